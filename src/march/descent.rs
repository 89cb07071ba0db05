//! Descent of a line through the octree: the occupied cells of one depth that it crosses, in order, each once.
//!
//! Based on: J. Amanatides, A. Woo, *A Fast Voxel Traversal Algorithm for Ray Tracing*, EG 1987; J. Revelles et al.,
//! *An Efficient Parametric Algorithm for Octree Traversal*, WSCG 2000 (mirroring to one octant); S. Laine, T. Karras,
//! *Efficient Sparse Voxel Octrees*, I3D 2010.
//!
//! The parameter at which the line meets a plane of the grid is one expression of the plane's integer index, whatever the
//! size of the cells that share the plane. So the pieces in successive cells abut exactly, no epsilon moves the line on,
//! and the lengths add up to the whole. Space is mirrored so that the line goes up along each axis; a cell's index in
//! its block follows by flipping bits of its Morton code.

use glam::{BVec3A, Vec3A};

use crate::geom::{Vec3, each3};
use crate::morton;
use crate::volume::octree::{Block, Octree, VoxelAddress};
use crate::volume::voxel::SUPPORT_ENDS;
use crate::volume::{MAX_DEPTH, Voxel};

/// A line in texel space, as the descent uses it; `s` is the distance along it from its origin, in cube edges.
pub(super) struct Line {
    /// Unit direction in texel space, not mirrored.
    pub dir: Vec3,
    /// Origin and direction, mirrored: no component of `ahead` is below `PARALLEL`.
    origin: Vec3A,
    ahead: Vec3A,
    inverse: Vec3A,
    /// Bit k: axis k is mirrored.
    pub mirrored: u32,
}

/// Stands for a zero component of a direction: a plane is then met at ±1e20 cube edges or more, on the right side.
const PARALLEL: f32 = 1e-20;

impl Line {
    /// `dir` of unit length.
    pub fn new(origin: Vec3, dir: Vec3) -> Line {
        let back = Vec3A::from(dir).cmplt(Vec3A::ZERO);
        let origin = Vec3A::from(origin);
        let ahead = Vec3A::from(dir).abs().max(Vec3A::splat(PARALLEL));
        Line {
            dir,
            origin: Vec3A::select(back, 1.0 - origin, origin),
            ahead,
            inverse: 1.0 / ahead,
            mirrored: back.bitmask(),
        }
    }

    /// The interval of s within `[s0, s1]` in which the line is inside the box `min ..= max` of texel space.
    pub fn clip(&self, min: Vec3, max: Vec3, s0: f32, s1: f32) -> (f32, f32) {
        let (min, max) = (Vec3A::from(min), Vec3A::from(max));
        let back = BVec3A::new(self.mirrored & 1 != 0, self.mirrored & 2 != 0, self.mirrored & 4 != 0);
        let low = Vec3A::select(back, 1.0 - max, min);
        let high = Vec3A::select(back, 1.0 - min, max);
        let near = ((low - self.origin) * self.inverse).max_element();
        let far = ((high - self.origin) * self.inverse).min_element();
        (near.max(s0), far.min(s1))
    }
}

/// The cells of one depth as planes along a [`Line`]: plane i of axis k is met at `i · step[k] + start[k]`.
#[derive(Clone, Copy)]
pub(super) struct Planes {
    step: Vec3A,
    start: Vec3A,
}

impl Planes {
    /// The parameters at which the line meets one plane of each axis, by index (in cells, mirrored, may be fractional).
    #[inline]
    pub fn meet(&self, index: Vec3A) -> Vec3A {
        index * self.step + self.start
    }
}

/// The part of a line in one voxel.
pub(super) struct VoxelSegment<'a> {
    line: &'a Line,
    planes: Planes,
    /// The voxel, and the depth of the walk: deeper than the voxel's where a terminal node shows.
    pub address: VoxelAddress,
    depth: u32,
    /// The cell's low corner in cells of the walk's depth, mirrored.
    corner: Vec3A,
    /// The line's s where it enters and leaves the cell, enter < leave.
    pub enter: f32,
    pub leave: f32,
}

