//! Marching cubes with loops: the iso-surface within one cell of a lattice as closed loops of points on the cell's edges.
//!
//! Based on: W. Lorensen, H. Cline, *Marching Cubes*, SIGGRAPH 1987; G. Nielson, B. Hamann, *The Asymptotic Decider*, VIS 1991
//! (faces with two diagonal corners within are ambiguous: here such corners are always apart, so that neighbours agree).

use std::sync::LazyLock;

use crate::geom::DVec3;
use crate::geom::polygon::{MAX_CORNERS, Polygon};

/// Greatest distance of a facet's corners from one plane, in voxels.
const PLANAR: f64 = 0.02;

/// Corners of an edge: the lower one first. Corner c lies at (c & 1, c >> 1 & 1, c >> 2).
pub const EDGES: [[u8; 2]; 12] =
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

/// Corners of the faces, counter-clockwise from outside.
const FACES: [[u8; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Table of the loops for each of the 256 sets of a cell's corners that are inside of the surface. A set is a byte, with bit c for
/// corner c.
pub struct LoopTable {
    /// Edges of all loops, one loop after the other.
    edges: Vec<u8>,
    /// End of each loop in `edges`.
    ends: Vec<u16>,
    /// Loops of each set: index of the first, and one past the last.
    sets: [(u16, u16); 256],
}

impl LoopTable {
    /// The table, which is computed once.
    pub fn get() -> &'static LoopTable {
        static KNOWN: LazyLock<LoopTable> = LazyLock::new(LoopTable::find);
        &KNOWN
    }

    fn find() -> LoopTable {
        let mut loops = LoopTable { edges: Vec::new(), ends: Vec::new(), sets: [(0, 0); 256] };
        for within in 0..256usize {
            let next = steps(within);
            let first = loops.ends.len() as u16;
            let mut left: u16 = (0..12).filter(|&e| next[e as usize].is_some()).map(|e| 1 << e).sum();
            while left != 0 {
                let start = left.trailing_zeros() as u8;
                let mut edge = start;
                loop {
                    left &= !(1 << edge);
                    loops.edges.push(edge);
                    match next[usize::from(edge)] {
                        Some(to) if to != start => edge = to,
                        _ => break,
                    }
                }
                loops.ends.push(loops.edges.len() as u16);
            }
            loops.sets[within] = (first, loops.ends.len() as u16);
        }
        loops
    }

    /// Loops of edges for the set `within` of corners that are inside, counter-clockwise seen from outside.
    pub fn of(&self, within: u8) -> impl Iterator<Item = &[u8]> {
        let (first, end) = self.sets[usize::from(within)];
        (usize::from(first)..usize::from(end)).map(|n| {
            let start = if n == 0 { 0 } else { usize::from(self.ends[n - 1]) };
            &self.edges[start..usize::from(self.ends[n])]
        })
    }
}

/// Mean of a loop's corners, and unit normal of the plane through it, if all corners lie within [`PLANAR`] of that plane and the loop
/// is convex.
pub fn plane_of(corners: &[DVec3]) -> Option<(DVec3, DVec3)> {
    let n = corners.len();
    let middle = corners.iter().sum::<DVec3>() / n as f64;
    let area: DVec3 = (0..n).map(|i| (corners[i] - middle).cross(corners[(i + 1) % n] - middle)).sum();
    let normal = area.try_normalize()?;
    let plane = (0..n).all(|i| {
        let (p, q, r) = (corners[i], corners[(i + 1) % n], corners[(i + 2) % n]);
        normal.dot(p - middle).abs() <= PLANAR && (q - p).cross(r - q).dot(normal) >= 0.0
    });
    plane.then_some((middle, normal))
}

/// Call `each` for planar convex facets that fill the loop `corners`.
pub fn facets(corners: &[DVec3], each: &mut dyn FnMut(&Polygon)) {
    let n = corners.len();
    if n > 3 && n <= MAX_CORNERS && plane_of(corners).is_some() {
        return each(&Polygon::new(corners, 0));
    }
    // From the corner whose fan bends least: of a quad, along the shorter diagonal.
    let start = if n == 4 && (corners[1] - corners[3]).length_squared() < (corners[0] - corners[2]).length_squared() {
        1
    } else {
        0
    };
    for i in 1..n.saturating_sub(1) {
        each(&Polygon::new(&[corners[start], corners[(start + i) % n], corners[(start + i + 1) % n]], 0));
    }
}

fn edge_of(a: u8, b: u8) -> usize {
    EDGES.iter().position(|e| *e == [a.min(b), a.max(b)]).unwrap_or(0)
}

/// The edge that follows each crossed edge on its loop. Around a face, a run of corners that are within begins at one crossed
/// edge and ends at another: a loop goes from the first to the second. An edge begins a run on just one of its faces.
fn steps(within: usize) -> [Option<u8>; 12] {
    let inside = |c: u8| within >> c & 1 == 1;
    let mut next = [None; 12];
    for face in FACES {
        for i in 0..4 {
            let corner = |n: usize| face[n % 4];
            if !inside(corner(i)) || inside(corner(i + 1)) {
                continue;
            }
            // Back to where the run begins.
            let mut start = i + 4;
            while inside(corner(start - 1)) {
                start -= 1;
            }
            next[edge_of(corner(start - 1), corner(start))] = Some(edge_of(corner(i), corner(i + 1)) as u8);
        }
    }
    next
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(c: u8) -> DVec3 {
        DVec3::new(f64::from(c & 1), f64::from(c >> 1 & 1), f64::from(c >> 2))
    }

    #[test]
    fn every_crossed_edge_is_on_one_loop_that_turns_outward() {
        let loops = LoopTable::get();
        let mut longest = 0;
        for within in 0..=255u8 {
            let inside = |c: u8| within >> c & 1 == 1;
            let mut seen = [0; 12];
            for l in loops.of(within) {
                assert!(l.len() >= 3, "{within}");
                longest = longest.max(l.len());
                l.iter().for_each(|&e| seen[usize::from(e)] += 1);
                let points: Vec<DVec3> = l
                    .iter()
                    .map(|&e| {
                        let [a, b] = EDGES[usize::from(e)];
                        0.5 * (corner(a) + corner(b))
                    })
                    .collect();
                let area: DVec3 =
                    (2..points.len()).map(|i| (points[i - 1] - points[0]).cross(points[i] - points[0])).sum();
                // Along the loop, out of matter: from the end within to the end outside.
                let out: DVec3 = l
                    .iter()
                    .map(|&e| {
                        let [a, b] = EDGES[usize::from(e)];
                        if inside(a) { corner(b) - corner(a) } else { corner(a) - corner(b) }
                    })
                    .sum();
                assert!(area.dot(out) > 0.0, "{within}: {area} {out}");
            }
            for (e, [a, b]) in EDGES.iter().enumerate() {
                assert_eq!(seen[e], u8::from(inside(*a) != inside(*b)), "{within} {e}");
            }
        }
        assert!(longest <= 8, "{longest}");
    }
}
