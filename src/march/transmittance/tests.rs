//! The march against closed forms and against a brute-force walk in f64.

use proptest::prelude::*;

use super::*;
use crate::geom::DVec3;
use crate::morton;
use crate::volume::{Depth, Info, Sggx, Volume, voxel};

fn info(model: Model) -> Info {
    Info { model, ..Info::default() }
}

/// A texel whose finest voxels, at `depth`, are those given by Morton code (sorted, distinct); coarser voxels are `coarse`.
pub fn sparse(depth: usize, codes: &[u64], voxels: &[Voxel], coarse: Voxel) -> Volume {
    let mut depths = vec![Depth { masks: vec![0; codes.len()], voxels: voxels.to_vec(), mixes: Vec::new() }];
    let mut codes = codes.to_vec();
    for _ in 0..depth {
        let masks;
        (codes, masks) = crate::morton::parents(&codes);
        depths.push(Depth { masks, voxels: vec![coarse; codes.len()], mixes: Vec::new() });
    }
    depths.reverse();
    Volume { info: info(Model::Coverage), depths }
}

/// All (2^depth)^3 voxels alike.
fn full(depth: usize, voxel: Voxel) -> Volume {
    let codes: Vec<u64> = (0..1 << (3 * depth)).collect();
    sparse(depth, &codes, &vec![voxel; codes.len()], voxel)
}

fn tree(volume: Volume) -> Octree {
    Octree::new(volume).unwrap()
}

fn isotropic(rho: f64, correlation: u8) -> Voxel {
    Voxel { rate: voxel::encode_rate(rho), correlation, ..Voxel::default() }
}

fn segment(origin: Vec3, to: Vec3) -> MarchSegment {
    MarchSegment { origin, dir: to - origin, length: 1.0, footprint: 1e-9, growth: 0.0, opacity_scale: 1.0 }
}

fn through(tree: &Octree, s: &MarchSegment) -> f32 {
    transmittance(tree, s, DepthChoice::default(), 0.0, &mut MarchStats::default())
}

fn at_depth(depth: usize) -> DepthChoice {
    DepthChoice { finest: depth as u8, ..DepthChoice::default() }
}

#[derive(Default)]
struct Record(Vec<(Voxel, f32, f32)>);
impl Sink for Record {
    fn voxel(&mut self, hit: &VoxelHit<'_>) {
        self.0.push((*hit.voxel, hit.weight, hit.t));
    }
}

#[test]
fn rates_are_those_of_the_volume() {
    assert_eq!(RATE, voxel::rate_table());
}

#[test]
fn a_slab_is_exact() {
    for depth in [0, 1, 2, 3, 4, 5] {
        // c = 0, so that blocks multiply to the whole.
        let tree = tree(full(depth, isotropic(0.25 * 2f64.powi(-(depth as i32)), 0)));
        let (a, b) = (Vec3::new(-0.2, 0.3, 0.1), Vec3::new(1.3, 0.45, 0.8));
        let inside = (b - a).length() / 1.5;
        let want = (-0.25 * inside).exp();
        let got = through(&tree, &segment(a, b));
        // The rate's code is exact; lengths of up to 50 pieces are rounded to 1e-7 each, times the rate .25.
        assert!((got - want).abs() < 2e-6, "{depth}: {got} {want}");
        let back = through(&tree, &segment(b, a));
        assert!((got - back).abs() < 2e-6, "{depth}: {got} {back}");
    }
}

