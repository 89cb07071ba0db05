//! Scene → film.

mod descent;
pub mod image_io;
pub mod march;
pub mod metrics;
pub mod preview;
pub mod shade;
pub mod vndf;

pub use march::{DepthChoice, Hit, MarchStats, Sink, Stretch, march, transmittance};
mod bvh;
mod cells;
mod shell;
