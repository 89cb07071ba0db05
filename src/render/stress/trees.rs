//! Marches through octrees, against every voxel's chord in f64.

use super::{Random, Tally};
use crate::geom::{DVec3, Vec3};
use crate::march::transmittance::{DepthChoice, MarchSegment, MarchStats, Sink, VoxelHit, run, transmittance};
use crate::morton;
use crate::volume::opacity::advance_f64;
use crate::volume::voxel::{RATE_MAX, rate_table};
use crate::volume::{Depth, Info, Octree, Sggx, Volume, Voxel};

/// How far a position along a ray may be off, cube edges: two roundings of values up to 2.5 at the origin, one at each face.
const POSITION: f64 = 6e-7;
/// How far a transmittance may be off besides: the law's own rounding, over a few dozen voxels.
const ROUNDING: f64 = 4e-6;

/// A texel of single voxels of one depth, with what an oracle needs.
struct Cells {
    tree: Octree,
    depth: usize,
    codes: Vec<u64>,
    voxels: Vec<Voxel>,
}

impl Cells {
    /// Tree of voxels by ascending code; coarser ones are blank.
    fn new(depth: usize, cells: std::collections::BTreeMap<u64, Voxel>) -> Option<Cells> {
        let (codes, voxels): (Vec<u64>, Vec<Voxel>) = cells.into_iter().unzip();
        let mut depths = vec![Depth { masks: vec![0; codes.len()], voxels: voxels.clone(), mixes: Vec::new() }];
        let mut level = codes.clone();
        for _ in 0..depth {
            let (parents, masks) = morton::parents(&level);
            depths.push(Depth { masks, voxels: vec![Voxel::default(); parents.len()], mixes: Vec::new() });
            level = parents;
        }
        depths.reverse();
        let info = Info::default();
        let tree = Octree::new(Volume { info, depths }).ok()?;
        Some(Cells { tree, depth, codes, voxels })
    }

