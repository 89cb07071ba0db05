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

use std::sync::LazyLock;

use super::clip::{Polygon, ROOM};
use crate::geom::{AXES13, DVec3};

/// Lines a voxel edge.
pub const LINES: usize = 16;

/// How an axis is projected.
#[derive(Debug, Clone, Copy)]
pub struct Projection {
    /// Dropped coordinate, the one of the bits in a row, and the one of the rows.
    drop: usize,
    a: usize,
    b: usize,
    /// Shears of a and b: 0, 1, −1.
    sa: i32,
    sb: i32,
    /// First row in [`Beams`], and their number: 16, or 32 where b is sheared.
    first: usize,
    rows: usize,
}

const fn projections() -> [Projection; 13] {
    let mut out = [Projection { drop: 0, a: 1, b: 2, sa: 0, sb: 0, first: 0, rows: 16 }; 13];
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
        out[k] = Projection { drop, a, b, sa, sb, first, rows };
        first += rows;
        k += 1;
    }
    out
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

    /// Where child `j`'s plane origin lies in its parent's plane, in child edges.
    pub fn child_offset(&self, j: usize) -> (usize, usize) {
        let bit = |axis: usize| (j >> axis & 1) as i32;
        let at = |q: usize, s: i32| {
            let o = bit(q) - s * bit(self.drop);
            (if s > 0 { o + 1 } else { o }) as usize
        };
        (at(self.a, self.sa), at(self.b, self.sb))
    }

    /// Where the plane origin of the cell `at` lies in the plane of its block, `width` cells wide, in cell edges.
    pub fn place(&self, at: [u8; 3], width: usize) -> (usize, usize) {
        let of = |q: usize, s: i32| {
            let o = i32::from(at[q]) - s * i32::from(at[self.drop]);
            (if s > 0 { o + width as i32 - 1 } else { o }) as usize
        };
        (of(self.a, self.sa), of(self.b, self.sb))
    }

    /// Width of the voxel's plane, in voxel edges: (a, b).
    pub fn extent(&self) -> (usize, usize) {
        (if self.sa == 0 { 1 } else { 2 }, if self.sb == 0 { 1 } else { 2 })
    }
}

/// The lattice lines, of all 13 axes, that meet matter in one voxel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Beams {
    rows: [u32; ROWS],
}

/// What a parent learns when it unites its children's lines.
pub struct Union {
    pub beams: Beams,
    /// Lines of the union an axis.
    pub lines: [u32; 13],
    /// Lines of the children an axis, counted before they are united.
    pub parts: [u32; 13],
    /// Of each child, an axis: lines, and those of them that it blocks first, going along the axis and against it.
    pub children: [[Seen; 13]; 8],
}

/// Lines of a child in its parent.
#[derive(Debug, Clone, Copy, Default)]
pub struct Seen {
    pub lines: u32,
    /// Sum over both ways; at most 2 · lines.
    pub first: u32,
}

impl Default for Beams {
    fn default() -> Self {
        Beams { rows: [0; ROWS] }
    }
}

impl Beams {
    /// Lines of the axis `k`.
    pub fn count(&self, k: usize) -> u32 {
        self.axis(k).iter().map(|r| r.count_ones()).sum()
    }

    fn axis(&self, k: usize) -> &[u32] {
        let p = &PROJECTIONS[k];
        &self.rows[p.first..p.first + p.rows]
    }

    /// Add the lines through `polygon` (voxel edges, within the unit voxel); `passes` may veto a line at the plane point
    /// (x, y) of the axis. Adds the lines found, before they are united, to `parts`.
    pub fn add(
        &mut self,
        polygon: &Polygon,
        parts: &mut [u32; 13],
        mut passes: Option<&mut dyn FnMut(usize, f64, f64) -> bool>,
    ) {
        let mut scaled = [DVec3::ZERO; ROOM];
        for (s, c) in scaled.iter_mut().zip(polygon.corners()) {
            *s = *c * LINES as f64;
        }
        let scaled = &scaled[..polygon.corners().len()];
        let (mut lo, mut hi) = ([0.0; 32], [0.0; 32]);
        let mut plane = [(0.0, 0.0); ROOM];
        for (k, projection) in PROJECTIONS.iter().enumerate() {
            let plane = &mut plane[..scaled.len()];
            let (first, last) = spans(scaled, projection, plane, &mut lo, &mut hi);
            for row in first..last {
                let (from, to) = (line_after(lo[row], 32) as u32, line_after(hi[row], 32) as u32);
                if from >= to {
                    continue;
                }
                let mut bits = (((1u64 << to) - 1) & !((1u64 << from) - 1)) as u32;
                if let Some(passes) = &mut passes {
                    let y = (row as f64 + 0.5) / LINES as f64;
                    for i in from..to {
                        if !passes(k, (f64::from(i) + 0.5) / LINES as f64, y) {
                            bits &= !(1 << i);
                        }
                    }
                }
                parts[k] += bits.count_ones();
                self.rows[projection.first + row] |= bits;
            }
        }
    }

