//! One slice from an image file (PNG, JPEG, EXR and what else `image` reads), and all pages of a TIFF.

use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ImageFormat, ImageReader};
use tiff::ColorType;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

use super::bytes::map_file;
use super::samples::{Coding, Kind};
use crate::{Error, Result};

/// A slice's samples, row by row from the first.
pub struct Slice {
    pub width: usize,
    pub height: usize,
    pub coding: Coding,
    pub bytes: Vec<u8>,
}

impl Slice {
    /// "512×512, 1 channel of U16".
    pub fn describe(&self) -> String {
        let s = if self.coding.channels == 1 { "" } else { "s" };
        format!("{}×{}, {} channel{s} of {:?}", self.width, self.height, self.coding.channels, self.coding.kind)
    }

    pub fn is_like(&self, other: &Slice) -> bool {
        (self.width, self.height, self.coding) == (other.width, other.height, other.coding)
    }
}

/// Pixels of a slice.
const MAX_PIXELS: u64 = 1 << 28;

/// The size that a header claims, against [`MAX_PIXELS`] and what `stored` bytes can be unpacked to.
fn check_size(path: &Path, width: u64, height: u64, stored: u64) -> Result<()> {
    let pixels = width.saturating_mul(height);
    if pixels == 0 || pixels / (8 * 1032) > stored {
        return Err(Error::input(path, "", format!("{stored} bytes cannot hold {width}×{height} pixels")));
    }
    if pixels > MAX_PIXELS {
        let what = format!("the number of pixels of {}", path.display());
        return Err(Error::Limit { what, needed: pixels, allowed: MAX_PIXELS });
    }
    Ok(())
}

/// The extensions of slices.
pub fn is_image(extension: &str) -> bool {
    ["png", "jpg", "jpeg", "tif", "tiff", "exr", "bmp", "webp", "gif", "tga"].contains(&extension)
}

/// All slices of an image file, one after the other: one, but for TIFF.
pub fn read(path: &Path, each: &mut dyn FnMut(Slice) -> Result<()>) -> Result<()> {
    let bytes = map_file(path)?;
    match bytes.get(..4) {
        Some(b"II*\0" | b"MM\0*" | b"II+\0" | b"MM\0+") => tiff_pages(path, &bytes, each),
        Some([0x76, 0x2f, 0x31, 0x01]) => each(exr(path, &bytes)?),
        _ => each(other(path, &bytes)?),
    }
}

fn other(path: &Path, bytes: &[u8]) -> Result<Slice> {
    let broken = |e: image::ImageError| Error::input(path, "", format!("cannot be read as an image: {e}"));
    let format = image::guess_format(bytes).or_else(|e| ImageFormat::from_path(path).map_err(|_| e)).map_err(broken)?;
    let reader = || ImageReader::with_format(Cursor::new(bytes), format);
    let (width, height) = reader().into_dimensions().map_err(broken)?;
    check_size(path, width.into(), height.into(), bytes.len() as u64)?;
    let mut limits = image::Limits::default();
    limits.max_alloc = Some((u64::from(width) * u64::from(height)).saturating_mul(16).saturating_add(1 << 20));
    let mut reader = reader();
    reader.limits(limits);
    let image = reader.decode().map_err(broken)?;
    let (kind, channels) = match &image {
        DynamicImage::ImageLuma8(_) => (Kind::U8, 1),
        DynamicImage::ImageLumaA8(_) => (Kind::U8, 2),
        DynamicImage::ImageRgb8(_) => (Kind::U8, 3),
        DynamicImage::ImageRgba8(_) => (Kind::U8, 4),
        DynamicImage::ImageLuma16(_) => (Kind::U16, 1),
        DynamicImage::ImageLumaA16(_) => (Kind::U16, 2),
        DynamicImage::ImageRgb16(_) => (Kind::U16, 3),
        DynamicImage::ImageRgba16(_) => (Kind::U16, 4),
        DynamicImage::ImageRgb32F(_) => (Kind::F32, 3),
        DynamicImage::ImageRgba32F(_) => (Kind::F32, 4),
        _ => return Err(Error::unsupported(path, "an image of this kind of pixels")),
    };
    let (width, height) = (width as usize, height as usize);
    Ok(Slice { width, height, coding: Coding::native(kind, channels), bytes: image.into_bytes() })
}

