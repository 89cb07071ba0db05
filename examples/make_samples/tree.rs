//! A broad-leaved tree: four orders of branches and leaves on the last.
//! Based on: Weber & Penn, Creation and Rendering of Realistic Trees, 1995 (parameters by order); Shinozaki et al.,
//! A Quantitative Analysis of Plant Form: the Pipe Model Theory, 1964 (radii).

use glam::{DQuat, DVec2, DVec3};
use serde_json::json;
use std::f64::consts::TAU;

use crate::glb::{Glb, Mesh};
use crate::leaf::{self, Place, Shape};
use crate::random::{Random, noise, turn};
use crate::tube::{self, Ring};

/// The angle between successive organs in a spiral, radians.
const GOLDEN: f64 = 2.399_963_229_728_653;
/// Leaves of a twig, and the radius that one leaf asks for, metres.
const LEAVES: u32 = 7;
const LEAF_PIPE: f64 = 0.0034;
/// Pipes add up by this power of the radius.
const PIPE_POWER: f64 = 2.25;

struct Stem {
    points: Vec<DVec3>,
    /// Children with the node (index into `points`) that they leave from.
    children: Vec<(usize, Stem)>,
    /// Leaves that hang on each node.
    leaves: Vec<f64>,
    order: usize,
}

/// How stems of one order grow.
struct Level {
    segments: usize,
    sides: u32,
    /// Children a metre, and the share of the stem below the first.
    density: f64,
    bare: f64,
    /// Angle between a child and this stem at the bottom and at the top, radians.
    angle: (f64, f64),
    /// Random bend and turn towards the light, a segment.
    wobble: f64,
    rise: f64,
}

const LEVELS: [Level; 4] = [
    Level { segments: 18, sides: 14, density: 6.4, bare: 0.24, angle: (1.5, 0.62), wobble: 0.06, rise: 0.03 },
    Level { segments: 9, sides: 6, density: 2.75, bare: 0.22, angle: (0.95, 0.7), wobble: 0.11, rise: 0.045 },
    Level { segments: 3, sides: 4, density: 3.9, bare: 0.12, angle: (0.95, 0.65), wobble: 0.17, rise: 0.05 },
    Level { segments: 1, sides: 3, density: 0.0, bare: 0.0, angle: (0.0, 0.0), wobble: 0.2, rise: 0.04 },
];

struct Grower {
    random: Random,
    leaves: Vec<Place>,
}

/// Half the crown's width at the share `s` of the tree's height, metres.
fn crown(s: f64) -> f64 {
    let bottom = 0.16;
    let x = ((s - bottom) / (0.93 - bottom)).clamp(0.0, 1.0);
    // Widest below the middle, round above, open below.
    3.9 * libm::sqrt((1.0 - libm::pow(x, 2.2)).max(0.0)) * (0.55 + 0.45 * libm::sqrt((x / 0.3).min(1.0)))
}

/// Height of the tree, metres.
const HEIGHT: f64 = 10.0;

impl Grower {
    fn stem(&mut self, order: usize, start: DVec3, direction: DVec3, length: f64) -> Stem {
        let level = &LEVELS[order];
        let (mut at, mut dir) = (start, direction.normalize());
        let mut points = vec![at];
        let step = length / level.segments as f64;
        for i in 0..level.segments {
            // Low boughs sag first and rise towards their tips.
            let s = (i as f64 + 0.5) / level.segments as f64;
            let rise = level.rise * if order == 1 { 2.6 * s - 0.5 } else { 1.0 };
            dir = (dir + self.random.ball() * level.wobble + DVec3::Y * rise).normalize();
            at += dir * step;
            points.push(at);
        }
        let mut stem = Stem { leaves: vec![0.0; points.len()], points, children: Vec::new(), order };
        if order + 1 < LEVELS.len() {
            self.branch(&mut stem, length);
        } else {
            self.leaf_spiral(&mut stem);
        }
        stem
    }

