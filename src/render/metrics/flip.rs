//! FLIP: for each pixel, the difference that a viewer sees when flipping between two pictures.
//!
//! Based on: Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild, *FLIP: A Difference Evaluator for
//! Alternating Images*, HPG 2020 (LDR-FLIP; the constants are the paper's, with the contrast sensitivities, the
//! illuminant and the separation into one-dimensional filters of the authors' later public code).

use std::f64::consts::PI;

use crate::par;
use crate::render::image_io::{Image, unit};

/// Pixels per degree of visual angle for the paper's viewer: a 0.7 m wide display of 3840 pixels, seen from 0.7 m.
pub const DEFAULT_PPD: f64 = 3840.0 * PI / 180.0;

/// Exponents and thresholds of the paper: q_c, p_c, p_t, w (degrees), q_f.
const COLOUR_EXPONENT: f32 = 0.7;
const COLOUR_KNEE: f32 = 0.4;
const COLOUR_KNEE_VALUE: f32 = 0.95;
const FEATURE_WIDTH: f64 = 0.082;

/// D65.
const WHITE: [f32; 3] = [0.950_428_55, 1.0, 1.088_900_4];

/// Rows that one task works on: enough to make the rows above and below it, which are filtered twice, cheap.
const BAND: usize = 64;

/// The LDR-FLIP of every pixel, row by row, 0 (same) to 1; symmetric in `a` and `b`.
///
/// Colours are clamped to [0, 1]; alpha is ignored. `ppd` is in pixels per degree.
///
/// # Panics
/// Never, but the result is empty where the sizes differ.
pub fn flip(a: &Image, b: &Image, ppd: f64) -> Vec<f32> {
    if (a.width, a.height) != (b.width, b.height) || a.rgba.is_empty() {
        return Vec::new();
    }
    let filters = Filters::new(ppd);
    let farthest = largest_colour_difference();
    let mut map = vec![0.0; a.rgba.len()];
    par::chunks_mut(&mut map, a.width * BAND, |band, out| {
        let first = band * BAND;
        let seen = [a, b].map(|image| Features::new(image, first, out.len() / image.width, &filters));
        for (i, error) in out.iter_mut().enumerate() {
            let feature = seen[0].feature_difference(&seen[1], i);
            let colour = colour_difference(seen[0].lab(i), seen[1].lab(i), farthest);
            *error = libm::powf(colour, 1.0 - feature);
        }
    });
    map
}

/// One-dimensional filters, of odd length, centred.
struct Filters {
    /// Contrast sensitivity of Y, Cx, and the two parts of Cz.
    achromatic: Vec<f32>,
    red_green: Vec<f32>,
    blue_yellow: [Vec<f32>; 2],
    /// A Gaussian and its first and second derivative, for edges and points.
    gauss: Vec<f32>,
    edge: Vec<f32>,
    point: Vec<f32>,
}

impl Filters {
    fn new(ppd: f64) -> Self {
        // Amplitude and width of the Gaussians; the widest sets the radius of all.
        let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * ppd).ceil() as i64;
        let sensitivity = |a: f64, b: f64| -> Vec<f64> {
            let weight = |i: i64| (a * (PI / b).sqrt()).sqrt() * libm::exp(-(PI * i as f64 / ppd).powi(2) / b);
            (-radius..=radius).map(weight).collect()
        };
        let unit = |f: Vec<f64>| -> Vec<f32> {
            let sum: f64 = f.iter().sum();
            f.iter().map(|w| (w / sum) as f32).collect()
        };
        let blue_yellow = [sensitivity(34.1, 0.04), sensitivity(13.5, 0.025)];
        // The sum of two separable filters: together they have to sum to 1 over the plane.
        let norm = blue_yellow.iter().map(|f| f.iter().sum::<f64>().powi(2)).sum::<f64>().sqrt();