    /// Block the line `bit` in the row `row` of the axis `k`.
    pub fn set(&mut self, k: usize, row: usize, bit: usize) {
        self.rows[PROJECTIONS[k].first + row] |= 1 << bit;
    }

    /// Take over the lines of the axis `k`.
    pub fn copy_axis(&mut self, k: usize, other: &Beams) {
        let p = &PROJECTIONS[k];
        self.rows[p.first..p.first + p.rows].copy_from_slice(other.axis(k));
    }

    /// Block all that `other` blocks, and count its lines into `parts`.
    pub fn merge(&mut self, other: &Beams, parts: &mut [u32; 13]) {
        for (k, parts) in parts.iter_mut().enumerate() {
            *parts += other.count(k);
        }
        for (mine, theirs) in self.rows.iter_mut().zip(&other.rows) {
            *mine |= theirs;
        }
    }

    /// Every line through a full voxel; found once, as every solid voxel asks for them.
    pub fn full() -> &'static Beams {
        static FULL: LazyLock<Beams> = LazyLock::new(Beams::find_full);
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

    /// Unite up to eight children (in child order) whose voxels are of depth `depth`.
    pub fn unite(children: &[Option<&Beams>; 8], depth: usize) -> Union {
        let mut all =
            Union { beams: Beams::default(), lines: [0; 13], parts: [0; 13], children: [[Seen::default(); 13]; 8] };
        let phase = depth & 1;
        for (k, p) in PROJECTIONS.iter().enumerate() {
            let mut thinned = [[0u32; 32]; 8];
            let mut lines = [0u32; 8];
            for (j, child) in children.iter().enumerate() {
                let Some(child) = child else { continue };
                let (oa, ob) = p.child_offset(j);
                for (n, row) in child.axis(k).iter().skip(phase).step_by(2).enumerate() {
                    let bits = even_bits(row >> ((n + phase) & 1)) << (8 * oa);
                    thinned[j][n + 8 * ob] = bits;
                    lines[j] += bits.count_ones();
                }
                all.children[j][k].lines = lines[j];
                all.parts[k] += lines[j];
            }
            let mut united = [0u32; 32];
            for way in [1i32, -1] {
                united = [0; 32];
                for &j in order(k, way) {
                    if lines[j] == 0 {
                        continue;
                    }
                    let mut first = 0;
                    for (u, t) in united.iter_mut().zip(&thinned[j]) {
                        first += (t & !*u).count_ones();
                        *u |= t;
                    }
                    all.children[j][k].first += first;
                }
            }
            all.lines[k] = united.iter().map(|r| r.count_ones()).sum();
            all.beams.rows[p.first..p.first + p.rows].copy_from_slice(&united[..p.rows]);
        }
        all
    }
}

/// Rows whose middles the polygon of `corners` crosses, `first..last`, with the interval of each, all in lines; `plane` is
/// room for its projection. Most facets are smaller than the lattice and cross none.
#[inline]
fn spans(
    corners: &[DVec3],
    p: &Projection,
    plane: &mut [(f64, f64)],
    lo: &mut [f64; 32],
    hi: &mut [f64; 32],
) -> (usize, usize) {
    let (sa, sb) = (f64::from(p.sa), f64::from(p.sb));
    let (ba, bb) = (LINES as f64 * Projection::base(p.sa), LINES as f64 * Projection::base(p.sb));
    let (mut least, mut most) = ((f64::INFINITY, f64::INFINITY), (f64::NEG_INFINITY, f64::NEG_INFINITY));
    for (at, c) in plane.iter_mut().zip(corners) {
        let c = c.to_array();
        let d = c[p.drop];
        let (x, y) = (c[p.a] - sa * d - ba, c[p.b] - sb * d - bb);
        least = (least.0.min(x), least.1.min(y));
        most = (most.0.max(x), most.1.max(y));
        *at = (x, y);
    }
    let (first, last) = (line_after(least.1, p.rows), line_after(most.1, p.rows));
    if first >= last || line_after(least.0, 32) >= line_after(most.0, 32) {
        return (0, 0);
    }
    lo[first..last].fill(f64::INFINITY);
    hi[first..last].fill(f64::NEG_INFINITY);
    let Some(&(mut x0, mut y0)) = plane.last() else { return (0, 0) };
    for &(x1, y1) in plane.iter() {
        let (from, to) = (line_after(y0.min(y1), p.rows), line_after(y0.max(y1), p.rows));
        if from < to {
            let slope = (x1 - x0) / (y1 - y0);
            for row in from..to {
                let x = x0 + (row as f64 + 0.5 - y0) * slope;
                lo[row] = lo[row].min(x);
                hi[row] = hi[row].max(x);
            }
        }
        (x0, y0) = (x1, y1);
    }
    (first, last)
}

/// The first of `count` lines, at i + 1/2, that is beyond `x`; so a line is in an interval when lo < i + 1/2 <= hi.
#[inline]
fn line_after(x: f64, count: usize) -> usize {
    // The cast rounds toward 0; from i32 it is far cheaper than from usize.
    ((x + 0.5) as i32).clamp(0, count as i32) as usize
}

