//! Encoded images (PNG, JPEG, WebP, GIF, BMP, TGA) → [`Texture`], within limits.

use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use super::texture::Texture;

/// Why an image is not decoded.
#[derive(Debug, PartialEq)]
pub enum Refused {
    /// What is wrong with it.
    Image(String),
    /// Decoding takes so many bytes, more than there are.
    Memory(u64),
}

impl From<image::ImageError> for Refused {
    fn from(e: image::ImageError) -> Refused {
        Refused::Image(e.to_string())
    }
}

/// Most bytes that a decoder may allocate for a header: a packed colour profile is unpacked with it.
const MAX_BESIDE: u64 = 16 << 20;

/// A decoder of an image, whose header is read under a small limit of memory. The caller has to set limits before it reads the pixels.
///
/// # Errors
/// As the decoder has them: where the header is broken.
pub(crate) fn decoder(bytes: &[u8], format: ImageFormat) -> image::ImageResult<impl ImageDecoder + '_> {
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(MAX_BESIDE);
    let mut reader = ImageReader::with_format(std::io::Cursor::new(bytes), format);
    reader.limits(limits);
    reader.into_decoder()
}

/// Decode an image of at most `max_pixels` pixels, which takes at most `max_bytes` of memory meanwhile; `hint` is its file name
/// or MIME type, for TGA, which has no signature.
pub fn decode(name: &str, bytes: &[u8], hint: &str, max_pixels: u64, max_bytes: u64) -> Result<Texture, Refused> {
    let refused = |what: &str| Err(Refused::Image(what.into()));
    let tga = hint.to_ascii_lowercase().ends_with("tga");
    let format = match image::guess_format(bytes) {
        Ok(ImageFormat::Avif) => return refused("AVIF images are not read; save it as PNG, JPEG or WebP"),
        Ok(format) => format,
        Err(_) if tga => ImageFormat::Tga,
        Err(_) if bytes.starts_with(b"\xABKTX") => return refused("KTX2 textures are not read"),
        Err(_) if bytes.starts_with(b"DDS ") => return refused("DDS textures are not read"),
        Err(_) => return refused("not an image of a known format (png, jpeg, webp, gif, bmp, tga)"),
    };
    let mut decoder = decoder(bytes, format)?;
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > max_pixels {
        return refused(&format!("{width}×{height} pixels, the limit is {max_pixels} in all"));
    }
    // The stored pixels, the same as 8-bit RGBA, and a copy of these as texels.
    let needed = (4 * pixels).saturating_add(decoder.total_bytes().max(4 * pixels));
    if needed > max_bytes {
        return Err(Refused::Memory(needed));
    }
    let mut limits = Limits::default();
    // The decoded pixels at 16 bits a channel, and as much again for the decoder itself.
    limits.max_alloc = Some(pixels.saturating_mul(16).saturating_add(1 << 20));
    decoder.set_limits(limits)?;
    let rgba = DynamicImage::from_decoder(decoder)?.into_rgba8();
    let (width, height) = rgba.dimensions();
    let texels = rgba.as_raw().as_chunks::<4>().0.to_vec();
    Ok(Texture::new(name, width, height, texels))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn png(width: u32, height: u32) -> Vec<u8> {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let image = image::RgbaImage::from_fn(width, height, |x, y| image::Rgba([x as u8, y as u8, 7, 200]));
        image.write_to(&mut bytes, ImageFormat::Png).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn texels_come_row_by_row() {
        let t = decode("t", &png(3, 2), "", 6, 48).unwrap();
        assert_eq!((t.width, t.height, t.texels.len()), (3, 2, 6));
        assert_eq!(t.texels[4], [1, 1, 7, 200]);
    }

    #[test]
    fn sizes_and_broken_bytes_are_refused() {
        let why = |bytes: &[u8], hint: &str| match decode("t", bytes, hint, 5, 1 << 20) {
            Err(Refused::Image(what)) => what,
            other => panic!("{other:?}"),
        };
        assert!(why(&png(3, 2), "").contains("the limit is 5"));
        // Six pixels of RGBA, twice.
        assert_eq!(decode("t", &png(3, 2), "", 6, 47), Err(Refused::Memory(48)));
        let whole = png(64, 64);
        for cut in 0..whole.len() {
            let _ = decode("t", &whole[..cut], "", 1 << 20, 1 << 30);
        }
        assert!(decode("t", b"", "x.tga", 9, 999).is_err());
        assert!(why(b"\xABKTX 20\xBB", "").contains("KTX2"));
        assert!(why(b"\0\0\0\x1cftypavif\0\0\0\0avifmif1miaf", "").contains("save it as PNG"));
    }
}
