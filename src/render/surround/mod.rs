//! What surrounds a scene: the radiance that comes from every direction, and what air between the eye and things adds.

mod harmonics;
mod panorama;
mod parts;
mod sun;
#[cfg(test)]
mod tests;

use std::path::Path;

use super::air::{ClearSky, luminance};
use super::options::Ambient;
use crate::geom::{DVec3, Vec3};
use crate::{Error, Result};

pub use harmonics::{Harmonics, of_means, of_normal};
pub use panorama::Panorama;
pub use parts::{PARTS, Part, Parts, Shares};
pub use sun::Sun;

/// Radiance by direction, linear Rec. 709.
pub struct Surround {
    kind: Kind,
    /// What camera rays see in its place.
    background: Option<Vec3>,
    /// Of a clear sky: where the sun is seen as a disc.
    disc: Option<Disc>,
    /// As it lights what sees all of it.
    pub light: Harmonics,
    /// The directions in parts, each with the light that comes from it.
    pub parts: Parts,
    /// Optical depth of the air in a unit of length; 0: none.
    haze: Vec3,
}

enum Kind {
    Constant(DVec3),
    Clear { sky: ClearSky, factor: f64 },
    Picture(Box<Panorama>),
}

struct Disc {
    towards: DVec3,
    radius: f64,
    radiance: DVec3,
}

impl Surround {
    fn new(kind: Kind) -> Surround {
        let reduced = match &kind {
            Kind::Picture(panorama) => Some(panorama.reduced()),
            _ => None,
        };
        let mut surround = Surround {
            kind,
            background: None,
            disc: None,
            light: Harmonics::default(),
            parts: Parts::default(),
            haze: Vec3::ZERO,
        };
        surround.parts = Parts::new(|dir| {
            let reduced = reduced.as_ref().map(|panorama| panorama.radiance(dir));
            reduced.unwrap_or_else(|| surround.radiance(dir)).as_dvec3()
        });
        surround.light = match surround.kind {
            Kind::Constant(radiance) => Harmonics::constant(radiance.as_vec3()),
            _ => surround.parts.list.iter().map(|part| part.light).sum(),
        };
        surround
    }

    /// The same from all sides.
    pub fn constant(radiance: DVec3) -> Surround {
        Surround::new(Kind::Constant(radiance))
    }

    /// A clear sky that fits a sun: as bright, relative to it, as air of that turbidity makes it.
    pub fn clear(sun: &Sun, turbidity: f64) -> Surround {
        let sky = ClearSky::new(sun.towards, turbidity);
        let factor = ClearSky::scale(sun.towards, turbidity, luminance(sun.irradiance));
        let mut surround = Surround::new(Kind::Clear { sky, factor });
        let area = std::f64::consts::PI * libm::sin(sun.radius).powi(2);
        if area > 0.0 {
            surround.disc =
                Some(Disc { towards: sun.towards, radius: sun.radius, radiance: sun.irradiance * (1.0 / area) });
        }
        surround
    }

    /// A picture of all directions, and the sun that was found in it, which is then no longer part of its light.
    ///
    /// # Errors
    /// As [`super::image_io::read`]; `Input` where the picture is not twice as wide as high, or a value is no radiance.
    pub fn picture(path: &Path) -> Result<(Surround, Option<Sun>)> {
        let (panorama, sun) = Panorama::read(path)?;
        let mut surround = Surround::new(Kind::Picture(Box::new(panorama)));
        if let Some(sun) = &sun {
            let area = std::f64::consts::PI * libm::sin(sun.radius).powi(2);
            surround.disc =
                Some(Disc { towards: sun.towards, radius: sun.radius, radiance: sun.irradiance * (1.0 / area) });
        }
        Ok((surround, sun))
    }

    /// What camera rays see where nothing is; `None`: what lights the scene.
    pub fn behind(mut self, background: Option<DVec3>) -> Surround {
        self.background = background.map(DVec3::as_vec3);
        self
    }

    /// Air in which dark things fade into the horizon: 2 % of their contrast are left at `visibility` metres (H.
    /// Koschmieder 1924). `unit`: metres in a unit of length. Molecules have their share of it, more in the blue.
    pub fn hazy(mut self, visibility: Option<f64>, unit: f64) -> Surround {
        if let Some(visibility) = visibility {
            // At 610, 550 and 465 nm, which the channels stand for.
            let molecules = DVec3::new(8.96e-6, 1.356e-5, 2.65e-5);
            let all = 3.912 / visibility;
            let aerosol = (all - molecules.y).max(0.0);
            // Ångström's exponent of continental haze, 1.1.
            let by_wavelength = DVec3::new(0.892, 1.0, 1.203);
            self.haze = ((molecules.min(DVec3::splat(all)) + aerosol * by_wavelength) * unit).as_vec3();
        }
        self
    }

    /// Whether light depends on normals or on what stands before it.
    pub fn is_directional(&self, ambient: Ambient) -> bool {
        ambient == Ambient::Occluded || !matches!(self.kind, Kind::Constant(_))
    }

    /// What lights the scene from a unit direction; the sun, which is a light of its own, left out.
    pub fn radiance(&self, dir: DVec3) -> Vec3 {
        match &self.kind {
            Kind::Constant(radiance) => radiance.as_vec3(),
            Kind::Clear { sky, factor } => (*factor * sky.radiance(dir)).as_vec3(),
            Kind::Picture(panorama) => panorama.radiance(dir),
        }
    }

    /// What a camera ray sees that meets nothing, `width` radians wide.
    pub fn seen(&self, dir: DVec3, width: f64) -> Vec3 {
        if let Some(background) = self.background {
            return background;
        }
        // Behind haze without an end there is no ground.
        let hazy = self.haze != Vec3::ZERO;
        let mut radiance = self.radiance(if hazy { above_horizon(dir) } else { dir });
        if let Some(disc) = self.disc.as_ref().filter(|disc| disc.towards.dot(dir) > 0.0) {
            let angle = libm::asin(disc.towards.cross(dir).length().min(1.0));
            let cover = ((disc.radius - angle) / width.max(1e-6) + 0.5).clamp(0.0, 1.0);
            radiance += (cover * disc.radiance).as_vec3();
        }
        radiance
    }

    /// What comes through `distance` of the air, and what the air adds: it is as bright as the horizon in that direction.
    pub fn air(&self, dir: DVec3, distance: f64) -> Option<(Vec3, Vec3)> {
        if self.haze == Vec3::ZERO {
            return None;
        }
        let through = (self.haze * distance as f32).to_array().map(|depth| libm::expf(-depth));
        let through = Vec3::from_array(through);
        let shine = self.background.unwrap_or_else(|| self.radiance(above_horizon(dir)));
        Some((through, (Vec3::ONE - through) * shine))
    }
}

/// The direction, or above the horizon where it leads below: there the sky is as bright as air without an end.
fn above_horizon(dir: DVec3) -> DVec3 {
    DVec3::new(dir.x, dir.y.max(0.02), dir.z).try_normalize().unwrap_or(DVec3::Y)
}

/// Whether a sun is so high that a clear sky fits it.
pub fn is_up(towards: DVec3) -> bool {
    towards.y > -0.02
}

/// Turbidity and what is wrong with it.
pub fn check_turbidity(turbidity: f64) -> Result<()> {
    let range = super::air::TURBIDITY;
    if range.contains(&turbidity) {
        return Ok(());
    }
    let (least, most) = (range.start(), range.end());
    Err(Error::Options(format!("a turbidity of {turbidity}: it must be {least} (no haze) to {most} (very hazy)")))
}
