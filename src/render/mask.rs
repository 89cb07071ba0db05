//! How much of a cone's footprint on a textured triangle alpha lets be there.
//!
//! Based on: F. Crow, *Summed-Area Tables for Texture Mapping*, SIGGRAPH 1984.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use crate::scene::alpha::AlphaSums;
use crate::scene::{Alpha, Material, Texture};

/// Where a cone meets the texture of a triangle.
pub struct Lookup<'a> {
    pub texture: &'a Texture,
    pub uv: [f32; 2],
    /// Texture coordinates of the triangle's corners.
    pub corners: [[f32; 2]; 3],
    /// Texels that the cone's width covers.
    pub footprint: f32,
}

impl Lookup<'_> {
    /// Least and largest texture coordinates of the triangle.
    fn range(&self) -> [[f64; 2]; 2] {
        let of = |pick: fn(f32, f32) -> f32| {
            [0, 1].map(|k| f64::from(self.corners.iter().map(|uv| uv[k]).fold(self.uv[k], pick)))
        };
        [of(f32::min), of(f32::max)]
    }
}

/// Tables of the materials that a cutoff cuts, each made when it is first asked for.
#[derive(Default)]
pub struct Masks {
    /// For each material, its index into `tables`; materials that cut the same texture alike share one.
    slots: Vec<usize>,
    tables: Vec<OnceLock<Option<AlphaSums>>>,
}

impl Masks {
    pub fn new(materials: &[Material]) -> Masks {
        let mut known = HashMap::new();
        let slots = materials.iter().map(|material| {
            let texture = material.texture.as_ref().map(|t| Arc::as_ptr(&t.texture));
            let cutoff = if let Alpha::Mask(cutoff) = material.alpha { Some(cutoff.to_bits()) } else { None };
            let next = known.len();
            *known.entry((texture, cutoff, material.base_color[3].to_bits())).or_insert(next)
        });
        let slots = slots.collect();
        Masks { slots, tables: (0..known.len()).map(|_| OnceLock::new()).collect() }
    }

    /// The share of the footprint where the alpha of `material`, the model's material `index`, passes its cutoff. `vertex`
    /// is the triangle's own alpha at the contact and whether it is 1 all over.
    pub fn share(&self, material: &Material, index: usize, at: &Lookup<'_>, vertex: (f32, bool)) -> f32 {
        let (vertex, plain) = vertex;
        let point = |uv| material.alpha.share(material.base_color[3] * vertex * at.texture.alpha(uv));
        if at.footprint.is_nan() || at.footprint <= 1.0 {
            return point(at.uv);
        }
        let slot = self.slots.get(index).and_then(|&slot| self.tables.get(slot)).filter(|_| plain);
        match slot.and_then(|table| table.get_or_init(|| AlphaSums::of(material)).as_ref()) {
            Some(table) => table.mean_within(at.uv.map(f64::from), f64::from(at.footprint), at.range()),
            None => sampled(at, point),
        }
    }
}

/// The mean of `point` over the footprint, by at most 8 × 8 lookups; for what no table tells, as where the triangle's own
/// alpha changes what passes.
fn sampled(at: &Lookup<'_>, point: impl Fn([f32; 2]) -> f32) -> f32 {
    const MOST: f32 = 8.0;
    let n = at.footprint.ceil().min(MOST) as u32;
    let size = [at.texture.width as f32, at.texture.height as f32];
    let [lo, hi] = at.range().map(|end| end.map(|v| v as f32));
    let place = |k: usize, i: u32| {
        let offset = ((i as f32 + 0.5) / n as f32 - 0.5) * at.footprint / size[k].max(1.0);
        let uv = at.uv[k] + offset;
        // What lies beyond the triangle's range is folded back, as in a table.
        let folded = if uv < lo[k] { 2.0 * lo[k] - uv } else { uv.min(2.0 * hi[k] - uv) };
        folded.clamp(lo[k], hi[k])
    };
    let sum: f32 = (0..n * n).map(|i| point([place(0, i % n), place(1, i / n)])).sum();
    sum / (n * n) as f32
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

    /// A card of 1 m that stands in the plane z = 0, white and shining by itself, before what `more` adds; its camera sees
    /// `high` metres.
    fn scene(card: Card, high: f64, more: impl FnOnce(&mut Model)) -> Scene {
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
        let to_world = DAffine3::from_translation(DVec3::new(0.013, 0.017, 5.0));
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

    /// The scene's mean radiance in a picture of `side`² pixels, and in the limit of many point samples.
    fn means(scene: &Scene, side: u32) -> (f64, f64) {
        let samples = (1 << 18) / (side * side);
        let options = Options { size: [side; 2], ..Options::default() };
        let picture = render_with(scene, vec![], &options, &Quiet).unwrap().film;
        let truth = reference_with(scene, vec![], &[], &options, 0..samples, &Quiet).unwrap().film;
        (mean(&picture), mean(&truth))
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
            // Cards of 64, 16, 8 and 4 pixels, a whole number so that their edges fall on those of pixels.
            for (side, high) in [(64, 1.0), (16, 1.0), (16, 2.0), (16, 4.0)] {
                let (found, truth) = means(&scene(card, high, |_| ()), side);
                // The truth has 16384 samples on the smallest card, which tell a share of a half to .8 %; the camera stands
                // a little aside, so that rows of texels at a card's edge are counted twice or not at all. At a high cutoff a
                // quarter is left, of which the rows at the edge are 2 %; in an atlas the truth also reads half a texel of the
                // neighbours of 32 × 24 texels, up to 7 % of them, half of which are there.
                // Alpha of vertices is looked up at 8 × 8 points of a pixel, so what it cuts off a card of 4 × 4 is a stair.
                let most = if matches!(name, "atlas" | "alpha of vertices") { 0.05 } else { 0.03 };
                assert!((found / truth - 1.0).abs() < most, "{name}, {high} m, {side} pixels: {found} {truth}");
            }
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
                let (found, truth) = means(&scene(Card { alpha, ..SQUARE }, high, ground), side);
                let (found, truth) = (1.0 - found, 1.0 - truth);
                // A shadow of two pixels lies across those beside it, and a pixel has one shadow ray: of its eight edges each is
                // off by up to a sixteenth of a pixel in the mean.
                let most = if high > 4.0 { 0.12 } else { 0.03 };
                assert!((found / truth - 1.0).abs() < most, "{name}, {high} m, {side} pixels: {found} {truth}");
            }
        }
    }
}
