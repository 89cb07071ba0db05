//! One sample: the nearest surface along a ray, of the scene's meshes or of a texel's source in a shell, and its light.

use crate::geom::{DMat3, DVec3, Ray, Vec3};
use crate::render::cells::Visit;
use crate::render::mesh::{Contact, Mesh, Surface};
use crate::render::options::{Ambient, Options};
use crate::render::passage::Start;
use crate::render::prepare::World;
use crate::render::shell::Piece;
use crate::render::source::Source;
use crate::render::stats::Counts;
use crate::scene::Model;

use super::sampling::{chance, hash, point};

/// How far a straight piece may stray from the true path through a curved box, in edges of the texel's cube.
const STRAY: f64 = 1e-4;

pub struct Tracer<'a> {
    pub world: &'a World<'a>,
    pub sources: &'a [Option<Source>],
    pub options: &'a Options,
}

/// What a ray met.
struct Met<'a> {
    t: f64,
    contact: Contact,
    /// Of a texel's copy; `None` for a mesh of the scene.
    copy: Option<Copied<'a>>,
}

/// A copy of a texel's source, where a ray runs through it.
struct Copied<'a> {
    source: &'a Source,
    texel: usize,
    cell: [i64; 3],
    /// In texel space, from where the ray entered at `t0`.
    ray: Ray,
    t0: f64,
    /// The renderer's space → texel space.
    to_texel: DMat3,
    diffuse: Vec3,
}

impl<'a> Tracer<'a> {
    /// Radiance and cover of sample `index` of pixel (x, y). Even and odd samples are two sets of points, drawn apart.
    pub fn sample(&self, x: u32, y: u32, index: u32, counts: &mut Counts) -> [f32; 4] {
        let (set, place) = (hash(x ^ hash(y ^ hash(index & 1))), index >> 1);
        let [dx, dy] = point(place, set);
        let cone = self.world.view.cone(f64::from(x) + dx, f64::from(y) + dy, self.world.unit);
        counts.cones += 1;
        let seed = hash(set ^ hash(place));
        match self.nearest(&cone.ray, seed, counts) {
            Some(met) => {
                let [r, g, b] = self.radiance(&cone.ray, &met, point(place, !set), counts).to_array();
                [r, g, b, 1.0]
            }
            None => {
                let [r, g, b] = self.world.background.to_array();
                [r, g, b, 0.0]
            }
        }
    }

