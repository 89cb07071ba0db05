//! Oblique projections along the 13 axes, and the lattice of parallel lines along each axis that all voxels share.
//!
//! Each axis W is projected obliquely onto a coordinate plane: p → (p_a − s_a p_d, p_b − s_b p_d), where d is the dropped
//! coordinate and the shears s are 0, 1 or −1. Because the shears are whole numbers, a lattice of 16 lines per voxel edge in
//! that plane meets every voxel in the same lines. Areas in these planes are *oblique areas*: the area seen along the axis
//! times |W|, the length of its integer direction.

use super::{AXES13, DVec3};

/// Number of lattice lines per voxel edge.
pub const LINES: usize = 16;
/// Number of lattice lines along the edge of a square in which lines are counted.
pub const SQUARE_LINES: usize = 4;

/// Oblique projection along one axis.
#[derive(Debug, Clone, Copy)]
pub struct Projection {
    /// Dropped coordinate; coordinate that runs along the bits of a row; coordinate that runs along the rows.
    pub drop: usize,
    pub a: usize,
    pub b: usize,
    /// Shears of `a` and `b`: 0, 1 or −1.
    pub sa: i32,
    pub sb: i32,
    /// First row of the axis in a mask of all axes' lines, and the number of rows: 16, or 32 where `b` is sheared.
    pub first: usize,
    pub rows: usize,
    /// Indices of `a` and `b` among the nine [`COORDINATES`].
    pub coordinates: [usize; 2],
}

const fn projections() -> [Projection; 13] {
    let mut out = [Projection { drop: 0, a: 1, b: 2, sa: 0, sb: 0, first: 0, rows: 16, coordinates: [0; 2] }; 13];
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
        let coordinates = [coordinate(a, sa, drop), coordinate(b, sb, drop)];
        out[k] = Projection { drop, a, b, sa, sb, first, rows, coordinates };
        first += rows;
        k += 1;
    }
    out
}

/// Number of different coordinates of all projection planes: x, y, z; y ∓ x; z ∓ x; z ∓ y.
pub const COORDINATES: usize = 9;

/// Index, below [`COORDINATES`], of the coordinate `q` sheared by `s` times the coordinate `drop`.
pub const fn coordinate(q: usize, s: i32, drop: usize) -> usize {
    if s == 0 {
        return q;
    }
    // The dropped axis is always the lower one of the two.
    3 + 2 * (drop + q - 1) + if s < 0 { 1 } else { 0 }
}

/// Projections along the axes of [`AXES13`](super::AXES13), in their order.
pub const PROJECTIONS: [Projection; 13] = projections();
/// Number of rows of all axes together.
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

    /// Step along the axis by one unit of the dropped coordinate.
    pub fn step(&self) -> DVec3 {
        let mut step = DVec3::ZERO;
        step[self.drop] = 1.0;
        step[self.a] = f64::from(self.sa);
        step[self.b] = f64::from(self.sb);
        step
    }

    /// Plane origin of the cell `at` in the plane of its block, which is `width` cells wide: (a, b) in cell edges.
    #[inline(always)]
    pub fn cell_origin(&self, at: [u8; 3], width: usize) -> (usize, usize) {
        let of = |q: usize, s: i32| {
            let o = i32::from(at[q]) - s * i32::from(at[self.drop]);
            (if s > 0 { o + width as i32 - 1 } else { o }) as usize
        };
        (of(self.a, self.sa), of(self.b, self.sb))
    }

    /// Extent of a voxel's projection, in voxel edges: (a, b).
    pub const fn extent(&self) -> (usize, usize) {
        (if self.sa == 0 { 1 } else { 2 }, if self.sb == 0 { 1 } else { 2 })
    }
}

/// Plane origin of the child `j` in its parent's plane along the axis `k`: (a, b) in child edges.
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

/// Number of squares of a cube's edge in the cube's projections along all axes before `k`.
pub const fn squares_before(k: usize) -> usize {
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

/// Segment, in the box `lo..hi`, of the line of axis `k` at the plane point (x, y): an interval of the dropped coordinate,
/// whose length times |W| is the chord. `None` where the line misses the box.
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
