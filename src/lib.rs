//! vtex: any 3D source → a *texel* (a prefiltered, multiscale octree of directional opacity, normals and colour, in a
//! `.vtex` file) → pictures of landscapes covered with texels, at one cone per pixel.
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
//! | texel space | the cube \[0,1\]^3, axes (u, v, w) = source (X, −Z, Y), f64 |
//! | depth | 0 at the root; a voxel of depth d is 2^−d of the cube |
//! | rate | hits per voxel edge of the voxel's own depth |
//! | albedo, radiance | linear Rec. 709 |
//! | angles | radians |
//!
//! A mesh in memory becomes a texel, and the texel a file:
//!
//! ```
//! use vtex::bake::{Options, bake};
//! use vtex::format::{WriteOptions, write};
//! use vtex::progress::Quiet;
//! use vtex::scene::{Instance, Material, Model, Part};
//! use vtex::source::{MeshOptions, MeshSource};
//!
//! # fn main() -> vtex::Result<()> {
//! // One leaf: a green triangle, a metre long.
//! let leaf = Part {
//!     positions: vec![[0.0, 0.0, 0.0], [1.0, 0.2, 0.0], [0.5, 1.0, 0.3]],
//!     triangles: vec![[0, 1, 2]],
//!     ..Part::default()
//! };
//! let green = Material { name: "leaf".into(), base_color: [0.1, 0.5, 0.1, 1.0], ..Material::default() };
//! let model = Model {
//!     parts: vec![leaf],
//!     materials: vec![green],
//!     instances: vec![Instance { part: 0, transform: Default::default(), node: String::new() }],
//!     metres_per_unit: 1.0,
//!     ..Model::default()
//! };
//! let source = MeshSource::new(model, &MeshOptions::default());
//! let options = Options { resolution: 32, ..Options::default() };
//! let (texel, report) = bake(&source, &options, &Quiet, &mut |_| ())?;
//! assert_eq!(report.depths.len(), 6, "32 voxels along the edge, and every coarser depth down to one");
//! # let folder = std::env::temp_dir().join(format!("vtex-doc-{}", std::process::id()));
//! # std::fs::create_dir_all(&folder).map_err(|e| vtex::Error::io(&folder, e))?;
//! let path = folder.join("leaf.vtex");
//! write(&texel, &path, &WriteOptions::default())?;
//! # std::fs::remove_dir_all(&folder).map_err(|e| vtex::Error::io(&folder, e))?;
//! # Ok(())
//! # }
//! ```
//!
//! A texel in memory covers a landscape, and the landscape becomes a picture:
//!
//! ```
//! use std::sync::Arc;
//!
//! use vtex::progress::Quiet;
//! use vtex::render::{CameraChoice, Options, render};
//! use vtex::scene::shell::{Layer, ShellMaterial, TexelRef};
//! use vtex::scene::{Instance, Material, Model, Part, Scene};
//! use vtex::source::field::{FieldSource, Sphere};
//!
//! # fn main() -> vtex::Result<()> {
//! // A ball as the texel.
//! let ball = FieldSource::new(Box::new(Sphere { centre: [0.0; 3].into(), radius: 1.0 }), None)?;
//! let baking = vtex::bake::Options { resolution: 16, ..Default::default() };
//! let (texel, _) = vtex::bake::bake(&ball, &baking, &Quiet, &mut |_| ())?;
//! // A square of 4 × 4 m; a shell of a metre's thickness on it holds 4 × 4 copies.
//! let corners = [[-2.0, 2.0], [2.0, 2.0], [2.0, -2.0], [-2.0f32, -2.0]];
//! let ground = Part {
//!     positions: corners.map(|[x, z]| [x, 0.0, z]).to_vec(),
//!     normals: Some(vec![[0.0, 1.0, 0.0]; 4]),
//!     uvs: vec![vec![[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]],
//!     triangles: vec![[0, 1, 2], [0, 2, 3]],
//!     ..Part::default()
//! };
//! let layers = vec![Layer { texel: 0, ..Layer::default() }];
//! let shell = ShellMaterial { layers, ..ShellMaterial::default() };
//! let model = Model {
//!     parts: vec![ground],
//!     materials: vec![Material { shell: Some(Arc::new(shell)), ..Material::default() }],
//!     instances: vec![Instance { part: 0, transform: Default::default(), node: String::new() }],
//!     metres_per_unit: 1.0,
//!     ..Model::default()
//! };
//! let scene = Scene { model, texels: vec![TexelRef::in_memory("ball", Arc::new(texel))], ..Scene::default() };
//! let camera = CameraChoice::LookAt { eye: [3.0, 4.0, 5.0].into(), target: [0.0; 3].into(), yfov: 0.8 };
//! let picture = render(&scene, &Options { size: [32, 32], camera, ..Options::default() }, &Quiet)?.film;
//! assert!(picture.pixels.iter().any(|p| p[3] > 0.99), "the landscape is seen");
//! # Ok(())
//! # }
//! ```

pub mod error;
pub mod geom;
pub mod morton;
pub mod noise;
pub mod par;
pub mod progress;
pub mod random;
mod simd;
mod system;

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
