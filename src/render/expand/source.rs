//! The triangles of a texel's source in a uniform grid of bins, for queries by box.

use crate::geom::{Aabb, DVec3};
use crate::render::source_mesh::SourceMesh;

/// Bins along an edge of the cube, at most.
const MAX_BINS: usize = 32;

/// A source's triangles in texel space, in bins.
pub struct SourceTriangles {
    pub mesh: SourceMesh,
    pub triangles: Vec<SourceTriangle>,
    bounds: Aabb,
    bins: usize,
    /// Where each bin's list in `members` begins; one more than there are bins.
    starts: Vec<u32>,
    members: Vec<u32>,
}

/// A triangle of `mesh.model`.
#[derive(Debug, Clone, Copy)]
pub struct SourceTriangle {
    /// Index into the model's instances, and of the triangle in its part.
    pub instance: u32,
    pub index: u32,
    pub corners: [DVec3; 3],
}

/// Marks the triangles that a query has visited, so that each is reported once.
#[derive(Default)]
pub struct VisitedTriangles {
    round: u32,
    last: Vec<u32>,
}

impl SourceTriangles {
    pub fn new(mesh: SourceMesh) -> SourceTriangles {
        let mut triangles = Vec::new();
        for (i, instance) in mesh.model.instances.iter().enumerate() {
            let Some(part) = mesh.model.parts.get(instance.part) else { continue };
            let at = |v: u32| {
                let p = part.positions.get(v as usize)?;
                Some(instance.transform.transform_point3(DVec3::from_array(p.map(f64::from))))
            };
            for (k, t) in part.triangles.iter().enumerate() {
                if let [Some(a), Some(b), Some(c)] = t.map(at) {
                    triangles.push(SourceTriangle { instance: i as u32, index: k as u32, corners: [a, b, c] });
                }
            }
        }
        let bounds = Aabb::around(triangles.iter().flat_map(|t| t.corners));
        let bins = ((triangles.len() as f64).cbrt() as usize).clamp(1, MAX_BINS);
        let mut made = SourceTriangles {
            mesh,
            triangles,
            bounds,
            bins,
            starts: vec![0; bins * bins * bins + 1],
            members: Vec::new(),
        };
        made.sort_into_bins();
        made
    }

    fn sort_into_bins(&mut self) {
        let boxes: Vec<[[usize; 2]; 3]> = self.triangles.iter().map(|t| self.range(&Aabb::around(t.corners))).collect();
        let mut lists: Vec<Vec<u32>> = vec![Vec::new(); self.bins * self.bins * self.bins];
        for (i, range) in boxes.iter().enumerate() {
            self.for_each_bin(range, &mut |bin| {
                if let Some(list) = lists.get_mut(bin) {
                    list.push(i as u32);
                }
            });
        }
        for (k, list) in lists.iter().enumerate() {
            self.members.extend(list);
            self.starts[k + 1] = self.members.len() as u32;
        }
    }

    /// The bins that a box meets, from the first to the last along each axis.
    fn range(&self, of: &Aabb) -> [[usize; 2]; 3] {
        let size = self.bounds.size().max(DVec3::splat(1e-300));
        let last = self.bins - 1;
        std::array::from_fn(|k| {
            let bin = |x: f64| ((x - self.bounds.min[k]) / size[k] * self.bins as f64).clamp(0.0, last as f64) as usize;
            [bin(of.min[k]), bin(of.max[k])]
        })
    }

    fn for_each_bin(&self, range: &[[usize; 2]; 3], each: &mut dyn FnMut(usize)) {
        for x in range[0][0]..=range[0][1] {
            for y in range[1][0]..=range[1][1] {
                for z in range[2][0]..=range[2][1] {
                    each((x * self.bins + y) * self.bins + z);
                }
            }
        }
    }

    /// The triangles whose boxes meet `of`, each once, in the order of the bins.
    pub fn for_each(&self, of: &Aabb, seen: &mut VisitedTriangles, each: &mut dyn FnMut(u32, &SourceTriangle)) {
        if !of.overlaps(self.bounds) {
            return;
        }
        seen.last.resize(self.triangles.len().max(seen.last.len()), 0);
        seen.round += 1;
        self.for_each_bin(&self.range(of), &mut |bin| {
            let (from, to) = (self.starts[bin] as usize, self.starts[bin + 1] as usize);
            for &i in &self.members[from..to] {
                let triangle = &self.triangles[i as usize];
                if std::mem::replace(&mut seen.last[i as usize], seen.round) != seen.round
                    && of.overlaps(Aabb::around(triangle.corners))
                {
                    each(i, triangle);
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Warnings;
    use crate::geom::DAffine3;
    use crate::random::SplitMix64;
    use crate::scene::{Instance, Material, Model, Part};
    use crate::volume::Info;

    #[test]
    fn a_box_finds_what_it_meets() {
        let mut part = Part::default();
        for i in 0..500u32 {
            let at = |k: u32| SplitMix64::new(u64::from(7 * i + k)).unit() as f32;
            let p = [at(0), at(1), at(2)];
            part.positions.extend([p, [p[0] + 0.1 * at(3), p[1], p[2]], [p[0], p[1] + 0.1 * at(4), p[2]]]);
            part.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        }
        let model = Model {
            parts: vec![part],
            materials: vec![Material::default()],
            instances: vec![Instance { part: 0, transform: DAffine3::IDENTITY, node: String::new() }],
            ..Model::default()
        };
        let info = Info { bounds: Aabb::UNIT, up: 2, ..Info::default() };
        let source = SourceTriangles::new(SourceMesh::new(model, &info, &mut Warnings::default()));
        let mut seen = VisitedTriangles::default();
        for k in 0..50u64 {
            let at = |n: u64| SplitMix64::new(10_000 + 7 * k + n).unit();
            let low = DVec3::new(at(0), at(1), at(2));
            let wanted = Aabb::new(low, low + 0.2 * DVec3::new(at(3), at(4), at(5)));
            let mut found = Vec::new();
            source.for_each(&wanted, &mut seen, &mut |i, _| found.push(i));
            found.sort_unstable();
            let all = (0..500u32).filter(|i| wanted.overlaps(Aabb::around(source.triangles[*i as usize].corners)));
            assert_eq!(found, all.collect::<Vec<_>>());
        }
    }
}
