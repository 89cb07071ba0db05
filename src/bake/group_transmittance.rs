//! Transmittance of a group of fitted blocks along a lattice of lines of all 13 axes, at three gains of the group's rates.
//!
//! A group is a cube of blocks, one block at first and then eight groups at a time. Within a block its lines follow the law of
//! [`crate::volume::opacity`]; the transmittances of blocks multiply, as the renderer multiplies them.

use std::sync::OnceLock;

use super::block_lines::{BlockLineValues, TILE_LINES, axis_lines, line_position};
use super::gain_curve::{CurvePosition, GAINS, GainCurve};
use crate::geom::projection::{PROJECTIONS, child_offset, crossing, squares_before};
use crate::geom::{DVec3, axis_length, box_area, larger};
use crate::volume::chord::{FULL_CORRELATION, LENGTHS, Lanes, exp_neg};

/// Largest number of lines along a group's edge: in larger groups every other line is left out. With half as many lines a sheet
/// leaks (FLIP .052 instead of .044) and a tree covers 1.5 % more. The certificate does not show that, since it compares blocks.
pub const MAX_LINES: usize = 32;
/// Number of lines that are handled at once. Each axis has a multiple of it, except in the smallest blocks.
const BATCH: usize = 16;
/// Number of powers of two that a number of lines per edge may be.
const SIZES: usize = 12;

/// Transmittance of a line, in units of 1 / [`ONE`]. It is half as wide as an f32, since a group's lines do not fit into the L1
/// cache as f32, and its step is still far smaller than what a step of a rate's code changes.
pub type Transmittance16 = u16;
/// Transmittance of a free line.
pub const ONE: Transmittance16 = Transmittance16::MAX;

/// Nearest [`Transmittance16`] of a transmittance that is already scaled to 0 … [`ONE`].
#[inline(always)]
fn quantize(scaled: f32) -> Transmittance16 {
    // At this magnitude the last bit of an f32 is worth 1, so the addition rounds to a whole number.
    const ROUND: f32 = 12_582_912.0;
    (scaled + ROUND).to_bits() as Transmittance16
}

/// Product of two transmittances: exact where one of them is 0 or 1, and up to one unit too large elsewhere.
#[inline(always)]
fn mul_transmittance(a: Transmittance16, b: Transmittance16) -> Transmittance16 {
    let high = ((u32::from(a) * u32::from(b)) >> 16) as Transmittance16;
    (high + 1).min(a).min(b)
}

/// `count` lines of the transmittance `value` at each of [`GAINS`].
fn uniform_lines(count: usize, value: Transmittance16) -> [Vec<Transmittance16>; GAINS.len()] {
    [vec![value; count], vec![value; count], vec![value; count]]
}

/// Transmittance of a cube of fitted voxels along the lines of all axes, at each of [`GAINS`].
pub struct GroupTransmittance {
    /// Number of lines along the cube's edge, a power of two.
    pub lines: usize,
    /// Transmittance by gain: axis by axis, and within an axis tile by tile as in [`super::block_lines`].
    pub at: [Vec<Transmittance16>; GAINS.len()],
    /// Area that is covered along each axis, by gain, in squares of the cube's edge. It is more exact than what `at` would give where
    /// lines were left out.
    pub areas: [Lanes; GAINS.len()],
    /// Number of voxels in the cube.
    pub voxels: usize,
}

/// Silhouettes of a full cube along all axes.
struct CubeSilhouette {
    /// Transmittance of each line: 0 where it meets the cube, else [`ONE`].
    lines: Vec<Transmittance16>,
    /// Number of lines that meet the cube, per axis.
    covered: [f32; 13],
}

