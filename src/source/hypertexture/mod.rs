//! Hypertextures: a shape whose surface, or the soft layer around it, is formed by noise.
//!
//! Based on: K. Perlin, E. Hoffert, *Hypertexture*, SIGGRAPH 1989 (density modulated by noise, turbulence, bias and gain).

mod soft;
mod spec;

pub use soft::HypertextureSource;
pub use spec::{Bounds, ColourBy, HypertextureSpec, Mode, NoiseKind, Preset};

use super::field::{Field, build, central_difference};
use super::noise::Noise;
use super::traits::Source;
use crate::Result;
use crate::geom::{Aabb, DVec3};
use spec::Resolved;

/// A shape formed by noise: as a field, its hard surface; with a density, soft matter.
pub struct Hypertexture {
    base: Box<dyn Field>,
    noise: Noise,
    set: Resolved,
}

/// The way down, which melting matter flows.
const DOWN: DVec3 = DVec3::NEG_Y;

impl Hypertexture {
    /// # Errors
    /// [`crate::Error::Options`] on numbers out of range, and where the base is not a shape.
    pub fn new(spec: &HypertextureSpec) -> Result<Hypertexture> {
        let base = build(&spec.base)?;
        let (set, noise) = spec.resolve(base.bounds())?;
        Ok(Hypertexture { base, noise, set })
    }

    /// As a source: hard where no density is given.
    ///
    /// # Errors
    /// As [`Hypertexture::new`], and [`crate::Error::Options`] where the shape has no end and no bounds are given.
    pub fn source(spec: &HypertextureSpec) -> Result<Box<dyn Source>> {
        let texture = Hypertexture::new(spec)?;
        let (window, repeats) = (texture.set.window, texture.set.cyclic);
        if texture.set.density > 0.0 {
            return Ok(Box::new(HypertextureSource::new(texture, window, repeats)?));
        }
        Ok(Box::new(super::field::FieldSource::new(Box::new(texture), window)?.repeating(repeats)))
    }

    /// The shaped noise in [0, 1] at `p`, with its gradient.
    fn shaped(&self, p: DVec3) -> (f64, DVec3) {
        let (n, slope) = self.noise.at(p);
        let (n, d) = self.unit(n);
        let (b, db) = self.set.bias.at(n);
        let (g, dg) = self.set.gain.at(b);
        (g, dg * db * d * slope)
    }

    /// The shaped noise alone, the same to the bit.
    fn formed(&self, p: DVec3) -> f64 {
        self.shape(self.noise.value(p))
    }

    /// Noise brought to [0, 1] and shaped.
    fn shape(&self, n: f64) -> f64 {
        self.set.gain.at(self.set.bias.at(self.unit(n).0).0).0
    }

    /// Noise in [0, 1], and what its derivative is multiplied by.
    fn unit(&self, n: f64) -> (f64, f64) {
        let (v, d) = if self.noise.turbulence { (n, 1.0) } else { (0.5 + 0.5 * n, 0.5) };
        if (0.0..=1.0).contains(&v) { (v, d) } else { (v.clamp(0.0, 1.0), 0.0) }
    }

    /// Bounds of the shaped noise in a box; bias and gain never fall.
    fn shaped_range(&self, b: &Aabb) -> (f64, f64) {
        let (low, high) = self.noise.range(b.centre(), 0.5 * b.size().length());
        (self.shape(low), self.shape(high))
    }

    /// The point of the base's surface below `p`, and how far above it `p` is.
    fn foot(&self, p: DVec3) -> (DVec3, f64) {
        let height = self.base.value(p);
        (p - height * self.base.gradient(p).normalize_or_zero(), height)
    }

    /// The value from which on there is no matter.
    fn margin(&self) -> f64 {
        if self.set.density > 0.0 { 0.5 * self.set.softness } else { 0.0 }
    }

    /// Share of the full density where the value is `v`: falls from 1 to 0 over the softness.
    fn share(&self, v: f64) -> f64 {
        let t = (0.5 - v / self.set.softness).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }

    /// Number that decides the colour, in [0, 1]; `value` gives the value at `p`.
    fn tone(&self, p: DVec3, value: impl FnOnce() -> f64) -> f64 {
        match self.set.colour_by {
            ColourBy::Noise => self.formed(p),
            ColourBy::Depth => self.share(value()),
            ColourBy::Height => {
                let (_, height) = self.foot(p);
                if self.set.amplitude > 0.0 { (height / self.set.amplitude).clamp(0.0, 1.0) } else { 0.0 }
            }
            ColourBy::Bands => {
                // Perlin's marble: a wave that turbulence disturbs.
                let phase = (p - self.noise.origin).dot(self.set.bands) + self.set.disturbance * self.noise.value(p);
                0.5 + 0.5 * libm::sin(std::f64::consts::TAU * phase)
            }
        }
    }

