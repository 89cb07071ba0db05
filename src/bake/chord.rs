//! How much a box of uniform matter blocks along an axis: the law of opacity averaged over the box's chords.
//!
//! Based on: the chord-length distribution of a convex body along a direction is minus the derivative of its covariogram
//! (Matheron, *Random Sets and Integral Geometry*, 1975); a box's covariogram is the product of three ramps.

use super::beams::axis_length;
use crate::geom::{AXES13, DVec3};
use crate::volume::opacity;

/// Chords of a box along one axis. The share longer than s is 1 − b s + d s², up to the longest.
#[derive(Debug, Clone, Copy)]
pub struct Chords {
    b: f64,
    d: f64,
    longest: f64,
    pub mean: f64,
}

/// Largest rate that is asked for, hits per voxel edge.
pub const MAX_RATE: f64 = 118.0;

/// Gauss-Legendre nodes and weights on [0, 1], four points.
const GAUSS: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];

impl Chords {
    /// Of a box with edges `e` > 0 along axis `k`.
    pub fn new(k: usize, e: DVec3) -> Chords {
        let w = DVec3::new(f64::from(AXES13[k][0]), f64::from(AXES13[k][1]), f64::from(AXES13[k][2]));
        let q = w.abs() / (e * axis_length(k));
        let sum = q.element_sum();
        Chords {
            b: 2.0 * (q.x * q.y + q.x * q.z + q.y * q.z) / sum,
            d: 3.0 * q.x * q.y * q.z / sum,
            longest: 1.0 / q.max_element(),
            mean: 1.0 / sum,
        }
    }

    /// Share of the lines through the box that matter of rate `r` and correlation `c` blocks.
    pub fn blocked(&self, r: f64, c: f64) -> f64 {
        if c > 0.999 {
            let m = self.longest.min(1.0 / r);
            return r * m * (1.0 - m * (0.5 * self.b - m * self.d / 3.0));
        }
        let k = (1.0 - c) * r;
        let a = c / (1.0 - c);
        if self.b == 0.0 {
            return 1.0 - opacity::advance_f64(1.0, r * self.longest, c);
        }
        // T = (1 + a) e^−ks − a until it is 0; beyond 12 / k what is left is below 1e-5.
        let zero = if c > 0.0 { libm::log((1.0 + a) / a) / k } else { f64::INFINITY };
        let m = self.longest.min(zero).min(12.0 / k);
        let sum: f64 = GAUSS
            .iter()
            .map(|&(x, w)| {
                let s = x * m;
                w * f64::from(exp_neg((k * s) as f32)) * (1.0 - s * (self.b - s * self.d))
            })
            .sum();
        (1.0 + a) * k * m * sum
    }

    /// The rate with which the box blocks the share `p` in [0, 1) of its lines, at most 118.
    pub fn rate(&self, p: f64, c: f64) -> f64 {
        if p <= 0.0 {
            return 0.0;
        }
        let want = opacity::depth_for(1.0 - p, c);
        let mut r = (want / self.mean).min(MAX_RATE);
        if self.b == 0.0 {
            return r;
        }
        // Secant steps on log depth over log r, whose slope is 1 while little is blocked and falls towards opaque.
        let (goal, most) = (libm::log(want), libm::log(MAX_RATE));
        let mut x = libm::log(r);
        let mut last: Option<(f64, f64)> = None;
        for _ in 0..8 {
            let y = libm::log(opacity::depth_for((1.0 - self.blocked(r, c)).max(1e-9), c));
            let slope = last.map_or(1.0, |(x0, y0)| (y - y0) / (x - x0));
            let slope = if slope > 0.02 { slope.min(1.0) } else { 0.02 };
            last = Some((x, y));
            let next = (x + (goal - y) / slope).min(most);
            let done = (next - x).abs() < 0.01;
            x = next;
            r = libm::exp(x);
            if done {
                break;
            }
        }
        r
    }
}

/// e^−x for x ≥ 0, to 1e-5: Taylor's series at x/64 and six squarings; no library's exp, so the same everywhere.
#[inline]
pub fn exp_neg(x: f32) -> f32 {
    let y = -x.min(40.0) / 64.0;
    let mut e = 1.0 + y * (1.0 + y * (0.5 + y * (1.0 / 6.0 + y * (1.0 / 24.0))));
    for _ in 0..6 {
        e *= e;
    }
    e
}

#[cfg(test)]
mod tests {
    use super::super::beams::{PROJECTIONS, crossing};
    use super::*;

    #[test]
    fn agrees_with_lines_through_a_box() {
        let e = DVec3::new(0.9, 0.5, 0.25);
        for (k, p) in PROJECTIONS.iter().enumerate() {
            let (wa, wb) = p.extent();
            let chords = Chords::new(k, e);
            for (r, c) in [(0.5, 0.0), (2.0, 0.5), (3.0, 1.0), (9.0, 0.2), (20.0, 0.9)] {
                let (mut n, mut sum) = (0, 0.0);
                for j in 0..200 * wb {
                    for i in 0..200 * wa {
                        let at = |v: usize| (v as f64 + 0.5) / 200.0;
                        if let Some((from, to)) = crossing(k, at(i), at(j), DVec3::ZERO, e) {
                            n += 1;
                            sum += 1.0 - opacity::advance_f64(1.0, r * (to - from) * axis_length(k), c);
                        }
                    }
                }
                // 200 lines an edge: the rim is wrong by half a line, under .5 % of the lines; Gauss on e^−12 by 1e-2.
                let p = chords.blocked(r, c);
                assert!((p - sum / f64::from(n)).abs() < 0.012, "{k} {r} {c}: {p} {}", sum / f64::from(n));
                // Steps end within 1 % of the rate or less, which near opaque is far less in what is blocked.
                let back = chords.blocked(chords.rate(p, c), c);
                assert!((back - p).abs() < 2e-3, "{k} {r} {c}: {p} {back}");
            }
        }
    }

    #[test]
    fn exp_neg_is_exp() {
        for i in 0..400 {
            let x = i as f32 * 0.1;
            assert!((exp_neg(x) - (-x).exp()).abs() < 2e-5, "{x}");
        }
    }
}
