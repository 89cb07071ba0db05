//! Correction of the rates of groups of blocks. Blocks are fitted one by one, but along a ray their transmittances multiply, as
//! if their matter were unrelated. So a sheet that continues from block to block leaks light at each border. Therefore groups of
//! blocks are marched along a lattice of lines, and their rates are scaled so that the group covers the area that was measured;
//! then eight groups at a time form the next larger ones.
//!
//! Based on: G. Loubet, F. Neyret, *Hybrid Mesh-Volume LoDs for All-Scale Pre-Filtering*, EG 2017 (opacity fitted to measured
//! coverage); the law of [`crate::volume::opacity`].

use super::gain_curve::{GainCurve, weighted_median};
use super::group_transmittance::GroupTransmittance;
use crate::simd::multiversioned;
use crate::volume::Voxel;
use crate::volume::chord::LENGTHS;
use crate::volume::voxel::RATE_MAX;

/// Furthest that a correction may be from the median of the corrections that the axes ask for, as a logarithm.
const MAX_FROM_MEDIAN: f32 = 0.1;
/// Step of a rate's code, as a logarithm.
const LOG_RATE_PER_CODE: f32 = std::f32::consts::LN_2 / 16.0;

/// Group whose rates were corrected.
pub struct CorrectedGroup {
    /// Its transmittance after the correction, with [thinned](GroupTransmittance::thin_lines) lines.
    pub transmittance: GroupTransmittance,
    /// Steps by which the codes of its rates have to change.
    pub code_steps: i32,
}

multiversioned! {
    /// Compose the group of `children` (see [`GroupTransmittance::compose`]) and correct its rates so that it covers `cover`,
    /// oblique areas per axis in squares of the cube's edge. `None` where there is no child.
    pub fn correct_group(
        children: &[Option<&GroupTransmittance>; 8],
        solid: [bool; 8],
        cover: &[f64; 13],
    ) -> Option<CorrectedGroup> = compose_and_correct;
}

#[inline(always)]
fn compose_and_correct(
    children: &[Option<&GroupTransmittance>; 8],
    solid: [bool; 8],
    cover: &[f64; 13],
) -> Option<CorrectedGroup> {
    Some(correct_rates(GroupTransmittance::compose(children, solid)?, cover))
}

multiversioned! {
    /// Compose the group of `children` as [`correct_group`] does, without a correction.
    pub fn compose_group(
        children: &[Option<&GroupTransmittance>; 8],
        solid: [bool; 8],
    ) -> Option<GroupTransmittance> = compose_thinned;
}

#[inline(always)]
fn compose_thinned(children: &[Option<&GroupTransmittance>; 8], solid: [bool; 8]) -> Option<GroupTransmittance> {
    GroupTransmittance::compose(children, solid).map(GroupTransmittance::thin_lines)
}

/// Correct the rates of `group`, in whole steps of their codes.
#[inline(always)]
fn correct_rates(group: GroupTransmittance, cover: &[f64; 13]) -> CorrectedGroup {
    let steps = (solve_log_gain(&group, cover) / LOG_RATE_PER_CODE).round();
    // Lines that are left out need not be changed.
    let mut transmittance = group.thin_lines();
    transmittance.apply_log_gain(steps * LOG_RATE_PER_CODE);
    CorrectedGroup { transmittance, code_steps: steps as i32 }
}

/// Logarithm of the gain of the rates at which `group` covers the oblique areas `cover`, in squares of the cube's edge.
///
/// The axes may disagree, since one gain scales them all: what leaks in a sheet's own plane does not close along its normal, and
/// slats hide one another along some axes only. So the gain that the axes ask for together is clamped to within
/// [`MAX_FROM_MEDIAN`] of their median. Then it is shrunk towards 0: by the ratio, at most 1, of the squared standard error of the
/// axes' mean to the squared gain. The shrinkage also keeps random errors in the measured coverage of soft matter from being
/// followed.
#[inline(always)]
pub fn solve_log_gain(group: &GroupTransmittance, cover: &[f64; 13]) -> f32 {
    let (mut want, mut gains, mut slopes) = ([0.0f32; 16], [0.0f32; 16], [0.0f32; 16]);
    for k in 0..13 {
        want[k] = cover[k] as f32 / LENGTHS[k];
    }
    for k in 0..16 {
        let [as_is, up, down] = &group.areas;
        let curve = GainCurve::new([as_is[k], up[k], down[k]]);
        gains[k] = curve.solve(want[k]);
        slopes[k] = if curve.slope > 1e-6 * as_is[k] { curve.slope } else { 0.0 };
    }
    let weight: f32 = slopes.iter().sum();
    if weight <= 0.0 {
        return 0.0;
    }
    let sum = |g: usize| group.areas[g].iter().sum();
    let joint = GainCurve::new([sum(0), sum(1), sum(2)]).solve(want.iter().sum());
    let mut spread = 0.0;
    for k in 0..16 {
        spread += slopes[k] * (gains[k] - joint) * (gains[k] - joint);
    }
    let shrinkage = (spread / weight / (13.0 * joint * joint).max(1e-12)).min(1.0);
    let median = weighted_median(&gains, &slopes);
    joint.clamp(median - MAX_FROM_MEDIAN, median + MAX_FROM_MEDIAN) * (1.0 - shrinkage)
}