        let sigma = 0.5 * FEATURE_WIDTH * ppd;
        let radius = (3.0 * sigma).ceil() as i64;
        let gauss = |x: f64| libm::exp(-x * x / (2.0 * sigma * sigma));
        let sample = |f: &dyn Fn(f64) -> f64| (-radius..=radius).map(|i| f(i as f64)).collect::<Vec<f64>>();
        Filters {
            achromatic: unit(sensitivity(1.0, 0.0047)),
            red_green: unit(sensitivity(1.0, 0.0053)),
            blue_yellow: blue_yellow.map(|f| f.iter().map(|w| (w / norm) as f32).collect()),
            gauss: unit(sample(&gauss)),
            edge: balanced(sample(&|x| -x * gauss(x))),
            point: balanced(sample(&|x| (x * x / (sigma * sigma) - 1.0) * gauss(x))),
        }
    }
}

/// Scale the positive weights to sum to 1 and the negative ones to −1.
fn balanced(f: Vec<f64>) -> Vec<f32> {
    let positive: f64 = f.iter().map(|w| w.max(0.0)).sum();
    let negative: f64 = f.iter().map(|w| (-w).max(0.0)).sum();
    let scale = |w: f64, sum: f64| if sum > 0.0 { (w / sum) as f32 } else { 0.0 };
    f.iter().map(|&w| scale(w, if w > 0.0 { positive } else { negative })).collect()
}

/// A band of rows of one picture after the filters of the eye: YCxCz, and gradients and second derivatives of Y in [0, 1].
struct Features {
    ycxcz: [Vec<f32>; 3],
    edge: [Vec<f32>; 2],
    point: [Vec<f32>; 2],
}

impl Features {
    /// Rows `first .. first + rows` of `image`.
    fn new(image: &Image, first: usize, rows: usize, filters: &Filters) -> Self {
        let reach = (filters.achromatic.len() / 2).max(filters.gauss.len() / 2);
        let top = first.saturating_sub(reach);
        let bottom = (first + rows + reach).min(image.height);
        let pixels = &image.rgba[top * image.width..bottom * image.width];
        let mut planes: [Vec<f32>; 3] = std::array::from_fn(|_| Vec::with_capacity(pixels.len()));
        for p in pixels {
            for (plane, c) in planes.iter_mut().zip(ycxcz([p[0], p[1], p[2]])) {
                plane.push(c);
            }
        }
        let [y, cx, cz] = planes;
        let gray: Vec<f32> = y.iter().map(|y| (y + 16.0) / 116.0).collect();

        let across = |plane: &[f32], filter: &[f32]| convolve_rows(plane, image.width, filter);
        let down = |plane: &[f32], filter: &[f32]| convolve_columns(plane, image.width, filter, first - top, rows);
        let both = |plane: &[f32], filter: &[f32]| down(&across(plane, filter), filter);
        let mut blue_yellow = both(&cz, &filters.blue_yellow[0]);
        for (sum, part) in blue_yellow.iter_mut().zip(both(&cz, &filters.blue_yellow[1])) {
            *sum += part;
        }
        let smooth = across(&gray, &filters.gauss);
        Features {
            ycxcz: [both(&y, &filters.achromatic), both(&cx, &filters.red_green), blue_yellow],
            edge: [down(&across(&gray, &filters.edge), &filters.gauss), down(&smooth, &filters.edge)],
            point: [down(&across(&gray, &filters.point), &filters.gauss), down(&smooth, &filters.point)],
        }
    }

    /// Pixel `i` in CIELAB, its chroma scaled by lightness after Hunt.
    fn lab(&self, i: usize) -> [f32; 3] {
        hunt_lab(ycxcz_to_rgb([self.ycxcz[0][i], self.ycxcz[1][i], self.ycxcz[2][i]]).map(|c| c.clamp(0.0, 1.0)))
    }

    /// Difference of edge or point strength at pixel `i`, 0 … 1.
    fn feature_difference(&self, other: &Features, i: usize) -> f32 {
        let length = |v: &[Vec<f32>; 2]| (v[0][i] * v[0][i] + v[1][i] * v[1][i]).sqrt();
        let edge = (length(&self.edge) - length(&other.edge)).abs();
        let point = (length(&self.point) - length(&other.point)).abs();
        (edge.max(point) * std::f32::consts::FRAC_1_SQRT_2).sqrt()
    }
}

