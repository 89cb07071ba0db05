//! Rates corrected with the renderer's own march. Blocks are fitted one by one, but along a ray their transmittances
//! multiply, as of unrelated matter: a sheet that goes on from block to block leaks at each border. So groups of blocks are
//! marched along a lattice of lines and compared with what was measured of the group, level by level.
//!
//! Based on: G. Loubet, F. Neyret, *Hybrid Mesh-Volume LoDs for All-Scale Pre-Filtering*, EG 2017 (opacity fitted to measured
//! coverage); the law of [`crate::volume::opacity`].

use std::ops::Range;
use std::sync::OnceLock;

use multiversion::multiversion;

use super::beams::{Beams, PROJECTIONS, SQUARE, axis_length, box_area, crossing, planes_before};
use super::chord::{LENGTHS, Lanes, exp_neg, ln, sum};
use super::march;
use crate::geom::{DVec3, larger, smaller};
use crate::volume::Voxel;
use crate::volume::voxel::RATE_MAX;

/// Gains of the rates at which a group is marched: as they are, more and less; steps are interpolated between them.
const GAINS: [f32; 3] = [1.0, TRIAL, 1.0 / TRIAL];
const TRIAL: f32 = 1.5;
/// Their logarithms, in steps of ln `TRIAL`.
const GAINS_AT: [f32; 3] = [0.0, 1.0, -1.0];
/// How far rates are taken, as logarithms: down no farther than was tried, since what is opaque opens faster than that.
const LEAST: f32 = -0.4;
const MOST: f32 = 0.9;
/// How far from the axes' median what they ask for together is followed.
const APART: f32 = 0.1;
/// A step of a rate's code, as a logarithm.
const STEP: f32 = std::f32::consts::LN_2 / 16.0;
/// A square through which more passes is empty.
const CLEAR: f32 = 0.999;
/// Lines along a group's edge, at most: beyond, every other one is left out. With half as many a sheet leaks (FLIP .052 for .044)
/// and a tree covers 1.5 % more; certificates, which end at blocks, do not tell.
const MOST_LINES: usize = 32;
/// Levels of a group's lines, doubled from one a cube's edge.
const SIZES: usize = 12;

/// What comes through a cube of fitted voxels along the lines of all axes, at each of the `GAINS`.
pub struct Passed {
    /// Lines along the cube's edge, a power of two.
    lines: usize,
    /// Axis by axis, row by row.
    at: [Vec<f32>; GAINS.len()],
    /// The area that is covered along each axis, in squares of the cube's edge: better known than from these lines, where some
    /// were left out.
    areas: [Lanes; GAINS.len()],
    /// Voxels in the cube.
    pub voxels: usize,
}

/// For each of the lines of a cube with `lines` an edge, whether it meets the cube: 0, or misses it: 1.
fn misses(lines: usize) -> &'static [f32] {
    static KNOWN: [OnceLock<Vec<f32>>; SIZES] = [const { OnceLock::new() }; SIZES];
    KNOWN[lines.ilog2() as usize].get_or_init(|| {
        let middle = |i: usize| (i as f64 + 0.5) / lines as f64;
        let mut at = Vec::with_capacity(planes_before(13) * lines * lines);
        for (k, p) in PROJECTIONS.iter().enumerate() {
            let (wa, wb) = p.extent();
            for y in 0..wb * lines {
                let row = (0..wa * lines).map(|x| crossing(k, middle(x), middle(y), DVec3::ZERO, DVec3::ONE));
                at.extend(row.map(|met| f32::from(u8::from(met.is_none()))));
            }
        }
        at
    })
}

/// Where the lines of the axis `k` are among those of a cube with `lines` an edge.
#[inline(always)]
fn of_axis(k: usize, lines: usize) -> Range<usize> {
    planes_before(k) * lines * lines..planes_before(k + 1) * lines * lines
}

