//! Visibility of cards (triangles with alpha masks or alpha maps, such as leaves) within one pixel, by fine rays.
//!
//! Based on: L. Carpenter, *The A-buffer*, SIGGRAPH 1984 (visibility is sampled at many points of a pixel, shading once per surface).
//!
//! The mean alpha of a card over a pixel does not say where in the pixel its opaque parts are, and the leaves of one plant have
//! them in the same places. Multiplying the transmittances of several cards, which is right for independent leaves, therefore covers
//! too much. Where a pixel's cone, or a shadow cone from what it sees, may meet cards, a bundle of fine rays is tested against the
//! cards nearby ([`super::mesh::Bundle`]); a fine ray samples a card's alpha at one point. Other triangles are seen by the cone's own
//! ray. Each triangle that fine rays see is shaded once, and from each point where it is seen a fine ray goes to the light.

use std::collections::BTreeMap;

use super::camera::Cone;
use super::events::FineHit;
use super::lane::{FineRays, Lane, REACH};
use super::light::PunctualLight;
use super::mesh::{Bundle, Contact};
use super::pixel::Tracer;
use super::prepare::World;
use super::shadow::{SelfHit, ShadowCone};
use crate::geom::{DVec3, Ray};

/// Number of fine rays per pixel, and the number where all cards of the scene are seen in few pixels, whose errors cannot average out.
const RAYS: u32 = 64;
const RAYS_OF_SMALL: u32 = 256;
/// Cards count as seen in few pixels if the diagonal of the box around all of them is shorter than this, in pixels.
const SMALL: f64 = 32.0;
/// Most surfaces that are lit in a pixel, and how many of them are the largest ones, which keep all their hits.
pub const MAX_LIT: usize = 16;
const LARGEST: usize = 8;
/// Least distance of a hit from the start of a shadow ray, which keeps the ray from hitting its own surface.
const MIN_DISTANCE: f64 = 1e-9;

/// A point of a surface from which a fine shadow ray starts.
#[derive(Clone, Copy)]
pub struct LitPlace {
    /// Offset from the point at which the surface as a whole is lit.
    offset: DVec3,
    ray: u32,
    /// Share of the lane that is seen here.
    pub weight: f32,
}

