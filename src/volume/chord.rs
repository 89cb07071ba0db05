//! Opacity of a box of uniform matter along the 13 axes: the law of [`opacity`](crate::volume::opacity), averaged over the
//! box's chords, for all axes at once.
//!
//! Based on: the chord-length distribution of a convex body along a direction is minus the derivative of its covariogram
//! (Matheron, *Random Sets and Integral Geometry*, 1975); a box's covariogram is the product of three ramps.

use crate::geom::axis_length;
use crate::geom::{AXES13, DVec3, larger, smaller};

/// One value per axis. The last three lanes belong to no axis; they fill up to a multiple of the SIMD width.
pub type Lanes = [f32; 16];

/// Distribution of a box's chords along each axis: the share of chords longer than s is 1 − b s + d s², up to `longest`.
#[derive(Debug, Clone, Copy)]
pub struct Chords {
    b: Lanes,
    d: Lanes,
    longest: Lanes,
    /// Reciprocal of the mean chord, which is also the rate of faint matter per unit of its opacity.
    pub inverse_mean: Lanes,
}

/// Absolute coordinates of the axes as unit vectors, by coordinate. The unused lanes repeat the first axis, so that every box
/// has chords there and no lane divides by 0.
const ABS_DIRECTION: [Lanes; 3] = abs_directions();

const fn abs_directions() -> [Lanes; 3] {
    let mut out = [[0.0; 16]; 3];
    let mut k = 0;
    while k < 16 {
        let axis = if k < 13 { k } else { 0 };
        let mut i = 0;
        while i < 3 {
            out[i][k] = AXES13[axis][i].abs() as f32 / axis_length(axis) as f32;
            i += 1;
        }
        k += 1;
    }
    out
}

/// Length [`axis_length`] of every axis.
pub const LENGTHS: Lanes = {
    let mut out = [1.0; 16];
    let mut k = 0;
    while k < 13 {
        out[k] = axis_length(k) as f32;
        k += 1;
    }
    out
};

/// Opacity of a box from which on it counts as opaque: larger ones would ask for rates without bound.
pub const OPAQUE: f32 = 0.996;
/// Largest rate that a fit asks for, hits per voxel edge.
pub const MAX_RATE: f32 = 118.0;

/// Gauss-Legendre nodes and weights on [0, 1], four points.
const GAUSS: [(f32, f32); 4] = [
    (0.069_431_84, 0.173_927_42),
    (0.330_009_5, 0.326_072_58),
    (0.669_990_5, 0.326_072_58),
    (0.930_568_16, 0.173_927_42),
];

/// Correlation above which matter counts as fully correlated: its opacity is min(τ, 1).
pub const FULL_CORRELATION: f32 = 0.999;

/// Most Newton steps towards a rate.
const MAX_NEWTON_STEPS: usize = 6;
/// Largest step of log rate after which Newton's method stops.
const LAST_STEP: f32 = 0.03;

/// Rates, hits per voxel edge, and how opacity grows with them.
#[derive(Debug, Clone, Copy)]
pub struct SolvedRates {
    pub rates: Lanes,
    /// Derivatives of the opacities with respect to the logarithms of the rates, at or near the rates.
    pub slopes: Lanes,
}

impl Chords {
    /// Chords of a box with edges `e` > 0.
    #[inline(always)]
    pub fn new(e: DVec3) -> Chords {
        let mut chords = Chords { b: [0.0; 16], d: [0.0; 16], longest: [1.0; 16], inverse_mean: [1.0; 16] };
        let q = e.recip().as_vec3();
        for k in 0..16 {
            let (x, y, z) = (q.x * ABS_DIRECTION[0][k], q.y * ABS_DIRECTION[1][k], q.z * ABS_DIRECTION[2][k]);
            let sum = x + y + z;
            chords.b[k] = 2.0 * (x * y + x * z + y * z) / sum;
            chords.d[k] = 3.0 * x * y * z / sum;
            chords.longest[k] = 1.0 / larger(larger(x, y), z);
            chords.inverse_mean[k] = sum;
        }
        chords
    }

    /// Opacity of the box along each axis, in [0, 1]: the mean over its chords, for matter of the rates `r` > 0 (hits per unit of
    /// length) and the correlation `c`.
    #[inline(always)]
    pub fn opacity(&self, r: &Lanes, c: f32) -> Lanes {
        self.opacity_and_slope(r, c).0
    }

