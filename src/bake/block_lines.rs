//! March of a block along a lattice of lines of all 13 axes while it is fitted: chords, optical depths and opacities.
//!
//! The law is that of [`crate::volume::opacity`], as in the renderer's march, but written for many parallel lines at once. A
//! voxel has so few lines that all of them are kept, also those that miss its support box: then every number of lines is a
//! constant, and the compiler turns the loops into SIMD code. In a projection plane, lines are ordered by tiles (squares one
//! voxel wide with four lines each), row of tiles by row of tiles.

use std::ops::Range;

use crate::geom::axis_length;
use crate::geom::projection::{COORDINATES, PROJECTIONS, Projection, coordinate, squares_before};
use crate::geom::{Vec3, larger, smaller};
use crate::volume::chord::{Lanes, exp_neg, sum};

/// Number of marched lines per voxel edge.
pub const MARCH_LINES: usize = 2;
/// Number of lines of a tile, a square one voxel wide.
pub const TILE_LINES: usize = MARCH_LINES * MARCH_LINES;
/// Number of lines along an edge of a voxel's widest projection.
const MAX_ROW_LINES: usize = 2 * MARCH_LINES;
/// Number of a voxel's lines along all axes, rounded up to whole SIMD vectors of eight.
const VOXEL_LINES: usize = (squares_before(13) * TILE_LINES).next_multiple_of(8);
/// Number of lines along all axes of the widest block, four voxels per edge.
const MAX_BLOCK_LINES: usize = squares_before(13) * TILE_LINES * 16;

/// One value per line of a block, axis by axis.
pub type BlockLineValues = [f32; MAX_BLOCK_LINES];

/// Range of the axis `k` among a voxel's lines. The narrow projections, of four lines, come last: all others then fill whole vectors
/// of eight. A processor stalls when it loads a vector that was stored in parts.
const fn voxel_lines(k: usize) -> Range<usize> {
    const NARROW: usize = squares_before(3);
    let first = if k < 3 { squares_before(13) - NARROW + k } else { squares_before(k) - NARROW };
    first * TILE_LINES..(first + squares_before(k + 1) - squares_before(k)) * TILE_LINES
}

/// Range of the axis `k` among the lines of a cube with `lines` lines per edge.
#[inline(always)]
pub fn axis_lines(k: usize, lines: usize) -> Range<usize> {
    squares_before(k) * lines * lines..squares_before(k + 1) * lines * lines
}

/// Column and row of the line `n` in a plane that is `across` lines wide.
pub fn line_position(n: usize, across: usize) -> (usize, usize) {
    let (tile, line, tiles) = (n / TILE_LINES, n % TILE_LINES, across / MARCH_LINES);
    (MARCH_LINES * (tile % tiles) + line % MARCH_LINES, MARCH_LINES * (tile / tiles) + line / MARCH_LINES)
}

/// Call an associated function of [`Axis`] for each axis, so that the axis is a constant in the callee. Compared with a loop over
/// the axes, this saves a fifth of a fit's time.
macro_rules! for_each_axis {
    ($call:ident $args:tt) => {
        for_each_axis!($call $args: 0 1 2 3 4 5 6 7 8 9 10 11 12)
    };
    ($call:ident $args:tt: $($k:literal)*) => {
        { $( Axis::<$k>::$call $args; )* }
    };
}

/// Chords of a block's lines in the support boxes of its voxels.
pub struct BlockLines {
    /// Chords of each voxel's lines, axis by axis as [`voxel_lines`] has them; 0 for lines that miss the support box.
    chords: Vec<[f32; VOXEL_LINES]>,
    /// First line of each voxel, for each axis, among the block's lines.
    firsts: Vec<[u16; 13]>,
    /// Voxels along the block's edge: 1, 2 or 4.
    width: usize,
}

/// Numbers of lines that a block's voxels block, per axis: sums of the lines' opacities.
pub struct BlockedLines {
    /// Sum over the voxels of the numbers that each would block alone.
    pub alone: [f32; 13],
    /// Number that all voxels together block.
    pub together: [f32; 13],
}

