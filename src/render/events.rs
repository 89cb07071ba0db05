//! Events along one cone, each of which stops some of its light, and their compositing: each event's share of the light that reaches the
//! eye.
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
use crate::geom::Ray;
use crate::march::transmittance::{Sink, VoxelHit};
use crate::volume::voxel::voxel_edge;

/// Matter that stops part of the light, at a distance along the ray.
#[derive(Clone, Copy)]
pub struct Event {
    /// Distance at which it is composited: its own, less the lead of its layer (see [`layer_lead`]).
    pub t: f64,
    /// Share that it stops of the light that reaches it; after [`composite`], of the whole cone's light.
    pub alpha: f32,
    pub origin: EventOrigin,
}

/// The matter of an event; kept small, since events are sorted. `copy` is an index into the cone's list of [`CopySegment`]s.
#[derive(Clone, Copy)]
pub enum EventOrigin {
    Voxel {
        copy: u32,
        depth: u8,
        /// Its number among the voxels of its depth.
        rank: u32,
        /// Ray parameter, counted from where the ray enters the copy.
        t: f32,
    },
    /// A triangle of a copy's source: index into the cone's list of them.
    Source { copy: u32, contact: u32 },
    /// A triangle of the scene that lets part of the light through: index into the cone's list of them.
    BlendedSurface(u32),
}

impl Event {
    /// Number of the group in which the event is lit: of a copy, so that its voxels share shadow rays, or of one blended surface.
    pub fn group(&self) -> u32 {
        match self.origin {
            EventOrigin::Voxel { copy, .. } | EventOrigin::Source { copy, .. } => copy,
            EventOrigin::BlendedSurface(i) => u32::MAX - i,
        }
    }
}

/// Distance, in widths of the voxel or cone, by which the events of a layer that lies over `rank` others are moved towards the eye before
/// compositing. They then come before events of those layers in the same place, and after events that are a whole width nearer.
pub fn layer_lead(rank: u32) -> f64 {
    1.0 - (-f64::from(rank)).exp2()
}

/// Bring events into order of distance, as they mostly are already.
pub fn sort(events: &mut [Event]) {
    if !events.is_sorted_by(|a, b| a.t <= b.t) {
        events.sort_by(|a, b| a.t.total_cmp(&b.t));
    }
}

/// Composite events that are sorted by distance. `transmittance` is that before the first one; each event's alpha becomes its share of
/// the whole cone's light. Returns the transmittance after the last one.
pub fn composite(events: &mut [Event], mut transmittance: f32) -> f32 {
    for tied in events.chunk_by_mut(|a, b| a.t == b.t) {
        // Events at one distance (layers of one box) share the light that they stop together in proportion to their optical depths.
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

/// An event is faint below this share of all that a cone sees, and below this part of the mean event. (In thin matter all are alike,
/// and none is left out.)
const FAINT_EVENT: f32 = 1.0 / 128.0;
const FAINT_OF_MEAN: f32 = 0.25;
/// Largest share of a cone's events that is left out. A far picture takes 6 % less time this way. (With faint events of 1/64, and 1/16 of
/// all, it takes 9 % less, but then the error shows, because events that are left out lie deeper in the shade than the rest.)
const MAX_LEFT_OUT: f32 = 1.0 / 32.0;

/// Remove composited events of so little weight that the others may stand for them. Returns the share of the light that is left, in
/// (0, 1].
pub fn leave_out_faint(events: &mut Vec<Event>) -> f32 {
    let all: f32 = events.iter().map(|e| e.alpha).sum();
    if events.len() < 2 || all <= 0.0 {
        return 1.0;
    }
    let faint = all * FAINT_EVENT.min(FAINT_OF_MEAN / events.len() as f32);
    let room = MAX_LEFT_OUT * all;
    let mut left_out = 0.0;
    events.retain(|e| {
        let stays = e.alpha >= faint || left_out + e.alpha > room;
        left_out += if stays { 0.0 } else { e.alpha };
        stays
    });
    1.0 - left_out / all
}

/// The sink that records a march's voxels as events.
pub struct Recorder<'a> {
    pub events: &'a mut Vec<Event>,
    /// Transmittance before the next voxel.
    pub transmittance: f32,
    pub copy: u32,
    /// Lead of a voxel as wide as the cube, in the ray's t, see [`layer_lead`].
    pub lead: f64,
    /// The ray's t where it enters the copy.
    pub t0: f64,
}

impl Sink for Recorder<'_> {
    const IS_CAMERA: bool = true;

    #[inline(always)]
    fn voxel(&mut self, hit: &VoxelHit<'_>) {
        let alpha = (hit.weight / self.transmittance).clamp(0.0, 1.0);
        self.transmittance -= hit.weight;
        let VoxelHit { t, depth, rank, .. } = *hit;
        let origin = EventOrigin::Voxel { copy: self.copy, depth, rank, t };
        let lead = self.lead * f64::from(voxel_edge(depth));
        self.events.push(Event { t: self.t0 + f64::from(t) - lead, alpha, origin });
    }
}

/// The events of a cone, and what they refer to.
#[derive(Default)]
pub struct EventLists {
    /// Events that are not composited yet.
    pub events: Vec<Event>,
    /// Composited events, in order of distance.
    pub composited: Vec<Event>,
    /// Segments of the ray in copies, to which events refer.
    pub copies: Vec<CopySegment>,
    /// Contacts with triangles of copies' sources, to which events refer.
    pub contacts: Vec<Contact>,
    /// Blended surfaces before the first opaque one; with fine rays, all surfaces that they see.
    pub blended: Vec<Contact>,
    /// Fine rays, their hits, and the range of hits of each item of `blended`; empty without fine rays.
    pub rays: Vec<Ray>,
    pub fine: Vec<FineHit>,
    pub places: Vec<Range<usize>>,
}

/// A hit of one of a lane's fine rays.
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
        self.composited.clear();
        self.copies.clear();
        self.contacts.clear();
        self.blended.clear();
        self.rays.clear();
        self.fine.clear();
        self.places.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of an opaque event and of faint ones, as many as may are left out; of events that are alike, none.
    #[test]
    fn faint_events_are_left_out_within_a_bound() {
        let events = |alphas: &[f32]| -> Vec<Event> {
            let event = |(i, &alpha): (usize, &f32)| Event {
                t: i as f64,
                alpha,
                origin: EventOrigin::BlendedSurface(i as u32),
            };
            alphas.iter().enumerate().map(event).collect()
        };
        let mut few = events(&[0.5, 0.003, 0.4, 0.002]);
        let share = leave_out_faint(&mut few);
        assert_eq!(few.iter().map(|e| e.t).collect::<Vec<_>>(), [0.0, 2.0]);
        assert!((share - 0.9 / 0.905).abs() < 1e-6, "{share}");
        let mut many = events(&[&[0.9][..], &[0.001; 100]].concat());
        let share = leave_out_faint(&mut many);
        assert_eq!(many.len(), 101 - 31, "31 thousandths are a little less than a 32nd");
        assert!((share - 0.969).abs() < 1e-5, "{share}");
        let mut alike = events(&[0.001; 500]);
        assert_eq!((leave_out_faint(&mut alike), alike.len()), (1.0, 500));
        assert_eq!(leave_out_faint(&mut Vec::new()), 1.0);
    }

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
