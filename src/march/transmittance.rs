//! The march: the transmittance of one texel along a straight segment of a ray, and the voxels that stop the rest of the light.
//!
//! Based on: F. Neyret, *Synthesizing Verdant Landscapes using Volumetric Textures*, INRIA RR-2846, 1996 (one ray per pixel, the
//! depth by the size of its cone); M. Levoy, *Efficient Ray Tracing of Volume Data*, TOG 1990 (early termination).

use crate::geom::Vec3;
use crate::simd::multiversioned;
use crate::volume::octree::Octree;
use crate::volume::opacity::advance;
use crate::volume::voxel::voxel_edge;
use crate::volume::{Model, Voxel};

use super::descent::{Line, VoxelSegment, VoxelVisitor, WalkEnd, walk};

/// A straight segment of a ray through one texel's cube \[0,1\]^3.
#[derive(Debug, Clone, Copy)]
pub struct MarchSegment {
    /// Texel space, at t = 0: best at or near the cube's face, since positions are f32.
    pub origin: Vec3,
    /// Texel units per unit of the ray's parameter t; any length but 0.
    pub dir: Vec3,
    /// The segment is t in [0, length].
    pub length: f32,
    /// Width of the ray's cone at t = 0, in cube edges.
    pub footprint: f32,
    /// Growth of the width per unit of t.
    pub growth: f32,
    /// Multiplies the rates, ≥ 0.
    pub opacity_scale: f32,
}

/// The rule by which a cone of a given width chooses the depth that it reads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthChoice {
    /// Added to the depth that fits: −1 is one coarser.
    pub bias: f32,
    /// In [0, 1): the share of fractional depths that go to the coarser side. 0.5 rounds to the nearest; neighbouring pixels
    /// or lanes that take ordered thresholds instead dither between two depths, so that no switch shows.
    pub lod_dither: f32,
    /// Never deeper than this.
    pub finest: u8,
}

impl Default for DepthChoice {
    fn default() -> Self {
        DepthChoice { bias: 0.0, lod_dither: 0.5, finest: u8::MAX }
    }
}

impl DepthChoice {
    /// Which depths of a tree of the depth `finest` are chosen.
    fn depths(&self, finest: usize) -> Depths {
        let finest = finest.min(usize::from(self.finest)) as i32;
        Depths { doubled: (self.bias + 1.0 - self.lod_dither).exp2(), finest }
    }
}

/// A [`DepthChoice`] in one tree.
#[derive(Clone, Copy)]
struct Depths {
    /// Twice the width at which depth 0 is chosen, with the bias and the dither applied.
    doubled: f32,
    finest: i32,
}

impl Depths {
    /// The depth for a cone `width` cube edges wide: voxel ≈ width.
    #[inline(always)]
    fn depth(&self, width: f32) -> u32 {
        // The exponent of a float is its base-2 logarithm, rounded down.
        let exponent = ((self.doubled / width.max(f32::MIN_POSITIVE)).to_bits() >> 23) as i32 - 127;
        exponent.clamp(0, self.finest) as u32
    }

    /// The width at which `depth` is given up for the next coarser one.
    #[inline(always)]
    fn width_limit(&self, depth: u32) -> f32 {
        if depth == 0 { f32::INFINITY } else { self.doubled * voxel_edge(depth as u8) }
    }
}

/// Counts of a thread's marches.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct MarchStats {
    /// Segments marched.
    pub segments: u64,
    /// Steps of the descent: voxels, and empty cubes skipped.
    pub cells: u64,
    /// Voxels that lay on the way.
    pub voxels: u64,
    /// Deepest depth chosen.
    pub deepest: u32,
}

impl MarchStats {
    /// Add what another thread met.
    pub fn merge(&mut self, other: &MarchStats) {
        self.segments += other.segments;
        self.cells += other.cells;
        self.voxels += other.voxels;
        self.deepest = self.deepest.max(other.deepest);
    }
}

