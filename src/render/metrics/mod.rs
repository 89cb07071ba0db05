//! Error measures of a picture against a reference.
//!
//! Everything is measured on linear Rec. 709, unless it says sRGB.

pub mod flip;
pub mod picture;
pub mod temporal;

use serde::Serialize;

use super::image_io::{Image, srgb_encode};
use crate::{Error, Result, par};

/// Added to the squared reference in relMSE, so that black pixels count finitely.
const RELATIVE_FLOOR: f64 = 0.01;

/// Options of [`compare`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Pixels per degree of visual angle for FLIP, 1 … 1000.
    pub ppd: f64,
    /// Pixels of this colour, linear, are not covered, in a picture without alpha. Two colours are the same where no
    /// channel differs by more than half an 8-bit sRGB step.
    pub background: Option<[f32; 3]>,
}

impl Default for Options {
    fn default() -> Self {
        Options { ppd: flip::DEFAULT_PPD, background: None }
    }
}

/// Measures over a set of pixels and the three channels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Measures {
    /// Pixels that were measured.
    pub pixels: u64,
    /// √ mean (a − b)².
    pub rmse: f64,
    /// Mean (a − b)² / (b² + 0.01).
    pub rel_mse: f64,
    /// −20 log₁₀ RMSE, dB; infinite (null in JSON) for equal pictures.
    pub psnr: f64,
    /// The same of sRGB values clamped to [0, 1].
    pub psnr_srgb: f64,
    /// Mean LDR-FLIP, 0 … 1.
    pub flip: f64,
    /// Mean luminance of a less that of b.
    pub bias: f64,
    /// `bias` over the mean luminance of b; absent where b is black.
    pub relative_bias: Option<f64>,
}

/// Share of the picture that is covered: the mean alpha, or the share of pixels that differ from the background.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Area {
    /// Share of picture a, in [0, 1].
    pub a: f64,
    /// Share of the reference b, in [0, 1].
    pub b: f64,
    /// `a / b`; absent where b is empty.
    pub ratio: Option<f64>,
}

/// Picture a against the reference b.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Pixels per row, of both pictures.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Pixels per degree of visual angle that FLIP was measured for.
    pub ppd: f64,
    /// Over all pixels.
    pub all: Measures,
    /// Over the pixels that a or b covers; absent where nothing tells what is covered, or nothing is.
    pub covered: Option<Measures>,
    /// Covered share of both; absent where nothing tells what is covered.
    pub area: Option<Area>,
    /// Pixels of a and of b with a NaN or an infinity; they were taken for black.
    pub not_finite: [u64; 2],
    /// LDR-FLIP of each pixel, row by row.
    #[serde(skip)]
    pub flip_map: Vec<f32>,
}

/// Compare `a` with the reference `b`.
///
/// # Errors
/// `Options` where the sizes differ or `options.ppd` is out of range.
pub fn compare(a: &Image, b: &Image, options: &Options) -> Result<Comparison> {
    if (a.width, a.height) != (b.width, b.height) {
        return Err(Error::Options(format!(
            "the pictures differ in size: {}×{} and {}×{}; render both at one size",
            a.width, a.height, b.width, b.height
        )));
    }
    if !(1.0..=1000.0).contains(&options.ppd) {
        return Err(Error::Options(format!("{} pixels a degree: the range is 1 to 1000", options.ppd)));
    }
    let (not_finite_a, a) = finite(a);
    let (not_finite_b, b) = finite(b);
    let (a, b) = (a.as_ref(), b.as_ref());
    let flip_map = flip::flip(a, b, options.ppd);
    let cover = Cover::of(a, options.background).zip(Cover::of(b, options.background));

    let rows = par::map(a.height, |y| {
        let (mut all, mut covered, mut area) = (Sums::default(), Sums::default(), [0.0; 2]);
        let row = y * a.width..(y + 1) * a.width;
        for ((&pa, &pb), &flip) in a.rgba[row.clone()].iter().zip(&b.rgba[row.clone()]).zip(&flip_map[row]) {
            all.add(pa, pb, flip);
            if let Some((ca, cb)) = cover {
                let shares = [ca.share(pa), cb.share(pb)];
                area[0] += shares[0];
                area[1] += shares[1];
                if shares[0] > 0.0 || shares[1] > 0.0 {
                    covered.add(pa, pb, flip);
                }
            }
        }
        (all, covered, area)
    });
    let (mut all, mut covered, mut area) = (Sums::default(), Sums::default(), [0.0; 2]);
    for (row_all, row_covered, row_area) in rows {
        all.merge(&row_all);
        covered.merge(&row_covered);
        area = [area[0] + row_area[0], area[1] + row_area[1]];
    }
    let pixels = all.pixels.max(1) as f64;
    Ok(Comparison {
        width: a.width,
        height: a.height,
        ppd: options.ppd,
        all: all.measures(),
        covered: (covered.pixels > 0).then(|| covered.measures()),
        area: cover.map(|_| Area {
            a: area[0] / pixels,
            b: area[1] / pixels,
            ratio: (area[1] > 0.0).then(|| area[0] / area[1]),
        }),
        not_finite: [not_finite_a, not_finite_b],
        flip_map,
    })
}

