//! The octree of a bake: regions are cut down to voxels in parallel, then joined upward; each node measures itself from its
//! children and, once it does, fits its grandchildren.

use std::borrow::Cow;
use std::sync::Arc;

use super::beams::Beams;
use super::cutout;
use super::fit::{Block, Cell, Certificate, fit_block};
use super::materials::Weights;
use super::measure::{Gather, Measure};
use super::medium::share;
use super::refine;
use super::refine::Passed;
use crate::geom::DVec3;
use crate::geom::projection::LINES;
use crate::morton;
use crate::source::Medium;
use crate::source::Staged;
use crate::volume::material::{COARSE, FINE};
use crate::volume::{Depth, Model};

/// A node whose voxel is not fitted yet, with its children, whose voxels are not either.
pub struct Node {
    measure: Box<Measure>,
    beams: Arc<Beams>,
    /// Children that there are; 0 on the finest depth and for a terminal node.
    mask: u8,
    /// In child order.
    children: Vec<(Box<Measure>, u8)>,
    /// Lines that the insides of solids block which are not measured.
    inside: Option<Box<Beams>>,
    /// What a ray finds of the voxels that are fitted: two depths below the node, three …, as far as they are refined.
    passed: Vec<Passed>,
}

/// Fitted voxels, a list a depth, in Morton order.
pub struct Output {
    pub depths: Vec<Depth>,
    /// A depth each.
    pub certificates: Vec<Certificate>,
    /// Of the root.
    pub materials: Weights,
    how: How,
}

/// How voxels are fitted.
#[derive(Debug, Clone, Copy)]
pub struct How {
    pub model: Model,
    /// How many levels of groups of blocks have their rates corrected.
    pub refine: usize,
    /// Whether voxels tell materials apart.
    pub materials: bool,
}

impl Output {
    pub fn new(depths: usize, how: How) -> Output {
        let certificates = vec![Certificate::default(); depths];
        Output { depths: vec![Depth::default(); depths], certificates, materials: Weights::default(), how }
    }

    /// Take over what follows in Morton order.
    pub fn append(&mut self, mut next: Output) {
        for (mine, theirs) in self.depths.iter_mut().zip(&mut next.depths) {
            mine.masks.append(&mut theirs.masks);
            mine.voxels.append(&mut theirs.voxels);
            mine.mixes.append(&mut theirs.mixes);
        }
        for (mine, theirs) in self.certificates.iter_mut().zip(&next.certificates) {
            mine.merge(theirs);
        }
    }

    /// Fit the block `cells`, of voxels at `depth` with masks, whose node is measured by `block`.
    fn fit(&mut self, depth: usize, cells: &[(Cell, u8)], block: &Block) -> Option<Passed> {
        let step = if depth + 1 == self.depths.len() { COARSE } else { FINE };
        let out = &mut self.depths[depth];
        out.masks.extend(cells.iter().map(|c| c.1));
        if self.how.materials {
            out.mixes.extend(cells.iter().map(|(c, _)| c.measure.materials.mix(step)));
        }
        let cells: Vec<Cell> = cells.iter().map(|(c, _)| Cell { at: c.at, measure: c.measure }).collect();
        let How { model, refine, .. } = self.how;
        fit_block(&cells, block, refine > 0, model, &mut out.voxels, &mut self.certificates[depth])
    }

    /// Correct the rates of what was fitted last at `depth`, the groups `children` side by side, whose node covers the
    /// oblique areas `cover`.
    fn refine(
        &mut self,
        depth: usize,
        children: &[Option<&Passed>; 8],
        solid: [bool; 8],
        cover: &[f64; 13],
    ) -> Option<Passed> {
        let (group, steps) = refine::group(children, solid, cover)?;
        let voxels = &mut self.depths[depth].voxels;
        let first = voxels.len().saturating_sub(group.voxels);
        refine::scale(&mut voxels[first..], steps);
        Some(group)
    }
}

fn place(code: usize) -> [u8; 3] {
    morton::decode(code as u64).map(|v| v as u8)
}

/// Measures one region, a cube of `2^levels` finest voxels.
pub struct Region<'a> {
    pub staged: &'a dyn Staged,
    pub output: Output,
    /// Lowest voxel.
    pub origin: [u32; 3],
    pub levels: usize,
    /// By code of a voxel, whether it is without facets, and then whether it is inside.
    bare: Vec<Option<bool>>,
}

