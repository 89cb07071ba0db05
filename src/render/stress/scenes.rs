//! Pictures of one landscape in different places: they are one picture.

use std::sync::Arc;

use super::{Random, Tally};
use crate::geom::{DAffine3, DVec3};
use crate::morton;
use crate::progress::Quiet;
use crate::render::{CameraChoice, Options, render_with};
use crate::scene::copies::CopySet;
use crate::scene::phong::Phong;
use crate::scene::shell::{Environment, ShellMaterial, TexelRef, Variant};
use crate::scene::{Instance, Light, LightKind, Material, Model, Part, Scene};
use crate::volume::{Channels, Depth, Info, Octree, Volume, Voxel};

/// Pixels a side: three pictures are 3072 rays.
const SIDE: u32 = 32;
/// A ball of voxels of `depth`; the same matter at every depth.
fn ball(depth: usize, seed: u64) -> Option<Octree> {
    let inside = |c: &u64, d: usize| {
        let p = DVec3::from_array(morton::decode(*c).map(|k| f64::from(k) + 0.5)) * libm::exp2(-(d as f64));
        (p - 0.5).length() < 0.42
    };
    let mut codes: Vec<u64> = (0..1u64 << (3 * depth)).filter(|c| inside(c, depth)).collect();
    let mut depths = Vec::new();
    let mut masks = vec![0; codes.len()];
    for d in (0..=depth).rev() {
        let voxel = |c: &u64| {
            let mut random = Random::new(seed, d as u64, *c);
            // As many hits along the whole at each depth.
            let mut v = Voxel { rate: (130 + 16 * (depth - d)).min(255) as u8, ..Voxel::default() };
            v.set_albedo([random.unit(), random.unit(), random.unit()]);
            v
        };
        depths.push(Depth { masks, voxels: codes.iter().map(voxel).collect(), mixes: Vec::new() });
        (codes, masks) = morton::parents(&codes);
    }
    depths.reverse();
    let info = Info { facet_size: 0.02, channels: Channels { albedo: true, ..Channels::default() }, ..Info::default() };
    Octree::new(Volume { info, depths }).ok()
}

/// A square patch of uneven thickness on a ground, rigid copies about it, and a sun; all numbers are short in binary.
fn landscape(random: &mut Random, place: DAffine3) -> Scene {
    let short = |v: f64| (v * 256.0).round() as f32 / 256.0;
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0f32]];
    let square = |half: f32, tiles: f32, material: usize| Part {
        name: "square".into(),
        positions: corners.map(|[x, z]| [x * half, 0.0, z * half]).to_vec(),
        normals: Some(vec![[0.0, 1.0, 0.0]; 4]),
        uvs: vec![corners.map(|[x, z]| [0.5 * (x + 1.0) * tiles, 0.5 * (1.0 - z) * tiles]).to_vec()],
        triangles: vec![[0, 3, 1], [1, 3, 2]],
        material,
        ..Part::default()
    };
    let mut bulging = square(2.0, 3.0, 0);
    let mut height = |_: usize| {
        [short(random.between(-0.3, 0.3)), short(random.between(0.5, 1.5)), short(random.between(-0.3, 0.3))]
    };
    bulging.heights = Some((0..4).map(&mut height).collect());
    if random.once_in(2) {
        bulging.patches = vec![[3, 2, 1, 0]];
        bulging.triangles.reverse();
    }
    let shell = ShellMaterial::default();
    let covered = Material { shell: Some(Arc::new(shell)), ..Material::default() };
    let low = DAffine3::from_translation(DVec3::new(0.0, -0.5, 0.0));
    let instance = |part: usize, transform: DAffine3| Instance { part, transform, node: String::new() };
    let sun = Light {
        name: String::new(),
        to_world: DAffine3::from_quat(glam::DQuat::from_rotation_arc(DVec3::Z, DVec3::new(0.4, 1.0, 0.3).normalize())),
        intensity: [3.0; 3],
        kind: LightKind::Directional,
        range: f64::INFINITY,
    };
    // Leaning, flattened and mirrored ones among them, inside of the shell and outside.
    let spot = |random: &mut Random, y: f64| [random.between(-2.0, 2.0), y, random.between(-2.0, 2.0)].map(short);
    let copies = CopySet {
        node: "copies".into(),
        to_world: place,
        variants: vec![Variant { phong: Phong::tint([1.0, 0.5, 0.25]), ..Variant::alone(0) }],
        translations: (0..4).map(|k| spot(random, 0.25 * f64::from(k) - 0.25)).collect(),
        rotations: (0..4).map(|_| spot(random, 0.5)).map(|[x, y, z]| [x, y, z, 1.0]).collect(),
        scales: [[1.0; 3], [0.5, 1.5, 0.5], [-1.0, 1.0, 1.0], [0.25, 0.25, 2.0]].to_vec(),
        choices: Vec::new(),
        tints: Vec::new(),
        phases: Vec::new(),
        wind: None,
    };
    let model = Model {
        parts: vec![bulging, square(8.0, 1.0, 1)],
        materials: vec![covered, Material::default()],
        instances: vec![instance(0, place), instance(1, place * low)],
        lights: vec![sun],
        metres_per_unit: 1.0,
        ..Model::default()
    };
    let texel = TexelRef { name: "t".into(), frames: vec!["t.vtex".into()], ..TexelRef::default() };
    let environment =
        Environment { sky: Some([0.2, 0.3, 0.4].into()), background: Some([0.0; 3]), ..Default::default() };
    Scene { model, texels: vec![texel], copies: vec![copies], environment }
}

