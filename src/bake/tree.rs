//! Octree of a bake: nodes are joined upward. Each node is measured from its children, and once it is, its grandchildren are
//! fitted as one block.

use std::borrow::Cow;
use std::sync::Arc;

use super::fit::BlockMeasure;
use super::group_transmittance::GroupTransmittance;
use super::line_mask::{LineMask, MaskUnion, unite};
use super::measure::Measure;
use super::output::{CellWithMask, Output};
use super::projected_cell::Cell;
use super::refine::compose_group;
use crate::geom::projection::LINES;
use crate::morton;

/// Largest difference of two albedos that count as one: over all depths it adds up to far less than a step of a code.
const SAME_ALBEDO: f64 = 1e-9;

/// Up to eight nodes, in child order.
pub type Siblings = [Option<Box<Node>>; 8];

/// A node whose voxel is not fitted yet, with its children, whose voxels are not fitted either.
pub struct Node {
    measure: Box<Measure>,
    mask: Arc<LineMask>,
    children: Children,
    /// Lines that only the insides of solids cover, which are not measured in the node.
    inside: Option<Box<LineMask>>,
    /// Transmittances of the node's fitted voxels: those two depths below it, three, and so on, as far as they are corrected.
    groups: Vec<GroupTransmittance>,
}

/// Children of a node.
#[derive(Default)]
struct Children {
    /// Which of the eight there are; 0 on the finest depth and for a terminal node.
    mask: u8,
    /// Those that there are, in child order.
    nodes: Vec<Child>,
}

/// Child whose voxel is not fitted yet.
struct Child {
    measure: Box<Measure>,
    /// Which children it has itself.
    mask: u8,
}

impl Children {
    /// Children with their indices.
    fn iter(&self) -> impl Iterator<Item = (usize, &Child)> {
        (0..8).filter(|j| self.mask >> j & 1 != 0).zip(&self.nodes)
    }
}

impl Node {
    /// Node without children.
    pub fn leaf(measure: Box<Measure>, mask: Arc<LineMask>) -> Node {
        Node { measure, mask, children: Children::default(), inside: None, groups: Vec::new() }
    }

    /// Node of a cube that is opaque throughout.
    pub fn solid() -> Node {
        Node::leaf(Box::new(Measure::full()), LineMask::full().clone())
    }

    /// Whether the node is one opaque cube without a face in it.
    fn is_terminal_solid(&self) -> bool {
        self.measure.solid && self.children.mask == 0
    }
}

/// Position of the cell with this Morton code in its block.
fn cell_position(code: usize) -> [u8; 3] {
    morton::decode(code as u64).map(|v| v as u8)
}

/// Whether the child `j` is measured in its parent. The opaque inside of a solid is not: rays come to it through its faces, which
/// cover the same lines already. But where it has no neighbour at a side, it has no face there, and has to be measured itself.
fn is_measured_in_parent(children: &Siblings, j: usize) -> bool {
    let Some(child) = &children[j] else { return false };
    !child.is_terminal_solid() || [1, 2, 4].iter().any(|side| children[j ^ side].is_none())
}

/// Coverage of a block: what is measured of its node, and the lines that only the insides of solids cover.
struct BlockCoverage<'a> {
    /// Oblique area, per axis.
    cover: [f64; 13],
    mask: Cow<'a, LineMask>,
}

