//! Lighting of a cone's events: light from every light source, tested by shadow rays, and ambient light.
//!
//! Based on: E. Heitz et al., *The SGGX Microflake Distribution*, SIGGRAPH 2015 (voxels reflect as their facets do, see
//! [`crate::march::shade`]). One shadow ray for a group of voxels of one copy: see [`crate::march::shade::ShadowGroup`].

use std::f32::consts::FRAC_1_PI;

use super::cards::{LitPlace, MAX_LIT, mesh_transmittance_to_places};
use super::cells::CopyHit;
use super::copy_segment::CopySegment;
use super::environment_light::{moments_of_means, moments_of_normal};
use super::events::{Event, EventOrigin};
use super::mesh::{Contact, Surface};
use super::pixel::{ConeState, Tracer};
use super::shadow::{SelfHit, ShadowCone, ShadowQuality};
use super::shared_shadow::{LitGroup, merge_small_groups};
use super::sky::PointInCopy;
use super::source_mesh::CopyRay;
use super::trace::TraceEvent;
use crate::geom::{DMat3, DVec3, Mat3, Ray, Vec3};
use crate::march::shade::{Look, MAX_FROM_MEAN, Shader};
use crate::march::transmittance::{DepthChoice, Sink, VoxelHit};
use crate::volume::octree::VoxelAddress;

/// Contributions below this are not tested by shadow rays; the display's white is 1.
const FAINT: f32 = 1.0 / 256.0;

/// A visibility of a light below this counts as 0.
const DARK_BELOW: f32 = 1.0 / 64.0;

/// How the cone sees a surface.
struct SurfaceView<'a> {
    start: SelfHit,
    /// Width of the cone there.
    width: f64,
    /// Share of the cone's light.
    weight: f32,
    /// The points at which fine rays see it; empty without fine rays.
    places: &'a [LitPlace],
    /// Its place in a copy, if it belongs to one.
    copy: Option<PointInCopy<'a>>,
}

