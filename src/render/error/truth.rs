//! The source of a texel as triangles with a look and soft matter, for rays in texel space.

use std::f64::consts::PI;

use crate::geom::{Aabb, DVec3, Ray};
use crate::render::bvh::Bvh;
use crate::render::mesh::Shear;

/// A triangle of the source, texel space.
#[derive(Debug, Clone, Copy)]
pub struct Facet {
    /// Corners, in order.
    pub corners: [DVec3; 3],
    /// The source's own number for what this is a piece of.
    pub number: u32,
    /// Whether alpha cuts something out of it.
    pub cut_out: bool,
}

/// Semi-transparent matter that fills a box evenly, texel space.
#[derive(Debug, Clone, Copy)]
pub struct Soft {
    /// The box that it fills.
    pub bounds: Aabb,
    /// Hits in an edge of the cube, > 0, in the mean over all directions.
    pub extinction: f64,
    /// Share of the matter that is flakes square to `normal`, in [0, 1]; the rest looks the same from every side.
    pub flat: f64,
    /// Unit, or zero where nothing is flat.
    pub normal: DVec3,
    /// Linear.
    pub albedo: [f32; 3],
}

impl Soft {
    /// Hits in an edge along `w`, and the share of them on flat matter.
    fn along(&self, w: DVec3) -> (f64, f64) {
        // Flakes of one normal: |n . w| is 1/2 in the mean.
        let flat = self.flat * 2.0 * self.normal.dot(w).abs();
        let all = 1.0 - self.flat + flat;
        (self.extinction * all, if all > 0.0 { flat / all } else { 0.0 })
    }
}

/// Linear colour and alpha in [0, 1] of the facet of that number at a point of texel space.
pub type Look<'a> = dyn Fn(u32, DVec3) -> ([f32; 3], f32) + Sync + 'a;

/// A source, ready for rays.
pub struct Truth<'a> {
    facets: Vec<Facet>,
    bvh: Bvh,
    soft: Vec<Soft>,
    soft_bvh: Bvh,
    look: &'a Look<'a>,
}

/// Matter that a ray sees: a share of the ray ends on each.
#[derive(Debug, Clone, Copy)]
pub struct Layer {
    pub facet: u32,
    pub t: f64,
    /// Share of the ray.
    pub weight: f64,
    pub albedo: [f32; 3],
    /// Unit, towards the viewer.
    pub normal: DVec3,
    /// Share of it that has this normal; the rest is a cloud of specks that look the same from every side.
    pub flat: f64,
}

impl Layer {
    /// Mean of max(0, n·l), seen along the unit `w`.
    pub fn lit(&self, w: DVec3, l: DVec3) -> f64 {
        // Of a ball: its disc shows cos over the viewer's half, of which the crescent towards the light is lit.
        let cos = -w.dot(l).clamp(-1.0, 1.0);
        let angle = libm::acos(cos);
        let ball = 2.0 / (3.0 * PI) * (libm::sin(angle) + (PI - angle) * cos);
        self.flat * self.normal.dot(l).max(0.0) + (1.0 - self.flat) * ball
    }
}

/// What layers of semi-transparent matter have for a facet.
const NO_FACET: u32 = u32::MAX;

/// Rays that start on a facet do not meet what is nearer than this, cube edges.
const APART: f64 = 1e-7;

