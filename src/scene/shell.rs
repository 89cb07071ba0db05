//! The content of the glTF extension `VTEX_volumetric_texture` (see `docs/landscapes.md`) as plain data with all defaults filled in.

use std::sync::Arc;

use super::cycle::Cycle;
use super::phong::Phong;
use crate::volume::{Palette, Volume};

/// Name of the extension in glTF files.
pub const EXTENSION_NAME: &str = "VTEX_volumetric_texture";

/// A texel that the landscape names, with a palette; a texel that layers show in several palettes has one entry for each.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TexelRef {
    /// Name of the texel.
    pub name: String,
    /// The `.vtex` files of its frames, in order; at least one, unless the texel is in `memory`. Paths are resolved against the
    /// landscape's folder.
    pub frames: Vec<std::path::PathBuf>,
    /// The source mesh, for the reference render.
    pub geometry: Option<std::path::PathBuf>,
    /// Deepest depth to be used.
    pub max_depth: Option<u8>,
    /// Content identifier of the first frame's file, if the landscape was made for that alone.
    pub content_id: Option<[u8; 16]>,
    /// Colours in which it is shown.
    pub palette: Palette,
    /// Facts about each of its frames; empty if the landscape states none.
    pub facts: Vec<FrameFacts>,
    /// Bytes of the first frame's file, if it is embedded in the landscape; its path then names the position there.
    pub bytes: Option<Arc<[u8]>>,
    /// Pose of its `geometry` in this frame; `None` for the rest pose.
    pub pose: Option<Pose>,
    /// Number of further frames of this texel, which follow it in the scene's list. A copy shows one of all these frames, by `cycle`.
    pub following: u32,
    /// Which frame a copy shows, where there are several.
    pub cycle: Option<Cycle>,
    /// The texel itself, if the caller has it in memory; then no file is read.
    pub memory: Option<Arc<Volume>>,
}

impl TexelRef {
    /// A texel that needs no file.
    pub fn in_memory(name: impl Into<String>, volume: Arc<Volume>) -> TexelRef {
        TexelRef { name: name.into(), memory: Some(volume), ..TexelRef::default() }
    }
}

/// One frame of a texel.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrameFacts {
    /// Content identifier of its file, if the landscape was made for that alone.
    pub content_id: Option<[u8; 16]>,
    /// Bytes of its file, if that is embedded in the landscape.
    pub bytes: Option<Arc<[u8]>>,
    /// Pose of the texel's `geometry` when the frame was baked.
    pub pose: Option<Pose>,
}

/// Pose of an animated model.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Pose {
    /// Seconds.
    pub time: f64,
    /// Names of the animations that play; if empty, the choice of [`crate::scene::ReadOptions::animations`].
    pub animations: Vec<String>,
}

/// `environment` of the root.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Environment {
    /// The sky that lights the scene.
    pub sky: Option<Sky>,
    /// Radiance that an escaped camera ray sees, linear.
    pub background: Option<[f64; 3]>,
    /// Angular size of directional lights, radians.
    pub sun_angle: Option<f64>,
    /// Visibility in haze, metres.
    pub haze: Option<f64>,
}

/// The sky that lights a scene.
#[derive(Debug, Clone, PartialEq)]
pub enum Sky {
    /// The same radiance from everywhere, linear Rec. 709.
    Constant([f64; 3]),
    /// A clear sky that fits the sun: the optical depth of the air over that of the molecules alone, 1 to 10.
    Clear(f64),
    /// A picture of all directions: `.exr`, `.hdr` or `.png`, twice as wide as high.
    Picture(std::path::PathBuf),
}

impl From<[f64; 3]> for Sky {
    fn from(radiance: [f64; 3]) -> Sky {
        Sky::Constant(radiance)
    }
}

/// The extension object of a material.
#[derive(Debug, Clone, PartialEq)]
pub struct ShellMaterial {
    /// Index of the set of texture coordinates that gives u and v.
    pub tex_coord: usize,
    /// Texel coordinate w at the base of the shell.
    pub w: f64,
    /// Difference of w between the top and the base of the shell.
    pub dw: f64,
    /// Metres: H = thickness · NORMAL where `_VTEX_HEIGHT` is absent.
    pub thickness: f64,
    /// Whether the base face itself is drawn.
    pub surface_visible: bool,
    /// 1 … 16.
    pub layers: Vec<Layer>,
}

impl Default for ShellMaterial {
    /// What the extension says of what is absent, with one layer.
    fn default() -> Self {
        let layers = vec![Layer::default()];
        ShellMaterial { tex_coord: 0, w: 0.0, dw: 1.0, thickness: 1.0, surface_visible: true, layers }
    }
}

