//! The source of a texel as ground truth: its triangles and boxes of participating medium, for rays in texel space.

use std::f64::consts::PI;

use crate::geom::{Aabb, DVec3, Ray};
use crate::render::bvh::Bvh;
use crate::render::mesh::Shear;

/// A triangle of the source, texel space.
#[derive(Debug, Clone, Copy)]
pub struct Facet {
    /// Corners, in order.
    pub corners: [DVec3; 3],
    /// The source's number of the facet that this triangle is a piece of.
    pub number: u32,
    /// Whether its alpha is below 1 somewhere.
    pub cut_out: bool,
}

/// A homogeneous participating medium in a box, texel space.
#[derive(Debug, Clone, Copy)]
pub struct MediumBox {
    /// The box that it fills.
    pub bounds: Aabb,
    /// Extinction per cube edge, > 0, averaged over all directions.
    pub extinction: f64,
    /// Share of the medium that is flakes at right angles to `normal`, in [0, 1]; the rest is isotropic.
    pub flat: f64,
    /// Unit normal of the flakes, or zero without flakes.
    pub normal: DVec3,
    /// Linear.
    pub albedo: [f32; 3],
}

impl MediumBox {
    /// Extinction per cube edge along the unit direction `w`, and the share of it that is due to flakes.
    fn extinction_along(&self, w: DVec3) -> (f64, f64) {
        // The mean of |n · w| over all directions is 1/2.
        let flat = self.flat * 2.0 * self.normal.dot(w).abs();
        let all = 1.0 - self.flat + flat;
        (self.extinction * all, if all > 0.0 { flat / all } else { 0.0 })
    }
}

/// Linear colour and alpha in [0, 1] of the facet with a given number, at a point of texel space.
pub type FacetAppearance<'a> = dyn Fn(u32, DVec3) -> ([f32; 3], f32) + Sync + 'a;

/// A source with hierarchies over its facets and media, ready for rays.
pub struct GroundTruth<'a> {
    facets: Vec<Facet>,
    bvh: Bvh,
    soft: Vec<MediumBox>,
    soft_bvh: Bvh,
    appearance: &'a FacetAppearance<'a>,
}

/// A hit of a ray in the ground truth, at which a share of the ray ends.
#[derive(Debug, Clone, Copy)]
pub struct TruthHit {
    pub facet: u32,
    pub t: f64,
    /// Share of the ray that ends here, in [0, 1].
    pub weight: f64,
    pub albedo: [f32; 3],
    /// Unit, towards the viewer.
    pub normal: DVec3,
    /// Share of the matter that has this normal; the rest is isotropic.
    pub flat: f64,
}

impl TruthHit {
    /// Mean of max(0, n·l), seen along the unit `w`.
    pub fn lit(&self, w: DVec3, l: DVec3) -> f64 {
        // Isotropic matter looks like a Lambertian sphere: its lit crescent, averaged over the visible disc.
        let cos = -w.dot(l).clamp(-1.0, 1.0);
        let angle = libm::acos(cos);
        let ball = 2.0 / (3.0 * PI) * (libm::sin(angle) + (PI - angle) * cos);
        self.flat * self.normal.dot(l).max(0.0) + (1.0 - self.flat) * ball
    }
}

/// In place of a facet's number, in hits of a medium.
const NO_FACET: u32 = u32::MAX;

/// Least distance of a hit from the start of a ray that starts on a facet, cube edges.
const SELF_HIT_DISTANCE: f64 = 1e-7;

