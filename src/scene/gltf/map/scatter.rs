//! Points on triangles, evenly and irregularly spread, and how far they are from the border.
//!
//! Based on: R. Cook, *Stochastic Sampling in Computer Graphics*, TOG 1986 (Poisson disks by dart throwing); D. Cline et al.,
//! *Dart Throwing on Surfaces*, CGF 2009.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use super::surface::Face;
use crate::geom::{Aabb, DVec3};
use crate::random::SplitMix64;

/// A point on a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    pub at: DVec3,
    /// Unit normal of the front of its triangle.
    pub normal: DVec3,
    /// The caller's number of the triangle's surface.
    pub surface: usize,
    /// Texture coordinates.
    pub uv: [f64; 2],
}

/// Triangles to throw darts at.
#[derive(Default)]
pub struct Target {
    triangles: Vec<Triangle>,
    /// Area summed up to and with each.
    areas: Vec<f64>,
}

#[derive(Clone, Copy)]
struct Triangle {
    corners: [DVec3; 3],
    /// Unit normal of the front.
    normal: DVec3,
    surface: usize,
    uvs: [[f64; 2]; 3],
}

impl Triangle {
    /// The point a + s (b − a) + t (c − a).
    fn point(&self, s: f64, t: f64) -> Point {
        let ([a, b, c], [p, q, r]) = (self.corners, self.uvs);
        let uv = std::array::from_fn(|k| p[k] + s * (q[k] - p[k]) + t * (r[k] - p[k]));
        Point { at: a + s * (b - a) + t * (c - a), normal: self.normal, surface: self.surface, uv }
    }
}

impl Target {
    /// Add a triangle of the caller's surface number `surface`.
    pub fn push(&mut self, face: &Face, surface: usize) {
        let area = 0.5 * face.cross.length();
        if area > 0.0 && area.is_finite() {
            let normal = face.cross / (2.0 * area);
            self.triangles.push(Triangle { corners: face.corners, normal, surface, uvs: face.chart });
            self.areas.push(self.area() + area);
        }
    }

    /// Box around all triangles.
    pub fn bounds(&self) -> Aabb {
        Aabb::around(self.triangles.iter().flat_map(|t| t.corners))
    }

    /// Whether no texture coordinate leaves the unit square, but for rounding.
    pub fn is_in_unit_square(&self) -> bool {
        let mut all = self.triangles.iter().flat_map(|t| t.uvs.as_flattened());
        all.all(|c| (-1e-6..=1.0 + 1e-6).contains(c))
    }

    /// Square metres.
    pub fn area(&self) -> f64 {
        self.areas.last().copied().unwrap_or(0.0)
    }

    /// A point, by area; `None` where there is no triangle.
    fn dart(&self, random: &mut SplitMix64) -> Option<Point> {
        let aim = random.unit() * self.area();
        let i = self.areas.partition_point(|&a| a <= aim).min(self.areas.len().checked_sub(1)?);
        let triangle = self.triangles.get(i)?;
        let (mut s, mut t) = (random.unit(), random.unit());
        if s + t > 1.0 {
            (s, t) = (1.0 - s, 1.0 - t);
        }
        Some(triangle.point(s, t))
    }

    /// The edges that only one triangle has, by the positions of their ends.
    pub fn border(&self) -> Vec<[DVec3; 2]> {
        let key = |p: DVec3| (p + 0.0).to_array().map(|v| (v as f32).to_bits());
        let ends = |a: DVec3, b: DVec3| {
            let (ka, kb) = (key(a), key(b));
            if ka <= kb { (ka, kb) } else { (kb, ka) }
        };
        let edges = || {
            self.triangles.iter().flat_map(|t| {
                let [a, b, c] = t.corners;
                [[a, b], [b, c], [c, a]]
            })
        };
        let mut counts: HashMap<_, u32> = HashMap::new();
        edges().for_each(|[a, b]| *counts.entry(ends(a, b)).or_default() += 1);
        edges().filter(|&[a, b]| counts.get(&ends(a, b)) == Some(&1)).collect()
    }
}

/// Discs that keep a distance from each other, in a grid of cells as wide as the largest.
pub struct Discs {
    cell: f64,
    cells: HashMap<[i64; 3], Vec<(DVec3, f64)>, BuildHasherDefault<CellHasher>>,
    /// The largest radius so far.
    largest: f64,
}

