//! The sun.

use crate::geom::DVec3;

/// A sun.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sun {
    /// Unit direction from the scene to the sun.
    pub towards: DVec3,
    /// Irradiance on a surface that faces it, linear Rec. 709.
    pub irradiance: DVec3,
    /// Half of its angular size, radians.
    pub radius: f64,
}
