//! Rates corrected with the renderer's own march. Blocks are fitted one by one, but along a ray their transmittances
//! multiply, as of unrelated matter: a sheet that goes on from block to block leaks at each border. So groups of blocks are
//! marched along a lattice of lines and compared with what was measured of the group, level by level.
//!
//! Based on: G. Loubet, F. Neyret, *Hybrid Mesh-Volume LoDs for All-Scale Pre-Filtering*, EG 2017 (opacity fitted to measured
//! coverage); the law of [`crate::volume::opacity`].

use super::beams::{PROJECTIONS, axis_length, crossing};
use super::chord::{exp_neg, ln};
use crate::geom::DVec3;
use crate::volume::Voxel;
use crate::volume::voxel::RATE_MAX;

/// Gain of the rates at which a group is marched besides 1.
const TRIAL: f32 = 1.5;
/// How far a level may take rates, as logarithms: less far down, where what is opaque opens faster than the trial can tell.
const LEAST: f32 = -0.05;
const MOST: f32 = 0.6;

/// What comes through a cube of fitted voxels along the lines of all axes, with its rates as they are and times `TRIAL`.
pub struct Passed {
    /// Lines along the cube's edge.
    lines: usize,
    /// Axis by axis, row by row.
    at: [Vec<f32>; 2],
    /// Voxels in the cube.
    pub voxels: usize,
}

/// How many times the square of `Passed::lines` come before axis `k`.
fn start(k: usize) -> usize {
    PROJECTIONS[..k].iter().map(|p| p.extent().0 * p.extent().1).sum()
}

impl Passed {
    /// Of a block with `lines` an edge and the correlation `c`; `depths(k)` are the optical depths of axis `k`.
    pub fn of_block(lines: usize, c: f32, voxels: usize, mut depths: impl FnMut(usize) -> [f32; 256]) -> Passed {
        let room = start(13) * lines * lines;
        let mut at = [Vec::with_capacity(room), Vec::with_capacity(room)];
        let d = 1.0 - c;
        for (k, p) in PROJECTIONS.iter().enumerate() {
            let all = depths(k);
            let all = &all[..p.extent().0 * p.extent().1 * lines * lines];
            for (at, gain) in at.iter_mut().zip([1.0, TRIAL]) {
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

    /// Let nothing through the box `lo..hi` of the cube.
    pub fn close(&mut self, lo: DVec3, hi: DVec3) {
        let n = self.lines;
        for (k, p) in PROJECTIONS.iter().enumerate() {
            let (wa, wb) = p.extent();
            let middle = |i: usize| (i as f64 + 0.5) / n as f64;
            for y in 0..wb * n {
                for x in 0..wa * n {
                    if crossing(k, middle(x), middle(y), lo, hi).is_some() {
                        let line = start(k) * n * n + y * wa * n + x;
                        self.at.iter_mut().for_each(|at| at[line] = 0.0);
                    }
                }
            }
        }
    }

    /// Of the cube of up to eight, in child order; of those that are `solid`, nothing comes through. `None` if none is known.
    pub fn unite(children: &[Option<&Passed>; 8], solid: [bool; 8]) -> Option<Group> {
        let known = children.iter().flatten().next()?;
        let (small, lines) = (known.lines, 2 * known.lines);
        let room = start(13) * lines * lines;
        let mut whole = Passed {
            lines,
            at: [vec![1.0; room], vec![1.0; room]],
            voxels: children.iter().flatten().map(|c| c.voxels).sum(),
        };
        let mut alone = [0.0f32; 13];
        for (j, child) in children.iter().enumerate() {
            let closed = if solid[j] {
                let mut closed = Passed { lines: small, at: Default::default(), voxels: 0 };
                closed.at = [vec![1.0; start(13) * small * small], vec![1.0; start(13) * small * small]];
                closed.close(DVec3::ZERO, DVec3::ONE);
                Some(closed)
            } else {
                None
            };
            let Some(child) = child.or(closed.as_ref()).filter(|c| c.lines == small) else { continue };
            for (k, p) in PROJECTIONS.iter().enumerate() {
                let (wa, wb) = p.extent();
                let (oa, ob) = p.child_offset(j);
                for y in 0..wb * small {
                    let from = start(k) * small * small + y * wa * small;
                    let to = start(k) * lines * lines + (ob * small + y) * wa * lines + oa * small;
                    for (whole, at) in whole.at.iter_mut().zip(&child.at) {
                        for (whole, passes) in whole[to..to + wa * small].iter_mut().zip(&at[from..from + wa * small]) {
                            *whole *= passes;
                        }
                    }
                    alone[k] += child.at[0][from..from + wa * small].iter().map(|passes| 1.0 - passes).sum::<f32>();
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
    /// whole, where `parts` is the sum of its children's. What comes through is changed accordingly.
    pub fn refine(&mut self, cover: &[f64; 13], parts: &[f64; 13]) -> f32 {
        let n = self.whole.lines;
        let (mut want, mut got) = (0.0, [0.0f32; 2]);
        for (k, p) in PROJECTIONS.iter().enumerate() {
            if parts[k] <= 0.0 || self.alone[k] <= 0.0 {
                continue;
            }
            let weight = (parts[k] / axis_length(k)) as f32;
            want += weight * (cover[k] / parts[k]).clamp(0.0, 1.0) as f32;
            let range = start(k) * n * n..(start(k) + p.extent().0 * p.extent().1) * n * n;
            for (got, at) in got.iter_mut().zip(&self.whole.at) {
                *got += weight * at[range.clone()].iter().map(|passes| 1.0 - passes).sum::<f32>() / self.alone[k];
            }
        }
        let slope = (got[1] - got[0]) / ln(TRIAL);
        if slope <= 1e-6 * got[0] {
            return 0.0;
        }
        let log = ((want - got[0]) / slope).clamp(LEAST, MOST);
        let share = log / ln(TRIAL);
        let [first, second] = &mut self.whole.at;
        for (a, b) in first.iter_mut().zip(second) {
            let change = (*b - *a) * share;
            (*a, *b) = ((*a + change).clamp(0.0, 1.0), (*b + change).clamp(0.0, 1.0));
        }
        log
    }
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
        assert!((log - 4.0 / 3.0 * 1.5f32.ln()).abs() < 1e-5, "{log}");
        let unrelated = cover.map(|c| 0.75 * c);
        let mut group = Passed::unite(&children, [false; 8]).unwrap();
        assert!(group.refine(&unrelated, &parts).abs() < 1e-6, "independent halves are right as they are");
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
