//! MTL files: the materials of Wavefront OBJ → [`Material`]s, textures decoded.
//!
//! tobj reads the statements that matter. The pass in front of it hands on no others and puts those right for which tobj 4.0
//! gives up the whole file or panics: a grey `Kd` of one number, `d -halo`, a material without a name, lines that go on after
//! a backslash. tobj leaves the options of a texture statement in its name: they are read here.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::scene::alpha::AlphaSums;
use crate::scene::image::Refused;
use crate::scene::text::{decode, keyword, logical_lines, without_comment};
use crate::scene::texture::{Texture, Wrap};
use crate::scene::{Alpha, Material, ReadOptions, TextureRef, files, image};
use crate::{Error, Result, Warnings};

/// A material as the text has it.
#[derive(Debug, Default)]
pub struct MtlMaterial {
    name: String,
    /// Folder of the MTL file, which paths start from.
    folder: PathBuf,
    diffuse: Option<[f32; 3]>,
    opacity: Option<f32>,
    color_map: Option<TextureMap>,
    alpha_map: Option<TextureMap>,
    /// True where it emits light.
    emits: bool,
}

impl MtlMaterial {
    /// Its textures that are there.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        let maps = [&self.color_map, &self.alpha_map];
        maps.into_iter().flatten().filter_map(|m| files::find(&self.folder, &m.file, true))
    }
}

/// A texture statement.
#[derive(Debug, Clone, PartialEq)]
struct TextureMap {
    file: String,
    clamp: bool,
    offset: [f32; 2],
    scale: [f32; 2],
}

impl TextureMap {
    /// The texture, as the statement lays it on.
    fn laid_on(&self, mut texture: Texture) -> TextureRef {
        texture.wrap = [if self.clamp { Wrap::Clamp } else { Wrap::Repeat }; 2];
        let ([u, v], [su, sv]) = (self.offset, self.scale);
        // The file's v points up, the texture's down.
        let transform = [[su, 0.0, u], [0.0, sv, 1.0 - sv - v]];
        TextureRef { texture: Arc::new(texture), tex_coord: 0, transform }
    }
}

/// The material files that `rest` of a `mtllib` statement names in the file `path`: one name with spaces, or several; a
/// space within a name may have a backslash before it. Names of files that are not there are errors.
pub fn libraries(path: &Path, rest: &str) -> Vec<Result<PathBuf, String>> {
    const SPACE: &str = "\u{1}";
    let folder = path.parent().unwrap_or(Path::new(""));
    if let Some(path) = files::find(folder, rest, true) {
        return vec![Ok(path)];
    }
    let escaped = rest.replace("\\ ", SPACE);
    let names = escaped.split_whitespace().map(|name| name.replace(SPACE, " "));
    names.map(|name| files::find(folder, &name, true).ok_or(name)).collect()
}

/// The materials of the files that were read, in order.
#[derive(Debug, Default)]
pub struct Library(Vec<MtlMaterial>);

impl Library {
    /// Index of the material `name`; the first of several.
    pub fn position(&self, name: &str) -> Option<usize> {
        self.0.iter().position(|m| m.name == name)
    }

    pub fn get(&self, index: usize) -> Option<&MtlMaterial> {
        self.0.get(index)
    }

    pub fn materials(&self) -> &[MtlMaterial] {
        &self.0
    }

    /// Add the materials of the file `path` that has these bytes. What is not understood is left out and counted.
    pub fn add(&mut self, path: &Path, bytes: &[u8], warnings: &mut Warnings) {
        let (text, names) = rewrite_statements(&decode(bytes), warnings);
        let folder = path.parent().unwrap_or(Path::new(""));
        let materials = match tobj::load_mtl_buf(&mut text.as_bytes()) {
            Ok((materials, _)) => materials,
            Err(e) => {
                warnings.add(format!("a material file cannot be read ({}: {e})", path.display()));
                return;
            }
        };
        self.0.extend(names.into_iter().zip(materials).map(|(name, material)| MtlMaterial {
            name,
            folder: folder.to_path_buf(),
            diffuse: material.diffuse.map(|c| c.map(|v| v as f32)),
            opacity: material.dissolve.map(|v| v as f32),
            color_map: material.diffuse_texture.as_deref().and_then(parse_map),
            alpha_map: material.dissolve_texture.as_deref().and_then(parse_map),
            emits: material.emissive.is_some_and(|c| c.iter().any(|v| *v > 0.0))
                || material.unknown_param.contains_key("map_Ke"),
        }));
    }
}

