//! What matter is: every kind of source gives the same things – facets, semi-transparent media, and what is inside – one
//! region of the grid at a time.
//!
//! The door is [`Source`] and [`Staged`], with [`Placement`] and what they speak of: [`Polygon`], [`Medium`], [`Surface`],
//! [`AlphaSampler`]. A bake knows only these. Behind it is a folder or a file for each kind; [`open`](open()) chooses one by a file's name.

pub mod curve;
pub mod emitter;
mod facets;
pub mod field;
pub mod group;
pub mod hypertexture;
pub mod layers;
mod ledger;
mod loops;
pub mod lsystem;
pub mod materials;
mod medium;
pub mod mesh;
mod mixture;
pub mod noise;
mod open;
mod options;
pub mod paint;
mod placement;
pub mod recipe;
pub mod stack;
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
pub(crate) use medium::least_extinction;
pub use mesh::{Fill, MeshOptions, MeshSource};
pub use open::{dependencies, open};
pub use options::{FileKind, OpenOptions, READING, file_kind, unread};
pub use placement::{Placement, REGION_LOG2};
pub use recipe::{Laid, laid_files, lay};
pub use stack::{StackOptions, StackSource};
pub use traits::{AlphaSampler, FACET_MEMORY, Source, Staged, Surface};
