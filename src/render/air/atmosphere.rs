//! Molecules, haze and ozone around a round earth: what they let through of the sun's light, and what they scatter.
//!
//! Based on: S. Hillaire, *A Scalable and Production Ready Sky and Atmosphere Rendering Technique*, EGSR 2020 (all
//! scattering of higher orders as one factor); E. Bruneton, F. Neyret, *Precomputed Atmospheric Scattering*, EGSR 2008 (the table of
//! transmittance); A. Preetham, P. Shirley, B. Smits, *A Practical Analytic Model for Daylight*, SIGGRAPH 1999 (turbidity).
//! With eight wavelengths, since three make sunsets too pink. Metres; radiance and irradiance per nanometre.

use std::f64::consts::PI;

use super::spectrum::{OZONE, SUN, Spectrum, WAVELENGTHS, decay};
use crate::geom::{DVec2, DVec3};

/// Radius of the earth, and of the upper end of the atmosphere, metres.
const GROUND_RADIUS: f64 = 6_360e3;
const TOP_RADIUS: f64 = 6_460e3;
/// Radius of the eye, which is 100 m above the sea, and the angle of its horizon below the horizontal, radians.
const EYE_RADIUS: f64 = GROUND_RADIUS + 100.0;
pub const HORIZON_DIP: f64 = 0.005_608;
/// Scale heights of molecules and of haze, metres: over each the density falls by a factor of e.
const RAYLEIGH_SCALE_HEIGHT: f64 = 8_000.0;
const HAZE_SCALE_HEIGHT: f64 = 1_200.0;
/// Single-scattering albedo of haze, and the mean cosine of its scattering angle.
const HAZE_ALBEDO: f64 = 0.93;
const HAZE_ASYMMETRY: f64 = 0.76;
/// Molecules of ozone over a square metre: 300 Dobson units; a tent from 10 to 40 km.
const OZONE_COLUMN: f64 = 300.0 * 2.687e20;
const OZONE_MIDDLE: f64 = 25_000.0;
const OZONE_REACH: f64 = 15_000.0;
/// Albedo of the ground.
const GROUND_ALBEDO: f64 = 0.2;
/// Half of the sun's angular size, radians, over which it sets gradually.
const SUN_RADIUS: f64 = 0.004_65;

/// How hazy the air may be: its optical depth over that of the molecules alone.
pub const TURBIDITY: std::ops::RangeInclusive<f64> = 1.0..=10.0;

/// Sizes of the tables: heights, and cosines of the zenith angle.
const HEIGHTS: usize = 32;
const COSINES: usize = 128;
const SCATTER_HEIGHTS: usize = 8;
const SCATTER_COSINES: usize = 32;

/// Air of one turbidity.
pub struct Atmosphere {
    /// Extinction coefficients per metre: of molecules and haze at the ground, of ozone in the middle of its layer.
    rayleigh: Spectrum,
    haze: Spectrum,
    ozone: Spectrum,
    /// Column densities from a height along a direction to the top, as metres of air at full density: molecules, haze, ozone.
    columns: Vec<DVec3>,
    /// Light that was scattered more than once, over the sun's.
    multiple_scattering: Vec<Spectrum>,
}

/// Relative densities at radius `r` of molecules and haze (1 at the ground) and of ozone (1 in the middle of its layer).
fn density(r: f64) -> DVec3 {
    let h = (r - GROUND_RADIUS).max(0.0);
    let ozone = (1.0 - (h - OZONE_MIDDLE).abs() / OZONE_REACH).max(0.0);
    let [molecules, haze] = decay([h / RAYLEIGH_SCALE_HEIGHT, h / HAZE_SCALE_HEIGHT]);
    DVec3::new(molecules, haze, ozone)
}

/// Distance from a point at radius `r`, along a direction whose zenith angle has the cosine `mu`, to the enclosing sphere of radius
/// `to`.
fn to_sphere(r: f64, mu: f64, to: f64) -> f64 {
    let square = (to * to - r * r * (1.0 - mu * mu)).max(0.0);
    -r * mu + square.sqrt()
}

