//! Fit of a block: from the measurements of its cells to voxels that, when they are marched, cover the measured areas.
//!
//! Based on: E. Heitz, J. Dupuy, C. Crassin, C. Dachsbacher, *The SGGX Microflake Distribution*, SIGGRAPH 2015; D. Vicini,
//! W. Jakob, A. Kaplanyan, *A Non-Exponential Transmittance Model for Volumetric Scene Representations*, SIGGRAPH 2021;
//! G. Loubet, F. Neyret, *Hybrid Mesh-Volume LoDs for All-Scale Pre-Filtering*, EG 2017; F. Neyret, *Synthesizing Verdant
//! Landscapes using Volumetric Textures*, INRIA RR-2846, 1996 (the isotropic model).

use super::block_lines::{BlockLineValues, BlockLines, MARCH_LINES};
use super::correlation::choose_correlation;
use super::coverage_error::{SquareErrors, square_errors};
use super::ellipsoid::sigmas;
use super::group_transmittance::GroupTransmittance;
use super::line_mask::LineMask;
use super::measure::Measure;
use super::ndf::{FitTarget, solve_ndfs};
use super::projected_cell::{Cell, ProjectedCell};
use super::refine::solve_log_gain;
use crate::geom::larger;
use crate::simd::multiversioned;
use crate::volume::chord::{Lanes, MAX_RATE, OPAQUE, exp_neg};
use crate::volume::voxel::{RATE_MAX, encode_rate};
use crate::volume::{Model, Sggx, Voxel};

/// Most voxels of a block.
const MAX_BLOCK_CELLS: usize = 64;
/// Relative error of the covered area below which a rate scale is not corrected any further.
const AREA_TOLERANCE: f32 = 0.005;
/// Rate of the code 1, hits per voxel edge: 2^(−143/16).
const SMALLEST_RATE: f64 = 0.002_039_597_231_303_542_5;

/// Measurements of a block as a whole.
pub struct BlockMeasure<'a> {
    pub measure: &'a Measure,
    /// Lines that the block covers, with the insides of solids.
    pub mask: &'a LineMask,
    /// Oblique area that the block covers, with the insides of solids, per axis.
    pub cover: [f64; 13],
    /// Octants that are opaque cubes without cells.
    pub solid_octants: [bool; 8],
    /// Cells along the block's edge: 1, 2 or 4.
    pub width: usize,
}

/// Fitted block.
pub struct BlockFit {
    voxels: [Voxel; MAX_BLOCK_CELLS],
    count: usize,
    /// Errors of its coverage; `None` for the model of 1996, which is not fitted to coverage.
    pub errors: Option<SquareErrors>,
    pub transmittance: GroupTransmittance,
}

impl BlockFit {
    /// Voxels, in the order of the cells.
    pub fn voxels(&self) -> &[Voxel] {
        &self.voxels[..self.count]
    }
}

/// Rates of a block's cells before they are corrected together.
struct BlockRates {
    /// Normal distribution, and rate in hits per voxel edge; 0 for cells that have none of their own.
    ndfs: [Option<[u8; 6]>; MAX_BLOCK_CELLS],
    rates: [f32; MAX_BLOCK_CELLS],
    /// Rates along the axes.
    along: Vec<Lanes>,
}

/// Marched block, with its rates corrected.
struct MarchedBlock {
    transmittance: GroupTransmittance,
    /// Logarithm of the factor that corrects the rates.
    log_gain: f32,
}

/// Encoder of a block's rates that keeps the sum of those too small for a code, by error diffusion (R. Floyd, L. Steinberg, *An
/// Adaptive Algorithm for Spatial Greyscale*, 1976). Without it a haze of less than .0019 hits per voxel edge would be coded as
/// nothing, however wide it is.
#[derive(Default)]
struct RateEncoder {
    /// Rate times volume that cells so far had more than their codes hold.
    residual: f64,
}