    /// [`Chords::opacity`], and its derivative with respect to the logarithm of the rate.
    #[inline(always)]
    fn opacity_and_slope(&self, r: &Lanes, c: f32) -> (Lanes, Lanes) {
        let (mut opacity, mut slope) = ([0.0; 16], [0.0; 16]);
        if c > FULL_CORRELATION {
            for i in 0..16 {
                let m = smaller(self.longest[i], 1.0 / r[i]);
                let (b, d) = (self.b[i], self.d[i]);
                opacity[i] = r[i] * m * (1.0 - m * (0.5 * b - m * d * (1.0 / 3.0)));
                // Chords shorter than m grow more opaque with the rate (`part`); those that reach m do so (`whole`) unless they
                // are opaque already.
                let part = r[i] * m * m * (0.5 * b - m * d * (2.0 / 3.0));
                let whole = if m < self.longest[i] { 0.0 } else { r[i] * m * (1.0 - m * (b - m * d)) };
                slope[i] = part + whole;
            }
            return (opacity, slope);
        }
        let more = 1.0 / (1.0 - c);
        // T = (1 + a) e^−ks − a with 1 + a = 1 / (1 − c), until it is 0. Beyond s = 12 / k what is left is below 1e-5.
        let zero = if c > 0.0 { ln(1.0 / c).min(12.0) } else { 12.0 };
        for i in 0..16 {
            let k = (1.0 - c) * r[i];
            let m = smaller(self.longest[i], zero / k);
            let (b, d) = (self.b[i], self.d[i]);
            let (mut sum, mut part) = (0.0, 0.0);
            for (x, w) in GAUSS {
                let s = x * m;
                let e = w * exp_neg(k * s);
                sum += e * (1.0 - s * (b - s * d));
                part += e * s * (b - 2.0 * s * d);
            }
            let end = exp_neg(k * m);
            let whole = if m < self.longest[i] { 0.0 } else { end * (1.0 - m * (b - m * d)) };
            // All chords of a box along its edges are equal, and there the closed form is exact; the sum is exact for short ones.
            opacity[i] = more * if b == 0.0 && k * m > 1.0 { 1.0 - end } else { k * m * sum };
            slope[i] = more * k * m * (part + whole);
        }
        (opacity, slope)
    }

    /// Rates, at most [`MAX_RATE`], at which the box has the opacities `p` in [0, 1) at the correlation `c`.
    #[inline(always)]
    pub fn solve_rates(&self, p: &Lanes, c: f32) -> SolvedRates {
        if c > FULL_CORRELATION {
            return self.solve_correlated_rates(p);
        }
        let mut rates = [0.0; 16];
        let mut slopes = [0.0; 16];
        let mut goal = [0.0; 16];
        for i in 0..16 {
            let want = larger(optical_depth_of(p[i], c), 1e-12);
            goal[i] = ln(want);
            rates[i] = smaller(want * self.inverse_mean[i], MAX_RATE);
        }
        // Newton's method on log depth as a function of log rate, whose slope is 1 for faint matter and falls towards opaque.
        for _ in 0..MAX_NEWTON_STEPS {
            let (opacity, slope) = self.opacity_and_slope(&rates, c);
            slopes = slope;
            let mut largest = [0.0f32; 16];
            for i in 0..16 {
                let reached = opacity[i].clamp(1e-12, 1.0 - 1e-6);
                let depth = optical_depth_of(reached, c);
                let slope = slope[i] / (depth * (1.0 - reached * (1.0 - c)));
                let step = ((goal[i] - ln(depth)) / slope.clamp(0.02, 1.0)).clamp(-3.0, 3.0);
                let e = exp_neg(step.abs());
                let next = smaller(if step < 0.0 { rates[i] * e } else { rates[i] / e }, MAX_RATE);
                let moved = if rates[i] < MAX_RATE || next < MAX_RATE { step.abs() } else { 0.0 };
                largest[i] = if p[i] > 0.0 { moved } else { 0.0 };
                rates[i] = next;
            }
            if largest.into_iter().fold(0.0, larger) < LAST_STEP {
                break;
            }
        }
        for i in 0..16 {
            rates[i] = if p[i] > 0.0 { rates[i] } else { 0.0 };
        }
        SolvedRates { rates, slopes }
    }

