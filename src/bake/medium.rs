//! Semi-transparent matter: cubes filled evenly by a cloud of specks, entered into the same measure as facets.
//!
//! Based on: J. Kajiya, B. Von Herzen, *Ray Tracing Volume Densities*, SIGGRAPH 1984 (what a density takes away along a ray);
//! W. Jakob et al., *A Radiative Transfer Framework for Rendering Materials with Anisotropic Structure*, SIGGRAPH 2010
//! (extinction by flakes with normals).
//!
//! A cube blocks the share of its lines that its density takes away, which is exact. Which lines these are is drawn from a
//! fixed table: a line is blocked from some extinction on, in an order that the cube's place chooses, so that cubes which are
//! united at a coarser depth hide one another as independent matter does.

use std::sync::LazyLock;

use super::beams::Beams;
use crate::geom::DVec3;
use crate::geom::projection::{PROJECTIONS, crossing};
use crate::geom::{axis_length, box_area};
use crate::random::SplitMix64;
use crate::source::Medium;
use crate::volume::chord::Chords;

/// What a cube of a medium adds to a voxel; lengths in edges of the cube.
pub struct Share {
    pub lo: DVec3,
    pub hi: DVec3,
    pub beams: Beams,
    /// Oblique area of what is blocked, an axis.
    pub cover: [f64; 13],
    /// Area of the flakes, both faces as one.
    pub area: f64,
    /// Sum of their area vectors, where they face one way.
    pub facing: DVec3,
}

/// Orders in which lines are blocked; turned and shifted there are more, so that two cubes seldom have the same.
const ORDERS: usize = 127;
/// Extinctions in the table: 2^(level / STEPS − OCTAVES_BELOW) hits an edge.
const LEVELS: usize = 40;
const STEPS: f64 = 3.5;
const OCTAVES_BELOW: f64 = 8.0;

/// By order and level.
static TABLE: LazyLock<Vec<Beams>> = LazyLock::new(|| {
    let mut table = vec![Beams::default(); ORDERS * LEVELS];
    for (order, table) in table.chunks_exact_mut(LEVELS).enumerate() {
        for k in 0..13 {
            for (row, bit, depth) in thresholds(order, k) {
                let (x, y) = middle(row, bit);
                let Some((from, to)) = crossing(k, x, y, DVec3::ZERO, DVec3::ONE) else { continue };
                let first = (libm::log2(depth / ((to - from) * axis_length(k))) + OCTAVES_BELOW) * STEPS;
                if let Some(beams) = table.get_mut(first.ceil().max(0.0) as usize) {
                    beams.set(k, row, bit);
                }
            }
        }
        for level in 1..LEVELS {
            let (below, above) = table.split_at_mut(level);
            above[0].unite_with(&below[level - 1]);
        }
    }
    table
});

/// Plane coordinates of a line, voxel edges.
fn middle(row: usize, bit: usize) -> (f64, f64) {
    let at = |i: usize| (i as f64 + 0.5) / crate::geom::projection::LINES as f64;
    (at(bit), at(row))
}

/// The optical depth from which on each line of axis `k` through a voxel is blocked: row, bit, depth.
fn thresholds(order: usize, k: usize) -> Vec<(usize, usize, f64)> {
    let (wa, wb) = PROJECTIONS[k].extent();
    let all = (0..16 * wb).flat_map(|row| (0..16 * wa).map(move |bit| (row, bit)));
    let mut lines: Vec<(u64, usize, usize)> = all
        .filter(|&(row, bit)| {
            let (x, y) = middle(row, bit);
            crossing(k, x, y, DVec3::ZERO, DVec3::ONE).is_some()
        })
        .map(|(row, bit)| (mix((order << 24 | k << 16 | row << 8 | bit) as u64), row, bit))
        .collect();
    lines.sort_unstable();
    let count = lines.len() as f64;
    // One line in every equal part of [0, 1).
    lines
        .into_iter()
        .enumerate()
        .map(|(n, (_, row, bit))| (row, bit, -libm::log1p(-(n as f64 + 0.5) / count)))
        .collect()
}

/// A fixed number for every number.
fn mix(v: u64) -> u64 {
    SplitMix64::new(v).bits()
}

/// What `medium` adds to the cube of `2^levels` voxels at the voxel `at`, which is a part of its own cube.
pub fn share(medium: &Medium, at: [u32; 3], levels: u32) -> Option<Share> {
    // The filled part, in edges of the cube that is asked about.
    let ratio = f64::from(1u32 << medium.levels.saturating_sub(levels));
    let edge = f64::from(1u32 << levels);
    let offset = (DVec3::from(at.map(f64::from)) - DVec3::from(medium.at.map(f64::from))) / edge;
    let lo = (medium.lo * ratio - offset).max(DVec3::ZERO);
    let hi = (medium.hi * ratio - offset).min(DVec3::ONE);
    if !lo.cmplt(hi).all() {
        return None;
    }
    let rates = medium.rates(levels);
    let e = hi - lo;
    let lanes = std::array::from_fn(|k| rates.get(k).map_or(1.0, |&r| r as f32).max(1e-12));
    let blocked = Chords::new(e).blocked(&lanes, 0.0);
    let cover = std::array::from_fn(|k| box_area(k, e) * f64::from(blocked[k]));
    let seed = mix(u64::from(at[0]) | u64::from(at[1]) << 20 | u64::from(at[2]) << 40 | u64::from(levels) << 60);
    let whole = lo == DVec3::ZERO && hi == DVec3::ONE;
    let beams = if whole { whole_cube(seed, &rates) } else { part_of_cube(seed, &rates, lo, hi) };
    // Facets of area A block A / 2 in the mean over all directions.
    let area = 2.0 * medium.extinction * edge * e.element_product();
    Some(Share { lo, hi, beams, cover, area, facing: area * medium.facing * medium.normal })
}

fn whole_cube(seed: u64, rates: &[f64; 13]) -> Beams {
    let mut beams = Beams::default();
    let table = &*TABLE;
    for (k, &rate) in rates.iter().enumerate() {
        let draw = mix(seed ^ k as u64);
        let level = (libm::log2(rate) + OCTAVES_BELOW) * STEPS;
        // Less than the table has: its least, as seldom as makes up for it.
        if level < 0.0 && f64::from(draw as u32) > 4_294_967_296.0 * libm::exp2(level / STEPS) {
            continue;
        }
        let level = (level.round().max(0.0) as usize).min(LEVELS - 1);
        let order = (draw >> 32) as usize % ORDERS;
        beams.copy_axis(k, &table[order * LEVELS + level], (draw >> 52) as u32);
    }
    beams
}

fn part_of_cube(seed: u64, rates: &[f64; 13], lo: DVec3, hi: DVec3) -> Beams {
    let mut beams = Beams::default();
    for (k, &rate) in rates.iter().enumerate() {
        for (row, bit, depth) in thresholds((mix(seed ^ k as u64) >> 32) as usize, k) {
            let (x, y) = middle(row, bit);
            if let Some((from, to)) = crossing(k, x, y, lo, hi)
                && rate * (to - from) * axis_length(k) > depth
            {
                beams.set(k, row, bit);
            }
        }
    }
    beams
}
