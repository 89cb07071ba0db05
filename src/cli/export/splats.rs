//! A texel as Gaussian splats, one for each voxel.
//!
//! E. Heitz, J. Dupuy, C. Crassin, C. Dachsbacher, *The SGGX Microflake Distribution*, SIGGRAPH 2015: the ellipsoid whose
//! projected areas are a voxel's.
//!
//! An ellipsoid with the half axes a₁, a₂, a₃ has, along its first axis, the projected area π a₂ a₃. A voxel's areas along
//! the axes of its SGGX matrix are s₁, s₂, s₃. So a₁ ∝ √(s₂ s₃ / s₁), and a Gaussian of those deviations casts the voxel's
//! shadow from every side, up to one factor, which the opacity takes.

use glam::{DMat3, DQuat, DVec3};

use super::voxels::Voxels;
use crate::volume::Sggx;
use crate::volume::cells::Cell;

/// Zeroth coefficient of real spherical harmonics.
const SH_0: f64 = 0.282_094_791_773_878_14;
/// Flattest splat: its thinnest axis over its longest.
const FLATTEST: f64 = 0.05;
/// Greatest opacity in the middle of a splat: what the file keeps is its logit.
const MAX_OPAQUE: f64 = 0.995;

/// One splat, in the copy's own space.
pub struct Splat {
    /// Metres.
    pub centre: DVec3,
    /// Standard deviations along its axes, metres.
    pub deviations: DVec3,
    /// From its axes to the copy's own.
    pub turn: DQuat,
    /// In the middle, in (0, 1).
    pub opacity: f64,
    /// Linear.
    pub albedo: DVec3,
}

impl Splat {
    /// Coefficient of degree 0 of the colour, red, green, blue: files of splats hold colours as a screen shows them.
    pub fn harmonic(&self) -> [f64; 3] {
        self.albedo.to_array().map(|c| (screen(c) - 0.5) / SH_0)
    }
}

/// The splats of a depth; what takes less than 1/255 of the light has none.
pub fn of(voxels: &Voxels) -> Vec<Splat> {
    voxels.cells.iter().filter_map(|cell| splat(voxels, cell)).collect()
}

/// Linear → sRGB, both in [0, 1].
fn screen(c: f64) -> f64 {
    if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * libm::pow(c, 1.0 / 2.4) - 0.055 }
}

fn splat(voxels: &Voxels, cell: &Cell) -> Option<Splat> {
    let (low, high) = cell.support(voxels.resolution);
    let size = high - low;
    let opacity = cell.opacity();
    if opacity <= 1.0 / 255.0 {
        return None;
    }
    let (areas, axes) = eigen(&Sggx::decode(cell.voxel.ndf));
    let roots = areas.to_array().map(|area| area.max(0.0).sqrt().max(1e-3));
    let raw = DVec3::new(
        (roots[1] * roots[2] / roots[0]).sqrt(),
        (roots[2] * roots[0] / roots[1]).sqrt(),
        (roots[0] * roots[1] / roots[2]).sqrt(),
    );
    let raw = raw.max(DVec3::splat(raw.max_element() * FLATTEST));
    // As wide as matter that fills the box evenly, whose deviation is its edge over √12: the mean of the squares agrees.
    let spread = (size.dot(size) / 12.0 / raw.dot(raw)).sqrt();
    let mut deviations = raw * spread;
    // What it takes of the light, over the three axes: ∫ opacity · Gauss = 2π σ σ' opacity, against the box's share.
    let mean = |v: DVec3| (v.y * v.z + v.z * v.x + v.x * v.y) / 3.0;
    let wanted = opacity * mean(size);
    let mut peak = wanted / (std::f64::consts::TAU * mean(deviations));
    if peak > MAX_OPAQUE {
        deviations *= (peak / MAX_OPAQUE).sqrt();
        peak = MAX_OPAQUE;
    }
    // Both maps are turns and one scale, so that axes stay at right angles.
    let scale = voxels.to_own.matrix3.x_axis.length();
    let turn = voxels.to_own.matrix3 * (1.0 / scale) * axes;
    let turn = if turn.determinant() < 0.0 { turn * DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)) } else { turn };
    Some(Splat {
        centre: voxels.to_own.transform_point3((low + high) / 2.0),
        deviations: deviations * scale,
        turn: DQuat::from_mat3(&turn).normalize(),
        opacity: peak,
        albedo: cell.voxel.albedo().as_dvec3(),
    })
}

/// Eigenvalues and eigenvectors (columns) of a symmetric matrix, by Jacobi's turns.
fn eigen(s: &Sggx) -> (DVec3, DMat3) {
    let [xx, yy, zz, xy, xz, yz] = [s.xx, s.yy, s.zz, s.xy, s.xz, s.yz].map(f64::from);
    let mut matrix = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    // Each sweep squares the error; six are more than 64 bits can tell.
    for (p, q) in [(0, 1), (0, 2), (1, 2)].into_iter().cycle().take(18) {
        if matrix[p][q] == 0.0 {
            continue;
        }
        let theta = (matrix[q][q] - matrix[p][p]) / (2.0 * matrix[p][q]);
        let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
        let c = 1.0 / (t * t + 1.0).sqrt();
        let s = t * c;
        for row in &mut matrix {
            (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
        }
        for k in 0..3 {
            (matrix[p][k], matrix[q][k]) = (c * matrix[p][k] - s * matrix[q][k], s * matrix[p][k] + c * matrix[q][k]);
        }
        for row in &mut axes {
            (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
        }
    }
    let axes = DMat3::from_cols_array_2d(&axes).transpose();
    (DVec3::new(matrix[0][0], matrix[1][1], matrix[2][2]), axes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvectors_rebuild_the_matrix() {
        let s = Sggx { xx: 0.9, yy: 0.4, zz: 0.2, xy: 0.3, xz: -0.1, yz: 0.05 };
        let (values, axes) = eigen(&s);
        let back = axes * DMat3::from_diagonal(values) * axes.transpose();
        let want = [[0.9, 0.3, -0.1], [0.3, 0.4, 0.05], [-0.1, 0.05, 0.2]];
        for (j, row) in want.iter().enumerate() {
            for (k, w) in row.iter().enumerate() {
                // The matrix is of 32 bits.
                assert!((back.col(k)[j] - w).abs() < 1e-7, "{back}");
            }
        }
        assert!((axes.determinant().abs() - 1.0).abs() < 1e-12);
    }
}