/// Each row convolved with `filter`, its ends repeated beyond the border.
fn convolve_rows(plane: &[f32], width: usize, filter: &[f32]) -> Vec<f32> {
    let reach = filter.len() / 2;
    let mut out = vec![0.0; plane.len()];
    let mut padded = vec![0.0; width + 2 * reach];
    for (row, out) in plane.chunks_exact(width).zip(out.chunks_exact_mut(width)) {
        padded[..reach].fill(row[0]);
        padded[reach..reach + width].copy_from_slice(row);
        padded[reach + width..].fill(row[width - 1]);
        for (k, &weight) in filter.iter().enumerate() {
            for (o, p) in out.iter_mut().zip(&padded[k..k + width]) {
                *o += weight * p;
            }
        }
    }
    out
}

/// Rows `first .. first + rows` of `plane`, each column convolved with `filter`, its ends repeated beyond the plane.
fn convolve_columns(plane: &[f32], width: usize, filter: &[f32], first: usize, rows: usize) -> Vec<f32> {
    let reach = filter.len() / 2;
    let last = plane.len() / width - 1;
    let mut out = vec![0.0; rows * width];
    for (y, out) in out.chunks_exact_mut(width).enumerate() {
        for (k, &weight) in filter.iter().enumerate() {
            let row = (first + y + k).saturating_sub(reach).min(last);
            for (o, p) in out.iter_mut().zip(&plane[row * width..(row + 1) * width]) {
                *o += weight * p;
            }
        }
    }
    out
}

/// HyAB distance, raised to q_c and bent so that [0, knee) of the range takes [0, .95) of the result.
fn colour_difference(a: [f32; 3], b: [f32; 3], farthest: f32) -> f32 {
    let difference = libm::powf(hyab(a, b), COLOUR_EXPONENT);
    let knee = COLOUR_KNEE * farthest;
    if difference < knee {
        difference * COLOUR_KNEE_VALUE / knee
    } else {
        COLOUR_KNEE_VALUE + (1.0 - COLOUR_KNEE_VALUE) * (difference - knee) / (farthest - knee)
    }
}

/// City-block in lightness, Euclidean in chroma (Abasi et al. 2020).
fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] - b[0]).abs() + ((a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)).sqrt()
}

/// Between the green and the blue primary.
fn largest_colour_difference() -> f32 {
    libm::powf(hyab(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0])), COLOUR_EXPONENT)
}

/// Linear Rec. 709 → XYZ relative to the white.
fn relative_xyz([r, g, b]: [f32; 3]) -> [f32; 3] {
    [
        (0.412_386_57 * r + 0.357_591_5 * g + 0.180_450_49 * b) / WHITE[0],
        0.212_636_82 * r + 0.715_183 * g + 0.072_180_2 * b,
        (0.019_330_62 * r + 0.119_197_16 * g + 0.950_372_6 * b) / WHITE[2],
    ]
}

/// The opponent space that the filters work in, from linear Rec. 709 clamped to [0, 1]; NaN is taken for 0.
fn ycxcz(rgb: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = relative_xyz(rgb.map(unit));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Inverse of [`ycxcz`].
fn ycxcz_to_rgb([y, cx, cz]: [f32; 3]) -> [f32; 3] {
    let y = (y + 16.0) / 116.0;
    let (x, z) = ((y + cx / 500.0) * WHITE[0], (y - cz / 200.0) * WHITE[2]);
    [
        3.241_003_3 * x - 1.537_398_9 * y - 0.498_615_86 * z,
        -0.969_224_3 * x + 1.875_930_1 * y + 0.041_554_224 * z,
        0.055_639_423 * x - 0.204_011_2 * y + 1.057_149 * z,
    ]
}

/// Linear Rec. 709 in [0, 1] → CIELAB with chroma scaled by L / 100.
fn hunt_lab(rgb: [f32; 3]) -> [f32; 3] {
    const EDGE: f32 = 6.0 / 29.0;
    let bend = |t: f32| {
        if t > EDGE * EDGE * EDGE { libm::cbrtf(t) } else { t / (3.0 * EDGE * EDGE) + 4.0 / 29.0 }
    };
    let [x, y, z] = relative_xyz(rgb).map(bend);
    let lightness = 116.0 * y - 16.0;
    [lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z)]
}
