//! The codes of what voxels show of a texel's materials: the shares of all but the first where all fit into a voxel's slots,
//! else the ids of as many as there are slots and the shares of all but the first of these.

use crate::volume::material::{SLOTS, WHOLE};
use crate::volume::{Material, Mix};

/// Codes a voxel, of a texel of so many materials.
pub fn components(materials: usize) -> usize {
    if materials <= SLOTS { materials.saturating_sub(1) } else { 2 * SLOTS - 1 }
}

/// Largest code of component `k`.
pub fn most(materials: usize, k: usize) -> u8 {
    if materials > SLOTS && k < SLOTS { (materials - 1).min(254) as u8 } else { WHOLE }
}

/// Coding of a texel's mixes of materials: with the first material and the likeliest one, by the voxel's colour, in each other's
/// place. So most codes are 0.
pub struct Coding {
    /// Mean albedo of each material, as the codes of a voxel's.
    means: Vec<[i32; 3]>,
}

impl Coding {
    pub fn new(materials: &[Material]) -> Coding {
        let code = |v: f64| (libm::sqrt(v.clamp(0.0, 1.0)) * 255.0).round() as i32;
        Coding { means: materials.iter().map(|m| m.albedo.map(code)).collect() }
    }

    /// The material whose mean is nearest to a voxel's albedo codes, the first of equals.
    fn likely(&self, albedo: [u8; 3]) -> u8 {
        let off = |m: &[i32; 3]| (0..3).map(|k| (m[k] - i32::from(albedo[k])).pow(2)).sum::<i32>();
        (0..self.means.len()).min_by_key(|&i| off(&self.means[i])).unwrap_or(0).min(254) as u8
    }

    /// Codes of voxels that have these albedo codes, one voxel after the other. Ids that there are not are the last.
    pub fn codes(&self, mixes: &[Mix], albedo: impl Fn(usize) -> [u8; 3]) -> Vec<u8> {
        let n = components(self.means.len());
        let mut out = vec![0; mixes.len() * n];
        if n == 0 {
            return out;
        }
        let last = (self.means.len() - 1) as u8;
        for (i, (mix, slot)) in mixes.iter().zip(out.chunks_exact_mut(n)).enumerate() {
            let likely = self.likely(albedo(i));
            let swapped = mix.renamed(|id| swapped(id.min(last), likely));
            for (k, (id, share)) in swapped.shares().enumerate() {
                if self.means.len() > SLOTS {
                    slot[k] = id;
                    if k > 0 {
                        slot[SLOTS - 1 + k] = share;
                    }
                } else if id > 0 {
                    slot[usize::from(id) - 1] = share;
                }
            }
        }
        out
    }

    /// Mix of a voxel's codes; `None` where shares sum up to more than the whole.
    pub fn mix(&self, codes: &[u8], albedo: [u8; 3]) -> Option<Mix> {
        let ids = self.means.len() > SLOTS;
        let shares = if ids { codes.get(SLOTS..)? } else { codes };
        let rest = sum(shares)?;
        let id = |k: usize| if ids { codes.get(k).copied().unwrap_or(0) } else { k as u8 };
        let others = shares.iter().enumerate().map(|(k, &s)| (id(k + 1), s));
        let mix = Mix::of(std::iter::once((id(0), WHOLE - rest)).chain(others));
        let likely = self.likely(albedo);
        // Two slots may name one material.
        Some(mix.renamed(|id| swapped(id, likely)))
    }

    /// Whether shares do not sum up to more than the whole.
    pub fn is_whole(&self, codes: &[u8]) -> bool {
        let shares = if self.means.len() > SLOTS { codes.get(SLOTS..).unwrap_or_default() } else { codes };
        sum(shares).is_some()
    }
}

fn swapped(id: u8, likely: u8) -> u8 {
    match id {
        0 => likely,
        _ if id == likely => 0,
        _ => id,
    }
}

fn sum(shares: &[u8]) -> Option<u8> {
    shares.iter().try_fold(0u8, |sum, s| sum.checked_add(*s)).filter(|sum| *sum <= WHOLE)
}

#[cfg(test)]
mod tests;
