//! What a place sees of each part of the sky, past land and texels.
//!
//! Based on: C. Crassin et al., *Interactive Indirect Illumination Using Voxel Cone Tracing*, Pacific Graphics 2011.

use super::shares::SmallShares;
use crate::geom::{DVec3, Ray};
use crate::march::transmittance::DepthChoice;
use crate::render::prepare::World;
use crate::render::shadow::{LeftOut, ShadowCone, ShadowQuality};
use crate::render::stats::Counts;
use crate::render::surround::{PARTS, Part};

/// Light that is less than this share of what comes from a part of the sky is left out.
const FAINT: f32 = 0.05;

/// The share of the light from each part of the sky that comes to `x` by cones `width` wide at their start.
pub fn shares_at(
    world: &World<'_>,
    x: DVec3,
    width: f64,
    left_out: Option<LeftOut>,
    bias: f32,
) -> (SmallShares, Counts) {
    let mut counts = Counts::default();
    let choice = DepthChoice { bias, lod_dither: 0.5, finest: u8::MAX };
    let quality = ShadowQuality { choice, stop_below: FAINT, source_geometry: false, left_out };
    let mut share = |part: &Part| {
        let towards = |dir: DVec3| ShadowCone {
            ray: Ray { origin: x, dir },
            end: f64::INFINITY,
            start: None,
            width,
            growth: part.growth,
        };
        let rays = part.rays.iter().map(|&dir| towards(dir).mesh_transmittance(world));
        let through = rays.sum::<f32>() / part.rays.len() as f32;
        counts.sky_cones += 1;
        towards(part.axis).transmittance(world, through, quality, &mut counts)
    };
    let mut shares = [0.0; PARTS];
    for (value, part) in shares.iter_mut().zip(&world.surround.parts.list) {
        *value = share(part);
    }
    (SmallShares::new(shares), counts)
}

/// A corner that lies a little below the ground sees nothing, and yet is one of those around what stands on it: the place
/// right above it then, where there is nothing below.
pub fn out_of_the_ground(world: &World<'_>, x: DVec3, size: f64) -> DVec3 {
    if world.mesh.is_empty() {
        return x;
    }
    let reach = 2.0 * size;
    let mut blended = Vec::new();
    let mut meets = |dir: DVec3| {
        let ray = Ray { origin: x, dir };
        world.mesh.nearest(&world.scene.model, &ray, reach, |_| 0.0, &mut blended).map(|contact| contact.t)
    };
    match meets(DVec3::Y) {
        Some(t) if meets(DVec3::NEG_Y).is_none() => x + (t + 0.05 * size) * DVec3::Y,
        _ => x,
    }
}
