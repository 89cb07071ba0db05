//! Codes of voxels' mixes of materials. If a texel has no more materials than a mix has slots, the codes are the shares of all
//! materials but the first; else they are the ids of the materials in the slots, and the shares in all slots but the first. The
//! share that is left out is the rest to the whole.

use crate::volume::material::{MIX_SLOTS, SHARE_SUM};
use crate::volume::{Material, Mix};

/// Number of codes per voxel in a texel of so many materials.
pub fn components(materials: usize) -> usize {
    if materials <= MIX_SLOTS { materials.saturating_sub(1) } else { 2 * MIX_SLOTS - 1 }
}

/// Largest code of component `k` in a texel of so many materials.
pub fn component_max(materials: usize, k: usize) -> u8 {
    if materials > MIX_SLOTS && k < MIX_SLOTS { (materials - 1).min(254) as u8 } else { SHARE_SUM }
}

/// Coding of a texel's mixes of materials. For each voxel, the id 0 and the id of the material whose mean colour is nearest to the
/// voxel's are swapped. That material is mostly the one that the voxel shows, so most codes are 0.
pub struct MixCoding {
    /// Mean albedo of each material, coded like a voxel's albedo.
    means: Vec<[i32; 3]>,
}

impl MixCoding {
    pub fn new(materials: &[Material]) -> MixCoding {
        let code = |v: f64| (libm::sqrt(v.clamp(0.0, 1.0)) * 255.0).round() as i32;
        MixCoding { means: materials.iter().map(|m| m.albedo.map(code)).collect() }
    }

    /// The material whose mean is nearest to a voxel's albedo codes, the first of equals.
    fn likely(&self, albedo: [u8; 3]) -> u8 {
        let off = |m: &[i32; 3]| (0..3).map(|k| (m[k] - i32::from(albedo[k])).pow(2)).sum::<i32>();
        (0..self.means.len()).min_by_key(|&i| off(&self.means[i])).unwrap_or(0).min(254) as u8
    }

    /// Codes of `mixes`, voxel by voxel, where `albedo` gives the albedo codes of the voxel with this index. An id beyond the last
    /// material counts as the last.
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
                if self.means.len() > MIX_SLOTS {
                    slot[k] = id;
                    if k > 0 {
                        slot[MIX_SLOTS - 1 + k] = share;
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
        let ids = self.means.len() > MIX_SLOTS;
        let shares = if ids { codes.get(MIX_SLOTS..)? } else { codes };
        let rest = sum(shares)?;
        let id = |k: usize| if ids { codes.get(k).copied().unwrap_or(0) } else { k as u8 };
        let others = shares.iter().enumerate().map(|(k, &s)| (id(k + 1), s));
        let mix = Mix::from_shares(std::iter::once((id(0), SHARE_SUM - rest)).chain(others));
        let likely = self.likely(albedo);
        // A file may have the same id in two slots; renaming adds their shares.
        Some(mix.renamed(|id| swapped(id, likely)))
    }

    /// Whether the shares in a voxel's codes sum up to at most [`SHARE_SUM`].
    pub fn is_whole(&self, codes: &[u8]) -> bool {
        let shares = if self.means.len() > MIX_SLOTS { codes.get(MIX_SLOTS..).unwrap_or_default() } else { codes };
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
    shares.iter().try_fold(0u8, |sum, s| sum.checked_add(*s)).filter(|sum| *sum <= SHARE_SUM)
}

#[cfg(test)]
mod tests;
