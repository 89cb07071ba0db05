//! From measures to voxels: the block correlation that makes a marched block cover what was measured, then rate and SGGX.
//!
//! Based on: E. Heitz et al., *The SGGX Microflake Distribution*, SIGGRAPH 2015; D. Vicini et al., *A Non-Exponential
//! Transmittance Model for Volumetric Scene Representations*, SIGGRAPH 2021; G. Loubet, F. Neyret, *Hybrid Mesh-Volume
//! LoDs for All-Scale Pre-Filtering*, EG 2017.

use super::beams::{PROJECTIONS, axis_length, box_area, crossing};
use super::chord::{Chords, MAX_RATE, exp_neg};
use super::ellipsoid::fit_sggx;
use super::measure::Measure;
use crate::geom::{DVec3, directions13};
use crate::volume::voxel::{RATE_MAX, encode_rate};
use crate::volume::{Model, Sggx, Voxel, opacity};

/// Share of a support box from which on it is taken for opaque.
const OPAQUE: f64 = 0.996;
/// Lines a voxel edge on which a block is marched.
const MARCH_LINES: usize = 2;
/// Correlations at which a block is marched; the law is smooth in between.
const TRIALS: [f64; 3] = [0.0, 0.5, 1.0];
/// Factor of the rates at which a block is marched besides 1, and the largest that is given.
const GAIN_TRIAL: f32 = 1.5;
const MAX_GAIN: f64 = 2.5;

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
    /// Area of the box as it is seen.
    area: [f64; 13],
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
            area: std::array::from_fn(|k| area[k] / axis_length(k)),
        }
    }
}

/// How far fitted voxels are from what was measured: the mean over 13 directions of |share of the support box blocked,
/// fitted − measured|, of every voxel of a depth.
#[derive(Debug, Clone, Default)]
pub struct Certificate {
    count: u64,
    sum: f64,
    /// Voxels by error, in steps of 1/256.
    histogram: Vec<u64>,
}

impl Certificate {
    fn add(&mut self, error: f64) {
        self.count += 1;
        // Summed in fixed steps, so that the order in which regions are joined cannot show.
        self.sum += (error * 65536.0).round();
        self.histogram.resize(257, 0);
        self.histogram[(error * 256.0).clamp(0.0, 256.0) as usize] += 1;
    }

    pub fn merge(&mut self, other: &Certificate) {
        self.count += other.count;
        self.sum += other.sum;
        self.histogram.resize(257, 0);
        for (mine, theirs) in self.histogram.iter_mut().zip(&other.histogram) {
            *mine += theirs;
        }
    }

    /// Mean and 95th percentile; 0 where there are no voxels.
    pub fn figures(&self) -> (f64, f64) {
        let mean = self.sum / 65536.0 / self.count.max(1) as f64;
        let mut left = self.count - self.count * 95 / 100;
        for (step, &n) in self.histogram.iter().enumerate().rev() {
            if n >= left {
                return (mean, (step as f64 + 0.5) / 256.0);
            }
            left -= n;
        }
        (mean, 0.0)
    }
}

/// Fit all cells of one block, `width` cells wide, whose own measure is `block`. Voxels come in the order of the cells.
pub fn fit_block(
    cells: &[Cell],
    block: &Measure,
    width: usize,
    model: Model,
    voxels: &mut Vec<Voxel>,
    certificate: &mut Certificate,
) {
    let mut fitted = [Voxel::default(); 64];
    let mut seen = Vec::with_capacity(cells.len());
    for (voxel, cell) in fitted.iter_mut().zip(cells) {
        seen.push(Seen::new(cell.measure, voxel));
    }
    let lines = if cells.len() > 1 { Lines::new(cells, &seen, width) } else { Lines::new(&[], &[], width) };
    let code = correlation(cells, &seen, &lines, block, width);
    let c = f64::from(code) / 15.0;
    let rates: Vec<[f64; 13]> =
        seen.iter().map(|s| std::array::from_fn(|k| s.chords[k].rate(s.blocked[k], c))).collect();
    let gain = gain(cells, &lines, &rates, block, width, c);
    for (((voxel, cell), seen), rates) in fitted.iter_mut().zip(cells).zip(&seen).zip(&rates) {
        let m = cell.measure;
        voxel.correlation = code;
        voxel.set_albedo(m.albedo.to_array());
        if m.total > 0.0 {
            voxel.set_mean_normal(m.mean.to_array(), m.mean.length() / m.total);
        }
        if m.solid {
            voxel.rate = RATE_MAX;
        } else if let Some(s) = fit_sggx(rates) {
            voxel.ndf = s.encode();
            let (rate, error) = level(voxel.ndf, f64::from(s.scale()), seen, c);
            voxel.rate = encode_rate(rate * gain);
            certificate.add(error);
        }
        if model == Model::Neyret {
            neyret(voxel, m);
        }
        voxels.push(*voxel);
    }
}

