//! The pixels of DICOM's frames: as they are, in runs, or as JPEG.
//!
//! Based on: NEMA PS3.5, sections 8 (pixel data) and annexes A and G (packed transfer syntaxes, RLE).

use std::borrow::Cow;
use std::ops::Range;

use byteorder::{ByteOrder, LittleEndian};

use super::dataset::{DOUBLE_PIXEL_DATA, Element, FLOAT_PIXEL_DATA, File, PIXEL_DATA, Tag};
use crate::source::stack::coding::{Coding, Kind, rgb_of_ycbcr};

/// Table of offsets of 64 bits.
const EXTENDED_OFFSETS: Tag = 0x7fe0_0001;

/// How a file's pixels are stored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    pub rows: usize,
    pub columns: usize,
    pub channels: usize,
    /// Bits that a number takes, that it has, and the highest of these.
    allocated: usize,
    stored: usize,
    high: usize,
    signed: bool,
    planar: bool,
    /// Where the pixels are: whole numbers or floats.
    data: Tag,
    pub photometric: String,
}

/// What to do with a transfer syntax; the error is its name.
enum Packing {
    Plain,
    Runs,
    Jpeg,
}

fn packing(syntax: &str) -> Result<Packing, String> {
    let name = match syntax.strip_prefix("1.2.840.10008.1.2").unwrap_or("?") {
        "" | ".1" | ".2" => return Ok(Packing::Plain),
        ".5" => return Ok(Packing::Runs),
        ".4.50" | ".4.51" | ".4.57" | ".4.70" => return Ok(Packing::Jpeg),
        ".4.80" | ".4.81" => "JPEG-LS".to_owned(),
        ".4.90" | ".4.91" | ".4.92" | ".4.93" => "JPEG 2000".into(),
        ".4.201" | ".4.202" | ".4.203" => "High-Throughput JPEG 2000".into(),
        s if s.starts_with(".4.10") => "video".into(),
        _ => format!("transfer syntax {syntax}"),
    };
    Err(format!("DICOM with pixels packed as {name} (unpack it with another tool)"))
}

impl Layout {
    pub fn new(file: &File) -> Result<Layout, String> {
        let data = &file.data;
        let need = |tag, name: &str| {
            file.short(data, tag).map(usize::from).ok_or_else(|| format!("it does not say its {name}"))
        };
        let pixels = [PIXEL_DATA, FLOAT_PIXEL_DATA, DOUBLE_PIXEL_DATA].into_iter().find(|tag| data.0.contains_key(tag));
        let pixels = pixels.unwrap_or(PIXEL_DATA);
        let allocated = need(0x0028_0100, "bits")?;
        // Floats use all of their bits and do not say so.
        let stored = if pixels == PIXEL_DATA { need(0x0028_0101, "bits")? } else { allocated };
        let high = file.short(data, 0x0028_0102).filter(|_| pixels == PIXEL_DATA);
        let layout = Layout {
            rows: need(0x0028_0010, "rows")?,
            columns: need(0x0028_0011, "columns")?,
            channels: file.short(data, 0x0028_0002).map_or(1, usize::from),
            allocated,
            stored,
            high: high.map_or_else(|| stored.saturating_sub(1), usize::from),
            signed: file.short(data, 0x0028_0103) == Some(1),
            planar: file.short(data, 0x0028_0006) == Some(1),
            data: pixels,
            photometric: file.text(data, 0x0028_0004).unwrap_or_default(),
        };
        let bits = (1..=layout.allocated).contains(&layout.stored)
            && layout.stored - 1 <= layout.high
            && layout.high < layout.allocated;
        if layout.rows == 0 || layout.columns == 0 || !bits || ![1, 3].contains(&layout.channels) {
            return Err(format!("its pixels cannot be: {layout:?}"));
        }
        Ok(layout)
    }

    pub fn is_signed(&self) -> bool {
        self.signed
    }

    pub fn is_palette(&self) -> bool {
        self.photometric == "PALETTE COLOR" && self.channels == 1
    }

    /// Whether slices of both can be in one stack.
    pub fn is_like(&self, other: &Layout) -> bool {
        (self.columns, self.rows, self.coding(), &self.photometric)
            == (other.columns, other.rows, other.coding(), &other.photometric)
    }