pub fn scenes(random: &mut Random, rays: u64) -> Tally {
    let mut tally = Tally { rays, ..Tally::default() };
    let (seed, of_land) = (random.bits(), random.bits());
    let short = |v: DVec3| (v * 64.0).round() / 64.0;
    // From all around, and from inside of the shell.
    let eye = if random.once_in(3) {
        short(DVec3::new(random.between(-1.5, 1.5), random.between(0.1, 0.5), random.between(-1.5, 1.5)))
    } else {
        short(DVec3::Y + 5.0 * DVec3::new(1.0, 0.8, 1.0) * random.direction().abs())
    };
    let target = short(random.point());
    if eye == target {
        return tally;
    }
    let shot = |scale: f64, shift: DVec3| {
        let place = DAffine3::from_scale(DVec3::splat(scale)) * DAffine3::from_translation(shift);
        let at = |p: DVec3| place.transform_point3(p);
        let camera = CameraChoice::LookAt { eye: at(eye), target: at(target), yfov: 0.7 };
        let options = Options { size: [SIDE, SIDE], camera, threads: 1, ..Options::measuring() };
        let scene = landscape(&mut Random::new(of_land, 0, 0), place);
        let tree = ball(4, seed)?;
        render_with(&scene, vec![Some(tree)], &options, &Quiet).ok().map(|done| done.film.pixels)
    };
    let far = DVec3::new(1e7, 0.0, -1e7) * if random.once_in(2) { 1.0 } else { -1.0 };
    // Products with a power of two are exact: as are sums with 1e7 of what is short in binary. So not a bit may change.
    let scale = libm::exp2(random.between(-20.0, 20.0).round());
    let [Some(still), Some(moved), Some(scaled)] = [shot(1.0, DVec3::ZERO), shot(1.0, far), shot(scale, DVec3::ZERO)]
    else {
        tally.nan += 1;
        return tally;
    };
    for pixels in [&still, &moved, &scaled] {
        let whole = |p: &[f32; 4]| p.iter().all(|v| v.is_finite() && *v >= 0.0) && p[3] <= 1.0 + 1e-5;
        tally.nan += pixels.iter().filter(|p| !whole(p)).count() as u64;
    }
    let apart = |a: &[f32; 4], b: &[f32; 4]| (0..4).map(|k| (a[k] - b[k]).abs()).fold(0.0, f32::max);
    for (a, (b, c)) in still.iter().zip(moved.iter().zip(&scaled)) {
        tally.steps += u64::from(apart(a, b) > 0.0) + u64::from(apart(a, c) > 0.0);
        tally.worst_step = tally.worst_step.max(apart(a, b).max(apart(a, c)).into());
    }
    tally
}
