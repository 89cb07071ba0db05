//! Error of the fitted coverage: marched blocks against the line masks that were measured.

use super::block_lines::{BlockLineValues, TILE_LINES, axis_lines};
use super::group_transmittance::{GroupTransmittance, ONE};
use super::line_mask::LineMask;
use crate::geom::larger;
use crate::geom::projection::{PROJECTIONS, SQUARE_LINES, squares_before};
use crate::simd::multiversioned;

/// Transmittance above which a square counts as empty.
const EMPTY_TRANSMITTANCE: f32 = 0.999;
/// Errors are summed as whole numbers of units of 1 / [`UNITS`], so that the sum does not depend on the order in which regions are
/// joined. A u64 holds the sum of 2^40 errors.
const UNITS: f32 = 16_777_216.0;
/// Number of bins of the errors' histogram, from 0 to 1.
const BINS: usize = 256;

/// Most squares of a block along all axes.
const MAX_SQUARES: usize = size_of::<BlockLineValues>() / size_of::<[f32; TILE_LINES]>();
/// Errors of a block's squares, one voxel wide, axis by axis: |marched − measured| of the share that is covered; −1 for squares in
/// which there is no matter, and beyond the block's own number of squares.
pub type SquareErrors = [f32; MAX_SQUARES];

/// Compare the marched coverage of a block with its line mask.
#[inline(always)]
pub fn square_errors(block: &GroupTransmittance, mask: &LineMask) -> SquareErrors {
    let mut errors = [-1.0; MAX_SQUARES];
    let square = block.lines * block.lines / TILE_LINES;
    for (k, p) in PROJECTIONS.iter().enumerate() {
        let counts = mask.square_counts(k);
        let errors = &mut errors[squares_before(k) * square..squares_before(k + 1) * square];
        // Blocks have two lines per voxel edge, and are 4, 2 or 1 voxels wide.
        match (block.lines, p.extent().0) {
            (8, 1) => axis_errors::<1, 4>(block, k, &counts, errors),
            (8, _) => axis_errors::<1, 8>(block, k, &counts, errors),
            (4, 1) => axis_errors::<2, 2>(block, k, &counts, errors),
            (4, _) => axis_errors::<2, 4>(block, k, &counts, errors),
            (_, 1) => axis_errors::<4, 1>(block, k, &counts, errors),
            _ => axis_errors::<4, 2>(block, k, &counts, errors),
        }
    }
    errors
}

/// Errors along the axis `k`, where a row has `ROW` voxels, each as wide as `SQUARES_PER_VOXEL` squares of the `counts`.
#[inline(always)]
fn axis_errors<const SQUARES_PER_VOXEL: usize, const ROW: usize>(
    block: &GroupTransmittance,
    k: usize,
    counts: &[[u8; 8]; 8],
    errors: &mut [f32],
) {
    let tiles = block.at[0][axis_lines(k, block.lines)].as_chunks::<TILE_LINES>().0.as_chunks::<ROW>().0;
    let counts = counts.as_chunks::<SQUARES_PER_VOXEL>().0;
    for ((tiles, counts), errors) in tiles.iter().zip(counts).zip(errors.as_chunks_mut::<ROW>().0) {
        let (mut transmittance, mut lines) = ([0.0f32; ROW], [0.0f32; ROW]);
        for i in 0..ROW {
            let [a, b, c, d] = tiles[i].map(u32::from);
            transmittance[i] = (a + b + c + d) as f32 * (0.25 / ONE as f32);
            for row in counts {
                for n in 0..SQUARES_PER_VOXEL {
                    lines[i] += f32::from(row[i * SQUARES_PER_VOXEL + n]);
                }
            }
        }
        let most = (SQUARES_PER_VOXEL * SQUARES_PER_VOXEL * SQUARE_LINES * SQUARE_LINES) as f32;
        for i in 0..ROW {
            let error = (1.0 - transmittance[i] - lines[i] / most).abs();
            errors[i] = if lines[i] > 0.0 || transmittance[i] < EMPTY_TRANSMITTANCE { error } else { -1.0 };
        }
    }
}

/// Distribution of the errors of all squares in which there is matter.
#[derive(Debug, Clone, Default)]
pub struct CoverageError {
    count: u64,
    /// Sum of the errors, in units of 1 / [`UNITS`].
    sum: u64,
    /// Number of squares by error, and in the last bin of those without matter. Each bin has four counters that are used in turn:
    /// many successive squares fall into one bin, and incrementing one counter again would wait for the previous store.
    histogram: Vec<[u64; 4]>,
}

impl CoverageError {
    /// Add the errors of a block.
    pub fn add(&mut self, errors: &SquareErrors) {
        add(self, errors);
    }

    /// Add all errors of `other`.
    pub fn merge(&mut self, other: &CoverageError) {
        self.count += other.count;
        self.sum += other.sum;
        self.histogram.resize(BINS + 2, [0; 4]);
        for (mine, theirs) in self.histogram.iter_mut().zip(&other.histogram) {
            for n in 0..4 {
                mine[n] += theirs[n];
            }
        }
    }

    /// Mean and 95th percentile; `None` where nothing was measured.
    pub fn mean_p95(&self) -> Option<(f64, f64)> {
        if self.count == 0 {
            return None;
        }
        let mean = self.sum as f64 / f64::from(UNITS) / self.count as f64;
        let mut left = self.count - self.count * 95 / 100;
        for (bin, counts) in self.histogram.iter().enumerate().take(BINS + 1).rev() {
            let n = counts.iter().sum::<u64>();
            if n >= left {
                return Some((mean, (bin as f64 + 0.5) / BINS as f64));
            }
            left -= n;
        }
        Some((mean, 0.0))
    }
}

multiversioned! {
    fn add(to: &mut CoverageError, errors: &SquareErrors) = add_squares;
}

#[inline(always)]
fn add_squares(to: &mut CoverageError, errors: &SquareErrors) {
    to.histogram.resize(BINS + 2, [0; 4]);
    let (mut sums, mut counts) = ([0u32; 16], [0u32; 16]);
    for errors in errors.as_chunks::<16>().0 {
        let mut bins = [0; 16];
        for n in 0..16 {
            sums[n] += (larger(errors[n], 0.0) * UNITS) as i32 as u32;
            counts[n] += u32::from(errors[n] >= 0.0);
            let bin = (errors[n] * BINS as f32) as i32;
            bins[n] = if errors[n] >= 0.0 { bin.min(BINS as i32) } else { BINS as i32 + 1 };
        }
        for n in 0..16 {
            if let Some(counts) = to.histogram.get_mut(bins[n] as usize) {
                counts[n % 4] += 1;
            }
        }
    }
    for n in 0..16 {
        to.count += u64::from(counts[n]);
        to.sum += u64::from(sums[n]);
    }
}
