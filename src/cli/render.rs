//! `vtex render`, and `vtex-render`: a landscape to a picture.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::{Value, json};

use super::depfile::{self, DepfileArgs};
use super::download::{self, DownloadArgs, Need};
use super::exposure::{Exposure, exposure};
use super::quantity::{bytes, finite, positive};
use super::render_stats::{self, PerPixel};
use super::results::{each, output_for, shown};
use super::sequence::{MotionArgs, Said};
use super::tile::{self, Picture};
use super::{Ui, outputs, pixel_trace, reference};
use crate::error::short;
use crate::geom::DVec3;
use crate::progress::Progress;
use crate::render;
use crate::render::{Ambient, CameraChoice, CropWindow, Options, Sky, SourceLod, SunPosition, Tone};
use crate::scene::files::extension;
use crate::scene::{Scene, gltf};
use crate::{Error, Result};

#[derive(clap::Args)]
pub struct Args {
    /// The landscapes, .gltf or .glb, or URLs of such, a picture of each
    #[arg(required = true, value_name = "LANDSCAPE")]
    landscapes: Vec<PathBuf>,
    /// The picture, .png (sRGB) or .exr (linear, with alpha), or with a slash at its end the folder [default: the landscape's
    /// name with .png, here]
    #[arg(short, long, value_name = "OUT.png|FOLDER/")]
    output: Option<PathBuf>,
    /// Pixels; by default the longer side has 1280, and the shape is the camera's in the file, or else 16:9
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,
    /// Render only this part of the picture, pixels from the upper left; `vtex stitch` puts the parts together
    #[arg(long, value_name = "X,Y,WIDTH,HEIGHT", conflicts_with_all = ["pixel", "reference"])]
    tile: Option<CropWindow>,
    /// A camera of the file, by name or number; the first by default
    #[arg(long, value_name = "NAME", conflicts_with_all = ["eye", "frame"])]
    camera: Option<String>,
    /// Look from here, metres
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, requires = "look_at", allow_hyphen_values = true)]
    eye: Option<[f64; 3]>,
    /// Look there, metres
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, requires = "eye", allow_hyphen_values = true)]
    look_at: Option<[f64; 3]>,
    /// Vertical field of view with --eye, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 40.0, value_parser = finite, requires = "eye")]
    fov: f64,
    /// Frame the whole scene, whatever cameras the file has
    #[arg(long, conflicts_with = "eye")]
    frame: bool,
    /// The scene of the file, by name or number
    #[arg(long, value_name = "NAME")]
    scene: Option<String>,
    /// What lights the scene from all around; over the file's. `clear`, or `clear,TURBIDITY` from 1 (no haze) to 10: a clear
    /// sky that fits the sun, the default; R,G,B: a constant radiance, linear; or a picture of all directions, .exr or .hdr
    #[arg(long, value_name = "clear|R,G,B|FILE", value_parser = sky)]
    sky: Option<Sky>,
    /// Where the sun stands, degrees above the horizon, and from north (−Z) by east (+X); the file's brightest directional
    /// light is moved there and takes the colour that the air gives it
    #[arg(long, value_name = "ELEVATION,AZIMUTH", value_parser = sun, allow_hyphen_values = true)]
    sun: Option<SunPosition>,
    /// Angular size of the sun, degrees: how soft shadows are; 0.53 by default
    #[arg(long, value_name = "DEGREES", value_parser = finite)]
    sun_angle: Option<f64>,
    /// Haze: how far one sees, metres. Far things fade into the sky at the horizon; without it the air is clear
    #[arg(long, value_name = "METRES", value_parser = positive)]
    haze: Option<f64>,
    /// Radiance behind the scene, linear; the sky's by default
    #[arg(long, value_name = "R,G,B", value_parser = colour)]
    background: Option<[f64; 3]>,
    /// How much of the sky each point sees: as much as land and plants leave open, or all of it, for comparisons
    #[arg(long, value_enum, default_value = "occluded")]
    ambient: AmbientArg,
    /// Cones a pixel: 1, 2, 4, 8 or 16
    #[arg(long, value_name = "N", default_value_t = 1)]
    lanes: u32,
    /// Brightness: so many stops brighter than what the file says, its lights read as W/m² and W/sr; or `auto`: lights so
    /// strong that they must be lux and candela (a median of more than 100 over the scene) are divided by 683 lm/W, which
    /// is said, as Blender shows what it exports, and auto+1 is a stop brighter than that. By default `auto` for .png, 0 for .exr, whose numbers are for measuring
    #[arg(long, value_name = "auto|STOPS|auto+STOPS", value_parser = exposure, allow_hyphen_values = true)]
    exposure: Option<Exposure>,
    /// Tone curve of a .png: Khronos PBR Neutral, which leaves colours alone and presses what is bright; AgX, in which bright
    /// colours run to white as on film; or none, clipped at white, for measuring. An .exr has none
    #[arg(long, value_enum, default_value = "neutral")]
    tonemap: ToneArg,
    /// Threads; 0: one a core
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Most memory that the landscape may take: its data and textures, and its triangles, placed; 8 GiB by default
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    memory: Option<u64>,
    /// Added to the depth that fits a pixel: −1 is one coarser
    #[arg(long, value_name = "DEPTHS", default_value_t = 0.0, value_parser = finite, allow_hyphen_values = true)]
    depth_bias: f64,
    /// Added to that depth for shadows: −1 is one coarser, which is faster and darker
    #[arg(long, value_name = "DEPTHS", default_value_t = 0.0, value_parser = finite, allow_hyphen_values = true)]
    shadow_bias: f64,
    /// What is seen of a texel where a pixel is smaller than its finest voxel: the mesh that it was baked from, where the
    /// landscape names it, or its voxels
    #[arg(long, value_enum, default_value = "geometry")]
    near: NearArg,
    /// Lights shine through everything
    #[arg(long)]
    no_shadows: bool,
    /// Print what the rays of one pixel meet, instead of a picture
    #[arg(long, value_name = "X,Y", value_parser = pixel, conflicts_with = "output")]
    pixel: Option<[u32; 2]>,
    /// Trace the texels' source geometry instead, this many samples a pixel: the truth to compare with
    #[arg(long, value_name = "SAMPLES", value_parser = clap::value_parser!(u32).range(1..=1 << 24), conflicts_with = "pixel")]
    reference: Option<u32>,
    /// Go on from the samples that the output, an .exr, already has
    #[arg(long, requires = "reference")]
    resume: bool,
    /// Print what was read, marched and how long it took
    #[arg(long)]
    stats: bool,
    #[command(flatten)]
    depfile: DepfileArgs,
    /// Print what was made, with --stats, or what --pixel met, as JSON
    #[arg(long)]
    json: bool,
    // Last: what stands below a heading stays below it.
    #[command(flatten)]
    motion: MotionArgs,
    #[command(flatten)]
    download: DownloadArgs,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum NearArg {
    Geometry,
    Voxels,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum ToneArg {
    Agx,
    Neutral,
    None,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum AmbientArg {
    Constant,
    Occluded,
}

pub fn size(text: &str) -> std::result::Result<[u32; 2], String> {
    let (w, h) = text.split_once(['x', 'X', '×']).ok_or("wanted WIDTHxHEIGHT, as 1280x720")?;
    let side = |s: &str| s.trim().parse().map_err(|_| format!("{s:?} is not a number of pixels"));
    Ok([side(w)?, side(h)?])
}

fn pixel(text: &str) -> std::result::Result<[u32; 2], String> {
    let (x, y) = text.split_once(',').ok_or("wanted X,Y")?;
    let part = |s: &str| s.trim().parse().map_err(|_| format!("{s:?} is not a pixel"));
    Ok([part(x)?, part(y)?])
}

pub fn triple(text: &str) -> std::result::Result<[f64; 3], String> {
    let parts: Vec<f64> = text
        .split(',')
        .map(|s| s.trim().parse().map_err(|_| format!("{s:?} is not a number")))
        .collect::<std::result::Result<_, _>>()?;
    match parts[..] {
        [x, y, z] if parts.iter().all(|v| v.is_finite()) => Ok([x, y, z]),
        _ => Err("wanted three finite numbers, as 1,2.5,0".into()),
    }
}

fn sky(text: &str) -> std::result::Result<Sky, String> {
    if text == "clear" {
        return Ok(Sky::Clear(render::DEFAULT_TURBIDITY));
    }
    if let Some(turbidity) = text.strip_prefix("clear,") {
        let value = turbidity.trim().parse().ok().filter(|t| (1.0..=10.0).contains(t));
        return value.map(Sky::Clear).ok_or_else(|| format!("{turbidity:?} is not a turbidity from 1 to 10"));
    }
    let picture = std::path::Path::new(text);
    let ending = picture.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    if ending.is_some_and(|e| ["exr", "hdr", "png"].contains(&e.as_str())) {
        return Ok(Sky::Picture(picture.to_path_buf()));
    }
    let what = "neither clear, nor R,G,B, nor an .exr or .hdr picture";
    colour(text).map(Sky::Constant).map_err(|e| format!("{what} ({e})"))
}

fn sun(text: &str) -> std::result::Result<SunPosition, String> {
    let (elevation, azimuth) = text.split_once(',').ok_or("wanted ELEVATION,AZIMUTH in degrees, as 12,240")?;
    let degrees = |s: &str| s.trim().parse().ok().filter(|v: &f64| v.is_finite());
    let (elevation, azimuth) = degrees(elevation).zip(degrees(azimuth)).ok_or("wanted two numbers of degrees")?;
    if !(-90.0..=90.0).contains(&elevation) {
        return Err("the elevation is -90 to 90 degrees".into());
    }
    Ok(SunPosition { elevation, azimuth })
}

fn colour(text: &str) -> std::result::Result<[f64; 3], String> {
    let rgb = triple(text)?;
    if rgb.iter().all(|&v| v >= 0.0) { Ok(rgb) } else { Err("a radiance is not negative".into()) }
}

impl Args {
    fn options(&self, scene: &Scene, output: &Path) -> Result<Options> {
        let camera = match (&self.camera, self.eye.zip(self.look_at)) {
            (Some(name), _) => CameraChoice::Named(name.clone()),
            (None, Some((eye, target))) => CameraChoice::LookAt {
                eye: DVec3::from_array(eye),
                target: DVec3::from_array(target),
                yfov: self.fov.to_radians(),
            },
            (None, None) if self.frame => CameraChoice::Framed,
            (None, None) => CameraChoice::Default,
        };
        let size = match self.size {
            Some(size) => size,
            None => render::picture_size(scene, &camera)?,
        };
        let (exposure, light_scale) = self.exposure_of(output).of(render::photometric(scene));
        Ok(Options {
            size,
            crop: self.tile,
            camera,
            sky: self.sky.clone(),
            background: self.background,
            ambient: match self.ambient {
                AmbientArg::Constant => Ambient::Constant,
                AmbientArg::Occluded => Ambient::Occluded,
            },
            lanes: self.lanes,
            exposure,
            light_scale,
            threads: self.threads,
            memory: self.memory.unwrap_or(Options::default().memory),
            depth_bias: self.depth_bias,
            shadow_bias: self.shadow_bias,
            source_lod: match self.near {
                NearArg::Geometry => SourceLod::Geometry,
                NearArg::Voxels => SourceLod::Voxels,
            },
            shadows: !self.no_shadows,
            sun: self.sun,
            sun_angle: self.sun_angle.map(f64::to_radians),
            haze: self.haze,
        })
    }

    fn exposure_of(&self, output: &Path) -> Exposure {
        self.exposure.unwrap_or(if is_exr(output) { Exposure::Stops(0.0) } else { Exposure::AUTO })
    }

    /// The picture of the sky, if one is asked for.
    pub fn sky_picture(&self) -> Option<&Path> {
        if let Some(Sky::Picture(path)) = &self.sky { Some(path) } else { None }
    }

    /// The curve that the output gets.
    fn tone(&self, output: &Path) -> Tone {
        match self.tonemap {
            _ if is_exr(output) => Tone::None,
            ToneArg::Agx => Tone::Agx,
            ToneArg::Neutral => Tone::Neutral,
            ToneArg::None => Tone::None,
        }
    }

    /// The part of the picture that is made, at a time of a sequence or as asked for.
    fn tile(
        &self,
        landscape: &Path,
        output: &Path,
        options: &Options,
        time: Option<f64>,
    ) -> Result<Option<render::Tile>> {
        let said = format!("{:?} {} {time:?} {:?}", self.scene, self.motion.moment(), self.tone(output));
        tile::tile(landscape, options, &said)
    }

    /// What is to be known of the lights' units, in a line.
    fn said_of_lights(&self, scene: &Scene, options: &Options) -> Option<String> {
        let irradiance = render::photometric(scene)?;
        let what = format!("the file's lights are in lux and candela (a median of {} lx)", short(irradiance.round()));
        if options.light_scale != 1.0 {
            // Stops that were asked for besides are known to who asked.
            let (own, _) = Exposure::AUTO.of(Some(irradiance));
            let darker = if own < 0.0 {
                let by = short((1e3 * (-own).exp2()).round() / 1e3);
                format!(", and by {by} so that a white surface in that light is 1")
            } else {
                String::new()
            };
            return Some(format!("{what}: divided by 683 lm/W{darker} (--exposure 0: as they are)"));
        }
        // Who asked for stops knows.
        let kept = "kept in an .exr (--exposure auto: divided by 683 lm/W, as in a .png)";
        self.exposure.is_none().then(|| format!("{what}: {kept}"))
    }
}

fn is_exr(path: &Path) -> bool {
    extension(path) == "exr"
}

/// A line about a film of which most is clipped, with what would help.
fn said_of_clipping(film: &render::Film, options: &Options, tone: Tone) -> Option<String> {
    let (share, stops) = film.overexposed(tone.white())?;
    // Stops that are asked for take the lights as they are.
    let wanted = options.exposure + options.light_scale.log2() + stops;
    Some(format!("{:.0} % of the picture is clipped to white; try --exposure {wanted:.1}", 100.0 * share))
}

pub fn run(mut args: Args, ui: &Ui) -> Result<()> {
    let downloads = download::local(&mut args.landscapes, Need::Landscape, &args.download, ui)?;
    downloads.no_depfile(args.depfile.path())?;
    let args = &args;
    if let (Some(at), [landscape]) = (args.pixel, &args.landscapes[..]) {
        let scene = read(args, landscape, None, &mut Said::default(), ui)?;
        return pixel_trace::print(&render::trace_pixel(&scene, &args.options(&scene, Path::new(""))?, at)?, args.json);
    } else if args.pixel.is_some() {
        return Err(Error::Options("--pixel is of one landscape".into()));
    }
    let sky = args.sky_picture().map(Path::to_path_buf);
    let files =
        |path: &PathBuf| -> Vec<PathBuf> { depfile::of_landscape(path).into_iter().chain(sky.clone()).collect() };
    if let (Some(output), [landscape]) = (&args.output, &args.landscapes[..])
        && let Some(sequence) = args.motion.sequence(output, args.tile.map(|t| t.size).or(args.size))?
    {
        if args.stats || args.json || args.depfile.path().is_some() {
            return Err(Error::Options("--stats, --json and --depfile are of a picture, not of --frames".into()));
        }
        if args.tile.is_some() && sequence.is_one_file() {
            let what = format!("{}: --tile makes a .png or .exr, not a part of a picture that moves", output.display());
            return Err(Error::Options(what));
        }
        let mut said = Said::default();
        let mut frame = |time| frame(args, (landscape, output), time, &mut said, ui);
        return sequence.run(&files(landscape), ui, &mut frame);
    }
    args.motion.only_one()?;
    let several = args.landscapes.len() > 1;
    let named = |path: &PathBuf| output_for(path, args.output.as_deref(), several, "png");
    let pictures = args.landscapes.iter().map(named).collect::<Result<Vec<_>>>()?;
    pictures.iter().try_for_each(|path| render::Film::check_name(path))?;
    let reads: Vec<_> = args.landscapes.iter().map(files).collect();
    outputs::check(&reads.concat(), pictures.iter().map(PathBuf::as_path).chain(args.depfile.path()))?;
    let (mut rules, mut left) = (Vec::new(), pictures.iter().zip(reads));
    let done = each(&args.landscapes, args.json, ui, |landscape| {
        let Some((output, files)) = left.next() else { return Ok(Value::Null) };
        let summary = picture(args, landscape, output, ui)?;
        rules.push((output.as_path(), files));
        Ok(summary)
    });
    if !rules.is_empty() {
        args.depfile.write(rules, ui)?;
    }
    done
}

/// The scene of a picture that others will make, at a time of a sequence or as asked for, and the picture's width and height.
///
/// # Errors
/// `Options` where something is asked for that others decide, or tiles of what is not made in tiles; else as reading a scene.
#[cfg(feature = "bake")]
pub fn survey(args: &Args, time: Option<f64>, is_tiled: bool, ui: &Ui) -> Result<(Scene, [u32; 2])> {
    let [landscape] = &args.landscapes[..] else {
        return Err(Error::Options("a job is of one landscape".into()));
    };
    if args.stats || args.json || args.tile.is_some() || args.depfile.path().is_some() {
        return Err(Error::Options("--stats, --json, --tile and --depfile are not of a job's pictures".into()));
    }
    if is_tiled && args.reference.is_some() {
        return Err(Error::Options("--reference is not made in tiles".into()));
    }
    let scene = read(args, landscape, time, &mut Said::default(), ui)?;
    let size = args.options(&scene, Path::new(""))?.size;
    Ok((scene, size))
}

/// A landscape to be looked at, and how its pictures are made.
#[cfg(feature = "bake")]
pub struct Look {
    pub scene: Scene,
    pub options: Options,
    pub tone: Tone,
    pub exposure: Exposure,
    /// Whether the command line says the exposure.
    pub is_exposed: bool,
    /// The irradiance of the lights, where the file has them in lux and candela.
    pub lux: Option<f64>,
}

/// A landscape of which pictures are made by cameras that others choose.
///
/// # Errors
/// `Options` where something is asked for that is not of such pictures; else as reading a scene.
#[cfg(feature = "bake")]
pub fn look(args: &Args, ui: &Ui) -> Result<Look> {
    let [landscape] = &args.landscapes[..] else {
        return Err(Error::Options("one landscape is looked at".into()));
    };
    let is_picture = args.output.is_some() || args.tile.is_some() || args.depfile.path().is_some();
    if is_picture || args.pixel.is_some() || args.reference.is_some() || args.stats || args.json {
        let what = "--output, --tile, --pixel, --reference, --stats, --json and --depfile are not of a view";
        return Err(Error::Options(what.into()));
    }
    args.motion.only_one()?;
    let scene = read(args, landscape, None, &mut Said::default(), ui)?;
    let shown = Path::new("view.png");
    let options = args.options(&scene, shown)?;
    args.said_of_lights(&scene, &options).iter().for_each(|line| ui.say(line));
    let (lux, exposure) = (render::photometric(&scene), args.exposure_of(shown));
    Ok(Look { scene, options, tone: args.tone(shown), exposure, is_exposed: args.exposure.is_some(), lux })
}

/// The landscape at a time of a sequence, or as asked for.
fn read(args: &Args, landscape: &Path, time: Option<f64>, said: &mut Said, ui: &Ui) -> Result<Scene> {
    ui.stage("read", 0);
    let mut read = gltf::ReadOptions { scene: args.scene.clone(), contained: true, ..Default::default() };
    read.max_bytes = args.memory.unwrap_or(read.max_bytes);
    let scene = gltf::read(landscape, &args.motion.read(read, time))?;
    ui.finish();
    said.warn(ui, &scene.model.warnings)?;
    Ok(scene)
}

/// Render, and say what there is to say.
fn render_film(
    (scene, options): (&Scene, &Options),
    (tone, output): (Tone, &Path),
    said: &mut Said,
    ui: &Ui,
) -> Result<render::Rendered> {
    let done = render::render(scene, options, ui)?;
    ui.finish();
    done.notes.iter().for_each(|note| said.say(ui, note));
    said.warn(ui, &done.warnings)?;
    if let Some(line) = said_of_clipping(&done.film, options, tone).filter(|_| !is_exr(output)) {
        said.say(ui, &line);
    }
    Ok(done)
}

/// The picture of one time of a sequence, by itself: no other frame has a part in it.
fn frame(args: &Args, (landscape, output): (&Path, &Path), time: f64, said: &mut Said, ui: &Ui) -> Result<Picture> {
    let scene = read(args, landscape, Some(time), said, ui)?;
    let options = args.options(&scene, output)?;
    if let Some(line) = args.said_of_lights(&scene, &options) {
        said.say(ui, &line);
    }
    let Some(samples) = args.reference else {
        let mut film = render_film((&scene, &options), (args.tone(output), output), said, ui)?.film;
        args.tone(output).apply(&mut film);
        return Ok(Picture { film, tile: args.tile(landscape, output, &options, Some(time))? });
    };
    let mut done = render::reference::reference(&scene, &options, 0..samples, ui)?;
    ui.finish();
    done.notes.iter().for_each(|note| said.say(ui, note));
    said.warn(ui, &done.warnings)?;
    args.tone(output).apply(&mut done.film);
    Ok(Picture { film: done.film, tile: None })
}

/// One picture, and what is told of it.
fn picture(args: &Args, landscape: &Path, output: &Path, ui: &Ui) -> Result<Value> {
    let start = Instant::now();
    let mut said = Said::default();
    let scene = read(args, landscape, None, &mut said, ui)?;
    let reading = start.elapsed();
    let options = args.options(&scene, output)?;
    if let Some(line) = args.said_of_lights(&scene, &options) {
        ui.say(&line);
    }
    let [width, height] = options.window().size;
    let mut told = json!({ "input": shown(landscape), "output": shown(output), "width": width, "height": height });
    if let Some(tile) = options.crop {
        told["tile"] = json!({ "x": tile.at[0], "y": tile.at[1], "of": options.size });
    }
    if let Some(samples) = args.reference {
        let job = reference::Job {
            landscape,
            scene: &scene,
            scene_name: args.scene.as_deref(),
            moment: args.motion.moment(),
            options: &options,
            tone: args.tone(output),
            samples,
            output,
        };
        let (done, noise) = job.run(args.resume, ui)?;
        let pixel = PerPixel::of(&done.stats, options.window().size, options.threads);
        if args.stats && !args.json {
            render_stats::print_stats(&done.stats, &pixel)?;
        }
        extend(&mut told, noise);
        extend(&mut told, render_stats::described(&done.stats, &pixel));
        return Ok(told);
    }
    let mut done = render_film((&scene, &options), (args.tone(output), output), &mut said, ui)?;
    let saving = Instant::now();
    args.tone(output).apply(&mut done.film);
    Picture { film: done.film, tile: args.tile(landscape, output, &options, None)? }.save(output)?;
    done.stats.times.insert(0, ("read", reading));
    done.stats.times.push(("save", saving.elapsed()));
    let pixel = PerPixel::of(&done.stats, options.window().size, options.threads);
    if args.stats && !args.json {
        render_stats::print_stats(&done.stats, &pixel)?;
    }
    let total: f64 = done.stats.times.iter().map(|t| t.1.as_secs_f64()).sum();
    ui.say(&format!("{}: {width}×{height} in {total:.2} s", output.display()));
    extend(&mut told, render_stats::described(&done.stats, &pixel));
    Ok(told)
}

fn extend(told: &mut Value, more: Value) {
    if let (Some(told), Value::Object(more)) = (told.as_object_mut(), more) {
        told.extend(more);
    }
}
