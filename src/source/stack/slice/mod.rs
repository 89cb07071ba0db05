//! Slices of an image file: one of PNG, JPEG and what else `image` reads, the pages of a TIFF, the parts of an EXR.

mod description;
mod lzma;
mod pages;
mod parts;

use std::io::Cursor;
use std::path::Path;

use image::codecs::{gif::GifDecoder, webp::WebPDecoder};
use image::{AnimationDecoder, DynamicImage, ImageDecoder, ImageFormat};

use super::bytes::map_file;
use super::choice::Choice;
use super::coding::{Coding, Kind};
use crate::scene::image::decoder;
use crate::{Error, Result, Warnings};

/// A slice's samples, row by row from the first.
pub struct Slice {
    pub width: usize,
    pub height: usize,
    pub coding: Coding,
    pub bytes: Vec<u8>,
    /// Column and row of the first pixel in the picture that the file says it is a part of.
    pub origin: [i32; 2],
}

/// Description that a file gives of all its slices.
#[derive(Default)]
pub struct ImageInfo {
    pub spacing: Option<Spacing>,
    /// Names of the channels of a pixel, where they are values apart and no colour.
    pub values: Option<Vec<String>>,
    /// Whether one channel of several was taken.
    pub chosen: bool,
    pub warnings: Warnings,
}

/// Distances of samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spacing {
    pub columns: f64,
    pub rows: f64,
    pub slices: Option<f64>,
    /// Metres per unit of these; 0 where only their ratio is known.
    pub metres: f64,
}

/// Receiver of each slice, and before the first of them of what the file says.
pub trait Sink {
    fn about(&mut self, about: ImageInfo) -> Result<()>;
    fn slice(&mut self, slice: Slice) -> Result<()>;
}

impl Slice {
    /// "512×512, 1 channel of U16".
    pub fn describe(&self) -> String {
        let s = if self.coding.channels == 1 { "" } else { "s" };
        let [x, y] = self.origin;
        let at = if self.origin == [0, 0] { String::new() } else { format!(" from pixel ({x}, {y}) on") };
        format!("{}×{}{at}, {} channel{s} of {:?}", self.width, self.height, self.coding.channels, self.coding.kind)
    }

    pub fn is_like(&self, other: &Slice) -> bool {
        (self.width, self.height, self.coding, self.origin) == (other.width, other.height, other.coding, other.origin)
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

/// Check that decoding `path` takes no more memory than is allowed.
fn check_memory(choice: &Choice, path: &Path, needed: u64) -> Result<()> {
    if needed <= choice.memory {
        return Ok(());
    }
    Err(Error::Limit { what: format!("decoding {}, in bytes,", path.display()), needed, allowed: choice.memory })
}

/// The extensions of slices.
pub fn is_image(extension: &str) -> bool {
    ["png", "jpg", "jpeg", "tif", "tiff", "exr", "bmp", "webp", "gif", "tga"].contains(&extension)
}

/// Give all slices of an image file, one after the other.
pub fn read(choice: &Choice, path: &Path, sink: &mut dyn Sink) -> Result<()> {
    let bytes = map_file(path)?;
    match bytes.get(..4) {
        Some(b"II*\0" | b"MM\0*" | b"II+\0" | b"MM\0+") => pages::read(choice, path, &bytes, sink),
        Some([0x76, 0x2f, 0x31, 0x01]) => parts::read(choice, path, &bytes, sink),
        _ => {
            let mut about = ImageInfo::default();
            choice.frame(1, &mut about.warnings)?;
            sink.about(about)?;
            sink.slice(other(choice, path, &bytes)?)
        }
    }
}

fn other(choice: &Choice, path: &Path, bytes: &[u8]) -> Result<Slice> {
    let broken = |e: image::ImageError| Error::input(path, "", format!("cannot be read as an image: {e}"));
    let format = image::guess_format(bytes).or_else(|e| ImageFormat::from_path(path).map_err(|_| e)).map_err(broken)?;
    let mut decoder = decoder(bytes, format).map_err(broken)?;
    let (width, height) = decoder.dimensions();
    check_size(path, width.into(), height.into(), bytes.len() as u64)?;
    // Bytes that are decoded, and those that a decoder keeps besides.
    check_memory(choice, path, decoder.total_bytes().saturating_mul(2))?;
    if is_animation(bytes, format).map_err(broken)? {
        let what = "an animation of several pictures (save each as a file of its own, all in one folder)";
        return Err(Error::unsupported(path, what));
    }
    let mut limits = image::Limits::default();
    limits.max_alloc = Some((u64::from(width) * u64::from(height)).saturating_mul(16).saturating_add(1 << 20));
    decoder.set_limits(limits).map_err(broken)?;
    let image = DynamicImage::from_decoder(decoder).map_err(broken)?;
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
    let coding = Coding::native(kind, channels);
    Ok(Slice { width, height, coding, bytes: image.into_bytes(), origin: [0, 0] })
}

/// Whether the file holds several pictures, of which a decoder gives the first.
fn is_animation(bytes: &[u8], format: ImageFormat) -> image::ImageResult<bool> {
    let from = Cursor::new(bytes);
    Ok(match format {
        // The count of frames stands before the pixels.
        ImageFormat::Png => bytes.windows(4).take_while(|b| b != b"IDAT").any(|b| b == b"acTL"),
        ImageFormat::WebP => WebPDecoder::new(from)?.has_animation(),
        ImageFormat::Gif => GifDecoder::new(from)?.into_frames().nth(1).is_some(),
        _ => false,
    })
}
