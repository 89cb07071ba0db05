//! Scenes to render and models to bake: models read from files, as plain data with every default filled in.

pub mod alpha;
pub mod copies;
pub mod cycle;
pub mod emission;
#[cfg(feature = "bake")]
pub(crate) mod far;
pub(crate) mod files;
pub mod gltf;
pub(crate) mod image;
pub mod model;
#[cfg(feature = "bake")]
pub mod obj;
pub mod phong;
#[cfg(feature = "bake")]
pub mod raster;
pub(crate) mod select;
pub mod shell;
#[cfg(feature = "bake")]
pub(crate) mod text;
pub mod texture;
#[cfg(feature = "bake")]
pub(crate) mod tiff_file;
pub(crate) mod topology;
pub mod transmission;
#[cfg(feature = "bake")]
pub(crate) mod triangulate;
pub mod wind;

pub use emission::Emission;
pub use model::{Alpha, Camera, Instance, Light, LightKind, Material, Model, Part, Projection};
pub use texture::{Texture, TextureRef, Wrap};
pub use transmission::Transmission;

/// A landscape, ready to render: its geometry, and what its shells are filled with.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// Geometry, materials, cameras and lights.
    pub model: Model,
    /// Texels that the layers of the shells refer to.
    pub texels: Vec<shell::TexelRef>,
    /// Rigid copies of the texels.
    pub copies: Vec<copies::CopySet>,
    /// Sky and background.
    pub environment: shell::Environment,
}

/// Selection from a file, and limits on its size.
#[derive(Debug, Clone, PartialEq)]
pub struct ReadOptions {
    /// The scene by its name or, failing that, its index; by default the file's own choice.
    pub scene: Option<String>,
    /// Seconds at which the animations stand; none: everything as the file has it at rest. Before the first key and after
    /// the last, nodes stand as at those.
    pub time: Option<f64>,
    /// Names or, failing that, numbers of the animations that play. None: the first of the file, and every other that moves
    /// nothing that one before it moves.
    pub animations: Vec<String>,
    /// Whether the animations begin anew after the last key of all that play.
    pub repeat: bool,
    /// Names of nodes that are taken with all below them; `*` and `?` stand for any characters and any one. None: all.
    pub include: Vec<String>,
    /// Names of nodes that are left out with all below them, in the same form.
    pub exclude: Vec<String>,
    /// Bytes that may be taken for the files and what is decoded from them.
    pub max_bytes: u64,
    /// Pixels of one image.
    pub max_pixels: u64,
    /// Placed primitives, after EXT_mesh_gpu_instancing.
    pub max_instances: usize,
    /// Whether the files that it names must lie in its folder or below it, as those of a landscape must.
    pub contained: bool,
    /// Whether four-cornered faces of an OBJ file are bilinear patches, besides their triangles.
    pub patches: bool,
    /// Whether images are decoded; without them a texture is left out, the factor colour stays.
    pub textures: bool,
    /// Whether the light that surfaces give off is read, for which texels have no place.
    pub emission: bool,
}

impl Default for ReadOptions {
    fn default() -> Self {
        ReadOptions {
            scene: None,
            time: None,
            animations: Vec::new(),
            repeat: false,
            include: Vec::new(),
            exclude: Vec::new(),
            max_bytes: 8 << 30,
            max_pixels: 1 << 27,
            max_instances: 1 << 26,
            contained: false,
            patches: false,
            textures: true,
            emission: true,
        }
    }
}

/// The model in a glTF or, by its extension, an OBJ file.
///
/// # Errors
/// As [`gltf::read`] and [`obj::read`].
#[cfg(feature = "bake")]
pub fn read_model(path: &std::path::Path, options: &ReadOptions) -> crate::Result<Model> {
    let is_obj = files::extension(path) == "obj";
    if is_obj { obj::read(path, options) } else { gltf::read(path, options).map(|scene| scene.model) }
}
