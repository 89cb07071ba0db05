//! Options of a render.

use std::fmt;
use std::str::FromStr;

use crate::geom::DVec3;
pub use crate::scene::shell::Sky;

/// Options of [`super::render`]; the default is what `vtex render` does without flags.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Pixels, width and height, each 1 … 65 536.
    pub size: [u32; 2],
    /// Part of the picture that is rendered; by default all of it.
    pub crop: Option<CropWindow>,
    /// Camera that the picture is seen from.
    pub camera: CameraChoice,
    /// The sky that lights the scene; overrides the file's. By default a clear sky that fits the sun.
    pub sky: Option<Sky>,
    /// Radiance that an escaped camera ray sees, linear; overrides the file's.
    pub background: Option<[f64; 3]>,
    /// Share of the sky that lights a point.
    pub ambient: Ambient,
    /// Where the sun stands; the file's brightest directional light is moved there.
    pub sun: Option<SunPosition>,
    /// Angular size of directional lights, radians; overrides the file's. By default the sun's, .53 degrees.
    pub sun_angle: Option<f64>,
    /// Visibility in haze, metres; overrides the file's. By default the air is clear.
    pub haze: Option<f64>,
    /// Cones per pixel: 1, 2, 4, 8 or 16.
    pub lanes: u32,
    /// Exposure in stops: the film is multiplied by 2^exposure.
    pub exposure: f64,
    /// Factor of the intensity of the file's lights: 1 takes them as radiometric, 1 / [`super::LUMENS_PER_WATT`] as
    /// photometric. Sky and emission are not affected.
    pub light_scale: f64,
    /// Most bytes that the scene's triangles and shells may take, placed as often as the scene shows them.
    pub memory: u64,
    /// Number of threads; 0 uses all cores.
    pub threads: usize,
    /// Added to the depth that fits a cone: −1 is one coarser.
    pub depth_bias: f64,
    /// Added to the depth of shadow rays, besides `depth_bias`: −1 is one coarser, which is faster and darker.
    pub shadow_bias: f64,
    /// Representation of a texel where a pixel is smaller than its finest voxel.
    pub source_lod: SourceLod,
    /// Whether shadow rays are cast.
    pub shadows: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            size: [1280, 720],
            crop: None,
            camera: CameraChoice::Default,
            sky: None,
            background: None,
            ambient: Ambient::Occluded,
            sun: None,
            sun_angle: None,
            haze: None,
            lanes: 1,
            exposure: 0.0,
            light_scale: 1.0,
            memory: 8 << 30,
            threads: 0,
            depth_bias: 0.0,
            shadow_bias: 0.0,
            source_lod: SourceLod::Geometry,
            shadows: true,
        }
    }
}

/// A rectangle of a picture's pixels, as text `X,Y,WIDTH,HEIGHT`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CropWindow {
    /// Column and row of its upper left pixel, from the picture's upper left.
    pub at: [u32; 2],
    /// Pixels, width and height.
    pub size: [u32; 2],
}

impl CropWindow {
    /// Whether it has pixels, all of them in a picture of this width and height.
    pub fn is_within(&self, picture: [u32; 2]) -> bool {
        let fits = |k: usize| self.size[k] > 0 && self.at[k] < picture[k] && self.size[k] <= picture[k] - self.at[k];
        fits(0) && fits(1)
    }

    /// Whether two windows of one picture have a pixel in common.
    pub fn overlaps(&self, other: &CropWindow) -> bool {
        let meet = |k: usize| self.at[k] < other.at[k] + other.size[k] && other.at[k] < self.at[k] + self.size[k];
        meet(0) && meet(1)
    }

    /// Whether a pixel, by its column and row, is one of its.
    pub fn contains(&self, at: [u32; 2]) -> bool {
        (0..2).all(|k| at[k] >= self.at[k] && at[k] - self.at[k] < self.size[k])
    }
}

impl fmt::Display for CropWindow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([x, y], [width, height]) = (self.at, self.size);
        write!(f, "{x},{y},{width},{height}")
    }
}

impl FromStr for CropWindow {
    type Err = String;

    fn from_str(text: &str) -> Result<CropWindow, String> {
        let number = |s: &str| s.trim().parse().map_err(|_| format!("{s:?} is not a number of pixels"));
        let list: Vec<u32> = text.split(',').map(number).collect::<Result<_, _>>()?;
        let [x, y, width, height] = list[..] else { return Err("wanted X,Y,WIDTH,HEIGHT, as 640,0,640,360".into()) };
        Ok(CropWindow { at: [x, y], size: [width, height] })
    }
}

/// A direction to the sun, degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SunPosition {
    /// Above the horizon, −90 to 90.
    pub elevation: f64,
    /// From north (−Z) by east (+X).
    pub azimuth: f64,
}

impl Options {
    /// The pixels that are rendered.
    pub fn window(&self) -> CropWindow {
        self.crop.unwrap_or(CropWindow { at: [0, 0], size: self.size })
    }

    /// Options for measurements and comparisons: every point sees all of the sky, and the sun has no size.
    pub fn measuring() -> Self {
        Options { ambient: Ambient::Constant, sun_angle: Some(0.0), ..Options::default() }
    }
}

/// Choice of the camera.
#[derive(Debug, Clone, PartialEq)]
pub enum CameraChoice {
    /// The file's first camera; without one, the scene is framed.
    Default,
    /// The file's camera of that name, or of that number.
    Named(String),
    /// The scene is framed, whatever the file says.
    Framed,
    /// Perspective from `eye` to `target`, metres; vertical field of view in radians.
    LookAt {
        /// World space, metres.
        eye: DVec3,
        /// World space, metres; not the eye.
        target: DVec3,
        /// Vertical field of view, radians, in (0, π).
        yfov: f64,
    },
}

/// Representation of a texel where a pixel is smaller than its finest voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SourceLod {
    /// The mesh that it was baked from, where the scene names it; read when a cone first needs it.
    #[default]
    Geometry,
    /// Its voxels.
    Voxels,
}

/// Share of the sky that a point sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Ambient {
    /// All of it, as in comparisons.
    Constant,
    /// The part that land and texels do not hide.
    #[default]
    Occluded,
}
