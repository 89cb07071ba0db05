//! A valley between hills: forest and meadow in blocks of ten metres, a ground texture, two cameras and a sun.

use glam::{DMat3, DQuat, DVec2, DVec3};
use serde_json::{Value, json};
use std::f64::consts::PI;

use crate::glb::{Glb, Mesh};
use crate::random::fractal;

/// Metres across, and squares a side; a block of forest or meadow is `BLOCK` squares wide, as wide as the tree is tall.
const SIZE: f64 = 320.0;
const SQUARES: u32 = 64;
const BLOCK: u32 = 2;

/// Height of the ground, metres: a winding valley that climbs towards the rim.
fn height(p: DVec2) -> f64 {
    let hills = 15.0 * fractal(p / 95.0, 5, 3);
    let winding = p.x - 26.0 * libm::sin(p.y / 62.0) - 8.0;
    let valley = 1.0 - libm::exp(-(winding / 46.0) * (winding / 46.0));
    let rim = libm::pow(p.length() / (SIZE / 2.0), 3.0);
    hills * (0.35 + 0.65 * valley) + 17.0 * valley + 12.0 * rim
}

fn normal(p: DVec2) -> DVec3 {
    let e = 0.5;
    let slope = |d: DVec2| (height(p + d) - height(p - d)) / (2.0 * e);
    DVec3::new(-slope(DVec2::X * e), 1.0, -slope(DVec2::Y * e)).normalize()
}

/// Above 0 where the ground is meadow: the valley's floor and a few clearings.
fn open(p: DVec2) -> f64 {
    let winding = p.x - 26.0 * libm::sin(p.y / 62.0) - 8.0;
    1.0 - (winding / 21.0).abs() + 0.9 * fractal(p / 38.0, 3, 40)
}

/// Linear colour of the ground: grass, drier on the heights, earth on slopes and under the trees.
fn ground(p: DVec2) -> DVec3 {
    let (grass, dry, earth) =
        (DVec3::new(0.085, 0.15, 0.03), DVec3::new(0.2, 0.18, 0.065), DVec3::new(0.11, 0.08, 0.05));
    let meadow = (0.5 + 0.8 * open(p) + 0.35 * fractal(p / 6.0, 3, 9)).clamp(0.0, 1.0);
    let dryness = (0.3 + 0.02 * height(p) + 0.7 * fractal(p / 17.0, 4, 21)).clamp(0.0, 1.0);
    let steep = ((0.95 - normal(p).y) * 9.0).clamp(0.0, 1.0);
    let grass = grass.lerp(dry, 0.55 * dryness);
    let floor = earth.lerp(grass, 0.25 + 0.75 * meadow);
    floor.lerp(earth, 0.8 * steep) * (1.0 + 0.35 * fractal(p / 3.1, 3, 33))
}

fn texture() -> Vec<u8> {
    let side = 256;
    let image = image::RgbImage::from_fn(side, side, |i, j| {
        let p = (DVec2::new(f64::from(i), f64::from(j)) + 0.5) / f64::from(side) - 0.5;
        let code = |x: f64| (libm::pow(x.clamp(0.0, 1.0), 1.0 / 2.2) * 63.0).round() as u8 * 4;
        image::Rgb(ground(p * SIZE).to_array().map(code))
    });
    crate::glb::png(&image::DynamicImage::from(image))
}

fn mesh(meadow: bool) -> Mesh {
    let mut mesh = Mesh::default();
    let step = SIZE / f64::from(SQUARES);
    let mut index = vec![u32::MAX; ((SQUARES + 1) * (SQUARES + 1)) as usize];
    let mut vertex = |mesh: &mut Mesh, i: u32, j: u32| {
        let slot = &mut index[(j * (SQUARES + 1) + i) as usize];
        if *slot == u32::MAX {
            let share = DVec2::new(f64::from(i), f64::from(j)) / f64::from(SQUARES);
            let p = (share - 0.5) * SIZE;
            *slot = mesh.positions.len() as u32;
            mesh.positions.push(DVec3::new(p.x, height(p), p.y));
            mesh.normals.push(normal(p));
            mesh.uvs.push(share);
        }
        *slot
    };
    for j in 0..SQUARES {
        for i in 0..SQUARES {
            let block = DVec2::new(f64::from(i / BLOCK), f64::from(j / BLOCK)) + 0.5;
            if (open(block * step * f64::from(BLOCK) - SIZE / 2.0) > 0.0) != meadow {
                continue;
            }
            let [a, b, c, d] = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| vertex(&mut mesh, i + x, j + y));
            mesh.triangles.extend([[a, c, d], [a, d, b]]);
        }
    }
    mesh
}

/// A node's rotation that turns −z towards `dir`, +y up.
fn rotation(dir: DVec3) -> Value {
    let back = -dir.normalize();
    let right = DVec3::Y.cross(back).normalize();
    json!(DQuat::from_mat3(&DMat3::from_cols(right, back.cross(right), back)).to_array())
}

/// `terrain.glb`.
pub fn valley() -> Vec<u8> {
    let mut glb = Glb::new();
    let texture = glb.texture("ground", &texture(), json!({"wrapS": 33071, "wrapT": 33071}));
    let mut primitives = Vec::new();
    for (name, meadow) in [("forest", false), ("meadow", true)] {
        let surface = json!({"baseColorTexture": {"index": texture}, "metallicFactor": 0.0, "roughnessFactor": 1.0});
        let material = glb.push("materials", json!({"name": name, "pbrMetallicRoughness": surface}));
        primitives.push(glb.primitive(&mesh(meadow), material));
    }
    let mesh = glb.push("meshes", json!({"name": "valley", "primitives": primitives}));
    glb.node(json!({"name": "valley", "mesh": mesh}));
    for (name, from, above, to, above_to, yfov) in [
        ("near", DVec2::new(33.0, 84.0), 2.4, DVec2::new(6.0, -10.0), 6.0, 55.0),
        ("far", DVec2::new(20.0, 152.0), 42.0, DVec2::new(4.0, -60.0), 0.0, 42.0),
    ] {
        let eye = DVec3::new(from.x, height(from) + above, from.y);
        let target = DVec3::new(to.x, height(to) + above_to, to.y);
        let view = json!({"yfov": yfov * PI / 180.0, "znear": 0.1, "zfar": 2000.0});
        let camera = glb.push("cameras", json!({"name": name, "type": "perspective", "perspective": view}));
        let rotation = rotation(target - eye);
        glb.node(json!({"name": name, "camera": camera, "translation": eye.to_array(), "rotation": rotation}));
    }
    let sun = json!({"name": "sun", "type": "directional", "color": [1.0, 0.93, 0.82], "intensity": 3.4});
    glb.set("extensions", json!({"KHR_lights_punctual": {"lights": [sun]}}));
    glb.set("extensionsUsed", json!(["KHR_lights_punctual"]));
    let shines = json!({"KHR_lights_punctual": {"light": 0}});
    glb.node(json!({"name": "sun", "rotation": rotation(DVec3::new(0.75, -0.62, -0.42)), "extensions": shines}));
    glb.finish()
}
