//! Cards in a pixel: triangles whose masks or alpha maps lie one before the other.
//!
//! Based on: L. Carpenter, *The A-buffer*, SIGGRAPH 1984 (what is seen is found at many points of a pixel, how it is lit
//! once a surface).
//!
//! The share of a pixel that a mask lets be there does not say where in the pixel, and leaves of one plant have their dense
//! parts in the same places. So the product of their gaps, right for leaves that know nothing of one another, covers too much.
//! Where a pixel's cone may meet cards, or the sun's cone behind it, fine rays through the pixel find what is seen, each
//! by masks a fraction of the pixel wide, or as wide as a point where it meets several, and each sends its own ray to the light.
//! What they see of one triangle is lit once.

use super::camera::Cone;
use super::events::FineHit;
use super::lane::{FineRays, Lane, REACH};
use super::light::PunctualLight;
use super::mesh::{Contact, Place};
use super::pixel::Tracer;
use super::prepare::World;
use crate::geom::{DVec3, Ray};

/// Fine rays of a pixel with few cards, and with many. Few are near, and their picture is the mean over many pixels.
const FEW_RAYS: u32 = 16;
const MANY_RAYS: u32 = 64;
/// From so many cards on they are many.
const MANY: u32 = 12;
/// Largest number of surfaces that are lit in a pixel.
pub const MOST_LIT: usize = 16;

/// A point of a surface from which a light is looked for.
#[derive(Clone, Copy)]
pub struct LitPlace {
    lifted: DVec3,
    triangle: u32,
    ray: u32,
    /// Share of the lane that is seen here.
    pub weight: f32,
}

impl Tracer<'_> {
    /// The fine rays that the lane needs; `None` where neither it nor a light's ray comes near a card. `contact` is what
    /// its cone meets.
    pub(super) fn fine_rays(&self, lane: Lane, cone: &Cone, contact: Option<&Contact>) -> Option<FineRays> {
        let (world, mesh) = (self.world, &self.world.mesh);
        if !mesh.has_cards() {
            return None;
        }
        let near = |t1: f64| mesh.cards_near(&cone.ray, t1, |t| REACH * cone.width_at(t), MANY);
        let mut count = near(f64::INFINITY);
        if let (true, Some(contact)) = (count > 0, contact) {
            // All of it may be hidden.
            let few = FineRays { lane, all: 4 * lane.count };
            let ends = (0..4).map(|k| self.fine_contacts(few, k, cone, &mut Vec::new()).map(|c| c.t));
            if let Some(end) = ends.reduce(|a, b| Some(a?.max(b?))).flatten() {
                count = near(end.max(contact.t));
            }
        }
        if let (true, Some(contact)) = (self.options.shadows && count < MANY, contact) {
            let place = mesh.place(&world.scene.model, &cone.ray, contact);
            let width = cone.width_at(contact.t);
            for incident in world.lights.iter().filter_map(|light| light.incident(place.point)) {
                if place.normal.dot(incident.dir) > 0.0 {
                    let ray = Ray { origin: place.lifted, dir: incident.dir };
                    let reach = |t: f64| REACH * (width + 2.0 * incident.radius * t);
                    count = count.max(mesh.cards_near(&ray, incident.distance, reach, MANY));
                }
            }
        }
        let all = if count < MANY { FEW_RAYS } else { MANY_RAYS };
        (count > 0).then_some(FineRays { lane, all })
    }

    /// What fine ray k meets of the scene's meshes: the opaque surface, and what lets light through before it.
    fn fine_contacts(&self, rays: FineRays, k: u32, cone: &Cone, before: &mut Vec<Contact>) -> Option<Contact> {
        let world = self.world;
        let ray = rays.lane.fine(&world.view, world.unit, k, rays.all).ray;
        let met = |share: f64, before: &mut Vec<Contact>| {
            before.clear();
            world.mesh.nearest(&world.scene.model, &ray, f64::INFINITY, |t| share * cone.width_at(t), before)
        };
        let last = met(rays.narrow(), before);
        if before.len() > 1 { met(0.0, before) } else { last }
    }

    /// Find what the lane's fine rays see of the scene's meshes: surfaces, as if each let some light through, and of each
    /// the places that are seen. Returns the distance behind which nothing is seen.
    pub(super) fn gather_cards(&mut self, rays: FineRays, cone: &Cone) -> f64 {
        let count = rays.lane.share(rays.all);
        let mut hits = std::mem::take(&mut self.lists.fine);
        let mut before = std::mem::take(&mut self.lists.blended);
        hits.clear();
        let mut open = 0.0;
        for k in 0..count {
            let last = self.fine_contacts(rays, k, cone, &mut before);
            before.sort_by(|a, b| a.t.total_cmp(&b.t));
            let mut through = 1.0 / count as f32;
            for contact in before.drain(..).chain(last) {
                let weight = through * contact.alpha;
                through -= weight;
                hits.push(FineHit { contact, weight, ray: k });
            }
            open += through;
        }
        thin_out(&mut hits);
        let mut surfaces = surfaces(&mut hits);
        surfaces.sort_by(|a, b| a.0.t.total_cmp(&b.0.t));
        let mut left = 1.0f32;
        let mut end = 0.0f64;
        self.lists.places.clear();
        for (mut contact, range) in surfaces {
            let weight: f32 = hits[range.clone()].iter().map(|h| h.weight).sum();
            contact.alpha = weight / left.max(weight);
            left -= weight;
            // In no place with another, or else they would share what they stop.
            contact.t = contact.t.max(end.next_up());
            end = contact.t;
            before.push(contact);
            self.lists.places.push(range);
        }
        if open < 1e-4
            && let Some(last) = before.last_mut()
        {
            last.alpha = 1.0;
        }
        self.lists.fine = hits;
        self.lists.blended = before;
        if open < 1e-4 { end.next_up() } else { f64::INFINITY }
    }

    /// Where surface `index` of those that were gathered is seen, ready for rays to lights.
    pub(super) fn lit_places(&self, rays: FineRays, index: usize) -> Vec<LitPlace> {
        let world = self.world;
        let hits = self.lists.places.get(index).and_then(|range| self.lists.fine.get(range.clone()));
        let place = |hit: &FineHit| {
            let ray = rays.lane.fine(&world.view, world.unit, hit.ray, rays.all).ray;
            let Place { lifted, .. } = world.mesh.place(&world.scene.model, &ray, &hit.contact);
            LitPlace { lifted, triangle: hit.contact.triangle, ray: hit.ray, weight: hit.weight }
        };
        hits.into_iter().flatten().map(place).collect()
    }
}