fn exr(path: &Path, bytes: &[u8]) -> Result<Slice> {
    use ::exr::prelude::{ReadChannels, ReadLayers};
    let broken = |e: ::exr::error::Error| match e {
        ::exr::error::Error::NotSupported(e) => Error::unsupported(path, e.into_owned()),
        e => Error::input(path, "", format!("cannot be read as an EXR: {e}")),
    };
    let meta = ::exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(broken)?;
    for header in &meta.headers {
        let size = header.layer_size;
        check_size(path, size.width() as u64, size.height() as u64, bytes.len() as u64)?;
    }
    let layer = ::exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(broken)?
        .layer_data;
    let (width, height) = (layer.size.width(), layer.size.height());
    let plane = |name: &str| -> Option<Vec<f32>> {
        let channel = layer.channel_data.list.iter().find(|c| c.name.to_string() == name)?;
        let values: Vec<f32> = channel.sample_data.values_as_f32().collect();
        (values.len() == width * height).then_some(values)
    };
    let planes: Vec<Vec<f32>> = match (plane("Y"), plane("R"), plane("G"), plane("B"), plane("A")) {
        (Some(y), ..) => vec![y],
        (_, Some(r), Some(g), Some(b), Some(a)) => vec![r, g, b, a],
        (_, Some(r), Some(g), Some(b), None) => vec![r, g, b],
        _ => match &layer.channel_data.list[..] {
            [one] => vec![plane(&one.name.to_string()).unwrap_or_default()],
            _ => return Err(Error::unsupported(path, "an EXR layer without one channel, Y, or R, G and B")),
        },
    };
    let mut bytes = Vec::with_capacity(width * height * planes.len() * 4);
    for i in 0..width * height {
        for plane in &planes {
            bytes.extend(plane.get(i).copied().unwrap_or(0.0).to_ne_bytes());
        }
    }
    Ok(Slice { width, height, coding: Coding::native(Kind::F32, planes.len()), bytes })
}

fn tiff_pages(path: &Path, bytes: &[u8], each: &mut dyn FnMut(Slice) -> Result<()>) -> Result<()> {
    let mut page = 0;
    let broken = |page: usize, e: tiff::TiffError| match e {
        tiff::TiffError::UnsupportedError(e) => Error::unsupported(path, format!("page {page}: {e}")),
        e => Error::input(path, format!("page {page}"), format!("cannot be read as a TIFF: {e}")),
    };
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(|e| broken(1, e))?;
    loop {
        page += 1;
        let wrong = |e| broken(page, e);
        let (width, height) = decoder.dimensions().map_err(wrong)?;
        check_size(path, width.into(), height.into(), bytes.len() as u64)?;
        let color = decoder.colortype().map_err(wrong)?;
        let channels = match color {
            ColorType::Gray(_) => 1,
            ColorType::GrayA(_) => 2,
            ColorType::RGB(_) => 3,
            ColorType::RGBA(_) => 4,
            ColorType::Multiband { num_samples: 1, .. } => 1,
            other => return Err(Error::unsupported(path, format!("page {page}: a TIFF of {other:?} pixels"))),
        };
        let bits = color.bit_depth();
        if ![8, 16, 32, 64].contains(&bits) {
            return Err(Error::unsupported(path, format!("page {page}: a TIFF of {bits} bits a sample")));
        }
        if channels > 1 && decoder.find_tag_unsigned::<u16>(Tag::PlanarConfiguration).map_err(wrong)? == Some(2) {
            return Err(Error::unsupported(path, format!("page {page}: a TIFF whose channels are apart (planar)")));
        }
        let mut limits = tiff::decoder::Limits::default();
        let size = width as usize * height as usize * channels * usize::from(bits / 8);
        limits.decoding_buffer_size = size;
        limits.intermediate_buffer_size = size.saturating_add(1 << 20);
        decoder = decoder.with_limits(limits);
        let (kind, bytes) = numbers(decoder.read_image().map_err(wrong)?);
        if bytes.len() != size {
            return Err(Error::input(path, format!("page {page}"), "its samples are not as many as its size says"));
        }
        let coding = Coding::native(kind, channels);
        each(Slice { width: width as usize, height: height as usize, coding, bytes })?;
        if !decoder.more_images() {
            return Ok(());
        }
        decoder.next_image().map_err(wrong)?;
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
