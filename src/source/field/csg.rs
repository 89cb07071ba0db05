//! Fields made of other fields: union, intersection, difference, smooth blends, offsets and transforms.
//!
//! Based on: A. Ricci, *A Constructive Geometry for Computer Graphics*, The Computer Journal 16, 1973 (minimum and maximum);
//! the smooth minimum by a cubic polynomial after I. Quilez.

use super::Field;
use crate::geom::{Aabb, DAffine3, DMat3, DVec3};

/// Operation that joins parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Operation {
    /// Matter of any part.
    Union,
    /// Matter that all parts share.
    Intersection,
    /// The first less all others.
    Difference,
}

/// Parts joined by an operation; sharp, or over a band of the width `smooth`.
pub struct Csg {
    operation: Operation,
    parts: Vec<Box<dyn Field>>,
    smooth: f64,
}

impl Csg {
    /// `smooth`: width of the band in which parts melt into one another, ≥ 0, in units of the values.
    pub fn new(operation: Operation, parts: Vec<Box<dyn Field>>, smooth: f64) -> Csg {
        Csg { operation, parts, smooth }
    }

    /// +1 where the lowest value counts, −1 where the highest; for the part `index`.
    fn signs(&self, index: usize) -> (f64, f64) {
        match self.operation {
            Operation::Union => (1.0, 1.0),
            Operation::Intersection => (-1.0, -1.0),
            Operation::Difference => (-1.0, if index == 0 { -1.0 } else { 1.0 }),
        }
    }

    /// The joined value from the parts', and how far each part takes a share in it: only the two ends matter for a sharp one.
    fn join(&self, value: impl Fn(usize) -> f64) -> f64 {
        let mut sum = f64::INFINITY;
        let mut outer = 1.0;
        for i in 0..self.parts.len() {
            let (whole, sign) = self.signs(i);
            outer = whole;
            sum = smooth_min(sum, sign * value(i), self.smooth);
        }
        outer * sum
    }

    /// The part that decides at `p`: the one whose surface is met there.
    fn deciding(&self, p: DVec3) -> Option<usize> {
        let value = |i: usize| self.signs(i).1 * self.parts[i].value(p);
        (0..self.parts.len()).min_by(|&a, &b| value(a).total_cmp(&value(b)))
    }
}

/// The lesser of both; where they are nearer than `k` to one another, up to k/6 less.
fn smooth_min(a: f64, b: f64, k: f64) -> f64 {
    let h = if k > 0.0 { (k - (a - b).abs()).max(0.0) / k } else { 0.0 };
    a.min(b) - h * h * h * k / 6.0
}

/// Share of the gradient of `b` in that of `smooth_min(a, b)`.
fn share_of_second(a: f64, b: f64, k: f64) -> f64 {
    let h = if k > 0.0 { (k - (a - b).abs()).max(0.0) / k } else { 0.0 };
    let greater = 0.5 * h * h;
    if b < a { 1.0 - greater } else { greater }
}

impl Field for Csg {
    fn value(&self, p: DVec3) -> f64 {
        self.join(|i| self.parts[i].value(p))
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        let (mut sum, mut slope) = (f64::INFINITY, DVec3::ZERO);
        let mut outer = 1.0;
        for (i, part) in self.parts.iter().enumerate() {
            let (whole, sign) = self.signs(i);
            outer = whole;
            let value = sign * part.value(p);
            let share = share_of_second(sum, value, self.smooth);
            if share > 0.0 {
                slope = (1.0 - share) * slope + share * sign * part.gradient(p);
            }
            sum = smooth_min(sum, value, self.smooth);
        }
        outer * slope
    }

    fn slope(&self) -> f64 {
        self.parts.iter().map(|p| p.slope()).fold(0.0, f64::max)
    }

