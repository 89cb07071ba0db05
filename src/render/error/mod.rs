//! The error of a texel against its source: opacity, normals, colour and shadows, compared with rays cast through the source's own
//! facets, depth by depth, in 26 directions.
//!
//! Based on: E. Heitz, F. Neyret, *Representing Appearance and Pre-filtering Subpixel Data in Sparse Voxel Octrees*, HPG 2012
//! (what a prefiltered voxel has to agree with is the mean over a pixel); G. Loubet, F. Neyret, *Hybrid Mesh-Volume LoDs*,
//! EG 2017.
//!
//! A pixel is a square at right angles to the direction, at a random position over the texel and randomly rotated. Texel and source
//! are both averaged over the same rays through it (a box filter). A pixel that neither covers is background and does not count.

mod options;
mod pixels;
mod sigma;
mod truth;

pub use options::{Options, SUN};
pub use sigma::ProjectedAreas;
pub use truth::{Facet, FacetAppearance, GroundTruth, MediumBox};

use serde::Serialize;

use crate::geom::{DMat3, DVec3, directions13};
use crate::progress::Progress;
use crate::volume::Octree;
use crate::{Error, Result, par};
use pixels::{Batch, Pixel};

/// Statistics of errors, which are texel − ground truth: mean and 95th percentile of their magnitude, and their signed mean.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct ErrorStats {
    /// Mean magnitude.
    pub mean: f64,
    /// 95th percentile of the magnitude.
    pub p95: f64,
    /// Signed mean.
    pub bias: f64,
}

impl ErrorStats {
    /// Statistics of pairs of an error and its weight, ≥ 0.
    fn of(mut errors: Vec<(f64, f64)>) -> ErrorStats {
        let total: f64 = errors.iter().map(|e| e.1).sum();
        if total.is_nan() || total <= 0.0 {
            return ErrorStats::default();
        }
        errors.sort_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
        let mut left = 0.95 * total;
        let p95 = errors.iter().find(|e| {
            left -= e.1;
            left <= 0.0
        });
        ErrorStats {
            mean: errors.iter().map(|e| e.0.abs() * e.1).sum::<f64>() / total,
            p95: p95.map_or(0.0, |e| e.0.abs()),
            bias: errors.iter().map(|e| e.0 * e.1).sum::<f64>() / total,
        }
    }
}

/// Opacity at one size of pixel.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Opacity {
    /// |ΔT| over pixels; a positive bias is too opaque.
    #[serde(flatten)]
    pub spread: ErrorStats,
    /// Ratio of the covered area to the true one, over all directions together.
    pub area: f64,
    /// Least such ratio of any one direction.
    pub area_least: f64,
    /// Greatest such ratio of any one direction.
    pub area_most: f64,
    /// The part of |ΔT| that is due to the finite number of rays: half the mean difference between the errors by each half of them.
    pub noise: f64,
    /// Mean number of rays per pixel.
    pub rays: f64,
    /// Pixels that are not background.
    pub pixels: u64,
}

/// Error of one depth against the truth.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct DepthError {
    /// Depth in the octree; 0 is the root.
    pub depth: usize,
    /// Voxels at this depth.
    pub voxels: u64,
    /// Pixels as wide as a voxel.
    pub opacity: Opacity,
    /// The same by one ray through the pixel's middle, as a picture of one lane takes it.
    pub one_ray: ErrorStats,
    /// Pixels four voxels wide; not at depths 0 and 1, where those are as large as the texel.
    pub opacity_at_4: Option<Opacity>,
    /// Projected area of a voxel's normals along 13 axes, over its mean, against that of the facets in it.
    pub sigma: Option<ErrorStats>,
    /// Colour of what is seen, mean over the channels; pixels by coverage.
    pub albedo: ErrorStats,
    /// Mean of max(0, n·l) over what is seen, l being [`SUN`] and no shadows; pixels by coverage.
    pub shading: ErrorStats,
    /// Share of that light that is not in the shadow; pixels by the light.
    pub shadow: ErrorStats,
    /// Both together, as a picture shows it: with the factors of light that the texel has for its depths.
    pub light: ErrorStats,
}

/// 26 unit directions through the faces, edges and corners of the cube.
fn directions(turned: bool) -> [DVec3; 26] {
    // A turn by 45 degrees about an axis that lies in no mirror plane of the cube.
    let turn = if turned {
        DMat3::from_axis_angle(DVec3::new(0.37, 0.61, 0.70).normalize(), std::f64::consts::FRAC_PI_4)
    } else {
        DMat3::IDENTITY
    };
    let axes = directions13();
    std::array::from_fn(|i| turn * if i < 13 { axes[i] } else { -axes[i - 13] })
}