/// Hashes cells by a multiplication for each number: a million copies look up as many millions of cells as there are darts, and
/// nobody chooses cells so that they meet. (Knuth, *The Art of Computer Programming* 3, 6.4.)
#[derive(Default)]
struct CellHasher(u64);

impl Hasher for CellHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&byte| self.write_u64(byte.into()));
    }

    fn write_u64(&mut self, number: u64) {
        self.0 = (self.0.rotate_left(26) ^ number).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    }

    fn write_i64(&mut self, number: i64) {
        self.write_u64(number as u64);
    }

    fn write_usize(&mut self, number: usize) {
        self.write_u64(number as u64);
    }
}

/// Darts thrown per disc that is wanted before the ground counts as full. At the least distance that `copies` asks for, three
/// are enough on average.
const DARTS: usize = 40;

impl Discs {
    /// `largest`: the largest radius that will come, metres.
    pub fn new(largest: f64) -> Discs {
        let cell = if largest > 0.0 && largest.is_finite() { 2.0 * largest } else { 1.0 };
        Discs { cell, cells: HashMap::default(), largest: f64::NEG_INFINITY }
    }

    fn cell_of(&self, p: DVec3) -> [i64; 3] {
        (p / self.cell).floor().to_array().map(|v| v as i64)
    }

    /// `radius` may be negative: then others come nearer than their own.
    pub fn insert(&mut self, p: DVec3, radius: f64) {
        let cell = self.cell_of(p);
        self.largest = self.largest.max(radius);
        self.cells.entry(cell).or_default().push((p, radius));
    }

    /// Whether a disc there would keep the sum of the radii from all others.
    fn is_free(&self, p: DVec3, radius: f64) -> bool {
        // No farther than this a disc can be in the way: at most two cells along an axis where discs are small.
        let reach = (radius + self.largest).max(0.0);
        let (low, own, high) = (self.cell_of(p - reach), self.cell_of(p), self.cell_of(p + reach));
        let cells = |k: usize| low[k].max(own[k].saturating_sub(1))..=high[k].min(own[k].saturating_add(1));
        let free = |cell: [i64; 3]| {
            let discs = self.cells.get(&cell).map_or(&[][..], Vec::as_slice);
            discs.iter().all(|&(q, r)| p.distance(q) >= radius + r)
        };
        cells(0).all(|x| cells(1).all(|y| cells(2).all(|z| free([x, y, z]))))
    }

    /// Up to `count` more points of `target`, each `radius` and the other's from every other.
    pub fn throw(&mut self, target: &Target, count: usize, radius: f64, random: &mut SplitMix64) -> Vec<Point> {
        let mut points = Vec::with_capacity(count);
        for _ in 0..count.saturating_mul(DARTS) {
            if points.len() == count {
                break;
            }
            let Some(point) = target.dart(random) else { break };
            if self.is_free(point.at, radius) {
                self.insert(point.at, radius);
                points.push(point);
            }
        }
        points
    }
}

/// The triangles of a target seen from above, to find the ground under a place.
pub struct Lookup<'a> {
    target: &'a Target,
    bounds: Aabb,
    /// Columns and rows along x and z, and the triangles whose bounds touch each.
    size: [usize; 2],
    cells: Vec<Vec<u32>>,
}

/// A lookup has some one cell per triangle, and at most so many along an axis.
const MOST_COLUMNS: f64 = 2048.0;