/// The share of a light that comes through meshes to places of one surface, in the mean; `width` is that of the pixel.
pub fn openness(world: &World<'_>, rays: FineRays, places: &[LitPlace], light: &PunctualLight, width: f64) -> f32 {
    let (mut sum, mut all) = (0.0, 0.0);
    let width = rays.narrow() * width;
    for place in places {
        let Some(incident) = light.incident(place.lifted) else { continue };
        let mut dir = incident.dir;
        if incident.radius > 0.0 {
            let [u, v] = rays.lane.point(place.ray, rays.all, 1);
            let (across, other) = dir.any_orthonormal_pair();
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * v);
            dir = (dir + libm::tan(incident.radius) * u.sqrt() * (cos * across + sin * other)).normalize();
        }
        let ray = Ray { origin: place.lifted, dir };
        let skip = Some(place.triangle);
        sum += place.weight
            * world.mesh.transmittance_of_overlapping(&world.scene.model, &ray, incident.distance, skip, width);
        all += place.weight;
    }
    if all > 0.0 { sum / all } else { 1.0 }
}

/// Sort by triangle, and find each one's range and mean contact.
fn surfaces(hits: &mut [FineHit]) -> Vec<(Contact, std::ops::Range<usize>)> {
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

/// Where hits are of more triangles than are lit, leave that many hits of equal weight, chosen evenly over the pixel by weight.
fn thin_out(hits: &mut Vec<FineHit>) {
    let mut triangles: Vec<u32> = hits.iter().map(|h| h.contact.triangle).collect();
    triangles.sort_unstable();
    triangles.dedup();
    if triangles.len() <= MOST_LIT {
        return;
    }
    let all: f32 = hits.iter().map(|h| h.weight).sum();
    let weight = all / MOST_LIT as f32;
    let (mut sum, mut kept) = (0.0, Vec::with_capacity(MOST_LIT));
    for hit in hits.iter() {
        sum += hit.weight;
        // The places among the hits are apart from where rays begin, or else the first hit of a ray would be chosen.
        let place = |k: usize| k as f32 + ((k as u32).reverse_bits() >> 28) as f32 / 16.0 + 0.5 / 16.0;
        while kept.len() < MOST_LIT && sum > place(kept.len()) * weight {
            kept.push(FineHit { weight, ..*hit });
        }
    }
    *hits = kept;
}
