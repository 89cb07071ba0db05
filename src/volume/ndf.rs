//! Distribution of normals in a voxel: Neyret's ellipsoid as an SGGX matrix.
//!
//! Based on: E. Heitz, J. Dupuy, C. Crassin, C. Dachsbacher, *The SGGX Microflake Distribution*, SIGGRAPH 2015;
//! F. Neyret, *A General and Multiscale Model for Volumetric Textures*, GI 1995 (the ellipsoid of normals).

use crate::geom::{Vec3, each3};

/// A symmetric positive semidefinite matrix S. The projected area of the facets along the unit vector w is sqrt(w^T S w), in
/// any unit; decoded matrices have a largest diagonal element of 1, and the voxel's rate holds the unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sggx {
    /// Element xx of the matrix.
    pub xx: f32,
    /// Element yy of the matrix.
    pub yy: f32,
    /// Element zz of the matrix.
    pub zz: f32,
    /// Element xy of the matrix.
    pub xy: f32,
    /// Element xz of the matrix.
    pub xz: f32,
    /// Element yz of the matrix.
    pub yz: f32,
}

impl Sggx {
    /// The same projected area, 1, along every direction.
    pub const ISOTROPIC: Sggx = Sggx { xx: 1.0, yy: 1.0, zz: 1.0, xy: 0.0, xz: 0.0, yz: 0.0 };

    /// Quadratic form w^T S w.
    #[inline(always)]
    pub fn quad(&self, w: Vec3) -> f32 {
        self.xx * w.x * w.x
            + self.yy * w.y * w.y
            + self.zz * w.z * w.z
            + 2.0 * (self.xy * w.x * w.y + self.xz * w.x * w.z + self.yz * w.y * w.z)
    }

    /// Projected area along the unit vector `w`, ≥ 0.
    #[inline(always)]
    pub fn sigma(&self, w: Vec3) -> f32 {
        self.quad(w).max(0.0).sqrt()
    }

    /// Product S w.
    #[inline(always)]
    pub fn mul(&self, w: Vec3) -> Vec3 {
        Vec3::new(
            self.xx * w.x + self.xy * w.y + self.xz * w.z,
            self.xy * w.x + self.yy * w.y + self.yz * w.z,
            self.xz * w.x + self.yz * w.y + self.zz * w.z,
        )
    }

    /// The matrix times `s`.
    pub fn scaled(&self, s: f32) -> Sggx {
        let Sggx { xx, yy, zz, xy, xz, yz } = *self;
        Sggx { xx: xx * s, yy: yy * s, zz: zz * s, xy: xy * s, xz: xz * s, yz: yz * s }
    }

    /// Six bytes: the square roots of the diagonal, divided by the largest of them, in steps of 1/255; then the correlations xy,
    /// xz and yz, where code 128 is 0 and the codes 1 … 255 are −1 … 1 in steps of 1/127. What was divided by is
    /// [`Sggx::scale`], by which the rate has to be multiplied.
    #[inline]
    pub fn encode(&self) -> [u8; 6] {
        let s = self.scale();
        if s.is_nan() || s <= 0.0 {
            return Sggx::ISOTROPIC.encode();
        }
        let d = [self.xx, self.yy, self.zz].map(|v| v.max(0.0).sqrt());
        // Rounds to the nearest: the numbers are never negative, so the cast only drops the fraction.
        let diag = |v: f32| (v / s * 255.0 + 0.5) as u8;
        let corr = |m: f32, p: f32| {
            let r = if p > 0.0 { (m / p).clamp(-1.0, 1.0) } else { 0.0 };
            (r * 127.0 + 128.5) as u8
        };
        [
            diag(d[0]),
            diag(d[1]),
            diag(d[2]),
            corr(self.xy, d[0] * d[1]),
            corr(self.xz, d[0] * d[2]),
            corr(self.yz, d[1] * d[2]),
        ]
    }

    /// Square root of the largest diagonal element, by which [`Sggx::encode`] divides.
    pub fn scale(&self) -> f32 {
        self.xx.max(self.yy).max(self.zz).max(0.0).sqrt()
    }

