//! `vtex bake`: a 3D source → a .vtex file.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::{Value, json};

use super::bake_frames::{FrameArgs, Shot};
use super::clap_name;
use super::depfile::DepfileArgs;
use super::paint::PaintArgs;
use super::provenance::{Digests, Provenance};
use super::quantity::{bytes, count, finite, size};
use super::results::{each, output_for, shown};
use super::source::SourceArgs;
use super::{Ui, outputs, provenance, ui};
use crate::bake;
use crate::bake::Estimate;
use crate::bake::{DepthReport, MAX_REFINE, MAX_RESOLUTION, Options, REFINE, Report};
use crate::format;
use crate::format::{Quality, Reader, WriteOptions, Written};
use crate::geom::{Aabb, DVec3};
use crate::progress::Progress;
use crate::source;
use crate::source::OpenOptions;
use crate::volume::{Model, Volume};
use crate::{Error, Result};

/// Turn a 3D source (a mesh, an image stack) into a texel
#[derive(clap::Args)]
pub struct Args {
    /// The sources, each baked by itself; none where --string is all there is. With # in the name of the output, the frames of
    /// one texel, as are numbered files, NAME.####.EXT
    #[arg(required_unless_present = "string", value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// The .vtex file to write, or with a slash at its end the folder [default: the input's name with .vtex, here]
    #[arg(short, long, value_name = "OUT.vtex|FOLDER/")]
    output: Option<PathBuf>,
    /// Voxels along the cube's edge: a power of two up to 4096, others are rounded up
    #[arg(short, long, default_value_t = RESOLUTION, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_RESOLUTION)))]
    resolution: u32,
    /// Edge of the finest voxel in source units, instead of a resolution
    #[arg(long, value_name = "X", value_parser = finite)]
    voxel_size: Option<f64>,
    /// Axes along which the texel continues itself; with --voxel-size and -r, content beyond comes in on the other side
    #[arg(long, value_name = "AXES", value_delimiter = ',', value_parser = ["u", "v", "w"])]
    cyclic: Vec<String>,
    /// Source axis that points up [default: y, of image stacks z]
    #[arg(long, value_enum)]
    up: Option<Up>,
    /// Appearance model: coverage measured at every depth, or the paper's averaged isotropic opacity
    #[arg(long, value_enum, default_value = "coverage")]
    model: ModelArg,
    /// Levels of groups of blocks whose rates are corrected with the renderer's own march: 0 none, each more costs less
    #[arg(long, default_value_t = REFINE, value_name = "N", value_parser = clap::value_parser!(u8).range(..=i64::from(MAX_REFINE)))]
    refine: u8,
    /// Whether voxels tell the source's materials apart, so that a landscape can restyle them by name
    #[arg(long, value_enum, default_value = "on")]
    materials: Materials,
    /// How finely the channels are stored
    #[arg(long, value_enum, default_value = "full")]
    quality: QualityArg,
    /// zstd's most level: 1 is quick, 19 small; lower where that saves next to nothing
    #[arg(long, default_value_t = WriteOptions::default().level, value_name = "LEVEL", value_parser = clap::value_parser!(i32).range(1..=19))]
    compress: i32,
    /// Memory that the bake may take, such as 800M or 2G; more is refused before work begins
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    memory: Option<u64>,
    /// Threads to use [default: all cores]
    #[arg(long, default_value_t = 0, hide_default_value = true, value_name = "N")]
    threads: usize,
    #[command(flatten)]
    depfile: DepfileArgs,
    /// Leave a texel as it is where a bake would write the same once more: the digests of all files that are read, the options
    /// and the version of the program are those that its META has
    #[arg(long, conflicts_with = "report")]
    if_changed: bool,
    /// Write a report as JSON
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print a summary as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    frames: FrameArgs,
    #[command(flatten)]
    paint: PaintArgs,
    #[command(flatten)]
    source: SourceArgs,
}

/// Voxels along the cube's edge where nobody says.
const RESOLUTION: u32 = 512;

#[derive(Clone, Copy, clap::ValueEnum)]
enum ModelArg {
    Coverage,
    Neyret,
}

