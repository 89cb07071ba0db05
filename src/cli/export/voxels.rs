//! The voxels of one depth, each with its place in the copy's own space: what every exporter begins with.

use glam::DAffine3;

use crate::Result;
use crate::format::Reader;
use crate::scene::copies::to_texel;
use crate::volume::Pages;
use crate::volume::cells::{Cell, cells};

/// One depth of a texel.
pub struct Voxels {
    /// Voxels along the cube's edge.
    pub resolution: u32,
    pub cells: Vec<Cell>,
    /// The unit cube → the copy's own space: metres, +Y up, the source's origin at 0.
    pub to_own: DAffine3,
}

/// See [`cells`].
pub fn of(reader: &Reader, depth: usize, most: usize) -> Result<Voxels> {
    let depth = depth.min(reader.counts().len().saturating_sub(1));
    let cells = cells(reader, depth, most)?;
    Ok(Voxels { resolution: 1 << depth, cells, to_own: to_texel(&reader.head().info).inverse() })
}
