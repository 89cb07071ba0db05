//! Implicit surfaces around skeletons of points, segments and triangles with weights.
//!
//! Based on: F. Neyret, *Synthesizing Verdant Landscapes using Volumetric Textures*, INRIA RR-2846, 1996, section 3.1 (the
//! potential Σ w / d² and its distance 1/√pot − 1); J. Blinn, *A Generalization of Algebraic Surface Drawing*, ACM TOG 1,
//! 1982 (Gaussians); G. Wyvill, C. McPheeters, B. Wyvill, *Data Structure for Soft Objects*, The Visual Computer 2, 1986
//! (a kernel that ends).

use super::shapes::{nearest_of_segment, nearest_of_triangle};
use super::{Field, grown};
use crate::geom::{Aabb, DVec3};

/// Point, segment or triangle that a potential falls off from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bone {
    /// A point, source units.
    Point(DVec3),
    /// The line between two points.
    Segment([DVec3; 2]),
    /// The area between three corners.
    Triangle([DVec3; 3]),
}

impl Bone {
    fn nearest(&self, p: DVec3) -> DVec3 {
        match *self {
            Bone::Point(a) => a,
            Bone::Segment([a, b]) => nearest_of_segment(p, a, b),
            Bone::Triangle(t) => nearest_of_triangle(p, t),
        }
    }

    fn bounds(&self) -> Aabb {
        match self {
            Bone::Point(a) => Aabb::new(*a, *a),
            Bone::Segment(s) => Aabb::around(*s),
            Bone::Triangle(t) => Aabb::around(*t),
        }
    }
}

/// One bone's share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Element {
    /// Shape that the potential falls off from.
    pub bone: Bone,
    /// Not 0; below 0 the bone pushes matter away.
    pub weight: f64,
    /// Linear Rec. 709; `None` where it has no colour of its own.
    pub colour: Option<[f32; 3]>,
}

/// Law by which a bone's potential falls off with the distance d.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kernel {
    /// 1 / d²: a bone of weight w alone has the radius √w.
    InverseSquare,
    /// e^(−d² / radius²).
    Gaussian {
        /// Distance at which it has fallen to 1/e, > 0.
        radius: f64,
    },
    /// (1 − d² / radius²)³, and 0 from the radius on.
    Wyvill {
        /// Distance at which it ends, > 0.
        radius: f64,
    },
}

impl Kernel {
    /// The potential at the squared distance `d2`, and its derivative by `d2`.
    fn potential(self, d2: f64) -> (f64, f64) {
        match self {
            Kernel::InverseSquare => {
                let inverse = 1.0 / d2.max(1e-30);
                (inverse, -inverse * inverse)
            }
            Kernel::Gaussian { radius } => {
                let e = libm::exp(-d2 / (radius * radius));
                (e, -e / (radius * radius))
            }
            Kernel::Wyvill { radius } => {
                let left = (1.0 - d2 / (radius * radius)).max(0.0);
                (left * left * left, -3.0 * left * left / (radius * radius))
            }
        }
    }

    /// The greatest slope by d; of `InverseSquare` there is none.
    fn slope(self) -> f64 {
        match self {
            Kernel::InverseSquare => f64::INFINITY,
            // At d = radius / √2: √2 e^(−1/2) / radius.
            Kernel::Gaussian { radius } => 0.857_763_885 / radius,
            // At d = radius / √5: 6 / √5 (4/5)² / radius.
            Kernel::Wyvill { radius } => 1.717_300_207 / radius,
        }
    }
}

/// The surface where the sum of the bones' potentials is `level`.
pub struct Skeleton {
    elements: Vec<Element>,
    kernel: Kernel,
    level: f64,
    /// Factor on the value, so that it grows no faster than the distance.
    scale: f64,
}

