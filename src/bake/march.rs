//! The lines, along all axes, on which a block is marched while it is fitted, and what its voxels' boxes put in their way.
//!
//! A voxel's own lines are so few that all of them are kept, also those that miss its box: their numbers are fixed, and many are
//! handled at once. In a plane they are ordered by tiles, squares one voxel wide with four lines each, row by row.

use std::ops::Range;

use crate::geom::axis_length;
use crate::geom::projection::{COORDINATES, PROJECTIONS, Projection, coordinate, planes_before};
use crate::geom::{Vec3, larger, smaller};
use crate::volume::chord::{Lanes, exp_neg, sum};

/// Lines a voxel edge.
pub const MARCH_LINES: usize = 2;
/// Lines of a tile, a square one voxel wide.
pub const TILE: usize = MARCH_LINES * MARCH_LINES;
/// Lines along an edge of the widest plane that a voxel has.
const WIDE: usize = 2 * MARCH_LINES;
/// Room for a voxel's lines along all axes, of which eight at a time are handled.
const ROOM: usize = (planes_before(13) * TILE).next_multiple_of(8);
/// Most lines along all axes of a block, which is four voxels wide.
const MOST_LINES: usize = planes_before(13) * TILE * 16;

/// Values of all lines of a block, axis by axis.
pub type OfBlock = [f32; MOST_LINES];

/// Where the lines of the axis `k` are among a voxel's own: the narrow planes, which have four, come last, so that the eight that
/// are handled at once are written at once before. A processor waits where what it reads was written in parts.
const fn own(k: usize) -> Range<usize> {
    const NARROW: usize = planes_before(3);
    let first = if k < 3 { planes_before(13) - NARROW + k } else { planes_before(k) - NARROW };
    first * TILE..(first + planes_before(k + 1) - planes_before(k)) * TILE
}

/// Where the lines of the axis `k` are among those of a cube with `lines` an edge.
#[inline(always)]
pub fn of_axis(k: usize, lines: usize) -> Range<usize> {
    planes_before(k) * lines * lines..planes_before(k + 1) * lines * lines
}

/// Column and row of the line `n` in a plane that is `across` lines wide.
pub fn line_at(n: usize, across: usize) -> (usize, usize) {
    let (tile, line, tiles) = (n / TILE, n % TILE, across / MARCH_LINES);
    (MARCH_LINES * (tile % tiles) + line % MARCH_LINES, MARCH_LINES * (tile / tiles) + line / MARCH_LINES)
}

/// Call a function of [`Axis`] for each of the axes, all numbers of which the compiler then knows: a fifth of a fit's time.
macro_rules! all_axes {
    ($call:ident $args:tt) => {
        all_axes!($call $args: 0 1 2 3 4 5 6 7 8 9 10 11 12)
    };
    ($call:ident $args:tt: $($k:literal)*) => {
        { $( Axis::<$k>::$call $args; )* }
    };
}

/// Of each voxel of a block the chords, in its support box, of its lines, axis by axis; 0 of those that miss it.
pub struct Lines {
    chords: Vec<[f32; ROOM]>,
    /// Where each voxel's lines of each axis begin among the block's.
    firsts: Vec<[u16; 13]>,
    /// Voxels along the block's edge, at most 4.
    width: usize,
}

/// What a block's voxels block.
pub struct Trial {
    /// Lines that are blocked, an axis: by the voxels one by one, and by all together.
    pub alone: [f32; 13],
    pub together: [f32; 13],
}

impl Lines {
    /// Of voxels with these places in the block and support boxes.
    #[inline(always)]
    pub fn new(boxes: impl ExactSizeIterator<Item = ([u8; 3], Vec3, Vec3)>, width: usize) -> Lines {
        let mut all = Lines { chords: Vec::with_capacity(boxes.len()), firsts: Vec::with_capacity(boxes.len()), width };
        for (at, lo, hi) in boxes {
            let mut firsts = [0; 13];
            all_axes!(place(&mut firsts, at, width));
            all.firsts.push(firsts);
            let (slabs, mut chords) = (Slabs::new(lo, hi), [0.0; ROOM]);
            all_axes!(cross(&mut chords, &slabs));
            all.chords.push(chords);
        }
        all
    }