/// The statements of `text` in the form in which tobj is to read them, and the names of the materials. Names are replaced by numbers, since tobj
/// ignores a material without a name.
fn rewrite_statements(text: &str, warnings: &mut Warnings) -> (String, Vec<String>) {
    let (mut out, mut names) = (String::new(), Vec::new());
    let mut has_opacity = false;
    for (_, line) in logical_lines(text) {
        let (key, rest) = keyword(without_comment(&line));
        if key == "newmtl" {
            has_opacity = false;
            out.push_str(&format!("newmtl {}\n", names.len()));
            names.push(rest.to_owned());
            continue;
        }
        if names.is_empty() {
            continue;
        }
        let statement = match key {
            "Kd" | "Ke" => {
                let values: Option<Vec<f32>> = rest.split_whitespace().map(number).collect();
                match values.as_deref() {
                    Some([grey]) => Some(format!("{key} {grey} {grey} {grey}")),
                    Some([r, g, b, ..]) => Some(format!("{key} {r} {g} {b}")),
                    _ => {
                        warnings.add("a material colour that is not three numbers is ignored");
                        None
                    }
                }
            }
            // `d -halo x` depends on the angle of view: its x is what is seen face on.
            "d" => rest.split_whitespace().last().and_then(number).map(|d| format!("d {d}")),
            "Tr" if has_opacity => None,
            "Tr" => number(rest).map(|t| format!("d {}", 1.0 - t)),
            "map_Kd" | "map_d" | "map_Ke" if !rest.is_empty() => Some(format!("{key} {rest}")),
            _ => None,
        };
        if let Some(statement) = statement {
            has_opacity |= statement.starts_with("d ");
            out.push_str(&statement);
            out.push('\n');
        }
    }
    (out, names)
}

fn number(text: &str) -> Option<f32> {
    text.parse().ok().filter(|v: &f32| v.is_finite())
}

/// `-option values … file name with spaces`
fn parse_map(mut rest: &str) -> Option<TextureMap> {
    let mut map = TextureMap { file: String::new(), clamp: false, offset: [0.0; 2], scale: [1.0; 2] };
    while let Some(option) = rest.strip_prefix('-') {
        let (name, mut tail) = option.split_once(char::is_whitespace)?;
        let mut word = || {
            let (word, left) = tail.trim_start().split_once(char::is_whitespace).unwrap_or((tail.trim_start(), ""));
            tail = left;
            word
        };
        match name {
            "o" | "s" | "t" => {
                let mut values = [if name == "s" { 1.0 } else { 0.0 }; 2];
                for k in 0..3 {
                    // One to three numbers; the first word that is no number belongs to the name or the next option.
                    let Some(value) = number(tail.trim_start().split(char::is_whitespace).next()?) else { break };
                    let after = tail.trim_start().split_once(char::is_whitespace);
                    tail = after?.1;
                    if let Some(v) = values.get_mut(k) {
                        *v = value;
                    }
                }
                match name {
                    "o" => map.offset = values,
                    "s" => map.scale = values,
                    _ => {}
                }
            }
            "mm" => {
                word();
                word();
            }
            "clamp" => map.clamp = word() == "on",
            _ => {
                word();
            }
        }
        rest = tail.trim_start();
    }
    map.file = rest.trim_matches('"').to_string();
    (!map.file.is_empty()).then_some(map)
}

/// Textures that were decoded so far, by their path, and the bytes that may still be allocated.
pub struct Textures {
    decoded: BTreeMap<PathBuf, Option<Arc<Texture>>>,
    left: u64,
}

impl Textures {
    /// None so far, and `max_bytes` for all.
    pub fn new(max_bytes: u64) -> Textures {
        Textures { decoded: BTreeMap::new(), left: max_bytes }
    }

