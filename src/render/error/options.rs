//! Options of the measurement, and the light that it is lit by.

use crate::geom::DVec3;

/// Options of the measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Pixels a direction, depth and size, 1 … 100 000.
    pub pixels: u32,
    /// Rays a pixel at the least, and at the most where it takes so many for [`Options::noise`]; powers of two, 2 … 65 536.
    pub rays: [u32; 2],
    /// The noise of |ΔT| that is good enough.
    pub noise: f64,
    /// Turn the 26 directions, so that none of them is one that a bake measures along.
    pub turned: bool,
    /// Depths to measure, finest first.
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
