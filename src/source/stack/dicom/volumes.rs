//! Which slices of a series are one stack: those that lie alike and share echo, time, phase and diffusion weighting.
//!
//! Based on: NEMA PS3.3, sections C.7.6.16 (multi-frame functional groups), C.8.3 and C.8.13 (MR images).

use super::attributes::ATTRIBUTES;
use super::image::{Frame, Image};
use crate::geom::DVec3;
use crate::source::stack::natural::natural;

/// A slice: which image of the series, and which frame of it.
pub type Slice = (usize, usize);

/// Slices that are one stack, and what tells them from the others of their series.
pub struct Group {
    pub label: String,
    pub slices: Vec<Slice>,
}

/// Share of a slice's thickness within which two slices lie at one place.
const SAME_PLACE: f64 = 1e-3;
/// Largest cosine of an angle between slices that lie differently.
const TURNED: f64 = 0.999;

struct Series<'a>(&'a [Image]);

impl Series<'_> {
    fn frame(&self, (image, frame): Slice) -> &Frame {
        &self.0[image].frames[frame]
    }

    fn axes(&self, slice: Slice) -> [DVec3; 2] {
        self.frame(slice).axes.unwrap_or([DVec3::X, DVec3::Y])
    }

    /// Positions along the normal, in units of the tolerance; `None` where one is not known.
    fn positions(&self, slices: &[Slice]) -> Option<Vec<f64>> {
        let [row, column] = self.axes(*slices.first()?);
        let normal = row.cross(column).normalize_or_zero();
        let tolerance = SAME_PLACE * self.0[slices[0].0].thickness.unwrap_or(1.0);
        slices.iter().map(|s| Some(self.frame(*s).position?.dot(normal) / tolerance)).collect()
    }

    /// Slices at the same place together, along the normal; in each place in the order in which they were taken.
    fn places(&self, slices: &[Slice]) -> Vec<Vec<Slice>> {
        let Some(positions) = self.positions(slices) else { return slices.iter().map(|s| vec![*s]).collect() };
        let mut order: Vec<(f64, Slice)> = positions.into_iter().zip(slices.iter().copied()).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut places: Vec<Vec<Slice>> = Vec::new();
        let mut before = f64::NEG_INFINITY;
        for (position, slice) in order {
            match places.last_mut() {
                Some(place) if position - before < 1.0 => place.push(slice),
                _ => {
                    before = position;
                    places.push(vec![slice]);
                }
            }
        }
        let when = |s: &Slice| (self.0[s.0].when.clone(), self.0[s.0].instance, s.1);
        for place in &mut places {
            place.sort_by(|a, b| {
                let (a, b) = (when(a), when(b));
                a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2))
            });
        }
        places
    }

    /// Most slices that lie at one place.
    fn most_at_one_place(&self, slices: &[Slice]) -> usize {
        self.places(slices).iter().map(Vec::len).max().unwrap_or(0)
    }

    /// Slices of the same size, kind of pixels and orientation together.
    fn alike(&self, slices: &[Slice]) -> Vec<Group> {
        let mut groups: Vec<Group> = Vec::new();
        for &slice in slices {
            let layout = &self.0[slice.0].layout;
            let like = |g: &&mut Group| {
                let (first, axes) = (g.slices[0], self.axes(slice));
                let turned =
                    self.axes(first).iter().zip(axes).any(|(a, b)| a.dot(b) < TURNED * a.length() * b.length());
                self.0[first.0].layout.is_like(layout) && !turned
            };
            match groups.iter_mut().find(like) {
                Some(group) => group.slices.push(slice),
                None => {
                    let [row, column] = self.axes(slice);
                    let normal = row.cross(column).abs();
                    let plane = match normal.max_element() {
                        m if m == normal.z => "axial",
                        m if m == normal.y => "coronal",
                        _ => "sagittal",
                    };
                    let label = format!("{plane} {}", layout.describe());
                    groups.push(Group { label, slices: vec![slice] });
                }
            }
        }
        groups
    }

    /// The groups of slices that have the same value of an attribute; one group where that is the same for all.
    fn by_value(&self, slices: &[Slice], attribute: usize) -> Vec<Group> {
        let value = |s: Slice| self.frame(s).attributes[attribute].clone().unwrap_or_default();
        let mut values: Vec<String> = slices.iter().map(|s| value(*s)).collect();
        values.sort_by(|a, b| match (a.parse::<f64>(), b.parse::<f64>()) {
            (Ok(x), Ok(y)) => x.total_cmp(&y),
            _ => natural(a, b),
        });
        values.dedup();
        let group = |v: String| {
            let of_group = slices.iter().copied().filter(|s| value(*s) == v).collect();
            let v = if v.is_empty() { "unknown" } else { &v };
            Group { label: format!("{} {v}", ATTRIBUTES[attribute].name), slices: of_group }
        };
        values.into_iter().map(group).collect()
    }

    /// Part slices by all attributes from `attribute` on.
    fn split(&self, group: Group, attribute: usize, out: &mut Vec<Group>) {
        let most = self.most_at_one_place(&group.slices);
        if let Some(kind) = ATTRIBUTES.get(attribute) {
            let parts = self.by_value(&group.slices, attribute);
            // An attribute that numbers the slices of one stack makes more parts than there are slices at one place.
            let apart = kind.constant && parts.iter().all(|p| p.slices.len() > 1);
            if parts.len() > 1 && (apart || parts.len() <= most) {
                for part in parts {
                    let label = join(&group.label, &part.label);
                    self.split(Group { label, slices: part.slices }, attribute + 1, out);
                }
            } else {
                self.split(group, attribute + 1, out);
            }
            return;
        }
        if most <= 1 {
            out.push(group);
            return;
        }
        // Nothing tells them apart but the order in which they were taken.
        let places = self.places(&group.slices);
        for n in 0..most {
            let slices = places.iter().filter_map(|place| place.get(n).copied()).collect();
            out.push(Group { label: join(&group.label, &format!("volume {}", n + 1)), slices });
        }
    }
}

fn join(a: &str, b: &str) -> String {
    if a.is_empty() { b.to_owned() } else { format!("{a}, {b}") }
}

/// The stacks of a series.
pub fn stacks(images: &[Image]) -> Vec<Group> {
    let series = Series(images);
    let all: Vec<Slice> =
        images.iter().enumerate().flat_map(|(i, image)| (0..image.frames.len()).map(move |f| (i, f))).collect();
    let mut alike = series.alike(&all);
    if let [only] = &mut alike[..] {
        only.label.clear();
    }
    let mut out = Vec::new();
    alike.into_iter().for_each(|group| series.split(group, 0, &mut out));
    out
}

/// Index of the stack that is taken where none was asked for: the first of those with the most slices.
pub fn largest(groups: &[Group]) -> usize {
    let most = groups.iter().map(|g| g.slices.len()).max();
    groups.iter().position(|g| Some(g.slices.len()) == most).unwrap_or(0)
}

/// "1 (echo 1, 16 slices), 2 (echo 2, 16 slices)".
pub fn listed(groups: &[Group]) -> String {
    let one = |(n, g): (usize, &Group)| {
        let slices = format!("{} slice{}", g.slices.len(), if g.slices.len() == 1 { "" } else { "s" });
        format!("{} ({})", n + 1, join(&g.label, &slices))
    };
    let mut list: Vec<String> = groups.iter().enumerate().take(20).map(one).collect();
    if groups.len() > list.len() {
        list.push(format!("… {}", groups.len()));
    }
    list.join(", ")
}
