//! Openness of a texel: the transmittance of its own matter, by direction, from a point in it to the outside.
//!
//! Every copy of a texel has the same matter, so this is computed once for all copies: on grids in the texel's cube, finer the
//! smaller the pixels, at points where some copy is first seen.
//!
//! Based on: P.-P. Sloan, J. Kautz, J. Snyder, *Precomputed Radiance Transfer*, SIGGRAPH 2002 (visibility in low-order spherical harmonics);
//! N. Max, *Horizon Mapping*, The Visual Computer 1988.

use super::grid::two_levels;
use crate::geom::{DMat3, DVec3, Vec3};
use crate::march::transmittance::{DepthChoice, MarchSegment, MarchStats, transmittance};
use crate::render::environment_light::{SECTORS, SectorVisibility};
use crate::volume::Octree;

/// Edge of a cell, in widths of the cone that it is for.
const CELL: f64 = 5.0;
/// Coarsest level: the cube's edge is cut into 2^level cells.
const COARSEST: f64 = 4.0;
/// Finest level, and log2 of the least number of the finest voxels along a cell's edge.
const FINEST: f64 = 8.0;
const VOXELS: f64 = 1.0;
/// Width of the cones at their start, in cells, and its growth per unit of length.
const WIDTH: f64 = 0.15;
const GROWTH: f32 = 0.25;
/// A transmittance below this counts as 0.
const FAINT: f32 = 0.02;

/// A transmittance by direction, as a polynomial of second degree of the unit direction: coefficients of 1, x, y, z, x y, y z, z x,
/// x² − y², 3 z² − 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Openness(pub [f32; 9]);

/// Means of the polynomials' squares over all directions.
const MEAN_SQUARES: [f32; 9] =
    [1.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 15.0, 1.0 / 15.0, 1.0 / 15.0, 4.0 / 15.0, 4.0 / 5.0];

fn sh_basis(d: Vec3) -> [f32; 9] {
    [1.0, d.x, d.y, d.z, d.x * d.y, d.y * d.z, d.z * d.x, d.x * d.x - d.y * d.y, 3.0 * d.z * d.z - 1.0]
}

/// A rotation after which none of the directions lies near a coordinate plane, along which flat matter usually ends:
/// (2, 3, 6; 3, −6, 2; 6, 2, −3) / 7.
const ROTATION: DMat3 = DMat3::from_cols_array(&[
    2.0 / 7.0,
    3.0 / 7.0,
    6.0 / 7.0,
    3.0 / 7.0,
    -6.0 / 7.0,
    2.0 / 7.0,
    6.0 / 7.0,
    2.0 / 7.0,
    -3.0 / 7.0,
]);

/// A cubature of the sphere that is exact for polynomials up to degree 9: directions and weights (which sum to 1), the corners of a
/// rotated icosahedron and of its dual (A. McLaren, *Optimal Numerical Integration on a Sphere*, 1963).
fn directions() -> impl Iterator<Item = (Vec3, f32)> {
    let golden = 0.5 * (1.0 + 5.0f64.sqrt());
    let cyclic = |v: DVec3| [v, DVec3::new(v.z, v.x, v.y), DVec3::new(v.y, v.z, v.x)];
    let signs = |v: DVec3, weight: f64| {
        let all =
            (0..8).map(move |k| v * DVec3::from_array([0, 1, 2].map(|a| if k >> a & 1 == 0 { 1.0 } else { -1.0 })));
        // A zero component has one sign only.
        let zeros = (0..3).filter(|&a| v[a] == 0.0).map(|a| 1usize << a).sum::<usize>();
        all.enumerate()
            .filter(move |(k, _)| k & zeros == 0)
            .map(move |(_, v)| ((ROTATION * v.normalize()).as_vec3(), weight as f32))
    };
    let icosahedron = cyclic(DVec3::new(0.0, 1.0, golden)).into_iter().flat_map(move |v| signs(v, 5.0 / 168.0));
    let edges = cyclic(DVec3::new(1.0 / golden, 0.0, golden)).into_iter().flat_map(move |v| signs(v, 9.0 / 280.0));
    icosahedron.chain(edges).chain(signs(DVec3::ONE, 9.0 / 280.0))
}

