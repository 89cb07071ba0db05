//! One sample of a reference picture: the nearest surface along a ray, of the scene's meshes or of a texel's source in a shell, and its
//! radiance.

use crate::geom::{DMat3, DVec3, Ray, Vec3};
use crate::march::shade::Look;
use crate::render::affine::ConeWidth;
use crate::render::cells::CopyHit;
use crate::render::mesh::{Contact, Mesh, Surface};
use crate::render::options::{Ambient, Options};
use crate::render::phong::SurfaceCoords;
use crate::render::prepare::{Item, World};
use crate::render::shadow::SelfHit;
use crate::render::source_mesh::{CopyRay, SourceMesh};
use crate::render::stats::Counts;
use crate::scene::Model;

use super::sampling::{PixelSample, chance, hash, pixel_sample, point};
use crate::render::environment_light::moments_of_normal;

/// Largest deviation of a chord from the exact path through a curved box, in edges of the texel's cube.
const CHORD_TOLERANCE: f64 = 1e-4;

pub struct Tracer<'a> {
    pub world: &'a World<'a>,
    pub sources: &'a [Option<SourceMesh>],
    pub options: &'a Options,
}

/// The surface that a ray hits.
struct Intersection<'a> {
    t: f64,
    contact: Contact,
    /// The copy that was hit; `None` for a mesh of the scene.
    copy: Option<SourceCopy<'a>>,
    /// Of several surfaces in one place, that with the greatest priority is seen.
    priority: (u32, u32),
}

/// The cell of a copy: its frame, and its layer.
#[derive(Clone, Copy)]
struct CellFrame<'a> {
    /// Linear part of the map from the renderer's space to the cell.
    to_cell: &'a DMat3,
    /// Gives the texel coordinates along the ray in a copy.
    coords: &'a dyn Fn(&CopyHit) -> SurfaceCoords,
    layer: LayerAttributes,
}

/// Attributes of the layer that a copy is in.
#[derive(Clone, Copy, Default)]
struct LayerAttributes {
    /// Number of the layer in its box.
    number: u32,
    /// See [`crate::render::layer::TexelLayer::rank`].
    rank: u32,
    /// See [`crate::scene::shell::Layer::opacity_scale`].
    opacity_scale: f32,
}

/// Facets of two layers count as coincident within this distance, relative to 1 + their distance from the camera: two paths through
/// texel space differ by as much rounding.
const COINCIDENT: f64 = 1e-9;

/// A copy of a texel's source, where a ray runs through it.
struct SourceCopy<'a> {
    source: &'a SourceMesh,
    texel: usize,
    cell: [i64; 3],
    ray: CopyRay,
    look: Look,
}

impl<'a> Tracer<'a> {
    /// Linear radiance and alpha of sample `index` of pixel (x, y).
    pub fn sample(&self, x: u32, y: u32, index: u32, counts: &mut Counts) -> [f32; 4] {
        let sample = pixel_sample(x, y, index);
        let [dx, dy] = sample.in_pixel();
        let cone = self.world.view.cone(f64::from(x) + dx, f64::from(y) + dy, self.world.unit);
        counts.cones += 1;
        let seed = hash(sample.set ^ hash(sample.index));
        match self.nearest(&cone.ray, seed, counts) {
            Some(met) => {
                let mut seen = self.radiance(&cone.ray, &met, sample, counts);
                if let Some((through, added)) = self.world.environment.aerial_perspective(cone.ray.dir, met.t) {
                    seen = through * seen + added;
                }
                let [r, g, b] = seen.to_array();
                [r, g, b, 1.0]
            }
            None => {
                let [r, g, b] = self.world.environment.background_radiance(cone.ray.dir, 0.0).to_array();
                [r, g, b, 0.0]
            }
        }
    }

