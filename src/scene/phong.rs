//! Phong parameters by which a layer of a shell, a variant or a set of copies modifies the material of its texels. Each is a constant times an
//! image over the ground times noise. Normative: `format-spec/landscape-1-materials.md`.

use std::sync::Arc;

use super::texture::TextureRef;
use crate::geom::{DVec3, Vec3};
use crate::noise::Noise;
use crate::volume::Finish;

/// Phong's parameters of a whole layer.
#[derive(Debug, Clone, PartialEq)]
pub struct Phong {
    /// Multiplies the texel's albedo, linear, ≥ 0.
    pub diffuse: [f64; 3],
    /// Light from around, and highlights.
    pub finish: Finish,
    /// Factors of these parameters that vary from place to place.
    pub variations: Vec<Arc<Variation>>,
}

impl Default for Phong {
    /// No change.
    fn default() -> Phong {
        Phong::tint([1.0; 3])
    }
}

impl Phong {
    /// A factor of all colours.
    pub fn tint(diffuse: [f64; 3]) -> Phong {
        Phong { diffuse, finish: Finish::PLAIN, variations: Vec::new() }
    }

    /// The combination with the parameters of an enclosing object: factors and variations of both multiply, and own highlights take precedence.
    pub fn within(&self, outer: &Phong) -> Phong {
        Phong {
            diffuse: [0, 1, 2].map(|k| self.diffuse[k] * outer.diffuse[k]),
            finish: self.finish.within(&outer.finish),
            variations: outer.variations.iter().chain(&self.variations).cloned().collect(),
        }
    }
}

/// Factors that vary from place to place.
#[derive(Debug, Clone, Default)]
pub struct Variation {
    /// Image of the factor of the light from around.
    pub ambient: Option<TextureRef>,
    /// Image of the factor of the albedo.
    pub diffuse: Option<TextureRef>,
    /// Image of the factor of highlights; its alpha multiplies the shininess.
    pub specular: Option<TextureRef>,
    /// Factors by noise.
    pub noise: Option<PhongNoise>,
}

/// Equality is identity, since images are not compared.
impl PartialEq for Variation {
    fn eq(&self, other: &Variation) -> bool {
        std::ptr::eq(self, other)
    }
}

/// The space that noise lies in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum NoiseSpace {
    /// Texel coordinates of the layer, before jitter; of a rigid copy those of its texel.
    #[default]
    Texel,
    /// The world, metres.
    World,
}

/// Factors by noise: from the first to the second as it goes from −1 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhongNoise {
    /// The noise.
    pub noise: Noise,
    /// Where it is evaluated.
    pub space: NoiseSpace,
    /// Factors of the light from around.
    pub ambient: [[f64; 3]; 2],
    /// Factors of the albedo.
    pub diffuse: [[f64; 3]; 2],
    /// Factors of highlights.
    pub specular: [[f64; 3]; 2],
    /// Factors of the shininess.
    pub shininess: [f64; 2],
}

/// A point of a surface with its footprint, in the three spaces in which [`Variation`]s are evaluated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShadingPoint {
    /// Texel coordinates (u, v) of the mesh below it, with the width of the cone's footprint there.
    pub ground: [f64; 2],
    /// See `ground`.
    pub ground_width: f64,
    /// Texel coordinates of the layer, with the width of the footprint there.
    pub texel: DVec3,
    /// See `texel`.
    pub texel_width: f64,
    /// World position, metres, with the width of the footprint there.
    pub world: DVec3,
    /// See `world`.
    pub world_width: f64,
}

/// Factors at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Factors {
    /// Of the light from around.
    pub ambient: Vec3,
    /// Of the albedo.
    pub diffuse: Vec3,
    /// Of highlights.
    pub specular: Vec3,
    /// Of the shininess.
    pub shininess: f32,
}

impl Factors {
    /// No change.
    pub const ONE: Factors = Factors { ambient: Vec3::ONE, diffuse: Vec3::ONE, specular: Vec3::ONE, shininess: 1.0 };
}

impl Variation {
    /// Multiply `factors` by those of a place.
    pub fn apply(&self, place: &ShadingPoint, factors: &mut Factors) {
        let average = |image: &TextureRef| {
            let [[a, b, _], [c, d, _]] = image.transform;
            let texels = f64::from(image.texture.width) * f64::from(image.texture.height);
            let footprint = place.ground_width * (f64::from((a * d - b * c).abs()) * texels).sqrt();
            let [r, g, b, alpha] = image.texture.average(image.map(place.ground.map(|v| v as f32)), footprint as f32);
            (Vec3::new(r, g, b), alpha)
        };
        if let Some(image) = &self.ambient {
            factors.ambient *= average(image).0;
        }
        if let Some(image) = &self.diffuse {
            factors.diffuse *= average(image).0;
        }
        if let Some(image) = &self.specular {
            let (colour, alpha) = average(image);
            factors.specular *= colour;
            factors.shininess *= alpha;
        }
        if let Some(noise) = &self.noise {
            noise.apply(place, factors);
        }
    }
}

