//! Directions in which the sky is looked for: eight cones of equal weight, each with four rays spread over it.
//!
//! A cone through a texel is prefiltered, but a mesh is met by rays. Tests against a wall of any height, length and
//! distance, seen from the ground (root mean square and largest error of the share that is open): the corners of a turned
//! cube, weighted by the cosine, .126 and .34, and .05 too dark in the mean, since none of them is near the zenith; eight
//! rays that share the cosine .063 and .23; four rays in each of these cones .024 and .09.

use std::f64::consts::TAU;
use std::sync::LazyLock;

use crate::geom::{DMat3, DVec3};

/// A part of the directions.
#[derive(Debug, Clone, Copy)]
pub struct SkyCone {
    /// Unit.
    pub axis: DVec3,
    /// Unit, spread evenly over the part.
    pub rays: [DVec3; 4],
}

impl SkyCone {
    fn turned(&self, turn: DMat3) -> SkyCone {
        SkyCone { axis: turn * self.axis, rays: self.rays.map(|ray| turn * ray) }
    }
}

/// The half of the directions around +z in parts of equal weight by the cosine: three about the pole, five below.
static HALF: LazyLock<[SkyCone; 8]> = LazyLock::new(|| {
    std::array::from_fn(|k| {
        // Equal weights are equal areas of the unit disc below; `u` is the square of the distance from its middle.
        let (u0, u1, count, first) = if k < 3 { (0.0, 0.375, 3.0, 0.0) } else { (0.375, 1.0, 5.0, 0.5) };
        let sector = if k < 3 { k as f64 } else { k as f64 - 3.0 };
        let at = |i: f64, j: f64| {
            let u: f64 = u0 + (u1 - u0) * i;
            let (sin, cos) = libm::sincos(TAU * (sector + first + j) / count);
            DVec3::new(u.sqrt() * cos, u.sqrt() * sin, (1.0 - u).sqrt())
        };
        SkyCone {
            axis: at(0.5, 0.5),
            rays: [(0.25, 0.25), (0.25, 0.75), (0.75, 0.25), (0.75, 0.75)].map(|(i, j)| at(i, j)),
        }
    })
});

/// All directions in parts of equal size: the octants, turned so that none is about an axis.
static ALL: LazyLock<[SkyCone; 8]> = LazyLock::new(|| {
    let (sin_y, cos_y) = libm::sincos(0.39);
    let (sin_x, cos_x) = libm::sincos(0.23);
    let about_y = DMat3::from_cols_array(&[cos_y, 0.0, -sin_y, 0.0, 1.0, 0.0, sin_y, 0.0, cos_y]);
    let about_x = DMat3::from_cols_array(&[1.0, 0.0, 0.0, 0.0, cos_x, sin_x, 0.0, -sin_x, cos_x]);
    let turn = about_y * about_x;
    std::array::from_fn(|k| {
        let sign = |bit: usize| if k >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let at = |x: f64, y: f64, z: f64| turn * DVec3::new(sign(0) * x, sign(1) * y, sign(2) * z).normalize();
        // Middles of the four triangles that an octant's flat triangle is cut into.
        let rays = [at(1.0, 1.0, 1.0), at(4.0, 1.0, 1.0), at(1.0, 4.0, 1.0), at(1.0, 1.0, 4.0)];
        SkyCone { axis: rays[0], rays }
    })
});

/// Cones of equal weight over the directions about a unit normal, by the cosine; over all directions without one.
pub fn sky_cones(normal: Option<DVec3>) -> [SkyCone; 8] {
    let Some(normal) = normal else { return *ALL };
    let (tangent, other) = normal.any_orthonormal_pair();
    let turn = DMat3::from_cols(tangent, other, normal);
    HALF.map(|cone| cone.turned(turn))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_even() {
        let rays = |normal| sky_cones(normal).into_iter().flat_map(|cone| cone.rays);
        let sum: DVec3 = rays(None).sum();
        assert!(sum.length() < 1e-12 && rays(None).all(|ray| (ray.length() - 1.0).abs() < 1e-12));
        let normal = DVec3::new(0.3, -0.5, 0.2).normalize();
        let mean = rays(Some(normal)).sum::<DVec3>() / 32.0;
        // The mean direction under the cosine: 2/3 along the normal. Four values of a root, by the midpoint rule.
        assert!((mean - mean.dot(normal) * normal).length() < 1e-12);
        assert!((mean.dot(normal) - 2.0 / 3.0).abs() < 0.01, "{}", mean.dot(normal));
    }

    /// The share of the sky that a wall hides from a point on the ground, against its form factor: for a wall of height h
    /// and length 2 l at distance d, whose middle is the nearest, (atan(l/d) − d/r atan(l/r)) / π with r² = d² + h².
    #[test]
    fn a_finite_wall_hides_its_form_factor() {
        let (mut square, mut sum, mut worst, mut count) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
        for (d, h, l) in [0.2f64, 0.5, 1.0, 2.0].into_iter().flat_map(|d| {
            [0.3f64, 1.0, 3.0].into_iter().flat_map(move |h| [0.5f64, 1.5, 5.0].into_iter().map(move |l| (d, h, l)))
        }) {
            let r = f64::hypot(d, h);
            let right = ((l / d).atan() - d / r * (l / r).atan()) / std::f64::consts::PI;
            for turn in 0..12 {
                let towards = DMat3::from_rotation_y(f64::from(turn) * 0.5) * DVec3::X;
                let hidden = |ray: DVec3| {
                    let t = d / ray.dot(towards);
                    let p = t * ray;
                    t > 0.0 && p.y <= h && p.dot(towards.cross(DVec3::Y)).abs() <= l
                };
                let cones = sky_cones(Some(DVec3::Y));
                let found = cones.iter().flat_map(|cone| cone.rays).filter(|&ray| hidden(ray)).count() as f64 / 32.0;
                let error = found - right;
                (square, sum, worst, count) =
                    (square + error * error, sum + error, worst.max(error.abs()), count + 1.0);
            }
        }
        let (rms, mean): (f64, f64) = ((square / count).sqrt(), sum / count);
        // 32 rays: a share is told to a thirty-second, or three where an edge runs along them.
        assert!(rms < 0.035 && mean.abs() < 0.015 && worst < 0.1, "{rms} {mean} {worst}");
    }
}
