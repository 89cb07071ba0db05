//! The boxes of a shell: one for each face, between the face and its copy that is pushed out by the height vectors. They tell where a ray is
//! inside, and its path in texel coordinates.
//!
//! Based on: S. Porumbescu, B. Budge, L. Feng, K. Joy, *Shell Maps*, SIGGRAPH 2005 (a shell over a surface as texture space);
//! F. Neyret, *Synthesizing Verdant Landscapes using Volumetric Textures*, RR-2846, 1996 (boxes on faces);
//! S. Ogaki, *Nonlinear Ray Tracing for Displacement and Shell Mapping*, SIGGRAPH Asia 2023 (height along the ray is the
//! root of a cubic).
//!
//! Boxes are watertight. A wall is stored with its ends in a fixed order, so both its boxes compute identical crossings. A crossing is never
//! computed again from another origin. And whether a segment between two crossings is inside is decided at its middle, so that a crossing
//! that is found twice, or on a rim, does no harm.

mod corner;
mod patch;
mod trilinear;
mod wall;

use crate::geom::{Aabb, DAffine3, DMat3, DVec3, Ray};
pub use corner::{Corner, HeightInShell, MAX_CELLS, ShellPoint, ShellSegment};
pub use patch::{PatchBox, PatchFault};
use wall::{Crossings, RIM, Wall, quadratic, wall_plane};

/// The half-space n · x ≤ c.
#[derive(Debug, Clone, Copy)]
struct Plane {
    n: DVec3,
    c: f64,
    /// Whether the plane itself is outside of the box: of the two boxes that share a wall, one is open there.
    open: bool,
}

/// A prism: a box whose height vectors agree and whose dw is constant, so that texel coordinates are affine.
#[derive(Debug, Clone)]
pub struct Prism {
    planes: [Plane; 6],
    count: usize,
    /// Texel coordinate = `to_texel` · x + `offset`.
    to_texel: DMat3,
    offset: DVec3,
    /// Height in [0, 1] = `up` · x + `floor`; strength of jitter = `mask` · x + `mask_offset`.
    up: DVec3,
    floor: f64,
    mask: DVec3,
    mask_offset: f64,
    dw: f64,
    bounds: Aabb,
    /// Bounding box of the corners' texel coordinates.
    cover: Aabb,
}

impl Prism {
    /// The prism over a plane convex face of 3 or 4 corners; `None` where the height vectors or dw differ, or there is no volume.
    pub fn new(face: &[Corner]) -> Option<Prism> {
        let [a, b, c, ..] = face else { return None };
        if face.len() > 4 || face.iter().any(|f| f.h != a.h || f.dw != a.dw) {
            return None;
        }
        let edges = DMat3::from_cols(b.p - a.p, c.p - a.p, a.h);
        let inverse = edges.inverse();
        if edges.determinant() == 0.0 || !inverse.is_finite() {
            return None;
        }
        let to_texel = DMat3::from_cols(b.q - a.q, c.q - a.q, a.dw * DVec3::Z) * inverse;
        let offset = a.q - to_texel * a.p;
        let up = inverse.transpose().z_axis;
        let base = up.dot(a.p);
        let mut planes = [Plane { n: -up, c: -base, open: false }; 6];
        planes[1] = Plane { n: up, c: 1.0 + base, open: true };
        let centre = face.iter().map(|f| f.p).sum::<DVec3>() / face.len() as f64;
        for (k, f) in face.iter().enumerate() {
            let (n, c) = wall_plane(f, &face[(k + 1) % face.len()]);
            let open = n.dot(centre) > c;
            planes[2 + k] = if open { Plane { n: -n, c: -c, open } } else { Plane { n, c, open } };
        }
        let mask = inverse.transpose() * DVec3::new(b.jitter - a.jitter, c.jitter - a.jitter, 0.0);
        let bounds = Aabb::around(face.iter().flat_map(|f| [f.p, f.p + f.h]));
        let cover = Aabb::around(face.iter().flat_map(|f| [f.q, f.q + f.dw * DVec3::Z]));
        (to_texel.is_finite() && offset.is_finite()).then_some(Prism {
            planes,
            count: 2 + face.len(),
            to_texel,
            offset,
            up,
            floor: -base,
            mask,
            mask_offset: a.jitter - mask.dot(a.p),
            dw: a.dw,
            bounds,
            cover,
        })
    }

    /// The map from the renderer's space to texel coordinates.
    pub fn to_texel(&self) -> DAffine3 {
        DAffine3 { matrix3: self.to_texel, translation: self.offset }
    }

    /// Bounding box of its texel coordinates.
    pub fn cover(&self) -> Aabb {
        self.cover
    }

