//! The surface of a field in a block of cells: in every cell that it passes, the loop of points where it crosses the cell's
//! edges; and where it has a crease or a tip between them, a vertex, placed where the tangent planes at these points meet.
//!
//! Based on: L. Kobbelt, M. Botsch, U. Schwanecke, H.-P. Seidel, *Feature Sensitive Surface Extraction from Volume Data*,
//! SIGGRAPH 2001 (a fan around a vertex in cells with features); T. Ju, F. Losasso, S. Schaefer, J. Warren, *Dual Contouring
//! of Hermite Data*, SIGGRAPH 2002 (where the vertex is, and creases that go from vertex to vertex).
//!
//! All that is asked of the field depends on the cell alone, not on the block, so blocks that touch agree on every bit; and no
//! facet leaves its cell, so none is cut when cells are voxels.

use crate::geom::polygon::Polygon;
use crate::geom::{DMat3, DVec3};
use crate::source::loops::{EDGES, LoopTable, facets, plane_of};

/// A field in a grid of cells.
pub trait Cells {
    /// The value at `at` of the cell, `at` within [0, 1]^3.
    fn value(&self, cell: [i64; 3], at: DVec3) -> f64;
    /// The direction in which the value grows, along the grid's axes; of any length.
    fn gradient(&self, cell: [i64; 3], at: DVec3) -> DVec3;
    /// Whether the surface may pass the closed box from the corner `lo` to the corner `hi`.
    fn may_cross(&self, lo: [i64; 3], hi: [i64; 3]) -> bool;
}

/// Number of cells per edge of boxes that are not subdivided any further.
const LEAF_CELLS: i64 = 2;
/// Largest number of steps by which the crossing of an edge is found.
const MAX_ROOT_STEPS: usize = 12;
/// Error of a crossing, in edges, at which the search ends.
const ROOT_TOLERANCE: f64 = 1e-5;
/// Weight with which a vertex is pulled to the mean of its cell's crossings, which makes its equations regular.
const REGULARIZATION: f64 = 0.05;
/// Number of iterations that remove the error that the regularization makes.
const REFINEMENTS: usize = 4;
/// Cosine of the angle between two normals of a cell from which on there is a crease or a tip. For smaller angles the surface may be
/// that of a ball two cells wide.
const CREASE_COSINE: f64 = 0.7;
/// Smallest distance of a vertex from the plane of its cell's crossings, in cells; nearer ones are left out.
const MIN_VERTEX_OFFSET: f64 = 0.005;

/// The facets in the cells `lo .. lo + size`; `size` cells beyond 0.
pub fn contour(cells: &dyn Cells, lo: [i64; 3], size: i64, each: &mut dyn FnMut(&Polygon)) {
    // A margin of one cell: creases go on from cell to cell.
    let mut block = CellBlock::new(cells, lo.map(|v| v - 1), size + 2);
    block.descend([1; 3], [size + 1; 3]);
    block.look_beyond();
    block.facets(each);
}

struct CellBlock<'a> {
    cells: &'a dyn Cells,
    base: [i64; 3],
    /// Cells an edge.
    size: i64,
    /// At corners, x fastest; NaN until it is asked for.
    values: Vec<f64>,
    /// Place in `surface_cells` of each cell that the surface passes, counted from 1.
    places: Vec<u32>,
    surface_cells: Vec<SurfaceCell>,
    /// Place in `crossings` of the edges from each corner along x, y and z, counted from 1.
    edges: Vec<[u32; 3]>,
    crossings: Vec<Crossing>,
}

/// A cell that the surface passes.
struct SurfaceCell {
    cell: [i64; 3],
    /// Corners that are within.
    within: u8,
    /// Position of a crease or a tip, in cells; then there is one loop.
    vertex: Option<DVec3>,
}

struct Crossing {
    /// Along the edge, [0, 1].
    t: f64,
    /// Unit, out of the matter.
    normal: DVec3,
}

