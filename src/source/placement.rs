//! Placement of a source in the grid of finest voxels.

use crate::geom::{Aabb, DAffine3, DMat3, DVec3};
use crate::volume::Info;
use crate::volume::axes::{source_to_uvw, to_uvw};

/// log2 of the width of a region in voxels. A smaller texel is a single region.
pub const REGION_LOG2: usize = 4;

/// Placement of a source in the grid of finest voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Box, in the space that the source is placed in, that becomes the texel's cube.
    pub bounds: Aabb,
    /// Transform from the source's own space to that of `bounds`, for sources that are parts of another source.
    pub transform: DAffine3,
    /// Number of voxel edges per unit of the space of `bounds`.
    pub scale: f64,
    /// Finest depth: 2^depth voxels per side.
    pub depth: usize,
    /// Source axis that becomes w: 0 (+X up), 1 (+Y up) or 2 (+Z up).
    pub up: u8,
    /// Axes of the grid along which matter that reaches beyond the cube comes in again on the other side.
    pub cyclic: [bool; 3],
    /// Bytes of memory that staging the source may take; `u64::MAX` for no limit.
    pub memory: u64,
}

impl Placement {
    /// Placement of the source of a texel with this `info`, with `depth` as the finest depth.
    pub fn of(info: &Info, depth: usize) -> Placement {
        Placement {
            bounds: info.bounds,
            transform: DAffine3::IDENTITY,
            scale: libm::exp2(depth as f64) / info.bounds.size().x,
            depth,
            up: info.up,
            cyclic: info.cyclic,
            memory: u64::MAX,
        }
    }

    /// Map a point from source space to grid space, [0, 2^depth]^3.
    pub fn to_grid(&self, p: DVec3) -> DVec3 {
        let p = to_uvw(self.up, self.transform.transform_point3(p));
        (p - self.turned_min()) * self.scale
    }

    /// [`Placement::to_grid`] as a map.
    pub fn grid_map(&self) -> DAffine3 {
        let scaled = DMat3::from_diagonal(DVec3::splat(self.scale));
        DAffine3::from_mat3_translation(scaled * source_to_uvw(self.up), -self.scale * self.turned_min())
            * self.transform
    }

    /// Placement of a source that is placed by `transform` in the space of the source that this placement is of.
    pub fn within(&self, transform: DAffine3) -> Placement {
        Placement { transform: self.transform * transform, ..*self }
    }

    fn turned_min(&self) -> DVec3 {
        to_uvw(self.up, self.bounds.min).min(to_uvw(self.up, self.bounds.max))
    }

    /// Translations (grid space) under which matter in the box `extent` appears in the cube: along cyclic axes all multiples of the
    /// cube's edge that bring a part of it into the cube, and no translation along the others.
    pub fn shifts(&self, extent: Aabb) -> Vec<DVec3> {
        let side = f64::from(self.side());
        let mut out = vec![DVec3::ZERO];
        if extent.is_empty() {
            return out;
        }
        for axis in (0..3).filter(|&a| self.cyclic[a]) {
            let first = -(extent.max[axis] / side).floor().clamp(-64.0, 64.0) as i32;
            let last = -(extent.min[axis] / side).floor().clamp(-64.0, 64.0) as i32;
            let step = |n: i32| {
                let mut shift = DVec3::ZERO;
                shift[axis] = f64::from(n) * side;
                shift
            };
            out = (first..=last).flat_map(|n| out.iter().map(move |s| *s + step(n)).collect::<Vec<_>>()).collect();
        }
        out
    }

    /// Number of voxels along the cube's edge.
    pub fn side(&self) -> u32 {
        1 << self.depth
    }

    /// log2 of the width of a region in voxels.
    pub fn region_log2(&self) -> usize {
        REGION_LOG2.min(self.depth)
    }
}
