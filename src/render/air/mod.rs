//! The air: a clear sky and the sunlight that comes through it, computed from the physics of the atmosphere.

mod atmosphere;
mod clear;
mod spectrum;
#[cfg(test)]
mod tests;

pub use atmosphere::TURBIDITY;
pub use clear::ClearSky;
pub use spectrum::luminance;
