//! Fitted voxels of a bake: they are appended block by block in Morton order, and rates are corrected group by group.

use super::coverage_error::CoverageError;
use super::fit::{BlockMeasure, fit_block};
use super::group_transmittance::GroupTransmittance;
use super::materials::MaterialWeights;
use super::projected_cell::Cell;
use super::refine::{correct_group, scale_rate_codes};
use crate::volume::material::{COARSE_STEP, FINE_STEP};
use crate::volume::{Depth, Model};

/// Options of the fit.
#[derive(Debug, Clone, Copy)]
pub struct FitOptions {
    pub model: Model,
    /// Number of group sizes, each twice the last, whose rates are corrected; 0: none.
    pub refine: usize,
    /// Whether voxels store mixes of materials.
    pub track_materials: bool,
}

/// Fitted voxels, one list per depth, in Morton order.
pub struct Output {
    pub depths: Vec<Depth>,
    /// Errors of the coverage, per depth.
    pub errors: Vec<CoverageError>,
    /// Materials of the root.
    pub materials: MaterialWeights,
    pub options: FitOptions,
}

/// Cell of a block, and the child mask of its voxel.
pub struct CellWithMask<'a> {
    pub cell: Cell<'a>,
    pub mask: u8,
}

impl Output {
    /// Output without voxels.
    pub fn new(depths: usize, options: FitOptions) -> Output {
        Output {
            depths: vec![Depth::default(); depths],
            errors: vec![CoverageError::default(); depths],
            materials: MaterialWeights::default(),
            options,
        }
    }

    /// Append the voxels of `next`, which follow in Morton order.
    pub fn append(&mut self, mut next: Output) {
        for (mine, theirs) in self.depths.iter_mut().zip(&mut next.depths) {
            mine.masks.append(&mut theirs.masks);
            mine.voxels.append(&mut theirs.voxels);
            mine.mixes.append(&mut theirs.mixes);
        }
        for (mine, theirs) in self.errors.iter_mut().zip(&next.errors) {
            mine.merge(theirs);
        }
    }

    /// Fit the `cells` of a block, which are voxels of `depth`, and append them. Returns the block's transmittance where groups of
    /// blocks are to be corrected.
    pub fn fit(&mut self, depth: usize, cells: Vec<CellWithMask>, block: &BlockMeasure) -> Option<GroupTransmittance> {
        let step = if depth + 1 == self.depths.len() { COARSE_STEP } else { FINE_STEP };
        let out = &mut self.depths[depth];
        out.masks.extend(cells.iter().map(|c| c.mask));
        if self.options.track_materials {
            out.mixes.extend(cells.iter().map(|c| c.cell.measure.materials.mix(step)));
        }
        let cells: Vec<Cell> = cells.into_iter().map(|c| c.cell).collect();
        let fit = fit_block(&cells, block, self.options.model);
        out.voxels.extend_from_slice(fit.voxels());
        if let Some(errors) = &fit.errors {
            self.errors[depth].add(errors);
        }
        (self.options.refine > 0).then_some(fit.transmittance)
    }

    /// Correct the rates of the last voxels of `depth`, those of the groups `children`, so that they cover the oblique areas
    /// `cover`; children that are `solid` are opaque cubes. Returns the transmittance of their group; `None` where there is none.
    pub fn correct(
        &mut self,
        depth: usize,
        children: &[Option<&GroupTransmittance>; 8],
        solid: [bool; 8],
        cover: &[f64; 13],
    ) -> Option<GroupTransmittance> {
        let group = correct_group(children, solid, cover)?;
        let voxels = &mut self.depths[depth].voxels;
        let first = voxels.len().saturating_sub(group.transmittance.voxels);
        scale_rate_codes(&mut voxels[first..], group.code_steps);
        Some(group.transmittance)
    }
}
