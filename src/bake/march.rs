//! The lines, along all axes, on which a block is marched while it is fitted, and what its voxels' boxes put in their way.
//!
//! A voxel's own lines are so few that all of them are kept, also those that miss its box: their numbers are fixed, and many are
//! handled at once.

use super::beams::{PROJECTIONS, Projection, Slabs, axis_length, planes_before};
use super::chord::{exp_neg, sum};
use crate::geom::{Vec3, larger, smaller};

/// Lines a voxel edge.
pub const MARCH_LINES: usize = 2;
/// Lines along an edge of the widest plane that a voxel has.
const WIDE: usize = 2 * MARCH_LINES;
/// Lines along all axes that a voxel's planes have.
const LINES_OF_VOXEL: usize = start(13);
/// Most lines of one axis that a block has, which is four voxels wide.
pub const MOST_LINES: usize = WIDE * WIDE * 16;

/// Where the lines of the axis `k` begin.
const fn start(k: usize) -> usize {
    planes_before(k) * MARCH_LINES * MARCH_LINES
}

/// Call a method of [`Lines`] for the axis `k` with its numbers fixed: lines that a voxel has in a row, and in all, the block's
/// width, and its lines.
macro_rules! numbered {
    ($lines:ident.$call:ident [$($first:tt)*] ($k:ident $(, $more:ident)*)) => {
        match (PROJECTIONS[$k].extent(), $lines.width) {
            ((1, _), 4) => $lines.$call::<$($first)* { WIDE / 2 }, 4, 4, 64>($k $(, $more)*),
            ((1, _), 2) => $lines.$call::<$($first)* { WIDE / 2 }, 4, 2, 16>($k $(, $more)*),
            ((1, _), _) => $lines.$call::<$($first)* { WIDE / 2 }, 4, 1, 4>($k $(, $more)*),
            ((_, 1), 4) => $lines.$call::<$($first)* WIDE, 8, 4, 128>($k $(, $more)*),
            ((_, 1), 2) => $lines.$call::<$($first)* WIDE, 8, 2, 32>($k $(, $more)*),
            ((_, 1), _) => $lines.$call::<$($first)* WIDE, 8, 1, 8>($k $(, $more)*),
            (_, 4) => $lines.$call::<$($first)* WIDE, 16, 4, 256>($k $(, $more)*),
            (_, 2) => $lines.$call::<$($first)* WIDE, 16, 2, 64>($k $(, $more)*),
            _ => $lines.$call::<$($first)* WIDE, 16, 1, 16>($k $(, $more)*),
        }
    };
}

/// Of each voxel of a block the chords, in its support box, of its lines, axis by axis and row by row; 0 of those that miss it.
pub struct Lines {
    chords: Vec<[f32; LINES_OF_VOXEL]>,
    /// Where each voxel's lines begin in the block's plane.
    firsts: Vec<[u8; 13]>,
    /// Voxels along the block's edge, at most 4.
    width: usize,
}

impl Lines {
    /// Of voxels with these places in the block and support boxes.
    #[inline(always)]
    pub fn new(boxes: impl ExactSizeIterator<Item = ([u8; 3], Vec3, Vec3)>, width: usize) -> Lines {
        let mut all = Lines { chords: Vec::with_capacity(boxes.len()), firsts: Vec::with_capacity(boxes.len()), width };
        for (at, lo, hi) in boxes {
            let mut chords = [0.0; LINES_OF_VOXEL];
            let mut firsts = [0; 13];
            let slabs = Slabs::<WIDE>::new(lo, hi);
            for (k, p) in PROJECTIONS.iter().enumerate() {
                let (oa, ob) = p.place(at, width);
                // At most 16 lines each way: below 256.
                firsts[k] = (MARCH_LINES * (ob * MARCH_LINES * p.extent().0 * width + oa)) as u8;
                let chords = &mut chords[start(k)..start(k + 1)];
                match p.extent() {
                    (1, _) => crossings::<{ WIDE / 2 }>(chords, &slabs, p, axis_length(k) as f32),
                    _ => crossings::<WIDE>(chords, &slabs, p, axis_length(k) as f32),
                }
            }
            all.chords.push(chords);
            all.firsts.push(firsts);
        }
        all
    }

    /// Optical depths of the lines of the axis `k`, row by row, where the voxels have the rates `rate` that way; into the first
    /// of `depths`.
    #[inline(always)]
    pub fn depths(&self, k: usize, rate: impl Fn(usize) -> f32, depths: &mut [f32; MOST_LINES]) {
        numbered!(self.add [] (k, rate, depths))
    }

    /// [`Lines::depths`] of an axis of which a voxel has `ALL` lines, `N` a row, and a block, `WIDTH` wide, `COUNT`.
    #[inline(always)]
    fn add<const N: usize, const ALL: usize, const WIDTH: usize, const COUNT: usize>(
        &self,
        k: usize,
        rate: impl Fn(usize) -> f32,
        depths: &mut [f32; MOST_LINES],
    ) {
        let Some(depths) = depths.first_chunk_mut::<COUNT>() else { return };
        *depths = [0.0; COUNT];
        for (cell, (chords, firsts)) in self.chords.iter().zip(&self.firsts).enumerate() {
            let rate = rate(cell);
            let first = usize::from(firsts[k]);
            let Some(chords) = chords[start(k)..].first_chunk::<ALL>() else { continue };
            let Some(depths) = depths.get_mut(first..first + (ALL / N - 1) * N * WIDTH + N) else { continue };
            for row in 0..ALL / N {
                let at = row * N * WIDTH;
                let mut more = [0.0; N];
                for n in 0..N {
                    more[n] = depths[at + n] + rate * chords[row * N + n];
                }
                depths[at..at + N].copy_from_slice(&more);
            }
        }
    }

