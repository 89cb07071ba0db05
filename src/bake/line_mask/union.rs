//! The line mask of a parent voxel as the union of its children's.

use super::mask::{LineMask, ones};
use crate::geom::AXES13;
use crate::geom::projection::{PROJECTIONS, child_offset};
use crate::simd::multiversioned;

/// Union of the line masks of up to eight children.
pub struct MaskUnion {
    pub mask: LineMask,
    /// Number of lines of the union, per axis.
    pub lines: [u32; 13],
    /// Sum over the children of their numbers of lines, per axis.
    pub sum_before_union: [u32; 13],
    /// Lines of each child, per axis.
    pub children: [[ChildLines; 13]; 8],
}

/// Numbers of lines of a child along one axis, among the lines that its parent keeps.
#[derive(Debug, Clone, Copy, Default)]
pub struct ChildLines {
    pub lines: u32,
    /// Lines that no other child blocks before this one: the sum of those going along the axis and those going against it, so at
    /// most 2 · `lines`.
    pub visible: u32,
}

/// Union of up to eight children, in child order, for a parent at `depth`. Without `visibility` every child counts as fully
/// visible, and the children are walked once instead of once per direction.
pub fn unite(children: &[Option<&LineMask>; 8], depth: usize, visibility: bool) -> MaskUnion {
    unite_with_phase(children, depth & 1, visibility)
}

multiversioned! {
    fn unite_with_phase(children: &[Option<&LineMask>; 8], phase: usize, visibility: bool) -> MaskUnion = unite_children;
}

#[inline(always)]
fn unite_children(children: &[Option<&LineMask>; 8], phase: usize, visibility: bool) -> MaskUnion {
    match (phase, visibility) {
        (0, false) => unite_from::<0, false>(children),
        (0, true) => unite_from::<0, true>(children),
        (_, false) => unite_from::<1, false>(children),
        (_, true) => unite_from::<1, true>(children),
    }
}

#[inline(always)]
fn unite_from<const PHASE: usize, const VISIBILITY: bool>(children: &[Option<&LineMask>; 8]) -> MaskUnion {
    let mut all = MaskUnion {
        mask: LineMask::default(),
        lines: [0; 13],
        sum_before_union: [0; 13],
        children: [[ChildLines::default(); 13]; 8],
    };
    for (k, p) in PROJECTIONS.iter().enumerate() {
        match p.rows {
            16 => all.unite_axis::<8, 16, PHASE, VISIBILITY>(k, children),
            _ => all.unite_axis::<16, 32, PHASE, VISIBILITY>(k, children),
        }
    }
    all
}

/// Rows of an axis that a parent keeps of a child's `own`, every other line of every other row, moved to the column `oa` (child
/// edges); and their number of lines.
#[inline(always)]
fn keep_quincunx<const HALF: usize, const ALL: usize, const PHASE: usize>(
    own: &[u32; ALL],
    oa: usize,
) -> ([u32; HALF], u32) {
    const EVEN: u32 = 0x5555_5555;
    let mut rows = [0; HALF];
    for n in 0..HALF {
        rows[n] = own[2 * n + PHASE] >> ((n + PHASE) & 1) & EVEN;
    }
    // The even columns of one row and the odd ones of another make one word, so that two rows are counted at once.
    let mut pairs = [0; HALF];
    for n in 0..HALF / 2 {
        pairs[n] = rows[n] | rows[n + HALF / 2] << 1;
    }
    let count = ones(&pairs[..HALF / 2]);
    for n in 0..HALF {
        rows[n] = compact_even_bits(rows[n]) << (8 * oa);
    }
    (rows, count)
}

impl MaskUnion {
    /// Unite the lines of the axis `k`, of which a child has `ALL` rows and gives `HALF`, every other one from the row `PHASE` on.
    /// These numbers are constants so that the compiler handles many rows at once.
    #[inline(always)]
    fn unite_axis<const HALF: usize, const ALL: usize, const PHASE: usize, const VISIBILITY: bool>(
        &mut self,
        k: usize,
        children: &[Option<&LineMask>; 8],
    ) {
        let p = &PROJECTIONS[k];
        // For each child: its rows as the parent keeps them, the first of them among the parent's, and the number of lines.
        let mut kept = [([0u32; HALF], 0, 0); 8];
        for (j, (child, (rows, first, lines))) in children.iter().zip(&mut kept).enumerate() {
            let Some(own) = child.and_then(|c| c.rows[p.first..].first_chunk::<ALL>()) else { continue };
            let (oa, ob) = child_offset(k, j);
            *first = 8 * ob;
            (*rows, *lines) = keep_quincunx::<HALF, ALL, PHASE>(own, oa);
            self.children[j][k].lines = *lines;
            self.sum_before_union[k] += *lines;
        }
        let mut united = [0u32; 32];
        if VISIBILITY {
            for direction in [1, -1] {
                united = [0; 32];
                for &j in visit_order(k, direction) {
                    let (rows, first, lines) = &kept[j];
                    let Some(united) = united[*first..].first_chunk_mut::<HALF>().filter(|_| *lines > 0) else {
                        continue;
                    };
                    let mut new = [0; HALF];
                    for n in 0..HALF {
                        new[n] = rows[n] & !united[n];
                        united[n] |= rows[n];
                    }
                    self.children[j][k].visible += ones(&new);
                }
            }
        } else {
            for (j, (rows, first, lines)) in kept.iter().enumerate() {
                self.children[j][k].visible = 2 * lines;
                let Some(united) = united[*first..].first_chunk_mut::<HALF>() else { continue };
                for n in 0..HALF {
                    united[n] |= rows[n];
                }
            }
        }
        self.lines[k] = ones(&united[..ALL]);
        self.mask.rows[p.first..p.first + ALL].copy_from_slice(&united[..ALL]);
    }
}

/// The bits 0, 2, 4 … 30 of `v`, which has no others, moved to the bits 0 … 15.
#[inline(always)]
fn compact_even_bits(v: u32) -> u32 {
    let v = (v | v >> 1) & 0x3333_3333;
    let v = (v | v >> 2) & 0x0f0f_0f0f;
    let v = (v | v >> 4) & 0x00ff_00ff;
    (v | v >> 8) & 0xffff
}

/// Children in the order in which lines along the axis `k` (`direction` 1) or against it (−1) meet them.
fn visit_order(k: usize, direction: i32) -> &'static [usize; 8] {
    const ORDERS: [[[usize; 8]; 2]; 13] = orders();
    &ORDERS[k][if direction > 0 { 0 } else { 1 }]
}

const fn orders() -> [[[usize; 8]; 2]; 13] {
    let mut out = [[[0usize; 8]; 2]; 13];
    let mut k = 0;
    while k < 13 {
        let (mut n, mut distance) = (0, -3i32);
        while distance <= 3 {
            let mut j = 0;
            while j < 8 {
                let w = AXES13[k];
                let along =
                    w[0] as i32 * (j & 1) as i32 + w[1] as i32 * (j >> 1 & 1) as i32 + w[2] as i32 * (j >> 2) as i32;
                if along == distance {
                    out[k][0][n] = j;
                    out[k][1][7 - n] = j;
                    n += 1;
                }
                j += 1;
            }
            distance += 1;
        }
        k += 1;
    }
    out
}
