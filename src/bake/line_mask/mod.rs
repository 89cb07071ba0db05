//! Coverage by line masks: which lines of a lattice that all voxels share meet matter in a voxel, along the 13 axes.
//!
//! Based on: L. Carpenter, *The A-buffer, an Antialiased Hidden Surface Method*, SIGGRAPH 1984 (coverage as bit masks);
//! G. Loubet, F. Neyret, *Hybrid Mesh-Volume LoDs for All-Scale Pre-Filtering*, EG 2017 (opacity fitted to measured coverage).
//!
//! Masks are rasterized for the finest voxels only. The lines of a parent are one in four of its children's, chosen by a
//! fixed rule (quincunx), so a parent's mask is the union of its children's, and coverage is measured at every depth without
//! going back to the geometry. See [`crate::geom::projection`] for the lattice.

mod mask;
mod polygon;
mod rasterize;
mod union;

#[cfg(test)]
mod tests;

pub use mask::LineMask;
pub use rasterize::rasterize;
pub use union::{MaskUnion, unite};
