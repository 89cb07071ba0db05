//! The pages of a TIFF that are one stack: those of one channel and one frame, where its description tells of several.
//!
//! Values are as stored: WhiteIsZero, like DICOM's MONOCHROME1, says how a viewer shows them and changes nothing.

use std::io::Cursor;
use std::path::Path;

use tiff::decoder::ifd::Value;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::{Tag, Type, ValueBuffer};
use tiff::{ColorType, TiffUnsupportedError};

use super::description;
use super::description::Description;
use super::{ImageInfo, Sink, Slice, check_memory, check_size};
use crate::scene::tiff_file;
use crate::source::stack::choice::Choice;
use crate::source::stack::coding::{Coding, Kind, rgb_of_ycbcr};
use crate::{Error, Result};

/// Bytes of a page's samples.
const MAX_PAGE: usize = 1 << 32;
/// Bytes of samples per byte of the file, which no packing of real pages exceeds.
pub(super) const MAX_RATIO: usize = 8 * 1032;

/// Number of the method in a page's tags.
const LZMA: u16 = 34925;

/// The pages of a file, at one of which its decoder stands.
pub(super) struct Pages<'a> {
    pub choice: &'a Choice<'a>,
    pub path: &'a Path,
    pub bytes: &'a [u8],
    pub decoder: Decoder<Cursor<&'a [u8]>>,
}

/// Name of a packing that is not unpacked.
fn packing(method: u16) -> &'static str {
    match method {
        2..=4 => " (fax)",
        34712 => " (JPEG 2000)",
        34887 => " (LERC)",
        50001 => " (WebP)",
        50002 => " (JPEG XL)",
        _ => "",
    }
}

/// Error about the page `n`, which counts from 0.
pub(super) fn broken(path: &Path, n: usize) -> impl Fn(tiff::TiffError) -> Error {
    let (path, page) = (path.to_path_buf(), n + 1);
    move |e| match e {
        tiff::TiffError::UnsupportedError(TiffUnsupportedError::UnsupportedCompressionMethod(method)) => {
            let (code, name) = (method.to_u16(), packing(method.to_u16()));
            let what =
                format!("page {page}: packing {code}{name} (write it anew first, as `tiffcp -c zip IN OUT` does)");
            Error::unsupported(&path, what)
        }
        tiff::TiffError::UnsupportedError(e) => {
            let what = e.to_string();
            Error::unsupported(&path, format!("page {page}: {}", what.trim_end_matches(" is unsupported")))
        }
        e => Error::input(&path, format!("page {page}"), format!("cannot be read as a TIFF: {e}")),
    }
}

/// A decoder of the file `bytes` that takes at most `memory` bytes.
fn decoder<'a>(path: &Path, bytes: &'a [u8], memory: u64) -> Result<Decoder<Cursor<&'a [u8]>>> {
    tiff_file::open(path, bytes, memory.min(MAX_PAGE as u64), |page, e| broken(path, page)(e))
}

/// Give the slices of a TIFF.
pub fn read(choice: &Choice, path: &Path, bytes: &[u8], sink: &mut dyn Sink) -> Result<()> {
    let mut decoder = decoder(path, bytes, choice.memory)?;
    let mut about = ImageInfo::default();
    // Before its pages are walked through: its tags are at hand.
    let described = describe(path, &mut decoder);
    let mut pages = Vec::new();
    for n in 0.. {
        let wrong = broken(path, n);
        // Smaller copies of a page, as pyramids and previews are.
        let reduced = decoder.find_tag_unsigned::<u64>(Tag::NewSubfileType).map_err(&wrong)?.unwrap_or(0) & 1 == 1;
        pages.push((n, reduced));
        if !decoder.more_images() {
            break;
        }
        decoder.next_image().map_err(broken(path, n + 1))?;
    }
    let whole: Vec<usize> = pages.iter().filter(|p| !p.1).map(|p| p.0).collect();
    let whole = if whole.is_empty() { pages.iter().map(|p| p.0).collect() } else { whole };
    about.warnings.add_many("pages that are smaller copies of others are left out", (pages.len() - whole.len()) as u64);
    let mut reader = Pages { choice, path, bytes, decoder };
    let planes = plan(choice, path, described, whole.len(), &mut about)?;
    let planes = planes.unwrap_or_else(|| (0..whole.len()).collect());
    let in_a_row = whole.len() == 1 && planes.iter().any(|p| *p > 0);
    reader.seek(whole[0])?;
    about.values = reader.values(whole[0])?;
    sink.about(about)?;
    for plane in planes {
        let slice = match whole.get(plane) {
            _ if in_a_row => reader.plane_in_a_row(plane)?,
            Some(&page) => {
                reader.seek(page)?;
                reader.page(page)?
            }
            None => {
                let what = format!("its description counts on a page {}, but there are {}", plane + 1, whole.len());
                return Err(Error::input(path, "", what));
            }
        };
        sink.slice(slice)?;
    }
    Ok(())
}

