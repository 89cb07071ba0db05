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

/// An array: what it holds is told by its name, as in `positions.3.float16`.
struct Array {
    kind: String,
    columns: usize,
    bytes: Vec<u8>,
}

/// Colours of points are those of `dpv/` arrays of three columns that are named as such. At most `max_bytes` are unpacked.
pub fn read(bytes: &[u8], max_bytes: u64) -> Result<Content, Fault> {
    let broken = |what: String| (String::new(), what);
    let archive = zip::ZipArchive::new(std::io::Cursor::new(bytes));
    let mut archive = archive.map_err(|e| broken(format!("is not a zip archive, as a .trx file is ({e})")))?;
    let names: Vec<String> = archive.file_names().filter_map(|name| name.ok().map(Cow::into_owned)).collect();
    let mut left = max_bytes;
    let mut unpack = |name: &str| -> Result<Vec<u8>, Fault> {
        let at = |what: String| (name.to_owned(), what);
        let file = archive.by_name(name).map_err(|e| at(e.to_string()))?;
        let mut out = Vec::new();
        file.take(left.saturating_add(1)).read_to_end(&mut out).map_err(|e| at(e.to_string()))?;
        left = left.checked_sub(out.len() as u64).ok_or_else(|| {
            at(format!("unpacking the archive takes more than {max_bytes} bytes; raise option `memory`"))
        })?;
        Ok(out)
    };
    let header: Header = serde_json::from_slice(&unpack("header.json")?)
        .map_err(|e| ("header.json".to_owned(), e.to_string().replace('\n', " ")))?;
    let mut array = |wanted: &dyn Fn(&str) -> bool| -> Result<Option<Array>, Fault> {
        let Some(name) = names.iter().find(|name| wanted(name)) else { return Ok(None) };
        let mut words = name.rsplit('.');
        let kind = words.next().unwrap_or_default().to_owned();
        let columns = words.next().and_then(|word| word.parse().ok()).unwrap_or(1);
        Ok(Some(Array { kind, columns, bytes: unpack(name)? }))
    };
    let missing = |name: &str| (String::new(), format!("the archive has no {name}"));
    let positions = array(&|name| name.starts_with("positions."))?.ok_or_else(|| missing("positions.3.float32"))?;
    let offsets = array(&|name| name.starts_with("offsets."))?.ok_or_else(|| missing("offsets.uint64"))?;
    let is_colour = |name: &str| {
        let own = name.strip_prefix("dpv/").map(str::to_ascii_lowercase);
        own.is_some_and(|own| (own.contains("color") || own.contains("rgb")) && own.split('.').nth(1) == Some("3"))
    };
    let colours = array(&is_colour)?;
    if positions.columns != 3 {
        return Err(("positions".into(), format!("has {} columns and should have 3", positions.columns)));
    }
    let values = positions.values("positions")?;
    let points: Vec<DVec3> = values.as_chunks::<3>().0.iter().map(|p| DVec3::from(*p)).collect();
    if !values.len().is_multiple_of(3) || points.len() as u64 != header.nb_vertices {
        let what = format!("has {} numbers, the header counts {} points", values.len(), header.nb_vertices);
        return Err(("positions".into(), what));
    }
    let mut starts = offsets.values("offsets")?;
    // Some writers end the list with the number of points.
    if starts.len() as u64 == header.nb_streamlines {
        starts.push(points.len() as f64);
    }
    let ascending = starts.windows(2).all(|w| w[0] <= w[1]) && starts.last() == Some(&(points.len() as f64));
    if starts.len() as u64 != header.nb_streamlines.saturating_add(1) || !ascending {
        let what =
            format!("does not part {} points into the {} tracts of the header", points.len(), header.nb_streamlines);
        return Err(("offsets".into(), what));
    }
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
