//! Gradient noise that repeats itself exactly, with its derivative. Normative for landscapes: `format-spec/landscape-1.md`.
//!
//! Based on: K. Perlin, *Improving Noise*, SIGGRAPH 2002 (the quintic fade, twelve gradients); K. Perlin, *An Image
//! Synthesizer*, SIGGRAPH 1985 (turbulence).

use crate::geom::DVec3;

/// Bounds of one octave's value, slope and curvature (cells, any direction), whatever gradients its corners have: at a place
/// of the cell all three are sums of one term a corner, so the worst gradient of each corner gives their supremum there. Over
/// the cell they are 1.0364, 15/4 (in its middle) and 14.47.
const VALUE: f64 = 1.04;
const SLOPE: f64 = 3.76;
const CURVATURE: f64 = 14.6;

/// Noise of one or several octaves over space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Seed of the lattice.
    pub seed: u32,
    /// Lattice cells in a source unit, along each axis.
    pub frequency: DVec3,
    /// Where the lattice begins.
    pub origin: DVec3,
    /// Cells after which the lattice begins anew; 0: never.
    pub period: [u32; 3],
    /// Each of twice the frequency and half the height of the one before; 1 … 10.
    pub octaves: u32,
    /// Whether octaves enter by their absolute values.
    pub turbulence: bool,
}

impl Noise {
    /// The value and its gradient. Noise is about −1 … 1, turbulence 0 … 1; the sum of heights of all octaves is 1.
    pub fn at(&self, p: DVec3) -> (f64, DVec3) {
        let (mut value, mut gradient) = (0.0, DVec3::ZERO);
        self.each_octave::<true>(p, |v, g, weight, frequency| {
            let sign = if self.turbulence && v < 0.0 { -weight } else { weight };
            value += sign * v;
            gradient += sign * frequency * g;
        });
        (value, gradient)
    }

    /// The value alone, the same to the bit.
    pub fn value(&self, p: DVec3) -> f64 {
        let mut value = 0.0;
        self.each_octave::<false>(p, |v, _, weight, _| {
            value += if self.turbulence && v < 0.0 { -weight } else { weight } * v;
        });
        value
    }

    /// Bounds of the value within `reach` of `p`.
    pub fn range(&self, p: DVec3, reach: f64) -> (f64, f64) {
        let (mut low, mut high) = (0.0, 0.0);
        self.each_octave::<true>(p, |v, g, weight, frequency| {
            let r = reach * frequency.max_element();
            let by = (g.length() * r + 0.5 * CURVATURE * r * r).min(SLOPE * r);
            let (mut a, mut b) = ((v - by).max(-VALUE), (v + by).min(VALUE));
            if self.turbulence {
                (a, b) =
                    if a < 0.0 && b > 0.0 { (0.0, (-a).max(b)) } else { (a.abs().min(b.abs()), a.abs().max(b.abs())) };
            }
            low += weight * a;
            high += weight * b;
        });
        (low, high)
    }

    /// Value, gradient along the lattice (where it is asked for), weight and frequency of each octave.
    fn each_octave<const SLOPE: bool>(&self, p: DVec3, mut each: impl FnMut(f64, DVec3, f64, DVec3)) {
        let whole = 2.0 - 2.0 / f64::from(1u32 << self.octaves);
        for octave in 0..self.octaves {
            let scale = f64::from(1u32 << octave);
            let frequency = self.frequency * scale;
            let period = self.period.map(|n| n << octave);
            let (v, g) = lattice::<SLOPE>((p - self.origin) * frequency, period, self.seed.wrapping_add(octave));
            each(v, g, 1.0 / (scale * whole), frequency);
        }
    }
}

