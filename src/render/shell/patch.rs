//! The box over a bilinear patch: its base, its top and its walls are bilinear patches, and what lies between them is the
//! trilinear map of a cube, in space as in texel coordinates.
//!
//! Based on: F. Neyret, *Synthesizing Verdant Landscapes using Volumetric Textures*, RR-2846, 1996, 4.1 (both maps are
//! trilinear); S. Ramsey, K. Potter, C. Hansen, *Ray Bilinear Patch Intersections*, JGT 2004; A. Reshetov, *Cool Patches*,
//! Ray Tracing Gems, 2019 (where a ray enters and leaves); E. Allgower, K. Georg, *Numerical Continuation Methods*, 1990 (a
//! curve is followed by predicting from its derivatives and correcting by Newton's method); D. Filip, R. Magedson, R. Markot,
//! *Surface Algorithms using Bounds on Derivatives*, CAGD 1986 (a chord of length l strays from a curve by at most l²/8 times
//! the largest second derivative).

use super::corner::{Corner, HeightInShell, MAX_CELLS, ShellSegment};
use super::trilinear::{Inverse, Trilinear, outside};
use super::wall::{Crossings, Wall};
use crate::geom::{Aabb, DMat3, DVec3, Ray};

/// A box over a patch, with heights of any kind.
#[derive(Debug, Clone)]
pub struct PatchBox {
    corners: [Corner; 4],
    walls: [Wall; 4],
    /// (U, V, W) → space, relative to the first corner, and its inverse.
    space: Inverse,
    /// (U, V, W) → texel coordinates.
    texel: Trilinear,
    bounds: Aabb,
}

/// Reasons why a patch has no box of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PatchFault {
    /// Two neighbouring corners are one.
    Collapsed,
    /// It is concave, flat, or its height vectors cross: it turns inside out somewhere, or nearly does.
    Folded,
}

/// A point of a ray, and the curve that the ray is in the box's parameters (U, V, W) and in texel coordinates.
#[derive(Clone, Copy)]
struct CurvePoint {
    t: f64,
    /// The point's parameters (U, V, W).
    s: DVec3,
    /// First and second derivative of `s` with respect to t.
    speed: DVec3,
    acceleration: DVec3,
    /// The point's texel coordinates.
    q: DVec3,
    /// Length of the second derivative of `q` with respect to t.
    curvature: f64,
    /// World → texel, the linear part.
    to_texel: DMat3,
}

/// Most halvings of a segment.
const MAX_HALVINGS: u32 = 8;
/// Distance outside the unit cube of parameters at which a point still counts as inside, because of rounding.
const INSIDE_TOLERANCE: f64 = 1e-9;

impl PatchBox {
    /// The box over the corners at (U, V) = (0, 0), (1, 0), (1, 1), (0, 1).
    ///
    /// # Errors
    /// Where its map to space has no inverse.
    pub fn new(corners: &[Corner; 4]) -> Result<PatchBox, PatchFault> {
        let [a, b, c, d] = corners;
        let next = |k: usize| &corners[(k + 1) % 4];
        if (0..4).any(|k| corners[k].p == next(k).p) {
            return Err(PatchFault::Collapsed);
        }
        let space = Trilinear::new(corners.map(|k| k.p - a.p), corners.map(|k| k.h));
        let space = Inverse::new(space).ok_or(PatchFault::Folded)?;
        let texel = Trilinear::new(corners.map(|k| k.q), corners.map(|k| k.dw * DVec3::Z));
        Ok(PatchBox {
            corners: *corners,
            walls: [Wall::new(a, b), Wall::new(b, c), Wall::new(c, d), Wall::new(d, a)],
            space,
            texel,
            bounds: Aabb::around(corners.iter().flat_map(|k| [k.p, k.p + k.h])),
        })
    }

    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Depth of a point inside, a share of the box's size; not above 0 outside.
    pub fn depth_inside(&self, x: DVec3) -> f64 {
        self.locate(x).map_or(f64::NEG_INFINITY, |s| -outside(s))
    }

    fn locate(&self, x: DVec3) -> Option<DVec3> {
        self.space.locate(x - self.corners[0].p)
    }

    /// The intervals of t in [t0, t1] in which the ray is inside, in order.
    pub fn spans(&self, ray: &Ray, t0: f64, t1: f64, each: impl FnMut(f64, f64)) {
        let mut found = Crossings::new();
        for top in [false, true] {
            let [a, b, c, d] = self.corners.map(|k| if top { k.p + k.h } else { k.p });
            let (along_v, along_u) = (Wall::ruled([a, b], [d, c]), Wall::ruled([a, d], [b, c]));
            // A bilinear patch is ruled in both directions; the rulings that the ray crosses more squarely give better digits.
            let squarer = along_v.squareness(ray.dir) >= along_u.squareness(ray.dir);
            (if squarer { along_v } else { along_u }).crossings(ray, &mut found);
        }
        self.walls.iter().for_each(|w| w.crossings(ray, &mut found));
        found.spans(t0, t1, |t| self.locate(ray.at(t)).is_some_and(|s| outside(s) <= INSIDE_TOLERANCE), each);
    }

