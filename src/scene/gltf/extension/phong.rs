//! The `phong` and `palette` objects of layers, variants and copies. Normative: `format-spec/landscape-1-materials.md`.

use std::collections::BTreeMap;
use std::sync::Arc;

use gltf::json::texture::Info;
use serde_json::Value;

use super::object::Object;
use crate::geom::DVec3;
use crate::noise::Noise;
use crate::scene::phong::{NoiseSpace, Phong, PhongNoise, Variation};
use crate::scene::texture::TextureRef;
use crate::volume::finish::MAX_SHININESS;
use crate::volume::material::MAX_MATERIALS;
use crate::volume::{Finish, Palette, Style};
use crate::{Result, Warnings};

/// Reads the texture of a `textureInfo`. The arguments are the info, whether alpha is to be ignored, the place in the file, and warnings.
pub type ReadTexture<'a> = dyn FnMut(&Info, bool, &str, &mut Warnings) -> Result<Option<TextureRef>> + 'a;

/// How the images of a shell's layers are read.
pub struct ImageContext<'a> {
    pub textures: &'a mut ReadTexture<'a>,
    /// Set of texture coordinates that gives the shell's u and v.
    pub tex_coord: usize,
}

const CONSTANTS: [&str; 5] = ["ambientFactor", "diffuseFactor", "specularFactor", "shininess", "useTexelAlbedo"];
const VARIATIONS: [&str; 4] = ["ambientTexture", "diffuseTexture", "specularTexture", "noise"];

/// The `palette` and `phong` objects of a layer or of copies. Without `images`, textures are refused.
pub fn styles(
    json: &Object,
    images: Option<&mut ImageContext<'_>>,
    warnings: &mut Warnings,
) -> Result<(Palette, Phong)> {
    let (phong, keep) = phong(json, images, warnings)?;
    let rest = if keep { Style::UNCHANGED } else { Style::WHITE };
    let mut styles = BTreeMap::new();
    if let Some(palette) = json.object("palette")? {
        if palette.json.len() > MAX_MATERIALS {
            return Err(json.error("palette", &format!("has more than {MAX_MATERIALS} materials")));
        }
        for name in palette.json.keys() {
            styles.insert(name.clone(), style(&palette, name, &phong.finish, warnings)?);
        }
    }
    Ok((Palette { styles, rest }, phong))
}

/// The style of a material in a palette; absent parameters of its highlights are taken from `outer`.
fn style(palette: &Object, name: &str, outer: &Finish, warnings: &mut Warnings) -> Result<Style> {
    let Some(json) = palette.object(name)? else { return Ok(Style::UNCHANGED) };
    if let Some(key) = VARIATIONS.iter().find(|key| json.json.contains_key(**key)) {
        return Err(json.error(key, "stands in a palette, which has constants alone: put it into the layer's phong"));
    }
    json.known(&CONSTANTS, &[], warnings);
    let (factor, mut finish, keep) = constants(&json)?;
    if finish.has_gloss() {
        finish.specular = finish.specular.or(outer.specular);
        finish.shininess = finish.shininess.or(outer.shininess);
    }
    Ok(Style { factor, keeps_albedo: keep, finish })
}

/// The `phong` object of `json`, and whether the texel's own albedo is used; without such an object nothing is changed.
pub fn phong(json: &Object, images: Option<&mut ImageContext<'_>>, warnings: &mut Warnings) -> Result<(Phong, bool)> {
    let Some(json) = json.object("phong")? else { return Ok((Phong::default(), true)) };
    json.known(&[&CONSTANTS[..], &VARIATIONS].concat(), &[], warnings);
    let (diffuse, finish, keep) = constants(&json)?;
    let mut variation = Variation { noise: noise(&json, warnings)?, ..Variation::default() };
    match images {
        Some(images) => {
            variation.ambient = image(&json, "ambientTexture", images, true, warnings)?;
            variation.diffuse = image(&json, "diffuseTexture", images, true, warnings)?;
            variation.specular = image(&json, "specularTexture", images, false, warnings)?;
        }
        None => {
            if let Some(key) = VARIATIONS[..3].iter().find(|key| json.json.contains_key(**key)) {
                return Err(json.error(key, "lies on the images below a shell, and rigid copies have none: use noise"));
            }
        }
    }
    let Variation { ambient, diffuse: colour, specular, noise } = &variation;
    let varies = ambient.is_some() || colour.is_some() || specular.is_some() || noise.is_some();
    let variations = if varies { vec![Arc::new(variation)] } else { Vec::new() };
    Ok((Phong { diffuse, finish, variations }, keep))
}