    /// Take `needed` bytes for the texture `file`, before they are allocated.
    fn charge(&mut self, needed: u64, file: &str, options: &ReadOptions) -> Result<()> {
        let what = || format!("decoding the textures of its materials, up to {file}, in bytes,");
        let allowed = options.max_bytes;
        let taken = allowed.saturating_sub(self.left);
        let left = self.left.checked_sub(needed);
        self.left = left.ok_or_else(|| Error::Limit { what: what(), needed: taken.saturating_add(needed), allowed })?;
        Ok(())
    }

    /// Convert a material, and decode its textures; those that cannot be read are left out and counted as warnings.
    ///
    /// # Errors
    /// [`Error::Limit`] where textures take more memory than is allowed.
    pub fn resolve(
        &mut self,
        source: &MtlMaterial,
        options: &ReadOptions,
        warnings: &mut Warnings,
    ) -> Result<Material> {
        let opacity = source.opacity.unwrap_or(1.0).clamp(0.0, 1.0);
        let mut load = |map: &Option<TextureMap>| match map.as_ref().filter(|_| options.textures) {
            Some(map) => self.load(&source.folder, &map.file, options, warnings),
            None => Ok(None),
        };
        let (color, alpha) = (load(&source.color_map)?, load(&source.alpha_map)?);
        // Memory of the combined texture.
        let side = |f: fn(&Texture) -> u32| color.iter().chain(&alpha).map(|t| u64::from(f(t))).max().unwrap_or(0);
        let made = 4 * side(|t| t.width) * side(|t| t.height);
        self.charge(made, &source.name, options)?;
        let name = &source.name;
        if alpha.is_none()
            && let Some(color) = color.as_ref().filter(|c| c.has_cutouts())
        {
            let file = &color.name;
            warnings.add(format!(
                "material {name}: its picture {file} has alpha, which an OBJ uses only where the material says map_d {file} too"
            ));
        }
        let texture = combined(source, color.as_deref(), alpha.as_deref());
        let textured = color.is_some();
        let [r, g, b] = diffuse(source, textured, warnings).map(|c| c.max(0.0));
        let has_alpha = alpha.is_some();
        let alpha = match &texture {
            Some(t) if has_alpha && opacity == 1.0 && is_cut_out(t) => Alpha::Mask(0.5),
            _ if has_alpha || opacity < 1.0 => Alpha::Blend,
            _ => Alpha::Opaque,
        };
        if let Some(texture) = texture.as_ref().filter(|_| alpha != Alpha::Opaque) {
            self.charge(AlphaSums::bytes(texture), &source.name, options)?;
        }
        let map = source.color_map.as_ref().filter(|_| textured).or(source.alpha_map.as_ref());
        Ok(Material {
            finish: crate::volume::Finish::PLAIN,
            name: source.name.clone(),
            base_color: [r, g, b, opacity],
            texture: texture.zip(map).map(|(texture, map)| map.laid_on(texture)),
            alpha,
            // Faces of an OBJ have no culled side.
            double_sided: true,
            transmission: None,
            ..Material::default()
        })
    }

    fn load(
        &mut self,
        dir: &Path,
        file: &str,
        options: &ReadOptions,
        warnings: &mut Warnings,
    ) -> Result<Option<Arc<Texture>>> {
        let key = dir.join(file);
        if let Some(known) = self.decoded.get(&key) {
            return Ok(known.clone());
        }
        let decoded = files::find(dir, file, true).ok_or(Refused::Image("no such file".into())).and_then(|path| {
            let bytes = files::read(&path, self.left).map_err(|e| Refused::Image(e.to_string()))?;
            image::decode(file, &bytes, file, options.max_pixels, self.left)
        });
        let texture = match decoded {
            Ok(texture) => {
                self.charge(4 * texture.texels.len() as u64, file, options)?;
                Some(Arc::new(texture))
            }
            Err(Refused::Memory(needed)) => {
                self.charge(needed, file, options)?;
                None
            }
            Err(Refused::Image(what)) => {
                warnings.add(format!("texture {file} cannot be read ({what}); the colour Kd is used"));
                None
            }
        };
        self.decoded.insert(key, texture.clone());
        Ok(texture)
    }
}

