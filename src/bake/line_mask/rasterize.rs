//! Rasterizes a polygon, or what its alpha leaves of it, into the line mask of its voxel.

use super::mask::LineMask;
use super::polygon::{MAX_PADDED_CORNERS, ProjectedPolygon};
use crate::bake::alpha_mask::AlphaMask;
use crate::geom::DVec3;
use crate::geom::polygon::Polygon;
use crate::geom::projection::{LINES, PROJECTIONS, Projection};
use crate::simd::multiversioned;

/// Add to `mask` the lines that meet `polygon` (in voxel edges, within the voxel at `origin`); with `alpha`, only those that meet its
/// opaque cells. The number of these lines is added to `sum_before_union`, axis by axis, whether the mask held them already or not.
pub fn rasterize(
    mask: &mut LineMask,
    polygon: &Polygon,
    origin: DVec3,
    alpha: Option<&AlphaMask>,
    sum_before_union: &mut [u32; 13],
) {
    rasterize_corners(mask, (polygon.corners(), origin), alpha, sum_before_union);
}

multiversioned! {
    fn rasterize_corners(
        mask: &mut LineMask,
        polygon: (&[DVec3], DVec3),
        alpha: Option<&AlphaMask>,
        sum_before_union: &mut [u32; 13],
    ) = rasterize_padded;
}

/// Rasterize a polygon of these corners in the voxel at this origin.
#[inline(always)]
fn rasterize_padded(
    mask: &mut LineMask,
    (corners, origin): (&[DVec3], DVec3),
    alpha: Option<&AlphaMask>,
    sum_before_union: &mut [u32; 13],
) {
    match corners.len() {
        ..=4 => rasterize_projected(mask, &ProjectedPolygon::<4>::new(corners, origin), alpha, sum_before_union),
        5..=8 => rasterize_projected(mask, &ProjectedPolygon::<8>::new(corners, origin), alpha, sum_before_union),
        _ => {
            let polygon = ProjectedPolygon::<MAX_PADDED_CORNERS>::new(corners, origin);
            rasterize_projected(mask, &polygon, alpha, sum_before_union);
        }
    }
}

#[inline(always)]
fn rasterize_projected<const N: usize>(
    mask: &mut LineMask,
    polygon: &ProjectedPolygon<N>,
    alpha: Option<&AlphaMask>,
    sum_before_union: &mut [u32; 13],
) {
    let mut found = [0u32; 32];
    for (k, p) in PROJECTIONS.iter().enumerate() {
        let [a, b] = p.coordinates;
        let (first, last) = polygon.ranges[b];
        // Most facets are smaller than the lattice's spacing and cross no row, or no line within one.
        if first >= last || polygon.ranges[a].0 >= polygon.ranges[a].1 {
            continue;
        }
        let count = polygon.scan_rows(a, b, &mut found);
        let Some(rows) = mask.rows.get_mut(p.first + first..p.first + last) else { continue };
        match alpha {
            None => {
                sum_before_union[k] += count;
                for (n, row) in rows.iter_mut().enumerate() {
                    *row |= std::mem::take(&mut found[(first + n) & 31]);
                }
            }
            Some(alpha) => {
                let cells = LineToCell::new(p, alpha);
                for (n, row) in rows.iter_mut().enumerate() {
                    let bits = std::mem::take(&mut found[(first + n) & 31]);
                    if bits != 0 {
                        let (from, to) = (bits.trailing_zeros(), 32 - bits.leading_zeros());
                        let bits = bits & cells.opaque_lines(alpha, first + n, from, to);
                        sum_before_union[k] += bits.count_ones();
                        *row |= bits;
                    }
                }
            }
        }
    }
}

/// Affine map from the lines of an axis to the cells of an alpha mask that they meet, in cells.
struct LineToCell {
    /// Image of the first line of the first row.
    first: [f64; 2],
    /// Steps from line to line and from row to row.
    line: [f64; 2],
    row: [f64; 2],
}

impl LineToCell {
    #[inline(always)]
    fn new(p: &Projection, alpha: &AlphaMask) -> LineToCell {
        let (normal, offset) = alpha.plane();
        let along = p.step();
        let along = along / normal.dot(along);
        let start = p.lift(0.5 / LINES as f64, 0.5 / LINES as f64, 0.0);
        let step = |q: usize| alpha.cell_step((DVec3::AXES[q] - normal[q] * along) / LINES as f64);
        let first = alpha.cell(start + (offset - normal.dot(start)) * along);
        LineToCell { first, line: step(p.a), row: step(p.b) }
    }

    /// Bits of the lines `from..to` of the row `n` that meet an opaque cell.
    #[inline(always)]
    fn opaque_lines(&self, alpha: &AlphaMask, n: usize, from: u32, to: u32) -> u32 {
        // A facet that is seen edge-on has hardly a line, and steps without bound: casts saturate, and cells are clamped.
        let fixed = |v: f64| (v * 65536.0) as i32;
        let cell = [0, 1].map(|i| fixed(self.first[i] + n as f64 * self.row[i] + f64::from(from) * self.line[i]));
        alpha.opaque_lines(from, to, cell, self.line.map(fixed))
    }
}
