//! Times the march over one texel: `cargo bench --bench march [-- [FILE.vtex] [--depth=D]]`. Without a file, over a crown of random leaves.
//!
//! Prints nanoseconds, steps and voxels a ray for orthographic camera rays at several footprints, and for shadow rays
//! from what those rays met, one depth coarser. One thread; the best of three runs, or one of one depth.

use std::time::Instant;

use vtex::geom::{DVec3, Vec3};
use vtex::march::shade::{Shader, ShadowGroup};
use vtex::render::{DepthChoice, MarchSegment, MarchStats, march, transmittance};
use vtex::volume::{Channels, Depth, Info, Octree, Sggx, Volume, Voxel, voxel};
use vtex::{format, morton};

fn main() -> vtex::Result<()> {
    let file = std::env::args().skip(1).find(|a| !a.starts_with('-'));
    let tree = match file {
        Some(path) => Octree::new(format::Reader::open(path, &format::Limits::default())?)?,
        None => Octree::new(crown(9, 12_000))?,
    };
    let finest = tree.finest().unwrap_or(0);
    println!("{} voxels, {} at depth {finest}", (0..=finest).map(|d| tree.count(d)).sum::<usize>(), tree.count(finest));
    println!(
        "{:>10} {:>9} {:>9} {:>9} {:>9}  | shadow {:>7} {:>9} {:>9} {:>9}",
        "depth", "ns/ray", "with sun", "cells", "voxels", "rays", "ns/ray", "cells", "voxels"
    );
    let only: Option<usize> = std::env::args().find_map(|a| a.strip_prefix("--depth=")?.parse().ok());
    let runs = if only.is_some() { 1 } else { 3 };
    for depth in (3..=finest).rev().filter(|&d| only.is_none_or(|o| o == d)) {
        let (best, first) =
            (0..runs).map(|_| pass(&tree, depth)).fold((f64::MAX, None), |(b, _), p| (b.min(p.plain), Some(p)));
        if let Some(p) = first {
            let (n, m) = (p.rays as f64, p.shadow_rays.max(1) as f64);
            println!(
                "{depth:>10} {best:>9.0} {:>9.0} {:>9.1} {:>9.1}  |        {:>7.2} {:>9.0} {:>9.1} {:>9.1}   (coverage {:.4}, light {:.5})",
                p.shaded,
                p.camera.cells as f64 / n,
                p.camera.voxels as f64 / n,
                m / n,
                p.shadow,
                p.shadows.cells as f64 / m,
                p.shadows.voxels as f64 / m,
                p.coverage,
                p.light,
            );
        }
    }
    Ok(())
}

struct Pass {
    rays: u64,
    plain: f64,
    shaded: f64,
    shadow: f64,
    shadow_rays: u64,
    camera: MarchStats,
    shadows: MarchStats,
    coverage: f64,
    light: f64,
}

/// Rays across the whole cube, one a voxel of `depth`, from a slightly turned direction.
fn pass(tree: &Octree, depth: usize) -> Pass {
    let side = 1 << depth.clamp(7, 9);
    let dir = Vec3::new(0.18, 0.97, -0.12).normalize();
    let (right, up) = (dir.any_orthonormal_pair().0, dir.any_orthonormal_pair().1);
    let stretch = |i: usize| {
        let at = |k: usize| (k as f32 + 0.5) / side as f32 - 0.5;
        let origin = Vec3::splat(0.5) + right * at(i % side) + up * at(i / side) - dir * 0.9;
        MarchSegment { origin, dir, length: 1.8, footprint: (-(depth as f32)).exp2(), growth: 0.0, opacity_scale: 1.0 }
    };
    let n = side * side;
    let choice = DepthChoice::default();
    let began = Instant::now();
    let time = |f: &mut dyn FnMut()| {
        let start = cpu_ns().unwrap_or_else(|| began.elapsed().as_nanos() as f64);
        f();
        cpu_ns().unwrap_or_else(|| began.elapsed().as_nanos() as f64) - start
    };
    let mut camera = MarchStats::default();
    let mut coverage = 0.0;
    let plain = time(&mut || {
        for i in 0..n {
            coverage += f64::from(1.0 - transmittance(tree, &stretch(i), choice, 1.0 / 512.0, &mut camera));
        }
    });
    let sun = [Vec3::new(-0.45, -0.55, 0.75).normalize()];
    let mut groups: Vec<ShadowGroup> = Vec::new();
    let mut unused = MarchStats::default();
    let shaded = time(&mut || {
        for i in 0..n {
            let mut shader = Shader::new(-dir, &sun, None, Vec3::ONE, tree.brightness_factors(), &mut groups);
            march(tree, &stretch(i), choice, 1.0, &mut shader, &mut unused);
            shader.finish();
        }
    });
    let mut shadows = MarchStats::default();
    let mut light = 0.0;
    let shadow = time(&mut || {
        for g in &groups {
            let s = MarchSegment { origin: g.position + sun[0] * 0.002, dir: sun[0], ..stretch(0) };
            let t = transmittance(tree, &s, DepthChoice { bias: -1.0, ..choice }, 1.0 / 256.0, &mut shadows);
            light += f64::from(g.energy.y * t);
        }
    });
    Pass {
        rays: n as u64,
        plain: plain / n as f64,
        shaded: shaded / n as f64,
        shadow: shadow / groups.len().max(1) as f64,
        shadow_rays: groups.len() as u64,
        camera,
        shadows,
        coverage: coverage / n as f64,
        light: light / n as f64,
    }
}

