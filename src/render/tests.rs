//! Whole scenes with closed-form answers.

use super::*;
use crate::geom::{Aabb, DAffine3, DVec3};
use crate::progress::Quiet;
use crate::scene::shell::{CellWrap, Environment, Layer, ShellMaterial, TexelRef};
use crate::scene::{Instance, Light, LightKind, Material, Model, Part};
use crate::volume::{Channels, Depth, Info, Volume, Voxel, voxel};

/// A texel that is the same voxel everywhere inside `fill` (texel units), down to `finest`.
fn texel(finest: usize, proto: Voxel, fill: impl Fn(DVec3) -> bool) -> Octree {
    let mut depths: Vec<Depth> = vec![Depth::default(); finest + 1];
    let mut codes: Vec<u64> = (0..1u64 << (3 * finest))
        .filter(|&c| {
            let p = crate::morton::decode(c).map(|k| (f64::from(k) + 0.5) / f64::from(1u32 << finest));
            fill(DVec3::from_array(p))
        })
        .collect();
    for d in (0..=finest).rev() {
        depths[d].voxels = vec![Voxel { rate: rate_at(proto.rate, finest, d), ..proto }; codes.len()];
        if d == finest {
            depths[d].masks = vec![0; codes.len()];
        }
        if d > 0 {
            let mut masks: Vec<(u64, u8)> = Vec::new();
            for c in &codes {
                match masks.last_mut() {
                    Some(last) if last.0 == c >> 3 => last.1 |= 1 << (c & 7),
                    _ => masks.push((c >> 3, 1 << (c & 7))),
                }
            }
            codes = masks.iter().map(|m| m.0).collect();
            depths[d - 1].masks = masks.iter().map(|m| m.1).collect();
        }
    }
    let info = Info {
        bounds: Aabb::UNIT,
        metres_per_unit: 1.0,
        up: 1,
        cyclic: [false; 3],
        model: crate::volume::Model::Coverage,
        content: Aabb::UNIT,
        facet_size: 0.0,
        channels: Channels::default(),
        meta: Default::default(),
    };
    Octree::new(Volume { info, depths }).unwrap()
}

/// The code of the same density a coarser depth: twice the rate a voxel edge for each.
fn rate_at(code: u8, finest: usize, depth: usize) -> u8 {
    (usize::from(code) + 16 * (finest - depth)).min(255) as u8
}

fn layer() -> Layer {
    Layer {
        texel: 0,
        wrap: [CellWrap::Repeat, CellWrap::Repeat, CellWrap::Empty],
        offset: [0.0; 3],
        scale: [1.0; 3],
        opacity_scale: 1.0,
        diffuse: [1.0; 3],
        discrete: None,
    }
}

fn shell(thickness: f64, surface_visible: bool) -> Material {
    let shell = ShellMaterial { tex_coord: 0, w: 0.0, dw: 1.0, thickness, surface_visible, layers: vec![layer()] };
    Material { base_color: [0.5, 0.5, 0.5, 1.0], shell: Some(Arc::new(shell)), ..Default::default() }
}

/// A square of side 2 `half` in the plane y = 0, facing up, with `tiles` copies along each side.
fn square(half: f32, tiles: f32, material: usize) -> Part {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0f32]];
    Part {
        name: "square".into(),
        positions: corners.map(|[x, z]| [x * half, 0.0, z * half]).to_vec(),
        normals: Some(vec![[0.0, 1.0, 0.0]; 4]),
        uvs: vec![corners.map(|[x, z]| [0.5 * (x + 1.0) * tiles, 0.5 * (1.0 - z) * tiles]).to_vec()],
        triangles: vec![[0, 3, 1], [1, 3, 2]],
        material,
        ..Default::default()
    }
}

fn scene(parts: Vec<Part>, materials: Vec<Material>, at: Vec<DAffine3>) -> Scene {
    let instances =
        at.into_iter().enumerate().map(|(part, transform)| Instance { part, transform, node: String::new() }).collect();
    let model = Model { parts, materials, instances, metres_per_unit: 1.0, ..Default::default() };
    let texel = TexelRef { name: "t".into(), frames: vec!["t.vtex".into()], geometry: None, max_depth: None };
    let environment = Environment { sky: Some([0.0; 3]), background: Some([0.0; 3]) };
    Scene { model, texels: vec![texel], environment }
}

fn sun(towards: DVec3, irradiance: f64) -> Light {
    Light {
        name: String::new(),
        to_world: DAffine3::from_quat(glam::DQuat::from_rotation_arc(DVec3::Z, towards.normalize())),
        intensity: [irradiance; 3],
        kind: LightKind::Directional,
        range: f64::INFINITY,
    }
}

fn looking(eye: DVec3, target: DVec3, size: u32) -> Options {
    Options {
        size: [size, size],
        camera: CameraChoice::LookAt { eye, target, yfov: 0.5 },
        sky: Some([0.0; 3]),
        background: Some([0.0; 3]),
        ..Default::default()
    }
}

fn grey(rate: f64) -> Voxel {
    let mut v = Voxel { rate: voxel::encode_rate(rate), ..Default::default() };
    v.set_albedo([0.5; 3]);
    v
}

#[test]
#[ignore = "makes a picture to look at"]
fn first_picture() {
    let ball = |p: DVec3| (p - DVec3::splat(0.5)).length() < 0.45;
    let tree = texel(6, grey(2.0), ball);
    let mut ground = square(4.0, 4.0, 0);
    ground.name = "ground".into();
    let mut wall = square(0.6, 1.0, 1);
    wall.uvs.clear();
    let materials = vec![shell(2.0, true), Material { base_color: [0.7, 0.1, 0.1, 1.0], ..Default::default() }];
    let tilt = DAffine3::from_translation(DVec3::new(-1.0, 2.5, 2.0)) * DAffine3::from_rotation_x(0.8);
    let scene = scene(vec![ground, wall], materials, vec![DAffine3::IDENTITY, tilt]);
    let options = Options {
        size: [640, 360],
        camera: CameraChoice::LookAt { eye: DVec3::new(3.0, 6.0, 12.0), target: DVec3::new(0.0, 0.5, 0.0), yfov: 0.6 },
        sky: Some([0.3, 0.4, 0.5]),
        lanes: 4,
        ..Default::default()
    };
    let done = render_with(&scene, vec![Some(tree)], &options, &Quiet).unwrap();
    done.film.save(std::path::Path::new("/tmp/shells-first.png")).unwrap();
    println!("{:?} {:?} {:?}", done.stats, done.warnings, done.notes);
}
