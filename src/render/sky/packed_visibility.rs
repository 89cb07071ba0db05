//! Visibility of the sectors of the sky, in one byte each: the form in which caches keep it.

use crate::render::environment_light::{SECTORS, SectorVisibility};

/// [`SectorVisibility`] in 255ths, which takes a quarter of the memory.
#[derive(Debug, Clone, Copy)]
pub struct PackedVisibility([u8; SECTORS]);

impl PackedVisibility {
    pub fn new(visibility: SectorVisibility) -> PackedVisibility {
        PackedVisibility(visibility.map(|v| (255.0 * v.clamp(0.0, 1.0) + 0.5) as u8))
    }

    /// Add `weight` times these to `sum`.
    pub fn add_to(&self, sum: &mut SectorVisibility, weight: f32) {
        let weight = weight * (1.0 / 255.0);
        for (s, v) in sum.iter_mut().zip(self.0) {
            *s += weight * f32::from(v);
        }
    }
}
