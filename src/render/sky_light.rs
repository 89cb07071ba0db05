//! How much light comes from around to a place, where land and texels stand before it.
//!
//! Based on: C. Crassin et al., *Interactive Indirect Illumination Using Voxel Cone Tracing*, Pacific Graphics 2011. What was
//! found is kept and interpolated, see [`super::sky_cache`].

use super::options::Ambient;
use super::pixel::Tracer;
use super::prepare::World;
use super::shadow::{ShadowCone, ShadowQuality};
use super::sky_cache::Corner;
use super::stats::Counts;
use super::surround::{Harmonics, Moments};
use crate::geom::{DVec3, Ray, Vec3};
use crate::march::transmittance::DepthChoice;

/// Light that is less than this share of what comes from a part of the sky is left out.
const FAINT: f32 = 0.05;
/// How far from a surface the grid is asked, in cells: what lies within it sees nothing.
const LIFT: f64 = 0.5;

impl Tracer<'_> {
    /// Irradiance / π from around, on matter at `x` with these normals. `outward`: the mean normal, at most of length 1;
    /// `width`: of the cone that sees it.
    pub(super) fn sky_light(&mut self, x: DVec3, normals: &Moments, outward: DVec3, width: f64) -> Vec3 {
        let world = self.world;
        if self.options.ambient == Ambient::Constant {
            return world.surround.light.irradiance(normals);
        }
        let mut sum = Harmonics::default();
        for (level, share) in world.sky_cache.levels(width) {
            if share > 0.0 {
                let Some(light) = self.sky_at(x, outward, level) else {
                    return world.surround.light.irradiance(normals);
                };
                sum = sum + light * share as f32;
            }
        }
        sum.irradiance(normals)
    }

    /// What a level of the grid has at `x`, from the corners of its cell there; `None` where the grid ends.
    fn sky_at(&mut self, x: DVec3, outward: DVec3, level: i32) -> Option<Harmonics> {
        let world = self.world;
        let bias = self.options.depth_bias + self.options.shadow_bias;
        let place = world.sky_cache.place(x, level) + LIFT * outward;
        if place.abs().max_element() >= f64::from(i32::MAX) {
            return None;
        }
        let low = place.floor();
        let share = place - low;
        let mut sum = Harmonics::default();
        for k in 0..8 {
            let bit = |a: usize| f64::from(k >> a & 1);
            let of = |a: usize| if k >> a & 1 == 0 { 1.0 - share[a] } else { share[a] };
            let weight = of(0) * of(1) * of(2);
            if weight > 0.0 {
                let at = [0, 1, 2].map(|a| (low[a] + bit(a)) as i32);
                let corner = Corner { level, at };
                let light = self.recent_sky.get(corner, &world.sky_cache, || find(world, corner, bias as f32));
                sum = sum + light * weight as f32;
            }
        }
        Some(sum)
    }
}

/// The light at a corner of the grid.
fn find(world: &World<'_>, corner: Corner, bias: f32) -> (Harmonics, Counts) {
    let cache = &world.sky_cache;
    let size = cache.size(corner.level);
    let x = out_of_the_ground(world, cache.position(corner), size);
    let mut counts = Counts::default();
    let choice = DepthChoice { bias, lod_dither: 0.5, finest: u8::MAX };
    let quality = ShadowQuality { choice, stop_below: FAINT, source_geometry: false };
    let mut sum = Harmonics::default();
    for part in &world.surround.parts {
        let towards = |dir: DVec3| ShadowCone {
            ray: Ray { origin: x, dir },
            end: f64::INFINITY,
            start: None,
            width: 0.5 * size,
            growth: part.growth,
        };
        let rays = part.rays.iter().map(|&dir| towards(dir).mesh_transmittance(world));
        let through = rays.sum::<f32>() / part.rays.len() as f32;
        counts.sky_cones += 1;
        let open = towards(part.axis).transmittance(world, through, quality, &mut counts);
        sum = sum + part.light * open;
    }
    (sum, counts)
}

/// A corner that lies a little below the ground sees nothing, and yet is one of those around what stands on it: the place
/// right above it then, where there is nothing below.
fn out_of_the_ground(world: &World<'_>, x: DVec3, size: f64) -> DVec3 {
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
