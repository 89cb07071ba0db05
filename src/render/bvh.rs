//! A bounding volume hierarchy over numbered boxes: nearest hit, any hit, and all hits in order of depth.
//!
//! Based on: D. Meister, J. Bittner, *Parallel Locally-Ordered Clustering*, TVCG 2018 (the build, by the crate obvhs);
//! T. Ize, *Robust BVH Ray Traversal*, JCGT 2013 (padded slabs).

use std::cmp::Ordering;

use obvhs::{Boundable, BvhBuildParams};

use crate::geom::{Aabb, Ray, Vec3};

/// Distance by which every box is grown, in units in which the scene is about 1 across: more than the rounding of origins and
/// bounds to f32 (2^-24), so that the f32 slabs never lose what the exact tests in f64 would find.
const PAD: f32 = 1.0 / (1 << 21) as f32;

#[derive(Clone, Copy)]
#[repr(C, align(32))]
struct Node {
    min: [f32; 3],
    /// First child (the second follows), or the first of `count` items.
    first: u32,
    max: [f32; 3],
    /// 0: an inner node.
    count: u32,
}

/// The hierarchy. Items are the indices of the boxes that it was built from.
#[derive(Default)]
pub struct Bvh {
    nodes: Vec<Node>,
    items: Vec<u32>,
}

struct Item(Aabb);

impl Boundable for Item {
    fn aabb(&self) -> obvhs::aabb::Aabb {
        let (min, max) = (self.0.min.as_vec3a(), self.0.max.as_vec3a());
        obvhs::aabb::Aabb { min: min - PAD, max: max + PAD }
    }
}

/// A ray prepared for slab tests.
struct Slabs {
    origin: Vec3,
    inv: Vec3,
}

impl Slabs {
    fn new(ray: &Ray) -> Slabs {
        // A component that is zero becomes a huge finite reciprocal, so that 0 · inf = NaN cannot arise.
        let inv = |d: f64| {
            let r = (1.0 / d) as f32;
            if r.is_finite() { r } else { f32::MAX.copysign(r) * 1e-8 }
        };
        Slabs { origin: ray.origin.as_vec3(), inv: Vec3::new(inv(ray.dir.x), inv(ray.dir.y), inv(ray.dir.z)) }
    }

    /// The ray's t where it enters the node, if it does so before `t1`.
    #[inline]
    fn enter(&self, node: &Node, t1: f32) -> Option<f32> {
        let a = (Vec3::from_array(node.min) - self.origin) * self.inv;
        let b = (Vec3::from_array(node.max) - self.origin) * self.inv;
        let near = a.min(b).max_element().max(0.0);
        let far = a.max(b).min_element() * (1.0 + 4.0 * f32::EPSILON);
        (near <= far.min(t1)).then_some(near)
    }
}

impl Bvh {
    /// Boxes must be finite, in units in which the scene is about 1 across.
    pub fn new(boxes: &[Aabb]) -> Bvh {
        if boxes.is_empty() {
            return Bvh::default();
        }
        let items: Vec<Item> = boxes.iter().map(|&b| Item(b)).collect();
        let params = BvhBuildParams { max_prims_per_leaf: 4, ..BvhBuildParams::medium_build() };
        let built = obvhs::bvh2::builder::build_bvh2(&items, params, &mut Default::default());
        let node = |n: &obvhs::bvh2::node::Bvh2Node| Node {
            min: n.aabb.min.to_array(),
            first: n.first_index,
            max: n.aabb.max.to_array(),
            count: n.prim_count,
        };
        Bvh { nodes: built.nodes.iter().map(node).collect(), items: built.primitive_indices }
    }

