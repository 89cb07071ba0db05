//! The octree as rays traverse it: in 4^3 blocks, which span two depths each and are decoded when a ray first enters one.
//!
//! Based on: C. Crassin et al., *GigaVoxels*, I3D 2009 (bricks decoded on demand); S. Laine, T. Karras, *Efficient Sparse
//! Voxel Octrees*, I3D 2010 (masks and popcounts instead of pointers).
//!
//! A file lists the nodes of each depth in Morton order. So the grandchildren of a node, at most 64, are consecutive, and a mask
//! of 64 bits together with the rank (the index within its depth) of the first grandchild finds any of them. That is a
//! [`Block`]. A ray that reads voxels of depth d traverses the blocks of nodes at depths d − 2, d − 4, … up to the root.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use super::brightness::{self, BrightnessFactors};
use super::surface::{SurfaceTable, VoxelSurface};
use super::{Info, MAX_DEPTH, Mix, Model, Volume, Voxel};
use crate::geom::Vec3;
use crate::{Error, Result};

/// log2 of the number of voxels in a page in memory.
pub const PAGE_LOG2: u32 = 12;
pub(crate) const PAGE: usize = 1 << PAGE_LOG2;
/// Most nodes of a depth.
const MAX_NODES: usize = u32::MAX as usize - 1;

/// Provider of an [`Octree`]'s content: a file's reader, or a volume in memory. Each call may be slow, so an octree asks only once
/// for the masks of a depth and for the voxels of a page. It asks for surfaces only where a material is more than matt and
/// opaque, and never for mixes: [`super::palette`] reads those to find the colours of restyled materials.
pub trait Pages: Send + Sync {
    /// Description of the texel.
    fn info(&self) -> &Info;
    /// Number of nodes of each depth, root first.
    fn counts(&self) -> Vec<usize>;
    /// Child masks of all nodes at `depth`, in Morton order.
    fn masks(&self, depth: usize) -> Result<Vec<u8>>;
    /// Voxels of a page: of the voxels of `depth` in Morton order those from `page` · 4096 on, 4096 or as many as are left.
    fn voxels(&self, depth: usize, page: usize) -> Result<Vec<Voxel>>;
    /// Shares of the texel's materials that the voxels of a page show; empty where there are fewer than two.
    fn mixes(&self, _depth: usize, _page: usize) -> Result<Vec<Mix>> {
        Ok(Vec::new())
    }
    /// Properties of the materials besides their albedo; `None` where all are matt, opaque and lit.
    fn surface_table(&self) -> Option<SurfaceTable> {
        SurfaceTable::new(self.info())
    }
    /// Surfaces of the `voxels` of a page, from the `table` that [`Pages::surface_table`] gave.
    fn surfaces(&self, depth: usize, page: usize, voxels: &[Voxel], table: &SurfaceTable) -> Result<Vec<VoxelSurface>> {
        let mixes = if table.needs_mixes() { self.mixes(depth, page)? } else { Vec::new() };
        let of = |(i, v): (usize, &Voxel)| table.own_surface(v.albedo(), &mixes.get(i).copied().unwrap_or_default());
        Ok(voxels.iter().enumerate().map(of).collect())
    }
}

impl<P: Pages + ?Sized> Pages for Arc<P> {
    fn info(&self) -> &Info {
        (**self).info()
    }
    fn counts(&self) -> Vec<usize> {
        (**self).counts()
    }
    fn masks(&self, depth: usize) -> Result<Vec<u8>> {
        (**self).masks(depth)
    }
    fn voxels(&self, depth: usize, page: usize) -> Result<Vec<Voxel>> {
        (**self).voxels(depth, page)
    }
    fn mixes(&self, depth: usize, page: usize) -> Result<Vec<Mix>> {
        (**self).mixes(depth, page)
    }
    fn surface_table(&self) -> Option<SurfaceTable> {
        (**self).surface_table()
    }
    fn surfaces(&self, depth: usize, page: usize, voxels: &[Voxel], table: &SurfaceTable) -> Result<Vec<VoxelSurface>> {
        (**self).surfaces(depth, page, voxels, table)
    }
}

