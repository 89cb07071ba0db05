//! The rays of a pixel: its lanes, each with a cone, and the fine rays that sample a lane's part of the pixel where one ray is not
//! enough.

use super::camera::{Cone, View};
use super::reference::sampling::{PixelSample, pixel_sample};
use crate::geom::Ray;

/// Radius of a cone with a square cross-section, in widths: half the diagonal.
pub const REACH: f64 = 0.71;

/// One of a pixel's lanes.
#[derive(Debug, Clone, Copy)]
pub struct Lane {
    /// Pixel, counted from the upper left.
    pub x: u32,
    pub y: u32,
    /// Number of the lane, and the number of the pixel's lanes, a power of two. Lanes with numbers from that on are additional ones, at
    /// mirrored positions.
    pub index: u32,
    pub count: u32,
}

impl Lane {
    /// The lane's cone; `unit` is the length that becomes 1.
    pub fn cone(&self, view: &View, unit: f64) -> Cone {
        let [dx, dy] = self.offset();
        view.cone(f64::from(self.x) + dx, f64::from(self.y) + dy, unit)
    }

    /// Position of the lane in its pixel: a rotated grid, with row i in the bit-reversed column i.
    fn offset(&self) -> [f64; 2] {
        let bits = self.count.trailing_zeros();
        let row = self.index % self.count;
        let column = if bits == 0 { 0 } else { row.reverse_bits() >> (32 - bits) };
        let [x, y] = [column, row].map(|k| (f64::from(k) + 0.5) / f64::from(self.count));
        if self.index < self.count { [x, y] } else { [1.0 - x, y] }
    }

    /// The number in [0, 1) that chooses between two depths: ordered over a pixel's lanes, and over neighbouring pixels by
    /// interleaved gradient noise (J. Jimenez, *Next Generation Post Processing in Call of Duty*, SIGGRAPH 2014 courses).
    pub fn lod_dither(&self) -> f32 {
        let ramp = 0.067_110_56 * f64::from(self.x) + 0.005_837_15 * f64::from(self.y);
        let noise = (52.982_918_9 * ramp.fract()).fract();
        ((noise + f64::from(self.index)) / f64::from(self.count)) as f32 % 1.0
    }

    /// The lane's share of the pixel's `all` fine rays (a power of two).
    pub fn share(&self, all: u32) -> u32 {
        (all / self.count).max(1)
    }

    /// The lane's fine rays, [`Lane::share`] of them: over all lanes they fill the pixel evenly.
    pub fn fine(self, view: &View, unit: f64, all: u32) -> impl Iterator<Item = Ray> {
        (0..self.share(all)).map(move |k| {
            let [dx, dy] = self.sample(k, all).in_pixel();
            view.ray(f64::from(self.x) + dx, f64::from(self.y) + dy, unit)
        })
    }

    /// The sample of the lane's fine ray k. It is one of the reference's samples of the pixel, so that a picture and its reference do not
    /// differ in sampling.
    pub fn sample(&self, k: u32, all: u32) -> PixelSample {
        pixel_sample(self.x, self.y, self.index * self.share(all) + k)
    }
}

/// A lane's fine rays.
#[derive(Clone, Copy)]
pub struct FineRays {
    pub lane: Lane,
    /// Number of fine rays of the whole pixel.
    pub all: u32,
}
