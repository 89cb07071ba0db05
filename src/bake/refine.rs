//! Rates corrected with the renderer's own march. Blocks are fitted one by one, but along a ray their transmittances
//! multiply, as of unrelated matter: a sheet that goes on from block to block leaks at each border. So groups of blocks are
//! marched along a lattice of lines and compared with what was measured of the group, level by level.
//!
//! Based on: G. Loubet, F. Neyret, *Hybrid Mesh-Volume LoDs for All-Scale Pre-Filtering*, EG 2017 (opacity fitted to measured
//! coverage); the law of [`crate::volume::opacity`].

use std::sync::OnceLock;

use super::beams::{PROJECTIONS, axis_length, crossing};
use super::chord::{exp_neg, ln};
use crate::geom::DVec3;
use crate::volume::Voxel;
use crate::volume::voxel::RATE_MAX;

/// Gains of the rates at which a group is marched: as they are, more and less; steps are interpolated between them.
const GAINS: [f32; 3] = [1.0, TRIAL, 1.0 / TRIAL];
const TRIAL: f32 = 1.5;
/// How far a level may take rates, as logarithms: down no farther than was tried, since what is opaque opens faster than that.
const LEAST: f32 = -0.4;
const MOST: f32 = 0.6;
/// Wishes that small are left alone, and larger ones by that much smaller: blocks were measured no better than that. A step of
/// a rate is .043. Without it, thin strands and soft media lose more than surfaces gain.
const QUIET: f32 = 0.04;
/// Levels of a group's lines, doubled from one a cube's edge.
const SIZES: usize = 12;

/// What comes through a cube of fitted voxels along the lines of all axes, at each of the `GAINS`.
pub struct Passed {
    /// Lines along the cube's edge, a power of two.
    lines: usize,
    /// Axis by axis, row by row.
    at: [Vec<f32>; GAINS.len()],
    /// Voxels in the cube.
    pub voxels: usize,
}

/// How many times the square of `Passed::lines` come before axis `k`.
fn start(k: usize) -> usize {
    PROJECTIONS[..k].iter().map(|p| p.extent().0 * p.extent().1).sum()
}

