//! How large a bake will be, before it is done: the facets of some regions are cut without being measured.

use super::clip::Polygon;
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
        let mut facets = Vec::new();
        staged.emit(region, &mut facets);
        let (corner, width) = (DVec3::from(origin), f64::from(1u32 << levels));
        let facets: Vec<Polygon> = facets.iter().filter_map(|f| f.clip(corner, corner + width)).collect();
        count(levels, corner, &facets)
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

/// Finest voxels and nodes in a cube.
fn count(levels: usize, corner: DVec3, polygons: &[Polygon]) -> [u64; 2] {
    if polygons.is_empty() {
        return [0, 0];
    }
    if levels == 0 {
        return [1, 1];
    }
    let half = f64::from(1u32 << (levels - 1));
    let mut octants: [Vec<Polygon>; 8] = Default::default();
    for polygon in polygons {
        polygon.split_octants(corner + half, &mut octants);
    }
    let mut sum = [0, 1];
    for (j, octant) in octants.iter().enumerate() {
        let at = corner + half * DVec3::new((j & 1) as f64, (j >> 1 & 1) as f64, (j >> 2) as f64);
        let inner = count(levels - 1, at, octant);
        sum = [sum[0] + inner[0], sum[1] + inner[1]];
    }
    sum
}