    /// Calls `hit(item, t)` for items whose boxes the ray may meet before `t`, nearer nodes first; `hit` returns the new,
    /// never larger `t`. A negative `t` ends the walk.
    pub fn nearest(&self, ray: &Ray, t: f64, mut hit: impl FnMut(u32, f64) -> f64) -> f64 {
        let Some(root) = self.nodes.first() else { return t };
        let slabs = Slabs::new(ray);
        // Rounded up, so that nothing before the f64 bound is lost.
        let up = |t: f64| (t as f32) * (1.0 + f32::EPSILON);
        let (mut t, mut limit) = (t, up(t));
        let mut stack = [(0u32, 0f32); 96];
        let mut spill = Vec::new();
        let mut depth = 0;
        let mut current = slabs.enter(root, limit).map(|_| root);
        loop {
            let Some(node) = current.take() else {
                let next = spill.pop().or_else(|| {
                    (depth > 0).then(|| {
                        depth -= 1;
                        stack[depth]
                    })
                });
                let Some((index, enter)) = next else { return t };
                if enter <= limit {
                    current = Some(&self.nodes[index as usize]);
                }
                continue;
            };
            if node.count > 0 {
                for &item in &self.items[node.first as usize..(node.first + node.count) as usize] {
                    t = hit(item, t);
                    if t < 0.0 {
                        return t;
                    }
                    limit = up(t);
                }
                continue;
            }
            let (i, j) = (node.first, node.first + 1);
            let (a, b) = (&self.nodes[i as usize], &self.nodes[j as usize]);
            current = match (slabs.enter(a, limit), slabs.enter(b, limit)) {
                (Some(ta), Some(tb)) => {
                    let (near, far) = if ta <= tb { (a, (j, tb)) } else { (b, (i, ta)) };
                    if depth < stack.len() {
                        stack[depth] = far;
                        depth += 1;
                    } else {
                        spill.push(far);
                    }
                    Some(near)
                }
                (Some(_), None) => Some(a),
                (None, Some(_)) => Some(b),
                (None, None) => None,
            };
        }
    }
}

impl Bvh {
    /// The box around all items; empty without any.
    pub fn bounds(&self) -> Aabb {
        let of = |v: [f32; 3]| Vec3::from_array(v).as_dvec3();
        self.nodes.first().map_or(Aabb::EMPTY, |root| Aabb::new(of(root.min), of(root.max)))
    }

    /// Give `each` the items that may come as near to the ray before `t1` as `reach(t)`, which does not fall with t, a few at a
    /// time, until it returns false.
    pub fn each_near(&self, ray: &Ray, t1: f64, reach: impl Fn(f64) -> f64, mut each: impl FnMut(&[u32]) -> bool) {
        let slabs = Slabs::new(ray);
        let dir = ray.dir.as_vec3();
        let is_near = |node: &Node| {
            let (min, max) = (Vec3::from_array(node.min), Vec3::from_array(node.max));
            let middle = (0.5 * (min + max) - slabs.origin).dot(dir);
            let half = (0.5 * (max - min)).dot(dir.abs());
            let r = reach(f64::from(middle + half).clamp(0.0, t1)) as f32 + PAD;
            let grown = Node { min: (min - r).to_array(), max: (max + r).to_array(), ..*node };
            middle + half + r >= 0.0 && slabs.enter(&grown, t1 as f32).is_some()
        };
        let mut open = vec![0u32];
        while let Some(node) = open.pop().and_then(|i| self.nodes.get(i as usize)) {
            if !is_near(node) {
                continue;
            }
            if node.count == 0 {
                open.extend([node.first, node.first + 1]);
                continue;
            }
            if !each(&self.items[node.first as usize..(node.first + node.count) as usize]) {
                return;
            }
        }
    }
}

/// The items that a ray may meet, in order of where it enters their nodes.
pub struct Sweep<'a> {
    bvh: &'a Bvh,
    slabs: Slabs,
    limit: f32,
    heap: &'a mut Vec<Pending>,
}

/// A node that waits for the sweep to reach it.
#[derive(Clone, Copy)]
pub struct Pending {
    enter: f32,
    node: u32,
}

