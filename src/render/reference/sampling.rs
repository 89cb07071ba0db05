//! Low-discrepancy sample points in the unit square, the same in every run.
//!
//! Based on: I. Sobol', *On the Distribution of Points in a Cube*, 1967; B. Burley, *Practical Hash-based Owen
//! Scrambling*, JCGT 2020.

use crate::geom::DVec3;

/// Sample `index` of the points of `seed`, in [0, 1)². Any 2^k points from a multiple of 2^k on have one point in each of
/// the 2^k boxes of any power-of-two proportion.
pub fn point(index: u32, seed: u32) -> [f64; 2] {
    let index = scramble(index, hash(seed));
    let x = scramble(index.reverse_bits(), hash(seed ^ 0x5bd1_e995));
    let y = scramble(sobol_second(index), hash(seed ^ 0xa136_aaad));
    [x, y].map(unit)
}

/// One sample of a pixel: a number in a set of points that belongs to the pixel alone. It gives the position in the pixel, and the
/// point of a light that is tested.
#[derive(Clone, Copy)]
pub struct PixelSample {
    pub index: u32,
    pub set: u32,
}

/// Sample `index` of the pixel (x, y). Even and odd samples are two independent sets of points.
pub fn pixel_sample(x: u32, y: u32, index: u32) -> PixelSample {
    PixelSample { index: index >> 1, set: hash(x ^ hash(y ^ hash(index & 1))) }
}

impl PixelSample {
    /// Position in the pixel, in pixels from its upper left corner.
    pub fn in_pixel(self) -> [f64; 2] {
        point(self.index, self.set)
    }

    /// A unit direction to a light around `dir` with the angular size 2 `radius` (radians), evenly distributed over its disc.
    pub fn towards(self, dir: DVec3, radius: f64) -> DVec3 {
        if radius <= 0.0 {
            return dir;
        }
        let [u, v] = point(self.index, hash(self.set));
        let (across, other) = dir.any_orthonormal_pair();
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * v);
        (dir + libm::tan(radius) * u.sqrt() * (cos * across + sin * other)).normalize()
    }
}

/// A uniform random number in [0, 1) for `index` and `seed`.
pub fn chance(index: u32, seed: u32) -> f64 {
    unit(hash(seed ^ hash(index)))
}

fn unit(x: u32) -> f64 {
    f64::from(x) / 4_294_967_296.0
}

/// The second dimension of the (0, 2)-sequence whose first is bit reversal.
fn sobol_second(mut index: u32) -> u32 {
    let (mut y, mut column) = (0, 1u32 << 31);
    while index != 0 {
        if index & 1 != 0 {
            y ^= column;
        }
        column ^= column >> 1;
        index >>= 1;
    }
    y
}

/// A random nested permutation: bit k of the result depends on the bits above it only.
fn scramble(x: u32, seed: u32) -> u32 {
    let mut x = x.reverse_bits();
    x = x.wrapping_add(seed);
    x ^= x.wrapping_mul(0x6c50_b47c);
    x ^= x.wrapping_mul(0xb82f_1e52);
    x ^= x.wrapping_mul(0xc7af_e638);
    x ^= x.wrapping_mul(0x8d22_f6e6);
    x.reverse_bits()
}

/// A mixing of 32 bits: each bit of the input changes half the bits of the result.
pub fn hash(mut x: u32) -> u32 {
    x = x.wrapping_add(0x9e37_79b9);
    x = (x ^ (x >> 16)).wrapping_mul(0x21f0_aaad);
    x = (x ^ (x >> 15)).wrapping_mul(0x735a_2d97);
    x ^ (x >> 15)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn aligned_runs_are_nets() {
        for seed in 0..20 {
            for (first, log2) in [(0u32, 6u32), (64, 6), (128, 4), (4096, 8)] {
                for across in 0..=log2 {
                    let (columns, rows) = (1u32 << across, 1u32 << (log2 - across));
                    let mut seen = vec![0; 1 << log2];
                    for i in first..first + (1 << log2) {
                        let [x, y] = point(i, seed);
                        let (column, row) = ((x * f64::from(columns)) as u32, (y * f64::from(rows)) as u32);
                        seen[(row * columns + column) as usize] += 1;
                    }
                    assert!(seen.iter().all(|&n| n == 1), "seed {seed}, {first}, 2^{log2}, {columns} columns");
                }
            }
        }
    }

    #[test]
    fn seeds_and_chances_are_apart() {
        let mean: f64 = (0..4096).map(|s| point(0, s)[0]).sum::<f64>() / 4096.0;
        // Standard error of the mean of 4096 uniform numbers: .0045.
        assert!((mean - 0.5).abs() < 0.02, "{mean}");
        let mean: f64 = (0..4096).map(|i| chance(i, 7)).sum::<f64>() / 4096.0;
        assert!((mean - 0.5).abs() < 0.02, "{mean}");
    }
}