/// The rate, near `rate`, with which a voxel of the ellipsoid `ndf` covers the area that was measured, summed over the 13 axes; and
/// the mean error that is left.
fn level(ndf: [u8; 6], rate: f64, seen: &Seen, c: f64) -> (f64, f64) {
    let shape = Sggx::decode(ndf);
    let sigma = directions13().map(|w| f64::from(shape.sigma(w.as_vec3())));
    let blocked = |rate: f64| -> [f64; 13] { std::array::from_fn(|k| seen.chords[k].blocked(rate * sigma[k], c)) };
    // By area: a thin sheet seen edge-on has next to none.
    let total = |shares: &[f64; 13]| shares.iter().zip(&seen.area).map(|(b, a)| b * a).sum::<f64>();
    let want = total(&seen.blocked);
    let mut rate = rate;
    let mut got = blocked(rate);
    for _ in 0..2 {
        let sum = total(&got);
        // Where almost all is blocked, the sum hardly moves with the rate.
        let next = (rate * (want / sum).clamp(0.5, 2.0)).min(MAX_RATE);
        if (want / sum - 1.0).abs() < 0.005 {
            break;
        }
        rate = next;
        got = blocked(rate);
    }
    let error = got.iter().zip(&seen.blocked).map(|(g, w)| (g - w).abs()).sum::<f64>() / 13.0;
    (rate, error)
}

/// The paper's own model: one isotropic opacity, the mean of what is covered, as a rate that takes that much away over a
/// voxel's edge; the ellipsoid is left for shading, and there is neither support nor correlation.
fn neyret(voxel: &mut Voxel, m: &Measure) {
    voxel.correlation &= 0xf0;
    voxel.support = Voxel::default().support;
    if !m.solid {
        let opacity = m.averaged.min(OPAQUE);
        voxel.rate = encode_rate(-libm::log(1.0 - opacity));
    }
}

/// The lines of all axes through the support boxes of a block's cells.
struct Lines {
    /// Cell, line, and chord.
    chords: Vec<(u8, u8, f32)>,
    /// Where each axis ends in `chords`.
    ends: [usize; 13],
    /// Lines of each axis.
    counts: [usize; 13],
}

impl Lines {
    fn new(cells: &[Cell], seen: &[Seen], width: usize) -> Lines {
        let mut lines = Lines { chords: Vec::with_capacity(64 * cells.len()), ends: [0; 13], counts: [0; 13] };
        let at = |n: usize| (n as f64 + 0.5) / MARCH_LINES as f64;
        for (k, p) in PROJECTIONS.iter().enumerate() {
            let (wa, wb) = p.extent();
            let na = wa * width * MARCH_LINES;
            let length = axis_length(k) as f32;
            for (i, (cell, s)) in cells.iter().zip(seen).enumerate() {
                let (oa, ob) = p.place(cell.at, width);
                for y in 0..wb * MARCH_LINES {
                    for x in 0..wa * MARCH_LINES {
                        if let Some((from, to)) = crossing(k, at(x), at(y), s.lo, s.hi) {
                            // At most 16 lines each way: below 256.
                            let line = (ob * MARCH_LINES + y) * na + oa * MARCH_LINES + x;
                            lines.chords.push((i as u8, line as u8, (to - from) as f32 * length));
                        }
                    }
                }
            }
            lines.ends[k] = lines.chords.len();
            lines.counts[k] = na * wb * width * MARCH_LINES;
        }
        lines
    }

    fn axis(&self, k: usize) -> &[(u8, u8, f32)] {
        &self.chords[if k == 0 { 0 } else { self.ends[k - 1] }..self.ends[k]]
    }
}