impl PartialEq for Pending {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Pending {}
impl PartialOrd for Pending {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Pending {
    /// The nearest is the greatest, as the sweep takes its last entry first; ties by node, so that the order is fixed.
    fn cmp(&self, other: &Self) -> Ordering {
        other.enter.total_cmp(&self.enter).then(other.node.cmp(&self.node))
    }
}

impl<'a> Sweep<'a> {
    /// Items up to `t1` along the ray; `heap` is scratch space.
    pub fn new(bvh: &'a Bvh, ray: &Ray, t1: f64, heap: &'a mut Vec<Pending>) -> Sweep<'a> {
        heap.clear();
        let slabs = Slabs::new(ray);
        let limit = (t1 as f32) * (1.0 + f32::EPSILON);
        if let Some(enter) = bvh.nodes.first().and_then(|root| slabs.enter(root, limit)) {
            heap.push(Pending { enter, node: 0 });
        }
        Sweep { bvh, slabs, limit, heap }
    }

    /// No item that has not been visited yet begins before this; infinite when there is none.
    pub fn next_enter(&self) -> f64 {
        self.heap.last().map_or(f64::INFINITY, |p| f64::from(p.enter))
    }

    /// Open the nearest node: calls `visit` for its items, if it is a leaf. False when nothing is left.
    pub fn step(&mut self, mut visit: impl FnMut(u32)) -> bool {
        let Some(Pending { node, .. }) = self.heap.pop() else { return false };
        let node = self.bvh.nodes[node as usize];
        if node.count > 0 {
            self.bvh.items[node.first as usize..(node.first + node.count) as usize].iter().for_each(|&i| visit(i));
            return true;
        }
        for child in [node.first, node.first + 1] {
            if let Some(enter) = self.slabs.enter(&self.bvh.nodes[child as usize], self.limit) {
                let pending = Pending { enter, node: child };
                // A sorted list beats a heap here: a sweep holds a few dozen nodes and new ones go near the end.
                let place = self.heap.partition_point(|p| p.cmp(&pending) == Ordering::Less);
                self.heap.insert(place, pending);
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::DVec3;

    fn grid() -> Vec<Aabb> {
        let mut boxes = Vec::new();
        for x in 0..12 {
            for y in 0..12 {
                let min = DVec3::new(f64::from(x) / 12.0, f64::from(y) / 12.0, 0.3);
                boxes.push(Aabb::new(min, min + DVec3::new(0.07, 0.05, 0.1)));
            }
        }
        boxes
    }

    #[test]
    fn finds_what_brute_force_finds_in_order() {
        let boxes = grid();
        let bvh = Bvh::new(&boxes);
        let mut scratch = Vec::new();
        for k in 0..200 {
            let a = f64::from(k) * 0.71;
            let dir = DVec3::new(a.cos(), a.sin(), 0.01 * f64::from(k % 7)).normalize();
            let ray = Ray { origin: DVec3::new(0.5, 0.5, 0.35) - dir, dir };
            let truth: Vec<u32> = (0..boxes.len() as u32)
                .filter(|&i| boxes[i as usize].hit(ray.origin, 1.0 / ray.dir, 0.0, 9.0).is_some())
                .collect();
            let mut found = Vec::new();
            bvh.nearest(&ray, 9.0, |i, t| {
                found.push(i);
                t
            });
            let mut swept = Vec::new();
            let mut sweep = Sweep::new(&bvh, &ray, 9.0, &mut scratch);
            let mut last = 0.0;
            while sweep.next_enter().is_finite() {
                assert!(sweep.next_enter() >= last - 1e-6);
                last = sweep.next_enter();
                sweep.step(|i| swept.push(i));
            }
            for i in truth {
                assert!(found.contains(&i) && swept.contains(&i));
            }
        }
    }

    #[test]
    fn one_box_and_none() {
        let ray = Ray { origin: DVec3::ZERO, dir: DVec3::X };
        assert_eq!(Bvh::new(&[]).nearest(&ray, 1.0, |_, _| -1.0), 1.0);
        let one = Bvh::new(&[Aabb::UNIT]);
        assert_eq!(one.nearest(&ray, 1.0, |_, _| 0.5), 0.5);
    }
}
