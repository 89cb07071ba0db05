//! The pixels of DICOM's frames: where each frame's bytes are, and what they are once unpacked.
//!
//! Based on: NEMA PS3.5, section 8 (pixel data) and annex A.4 (encapsulated pixels).

use std::borrow::Cow;
use std::ops::Range;

use byteorder::{ByteOrder, LittleEndian};

use super::dataset::{Element, File, PIXEL_DATA, Tag};
use super::layout::Layout;
use super::packed::Packing;
use crate::source::stack::coding::rgb_of_ycbcr;

/// Table of offsets of 64 bits.
const EXTENDED_OFFSETS: Tag = 0x7fe0_0001;

/// Transfer syntaxes that are not read, by name.
pub fn unsupported(layout: &Layout, syntax: &str) -> Option<String> {
    let packing = match Packing::of(syntax) {
        Ok(packing) => packing,
        Err(name) => return Some(name),
    };
    let known = if layout.data == PIXEL_DATA { &[8, 16, 32][..] } else { &[32, 64] };
    if !known.contains(&layout.allocated) {
        return Some(format!("DICOM of {} bits per pixel", layout.allocated));
    }
    let colour = packing.has_colours(&layout.photometric, layout.allocated);
    (layout.channels == 3 && !colour).then(|| format!("DICOM of {} pixels", layout.photometric))
}

/// Frame `frame` of `frames` in this machine's bytes, channels side by side.
pub fn frame(file: &File, layout: &Layout, frame: usize, frames: usize) -> Result<Vec<u8>, String> {
    let packing = Packing::of(&file.syntax)?;
    let bytes: Cow<[u8]> = match file.data.0.get(&layout.data) {
        None => return Err("it holds no pixels".into()),
        Some(Element::Value(range)) if packing == Packing::Plain => {
            let all = file.bytes.get(range.clone()).unwrap_or_default();
            let size = stored_bytes(layout);
            let part = all.get(frame * size..(frame + 1) * size);
            Cow::Borrowed(
                part.ok_or_else(|| format!("its pixels need {} bytes, {} are there", frames * size, all.len()))?,
            )
        }
        Some(Element::Fragments(list)) if packing != Packing::Plain => {
            let piece = |r: &Range<usize>| file.bytes.get(r.clone()).unwrap_or_default();
            match &fragments(file, list, frames)?[frame] {
                [one] => Cow::Borrowed(piece(one)),
                many => Cow::Owned(many.iter().flat_map(|r| piece(r).iter().copied()).collect()),
            }
        }
        _ => return Err("its pixels are not packed as it says".into()),
    };
    let mut out = match packing {
        Packing::Plain => plain(layout, &bytes, file.big_endian),
        Packing::Deflate => plain(layout, &packing.unpack(layout, &bytes)?, file.big_endian),
        _ => packing.unpack(layout, &bytes)?,
    };
    // A JPEG is turned into RGB by what it says itself.
    if layout.channels == 3 && layout.photometric.starts_with("YBR_FULL") && packing != Packing::Jpeg {
        out.as_chunks_mut().0.iter_mut().for_each(|pixel| *pixel = rgb_of_ycbcr(*pixel));
    }
    Ok(out)
}

/// Whether two pixels of a row share their chroma, lying as luma, luma, blue, red.
fn is_halved(layout: &Layout) -> bool {
    layout.channels == 3 && layout.photometric == "YBR_FULL_422"
}

/// Bytes of a frame that is not packed.
fn stored_bytes(layout: &Layout) -> usize {
    if is_halved(layout) { layout.bytes() / 3 * 2 } else { layout.bytes() }
}

/// The numbers of pixels that are not packed.
fn plain(layout: &Layout, raw: &[u8], big: bool) -> Vec<u8> {
    let width = layout.allocated / 8;
    let mut raw = Cow::Borrowed(raw);
    if is_halved(layout) {
        let pixels = raw.as_chunks::<4>().0.iter().flat_map(|&[a, b, blue, red]| [a, blue, red, b, blue, red]);
        raw = Cow::Owned(pixels.collect());
    } else if layout.planar && layout.channels > 1 {
        let plane = layout.rows * layout.columns;
        let mut mixed = Vec::with_capacity(raw.len());
        for i in 0..plane {
            for c in 0..layout.channels {
                let number = raw.get((c * plane + i) * width..(c * plane + i + 1) * width);
                mixed.extend_from_slice(number.unwrap_or_default());
            }
        }
        raw = Cow::Owned(mixed);
    }
    if layout.data == PIXEL_DATA {
        return layout.clean(&raw, big);
    }
    let swapped = |number: &[u8]| {
        if big == cfg!(target_endian = "big") { number.to_vec() } else { number.iter().rev().copied().collect() }
    };
    raw.chunks_exact(width).flat_map(swapped).collect()
}

/// The pieces of each frame: as many as frames, or by the table of offsets, or by where a JPEG begins.
fn fragments<'a>(file: &File, list: &'a [Range<usize>], frames: usize) -> Result<Vec<&'a [Range<usize>]>, String> {
    let (table, pieces) = list.split_first().ok_or("its packed pixels hold nothing")?;
    if frames == 1 {
        return Ok(vec![pieces]);
    }
    if frames == pieces.len() {
        return Ok(pieces.chunks(1).collect());
    }
    // Offsets count from the head of the first piece, which is eight bytes long.
    let offset = |r: &Range<usize>| r.start - pieces[0].start;
    let table = file.bytes.get(table.clone()).unwrap_or_default();
    let offsets: Vec<usize> = match file.value(&file.data, EXTENDED_OFFSETS) {
        Some(wide) => wide.chunks_exact(8).map(|b| LittleEndian::read_u64(b) as usize).collect(),
        None => table.chunks_exact(4).map(|b| LittleEndian::read_u32(b) as usize).collect(),
    };
    let begins = |r: &Range<usize>| match offsets.len() {
        0 => file.bytes.get(r.clone()).is_some_and(|b| b.starts_with(&[0xff, 0xd8])),
        _ => offsets.contains(&offset(r)),
    };
    let starts: Vec<usize> = (0..pieces.len()).filter(|&n| begins(&pieces[n])).collect();
    if starts.len() != frames || starts[0] != 0 {
        return Err(format!("{frames} frames are in {} pieces, and it does not say which are whose", pieces.len()));
    }
    let end = |n: usize| starts.get(n + 1).copied().unwrap_or(pieces.len());
    Ok((0..frames).map(|n| &pieces[starts[n]..end(n)]).collect())
}