    fn branch(&mut self, stem: &mut Stem, length: f64) {
        let level = &LEVELS[stem.order];
        let n = (length * (1.0 - level.bare) * level.density).round().max(1.0) as usize;
        let mut azimuth = self.random.angle();
        for i in 0..n {
            let s = level.bare + (1.0 - level.bare) * (i as f64 + self.random.unit()) / n as f64;
            azimuth += GOLDEN + self.random.around(0.0, 0.3);
            let (node, at, axis) = along(&stem.points, s);
            let open = level.angle.0 + (level.angle.1 - level.angle.0) * s + self.random.around(0.0, 0.14);
            let reference = if stem.order == 0 { DVec3::X } else { DVec3::Y };
            let side = (reference - axis * reference.dot(axis)).normalize();
            let (sin, cos) = turn(azimuth);
            let mut out = side * cos + axis.cross(side) * sin;
            if stem.order > 0 {
                // Boughs spread their branches like a hand: sideways more than up and down.
                out = (out * DVec3::new(1.0, 0.45, 1.0)).normalize();
            }
            let (sin, cos) = turn(open);
            let direction = axis * cos + out * sin;
            let length = match stem.order {
                0 => {
                    let lobes = 1.0 + 0.2 * noise(DVec2::new(azimuth.rem_euclid(TAU) * 0.9, at.y * 0.55), 5);
                    crown((at.y + 0.6) / HEIGHT) * lobes * self.random.around(0.95, 0.1)
                }
                1 => (0.36 + 0.24 * length * (1.0 - s)) * self.random.around(1.1, 0.3),
                _ => self.random.around(0.34, 0.1),
            };
            let child = self.stem(stem.order + 1, at, direction, length);
            stem.children.push((node, child));
        }
        // A leader: the stem goes on as the next order.
        let last = stem.points.len() - 1;
        let (_, at, axis) = along(&stem.points, 1.0);
        let length = [0.7, 0.45, 0.3][stem.order];
        let leader = self.stem(stem.order + 1, at, axis, length);
        stem.children.push((last, leader));
    }

    fn leaf_spiral(&mut self, stem: &mut Stem) {
        let mut azimuth = self.random.angle();
        let mood = self.random.unit();
        for i in 0..LEAVES {
            let s = 0.25 + 0.75 * f64::from(i) / f64::from(LEAVES - 1);
            let (node, base, axis) = along(&stem.points, s);
            azimuth += GOLDEN;
            let side = axis.any_orthonormal_vector();
            let (sin, cos) = turn(azimuth);
            let spread = side * cos + axis.cross(side) * sin;
            let out = DVec3::new(base.x, 0.0, base.z) / 4.0;
            let droop = DVec3::Y * self.random.around(-0.25, 0.25);
            let along = (axis * 0.55 + spread * 0.85 + droop + out * 0.2).normalize();
            let up = DVec3::Y + out * 0.5 + self.random.ball() * 0.5;
            self.leaves.push(Place {
                base,
                along,
                up: DQuat::from_axis_angle(along, self.random.around(0.0, 0.3)) * up,
                length: self.random.around(0.195, 0.04),
                stalk: self.random.around(0.055, 0.02),
                color: leaf_color(&mut self.random, mood, base),
            });
            stem.leaves[node] += 1.0;
        }
    }
}

/// The share `s` of a polyline: the node at or below it, the point there and the direction.
fn along(points: &[DVec3], s: f64) -> (usize, DVec3, DVec3) {
    let x = s.clamp(0.0, 1.0) * (points.len() - 1) as f64;
    let i = (x as usize).min(points.len() - 2);
    let axis = points[i + 1] - points[i];
    (i, points[i] + axis * (x - i as f64), axis.normalize())
}

/// Leaves differ by twig and by leaf; those inside and below are darker, young ones at the top yellower. Linear.
fn leaf_color(random: &mut Random, mood: f64, base: DVec3) -> DVec3 {
    let centre = DVec3::new(0.0, 5.6, 0.0);
    let outward = ((base - centre) / DVec3::new(4.2, 4.4, 4.2)).length().min(1.0);
    let light = (0.62 + 0.3 * outward + 0.1 * base.y / HEIGHT) * random.around(1.0, 0.16);
    let yellow = (0.5 * mood + 0.5 * random.unit()) * outward;
    DVec3::new(0.075, 0.175, 0.028).lerp(DVec3::new(0.17, 0.25, 0.03), 0.75 * yellow) * light
}

