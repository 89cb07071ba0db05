//! Coverage by semi-transparent matter: cubes filled evenly with small particles, measured like facets.
//!
//! Based on: J. Kajiya, B. Von Herzen, *Ray Tracing Volume Densities*, SIGGRAPH 1984 (what a density takes away along a ray);
//! W. Jakob et al., *A Radiative Transfer Framework for Rendering Materials with Anisotropic Structure*, SIGGRAPH 2010
//! (extinction by flakes with normals).
//!
//! The area that a cube covers is exact: the opacity of its extinction, averaged over its chords. The line mask holds as many
//! lines as that, drawn pseudo-randomly: each line is blocked from some extinction on, in an order that depends on the cube's
//! position. So cubes that are united at a coarser depth hide one another as statistically independent matter does.

use std::sync::LazyLock;

use super::line_mask::LineMask;
use crate::geom::DVec3;
use crate::geom::projection::{LINES, PROJECTIONS, crossing};
use crate::geom::{axis_length, box_area};
use crate::random::SplitMix64;
use crate::source::Medium;
use crate::volume::chord::Chords;

/// Part of a cube that a medium covers; lengths in edges of the cube.
pub struct MediumCoverage {
    /// Filled box, lower and upper corner.
    pub lo: DVec3,
    pub hi: DVec3,
    pub mask: LineMask,
    /// Oblique area that is covered, per axis.
    pub cover: [f64; 13],
    /// Area of the particles, counted once for both sides.
    pub area: f64,
    /// Sum of the particles' area vectors; 0 where they face all ways.
    pub facing: DVec3,
}

/// Number of orders in the table in which lines are blocked. Each is used shifted and reflected, so that two cubes seldom have the
/// same.
const ORDERS: usize = 127;
/// Number of rates in the table: rate `i` is 2^(i / RATES_PER_OCTAVE − OCTAVES_BELOW) hits per edge.
const RATES: usize = 40;
const RATES_PER_OCTAVE: f64 = 3.5;
const OCTAVES_BELOW: f64 = 8.0;

/// Thresholds of all lines, by order and axis. Boxes that fill their cube in part are frequent where texels are merged, and
/// without this table nine tenths of a merge went into sorting lines.
static THRESHOLDS: LazyLock<Vec<[Vec<LineThreshold>; 13]>> =
    LazyLock::new(|| (0..ORDERS).map(|order| std::array::from_fn(|k| line_thresholds(order, k))).collect());

/// Line masks of full cubes, by order and rate.
static TABLE: LazyLock<Vec<LineMask>> = LazyLock::new(|| {
    let mut table = vec![LineMask::default(); ORDERS * RATES];
    for (order, table) in table.chunks_exact_mut(RATES).enumerate() {
        for k in 0..13 {
            for &LineThreshold { row, bit, depth } in &THRESHOLDS[order][k] {
                let (row, bit) = (usize::from(row), usize::from(bit));
                let (x, y) = line_position(row, bit);
                let Some((from, to)) = crossing(k, x, y, DVec3::ZERO, DVec3::ONE) else { continue };
                let first = (libm::log2(depth / ((to - from) * axis_length(k))) + OCTAVES_BELOW) * RATES_PER_OCTAVE;
                if let Some(mask) = table.get_mut(first.ceil().max(0.0) as usize) {
                    mask.set(k, row, bit);
                }
            }
        }
        for rate in 1..RATES {
            let (below, above) = table.split_at_mut(rate);
            above[0].unite_with(&below[rate - 1]);
        }
    }
    table
});

/// Plane coordinates of a line, in voxel edges.
fn line_position(row: usize, bit: usize) -> (f64, f64) {
    let at = |i: usize| (i as f64 + 0.5) / LINES as f64;
    (at(bit), at(row))
}

/// Line of a mask, and the optical depth from which on it is blocked.
#[derive(Clone, Copy)]
struct LineThreshold {
    row: u8,
    bit: u8,
    depth: f64,
}

/// Thresholds of all lines of the axis `k` through a voxel, ascending, for the pseudo-random order `order`. The i-th of n lines is
/// blocked from the opacity (i + 1/2) / n on.
fn line_thresholds(order: usize, k: usize) -> Vec<LineThreshold> {
    let (wa, wb) = PROJECTIONS[k].extent();
    let all = (0..16 * wb).flat_map(|row| (0..16 * wa).map(move |bit| (row, bit)));
    let mut lines: Vec<(u64, usize, usize)> = all
        .filter(|&(row, bit)| {
            let (x, y) = line_position(row, bit);
            crossing(k, x, y, DVec3::ZERO, DVec3::ONE).is_some()
        })
        .map(|(row, bit)| (hash((order << 24 | k << 16 | row << 8 | bit) as u64), row, bit))
        .collect();
    lines.sort_unstable();
    let count = lines.len() as f64;
    lines
        .into_iter()
        .enumerate()
        .map(|(n, (_, row, bit))| LineThreshold {
            row: row as u8,
            bit: bit as u8,
            depth: -libm::log1p(-(n as f64 + 0.5) / count),
        })
        .collect()
}