impl<'a> CellBlock<'a> {
    fn new(cells: &'a dyn Cells, base: [i64; 3], size: i64) -> CellBlock<'a> {
        let corners = ((size + 1) * (size + 1) * (size + 1)) as usize;
        CellBlock {
            cells,
            base,
            size,
            values: vec![f64::NAN; corners],
            places: vec![0; corners],
            surface_cells: Vec::new(),
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
        if (0..3).all(|a| hi[a] - lo[a] <= LEAF_CELLS) {
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
        let mut within = 0;
        for j in 0..8i64 {
            within |= u8::from(self.corner([p[0] + (j & 1), p[1] + (j >> 1 & 1), p[2] + (j >> 2)]) < 0.0) << j;
        }
        if within == 0 || within == 255 {
            return;
        }
        for (edge, [a, b]) in EDGES.into_iter().enumerate() {
            if (within >> a ^ within >> b) & 1 != 0 {
                let (from, axis) = start(p, edge);
                self.crossing(from, axis);
            }
        }
        let mut loops = LoopTable::get().of(within);
        let vertex = loops.next().filter(|_| loops.next().is_none()).and_then(|l| self.vertex(p, l));
        self.surface_cells.push(SurfaceCell { cell: p, within, vertex });
        let at = self.index(p);
        self.places[at] = self.surface_cells.len() as u32;
    }

    /// The vertex of the cell `p`, whose loop is `edges`, if it needs one.
    fn vertex(&self, p: [i64; 3], edges: &[u8]) -> Option<DVec3> {
        let (mut points, mut normals) = ([DVec3::ZERO; 12], [DVec3::ZERO; 12]);
        let (points, normals) = (points.get_mut(..edges.len())?, normals.get_mut(..edges.len())?);
        for ((point, normal), &edge) in points.iter_mut().zip(&mut *normals).zip(edges) {
            let [a, _] = EDGES[usize::from(edge)];
            let (from, axis) = start(p, edge.into());
            let crossing = self.crossed(from, axis)?;
            *point = DVec3::new(f64::from(a & 1), f64::from(a >> 1 & 1), f64::from(a >> 2));
            point[axis] = crossing.t;
            *normal = crossing.normal;
        }
        if normals.iter().enumerate().all(|(i, n)| normals[..i].iter().all(|m| m.dot(*n) > CREASE_COSINE)) {
            return None;
        }
        let vertex = meeting(points, normals);
        let smooth =
            plane_of(points).is_some_and(|(middle, normal)| normal.dot(vertex - middle).abs() < MIN_VERTEX_OFFSET);
        (!smooth).then(|| DVec3::from(self.absolute(p).map(|v| v as f64)) + vertex)
    }

    /// Point at which the surface was found to cross the edge from the corner `p` along `axis`.
    fn crossed(&self, p: [i64; 3], axis: usize) -> Option<&Crossing> {
        self.crossings.get((self.edges[self.index(p)][axis] as usize).wrapping_sub(1))
    }

    /// Point at which the surface crosses the edge from the corner `p` along `axis`, whose ends differ in sign.
    fn crossing(&mut self, p: [i64; 3], axis: usize) {
        let at = self.index(p);
        if self.edges[at][axis] > 0 {
            return;
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
        // Within the cell: what is on its upper face belongs to the one above.
        let t = root(|t| self.cells.value(cell, along(t)), v0, v1).min(1.0 - ROOT_TOLERANCE);
        let mut up = along(1.0);
        if v1 < v0 {
            up = -up;
        }
        let normal = self.cells.gradient(cell, along(t)).try_normalize().unwrap_or(up);
        self.crossings.push(Crossing { t, normal });
        self.edges[at][axis] = self.crossings.len() as u32;
    }

    /// Find the cells of the margin into which a crease may go on.
    fn look_beyond(&mut self) {
        let mut beside = Vec::new();
        for cell in self.surface_cells.iter().filter(|cell| cell.vertex.is_some()) {
            for edges in LoopTable::get().of(cell.within) {
                for (i, &edge) in edges.iter().enumerate() {
                    if let Some((.., cell)) = beside_of(cell.cell, edge, edges[(i + 1) % edges.len()])
                        && self.is_margin(cell)
                    {
                        beside.push(cell);
                    }
                }
            }
        }
        for cell in beside {
            if self.places[self.index(cell)] == 0 {
                self.cell(cell);
            }
        }
    }

    fn is_margin(&self, cell: [i64; 3]) -> bool {
        cell.iter().any(|&v| v < 1 || v >= self.size - 1)
    }

    /// The facets of all cells but those of the margin.
    fn facets(&self, each: &mut dyn FnMut(&Polygon)) {
        let mut points = [DVec3::ZERO; 12];
        for cell in &self.surface_cells {
            if self.is_margin(cell.cell) {
                continue;
            }
            for edges in LoopTable::get().of(cell.within) {
                for (point, &edge) in points.iter_mut().zip(edges) {
                    let (from, axis) = start(cell.cell, edge.into());
                    *point = DVec3::from(self.absolute(from).map(|v| v as f64));
                    point[axis] += self.crossed(from, axis).map_or(0.5, |c| c.t);
                }
                let points = &points[..edges.len().min(points.len())];
                let Some(vertex) = cell.vertex else {
                    facets(points, each);
                    continue;
                };
                for (i, &edge) in edges.iter().enumerate() {
                    let j = (i + 1) % edges.len();
                    match self.beyond(cell.cell, edge, edges[j]) {
                        Some((axis, upper, other)) => {
                            // From the lower end always, so that both cells find one point.
                            let (low, high) = if upper { (vertex, other) } else { (other, vertex) };
                            let (from, to) = (points[i][axis] - low[axis], high[axis] - points[i][axis]);
                            let t = if from + to > 0.0 { from / (from + to) } else { 0.5 };
                            let mut between = low + t * (high - low);
                            between[axis] = points[i][axis];
                            each(&Polygon::new(&[vertex, points[i], between], 0));
                            each(&Polygon::new(&[vertex, between, points[j]], 0));
                        }
                        None => each(&Polygon::new(&[vertex, points[i], points[j]], 0)),
                    }
                }
            }
        }
    }

    /// The face with both edges of the cell `p`: its axis, whether it is the upper one, and the vertex beyond it if the cell there
    /// has one.
    fn beyond(&self, p: [i64; 3], edge: u8, next: u8) -> Option<(usize, bool, DVec3)> {
        let (axis, upper, cell) = beside_of(p, edge, next)?;
        let place = self.places[self.index(cell)] as usize;
        Some((axis, upper, self.surface_cells.get(place.wrapping_sub(1))?.vertex?))
    }
}

/// The face with both edges of the cell `p`: its axis, whether it is the upper one, and the cell beyond it.
fn beside_of(p: [i64; 3], edge: u8, next: u8) -> Option<(usize, bool, [i64; 3])> {
    let ([a, b], [c, d]) = (EDGES[usize::from(edge)], EDGES[usize::from(next)]);
    let (all, any) = (a & b & c & d, a | b | c | d);
    let axis = (0..3).find(|&axis| all >> axis & 1 == 1 || any >> axis & 1 == 0)?;
    let upper = all >> axis & 1 == 1;
    let mut cell = p;
    cell[axis] += if upper { 1 } else { -1 };
    Some((axis, upper, cell))
}

/// The corner from which an edge of the cell `p` starts, and its axis.
fn start(p: [i64; 3], edge: usize) -> ([i64; 3], usize) {
    let [a, b] = EDGES[edge];
    (
        [p[0] + i64::from(a & 1), p[1] + i64::from(a >> 1 & 1), p[2] + i64::from(a >> 2)],
        (a ^ b).trailing_zeros() as usize,
    )
}

/// Root of a function with the values `v0`, `v1` at 0 and 1, of which one is negative: false position, in Illinois's way.
fn root(value: impl Fn(f64) -> f64, v0: f64, v1: f64) -> f64 {
    let (mut t0, mut t1, mut v0, mut v1) = (0.0, 1.0, v0, v1);
    let mut last = 0;
    let mut t = 0.5;
    for _ in 0..MAX_ROOT_STEPS {
        let share = v0 / (v0 - v1);
        let next = if share.is_finite() { t0 + share * (t1 - t0) } else { 0.5 * (t0 + t1) };
        if (next - t).abs() < ROOT_TOLERANCE {
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
    let mut m = DMat3::from_diagonal(DVec3::splat(REGULARIZATION * points.len() as f64));
    for n in normals {
        m += DMat3::from_cols(*n * n.x, *n * n.y, *n * n.z);
    }
    let inverse = m.inverse();
    let mut p = mean;
    for _ in 0..REFINEMENTS {
        let pull: DVec3 = points.iter().zip(normals).map(|(q, n)| *n * n.dot(*q - p)).sum();
        p += inverse * pull;
    }
    if p.is_finite() { p.clamp(DVec3::splat(ROOT_TOLERANCE), DVec3::splat(1.0 - ROOT_TOLERANCE)) } else { mean }
}
