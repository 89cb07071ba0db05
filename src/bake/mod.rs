//! Any source → texel.
//!
//! A source gives its matter as planar convex facets; the bake cuts them exactly into voxels, measures coverage along 13
//! axes at every depth, and fits each voxel's directional rate, correlation and colour.

mod beams;
mod calibrate;
mod cutout;
mod ellipsoid;
mod estimate;
mod fit;
mod march;
mod materials;
mod measure;
mod medium;
mod refine;
mod tree;

pub(crate) use calibrate::calibrate;
pub use ellipsoid::fit_sggx;
pub use estimate::Estimate;

use crate::geom::{Aabb, DAffine3, DVec3};
use crate::progress::Progress;
use crate::source::{Placement, Source, Staged};
use crate::volume::level::Level;
use crate::volume::{Channels, Info, Material, Model, Volume};
use crate::{Error, Result, Warnings, morton, par};
use tree::{How, Joiner, Output, Region};

/// Largest resolution that may be asked for.
pub const MAX_RESOLUTION: u32 = 4096;

/// Levels of [`Options::refine`] where nothing is said, and the most: up to the root of the largest texel, so that it covers as a
/// whole what was measured.
pub const REFINE: u8 = MAX_REFINE;
pub const MAX_REFINE: u8 = 10;

/// What is to be baked of a source.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Voxels along the cube's edge, 1 … 4096; rounded up to a power of two.
    pub resolution: u32,
    /// Edge of the finest voxel in source units. Then the cube is as many voxels wide as the source needs; along cyclic
    /// axes it is `resolution` voxels wide, and what reaches beyond comes in again on the other side.
    pub voxel_size: Option<f64>,
    pub model: Model,
    /// Axes u, v, w along which the texel is to match itself.
    pub cyclic: [bool; 3],
    /// Source axis that becomes w: 1 (+Y) or 2 (+Z).
    pub up: u8,
    /// Bytes that the bake may take besides the source; 0: any.
    pub memory: u64,
    /// The texel's cube in source space, where it is not to be found from what the source fills.
    pub cube: Option<Aabb>,
    /// Levels of groups of blocks, each twice as wide as the last, in which rates are corrected with the renderer's own
    /// march; 0: none.
    pub refine: u8,
    /// Whether the texel tells the source's materials apart.
    pub materials: bool,
    /// Whether the brightness of the depths is measured against the finest, so that it does not step from depth to depth in
    /// a picture ([`crate::volume::level`]).
    pub calibrate: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            resolution: 512,
            voxel_size: None,
            model: Model::Coverage,
            cyclic: [false; 3],
            up: 1,
            memory: 0,
            cube: None,
            refine: REFINE,
            materials: true,
            calibrate: true,
        }
    }
}

/// What the bake says besides the volume.
#[derive(Debug, Clone, Default)]
pub struct Report {
    pub warnings: Warnings,
    pub estimate: Estimate,
    /// A depth each, root first.
    pub depths: Vec<DepthReport>,
}

/// How one depth came out.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct DepthReport {
    pub voxels: u64,
    /// Mean and 95th percentile, over voxels, of the mean over 13 directions of |opacity fitted − measured|.
    pub error_mean: f64,
    pub error_p95: f64,
}

/// Bake `source` into a texel that is ready to be written; `foresee` is told the size before the work begins.
///
/// # Errors
/// [`Error::Options`] on options out of range, [`Error::Limit`] where more memory is needed than is allowed, and what the
/// source gives.
pub fn bake(
    source: &dyn Source,
    options: &Options,
    progress: &dyn Progress,
    foresee: &mut dyn FnMut(&Estimate),
) -> Result<(Volume, Report)> {
    let (volume, report) = measure_and_fit(source, options, progress, foresee)?;
    if !options.calibrate {
        return Ok((volume, report));
    }
    progress.stage("calibrate", 0);
    Ok((calibrate(volume, Level::PLAIN)?, report))
}