    /// [`Chords::solve_rates`] at c = 1, in closed form. As long as not even the longest chord is blocked throughout, opacity is
    /// rate over [`Chords::inverse_mean`]. Else the shortest chord that is blocked throughout, m = 1 / r, solves a quadratic
    /// equation: 1 − p = b/2 · m − d/3 · m².
    #[inline(always)]
    fn solve_correlated_rates(&self, p: &Lanes) -> SolvedRates {
        let (mut rates, mut slopes) = ([0.0; 16], [0.0; 16]);
        for i in 0..16 {
            let (b, d, rest) = (0.5 * self.b[i], self.d[i] * (1.0 / 3.0), 1.0 - p[i]);
            let even = p[i] * self.inverse_mean[i];
            let root = larger(b * b - 4.0 * d * rest, 0.0).sqrt();
            let shortest = 2.0 * rest / larger(b + root, 1e-20);
            let all_grow = even * self.longest[i] <= 1.0;
            rates[i] = smaller(if all_grow { even } else { 1.0 / shortest }, MAX_RATE);
            let m = 1.0 / larger(rates[i], 1e-20);
            slopes[i] = if all_grow { p[i] } else { m * (b - 2.0 * m * d) };
            rates[i] = if p[i] > 0.0 { rates[i] } else { 0.0 };
        }
        SolvedRates { rates, slopes }
    }
}

/// Optical depth of a line of opacity `p` in [0, 1) at the correlation `c`: that of
/// [`opacity::optical_depth_for`](crate::volume::opacity::optical_depth_for) at transmittance 1 − p, to a relative 1e-6.
#[inline(always)]
pub fn optical_depth_of(p: f32, c: f32) -> f32 {
    if c > FULL_CORRELATION {
        return p;
    }
    let d = 1.0 - c;
    // −ln(1 − x) / d, corrected for what rounding took from a small x.
    let x = p * d;
    let u = 1.0 - x;
    let lost = 1.0 - u;
    let log = -ln(u) / d;
    if lost > 0.0 { log * (x / lost) } else { p }
}

/// Natural logarithm of a normal x > 0, to the larger of 2e-7 and a relative 2e-7, by the series of artanh. It is written out
/// so that it is the same on every machine and runs in SIMD lanes.
#[inline(always)]
pub fn ln(x: f32) -> f32 {
    const HALF_ROOT: u32 = 0x3f35_04f3;
    let shifted = x.to_bits().wrapping_sub(HALF_ROOT) as i32;
    let m = f32::from_bits((shifted as u32 & 0x007f_ffff) + HALF_ROOT);
    let f = m - 1.0;
    let s = f / (2.0 + f);
    let z = s * s;
    (shifted >> 23) as f32 * std::f32::consts::LN_2 + 2.0 * s * (1.0 + z * (1.0 / 3.0 + z * (0.2 + z * (1.0 / 7.0))))
}

/// e^−x for x ≥ 0, to 1e-5, by Taylor's series at x/32 and five squarings. It is written out so that it is the same on every
/// machine and runs in SIMD lanes.
#[inline(always)]
pub fn exp_neg(x: f32) -> f32 {
    let y = -smaller(x, 40.0) / 32.0;
    let mut e = 1.0 + y * (1.0 + y * (0.5 + y * (1.0 / 6.0)));
    for _ in 0..5 {
        e *= e;
    }
    e
}

/// Oblique areas, along all axes, of a box with edges `e`: see [`box_area`](crate::geom::box_area).
#[inline(always)]
pub fn box_areas(e: DVec3) -> Lanes {
    let e = e.as_vec3();
    let (x, y, z) = (e.y * e.z, e.x * e.z, e.x * e.y);
    let mut areas = [0.0; 16];
    for k in 0..16 {
        areas[k] = (x * ABS_DIRECTION[0][k] + y * ABS_DIRECTION[1][k] + z * ABS_DIRECTION[2][k]) * LENGTHS[k];
    }
    areas
}

