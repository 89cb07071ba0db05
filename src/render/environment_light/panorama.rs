//! Pictures of all directions (latitude and longitude), and the sun in them.
//!
//! The middle of the picture is towards +X, its left quarter towards −Z, its upper edge +Y, as in three.js and Blender.

use std::f64::consts::{PI, TAU};
use std::path::Path;

use super::sun::Sun;
use crate::geom::{DVec3, Vec3};
use crate::render::air::luminance;
use crate::render::image_io::{self, Image};
use crate::{Error, Result};

/// Radiance by direction, linear Rec. 709.
pub struct Panorama {
    width: usize,
    height: usize,
    pixels: Vec<[f32; 3]>,
}

/// A pixel belongs to a sun only if it is this many times as bright as the mean of the picture.
const SUN_CONTRAST: f64 = 200.0;
/// Largest angle between the brightest pixel and others of the same sun, radians.
const MAX_SUN_RADIUS: f64 = 0.045;
/// Least share of the picture's irradiance that a sun must bring.
const MIN_SUN_SHARE: f64 = 0.1;

impl Panorama {
    /// Read a `.exr`, `.hdr` or `.png`.
    pub fn read(path: &Path) -> Result<(Panorama, Option<Sun>)> {
        Panorama::new(image_io::read(path)?).map_err(|what| Error::input(path, "", what))
    }

    /// From a picture; the error says what is wrong with it.
    pub fn new(image: Image) -> std::result::Result<(Panorama, Option<Sun>), String> {
        let Image { width, height, rgba } = image;
        if width != 2 * height || height < 2 {
            return Err(format!("a picture of the sky is twice as wide as high, and this one is {width}×{height}"));
        }
        if let Some(i) = rgba.iter().position(|p| !p[..3].iter().all(|c| c.is_finite())) {
            return Err(format!("the pixel ({}, {}) holds no finite radiance", i % width, i / width));
        }
        let pixels = rgba.into_iter().map(|[r, g, b, _]| [r.max(0.0), g.max(0.0), b.max(0.0)]).collect();
        let mut panorama = Panorama { width, height, pixels };
        let sun = panorama.take_sun();
        Ok((panorama, sun))
    }

    fn direction(&self, x: usize, y: usize) -> DVec3 {
        let (sin, cos) = libm::sincos(TAU * ((x as f64 + 0.5) / self.width as f64 - 0.5));
        let (across, up) = libm::sincos(PI * (y as f64 + 0.5) / self.height as f64);
        DVec3::new(across * cos, up, across * sin)
    }

    /// Solid angle of a pixel of row y.
    fn solid_angle(&self, y: usize) -> f64 {
        let edge = |y: usize| libm::cos(PI * y as f64 / self.height as f64);
        TAU / self.width as f64 * (edge(y) - edge(y + 1))
    }

    fn light(&self, i: usize) -> DVec3 {
        Vec3::from_array(self.pixels[i]).as_dvec3()
    }

    /// Find the sun and remove it from the picture: its pixels become as bright as the sky around them.
    fn take_sun(&mut self) -> Option<Sun> {
        let (mut mean, mut brightest) = (0.0, (0.0, 0));
        for i in 0..self.pixels.len() {
            let own = luminance(self.light(i));
            mean += own * self.solid_angle(i / self.width) / (4.0 * PI);
            if own > brightest.0 {
                brightest = (own, i);
            }
        }
        // The brightest pixel must stand out against the mean, which cannot exceed it.
        if brightest.0 <= SUN_CONTRAST * mean.min(brightest.0) || mean <= 0.0 {
            return None;
        }
        let towards = self.direction(brightest.1 % self.width, brightest.1 / self.width);
        let angle = |dir: DVec3| libm::asin(towards.cross(dir).length().min(1.0));
        let (mut inside, mut ring) = (Vec::new(), (DVec3::ZERO, 0.0));
        for i in 0..self.pixels.len() {
            let dir = self.direction(i % self.width, i / self.width);
            if dir.dot(towards) < 0.9 {
                continue;
            }
            let size = self.solid_angle(i / self.width);
            match angle(dir) {
                apart if apart <= MAX_SUN_RADIUS => inside.push((i, dir, size)),
                apart if apart <= 1.5 * MAX_SUN_RADIUS => ring = (ring.0 + size * self.light(i), ring.1 + size),
                _ => {}
            }
        }
        let around = if ring.1 > 0.0 { ring.0 / ring.1 } else { DVec3::ZERO };
        let above = |i: usize| (self.light(i) - around).max(DVec3::ZERO);
        let irradiance: DVec3 = inside.iter().map(|&(i, _, size)| size * above(i)).sum();
        let centre: DVec3 = inside.iter().map(|&(i, dir, size)| size * luminance(above(i)) * dir).sum();
        if luminance(irradiance) < MIN_SUN_SHARE * PI * mean {
            return None;
        }
        let towards = centre.try_normalize()?;
        let area = luminance(irradiance) / brightest.0;
        for (i, _, _) in inside {
            let kept = self.light(i).min(around).as_vec3();
            self.pixels[i] = kept.to_array();
        }
        Some(Sun { towards, irradiance, radius: (area / PI).sqrt().clamp(1e-4, MAX_SUN_RADIUS) })
    }

    /// The picture reduced to at most 128 rows by averaging blocks of pixels, for sums over all directions.
    pub fn reduced(&self) -> Panorama {
        let block = self.height.div_ceil(128);
        let (width, height) = (self.width.div_ceil(block), self.height.div_ceil(block));
        let mut sums = vec![(Vec3::ZERO, 0.0f32); width * height];
        for (i, pixel) in self.pixels.iter().enumerate() {
            let (sum, count) = &mut sums[i / self.width / block * width + i % self.width / block];
            *sum += Vec3::from_array(*pixel);
            *count += 1.0;
        }
        Panorama { width, height, pixels: sums.into_iter().map(|(sum, count)| (sum / count).to_array()).collect() }
    }

    /// Radiance from a unit direction, bilinear between pixels.
    pub fn radiance(&self, dir: DVec3) -> Vec3 {
        let x = (libm::atan2(dir.z, dir.x) / TAU + 0.5) * self.width as f64 - 0.5;
        let y = libm::acos(dir.y.clamp(-1.0, 1.0)) / PI * self.height as f64 - 0.5;
        let (fx, fy) = ((x - x.floor()) as f32, (y - y.floor()) as f32);
        let column = |k: f64| (x.floor() + k).rem_euclid(self.width as f64) as usize % self.width;
        let row = |k: f64| (y.floor() + k).clamp(0.0, (self.height - 1) as f64) as usize;
        let at = |i: f64, j: f64| Vec3::from_array(self.pixels[row(j) * self.width + column(i)]);
        at(0.0, 0.0).lerp(at(1.0, 0.0), fx).lerp(at(0.0, 1.0).lerp(at(1.0, 1.0), fx), fy)
    }
}