impl Openness {
    /// Projection of a transmittance by direction onto the polynomials.
    pub fn project(share: impl Fn(Vec3) -> f32) -> Openness {
        let mut sum = [0.0; 9];
        for (dir, weight) in directions() {
            let value = weight * share(dir);
            for (s, p) in sum.iter_mut().zip(sh_basis(dir)) {
                *s += value * p;
            }
        }
        Openness(std::array::from_fn(|k| sum[k] / MEAN_SQUARES[k]))
    }

    /// Openness of a texel at the point `at` of texel space, at the resolution of grid cells of `size` cube edges. `around` cells on
    /// either side along each axis hold the same matter, and count too.
    pub fn measure(
        (tree, finest): (&Octree, u8),
        at: DVec3,
        size: f64,
        around: [i64; 3],
        stats: &mut MarchStats,
    ) -> Openness {
        let choice = DepthChoice { finest, ..DepthChoice::default() };
        let most = around.iter().copied().max().unwrap_or(0) as f32;
        let stats = std::cell::RefCell::new(stats);
        let axis = |k: usize| -around[k]..=around[k];
        Openness::project(|dir| {
            let mut open = 1.0;
            for cell in axis(0).flat_map(|u| axis(1).flat_map(move |v| axis(2).map(move |w| [u, v, w]))) {
                let segment = MarchSegment {
                    origin: (at - DVec3::from_array(cell.map(|c| c as f64))).as_vec3(),
                    dir,
                    // The diagonal of all the cells.
                    length: 1.733 * (1.0 + most),
                    footprint: (WIDTH * size) as f32,
                    growth: GROWTH,
                    opacity_scale: 1.0,
                };
                if open > 0.0 {
                    open *= transmittance(tree, &segment, choice, FAINT, &mut stats.borrow_mut());
                }
            }
            open
        })
    }

    pub fn add(&mut self, other: &Openness, weight: f32) {
        for (s, v) in self.0.iter_mut().zip(other.0) {
            *s += weight * v;
        }
    }

    /// Multiply the visibility of each sector by the transmittance along its unit direction in `axes`. `to_texel` takes directions to
    /// texel space; `opacity_scale` multiplies the rates.
    pub fn apply(
        &self,
        visibility: &mut SectorVisibility,
        axes: &[[f32; SECTORS]; 3],
        to_texel: &DMat3,
        opacity_scale: f32,
    ) {
        let m = to_texel.as_mat3();
        let c = &self.0;
        let [x, y, z] = axes;
        for k in 0..SECTORS {
            let row = |r: usize| m.x_axis[r] * x[k] + m.y_axis[r] * y[k] + m.z_axis[r] * z[k];
            let (u, v, w) = (row(0), row(1), row(2));
            let inverse = 1.0 / (u * u + v * v + w * w).max(f32::MIN_POSITIVE).sqrt();
            let (u, v, w) = (u * inverse, v * inverse, w * inverse);
            let open = c[0]
                + c[1] * u
                + c[2] * v
                + c[3] * w
                + c[4] * u * v
                + c[5] * v * w
                + c[6] * w * u
                + c[7] * (u * u - v * v)
                + c[8] * (3.0 * w * w - 1.0);
            let open = open.clamp(0.0, 1.0);
            visibility[k] *= if opacity_scale == 1.0 { open } else { libm::powf(open, opacity_scale) };
        }
    }
}

