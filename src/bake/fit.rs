//! From measures to voxels: the block correlation that makes a marched block cover what was measured, then rate and SGGX.
//!
//! Based on: E. Heitz et al., *The SGGX Microflake Distribution*, SIGGRAPH 2015; D. Vicini et al., *A Non-Exponential
//! Transmittance Model for Volumetric Scene Representations*, SIGGRAPH 2021; G. Loubet, F. Neyret, *Hybrid Mesh-Volume
//! LoDs for All-Scale Pre-Filtering*, EG 2017.

use super::beams::{PROJECTIONS, axis_length, box_area, crossing};
use super::chord::Chords;
use super::ellipsoid::fit_sggx;
use super::measure::Measure;
use crate::geom::DVec3;
use crate::volume::voxel::{RATE_MAX, encode_rate};
use crate::volume::{Model, Voxel};

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
            fit_rate(voxel, seen, c);
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
fn fit_rate(voxel: &mut Voxel, seen: &Seen, c: f64) {
    let rates: [f64; 13] = std::array::from_fn(|k| seen.chords[k].rate(seen.blocked[k], c));
    let Some(s) = fit_sggx(&rates) else {
        voxel.rate = 0;
        return;
    };
    voxel.ndf = s.encode();
    voxel.rate = encode_rate(f64::from(s.scale()));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_neg_is_exp() {
        for i in 0..400 {
            let x = i as f32 * 0.1;
            assert!((exp_neg(x) - (-x).exp()).abs() < 2e-5, "{x}");
        }
    }
}
