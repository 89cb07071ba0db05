//! How large a bake will be, before it is done: the facets of some regions are cut without being measured.

use super::cutout;
use crate::geom::DVec3;
use crate::source::{Placement, Staged};
use crate::{morton, par};

/// Regions that are looked at: of sources whose facets are at hand, and of those that have to make them.
const SAMPLES: [usize; 2] = [128, 32];
/// Bytes that a voxel takes while a bake runs (measured at 512^3 and 1024^3: 43 and 36, and what it shows of materials) and in a file, and what a facet and
/// a region take.
pub const VOXEL_MEMORY: u64 = 44 + 8;
const VOXEL_FILE: f64 = 6.0;
const FACET_MEMORY: u64 = 48;
const REGION_MEMORY: u64 = 4096;

/// What is expected; voxels to some 10 %, of sources that make their facets 20 %.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct Estimate {
    /// Voxels of the finest depth.
    pub finest_voxels: u64,
    /// Of all depths.
    pub voxels: u64,
    pub file_bytes: u64,
    /// Besides the source itself.
    pub memory_bytes: u64,
}

/// Cut every n-th region of `staged`, and expect of the others what their numbers of facets let expect.
pub fn estimate(staged: &dyn Staged, place: &Placement) -> Estimate {
    let regions = staged.regions();
    let weights: Vec<u64> = (0..regions.len()).map(|r| staged.weight(r)).collect();
    let at_hand = weights.iter().any(|&w| w > 1);
    let step = regions.len().div_ceil(SAMPLES[usize::from(!at_hand)]).max(1);
    let levels = place.region_log2();
    let counted = par::map(regions.len().div_ceil(step), |n| {
        let region = (n * step + step / 2).min(regions.len() - 1);
        let origin = morton::decode(regions[region]).map(|v| f64::from(v << levels));
        let (corner, width) = (DVec3::from(origin), f64::from(1u32 << levels));
        let mut codes = Vec::new();
        staged.emit(region, &mut |facet| {
            cutout::pieces(staged, facet, corner, corner + width, &mut |_, at, _| {
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
            let cell = medium.at.map(|v| v & ((1 << levels) - 1));
            codes.push(morton::encode(cell));
        });
        codes.sort_unstable();
        codes.dedup();
        (weights[region], count(levels, codes))
    });
    let facets: u64 = weights.iter().sum();
    let of = |i: usize| {
        let seen: Vec<[f64; 2]> = counted.iter().map(|(w, c)| [*w as f64, c[i] as f64]).collect();
        total(&seen, regions.len() as f64, facets as f64)
    };
    let (finest, voxels) = (of(0), of(1) * 1.02);
    Estimate {
        finest_voxels: finest as u64,
        voxels: voxels as u64,
        file_bytes: (voxels * VOXEL_FILE) as u64,
        memory_bytes: voxels as u64 * VOXEL_MEMORY + facets * FACET_MEMORY + regions.len() as u64 * REGION_MEMORY,
    }
}

/// The sum of y over `n` regions whose x add up to `sum`, of some of which `seen` has [x, y]: along the line of least
/// squares (the regression estimator; W. Cochran, *Sampling Techniques*, 1977).
fn total(seen: &[[f64; 2]], n: f64, sum: f64) -> f64 {
    let count = seen.len().max(1) as f64;
    let [x, y] = [0, 1].map(|k| seen.iter().map(|s| s[k]).sum::<f64>() / count);
    let spread: f64 = seen.iter().map(|s| (s[0] - x).powi(2)).sum();
    let slope = if spread > 0.0 { seen.iter().map(|s| (s[0] - x) * (s[1] - y)).sum::<f64>() / spread } else { 0.0 };
    (n * y + slope * (sum - n * x)).max(y * count)
}

/// Finest voxels and nodes in a cube, of its voxels' codes.
fn count(levels: usize, mut codes: Vec<u64>) -> [u64; 2] {
    let finest = codes.len() as u64;
    let mut nodes = finest;
    for _ in 0..levels {
        codes.iter_mut().for_each(|c| *c >>= 3);
        codes.dedup();
        nodes += codes.len() as u64;
    }
    [finest, nodes]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_on_a_line_is_foreseen_exactly() {
        // y = 3 + 2 x: 10 regions with 40 facets.
        let seen = [[1.0, 5.0], [4.0, 11.0], [7.0, 17.0]];
        assert!((total(&seen, 10.0, 40.0) - 110.0).abs() < 1e-9);
        // All alike: so many times the mean, and never less than what was seen.
        assert_eq!(total(&[[1.0, 5.0], [1.0, 7.0]], 10.0, 10.0), 60.0);
        assert_eq!(total(&[[0.0, 1.0], [10.0, 21.0]], 100.0, -400.0), 22.0);
        assert_eq!(total(&[], 0.0, 0.0), 0.0);
    }
}