    /// The matrix of six codes. About one code in twelve of random matrices is not positive; such correlations are scaled
    /// back until the determinant is, so every result is positive semidefinite.
    #[inline(always)]
    pub fn decode(code: [u8; 6]) -> Sggx {
        let d = each3([code[0], code[1], code[2]], |v| f32::from(v) * (1.0 / 255.0));
        let mut r = each3([code[3], code[4], code[5]], |v| ((f32::from(v) - 128.0) * (1.0 / 127.0)).max(-1.0));
        let det = 1.0 + 2.0 * r[0] * r[1] * r[2] - r[0] * r[0] - r[1] * r[1] - r[2] * r[2];
        if det < 0.0 {
            let f = positive_scale(r);
            r = each3(r, |v| v * f);
        }
        let [xy, xz, yz] = [r[0] * d[0] * d[1], r[1] * d[0] * d[2], r[2] * d[1] * d[2]];
        Sggx { xx: d[0] * d[0], yy: d[1] * d[1], zz: d[2] * d[2], xy, xz, yz }
    }
}

/// The largest multiple of 2^-14 in [0, 1) by which the correlations `r` make a positive semidefinite matrix. Half of the voxels
/// of thin leaves need it.
#[inline]
fn positive_scale(r: [f32; 3]) -> f32 {
    const STEP: f32 = 1.0 / 16_384.0;
    let (product, squares) = (r[0] * r[1] * r[2], r[0] * r[0] + r[1] * r[1] + r[2] * r[2]);
    // Determinant of the matrix of correlations times f. It falls from 1 at f = 0 to less than 0 at f = 1.
    let det = |f: f32| 1.0 + 2.0 * f * f * f * r[0] * r[1] * r[2] - f * f * squares;
    // Newton's method, then single steps to the exact multiple. Fourteen bisections took 4 % of the time of a distant view.
    let mut f = 1.0f32;
    for _ in 0..3 {
        f -= det(f) / (f * (6.0 * product * f - 2.0 * squares));
    }
    f = if f > 0.0 { (f.min(1.0 - STEP) / STEP).floor() * STEP } else { 0.0 };
    while f > 0.0 && det(f) < 0.0 {
        f -= STEP;
    }
    while f + STEP < 1.0 && det(f + STEP) >= 0.0 {
        f += STEP;
    }
    f
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn facet(n: Vec3) -> Sggx {
        Sggx { xx: n.x * n.x, yy: n.y * n.y, zz: n.z * n.z, xy: n.x * n.y, xz: n.x * n.z, yz: n.y * n.z }
    }

    #[test]
    fn codes_that_make_no_positive_matrix_are_scaled_as_little_as_that_takes() {
        let det = |f: f32, r: [f32; 3]| {
            1.0 + 2.0 * f * f * f * r[0] * r[1] * r[2] - f * f * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        };
        let codes = || (-127..=127).step_by(6).map(|v| v as f32 / 127.0);
        let mut scaled = 0;
        for (a, b, c) in codes().flat_map(|a| codes().flat_map(move |b| codes().map(move |c| (a, b, c)))) {
            let r = [a, b, c];
            if det(1.0, r) >= 0.0 {
                continue;
            }
            scaled += 1;
            let f = positive_scale(r);
            let next = f + 1.0 / 16_384.0;
            assert!(det(f, r) >= 0.0 && (next >= 1.0 || det(next, r) < 0.0), "{r:?}: {f}");
        }
        assert!(scaled > 10_000, "{scaled}");
    }

    #[test]
    fn single_facets_survive_the_code() {
        for n in [Vec3::X, Vec3::Z, Vec3::new(0.6, -0.8, 0.0), Vec3::new(-0.48, 0.6, 0.64), Vec3::ONE.normalize()] {
            let s = facet(n);
            let back = Sggx::decode(s.encode()).scaled(s.scale() * s.scale());
            for w in [Vec3::X, Vec3::Y, Vec3::new(0.6, 0.0, 0.8), n] {
                // Half a step of 1/255 on each of three products of the diagonal: under 3 * 2/255.
                assert!((back.sigma(w) - n.dot(w).abs()).abs() < 0.024, "{n} {w} {} {}", back.sigma(w), n.dot(w));
            }
        }
    }

    proptest! {
        #[test]
        fn every_code_decodes_to_a_positive_matrix(code: [u8; 6], x in -1.0f32..1.0, y in -1.0f32..1.0, z in -1.0f32..1.0) {
            let s = Sggx::decode(code);
            // Rounding of nine products of values <= 1.
            prop_assert!(s.quad(Vec3::new(x, y, z)) > -2e-6);
        }
    }
}
