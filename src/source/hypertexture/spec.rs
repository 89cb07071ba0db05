//! Hypertextures as they are written in recipes: a preset, and what differs from it.

use serde::{Deserialize, Serialize};

use crate::error::short;
use crate::geom::{Aabb, DVec3};
use crate::source::field::{Colour, FieldSpec};
use crate::source::noise::{Bias, Gain, Noise};
use crate::{Error, Result};

/// A hypertexture. What is not given comes from the preset; lengths there are shares of the base's longest edge.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct HypertextureSpec {
    /// The shape that noise is added to.
    pub base: FieldSpec,
    /// Preset that gives the values which are not given.
    #[serde(default)]
    pub preset: Preset,
    /// Effect of the noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mode: Option<Mode>,
    /// Rule by which octaves of noise are summed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<NoiseKind>,
    /// Cells of the noise in a source unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency: Option<f64>,
    /// 1 … 10.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub octaves: Option<u32>,
    /// Reach of the noise, in source units: outward, inward for `erode`, down for `melt`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub amplitude: Option<f64>,
    /// Value that noise of 1/2 becomes, in (0, 1).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bias: Option<f64>,
    /// Contrast of the noise in (0, 1); 1/2 leaves it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gain: Option<f64>,
    /// Seed of the noise.
    #[serde(default)]
    pub seed: u32,
    /// Hits in a source unit where the matter is densest; 0: a hard surface, opaque within.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub density: Option<f64>,
    /// Width over which the density falls to nothing, in source units.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub softness: Option<f64>,
    /// A ramp of colours, evenly spaced.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colours: Option<Vec<Colour>>,
    /// Quantity that chooses from the ramp of colours.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colour_by: Option<ColourBy>,
    /// Box in which it is looked at, for bases without end; along cyclic axes, the box that repeats itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<Bounds>,
    /// Source axes along which the noise repeats itself with the width of `bounds`.
    #[serde(default)]
    pub cyclic: [bool; 3],
}

/// A box, in source units.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Bounds {
    /// Lower corner.
    pub min: [f64; 3],
    /// Upper corner.
    pub max: [f64; 3],
}

/// Preset that gives the values which are not given.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// A shape with a bumpy surface.
    #[default]
    Noise,
    /// Hairs along the normals.
    Fur,
    /// Soft matter that glows, turbulent.
    Fire,
    /// Coloured veins that run through a hard shape.
    Marble,
    /// Matter that runs down.
    Melt,
    /// Holes eaten into the shape.
    Eroded,
}

/// Effect of the noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// Moves the surface outward.
    Displace,
    /// Eats into the matter.
    Erode,
    /// Grows hairs along the normals.
    Fur,
    /// Lets matter flow down.
    Melt,
    /// Only colours.
    Paint,
}

/// Rule by which octaves of noise are summed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum NoiseKind {
    /// With their signs: smooth hills and valleys.
    Noise,
    /// By their magnitudes: creases, as in smoke and stone.
    Turbulence,
}

/// Quantity that chooses from the ramp of colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum ColourBy {
    /// The noise's own value.
    Noise,
    /// From the outside of soft matter to its core.
    Depth,
    /// From the base's surface to the amplitude above it.
    Height,
    /// Waves that the noise disturbs.
    Bands,
}

/// Everything filled in.
#[derive(Debug, Clone, PartialEq)]
pub struct Resolved {
    pub mode: Mode,
    pub amplitude: f64,
    pub bias: Bias,
    pub gain: Gain,
    pub density: f64,
    pub softness: f64,
    pub colours: Vec<[f32; 3]>,
    pub colour_by: ColourBy,
    /// Waves in a source unit, and waves that the noise shifts them by.
    pub bands: DVec3,
    pub disturbance: f64,
    pub window: Option<Aabb>,
    pub cyclic: [bool; 3],
}

/// A preset's values; lengths in the base's longest edge.
struct Defaults {
    mode: Mode,
    noise: NoiseKind,
    frequency: f64,
    octaves: u32,
    amplitude: f64,
    bias: f64,
    gain: f64,
    density: f64,
    softness: f64,
    colours: &'static [[f32; 3]],
    colour_by: ColourBy,
}