/// One octave at `q`, in cells; without `SLOPE` its gradient is 0.
fn lattice<const SLOPE: bool>(q: DVec3, period: [u32; 3], seed: u32) -> (f64, DVec3) {
    let cell = [floor(q.x), floor(q.y), floor(q.z)];
    let f = q - DVec3::from(cell.map(|c| c as f64));
    let corners = |axis: usize| {
        let (low, period) = (cell[axis], i64::from(period[axis]));
        if period == 0 {
            return [low as u32, low.wrapping_add(1) as u32];
        }
        // Divisions take long: mostly the first period is asked for.
        let low = if (0..period).contains(&low) { low } else { low.rem_euclid(period) };
        [low as u32, if low + 1 == period { 0 } else { low as u32 + 1 }]
    };
    let (x, y, z) = (corners(0), corners(1), corners(2));
    let fade = |t: f64| (t * t * t * (t * (t * 6.0 - 15.0) + 10.0), 30.0 * t * t * (t * (t - 2.0) + 1.0));
    let ((u, du), (v, dv), (w, dw)) = (fade(f.x), fade(f.y), fade(f.z));
    let (mut values, mut slopes) = ([0.0; 8], [DVec3::ZERO; 8]);
    for j in 0..8 {
        let (a, b, c) = (j & 1, j >> 1 & 1, j >> 2);
        let g = gradient(x[a], y[b], z[c], seed);
        slopes[j] = g;
        values[j] = g.dot(f - DVec3::new(a as f64, b as f64, c as f64));
    }
    // Blended along x, then y, then z.
    let mix = |a: f64, b: f64, t: f64| a + t * (b - a);
    let along_x: [f64; 4] = std::array::from_fn(|i| mix(values[2 * i], values[2 * i + 1], u));
    let along_y = [mix(along_x[0], along_x[1], v), mix(along_x[2], along_x[3], v)];
    let value = mix(along_y[0], along_y[1], w);
    if !SLOPE {
        return (value, DVec3::ZERO);
    }
    let face: [f64; 4] = std::array::from_fn(|i| values[2 * i + 1] - values[2 * i]);
    let dx = du * mix(mix(face[0], face[1], v), mix(face[2], face[3], v), w);
    let dy = dv * mix(along_x[1] - along_x[0], along_x[3] - along_x[2], w);
    let dz = dw * (along_y[1] - along_y[0]);
    let weight = |j: usize| {
        let side = |bit: usize, t: f64| if j >> bit & 1 == 1 { t } else { 1.0 - t };
        side(0, u) * side(1, v) * side(2, w)
    };
    let ramps: DVec3 = (0..8).map(|j| weight(j) * slopes[j]).sum();
    (value, ramps + DVec3::new(dx, dy, dz))
}

/// The largest whole number that is not above `v`; `f64::floor` is a call where no instruction for it may be taken for granted.
#[inline]
fn floor(v: f64) -> i64 {
    let toward_zero = v as i64;
    toward_zero.wrapping_sub(i64::from(v < toward_zero as f64))
}

/// The directions to the middles of a cube's edges, by the axis they are square to (z, y, x) and two signs; looked up without
/// a branch that no processor can foresee.
const GRADIENTS: [DVec3; 12] = {
    let mut out = [DVec3::ZERO; 12];
    let mut i = 0;
    while i < 12 {
        let first = if i & 1 == 0 { 1.0 } else { -1.0 };
        let second = if i >> 1 & 1 == 0 { 1.0 } else { -1.0 };
        out[i] = match i >> 2 {
            0 => DVec3::new(first, second, 0.0),
            1 => DVec3::new(first, 0.0, second),
            _ => DVec3::new(0.0, first, second),
        };
        i += 1;
    }
    out
};