impl CubeSilhouette {
    /// Silhouettes with `lines` lines per edge, a power of two. Each is found once.
    fn new(lines: usize) -> &'static CubeSilhouette {
        static KNOWN: [OnceLock<CubeSilhouette>; SIZES] = [const { OnceLock::new() }; SIZES];
        KNOWN[lines.ilog2() as usize].get_or_init(|| {
            let middle = |i: usize| (i as f64 + 0.5) / lines as f64;
            let room = squares_before(13) * lines * lines;
            let mut silhouette = CubeSilhouette { lines: Vec::with_capacity(room), covered: [0.0; 13] };
            for (k, p) in PROJECTIONS.iter().enumerate() {
                let (wa, wb) = p.extent();
                for n in 0..wa * wb * lines * lines {
                    let (x, y) = line_position(n, wa * lines);
                    let met = crossing(k, middle(x), middle(y), DVec3::ZERO, DVec3::ONE).is_some();
                    silhouette.lines.push(if met { 0 } else { ONE });
                    silhouette.covered[k] += if met { 1.0 } else { 0.0 };
                }
            }
            silhouette
        })
    }
}

impl GroupTransmittance {
    /// Transmittance of a block of `voxels` voxels with `lines` lines per edge, the correlation `c` in [0, 1] and these optical
    /// `depths`.
    #[inline(always)]
    pub fn from_block(lines: usize, c: f32, depths: &BlockLineValues, voxels: usize) -> GroupTransmittance {
        let count = (squares_before(13) * lines * lines).next_multiple_of(BATCH);
        let depths = depths[..count].as_chunks::<BATCH>().0;
        let mut at = uniform_lines(depths.len() * BATCH, 0);
        let [as_is, up, down] = &mut at;
        let chunks = as_is.as_chunks_mut::<BATCH>().0.iter_mut();
        let chunks = chunks.zip(up.as_chunks_mut::<BATCH>().0).zip(down.as_chunks_mut::<BATCH>().0);
        let d = 1.0 - c;
        // T = (E − c) / (1 − c) with E = e^−(1−c)τ. The gains 1, 3/2 and 2/3 make E powers of one exponential: its sixth, ninth
        // and fourth.
        let one = f32::from(ONE);
        let (factor, offset) = (one / d, one * c / d);
        for (((as_is, up), down), depths) in chunks.zip(depths) {
            for n in 0..BATCH {
                if c > FULL_CORRELATION {
                    as_is[n] = quantize(larger(one - one * GAINS[0] * depths[n], 0.0));
                    up[n] = quantize(larger(one - one * GAINS[1] * depths[n], 0.0));
                    down[n] = quantize(larger(one - one * GAINS[2] * depths[n], 0.0));
                } else {
                    let e = exp_neg(d * depths[n] * (1.0 / 6.0));
                    let (square, cube) = (e * e, e * e * e);
                    as_is[n] = quantize(larger(square * square * square * factor - offset, 0.0));
                    up[n] = quantize(larger(cube * cube * cube * factor - offset, 0.0));
                    down[n] = quantize(larger(square * square * factor - offset, 0.0));
                }
            }
        }
        GroupTransmittance { lines, at, areas: Default::default(), voxels }
    }

    /// Find [`GroupTransmittance::areas`] from the lines.
    #[inline(always)]
    pub fn measure_areas(&mut self) {
        let square = self.lines * self.lines;
        for g in 0..GAINS.len() {
            for k in 0..13 {
                self.areas[g][k] = self.covered_lines(k, g) / (square as f32 * LENGTHS[k]);
            }
        }
    }

