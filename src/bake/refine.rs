//! Rates corrected with the renderer's own march. Blocks are fitted one by one, but along a ray their transmittances
//! multiply, as of unrelated matter: a sheet that goes on from block to block leaks at each border. So groups of blocks are
//! marched along a lattice of lines and compared with what was measured of the group, level by level.
//!
//! Based on: G. Loubet, F. Neyret, *Hybrid Mesh-Volume LoDs for All-Scale Pre-Filtering*, EG 2017 (opacity fitted to measured
//! coverage); the law of [`crate::volume::opacity`].

use std::sync::OnceLock;

use multiversion::multiversion;

use super::beams::Beams;
use super::march;
use super::march::{OfBlock, TILE, of_axis};
use crate::geom::projection::{PROJECTIONS, SQUARE, child_offset, crossing, planes_before};
use crate::geom::{DVec3, larger, smaller};
use crate::geom::{axis_length, box_area};
use crate::volume::Voxel;
use crate::volume::chord::{CORRELATED, LENGTHS, Lanes, exp_neg, ln};
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
/// Lines that are handled at once; each axis has a multiple of them, but of the smallest blocks.
const SIDE: usize = 16;
/// Levels of a group's lines, doubled from one a cube's edge.
const SIZES: usize = 12;

/// Most squares, one voxel wide, of a block along all axes; and their errors.
const MOST_ERRORS: usize = size_of::<OfBlock>() / size_of::<[f32; TILE]>();
pub type Errors = [f32; MOST_ERRORS];

/// The share of a line's light that comes through, in parts of `ALL`: half as wide as an f32, since planes of lines do not stay in
/// the nearest cache, and far finer than a step of a rate's code.
type Part = u16;
const ALL: Part = Part::MAX;

/// To whole parts, from 0 to `ALL`.
#[inline(always)]
fn whole(parts: f32) -> Part {
    // Where the last bit is worth 1, adding rounds.
    const ROUND: f32 = 12_582_912.0;
    (parts + ROUND).to_bits() as Part
}

/// What comes through two, one behind the other: right where one of them is nothing or all, and up to a part too much elsewhere.
#[inline(always)]
fn through(a: Part, b: Part) -> Part {
    let high = ((u32::from(a) * u32::from(b)) >> 16) as Part;
    (high + 1).min(a).min(b)
}

/// So many lines at each of the `GAINS`, through which the same comes.
fn lines_of(count: usize, passes: Part) -> [Vec<Part>; GAINS.len()] {
    [vec![passes; count], vec![passes; count], vec![passes; count]]
}

/// What comes through a cube of fitted voxels along the lines of all axes, at each of the `GAINS`.
pub struct Passed {
    /// Lines along the cube's edge, a power of two.
    lines: usize,
    /// Axis by axis, tile by tile as [`march::Lines`] has them.
    at: [Vec<Part>; GAINS.len()],
    /// The area that is covered along each axis, in squares of the cube's edge: better known than from these lines, where some
    /// were left out.
    areas: [Lanes; GAINS.len()],
    /// Voxels in the cube.
    pub voxels: usize,
}

/// Of a cube with some lines an edge, for each of them whether it meets the cube: 0, or misses it: `ALL`; and how many of an axis
/// meet it.
struct Closed {
    misses: Vec<Part>,
    met: [f32; 13],
}

impl Closed {
    fn of(lines: usize) -> &'static Closed {
        static KNOWN: [OnceLock<Closed>; SIZES] = [const { OnceLock::new() }; SIZES];
        KNOWN[lines.ilog2() as usize].get_or_init(|| {
            let middle = |i: usize| (i as f64 + 0.5) / lines as f64;
            let mut closed = Closed { misses: Vec::with_capacity(planes_before(13) * lines * lines), met: [0.0; 13] };
            for (k, p) in PROJECTIONS.iter().enumerate() {
                let (wa, wb) = p.extent();
                for n in 0..wa * wb * lines * lines {
                    let (x, y) = march::line_at(n, wa * lines);
                    let met = crossing(k, middle(x), middle(y), DVec3::ZERO, DVec3::ONE).is_some();
                    closed.misses.push(if met { 0 } else { ALL });
                    closed.met[k] += if met { 1.0 } else { 0.0 };
                }
            }
            closed
        })
    }
}

