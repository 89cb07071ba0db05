//! The sphere of directions in 32 sectors of about the same solid angle, in rings around the vertical (as the sky patches of P.
//! Tregenza, *Subdivision of the Sky Hemisphere for Luminance Measurements*, 1987, but below the horizon too).

use std::f64::consts::TAU;

use super::harmonics::IrradianceHarmonics;
use crate::geom::{DVec3, Vec3};

/// A sector: the directions between two elevations and two azimuths.
#[derive(Debug, Clone)]
pub struct Sector {
    /// Unit direction of its middle.
    pub axis: DVec3,
    /// Growth of the width, per unit of length, of a cone that has the sector's solid angle.
    pub growth: f64,
    /// The few unit directions in which meshes are looked for first.
    pub rays: Vec<DVec3>,
    /// Unit directions for a sector that meshes hide partly: a lattice, so that an edge divides them in proportion, however it
    /// runs.
    pub more: Vec<DVec3>,
    /// Numbers of the neighbouring sectors on the same side of the horizon. Where their visibility differs from this sector's, the
    /// edge of what hides them runs between.
    pub neighbours: Vec<usize>,
    /// The light that comes from the sector.
    pub light: IrradianceHarmonics,
}

/// For each ring the sines of its lowest and highest elevation, its number of sectors, and the rays per sector. Sectors are
/// smallest where land and trees usually hide the sky.
const RINGS: [(f64, f64, usize, usize); 6] =
    [(-1.0, -0.5, 3, 1), (-0.5, 0.0, 5, 1), (0.0, 0.2, 7, 2), (0.2, 0.45, 7, 2), (0.45, 0.75, 6, 1), (0.75, 1.0, 4, 1)];

/// Number of [`Sector::more`], and the step of their lattice: each fifth of the sector, in either coordinate, holds one ray.
const MORE: usize = 5;
const STEP: usize = 2;
/// Least cosine between the middles of neighbouring sectors above the horizon. Below the horizon sectors are larger, and few of
/// them count as neighbours; they mostly see ground.
const MIN_NEIGHBOUR_COSINE: f64 = 0.68;

/// Number of sectors.
pub const SECTORS: usize = 32;

/// Visibility of each sector from a point: the share of its light that arrives, in [0, 1].
pub type SectorVisibility = [f32; SECTORS];

/// Numbers in [`IrradianceHarmonics`], padded by one to whole vectors of four.
const NUMBERS: usize = 28;

/// All sectors.
#[derive(Default)]
pub struct Sectors {
    pub list: Vec<Sector>,
    /// Axes of the sectors, one array per coordinate.
    pub axes: [[f32; SECTORS]; 3],
    /// The light of each sector as a flat list of numbers.
    lights: Vec<[f32; NUMBERS]>,
}

impl Sectors {
    /// The sectors, where `radiance` comes from each unit direction.
    pub fn new(radiance: impl Fn(DVec3) -> DVec3) -> Sectors {
        let list = sectors(radiance);
        let axes = [0, 1, 2].map(|a| std::array::from_fn(|k| list.get(k).map_or(0.0, |sector| sector.axis[a] as f32)));
        let lights =
            list.iter().map(|sector| std::array::from_fn(|i| sector.light.0.get(i / 3).map_or(0.0, |c| c[i % 3])));
        let lights = lights.collect();
        Sectors { list, axes, lights }
    }

    /// The light that arrives at a point which sees the sectors so.
    pub fn light(&self, visibility: &SectorVisibility) -> IrradianceHarmonics {
        let mut sum = [0.0; NUMBERS];
        for (share, light) in visibility.iter().zip(&self.lights) {
            for (s, l) in sum.iter_mut().zip(light) {
                *s += share * l;
            }
        }
        IrradianceHarmonics(std::array::from_fn(|k| Vec3::new(sum[3 * k], sum[3 * k + 1], sum[3 * k + 2])))
    }
}

fn sectors(radiance: impl Fn(DVec3) -> DVec3) -> Vec<Sector> {
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
            let light = spread
                .map(|dir| IrradianceHarmonics::from_direction(dir, radiance(dir) * (size / (N * N) as f64)))
                .sum();
            let rays = (0..rays).map(|i| at(0.5, (i as f64 + 0.5) / rays as f64)).collect();
            let more = (0..MORE).map(|i| [i, STEP * i % MORE].map(|n| (n as f64 + 0.5) / MORE as f64));
            let more = more.map(|[up, around]| at(up, around)).collect();
            all.push(Sector { axis: at(0.5, 0.5), growth: size.sqrt(), rays, more, neighbours: Vec::new(), light });
        }
    }
    let axes: Vec<DVec3> = all.iter().map(|sector| sector.axis).collect();
    for (sector, axis) in all.iter_mut().zip(&axes) {
        let is_neighbour = |other: &DVec3| {
            other != axis && other.dot(*axis) > MIN_NEIGHBOUR_COSINE && (other.y > 0.0) == (axis.y > 0.0)
        };
        sector.neighbours = (0..axes.len()).filter(|&n| is_neighbour(&axes[n])).collect();
    }
    all
}
