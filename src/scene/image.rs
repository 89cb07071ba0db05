//! Encoded images (PNG, JPEG, WebP, GIF, BMP, TGA) → [`Texture`], within limits.

use image::{ImageFormat, ImageReader, Limits};

use super::texture::Texture;

/// Decode an image of at most `max_pixels` pixels; `hint` is its file name or MIME type, for TGA, which has no
/// signature. The error says what is wrong with it.
pub fn decode(name: &str, bytes: &[u8], hint: &str, max_pixels: u64) -> Result<Texture, String> {
    let tga = hint.to_ascii_lowercase().ends_with("tga");
    let format = match image::guess_format(bytes) {
        Ok(format) => format,
        Err(_) if tga => ImageFormat::Tga,
        Err(_) if bytes.starts_with(b"\xABKTX") => return Err("KTX2 textures are not read".into()),
        Err(_) if bytes.starts_with(b"DDS ") => return Err("DDS textures are not read".into()),
        Err(_) => return Err("not an image of a known format (png, jpeg, webp, gif, bmp, tga)".into()),
    };
    let reader = || ImageReader::with_format(std::io::Cursor::new(bytes), format);
    let (width, height) = reader().into_dimensions().map_err(|e| e.to_string())?;
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > max_pixels {
        return Err(format!("{width}×{height} pixels, the limit is {max_pixels} in all"));
    }
    let mut limits = Limits::default();
    // The decoded pixels at 16 bits a channel, and as much again for the decoder itself.
    limits.max_alloc = Some(pixels.saturating_mul(16).saturating_add(1 << 20));
    let mut reader = reader();
    reader.limits(limits);
    let rgba = reader.decode().map_err(|e| e.to_string())?.into_rgba8();
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
        let t = decode("t", &png(3, 2), "", 6).unwrap();
        assert_eq!((t.width, t.height, t.texels.len()), (3, 2, 6));
        assert_eq!(t.texels[4], [1, 1, 7, 200]);
    }

    #[test]
    fn sizes_and_broken_bytes_are_refused() {
        assert!(decode("t", &png(3, 2), "", 5).unwrap_err().contains("the limit is 5"));
        let whole = png(64, 64);
        for cut in 0..whole.len() {
            let _ = decode("t", &whole[..cut], "", 1 << 20);
        }
        assert!(decode("t", b"", "x.tga", 9).is_err());
        assert!(decode("t", b"\xABKTX 20\xBB", "", 9).unwrap_err().contains("KTX2"));
    }
}
