//! Tractograms in the TRX format (`.trx`): a zip archive of a header and plain little-endian arrays, in millimetres right,
//! anterior, superior.
//!
//! Based on: F. Rheault et al., *TRX: A Community-Oriented Tractography File Format*, 2022.

use std::borrow::Cow;
use std::io::Read;

use byteorder::{ByteOrder, LE};

use super::Content;
use super::cursor::Fault;
use crate::geom::DVec3;
use crate::source::curve::Strand;

/// Fields of the header that are used; it has more.
#[derive(serde::Deserialize)]
#[serde(rename_all = "UPPERCASE")]
struct Header {
    nb_vertices: u64,
    nb_streamlines: u64,
}

/// The archive, and how much of it may still be unpacked.
struct Archive<'a> {
    zip: zip::ZipArchive<std::io::Cursor<&'a [u8]>>,
    names: Vec<String>,
    left: u64,
    max_bytes: u64,
}

impl<'a> Archive<'a> {
    fn new(bytes: &'a [u8], max_bytes: u64) -> Result<Archive<'a>, Fault> {
        let zip = zip::ZipArchive::new(std::io::Cursor::new(bytes));
        let zip = zip.map_err(|e| (String::new(), format!("is not a zip archive, as a .trx file is ({e})")))?;
        let names = zip.file_names().filter_map(|name| name.ok().map(Cow::into_owned)).collect();
        Ok(Archive { zip, names, left: max_bytes, max_bytes })
    }

    fn unpack(&mut self, name: &str) -> Result<Vec<u8>, Fault> {
        let at = |what: String| (name.to_owned(), what);
        let file = self.zip.by_name(name).map_err(|e| at(e.to_string()))?;
        let mut out = Vec::new();
        file.take(self.left.saturating_add(1)).read_to_end(&mut out).map_err(|e| at(e.to_string()))?;
        self.left = self.left.checked_sub(out.len() as u64).ok_or_else(|| {
            at(format!("unpacking the archive takes more than {} bytes; raise option `memory`", self.max_bytes))
        })?;
        Ok(out)
    }

    fn header(&mut self) -> Result<Header, Fault> {
        serde_json::from_slice(&self.unpack("header.json")?)
            .map_err(|e| ("header.json".to_owned(), e.to_string().replace('\n', " ")))
    }

    /// The first array with such a name.
    fn array(&mut self, wanted: impl Fn(&str) -> bool) -> Result<Option<Array>, Fault> {
        let Some(name) = self.names.iter().find(|name| wanted(name)).cloned() else { return Ok(None) };
        let mut words = name.rsplit('.');
        let kind = words.next().unwrap_or_default().to_owned();
        let columns = words.next().and_then(|word| word.parse().ok()).unwrap_or(1);
        Ok(Some(Array { kind, columns, bytes: self.unpack(&name)? }))
    }

    /// The array whose name begins with that of `example`.
    fn required(&mut self, example: &str) -> Result<Array, Fault> {
        let begin = example.split_inclusive('.').next().unwrap_or_default();
        let missing = || (String::new(), format!("the archive has no {example}"));
        self.array(|name| name.starts_with(begin))?.ok_or_else(missing)
    }
}

/// An array: what it holds is told by its name, as in `positions.3.float16`.
struct Array {
    kind: String,
    columns: usize,
    bytes: Vec<u8>,
}

/// Colours of points are those of `dpv/` arrays of three columns that are named as such. At most `max_bytes` are unpacked.
pub fn read(bytes: &[u8], max_bytes: u64) -> Result<Content, Fault> {
    let mut archive = Archive::new(bytes, max_bytes)?;
    let header = archive.header()?;
    let positions = archive.required("positions.3.float32")?;
    let offsets = archive.required("offsets.uint64")?;
    let is_colour = |name: &str| {
        let own = name.strip_prefix("dpv/").map(str::to_ascii_lowercase);
        own.is_some_and(|own| (own.contains("color") || own.contains("rgb")) && own.split('.').nth(1) == Some("3"))
    };
    let colours = archive.array(is_colour)?;
    let points = header.points(&positions)?;
    let starts = header.starts(&offsets, points.len())?;
    let colours = colours.map(|c| Ok::<_, Fault>((c.values("colours")?, c.kind.starts_with("uint")))).transpose()?;
    let colour = |i: usize| {
        let (values, is_byte) = colours.as_ref()?;
        let [r, g, b] = *values.as_chunks::<3>().0.get(i)?;
        let scale = if *is_byte { 1.0 / 255.0 } else { 1.0 };
        Some([(r * scale) as f32, (g * scale) as f32, (b * scale) as f32, 1.0])
    };
    let mut content = Content { metres_per_unit: 1e-3, ..Content::default() };
    for ends in starts.windows(2) {
        let range = ends[0] as usize..ends[1] as usize;
        let strand = Strand {
            points: points.get(range.clone()).unwrap_or_default().to_vec(),
            colours: range.filter_map(colour).collect(),
            ..Strand::default()
        };
        if !strand.points.is_empty() {
            content.strands.push(strand);
        }
    }
    Ok(content)
}

impl Header {
    fn points(&self, positions: &Array) -> Result<Vec<DVec3>, Fault> {
        if positions.columns != 3 {
            return Err(("positions".into(), format!("has {} columns and should have 3", positions.columns)));
        }
        let values = positions.values("positions")?;
        let points: Vec<DVec3> = values.as_chunks::<3>().0.iter().map(|p| DVec3::from(*p)).collect();
        if !values.len().is_multiple_of(3) || points.len() as u64 != self.nb_vertices {
            let what = format!("has {} numbers, the header counts {} points", values.len(), self.nb_vertices);
            return Err(("positions".into(), what));
        }
        Ok(points)
    }

