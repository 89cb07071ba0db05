//! Boxes, rays and the fixed directions; points and matrices are glam's. World and texel space are f64, voxels f32.

pub mod polygon;
#[cfg(feature = "bake")]
pub(crate) mod projection;

pub use glam::{DAffine3, DMat3, DMat4, DVec2, DVec3, Mat3, Vec2, Vec3};

/// `f` of each of three things, inlined: `array::map` calls a function for each of them where `f` is more than a few instructions and
/// the build does not optimise across the parts of the crate.
#[inline(always)]
pub(crate) fn each3<T, U>([a, b, c]: [T; 3], f: impl Fn(T) -> U) -> [U; 3] {
    [f(a), f(b), f(c)]
}

/// An axis-aligned box; empty while any `min > max`.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Aabb {
    /// Lower corner.
    pub min: DVec3,
    /// Upper corner.
    pub max: DVec3,
}

impl Aabb {
    /// The box that holds nothing: the identity of [`Aabb::union`].
    pub const EMPTY: Aabb = Aabb { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };
    /// The reference cube of a texel.
    pub const UNIT: Aabb = Aabb { min: DVec3::ZERO, max: DVec3::ONE };

    /// The box between two corners.
    pub fn new(min: DVec3, max: DVec3) -> Self {
        Aabb { min, max }
    }

    /// The smallest box around `points`.
    pub fn around(points: impl IntoIterator<Item = DVec3>) -> Self {
        points.into_iter().fold(Aabb::EMPTY, |b, p| b.grow(p))
    }

    /// The smallest box around this one and `p`.
    pub fn grow(self, p: DVec3) -> Self {
        Aabb { min: self.min.min(p), max: self.max.max(p) }
    }

    /// The smallest box around both boxes.
    pub fn union(self, other: Aabb) -> Self {
        Aabb { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// The box that both boxes share; empty where they do not meet.
    pub fn intersection(self, other: Aabb) -> Self {
        Aabb { min: self.min.max(other.min), max: self.max.min(other.max) }
    }

    /// The box around this one's corners where `map` takes them.
    pub fn transformed(self, map: DAffine3) -> Self {
        if self.is_empty() {
            return Aabb::EMPTY;
        }
        let corner = |i: usize| {
            DVec3::from_array(std::array::from_fn(|a| if i >> a & 1 == 0 { self.min[a] } else { self.max[a] }))
        };
        Aabb::around((0..8).map(|i| map.transform_point3(corner(i))))
    }

    /// Whether the boxes share a point, faces included.
    pub fn overlaps(self, other: Aabb) -> bool {
        !self.intersection(other).is_empty()
    }

    /// With room for what a few roundings of its coordinates move.
    pub fn rounded_out(self) -> Self {
        let room = 1e-9 * (1.0 + self.min.abs().max(self.max.abs()).max_element());
        Aabb { min: self.min - room, max: self.max + room }
    }

    /// Whether the box holds no point.
    pub fn is_empty(&self) -> bool {
        !(self.min.cmple(self.max)).all()
    }

    /// Edge lengths.
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// Midpoint between the corners.
    pub fn centre(&self) -> DVec3 {
        0.5 * (self.min + self.max)
    }

    /// The interval of `t` in which `origin + t * dir` is inside, within `[t0, t1]`; `None` where it misses.
    /// A zero component of `dir` is handled by IEEE infinities; the far bound is widened by 1 + 2 gamma(3)
    /// (Ize, *Robust BVH Ray Traversal*, 2013), so that no ray slips between two boxes that touch.
    pub fn hit(&self, origin: DVec3, inv_dir: DVec3, t0: f64, t1: f64) -> Option<(f64, f64)> {
        const PAD: f64 = 1.0 + 2.0 * (3.0 * f64::EPSILON) / (1.0 - 3.0 * f64::EPSILON);
        let (mut near, mut far) = (t0, t1);
        for k in 0..3 {
            let (a, b) = ((self.min[k] - origin[k]) * inv_dir[k], (self.max[k] - origin[k]) * inv_dir[k]);
            if a.is_nan() || b.is_nan() {
                continue; // 0 * inf: the ray runs along the face that its origin lies on, which counts as inside.
            }
            near = near.max(a.min(b));
            far = far.min(a.max(b) * PAD);
        }
        (near <= far).then_some((near, far))
    }
}

/// A half-line `origin + t * dir`, t ≥ 0; `dir` need not be of unit length.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Start of the ray.
    pub origin: DVec3,
    /// Direction, of any length above 0.
    pub dir: DVec3,
}

impl Ray {
    /// The point at parameter `t`.
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.dir
    }
}

/// The 13 axes through a cube's faces (0–2), edges (3–8) and corners (9–12), as integers; a unit direction is this over its length.
/// Every measurement of a voxel is taken along these (both ways give the same chord).
pub const AXES13: [[i8; 3]; 13] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 1, 0],
    [1, -1, 0],
    [1, 0, 1],
    [1, 0, -1],
    [0, 1, 1],
    [0, 1, -1],
    [1, 1, 1],
    [1, 1, -1],
    [1, -1, 1],
    [-1, 1, 1],
];

/// [`AXES13`] as unit vectors.
pub fn directions13() -> [DVec3; 13] {
    AXES13.map(|a| DVec3::new(a[0].into(), a[1].into(), a[2].into()).normalize())
}

/// |W| of the axis `k` of [`AXES13`].
#[inline]
pub const fn axis_length(k: usize) -> f64 {
    const LENGTH: [f64; 3] = [1.0, std::f64::consts::SQRT_2, 1.732_050_807_568_877_2];
    LENGTH[(k > 2) as usize + (k > 8) as usize]
}

/// Oblique area, along the axis `k`, of the box with edges `e`: the lines that it blocks when it is full.
#[inline]
pub fn box_area(k: usize, e: DVec3) -> f64 {
    let w = AXES13[k];
    let on = |i: usize| f64::from(w[i].abs());
    e.y * e.z * on(0) + e.x * e.z * on(1) + e.x * e.y * on(2)
}

/// Oblique area of `area` (an area vector) along the axis `k`.
#[inline]
pub fn oblique_area(k: usize, area: DVec3) -> f64 {
    let w = AXES13[k];
    (area.x * f64::from(w[0]) + area.y * f64::from(w[1]) + area.z * f64::from(w[2])).abs()
}

/// The larger of two numbers; of which one is returned where they do not compare is not said. One instruction, unlike [`f32::max`].
#[inline(always)]
pub fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The smaller of two numbers, as [`larger`].
#[inline(always)]
pub fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slab_is_exact_along_axes_and_on_faces() {
        let inv = |d: DVec3| 1.0 / d;
        let b = Aabb::UNIT;
        let (t0, t1) = b.hit(DVec3::new(-1.0, 0.5, 0.5), inv(DVec3::X), 0.0, f64::INFINITY).unwrap();
        assert_eq!(t0, 1.0);
        assert!((2.0..2.0 + 1e-14).contains(&t1));
        // Along a face, an edge and through a corner: inside, by convention.
        assert!(b.hit(DVec3::new(-1.0, 0.0, 0.5), inv(DVec3::X), 0.0, 9.0).is_some());
        assert!(b.hit(DVec3::new(-1.0, 1.0, 1.0), inv(DVec3::X), 0.0, 9.0).is_some());
        assert!(b.hit(DVec3::splat(-1.0), inv(DVec3::ONE), 0.0, 9.0).is_some());
        assert!(b.hit(DVec3::new(-1.0, 1.5, 0.5), inv(DVec3::X), 0.0, 9.0).is_none());
    }
}