    /// Whether a part of the box `content` lies outside of the prism by more than the length `room`. Both are in a space from which `place`
    /// leads to the renderer's.
    pub fn cuts(&self, content: &Aabb, place: &DAffine3, room: f64) -> bool {
        let normals_to_place = place.matrix3.transpose();
        self.planes[..self.count].iter().any(|plane| {
            let n = normals_to_place * plane.n;
            let farthest = n.dot(content.centre()) + n.abs().dot(0.5 * content.size());
            farthest - (plane.c - plane.n.dot(place.translation)) > room * n.length()
        })
    }

    fn span(&self, ray: &Ray, mut t0: f64, mut t1: f64) -> Option<(f64, f64)> {
        for plane in &self.planes[..self.count] {
            let (along, room) = (plane.n.dot(ray.dir), plane.c - plane.n.dot(ray.origin));
            if along > 0.0 {
                t1 = t1.min(room / along);
            } else if along < 0.0 {
                t0 = t0.max(room / along);
            } else if room < 0.0 || (room == 0.0 && plane.open) {
                return None;
            }
        }
        (t0 < t1).then_some((t0, t1))
    }

    fn texel(&self, x: DVec3) -> DVec3 {
        self.to_texel * x + self.offset
    }

    fn height_at(&self, x: DVec3) -> HeightInShell {
        let height = self.up.dot(x) + self.floor;
        HeightInShell { rise: height * self.dw, height, mask: (self.mask.dot(x) + self.mask_offset).clamp(0.0, 1.0) }
    }
}

/// A box over a triangle with any height vectors; its walls are bilinear patches.
#[derive(Debug, Clone)]
pub struct TwistedBox {
    corners: [Corner; 3],
    walls: [Wall; 3],
    /// Normal of the triangle at height W is n0 + W n1 + W² n2.
    normal: [DVec3; 3],
    bounds: Aabb,
}

/// Parameters of a point in a box over a triangle: barycentric weights of corners 1 and 2, and the height W in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
struct BoxPoint {
    b: [f64; 2],
    w: f64,
    /// Distance outside of the box in these parameters; ≤ 0 inside.
    outside: f64,
}

impl TwistedBox {
    /// `None` where the box has no volume at its middle.
    pub fn new(face: &[Corner; 3]) -> Option<TwistedBox> {
        let [a, b, c] = face;
        let (e1, e2, g1, g2) = (b.p - a.p, c.p - a.p, b.h - a.h, c.h - a.h);
        let normal = [e1.cross(e2), e1.cross(g2) + g1.cross(e2), g1.cross(g2)];
        let bounds = Aabb::around(face.iter().flat_map(|f| [f.p, f.p + f.h]));
        let it =
            TwistedBox { corners: *face, walls: [Wall::new(a, b), Wall::new(b, c), Wall::new(c, a)], normal, bounds };
        let middle = it.edges(BoxPoint { b: [1.0 / 3.0; 2], w: 0.5, outside: 0.0 });
        (middle.determinant() != 0.0 && middle.inverse().is_finite()).then_some(it)
    }

