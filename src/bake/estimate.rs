//! Estimate of a bake's size: facets are cut to voxels in a sample of the regions, without measuring them.

use super::clip::for_each_piece;
use crate::geom::DVec3;
use crate::source::{FACET_MEMORY, Placement, Staged};
use crate::{morton, par};

/// Number of regions that are sampled: of sources that hold their facets, and of those that have to compute them.
const SAMPLES: [usize; 2] = [128, 32];
/// Bytes of memory per voxel while a bake runs: 43 and 36 as measured at 512³ and 1024³, and 8 for its mix of materials.
pub const VOXEL_MEMORY: u64 = 44 + 8;
/// Bytes per voxel in a file.
const VOXEL_FILE: f64 = 6.0;
/// Bytes of memory per region.
const REGION_MEMORY: u64 = 4096;

/// Expected size of a bake. Numbers of voxels are right to some 10 %, or 20 % for sources that compute their facets.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct Estimate {
    /// Number of voxels of the finest depth.
    pub finest_voxels: u64,
    /// Number of voxels of all depths.
    pub voxels: u64,
    /// Size of the file.
    pub file_bytes: u64,
    /// Memory besides the source itself.
    pub memory_bytes: u64,
}

/// Expected size of the bake of `staged`: every n-th region is cut, and the others are extrapolated by their numbers of facets.
pub fn estimate(staged: &dyn Staged, place: &Placement) -> Estimate {
    let regions = staged.regions();
    let weights: Vec<u64> = (0..regions.len()).map(|r| staged.weight(r)).collect();
    let holds_facets = weights.iter().any(|&w| w > 1);
    let step = regions.len().div_ceil(SAMPLES[usize::from(!holds_facets)]).max(1);
    let region_log2 = place.region_log2();
    let counted = par::map(regions.len().div_ceil(step), |n| {
        let region = (n * step + step / 2).min(regions.len() - 1);
        let origin = morton::decode(regions[region]).map(|v| f64::from(v << region_log2));
        let (corner, width) = (DVec3::from(origin), f64::from(1u32 << region_log2));
        let mut codes = Vec::new();
        staged.emit(region, &mut |facet| {
            for_each_piece(staged, facet, corner, corner + width, &mut |_, at, _| {
                let cell = (at - corner).clamp(DVec3::ZERO, DVec3::splat(width - 1.0)).as_uvec3();
                let code = morton::encode(cell.to_array());
                if codes.last() != Some(&code) {
                    codes.push(code);
                }
            });
            if codes.len() > 1 << 20 {
                codes.sort_unstable();
                codes.dedup();
            }
        });
        staged.medium(region, &mut |medium| {
            let cell = medium.at.map(|v| v & ((1 << region_log2) - 1));
            codes.push(morton::encode(cell));
        });
        codes.sort_unstable();
        codes.dedup();
        (weights[region], count_nodes(region_log2, codes))
    });
    let facets: u64 = weights.iter().sum();
    let extrapolate = |count: fn(&NodeCount) -> u64| {
        let samples: Vec<[f64; 2]> = counted.iter().map(|(w, c)| [*w as f64, count(c) as f64]).collect();
        regression_total(&samples, regions.len() as f64, facets as f64)
    };
    // Nodes above the regions are a fiftieth of those within at most.
    let (finest, voxels) = (extrapolate(|c| c.finest), extrapolate(|c| c.all) * 1.02);
    Estimate {
        finest_voxels: finest as u64,
        voxels: voxels as u64,
        file_bytes: (voxels * VOXEL_FILE) as u64,
        memory_bytes: voxels as u64 * VOXEL_MEMORY + facets * FACET_MEMORY + regions.len() as u64 * REGION_MEMORY,
    }
}

/// Expected sum of y over `n` regions whose x sum up to `sum`, where `samples` holds [x, y] of some of them: the regression
/// estimator (W. Cochran, *Sampling Techniques*, 1977), at least the sum of the samples.
fn regression_total(samples: &[[f64; 2]], n: f64, sum: f64) -> f64 {
    let count = samples.len().max(1) as f64;
    let [x, y] = [0, 1].map(|k| samples.iter().map(|s| s[k]).sum::<f64>() / count);
    let spread: f64 = samples.iter().map(|s| (s[0] - x).powi(2)).sum();
    let slope = if spread > 0.0 { samples.iter().map(|s| (s[0] - x) * (s[1] - y)).sum::<f64>() / spread } else { 0.0 };
    (n * y + slope * (sum - n * x)).max(y * count)
}

/// Numbers of nodes in a region.
struct NodeCount {
    /// Voxels of the finest depth.
    finest: u64,
    /// Nodes of all depths.
    all: u64,
}

/// Number of nodes in a region of `2^region_log2` voxels per edge whose occupied voxels have these Morton `codes`, ascending.
fn count_nodes(region_log2: usize, mut codes: Vec<u64>) -> NodeCount {
    let finest = codes.len() as u64;
    let mut all = finest;
    for _ in 0..region_log2 {
        codes.iter_mut().for_each(|c| *c >>= 3);
        codes.dedup();
        all += codes.len() as u64;
    }
    NodeCount { finest, all }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_on_a_line_extrapolate_exactly() {
        // y = 3 + 2 x: 10 regions with 40 facets.
        let samples = [[1.0, 5.0], [4.0, 11.0], [7.0, 17.0]];
        assert!((regression_total(&samples, 10.0, 40.0) - 110.0).abs() < 1e-9);
        // Where all x are alike the mean counts; and the total is never less than the samples themselves.
        assert_eq!(regression_total(&[[1.0, 5.0], [1.0, 7.0]], 10.0, 10.0), 60.0);
        assert_eq!(regression_total(&[[0.0, 1.0], [10.0, 21.0]], 100.0, -400.0), 22.0);
        assert_eq!(regression_total(&[], 0.0, 0.0), 0.0);
    }
}
