//! `vtex bake`: a 3D source → a .vtex file.

use std::fmt::Write as _;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use super::clap_name;
use super::quantity::{bytes, count, finite, size};
use super::source::SourceArgs;
use super::ui::put_json;
use super::{Ui, outputs};
use crate::bake;
use crate::bake::Estimate;
use crate::bake::{DepthReport, MAX_REFINE, MAX_RESOLUTION, Options, REFINE};
use crate::format;
use crate::format::{Quality, WriteOptions};
use crate::progress::Progress;
use crate::source;
use crate::source::recipe::Laid;
use crate::volume::{Model, Volume};
use crate::{Error, Result, par};

/// Turn a 3D source (a mesh, an image stack) into a texel
#[derive(clap::Args)]
pub struct Args {
    /// The source; none where --string is all there is
    #[arg(required_unless_present = "string")]
    input: Option<PathBuf>,
    #[command(flatten)]
    source: SourceArgs,
    /// Lay a colour on all of it: '#rrggbb' or r,g,b (linear), a picture, a .toml file with the keys of a recipe's albedo, or
    /// these in braces: '{ noise = { scale = 2 }, colours = ["#553311", "#998866"] }'
    #[arg(long, value_name = "COLOUR|FILE|{TABLE}")]
    albedo: Option<String>,
    /// Multiply the source's own colours by --albedo, and don't replace them
    #[arg(long)]
    tint: bool,
    /// Call all of its matter by this name, and not as the source does
    #[arg(long, value_name = "NAME")]
    material: Option<String>,
    /// The .vtex file to write [default: the input's name with .vtex, here]
    #[arg(short, long, value_name = "OUT.vtex")]
    output: Option<PathBuf>,
    /// Voxels along the cube's edge: a power of two up to 4096, others are rounded up
    #[arg(short, long, default_value_t = 512, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_RESOLUTION)))]
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

    /// What decides on the content, for the file's provenance.
    fn provenance(&self, up: u8) -> Value {
        let up = if up == 1 { "y" } else { "z" };
        let name = |v: &dyn clap_name::Name| v.name();
        let mut out = json!({
            "model": name(&self.model), "quality": name(&self.quality), "up": up, "resolution": self.resolution,
            "refine": self.refine,
        });
        self.voxel_size.into_iter().for_each(|v| out["voxelSize"] = v.into());
        if !self.cyclic.is_empty() {
            out["cyclic"] = self.cyclic.clone().into();
        }
        self.source.provenance(&mut out);
        self.albedo.iter().for_each(|v| out["albedo"] = v.as_str().into());
        if self.tint {
            out["tint"] = true.into();
        }
        self.material.iter().for_each(|v| out["material"] = v.as_str().into());
        if self.materials == Materials::Off {
            out["materials"] = "off".into();
        }
        out
    }

    fn laid(&self) -> Laid {
        Laid { albedo: self.albedo.clone(), tint: self.tint, material: self.material.clone() }
    }
}

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    par::with_threads(args.threads, || bake_file(args, ui))?
}

fn bake_file(args: &Args, ui: &Ui) -> Result<()> {
    let start = Instant::now();
    // A string alone has neither a file nor a name.
    let input = args.input.as_deref().unwrap_or(Path::new("string"));
    let output = args
        .output
        .clone()
        .unwrap_or_else(|| PathBuf::from(input.file_name().unwrap_or_default()).with_extension("vtex"));
    let laid = args.laid();
    let mut files = args.input.as_deref().map(source::dependencies).unwrap_or_default();
    files.extend(source::laid_files(&laid));
    check_outputs(args, &output, &files)?;
    if args.voxel_size.is_none() && !args.resolution.is_power_of_two() {
        ui.say(&format!("-r {} is rounded up to {}", args.resolution, args.resolution.next_power_of_two()));
    }
    ui.stage("read", 0);
    let options = args.source.options(args.memory);
    let source = match &args.input {
        Some(path) => source::open(path, &options)?,
        None => source::lsystem::open(None, &options.lsystem, &options.read, &options.mesh)?,
    };
    let source = source::lay(source, &laid, &options.read)?;
    source.notes().iter().for_each(|note| ui.say(note));
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
    let (mut volume, report) = bake::bake(&*source, &args.options(source.up()), ui, &mut foresee)?;
    if volume.depths.is_empty() {
        let why = report.warnings.as_reasons();
        let why = if why.is_empty() { "; no facet has an area".to_owned() } else { why };
        return Err(Error::input(input, "", format!("there is nothing in it to bake{why}")));
    }
    ui.warn(&report.warnings)?;
    let bake_time = start.elapsed() - read_time;
    volume.info.meta.insert("options".into(), args.provenance(volume.info.up));
    volume.info.meta.insert("sources".into(), sources(input, &files)?);
    ui.stage("write", 0);
    let quality = match args.quality {
        QualityArg::Lean => Quality::Lean,
        QualityArg::Full => Quality::Full,
    };
    let written = format::write(&volume, &output, &WriteOptions { level: args.compress, quality })?;
    ui.finish();
    if let Some(depfile) = &args.depfile {
        format::save(depfile, rule(&output, &files).as_bytes())?;
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
        format::save(path, format!("{full:#}\n").as_bytes())?;
    }
    if args.json {
        put_json(&summary)?;
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
fn check_outputs(args: &Args, output: &Path, files: &[PathBuf]) -> Result<()> {
    let other = output.extension().filter(|e| !e.eq_ignore_ascii_case("vtex"));
    if let Some(other) = other {
        let (path, other) = (output.display(), other.display());
        return Err(Error::Options(format!("{path}: a texel is written as .vtex, not as .{other}; name it so")));
    }
    outputs::check(files, [Some(output), args.depfile.as_deref(), args.report.as_deref()].into_iter().flatten())
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
        let mut digest = Sha256::new();
        let mut from = format::open_file(file)?;
        // A piece at a time: sources may be larger than memory.
        let mut piece = vec![0; 1 << 20];
        loop {
            let n = from.read(&mut piece).map_err(|e| Error::io(file, e))?;
            if n == 0 {
                break;
            }
            digest.update(&piece[..n]);
        }
        let mut hex = String::new();
        for byte in digest.finalize() {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_are_escaped() {
        let files = [PathBuf::from("a b.gltf"), PathBuf::from("c$#.bin")];
        assert_eq!(rule(Path::new("o.vtex"), &files), "o.vtex: a\\ b.gltf \\\n  c$$\\#.bin\n");
    }
}
