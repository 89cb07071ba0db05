//! Files of trajectories, hair, tracts and neurons → strands.

mod csv;
mod cursor;
mod hair;
mod swc;
mod tck;
#[cfg(test)]
mod tests;
mod trk;
mod trx;

use std::io::Read;
use std::path::{Path, PathBuf};

use cursor::{Cursor, Fault, at_byte, point};

use super::{CurveOptions, CurveSource, Section, Strand};
use crate::error::short;
use crate::geom::{Aabb, DVec3};
use crate::scene::far::Decimals;
use crate::scene::text::decode;
use crate::scene::texture::srgb_to_linear;
use crate::scene::{far, files};
use crate::{Error, Result, Warnings};

/// Extensions that are read here; each may have `.gz` after it.
pub const KNOWN: [&str; 7] = ["csv", "tsv", "hair", "trk", "trx", "tck", "swc"];

/// Bytes per point while it is read and as a part of a source.
const POINT_BYTES: usize = 96;

/// Options of trajectories, and of the lines and points of meshes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectoryOptions {
    /// Cross-section of every trajectory.
    pub section: Section,
    /// Kind of matter that trajectories become.
    pub curve: CurveOptions,
    /// Width, in source units, of what the file gives none; by default a 500th of a trajectories' extent, with a warning,
    /// and a mesh's lines and points are left out.
    pub width: Option<f64>,
    /// Factor of all widths.
    pub width_scale: f64,
    /// True where colours are linear; else they are sRGB.
    pub linear_colour: bool,
}

impl Default for TrajectoryOptions {
    fn default() -> Self {
        TrajectoryOptions {
            section: Section::Round,
            curve: CurveOptions::default(),
            width: None,
            width_scale: 1.0,
            linear_colour: false,
        }
    }
}

/// Content of a file. A radius that is missing is NaN.
#[derive(Debug, Default)]
struct Content {
    strands: Vec<Strand>,
    /// Metres in a unit; 0 where the format does not say.
    metres_per_unit: f64,
    /// Decimal places of the points, where they are text.
    decimals: Decimals,
    warnings: Warnings,
}

/// The known extension of a file, in lower case and without `.gz`; empty where it is not known.
pub fn extension(path: &Path) -> &'static str {
    let is_packed = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz"));
    let inner = if is_packed { path.with_extension("") } else { PathBuf::from(path) };
    let own = inner.extension().and_then(|e| e.to_str()).unwrap_or_default();
    KNOWN.into_iter().find(|known| own.eq_ignore_ascii_case(known)).unwrap_or_default()
}

/// The bytes of a file, unpacked where it is compressed by gzip; at most `max_bytes`.
fn bytes_of(path: &Path, max_bytes: u64) -> Result<Vec<u8>> {
    let bytes = files::read(path, max_bytes)?;
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return Ok(bytes);
    }
    let packed = |e: std::io::Error| Error::input(path, "", format!("is not whole as gzip has it ({e})"));
    let unpack = || flate2::read::MultiGzDecoder::new(&bytes[..]).take(max_bytes.saturating_add(1));
    // Counted first: a vector that grows as it is read takes three times its bytes for a while.
    let length = std::io::copy(&mut unpack(), &mut std::io::sink()).map_err(packed)?;
    if length > max_bytes {
        let what = format!("unpacking {}, in bytes,", path.display());
        return Err(Error::Limit { what, needed: length, allowed: max_bytes });
    }
    let mut out = Vec::with_capacity(length as usize);
    unpack().read_to_end(&mut out).map_err(packed)?;
    Ok(out)
}

/// Read the file `path`, of at most `max_bytes`, by its extension.
///
/// # Errors
/// [`Error::Io`], [`Error::Limit`], and [`Error::Input`] with the place in the file.
pub fn read(path: &Path, max_bytes: u64, options: &TrajectoryOptions) -> Result<CurveSource> {
    let bytes = bytes_of(path, max_bytes)?;
    let extension = extension(path);
    // The memory that strands take is estimated with one point per line of text or per 12 bytes.
    let points = match extension {
        "hair" | "trk" | "tck" => bytes.len() / 12,
        // It is checked as its arrays are unpacked.
        "trx" => 0,
        _ => bytes.iter().filter(|b| **b == b'\n').count(),
    };
    let needed = (bytes.len() + points * POINT_BYTES) as u64;
    if needed > max_bytes {
        return Err(Error::Limit {
            what: format!("reading {}, in bytes,", path.display()),
            needed,
            allowed: max_bytes,
        });
    }
    let content = match extension {
        "hair" => hair::read(&bytes),
        "trk" => trk::read(&bytes),
        "trx" => trx::read(&bytes, max_bytes),
        "tck" => tck::read(&bytes),
        "swc" => swc::read(&decode(&bytes)),
        _ => csv::read(&decode(&bytes)),
    };
    let mut content = content.map_err(|(at, what)| Error::input(path, at, what))?;
    if content.strands.is_empty() {
        return Err(Error::input(path, "", format!("there is no point in it{}", content.warnings.as_reasons())));
    }
    finish(&mut content, options);
    let origin = far::offset(bounds(&content.strands));
    if origin != DVec3::ZERO {
        let points = content.strands.iter_mut().flat_map(|s| &mut s.points);
        points.for_each(|p| *p = far::subtract(*p, origin, content.decimals));
    }
    let source = CurveSource::new(content.strands, &options.curve, content.metres_per_unit, content.warnings);
    Ok(source.with_origin(origin))
}

/// The box of all points.
fn bounds(strands: &[Strand]) -> Aabb {
    Aabb::around(strands.iter().flat_map(|s| &s.points).copied().filter(|p| p.is_finite()))
}

/// Fill in widths, and take colours to linear.
fn finish(content: &mut Content, options: &TrajectoryOptions) {
    // Widths that are all 0 are none: they were never measured, and nothing would be drawn.
    if !content.strands.iter().flat_map(|s| &s.radii).any(|r| *r > 0.0) {
        content.strands.iter_mut().for_each(|s| s.radii.clear());
    }
    let missing = |s: &Strand| s.radii.is_empty() || s.radii.iter().any(|r| r.is_nan());
    let mut width = options.width.unwrap_or(0.0);
    if options.width.is_none() && content.strands.iter().any(missing) {
        let extent = bounds(&content.strands).size().max_element();
        // To one digit, as one would type it.
        let coarse = (extent / 500.0).max(1e-300);
        let digit = 10f64.powf(coarse.log10().floor());
        width = (coarse / digit).round() * digit;
        content.warnings.add(format!("the file gives no widths: {} is taken; say option `width`", short(width)));
    }
    let linear = |c: f32| if options.linear_colour { c } else { srgb_to_linear((255.0 * c + 0.5) as u8) };
    for strand in &mut content.strands {
        strand.section = options.section;
        if strand.radii.is_empty() {
            strand.radii.push(f32::NAN);
        }
        for r in &mut strand.radii {
            let radius = if r.is_nan() { 0.5 * width } else { f64::from(*r) };
            *r = (radius * options.width_scale) as f32;
        }
        for [r, g, b, _] in &mut strand.colours {
            [*r, *g, *b] = [*r, *g, *b].map(|c| linear(c.clamp(0.0, 1.0)));
        }
    }
}
