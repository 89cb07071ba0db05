//! Cem Yuksel's hair files (`.hair`).

use super::{Content, Cursor, Fault, at_byte, point};
use crate::source::curve::Strand;

/// Which arrays follow the header, in this order.
const SEGMENTS: u32 = 1;
const POINTS: u32 = 2;
const THICKNESS: u32 = 4;
const TRANSPARENCY: u32 = 8;
const COLOURS: u32 = 16;
const HEADER: usize = 128;

/// Thickness is the width; transparency is the share that is not there.
pub fn read(bytes: &[u8]) -> Result<Content, Fault> {
    let mut file = Cursor::new(bytes);
    let header = Header::read(&mut file)?;
    let segments = header.segments(&mut file)?;
    let arrays = Arrays::read(&header, &mut file)?;
    let mut content = Content::default();
    if file.left() > 0 {
        content.warnings.add("bytes after the last array are ignored");
    }
    let mut first = 0;
    for count in segments {
        let range = first..first + count + 1;
        first = range.end;
        content.strands.push(arrays.strand(&header, range));
    }
    Ok(content)
}

struct Header {
    strands: usize,
    points: usize,
    flags: u32,
    /// Values of every strand and point where no array gives them.
    segments: u32,
    thickness: f32,
    transparency: f32,
    colour: [f32; 3],
}

impl Header {
    fn read(file: &mut Cursor) -> Result<Header, Fault> {
        if file.take(4).ok() != Some(b"HAIR") {
            return Err(at_byte(0, "a hair file begins with HAIR"));
        }
        let [strands, points, flags, segments] = [file.u32()?, file.u32()?, file.u32()?, file.u32()?];
        let [thickness, transparency] = [file.f32()?, file.f32()?];
        let colour = [file.f32()?, file.f32()?, file.f32()?];
        file.take(HEADER - file.at)?;
        if flags & POINTS == 0 {
            return Err(at_byte(12, "the file has no array of points"));
        }
        let (strands, points) = (strands as usize, points as usize);
        // Before anything is taken by number: a strand has a point, and a point 12 bytes.
        if strands > points || points > file.left() / 12 {
            let what =
                format!("the header counts {strands} strands of {points} points: the file ends too early for them");
            return Err(at_byte(4, what));
        }
        Ok(Header { strands, points, flags, segments, thickness, transparency, colour })
    }

    /// Number of segments of each strand.
    fn segments(&self, file: &mut Cursor) -> Result<Vec<usize>, Fault> {
        let Header { strands, points, segments: default, .. } = *self;
        let segments: Vec<usize> = if self.flags & SEGMENTS != 0 {
            file.u16s(strands)?.into_iter().map(usize::from).collect()
        } else {
            if strands.saturating_mul(default as usize + 1) != points {
                let what = format!("{strands} strands of {default} segments are not {points} points");
                return Err(at_byte(16, what));
            }
            vec![default as usize; strands]
        };
        let sum = segments.iter().map(|s| s + 1).sum::<usize>();
        if sum != points {
            return Err(at_byte(HEADER, format!("the strands have {sum} points, the header says {points}")));
        }
        Ok(segments)
    }
}

/// Values of all points, strand after strand.
struct Arrays {
    places: Vec<f32>,
    widths: Option<Vec<f32>>,
    transparencies: Option<Vec<f32>>,
    colours: Option<Vec<f32>>,
}

impl Arrays {
    fn read(header: &Header, file: &mut Cursor) -> Result<Arrays, Fault> {
        let mut array = |each: usize| file.f32s(header.points.saturating_mul(each));
        let places = array(3)?;
        let mut optional = |flag: u32, each: usize| {
            if header.flags & flag == 0 { Ok(None) } else { array(each).map(Some) }
        };
        Ok(Arrays {
            places,
            widths: optional(THICKNESS, 1)?,
            transparencies: optional(TRANSPARENCY, 1)?,
            colours: optional(COLOURS, 3)?,
        })
    }

    /// The strand of these points.
    fn strand(&self, header: &Header, range: std::ops::Range<usize>) -> Strand {
        // A width of 0 for all stands for none.
        let default_radius = if header.thickness > 0.0 { 0.5 * header.thickness } else { f32::NAN };
        let colour_of = |i: usize| {
            let [r, g, b] = self.colours.as_ref().map_or(header.colour, |c| [c[3 * i], c[3 * i + 1], c[3 * i + 2]]);
            [r, g, b, 1.0 - self.transparencies.as_ref().map_or(header.transparency, |t| t[i])]
        };
        let is_coloured = self.colours.is_some() || self.transparencies.is_some();
        let coloured = if is_coloured { range.clone() } else { range.start..range.start + 1 };
        Strand {
            points: self.places[3 * range.start..3 * range.end].as_chunks::<3>().0.iter().map(|p| point(*p)).collect(),
            radii: self.widths.as_ref().map_or(vec![default_radius], |w| w[range].iter().map(|w| 0.5 * w).collect()),
            colours: coloured.map(colour_of).collect(),
            ..Strand::default()
        }
    }
}
