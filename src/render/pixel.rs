//! One cone: the nearest surface, and before it every copy of a texel in order of depth.
//!
//! Boxes may overlap (trees that stand close): each box's ray is marched on its own, which keeps its matter together, and
//! what voxels stop light is then merged by depth, each as a share of the light that reaches it. So two boxes in one place
//! interleave voxel by voxel, and the transmittance is the product of theirs.

use std::f32::consts::FRAC_1_PI;

use super::bvh::{Pending, Sweep};
use super::camera::Cone;
use super::cells::Visit;
use super::mesh::{Contact, Surface};
use super::options::{Ambient, Options};
use super::passage::{ShadowCone, Start, Stretched, passage};
use super::prepare::World;
use super::sky::sky_cones;
use super::stats::Counts;
use super::trace::{Met, Trace};
use crate::geom::{DMat3, DVec3, Ray, Vec3};
use crate::march::shade::{Group, Shader};
use crate::march::transmittance::{DepthChoice, Hit, OPAQUE_BELOW, Sink, march};
use crate::volume::Voxel;

/// What stops part of the light, at a depth along the ray.
#[derive(Clone, Copy)]
struct Event {
    t: f64,
    /// Share of the light reaching it that it stops.
    alpha: f32,
    source: Source,
}

#[derive(Clone, Copy)]
enum Source {
    Voxel {
        frame: u32,
        voxel: Voxel,
        depth: u8,
        t: f32,
        position: Vec3,
    },
    /// A triangle of a copy's source.
    Near {
        frame: u32,
        contact: Contact,
    },
    Veil(u32),
}

/// A copy of a texel that the ray passes.
struct Frame {
    texel: usize,
    tint: Vec3,
    t0: f64,
    cell: [i64; 3],
    /// The ray in texel space, from t0 on.
    inside: Ray,
    /// World → texel, the linear part.
    to_texel: DMat3,
    /// Cube edges in a unit of length across the ray.
    scale: f64,
}

/// An interval of the ray in one layer of a box, or a veil, waiting for its turn.
#[derive(Clone, Copy)]
struct Span {
    t0: f64,
    t1: f64,
    what: What,
}

#[derive(Clone, Copy)]
enum What {
    Box { index: u32, layer: u32 },
    Veil(u32),
}

/// Traces cones for one thread; keeps its lists from cone to cone.
pub struct Tracer<'w> {
    pub world: &'w World<'w>,
    pub options: &'w Options,
    pub counts: Counts,
    pub trace: Option<Trace>,
    /// Set where a texel's source was traced; also where the ray missed it, or else edges would be drawn too light.
    pub near: bool,
    heap: Vec<Pending>,
    spans: Vec<Span>,
    events: Vec<Event>,
    frames: Vec<Frame>,
    veils: Vec<Contact>,
    /// Contacts in one copy's source.
    contacts: Vec<Contact>,
    groups: Vec<Group>,
    lights: Vec<Vec3>,
}

/// Light that a cone gathers, front to back.
#[derive(Default)]
struct Sum {
    radiance: Vec3,
    /// Light too faint to be worth a shadow ray.
    faint: Vec3,
    /// Of the light that was tested: how much came through, and how much there was.
    seen: f32,
    tested: f32,
}

/// Contributions below this, where the display's white is 1, are not tested for shadows.
const FAINT: f32 = 1.0 / 256.0;

