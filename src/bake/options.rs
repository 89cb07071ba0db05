//! Options of a bake.

use crate::geom::Aabb;
use crate::volume::Model;

/// Largest resolution, in voxels along the cube's edge.
pub const MAX_RESOLUTION: u32 = 4096;

/// Default of [`Options::refine`]: groups grow up to the whole texel, so that it as a whole covers the area that was measured.
pub const REFINE: u8 = MAX_REFINE;
/// Largest value of [`Options::refine`].
pub const MAX_REFINE: u8 = 10;

/// Options of a bake.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Voxels along the cube's edge, 1 … 4096; rounded up to a power of two.
    pub resolution: u32,
    /// Edge of the finest voxel in source units. If it is given, the cube has as many voxels per edge as the source needs. Cyclic
    /// axes do not count for that: matter that reaches beyond the cube along them comes in again on the other side, and the cube
    /// has at least `resolution` voxels per edge.
    pub voxel_size: Option<f64>,
    /// Appearance model that is fitted.
    pub model: Model,
    /// Whether the texel tiles with itself along u, v and w.
    pub cyclic: [bool; 3],
    /// Source axis that becomes w: 1 (+Y) or 2 (+Z).
    pub up: u8,
    /// Largest number of bytes of memory that the bake may take besides the source; 0 for no limit.
    pub memory: u64,
    /// Cube of the texel in source space; by default it is found from the source's bounds.
    pub cube: Option<Aabb>,
    /// Number of sizes of groups of blocks, each twice as wide as the last, whose rates are corrected by marching them; 0: none.
    pub refine: u8,
    /// Whether voxels store mixes of the source's materials.
    pub materials: bool,
    /// Whether the brightness of the depths is measured against the finest, so that pictures do not step in brightness where the
    /// depth changes ([`crate::volume::brightness`]).
    pub calibrate: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            resolution: 512,
            voxel_size: None,
            model: Model::Coverage,
            cyclic: [false; 3],
            up: 1,
            memory: 0,
            cube: None,
            refine: REFINE,
            materials: true,
            calibrate: true,
        }
    }
}