#[test]
fn a_ray_that_starts_on_matter_meets_less_of_its_own_block() {
    // Depth 3: two blocks of 4 voxels along x. A tau of .1 a voxel, and all that c says of it.
    let leave = |tree: &Octree, s: &MarchSegment| {
        transmittance_from_own_matter(tree, s, DepthChoice::default(), 0.0, &mut MarchStats::default())
    };
    let rho = f64::from(voxel::rate_table()[voxel::encode_rate(0.1) as usize]);
    for correlation in [0, 5, 15] {
        let tree = tree(full(3, isotropic(rho, correlation)));
        let s = segment(Vec3::new(0.125, 0.3, 0.3), Vec3::new(1.2, 0.3, 0.3));
        let c = f64::from(correlation) / 15.0;
        // Three voxels of the block that it starts in, then a whole one, where the law is as ever.
        let want = libm::exp(-3.0 * (1.0 - c) * rho) * crate::volume::opacity::advance_f64(1.0, 4.0 * rho, c);
        let got = f64::from(leave(&tree, &s));
        // f32: lengths of 7 pieces and exponentials, each to 1e-7.
        assert!((got - want).abs() < 2e-6, "{c}: {got} {want}");
    }
    // Matter that is met further on is not the ray's own.
    let code = morton::encode([6, 2, 2]);
    let lone = tree(sparse(3, &[code], &[isotropic(rho, 15)], Voxel::default()));
    let s = segment(Vec3::new(0.51, 0.3, 0.3), Vec3::new(1.2, 0.3, 0.3));
    assert_eq!(leave(&lone, &s), through(&lone, &s));
    // A solid's inside is in the way wherever a ray starts.
    let solid = tree(full(3, Voxel { rate: voxel::RATE_MAX, correlation: 15, ..Voxel::default() }));
    assert_eq!(leave(&solid, &s), 0.0);
}

#[test]
fn a_slab_does_not_depend_on_how_it_is_cut() {
    let tree = tree(full(4, isotropic(0.05, 0)));
    let (a, b) = (Vec3::new(0.0, 0.2, 0.9), Vec3::new(1.0, 0.7, 0.0));
    let whole = through(&tree, &segment(a, b));
    let split: f32 =
        (0..7).map(|i| through(&tree, &segment(a.lerp(b, i as f32 / 7.0), a.lerp(b, (i + 1) as f32 / 7.0)))).product();
    // Seven stretches, each end rounded to 6e-8 of the cube = 1e-6 voxels of rate .05.
    assert!((whole - split).abs() < 1e-6, "{whole} {split}");
    // The unit of t is the caller's.
    let s = segment(a, b);
    let far = MarchSegment { dir: s.dir * 1e-6, length: 1e6, ..s };
    assert!((whole - through(&tree, &far)).abs() < 1e-6);
}

#[test]
fn a_sheet_of_disjoint_matter_becomes_opaque() {
    // One layer of voxels whose facets never overlap, of total optical depth 1 straight on: c = 1 reaches exactly 0.
    let codes: Vec<u64> = (0..4096u64).filter(|&c| morton::decode(c)[2] == 5).collect();
    let facet = Sggx { xx: 0.0, yy: 0.0, zz: 1.0, xy: 0.0, xz: 0.0, yz: 0.0 };
    // A step of the rate above 1, so that rounding of an oblique chord leaves nothing.
    let mut voxel = isotropic(1.045, 15);
    voxel.ndf = facet.encode();
    let tree = tree(sparse(4, &codes, &vec![voxel; codes.len()], voxel));
    for to in [Vec3::new(0.3, 0.7, -0.5), Vec3::new(0.9, 0.1, -0.5), Vec3::new(0.31, 0.71, 0.2)] {
        assert_eq!(through(&tree, &segment(Vec3::new(0.3, 0.7, 1.0), to)), 0.0, "{to}");
    }
    // Edge-on, the facets are not seen.
    let along = through(&tree, &segment(Vec3::new(0.0, 0.3, 0.34), Vec3::new(1.0, 0.3, 0.34)));
    assert!(along > 0.99, "{along}");
}

#[test]
fn blocks_multiply() {
    // c = 1 within a block, so one block lets 1 − 4 · .1 through; n of them let the n-th power through.
    let rho = 0.1051121; // 2^(−52/16): an exact code.
    let tree = tree(full(5, isotropic(rho, 15)));
    for n in 1..=8 {
        let to = Vec3::new(n as f32 / 8.0, 0.4, 0.4);
        let got = through(&tree, &segment(Vec3::new(0.0, 0.4, 0.4), to));
        let want = (1.0 - 4.0 * rho as f32).powi(n);
        assert!((got - want).abs() < 1e-5, "{n}: {got} {want}");
    }
}

