//! Gradient noise that repeats itself exactly, with its derivative.
//!
//! Based on: K. Perlin, *Improving Noise*, SIGGRAPH 2002 (the quintic fade, twelve gradients); K. Perlin, *An Image
//! Synthesizer*, SIGGRAPH 1985 (turbulence); K. Perlin, E. Hoffert, *Hypertexture*, SIGGRAPH 1989 (bias and gain).

use crate::geom::DVec3;

/// Bounds of the noise's first and second derivatives: of trilinear blends of ramps of slope 1 by fades of slope 15/8 and
/// curvature 10/√3, a face's blend within ±1, component by component.
const SLOPE: f64 = 8.3;
const CURVATURE: f64 = 62.0;

/// Noise of one or several octaves over space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
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
            let (mut a, mut b) = ((v - by).max(-1.5), (v + by).min(1.5));
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
        let whole = 2.0 - libm::exp2(1.0 - f64::from(self.octaves));
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
    let cell = q.floor();
    let f = q - cell;
    let corner = |axis: usize, upper: u32| {
        let c = cell[axis] as i64 + i64::from(upper);
        if period[axis] > 0 { c.rem_euclid(i64::from(period[axis])) as u32 } else { c as u32 }
    };
    let (x, y, z) = ([corner(0, 0), corner(0, 1)], [corner(1, 0), corner(1, 1)], [corner(2, 0), corner(2, 1)]);
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

/// One of the twelve directions to the middles of a cube's edges.
fn gradient(x: u32, y: u32, z: u32, seed: u32) -> DVec3 {
    let mut h = x.wrapping_mul(0x8da6_b343) ^ y.wrapping_mul(0xd816_3841) ^ z.wrapping_mul(0xcb1a_b31f);
    h ^= seed.wrapping_mul(0x9e37_79b9);
    h = (h ^ h >> 16).wrapping_mul(0x7feb_352d);
    h = (h ^ h >> 15).wrapping_mul(0x846c_a68b);
    h ^= h >> 16;
    let sign = |bit: u32| if h >> bit & 1 == 0 { 1.0 } else { -1.0 };
    // A third each by the upper bits.
    match (u64::from(h >> 8) * 3) >> 24 {
        0 => DVec3::new(sign(0), sign(1), 0.0),
        1 => DVec3::new(sign(0), 0.0, sign(1)),
        _ => DVec3::new(0.0, sign(0), sign(1)),
    }
}

/// Perlin's bias: 0 and 1 stay, 1/2 becomes `b` in (0, 1). With the derivative.
pub fn bias(b: f64, t: f64) -> (f64, f64) {
    if b == 0.5 {
        return (t, 1.0);
    }
    let exponent = libm::log(b) / libm::log(0.5);
    let t = t.max(1e-12);
    let value = libm::pow(t, exponent);
    (value, exponent * value / t)
}

/// Perlin's gain: 0, 1/2 and 1 stay, and the middle rises the steeper the nearer `g` in (0, 1) is to 1. With the derivative.
pub fn gain(g: f64, t: f64) -> (f64, f64) {
    if t < 0.5 {
        let (v, d) = bias(1.0 - g, 2.0 * t);
        (0.5 * v, d)
    } else {
        let (v, d) = bias(1.0 - g, 2.0 - 2.0 * t);
        (1.0 - 0.5 * v, d)
    }
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

    #[test]
    fn bias_and_gain_keep_their_points() {
        for b in [0.1, 0.5, 0.8] {
            assert!((bias(b, 0.5).0 - b).abs() < 1e-12);
            assert!(bias(b, 0.0).0.abs() < 1e-2 && (bias(b, 1.0).0 - 1.0).abs() < 1e-12);
            assert!((gain(b, 0.5).0 - 0.5).abs() < 1e-12);
            for t in [0.2, 0.45, 0.7] {
                let h = 1e-6;
                for f in [bias, gain] {
                    let slope = (f(b, t + h).0 - f(b, t - h).0) / (2.0 * h);
                    assert!((slope - f(b, t).1).abs() < 1e-5);
                }
            }
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
