//! Choice of a block's correlation: the one with which the share of the cells' coverage that other cells of the block hide is nearest
//! to the measured share.
//!
//! Based on: D. Vicini, W. Jakob, A. Kaplanyan, *A Non-Exponential Transmittance Model for Volumetric Scene Representations*,
//! SIGGRAPH 2021 (transmittance between exponential and linear).

use super::block_lines::{BlockLines, BlockedLines};
use super::measure::Measure;
use super::projected_cell::{Cell, ProjectedCell};
use crate::volume::chord::{LENGTHS, Lanes, optical_depth_of};

/// Code of full correlation.
const MAX_CODE: u8 = 15;
/// Linear model of the hidden share at c = 1/2, as a fraction of the way from that at c = 1 to that at c = 0: a constant, and factors
/// of the hidden shares at c = 0 and at c = 1. It was found by least squares over the blocks of four texels (a nut, a wall, fur, a
/// tree; 64³). Its RMS error is .005 of the covered area, so a third march at c = 1/2 gives nothing more.
const MIDDLE_MODEL: [f32; 3] = [0.21, 1.6, -2.22];

/// Share of the cells' summed coverage that other cells hide, along each axis, as it was measured and as it is marched.
struct HiddenShares {
    measured: Lanes,
    /// At c = 1, where cells hide each other least.
    at_one: Lanes,
    /// Excess of the hidden share at c = 0 over that at c = 1.
    excess: Lanes,
    /// Fraction of `excess` by which the hidden share at c = 1/2 exceeds that at c = 1.
    middle: Lanes,
    /// Area that the cells cover one by one.
    weight: Lanes,
}

/// Code, 0 … 15 for c = 0 … 1, of the correlation of a block that is `width` cells wide and measured by `block`: the least squares
/// over the 13 axes of the hidden area, marched less measured.
#[inline(always)]
pub fn choose_correlation(
    cells: &[Cell],
    projected: &[ProjectedCell],
    lines: &BlockLines,
    block: &Measure,
    width: usize,
) -> u8 {
    if cells.len() < 2 {
        return MAX_CODE;
    }
    let hidden = hidden_shares(cells, projected, lines, block, width);
    let (mut best, mut least) = (0, f32::INFINITY);
    for code in 0..=MAX_CODE {
        let c = f32::from(code) / f32::from(MAX_CODE);
        // Lagrange's parabola through the hidden shares at 0, 1/2 and 1.
        let (first, second) = ((1.0 - c) * (1.0 - 2.0 * c), 4.0 * c * (1.0 - c));
        let mut squares = [0.0f32; 16];
        for k in 0..16 {
            let marched = hidden.at_one[k] + hidden.excess[k] * (first + second * hidden.middle[k]);
            let miss = hidden.weight[k] * (marched - hidden.measured[k]);
            squares[k] = miss * miss;
        }
        let error = squares.iter().sum();
        if error < least {
            (best, least) = (code, error);
        }
    }
    best
}

/// Hidden shares of a block along each axis, from its measurements and from two marches.
#[inline(always)]
fn hidden_shares(
    cells: &[Cell],
    projected: &[ProjectedCell],
    lines: &BlockLines,
    block: &Measure,
    width: usize,
) -> HiddenShares {
    let (independent, correlated) = (march_cells::<false>(projected, lines), march_cells::<true>(projected, lines));
    // Sum over the cells of what each covers alone.
    let mut sums = [0.0; 13];
    for cell in cells {
        for k in 0..13 {
            sums[k] += cell.measure.cover[k];
        }
    }
    let zero = [0.0f32; 16];
    let mut hidden = HiddenShares { measured: zero, at_one: zero, excess: zero, middle: zero, weight: zero };
    for k in 0..13 {
        if sums[k] <= 0.0 {
            continue;
        }
        let measured = (1.0 - (width * width) as f64 * block.cover[k] / sums[k]).clamp(0.0, 1.0) as f32;
        let marched = |lines: &BlockedLines| {
            if lines.alone[k] > 0.0 { 1.0 - lines.together[k] / lines.alone[k] } else { measured }
        };
        let (at_zero, at_one) = (marched(&independent), marched(&correlated));
        hidden.measured[k] = measured;
        hidden.at_one[k] = at_one;
        hidden.excess[k] = at_zero - at_one;
        hidden.middle[k] = MIDDLE_MODEL[0] + MIDDLE_MODEL[1] * at_zero + MIDDLE_MODEL[2] * at_one;
        hidden.weight[k] = sums[k] as f32 / LENGTHS[k];
    }
    hidden
}

/// Lines that the cells block at c = 0, or with `DISJOINT` at c = 1, where matter never overlaps. The rates are those of the mean
/// chord, which is enough since the hidden share hardly depends on them.
#[inline(always)]
fn march_cells<const DISJOINT: bool>(projected: &[ProjectedCell], lines: &BlockLines) -> BlockedLines {
    let mut rates = Vec::with_capacity(projected.len());
    for cell in projected {
        let mut own = [0.0; 16];
        for k in 0..16 {
            own[k] = cell.rounded.chords.inverse_mean[k]
                * optical_depth_of(cell.rounded.opacity[k], if DISJOINT { 1.0 } else { 0.0 });
        }
        rates.push(own);
    }
    lines.blocked::<DISJOINT>(&rates)
}
