//! Least-squares fit of an SGGX matrix S to projected areas along the 13 axes.
//!
//! Based on: E. Heitz et al., *The SGGX Microflake Distribution*, SIGGRAPH 2015; F. Neyret, *A General and Multiscale Model
//! for Volumetric Textures*, GI 1995; O. K. Smith, *Eigenvalues of a Symmetric 3 × 3 Matrix*, CACM 4(4), 1961.

use crate::geom::{AXES13, larger};
use crate::volume::Sggx;
use crate::volume::chord::Lanes;

/// Coefficients of the six numbers of S in w^T S w, for each of the 13 directions w.
const FEATURES: [[f64; 6]; 13] = features();

const fn features() -> [[f64; 6]; 13] {
    let mut out = [[0.0; 6]; 13];
    let mut k = 0;
    while k < 13 {
        let (x, y, z) = (AXES13[k][0] as f64, AXES13[k][1] as f64, AXES13[k][2] as f64);
        let n = x * x + y * y + z * z;
        out[k] = [x * x / n, y * y / n, z * z / n, 2.0 * x * y / n, 2.0 * x * z / n, 2.0 * y * z / n];
        k += 1;
    }
    out
}

/// [`FEATURES`] in lanes, one row per number of S.
const FEATURE_LANES: [Lanes; 6] = {
    let mut out = [[0.0; 16]; 6];
    let mut k = 0;
    while k < 13 {
        let mut i = 0;
        while i < 6 {
            out[i][k] = FEATURES[k][i] as f32;
            i += 1;
        }
        k += 1;
    }
    out
};

/// Products of two features each, for each direction: the upper half of their matrix, row by row, padded to 24.
const PRODUCTS: [[f64; 24]; 13] = {
    let mut out = [[0.0; 24]; 13];
    let mut k = 0;
    while k < 13 {
        let (mut n, mut i) = (0, 0);
        while i < 6 {
            let mut j = i;
            while j < 6 {
                out[k][n] = FEATURES[k][i] * FEATURES[k][j];
                (n, j) = (n + 1, j + 1);
            }
            i += 1;
        }
        k += 1;
    }
    out
};

/// Projected areas σ(w) = √(w^T S w) of `s` along the 13 axes.
#[inline(always)]
pub fn sigmas(s: &Sggx) -> Lanes {
    let values = [s.xx, s.yy, s.zz, s.xy, s.xz, s.yz];
    let mut out = [0.0; 16];
    for (features, value) in FEATURE_LANES.iter().zip(values) {
        for k in 0..16 {
            out[k] += features[k] * value;
        }
    }
    for sigma in &mut out {
        *sigma = larger(*sigma, 0.0).sqrt();
    }
    out
}

/// Number of matrices that are fitted at once.
pub const BATCH: usize = 4;
/// One number of each matrix of a batch.
type Batch = [f64; BATCH];

/// Symmetric positive definite S whose σ(w) are nearest to `values`, projected areas of any unit along the 13 axes, by relative
/// error. `None` where all values are 0.
pub fn fit_sggx(values: &[f32; 13]) -> Option<Sggx> {
    let mut lanes = [0.0; 16];
    lanes[..13].copy_from_slice(values);
    fit_weighted(&[lanes; BATCH], &[[1.0; 16]; BATCH])[0]
}

/// [`fit_sggx`] of a batch, with a weight in [0, 1] of the error along each axis.
#[inline(always)]
pub fn fit_weighted(values: &[Lanes; BATCH], weights: &[Lanes; BATCH]) -> [Option<Sggx>; BATCH] {
    let mut eq = [[[0.0; BATCH]; 7]; 6];
    let mut means = [0.0; BATCH];
    for l in 0..BATCH {
        let mean = values[l][..13].iter().sum::<f32>() / 13.0;
        if !mean.is_finite() || mean <= 1e-12 {
            continue;
        }
        means[l] = f64::from(mean);
        // Normal equations of w^T S w = y², weighted by 1 / y² so that relative errors of y count.
        let (mut weight, mut weighted, scale) = ([0.0; 16], [0.0; 16], 1.0 / mean);
        for k in 0..16 {
            let y2 = (values[l][k] * scale) * (values[l][k] * scale);
            weight[k] = weights[l][k] / (y2 + 0.01);
            weighted[k] = weight[k] * y2;
        }
        let (mut products, mut right) = ([0.0; 24], [0.0; 6]);
        for k in 0..13 {
            let (weight, weighted) = (f64::from(weight[k]), f64::from(weighted[k]));
            for (sum, product) in products.iter_mut().zip(&PRODUCTS[k]) {
                *sum += weight * product;
            }
            for (sum, feature) in right.iter_mut().zip(&FEATURES[k]) {
                *sum += weighted * feature;
            }
        }
        let mut next = 0;
        for i in 0..6 {
            for j in i..6 {
                eq[i][j][l] = products[next];
                next += 1;
            }
            eq[i][6][l] = right[i];
        }
    }
    let s = raise_eigenvalues(solve(eq));
    let mut out = [None; BATCH];
    for (l, out) in out.iter_mut().enumerate() {
        if means[l] > 0.0 {
            let value = |i: usize| (s[i][l] * means[l] * means[l]) as f32;
            *out = Some(Sggx { xx: value(0), yy: value(1), zz: value(2), xy: value(3), xz: value(4), yz: value(5) });
        }
    }
    out
}

