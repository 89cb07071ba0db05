//! The normals that a viewer sees in a voxel, as eight fixed points.
//!
//! Based on: E. Heitz, J. Dupuy, C. Crassin, C. Dachsbacher, *The SGGX Microflake Distribution*, SIGGRAPH 2015 (sampling of
//! visible normals). The random numbers of the paper become a cubature of the disk, so that there is no noise: two rings of
//! four points at r^2 = (1 ∓ 1/√3)/2, Gauss–Legendre in r^2, the second ring turned by 45 degrees.

use glam::Vec4;

use crate::geom::Vec3;
use crate::volume::Sggx;

/// Number of normals that stand for a voxel.
pub const POINTS: usize = 8;

/// Equally weighted unit normals, each on the viewer's side, one array per component.
#[derive(Debug, Clone, Copy)]
pub struct Normals {
    /// x components.
    pub x: [f32; POINTS],
    /// y components.
    pub y: [f32; POINTS],
    /// z components.
    pub z: [f32; POINTS],
}

/// Inner and outer radius of the rings, and their coordinates on the diagonal; heights sqrt(1 − r^2).
const INNER: f32 = 0.459_700_84;
const OUTER: f32 = 0.888_073_84;
const OUTER_DIAGONAL: f32 = 0.627_963;
const DISK_X: [f32; POINTS] =
    [INNER, 0.0, -INNER, 0.0, OUTER_DIAGONAL, -OUTER_DIAGONAL, -OUTER_DIAGONAL, OUTER_DIAGONAL];
const DISK_Y: [f32; POINTS] =
    [0.0, INNER, 0.0, -INNER, OUTER_DIAGONAL, OUTER_DIAGONAL, -OUTER_DIAGONAL, -OUTER_DIAGONAL];
const DISK_Z: [f32; POINTS] = [OUTER, OUTER, OUTER, OUTER, INNER, INNER, INNER, INNER];

/// The normals of `s` seen from the unit direction `view` (from the matter to the viewer), weighted by projected area.
#[inline(always)]
pub fn visible_normals(s: &Sggx, view: Vec3) -> Normals {
    // Relative to the largest diagonal, with enough isotropy that a facet seen edge-on still has a normal.
    const FLOOR: f32 = 1e-6;
    let largest = s.xx.max(s.yy).max(s.zz);
    let s = if largest > 0.0 { s.scaled(1.0 / largest) } else { Sggx::ISOTROPIC };
    let apply = |v: Vec3| s.mul(v) + FLOOR * v;
    // Duff et al., Building an Orthonormal Basis, Revisited, JCGT 2017.
    let sign = 1.0f32.copysign(view.z);
    let a = -1.0 / (sign + view.z);
    let b = view.x * view.y * a;
    let right = Vec3::new(1.0 + sign * view.x * view.x * a, sign * b, -sign * view.x);
    let up = Vec3::new(b, sign + view.y * view.y * a, -view.y);
    // U with U U^T = S in the frame (right, up, view), upper triangular.
    let (s_view, s_up, s_right) = (apply(view), apply(up), apply(right));
    let vv = view.dot(s_view).max(FLOOR);
    let v_inv = 1.0 / vv.sqrt();
    let (uv, rv) = (up.dot(s_view) * v_inv, right.dot(s_view) * v_inv);
    let uu = (up.dot(s_up) - uv * uv).max(FLOOR).sqrt();
    let ru = (right.dot(s_up) - rv * uv) / uu;
    let rr = (right.dot(s_right) - rv * rv - ru * ru).max(0.0).sqrt();
    // Columns of U, in world axes: a normal is their sum weighted by the disk point.
    let along_x = right * rr;
    let along_y = right * ru + up * uu;
    let along_z = s_view * v_inv;
    // Four points at a time: a loop over eight is unrolled before it could become vectors.
    let mut n = Normals { x: [0.0; POINTS], y: [0.0; POINTS], z: [0.0; POINTS] };
    for half in [0, POINTS / 2] {
        let four = |all: &[f32; POINTS]| Vec4::from_slice(&all[half..]);
        let (p, q, r) = (four(&DISK_X), four(&DISK_Y), four(&DISK_Z));
        let x = along_x.x * p + along_y.x * q + along_z.x * r;
        let y = along_x.y * p + along_y.y * q + along_z.y * r;
        let z = along_x.z * p + along_y.z * q + along_z.z * r;
        let inverse = 1.0 / (x * x + y * y + z * z).max(Vec4::splat(1e-30)).sqrt();
        (x * inverse).write_to_slice(&mut n.x[half..]);
        (y * inverse).write_to_slice(&mut n.y[half..]);
        (z * inverse).write_to_slice(&mut n.z[half..]);
    }
    n
}

