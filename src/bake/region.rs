//! One region of a bake: its facets are cut into the finest voxels, and these are joined to the region's node.

use std::iter::Peekable;
use std::vec::IntoIter;

use super::clip::for_each_piece;
use super::measure::VoxelAccumulator;
use super::medium::cover_cube;
use super::output::Output;
use super::tree::{Node, Siblings, join};
use crate::geom::DVec3;
use crate::morton;
use crate::source::{Medium, Staged};

/// A region while it is measured: a cube of `2^log2` finest voxels per edge.
pub struct Region<'a> {
    staged: &'a dyn Staged,
    pub output: Output,
    /// Lowest voxel, in the grid.
    origin: [u32; 3],
    log2: usize,
    /// For each voxel without facets, by Morton code, whether it is within opaque matter, once that is known.
    inside: Vec<Option<bool>>,
}

/// Cube of `2^log2` voxels per edge within a region.
#[derive(Clone, Copy)]
struct Cube {
    /// Depth of the cube's node.
    depth: usize,
    log2: usize,
    /// Morton code, within the region, of its lowest voxel.
    code: u32,
}

impl Cube {
    /// Morton code after the last voxel of the cube.
    fn end(&self) -> u32 {
        self.code + (1 << (3 * self.log2))
    }

    /// Octant `j`.
    fn child(&self, j: usize) -> Cube {
        let log2 = self.log2 - 1;
        Cube { depth: self.depth + 1, log2, code: self.code + ((j as u32) << (3 * log2)) }
    }
}

/// Matter of a region that is not joined yet, by ascending Morton code.
struct Matter {
    voxels: Peekable<IntoIter<(u32, Box<VoxelAccumulator>)>>,
    media: Peekable<IntoIter<(u32, Medium)>>,
}

impl Matter {
    /// Whether there is matter before the code `end`.
    fn comes_before(&mut self, end: u32) -> bool {
        self.voxels.peek().is_some_and(|v| v.0 < end) || self.media.peek().is_some_and(|m| m.0 < end)
    }
}

