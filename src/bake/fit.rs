//! From measures to voxels: the block correlation that makes a marched block cover what was measured, then rate and SGGX.
//!
//! Based on: E. Heitz et al., *The SGGX Microflake Distribution*, SIGGRAPH 2015; D. Vicini et al., *A Non-Exponential
//! Transmittance Model for Volumetric Scene Representations*, SIGGRAPH 2021; G. Loubet, F. Neyret, *Hybrid Mesh-Volume
//! LoDs for All-Scale Pre-Filtering*, EG 2017.

use super::beams::{PROJECTIONS, axis_length, box_area, crossing};
use super::chord::Chords;
use super::measure::Measure;
use crate::geom::{DVec3, directions13};
use crate::volume::voxel::{RATE_MAX, encode_rate};
use crate::volume::{Model, Sggx, Voxel};

/// Share of a support box from which on it is taken for opaque.
const OPAQUE: f64 = 0.996;
/// Lines a voxel edge on which a block is marched.
const MARCH_LINES: usize = 2;
/// Correlations at which a block is marched; the law is smooth in between.
const TRIALS: [f64; 3] = [0.0, 0.5, 1.0];

/// A voxel of a block, to be fitted.
pub struct Cell<'a> {
    /// Place in the block: x, y, z.
    pub at: [u8; 3],
    pub measure: &'a Measure,
}

/// What is known of a cell along the 13 axes, through the support box that a ray will see.
struct Seen {
    lo: DVec3,
    hi: DVec3,
    /// Share of the box that is blocked.
    blocked: [f64; 13],
    chords: [Chords; 13],
}

impl Seen {
    fn new(cell: &Measure, voxel: &mut Voxel) -> Seen {
        voxel.set_support(cell.lo.to_array(), cell.hi.to_array());
        let (lo, hi) = voxel.support_box();
        let (lo, hi) = (lo.as_dvec3(), hi.as_dvec3());
        let e = hi - lo;
        let area: [f64; 13] = std::array::from_fn(|k| box_area(k, e));
        Seen {
            lo,
            hi,
            blocked: std::array::from_fn(|k| (cell.cover[k] / area[k]).clamp(0.0, OPAQUE)),
            chords: std::array::from_fn(|k| Chords::new(k, e)),
        }
    }
}

/// Fit all cells of one block, `width` cells wide, whose own measure is `block`. Voxels come in the order of the cells.
/// Gives the mean error of the marched block's coverage besides: [`Certificate`].
pub fn fit_block(cells: &[Cell], block: &Measure, width: usize, model: Model, voxels: &mut Vec<Voxel>) {
    let mut fitted = [Voxel::default(); 64];
    let mut seen = Vec::with_capacity(cells.len());
    for (voxel, cell) in fitted.iter_mut().zip(cells) {
        seen.push(Seen::new(cell.measure, voxel));
    }
    let code = if model == Model::Neyret { 0 } else { correlation(cells, &seen, block, width) };
    let c = f64::from(code) / 15.0;
    for ((voxel, cell), seen) in fitted.iter_mut().zip(cells).zip(&seen) {
        let m = cell.measure;
        voxel.correlation = code;
        if m.solid {
            voxel.rate = RATE_MAX;
        } else {
            fit_rate(voxel, m, seen, c);
        }
        voxel.set_albedo(m.albedo.to_array());
        if m.total > 0.0 {
            voxel.set_mean_normal(m.mean.to_array(), m.mean.length() / m.total);
        }
        voxels.push(*voxel);
    }
}

/// The code of the c with which the marched block best covers what was measured, in 13 directions.
fn correlation(cells: &[Cell], seen: &[Seen], block: &Measure, width: usize) -> u8 {
    if cells.len() < 2 {
        return 15;
    }
    let rates: Vec<[[f32; 3]; 13]> = seen
        .iter()
        .map(|s| std::array::from_fn(|k| TRIALS.map(|c| s.chords[k].rate(s.blocked[k], c) as f32)))
        .collect();
    let blocks = (width * width) as f64;
    let mut overlap = [[0.0f64; 3]; 13];
    let mut wanted = [0.0f64; 13];
    let mut weight = [0.0f64; 13];
    let mut depths = [[0.0f32; 3]; 256];
    for (k, p) in PROJECTIONS.iter().enumerate() {
        let parts: f64 = cells.iter().map(|c| c.measure.cover[k]).sum();
        if parts <= 0.0 {
            continue;
        }
        wanted[k] = (1.0 - blocks * block.cover[k] / parts).clamp(0.0, 1.0);
        weight[k] = parts / axis_length(k);
        let (wa, wb) = p.extent();
        let (na, nb) = (wa * width * MARCH_LINES, wb * width * MARCH_LINES);
        depths[..na * nb].fill([0.0; 3]);
        let mut alone = [0.0f32; 3];
        for ((cell, s), rate) in cells.iter().zip(seen).zip(&rates) {
            let rate = rate[k];
            let (oa, ob) = p.place(cell.at, width);
            let length = axis_length(k) as f32;
            for j in 0..wb * MARCH_LINES {
                for i in 0..wa * MARCH_LINES {
                    let at = |n: usize| (n as f64 + 0.5) / MARCH_LINES as f64;
                    let Some((from, to)) = crossing(k, at(i), at(j), s.lo, s.hi) else { continue };
                    let chord = (to - from) as f32 * length;
                    let line = &mut depths[(ob * MARCH_LINES + j) * na + oa * MARCH_LINES + i];
                    for t in 0..3 {
                        let tau = rate[t] * chord;
                        line[t] += tau;
                        alone[t] += blocked(tau, t);
                    }
                }
            }
        }
        for t in 0..3 {
            let union: f32 = depths[..na * nb].iter().map(|d| if d[t] > 0.0 { blocked(d[t], t) } else { 0.0 }).sum();
            overlap[k][t] = if alone[t] > 0.0 { f64::from(1.0 - union / alone[t]) } else { wanted[k] };
        }
    }
    let error = |code: u8| -> f64 {
        let c = f64::from(code) / 15.0;
        // Through the three trials: Lagrange's parabola at 0, 1/2, 1.
        let (a, b, d) = ((1.0 - c) * (1.0 - 2.0 * c), 4.0 * c * (1.0 - c), c * (2.0 * c - 1.0));
        (0..13)
            .map(|k| {
                let o = overlap[k];
                let miss = weight[k] * (a * o[0] + b * o[1] + d * o[2] - wanted[k]);
                miss * miss
            })
            .sum()
    };
    (0..16u8).min_by(|&a, &b| error(a).total_cmp(&error(b))).unwrap_or(0)
}