impl Pages for Volume {
    fn info(&self) -> &Info {
        &self.info
    }
    fn counts(&self) -> Vec<usize> {
        self.depths.iter().map(|d| d.voxels.len()).collect()
    }
    fn masks(&self, depth: usize) -> Result<Vec<u8>> {
        Ok(self.depths[depth].masks.clone())
    }
    fn voxels(&self, depth: usize, page: usize) -> Result<Vec<Voxel>> {
        Ok(slice(&self.depths[depth].voxels, page))
    }
    fn mixes(&self, depth: usize, page: usize) -> Result<Vec<Mix>> {
        Ok(slice(&self.depths[depth].mixes, page))
    }
}

fn slice<T: Copy>(all: &[T], page: usize) -> Vec<T> {
    all[(page * PAGE).min(all.len())..((page + 1) * PAGE).min(all.len())].to_vec()
}

/// The 4^3 cells two depths below a node. The index of a cell is the Morton code of its position in the block, 0 … 63.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Block {
    /// Occupied cells.
    pub mask: u64,
    /// Occupied cells that are part of a terminal node above their depth: all 8 cells of a child, or all 64 of the node.
    pub terminal: u64,
    /// Rank, in its depth, of the first cell that is not terminal.
    first: u32,
    /// Rank of the node's first child, one depth down, or [`SELF_TERMINAL`].
    child: u32,
}

/// Address of a voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VoxelAddress {
    /// Depth of the voxel; 0 is the root.
    pub depth: u8,
    /// Index of the voxel among those of its depth, in Morton order.
    pub rank: u32,
}

/// Value of [`Block`]'s `child` where the block's own node is terminal.
const SELF_TERMINAL: u32 = u32::MAX;

impl Block {
    /// No occupied cell.
    pub const EMPTY: Block = Block { mask: 0, terminal: 0, first: 0, child: 0 };

    /// Rank of the occupied, non-terminal `cell`, in the depth two below the block's node.
    #[inline(always)]
    pub fn rank(&self, cell: u32) -> u32 {
        let below = self.mask & !self.terminal & ((1u64 << cell) - 1);
        self.first + below.count_ones()
    }

    /// Address of the voxel that fills the occupied `cell`, where the block belongs to the node `node` of `depth`. Depths −2 and
    /// −1 are those of the virtual roots: see [`Octree::blocks`].
    #[inline(always)]
    pub fn address(&self, depth: i32, node: u32, cell: u32) -> VoxelAddress {
        if self.terminal >> cell & 1 == 0 {
            return VoxelAddress { depth: (depth + 2) as u8, rank: self.rank(cell) };
        }
        self.terminal_address(depth, node, cell)
    }

    #[cold]
    fn terminal_address(&self, depth: i32, node: u32, cell: u32) -> VoxelAddress {
        if self.child == SELF_TERMINAL {
            return VoxelAddress { depth: depth as u8, rank: node };
        }
        let earlier = (0..cell >> 3).filter(|j| self.mask >> (8 * j) & 255 != 0).count() as u32;
        VoxelAddress { depth: (depth + 1) as u8, rank: self.child + earlier }
    }

    /// Whether the whole block is one terminal node.
    pub fn is_terminal(&self) -> bool {
        self.child == SELF_TERMINAL
    }
}

/// Counts of the pages and voxels that were decoded so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct DecodedCounts {
    /// Voxel pages decoded.
    pub pages: u64,
    /// Voxels in them.
    pub voxels: u64,
    /// Deepest depth of which voxels were decoded.
    pub deepest: usize,
}

/// Voxels of a page, decoded when first asked for.
type Page = OnceLock<Box<[Voxel]>>;

/// Surfaces of the voxels of a page, found when first asked for.
type SurfacePage = OnceLock<Box<[VoxelSurface]>>;

/// Surfaces of the voxels, by depth and page like [`Octree::pages`].
struct Surfaces {
    table: SurfaceTable,
    pages: Vec<Box<[SurfacePage]>>,
}

/// A texel opened for rays: each depth's blocks and each page of voxels are made when first asked for, by any thread.
pub struct Octree {
    source: Box<dyn Pages>,
    counts: Vec<usize>,
    /// Child masks by depth. The blocks of two depths are made from each.
    masks: Vec<OnceLock<Box<[u8]>>>,
    /// Indexed by the node's depth + 2: slots 0 and 1 are the virtual roots of depths −2 and −1.
    blocks: Vec<OnceLock<Box<[Block]>>>,
    /// Indexed by depth, then page.
    pages: Vec<Box<[Page]>>,
    /// Surfaces of the voxels; `None` where all materials are matt, opaque and lit.
    surfaces: Option<Surfaces>,
    brightness_factors: [BrightnessFactors; MAX_DEPTH + 1],
    /// Box of the content, and model: copies of what the description says, since every march asks for them.
    content: (Vec3, Vec3),
    model: Model,
    failure: OnceLock<Error>,
    pages_decoded: AtomicU64,
    voxels_decoded: AtomicU64,
    deepest: AtomicU64,
}

