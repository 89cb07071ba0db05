//! `vtex merge` and `vtex resample`: texels → a texel.

use std::path::{Path, PathBuf};

use serde_json::json;

use super::depfile::DepfileArgs;
use super::quantity::{bytes, count, positive, size};
use super::results::{print, shown};
use super::{Ui, outputs};
use crate::format;
use crate::format::{Limits, Quality, Reader, WriteOptions};
use crate::geom::{Aabb, DAffine3, DMat3, DVec3};
use crate::merge::{MergeOptions, merge, to_unit_of};
use crate::progress::Progress;
use crate::{Error, Result};

/// Put texels together, each with its own colours; where one lies on the grid alone, its voxels stay as they are
#[derive(clap::Args)]
pub struct MergeArgs {
    /// Two or more .vtex files; the first one's grid is kept where all fit in
    #[arg(required = true, num_args = 2..)]
    inputs: Vec<PathBuf>,
    /// The file to write
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    /// Move an input, in its units; the first time the first input, the second time the second, and so on
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    translate: Vec<DVec3>,
    #[command(flatten)]
    common: Common,
}

/// Turn, resize, crop or tile a texel, or change its resolution
#[derive(clap::Args)]
pub struct ResampleArgs {
    /// The .vtex file
    input: PathBuf,
    /// The file to write
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    /// Make it so many times as large
    #[arg(long, value_name = "FACTOR", value_parser = positive, default_value = "1")]
    scale: f64,
    /// Turn it by degrees about x, then y, then z
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true, default_value = "0,0,0")]
    rotate: DVec3,
    /// Move it, in its units
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true, default_value = "0,0,0")]
    translate: DVec3,
    /// Keep what is in the box between two corners, in its units, after it was moved
    #[arg(long, value_name = "X,Y,Z", num_args = 2, value_parser = vector, allow_hyphen_values = true)]
    crop: Vec<DVec3>,
    /// Copies side by side along u, v and w
    #[arg(long, value_name = "U,V,W", value_parser = vector)]
    tile: Option<DVec3>,
    #[command(flatten)]
    common: Common,
}

#[derive(clap::Args)]
struct Common {
    /// Voxels along the cube's edge [default: the voxels stay as large as they are]
    #[arg(short, long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    resolution: Option<u32>,
    /// zstd's most level: 1 is quick, 19 small; lower where that saves next to nothing
    #[arg(long, default_value_t = WriteOptions::default().level, value_name = "LEVEL", value_parser = clap::value_parser!(i32).range(1..=19))]
    compress: i32,
    /// Memory that each input and the work may take, such as 800M or 2G
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    memory: Option<u64>,
    #[command(flatten)]
    depfile: DepfileArgs,
    /// Print a summary as JSON
    #[arg(long)]
    json: bool,
}

fn vector(text: &str) -> Result<DVec3, String> {
    let numbers: Vec<f64> =
        text.split(',').filter_map(|v| v.trim().parse().ok()).filter(|v: &f64| v.is_finite()).collect();
    match numbers[..] {
        [x, y, z] if text.split(',').count() == 3 => Ok(DVec3::new(x, y, z)),
        _ => Err("three numbers with commas between them".into()),
    }
}

pub fn run_merge(args: &MergeArgs, ui: &Ui) -> Result<()> {
    if args.translate.len() > args.inputs.len() {
        return Err(Error::Options("--translate was given more often than there are inputs".into()));
    }
    let transforms = args.translate.iter().map(|t| DAffine3::from_translation(*t)).collect();
    make(&args.inputs, &args.output, &args.common, MergeOptions { transforms, ..MergeOptions::default() }, ui)
}

pub fn run_resample(args: &ResampleArgs, ui: &Ui) -> Result<()> {
    let [x, y, z] = args.rotate.to_array().map(f64::to_radians);
    let turn = DMat3::from_rotation_z(z) * DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x);
    let placed = DAffine3::from_mat3_translation(turn * args.scale, args.translate);
    let crop = match args.crop[..] {
        [a, b] => Some(Aabb::new(a.min(b), a.max(b))),
        _ => None,
    };
    if crop.is_some_and(|c| c.size().min_element() <= 0.0) {
        return Err(Error::Options("--crop: the box has no inside".into()));
    }
    let tile = args.tile.map_or([1; 3], |t| t.to_array().map(|n| n.clamp(1.0, 4096.0) as u32));
    let options = MergeOptions { transforms: vec![placed], crop, tile, ..MergeOptions::default() };
    make(std::slice::from_ref(&args.input), &args.output, &args.common, options, ui)
}

fn make(inputs: &[PathBuf], output: &Path, common: &Common, options: MergeOptions, ui: &Ui) -> Result<()> {
    outputs::check(inputs, [Some(output), common.depfile.path()].into_iter().flatten())?;
    ui.stage("read", 0);
    let limit = common.memory.filter(|&m| m > 0).unwrap_or(Limits::default().decoded_bytes);
    let mut volumes = Vec::with_capacity(inputs.len());
    for path in inputs {
        let reader = Reader::open(path, &Limits { decoded_bytes: limit })?;
        volumes.push((reader.read_all()?, reader.warnings()));
    }
    // Each was moved in its own unit.
    let Some(first) = volumes.first().map(|(v, _)| v.info.clone()) else { return Ok(()) };
    let transforms = volumes.iter().enumerate().map(|(i, (v, _))| {
        to_unit_of(&v.info, &first) * options.transforms.get(i).copied().unwrap_or(DAffine3::IDENTITY)
    });
    let options = MergeOptions { transforms: transforms.collect(), ..options };
    let options = MergeOptions { resolution: common.resolution, memory: common.memory.unwrap_or(0), ..options };
    let (mut volume, report) = merge(volumes, &options, ui)?;
    ui.warn(&report.warnings)?;
    let name = |p: &PathBuf| json!({ "uri": p.file_name().unwrap_or_default().to_string_lossy() });
    volume.info.meta.insert("sources".into(), inputs.iter().map(name).collect());
    let written = format::write(&volume, output, &WriteOptions { level: common.compress, quality: Quality::Full })?;
    ui.finish();
    common.depfile.write([(output, inputs.to_vec())], ui)?;
    if !common.json {
        ui.say(&format!(
            "{}: {} voxels at {}^3, {}",
            output.display(),
            count(written.finest_voxels),
            volume.resolution(),
            size(written.file_bytes)
        ));
    }
    let summary = json!({
        "inputs": inputs.iter().map(|input| shown(input)).collect::<Vec<_>>(),
        "output": shown(output),
        "resolution": volume.resolution(),
        "voxel_size": volume.info.bounds.size().x / f64::from(volume.resolution()),
        "finest_voxels": written.finest_voxels,
        "file_bytes": written.file_bytes,
    });
    print(summary, common.json, ui)
}