impl Tracer<'_> {
    /// Light a triangle of the scene; `weight` is its share of the cone's light, and `index` its number among the blended surfaces, if it
    /// is one.
    pub(super) fn shade_contact(
        &mut self,
        state: &mut ConeState<'_>,
        contact: &Contact,
        weight: f32,
        index: Option<usize>,
    ) {
        let width = state.cone.width_at(contact.t);
        let fine = state.fine.zip(index);
        // Fine rays see it only in a part of the pixel.
        let part = fine.map_or(1.0, |(_, index)| f64::from(self.seen_share(index)));
        let world = self.world;
        let surface = world.mesh.surface(&world.scene.model, &state.cone.ray, contact, width * part.sqrt());
        let places = fine.map_or(Vec::new(), |(_, index)| self.lit_places(surface.point, index));
        let (albedo, normal) = (surface.albedo.to_array(), surface.normal.to_array());
        let metres = contact.t * world.unit;
        self.trace_event(|| TraceEvent::Surface { metres, albedo, normal, through: weight });
        let start = SelfHit { triangle: contact.triangle, copy: None, affine: None };
        self.shade_surface(state, &surface, SurfaceView { start, width, weight, places: &places, copy: None });
    }

    /// Light the triangle of a copy's source that an event records.
    pub(super) fn shade_source(&mut self, state: &mut ConeState<'_>, segment: &CopySegment, event: &Event) {
        let EventOrigin::Source { contact, .. } = event.origin else { return };
        let contact = self.lists.contacts[contact as usize];
        let Some(texel) = &self.world.texels[segment.hit.texel] else { return };
        // The source is in memory, since it was traced.
        let Some(source) = texel.source_lod(0.0, state.lod_dither) else { return };
        let t = segment.hit.t0 + contact.t;
        let width = state.cone.width_at(t);
        let copy = CopyRay { ray: segment.hit.ray(), t0: segment.hit.t0, to_texel: segment.to_texel };
        let surface = source.surface(&state.cone.ray, &copy, &contact, width * segment.scale);
        let surface = surface.shown(&self.look(segment, &state.cone.ray, t, width));
        let copy_of = Some((segment.hit.texel, segment.hit.cell));
        let start = SelfHit { triangle: contact.triangle, copy: copy_of, affine: segment.affine };
        let copy = Some(PointInCopy { segment, t });
        self.shade_surface(state, &surface, SurfaceView { start, width, weight: event.alpha, places: &[], copy });
    }

    /// Light a surface of either kind.
    fn shade_surface(&mut self, state: &mut ConeState<'_>, surface: &Surface, seen: SurfaceView<'_>) {
        let world = self.world;
        let SurfaceView { start, width, weight, places, copy } = seen;
        let albedo = weight * surface.albedo;
        let before = (state.radiance, state.faint);
        let distance = (surface.point - state.cone.ray.origin).dot(state.cone.ray.dir);
        state.radiance += weight * surface.emission;
        if surface.unlit {
            state.radiance += albedo;
            state.apply_air(before, world.environment.aerial_perspective(state.cone.ray.dir, distance), weight);
            return;
        }
        let transmission = weight * surface.transmission;
        let normals = moments_of_normal(surface.normal);
        let front = self.sky_light(surface.point, surface.normal, width, copy);
        state.radiance += albedo * surface.ambient * front.irradiance(&normals);
        if transmission != Vec3::ZERO {
            let normals = moments_of_normal(-surface.normal);
            let behind = self.sky_light_behind(front, surface.point, surface.normal, width, copy);
            state.radiance += transmission * surface.ambient * behind.irradiance(&normals);
        }
        for light in &world.lights {
            let Some(incident) = light.incident(surface.point) else { continue };
            let cosine = surface.normal.dot(incident.dir) as f32;
            let (share, origin) =
                if cosine > 0.0 { (albedo, surface.lifted) } else { (transmission, surface.lifted_behind()) };
            let reflected = share * cosine.abs() + weight * surface.highlight(-state.cone.ray.dir, incident.dir);
            if reflected != Vec3::ZERO {
                let radiance = reflected * incident.irradiance * FRAC_1_PI;
                let ray = Ray { origin, dir: incident.dir };
                let growth = 2.0 * incident.radius;
                let cone = ShadowCone { ray, end: incident.distance, start: Some(start), width, growth };
                match state.fine.filter(|_| !places.is_empty()) {
                    Some(rays) => {
                        let open = || mesh_transmittance_to_places(world, rays, places, light, &cone);
                        self.add_light(state, radiance, &cone, FAINT / MAX_LIT as f32, open);
                    }
                    None => self.add_light(state, radiance, &cone, FAINT, || cone.soft_mesh_transmittance(world)),
                }
            }
        }
        state.apply_air(before, world.environment.aerial_perspective(state.cone.ray.dir, distance), weight);
    }

    /// Light the voxels of one copy that events record. Their contributions are added to the cone, or wait in `self.lit` for a shadow ray
    /// that they share.
    pub(super) fn shade_voxels(&mut self, state: &mut ConeState<'_>, segment: &CopySegment, events: &[Event]) {
        let (world, cone) = (self.world, state.cone);
        let hit = &segment.hit;
        let weight: f32 = events.iter().map(|e| e.alpha).sum();
        let mean: f64 = events.iter().map(|e| f64::from(e.alpha) * distance(hit, e)).sum::<f64>() / f64::from(weight);
        if !mean.is_finite() {
            return;
        }
        let middle = cone.ray.at(mean);
        let space = ShadingSpace::new(segment.to_texel);
        self.local_light_dirs.clear();
        let dirs = world.lights.iter().map(|l| l.incident(middle).map_or(Vec3::ZERO, |i| space.local(i.dir)));
        self.local_light_dirs.extend(dirs);
        let mut groups = std::mem::take(&mut self.groups);
        groups.clear();
        let lights = std::mem::take(&mut self.local_light_dirs);
        let texel = world.texels[hit.texel].as_ref();
        // Brightness factors correct the light that coarse depths let through; that error arises with shadow rays only.
        let calibrated = texel.filter(|_| self.options.shadows);
        let factors = calibrated.map_or(&[][..], |t| &t.tree.brightness_factors()[..]);
        let view = space.local(-cone.ray.dir);
        let mut shader = Shader::new(view, &lights, space.cofactor(), hit.tint, factors, &mut groups);
        if let Some(texel) = texel {
            shader = shader.with_surfaces_of(&texel.tree);
        }
        shader.normals = world.environment.is_directional(self.options.ambient).then(Default::default);
        for event in events {
            if let (EventOrigin::Voxel { depth, rank, t, .. }, Some(texel)) = (event.origin, texel) {
                let voxel = texel.tree.voxel(VoxelAddress { depth, rank });
                let position = segment.march.origin + t * segment.march.dir;
                if hit.phong != 0 {
                    let t = hit.t0 + f64::from(t);
                    shader.look = self.look(segment, &cone.ray, t, cone.width_at(t));
                }
                shader.voxel(&VoxelHit { t, weight: event.alpha, depth, voxel, rank, position });
            }
        }
        shader.finish();
        let (albedo, transmission, unlit) = (shader.albedo, shader.transmission, shader.unlit);
        let before = (state.radiance, state.faint);
        match shader.normals {
            None => state.radiance += unlit + (albedo + transmission) * world.environment.light.mean_irradiance(),
            Some(normals) => {
                let (normal, square) = normals.means();
                let of_normals = |normal: Vec3| moments_of_means(normal, square, &space.rotation());
                let outward = space.world(normal);
                let (width, copy) = (cone.width_at(mean), Some(PointInCopy { segment, t: mean }));
                let front = self.sky_light(middle, outward, width, copy);
                state.radiance += unlit + albedo * front.irradiance(&of_normals(normal));
                if transmission != Vec3::ZERO {
                    let behind = self.sky_light_behind(front, middle, outward, width, copy);
                    state.radiance += transmission * behind.irradiance(&of_normals(-normal));
                }
            }
        }
        let air = world.environment.aerial_perspective(cone.ray.dir, mean);
        let through_air = air.map_or(Vec3::ONE, |(through, _)| through);
        let start = Some(SelfHit { triangle: u32::MAX, copy: Some((hit.texel, hit.cell)), affine: segment.affine });
        let facet_size = texel.map_or(0.0, |t| t.tree.info().facet_size as f32);
        for group in &groups {
            let t = hit.t0 + f64::from(group.t);
            let x = cone.ray.at(t);
            let Some(incident) = world.lights[group.light].incident(x) else { continue };
            let radiance = group.energy * incident.irradiance * FRAC_1_PI;
            let offset = space.world(group.start(facet_size, lights[group.light])) / segment.scale;
            // Of a copy without width, by collapsed coordinates, there is none.
            let offset = if offset.is_finite() { offset } else { DVec3::ZERO };
            let ray = Ray { origin: x + offset, dir: incident.dir };
            let end = incident.distance - offset.dot(incident.dir);
            let growth = 2.0 * incident.radius;
            let cone = ShadowCone { ray, end, start, width: cone.width_at(t), growth };
            if self.needs_shadow_ray(radiance, FAINT) {
                let reach = f64::from(MAX_FROM_MEAN * group.voxel) / segment.scale;
                let radiance = through_air * radiance;
                self.lit.push(LitGroup { light: group.light, t, reach, weight: group.weight, radiance, cone });
            } else {
                self.add_light(state, radiance, &cone, FAINT, || 1.0);
            }
        }
        state.apply_air(before, air, weight);
        self.groups = groups;
        self.local_light_dirs = lights;
    }

    /// How the landscape modifies the material of a copy at the distance `t`, where the cone is `width` wide.
    fn look(&self, segment: &CopySegment, ray: &Ray, t: f64, width: f64) -> Look {
        self.world.look(&segment.hit, segment.coords.as_deref(), ray, (t, width))
    }

    /// Whether a contribution is worth a shadow ray.
    fn needs_shadow_ray(&self, radiance: Vec3, faint: f32) -> bool {
        self.options.shadows && radiance.max_element() * self.exposure >= faint
    }

    /// Cast the shadow rays of all groups that wait for one, and add their light.
    pub(super) fn add_shadow_groups(&mut self, state: &mut ConeState<'_>) {
        let mut lit = std::mem::take(&mut self.lit);
        merge_small_groups(&mut lit);
        for LitGroup { radiance, cone, .. } in lit.drain(..) {
            self.add_shadow_tested(state, radiance, &cone, cone.soft_mesh_transmittance(self.world));
        }
        self.lit = lit;
    }

    /// Add reflected `radiance`, times the visibility of its light along `cone`. `through` gives the transmittance of meshes. A
    /// contribution below `faint` is not tested, but collected.
    fn add_light(
        &mut self,
        state: &mut ConeState<'_>,
        radiance: Vec3,
        cone: &ShadowCone,
        faint: f32,
        through: impl FnOnce() -> f32,
    ) {
        if !self.options.shadows {
            state.radiance += radiance;
            return;
        }
        if self.needs_shadow_ray(radiance, faint) {
            self.add_shadow_tested(state, radiance, cone, through());
        } else {
            state.faint += radiance;
        }
    }

    /// Add `radiance` times the visibility that a shadow cone finds; `through` is the transmittance of meshes.
    fn add_shadow_tested(&mut self, state: &mut ConeState<'_>, radiance: Vec3, cone: &ShadowCone, through: f32) {
        let bright = radiance.max_element();
        let seen = self.visibility(cone, through, state.lod_dither);
        state.radiance += seen * radiance;
        state.arrived += seen * bright;
        state.tested += bright;
        let origin = (cone.ray.origin * self.world.unit).to_array();
        self.trace_event(|| TraceEvent::Shadow { origin, light: radiance.to_array(), seen });
    }

    /// The visibility of a light along a cone; `through` is the transmittance of meshes.
    fn visibility(&mut self, cone: &ShadowCone, through: f32, lod_dither: f32) -> f32 {
        self.counts.shadow_rays += 1;
        // By default the depth by which matter is seen also shades it; a coarser one darkens (see `shadow_start`).
        let bias = (self.options.depth_bias + self.options.shadow_bias) as f32;
        let choice = DepthChoice { bias, lod_dither, finest: u8::MAX };
        cone.transmittance(
            self.world,
            through,
            ShadowQuality { choice, stop_below: DARK_BELOW, source_geometry: true, left_out: None },
            &mut self.counts,
        )
    }
}

