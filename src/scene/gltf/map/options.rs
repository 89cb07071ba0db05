//! Options of a mapping, and the report about it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use super::super::write::Saved;
pub use super::heightfield::Scales;
use super::motion::Motion;
pub use super::points::PointsUp;
use crate::geom::DVec3;
use crate::scene::raster::Raster;
use crate::scene::shell::{Continuous, Orientations};
use crate::volume::{Finish, Info, Style};
use crate::{Error, Result};

/// Options of a mapping: how a mesh is to be covered.
#[derive(Debug, Clone)]
pub struct MapOptions {
    /// The texels, each with the head of its file; at least one. A copy takes one of them at random.
    pub texels: Vec<(PathBuf, Info)>,
    /// The source mesh of each texel, a `.glb`, for the reference render; as many as `texels`, or none.
    pub geometries: Vec<PathBuf>,
    /// Names or indices of the materials; none: all of them.
    pub materials: Vec<String>,
    /// Width of a copy.
    pub cells: Cells,
    /// Bend copies with the ground, in a shell, even if the texels are isolated objects, which otherwise become rigid copies. Cyclic texels always
    /// fill shells.
    pub bend: bool,
    /// Shares of the copies that each texel has, above 0; as many as `texels`, or none where all have the same.
    pub weights: Vec<f64>,
    /// Rigid copies per square metre of ground; by default their crowns touch, or each cell holds one.
    pub density: Option<f64>,
    /// Shares of the density, in [0, 1], on the whole ground.
    pub density_map: Option<Raster>,
    /// Domain of the density map; by default texture coordinates if they lie in the unit square, else the bounds of the ground.
    pub map_over: Option<MaskOver>,
    /// Least and largest slope on which rigid copies stand, degrees; infinite where there is no limit.
    pub slope: Option<[f64; 2]>,
    /// Least and largest altitude (y) at which they stand, metres.
    pub altitude: Option<[f64; 2]>,
    /// Heights of rigid copies' contents, metres: one for each of `texels`; or one for the tallest texel, to which the others stay in proportion;
    /// or none, for each texel's own height or one in proportion to the cell.
    pub sizes: Vec<f64>,
    /// How rigid copies are spread.
    pub arrangement: Arrangement,
    /// Each copy's albedo is multiplied by a colour between these two, linear.
    pub tint: Option<[[f64; 3]; 2]>,
    /// Width in metres of the patches in which `tint` varies over the land, by noise; by default it varies from copy to copy.
    pub tint_patches: Option<f64>,
    /// Where rigid copies stand, in place of a random spread.
    pub points: Option<PointsTable>,
    /// Scale of a ground that is a height map.
    pub ground: Scales,
    /// Metres that rigid copies are sunk by on a slope of 45 degrees, and in proportion to the slope elsewhere.
    pub sink: f64,
    /// Leave out rigid copies that would overhang the border of the covered surface.
    pub inset: bool,
    /// Shift of the copies along u and v, in cells.
    pub offset: [f64; 2],
    /// Keep the layers and copies that the materials have already, and add to them.
    pub add: bool,
    /// Overwrite `_VTEX_UVW`, `_VTEX_HEIGHT` and `_VTEX_DW` of the file; by default they are kept.
    pub replace: bool,
    /// The height vectors that the file brings were made with Z up: (x, y, z) is turned into (x, z, −y).
    pub z_up: bool,
    /// Height of the shell, metres; by default in proportion to the cell.
    pub thickness: Option<f64>,
    /// Direction that copies grow in.
    pub heights: Heights,
    /// Origin of u and v.
    pub chart: Chart,
    /// Write `_VTEX_UVW` and `_VTEX_HEIGHT` even where the material alone would do.
    pub attributes: bool,
    /// Turns and mirrorings that copies of a shell take at random.
    pub orientations: Orientations,
    /// Whether a shell's copies may be mirrored along u, v, w.
    pub mirror: [bool; 3],
    /// Noise that bends a shell's coordinates.
    pub continuous: Option<Continuous>,
    /// Uniform scale of a copy, [min, max]; of a shell within (0, 1].
    pub scale: [f64; 2],
    /// Largest displacement along u, v, w, in cells.
    pub displace: [f64; 3],
    /// Share of the cells that hold a copy.
    pub presence: f64,
    /// Seed of the random choices.
    pub seed: u32,
    /// Styles of the texels' materials, by name.
    pub palette: BTreeMap<String, Style>,
    /// Ambient factor and highlights of all materials that are not in the palette.
    pub finish: Finish,
    /// Whether the base face itself is drawn.
    pub surface_visible: bool,
    /// Frames of texels, and wind.
    pub motion: Motion,
    /// Whether quads, of an OBJ file or of FB_ngon_encoding, become bilinear patches; otherwise they become two triangles each.
    pub patches: bool,
}

