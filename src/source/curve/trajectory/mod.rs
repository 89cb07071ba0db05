//! Files of trajectories, hair, tracts and neurons → strands.

mod csv;
mod hair;
mod swc;
mod tck;
#[cfg(test)]
mod tests;
mod trk;

use std::path::Path;

use super::{CurveOptions, CurveSource, Section, Strand};
use crate::geom::{Aabb, DVec3};
use crate::scene::files;
use crate::scene::texture::srgb_to_linear;
use crate::{Error, Result, Warnings};

/// Extensions that are read here.
pub const KNOWN: [&str; 6] = ["csv", "tsv", "hair", "trk", "tck", "swc"];

/// What a point takes of memory while it is read and as a part of a source.
const POINT_BYTES: usize = 96;

/// How trajectories, and the lines and points of meshes, are taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectoryOptions {
    pub section: Section,
    pub curve: CurveOptions,
    /// Width, in source units, of what the file gives none; by default a 500th of a trajectories' extent, with a warning,
    /// and a mesh's lines and points are left out.
    pub width: Option<f64>,
    /// Factor of all widths.
    pub width_scale: f64,
    /// Whether colours are linear; else they are sRGB.
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

/// What a file holds. A radius that is missing is NaN.
#[derive(Debug, Default)]
struct Content {
    strands: Vec<Strand>,
    /// Metres in a unit; 0 where the format does not say.
    metres_per_unit: f64,
    warnings: Warnings,
}

/// Read the file `path`, of at most `max_bytes`, by its extension.
///
/// # Errors
/// [`Error::Io`], [`Error::Limit`], and [`Error::Input`] with the place in the file.
pub fn read(path: &Path, max_bytes: u64, options: &TrajectoryOptions) -> Result<CurveSource> {
    let bytes = files::read(path, max_bytes)?;
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    // What strands take of memory: a point a line of text, or of 12 bytes.
    let points = match extension.as_str() {
        "hair" | "trk" | "tck" => bytes.len() / 12,
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
    let content = match extension.as_str() {
        "hair" => hair::read(&bytes),
        "trk" => trk::read(&bytes),
        "tck" => tck::read(&bytes),
        "swc" => swc::read(&String::from_utf8_lossy(&bytes)),
        _ => csv::read(&String::from_utf8_lossy(&bytes)),
    };
    let mut content = content.map_err(|(at, what)| Error::input(path, at, what))?;
    if content.strands.is_empty() {
        return Err(Error::input(path, "", format!("there is no point in it{}", content.warnings.as_reasons())));
    }
    finish(&mut content, options);
    Ok(CurveSource::new(content.strands, &options.curve, content.metres_per_unit, content.warnings))
}

/// Fill in widths, and take colours to linear.
fn finish(content: &mut Content, options: &TrajectoryOptions) {
    let missing = |s: &Strand| s.radii.is_empty() || s.radii.iter().any(|r| r.is_nan());
    let mut width = options.width.unwrap_or(0.0);
    if options.width.is_none() && content.strands.iter().any(missing) {
        let points = content.strands.iter().flat_map(|s| &s.points).copied().filter(|p| p.is_finite());
        let extent = Aabb::around(points).size().max_element();
        // To one digit, as one would type it.
        let coarse = (extent / 500.0).max(1e-300);
        let digit = 10f64.powf(coarse.log10().floor());
        width = (coarse / digit).round() * digit;
        content.warnings.add(format!("the file gives no widths: {width} is taken; say --width"));
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

/// Where in a file, and what is wrong there.
type Fault = (String, String);

fn at_byte(offset: usize, what: impl Into<String>) -> Fault {
    (format!("byte {offset}"), what.into())
}

/// Reads numbers one after the other, in either order of bytes.
struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    big_endian: bool,
}

impl<'a> Cursor<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        let end = self.at.checked_add(count).filter(|&e| e <= self.bytes.len());
        let Some(end) = end else {
            let left = self.bytes.len().saturating_sub(self.at);
            return Err(at_byte(
                self.at,
                format!("the file ends too early: {count} more bytes were announced, {left} are left"),
            ));
        };
        let taken = &self.bytes[self.at..end];
        self.at = end;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        if self.big_endian {
            out.reverse();
        }
        Ok(out)
    }

    fn u16(&mut self) -> Result<u16, Fault> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Result<u32, Fault> {
        self.array().map(u32::from_le_bytes)
    }

    fn f32(&mut self) -> Result<f32, Fault> {
        self.array().map(f32::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64, Fault> {
        self.array().map(f64::from_le_bytes)
    }

    /// `count` numbers; the room for them is checked first.
    fn floats(&mut self, count: usize) -> Result<Vec<f32>, Fault> {
        let bytes = self.take(count.saturating_mul(4))?;
        let one = |b: &[u8; 4]| if self.big_endian { f32::from_be_bytes(*b) } else { f32::from_le_bytes(*b) };
        Ok(bytes.as_chunks::<4>().0.iter().map(one).collect())
    }

    fn left(&self) -> usize {
        self.bytes.len() - self.at
    }
}

fn point(p: [f32; 3]) -> DVec3 {
    DVec3::from(p.map(f64::from))
}
