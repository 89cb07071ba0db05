//! Oblique projections along the 13 axes, and the lattice of lines along each that all voxels share.
//!
//! An axis is projected obliquely on a coordinate plane: p → (p_a − s_a p_d, p_b − s_b p_d) with s = 0 or ±1. So a lattice of
//! 16 lines a voxel edge in that plane falls into the same lines for every voxel. Plane areas are "oblique": the area seen
//! along the axis W (integers) times |W|.

use super::{AXES13, DVec3};

/// Lines a voxel edge.
pub const LINES: usize = 16;
/// Lines along the edge of the squares in which they are counted.
pub const SQUARE: usize = 4;

/// How an axis is projected.
#[derive(Debug, Clone, Copy)]
pub struct Projection {
    /// Dropped coordinate, the one of the bits in a row, and the one of the rows.
    pub drop: usize,
    pub a: usize,
    pub b: usize,
    /// Shears of a and b: 0, 1, −1.
    pub sa: i32,
    pub sb: i32,
    /// First row in a mask of all axes' lines, and their number: 16, or 32 where b is sheared.
    pub first: usize,
    pub rows: usize,
    /// Which of the nine sheared coordinates a and b are.
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
/// Rows of all axes together.
pub const ROWS: usize = PROJECTIONS[12].first + PROJECTIONS[12].rows;

impl Projection {
    /// Lowest value of the sheared coordinate in the unit voxel.
    pub const fn base(s: i32) -> f64 {
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
    pub fn along(&self) -> DVec3 {
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
