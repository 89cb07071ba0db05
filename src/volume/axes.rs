//! How the axes of a source, of a texel (u, v, w, of which w is up) and of a scene (+Y up) lie to each other.

use crate::geom::{DMat3, DVec3};

/// Rotate a vector of a source, whose axis `up` points up (0 x, 1 y, 2 z), to the axes u, v, w. No coordinate is rounded.
pub fn to_uvw(up: u8, p: DVec3) -> DVec3 {
    match up {
        0 => DVec3::new(p.y, p.z, p.x),
        1 => DVec3::new(p.x, -p.z, p.y),
        _ => p,
    }
}

/// [`to_uvw`] as a matrix.
pub fn source_to_uvw(up: u8) -> DMat3 {
    DMat3::from_cols(to_uvw(up, DVec3::X), to_uvw(up, DVec3::Y), to_uvw(up, DVec3::Z))
}

/// The rotation of u, v, w to the axes of a scene: (u, w, −v).
pub const UVW_TO_SCENE: DMat3 = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn up_becomes_w_and_then_y_and_nothing_is_mirrored() {
        for (up, axis) in [(0, DVec3::X), (1, DVec3::Y), (2, DVec3::Z)] {
            let turn = source_to_uvw(up);
            assert_eq!((turn * axis, turn.determinant()), (DVec3::Z, 1.0), "{up}");
            assert_eq!(UVW_TO_SCENE * (turn * axis), DVec3::Y, "{up}");
            let p = DVec3::new(1.0, 2.0, 3.0);
            assert_eq!(turn * p, to_uvw(up, p), "{up}");
        }
        // A source that stands as scenes do is not turned.
        assert_eq!(UVW_TO_SCENE * source_to_uvw(1), DMat3::IDENTITY);
        // As other programs turn what has z up: (x, z, −y).
        assert_eq!(UVW_TO_SCENE * source_to_uvw(2) * DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 3.0, -2.0));
    }
}
