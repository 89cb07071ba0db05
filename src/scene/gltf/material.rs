//! Materials: base colour, its texture and how it is laid on, alpha, and the shell that a material may carry.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use gltf::json::extensions::texture::TextureTransform;
use gltf::json::material::AlphaMode;
use gltf::json::texture::{Info, MagFilter, WrappingMode};
use gltf::json::validation::Checked;
use serde_json::Value;

use super::document::{Document, index};
use super::{ReadOptions, emission, extension, transmission};
use crate::scene::alpha::AlphaSums;
use crate::scene::image::Refused;
use crate::scene::model::{Alpha, Material, Part};
use crate::scene::texture::TextureRef;
use crate::scene::texture::{Texture, Wrap};
use crate::scene::{files, image};
use crate::volume::Finish;
use crate::{Result, Warnings};

/// All materials of the file, with the file's indices, followed by the default for parts without one. Materials that no part uses are not read.
/// Afterwards each part has the sets of texture coordinates that its material needs.
pub fn read(
    document: &Document,
    options: &ReadOptions,
    parts: &mut [Part],
    texels: &mut extension::TexelTable,
    warnings: &mut Warnings,
) -> Result<Vec<Material>> {
    let count = document.root.materials.len();
    let mut used = vec![false; count + 1];
    for part in parts.iter() {
        let Some(flag) = used.get_mut(part.material) else {
            return Err(document.error(format!("materials[{}]", part.material), "does not exist"));
        };
        *flag = true;
    }
    let mut images = Images { document, options, missing: BTreeSet::new(), textures: BTreeMap::new() };
    let mut materials = Vec::with_capacity(count + 1);
    for (i, &used) in used[..count].iter().enumerate() {
        materials.push(if used { material(&mut images, i, texels, warnings)? } else { Material::default() });
    }
    if used[count] || count == 0 {
        // As the format has the material of what names none.
        materials.push(Material { double_sided: false, ..Material::default() });
    }
    for part in parts {
        let material = &materials[part.material];
        let texture = material.texture.as_ref().map(|t| t.tex_coord);
        let through = material.transmission.iter().flat_map(|t| [&t.factor_texture, &t.color_texture]);
        let through: Vec<usize> = through.flatten().map(|t| t.tex_coord).collect();
        let shell = material.shell.as_ref().filter(|_| part.uvw.is_none()).map(|s| s.tex_coord);
        for set in [texture, shell].into_iter().flatten().chain(through) {
            if set >= part.uvs.len() {
                warnings.add("texture coordinates that a material asks for are missing; they are read as 0");
                part.uvs.resize_with(set + 1, || vec![[0.0; 2]; part.positions.len()]);
            }
        }
    }
    Ok(materials)
}

fn material(
    images: &mut Images,
    i: usize,
    texels: &mut extension::TexelTable,
    warnings: &mut Warnings,
) -> Result<Material> {
    let document = images.document;
    let at = format!("materials[{i}]");
    let json = &document.root.materials[i];
    let name = json.name.clone().unwrap_or_else(|| format!("material {i}"));
    let alpha = alpha(json).ok_or_else(|| document.error(&*at, "has an unknown alphaMode"))?;
    let opaque = alpha == Alpha::Opaque;
    let (mut base_color, texture) = diffuse(document, json, &at)?;
    if opaque {
        base_color[3] = 1.0;
    }
    let texture = match texture {
        Some(info) => images.reference(&info, opaque, &at, warnings)?,
        None => None,
    };
    if let Some(t) = texture.as_ref().filter(|_| !opaque) {
        document.charge(AlphaSums::bytes(&t.texture), &at)?;
    }
    let emissive = json.emissive_factor.0.iter().any(|v| *v > 0.0);
    if emissive && !images.options.emission && texture.is_none() && base_color[..3] == [0.0; 3] {
        warnings.add(format!("material {name} only emits light, which is not taken: it is black"));
    }
    let extensions = json.extensions.as_ref();
    let shell = extensions.and_then(|e| e.others.get(extension::NAME)).filter(|json| !extension::places_copies(json));
    let wind = shell.map(|json| extension::wind_of_shell(document, json, &at, texels, warnings)).transpose()?;
    let mut textures =
        |info: &Info, opaque: bool, at: &str, warnings: &mut Warnings| images.reference(info, opaque, at, warnings);
    let read = |json| extension::material(document, (json, &at), texels, &mut textures, warnings);
    let shell = shell.map(read).transpose()?;
    let unlit = extensions.is_some_and(|e| e.unlit.is_some());
    // The alpha of the factor texture is its value, so it is kept; that of an emissive texture has no meaning.
    let transmission = transmission::read(document, extensions.map(|e| &e.others), &at, |info| {
        images.reference(info, false, &at, warnings)
    })?;
    let emission = match unlit || !images.options.emission {
        true => None,
        false => emission::read(document, json, &at, |info| images.reference(info, true, &at, warnings))?,
    };
    Ok(Material {
        name,
        base_color: base_color.map(|c| if c.is_finite() { c.max(0.0) } else { 0.0 }),
        texture,
        alpha,
        double_sided: json.double_sided,
        unlit,
        finish: Finish::PLAIN,
        emission: emission.map(Box::new),
        transmission: transmission.filter(|_| !unlit).map(Box::new),
        shell: shell.map(Arc::new),
        wind: wind.flatten(),
    })
}