/// Bits 0, 2, 4 … 30 gathered into the low half.
#[inline]
fn even_bits(v: u32) -> u32 {
    let v = v & 0x5555_5555;
    let v = (v | v >> 1) & 0x3333_3333;
    let v = (v | v >> 2) & 0x0f0f_0f0f;
    let v = (v | v >> 4) & 0x00ff_00ff;
    (v | v >> 8) & 0xffff
}

/// Children in the order in which lines along axis `k` (`way` 1) or against it meet them.
fn order(k: usize, way: i32) -> &'static [usize; 8] {
    const ORDERS: [[[usize; 8]; 2]; 13] = orders();
    &ORDERS[k][if way > 0 { 0 } else { 1 }]
}

const fn orders() -> [[[usize; 8]; 2]; 13] {
    let mut out = [[[0usize; 8]; 2]; 13];
    let mut k = 0;
    while k < 13 {
        let (mut n, mut level) = (0, -3i32);
        while level <= 3 {
            let mut j = 0;
            while j < 8 {
                let w = AXES13[k];
                let along =
                    w[0] as i32 * (j & 1) as i32 + w[1] as i32 * (j >> 1 & 1) as i32 + w[2] as i32 * (j >> 2) as i32;
                if along == level {
                    out[k][0][n] = j;
                    out[k][1][7 - n] = j;
                    n += 1;
                }
                j += 1;
            }
            level += 1;
        }
        k += 1;
    }
    out
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
pub fn axis_length(k: usize) -> f64 {
    const LENGTH: [f64; 3] = [1.0, std::f64::consts::SQRT_2, 1.732_050_807_568_877_2];
    LENGTH[usize::from(k > 2) + usize::from(k > 8)]
}

/// Oblique area of `area` (an area vector) along axis `k`.
#[inline]
pub fn oblique_area(k: usize, area: DVec3) -> f64 {
    let w = AXES13[k];
    (area.x * f64::from(w[0]) + area.y * f64::from(w[1]) + area.z * f64::from(w[2])).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Plane coordinates of `q`, in voxel edges from the lowest that the voxel has.
    fn project(p: &Projection, q: DVec3) -> (f64, f64) {
        let along = |i: usize, s: i32| q[i] - f64::from(s) * q[p.drop] - Projection::base(s);
        (along(p.a, p.sa), along(p.b, p.sb))
    }

    #[test]
    fn a_full_voxel_blocks_its_box_area() {
        let full = Beams::full();
        for k in 0..13 {
            let area = f64::from(full.count(k)) / (LINES * LINES) as f64;
            // Lines on the silhouette's edge: an edge of 16 lines is off by half a line at most.
            assert!((area - box_area(k, DVec3::ONE)).abs() < 0.1, "{k} {area}");
        }
    }

    #[test]
    fn eight_full_children_make_a_full_parent() {
        let full = Beams::full();
        let union = Beams::unite(&[Some(full); 8], 3);
        for k in 0..13 {
            let want = box_area(k, DVec3::ONE) * (LINES * LINES) as f64;
            assert!((f64::from(union.lines[k]) / want - 1.0).abs() < 0.06, "{k} {}", union.lines[k]);
            // Every line is blocked first by one child, each way.
            let first: u32 = (0..8).map(|j| union.children[j][k].first).sum();
            assert_eq!(first, 2 * union.lines[k]);
        }
    }

    #[test]
    fn lines_of_a_facet_measure_its_area() {
        let c = [
            DVec3::new(0.1, 0.2, 0.3),
            DVec3::new(0.9, 0.4, 0.2),
            DVec3::new(0.5, 0.8, 0.9),
            DVec3::new(0.2, 0.7, 0.8),
        ];
        let p = Polygon::new(&c[..3], 0);
        let (mut beams, mut parts) = (Beams::default(), [0; 13]);
        beams.add(&p, &mut parts, None);
        for (k, parts) in parts.into_iter().enumerate() {
            let area = f64::from(beams.count(k)) / (LINES * LINES) as f64;
            assert_eq!(beams.count(k), parts);
            // The boundary is some 3 edges of at most 16·sqrt(2) lines: off by a few lines of 256.
            assert!((area - oblique_area(k, p.area_vector())).abs() < 0.03, "{k} {area}");
        }
    }

    #[test]
    fn neighbours_share_their_lines() {
        // A wall across two voxels, seen obliquely: each line is in one of both.
        for p in &PROJECTIONS {
            for j in 0..8 {
                let (oa, ob) = p.child_offset(j);
                let (wa, wb) = p.extent();
                assert!(oa <= wa && ob <= wb);
                let centre = DVec3::new((j & 1) as f64, (j >> 1 & 1) as f64, (j >> 2) as f64) + 0.4;
                let (x, y) = project(p, centre);
                let local = project(p, DVec3::splat(0.4));
                // The parent's plane starts at −2 child edges where sheared upward, the child's at −1.
                let base = |s: i32| if s > 0 { 1.0 } else { 0.0 };
                assert!((x + base(p.sa) - oa as f64 - local.0).abs() < 1e-12);
                assert!((y + base(p.sb) - ob as f64 - local.1).abs() < 1e-12);
            }
        }
    }
}