impl<'a> Lookup<'a> {
    pub fn new(target: &'a Target) -> Lookup<'a> {
        let bounds = target.bounds();
        let side = (target.triangles.len() as f64).sqrt().ceil().clamp(1.0, MOST_COLUMNS) as usize;
        let mut lookup = Lookup { target, bounds, size: [side; 2], cells: vec![Vec::new(); side * side] };
        for (i, t) in target.triangles.iter().enumerate() {
            let own = Aabb::around(t.corners);
            let (low, high) = (lookup.column(own.min), lookup.column(own.max));
            for row in low[1]..=high[1] {
                for column in low[0]..=high[0] {
                    lookup.cells[row * side + column].push(i as u32);
                }
            }
        }
        lookup
    }

    fn column(&self, p: DVec3) -> [usize; 2] {
        let (share, size) = ((p - self.bounds.min) / self.bounds.size().max(DVec3::splat(1e-9)), self.size);
        [(share.x, size[0]), (share.z, size[1])].map(|(s, n)| ((s * n as f64).max(0.0) as usize).min(n - 1))
    }

    /// The highest point of the ground at (x, z); `None` where there is none.
    pub fn at(&self, x: f64, z: f64) -> Option<Point> {
        let p = DVec3::new(x, 0.0, z);
        let [column, row] = self.column(p);
        let mut best: Option<Point> = None;
        for &i in &self.cells[row * self.size[0] + column] {
            let triangle = &self.target.triangles[i as usize];
            let [a, b, c] = triangle.corners;
            let (e, f, d) = (b - a, c - a, p - a);
            let det = e.x * f.z - f.x * e.z;
            let (s, t) = ((d.x * f.z - f.x * d.z) / det, (e.x * d.z - d.x * e.z) / det);
            // A place on an edge may lie outside of both triangles by rounding.
            const RIM: f64 = 1e-9;
            if s >= -RIM && t >= -RIM && s + t <= 1.0 + RIM {
                let found = triangle.point(s, t);
                if best.is_none_or(|b| found.at.y > b.at.y) {
                    best = Some(found);
                }
            }
        }
        best
    }
}

/// Whether points lie near a border, by a grid as coarse as the largest distance that is asked for.
pub struct Border {
    cell: f64,
    cells: HashMap<[i64; 3], Vec<[DVec3; 2]>>,
    /// Unit vector along which all is seen.
    up: Option<DVec3>,
}

/// `v` without its part along the unit vector `up`.
fn flattened(v: DVec3, up: DVec3) -> DVec3 {
    v - up * up.dot(v)
}

/// An edge is entered into at most so many cells along each axis; longer ones are cut in pieces first.
const MOST_CELLS: f64 = 4.0;

impl Border {
    /// `reach`: the largest distance that will be asked for. `up`: the unit vector along which the border is seen, where that is
    /// the same for all points; it then counts however far above or below a point it is. Else it counts within the reach.
    pub fn new(edges: &[[DVec3; 2]], reach: f64, up: Option<DVec3>) -> Border {
        let mut border = Border { cell: reach.max(f64::MIN_POSITIVE), cells: HashMap::new(), up };
        for edge in edges {
            let [a, b] = edge.map(|p| up.map_or(p, |up| flattened(p, up)));
            let pieces = ((b - a).abs().max_element() / (MOST_CELLS * border.cell)).ceil().clamp(1.0, 1e6);
            for k in 0..pieces as u64 {
                let at = |k: f64| a.lerp(b, k / pieces);
                border.insert([at(k as f64), at(k as f64 + 1.0)]);
            }
        }
        border
    }

