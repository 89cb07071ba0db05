//! Reading and writing of pictures: PNG and EXR files, and Radiance HDR files for reading.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

use exr::prelude::{AttributeValue, ReadChannels, ReadLayers};

use crate::format;
use crate::format::read_file;
use crate::scene::files::extension;
use crate::scene::image::decoder;
use crate::scene::texture::srgb_to_linear;
use crate::{Error, Result};

/// Pictures of more pixels than this are refused: 2^28, a 16 K square.
pub const MAX_PIXELS: u64 = 1 << 28;
/// Pixels of a picture that is read: 2^26, an 8 K square, are a gigabyte as RGBA of 32-bit floats.
const MAX_READ: u64 = 1 << 26;
/// Largest file: those pixels as RGBA of 32-bit floats, and as much again; also what the channels of one may take.
const MAX_BYTES: u64 = 32 * MAX_READ;

/// A picture in linear Rec. 709; row 0 is the top.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Image {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` pixels, row by row: colour as it is seen (over black, where the file has straight alpha), and the
    /// share of the pixel that is covered, 1 where the file does not say.
    pub rgba: Vec<[f32; 4]>,
}

impl Image {
    /// The picture whose pixel (x, y) is `f(x, y)`.
    pub fn from_fn(width: usize, height: usize, f: impl Fn(usize, usize) -> [f32; 4]) -> Self {
        Image { width, height, rgba: (0..width * height).map(|i| f(i % width, i / width)).collect() }
    }

    /// Whether any pixel is less than wholly covered.
    pub fn has_alpha(&self) -> bool {
        self.rgba.iter().any(|p| p[3] < 1.0)
    }
}

/// Clamped to [0, 1]; NaN becomes 0.
pub fn unit(value: f32) -> f32 {
    if value > 0.0 { value.min(1.0) } else { 0.0 }
}

/// Linear → sRGB transfer curve (IEC 61966-2-1); values outside [0, 1] are clamped, NaN becomes 0.
pub fn srgb_encode(linear: f32) -> f32 {
    let c = unit(linear);
    if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * libm::powf(c, 1.0 / 2.4) - 0.055 }
}

/// sRGB → linear transfer curve (IEC 61966-2-1) of a value in [0, 1].
pub fn srgb_decode(encoded: f32) -> f32 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { libm::powf((encoded + 0.055) / 1.055, 2.4) }
}

/// Linear → 8-bit sRGB, rounded to the nearest.
pub fn srgb8(linear: f32) -> u8 {
    (255.0 * srgb_encode(linear)).round() as u8
}

/// Read a `.png` (sRGB, 8 or 16 bit, straight alpha), an `.exr` (linear; channels R G B or Y, and A) or an `.hdr` (Radiance
/// RGBE, linear) picture.
///
/// # Errors
/// `Io` where the file cannot be read, `Unsupported` for another ending or pixel layout, `Input` where the data are
/// broken, `Limit` beyond 2^26 pixels.
pub fn read(path: &Path) -> Result<Image> {
    match extension(path).as_str() {
        "png" => read_png(path),
        "exr" => read_exr(path),
        "hdr" => read_hdr(path),
        _ => Err(Error::unsupported(path, "a picture that ends neither in .png, nor in .exr or .hdr")),
    }
}

/// Largest ratio of unpacked to packed bytes of deflate, which is the densest coding in PNG and EXR.
const MAX_DEFLATED: u64 = 1032;

fn too_short(path: &Path, width: u64, height: u64) -> Error {
    Error::input(path, "", format!("the file is too short for {width}×{height} pixels"))
}

/// The size that a header claims, against [`MAX_READ`] and the length of the file; a byte is at most 8 pixels.
fn check_size(path: &Path, width: u64, height: u64, file_bytes: u64) -> Result<()> {
    let pixels = width.saturating_mul(height);
    if pixels == 0 {
        return Err(Error::input(path, "", "the picture has no pixels"));
    }
    if pixels / (8 * MAX_DEFLATED) > file_bytes {
        return Err(too_short(path, width, height));
    }
    if pixels > MAX_READ {
        return Err(Error::Limit { what: format!("{}: pixels", path.display()), needed: pixels, allowed: MAX_READ });
    }
    Ok(())
}