/// The planes that are taken, in order; `None`: all pages.
fn plan(
    choice: &Choice,
    path: &Path,
    described: Option<Description>,
    pages: usize,
    about: &mut ImageInfo,
) -> Result<Option<Vec<usize>>> {
    let Some(mut described) = described else {
        choice.frame(1, &mut about.warnings)?;
        return Ok(None);
    };
    about.spacing = described.spacing;
    let count = described.count();
    if described.is_guess && count != pages {
        choice.frame(1, &mut about.warnings)?;
        return Ok(None);
    }
    described.notes.drain(..).for_each(|note| about.warnings.add(note));
    if !described.is_listed() && count != pages && pages != 1 {
        about
            .warnings
            .add(format!("its description tells of {count} planes, but there are {pages} pages: all are slices"));
        choice.frame(1, &mut about.warnings)?;
        return Ok(None);
    }
    if described.slices == 1 && described.frames > 1 && !choice.names_frame() {
        about.warnings.add(format!("its {} frames have one slice each: they are taken for slices", described.frames));
        described.frames_are_slices();
    }
    let frame = choice.frame(described.frames, &mut about.warnings)?;
    let mut channel = 0;
    if described.channels > 1 {
        channel = choice.channel(&described.names, &mut about.warnings)?;
        about.chosen = true;
    }
    let page = |slice| {
        let wrong =
            |e| Error::input(path, format!("slice {}", slice + 1), format!("its description says that it is {e}"));
        described.page(slice, channel, frame).map_err(wrong)
    };
    (0..described.slices).map(page).collect::<Result<Vec<usize>>>().map(Some)
}

/// Description in the first page.
fn describe(path: &Path, decoder: &mut Decoder<Cursor<&[u8]>>) -> Option<Description> {
    let mut text = ValueBuffer::empty(Type::ASCII);
    decoder.image_ifd().find_tag_buf(Tag::ImageDescription, &mut text).ok()??;
    // Old programs write a µ in Latin-1.
    let bytes = text.as_bytes();
    let latin = || bytes.iter().map(|b| char::from(*b)).collect();
    let text = std::str::from_utf8(bytes).map_or_else(|_| latin(), str::to_owned);
    let text = text.trim_end_matches('\0');
    let mut per_unit = |tag| {
        let value = match decoder.find_tag(tag).ok()?? {
            Value::Rational(a, b) => f64::from(a) / f64::from(b),
            Value::Float(v) => f64::from(v),
            Value::Double(v) => v,
            _ => return None,
        };
        Some(value).filter(|v| v.is_finite() && *v > 0.0)
    };
    let (x, y) = (per_unit(Tag::XResolution), per_unit(Tag::YResolution));
    let unit = decoder.find_tag_unsigned::<u16>(Tag::ResolutionUnit).ok().flatten().unwrap_or(1);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let (width, height) = decoder.dimensions().ok()?;
    let page = description::Page { width: width as usize, height: height as usize, x, y, unit };
    Description::parse(text, page, &name)
}

/// Type and channels of a page's pixels.
pub(super) struct Layout {
    pub width: usize,
    pub height: usize,
    pub channels: usize,
    pub bits: usize,
    colour: ColorType,
}

