//! A small random generator (PCG-RXS-M-XS 32) and smooth value noise, the same on every machine.

use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

pub struct Random(u32);

impl Random {
    pub fn new(seed: u32) -> Self {
        Random(seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453))
    }

    fn next(&mut self) -> u32 {
        let state = self.0;
        self.0 = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
        (word >> 22) ^ word
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        f64::from(self.next()) / 4_294_967_296.0
    }

    /// Uniform in `centre` ± `spread`.
    pub fn around(&mut self, centre: f64, spread: f64) -> f64 {
        centre + spread * (2.0 * self.unit() - 1.0)
    }

    pub fn angle(&mut self) -> f64 {
        TAU * self.unit()
    }

    /// A point in the unit ball.
    pub fn ball(&mut self) -> DVec3 {
        loop {
            let p = DVec3::new(self.around(0.0, 1.0), self.around(0.0, 1.0), self.around(0.0, 1.0));
            if p.length_squared() <= 1.0 {
                return p;
            }
        }
    }
}

/// Smooth noise in [-1, 1] over the plane, wavelength about 1.
pub fn noise(p: DVec2, seed: u32) -> f64 {
    let cell = p.floor();
    let f = p - cell;
    let s = f * f * (3.0 - 2.0 * f);
    let corner = |dx: i32, dy: i32| {
        let (x, y) = (cell.x as i32 + dx, cell.y as i32 + dy);
        let key = (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77) ^ seed;
        let mut random = Random::new(key ^ (key >> 15));
        random.next();
        random.around(0.0, 1.0)
    };
    let (a, b) =
        (corner(0, 0) + s.x * (corner(1, 0) - corner(0, 0)), corner(0, 1) + s.x * (corner(1, 1) - corner(0, 1)));
    a + s.y * (b - a)
}

/// Octaves of [`noise`], each half as wide and half as high, in about [-1, 1].
pub fn fractal(p: DVec2, octaves: u32, seed: u32) -> f64 {
    let (mut sum, mut weight, mut scale) = (0.0, 0.5, 1.0);
    for octave in 0..octaves {
        sum += weight * noise(p * scale + DVec2::splat(f64::from(octave) * 17.3), seed.wrapping_add(octave));
        weight *= 0.5;
        scale *= 2.0;
    }
    sum
}

/// Sine and cosine by libm, so that the samples are the same on every machine.
pub fn turn(angle: f64) -> (f64, f64) {
    (libm::sin(angle), libm::cos(angle))
}