impl Passed {
    /// Of a block with `lines` an edge and the correlation `c`; `depths(k, …)` gives the optical depths of axis `k`. Nothing comes
    /// through its octants that are `closed`.
    #[inline(always)]
    pub fn of_block(
        lines: usize,
        c: f32,
        (voxels, closed): (usize, [bool; 8]),
        depths: impl Fn(usize, &mut [f32; march::MOST_LINES]),
    ) -> Passed {
        let square = lines * lines;
        let mut at: [Vec<f32>; GAINS.len()] = GAINS.map(|_| Vec::with_capacity(planes_before(13) * square));
        let d = 1.0 - c;
        let mut all = [0.0; march::MOST_LINES];
        for k in 0..13 {
            depths(k, &mut all);
            let all = &mut all[..of_axis(k, lines).len().min(march::MOST_LINES)];
            if d < 1e-3 {
                for (at, gain) in at.iter_mut().zip(GAINS) {
                    at.extend(all.iter().map(|tau| larger(1.0 - gain * tau, 0.0)));
                }
                continue;
            }
            // T = (E − c) / (1 − c), E = e^−(1−c)τ, of which the gains 1, 3/2 and 2/3 are powers.
            let (by, less) = (1.0 / d, c / d);
            all.iter_mut().for_each(|tau| *tau = exp_neg(d * *tau * (1.0 / 6.0)));
            let [as_is, up, down] = &mut at;
            as_is.extend(all.iter().map(|e| larger((e * e) * (e * e) * (e * e) * by - less, 0.0)));
            up.extend(all.iter().map(|e| larger((e * e * e) * (e * e * e) * (e * e * e) * by - less, 0.0)));
            down.extend(all.iter().map(|e| larger((e * e) * (e * e) * by - less, 0.0)));
        }
        let mut passed = Passed { lines, at, areas: Default::default(), voxels };
        (0..8).filter(|&j| closed[j]).for_each(|j| passed.close(j));
        for g in 0..GAINS.len() {
            for k in 0..13 {
                passed.areas[g][k] = passed.blocked(k, g) / (square as f32 * LENGTHS[k]);
            }
        }
        passed
    }

