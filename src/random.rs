//! Pseudo-random numbers that are the same in every run and on every machine.
//!
//! Based on: G. Steele, D. Lea, C. Flood, *Fast Splittable Pseudorandom Number Generators*, OOPSLA 2014; G. Box, M. Muller,
//! *A Note on the Generation of Random Normal Deviates*, 1958.

/// SplitMix64. Seeds that differ in any bit give streams that have nothing to do with each other.
#[derive(Debug, Clone)]
pub struct SplitMix64(u64);

impl SplitMix64 {
    /// Start the sequence that belongs to `seed`.
    pub fn new(seed: u64) -> SplitMix64 {
        SplitMix64(seed)
    }

    /// 64 bits, any.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// In [−1, 1).
    pub fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    /// Draw from the normal distribution of mean 0 and standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.unit()));
        radius * libm::cos(std::f64::consts::TAU * self.unit())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_those_of_the_published_generator() {
        // The first three that the authors' Java program gives for the seed 1234567.
        let mut random = SplitMix64::new(1_234_567);
        assert_eq!([0; 3].map(|_: u64| random.bits()), [6457827717110365317, 3203168211198807973, 9817491932198370423]);
    }

    #[test]
    fn units_and_normals_have_their_means() {
        let mut random = SplitMix64::new(7);
        let n = 100_000;
        let of = |draw: &mut dyn FnMut() -> f64| {
            let (mut sum, mut squares) = (0.0, 0.0);
            for _ in 0..n {
                let v = draw();
                (sum, squares) = (sum + v, squares + v * v);
            }
            (sum / f64::from(n), squares / f64::from(n))
        };
        // Within four deviations of means over n: 1/√(12 n) and √(1/n), √(2/n).
        let (mean, square) = of(&mut || random.unit());
        assert!((mean - 0.5).abs() < 4e-3 && (square - 1.0 / 3.0).abs() < 4e-3, "{mean} {square}");
        let (mean, square) = of(&mut || random.normal());
        assert!(mean.abs() < 0.013 && (square - 1.0).abs() < 0.018, "{mean} {square}");
    }
}