    /// The nearest surface. Alpha is stochastic: a surface of alpha a is hit with probability a.
    fn nearest(&self, ray: &Ray, seed: u32, counts: &mut Counts) -> Option<Intersection<'a>> {
        let world = self.world;
        let mut best = nearest_contact(&world.mesh, &world.scene.model, ray, (f64::INFINITY, 1.0), seed)
            .map(|contact| Intersection { t: contact.t, contact, copy: None, priority: (u32::MAX, u32::MAX) });
        let limit = best.as_ref().map_or(f64::INFINITY, |met| met.t);
        world.shells.nearest(ray, limit, |index, limit| {
            let mut end = limit;
            let world_ray = ray;
            let reach = |end: f64| end + COINCIDENT * (1.0 + end);
            self.copies(index, ray, reach(limit), counts, &mut |hit, CellFrame { to_cell, coords, layer }| {
                if hit.t0 >= reach(end) {
                    return false;
                }
                let Some(Some(source)) = self.sources.get(hit.texel) else { return true };
                let ray = hit.ray();
                let seed = seed ^ hash(hit.cell[0] as u32 ^ hash(hit.cell[1] as u32 ^ hash(hit.cell[2] as u32)));
                let until = (hit.t1.min(reach(end)) - hit.t0, layer.opacity_scale);
                let Some(contact) = nearest_contact(&source.mesh, &source.model, &ray, until, seed) else {
                    return true;
                };
                let t = hit.t0 + contact.t;
                // Of coincident facets that of the upper layer is seen; among layers that are mixed, a random one.
                let priority = (layer.rank, hash(seed ^ hash(layer.number)));
                let other = best.as_ref().filter(|best| reach(t) >= best.t && best.priority != priority);
                if other.map_or(t >= end, |best| priority < best.priority) {
                    return true;
                }
                end = t;
                let copy = SourceCopy {
                    source,
                    texel: hit.texel,
                    cell: hit.cell,
                    ray: CopyRay { ray, t0: hit.t0, to_texel: hit.linear * *to_cell },
                    look: world.look(hit, Some(&coords(hit)), world_ray, (end, 0.0)),
                };
                best = Some(Intersection { t: end, contact, copy: Some(copy), priority });
                // Copies that reach over others' cells may overlap this one, and begin before `end`.
                true
            });
            end
        });
        best
    }

    /// The copies of texels that a ray runs through in a box, up to `t1`: layer by layer, each in order, until `each`
    /// returns false, which ends the layer.
    fn copies(
        &self,
        index: u32,
        ray: &Ray,
        t1: f64,
        counts: &mut Counts,
        each: &mut dyn FnMut(&CopyHit, CellFrame<'_>) -> bool,
    ) {
        let shell = match self.world.item(index) {
            Item::Box(shell) => shell,
            Item::Copy(number) => {
                let width = ConeWidth { start: 0.0, growth: 0.0 };
                if let Some(segment) = self.world.copies.segment(number, ray, t1, width) {
                    counts.boxes += 1;
                    let coords = |hit: &CopyHit| SurfaceCoords::of_copy(hit, 0.0);
                    let (rank, opacity_scale) = (segment.rank, segment.march.opacity_scale);
                    let layer = LayerAttributes { rank, opacity_scale, ..LayerAttributes::default() };
                    each(&segment.hit, CellFrame { to_cell: &segment.to_texel, coords: &coords, layer });
                }
                return;
            }
        };
        let tolerance = |_: f64, _: &DMat3| CHORD_TOLERANCE;
        shell.spans(ray, 0.0, t1, |from, to| {
            counts.boxes += 1;
            for (number, layer) in (0..).zip(self.world.layers_of(index)) {
                let opacity_scale = layer.layer.opacity_scale as f32;
                let of_layer = LayerAttributes { number, rank: layer.rank, opacity_scale };
                shell.for_each_segment(ray, from, to, &tolerance, &mut |segment| {
                    let coords = |_: &CopyHit| SurfaceCoords::of_layer(segment, layer, 0.0);
                    layer.for_each_chord(segment, &tolerance, &mut |chord| {
                        let space = CellFrame { to_cell: &chord.to_texel, coords: &coords, layer: of_layer };
                        layer.for_each_copy(chord, &mut |hit| each(hit, space))
                    })
                });
            }
        });
    }

    /// Radiance that leaves the surface towards the origin of `ray`; `sample` chooses the directions to lights and sky.
    fn radiance(&self, ray: &Ray, met: &Intersection, sample: PixelSample, counts: &mut Counts) -> Vec3 {
        let seen = self.surface(ray, met);
        if seen.unlit {
            return seen.albedo;
        }
        let start = SelfHit {
            triangle: met.contact.triangle,
            copy: met.copy.as_ref().map(|copy| (copy.texel, copy.cell)),
            affine: None,
        };
        let mut light = seen.emission;
        for incident in self.world.lights.iter().filter_map(|light| light.incident(seen.lifted)) {
            let cosine = seen.normal.dot(incident.dir) as f32;
            let (share, origin) =
                if cosine > 0.0 { (seen.albedo, seen.lifted) } else { (seen.transmission, seen.lifted_behind()) };
            let reflected = share * cosine.abs() + seen.highlight(-ray.dir, incident.dir);
            if reflected != Vec3::ZERO {
                let dir = sample.towards(incident.dir, incident.radius);
                let open = self.visibility(origin, dir, incident.distance, start, counts);
                light += reflected * incident.irradiance * (open * std::f32::consts::FRAC_1_PI);
            }
        }
        // Ambient light, on the visible side and on the other.
        let sides = [(seen.albedo, seen.normal, seen.lifted), (seen.transmission, -seen.normal, seen.lifted_behind())];
        for (share, normal, origin) in sides.into_iter().filter(|side| side.0 != Vec3::ZERO) {
            let environment = &self.world.environment;
            light += share
                * seen.ambient
                * if self.options.ambient == Ambient::Occluded {
                    let dir = cosine_direction(normal, point(sample.index, !sample.set));
                    self.visibility(origin, dir, f64::INFINITY, start, counts) * environment.radiance(dir)
                } else {
                    environment.light.irradiance(&moments_of_normal(normal))
                };
        }
        light
    }

    fn surface(&self, ray: &Ray, met: &Intersection) -> Surface {
        let Some(copy) = &met.copy else {
            return self.world.mesh.surface(&self.world.scene.model, ray, &met.contact, 0.0);
        };
        let surface = copy.source.surface(ray, &copy.ray, &met.contact, 0.0);
        surface.shown(&copy.look)
    }

    /// Transmittance from a point at `distance` along `dir` to `from`.
    fn visibility(&self, from: DVec3, dir: DVec3, distance: f64, start: SelfHit, counts: &mut Counts) -> f32 {
        if !self.options.shadows {
            return 1.0;
        }
        counts.shadow_rays += 1;
        let (world, ray) = (self.world, Ray { origin: from, dir });
        let start = Some(start);
        let mut through =
            world.mesh.transmittance(&world.scene.model, &ray, distance, SelfHit::mesh_triangle(start), 0.0);
        if through <= 0.0 {
            return 0.0;
        }
        world.shells.nearest(&ray, distance, |index, t1| {
            self.copies(index, &ray, t1, counts, &mut |hit, CellFrame { layer, .. }| {
                if through <= 0.0 {
                    return false;
                }
                let Some(Some(source)) = self.sources.get(hit.texel) else { return true };
                let ray = hit.ray();
                let skip = SelfHit::source_triangle(start, hit);
                let end = (hit.t1 - hit.t0, layer.opacity_scale);
                through *= source.mesh.transmittance_scaled(&source.model, &ray, end, skip, 0.0);
                through > 0.0
            });
            if through > 0.0 { t1 } else { -1.0 }
        });
        through.max(0.0)
    }
}

/// The nearest contact before t1, where a contact of alpha a is there with probability a; opacities are scaled.
fn nearest_contact(mesh: &Mesh, model: &Model, ray: &Ray, t1_and_scale: (f64, f32), seed: u32) -> Option<Contact> {
    let mut blended = Vec::new();
    let opaque = mesh.nearest_for_camera(model, ray, t1_and_scale, |_| 0.0, &mut blended);
    let there = blended.into_iter().filter(|surface| chance(surface.triangle, seed) < f64::from(surface.alpha));
    there.chain(opaque).min_by(|a, b| a.t.total_cmp(&b.t))
}

/// A unit direction around `normal`, with a density in proportion to the cosine.
fn cosine_direction(normal: DVec3, [u, v]: [f64; 2]) -> DVec3 {
    let (tangent, other) = normal.any_orthonormal_pair();
    let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
    let radius = u.sqrt();
    (radius * cos * tangent + radius * sin * other + (1.0 - u).sqrt() * normal).normalize()
}
