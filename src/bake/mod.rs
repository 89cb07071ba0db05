//! Bake of any source into a texel.
//!
//! A source gives its matter as planar convex facets and as media. A bake takes these steps, each in a file or folder:
//!
//! 1. `options`, `plan`, `estimate`: where the source lies in the grid, and how large the result will be.
//! 2. `region`, `clip`: facets are cut exactly into the finest voxels, region by region, in parallel.
//! 3. `measure`, with `line_mask`, `alpha_mask`, `medium`, `materials`: areas, coverage along 13 axes and colour of a voxel.
//! 4. `tree`: nodes are joined upward, and measured at every depth from their children.
//! 5. `fit`, with `projected_cell`, `block_lines`, `correlation`, `ndf`, `ellipsoid`: voxels of a block from measurements.
//! 6. `refine`, with `group_transmittance`, `gain_curve`: rates of groups of blocks are corrected.
//! 7. `output`, `coverage_error`: fitted voxels, and how far they are from what was measured.
//! 8. `calibrate`: brightness of every depth against a fine one.

mod alpha_mask;
mod block_lines;
mod calibrate;
mod clip;
mod correlation;
mod coverage_error;
mod ellipsoid;
mod estimate;
mod fit;
mod gain_curve;
mod group_transmittance;
mod line_mask;
mod materials;
mod measure;
mod medium;
mod ndf;
mod options;
mod output;
mod plan;
mod projected_cell;
mod refine;
mod region;
mod tree;

#[cfg(test)]
mod tests;

pub(crate) use calibrate::calibrate;
pub use ellipsoid::fit_sggx;
pub use estimate::Estimate;
pub use options::{MAX_REFINE, MAX_RESOLUTION, Options, REFINE};
pub(crate) use plan::plan;

use serde_json::json;

use crate::geom::{Aabb, DVec3};
use crate::progress::Progress;
use crate::source::{Placement, Source, Staged};
use crate::volume::brightness::BrightnessFactors;
use crate::volume::surface::{self, SurfaceMeans, SurfaceParams};
use crate::volume::{Channels, Depth, Info, Material, Model, Volume};
use crate::{Error, Result, Warnings, morton, par};
use coverage_error::CoverageError;
use output::{FitOptions, Output};
use region::Region;
use tree::TreeAssembler;

/// Report of a bake, besides the volume.
#[derive(Debug, Clone, Default)]
pub struct Report {
    /// Warnings of the source.
    pub warnings: Warnings,
    /// Size that was expected before the work began.
    pub estimate: Estimate,
    /// Result of each depth, root first.
    pub depths: Vec<DepthReport>,
}

/// Result of one depth.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct DepthReport {
    /// Number of voxels.
    pub voxels: u64,
    /// Mean error of coverage: over all squares one voxel wide, along 13 axes, in which a block has matter, the mean of |share
    /// covered by the fitted block − measured|. Blocks are compared one by one, before groups of them are refined. `None` where
    /// nothing was measured, as with [`Model::Neyret`].
    pub error_mean: Option<f64>,
    /// 95th percentile of the same.
    pub error_p95: Option<f64>,
}

/// Bake `source` into a texel that is ready to be written; `on_estimate` is called with the expected size before the work begins.
///
/// # Errors
/// [`Error::Options`] on options out of range, [`Error::Limit`] where more memory is needed than is allowed, and what the
/// source gives.
pub fn bake(
    source: &dyn Source,
    options: &Options,
    progress: &dyn Progress,
    on_estimate: &mut dyn FnMut(&Estimate),
) -> Result<(Volume, Report)> {
    let (volume, report) = measure_and_fit(source, options, progress, on_estimate)?;
    if !options.calibrate {
        return Ok((volume, report));
    }
    progress.stage("calibrate", 0);
    Ok((calibrate(volume, BrightnessFactors::PLAIN)?, report))
}

