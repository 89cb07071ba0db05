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

use crate::geom::Vec3;
use crate::morton;
use crate::volume::octree::{Block, Octree, Place};
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

/// A stretch of the line in a voxel.
pub(super) struct Piece<'a> {
    pub line: &'a Line,
    pub planes: &'a Planes,
    pub place: Place,
    /// The voxel's low corner in cells of the walk's depth, mirrored, and its edge in them: 1 but for terminal nodes.
    pub corner: Vec3A,
    pub edge: f32,
    /// Where the line enters and leaves the voxel, enter ≤ leave.
    pub enter: f32,
    pub leave: f32,
}

/// What a walk calls.
pub(super) trait Visit {
    /// Each occupied voxel on the way. `false` ends the walk.
    fn piece(&mut self, piece: &Piece<'_>) -> bool;
    /// After each 4^3 block that was entered, and between larger terminal nodes. `false` ends the walk.
    fn block_end(&mut self) -> bool;
    /// Empty cells and cubes that were crossed, for statistics.
    fn stepped(&mut self, cells: u32);
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

/// How a walk ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum End {
    /// At the end of the line, or behind the last voxel.
    Done,
    /// At the first end of a block at or behind `turn`, at this s.
    Turned(f32),
    /// `Visit` ended it.
    Stopped,
}

/// The block that a walk is in: its node, whose cells are cubes of 2^shift cells of the walk's depth.
#[derive(Clone, Copy)]
struct Frame<'a> {
    block: &'a Block,
    node: u32,
}

static EMPTY: Block = Block::EMPTY;

/// Visit the voxels of `depth` that the line crosses between `s0` and `s1`, in order, terminal nodes above `depth` as one
/// piece each. `depth` at most the finest; `turn`: where to hand back for another choice of depth.
#[inline]
pub(super) fn walk(tree: &Octree, line: &Line, depth: u32, [s0, s1, turn]: [f32; 3], visit: &mut impl Visit) -> End {
    let side = (depth as f32).exp2();
    let planes = Planes { step: line.inverse * (1.0 / side), start: -line.origin * line.inverse };
    let cells = 1u32 << depth;
    let at = |s: f32| ((line.origin + line.ahead * s) * side).to_array();
    let all = line.mirrored | line.mirrored << 3;
    // The virtual roots' cells start at the low corner: only the bits that the cube has are mirrored there.
    let (top, top_flip) = match depth {
        0 => (0, 0),
        d if d % 2 == 0 => (d - 2, all),
        d => (d - 1, all & 7),
    };
    let block_at = |shift: u32, node: u32| {
        let blocks = tree.blocks(depth as i32 - shift as i32 - 2);
        Frame { block: blocks.get(node as usize).unwrap_or(&EMPTY), node }
    };
    let mut s = s0;
    let mut x = at(s).map(|p| (p as i32).clamp(0, cells as i32 - 1) as u32);
    let mut shift = top;
    let mut frame = block_at(top, 0);
    let mut stack = [frame; MAX_DEPTH / 2];
    let mut inside = false;
    loop {
        let flip = if shift == top { top_flip } else { all };
        let morton = cell_code(x, shift);
        let cell = morton ^ flip;
        let block = frame.block;
        let size = if block.mask >> cell & 1 == 0 {
            if block.mask & REACH[line.mirrored as usize][cell as usize] == 0 {
                shift + 2
            } else if (block.mask >> (cell & 56)) as u8 == 0 {
                shift + 1
            } else {
                shift
            }
        } else if shift == 0 || block.terminal >> cell & 1 != 0 {
            let place = block.place(depth as i32 - shift as i32 - 2, frame.node, cell);
            let size = depth - u32::from(place.depth);
            let corner = x.map(|v| (v >> size << size) as f32);
            let edge = (1u32 << size) as f32;
            let corner = Vec3A::from_array(corner);
            let leave = planes.meet(corner + edge).min_element().min(s1);
            if leave > s {
                let piece = Piece { line, planes: &planes, place, corner, edge, enter: s, leave };
                if !visit.piece(&piece) {
                    return End::Stopped;
                }
            }
            inside = size < 2;
            if !inside && !visit.block_end() {
                return End::Stopped;
            }
            size
        } else {
            stack[shift as usize / 2] = frame;
            let node = block.rank(cell);
            shift -= 2;
            frame = block_at(shift, node);
            continue;
        };
        visit.stepped(1);
        // To the first of the planes that end the cube of 2^size cells.
        let high = x.map(|v| ((v >> size) + 1) << size);
        let next = planes.meet(Vec3A::from_array(high.map(|v| v as f32)));
        let leave = next.min_element();
        if leave >= s1 || leave.is_nan() {
            visit.block_end();
            return End::Done;
        }
        s = s.max(leave);
        let crossed = next.cmple(Vec3A::splat(leave)).bitmask();
        let here = if size == 0 { [0.0; 3] } else { at(s) };
        let mut changed = 0;
        for k in 0..3 {
            let new = if crossed >> k & 1 != 0 {
                high[k]
            } else if size == 0 {
                x[k]
            } else {
                (here[k] as u32).clamp(x[k], high[k] - 1)
            };
            changed |= new ^ x[k];
            x[k] = new;
        }
        if changed == 0 || changed >= cells {
            visit.block_end();
            return End::Done;
        }
        let level = (31 - changed.leading_zeros()) & !1;
        if level > shift {
            if inside {
                inside = false;
                if !visit.block_end() {
                    return End::Stopped;
                }
            }
            if s >= turn {
                return End::Turned(s);
            }
            shift = level;
            frame = stack[level as usize / 2];
        }
    }
}

/// The Morton code of the cell in its block, of 2^shift cells a side.
#[inline]
fn cell_code(x: [u32; 3], shift: u32) -> u32 {
    let [a, b, c] = x.map(|v| v >> shift & 3);
    (a & 1 | (b & 1) << 1 | (c & 1) << 2) | (a & 2 | (b & 2) << 1 | (c & 2) << 2) << 2
}

impl Piece<'_> {
    /// The part of the piece within the voxel's support; empty where `.0 >= .1`.
    #[inline]
    pub fn support(&self, voxel: &Voxel) -> (f32, f32) {
        let mut low = [0.0f32; 3];
        let mut high = [0.0f32; 3];
        for k in 0..3 {
            // Mirrored, a box of sixteenths swaps the distances from the two ends.
            let byte = voxel.support[k];
            let byte = if self.line.mirrored >> k & 1 != 0 { byte.rotate_left(4) } else { byte };
            low[k] = f32::from(byte & 15);
            high[k] = f32::from(16 - (byte >> 4));
        }
        let sixteenth = self.edge * (1.0 / 16.0);
        let near = self.planes.meet(self.corner + Vec3A::from_array(low) * sixteenth).max_element();
        let far = self.planes.meet(self.corner + Vec3A::from_array(high) * sixteenth).min_element();
        (near.max(self.enter), far.min(self.leave))
    }
}
