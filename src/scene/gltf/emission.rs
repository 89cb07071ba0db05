//! Emission of materials: the emissive factor and texture, and KHR_materials_emissive_strength.

use gltf::json::{Material, texture::Info};

use super::document::Document;
use crate::Result;
use crate::scene::emission::Emission;
use crate::scene::texture::TextureRef;

/// Name of the extension that gives factors above 1.
const STRENGTH: &str = "KHR_materials_emissive_strength";

/// Emission of the material `json` at the place `at` of the file; `None` where its factor or its strength is 0. `read` reads a texture, or gives
/// `None` if that is not possible.
///
/// # Errors
/// [`crate::Error::Input`] where the strength is no number from 0 on.
pub fn read(
    document: &Document,
    json: &Material,
    at: &str,
    read: impl FnOnce(&Info) -> Result<Option<TextureRef>>,
) -> Result<Option<Emission>> {
    let extension = json.extensions.as_ref().and_then(|e| e.others.get(STRENGTH));
    let strength = match extension.and_then(|e| e.get("emissiveStrength")) {
        None => 1.0,
        Some(value) => {
            let known = value.as_f64().filter(|v| *v >= 0.0 && (*v as f32).is_finite());
            known.ok_or_else(|| document.error(at, format!("{STRENGTH}: emissiveStrength {value} is not 0 or more")))?
        }
    };
    let color = json.emissive_factor.0.map(|c| (f64::from(c.max(0.0)) * strength) as f32);
    if color == [0.0; 3] || color.iter().any(|c| !c.is_finite()) {
        return Ok(None);
    }
    let texture = json.emissive_texture.as_ref().map_or(Ok(None), read)?;
    Ok(Some(Emission { color, texture }))
}