/// Multiply the rates of `voxels` by 2^(`code_steps`/16), within the codes of matter that is neither absent nor opaque; opaque
/// voxels remain so.
pub fn scale_rate_codes(voxels: &mut [Voxel], code_steps: i32) {
    for voxel in voxels.iter_mut().filter(|v| v.rate != 0 && v.rate != RATE_MAX) {
        voxel.rate = (i32::from(voxel.rate) + code_steps).clamp(1, i32::from(RATE_MAX) - 1) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::block_lines::{BlockLineValues, axis_lines};
    use crate::bake::gain_curve::MIN_LOG_GAIN;
    use crate::bake::group_transmittance::{MAX_LINES, ONE};
    use crate::geom::projection::squares_before;

    /// Block of 8 lines per edge with these optical depths at c = 1.
    fn block(depths: &BlockLineValues, voxels: usize) -> GroupTransmittance {
        let mut group = GroupTransmittance::from_block(8, 1.0, depths, voxels);
        group.measure_areas();
        group
    }

    /// Block with a wall in the plane x = 0 of opacity `p` along x, and of none along other axes.
    fn wall(p: f32) -> GroupTransmittance {
        let mut depths: BlockLineValues = [0.0; squares_before(13) * 64];
        depths[axis_lines(0, 8)].fill(p);
        block(&depths, 3)
    }

    #[test]
    fn a_wall_in_halves_closes() {
        // Two blocks along a ray, each with half of a wall: 1/4 leaks, where nothing should.
        let halves = [wall(0.5), wall(0.5)];
        let mut children = [None; 8];
        (children[0], children[1]) = (Some(&halves[0]), Some(&halves[1]));
        let compose = || GroupTransmittance::compose(&children, [false; 8]).unwrap();
        assert_eq!(compose().voxels, 6);
        let mut cover = [0.0; 13];
        // They cover a quarter of the group's face, of which 3/4 are found, at gains 1.5 and 1/1.5 15/16 and 5/9. The slope
        // is .191 at first, the harmonic mean, and at last 2 · 3/16 − .191: the last 1/16 is .339 of a trial beyond the first.
        // 1.339 · ln 1.5 = .543 are 12.5 steps of a code.
        cover[0] = 0.25;
        let closed = correct_rates(compose(), &cover);
        assert_eq!(closed.code_steps, 13);
        assert_eq!(closed.transmittance.covered_lines(0, 0), 64.0, "closed");
        cover[0] *= 0.75;
        assert_eq!(correct_rates(compose(), &cover).code_steps, 0, "independent halves are right as they are");
        let least = (MIN_LOG_GAIN / LOG_RATE_PER_CODE).round() as i32;
        assert_eq!(correct_rates(compose(), &[0.0; 13]).code_steps, least);
    }

    #[test]
    fn axes_that_disagree_are_not_followed() {
        // Walls along two axes, of which one should be closed and the other opened.
        let walls = || {
            let mut depths: BlockLineValues = [0.0; squares_before(13) * 64];
            depths[axis_lines(0, 8)].fill(0.5);
            depths[axis_lines(1, 8)].fill(0.5);
            block(&depths, 6)
        };
        let mut cover = [0.0; 13];
        (cover[0], cover[1]) = (0.7, 0.32);
        assert_eq!(correct_rates(walls(), &cover).code_steps, 0);
        cover[1] = 0.65;
        assert!(correct_rates(walls(), &cover).code_steps > 5);
    }

    #[test]
    fn lines_that_are_left_out_change_no_area() {
        let mut group = wall(0.5);
        for level in 1..5 {
            let mut children = [None; 8];
            children[2 * (level & 1)] = Some(&group);
            group = GroupTransmittance::compose(&children, [false; 8]).unwrap();
            assert_eq!(group.lines, (8 << level).min(MAX_LINES));
            let want = 0.5 * 0.25f32.powi(level as i32);
            let square = (group.lines * group.lines) as f32;
            // Half of 65535 units is rounded by 8e-6, as a share of the half 1.6e-5; a ratio's rounding.
            assert!((group.areas[0][0] / want - 1.0).abs() < 2e-5, "{}", group.areas[0][0]);
            let covered = group.covered_lines(0, 0);
            assert!((covered / (want * square) - 1.0).abs() < 2e-5, "{covered}");
            group = group.thin_lines();
        }
    }

    #[test]
    fn solid_children_are_opaque() {
        let half = wall(0.5);
        let mut children = [None; 8];
        children[0] = Some(&half);
        let mut solid = [false; 8];
        solid[1] = true;
        let group = GroupTransmittance::compose(&children, solid).unwrap();
        // Along x: the low quarter of the face is closed, the rest open.
        let axis = &group.at[0][..256];
        assert_eq!(axis.iter().filter(|t| **t == 0).count(), 64);
        assert_eq!(axis.iter().filter(|t| **t == ONE).count(), 192);
    }

    #[test]
    fn opaque_voxels_remain_opaque() {
        let mut voxels = [0, 100, 250, RATE_MAX].map(|rate| Voxel { rate, ..Voxel::default() });
        scale_rate_codes(&mut voxels, 16);
        assert_eq!(voxels.map(|v| v.rate), [0, 116, 254, RATE_MAX]);
    }
}
