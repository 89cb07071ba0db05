//! Random points on triangles with a least distance (Poisson disks), lookups of the ground below a point, and distances to the border.
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
pub struct SurfacePoint {
    pub at: DVec3,
    /// Unit normal of the front of its triangle.
    pub normal: DVec3,
    /// The caller's number of the triangle's surface.
    pub surface: usize,
    /// Texture coordinates.
    pub uv: [f64; 2],
}

/// The triangles on which points are sampled.
#[derive(Default)]
pub struct SampledTriangles {
    triangles: Vec<Triangle>,
    /// Cumulative area, including each triangle.
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
    fn point(&self, s: f64, t: f64) -> SurfacePoint {
        let ([a, b, c], [p, q, r]) = (self.corners, self.uvs);
        let uv = std::array::from_fn(|k| p[k] + s * (q[k] - p[k]) + t * (r[k] - p[k]));
        SurfacePoint { at: a + s * (b - a) + t * (c - a), normal: self.normal, surface: self.surface, uv }
    }
}

impl SampledTriangles {
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
    fn dart(&self, random: &mut SplitMix64) -> Option<SurfacePoint> {
        let aim = random.unit() * self.area();
        let i = self.areas.partition_point(|&a| a <= aim).min(self.areas.len().checked_sub(1)?);
        let triangle = self.triangles.get(i)?;
        let (mut s, mut t) = (random.unit(), random.unit());
        if s + t > 1.0 {
            (s, t) = (1.0 - s, 1.0 - t);
        }
        Some(triangle.point(s, t))
    }

    /// The edges that belong to only one triangle; edges with ends at the same positions are the same.
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

/// Discs that do not overlap, in a grid whose cells are as wide as the largest disc.
pub struct PoissonDiscs {
    cell: f64,
    cells: HashMap<[i64; 3], Vec<(DVec3, f64)>, BuildHasherDefault<CellHasher>>,
    /// The largest radius so far.
    largest: f64,
}

/// A hasher of cells with one multiplication per number. A million copies look up many millions of cells, and there is no adversary who could
/// provoke collisions. (Knuth, *The Art of Computer Programming* 3, 6.4.)
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

/// Darts per wanted disc after which the ground counts as full. At the least distance that `place` uses, three are enough on average.
const DARTS: usize = 40;

impl PoissonDiscs {
    /// `largest`: the largest radius that will come, metres.
    pub fn new(largest: f64) -> PoissonDiscs {
        let cell = if largest > 0.0 && largest.is_finite() { 2.0 * largest } else { 1.0 };
        PoissonDiscs { cell, cells: HashMap::default(), largest: f64::NEG_INFINITY }
    }

    fn cell_of(&self, p: DVec3) -> [i64; 3] {
        (p / self.cell).floor().to_array().map(|v| v as i64)
    }

    /// Add a disc. A negative radius lets other discs come nearer than their own radius.
    pub fn insert(&mut self, p: DVec3, radius: f64) {
        let cell = self.cell_of(p);
        self.largest = self.largest.max(radius);
        self.cells.entry(cell).or_default().push((p, radius));
    }

    /// Whether a disc at `p` would overlap no other.
    fn is_free(&self, p: DVec3, radius: f64) -> bool {
        // Discs beyond this distance cannot overlap it.
        let reach = (radius + self.largest).max(0.0);
        let (low, own, high) = (self.cell_of(p - reach), self.cell_of(p), self.cell_of(p + reach));
        let cells = |k: usize| low[k].max(own[k].saturating_sub(1))..=high[k].min(own[k].saturating_add(1));
        let free = |cell: [i64; 3]| {
            let discs = self.cells.get(&cell).map_or(&[][..], Vec::as_slice);
            discs.iter().all(|&(q, r)| p.distance(q) >= radius + r)
        };
        cells(0).all(|x| cells(1).all(|y| cells(2).all(|z| free([x, y, z]))))
    }

