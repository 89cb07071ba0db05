//! The build of a hierarchy, from boxes to nodes of eight children.
//!
//! Based on: D. Meister, J. Bittner, *Parallel Locally-Ordered Clustering*, TVCG 2018 (by the crate obvhs); I. Wald, C. Benthin,
//! S. Boulos, *Getting Rid of Packets*, RT 2008 (nodes of two children opened until they have more).

use glam::Vec3A;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb as Bounds;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;

use super::{ITEM, Node, PAD, WIDTH};
use crate::geom::{Aabb, Vec3};
use crate::par;

/// A box, grown: its lower corner and its upper one. In 24 bytes, and not in the 32 that the build takes: for a million copies that
/// is 8 MB.
#[derive(Clone, Copy)]
struct Grown([Vec3; 2]);

impl Grown {
    fn new(bounds: Aabb) -> Grown {
        Grown([bounds.min.as_vec3() - PAD, bounds.max.as_vec3() + PAD])
    }

    fn bounds(&self) -> Bounds {
        let [min, max] = self.0.map(Vec3A::from);
        Bounds { min, max }
    }

    /// Twice the middle.
    fn middle(&self) -> Vec3 {
        self.0[0] + self.0[1]
    }
}

/// Boxes of items, grown and in f32, as the build takes them.
#[derive(Default)]
pub struct Boxes(Vec<Grown>);

impl Boxes {
    /// Add the next item's, in units in which the scene is about 1 across.
    pub fn push(&mut self, bounds: Aabb) {
        self.0.push(Grown::new(bounds));
    }

    /// Add all of the others behind these.
    pub fn append(&mut self, mut others: Boxes) {
        if self.0.is_empty() {
            *self = others;
        } else {
            self.0.append(&mut others.0);
        }
    }

    /// Number of boxes.
    #[cfg(test)]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether every number is finite.
    pub fn are_finite(&self) -> bool {
        self.0.iter().all(|b| b.0.iter().all(|p| p.is_finite()))
    }
}

impl FromIterator<Aabb> for Boxes {
    fn from_iter<I: IntoIterator<Item = Aabb>>(boxes: I) -> Boxes {
        Boxes(boxes.into_iter().map(Grown::new).collect())
    }
}

/// The largest number of items of which a hierarchy is built at once. More are cut into parts of neighbours, each of which is built
/// for itself, and a hierarchy over these: the build of a million items at once took 300 MB besides what it made.
const PART: usize = 1 << 16;

/// The nodes over all boxes, the root first. A child that holds up to `most` items is a leaf; `number` is given its items, rising, and
/// tells the leaf's own number.
pub(super) fn build(boxes: &Boxes, most: usize, mut number: impl FnMut(&[u32]) -> u32 + Send) -> Vec<Node> {
    let boxes = &boxes.0;
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    let mut parts = Vec::new();
    split(boxes, &mut order, &mut parts);
    let bounds = |&i: &u32| boxes[i as usize].bounds();
    let over = if parts.len() > 1 {
        let around = |part: &&[u32]| part.iter().map(bounds).fold(Bounds::empty(), |all, b| all.union(&b));
        widened(&built(&parts.iter().map(around).collect::<Vec<_>>()), 1)
    } else {
        Widened::default()
    };
    let mut nodes = over.nodes;
    let above = nodes.len();
    let mut roots = vec![0; parts.len()];
    let make = |i: usize| widened(&built(&parts[i].iter().map(bounds).collect::<Vec<_>>()), most);
    let take = |i: usize, made: Widened| {
        let first = nodes.len() as u32;
        roots[i] = first;
        let mut items = Vec::new();
        let numbers = made.leaves.chunk_by(|a, b| a.0 == b.0).map(|leaf| {
            items.clear();
            items.extend(leaf.iter().map(|&(_, item)| parts[i][item as usize]));
            number(&items)
        });
        let numbers: Vec<u32> = numbers.collect();
        // All parts are about as large.
        nodes.reserve_exact((parts.len() - i) * made.nodes.len());
        nodes.extend(made.nodes.into_iter().map(|mut node| {
            node.renumber(|child| first + child, |leaf| ITEM | numbers[leaf as usize]);
            node
        }));
        Ok::<(), std::convert::Infallible>(())
    };
    let Ok(()) = par::in_order(parts.len(), 4, make, take);
    let root_of = |leaf: u32| roots[over.leaves[leaf as usize].1 as usize];
    nodes[..above].iter_mut().for_each(|node| node.renumber(|child| child, root_of));
    nodes
}

