//! Frustum culling: which boxes a camera may see.

use super::clip::HalfSpace;
use crate::geom::{Aabb, DVec3};
use crate::render::camera::View;

/// The view frustum of a picture: a pyramid or, in a parallel view, a prism, without a far plane.
#[derive(Debug, Clone)]
pub struct Frustum {
    sides: Vec<HalfSpace>,
}

impl Frustum {
    /// The frustum of a picture of `size` pixels, widened by `margin` metres.
    pub fn new(view: &View, size: [u32; 2], margin: f64) -> Frustum {
        let [w, h] = size.map(f64::from);
        let ray = |x: f64, y: f64| {
            let ray = view.cone(x, y, 1.0).ray;
            (view.eye + ray.origin, ray.dir)
        };
        let corners = [ray(0.0, 0.0), ray(w, 0.0), ray(w, h), ray(0.0, h)];
        let (eye, forward) = ray(0.5 * w, 0.5 * h);
        let side = |n: DVec3, through: DVec3| {
            let n = n.normalize_or_zero();
            // Inside is where the middle of the picture is.
            let n = if n.dot(eye + forward - through) > 0.0 { -n } else { n };
            HalfSpace { n, c: n.dot(through) + margin, closed: true }
        };
        let mut sides = vec![side(forward, eye)];
        for k in 0..4 {
            let ((p, d), (q, e)) = (corners[k], corners[(k + 1) % 4]);
            sides.push(side(d.cross(q + e - p), p));
        }
        Frustum { sides }
    }

    /// Whether the box may be visible; boxes near the frustum's edges may count as visible.
    pub fn sees(&self, of: &Aabb) -> bool {
        self.sides.iter().all(|side| {
            let nearest = DVec3::select(side.n.cmpgt(DVec3::ZERO), of.min, of.max);
            side.n.dot(nearest) <= side.c
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Projection;

    #[test]
    fn what_lies_in_the_picture_is_seen() {
        let size = [200, 100];
        for projection in [Projection::Perspective { yfov: 0.8 }, Projection::Orthographic { ymag: 3.0 }] {
            let eye = DVec3::new(100.0, 5.0, -7.0);
            let view = View::towards(eye, DVec3::new(0.3, -0.4, 1.0), DVec3::Y, size, projection).unwrap();
            let frustum = Frustum::new(&view, size, 0.0);
            let point = |x: f64, y: f64, t: f64| {
                let ray = view.cone(x, y, 1.0).ray;
                let p = view.eye + ray.origin + t * ray.dir;
                Aabb::new(p, p)
            };
            for (x, y, inside) in
                [(1.0, 1.0, true), (199.0, 99.0, true), (100.0, 50.0, true), (-2.0, 50.0, false), (100.0, 102.0, false)]
            {
                assert_eq!(frustum.sees(&point(x, y, 20.0)), inside, "{projection:?} {x} {y}");
            }
            assert!(!frustum.sees(&point(100.0, 50.0, -1.0)));
            assert!(Frustum::new(&view, size, 2.0).sees(&point(100.0, 50.0, -1.0)));
        }
    }
}