impl BlockLines {
    /// Lines of voxels with these positions in the block and these support boxes, lower and upper corner.
    #[inline(always)]
    pub fn new(boxes: impl ExactSizeIterator<Item = ([u8; 3], Vec3, Vec3)>, width: usize) -> BlockLines {
        let mut all =
            BlockLines { chords: Vec::with_capacity(boxes.len()), firsts: Vec::with_capacity(boxes.len()), width };
        for (at, lo, hi) in boxes {
            let mut firsts = [0; 13];
            for_each_axis!(first_line(&mut firsts, at, width));
            all.firsts.push(firsts);
            let (slabs, mut chords) = (Slabs::new(lo, hi), [0.0; VOXEL_LINES]);
            for_each_axis!(find_chords(&mut chords, &slabs));
            all.chords.push(chords);
        }
        all
    }

    /// Optical depths of the block's lines, where the voxels have these `rates` along the axes.
    #[inline(always)]
    pub fn optical_depths(&self, rates: &[Lanes]) -> BlockLineValues {
        let mut depths = [0.0; MAX_BLOCK_LINES];
        for ((chords, firsts), rates) in self.chords.iter().zip(&self.firsts).zip(rates) {
            let mut own = [0.0; VOXEL_LINES];
            for_each_axis!(broadcast(&mut own, rates));
            for n in 0..VOXEL_LINES {
                own[n] *= chords[n];
            }
            for_each_axis!(combine(&mut depths, firsts, self.width, &own, |depth, own| depth + own));
        }
        depths
    }

    /// Lines that the voxels block with these `rates`: with `DISJOINT` at the correlation c = 1, at which pieces of matter never
    /// overlap along a line that is not opaque yet; else at c = 0, at which voxels are independent.
    #[inline(always)]
    pub fn blocked<const DISJOINT: bool>(&self, rates: &[Lanes]) -> BlockedLines {
        // Values of lines are optical depths τ at c = 1, and transmittances e^−τ at c = 0.
        let mut alone = [0.0; VOXEL_LINES];
        let mut lines = [if DISJOINT { 0.0 } else { 1.0 }; MAX_BLOCK_LINES];
        for ((chords, firsts), rates) in self.chords.iter().zip(&self.firsts).zip(rates) {
            let mut own = [0.0; VOXEL_LINES];
            for_each_axis!(broadcast(&mut own, rates));
            for n in 0..VOXEL_LINES {
                let depth = own[n] * chords[n];
                own[n] = if DISJOINT { depth } else { exp_neg(depth) };
            }
            for n in 0..VOXEL_LINES {
                alone[n] += line_opacity::<DISJOINT>(own[n]);
            }
            let both = |all, own| if DISJOINT { all + own } else { all * own };
            for_each_axis!(combine(&mut lines, firsts, self.width, &own, both));
        }
        let mut blocked = BlockedLines { alone: [0.0; 13], together: [0.0; 13] };
        for k in 0..13 {
            blocked.alone[k] = sum(&alone[voxel_lines(k)], |opacity| opacity);
            blocked.together[k] = sum(&lines[axis_lines(k, MARCH_LINES * self.width)], line_opacity::<DISJOINT>);
        }
        blocked
    }
}

/// Axis `K` and the layout of a voxel's lines along it.
struct Axis<const K: usize>;

impl<const K: usize> Axis<K> {
    const PROJECTION: Projection = PROJECTIONS[K];
    /// Number of tiles in a row, and of rows of tiles.
    const ACROSS: usize = Self::PROJECTION.extent().0;
    const ROWS: usize = Self::PROJECTION.extent().1;
    const LENGTH: f32 = axis_length(K) as f32;

    /// First line of the voxel at `at` in a block of this `width`, into `firsts`.
    #[inline(always)]
    fn first_line(firsts: &mut [u16; 13], at: [u8; 3], width: usize) {
        let (oa, ob) = Self::PROJECTION.cell_origin(at, width);
        // Below MAX_BLOCK_LINES, which fits 16 bits.
        firsts[K] = (TILE_LINES * (squares_before(K) * width * width + ob * Self::ACROSS * width + oa)) as u16;
    }

