//! Connectivity of a mesh: which triangles bound closed components, and how large its flat patches (leaves) are.

use crate::geom::DVec3;
use crate::scene::model::Part;

/// Role of a triangle as a boundary of matter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Face {
    /// A sheet, seen from both sides.
    Sheet,
    /// Face of a closed component; its normal points outward.
    Outward,
    /// Face of a closed component that is inside out: its normal points inward.
    Inward,
}

/// Result of the analysis of one part, in the part's own space.
pub struct Patches {
    /// Role of each triangle as a boundary of matter.
    pub faces: Vec<Face>,
    /// Width (4 · area / perimeter) and area of each flat patch.
    pub patches: Vec<(f64, f64)>,
}

/// Share of a patch's area that must be left in its area vector: a third of a cylinder still passes.
const FLAT: f64 = 0.85;

/// Sets that are united; the smaller index is the representative.
struct Sets(Vec<u32>);

impl Sets {
    fn new(n: usize) -> Sets {
        Sets((0..n as u32).collect())
    }

    fn find(&mut self, mut i: u32) -> u32 {
        while self.0[i as usize] != i {
            let up = self.0[self.0[i as usize] as usize];
            self.0[i as usize] = up;
            i = up;
        }
        i
    }

    fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

/// One side of a triangle: its welded ends in order, whether the triangle runs along it, and the triangle.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    ends: [u32; 2],
    triangle: u32,
    along: bool,
}

/// Corners at the same place get the same number.
fn weld(positions: &[[f32; 3]]) -> Vec<u32> {
    let key = |i: u32| positions[i as usize].map(|v| (v + 0.0).to_bits());
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    order.sort_unstable_by_key(|&i| (key(i), i));
    let mut ids = vec![0; positions.len()];
    let mut first = 0;
    for (n, &i) in order.iter().enumerate() {
        if n == 0 || key(i) != key(first) {
            first = i;
        }
        ids[i as usize] = first;
    }
    ids
}

/// Roles of a part's triangles, and its flat patches.
pub fn analyse(part: &Part) -> Patches {
    let count = part.triangles.len();
    let ids = weld(&part.positions);
    let at = |i: u32| DVec3::from(part.positions[i as usize].map(f64::from));
    let corners = |t: &[u32; 3]| t.map(at);
    let mut sides = Vec::with_capacity(3 * count);
    for (n, t) in part.triangles.iter().enumerate() {
        let t = t.map(|i| ids[i as usize]);
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            if a != b {
                sides.push(Side { ends: [a.min(b), a.max(b)], triangle: n as u32, along: a < b });
            }
        }
    }
    sides.sort_unstable();
    let vectors: Vec<DVec3> = part
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = corners(t);
            0.5 * (b - a).cross(c - a)
        })
        .collect();
    let mut whole = Sets::new(count);
    let mut open = Vec::new();
    let mut flat = Sets::new(count);
    let mut area: Vec<(DVec3, f64, f64)> = vectors
        .iter()
        .zip(&part.triangles)
        .map(|(v, t)| {
            let [a, b, c] = corners(t);
            (*v, v.length(), (b - a).length() + (c - b).length() + (a - c).length())
        })
        .collect();
    for group in sides.chunk_by(|a, b| a.ends == b.ends) {
        for pair in group.windows(2) {
            whole.unite(pair[0].triangle, pair[1].triangle);
        }
        if 2 * group.iter().filter(|s| s.along).count() != group.len() {
            open.push(group[0].triangle);
        }
        let [a, b] = group else { continue };
        let (i, j) = (flat.find(a.triangle), flat.find(b.triangle));
        let length = (at(a.ends[1]) - at(a.ends[0])).length();
        if i == j {
            area[i as usize].2 -= 2.0 * length;
            continue;
        }
        let ((vi, si, pi), (vj, sj, pj)) = (area[i as usize], area[j as usize]);
        let vj = if a.along == b.along { -vj } else { vj };
        if (vi + vj).length() >= FLAT * (si + sj) {
            flat.unite(i, j);
            area[i.min(j) as usize] = (vi + vj, si + sj, pi + pj - 2.0 * length);
        }
    }
    let mut closed = vec![true; count];
    for t in open {
        closed[whole.find(t) as usize] = false;
    }
    let mut volume = vec![0.0; count];
    for (n, t) in part.triangles.iter().enumerate() {
        let [a, b, c] = corners(t);
        volume[whole.find(n as u32) as usize] += a.dot(b.cross(c));
    }
    let faces = (0..count as u32)
        .map(|n| {
            let root = whole.find(n) as usize;
            match (closed[root], volume[root]) {
                (true, v) if v > 0.0 => Face::Outward,
                (true, v) if v < 0.0 => Face::Inward,
                _ => Face::Sheet,
            }
        })
        .collect();
    let patches = (0..count as u32)
        .filter(|&n| flat.find(n) == n)
        .map(|n| area[n as usize])
        .filter(|&(_, s, p)| s > 0.0 && p > 0.0)
        .map(|(_, s, p)| (4.0 * s / p, s))
        .collect();
    Patches { faces, patches }
}

/// The size at which half of the weight is reached; 0 for none.
pub fn weighted_median(mut sizes: Vec<(f64, f64)>) -> f64 {
    sizes.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let half = 0.5 * sizes.iter().map(|s| s.1).sum::<f64>();
    let mut sum = 0.0;
    for &(size, weight) in &sizes {
        sum += weight;
        if sum >= half {
            return size;
        }
    }
    0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube() -> Part {
        let positions = (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(|v| v as f32)).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        Part { positions, triangles, ..Part::default() }
    }

    #[test]
    fn a_cube_is_closed_and_made_of_six_patches() {
        let mut part = cube();
        let p = analyse(&part);
        assert!(p.faces.iter().all(|f| *f == Face::Outward));
        assert_eq!(p.patches.len(), 6);
        // 4 · 1 / 4.
        assert!((weighted_median(p.patches) - 1.0).abs() < 1e-12);
        part.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        assert!(analyse(&part).faces.iter().all(|f| *f == Face::Inward));
        part.triangles.pop();
        assert!(analyse(&part).faces.iter().all(|f| *f == Face::Sheet));
    }
}
