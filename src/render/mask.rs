//! Mean alpha of a textured triangle over the footprint of a cone, after the cutoff of an alpha mask.
//!
//! Based on: F. Crow, *Summed-Area Tables for Texture Mapping*, SIGGRAPH 1984.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use crate::scene::alpha::AlphaSums;
use crate::scene::{Alpha, Material, Texture};

/// Place and footprint of a cone in the texture of a triangle.
pub struct Lookup<'a> {
    pub texture: &'a Texture,
    pub uv: [f32; 2],
    /// Texture coordinates of the triangle's corners.
    pub corners: [[f32; 2]; 3],
    /// Texels that the cone's width covers along u and along v.
    pub widths: [f32; 2],
    /// Alpha of the triangle's own corners, and where it is met.
    pub corner_alphas: [f32; 3],
    pub own_alpha: f32,
}

impl Lookup<'_> {
    /// Edge, in texels, of the square that has the footprint's area.
    pub fn footprint(&self) -> f32 {
        (self.widths[0] * self.widths[1]).sqrt()
    }

    /// Least and largest texture coordinates of the triangle.
    fn range(&self) -> [[f64; 2]; 2] {
        let of = |pick: fn(f32, f32) -> f32| {
            [0, 1].map(|k| f64::from(self.corners.iter().map(|uv| uv[k]).fold(self.uv[k], pick)))
        };
        [of(f32::min), of(f32::max)]
    }

    /// Change of the triangle's own alpha by u and by v; 0 where its texture coordinates have no area.
    fn alpha_slope(&self) -> [f32; 2] {
        let [a, b, c] = self.corners;
        let [e, f] = [[b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]];
        let [p, q, r] = self.corner_alphas;
        let det = e[0] * f[1] - e[1] * f[0];
        let slope = [((q - p) * f[1] - (r - p) * e[1]) / det, ((r - p) * e[0] - (q - p) * f[0]) / det];
        if slope.iter().all(|v| v.is_finite()) { slope } else { [0.0; 2] }
    }
}

/// Summed-area tables of a model's materials with alpha masks, each computed when it is first needed.
#[derive(Default)]
pub struct Masks {
    /// For each material, its index into `tables`; materials with the same texture, factor and cutoff share a table.
    slots: Vec<usize>,
    tables: Vec<OnceLock<Option<AlphaSums>>>,
}

impl Masks {
    pub fn new(materials: &[Material]) -> Masks {
        let mut known = HashMap::new();
        let slots = materials.iter().map(|material| {
            let texture = material.texture.as_ref().map(|t| Arc::as_ptr(&t.texture));
            let alpha = match material.alpha {
                Alpha::Opaque => (0, 0),
                Alpha::Mask(cutoff) => (1, cutoff.to_bits()),
                Alpha::Blend => (2, 0),
            };
            let next = known.len();
            *known.entry((texture, alpha, material.base_color[3].to_bits())).or_insert(next)
        });
        let slots = slots.collect();
        Masks { slots, tables: (0..known.len()).map(|_| OnceLock::new()).collect() }
    }

    /// The share of the footprint in which the alpha of `material`, which is the model's material `index`, passes its cutoff.
    pub fn share(&self, material: &Material, index: usize, at: &Lookup<'_>) -> f32 {
        let point = |uv, own: f32| material.alpha.share(material.base_color[3] * own * at.texture.alpha(uv));
        if !at.widths.iter().any(|w| *w > 1.0) {
            return point(at.uv, at.own_alpha);
        }
        let plain = at.corner_alphas == [1.0; 3];
        let slot = self.slots.get(index).and_then(|&slot| self.tables.get(slot)).filter(|_| plain);
        match slot.and_then(|table| table.get_or_init(|| AlphaSums::of(material)).as_ref()) {
            Some(table) => table.mean_within(at.uv.map(f64::from), at.widths.map(f64::from), at.range()),
            None => sampled(at, point),
        }
    }
}

