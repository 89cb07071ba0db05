//! A model read from a file: triangles, lines and points with materials, placed by transforms; every default filled in.
//! Both the baker's mesh source and the renderer's landscape start from this.

use std::sync::Arc;

use super::emission::Emission;
use super::texture::TextureRef;
use super::transmission::Transmission;
use crate::Warnings;
use crate::geom::DAffine3;
use crate::volume::Finish;

/// Everything that was found in the chosen scene of a file.
#[derive(Debug, Clone, Default)]
pub struct Model {
    /// Primitives, each in its own space.
    pub parts: Vec<Part>,
    /// At least one; a part without a material uses a default that was appended.
    pub materials: Vec<Material>,
    /// Placements of the parts in the world.
    pub instances: Vec<Instance>,
    /// Cameras in world space.
    pub cameras: Vec<Camera>,
    /// Punctual lights in world space.
    pub lights: Vec<Light>,
    /// Metres in a unit of the file: 1 for glTF, 0 (unknown) for OBJ.
    pub metres_per_unit: f64,
    /// Warnings of the reader.
    pub warnings: Warnings,
}

/// One primitive of a mesh, in its own space. Attribute arrays are as long as `positions`; values are finite.
#[derive(Debug, Clone, Default)]
pub struct Part {
    /// Mesh name, for messages.
    pub name: String,
    /// Positions of the vertices, in part space.
    pub positions: Vec<[f32; 3]>,
    /// Unit length, or absent.
    pub normals: Option<Vec<[f32; 3]>>,
    /// TEXCOORD_0, _1, …
    pub uvs: Vec<Vec<[f32; 2]>>,
    /// Linear RGBA, multiplied into the base colour.
    pub colors: Option<Vec<[f32; 4]>>,
    /// Indices below `positions.len()`; strips, fans and loops are already taken apart.
    pub triangles: Vec<[u32; 3]>,
    /// Bilinear patches, as indices of their corners at (U, V) = (0, 0), (1, 0), (1, 1), (0, 1). Patch i is also two triangles,
    /// 2i and 2i + 1, over its corners 0, 1, 2 and 0, 2, 3; those of all patches come first.
    pub patches: Vec<[u32; 4]>,
    /// Patches of the file that are collapsed to triangles, and no longer among `patches`.
    pub collapsed_patches: u64,
    /// Pairs of indices below `positions.len()`.
    pub lines: Vec<[u32; 2]>,
    /// Indices below `positions.len()`.
    pub points: Vec<u32>,
    /// Index into [`Model::materials`].
    pub material: usize,
    /// `_VTEX_UVW` of each vertex: texel coordinates at the base of the shell.
    pub uvw: Option<Vec<[f32; 3]>>,
    /// `_VTEX_HEIGHT` of each vertex.
    pub heights: Option<Vec<[f32; 3]>>,
    /// `_VTEX_DW` of each vertex.
    pub dw: Option<Vec<f32>>,
    /// `_VTEX_JITTER` of each vertex.
    pub jitter: Option<Vec<f32>>,
}

/// A part placed in the world.
#[derive(Debug, Clone)]
pub struct Instance {
    /// Index into [`Model::parts`].
    pub part: usize,
    /// Part space → world.
    pub transform: DAffine3,
    /// Name of the node, for `--include`, `--exclude` and messages.
    pub node: String,
}

/// Interpretations of alpha.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Alpha {
    /// Alpha is ignored.
    #[default]
    Opaque,
    /// Opaque where alpha ≥ the cutoff, transparent elsewhere.
    Mask(f32),
    /// Partly transparent: alpha is the share of light that is stopped.
    Blend,
}

impl Alpha {
    /// Opacity in [0, 1] of a point where the base colour's alpha is `alpha`.
    pub fn share(self, alpha: f32) -> f32 {
        /// Rounding error of a filtered alpha that equals the cutoff: the weights of a lookup add up to 1 within this.
        const ROUNDING: f32 = 1e-6;
        match self {
            Alpha::Opaque => 1.0,
            Alpha::Mask(cutoff) => f32::from(u8::from(alpha >= cutoff - ROUNDING)),
            Alpha::Blend => alpha.clamp(0.0, 1.0),
        }
    }
}

/// A surface: base colour = factor · texture · vertex colour.
#[derive(Debug, Clone)]
pub struct Material {
    /// Name in the file, for messages.
    pub name: String,
    /// Linear RGBA.
    pub base_color: [f32; 4],
    /// Texture of the base colour.
    pub texture: Option<TextureRef>,
    /// Interpretation of alpha.
    pub alpha: Alpha,
    /// Whether both sides of a face are seen.
    pub double_sided: bool,
    /// Shown in its base colour whatever the light.
    pub unlit: bool,
    /// Ambient factor and highlights, of a texel's source to which a landscape gives them.
    pub finish: Finish,
    /// Light that it gives off by itself; `None`: none.
    pub emission: Option<Box<Emission>>,
    /// Light that comes through; `None`: none does.
    pub transmission: Option<Box<Transmission>>,
    /// The `VTEX_volumetric_texture` extension, where the material carries it.
    pub shell: Option<Arc<super::shell::ShellMaterial>>,
    /// The wind in which the height vectors of its shell bend.
    pub wind: Option<super::wind::WindField>,
}

impl Default for Material {
    fn default() -> Self {
        Material {
            name: String::new(),
            base_color: [1.0; 4],
            texture: None,
            alpha: Alpha::Opaque,
            double_sided: true,
            unlit: false,
            finish: Finish::PLAIN,
            emission: None,
            transmission: None,
            shell: None,
            wind: None,
        }
    }
}

/// A camera of the file, in world space. It looks along −z of `to_world`, +y up.
#[derive(Debug, Clone)]
pub struct Camera {
    /// Name in the file, for messages.
    pub name: String,
    /// Map from its own space to the world.
    pub to_world: DAffine3,
    /// Projection of the view.
    pub projection: Projection,
    /// Width of its picture for a height of 1; `None` where the file leaves it to the viewer.
    pub aspect: Option<f64>,
}

/// Projection of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// Rays through one point.
    Perspective {
        /// Vertical field of view, radians, in (0, π).
        yfov: f64,
    },
    /// Parallel rays.
    Orthographic {
        /// Half the height of the view, metres.
        ymag: f64,
    },
}

/// A punctual light (KHR_lights_punctual), in world space. It shines along −z of `to_world`.
#[derive(Debug, Clone)]
pub struct Light {
    /// Name in the file, for messages.
    pub name: String,
    /// Map from its own space to the world.
    pub to_world: DAffine3,
    /// Colour × intensity, linear: irradiance for a directional light, radiant intensity for the others.
    pub intensity: [f64; 3],
    /// Kind of the light.
    pub kind: LightKind,
    /// Metres beyond which it gives nothing; infinite where absent.
    pub range: f64,
}

/// Kinds of punctual lights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LightKind {
    /// Parallel rays.
    Directional,
    /// Light from a point, the same in all directions.
    Point,
    /// Light from a point within a cone.
    Spot {
        /// Half-angle up to which the light is full, radians.
        inner: f64,
        /// Half-angle at which it ends, radians.
        outer: f64,
    },
}