/// The constants of a phong object: factor of the albedo, finish, and whether the texel's own albedo is used.
fn constants(json: &Object) -> Result<([f64; 3], Finish, bool)> {
    let keep = match json.json.get("useTexelAlbedo") {
        None => true,
        Some(Value::Bool(keep)) => *keep,
        Some(_) => return Err(json.error("useTexelAlbedo", "is neither true nor false")),
    };
    let finish = Finish {
        ambient: json.vec3("ambientFactor", 0.0..=1.0)?.unwrap_or([1.0; 3]),
        specular: json.vec3("specularFactor", 0.0..=1.0)?,
        shininess: json.number("shininess", 0.0..=MAX_SHININESS)?,
    };
    Ok((json.vec3("diffuseFactor", 0.0..=f64::MAX)?.unwrap_or([1.0; 3]), finish, keep))
}

fn image(
    json: &Object,
    key: &str,
    images: &mut ImageContext<'_>,
    opaque: bool,
    warnings: &mut Warnings,
) -> Result<Option<TextureRef>> {
    let Some(value) = json.json.get(key) else { return Ok(None) };
    let info: Info = serde_json::from_value(value.clone()).map_err(|e| json.error(key, &e.to_string()))?;
    let found = (images.textures)(&info, opaque, &format!("{}.{key}", json.at), warnings)?;
    if let Some(set) = found.as_ref().map(|t| t.tex_coord).filter(|&set| set != 0 && set != images.tex_coord) {
        let what =
            format!("has texCoord {set}: such an image lies on the shell's own coordinates, {}", images.tex_coord);
        return Err(json.error(key, &what));
    }
    Ok(found)
}

fn noise(json: &Object, warnings: &mut Warnings) -> Result<Option<PhongNoise>> {
    let Some(json) = json.object("noise")? else { return Ok(None) };
    let keys = ["seed", "space", "frequency", "octaves", "ambient", "diffuse", "specular", "shininess"];
    json.known(&keys, &[], warnings);
    let octaves = json.integer("octaves", 8)?.unwrap_or(1) as u32;
    if octaves == 0 {
        return Err(json.error("octaves", "must be at least 1"));
    }
    let frequency = json.vec3("frequency", 0.0..=64.0)?.unwrap_or([0.5; 3]);
    if frequency == [0.0; 3] {
        return Err(json.error("frequency", "must be above 0 along an axis"));
    }
    let ramp = |key: &str| -> Result<[[f64; 3]; 2]> {
        let found = json.colours(key)?;
        match found[..] {
            [] => Ok([[1.0; 3]; 2]),
            [from, to] => Ok([from, to]),
            _ => Err(json.error(key, "is not two colours")),
        }
    };
    Ok(Some(PhongNoise {
        noise: Noise {
            seed: json.integer("seed", u32::MAX.into())?.unwrap_or(0) as u32,
            frequency: DVec3::from_array(frequency),
            origin: DVec3::ZERO,
            period: [0; 3],
            octaves,
            turbulence: false,
        },
        space: json.choice("space", &[("texel", NoiseSpace::Texel), ("world", NoiseSpace::World)])?.unwrap_or_default(),
        ambient: ramp("ambient")?,
        diffuse: ramp("diffuse")?,
        specular: ramp("specular")?,
        shininess: json.numbers::<2>("shininess", 0.0..=f64::MAX)?.unwrap_or([1.0; 2]),
    }))
}
