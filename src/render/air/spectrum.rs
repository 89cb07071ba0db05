//! Eight wavelengths, and how they become linear Rec. 709.
//!
//! Based on: C. Wyman, P.-P. Sloan, P. Shirley, *Simple Analytic Approximations to the CIE XYZ Color Matching Functions*,
//! JCGT 2013. Solar irradiance (ASTM E490) and absorption by ozone (J. Orphal et al. 2016) are means of 40 nm.

use std::ops::{Add, AddAssign, Mul};

use crate::geom::{DMat3, DVec3};

pub const COUNT: usize = 8;
/// Nanometres.
pub const WAVELENGTHS: [f64; COUNT] = [400.0, 440.0, 480.0, 520.0, 560.0, 600.0, 640.0, 680.0];
/// W / m² / nm, facing the sun, outside of the atmosphere.
pub const SUN: Spectrum = Spectrum([1.68, 1.86, 1.98, 1.87, 1.84, 1.745, 1.60, 1.48]);
/// Absorption cross section of ozone, m² per molecule.
pub const OZONE: [f64; COUNT] = [1.5e-27, 1.6e-26, 7.8e-26, 2.1e-25, 4.2e-25, 5.0e-25, 2.7e-25, 1.2e-25];

/// A value for each wavelength; in between it is linear, beyond the ends constant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Spectrum(pub [f64; COUNT]);

impl Spectrum {
    /// By a loop: `array::map` and `array::from_fn` of eight are calls for each, which were half of a small picture's time.
    #[inline(always)]
    pub fn from_fn(mut f: impl FnMut(usize) -> f64) -> Spectrum {
        let mut out = [0.0; COUNT];
        for (k, value) in out.iter_mut().enumerate() {
            *value = f(k);
        }
        Spectrum(out)
    }

    pub fn splat(value: f64) -> Spectrum {
        Spectrum([value; COUNT])
    }

    /// e to the power of minus each value.
    pub fn attenuation(self) -> Spectrum {
        Spectrum(decay(self.0))
    }
}

/// e to the power of minus each value, of values from 0 on; the same on all machines, within two units in the last place. Several
/// at once become vector instructions.
pub fn decay<const N: usize>(values: [f64; N]) -> [f64; N] {
    /// Added to a number, it leaves its integer in the last bits: 1.5 · 2^52.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    /// The logarithm of 2 in two parts, of which multiples of the first are exact.
    const LN_2: [f64; 2] = [0.693_147_180_369_123_8, 1.908_214_929_270_587_7e-10];
    /// From here on all is 0 next to anything, and 2^n is no longer a normal number soon after.
    const MAX: f64 = 700.0;
    let mut out = [0.0; N];
    for k in 0..N {
        let x = -values[k].min(MAX);
        // x = n ln 2 + rest, the rest within half of ln 2.
        let rounded = x * std::f64::consts::LOG2_E + ROUND;
        let n = rounded - ROUND;
        let rest = (x - n * LN_2[0]) - n * LN_2[1];
        // Taylor's series: what it leaves out is below 2^-57.
        let mut sum = 1.0 / 6_227_020_800.0;
        for factor in FACTORIALS {
            sum = sum * rest + factor;
        }
        out[k] = sum * f64::from_bits((rounded.to_bits() << 52).wrapping_add(1023 << 52));
    }
    out
}

/// 1 / 12!, 1 / 11!, … 1 / 0!.
const FACTORIALS: [f64; 13] = [
    1.0 / 479_001_600.0,
    1.0 / 39_916_800.0,
    1.0 / 3_628_800.0,
    1.0 / 362_880.0,
    1.0 / 40_320.0,
    1.0 / 5_040.0,
    1.0 / 720.0,
    1.0 / 120.0,
    1.0 / 24.0,
    1.0 / 6.0,
    0.5,
    1.0,
    1.0,
];