/// Solutions of symmetric positive definite 6×6 systems, given by the upper halves of their matrices and, in the last column, their
/// right-hand sides, by Gaussian elimination.
#[inline(always)]
fn solve(mut eq: [[Batch; 7]; 6]) -> [Batch; 6] {
    let mut inverse = [[0.0; BATCH]; 6];
    for i in 0..6 {
        for l in 0..BATCH {
            eq[i][i][l] += 1e-9;
            inverse[i][l] = 1.0 / eq[i][i][l];
        }
        for r in i + 1..6 {
            let mut f = [0.0; BATCH];
            for l in 0..BATCH {
                f[l] = eq[i][r][l] * inverse[i][l];
            }
            for c in r..7 {
                for l in 0..BATCH {
                    eq[r][c][l] -= f[l] * eq[i][c][l];
                }
            }
        }
    }
    let mut x = [[0.0; BATCH]; 6];
    for i in (0..6).rev() {
        let mut rest = [0.0; BATCH];
        for j in i + 1..6 {
            for l in 0..BATCH {
                rest[l] += eq[i][j][l] * x[j][l];
            }
        }
        for l in 0..BATCH {
            x[i][l] = (eq[i][6][l] - rest[l]) * inverse[i][l];
        }
    }
    x
}

/// Whether all eigenvalues of the matrix exceed 1e-4 of their sum, by Sylvester's criterion.
#[inline(always)]
fn is_well_conditioned([xx, yy, zz, xy, xz, yz]: [f64; 6]) -> bool {
    let least = 1e-4 * (xx + yy + zz);
    let (x, y, z) = (xx - least, yy - least, zz - least);
    let minor = x * y - xy * xy;
    let determinant = z * minor - x * yz * yz - y * xz * xz + 2.0 * xy * xz * yz;
    x > 0.0 && minor > 0.0 && determinant > 0.0
}

