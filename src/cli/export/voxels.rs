//! The voxels of one depth, each with its place in the copy's own space: what every exporter begins with.

use glam::{DAffine3, DVec3};

use crate::Result;
use crate::format::Reader;
use crate::geom::Aabb;
use crate::scene::copies::to_texel;
use crate::scene::far;
use crate::volume::Pages;
use crate::volume::cells::{Cell, cells};
use crate::volume::voxel::decode_rate;

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

impl Voxels {
    /// Edge of the cube, metres.
    pub fn size(&self) -> f64 {
        self.to_own.matrix3.x_axis.length()
    }

    /// Low corner of the cube along the copy's own axes, which are u, w and −v, relative to `origin`.
    pub fn own_origin(&self) -> DVec3 {
        self.to_own.transform_point3(DVec3::Y)
    }

    /// Low corner of a cell along the copy's own axes, in voxels from [`Voxels::own_origin`].
    pub fn own_corner(&self, cell: &Cell) -> [u32; 3] {
        let [u, v, w] = cell.corner;
        [u, w, self.resolution - v - cell.edge]
    }

    /// Middle of a cell's matter, the copy's own space, metres, relative to `origin`.
    pub fn own_middle(&self, cell: &Cell) -> DVec3 {
        let (low, high) = cell.support(self.resolution);
        self.to_own.transform_point3((low + high) / 2.0)
    }

    /// Extinction per voxel along the direction from which most of a cell's facets are seen, where its matter is spread over the
    /// whole cell.
    pub fn extinction(&self, cell: &Cell) -> f64 {
        // Rates are by the edge of the node's own depth.
        let (low, high) = cell.voxel.support_box();
        f64::from(decode_rate(cell.voxel.rate) * (high - low).element_product() / cell.edge as f32)
    }
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
