//! `vtex error`: how far a texel is from the source that it was baked from.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::plot;
use super::plot::{Axis, Chart, Scale, Series};
use super::quantity::bytes;
use super::results::print;
use super::source::SourceArgs;
use super::{Ui, outputs, ui};
use crate::format::{Limits, Reader};
use crate::geom::{Aabb, DVec3};
use crate::render::error::{
    DepthError, ErrorStats, Facet, GroundTruth, MediumBox, Opacity, Options, ProjectedAreas, measure,
};
use crate::scene::files::sha256;
use crate::source;
use crate::source::Placement;
use crate::volume::Octree;
use crate::{Result, Warnings};

#[derive(clap::Args)]
pub struct Args {
    /// The .vtex file
    texel: PathBuf,
    /// The source that it was baked from, with the options that it was baked with
    #[arg(long, value_name = "FILE")]
    source: PathBuf,
    #[command(flatten)]
    measure: MeasureArgs,
    /// Threads to use [default: all cores]
    #[arg(long, default_value_t = 0, hide_default_value = true, value_name = "N")]
    threads: usize,
    /// Memory that the source and its facets may take each, such as 800M or 2G
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    memory: Option<u64>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Draw the errors over the depths
    #[arg(long, value_name = "SVG|PNG")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    how: SourceArgs,
}

/// How finely it is measured.
#[derive(clap::Args)]
pub struct MeasureArgs {
    /// Pixels a direction, depth and size
    #[arg(long, value_name = "N", default_value_t = Options::default().pixels)]
    pixels: u32,
    /// Rays a pixel at the most, a power of two; fewer where they leave noise below .005
    #[arg(long, value_name = "N", default_value_t = Options::default().rays[1])]
    rays: u32,
    /// Only so many of the finest depths
    #[arg(long, value_name = "N", default_value_t = usize::MAX, hide_default_value = true)]
    depths: usize,
    /// Turn the 26 directions away from those that the bake measures along
    #[arg(long)]
    turned: bool,
    /// Other pixels and rays
    #[arg(long, value_name = "N", default_value_t = Options::default().seed)]
    rays_seed: u32,
}

impl MeasureArgs {
    pub fn options(&self) -> Options {
        let default = Options::default();
        let rays = [default.rays[0].min(self.rays), self.rays];
        Options { pixels: self.pixels, rays, turned: self.turned, depths: self.depths, seed: self.rays_seed, ..default }
    }
}

/// Bytes that facets may take where --memory says nothing.
const FACET_BYTES: u64 = 4 << 30;

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    args.plot.iter().try_for_each(|path| plot::check_name(path))?;
    let mut read = source::dependencies(&args.source);
    read.push(args.texel.clone());
    outputs::check(&read, args.plot.as_deref())?;
    ui::with_threads(args.threads, || {
        let reader = Reader::open(&args.texel, &Limits { decoded_bytes: u64::MAX })?;
        ui.warn(&reader.warnings())?;
        ui.warn(&differences(args, &reader)?)?;
        let tree = Octree::new(reader)?;
        args.how.check(&serde_json::json!({}), std::slice::from_ref(&args.source))?;
        let source = source::open(&args.source, &args.how.options(args.memory))?;
        let limit = args.memory.unwrap_or(FACET_BYTES);
        let found = against(&tree, &*source, &args.measure.options(), limit, ui)?;
        if let Some(failure) = tree.into_failure() {
            return Err(failure);
        }
        ui.finish();
        if args.json {
            print(described(args, &found), true, ui)?;
        } else {
            out!("{}", table(args, &found))?;
        }
        args.plot.iter().try_for_each(|path| plot::write(path, &charts(&args.texel, &found), 2))
    })?
}

/// Measure a texel against its source.
pub fn against(
    tree: &Octree,
    source: &dyn source::Source,
    options: &Options,
    max_bytes: u64,
    ui: &Ui,
) -> Result<Vec<DepthError>> {
    let Some(finest) = tree.finest() else { return Ok(Vec::new()) };
    let place = Placement { memory: max_bytes, ..Placement::of(tree.info(), finest) };
    let staged = source.stage(&place, ui)?;
    let source::Facets { pieces, areas, media } = source::facets(&*staged, &place, max_bytes, ui)?;
    let side = f64::from(place.side());
    let facet =
        |p: source::FacetTriangle| Facet { corners: p.corners.map(|c| c / side), number: p.facet, cut_out: p.cut_out };
    let look = |facet: u32, at: DVec3| {
        let seen = staged.surface(facet, at * side, 0.0);
        (seen.albedo, seen.alpha)
    };
    let soft = |m: &source::Medium| {
        let (low, edge) = (DVec3::from(m.at.map(f64::from)), f64::from(1u32 << m.edge_log2));
        let bounds = Aabb::new((low + edge * m.lo) / side, (low + edge * m.hi) / side);
        MediumBox { bounds, extinction: m.extinction * side, flat: m.flat, normal: m.normal, albedo: m.albedo }
    };
    // Projected areas are of facets alone.
    let areas = media.is_empty().then(|| ProjectedAreas::new(areas));
    let soft = media.iter().map(soft).collect();
    let truth = GroundTruth::new(pieces.into_iter().map(facet).collect(), soft, &look);
    measure(tree, &truth, areas, options, ui)
}

