//! Shares of the parts of the sky that come to a place, as they are kept.

use crate::render::surround::{PARTS, Shares};

/// Shares in 255ths: a grid of them takes a quarter of the memory.
#[derive(Debug, Clone, Copy)]
pub struct SmallShares([u8; PARTS]);

impl SmallShares {
    pub fn new(shares: Shares) -> SmallShares {
        SmallShares(shares.map(|v| (255.0 * v.clamp(0.0, 1.0) + 0.5) as u8))
    }

    /// Add `weight` times these to `sum`.
    pub fn add_to(&self, sum: &mut Shares, weight: f32) {
        let weight = weight * (1.0 / 255.0);
        for (s, v) in sum.iter_mut().zip(self.0) {
            *s += weight * f32::from(v);
        }
    }
}