/// The diffuse colour of a material with a texture or without.
fn diffuse(source: &MtlMaterial, textured: bool, warnings: &mut Warnings) -> [f32; 3] {
    let diffuse = source.diffuse.unwrap_or([1.0; 3]);
    if diffuse != [0.0; 3] {
        return diffuse;
    }
    if textured {
        warnings.add("a black Kd under a texture is read as white");
        return [1.0; 3];
    }
    if source.emits {
        warnings.add(format!("material {} only emits light, which is not taken: it is black", source.name));
    }
    diffuse
}

/// The texture of a material, from the images of its `map_Kd` and `map_d`.
fn combined(source: &MtlMaterial, color: Option<&Texture>, alpha: Option<&Texture>) -> Option<Texture> {
    let is_same = source.color_map.as_ref().zip(source.alpha_map.as_ref()).is_some_and(|(c, a)| c.file == a.file);
    match (color, alpha) {
        (None, None) => None,
        (Some(color), None) => Some(with_alpha(color, |_| 255)),
        (Some(color), Some(alpha)) if is_same => Some(with_alpha(color, mask_of(alpha))),
        (color, Some(alpha)) => Some(merged(color, alpha)),
    }
}

/// Opacity of a texel of `map_d`: its alpha where the image has any, else its brightness.
fn mask_of(alpha: &Texture) -> fn(&[u8; 4]) -> u8 {
    if alpha.texels.iter().any(|t| t[3] < 255) {
        |t| t[3]
    } else {
        |t| ((u16::from(t[0]) + u16::from(t[1]) + u16::from(t[2])) / 3) as u8
    }
}

fn with_alpha(color: &Texture, alpha: fn(&[u8; 4]) -> u8) -> Texture {
    let mut out = color.clone();
    out.texels.iter_mut().for_each(|t| t[3] = alpha(t));
    out
}

/// Colour of one image, white where there is none, and alpha of another, at the larger size of both.
fn merged(color: Option<&Texture>, alpha: &Texture) -> Texture {
    let (w, h) = color.map_or((0, 0), |c| (c.width, c.height));
    let (w, h) = (w.max(alpha.width), h.max(alpha.height));
    let mask = mask_of(alpha);
    let texel = |t: &Texture, x: u32, y: u32| {
        let at = |i: u32, from: u32, to: u32| (u64::from(i) * u64::from(to) / u64::from(from.max(1))) as usize;
        t.texels.get(at(y, h, t.height) * t.width as usize + at(x, w, t.width)).copied().unwrap_or_default()
    };
    let merge = |(x, y)| {
        let [r, g, b, _] = color.map_or([255; 4], |c| texel(c, x, y));
        [r, g, b, mask(&texel(alpha, x, y))]
    };
    let texels = (0..h).flat_map(|y| (0..w).map(move |x| (x, y))).map(merge).collect();
    Texture::new(alpha.name.clone(), w, h, texels)
}