/// The two levels whose cells fit a cone `width` cube edges wide, with their weights, which sum to 1; `finest` is the texel's finest
/// depth.
pub fn levels(width: f64, finest: usize) -> [(i32, f64); 2] {
    let most = (finest as f64 - VOXELS).clamp(COARSEST, FINEST);
    two_levels(libm::log2(1.0 / (CELL * width).max(f64::MIN_POSITIVE)).clamp(COARSEST, most))
}

/// Edge of a cell of a level, in cube edges.
pub fn size(level: i32) -> f64 {
    libm::exp2(f64::from(-level))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::march::transmittance::tests::sparse;
    use crate::volume::{Octree, Voxel};

    #[test]
    fn the_directions_sum_up_polynomials() {
        let all: Vec<_> = directions().collect();
        assert_eq!(all.len(), 32);
        for i in 0..9 {
            for j in 0..9 {
                let mean: f32 = all.iter().map(|(d, w)| w * sh_basis(*d)[i] * sh_basis(*d)[j]).sum();
                let right = if i == j { MEAN_SQUARES[i] } else { 0.0 };
                assert!((mean - right).abs() < 1e-5, "{i} {j}: {mean} {right}");
            }
        }
    }

    #[test]
    fn a_share_of_second_degree_is_kept_and_turned() {
        let share = |d: Vec3| 0.4 + 0.2 * d.x - 0.1 * d.z + 0.3 * d.y * d.z;
        let found = Openness::project(share);
        let (sin, cos) = libm::sincos(0.7);
        let turn = DMat3::from_cols(DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0), DVec3::Z) * 5.0;
        let dirs: Vec<Vec3> = directions().map(|d| d.0).collect();
        let axes = [0, 1, 2].map(|a| std::array::from_fn(|k| dirs[k][a]));
        let mut visibility = [0.5; SECTORS];
        found.apply(&mut visibility, &axes, &turn, 1.0);
        for (dir, found) in dirs.iter().zip(visibility) {
            let right = 0.5 * share((turn * dir.as_dvec3()).normalize().as_vec3());
            assert!((found - right).abs() < 1e-5, "{dir}: {found} {right}");
        }
    }

    /// Over an opaque half of the cube half of the directions are open: 1/2 + 3/4 z, to the second degree.
    #[test]
    fn half_of_the_sky_is_open_over_a_floor() {
        let mut floor = Voxel { rate: 255, ..Voxel::default() };
        floor.set_albedo([0.5; 3]);
        let low: Vec<u64> = (0..512).filter(|&code| crate::morton::decode(code)[2] < 4).collect();
        let tree = Octree::new(sparse(3, &low, &vec![floor; low.len()], floor)).unwrap();
        let mut stats = MarchStats::default();
        let found = Openness::measure((&tree, u8::MAX), DVec3::new(0.5, 0.5, 0.52), 1.0 / 16.0, [0; 3], &mut stats).0;
        assert!(stats.segments == 32);
        // Of 32 directions, the two or three next to the horizon may be on either side of it.
        for (k, right) in [0.5, 0.0, 0.0, 0.75].into_iter().enumerate() {
            assert!((found[k] - right).abs() < 0.1, "{k}: {found:?}");
        }
    }

    /// Matter that goes on in the cells around is as deep next to a border as it is in the middle.
    #[test]
    fn cells_of_cyclic_texels_have_no_borders() {
        let voxel = Voxel { rate: crate::volume::voxel::encode_rate(1.0), ..Voxel::default() };
        let tree = Octree::new(sparse(3, &(0..512).collect::<Vec<_>>(), &vec![voxel; 512], voxel)).unwrap();
        let sum = |x: f64, around| {
            let at = DVec3::new(x, 0.5, 0.9);
            Openness::measure((&tree, u8::MAX), at, 1.0 / 16.0, around, &mut MarchStats::default()).0[0]
        };
        let [middle, border] = [0.5, 0.05].map(|x| sum(x, [1, 1, 0]));
        assert!((middle - border).abs() < 0.01, "{middle} {border}");
        assert!(sum(0.05, [0; 3]) > border + 0.05);
    }
}