/// A voxel that stops some of the ray's light, as a [`Sink`] receives it.
#[derive(Debug, Clone, Copy)]
pub struct VoxelHit<'a> {
    /// The ray's parameter in the middle of its segment in the voxel.
    pub t: f32,
    /// Share of the ray's light that ends here, > 0: the transmittance before it less that after it.
    pub weight: f32,
    /// Depth of the voxel: its edge is 2^−depth cube edges.
    pub depth: u8,
    /// Voxel that stops the light.
    pub voxel: &'a Voxel,
    /// Its number among those of its depth.
    pub rank: u32,
    /// The middle of that segment, texel space.
    pub position: Vec3,
}

/// Takes the voxels that stop light, front to back.
pub trait Sink {
    /// Whether the march follows a camera ray, for which single-sided sheets are there only where they face the camera. Shadow rays
    /// are stopped by both sides.
    const IS_CAMERA: bool = false;

    /// Called for each voxel that stops light, in order along the ray.
    fn voxel(&mut self, hit: &VoxelHit<'_>);
}

/// Below this transmittance a march of one texel on its own ends; its last voxel stops what is left.
pub const OPAQUE_BELOW: f32 = 1.0 / 512.0;

/// March a segment with the transmittance `t_in` in [0, 1] at its start; the transmittance at its end. It is 0 once it falls
/// below [`OPAQUE_BELOW`].
pub fn march(
    tree: &Octree,
    segment: &MarchSegment,
    choice: DepthChoice,
    t_in: f32,
    sink: &mut impl Sink,
    stats: &mut MarchStats,
) -> f32 {
    run(tree, segment, choice, t_in, OPAQUE_BELOW, sink, stats)
}

/// The share of light that comes through a segment; 0 once it falls below `stop_below`.
pub fn transmittance(
    tree: &Octree,
    segment: &MarchSegment,
    choice: DepthChoice,
    stop_below: f32,
    stats: &mut MarchStats,
) -> f32 {
    run(tree, segment, choice, 1.0, stop_below, &mut NoSink, stats)
}

/// [`transmittance`] of a segment that starts on the texel's own matter.
///
/// The law's c is the share of matter that no ray meets after other matter of the same block. So what a ray that starts on
/// matter meets of its block is less: dT/ds = −(1 − c) r T. Else a leaf, or a hair, would stand in its own light.
pub fn transmittance_from_own_matter(
    tree: &Octree,
    segment: &MarchSegment,
    choice: DepthChoice,
    stop_below: f32,
    stats: &mut MarchStats,
) -> f32 {
    march_from(tree, segment, choice, [1.0, stop_below], StartBlock::Ahead, &mut NoSink, stats)
}

struct NoSink;

impl Sink for NoSink {
    #[inline(always)]
    fn voxel(&mut self, _: &VoxelHit<'_>) {}
}

/// Position of a march that starts on matter relative to the block of that matter. The first block is taken for it if its first voxel
/// begins within a voxel's width of the start.
#[derive(Clone, Copy, PartialEq)]
enum StartBlock {
    Ahead,
    Inside,
    Past,
}

/// [`march`] that ends where the transmittance falls below `stop_below`.
pub(crate) fn run(
    tree: &Octree,
    segment: &MarchSegment,
    choice: DepthChoice,
    t_in: f32,
    stop_below: f32,
    sink: &mut impl Sink,
    stats: &mut MarchStats,
) -> f32 {
    march_from(tree, segment, choice, [t_in, stop_below], StartBlock::Past, sink, stats)
}

multiversioned! {
    fn march_from[S: Sink](
        tree: &Octree,
        segment: &MarchSegment,
        choice: DepthChoice,
        limits: [f32; 2],
        start_block: StartBlock,
        sink: &mut S,
        stats: &mut MarchStats,
    ) -> f32 = march_inline;
}

/// `limits`: the transmittance at the start, and that below which the march ends.
#[inline(always)]
fn march_inline<S: Sink>(
    tree: &Octree,
    segment: &MarchSegment,
    choice: DepthChoice,
    [t_in, stop_below]: [f32; 2],
    start_block: StartBlock,
    sink: &mut S,
    stats: &mut MarchStats,
) -> f32 {
    let speed = segment.dir.length();
    let Some(finest) = tree.finest() else { return t_in };
    let usable = segment.origin.is_finite() && speed.is_normal() && segment.opacity_scale > 0.0 && t_in > 0.0;
    if !usable {
        return t_in;
    }
    stats.segments += 1;
    let line = Line::new(segment.origin, segment.dir / speed);
    let (width, growth) = (segment.footprint, segment.growth / speed);
    // In a file the root's support box may be larger than the content's, with a rate that is lower by as much. At depth 0 the whole cube
    // is therefore marched.
    let depths = choice.depths(finest);
    let pad = if depths.depth(width) == 0 { 1.0 } else { CONTENT_PAD };
    let (low, high) = tree.content();
    let (min, max) = ((low - pad).max(Vec3::ZERO), (high + pad).min(Vec3::ONE));
    let (mut s, end) = line.clip(min, max, 0.0, segment.length * speed);
    let mut law = OpacityLaw {
        tree,
        origin: segment.origin,
        dir: line.dir,
        per_speed: 1.0 / speed,
        scale: segment.opacity_scale,
        isotropic: tree.model() == Model::Neyret,
        before_block: t_in,
        block: 1.0,
        stop_below,
        start_block,
        has_one_sided: S::IS_CAMERA && tree.has_one_sided(),
        sink,
        stats,
    };
    while s < end {
        let depth = depths.depth(width + growth * s);
        law.stats.deepest = law.stats.deepest.max(depth);
        let depth_limit = if growth > 0.0 { (depths.width_limit(depth) - width) / growth } else { f32::INFINITY };
        match walk(tree, &line, depth, [s, end, depth_limit.max(s)], &mut law) {
            // Going on from s itself would choose the same depth again where the width is within rounding of the limit.
            WalkEnd::DepthLimit(at) => s = at.max(s.next_up()),
            WalkEnd::Done => break,
            WalkEnd::Stopped => return 0.0,
        }
    }
    law.before_block
}

/// Margin around the content's box, in cube edges. The box is kept in f64, and the faces of its voxels, computed in f32, must not fall
/// outside. At the faces of the cube there is no margin, or the first voxel on a grazing ray would begin before its face.
const CONTENT_PAD: f32 = 1e-6;

/// The law of opacity, applied along one line.
struct OpacityLaw<'a, S> {
    tree: &'a Octree,
    origin: Vec3,
    dir: Vec3,
    per_speed: f32,
    scale: f32,
    isotropic: bool,
    /// Transmittance up to the current block.
    before_block: f32,
    /// Transmittance within the current block.
    block: f32,
    stop_below: f32,
    /// Where the current block is with respect to the one that the ray starts in.
    start_block: StartBlock,
    /// Whether voxels may have single-sided sheets and the march follows a camera ray.
    has_one_sided: bool,
    sink: &'a mut S,
    stats: &'a mut MarchStats,
}

impl<S: Sink> VoxelVisitor for OpacityLaw<'_, S> {
    #[inline(always)]
    fn segment(&mut self, segment: &VoxelSegment<'_>) -> bool {
        self.stats.voxels += 1;
        let voxel = self.tree.voxel(segment.address);
        if voxel.rate == 0 {
            return true;
        }
        let (enter, leave) = segment.support(voxel);
        let length = leave - enter;
        if length.is_nan() || length <= 0.0 {
            return true;
        }
        let mut sigma = if self.isotropic { 1.0 } else { projected_area(voxel, self.dir) };
        if self.has_one_sided {
            sigma *= front_facing_share(voxel, self.tree.surface(segment.address).one_sided(), self.dir);
        }
        let depth = segment.address.depth;
        let edges = length * (1u32 << depth) as f32;
        let tau = RATE[usize::from(voxel.rate)] * self.scale * sigma * edges;
        let before = self.block;
        if self.start_block == StartBlock::Ahead {
            let near = segment.enter * (1u32 << depth) as f32 <= 1.0;
            self.start_block = if near { StartBlock::Inside } else { StartBlock::Past };
        }
        let c = voxel.c();
        let own_matter = self.start_block == StartBlock::Inside && !voxel.is_inside();
        self.block = if own_matter { advance(before, (1.0 - c) * tau, 0.0) } else { advance(before, tau, c) };
        let stopped = self.before_block * self.block < self.stop_below;
        if stopped {
            self.block = 0.0;
        }
        let weight = self.before_block * (before - self.block);
        if weight > 0.0 {
            let s = 0.5 * (enter + leave);
            let position = self.origin + s * self.dir;
            let rank = segment.address.rank;
            self.sink.voxel(&VoxelHit { t: s * self.per_speed, weight, depth, voxel, rank, position });
        }
        !stopped
    }