    /// "512×512 MONOCHROME2 U16".
    pub fn describe(&self) -> String {
        format!("{}×{} {} {:?}", self.columns, self.rows, self.photometric, self.coding().kind)
    }

    /// What is not read, by name.
    pub fn unsupported(&self, syntax: &str) -> Option<String> {
        let jpeg = match packing(syntax) {
            Ok(packing) => matches!(packing, Packing::Jpeg),
            Err(name) => return Some(name),
        };
        let known = if self.data == PIXEL_DATA { &[8, 16, 32][..] } else { &[32, 64] };
        if !known.contains(&self.allocated) {
            return Some(format!("DICOM of {} bits per pixel", self.allocated));
        }
        let colour = match self.photometric.as_str() {
            "RGB" => true,
            "YBR_FULL" => self.allocated == 8,
            other => jpeg && other.starts_with("YBR"),
        };
        (self.channels == 3 && !colour).then(|| format!("DICOM of {} pixels", self.photometric))
    }

    /// What frames are decoded to.
    pub fn coding(&self) -> Coding {
        let kind = match (self.allocated, self.signed) {
            (32, _) if self.data == FLOAT_PIXEL_DATA => Kind::F32,
            (64, _) => Kind::F64,
            (8, false) => Kind::U8,
            (8, true) => Kind::I8,
            (16, false) => Kind::U16,
            (16, true) => Kind::I16,
            (_, false) => Kind::U32,
            (_, true) => Kind::I32,
        };
        Coding::native(kind, self.channels)
    }

    /// Bytes of a frame.
    pub fn bytes(&self) -> usize {
        self.rows * self.columns * self.coding().sample()
    }

    /// The number that 16 stored bits are.
    pub fn number(&self, bits: u16) -> f32 {
        if self.allocated != 16 {
            return if self.signed { f32::from(bits as i16) } else { f32::from(bits) };
        }
        let bits = self.clean(&bits.to_le_bytes(), false).first_chunk().map_or(bits, |b| u16::from_ne_bytes(*b));
        if self.signed { f32::from(bits as i16) } else { f32::from(bits) }
    }

    /// Frame `frame` of `frames` in this machine's bytes, channels side by side.
    pub fn frame(&self, file: &File, frame: usize, frames: usize) -> Result<Vec<u8>, String> {
        let mut raw: Cow<[u8]> = match (packing(&file.syntax)?, file.data.0.get(&self.data)) {
            (_, None) => return Err("it holds no pixels".into()),
            (Packing::Plain, Some(Element::Value(range))) => {
                let all = file.bytes.get(range.clone()).unwrap_or_default();
                let start = frame * self.bytes();
                let there = all.len();
                let part = all.get(start..start + self.bytes());
                Cow::Borrowed(
                    part.ok_or_else(|| format!("its pixels need {} bytes, {there} are there", frames * self.bytes()))?,
                )
            }
            (packing @ (Packing::Runs | Packing::Jpeg), Some(Element::Fragments(list))) => {
                let piece = |r: &Range<usize>| file.bytes.get(r.clone()).unwrap_or_default();
                let packed: Cow<[u8]> = match &fragments(file, list, frames)?[frame] {
                    [one] => Cow::Borrowed(piece(one)),
                    many => Cow::Owned(many.iter().flat_map(|r| piece(r).iter().copied()).collect()),
                };
                match packing {
                    Packing::Runs => Cow::Owned(self.runs(&packed)?),
                    _ => return self.jpeg(&packed),
                }
            }
            _ => return Err("its pixels are not packed as it says".into()),
        };
        let width = self.allocated / 8;
        // Runs come as this machine stores numbers, and channels side by side.
        let plain = matches!(raw, Cow::Borrowed(_));
        if self.planar && self.channels > 1 && plain {
            let plane = self.rows * self.columns;
            let mut mixed = Vec::with_capacity(raw.len());
            for i in 0..plane {
                for c in 0..self.channels {
                    mixed.extend_from_slice(
                        raw.get((c * plane + i) * width..(c * plane + i + 1) * width).unwrap_or_default(),
                    );
                }
            }
            raw = Cow::Owned(mixed);
        }
        let big = file.big_endian && plain;
        if self.data != PIXEL_DATA {
            let swapped = |number: &[u8]| {
                if big == cfg!(target_endian = "big") {
                    number.to_vec()
                } else {
                    number.iter().rev().copied().collect()
                }
            };
            return Ok(raw.chunks_exact(width).flat_map(swapped).collect());
        }
        let mut out = self.clean(&raw, big);
        if self.channels == 3 && self.photometric == "YBR_FULL" {
            out.as_chunks_mut().0.iter_mut().for_each(|pixel| *pixel = rgb_of_ycbcr(*pixel));
        }
        Ok(out)
    }