impl Passed {
    /// Of a block with `lines` an edge and the correlation `c`; `depths` are their optical depths. Nothing comes through its
    /// octants that are `closed`.
    #[inline(always)]
    pub fn of_block(lines: usize, c: f32, (voxels, closed): (usize, [bool; 8]), depths: &OfBlock) -> Passed {
        let square = lines * lines;
        let depths = depths[..(planes_before(13) * square).next_multiple_of(SIDE)].as_chunks::<SIDE>().0;
        let mut at = lines_of(depths.len() * SIDE, 0);
        let [as_is, up, down] = &mut at;
        let chunks = as_is.as_chunks_mut::<SIDE>().0.iter_mut();
        let chunks = chunks.zip(up.as_chunks_mut::<SIDE>().0).zip(down.as_chunks_mut::<SIDE>().0);
        let d = 1.0 - c;
        // T = (E − c) / (1 − c), E = e^−(1−c)τ, of which the gains 1, 3/2 and 2/3 are powers.
        let all = f32::from(ALL);
        let (by, less) = (all / d, all * c / d);
        for (((as_is, up), down), depths) in chunks.zip(depths) {
            for n in 0..SIDE {
                if c > CORRELATED {
                    as_is[n] = whole(larger(all - all * GAINS[0] * depths[n], 0.0));
                    up[n] = whole(larger(all - all * GAINS[1] * depths[n], 0.0));
                    down[n] = whole(larger(all - all * GAINS[2] * depths[n], 0.0));
                } else {
                    let e = exp_neg(d * depths[n] * (1.0 / 6.0));
                    let (square, cube) = (e * e, e * e * e);
                    as_is[n] = whole(larger(square * square * square * by - less, 0.0));
                    up[n] = whole(larger(cube * cube * cube * by - less, 0.0));
                    down[n] = whole(larger(square * square * by - less, 0.0));
                }
            }
        }
        let mut passed = Passed { lines, at, areas: Default::default(), voxels };
        for (j, &closed) in closed.iter().enumerate() {
            if closed {
                passed.close(j);
            }
        }
        for g in 0..GAINS.len() {
            for k in 0..13 {
                passed.areas[g][k] = passed.blocked(k, g) / (square as f32 * LENGTHS[k]);
            }
        }
        passed
    }

    /// Multiply what comes through along the axis `k` at the gain `g` by that of the child `j`, `of`, which has half the lines.
    #[inline(always)]
    fn cover(&mut self, j: usize, k: usize, g: usize, of: &[Part]) {
        let (lines, small, p) = (self.lines, self.lines / 2, &PROJECTIONS[k]);
        let (wa, wb) = p.extent();
        let (oa, ob) = child_offset(k, j);
        // A row of tiles has two lines of each column.
        let (wide, from) = (2 * wa * lines, 2 * oa * small);
        let (Some(of), Some(at)) = (of.get(of_axis(k, small)), self.at[g].get_mut(of_axis(k, lines))) else { return };
        let half = small / 2;
        let Some(at) = at.get_mut(ob * half * wide..(ob + wb) * half * wide) else { return };
        // A child has at most half of MOST_LINES an edge, a power of two, and its widest planes are twice as wide.
        const { assert!(MOST_LINES == 32) };
        match 2 * wa * small {
            64 => multiply::<64>(at, of, wide, from),
            32 => multiply::<32>(at, of, wide, from),
            16 => multiply::<16>(at, of, wide, from),
            8 => multiply::<8>(at, of, wide, from),
            _ => multiply::<4>(at, of, wide, from),
        }
    }

    /// Let nothing through the octant `j`.
    #[inline(always)]
    fn close(&mut self, j: usize) {
        let closed = Closed::of(self.lines / 2);
        for k in 0..13 {
            for g in 0..GAINS.len() {
                self.cover(j, k, g, &closed.misses);
            }
        }
    }

    /// What an axis blocks, in lines.
    #[inline(always)]
    fn blocked(&self, k: usize, gain: usize) -> f32 {
        let all = &self.at[gain][of_axis(k, self.lines)];
        let mut passed = 0;
        for &passes in all {
            passed += u32::from(passes);
        }
        // At most four squares of MOST_LINES.
        (all.len() as u32 * u32::from(ALL) - passed) as f32 * (1.0 / ALL as f32)
    }

    /// As a larger cube takes it in: with half of the lines each way, the rows by turns, where there would be too many.
    #[inline(always)]
    fn thinned(self) -> Passed {
        if self.lines <= MOST_LINES / 2 {
            return self;
        }
        let (lines, half) = (self.lines, self.lines / 2);
        let mut at = lines_of(planes_before(13) * half * half, 0);
        for (at, all) in at.iter_mut().zip(&self.at) {
            for (k, p) in PROJECTIONS.iter().enumerate() {
                // Of each tile a line of its first row: the first one in even rows of tiles, the second in odd ones.
                let across = p.extent().0 * half;
                let rows = all[of_axis(k, lines)].as_chunks::<TILE>().0.chunks_exact(2 * across);
                for (rows, to) in rows.zip(at[of_axis(k, half)].as_chunks_mut::<TILE>().0.chunks_exact_mut(across / 2))
                {
                    let (even, odd) = rows.split_at(across);
                    for (to, (even, odd)) in
                        to.iter_mut().zip(even.as_chunks::<2>().0.iter().zip(odd.as_chunks::<2>().0))
                    {
                        *to = [even[0][0], even[1][0], odd[0][1], odd[1][1]];
                    }
                }
            }
        }
        Passed { lines: half, at, areas: self.areas, voxels: self.voxels }
    }