/// For each of the lines of a cube with `lines` an edge, whether it meets the cube: 0, or misses it: 1.
fn misses(lines: usize) -> &'static [f32] {
    static KNOWN: [OnceLock<Vec<f32>>; SIZES] = [const { OnceLock::new() }; SIZES];
    KNOWN[lines.ilog2() as usize].get_or_init(|| {
        let middle = |i: usize| (i as f64 + 0.5) / lines as f64;
        let mut at = Vec::with_capacity(start(13) * lines * lines);
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

impl Passed {
    /// Of a block with `lines` an edge and the correlation `c`; `depths(k)` are the optical depths of axis `k`.
    pub fn of_block(lines: usize, c: f32, voxels: usize, mut depths: impl FnMut(usize) -> [f32; 256]) -> Passed {
        let room = start(13) * lines * lines;
        let mut at = GAINS.map(|_| Vec::with_capacity(room));
        let d = 1.0 - c;
        for (k, p) in PROJECTIONS.iter().enumerate() {
            let all = depths(k);
            let all = &all[..p.extent().0 * p.extent().1 * lines * lines];
            for (at, gain) in at.iter_mut().zip(GAINS) {
                if d < 1e-3 {
                    at.extend(all.iter().map(|tau| (1.0 - gain * tau).max(0.0)));
                } else {
                    // T = (E − c) / (1 − c), E = e^−(1−c)τ.
                    at.extend(all.iter().map(|tau| ((exp_neg(d * gain * tau) - c) / d).max(0.0)));
                }
            }
        }
        Passed { lines, at, voxels }
    }

    /// Multiply what comes through by that of the child `j`, which has half the lines: at the gain `g`, `of(g)`.
    fn cover<'a>(&mut self, j: usize, of: impl Fn(usize) -> &'a [f32]) {
        let (lines, small) = (self.lines, self.lines / 2);
        for (k, p) in PROJECTIONS.iter().enumerate() {
            let (wa, wb) = p.extent();
            let (oa, ob) = p.child_offset(j);
            for y in 0..wb * small {
                let from = start(k) * small * small + y * wa * small;
                let to = start(k) * lines * lines + (ob * small + y) * wa * lines + oa * small;
                for (g, at) in self.at.iter_mut().enumerate() {
                    for (whole, passes) in at[to..to + wa * small].iter_mut().zip(&of(g)[from..from + wa * small]) {
                        *whole *= passes;
                    }
                }
            }
        }
    }

    /// Let nothing through the octant `j`.
    pub fn close(&mut self, j: usize) {
        let closed = misses(self.lines / 2);
        self.cover(j, |_| closed);
    }

    /// What an axis blocks, in lines.
    fn blocked(&self, k: usize, gain: usize) -> f32 {
        let (wa, wb) = PROJECTIONS[k].extent();
        let square = self.lines * self.lines;
        self.at[gain][start(k) * square..(start(k) + wa * wb) * square].iter().map(|passes| 1.0 - passes).sum()
    }

    /// Of the cube of up to eight, in child order; of those that are `solid`, nothing comes through. `None` if none is known.
    pub fn unite(children: &[Option<&Passed>; 8], solid: [bool; 8]) -> Option<Group> {
        let small = children.iter().flatten().next()?.lines;
        let lines = 2 * small;
        let mut whole = Passed {
            lines,
            at: GAINS.map(|_| vec![1.0; start(13) * lines * lines]),
            voxels: children.iter().flatten().map(|c| c.voxels).sum(),
        };
        let mut alone = [0.0f32; 13];
        for (j, child) in children.iter().enumerate() {
            if let Some(child) = child.filter(|c| c.lines == small) {
                whole.cover(j, |g| &child.at[g]);
                (0..13).for_each(|k| alone[k] += child.blocked(k, 0));
            } else if solid[j] {
                whole.close(j);
                let shadow = misses(small);
                for (k, p) in PROJECTIONS.iter().enumerate() {
                    let range = start(k) * small * small..(start(k) + p.extent().0 * p.extent().1) * small * small;
                    alone[k] += shadow[range].iter().map(|misses| 1.0 - misses).sum::<f32>();
                }
            }
        }
        Some(Group { whole, alone })
    }
}

/// Blocks side by side.
pub struct Group {
    pub whole: Passed,
    /// What they block one by one, summed, an axis; in lines.
    alone: [f32; 13],
}

impl Group {
    /// The logarithm of what the rates are to be multiplied by, so that the group covers what was measured: `cover` of the
    /// whole, where `parts` is the sum of its children's. What comes through is changed accordingly. Axes may disagree, since
    /// one factor scales them all: what leaks in a sheet's own plane does not close along its normal. The median is taken, which
    /// a few axes that ask for much do not move.
    pub fn refine(&mut self, cover: &[f64; 13], parts: &[f64; 13]) -> f32 {
        let mut wishes = Vec::with_capacity(13); // (logarithm, weight)
        for k in 0..13 {
            if parts[k] <= 0.0 || self.alone[k] <= 0.0 {
                continue;
            }
            let weight = (parts[k] / axis_length(k)) as f32;
            let want = (cover[k] / parts[k]).clamp(0.0, 1.0) as f32;
            let got: [f32; 3] = std::array::from_fn(|g| self.whole.blocked(k, g) / self.alone[k]);
            let slope = (got[if want > got[0] { 1 } else { 2 }] - got[0]).abs() / ln(TRIAL);
            if slope > 1e-6 * got[0] {
                wishes.push(((want - got[0]) / slope, weight * slope));
            }
        }
        let log = median(&mut wishes);
        let more = log > 0.0;
        let log = (log.abs() - QUIET).max(0.0).copysign(log).clamp(LEAST, MOST);
        let share = log / ln(TRIAL);
        let [as_is, up, down] = &mut self.whole.at;
        for ((as_is, up), down) in as_is.iter_mut().zip(up).zip(down) {
            let change = share * if more { *up - *as_is } else { *as_is - *down };
            for passes in [as_is, up, down] {
                *passes = (*passes + change).clamp(0.0, 1.0);
            }
        }
        log
    }
}

/// The weighted median of `(value, weight)`; 0 of none.
fn median(of: &mut [(f32, f32)]) -> f32 {
    of.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut left = 0.5 * of.iter().map(|w| w.1).sum::<f32>();
    let middle = of.iter().find(|w| {
        left -= w.1;
        left <= 0.0
    });
    middle.map_or(0.0, |w| w.0)
}

/// Multiply the rates of voxels by e^`log`; what is opaque remains so.
pub fn scale(voxels: &mut [Voxel], log: f32) {
    let steps = (16.0 * log / std::f32::consts::LN_2).round() as i32;
    for voxel in voxels.iter_mut().filter(|v| v.rate != 0 && v.rate != RATE_MAX) {
        voxel.rate = (i32::from(voxel.rate) + steps).clamp(1, i32::from(RATE_MAX) - 1) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What comes through a wall in the plane x = 0 of share `p` in each line along x, and of nothing along others.
    fn wall(p: f32) -> Passed {
        Passed::of_block(8, 1.0, 3, |k| if k == 0 { [p; 256] } else { [0.0; 256] })
    }

    #[test]
    fn a_wall_in_halves_closes() {
        // Two blocks one behind the other, each with half of a wall: 1/4 leaks, where nothing should.
        let halves = [wall(0.5), wall(0.5)];
        let mut children = [None; 8];
        (children[0], children[1]) = (Some(&halves[0]), Some(&halves[1]));
        let mut group = Passed::unite(&children, [false; 8]).unwrap();
        assert_eq!(group.whole.voxels, 6);
        let (mut cover, mut parts) = ([0.0; 13], [0.0; 13]);
        // Each covers half of a quarter of the group's face; together they cover the quarter.
        (cover[0], parts[0]) = (0.25, 0.25);
        let log = group.refine(&cover, &parts);
        // (1 − .75)^2 = 1/16 leaks at gain 1.5: a step of .25 / (3/16) · ln 1.5 is asked for.
        assert!((log - (4.0 / 3.0 * 1.5f32.ln() - QUIET)).abs() < 1e-5, "{log}");
        let unrelated = cover.map(|c| 0.75 * c);
        let mut group = Passed::unite(&children, [false; 8]).unwrap();
        assert!(group.refine(&unrelated, &parts).abs() < 1e-6, "independent halves are right as they are");
    }

    #[test]
    fn most_axes_are_heard() {
        assert_eq!(median(&mut [(0.5, 1.0), (-0.2, 3.0), (0.1, 2.5)]), 0.1);
        assert_eq!(median(&mut [(0.5, 1.0), (0.0, 3.0)]), 0.0);
        assert_eq!(median(&mut []), 0.0);
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
        let axis = &group.whole.at[0][..256];
        assert_eq!(axis.iter().filter(|t| **t == 0.0).count(), 64);
        assert_eq!(axis.iter().filter(|t| **t == 1.0).count(), 192);
    }

    #[test]
    fn opaque_voxels_remain_opaque() {
        let mut voxels = [0, 100, 250, RATE_MAX].map(|rate| Voxel { rate, ..Voxel::default() });
        scale(&mut voxels, 2.0f32.ln());
        assert_eq!(voxels.map(|v| v.rate), [0, 116, 254, RATE_MAX]);
    }
}