impl<'a> Region<'a> {
    pub fn new(staged: &'a dyn Staged, output: Output, origin: [u32; 3], levels: usize) -> Region<'a> {
        Region { staged, output, origin, levels, bare: vec![None; 1 << (3 * levels)] }
    }

    /// The region's node, which is of `depth`, from the facets of the staged region `index`.
    pub fn node(&mut self, index: usize, depth: usize) -> Option<Box<Node>> {
        let corner = DVec3::from(self.origin.map(f64::from));
        let width = f64::from(1u32 << self.levels);
        let told = self.output.how.materials;
        // Voxels by code, as places in `voxels` from 1 on.
        let mut places = vec![0u32; 1 << (3 * self.levels)];
        let mut voxels: Vec<(u32, Box<Gather>)> = Vec::new();
        self.staged.emit(index, &mut |facet| {
            cutout::pieces(self.staged, facet, corner, corner + width, &mut |piece, at, cut| {
                let cell = (at - corner).clamp(DVec3::ZERO, DVec3::splat(width - 1.0)).as_uvec3();
                let code = morton::encode(cell.to_array()) as usize;
                if places[code] == 0 {
                    voxels.push((code as u32, Box::new(Gather::new(told))));
                    places[code] = voxels.len() as u32;
                }
                voxels[places[code] as usize - 1].1.add(self.staged, piece, at, cut);
            });
        });
        voxels.sort_unstable_by_key(|v| v.0);
        let mut media: Vec<(u32, Medium)> = Vec::new();
        self.staged.medium(index, &mut |medium| {
            let cell: [u32; 3] = std::array::from_fn(|axis| medium.at[axis].wrapping_sub(self.origin[axis]));
            let inner = cell.iter().all(|&c| c >> self.levels == 0) && medium.levels as usize <= self.levels;
            if inner && medium.is_valid() {
                media.push((morton::encode(cell) as u32, *medium));
            }
        });
        media.sort_by_key(|m| m.0);
        let mut matter = Matter { voxels: voxels.into_iter().peekable(), media: media.into_iter().peekable() };
        self.cube(depth, self.levels, 0, None, &mut matter)
    }

    /// The node at `depth` of the cube of `2^levels` voxels from `code` on, whose matter comes next, and which lies in the
    /// cube of the medium `within`.
    fn cube(
        &mut self,
        depth: usize,
        levels: usize,
        code: u32,
        within: Option<&Medium>,
        matter: &mut Matter,
    ) -> Option<Box<Node>> {
        let end = code + (1 << (3 * levels));
        let own = matter.media.next_if(|m| m.0 == code && m.1.levels as usize >= levels);
        let within = own.as_ref().map(|m| &m.1).or(within);
        if levels > 0 && matter.comes_before(end) {
            let step = 1 << (3 * (levels - 1));
            let mut children: [Option<Box<Node>>; 8] = Default::default();
            for j in 0..8 {
                let from = code + step * j as u32;
                if within.is_some() || matter.comes_before(from + step) {
                    children[j] = self.cube(depth + 1, levels - 1, from, within, matter);
                    continue;
                }
                children[j] = self.is_inside(levels - 1, from).then(|| Box::new(Node::solid()));
            }
            return join(depth, children, &mut self.output);
        }
        let mut gather = matter.voxels.next_if(|v| v.0 < end).map(|v| v.1);
        if let Some(medium) = within
            && let Some(share) = share(medium, self.lowest(code), levels as u32)
        {
            let told = self.output.how.materials;
            gather.get_or_insert_with(|| Box::new(Gather::new(told))).add_medium(&share, medium);
        }
        match gather.and_then(|g| g.finish()) {
            Some((measure, beams)) => {
                Some(Box::new(Node { measure, beams, mask: 0, children: Vec::new(), inside: None, passed: Vec::new() }))
            }
            // Facets of no area: as if there were none.
            None => self.is_inside(levels, code).then(|| Box::new(Node::solid())),
        }
    }

    /// The voxel of `code`, in the grid.
    fn lowest(&self, code: u32) -> [u32; 3] {
        let low = morton::decode(u64::from(code));
        std::array::from_fn(|axis| self.origin[axis] + low[axis])
    }

    /// Whether the cube of `2^levels` voxels from `code` on, which has no facets, is opaque. As no facet is between two
    /// neighbours that have none, most know it from one that was asked before.
    fn is_inside(&mut self, levels: usize, code: u32) -> bool {
        let (low, edge, width) = (morton::decode(u64::from(code)), 1 << levels, 1 << self.levels);
        let beside = |axis: usize, at: u32| {
            let mut beside = low;
            beside[axis] = at;
            if at < width { self.bare[morton::encode(beside) as usize] } else { None }
        };
        let known = (0..3).find_map(|axis| {
            let before = low[axis].checked_sub(1).and_then(|at| beside(axis, at));
            before.or_else(|| beside(axis, low[axis] + edge))
        });
        let inside = known.unwrap_or_else(|| {
            let centre = DVec3::from(self.lowest(code).map(f64::from)) + 0.5 * f64::from(edge);
            self.staged.inside(centre)
        });
        let first = code as usize;
        self.bare[first..first + (1 << (3 * levels))].fill(Some(inside));
        inside
    }
}

/// What is left of a region's matter, by ascending code.
struct Matter {
    voxels: std::iter::Peekable<std::vec::IntoIter<(u32, Box<Gather>)>>,
    media: std::iter::Peekable<std::vec::IntoIter<(u32, Medium)>>,
}

impl Matter {
    /// Whether there is any before the code `end`.
    fn comes_before(&mut self, end: u32) -> bool {
        self.voxels.peek().is_some_and(|v| v.0 < end) || self.media.peek().is_some_and(|m| m.0 < end)
    }
}

impl Node {
    fn solid() -> Node {
        let (measure, beams) = (Box::new(Measure::full()), Beams::full().clone());
        Node { measure, beams, mask: 0, children: Vec::new(), inside: None, passed: Vec::new() }
    }