/// Measure `tree` against `truth`, and its normals against `areas` where they are known (of the finest depth); coarsest
/// depth first. Same figures for any number of threads.
///
/// # Errors
/// `Options` where a number is out of range, and what reading the texel gives.
pub fn measure(
    tree: &Octree,
    truth: &GroundTruth<'_>,
    areas: Option<ProjectedAreas>,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Vec<DepthError>> {
    let [least, most] = options.rays;
    let usable = |n: u32| n.is_power_of_two() && (2..=65_536).contains(&n);
    if !(usable(least) && usable(most) && least <= most && (1..=100_000).contains(&options.pixels)) {
        return Err(Error::Options(format!(
            "{} pixels of {least} to {most} rays: 1 to 100000 pixels, and powers of two from 2 to 65536 of rays",
            options.pixels
        )));
    }
    let Some(finest) = tree.finest() else { return Ok(Vec::new()) };
    let depths: Vec<usize> = (0..=finest).rev().take(options.depths).collect();
    let directions = directions(options.turned);
    let mut areas = areas;
    let mut found = Vec::with_capacity(depths.len());
    progress.stage("measure", 2 * 26 * depths.len() as u64);
    for &depth in &depths {
        let at = |voxels: f64, shaded: bool| {
            let pixels = par::map(directions.len(), |i| {
                let batch = Batch { tree, truth, options, depth, voxels, shaded, direction: directions[i] };
                let pixels = batch.measure(i as u32);
                progress.advance(1);
                pixels
            });
            (opacity(&pixels), pixels.concat())
        };
        let (own, pixels) = at(1.0, true);
        let mut error = DepthError { depth, voxels: tree.count(depth) as u64, opacity: own, ..DepthError::default() };
        error.one_ray = ErrorStats::of(pixels.iter().map(|p| (p.one_ray - p.truth.opacity, 1.0)).collect());
        appearance(&pixels, &mut error);
        error.opacity_at_4 = (depth >= 2).then(|| at(4.0, false).0);
        error.sigma = areas.as_ref().map(|a| sigma::compare(tree, depth, a));
        areas = areas.map(|a| a.coarser());
        found.push(error);
    }
    found.reverse();
    Ok(found)
}

/// Errors of the pixels of all directions.
fn opacity(directions: &[Vec<Pixel>]) -> Opacity {
    let area = |pixels: &[Pixel]| {
        let sum = |f: &dyn Fn(&Pixel) -> f64| pixels.iter().map(f).sum::<f64>();
        sum(&|p| p.texel.opacity) / sum(&|p| p.truth.opacity)
    };
    let pixels = directions.concat();
    if pixels.is_empty() {
        return Opacity::default();
    }
    let n = pixels.len() as f64;
    let areas = directions.iter().map(|d| area(d)).filter(|a| a.is_finite());
    let (least, most) = areas.fold((f64::INFINITY, 0.0f64), |(lo, hi), a| (lo.min(a), hi.max(a)));
    let whole = area(&pixels);
    Opacity {
        spread: ErrorStats::of(pixels.iter().map(|p| (p.texel.opacity - p.truth.opacity, 1.0)).collect()),
        area: if whole.is_finite() { whole } else { 0.0 },
        area_least: if least.is_finite() { least } else { 0.0 },
        area_most: most,
        noise: pixels.iter().map(|p| p.noise).sum::<f64>() / n,
        rays: pixels.iter().map(|p| f64::from(p.rays)).sum::<f64>() / n,
        pixels: pixels.len() as u64,
    }
}

/// Colour, shading and shadow over pixels.
fn appearance(pixels: &[Pixel], error: &mut DepthError) {
    /// Pixels of less coverage are left out, since the mean over what covers them is too noisy.
    const SEEN: f64 = 1.0 / 64.0;
    let seen = || pixels.iter().filter(|p| p.texel.cover > SEEN && p.truth.cover > SEEN);
    let mut albedo = ErrorStats::default();
    for k in 0..3 {
        let of = |p: &Pixel| (p.texel.albedo[k] / p.texel.cover - p.truth.albedo[k] / p.truth.cover, p.truth.cover);
        let one = ErrorStats::of(seen().map(of).collect());
        albedo.mean += one.mean / 3.0;
        albedo.p95 += one.p95 / 3.0;
        albedo.bias += one.bias / 3.0;
    }
    error.albedo = albedo;
    let shading = |p: &Pixel| (p.texel.lit / p.texel.cover - p.truth.lit / p.truth.cover, p.truth.cover);
    error.shading = ErrorStats::of(seen().map(shading).collect());
    let light = |p: &Pixel| (p.texel.light / p.texel.cover - p.truth.light / p.truth.cover, p.truth.cover);
    error.light = ErrorStats::of(seen().map(light).collect());
    let lit = seen().filter(|p| p.texel.lit > SEEN && p.truth.lit > SEEN);
    let shadow = |p: &Pixel| (p.texel.open / p.texel.lit - p.truth.open / p.truth.lit, p.truth.lit);
    error.shadow = ErrorStats::of(lit.map(shadow).collect());
}

#[cfg(test)]
mod tests;
