//! Random numbers that are the same in every run, and the awkward points and directions made of them.

use crate::geom::{DVec3, Vec3};
use crate::random::SplitMix64;

pub struct Random(SplitMix64);

impl Random {
    pub fn new(seed: u64, suite: u64, batch: u64) -> Random {
        let seed = seed ^ suite.wrapping_mul(0x9e6c_63d0_676a_9a99) ^ batch.wrapping_mul(0xd1b5_4a32_d192_ed03);
        let mut random = Random(SplitMix64::new(seed));
        random.bits();
        random
    }

    pub fn bits(&mut self) -> u64 {
        self.0.bits()
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.0.unit()
    }

    /// In [a, b).
    pub fn between(&mut self, a: f64, b: f64) -> f64 {
        a + (b - a) * self.unit()
    }

    /// One of 0 .. n.
    pub fn below(&mut self, n: u64) -> u64 {
        self.bits() % n.max(1)
    }

    /// True once in n times.
    pub fn once_in(&mut self, n: u64) -> bool {
        self.below(n) == 0
    }

    /// 10 to a power between `a` and `b`.
    pub fn magnitude(&mut self, a: f64, b: f64) -> f64 {
        libm::exp10(self.between(a, b))
    }

    /// In [-1, 1)^3.
    pub fn point(&mut self) -> DVec3 {
        DVec3::new(self.between(-1.0, 1.0), self.between(-1.0, 1.0), self.between(-1.0, 1.0))
    }

    /// Uniform over the sphere.
    pub fn direction(&mut self) -> DVec3 {
        let (z, a) = (self.between(-1.0, 1.0), self.between(0.0, std::f64::consts::TAU));
        let r = libm::sqrt((1.0 - z * z).max(0.0));
        DVec3::new(r * libm::cos(a), r * libm::sin(a), z)
    }

    /// A unit vector, often with components that are 0 or next to it, of either sign.
    pub fn awkward_direction(&mut self) -> Vec3 {
        let mut d = self.direction().as_vec3();
        for k in 0..3 {
            match self.below(8) {
                0 => d[k] = 0.0,
                1 => d[k] = -0.0,
                2 => d[k] *= self.magnitude(-20.0, -3.0) as f32,
                _ => {}
            }
        }
        // In f64: the square of what is next to 0 is none in f32.
        d.as_dvec3().try_normalize().map_or(Vec3::X, |d| d.as_vec3())
    }
}
