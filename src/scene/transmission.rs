//! Thin surfaces that let light through diffusely, as leaves and paper do.
//!
//! Based on: the glTF extension `KHR_materials_diffuse_transmission`. Of the light that would be reflected diffusely the share
//! `factor` comes out on the other side, in a colour of its own.

use super::texture::TextureRef;

/// Diffuse transmission of a material.
#[derive(Debug, Clone, Default)]
pub struct Transmission {
    /// Share of the diffuse light that comes through, in [0, 1].
    pub factor: f32,
    /// Its alpha multiplies the factor.
    pub factor_texture: Option<TextureRef>,
    /// Linear Rec. 709, each in [0, 1].
    pub color: [f32; 3],
    /// Its colour multiplies the colour.
    pub color_texture: Option<TextureRef>,
    /// Whether the base colour, with vertex colours, multiplies the colour, so that transmitted light has the colour of reflected light.
    pub of_base: bool,
}

impl Transmission {
    /// Linear albedo of reflection and of transmission where the base colour is `base`; `sample` gives a texture's linear RGBA.
    pub fn split(&self, base: [f32; 3], sample: &dyn Fn(&TextureRef) -> [f32; 4]) -> ([f32; 3], [f32; 3]) {
        let share = self.factor * self.factor_texture.as_ref().map_or(1.0, |t| sample(t)[3]);
        let texture = self.color_texture.as_ref().map_or([1.0; 4], sample);
        let own = if self.of_base { base } else { [1.0; 3] };
        (base.map(|c| (1.0 - share) * c), [0, 1, 2].map(|k| share * self.color[k] * texture[k] * own[k]))
    }
}
