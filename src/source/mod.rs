//! Sources of matter: meshes, curves, image stacks, L-systems, implicit fields, recipes and texels.
//!
//! All kinds implement the same interface, [`Source`] and [`Staged`]: they give facets ([`Polygon`]), semi-transparent matter
//! ([`Medium`]), and whether a point is inside of opaque matter, one region of the grid at a time. A bake knows only this interface,
//! with [`Placement`], [`Surface`] and [`AlphaSampler`], which belong to it. Each kind has a folder or a file; [`open`](open())
//! chooses the kind by a file's name.

pub mod curve;
pub mod emitter;
mod facets;
pub mod field;
pub mod group;
pub mod hypertexture;
pub mod layers;
mod loops;
pub mod lsystem;
pub mod materials;
mod medium;
mod memory_budget;
pub mod mesh;
mod mixture;
pub mod noise;
mod open;
mod options;
pub mod paint;
mod placement;
pub mod recipe;
pub mod stack;
mod tessellate;
pub mod texel;
mod traits;

pub use crate::geom::polygon::{MAX_CORNERS, Polygon};
pub use crate::scene::alpha::AlphaClass;
pub use curve::trajectory::TrajectoryOptions;
pub use curve::{CurveOptions, CurveSource, Interpolation, Section, Strand};
pub use facets::{FacetTriangle, Facets, facets};
pub use group::{GroupSource, Part};
pub use lsystem::LSystemOptions;
pub use medium::Medium;
pub(crate) use medium::min_extinction;
pub use mesh::{Fill, MeshOptions, MeshSource};
pub use open::{dependencies, open};
pub use options::{FileKind, OpenOptions, READ_OPTIONS, file_kind, unused_by};
pub use placement::{Placement, REGION_LOG2};
pub use recipe::{PaintOptions, apply_paint, paint_files};
pub use stack::{StackOptions, StackSource};
pub use tessellate::tessellate;
pub use traits::{AlphaSampler, FACET_MEMORY, Source, Staged, Surface};