    /// T along the stretch with each voxel's support grown by `grown` cube edges on every side.
    fn oracle(&self, table: &[f32; 256], s: &MarchSegment, grown: f64) -> f64 {
        let side = f64::from(1u32 << self.depth);
        let speed = f64::from(s.dir.length());
        let (o, d) = (s.origin.as_dvec3() * side, s.dir.as_dvec3() * side);
        let (inverse, end, dir) = (d.recip(), f64::from(s.length), s.dir.as_dvec3() / speed);
        let (mut behind, mut block, mut current) = (1.0, 1.0, u64::MAX);
        for (code, v) in self.codes.iter().zip(&self.voxels) {
            let corner = DVec3::from_array(morton::decode(*code).map(f64::from));
            let (lo, hi) = v.support_box();
            let (lo, hi) = (corner + lo.as_dvec3() - grown * side, corner + hi.as_dvec3() + grown * side);
            let (mut near, mut far) = (0.0f64, end);
            for k in 0..3 {
                if d[k] == 0.0 {
                    // A line in a face belongs to the voxel above it.
                    if !(lo[k] <= o[k] && o[k] < hi[k]) {
                        far = -1.0;
                    }
                } else {
                    let (a, b) = ((lo[k] - o[k]) * inverse[k], (hi[k] - o[k]) * inverse[k]);
                    (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
                }
            }
            if near >= far {
                continue;
            }
            // Voxels of a block follow each other, and its correlation is one: their order within it does not matter.
            if code >> 6 != current {
                behind *= block;
                (block, current) = (1.0, code >> 6);
            }
            let sigma = Sggx::decode(v.ndf);
            let w = dir.as_vec3();
            let rate = f64::from(table[usize::from(v.rate)]) * f64::from(s.opacity_scale) * f64::from(sigma.sigma(w));
            block = advance_f64(block, rate * (far - near) * speed * side, f64::from(v.correlation & 15) / 15.0);
        }
        behind * block
    }
}

/// Checks that what a march gives is whole and in order.
struct Check {
    sum: f64,
    last: f32,
    wrong: bool,
    late: bool,
}

impl Sink for Check {
    fn voxel(&mut self, hit: &VoxelHit<'_>) {
        self.sum += f64::from(hit.weight);
        self.wrong |= !(hit.weight > 0.0 && hit.weight <= 1.0 && hit.position.is_finite());
        // The middles of two pieces that abut, each rounded.
        self.late |= hit.t + 2e-6 * (1.0 + hit.t.abs()) < self.last;
        self.last = hit.t;
    }
}

/// A voxel whose correlation is that of its block.
fn voxel(random: &mut Random, code: u64, independent: bool, block_seed: u64) -> Voxel {
    let c = if independent { 0 } else { (Random::new(block_seed, 1, code >> 6).bits() & 15) as u8 };
    let mut v = Voxel { rate: 1 + random.below(255) as u8, correlation: c, ..Voxel::default() };
    match random.below(3) {
        0 => v.ndf.iter_mut().for_each(|b| *b = random.bits() as u8),
        1 => {
            let n = random.direction().as_vec3();
            v.ndf = Sggx { xx: n.x * n.x, yy: n.y * n.y, zz: n.z * n.z, xy: n.x * n.y, xz: n.x * n.z, yz: n.y * n.z }
                .encode();
        }
        _ => {}
    }
    if random.once_in(2) {
        let lo = [0; 3].map(|_| random.below(15) as f64 / 16.0);
        v.set_support(lo, lo.map(|l| l + random.between(0.0, 1.0 - l)));
    }
    v
}

/// A stretch through or past the cube, and whether nothing about it magnifies rounding.
fn stretch(random: &mut Random, side: f64, aim: DVec3, reach: f64) -> (MarchSegment, bool) {
    // Points of the grid are exact in f32.
    let snapped = |random: &mut Random, p: DVec3| {
        let mut p = p;
        for k in 0..3 {
            if random.once_in(2) {
                p[k] = (p[k] * side).round() / side;
            }
        }
        p.as_vec3()
    };
    let kind = random.below(6);
    let (near, far) = (aim + reach * random.point(), aim + reach * random.point());
    let (from, mut to) = match kind {
        0 | 1 => (snapped(random, near), snapped(random, far)),
        _ => (near.as_vec3(), far.as_vec3()),
    };
    if matches!(kind, 2 | 3) {
        // Along an axis or a plane of the grid, exactly or nearly.
        let tilt = if kind == 2 { 0.0 } else { random.magnitude(-20.0, -3.0) as f32 };
        for k in 0..3 {
            if random.once_in(2) {
                to[k] = from[k] + tilt * (to[k] - from[k]);
            }
        }
    }
    let dir = to - from;
    // Any unit of t.
    let unit = if random.once_in(4) { random.magnitude(-6.0, 6.0) as f32 } else { 1.0 };
    let s = MarchSegment {
        origin: from,
        dir: dir / unit,
        length: unit,
        footprint: 1e-9,
        growth: 0.0,
        opacity_scale: if random.once_in(2) { 1.0 } else { random.magnitude(-12.0, 12.0) as f32 },
    };
    let plain = kind > 3 && s.opacity_scale == 1.0;
    (s, plain)
}

pub fn random_trees(random: &mut Random, rays: u64) -> Tally {
    let depth = random.below(6) as usize;
    let (count, independent, seed) = (1 + random.below(200), random.once_in(2), random.bits());
    let mut cells = std::collections::BTreeMap::new();
    for _ in 0..count {
        let code = random.below(1 << (3 * depth));
        cells.insert(code, voxel(random, code, independent, seed));
    }
    let Some(cells) = Cells::new(depth, cells) else { return Tally { nan: 1, ..Tally::default() } };
    let side = f64::from(1u32 << depth);
    cast(random, &cells, rays, independent, &mut |random| stretch(random, side, DVec3::splat(0.5), 0.8))
}

pub fn deep_trees(random: &mut Random, rays: u64) -> Tally {
    let depth = crate::volume::MAX_DEPTH;
    let side = f64::from(1u32 << depth);
    let (independent, seed) = (random.once_in(2), random.bits());
    let middle = (0.5 * random.point() + 0.5) * side;
    let mut cells = std::collections::BTreeMap::new();
    for _ in 0..1 + random.below(60) {
        let p = (middle + 4.0 * random.point()).clamp(DVec3::ZERO, DVec3::splat(side - 1.0));
        let code = morton::encode(p.as_uvec3().to_array());
        cells.insert(code, voxel(random, code, independent, seed));
    }
    let Some(cells) = Cells::new(depth, cells) else { return Tally { nan: 1, ..Tally::default() } };
    // Aimed at the cluster from near: over the whole cube an f32 is coarser than what a few voxels are apart.
    cast(random, &cells, rays, independent, &mut |random| {
        let (s, _) = stretch(random, side, middle / side, 8.0 / side);
        (s, false)
    })
}

fn cast(
    random: &mut Random,
    cells: &Cells,
    rays: u64,
    independent: bool,
    next: &mut dyn FnMut(&mut Random) -> (MarchSegment, bool),
) -> Tally {
    let table = rate_table();
    let mut tally = Tally { rays, ..Tally::default() };
    let through = |s: &MarchSegment| {
        f64::from(transmittance(&cells.tree, s, DepthChoice::default(), 0.0, &mut MarchStats::default()))
    };
    for _ in 0..rays {
        let (s, plain) = next(random);
        let speed = f64::from(s.dir.length());
        if !(speed > 0.0 && speed.is_finite()) {
            // No direction: nothing is lost.
            tally.nan += u64::from(through(&s) != 1.0);
            continue;
        }
        let whole = through(&s);
        if !(0.0..=1.0).contains(&whole) {
            tally.nan += 1;
            continue;
        }
        let most = cells.oracle(&table, &s, -POSITION) + ROUNDING;
        let least = cells.oracle(&table, &s, POSITION) - ROUNDING;
        if plain {
            tally.compare(whole, cells.oracle(&table, &s, 0.0), f64::INFINITY);
        }
        tally.deviations += u64::from(whole < least || whole > most);
        // No part lets less through, but by the last bit: a law in f32 need not fall by as little as a length grows.
        let cut = random.unit() as f32 * s.length;
        let part = MarchSegment { length: cut, ..s };
        let first = through(&part);
        tally.rises += u64::from((first as f32).next_up() < whole as f32);
        if independent {
            let rest = MarchSegment { origin: s.origin + s.dir * cut, length: s.length - cut, ..s };
            let pieces = first * through(&rest);
            tally.steps += u64::from(!(least..=most).contains(&pieces));
            if plain {
                tally.worst_step = tally.worst_step.max((pieces - whole).abs());
            }
        }
        let mut check = Check { sum: 0.0, last: f32::NEG_INFINITY, wrong: false, late: false };
        let stop = if random.once_in(2) { 0.0 } else { 1.0 / 512.0 };
        let left = run(&cells.tree, &s, DepthChoice::default(), 1.0, stop, &mut check, &mut MarchStats::default());
        tally.nan += u64::from(check.wrong);
        tally.leaks += u64::from((check.sum + f64::from(left) - 1.0).abs() > ROUNDING || check.late);
    }
    tally
}

/// Walls across the cube, thick enough that every ray has a chord of a voxel in it.
pub fn walls(random: &mut Random, rays: u64) -> Tally {
    let depth = 3 + random.below(3) as usize;
    let side = f64::from(1u32 << depth);
    let mut normal = random.direction();
    if random.once_in(2) {
        // Across small multiples of the axes: faces, edges and vertices lie in the wall's plane.
        normal = DVec3::new(random.below(3) as f64, random.below(3) as f64, 1.0 + random.below(2) as f64).normalize();
    }
    let level = normal.dot(DVec3::splat(0.5 * side)) + random.between(-1.0, 1.0);
    let half = 1.0 + 0.5 * normal.abs().element_sum();
    let opaque = Voxel { rate: RATE_MAX, correlation: random.below(16) as u8, ..Voxel::default() };
    let all = 0..1u64 << (3 * depth);
    let near = |c: &u64| {
        let p = DVec3::from_array(morton::decode(*c).map(f64::from)) + 0.5;
        (normal.dot(p) - level).abs() <= half
    };
    let Some(cells) = Cells::new(depth, all.filter(near).map(|c| (c, opaque)).collect()) else {
        return Tally { nan: 1, ..Tally::default() };
    };
    let mut tally = Tally { rays, ..Tally::default() };
    let place = |random: &mut Random, far: bool| {
        for _ in 0..64 {
            let mut p = (random.point() * 0.5 + 0.5) * side;
            for k in 0..3 {
                match random.below(4) {
                    // Down: what runs in the cube's upper faces is outside of it.
                    0 => p[k] = p[k].floor(),
                    1 => p[k] = (p[k] * 16.0).floor() / 16.0,
                    _ => {}
                }
            }
            let off = normal.dot(p) - level;
            if off.abs() > half + 1.0 && (off > 0.0) == far {
                return Some((p / side).as_vec3());
            }
        }
        None
    };
    for _ in 0..rays {
        let (Some(a), Some(b)) = (place(random, false), place(random, true)) else { continue };
        let (a, b): (Vec3, Vec3) = if random.once_in(2) { (a, b) } else { (b, a) };
        let s = MarchSegment { origin: a, dir: b - a, length: 1.0, footprint: 1e-9, growth: 0.0, opacity_scale: 1.0 };
        let mut check = Check { sum: 0.0, last: f32::NEG_INFINITY, wrong: false, late: false };
        let left =
            run(&cells.tree, &s, DepthChoice::default(), 1.0, 1.0 / 512.0, &mut check, &mut MarchStats::default());
        tally.nan += u64::from(check.wrong || !left.is_finite());
        tally.leaks += u64::from(left != 0.0 || (check.sum - 1.0).abs() > ROUNDING || check.late);
    }
    tally
}