    /// Of the cube of up to eight that are [`thinned`](Passed::thinned), in child order; nothing comes through those that are
    /// `solid`. `None` if none is known.
    #[inline(always)]
    pub fn unite(children: &[Option<&Passed>; 8], solid: [bool; 8]) -> Option<Passed> {
        let small = children.iter().flatten().next()?.lines;
        let lines = 2 * small;
        let mut whole = Passed {
            lines,
            at: lines_of(planes_before(13) * lines * lines, ALL),
            areas: Default::default(),
            voxels: children.iter().flatten().map(|c| c.voxels).sum(),
        };
        let (children, closed) = (children.map(|child| child.filter(|c| c.lines == small)), Closed::of(small));
        // Plane by plane, each of which stays near while all children cover it.
        for g in 0..GAINS.len() {
            for k in 0..13 {
                // What the children cover one by one: as it is known, and in lines.
                let (mut known, mut found) = (0.0, 0.0);
                for (j, child) in children.iter().enumerate() {
                    if let Some(child) = child {
                        whole.cover(j, k, g, &child.at[g]);
                        known += 0.25 * child.areas[g][k];
                        found += child.blocked(k, g);
                    } else if solid[j] {
                        whole.cover(j, k, g, &closed.misses);
                        known += 0.25 * (box_area(k, DVec3::ONE) / axis_length(k)) as f32;
                        found += closed.met[k];
                    }
                }
                whole.areas[g][k] = if found > 0.0 { known * whole.blocked(k, g) / found } else { known };
            }
        }
        Some(whole)
    }

    /// Compare a block with the lines that are met in `beams`: differences of what is covered of squares one voxel wide, −1 where
    /// neither finds something in; a voxel is two of the cube's lines wide.
    #[inline(always)]
    pub fn compare(&self, beams: &Beams) -> Errors {
        let mut errors = [-1.0; MOST_ERRORS];
        let square = self.lines * self.lines / TILE;
        for (k, p) in PROJECTIONS.iter().enumerate() {
            let squares = beams.squares(k);
            let errors = &mut errors[planes_before(k) * square..planes_before(k + 1) * square];
            match (self.lines, p.extent().0) {
                (8, 1) => self.compare_axis::<1, 4>(k, &squares, errors),
                (8, _) => self.compare_axis::<1, 8>(k, &squares, errors),
                (4, 1) => self.compare_axis::<2, 2>(k, &squares, errors),
                (4, _) => self.compare_axis::<2, 4>(k, &squares, errors),
                (_, 1) => self.compare_axis::<4, 1>(k, &squares, errors),
                _ => self.compare_axis::<4, 2>(k, &squares, errors),
            }
        }
        errors
    }

    /// [`Passed::compare`] along the axis `k`, `WIDE` voxels to a row, each as wide as `STEP` of the `squares`.
    #[inline(always)]
    fn compare_axis<const STEP: usize, const WIDE: usize>(&self, k: usize, squares: &[[u8; 8]; 8], errors: &mut [f32]) {
        let voxels = self.at[0][of_axis(k, self.lines)].as_chunks::<TILE>().0.as_chunks::<WIDE>().0;
        let squares = squares.as_chunks::<STEP>().0;
        for ((voxels, squares), errors) in voxels.iter().zip(squares).zip(errors.as_chunks_mut::<WIDE>().0) {
            let (mut passes, mut met) = ([0.0f32; WIDE], [0.0f32; WIDE]);
            for i in 0..WIDE {
                let [a, b, c, d] = voxels[i].map(u32::from);
                passes[i] = (a + b + c + d) as f32 * (0.25 / ALL as f32);
                for row in squares {
                    for n in 0..STEP {
                        met[i] += f32::from(row[i * STEP + n]);
                    }
                }
            }
            for i in 0..WIDE {
                let error = (1.0 - passes[i] - met[i] / (STEP * STEP * SQUARE * SQUARE) as f32).abs();
                errors[i] = if met[i] > 0.0 || passes[i] < CLEAR { error } else { -1.0 };
            }
        }
    }

