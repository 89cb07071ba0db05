//! The picture: linear radiance, and how it is stored.

use std::path::Path;

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use super::image_io::{Image, srgb8};
use crate::format;
use crate::scene::files::extension;
use crate::{Error, Result};

/// Linear Rec. 709 radiance with the background behind it, and alpha: the share of the pixel that is not background.
/// Over a black background that is premultiplied alpha.
#[derive(Debug, Clone, PartialEq)]
pub struct Film {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Row by row from the upper left.
    pub pixels: Vec<[f32; 4]>,
}

impl Film {
    /// The picture, to be compared with others.
    pub fn image(&self) -> Image {
        Image { width: self.width as usize, height: self.height as usize, rgba: self.pixels.clone() }
    }

    /// Multiply the radiance.
    pub fn expose(&mut self, factor: f32) {
        for p in &mut self.pixels {
            p[..3].iter_mut().for_each(|c| *c *= factor);
        }
    }

    /// If more than half of the picture is brighter than `white`: that share of the picture, and the exposure in stops that would bring nine
    /// tenths of it below 1.
    pub fn overexposed(&self, white: f32) -> Option<(f64, f64)> {
        // White itself is not counted, since it may be intended, as for a background.
        let white = 1.001 * white;
        let mut brightest: Vec<f32> = self.pixels.iter().map(|p| p[0].max(p[1]).max(p[2])).collect();
        let count = brightest.iter().filter(|&&c| c > white).count();
        let share = count as f64 / brightest.len().max(1) as f64;
        if share <= 0.5 {
            return None;
        }
        brightest.sort_unstable_by(f32::total_cmp);
        let most = brightest.get(brightest.len() * 9 / 10)?;
        Some((share, -f64::from(*most).log2()))
    }

    /// Whether [`Film::save`] knows the path's extension.
    pub fn check_name(path: &Path) -> Result<()> {
        match extension(path).as_str() {
            "exr" | "png" => Ok(()),
            _ => {
                let what = format!("{}: the picture's name must end in .png or .exr", path.display());
                Err(Error::Options(what))
            }
        }
    }

    /// Store as `.exr` (linear RGBA, 32-bit float) or `.png` (sRGB, 8 bit, clipped), by the path's extension. The file
    /// appears under its name once it is whole.
    pub fn save(&self, path: &Path) -> Result<()> {
        Self::check_name(path)?;
        let bytes = if extension(path) == "exr" { self.exr(path)? } else { self.png(path)? };
        format::save(path, &bytes)
    }

    /// sRGB, 8 bit, clipped, row by row.
    pub fn rgb8(&self) -> Vec<u8> {
        self.pixels.iter().flat_map(|p| [p[0], p[1], p[2]].map(srgb8)).collect()
    }

    fn png(&self, path: &Path) -> Result<Vec<u8>> {
        let rgb = self.rgb8();
        if rgb.len() as u64 != 3 * u64::from(self.width) * u64::from(self.height) {
            return Err(Error::input(path, "", "the film's size does not match its pixels"));
        }
        let mut out = Vec::new();
        PngEncoder::new(&mut out)
            .write_image(&rgb, self.width, self.height, ExtendedColorType::Rgb8)
            .map_err(|e| Error::io(path, std::io::Error::other(e)))?;
        Ok(out)
    }

    fn exr(&self, path: &Path) -> Result<Vec<u8>> {
        use exr::prelude::*;
        let size = (self.width as usize, self.height as usize);
        let pixel = |at: Vec2<usize>| {
            let [r, g, b, a] = self.pixels.get(at.1 * size.0 + at.0).copied().unwrap_or_default();
            (r, g, b, a)
        };
        let image = Image::from_channels(size, SpecificChannels::rgba(pixel));
        let mut out = std::io::Cursor::new(Vec::new());
        image.write().to_buffered(&mut out).map_err(|e| crate::Error::io(path, std::io::Error::other(e)))?;
        Ok(out.into_inner())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_much_light_is_noticed() {
        let film = |bright: usize, value: f32| {
            let pixels = (0..100).map(|i| if i < bright { [value, 0.5, 0.1, 1.0] } else { [0.2; 4] }).collect();
            Film { width: 10, height: 10, pixels }
        };
        assert_eq!(film(85, 8.0).overexposed(1.0), Some((0.85, -3.0)));
        assert_eq!(film(50, 8.0).overexposed(1.0), None);
        // A white background.
        assert_eq!(film(100, 1.0).overexposed(1.0), None);
        assert_eq!(Film { width: 0, height: 0, pixels: vec![] }.overexposed(1.0), None);
    }

    #[test]
    fn films_round_trip() {
        let dir = tempfile::tempdir().unwrap();
        let film = Film { width: 2, height: 1, pixels: vec![[0.25, 5.0, 0.0, 1.0], [0.0, 0.0, 1e-3, 0.5]] };
        for name in ["a.exr", "b.png"] {
            film.save(&dir.path().join(name)).unwrap();
        }
        let back = exr::prelude::read_first_rgba_layer_from_file(
            dir.path().join("a.exr"),
            |size, _| vec![[0.0f32; 4]; size.width() * size.height()],
            |pixels, at, (r, g, b, a): (f32, f32, f32, f32)| pixels[at.y() * 2 + at.x()] = [r, g, b, a],
        );
        assert_eq!(back.unwrap().layer_data.channel_data.pixels, film.pixels);
        assert_eq!(image::open(dir.path().join("b.png")).unwrap().to_rgb8().get_pixel(0, 0).0, [137, 255, 0]);
        assert_eq!(std::fs::read_dir(&dir).unwrap().count(), 2);
        assert!(film.save(&dir.path().join("c.jpeg")).is_err());
        assert!(film.save(&dir.path().join("no/such/folder.png")).is_err());
    }
}