/// Shares of eight normals, which sum to 1.
pub type Weights = [f32; POINTS];

/// Equal weights: facets that are seen from both sides.
pub const EQUAL: Weights = [1.0 / POINTS as f32; POINTS];

/// Below this sum all normals face away from the viewer, as where the viewer is inside the matter; they then get equal weights.
const MIN_SEEN: f32 = 1e-3;

impl Normals {
    /// Shares of the normals where facets have a front: `mean` is the unit direction of the mean area vector and
    /// `one_sidedness` in [0, 1] its length over the area. A normal m then counts (1 + k m·mean), with k such that the
    /// normals' mean becomes what was measured, and hidden back faces count 0.
    #[inline(always)]
    pub fn one_sided(&self, mean: Vec3, one_sidedness: f32) -> Weights {
        self.tilted(mean, one_sidedness).0
    }

    /// The weight of a unit normal `m` over the mean weight of all, where facets have a front: see [`Normals::one_sided`].
    pub fn one_sided_density(&self, mean: Vec3, one_sidedness: f32, m: Vec3) -> f32 {
        let (_, slope, sum) = self.tilted(mean, one_sidedness);
        if sum < MIN_SEEN { 1.0 } else { (1.0 + slope * m.dot(mean)).max(0.0) * (POINTS as f32 / sum) }
    }

    /// Weights of the normals, the slope k, and the sum of the weights before they were normalised.
    fn tilted(&self, mean: Vec3, one_sidedness: f32) -> (Weights, f32, f32) {
        let mut cosine = [0.0; POINTS];
        let mut square = 0.0;
        for (i, cosine) in cosine.iter_mut().enumerate() {
            *cosine = self.x[i] * mean.x + self.y[i] * mean.y + self.z[i] * mean.z;
            square += *cosine * *cosine * (1.0 / POINTS as f32);
        }
        // Bounded, since from k = 1/|cosine| on one side is gone altogether.
        let k = one_sidedness / square.max(0.05);
        let weight = cosine.map(|c| (1.0 + k * c).max(0.0));
        let sum: f32 = weight.iter().sum();
        (if sum < MIN_SEEN { EQUAL } else { weight.map(|w| w / sum) }, k, sum)
    }

    /// Mean of the normals, and mean of their squares: xx, yy, zz, xy, yz, zx.
    #[inline(always)]
    pub fn moments(&self, weights: &Weights) -> (Vec3, [f32; 6]) {
        let (mut mean, mut square) = (Vec3::ZERO, [0.0; 6]);
        for i in 0..POINTS {
            let (x, y, z, w) = (self.x[i], self.y[i], self.z[i], weights[i]);
            mean += w * Vec3::new(x, y, z);
            for (sum, v) in square.iter_mut().zip([x * x, y * y, z * z, x * y, y * z, z * x]) {
                *sum += w * v;
            }
        }
        (mean, square)
    }