    /// Their optical depths, where the voxels have these `rates` along the axes.
    #[inline(always)]
    pub fn depths(&self, rates: &[Lanes]) -> OfBlock {
        let mut depths = [0.0; MOST_LINES];
        for ((chords, firsts), rates) in self.chords.iter().zip(&self.firsts).zip(rates) {
            let mut own = [0.0; ROOM];
            all_axes!(fill(&mut own, rates));
            for n in 0..ROOM {
                own[n] *= chords[n];
            }
            all_axes!(lay(&mut depths, firsts, self.width, &own, |depth, own| depth + own));
        }
        depths
    }

    /// What the voxels block with these `rates`: where they are independent, c = 0; or `FULL`y correlated, c = 1, which keeps lines
    /// that are not blocked apart as long as there are any.
    #[inline(always)]
    pub fn blocked<const FULL: bool>(&self, rates: &[Lanes]) -> Trial {
        // Of the voxels' own lines and the block's, T = e^−τ; or at c = 1, τ.
        let mut alone = [0.0; ROOM];
        let mut lines = [if FULL { 0.0 } else { 1.0 }; MOST_LINES];
        for ((chords, firsts), rates) in self.chords.iter().zip(&self.firsts).zip(rates) {
            let mut own = [0.0; ROOM];
            all_axes!(fill(&mut own, rates));
            for n in 0..ROOM {
                let depth = own[n] * chords[n];
                own[n] = if FULL { depth } else { exp_neg(depth) };
            }
            for n in 0..ROOM {
                alone[n] += share::<FULL>(own[n]);
            }
            let both = |all, own| if FULL { all + own } else { all * own };
            all_axes!(lay(&mut lines, firsts, self.width, &own, both));
        }
        let mut trial = Trial { alone: [0.0; 13], together: [0.0; 13] };
        for k in 0..13 {
            trial.alone[k] = sum(&alone[own(k)], |share| share);
            trial.together[k] = sum(&lines[of_axis(k, MARCH_LINES * self.width)], share::<FULL>);
        }
        trial
    }
}

/// The axis `K`, with what a voxel has of it.
struct Axis<const K: usize>;

impl<const K: usize> Axis<K> {
    const AT: Projection = PROJECTIONS[K];
    /// Tiles in a row, and rows.
    const ACROSS: usize = Self::AT.extent().0;
    const ROWS: usize = Self::AT.extent().1;
    const LENGTH: f32 = axis_length(K) as f32;

    /// Where the lines of the voxel at `at` begin in a block of this `width`.
    #[inline(always)]
    fn place(firsts: &mut [u16; 13], at: [u8; 3], width: usize) {
        let (oa, ob) = Self::AT.place(at, width);
        // Below MOST_LINES.
        firsts[K] = (TILE * (planes_before(K) * width * width + ob * Self::ACROSS * width + oa)) as u16;
    }

    /// The chords of a voxel's lines.
    #[inline(always)]
    fn cross(chords: &mut [f32; ROOM], slabs: &Slabs) {
        for row in 0..Self::ROWS {
            let first = own(K).start + TILE * Self::ACROSS * row;
            match Self::ACROSS {
                1 => chords[first..first + 4].copy_from_slice(&slabs.chords::<4>(&Self::AT, row, Self::LENGTH)),
                _ => chords[first..first + 8].copy_from_slice(&slabs.chords::<8>(&Self::AT, row, Self::LENGTH)),
            }
        }
    }

    /// What is known of the axis, for each of its lines.
    #[inline(always)]
    fn fill(lines: &mut [f32], axes: &Lanes) {
        lines[own(K)].fill(axes[K]);
    }

    /// Lay a voxel's `own` lines over the block's from the `firsts` on.
    #[inline(always)]
    fn lay(lines: &mut [f32], firsts: &[u16; 13], width: usize, own: &[f32], both: impl Fn(f32, f32) -> f32) {
        for row in 0..Self::ROWS {
            let step = TILE * Self::ACROSS * row;
            let (lines, own) = (&mut lines[usize::from(firsts[K]) + step * width..], &own[self::own(K).start + step..]);
            match Self::ACROSS {
                1 => lay_row::<4>(lines, own, &both),
                _ => lay_row::<8>(lines, own, &both),
            }
        }
    }
}

/// Lay the first `N` of the lines `own` over the first of `lines`.
#[inline(always)]
fn lay_row<const N: usize>(lines: &mut [f32], own: &[f32], both: &impl Fn(f32, f32) -> f32) {
    let (Some(lines), Some(own)) = (lines.first_chunk_mut::<N>(), own.first_chunk::<N>()) else { return };
    // Apart, so that the compiler need not fear that one is the other.
    let mut all = [0.0; N];
    for n in 0..N {
        all[n] = both(lines[n], own[n]);
    }
    *lines = all;
}

