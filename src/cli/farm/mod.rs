//! `vtex farm`: a landscape's bakes, frames and tiles as a job for render farms.

mod paths;
mod rebake;
mod template;
#[cfg(test)]
mod tests;
mod yaml;

use std::path::{Path, PathBuf};

use serde_json::json;

use super::frames::{self, Frames};
use super::results::{print, shown};
use super::{Ui, depfile, outputs, render};
use crate::format;
use crate::render::CropWindow;
use crate::scene::Scene;
use crate::scene::files::extension;
use crate::{Error, Result};
use paths::{Flow, Paths};
use rebake::Rebake;
use template::{Job, MAX_TILES, folders};

/// Write a job for render farms: the bakes of a landscape's texels, its frames and tiles, as a template of Open Job Description
/// (2023-09 with TASK_CHUNKING), which `openjd run` and the farms that know it run
#[derive(clap::Args)]
pub struct Args {
    /// The landscape, .gltf or .glb
    landscape: PathBuf,
    /// The template, .yaml or .json, in a folder above the landscape and its texels' sources, or beside them
    #[arg(short, long, value_name = "JOB.yaml|JOB.json")]
    output: PathBuf,
    /// Frames A to B, or 0 to N−1, as of `render --frames`; without it a single picture
    #[arg(long, value_name = "A..B|N", value_parser = frames::parse)]
    frames: Option<Frames>,
    /// Frames a second
    #[arg(long, value_name = "F", default_value_t = 24.0, value_parser = super::quantity::positive, requires = "frames")]
    fps: f64,
    /// Frames that a task renders one after the other
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000), requires = "frames")]
    chunk: u32,
    /// Columns and rows of tiles that each picture is divided into
    #[arg(long, value_name = "COLUMNSxROWS", default_value = "1x1", value_parser = render::size)]
    tiles: [u32; 2],
    /// What pictures are stored as
    #[arg(long, value_enum, default_value_t = Format::Png)]
    format: Format,
    /// Look for the texels' sources here, besides the landscape's folder and each texel's own; may be given again
    #[arg(long, value_name = "FOLDER")]
    sources: Vec<PathBuf>,
    /// Print a summary as JSON
    #[arg(long)]
    json: bool,
    /// Options of `vtex render`, after `--`, such as -- --size 1920x1080 --lanes 4
    #[arg(last = true, value_name = "OPTIONS")]
    render: Vec<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    /// sRGB, 8 bit
    Png,
    /// Linear, with alpha
    Exr,
}

impl Format {
    fn extension(self) -> &'static str {
        match self {
            Format::Png => ".png",
            Format::Exr => ".exr",
        }
    }
}

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    let written = extension(&args.output);
    if !["yaml", "yml", "json"].contains(&written.as_str()) {
        return Err(Error::Options(format!("{}: give it a name that ends in .yaml or .json", args.output.display())));
    }
    let name = args.landscape.file_stem().and_then(|n| n.to_str()).filter(|n| !n.contains("{{"));
    let Some(name) = name.filter(|n| !n.contains(char::is_control)) else {
        let what = "a job cannot have a name with {{, a control character or what is not UTF-8";
        return Err(Error::Options(format!("{}: {what}", args.landscape.display())));
    };
    let how = render_args(args)?;
    let is_tiled = args.tiles != [1, 1];
    let (scene, size) = render::survey(&how, args.frames.map(|f| f64::from(f.first) / args.fps), is_tiled, ui)?;
    let tiles = grid(size, args.tiles)?;

    let mut paths = Paths::new(&args.output)?;
    let mut files = depfile::of_landscape(&args.landscape);
    files.retain(|file| file.is_file());
    outputs::check(&files, [args.output.as_path()])?;
    for file in files.iter().map(PathBuf::as_path).chain(how.sky_picture()) {
        paths.add(file, Flow::In)?;
    }
    let bakes = bakes(args, &scene, ui)?;
    for bake in &bakes {
        paths.add(&bake.texel, Flow::InOut)?;
        bake.files.iter().try_for_each(|file| paths.add(file, Flow::In))?;
    }
    let job = Job {
        name: name.to_owned(),
        extension: args.format.extension(),
        bakes: bakes.iter().map(|bake| step(bake, &paths)).collect::<Result<_>>()?,
        landscape: paths.refer(&args.landscape)?,
        frames: args.frames,
        frames_per_task: args.chunk,
        tiles,
        render: render_words(args, &how, &paths)?,
    };
    let template = job.template(&paths)?;
    let text = if written == "json" { format!("{template:#}\n") } else { yaml::document(&template) };
    let base = args.output.parent().unwrap_or(Path::new(""));
    for folder in folders(name).iter().take(if job.tiles.len() > 1 { 2 } else { 1 }) {
        let folder = base.join(folder);
        std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, e))?;
    }
    format::save(&args.output, text.as_bytes())?;
    tell(args, &job, size, ui)
}