    #[inline(always)]
    fn block_end(&mut self) {
        self.before_block *= self.block;
        self.block = 1.0;
        if self.start_block == StartBlock::Inside {
            self.start_block = StartBlock::Past;
        }
    }

    #[inline(always)]
    fn stepped(&mut self, cells: u64) {
        self.stats.cells += cells;
    }
}

/// Rate ρ of each code, see [`Voxel::rate`].
static RATE: [f32; 256] = rates();

const fn rates() -> [f32; 256] {
    /// 2^(i/16), rounded to nearest.
    const SIXTEENTHS: [f32; 16] = [
        1.0,
        1.0442737,
        1.0905077,
        1.1387886,
        1.1892071,
        1.2418578,
        1.2968396,
        1.3542556,
        std::f32::consts::SQRT_2,
        1.4768262,
        1.5422108,
        1.6104903,
        1.6817929,
        1.7562522,
        1.8340081,
        1.9152066,
    ];
    let mut table = [0.0; 256];
    let mut code = 1;
    while code < 256 {
        // Times 2^(code / 16 − 9), by its exponent bits.
        table[code] = SIXTEENTHS[code & 15] * f32::from_bits((127 - 9 + (code as u32 >> 4)) << 23);
        code += 1;
    }
    table
}

/// Projected area sigma of the voxel's normals along the unit vector `w`.
#[inline(always)]
fn projected_area(voxel: &Voxel, w: Vec3) -> f32 {
    crate::volume::Sggx::decode(voxel.ndf).sigma(w)
}