impl Preset {
    fn defaults(self) -> Defaults {
        let plain = Defaults {
            mode: Mode::Displace,
            noise: NoiseKind::Noise,
            frequency: 6.0,
            octaves: 4,
            amplitude: 0.15,
            bias: 0.5,
            gain: 0.5,
            density: 0.0,
            softness: 0.1,
            colours: &[],
            colour_by: ColourBy::Noise,
        };
        match self {
            Preset::Noise => plain,
            Preset::Fur => Defaults {
                mode: Mode::Fur,
                frequency: 48.0,
                octaves: 1,
                amplitude: 0.16,
                bias: 0.35,
                gain: 0.7,
                colours: &[[0.10, 0.05, 0.02], [0.55, 0.36, 0.18]],
                colour_by: ColourBy::Height,
                ..plain
            },
            Preset::Fire => Defaults {
                noise: NoiseKind::Turbulence,
                frequency: 3.0,
                octaves: 5,
                amplitude: 0.6,
                bias: 0.6,
                density: 14.0,
                softness: 0.35,
                colours: &[[0.35, 0.02, 0.0], [0.9, 0.18, 0.01], [1.0, 0.62, 0.06], [1.0, 0.95, 0.6]],
                colour_by: ColourBy::Depth,
                ..plain
            },
            Preset::Marble => Defaults {
                mode: Mode::Paint,
                noise: NoiseKind::Turbulence,
                frequency: 3.0,
                octaves: 6,
                colours: &[[0.16, 0.17, 0.22], [0.72, 0.70, 0.68], [0.88, 0.87, 0.84]],
                colour_by: ColourBy::Bands,
                ..plain
            },
            Preset::Melt => Defaults {
                mode: Mode::Melt,
                frequency: 4.0,
                octaves: 2,
                amplitude: 0.5,
                bias: 0.4,
                gain: 0.75,
                colours: &[[0.55, 0.30, 0.10], [0.85, 0.70, 0.40]],
                ..plain
            },
            Preset::Eroded => Defaults {
                mode: Mode::Erode,
                frequency: 5.0,
                octaves: 5,
                amplitude: 0.6,
                bias: 0.45,
                gain: 0.85,
                colours: &[[0.62, 0.52, 0.40], [0.25, 0.18, 0.13]],
                ..plain
            },
        }
    }
}

fn wrong(key: &str, what: impl std::fmt::Display) -> Error {
    Error::Options(format!("{key}: {what}"))
}

impl HypertextureSpec {
    /// Everything filled in, for a base of the box `base`; and the noise.
    ///
    /// # Errors
    /// [`Error::Options`] on numbers out of range, and cyclic axes without bounds.
    pub(super) fn resolve(&self, base: Aabb) -> Result<(Resolved, Noise)> {
        let window = self.window()?;
        let seen = window.map_or(base, |w| w.intersection(base));
        let size = if seen.is_empty() { 0.0 } else { seen.size().max_element() };
        if size.is_nan() || size <= 0.0 || !size.is_finite() {
            return Err(wrong(
                "base",
                "the shape has no end, or is not within bounds: give bounds around a part of it",
            ));
        }
        let d = self.preset.defaults();
        let within = |key: &str, given: Option<f64>, default: f64, low: f64, high: f64| {
            let v = given.unwrap_or(default);
            let fits = v >= low && v <= high;
            if fits { Ok(v) } else { Err(wrong(key, format!("{}: from {low} to {high}", short(v)))) }
        };
        let octaves = self.octaves.unwrap_or(d.octaves);
        if !(1..=10).contains(&octaves) {
            return Err(wrong("octaves", format!("{octaves}: from 1 to 10")));
        }
        let frequency = within("frequency", self.frequency, d.frequency / size, 1e-9 / size, 1e6 / size)?;
        let mut noise = Noise {
            seed: self.seed,
            frequency: DVec3::splat(frequency),
            origin: seen.min,
            period: [0; 3],
            octaves,
            turbulence: self.noise.unwrap_or(d.noise) == NoiseKind::Turbulence,
        };
        let mut bands = DVec3::new(frequency, 0.5 * frequency, 0.0);
        self.repeat(window, &mut noise, &mut bands)?;
        let colours = match &self.colours {
            Some(list) => list.iter().map(Colour::linear).collect::<Result<_>>()?,
            None => d.colours.to_vec(),
        };
        let set = Resolved {
            mode: self.mode.unwrap_or(d.mode),
            amplitude: within("amplitude", self.amplitude, d.amplitude * size, 0.0, 100.0 * size)?,
            bias: Bias::new(within("bias", self.bias, d.bias, 0.001, 0.999)?),
            gain: Gain::new(within("gain", self.gain, d.gain, 0.001, 0.999)?),
            density: within("density", self.density, d.density / size, 0.0, 1e9 / size)?,
            softness: within("softness", self.softness, d.softness * size, 1e-9 * size, 100.0 * size)?,
            colours,
            colour_by: self.colour_by.unwrap_or(d.colour_by),
            bands,
            disturbance: 2.0,
            window,
            cyclic: self.cyclic,
        };
        Ok((set, noise))
    }

    /// The box of `bounds`.
    fn window(&self) -> Result<Option<Aabb>> {
        let window = self.bounds.map(|b| Aabb::new(b.min.into(), b.max.into()));
        if window.is_some_and(|w| !(w.min.is_finite() && w.max.is_finite() && w.min.cmplt(w.max).all())) {
            return Err(wrong("bounds", "min is below max along every axis, and both are finite"));
        }
        Ok(window)
    }

    /// Change noise and bands so that along cyclic axes they repeat themselves with the width of the window.
    fn repeat(&self, window: Option<Aabb>, noise: &mut Noise, bands: &mut DVec3) -> Result<()> {
        for axis in (0..3).filter(|&a| self.cyclic[a]) {
            let Some(window) = window else {
                return Err(wrong("cyclic", "give bounds: their width is what repeats itself"));
            };
            let width = window.size()[axis];
            let cells = (noise.frequency[axis] * width).round().max(1.0);
            noise.frequency[axis] = cells / width;
            noise.origin[axis] = window.min[axis];
            noise.period[axis] = cells as u32;
            bands[axis] = (bands[axis] * width).round() / width;
        }
        Ok(())
    }
}
