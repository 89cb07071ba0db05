//! Paint of a whole source by options of the command line: its colour in a recipe's notation, its material's name, and translucency.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Deserialize;

use super::model::{Albedo, Either, Noise, Projection, Varied};
use crate::geom::{Aabb, DVec3};
use crate::scene::image::Refused;
use crate::scene::{ReadOptions, files, image, text};
use crate::source::noise;
use crate::source::paint;
use crate::source::paint::{Colouring, Paint, PaintedSource, Translucency};
use crate::source::traits::Source;
use crate::{Error, Result};

/// Options of the paint on a whole source.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PaintOptions {
    /// A colour `#rrggbb` or `r,g,b` (linear), a picture's name, the name of a `.toml` or `.json` file with the keys of a
    /// recipe's `albedo`, or such a table itself, as TOML in braces.
    pub albedo: Option<String>,
    /// Whether `albedo` multiplies the source's own colours instead of replacing them.
    pub tint: bool,
    /// Name of the material of all its matter.
    pub material: Option<String>,
    /// Shares of light that are transmitted, where the source gives none.
    pub translucency: Vec<Translucency>,
}

/// Source with the paint of `options`. A picture that is not placed is fitted to the source's box.
///
/// # Errors
/// [`Error::Options`] where the colour is not understood, [`Error::Input`] where its file is not.
pub fn apply_paint(source: Box<dyn Source>, options: &PaintOptions, read: &ReadOptions) -> Result<Box<dyn Source>> {
    if options.tint && options.albedo.is_none() {
        return Err(Error::Options("option `tint` multiplies by what option `albedo` says: give that too".into()));
    }
    if options.material.as_ref().is_some_and(String::is_empty) {
        return Err(Error::Options("option `material` needs a name".into()));
    }
    let translucency = options.translucency.clone();
    if options.albedo.is_none() && options.material.is_none() && translucency.is_empty() {
        return Ok(source);
    }
    let names = source.materials();
    let unknown = |name: &&String| !names.contains(name);
    if let Some(name) = translucency.iter().filter_map(|t| t.material.as_ref()).find(unknown) {
        let known =
            if names.is_empty() { "it names none".to_owned() } else { format!("there are: {}", names.join(", ")) };
        return Err(Error::Options(format!(
            "option `translucency`: the source has no such material as {name:?}; {known}"
        )));
    }
    let mut paint = Paint { material: options.material.clone(), tint: options.tint, translucency, ..Paint::default() };
    if let Some(text) = &options.albedo {
        let spec = Spec::of(text)?;
        let albedo = spec.albedo(&source.bounds(), source.up())?;
        let find = |name: &str| {
            let found = files::find(&spec.folder, name, false).filter(|f| f.is_file());
            found.ok_or_else(|| spec.error(format!("the picture '{name}' is not there")))
        };
        paint.tint |= matches!(&albedo, Either::Table(v) if v.tint);
        (paint.colour, paint.cuts) = colour(&albedo, &find, &|what| spec.error(what.into()), read)?;
    }
    Ok(Box::new(PaintedSource::new(source, paint)))
}

/// The files that it names and that are there.
pub fn files(options: &PaintOptions) -> Vec<PathBuf> {
    let Some(spec) = options.albedo.as_ref().and_then(|text| Spec::of(text).ok()) else { return Vec::new() };
    let picture = spec.table.get("image").and_then(toml::Value::as_str);
    let picture = picture.and_then(|name| files::find(&spec.folder, name, false));
    spec.file.into_iter().chain(picture).filter(|f| f.is_file()).collect()
}

/// A colouring as it is written.
struct Spec {
    /// Empty where it is `plain`.
    table: toml::Table,
    plain: Option<toml::Value>,
    /// File that holds the table, and by whose folder names are looked up.
    file: Option<PathBuf>,
    folder: PathBuf,
}

impl Spec {
    fn of(text: &str) -> Result<Spec> {
        let text = text.trim();
        let here = Spec { table: toml::Table::new(), plain: None, file: None, folder: PathBuf::new() };
        let numbers: Option<Vec<f64>> = text.split(',').map(|v| v.trim().parse().ok()).collect();
        if let Some(rgb) = numbers {
            return Ok(Spec { plain: Some(toml::Value::from(rgb)), ..here });
        }
        if text.starts_with('#') {
            return Ok(Spec { plain: Some(toml::Value::from(text)), ..here });
        }
        if text.starts_with('{') {
            let whole: toml::Table =
                toml::from_str(&format!("albedo = {text}")).map_err(|e| here.error(super::one_line(e.message())))?;
            let table = whole.get("albedo").and_then(toml::Value::as_table).cloned().unwrap_or_default();
            return Ok(Spec { table, ..here });
        }
        let path = Path::new(text);
        if !["toml", "json"].contains(&files::extension(path).as_str()) {
            let mut table = toml::Table::new();
            table.insert("image".into(), text.into());
            return Ok(Spec { table, ..here });
        }
        let text = text::decode(&files::read(path, super::MAX_BYTES)?).into_owned();
        let bad = |at: String, what: &str| Error::input(path, at, super::one_line(what));
        let table = match files::extension(path).as_str() {
            "json" => serde_json::from_str(&text).map_err(|e| bad(String::new(), &e.to_string()))?,
            _ => toml::from_str(&text).map_err(|e: toml::de::Error| {
                bad(e.span().map_or(String::new(), |span| super::place(&text, span.start)), e.message())
            })?,
        };
        Ok(Spec {
            table,
            file: Some(path.to_path_buf()),
            folder: path.parent().unwrap_or(Path::new("")).to_path_buf(),
            ..here
        })
    }