/// Hash of a number.
fn hash(v: u64) -> u64 {
    SplitMix64::new(v).bits()
}

/// Coverage by `medium` of the cube of `2^edge_log2` voxels at the voxel `at`, which must lie in the medium's own cube. `None` where
/// the medium does not reach it.
pub fn cover_cube(medium: &Medium, at: [u32; 3], edge_log2: u32) -> Option<MediumCoverage> {
    // Filled box of the medium, in edges of the smaller cube.
    let ratio = f64::from(1u32 << medium.edge_log2.saturating_sub(edge_log2));
    let edge = f64::from(1u32 << edge_log2);
    let offset = (DVec3::from(at.map(f64::from)) - DVec3::from(medium.at.map(f64::from))) / edge;
    let lo = (medium.lo * ratio - offset).max(DVec3::ZERO);
    let hi = (medium.hi * ratio - offset).min(DVec3::ONE);
    if !lo.cmplt(hi).all() {
        return None;
    }
    let rates = medium.rates(edge_log2);
    let e = hi - lo;
    let lanes = std::array::from_fn(|k| rates.get(k).map_or(1.0, |&r| r as f32).max(1e-12));
    let opacity = Chords::new(e).opacity(&lanes, 0.0);
    let cover = std::array::from_fn(|k| box_area(k, e) * f64::from(opacity[k]));
    let seed = hash(u64::from(at[0]) | u64::from(at[1]) << 20 | u64::from(at[2]) << 40 | u64::from(edge_log2) << 60);
    let whole = lo == DVec3::ZERO && hi == DVec3::ONE;
    let mask = if whole { full_cube_mask(seed, &rates) } else { box_mask(seed, &rates, lo, hi) };
    // Facets of area A cover A / 2 in the mean over all directions.
    let area = 2.0 * medium.extinction * edge * e.element_product();
    Some(MediumCoverage { lo, hi, mask, cover, area, facing: area * medium.facing * medium.normal })
}

/// Line mask of a full cube of these `rates`, hits per edge along the axes.
fn full_cube_mask(seed: u64, rates: &[f64; 13]) -> LineMask {
    let mut mask = LineMask::default();
    let table = &*TABLE;
    for (k, &rate) in rates.iter().enumerate() {
        let draw = hash(seed ^ k as u64);
        let index = (libm::log2(rate) + OCTAVES_BELOW) * RATES_PER_OCTAVE;
        // Below the table's lowest rate, that one is used with a probability that makes up for it.
        if index < 0.0 && f64::from(draw as u32) > 4_294_967_296.0 * libm::exp2(index / RATES_PER_OCTAVE) {
            continue;
        }
        let index = (index.round().max(0.0) as usize).min(RATES - 1);
        let order = (draw >> 32) as usize % ORDERS;
        mask.copy_axis(k, &table[order * RATES + index], (draw >> 52) as u32);
    }
    mask
}

/// Line mask of the box `lo..hi` of a cube.
fn box_mask(seed: u64, rates: &[f64; 13], lo: DVec3, hi: DVec3) -> LineMask {
    let mut mask = LineMask::default();
    for (k, &rate) in rates.iter().enumerate() {
        let order = (hash(seed ^ k as u64) >> 32) as usize % ORDERS;
        // No chord of the box is longer than this.
        let longest = (hi - lo)[PROJECTIONS[k].drop] * axis_length(k);
        for &LineThreshold { row, bit, depth } in &THRESHOLDS[order][k] {
            if rate * longest <= depth {
                break;
            }
            let (row, bit) = (usize::from(row), usize::from(bit));
            let (x, y) = line_position(row, bit);
            if let Some((from, to)) = crossing(k, x, y, lo, hi)
                && rate * (to - from) * axis_length(k) > depth
            {
                mask.set(k, row, bit);
            }
        }
    }
    mask
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_of_boxes_hold_as_many_lines_as_are_covered() {
        // Corners on the lattice's own spacing, so that it counts areas exactly.
        let (lo, hi) = (DVec3::new(0.25, 0.0, 0.5), DVec3::new(0.75, 0.875, 1.0));
        for extinction in [0.05, 0.7, 4.0] {
            let medium = Medium { lo, hi, ..Medium::even([0; 3], 0, extinction, [1.0; 3]) };
            let (mut lines, mut area) = (0.0, 0.0);
            for n in 0..400u32 {
                let at = [n % 7, n / 7 % 7, n / 49];
                let part = cover_cube(&Medium { at, ..medium }, at, 0).unwrap();
                lines += f64::from(part.mask.counts().iter().sum::<u32>());
                area += part.cover.iter().sum::<f64>() * (LINES * LINES) as f64;
            }
            // At least 30 000 lines, drawn one by one: 1 % is some two standard deviations, and the lattice's chords are
            // those of the middles of its squares.
            assert!((lines / area - 1.0).abs() < 0.03, "{extinction}: {lines} {area}");
        }
    }
}
