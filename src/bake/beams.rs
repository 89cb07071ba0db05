//! Coverage by beams: in 13 directions, which lines of a lattice that all voxels share meet matter in a voxel.
//!
//! Based on: L. Carpenter, *The A-buffer, an Antialiased Hidden Surface Method*, SIGGRAPH 1984 (coverage as bit masks);
//! G. Loubet, F. Neyret, *Hybrid Mesh-Volume LoDs for All-Scale Pre-Filtering*, EG 2017 (opacity fitted to measured coverage).
//!
//! An axis is projected obliquely on a coordinate plane: p → (p_a − s_a p_d, p_b − s_b p_d) with s = 0 or ±1. So a lattice of
//! 16 lines a voxel edge in that plane falls into the same lines for every voxel. The lines of a parent are one in four of its
//! children's, chosen by a fixed rule (quincunx), so a parent's mask is the union of its children's and coverage is measured
//! at every depth without going back to the geometry. Plane areas are "oblique": the area seen along the axis W (integers)
//! times |W|.

mod plane;
mod union;

use std::sync::{Arc, LazyLock};

use multiversion::multiversion;

use self::plane::{MOST_CORNERS, Plane};
pub use self::union::Union;
use super::cutout::CutOut;
use crate::geom::DVec3;
use crate::geom::polygon::Polygon;
use crate::geom::projection::{LINES, PROJECTIONS, Projection, ROWS, SQUARE, crossing};

/// The lattice lines, of all 13 axes, that meet matter in one voxel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Beams {
    rows: [u32; ROWS],
}

impl Default for Beams {
    fn default() -> Self {
        Beams { rows: [0; ROWS] }
    }
}

impl Beams {
    /// Lines of each axis.
    pub fn counts(&self) -> [u32; 13] {
        counts(self)
    }

    fn axis(&self, k: usize) -> &[u32] {
        let p = &PROJECTIONS[k];
        &self.rows[p.first..p.first + p.rows]
    }

    /// How many lines of the axis `k` are met in squares of `SQUARE` rows and columns; squares that the axis has not are 0.
    #[inline(always)]
    pub fn squares(&self, k: usize) -> [[u8; 8]; 8] {
        let mut squares = [[0; 8]; 8];
        for (rows, squares) in self.axis(k).as_chunks::<SQUARE>().0.iter().zip(&mut squares) {
            let (mut even, mut odd) = (0, 0);
            for row in rows {
                // Ones of each four columns, then of all rows, in a byte each.
                let pairs = row - (row >> 1 & 0x5555_5555);
                let fours = (pairs & 0x3333_3333) + (pairs >> 2 & 0x3333_3333);
                even += fours & 0x0f0f_0f0f;
                odd += fours >> 4 & 0x0f0f_0f0f;
            }
            let (even, odd) = (even.to_le_bytes(), odd.to_le_bytes());
            *squares = [even[0], odd[0], even[1], odd[1], even[2], odd[2], even[3], odd[3]];
        }
        squares
    }

    /// Add the lines through `polygon` (voxel edges, within the voxel at `origin`), or through what `cut` leaves of it. Adds
    /// the lines found, before they are united, to `parts`.
    pub fn add(&mut self, polygon: &Polygon, origin: DVec3, parts: &mut [u32; 13], cut: Option<&CutOut>) {
        add(self, (polygon.corners(), origin), parts, cut);
    }

    #[inline(always)]
    fn add_plane<const N: usize>(&mut self, plane: &Plane<N>, parts: &mut [u32; 13], cut: Option<&CutOut>) {
        let mut found = [0u32; 32];
        for (k, p) in PROJECTIONS.iter().enumerate() {
            let [a, b] = p.on;
            let (first, last) = plane.ranges[b];
            // Most facets are smaller than the lattice and cross no row, or no line in it.
            if first >= last || plane.ranges[a].0 >= plane.ranges[a].1 {
                continue;
            }
            let count = plane.rows(a, b, &mut found);
            let Some(rows) = self.rows.get_mut(p.first + first..p.first + last) else { continue };
            match cut {
                None => {
                    parts[k] += count;
                    for (n, row) in rows.iter_mut().enumerate() {
                        *row |= std::mem::take(&mut found[(first + n) & 31]);
                    }
                }
                Some(cut) => {
                    let cells = Cells::new(p, cut);
                    for (n, row) in rows.iter_mut().enumerate() {
                        let bits = std::mem::take(&mut found[(first + n) & 31]);
                        if bits != 0 {
                            let bits =
                                bits & cells.row(cut, first + n, bits.trailing_zeros(), 32 - bits.leading_zeros());
                            parts[k] += bits.count_ones();
                            *row |= bits;
                        }
                    }
                }
            }
        }
    }

    /// Block the line `bit` in the row `row` of the axis `k`.
    pub fn set(&mut self, k: usize, row: usize, bit: usize) {
        self.rows[PROJECTIONS[k].first + row] |= 1 << bit;
    }