    /// The colour at `p`, where `value` gives the value.
    fn colour_by(&self, p: DVec3, value: impl FnOnce() -> f64) -> Option<[f32; 3]> {
        let colours = &self.set.colours;
        let last = colours.len().checked_sub(1)?;
        let at = self.tone(p, value) * last as f64;
        let low = (at as usize).min(last);
        let share = (at - low as f64) as f32;
        let (u, v) = (colours[low], colours[(low + 1).min(last)]);
        Some(std::array::from_fn(|c| u[c] + share * (v[c] - u[c])))
    }
}

impl Field for Hypertexture {
    fn value(&self, p: DVec3) -> f64 {
        let a = self.set.amplitude;
        match self.set.mode {
            Mode::Paint => self.base.value(p),
            Mode::Displace => {
                let v = self.base.value(p);
                // Out of the noise's reach it is not asked for.
                if v > a + self.margin() { v - a } else { v - a * self.formed(p) }
            }
            Mode::Erode => {
                let v = self.base.value(p);
                if v > self.margin() { v } else { v + a * self.formed(p) }
            }
            Mode::Melt => self.base.value(p - DOWN * (a * self.formed(p))),
            Mode::Fur => {
                let (foot, height) = self.foot(p);
                let hairs = (0.0..=a + self.margin()).contains(&height);
                height - if hairs { a * self.formed(foot) } else { a }
            }
        }
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        self.value_and_gradient(p).1
    }

    fn value_and_gradient(&self, p: DVec3) -> (f64, DVec3) {
        let a = self.set.amplitude;
        match self.set.mode {
            Mode::Paint => self.base.value_and_gradient(p),
            Mode::Displace => {
                let (v, g) = self.base.value_and_gradient(p);
                // As far as the noise is asked for.
                if v > a + self.margin() {
                    return (v - a, g);
                }
                let (s, slope) = self.shaped(p);
                (v - a * s, g - a * slope)
            }
            Mode::Erode => {
                let (v, g) = self.base.value_and_gradient(p);
                if v > self.margin() {
                    return (v, g);
                }
                let (s, slope) = self.shaped(p);
                (v + a * s, g + a * slope)
            }
            Mode::Melt => {
                let (s, slope) = self.shaped(p);
                let (v, g) = self.base.value_and_gradient(p - DOWN * (a * s));
                (v, g - DOWN.dot(g) * a * slope)
            }
            Mode::Fur => {
                let (foot, height) = self.foot(p);
                let g = self.base.gradient(p);
                if !(0.0..=a + self.margin()).contains(&height) {
                    return (height - a, g);
                }
                let (s, slope) = self.shaped(foot);
                // The noise is asked for once; how its place moves with p is the base's alone, and cheap.
                let h = 1e-3 / self.noise.frequency.max_element();
                let slope = central_difference(|p| self.foot(p).0.dot(slope), p, h);
                (height - a * s, g - a * slope)
            }
        }
    }

    fn slope(&self) -> f64 {
        f64::INFINITY
    }

    fn range(&self, b: &Aabb) -> (f64, f64) {
        let a = self.set.amplitude;
        if self.set.mode == Mode::Melt {
            let (low, high) = self.shaped_range(b);
            let (u, v) = (-DOWN * (a * low), -DOWN * (a * high));
            return self.base.range(&Aabb::new(b.min + u.min(v), b.max + u.max(v)));
        }
        let (near, far) = self.base.range(b);
        match self.set.mode {
            Mode::Paint | Mode::Melt => (near, far),
            Mode::Displace if near > a + self.margin() || far < 0.0 => (near - a, far),
            Mode::Displace => {
                let (low, high) = self.shaped_range(b);
                // Where the noise is not asked for, the value is above the margin.
                let beyond = if far > a + self.margin() { self.margin() } else { f64::INFINITY };
                ((near - a * high).min(beyond), far - a * low)
            }
            Mode::Erode if near > self.margin() => (near, far),
            Mode::Erode if far < -a => (near, far + a),
            Mode::Erode => {
                let (low, high) = self.shaped_range(b);
                let beyond = if far > self.margin() { self.margin() } else { f64::INFINITY };
                ((near + a * low).min(beyond), far + a * high)
            }
            // At most the whole length of a hair.
            Mode::Fur => (near - a, if far < 0.0 { far - a } else { far }),
        }
    }

    fn bounds(&self) -> Aabb {
        self.bounds_of(0.0)
    }

    fn bounds_of(&self, level: f64) -> Aabb {
        let a = self.set.amplitude;
        match self.set.mode {
            Mode::Paint | Mode::Erode => self.base.bounds_of(level),
            Mode::Displace | Mode::Fur => self.base.bounds_of(level + a),
            Mode::Melt => {
                let b = self.base.bounds_of(level);
                if b.is_empty() { b } else { Aabb::new(b.min.min(b.min + a * DOWN), b.max) }
            }
        }
    }

    fn colour(&self, p: DVec3) -> Option<[f32; 3]> {
        self.colour_by(p, || self.value(p))
    }

    fn has_colour(&self) -> bool {
        !self.set.colours.is_empty()
    }
}

#[cfg(test)]
mod tests;
