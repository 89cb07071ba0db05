//! Welding: groups of vertices at one position, and pairs of triangles that share an edge. Both are found by hashing, since sorting took
//! 44 % of the set-up of a million quads.

use crate::scene::Part;

/// Marks a triangle without a partner, and an empty slot of a table.
pub const NONE: u32 = u32::MAX;

/// An open-addressing table of numbers, whose keys are kept elsewhere.
struct Table {
    slots: Vec<u32>,
}

impl Table {
    /// Room for `n` numbers, below [`NONE`].
    fn new(n: usize) -> Table {
        Table { slots: vec![NONE; (2 * n).next_power_of_two()] }
    }

    /// The slot of the number whose key is looked for, or the empty slot where it belongs. `is_same` compares keys.
    fn slot(&mut self, hash: u64, is_same: impl Fn(u32) -> bool) -> &mut u32 {
        let mask = self.slots.len() - 1;
        // The upper bits of a product depend on all bits.
        let mut at = (hash >> 32) as usize & mask;
        while self.slots[at] != NONE && !is_same(self.slots[at]) {
            at = (at + 1) & mask;
        }
        &mut self.slots[at]
    }
}

/// A step of a multiplicative hash.
fn mix(hash: u64, word: u32) -> u64 {
    (hash.rotate_left(29) ^ u64::from(word)).wrapping_mul(0x9e37_79b9_7f4a_7c15)
}

/// For each vertex the lowest vertex at the same position.
pub fn by_position(part: &Part) -> Vec<u32> {
    // −0 and 0 are one position.
    let key = |i: u32| part.positions[i as usize].map(|v| (v + 0.0).to_bits());
    let mut table = Table::new(part.positions.len());
    let first = |i: u32| {
        let own = key(i);
        let slot = table.slot(own.iter().fold(0, |hash, &word| mix(hash, word)), |other| key(other) == own);
        if *slot == NONE {
            *slot = i;
        }
        *slot
    };
    (0..part.positions.len() as u32).map(first).collect()
}

/// For each of `n` triangles the partner with which it forms one face, or [`NONE`]. `edge(i)` gives the edge that triangle i may share, as
/// its two vertices with the lower number first, or `None`; `join(i, j)` tells whether two triangles with the same edge form a face. Pairs
/// of successive triangles are tried first, since most files write quads so, then other pairs with the same edge in order.
pub fn partners(n: usize, edge: impl Fn(u32) -> Option<[u32; 2]>, join: impl Fn(u32, u32) -> bool) -> Vec<u32> {
    let mut partner = vec![NONE; n];
    let mut left = n;
    for j in 1..n as u32 {
        let i = j - 1;
        if partner[i as usize] == NONE && edge(i).is_some_and(|own| edge(j) == Some(own)) && join(i, j) {
            (partner[i as usize], partner[j as usize]) = (j, i);
            left -= 2;
        }
    }
    let mut table = Table::new(left);
    for j in 0..n as u32 {
        let Some(own) = edge(j).filter(|_| partner[j as usize] == NONE) else { continue };
        let slot = table.slot(mix(mix(0, own[0]), own[1]), |other| edge(other) == Some(own));
        let i = *slot;
        // One that has its partner makes way for the next.
        *slot = j;
        if i != NONE && partner[i as usize] == NONE && join(i, j) {
            (partner[i as usize], partner[j as usize]) = (j, i);
        }
    }
    partner
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_at_one_position_are_found() {
        let mut part = Part::default();
        for i in 0..4000u32 {
            let k = (i * 7919 % 1000) as f32;
            part.positions.push([k * 0.37, if i % 2 == 0 { 0.0 } else { -0.0 }, -k]);
        }
        let found = by_position(&part);
        for (i, &first) in found.iter().enumerate() {
            let lowest = part.positions.iter().position(|p| *p == part.positions[i]).unwrap();
            assert_eq!(first as usize, lowest);
        }
    }

    #[test]
    fn triangles_are_paired_once_and_in_order() {
        // Five share an edge, of which two follow each other; two share another one; 7 may not share any.
        let edges = [[1, 2], [3, 4], [1, 2], [1, 2], [1, 2], [3, 4], [1, 2], [0, 0]];
        let edge = |i: u32| Some(edges[i as usize]).filter(|_| i != 7);
        assert_eq!(partners(8, edge, |_, _| true), [4, 5, 3, 2, 0, 1, NONE, NONE]);
        // The first of them is alone: the next are asked.
        assert_eq!(partners(8, edge, |i, _| i != 0), [NONE, 5, 3, 2, 6, 1, 4, NONE]);
        assert!(partners(0, edge, |_, _| true).is_empty());
    }
}