    /// Whether the node is one opaque cube without a face in it.
    fn is_terminal_solid(&self) -> bool {
        self.measure.solid && self.mask == 0
    }
}

/// Whether the child `j` is measured in its parent. Rays come to the opaque inside of a solid through its faces, and it would
/// only block once more what these block; but one that has nothing at a side has no face there either.
fn counts(children: &[Option<Box<Node>>; 8], j: usize) -> bool {
    let Some(child) = &children[j] else { return false };
    !child.is_terminal_solid() || [1, 2, 4].iter().any(|side| children[j ^ side].is_none())
}

/// What is measured and the lines of it, `lines` an axis, with those that meet nothing else than the `inside` of solids.
fn with_inside<'a>(
    measure: &Measure,
    (beams, lines): (&'a Beams, [u32; 13]),
    inside: Option<&Beams>,
) -> ([f64; 13], Cow<'a, Beams>) {
    let mut cover = measure.cover;
    let Some(inside) = inside else { return (cover, Cow::Borrowed(beams)) };
    let mut all = beams.clone();
    all.unite_with(inside);
    for (cover, (with, without)) in cover.iter_mut().zip(all.counts().into_iter().zip(lines)) {
        *cover += f64::from(with - without) / (LINES * LINES) as f64;
    }
    (cover, Cow::Owned(all))
}

/// Colours so near to each other are one: over all depths, by far no step of a code.
const ALIKE: f64 = 1e-9;

/// The parent, at `depth`, of `children`; its grandchildren are fitted into `output`. `None`: there are no children.
pub fn join(depth: usize, children: [Option<Box<Node>>; 8], output: &mut Output) -> Option<Box<Node>> {
    if children.iter().all(Option::is_none) {
        return None;
    }
    if children.iter().all(|c| c.as_ref().is_some_and(|c| c.is_terminal_solid())) {
        return children.into_iter().next().flatten();
    }
    let counts: [bool; 8] = std::array::from_fn(|j| counts(&children, j));
    let counted = |j: usize| children[j].as_ref().filter(|_| counts[j]);
    // Which of them are seen first is asked for where they are not all of one colour.
    let mut colours = (0..8).filter_map(counted).filter(|c| c.measure.total > 0.0).map(|c| c.measure.albedo);
    let first = colours.next();
    let alike = colours.all(|c| first.is_none_or(|first| (c - first).abs().max_element() < ALIKE));
    let seen = output.how.materials || !alike;
    let union = Beams::unite(&std::array::from_fn(|j| counted(j).map(|c| &*c.beams)), depth, seen);
    let mut measure = Box::new(Measure::of_children(&std::array::from_fn(|j| counted(j).map(|c| &*c.measure)), &union));
    measure.averaged += (0..8).filter(|&j| children[j].is_some() && !counts[j]).count() as f64 / 8.0;
    let inside: [Option<&Beams>; 8] = std::array::from_fn(|j| match &children[j] {
        Some(child) if counts[j] => child.inside.as_deref(),
        child => child.as_ref().map(|c| &*c.beams),
    });
    let inside = inside.iter().any(Option::is_some).then(|| Box::new(Beams::unite(&inside, depth, false).beams));
    let (cover, all) = with_inside(&measure, (&union.beams, union.lines), inside.as_deref());
    let mut cells = Vec::with_capacity(64);
    let mut mask = 0;
    for (j, child) in children.iter().enumerate() {
        let Some(child) = child else { continue };
        mask |= 1 << j;
        let present = (0..8).filter(|g| child.mask >> g & 1 != 0);
        for (g, (measure, mask)) in present.zip(&child.children) {
            cells.push((Cell { at: place(j * 8 + g), measure }, *mask));
        }
    }
    let solid = children.each_ref().map(|c| c.as_ref().is_some_and(|c| c.is_terminal_solid()));
    let mut passed = Vec::new();
    if !cells.is_empty() {
        let block = Block { measure: &measure, beams: &all, cover, closed: solid, width: 4 };
        passed.extend(output.fit(depth + 2, &cells, &block));
    }
    let refine = if measure.is_soft() { 0 } else { output.how.refine };
    for level in 1..=refine {
        let groups = children.each_ref().map(|c| c.as_ref().and_then(|c| c.passed.get(level - 1)));
        let Some(group) = output.refine(depth + 2 + level, &groups, solid, &cover) else { break };
        passed.push(group);
    }
    // What no level above asks for.
    passed.truncate(output.how.refine);
    let own = |(j, child): (usize, Option<Box<Node>>)| {
        let mut child = child?;
        if !counts[j] {
            child.measure.cover = [0.0; 13];
        }
        if child.measure.total == 0.0 {
            // Matter that no facet shows takes the colour around it.
            child.measure.albedo = measure.albedo;
            child.measure.materials = measure.materials.clone();
        }
        Some((child.measure, child.mask))
    };
    let children = children.into_iter().enumerate().filter_map(own).collect();
    Some(Box::new(Node { measure, beams: Arc::new(union.beams), mask, children, inside, passed }))
}

/// Up to eight nodes, in child order.
type Siblings = [Option<Box<Node>>; 8];

/// Joins nodes up to the root as they come, in Morton order, and fits what is between.
pub struct Joiner {
    /// Siblings that may get another yet, by their depth: their parent's code and themselves.
    pending: Vec<Option<(u64, Siblings)>>,
    root: Option<Box<Node>>,
}

impl Joiner {
    /// For nodes of `depth`.
    pub fn new(depth: usize) -> Joiner {
        Joiner { pending: (0..=depth).map(|_| None).collect(), root: None }
    }

