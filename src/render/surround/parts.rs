//! All directions in parts of about the same size, in rings about the vertical.

use std::f64::consts::TAU;

use super::harmonics::Harmonics;
use crate::geom::{DVec3, Vec3};

/// A part of the directions.
#[derive(Debug, Clone)]
pub struct Part {
    /// Unit: its middle.
    pub axis: DVec3,
    /// What a cone as large as the part grows by in a unit of length.
    pub growth: f64,
    /// Rays to look for meshes by, spread over it; unit.
    pub rays: Vec<DVec3>,
    /// Rays for a part that a mesh hides in part: a lattice, which an edge parts at any of its places, however it runs.
    pub more: Vec<DVec3>,
    /// The parts beside it that are on its side of the horizon, where the edge of what hides it goes on.
    pub beside: Vec<usize>,
    /// The light that comes from it.
    pub light: Harmonics,
}

/// Rings: sine of the elevation from and to, parts, rays a part. Most are where land and trees hide the sky.
const RINGS: [(f64, f64, usize, usize); 6] =
    [(-1.0, -0.5, 3, 1), (-0.5, 0.0, 5, 1), (0.0, 0.2, 7, 2), (0.2, 0.45, 7, 2), (0.45, 0.75, 6, 1), (0.75, 1.0, 4, 1)];

/// Rays of a part that is hidden in part, and the step of their lattice: each fifth of either side has one of them.
const MORE: usize = 5;
const STEP: usize = 2;
/// Least cosine between the middles of parts that are beside one another, of those above the horizon; below it, parts are larger and
/// few, and mostly ground.
const BESIDE: f64 = 0.68;

/// Number of parts.
pub const PARTS: usize = 32;

/// The share of each part's light that arrives.
pub type Shares = [f32; PARTS];

/// Numbers of [`Harmonics`], and one more: whole vectors of four.
const NUMBERS: usize = 28;

/// All parts.
#[derive(Default)]
pub struct Parts {
    pub list: Vec<Part>,
    /// The parts' axes: all x, all y, all z.
    pub axes: [Shares; 3],
    /// Their light, as one list of numbers each.
    lights: Vec<[f32; NUMBERS]>,
}

impl Parts {
    /// The parts, lit by `radiance`.
    pub fn new(radiance: impl Fn(DVec3) -> DVec3) -> Parts {
        let list = parts(radiance);
        let axes = [0, 1, 2].map(|a| std::array::from_fn(|k| list.get(k).map_or(0.0, |part| part.axis[a] as f32)));
        let lights = list.iter().map(|part| std::array::from_fn(|i| part.light.0.get(i / 3).map_or(0.0, |c| c[i % 3])));
        let lights = lights.collect();
        Parts { list, axes, lights }
    }

    /// The light of which these shares arrive.
    pub fn light(&self, shares: &Shares) -> Harmonics {
        let mut sum = [0.0; NUMBERS];
        for (share, light) in shares.iter().zip(&self.lights) {
            for (s, l) in sum.iter_mut().zip(light) {
                *s += share * l;
            }
        }
        Harmonics(std::array::from_fn(|k| Vec3::new(sum[3 * k], sum[3 * k + 1], sum[3 * k + 2])))
    }
}

fn parts(radiance: impl Fn(DVec3) -> DVec3) -> Vec<Part> {
    let mut all = Vec::new();
    for (low, high, count, rays) in RINGS {
        for k in 0..count {
            // Neighbouring rings are turned against each other.
            let turn = |at: f64| TAU * (k as f64 + at + 0.5 * (count % 2) as f64) / count as f64;
            let at = |up: f64, around: f64| {
                let y: f64 = low + (high - low) * up;
                let (sin, cos) = libm::sincos(turn(around));
                let level = (1.0 - y * y).max(0.0).sqrt();
                DVec3::new(level * cos, y, level * sin)
            };
            let size = TAU * (high - low) / count as f64;
            const N: usize = 12;
            let spread = (0..N * N).map(|i| at(((i / N) as f64 + 0.5) / N as f64, ((i % N) as f64 + 0.5) / N as f64));
            let light = spread.map(|dir| Harmonics::from_direction(dir, radiance(dir) * (size / (N * N) as f64))).sum();
            let rays = (0..rays).map(|i| at(0.5, (i as f64 + 0.5) / rays as f64)).collect();
            let more = (0..MORE).map(|i| [i, STEP * i % MORE].map(|n| (n as f64 + 0.5) / MORE as f64));
            let more = more.map(|[up, around]| at(up, around)).collect();
            all.push(Part { axis: at(0.5, 0.5), growth: size.sqrt(), rays, more, beside: Vec::new(), light });
        }
    }
    let axes: Vec<DVec3> = all.iter().map(|part| part.axis).collect();
    for (part, axis) in all.iter_mut().zip(&axes) {
        let is_beside = |other: &DVec3| other != axis && other.dot(*axis) > BESIDE && (other.y > 0.0) == (axis.y > 0.0);
        part.beside = (0..axes.len()).filter(|&n| is_beside(&axes[n])).collect();
    }
    all
}