    /// Take over the lines of the axis `k`, brought by a symmetry of the full voxel that `turn` chooses to other lines.
    pub fn copy_axis(&mut self, k: usize, other: &Beams, turn: u32) {
        let p = &PROJECTIONS[k];
        let from = other.axis(k);
        let to = &mut self.rows[p.first..p.first + p.rows];
        let (rows, bits) = ((turn & 15) as usize, turn >> 4 & 15);
        for (i, to) in to.iter_mut().enumerate() {
            *to = match (p.sa, p.sb) {
                (0, _) => {
                    let row = from[(i + rows) & 15];
                    (row << bits | row >> (16 - bits)) & 0xffff
                }
                (_, 0) if bits & 1 == 1 => from[(i + rows) & 15].reverse_bits(),
                (_, 0) => from[(i + rows) & 15],
                _ if bits & 1 == 1 => from[31 - i].reverse_bits(),
                _ => from[i],
            };
        }
    }

    /// Block all that `other` blocks.
    pub fn unite_with(&mut self, other: &Beams) {
        for (mine, theirs) in self.rows.iter_mut().zip(&other.rows) {
            *mine |= theirs;
        }
    }

    /// Block all that `other` blocks, and count its lines into `parts`.
    pub fn merge(&mut self, other: &Beams, parts: &mut [u32; 13]) {
        parts.iter_mut().zip(other.counts()).for_each(|(parts, more)| *parts += more);
        self.unite_with(other);
    }

    /// Every line through a full voxel; found once, as every solid voxel asks for them.
    pub fn full() -> &'static Arc<Beams> {
        static FULL: LazyLock<Arc<Beams>> = LazyLock::new(|| Arc::new(Beams::find_full()));
        &FULL
    }

    fn find_full() -> Beams {
        let mut beams = Beams::default();
        for (k, p) in PROJECTIONS.iter().enumerate() {
            let (wa, wb) = p.extent();
            for row in 0..16 * wb {
                for bit in 0..16 * wa {
                    let at = |i: usize| (i as f64 + 0.5) / LINES as f64;
                    if crossing(k, at(bit), at(row), DVec3::ZERO, DVec3::ONE).is_some() {
                        beams.rows[p.first + row] |= 1 << bit;
                    }
                }
            }
        }
        beams
    }
}

// Functions of their own, as no method can be compiled for several targets.

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+lzcnt+popcnt"))]
fn add(beams: &mut Beams, (corners, origin): (&[DVec3], DVec3), parts: &mut [u32; 13], cut: Option<&CutOut>) {
    match corners.len() {
        ..=4 => beams.add_plane(&Plane::<4>::new(corners, origin), parts, cut),
        5..=8 => beams.add_plane(&Plane::<8>::new(corners, origin), parts, cut),
        _ => beams.add_plane(&Plane::<MOST_CORNERS>::new(corners, origin), parts, cut),
    }
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+lzcnt+popcnt"))]
fn counts(beams: &Beams) -> [u32; 13] {
    let mut counts = [0; 13];
    for (k, count) in counts.iter_mut().enumerate() {
        *count = ones(beams.axis(k));
    }
    counts
}

/// How many bits of `rows`, an even number of them, are set.
#[inline(always)]
fn ones(rows: &[u32]) -> u32 {
    let mut count = 0;
    for &[a, b] in rows.as_chunks::<2>().0 {
        count += (u64::from(a) | u64::from(b) << 32).count_ones();
    }
    count
}

/// Where the lines of an axis meet the cells of a cut-out facet: an affine map.
struct Cells {
    first: [f64; 2],
    line: [f64; 2],
    row: [f64; 2],
}

impl Cells {
    #[inline(always)]
    fn new(p: &Projection, cut: &CutOut) -> Cells {
        let (normal, offset) = cut.plane();
        let along = p.along();
        let along = along / normal.dot(along);
        let start = p.lift(0.5 / LINES as f64, 0.5 / LINES as f64, 0.0);
        let beside = |q: usize| cut.cells_along((DVec3::AXES[q] - normal[q] * along) / LINES as f64);
        Cells { first: cut.cell(start + (offset - normal.dot(start)) * along), line: beside(p.a), row: beside(p.b) }
    }

    /// Which of the lines `from..to` of row `n` meet what is there.
    #[inline(always)]
    fn row(&self, cut: &CutOut, n: usize, from: u32, to: u32) -> u32 {
        // Seen edge-on it has hardly a line: casts saturate, and the cells that are met are clamped.
        let fixed = |v: f64| (v * 65536.0) as i32;
        let cell = [0, 1].map(|i| fixed(self.first[i] + n as f64 * self.row[i] + f64::from(from) * self.line[i]));
        cut.row(from, to, cell, self.line.map(fixed))
    }
}

#[cfg(test)]
mod tests;