/// Time that this thread was on a core, where the system tells (Linux): other processes' load does not count.
fn cpu_ns() -> Option<f64> {
    std::fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse().ok()
}

/// A ball of `leaves` disks of 5 voxels across at `depth`, in clumps; coarser voxels hold the mean rate, thinned for overlap.
fn crown(depth: usize, leaves: usize) -> Volume {
    let mut state = 1u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / (1u64 << 24) as f64
    };
    let mut ball = move || loop {
        let p = DVec3::new(random(), random(), random()) * 2.0 - 1.0;
        if p.length_squared() < 1.0 {
            return p;
        }
    };
    let side = f64::from(1u32 << depth);
    let mut cells = std::collections::BTreeMap::new();
    let mut clump = DVec3::ZERO;
    for leaf in 0..leaves {
        if leaf % 60 == 0 {
            clump = ball() * 0.42 + 0.5;
        }
        let centre = clump + ball() * 0.05;
        let normal = ball().normalize();
        let mut voxel = Voxel { rate: voxel::encode_rate(0.8), correlation: 12, ..Voxel::default() };
        let n = normal.as_vec3();
        voxel.ndf =
            Sggx { xx: n.x * n.x, yy: n.y * n.y, zz: n.z * n.z, xy: n.x * n.y, xz: n.x * n.z, yz: n.y * n.z }.encode();
        voxel.set_albedo([0.1, 0.4, 0.05]);
        let (a, b) = normal.any_orthonormal_pair();
        for i in 0..144 {
            let (x, y) = (f64::from(i % 12) - 5.5, f64::from(i / 12) - 5.5);
            let p = centre * side + (a * x + b * y) * 0.4;
            if x * x + y * y < 36.0 && p.min_element() >= 0.0 && p.max_element() < side {
                cells.insert(morton::encode([p.x as u32, p.y as u32, p.z as u32]), voxel);
            }
        }
    }
    let (codes, voxels): (Vec<u64>, Vec<Voxel>) = cells.into_iter().unzip();
    let mut depths = vec![Depth { masks: vec![0; codes.len()], voxels, mixes: Vec::new() }];
    let mut codes = codes;
    let rates = voxel::rate_table();
    for _ in 0..depth {
        let below = &depths[depths.len() - 1].voxels;
        let (mut parents, mut up): (Vec<u64>, Depth) = Default::default();
        let mut sum = 0.0;
        for (i, c) in codes.iter().enumerate() {
            if parents.last() != Some(&(c >> 3)) {
                parents.push(c >> 3);
                up.masks.push(0);
                up.voxels.push(Voxel { correlation: 0, ..below[i] });
                sum = 0.0;
            }
            let last = parents.len() - 1;
            up.masks[last] |= 1 << (c & 7);
            sum += f64::from(rates[usize::from(below[i].rate)]);
            up.voxels[last].rate = voxel::encode_rate(0.22 * sum);
        }
        depths.push(up);
        codes = parents;
    }
    depths.reverse();
    let info = Info {
        facet_size: 4.0 / side,
        channels: Channels { correlation: true, albedo: true, ..Channels::default() },
        ..Info::default()
    };
    Volume { info, depths }
}
