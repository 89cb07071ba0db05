//! Which materials a voxel shows: names that a texel has, and a share of each that is seen, so that a landscape can restyle them.
//!
//! Nominal data has no mean: a coarse voxel keeps the shares of the materials seen most, measured from the same sums as its
//! colour and not from the choices of the voxels below it.

/// One material of a texel.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Not empty, and no other material of the texel has it.
    pub name: String,
    /// Mean linear Rec. 709 albedo of what is seen of it.
    pub albedo: [f64; 3],
    /// Its share of what is seen of the texel, in [0, 1].
    pub share: f64,
}

/// Most materials of a texel.
pub const MOST_MATERIALS: usize = 255;
/// Materials that a voxel tells apart.
pub const SLOTS: usize = 4;
/// Sum of the shares of a voxel.
pub const WHOLE: u8 = 63;
/// Finest step of a share, in parts of [`WHOLE`].
pub const FINE: u8 = 1;
/// Step of the shares of the finest voxels, in parts of [`WHOLE`]. Most of them show one material, so that this step costs
/// 0.4 bits per voxel less than [`FINE`].
pub const COARSE: u8 = 9;

/// Visible shares of a voxel by material: the largest share first, of equal ones the lower id; unused slots are 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mix {
    ids: [u8; SLOTS],
    /// In parts of [`WHOLE`].
    shares: [u8; SLOTS],
}

impl Default for Mix {
    fn default() -> Self {
        Mix::one(0)
    }
}

impl Mix {
    /// Nothing but the material `id`.
    pub fn one(id: u8) -> Mix {
        Mix { ids: [id, 0, 0, 0], shares: [WHOLE, 0, 0, 0] }
    }

    /// The mix nearest to weights ≥ 0 of different materials, in steps of `step`; the first material where there are none.
    /// Materials that do not fit into the slots are left out.
    pub fn new(weights: impl IntoIterator<Item = (u8, f64)>, step: u8) -> Mix {
        let mut all: Vec<(u8, f64)> = weights.into_iter().filter(|w| w.1 > 0.0 && w.1.is_finite()).collect();
        if let [(id, _)] = all[..] {
            return Mix::one(id);
        }
        all.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        all.truncate(SLOTS);
        let sum: f64 = all.iter().map(|w| w.1).sum();
        let mut parts: Vec<(u8, u8, f64)> = Vec::with_capacity(SLOTS);
        for (id, weight) in all {
            let exact = weight / sum * f64::from(WHOLE / step);
            parts.push((id, exact as u8, exact.fract()));
        }
        // What rounding down left goes to the largest rests.
        let left = (WHOLE / step).saturating_sub(parts.iter().map(|p| p.1).sum());
        let mut order: Vec<usize> = (0..parts.len()).collect();
        order.sort_by(|&a, &b| parts[b].2.total_cmp(&parts[a].2).then(a.cmp(&b)));
        order.iter().take(left.into()).for_each(|&i| parts[i].1 += 1);
        Mix::of(parts.iter().map(|p| (p.0, p.1 * step)))
    }

    /// From shares that sum up to [`WHOLE`], of different materials; at most [`SLOTS`].
    pub fn of(shares: impl IntoIterator<Item = (u8, u8)>) -> Mix {
        let mut slots = [(0, 0); SLOTS];
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
        self.shares().map(|(id, share)| (id, f64::from(share) / f64::from(WHOLE)))
    }

    /// With other ids: materials that become one are added up.
    pub fn renamed(&self, to: impl Fn(u8) -> u8) -> Mix {
        let mut sums: [(u8, u8); SLOTS] = [(0, 0); SLOTS];
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
        Mix::of(sums.into_iter().take(count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn shares_are_those_of_the_weights() {
        assert_eq!(Mix::new([], FINE), Mix::one(0));
        assert_eq!(Mix::new([(3, 0.0), (7, 1e-30)], FINE), Mix::one(7));
        let thirds = Mix::new([(2, 2.0), (5, 4.0), (9, 0.0)], FINE);
        assert_eq!(thirds.shares().collect::<Vec<_>>(), [(5, 42), (2, 21)]);
        // Equal ones in the order of their ids, and what rounding leaves to the first.
        let sevenths = Mix::new([(2, 2.0), (5, 4.0)], COARSE);
        assert_eq!(sevenths.shares().collect::<Vec<_>>(), [(5, 45), (2, 18)]);
        assert_eq!(Mix::new([(2, 1.0), (5, 20.0)], COARSE), Mix::one(5));
        assert_eq!(Mix::new([(1, 1.0), (0, 1.0)], FINE).shares().collect::<Vec<_>>(), [(0, 32), (1, 31)]);
        // The least of five finds no slot.
        let five = Mix::new([(0, 1.0), (1, 2.0), (2, 3.0), (3, 4.0), (4, 5.0)], FINE);
        assert_eq!(five.shares().map(|s| s.0).collect::<Vec<_>>(), [4, 3, 2, 1]);
        assert_eq!(five.renamed(|id| id / 3).shares().collect::<Vec<_>>(), [(1, 41), (0, 22)]);
    }

    proptest! {
        #[test]
        fn nothing_is_lost(weights in proptest::collection::btree_map(0u8..255, 0.0f64..1e9, 0..9)) {
            let mix = Mix::new(weights.clone(), FINE);
            let found: Vec<_> = mix.shares().collect();
            prop_assert_eq!(found.iter().map(|s| u32::from(s.1)).sum::<u32>(), u32::from(WHOLE));
            prop_assert!(found.windows(2).all(|s| (s[1].1, s[0].0) < (s[0].1, s[1].0) || s[1].1 < s[0].1));
            if (1..=SLOTS).contains(&weights.len()) && weights.values().any(|w| *w > 0.0) {
                let sum: f64 = weights.values().sum();
                for (id, share) in mix.weights() {
                    // Largest rests: less than a step away.
                    prop_assert!((share - weights[&id] / sum).abs() < 1.0 / f64::from(WHOLE));
                }
            }
        }
    }
}