/// Distance to the ground; `None` where the direction passes it.
fn to_ground(r: f64, mu: f64) -> Option<f64> {
    let square = GROUND_RADIUS * GROUND_RADIUS - r * r * (1.0 - mu * mu);
    (mu < 0.0 && square >= 0.0).then(|| (-r * mu - square.sqrt()).max(0.0))
}

/// Radius and cosine of the zenith angle after `t` metres along `mu` from `r`.
fn along(r: f64, mu: f64, t: f64) -> (f64, f64) {
    let there = (r * r + t * t + 2.0 * r * mu * t).sqrt();
    (there, (r * mu + t) / there)
}

/// Middles and lengths of `count` steps from 0 to `end`, shorter at first.
fn steps(end: f64, count: usize) -> impl Iterator<Item = (f64, f64)> {
    let edge = move |i: usize| end * (i as f64 / count as f64).powi(2);
    (0..count).map(move |i| (0.5 * (edge(i) + edge(i + 1)), edge(i + 1) - edge(i)))
}

impl Atmosphere {
    /// `turbidity` is brought into [`TURBIDITY`].
    pub fn new(turbidity: f64) -> Atmosphere {
        let mut air = Atmosphere::without_multiple_scattering(turbidity);
        air.multiple_scattering = (0..SCATTER_HEIGHTS * SCATTER_COSINES)
            .map(|i| {
                let (h, mu) = (i / SCATTER_COSINES, i % SCATTER_COSINES);
                let (h, mu) = (h as f64 / (SCATTER_HEIGHTS - 1) as f64, mu as f64 / (SCATTER_COSINES - 1) as f64);
                air.compute_multiple_scattering(GROUND_RADIUS + h * h * (TOP_RADIUS - GROUND_RADIUS), 2.0 * mu - 1.0)
            })
            .collect();
        air
    }

    /// The same, of which the sun's own light alone is asked.
    pub fn without_multiple_scattering(turbidity: f64) -> Atmosphere {
        let turbidity = turbidity.clamp(*TURBIDITY.start(), *TURBIDITY.end());
        // E. Bucholtz 1995, as one power.
        let rayleigh = |nm: f64| 1.24062e-6 * (nm / 1000.0).powi(-4);
        // Ångström's exponent of continental haze.
        let haze = |nm: f64| {
            (turbidity - 1.0) * rayleigh(550.0) * RAYLEIGH_SCALE_HEIGHT / HAZE_SCALE_HEIGHT
                * libm::pow(nm / 550.0, -1.1)
        };
        Atmosphere {
            rayleigh: Spectrum(WAVELENGTHS.map(rayleigh)),
            haze: Spectrum(WAVELENGTHS.map(haze)),
            ozone: Spectrum(OZONE.map(|area| area * OZONE_COLUMN / OZONE_REACH)),
            columns: columns(),
            multiple_scattering: Vec::new(),
        }
    }

    fn extinction(&self, density: DVec3) -> Spectrum {
        self.rayleigh * density.x + self.haze * density.y + self.ozone * density.z
    }

    /// Transmittance from the top of the atmosphere to radius `r` along `mu`, a direction that does not meet the ground.
    pub fn transmittance(&self, r: f64, mu: f64) -> Spectrum {
        let horizon = (TOP_RADIUS * TOP_RADIUS - GROUND_RADIUS * GROUND_RADIUS).sqrt();
        let rho = (r * r - GROUND_RADIUS * GROUND_RADIUS).max(0.0).sqrt();
        let (near, far) = (TOP_RADIUS - r, rho + horizon);
        let x = (to_sphere(r, mu, TOP_RADIUS) - near) / (far - near).max(1.0);
        let at = DVec2::new(x * (COSINES - 1) as f64, rho / horizon * (HEIGHTS - 1) as f64);
        self.extinction(bilinear(&self.columns, COSINES, at)).attenuation()
    }

    /// Share of the sun's light that reaches radius `r`; the middle of its disc is in the direction `mu`.
    fn sunlight(&self, r: f64, mu: f64) -> Spectrum {
        let sin = (GROUND_RADIUS / r).min(1.0);
        let horizon = -(1.0 - sin * sin).sqrt();
        let above = ((mu - horizon) / SUN_RADIUS * 0.5 + 0.5).clamp(0.0, 1.0);
        if above <= 0.0 {
            return Spectrum::default();
        }
        self.transmittance(r, mu.max(horizon)) * (above * above * (3.0 - 2.0 * above))
    }

