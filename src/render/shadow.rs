//! Shadow cones towards lights and towards sectors of the sky: the transmittance of meshes and texels along them.
//!
//! Based on: J. Amanatides, *Ray Tracing with Cones*, SIGGRAPH 1984.

use super::affine::ConeWidth;
use super::cells::CopyHit;
use super::copy_segment::CopySegment;
use super::lane::REACH;
use super::mesh::Bundle;
use super::prepare::{Item, World};
use super::reference::sampling::point;
use super::segments::{BoxInterval, for_each_segment};
use super::stats::Counts;
use crate::geom::Ray;
use crate::march::transmittance::{DepthChoice, transmittance, transmittance_from_own_matter};
use crate::volume::Info;

/// The matter that a ray starts on and must not hit again: a triangle of the scene's meshes, or of the source of a texel's
/// copy, or voxels of a copy.
#[derive(Clone, Copy)]
pub struct SelfHit {
    /// `u32::MAX` where the ray starts on voxels.
    pub triangle: u32,
    /// The texel and the cell of the copy; `None` for the scene's meshes.
    pub copy: Option<(usize, [i64; 3])>,
    /// Number of that copy, see [`CopySegment::affine`].
    pub affine: Option<u32>,
}

impl SelfHit {
    /// The triangle, if it is of the scene's meshes.
    pub fn mesh_triangle(start: Option<SelfHit>) -> Option<u32> {
        start.filter(|s| s.copy.is_none()).map(|s| s.triangle)
    }

    /// The triangle, if it is of the source of this copy.
    pub fn source_triangle(start: Option<SelfHit>, hit: &CopyHit) -> Option<u32> {
        start.filter(|s| s.copy == Some((hit.texel, hit.cell))).map(|s| s.triangle)
    }

    /// Whether the ray starts on matter of this copy.
    pub fn starts_in(start: Option<SelfHit>, hit: &CopyHit) -> bool {
        start.is_some_and(|s| s.copy == Some((hit.texel, hit.cell)))
    }
}

/// A cone towards a light or a sector of the sky.
#[derive(Clone, Copy)]
pub struct ShadowCone {
    pub ray: Ray,
    /// Distance to the light.
    pub end: f64,
    pub start: Option<SelfHit>,
    /// Width at the start, and its growth per unit of the ray's t.
    pub width: f64,
    pub growth: f64,
}

/// Level of detail of shadow rays, and the transmittance at which they end.
#[derive(Clone, Copy)]
pub struct ShadowQuality {
    pub choice: DepthChoice,
    /// A transmittance below this counts as 0.
    pub stop_below: f32,
    /// Whether a texel's source is traced where the cone is narrower than its voxels.
    pub source_geometry: bool,
    /// Matter that the cone ignores.
    pub left_out: Option<LeftOut>,
}

/// A copy that a cone ignores, together with the cyclic texels of up to `around` cells on either side along each axis.
#[derive(Clone, Copy)]
pub struct LeftOut {
    pub texel: usize,
    pub cell: [i64; 3],
    pub around: [i64; 3],
}

impl LeftOut {
    fn holds(&self, hit: &CopyHit, info: &Info) -> bool {
        let near = |k: usize| hit.cell[k].abs_diff(self.cell[k]) <= self.around[k] as u64;
        let own = hit.texel == self.texel && hit.cell == self.cell;
        own || (self.around != [0; 3] && info.cyclic.contains(&true) && (0..3).all(near))
    }
}

impl ShadowCone {
    /// Transmittance of the scene's meshes along the cone's central ray.
    pub fn mesh_transmittance(&self, world: &World<'_>) -> f32 {
        let skip = SelfHit::mesh_triangle(self.start);
        world.mesh.transmittance_of_overlapping(&world.scene.model, &self.ray, self.end, skip, self.width)
    }

