//! Phong parameters of matter besides its diffuse colour: how much of the ambient light it reflects, and its highlights.
//!
//! Based on: B. T. Phong, *Illumination for Computer Generated Pictures*, CACM 1975, in the form of J. Blinn, *Models of Light
//! Reflection for Computer Synthesized Pictures*, SIGGRAPH 1977: a highlight depends on the angle between the normal and the
//! direction halfway between the light and the viewer, and so can be integrated over a distribution of normals.

use crate::geom::Vec3;

/// Largest shininess.
pub const MAX_SHININESS: f64 = 10_000.0;
/// Shininess of highlights for which none is given.
pub const DEFAULT_SHININESS: f64 = 16.0;

/// Phong parameters that a landscape gives to a material, a layer or a variant. A parameter that is `None` is taken from the
/// enclosing object: see [`Finish::within`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Finish {
    /// Factors of the ambient light that is reflected, linear, each in [0, 1].
    pub ambient: [f64; 3],
    /// Strength of highlights, linear, each in [0, 1]; 0 if no object gives it.
    pub specular: Option<[f64; 3]>,
    /// Exponent of highlights, 0 to [`MAX_SHININESS`]; [`DEFAULT_SHININESS`] if no object gives it.
    pub shininess: Option<f64>,
}

impl Finish {
    /// Full ambient light and no highlights.
    pub const PLAIN: Finish = Finish { ambient: [1.0; 3], specular: None, shininess: None };

    /// Parameters inside of an enclosing object: those given here, and those of `outer` for the rest. Ambient factors multiply.
    pub fn within(&self, outer: &Finish) -> Finish {
        Finish {
            ambient: [0, 1, 2].map(|k| self.ambient[k] * outer.ambient[k]),
            specular: self.specular.or(outer.specular),
            shininess: self.shininess.or(outer.shininess),
        }
    }

    /// Whether it gives any parameter of highlights, even one that switches them off.
    pub fn has_gloss(&self) -> bool {
        self.specular.is_some() || self.shininess.is_some()
    }

    /// Highlights, with defaults for what is not given.
    pub fn gloss(&self) -> Gloss {
        let specular = self.specular.unwrap_or_default().map(|v| v as f32);
        Gloss { specular: Vec3::from_array(specular), shininess: self.shininess.unwrap_or(DEFAULT_SHININESS) as f32 }
    }
}

/// Highlights of a facet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gloss {
    /// Strength, linear.
    pub specular: Vec3,
    /// Exponent, ≥ 0.
    pub shininess: f32,
}

impl Gloss {
    /// No highlights.
    pub const NONE: Gloss = Gloss { specular: Vec3::ZERO, shininess: DEFAULT_SHININESS as f32 };

    /// Whether there are none.
    pub fn is_none(&self) -> bool {
        self.specular == Vec3::ZERO
    }

    /// What a facet of the unit normal `normal` reflects towards `view` in its highlight, in units of `specular` and of the
    /// irradiance over π of a surface that faces the light; all directions are unit, away from the facet.
    pub fn facet(&self, normal: Vec3, view: Vec3, light: Vec3) -> f32 {
        let (cosine, halfway) = (normal.dot(light), normal.dot((view + light).normalize_or_zero()));
        if cosine <= 0.0 || halfway <= 0.0 { 0.0 } else { self.peak() * halfway.powf(self.shininess) * cosine }
    }

    /// Height of the lobe, so that a facet that faces light and viewer reflects about the share `specular` of the light,
    /// whatever the shininess (T. Akenine-Möller, E. Haines, N. Hoffman, *Real-Time Rendering*, 2008, section 7.6).
    pub fn peak(&self) -> f32 {
        (self.shininess + 8.0) / 8.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::PI;

    #[test]
    fn who_says_something_is_heard_first() {
        let layer = Finish { ambient: [0.5, 1.0, 0.0], specular: Some([0.1; 3]), shininess: Some(40.0) };
        let variant = Finish { ambient: [0.5; 3], specular: None, shininess: Some(9.0) };
        let found = variant.within(&layer);
        assert_eq!(found, Finish { ambient: [0.25, 0.5, 0.0], specular: Some([0.1; 3]), shininess: Some(9.0) });
        assert_eq!(layer.within(&Finish::PLAIN), layer);
        assert!(Finish::PLAIN.gloss().is_none() && !Finish::PLAIN.has_gloss());
    }

    /// Those of `format-spec/landscape-1-materials.md`, §7.
    #[test]
    fn the_values_of_the_specification() {
        let gloss = Gloss { specular: Vec3::ONE, shininess: 16.0 };
        let (slanted, mirrored) = (Vec3::new(0.6, 0.0, 0.8), Vec3::new(-0.6, 0.0, 0.8));
        for (view, light, want) in [
            (Vec3::Z, Vec3::Z, 3.0),
            (slanted, mirrored, 2.4),
            (Vec3::Z, slanted, 1.033_121_3),
            (Vec3::Z, -slanted, 0.0),
        ] {
            // A power of 16 of numbers rounded to 24 bits.
            assert!((gloss.facet(Vec3::Z, view, light) - want).abs() < 1e-5, "{view} {light}");
        }
    }

    /// The mean over the light's directions, by cosines, of what comes back to a viewer who faces the facet: the integral of
    /// peak/π · cosᵏ(θ/2) · cos θ over the hemisphere.
    #[test]
    fn a_facet_reflects_the_same_share_whatever_its_shininess() {
        for shininess in [8.0f32, 32.0, 200.0, 1000.0] {
            let gloss = Gloss { specular: Vec3::ONE, shininess };
            let n = 20_000;
            let ring = |i: usize| {
                let theta = 0.5 * PI * (i as f32 + 0.5) / n as f32;
                let light = Vec3::new(theta.sin(), 0.0, theta.cos());
                gloss.facet(Vec3::Z, Vec3::Z, light) / PI * 2.0 * PI * theta.sin() * (0.5 * PI / n as f32)
            };
            let share: f32 = (0..n).map(ring).sum();
            // The factor is a fit: 7.5 % too much at s = 8, 0.2 % at s = 1000.
            assert!((share - 1.0).abs() < 0.08, "{shininess}: {share}");
        }
    }
}