    /// Multiply what comes through by that of the child `j`, which has half the lines: at the gain `g`, `of(g)`.
    #[inline(always)]
    fn cover<'a>(&mut self, j: usize, of: impl Fn(usize) -> &'a [f32]) {
        let (lines, small) = (self.lines, self.lines / 2);
        for (g, at) in self.at.iter_mut().enumerate() {
            let of = of(g);
            for (k, p) in PROJECTIONS.iter().enumerate() {
                let (wa, wb) = p.extent();
                let (oa, ob) = p.child_offset(j);
                let Some(of) = of.get(of_axis(k, small)) else { continue };
                let first = planes_before(k) * lines * lines + ob * small * wa * lines;
                let Some(at) = at.get_mut(first..first + wb * small * wa * lines) else { continue };
                let (wide, from) = (wa * lines, oa * small);
                // A child has at most half of MOST_LINES an edge, and its widest planes are twice as wide.
                const { assert!(MOST_LINES == 32) };
                match wa * small {
                    32 => multiply::<32>(at, of, wide, from),
                    16 => multiply::<16>(at, of, wide, from),
                    8 => multiply::<8>(at, of, wide, from),
                    4 => multiply::<4>(at, of, wide, from),
                    2 => multiply::<2>(at, of, wide, from),
                    _ => multiply::<1>(at, of, wide, from),
                }
            }
        }
    }

    /// Let nothing through the octant `j`.
    #[inline(always)]
    fn close(&mut self, j: usize) {
        let closed = misses(self.lines / 2);
        self.cover(j, |_| closed);
    }

    /// What an axis blocks, in lines.
    #[inline(always)]
    fn blocked(&self, k: usize, gain: usize) -> f32 {
        sum(&self.at[gain][of_axis(k, self.lines)], |passes| 1.0 - passes)
    }

    /// As a larger cube takes it in: with half of the lines each way, the rows by turns, where there would be too many.
    #[inline(always)]
    fn thinned(self) -> Passed {
        if self.lines <= MOST_LINES / 2 {
            return self;
        }
        let (lines, half) = (self.lines, self.lines / 2);
        let mut at: [Vec<f32>; GAINS.len()] = GAINS.map(|_| Vec::with_capacity(planes_before(13) * half * half));
        for (at, all) in at.iter_mut().zip(&self.at) {
            for (k, p) in PROJECTIONS.iter().enumerate() {
                for (n, row) in all[of_axis(k, lines)].chunks_exact(p.extent().0 * lines).step_by(2).enumerate() {
                    at.extend(row.as_chunks::<2>().0.iter().map(|pair| pair[n & 1]));
                }
            }
        }
        Passed { lines: half, at, areas: self.areas, voxels: self.voxels }
    }

    /// Of the cube of up to eight that are [`thinned`](Passed::thinned), in child order; of those that are `solid`, nothing comes through. `None` if none is known.
    #[inline(always)]
    pub fn unite(children: &[Option<&Passed>; 8], solid: [bool; 8]) -> Option<Passed> {
        let small = children.iter().flatten().next()?.lines;
        let lines = 2 * small;
        let mut whole = Passed {
            lines,
            at: GAINS.map(|_| vec![1.0; planes_before(13) * lines * lines]),
            areas: Default::default(),
            voxels: children.iter().flatten().map(|c| c.voxels).sum(),
        };
        // What the children cover one by one: as it is known, and in lines.
        let (mut known, mut found) = ([[0.0; 16]; GAINS.len()], [[0.0; 16]; GAINS.len()]);
        for (j, child) in children.iter().enumerate() {
            if let Some(child) = child.filter(|c| c.lines == small) {
                whole.cover(j, |g| &child.at[g]);
                for g in 0..GAINS.len() {
                    for k in 0..16 {
                        known[g][k] += 0.25 * child.areas[g][k];
                    }
                    for k in 0..13 {
                        found[g][k] += child.blocked(k, g);
                    }
                }
            } else if solid[j] {
                whole.close(j);
                for k in 0..13 {
                    let met: f32 = misses(small)[of_axis(k, small)].iter().map(|m| 1.0 - m).sum();
                    let area = 0.25 * (box_area(k, DVec3::ONE) / axis_length(k)) as f32;
                    for (known, found) in known.iter_mut().zip(&mut found) {
                        known[k] += area;
                        found[k] += met;
                    }
                }
            }
        }
        for g in 0..GAINS.len() {
            for k in 0..13 {
                whole.areas[g][k] =
                    if found[g][k] > 0.0 { known[g][k] * whole.blocked(k, g) / found[g][k] } else { known[g][k] };
            }
        }
        Some(whole)
    }

    /// Compare with the lines that are met in `beams`: calls `each` with the difference of what is covered of every square one
    /// voxel wide that either finds something in; a voxel is two of the cube's lines wide.
    #[inline(always)]
    pub fn compare(&self, beams: &Beams, mut each: impl FnMut(f32)) {
        for (k, p) in PROJECTIONS.iter().enumerate() {
            let squares = beams.squares(k);
            match (self.lines, p.extent().0) {
                (8, 1) => self.compare_axis::<1, 4>(k, &squares, &mut each),
                (8, _) => self.compare_axis::<1, 8>(k, &squares, &mut each),
                (4, 1) => self.compare_axis::<2, 2>(k, &squares, &mut each),
                (4, _) => self.compare_axis::<2, 4>(k, &squares, &mut each),
                (_, 1) => self.compare_axis::<4, 1>(k, &squares, &mut each),
                _ => self.compare_axis::<4, 2>(k, &squares, &mut each),
            }
        }
    }

    /// [`Passed::compare`] along the axis `k`, `WIDE` voxels to a row, each as wide as `STEP` of the `squares`.
    #[inline(always)]
    fn compare_axis<const STEP: usize, const WIDE: usize>(
        &self,
        k: usize,
        squares: &[[u8; 8]; 8],
        each: &mut impl FnMut(f32),
    ) {
        let rows = self.at[0][of_axis(k, self.lines)].as_chunks::<2>().0.as_chunks::<WIDE>().0;
        for (rows, squares) in rows.as_chunks::<2>().0.iter().zip(squares.as_chunks::<STEP>().0) {
            let (mut passes, mut met) = ([0.0f32; WIDE], [0.0f32; WIDE]);
            for i in 0..WIDE {
                let ([a, b], [c, d]) = (rows[0][i], rows[1][i]);
                passes[i] = 0.25 * (a + b + c + d);
                for row in squares {
                    for n in 0..STEP {
                        met[i] += f32::from(row[i * STEP + n]);
                    }
                }
            }
            for i in 0..WIDE {
                if met[i] > 0.0 || passes[i] < CLEAR {
                    each((1.0 - passes[i] - met[i] / (STEP * STEP * SQUARE * SQUARE) as f32).abs());
                }
            }
        }
    }

    /// Correct the rates of blocks side by side, which were measured to cover `cover` (oblique areas in squares of the cube's
    /// edge): gives steps of the rates' codes.
    #[inline(always)]
    pub fn correct(&mut self, cover: &[f64; 13]) -> i32 {
        let steps = (self.wish(cover) / STEP).round();
        self.change(steps * STEP);
        steps as i32
    }

    /// The logarithm of what the rates are to be multiplied by so that the cube covers the oblique areas `cover`. Axes may
    /// disagree, since one factor scales them all: what leaks in a sheet's own plane does not close along its normal, and slats
    /// hide one another along some axes only. So what all axes ask for together is not followed farther than `APART` from their
    /// median, and no farther than it is sure: less by the share that the mean's own variance, by the axes' spread, has of its
    /// square. That also keeps what chance has put into a measure of soft matter from being followed.
    #[inline(always)]
    pub fn wish(&self, cover: &[f64; 13]) -> f32 {
        let (mut want, mut logs, mut slopes) = ([0.0f32; 16], [0.0f32; 16], [0.0f32; 16]);
        for k in 0..13 {
            want[k] = cover[k] as f32 / LENGTHS[k];
        }
        for k in 0..16 {
            let [as_is, up, down] = &self.areas;
            let curve = Curve::new([as_is[k], up[k], down[k]]);
            logs[k] = curve.find(want[k]);
            slopes[k] = if curve.slope > 1e-6 * as_is[k] { curve.slope } else { 0.0 };
        }
        let weight: f32 = slopes.iter().sum();
        if weight <= 0.0 {
            return 0.0;
        }
        let whole = |g: usize| self.areas[g].iter().sum();
        let all = Curve::new([whole(0), whole(1), whole(2)]).find(want.iter().sum());
        let mut spread = 0.0;
        for k in 0..16 {
            spread += slopes[k] * (logs[k] - all) * (logs[k] - all);
        }
        let doubt = (spread / weight / (13.0 * all * all).max(1e-12)).min(1.0);
        let middle = median(&logs, &slopes);
        all.clamp(middle - APART, middle + APART) * (1.0 - doubt)
    }

    /// Change what comes through as rates that are e^`log` times as large do.
    #[inline(always)]
    pub fn change(&mut self, log: f32) {
        if log == 0.0 {
            return;
        }
        let steps = GAINS_AT.map(|gain| Step::new(log / ln(TRIAL) + gain));
        let [as_is, up, down] = &mut self.at;
        for ((as_is, up), down) in as_is.iter_mut().zip(up).zip(down) {
            let curve = Curve::new([*as_is, *up, *down]);
            *as_is = curve.at(&steps[0]).clamp(0.0, 1.0);
            *up = curve.at(&steps[1]).clamp(0.0, 1.0);
            *down = curve.at(&steps[2]).clamp(0.0, 1.0);
        }
        let [as_is, up, down] = &mut self.areas;
        for k in 0..16 {
            let curve = Curve::new([as_is[k], up[k], down[k]]);
            as_is[k] = larger(curve.at(&steps[0]), 0.0);
            up[k] = larger(curve.at(&steps[1]), 0.0);
            down[k] = larger(curve.at(&steps[2]), 0.0);
        }
    }
}