    /// How many of the lines of the axis `k` the voxels block, each for itself, and all together, where their correlation is half
    /// of `TWICE`, 0 to 2: independent, half, or fully correlated, which keeps lines that are not blocked apart as long as there
    /// are any.
    #[inline(always)]
    pub fn blocked<const TWICE: u8>(&self, k: usize, rate: impl Fn(usize) -> f32) -> (f32, f32) {
        numbered!(self.block [TWICE,] (k, rate))
    }

    /// [`Lines::blocked`] of an axis of which a voxel has `ALL` lines, `N` a row, and a block, `WIDTH` wide, `COUNT`.
    #[inline(always)]
    fn block<const TWICE: u8, const N: usize, const ALL: usize, const WIDTH: usize, const COUNT: usize>(
        &self,
        k: usize,
        rate: impl Fn(usize) -> f32,
    ) -> (f32, f32) {
        let mut alone = [0.0; ALL];
        // Of the block's lines, E = e^−(1−c)τ; or at c = 1, τ.
        let mut lines = [if TWICE == 2 { 0.0f32 } else { 1.0 }; COUNT];
        for (cell, (chords, firsts)) in self.chords.iter().zip(&self.firsts).enumerate() {
            let rate = (if TWICE == 1 { 0.5 } else { 1.0 }) * rate(cell);
            let first = usize::from(firsts[k]);
            let Some(chords) = chords[start(k)..].first_chunk::<ALL>() else { continue };
            let Some(lines) = lines.get_mut(first..first + (ALL / N - 1) * N * WIDTH + N) else { continue };
            let mut own = [0.0; ALL];
            for n in 0..ALL {
                own[n] = if TWICE == 2 { rate * chords[n] } else { exp_neg(rate * chords[n]) };
                alone[n] += share::<TWICE>(own[n]);
            }
            for row in 0..ALL / N {
                let at = row * N * WIDTH;
                let mut more = [0.0; N];
                for n in 0..N {
                    let own = own[row * N + n];
                    more[n] = if TWICE == 2 { lines[at + n] + own } else { lines[at + n] * own };
                }
                lines[at..at + N].copy_from_slice(&more);
            }
        }
        (alone.iter().sum(), sum(&lines, share::<TWICE>))
    }
}

/// The share that is blocked of a line, by what [`Lines::block`] keeps of it: T = (E − c) / (1 − c), as long as it is positive.
#[inline(always)]
fn share<const TWICE: u8>(of: f32) -> f32 {
    match TWICE {
        0 => 1.0 - of,
        1 => smaller(2.0 - 2.0 * of, 1.0),
        _ => smaller(of, 1.0),
    }
}

/// The chords of lines in `N` columns, row by row.
#[inline(always)]
fn crossings<const N: usize>(chords: &mut [f32], slabs: &Slabs<WIDE>, p: &Projection, length: f32) {
    for (y, chords) in chords.as_chunks_mut::<N>().0.iter_mut().enumerate() {
        for (x, chord) in chords.iter_mut().enumerate() {
            *chord = larger(slabs.stretch(p, x, y), 0.0) * length;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::beams::crossing;
    use super::*;

    #[test]
    fn depths_are_those_of_lines_through_the_boxes() {
        let (lo, hi) = (Vec3::new(0.125, 0.0, 0.25), Vec3::new(0.875, 0.6875, 1.0));
        for (width, at) in [(4u8, [3u8, 1, 2]), (2, [1, 0, 1]), (1, [0, 0, 0])] {
            let wide = usize::from(width);
            let lines = Lines::new([(at, lo, hi)].into_iter(), wide);
            let corner = Vec3::from(at.map(f32::from));
            let (lo, hi) = ((corner + lo) / f32::from(width), (corner + hi) / f32::from(width));
            for (k, p) in PROJECTIONS.iter().enumerate() {
                let mut depths = [0.0; MOST_LINES];
                lines.depths(k, |_| 2.0, &mut depths);
                let (across, down) = p.extent();
                let edge = wide * MARCH_LINES;
                let count = across * down * edge * edge;
                let (mut full, mut half, mut none) = (0.0, 0.0, 0.0);
                for (n, &depth) in depths[..count].iter().enumerate() {
                    let middle = |i: usize| (i as f64 + 0.5) / edge as f64;
                    let (x, y) = (middle(n % (across * edge)), middle(n / (across * edge)));
                    let met = crossing(k, x, y, lo.as_dvec3(), hi.as_dvec3()).map_or(0.0, |(from, to)| to - from);
                    let want = 2.0 * met * axis_length(k) * f64::from(width);
                    // All of it are a few roundings of numbers of up to 8, in f32.
                    assert!((f64::from(depth) - want).abs() < 1e-5, "{width} {k} {n}: {depth} {want}");
                    full += want.min(1.0);
                    half += (2.0 - 2.0 * (-0.5 * want).exp()).min(1.0);
                    none += 1.0 - (-want).exp();
                }
                // Sums of at most 256 of them; exp_neg is right to 1e-5.
                for ((alone, together), want) in [
                    (lines.blocked::<2>(k, |_| 2.0), full),
                    (lines.blocked::<1>(k, |_| 2.0), half),
                    (lines.blocked::<0>(k, |_| 2.0), none),
                ] {
                    assert!((f64::from(alone) - want).abs() < 1e-3, "{width} {k}: {alone} {want}");
                    assert!((alone - together).abs() < 1e-4, "one voxel hides nothing");
                }
            }
        }
    }
}