/// Add the stem and all that grows from it; the pipes that its base carries.
fn skin(stem: &Stem, parent_radius: Option<f64>, wood: &mut Mesh) -> f64 {
    let pipes = pipes(stem);
    let radii: Vec<f64> = pipes.iter().map(|p| LEAF_PIPE * libm::pow(p.max(0.6), 1.0 / PIPE_POWER)).collect();
    let last = stem.points.len() - 1;
    let mut rings = Vec::new();
    for (i, &centre) in stem.points.iter().enumerate() {
        // Smooth the steps that pipes make at every fork.
        let radius = (radii[i.saturating_sub(1)] + 2.0 * radii[i] + radii[(i + 1).min(last)]) / 4.0;
        if let (0, Some(parent)) = (i, parent_radius.filter(|_| stem.order < 3)) {
            // Starts inside its parent and widens into a collar where it leaves it.
            rings.push(Ring { centre, radius: (radius * 1.5).min(parent * 0.9) });
            let first = stem.points[1] - centre;
            let out = centre + first * (parent * 1.15 / first.length()).min(0.6);
            rings.push(Ring { centre: out, radius: (radius * 1.25).min(parent * 0.9) });
        } else if stem.order == 0 && i == 0 {
            for (height, flare) in [(0.0, 1.75), (0.1, 1.38), (0.28, 1.16)] {
                rings.push(Ring { centre: centre + DVec3::Y * height, radius: radius * flare });
            }
        } else {
            rings.push(Ring { centre, radius });
        }
    }
    let bark = DVec3::new(0.13, 0.098, 0.07).lerp(DVec3::new(0.12, 0.1, 0.05), stem.order as f64 / 3.0);
    let sides = LEVELS[stem.order].sides;
    if stem.order == 0 {
        // Root flares die away with height; higher up the trunk is slightly fluted.
        tube::add(wood, &rings, sides, bark, |angle, y| {
            let (wave, _) = turn(angle * 5.0 + 0.7);
            1.0 + wave * (0.16 * libm::exp(-y / 0.22) + 0.025)
        });
    } else {
        tube::add(wood, &rings, sides, bark, |_, _| 1.0);
    }
    for (node, child) in &stem.children {
        skin(child, Some(radii[*node]), wood);
    }
    pipes[0]
}

/// Leaves carried at or beyond each node of the stem.
fn pipes(stem: &Stem) -> Vec<f64> {
    let mut pipes = stem.leaves.clone();
    for (node, child) in &stem.children {
        pipes[*node] += self::pipes(child)[0];
    }
    for i in (0..pipes.len() - 1).rev() {
        pipes[i] += pipes[i + 1];
    }
    pipes
}

/// `tree.glb`.
pub fn broadleaf() -> Vec<u8> {
    let mut grower = Grower { random: Random::new(20), leaves: Vec::new() };
    let trunk = grower.stem(0, DVec3::ZERO, DVec3::new(0.03, 1.0, -0.02), HEIGHT * 0.74);
    let (mut wood, mut foliage) = (Mesh::default(), Mesh::default());
    skin(&trunk, None, &mut wood);
    let shape = Shape { outline: [(0.16, 0.33), (0.45, 0.36), (0.76, 0.19)], fold: 0.33, bend: 0.5 };
    for place in &grower.leaves {
        leaf::add(&mut foliage, &shape, place);
    }
    let mut glb = Glb::new();
    let surface = json!({"metallicFactor": 0.0, "roughnessFactor": 0.9});
    let bark = glb.push("materials", json!({"name": "bark", "pbrMetallicRoughness": surface}));
    let leaves = glb.push("materials", json!({"name": "leaf", "doubleSided": true, "pbrMetallicRoughness": surface}));
    let primitives = [glb.primitive(&wood, bark), glb.primitive(&foliage, leaves)];
    let mesh = glb.push("meshes", json!({"name": "tree", "primitives": primitives}));
    glb.node(json!({"name": "tree", "mesh": mesh}));
    glb.finish()
}
