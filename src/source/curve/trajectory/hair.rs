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
    if file.take(4).ok() != Some(b"HAIR") {
        return Err(at_byte(0, "a hair file begins with HAIR"));
    }
    let [strands, points, flags, default_segments] = [file.u32()?, file.u32()?, file.u32()?, file.u32()?];
    let [thickness, transparency] = [file.f32()?, file.f32()?];
    let colour = [file.f32()?, file.f32()?, file.f32()?];
    file.take(HEADER - file.at)?;
    if flags & POINTS == 0 {
        return Err(at_byte(12, "the file has no array of points"));
    }
    let (strands, points) = (strands as usize, points as usize);
    // Before anything is taken by number: a strand has a point, and a point 12 bytes.
    if strands > points || points > file.left() / 12 {
        let what = format!("the header counts {strands} strands of {points} points: the file ends too early for them");
        return Err(at_byte(4, what));
    }
    let segments: Vec<usize> = if flags & SEGMENTS != 0 {
        file.u16s(strands)?.into_iter().map(usize::from).collect()
    } else {
        if strands.saturating_mul(default_segments as usize + 1) != points {
            let what = format!("{strands} strands of {default_segments} segments are not {points} points");
            return Err(at_byte(16, what));
        }
        vec![default_segments as usize; strands]
    };
    let sum = segments.iter().map(|s| s + 1).sum::<usize>();
    if sum != points {
        return Err(at_byte(HEADER, format!("the strands have {sum} points, the header says {points}")));
    }
    let places = file.f32s(points.saturating_mul(3))?;
    let mut optional = |flag: u32, each: usize| {
        if flags & flag == 0 { Ok(None) } else { file.f32s(points.saturating_mul(each)).map(Some) }
    };
    let widths = optional(THICKNESS, 1)?;
    let clear = optional(TRANSPARENCY, 1)?;
    let colours = optional(COLOURS, 3)?;
    let mut content = Content::default();
    if file.left() > 0 {
        content.warnings.add("bytes after the last array are ignored");
    }
    // A width of 0 for all stands for none.
    let default_radius = if thickness > 0.0 { 0.5 * thickness } else { f32::NAN };
    let mut first = 0;
    for count in segments {
        let range = first..first + count + 1;
        first = range.end;
        let colour_of = |i: usize| {
            let [r, g, b] = colours.as_ref().map_or(colour, |c| [c[3 * i], c[3 * i + 1], c[3 * i + 2]]);
            [r, g, b, 1.0 - clear.as_ref().map_or(transparency, |t| t[i])]
        };
        let coloured = if colours.is_some() || clear.is_some() { range.clone() } else { range.start..range.start + 1 };
        content.strands.push(Strand {
            points: places[3 * range.start..3 * range.end].as_chunks::<3>().0.iter().map(|p| point(*p)).collect(),
            radii: widths.as_ref().map_or(vec![default_radius], |w| w[range].iter().map(|w| 0.5 * w).collect()),
            colours: coloured.map(colour_of).collect(),
            ..Strand::default()
        });
    }
    Ok(content)
}