    /// Join what is complete before the node at `depth` with the Morton code `code`, whose voxels are not in `output` yet.
    pub fn make_way(&mut self, depth: usize, code: u64, output: &mut Output) {
        for d in (1..=depth).rev() {
            let parent = code >> (3 * (depth - d + 1));
            if self.pending[d].as_ref().is_some_and(|(pending, _)| *pending != parent) {
                self.close(d, output);
            }
        }
    }

    /// Add the node at `depth` with the Morton code `code`, which follows all before.
    pub fn add(&mut self, depth: usize, code: u64, node: Box<Node>) {
        if depth == 0 {
            self.root = Some(node);
            return;
        }
        let (_, siblings) = self.pending[depth].get_or_insert_with(|| (code >> 3, Default::default()));
        siblings[(code & 7) as usize] = Some(node);
    }

    /// Join the siblings at `depth`, to which none will be added.
    fn close(&mut self, depth: usize, output: &mut Output) {
        let Some((code, siblings)) = self.pending[depth].take() else { return };
        if let Some(parent) = join(depth - 1, siblings, output) {
            self.add(depth - 1, code, parent);
        }
    }

    /// Join what is left, and fit the root and its children. Gives whether there is a root.
    pub fn finish(mut self, output: &mut Output) -> bool {
        for depth in (1..self.pending.len()).rev() {
            self.close(depth, output);
        }
        let Some(root) = self.root else { return false };
        let (cover, beams) = with_inside(&root.measure, (&root.beams, root.beams.counts()), root.inside.as_deref());
        let block = |width| Block { measure: &root.measure, beams: &beams, cover, closed: [false; 8], width };
        // The root's children, then the root: blocks of their own.
        let present = (0..8).filter(|j| root.mask >> j & 1 != 0);
        let cells: Vec<(Cell, u8)> =
            present.zip(&root.children).map(|(j, (measure, mask))| (Cell { at: place(j), measure }, *mask)).collect();
        if !cells.is_empty() {
            output.fit(1, &cells, &block(2));
        }
        let cell = Cell { at: [0; 3], measure: &root.measure };
        output.fit(0, &[(cell, root.mask)], &block(1));
        output.materials = root.measure.materials;
        true
    }
}