fn read_png(path: &Path) -> Result<Image> {
    use image::{DynamicImage, ImageDecoder, ImageFormat};
    let broken = |e: image::ImageError| Error::input(path, "", format!("cannot be read as a PNG: {e}"));
    let bytes = read_file(path, MAX_BYTES)?;
    let decoder = decoder(&bytes, ImageFormat::Png).map_err(broken)?;
    let (width, height) = decoder.dimensions();
    check_size(path, width.into(), height.into(), bytes.len() as u64)?;
    // The decoder allocates memory for all pixels before it finds that the file is shorter.
    let bits = u64::from(decoder.original_color_type().bits_per_pixel());
    let packed = (u64::from(width) * u64::from(height)).saturating_mul(bits) / 8;
    if packed / MAX_DEFLATED > bytes.len() as u64 {
        return Err(too_short(path, width.into(), height.into()));
    }
    let decoded = DynamicImage::from_decoder(decoder).map_err(broken)?;
    let premultiply = |[r, g, b, a]: [f32; 4]| [r * a, g * a, b * a, a];
    let deep = matches!(
        decoded,
        DynamicImage::ImageLuma16(_)
            | DynamicImage::ImageLumaA16(_)
            | DynamicImage::ImageRgb16(_)
            | DynamicImage::ImageRgba16(_)
    );
    let rgba = if deep {
        let decode = |c: u16| srgb_decode(f32::from(c) / 65535.0);
        let pixels = decoded.into_rgba16();
        let pixel = |p: &image::Rgba<u16>| [decode(p[0]), decode(p[1]), decode(p[2]), f32::from(p[3]) / 65535.0];
        pixels.pixels().map(|p| premultiply(pixel(p))).collect()
    } else {
        let decode = srgb_to_linear;
        let pixels = decoded.into_rgba8();
        let pixel = |p: &image::Rgba<u8>| [decode(p[0]), decode(p[1]), decode(p[2]), f32::from(p[3]) / 255.0];
        pixels.pixels().map(|p| premultiply(pixel(p))).collect()
    };
    Ok(Image { width: width as usize, height: height as usize, rgba })
}

/// An 8-bit RGB picture with its values as stored in the file.
pub struct Rgb8 {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// sRGB, row by row from the top.
    pub rgb: Vec<u8>,
    /// The text that was asked for.
    pub text: Option<String>,
}

/// Read a `.png` of 8-bit RGB without decoding its values, and the text that stands under the name `text` in it.
///
/// # Errors
/// As [`read`]; `Unsupported` where pixels are stored otherwise.
pub fn read_rgb8(path: &Path, text: &str) -> Result<Rgb8> {
    let broken = |e: png::DecodingError| Error::input(path, "", format!("cannot be read as a PNG: {e}"));
    let bytes = read_file(path, MAX_BYTES)?;
    let limits = png::Limits { bytes: MAX_BYTES as usize };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(&bytes), limits);
    // An embedded colour profile would be unpacked needlessly.
    decoder.set_ignore_iccp_chunk(true);
    let mut reader = decoder.read_info().map_err(broken)?;
    let info = reader.info();
    check_size(path, info.width.into(), info.height.into(), bytes.len() as u64)?;
    if (info.color_type, info.bit_depth) != (png::ColorType::Rgb, png::BitDepth::Eight) {
        return Err(Error::unsupported(path, "a PNG of other pixels than 8-bit RGB as a tile"));
    }
    let size = [info.width, info.height];
    let text = info.uncompressed_latin1_text.iter().find(|t| t.keyword == text).map(|t| t.text.clone());
    let mut rgb = vec![0; reader.output_buffer_size().unwrap_or_default()];
    reader.next_frame(&mut rgb).map_err(broken)?;
    Ok(Rgb8 { size, rgb, text })
}

fn read_hdr(path: &Path) -> Result<Image> {
    use image::{DynamicImage, ImageDecoder, codecs::hdr::HdrDecoder};
    let broken = |e: image::ImageError| Error::input(path, "", format!("cannot be read as a Radiance HDR: {e}"));
    let bytes = read_file(path, MAX_BYTES)?;
    let decoder = HdrDecoder::new(Cursor::new(&bytes)).map_err(broken)?;
    let (width, height) = decoder.dimensions();
    check_size(path, width.into(), height.into(), bytes.len() as u64)?;
    let pixels = DynamicImage::from_decoder(decoder).map_err(broken)?.into_rgb32f();
    let rgba = pixels.pixels().map(|p| [p[0], p[1], p[2], 1.0]).collect();
    Ok(Image { width: width as usize, height: height as usize, rgba })
}

