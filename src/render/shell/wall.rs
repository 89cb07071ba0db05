//! Walls between the boxes of a shell: where rays cross them, and which intervals between crossings are inside of a box.
//!
//! Based on: S. Ramsey, K. Potter, C. Hansen, *Ray Bilinear Patch Intersections*, JGT 2004; A. Reshetov, *Cool Patches*, Ray
//! Tracing Gems, 2019 (the quadratic of a ray and a ruled surface).

use super::corner::Corner;
use crate::geom::{DVec3, Ray};

/// Whether `a` comes before `b` in a fixed order of positions.
fn ordered(a: &Corner, b: &Corner) -> bool {
    a.p.to_array().partial_cmp(&b.p.to_array()) != Some(std::cmp::Ordering::Greater)
}

/// The plane of a wall whose ends have the same height vector, in the fixed order of its ends.
pub fn wall_plane(a: &Corner, b: &Corner) -> (DVec3, f64) {
    let (a, b) = if ordered(a, b) { (a, b) } else { (b, a) };
    let n = (b.p - a.p).cross(a.h);
    (n, n.dot(a.p))
}

/// A wall between two corners.
#[derive(Debug, Clone, Copy)]
pub enum Wall {
    Plane {
        n: DVec3,
        c: f64,
    },
    /// a + s e + W (h + s g).
    Patch {
        a: DVec3,
        e: DVec3,
        h: DVec3,
        g: DVec3,
    },
}

impl Wall {
    /// The wall over the edge from a to b, bitwise equal to that over the edge from b to a.
    pub fn new(a: &Corner, b: &Corner) -> Wall {
        if a.h == b.h {
            let (n, c) = wall_plane(a, b);
            return Wall::Plane { n, c };
        }
        let (a, b) = if ordered(a, b) { (a, b) } else { (b, a) };
        Wall::Patch { a: a.p, e: b.p - a.p, h: a.h, g: b.h - a.h }
    }

    /// The bilinear patch between two edges, ruled from the one to the other.
    pub fn ruled([a, b]: [DVec3; 2], [over_a, over_b]: [DVec3; 2]) -> Wall {
        Wall::Patch { a, e: b - a, h: over_a - a, g: (over_b - b) - (over_a - a) }
    }

    /// Sine of the angle between `dir` and the wall's rulings in its middle; 1 for a plane.
    pub fn squareness(&self, dir: DVec3) -> f64 {
        let Wall::Patch { h, g, .. } = self else { return 1.0 };
        let ruling = *h + 0.5 * *g;
        ruling.cross(dir).length() / (ruling.length() * dir.length())
    }

    /// Add the parameters at which `ray` crosses the wall to `found`; some may lie slightly beyond its rim.
    pub fn crossings(&self, ray: &Ray, found: &mut Crossings) {
        match *self {
            Wall::Plane { n, c } => found.push((c - n.dot(ray.origin)) / n.dot(ray.dir)),
            Wall::Patch { a, e, h, g } => {
                let (a, d) = (a - ray.origin, ray.dir);
                let c0 = d.dot(a.cross(h));
                let c1 = d.dot(a.cross(g) + e.cross(h));
                let c2 = d.dot(e.cross(g));
                for s in quadratic(c0, c1, c2) {
                    // The ruling at s, and where on it the ray passes.
                    let (foot, rise) = (a + s * e, h + s * g);
                    let across = rise.cross(d);
                    let w = -foot.cross(d).dot(across) / across.length_squared();
                    if (-RIM..=1.0 + RIM).contains(&s) && (-RIM..=1.0 + RIM).contains(&w) {
                        found.push((foot + w * rise).dot(d) / d.length_squared());
                    }
                }
            }
        }
    }
}

/// Distance beyond its rim, in units of its size, at which a wall still reports a crossing; an additional crossing is harmless.
pub const RIM: f64 = 1e-6;

/// Roots of c0 + c1 x + c2 x², without cancellation; NaN or infinite where there is none.
pub fn quadratic(c0: f64, c1: f64, c2: f64) -> [f64; 2] {
    let disc = c1 * c1 - 4.0 * c0 * c2;
    // A negative discriminant by rounding alone, at a ray that touches the patch, is a double root.
    let root = if disc < 0.0 && disc > -1e-13 * c1 * c1 { 0.0 } else { disc.sqrt() };
    let s = -0.5 * (c1 + root.copysign(c1));
    [s / c2, c0 / s]
}

/// Parameters at which a ray crosses a box's surface.
pub struct Crossings {
    t: [f64; 16],
    n: usize,
}

impl Crossings {
    pub fn new() -> Crossings {
        Crossings { t: [0.0; 16], n: 0 }
    }

    pub fn push(&mut self, t: f64) {
        if t.is_finite() && self.n < self.t.len() {
            self.t[self.n] = t;
            self.n += 1;
        }
    }

    /// The intervals of [t0, t1], between crossings, whose middles are `inside`, in order; those that abut are one.
    pub fn spans(mut self, t0: f64, t1: f64, inside: impl Fn(f64) -> bool, mut each: impl FnMut(f64, f64)) {
        self.push(t0);
        self.push(t1);
        let all = &mut self.t[..self.n];
        all.sort_unstable_by(f64::total_cmp);
        let mut open: Option<f64> = None;
        let mut last = t0;
        for pair in all.windows(2) {
            let (from, to) = (pair[0].max(t0), pair[1].min(t1));
            if from >= to {
                continue;
            }
            match (inside(0.5 * (from + to)), open) {
                (true, None) => open = Some(from),
                (false, Some(start)) => {
                    each(start, from);
                    open = None;
                }
                _ => {}
            }
            last = to;
        }
        if let Some(start) = open {
            each(start, last);
        }
    }
}
