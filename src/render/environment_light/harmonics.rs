//! Irradiance as a function of the normal, in spherical harmonics up to degree 2.
//!
//! Based on: R. Ramamoorthi, P. Hanrahan, *An Efficient Representation for Irradiance Environment Maps*, SIGGRAPH 2001.

use std::f64::consts::PI;
use std::iter::Sum;
use std::ops::{Add, Mul};

use crate::geom::{DMat3, DVec3, Vec3};

/// Irradiance / π, linear Rec. 709, as a polynomial of second degree of the normal: one coefficient per basis function, in the order
/// of [`Moments`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct IrradianceHarmonics(pub [Vec3; 9]);

/// Means over normals of the basis functions 1, x, y, z, x y, y z, z x, x² − y², 3 z² − 1.
pub type Moments = [f32; 9];

fn sh_basis(n: DVec3) -> [f64; 9] {
    [1.0, n.x, n.y, n.z, n.x * n.y, n.y * n.z, n.z * n.x, n.x * n.x - n.y * n.y, 3.0 * n.z * n.z - 1.0]
}

/// Moments of one unit normal.
pub fn moments_of_normal(n: DVec3) -> Moments {
    sh_basis(n).map(|v| v as f32)
}

/// Moments of a distribution of unit normals after the rotation `turn`, from its mean and its second moments `square` (xx, yy, zz,
/// xy, yz, zx; xx + yy + zz = 1).
pub fn moments_of_means(mean: Vec3, square: [f32; 6], turn: &DMat3) -> Moments {
    let [xx, yy, zz, xy, yz, zx] = square.map(f64::from);
    let m = DMat3::from_cols(DVec3::new(xx, xy, zx), DVec3::new(xy, yy, yz), DVec3::new(zx, yz, zz));
    let m = *turn * m * turn.transpose();
    let n = *turn * mean.as_dvec3();
    let (x, y, z) = (m.x_axis, m.y_axis, m.z_axis);
    [1.0, n.x, n.y, n.z, x.y, y.z, z.x, x.x - y.y, 3.0 * z.z - 1.0].map(|v| v as f32)
}

impl IrradianceHarmonics {
    /// Irradiance under the same radiance from all directions.
    pub fn constant(radiance: Vec3) -> IrradianceHarmonics {
        let mut all = [Vec3::ZERO; 9];
        all[0] = radiance;
        IrradianceHarmonics(all)
    }

    /// Irradiance by light from one unit direction; `light` is its radiance times solid angle.
    pub fn from_direction(dir: DVec3, light: DVec3) -> IrradianceHarmonics {
        // One over the squared norm of each function, times the cosine lobe's coefficient of its degree: 1, 2/3, 1/4.
        let (flat, linear) = (0.25 / PI, 0.75 / PI * 2.0 / 3.0);
        let (mixed, apart, along) = (3.75 / PI * 0.25, 0.9375 / PI * 0.25, 0.3125 / PI * 0.25);
        let weights = [flat, linear, linear, linear, mixed, mixed, mixed, apart, along];
        let at = sh_basis(dir);
        IrradianceHarmonics(std::array::from_fn(|k| (weights[k] * at[k] * light).as_vec3()))
    }

    /// Irradiance / π averaged over all normals; at least 0.
    pub fn mean_irradiance(&self) -> Vec3 {
        self.0[0].max(Vec3::ZERO)
    }

    /// Irradiance / π averaged over normals with these moments; at least 0.
    pub fn irradiance(&self, normals: &Moments) -> Vec3 {
        let sum: Vec3 = self.0.iter().zip(normals).map(|(c, m)| *c * *m).sum();
        sum.max(Vec3::ZERO)
    }
}

impl Add for IrradianceHarmonics {
    type Output = IrradianceHarmonics;
    fn add(self, other: IrradianceHarmonics) -> IrradianceHarmonics {
        IrradianceHarmonics(std::array::from_fn(|k| self.0[k] + other.0[k]))
    }
}

impl Mul<f32> for IrradianceHarmonics {
    type Output = IrradianceHarmonics;
    fn mul(self, factor: f32) -> IrradianceHarmonics {
        IrradianceHarmonics(self.0.map(|c| c * factor))
    }
}

impl Sum for IrradianceHarmonics {
    fn sum<I: Iterator<Item = IrradianceHarmonics>>(all: I) -> IrradianceHarmonics {
        all.fold(IrradianceHarmonics::default(), |a, b| a + b)
    }
}
