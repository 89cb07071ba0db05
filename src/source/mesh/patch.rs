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
    let sides = sides(part);
    let vectors: Vec<DVec3> = corners(part).map(|[a, b, c]| 0.5 * (b - a).cross(c - a)).collect();
    Patches { faces: faces(part, &sides, &vectors, single_sided), patches: flat_patches(part, &sides, &vectors) }
}

/// Corners of each triangle.
fn corners(part: &Part) -> impl Iterator<Item = [DVec3; 3]> {
    part.triangles.iter().map(|t| t.map(|i| corner(part, i)))
}

fn corner(part: &Part, i: u32) -> DVec3 {
    DVec3::from(part.positions[i as usize].map(f64::from))
}

/// The sides of all triangles, those between the same ends in a row.
fn sides(part: &Part) -> Vec<Side> {
    let ids = weld(&part.positions);
    let mut sides = Vec::with_capacity(3 * part.triangles.len());
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
    sides
}

fn between_same_ends(sides: &[Side]) -> impl Iterator<Item = &[Side]> {
    sides.chunk_by(|a, b| a.ends == b.ends)
}

/// What triangles that are connected by their sides have together.
#[derive(Clone, Copy, Default)]
struct Component {
    is_open: bool,
    /// Six times the volume within, if it is closed; below 0 if it is inside out.
    volume: f64,
    /// Sum of the triangles' area vectors, and of their areas.
    vector: DVec3,
    area: f64,
}

impl Component {
    fn face(&self, single_sided: bool) -> Face {
        match self.is_open {
            false if self.volume > 0.0 => Face::Outward,
            false if self.volume < 0.0 => Face::Inward,
            _ if single_sided && self.vector.length() > FRONT * self.area => Face::Front,
            _ => Face::Sheet,
        }
    }
}

/// The role of each triangle, by what it is connected to; `vectors`: the triangles' area vectors.
fn faces(part: &Part, sides: &[Side], vectors: &[DVec3], single_sided: bool) -> Vec<Face> {
    let count = part.triangles.len();
    let mut connected = Sets::new(count);
    for group in between_same_ends(sides) {
        for pair in group.windows(2) {
            connected.unite(pair[0].triangle, pair[1].triangle);
        }
    }
    let mut components = vec![Component::default(); count];
    for group in between_same_ends(sides) {
        // Through a side of what closes, triangles run as often one way as the other.
        if 2 * group.iter().filter(|s| s.along).count() != group.len() {
            components[connected.find(group[0].triangle) as usize].is_open = true;
        }
    }
    for (n, ([a, b, c], vector)) in corners(part).zip(vectors).enumerate() {
        let component = &mut components[connected.find(n as u32) as usize];
        component.volume += a.dot(b.cross(c));
        component.vector += vector;
        component.area += vector.length();
    }
    (0..count as u32).map(|n| components[connected.find(n) as usize].face(single_sided)).collect()
}

/// Triangles that lie in a plane, nearly, and are seen as one.
#[derive(Clone, Copy)]
struct FlatPatch {
    vector: DVec3,
    area: f64,
    perimeter: f64,
}

/// Width (4 · area / perimeter) and area of each flat patch; `vectors`: the triangles' area vectors.
fn flat_patches(part: &Part, sides: &[Side], vectors: &[DVec3]) -> Vec<(f64, f64)> {
    let mut united = Sets::new(part.triangles.len());
    let triangle = |(&vector, [a, b, c]): (&DVec3, [DVec3; 3])| FlatPatch {
        vector,
        area: vector.length(),
        perimeter: (b - a).length() + (c - b).length() + (a - c).length(),
    };
    let mut patches: Vec<FlatPatch> = vectors.iter().zip(corners(part)).map(triangle).collect();
    for group in between_same_ends(sides) {
        let [a, b] = group else { continue };
        let (i, j) = (united.find(a.triangle), united.find(b.triangle));
        let length = (corner(part, a.ends[1]) - corner(part, a.ends[0])).length();
        if i == j {
            patches[i as usize].perimeter -= 2.0 * length;
            continue;
        }
        let (p, q) = (patches[i as usize], patches[j as usize]);
        let vector = p.vector + if a.along == b.along { -q.vector } else { q.vector };
        let area = p.area + q.area;
        if vector.length() >= FLAT * area {
            united.unite(i, j);
            let perimeter = p.perimeter + q.perimeter - 2.0 * length;
            patches[i.min(j) as usize] = FlatPatch { vector, area, perimeter };
        }
    }
    (0..patches.len() as u32)
        .filter(|&n| united.find(n) == n)
        .map(|n| patches[n as usize])
        .filter(|p| p.area > 0.0 && p.perimeter > 0.0)
        .map(|p| (4.0 * p.area / p.perimeter, p.area))
        .collect()
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
