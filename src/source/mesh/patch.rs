//! Connectivity of a mesh: which triangles bound closed components, and how large its flat patches (leaves) are.

use crate::geom::DVec3;
use crate::scene::model::Part;

/// Role of a triangle as a boundary of matter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Face {
    /// Of something that does not close, seen from both sides.
    Sheet,
    /// Of a sheet that its file calls single-sided: seen from the side alone that its normal points to.
    Front,
    /// Face of a closed component; its normal points outward.
    Outward,
    /// Face of a closed component that is inside out: its normal points inward.
    Inward,
}

impl Face {
    /// Whether it bounds matter.
    pub fn is_closed(self) -> bool {
        matches!(self, Face::Outward | Face::Inward)
    }
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

/// Share of the area of a connected component that does not close which must be left in its area vector if it is to have a
/// front: all of a leaf's, half of a hemisphere's, nothing of a tube's. Of a tube with open ends one sees the outside from all
/// around, and its front hides its back, as of what closes.
const FRONT: f64 = 0.4;

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

/// Roles of a part's triangles, and its flat patches. `single_sided`: whether the part's material shows its front alone.
pub fn analyse(part: &Part, single_sided: bool) -> Patches {
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
    let mut spread = vec![(DVec3::ZERO, 0.0); if single_sided { count } else { 0 }];
    for (n, vector) in vectors.iter().enumerate().take(spread.len()) {
        let (sum, area) = &mut spread[whole.find(n as u32) as usize];
        (*sum, *area) = (*sum + vector, *area + vector.length());
    }
    let faces = (0..count as u32)
        .map(|n| {
            let root = whole.find(n) as usize;
            let has_front = spread.get(root).is_some_and(|(sum, area)| sum.length() > FRONT * area);
            match (closed[root], volume[root]) {
                (true, v) if v > 0.0 => Face::Outward,
                (true, v) if v < 0.0 => Face::Inward,
                _ if has_front => Face::Front,
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
        let p = analyse(&part, false);
        assert!(p.faces.iter().all(|f| *f == Face::Outward));
        assert_eq!(p.patches.len(), 6);
        // 4 · 1 / 4.
        assert!((weighted_median(p.patches) - 1.0).abs() < 1e-12);
        part.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        assert!(analyse(&part, false).faces.iter().all(|f| *f == Face::Inward));
        part.triangles.pop();
        assert!(analyse(&part, false).faces.iter().all(|f| *f == Face::Sheet));
    }

    #[test]
    fn single_sided_sheets_have_a_front_and_tubes_have_none() {
        let of = |positions: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>| {
            let part = Part { positions, triangles, ..Part::default() };
            let faces = [true, false].map(|single| analyse(&part, single).faces);
            assert!(faces[1].iter().all(|f| *f == Face::Sheet));
            faces.into_iter().next().unwrap_or_default()
        };
        let square = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let (there, back) = (vec![[0, 1, 2], [0, 2, 3]], vec![[0, 2, 1], [0, 3, 2]]);
        assert_eq!(of(square.clone(), there.clone()), [Face::Front; 2]);
        // Two in one place, back to back: both of its sides are seen.
        let both = [there, back].concat();
        assert_eq!(of(square, both), [Face::Sheet; 4]);
        // A tube without ends, and the half of one, of whose area 2/π is left.
        let ring = |n: u32| {
            (0..2 * n).map(move |i| {
                let (sin, cos) = libm::sincosf(std::f32::consts::PI / 8.0 * (i / 2) as f32);
                [cos, sin, (i % 2) as f32]
            })
        };
        let quad = |a: u32, b: u32| [[2 * a, 2 * b, 2 * b + 1], [2 * a, 2 * b + 1, 2 * a + 1]];
        let tube: Vec<[u32; 3]> = (0..16).flat_map(|i| quad(i, (i + 1) % 16)).collect();
        assert_eq!(of(ring(16).collect(), tube.clone()), [Face::Sheet; 32]);
        assert_eq!(of(ring(9).collect(), tube[..16].to_vec()), [Face::Front; 16]);
    }
}