impl<'a> Region<'a> {
    /// Region of `2^log2` voxels per edge whose lowest voxel is `origin`; its voxels go to `output`.
    pub fn new(staged: &'a dyn Staged, output: Output, origin: [u32; 3], log2: usize) -> Region<'a> {
        Region { staged, output, origin, log2, inside: vec![None; 1 << (3 * log2)] }
    }

    /// Node, at `depth`, of the region, from the matter of the staged region `index`; `None` where there is none.
    pub fn node(&mut self, index: usize, depth: usize) -> Option<Box<Node>> {
        let voxels = self.gather_facets(index);
        let media = self.gather_media(index);
        let mut matter = Matter { voxels: voxels.into_iter().peekable(), media: media.into_iter().peekable() };
        self.node_of_cube(Cube { depth, log2: self.log2, code: 0 }, None, &mut matter)
    }

    /// Facets cut into voxels, each with its Morton code.
    fn gather_facets(&self, index: usize) -> Vec<(u32, Box<VoxelAccumulator>)> {
        let corner = DVec3::from(self.origin.map(f64::from));
        let width = f64::from(1u32 << self.log2);
        let track_materials = self.output.options.track_materials;
        // For each code, the index in `voxels` plus 1, or 0 where there is no voxel yet.
        let mut places = vec![0u32; 1 << (3 * self.log2)];
        let mut voxels: Vec<(u32, Box<VoxelAccumulator>)> = Vec::new();
        self.staged.emit(index, &mut |facet| {
            for_each_piece(self.staged, facet, corner, corner + width, &mut |piece, at, alpha| {
                let cell = (at - corner).clamp(DVec3::ZERO, DVec3::splat(width - 1.0)).as_uvec3();
                let code = morton::encode(cell.to_array()) as usize;
                if places[code] == 0 {
                    voxels.push((code as u32, Box::new(VoxelAccumulator::new(track_materials))));
                    places[code] = voxels.len() as u32;
                }
                voxels[places[code] as usize - 1].1.add(self.staged, piece, at, alpha);
            });
        });
        voxels.sort_unstable_by_key(|v| v.0);
        voxels
    }

    /// Media in the region, each with its Morton code; invalid ones are left out.
    fn gather_media(&self, index: usize) -> Vec<(u32, Medium)> {
        let mut media: Vec<(u32, Medium)> = Vec::new();
        self.staged.medium(index, &mut |medium| {
            let cell: [u32; 3] = std::array::from_fn(|axis| medium.at[axis].wrapping_sub(self.origin[axis]));
            let within = cell.iter().all(|&c| c >> self.log2 == 0) && medium.edge_log2 as usize <= self.log2;
            if within && medium.is_valid() {
                media.push((morton::encode(cell) as u32, *medium));
            }
        });
        media.sort_by_key(|m| m.0);
        media
    }

    /// Node of `cube`, whose matter comes next in `matter`; `within` is the medium in whose larger cube it lies, if any.
    fn node_of_cube(&mut self, cube: Cube, within: Option<&Medium>, matter: &mut Matter) -> Option<Box<Node>> {
        let own = matter.media.next_if(|m| m.0 == cube.code && m.1.edge_log2 as usize >= cube.log2);
        let within = own.as_ref().map(|m| &m.1).or(within);
        if cube.log2 > 0 && matter.comes_before(cube.end()) {
            let mut children: Siblings = Default::default();
            for (j, node) in children.iter_mut().enumerate() {
                let child = cube.child(j);
                *node = if within.is_some() || matter.comes_before(child.end()) {
                    self.node_of_cube(child, within, matter)
                } else {
                    self.solid_node(child)
                };
            }
            return join(cube.depth, children, &mut self.output);
        }
        let mut gather = matter.voxels.next_if(|v| v.0 < cube.end()).map(|v| v.1);
        if let Some(medium) = within
            && let Some(part) = cover_cube(medium, self.lowest(cube.code), cube.log2 as u32)
        {
            let track_materials = self.output.options.track_materials;
            gather.get_or_insert_with(|| Box::new(VoxelAccumulator::new(track_materials))).add_medium(&part, medium);
        }
        match gather.and_then(|g| g.finish()) {
            Some((measure, mask)) => Some(Box::new(Node::leaf(measure, mask))),
            // Facets without area count as if there were none.
            None => self.solid_node(cube),
        }
    }

    /// Solid node of a cube without facets where it is within opaque matter.
    fn solid_node(&mut self, cube: Cube) -> Option<Box<Node>> {
        self.is_inside(cube).then(|| Box::new(Node::solid()))
    }

    /// Position in the grid of the voxel of `code`.
    fn lowest(&self, code: u32) -> [u32; 3] {
        let low = morton::decode(u64::from(code));
        std::array::from_fn(|axis| self.origin[axis] + low[axis])
    }

    /// Whether `cube`, which has no facets, is within opaque matter. No facet is between two neighbours without facets, so most
    /// cubes take the answer of a neighbour, and few points are asked for.
    fn is_inside(&mut self, cube: Cube) -> bool {
        let (low, edge, width) = (morton::decode(u64::from(cube.code)), 1 << cube.log2, 1 << self.log2);
        let neighbour = |axis: usize, at: u32| {
            let mut cell = low;
            cell[axis] = at;
            if at < width { self.inside[morton::encode(cell) as usize] } else { None }
        };
        let known = (0..3).find_map(|axis| {
            let before = low[axis].checked_sub(1).and_then(|at| neighbour(axis, at));
            before.or_else(|| neighbour(axis, low[axis] + edge))
        });
        let inside = known.unwrap_or_else(|| {
            let centre = DVec3::from(self.lowest(cube.code).map(f64::from)) + 0.5 * f64::from(edge);
            self.staged.inside(centre)
        });
        self.inside[cube.code as usize..cube.end() as usize].fill(Some(inside));
        inside
    }
}