/// The share that is blocked of a line, by what [`Lines::blocked`] keeps of it.
#[inline(always)]
fn share<const FULL: bool>(of: f32) -> f32 {
    if FULL { smaller(of, 1.0) } else { 1.0 - of }
}

/// Where a voxel's lines are within a box in each of the planes' coordinates, by the dropped coordinate; empty stretches end
/// before they begin.
struct Slabs {
    from: [[f32; WIDE]; COORDINATES],
    to: [[f32; WIDE]; COORDINATES],
    lo: Vec3,
    hi: Vec3,
}

impl Slabs {
    #[inline(always)]
    fn new(lo: Vec3, hi: Vec3) -> Slabs {
        const AT: [f32; WIDE] = [0.25, 0.75, 1.25, 1.75];
        let (inf, none) = (f32::INFINITY, f32::NEG_INFINITY);
        let mut slabs = Slabs { from: [[inf; WIDE]; COORDINATES], to: [[none; WIDE]; COORDINATES], lo, hi };
        for q in 0..3 {
            for i in 0..WIDE {
                let within = AT[i] >= lo[q] && AT[i] < hi[q];
                slabs.from[q][i] = if within { none } else { inf };
                slabs.to[q][i] = if within { inf } else { none };
            }
        }
        for (drop, q) in [(0, 1), (0, 2), (1, 2)] {
            let on = coordinate(q, 1, drop);
            for i in 0..WIDE {
                // q = v + s d, where v begins at −1 for s = 1.
                let v = AT[i] - 1.0;
                (slabs.from[on][i], slabs.to[on][i]) = (lo[q] - v, hi[q] - v);
                let v = AT[i];
                (slabs.from[on + 1][i], slabs.to[on + 1][i]) = (v - hi[q], v - lo[q]);
            }
        }
        slabs
    }

    /// The chords of the `N` lines of a row of tiles in the plane `p`, along an axis of this `length`.
    #[inline(always)]
    fn chords<const N: usize>(&self, p: &Projection, row: usize, length: f32) -> [f32; N] {
        let [a, b] = p.on;
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

/// What is known of columns, for each line of a row of tiles.
#[inline(always)]
fn columns<const N: usize>(of: &[f32; WIDE]) -> [f32; N] {
    let mut lines = [0.0; N];
    for n in 0..N {
        lines[n] = of[n / TILE * MARCH_LINES + n % MARCH_LINES];
    }
    lines
}

/// What is known of rows, for each line of the row `row` of tiles.
#[inline(always)]
fn rows<const N: usize>(of: &[f32; WIDE], row: usize) -> [f32; N] {
    let mut lines = [0.0; N];
    for n in 0..N {
        lines[n] = of[(row * MARCH_LINES + n % TILE / MARCH_LINES) % WIDE];
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::projection::crossing;

    #[test]
    fn depths_are_those_of_lines_through_the_boxes() {
        let (lo, hi) = (Vec3::new(0.125, 0.0, 0.25), Vec3::new(0.875, 0.6875, 1.0));
        for (width, at) in [(4u8, [3u8, 1, 2]), (2, [1, 0, 1]), (1, [0, 0, 0])] {
            let wide = usize::from(width);
            let lines = Lines::new([(at, lo, hi)].into_iter(), wide);
            let corner = Vec3::from(at.map(f32::from));
            let (lo, hi) = ((corner + lo) / f32::from(width), (corner + hi) / f32::from(width));
            let depths = lines.depths(&[[2.0; 16]]);
            let trials = [lines.blocked::<false>(&[[2.0; 16]]), lines.blocked::<true>(&[[2.0; 16]])];
            for (k, p) in PROJECTIONS.iter().enumerate() {
                let (across, _) = p.extent();
                let edge = wide * MARCH_LINES;
                let (mut full, mut none) = (0.0, 0.0);
                for (n, &depth) in depths[of_axis(k, edge)].iter().enumerate() {
                    let middle = |i: usize| (i as f64 + 0.5) / edge as f64;
                    let (x, y) = line_at(n, across * edge);
                    let (x, y) = (middle(x), middle(y));
                    let met = crossing(k, x, y, lo.as_dvec3(), hi.as_dvec3()).map_or(0.0, |(from, to)| to - from);
                    let want = 2.0 * met * axis_length(k) * f64::from(width);
                    // All of it are a few roundings of numbers of up to 8, in f32.
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
