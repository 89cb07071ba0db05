//! `vtex bake`: a 3D source → a .vtex file.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use super::Ui;
use crate::bake::{self, DepthReport, Estimate, Fill, MAX_RESOLUTION, MeshOptions, Options};
use crate::format::{self, Quality, WriteOptions};
use crate::progress::Progress;
use crate::scene::gltf::ReadOptions;
use crate::volume::{Model, Volume};
use crate::{Error, Result, par};

/// Bytes that a source may take as it is read where --memory says nothing: a file that lies of its size cannot take more.
const READ_BYTES: u64 = 2 << 30;

/// Turn a 3D source (.gltf, .glb, .obj) into a texel
#[derive(clap::Args)]
pub struct Args {
    /// The source
    input: PathBuf,
    /// The .vtex file to write [default: the input's name with .vtex, here]
    #[arg(short, long, value_name = "OUT.vtex")]
    output: Option<PathBuf>,
    /// Voxels along the cube's edge: a power of two up to 4096, others are rounded up
    #[arg(short, long, default_value_t = 512, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_RESOLUTION)))]
    resolution: u32,
    /// Edge of the finest voxel in source units, instead of a resolution
    #[arg(long, value_name = "X")]
    voxel_size: Option<f64>,
    /// What is within closed surfaces: nothing, or opaque matter (auto: in every component that closes)
    #[arg(long, value_enum, default_value = "auto")]
    fill: FillArg,
    /// Axes along which the texel continues itself; with --voxel-size and -r, content beyond comes in on the other side
    #[arg(long, value_name = "AXES", value_delimiter = ',', value_parser = ["u", "v", "w"])]
    cyclic: Vec<String>,
    /// Source axis that points up
    #[arg(long, value_enum, default_value = "y")]
    up: Up,
    /// Appearance model: coverage measured at every depth, or the paper's averaged isotropic opacity
    #[arg(long, value_enum, default_value = "coverage")]
    model: ModelArg,
    /// How finely the channels are stored
    #[arg(long, value_enum, default_value = "full")]
    quality: QualityArg,
    /// zstd's level: 1 is quick, 19 small
    #[arg(long, default_value_t = 9, value_name = "LEVEL", value_parser = clap::value_parser!(i32).range(1..=19))]
    compress: i32,
    /// Memory that the bake may take, such as 800M or 2G; more is refused before work begins
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    memory: Option<u64>,
    /// Threads to use [default: all cores]
    #[arg(long, default_value_t = 0, hide_default_value = true, value_name = "N")]
    threads: usize,
    /// Width of lines and points in source units; without it they are left out
    #[arg(long, value_name = "X", value_parser = positive)]
    line_width: Option<f64>,
    /// Scene of the file, by name or index
    #[arg(long, value_name = "SCENE")]
    scene: Option<String>,
    /// Take only the nodes of this name (* and ? match) and all below them; may be given again
    #[arg(long, value_name = "NAME")]
    include: Vec<String>,
    /// Leave out the nodes of this name and all below them; may be given again
    #[arg(long, value_name = "NAME")]
    exclude: Vec<String>,
    /// Write what the output depends on, for make and ninja
    #[arg(long, value_name = "FILE")]
    depfile: Option<PathBuf>,
    /// Write a report as JSON
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print a summary as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum FillArg {
    Surface,
    Solid,
    Auto,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum ModelArg {
    Coverage,
    Neyret,
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
    fn options(&self) -> Options {
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
                Up::Y => 1,
                Up::Z => 2,
            },
            memory: self.memory.unwrap_or(0),
        }
    }

    fn mesh(&self) -> MeshOptions {
        let fill = match self.fill {
            FillArg::Surface => Fill::Surface,
            FillArg::Solid => Fill::Solid,
            FillArg::Auto => Fill::Auto,
        };
        MeshOptions { line_width: self.line_width, fill }
    }

    /// What decides on the content, for the file's provenance.
    fn provenance(&self) -> Value {
        let name = |v: &dyn clap_name::Name| v.name();
        let mut out = json!({
            "fill": name(&self.fill), "model": name(&self.model), "quality": name(&self.quality), "up": name(&self.up),
            "resolution": self.resolution,
        });
        let mut add = |key: &str, value: Value| out[key] = value;
        self.voxel_size.into_iter().for_each(|v| add("voxelSize", v.into()));
        self.line_width.into_iter().for_each(|v| add("lineWidth", v.into()));
        self.scene.iter().for_each(|v| add("scene", v.as_str().into()));
        for (key, list) in [("cyclic", &self.cyclic), ("include", &self.include), ("exclude", &self.exclude)] {
            if !list.is_empty() {
                add(key, list.clone().into());
            }
        }
        out
    }
}

