//! Triangulation of planar polygons with any number of corners.

use crate::geom::{DVec2, DVec3};

/// Triangulator of polygons that keeps its working memory between them.
pub struct Triangulator {
    earcut: earcut::Earcut<f64>,
    flat: Vec<DVec2>,
    corners: Vec<u32>,
}

impl Triangulator {
    pub fn new() -> Self {
        Triangulator { earcut: earcut::Earcut::new(), flat: Vec::new(), corners: Vec::new() }
    }

    /// Call `triangle` for the triangles of a polygon, as indices into it and with its winding. Convex polygons become fans; concave ones are
    /// triangulated by ear clipping.
    pub fn triangulate(&mut self, polygon: &[DVec3], mut triangle: impl FnMut([usize; 3])) {
        let fan = |triangle: &mut dyn FnMut([usize; 3])| (2..polygon.len()).for_each(|i| triangle([0, i - 1, i]));
        if polygon.len() <= 3 {
            return fan(&mut triangle);
        }
        // Newell: the area vector of any closed polygon.
        let edges = || polygon.iter().zip(polygon.iter().cycle().skip(1));
        let normal: DVec3 = edges().map(|(a, b)| (*a - polygon[0]).cross(*b - polygon[0])).sum();
        let Some(w) = normal.try_normalize() else { return fan(&mut triangle) };
        let (u, v) = w.any_orthonormal_pair();
        // (u, v, w) is right-handed, so that the polygon turns counter-clockwise in the plane.
        self.flat.clear();
        self.flat.extend(polygon.iter().map(|p| DVec2::new((*p - polygon[0]).dot(u), (*p - polygon[0]).dot(v))));
        let n = self.flat.len();
        let turn = |i: usize| {
            let [a, b, c] = [i, (i + 1) % n, (i + 2) % n].map(|k| self.flat[k]);
            (b - a).perp_dot(c - b)
        };
        if (0..n).all(|i| turn(i) >= 0.0) && self.winds_once() {
            return fan(&mut triangle);
        }
        self.earcut.earcut(self.flat.iter().map(|p| p.to_array()), &[], &mut self.corners);
        for t in self.corners.as_chunks::<3>().0 {
            let [a, b, c] = t.map(|i| i as usize);
            // Ear clipping gives triangles of either winding.
            let ccw = (self.flat[b] - self.flat[a]).perp_dot(self.flat[c] - self.flat[a]) >= 0.0;
            triangle(if ccw { [a, b, c] } else { [a, c, b] });
        }
    }

    /// Test whether a polygon without right turns winds around once, unlike a star.
    fn winds_once(&self) -> bool {
        let edges = self.flat.iter().zip(self.flat.iter().cycle().skip(1)).map(|(a, b)| *b - *a);
        let upward: Vec<bool> =
            edges.filter(|e| *e != DVec2::ZERO).map(|e| e.y > 0.0 || (e.y == 0.0 && e.x > 0.0)).collect();
        let changes = upward.iter().zip(upward.iter().cycle().skip(1)).filter(|(a, b)| a != b).count();
        changes <= 2
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn area(polygon: &[DVec3], triangles: &[[usize; 3]]) -> DVec3 {
        let one = |t: &[usize; 3]| {
            let [a, b, c] = t.map(|i| polygon[i]);
            (b - a).cross(c - a)
        };
        triangles.iter().map(one).sum::<DVec3>() * 0.5
    }

    fn cut(polygon: &[DVec3]) -> Vec<[usize; 3]> {
        let mut out = Vec::new();
        Triangulator::new().triangulate(polygon, |t| out.push(t));
        out
    }

    #[test]
    fn a_concave_corner_is_not_covered() {
        // An arrow head of area 2, tilted: a fan from its first corner would cover the notch.
        let tilt = |x: f64, y: f64| DVec3::new(x, y, 2.0 * x - y);
        let arrow = [tilt(0.0, 0.0), tilt(2.0, -2.0), tilt(1.0, 0.0), tilt(2.0, 2.0)];
        let out = cut(&arrow);
        assert_eq!(out.len(), 2);
        let whole = DVec3::new(-2.0, 1.0, 1.0) * 2.0;
        assert!((area(&arrow, &out) - whole).length() < 1e-12);
        for t in &out {
            assert!(area(&arrow, std::slice::from_ref(t)).dot(whole) > 0.0, "every piece faces as the whole");
        }
    }

    #[test]
    fn what_is_no_polygon_is_harmless() {
        assert!(cut(&[DVec3::ZERO; 2]).is_empty());
        assert_eq!(cut(&[DVec3::ZERO; 5]).len(), 3);
        let star: Vec<DVec3> = (0..5)
            .map(|i| f64::from(i) * 0.8 * std::f64::consts::PI)
            .map(|a| DVec3::new(a.cos(), a.sin(), 0.0))
            .collect();
        cut(&star);
        cut(&[DVec3::NAN, DVec3::X, DVec3::Y, DVec3::Z]);
    }

    proptest! {
        #[test]
        fn areas_of_star_shaped_polygons_add_up(radii in prop::collection::vec(0.1f64..1.0, 4..40)) {
            let n = radii.len() as f64;
            let at = |(i, r): (usize, &f64)| {
                let a = i as f64 / n * std::f64::consts::TAU;
                DVec3::new(r * a.cos(), 0.0, -r * a.sin())
            };
            let polygon: Vec<DVec3> = radii.iter().enumerate().map(at).collect();
            let out = cut(&polygon);
            let exact: DVec3 = polygon.iter().zip(polygon.iter().cycle().skip(1)).map(|(a, b)| a.cross(*b) * 0.5).sum();
            prop_assert_eq!(out.len(), polygon.len() - 2);
            prop_assert!((area(&polygon, &out) - exact).length() < 1e-12);
            let sum: f64 = out.iter().map(|t| area(&polygon, std::slice::from_ref(t)).length()).sum();
            prop_assert!((sum - exact.length()).abs() < 1e-12, "pieces overlap");
        }
    }
}