    /// With the rates of blocks side by side corrected, which were measured to cover `cover` (oblique areas in squares of the
    /// cube's edge), by steps of the rates' codes; [`thinned`](Passed::thinned).
    #[inline(always)]
    fn corrected(self, cover: &[f64; 13]) -> (Passed, i32) {
        let steps = (self.wish(cover) / STEP).round();
        // What is left out need not be changed.
        let mut passed = self.thinned();
        passed.change(steps * STEP);
        (passed, steps as i32)
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
        let at = as_is.as_chunks_mut::<SIDE>().0.iter_mut();
        for ((as_is, up), down) in at.zip(up.as_chunks_mut::<SIDE>().0).zip(down.as_chunks_mut::<SIDE>().0) {
            for n in 0..SIDE {
                let curve = Curve::new([as_is[n], up[n], down[n]].map(f32::from));
                as_is[n] = whole(curve.at(&steps[0]).clamp(0.0, f32::from(ALL)));
                up[n] = whole(curve.at(&steps[1]).clamp(0.0, f32::from(ALL)));
                down[n] = whole(curve.at(&steps[2]).clamp(0.0, f32::from(ALL)));
            }
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
fn multiply<const N: usize>(at: &mut [Part], by: &[Part], wide: usize, from: usize) {
    for (row, by) in at.chunks_exact_mut(wide).zip(by.as_chunks::<N>().0) {
        let Some(row) = row.get_mut(from..).and_then(|row| row.first_chunk_mut::<N>()) else { continue };
        // Apart, so that the compiler need not fear that one is the other.
        let mut product = [0; N];
        for n in 0..N {
            product[n] = through(row[n], by[n]);
        }
        *row = product;
    }
}

/// The group of `children` (see [`Passed::unite`]), which was measured to cover `cover`, corrected and thinned; and by how many
/// steps of the rates' codes.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+lzcnt+popcnt"))]
pub fn group(children: &[Option<&Passed>; 8], solid: [bool; 8], cover: &[f64; 13]) -> Option<(Passed, i32)> {
    Some(Passed::unite(children, solid)?.corrected(cover))
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
        let mut depths: OfBlock = [0.0; planes_before(13) * 64];
        depths[of_axis(0, 8)].fill(p);
        Passed::of_block(8, 1.0, (3, [false; 8]), &depths)
    }

    #[test]
    fn parts_multiply_as_shares_do() {
        for a in (0..=ALL).step_by(251) {
            assert_eq!((through(a, ALL), through(ALL, a), through(a, 0), through(0, a)), (a, a, 0, 0));
            for b in (0..=ALL).step_by(257) {
                let want = f64::from(a) * f64::from(b) / f64::from(ALL);
                let got = f64::from(through(a, b));
                assert!(got > want - 1.0 && got <= want + 1.0, "{a} {b}: {got} {want}");
            }
            assert_eq!(whole(f32::from(a) + 0.25), a);
        }
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
        let (group, steps) = unite().corrected(&cover);
        assert_eq!(steps, 13);
        assert_eq!(group.blocked(0, 0), 64.0, "closed");
        cover[0] *= 0.75;
        assert_eq!(unite().corrected(&cover).1, 0, "independent halves are right as they are");
        assert_eq!(unite().corrected(&[0.0; 13]).1, (LEAST / STEP).round() as i32);
    }

    #[test]
    fn axes_that_disagree_are_not_followed() {
        // Walls along two axes, of which one should be closed and the other opened.
        let walls = || {
            let mut depths: OfBlock = [0.0; planes_before(13) * 64];
            depths[of_axis(0, 8)].fill(0.5);
            depths[of_axis(1, 8)].fill(0.5);
            Passed::of_block(8, 1.0, (6, [false; 8]), &depths)
        };
        let mut cover = [0.0; 13];
        (cover[0], cover[1]) = (0.7, 0.32);
        assert_eq!(walls().corrected(&cover).1, 0);
        cover[1] = 0.65;
        assert!(walls().corrected(&cover).1 > 5);
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
            // Half of 65535 parts is rounded by 8e-6, as a share of the half 1.6e-5; a ratio's rounding.
            assert!((passed.areas[0][0] / want - 1.0).abs() < 2e-5, "{}", passed.areas[0][0]);
            assert!((passed.blocked(0, 0) / (want * square) - 1.0).abs() < 2e-5, "{}", passed.blocked(0, 0));
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
        assert_eq!(axis.iter().filter(|t| **t == 0).count(), 64);
        assert_eq!(axis.iter().filter(|t| **t == ALL).count(), 192);
    }

    #[test]
    fn opaque_voxels_remain_opaque() {
        let mut voxels = [0, 100, 250, RATE_MAX].map(|rate| Voxel { rate, ..Voxel::default() });
        scale(&mut voxels, 16);
        assert_eq!(voxels.map(|v| v.rate), [0, 116, 254, RATE_MAX]);
    }
}
