//! Where a ray meets a triangle, so that none slips between two that share an edge.
//!
//! Based on: S. Woop, C. Benthin, I. Wald, *Watertight Ray/Triangle Intersection*, JCGT 2013.

use crate::geom::{DVec3, each3};

/// A ray prepared for triangles: its largest axis becomes z, and a shear makes it run along z.
pub struct Shear {
    /// Which axes become x, y and z.
    pub axes: [usize; 3],
    /// What x and y move by per z, and 1 over the direction's z.
    pub scale: DVec3,
}

impl Shear {
    pub fn new(dir: DVec3) -> Shear {
        let a = dir.abs();
        let z = if a.x > a.y && a.x > a.z { 0 } else { 1 + usize::from(a.z >= a.y) };
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if dir[z] < 0.0 {
            (x, y) = (y, x);
        }
        Shear { axes: [x, y, z], scale: DVec3::new(dir[x], dir[y], 1.0) / dir[z] }
    }

    /// (t, b1, b2) where the ray from the origin meets the triangle.
    #[inline]
    pub fn meet(&self, [a, b, c]: [DVec3; 3]) -> Option<(f64, [f64; 2])> {
        let [x, y, z] = self.axes;
        // Not by `map` over the corners, which is a call for each: a near picture took 4 % longer.
        let sheared =
            |p: DVec3| DVec3::new(p[x] - self.scale.x * p[z], p[y] - self.scale.y * p[z], self.scale.z * p[z]);
        let (a, b, c) = (sheared(a), sheared(b), sheared(c));
        let u = c.x * b.y - c.y * b.x;
        let v = a.x * c.y - a.y * c.x;
        let w = b.x * a.y - b.y * a.x;
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = u + v + w;
        let t = (u * a.z + v * b.z + w * c.z) / det;
        t.is_finite().then_some((t, [v / det, w / det]))
    }

    /// Whether the triangle is met by the ray, as [`is_within`] has it.
    pub fn is_within(&self, corners: [DVec3; 3]) -> bool {
        let [x, y, z] = self.axes;
        is_within(each3(corners, |p| [p[x] - self.scale.x * p[z], p[y] - self.scale.y * p[z]]))
    }
}

/// Whether the origin, moved aside by (ε, ε²), ε → 0, is in the triangle: of two triangles that share an edge on which the origin
/// is, it is in one alone. Based on: H. Edelsbrunner, E. Mücke, *Simulation of Simplicity*, TOG 1990.
pub fn is_within([a, b, c]: [[f64; 2]; 3]) -> bool {
    let side = |from: [f64; 2], to: [f64; 2]| {
        let exact = from[0] * to[1] - from[1] * to[0];
        let terms = [exact, from[1] - to[1], to[0] - from[0]];
        terms.into_iter().find(|v| *v != 0.0).unwrap_or(0.0) > 0.0
    };
    let first = side(c, b);
    side(a, c) == first && side(b, a) == first
}
