//! The cards that a bundle of rays meets, found for all of them at once.
//!
//! Rays of a bundle are close to one another and run nearly along one axis, as those through one pixel do, and those from what
//! is seen in a pixel towards one light. So one walk through the hierarchy finds the cards near them all, and each card is
//! brought into the bundle's frame once, in which a ray is a point of the plane that moves with depth.
//!
//! Based on: L. Carpenter, *The A-buffer*, SIGGRAPH 1984.

use super::shear::is_within;
use super::{Contact, Mesh, Triangle, is_front};
use crate::geom::{DMat3, DVec2, DVec3, Ray};
use crate::scene::{Material, Model, Part, Texture};

/// Cosine to the axis below which a ray does not belong to a bundle.
const MIN_COSINE: f64 = 0.1;

/// Rays of one bundle.
pub struct Bundle {
    origin: DVec3,
    /// Rows: the frame's axes; rays run along the third.
    to_frame: DMat3,
    rays: Vec<Slanted>,
    /// Whether the rays are camera rays, which meet single-sided cards from the front only.
    is_camera: bool,
    /// Least and largest values over all rays.
    at: [DVec2; 2],
    slope: [DVec2; 2],
    depth: [f64; 2],
}

/// A ray in its bundle's frame.
#[derive(Clone, Copy)]
struct Slanted {
    /// Place in the plane at depth 0, and how far it moves per depth.
    at: DVec2,
    slope: DVec2,
    /// Depths between which it looks.
    from: f64,
    to: f64,
}

/// Intersection of one of the rays with a card.
pub struct BundleHit {
    /// Number of the ray in its bundle.
    pub ray: usize,
    /// Distance along the axis, by which contacts of one ray are in the order in which it meets them.
    pub depth: f64,
    /// Its distance is that along the ray.
    pub contact: Contact,
}

impl Bundle {
    /// A bundle without rays, from about the origin of `axis` along its unit direction.
    pub fn new(axis: Ray) -> Bundle {
        let (x, y) = axis.dir.any_orthonormal_pair();
        Bundle {
            origin: axis.origin,
            to_frame: DMat3::from_cols(x, y, axis.dir).transpose(),
            rays: Vec::new(),
            is_camera: false,
            at: [DVec2::INFINITY, DVec2::NEG_INFINITY],
            slope: [DVec2::INFINITY, DVec2::NEG_INFINITY],
            depth: [f64::INFINITY, f64::NEG_INFINITY],
        }
    }

    /// The same for camera rays, which meet single-sided cards from the front only.
    pub fn of_camera(axis: Ray) -> Bundle {
        Bundle { is_camera: true, ..Bundle::new(axis) }
    }

    /// Add a ray that looks between the distances `from` and `to`. One that runs across the axis meets nothing.
    pub fn push(&mut self, ray: &Ray, from: f64, to: f64) {
        let (origin, dir) = (self.to_frame * (ray.origin - self.origin), self.to_frame * ray.dir);
        if !(dir.z > MIN_COSINE && origin.is_finite()) {
            self.rays.push(Slanted { at: DVec2::ZERO, slope: DVec2::ZERO, from: f64::INFINITY, to: f64::INFINITY });
            return;
        }
        let slope = dir.truncate() / dir.z;
        let at = origin.truncate() - origin.z * slope;
        let [from, to] = [from, to].map(|t| origin.z + t * dir.z);
        self.at = [self.at[0].min(at), self.at[1].max(at)];
        self.slope = [self.slope[0].min(slope), self.slope[1].max(slope)];
        self.depth = [self.depth[0].min(from), self.depth[1].max(to)];
        self.rays.push(Slanted { at, slope, from, to });
    }

    /// Number of rays.
    pub fn len(&self) -> usize {
        self.rays.len()
    }

    fn local(&self, p: DVec3) -> DVec3 {
        self.to_frame * (p - self.origin)
    }

    /// Least and largest place that rays have at a depth.
    fn range(&self, depth: f64) -> [DVec2; 2] {
        let [a, b] = self.slope.map(|s| s * depth);
        [self.at[0] + a.min(b), self.at[1] + a.max(b)]
    }

    /// Whether the box around a triangle may be met.
    fn may_meet(&self, corners: &[DVec3; 3]) -> bool {
        let [a, b, c] = *corners;
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let [near, far] = [low.z.max(self.depth[0]), high.z.min(self.depth[1])];
        if near > far {
            return false;
        }
        let [near, far] = [near, far].map(|depth| self.range(depth));
        let [least, most] = [near[0].min(far[0]), near[1].max(far[1])];
        low.truncate().cmple(most).all() && high.truncate().cmpge(least).all()
    }
}

