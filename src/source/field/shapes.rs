//! Simple solids by their distances: none grows faster than the distance to the surface.
//!
//! Based on: J. Hart, *Sphere Tracing*, The Visual Computer 12, 1996 (distances to solids, and lower bounds of them).

use super::{Field, grown};
use crate::geom::{Aabb, DVec2, DVec3};

/// A ball. Exact.
#[derive(Debug, Clone, Copy)]
pub struct Sphere {
    /// Centre.
    pub centre: DVec3,
    /// Radius.
    pub radius: f64,
}

impl Field for Sphere {
    fn value(&self, p: DVec3) -> f64 {
        p.distance(self.centre) - self.radius
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        (p - self.centre).normalize_or_zero()
    }

    fn range(&self, b: &Aabb) -> (f64, f64) {
        let (near, far) = reach(b, self.centre);
        (near.length() - self.radius, far.length() - self.radius)
    }

    fn bounds(&self) -> Aabb {
        Aabb::new(self.centre - self.radius, self.centre + self.radius)
    }

    fn bounds_of(&self, level: f64) -> Aabb {
        grown(self.bounds(), level)
    }
}

/// Distances, axis by axis, from `p` to the nearest and the farthest point of `b`.
fn reach(b: &Aabb, p: DVec3) -> (DVec3, DVec3) {
    ((b.min - p).max(p - b.max).max(DVec3::ZERO), (b.min - p).abs().max((b.max - p).abs()))
}

/// An ellipsoid along the axes: the distance of the unit ball that it is an image of, times the least radius. Exact on the
/// surface, at most the distance elsewhere.
#[derive(Debug, Clone, Copy)]
pub struct Ellipsoid {
    /// Centre.
    pub centre: DVec3,
    /// Radii.
    pub radii: DVec3,
}

impl Field for Ellipsoid {
    fn value(&self, p: DVec3) -> f64 {
        (((p - self.centre) / self.radii).length() - 1.0) * self.radii.min_element()
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        let q = (p - self.centre) / self.radii;
        q.normalize_or_zero() / self.radii * self.radii.min_element()
    }

    fn range(&self, b: &Aabb) -> (f64, f64) {
        let (near, far) = reach(b, self.centre);
        let value = |d: DVec3| ((d / self.radii).length() - 1.0) * self.radii.min_element();
        (value(near), value(far))
    }

    fn bounds(&self) -> Aabb {
        Aabb::new(self.centre - self.radii, self.centre + self.radii)
    }

    fn bounds_of(&self, level: f64) -> Aabb {
        let reach = self.radii * (1.0 + level.max(0.0) / self.radii.min_element());
        Aabb::new(self.centre - reach, self.centre + reach)
    }
}

/// A box along the axes, its edges rounded by `round`. Exact.
#[derive(Debug, Clone, Copy)]
pub struct RoundedBox {
    /// Lower corner.
    pub min: DVec3,
    /// Upper corner.
    pub max: DVec3,
    /// At most half the shortest edge.
    pub round: f64,
}

impl Field for RoundedBox {
    fn value(&self, p: DVec3) -> f64 {
        let d = (self.min + self.round - p).max(p - self.max + self.round);
        d.max(DVec3::ZERO).length() + d.max_element().min(0.0) - self.round
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        let (low, high) = (self.min + self.round - p, p - self.max + self.round);
        let d = low.max(high);
        let sign = DVec3::new(sign(low.x, high.x), sign(low.y, high.y), sign(low.z, high.z));
        let out = d.max(DVec3::ZERO);
        if out != DVec3::ZERO {
            return out.normalize() * sign;
        }
        let axis = (0..3).max_by(|&a, &b| d[a].total_cmp(&d[b])).unwrap_or(0);
        DVec3::AXES[axis] * sign
    }

    fn bounds(&self) -> Aabb {
        Aabb::new(self.min, self.max)
    }

    fn bounds_of(&self, level: f64) -> Aabb {
        grown(self.bounds(), level)
    }
}

fn sign(low: f64, high: f64) -> f64 {
    if low > high { -1.0 } else { 1.0 }
}

/// All points within `radius` of a segment. Exact.
#[derive(Debug, Clone, Copy)]
pub struct Capsule {
    /// First end of the axis.
    pub from: DVec3,
    /// Second end of the axis.
    pub to: DVec3,
    /// Radius.
    pub radius: f64,
}

