//! vtex: any 3D source → a *texel* (a prefiltered, multiscale octree of directional opacity, normals and colour, in a
//! `.vtex` file) → pictures of landscapes covered with texels, at one cone a pixel.
//!
//! Data flows one way, and each step is a module:
//!
//! ```text
//! source ──bake──▶ volume ──format──▶ .vtex ──scene──▶ Scene ──render──▶ Film
//!                                    (both bake and render let rays march through a texel: march)
//! ```
//!
//! | quantity | unit |
//! |---|---|
//! | world space | metres, right-handed, +Y up (glTF), f64 |
//! | texel space | the cube [0,1]^3, axes (u, v, w) = source (X, −Z, Y), f64 |
//! | depth | 0 at the root; a voxel of depth d is 2^−d of the cube |
//! | rate | hits per voxel edge of the voxel's own depth |
//! | albedo, radiance | linear Rec. 709 |
//! | angles | radians |

pub mod error;
pub mod geom;
pub mod morton;
pub mod par;
pub mod progress;
pub mod random;

pub mod format;
pub mod march;
pub mod scene;
pub mod volume;

#[cfg(feature = "bake")]
pub mod bake;
#[cfg(feature = "cli")]
pub mod cli;
#[cfg(feature = "bake")]
pub mod merge;
#[cfg(feature = "render")]
pub mod render;
#[cfg(feature = "bake")]
pub mod source;

pub use error::{Error, Result, Warnings};
