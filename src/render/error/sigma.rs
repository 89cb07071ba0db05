//! Error of the distribution of normals: projected areas of voxels against those of the facets in them.

use super::ErrorStats;
use crate::geom::directions13;
use crate::volume::{Octree, Sggx};

/// Projected areas of the facets in each voxel along the 13 axes ([`crate::geom::AXES13`]), with the voxel's Morton code;
/// in any one unit.
#[derive(Debug, Clone, Default)]
pub struct ProjectedAreas {
    voxels: Vec<(u64, [f32; 13])>,
}

impl ProjectedAreas {
    /// From pairs of a voxel's Morton code and its areas, in any order; those of one voxel are added.
    pub fn new(mut voxels: Vec<(u64, [f32; 13])>) -> ProjectedAreas {
        voxels.sort_by_key(|v| v.0);
        ProjectedAreas { voxels }.merged()
    }

    fn merged(mut self) -> ProjectedAreas {
        self.voxels.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            if same {
                kept.1.iter_mut().zip(next.1).for_each(|(sum, area)| *sum += area);
            }
            same
        });
        self
    }

    /// Areas of the voxels twice as wide.
    pub fn coarser(mut self) -> ProjectedAreas {
        self.voxels.iter_mut().for_each(|v| v.0 >>= 3);
        self.merged()
    }
}

/// Error over the voxels of `depth` that hold facets: the sum over 13 axes of |projected area of the normals − of the facets|, each
/// relative to its own sum over the axes. The bias is 0.
pub fn compare(tree: &Octree, depth: usize, areas: &ProjectedAreas) -> ErrorStats {
    let axes = directions13().map(|w| w.as_vec3());
    let errors = areas.voxels.iter().filter_map(|(code, truth)| {
        let voxel = tree.voxel(tree.find(depth, *code)?);
        let normals = Sggx::decode(voxel.ndf);
        let own = axes.map(|w| f64::from(normals.sigma(w)));
        let truth = truth.map(f64::from);
        let (all, all_truth) = (own.iter().sum::<f64>(), truth.iter().sum::<f64>());
        if !(all > 0.0 && all_truth > 0.0) {
            return None;
        }
        Some((own.iter().zip(&truth).map(|(a, b)| (a / all - b / all_truth).abs()).sum::<f64>(), 1.0))
    });
    ErrorStats { bias: 0.0, ..ErrorStats::of(errors.collect()) }
}
