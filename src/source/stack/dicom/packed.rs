//! Packed pixels of DICOM's frames: runs, deflate, JPEG, JPEG-LS, JPEG 2000.
//!
//! Based on: NEMA PS3.5, section 8.2 and annexes A and G (RLE); ISO/IEC 15444-1, annex A (JPEG 2000's markers).

use std::io::Read;

use byteorder::{BigEndian, ByteOrder};

use super::layout::Layout;

/// Compression of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Packing {
    Plain,
    Runs,
    Deflate,
    Jpeg,
    JpegLs,
    Jpeg2000,
}

impl Packing {
    /// Of a transfer syntax; the error names one that is not read.
    pub fn of(syntax: &str) -> Result<Packing, String> {
        let name = match syntax.strip_prefix("1.2.840.10008.1.2").unwrap_or("?") {
            "" | ".1" | ".2" => return Ok(Packing::Plain),
            ".5" => return Ok(Packing::Runs),
            ".8.1" => return Ok(Packing::Deflate),
            ".4.50" | ".4.51" | ".4.57" | ".4.70" => return Ok(Packing::Jpeg),
            ".4.80" | ".4.81" => return Ok(Packing::JpegLs),
            ".4.90" | ".4.91" => return Ok(Packing::Jpeg2000),
            ".4.92" | ".4.93" => "JPEG 2000 of several components (Part 2)".to_owned(),
            ".4.110" | ".4.111" | ".4.112" => "JPEG XL".into(),
            ".4.201" | ".4.202" | ".4.203" => "High-Throughput JPEG 2000".into(),
            s if s.starts_with(".4.10") => "video".into(),
            _ => format!("transfer syntax {syntax}"),
        };
        Err(format!("DICOM with pixels packed as {name} (unpack it with another tool)"))
    }

    /// Whether pixels that are said to be `photometric` are read, of three channels.
    pub fn has_colours(self, photometric: &str, bits: usize) -> bool {
        match photometric {
            "RGB" => true,
            "YBR_FULL" => bits == 8,
            "YBR_FULL_422" if self == Packing::Plain => bits == 8,
            "YBR_RCT" | "YBR_ICT" => matches!(self, Packing::Jpeg | Packing::Jpeg2000),
            other => self == Packing::Jpeg && other.starts_with("YBR"),
        }
    }

    /// A frame's numbers in this machine's bytes, channels side by side unless they are plain or deflated.
    pub fn unpack(self, layout: &Layout, packed: &[u8]) -> Result<Vec<u8>, String> {
        match self {
            Packing::Plain => Ok(packed.to_vec()),
            Packing::Runs => Ok(layout.clean(&runs(layout, packed)?, false)),
            Packing::Deflate => inflate(layout, packed),
            Packing::Jpeg => jpeg(layout, packed),
            Packing::JpegLs => jpeg_ls(layout, packed),
            Packing::Jpeg2000 => jpeg_2000(layout, packed),
        }
    }
}

/// DICOM's runs: a segment for every byte of a number, the highest first, channel by channel.
fn runs(layout: &Layout, packed: &[u8]) -> Result<Vec<u8>, String> {
    const BROKEN: &str = "its runs are broken";
    let word = |n: usize| -> Option<usize> { Some(u32::from_le_bytes(*packed.get(4 * n..)?.first_chunk()?) as usize) };
    let width = layout.allocated / 8;
    let segments = layout.channels * width;
    if word(0) != Some(segments) || segments > 15 {
        return Err(format!("{BROKEN}: {segments} segments are needed"));
    }
    let pixels = layout.rows * layout.columns;
    let sample = width * layout.channels;
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
            let (values, rest) = from.split_at_checked(take).ok_or_else(|| format!("{BROKEN}: they end too early"))?;
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

/// Bytes as they would lie unpacked.
fn inflate(layout: &Layout, packed: &[u8]) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    let mut from = flate2::read::DeflateDecoder::new(packed).take(layout.bytes() as u64);
    from.read_to_end(&mut out).map_err(|_| "its deflated pixels are broken")?;
    if out.len() < layout.bytes() {
        return Err(format!("its pixels need {} bytes, {} are there", layout.bytes(), out.len()));
    }
    Ok(out)
}

/// What to do about pixels that are packed in a way that is not read.
const UNPACK: &str = "unpack it first, as gdcmconv with its option raw does";

fn jpeg(layout: &Layout, packed: &[u8]) -> Result<Vec<u8>, String> {
    use jpeg_decoder::PixelFormat;
    let broken = |e: jpeg_decoder::Error| match e {
        // Twelve bits with loss among them.
        jpeg_decoder::Error::Unsupported(what) => {
            format!("its JPEG is of a kind that is not read ({what:?}); {UNPACK}")
        }
        e => format!("its JPEG cannot be read: {e}"),
    };
    let mut decoder = jpeg_decoder::Decoder::new(packed);
    decoder.set_max_decoding_buffer_size(layout.bytes());
    decoder.read_info().map_err(broken)?;
    let info = decoder.info().ok_or("its JPEG says no size")?;
    let format = match (layout.channels, layout.allocated) {
        (1, 8) => PixelFormat::L8,
        (1, 16) => PixelFormat::L16,
        (3, 8) => PixelFormat::RGB24,
        _ => return Err(format!("a JPEG for {} bits is not read; {UNPACK}", layout.allocated)),
    };
    if (usize::from(info.width), usize::from(info.height), info.pixel_format) != (layout.columns, layout.rows, format) {
        return Err("its JPEG is of another size or kind than it says".into());
    }
    let pixels = decoder.decode().map_err(broken)?;
    // 16 bits come as this machine stores them.
    if layout.channels == 1 { Ok(layout.clean(&pixels, cfg!(target_endian = "big"))) } else { Ok(pixels) }
}