    /// Mean of max(0, n·light): what Lambertian facets reflect towards the viewer, for a unit direction to the light.
    #[inline(always)]
    pub fn diffuse(&self, weights: &Weights, light: Vec3) -> f32 {
        let mut term = [0.0; POINTS];
        for half in [0, POINTS / 2] {
            let four = |all: &[f32; POINTS]| Vec4::from_slice(&all[half..]);
            let cosine = four(&self.x) * light.x + four(&self.y) * light.y + four(&self.z) * light.z;
            (four(weights) * cosine.max(Vec4::ZERO)).write_to_slice(&mut term[half..]);
        }
        term.iter().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn unit(v: [f32; 3]) -> Vec3 {
        Vec3::from_array(v).try_normalize().unwrap_or(Vec3::Z)
    }

    /// S = sum of squared axes.
    fn matrix(axes: [[f32; 3]; 3]) -> Sggx {
        let e = |i: usize, j: usize| axes.iter().map(|a| a[i] * a[j]).sum();
        Sggx { xx: e(0, 0), yy: e(1, 1), zz: e(2, 2), xy: e(0, 1), xz: e(0, 2), yz: e(1, 2) }
    }

    /// E[max(0, n·light)] over visible normals by brute force over D(m) max(0, m·view).
    fn integrate(s: &Sggx, view: Vec3, light: Vec3) -> f64 {
        let (xx, yy, zz) = (f64::from(s.xx), f64::from(s.yy), f64::from(s.zz));
        let (xy, xz, yz) = (f64::from(s.xy), f64::from(s.xz), f64::from(s.yz));
        let adj = [
            yy * zz - yz * yz,
            xx * zz - xz * xz,
            xx * yy - xy * xy,
            xz * yz - xy * zz,
            xy * yz - xz * yy,
            xy * xz - yz * xx,
        ];
        let (view, light) = (view.as_dvec3(), light.as_dvec3());
        let (mut sum, mut norm) = (0.0, 0.0);
        const N: usize = 200;
        for i in 0..N {
            let z = -1.0 + 2.0 * (i as f64 + 0.5) / N as f64;
            let r = (1.0 - z * z).sqrt();
            for j in 0..2 * N {
                let a = std::f64::consts::PI * (j as f64 + 0.5) / N as f64;
                let m = crate::geom::DVec3::new(r * a.cos(), r * a.sin(), z);
                let q = adj[0] * m.x * m.x
                    + adj[1] * m.y * m.y
                    + adj[2] * m.z * m.z
                    + 2.0 * (adj[3] * m.x * m.y + adj[4] * m.x * m.z + adj[5] * m.y * m.z);
                let w = m.dot(view).max(0.0) / (q * q);
                sum += w * m.dot(light).max(0.0);
                norm += w;
            }
        }
        sum / norm
    }

    #[test]
    fn one_facet_shows_its_own_normal() {
        for (n, view) in [(Vec3::Z, Vec3::new(0.6, 0.0, 0.8)), (Vec3::X, Vec3::new(-0.6, 0.8, 0.0))] {
            let normals = visible_normals(&matrix([n.into(), [0.0; 3], [0.0; 3]]), view);
            let side = n * n.dot(view).signum();
            for i in 0..POINTS {
                let m = Vec3::new(normals.x[i], normals.y[i], normals.z[i]);
                // The floor of 1e-6 in S spreads normals by about its root.
                assert!((m - side).length() < 4e-3, "{m} {side}");
            }
        }
    }

    #[test]
    fn isotropic_matter_is_a_lambertian_sphere() {
        // A sphere's mean cosine over its visible disk, lit from the viewer: 2/3; from behind: 0.
        let n = visible_normals(&Sggx::ISOTROPIC, Vec3::Y);
        assert!((n.diffuse(&EQUAL, Vec3::Y) - 2.0 / 3.0).abs() < 0.01);
        assert!(n.diffuse(&EQUAL, -Vec3::Y) < 1e-6);
    }

    #[test]
    fn a_front_is_lit_by_its_own_side() {
        let n = visible_normals(&Sggx::ISOTROPIC, Vec3::X);
        let up = n.one_sided(Vec3::Z, 0.33);
        assert!(n.diffuse(&up, Vec3::Z) > 1.5 * n.diffuse(&EQUAL, Vec3::Z));
        assert!(n.diffuse(&up, -Vec3::Z) < 0.5 * n.diffuse(&EQUAL, -Vec3::Z));
        assert_eq!(n.one_sided(Vec3::Z, 0.0), EQUAL);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn points_stand_for_the_integral(a: [i8; 9], v in prop::array::uniform3(-1.0f32..1.0), l in prop::array::uniform3(-1.0f32..1.0)) {
            let f = |i: usize| f32::from(a[i]) / 128.0;
            // At least .3 thick, so that the brute-force grid resolves the lobe.
            let s = matrix([[0.3 + f(0).abs(), f(1), f(2)], [f(3), 0.3 + f(4).abs(), f(5)], [f(6), f(7), 0.3 + f(8).abs()]]);
            let det = s.xx * (s.yy * s.zz - s.yz * s.yz) - s.xy * (s.xy * s.zz - s.yz * s.xz) + s.xz * (s.xy * s.yz - s.yy * s.xz);
            prop_assume!(det > 0.02);
            let (view, light) = (unit(v), unit(l));
            let got = f64::from(visible_normals(&s, view).diffuse(&EQUAL, light));
            // The cubature's own error: .014 RMSE on these lobes, and .071 the largest of some ten thousand.
            prop_assert!((got - integrate(&s, view, light)).abs() < 0.1, "{got}");
        }

        #[test]
        fn normals_are_unit_and_face_the_viewer(code: [u8; 6], v in prop::array::uniform3(-1.0f32..1.0)) {
            let view = unit(v);
            let n = visible_normals(&Sggx::decode(code), view);
            for i in 0..POINTS {
                let m = Vec3::new(n.x[i], n.y[i], n.z[i]);
                prop_assert!((m.length() - 1.0).abs() < 1e-4, "{m}");
                prop_assert!(m.dot(view) > -1e-4, "{m}");
            }
        }
    }
}