/// The point of the segment `a`-`b` that is nearest to `p`.
pub fn nearest_of_segment(p: DVec3, a: DVec3, b: DVec3) -> DVec3 {
    let along = b - a;
    let length = along.length_squared();
    let t = if length > 0.0 { ((p - a).dot(along) / length).clamp(0.0, 1.0) } else { 0.0 };
    a + t * along
}

impl Field for Capsule {
    fn value(&self, p: DVec3) -> f64 {
        p.distance(nearest_of_segment(p, self.from, self.to)) - self.radius
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        (p - nearest_of_segment(p, self.from, self.to)).normalize_or_zero()
    }

    fn bounds(&self) -> Aabb {
        let b = Aabb::around([self.from, self.to]);
        Aabb::new(b.min - self.radius, b.max + self.radius)
    }

    fn bounds_of(&self, level: f64) -> Aabb {
        grown(self.bounds(), level)
    }
}

/// A truncated cone between two discs; a cylinder where both radii are the same. Exact.
#[derive(Debug, Clone, Copy)]
pub struct Cone {
    /// First end of the axis.
    pub from: DVec3,
    /// Second end of the axis.
    pub to: DVec3,
    /// Radii.
    pub radii: [f64; 2],
}

impl Cone {
    /// Along the axis, away from it, and the unit directions of both at `p`.
    fn flat(&self, p: DVec3) -> (DVec2, DVec3, DVec3) {
        let axis = (self.to - self.from).normalize_or(DVec3::Z);
        let along = (p - self.from).dot(axis);
        let away = p - self.from - along * axis;
        let out = away.try_normalize().unwrap_or_else(|| axis.any_orthonormal_vector());
        (DVec2::new(along, away.length()), axis, out)
    }

    /// The signed distance in the half-plane (along, away), and its gradient there.
    fn distance(&self, p: DVec2) -> (f64, DVec2) {
        let height = (self.to - self.from).length();
        let [r0, r1] = self.radii;
        let side = DVec2::new(height, r1 - r0);
        let normal = DVec2::new(-side.y, side.x).normalize_or(DVec2::Y);
        // Signed distances to the lines of the three faces; within, the nearest of them.
        let lines = [(-p.x, -DVec2::X), (p.x - height, DVec2::X), ((p - DVec2::new(0.0, r0)).dot(normal), normal)];
        let inner = lines.iter().fold(lines[0], |best, l| if l.0 > best.0 { *l } else { best });
        if inner.0 <= 0.0 {
            return inner;
        }
        let on = |a: DVec2, b: DVec2| {
            let t = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
            if t.is_nan() { a } else { a + t * (b - a) }
        };
        let (low, high) = (DVec2::new(0.0, r0), DVec2::new(height, r1));
        let nearest = [on(DVec2::ZERO, low), on(low, high), on(high, DVec2::new(height, 0.0))]
            .into_iter()
            .min_by(|a, b| p.distance_squared(*a).total_cmp(&p.distance_squared(*b)))
            .unwrap_or_default();
        (p.distance(nearest), (p - nearest).try_normalize().unwrap_or(inner.1))
    }
}

impl Field for Cone {
    fn value(&self, p: DVec3) -> f64 {
        self.distance(self.flat(p).0).0
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        let (flat, axis, out) = self.flat(p);
        let g = self.distance(flat).1;
        g.x * axis + g.y * out
    }

    fn bounds(&self) -> Aabb {
        let axis = (self.to - self.from).normalize_or(DVec3::Z);
        // A disc square to the axis reaches this far along each coordinate.
        let disc = (1.0 - axis * axis).max(DVec3::ZERO).map(f64::sqrt);
        let end = |p: DVec3, r: f64| Aabb::new(p - r * disc, p + r * disc);
        end(self.from, self.radii[0]).union(end(self.to, self.radii[1]))
    }

    fn bounds_of(&self, level: f64) -> Aabb {
        grown(self.bounds(), level)
    }
}

/// A ring: all points within `thickness` of a circle. Exact.
#[derive(Debug, Clone, Copy)]
pub struct Torus {
    /// Centre.
    pub centre: DVec3,
    /// Unit direction of the axis or normal.
    pub axis: DVec3,
    /// Radius of the circle.
    pub radius: f64,
    /// Thickness.
    pub thickness: f64,
}

impl Torus {
    /// From the nearest point of the circle.
    fn off_circle(&self, p: DVec3) -> DVec3 {
        let d = p - self.centre;
        let height = d.dot(self.axis);
        let flat = d - height * self.axis;
        flat - self.radius * flat.try_normalize().unwrap_or_else(|| self.axis.any_orthonormal_vector())
            + height * self.axis
    }
}