    /// Whether the box turns inside out somewhere: its volume element changes sign between corners.
    pub fn folded(&self) -> bool {
        let sign = |b: [f64; 2], w: f64| self.edges(BoxPoint { b, w, outside: 0.0 }).determinant().signum();
        let all = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|b| [sign(b, 0.0), sign(b, 1.0)]);
        all.iter().flatten().any(|&s| s != all[0][0])
    }

    /// dx/d(b1, b2, W).
    fn edges(&self, at: BoxPoint) -> DMat3 {
        let [a, b, c] = &self.corners;
        let rise = (1.0 - at.b[0] - at.b[1]) * a.h + at.b[0] * b.h + at.b[1] * c.h;
        DMat3::from_cols(b.p - a.p + at.w * (b.h - a.h), c.p - a.p + at.w * (c.h - a.h), rise)
    }

    fn texel(&self, at: BoxPoint) -> DVec3 {
        let [a, b, c] = &self.corners;
        let top = |k: &Corner| k.q + at.w * k.dw * DVec3::Z;
        (1.0 - at.b[0] - at.b[1]) * top(a) + at.b[0] * top(b) + at.b[1] * top(c)
    }

    fn height_at(&self, at: BoxPoint) -> HeightInShell {
        let [a, b, c] = &self.corners;
        let mix = |of: fn(&Corner) -> f64| (1.0 - at.b[0] - at.b[1]) * of(a) + at.b[0] * of(b) + at.b[1] * of(c);
        HeightInShell { rise: at.w * mix(|k| k.dw), height: at.w, mask: mix(|k| k.jitter).clamp(0.0, 1.0) }
    }

    /// Linear part of the map from the renderer's space to texel coordinates at a point.
    fn to_texel(&self, at: BoxPoint) -> DMat3 {
        let [a, b, c] = &self.corners;
        let dw = (1.0 - at.b[0] - at.b[1]) * a.dw + at.b[0] * b.dw + at.b[1] * c.dw;
        let up = |k: &Corner| k.q - a.q + at.w * (k.dw - a.dw) * DVec3::Z;
        DMat3::from_cols(up(b), up(c), dw * DVec3::Z) * self.edges(at).inverse()
    }

    /// Parameters of a position. Of the up to three heights at which it lies in the plane of the triangle, the solution that is least outside.
    fn locate(&self, x: DVec3) -> Option<BoxPoint> {
        let [a, b, c] = &self.corners;
        let (r, [n0, n1, n2]) = (x - a.p, self.normal);
        let k = [n0.dot(r), n1.dot(r) - n0.dot(a.h), n2.dot(r) - n1.dot(a.h), -n2.dot(a.h)];
        let mut best: Option<BoxPoint> = None;
        for w in cubic_in_unit(k).into_iter().flatten() {
            let n = n0 + w * (n1 + w * n2);
            let foot = r - w * a.h;
            let (e1, e2) = (b.p - a.p + w * (b.h - a.h), c.p - a.p + w * (c.h - a.h));
            let area = n.length_squared();
            let (b1, b2) = (foot.cross(e2).dot(n) / area, e1.cross(foot).dot(n) / area);
            let outside = (-b1).max(-b2).max(b1 + b2 - 1.0).max(-w).max(w - 1.0);
            if outside.is_finite() && best.is_none_or(|p| outside < p.outside) {
                best = Some(BoxPoint { b: [b1, b2], w, outside });
            }
        }
        best
    }

    fn spans(&self, ray: &Ray, t0: f64, t1: f64, each: impl FnMut(f64, f64)) {
        let mut found = Crossings::new();
        let [a, b, c] = &self.corners;
        for (p, q, r) in [(a.p, b.p, c.p), (a.p + a.h, b.p + b.h, c.p + c.h)] {
            let n = (q - p).cross(r - p);
            found.push(n.dot(p - ray.origin) / n.dot(ray.dir));
        }
        self.walls.iter().for_each(|w| w.crossings(ray, &mut found));
        let inside = |t: f64| self.locate(ray.at(t)).is_some_and(|p| p.outside <= 1e-9);
        found.spans(t0, t1, inside, each);
    }

    /// Texel coordinate at t; `None` where the box is degenerate.
    fn along(&self, ray: &Ray, t: f64) -> Option<(BoxPoint, DVec3)> {
        let place = self.locate(ray.at(t))?;
        Some((place, self.texel(place)))
    }

    /// Subdivide [t0, t1] until the texel coordinates in the middle and at a quarter of each segment are within `tolerance` of the chord.
    fn for_each_segment(
        &self,
        ray: &Ray,
        t0: f64,
        t1: f64,
        tolerance: &dyn Fn(f64, &DMat3) -> f64,
        each: &mut dyn FnMut(&ShellSegment) -> bool,
    ) -> bool {
        let (Some((from, q0)), Some((to, q1))) = (self.along(ray, t0), self.along(ray, t1)) else { return true };
        let end_heights = [self.height_at(from), self.height_at(to)];
        self.cut(ray, ShellSegment { t0, t1, q0, q1, to_texel: DMat3::IDENTITY, end_heights }, 0, tolerance, each)
    }

    fn cut(
        &self,
        ray: &Ray,
        mut piece: ShellSegment,
        depth: u32,
        tolerance: &dyn Fn(f64, &DMat3) -> f64,
        each: &mut dyn FnMut(&ShellSegment) -> bool,
    ) -> bool {
        const DEEPEST: u32 = 8;
        let ShellSegment { t0, t1, q0, q1, .. } = piece;
        let mid = 0.5 * (t0 + t1);
        let Some((place, q)) = self.along(ray, mid) else { return true };
        let to_texel = self.to_texel(place);
        if !to_texel.is_finite() {
            return true;
        }
        let allowed = tolerance(mid, &to_texel);
        let straight = q.distance(0.5 * (q0 + q1)) <= allowed
            && self
                .along(ray, 0.75 * t0 + 0.25 * t1)
                .is_none_or(|(_, quarter)| quarter.distance(0.75 * q0 + 0.25 * q1) <= allowed);
        let many = (q1 - q0).abs().max_element() > f64::from(MAX_CELLS);
        if straight || many || depth == DEEPEST {
            piece.to_texel = to_texel;
            return each(&piece);
        }
        let ([from, to], height) = (piece.end_heights, self.height_at(place));
        let left = ShellSegment { t1: mid, q1: q, end_heights: [from, height], ..piece };
        let right = ShellSegment { t0: mid, q0: q, end_heights: [height, to], ..piece };
        self.cut(ray, left, depth + 1, tolerance, each) && self.cut(ray, right, depth + 1, tolerance, each)
    }
}