impl<'w> Tracer<'w> {
    pub fn new(world: &'w World<'w>, options: &'w Options) -> Tracer<'w> {
        Tracer {
            world,
            options,
            counts: Counts::default(),
            trace: None,
            near: false,
            heap: Vec::new(),
            spans: Vec::new(),
            events: Vec::new(),
            frames: Vec::new(),
            veils: Vec::new(),
            contacts: Vec::new(),
            groups: Vec::new(),
            lights: Vec::new(),
        }
    }

    fn tell(&mut self, met: impl FnOnce() -> Met) {
        if let Some(trace) = &mut self.trace {
            trace.push(met());
        }
    }

    /// Radiance with the background behind, and the share of the pixel that is not background. `threshold` in [0, 1)
    /// chooses between two depths.
    pub fn cone(&mut self, cone: &Cone, threshold: f32) -> (Vec3, f32) {
        let world = self.world;
        self.counts.cones += 1;
        self.frames.clear();
        self.events.clear();
        self.spans.clear();
        self.veils.clear();
        let width_at = |t: f64| cone.width_at(t);
        let contact = world.mesh.nearest(&world.scene.model, &cone.ray, f64::INFINITY, width_at, &mut self.veils);
        let end = contact.map_or(f64::INFINITY, |c| c.t);
        for (i, veil) in self.veils.iter().enumerate() {
            self.spans.push(Span { t0: veil.t, t1: veil.t, what: What::Veil(i as u32) });
        }
        let mut sum = Sum::default();
        let mut through = 1.0;
        let mut heap = std::mem::take(&mut self.heap);
        let mut sweep = Sweep::new(&world.shells, &cone.ray, end, &mut heap);
        while through > OPAQUE_BELOW {
            let spans = &mut self.spans;
            let mut first = nearest(spans);
            while sweep.next_enter() < first.map_or(f64::INFINITY, |i| spans[i].t0) {
                sweep.step(|index| {
                    world.spans(index, &cone.ray, end, |t0, t1| {
                        // A copy fills its box alone.
                        let layers = world.skins_of(index).len().max(1) as u32;
                        spans.extend((0..layers).map(|layer| Span { t0, t1, what: What::Box { index, layer } }));
                    });
                });
                first = nearest(spans);
            }
            let next = first.map(|i| spans.swap_remove(i));
            self.settle(cone, next.map_or(f64::INFINITY, |s| s.t0), threshold, &mut through, &mut sum);
            let Some(span) = next else { break };
            match span.what {
                What::Veil(i) => {
                    let alpha = self.veils[i as usize].alpha;
                    self.events.push(Event { t: span.t0, alpha, source: Source::Veil(i) });
                }
                What::Box { index, layer } => self.enter(cone, &span, (index, layer), threshold, through),
            }
        }
        self.heap = heap;
        let mut alpha = 1.0 - through;
        if through > OPAQUE_BELOW {
            match contact {
                Some(contact) => {
                    alpha = 1.0;
                    let width = cone.width_at(contact.t);
                    let surface = world.mesh.surface(&world.scene.model, &cone.ray, &contact, width);
                    let start = Start { triangle: contact.triangle, copy: None };
                    self.light_surface(&surface, start, width, threshold, through, &mut sum);
                    let (albedo, normal) = (surface.albedo.to_array(), surface.normal.to_array());
                    let metres = contact.t * world.unit;
                    self.tell(|| Met::Surface { metres, albedo, normal, through });
                }
                None => sum.radiance += through * world.background,
            }
        }
        let visible = if sum.tested > 0.0 { sum.seen / sum.tested } else { 1.0 };
        let radiance = sum.radiance + visible * sum.faint;
        (radiance, alpha)
    }

    /// March one layer of a box: its voxels become events.
    fn enter(&mut self, cone: &Cone, span: &Span, (index, layer): (u32, u32), threshold: f32, through: f32) {
        let world = self.world;
        let (events, frames, counts, trace) = (&mut self.events, &mut self.frames, &mut self.counts, &mut self.trace);
        let (contacts, found_near) = (&mut self.contacts, &mut self.near);
        counts.boxes += 1;
        if let Some(trace) = trace {
            let metres = [span.t0 * world.unit, span.t1 * world.unit];
            trace.push(Met::Box { index, layer, metres });
        }
        let mut own = through;
        let bias = self.options.depth_bias as f32;
        passage(world, &cone.ray, index, Some(layer), (span.t0, span.t1), &|t| cone.width_at(t), &mut |step| {
            let Stretched { visit, stretch, to_texel, scale, .. } = step;
            let Some(Some(texel)) = world.texels.get(visit.texel) else { return true };
            let frame = frames.len() as u32;
            let frame_of = || {
                let inside = Ray { origin: visit.origin, dir: visit.dir };
                let (texel, tint, cell, t0) = (visit.texel, visit.tint, visit.cell, visit.t0);
                Frame { texel, tint, t0, cell, inside, to_texel: *to_texel, scale: *scale }
            };
            if let Some(source) = texel.near(stretch.footprint + 0.5 * stretch.growth * stretch.length, threshold) {
                counts.near_copies += 1;
                let new = frame_of();
                contacts.clear();
                let width = |t: f64| f64::from(stretch.footprint + stretch.growth * t as f32);
                let last = source.mesh.nearest(&source.model, &new.inside, visit.t1 - visit.t0, width, contacts);
                contacts.extend(last);
                let before = own;
                for &contact in contacts.iter() {
                    own *= 1.0 - contact.alpha;
                    let source = Source::Near { frame, contact };
                    events.push(Event { t: visit.t0 + contact.t, alpha: contact.alpha, source });
                }
                if let Some(trace) = trace {
                    trace.push(near(world, visit, contacts.len(), before, own));
                }
                if !contacts.is_empty() {
                    frames.push(new);
                }
                *found_near = true;
                return own > 0.0;
            }
            let mut recorder = Recorder { events, own, frame, t0: visit.t0 };
            let choice = DepthChoice { bias, threshold, finest: texel.finest };
            let before = (own, recorder.events.len());
            own = march(&texel.tree, stretch, choice, own, &mut recorder, &mut counts.march);
            if let Some(trace) = trace {
                trace.push(cell(world, visit, &events[before.1..], before.0, own));
            }
            if events.len() > before.1 {
                frames.push(frame_of());
            }
            own > 0.0
        });
    }

    /// Composite the events before `frontier`, in order of depth.
    fn settle(&mut self, cone: &Cone, frontier: f64, threshold: f32, through: &mut f32, sum: &mut Sum) {
        if self.events.is_empty() {
            return;
        }
        let mut events = std::mem::take(&mut self.events);
        if !events.is_sorted_by(|a, b| a.t <= b.t) {
            events.sort_by(|a, b| a.t.total_cmp(&b.t));
        }
        let count = events.partition_point(|e| e.t < frontier);
        let settled = &mut events[..count];
        // From here on an event's alpha is its share of the whole cone.
        for tied in settled.chunk_by_mut(|a, b| a.t == b.t) {
            // Voxels in one place (layers of one box) share what they stop together by their optical depths.
            let depth = |alpha: f32| -(1.0 - alpha).max(1e-6).ln();
            let passed = *through * tied.iter().map(|e| 1.0 - e.alpha).product::<f32>();
            let stopped = *through - passed;
            match tied {
                [one] => one.alpha = stopped,
                many => {
                    let total: f32 = many.iter().map(|e| depth(e.alpha)).sum();
                    many.iter_mut().for_each(|e| e.alpha = stopped * (depth(e.alpha) / total));
                }
            }
            *through = passed;
        }
        // Each copy's voxels together, so that they share shadow rays.
        let place = |e: &Event| match e.source {
            Source::Voxel { frame, .. } | Source::Near { frame, .. } => frame,
            Source::Veil(i) => u32::MAX - i,
        };
        if !settled.is_sorted_by_key(place) {
            settled.sort_by_key(place);
        }
        for run in settled.chunk_by(|a, b| place(a) == place(b)) {
            match run[0].source {
                Source::Voxel { frame, .. } => self.light_copy(cone, frame as usize, run, threshold, sum),
                Source::Near { .. } => run.iter().for_each(|e| self.light_near(cone, e, threshold, sum)),
                Source::Veil(i) => {
                    let contact = self.veils[i as usize];
                    let width = cone.width_at(contact.t);
                    let surface = self.world.mesh.surface(&self.world.scene.model, &cone.ray, &contact, width);
                    let start = Start { triangle: contact.triangle, copy: None };
                    self.light_surface(&surface, start, width, threshold, run[0].alpha, sum);
                }
            }
        }
        events.drain(..count);
        self.events = events;
    }

    /// Light a triangle of a copy's source, whose event carries its weight.
    fn light_near(&mut self, cone: &Cone, event: &Event, threshold: f32, sum: &mut Sum) {
        let Source::Near { frame, contact } = event.source else { return };
        let frame = &self.frames[frame as usize];
        let Some(texel) = &self.world.texels[frame.texel] else { return };
        let width = cone.width_at(event.t);
        // It was read when it was traced.
        let Some(source) = texel.near(0.0, threshold) else { return };
        let seen = source.surface(&cone.ray, frame.t0, &frame.inside, &contact, &frame.to_texel, width * frame.scale);
        let surface = Surface { albedo: seen.albedo * frame.tint, ..seen };
        let start = Start { triangle: contact.triangle, copy: Some((frame.texel, frame.cell)) };
        self.light_surface(&surface, start, width, threshold, event.alpha, sum);
    }

    /// Light voxels of one copy, whose events carry their weights.
    fn light_copy(&mut self, cone: &Cone, frame: usize, run: &[Event], threshold: f32, sum: &mut Sum) {
        let world = self.world;
        let frame = &self.frames[frame];
        let weight: f32 = run.iter().map(|e| e.alpha).sum();
        let mean: f64 = run.iter().map(|e| f64::from(e.alpha) * e.t).sum::<f64>() / f64::from(weight);
        if !mean.is_finite() {
            return;
        }
        let middle = cone.ray.at(mean);
        let m = frame.to_texel;
        let similar = similarity(&m);
        let turn = |d: DVec3| if similar { (m * d).normalize_or_zero() } else { d }.as_vec3();
        // And back, to as good as the numbers of a shadow's start are.
        let back = |v: Vec3| {
            let v = v.as_dvec3();
            if similar { m.transpose() * v / m.x_axis.length().max(f64::MIN_POSITIVE) } else { v }
        };
        self.lights.clear();
        for lamp in &world.lamps {
            self.lights.push(lamp.sight(middle).map_or(Vec3::ZERO, |s| turn(s.dir)));
        }
        let warp = (!similar).then(|| (m.transpose() * (1.0 / m.x_axis.length().max(f64::MIN_POSITIVE))).as_mat3());
        let mut groups = std::mem::take(&mut self.groups);
        groups.clear();
        let lights = std::mem::take(&mut self.lights);
        // They make up for what shadows lack.
        let levelled = world.texels[frame.texel].as_ref().filter(|_| self.options.shadows);
        let levels = levelled.map_or(&[][..], |t| &t.tree.brightness_factors()[..]);
        let mut shader = Shader::new(turn(-cone.ray.dir), &lights, warp, frame.tint, levels, &mut groups);
        for event in run {
            if let Source::Voxel { voxel, depth, t, position, .. } = &event.source {
                shader.voxel(&Hit { t: *t, weight: event.alpha, depth: *depth, voxel, position: *position });
            }
        }
        shader.finish();
        let albedo = shader.albedo;
        let (t0, scale, texel) = (frame.t0, frame.scale, frame.texel);
        let on = Start { triangle: u32::MAX, copy: Some((texel, frame.cell)) };
        let facet = world.texels[texel].as_ref().map_or(0.0, |t| t.tree.info().facet_size as f32);
        let open = match self.options.ambient {
            Ambient::Constant => 1.0,
            Ambient::Occluded => self.open_sky(middle, None, cone.width_at(mean), threshold),
        };
        sum.radiance += open * albedo * world.sky;
        for group in &groups {
            let t = t0 + f64::from(group.t);
            let x = cone.ray.at(t);
            let Some(sight) = world.lamps[group.light].sight(x) else { continue };
            let light = group.energy * sight.irradiance * FRAC_1_PI;
            let start = back(group.start(facet, lights[group.light])) / scale;
            let from = Ray { origin: x + start, dir: sight.dir };
            self.add(light, &from, sight.distance - start.dot(sight.dir), Some(on), cone.width_at(t), threshold, sum);
        }
        self.groups = groups;
        self.lights = lights;
    }

    /// Add a light's contribution as far as it is seen.
    #[allow(clippy::too_many_arguments)]
    fn add(
        &mut self,
        light: Vec3,
        from: &Ray,
        distance: f64,
        start: Option<Start>,
        width: f64,
        threshold: f32,
        sum: &mut Sum,
    ) {
        if !self.options.shadows {
            sum.radiance += light;
            return;
        }
        let bright = light.max_element();
        if bright * (self.options.exposure as f32).exp2() < FAINT {
            sum.faint += light;
            return;
        }
        let cone = ShadowCone { ray: *from, end: distance, start, width, growth: 0.0 };
        let seen = self.visibility(&cone, cone.through_meshes(self.world), threshold);
        sum.radiance += seen * light;
        sum.seen += seen * bright;
        sum.tested += bright;
        let unit = self.world.unit;
        self.tell(|| Met::Shadow { origin: (from.origin * unit).to_array(), light: light.to_array(), seen });
    }

    /// Light a plain surface of which the cone sees the share `weight`.
    fn light_surface(
        &mut self,
        surface: &Surface,
        start: Start,
        width: f64,
        threshold: f32,
        weight: f32,
        sum: &mut Sum,
    ) {
        let world = self.world;
        if surface.unlit {
            sum.radiance += weight * surface.albedo;
            return;
        }
        let albedo = weight * surface.albedo;
        let open = match self.options.ambient {
            Ambient::Constant => 1.0,
            Ambient::Occluded => self.open_sky(surface.point, Some((surface.normal, start)), width, threshold),
        };
        sum.radiance += open * albedo * world.sky;
        for lamp in &world.lamps {
            let Some(sight) = lamp.sight(surface.point) else { continue };
            let cosine = surface.normal.dot(sight.dir) as f32;
            if cosine > 0.0 {
                let light = albedo * sight.irradiance * (cosine * FRAC_1_PI);
                let from = Ray { origin: surface.lifted, dir: sight.dir };
                self.add(light, &from, sight.distance, Some(start), width, threshold, sum);
            }
        }
    }

    /// The share of light that comes along a cone, of the share `through` that meshes leave.
    fn visibility(&mut self, cone: &ShadowCone, through: f32, threshold: f32) -> f32 {
        self.counts.shadow_rays += 1;
        // The depth of what is seen by default; a coarser one darkens (see `shadow_start`).
        let bias = (self.options.depth_bias + self.options.shadow_bias) as f32;
        let choice = DepthChoice { bias, threshold, finest: u8::MAX };
        super::passage::visibility(self.world, cone, through, choice, FAINT, &mut self.counts)
    }

    /// The share of the sky that a point sees: of the half around a surface's normal, or of all around a voxel.
    fn open_sky(&mut self, x: DVec3, surface: Option<(DVec3, Start)>, width: f64, threshold: f32) -> f32 {
        const GROWTH: f64 = 0.8;
        let start = surface.map(|s| s.1);
        let cone = |dir: DVec3| {
            let ray = Ray { origin: x + width * dir, dir };
            ShadowCone { ray, end: f64::INFINITY, start, width, growth: GROWTH }
        };
        let cones = sky_cones(surface.map(|s| s.0));
        let count = cones.len() as f32;
        let open = cones.into_iter().map(|part| {
            let rays = part.rays.map(|ray| cone(ray).through_meshes(self.world));
            let through = rays.iter().sum::<f32>() / rays.len() as f32;
            self.visibility(&cone(part.axis), through, threshold)
        });
        open.sum::<f32>() / count
    }
}

/// Index of the span that begins first.
fn nearest(spans: &[Span]) -> Option<usize> {
    (0..spans.len()).reduce(|best, i| if spans[i].t0 < spans[best].t0 { i } else { best })
}

/// Whether a map keeps angles, to a thousandth.
fn similarity(m: &DMat3) -> bool {
    let (a, b, c) = (m.x_axis, m.y_axis, m.z_axis);
    let (aa, bb, cc) = (a.length_squared(), b.length_squared(), c.length_squared());
    let near = |x: f64, y: f64| (x - y).abs() <= 1e-3 * aa;
    near(aa, bb) && near(aa, cc) && near(a.dot(b), 0.0) && near(a.dot(c), 0.0) && near(b.dot(c), 0.0)
}

/// Keeps what a march meets.
struct Recorder<'a> {
    events: &'a mut Vec<Event>,
    own: f32,
    frame: u32,
    t0: f64,
}