/// Domain of a density map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MaskOver {
    /// The unit square of texture coordinates, and repeated beyond.
    Uv,
    /// The box around what is covered, seen from above with −z, north, up.
    Bounds,
}

/// How rigid copies are spread.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Arrangement {
    /// Irregularly, with a least distance.
    #[default]
    Scattered,
    /// In rows along x and z.
    Rows,
}

/// A table of positions of copies.
#[derive(Debug, Clone, PartialEq)]
pub struct PointsTable {
    /// The file, of comma-, semicolon- or tab-separated values.
    pub path: PathBuf,
    /// Axis of the table that points up.
    pub up: PointsUp,
    /// Offset that is subtracted from east and north (of a survey), or from x and z; by default the origin of the ground, if it has one.
    pub origin: Option<[f64; 2]>,
}

/// How wide a copy is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cells {
    /// As wide as the texel says it is in metres.
    Texel,
    /// Copies along u and v of the unit square of texture coordinates, or of the mesh's extent where it is planar.
    Repeat([f64; 2]),
    /// Metres.
    Wide(f64),
}

/// Direction in which copies grow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Heights {
    /// Straight up where the mesh mostly faces up, else along the normals.
    Auto,
    /// Along the normals of the mesh.
    Normals,
    /// Along this vector, world space; its length does not count.
    Along(DVec3),
}

/// Source of the texture coordinates u and v.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Chart {
    /// Texture coordinates, or planar from above where there are none.
    Auto,
    /// A set of texture coordinates.
    Uv(usize),
    /// World coordinates seen along axis 0 x, 1 y or 2 z.
    Planar(usize),
}

/// Report about a mapping.
#[derive(Debug, Default)]
pub struct Mapped {
    /// Notes about choices that were made, a line each.
    pub notes: Vec<String>,
    /// What each material was covered with, in file order.
    pub covered: Vec<Covered>,
    /// Files that were written besides the output, and warnings.
    pub saved: Saved,
}

/// What one material was covered with.
#[derive(Debug, Clone, PartialEq)]
pub struct Covered {
    /// Name of the material.
    pub material: String,
    /// Name of the texel of rigid copies; `None` for a shell.
    pub texel: Option<String>,
    /// Width of a copy along u and v (of a rigid copy's content along its x and z), metres, at full size.
    pub cell: [f64; 2],
    /// Height of a copy, metres, at full size.
    pub height: f64,
    /// Number of copies.
    pub copies: f64,
}

impl MapOptions {
    /// The two ends of the range of tints, if each copy gets a random tint of its own.
    pub fn tint_by_copy(&self) -> Option<[[f64; 3]; 2]> {
        self.tint.filter(|_| self.tint_patches.is_none())
    }
}

impl Default for MapOptions {
    fn default() -> Self {
        MapOptions {
            texels: Vec::new(),
            geometries: Vec::new(),
            materials: Vec::new(),
            cells: Cells::Texel,
            bend: false,
            weights: Vec::new(),
            density: None,
            density_map: None,
            map_over: None,
            slope: None,
            altitude: None,
            sizes: Vec::new(),
            arrangement: Arrangement::Scattered,
            tint: None,
            tint_patches: None,
            points: None,
            ground: Scales::default(),
            sink: 0.0,
            inset: false,
            offset: [0.0; 2],
            add: false,
            replace: false,
            z_up: false,
            thickness: None,
            heights: Heights::Auto,
            chart: Chart::Auto,
            attributes: false,
            orientations: Orientations::W8,
            mirror: [false; 3],
            continuous: None,
            scale: [0.8, 1.0],
            displace: [0.1, 0.1, 0.0],
            presence: 1.0,
            seed: 0,
            palette: BTreeMap::new(),
            finish: Finish::PLAIN,
            surface_visible: true,
            motion: Motion::default(),
            patches: true,
        }
    }
}

/// Check that options are in range and do not contradict each other; `rigid` tells whether rigid copies are placed.
///
/// # Errors
/// [`Error::Options`].
pub fn check(options: &MapOptions, rigid: bool) -> Result<()> {
    check_texels(options)?;
    check_copies(options, rigid)?;
    check_ranges(options)?;
    check_palette(options)?;
    check_lengths(options)
}

fn wrong(what: &str) -> Result<()> {
    Err(Error::Options(what.into()))
}

fn check_texels(options: &MapOptions) -> Result<()> {
    if options.texels.is_empty() {
        return wrong("option `texels` needs at least one");
    }
    if !options.geometries.is_empty() && options.geometries.len() != options.texels.len() {
        return wrong("option `geometries` is given once for each option `texels`, in the same order, or not at all");
    }
    let is_glb = |path: &PathBuf| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb"));
    match options.geometries.iter().find(|path| !is_glb(path)) {
        Some(path) => wrong(&format!("option `geometries` = {}: it must be one .glb file", path.display())),
        None => Ok(()),
    }
}

