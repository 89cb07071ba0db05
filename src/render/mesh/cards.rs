//! Which triangles are cards, and what is seen and shadowed by all others.

use super::{Contact, Mesh, RayQuery, Shear, through};
use crate::geom::{Aabb, Ray};
use crate::scene::Model;

impl Mesh {
    /// Whether there are cards: triangles whose alpha varies.
    pub fn has_cards(&self) -> bool {
        !self.cards.is_empty()
    }

    /// Whether there is nothing but cards.
    pub fn is_all_cards(&self) -> bool {
        self.cards.len() == self.triangles.len()
    }

    fn is_card(&self, triangle: u32) -> bool {
        self.has_cards() && self.cards.binary_search(&triangle).is_ok()
    }

    /// A contact as `ray`, beside the ray that has it, meets its plane: at the distance there, or at its own where that is far from
    /// it, as where the plane is seen from its edge.
    pub fn on_plane(&self, contact: &Contact, ray: &Ray) -> Contact {
        let [a, b, c] = self.corners(&self.triangles[contact.triangle as usize]);
        let normal = (b - a).cross(c - a);
        let t = normal.dot(a - ray.origin) / normal.dot(ray.dir);
        if t > 0.5 * contact.t && t < 2.0 * contact.t { Contact { t, ..*contact } } else { *contact }
    }

    /// Whether a card may come as near to the ray before `t1` as `reach(t)`.
    pub fn are_cards_near(&self, ray: &Ray, t1: f64, reach: impl Fn(f64) -> f64) -> bool {
        self.card_bvh.is_any_near(ray, t1, reach)
    }

    /// The box around all cards.
    pub fn cards_bounds(&self) -> Aabb {
        self.card_bvh.bounds()
    }

    /// For a camera ray, the nearest contact that lets nothing through of all that is no card, and in `blended` what lets light
    /// through before it, as [`Mesh::nearest`] has them.
    pub fn nearest_but_cards(
        &self,
        model: &Model,
        ray: &Ray,
        width_at: impl Fn(f64) -> f64,
        blended: &mut Vec<Contact>,
    ) -> Option<Contact> {
        if self.is_all_cards() {
            return None;
        }
        self.nearest_of(ray, f64::INFINITY, blended, |i, shear, t1| {
            if self.is_card(i) {
                return None;
            }
            self.contact(model, shear, ray, i, &RayQuery::until(t1).of_camera(), &width_at)
        })
    }

    /// The share that comes through all that is no card.
    pub fn transmittance_but_cards(&self, model: &Model, ray: &Ray, t1: f64, skip: Option<u32>) -> f32 {
        let each = |i: u32, shear: &Shear, t1: f64| {
            if self.is_card(i) {
                return None;
            }
            self.contact(model, shear, ray, i, &RayQuery::from_surface(t1, skip), &|_| 0.0)
        };
        through(&self.blocks, ray, t1, each).0
    }
}
