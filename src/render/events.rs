//! What stops light along one cone, and its compositing: each event's share of the light that reaches the eye.
//!
//! Based on: T. Porter, T. Duff, *Compositing Digital Images*, SIGGRAPH 1984 (*over*); L. Carpenter, *The A-buffer*,
//! SIGGRAPH 1984 (fragments of one pixel are kept, ordered by distance and composited).
//!
//! Boxes may overlap (trees that stand close). Each box's ray is marched on its own, which keeps its matter together, and
//! its voxels become events here, each with the share that it stops of the light that reaches it. Ordered by distance, events
//! of two boxes in one place interleave voxel by voxel, and the transmittance is the product of theirs.

use std::ops::Range;

use super::copy_segment::CopySegment;
use super::mesh::Contact;
use crate::geom::{Ray, Vec3};
use crate::march::transmittance::{Sink, VoxelHit};
use crate::volume::Voxel;

/// Matter that stops part of the light, at a distance along the ray.
#[derive(Clone, Copy)]
pub struct Event {
    /// Where it is composited: its distance, less what [`lead_of`] says.
    pub t: f64,
    /// The share of the light reaching it that it stops; after [`composite`], the share of the whole cone's light.
    pub alpha: f32,
    pub origin: EventOrigin,
}

/// Matter that an event is of. `copy` is an index into the cone's list of [`CopySegment`]s.
#[derive(Clone, Copy)]
pub enum EventOrigin {
    Voxel {
        copy: u32,
        voxel: Voxel,
        depth: u8,
        /// Its number among those of its depth.
        rank: u32,
        /// The copy's own parameter, from where the ray enters it.
        t: f32,
        /// Texel space.
        position: Vec3,
    },
    /// A triangle of a copy's source.
    Source { copy: u32, contact: Contact },
    /// A triangle of the scene that lets part of the light through: index into the cone's list of them.
    BlendedSurface(u32),
}

impl Event {
    /// Number of what is lit together: a copy, so that its voxels share shadow rays, or one blended surface.
    pub fn group(&self) -> u32 {
        match self.origin {
            EventOrigin::Voxel { copy, .. } | EventOrigin::Source { copy, .. } => copy,
            EventOrigin::BlendedSurface(i) => u32::MAX - i,
        }
    }
}

/// How far before what is in the same place a layer is composited that lies over `rank` others, in widths of what is seen: so that
/// it is before them, and behind what is a whole width nearer.
pub fn lead_of(rank: u32) -> f64 {
    1.0 - (-f64::from(rank)).exp2()
}

/// Bring events into order of distance, as they mostly are already.
pub fn sort(events: &mut [Event]) {
    if !events.is_sorted_by(|a, b| a.t <= b.t) {
        events.sort_by(|a, b| a.t.total_cmp(&b.t));
    }
}

/// Composite events that are in order of distance, where the share `transmittance` of the light arrives: an event's alpha
/// becomes its share of the whole. Returns the transmittance after them.
pub fn composite(events: &mut [Event], mut transmittance: f32) -> f32 {
    for tied in events.chunk_by_mut(|a, b| a.t == b.t) {
        // Voxels in one place (layers of one box) share what they stop together by their optical depths.
        let optical_depth = |alpha: f32| -(-alpha.min(1.0 - 1e-6)).ln_1p();
        let passed = transmittance * tied.iter().map(|e| 1.0 - e.alpha).product::<f32>();
        let stopped = transmittance - passed;
        match tied {
            [one] => one.alpha = stopped,
            many => {
                let total: f32 = many.iter().map(|e| optical_depth(e.alpha)).sum();
                let share = |alpha: f32| if total > 0.0 { stopped * (optical_depth(alpha) / total) } else { 0.0 };
                many.iter_mut().for_each(|e| e.alpha = share(e.alpha));
            }
        }
        transmittance = passed;
    }
    transmittance
}

/// The sink that records a march's voxels as events.
pub struct Recorder<'a> {
    pub events: &'a mut Vec<Event>,
    /// Share of the march's light that has not been stopped.
    pub transmittance: f32,
    pub copy: u32,
    /// How much of the ray's t a voxel as wide as the cube would lead by, see [`lead_of`].
    pub lead: f64,
    /// The ray's t where it enters the copy.
    pub t0: f64,
}

impl Sink for Recorder<'_> {
    fn voxel(&mut self, hit: &VoxelHit<'_>) {
        let alpha = (hit.weight / self.transmittance).clamp(0.0, 1.0);
        self.transmittance -= hit.weight;
        let VoxelHit { t, voxel, depth, rank, position, .. } = *hit;
        let origin = EventOrigin::Voxel { copy: self.copy, voxel: *voxel, depth, rank, t, position };
        let lead = self.lead * (-f64::from(depth)).exp2();
        self.events.push(Event { t: self.t0 + f64::from(t) - lead, alpha, origin });
    }
}

/// The events of a cone that are not composited yet, and what they refer to.
#[derive(Default)]
pub struct EventLists {
    pub events: Vec<Event>,
    /// Copies that events are of, or may be.
    pub copies: Vec<CopySegment>,
    /// Triangles of the scene before the first opaque one; with fine rays, all that they see.
    pub blended: Vec<Contact>,
    /// Fine rays, what they see, and which of it belongs to each item of `blended`; empty without them.
    pub rays: Vec<Ray>,
    pub fine: Vec<FineHit>,
    pub places: Vec<Range<usize>>,
}

/// What one of a lane's fine rays sees.
#[derive(Clone, Copy)]
pub struct FineHit {
    pub contact: Contact,
    /// Share of the lane.
    pub weight: f32,
    /// Number of the fine ray.
    pub ray: u32,
}

impl EventLists {
    pub fn clear(&mut self) {
        self.events.clear();
        self.copies.clear();
        self.blended.clear();
        self.rays.clear();
        self.fine.clear();
        self.places.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Events in one place, however faint or opaque, share what they stop together.
    #[test]
    fn tied_events_share_what_they_stop() {
        for alphas in [[0.0, 0.0], [1e-9, 1e-9], [1e-9, 0.5], [0.25, 0.25], [1.0, 0.5], [1.0, 1.0]] {
            let event = |alpha| Event { t: 1.0, alpha, origin: EventOrigin::BlendedSurface(0) };
            let mut events = alphas.map(event);
            let through = composite(&mut events, 0.5);
            assert_eq!(through, 0.5 * (1.0 - alphas[0]) * (1.0 - alphas[1]), "{alphas:?}");
            let [a, b] = [0, 1].map(|k| events[k].alpha);
            // Rounding of numbers below 1.
            assert!((a + b - (0.5 - through)).abs() < 1e-6 && a >= 0.0 && b >= 0.0, "{alphas:?}: {a} {b}");
            assert!(alphas[0] != alphas[1] || a == b, "{alphas:?}: {a} {b}");
        }
    }
}