fn tell(args: &Args, job: &Job, [width, height]: [u32; 2], ui: &Ui) -> Result<()> {
    let (bakes, tiles) = (job.bakes.len(), job.tiles.len());
    let pictures = args.frames.map_or(1, Frames::count);
    let (path, in_tiles) =
        (args.output.display(), if tiles > 1 { format!(" in {tiles} tiles each") } else { String::new() });
    ui.say(&format!(
        "{path}: {bakes} bakes, {pictures} pictures of {width}×{height}{in_tiles}; `openjd run {path}` runs it"
    ));
    let texels: Vec<&str> = job.bakes.iter().map(|(texel, _)| texel.as_str()).collect();
    let summary = json!({
        "input": shown(&args.landscape), "output": shown(&args.output), "width": width, "height": height,
        "pictures": pictures, "tiles": tiles, "frames_per_task": args.chunk, "bakes": texels,
    });
    print(summary, args.json, ui)
}

/// `vtex render` as a task will call it, but for names.
///
/// # Errors
/// `Options` where an option is not known, or is the job's to say.
fn render_args(args: &Args) -> Result<Box<render::Args>> {
    let mut words: Vec<String> = ["vtex", "render", "-o"].map(String::from).into();
    words.push(format!("x.####{}", args.format.extension()));
    if args.frames.is_some() {
        words.extend(["--frames".into(), "1".into(), "--fps".into(), args.fps.to_string()]);
    }
    super::after_dashes(words, &args.render, &args.landscape)
}

/// The options of a task, with a picture of the sky as a parameter.
fn render_words(args: &Args, how: &render::Args, paths: &Paths) -> Result<Vec<String>> {
    let mut words: Vec<String> = Vec::new();
    if args.frames.is_some() {
        words.extend(["--fps".into(), args.fps.to_string()]);
    }
    let sky = how.sky_picture().map(|path| Ok::<_, Error>((shown(path), paths.refer(path)?))).transpose()?;
    for word in &args.render {
        let (option, value) = match word.split_once('=') {
            Some((option @ "--sky", value)) => (Some(option), value),
            _ => (None, word.as_str()),
        };
        let value = sky.iter().find(|(path, _)| path == value).map_or(value, |(_, parameter)| parameter);
        if sky.iter().all(|(_, parameter)| parameter != value) {
            check_word(value)?;
        }
        words.push(option.map_or(value.to_owned(), |option| format!("{option}={value}")));
    }
    Ok(words)
}

/// That a template can have the word as it is.
fn check_word(word: &str) -> Result<()> {
    if word.contains("{{") || word.contains(char::is_control) {
        return Err(Error::Options(format!("{word:?}: a job cannot say {{{{ or a control character")));
    }
    Ok(())
}

/// Tiles row by row, as alike as can be.
fn grid([width, height]: [u32; 2], [columns, rows]: [u32; 2]) -> Result<Vec<CropWindow>> {
    let count = u64::from(columns) * u64::from(rows);
    if count == 0 || columns > width || rows > height {
        let what = format!("--tiles {columns}x{rows}: a picture of {width}×{height} cannot be divided so");
        return Err(Error::Options(what));
    }
    if count > MAX_TILES as u64 {
        return Err(Error::Options(format!("--tiles {columns}x{rows}: a job may have {MAX_TILES} tiles")));
    }
    let edge = |i: u32, n: u32, length: u32| (u64::from(i) * u64::from(length) / u64::from(n)) as u32;
    let span = |i: u32, n: u32, length: u32| [edge(i, n, length), edge(i + 1, n, length)];
    let tile = |i: u32| {
        let ([x0, x1], [y0, y1]) = (span(i % columns, columns, width), span(i / columns, rows, height));
        CropWindow { at: [x0, y0], size: [x1 - x0, y1 - y0] }
    };
    Ok((0..columns * rows).map(tile).collect())
}

/// The bakes of the landscape's texels; what cannot be baked is told and taken as it is.
fn bakes(args: &Args, scene: &Scene, ui: &Ui) -> Result<Vec<Rebake>> {
    let mut bakes: Vec<Rebake> = Vec::new();
    let mut seen: Vec<&Path> = Vec::new();
    for texel in &scene.texels {
        // A texel in a buffer of the landscape has no file of its own.
        let own = |path: &&PathBuf| texel.bytes.is_none() && !seen.contains(&path.as_path());
        let Some(path) = texel.frames.first().filter(own) else { continue };
        seen.push(path);
        let folder = |path: &Path| path.parent().unwrap_or(Path::new("")).to_path_buf();
        let near = [folder(path), folder(&args.landscape)];
        let folders: Vec<PathBuf> = near.into_iter().chain(args.sources.iter().cloned()).collect();
        match Rebake::find(path, texel.geometry.as_deref(), &folders)? {
            Ok(bake) => {
                if let Some(change) = &bake.change {
                    ui.say(&format!("{}: {change}: the job bakes it anew", path.display()));
                }
                bakes.push(bake);
            }
            Err(why) => ui.say(&format!("{}: {why}: the job takes it as it is", path.display())),
        }
    }
    Ok(bakes)
}

/// Name of what a bake makes, and its arguments.
fn step(bake: &Rebake, paths: &Paths) -> Result<(String, Vec<String>)> {
    let mut words: Vec<String> = vec!["bake".into()];
    if let Some(source) = &bake.source {
        words.push(paths.refer(source)?);
    }
    bake.options.iter().try_for_each(|word| check_word(word))?;
    words.extend(bake.options.iter().cloned());
    words.extend(["--if-changed".into(), "-o".into(), paths.refer(&bake.texel)?]);
    let name = bake.texel.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok((name, words))
}