impl Octree {
    /// Open a texel; only its counts are read.
    ///
    /// # Errors
    /// [`Error::Limit`] where there are more depths, or more nodes in a depth, than an octree may have.
    pub fn new(source: impl Pages + 'static) -> Result<Octree> {
        let counts = source.counts();
        let limit = |what: String, needed: usize, allowed: usize| {
            Err(Error::Limit { what, needed: needed as u64, allowed: allowed as u64 })
        };
        if counts.len() > MAX_DEPTH + 1 {
            return limit("the number of the octree's depths".into(), counts.len(), MAX_DEPTH + 1);
        }
        if let Some((depth, &n)) = counts.iter().enumerate().find(|(_, n)| **n > MAX_NODES) {
            return limit(format!("the number of voxels at depth {depth} of the octree"), n, MAX_NODES);
        }
        let pages = counts.iter().map(|n| (0..n.div_ceil(PAGE)).map(|_| OnceLock::new()).collect()).collect();
        let surfaces = source.surface_table().map(|table| {
            let pages = counts.iter().map(|n| (0..n.div_ceil(PAGE)).map(|_| OnceLock::new()).collect()).collect();
            Surfaces { table, pages }
        });
        Ok(Octree {
            brightness_factors: brightness::read(source.info()),
            content: (source.info().content.min.as_vec3(), source.info().content.max.as_vec3()),
            model: source.info().model,
            source: Box::new(source),
            masks: counts.iter().map(|_| OnceLock::new()).collect(),
            blocks: (0..counts.len() + 1).map(|_| OnceLock::new()).collect(),
            pages,
            surfaces,
            counts,
            failure: OnceLock::new(),
            pages_decoded: AtomicU64::new(0),
            voxels_decoded: AtomicU64::new(0),
            deepest: AtomicU64::new(0),
        })
    }

    /// Description of the texel.
    pub fn info(&self) -> &Info {
        self.source.info()
    }

    /// Lower and upper corner of the content's box, texel space, rounded to f32.
    pub fn content(&self) -> (Vec3, Vec3) {
        self.content
    }

    /// The model that the texel was baked by.
    pub fn model(&self) -> Model {
        self.model
    }

    /// The finest depth; `None` for a texel without matter.
    pub fn finest(&self) -> Option<usize> {
        (self.counts.first() == Some(&1)).then(|| self.counts.len() - 1)
    }

    /// Brightness factors of each depth, root first.
    pub fn brightness_factors(&self) -> &[BrightnessFactors; MAX_DEPTH + 1] {
        &self.brightness_factors
    }

    /// Number of nodes at `depth`; 0 where there is no such depth.
    pub fn count(&self, depth: usize) -> usize {
        self.counts.get(depth).copied().unwrap_or(0)
    }

    /// Blocks of the nodes at `depth`, in Morton order. `depth + 2` must not exceed the finest depth.
    ///
    /// Blocks go down two depths at a time, so a descent to an even depth begins with a virtual root at depth −2, whose one cell
    /// is the root, and a descent to an odd depth at depth −1, whose cells are the root's children. In both, the root's cube is at
    /// the lower corner of the block. After a failure to read, blocks are empty and [`Octree::failure`] tells why.
    #[inline(always)]
    pub fn blocks(&self, depth: i32) -> &[Block] {
        let slot = &self.blocks[(depth + 2) as usize];
        match slot.get() {
            Some(blocks) => blocks,
            None => self.open_blocks(depth),
        }
    }

    #[cold]
    fn open_blocks(&self, depth: i32) -> &[Block] {
        self.blocks[(depth + 2) as usize].get_or_init(|| {
            let blocks = self.build_blocks(depth);
            // Child masks that could not be read are 0, which would make every node terminal and fill the cube.
            if self.failure.get().is_none() { blocks } else { vec![Block::EMPTY; blocks.len()].into() }
        })
    }

