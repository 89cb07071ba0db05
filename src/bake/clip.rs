//! Cuts facets into voxels, without what their alpha leaves transparent.

use crate::geom::DVec3;
use crate::geom::polygon::{Polygon, VoxelSplit};
use crate::source::{AlphaClass, AlphaSampler, Staged};

use super::alpha_mask::MAX_ALPHA_CELLS;

/// Call `each` for every piece of `facet` in the half-open box `lo..hi` that is not transparent: with the piece, its voxel's
/// lower corner and, where the piece may be transparent in part, the sampler of its alpha.
pub fn for_each_piece(
    staged: &dyn Staged,
    facet: &Polygon,
    lo: DVec3,
    hi: DVec3,
    each: &mut impl FnMut(&Polygon, DVec3, Option<&dyn AlphaSampler>),
) {
    let mut room = None;
    let Some(piece) = facet.clip(lo, hi, &mut room) else { return };
    if !staged.has_alpha(piece.facet) {
        return piece.split_voxels(&mut |piece, at| each(piece, at, None));
    }
    match staged.alpha_sampler(piece.facet) {
        Some(alpha) => split_by_alpha(&*alpha, piece, each),
        None => {
            let alpha = PointSampler { staged, facet: piece.facet };
            piece.split_voxels(&mut |piece, at| each(piece, at, Some(&alpha)));
        }
    }
}

/// [`Polygon::split_voxels`] of the pieces that are not transparent. Bounds on alpha are asked for before every split, so that
/// large parts that are transparent, or opaque, are never cut up with alpha in mind.
fn split_by_alpha(
    alpha: &dyn AlphaSampler,
    piece: &Polygon,
    each: &mut impl FnMut(&Polygon, DVec3, Option<&dyn AlphaSampler>),
) {
    match alpha.classify(piece) {
        AlphaClass::Transparent => {}
        AlphaClass::Opaque => piece.split_voxels(&mut |piece, at| each(piece, at, None)),
        AlphaClass::Mixed => match piece.voxel_split() {
            VoxelSplit::Inside(at) => each(piece, at, Some(alpha)),
            VoxelSplit::Plane { axis, at } => {
                piece.split(axis, at).iter().for_each(|piece| split_by_alpha(alpha, piece, each));
            }
        },
    }
}

/// Alpha of a facet whose source has no sampler: point samples of its surface.
struct PointSampler<'a> {
    staged: &'a dyn Staged,
    facet: u32,
}

impl AlphaSampler for PointSampler<'_> {
    fn classify(&self, _: &Polygon) -> AlphaClass {
        AlphaClass::Mixed
    }

    fn texels_per_voxel(&self) -> f64 {
        MAX_ALPHA_CELLS as f64
    }

    fn sample_row(&self, from: DVec3, step: DVec3, _: f64, alpha: &mut [f32]) {
        for (i, alpha) in alpha.iter_mut().enumerate() {
            *alpha = self.staged.surface(self.facet, from + i as f64 * step, 0.0).alpha;
        }
    }
}
