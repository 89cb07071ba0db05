//! The voxels of one depth, each with its place in the copy's own space: what every exporter begins with.

use glam::{DAffine3, DVec3};

use crate::Result;
use crate::format::Reader;
use crate::geom::Aabb;
use crate::scene::copies::to_texel;
use crate::scene::far;
use crate::volume::Pages;
use crate::volume::cells::{Cell, cells};

/// One depth of a texel.
pub struct Voxels {
    /// Voxels along the cube's edge.
    pub resolution: u32,
    pub cells: Vec<Cell>,
    /// The unit cube → the copy's own space: metres, +Y up, relative to `origin`.
    pub to_own: DAffine3,
    /// 0, where the source's origin is, or a round place near matter that is far from it: files hold 32 bits of a number.
    pub origin: DVec3,
}

/// See [`cells`].
pub fn of(reader: &Reader, depth: usize, most: usize) -> Result<Voxels> {
    let depth = depth.min(reader.counts().len().saturating_sub(1));
    let cells = cells(reader, depth, most)?;
    let mut to_own = to_texel(&reader.head().info).inverse();
    let origin = far::offset(Aabb::around([DVec3::ZERO, DVec3::ONE].map(|p| to_own.transform_point3(p))));
    to_own.translation -= origin;
    Ok(Voxels { resolution: 1 << depth, cells, to_own, origin })
}