    /// Irradiance by the sun on a surface that faces it, at the eye.
    pub fn sun(&self, sin_elevation: f64) -> Spectrum {
        SUN * self.sunlight(EYE_RADIUS, sin_elevation)
    }

    /// Radiance of the sky at the eye towards an elevation, the sun's disc left out; `cos` is that of the angle to the sun.
    /// Below the horizon, that of the ground: it reflects the sun and `sky`, the irradiance from above.
    pub fn radiance(&self, sin_elevation: f64, sin_sun: f64, cos: f64, sky: Spectrum) -> Spectrum {
        const STEPS: usize = 40;
        let phase = Phase { rayleigh: rayleigh_phase(cos), haze: haze_phase(cos) };
        let mut sum = Spectrum::default();
        let mut through = Spectrum::splat(1.0);
        let ground = to_ground(EYE_RADIUS, sin_elevation);
        let end = ground.unwrap_or_else(|| to_sphere(EYE_RADIUS, sin_elevation, TOP_RADIUS));
        for (t, length) in steps(end, STEPS) {
            let r = along(EYE_RADIUS, sin_elevation, t).0;
            // Cosine of the sun's zenith angle there: the sun's direction against the place's own up.
            let sun = (EYE_RADIUS * sin_sun + t * cos) / r;
            let (own, passed) = self.step(r, sun.clamp(-1.0, 1.0), length, &phase);
            sum += own * through;
            through = through * passed;
        }
        if let Some(t) = ground {
            let sun = (EYE_RADIUS * sin_sun + t * cos) / GROUND_RADIUS;
            let light = self.sunlight(GROUND_RADIUS, sun.clamp(-1.0, 1.0)) * sun.max(0.0) * SUN + sky;
            sum += light * through * (GROUND_ALBEDO / PI);
        }
        sum
    }

    /// Radiance that one step of the ray adds, and its transmittance.
    fn step(&self, r: f64, sun: f64, length: f64, phase: &Phase) -> (Spectrum, Spectrum) {
        let density = density(r);
        let (molecules, haze) = (self.rayleigh * density.x, self.haze * (density.y * HAZE_ALBEDO));
        let once = (molecules * phase.rayleigh + haze * phase.haze) * self.sunlight(r, sun);
        let multiple_scattering = (molecules + haze) * self.multiple_scattering(r, sun);
        let extinction = self.extinction(density);
        let passed = (extinction * length).attenuation();
        // The source term is taken as constant along the step, and extinction is integrated exactly.
        let share = Spectrum::from_fn(|k| (1.0 - passed.0[k]) / extinction.0[k].max(1e-30));
        ((once + multiple_scattering) * SUN * share, passed)
    }

    /// Radiance of what was scattered more than once at a place, alike in all directions, over the sun's irradiance.
    fn multiple_scattering(&self, r: f64, sun: f64) -> Spectrum {
        if self.multiple_scattering.is_empty() {
            return Spectrum::default();
        }
        let h = ((r - GROUND_RADIUS) / (TOP_RADIUS - GROUND_RADIUS)).clamp(0.0, 1.0).sqrt();
        let x = (0.5 * sun + 0.5) * (SCATTER_COSINES - 1) as f64;
        bilinear(&self.multiple_scattering, SCATTER_COSINES, DVec2::new(x, h * (SCATTER_HEIGHTS - 1) as f64))
    }