mod clap_name {
    use clap::ValueEnum;

    /// The name of an argument's value, as it is typed.
    pub trait Name {
        fn name(&self) -> String;
    }

    impl<T: ValueEnum> Name for T {
        fn name(&self) -> String {
            self.to_possible_value().map(|v| v.get_name().to_owned()).unwrap_or_default()
        }
    }
}

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    par::with_threads(args.threads, || bake_file(args, ui))?
}

fn bake_file(args: &Args, ui: &Ui) -> Result<()> {
    let start = Instant::now();
    let output = args
        .output
        .clone()
        .unwrap_or_else(|| PathBuf::from(args.input.file_name().unwrap_or_default()).with_extension("vtex"));
    check_outputs(args, &output)?;
    if args.voxel_size.is_none() && !args.resolution.is_power_of_two() {
        ui.say(&format!("-r {} is rounded up to {}", args.resolution, args.resolution.next_power_of_two()));
    }
    ui.stage("read", 0);
    let read = ReadOptions {
        scene: args.scene.clone(),
        include: args.include.clone(),
        exclude: args.exclude.clone(),
        max_bytes: args.memory.filter(|&m| m > 0).unwrap_or(READ_BYTES),
        ..ReadOptions::default()
    };
    let source = bake::open(&args.input, &read, &args.mesh())?;
    let read_time = start.elapsed();
    let mut foresee = |e: &Estimate| {
        if e.finest_voxels == 0 {
            return;
        }
        ui.say(&format!(
            "about {} voxels, a file of {}, {} of memory",
            count(e.finest_voxels),
            size(e.file_bytes),
            size(e.memory_bytes)
        ));
    };
    let (mut volume, report) = bake::bake(&*source, &args.options(), ui, &mut foresee)?;
    if volume.depths.is_empty() {
        let why = report.warnings.as_reasons();
        return Err(Error::input(
            &args.input,
            "",
            format!("there is nothing in it to bake: no facet has an area{why}"),
        ));
    }
    ui.warn(&report.warnings)?;
    let bake_time = start.elapsed() - read_time;
    let files = bake::dependencies(&args.input);
    volume.info.meta.insert("options".into(), args.provenance());
    volume.info.meta.insert("sources".into(), sources(&args.input, &files)?);
    ui.stage("write", 0);
    let quality = match args.quality {
        QualityArg::Lean => Quality::Lean,
        QualityArg::Full => Quality::Full,
    };
    let written = format::write(&volume, &output, &WriteOptions { level: args.compress, quality })?;
    ui.finish();
    if let Some(depfile) = &args.depfile {
        save(depfile, &rule(&output, &files))?;
    }
    let bits = 8.0 * written.file_bytes as f64 / written.finest_voxels.max(1) as f64;
    let seconds = start.elapsed().as_secs_f64();
    let summary = json!({
        "output": output.display().to_string(),
        "resolution": volume.resolution(),
        "voxelSize": volume.info.bounds.size().x / f64::from(volume.resolution()),
        "finestVoxels": written.finest_voxels,
        "fileBytes": written.file_bytes,
        "bitsPerFinestVoxel": bits,
        "seconds": { "read": read_time.as_secs_f64(), "bake": bake_time.as_secs_f64(), "total": seconds },
        "warnings": report.warnings.iter().map(|(text, n)| (text.to_owned(), Value::from(n))).collect::<serde_json::Map<_, _>>(),
    });
    if let Some(path) = &args.report {
        let mut full = summary.clone();
        full["estimate"] = serde_json::to_value(report.estimate).unwrap_or_default();
        full["depths"] = depths(&volume, &report.depths);
        full["channels"] =
            written.channels.iter().map(|(name, bytes)| json!({ "name": name, "bytes": bytes })).collect();
        full["meta"] = Value::Object(volume.info.meta.clone());
        save(path, &format!("{full:#}\n"))?;
    }
    if args.json {
        println!("{summary:#}");
    } else {
        ui.say(&format!(
            "{}: {} voxels at {}^3, {}, {bits:.1} bits a voxel, {seconds:.1} s",
            output.display(),
            count(written.finest_voxels),
            volume.resolution(),
            size(written.file_bytes)
        ));
    }
    Ok(())
}

/// That what will be written has a place, and is none of the files that are read.
fn check_outputs(args: &Args, output: &Path) -> Result<()> {
    let real = |path: &Path| std::fs::canonicalize(path).ok();
    let read: Vec<PathBuf> = bake::dependencies(&args.input).iter().filter_map(|f| real(f)).collect();
    for path in [Some(output), args.depfile.as_deref(), args.report.as_deref()].into_iter().flatten() {
        let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            return Err(Error::input(path, "", "its folder does not exist; make it first"));
        }
        if path.is_dir() {
            return Err(Error::Options(format!("{}: is a folder; name a file in it", path.display())));
        }
        if real(path).is_some_and(|p| read.contains(&p)) {
            return Err(Error::Options(format!("{}: is read as a source; write to another name", path.display())));
        }
    }
    Ok(())
}

