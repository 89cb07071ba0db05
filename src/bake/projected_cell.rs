//! A voxel of a block as it is seen along the 13 axes, through the support box that its rays will meet.

use super::measure::Measure;
use crate::geom::{DVec3, Vec3, larger, smaller};
use crate::volume::Voxel;
use crate::volume::chord::{Chords, LENGTHS, Lanes, OPAQUE, SolvedRates, box_areas};

/// Least slope of an opaque box's opacity over the logarithm of its rate that weights are computed with.
const MIN_OPAQUE_SLOPE: f32 = 0.15;
/// Least thickness of an unrounded box, in voxel edges: that of the thinnest support box. Thinner ones would all ask for the
/// largest rate.
const MIN_THICKNESS: f64 = 1.0 / 16.0;

/// A voxel of a block that is to be fitted.
pub struct Cell<'a> {
    /// Position in the block: x, y, z.
    pub at: [u8; 3],
    pub measure: &'a Measure,
}

/// Opacity and chords of a box along the axes.
pub struct ProjectedBox {
    /// Share of the box's projection that is covered, at most [`OPAQUE`].
    pub opacity: Lanes,
    pub chords: Chords,
}

/// Projections of a cell along the 13 axes.
pub struct ProjectedCell {
    /// Support box, rounded outward to sixteenths: lower and upper corner.
    pub lo: Vec3,
    pub hi: Vec3,
    /// Support box as rays will see it.
    pub rounded: ProjectedBox,
    /// Area of the support box's projection, per axis.
    pub area: Lanes,
    /// Tight box of the matter, before it is rounded outward. Rates are fitted to it: a layer that is opaque to every line along
    /// its normal stays so, where the mean opacity of a wider box would let light through.
    pub unrounded: ProjectedBox,
}

impl ProjectedCell {
    /// Projections of a cell; the support of `voxel` is set.
    #[inline(always)]
    pub fn new(cell: &Measure, voxel: &mut Voxel) -> ProjectedCell {
        voxel.set_support(cell.lo.to_array(), cell.hi.to_array());
        let (lo, hi) = voxel.support_box();
        let e = (hi - lo).as_dvec3();
        let oblique = box_areas(e);
        let tight = (cell.hi - cell.lo).max(DVec3::splat(MIN_THICKNESS));
        let narrow = box_areas(tight);
        let mut cover = [0.0; 16];
        cover.iter_mut().zip(&cell.cover).for_each(|(to, &cover)| *to = cover as f32);
        let (mut opacity, mut area, mut inner) = ([0.0; 16], [0.0; 16], [0.0; 16]);
        for k in 0..16 {
            opacity[k] = (cover[k] / oblique[k]).clamp(0.0, OPAQUE);
            area[k] = oblique[k] / LENGTHS[k];
            inner[k] = (cover[k] / narrow[k]).clamp(0.0, OPAQUE);
        }
        ProjectedCell {
            lo,
            hi,
            rounded: ProjectedBox { opacity, chords: Chords::new(e) },
            area,
            unrounded: ProjectedBox { opacity: inner, chords: Chords::new(tight) },
        }
    }

    /// Area that a box of these `opacities` covers, summed over the 13 axes.
    #[inline(always)]
    pub fn covered_area(&self, opacities: &Lanes) -> f32 {
        (0..13).map(|k| opacities[k] * self.area[k]).sum()
    }

    /// Weight in [1e-4, 1] of an error of the rate along each axis: the square of the change of opacity that the error causes,
    /// relative to faint matter, which has the weight 1. So axes count little along which a box is opaque, since larger rates do
    /// no harm there.
    #[inline(always)]
    pub fn rate_weights(&self, solved: &SolvedRates) -> Lanes {
        let ProjectedBox { opacity, chords } = &self.unrounded;
        let SolvedRates { rates, slopes } = solved;
        let mut weights = [1.0; 16];
        for k in 0..16 {
            // For an opaque box the slope is near 0, but only towards larger rates: with a lower rate it does lose opacity.
            let slope = larger(slopes[k], MIN_OPAQUE_SLOPE * opacity[k]);
            let change = chords.inverse_mean[k] * slope / larger(rates[k], 1e-20);
            let weight = larger(smaller(change * change, 1.0), 1e-4);
            weights[k] = if rates[k] > 0.0 { weight } else { 1.0 };
        }
        weights
    }
}
