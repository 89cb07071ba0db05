//! A straight segment of a ray in one copy of a texel. Affine copies and shells' cells both produce these, and the march reads them.

use super::cells::CopyHit;
use super::phong::SurfaceCoords;
use crate::geom::{DMat3, DVec3, Vec3};
use crate::march::transmittance::MarchSegment;

/// A straight segment of a ray in one copy, ready to be marched.
#[derive(Clone)]
pub struct CopySegment {
    pub hit: CopyHit,
    pub march: MarchSegment,
    /// Linear part of the map from the renderer's space to texel space.
    pub to_texel: DMat3,
    /// Cube edges per unit of length across the ray.
    pub scale: f64,
    /// See [`super::cells::TexelLayer::rank`].
    pub rank: u32,
    /// Its number in [`super::affine::AffineCopies`]; `None` for copies in cells.
    pub affine: Option<u32>,
    /// Texel coordinates along the segment, where the copy's Phong parameters vary from place to place.
    pub coords: Option<Box<SurfaceCoords>>,
}

/// Round to f32, but keep points that lie below a cube's upper faces below them, so that a ray along such a face is in one cube only.
pub fn round_inside(origin: DVec3) -> Vec3 {
    let rounded = origin.as_vec3();
    Vec3::select(rounded.cmpeq(Vec3::ONE) & origin.cmplt(DVec3::ONE), Vec3::splat(1.0f32.next_down()), rounded)
}
