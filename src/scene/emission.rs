//! Light that surfaces give off by themselves: lamps, windows, screens.
//!
//! Based on: glTF 2.0, `emissiveFactor` and `emissiveTexture`, and the extension `KHR_materials_emissive_strength`.

use super::texture::TextureRef;

/// Light that a surface gives off, the same in all directions.
#[derive(Debug, Clone)]
pub struct Emission {
    /// Radiance, linear Rec. 709, in units of the picture's white; at least 0 and finite.
    pub color: [f32; 3],
    /// Its colour multiplies the radiance.
    pub texture: Option<TextureRef>,
}