/// What an optical depth blocks at `TRIALS[trial]`.
#[inline]
fn blocked(tau: f32, trial: usize) -> f32 {
    match trial {
        0 => 1.0 - exp_neg(tau),
        1 => (2.0 - 2.0 * exp_neg(0.5 * tau)).min(1.0),
        _ => tau.min(1.0),
    }
}

/// e^−x for x ≥ 0, to 1e-5: (1 − x/2^8 + …)^(2^8) by squaring; no library's exp, so the same everywhere.
#[inline]
fn exp_neg(x: f32) -> f32 {
    let y = -x.min(40.0) / 64.0;
    let mut e = 1.0 + y * (1.0 + y * (0.5 + y * (1.0 / 6.0 + y * (1.0 / 24.0))));
    for _ in 0..6 {
        e *= e;
    }
    e
}

/// Rate and SGGX of one voxel from its coverage along the 13 axes.
fn fit_rate(voxel: &mut Voxel, m: &Measure, seen: &Seen, c: f64) {
    let rates: [f64; 13] = std::array::from_fn(|k| seen.chords[k].rate(seen.blocked[k], c));
    let areas: [f64; 13] = std::array::from_fn(|k| m.area[k] / axis_length(k));
    let _ = areas;
    let Some(s) = fit_sggx(&rates) else {
        voxel.rate = 0;
        return;
    };
    voxel.ndf = s.encode();
    voxel.rate = encode_rate(f64::from(s.scale()));
}

/// The symmetric positive S with sqrt(w^T S w) nearest to `values` in the 13 directions; `None` where all are 0.
pub fn fit_sggx(values: &[f64; 13]) -> Option<Sggx> {
    let mean = values.iter().sum::<f64>() / 13.0;
    if !mean.is_finite() || mean <= 1e-12 {
        return None;
    }
    // Normal equations of w^T S w = y^2, weighted by 1 / y^2 so that relative errors of y count.
    let mut eq = [[0.0f64; 7]; 6];
    for (w, &value) in directions13().iter().zip(values) {
        let y2 = (value / mean) * (value / mean);
        let weight = 1.0 / (y2 + 0.01);
        let f = [w.x * w.x, w.y * w.y, w.z * w.z, 2.0 * w.x * w.y, 2.0 * w.x * w.z, 2.0 * w.y * w.z];
        for i in 0..6 {
            for j in i..6 {
                eq[i][j] += weight * f[i] * f[j];
            }
            eq[i][6] += weight * f[i] * y2;
        }
    }
    let x = solve(eq);
    let [xx, yy, zz, xy, xz, yz] = positive(x).map(|v| (v * mean * mean) as f32);
    Some(Sggx { xx, yy, zz, xy, xz, yz })
}

/// Solve the symmetric positive 6×6 system, given by its upper half and the right-hand side, by Gauss's elimination.
fn solve(mut eq: [[f64; 7]; 6]) -> [f64; 6] {
    for i in 0..6 {
        eq[i][i] += 1e-9;
        for r in i + 1..6 {
            let f = eq[i][r] / eq[i][i];
            for c in r..7 {
                eq[r][c] -= f * eq[i][c];
            }
        }
    }
    let mut x = [0.0; 6];
    for i in (0..6).rev() {
        let rest: f64 = (i + 1..6).map(|j| eq[i][j] * x[j]).sum();
        x[i] = (eq[i][6] - rest) / eq[i][i];
    }
    x
}

/// The matrix (xx yy zz xy xz yz) with its eigenvalues raised to 1e-4 of the largest: Jacobi's rotations.
fn positive(s: [f64; 6]) -> [f64; 6] {
    let mut a = [[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]];
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0f64]];
    for _ in 0..8 {
        for (p, q) in [(0usize, 1usize), (0, 2), (1, 2)] {
            if a[p][q].abs() < 1e-15 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let sn = t * c;
            for k in 0..3 {
                let (x, y) = (a[k][p], a[k][q]);
                (a[k][p], a[k][q]) = (c * x - sn * y, sn * x + c * y);
            }
            for k in 0..3 {
                let (x, y) = (a[p][k], a[q][k]);
                (a[p][k], a[q][k]) = (c * x - sn * y, sn * x + c * y);
            }
            for row in &mut v {
                let (x, y) = (row[p], row[q]);
                (row[p], row[q]) = (c * x - sn * y, sn * x + c * y);
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

    #[test]
    fn exp_neg_is_exp() {
        for i in 0..400 {
            let x = i as f32 * 0.1;
            assert!((exp_neg(x) - (-x).exp()).abs() < 2e-5, "{x}");
        }
    }
}