/// Sum of `f` over `values`, as eight interleaved partial sums so that it runs in SIMD lanes.
#[inline(always)]
pub fn sum(values: &[f32], f: impl Fn(f32) -> f32) -> f32 {
    let mut sums = [0.0f32; 8];
    let (whole, rest) = values.as_chunks::<8>();
    for chunk in whole {
        for n in 0..8 {
            sums[n] += f(chunk[n]);
        }
    }
    for (n, &value) in rest.iter().enumerate() {
        sums[n] += f(value);
    }
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::projection::{PROJECTIONS, crossing};
    use crate::volume::opacity;

    #[test]
    fn agrees_with_lines_through_a_box() {
        let e = DVec3::new(0.9, 0.5, 0.25);
        let chords = Chords::new(e);
        for (r, c) in [(0.5, 0.0), (2.0, 0.5), (3.0, 1.0), (9.0, 0.2), (20.0, 0.9)] {
            let p = chords.opacity(&[r; 16], c);
            let back = chords.opacity(&chords.solve_rates(&p, c).rates, c);
            for (k, projection) in PROJECTIONS.iter().enumerate() {
                let (wa, wb) = projection.extent();
                let (mut n, mut sum) = (0, 0.0);
                for j in 0..200 * wb {
                    for i in 0..200 * wa {
                        let at = |v: usize| (v as f64 + 0.5) / 200.0;
                        if let Some((from, to)) = crossing(k, at(i), at(j), DVec3::ZERO, e) {
                            n += 1;
                            let depth = f64::from(r) * (to - from) * axis_length(k);
                            sum += 1.0 - opacity::advance_f64(1.0, depth, c.into());
                        }
                    }
                }
                // 200 lines per edge: the rim is wrong by half a line, under .5 % of the lines; Gauss on e^−12 by 1e-2.
                let want = sum / f64::from(n);
                assert!((f64::from(p[k]) - want).abs() < 0.012, "{k} {r} {c}: {} {want}", p[k]);
                // The last of Newton's steps is below 3 %, so what is left is far below .1 % of the rate.
                assert!((back[k] - p[k]).abs() < 5e-4, "{k} {r} {c}: {} {}", p[k], back[k]);
            }
        }
    }

    #[test]
    fn rates_are_found_wherever_they_are() {
        for e in [DVec3::ONE, DVec3::new(1.0, 0.0625, 0.5), DVec3::splat(0.0625)] {
            let chords = Chords::new(e);
            for code in 0..16 {
                let c = code as f32 / 15.0;
                for p in [1e-6, 1e-3, 0.1, 0.5, 0.9, 0.97, 0.996] {
                    let SolvedRates { rates, .. } = chords.solve_rates(&[p; 16], c);
                    let back = chords.opacity(&rates, c);
                    for k in 0..13 {
                        // Near opaque the largest rate is near, and steps are small.
                        let most = if p > 0.99 { 5e-3 } else { 2e-3 };
                        let reached = rates[k] >= MAX_RATE || (back[k] / p - 1.0).abs() < most;
                        assert!(reached, "{e} {c} {p} {k}: {} {}", rates[k], back[k]);
                    }
                }
            }
        }
    }

    #[test]
    fn what_is_correlated_has_its_rate_and_slope_in_closed_form() {
        // A cube, a slab, a rod, and all of them from hardly blocked to nearly opaque.
        for e in [DVec3::ONE, DVec3::new(1.0, 0.0625, 1.0), DVec3::new(0.1, 0.9, 0.1)] {
            let chords = Chords::new(e);
            for p in [1e-6, 0.1, 0.5, 0.7, 0.9, 0.97, 0.996] {
                let SolvedRates { rates, slopes } = chords.solve_rates(&[p; 16], 1.0);
                let (back, slope) = chords.opacity_and_slope(&rates, 1.0);
                for k in (0..13).filter(|&k| rates[k] < MAX_RATE) {
                    // Some ten roundings of numbers of up to 1 / (1 − p), in f32.
                    assert!((back[k] / p - 1.0).abs() < 2e-5, "{e} {p} {k}: {}", back[k]);
                    assert!((slopes[k] - slope[k]).abs() < 2e-5, "{e} {p} {k}: {} {}", slopes[k], slope[k]);
                }
            }
        }
    }

    #[test]
    fn functions_are_what_they_are_called() {
        for i in 0..400 {
            let x = i as f32 * 0.1;
            assert!((exp_neg(x) - (-x).exp()).abs() < 2e-5, "{x}");
            let y = (x - 20.0).exp();
            assert!((ln(y) - y.ln()).abs() < 4e-7 * y.ln().abs().max(1.0), "{y}");
        }
        for c in [0.0, 0.3, 14.0 / 15.0, 1.0] {
            for p in [1e-7, 1e-4, 0.2, 0.9, 0.999] {
                let want = opacity::optical_depth_for(1.0 - f64::from(p), c) as f32;
                assert!((optical_depth_of(p, c as f32) / want - 1.0).abs() < 3e-6, "{c} {p}");
            }
        }
    }
}