impl Tracer<'_> {
    /// Intersect the lane's cone with the scene's meshes. Returns the nearest opaque contact, the fine rays if they were used, and the
    /// distance beyond which nothing is seen. Blended surfaces before that contact are put into `lists.blended`. Where fine rays are
    /// used, all that they see is put there, and no opaque contact is returned.
    pub(super) fn meet_meshes(&mut self, lane: Lane, cone: &Cone) -> (Option<Contact>, Option<FineRays>, f64) {
        let (world, mesh) = (self.world, &self.world.mesh);
        let blended = &mut self.lists.blended;
        let last = mesh.nearest_but_cards(&world.scene.model, &cone.ray, |t| cone.width_at(t), blended);
        let end = last.map_or(f64::INFINITY, |c| c.t);
        if !self.cards_matter(cone, last.as_ref(), end) {
            return (last, None, end);
        }
        let around = mesh.cards_bounds();
        let far = (around.centre() - cone.ray.origin).dot(cone.ray.dir);
        let is_small = around.size().length() < SMALL * cone.width_at(far.max(0.0));
        let rays = FineRays { lane, all: if is_small { RAYS_OF_SMALL } else { RAYS } };
        let end = self.gather_cards(rays, cone, last);
        (None, Some(rays), end)
    }

    /// Whether a card may lie in the cone before `end`, or in a shadow cone from `surface`, the opaque contact there.
    fn cards_matter(&self, cone: &Cone, surface: Option<&Contact>, end: f64) -> bool {
        let (world, mesh) = (self.world, &self.world.mesh);
        if mesh.are_cards_near(&cone.ray, end, |t| REACH * cone.width_at(t)) {
            return true;
        }
        let Some(contact) = surface.filter(|_| mesh.has_cards() && self.options.shadows) else { return false };
        let place = mesh.place(&world.scene.model, &cone.ray, contact);
        let width = cone.width_at(contact.t) / place.normal.dot(cone.ray.dir).abs().max(0.05);
        world.lights.iter().filter_map(|light| light.incident(place.point)).any(|incident| {
            let ray = Ray { origin: place.lifted, dir: incident.dir };
            let reach = |t: f64| REACH * width + incident.radius * t;
            place.normal.dot(incident.dir) > 0.0 && mesh.are_cards_near(&ray, incident.distance, reach)
        })
    }

    /// Intersect the lane's fine rays with cards and with the other surfaces that the cone's own ray meets, which are in `lists.blended`
    /// and `last`. The visible surfaces replace `lists.blended`, each with an alpha by which compositing gives it its share of the lane;
    /// `lists.places` holds the hits of each. Returns the distance beyond which nothing is seen.
    fn gather_cards(&mut self, rays: FineRays, cone: &Cone, last: Option<Contact>) -> f64 {
        let world = self.world;
        let count = rays.lane.share(rays.all);
        let mut bundle = Bundle::of_camera(cone.ray);
        let mut seen = std::mem::take(&mut self.lists.rays);
        seen.clear();
        seen.extend(rays.lane.fine(&world.view, world.unit, rays.all));
        let mut sheets = std::mem::take(&mut self.lists.blended);
        sheets.extend(last);
        for ray in &seen {
            bundle.push(ray, 0.0, last.map_or(f64::INFINITY, |c| world.mesh.on_plane(&c, ray).t));
        }
        // For each ray its nearest opaque contact, and all blended contacts.
        let mut nearest: Vec<Option<(f64, Contact)>> = vec![None; seen.len()];
        let mut some: Vec<(u32, Contact)> = Vec::new();
        world.mesh.cards_along(&world.scene.model, &bundle, None, |hit| {
            if hit.contact.alpha < 1.0 {
                some.push((hit.ray as u32, hit.contact));
            } else if nearest[hit.ray].is_none_or(|(depth, _)| hit.depth < depth) {
                nearest[hit.ray] = Some((hit.depth, hit.contact));
            }
        });
        for sheet in &sheets {
            some.extend(seen.iter().enumerate().map(|(k, ray)| (k as u32, world.mesh.on_plane(sheet, ray))));
        }
        some.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.t.total_cmp(&b.1.t)));
        let mut hits = std::mem::take(&mut self.lists.fine);
        hits.clear();
        let mut open = 0.0;
        let mut rest = &some[..];
        for (ray, nearest) in nearest.iter().enumerate() {
            let own = rest.partition_point(|(k, _)| *k == ray as u32);
            let (before, later) = rest.split_at(own);
            rest = later;
            let end = nearest.map_or(f64::INFINITY, |(_, c)| c.t);
            let before = before.iter().map(|(_, c)| *c).filter(|c| c.t < end);
            let mut through = 1.0 / count as f32;
            for contact in before.chain(nearest.map(|(_, c)| c)) {
                let weight = through * contact.alpha;
                through -= weight;
                if weight > 0.0 {
                    hits.push(FineHit { contact, weight, ray: ray as u32 });
                }
            }
            open += through;
        }
        let mut surfaces = surfaces(&mut hits);
        surfaces.sort_by(|a, b| a.0.t.total_cmp(&b.0.t));
        let mut left = 1.0f32;
        let mut end = 0.0f64;
        sheets.clear();
        self.lists.places.clear();
        for (mut contact, range) in surfaces {
            let weight: f32 = hits[range.clone()].iter().map(|h| h.weight).sum();
            contact.alpha = weight / left.max(weight);
            left -= weight;
            // Distances are made distinct, since events at one distance would share the light that they stop.
            contact.t = contact.t.max(end.next_up());
            end = contact.t;
            sheets.push(contact);
            self.lists.places.push(range);
        }
        if open < 1e-4
            && let Some(last) = sheets.last_mut()
        {
            last.alpha = 1.0;
        }
        self.lists.fine = hits;
        self.lists.blended = sheets;
        self.lists.rays = seen;
        if open < 1e-4 { end.next_up() } else { f64::INFINITY }
    }

    /// Share of the lane in which the gathered surface `index` is seen.
    pub(super) fn seen_share(&self, index: usize) -> f32 {
        let hits = self.lists.places.get(index).and_then(|range| self.lists.fine.get(range.clone()));
        hits.into_iter().flatten().map(|h| h.weight).sum()
    }

    /// The points at which the gathered surface `index` is seen; `point` is their mean.
    pub(super) fn lit_places(&self, point: DVec3, index: usize) -> Vec<LitPlace> {
        let hits = self.lists.places.get(index).and_then(|range| self.lists.fine.get(range.clone()));
        let place = |hit: &FineHit| {
            let at = self.lists.rays.get(hit.ray as usize).map_or(point, |ray| ray.at(hit.contact.t));
            LitPlace { offset: at - point, ray: hit.ray, weight: hit.weight }
        };
        hits.into_iter().flatten().map(place).collect()
    }
}