impl Pages<'_> {
    fn seek(&mut self, page: usize) -> Result<()> {
        self.decoder.seek_to_image(page).map_err(broken(self.path, page))
    }

    fn layout(&mut self, page: usize) -> Result<Layout> {
        let wrong = broken(self.path, page);
        let (width, height) = self.decoder.dimensions().map_err(&wrong)?;
        check_size(self.path, width.into(), height.into(), self.bytes.len() as u64)?;
        let colour = self.decoder.colortype().map_err(&wrong)?;
        let bits = colour.bit_depth();
        let channels = match colour {
            ColorType::Gray(_) => 1,
            ColorType::GrayA(_) => 2,
            ColorType::RGB(_) | ColorType::YCbCr(8) => 3,
            ColorType::RGBA(_) => 4,
            ColorType::Multiband { num_samples, .. } => usize::from(num_samples),
            other => {
                return Err(Error::unsupported(self.path, format!("page {}: a TIFF of {other:?} pixels", page + 1)));
            }
        };
        let few = channels == 1 && [1, 2, 4].contains(&bits);
        if !few && ![8, 16, 32, 64].contains(&bits) {
            let what = format!("page {}: a TIFF of {bits} bits per sample", page + 1);
            return Err(Error::unsupported(self.path, what));
        }
        Ok(Layout { width: width as usize, height: height as usize, channels, bits: bits.into(), colour })
    }

    /// Names of a page's channels where they are values apart.
    fn values(&mut self, page: usize) -> Result<Option<Vec<String>>> {
        let layout = self.layout(page)?;
        let extra = self.decoder.find_tag_unsigned_vec::<u16>(Tag::ExtraSamples).ok().flatten().unwrap_or_default();
        // Grey, and an opacity beside it.
        let alpha = layout.channels == 2 && matches!(extra[..], [1 | 2]);
        let apart = matches!(layout.colour, ColorType::Multiband { num_samples: 2.., .. }) && !alpha;
        Ok(apart.then(|| vec![String::new(); layout.channels]))
    }

    fn page(&mut self, page: usize) -> Result<Slice> {
        let layout = self.layout(page)?;
        let Layout { width, height, channels, bits, colour } = layout;
        let wrong = broken(self.path, page);
        let planar =
            channels > 1 && self.decoder.find_tag_unsigned::<u16>(Tag::PlanarConfiguration).map_err(&wrong)? == Some(2);
        let white = self.decoder.find_tag_unsigned::<u16>(Tag::PhotometricInterpretation).map_err(&wrong)? == Some(0);
        let size = (width * bits).div_ceil(8).saturating_mul(channels).saturating_mul(height);
        if size > MAX_PAGE || size / MAX_RATIO > self.bytes.len() {
            let what = format!("{} bytes cannot hold {width}×{height} pixels of {channels} channels", self.bytes.len());
            return Err(Error::input(self.path, format!("page {}", page + 1), what));
        }
        // The page as it is decoded, and in the order in which it is kept.
        let kept = (width * height).saturating_mul(channels).saturating_mul(bits.max(8) / 8);
        let taken = size.saturating_add(kept) as u64;
        check_memory(self.choice, self.path, taken)?;
        let mut decoded = DecodingResult::U8(Vec::new());
        if self.decoder.find_tag_unsigned::<u16>(Tag::Compression).map_err(&wrong)? == Some(LZMA) {
            let file = self.unpacked(page, &layout, taken)?;
            decoder(self.path, &file, self.choice.memory)?.read_image_to_buffer(&mut decoded).map_err(&wrong)?;
        } else {
            self.decoder.read_image_to_buffer(&mut decoded).map_err(&wrong)?;
        }
        let (kind, mut bytes) = numbers(decoded);
        if bits < 8 {
            bytes = unpacked(&bytes, width, bits);
        }
        if white {
            as_stored(kind, bits, &mut bytes);
        }
        if bytes.len() != width * height * channels * kind.bytes() {
            let what = "its samples are not as many as its size says";
            return Err(Error::input(self.path, format!("page {}", page + 1), what));
        }
        if planar {
            bytes = interleaved(&bytes, channels, kind.bytes());
        }
        if matches!(colour, ColorType::YCbCr(_)) {
            bytes.as_chunks_mut().0.iter_mut().for_each(|pixel| *pixel = rgb_of_ycbcr(*pixel));
        }
        Ok(Slice { width, height, coding: Coding::native(kind, channels), bytes, origin: [0, 0] })
    }

    /// A plane of those that follow the first page's pixels without pages of their own, as ImageJ writes stacks above 4 GB.
    fn plane_in_a_row(&mut self, plane: usize) -> Result<Slice> {
        let Layout { width, height, channels, bits, .. } = self.layout(0)?;
        let wrong = broken(self.path, 0);
        let tag = |decoder: &mut Decoder<_>, tag| decoder.find_tag_unsigned_vec::<u64>(tag).map_err(&wrong);
        let offset = tag(&mut self.decoder, Tag::StripOffsets)?.and_then(|v| v.first().copied());
        let packed = tag(&mut self.decoder, Tag::Compression)?.is_some_and(|v| v.first() != Some(&1));
        let format = tag(&mut self.decoder, Tag::SampleFormat)?.and_then(|v| v.first().copied()).unwrap_or(1);
        let kind = match (bits, format) {
            (8, 1) => Kind::U8,
            (8, 2) => Kind::I8,
            (16, 1) => Kind::U16,
            (16, 2) => Kind::I16,
            (32, 1) => Kind::U32,
            (32, 2) => Kind::I32,
            (32, 3) => Kind::F32,
            (64, 3) => Kind::F64,
            _ => return Err(Error::unsupported(self.path, format!("planes in one page, of {bits} bits"))),
        };
        let big_endian = self.decoder.byte_order() == tiff::tags::ByteOrder::BigEndian;
        let size = (width * height * kind.bytes()).saturating_mul(channels);
        let start = offset.and_then(|o| usize::try_from(o).ok()).and_then(|o| o.checked_add(size.checked_mul(plane)?));
        // Pixels end where the page's tags begin, if these come after.
        let tags = self.decoder.ifd_pointer().map_or(u64::MAX, |p| p.0);
        let end =
            if offset.is_some_and(|o| o < tags) { usize::try_from(tags).unwrap_or(usize::MAX) } else { usize::MAX };
        let range = start.and_then(|s| Some(s..s.checked_add(size)?)).filter(|r| !packed && r.end <= end);
        let bytes = range.and_then(|r| self.bytes.get(r));
        let Some(bytes) = bytes else {
            let what = format!(
                "its description counts on a plane {}, but there is one page, and no more follows it",
                plane + 1
            );
            return Err(Error::input(self.path, "", what));
        };
        let coding = Coding { kind, big_endian, channels };
        Ok(Slice { width, height, coding, bytes: bytes.to_vec(), origin: [0, 0] })
    }
}

