//! The clear sky over one place under one sun, as a table of directions.

use std::f64::consts::{FRAC_PI_2, PI};

use super::atmosphere::{Atmosphere, HORIZON_DIP};
use super::spectrum::{RgbWeights, Spectrum, luminance};
use crate::geom::DVec3;

/// Size of the table: columns of azimuth from the sun to the opposite side, and rows of elevation from the nadir to the zenith. Both are
/// denser near the sun and near the horizon. The sky is symmetric about the sun's meridian.
const AROUND: usize = 48;
const POLAR: usize = 96;

/// Radiance of a clear sky by direction, linear Rec. 709, +y up, without the sun's disc.
pub struct ClearSky {
    /// Unit horizontal direction towards the sun.
    towards: DVec3,
    table: Vec<DVec3>,
}

impl ClearSky {
    /// The sky of a sun in the unit direction `sun`. Luminances times 683 are cd / m².
    pub fn new(sun: DVec3, turbidity: f64) -> ClearSky {
        let air = Atmosphere::new(turbidity);
        let colours = RgbWeights::new();
        let sin_sun = sun.y.clamp(-1.0, 1.0);
        let across = (1.0 - sin_sun * sin_sun).sqrt();
        let radiance = |row: usize, column: usize, from_above: Spectrum| {
            let (elevation, azimuth) = (elevation(row as f64), PI * (column as f64 / (AROUND - 1) as f64).powi(2));
            let (sin, cos) = libm::sincos(elevation);
            let to_sun = (sin * sin_sun + cos * across * libm::cos(azimuth)).clamp(-1.0, 1.0);
            air.radiance(sin, sin_sun, to_sun, from_above)
        };
        // First what is above the horizon: it lights the ground below.
        let half = POLAR / 2;
        let above: Vec<Spectrum> =
            (0..half * AROUND).map(|i| radiance(half + i / AROUND, i % AROUND, Spectrum::default())).collect();
        let mut from_above = Spectrum::default();
        for (i, radiance) in above.iter().enumerate() {
            let (row, column) = (half + i / AROUND, i % AROUND);
            // Solid angle between the middles to the neighbours, on both sides of the meridian.
            let edge = |row: f64| libm::sin(elevation(row.clamp(half as f64 - 0.5, (POLAR - 1) as f64)));
            let (low, high) = (edge(row as f64 - 0.5), edge(row as f64 + 0.5));
            let turn = |c: f64| PI * (c.clamp(0.0, (AROUND - 1) as f64) / (AROUND - 1) as f64).powi(2);
            let wide = 2.0 * (turn(column as f64 + 0.5) - turn(column as f64 - 0.5));
            from_above += *radiance * (0.5 * (high * high - low * low) * wide);
        }
        let below = (0..half * AROUND).map(|i| radiance(i / AROUND, i % AROUND, from_above));
        let table: Vec<DVec3> = below.chain(above).map(|spectrum| colours.rgb(&spectrum)).collect();
        let towards = DVec3::new(sun.x, 0.0, sun.z).try_normalize().unwrap_or(DVec3::X);
        ClearSky { towards, table }
    }

    /// Irradiance of that sun on what faces it, without the sky; luminances times 683 are lux.
    pub fn sunlight(sun: DVec3, turbidity: f64) -> DVec3 {
        RgbWeights::new().rgb(&Atmosphere::without_multiple_scattering(turbidity).sun(sun.y.clamp(-1.0, 1.0)))
    }

    /// The factor of the sky at which the sun's irradiance has the luminance `wanted`. A sun below 2 degrees counts as if it stood at 2
    /// degrees, since its own light vanishes there while the sky's does not.
    pub fn scale(sun: DVec3, turbidity: f64, wanted: f64) -> f64 {
        const LEAST: f64 = 0.034_9;
        let found =
            luminance(RgbWeights::new().rgb(&Atmosphere::without_multiple_scattering(turbidity).sun(sun.y.max(LEAST))));
        wanted / found.max(1e-9)
    }

    /// Radiance from a unit direction.
    pub fn radiance(&self, dir: DVec3) -> DVec3 {
        let level = (dir.x * dir.x + dir.z * dir.z).sqrt();
        let cos = if level > 0.0 { (dir.dot(self.towards) / level).clamp(-1.0, 1.0) } else { 1.0 };
        let x = (libm::acos(cos) / PI).sqrt() * (AROUND - 1) as f64;
        let y = row(libm::atan2(dir.y, level)).clamp(0.0, (POLAR - 1) as f64);
        let (x0, y0) = ((x as usize).min(AROUND - 2), (y as usize).min(POLAR - 2));
        // Ground and sky meet at the horizon with an edge.
        let half = POLAR / 2;
        let y0 = if y0 == half - 1 { if y < half as f64 - 0.5 { half - 2 } else { half } } else { y0 };
        let (fx, fy) = ((x - x0 as f64).clamp(0.0, 1.0), (y - y0 as f64).clamp(-0.5, 1.5));
        let row = |y: usize| {
            let i = y * AROUND + x0;
            self.table[i] * (1.0 - fx) + self.table[i + 1] * fx
        };
        (row(y0) * (1.0 - fy) + row(y0 + 1) * fy).max(DVec3::ZERO)
    }
}

/// Elevation of a row; the level is halfway between the middle rows, and what is below starts at the horizon.
fn elevation(row: f64) -> f64 {
    let v = 2.0 * row / (POLAR - 1) as f64 - 1.0;
    let elevation = FRAC_PI_2 * v * v.abs();
    if v < 0.0 { elevation * (1.0 - HORIZON_DIP / FRAC_PI_2) - HORIZON_DIP } else { elevation }
}

/// The row of an elevation.
fn row(elevation: f64) -> f64 {
    let below = (elevation + HORIZON_DIP).min(0.0) / (1.0 - HORIZON_DIP / FRAC_PI_2);
    let elevation = if elevation > 0.0 { elevation } else { below };
    let v = (elevation.abs() / FRAC_PI_2).sqrt().copysign(elevation);
    (v + 1.0) * 0.5 * (POLAR - 1) as f64
}