impl RateEncoder {
    /// Code of `rate` ≥ 0, hits per voxel edge, of matter in a box of this `volume`.
    #[inline(always)]
    fn encode(&mut self, rate: f64, volume: f64) -> u8 {
        let code = encode_rate(rate);
        if code > 0 || rate.is_nan() || rate <= 0.0 {
            return code;
        }
        let step = SMALLEST_RATE * volume;
        self.residual += rate * volume;
        if self.residual < 0.5 * step {
            return 0;
        }
        self.residual -= step;
        1
    }
}

multiversioned! {
    /// Fit the `cells`, at most 64, of one block.
    pub fn fit_block(cells: &[Cell], block: &BlockMeasure, model: Model) -> BlockFit = fit_cells;
}

#[inline(always)]
fn fit_cells(cells: &[Cell], block: &BlockMeasure, model: Model) -> BlockFit {
    let mut voxels = [Voxel::default(); MAX_BLOCK_CELLS];
    let mut projected = Vec::with_capacity(cells.len());
    for (voxel, cell) in voxels.iter_mut().zip(cells) {
        projected.push(ProjectedCell::new(cell.measure, voxel));
    }
    let lines = BlockLines::new(cells.iter().zip(&projected).map(|(cell, p)| (cell.at, p.lo, p.hi)), block.width);
    // The particles of soft matter are independent, and their opacity is known exactly. The lines of its mask are drawn at
    // random, so a correlation found from them would be noise.
    let soft = block.measure.is_soft();
    let code = if soft { 0 } else { choose_correlation(cells, &projected, &lines, block.measure, block.width) };
    let c = f32::from(code) / 15.0;
    let mut targets = fit_targets(cells, &projected, c);
    solve_ndfs(&mut targets, &projected);
    let rates = scale_rates(cells, &targets, &projected, c);
    let marched = march_and_correct(&lines.optical_depths(&rates.along), cells.len(), block, c, soft);
    let errors = match model {
        Model::Coverage => Some(square_errors(&marched.transmittance, block.mask)),
        Model::Neyret => None,
    };
    let mut encoder = RateEncoder::default();
    for (i, (voxel, cell)) in voxels.iter_mut().zip(cells).enumerate() {
        encode(voxel, cell.measure, code);
        if let Some(ndf) = rates.ndfs[i] {
            voxel.ndf = ndf;
        }
        if model == Model::Neyret {
            make_isotropic(voxel, cell.measure, &mut encoder);
        } else if rates.rates[i] > 0.0 {
            let e = exp_neg(marched.log_gain.abs());
            let rate = if marched.log_gain < 0.0 { rates.rates[i] * e } else { rates.rates[i] / e };
            let volume = (projected[i].hi - projected[i].lo).element_product();
            voxel.rate = encoder.encode(f64::from(rate), f64::from(volume));
        }
    }
    BlockFit { voxels, count: cells.len(), errors, transmittance: marched.transmittance }
}

/// Rates that the cells' opacities ask for along the axes; solid cells have none.
#[inline(always)]
fn fit_targets(cells: &[Cell], projected: &[ProjectedCell], c: f32) -> Vec<FitTarget> {
    let mut targets = Vec::with_capacity(cells.len());
    for (i, (cell, projected)) in cells.iter().zip(projected).enumerate() {
        if !cell.measure.solid {
            let solved = projected.unrounded.chords.solve_rates(&projected.unrounded.opacity, c);
            let weights = projected.rate_weights(&solved);
            targets.push(FitTarget { cell: i, rates: solved.rates, weights, ndf: None });
        }
    }
    targets
}

/// Encode the normal distributions, and scale their rates so that each cell covers its measured area, summed over the axes.
#[inline(always)]
fn scale_rates(cells: &[Cell], targets: &[FitTarget], projected: &[ProjectedCell], c: f32) -> BlockRates {
    let mut block = BlockRates {
        ndfs: [None; MAX_BLOCK_CELLS],
        rates: [0.0; MAX_BLOCK_CELLS],
        along: vec![[0.0f32; 16]; cells.len()],
    };
    for (along, cell) in block.along.iter_mut().zip(cells) {
        if cell.measure.solid {
            *along = [MAX_RATE; 16];
        }
    }
    for target in targets {
        let Some(s) = target.ndf else { continue };
        let i = target.cell;
        let code = s.encode();
        let sigma = sigmas(&Sggx::decode(code));
        block.ndfs[i] = Some(code);
        block.rates[i] = solve_rate_scale(&sigma, s.scale(), &projected[i], c);
        for k in 0..16 {
            block.along[i][k] = block.rates[i] * sigma[k];
        }
    }
    block
}

