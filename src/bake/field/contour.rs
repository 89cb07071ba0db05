//! The surface of a field in a block of cells: a vertex in every cell that it passes, placed where the tangent planes at the
//! cell's edges meet, and a facet around every edge that it crosses.
//!
//! Based on: T. Ju, F. Losasso, S. Schaefer, J. Warren, *Dual Contouring of Hermite Data*, SIGGRAPH 2002 (sharp edges and
//! corners are kept); S. Gibson, *Constrained Elastic Surface Nets*, MICCAI 1998.
//!
//! All that is asked of the field depends on the cell alone, not on the block, so blocks that touch agree on every bit.

use super::super::clip::Polygon;
use crate::geom::{DMat3, DVec3};

/// A field in a grid of cells.
pub trait Cells {
    /// The value at `at` of the cell, `at` within [0, 1]^3.
    fn value(&self, cell: [i64; 3], at: DVec3) -> f64;
    /// The direction in which the value grows, along the grid's axes; of any length.
    fn gradient(&self, cell: [i64; 3], at: DVec3) -> DVec3;
    /// Whether the surface may pass the closed box from the corner `lo` to the corner `hi`.
    fn may_cross(&self, lo: [i64; 3], hi: [i64; 3]) -> bool;
}

/// Boxes of at most so many cells an edge are looked at corner by corner.
const LEAF: i64 = 2;
/// Steps of a search along an edge, and how near to the crossing it ends, in edges.
const STEPS: usize = 12;
const NEAR: f64 = 1e-5;
/// Weight with which a vertex is held to the mean of its cell's crossings, and passes that take this back.
const HOLD: f64 = 0.05;
const PASSES: usize = 4;
/// How far from one plane a facet of four corners may be, in cells. Its area vector is that of any surface within its edges.
const PLANAR: f64 = 0.01;

/// The facets around all edges that touch the cells `lo .. lo + size`, in cells; `size` cells beyond 0.
pub fn contour(cells: &dyn Cells, lo: [i64; 3], size: i64, each: &mut dyn FnMut(&Polygon)) {
    // A margin of one cell: facets reach from cell to cell.
    let base = lo.map(|v| v - 1);
    let mut block = Block::new(cells, base, size + 2);
    block.descend([0; 3], [size + 2; 3]);
    block.facets(each);
}

struct Block<'a> {
    cells: &'a dyn Cells,
    base: [i64; 3],
    /// Cells an edge.
    size: i64,
    /// At corners, x fastest; NaN until it is asked for.
    values: Vec<f64>,
    /// Cells with a vertex: their place in `vertices`, from 1 on.
    places: Vec<u32>,
    /// In cells from the block's base.
    vertices: Vec<DVec3>,
    /// Of the edges from each corner along x, y, z: the place in `crossings`, from 1 on.
    edges: Vec<[u32; 3]>,
    crossings: Vec<Crossing>,
}

#[derive(Clone, Copy)]
struct Crossing {
    /// Corner from which the edge starts, and its axis.
    corner: [i64; 3],
    axis: usize,
    /// Along the edge, [0, 1].
    t: f64,
    /// Unit, out of the matter.
    normal: DVec3,
    /// Whether the edge's start is within.
    out: bool,
}

