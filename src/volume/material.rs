//! Materials of a texel by name, and the mix of materials that a voxel shows, so that a landscape can restyle them by name.
//!
//! Material ids cannot be averaged. So a coarse voxel stores the shares of the materials that are seen most in it. These are
//! measured from the same sums as its colour, and not from the rounded mixes of its children.

/// One material of a texel.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Name, unique in the texel and not empty.
    pub name: String,
    /// Mean linear Rec. 709 albedo of its visible matter.
    pub albedo: [f64; 3],
    /// Share of the texel's visible matter that is of it, in [0, 1].
    pub share: f64,
}

/// Most materials of a texel.
pub const MAX_MATERIALS: usize = 255;
/// Number of materials that a voxel's mix can hold.
pub const MIX_SLOTS: usize = 4;
/// Sum of the shares of a mix: a share of 1.
pub const SHARE_SUM: u8 = 63;
/// Finest step of a share, in parts of [`SHARE_SUM`].
pub const FINE_STEP: u8 = 1;
/// Step of the shares of the finest voxels, in parts of [`SHARE_SUM`]. Most of them show one material, so that this step costs
/// 0.4 bits per voxel less than [`FINE_STEP`].
pub const COARSE_STEP: u8 = 9;

/// Visible shares of a voxel by material: the largest share first, of equal ones the lower id; unused slots are 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mix {
    ids: [u8; MIX_SLOTS],
    /// In parts of [`SHARE_SUM`].
    shares: [u8; MIX_SLOTS],
}

impl Default for Mix {
    fn default() -> Self {
        Mix::one(0)
    }
}

impl Mix {
    /// Mix of the material `id` alone.
    pub fn one(id: u8) -> Mix {
        Mix { ids: [id, 0, 0, 0], shares: [SHARE_SUM, 0, 0, 0] }
    }

    /// Mix nearest to the weights ≥ 0 of different materials (id, weight), in steps of `step` parts of [`SHARE_SUM`]. Without any
    /// weight above 0 it is the material 0 alone. Of more than [`MIX_SLOTS`] materials those with the smallest weights are left out.
    pub fn new(weights: impl IntoIterator<Item = (u8, f64)>, step: u8) -> Mix {
        let mut all: Vec<(u8, f64)> = weights.into_iter().filter(|w| w.1 > 0.0 && w.1.is_finite()).collect();
        if let [(id, _)] = all[..] {
            return Mix::one(id);
        }
        all.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        all.truncate(MIX_SLOTS);
        let sum: f64 = all.iter().map(|w| w.1).sum();
        let mut parts: Vec<(u8, u8, f64)> = Vec::with_capacity(MIX_SLOTS);
        for (id, weight) in all {
            let exact = weight / sum * f64::from(SHARE_SUM / step);
            parts.push((id, exact as u8, exact.fract()));
        }
        // Method of largest remainders: what rounding down left over goes to the shares with the largest fractions.
        let left = (SHARE_SUM / step).saturating_sub(parts.iter().map(|p| p.1).sum());
        let mut order: Vec<usize> = (0..parts.len()).collect();
        order.sort_by(|&a, &b| parts[b].2.total_cmp(&parts[a].2).then(a.cmp(&b)));
        order.iter().take(left.into()).for_each(|&i| parts[i].1 += 1);
        Mix::from_shares(parts.iter().map(|p| (p.0, p.1 * step)))
    }

    /// Mix of at most [`MIX_SLOTS`] different materials with these shares (id, share), which sum up to [`SHARE_SUM`].
    pub fn from_shares(shares: impl IntoIterator<Item = (u8, u8)>) -> Mix {
        let mut slots = [(0, 0); MIX_SLOTS];
        slots.iter_mut().zip(shares.into_iter().filter(|s| s.1 > 0)).for_each(|(slot, s)| *slot = s);
        slots.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
        if slots[0].1 == 0 {
            return Mix::default();
        }
        Mix { ids: slots.map(|s| s.0), shares: slots.map(|s| s.1) }
    }

    /// Id and share of each material that is there.
    pub fn shares(&self) -> impl Iterator<Item = (u8, u8)> {
        self.ids.into_iter().zip(self.shares).filter(|s| s.1 > 0)
    }

    /// Id and share in [0, 1] of each material that is there.
    pub fn weights(&self) -> impl Iterator<Item = (u8, f64)> {
        self.shares().map(|(id, share)| (id, f64::from(share) / f64::from(SHARE_SUM)))
    }

    /// The mix with every id replaced by `to(id)`. The shares of materials that get the same id are added.
    pub fn renamed(&self, to: impl Fn(u8) -> u8) -> Mix {
        let mut sums: [(u8, u8); MIX_SLOTS] = [(0, 0); MIX_SLOTS];
        let mut count = 0;
        for (id, share) in self.shares() {
            let id = to(id);
            match sums[..count].iter_mut().find(|s| s.0 == id) {
                Some(sum) => sum.1 += share,
                None => {
                    sums[count] = (id, share);
                    count += 1;
                }
            }
        }
        Mix::from_shares(sums.into_iter().take(count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn shares_are_those_of_the_weights() {
        assert_eq!(Mix::new([], FINE_STEP), Mix::one(0));
        assert_eq!(Mix::new([(3, 0.0), (7, 1e-30)], FINE_STEP), Mix::one(7));
        let thirds = Mix::new([(2, 2.0), (5, 4.0), (9, 0.0)], FINE_STEP);
        assert_eq!(thirds.shares().collect::<Vec<_>>(), [(5, 42), (2, 21)]);
        // Equal ones in the order of their ids, and what rounding leaves to the first.
        let sevenths = Mix::new([(2, 2.0), (5, 4.0)], COARSE_STEP);
        assert_eq!(sevenths.shares().collect::<Vec<_>>(), [(5, 45), (2, 18)]);
        assert_eq!(Mix::new([(2, 1.0), (5, 20.0)], COARSE_STEP), Mix::one(5));
        assert_eq!(Mix::new([(1, 1.0), (0, 1.0)], FINE_STEP).shares().collect::<Vec<_>>(), [(0, 32), (1, 31)]);
        // The least of five finds no slot.
        let five = Mix::new([(0, 1.0), (1, 2.0), (2, 3.0), (3, 4.0), (4, 5.0)], FINE_STEP);
        assert_eq!(five.shares().map(|s| s.0).collect::<Vec<_>>(), [4, 3, 2, 1]);
        assert_eq!(five.renamed(|id| id / 3).shares().collect::<Vec<_>>(), [(1, 41), (0, 22)]);
    }

    proptest! {
        #[test]
        fn nothing_is_lost(weights in proptest::collection::btree_map(0u8..255, 0.0f64..1e9, 0..9)) {
            let mix = Mix::new(weights.clone(), FINE_STEP);
            let found: Vec<_> = mix.shares().collect();
            prop_assert_eq!(found.iter().map(|s| u32::from(s.1)).sum::<u32>(), u32::from(SHARE_SUM));
            prop_assert!(found.windows(2).all(|s| (s[1].1, s[0].0) < (s[0].1, s[1].0) || s[1].1 < s[0].1));
            if (1..=MIX_SLOTS).contains(&weights.len()) && weights.values().any(|w| *w > 0.0) {
                let sum: f64 = weights.values().sum();
                for (id, share) in mix.weights() {
                    // Largest remainders: less than a step away.
                    prop_assert!((share - weights[&id] / sum).abs() < 1.0 / f64::from(SHARE_SUM));
                }
            }
        }
    }
}
