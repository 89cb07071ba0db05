//! Transmittance of matter along a ray.
//!
//! Based on: F. Neyret, *Synthesizing Verdant Landscapes using Volumetric Textures*, INRIA RR-2846, 1996 (opacity per voxel);
//! D. Vicini, W. Jakob, A. Kaplanyan, *A Non-Exponential Transmittance Model for Volumetric Scene Representations*, 2021
//! (correlated matter is not exponential).
//!
//! Along a segment of constant rate r and correlation c, dT/ds = −r (T + c (1 − T)) while T > 0. With c = 0 matter is
//! independent ("over", T = e^−rs); with c = 1 it never overlaps along the ray ("plus", T = 1 − rs down to exactly 0).
//! The solution is a semigroup, so the result does not depend on how a segment is cut into steps. T is the transmittance of
//! the current 4^3 block of voxels, over which c was fitted: it starts at 1 where the ray enters the block, and the
//! transmittances of blocks are multiplied.

/// Transmittance after an optical depth `tau` = r · length ≥ 0 of matter of correlation `c` in [0, 1], starting from `t` in [0, 1].
#[inline]
pub fn advance(t: f32, tau: f32, c: f32) -> f32 {
    let k = (1.0 - c) * tau;
    let (e, phi) = decay(k);
    (t * e - c * tau * phi).max(0.0)
}

/// The pair e^−k and (1 − e^−k) / k for k ≥ 0; the second is 1 at k = 0.
#[inline]
fn decay(k: f32) -> (f32, f32) {
    if k < 0.05 {
        // Four terms: the next is k^4 / 120 < 6e-8 relative, below f32's half step.
        let phi = 1.0 - k * (0.5 - k * (1.0 / 6.0 - k * (1.0 / 24.0)));
        (1.0 - k * phi, phi)
    } else {
        let e = (-k).exp();
        (e, (1.0 - e) / k)
    }
}

/// [`advance`] in f64, which tests compare with.
pub fn advance_f64(t: f64, tau: f64, c: f64) -> f64 {
    let k = (1.0 - c) * tau;
    let phi = if k < 1e-9 { 1.0 - 0.5 * k } else { -libm::expm1(-k) / k };
    (t * libm::exp(-k) - c * tau * phi).max(0.0)
}

/// Optical depth after which the transmittance has fallen from 1 to `t` in [0, 1], at the correlation `c` in [0, 1]; infinite
/// for t = 0 with c = 0. The inverse of [`advance_f64`] from 1.
pub fn optical_depth_for(t: f64, c: f64) -> f64 {
    let d = 1.0 - c;
    if d < 1e-6 {
        return 1.0 - t;
    }
    // T = E − a (1 − E) with a = c/(1 − c) and E = e^−k.
    let a = c / d;
    -libm::log((t + a) / (1.0 + a)) / d
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn closed_forms() {
        assert_eq!(advance(1.0, 0.25, 1.0), 0.75);
        assert_eq!(advance(1.0, 2.0, 1.0), 0.0);
        assert!((advance(1.0, 0.7, 0.0) - (-0.7f32).exp()).abs() < 1e-7);
        assert_eq!(advance(0.3, 0.0, 0.5), 0.3);
    }

    proptest! {
        /// Halving a step changes nothing: the law is a semigroup. f32: four roundings of values <= 1 each side, < 1e-6.
        #[test]
        fn step_split(t in 0.0f32..1.0, tau in 0.0f32..8.0, c in 0.0f32..=1.0, f in 0.0f32..1.0) {
            let whole = advance(t, tau, c);
            let split = advance(advance(t, tau * f, c), tau * (1.0 - f), c);
            prop_assert!((whole - split).abs() < 1e-6, "{whole} {split}");
            prop_assert!((0.0..=t).contains(&whole));
        }

        #[test]
        fn f32_agrees_with_f64(t in 0.0f32..1.0, tau in 0.0f32..40.0, c in 0.0f32..=1.0) {
            let d = f64::from(advance(t, tau, c)) - advance_f64(t.into(), tau.into(), c.into());
            prop_assert!(d.abs() < 5e-7, "{d}");
        }

        #[test]
        fn inverse(t in 0.001f64..1.0, c in 0.0f64..=1.0) {
            prop_assert!((advance_f64(1.0, optical_depth_for(t, c), c) - t).abs() < 1e-9);
        }
    }
}
