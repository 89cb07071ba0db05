//! A fern: a rosette of arching fronds, each an alpha-masked card.

use glam::{DVec2, DVec3};
use serde_json::json;

use crate::card::{self, Frond, Strip, Stroke};
use crate::glb::{Glb, Mesh};
use crate::random::{Random, turn};

/// Half the frond's width, in its length.
const HALF_WIDTH: f64 = 0.21;

fn frond() -> Frond {
    let mut strokes = Vec::new();
    let pairs = 30;
    for i in 0..pairs {
        let s = f64::from(i) / f64::from(pairs);
        let y = 0.1 + 0.89 * s;
        // Longest below the middle, shorter towards the base, to nothing at the tip.
        let length = 0.2 * libm::pow(1.0 - s, 0.85) * (0.45 + 0.55 * (s * 5.0).min(1.0)) + 0.006;
        let (rise, out) = turn(0.28 + 0.5 * s);
        for side in [-1.0, 1.0] {
            let green = DVec3::new(0.075, 0.2, 0.03).lerp(DVec3::new(0.13, 0.26, 0.04), s);
            strokes.push(Stroke {
                base: DVec2::new(0.0, y + 0.006 * side),
                along: DVec2::new(side * out, rise),
                length,
                half_width: 0.0125 * (0.5 + 0.5 * (1.0 - s)) + 0.002,
                teeth: (11.0, 0.42),
                color: green,
            });
        }
    }
    Frond { strokes, half_width: HALF_WIDTH, rachis: (0.0065, DVec3::new(0.16, 0.13, 0.05)) }
}

/// `fern.glb`.
pub fn fern() -> Vec<u8> {
    let mut random = Random::new(4);
    let mut mesh = Mesh::default();
    let count = 26;
    for i in 0..count {
        let young = f64::from(i) / f64::from(count);
        let (sin, cos) = turn(f64::from(i) * 2.399_963 + random.around(0.0, 0.2));
        let out = DVec3::new(cos, 0.0, sin);
        let length = random.around(0.86, 0.12) * (1.0 - 0.35 * young * young);
        let (mut elevation, droop) = (0.75 + 0.6 * young + random.around(0.0, 0.1), random.around(0.2, 0.05));
        let mut p = out * random.around(0.035, 0.02);
        let mut points = vec![p];
        for _ in 0..7 {
            let (up, forward) = turn(elevation);
            p += (out * forward + DVec3::Y * up) * length / 7.0;
            points.push(p.with_y(p.y.max(0.06)));
            elevation -= droop;
        }
        let tint = DVec3::new(1.0, 1.0, 1.0) * random.around(0.9, 0.1) * (0.85 + 0.15 * young);
        let side = DVec3::Y.cross(out) + random.ball() * 0.25;
        card::add(&mut mesh, &Strip { points: &points, side, half_width: HALF_WIDTH * length, fold: 0.22, tint });
    }
    let lowest = mesh.positions.iter().fold(f64::INFINITY, |y, p| y.min(p.y));
    mesh.positions.iter_mut().for_each(|p| p.y -= lowest);
    let mut glb = Glb::new();
    let texture = glb.texture("frond", &card::draw(&frond(), 256, 512), json!({"wrapS": 33071, "wrapT": 33071}));
    let material = json!({"name": "frond", "doubleSided": true, "alphaMode": "MASK", "alphaCutoff": 0.5,
        "pbrMetallicRoughness": {"baseColorTexture": {"index": texture}, "metallicFactor": 0.0, "roughnessFactor": 0.9}});
    let material = glb.push("materials", material);
    let primitive = glb.primitive(&mesh, material);
    let mesh = glb.push("meshes", json!({"name": "fern", "primitives": [primitive]}));
    glb.node(json!({"name": "fern", "mesh": mesh}));
    glb.finish()
}
