//! The octree of a bake: regions are cut down to voxels in parallel, then joined upward; each node measures itself from its
//! children and, once it does, fits its grandchildren.

use super::beams::Beams;
use super::cutout;
use super::fit::{Cell, Certificate, fit_block};
use super::measure::{Gather, Measure};
use super::medium::{Medium, share};
use super::source::Staged;
use crate::geom::DVec3;
use crate::morton;
use crate::volume::{Depth, Model};

/// A node whose voxel is not fitted yet, with its children, whose voxels are not either.
pub struct Node {
    measure: Measure,
    beams: Beams,
    /// Children that there are; 0 on the finest depth and for a terminal node.
    mask: u8,
    /// In child order.
    children: Vec<(Measure, u8)>,
}

/// Fitted voxels, a list a depth, in Morton order.
pub struct Output {
    pub depths: Vec<Depth>,
    /// A depth each.
    pub certificates: Vec<Certificate>,
    model: Model,
}

impl Output {
    pub fn new(depths: usize, model: Model) -> Output {
        Output { depths: vec![Depth::default(); depths], certificates: vec![Certificate::default(); depths], model }
    }

    /// Take over what follows in Morton order.
    pub fn append(&mut self, mut next: Output) {
        for (mine, theirs) in self.depths.iter_mut().zip(&mut next.depths) {
            mine.masks.append(&mut theirs.masks);
            mine.voxels.append(&mut theirs.voxels);
        }
        for (mine, theirs) in self.certificates.iter_mut().zip(&next.certificates) {
            mine.merge(theirs);
        }
    }