impl Sink for Recorder<'_> {
    fn voxel(&mut self, hit: &Hit<'_>) {
        let alpha = (hit.weight / self.own).clamp(0.0, 1.0);
        self.own -= hit.weight;
        let (t, position) = (hit.t, hit.position);
        let source = Source::Voxel { frame: self.frame, voxel: *hit.voxel, depth: hit.depth, t, position };
        self.events.push(Event { t: self.t0 + f64::from(t), alpha, source });
    }
}

fn near(world: &World<'_>, visit: &Visit, contacts: usize, before: f32, after: f32) -> Met {
    Met::Near {
        texel: world.scene.texels.get(visit.texel).map_or(String::new(), |t| t.name.clone()),
        cell: visit.cell,
        metres: [visit.t0 * world.unit, visit.t1 * world.unit],
        contacts,
        before,
        after,
    }
}

fn cell(world: &World<'_>, visit: &Visit, events: &[Event], before: f32, after: f32) -> Met {
    let depth = events.iter().find_map(|e| match e.source {
        Source::Voxel { depth, .. } => Some(depth),
        Source::Near { .. } | Source::Veil(_) => None,
    });
    Met::Cell {
        texel: world.scene.texels.get(visit.texel).map_or(String::new(), |t| t.name.clone()),
        cell: visit.cell,
        metres: [visit.t0 * world.unit, visit.t1 * world.unit],
        depth,
        voxels: events.len(),
        before,
        after,
    }
}
