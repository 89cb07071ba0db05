//! Visibility of the sky from a point, past meshes and texels: one cone per sector.
//!
//! Based on: C. Crassin et al., *Interactive Indirect Illumination Using Voxel Cone Tracing*, Pacific Graphics 2011.

use super::packed_visibility::PackedVisibility;
use crate::geom::{DVec3, Ray};
use crate::march::transmittance::DepthChoice;
use crate::render::environment_light::{SECTORS, Sector};
use crate::render::prepare::World;
use crate::render::shadow::{LeftOut, ShadowCone, ShadowQuality};
use crate::render::stats::Counts;

/// A visibility below this counts as 0.
const FAINT: f32 = 0.05;

/// Visibility of each sector from `x`, by cones that are `width` wide at their start (renderer's units). `left_out` is not met;
/// `bias` is added to the depths that fit the cones.
pub fn visibility_at(
    world: &World<'_>,
    x: DVec3,
    width: f64,
    left_out: Option<LeftOut>,
    bias: f32,
) -> (PackedVisibility, Counts) {
    let mut counts = Counts::default();
    let choice = DepthChoice { bias, lod_dither: 0.5, finest: u8::MAX };
    let quality = ShadowQuality { choice, stop_below: FAINT, source_geometry: false, left_out };
    let towards = |sector: &Sector, dir: DVec3| ShadowCone {
        ray: Ray { origin: x, dir },
        end: f64::INFINITY,
        start: None,
        width,
        growth: sector.growth,
    };
    let list = &world.environment.sectors.list;
    let through = mesh_visibility(list, |sector, dir| towards(sector, dir).mesh_transmittance(world));
    let mut visibility = [0.0; SECTORS];
    for ((value, sector), through) in visibility.iter_mut().zip(list).zip(through) {
        counts.sky_cones += 1;
        *value = towards(sector, sector.axis).transmittance(world, through, quality, &mut counts);
    }
    (PackedVisibility::new(visibility), counts)
}

/// Visibility of each sector past the meshes alone; `open` gives the transmittance of one ray. A few rays tell which sectors are
/// open and which are hidden, and more are cast where the edge between them runs.
fn mesh_visibility(list: &[Sector], open: impl Fn(&Sector, DVec3) -> f32) -> [f32; SECTORS] {
    let mean =
        |sector: &Sector, rays: &[DVec3]| rays.iter().map(|&dir| open(sector, dir)).sum::<f32>() / rays.len() as f32;
    let mut few = [0.0; SECTORS];
    few.iter_mut().zip(list).for_each(|(value, sector)| *value = mean(sector, &sector.rays));
    let mut all = few;
    for (k, (value, sector)) in all.iter_mut().zip(list).enumerate() {
        let is_cut = few[k] > 0.0 && few[k] < 1.0 || sector.neighbours.iter().any(|&n| few[n] != few[k]);
        if is_cut {
            *value = mean(sector, &sector.more);
        }
    }
    all
}

/// `x`, moved up onto the ground if it lies less than two cells (of `size`) below it and there is nothing under it. A grid point
/// just below the ground would see no sky, although points above the ground interpolate from it.
pub fn lift_above_ground(world: &World<'_>, x: DVec3, size: f64) -> DVec3 {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::environment_light::Sectors;

    /// What a wall of the height `h`, from −`w`/2 to `w`/2 along z, hides of the cosine-weighted sky at a distance `d` from its
    /// middle: form factors of a point and an upright rectangle (J. Howell, *A Catalog of Radiation Heat Transfer Configuration
    /// Factors*, B-3).
    fn hidden(d: f64, w: f64, h: f64) -> f64 {
        let slant = d.hypot(h);
        (libm::atan(0.5 * w / d) - d / slant * libm::atan(0.5 * w / slant)) / std::f64::consts::PI
    }

    #[test]
    fn a_finite_wall_hides_its_solid_angle() {
        let list = Sectors::new(|_| DVec3::ONE).list;
        assert!(list.iter().all(|sector| sector.axis.y < 0.0 || sector.neighbours.len() > 1));
        let (mut most, mut sum, mut count) = (0.0f64, 0.0, 0.0);
        for (w, h) in [(4.0, 2.0), (1.0, 3.0), (20.0, 3.0), (2.0, 0.5), (6.0, 6.0)] {
            for n in 0..40 {
                let d = 0.1 * 1.1f64.powi(n);
                // The wall stands in the direction of x, turned about the vertical.
                let (sin, cos) = libm::sincos(0.7 * f64::from(n));
                let open = |_: &Sector, dir: DVec3| {
                    let (x, z) = (dir.x * cos + dir.z * sin, dir.z * cos - dir.x * sin);
                    let t = d / x;
                    f32::from(dir.y > 0.0 && !(x > 0.0 && (t * z).abs() < 0.5 * w && t * dir.y < h))
                };
                let visibility = mesh_visibility(&list, open);
                // The sector's own cosine stands for all of it.
                let all: f64 = list.iter().map(|p| p.axis.y.max(0.0) * p.growth * p.growth).sum();
                let seen =
                    list.iter().zip(visibility).map(|(p, s)| f64::from(s) * p.axis.y.max(0.0) * p.growth * p.growth);
                let error = seen.sum::<f64>() / all - (1.0 - hidden(d, w, h));
                most = most.max(error.abs());
                sum += error;
                count += 1.0;
            }
        }
        // A sector is some 1/14 of what the ground sees, and an edge through it is right to half a fifth of it, .007. The top and the
        // sides of a wall run through a dozen sectors, whose errors partly cancel; these add up to three times as much as one in the
        // mean square, and six times at the most. (One or two rays for each sector had .11 at the most, .046 in the mean square.)
        assert!(most < 0.042 && (sum / count).abs() < 0.005, "{most} {}", sum / count);
    }
}