/// [`bake`] without the calibration of depths, which comes last: what puts other voxels in place of some calibrates itself.
pub(crate) fn measure_and_fit(
    source: &dyn Source,
    options: &Options,
    progress: &dyn Progress,
    foresee: &mut dyn FnMut(&Estimate),
) -> Result<(Volume, Report)> {
    let place = plan(source.bounds(), options)?;
    let names = if options.materials { source.materials() } else { &[] };
    materials::check(names)?;
    let staged = source.stage(&place, progress)?;
    let estimate = estimate::estimate(&*staged, &place);
    foresee(&estimate);
    within(options, &place, estimate.memory_bytes)?;
    let output = build(&*staged, &place, options, names.len() > 1, progress)?;
    let materials = match names {
        [one] => only(one, &output),
        _ => output.materials.told(names),
    };
    let depths = output.depths;
    // The root's support: rounded outward by more than any deeper voxel's, so no support reaches beyond it.
    let content = depths.first().and_then(|d| d.voxels.first()).map_or(Aabb::new(DVec3::ZERO, DVec3::ZERO), |root| {
        let (lo, hi) = root.support_box();
        Aabb::new(lo.as_dvec3(), hi.as_dvec3())
    });
    let report = Report {
        warnings: source.warnings().clone(),
        estimate,
        depths: depths
            .iter()
            .zip(&output.certificates)
            .map(|(d, c)| {
                let round = |v: f64| (v * 1e4).round() / 1e4;
                let (mean, p95) = c.figures();
                DepthReport { voxels: d.voxels.len() as u64, error_mean: round(mean), error_p95: round(p95) }
            })
            .collect(),
    };
    let info = Info {
        bounds: place.bounds,
        metres_per_unit: source.metres_per_unit(),
        up: place.up,
        cyclic: options.cyclic,
        model: options.model,
        content,
        facet_size: source.facet_size() * place.scale / f64::from(place.side()),
        channels: Channels {
            correlation: options.model == Model::Coverage,
            support: options.model == Model::Coverage,
            albedo: source.has_colour(),
            mean_normal: depths.iter().flat_map(|d| &d.voxels).any(|v| v.one_sidedness() > 0.0),
        },
        materials,
        meta: meta(&report),
    };
    Ok((Volume { info, depths }, report))
}

/// A texel's one material.
fn only(name: &str, output: &Output) -> Vec<Material> {
    let root = output.depths.first().and_then(|d| d.voxels.first());
    let mut weights = materials::Weights::default();
    weights.add(0, 1.0, root.map_or(DVec3::ONE, |r| r.albedo().as_dvec3()));
    weights.told(&[name.to_owned()])
}

/// What the file says of how it was made; who calls adds the sources.
fn meta(report: &Report) -> serde_json::Map<String, serde_json::Value> {
    let mut meta = serde_json::Map::new();
    let error = |d: &DepthReport| serde_json::json!({ "opacity": { "mean": d.error_mean, "p95": d.error_p95 } });
    let depths: Vec<_> = report.depths.iter().map(error).collect();
    meta.insert("error".into(), serde_json::json!({ "depths": depths }));
    meta.insert("generator".into(), concat!("vtex ", env!("CARGO_PKG_VERSION")).into());
    meta
}