    fn insert(&mut self, [a, b]: [DVec3; 2]) {
        let low = ((a.min(b) - self.cell) / self.cell).floor().to_array().map(|v| v as i64);
        let high = ((a.max(b) + self.cell) / self.cell).floor().to_array().map(|v| v as i64);
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    self.cells.entry([x, y, z]).or_default().push([a, b]);
                }
            }
        }
    }

    /// Whether the border comes nearer to `p` than `distance`, at most the reach, seen along the unit vector `up`, or the one
    /// that the border was made for.
    pub fn is_within(&self, p: DVec3, distance: f64, up: DVec3) -> bool {
        let (up, p) = self.up.map_or((up, p), |up| (up, flattened(p, up)));
        let cell = (p / self.cell).floor().to_array().map(|v| v as i64);
        self.cells.get(&cell).is_some_and(|edges| {
            edges.iter().any(|&[a, b]| {
                let (ab, ap) = (flattened(b - a, up), flattened(p - a, up));
                let t = (ap.dot(ab) / ab.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
                (ap - t * ab).length() < distance
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(size: f64) -> Target {
        let p = |x: f64, z: f64| DVec3::new(x * size, 0.0, z * size);
        let mut target = Target::default();
        for t in [[p(0.0, 0.0), p(0.0, 1.0), p(1.0, 1.0)], [p(0.0, 0.0), p(1.0, 1.0), p(1.0, 0.0)]] {
            let chart = t.map(|p| [p.x / size, p.z / size]);
            target.push(&Face { corners: t, cross: (t[1] - t[0]).cross(t[2] - t[0]), chart }, 0);
        }
        target
    }

    #[test]
    fn discs_are_as_many_as_wanted_apart_and_even() {
        let (target, mut random) = (square(100.0), SplitMix64::new(5));
        assert!((target.area() - 1e4).abs() < 1e-9);
        let points = Discs::new(3.5).throw(&target, 100, 3.5, &mut random);
        // One per 10 m square, .7 of its width apart: below what random darts fill the plane with (.83).
        assert_eq!(points.len(), 100);
        for (i, a) in points.iter().enumerate() {
            assert!(a.at.y == 0.0 && (0.0..100.0).contains(&a.at.x) && (0.0..100.0).contains(&a.at.z));
            assert!((a.normal - DVec3::Y).length() < 1e-12);
            assert!(points[..i].iter().all(|b| b.at.distance(a.at) >= 7.0));
        }
        // Each quarter has near 25; discs that keep apart vary less than independent ones, whose deviation is 4.3.
        let quarter = points.iter().filter(|p| p.at.x < 50.0 && p.at.z < 50.0).count();
        assert!((17..=33).contains(&quarter), "{quarter}");
        let again = Discs::new(3.5).throw(&target, 100, 3.5, &mut SplitMix64::new(5));
        assert_eq!(points, again);
    }

    #[test]
    fn the_ground_is_found_from_above() {
        let mut target = square(8.0);
        let roof = [[2.0, 3.0, 2.0], [2.0, 3.0, 4.0], [4.0, 5.0, 2.0f64]].map(DVec3::from_array);
        let cross = (roof[1] - roof[0]).cross(roof[2] - roof[0]);
        target.push(&Face { corners: roof, cross, chart: [[0.0; 2]; 3] }, 7);
        let lookup = Lookup::new(&target);
        let found = lookup.at(3.0, 2.5).unwrap();
        assert!(found.surface == 7 && (found.at.y - 4.0).abs() < 1e-12, "{found:?}");
        let found = lookup.at(6.0, 2.0).unwrap();
        assert!(found.surface == 0 && found.at.y == 0.0 && found.uv == [0.75, 0.25], "{found:?}");
        // On the diagonal, at a corner, and beyond.
        assert!(lookup.at(5.0, 5.0).is_some() && lookup.at(8.0, 8.0).is_some() && lookup.at(8.1, 4.0).is_none());
        assert!(lookup.at(f64::NAN, 0.0).is_none());
    }

    #[test]
    fn a_full_ground_takes_no_more() {
        let mut discs = Discs::new(10.0);
        let points = discs.throw(&square(50.0), 1000, 10.0, &mut SplitMix64::new(1));
        // Hexagonal packing, with centres up to the border, is the most there can be.
        assert!((5..=13).contains(&points.len()), "{}", points.len());
    }

    #[test]
    fn the_border_is_where_one_triangle_ends() {
        let target = square(8.0);
        let edges = target.border();
        assert_eq!(edges.len(), 4, "the diagonal is shared");
        let border = Border::new(&edges, 2.0, None);
        let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
        // On a steep slope the border is far below; what hangs over it hangs over it all the same.
        let below = Border::new(&edges, 2.0, Some(DVec3::Y));
        assert!(
            below.is_within(at(1.0, 9.0, 4.0), 1.5, DVec3::Y) && !border.is_within(at(1.0, 9.0, 4.0), 1.5, DVec3::Y)
        );
        assert!(!below.is_within(at(2.0, 9.0, 4.0), 1.5, DVec3::Y));
        assert!(border.is_within(at(1.0, 0.0, 4.0), 1.5, DVec3::Y));
        assert!(!border.is_within(at(2.0, 0.0, 4.0), 1.5, DVec3::Y));
        assert!(border.is_within(at(6.9, 0.0, 6.9), 1.2, DVec3::Y));
        assert!(!border.is_within(at(4.0, 0.0, 4.0), 2.0, DVec3::Y));
    }
}
