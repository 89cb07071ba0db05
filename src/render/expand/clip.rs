//! Clipping of triangles to convex regions.
//!
//! Based on: I. Sutherland, G. Hodgman, *Reentrant Polygon Clipping*, CACM 1974.

use crate::geom::{DAffine3, DVec3};

/// The half-space n · x ≤ c. A polygon that lies in the plane itself belongs to it if `closed`: of two regions that share a
/// plane, one is closed there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfSpace {
    pub n: DVec3,
    pub c: f64,
    pub closed: bool,
}

impl HalfSpace {
    /// Closed where the first component of `n` that is not 0 is above it: of two regions with opposite normals, one is.
    pub fn shared(n: DVec3, c: f64) -> HalfSpace {
        let first = n.to_array().into_iter().find(|v| *v != 0.0).unwrap_or(0.0);
        HalfSpace { n, c, closed: first > 0.0 }
    }

    /// The half-space of the points that `map` takes into this one.
    pub fn preimage(&self, map: &DAffine3) -> HalfSpace {
        HalfSpace { n: map.matrix3.transpose() * self.n, c: self.c - self.n.dot(map.translation), closed: self.closed }
    }
}

/// A vertex of a clipped triangle: its position, and its barycentric weights of the triangle's corners 1 and 2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipVertex {
    pub x: DVec3,
    pub b: [f64; 2],
    /// The triangle's corner that this is; 3 where it is none.
    pub corner: u8,
}

/// Distance, as a share of the normal's length, within which a point lies in a plane: some roundings of coordinates that
/// are themselves of size 1.
const IN_PLANE: f64 = 1e-10;

/// Clip `polygon` to the intersection of `spaces`; it becomes empty where less than a triangle is left. `room` is scratch space.
pub fn clip(polygon: &mut Vec<ClipVertex>, room: &mut Vec<ClipVertex>, spaces: &[HalfSpace]) {
    for space in spaces {
        let slack = IN_PLANE * space.n.length();
        let beyond = |p: &ClipVertex| space.n.dot(p.x) - space.c;
        let (mut most, mut least) = (f64::NEG_INFINITY, f64::INFINITY);
        for d in polygon.iter().map(beyond) {
            (most, least) = (most.max(d), least.min(d));
        }
        if most <= slack {
            if least >= -slack && !space.closed {
                polygon.clear();
            }
            if polygon.is_empty() {
                return;
            }
            continue;
        }
        room.clear();
        for (i, a) in polygon.iter().enumerate() {
            let b = &polygon[(i + 1) % polygon.len()];
            let (da, db) = (beyond(a), beyond(b));
            if da <= slack {
                room.push(*a);
            }
            if (da < -slack && db > slack) || (da > slack && db < -slack) {
                room.push(between(a, b, da / (da - db)));
            }
        }
        std::mem::swap(polygon, room);
        if polygon.len() < 3 {
            polygon.clear();
            return;
        }
    }
}

fn between(a: &ClipVertex, b: &ClipVertex, share: f64) -> ClipVertex {
    let mix = |k: usize| a.b[k] + share * (b.b[k] - a.b[k]);
    ClipVertex { x: a.x.lerp(b.x, share), b: [mix(0), mix(1)], corner: 3 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::DMat3;

    fn triangle() -> Vec<ClipVertex> {
        let at = |x: DVec3, b, corner| ClipVertex { x, b, corner };
        vec![
            at(DVec3::ZERO, [0.0, 0.0], 0),
            at(DVec3::new(2.0, 0.0, 0.0), [1.0, 0.0], 1),
            at(DVec3::new(0.0, 2.0, 0.0), [0.0, 1.0], 2),
        ]
    }

    fn area(polygon: &[ClipVertex]) -> f64 {
        let fan = |k: usize| 0.5 * (polygon[k].x - polygon[0].x).cross(polygon[k + 1].x - polygon[0].x).z;
        (1..polygon.len().saturating_sub(1)).map(fan).sum()
    }

    #[test]
    fn both_sides_of_a_plane_make_up_the_whole() {
        for (n, c) in [(DVec3::X, 0.5), (DVec3::new(1.0, 2.0, 3.0), 1.7), (DVec3::X, 2.0), (DVec3::X, 9.0)] {
            let (mut low, mut high, mut room) = (triangle(), triangle(), Vec::new());
            clip(&mut low, &mut room, &[HalfSpace::shared(n, c)]);
            clip(&mut high, &mut room, &[HalfSpace::shared(-n, -c)]);
            assert!((area(&low) + area(&high) - 2.0).abs() < 1e-12, "{n} {c}");
            for p in low.iter().chain(&high) {
                let by_weights = p.b[0] * DVec3::new(2.0, 0.0, 0.0) + p.b[1] * DVec3::new(0.0, 2.0, 0.0);
                assert!(p.x.distance(by_weights) < 1e-12);
            }
        }
    }

    #[test]
    fn what_lies_in_a_shared_plane_is_of_one_side() {
        let mut kept = 0;
        for n in [DVec3::Z, DVec3::NEG_Z] {
            let (mut polygon, mut room) = (triangle(), Vec::new());
            clip(&mut polygon, &mut room, &[HalfSpace::shared(n, 0.0)]);
            kept += usize::from(!polygon.is_empty());
        }
        assert_eq!(kept, 1);
    }

    #[test]
    fn half_spaces_are_taken_back_through_maps() {
        let map = DAffine3 { matrix3: DMat3::from_rotation_x(0.3) * 2.0, translation: DVec3::new(1.0, 2.0, 3.0) };
        let space = HalfSpace::shared(DVec3::new(0.3, -1.0, 0.7), 0.4);
        let x = DVec3::new(0.9, -0.2, 0.6);
        let (before, after) = (space.preimage(&map), map.transform_point3(x));
        assert!(((before.n.dot(x) - before.c) - (space.n.dot(after) - space.c)).abs() < 1e-12);
    }
}