/// Callbacks of a walk.
pub(super) trait VoxelVisitor {
    /// Called for the line's segment in each occupied voxel, in order. `false` ends the walk.
    fn segment(&mut self, segment: &VoxelSegment<'_>) -> bool;
    /// Called where the line leaves a 4^3 block or a terminal node of that size, even if it met no voxel there.
    fn block_end(&mut self);
    /// Called once per walk with the number of cells and empty cubes that were crossed.
    fn stepped(&mut self, cells: u64);
}

/// Cells of a block that a line can still meet when it is in a cell: `REACH[mirrored][cell]`, indices Morton, not mirrored.
static REACH: [[u64; 64]; 8] = reach();

const fn reach() -> [[u64; 64]; 8] {
    let mut table = [[0u64; 64]; 8];
    let mut i = 0;
    while i < 8 * 64 * 64 {
        let (mirrored, from, to) = (i >> 12, i >> 6 & 63, i & 63);
        let (a, b) = (morton::decode(from as u64), morton::decode(to as u64));
        let mut ahead = true;
        let mut k = 0;
        while k < 3 {
            ahead &= if mirrored >> k & 1 == 0 { a[k] <= b[k] } else { a[k] >= b[k] };
            k += 1;
        }
        if ahead {
            table[mirrored][from] |= 1 << to;
        }
        i += 1;
    }
    table
}

/// End of a walk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum WalkEnd {
    /// The walk reached the end of the line, or its last voxel.
    Done,
    /// At the first end of a block at or after `depth_limit`, at this s.
    DepthLimit(f32),
    /// The visitor ended the walk.
    Stopped,
}

/// Position of a walk in the block of one node: a cell of it, and where the line leaves that cell.
#[derive(Clone, Copy)]
struct BlockCursor<'a> {
    block: &'a Block,
    node: u32,
    /// Morton code of the cell in the block, mirrored.
    cell: u32,
    /// Indices of the planes that end the cell, in cells of this block's size.
    end: Vec3A,
}

static EMPTY: Block = Block::EMPTY;

/// How a walk enters the blocks of a tree.
struct Entry<'a> {
    tree: &'a Octree,
    line: &'a Line,
    /// Depth of the voxels that the walk visits.
    depth: u32,
}

impl<'a> Entry<'a> {
    /// A cursor in the block of `node`, at the cell in which the line is at `s`. The block's cells are 2^`shift` voxels wide, and
    /// `scale` of them make a cube edge. `low` is the block's low corner, counted in its cells; positions within the block are clamped
    /// to `most` cells.
    #[inline(always)]
    fn cursor(&self, [shift, node]: [u32; 2], low: Vec3A, [scale, s, most]: [f32; 3]) -> BlockCursor<'a> {
        let blocks = self.tree.blocks(self.depth as i32 - shift as i32 - 2);
        let at = ((self.line.origin + self.line.ahead * s) * scale - low).min(Vec3A::splat(most));
        let upper = at.cmpge(Vec3A::splat(2.0));
        let half = Vec3A::select(upper, Vec3A::splat(2.0), Vec3A::ZERO);
        let odd = (at - half).cmpge(Vec3A::ONE);
        let end = low + half + Vec3A::select(odd, Vec3A::splat(2.0), Vec3A::ONE);
        BlockCursor {
            block: blocks.get(node as usize).unwrap_or(&EMPTY),
            node,
            cell: odd.bitmask() | upper.bitmask() << 3,
            end,
        }
    }
}

