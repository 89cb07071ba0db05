//! How a ray crosses one texel: the cells that it meets, what they take of its light, and how they are lit.
//!
//! Both sides use it: a bake to calibrate the brightness of a texel's depths, the renderer for every cone.

pub mod calibrate;
mod descent;
pub mod shade;
pub mod specular;
pub mod transmittance;
pub mod vndf;
