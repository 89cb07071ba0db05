//! The pixels of DICOM's frames: as they are, in runs, or as JPEG.
//!
//! Based on: NEMA PS3.5, sections 8 (pixel data) and annexes A and G (packed transfer syntaxes, RLE).

use std::borrow::Cow;

use super::dataset::{Element, File, PIXEL_DATA};
use crate::source::stack::samples::{Coding, Kind};

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
        let need =
            |tag, name: &str| file.short(tag).map(usize::from).ok_or_else(|| format!("it does not say its {name}"));
        let data = &file.data;
        let layout = Layout {
            rows: need(0x0028_0010, "rows")?,
            columns: need(0x0028_0011, "columns")?,
            channels: file.short(0x0028_0002).map_or(1, usize::from),
            allocated: need(0x0028_0100, "bits")?,
            stored: need(0x0028_0101, "bits")?,
            high: file.short(0x0028_0102).map_or(usize::MAX, usize::from),
            signed: file.short(0x0028_0103) == Some(1),
            planar: file.short(0x0028_0006) == Some(1),
            photometric: file.text(data, 0x0028_0004).unwrap_or_default(),
        };
        let high = if layout.high == usize::MAX { layout.stored.saturating_sub(1) } else { layout.high };
        let layout = Layout { high, ..layout };
        let bits =
            (1..=layout.allocated).contains(&layout.stored) && layout.stored - 1 <= high && high < layout.allocated;
        if layout.rows == 0 || layout.columns == 0 || !bits || ![1, 3].contains(&layout.channels) {
            return Err(format!("its pixels cannot be: {layout:?}"));
        }
        Ok(layout)
    }

    /// What is not read, by name.
    pub fn unsupported(&self, syntax: &str) -> Option<String> {
        let jpeg = match packing(syntax) {
            Ok(packing) => matches!(packing, Packing::Jpeg),
            Err(name) => return Some(name),
        };
        if ![8, 16, 32].contains(&self.allocated) {
            return Some(format!("DICOM of {} bits a pixel", self.allocated));
        }
        let colour = self.photometric == "RGB" || jpeg && self.photometric.starts_with("YBR");
        (self.channels == 3 && !colour).then(|| format!("DICOM of {} pixels", self.photometric))
    }

    /// What frames are decoded to.
    pub fn coding(&self) -> Coding {
        let kind = match (self.allocated, self.signed) {
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

    /// Frame `frame` of `frames` in this machine's bytes, channels side by side.
    pub fn frame(&self, file: &File, frame: usize, frames: usize) -> Result<Vec<u8>, String> {
        let width = self.allocated / 8;
        let mut raw: Cow<[u8]> = match (packing(&file.syntax)?, file.data.0.get(&PIXEL_DATA)) {
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
                let piece = |r: &std::ops::Range<usize>| file.bytes.get(r.clone()).unwrap_or_default();
                let pieces = list.get(1..).unwrap_or_default();
                let packed: Cow<[u8]> = match (frames, pieces) {
                    (1, [one]) => Cow::Borrowed(piece(one)),
                    (1, many) => Cow::Owned(many.iter().flat_map(|r| piece(r).iter().copied()).collect()),
                    (n, many) if n == many.len() => Cow::Borrowed(piece(&many[frame])),
                    _ => return Err(format!("{frames} frames are in {} pieces", pieces.len())),
                };
                match packing {
                    Packing::Runs => Cow::Owned(self.runs(&packed)?),
                    _ => return self.jpeg(&packed),
                }
            }
            _ => return Err("its pixels are not packed as it says".into()),
        };
        // Runs come as this machine stores numbers.
        let big = file.big_endian && matches!(raw, Cow::Borrowed(_));
        if self.planar && self.channels > 1 && matches!(raw, Cow::Borrowed(_)) {
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
        Ok(self.clean(&raw, big))
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
