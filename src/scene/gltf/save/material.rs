//! Writing of a model's materials and their textures to a glTF file, each when it is first used.

use std::collections::BTreeMap;
use std::sync::Arc;

use image::ImageEncoder;
use image::codecs::png::PngEncoder;
use serde_json::{Value, json};

use crate::scene::gltf::write::Editor;
use crate::scene::model::{Alpha, Material, Model};
use crate::scene::texture::TextureRef;
use crate::scene::texture::{Texture, Wrap};
use crate::scene::transmission::Transmission;
use crate::{Error, Result, Warnings};

/// The materials of a model and those that have been written.
pub struct Materials<'a> {
    model: &'a Model,
    /// Indices in the file by the model's material and whether it is written with its texture.
    known: BTreeMap<(usize, bool), usize>,
    textures: Vec<(Arc<Texture>, usize)>,
}

impl<'a> Materials<'a> {
    pub fn new(model: &'a Model) -> Materials<'a> {
        Materials { model, known: BTreeMap::new(), textures: Vec::new() }
    }

    /// The set of texture coordinates that a material uses, if it has a texture.
    pub fn tex_coord(&self, material: usize) -> Option<usize> {
        self.model.materials.get(material)?.texture.as_ref().map(|t| t.tex_coord)
    }

    /// Index of a material in the file, which is written if needed; `textured` tells whether with its texture, which then uses set 0 of texture
    /// coordinates.
    pub fn index(
        &mut self,
        material: usize,
        textured: bool,
        file: &mut Editor,
        warnings: &mut Warnings,
    ) -> Result<usize> {
        if let Some(&known) = self.known.get(&(material, textured)) {
            return Ok(known);
        }
        let own = self.model.materials.get(material).cloned().unwrap_or_else(Material::default);
        let mut json = plain(&own, warnings);
        if own.unlit {
            file.use_extension("KHR_materials_unlit")?;
            json["extensions"]["KHR_materials_unlit"] = json!({});
        }
        if let Some(emission) = &own.emission {
            let strength = emission.color.iter().copied().fold(1.0, f32::max);
            json["emissiveFactor"] = json!(emission.color.map(|c| c / strength));
            if strength > 1.0 {
                file.use_extension("KHR_materials_emissive_strength")?;
                json["extensions"]["KHR_materials_emissive_strength"] = json!({"emissiveStrength": strength});
            }
            if let Some(texture) = emission.texture.as_ref().filter(|_| textured) {
                json["emissiveTexture"] = self.reference(texture, file)?;
            }
        }
        if let Some(texture) = own.texture.as_ref().filter(|_| textured) {
            json["pbrMetallicRoughness"]["baseColorTexture"] = self.reference(texture, file)?;
        }
        if let Some(through) = &own.transmission {
            file.use_extension("KHR_materials_diffuse_transmission")?;
            let transmission = self.transmission(through, &own, textured, file, warnings)?;
            json["extensions"]["KHR_materials_diffuse_transmission"] = transmission;
        }
        let index = file.push("materials", json)?;
        self.known.insert((material, textured), index);
        Ok(index)
    }

    /// What lets light through; its textures where they lie as the base colour's does.
    fn transmission(
        &mut self,
        of: &Transmission,
        own: &Material,
        textured: bool,
        file: &mut Editor,
        warnings: &mut Warnings,
    ) -> Result<Value> {
        let base = if of.of_base { own.base_color } else { [1.0; 4] };
        let color = [0, 1, 2].map(|k| (of.color[k] * base[k]).clamp(0.0, 1.0));
        let mut json = json!({"diffuseTransmissionFactor": of.factor, "diffuseTransmissionColorFactor": color});
        let alike = |t: &TextureRef| textured && own.texture.as_ref().is_some_and(|b| b.tex_coord == t.tex_coord);
        let base_texture = own.texture.as_ref().filter(|_| of.of_base);
        for (name, texture) in [
            ("diffuseTransmissionTexture", of.factor_texture.as_ref()),
            ("diffuseTransmissionColorTexture", of.color_texture.as_ref().or(base_texture)),
        ] {
            match texture {
                Some(texture) if alike(texture) => json[name] = self.reference(texture, file)?,
                Some(_) => {
                    warnings.add("a texture of light that comes through is left out: it lies unlike the colour's")
                }
                None => {}
            }
        }
        Ok(json)
    }

    fn reference(&mut self, of: &TextureRef, file: &mut Editor) -> Result<Value> {
        let known = self.textures.iter().find(|(t, _)| Arc::ptr_eq(t, &of.texture)).map(|(_, index)| *index);
        let index = match known {
            Some(index) => index,
            None => {
                let index = texture(&of.texture, file)?;
                self.textures.push((Arc::clone(&of.texture), index));
                index
            }
        };
        let mut json = json!({"index": index});
        if let Some(transform) = transform(&of.transform) {
            file.use_extension("KHR_texture_transform")?;
            json["extensions"] = json!({"KHR_texture_transform": transform});
        }
        Ok(json)
    }
}

/// All of a material but its texture.
fn plain(material: &Material, warnings: &mut Warnings) -> Value {
    let color = material.base_color.map(|c| c.clamp(0.0, 1.0));
    let beyond = material.base_color.iter().any(|c| *c > 1.0);
    warnings.add_many("a colour brighter than white is clamped: glTF has none", u64::from(beyond));
    let mut json = json!({"pbrMetallicRoughness":
        {"baseColorFactor": color, "metallicFactor": 0.0, "roughnessFactor": 1.0}});
    if !material.name.is_empty() {
        json["name"] = json!(material.name);
    }
    match material.alpha {
        Alpha::Opaque => {}
        Alpha::Mask(cutoff) => (json["alphaMode"], json["alphaCutoff"]) = (json!("MASK"), json!(cutoff.max(0.0))),
        Alpha::Blend => json["alphaMode"] = json!("BLEND"),
    }
    if material.double_sided {
        json["doubleSided"] = json!(true);
    }
    json
}

/// A texture transform as KHR_texture_transform; `None` for the identity. It must be without shear, as those that were read from files are.
fn transform([[a, b, c], [d, e, f]]: &[[f32; 3]; 2]) -> Option<Value> {
    let [a, b, c, d, e, f] = [*a, *b, *c, *d, *e, *f].map(f64::from);
    if [a, b, c, d, e, f] == [1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
        return None;
    }
    // u' = sx cos r · u + sy sin r · v + c; v' = −sx sin r · u + sy cos r · v + f.
    let scale_x = a.hypot(d);
    let (sin, cos) = if scale_x > 0.0 { (-d / scale_x, a / scale_x) } else { (0.0, 1.0) };
    let scale_y = b * sin + e * cos;
    Some(json!({"offset": [c, f], "rotation": libm::atan2(sin, cos), "scale": [scale_x, scale_y]}))
}

fn texture(of: &Texture, file: &mut Editor) -> Result<usize> {
    let mut png = Vec::new();
    let opaque = of.texels.iter().all(|t| t[3] == 255);
    let failed = |e: image::ImageError| Error::Options(format!("texture {:?} cannot be encoded: {e}", of.name));
    let encoder = PngEncoder::new(&mut png);
    if opaque {
        let rgb: Vec<u8> = of.texels.iter().flat_map(|t| [t[0], t[1], t[2]]).collect();
        encoder.write_image(&rgb, of.width, of.height, image::ExtendedColorType::Rgb8).map_err(failed)?;
    } else {
        let rgba: Vec<u8> = of.texels.iter().flatten().copied().collect();
        encoder.write_image(&rgba, of.width, of.height, image::ExtendedColorType::Rgba8).map_err(failed)?;
    }
    let source = file.add_image(&png, "image/png", &of.name)?;
    let wrap = of.wrap.map(|w| match w {
        Wrap::Repeat => 10_497,
        Wrap::Mirror => 33_648,
        Wrap::Clamp => 33_071,
    });
    let [least, most] = if of.nearest { [9728, 9728] } else { [9987, 9729] };
    let sampler = json!({"wrapS": wrap[0], "wrapT": wrap[1], "minFilter": least, "magFilter": most});
    let sampler = file.push("samplers", sampler)?;
    file.push("textures", json!({"source": source, "sampler": sampler}))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transforms_of_textures_are_said_as_the_extension_has_them() {
        let (r, s) = (0.7f64, [2.0, -0.5]);
        let (sin, cos) = r.sin_cos();
        let rows = [[s[0] * cos, s[1] * sin, 0.25], [-s[0] * sin, s[1] * cos, -3.0]].map(|row| row.map(|v| v as f32));
        let json = transform(&rows).unwrap();
        let number = |pointer: &str| json.pointer(pointer).and_then(Value::as_f64).unwrap();
        // Rounded to 32 bits once.
        assert!((number("/rotation") - r).abs() < 1e-6 && (number("/scale/1") + 0.5).abs() < 1e-6);
        assert!((number("/scale/0") - 2.0).abs() < 1e-6 && number("/offset/1") == -3.0);
        assert_eq!(transform(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), None);
    }
}