/// The matrices (xx yy zz xy xz yz) with all eigenvalues raised to at least 1e-4 of the largest.
///
/// With S = m + p B, where m is a third of the trace and p scales B, the eigenvalues of B are the roots of x³ − 3 x = det B (Smith).
/// Newton's method finds the root that is farthest from the others, and a quadratic equation the other two. Raising one
/// eigenvalue, or two, then takes no eigenvector: the projection on an eigenvalue's axis is the product of S less each of the
/// other two eigenvalues, scaled.
#[inline(always)]
fn raise_eigenvalues(s: [Batch; 6]) -> [Batch; 6] {
    let mut fine = [false; BATCH];
    for l in 0..BATCH {
        fine[l] = is_well_conditioned([s[0][l], s[1][l], s[2][l], s[3][l], s[4][l], s[5][l]]);
    }
    if fine == [true; BATCH] {
        return s;
    }
    let mut out = s;
    for l in 0..BATCH {
        let [xx, yy, zz, xy, xz, yz] = [s[0][l], s[1][l], s[2][l], s[3][l], s[4][l], s[5][l]];
        let m = (xx + yy + zz) * (1.0 / 3.0);
        let (x, y, z) = (xx - m, yy - m, zz - m);
        let squares = x * x + y * y + z * z + 2.0 * (xy * xy + xz * xz + yz * yz);
        let p = (squares * (1.0 / 6.0)).sqrt().max(1e-90);
        let determinant = x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz);
        let half = (0.5 * determinant / (p * p * p)).clamp(-1.0, 1.0);
        // The outlying root is between √3 and 2 in absolute value.
        let (signed_p, half) = (p.copysign(half), half.abs());
        let mut outlier = 1.732_050_807_568_877_2 + half * 0.267_949_192_431_122_7;
        for _ in 0..3 {
            let square = outlier * outlier;
            outlier = (2.0 * square * outlier + 2.0 * half) / (3.0 * square - 3.0);
        }
        let split = (12.0 - 3.0 * outlier * outlier).max(0.0).sqrt();
        let first = m + signed_p * outlier;
        let (second, third) = (m + signed_p * 0.5 * (split - outlier), m - signed_p * 0.5 * (split + outlier));
        let (high, middle, low) = if signed_p > 0.0 { (first, second, third) } else { (third, second, first) };
        let least = 1e-4 * high.max(0.0);
        // One eigenvalue is raised by S + (least − low) P, where P projects on its axis; two by least + (high − least) P, where P
        // projects on the axis of the highest.
        let single = middle >= least;
        let (base, scale, from) = if single { (0.0, 1.0, low) } else { (least, 0.0, high) };
        let others = if single { (high, middle) } else { (middle, low) };
        let between = (from - others.0) * (from - others.1);
        let by = (if single { (least - low).max(0.0) } else { high - least })
            / if between.abs() > 1e-300 { between } else { 1e-300 };
        // P = (S − others.0) (S − others.1) / between.
        let (ax, ay, az) = (xx - others.0, yy - others.0, zz - others.0);
        let (bx, by_, bz) = (xx - others.1, yy - others.1, zz - others.1);
        let products = [
            ax * bx + xy * xy + xz * xz,
            xy * xy + ay * by_ + yz * yz,
            xz * xz + yz * yz + az * bz,
            ax * xy + xy * by_ + xz * yz,
            ax * xz + xy * yz + xz * bz,
            xy * xz + ay * yz + yz * bz,
        ];
        for i in 0..6 {
            let raised = scale * s[i][l] + by * products[i] + if i < 3 { base } else { 0.0 };
            out[i][l] = if fine[l] {
                s[i][l]
            } else if high > 0.0 {
                raised
            } else {
                0.0
            };
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{DMat3, DVec3, directions13};

    /// R diag(values) R^T, as xx yy zz xy xz yz.
    fn turned(axes: DMat3, values: DVec3) -> [f64; 6] {
        let m = axes * DMat3::from_diagonal(values) * axes.transpose();
        [m.x_axis.x, m.y_axis.y, m.z_axis.z, m.x_axis.y, m.x_axis.z, m.y_axis.z]
    }

    #[test]
    fn eigenvalues_are_raised_and_axes_kept() {
        // None, one and two below 1e-4 of the largest; equal ones; none above 0; nothing at all.
        let values = [
            [3.0, 2.0, 1.0],
            [1.0, 1.0, 1.0],
            [2.0, 1.0, -0.3],
            [2.0, 2.0, -0.3],
            [5.0, -1.0, -1.0],
            [5.0, -1.0, -0.2],
            [1.0, 0.0, 0.0],
            [1.0, 1e-4, 1e-5],
            [1.0, 1e-4, -1e-12],
            [1.0, 0.7, 0.0],
            [-1.0, -2.0, -3.0],
            [0.0, 0.0, 0.0],
        ];
        for (n, &v) in values.iter().enumerate() {
            for turn in 0..8 {
                let axis = DVec3::new(1.0, turn as f64 - 3.0, 0.3 * n as f64).normalize();
                let axes = DMat3::from_axis_angle(axis, 0.7 * turn as f64);
                for scale in [1e-6, 1.0, 1e6] {
                    let v = DVec3::from(v) * scale;
                    let largest = v.max_element().max(0.0);
                    let want =
                        turned(axes, if largest > 0.0 { v.max(DVec3::splat(1e-4 * largest)) } else { DVec3::ZERO });
                    let s = turned(axes, v);
                    let got = raise_eigenvalues(s.map(|value| [value; BATCH]));
                    for i in 0..6 {
                        // The roots that do not stand apart are right to the root of f64's rounding, 1e-8 of the spread,
                        // which is taken for 1e-90 at least.
                        let error = (got[i][turn % BATCH] - want[i]).abs();
                        assert!(error <= 1e-7 * v.abs().max_element() + 1e-90, "{n} {turn} {i}: {got:?} {want:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_single_facet_is_recovered() {
        for n in [DVec3::X, DVec3::new(0.6, -0.8, 0.0), DVec3::new(0.48, 0.6, -0.64)] {
            let s = fit_sggx(&directions13().map(|w| 2.5 * w.dot(n).abs() as f32)).unwrap();
            for w in [DVec3::Y, DVec3::new(0.0, 0.6, 0.8), n] {
                // Eigenvalues are raised to 1e-4 of the largest: sigma to .01 of it.
                assert!((f64::from(s.sigma(w.as_vec3())) - 2.5 * w.dot(n).abs()).abs() < 0.03);
            }
        }
    }
}