    /// Fit the block `cells`, of voxels at `depth` with masks, whose node is measured by `block`.
    fn fit(&mut self, depth: usize, cells: &[(Cell, u8)], block: &Measure, width: usize) {
        let out = &mut self.depths[depth];
        out.masks.extend(cells.iter().map(|c| c.1));
        let cells: Vec<Cell> = cells.iter().map(|(c, _)| Cell { at: c.at, measure: c.measure }).collect();
        fit_block(&cells, block, width, self.model, &mut out.voxels, &mut self.certificates[depth]);
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
}

impl Region<'_> {
    /// The region's node, which is of `depth`, from the facets of the staged region `index`.
    pub fn node(&mut self, index: usize, depth: usize) -> Option<Box<Node>> {
        let corner = DVec3::from(self.origin.map(f64::from));
        let width = f64::from(1u32 << self.levels);
        // Voxels by code, as places in `voxels` from 1 on.
        let mut places = vec![0u32; 1 << (3 * self.levels)];
        let mut voxels: Vec<(u32, Box<Gather>)> = Vec::new();
        self.staged.emit(index, &mut |facet| {
            cutout::pieces(self.staged, facet, corner, corner + width, &mut |piece, at, cut| {
                let cell = (at - corner).clamp(DVec3::ZERO, DVec3::splat(width - 1.0)).as_uvec3();
                let code = morton::encode(cell.to_array()) as usize;
                if places[code] == 0 {
                    voxels.push((code as u32, Box::new(Gather::new())));
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
        let faces = matter.voxels.peek().is_some_and(|v| v.0 < end);
        if levels > 0 && (faces || matter.media.peek().is_some_and(|m| m.0 < end)) {
            let step = 1 << (3 * (levels - 1));
            let children =
                std::array::from_fn(|j| self.cube(depth + 1, levels - 1, code + step * j as u32, within, matter));
            return join(depth, children, &mut self.output);
        }
        let mut gather = if faces { matter.voxels.next().map(|v| v.1) } else { None };
        if let Some(medium) = within
            && let Some(share) = share(medium, self.lowest(code), levels as u32)
        {
            gather.get_or_insert_with(|| Box::new(Gather::new())).add_medium(&share, medium.albedo);
        }
        match gather.and_then(|g| g.finish()) {
            Some((measure, beams)) => Some(Box::new(Node { measure, beams, mask: 0, children: Vec::new() })),
            // Facets of no area: as if there were none.
            None => self.inner(levels, code),
        }
    }

    /// The voxel of `code`, in the grid.
    fn lowest(&self, code: u32) -> [u32; 3] {
        let low = morton::decode(u64::from(code));
        std::array::from_fn(|axis| self.origin[axis] + low[axis])
    }

    /// A cube without facets: opaque or nothing.
    fn inner(&self, levels: usize, code: u32) -> Option<Box<Node>> {
        let centre = DVec3::from(self.lowest(code).map(f64::from)) + 0.5 * f64::from(1u32 << levels);
        self.staged.inside(centre).then(|| Box::new(Node::solid()))
    }
}

/// What is left of a region's matter, by ascending code.
struct Matter {
    voxels: std::iter::Peekable<std::vec::IntoIter<(u32, Box<Gather>)>>,
    media: std::iter::Peekable<std::vec::IntoIter<(u32, Medium)>>,
}

impl Node {
    fn solid() -> Node {
        Node { measure: Measure::full(), beams: Beams::full().clone(), mask: 0, children: Vec::new() }
    }

    /// Whether the node is one opaque cube without a face in it.
    fn is_terminal_solid(&self) -> bool {
        self.measure.solid && self.mask == 0
    }
}

/// The parent, at `depth`, of `children`; its grandchildren are fitted into `output`. `None`: there are no children.
pub fn join(depth: usize, children: [Option<Box<Node>>; 8], output: &mut Output) -> Option<Box<Node>> {
    if children.iter().all(Option::is_none) {
        return None;
    }
    if children.iter().all(|c| c.as_ref().is_some_and(|c| c.is_terminal_solid())) {
        return children.into_iter().next().flatten();
    }
    let union = Beams::unite(&children.each_ref().map(|c| c.as_ref().map(|c| &c.beams)), depth);
    let measure = Measure::of_children(&children.each_ref().map(|c| c.as_ref().map(|c| &c.measure)), &union);
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
    if !cells.is_empty() {
        output.fit(depth + 2, &cells, &measure, 4);
    }
    let own = |mut child: Box<Node>| {
        if child.measure.total == 0.0 {
            // Matter that no facet shows takes the colour around it.
            child.measure.albedo = measure.albedo;
        }
        (child.measure, child.mask)
    };
    let children = children.into_iter().flatten().map(own).collect();
    Some(Box::new(Node { measure, beams: union.beams, mask, children }))
}

/// Join the nodes of `depth`, given with their Morton codes in order, up to the root, and fit what is left. Gives whether
/// there is a root.
pub fn join_up(depth: usize, nodes: Vec<(u64, Box<Node>)>, output: &mut Output) -> bool {
    let (mut depth, mut nodes) = (depth, nodes);
    while depth > 0 {
        depth -= 1;
        let mut parents: Vec<(u64, Box<Node>)> = Vec::new();
        let mut nodes_left = nodes.into_iter().peekable();
        while let Some(&(code, _)) = nodes_left.peek() {
            let parent = code >> 3;
            let mut children: [Option<Box<Node>>; 8] = Default::default();
            while let Some((code, node)) = nodes_left.next_if(|(c, _)| c >> 3 == parent) {
                children[(code & 7) as usize] = Some(node);
            }
            parents.extend(join(depth, children, output).map(|node| (parent, node)));
        }
        nodes = parents;
    }
    let Some((_, root)) = nodes.into_iter().next() else { return false };
    // The root's children, then the root: blocks of their own.
    let present = (0..8).filter(|j| root.mask >> j & 1 != 0);
    let cells: Vec<(Cell, u8)> =
        present.zip(&root.children).map(|(j, (measure, mask))| (Cell { at: place(j), measure }, *mask)).collect();
    if !cells.is_empty() {
        output.fit(1, &cells, &root.measure, 2);
    }
    output.fit(0, &[(Cell { at: [0; 3], measure: &root.measure }, root.mask)], &root.measure, 1);
    true
}
