//! `vtex map`: cover a plain mesh with texels.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::ValueEnum;

use serde_json::{Value, json};

use super::depfile::{self, DepfileArgs};
use super::map_jitter::{JitterPreset, Turns};
use super::map_motion::MotionArgs;
use super::quantity::finite;
use super::results::{print, shown};
use super::{Ui, map_motion, outputs};
use crate::error::{length, short};
use crate::geom::DVec3;
use crate::progress::Progress;
use crate::scene::files::extension;
use crate::scene::gltf;
use crate::scene::gltf::map::{
    Cells, Chart, Covered, Heights, MapOptions, Mapped, MaskOver, PointsTable, PointsUp, Scales, map,
};
use crate::scene::obj;
use crate::scene::raster::Raster;
use crate::scene::texture::srgb_to_linear;
use crate::volume::finish::MAX_SHININESS;
use crate::volume::{Finish, Info, Style};
use crate::{Error, Result};

#[derive(clap::Args)]
pub struct Args {
    /// The mesh to cover, .gltf, .glb or .obj, or a picture of a ground's heights: .png, .tif
    input: PathBuf,
    /// A .vtex file, or a texel of frames, NAME.####.vtex; given several times, every copy is one of them
    #[arg(long = "texel", required = true, value_name = "FILE")]
    texels: Vec<PathBuf>,
    /// The .glb that the texel was baked from, for `render --reference`; once for each --texel
    #[arg(long = "geometry", value_name = "FILE")]
    geometries: Vec<PathBuf>,
    /// Where the landscape goes: .gltf or .glb [default: the input's name with -landscape added, here]
    #[arg(long, short, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Cover the primitives of this material, by name or index; may be given several times [default: all]
    #[arg(long = "material", value_name = "NAME")]
    materials: Vec<String>,
    /// Copies along u and v of the unit square of texture coordinates, or of the mesh's extent with --planar
    #[arg(long, value_name = "N|U,V", value_parser = pair, conflicts_with = "cell")]
    repeat: Option<[f64; 2]>,
    /// Width of a cell in metres, which holds one copy [default: as wide as the texel's source]
    #[arg(long, value_name = "METRES", value_parser = finite)]
    cell: Option<f64>,
    /// Bend copies with the ground, in a shell [default: cyclic texels and files with vectors of their own only]
    #[arg(long)]
    bend: bool,
    /// Share of the copies that a texel has, in proportion to the others'; once for each --texel [default: all the same]
    #[arg(long = "weight", value_name = "N", value_parser = finite)]
    weights: Vec<f64>,
    /// Rigid copies per hectare (400, 400/ha) or square metre (0.04/m2) of ground [default: crowns touch]
    #[arg(long, value_name = "N[/ha|/m2]", value_parser = density)]
    density: Option<f64>,
    /// A .png or .tif: the share of that density, from black (none) to white (all)
    #[arg(long, value_name = "FILE")]
    density_map: Option<PathBuf>,
    /// What the map lies on: texture coordinates, or the bounds of what is covered, from above [default: texture
    /// coordinates that lie in the unit square, else bounds]
    #[arg(long, value_enum, requires = "density_map")]
    map_over: Option<Over>,
    /// Slopes on which rigid copies stand, degrees; an end may be left out
    #[arg(long, value_name = "A..B", value_parser = range, allow_hyphen_values = true)]
    slope: Option<[f64; 2]>,
    /// Altitudes (y) at which rigid copies stand, metres; an end may be left out
    #[arg(long, value_name = "A..B", value_parser = range, allow_hyphen_values = true)]
    altitude: Option<[f64; 2]>,
    /// Height of rigid copies in metres: of the tallest texel, or once for each --texel [default: as the source, or in
    /// proportion to the cell]
    #[arg(long = "size", value_name = "METRES", value_parser = finite)]
    sizes: Vec<f64>,
    /// Multiply each copy's colours by one between these two
    #[arg(long, value_name = "COLOUR..COLOUR", value_parser = ramp)]
    tint: Option<[[f64; 3]; 2]>,
    /// Vary --tint over the land, in patches so wide, and not from copy to copy
    #[arg(long, value_name = "METRES", requires = "tint", value_parser = finite)]
    tint_patches: Option<f64>,
    /// Place rigid copies where a .csv says: x (east), y (north) [, z (up)], size (metres high), scale, turn (degrees), tint
    /// (#rrggbb), texel, by the names in its first line; where z is missing, on the ground
    #[arg(long, value_name = "FILE", conflicts_with_all = ["density", "density_map", "slope", "altitude", "inset"])]
    points: Option<PathBuf>,
    /// Which axis of --points is up; y: the scene's own axes
    #[arg(long, value_enum, default_value = "z", requires = "points")]
    points_up: PointsAxis,
    /// What is taken from the points' ground coordinates [default: the middle of a GeoTIFF ground, else 0,0]
    #[arg(long, value_name = "X,Y", value_parser = pair, requires = "points", allow_hyphen_values = true)]
    points_origin: Option<[f64; 2]>,
    /// Width of a pixel of a ground that is a picture, metres [default: as a GeoTIFF says]
    #[arg(long, value_name = "METRES", value_parser = finite)]
    pixel: Option<f64>,
    /// Heights of black and white in it, metres [default: numbers of a .tif are heights]
    #[arg(long, value_name = "MIN,MAX", value_parser = pair, allow_hyphen_values = true)]
    relief: Option<[f64; 2]>,
    /// Sink rigid copies by so many metres on a slope of 45 degrees, in proportion on others
    #[arg(long, value_name = "METRES", default_value_t = 0.0, value_parser = finite)]
    sink: f64,
    /// Leave out rigid copies that would overhang the border
    #[arg(long)]
    inset: bool,
    /// Shift of a shell's copies along u and v, in cells
    #[arg(long, value_name = "U,V", value_parser = pair, allow_hyphen_values = true)]
    offset: Option<[f64; 2]>,
    /// Keep what the materials are covered with: more copies among the first
    #[arg(long)]
    add: bool,
    /// Write over _VTEX_UVW, _VTEX_HEIGHT and _VTEX_DW that the file brings [default: they are kept]
    #[arg(long)]
    replace: bool,
    /// Turn the file's own _VTEX_HEIGHT: they were made with Z up, as in Blender
    #[arg(long, value_enum, conflicts_with = "replace")]
    heights: Option<Turned>,
    /// Height of the shell in metres [default: in proportion to the width of a copy]
    #[arg(long, value_name = "METRES", value_parser = finite)]
    thickness: Option<f64>,
    /// Where copies grow to: `normals` or a direction [default: 0,1,0 where the mesh mostly faces up, else normals]
    #[arg(long, value_name = "normals|X,Y,Z", value_parser = heights, allow_hyphen_values = true)]
    height_along: Option<Heights>,
    /// Take u and v from world coordinates seen along this axis
    #[arg(long, value_enum, conflicts_with = "uv")]
    planar: Option<Axis>,
    /// Take u and v from this set of texture coordinates [default: 0, or --planar y where there is none]
    #[arg(long, value_name = "SET")]
    uv: Option<usize>,
    /// Write _VTEX_UVW and _VTEX_HEIGHT even where the material alone would do
    #[arg(long)]
    attributes: bool,
    /// How copies differ, as a whole; options below change parts of it
    #[arg(long, value_enum, default_value_t = JitterPreset::Natural)]
    jitter: JitterPreset,
    /// How copies are turned at random: not at all; in a shell by quarter turns about w (w4), or also mirrored (w8), or by all
    /// turns of a cube (cube24), or also mirrored (cube48); rigid ones by any angle [default: w8; of cyclic texels identity]
    #[arg(long, value_enum)]
    orientations: Option<Turns>,
    /// Axes (of u, v, w, such as `uv`) along which half of a shell's copies are mirrored
    #[arg(long, value_name = "AXES", value_parser = axes)]
    mirror: Option<[bool; 3]>,
    /// Random size of copies, as a share of their full size [default: 0.8,1; of cyclic texels 1]
    #[arg(long, value_name = "MIN,MAX", value_parser = pair)]
    scale: Option<[f64; 2]>,
    /// Largest random displacement of a shell's copies, in cells; they may reach over others' cells [default: 0.1; of cyclic
    /// texels 0]
    #[arg(long, value_name = "D|U,V,W", value_parser = displacement)]
    displace: Option<[f64; 3]>,
    /// Share of the cells that hold a copy, or of the density that is kept
    #[arg(long, value_name = "SHARE", default_value_t = 1.0, value_parser = finite)]
    presence: f64,
    /// Seed of the random choices
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u32,
    /// Show the texels' material NAME in this colour, #rrggbb or r,g,b (linear), or with a * before it, in its own colours times
    /// this one; may be given again
    #[arg(long, value_name = "NAME=[*]COLOUR", value_parser = restyled)]
    palette: Vec<(String, Style)>,
    /// Give the texels' material NAME, or all, highlights: strength from 0 to 1 (or a colour), and shininess [default: 16]; may
    /// be given again
    #[arg(long, value_name = "[NAME=]STRENGTH[:SHININESS]", value_parser = glossy)]
    gloss: Vec<(Option<String>, Finish)>,
    /// Whether the covered faces themselves are drawn
    #[arg(long, value_enum, default_value_t = Surface::Visible)]
    surface: Surface,
    /// Take quads (of an .obj, or of FB_ngon_encoding) as two triangles each, and not as bilinear patches
    #[arg(long)]
    no_patches: bool,
    #[command(flatten)]
    depfile: DepfileArgs,
    /// Print what was covered as JSON
    #[arg(long)]
    json: bool,
    // Last: what stands below a heading stays below it.
    #[command(flatten)]
    motion: MotionArgs,
}

