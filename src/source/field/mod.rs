//! Implicit fields: a value at every point, negative within matter.
//!
//! Based on: F. Neyret, *Synthesizing Verdant Landscapes using Volumetric Textures*, INRIA RR-2846, 1996, section 3.1 (outside,
//! inside and frontier by a distance that never grows faster than Euclid's).

mod contour;
mod csg;
mod shapes;
mod skeleton;
mod source;
mod spec;

#[cfg(test)]
pub(super) use contour::Cells;
pub use csg::{Coloured, Csg, Grown, Operation, Placed};
pub use shapes::{Capsule, Cone, Ellipsoid, HalfSpace, Plane, RoundedBox, Sphere, Torus, Triangle};
pub use skeleton::{Bone, Element, Kernel, Skeleton};
pub use source::FieldSource;
pub(super) use source::{FieldSample, GridField};
pub use spec::{Change, Colour, ElementSpec, FieldSpec, KernelSpec, Scale, Shape, build};

#[cfg(test)]
mod tests;

use crate::geom::{Aabb, DVec3};

/// A scalar field whose negative part is matter. Points are in the field's own space.
pub trait Field: Sync + Send {
    /// Below 0 within, above 0 outside; NaN counts as outside.
    fn value(&self, p: DVec3) -> f64;

    /// The gradient of the value; where it has none, any.
    fn gradient(&self, p: DVec3) -> DVec3 {
        central_difference(|p| self.value(p), p, 1e-5 * (1.0 + p.abs().max_element()))
    }

    /// Both at once, the same to the bit, for less than each on its own where they share work.
    fn value_and_gradient(&self, p: DVec3) -> (f64, DVec3) {
        (self.value(p), self.gradient(p))
    }

    /// A value that no gradient's length exceeds; infinite where none is known.
    fn slope(&self) -> f64 {
        1.0
    }

    /// Bounds of the value over the box `b`: never tighter than the truth.
    fn range(&self, b: &Aabb) -> (f64, f64) {
        let (middle, reach) = (self.value(b.centre()), self.slope() * 0.5 * b.size().length());
        if middle.is_nan() || reach.is_nan() {
            return (f64::NEG_INFINITY, f64::INFINITY);
        }
        // The sum is rounded; a few steps of f64 more are safe.
        let reach = reach + 1e-14 * (middle.abs() + reach);
        (middle - reach, middle + reach)
    }

    /// A box around all matter; it may be infinite, and is empty where there is none.
    fn bounds(&self) -> Aabb;

    /// A box around all points whose value is at most `level`; without end where none is known.
    fn bounds_of(&self, level: f64) -> Aabb {
        if level <= 0.0 { self.bounds() } else { Aabb::new(DVec3::NEG_INFINITY, DVec3::INFINITY) }
    }

    /// Linear Rec. 709 at a point of the surface; `None`: white.
    fn colour(&self, _p: DVec3) -> Option<[f32; 3]> {
        None
    }

    /// Whether any colour is given.
    fn has_colour(&self) -> bool {
        false
    }
}

impl<F: Field + ?Sized> Field for Box<F> {
    fn value(&self, p: DVec3) -> f64 {
        (**self).value(p)
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        (**self).gradient(p)
    }

    fn value_and_gradient(&self, p: DVec3) -> (f64, DVec3) {
        (**self).value_and_gradient(p)
    }

    fn slope(&self) -> f64 {
        (**self).slope()
    }

    fn range(&self, b: &Aabb) -> (f64, f64) {
        (**self).range(b)
    }

    fn bounds(&self) -> Aabb {
        (**self).bounds()
    }

    fn bounds_of(&self, level: f64) -> Aabb {
        (**self).bounds_of(level)
    }

    fn colour(&self, p: DVec3) -> Option<[f32; 3]> {
        (**self).colour(p)
    }

    fn has_colour(&self) -> bool {
        (**self).has_colour()
    }
}

/// `b` with every face moved outward by `by` ≥ 0; an empty box stays empty.
fn grown(b: Aabb, by: f64) -> Aabb {
    if b.is_empty() || by <= 0.0 { b } else { Aabb::new(b.min - by, b.max + by) }
}

/// The gradient of `value` at `p` by steps of `h` each way.
pub fn central_difference(value: impl Fn(DVec3) -> f64, p: DVec3, h: f64) -> DVec3 {
    let along = |d: DVec3| value(p + h * d) - value(p - h * d);
    DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z)) / (2.0 * h)
}
