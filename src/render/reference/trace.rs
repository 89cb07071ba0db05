//! One sample: the nearest surface along a ray, of the scene's meshes or of a texel's source in a shell, and its light.

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

use super::sampling::{Place, chance, hash, place, point};
use crate::render::surround::of_normal;

/// Distance by which a straight segment may stray from the true path through a curved box, in edges of the texel's cube.
const STRAY: f64 = 1e-4;

pub struct Tracer<'a> {
    pub world: &'a World<'a>,
    pub sources: &'a [Option<SourceMesh>],
    pub options: &'a Options,
}

/// The surface that a ray hits.
struct Intersection<'a> {
    t: f64,
    contact: Contact,
    /// Of a texel's copy; `None` for a mesh of the scene.
    copy: Option<SourceCopy<'a>>,
    /// Of several in one place, that with the greatest is seen.
    place: (u32, u32),
}

/// The space of a copy's cell.
#[derive(Clone, Copy)]
struct Space<'a> {
    /// The linear part of the map from the world.
    to_cell: &'a DMat3,
    /// Texel coordinates along the ray, in a copy.
    coords: &'a dyn Fn(&CopyHit) -> SurfaceCoords,
    layer: LayerSpace,
}

/// What is asked of the layer that a copy is in.
#[derive(Clone, Copy, Default)]
struct LayerSpace {
    /// Number of the layer in its box.
    number: u32,
    /// See [`crate::render::layer::TexelLayer::rank`].
    rank: u32,
    /// See [`crate::scene::shell::Layer::opacity_scale`].
    opacity_scale: f32,
}

/// Facets of two layers that are as near to each other, in units of length and relative to their distance, are in one place: what
/// rounding leaves of two ways through texel space.
const ONE_PLACE: f64 = 1e-9;

/// A copy of a texel's source, where a ray runs through it.
struct SourceCopy<'a> {
    source: &'a SourceMesh,
    texel: usize,
    cell: [i64; 3],
    ray: CopyRay,
    look: Look,
}

impl<'a> Tracer<'a> {
    /// Radiance and cover of sample `index` of pixel (x, y).
    pub fn sample(&self, x: u32, y: u32, index: u32, counts: &mut Counts) -> [f32; 4] {
        let place = place(x, y, index);
        let [dx, dy] = place.in_pixel();
        let cone = self.world.view.cone(f64::from(x) + dx, f64::from(y) + dy, self.world.unit);
        counts.cones += 1;
        let seed = hash(place.set ^ hash(place.index));
        match self.nearest(&cone.ray, seed, counts) {
            Some(met) => {
                let mut seen = self.radiance(&cone.ray, &met, place, counts);
                if let Some((through, added)) = self.world.surround.air(cone.ray.dir, met.t) {
                    seen = through * seen + added;
                }
                let [r, g, b] = seen.to_array();
                [r, g, b, 1.0]
            }
            None => {
                let [r, g, b] = self.world.surround.seen(cone.ray.dir, 0.0).to_array();
                [r, g, b, 0.0]
            }
        }
    }