fn jpeg_ls(layout: &Layout, packed: &[u8]) -> Result<Vec<u8>, String> {
    if layout.channels != 1 || ![8, 16].contains(&layout.allocated) {
        let (channels, bits) = (layout.channels, layout.allocated);
        return Err(format!("a JPEG-LS of {channels} channels of {bits} bits is not read; {UNPACK}"));
    }
    let size = |n: usize| u32::try_from(n).map_err(|_| "it is too large".to_owned());
    let (numbers, ..) = jpegls::decode(packed, size(layout.columns)?, size(layout.rows)?)
        .map_err(|e| format!("its JPEG-LS cannot be read: {e}"))?;
    Ok(layout.clean(&numbers_of(layout, numbers.iter().map(|v| i32::from(*v))), false))
}

/// Numbers of 8 or 16 bits, the lower byte first; higher bits are left out.
fn numbers_of(layout: &Layout, numbers: impl Iterator<Item = i32>) -> Vec<u8> {
    let width = layout.allocated / 8;
    let mut out = Vec::with_capacity(layout.rows * layout.columns * layout.channels * width);
    numbers.for_each(|v| out.extend_from_slice(&v.to_le_bytes()[..width.min(4)]));
    out
}

/// The codestream of a JPEG 2000: bare, as DICOM wants it, or in the boxes of a .jp2 file.
fn codestream(packed: &[u8]) -> Option<&[u8]> {
    let mut rest = packed;
    while !rest.starts_with(&[0xff, 0x4f]) {
        let (head, length) = match BigEndian::read_u32(rest.get(..4)?) {
            0 => (8, rest.len()),
            1 => (16, usize::try_from(BigEndian::read_u64(rest.get(8..16)?)).ok()?),
            n => (8, n as usize),
        };
        if rest.get(4..8)? == b"jp2c" {
            return rest.get(head..length);
        }
        rest = rest.get(length.max(head)..)?;
    }
    Some(rest)
}

/// Bits and sign of all components, by the SIZ marker at a codestream's beginning, where all agree.
fn components(layout: &Layout, stream: &[u8]) -> Option<(u32, bool)> {
    let word = |at: usize| stream.get(at..at + 4).map(BigEndian::read_u32);
    let (width, height) = (word(8)?.checked_sub(word(16)?)?, word(12)?.checked_sub(word(20)?)?);
    // Each tile takes memory before its pixels are looked for.
    let (tile_width, tile_height) = (word(24)?, word(28)?);
    let tiles = u64::from(width.div_ceil(tile_width.max(1))) * u64::from(height.div_ceil(tile_height.max(1)));
    let count = usize::from(BigEndian::read_u16(stream.get(40..42)?));
    let first = stream.get(42..45)?;
    let &[depth, 1, 1] = first else { return None };
    let alike = stream.get(42..42 + 3 * count)?.chunks(3).all(|c| c == first);
    let bits = u32::from(depth & 0x7f) + 1;
    let right = (width as usize, height as usize, count) == (layout.columns, layout.rows, layout.channels)
        && bits as usize <= layout.allocated
        && tiles <= 1 << 16;
    (alike && right).then_some((bits, depth & 0x80 != 0))
}

fn jpeg_2000(layout: &Layout, packed: &[u8]) -> Result<Vec<u8>, String> {
    use hayro_jpeg2000::{DecodeError, DecodeSettings, DecoderContext, Image};
    if ![8, 16].contains(&layout.allocated) {
        return Err(format!("a JPEG 2000 for {} bits is not read", layout.allocated));
    }
    let stream = codestream(packed).ok_or("its JPEG 2000 has no codestream")?;
    let (bits, signed) = components(layout, stream).ok_or("its JPEG 2000 is of another size or kind than it says")?;
    let broken = |e: DecodeError| format!("its JPEG 2000 cannot be read: {e}");
    let settings = DecodeSettings { resolve_palette_indices: false, strict: true, target_resolution: None };
    let image = Image::new(stream, &settings).map_err(broken)?;
    let mut context = DecoderContext::default();
    let decoded = image.decode(&mut context).map_err(broken)?;
    let planes: Vec<&[f32]> = decoded.components().iter().map(|c| c.samples()).collect();
    let pixels = layout.rows * layout.columns;
    if planes.len() != layout.channels || planes.iter().any(|p| p.len() < pixels) {
        return Err("its JPEG 2000 does not hold all pixels".into());
    }
    // What is unsigned is stored around 0, and given with half of its range added; so are signed numbers, to which none is.
    let (half, full) = (1 << (bits - 1), (1 << bits) - 1);
    let number = |v: f32| (v.round() as i32).clamp(0, full) - if signed { half } else { 0 };
    let numbers = (0..pixels).flat_map(|i| planes.iter().map(move |plane| number(plane[i])));
    Ok(layout.clean(&numbers_of(layout, numbers), false))
}