#[derive(Clone, Copy, PartialEq, clap::ValueEnum)]
enum Materials {
    On,
    Off,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum QualityArg {
    Lean,
    Full,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Up {
    Y,
    Z,
}

impl Args {
    /// `up`: the source's own choice.
    fn options(&self, up: u8) -> Options {
        let wraps = |axis: &str| self.cyclic.iter().any(|a| a == axis);
        Options {
            resolution: self.resolution,
            voxel_size: self.voxel_size,
            model: match self.model {
                ModelArg::Coverage => Model::Coverage,
                ModelArg::Neyret => Model::Neyret,
            },
            cyclic: ["u", "v", "w"].map(wraps),
            up: match self.up {
                Some(Up::Y) => 1,
                Some(Up::Z) => 2,
                None => up,
            },
            memory: self.memory.unwrap_or(0),
            cube: None,
            refine: self.refine,
            materials: self.materials == Materials::On,
            calibrate: true,
        }
    }

    /// What decides on the file, as it was asked for.
    pub fn provenance(&self) -> Value {
        let name = |v: &dyn clap_name::Name| v.name();
        let mut out = json!({
            "model": name(&self.model), "quality": name(&self.quality), "resolution": self.resolution, "refine": self.refine,
        });
        self.up.iter().for_each(|up| out["up"] = name(up).into());
        if self.compress != WriteOptions::default().level {
            out["compress"] = self.compress.into();
        }
        self.voxel_size.into_iter().for_each(|v| out["voxel_size"] = v.into());
        if !self.cyclic.is_empty() {
            out["cyclic"] = self.cyclic.clone().into();
        }
        self.source.provenance(&mut out);
        self.frames.provenance(&mut out);
        self.paint.provenance(&mut out);
        if self.materials == Materials::Off {
            out["materials"] = "off".into();
        }
        out
    }

    /// Check that no option is given that says nothing of the inputs, or nothing beside the other options.
    fn check(&self, inputs: &[PathBuf]) -> Result<()> {
        let mut motion = json!({});
        self.frames.provenance(&mut motion);
        if let Some(ramps) = motion.as_object_mut().and_then(|m| m.remove("frameDefine")) {
            motion["frame_define"] = ramps;
        }
        // A string without a grammar is an L-system.
        let grammar = [PathBuf::from("string.lsys")];
        self.source.check(&motion, if self.inputs.is_empty() { &grammar } else { inputs })?;
        let idle = if self.voxel_size.is_some() && self.cyclic.is_empty() && self.resolution != RESOLUTION {
            "-r says nothing beside --voxel-size, unless the texel is --cyclic: leave one of them out"
        } else if matches!(self.model, ModelArg::Neyret) && self.refine != REFINE {
            "--refine says nothing of --model neyret, whose opacity is an average"
        } else {
            return Ok(());
        };
        Err(Error::Options(idle.into()))
    }
}

/// One bake, and the files that are read for it.
struct Job {
    shot: Shot,
    files: Vec<PathBuf>,
    /// Options by which a frame is laid into the cube that all frames need.
    shared: Option<Options>,
    /// Whether what is said of the source is said here: of the frames of one texel, for the first.
    speaks: bool,
}

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    ui::with_threads(args.threads, || bake_all(args, ui))?
}

fn bake_all(args: &Args, ui: &Ui) -> Result<()> {
    // A string alone has neither a file nor a name.
    let string = [PathBuf::from("string")];
    let inputs = if args.inputs.is_empty() { &string[..] } else { &args.inputs };
    args.check(inputs)?;
    let options = args.source.options(args.memory);
    let frames = args.frames.shots(&args.inputs, args.output.as_deref(), &options)?;
    let is_sequence = frames.is_some();
    let shots = match frames {
        Some(shots) => shots,
        None => inputs.iter().map(|input| shot(args, input, &options)).collect::<Result<Vec<_>>>()?,
    };
    let mut jobs: Vec<Job> = shots.into_iter().map(|shot| job(args, shot)).collect();
    check_outputs(args, &jobs)?;
    if args.voxel_size.is_none() && !args.resolution.is_power_of_two() {
        ui.say(&format!("-r {} is rounded up to {}", args.resolution, args.resolution.next_power_of_two()));
    }
    let mut digests = Digests::default();
    if args.if_changed {
        digests.read_ahead(jobs.iter().flat_map(|job| &job.files));
    }
    let asked = args.provenance();
    // A file that cannot be read is told of where its source is opened.
    let frames = if is_sequence { all_frames(&jobs, &mut digests).unwrap_or_default() } else { String::new() };
    let mut provenance = |job: &Job| {
        let sources = digests.sources(&job.shot.input, &job.files)?;
        Ok(Provenance::new(sources, &asked, &frames, job.shot.animation.as_ref()))
    };
    let mut is_kept =
        |job: &Job| args.if_changed && provenance(job).is_ok_and(|p| p.unchanged(&job.shot.output).is_ok());
    if is_sequence && !jobs.iter().all(&mut is_kept) {
        let shared = shared_box(args, &jobs, ui)?;
        for (k, job) in jobs.iter_mut().enumerate() {
            (job.shared, job.speaks) = (Some(shared.clone()), k == 0);
        }
    }
    let (mut rules, mut left, mut kept) = (Vec::new(), jobs.iter(), 0);
    let inputs: Vec<PathBuf> = jobs.iter().map(|job| job.shot.input.clone()).collect();
    let done = each(&inputs, args.json, ui, |_| {
        let Some(job) = left.next() else { return Ok(Value::Null) };
        let summary = bake_or_keep(args, job, provenance(job), ui)?;
        kept += usize::from(summary["unchanged"] == true);
        rules.push((job.shot.output.as_path(), [job.files.clone(), args.source.files()].concat()));
        Ok(summary)
    });
    if kept > 0 {
        ui.say(&format!("{kept} of {} texels are unchanged", jobs.len()));
    }
    if !rules.is_empty() {
        args.depfile.write(rules, ui)?;
    }
    done
}

/// A digest of what the cube is a function of that the frames share: their files and moments.
fn all_frames(jobs: &[Job], digests: &mut Digests) -> Result<String> {
    let mut all = Vec::new();
    for job in jobs {
        all.push(json!([job.shot.animation, digests.sources(&job.shot.input, &job.files)?]));
    }
    Ok(provenance::digest(&all.into()))
}

/// `provenance`: found before the source is read, so that a file which changes meanwhile is baked again the next time.
fn bake_or_keep(args: &Args, job: &Job, provenance: Result<Provenance>, ui: &Ui) -> Result<Value> {
    if let (true, Ok(provenance)) = (args.if_changed, &provenance) {
        match provenance.unchanged(&job.shot.output) {
            Ok(reader) => return Ok(kept(&job.shot, &reader)),
            Err(change) => ui.say(&format!("{}: {change}", job.shot.output.display())),
        }
    }
    bake_file(args, job, provenance, ui)
}

fn shot(args: &Args, input: &Path, options: &OpenOptions) -> Result<Shot> {
    let output = output_for(input, args.output.as_deref(), args.inputs.len() > 1, "vtex")?;
    let options = args.frames.still(options);
    Ok(Shot { input: input.to_path_buf(), output, options, animation: None })
}

fn job(args: &Args, shot: Shot) -> Job {
    let mut files = if args.inputs.is_empty() { Vec::new() } else { source::dependencies(&shot.input) };
    files.extend(source::paint_files(&args.paint.options()));
    Job { shot, files, shared: None, speaks: true }
}

fn open(args: &Args, shot: &Shot) -> Result<Box<dyn source::Source>> {
    let options = &shot.options;
    let source = match args.inputs.is_empty() {
        false => source::open(&shot.input, options)?,
        true => source::lsystem::open(None, &options.lsystem, &options.read, &options.mesh)?,
    };
    source::apply_paint(source, &args.paint.options(), &options.read)
}

/// The files that `vtex bake WORDS` reads for one texel, and what it is a function of.
///
/// # Errors
/// `Options` where the words are not of a bake; `Io` where a file cannot be read.
#[cfg(feature = "render")]
pub fn provenance_of(words: impl Iterator<Item = String>) -> Result<(Vec<PathBuf>, Provenance)> {
    let args = parse(words)?;
    let options = args.source.options(args.memory);
    let input = args.inputs.first().cloned().unwrap_or_else(|| PathBuf::from("string"));
    let job = job(&args, shot(&args, &input, &options)?);
    let sources = Digests::default().sources(&job.shot.input, &job.files)?;
    Ok(([job.files, args.source.files()].concat(), Provenance::new(sources, &args.provenance(), "", None)))
}

/// [`Args::provenance`] where no option is given.
#[cfg(feature = "render")]
pub fn default_options() -> Value {
    parse(["input".to_owned()].into_iter()).map(|args| args.provenance()).unwrap_or_default()
}

#[cfg(feature = "render")]
fn parse(words: impl Iterator<Item = String>) -> Result<Box<Args>> {
    use clap::Parser;
    let all = ["vtex", "bake"].map(String::from).into_iter().chain(words);
    match super::Vtex::try_parse_from(all).map(|cli| cli.command) {
        Ok(super::Command::Bake(args)) => Ok(args),
        Ok(_) => Err(Error::Options("not the words of a bake".into())),
        Err(e) => Err(Error::Options(e.to_string())),
    }
}

/// The options by which every frame is laid into the cube that all of them need.
fn shared_box(args: &Args, jobs: &[Job], ui: &Ui) -> Result<Options> {
    ui.stage("frames", jobs.len() as u64);
    let mut all: Option<(Aabb, DVec3, u8)> = None;
    for Job { shot, .. } in jobs {
        let source = open(args, shot)?;
        let (origin, up, own) = (source.origin(), source.up(), source.bounds());
        let (bounds, first, _) = *all.get_or_insert((Aabb::EMPTY, origin, up));
        if origin != first {
            let what = "lies far from 0, and elsewhere than the first frame; move the frames to 0";
            return Err(Error::input(&shot.input, "", what));
        }
        let own = if own.is_empty() { own } else { Aabb::new(own.min + origin, own.max + origin) };
        all = Some((bounds.union(own), origin, up));
        ui.advance(1);
    }
    ui.finish();
    let (bounds, _, up) = all.unwrap_or((Aabb::EMPTY, DVec3::ZERO, 1));
    let options = args.options(up);
    let place = bake::plan(bounds, &options)?;
    Ok(Options { cube: Some(place.bounds), resolution: place.side(), voxel_size: None, ..options })
}

fn bake_file(args: &Args, job: &Job, provenance: Result<Provenance>, ui: &Ui) -> Result<Value> {
    let Job { shot: Shot { output, animation, .. }, .. } = job;
    let start = Instant::now();
    ui.stage("read", 0);
    let source = open(args, &job.shot)?;
    if job.speaks {
        source.notes().iter().for_each(|note| ui.say(note));
    }
    let read_time = start.elapsed();
    let (mut volume, report) = bake_source(args, job, &*source, ui)?;
    let bake_time = start.elapsed() - read_time;
    provenance?.store(&mut volume.info.meta);
    if let Some(animation) = animation {
        volume.info.meta.insert("animation".into(), animation.clone());
    }
    ui.stage("write", 0);
    let quality = match args.quality {
        QualityArg::Lean => Quality::Lean,
        QualityArg::Full => Quality::Full,
    };
    let written = format::write(&volume, output, &WriteOptions { level: args.compress, quality })?;
    ui.finish();
    let seconds = start.elapsed().as_secs_f64();
    let voxel_size = volume.info.bounds.size().x / f64::from(volume.resolution());
    let mut summary = described(&job.shot, volume.resolution(), voxel_size, written.finest_voxels, written.file_bytes);
    summary["unchanged"] = false.into();
    let [read_time, bake_time] = [read_time, bake_time].map(|t| t.as_secs_f64());
    summary["seconds"] = json!({ "read": read_time, "bake": bake_time, "total": seconds });
    if let Some(path) = &args.report {
        let full = full_report(&summary, &volume, &report, &written);
        format::save(path, format!("{full:#}\n").as_bytes())?;
    }
    if !args.json {
        ui.say(&format!(
            "{}: {} voxels at {}^3, {}, {:.1} bits a voxel, {seconds:.1} s",
            output.display(),
            count(written.finest_voxels),
            volume.resolution(),
            size(written.file_bytes),
            bits_per(written.file_bytes, written.finest_voxels)
        ));
    }
    Ok(summary)
}

/// Bake, and say what is expected and what is wrong with the source.
fn bake_source(args: &Args, job: &Job, source: &dyn source::Source, ui: &Ui) -> Result<(Volume, Report)> {
    let mut on_estimate = |e: &Estimate| {
        if e.finest_voxels == 0 || !job.speaks {
            return;
        }
        ui.say(&format!(
            "about {} voxels, a file of {}, {} of memory",
            count(e.finest_voxels),
            size(e.file_bytes),
            size(e.memory_bytes)
        ));
    };
    let options = job.shared.as_ref().map_or_else(|| args.options(source.up()), Options::clone);
    let (volume, report) = bake::bake(source, &options, ui, &mut on_estimate)?;
    if volume.depths.is_empty() && job.shared.is_none() {
        let why = report.warnings.as_reasons();
        let why = if why.is_empty() { "; no facet has an area".to_owned() } else { why };
        return Err(Error::input(&job.shot.input, "", format!("there is nothing in it to bake{why}")));
    }
    ui.warn(&report.warnings)?;
    Ok((volume, report))
}

/// The summary with all that is known of the bake.
fn full_report(summary: &Value, volume: &Volume, report: &Report, written: &Written) -> Value {
    let mut full = summary.clone();
    full["warnings"] = report.warnings.iter().map(|(text, n)| json!({ "message": text, "count": n })).collect();
    full["estimate"] = serde_json::to_value(report.estimate).unwrap_or_default();
    full["depths"] = depths(volume, &report.depths);
    full["channels"] = written.channels.iter().map(|(name, bytes)| json!({ "name": name, "bytes": bytes })).collect();
    full["meta"] = Value::Object(volume.info.meta.clone());
    full
}

/// What is told of a texel.
fn described(shot: &Shot, resolution: u32, voxel_size: f64, finest_voxels: u64, file_bytes: u64) -> Value {
    json!({
        "input": shown(&shot.input),
        "output": shown(&shot.output),
        "resolution": resolution,
        "voxel_size": voxel_size,
        "finest_voxels": finest_voxels,
        "file_bytes": file_bytes,
        "bits_per_finest_voxel": bits_per(file_bytes, finest_voxels),
    })
}

/// What is told of a texel that is left as it is.
fn kept(shot: &Shot, reader: &Reader) -> Value {
    let head = reader.head();
    let voxel_size = head.info.bounds.size().x / f64::from(head.resolution());
    let finest = head.depths.last().map_or(0, |d| d.nodes);
    let mut summary = described(shot, head.resolution(), voxel_size, finest, reader.file_bytes());
    summary["unchanged"] = true.into();
    summary
}

fn bits_per(bytes: u64, voxels: u64) -> f64 {
    8.0 * bytes as f64 / voxels.max(1) as f64
}

/// That what will be written has a place, and is none of the files that are read.
fn check_outputs(args: &Args, jobs: &[Job]) -> Result<()> {
    let mut read = args.source.files();
    for Job { shot: Shot { output, .. }, files, .. } in jobs {
        let other = output.extension().filter(|e| !e.eq_ignore_ascii_case("vtex"));
        if let Some(other) = other {
            let (path, other) = (output.display(), other.display());
            return Err(Error::Options(format!("{path}: a texel is written as .vtex, not as .{other}; name it so")));
        }
        read.extend(files.iter().cloned());
    }
    if args.report.is_some() && jobs.len() > 1 {
        return Err(Error::Options("--report is about one input; bake the others by themselves, or use --json".into()));
    }
    let beside = [args.depfile.path(), args.report.as_deref()];
    outputs::check(&read, jobs.iter().map(|job| job.shot.output.as_path()).chain(beside.into_iter().flatten()))
}

fn depths(volume: &Volume, reports: &[DepthReport]) -> Value {
    let row = |(depth, r): (usize, &DepthReport)| {
        json!({
            "depth": depth, "voxels": r.voxels, "error_mean": r.error_mean, "error_p95": r.error_p95,
            "mean_correlation": volume.depths.get(depth).map_or(0.0, |d| {
                d.voxels.iter().map(|v| f64::from(v.c())).sum::<f64>() / d.voxels.len().max(1) as f64
            }),
        })
    };
    reports.iter().enumerate().map(row).collect()
}