impl Add for Spectrum {
    type Output = Spectrum;
    #[inline]
    fn add(self, other: Spectrum) -> Spectrum {
        Spectrum::from_fn(|k| self.0[k] + other.0[k])
    }
}

impl AddAssign for Spectrum {
    #[inline]
    fn add_assign(&mut self, other: Spectrum) {
        *self = *self + other;
    }
}

impl Mul for Spectrum {
    type Output = Spectrum;
    #[inline]
    fn mul(self, other: Spectrum) -> Spectrum {
        Spectrum::from_fn(|k| self.0[k] * other.0[k])
    }
}

impl Mul<f64> for Spectrum {
    type Output = Spectrum;
    #[inline]
    fn mul(self, factor: f64) -> Spectrum {
        Spectrum::from_fn(|k| self.0[k] * factor)
    }
}

/// For each wavelength its contribution to linear Rec. 709.
pub struct RgbWeights([DVec3; COUNT]);

impl RgbWeights {
    pub fn new() -> RgbWeights {
        let mut xyz = [DVec3::ZERO; COUNT];
        for nm in 360..=780 {
            let at = (f64::from(nm) - WAVELENGTHS[0]) / 40.0;
            let at = at.clamp(0.0, (COUNT - 1) as f64);
            let low = (at as usize).min(COUNT - 2);
            let high = at - low as f64;
            let matched = matching(f64::from(nm));
            xyz[low] += (1.0 - high) * matched;
            xyz[low + 1] += high * matched;
        }
        // XYZ → Rec. 709 with D65 as white.
        let to_rgb = DMat3::from_cols(
            DVec3::new(3.240_454_2, -0.969_266_0, 0.055_643_4),
            DVec3::new(-1.537_138_5, 1.876_010_8, -0.204_025_9),
            DVec3::new(-0.498_531_4, 0.041_556_0, 1.057_225_2),
        );
        RgbWeights(xyz.map(|v| to_rgb * v))
    }

    /// Linear Rec. 709 of a spectrum. Its luminance is the integral of the spectrum times the luminosity function, whose maximum is 1;
    /// 683 times that is in lux, or cd / m².
    pub fn rgb(&self, spectrum: &Spectrum) -> DVec3 {
        let sum: DVec3 = self.0.iter().zip(spectrum.0).map(|(weight, v)| v * *weight).sum();
        // Colours outside of the gamut are clipped.
        sum.max(DVec3::ZERO)
    }
}

/// The CIE 1931 colour matching functions.
fn matching(nm: f64) -> DVec3 {
    let lobe = |height: f64, middle: f64, below: f64, above: f64| {
        let apart = (nm - middle) / if nm < middle { below } else { above };
        height * libm::exp(-0.5 * apart * apart)
    };
    DVec3::new(
        lobe(0.362, 442.0, 16.0, 26.7) + lobe(1.056, 599.8, 37.9, 31.0) + lobe(-0.065, 501.1, 20.4, 26.2),
        lobe(0.821, 568.8, 46.9, 40.5) + lobe(0.286, 530.9, 16.3, 31.1),
        lobe(1.217, 437.0, 11.8, 36.0) + lobe(0.681, 459.0, 26.0, 13.8),
    )
}

/// Luminance of linear Rec. 709.
pub fn luminance(rgb: DVec3) -> f64 {
    rgb.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decay_is_a_power_of_e() {
        // Two units in the last place, and what is next to 0 where all that follows is as much.
        let near = |a: f64, b: f64| (a - b).abs() <= 2.0 * f64::EPSILON * b + 1e-303;
        for i in 0..20_000 {
            let v = 0.037 * f64::from(i);
            let [a, b] = decay([v, v * 1e-3]);
            assert!(near(a, libm::exp(-v)) && near(b, libm::exp(-v * 1e-3)), "{v}: {a} {b}");
        }
        assert_eq!(decay([0.0]), [1.0]);
        assert!(decay([f64::INFINITY])[0] < 1e-303);
    }
}
