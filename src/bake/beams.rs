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
use super::clip::Polygon;
use super::cutout::CutOut;
use crate::geom::{AXES13, DVec3};

/// Lines a voxel edge.
pub const LINES: usize = 16;
/// Lines along the edge of the squares in which they are counted.
pub const SQUARE: usize = 4;

/// How an axis is projected.
#[derive(Debug, Clone, Copy)]
pub struct Projection {
    /// Dropped coordinate, the one of the bits in a row, and the one of the rows.
    pub drop: usize,
    a: usize,
    b: usize,
    /// Shears of a and b: 0, 1, −1.
    sa: i32,
    sb: i32,
    /// First row in [`Beams`], and their number: 16, or 32 where b is sheared.
    first: usize,
    rows: usize,
    /// Which of [`Plane`]'s coordinates a and b are, sheared.
    pub on: [usize; 2],
}

const fn projections() -> [Projection; 13] {
    let mut out = [Projection { drop: 0, a: 1, b: 2, sa: 0, sb: 0, first: 0, rows: 16, on: [0; 2] }; 13];
    let (mut k, mut first) = (0, 0);
    while k < 13 {
        let w = AXES13[k];
        let drop = if w[0] != 0 {
            0
        } else if w[1] != 0 {
            1
        } else {
            2
        };
        let (mut a, mut b) = ((drop + 1) % 3, (drop + 2) % 3);
        if w[a] == 0 {
            (a, b) = (b, a);
        }
        let (sa, sb) = (w[a] as i32 * w[drop] as i32, w[b] as i32 * w[drop] as i32);
        let rows = if sb == 0 { 16 } else { 32 };
        out[k] = Projection { drop, a, b, sa, sb, first, rows, on: [coordinate(a, sa, drop), coordinate(b, sb, drop)] };
        first += rows;
        k += 1;
    }
    out
}

/// The nine coordinates that planes have: x, y, z; y ∓ x; z ∓ x; z ∓ y.
pub const COORDINATES: usize = 9;

/// Which of them `q` is, sheared by `s` times the coordinate `drop`.
pub const fn coordinate(q: usize, s: i32, drop: usize) -> usize {
    if s == 0 {
        return q;
    }
    // The dropped axis is the lower one always.
    3 + 2 * (drop + q - 1) + if s < 0 { 1 } else { 0 }
}

/// Of [`AXES13`], in order.
pub const PROJECTIONS: [Projection; 13] = projections();
const ROWS: usize = PROJECTIONS[12].first + PROJECTIONS[12].rows;

impl Projection {
    /// Lowest value of the sheared coordinate in the unit voxel.
    const fn base(s: i32) -> f64 {
        if s > 0 { -1.0 } else { 0.0 }
    }

    /// The point on the line at plane coordinates `(x, y)` where the dropped coordinate is `d`.
    pub fn lift(&self, x: f64, y: f64, d: f64) -> DVec3 {
        let mut p = DVec3::ZERO;
        p[self.drop] = d;
        p[self.a] = x + Self::base(self.sa) + f64::from(self.sa) * d;
        p[self.b] = y + Self::base(self.sb) + f64::from(self.sb) * d;
        p
    }

    /// From one unit of the dropped coordinate to the next, along the axis.
    fn along(&self) -> DVec3 {
        let mut step = DVec3::ZERO;
        step[self.drop] = 1.0;
        step[self.a] = f64::from(self.sa);
        step[self.b] = f64::from(self.sb);
        step
    }

    /// Where the plane origin of the cell `at` lies in the plane of its block, `width` cells wide, in cell edges.
    #[inline(always)]
    pub fn place(&self, at: [u8; 3], width: usize) -> (usize, usize) {
        let of = |q: usize, s: i32| {
            let o = i32::from(at[q]) - s * i32::from(at[self.drop]);
            (if s > 0 { o + width as i32 - 1 } else { o }) as usize
        };
        (of(self.a, self.sa), of(self.b, self.sb))
    }

    /// Width of the voxel's plane, in voxel edges: (a, b).
    pub const fn extent(&self) -> (usize, usize) {
        (if self.sa == 0 { 1 } else { 2 }, if self.sb == 0 { 1 } else { 2 })
    }
}

/// Where, along the axis `k`, child `j`'s plane origin lies in its parent's plane, in child edges.
#[inline(always)]
pub fn child_offset(k: usize, j: usize) -> (usize, usize) {
    const OFFSETS: [[[u8; 2]; 8]; 13] = {
        let mut out = [[[0; 2]; 8]; 13];
        let mut n = 0;
        while n < 13 * 8 {
            let (p, j) = (&PROJECTIONS[n / 8], n % 8);
            out[n / 8][j] = [offset(p, p.a, p.sa, j), offset(p, p.b, p.sb, j)];
            n += 1;
        }
        out
    };
    const fn offset(p: &Projection, q: usize, s: i32, j: usize) -> u8 {
        let o = (j >> q & 1) as i32 - s * (j >> p.drop & 1) as i32;
        (if s > 0 { o + 1 } else { o }) as u8
    }
    let [a, b] = OFFSETS[k][j];
    (a.into(), b.into())
}

/// How many squares, of the edge of a voxel or of any cube, the planes of the axes before `k` have.
pub const fn planes_before(k: usize) -> usize {
    const SQUARES: [usize; 14] = {
        let (mut out, mut k) = ([0; 14], 0);
        while k < 13 {
            let (wa, wb) = PROJECTIONS[k].extent();
            out[k + 1] = out[k] + wa * wb;
            k += 1;
        }
        out
    };
    SQUARES[k]
}

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

/// The stretch of the line of axis `k` at plane point (x, y) that lies in the box `lo..hi`, as an interval of the dropped
/// coordinate; its length times |W| is the chord.
#[inline]
pub fn crossing(k: usize, x: f64, y: f64, lo: DVec3, hi: DVec3) -> Option<(f64, f64)> {
    let p = &PROJECTIONS[k];
    let (mut from, mut to) = (lo[p.drop], hi[p.drop]);
    for (v, q, s) in [(x, p.a, p.sa), (y, p.b, p.sb)] {
        let v = v + Projection::base(s);
        // q = v + s d
        match s {
            0 if v < lo[q] || v >= hi[q] => return None,
            0 => {}
            1 => {
                from = from.max(lo[q] - v);
                to = to.min(hi[q] - v);
            }
            _ => {
                from = from.max(v - hi[q]);
                to = to.min(v - lo[q]);
            }
        }
    }
    (from < to).then_some((from, to))
}

/// Oblique area, along axis `k`, of the box with edges `e`: the lines that it blocks when it is full.
#[inline]
pub fn box_area(k: usize, e: DVec3) -> f64 {
    let w = AXES13[k];
    let on = |i: usize| f64::from(w[i].abs());
    e.y * e.z * on(0) + e.x * e.z * on(1) + e.x * e.y * on(2)
}

/// |W| of axis `k`.
#[inline]
pub const fn axis_length(k: usize) -> f64 {
    const LENGTH: [f64; 3] = [1.0, std::f64::consts::SQRT_2, 1.732_050_807_568_877_2];
    LENGTH[(k > 2) as usize + (k > 8) as usize]
}

/// Oblique area of `area` (an area vector) along axis `k`.
#[inline]
pub fn oblique_area(k: usize, area: DVec3) -> f64 {
    let w = AXES13[k];
    (area.x * f64::from(w[0]) + area.y * f64::from(w[1]) + area.z * f64::from(w[2])).abs()
}

#[cfg(test)]
mod tests;
