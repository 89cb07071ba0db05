//! The surface within one cell of a lattice: closed loops of points on the cell's edges.
//!
//! Based on: W. Lorensen, H. Cline, *Marching Cubes*, SIGGRAPH 1987; G. Nielson, B. Hamann, *The Asymptotic Decider*, VIS 1991
//! (faces with two diagonal corners within are ambiguous: here such corners are always apart, so that neighbours agree).

/// Corners of an edge: the lower one first. Corner c lies at (c & 1, c >> 1 & 1, c >> 2).
pub const EDGES: [[u8; 2]; 12] =
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

/// Corners of the faces, counter-clockwise from outside.
const FACES: [[u8; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// The loops of every set of corners that are within.
pub struct Loops {
    /// Edges, a loop after the other.
    edges: Vec<u8>,
    /// Where a loop ends in `edges`.
    ends: Vec<u16>,
    /// Loops of a set: first, and end.
    sets: [(u16, u16); 256],
}

impl Loops {
    pub fn new() -> Loops {
        let mut loops = Loops { edges: Vec::new(), ends: Vec::new(), sets: [(0, 0); 256] };
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

    /// Loops of edges around what is within, counter-clockwise from outside.
    pub fn of(&self, within: u8) -> impl Iterator<Item = &[u8]> {
        let (first, end) = self.sets[usize::from(within)];
        (usize::from(first)..usize::from(end)).map(|n| {
            let start = if n == 0 { 0 } else { usize::from(self.ends[n - 1]) };
            &self.edges[start..usize::from(self.ends[n])]
        })
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
    use crate::geom::DVec3;

    fn corner(c: u8) -> DVec3 {
        DVec3::new(f64::from(c & 1), f64::from(c >> 1 & 1), f64::from(c >> 2))
    }

    #[test]
    fn every_crossed_edge_is_on_one_loop_that_turns_outward() {
        let loops = Loops::new();
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