fn depths(volume: &Volume, reports: &[DepthReport]) -> Value {
    let row = |(depth, r): (usize, &DepthReport)| {
        json!({
            "depth": depth, "voxels": r.voxels, "errorMean": r.error_mean, "errorP95": r.error_p95,
            "meanCorrelation": volume.depths.get(depth).map_or(0.0, |d| {
                d.voxels.iter().map(|v| f64::from(v.c())).sum::<f64>() / d.voxels.len().max(1) as f64
            }),
        })
    };
    reports.iter().enumerate().map(row).collect()
}

/// Names, relative to the input's folder, and digests.
fn sources(input: &Path, files: &[PathBuf]) -> Result<Value> {
    let folder = input.parent().unwrap_or(Path::new(""));
    let mut list = Vec::new();
    for file in files {
        let bytes = std::fs::read(file).map_err(|e| Error::io(file, e))?;
        let mut hex = String::new();
        for byte in Sha256::digest(&bytes) {
            let _ = write!(hex, "{byte:02x}");
        }
        let name = file.strip_prefix(folder).ok().filter(|n| n.is_relative()).map(Path::to_path_buf);
        let name = name.or_else(|| file.file_name().map(PathBuf::from)).unwrap_or_default();
        list.push(json!({ "uri": name.to_string_lossy().replace('\\', "/"), "sha256": hex }));
    }
    Ok(list.into())
}

/// A make rule; ninja reads the same.
fn rule(output: &Path, files: &[PathBuf]) -> String {
    let escaped = |path: &Path| {
        let mut out = String::new();
        for c in path.to_string_lossy().chars() {
            match c {
                ' ' | '#' => out.extend(['\\', c]),
                '$' => out.push_str("$$"),
                _ => out.push(c),
            }
        }
        out
    };
    let inputs: Vec<String> = files.iter().map(|f| escaped(f)).collect();
    format!("{}: {}\n", escaped(output), inputs.join(" \\\n  "))
}

fn save(path: &Path, text: &str) -> Result<()> {
    std::fs::write(path, text).map_err(|e| Error::io(path, e))
}

/// 1500000 → "1.5 M".
fn count(n: u64) -> String {
    match n {
        0..10_000 => n.to_string(),
        10_000..1_000_000 => format!("{} k", n / 1000),
        _ => format!("{:.1} M", n as f64 * 1e-6),
    }
}

fn size(bytes: u64) -> String {
    match bytes {
        0..10_000 => format!("{bytes} bytes"),
        10_000..1_000_000 => format!("{} kB", bytes / 1000),
        1_000_000..1_000_000_000 => format!("{:.1} MB", bytes as f64 * 1e-6),
        _ => format!("{:.2} GB", bytes as f64 * 1e-9),
    }
}

/// A number of bytes with an optional K, M, G or T (powers of 1024).
fn bytes(text: &str) -> Result<u64, String> {
    let trimmed = text.trim().trim_end_matches(['B', 'b']).trim_end_matches(['i', 'I']);
    let (digits, unit) = match trimmed.char_indices().last() {
        Some((i, c)) if c.is_ascii_alphabetic() => (&trimmed[..i], c.to_ascii_uppercase()),
        _ => (trimmed, ' '),
    };
    let power = " KMGT".find(unit).ok_or_else(|| format!("{unit} is not one of K, M, G, T"))?;
    let number: f64 = digits.trim().parse().map_err(|_| "not a number of bytes, such as 800M or 2G".to_owned())?;
    let value = number * 1024f64.powi(power as i32);
    if (1.0..1e18).contains(&value) { Ok(value as u64) } else { Err("out of range".into()) }
}

fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if value > 0.0 && value.is_finite() { Ok(value) } else { Err("must be above 0".into()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn byte_counts() {
        assert_eq!(bytes("2G"), Ok(2 << 30));
        assert_eq!(bytes("1.5MiB"), Ok(3 << 19));
        assert_eq!(bytes("4096"), Ok(4096));
        assert!(bytes("x").is_err() && bytes("-1G").is_err() && bytes("").is_err());
    }

    #[test]
    fn rules_are_escaped() {
        let files = [PathBuf::from("a b.gltf"), PathBuf::from("c$#.bin")];
        assert_eq!(rule(Path::new("o.vtex"), &files), "o.vtex: a\\ b.gltf \\\n  c$$\\#.bin\n");
    }
}