fn alpha(json: &gltf::json::Material) -> Option<Alpha> {
    match json.alpha_mode {
        Checked::Valid(AlphaMode::Opaque) => Some(Alpha::Opaque),
        Checked::Valid(AlphaMode::Mask) => Some(Alpha::Mask(json.alpha_cutoff.map_or(0.5, |c| c.0))),
        Checked::Valid(AlphaMode::Blend) => Some(Alpha::Blend),
        Checked::Invalid => None,
    }
}

/// Factor and texture of the diffuse colour, of either material model.
fn diffuse(document: &Document, json: &gltf::json::Material, at: &str) -> Result<([f32; 4], Option<Info>)> {
    let old = json.extensions.as_ref().and_then(|e| e.others.get("KHR_materials_pbrSpecularGlossiness"));
    let Some(old) = old else {
        let pbr = &json.pbr_metallic_roughness;
        return Ok((pbr.base_color_factor.0, pbr.base_color_texture.clone()));
    };
    let bad = |e: serde_json::Error| document.error(at, format!("KHR_materials_pbrSpecularGlossiness: {e}"));
    let parsed: SpecularGlossiness = serde_json::from_value(old.clone()).map_err(bad)?;
    Ok((parsed.diffuse_factor.unwrap_or([1.0; 4]), parsed.diffuse_texture))
}

/// The older material model, of which the diffuse colour is used.
#[derive(serde::Deserialize)]
#[serde(rename_all = "camelCase")]
struct SpecularGlossiness {
    diffuse_factor: Option<[f32; 4]>,
    diffuse_texture: Option<Info>,
}

/// The parameters of a sampler that matter here: wrap modes along u and v (0 repeat, 1 mirror, 2 clamp), and whether lookups are nearest. It is
/// used as a key.
type Sampling = ([u8; 2], bool);

/// Textures that were decoded so far. An image with several samplers is decoded for each of them, so that no undecoded copy is kept.
struct Images<'a> {
    document: &'a Document,
    options: &'a ReadOptions,
    /// Images that cannot be read.
    missing: BTreeSet<usize>,
    textures: BTreeMap<(usize, Sampling, bool), Arc<Texture>>,
}