/// The share of a voxel's facets that a camera ray along the unit vector `w` meets, where the share `one_sided` of them is
/// single-sided. σ(w) is the projected area of fronts and backs together, and the mean area vector's projection is their
/// difference; so the fronts are half of the sum of the two.
#[inline(never)]
fn front_facing_share(voxel: &Voxel, one_sided: f32, w: Vec3) -> f32 {
    if one_sided <= 0.0 || voxel.is_inside() {
        return 1.0;
    }
    let ndf = crate::volume::Sggx::decode(voxel.ndf);
    // Facets project half of their area in the mean over all directions.
    let area = 2.0 * mean_projected_area(&ndf);
    let difference = -area * voxel.one_sidedness() * voxel.mean_normal().dot(w);
    let fronts = 0.5 + 0.5 * (difference / ndf.sigma(w).max(f32::MIN_POSITIVE)).clamp(-1.0, 1.0);
    1.0 - one_sided * (1.0 - fronts)
}

/// σ in the mean over all directions: by the fourteen points of a cubature of degree five (V. Lebedev 1976), of which seven pairs
/// are alike. Of a flat sheet it is .479 and not ½; else the error is below that.
fn mean_projected_area(ndf: &crate::volume::Sggx) -> f32 {
    const CORNER: f32 = 0.577_350_26;
    let axes: f32 = [Vec3::X, Vec3::Y, Vec3::Z].into_iter().map(|w| ndf.sigma(w)).sum();
    let corners = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)];
    let diagonals: f32 = corners.into_iter().map(|(y, z)| ndf.sigma(CORNER * Vec3::new(1.0, y, z))).sum();
    axes * (2.0 / 15.0) + diagonals * (3.0 / 20.0)
}

#[cfg(test)]
pub(crate) mod tests;
