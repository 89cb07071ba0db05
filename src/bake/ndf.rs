//! Fit of each cell's normal distribution to the rates that its opacities ask for.
//!
//! Based on: E. Heitz, J. Dupuy, C. Crassin, C. Dachsbacher, *The SGGX Microflake Distribution*, SIGGRAPH 2015; iteratively
//! reweighted least squares (P. Huber, *Robust Estimation of a Location Parameter*, Ann. Math. Stat. 35, 1964).

use super::ellipsoid::{BATCH, fit_weighted, sigmas};
use super::projected_cell::ProjectedCell;
use crate::volume::Sggx;
use crate::volume::chord::{Lanes, OPAQUE};

/// Number of fits with relaxed weights after the first fit.
const REWEIGHT_ITERATIONS: usize = 3;
/// Factor above its target from which on the rate of an opaque axis is larger than asked for.
const SLACK_FACTOR: f32 = 1.02;
/// Factor of the weight of such an axis in the next fit.
const SLACK_WEIGHT: f32 = 1e-4;

/// Rates that a cell's SGGX matrix is fitted to, and the matrix.
pub struct FitTarget {
    /// Index of the cell in its block.
    pub cell: usize,
    /// Rates along the axes, hits per voxel edge.
    pub rates: Lanes,
    /// Weight in [0, 1] of an error of each rate.
    pub weights: Lanes,
    /// Matrix S with √(w^T S w) nearest to the rates; `None` before the fit and where all rates are 0.
    pub ndf: Option<Sggx>,
}

/// Find the matrices whose rates are nearest to the targets. Along axes where a cell is opaque the rate may exceed its target
/// without harm, so such axes hardly count once they do.
#[inline(always)]
pub fn solve_ndfs(targets: &mut [FitTarget], projected: &[ProjectedCell]) {
    let mut left: Vec<usize> = (0..targets.len()).collect();
    let mut relaxed_weights: Vec<Lanes> = targets.iter().map(|t| t.weights).collect();
    for iteration in 0..=REWEIGHT_ITERATIONS {
        for batch in left.chunks(BATCH) {
            // A batch that is not full is filled up with rates of 0, which have no fit.
            let (mut rates, mut weights) = ([[0.0; 16]; BATCH], [[0.0; 16]; BATCH]);
            for (n, &i) in batch.iter().enumerate() {
                (rates[n], weights[n]) = (targets[i].rates, relaxed_weights[i]);
            }
            for (&i, ndf) in batch.iter().zip(fit_weighted(&rates, &weights)) {
                targets[i].ndf = ndf;
            }
        }
        if iteration == REWEIGHT_ITERATIONS {
            return;
        }
        // Cells with a slack axis are fitted once more.
        let mut again = Vec::with_capacity(left.len());
        for i in left {
            let FitTarget { cell, rates, weights, ndf } = &targets[i];
            let Some(s) = ndf else { continue };
            let (sigma, opacity) = (sigmas(s), &projected[*cell].unrounded.opacity);
            relaxed_weights[i] = *weights;
            let mut any = false;
            for k in 0..13 {
                let slack = opacity[k] >= OPAQUE && sigma[k] > SLACK_FACTOR * rates[k];
                relaxed_weights[i][k] *= if slack { SLACK_WEIGHT } else { 1.0 };
                any |= slack;
            }
            if any {
                again.push(i);
            }
        }
        left = again;
    }
}