/// Cut `items` at medians, across where they are widest, into parts of no more than [`PART`], each rising.
fn split<'o>(boxes: &[Grown], items: &'o mut [u32], parts: &mut Vec<&'o [u32]>) {
    if items.len() <= PART {
        items.sort_unstable();
        if !items.is_empty() {
            parts.push(items);
        }
        return;
    }
    let middle = |i: u32| boxes[i as usize].middle();
    let first = middle(items[0]);
    let (low, high) = items.iter().fold((first, first), |(low, high), &i| (low.min(middle(i)), high.max(middle(i))));
    let size = high - low;
    let axis = (0..3).fold(0, |best, k| if size[k] > size[best] { k } else { best });
    let half = items.len() / 2;
    items.select_nth_unstable_by(half, |&a, &b| middle(a)[axis].total_cmp(&middle(b)[axis]).then(a.cmp(&b)));
    let (low, high) = items.split_at_mut(half);
    split(boxes, low, parts);
    split(boxes, high, parts);
}

/// The hierarchy over boxes, with two children a node and an item a leaf.
fn built(items: &[Bounds]) -> Bvh2 {
    // Leaves that hold one item are not collapsed, so that there is nothing to mend after it.
    let params = BvhBuildParams {
        max_prims_per_leaf: 1,
        post_collapse_reinsertion_batch_ratio_multiplier: 0.0,
        ..BvhBuildParams::medium_build()
    };
    build_bvh2(items, params, &mut Default::default())
}

/// Nodes of eight children, and the items of their leaves: numbers of leaves, rising, each as often as it has items.
#[derive(Default)]
struct Widened {
    nodes: Vec<Node>,
    leaves: Vec<(u32, u32)>,
}

/// The same hierarchy with eight children a node: the widest of a node's children is opened until it has as many. A child that holds
/// up to `most` items is a leaf.
fn widened(built: &Bvh2, most: usize) -> Widened {
    let counts = if most > 1 { counts(built) } else { Vec::new() };
    let is_leaf = |i: usize| counts.get(i).map_or(built.nodes[i].prim_count > 0, |&count| count as usize <= most);
    let (mut nodes, mut open) = (vec![Node::EMPTY], vec![(0, 0)]);
    let (mut leaves, mut below, mut count) = (Vec::new(), Vec::new(), 0);
    while let Some((from, to)) = open.pop() {
        let mut children = vec![from];
        while children.len() < WIDTH {
            let area = |i: usize| built.nodes[i].aabb.half_area();
            let inner = (0..children.len()).filter(|&k| !is_leaf(children[k]));
            let Some(widest) = inner.max_by(|&a, &b| area(children[a]).total_cmp(&area(children[b]))) else { break };
            let first = built.nodes[children[widest]].first_index as usize;
            children[widest] = first;
            children.push(first + 1);
        }
        for (k, &child) in children.iter().enumerate() {
            let place = if is_leaf(child) {
                let begin = leaves.len();
                below.push(child);
                while let Some(node) = below.pop().map(|i| &built.nodes[i]) {
                    let first = node.first_index as usize;
                    match node.prim_count as usize {
                        0 => below.extend([first, first + 1]),
                        n => leaves.extend(built.primitive_indices[first..first + n].iter().map(|&item| (count, item))),
                    }
                }
                leaves[begin..].sort_unstable();
                count += 1;
                ITEM | (count - 1)
            } else {
                nodes.push(Node::EMPTY);
                open.push((child, nodes.len() - 1));
                nodes.len() as u32 - 1
            };
            nodes[to].set(k, &built.nodes[child].aabb, place);
        }
    }
    Widened { nodes, leaves }
}

/// How many items are below each node.
fn counts(built: &Bvh2) -> Vec<u32> {
    let mut counts: Vec<u32> = built.nodes.iter().map(|node| node.prim_count).collect();
    // Nodes with their parents before them.
    let mut order = vec![0];
    let mut next = 0;
    while let Some(&i) = order.get(next) {
        next += 1;
        let node = &built.nodes[i];
        if node.prim_count == 0 {
            order.extend([0, 1].map(|k| node.first_index as usize + k));
        }
    }
    for &i in order.iter().rev().filter(|&&i| built.nodes[i].prim_count == 0) {
        let first = built.nodes[i].first_index as usize;
        counts[i] = counts[first] + counts[first + 1];
    }
    counts
}