/// Roots of k0 + k1 x + k2 x² + k3 x³ in [0, 1] and a rim around it, by Newton's method guarded by bisection, between the extrema.
fn cubic_in_unit(k: [f64; 4]) -> [Option<f64>; 3] {
    const LO: f64 = -RIM;
    const HI: f64 = 1.0 + RIM;
    let f = |x: f64| k[0] + x * (k[1] + x * (k[2] + x * k[3]));
    let slope = |x: f64| k[1] + x * (2.0 * k[2] + x * 3.0 * k[3]);
    let [a, b] = quadratic(k[1], 2.0 * k[2], 3.0 * k[3]);
    let mut ends = [LO, a.clamp(LO, HI), b.clamp(LO, HI), HI].map(|x| if x.is_nan() { LO } else { x });
    ends.sort_unstable_by(f64::total_cmp);
    let mut roots = [None; 3];
    for i in 0..3 {
        let (mut lo, mut hi) = (ends[i], ends[i + 1]);
        let (flo, fhi) = (f(lo), f(hi));
        if lo >= hi || (flo > 0.0) == (fhi > 0.0) {
            continue;
        }
        let rising = fhi > flo;
        let mut x = lo + (hi - lo) * (flo / (flo - fhi)).clamp(0.0, 1.0);
        for _ in 0..60 {
            let y = f(x);
            if (y > 0.0) == rising {
                hi = x
            } else {
                lo = x
            }
            let step = x - y / slope(x);
            let next = if step > lo && step < hi { step } else { 0.5 * (lo + hi) };
            if next == x || (next - x).abs() < 1e-15 {
                break;
            }
            x = next;
        }
        roots[i] = Some(x);
    }
    roots
}

/// A box of any kind.
#[derive(Debug, Clone)]
pub enum ShellBox {
    Prism(Box<Prism>),
    Twisted(Box<TwistedBox>),
    Patch(Box<PatchBox>),
}

impl ShellBox {
    /// The box over a triangle; `None` where it has no volume.
    pub fn new(face: &[Corner; 3]) -> Option<ShellBox> {
        match Prism::new(face) {
            Some(prism) => Some(ShellBox::Prism(Box::new(prism))),
            None => TwistedBox::new(face).map(|t| ShellBox::Twisted(Box::new(t))),
        }
    }

    pub fn bounds(&self) -> Aabb {
        match self {
            ShellBox::Prism(b) => b.bounds,
            ShellBox::Twisted(b) => b.bounds,
            ShellBox::Patch(b) => b.bounds(),
        }
    }

    /// Depth of a point inside, a share of the box's size; not above 0 outside.
    pub fn depth_inside(&self, x: DVec3) -> f64 {
        match self {
            ShellBox::Prism(b) => {
                let size = b.bounds.size().length();
                let room = |p: &Plane| (p.c - p.n.dot(x)) / (p.n.length() * size);
                b.planes[..b.count].iter().map(room).fold(f64::INFINITY, f64::min)
            }
            ShellBox::Twisted(b) => b.locate(x).map_or(f64::NEG_INFINITY, |p| -p.outside),
            ShellBox::Patch(b) => b.depth_inside(x),
        }
    }

    /// The intervals of t in [t0, t1] in which the ray is inside, in order.
    pub fn spans(&self, ray: &Ray, t0: f64, t1: f64, mut each: impl FnMut(f64, f64)) {
        match self {
            ShellBox::Prism(b) => {
                if let Some((a, b)) = b.span(ray, t0, t1) {
                    each(a, b);
                }
            }
            ShellBox::Twisted(b) => b.spans(ray, t0, t1, each),
            ShellBox::Patch(b) => b.spans(ray, t0, t1, each),
        }
    }

    /// Call `each` for straight segments that approximate the ray in texel coordinates over [t0, t1], which lies in one of [`ShellBox::spans`],
    /// in order, until it returns false. `tolerance(t, to_texel)` is the largest deviation from the exact path, in texel units. Returns false if
    /// stopped.
    pub fn for_each_segment(
        &self,
        ray: &Ray,
        t0: f64,
        t1: f64,
        tolerance: &dyn Fn(f64, &DMat3) -> f64,
        each: &mut dyn FnMut(&ShellSegment) -> bool,
    ) -> bool {
        match self {
            ShellBox::Prism(b) => {
                let (from, to) = (ray.at(t0), ray.at(t1));
                let end_heights = [b.height_at(from), b.height_at(to)];
                each(&ShellSegment { t0, t1, q0: b.texel(from), q1: b.texel(to), to_texel: b.to_texel, end_heights })
            }
            ShellBox::Twisted(b) => b.for_each_segment(ray, t0, t1, tolerance, each),
            ShellBox::Patch(b) => b.for_each_segment(ray, t0, t1, tolerance, each),
        }
    }
}

#[cfg(test)]
mod tests;
