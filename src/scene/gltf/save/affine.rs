//! Decomposition of affine maps for glTF nodes: a translation, a rotation and a scale, or two nested nodes where there is shear.
//!
//! Based on: G. Golub, C. Van Loan, *Matrix Computations*, 8.5 (Jacobi's method); the singular value decomposition.

use glam::DQuat;
use serde_json::{Value, json};

use crate::geom::{DAffine3, DMat3, DVec3};

/// The transform of one node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trs {
    pub translation: DVec3,
    pub rotation: DQuat,
    pub scale: DVec3,
}

/// An affine map as one or two nodes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Placement {
    Rigid(Trs),
    /// The outer node, and the rotation of the one in it.
    Sheared(Trs, DQuat),
}

/// Cosine of the angle between two axes above which there is shear: some roundings of 32-bit numbers.
const SQUARE: f64 = 1e-6;

impl Trs {
    pub fn json(&self) -> Value {
        json!({"translation": self.translation.to_array(), "rotation": self.rotation.normalize().to_array(),
            "scale": self.scale.to_array()})
    }
}

/// `None` where the map is flat, or not finite.
pub fn placement(map: &DAffine3) -> Option<Placement> {
    let (m, translation) = (map.matrix3, map.translation);
    if !map.is_finite() || m.determinant() == 0.0 {
        return None;
    }
    // A mirroring map is a rotation after the first axis is mirrored.
    let sign = m.determinant().signum();
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
    let scale = DVec3::new(x.length(), y.length(), z.length());
    let axes = DMat3::from_cols(x / (sign * scale.x), y / scale.y, z / scale.z);
    let skew = axes
        .x_axis
        .dot(axes.y_axis)
        .abs()
        .max(axes.y_axis.dot(axes.z_axis).abs())
        .max(axes.z_axis.dot(axes.x_axis).abs());
    if skew <= SQUARE {
        let scale = DVec3::new(sign * scale.x, scale.y, scale.z);
        return Some(Placement::Rigid(Trs { translation, rotation: DQuat::from_mat3(&axes), scale }));
    }
    let (squares, mut right) = eigen(m.transpose() * m);
    if right.determinant() < 0.0 {
        right.x_axis = -right.x_axis;
    }
    let sizes = squares.map(|s| s.max(0.0).sqrt());
    let turned = m * right;
    let left = DMat3::from_cols(turned.x_axis / (sign * sizes.x), turned.y_axis / sizes.y, turned.z_axis / sizes.z);
    let outer =
        Trs { translation, rotation: DQuat::from_mat3(&left), scale: DVec3::new(sign * sizes.x, sizes.y, sizes.z) };
    let inner = DQuat::from_mat3(&right.transpose());
    (left.is_finite() && sizes.min_element() > 0.0).then_some(Placement::Sheared(outer, inner))
}

/// Eigenvalues and eigenvectors (columns) of a symmetric matrix.
fn eigen(mut a: DMat3) -> (DVec3, DMat3) {
    let mut vectors = DMat3::IDENTITY;
    // Converges quadratically; six sweeps are more than doubles can tell apart.
    for _ in 0..6 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (app, aqq, apq) = (a.col(p)[p], a.col(q)[q], a.col(q)[p]);
            if apq == 0.0 {
                continue;
            }
            let theta = (aqq - app) / (2.0 * apq);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            let mut turn = DMat3::IDENTITY;
            (turn.col_mut(p)[p], turn.col_mut(q)[q]) = (c, c);
            (turn.col_mut(q)[p], turn.col_mut(p)[q]) = (s, -s);
            a = turn.transpose() * a * turn;
            vectors *= turn;
        }
    }
    (DVec3::new(a.x_axis.x, a.y_axis.y, a.z_axis.z), vectors)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn matrix(of: &Placement) -> DAffine3 {
        let trs = |t: &Trs| DAffine3::from_scale_rotation_translation(t.scale, t.rotation, t.translation);
        match of {
            Placement::Rigid(t) => trs(t),
            Placement::Sheared(t, inner) => trs(t) * DAffine3::from_quat(*inner),
        }
    }

    #[test]
    fn maps_are_what_their_nodes_say() {
        let turn = DMat3::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0);
        let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.6, 1.0, 0.1), DVec3::new(-0.2, 0.3, 1.4));
        let cases = [
            (turn, false),
            (turn * DMat3::from_diagonal(DVec3::new(0.3, 2.0, 5.0)), false),
            (turn * DMat3::from_diagonal(DVec3::new(-0.3, 2.0, 5.0)), false),
            (DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0)), false),
            (shear, true),
            (turn * shear * turn, true),
            (turn * shear * DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0)), true),
            (DMat3::from_diagonal(DVec3::new(1.0, 2.0, 3.0)) * turn, true),
        ];
        for (i, (matrix3, sheared)) in cases.into_iter().enumerate() {
            let map = DAffine3 { matrix3, translation: DVec3::new(1.0, -2.0, 3.0) };
            let found = placement(&map).unwrap();
            assert_eq!(matches!(found, Placement::Sheared(..)), sheared, "{i}");
            // Numbers of at most 5, some dozens of roundings.
            assert!(matrix(&found).abs_diff_eq(map, 1e-12), "{i}: {:?} {map:?}", matrix(&found));
        }
        assert_eq!(placement(&DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0))), None);
    }
}