    /// Child masks of `depth`, read when first asked for.
    fn masks(&self, depth: usize) -> &[u8] {
        let Some(slot) = self.masks.get(depth) else { return &[] };
        slot.get_or_init(|| {
            let mut masks = self.source.masks(depth).unwrap_or_else(|e| {
                let _ = self.failure.set(e);
                Vec::new()
            });
            masks.resize(self.counts[depth], 0);
            masks.into()
        })
    }

    fn build_blocks(&self, depth: i32) -> Box<[Block]> {
        if depth < 0 {
            let occupied = match depth {
                -2 => u64::from(self.count(0) == 1),
                _ => u64::from(self.masks(0).first().copied().unwrap_or(0)),
            };
            // A terminal root without children stands for all eight of them.
            if depth == -1 && occupied == 0 && self.count(0) == 1 {
                return Box::new([Block { mask: 255, terminal: 255, first: 0, child: 0 }]);
            }
            return Box::new([Block { mask: occupied, terminal: 0, first: 0, child: 0 }]);
        }
        let depth = depth as usize;
        let (nodes, children) = (self.masks(depth), self.masks(depth + 1));
        let (mut child, mut first) = (0u32, 0u32);
        let mut blocks = Vec::with_capacity(nodes.len());
        for &mask8 in nodes {
            if mask8 == 0 {
                blocks.push(Block { mask: u64::MAX, terminal: u64::MAX, first, child: SELF_TERMINAL });
                continue;
            }
            let mut block = Block { mask: 0, terminal: 0, first, child };
            for j in (0..8).filter(|j| mask8 >> j & 1 != 0) {
                let inner = children.get(child as usize).copied().unwrap_or(0);
                child += 1;
                first += inner.count_ones();
                let cells = if inner == 0 { 255 } else { inner };
                block.mask |= u64::from(cells) << (8 * j);
                if inner == 0 {
                    block.terminal |= 255 << (8 * j);
                }
            }
            blocks.push(block);
        }
        blocks.into()
    }

    /// Address of the voxel that fills the cell with the Morton code `code` at `depth`: its own, or a terminal node's above it.
    /// `None` where the cell is empty, or there is no such depth.
    pub fn find(&self, depth: usize, code: u64) -> Option<VoxelAddress> {
        if depth > self.finest()? || code >> (3 * depth) != 0 {
            return None;
        }
        let mut above = depth as i32 % 2 - 2;
        let mut node = 0;
        loop {
            let block = self.blocks(above).get(node as usize)?;
            let below = depth as i32 - above - 2;
            let cell = (code >> (3 * below)) as u32 & 63;
            if block.mask >> cell & 1 == 0 {
                return None;
            }
            if below == 0 || block.terminal >> cell & 1 != 0 {
                return Some(block.address(above, node, cell));
            }
            node = block.rank(cell);
            above += 2;
        }
    }

    /// Voxel at an address that [`Block::address`] or [`Octree::find`] gave.
    #[inline(always)]
    pub fn voxel(&self, address: VoxelAddress) -> &Voxel {
        let (page, slot) = (address.rank >> PAGE_LOG2, address.rank as usize & (PAGE - 1));
        let cell = &self.pages[address.depth as usize][page as usize];
        let voxels = match cell.get() {
            Some(voxels) => voxels,
            None => self.open_page(address.depth as usize, page as usize),
        };
        &voxels[slot]
    }

    /// Whether [`Octree::surface`] may be anything but the default.
    pub fn has_surfaces(&self) -> bool {
        self.surfaces.is_some()
    }

    /// Whether some material has single-sided sheets.
    pub fn has_one_sided(&self) -> bool {
        self.surfaces.as_ref().is_some_and(|s| s.table.has_one_sided())
    }

    /// Surface of the voxel at an address.
    pub fn surface(&self, address: VoxelAddress) -> VoxelSurface {
        let Some(Surfaces { table, pages }) = &self.surfaces else { return VoxelSurface::default() };
        let (depth, page) = (usize::from(address.depth), (address.rank >> PAGE_LOG2) as usize);
        let Some(cell) = pages.get(depth).and_then(|pages| pages.get(page)) else { return VoxelSurface::default() };
        let surfaces = cell.get_or_init(|| {
            let voxels = self.pages[depth][page].get().map_or_else(|| self.open_page(depth, page), |voxels| &**voxels);
            let read = self.source.surfaces(depth, page, voxels, table).unwrap_or_else(|e| {
                let _ = self.failure.set(e);
                Vec::new()
            });
            read.into()
        });
        surfaces.get(address.rank as usize & (PAGE - 1)).copied().unwrap_or_default()
    }

