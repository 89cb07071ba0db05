//! One camera cone: the nearest surface, and before it every copy of a texel in order of distance.
//!
//! Based on: J. Amanatides, *Ray Tracing with Cones*, SIGGRAPH 1984; F. Neyret, *Synthesizing Verdant Landscapes using
//! Volumetric Textures*, INRIA RR-2846, 1996 (one cone per pixel through boxes full of texels).
//!
//! Boxes and copies are visited in order of where the ray enters them. Before the next one is marched, all that lies before it is
//! composited ([`super::events`]), so that the cone ends as soon as nothing comes through. Then it is lit ([`super::lighting`]).

use super::affine::ConeWidth;
use super::bvh::{Pending, Sweep};
use super::camera::Cone;
use super::cells::CopyHit;
use super::copy_segment::CopySegment;
use super::events::{Event, EventLists, EventOrigin, Recorder, composite, layer_lead, leave_out_faint, sort};
use super::lane::{FineRays, Lane};
use super::mesh::Contact;
use super::options::Options;
use super::prepare::{Item, Texel, World};
use super::segments::{BoxInterval, for_each_segment};
use super::shared_shadow::LitGroup;
use super::sky::store::RecentSky;
use super::source_mesh::SourceMesh;
use super::stats::Counts;
use super::trace::{Trace, TraceEvent};
use crate::geom::Vec3;
use crate::march::shade::ShadowGroup;
use crate::march::transmittance::{DepthChoice, run};

/// An item that the traversal has found and not visited yet.
#[derive(Clone, Copy)]
struct PendingItem {
    t0: f64,
    item: TraversalItem,
}

/// What the traversal visits.
#[derive(Clone, Copy)]
enum TraversalItem {
    /// An interval of the ray in one layer of a box.
    Box(BoxInterval),
    /// An affine copy: its number among the items of [`World::shells`], and the index of its segment in the cone's list.
    Copy { item: u32, segment: u32 },
    /// A triangle that lets light through: its index in the cone's list.
    BlendedSurface(u32),
}

/// Below this transmittance a cone ends, and what it has met stands for the rest of its light too. With 1/512 a far picture took a
/// tenth longer, at the same error.
const CONE_ENDS_BELOW: f32 = 1.0 / 64.0;

/// Traces cones for one thread; keeps its lists from cone to cone.
pub struct Tracer<'w> {
    pub world: &'w World<'w>,
    pub options: &'w Options,
    pub counts: Counts,
    /// Factor from radiance to the picture's values, 2^stops.
    pub exposure: f32,
    pub trace: Option<Trace>,
    /// Set where a texel's source was traced, also where the ray missed its triangles: else no lanes would be added along edges.
    pub uses_source_geometry: bool,
    heap: Vec<Pending>,
    pending: Vec<PendingItem>,
    pub(super) lists: EventLists,
    /// Contacts in one copy's source.
    contacts: Vec<Contact>,
    /// Scratch space of [`super::lighting`]: groups of one copy's voxels, and unit directions to the lights in its space.
    pub(super) groups: Vec<ShadowGroup>,
    pub(super) local_light_dirs: Vec<Vec3>,
    /// Groups that have no shadow ray yet.
    pub(super) lit: Vec<LitGroup>,
    pub(super) recent_sky: RecentSky,
}

/// State of one camera cone: what it has gathered so far, front to back.
pub struct ConeState<'c> {
    pub cone: &'c Cone,
    /// The fine rays by which meshes are seen, where cards are near.
    pub fine: Option<FineRays>,
    /// In [0, 1): chooses between two depths, and between voxels and triangles.
    pub lod_dither: f32,
    /// Distance after which the matter of some copy lets nothing through; infinite as long as none is known.
    pub opaque_at: f64,
    /// Transmittance of all that was composited.
    pub transmittance: f32,
    pub radiance: Vec3,
    /// Light too faint to be worth a shadow ray.
    pub faint: Vec3,
    /// Of the light that shadow rays tested, the part that arrived, and all of it; sums of each group's largest channel.
    pub arrived: f32,
    pub tested: f32,
}

impl ConeState<'_> {
    /// Apply the air between the eye and an object to the light that the object has added since `before` (radiance and faint
    /// light). `air` is its transmittance and the radiance that it adds; `weight` is the object's share of the cone.
    pub(super) fn apply_air(&mut self, before: (Vec3, Vec3), air: Option<(Vec3, Vec3)>, weight: f32) {
        let Some((through, added)) = air else { return };
        self.radiance = before.0 + through * (self.radiance - before.0) + weight * added;
        self.faint = before.1 + through * (self.faint - before.1);
    }
}