    /// Multiply the transmittances along the axis `k` at the gain `g` by those of the child `j`, `child`, which has half as many
    /// lines per edge.
    #[inline(always)]
    fn composite_child(&mut self, j: usize, k: usize, g: usize, child: &[Transmittance16]) {
        let (lines, small, p) = (self.lines, self.lines / 2, &PROJECTIONS[k]);
        let (wa, wb) = p.extent();
        let (oa, ob) = child_offset(k, j);
        // A row of tiles has two lines of each column.
        let (row, column) = (2 * wa * lines, 2 * oa * small);
        let (Some(child), Some(at)) = (child.get(axis_lines(k, small)), self.at[g].get_mut(axis_lines(k, lines)))
        else {
            return;
        };
        let half = small / 2;
        let Some(at) = at.get_mut(ob * half * row..(ob + wb) * half * row) else { return };
        // A child has at most MAX_LINES / 2 lines per edge, a power of two, and its widest projections are twice as wide.
        const { assert!(MAX_LINES == 32) };
        match 2 * wa * small {
            64 => multiply_rows::<64>(at, child, row, column),
            32 => multiply_rows::<32>(at, child, row, column),
            16 => multiply_rows::<16>(at, child, row, column),
            8 => multiply_rows::<8>(at, child, row, column),
            _ => multiply_rows::<4>(at, child, row, column),
        }
    }

    /// Make the octant `j` opaque.
    #[inline(always)]
    pub fn occlude_octant(&mut self, j: usize) {
        let silhouette = CubeSilhouette::new(self.lines / 2);
        for k in 0..13 {
            for g in 0..GAINS.len() {
                self.composite_child(j, k, g, &silhouette.lines);
            }
        }
    }

    /// Number of lines that are covered along the axis `k` at the gain `g`: the sum of their opacities.
    #[inline(always)]
    pub fn covered_lines(&self, k: usize, g: usize) -> f32 {
        let lines = &self.at[g][axis_lines(k, self.lines)];
        let mut sum = 0;
        for &transmittance in lines {
            sum += u32::from(transmittance);
        }
        // At most four squares of MAX_LINES² lines, so the sum fits.
        (lines.len() as u32 * u32::from(ONE) - sum) as f32 * (1.0 / ONE as f32)
    }

    /// The same group with half as many lines per edge, in a quincunx pattern, if its parent would otherwise have more than
    /// [`MAX_LINES`].
    #[inline(always)]
    pub fn thin_lines(self) -> GroupTransmittance {
        if self.lines <= MAX_LINES / 2 {
            return self;
        }
        let (lines, half) = (self.lines, self.lines / 2);
        let mut at = uniform_lines(squares_before(13) * half * half, 0);
        for (at, all) in at.iter_mut().zip(&self.at) {
            for (k, p) in PROJECTIONS.iter().enumerate() {
                // One line of the first row of each tile is kept: the first one in even rows of tiles, the second in odd ones.
                let across = p.extent().0 * half;
                let rows = all[axis_lines(k, lines)].as_chunks::<TILE_LINES>().0.chunks_exact(2 * across);
                let kept = at[axis_lines(k, half)].as_chunks_mut::<TILE_LINES>().0.chunks_exact_mut(across / 2);
                for (rows, kept) in rows.zip(kept) {
                    let (even, odd) = rows.split_at(across);
                    let tiles = even.as_chunks::<2>().0.iter().zip(odd.as_chunks::<2>().0);
                    for (kept, (even, odd)) in kept.iter_mut().zip(tiles) {
                        *kept = [even[0][0], even[1][0], odd[0][1], odd[1][1]];
                    }
                }
            }
        }
        GroupTransmittance { lines: half, at, areas: self.areas, voxels: self.voxels }
    }

