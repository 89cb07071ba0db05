//! Placement of a source in the grid of finest voxels.

use crate::geom::{Aabb, DAffine3, DMat3, DVec3};
use crate::volume::Info;

/// log2 of the voxels a region is wide; a texel of fewer voxels is one region.
pub const REGION_LOG2: usize = 4;

/// Placement of a source in the grid of finest voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// The box that the texel's cube is: a cube, or what wraps around along cyclic axes.
    pub bounds: Aabb,
    /// The source's own space → the space of `bounds`: where a source is placed as a part of another.
    pub transform: DAffine3,
    /// Voxel edges in a unit of that space.
    pub scale: f64,
    /// Finest depth: 2^depth voxels per side.
    pub depth: usize,
    /// Source axis that becomes w: 0 (+X up), 1 (+Y up) or 2 (+Z up).
    pub up: u8,
    /// Axes of the grid along which what reaches beyond comes in again on the other side.
    pub cyclic: [bool; 3],
    /// Bytes of memory that may be taken to lay the source into the grid; `u64::MAX`: no limit.
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

    /// Source space → grid space, [0, 2^depth]^3.
    pub fn to_grid(&self, p: DVec3) -> DVec3 {
        let p = self.turn(self.transform.transform_point3(p));
        (p - self.turned_min()) * self.scale
    }

    /// [`Placement::to_grid`] as a map.
    pub fn grid_map(&self) -> DAffine3 {
        let turned = DMat3::from_cols(self.turn(DVec3::X), self.turn(DVec3::Y), self.turn(DVec3::Z));
        let scaled = DMat3::from_diagonal(DVec3::splat(self.scale));
        DAffine3::from_mat3_translation(scaled * turned, -self.scale * self.turned_min()) * self.transform
    }

    /// The same with the source placed by `transform` within its own space.
    pub fn within(&self, transform: DAffine3) -> Placement {
        Placement { transform: self.transform * transform, ..*self }
    }

    /// A direction of the space of `bounds`, along u, v, w.
    fn turn(&self, p: DVec3) -> DVec3 {
        match self.up {
            0 => DVec3::new(p.y, p.z, p.x),
            1 => DVec3::new(p.x, -p.z, p.y),
            _ => p,
        }
    }

    fn turned_min(&self) -> DVec3 {
        self.turn(self.bounds.min).min(self.turn(self.bounds.max))
    }

    /// Places in the grid at which matter that fills `extent` (grid space) appears: by no shift, and by the whole sides along
    /// cyclic axes that bring some of it into the cube. A few at most.
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

    /// Voxels a side.
    pub fn side(&self) -> u32 {
        1 << self.depth
    }

    /// log2 of the voxels that a region of this placement is wide.
    pub fn region_log2(&self) -> usize {
        REGION_LOG2.min(self.depth)
    }
}
