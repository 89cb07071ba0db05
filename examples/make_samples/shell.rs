//! A nut as 32 slices of 8 bits: a hard shell with a seam, air, and a kernel of two folded halves.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

/// Pixels a side, and slices; a slice is as thick as two pixels are wide.
const SIDE: usize = 64;
const SLICES: usize = 32;

/// File names and bytes.
pub fn slices() -> Vec<(String, Vec<u8>)> {
    (0..SLICES).map(|k| (format!("stacks/shell/slice{}.png", k + 1), slice(k))).collect()
}

fn slice(k: usize) -> Vec<u8> {
    let centre = |n: usize, of: usize| n as f64 + 0.5 - 0.5 * of as f64;
    let mut pixels = Vec::with_capacity(SIDE * SIDE);
    for j in 0..SIDE {
        for i in 0..SIDE {
            pixels.push(value(centre(i, SIDE), centre(j, SIDE), 2.0 * centre(k, SLICES)));
        }
    }
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Best, FilterType::Adaptive)
        .write_image(&pixels, SIDE as u32, SIDE as u32, ExtendedColorType::L8)
        .expect("a picture of this size can be written");
    bytes
}

/// How much of a body is there whose border is `distance` pixels away, positive within.
fn share(distance: f64) -> f64 {
    (distance + 0.5).clamp(0.0, 1.0)
}

fn value(x: f64, y: f64, z: f64) -> u8 {
    let r = libm::sqrt(x * x + y * y + 0.8 * z * z);
    let turn = libm::atan2(y, x);
    // The shell: wrinkled, with a ridge along the seam.
    let wrinkles = 0.6 * libm::sin(9.0 * turn + 0.25 * z) * libm::cos(0.3 * z);
    let seam = 1.5 * libm::exp(-0.2 * y * y);
    let outer = 27.0 + wrinkles + seam;
    let shell = share(outer - r).min(share(r - 24.0));
    // The kernel: two halves, parted at the seam, with folds.
    let folds = libm::sin(0.55 * x) * libm::cos(0.5 * y)
        + libm::sin(0.5 * y) * libm::cos(0.6 * z)
        + libm::sin(0.6 * z) * libm::cos(0.55 * x);
    let kernel = share(19.0 + 2.0 * folds - r).min(share(x.abs() - 1.2));
    (220.0 * shell + 110.0 * kernel).round() as u8
}
