//! Scene → film.

pub mod image_io;
pub mod metrics;
mod descent;
pub mod march;
pub mod shade;
pub mod vndf;

pub use march::{DepthChoice, Hit, MarchStats, Sink, Stretch, march, transmittance};
