//! The line mask of one voxel: one bit per lattice line and axis.

use std::sync::{Arc, LazyLock};

use crate::geom::DVec3;
use crate::geom::projection::{LINES, PROJECTIONS, ROWS, SQUARE_LINES, crossing};
use crate::simd::multiversioned;

/// Set of the lattice lines, of all 13 axes, that meet matter in one voxel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineMask {
    /// Rows of lines, axis by axis as [`PROJECTIONS`] places them; one bit per line.
    pub(super) rows: [u32; ROWS],
}

impl Default for LineMask {
    fn default() -> Self {
        LineMask { rows: [0; ROWS] }
    }
}

impl LineMask {
    /// Mask of every line through a full voxel. It is found once, since every solid voxel asks for it.
    pub fn full() -> &'static Arc<LineMask> {
        static FULL: LazyLock<Arc<LineMask>> = LazyLock::new(|| Arc::new(LineMask::find_full()));
        &FULL
    }

    fn find_full() -> LineMask {
        let mut mask = LineMask::default();
        for (k, p) in PROJECTIONS.iter().enumerate() {
            let (wa, wb) = p.extent();
            for row in 0..16 * wb {
                for bit in 0..16 * wa {
                    let at = |i: usize| (i as f64 + 0.5) / LINES as f64;
                    if crossing(k, at(bit), at(row), DVec3::ZERO, DVec3::ONE).is_some() {
                        mask.set(k, row, bit);
                    }
                }
            }
        }
        mask
    }

    /// Number of lines of each axis.
    pub fn counts(&self) -> [u32; 13] {
        counts(self)
    }

    fn axis(&self, k: usize) -> &[u32] {
        let p = &PROJECTIONS[k];
        &self.rows[p.first..p.first + p.rows]
    }

    /// Number of lines of the axis `k` in each square of [`SQUARE_LINES`] rows and columns: `[row][column]`, 0 beyond the axis's
    /// extent.
    #[inline(always)]
    pub fn square_counts(&self, k: usize) -> [[u8; 8]; 8] {
        let mut squares = [[0; 8]; 8];
        for (rows, squares) in self.axis(k).as_chunks::<SQUARE_LINES>().0.iter().zip(&mut squares) {
            let (mut even, mut odd) = (0, 0);
            for row in rows {
                // Population counts of each four columns of a row, then of all rows together, one byte per square.
                let pairs = row - (row >> 1 & 0x5555_5555);
                let fours = (pairs & 0x3333_3333) + (pairs >> 2 & 0x3333_3333);
                even += fours & 0x0f0f_0f0f;
                odd += fours >> 4 & 0x0f0f_0f0f;
            }
            let (even, odd) = (even.to_le_bytes(), odd.to_le_bytes());
            *squares = [even[0], odd[0], even[1], odd[1], even[2], odd[2], even[3], odd[3]];
        }
        squares
    }

    /// Add the line `bit` in the row `row` of the axis `k`.
    pub fn set(&mut self, k: usize, row: usize, bit: usize) {
        self.rows[PROJECTIONS[k].first + row] |= 1 << bit;
    }

    /// Replace the lines of the axis `k` by those of `other`, moved by a symmetry of the full voxel that the low 8 bits of
    /// `symmetry` choose: a cyclic shift or a reflection of rows and columns.
    pub fn copy_axis(&mut self, k: usize, other: &LineMask, symmetry: u32) {
        let p = &PROJECTIONS[k];
        let from = other.axis(k);
        let to = &mut self.rows[p.first..p.first + p.rows];
        let (rows, bits) = ((symmetry & 15) as usize, symmetry >> 4 & 15);
        for (i, to) in to.iter_mut().enumerate() {
            *to = match (p.sa, p.sb) {
                (0, _) => {
                    let row = from[(i + rows) & 15];
                    (row << bits | row >> (16 - bits)) & 0xffff
                }
                (_, 0) if bits & 1 == 1 => from[(i + rows) & 15].reverse_bits(),
                (_, 0) => from[(i + rows) & 15],
                _ if bits & 1 == 1 => from[31 - i].reverse_bits(),
                _ => from[i],
            };
        }
    }

    /// Add all lines of `other`.
    pub fn unite_with(&mut self, other: &LineMask) {
        for (mine, theirs) in self.rows.iter_mut().zip(&other.rows) {
            *mine |= theirs;
        }
    }
}

multiversioned! {
    fn counts(mask: &LineMask) -> [u32; 13] = count_lines;
}

#[inline(always)]
fn count_lines(mask: &LineMask) -> [u32; 13] {
    let mut counts = [0; 13];
    for (k, count) in counts.iter_mut().enumerate() {
        *count = ones(mask.axis(k));
    }
    counts
}

/// Number of bits set in `rows`, of which there must be an even number.
#[inline(always)]
pub(super) fn ones(rows: &[u32]) -> u32 {
    let mut count = 0;
    for &[a, b] in rows.as_chunks::<2>().0 {
        count += (u64::from(a) | u64::from(b) << 32).count_ones();
    }
    count
}
