//! MRtrix tracts (`.tck`), in millimetres right, anterior, superior.

use super::{Content, Cursor, Fault, at_byte};
use crate::geom::DVec3;
use crate::scene::text::utf8;
use crate::source::curve::Strand;

/// Most bytes of a header.
const HEADER: usize = 1 << 20;

pub fn read(bytes: &[u8]) -> Result<Content, Fault> {
    let header = Header::parse(bytes)?;
    if header.start > bytes.len() {
        let what = format!("the file ends before its data, which begin at byte {}", header.start);
        return Err(at_byte(bytes.len(), what));
    }
    let mut file = Cursor::new(bytes);
    (file.at, file.big_endian) = (header.start, header.format.big_endian);
    let mut content = Content { metres_per_unit: 1e-3, ..Content::default() };
    let mut strand = Strand::default();
    let size = header.format.point_bytes();
    let mut closed = false;
    while file.left() >= size {
        let p = header.format.point(&mut file)?;
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

struct Header {
    /// Byte at which the points begin.
    start: usize,
    format: Format,
}

impl Header {
    fn parse(bytes: &[u8]) -> Result<Header, Fault> {
        // A byte-order mark counts among the bytes before the data.
        if !utf8(&bytes[..bytes.len().min(64)]).starts_with(b"mrtrix tracks") {
            return Err(("line 1".into(), "a tract file begins with `mrtrix tracks`".into()));
        }
        let (mut start, mut format, mut number) = (None, None, 0);
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
            match line.split_once(':').map(|(key, value)| (key.trim(), value.trim())) {
                Some(("file", value)) => {
                    let offset = value.strip_prefix('.').and_then(|v| v.trim().parse::<usize>().ok());
                    let only = || format!("`file: {value}`: only data in this file are read, as `file: . OFFSET`");
                    start = Some(offset.ok_or_else(|| fault(only()))?);
                }
                Some(("datatype", value)) => format = Some(Format::named(value).map_err(fault)?),
                _ => {}
            }
        }
        let fault = |what: &str| (format!("line {number}"), what.into());
        match (start, format) {
            _ if !ended => Err(fault("the header has no line END")),
            (Some(start), Some(format)) => Ok(Header { start, format }),
            _ => Err(fault("the header says no `file:` or no `datatype:`")),
        }
    }
}

/// How a coordinate is stored.
struct Format {
    double: bool,
    big_endian: bool,
}

impl Format {
    fn named(name: &str) -> Result<Format, String> {
        let (double, big_endian) = match name {
            "Float32LE" => (false, false),
            "Float32BE" => (false, true),
            "Float64LE" => (true, false),
            "Float64BE" => (true, true),
            _ => return Err(format!("datatype {name}: Float32LE, Float32BE, Float64LE and Float64BE are read")),
        };
        Ok(Format { double, big_endian })
    }

    fn point_bytes(&self) -> usize {
        if self.double { 24 } else { 12 }
    }

    fn point(&self, file: &mut Cursor) -> Result<DVec3, Fault> {
        let mut value = || if self.double { file.f64() } else { file.f32().map(f64::from) };
        Ok(DVec3::new(value()?, value()?, value()?))
    }
}