/// Where a moved ray, which is the origin now, meets a triangle: weights of its second and third corner.
#[inline]
fn weights_at([a, b, c]: [DVec2; 3]) -> Option<[f64; 2]> {
    let (u, v, w) = (b.perp_dot(c), c.perp_dot(a), a.perp_dot(b));
    let (least, most) = (u.min(v).min(w), u.max(v).max(w));
    if least < 0.0 && most > 0.0 {
        return None;
    }
    // On an edge: of the triangles that share it, one is met.
    if (least == 0.0 || most == 0.0) && !is_within([a, b, c].map(|p| p.to_array())) {
        return None;
    }
    let det = u + v + w;
    (det != 0.0).then_some([v / det, w / det])
}

/// What tells the share of a card that is there at a point of it.
struct CardAlpha<'a> {
    material: &'a Material,
    texture: Option<(&'a Texture, [[f32; 2]; 3])>,
    corner_alphas: [f32; 3],
}

impl CardAlpha<'_> {
    fn at(&self, contact: &Contact) -> f32 {
        let weights = contact.weights();
        let own: f32 = (0..3).map(|i| weights[i] * self.corner_alphas[i]).sum();
        let sampled = self.texture.map_or(1.0, |(texture, corners)| {
            texture.alpha([0, 1].map(|k| (0..3).map(|i| weights[i] * corners[i][k]).sum()))
        });
        self.material.alpha.share(self.material.base_color[3] * own * sampled)
    }
}

impl Mesh {
    /// Tell `each` of every card that a ray of the bundle meets, but for the triangle `skip`; in no order.
    pub fn cards_along(&self, model: &Model, bundle: &Bundle, skip: Option<u32>, mut each: impl FnMut(BundleHit)) {
        let [from, to] = bundle.depth;
        if from.partial_cmp(&to) != Some(std::cmp::Ordering::Less) {
            return;
        }
        let dir = bundle.to_frame.transpose().z_axis;
        let axis = Ray { origin: bundle.origin + from * dir, dir };
        let [wide, steep] = [bundle.at, bundle.slope].map(|[a, b]| a.abs().max(b.abs()).length());
        let reach = |t: f64| wide + steep * (from.abs() + t);
        self.card_bvh.each_near(&axis, to - from, reach, |item| {
            let index = self.cards[item as usize];
            if skip != Some(index) {
                self.card_along(model, bundle, index, &mut each);
            }
            true
        });
    }

    fn card_along(&self, model: &Model, bundle: &Bundle, index: u32, each: &mut impl FnMut(BundleHit)) {
        let triangle = &self.triangles[index as usize];
        let corners = self.corners(triangle).map(|p| bundle.local(p));
        if !bundle.may_meet(&corners) {
            return;
        }
        let depths = corners.map(|c| c.z);
        let mut known = None;
        let instance = &model.instances[triangle.instance as usize];
        let is_double = !bundle.is_camera || model.materials[model.parts[instance.part].material].double_sided;
        let to_world = bundle.to_frame.transpose();
        for (number, ray) in bundle.rays.iter().enumerate() {
            let Some(b) = weights_at(corners.map(|c| c.truncate() - ray.at - c.z * ray.slope)) else { continue };
            let depth = depths[0] + b[0] * (depths[1] - depths[0]) + b[1] * (depths[2] - depths[0]);
            if !(depth > ray.from && depth < ray.to) {
                continue;
            }
            let dir = || to_world * ray.slope.extend(1.0);
            if !is_double && !is_front(&self.corners(triangle), dir(), &instance.transform) {
                continue;
            }
            let t = (depth - ray.from) * (1.0 + ray.slope.length_squared()).sqrt();
            let mut contact = Contact { t, triangle: index, b, alpha: 1.0 };
            contact.alpha = known.get_or_insert_with(|| self.card_alpha(model, triangle)).at(&contact);
            if contact.alpha > 0.0 {
                each(BundleHit { ray: number, depth, contact });
            }
        }
    }

    fn card_alpha<'a>(&self, model: &'a Model, triangle: &Triangle) -> CardAlpha<'a> {
        let part: &Part = &model.parts[model.instances[triangle.instance as usize].part];
        let material = &model.materials[part.material];
        let middle = Contact { t: 0.0, triangle: 0, b: [1.0 / 3.0; 2], alpha: 1.0 };
        match self.lookup(part, material, triangle, &middle, 0.0) {
            Some(lookup) => CardAlpha {
                material,
                texture: Some((lookup.texture, lookup.corners)),
                corner_alphas: lookup.corner_alphas,
            },
            None => CardAlpha { material, texture: None, corner_alphas: self.corner_alphas(part, triangle) },
        }
    }
}