    #[cold]
    fn open_page(&self, depth: usize, page: usize) -> &[Voxel] {
        self.pages[depth][page].get_or_init(|| {
            let want = PAGE.min(self.counts[depth] - page * PAGE);
            let mut voxels = self.source.voxels(depth, page).unwrap_or_else(|e| {
                let _ = self.failure.set(e);
                Vec::new()
            });
            voxels.resize(want, Voxel::default());
            self.pages_decoded.fetch_add(1, Ordering::Relaxed);
            self.voxels_decoded.fetch_add(want as u64, Ordering::Relaxed);
            self.deepest.fetch_max(depth as u64, Ordering::Relaxed);
            voxels.into()
        })
    }

    /// Counts of the pages and voxels that were decoded so far.
    pub fn decoded(&self) -> DecodedCounts {
        DecodedCounts {
            pages: self.pages_decoded.load(Ordering::Relaxed),
            voxels: self.voxels_decoded.load(Ordering::Relaxed),
            deepest: self.deepest.load(Ordering::Relaxed) as usize,
        }
    }

    /// First failure to read, if any. It has to be checked once the rays are done, since matter that could not be read was treated
    /// as empty.
    pub fn failure(&self) -> Option<&Error> {
        self.failure.get()
    }

    /// [`Octree::failure`], owned.
    pub fn into_failure(self) -> Option<Error> {
        self.failure.into_inner()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::Depth;

    fn depth(masks: &[u8]) -> Depth {
        let voxels = (0..masks.len()).map(|i| Voxel { rate: i as u8 + 1, ..Default::default() }).collect();
        Depth { masks: masks.to_vec(), voxels, mixes: Vec::new() }
    }

    /// Root → children 0 and 7; child 0 is terminal, child 7 has grandchildren 1 and 3.
    fn small() -> Octree {
        let depths = vec![depth(&[0b1000_0001]), depth(&[0, 0b1010]), depth(&[0, 0])];
        Octree::new(Volume { info: Info::default(), depths }).unwrap()
    }

    #[test]
    fn ranks_and_terminals() {
        let tree = small();
        assert_eq!(tree.finest(), Some(2));
        let block = tree.blocks(0)[0];
        assert_eq!(block.mask, 255 | 0b1010 << 56);
        assert_eq!(block.address(0, 0, 3), VoxelAddress { depth: 1, rank: 0 });
        assert_eq!(block.address(0, 0, 57), VoxelAddress { depth: 2, rank: 0 });
        assert_eq!(block.address(0, 0, 59), VoxelAddress { depth: 2, rank: 1 });
        assert_eq!(tree.voxel(block.address(0, 0, 59)).rate, 2);
        assert_eq!(tree.blocks(-1)[0].address(-1, 0, 7), VoxelAddress { depth: 1, rank: 1 });
        assert_eq!(tree.blocks(-2)[0].address(-2, 0, 0), VoxelAddress { depth: 0, rank: 0 });
        assert_eq!(tree.decoded().pages, 1);
    }

    #[test]
    fn cells_are_found_by_their_codes() {
        let tree = small();
        assert_eq!(tree.find(0, 0), Some(VoxelAddress { depth: 0, rank: 0 }));
        assert_eq!([tree.find(1, 7), tree.find(1, 3)], [Some(VoxelAddress { depth: 1, rank: 1 }), None]);
        assert_eq!([tree.find(2, 57), tree.find(2, 58)], [Some(VoxelAddress { depth: 2, rank: 0 }), None]);
        // Within a terminal node, and outside of the texel.
        assert_eq!([tree.find(2, 5), tree.find(2, 64)], [Some(VoxelAddress { depth: 1, rank: 0 }), None]);
        assert_eq!(tree.find(3, 0), None);
    }

    #[test]
    fn empty_texel_has_no_depth() {
        let tree = Octree::new(Volume { info: Info::default(), depths: vec![] }).unwrap();
        assert_eq!(tree.finest(), None);
    }
}