impl<'a> BlockCoverage<'a> {
    /// Coverage of `measure`, whose `mask` has these numbers of `lines` per axis, with the lines `inside`.
    fn new(measure: &Measure, mask: &'a LineMask, lines: [u32; 13], inside: Option<&LineMask>) -> BlockCoverage<'a> {
        let mut cover = measure.cover;
        let Some(inside) = inside else { return BlockCoverage { cover, mask: Cow::Borrowed(mask) } };
        let mut all = mask.clone();
        all.unite_with(inside);
        for (cover, (with, without)) in cover.iter_mut().zip(all.counts().into_iter().zip(lines)) {
            *cover += f64::from(with - without) / (LINES * LINES) as f64;
        }
        BlockCoverage { cover, mask: Cow::Owned(all) }
    }
}

/// Parent, at `depth`, of `children`; its grandchildren are fitted into `output`. `None` where there are no children.
pub fn join(depth: usize, children: Siblings, output: &mut Output) -> Option<Box<Node>> {
    if children.iter().all(Option::is_none) {
        return None;
    }
    if children.iter().all(|c| c.as_ref().is_some_and(|c| c.is_terminal_solid())) {
        return children.into_iter().next().flatten();
    }
    let measured: [bool; 8] = std::array::from_fn(|j| is_measured_in_parent(&children, j));
    let union = unite_masks(depth, &children, measured, output.options.track_materials);
    let measure = measure_parent(&children, measured, &union);
    let inside = unite_insides(depth, &children, measured);
    let coverage = BlockCoverage::new(&measure, &union.mask, union.lines, inside.as_deref());
    let groups = fit_grandchildren(depth, &children, &measure, &coverage, output);
    let children = release(children, measured, &measure);
    Some(Box::new(Node { measure, mask: Arc::new(union.mask), children, inside, groups }))
}

/// Union of the line masks of the children that are `measured`.
fn unite_masks(depth: usize, children: &Siblings, measured: [bool; 8], track_materials: bool) -> MaskUnion {
    let child = |j: usize| children[j].as_ref().filter(|_| measured[j]);
    // Which children are visible matters only where they are not all of one colour.
    let mut albedos = (0..8).filter_map(child).filter(|c| c.measure.total > 0.0).map(|c| c.measure.albedo);
    let first = albedos.next();
    let same = albedos.all(|a| first.is_none_or(|first| (a - first).abs().max_element() < SAME_ALBEDO));
    unite(&std::array::from_fn(|j| child(j).map(|c| &*c.mask)), depth, track_materials || !same)
}

/// Measurements of the parent from the children that are `measured`.
fn measure_parent(children: &Siblings, measured: [bool; 8], union: &MaskUnion) -> Box<Measure> {
    let child = |j: usize| children[j].as_ref().filter(|_| measured[j]).map(|c| &*c.measure);
    let mut measure = Box::new(Measure::of_children(&std::array::from_fn(child), union));
    measure.mean_opacity += (0..8).filter(|&j| children[j].is_some() && !measured[j]).count() as f64 / 8.0;
    measure
}

/// Union of the lines of the children that are not `measured`, and of those that are not measured in the others.
fn unite_insides(depth: usize, children: &Siblings, measured: [bool; 8]) -> Option<Box<LineMask>> {
    let inside: [Option<&LineMask>; 8] = std::array::from_fn(|j| match &children[j] {
        Some(child) if measured[j] => child.inside.as_deref(),
        child => child.as_ref().map(|c| &*c.mask),
    });
    inside.iter().any(Option::is_some).then(|| Box::new(unite(&inside, depth, false).mask))
}

/// Fit the grandchildren of the node at `depth`, and correct the rates of the groups of blocks below it. Returns the
/// transmittances of those, finest last, that the node's own parent needs.
fn fit_grandchildren(
    depth: usize,
    children: &Siblings,
    measure: &Measure,
    coverage: &BlockCoverage,
    output: &mut Output,
) -> Vec<GroupTransmittance> {
    let solid = children.each_ref().map(|c| c.as_ref().is_some_and(|c| c.is_terminal_solid()));
    let mut cells = Vec::with_capacity(64);
    for (j, child) in children.iter().enumerate() {
        let Some(child) = child else { continue };
        for (g, grandchild) in child.children.iter() {
            let cell = Cell { at: cell_position(j * 8 + g), measure: &grandchild.measure };
            cells.push(CellWithMask { cell, mask: grandchild.mask });
        }
    }
    let mut groups = Vec::new();
    if !cells.is_empty() {
        let block =
            BlockMeasure { measure, mask: &coverage.mask, cover: coverage.cover, solid_octants: solid, width: 4 };
        groups.extend(output.fit(depth + 2, cells, &block));
    }
    for size in 1..=output.options.refine {
        let parts = children.each_ref().map(|c| c.as_ref().and_then(|c| c.groups.get(size - 1)));
        // Soft matter is independent from block to block, as the march assumes, and needs no correction. Its groups are composed all
        // the same: larger groups that they are part of may need a correction, which is applied to as many voxels as a group counts.
        let group = if measure.is_soft() {
            compose_group(&parts, solid)
        } else {
            output.correct(depth + 2 + size, &parts, solid, &coverage.cover)
        };
        let Some(group) = group else { break };
        groups.push(group);
    }
    // The parent corrects no group that is larger.
    groups.truncate(output.options.refine);
    groups
}

/// Children whose own children are fitted.
fn release(children: Siblings, measured: [bool; 8], parent: &Measure) -> Children {
    let mut left = Children::default();
    for (j, child) in children.into_iter().enumerate() {
        let Some(mut child) = child else { continue };
        left.mask |= 1 << j;
        if !measured[j] {
            child.measure.cover = [0.0; 13];
        }
        if child.measure.total == 0.0 {
            // Matter without facets, the inside of a solid, takes the colour around it.
            child.measure.albedo = parent.albedo;
            child.measure.materials = parent.materials.clone();
        }
        left.nodes.push(Child { measure: child.measure, mask: child.children.mask });
    }
    left
}

/// Nodes of one depth that may get another sibling yet.
struct PendingSiblings {
    /// Morton code of their parent.
    parent: u64,
    siblings: Siblings,
}

/// Joins nodes up to the root as they come, in Morton order, and fits the voxels in between.
pub struct TreeAssembler {
    /// Incomplete siblings, by their depth.
    pending: Vec<Option<PendingSiblings>>,
    root: Option<Box<Node>>,
}

impl TreeAssembler {
    /// Assembler of nodes of `depth`.
    pub fn new(depth: usize) -> TreeAssembler {
        TreeAssembler { pending: (0..=depth).map(|_| None).collect(), root: None }
    }

