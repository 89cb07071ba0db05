//! A plot as pixels: shapes by plotters' own rasteriser, text by a bitmap font, averaged down at the end.

use std::convert::Infallible;

use embedded_graphics::mono_font::{MonoTextStyle, iso_8859_1::FONT_7X14};
use embedded_graphics::pixelcolor::BinaryColor;
use embedded_graphics::prelude::{DrawTarget, Drawable, OriginDimensions, Pixel, Point, Size};
use embedded_graphics::text::{Baseline, Text};
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{BackendColor, BackendCoord, BackendTextStyle, DrawingBackend, DrawingErrorKind, FontTransform};

/// Pixels, to be averaged down in the end.
pub struct Picture {
    width: u32,
    height: u32,
    rgb: Vec<[u8; 3]>,
}

/// Draws into a picture.
pub struct Raster<'a>(pub &'a mut Picture);

/// Size of the font's characters.
const CELL: (u32, u32) = (7, 14);
/// The size in points that a character of [`CELL`] stands for.
const POINTS: f64 = 14.0;

impl Picture {
    /// A white one.
    pub fn new(width: u32, height: u32) -> Picture {
        Picture { width, height, rgb: vec![[255; 3]; width as usize * height as usize] }
    }

    /// `n` by `n` pixels averaged to one.
    pub fn averaged(&self, n: usize) -> Vec<[u8; 3]> {
        let (width, columns) = (self.width as usize, self.width as usize / n);
        let mean = |i: usize| {
            let (x, y) = (i % columns * n, i / columns * n);
            std::array::from_fn(|k| {
                let sum: u32 = (0..n * n).map(|j| u32::from(self.rgb[(y + j / n) * width + x + j % n][k])).sum();
                (sum / (n * n) as u32) as u8
            })
        };
        (0..columns * (self.height as usize / n)).map(mean).collect()
    }

    fn blend(&mut self, x: i32, y: i32, colour: BackendColor) {
        let (Ok(column), Ok(row)) = (u32::try_from(x), u32::try_from(y)) else { return };
        if column >= self.width || row >= self.height {
            return;
        }
        let pixel = &mut self.rgb[row as usize * self.width as usize + column as usize];
        let (r, g, b) = colour.rgb;
        for (old, new) in pixel.iter_mut().zip([r, g, b]) {
            *old = (f64::from(*old) + colour.alpha * (f64::from(new) - f64::from(*old))).round() as u8;
        }
    }
}

/// How many pixels a pixel of the font is wide, for a text of so many points.
fn zoom(points: f64) -> u32 {
    ((points / POINTS).round() as u32).max(1)
}

/// Collects the pixels of a text.
#[derive(Default)]
struct Ink(Vec<Point>);

impl OriginDimensions for Ink {
    fn size(&self) -> Size {
        Size::new(u32::MAX, u32::MAX)
    }
}

impl DrawTarget for Ink {
    type Color = BinaryColor;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<BinaryColor>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        self.0.extend(pixels.into_iter().filter(|p| p.1 == BinaryColor::On).map(|p| p.0));
        Ok(())
    }
}

impl DrawingBackend for Raster<'_> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        (self.0.width, self.0.height)
    }

    fn ensure_prepared(&mut self) -> Result<(), DrawingErrorKind<Infallible>> {
        Ok(())
    }

    fn present(&mut self) -> Result<(), DrawingErrorKind<Infallible>> {
        Ok(())
    }

    fn draw_pixel(&mut self, (x, y): BackendCoord, colour: BackendColor) -> Result<(), DrawingErrorKind<Infallible>> {
        self.0.blend(x, y, colour);
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        let zoom = zoom(style.size());
        Ok((CELL.0 * zoom * text.chars().count() as u32, CELL.1 * zoom))
    }

    fn draw_text<S: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &S,
        pos: BackendCoord,
    ) -> Result<(), DrawingErrorKind<Infallible>> {
        let zoom = zoom(style.size()) as i32;
        let (width, height) = self.estimate_text_size(text, style)?;
        let shift_x = match style.anchor().h_pos {
            HPos::Left => 0,
            HPos::Center => -(width as i32) / 2,
            HPos::Right => -(width as i32),
        };
        let shift_y = match style.anchor().v_pos {
            VPos::Top => 0,
            VPos::Center => -(height as i32) / 2,
            VPos::Bottom => -(height as i32),
        };
        let mut ink = Ink::default();
        let font = MonoTextStyle::new(&FONT_7X14, BinaryColor::On);
        let Ok(_) = Text::with_baseline(text, Point::zero(), font, Baseline::Top).draw(&mut ink);
        for dot in ink.0 {
            for i in 0..zoom * zoom {
                let (x, y) = (shift_x + dot.x * zoom + i % zoom, shift_y + dot.y * zoom + i / zoom);
                let (x, y) = match style.transform() {
                    FontTransform::None => (x, y),
                    FontTransform::Rotate90 => (-y, x),
                    FontTransform::Rotate180 => (-x, -y),
                    FontTransform::Rotate270 => (y, -x),
                };
                self.0.blend(pos.0 + x, pos.1 + y, style.color());
            }
        }
        Ok(())
    }
}