impl PhongNoise {
    fn apply(&self, place: &ShadingPoint, factors: &mut Factors) {
        let (at, width) = match self.space {
            NoiseSpace::Texel => (place.texel, place.texel_width),
            NoiseSpace::World => (place.world, place.world_width),
        };
        // Noise finer than the footprint is replaced by its mean, 0. It fades out between footprints of a half and of one lattice cell.
        let seen = (2.0 - 2.0 * width * self.noise.frequency.max_element()).clamp(0.0, 1.0);
        let value = if seen > 0.0 { seen * self.noise.value(at) } else { 0.0 };
        let share = (0.5 + 0.5 * value).clamp(0.0, 1.0);
        let mix = |[from, to]: [f64; 2]| (from + share * (to - from)) as f32;
        let colour = |[from, to]: [[f64; 3]; 2]| Vec3::from_array(std::array::from_fn(|k| mix([from[k], to[k]])));
        factors.ambient *= colour(self.ambient);
        factors.diffuse *= colour(self.diffuse);
        factors.specular *= colour(self.specular);
        factors.shininess *= mix(self.shininess);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Texture;

    fn place(u: f64, v: f64, width: f64) -> ShadingPoint {
        let texel = DVec3::new(0.3, 0.6, 0.2);
        let world = DVec3::new(2.5, 1.25, 0.75);
        ShadingPoint { ground: [u, v], ground_width: width, texel, texel_width: width, world, world_width: width }
    }

    fn factors(variation: &Variation, place: &ShadingPoint) -> Factors {
        let mut factors = Factors::ONE;
        variation.apply(place, &mut factors);
        factors
    }

    #[test]
    fn images_lie_on_the_ground() {
        let mut texture = Texture::new("t", 2, 1, vec![[255, 0, 0, 255], [0, 0, 255, 51]]);
        texture.nearest = true;
        // Twice as wide: u from 0 to 2 shows it once.
        let image =
            TextureRef { texture: Arc::new(texture), tex_coord: 0, transform: [[0.5, 0.0, 0.0], [0.0, 1.0, 0.0]] };
        let variation = Variation { diffuse: Some(image.clone()), specular: Some(image), ..Variation::default() };
        let left = factors(&variation, &place(0.5, 0.5, 0.0));
        assert_eq!((left.diffuse, left.specular, left.shininess), (Vec3::X, Vec3::X, 1.0));
        let right = factors(&variation, &place(1.5, 0.5, 0.0));
        assert_eq!((right.specular, right.shininess, right.ambient), (Vec3::Z, 0.2, Vec3::ONE));
        // From afar its mean: colours weighted by alpha, 1 to 0.2; to the rounding of 16 bits.
        let far = factors(&variation, &place(0.5, 0.5, 100.0));
        assert!((far.diffuse - Vec3::new(1.0, 0.0, 0.2) / 1.2).abs().max_element() < 1e-4, "{far:?}");
    }

    #[test]
    fn noise_goes_from_the_first_to_the_second_and_fades_with_distance() {
        let noise = Noise {
            seed: 3,
            frequency: DVec3::splat(1.0),
            origin: DVec3::ZERO,
            period: [0; 3],
            octaves: 2,
            turbulence: false,
        };
        let of = |space| PhongNoise {
            noise,
            space,
            ambient: [[1.0; 3]; 2],
            diffuse: [[0.0, 1.0, 0.5], [2.0, 1.0, 0.5]],
            specular: [[1.0; 3]; 2],
            shininess: [0.5, 1.5],
        };
        let near = place(0.0, 0.0, 0.0);
        for (space, at) in [(NoiseSpace::Texel, near.texel), (NoiseSpace::World, near.world)] {
            let variation = Variation { noise: Some(of(space)), ..Variation::default() };
            let found = factors(&variation, &near);
            let value = noise.value(at) as f32;
            assert!(value != 0.0 && (found.diffuse - Vec3::new(1.0 + value, 1.0, 0.5)).length() < 1e-6, "{found:?}");
            assert!((found.shininess - (1.0 + 0.5 * value)).abs() < 1e-6 && found.ambient == Vec3::ONE);
            assert_eq!(factors(&variation, &place(0.0, 0.0, 1.0)).diffuse, Vec3::new(1.0, 1.0, 0.5));
        }
    }

    #[test]
    fn variants_stand_within_their_layer() {
        let layer = Phong {
            diffuse: [0.5, 1.0, 2.0],
            finish: Finish { specular: Some([0.2; 3]), ..Finish::PLAIN },
            variations: vec![Arc::default()],
        };
        let variant = Phong { variations: vec![Arc::default()], ..Phong::tint([0.5; 3]) };
        let found = variant.within(&layer);
        assert_eq!((found.diffuse, found.finish.specular), ([0.25, 0.5, 1.0], Some([0.2; 3])));
        assert!(Arc::ptr_eq(&found.variations[0], &layer.variations[0]) && found.variations.len() == 2);
        assert!(found != variant.within(&Phong { variations: vec![Arc::default()], ..layer }));
    }
}