    /// Join all siblings that are complete before the node at `depth` with the Morton code `code`. It must be called before that
    /// node's own voxels are appended to `output`.
    pub fn finish_before(&mut self, depth: usize, code: u64, output: &mut Output) {
        for d in (1..=depth).rev() {
            let parent = code >> (3 * (depth - d + 1));
            if self.pending[d].as_ref().is_some_and(|pending| pending.parent != parent) {
                self.finish_siblings(d, output);
            }
        }
    }

    /// Add the node at `depth` with the Morton code `code`, which follows all nodes before.
    pub fn add(&mut self, depth: usize, code: u64, node: Box<Node>) {
        if depth == 0 {
            self.root = Some(node);
            return;
        }
        let new = || PendingSiblings { parent: code >> 3, siblings: Default::default() };
        self.pending[depth].get_or_insert_with(new).siblings[(code & 7) as usize] = Some(node);
    }

    /// Join the siblings at `depth`, of which no more will come.
    fn finish_siblings(&mut self, depth: usize, output: &mut Output) {
        let Some(PendingSiblings { parent, siblings }) = self.pending[depth].take() else { return };
        if let Some(node) = join(depth - 1, siblings, output) {
            self.add(depth - 1, parent, node);
        }
    }

    /// Join what is left, and fit the root and its children, as blocks of their own. Returns whether there is a root.
    pub fn finish(mut self, output: &mut Output) -> bool {
        for depth in (1..self.pending.len()).rev() {
            self.finish_siblings(depth, output);
        }
        let Some(root) = self.root else { return false };
        let coverage = BlockCoverage::new(&root.measure, &root.mask, root.mask.counts(), root.inside.as_deref());
        let block = |width| BlockMeasure {
            measure: &root.measure,
            mask: &coverage.mask,
            cover: coverage.cover,
            solid_octants: [false; 8],
            width,
        };
        let cells: Vec<CellWithMask> = root
            .children
            .iter()
            .map(|(j, child)| CellWithMask {
                cell: Cell { at: cell_position(j), measure: &child.measure },
                mask: child.mask,
            })
            .collect();
        if !cells.is_empty() {
            output.fit(1, cells, &block(2));
        }
        let cell = Cell { at: [0; 3], measure: &root.measure };
        output.fit(0, vec![CellWithMask { cell, mask: root.children.mask }], &block(1));
        output.materials = root.measure.materials;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::measure::VoxelAccumulator;
    use crate::bake::medium::cover_cube;
    use crate::bake::output::FitOptions;
    use crate::source::Medium;
    use crate::volume::Model;

    const FINEST: usize = 4;
    const REFINE: usize = 3;

    /// Leaf at the finest depth: smoke in the last octant of the root, and in all others a wall two voxels above the floor.
    fn leaf(code: u64) -> Option<Box<Node>> {
        let at = morton::decode(code);
        let scattered = at.iter().all(|&v| v >= 8);
        if !scattered && at[2] != 2 {
            return None;
        }
        let medium = Medium { scattered, ..Medium::even(at, 0, if scattered { 0.01 } else { 3.0 }, [0.5; 3]) };
        let mut gather = Box::new(VoxelAccumulator::new(false));
        gather.add_medium(&cover_cube(&medium, at, 0).unwrap(), &medium);
        gather.finish().map(|(measure, mask)| Box::new(Node::leaf(measure, mask)))
    }

    /// Node of `depth`; its groups are compared with the voxels that were appended for it.
    fn node(depth: usize, code: u64, output: &mut Output) -> Option<Box<Node>> {
        if depth == FINEST {
            return leaf(code);
        }
        let count = |output: &Output| -> Vec<usize> { output.depths.iter().map(|d| d.voxels.len()).collect() };
        let before = count(output);
        let children: Siblings = std::array::from_fn(|j| node(depth + 1, code << 3 | j as u64, output));
        let node = join(depth, children, output)?;
        let groups: Vec<usize> = node.groups.iter().map(|g| g.voxels).collect();
        let own = count(output).into_iter().zip(before).map(|(after, before)| after - before);
        let own: Vec<usize> = own.skip(depth + 2).take(REFINE).collect();
        assert_eq!(groups, own, "depth {depth}, node {code}");
        Some(node)
    }

    /// A group is corrected as the last voxels of its depth, as many as it says that it has.
    #[test]
    fn groups_count_all_voxels_below_them() {
        let mut output =
            Output::new(FINEST + 1, FitOptions { model: Model::Coverage, refine: REFINE, track_materials: false });
        let root = node(0, 0, &mut output).unwrap();
        assert!(!root.measure.is_soft(), "most of it is the wall");
        assert_eq!(root.groups.len(), FINEST - 1);
        assert_eq!(output.depths[FINEST].voxels.len(), 256 + 512);
    }
}