    /// Only the bits that are said to be the number's, the sign carried on.
    fn clean(&self, raw: &[u8], big: bool) -> Vec<u8> {
        let width = self.allocated / 8;
        let (down, up) = (self.high + 1 - self.stored, 32 - self.stored);
        let mut out = Vec::with_capacity(raw.len());
        for bytes in raw.chunks_exact(width) {
            let mut b = [0u8; 4];
            for (n, v) in bytes.iter().enumerate() {
                b[if big { width - 1 - n } else { n }] = *v;
            }
            let v = u32::from_le_bytes(b) >> down << up;
            let v = if self.signed { (v as i32 >> up) as u32 } else { v >> up };
            let all = v.to_ne_bytes();
            out.extend_from_slice(if cfg!(target_endian = "big") { &all[4 - width..] } else { &all[..width] });
        }
        out
    }

    /// DICOM's runs: a segment for every byte of a number, the highest first, channel by channel.
    fn runs(&self, packed: &[u8]) -> Result<Vec<u8>, String> {
        const BROKEN: &str = "its runs are broken";
        let word =
            |n: usize| -> Option<usize> { Some(u32::from_le_bytes(*packed.get(4 * n..)?.first_chunk()?) as usize) };
        let width = self.allocated / 8;
        let segments = self.channels * width;
        if word(0) != Some(segments) || segments > 15 {
            return Err(format!("{BROKEN}: {segments} segments are needed"));
        }
        let pixels = self.rows * self.columns;
        let sample = width * self.channels;
        let mut out = vec![0u8; pixels * sample];
        for n in 0..segments {
            let start = word(1 + n).ok_or(BROKEN)?;
            let end = if n + 1 < segments { word(2 + n).ok_or(BROKEN)? } else { packed.len() };
            let mut from = packed.get(start..end).ok_or(BROKEN)?;
            let byte = n / width * width + (width - 1 - n % width);
            let mut at = 0;
            while at < pixels {
                let [code, rest @ ..] = from else { return Err(format!("{BROKEN}: they end too early")) };
                let code = *code as i8;
                let (take, times) = if code >= 0 { (code as usize + 1, 1) } else { (1, 1 - isize::from(code)) };
                from = rest;
                if code == i8::MIN {
                    continue;
                }
                let (values, rest) =
                    from.split_at_checked(take).ok_or_else(|| format!("{BROKEN}: they end too early"))?;
                from = rest;
                for _ in 0..times {
                    for v in values {
                        if at < pixels {
                            out[at * sample + byte] = *v;
                            at += 1;
                        }
                    }
                }
            }
        }
        Ok(out)
    }

    fn jpeg(&self, packed: &[u8]) -> Result<Vec<u8>, String> {
        use jpeg_decoder::PixelFormat;
        let broken = |e: jpeg_decoder::Error| format!("its JPEG cannot be read: {e}");
        let mut decoder = jpeg_decoder::Decoder::new(packed);
        decoder.set_max_decoding_buffer_size(self.bytes());
        decoder.read_info().map_err(broken)?;
        let info = decoder.info().ok_or("its JPEG says no size")?;
        let format = match (self.channels, self.allocated) {
            (1, 8) => PixelFormat::L8,
            (1, 16) => PixelFormat::L16,
            (3, 8) => PixelFormat::RGB24,
            _ => return Err(format!("a JPEG for {} bits is not read", self.allocated)),
        };
        if (usize::from(info.width), usize::from(info.height), info.pixel_format) != (self.columns, self.rows, format) {
            return Err("its JPEG is of another size or kind than it says".into());
        }
        let pixels = decoder.decode().map_err(broken)?;
        // 16 bits come as this machine stores them.
        if self.channels == 1 { Ok(self.clean(&pixels, cfg!(target_endian = "big"))) } else { Ok(pixels) }
    }
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
