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
/// m² a molecule.
pub const OZONE: [f64; COUNT] = [1.5e-27, 1.6e-26, 7.8e-26, 2.1e-25, 4.2e-25, 5.0e-25, 2.7e-25, 1.2e-25];

/// A value for each wavelength; in between it is linear, beyond the ends constant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Spectrum(pub [f64; COUNT]);

impl Spectrum {
    pub fn from_fn(f: impl FnMut(usize) -> f64) -> Spectrum {
        Spectrum(std::array::from_fn(f))
    }

    pub fn splat(value: f64) -> Spectrum {
        Spectrum([value; COUNT])
    }

    /// e to the power of minus each value.
    pub fn attenuation(self) -> Spectrum {
        Spectrum(self.0.map(|v| libm::exp(-v)))
    }
}

impl Add for Spectrum {
    type Output = Spectrum;
    fn add(self, other: Spectrum) -> Spectrum {
        Spectrum::from_fn(|k| self.0[k] + other.0[k])
    }
}

impl AddAssign for Spectrum {
    fn add_assign(&mut self, other: Spectrum) {
        *self = *self + other;
    }
}

impl Mul for Spectrum {
    type Output = Spectrum;
    fn mul(self, other: Spectrum) -> Spectrum {
        Spectrum::from_fn(|k| self.0[k] * other.0[k])
    }
}

impl Mul<f64> for Spectrum {
    type Output = Spectrum;
    fn mul(self, factor: f64) -> Spectrum {
        Spectrum(self.0.map(|v| v * factor))
    }
}

/// From spectra to linear Rec. 709.
pub struct Colours([DVec3; COUNT]);

impl Colours {
    pub fn new() -> Colours {
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
        Colours(xyz.map(|v| to_rgb * v))
    }

    /// Its luminance is the integral with the eye's sensitivity, whose top is 1: 683 times that is lux, or cd / m².
    pub fn rgb(&self, spectrum: &Spectrum) -> DVec3 {
        let sum: DVec3 = self.0.iter().zip(spectrum.0).map(|(weight, v)| v * *weight).sum();
        // What is more saturated than the display's colours.
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

/// Of linear Rec. 709.
pub fn luminance(rgb: DVec3) -> f64 {
    rgb.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}
