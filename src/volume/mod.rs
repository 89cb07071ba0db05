//! A texel in memory: voxels on a sparse octree, their materials, and the law of opacity along a ray.
//!
//! Texel space is the cube \[0,1\]^3 with axes (u, v, w), w up; at depth d it is cut into (2^d)^3 voxels. Depth 0 is the root.

pub mod axes;
pub mod brightness;
pub mod cells;
#[cfg(feature = "bake")]
pub(crate) mod chord;
pub mod finish;
pub mod material;
pub mod ndf;
pub mod octree;
pub mod opacity;
pub mod palette;
pub mod surface;
pub mod voxel;

pub use finish::{Finish, Gloss};
pub use material::{Material, Mix};
pub use ndf::Sggx;
pub use octree::{Block, Octree, Pages};
pub use palette::{Palette, Style};
pub use voxel::Voxel;

use crate::geom::Aabb;

/// Deepest depth that a texel may have: 65 536 voxels per side.
pub const MAX_DEPTH: usize = 16;

/// Appearance models that voxels may hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// A rate that depends on the direction (SGGX), fitted to measured coverage, with a support box and one correlation per
    /// block.
    #[default]
    Coverage,
    /// The model of Neyret 1996: one averaged isotropic opacity. The normal distribution is for shading alone.
    Neyret,
}

/// Description of a texel besides its voxels.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Info {
    /// The box in source space (source axes and units) that texel space covers.
    pub bounds: Aabb,
    /// Metres per source unit; 0 where unknown.
    pub metres_per_unit: f64,
    /// Source axis that became w: 0 x, 1 y, 2 z.
    pub up: u8,
    /// Whether opposite faces match, along u, v, w.
    pub cyclic: [bool; 3],
    /// The model that the voxels hold.
    pub model: Model,
    /// The content's tight box in texel space.
    pub content: Aabb,
    /// Edge of a mean facet patch (half a leaf, a twig) in texel-cube edges: where a shadow ray starts. 0: unknown.
    pub facet_size: f64,
    /// Which of a voxel's fields carry information; the others are constant.
    pub channels: Channels,
    /// Materials; the index of one is its id in [`Mix`]. Voxels store mixes where there are two or more of them. At most
    /// [`material::MAX_MATERIALS`].
    pub materials: Vec<Material>,
    /// Everything else that META holds, with keys in sorted order: the generator, the sources, the options of the bake, and its
    /// certificate (the error that the bake measured of itself).
    pub meta: serde_json::Map<String, serde_json::Value>,
}

/// Description of a texel that fills the unit cube, +Y up, in metres, with none of the channels.
impl Default for Info {
    fn default() -> Info {
        Info {
            bounds: Aabb::UNIT,
            metres_per_unit: 1.0,
            up: 1,
            cyclic: [false; 3],
            model: Model::Coverage,
            content: Aabb::UNIT,
            facet_size: 0.0,
            channels: Channels::default(),
            materials: Vec::new(),
            meta: serde_json::Map::new(),
        }
    }
}

/// Which of a voxel's fields were measured; a field that was not is left at its default by every reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub struct Channels {
    /// Block correlation.
    pub correlation: bool,
    /// Support box.
    pub support: bool,
    /// Albedo.
    pub albedo: bool,
    /// Mean area vector.
    pub mean_normal: bool,
}

/// One depth of a [`Volume`]: its nodes in Morton order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Depth {
    /// Child mask of each node (bit x + 2y + 4z). 0 on a depth above the finest: terminal, the node fills its whole cube.
    /// On the finest depth every mask is 0.
    pub masks: Vec<u8>,
    /// The voxel of each node, as long as `masks`.
    pub voxels: Vec<Voxel>,
    /// Shares of the texel's materials that each node shows, as long as `voxels`; empty where there are fewer than two.
    pub mixes: Vec<Mix>,
}

/// A whole texel in memory: what a bake makes and a writer takes.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    /// Description of the texel.
    pub info: Info,
    /// `depths[0]` has the root (or nothing, for an empty texel); at most `MAX_DEPTH + 1`.
    pub depths: Vec<Depth>,
}

impl Volume {
    /// Number of voxels per side at the finest depth.
    pub fn resolution(&self) -> u32 {
        1 << self.depths.len().saturating_sub(1)
    }
}