impl<'a> GroundTruth<'a> {
    /// From facets and media in or near the unit cube; facets with corners that are not finite are left out.
    pub fn new(mut facets: Vec<Facet>, soft: Vec<MediumBox>, appearance: &'a FacetAppearance<'a>) -> GroundTruth<'a> {
        facets.retain(|f| f.corners.iter().all(|c| c.is_finite()));
        let bounds: Vec<Aabb> = facets.iter().map(|f| Aabb::around(f.corners)).collect();
        let boxes: Vec<Aabb> = soft.iter().map(|s| s.bounds).collect();
        GroundTruth { bvh: Bvh::new(bounds), facets, soft_bvh: Bvh::new(boxes), soft, appearance }
    }

    /// Calls `found` for each box of medium that the ray crosses before `end`, with the interval of its parameter, in no order.
    fn soft(&self, ray: &Ray, end: f64, mut found: impl FnMut(&MediumBox, f64, f64)) {
        let inverse = 1.0 / ray.dir;
        self.soft_bvh.nearest(ray, end, |index, end| {
            let soft = &self.soft[index as usize];
            if let Some((from, to)) = soft.bounds.hit(ray.origin, inverse, 0.0, end).filter(|(from, to)| to > from) {
                found(soft, from, to);
            }
            end
        });
    }

    fn intersect(&self, shear: &Shear, ray: &Ray, index: u32) -> Option<f64> {
        shear.meet(self.facets[index as usize].corners.map(|c| c - ray.origin)).map(|m| m.0)
    }

    /// Fill `hits` with the hits of `ray`, front to back; returns its transmittance.
    pub fn trace(&self, ray: &Ray, hits: &mut Vec<TruthHit>) -> f64 {
        hits.clear();
        let shear = Shear::new(ray.dir);
        let layer = |facet: u32, t: f64, alpha: f32, albedo: [f32; 3]| {
            let [a, b, c] = self.facets[facet as usize].corners;
            let normal = (b - a).cross(c - a).normalize_or_zero();
            let normal = if normal.dot(ray.dir) > 0.0 { -normal } else { normal };
            TruthHit { facet, t, weight: f64::from(alpha), albedo, normal, flat: 1.0 }
        };
        let mut last: Option<(u32, f64)> = None;
        let end = self.bvh.nearest(ray, f64::INFINITY, |index, t1| {
            let Some(t) = self.intersect(&shear, ray, index).filter(|&t| t > 0.0 && t < t1) else { return t1 };
            let facet = &self.facets[index as usize];
            if !facet.cut_out {
                last = Some((index, t));
                return t;
            }
            let (albedo, alpha) = (self.appearance)(facet.number, ray.at(t));
            if alpha > 0.0 {
                hits.push(layer(index, t, alpha.min(1.0), albedo));
            }
            t1
        });
        hits.retain(|l| l.t < end);
        let length = ray.dir.length();
        let w = ray.dir / length;
        self.soft(ray, end, |soft, from, to| {
            let (rate, flat) = soft.extinction_along(w);
            let weight = -libm::expm1(-rate * (to - from) * length);
            let normal = if soft.normal.dot(w) > 0.0 { -soft.normal } else { soft.normal };
            hits.push(TruthHit { facet: NO_FACET, t: 0.5 * (from + to), weight, albedo: soft.albedo, normal, flat });
        });
        hits.sort_by(|a, b| a.t.total_cmp(&b.t).then(a.facet.cmp(&b.facet)));
        if let Some((index, t)) = last {
            let (albedo, _) = (self.appearance)(self.facets[index as usize].number, ray.at(t));
            hits.push(layer(index, t, 1.0, albedo));
        }
        let mut through = 1.0;
        for layer in hits {
            layer.weight *= through;
            through -= layer.weight;
        }
        through.max(0.0)
    }

    /// Transmittance along `ray`, which starts on the facet `skip`.
    pub fn transmittance(&self, ray: &Ray, skip: u32) -> f64 {
        let shear = Shear::new(ray.dir);
        let mut through = 1.0;
        let end = self.bvh.nearest(ray, f64::INFINITY, |index, t1| {
            if index == skip {
                return t1;
            }
            let Some(t) = self.intersect(&shear, ray, index).filter(|&t| t > SELF_HIT_DISTANCE) else { return t1 };
            let facet = &self.facets[index as usize];
            through *= if facet.cut_out { 1.0 - f64::from((self.appearance)(facet.number, ray.at(t)).1) } else { 0.0 };
            if through <= 0.0 { -1.0 } else { t1 }
        });
        if end < 0.0 {
            return 0.0;
        }
        let (length, mut depth) = (ray.dir.length(), 0.0);
        self.soft(ray, f64::INFINITY, |soft, from, to| {
            depth += soft.extinction_along(ray.dir / length).0 * (to - from) * length
        });
        through * libm::exp(-depth)
    }
}