/// The mean over the footprint of `point`, a function of the texture coordinates and the triangle's vertex alpha, by at most 8 × 8
/// lookups. For materials without a table, and where vertex alpha changes what passes the cutoff.
fn sampled(at: &Lookup<'_>, point: impl Fn([f32; 2], f32) -> f32) -> f32 {
    const MAX: f32 = 8.0;
    let n = at.widths.map(|w| w.ceil().clamp(1.0, MAX) as u32);
    let size = [at.texture.width as f32, at.texture.height as f32];
    let [lo, hi] = at.range().map(|end| end.map(|v| v as f32));
    let slope = at.alpha_slope();
    let place = |k: usize, i: u32| {
        let offset = ((i as f32 + 0.5) / n[k] as f32 - 0.5) * at.widths[k] / size[k].max(1.0);
        let uv = at.uv[k] + offset;
        // Coordinates beyond the triangle's range are mirrored back into it, as lookups in a table do.
        let folded = if uv < lo[k] { 2.0 * lo[k] - uv } else { uv.min(2.0 * hi[k] - uv) };
        folded.clamp(lo[k], hi[k])
    };
    let value = |i: u32| {
        let uv = [place(0, i % n[0]), place(1, i / n[0])];
        let own = at.own_alpha + slope[0] * (uv[0] - at.uv[0]) + slope[1] * (uv[1] - at.uv[1]);
        point(uv, own.clamp(0.0, 1.0))
    };
    let count = n[0] * n[1];
    (0..count).map(value).sum::<f32>() / count as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    use crate::geom::{DAffine3, DMat3, DVec3};
    use crate::progress::Quiet;
    use crate::render::reference::reference_with;
    use crate::render::{Film, Options, render_with};
    use crate::scene::shell::Environment;
    use crate::scene::{Camera, Instance, Light, LightKind, Model, Part, Projection, Scene, TextureRef};

    /// A leaf with holes of a few texels and a soft rim.
    fn leaf() -> Texture {
        let texels = (0..64 * 64u32).map(|i| {
            let [x, y] = [i % 64, i / 64].map(|k| (f64::from(k) - 31.5) / 32.0);
            let rim = 1.0 - (x * x + 2.0 * y * y + 0.3 * (9.0 * x).sin() * (7.0 * y).cos()) / 0.6;
            [255, 255, 255, (255.0 * (0.5 + 2.0 * rim)).clamp(0.0, 255.0) as u8]
        });
        Texture::new("leaf", 64, 64, texels.collect())
    }

    /// In what cards differ.
    #[derive(Clone, Copy)]
    struct Card {
        alpha: Alpha,
        /// Texture coordinates of its lower left and upper right corner.
        uvs: [[f32; 2]; 2],
        /// Alpha of its right corners; 1 at the left ones.
        right: f32,
    }

    const SQUARE: Card = Card { alpha: Alpha::Mask(0.5), uvs: [[0.0, 0.0], [1.0, 1.0]], right: 1.0 };

    /// Quarters of a pixel by which a camera is moved aside, from 0 on, in both directions. What one ray a pixel finds of a card
    /// depends on where the card's edges are within pixels; in the mean over these positions it must be right.
    const QUARTERS: u32 = 4;

    /// A card of 1 m that stands in the plane z = 0, white and shining by itself, before what `more` adds; its camera sees
    /// `high` metres and stands `aside` metres to the right and above.
    fn scene(card: Card, high: f64, aside: [f64; 2], more: impl FnOnce(&mut Model)) -> Scene {
        let [lo, hi] = card.uvs;
        let part = Part {
            positions: vec![[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]],
            uvs: vec![vec![[lo[0], hi[1]], [hi[0], hi[1]], [hi[0], lo[1]], [lo[0], lo[1]]]],
            colors: (card.right != 1.0)
                .then(|| [1.0, card.right, card.right, 1.0].map(|a| [1.0, 1.0, 1.0, a]).to_vec()),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Part::default()
        };
        let transform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let texture = Some(TextureRef { texture: Arc::new(leaf()), tex_coord: 0, transform });
        let material = Material { texture, alpha: card.alpha, unlit: true, ..Material::default() };
        let to_world = DAffine3::from_translation(DVec3::new(aside[0], aside[1], 5.0));
        let projection = Projection::Orthographic { ymag: 0.5 * high };
        let camera = Camera { name: String::new(), to_world, projection, aspect: None };
        let sun = DAffine3::from_quat(DQuat::from_rotation_arc(DVec3::Z, DVec3::new(1.0, 0.0, 1.0).normalize()));
        let kind = LightKind::Directional;
        let sun = Light { name: String::new(), to_world: sun, intensity: [0.0; 3], kind, range: f64::INFINITY };
        let mut model = Model {
            parts: vec![part],
            materials: vec![material],
            instances: vec![Instance { part: 0, transform: DAffine3::IDENTITY, node: String::new() }],
            cameras: vec![camera],
            lights: vec![sun],
            ..Model::default()
        };
        more(&mut model);
        Scene {
            model,
            texels: vec![],
            copies: vec![],
            environment: Environment { sky: Some([0.0; 3].into()), background: Some([0.0; 3]), ..Default::default() },
        }
    }

    fn mean(film: &Film) -> f64 {
        film.pixels.iter().map(|p| f64::from(p[0])).sum::<f64>() / film.pixels.len() as f64
    }

    /// Mean radiance in pictures of `side`² pixels of the scene that `of` makes for a camera moved aside, in the mean over all
    /// positions within a pixel; and in the limit of many point samples, of which there are 2^`log2`.
    fn means(side: u32, high: f64, log2: u32, of: impl Fn([f64; 2]) -> Scene) -> (f64, f64) {
        let options = Options { size: [side; 2], ..Options::measuring() };
        let step = high / f64::from(side * QUARTERS);
        let all = QUARTERS * QUARTERS;
        let found = (0..all).map(|i| {
            let scene = of([i % QUARTERS, i / QUARTERS].map(|k| step * f64::from(k)));
            mean(&render_with(&scene, vec![], &options, &Quiet).unwrap().film)
        });
        let samples = (1 << log2) / (side * side);
        let truth = reference_with(&of([0.0; 2]), vec![], &[], &options, 0..samples, &Quiet).unwrap().film;
        (found.sum::<f64>() / f64::from(all), mean(&truth))
    }

    #[test]
    fn a_card_covers_the_same_at_any_distance() {
        let cards = [
            ("plain", SQUARE),
            ("low cutoff", Card { alpha: Alpha::Mask(0.1), ..SQUARE }),
            ("high cutoff", Card { alpha: Alpha::Mask(0.95), ..SQUARE }),
            ("blended", Card { alpha: Alpha::Blend, ..SQUARE }),
            // Beside it in the atlas is more.
            ("atlas", Card { uvs: [[0.25, 0.125], [0.75, 0.5]], ..SQUARE }),
            ("repeated", Card { uvs: [[0.0, 0.0], [3.0, 2.0]], ..SQUARE }),
            ("alpha of vertices", Card { right: 0.4, ..SQUARE }),
        ];
        for (name, card) in cards {
            // Cards of 64, 16, 8 and 4 pixels, a whole number so that positions within a pixel are evenly spread.
            for (side, high) in [(80, 1.25), (20, 1.25), (16, 2.0), (16, 4.0)] {
                let (found, truth) = means(side, high, 18, |aside| scene(card, high, aside, |_| ()));
                // The truth has 16384 samples on the smallest card, of which a quarter or more pass: 1.4 % is the standard
                // deviation of as many random ones.
                assert!((found / truth - 1.0).abs() < 0.03, "{name}, {high} m, {side} pixels: {found} {truth}");
            }
        }
    }

    /// A ray along the edge that two triangles share meets one of them.
    #[test]
    fn an_edge_within_a_card_covers_once() {
        // Four pixels lie on the diagonal, through their middles, of the card and of its mirror image.
        let half = |model: &mut Model| {
            let texture = Texture::new("half", 1, 1, vec![[255, 255, 255, 128]]);
            let transform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
            model.materials[0].texture = Some(TextureRef { texture: Arc::new(texture), tex_coord: 0, transform });
        };
        for turned in [false, true] {
            let scene = scene(Card { alpha: Alpha::Blend, ..SQUARE }, 2.0, [0.0; 2], |model| {
                half(model);
                if turned {
                    model.parts[0].triangles = vec![[1, 3, 0], [1, 2, 3]];
                }
            });
            let options = Options { size: [8; 2], ..Options::measuring() };
            let film = render_with(&scene, vec![], &options, &Quiet).unwrap().film;
            let covered: Vec<f32> = film.pixels.iter().map(|p| p[3]).filter(|a| *a > 0.0).collect();
            assert_eq!(covered.len(), 16);
            assert!(covered.iter().all(|a| (a - 128.0 / 255.0).abs() < 1e-4), "{covered:?}");
        }
    }

    /// A black card in the sun above a white ground, seen from above: what it hides and its shadow, beside it.
    #[test]
    fn a_cards_shadow_is_as_large_at_any_distance() {
        for (name, alpha) in [("mask", Alpha::Mask(0.3)), ("blend", Alpha::Blend)] {
            for (side, high) in [(64, 4.0), (16, 4.0), (16, 8.0)] {
                let ground = |model: &mut Model| {
                    model.materials[0].base_color = [0.0, 0.0, 0.0, 1.0];
                    model.materials.push(Material::default());
                    let corners = [[-1.0f32, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
                    let positions = corners.map(|[x, y]| [0.6 * high as f32 * x, 0.6 * high as f32 * y, 0.0]).to_vec();
                    let triangles = vec![[0, 1, 2], [0, 2, 3]];
                    model.parts.push(Part { positions, triangles, material: 1, ..Part::default() });
                    let transform = DAffine3 { matrix3: DMat3::IDENTITY, translation: DVec3::new(0.0, 0.0, -1.25) };
                    model.instances.push(Instance { part: 1, transform, node: String::new() });
                    model.lights[0].intensity = [std::f64::consts::PI * 2.0f64.sqrt(); 3];
                };
                // The open ground has radiance 1.
                let card = Card { alpha, ..SQUARE };
                let (found, truth) = means(side, high, 19, |aside| scene(card, high, aside, ground));
                let (found, truth) = (1.0 - found, 1.0 - truth);
                // The smallest card and its shadow have some 6000 of the truth's samples, 1.3 % as standard deviation, and of the
                // picture's own 16 positions one in ten meets the card's border: another 1 %. Three deviations of both.
                assert!((found / truth - 1.0).abs() < 0.05, "{name}, {high} m, {side} pixels: {found} {truth}");
            }
        }
    }
}