impl Images<'_> {
    /// The texture that a material refers to; `None` if textures are not read, or, with a counted warning, if its image cannot be.
    fn reference(
        &mut self,
        info: &Info,
        opaque: bool,
        at: &str,
        warnings: &mut Warnings,
    ) -> Result<Option<TextureRef>> {
        if !self.options.textures {
            return Ok(None);
        }
        let id = info.index.value();
        let texture = self.document.root.textures.get(id);
        let texture = texture.ok_or_else(|| self.document.error(at, format!("textures[{id}] does not exist")))?;
        let others = texture.extensions.as_ref().map(|e| &e.others);
        let source = |name: &str| {
            let source = others.and_then(|o| o.get(name)?.get("source")).and_then(Value::as_u64);
            source.and_then(|s| usize::try_from(s).ok())
        };
        // A texture without a source of its own has this value.
        let own = Some(texture.source.value()).filter(|&s| s != u32::MAX as usize);
        let Some(image) = source("EXT_texture_webp").or(own) else {
            let other = others.and_then(|o| o.keys().next().cloned()).unwrap_or("no source".into());
            warnings.add(format!("a texture with {other} is left out; the factor colour is used"));
            return Ok(None);
        };
        let sampling = match index(texture.sampler) {
            None => ([0, 0], false),
            Some(s) => {
                let sampler = self.document.root.samplers.get(s);
                let sampler =
                    sampler.ok_or_else(|| self.document.error(at, format!("samplers[{s}] does not exist")))?;
                let nearest = matches!(sampler.mag_filter, Some(Checked::Valid(MagFilter::Nearest)));
                ([wrap(&sampler.wrap_s), wrap(&sampler.wrap_t)], nearest)
            }
        };
        let Some(texture) = self.texture(image, sampling, opaque, warnings)? else { return Ok(None) };
        let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
        let tex_coord = transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord) as usize;
        if tex_coord >= 64 {
            return Err(self.document.error(at, format!("texCoord {tex_coord} is out of range")));
        }
        Ok(Some(TextureRef { texture, tex_coord, transform: transform.map_or(IDENTITY, rows) }))
    }

    fn texture(
        &mut self,
        image: usize,
        sampling: Sampling,
        opaque: bool,
        warnings: &mut Warnings,
    ) -> Result<Option<Arc<Texture>>> {
        if let Some(texture) = self.textures.get(&(image, sampling, opaque)) {
            return Ok(Some(texture.clone()));
        }
        if self.missing.contains(&image) {
            return Ok(None);
        }
        let Some(mut texture) = self.decode(image, warnings)? else {
            self.missing.insert(image);
            return Ok(None);
        };
        self.document.charge(4 * texture.texels.len() as u64, &format!("images[{image}]"))?;
        texture.wrap = sampling.0.map(|w| [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp][usize::from(w)]);
        texture.nearest = sampling.1;
        if opaque && texture.has_cutouts() {
            let name = &texture.name;
            warnings
                .add(format!("texture {name} has alpha, which is not used: an alphaMode of OPAQUE takes it for solid"));
        }
        if opaque {
            // glTF ignores alpha then, so it must not weight averages of colours either.
            texture.texels.iter_mut().for_each(|t| t[3] = 255);
        }
        let texture = Arc::new(texture);
        self.textures.insert((image, sampling, opaque), texture.clone());
        Ok(Some(texture))
    }

    /// Decode an image; `None`, with a counted warning, if it is missing or broken.
    fn decode(&self, id: usize, warnings: &mut Warnings) -> Result<Option<Texture>> {
        let at = format!("images[{id}]");
        let document = self.document;
        let json = document.root.images.get(id).ok_or_else(|| document.error(&*at, "does not exist"))?;
        let uri = json.uri.as_deref().filter(|u| files::scheme(u).is_none());
        let name = json.name.clone().or(uri.map(str::to_string)).unwrap_or_else(|| at.clone());
        let hint = json.mime_type.as_ref().map(|m| m.0.as_str()).or(uri).unwrap_or_default();
        let bytes = match (index(json.buffer_view), &json.uri) {
            (Some(view), _) => document.view(view).map(|v| v.bytes.to_vec()),
            (None, Some(uri)) => document.fetch(uri, &at, true),
            (None, None) => Err(document.error(&*at, "has neither a URI nor a buffer view")),
        };
        let texture = bytes
            .map_err(|e| Refused::Image(e.to_string()))
            .and_then(|bytes| image::decode(&name, &bytes, hint, self.options.max_pixels, document.left()));
        match texture {
            Ok(texture) => Ok(Some(texture)),
            Err(Refused::Memory(needed)) => document.charge(needed, &at).map(|()| None),
            Err(Refused::Image(what)) => {
                warnings.add(format!("texture {name} cannot be read ({what}); the factor colour is used"));
                Ok(None)
            }
        }
    }
}

fn wrap(mode: &Checked<WrappingMode>) -> u8 {
    match mode {
        Checked::Valid(WrappingMode::MirroredRepeat) => 1,
        Checked::Valid(WrappingMode::ClampToEdge) => 2,
        _ => 0,
    }
}

/// KHR_texture_transform of the first of a material's textures that uses the set `set` of texture coordinates, base colour before the others;
/// identity if there is none.
#[cfg(feature = "bake")]
pub fn uv_transform(material: Option<&gltf::json::Material>, set: u32) -> [[f32; 3]; 2] {
    let Some(material) = material else { return IDENTITY };
    let pbr = &material.pbr_metallic_roughness;
    let old = material.extensions.as_ref().and_then(|e| e.others.get("KHR_materials_pbrSpecularGlossiness"));
    let old = old.and_then(|old| serde_json::from_value::<SpecularGlossiness>(old.clone()).ok());
    let old = old.and_then(|old| old.diffuse_texture);
    let textures = [&old, &pbr.base_color_texture, &pbr.metallic_roughness_texture, &material.emissive_texture];
    let of = |info: &Info| {
        let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
        let used = transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord);
        (used == set).then(|| transform.map_or(IDENTITY, rows))
    };
    textures.into_iter().flatten().find_map(of).unwrap_or(IDENTITY)
}

const IDENTITY: [[f32; 3]; 2] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

/// Translation · rotation · scale, as KHR_texture_transform has it: v points down, so a positive angle turns the image
/// counter-clockwise.
fn rows(t: &TextureTransform) -> [[f32; 3]; 2] {
    let (sin, cos) = (libm::sinf(t.rotation.0), libm::cosf(t.rotation.0));
    let ([sx, sy], [x, y]) = (t.scale.0, t.offset.0);
    [[cos * sx, sin * sy, x], [-sin * sx, cos * sy, y]]
}