/// Multiply the rows of `at`, which are `wide`, from their column `from` on by those of `by`, which are `N` wide.
#[inline(always)]
fn multiply<const N: usize>(at: &mut [f32], by: &[f32], wide: usize, from: usize) {
    for (row, by) in at.chunks_exact_mut(wide).zip(by.as_chunks::<N>().0) {
        let Some(row) = row.get_mut(from..).and_then(|row| row.first_chunk_mut::<N>()) else { continue };
        // Apart, so that the compiler need not fear that one is the other.
        let mut product = [0.0; N];
        for n in 0..N {
            product[n] = row[n] * by[n];
        }
        *row = product;
    }
}

/// The group of `children` (see [`Passed::unite`]), which was measured to cover `cover`, corrected and thinned; and by how many
/// steps of the rates' codes.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+lzcnt+popcnt"))]
pub fn group(children: &[Option<&Passed>; 8], solid: [bool; 8], cover: &[f64; 13]) -> Option<(Passed, i32)> {
    let mut group = Passed::unite(children, solid)?;
    let steps = group.correct(cover);
    Some((group.thinned(), steps))
}

/// A quantity over the logarithm of the gain, in steps of ln `TRIAL`, between and beyond those tried: parabolas that meet with
/// one slope and rise, or fall, throughout.
struct Curve {
    middle: f32,
    slope: f32,
    /// Half of the second derivatives below and above, and slopes at the ends.
    bend: [f32; 2],
    ends: [f32; 2],
}

