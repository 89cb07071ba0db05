//! The lines of a parent, from its children's.

use multiversion::multiversion;

use super::{Beams, ones};
use crate::geom::AXES13;
use crate::geom::projection::{PROJECTIONS, child_offset};

/// What a parent learns when it unites its children's lines.
pub struct Union {
    pub beams: Beams,
    /// Lines of the union an axis.
    pub lines: [u32; 13],
    /// Lines of the children an axis, counted before they are united.
    pub parts: [u32; 13],
    /// Of each child, an axis: lines, and those of them that it blocks first, going along the axis and against it; all of
    /// them, both ways, where that is not asked for.
    pub children: [[Seen; 13]; 8],
}

/// Lines of a child in its parent.
#[derive(Debug, Clone, Copy, Default)]
pub struct Seen {
    pub lines: u32,
    /// Sum over both ways; at most 2 · lines.
    pub first: u32,
}

impl Beams {
    /// Unite up to eight children (in child order) whose voxels are of depth `depth`; `seen`: find which are met first.
    pub fn unite(children: &[Option<&Beams>; 8], depth: usize, seen: bool) -> Union {
        unite(children, depth & 1, seen)
    }
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+lzcnt+popcnt"))]
fn unite(children: &[Option<&Beams>; 8], phase: usize, seen: bool) -> Union {
    match (phase, seen) {
        (0, false) => unite_from::<0, false>(children),
        (0, true) => unite_from::<0, true>(children),
        (_, false) => unite_from::<1, false>(children),
        (_, true) => unite_from::<1, true>(children),
    }
}

#[inline(always)]
fn unite_from<const PHASE: usize, const SEEN: bool>(children: &[Option<&Beams>; 8]) -> Union {
    let mut all =
        Union { beams: Beams::default(), lines: [0; 13], parts: [0; 13], children: [[Seen::default(); 13]; 8] };
    for (k, p) in PROJECTIONS.iter().enumerate() {
        match p.rows {
            16 => all.unite_axis::<8, 16, PHASE, SEEN>(k, children),
            _ => all.unite_axis::<16, 32, PHASE, SEEN>(k, children),
        }
    }
    all
}

/// A child's rows of an axis, at `oa` child edges in its parent's: every other line of every other row. And how many lines.
#[inline(always)]
fn thinned<const HALF: usize, const ALL: usize, const PHASE: usize>(own: &[u32; ALL], oa: usize) -> ([u32; HALF], u32) {
    const EVEN: u32 = 0x5555_5555;
    let mut rows = [0; HALF];
    for n in 0..HALF {
        rows[n] = own[2 * n + PHASE] >> ((n + PHASE) & 1) & EVEN;
    }
    // The lines of two rows, side by side, are counted at once.
    let mut pairs = [0; HALF];
    for n in 0..HALF / 2 {
        pairs[n] = rows[n] | rows[n + HALF / 2] << 1;
    }
    let count = ones(&pairs[..HALF / 2]);
    for n in 0..HALF {
        rows[n] = gathered(rows[n]) << (8 * oa);
    }
    (rows, count)
}

impl Union {
    /// Unite the axis `k`, of which each child gives every other of its `ALL` rows, `HALF` in all, from the row `PHASE` on.
    /// All numbers are fixed, so that many rows are handled at once.
    #[inline(always)]
    fn unite_axis<const HALF: usize, const ALL: usize, const PHASE: usize, const SEEN: bool>(
        &mut self,
        k: usize,
        children: &[Option<&Beams>; 8],
    ) {
        let p = &PROJECTIONS[k];
        // By child: its rows as the parent has them, the first of those, and its lines.
        let mut parts = [([0u32; HALF], 0, 0); 8];
        for (j, (child, (rows, first, lines))) in children.iter().zip(&mut parts).enumerate() {
            let Some(own) = child.and_then(|c| c.rows[p.first..].first_chunk::<ALL>()) else { continue };
            let (oa, ob) = child_offset(k, j);
            *first = 8 * ob;
            (*rows, *lines) = thinned::<HALF, ALL, PHASE>(own, oa);
            self.children[j][k].lines = *lines;
            self.parts[k] += *lines;
        }
        let mut united = [0u32; 32];
        if SEEN {
            for way in [1, -1] {
                united = [0; 32];
                for &j in order(k, way) {
                    let (rows, first, lines) = &parts[j];
                    let Some(united) = united[*first..].first_chunk_mut::<HALF>().filter(|_| *lines > 0) else {
                        continue;
                    };
                    let mut new = [0; HALF];
                    for n in 0..HALF {
                        new[n] = rows[n] & !united[n];
                        united[n] |= rows[n];
                    }
                    self.children[j][k].first += ones(&new);
                }
            }
        } else {
            for (j, (rows, first, lines)) in parts.iter().enumerate() {
                self.children[j][k].first = 2 * lines;
                let Some(united) = united[*first..].first_chunk_mut::<HALF>() else { continue };
                for n in 0..HALF {
                    united[n] |= rows[n];
                }
            }
        }
        self.lines[k] = ones(&united[..ALL]);
        self.beams.rows[p.first..p.first + ALL].copy_from_slice(&united[..ALL]);
    }
}

/// Bits 0, 2, 4 … 30, all that there are, gathered into the low half.
#[inline(always)]
fn gathered(v: u32) -> u32 {
    let v = (v | v >> 1) & 0x3333_3333;
    let v = (v | v >> 2) & 0x0f0f_0f0f;
    let v = (v | v >> 4) & 0x00ff_00ff;
    (v | v >> 8) & 0xffff
}

/// Children in the order in which lines along axis `k` (`way` 1) or against it meet them.
fn order(k: usize, way: i32) -> &'static [usize; 8] {
    const ORDERS: [[[usize; 8]; 2]; 13] = orders();
    &ORDERS[k][if way > 0 { 0 } else { 1 }]
}

const fn orders() -> [[[usize; 8]; 2]; 13] {
    let mut out = [[[0usize; 8]; 2]; 13];
    let mut k = 0;
    while k < 13 {
        let (mut n, mut level) = (0, -3i32);
        while level <= 3 {
            let mut j = 0;
            while j < 8 {
                let w = AXES13[k];
                let along =
                    w[0] as i32 * (j & 1) as i32 + w[1] as i32 * (j >> 1 & 1) as i32 + w[2] as i32 * (j >> 2) as i32;
                if along == level {
                    out[k][0][n] = j;
                    out[k][1][7 - n] = j;
                    n += 1;
                }
                j += 1;
            }
            level += 1;
        }
        k += 1;
    }
    out
}
