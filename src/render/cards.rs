//! Cards in a pixel: triangles whose masks or alpha maps lie one before the other.
//!
//! Based on: L. Carpenter, *The A-buffer*, SIGGRAPH 1984 (what is seen is found at many points of a pixel, how it is lit
//! once a surface).
//!
//! The share of a pixel that a mask lets be there does not say where in the pixel, and leaves of one plant have their dense
//! parts in the same places. So the product of their gaps, right for leaves that know nothing of one another, covers too much.
//! Where a pixel's cone may meet cards, or the cone from what it sees towards a light, a bundle of fine rays is tested against
//! the cards that are near ([`super::mesh::Bundle`]); each card is there or not where a fine ray meets it. All else is seen by
//! the cone's own ray. What fine rays see of one triangle is lit once, and from each place where it is seen a fine ray goes
//! to the light.

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

/// Fine rays of a pixel, and where all cards of the scene are seen in few pixels, so that what is off in one is not made up for by
/// others.
const RAYS: u32 = 64;
const RAYS_OF_SMALL: u32 = 256;
/// How many pixels cards are small in: the length of the diagonal of the box around them.
const SMALL: f64 = 32.0;
/// Largest number of surfaces that are lit in a pixel, and of those of them that are the largest and are lit as a whole.
pub const MOST_LIT: usize = 16;
const LARGEST: usize = 8;
/// Distance from which on a ray meets other things than what it starts on.
const BEGIN: f64 = 1e-9;

/// A place of a surface from which a light is looked for.
#[derive(Clone, Copy)]
pub struct LitPlace {
    /// From where the surface as a whole is lit.
    offset: DVec3,
    ray: u32,
    /// Share of the lane that is seen here.
    pub weight: f32,
}

impl Tracer<'_> {
    /// What the lane's cone meets of the scene's meshes: the nearest surface that lets nothing through, and in `lists.blended` what
    /// lets light through before it. Where cards are near, all that fine rays see is there instead, and no surface is left. Returns
    /// the distance, too, behind which nothing is seen.
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

    /// Whether the cone may meet a card before `end`, or one from the surface there towards a light.
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

    /// Find what the lane's fine rays see of the scene's meshes, of which the cone's own ray meets what is in `lists.blended` and
    /// `last`, and no cards: surfaces, as if each let some light through, and of each the places that are seen. Returns the
    /// distance behind which nothing is seen.
    fn gather_cards(&mut self, rays: FineRays, cone: &Cone, last: Option<Contact>) -> f64 {
        let world = self.world;
        let count = rays.lane.share(rays.all);
        let mut bundle = Bundle::new(cone.ray);
        let mut seen = std::mem::take(&mut self.lists.rays);
        seen.clear();
        seen.extend(rays.lane.fine(&world.view, world.unit, rays.all));
        let mut sheets = std::mem::take(&mut self.lists.blended);
        sheets.extend(last);
        for ray in &seen {
            bundle.push(ray, 0.0, last.map_or(f64::INFINITY, |c| world.mesh.on_plane(&c, ray).t));
        }
        // Of each ray the nearest contact that lets nothing through, and all that let some through.
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
            // In no place with another, or else they would share what they stop.
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

    /// Share of the lane in which surface `index` of those that were gathered is seen.
    pub(super) fn seen_share(&self, index: usize) -> f32 {
        let hits = self.lists.places.get(index).and_then(|range| self.lists.fine.get(range.clone()));
        hits.into_iter().flatten().map(|h| h.weight).sum()
    }

    /// Where surface `index` of those that were gathered is seen; `point` is the mean of that.
    pub(super) fn lit_places(&self, point: DVec3, index: usize) -> Vec<LitPlace> {
        let hits = self.lists.places.get(index).and_then(|range| self.lists.fine.get(range.clone()));
        let place = |hit: &FineHit| {
            let at = self.lists.rays.get(hit.ray as usize).map_or(point, |ray| ray.at(hit.contact.t));
            LitPlace { offset: at - point, ray: hit.ray, weight: hit.weight }
        };
        hits.into_iter().flatten().map(place).collect()
    }
}

/// The share of a light that comes through meshes to places of one surface, in the mean; `cone` is from the surface as a whole.
pub fn openness(
    world: &World<'_>,
    rays: FineRays,
    places: &[LitPlace],
    light: &PunctualLight,
    cone: &ShadowCone,
) -> f32 {
    let towards = |place: &LitPlace| {
        let origin = cone.ray.origin + place.offset;
        let incident = light.incident(origin)?;
        let dir = rays.lane.place(place.ray, rays.all).towards(incident.dir, incident.radius);
        Some((Ray { origin, dir }, incident.distance, place.weight))
    };
    let to_light: Vec<(Ray, f64, f32)> = places.iter().filter_map(towards).collect();
    let model = &world.scene.model;
    let skip = SelfHit::mesh_triangle(cone.start);
    let mut bundle = Bundle::new(cone.ray);
    to_light.iter().for_each(|(ray, end, _)| bundle.push(ray, BEGIN, *end));
    let mut through: Vec<f32> = to_light.iter().map(|(.., weight)| *weight).collect();
    world.mesh.cards_along(model, &bundle, skip, |hit| through[hit.ray] *= 1.0 - hit.contact.alpha);
    let (all, through) = (to_light.iter().map(|(.., weight)| weight).sum::<f32>(), through.iter().sum::<f32>());
    if all <= 0.0 {
        return 1.0;
    }
    if through <= 0.0 || world.mesh.is_all_cards() {
        return through / all;
    }
    // What is solid has large shadows: fewer rays are enough.
    let per_ray = if cone.growth > 0.0 { 4 } else { 16 };
    let chosen = to_light.iter().skip(per_ray / 2 % to_light.len()).step_by(per_ray);
    let (mut open, mut sum) = (0.0, 0.0);
    for (ray, end, weight) in chosen {
        open += weight * world.mesh.transmittance_but_cards(model, ray, *end, skip);
        sum += weight;
    }
    through / all * (open / sum)
}

/// Sort by triangle, and find each one's range and mean contact.
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

/// Where hits are of more triangles than are lit, leave those of the largest, and of the others as many hits of equal weight as may
/// be lit besides, chosen evenly over the pixel by weight.
fn thin_out(hits: &mut Vec<FineHit>) {
    const OTHERS: usize = MOST_LIT - LARGEST;
    let mut sizes: BTreeMap<u32, f32> = BTreeMap::new();
    hits.iter().for_each(|h| *sizes.entry(h.contact.triangle).or_default() += h.weight);
    if sizes.len() <= MOST_LIT {
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
        // The places among the hits are apart from where rays begin, or else the first hit of a ray would be chosen.
        let place = |k: usize| k as f32 + ((k as u32).reverse_bits() >> 28) as f32 / 16.0 + 0.5 / 16.0;
        while count < OTHERS && sum > place(count) * weight {
            kept.push(FineHit { weight, ..*hit });
            count += 1;
        }
    }
    *hits = kept;
}