impl<'a> Block<'a> {
    fn new(cells: &'a dyn Cells, base: [i64; 3], size: i64) -> Block<'a> {
        let corners = ((size + 1) * (size + 1) * (size + 1)) as usize;
        Block {
            cells,
            base,
            size,
            values: vec![f64::NAN; corners],
            places: vec![0; corners],
            vertices: Vec::new(),
            edges: vec![[0; 3]; corners],
            crossings: Vec::new(),
        }
    }

    fn index(&self, p: [i64; 3]) -> usize {
        (p[0] + (self.size + 1) * (p[1] + (self.size + 1) * p[2])) as usize
    }

    fn absolute(&self, p: [i64; 3]) -> [i64; 3] {
        [self.base[0] + p[0], self.base[1] + p[1], self.base[2] + p[2]]
    }

    fn descend(&mut self, lo: [i64; 3], hi: [i64; 3]) {
        if !self.cells.may_cross(self.absolute(lo), self.absolute(hi)) {
            return;
        }
        if (0..3).all(|a| hi[a] - lo[a] <= LEAF) {
            for z in lo[2]..hi[2] {
                for y in lo[1]..hi[1] {
                    for x in lo[0]..hi[0] {
                        self.cell([x, y, z]);
                    }
                }
            }
            return;
        }
        let middle: [i64; 3] = std::array::from_fn(|a| (lo[a] + hi[a]) / 2);
        for j in 0..8 {
            let upper = |a: usize| j >> a & 1 == 1;
            let from = std::array::from_fn(|a| if upper(a) { middle[a] } else { lo[a] });
            let to = std::array::from_fn(|a| if upper(a) { hi[a] } else { middle[a] });
            if (0..3).all(|a| from[a] < to[a]) {
                self.descend(from, to);
            }
        }
    }

    /// The value at a corner; above 0 where it is no number.
    fn corner(&mut self, p: [i64; 3]) -> f64 {
        let at = self.index(p);
        if self.values[at].is_nan() {
            let value = self.cells.value(self.absolute(p), DVec3::ZERO);
            self.values[at] = if value.is_nan() { f64::INFINITY } else { value };
        }
        self.values[at]
    }

    fn cell(&mut self, p: [i64; 3]) {
        let mut within = 0u32;
        for j in 0..8i64 {
            within |= u32::from(self.corner([p[0] + (j & 1), p[1] + (j >> 1 & 1), p[2] + (j >> 2)]) < 0.0) << j;
        }
        if within == 0 || within == 255 {
            return;
        }
        let (mut points, mut normals) = ([DVec3::ZERO; 12], [DVec3::ZERO; 12]);
        let mut count = 0;
        for axis in 0..3 {
            for j in (0..8usize).filter(|j| j >> axis & 1 == 0) {
                if (within >> j ^ within >> (j | 1 << axis)) & 1 == 0 {
                    continue;
                }
                let offset = [(j & 1) as i64, (j >> 1 & 1) as i64, (j >> 2) as i64];
                let crossing = self.crossing([p[0] + offset[0], p[1] + offset[1], p[2] + offset[2]], axis);
                points[count] = DVec3::from(offset.map(|v| v as f64));
                points[count][axis] = crossing.t;
                normals[count] = crossing.normal;
                count += 1;
            }
        }
        self.vertices.push(meeting(&points[..count], &normals[..count]) + DVec3::from(p.map(|v| v as f64)));
        let at = self.index(p);
        self.places[at] = self.vertices.len() as u32;
    }

    /// Where the surface crosses the edge from the corner `p` along `axis`, whose ends differ in sign.
    fn crossing(&mut self, p: [i64; 3], axis: usize) -> Crossing {
        let at = self.index(p);
        if self.edges[at][axis] > 0 {
            return self.crossings[self.edges[at][axis] as usize - 1];
        }
        let mut end = p;
        end[axis] += 1;
        let (v0, v1) = (self.corner(p), self.corner(end));
        let cell = self.absolute(p);
        let along = |t: f64| {
            let mut at = DVec3::ZERO;
            at[axis] = t;
            at
        };
        let t = root(|t| self.cells.value(cell, along(t)), v0, v1);
        let mut up = along(1.0);
        if v1 < v0 {
            up = -up;
        }
        let normal = self.cells.gradient(cell, along(t)).try_normalize().unwrap_or(up);
        let crossing = Crossing { corner: p, axis, t, normal, out: v0 < 0.0 };
        self.crossings.push(crossing);
        self.edges[at][axis] = self.crossings.len() as u32;
        crossing
    }

    /// A facet around each crossed edge whose four cells are in the block.
    fn facets(&self, each: &mut dyn FnMut(&Polygon)) {
        for crossing in &self.crossings {
            let (a, b) = ((crossing.axis + 1) % 3, (crossing.axis + 2) % 3);
            let mut corners = [DVec3::ZERO; 4];
            let mut complete = true;
            // Counter-clockwise about the axis.
            for (corner, (da, db)) in corners.iter_mut().zip([(1, 1), (0, 1), (0, 0), (1, 0)]) {
                let mut cell = crossing.corner;
                cell[a] += da - 1;
                cell[b] += db - 1;
                if cell.iter().any(|&v| v < 0 || v >= self.size) {
                    complete = false;
                    break;
                }
                match self.places[self.index(cell)] {
                    0 => complete = false,
                    place => *corner = self.vertices[place as usize - 1],
                }
            }
            if !complete {
                continue;
            }
            if !crossing.out {
                corners.swap(1, 3);
            }
            quad(corners, crossing, &mut |polygon| {
                let moved: [DVec3; 4] = std::array::from_fn(|i| {
                    polygon.get(i).map_or(DVec3::ZERO, |p| *p + DVec3::from(self.base.map(|v| v as f64)))
                });
                each(&Polygon::new(&moved[..polygon.len()], 0));
            });
        }
    }
}

/// Where a function with the values `v0`, `v1` at 0 and 1, of which one is negative, is 0: false position, in Illinois's way.
fn root(value: impl Fn(f64) -> f64, v0: f64, v1: f64) -> f64 {
    let (mut t0, mut t1, mut v0, mut v1) = (0.0, 1.0, v0, v1);
    let mut last = 0;
    let mut t = 0.5;
    for _ in 0..STEPS {
        let share = v0 / (v0 - v1);
        let next = if share.is_finite() { t0 + share * (t1 - t0) } else { 0.5 * (t0 + t1) };
        if (next - t).abs() < NEAR {
            return next;
        }
        t = next;
        let v = value(t);
        if v == 0.0 || v.is_nan() {
            break;
        }
        if (v < 0.0) == (v0 < 0.0) {
            (t0, v0) = (t, v);
            if last == 1 {
                v1 *= 0.5;
            }
            last = 1;
        } else {
            (t1, v1) = (t, v);
            if last == 2 {
                v0 *= 0.5;
            }
            last = 2;
        }
    }
    t
}

/// The point of the unit cell that is nearest to all planes, and near the mean of their points where that leaves a choice.
fn meeting(points: &[DVec3], normals: &[DVec3]) -> DVec3 {
    let mean = points.iter().sum::<DVec3>() / points.len() as f64;
    let mut m = DMat3::from_diagonal(DVec3::splat(HOLD * points.len() as f64));
    for n in normals {
        m += DMat3::from_cols(*n * n.x, *n * n.y, *n * n.z);
    }
    let inverse = m.inverse();
    let mut p = mean;
    for _ in 0..PASSES {
        let pull: DVec3 = points.iter().zip(normals).map(|(q, n)| *n * n.dot(*q - p)).sum();
        p += inverse * pull;
    }
    if p.is_finite() { p.clamp(DVec3::ZERO, DVec3::ONE) } else { mean }
}

/// The facet `corners`, whole where it is plane and convex, else as two triangles, parted so that they pass nearest to where
/// the surface crosses the edge.
fn quad(corners: [DVec3; 4], crossing: &Crossing, each: &mut dyn FnMut(&[DVec3])) {
    let [c0, c1, c2, c3] = corners;
    let normal = (c2 - c0).cross(c3 - c1);
    let (axis, a, b) = (crossing.axis, (crossing.axis + 1) % 3, (crossing.axis + 2) % 3);
    // Twice the signed area of a triangle as the edge sees it.
    let seen = |p: DVec3, q: DVec3, r: DVec3| (q[a] - p[a]) * (r[b] - p[b]) - (q[b] - p[b]) * (r[a] - p[a]);
    let turn = if crossing.out { 1.0 } else { -1.0 };
    let turns = [seen(c3, c0, c1), seen(c0, c1, c2), seen(c1, c2, c3), seen(c2, c3, c0)].map(|v| v * turn);
    let convex = turns.iter().all(|&v| v >= 0.0);
    let off = (c1 - c0).dot(normal).abs().max((c2 - c0).dot(normal).abs()).max((c3 - c0).dot(normal).abs());
    if convex && off <= PLANAR * normal.length() {
        return each(&corners);
    }
    // Cutting from 0 to 2 keeps the turns at 1 and 3, and the other way round.
    let (keeps02, keeps13) = (turns[1] >= 0.0 && turns[3] >= 0.0, turns[0] >= 0.0 && turns[2] >= 0.0);
    let mut at = DVec3::from(crossing.corner.map(|v| v as f64));
    at[axis] += crossing.t;
    let miss = |p: DVec3, q: DVec3, r: DVec3, s: DVec3| {
        // Along the edge, at the triangle of p-q-r and p-r-s that it passes.
        let third = if (seen(p, r, at) > 0.0) == (seen(p, r, s) > 0.0) { s } else { q };
        let n = (r - p).cross(third - p);
        (n.dot(at - p) / n[axis]).abs()
    };
    let by02 = match (keeps02, keeps13) {
        (true, false) => true,
        (false, true) => false,
        _ => miss(c0, c1, c2, c3) <= miss(c1, c2, c3, c0),
    };
    if by02 {
        each(&[c0, c1, c2]);
        each(&[c0, c2, c3]);
    } else {
        each(&[c1, c2, c3]);
        each(&[c1, c3, c0]);
    }
}