/// A place on curves, as what it counts of each of their parts.
struct Step {
    /// Within −1 to 1; its square, below 0 and above; and how far it lies beyond −1 and 1.
    inner: f32,
    below: f32,
    above: f32,
    lower: f32,
    higher: f32,
}

impl Step {
    #[inline(always)]
    fn new(x: f32) -> Step {
        let inner = x.clamp(-1.0, 1.0);
        let (below, above) = (smaller(inner, 0.0), larger(inner, 0.0));
        let (lower, higher) = (smaller(x + 1.0, 0.0), larger(x - 1.0, 0.0));
        Step { inner, below: below * below, above: above * above, lower, higher }
    }
}

impl Curve {
    /// Through the values at `GAINS`.
    #[inline(always)]
    fn new([as_is, up, down]: [f32; 3]) -> Curve {
        let (below, above) = (as_is - down, up - as_is);
        // The harmonic mean.
        let slope = if below * above > 0.0 { 2.0 * below * above / (below + above) } else { 0.0 };
        let bend = [slope - below, above - slope];
        Curve { middle: as_is, slope, bend, ends: [2.0 * below - slope, 2.0 * above - slope] }
    }

    #[inline(always)]
    fn at(&self, step: &Step) -> f32 {
        let bend = step.below * self.bend[0] + step.above * self.bend[1];
        let end = step.lower * self.ends[0] + step.higher * self.ends[1];
        self.middle + step.inner * self.slope + bend + end
    }

    /// The logarithm of the gain at which a quantity that rises is `want`, within `LEAST` to `MOST`.
    #[inline(always)]
    fn find(&self, want: f32) -> f32 {
        let way = if want < self.middle { -1.0 } else { 1.0 };
        let (more, part) = ((want - self.middle).abs(), usize::from(way > 0.0));
        // Along a parabola that starts with `slope` and bends by `bend` to its end, a trial away; straight on from there.
        let bend = way * self.bend[part];
        let last = self.slope + bend;
        let x = if more > last {
            1.0 + (more - last) / larger(self.ends[part], 1e-20)
        } else {
            let root = larger(self.slope * self.slope + 4.0 * bend * more, 0.0).sqrt();
            2.0 * more / larger(self.slope + root, 1e-20)
        };
        (way * x * ln(TRIAL)).clamp(LEAST, MOST)
    }
}

/// The median of values by their weights; 0 of none.
#[inline(always)]
fn median(values: &Lanes, weights: &Lanes) -> f32 {
    // Of each value, the weight of those up to it.
    let mut upto = [0.0; 16];
    for (&value, &weight) in values.iter().zip(weights) {
        for k in 0..16 {
            upto[k] += if value <= values[k] { weight } else { 0.0 };
        }
    }
    let half = 0.5 * weights.iter().sum::<f32>();
    let mut middle = f32::INFINITY;
    for k in 0..16 {
        if weights[k] > 0.0 && upto[k] >= half {
            middle = smaller(middle, values[k]);
        }
    }
    if middle < f32::INFINITY { middle } else { 0.0 }
}