impl Skeleton {
    /// `level` > 0.
    pub fn new(elements: Vec<Element>, kernel: Kernel, level: f64) -> Skeleton {
        let scale = match kernel {
            // |grad pot^(−1/2)| ≤ 1/√(least weight), where all are above 0.
            Kernel::InverseSquare => {
                elements.iter().map(|e| e.weight.abs()).fold(f64::INFINITY, f64::min).sqrt() / level.sqrt()
            }
            _ => 1.0 / (kernel.slope() * elements.iter().map(|e| e.weight.abs()).sum::<f64>()),
        };
        Skeleton { elements, kernel, level, scale: if scale.is_finite() { scale } else { 1.0 } }
    }

    fn value_of(&self, potential: f64) -> f64 {
        match self.kernel {
            Kernel::InverseSquare if potential <= 0.0 => f64::INFINITY,
            Kernel::InverseSquare => self.scale * ((self.level / potential).sqrt() - 1.0),
            _ => self.scale * (self.level - potential),
        }
    }

    fn potential(&self, p: DVec3) -> f64 {
        self.elements.iter().map(|e| e.weight * self.kernel.potential(p.distance_squared(e.bone.nearest(p))).0).sum()
    }
}

impl Field for Skeleton {
    fn value(&self, p: DVec3) -> f64 {
        self.value_of(self.potential(p))
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        let slope = |e: &Element| {
            let away = p - e.bone.nearest(p);
            2.0 * e.weight * self.kernel.potential(away.length_squared()).1 * away
        };
        let slope: DVec3 = self.elements.iter().map(slope).sum();
        let outer = match self.kernel {
            Kernel::InverseSquare => 0.5 * (self.level / self.potential(p).max(1e-30).powi(3)).sqrt(),
            _ => 1.0,
        };
        -self.scale * outer * slope
    }

    fn slope(&self) -> f64 {
        let pushed = self.elements.iter().any(|e| e.weight < 0.0);
        if pushed && self.kernel == Kernel::InverseSquare { f64::INFINITY } else { 1.0 }
    }

    fn range(&self, b: &Aabb) -> (f64, f64) {
        let (centre, reach) = (b.centre(), 0.5 * b.size().length());
        let (mut least, mut most) = (0.0, 0.0);
        for e in &self.elements {
            let d = centre.distance(e.bone.nearest(centre));
            let at = |d: f64| e.weight * self.kernel.potential(d * d).0;
            let (near, far) = (at((d - reach).max(0.0)), at(d + reach));
            least += near.min(far);
            most += near.max(far);
        }
        (self.value_of(most), self.value_of(least))
    }

    fn bounds(&self) -> Aabb {
        self.bounds_of(0.0)
    }

    fn bounds_of(&self, level: f64) -> Aabb {
        let whole: f64 = self.elements.iter().map(|e| e.weight.max(0.0)).sum();
        // The potential that is needed, and how far from all bones it is never reached.
        let reach = match self.kernel {
            Kernel::InverseSquare => {
                let ratio = 1.0 + level.max(0.0) / self.scale;
                (whole * ratio * ratio / self.level).sqrt()
            }
            Kernel::Gaussian { radius } => {
                let needed = self.level - level.max(0.0) / self.scale;
                if needed > 0.0 { radius * libm::log((whole / needed).max(1.0)).sqrt() } else { f64::INFINITY }
            }
            Kernel::Wyvill { radius } => {
                if self.level > level.max(0.0) / self.scale {
                    radius
                } else {
                    f64::INFINITY
                }
            }
        };
        let bones = self.elements.iter().filter(|e| e.weight > 0.0).map(|e| e.bone.bounds());
        grown(bones.fold(Aabb::EMPTY, Aabb::union), reach)
    }

    fn colour(&self, p: DVec3) -> Option<[f32; 3]> {
        let (mut sum, mut colour) = (0.0, DVec3::ZERO);
        for e in self.elements.iter().filter(|e| e.weight > 0.0) {
            let share = e.weight * self.kernel.potential(p.distance_squared(e.bone.nearest(p))).0;
            sum += share;
            colour += share * DVec3::from(e.colour.unwrap_or([1.0; 3]).map(f64::from));
        }
        (sum > 0.0).then(|| (colour / sum).as_vec3().to_array())
    }

    fn has_colour(&self) -> bool {
        self.elements.iter().any(|e| e.colour.is_some())
    }
}
