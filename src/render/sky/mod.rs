//! Ambient light: the light of the environment at a point, past what occludes it.
//!
//! Occluders are of three kinds, each treated where that is cheapest. A copy's own matter is the same for all copies of its texel:
//! see [`openness`]. What other things hide changes little over a copy, and is computed at one or a few points of it: see
//! [`copies`]. At surfaces that belong to no copy all occluders are treated together, on the surface: see [`surface`].
//!
//! All are computed at points that do not depend on the picture's frame, cached in [`cache`], and interpolated.

mod cache;
mod cones;
mod copies;
mod grid;
mod openness;
mod packed_visibility;
pub mod store;
mod surface;

use super::copy_segment::CopySegment;
use super::environment_light::IrradianceHarmonics;
use super::options::Ambient;
use super::pixel::Tracer;
use crate::geom::DVec3;

/// A point in a copy of a texel.
#[derive(Clone, Copy)]
pub struct PointInCopy<'a> {
    pub segment: &'a CopySegment,
    /// Distance along the ray that met the copy.
    pub t: f64,
}

impl Tracer<'_> {
    /// Ambient light on matter at `x`. `outward` is the mean of its visible normals, at most of length 1; `width` is that of the
    /// cone that sees it, and `copy` its place in a copy, if it is in one.
    pub(super) fn sky_light(
        &mut self,
        x: DVec3,
        outward: DVec3,
        width: f64,
        copy: Option<PointInCopy<'_>>,
    ) -> IrradianceHarmonics {
        let environment = &self.world.environment;
        if self.options.ambient == Ambient::Constant {
            return environment.light;
        }
        let visibility = match copy {
            Some(copy) => self.sky_visibility_in_copy(x, outward, width, copy),
            None => self.sky_visibility_on_surface(x, outward, width),
        };
        visibility.map_or(environment.light, |visibility| environment.sectors.light(&visibility))
    }

    /// Ambient light on the side that faces away from the viewer; `front` is the light on the visible side. Matter with normals in
    /// all directions has no sides, and gets the same light on both.
    pub(super) fn sky_light_behind(
        &mut self,
        front: IrradianceHarmonics,
        x: DVec3,
        outward: DVec3,
        width: f64,
        copy: Option<PointInCopy<'_>>,
    ) -> IrradianceHarmonics {
        let sided = copy.is_none() || copies::self_occlusion_offset(outward) > 0.0;
        if sided { self.sky_light(x, -outward, width, copy) } else { front }
    }

    /// Added to the depth that fits a cone towards the sky.
    fn sky_bias(&self) -> f32 {
        (self.options.depth_bias + self.options.shadow_bias) as f32
    }
}