/// Multiply the rates of voxels by 2^(`steps`/16); what is opaque remains so.
pub fn scale(voxels: &mut [Voxel], steps: i32) {
    for voxel in voxels.iter_mut().filter(|v| v.rate != 0 && v.rate != RATE_MAX) {
        voxel.rate = (i32::from(voxel.rate) + steps).clamp(1, i32::from(RATE_MAX) - 1) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What comes through a wall in the plane x = 0 of share `p` in each line along x, and of nothing along others.
    fn wall(p: f32) -> Passed {
        Passed::of_block(8, 1.0, (3, [false; 8]), |k, depths| {
            depths.fill(if k == 0 { p } else { 0.0 });
        })
    }

    #[test]
    fn a_wall_in_halves_closes() {
        // Two blocks one behind the other, each with half of a wall: 1/4 leaks, where nothing should.
        let halves = [wall(0.5), wall(0.5)];
        let mut children = [None; 8];
        (children[0], children[1]) = (Some(&halves[0]), Some(&halves[1]));
        let unite = || Passed::unite(&children, [false; 8]).unwrap();
        assert_eq!(unite().voxels, 6);
        let mut cover = [0.0; 13];
        // They cover a quarter of the group's face, of which 3/4 are found, at gains 1.5 and 1/1.5 15/16 and 5/9. The slope
        // is .191 at first, the harmonic mean, and at last 2 · 3/16 − .191: the last 1/16 is .339 of a trial beyond the first.
        // 1.339 · ln 1.5 = .543 are 12.5 steps of a code.
        cover[0] = 0.25;
        let mut group = unite();
        assert_eq!(group.correct(&cover), 13);
        assert_eq!(group.blocked(0, 0), 64.0, "closed");
        cover[0] *= 0.75;
        assert_eq!(unite().correct(&cover), 0, "independent halves are right as they are");
        assert_eq!(unite().correct(&[0.0; 13]), (LEAST / STEP).round() as i32);
    }

    #[test]
    fn axes_that_disagree_are_not_followed() {
        // Walls along two axes, of which one should be closed and the other opened.
        let walls = || {
            Passed::of_block(8, 1.0, (6, [false; 8]), |k, depths| {
                depths.fill(if k < 2 { 0.5 } else { 0.0 });
            })
        };
        let mut cover = [0.0; 13];
        (cover[0], cover[1]) = (0.7, 0.32);
        assert_eq!(walls().correct(&cover), 0);
        cover[1] = 0.65;
        assert!(walls().correct(&cover) > 5);
    }

    #[test]
    fn lines_that_are_left_out_change_no_area() {
        let mut passed = wall(0.5);
        for level in 1..5 {
            let mut children = [None; 8];
            children[2 * (level & 1)] = Some(&passed);
            passed = Passed::unite(&children, [false; 8]).unwrap();
            assert_eq!(passed.lines, (8 << level).min(MOST_LINES));
            let want = 0.5 * 0.25f32.powi(level as i32);
            let square = (passed.lines * passed.lines) as f32;
            // Sums of up to 1024 f32 that are 1/2 or 0, exact; a ratio's rounding.
            assert!((passed.areas[0][0] / want - 1.0).abs() < 1e-5 && passed.blocked(0, 0) == want * square);
            passed = passed.thinned();
        }
    }

    #[test]
    fn nothing_comes_through_what_is_solid() {
        let half = wall(0.5);
        let mut children = [None; 8];
        children[0] = Some(&half);
        let mut solid = [false; 8];
        solid[1] = true;
        let group = Passed::unite(&children, solid).unwrap();
        // Along x: the low quarter of the face is closed, the rest open.
        let axis = &group.at[0][..256];
        assert_eq!(axis.iter().filter(|t| **t == 0.0).count(), 64);
        assert_eq!(axis.iter().filter(|t| **t == 1.0).count(), 192);
    }

    #[test]
    fn opaque_voxels_remain_opaque() {
        let mut voxels = [0, 100, 250, RATE_MAX].map(|rate| Voxel { rate, ..Voxel::default() });
        scale(&mut voxels, 16);
        assert_eq!(voxels.map(|v| v.rate), [0, 116, 254, RATE_MAX]);
    }
}
