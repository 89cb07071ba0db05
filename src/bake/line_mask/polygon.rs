//! A polygon projected along all axes, scan-converted into lattice lines.

use crate::geom::DVec3;
use crate::geom::polygon::MAX_PIECE_CORNERS;
use crate::geom::projection::{COORDINATES, LINES, coordinate};

/// Polygon of at most `N` corners, a multiple of 4, in all projection planes at once; in units of the line spacing.
pub(super) struct ProjectedPolygon<const N: usize> {
    /// Corners, by coordinate.
    at: [[f32; N]; COORDINATES],
    /// First line at or beyond each corner.
    lines: [[i32; N]; COORDINATES],
    /// Lines from the least corner to the greatest: first, and one past the last.
    pub(super) ranges: [(usize, usize); COORDINATES],
    /// Number of corners.
    count: usize,
}

/// Most corners of a piece, rounded up to a multiple of 4.
pub(super) const MAX_PADDED_CORNERS: usize = MAX_PIECE_CORNERS.next_multiple_of(4);

impl<const N: usize> ProjectedPolygon<N> {
    #[inline(always)]
    pub(super) fn new(corners: &[DVec3], origin: DVec3) -> ProjectedPolygon<N> {
        let mut at = [[0.0f32; N]; COORDINATES];
        // The last corner is repeated up to a multiple of four.
        let padded = corners.len().next_multiple_of(4).min(N);
        for i in 0..padded {
            let Some(c) = corners.get(i).or(corners.last()) else { break };
            for (at, v) in at.iter_mut().zip((*c - origin).to_array()) {
                at[i] = v as f32 * LINES as f32;
            }
        }
        for (drop, q) in [(0, 1), (0, 2), (1, 2)] {
            let on = coordinate(q, 1, drop);
            for i in 0..padded {
                let (p, d) = (at[q][i], at[drop][i]);
                (at[on][i], at[on + 1][i]) = (p - d + LINES as f32, p + d);
            }
        }
        let mut lines = [[0; N]; COORDINATES];
        let mut ranges = [(0, 0); COORDINATES];
        for (on, range) in ranges.iter_mut().enumerate() {
            let most = if on < 3 { LINES as i32 } else { 2 * LINES as i32 };
            let (mut first, mut last) = ([most; 4], [0; 4]);
            for (lines, at) in lines[on][..padded].chunks_exact_mut(4).zip(at[on].chunks_exact(4)) {
                for i in 0..4 {
                    let line = line_after(at[i]).clamp(0, most);
                    lines[i] = line;
                    first[i] = first[i].min(line);
                    last[i] = last[i].max(line);
                }
            }
            let first = first[0].min(first[1]).min(first[2].min(first[3]));
            let last = last[0].max(last[1]).max(last[2].max(last[3]));
            *range = (first as usize, last as usize);
        }
        ProjectedPolygon { at, lines, ranges, count: corners.len() }
    }

    /// Set, in `found`, the bits of the lines that meet the polygon in the plane of the coordinates `a` and `b`, one word per
    /// row; `found` must be 0. Returns the number of lines.
    #[inline(always)]
    pub(super) fn scan_rows(&self, a: usize, b: usize, found: &mut [u32; 32]) -> u32 {
        let (x, y, rows) = (&self.at[a][..self.count], &self.at[b][..self.count], &self.lines[b][..self.count]);
        let mut total = 0;
        let mut last = self.count - 1;
        for next in 0..self.count {
            let i = std::mem::replace(&mut last, next);
            if rows[i] == rows[next] {
                continue;
            }
            // Crossings are always computed from the edge's lower end, so that the facets on both sides of an edge agree. In a
            // convex polygon, the edges that go up are on one side and those that go down on the other.
            let up = rows[i] < rows[next];
            let (low, high) = if up { (i, next) } else { (next, i) };
            let slope = (x[high] - x[low]) / (y[high] - y[low]);
            let (mut sum, mut row) = (0, rows[low]);
            while row < rows[high] {
                let line = line_after(x[low] + (row as f32 + 0.5 - y[low]) * slope);
                sum += line;
                // Each row is crossed twice, and the exclusive or leaves the lines between both crossings.
                found[row as usize & 31] ^= (u64::MAX << (line & 63)) as u32;
                row += 1;
            }
            total += if up { sum } else { -sum };
        }
        total.unsigned_abs()
    }
}

/// Index i of the first line beyond `x`, where lines are at i + 1/2, for |x| < 2^22. A line exactly at `x` may fall on either
/// side, but always on the same one.
#[inline]
fn line_after(x: f32) -> i32 {
    // At this magnitude the last bit of an f32 is worth 1, so the addition rounds to a whole number.
    const ROUND: f32 = 12_582_912.0;
    (x + ROUND).to_bits().wrapping_sub(ROUND.to_bits()) as i32
}