    fn range(&self, b: &Aabb) -> (f64, f64) {
        let ranges: Vec<(f64, f64)> = self.parts.iter().map(|p| p.range(b)).collect();
        let end = |i: usize, low: bool| {
            let (low_value, high_value) = ranges[i];
            // A part that counts negative in the joined value gives its other end.
            let (outer, sign) = self.signs(i);
            if low == (outer * sign > 0.0) { low_value } else { high_value }
        };
        (self.join(|i| end(i, true)), self.join(|i| end(i, false)))
    }

    fn bounds(&self) -> Aabb {
        self.bounds_of(0.0)
    }

    fn bounds_of(&self, level: f64) -> Aabb {
        // A blend swells by k/6 for each part that is added.
        let swelling = self.smooth / 6.0 * self.parts.len().saturating_sub(1) as f64;
        match self.operation {
            Operation::Union => self.parts.iter().map(|p| p.bounds_of(level + swelling)).fold(Aabb::EMPTY, Aabb::union),
            Operation::Intersection => {
                self.parts.iter().map(|p| p.bounds_of(level)).reduce(Aabb::intersection).unwrap_or(Aabb::EMPTY)
            }
            Operation::Difference => self.parts.first().map_or(Aabb::EMPTY, |p| p.bounds_of(level)),
        }
    }

    fn colour(&self, p: DVec3) -> Option<[f32; 3]> {
        if self.smooth > 0.0 && self.operation == Operation::Union && self.has_colour() {
            // Colours melt as shapes do.
            let (mut sum, mut colour) = (f64::INFINITY, [1.0f32; 3]);
            for part in &self.parts {
                let value = part.value(p);
                let share = share_of_second(sum, value, self.smooth) as f32;
                let next = part.colour(p).unwrap_or([1.0; 3]);
                colour = std::array::from_fn(|c| colour[c] * (1.0 - share) + next[c] * share);
                sum = smooth_min(sum, value, self.smooth);
            }
            return Some(colour);
        }
        self.parts[self.deciding(p)?].colour(p)
    }

    fn has_colour(&self) -> bool {
        self.parts.iter().any(|p| p.has_colour())
    }
}

/// A field placed by an affine map. Values are scaled down so that they still grow no faster than the distance.
pub struct Placed {
    field: Box<dyn Field>,
    to_world: DAffine3,
    to_local: DAffine3,
    /// The least factor by which the map lengthens.
    least: f64,
}

impl Placed {
    /// `None`: the map flattens, or is not finite.
    pub fn new(field: Box<dyn Field>, to_world: DAffine3) -> Option<Placed> {
        let to_local = to_world.inverse();
        let finite = to_local.matrix3.is_finite() && to_local.translation.is_finite() && to_world.is_finite();
        let least = 1.0 / largest_stretch(to_local.matrix3);
        if !finite || !least.is_finite() || least <= 0.0 {
            return None;
        }
        Some(Placed { field, to_world, to_local, least })
    }
}

/// The largest factor by which `m` lengthens a vector, rounded up: the root of the largest eigenvalue of its square.
fn largest_stretch(m: DMat3) -> f64 {
    let square = m.transpose() * m;
    // Gershgorin's bound of M^64, whose 64th root is off by a factor of at most 3^(1/64), under 2 %.
    let mut power = square;
    let mut log = 0.0;
    for _ in 0..6 {
        let size = power.x_axis.abs().max(power.y_axis.abs()).max(power.z_axis.abs()).max_element();
        if size.is_nan() || size <= 0.0 {
            return f64::NAN;
        }
        power *= 1.0 / size;
        log = 2.0 * (log + libm::log(size));
        power *= power;
    }
    let rows = power.transpose();
    let row = |r: DVec3| r.abs().element_sum();
    let bound = row(rows.x_axis).max(row(rows.y_axis)).max(row(rows.z_axis));
    (libm::exp((libm::log(bound) + log) / 64.0) * (1.0 + 1e-12)).sqrt()
}