/// Check what is said of the sizes and shares of copies, and that nothing is said of rigid ones where there are none.
fn check_copies(options: &MapOptions, rigid: bool) -> Result<()> {
    let [least, most] = options.scale;
    if !(least > 0.0 && least <= most && most <= if rigid { 100.0 } else { 1.0 }) {
        return wrong(if rigid {
            "option `scale` must be MIN,MAX with 0 < MIN ≤ MAX ≤ 100"
        } else {
            "option `scale` must be MIN,MAX with 0 < MIN ≤ MAX ≤ 1"
        });
    }
    let n = options.texels.len();
    if !options.weights.is_empty() && options.weights.len() != n {
        return wrong("option `weights` is given once for each option `texels`, in the same order, or not at all");
    }
    if options.sizes.len() > 1 && options.sizes.len() != n {
        return wrong("option `sizes` is given once for all, or once for each option `texels`, in the same order");
    }
    match for_copies(options).filter(|_| !rigid) {
        Some(name) => wrong(&format!("{name} is for rigid copies, not for shells (cyclic texels, option `bend`)")),
        None => Ok(()),
    }
}

fn check_ranges(options: &MapOptions) -> Result<()> {
    for (limits, name) in [(options.slope, "option `slope`"), (options.altitude, "option `altitude`")] {
        if let Some([low, high]) = limits.filter(|[low, high]| low.is_nan() || high.is_nan() || low > high) {
            return wrong(&format!("{name} {low}..{high}: the limits go from less to more"));
        }
    }
    if !(0.0..=1.0).contains(&options.presence) {
        return wrong("option `presence` must lie in [0, 1]");
    }
    if options.displace.iter().any(|d| !(0.0..=4.0).contains(d)) {
        return wrong("option `displace` must lie in [0, 4], in cells");
    }
    if options.offset.iter().any(|d| !d.is_finite()) {
        return wrong("option `offset` must be two numbers");
    }
    Ok(())
}

/// Check that each style is one of a texel's material.
fn check_palette(options: &MapOptions) -> Result<()> {
    let materials = || options.texels.iter().flat_map(|(_, info)| &info.materials);
    let is_known = |name: &String| materials().any(|m| m.name == *name);
    let Some((name, style)) = options.palette.iter().find(|(name, _)| !is_known(name)) else { return Ok(()) };
    let restyles = *style != Style { finish: style.finish, ..Style::UNCHANGED };
    let option = if restyles { "palette" } else { "gloss" };
    let names: Vec<&str> = materials().map(|m| m.name.as_str()).collect::<BTreeSet<_>>().into_iter().collect();
    let names = if names.is_empty() { "none".into() } else { names.join(", ") };
    wrong(&format!("option `{option}` = {name}: no texel has a material of this name; there are: {names}"))
}

/// Check that lengths and what goes by them are above 0.
fn check_lengths(options: &MapOptions) -> Result<()> {
    let positive = |x: f64| x > 0.0 && x.is_finite();
    let cells = match options.cells {
        Cells::Texel => true,
        Cells::Repeat([u, v]) => positive(u) && positive(v),
        Cells::Wide(metres) => positive(metres),
    };
    if !cells || options.thickness.is_some_and(|t| !positive(t)) {
        return wrong("option `cells` and option `thickness` must be above 0");
    }
    if options.tint_patches.is_some() && options.tint.is_none() {
        return wrong("option `tint_patches` says where option `tint` varies: give that, too");
    }
    let numbers = options
        .density
        .iter()
        .chain(&options.tint_patches)
        .chain(&options.sizes)
        .chain(&options.weights)
        .chain(&options.ground.pixel);
    if numbers.copied().any(|x| !positive(x)) || !options.sink.is_finite() {
        return wrong(
            "option `density`, option `tint_patches`, option `sizes`, option `weights` and option `pixel` must be above 0, and \
             option `sink` a number",
        );
    }
    if let Heights::Along(d) = options.heights
        && !(d.is_finite() && d.length() > 0.0)
    {
        return wrong("option `heights` along 0,0,0 points nowhere");
    }
    Ok(())
}

/// Name of a given option that applies to rigid copies only.
fn for_copies(options: &MapOptions) -> Option<&'static str> {
    let given = [
        (options.density.is_some(), "option `density`"),
        (options.density_map.is_some(), "option `density_map`"),
        (options.slope.is_some(), "option `slope`"),
        (options.altitude.is_some(), "option `altitude`"),
        (!options.sizes.is_empty(), "option `sizes`"),
        (options.sink != 0.0, "option `sink`"),
        (options.inset, "option `inset`"),
        (options.points.is_some(), "option `points`"),
    ];
    given.into_iter().find(|g| g.0).map(|g| g.1)
}