/// One of the twelve directions, at a corner of the lattice.
#[inline]
fn gradient(x: u32, y: u32, z: u32, seed: u32) -> DVec3 {
    let mut h = x.wrapping_mul(0x8da6_b343) ^ y.wrapping_mul(0xd816_3841) ^ z.wrapping_mul(0xcb1a_b31f);
    h ^= seed.wrapping_mul(0x9e37_79b9);
    h = (h ^ h >> 16).wrapping_mul(0x7feb_352d);
    h = (h ^ h >> 15).wrapping_mul(0x846c_a68b);
    h ^= h >> 16;
    // The axis by the upper bits, a third each; the signs by the lowest.
    let axis = (u64::from(h >> 8) * 3) >> 24;
    GRADIENTS[axis as usize * 4 + (h & 3) as usize]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn noise(octaves: u32, turbulence: bool) -> Noise {
        let frequency = DVec3::new(4.0, 2.0, 8.0);
        Noise { seed: 7, frequency, origin: DVec3::ZERO, period: [4, 0, 8], octaves, turbulence }
    }

    proptest! {
        #[test]
        fn derivative_is_the_slope(x in 0.0f64..1.0, y in 0.0f64..1.0, z in 0.0f64..1.0) {
            let p = DVec3::new(x, y, z);
            let n = noise(3, false);
            let (_, g) = n.at(p);
            let h = 1e-5;
            for axis in DVec3::AXES {
                let slope = (n.at(p + h * axis).0 - n.at(p - h * axis).0) / (2.0 * h);
                // Third derivative, some 60 frequency³ of the finest octave / 4, times h² / 6: below 1e-4.
                prop_assert!((slope - g.dot(axis)).abs() < 1e-3, "{slope} {g}");
            }
        }

        #[test]
        fn periods_match_bit_for_bit(x in 0u32..64, y in 0.0f64..1.0, z in 0u32..64) {
            // Places that f64 holds exactly, so that the only rounding is the noise's own.
            let p = DVec3::new(f64::from(x) / 64.0, y, f64::from(z) / 64.0);
            let n = noise(4, true);
            prop_assert_eq!(n.at(p).0.to_bits(), n.value(p).to_bits());
            prop_assert_eq!(n.at(p), n.at(p + DVec3::X));
            prop_assert_eq!(n.at(p), n.at(p - DVec3::Z));
            prop_assert!(n.at(p).0 != n.at(p + DVec3::Y).0 || n.at(p).0 == 0.0);
        }

        #[test]
        fn ranges_hold(v in proptest::array::uniform6(0.0f64..1.0), reach in 0.0f64..0.3, turbulence: bool) {
            let p = DVec3::from_slice(&v[..3]);
            let q = p + reach * (DVec3::from_slice(&v[3..]) * 2.0 - 1.0).clamp_length_max(1.0);
            let n = noise(3, turbulence);
            let (low, high) = n.range(p, reach);
            let value = n.at(q).0;
            prop_assert!(low - 1e-12 <= value && value <= high + 1e-12, "{low} {value} {high}");
        }
    }

    /// The worst of all gradients at every corner, in the directions along axes and diagonals.
    #[test]
    fn bounds_hold_for_any_gradients() {
        let fade = |t: f64| {
            [
                t * t * t * (t * (t * 6.0 - 15.0) + 10.0),
                30.0 * t * t * (t * (t - 2.0) + 1.0),
                60.0 * t * (2.0 * t * t - 3.0 * t + 1.0),
            ]
        };
        let (mut value, mut slope, mut curvature) = (0.0f64, 0.0f64, 0.0f64);
        for at in 0..21 * 21 * 21 {
            let f = DVec3::new(f64::from(at % 21), f64::from(at / 21 % 21), f64::from(at / 441)) / 20.0;
            let fades = f.to_array().map(fade);
            for d in crate::geom::directions13() {
                let (mut v, mut s, mut c) = (0.0, 0.0, 0.0);
                for j in 0..8 {
                    // The corner's weight along d: itself, and its first two derivatives, by the product rule.
                    let [x, y, z] = std::array::from_fn(|a| {
                        let [w, dw, ddw] = fades[a];
                        if j >> a & 1 == 1 {
                            [w, dw * d[a], ddw * d[a] * d[a]]
                        } else {
                            [1.0 - w, -dw * d[a], -ddw * d[a] * d[a]]
                        }
                    });
                    let w = x[0] * y[0] * z[0];
                    let dw = x[1] * y[0] * z[0] + x[0] * y[1] * z[0] + x[0] * y[0] * z[1];
                    let ddw = x[2] * y[0] * z[0]
                        + x[0] * y[2] * z[0]
                        + x[0] * y[0] * z[2]
                        + 2.0 * (x[1] * y[1] * z[0] + x[1] * y[0] * z[1] + x[0] * y[1] * z[1]);
                    let r = f - DVec3::new((j & 1) as f64, (j >> 1 & 1) as f64, (j >> 2) as f64);
                    let most =
                        |of: &dyn Fn(DVec3) -> f64| GRADIENTS.into_iter().map(of).fold(f64::NEG_INFINITY, f64::max);
                    v += most(&|g| w * g.dot(r));
                    s += most(&|g| dw * g.dot(r) + w * g.dot(d));
                    c += most(&|g| ddw * g.dot(r) + 2.0 * dw * g.dot(d));
                }
                (value, slope, curvature) = (value.max(v), slope.max(s), curvature.max(c));
            }
        }
        // Reached to a few per cent where the grid of places comes near.
        for (found, bound) in [(value, VALUE), (slope, SLOPE), (curvature, CURVATURE)] {
            assert!(found <= bound && found > 0.95 * bound, "{found} {bound}");
        }
    }

    #[test]
    fn noise_fills_its_range_evenly() {
        let n = Noise { period: [0; 3], octaves: 1, ..noise(1, false) };
        let values: Vec<f64> = (0..20_000).map(|i| n.at(DVec3::new(0.37, 0.71, 0.13) * f64::from(i)).0).collect();
        let mean = values.iter().sum::<f64>() / 2e4;
        let deviation = (values.iter().map(|v| v * v).sum::<f64>() / 2e4).sqrt();
        let most = values.iter().map(|v| v.abs()).fold(0.0, f64::max);
        // Gradient noise of this kind has a deviation of about a quarter and ends a little beyond 1.
        assert!(mean.abs() < 0.02 && (0.2..0.35).contains(&deviation) && most < 1.1, "{mean} {deviation} {most}");
    }
}