    /// Chords of a voxel's lines, into `chords`.
    #[inline(always)]
    fn find_chords(chords: &mut [f32; VOXEL_LINES], slabs: &Slabs) {
        for row in 0..Self::ROWS {
            let first = voxel_lines(K).start + TILE_LINES * Self::ACROSS * row;
            match Self::ACROSS {
                1 => chords[first..first + 4].copy_from_slice(&slabs.chords::<4>(&Self::PROJECTION, row, Self::LENGTH)),
                _ => chords[first..first + 8].copy_from_slice(&slabs.chords::<8>(&Self::PROJECTION, row, Self::LENGTH)),
            }
        }
    }

    /// Fill all lines of the axis with its value.
    #[inline(always)]
    fn broadcast(lines: &mut [f32], axes: &Lanes) {
        lines[voxel_lines(K)].fill(axes[K]);
    }

    /// Combine a voxel's `own` lines with the block's `lines` that they fall on.
    #[inline(always)]
    fn combine(lines: &mut [f32], firsts: &[u16; 13], width: usize, own: &[f32], both: impl Fn(f32, f32) -> f32) {
        for row in 0..Self::ROWS {
            let step = TILE_LINES * Self::ACROSS * row;
            let (lines, own) =
                (&mut lines[usize::from(firsts[K]) + step * width..], &own[voxel_lines(K).start + step..]);
            match Self::ACROSS {
                1 => combine_row::<4>(lines, own, &both),
                _ => combine_row::<8>(lines, own, &both),
            }
        }
    }
}

/// Combine the first `N` of the lines `own` with the first of `lines`.
#[inline(always)]
fn combine_row<const N: usize>(lines: &mut [f32], own: &[f32], both: &impl Fn(f32, f32) -> f32) {
    let (Some(lines), Some(own)) = (lines.first_chunk_mut::<N>(), own.first_chunk::<N>()) else { return };
    // The result is a new array, so that the compiler need not assume that it overlaps an operand.
    let mut all = [0.0; N];
    for n in 0..N {
        all[n] = both(lines[n], own[n]);
    }
    *lines = all;
}

/// Opacity of a line, from the value that [`BlockLines::blocked`] keeps of it.
#[inline(always)]
fn line_opacity<const DISJOINT: bool>(value: f32) -> f32 {
    if DISJOINT { smaller(value, 1.0) } else { 1.0 - value }
}

/// Intervals of the dropped coordinate in which a voxel's lines are within a box's slabs, for each plane coordinate. Empty intervals
/// end before they begin.
struct Slabs {
    from: [[f32; MAX_ROW_LINES]; COORDINATES],
    to: [[f32; MAX_ROW_LINES]; COORDINATES],
    lo: Vec3,
    hi: Vec3,
}

impl Slabs {
    #[inline(always)]
    fn new(lo: Vec3, hi: Vec3) -> Slabs {
        const AT: [f32; MAX_ROW_LINES] = [0.25, 0.75, 1.25, 1.75];
        let (inf, none) = (f32::INFINITY, f32::NEG_INFINITY);
        let mut slabs =
            Slabs { from: [[inf; MAX_ROW_LINES]; COORDINATES], to: [[none; MAX_ROW_LINES]; COORDINATES], lo, hi };
        for q in 0..3 {
            for i in 0..MAX_ROW_LINES {
                let within = AT[i] >= lo[q] && AT[i] < hi[q];
                slabs.from[q][i] = if within { none } else { inf };
                slabs.to[q][i] = if within { inf } else { none };
            }
        }
        for (drop, q) in [(0, 1), (0, 2), (1, 2)] {
            let on = coordinate(q, 1, drop);
            for i in 0..MAX_ROW_LINES {
                // q = v + s d, where v begins at −1 for s = 1.
                let v = AT[i] - 1.0;
                (slabs.from[on][i], slabs.to[on][i]) = (lo[q] - v, hi[q] - v);
                let v = AT[i];
                (slabs.from[on + 1][i], slabs.to[on + 1][i]) = (v - hi[q], v - lo[q]);
            }
        }
        slabs
    }