    /// Transmittance of the scene's meshes over the whole light, whose angular size is the cone's growth: by a few rays, and by more where
    /// these differ or where cards are near.
    pub fn soft_mesh_transmittance(&self, world: &World<'_>) -> f32 {
        const RAYS: usize = 16;
        // The rays that are cast first are the last of the spiral. They lie next to the light's rim, and neighbours among them are at most
        // 85 degrees apart: where all of them agree, an edge hides at most a tenth of the light from the others. (Tried: every fourth ray.
        // Those lie near one line, and an edge along it is missed.)
        const FIRST: usize = 5;
        const CARD_RAYS: usize = 64;
        if world.mesh.is_empty() {
            return 1.0;
        }
        let reach = |t: f64| REACH * (self.width + self.growth * t);
        let has_cards = world.mesh.are_cards_near(&self.ray, self.end, reach);
        let radius = 0.5 * self.growth;
        let (across, other) = self.ray.dir.any_orthonormal_pair();
        let size = libm::tan(radius);
        // Vogel's spiral, evenly spread over the disc (H. Vogel 1979), from the middle outwards.
        let towards = |i: usize, count: usize| {
            let (sin, cos) = libm::sincos(2.399_963_23 * i as f64);
            let reach = size * ((i as f64 + 0.5) / count as f64).sqrt();
            let dir = (self.ray.dir + reach * (cos * across + sin * other)).normalize();
            Ray { dir, ..self.ray }
        };
        let (model, skip) = (&world.scene.model, SelfHit::mesh_triangle(self.start));
        let mut cards = 1.0;
        if has_cards {
            // Starts are spread over the cone's width for cards alone: other triangles may be the ground that the cone starts on.
            let mut bundle = Bundle::new(self.ray);
            for i in 0..CARD_RAYS {
                let ray = towards(i, CARD_RAYS);
                let [u, v] = point(i as u32, 0).map(|k| (k - 0.5) * self.width);
                bundle.push(&Ray { origin: ray.origin + u * across + v * other, ..ray }, 1e-9, self.end);
            }
            let mut through = [1.0f32; CARD_RAYS];
            world.mesh.cards_along(model, &bundle, skip, |hit| through[hit.ray] *= 1.0 - hit.contact.alpha);
            cards = through.iter().sum::<f32>() / CARD_RAYS as f32;
            if cards <= 0.0 || world.mesh.is_all_cards() {
                return cards;
            }
        }
        let through = |ray: &Ray| {
            if has_cards {
                return world.mesh.transmittance_but_cards(model, ray, self.end, skip);
            }
            world.mesh.transmittance_of_overlapping(model, ray, self.end, skip, self.width)
        };
        if radius <= 0.0 {
            return cards * through(&self.ray);
        }
        let one = |i: usize| through(&towards(i, RAYS));
        let is_first = |i: &usize| *i >= RAYS - FIRST;
        let first: Vec<f32> = (0..RAYS).filter(is_first).map(one).collect();
        let sum: f32 = first.iter().sum();
        if first.iter().all(|v| *v == first[0]) {
            return cards * sum / FIRST as f32;
        }
        cards * (sum + (0..RAYS).filter(|i| !is_first(i)).map(one).sum::<f32>()) / RAYS as f32
    }

    /// `through`, the transmittance of meshes, times the transmittance of all texels along the cone.
    pub fn transmittance(
        &self,
        world: &World<'_>,
        mut through: f32,
        quality: ShadowQuality,
        counts: &mut Counts,
    ) -> f32 {
        if through < quality.stop_below {
            return 0.0;
        }
        let width = ConeWidth { start: self.width, growth: self.growth };
        // The copy that the ray starts in is tested first, since it stops the light most often.
        let own = self.start.and_then(|start| start.affine);
        if let Some(number) = own
            && let Some(segment) = world.copies.segment(number as usize, &self.ray, self.end, width)
        {
            counts.boxes += 1;
            through *= self.segment_transmittance(world, &segment, quality, through, counts);
            if through < quality.stop_below {
                return 0.0;
            }
        }
        let is_open = world.shells.all(&self.ray, self.end, |index| match world.item(index) {
            Item::Copy(number) if own == Some(number as u32) => true,
            Item::Copy(number) => {
                let Some(segment) = world.copies.segment(number, &self.ray, self.end, width) else { return true };
                counts.boxes += 1;
                through *= self.segment_transmittance(world, &segment, quality, through, counts);
                through >= quality.stop_below
            }
            Item::Box(shell) => {
                let mut is_open = true;
                shell.spans(&self.ray, 0.0, self.end, |t0, t1| {
                    counts.boxes += 1;
                    let interval = BoxInterval { index, layer: None, t0, t1 };
                    let width_at = |t: f64| self.width + self.growth * t;
                    is_open = is_open
                        && for_each_segment(world, &self.ray, &interval, &width_at, &mut |segment| {
                            through *= self.segment_transmittance(world, segment, quality, through, counts);
                            through >= quality.stop_below
                        });
                });
                is_open
            }
        });
        if is_open { through } else { 0.0 }
    }

    /// Transmittance of one copy; `through` is the transmittance before it.
    fn segment_transmittance(
        &self,
        world: &World<'_>,
        segment: &CopySegment,
        quality: ShadowQuality,
        through: f32,
        counts: &mut Counts,
    ) -> f32 {
        let CopySegment { hit, march, .. } = segment;
        let Some(Some(texel)) = world.texels.get(hit.texel) else { return 1.0 };
        if quality.left_out.is_some_and(|left_out| left_out.holds(hit, texel.tree.info())) {
            return 1.0;
        }
        // As for camera cones, the width in the middle decides between voxels and the source.
        let mid_width = march.footprint + 0.5 * march.growth * march.length;
        let near = || texel.source_lod(mid_width, quality.choice.lod_dither);
        if let Some(source) = quality.source_geometry.then(near).flatten() {
            counts.near_copies += 1;
            let skip = SelfHit::source_triangle(self.start, hit);
            let (end, width) = ((hit.t1 - hit.t0, march.opacity_scale), f64::from(mid_width));
            return source.mesh.transmittance_scaled(&source.model, &hit.ray(), end, skip, width);
        }
        let choice = DepthChoice { finest: texel.finest, ..quality.choice };
        let stop_below = quality.stop_below / through;
        if hit.t0 <= 0.0 && SelfHit::starts_in(self.start, hit) {
            transmittance_from_own_matter(&texel.tree, march, choice, stop_below, &mut counts.march)
        } else {
            transmittance(&texel.tree, march, choice, stop_below, &mut counts.march)
        }
    }
}