impl Field for Torus {
    fn value(&self, p: DVec3) -> f64 {
        self.off_circle(p).length() - self.thickness
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        self.off_circle(p).normalize_or_zero()
    }

    fn bounds(&self) -> Aabb {
        let disc = (1.0 - self.axis * self.axis).max(DVec3::ZERO).map(f64::sqrt);
        let reach = self.radius * disc + self.thickness;
        Aabb::new(self.centre - reach, self.centre + reach)
    }

    fn bounds_of(&self, level: f64) -> Aabb {
        grown(self.bounds(), level)
    }
}

/// All that is below a plane. Exact; without end.
#[derive(Debug, Clone, Copy)]
pub struct HalfSpace {
    /// A point of the plane.
    pub point: DVec3,
    /// Unit, out of the matter.
    pub normal: DVec3,
}

impl Field for HalfSpace {
    fn value(&self, p: DVec3) -> f64 {
        (p - self.point).dot(self.normal)
    }

    fn gradient(&self, _: DVec3) -> DVec3 {
        self.normal
    }

    fn range(&self, b: &Aabb) -> (f64, f64) {
        let (middle, reach) = (self.value(b.centre()), (0.5 * b.size()).dot(self.normal.abs()));
        (middle - reach, middle + reach)
    }

    fn bounds(&self) -> Aabb {
        let mut b = Aabb::new(DVec3::NEG_INFINITY, DVec3::INFINITY);
        for a in 0..3 {
            if self.normal[a] == 1.0 {
                b.max[a] = self.point[a];
            } else if self.normal[a] == -1.0 {
                b.min[a] = self.point[a];
            }
        }
        b
    }

    fn bounds_of(&self, level: f64) -> Aabb {
        grown(self.bounds(), level)
    }
}

/// A plane `thickness` thick. Exact; without end.
#[derive(Debug, Clone, Copy)]
pub struct Plane {
    /// A point of the plane.
    pub point: DVec3,
    /// Unit direction of the axis or normal.
    pub normal: DVec3,
    /// Thickness.
    pub thickness: f64,
}

impl Field for Plane {
    fn value(&self, p: DVec3) -> f64 {
        (p - self.point).dot(self.normal).abs() - 0.5 * self.thickness
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        self.normal * 1f64.copysign((p - self.point).dot(self.normal))
    }

    fn bounds(&self) -> Aabb {
        let mut b = Aabb::new(DVec3::NEG_INFINITY, DVec3::INFINITY);
        for a in 0..3 {
            if self.normal[a].abs() == 1.0 {
                (b.min[a], b.max[a]) = (self.point[a] - 0.5 * self.thickness, self.point[a] + 0.5 * self.thickness);
            }
        }
        b
    }

    fn bounds_of(&self, level: f64) -> Aabb {
        grown(self.bounds(), level)
    }
}

/// All points within half of `thickness` of a triangle. Exact.
#[derive(Debug, Clone, Copy)]
pub struct Triangle {
    /// Corners.
    pub corners: [DVec3; 3],
    /// Thickness.
    pub thickness: f64,
}

/// The point of the triangle that is nearest to `p`.
pub fn nearest_of_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let n = (b - a).cross(c - a);
    let inner = |u: DVec3, v: DVec3| (v - u).cross(p - u).dot(n) >= 0.0;
    if n != DVec3::ZERO && inner(a, b) && inner(b, c) && inner(c, a) {
        return p - (p - a).dot(n) / n.length_squared() * n;
    }
    [nearest_of_segment(p, a, b), nearest_of_segment(p, b, c), nearest_of_segment(p, c, a)]
        .into_iter()
        .min_by(|u, v| p.distance_squared(*u).total_cmp(&p.distance_squared(*v)))
        .unwrap_or(a)
}

impl Field for Triangle {
    fn value(&self, p: DVec3) -> f64 {
        p.distance(nearest_of_triangle(p, self.corners)) - 0.5 * self.thickness
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        (p - nearest_of_triangle(p, self.corners)).normalize_or_zero()
    }

    fn bounds(&self) -> Aabb {
        let b = Aabb::around(self.corners);
        Aabb::new(b.min - 0.5 * self.thickness, b.max + 0.5 * self.thickness)
    }

    fn bounds_of(&self, level: f64) -> Aabb {
        grown(self.bounds(), level)
    }
}