/// Mean transmittance of meshes between a light and points of one surface; `cone` is the shadow cone from the surface as a whole.
pub fn mesh_transmittance_to_places(
    world: &World<'_>,
    rays: FineRays,
    places: &[LitPlace],
    light: &PunctualLight,
    cone: &ShadowCone,
) -> f32 {
    let towards = |place: &LitPlace| {
        let origin = cone.ray.origin + place.offset;
        let incident = light.incident(origin)?;
        let dir = rays.lane.sample(place.ray, rays.all).towards(incident.dir, incident.radius);
        Some((Ray { origin, dir }, incident.distance, place.weight))
    };
    let to_light: Vec<(Ray, f64, f32)> = places.iter().filter_map(towards).collect();
    let model = &world.scene.model;
    let skip = SelfHit::mesh_triangle(cone.start);
    let mut bundle = Bundle::new(cone.ray);
    to_light.iter().for_each(|(ray, end, _)| bundle.push(ray, MIN_DISTANCE, *end));
    let mut through: Vec<f32> = to_light.iter().map(|(.., weight)| *weight).collect();
    world.mesh.cards_along(model, &bundle, skip, |hit| through[hit.ray] *= 1.0 - hit.contact.alpha);
    let (all, through) = (to_light.iter().map(|(.., weight)| weight).sum::<f32>(), through.iter().sum::<f32>());
    if all <= 0.0 {
        return 1.0;
    }
    if through <= 0.0 || world.mesh.is_all_cards() {
        return through / all;
    }
    // Shadows of other triangles are large, so that fewer rays are enough for them.
    let per_ray = if cone.growth > 0.0 { 4 } else { 16 };
    let chosen = to_light.iter().skip(per_ray / 2 % to_light.len()).step_by(per_ray);
    let (mut open, mut sum) = (0.0, 0.0);
    for (ray, end, weight) in chosen {
        open += weight * world.mesh.transmittance_but_cards(model, ray, *end, skip);
        sum += weight;
    }
    through / all * (open / sum)
}

/// Sort hits by triangle; returns for each triangle its mean contact and its range of hits.
fn surfaces(hits: &mut Vec<FineHit>) -> Vec<(Contact, std::ops::Range<usize>)> {
    thin_out(hits);
    hits.sort_by_key(|h| (h.contact.triangle, h.ray));
    let mut from = 0;
    let chunks = hits.chunk_by(|a, b| a.contact.triangle == b.contact.triangle);
    let ranges = chunks.filter_map(|chunk| {
        let range = from..from + chunk.len();
        from = range.end;
        Some((Contact::mean(chunk.iter().map(|h| (h.weight, &h.contact)), 1.0)?, range))
    });
    ranges.collect()
}

/// Reduce the hits to at most [`MAX_LIT`] triangles. The largest triangles keep their hits. Of the others a few hits are chosen, evenly
/// spread over the pixel and with a probability in proportion to their weight, and get equal weights.
fn thin_out(hits: &mut Vec<FineHit>) {
    const OTHERS: usize = MAX_LIT - LARGEST;
    let mut sizes: BTreeMap<u32, f32> = BTreeMap::new();
    hits.iter().for_each(|h| *sizes.entry(h.contact.triangle).or_default() += h.weight);
    if sizes.len() <= MAX_LIT {
        return;
    }
    let mut largest: Vec<(u32, f32)> = sizes.into_iter().collect();
    largest.sort_by(|a, b| b.1.total_cmp(&a.1));
    largest.truncate(LARGEST);
    let is_large = |h: &FineHit| largest.iter().any(|(triangle, _)| *triangle == h.contact.triangle);
    let (mut kept, others): (Vec<FineHit>, Vec<FineHit>) = hits.iter().partition(|h| is_large(h));
    let weight = others.iter().map(|h| h.weight).sum::<f32>() / OTHERS as f32;
    let (mut sum, mut count) = (0.0, 0);
    for hit in &others {
        sum += hit.weight;
        // The thresholds are jittered, or the first hit of a ray would be chosen too often.
        let place = |k: usize| k as f32 + ((k as u32).reverse_bits() >> 28) as f32 / 16.0 + 0.5 / 16.0;
        while count < OTHERS && sum > place(count) * weight {
            kept.push(FineHit { weight, ..*hit });
            count += 1;
        }
    }
    *hits = kept;
}