    /// The nearest surface; one that lets a share of light through is there by that chance.
    fn nearest(&self, ray: &Ray, seed: u32, counts: &mut Counts) -> Option<Met<'a>> {
        let world = self.world;
        let mut best = solid(&world.mesh, &world.scene.model, ray, f64::INFINITY, seed).map(|contact| Met {
            t: contact.t,
            contact,
            copy: None,
        });
        let limit = best.as_ref().map_or(f64::INFINITY, |met| met.t);
        world.shells.nearest(ray, limit, |index, limit| {
            let mut end = limit;
            self.copies(index, ray, limit, counts, &mut |visit, piece, layer| {
                if visit.t0 >= end {
                    return false;
                }
                let Some(Some(source)) = self.sources.get(visit.texel) else { return true };
                let inside = Ray { origin: visit.origin, dir: visit.dir };
                let seed = seed ^ hash(visit.cell[0] as u32 ^ hash(visit.cell[1] as u32 ^ hash(visit.cell[2] as u32)));
                let until = visit.t1.min(end) - visit.t0;
                let Some(contact) = solid(&source.mesh, &source.model, &inside, until, seed) else { return true };
                end = visit.t0 + contact.t;
                let copy = Copied {
                    source,
                    texel: visit.texel,
                    cell: visit.cell,
                    ray: inside,
                    t0: visit.t0,
                    to_texel: visit.linear * layer.scale * piece.to_texel,
                    diffuse: visit.tint,
                };
                best = Some(Met { t: end, contact, copy: Some(copy) });
                false
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
        each: &mut dyn FnMut(&Visit, &Piece, &Placing) -> bool,
    ) {
        let Some(shell) = self.world.boxes.get(index as usize) else {
            let copy = self.world.copy(index);
            if let Some((copy, (from, to))) = copy.and_then(|copy| Some((copy, copy.span(ray, t1)?))) {
                counts.boxes += 1;
                let (q0, to_texel) = (DVec3::ZERO, copy.to_texel.matrix3);
                let piece = Piece { t0: from, t1: to, q0, q1: q0, to_texel };
                each(&copy.visit(ray, from, to), &piece, &Placing { scale: DMat3::IDENTITY });
            }
            return;
        };
        let tolerance = |_: f64, _: &DMat3| STRAY;
        shell.spans(ray, 0.0, t1, |from, to| {
            counts.boxes += 1;
            for skin in self.world.skins_of(index) {
                let scale = DVec3::from_array(skin.layer.scale);
                let offset = DVec3::from_array(skin.layer.offset);
                let placing = Placing { scale: DMat3::from_diagonal(scale) };
                shell.pieces(ray, from, to, &tolerance, &mut |piece| {
                    let placed = Piece { q0: piece.q0 * scale + offset, q1: piece.q1 * scale + offset, ..*piece };
                    skin.walk(&placed, &mut |visit| each(visit, piece, &placing))
                });
            }
        });
    }

    /// Light that leaves the surface against `ray`. `sky` chooses the direction in which the sky is looked for.
    fn radiance(&self, ray: &Ray, met: &Met, sky: [f64; 2], counts: &mut Counts) -> Vec3 {
        let seen = self.surface(ray, met);
        if seen.unlit {
            return seen.albedo;
        }
        let start =
            Start { triangle: met.contact.triangle, copy: met.copy.as_ref().map(|copy| (copy.texel, copy.cell)) };
        let mut light = Vec3::ZERO;
        for sight in self.world.lamps.iter().filter_map(|lamp| lamp.sight(seen.lifted)) {
            let cosine = seen.normal.dot(sight.dir) as f32;
            if cosine > 0.0 {
                let open = self.open(seen.lifted, sight.dir, sight.distance, start, counts);
                light += sight.irradiance * (cosine * open * std::f32::consts::FRAC_1_PI);
            }
        }
        let open = if self.options.ambient == Ambient::Occluded {
            self.open(seen.lifted, towards_sky(seen.normal, sky), f64::INFINITY, start, counts)
        } else {
            1.0
        };
        seen.albedo * (light + open * self.world.sky)
    }

    fn surface(&self, ray: &Ray, met: &Met) -> Surface {
        let Some(copy) = &met.copy else {
            return self.world.mesh.surface(&self.world.scene.model, ray, &met.contact, 0.0);
        };
        let surface = copy.source.surface(ray, copy.t0, &copy.ray, &met.contact, &copy.to_texel, 0.0);
        Surface { albedo: surface.albedo * copy.diffuse, ..surface }
    }

    /// The share of light that comes from `distance` away.
    fn open(&self, from: DVec3, dir: DVec3, distance: f64, start: Start, counts: &mut Counts) -> f32 {
        if !self.options.shadows {
            return 1.0;
        }
        counts.shadow_rays += 1;
        let (world, ray) = (self.world, Ray { origin: from, dir });
        let start = Some(start);
        let mut through = world.mesh.transmittance(&world.scene.model, &ray, distance, Start::plain(start), 0.0);
        if through <= 0.0 {
            return 0.0;
        }
        world.shells.nearest(&ray, distance, |index, t1| {
            self.copies(index, &ray, t1, counts, &mut |visit, _, _| {
                if through <= 0.0 {
                    return false;
                }
                let Some(Some(source)) = self.sources.get(visit.texel) else { return true };
                let inside = Ray { origin: visit.origin, dir: visit.dir };
                let skip = Start::within(start, visit);
                through *= source.mesh.transmittance(&source.model, &inside, visit.t1 - visit.t0, skip, 0.0);
                through > 0.0
            });
            if through > 0.0 { t1 } else { -1.0 }
        });
        through.max(0.0)
    }
}

/// What a layer makes of its texel.
struct Placing {
    scale: DMat3,
}

/// The nearest contact before `t1`, a contact of alpha a being there with chance a.
fn solid(mesh: &Mesh, model: &Model, ray: &Ray, t1: f64, seed: u32) -> Option<Contact> {
    let mut veils = Vec::new();
    let opaque = mesh.nearest(model, ray, t1, |_| 0.0, &mut veils);
    let there = veils.into_iter().filter(|veil| chance(veil.triangle, seed) < f64::from(veil.alpha));
    there.chain(opaque).min_by(|a, b| a.t.total_cmp(&b.t))
}

/// A direction about `normal`, by the cosine.
fn towards_sky(normal: DVec3, [u, v]: [f64; 2]) -> DVec3 {
    let (tangent, other) = normal.any_orthonormal_pair();
    let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
    let radius = u.sqrt();
    (radius * cos * tangent + radius * sin * other + (1.0 - u).sqrt() * normal).normalize()
}
