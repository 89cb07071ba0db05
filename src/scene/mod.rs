//! What is rendered and baked: models read from files, as plain data with every default filled in.

mod files;
pub mod gltf;
mod image;
pub mod model;
mod select;
pub mod shell;
pub mod texture;
mod topology;

pub use model::{Alpha, Camera, Instance, Light, LightKind, Material, Model, Part, Projection, TextureRef};
pub use texture::{Texture, Wrap};

/// A landscape, ready to render: its geometry, and what its shells are filled with.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    pub model: Model,
    pub texels: Vec<shell::TexelRef>,
    pub environment: shell::Environment,
}