/// Share of the cells' coverage along axis `k` that hides behind other cells of the block, as measured; and the coverage.
fn hidden(k: usize, cells: &[Cell], block: &Measure, width: usize) -> (f64, f64) {
    let parts: f64 = cells.iter().map(|c| c.measure.cover[k]).sum();
    let share = if parts > 0.0 { 1.0 - (width * width) as f64 * block.cover[k] / parts } else { 0.0 };
    (share.clamp(0.0, 1.0), parts)
}

/// The code of the c with which the marched block best covers what was measured, in 13 directions.
fn correlation(cells: &[Cell], seen: &[Seen], lines: &Lines, block: &Measure, width: usize) -> u8 {
    if cells.len() < 2 {
        return 15;
    }
    let mut overlap = [[0.0f64; 3]; 13];
    let mut wanted = [0.0f64; 13];
    let mut weight = [0.0f64; 13];
    let mut depths = [[0.0f32; 3]; 256];
    let mut rates = vec![[0.0f32; 3]; cells.len()];
    for k in 0..13 {
        let parts;
        (wanted[k], parts) = hidden(k, cells, block, width);
        if parts <= 0.0 {
            continue;
        }
        weight[k] = parts / axis_length(k);
        for (rate, s) in rates.iter_mut().zip(seen) {
            // By the mean chord: what hides behind what hardly depends on it.
            *rate = TRIALS.map(|c| (opacity::depth_for(1.0 - s.blocked[k], c) / s.chords[k].mean) as f32);
        }
        depths.fill([0.0; 3]);
        let mut alone = [0.0f32; 3];
        for &(cell, line, chord) in lines.axis(k) {
            for t in 0..3 {
                let tau = rates[usize::from(cell)][t] * chord;
                depths[usize::from(line)][t] += tau;
                alone[t] += blocked(tau, t);
            }
        }
        for t in 0..3 {
            let union: f32 =
                depths[..lines.counts[k]].iter().map(|d| if d[t] > 0.0 { blocked(d[t], t) } else { 0.0 }).sum();
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

/// What to multiply the rates of a block by so that it covers, all directions together, what was measured. Parts of one
/// sheet need it: their support boxes overlap, and where three meet a ray the sum is cut off at 1.
fn gain(cells: &[Cell], lines: &Lines, rates: &[[f64; 13]], block: &Measure, width: usize, c: f64) -> f64 {
    if cells.len() < 2 {
        return 1.0;
    }
    let (mut want, mut got) = (0.0, [0.0f64; 2]);
    let mut depths = [0.0f32; 256];
    let c = c as f32;
    #[allow(clippy::needless_range_loop, reason = "k is an axis of all that is asked here")]
    for k in 0..13 {
        let (share, parts) = hidden(k, cells, block, width);
        if parts <= 0.0 {
            continue;
        }
        depths.fill(0.0);
        let mut alone = 0.0f32;
        for &(cell, line, chord) in lines.axis(k) {
            let tau = rates[usize::from(cell)][k] as f32 * chord;
            depths[usize::from(line)] += tau;
            alone += covered(tau, c);
        }
        if alone <= 0.0 {
            continue;
        }
        let weight = parts / axis_length(k);
        want += weight * (1.0 - share);
        for (got, gain) in got.iter_mut().zip([1.0, GAIN_TRIAL]) {
            let union: f32 = depths[..lines.counts[k]].iter().filter(|&&d| d > 0.0).map(|d| covered(d * gain, c)).sum();
            *got += weight * f64::from(union / alone);
        }
    }
    let slope = (got[1] - got[0]) / libm::log(f64::from(GAIN_TRIAL));
    if slope <= 1e-9 { 1.0 } else { libm::exp((want - got[0]) / slope).clamp(0.7, MAX_GAIN) }
}

/// The share that an optical depth blocks.
#[inline]
fn covered(tau: f32, c: f32) -> f32 {
    let d = 1.0 - c;
    if d < 1e-3 {
        return tau.min(1.0);
    }
    // T = (E − c) / (1 − c), E = e^−(1−c)τ.
    ((1.0 - exp_neg(d * tau)) / d).min(1.0)
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