    /// The nearest surface; one that lets a share of light through is there by that chance.
    fn nearest(&self, ray: &Ray, seed: u32, counts: &mut Counts) -> Option<Intersection<'a>> {
        let world = self.world;
        let mut best = solid(&world.mesh, &world.scene.model, ray, (f64::INFINITY, 1.0), seed)
            .map(|contact| Intersection { t: contact.t, contact, copy: None, place: (u32::MAX, u32::MAX) });
        let limit = best.as_ref().map_or(f64::INFINITY, |met| met.t);
        world.shells.nearest(ray, limit, |index, limit| {
            let mut end = limit;
            let world_ray = ray;
            let reach = |end: f64| end + ONE_PLACE * (1.0 + end);
            self.copies(index, ray, reach(limit), counts, &mut |hit, Space { to_cell, coords, layer }| {
                if hit.t0 >= reach(end) {
                    return false;
                }
                let Some(Some(source)) = self.sources.get(hit.texel) else { return true };
                let ray = hit.ray();
                let seed = seed ^ hash(hit.cell[0] as u32 ^ hash(hit.cell[1] as u32 ^ hash(hit.cell[2] as u32)));
                let until = (hit.t1.min(reach(end)) - hit.t0, layer.opacity_scale);
                let Some(contact) = solid(&source.mesh, &source.model, &ray, until, seed) else { return true };
                let t = hit.t0 + contact.t;
                // Of what is in one place the upper layer is seen, and by chance any one of those that are mixed.
                let place = (layer.rank, hash(seed ^ hash(layer.number)));
                let other = best.as_ref().filter(|best| reach(t) >= best.t && best.place != place);
                if other.map_or(t >= end, |best| place < best.place) {
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
                best = Some(Intersection { t: end, contact, copy: Some(copy), place });
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
        each: &mut dyn FnMut(&CopyHit, Space<'_>) -> bool,
    ) {
        let shell = match self.world.item(index) {
            Item::Box(shell) => shell,
            Item::Copy(number) => {
                let width = ConeWidth { start: 0.0, growth: 0.0 };
                if let Some(segment) = self.world.copies.segment(number, ray, t1, width) {
                    counts.boxes += 1;
                    let coords = |hit: &CopyHit| SurfaceCoords::of_copy(hit, 0.0);
                    let (rank, opacity_scale) = (segment.rank, segment.march.opacity_scale);
                    let layer = LayerSpace { rank, opacity_scale, ..LayerSpace::default() };
                    each(&segment.hit, Space { to_cell: &segment.to_texel, coords: &coords, layer });
                }
                return;
            }
        };
        let tolerance = |_: f64, _: &DMat3| STRAY;
        shell.spans(ray, 0.0, t1, |from, to| {
            counts.boxes += 1;
            for (number, layer) in (0..).zip(self.world.layers_of(index)) {
                let opacity_scale = layer.layer.opacity_scale as f32;
                let of_layer = LayerSpace { number, rank: layer.rank, opacity_scale };
                shell.for_each_segment(ray, from, to, &tolerance, &mut |segment| {
                    let coords = |_: &CopyHit| SurfaceCoords::of_layer(segment, layer, 0.0);
                    layer.for_each_chord(segment, &tolerance, &mut |chord| {
                        let space = Space { to_cell: &chord.to_texel, coords: &coords, layer: of_layer };
                        layer.for_each_copy(chord, &mut |hit| each(hit, space))
                    })
                });
            }
        });
    }

    /// Light that leaves the surface against `ray`. Where it is looked for goes with the place of the sample.
    fn radiance(&self, ray: &Ray, met: &Intersection, place: Place, counts: &mut Counts) -> Vec3 {
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
                let dir = place.towards(incident.dir, incident.radius);
                let open = self.open(origin, dir, incident.distance, start, counts);
                light += reflected * incident.irradiance * (open * std::f32::consts::FRAC_1_PI);
            }
        }
        // Light from around, on the side that is seen and on the other.
        let sides = [(seen.albedo, seen.normal, seen.lifted), (seen.transmission, -seen.normal, seen.lifted_behind())];
        for (share, normal, origin) in sides.into_iter().filter(|side| side.0 != Vec3::ZERO) {
            let surround = &self.world.surround;
            light += share
                * seen.ambient
                * if self.options.ambient == Ambient::Occluded {
                    let dir = towards_sky(normal, point(place.index, !place.set));
                    self.open(origin, dir, f64::INFINITY, start, counts) * surround.radiance(dir)
                } else {
                    surround.light.irradiance(&of_normal(normal))
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

    /// The share of light that comes from `distance` away.
    fn open(&self, from: DVec3, dir: DVec3, distance: f64, start: SelfHit, counts: &mut Counts) -> f32 {
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
            self.copies(index, &ray, t1, counts, &mut |hit, Space { layer, .. }| {
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

/// The nearest contact before t1, a contact of alpha a being there with chance a, where facets' opacity is scaled.
fn solid(mesh: &Mesh, model: &Model, ray: &Ray, t1_and_scale: (f64, f32), seed: u32) -> Option<Contact> {
    let mut blended = Vec::new();
    let opaque = mesh.nearest_scaled(model, ray, t1_and_scale, |_| 0.0, &mut blended);
    let there = blended.into_iter().filter(|surface| chance(surface.triangle, seed) < f64::from(surface.alpha));
    there.chain(opaque).min_by(|a, b| a.t.total_cmp(&b.t))
}

/// A direction about `normal`, by the cosine.
fn towards_sky(normal: DVec3, [u, v]: [f64; 2]) -> DVec3 {
    let (tangent, other) = normal.any_orthonormal_pair();
    let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
    let radius = u.sqrt();
    (radius * cos * tangent + radius * sin * other + (1.0 - u).sqrt() * normal).normalize()
}