/// [`bake`] without the calibration of depths, for callers that first replace some of the voxels.
pub(crate) fn measure_and_fit(
    source: &dyn Source,
    options: &Options,
    progress: &dyn Progress,
    on_estimate: &mut dyn FnMut(&Estimate),
) -> Result<(Volume, Report)> {
    let origin = source.origin();
    let relative = |cube: Aabb| Aabb::new(cube.min - origin, cube.max - origin);
    let options = &Options { cube: options.cube.map(relative), ..options.clone() };
    let requested = plan(source.bounds(), options)?;
    let place = plan::measured_grid(&requested);
    let surfaces = source.surfaces();
    // Transmission is stored by material, so where there is any, voxels need their mixes of materials.
    let names = if options.materials || !surfaces.is_empty() { source.materials() } else { &[] };
    materials::check_count(names)?;
    let staged = source.stage(&place, progress)?;
    let estimate = estimate::estimate(&*staged, &place);
    on_estimate(&estimate);
    check_memory(options, &place, estimate.memory_bytes)?;
    let mut output = build(&*staged, &place, options, names.len() > 1, progress)?;
    let materials = match names {
        [one] => single_material(one, &output),
        _ => output.materials.summarize(names),
    };
    if place.depth > requested.depth {
        // Finer depths were baked only to measure this one.
        output.depths.truncate(requested.depth + 1);
        output.depths.iter_mut().last().into_iter().for_each(|finest| finest.masks.fill(0));
    }
    let report = Report { warnings: source.warnings().clone(), estimate, depths: depth_reports(&output) };
    let depths = output.depths;
    let mut info = Info {
        bounds: Aabb::new(place.bounds.min + origin, place.bounds.max + origin),
        metres_per_unit: source.metres_per_unit(),
        up: place.up,
        cyclic: options.cyclic,
        model: options.model,
        content: content_box(&depths),
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
    let params = |(i, s): (usize, &SurfaceMeans)| s.params(info.materials.get(i).map(|m| m.albedo));
    let surfaces: Vec<SurfaceParams> = surfaces.iter().enumerate().map(params).collect();
    surface::store(&surfaces, &mut info.meta);
    Ok((Volume { info, depths }, report))
}

/// Numbers of voxels and errors of all depths; errors are rounded to four places.
fn depth_reports(output: &Output) -> Vec<DepthReport> {
    let round = |v: f64| (v * 1e4).round() / 1e4;
    let report = |(depth, errors): (&Depth, &CoverageError)| {
        let (mean, p95) = errors.mean_p95().unzip();
        DepthReport { voxels: depth.voxels.len() as u64, error_mean: mean.map(round), error_p95: p95.map(round) }
    };
    output.depths.iter().zip(&output.errors).map(report).collect()
}

/// Box of all matter in texel space: the root's support box. It holds those of all deeper voxels, since it is rounded outward by more
/// than theirs.
fn content_box(depths: &[Depth]) -> Aabb {
    let Some(root) = depths.first().and_then(|d| d.voxels.first()) else { return Aabb::new(DVec3::ZERO, DVec3::ZERO) };
    let (lo, hi) = root.support_box();
    Aabb::new(lo.as_dvec3(), hi.as_dvec3())
}

/// Material of a texel that has only one, of the root's colour.
fn single_material(name: &str, output: &Output) -> Vec<Material> {
    let root = output.depths.first().and_then(|d| d.voxels.first());
    let mut weights = materials::MaterialWeights::default();
    weights.add(0, 1.0, root.map_or(DVec3::ONE, |r| r.albedo().as_dvec3()));
    weights.summarize(&[name.to_owned()])
}

/// META of the texel: the measured errors of the depths, and the version of vtex. The caller adds the provenance.
fn meta(report: &Report) -> serde_json::Map<String, serde_json::Value> {
    let mut meta = serde_json::Map::new();
    let error = |d: &DepthReport| d.error_mean.map(|mean| json!({ "opacity": { "mean": mean, "p95": d.error_p95 } }));
    let depths: Vec<_> = report.depths.iter().map(error).collect();
    if depths.iter().any(Option::is_some) {
        meta.insert("error".into(), json!({ "depths": depths }));
    }
    meta.insert("generator".into(), concat!("vtex ", env!("CARGO_PKG_VERSION")).into());
    meta
}

/// Number of regions per thread that may be measured ahead of the one that is joined next. The transmittances of a region take up
/// to an eighth of a megabyte.
const REGIONS_AHEAD: usize = 16;

/// Check that the bake may take the `needed` bytes.
fn check_memory(options: &Options, place: &Placement, needed: u64) -> Result<()> {
    if options.memory == 0 || needed <= options.memory {
        return Ok(());
    }
    let what = format!(
        "the memory of a bake at {} voxels an edge (allow more, or lower the resolution), in bytes,",
        place.side()
    );
    Err(Error::Limit { what, needed, allowed: options.memory })
}

/// Fitted voxels of all depths; none for a source without matter. Fails as soon as they take more memory than is allowed, which
/// happens where there are more of them than the estimate said.
fn build(
    staged: &dyn Staged,
    place: &Placement,
    options: &Options,
    track_materials: bool,
    progress: &dyn Progress,
) -> Result<Output> {
    let regions = staged.regions();
    let region_log2 = place.region_log2();
    let region_depth = place.depth - region_log2;
    let refine = if options.model == Model::Coverage { usize::from(options.refine) } else { 0 };
    let fit = FitOptions { model: options.model, refine, track_materials };
    progress.stage("measure", regions.len() as u64);
    let mut output = Output::new(place.depth + 1, fit);
    let mut assembler = TreeAssembler::new(region_depth);
    let measure = |i: usize| {
        let origin = morton::decode(regions[i]).map(|v| v << region_log2);
        let mut region = Region::new(staged, Output::new(place.depth + 1, fit), origin, region_log2);
        let node = region.node(i, region_depth);
        progress.advance(1);
        (node, region.output)
    };
    par::in_order(regions.len(), REGIONS_AHEAD * par::threads(), measure, |i, (node, part)| {
        assembler.finish_before(region_depth, regions[i], &mut output);
        output.append(part);
        if let Some(node) = node {
            assembler.add(region_depth, regions[i], node);
        }
        let voxels: usize = output.depths.iter().map(|d| d.voxels.len()).sum();
        check_memory(options, place, voxels as u64 * estimate::VOXEL_MEMORY)
    })?;
    Ok(if assembler.finish(&mut output) { output } else { Output::new(0, fit) })
}