/// Test whether alpha is nearly 0 or 1 everywhere, as on a card of leaves, and not the transparency of glass.
fn is_cut_out(texture: &Texture) -> bool {
    let between = texture.texels.iter().filter(|t| (26..230).contains(&t[3])).count();
    between * 4 <= texture.texels.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_stand_before_a_name_with_spaces() {
        let m = parse_map("-s 2 3 1 -o 0.5 -clamp on -mm 0 1 -bm 0.2 my bark.png").unwrap();
        let expected = TextureMap { file: "my bark.png".into(), clamp: true, offset: [0.5, 0.0], scale: [2.0, 3.0] };
        assert_eq!(m, expected);
        assert_eq!(parse_map("leaf 2.png").unwrap().file, "leaf 2.png");
        assert_eq!(parse_map("-imfchan r bump.jpg -bm 1.5").unwrap().file, "bump.jpg -bm 1.5");
        assert_eq!(parse_map("\"C:\\a b.png\"").unwrap().file, "C:\\a b.png");
        for broken in ["", "-s", "-s 1", "-o 1 2", "-clamp", "-x y"] {
            assert_eq!(parse_map(broken), None, "{broken}");
        }
    }

    fn resolved(source: &MtlMaterial, warnings: &mut Warnings) -> Result<Material> {
        Textures::new(1 << 30).resolve(source, &ReadOptions::default(), warnings)
    }

    #[test]
    fn statements_are_understood() {
        let mut warnings = Warnings::default();
        let text = "Kd 1 0 0\nnewmtl a b # c\nKd .5\nTr 0.25\nnewmtl\nKd x\n\td 0.5\nTr 0.9\nmap_Kd t.png";
        let mut library = Library::default();
        library.add(Path::new("./m.mtl"), text.as_bytes(), &mut warnings);
        let list = library.materials();
        assert_eq!((list[0].name.as_str(), list[0].diffuse, list[0].opacity), ("a b", Some([0.5; 3]), Some(0.75)));
        assert_eq!((list[1].name.as_str(), list[1].diffuse, list[1].opacity), ("", None, Some(0.5)));
        let material = resolved(&list[1], &mut warnings).unwrap();
        assert_eq!((material.alpha, material.base_color), (Alpha::Blend, [1.0, 1.0, 1.0, 0.5]));
        assert!(material.texture.is_none());
        assert_eq!(warnings.iter().count(), 2, "the colour and the missing texture");
    }

    #[test]
    fn what_tobj_stumbles_over_is_read() {
        let mut warnings = Warnings::default();
        let text =
            "\u{feff}newmtl a\nKa spectral x\nKd .25\nd -halo .5\nillum nine\nNs\nmap_Bump\nnewmtl\nKd 1 \\\n 2 3\nd";
        let mut library = Library::default();
        library.add(Path::new("m.mtl"), text.as_bytes(), &mut warnings);
        let list = library.materials();
        assert_eq!((list.len(), list[0].diffuse, list[0].opacity), (2, Some([0.25; 3]), Some(0.5)));
        assert_eq!((list[1].diffuse, list[1].opacity), (Some([1.0, 2.0, 3.0]), None));
        assert!(warnings.is_empty(), "{warnings:?}");
    }

    #[test]
    fn alpha_that_is_not_used_and_light_that_is_not_taken_are_said() {
        let dir = tempfile::tempdir().unwrap();
        let card = ::image::RgbaImage::from_fn(8, 8, |x, _| ::image::Rgba([10, 200, 10, if x < 4 { 0 } else { 255 }]));
        card.save(dir.path().join("leaf.png")).unwrap();
        let said = |text: &str| {
            let (mut library, mut warnings) = (Library::default(), Warnings::default());
            library.add(&dir.path().join("m.mtl"), text.as_bytes(), &mut warnings);
            resolved(&library.materials()[0], &mut warnings).unwrap();
            warnings.as_reasons()
        };
        assert!(said("newmtl leaf\nmap_Kd leaf.png").contains("says map_d leaf.png too"));
        assert_eq!(said("newmtl leaf\nmap_Kd leaf.png\nmap_d leaf.png"), "");
        assert!(said("newmtl lamp\nKd 0 0 0\nKe 1 1 1").contains("material lamp only emits light"));
        assert_eq!(said("newmtl lamp\nKd 1 0 0\nKe 1 1 1"), "");
    }

    #[test]
    fn alpha_comes_from_alpha_or_brightness() {
        let color = Texture::new("c", 2, 2, vec![[9, 8, 7, 255]; 4]);
        let grey = Texture::new("a", 1, 1, vec![[200, 200, 200, 255]]);
        let m = merged(Some(&color), &grey);
        assert_eq!((m.width, m.texels[3]), (2, [9, 8, 7, 200]));
        let keyed = Texture::new("a", 1, 2, vec![[200, 200, 200, 0], [0, 0, 0, 255]]);
        assert_eq!(merged(None, &keyed).texels, [[255, 255, 255, 0], [255, 255, 255, 255]]);
        assert!(is_cut_out(&keyed) && !is_cut_out(&Texture::new("glass", 1, 1, vec![[9, 9, 9, 128]])));
    }
}