    fn error(&self, what: String) -> Error {
        match &self.file {
            Some(file) => Error::input(file, "", what),
            None => Error::Options(format!(
                "option `albedo`: {what} (a colour '#8d9299' or r,g,b, a picture, a .toml file, or '{{ noise = {{ scale = 1 }}, colours = [\"#000000\", \"#ffffff\"] }}')"
            )),
        }
    }

    /// As a recipe has it, with pictures fitted to the box where nothing else is said.
    fn albedo(&self, bounds: &Aabb, up: u8) -> Result<Albedo> {
        let value = match &self.plain {
            Some(plain) => plain.clone(),
            None => toml::Value::Table(self.fitted(bounds, up)),
        };
        Albedo::deserialize(value).map_err(|e| self.error(super::one_line(e.message())))
    }

    fn fitted(&self, b: &Aabb, up: u8) -> toml::Table {
        let mut table = self.table.clone();
        if !table.contains_key("image") || b.is_empty() {
            return table;
        }
        let point = |p: DVec3| toml::Value::from(p.to_array().to_vec());
        let upward = if up == 1 { DVec3::Y } else { DVec3::Z };
        let (size, least) = (b.size(), b.size().max_element() * 1e-6 + f64::MIN_POSITIVE);
        let high = size.dot(upward).max(least);
        let round = table.get("projection").and_then(toml::Value::as_str).is_some_and(|p| p != "planar");
        let (origin, axis, wide) = match table.get("projection").and_then(toml::Value::as_str) {
            Some("cylindrical") => (b.centre() - 0.5 * high * upward, upward, high),
            Some("spherical") => (b.centre(), upward, high),
            // Seen from the front.
            _ if up == 1 => (b.min, DVec3::Z, size.x.max(least)),
            _ => (b.min, DVec3::NEG_Y, size.x.max(least)),
        };
        let placed = ["origin", "axis", "size"].iter().any(|key| table.contains_key(*key));
        if !placed || round {
            table.entry("origin").or_insert_with(|| point(origin));
            table.entry("axis").or_insert_with(|| point(axis));
            table.entry("size").or_insert_with(|| toml::Value::from(vec![wide, high]));
        }
        table
    }
}

/// A recipe's colouring, and whether it leaves anything out; files are looked up by `find`.
pub fn colour(
    albedo: &Albedo,
    find: &dyn Fn(&str) -> Result<PathBuf>,
    error: &dyn Fn(&str) -> Error,
    read: &ReadOptions,
) -> Result<(Option<Colouring>, bool)> {
    let varied = match albedo {
        Either::Plain(c) => {
            let [r, g, b] = c.0;
            return Ok((Some(Arc::new(move |_, _| [r, g, b, 1.0])), false));
        }
        Either::Table(varied) => varied,
    };
    let colours: Vec<[f32; 3]> = varied.colours.iter().map(|c| c.0).collect();
    let even = match (&varied.image, &varied.gradient, &varied.noise) {
        (Some(name), None, None) => {
            let path = find(name)?;
            let bytes = files::read(&path, read.max_bytes)?;
            let hint = path.to_string_lossy();
            let texture = image::decode(name, &bytes, &hint, read.max_pixels, read.max_bytes).map_err(|e| match e {
                Refused::Image(what) => Error::input(&path, "", what),
                Refused::Memory(needed) => {
                    let what = format!("decoding {}, in bytes,", path.display());
                    Error::Limit { what, needed, allowed: read.max_bytes }
                }
            })?;
            let cuts = texture.texels.iter().any(|t| t[3] < 255);
            return Ok((Some(paint::picture(texture, projection(varied))), cuts));
        }
        (None, Some(g), None) if !colours.is_empty() => {
            let (from, way) = (g.from.0, g.to.0 - g.from.0);
            let length = way.length_squared();
            paint::ramp(colours, move |p| if length > 0.0 { (p - from).dot(way) / length } else { 0.0 })
        }
        (None, None, Some(n)) if !colours.is_empty() => {
            let (noise, signed) = (noise(n), !n.turbulence);
            paint::ramp(colours, move |p| {
                let value = noise.at(p).0;
                if signed { 0.5 + 0.5 * value } else { value }
            })
        }
        _ => {
            return Err(error("an albedo is a colour, or has either an image, or noise or a gradient and its colours"));
        }
    };
    Ok((Some(even), false))
}

pub fn noise(n: &Noise) -> noise::Noise {
    noise::Noise {
        seed: n.seed,
        frequency: DVec3::splat(1.0 / n.scale.0),
        origin: DVec3::ZERO,
        period: [0; 3],
        octaves: u32::from(n.octaves.clamp(1, 10)),
        turbulence: n.turbulence,
    }
}

fn projection(v: &Varied) -> paint::Projection {
    let (origin, axis) = (v.origin.0, v.axis.0);
    let [width, height] = v.size.map(|s| s.0);
    match v.projection {
        Projection::Planar => {
            // Upright where it can be: seen from where the normal points to, with y (or z) upward.
            let top = if axis.y.abs() < 0.999 { DVec3::Y } else { DVec3::NEG_Z };
            let right = top.cross(axis).normalize_or(DVec3::X);
            paint::Projection::Planar { origin, right: width * right, up: height * axis.cross(right) }
        }
        Projection::Cylindrical => paint::Projection::Cylindrical { origin, up: axis, height },
        Projection::Spherical => paint::Projection::Spherical { origin, up: axis },
    }
}