    /// The paper's Ψ: light scattered twice, and as the sum of a geometric series all that follows.
    fn compute_multiple_scattering(&self, r: f64, sun: f64) -> Spectrum {
        const POLAR: usize = 8;
        const AROUND: usize = 4;
        const STEPS: usize = 16;
        let (mut second, mut share) = (Spectrum::default(), Spectrum::default());
        let sun_across = (1.0 - sun * sun).max(0.0).sqrt();
        for i in 0..POLAR * AROUND {
            let mu = (2 * (i / AROUND) + 1) as f64 / POLAR as f64 - 1.0;
            let turn = PI * ((i % AROUND) as f64 + 0.5) / AROUND as f64;
            let cos = mu * sun + (1.0 - mu * mu).sqrt() * sun_across * libm::cos(turn);
            let ground = to_ground(r, mu);
            let end = ground.unwrap_or_else(|| to_sphere(r, mu, TOP_RADIUS));
            let mut through = Spectrum::splat(1.0);
            for (t, length) in steps(end, STEPS) {
                let (there, _) = along(r, mu, t);
                let density = density(there);
                let scatters = self.rayleigh * density.x + self.haze * (density.y * HAZE_ALBEDO);
                let extinction = self.extinction(density);
                let passed = (extinction * length).attenuation();
                let of_step = |k: usize| scatters.0[k] * (1.0 - passed.0[k]) / extinction.0[k].max(1e-30);
                let scattered = Spectrum::from_fn(of_step) * through;
                let sun = ((r * sun + t * cos) / there).clamp(-1.0, 1.0);
                second += self.sunlight(there, sun) * scattered * (0.25 / PI);
                share += scattered;
                through = through * passed;
            }
            if let Some(t) = ground {
                let sun = ((r * sun + t * cos) / GROUND_RADIUS).clamp(-1.0, 1.0);
                second += self.sunlight(GROUND_RADIUS, sun) * through * (sun.max(0.0) * GROUND_ALBEDO / PI);
            }
        }
        // Means over the directions.
        let count = (POLAR * AROUND) as f64;
        Spectrum::from_fn(|k| second.0[k] / count / (1.0 - share.0[k] / count).max(1e-3))
    }
}

/// Phase functions towards the eye, per steradian.
struct Phase {
    rayleigh: f64,
    haze: f64,
}

fn rayleigh_phase(cos: f64) -> f64 {
    3.0 / (16.0 * PI) * (1.0 + cos * cos)
}

/// W. Cornette, J. Shanks 1992.
fn haze_phase(cos: f64) -> f64 {
    let g = HAZE_ASYMMETRY;
    let around = 1.0 + g * g - 2.0 * g * cos;
    3.0 / (8.0 * PI) * (1.0 - g * g) * (1.0 + cos * cos) / ((2.0 + g * g) * around * around.sqrt())
}

/// The table of columns. Rows are heights, evenly by the distance to the horizon; within a row evenly by the distance to the
/// top, from straight up to the horizon.
fn columns() -> Vec<DVec3> {
    const STEPS: usize = 64;
    let horizon = (TOP_RADIUS * TOP_RADIUS - GROUND_RADIUS * GROUND_RADIUS).sqrt();
    (0..HEIGHTS * COSINES)
        .map(|i| {
            let (row, column) = (i / COSINES, i % COSINES);
            let rho = horizon * row as f64 / (HEIGHTS - 1) as f64;
            let r = (GROUND_RADIUS * GROUND_RADIUS + rho * rho).sqrt();
            let (near, far) = (TOP_RADIUS - r, rho + horizon);
            let end = near + (far - near) * column as f64 / (COSINES - 1) as f64;
            let mu = if end > 0.0 {
                ((TOP_RADIUS * TOP_RADIUS - r * r - end * end) / (2.0 * r * end)).clamp(-1.0, 1.0)
            } else {
                1.0
            };
            let at = |(t, length): (f64, f64)| length * density(along(r, mu, t).0);
            // Where the ray comes down to its lowest point first, from there to both ends.
            let lowest = (-r * mu).clamp(0.0, end);
            let back = steps(lowest, STEPS).map(|(t, length)| at((lowest - t, length)));
            let on = steps(end - lowest, STEPS).map(|(t, length)| at((lowest + t, length)));
            back.chain(on).sum()
        })
        .collect()
}

/// The table at a place in units of its cells.
fn bilinear<T: Copy + std::ops::Mul<f64, Output = T> + std::ops::Add<Output = T>>(
    table: &[T],
    columns: usize,
    at: DVec2,
) -> T {
    let most = DVec2::new((columns - 1) as f64, (table.len() / columns - 1) as f64);
    let at = at.clamp(DVec2::ZERO, most);
    let low = at.floor().min(most - 1.0);
    let (fx, fy) = (at.x - low.x, at.y - low.y);
    let i = low.y as usize * columns + low.x as usize;
    let row = |i: usize| table[i] * (1.0 - fx) + table[i + 1] * fx;
    row(i) * (1.0 - fy) + row(i + columns) * fy
}