/// Criterion by which a pixel counts as covered.
#[derive(Clone, Copy)]
enum Cover {
    Alpha,
    /// sRGB-encoded.
    NotBackground([f32; 3]),
}

impl Cover {
    fn of(image: &Image, background: Option<[f32; 3]>) -> Option<Cover> {
        if image.has_alpha() {
            return Some(Cover::Alpha);
        }
        background.map(|colour| Cover::NotBackground(colour.map(srgb_encode)))
    }

    fn share(self, p: [f32; 4]) -> f64 {
        match self {
            Cover::Alpha => f64::from(p[3].clamp(0.0, 1.0)),
            Cover::NotBackground(colour) => {
                let same = (0..3).all(|k| (srgb_encode(p[k]) - colour[k]).abs() <= 0.5 / 255.0);
                f64::from(u8::from(!same))
            }
        }
    }
}

/// The picture with its pixels that are not finite made black, and how many they were.
fn finite(image: &Image) -> (u64, std::borrow::Cow<'_, Image>) {
    let broken = |p: &[f32; 4]| !p.iter().all(|c| c.is_finite());
    let count = image.rgba.iter().filter(|p| broken(p)).count() as u64;
    if count == 0 {
        return (0, std::borrow::Cow::Borrowed(image));
    }
    let mut mended = image.clone();
    for p in mended.rgba.iter_mut().filter(|p| broken(p)) {
        *p = [0.0, 0.0, 0.0, if p[3].is_finite() { p[3] } else { 1.0 }];
    }
    (count, std::borrow::Cow::Owned(mended))
}

/// Rec. 709.
fn luminance(p: [f32; 4]) -> f64 {
    0.2126 * f64::from(p[0]) + 0.7152 * f64::from(p[1]) + 0.0722 * f64::from(p[2])
}

#[derive(Default)]
struct Sums {
    pixels: u64,
    square: f64,
    relative: f64,
    square_srgb: f64,
    flip: f64,
    luminance: [f64; 2],
}

impl Sums {
    fn add(&mut self, a: [f32; 4], b: [f32; 4], flip: f32) {
        self.pixels += 1;
        self.flip += f64::from(flip);
        self.luminance[0] += luminance(a);
        self.luminance[1] += luminance(b);
        if a == b {
            return;
        }
        for k in 0..3 {
            let (ca, cb) = (f64::from(a[k]), f64::from(b[k]));
            let square = (ca - cb) * (ca - cb);
            self.square += square;
            self.relative += square / (cb * cb + RELATIVE_FLOOR);
            self.square_srgb += f64::from(srgb_encode(a[k]) - srgb_encode(b[k])).powi(2);
        }
    }

    fn merge(&mut self, other: &Sums) {
        self.pixels += other.pixels;
        self.square += other.square;
        self.relative += other.relative;
        self.square_srgb += other.square_srgb;
        self.flip += other.flip;
        self.luminance[0] += other.luminance[0];
        self.luminance[1] += other.luminance[1];
    }

    fn measures(&self) -> Measures {
        let pixels = self.pixels.max(1) as f64;
        let decibels = |mean_square: f64| -10.0 * libm::log10(mean_square);
        let mean_square = self.square / (3.0 * pixels);
        let [a, b] = self.luminance.map(|sum| sum / pixels);
        Measures {
            pixels: self.pixels,
            rmse: mean_square.sqrt(),
            rel_mse: self.relative / (3.0 * pixels),
            psnr: decibels(mean_square),
            psnr_srgb: decibels(self.square_srgb / (3.0 * pixels)),
            flip: self.flip / pixels,
            bias: a - b,
            relative_bias: (b > 0.0).then(|| (a - b) / b),
        }
    }
}

#[cfg(test)]
mod tests;
