//! Light by normal: what diffuse matter reflects of all that comes from around.
//!
//! Based on: R. Ramamoorthi, P. Hanrahan, *An Efficient Representation for Irradiance Environment Maps*, SIGGRAPH 2001.

use std::f64::consts::PI;
use std::iter::Sum;
use std::ops::{Add, Mul};

use crate::geom::{DMat3, DVec3, Vec3};

/// Irradiance / π as a polynomial of second degree of the normal.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Harmonics(pub [Vec3; 9]);

/// Means over normals: of 1, x, y, z, x y, y z, z x, x² − y², 3 z² − 1.
pub type Moments = [f32; 9];

fn polynomials(n: DVec3) -> [f64; 9] {
    [1.0, n.x, n.y, n.z, n.x * n.y, n.y * n.z, n.z * n.x, n.x * n.x - n.y * n.y, 3.0 * n.z * n.z - 1.0]
}

/// Of one normal.
pub fn of_normal(n: DVec3) -> Moments {
    polynomials(n).map(|v| v as f32)
}

/// Of normals whose mean and whose mean of squares (xx, yy, zz, xy, yz, zx; a trace of 1) are known, after a rotation.
pub fn of_means(mean: Vec3, square: [f32; 6], turn: &DMat3) -> Moments {
    let [xx, yy, zz, xy, yz, zx] = square.map(f64::from);
    let m = DMat3::from_cols(DVec3::new(xx, xy, zx), DVec3::new(xy, yy, yz), DVec3::new(zx, yz, zz));
    let m = *turn * m * turn.transpose();
    let n = *turn * mean.as_dvec3();
    let (x, y, z) = (m.x_axis, m.y_axis, m.z_axis);
    [1.0, n.x, n.y, n.z, x.y, y.z, z.x, x.x - y.y, 3.0 * z.z - 1.0].map(|v| v as f32)
}

impl Harmonics {
    /// Of the same radiance from everywhere.
    pub fn constant(radiance: Vec3) -> Harmonics {
        let mut all = [Vec3::ZERO; 9];
        all[0] = radiance;
        Harmonics(all)
    }

    /// Of what comes from a direction: its radiance times solid angle.
    pub fn from_direction(dir: DVec3, light: DVec3) -> Harmonics {
        // Squares of the functions' norms times the cosine's own: 1, 2/3, 1/4.
        let (flat, linear) = (0.25 / PI, 0.75 / PI * 2.0 / 3.0);
        let (mixed, apart, along) = (3.75 / PI * 0.25, 0.9375 / PI * 0.25, 0.3125 / PI * 0.25);
        let weights = [flat, linear, linear, linear, mixed, mixed, mixed, apart, along];
        let at = polynomials(dir);
        Harmonics(std::array::from_fn(|k| (weights[k] * at[k] * light).as_vec3()))
    }

    /// Irradiance / π of normals in all directions alike; at least 0.
    pub fn flat(&self) -> Vec3 {
        self.0[0].max(Vec3::ZERO)
    }

    /// Irradiance / π of normals; at least 0.
    pub fn irradiance(&self, normals: &Moments) -> Vec3 {
        let sum: Vec3 = self.0.iter().zip(normals).map(|(c, m)| *c * *m).sum();
        sum.max(Vec3::ZERO)
    }
}

impl Add for Harmonics {
    type Output = Harmonics;
    fn add(self, other: Harmonics) -> Harmonics {
        Harmonics(std::array::from_fn(|k| self.0[k] + other.0[k]))
    }
}

impl Mul<f32> for Harmonics {
    type Output = Harmonics;
    fn mul(self, factor: f32) -> Harmonics {
        Harmonics(self.0.map(|c| c * factor))
    }
}

impl Sum for Harmonics {
    fn sum<I: Iterator<Item = Harmonics>>(all: I) -> Harmonics {
        all.fold(Harmonics::default(), |a, b| a + b)
    }
}