/// Whether the texel was baked from another file, or with other options.
fn differences(args: &Args, reader: &Reader) -> Result<Warnings> {
    let mut warnings = Warnings::default();
    let meta = &reader.head().info.meta;
    if let Some(known) = meta.get("sources").and_then(|s| s[0]["sha256"].as_str())
        && sha256(&args.source)? != known
    {
        let (source, texel) = (args.source.display(), args.texel.display());
        warnings.add(format!("{source} is not the file, or not the version of it, that {texel} was baked from"));
    }
    let Some(Value::Object(known)) = meta.get("options") else { return Ok(warnings) };
    let mut mine = json!({});
    args.how.provenance(&mut mine);
    for (name, value) in mine.as_object().into_iter().flatten() {
        if !known.get(name).is_some_and(|k| same(k, value)) {
            let was = known.get(name).map_or("without it".into(), Value::to_string);
            warnings.add(format!("the texel was baked with another {name} ({was}): give the same options"));
        }
    }
    Ok(warnings)
}

/// Whether two options are alike; a number that is whole may be stored without a point.
fn same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Number(a), Value::Number(b)) => a.as_f64() == b.as_f64(),
        (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b)),
        (Value::Object(a), Value::Object(b)) => {
            a.len() == b.len() && a.iter().all(|(name, a)| b.get(name).is_some_and(|b| same(a, b)))
        }
        _ => a == b,
    }
}

/// The worst and the aims, in words that scripts can ask for.
fn described(args: &Args, depths: &[DepthError]) -> Value {
    json!({
        "texel": args.texel.display().to_string(),
        "source": args.source.display().to_string(),
        "directions": 26,
        "turned": args.measure.turned,
        "depths": depths,
    })
}

fn table(args: &Args, depths: &[DepthError]) -> String {
    let mut out = format!(
        "{} against {}: 26 directions{}, pixels as wide as a voxel, and of 4 voxels\n\n",
        args.texel.display(),
        args.source.display(),
        if args.measure.turned { " (turned)" } else { "" }
    );
    let opacity = |o: &Opacity| format!("{} {:>6.3}", spread(&o.spread), o.area);
    out +=
        "               | |ΔT|, pixel = voxel         | by one ray    | |ΔT|, pixel of 4 voxels     | sigma       |\n";
    out += "depth   voxels |  mean   p95    bias   area  |  mean   p95   |  mean   p95    bias   area  |  mean   p95 | albedo shading shadow  light  noise\n";
    for d in depths {
        let four = d.opacity_at_4.as_ref().map_or(format!("{:27}", ""), &opacity);
        let sigma = d.sigma.map_or(format!("{:11}", ""), |s| format!("{:>5.3} {:>5.3}", s.mean, s.p95));
        out += &format!(
            "{:>5} {:>8} | {} | {:>5.3} {:>6.3}  | {four} | {sigma} | {:>6.3} {:>7.3} {:>6.3} {:>6.3}  {:.4}\n",
            d.depth,
            d.voxels,
            opacity(&d.opacity),
            d.one_ray.mean,
            d.one_ray.p95,
            d.albedo.mean,
            d.shading.mean,
            d.shadow.mean,
            d.light.mean,
            d.opacity.noise.max(d.opacity_at_4.map_or(0.0, |o| o.noise)),
        );
    }
    out
}

fn spread(s: &ErrorStats) -> String {
    format!("{:>5.3} {:>6.3} {:>+7.3}", s.mean, s.p95, s.bias)
}

/// Opacity on the left, what covers on the right.
fn charts(texel: &Path, depths: &[DepthError]) -> [Chart; 2] {
    let line = |name: &str, of: &dyn Fn(&DepthError) -> Option<f64>| Series {
        name: name.into(),
        points: depths.iter().filter_map(|d| Some((d.depth as f64, of(d)?))).collect(),
        line: true,
    };
    let chart = |title: String, scale: Scale, series: Vec<Series>, aims: Vec<f64>| Chart {
        title,
        x: Axis { label: "depth".into(), scale: Scale::Linear },
        y: Axis { label: "error".into(), scale },
        series,
        aims,
    };
    let name = texel.file_name().unwrap_or_default().to_string_lossy();
    let opacity = vec![
        line("pixel = voxel", &|d| Some(d.opacity.spread.mean)),
        line("pixel = voxel, 95 %", &|d| Some(d.opacity.spread.p95)),
        line("pixel of 4 voxels", &|d| d.opacity_at_4.map(|o| o.spread.mean)),
        line("one ray", &|d| Some(d.one_ray.mean)),
    ];
    let rest = vec![
        line("sigma", &|d| d.sigma.map(|s| s.mean)),
        line("albedo", &|d| Some(d.albedo.mean)),
        line("shading", &|d| Some(d.shading.mean)),
        line("shadow", &|d| Some(d.shadow.mean)),
        line("light", &|d| Some(d.light.mean)),
    ];
    [
        chart(format!("{name}: opacity"), Scale::Linear, opacity, vec![0.03, 0.06]),
        chart(format!("{name}: appearance"), Scale::Log, rest, Vec::new()),
    ]
}

#[cfg(test)]
mod tests;