fn read_exr(path: &Path) -> Result<Image> {
    let Planes { width, height, mut planes, .. } = read_planes(path)?;
    let mut take = |name: &str| planes.remove(name);
    let alpha = take("A");
    let alpha = |i: usize| alpha.as_ref().map_or(1.0, |a| a[i]);
    let rgba = match (take("R"), take("G"), take("B"), take("Y")) {
        (Some(r), Some(g), Some(b), _) => (0..width * height).map(|i| [r[i], g[i], b[i], alpha(i)]).collect(),
        (None, None, None, Some(y)) => (0..width * height).map(|i| [y[i], y[i], y[i], alpha(i)]).collect(),
        _ => return Err(Error::unsupported(path, "an EXR layer without channels R, G and B, or Y")),
    };
    Ok(Image { width, height, rgba })
}

/// Channels and texts of the first layer of an EXR file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Planes {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Channels by name, `width * height` values each.
    pub planes: BTreeMap<String, Vec<f32>>,
    /// The layer's own attributes that are text.
    pub texts: BTreeMap<String, String>,
}

/// Read the first layer of an EXR file; subsampled channels are left out.
///
/// # Errors
/// As [`read`].
pub fn read_planes(path: &Path) -> Result<Planes> {
    let broken = |e: exr::error::Error| match e {
        exr::error::Error::NotSupported(e) => Error::unsupported(path, e.into_owned()),
        e => Error::input(path, "", format!("cannot be read as an EXR: {e}")),
    };
    let bytes = read_file(path, MAX_BYTES)?;
    let bytes = bytes.as_slice();
    // Sizes are checked in the header, before the crate allocates memory for pixels.
    let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(broken)?;
    for header in &meta.headers {
        let size = header.layer_size;
        check_size(path, size.width() as u64, size.height() as u64, bytes.len() as u64)?;
        // Bytes per pixel as stored, and as 32-bit numbers.
        let pixel = (header.channels.bytes_per_pixel + 4 * header.channels.list.len()) as u64;
        let needed = pixel.saturating_mul((size.width() * size.height()) as u64);
        if needed > MAX_BYTES {
            return Err(Error::Limit { what: format!("{}: bytes", path.display()), needed, allowed: MAX_BYTES });
        }
    }
    let layer = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(broken)?
        .layer_data;
    let (width, height) = (layer.size.width(), layer.size.height());
    let mut found = Planes { width, height, ..Planes::default() };
    for channel in &layer.channel_data.list {
        let values: Vec<f32> = channel.sample_data.values_as_f32().collect();
        if values.len() == width * height {
            found.planes.insert(channel.name.to_string(), values);
        }
    }
    for (name, value) in &layer.attributes.other {
        if let AttributeValue::Text(text) = value {
            found.texts.insert(name.to_string(), text.to_string());
        }
    }
    Ok(found)
}

/// Write an EXR file of 32-bit floats; it appears under its name once it is whole.
///
/// # Errors
/// `Io` where the file cannot be written; then nothing is left behind, and an older file under that name stays.
pub fn write_planes(path: &Path, planes: &Planes) -> Result<()> {
    use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage};
    let channels =
        planes.planes.iter().map(|(name, values)| AnyChannel::new(name.as_str(), FlatSamples::F32(values.clone())));
    let mut attributes = LayerAttributes::default();
    for (name, text) in &planes.texts {
        attributes.other.insert(name.as_str().into(), AttributeValue::Text(text.as_str().into()));
    }
    let size = (planes.width, planes.height);
    let layer = Layer::new(size, attributes, Encoding::default(), AnyChannels::sort(channels.collect()));
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer).write().to_buffered(&mut bytes).map_err(|e| Error::io(path, std::io::Error::other(e)))?;
    format::save(path, bytes.get_ref())
}