    fn mix(&self, s: DVec3, of: fn(&Corner) -> f64) -> f64 {
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| of(&self.corners[k]));
        (1.0 - s.y) * ((1.0 - s.x) * a + s.x * b) + s.y * ((1.0 - s.x) * d + s.x * c)
    }

    fn height_at(&self, s: DVec3) -> HeightInShell {
        let mask = self.mix(s, |k| k.jitter).clamp(0.0, 1.0);
        HeightInShell { rise: s.z * self.mix(s, |k| k.dw), height: s.z, mask }
    }

    /// The point at t, whose parameters are about `guess`; `None` where it is not in the box, or the box is flat there.
    fn point_at(&self, ray: &Ray, t: f64, guess: Option<DVec3>) -> Option<CurvePoint> {
        let x = ray.at(t) - self.corners[0].p;
        let s = match guess {
            Some(guess) => self.space.locate_from(x, guess)?,
            None => self.space.locate(x)?,
        };
        self.point_from(ray, t, s)
    }

    /// The point at t, whose parameters are `s`.
    fn point_from(&self, ray: &Ray, t: f64, s: DVec3) -> Option<CurvePoint> {
        let map = self.space.map();
        let inverse = map.derivative(s).inverse();
        let speed = inverse * ray.dir;
        // x'' = 0 = J s'' + (the map's own second derivative along s').
        let acceleration = -(inverse * map.second_derivative(s, speed));
        let along = self.texel.derivative(s);
        let curvature = (along * acceleration + self.texel.second_derivative(s, speed)).length();
        let to_texel = along * inverse;
        let place = CurvePoint { t, s, speed, acceleration, q: self.texel.at(s), curvature, to_texel };
        (to_texel.is_finite() && curvature.is_finite()).then_some(place)
    }

    /// Call `each` for straight segments that approximate the ray in texel coordinates over [t0, t1], which lies in one of
    /// [`PatchBox::spans`], in order, until it returns false. Each deviates from the exact curve by at most `tolerance(t, to_texel)`,
    /// in texel units. Returns false if stopped.
    pub fn for_each_segment(
        &self,
        ray: &Ray,
        t0: f64,
        t1: f64,
        tolerance: &dyn Fn(f64, &DMat3) -> f64,
        each: &mut dyn FnMut(&ShellSegment) -> bool,
    ) -> bool {
        // Any point inside: the first that is found of fifteen, beginning with the middle.
        let share = |k: u32| f64::from(k.reverse_bits() >> 28) / 16.0;
        let middle = (1..16).find_map(|k| self.point_at(ray, t0 + share(k) * (t1 - t0), None));
        let Some(middle) = middle else { return true };
        // In a box that is a million times higher at one corner than at the next, an end may lie outside by rounding.
        let end = |t: f64| {
            let inward = |k: &f64| self.point_at(ray, t + k * (middle.t - t), Some(middle.extrapolate(t)));
            let found = [0.0, 1e-9, 1e-6, 1e-3].iter().find_map(inward);
            found.or_else(|| self.point_from(ray, t, middle.extrapolate(t))).map(|found| CurvePoint { t, ..found })
        };
        let (Some(from), Some(to)) = (end(t0), end(t1)) else { return true };
        let mut walk = ChordSubdivision { shell: self, ray, tolerance, each };
        walk.cut([&from, &middle, &to], 0)
    }
}

impl CurvePoint {
    /// The parameters at t by a Taylor series of second order around this point.
    fn extrapolate(&self, t: f64) -> DVec3 {
        let by = t - self.t;
        // Clamped to the box, since far from this point the series is of no use.
        (self.s + by * (self.speed + 0.5 * by * self.acceleration)).clamp(DVec3::ZERO, DVec3::ONE)
    }
}

struct ChordSubdivision<'a> {
    shell: &'a PatchBox,
    ray: &'a Ray,
    tolerance: &'a dyn Fn(f64, &DMat3) -> f64,
    each: &'a mut dyn FnMut(&ShellSegment) -> bool,
}

impl ChordSubdivision<'_> {
    /// A segment, given by its ends and its middle: reported whole if its chord keeps to the tolerance, else halved.
    fn cut(&mut self, [from, middle, to]: [&CurvePoint; 3], depth: u32) -> bool {
        let length = to.t - from.t;
        let stray = length * length / 8.0 * from.curvature.max(middle.curvature).max(to.curvature);
        let halves = || {
            let at = |a: &CurvePoint, b: &CurvePoint| {
                let t = 0.5 * (a.t + b.t);
                self.shell.point_at(self.ray, t, Some(0.5 * (a.extrapolate(t) + b.extrapolate(t))))
            };
            Some((at(from, middle)?, at(middle, to)?))
        };
        if depth < MAX_HALVINGS
            && (to.q - from.q).abs().max_element() <= f64::from(MAX_CELLS)
            && stray > (self.tolerance)(middle.t, &middle.to_texel)
            && let Some((first, second)) = halves()
        {
            return self.cut([from, &first, middle], depth + 1) && self.cut([middle, &second, to], depth + 1);
        }
        let end_heights = [from, to].map(|end| self.shell.height_at(end.s));
        let (q0, q1, to_texel) = (from.q, to.q, middle.to_texel);
        (self.each)(&ShellSegment { t0: from.t, t1: to.t, q0, q1, to_texel, end_heights })
    }
}

#[cfg(test)]
mod tests;
