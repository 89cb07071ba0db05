//! Bias and gain: curves over [0, 1] that shape noise.
//!
//! Based on: K. Perlin, E. Hoffert, *Hypertexture*, SIGGRAPH 1989.

pub use crate::noise::Noise;

/// Perlin's bias: 0 and 1 stay, 1/2 becomes `b` in (0, 1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bias {
    exponent: f64,
}

impl Bias {
    /// The bias that maps 1/2 to `b` in (0, 1).
    pub fn new(b: f64) -> Bias {
        Bias { exponent: if b == 0.5 { 1.0 } else { libm::log(b) / libm::log(0.5) } }
    }

    /// The value at `t` in [0, 1], and the derivative.
    #[inline]
    pub fn at(self, t: f64) -> (f64, f64) {
        if self.exponent == 1.0 {
            return (t, 1.0);
        }
        let t = t.max(1e-12);
        // A third of the work of `libm::pow`, which gives more bits than are asked for; and `libm::log` is quicker than its log2.
        let value = libm::exp2(self.exponent * std::f64::consts::LOG2_E * libm::log(t));
        (value, self.exponent * value / t)
    }
}

/// Perlin's gain: 0, 1/2 and 1 stay, and the middle rises the steeper the nearer `g` in (0, 1) is to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gain {
    half: Bias,
}

impl Gain {
    /// The gain of strength `g` in (0, 1); 1/2 is the identity.
    pub fn new(g: f64) -> Gain {
        Gain { half: Bias::new(1.0 - g) }
    }

    /// The value at `t` in [0, 1], and the derivative.
    #[inline]
    pub fn at(self, t: f64) -> (f64, f64) {
        if t < 0.5 {
            let (v, d) = self.half.at(2.0 * t);
            (0.5 * v, d)
        } else {
            let (v, d) = self.half.at(2.0 - 2.0 * t);
            (1.0 - 0.5 * v, d)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bias_and_gain_keep_their_points() {
        for b in [0.1, 0.5, 0.8] {
            let (bias, gain) = (Bias::new(b), Gain::new(b));
            assert!((bias.at(0.5).0 - b).abs() < 1e-12);
            assert!(bias.at(0.0).0.abs() < 1e-2 && (bias.at(1.0).0 - 1.0).abs() < 1e-12);
            assert!((gain.at(0.5).0 - 0.5).abs() < 1e-12);
            for t in [0.2, 0.45, 0.7] {
                let h = 1e-6;
                for f in [&|t| bias.at(t) as (f64, f64), &|t| gain.at(t)] as [&dyn Fn(f64) -> (f64, f64); 2] {
                    let slope = (f(t + h).0 - f(t - h).0) / (2.0 * h);
                    assert!((slope - f(t).1).abs() < 1e-5);
                }
            }
        }
    }
}