#[test]
fn a_wall_is_crossed_once() {
    // Opaque voxels all over a diagonal plane, 6-connected: no ray slips through, and the first one met takes it all.
    let n = 32u32;
    let codes: Vec<u64> = (0..u64::from(n * n * n))
        .filter(|&c| {
            let [x, y, z] = morton::decode(c);
            let sum = x + y + z;
            (45..48).contains(&sum)
        })
        .collect();
    let voxel = isotropic(100.0, 0);
    let tree = tree(sparse(5, &codes, &vec![voxel; codes.len()], voxel));
    let mut seen = 0;
    for i in 0..4000u32 {
        let f = |k: u32| (i.wrapping_mul(2_654_435_761).wrapping_add(k * 977) >> 8 & 1023) as f32 / 1023.0;
        // From corners of cells, too: the coordinates are multiples of 1/32 for some rays.
        let snap = |v: f32| if i % 3 == 0 { (v * 32.0).round() / 32.0 } else { v };
        let a = Vec3::new(snap(f(1) * 0.45), snap(f(2) * 0.45), snap(f(3) * 0.45));
        let b = Vec3::ONE - 0.4 * Vec3::new(f(4), f(5), f(6));
        if a.element_sum() > 1.35 || b.element_sum() < 1.6 {
            continue;
        }
        seen += 1;
        let mut record = Record::default();
        let s = segment(a, b);
        let t = march(&tree, &s, DepthChoice::default(), 1.0, &mut record, &mut MarchStats::default());
        assert_eq!(t, 0.0, "{a} {b}");
        let total: f32 = record.0.iter().map(|r| r.1).sum();
        assert!((total - 1.0).abs() < 1e-6);
    }
    assert!(seen > 2000, "{seen}");
}

