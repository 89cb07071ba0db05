//! Diffuse transmission of materials: `KHR_materials_diffuse_transmission`, with all ranges checked.

use gltf::json::texture::Info;
use serde_json::Value;

use super::document::Document;
use crate::Result;
use crate::scene::texture::TextureRef;
use crate::scene::transmission::Transmission;

/// Name of the extension.
const NAME: &str = "KHR_materials_diffuse_transmission";

#[derive(serde::Deserialize)]
#[serde(rename_all = "camelCase")]
struct Json {
    diffuse_transmission_factor: Option<f64>,
    diffuse_transmission_texture: Option<Info>,
    diffuse_transmission_color_factor: Option<[f64; 3]>,
    diffuse_transmission_color_texture: Option<Info>,
}

/// Diffuse transmission of the material at the place `at` of the file, whose extensions are `others`; `None` where its factor is 0. `read` reads
/// a texture, or gives `None` if that is not possible.
pub fn read(
    document: &Document,
    others: Option<&serde_json::Map<String, Value>>,
    at: &str,
    mut read: impl FnMut(&Info) -> Result<Option<TextureRef>>,
) -> Result<Option<Transmission>> {
    let Some(json) = others.and_then(|o| o.get(NAME)) else { return Ok(None) };
    let error = |what: String| document.error(at, format!("{NAME}: {what}"));
    let json: Json = serde_json::from_value(json.clone()).map_err(|e| error(e.to_string()))?;
    let factor = json.diffuse_transmission_factor.unwrap_or(0.0);
    let color = json.diffuse_transmission_color_factor.unwrap_or([1.0; 3]);
    if !(0.0..=1.0).contains(&factor) {
        return Err(error(format!("diffuseTransmissionFactor {factor} is not in [0, 1]")));
    }
    if let Some(bad) = color.iter().find(|c| !(0.0..=1.0).contains(*c)) {
        return Err(error(format!("diffuseTransmissionColorFactor: {bad} is not in [0, 1]")));
    }
    if factor == 0.0 {
        return Ok(None);
    }
    let mut texture = |info: Option<Info>| info.map_or(Ok(None), |info| read(&info));
    Ok(Some(Transmission {
        factor: factor as f32,
        factor_texture: texture(json.diffuse_transmission_texture)?,
        color: color.map(|c| c as f32),
        color_texture: texture(json.diffuse_transmission_color_texture)?,
        of_base: false,
    }))
}