/// Visit the voxels of `depth` (at most the finest) that the line crosses between `s0` and `s1`, in order. A terminal node above `depth`
/// is visited once for each of its cells on the way. The walk returns at the first end of a block at or after `depth_limit`, where the
/// caller chooses another depth.
#[inline(always)]
pub(super) fn walk(
    tree: &Octree,
    line: &Line,
    depth: u32,
    [s0, s1, depth_limit]: [f32; 3],
    visitor: &mut impl VoxelVisitor,
) -> WalkEnd {
    let start = -line.origin * line.inverse;
    let reach = &REACH[line.mirrored as usize & 7];
    let all = line.mirrored | line.mirrored << 3;
    // Cells of the first block are 2^shift voxels wide. Of the virtual roots' 4^3 cells only those at the low corner, `side`
    // of them an axis, are in the cube, and only the bits that those have are mirrored.
    let (first_shift, side, first_flip) = match depth {
        0 => (0, 1.0, 0),
        d if d % 2 == 0 => (d - 2, 4.0, all),
        d => (d - 1, 2.0, all & 7),
    };
    let (mut shift, mut scale, mut flip) = (first_shift, side, first_flip);
    let mut step = line.inverse * (1.0 / scale);
    let entry = Entry { tree, line, depth };
    let mut s = s0;
    let mut cursor = entry.cursor([shift, 0], Vec3A::ZERO, [scale, s, side - 0.5]);
    // Where the line meets the planes that end the cell.
    let mut meets = cursor.end * step + start;
    let mut stack = [cursor; MAX_DEPTH / 2];
    let mut terminal = None;
    let mut cells = 0u64;
    let end = 'walk: loop {
        let cell = cursor.cell ^ flip;
        let mask = cursor.block.mask;
        let mut leaving = false;
        if mask >> cell & 1 != 0 {
            if shift != 0 && cursor.block.terminal >> cell & 1 == 0 {
                stack[(shift / 2) as usize & (MAX_DEPTH / 2 - 1)] = cursor;
                let node = cursor.block.rank(cell);
                shift -= 2;
                scale *= 4.0;
                step *= 0.25;
                flip = all;
                cursor = entry.cursor([shift, node], (cursor.end - 1.0) * 4.0, [scale, s, 3.5]);
                meets = cursor.end * step + start;
                visitor.block_end();
                continue;
            }
            let address = cursor.block.address(depth as i32 - shift as i32 - 2, cursor.node, cell);
            if shift != 0 && terminal != Some(address) {
                visitor.block_end();
                terminal = Some(address);
            }
            let leave = meets.min_element().min(s1);
            if leave > s {
                let planes = Planes { step, start };
                let segment = VoxelSegment { line, planes, address, depth, corner: cursor.end - 1.0, enter: s, leave };
                if !visitor.segment(&segment) {
                    break WalkEnd::Stopped;
                }
            }
        } else {
            leaving = mask & reach[cell as usize & 63] == 0;
        }
        // To the next cell, up through the blocks that end where this one does.
        loop {
            if !leaving {
                cells += 1;
                let leave = meets.min_element();
                if leave >= s1 || leave.is_nan() {
                    break 'walk WalkEnd::Done;
                }
                s = s.max(leave);
                let crossed = meets.cmple(Vec3A::splat(leave));
                // Each axis counts 0 … 3 in two bits; one that was 3 leaves the block.
                let add = crossed.bitmask();
                let carry = cursor.cell & add;
                leaving = cursor.cell >> 3 & carry != 0;
                cursor.cell ^= add | carry << 3;
                cursor.end += Vec3A::select(crossed, Vec3A::ONE, Vec3A::ZERO);
                meets = cursor.end * step + start;
            }
            if !leaving {
                break;
            }
            if shift == 0 {
                visitor.block_end();
            }
            if shift == first_shift {
                break 'walk WalkEnd::Done;
            }
            shift += 2;
            scale *= 0.25;
            step *= 4.0;
            flip = if shift == first_shift { first_flip } else { all };
            cursor = stack[(shift / 2) as usize & (MAX_DEPTH / 2 - 1)];
            meets = cursor.end * step + start;
            leaving = false;
        }
        if shift != 0 && s >= depth_limit {
            break WalkEnd::DepthLimit(s);
        }
    };
    visitor.block_end();
    visitor.stepped(cells);
    end
}

impl VoxelSegment<'_> {
    /// The interval of s in which the line is within the voxel's support box; empty unless `.0 < .1`.
    #[inline(always)]
    pub fn support(&self, voxel: &Voxel) -> (f32, f32) {
        let [x, y, z] = voxel.support;
        if u32::from_le_bytes([x, y, z, 0]) == 0 || u32::from(self.address.depth) != self.depth {
            return (self.enter, self.leave);
        }
        // Mirroring an axis swaps the two distances of the support from the voxel's faces, which are the two halves of a byte.
        let mirrored = |k: u32, byte: u8| byte.rotate_left(4 * (self.line.mirrored >> k & 1));
        let ends = each3([mirrored(0, x), mirrored(1, y), mirrored(2, z)], |byte| &SUPPORT_ENDS[usize::from(byte)]);
        let low = Vec3A::new(ends[0][0], ends[1][0], ends[2][0]);
        let high = Vec3A::new(ends[0][1], ends[1][1], ends[2][1]);
        let near = self.planes.meet(self.corner + low).max_element();
        let far = self.planes.meet(self.corner + high).min_element();
        (near.max(self.enter), far.min(self.leave))
    }
}