    /// Chords of the `N` lines of a row of tiles in the plane `p`, along an axis of this `length`.
    #[inline(always)]
    fn chords<const N: usize>(&self, p: &Projection, row: usize, length: f32) -> [f32; N] {
        let [a, b] = p.coordinates;
        let (lo, hi) = (self.lo[p.drop], self.hi[p.drop]);
        let (from_a, to_a) = (columns::<N>(&self.from[a]), columns::<N>(&self.to[a]));
        let (from_b, to_b) = (rows::<N>(&self.from[b], row), rows::<N>(&self.to[b], row));
        let mut chords = [0.0; N];
        for n in 0..N {
            let from = larger(larger(from_a[n], from_b[n]), lo);
            let to = smaller(smaller(to_a[n], to_b[n]), hi);
            chords[n] = larger(to - from, 0.0) * length;
        }
        chords
    }
}

/// Values of the columns, for each line of a row of tiles.
#[inline(always)]
fn columns<const N: usize>(of: &[f32; MAX_ROW_LINES]) -> [f32; N] {
    let mut lines = [0.0; N];
    for n in 0..N {
        lines[n] = of[n / TILE_LINES * MARCH_LINES + n % MARCH_LINES];
    }
    lines
}

/// Values of the rows, for each line of the row `row` of tiles.
#[inline(always)]
fn rows<const N: usize>(of: &[f32; MAX_ROW_LINES], row: usize) -> [f32; N] {
    let mut lines = [0.0; N];
    for n in 0..N {
        lines[n] = of[(row * MARCH_LINES + n % TILE_LINES / MARCH_LINES) % MAX_ROW_LINES];
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::projection::crossing;

    #[test]
    fn optical_depths_are_chords_times_rates() {
        let (lo, hi) = (Vec3::new(0.125, 0.0, 0.25), Vec3::new(0.875, 0.6875, 1.0));
        for (width, at) in [(4u8, [3u8, 1, 2]), (2, [1, 0, 1]), (1, [0, 0, 0])] {
            let wide = usize::from(width);
            let lines = BlockLines::new([(at, lo, hi)].into_iter(), wide);
            let corner = Vec3::from(at.map(f32::from));
            let (lo, hi) = ((corner + lo) / f32::from(width), (corner + hi) / f32::from(width));
            let depths = lines.optical_depths(&[[2.0; 16]]);
            let trials = [lines.blocked::<false>(&[[2.0; 16]]), lines.blocked::<true>(&[[2.0; 16]])];
            for (k, p) in PROJECTIONS.iter().enumerate() {
                let (across, _) = p.extent();
                let edge = wide * MARCH_LINES;
                let (mut full, mut none) = (0.0, 0.0);
                for (n, &depth) in depths[axis_lines(k, edge)].iter().enumerate() {
                    let middle = |i: usize| (i as f64 + 0.5) / edge as f64;
                    let (x, y) = line_position(n, across * edge);
                    let (x, y) = (middle(x), middle(y));
                    let met = crossing(k, x, y, lo.as_dvec3(), hi.as_dvec3()).map_or(0.0, |(from, to)| to - from);
                    let want = 2.0 * met * axis_length(k) * f64::from(width);
                    // A few roundings of numbers of up to 8, in f32.
                    assert!((f64::from(depth) - want).abs() < 1e-5, "{width} {k} {n}: {depth} {want}");
                    full += want.min(1.0);
                    none += 1.0 - (-want).exp();
                }
                // Sums of at most 256 of them; exp_neg is right to 1e-5.
                for (trial, want) in trials.iter().zip([none, full]) {
                    let (alone, together) = (trial.alone[k], trial.together[k]);
                    assert!((f64::from(alone) - want).abs() < 1e-3, "{width} {k}: {alone} {want}");
                    assert!((alone - together).abs() < 1e-4, "one voxel hides nothing");
                }
            }
        }
    }
}
