//! The sun.

use crate::geom::DVec3;

/// A sun: unit direction towards it, irradiance on what faces it, half of its angular size in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sun {
    pub towards: DVec3,
    pub irradiance: DVec3,
    pub radius: f64,
}
