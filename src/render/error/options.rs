//! Options of the measurement, and the light that it is lit by.

use crate::geom::DVec3;

/// Options of the measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Number of pixels per direction, depth and pixel size, 1 … 100 000.
    pub pixels: u32,
    /// Least number of rays per pixel, and the most that are cast to reach [`Options::noise`]; powers of two, 2 … 65 536.
    pub rays: [u32; 2],
    /// Noise of |ΔT| below which no more rays are cast.
    pub noise: f64,
    /// Rotate the 26 directions, so that none of them is one along which a bake measures.
    pub turned: bool,
    /// Number of depths to measure, counted from the finest.
    pub depths: usize,
    /// Seed of the rays.
    pub seed: u32,
}

impl Default for Options {
    fn default() -> Self {
        Options { pixels: 32, rays: [64, 4096], noise: 0.005, turned: false, depths: usize::MAX, seed: 1 }
    }
}

/// Direction from which the light of [`DepthError::shading`](super::DepthError::shading) and `shadow` comes, texel space.
pub const SUN: DVec3 = DVec3::new(-0.435_540_526_646_244_54, -0.532_327_310_345_41, 0.725_900_877_743_740_9);