/// Distance of an event without the lead of its layer.
fn distance(hit: &CopyHit, event: &Event) -> f64 {
    match event.origin {
        EventOrigin::Voxel { t, .. } => hit.t0 + f64::from(t),
        EventOrigin::Source { .. } | EventOrigin::BlendedSurface(_) => event.t,
    }
}

/// The space in which a copy's voxels are lit: texel space, if the map to it is a similarity, else world space, to which the cofactor
/// matrix takes normals.
struct ShadingSpace {
    to_texel: DMat3,
    keeps_angles: bool,
}

impl ShadingSpace {
    fn new(to_texel: DMat3) -> ShadingSpace {
        ShadingSpace { to_texel, keeps_angles: is_similarity(&to_texel) }
    }

    /// A unit direction of the world in this space.
    fn local(&self, dir: DVec3) -> Vec3 {
        if self.keeps_angles { (self.to_texel * dir).normalize_or_zero() } else { dir }.as_vec3()
    }

    /// A vector of this space in the world, up to the copy's scale. The precision suffices for starts of shadow rays.
    fn world(&self, v: Vec3) -> DVec3 {
        let (v, m) = (v.as_dvec3(), &self.to_texel);
        if self.keeps_angles { m.transpose() * v / m.x_axis.length().max(f64::MIN_POSITIVE) } else { v }
    }

    /// Rotation from this space to the world.
    fn rotation(&self) -> DMat3 {
        let m = &self.to_texel;
        if self.keeps_angles {
            m.transpose() * (1.0 / m.x_axis.length().max(f64::MIN_POSITIVE))
        } else {
            DMat3::IDENTITY
        }
    }

    /// The map of normals from texel space to the world, up to a factor; `None` where voxels are lit in texel space.
    fn cofactor(&self) -> Option<Mat3> {
        let m = &self.to_texel;
        (!self.keeps_angles).then(|| (m.transpose() * (1.0 / m.x_axis.length().max(f64::MIN_POSITIVE))).as_mat3())
    }
}

/// Whether a map keeps angles, to a thousandth.
fn is_similarity(m: &DMat3) -> bool {
    let (a, b, c) = (m.x_axis, m.y_axis, m.z_axis);
    let (aa, bb, cc) = (a.length_squared(), b.length_squared(), c.length_squared());
    let near = |x: f64, y: f64| (x - y).abs() <= 1e-3 * aa;
    near(aa, bb) && near(aa, cc) && near(a.dot(b), 0.0) && near(a.dot(c), 0.0) && near(b.dot(c), 0.0)
}