/// Where a source of `bounds` lies in the grid.
pub(crate) fn plan(bounds: Aabb, options: &Options) -> Result<Placement> {
    if options.resolution == 0 || options.resolution > MAX_RESOLUTION {
        return Err(Error::Options(format!("-r {}: the resolution is 1 to {MAX_RESOLUTION}", options.resolution)));
    }
    let mut place = Placement {
        bounds: Aabb::UNIT,
        transform: DAffine3::IDENTITY,
        scale: 1.0,
        depth: 0,
        up: options.up,
        cyclic: options.cyclic,
    };
    let size = if bounds.is_empty() { DVec3::ONE } else { bounds.size() };
    // Source axes that wrap around: u is x; v and w are z and y, or y and z.
    let wraps = |axis: usize| match axis {
        0 => options.cyclic[0],
        a if a == usize::from(options.up) => options.cyclic[2],
        _ => options.cyclic[1],
    };
    let needed = (0..3).filter(|&a| options.voxel_size.is_none() || !wraps(a)).map(|a| size[a]).fold(0.0, f64::max);
    let extent = needed * (1.0 + 1.0 / f64::from(1 << 20));
    let extent = if extent > 0.0 { extent } else { 1.0 };
    let side = match options.voxel_size {
        Some(edge) => {
            let want = (extent / edge).ceil();
            if !(edge > 0.0 && want <= f64::from(MAX_RESOLUTION)) {
                return Err(Error::Options(format!(
                    "--voxel-size {edge}: from {:.6} on, for at most {MAX_RESOLUTION} voxels along {extent:.6}",
                    extent / f64::from(MAX_RESOLUTION)
                )));
            }
            let least = if options.cyclic == [false; 3] { 1 } else { options.resolution };
            (want as u32).max(least).next_power_of_two()
        }
        None => options.resolution.next_power_of_two(),
    };
    let edge = options.voxel_size.unwrap_or(extent / f64::from(side)) * f64::from(side);
    if let Some(cube) = options.cube {
        let side = options.resolution.next_power_of_two();
        place.bounds = cube;
        place.scale = f64::from(side) / cube.size().x;
        place.depth = side.trailing_zeros() as usize;
        return Ok(place);
    }
    // Centred across, standing on w = 0.
    let base = if bounds.is_empty() { Aabb::new(DVec3::ZERO, DVec3::ONE) } else { bounds };
    let mut min = base.centre() - 0.5 * edge;
    min[usize::from(options.up)] = base.min[usize::from(options.up)];
    place.bounds = Aabb::new(min, min + edge);
    place.scale = f64::from(side) / edge;
    place.depth = side.trailing_zeros() as usize;
    Ok(place)
}

/// Regions a thread that may be measured before the first of them is joined to others; what a ray finds in each takes up to an
/// eighth of a megabyte.
const AHEAD: usize = 16;

/// An error where more memory is needed than is allowed.
fn within(options: &Options, place: &Placement, needed: u64) -> Result<()> {
    if options.memory == 0 || needed <= options.memory {
        return Ok(());
    }
    let what = format!("baking at -r {} (give more --memory, or a smaller -r), in bytes,", place.side());
    Err(Error::Limit { what, needed, allowed: options.memory })
}

/// All depths; none for a source without matter. Ends where it takes more memory than was foreseen and is allowed.
fn build(
    staged: &dyn Staged,
    place: &Placement,
    options: &Options,
    materials: bool,
    progress: &dyn Progress,
) -> Result<Output> {
    let regions = staged.regions();
    let levels = place.region_log2();
    let top = place.depth - levels;
    let refine = if options.model == Model::Coverage { usize::from(options.refine) } else { 0 };
    let how = How { model: options.model, refine, materials };
    progress.stage("measure", regions.len() as u64);
    let mut output = Output::new(place.depth + 1, how);
    let mut joiner = Joiner::new(top);
    let measure = |i: usize| {
        let origin = morton::decode(regions[i]).map(|v| v << levels);
        let mut region = Region::new(staged, Output::new(place.depth + 1, how), origin, levels);
        let node = region.node(i, top);
        progress.advance(1);
        (node, region.output)
    };
    par::in_order(regions.len(), AHEAD * par::threads(), measure, |i, (node, part)| {
        joiner.make_way(top, regions[i], &mut output);
        output.append(part);
        if let Some(node) = node {
            joiner.add(top, regions[i], node);
        }
        let voxels: usize = output.depths.iter().map(|d| d.voxels.len()).sum();
        within(options, place, voxels as u64 * estimate::VOXEL_MEMORY)
    })?;
    Ok(if joiner.finish(&mut output) { output } else { Output::new(0, how) })
}