/// The box around the image of a box; where the box has no end, along the axes that its image has none along.
fn image(b: Aabb, map: &DAffine3) -> Aabb {
    if b.is_empty() {
        return b;
    }
    let mut out = Aabb::new(map.translation, map.translation);
    for axis in 0..3 {
        let column = map.matrix3.col(axis);
        for row in 0..3 {
            // 0 times infinity is nothing.
            let at = |v: f64| if column[row] == 0.0 { 0.0 } else { column[row] * v };
            let (u, v) = (at(b.min[axis]), at(b.max[axis]));
            out.min[row] += u.min(v);
            out.max[row] += u.max(v);
        }
    }
    out
}

impl Field for Placed {
    fn value(&self, p: DVec3) -> f64 {
        self.least * self.field.value(self.to_local.transform_point3(p))
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        self.least * (self.to_local.matrix3.transpose() * self.field.gradient(self.to_local.transform_point3(p)))
    }

    fn slope(&self) -> f64 {
        self.field.slope()
    }

    fn range(&self, b: &Aabb) -> (f64, f64) {
        let (low, high) = self.field.range(&image(*b, &self.to_local));
        (self.least * low, self.least * high)
    }

    fn bounds(&self) -> Aabb {
        image(self.field.bounds(), &self.to_world)
    }

    fn bounds_of(&self, level: f64) -> Aabb {
        image(self.field.bounds_of(level / self.least), &self.to_world)
    }

    fn colour(&self, p: DVec3) -> Option<[f32; 3]> {
        self.field.colour(self.to_local.transform_point3(p))
    }

    fn has_colour(&self) -> bool {
        self.field.has_colour()
    }
}

/// A field's matter grown by `by` all around, or only a skin of it; in units of its values.
pub struct Grown {
    /// The field that is grown.
    pub field: Box<dyn Field>,
    /// Distance by which it grows, in units of its values; below 0 it shrinks.
    pub by: f64,
    /// A skin of this thickness about the surface instead of the whole; 0: none.
    pub skin: f64,
}

impl Field for Grown {
    fn value(&self, p: DVec3) -> f64 {
        let v = self.field.value(p) - self.by;
        if self.skin > 0.0 { v.abs() - 0.5 * self.skin } else { v }
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        let g = self.field.gradient(p);
        if self.skin > 0.0 && self.field.value(p) < self.by { -g } else { g }
    }

    fn slope(&self) -> f64 {
        self.field.slope()
    }

    fn range(&self, b: &Aabb) -> (f64, f64) {
        let (low, high) = self.field.range(b);
        let (low, high) = (low - self.by, high - self.by);
        if self.skin <= 0.0 {
            return (low, high);
        }
        let least = if low <= 0.0 && high >= 0.0 { 0.0 } else { low.abs().min(high.abs()) };
        (least - 0.5 * self.skin, low.abs().max(high.abs()) - 0.5 * self.skin)
    }

    fn bounds(&self) -> Aabb {
        self.bounds_of(0.0)
    }

    fn bounds_of(&self, level: f64) -> Aabb {
        self.field.bounds_of(level + self.by + 0.5 * self.skin)
    }

    fn colour(&self, p: DVec3) -> Option<[f32; 3]> {
        self.field.colour(p)
    }

    fn has_colour(&self) -> bool {
        self.field.has_colour()
    }
}

/// A field with one colour.
pub struct Coloured {
    /// The field that is coloured.
    pub field: Box<dyn Field>,
    /// Linear Rec. 709.
    pub colour: [f32; 3],
}

impl Field for Coloured {
    fn value(&self, p: DVec3) -> f64 {
        self.field.value(p)
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        self.field.gradient(p)
    }

    fn slope(&self) -> f64 {
        self.field.slope()
    }

    fn range(&self, b: &Aabb) -> (f64, f64) {
        self.field.range(b)
    }

    fn bounds(&self) -> Aabb {
        self.field.bounds()
    }

    fn bounds_of(&self, level: f64) -> Aabb {
        self.field.bounds_of(level)
    }

    fn colour(&self, _: DVec3) -> Option<[f32; 3]> {
        Some(self.colour)
    }

    fn has_colour(&self) -> bool {
        true
    }
}
