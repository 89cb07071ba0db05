//! Tessellation of bilinear patches, fine enough that the matter of a shell does not float above its ground. Two triangles deviate from a
//! patch by a quarter of its twist; n × n pieces of a bilinear patch are bilinear patches with 1/n² of its twist.

use std::cmp::Ordering;

use crate::geom::DVec3;

/// Largest deviation of the triangles from a patch, in lengths of the patch's longest edge.
const MISS: f64 = 1e-3;
/// Most pieces along an edge, and most triangles of one part.
const MAX_PIECES: u32 = 16;
const MAX_TRIANGLES: usize = 1 << 22;

/// A triangle that is a piece of a patch.
#[derive(Debug, Clone, Copy)]
pub struct Piece {
    /// Index into the part's patches.
    pub patch: u32,
    /// (U, V) of its corners, in sixteenths.
    corners: [[u8; 2]; 3],
}

impl Piece {
    /// Bilinear interpolation of values at the four corners of the patch to the three corners of the piece.
    pub fn mix<T: Copy + std::ops::Mul<f64, Output = T> + std::ops::Add<Output = T>>(&self, ring: [T; 4]) -> [T; 3] {
        self.corners.map(|at| {
            let [u, v] = at.map(|k| f64::from(k) / f64::from(MAX_PIECES));
            let [a, b, c, d] = ring;
            a * ((1.0 - u) * (1.0 - v)) + b * (u * (1.0 - v)) + c * (u * v) + d * ((1.0 - u) * v)
        })
    }
}

/// Number of pieces along each edge of the patch with the corners `ring`, which belongs to a part of `patches` patches: 1, 2, 4, 8 or 16.
pub fn pieces(ring: [DVec3; 4], patches: usize) -> u32 {
    let [a, b, c, d] = ring;
    let twist = (a - b + c - d).length();
    let edge = (0..4).map(|k| ring[k].distance(ring[(k + 1) % 4])).fold(0.0, f64::max);
    // Two triangles miss the middle by a quarter of the twist; n × n pairs of them by an n²th of that.
    let wanted = (0.25 * twist / (MISS * edge)).sqrt();
    let allowed = (MAX_TRIANGLES as f64 / (2.0 * patches.max(1) as f64)).sqrt();
    let mut n = 1;
    while n < MAX_PIECES && f64::from(n) < wanted && f64::from(2 * n) <= allowed {
        n *= 2;
    }
    n
}

/// The vertices of n × n pieces, row by row along U, and their triangles by these numbers.
pub fn cut(ring: [DVec3; 4], patch: u32, n: u32) -> (Vec<DVec3>, Vec<([u32; 3], Piece)>) {
    let [a, b, c, d] = ring;
    let share = |k: u32| f64::from(k) / f64::from(n);
    let at = |i: u32, j: u32| match (i, j) {
        (_, 0) => on_edge(a, b, share(i)),
        (_, _) if j == n => on_edge(d, c, share(i)),
        (0, _) => on_edge(a, d, share(j)),
        (_, _) if i == n => on_edge(b, c, share(j)),
        _ => on_edge(a, b, share(i)).lerp(on_edge(d, c, share(i)), share(j)),
    };
    let vertices = (0..=n).flat_map(|j| (0..=n).map(move |i| (i, j))).map(|(i, j)| at(i, j)).collect();
    let step = MAX_PIECES / n;
    let piece = |corners: [[u32; 2]; 3]| {
        let numbers = corners.map(|[i, j]| j * (n + 1) + i);
        (numbers, Piece { patch, corners: corners.map(|c| c.map(|k| (k * step) as u8)) })
    };
    let cells = (0..n).flat_map(|j| (0..n).map(move |i| (i, j)));
    let triangles = cells.flat_map(|(i, j)| {
        let [a, b, c, d] = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]];
        [piece([a, b, c]), piece([a, c, d])]
    });
    (vertices, triangles.collect())
}

/// A point of the edge from a to b, the same to the bit as that of the edge from b to a: neighbours leave no crack.
fn on_edge(a: DVec3, b: DVec3, share: f64) -> DVec3 {
    if share == 0.0 || a == b {
        return a;
    }
    if share == 1.0 {
        return b;
    }
    let (a, b, share) = match a.to_array().partial_cmp(&b.to_array()) {
        Some(Ordering::Greater) => (b, a, 1.0 - share),
        _ => (a, b, share),
    };
    a + share * (b - a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::DVec2;

    #[test]
    fn pieces_lie_on_the_patch_and_miss_it_by_little() {
        let ring = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.3], [1.2, 1.0, -0.2], [0.0, 0.9, 0.25]].map(DVec3::from_array);
        let bilinear = |u: f64, v: f64| ring[0].lerp(ring[1], u).lerp(ring[3].lerp(ring[2], u), v);
        let n = pieces(ring, 1);
        assert!((4..=16).contains(&n));
        let (vertices, triangles) = cut(ring, 7, n);
        assert_eq!(triangles.len() as u32, 2 * n * n);
        let mut worst = 0.0f64;
        for (numbers, piece) in &triangles {
            assert_eq!(piece.patch, 7);
            let places = piece.mix([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(DVec2::from_array));
            let corners = numbers.map(|k| vertices[k as usize]);
            for (p, at) in corners.iter().zip(places) {
                assert!(p.distance(bilinear(at.x, at.y)) < 1e-15);
            }
            let middle = (places[0] + places[1] + places[2]) / 3.0;
            let flat = (corners[0] + corners[1] + corners[2]) / 3.0;
            worst = worst.max(flat.distance(bilinear(middle.x, middle.y)));
        }
        // Of edges up to 1.25 long.
        assert!(worst < 1.25 * MISS && worst > 0.0, "{worst}");
        // What is flat stays two triangles, and there are never too many.
        assert_eq!(pieces([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| DVec3::new(x, y, 0.5)), 1), 1);
        assert_eq!(pieces(ring, MAX_TRIANGLES), 1);
    }

    #[test]
    fn edges_are_the_same_from_both_sides() {
        let (a, b) = (DVec3::new(0.1, 0.7, 0.3), DVec3::new(1.3, -0.2, 0.9));
        for k in 0..=16 {
            let share = f64::from(k) / 16.0;
            assert_eq!(on_edge(a, b, share), on_edge(b, a, 1.0 - share));
        }
    }
}