    /// Throw darts at `target` for up to `count` points whose discs of radius `radius` overlap no other disc.
    pub fn throw(
        &mut self,
        target: &SampledTriangles,
        count: usize,
        radius: f64,
        random: &mut SplitMix64,
    ) -> Vec<SurfacePoint> {
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

/// The triangles seen from above, in a grid, to find the ground below a point.
pub struct GroundLookup<'a> {
    target: &'a SampledTriangles,
    bounds: Aabb,
    /// Columns and rows along x and z, and the triangles whose bounds touch each.
    size: [usize; 2],
    cells: Vec<Vec<u32>>,
}

/// Most cells along an axis; otherwise there is about one cell per triangle.
const MAX_COLUMNS: f64 = 2048.0;

impl<'a> GroundLookup<'a> {
    pub fn new(target: &'a SampledTriangles) -> GroundLookup<'a> {
        let bounds = target.bounds();
        let side = (target.triangles.len() as f64).sqrt().ceil().clamp(1.0, MAX_COLUMNS) as usize;
        let mut lookup = GroundLookup { target, bounds, size: [side; 2], cells: vec![Vec::new(); side * side] };
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
    pub fn at(&self, x: f64, z: f64) -> Option<SurfacePoint> {
        let p = DVec3::new(x, 0.0, z);
        let [column, row] = self.column(p);
        let mut best: Option<SurfacePoint> = None;
        for &i in &self.cells[row * self.size[0] + column] {
            let triangle = &self.target.triangles[i as usize];
            let [a, b, c] = triangle.corners;
            let (e, f, d) = (b - a, c - a, p - a);
            let det = e.x * f.z - f.x * e.z;
            let (s, t) = ((d.x * f.z - f.x * d.z) / det, (e.x * d.z - d.x * e.z) / det);
            // By rounding, a point on an edge may lie outside of both triangles.
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

/// Tests whether points lie near a border, by a grid whose cells are as wide as the largest distance that is tested.
pub struct Border {
    cell: f64,
    cells: HashMap<[i64; 3], Vec<[DVec3; 2]>>,
    /// Unit vector along which distances do not count.
    up: Option<DVec3>,
}

/// `v` without its part along the unit vector `up`.
fn flattened(v: DVec3, up: DVec3) -> DVec3 {
    v - up * up.dot(v)
}

/// Most cells along an axis into which a piece of an edge is entered; longer edges are divided into pieces first.
const MAX_CELLS: f64 = 4.0;

impl Border {
    /// `reach` is the largest distance that will be tested, metres. `up` is the unit direction in which copies grow, if it is the same
    /// everywhere; distances are then measured at right angles to it, however far above or below a point the border lies.
    pub fn new(edges: &[[DVec3; 2]], reach: f64, up: Option<DVec3>) -> Border {
        let mut border = Border { cell: reach.max(f64::MIN_POSITIVE), cells: HashMap::new(), up };
        for edge in edges {
            let [a, b] = edge.map(|p| up.map_or(p, |up| flattened(p, up)));
            let pieces = ((b - a).abs().max_element() / (MAX_CELLS * border.cell)).ceil().clamp(1.0, 1e6);
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

    /// Whether the border is nearer to `p` than `distance` (at most the reach), measured at right angles to the unit vector `up`, or to the one
    /// with which the border was built.
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

    fn square(size: f64) -> SampledTriangles {
        let p = |x: f64, z: f64| DVec3::new(x * size, 0.0, z * size);
        let mut target = SampledTriangles::default();
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
        let points = PoissonDiscs::new(3.5).throw(&target, 100, 3.5, &mut random);
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
        let again = PoissonDiscs::new(3.5).throw(&target, 100, 3.5, &mut SplitMix64::new(5));
        assert_eq!(points, again);
    }

    #[test]
    fn the_ground_is_found_from_above() {
        let mut target = square(8.0);
        let roof = [[2.0, 3.0, 2.0], [2.0, 3.0, 4.0], [4.0, 5.0, 2.0f64]].map(DVec3::from_array);
        let cross = (roof[1] - roof[0]).cross(roof[2] - roof[0]);
        target.push(&Face { corners: roof, cross, chart: [[0.0; 2]; 3] }, 7);
        let lookup = GroundLookup::new(&target);
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
        let mut discs = PoissonDiscs::new(10.0);
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