    /// Transmittance of the cube of up to eight groups, in child order, whose lines are [thinned](Self::thin_lines); children that
    /// are `solid` are opaque cubes. `None` where there is no group.
    #[inline(always)]
    pub fn compose(children: &[Option<&GroupTransmittance>; 8], solid: [bool; 8]) -> Option<GroupTransmittance> {
        let small = children.iter().flatten().next()?.lines;
        let lines = 2 * small;
        let mut whole = GroupTransmittance {
            lines,
            at: uniform_lines(squares_before(13) * lines * lines, ONE),
            areas: Default::default(),
            voxels: children.iter().flatten().map(|c| c.voxels).sum(),
        };
        let children = children.map(|child| child.filter(|c| c.lines == small));
        let silhouette = CubeSilhouette::new(small);
        // Plane by plane, so that each stays in the nearest cache while all children are multiplied into it.
        for g in 0..GAINS.len() {
            for k in 0..13 {
                // Sums over the children of what each covers: in well known areas, and in lines.
                let (mut areas, mut covered) = (0.0, 0.0);
                for (j, child) in children.iter().enumerate() {
                    if let Some(child) = child {
                        whole.composite_child(j, k, g, &child.at[g]);
                        areas += 0.25 * child.areas[g][k];
                        covered += child.covered_lines(k, g);
                    } else if solid[j] {
                        whole.composite_child(j, k, g, &silhouette.lines);
                        areas += 0.25 * (box_area(k, DVec3::ONE) / axis_length(k)) as f32;
                        covered += silhouette.covered[k];
                    }
                }
                whole.areas[g][k] = if covered > 0.0 { areas * whole.covered_lines(k, g) / covered } else { areas };
            }
        }
        Some(whole)
    }

    /// Change the transmittances and areas to those of rates that are e^`log_gain` times as large, by interpolation.
    #[inline(always)]
    pub fn apply_log_gain(&mut self, log_gain: f32) {
        if log_gain == 0.0 {
            return;
        }
        let positions = CurvePosition::of_gains(log_gain);
        let [as_is, up, down] = &mut self.at;
        let at = as_is.as_chunks_mut::<BATCH>().0.iter_mut();
        for ((as_is, up), down) in at.zip(up.as_chunks_mut::<BATCH>().0).zip(down.as_chunks_mut::<BATCH>().0) {
            for n in 0..BATCH {
                let curve = GainCurve::new([as_is[n], up[n], down[n]].map(f32::from));
                as_is[n] = quantize(curve.value(&positions[0]).clamp(0.0, f32::from(ONE)));
                up[n] = quantize(curve.value(&positions[1]).clamp(0.0, f32::from(ONE)));
                down[n] = quantize(curve.value(&positions[2]).clamp(0.0, f32::from(ONE)));
            }
        }
        let [as_is, up, down] = &mut self.areas;
        for k in 0..16 {
            let curve = GainCurve::new([as_is[k], up[k], down[k]]);
            as_is[k] = larger(curve.value(&positions[0]), 0.0);
            up[k] = larger(curve.value(&positions[1]), 0.0);
            down[k] = larger(curve.value(&positions[2]), 0.0);
        }
    }
}

/// Multiply the rows of `at`, which are `wide` lines long, from their column `from` on by the rows of `by`, which are `N` long.
#[inline(always)]
fn multiply_rows<const N: usize>(at: &mut [Transmittance16], by: &[Transmittance16], wide: usize, from: usize) {
    for (row, by) in at.chunks_exact_mut(wide).zip(by.as_chunks::<N>().0) {
        let Some(row) = row.get_mut(from..).and_then(|row| row.first_chunk_mut::<N>()) else { continue };
        // The product is a new array, so that the compiler need not assume that it overlaps an operand.
        let mut product = [0; N];
        for n in 0..N {
            product[n] = mul_transmittance(row[n], by[n]);
        }
        *row = product;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transmittances_multiply() {
        for a in (0..=ONE).step_by(251) {
            let products = [
                mul_transmittance(a, ONE),
                mul_transmittance(ONE, a),
                mul_transmittance(a, 0),
                mul_transmittance(0, a),
            ];
            assert_eq!(products, [a, a, 0, 0]);
            for b in (0..=ONE).step_by(257) {
                let want = f64::from(a) * f64::from(b) / f64::from(ONE);
                let got = f64::from(mul_transmittance(a, b));
                assert!(got > want - 1.0 && got <= want + 1.0, "{a} {b}: {got} {want}");
            }
            assert_eq!(quantize(f32::from(a) + 0.25), a);
        }
    }
}
