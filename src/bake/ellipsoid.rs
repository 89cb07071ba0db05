//! The ellipsoid of normals that fits values measured in 13 directions.
//!
//! Based on: E. Heitz et al., *The SGGX Microflake Distribution*, SIGGRAPH 2015; F. Neyret, *A General and Multiscale Model
//! for Volumetric Textures*, GI 1995.

use super::chord::Lanes;
use crate::geom::{AXES13, larger};
use crate::volume::Sggx;

/// What the six numbers of S are multiplied with to give w^T S w, for each of the 13 directions w.
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

/// [`FEATURES`] by number, in lanes.
const LANES: [Lanes; 6] = {
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

/// The products of two features each, row by row of the upper half of their matrix.
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

/// Projected areas of `s` along the 13 axes.
#[inline(always)]
pub fn sigmas(s: &Sggx) -> Lanes {
    let values = [s.xx, s.yy, s.zz, s.xy, s.xz, s.yz];
    let mut out = [0.0; 16];
    for (features, value) in LANES.iter().zip(values) {
        for k in 0..16 {
            out[k] += features[k] * value;
        }
    }
    for sigma in &mut out {
        *sigma = larger(*sigma, 0.0).sqrt();
    }
    out
}

/// The symmetric positive S with sqrt(w^T S w) nearest to `values` in the 13 directions; `None` where all are 0.
pub fn fit_sggx(values: &[f64; 13]) -> Option<Sggx> {
    fit_weighted(values, &[1.0; 13])
}

/// [`fit_sggx`] with how much an error in each direction counts, in [0, 1].
#[inline(always)]
pub fn fit_weighted(values: &[f64; 13], weights: &[f64; 13]) -> Option<Sggx> {
    let mean = values.iter().sum::<f64>() / 13.0;
    if !mean.is_finite() || mean <= 1e-12 {
        return None;
    }
    // Normal equations of w^T S w = y^2, weighted by 1 / y^2 so that relative errors of y count.
    let (mut products, mut right) = ([0.0; 24], [0.0; 6]);
    for (k, (&value, &counts)) in values.iter().zip(weights).enumerate() {
        let y2 = (value / mean) * (value / mean);
        let weight = counts / (y2 + 0.01);
        for (sum, product) in products.iter_mut().zip(&PRODUCTS[k]) {
            *sum += weight * product;
        }
        for (sum, feature) in right.iter_mut().zip(&FEATURES[k]) {
            *sum += weight * feature * y2;
        }
    }
    let mut eq = [[0.0f64; 7]; 6];
    let mut next = products.into_iter();
    for (i, (row, right)) in eq.iter_mut().zip(right).enumerate() {
        row[6] = right;
        row[i..6].iter_mut().zip(&mut next).for_each(|(to, product)| *to = product);
    }
    let x = solve(eq);
    let [xx, yy, zz, xy, xz, yz] = positive(x).map(|v| (v * mean * mean) as f32);
    Some(Sggx { xx, yy, zz, xy, xz, yz })
}

/// Solve the symmetric positive 6×6 system, given by its upper half and the right-hand side, by Gauss's elimination.
#[inline(always)]
fn solve(mut eq: [[f64; 7]; 6]) -> [f64; 6] {
    let mut inverse = [0.0; 6];
    for i in 0..6 {
        eq[i][i] += 1e-9;
        inverse[i] = 1.0 / eq[i][i];
        for r in i + 1..6 {
            let f = eq[i][r] * inverse[i];
            for c in r..7 {
                eq[r][c] -= f * eq[i][c];
            }
        }
    }
    let mut x = [0.0; 6];
    for i in (0..6).rev() {
        let mut rest = 0.0;
        for j in i + 1..6 {
            rest += eq[i][j] * x[j];
        }
        x[i] = (eq[i][6] - rest) * inverse[i];
    }
    x
}

/// Whether all eigenvalues of the matrix are at least 1e-4 of their sum: by the minors of the rest.
#[inline(always)]
fn is_positive([xx, yy, zz, xy, xz, yz]: [f64; 6]) -> bool {
    let least = 1e-4 * (xx + yy + zz);
    let (x, y, z) = (xx - least, yy - least, zz - least);
    let minor = x * y - xy * xy;
    let determinant = z * minor - x * yz * yz - y * xz * xz + 2.0 * xy * xz * yz;
    x > 0.0 && minor > 0.0 && determinant > 0.0
}

/// The matrix (xx yy zz xy xz yz) with its eigenvalues raised to 1e-4 of the largest: Jacobi's rotations.
fn positive(s: [f64; 6]) -> [f64; 6] {
    if is_positive(s) {
        return s;
    }
    let small = 1e-5 * (s[0].abs() + s[1].abs() + s[2].abs());
    let mut a = [[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]];
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0f64]];
    for _ in 0..8 {
        for (p, q) in [(0usize, 1usize), (0, 2), (1, 2)] {
            if a[p][q].abs() <= small {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let sn = t * c;
            let turn = |x: f64, y: f64| (c * x - sn * y, sn * x + c * y);
            for row in &mut a {
                (row[p], row[q]) = turn(row[p], row[q]);
            }
            let (rp, rq) = (a[p], a[q]);
            for (k, (x, y)) in rp.into_iter().zip(rq).enumerate() {
                (a[p][k], a[q][k]) = turn(x, y);
            }
            for row in &mut v {
                (row[p], row[q]) = turn(row[p], row[q]);
            }
        }
    }
    let largest = a[0][0].max(a[1][1]).max(a[2][2]).max(0.0);
    let l: [f64; 3] = std::array::from_fn(|i| a[i][i].max(1e-4 * largest));
    let at = |i: usize, j: usize| (0..3).map(|e| l[e] * v[i][e] * v[j][e]).sum();
    [at(0, 0), at(1, 1), at(2, 2), at(0, 1), at(0, 2), at(1, 2)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{DVec3, directions13};

    #[test]
    fn a_single_facet_is_recovered() {
        for n in [DVec3::X, DVec3::new(0.6, -0.8, 0.0), DVec3::new(0.48, 0.6, -0.64)] {
            let s = fit_sggx(&directions13().map(|w| 2.5 * w.dot(n).abs())).unwrap();
            for w in [DVec3::Y, DVec3::new(0.0, 0.6, 0.8), n] {
                // Eigenvalues are raised to 1e-4 of the largest: sigma to .01 of it.
                assert!((f64::from(s.sigma(w.as_vec3())) - 2.5 * w.dot(n).abs()).abs() < 0.03);
            }
        }
    }
}