/// Continuation of a texel beyond its unit cell along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CellWrap {
    /// The cell is repeated.
    Repeat,
    /// The cell is repeated, every second one mirrored.
    Mirror,
    /// There is nothing beyond the cell.
    Empty,
}

/// One texel in a shell.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Index into the root's texels.
    pub texel: usize,
    /// Along u, v, w; default repeat, repeat, empty.
    pub wrap: [CellWrap; 3],
    /// Texel coordinate = uvw · scale + offset.
    pub offset: [f64; 3],
    /// Scale of the same map, along u, v, w.
    pub scale: [f64; 3],
    /// Lower and upper share of the height vectors between which the layer lies, in [0, 1]: w at the lower end, w + dw at the upper.
    pub skin_range: [f64; 2],
    /// Multiplies the rates, ≥ 0.
    pub opacity_scale: f64,
    /// Whether it is composited over the layers before it where matter of both is in one place. Otherwise it mixes with the layer before it, and
    /// lies over the same layers as that one.
    pub over: bool,
    /// Modification of the texel's material.
    pub phong: Phong,
    /// Variation per cell; `None` where all cells are alike.
    pub discrete: Option<Discrete>,
    /// Noise that bends the texel coordinates; `None` where nothing does.
    pub continuous: Option<Continuous>,
}

impl Default for Layer {
    /// The root's first texel, as the extension's defaults have it.
    fn default() -> Self {
        Layer {
            texel: 0,
            wrap: [CellWrap::Repeat, CellWrap::Repeat, CellWrap::Empty],
            offset: [0.0; 3],
            scale: [1.0; 3],
            skin_range: [0.0, 1.0],
            opacity_scale: 1.0,
            over: false,
            phong: Phong::default(),
            discrete: None,
            continuous: None,
        }
    }
}

/// Per-cell variation of isolated objects, hashed from the integer cell and the seed.
#[derive(Debug, Clone, PartialEq)]
pub struct Discrete {
    /// Seed of the hash.
    pub seed: u32,
    /// Orientations to choose from.
    pub orientations: Orientations,
    /// Whether a copy may be mirrored along u, v, w: half of them are.
    pub mirror: [bool; 3],
    /// Uniform scale about the cell's base centre, [min, max], 0 < min ≤ max ≤ 1.
    pub scale: [f64; 2],
    /// Largest displacement along u, v, w, in cells; along an axis whose wrap is empty the content stays in its cell.
    pub displace: [f64; 3],
    /// Share of cells that hold an object.
    pub presence: f64,
    /// Texels to choose from; empty: the layer's own.
    pub variants: Vec<Variant>,
    /// A ramp of linear colours; each copy's albedo is multiplied by a random one of them. If empty, by 1.
    pub tint: Vec<[f64; 3]>,
}

impl Default for Discrete {
    /// Copies that are all alike.
    fn default() -> Self {
        Discrete {
            seed: 0,
            orientations: Orientations::Identity,
            mirror: [false; 3],
            scale: [1.0; 2],
            displace: [0.0; 3],
            presence: 1.0,
            variants: Vec::new(),
            tint: Vec::new(),
        }
    }
}

/// Noise that bends the texel coordinates of a cyclic texel: what it does is in `format-spec/landscape-1.md`, §4.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Continuous {
    /// Seed of the noise.
    pub seed: u32,
    /// Lattice cells of the noise per cell of the texel, along u, v, w; above 0.
    pub frequency: [f64; 3],
    /// 1 … 8.
    pub octaves: u32,
    /// Largest displacement of texel coordinates, in cells; ≥ 0.
    pub uvw_amplitude: [f64; 3],
    /// Largest tilt of height vectors, radians in texel space, in [0, 1.2].
    pub height_tilt: f64,
    /// Largest relative change of the length of height vectors, in [0, 0.9].
    pub height_scale: f64,
}

/// One of several texels of a layer.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    /// Index into the root's texels.
    pub texel: usize,
    /// > 0.
    pub weight: f64,
    /// Modification of the texel's material, in addition to the layer's.
    pub phong: Phong,
}

impl Variant {
    /// The only variant of a layer, in the texel's own colours.
    pub fn alone(texel: usize) -> Variant {
        Variant { texel, weight: 1.0, phong: Phong::default() }
    }
}

/// Orientations that the objects of cells may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Orientations {
    /// As the texel was baked.
    #[default]
    Identity,
    /// Quarter turns about w.
    W4,
    /// Quarter turns about w, mirrored or not.
    W8,
    /// All turns that take the cube's axes to axes.
    Cube24,
    /// The same, mirrored or not.
    Cube48,
}