/// Decoded numbers as bytes of this machine.
fn numbers(decoded: DecodingResult) -> (Kind, Vec<u8>) {
    macro_rules! bytes {
        ($list:expr) => {
            $list.into_iter().flat_map(|v| v.to_ne_bytes()).collect()
        };
    }
    match decoded {
        DecodingResult::U8(v) => (Kind::U8, v),
        DecodingResult::I8(v) => (Kind::I8, bytes!(v)),
        DecodingResult::U16(v) => (Kind::U16, bytes!(v)),
        DecodingResult::I16(v) => (Kind::I16, bytes!(v)),
        DecodingResult::U32(v) => (Kind::U32, bytes!(v)),
        DecodingResult::I32(v) => (Kind::I32, bytes!(v)),
        DecodingResult::U64(v) => (Kind::U64, bytes!(v)),
        DecodingResult::I64(v) => (Kind::I64, bytes!(v)),
        DecodingResult::F32(v) => (Kind::F32, bytes!(v)),
        DecodingResult::F64(v) => (Kind::F64, bytes!(v)),
        DecodingResult::F16(v) => (Kind::F32, bytes!(v.into_iter().map(|h| h.to_f32()))),
    }
}

/// One byte per number of `bits` bits; every row begins with a byte.
fn unpacked(bytes: &[u8], width: usize, bits: usize) -> Vec<u8> {
    let per_byte = 8 / bits;
    let number = |row: &[u8], x: usize| row[x / per_byte] >> (8 - bits * (x % per_byte + 1)) & ((1 << bits) - 1);
    bytes.chunks_exact(width.div_ceil(per_byte)).flat_map(|row| (0..width).map(move |x| number(row, x))).collect()
}

/// Undo the decoder's inversion of numbers where white is zero.
fn as_stored(kind: Kind, bits: usize, bytes: &mut [u8]) {
    match kind {
        Kind::F32 => bytes.as_chunks_mut().0.iter_mut().for_each(|b| *b = (1.0 - f32::from_ne_bytes(*b)).to_ne_bytes()),
        Kind::F64 => bytes.as_chunks_mut().0.iter_mut().for_each(|b| *b = (1.0 - f64::from_ne_bytes(*b)).to_ne_bytes()),
        _ if bits < 8 => bytes.iter_mut().for_each(|b| *b = !*b & ((1 << bits) - 1)),
        _ => bytes.iter_mut().for_each(|b| *b = !*b),
    }
}

/// Channels side by side, from planes of `width` bytes per number.
fn interleaved(planes: &[u8], channels: usize, width: usize) -> Vec<u8> {
    let plane = planes.len() / channels;
    let mut out = Vec::with_capacity(planes.len());
    for at in (0..plane).step_by(width) {
        (0..channels).for_each(|c| out.extend_from_slice(&planes[c * plane + at..][..width]));
    }
    out
}
