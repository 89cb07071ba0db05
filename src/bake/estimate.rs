//! How large a bake will be, before it is done: the facets of some regions are cut without being measured.

use super::cutout;
use super::source::{Placement, Staged};
use crate::geom::DVec3;
use crate::{morton, par};

/// Regions that are looked at.
const SAMPLES: usize = 32;
/// Bytes that a voxel takes while a bake runs and in a file, and what a facet and a region take.
const VOXEL_MEMORY: u64 = 3 * 17;
const VOXEL_FILE: f64 = 6.0;
const FACET_MEMORY: u64 = 48;
const REGION_MEMORY: u64 = 4096;

/// What is expected; voxels to some 20 %.
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

/// Cut every n-th region of `staged` and scale up.
pub fn estimate(staged: &dyn Staged, place: &Placement) -> Estimate {
    let regions = staged.regions();
    let step = regions.len().div_ceil(SAMPLES).max(1);
    let levels = place.region_log2();
    let counted = par::map(regions.len().div_ceil(step), |n| {
        let region = n * step + step / 2 % step.max(1);
        let region = region.min(regions.len() - 1);
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
        count(levels, codes)
    });
    let scale = regions.len() as f64 / counted.len().max(1) as f64;
    let sum = |i: usize| counted.iter().map(|c| c[i]).sum::<u64>() as f64 * scale;
    let facets: u64 = (0..regions.len()).map(|r| staged.weight(r)).sum();
    let voxels = sum(1) * 1.02;
    Estimate {
        finest_voxels: sum(0) as u64,
        voxels: voxels as u64,
        file_bytes: (voxels * VOXEL_FILE) as u64,
        memory_bytes: voxels as u64 * VOXEL_MEMORY + facets * FACET_MEMORY + regions.len() as u64 * REGION_MEMORY,
    }
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
