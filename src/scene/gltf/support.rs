//! Which extensions are read, and what to do about those that are not.

use super::document::Document;
use crate::{Error, Result};

/// Accessors of 64-bit floats.
pub const DOUBLES: &str = "KHR_accessor_float64";
/// Indices that begin another strip, loop or fan.
pub const RESTART: &str = "KHR_mesh_primitive_restart";

/// Read, or without bearing on shape and base colour.
const READ: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "FB_ngon_encoding",
    DOUBLES,
    RESTART,
    "KHR_lights_punctual",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_transform",
    super::extension::NAME,
    "KHR_animation_pointer",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_variants",
    "KHR_xmp_json_ld",
];

/// Test whether a file says that it uses an extension.
pub fn uses(document: &Document, name: &str) -> bool {
    document.root.extensions_used.iter().chain(&document.root.extensions_required).any(|n| n == name)
}

/// Refuse a file that requires what is not read, by name.
pub fn check(document: &Document) -> Result<()> {
    let Some(name) = document.root.extensions_required.iter().find(|n| !READ.contains(&n.as_str())) else {
        return Ok(());
    };
    let advice = match name.as_str() {
        "KHR_draco_mesh_compression" => "export it without Draco; meshopt compression is read",
        "KHR_texture_basisu" => "export it with PNG, JPEG or WebP textures instead of KTX2",
        "EXT_texture_avif" | "MSFT_texture_dds" => "export it with PNG, JPEG or WebP textures",
        _ => "export it without, or take it out of extensionsRequired if the rest makes sense alone",
    };
    Err(Error::unsupported(&document.path, format!("glTF extension {name}, which the file requires ({advice}),")))
}
