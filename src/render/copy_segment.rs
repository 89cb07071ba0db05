//! A straight segment of a ray in one copy of a texel: what every way of finding copies comes to.

use super::cells::CopyHit;
use super::phong::SurfaceCoords;
use crate::geom::{DMat3, DVec3, Vec3};
use crate::march::transmittance::MarchSegment;

/// A straight segment of a ray in one copy, ready to be marched.
#[derive(Clone)]
pub struct CopySegment {
    pub hit: CopyHit,
    pub march: MarchSegment,
    /// World → texel, the linear part.
    pub to_texel: DMat3,
    /// Cube edges per unit of length across the ray.
    pub scale: f64,
    /// See [`super::cells::TexelLayer::rank`].
    pub rank: u32,
    /// Its number in [`super::affine::AffineCopies`]; `None` for a copy that is not there.
    pub affine: Option<u32>,
    /// Where what it makes of surfaces varies.
    pub coords: Option<Box<SurfaceCoords>>,
}

/// To f32, so that what is inside of a cube's upper faces stays so: a ray along one lies in one cube only.
pub fn round_inside(origin: DVec3) -> Vec3 {
    let rounded = origin.as_vec3();
    Vec3::select(rounded.cmpeq(Vec3::ONE) & origin.cmplt(DVec3::ONE), Vec3::splat(1.0f32.next_down()), rounded)
}
