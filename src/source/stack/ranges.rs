//! Minimum and maximum of every small cube of samples, for pruning, and Otsu's threshold from a histogram.
//!
//! Based on: J. Wilhelms, A. Van Gelder, *Octrees for Faster Isosurface Generation*, TOG 1992; N. Otsu, *A Threshold Selection
//! Method from Gray-Level Histograms*, 1979.

use super::samples::Samples;
use crate::par;

/// Number of samples along the edge of a block, whose minimum and maximum are stored.
const BLOCK: usize = 4;
/// Number of cells along the edge of a brick, which is pruned as a whole.
pub const BRICK: usize = 8;
/// Number of bins of the histogram.
const BINS: usize = 4096;
/// Approximate number of samples that the histogram counts.
const HISTOGRAM_SAMPLES: usize = 1 << 23;

/// Minimum and maximum of values; `hi < lo` where there are none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    pub lo: f32,
    pub hi: f32,
}

impl Range {
    const EMPTY: Range = Range { lo: f32::INFINITY, hi: f32::NEG_INFINITY };

    fn add(&mut self, other: Range) {
        self.lo = self.lo.min(other.lo);
        self.hi = self.hi.max(other.hi);
    }
}

/// Ranges of values, by one pass over all samples.
pub struct Scan {
    /// Range of all finite values.
    pub whole: Range,
    /// Number of samples without a value: NaN, infinite, or padding.
    pub missing: u64,
    /// Indices of the blocks that hold such samples.
    with_missing: Vec<usize>,
    /// Range of each block of 4^3 samples, x fastest.
    blocks: Vec<Range>,
    size: [usize; 3],
}

impl Scan {
    pub fn new(samples: &Samples) -> Scan {
        let dims = samples.dims();
        let size = dims.map(|d| d.div_ceil(BLOCK));
        let layers = par::map(size[2], |layer| {
            let mut blocks = vec![Range::EMPTY; size[0] * size[1]];
            let mut row = vec![0.0f32; dims[0]];
            let mut missing = vec![0u64; blocks.len()];
            for k in layer * BLOCK..dims[2].min((layer + 1) * BLOCK) {
                for j in 0..dims[1] {
                    samples.row_with_nan(0, j, k, &mut row);
                    let first = j / BLOCK * size[0];
                    let blocks = blocks[first..].iter_mut().zip(&mut missing[first..]);
                    for ((block, missing), values) in blocks.zip(row.chunks(BLOCK)) {
                        for &v in values {
                            if v.is_finite() {
                                block.add(Range { lo: v, hi: v });
                            } else {
                                *missing += 1;
                            }
                        }
                    }
                }
            }
            (blocks, missing)
        });
        let blocks = Vec::with_capacity(size.iter().product());
        let mut scan = Scan { whole: Range::EMPTY, missing: 0, with_missing: Vec::new(), blocks, size };
        for (blocks, missing) in layers {
            let first = scan.blocks.len();
            scan.blocks.extend(blocks);
            scan.with_missing.extend((first..).zip(&missing).filter(|m| *m.1 > 0).map(|m| m.0));
            scan.missing += missing.iter().sum::<u64>();
        }
        for block in &scan.blocks {
            scan.whole.add(*block);
        }
        scan
    }

    /// Let samples without a value count as `value` in the ranges of their blocks.
    pub fn fill_missing(&mut self, value: f32) {
        for &n in &self.with_missing {
            self.blocks[n].add(Range { lo: value, hi: value });
        }
    }

    /// Range of the values that a filter of `reach` samples can give within each brick of 8^3 cells, x fastest; and the number
    /// of bricks along each axis.
    pub fn bricks(&self, dims: [usize; 3], reach: usize) -> (Vec<Range>, [usize; 3]) {
        let size = dims.map(|d| d.div_ceil(BRICK));
        let layers = par::map(size[2], |z| {
            let span = |u: usize, axis: usize| {
                let last = self.size[axis] - 1;
                let from = (u * BRICK).saturating_sub(reach) / BLOCK;
                // A brick's last cell ends at the first sample of the next.
                from..=((u * BRICK + BRICK + reach) / BLOCK).min(last)
            };
            let mut out = Vec::with_capacity(size[0] * size[1]);
            for y in 0..size[1] {
                for x in 0..size[0] {
                    let mut range = Range::EMPTY;
                    for k in span(z, 2) {
                        for j in span(y, 1) {
                            let row = (k * self.size[1] + j) * self.size[0];
                            span(x, 0).for_each(|i| range.add(self.blocks[row + i]));
                        }
                    }
                    out.push(range);
                }
            }
            out
        });
        (layers.concat(), size)
    }

    /// Otsu's threshold: the value that separates the samples into the two classes with the largest variance between them. Samples
    /// without a value are left out. `None` where all values are the same.
    pub fn otsu(&self, samples: &Samples) -> Option<f32> {
        let (lo, hi) = (f64::from(self.whole.lo), f64::from(self.whole.hi));
        if !(lo < hi && (hi - lo).is_finite()) {
            return None;
        }
        let dims = samples.dims();
        let rows = dims[1] * dims[2];
        let step = (rows * dims[0] / HISTOGRAM_SAMPLES).max(1);
        let scale = BINS as f64 / (hi - lo);
        let mut counts = vec![0u64; BINS];
        let mut row = vec![0.0; dims[0]];
        for n in (0..rows).step_by(step) {
            samples.row_with_nan(0, n % dims[1], n / dims[1], &mut row);
            for &v in row.iter().filter(|v| v.is_finite()) {
                counts[(((f64::from(v) - lo) * scale) as usize).min(BINS - 1)] += 1;
            }
        }
        let total: u64 = counts.iter().sum();
        let weighted: f64 = counts.iter().enumerate().map(|(i, &n)| i as f64 * n as f64).sum();
        let (mut below, mut sum_below) = (0u64, 0.0);
        // First and last threshold of the best separation: no value lies between them.
        let (mut best, mut first, mut last) = (-1.0, 0, 0);
        for (i, &n) in counts[..BINS - 1].iter().enumerate() {
            below += n;
            sum_below += i as f64 * n as f64;
            let above = total - below;
            if below == 0 || above == 0 {
                continue;
            }
            let apart = sum_below / below as f64 - (weighted - sum_below) / above as f64;
            let between = below as f64 * above as f64 * apart * apart;
            if between > best * (1.0 + 1e-12) {
                (best, first, last) = (between, i, i);
            } else if between > best * (1.0 - 1e-12) {
                last = i;
            }
        }
        Some((lo + (0.5 * (first + last) as f64 + 1.0) / scale) as f32)
    }
}