impl<'a> Truth<'a> {
    /// Facets and soft matter within or about the unit cube; facets that are not finite are left out.
    pub fn new(mut facets: Vec<Facet>, soft: Vec<Soft>, look: &'a Look<'a>) -> Truth<'a> {
        facets.retain(|f| f.corners.iter().all(|c| c.is_finite()));
        let bounds: Vec<Aabb> = facets.iter().map(|f| Aabb::around(f.corners)).collect();
        let boxes: Vec<Aabb> = soft.iter().map(|s| s.bounds).collect();
        Truth { bvh: Bvh::new(bounds), facets, soft_bvh: Bvh::new(boxes), soft, look }
    }

    /// Calls `found` with the soft matter on the ray's way up to `end`, in no order: from where to where.
    fn soft(&self, ray: &Ray, end: f64, mut found: impl FnMut(&Soft, f64, f64)) {
        let inverse = 1.0 / ray.dir;
        self.soft_bvh.nearest(ray, end, |index, end| {
            let soft = &self.soft[index as usize];
            if let Some((from, to)) = soft.bounds.hit(ray.origin, inverse, 0.0, end).filter(|(from, to)| to > from) {
                found(soft, from, to);
            }
            end
        });
    }

    fn meet(&self, shear: &Shear, ray: &Ray, index: u32) -> Option<f64> {
        shear.meet(self.facets[index as usize].corners.map(|c| c - ray.origin)).map(|m| m.0)
    }

    /// Matter that `ray` sees, front to back; returns the share that comes through.
    pub fn see(&self, ray: &Ray, layers: &mut Vec<Layer>) -> f64 {
        layers.clear();
        let shear = Shear::new(ray.dir);
        let layer = |facet: u32, t: f64, alpha: f32, albedo: [f32; 3]| {
            let [a, b, c] = self.facets[facet as usize].corners;
            let normal = (b - a).cross(c - a).normalize_or_zero();
            let normal = if normal.dot(ray.dir) > 0.0 { -normal } else { normal };
            Layer { facet, t, weight: f64::from(alpha), albedo, normal, flat: 1.0 }
        };
        let mut last: Option<(u32, f64)> = None;
        let end = self.bvh.nearest(ray, f64::INFINITY, |index, t1| {
            let Some(t) = self.meet(&shear, ray, index).filter(|&t| t > 0.0 && t < t1) else { return t1 };
            let facet = &self.facets[index as usize];
            if !facet.cut_out {
                last = Some((index, t));
                return t;
            }
            let (albedo, alpha) = (self.look)(facet.number, ray.at(t));
            if alpha > 0.0 {
                layers.push(layer(index, t, alpha.min(1.0), albedo));
            }
            t1
        });
        layers.retain(|l| l.t < end);
        let length = ray.dir.length();
        let w = ray.dir / length;
        self.soft(ray, end, |soft, from, to| {
            let (rate, flat) = soft.along(w);
            let weight = -libm::expm1(-rate * (to - from) * length);
            let normal = if soft.normal.dot(w) > 0.0 { -soft.normal } else { soft.normal };
            layers.push(Layer { facet: NO_FACET, t: 0.5 * (from + to), weight, albedo: soft.albedo, normal, flat });
        });
        layers.sort_by(|a, b| a.t.total_cmp(&b.t).then(a.facet.cmp(&b.facet)));
        if let Some((index, t)) = last {
            let (albedo, _) = (self.look)(self.facets[index as usize].number, ray.at(t));
            layers.push(layer(index, t, 1.0, albedo));
        }
        let mut through = 1.0;
        for layer in layers {
            layer.weight *= through;
            through -= layer.weight;
        }
        through.max(0.0)
    }

    /// The share that comes through along `ray`, which starts on the facet `skip`.
    pub fn open(&self, ray: &Ray, skip: u32) -> f64 {
        let shear = Shear::new(ray.dir);
        let mut through = 1.0;
        let end = self.bvh.nearest(ray, f64::INFINITY, |index, t1| {
            if index == skip {
                return t1;
            }
            let Some(t) = self.meet(&shear, ray, index).filter(|&t| t > APART) else { return t1 };
            let facet = &self.facets[index as usize];
            through *= if facet.cut_out { 1.0 - f64::from((self.look)(facet.number, ray.at(t)).1) } else { 0.0 };
            if through <= 0.0 { -1.0 } else { t1 }
        });
        if end < 0.0 {
            return 0.0;
        }
        let (length, mut depth) = (ray.dir.length(), 0.0);
        self.soft(ray, f64::INFINITY, |soft, from, to| depth += soft.along(ray.dir / length).0 * (to - from) * length);
        through * libm::exp(-depth)
    }
}