/// Write `width * height` sRGB pixels as an 8-bit PNG; it appears under its name once it is whole.
///
/// # Errors
/// As [`write_planes`].
pub fn write_png(path: &Path, width: usize, height: usize, rgb: &[[u8; 3]]) -> Result<()> {
    use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(rgb.as_flattened(), width as u32, height as u32, ExtendedColorType::Rgb8)
        .map_err(|e| Error::io(path, std::io::Error::other(e)))?;
    format::save(path, &bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transfer_curve_is_its_own_inverse_at_every_code() {
        for code in 0..=255u8 {
            assert_eq!(srgb8(srgb_decode(f32::from(code) / 255.0)), code);
        }
        assert_eq!([srgb8(f32::NAN), srgb8(-1.0), srgb8(9.0)], [0, 0, 255]);
    }

    #[test]
    fn png_is_read_as_it_was_written() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("é b.png");
        let rgb: Vec<[u8; 3]> = (0..6).map(|i| [i * 40, 255 - i, 7]).collect();
        write_png(&path, 3, 2, &rgb).unwrap();
        let image = read(&path).unwrap();
        assert_eq!((image.width, image.height, image.has_alpha()), (3, 2, false));
        let back: Vec<[u8; 3]> = image.rgba.iter().map(|p| [srgb8(p[0]), srgb8(p[1]), srgb8(p[2])]).collect();
        assert_eq!(back, rgb);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn png_that_claims_more_than_it_can_hold_is_refused() {
        let mut bytes = Cursor::new(Vec::new());
        image::RgbaImage::new(4, 4).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        let mut bytes = bytes.into_inner();
        // 33 kB are 34 MB at the most, and these pixels 138 MB.
        bytes[16..24].copy_from_slice(&[33792u32.to_be_bytes(), 1024u32.to_be_bytes()].concat());
        let sum = crc32fast::hash(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&sum.to_be_bytes());
        bytes.resize(32_871, 0);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        std::fs::write(&path, bytes).unwrap();
        let said = read(&path).unwrap_err().to_string();
        assert!(said.contains("too short for 33792×1024"), "{said}");
    }

    #[test]
    fn png_alpha_and_depth() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        image::RgbaImage::from_pixel(1, 1, image::Rgba([255, 0, 0, 51])).save(&path).unwrap();
        assert_eq!(read(&path).unwrap().rgba, [[0.2, 0.0, 0.0, 0.2]]);
        let gray = image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(1, 1, image::Luma([65535]));
        gray.save(&path).unwrap();
        assert_eq!(read(&path).unwrap().rgba, [[1.0; 4]]);
    }

    #[test]
    fn exr_is_linear_and_alpha_is_optional() {
        use exr::prelude::{f16, write_rgb_file, write_rgba_file};
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        write_rgba_file(&path, 2, 1, |x, _| (x as f32, 3.5f32, -1.0f32, 0.25f32)).unwrap();
        assert_eq!(read(&path).unwrap().rgba, [[0.0, 3.5, -1.0, 0.25], [1.0, 3.5, -1.0, 0.25]]);
        write_rgb_file(&path, 1, 1, |_, _| (f16::from_f32(0.5), f16::ONE, f16::ZERO)).unwrap();
        assert_eq!(read(&path).unwrap().rgba, [[0.5, 1.0, 0.0, 1.0]]);
    }

    #[test]
    fn planes_are_read_as_they_were_written() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        let planes = ["R", "G", "B", "even.R"].iter().enumerate();
        let planes = planes.map(|(k, name)| (name.to_string(), vec![k as f32, -0.5, 1e-20, 7e20, 0.0, 3.25])).collect();
        let texts = BTreeMap::from([("vtex:samples".to_owned(), "256".to_owned())]);
        let planes = Planes { width: 2, height: 3, planes, texts };
        write_planes(&path, &planes).unwrap();
        assert_eq!(read_planes(&path).unwrap(), planes);
        assert_eq!(read(&path).unwrap().rgba[0], [0.0, 1.0, 2.0, 1.0]);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn broken_files_are_refused_in_a_line() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        let line = |name: &str, bytes: &[u8]| {
            std::fs::write(path(name), bytes).unwrap();
            let line = read(&path(name)).unwrap_err().to_string();
            assert!(line.contains(name) && !line.contains('\n'), "{line}");
        };
        line("a.jpg", b"");
        line("a.png", b"");
        line("b.png", b"\x89PNG\r\n\x1a\n");
        line("a.exr", b"");
        line("b.exr", b"v/1\x01\x02\0\0\0");
        assert!(matches!(read(&path("missing.png")), Err(Error::Io { .. })));

        write_png(&path("whole.png"), 8, 8, &[[1, 2, 3]; 64]).unwrap();
        exr::prelude::write_rgb_file(path("whole.exr"), 8, 8, |x, y| (x as f32, y as f32, 1.0f32)).unwrap();
        for name in ["whole.png", "whole.exr"] {
            let bytes = std::fs::read(path(name)).unwrap();
            for cut in 0..bytes.len() - 12 {
                std::fs::write(path(name), &bytes[..cut]).unwrap();
                let _ = read(&path(name)); // An error or a picture with a part missing; never a panic.
            }
        }
        // A header that claims more pixels than the file can hold.
        let mut big = std::fs::read(path("b.png")).unwrap();
        big.extend(b"\0\0\0\x0dIHDR\0\0\x3f\0\0\0\x3f\0\x08\x02\0\0\0");
        big.extend(crc32fast::hash(&big[12..]).to_be_bytes());
        big.extend(b"\0\0\0\0IDAT\x35\xaf\x06\x1e");
        line("big.png", &big);
    }
}
