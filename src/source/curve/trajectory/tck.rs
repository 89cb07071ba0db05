//! MRtrix tracts (`.tck`), in millimetres right, anterior, superior.

use super::{Content, Cursor, Fault, at_byte};
use crate::geom::DVec3;
use crate::scene::text::utf8;
use crate::source::curve::Strand;

/// Most bytes of a header.
const HEADER: usize = 1 << 20;

pub fn read(bytes: &[u8]) -> Result<Content, Fault> {
    // A byte-order mark counts among the bytes before the data.
    if !utf8(&bytes[..bytes.len().min(64)]).starts_with(b"mrtrix tracks") {
        return Err(("line 1".into(), "a tract file begins with `mrtrix tracks`".into()));
    }
    let (mut start, mut kind, mut number) = (None, None, 0);
    let mut ended = false;
    for line in bytes[..bytes.len().min(HEADER)].split(|b| *b == b'\n') {
        number += 1;
        let line = String::from_utf8_lossy(line);
        let line = line.trim();
        if line == "END" {
            ended = true;
            break;
        }
        let fault = |what: String| (format!("line {number}"), what);
        let Some((key, value)) = line.split_once(':') else { continue };
        match (key.trim(), value.trim()) {
            ("file", value) => {
                let offset = value.strip_prefix('.').and_then(|v| v.trim().parse::<usize>().ok());
                let only = || fault(format!("`file: {value}`: only data in this file are read, as `file: . OFFSET`"));
                start = Some(offset.ok_or_else(only)?);
            }
            ("datatype", value) => {
                kind = Some(match value {
                    "Float32LE" => (false, false),
                    "Float32BE" => (false, true),
                    "Float64LE" => (true, false),
                    "Float64BE" => (true, true),
                    other => {
                        return Err(fault(format!(
                            "datatype {other}: Float32LE, Float32BE, Float64LE and Float64BE are read"
                        )));
                    }
                });
            }
            _ => {}
        }
    }
    if !ended {
        return Err((format!("line {number}"), "the header has no line END".into()));
    }
    let (Some(at), Some((double, big_endian))) = (start, kind) else {
        return Err((format!("line {number}"), "the header says no `file:` or no `datatype:`".into()));
    };
    if at > bytes.len() {
        return Err(at_byte(bytes.len(), format!("the file ends before its data, which begin at byte {at}")));
    }
    let mut file = Cursor::new(bytes);
    (file.at, file.big_endian) = (at, big_endian);
    let mut content = Content { metres_per_unit: 1e-3, ..Content::default() };
    let mut strand = Strand::default();
    let size = if double { 24 } else { 12 };
    let mut closed = false;
    while file.left() >= size {
        let mut value = || if double { file.f64() } else { file.f32().map(f64::from) };
        let p = DVec3::new(value()?, value()?, value()?);
        if p.is_finite() {
            strand.points.push(p);
            continue;
        }
        // NaN ends a tract, infinity the file.
        if !strand.points.is_empty() {
            content.strands.push(std::mem::take(&mut strand));
        }
        if !p.is_nan() {
            closed = true;
            break;
        }
    }
    if !closed {
        if !file.left().is_multiple_of(size) {
            return Err(at_byte(file.at, "the file ends within a point"));
        }
        content.warnings.add("the file ends without its mark");
    }
    if !strand.points.is_empty() {
        content.strands.push(strand);
    }
    Ok(content)
}