/// Rate, near `rate`, at which a cell of the projected areas `sigma` covers its measured area, summed over the 13 axes. Areas count
/// and not opacities: a thin sheet seen edge-on has next to no area.
#[inline(always)]
fn solve_rate_scale(sigma: &Lanes, rate: f32, cell: &ProjectedCell, c: f32) -> f32 {
    let want = cell.covered_area(&cell.rounded.opacity);
    let mut rate = rate;
    for _ in 0..2 {
        let mut rates = *sigma;
        rates.iter_mut().for_each(|r| *r = larger(*r * rate, 1e-12));
        let factor = want / cell.covered_area(&cell.rounded.chords.opacity(&rates, c));
        if (factor - 1.0).abs() < AREA_TOLERANCE {
            break;
        }
        // Near opaque the area hardly depends on the rate, so a step could be far too large.
        rate = (rate * factor.clamp(0.5, 2.0)).min(MAX_RATE);
    }
    rate
}

/// March the block, and correct the rates of its cells together so that it covers what was measured.
#[inline(always)]
fn march_and_correct(
    depths: &BlockLineValues,
    voxels: usize,
    block: &BlockMeasure,
    c: f32,
    soft: bool,
) -> MarchedBlock {
    let mut transmittance = GroupTransmittance::from_block(MARCH_LINES * block.width, c, depths, voxels);
    for (j, &solid) in block.solid_octants.iter().enumerate() {
        if solid {
            transmittance.occlude_octant(j);
        }
    }
    transmittance.measure_areas();
    let mut log_gain = 0.0;
    if voxels > 1 && !soft {
        log_gain = solve_log_gain(&transmittance, &block.cover);
        transmittance.apply_log_gain(log_gain);
    }
    MarchedBlock { transmittance, log_gain }
}

/// Set all codes of a voxel but its support, normal distribution and rate; the rate is set where the cell is solid.
#[inline(always)]
fn encode(voxel: &mut Voxel, cell: &Measure, correlation: u8) {
    voxel.correlation = correlation;
    voxel.set_albedo(cell.albedo.to_array());
    if cell.total > 0.0 {
        voxel.set_mean_normal(cell.mean.to_array(), cell.mean.length() / cell.total);
    }
    if cell.solid {
        voxel.rate = RATE_MAX;
    }
}

/// Turn a voxel into one of Neyret's model of 1996: one isotropic opacity over the whole voxel, whose rate takes it away over a
/// voxel's edge. The normal distribution stays for shading; there is neither support nor correlation.
#[inline(always)]
fn make_isotropic(voxel: &mut Voxel, cell: &Measure, encoder: &mut RateEncoder) {
    voxel.correlation &= 0xf0;
    voxel.support = Voxel::default().support;
    if !cell.solid {
        let opacity = cell.mean_opacity.min(OPAQUE.into());
        voxel.rate = encoder.encode(-libm::log(1.0 - opacity), 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::voxel::decode_rate;

    #[test]
    fn faint_rates_keep_their_sum() {
        // The constant is the f64 of which the table holds the f32.
        assert_eq!(decode_rate(1), SMALLEST_RATE as f32);
        for (rate, volume) in [(0.0012, 1.0), (0.0003, 0.25), (0.0018, 0.5)] {
            let mut encoder = RateEncoder::default();
            let codes: Vec<u8> = (0..64).map(|_| encoder.encode(rate, volume)).collect();
            let sum: f64 = codes.iter().map(|&code| f64::from(decode_rate(code))).sum();
            // What is left over is less than half a code of one of them.
            assert!((sum - 64.0 * rate).abs() <= 0.501 * SMALLEST_RATE, "{rate} {codes:?}");
        }
        assert_eq!(RateEncoder::default().encode(0.5, 1.0), encode_rate(0.5));
        assert_eq!(RateEncoder::default().encode(0.0, 1.0), 0);
    }
}