    /// The first of the points of each tract, and their number as the end of the last.
    fn starts(&self, offsets: &Array, points: usize) -> Result<Vec<f64>, Fault> {
        let tracts = self.nb_streamlines;
        let mut starts = offsets.values("offsets")?;
        // Some writers end the list with the number of points.
        if starts.len() as u64 == tracts {
            starts.push(points as f64);
        }
        let ascending = starts.windows(2).all(|w| w[0] <= w[1]) && starts.last() == Some(&(points as f64));
        if starts.len() as u64 != tracts.saturating_add(1) || !ascending {
            let what = format!("does not part {points} points into the {tracts} tracts of the header");
            return Err(("offsets".into(), what));
        }
        Ok(starts)
    }
}

impl Array {
    /// All numbers; whole ones up to 2^53 are exact.
    fn values(&self, name: &str) -> Result<Vec<f64>, Fault> {
        fn list<const N: usize>(bytes: &[u8], one: impl Fn(&[u8]) -> f64) -> Vec<f64> {
            bytes.as_chunks::<N>().0.iter().map(|b| one(b)).collect()
        }
        let (bytes, width) = (&self.bytes[..], self.kind.trim_start_matches(|c: char| !c.is_ascii_digit()));
        let width = width.parse::<usize>().unwrap_or(8) / 8;
        if width == 0 || !bytes.len().is_multiple_of(width) {
            return Err((name.into(), format!("ends within a number of the type {}", self.kind)));
        }
        Ok(match self.kind.as_str() {
            "float16" => list::<2>(bytes, |b| half::f16::from_bits(LE::read_u16(b)).to_f64()),
            "float32" => list::<4>(bytes, |b| LE::read_f32(b).into()),
            "float64" => list::<8>(bytes, LE::read_f64),
            "uint8" => list::<1>(bytes, |b| f64::from(b[0])),
            "uint16" => list::<2>(bytes, |b| LE::read_u16(b).into()),
            "uint32" => list::<4>(bytes, |b| LE::read_u32(b).into()),
            "uint64" => list::<8>(bytes, |b| LE::read_u64(b) as f64),
            "int32" => list::<4>(bytes, |b| LE::read_i32(b).into()),
            "int64" => list::<8>(bytes, |b| LE::read_i64(b) as f64),
            other => return Err((name.into(), format!("numbers of the type {other} are not read"))),
        })
    }
}