/// The chords of the line through each voxel of the finest depth, by slabs in f64, sorted along it.
fn chords(depth: usize, codes: &[u64], voxels: &[Voxel], s: &MarchSegment) -> Vec<(usize, f64, f64)> {
    let side = f64::from(1u32 << depth);
    let (o, d) = (s.origin.as_dvec3() * side, s.dir.as_dvec3() * side);
    let mut found: Vec<_> = (0..codes.len())
        .filter_map(|i| {
            let corner = DVec3::from_array(morton::decode(codes[i]).map(f64::from));
            let (lo, hi) = voxels[i].support_box();
            let (lo, hi) = (corner + lo.as_dvec3(), corner + hi.as_dvec3());
            let (mut near, mut far) = (0.0f64, f64::from(s.length));
            for k in 0..3 {
                if d[k] == 0.0 {
                    // A line in a face belongs to the voxel above it.
                    (near, far) = if lo[k] <= o[k] && o[k] < hi[k] { (near, far) } else { (1.0, 0.0) };
                } else {
                    let (a, b) = ((lo[k] - o[k]) / d[k], (hi[k] - o[k]) / d[k]);
                    (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
                }
            }
            (near < far).then_some((i, near, far))
        })
        .collect();
    found.sort_by(|a, b| (a.1 + a.2).total_cmp(&(b.1 + b.2)));
    found
}

/// The law of opacity over those chords, T starting at 1 in each 4^3 block.
fn oracle(codes: &[u64], voxels: &[Voxel], found: &[(usize, f64, f64)], s: &MarchSegment, depth: usize) -> f64 {
    let table = voxel::rate_table();
    let dir = s.dir.normalize();
    let edges = f64::from(s.dir.length()) * f64::from(1u32 << depth);
    let (mut behind, mut block, mut current) = (1.0, 1.0, u64::MAX);
    for &(i, near, far) in found {
        if codes[i] >> 6 != current {
            behind *= block;
            (block, current) = (1.0, codes[i] >> 6);
        }
        let v = &voxels[i];
        let r = f64::from(table[usize::from(v.rate)]) * f64::from(Sggx::decode(v.ndf).sigma(dir));
        block =
            crate::volume::opacity::advance_f64(block, r * (far - near) * edges, f64::from(v.correlation & 15) / 15.0);
    }
    behind * block
}

fn any_voxel() -> impl Strategy<Value = Voxel> {
    (90u8..165, 0u8..16, any::<[u8; 6]>(), any::<[u8; 3]>(), any::<bool>()).prop_map(
        |(rate, correlation, ndf, s, tight)| {
            let mut v = Voxel { rate, correlation, ndf, ..Voxel::default() };
            if tight {
                let lo = s.map(|b| f64::from(b & 7) / 16.0);
                v.set_support(lo, [0, 1, 2].map(|k| lo[k] + f64::from(1 + (s[k] >> 5)) / 16.0));
            }
            v
        },
    )
}

fn point() -> impl Strategy<Value = Vec3> {
    prop::array::uniform3(-0.3f32..1.3).prop_map(Vec3::from_array)
}

#[test]
fn a_line_in_a_face_belongs_to_the_voxel_above() {
    let voxel = isotropic(0.5, 0);
    for depth in [0usize, 1, 3] {
        let codes: Vec<u64> = (0..1 << (3 * depth)).collect();
        let voxels: Vec<Voxel> = codes.iter().map(|c| isotropic(0.1 + 0.01 * (c % 7) as f64, 0)).collect();
        let tree = tree(sparse(depth, &codes, &voxels, voxel));
        for y in [0.0, 0.125, 0.5, 0.875, 1.0] {
            for [from, to] in [[-0.0077493694, 0.016960958], [0.3, 0.3], [0.5, 0.2]] {
                let s = segment(Vec3::new(from, y, 0.0), Vec3::new(to, y, 1.1050864));
                let found = chords(depth, &codes, &voxels, &s);
                assert_eq!(found.is_empty(), y == 1.0);
                let (got, want) = (through(&tree, &s), oracle(&codes, &voxels, &found, &s, depth));
                // A few dozen chords, each end rounded to 2e-7 of the cube, at rates of at most .16 · 8.
                assert!((f64::from(got) - want).abs() < 1e-5, "{depth} {y} {from}: {got} {want}");
            }
        }
    }
}

proptest! {
    #[test]
    fn random_octrees_agree_with_brute_force(
        depth in 0usize..6,
        cells in prop::collection::btree_map(0u64..32768, any_voxel(), 1..300),
        a in point(), b in point(), axis in 0usize..12,
    ) {
        let cells: std::collections::BTreeMap<u64, Voxel> =
            cells.into_iter().map(|(c, v)| (c & ((1 << (3 * depth)) - 1), v)).collect();
        let codes: Vec<u64> = cells.keys().copied().collect();
        let voxels: Vec<Voxel> = cells.values().copied().collect();
        // A quarter of the rays run along an axis, exactly.
        let b = if axis < 3 { let mut b = a; b[axis] = 1.3; b } else { b };
        prop_assume!((b - a).length() > 1e-3);
        let tree = tree(sparse(depth, &codes, &voxels, Voxel::default()));
        let s = segment(a, b);
        let found = chords(depth, &codes, &voxels, &s);
        let mut record = Record::default();
        let mut stats = MarchStats::default();
        let got = run(&tree, &s, DepthChoice::default(), 1.0, 0.0, &mut record, &mut stats);
        let want = oracle(&codes, &voxels, &found, &s, depth);
        // Chord ends are rounded to about 2e-7 of the cube each, 6e-6 voxels at 32^3, at rates up to 2.5 and a few dozen
        // voxels; a chord near a voxel's edge may change block order, which costs no more than its own weight.
        prop_assert!((f64::from(got) - want).abs() < 2e-4, "{got} {want}");
        // Every chord that is longer than rounding, in order, once.
        let long = |c: &&(usize, f64, f64)| (c.2 - c.1) * f64::from(s.dir.length()) > 4e-6;
        let mut rest = record.0.iter();
        let mut behind = 1.0f32;
        for c in found.iter().filter(long) {
            if behind < 1e-6 { break; }
            let sigma = Sggx::decode(voxels[c.0].ndf).sigma(s.dir.normalize());
            if sigma < 1e-2 { continue; }
            let hit = rest.find(|h| h.0 == voxels[c.0] && (f64::from(h.2) - 0.5 * (c.1 + c.2)).abs() < 1e-5);
            prop_assert!(hit.is_some(), "voxel {} at {:?}, {} met", codes[c.0], c, record.0.len());
            behind -= hit.map_or(0.0, |h| h.1);
        }
        prop_assert!(record.0.windows(2).all(|w| w[0].2 <= w[1].2 + 1e-6));
        let total: f32 = record.0.iter().map(|r| r.1).sum();
        prop_assert!((total + got - 1.0).abs() < 2e-6, "weights {total} and T {got}");
    }

    #[test]
    fn transmittance_falls_along_a_ray(
        cells in prop::collection::btree_map(0u64..4096, any_voxel(), 1..300),
        a in point(), b in point(), cut in 0.0f32..1.0,
    ) {
        let (codes, voxels): (Vec<u64>, Vec<Voxel>) = cells.into_iter().unzip();
        prop_assume!((b - a).length() > 1e-3);
        let tree = tree(sparse(4, &codes, &voxels, Voxel::default()));
        let s = segment(a, b);
        let (part, whole) = (through(&tree, &MarchSegment { length: cut, ..s }), through(&tree, &s));
        prop_assert!((0.0..=1.0).contains(&whole) && whole <= part, "{part} {whole}");
    }

    #[test]
    fn terminal_nodes_equal_the_expanded_tree(
        masks in any::<[u8; 8]>(), a in point(), b in point(), depth in 3usize..6,
    ) {
        prop_assume!((b - a).length() > 1e-3);
        // Children of the root are either terminal at depth 1 or have children, some of which are terminal at depth 2.
        // c = 0 matter alike everywhere, so that the whole is e^(−rate · chord) however it is stored.
        let rate = |d: usize| isotropic(1.5 * 2f64.powi(-(d as i32)), 0);
        let solid = |p: DVec3| {
            let i = (p.x >= 0.5) as usize | ((p.y >= 0.5) as usize) << 1 | ((p.z >= 0.5) as usize) << 2;
            let q = (p * 2.0).fract();
            let j = (q.x >= 0.5) as usize | ((q.y >= 0.5) as usize) << 1 | ((q.z >= 0.5) as usize) << 2;
            masks[i] == 0 || masks[i] >> j & 1 != 0
        };
        let side = f64::from(1u32 << depth);
        let codes: Vec<u64> = (0..1u64 << (3 * depth))
            .filter(|&c| solid((DVec3::from_array(morton::decode(c).map(f64::from)) + 0.5) / side))
            .collect();
        let expanded = tree(sparse(depth, &codes, &vec![rate(depth); codes.len()], rate(0)));
        let inner: usize = masks.iter().map(|m| m.count_ones() as usize).sum();
        let mut depths = vec![
            Depth { masks: vec![255], voxels: vec![rate(0)], mixes: Vec::new() },
            Depth { masks: masks.to_vec(), voxels: vec![rate(1); 8], mixes: Vec::new() },
            Depth { masks: vec![0; inner], voxels: vec![rate(2); inner], mixes: Vec::new() },
        ];
        depths.resize(depth + 1, Depth::default());
        let terminal = tree(Volume { info: info(Model::Coverage), depths });
        let s = segment(a, b);
        let (want, got) = (through(&expanded, &s), through(&terminal, &s));
        // Up to 90 pieces of which each end is rounded to 2e-7 of the cube, at 1.5 per cube edge.
        prop_assert!((want - got).abs() < 5e-5, "{want} {got}");
    }

    #[test]
    fn nothing_panics(o in any::<[f32; 3]>(), d in any::<[f32; 3]>(), length in any::<f32>(), width in any::<f32>(), growth in any::<f32>()) {
        let tree = tree(full(3, isotropic(0.5, 7)));
        let s = MarchSegment { origin: o.into(), dir: d.into(), length, footprint: width, growth, opacity_scale: 1.0 };
        let t = through(&tree, &s);
        prop_assert!((0.0..=1.0).contains(&t));
        let d = Vec3::new(d[0], 0.0, -0.0);
        let near = MarchSegment { origin: Vec3::splat(0.25), dir: d, length: 1.0 / d.length(), ..s };
        prop_assert!((0.0..=1.0).contains(&through(&tree, &near)));
    }
}

#[test]
fn even_and_odd_depths_agree() {
    // The same matter read at each depth: alike up to how c = 0 matter is cut, which is not at all.
    let depths: Vec<Depth> = (0..=6)
        .map(|d| {
            let n = 1usize << (3 * d);
            let v = isotropic(0.5 * 2f64.powi(-d), 0);
            Depth { masks: vec![if d == 6 { 0 } else { 255 }; n], voxels: vec![v; n], mixes: Vec::new() }
        })
        .collect();
    let tree = tree(Volume { info: info(Model::Coverage), depths });
    let s = segment(Vec3::new(0.1, 0.0, 0.3), Vec3::new(0.9, 1.0, 0.35));
    let want = through(&tree, &s);
    for d in 0..6 {
        let got = transmittance(&tree, &s, at_depth(d), 0.0, &mut MarchStats::default());
        assert!((got - want).abs() < 5e-6, "{d}: {got} {want}");
    }
    // A cone that widens from a voxel to the whole cube changes depth on the way and loses nothing.
    let cone = MarchSegment { footprint: 1.0 / 64.0, growth: 0.5, ..s };
    let mut stats = MarchStats::default();
    let got = transmittance(&tree, &cone, DepthChoice::default(), 0.0, &mut stats);
    assert_eq!(stats.deepest, 6);
    assert!(stats.voxels < 40, "{stats:?}");
    assert!((got - want).abs() < 5e-6, "{got} {want}");
}

#[test]
fn depth_choice_rounds_and_dithers() {
    let c = DepthChoice::default();
    let depth = |c: DepthChoice, width: f32| c.depths(9).depth(width);
    assert_eq!([1.0, 0.5, 0.36, 0.35, 0.0, f32::NAN].map(|width| depth(c, width)), [0, 1, 1, 2, 9, 9]);
    assert_eq!(depth(DepthChoice { bias: -1.0, ..c }, 0.25), 1);
    assert_eq!(depth(DepthChoice { finest: 4, ..c }, 1e-9), 4);
    assert_eq!([1e9, -1e9].map(|bias| depth(DepthChoice { bias, ..c }, 0.25)), [9, 0]);
    // log2(1/.2) = 2.32: 32 % of thresholds go to depth 3.
    let finer = (0..100).filter(|i| depth(DepthChoice { lod_dither: *i as f32 / 100.0, ..c }, 0.2) == 3).count();
    assert_eq!(finer, 33);
    for lod_dither in [0.0, 0.3, 0.5, 0.99] {
        let depths = DepthChoice { lod_dither, ..c }.depths(9);
        for d in 1..9 {
            let limit = depths.width_limit(d);
            assert_eq!((depths.depth(limit * 0.9999), depths.depth(limit * 1.0001)), (d, d - 1));
        }
    }
}

#[test]
fn wide_instructions_change_no_bit() {
    let mut voxel = isotropic(0.3, 7);
    voxel.ndf = Sggx { xx: 0.9, yy: 0.5, zz: 0.2, xy: 0.3, xz: -0.1, yz: 0.05 }.encode();
    voxel.set_support([0.1, 0.2, 0.3], [0.8, 0.7, 0.9]);
    let tree = tree(full(5, voxel));
    let all = |plain: bool| -> Vec<u32> {
        crate::simd::PLAIN_ONLY.store(plain, std::sync::atomic::Ordering::Relaxed);
        let one = |i: u32| {
            let at = |k: f32| (0.37 * k * i as f32).fract();
            let s = segment(Vec3::new(at(1.0), at(2.0), at(3.0)), Vec3::new(at(5.0), at(7.0), at(11.0)));
            through(&tree, &MarchSegment { footprint: at(13.0) / 8.0, growth: 0.05, ..s }).to_bits()
        };
        let found = (0..500).map(one).collect();
        crate::simd::PLAIN_ONLY.store(false, std::sync::atomic::Ordering::Relaxed);
        found
    };
    let wide = all(false);
    assert!(wide.iter().filter(|t| **t != 1f32.to_bits()).count() > 400);
    assert_eq!(wide, all(true));
}

#[test]
fn neyret_opacity_is_isotropic() {
    let mut voxel = isotropic(0.0625, 0);
    voxel.ndf = Sggx { xx: 1.0, yy: 0.0, zz: 0.0, xy: 0.0, xz: 0.0, yz: 0.0 }.encode();
    let mut volume = full(3, voxel);
    volume.info.model = Model::Neyret;
    let tree = tree(volume);
    let got = through(&tree, &segment(Vec3::new(0.5, 0.0, 0.5), Vec3::new(0.5, 1.0, 0.5)));
    assert!((got - (-0.5f32).exp()).abs() < 1e-6, "{got}");
}

#[test]
fn what_is_left_of_an_opaque_ray_goes_to_its_last_voxel() {
    let tree = tree(full(5, isotropic(1.0, 0)));
    let mut record = Record::default();
    let s = segment(Vec3::new(0.0, 0.4, 0.4), Vec3::new(1.0, 0.4, 0.4));
    let t = march(&tree, &s, DepthChoice::default(), 0.5, &mut record, &mut MarchStats::default());
    let total: f32 = record.0.iter().map(|r| r.1).sum();
    assert_eq!(t, 0.0);
    assert!((total - 0.5).abs() < 1e-6);
    // e^−n / 2 < 1/512 from n = 6.
    assert_eq!(record.0.len(), 6);
}

/// What an eye sees of single-sided facets, in closed form: a sheet from before, from behind and aslant; a hemisphere of facets,
/// of which the share (1 + cos θ) / 2 faces the eye.
#[test]
fn fronts_are_seen_by_their_share() {
    let voxel = |ndf: crate::volume::Sggx, normal: Vec3, one_sidedness: f64| {
        let mut voxel = Voxel { rate: 100, ndf: ndf.encode(), ..Voxel::default() };
        voxel.set_mean_normal(normal.as_dvec3().to_array(), one_sidedness);
        voxel
    };
    let ways = (0..60).map(|i| {
        let (z, a) = (1.0 - (i as f32 + 0.5) / 30.0, 2.4 * i as f32);
        let r = (1.0 - z * z).sqrt();
        Vec3::new(r * a.cos(), r * a.sin(), z)
    });
    for w in ways {
        for normal in [Vec3::Z, Vec3::new(0.6, 0.0, -0.8), Vec3::new(0.48, 0.6, 0.64)] {
            let cosine = -normal.dot(w);
            let sheet = voxel(flat(normal), normal, 1.0);
            // Codes of the matrix make a slope of a twentieth of a sheet's edge on view: there both sides are seen.
            if cosine.abs() > 0.2 {
                let found = front_facing_share(&sheet, 1.0, w);
                assert!((found - f32::from(cosine > 0.0)).abs() < 0.06, "{normal} {w}: {found}");
            }
            let half = voxel(crate::volume::Sggx::ISOTROPIC, normal, 0.5);
            let (found, want) = (front_facing_share(&half, 1.0, w), 0.5 + 0.5 * cosine);
            // Of ½ the nearest fifteenth is .533, and of a direction's code a hundredth.
            assert!((found - want).abs() < 0.05, "{normal} {w}: {found} {want}");
            assert!((front_facing_share(&half, 0.5, w) - 0.5 - 0.5 * found).abs() < 1e-6);
            assert_eq!(front_facing_share(&half, 0.0, w), 1.0);
        }
    }
}

/// The distribution of a sheet of the unit normal `n`.
fn flat(n: Vec3) -> crate::volume::Sggx {
    let [x, y, z] = n.to_array();
    crate::volume::Sggx { xx: x * x, yy: y * y, zz: z * z, xy: x * y, xz: x * z, yz: y * z }
}