impl<'w> Tracer<'w> {
    pub fn new(world: &'w World<'w>, options: &'w Options) -> Tracer<'w> {
        Tracer {
            world,
            options,
            counts: Counts::default(),
            exposure: (options.exposure as f32).exp2(),
            trace: None,
            uses_source_geometry: false,
            heap: Vec::new(),
            pending: Vec::new(),
            lists: EventLists::default(),
            contacts: Vec::new(),
            groups: Vec::new(),
            local_light_dirs: Vec::new(),
            lit: Vec::new(),
            recent_sky: RecentSky::new(),
        }
    }

    pub(super) fn trace_event(&mut self, event: impl FnOnce() -> TraceEvent) {
        if let Some(trace) = &mut self.trace {
            trace.push(event());
        }
    }

    /// Radiance, the background included, and the share of the pixel that is not background, as `lane` sees it, whose cone is
    /// `cone`.
    pub fn cone(&mut self, cone: &Cone, lane: Lane) -> (Vec3, f32) {
        let world = self.world;
        let lod_dither = lane.lod_dither();
        self.counts.cones += 1;
        self.lists.clear();
        self.pending.clear();
        let (contact, fine, end) = self.meet_meshes(lane, cone);
        let blended = &self.lists.blended;
        let waits = |(i, surface): (usize, &Contact)| PendingItem {
            t0: surface.t,
            item: TraversalItem::BlendedSurface(i as u32),
        };
        self.pending.extend(blended.iter().enumerate().map(waits));
        let mut state = ConeState {
            cone,
            fine,
            lod_dither,
            opaque_at: f64::INFINITY,
            transmittance: 1.0,
            radiance: Vec3::ZERO,
            faint: Vec3::ZERO,
            arrived: 0.0,
            tested: 0.0,
        };
        self.traverse(&mut state, end);
        self.shade_composited(&mut state);
        let mut alpha = 1.0 - state.transmittance;
        if state.transmittance <= CONE_ENDS_BELOW {
            let rest = 1.0 / alpha;
            (state.radiance, state.faint, alpha) = (rest * state.radiance, rest * state.faint, 1.0);
        } else {
            match contact {
                Some(contact) => {
                    alpha = 1.0;
                    let through = state.transmittance;
                    self.shade_contact(&mut state, &contact, through, None);
                }
                None => {
                    state.radiance +=
                        state.transmittance * world.environment.background_radiance(cone.ray.dir, cone.growth)
                }
            }
        }
        // Light that was not tested is taken to be in shadow as often as light that was.
        let visible = if state.tested > 0.0 { state.arrived / state.tested } else { 1.0 };
        (state.radiance + visible * state.faint, alpha)
    }

    /// Visit boxes and blended surfaces before `end` in order of distance, until nothing comes through.
    fn traverse(&mut self, state: &mut ConeState<'_>, end: f64) {
        let (world, cone) = (self.world, state.cone);
        let mut heap = std::mem::take(&mut self.heap);
        let mut sweep = Sweep::new(&world.shells, &cone.ray, end, &mut heap);
        while state.transmittance > CONE_ENDS_BELOW {
            let mut first = nearest_pending(&self.pending);
            while sweep.next_enter() < first.map_or(f64::INFINITY, |i| self.pending[i].t0) {
                if let Some(item) = sweep.step() {
                    self.queue_item(item, cone, end);
                    first = nearest_pending(&self.pending);
                }
            }
            let next = first.map(|i| self.pending.swap_remove(i));
            self.composite_until(state, next.map_or(f64::INFINITY, |w| w.t0));
            let Some(PendingItem { t0, item }) = next else { break };
            match item {
                TraversalItem::Box(interval) => self.march_layer(state, &interval),
                TraversalItem::Copy { item, segment } => {
                    let CopyHit { t0, t1, .. } = self.lists.copies[segment as usize].hit;
                    self.count_item(item, 0, [t0, t1]);
                    self.march_copy(state, segment, state.transmittance);
                }
                TraversalItem::BlendedSurface(index) => {
                    let alpha = self.lists.blended[index as usize].alpha;
                    self.lists.events.push(Event { t: t0, alpha, origin: EventOrigin::BlendedSurface(index) });
                }
            }
        }
        self.heap = heap;
    }

    /// Find the intervals in which the ray is inside an item, and queue them.
    fn queue_item(&mut self, item: u32, cone: &Cone, end: f64) {
        let (world, pending) = (self.world, &mut self.pending);
        match world.item(item) {
            Item::Copy(number) => {
                let width = ConeWidth { start: cone.width, growth: cone.growth };
                if let Some(segment) = world.copies.segment(number, &cone.ray, end, width) {
                    let copies = &mut self.lists.copies;
                    let found = TraversalItem::Copy { item, segment: copies.len() as u32 };
                    pending.push(PendingItem { t0: segment.hit.t0, item: found });
                    copies.push(segment);
                }
            }
            Item::Box(shell) => {
                let layers = world.layers_of(item).len() as u32;
                shell.spans(&cone.ray, 0.0, end, |t0, t1| {
                    let interval = |layer| BoxInterval { index: item, layer: Some(layer), t0, t1 };
                    pending
                        .extend((0..layers).map(|layer| PendingItem { t0, item: TraversalItem::Box(interval(layer)) }));
                });
            }
        }
    }

    /// Count, and trace if asked, an item of the scene's hierarchy that is marched.
    fn count_item(&mut self, index: u32, layer: u32, interval: [f64; 2]) {
        self.counts.boxes += 1;
        let unit = self.world.unit;
        self.trace_event(|| TraceEvent::Box { index, layer, metres: interval.map(|t| t * unit) });
    }

    /// March one layer of a box, and record its voxels as events.
    fn march_layer(&mut self, state: &mut ConeState<'_>, interval: &BoxInterval) {
        let (world, cone) = (self.world, state.cone);
        self.count_item(interval.index, interval.layer.unwrap_or(0), [interval.t0, interval.t1]);
        let mut transmittance = state.transmittance;
        for_each_segment(world, &cone.ray, interval, &|t| cone.width_at(t), &mut |segment| {
            let (copy, events) = (self.lists.copies.len(), self.lists.events.len());
            self.lists.copies.push(segment.clone());
            transmittance = self.march_copy(state, copy as u32, transmittance);
            if self.lists.events.len() == events {
                self.lists.copies.truncate(copy);
            }
            // No layer's events are moved forward by more than the cone's width.
            transmittance > 0.0 && segment.hit.t1 < state.opaque_at + cone.width_at(segment.hit.t1)
        });
    }

    /// Record what stops light in the copy whose segment has the index `copy` in the cone's list. `before` is the transmittance at its
    /// start; returns that at its end.
    fn march_copy(&mut self, state: &mut ConeState<'_>, copy: u32, before: f32) -> f32 {
        let (world, cone, lod_dither) = (self.world, state.cone, state.lod_dither);
        let CopySegment { hit, march, rank, .. } = &mut self.lists.copies[copy as usize];
        let Some(Some(texel)) = world.texels.get(hit.texel) else { return before };
        let mid_width = march.footprint + 0.5 * march.growth * march.length;
        let width = cone.width_at(0.5 * (hit.t0 + hit.t1));
        // Copies overlap: nothing is recorded after the opaque matter of another copy.
        let end = state.opaque_at + layer_lead(*rank) * width;
        if end <= hit.t0 {
            return before;
        }
        if end < hit.t1 {
            (hit.t1, march.length) = (end, (end - hit.t0) as f32);
        }
        match texel.source_lod(mid_width, lod_dither) {
            Some(source) => self.trace_source(state, source, (copy, width), before),
            None => self.march_voxels(state, texel, copy, before),
        }
    }

    /// Record the triangles of a copy's source as events. `before` is the transmittance at the copy's start; returns that at its end.
    /// `mid_width` is the cone's width in the middle of the copy, in units of length.
    fn trace_source(
        &mut self,
        state: &mut ConeState<'_>,
        source: &SourceMesh,
        (copy, mid_width): (u32, f64),
        before: f32,
    ) -> f32 {
        let segment = &self.lists.copies[copy as usize];
        let CopySegment { hit, march, .. } = segment;
        self.counts.near_copies += 1;
        self.uses_source_geometry = true;
        self.contacts.clear();
        let width = |t: f64| f64::from(march.footprint + march.growth * t as f32);
        // Facets of two layers that lie in one place differ in distance by rounding alone.
        let lead = layer_lead(segment.rank) * mid_width;
        let end = (hit.t1 - hit.t0, march.opacity_scale);
        let last = source.mesh.nearest_for_camera(&source.model, &hit.ray(), end, width, &mut self.contacts);
        if let Some(last) = &last {
            state.opaque_at = state.opaque_at.min(hit.t0 + last.t);
        }
        self.contacts.extend(last);
        let mut after = before;
        for &contact in &self.contacts {
            after *= 1.0 - contact.alpha;
            let origin = EventOrigin::Source { copy, contact: self.lists.contacts.len() as u32 };
            self.lists.contacts.push(contact);
            let t = hit.t0 + contact.t - lead;
            self.lists.events.push(Event { t, alpha: contact.alpha, origin });
        }
        if let Some(trace) = &mut self.trace {
            let contacts = self.contacts.len();
            let (texel, cell, metres) = describe_copy(self.world, segment);
            trace.push(TraceEvent::Near { texel, cell, metres, contacts, before, after });
        }
        after
    }

    /// Record the voxels of a copy that stop light as events. `before` is the transmittance at the copy's start; returns that at its
    /// end.
    fn march_voxels(&mut self, state: &mut ConeState<'_>, texel: &Texel, copy: u32, before: f32) -> f32 {
        let lod_dither = state.lod_dither;
        let EventLists { events, copies, .. } = &mut self.lists;
        let (first, segment) = (events.len(), &copies[copy as usize]);
        let choice = DepthChoice { bias: self.options.depth_bias as f32, lod_dither, finest: texel.finest };
        let lead = layer_lead(segment.rank) / f64::from(segment.march.dir.length());
        let mut recorder = Recorder { events, transmittance: before, copy, t0: segment.hit.t0, lead };
        let (march, stats) = (&segment.march, &mut self.counts.march);
        let after = run(&texel.tree, march, choice, before, CONE_ENDS_BELOW, &mut recorder, stats);
        if let (true, Some(last)) = (after <= 0.0, events[first..].last()) {
            state.opaque_at = state.opaque_at.min(last.t);
        }
        if let Some(trace) = &mut self.trace {
            let recorded = &events[first..];
            let (texel, cell, metres) = describe_copy(self.world, segment);
            let depth = recorded.iter().find_map(|e| match e.origin {
                EventOrigin::Voxel { depth, .. } => Some(depth),
                EventOrigin::Source { .. } | EventOrigin::BlendedSurface(_) => None,
            });
            trace.push(TraceEvent::Cell { texel, cell, metres, depth, voxels: recorded.len(), before, after });
        }
        after
    }

    /// Composite the events that lie before the distance `frontier`, at which the next item begins.
    fn composite_until(&mut self, state: &mut ConeState<'_>, frontier: f64) {
        let EventLists { events, composited, .. } = &mut self.lists;
        if events.is_empty() {
            return;
        }
        sort(events);
        let count = events.partition_point(|e| e.t < frontier);
        state.transmittance = composite(&mut events[..count], state.transmittance);
        composited.extend(events.drain(..count));
    }

    /// Light all composited events; those of one copy together, so that its voxels share shadow rays.
    fn shade_composited(&mut self, state: &mut ConeState<'_>) {
        let (mut events, copies) = (std::mem::take(&mut self.lists.composited), std::mem::take(&mut self.lists.copies));
        let share = leave_out_faint(&mut events);
        if !events.is_sorted_by_key(Event::group) {
            events.sort_by_key(Event::group);
        }
        for group in events.chunk_by(|a, b| a.group() == b.group()) {
            match group[0].origin {
                EventOrigin::Voxel { copy, .. } => self.shade_voxels(state, &copies[copy as usize], group),
                EventOrigin::Source { copy, .. } => {
                    group.iter().for_each(|e| self.shade_source(state, &copies[copy as usize], e));
                }
                EventOrigin::BlendedSurface(i) => {
                    let contact = self.lists.blended[i as usize];
                    self.shade_contact(state, &contact, group[0].alpha, Some(i as usize));
                }
            }
        }
        (self.lists.composited, self.lists.copies) = (events, copies);
        self.add_shadow_groups(state);
        (state.radiance, state.faint) = (state.radiance / share, state.faint / share);
    }
}

/// Index of the item that begins first.
fn nearest_pending(pending: &[PendingItem]) -> Option<usize> {
    (0..pending.len()).reduce(|best, i| if pending[i].t0 < pending[best].t0 { i } else { best })
}

/// A copy as a trace names it: the texel's name, the cell, and the interval in metres.
fn describe_copy(world: &World<'_>, segment: &CopySegment) -> (String, [i64; 3], [f64; 2]) {
    let hit = &segment.hit;
    let name = world.scene.texels.get(hit.texel).map_or(String::new(), |t| t.name.clone());
    (name, hit.cell, [hit.t0 * world.unit, hit.t1 * world.unit])
}
