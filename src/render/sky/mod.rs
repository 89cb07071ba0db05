//! Light from all around on a place, past what stands between.
//!
//! What stands between is of three kinds, each found where that is cheapest. A copy's own matter is the same for all copies
//! of its texel: see [`openness`]. What else a copy sees changes little over it, and is found at one or a few of its places:
//! see [`copies`]. On what is no copy, both are found together, on the surface: see [`surface`].
//!
//! All are found at places that do not depend on the picture's frame, kept in [`cache`], and interpolated.

mod cache;
mod cones;
mod copies;
mod grid;
mod openness;
mod shares;
pub mod store;
mod surface;

use super::copy_segment::CopySegment;
use super::options::Ambient;
use super::pixel::Tracer;
use super::surround::Harmonics;
use crate::geom::DVec3;

/// A place in a copy of a texel.
#[derive(Clone, Copy)]
pub struct InCopy<'a> {
    pub segment: &'a CopySegment,
    /// Along the ray that met the copy.
    pub t: f64,
}

impl Tracer<'_> {
    /// Light from around on matter at `x`. `outward`: the mean of its normals that are seen, at most of length 1; `width`: of the
    /// cone that sees it; `copy`: where that is in a copy, if it is.
    pub(super) fn sky_light(&mut self, x: DVec3, outward: DVec3, width: f64, copy: Option<InCopy<'_>>) -> Harmonics {
        let surround = &self.world.surround;
        if self.options.ambient == Ambient::Constant {
            return surround.light;
        }
        let shares = match copy {
            Some(copy) => self.shares_in_copy(x, outward, width, copy),
            None => self.shares_on_surface(x, outward, width),
        };
        shares.map_or(surround.light, |shares| surround.parts.light(&shares))
    }

    /// The same on the side that is not seen, where `front` is the light on the other: matter with normals in all directions
    /// has no sides.
    pub(super) fn sky_light_behind(
        &mut self,
        front: Harmonics,
        x: DVec3,
        outward: DVec3,
        width: f64,
        copy: Option<InCopy<'_>>,
    ) -> Harmonics {
        let sided = copy.is_none() || copies::lift(outward) > 0.0;
        if sided { self.sky_light(x, -outward, width, copy) } else { front }
    }

    /// What is added to the depth that fits a cone towards the sky.
    fn sky_bias(&self) -> f32 {
        (self.options.depth_bias + self.options.shadow_bias) as f32
    }
}
