//! A spruce: a straight trunk, whorls of boughs, shoots as alpha-masked cards of needles.

use glam::{DVec2, DVec3};
use serde_json::json;

use crate::card::{self, Frond, Strip, Stroke};
use crate::glb::{Glb, Mesh};
use crate::random::{Random, turn};
use crate::tube::{self, Ring};

/// Half a shoot card's width, in its length.
const HALF_WIDTH: f64 = 0.2;
/// Height of the tree, metres.
const HEIGHT: f64 = 13.0;

/// A shoot: a twig with side twigs, all set with needles.
fn shoot() -> Frond {
    let mut random = Random::new(9);
    let mut strokes = Vec::new();
    let mut needles = |from: DVec2, along: DVec2, length: f64, count: u32| {
        for i in 0..count {
            let s = f64::from(i) / f64::from(count);
            let side = if i % 2 == 0 { 1.0 } else { -1.0 };
            let (sin, cos) = turn(side * random.around(0.85, 0.2));
            strokes.push(Stroke {
                base: from + along * length * s,
                along: DVec2::new(along.x * cos - along.y * sin, along.x * sin + along.y * cos),
                length: random.around(0.052, 0.01),
                half_width: 0.0042,
                teeth: (0.0, 0.0),
                color: DVec3::new(0.035, 0.085, 0.03).lerp(DVec3::new(0.075, 0.15, 0.035), random.unit()),
            });
        }
    };
    needles(DVec2::ZERO, DVec2::Y, 0.96, 150);
    for i in 0..9 {
        let s = f64::from(i) / 9.0;
        for side in [-1.0, 1.0] {
            let (cos, sin) = turn(0.8);
            let along = DVec2::new(side * sin, cos);
            needles(DVec2::new(0.0, 0.06 + 0.8 * s), along, 0.2 * (1.0 - 0.75 * s), 46 - 4 * i);
        }
    }
    Frond { strokes, half_width: HALF_WIDTH, rachis: (0.006, DVec3::new(0.11, 0.07, 0.04)) }
}

/// `spruce.glb`.
pub fn spruce() -> Vec<u8> {
    let mut random = Random::new(7);
    let (mut wood, mut green) = (Mesh::default(), Mesh::default());
    let bark = DVec3::new(0.12, 0.085, 0.06);
    let trunk_radius = |y: f64| 0.17 * (1.0 - y / HEIGHT) + 0.012 + 0.08 * libm::exp(-y / 0.3);
    let rings: Vec<Ring> = (0..=22)
        .map(|i| {
            let y = HEIGHT * 0.985 * libm::pow(f64::from(i) / 22.0, 1.2);
            Ring { centre: DVec3::Y * y, radius: trunk_radius(y) }
        })
        .collect();
    tube::add(&mut wood, &rings, 10, bark, |_, _| 1.0);
    let mut y = 0.9;
    while y < HEIGHT * 0.985 {
        let top = y / HEIGHT;
        let reach = (0.06 + 2.9 * libm::pow(1.0 - top, 0.85)) * (0.55 + 0.45 * (top / 0.14).min(1.0));
        let boughs = if top > 0.8 { 5 } else { 7 };
        let turned = random.angle();
        for b in 0..boughs {
            let azimuth =
                turned + std::f64::consts::TAU * (f64::from(b) + random.around(0.0, 0.25)) / f64::from(boughs);
            let (sin, cos) = turn(azimuth);
            let out = DVec3::new(cos, 0.0, sin);
            let length = reach * random.around(0.92, 0.18);
            // Old boughs hang and turn up at their ends; young ones stand.
            let mut elevation = 0.85 * top * top - 0.22 * (1.0 - top) + random.around(0.0, 0.08);
            let mut p = DVec3::Y * (y + random.around(0.0, 0.12));
            let steps = 5;
            let mut points = vec![p];
            for _ in 0..steps {
                let (up, forward) = turn(elevation);
                p += (out * forward + DVec3::Y * up) * length / f64::from(steps);
                points.push(p);
                elevation += 0.05 + 0.07 * (1.0 - top);
            }
            let rings: Vec<Ring> = points
                .iter()
                .enumerate()
                .map(|(i, &centre)| Ring { centre, radius: (0.008 + 0.011 * length) * (1.0 - 0.17 * i as f64) })
                .collect();
            tube::add(&mut wood, &rings, 4, bark, |_, _| 1.0);
            needle_cards(&mut green, &mut random, &points, out, length, top);
        }
        y += 0.42 * (1.12 - 0.35 * top);
    }
    let mut glb = Glb::new();
    let texture = glb.texture("shoot", &card::draw(&shoot(), 256, 512), json!({"wrapS": 33071, "wrapT": 33071}));
    let surface = json!({"metallicFactor": 0.0, "roughnessFactor": 0.9});
    let bark = glb.push("materials", json!({"name": "bark", "pbrMetallicRoughness": surface}));
    let mut surface = surface;
    surface["baseColorTexture"] = json!({"index": texture});
    let needles = glb.push(
        "materials",
        json!({"name": "needles", "doubleSided": true, "alphaMode": "MASK", "alphaCutoff": 0.5, "pbrMetallicRoughness": surface}),
    );
    let primitives = [glb.primitive(&wood, bark), glb.primitive(&green, needles)];
    let mesh = glb.push("meshes", json!({"name": "spruce", "primitives": primitives}));
    glb.node(json!({"name": "spruce", "mesh": mesh}));
    glb.finish()
}

/// Shoots to both sides of a bough and one at its end, each card curved a little and tilted at random.
fn needle_cards(green: &mut Mesh, random: &mut Random, points: &[DVec3], out: DVec3, length: f64, top: f64) {
    let count = (length * 6.5).ceil() as u32 + 2;
    for i in 0..count {
        let s = 0.14 + 0.86 * f64::from(i) / f64::from(count - 1);
        let x = s * (points.len() - 1) as f64;
        let k = (x as usize).min(points.len() - 2);
        let axis = (points[k + 1] - points[k]).normalize();
        let base = points[k].lerp(points[k + 1], x - k as f64);
        let sideways = DVec3::Y.cross(out) * if i % 2 == 0 { 1.0 } else { -1.0 };
        let last = i + 1 == count;
        let along = if last { axis } else { axis * 0.75 + sideways * 0.75 };
        let along = (along + random.ball() * 0.18 - DVec3::Y * 0.12 * (1.0 - top)).normalize();
        let reach = (0.16 + 0.2 * (1.0 - top) + 0.3 * (1.0 - s) * length.min(1.8)) * random.around(1.0, 0.2);
        let points = [0.0, 0.5, 1.0].map(|t| base + along * reach * t - DVec3::Y * 0.16 * reach * t * t);
        let tint = DVec3::ONE * random.around(0.88, 0.12) * (0.72 + 0.28 * s);
        for roll in [0.0, 1.25] {
            let flat = DVec3::Y.cross(along).normalize();
            let (sin, cos) = turn(roll + random.around(0.0, 0.3));
            let side = flat * cos + along.cross(flat) * sin;
            card::add(green, &Strip { points: &points, side, half_width: HALF_WIDTH * reach, fold: 0.12, tint });
        }
    }
}