#[derive(Clone, Copy, ValueEnum)]
enum Axis {
    X,
    Y,
    Z,
}

#[derive(Clone, Copy, ValueEnum)]
enum Over {
    Uv,
    Bounds,
}

impl From<Over> for MaskOver {
    fn from(over: Over) -> MaskOver {
        match over {
            Over::Uv => MaskOver::Uv,
            Over::Bounds => MaskOver::Bounds,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
enum PointsAxis {
    Y,
    Z,
}

impl From<PointsAxis> for PointsUp {
    fn from(axis: PointsAxis) -> PointsUp {
        match axis {
            PointsAxis::Y => PointsUp::Y,
            PointsAxis::Z => PointsUp::Z,
        }
    }
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Turned {
    ZUp,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Surface {
    Visible,
    Hidden,
}

/// Cover the mesh, and say what came of it.
pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    let output = args.output.clone().unwrap_or_else(|| default_output(&args.input));
    let read = check_output(args, &output)?;
    ui.stage("map", 0);
    let mapped = map(&args.input, &options(args, ui)?, &output)?;
    ui.finish();
    say(&mapped, ui);
    ui.warn(&mapped.saved.warnings)?;
    args.depfile.write([(output.as_path(), read)], ui)?;
    if !args.json {
        ui.say(&format!("wrote {}", output.display()));
    }
    print(described(args, &output, &mapped), args.json, ui)
}

/// The options of a mapping, with what they take from files.
fn options(args: &Args, ui: &Ui) -> Result<MapOptions> {
    let (mut texels, mut frames) = (Vec::new(), Vec::new());
    for path in &args.texels {
        let (path, info, list) = map_motion::texel(path)?;
        texels.push((path, info));
        frames.push(list);
    }
    let infos: Vec<&Info> = texels.iter().map(|(_, info)| info).collect();
    let motion = args.motion.motion(frames, &infos)?;
    let isolated = texels.iter().all(|(_, info)| !info.cyclic[0] && !info.cyclic[1]);
    let for_shells = isolated.then(|| of_shells(args)).flatten();
    if let (Some(name), false) = (for_shells, args.bend) {
        ui.say(&format!("{name} is for shells: copies bend with the ground, as with --bend"));
    }
    let bend = args.bend || for_shells.is_some();
    let density_map = args.density_map.as_deref().map(|path| Raster::open(path)?.into_shares(path)).transpose()?;
    Ok(MapOptions { texels, motion, bend, density_map, ..own_options(args, isolated) })
}

/// The options that the command line says by itself. `isolated`: all texels are objects that do not go on from cell to cell.
fn own_options(args: &Args, isolated: bool) -> MapOptions {
    let preset = args.jitter.preset(isolated, args.seed);
    MapOptions {
        geometries: args.geometries.clone(),
        materials: args.materials.clone(),
        cells: match (args.repeat, args.cell) {
            (Some(n), _) => Cells::Repeat(n),
            (None, Some(metres)) => Cells::Wide(metres),
            (None, None) => Cells::Texel,
        },
        weights: args.weights.clone(),
        density: args.density,
        map_over: args.map_over.map(Over::into),
        slope: args.slope,
        altitude: args.altitude,
        sizes: args.sizes.clone(),
        arrangement: preset.arrangement,
        tint: args.tint,
        tint_patches: args.tint_patches,
        points: args.points.clone().map(|path| {
            let up = args.points_up.into();
            PointsTable { path, up, origin: args.points_origin }
        }),
        ground: Scales { pixel: args.pixel, relief: args.relief },
        sink: args.sink,
        inset: args.inset,
        offset: args.offset.unwrap_or_default(),
        add: args.add,
        replace: args.replace,
        z_up: args.heights == Some(Turned::ZUp),
        thickness: args.thickness,
        heights: args.height_along.unwrap_or(Heights::Auto),
        chart: match (args.planar, args.uv) {
            (Some(axis), _) => Chart::Planar(axis as usize),
            (None, Some(set)) => Chart::Uv(set),
            (None, None) => Chart::Auto,
        },
        attributes: args.attributes,
        orientations: args.orientations.map_or(preset.orientations, Turns::into),
        mirror: args.mirror.unwrap_or_default(),
        continuous: preset.continuous,
        scale: args.scale.unwrap_or(preset.scale),
        displace: args.displace.unwrap_or(preset.displace),
        presence: args.presence,
        seed: args.seed,
        palette: palette(args),
        finish: args.gloss.iter().rfind(|(name, _)| name.is_none()).map_or(Finish::PLAIN, |(_, finish)| *finish),
        surface_visible: args.surface == Surface::Visible,
        patches: !args.no_patches,
        ..MapOptions::default()
    }
}

/// `terrain.glb` → `terrain-landscape.glb` in the current folder.
fn default_output(input: &Path) -> PathBuf {
    let mut name = input.file_stem().unwrap_or_default().to_owned();
    name.push("-landscape.");
    // A picture of a ground's heights becomes a mesh.
    let kind = input.extension().filter(|_| ["gltf", "glb"].contains(&extension(input).as_str()));
    name.push(kind.unwrap_or("glb".as_ref()));
    name.into()
}

fn described(args: &Args, output: &Path, mapped: &Mapped) -> Value {
    let covered = mapped.covered.iter().map(|Covered { material, texel, cell: [width, depth], height, copies }| {
        json!({
            "material": material, "texel": texel, "copies": copies, "width": width, "depth": depth, "height": height,
        })
    });
    json!({
        "input": shown(&args.input),
        "output": shown(output),
        "covered": covered.collect::<Vec<_>>(),
        "copied": mapped.saved.copied.iter().map(|path| shown(path)).collect::<Vec<_>>(),
    })
}

/// An option that only shells understand, if one is given.
fn of_shells(args: &Args) -> Option<&'static str> {
    let given = [
        (args.thickness.is_some(), "--thickness"),
        (args.planar.is_some(), "--planar"),
        (args.uv.is_some(), "--uv"),
        (args.attributes, "--attributes"),
        (args.displace.is_some(), "--displace"),
        (args.mirror.is_some(), "--mirror"),
        (args.offset.is_some(), "--offset"),
        (args.surface == Surface::Hidden, "--surface hidden"),
    ];
    given.into_iter().find(|g| g.0).map(|g| g.1)
}

/// That the landscape has a place, and that no source is lost: a mesh is only written over where it is a landscape already,
/// to which something is added. Gives the files that are read.
fn check_output(args: &Args, output: &Path) -> Result<Vec<PathBuf>> {
    if !["gltf", "glb"].contains(&extension(output).as_str()) {
        let path = output.display();
        return Err(Error::Options(format!("{path}: a landscape is written as .gltf or .glb; name it so")));
    }
    let mut read = depfile::of_landscape(&args.input);
    if extension(&args.input) == "obj" {
        read = vec![args.input.clone()];
        read.extend(obj::named_files(&args.input));
    }
    read.extend(args.density_map.iter().chain(&args.points).cloned());
    read.extend(args.texels.iter().chain(&args.geometries).cloned());
    // The input comes first.
    let added_to = outputs::same(&args.input, output) && gltf::is_landscape(&args.input);
    let kept = if added_to { read.split_off(1) } else { read };
    outputs::check(&kept, [Some(output), args.depfile.path()].into_iter().flatten())?;
    Ok(kept)
}

/// What was done, in a few lines.
pub fn say(mapped: &Mapped, ui: &Ui) {
    for note in &mapped.notes {
        ui.say(note);
    }
    for Covered { material, texel, cell: [u, v], height, copies } in &mapped.covered {
        let size = format!("{} × {} m, {} m high", length(*u), length(*v), length(*height));
        let copies = short(copies.round());
        ui.say(&match texel {
            Some(texel) => format!("covered {material}: {copies} copies of {texel}, up to {size}"),
            None => format!("covered {material}: copies {size}, about {copies} of them"),
        });
    }
    for copy in &mapped.saved.copied {
        ui.say(&format!("copied {} beside the output", copy.display()));
    }
}

fn numbers(text: &str) -> Result<Vec<f64>, String> {
    text.split(',').map(|x| finite(x.trim()).map_err(|_| format!("{x:?} is not a number"))).collect()
}

fn pair(text: &str) -> Result<[f64; 2], String> {
    match numbers(text)?[..] {
        [a] => Ok([a, a]),
        [a, b] => Ok([a, b]),
        _ => Err("one or two numbers are needed".into()),
    }
}

/// `NAME=#rrggbb`, `NAME=r,g,b`; with a `*` before the colour it multiplies.
fn restyled(text: &str) -> Result<(String, Style), String> {
    let (name, colour) = text.rsplit_once('=').filter(|(name, _)| !name.is_empty()).ok_or("NAME=COLOUR is needed")?;
    let (keep, colour) = colour.strip_prefix('*').map_or((false, colour), |rest| (true, rest));
    let factor = self::colour(colour)?;
    let most = if keep { f64::MAX } else { 1.0 };
    if factor.iter().any(|v| !(0.0..=most).contains(v)) {
        return Err(if keep { "factors are at least 0" } else { "a colour's numbers are from 0 to 1" }.into());
    }
    Ok((name.to_owned(), Style { factor, keeps_albedo: keep, ..Style::UNCHANGED }))
}

/// Colours and highlights of materials.
fn palette(args: &Args) -> BTreeMap<String, Style> {
    let mut palette: BTreeMap<String, Style> = args.palette.iter().cloned().collect();
    for (name, finish) in &args.gloss {
        if let Some(name) = name {
            palette.entry(name.clone()).or_insert(Style::UNCHANGED).finish = *finish;
        }
    }
    palette
}

/// `NAME=STRENGTH`, `STRENGTH`, either with `:SHININESS`; the strength is a number or a colour.
fn glossy(text: &str) -> Result<(Option<String>, Finish), String> {
    let (name, rest) = match text.rsplit_once('=') {
        Some(("", _)) => return Err("a material's name is missing before the =".into()),
        Some((name, rest)) => (Some(name.to_owned()), rest),
        None => (None, text),
    };
    let (strength, shininess) = match rest.split_once(':') {
        Some((strength, shininess)) => (strength, Some(finite(shininess)?)),
        None => (rest, None),
    };
    let specular = match finite(strength) {
        Ok(grey) => [grey; 3],
        Err(_) => colour(strength)?,
    };
    if specular.iter().any(|v| !(0.0..=1.0).contains(v)) {
        return Err("the strength of highlights is from 0 to 1".into());
    }
    if shininess.is_some_and(|s| !(0.0..=MAX_SHININESS).contains(&s)) {
        return Err(format!("the shininess is from 0 to {MAX_SHININESS}"));
    }
    Ok((name, Finish { specular: Some(specular), shininess, ..Finish::PLAIN }))
}

/// `#rrggbb` (sRGB), or three linear numbers.
fn colour(text: &str) -> Result<[f64; 3], String> {
    match text.strip_prefix('#') {
        Some(digits) => {
            let code = u32::from_str_radix(digits, 16).ok().filter(|_| digits.len() == 6);
            let code = code.ok_or_else(|| format!("{text} is not a colour like #4c8a2e"))?;
            Ok([16, 8, 0].map(|shift| f64::from(srgb_to_linear((code >> shift & 255) as u8))))
        }
        None => Ok(<[f64; 3]>::try_from(numbers(text)?).map_err(|_| "a colour is #rrggbb or three numbers")?),
    }
}

/// Some of u, v, w.
fn axes(text: &str) -> Result<[bool; 3], String> {
    let known = text.chars().all(|c| "uvw".contains(c)) && !text.is_empty();
    if known { Ok(['u', 'v', 'w'].map(|c| text.contains(c))) } else { Err("axes are u, v, w, such as `uv`".into()) }
}

/// `A..B`, `A..` or `..B`.
fn range(text: &str) -> Result<[f64; 2], String> {
    let (low, high) = text.split_once("..").ok_or("two numbers with .. between them are needed, such as 0..30")?;
    let end = |text: &str, open: f64| match text.trim() {
        "" => Ok(open),
        text => finite(text).map_err(|_| format!("{text:?} is not a number")),
    };
    let range = [end(low, f64::NEG_INFINITY)?, end(high, f64::INFINITY)?];
    if range[0] > range[1] { Err("the limits go from less to more".into()) } else { Ok(range) }
}

/// Two colours with `..` between them, or one.
fn ramp(text: &str) -> Result<[[f64; 3]; 2], String> {
    let (a, b) = text.split_once("..").unwrap_or((text, text));
    let ends = [colour(a.trim())?, colour(b.trim())?];
    if ends.iter().flatten().any(|v| *v < 0.0) { Err("factors are at least 0".into()) } else { Ok(ends) }
}

fn displacement(text: &str) -> Result<[f64; 3], String> {
    match numbers(text)?[..] {
        [d] => Ok([d, d, 0.0]),
        [u, v, w] => Ok([u, v, w]),
        _ => Err("one number (along u and v) or three are needed".into()),
    }
}

/// Copies per square metre from `400`, `400/ha`, `0.04/m2` or `0.04/m²`.
fn density(text: &str) -> Result<f64, String> {
    let (number, area) = text.split_once('/').unwrap_or((text, "ha"));
    let per = match area.trim() {
        "ha" => 1e-4,
        "m2" | "m²" => 1.0,
        _ => return Err("a density is per hectare (400/ha) or per square metre (0.04/m2)".into()),
    };
    let number = finite(number.trim()).map_err(|_| format!("{number:?} is not a number"))?;
    Ok(number * per)
}

fn heights(text: &str) -> Result<Heights, String> {
    if text == "normals" {
        return Ok(Heights::Normals);
    }
    match numbers(text).ok().as_deref() {
        Some(&[x, y, z]) => Ok(Heights::Along(DVec3::new(x, y, z))),
        _ => Err("`normals` or three numbers are needed".into()),
    }
}
