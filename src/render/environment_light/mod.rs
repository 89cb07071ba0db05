//! Environment light: the radiance that reaches a scene from every direction, and aerial perspective, by which air between the eye
//! and things dims and brightens them.

mod harmonics;
mod panorama;
mod sectors;
mod sun;
#[cfg(test)]
mod tests;

use std::path::Path;

use super::air::{ClearSky, luminance};
use super::options::Ambient;
use crate::geom::{DVec3, Vec3};
use crate::{Error, Result};

pub use harmonics::{IrradianceHarmonics, moments_of_means, moments_of_normal};
pub use panorama::Panorama;
pub use sectors::{SECTORS, Sector, SectorVisibility, Sectors};
pub use sun::Sun;

/// Radiance by direction, linear Rec. 709.
pub struct EnvironmentLight {
    kind: Kind,
    /// Radiance that camera rays see in place of the environment.
    background: Option<Vec3>,
    /// The sun as camera rays see it.
    disc: Option<Disc>,
    /// Irradiance at a point that nothing hides from the environment.
    pub light: IrradianceHarmonics,
    /// All directions in sectors, each with the light that comes from it.
    pub sectors: Sectors,
    /// Optical depth of the air per unit of length, by channel; 0 without haze.
    haze: Vec3,
}

enum Kind {
    Constant(DVec3),
    Clear { sky: ClearSky, factor: f64 },
    Picture(Box<Panorama>),
}

/// A sun as a disc in the sky.
struct Disc {
    /// Unit direction to its middle.
    towards: DVec3,
    /// Half of its angular size, radians.
    radius: f64,
    radiance: DVec3,
}

impl Disc {
    /// The disc by which a sun brings its irradiance; `None` for a sun without a size.
    fn of(sun: &Sun) -> Option<Disc> {
        let area = std::f64::consts::PI * libm::sin(sun.radius).powi(2);
        (area > 0.0).then(|| Disc { towards: sun.towards, radius: sun.radius, radiance: sun.irradiance * (1.0 / area) })
    }
}

impl EnvironmentLight {
    fn new(kind: Kind) -> EnvironmentLight {
        let reduced = match &kind {
            Kind::Picture(panorama) => Some(panorama.reduced()),
            _ => None,
        };
        let mut light = EnvironmentLight {
            kind,
            background: None,
            disc: None,
            light: IrradianceHarmonics::default(),
            sectors: Sectors::default(),
            haze: Vec3::ZERO,
        };
        light.sectors = Sectors::new(|dir| {
            let reduced = reduced.as_ref().map(|panorama| panorama.radiance(dir));
            reduced.unwrap_or_else(|| light.radiance(dir)).as_dvec3()
        });
        light.light = match light.kind {
            Kind::Constant(radiance) => IrradianceHarmonics::constant(radiance.as_vec3()),
            _ => light.sectors.list.iter().map(|sector| sector.light).sum(),
        };
        light
    }

    /// The same radiance from all directions.
    pub fn constant(radiance: DVec3) -> EnvironmentLight {
        EnvironmentLight::new(Kind::Constant(radiance))
    }

    /// A clear sky that fits a sun: as bright, relative to it, as air of that turbidity makes it.
    pub fn clear(sun: &Sun, turbidity: f64) -> EnvironmentLight {
        let sky = ClearSky::new(sun.towards, turbidity);
        let factor = ClearSky::scale(sun.towards, turbidity, luminance(sun.irradiance));
        let mut light = EnvironmentLight::new(Kind::Clear { sky, factor });
        light.disc = Disc::of(sun);
        light
    }

    /// A picture of all directions, and the sun that was found in it, which is then no longer part of its light.
    ///
    /// # Errors
    /// As [`super::image_io::read`]; `Input` where the picture is not twice as wide as high, or a value is no radiance.
    pub fn picture(path: &Path) -> Result<(EnvironmentLight, Option<Sun>)> {
        let (panorama, sun) = Panorama::read(path)?;
        let mut light = EnvironmentLight::new(Kind::Picture(Box::new(panorama)));
        light.disc = sun.as_ref().and_then(Disc::of);
        Ok((light, sun))
    }

    /// Give camera rays that meet nothing this radiance; with `None` they see the environment itself.
    pub fn with_background(mut self, background: Option<DVec3>) -> EnvironmentLight {
        self.background = background.map(DVec3::as_vec3);
        self
    }

    /// Add haze in which dark things fade into the horizon: at `visibility` metres 2 % of their contrast are left (H.
    /// Koschmieder 1924). `unit` is the length of the renderer's unit in metres. Molecules scatter their known share of it, which
    /// is more in the blue.
    pub fn with_haze(mut self, visibility: Option<f64>, unit: f64) -> EnvironmentLight {
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

    /// Whether the ambient light at a point depends on its normals or on what hides the environment from it.
    pub fn is_directional(&self, ambient: Ambient) -> bool {
        ambient == Ambient::Occluded || !matches!(self.kind, Kind::Constant(_))
    }

    /// Radiance that lights the scene from a unit direction, without the sun, which is a light of its own.
    pub fn radiance(&self, dir: DVec3) -> Vec3 {
        match &self.kind {
            Kind::Constant(radiance) => radiance.as_vec3(),
            Kind::Clear { sky, factor } => (*factor * sky.radiance(dir)).as_vec3(),
            Kind::Picture(panorama) => panorama.radiance(dir),
        }
    }

    /// Radiance that a camera ray sees which meets nothing; `width` is the angle of its cone, radians.
    pub fn background_radiance(&self, dir: DVec3, width: f64) -> Vec3 {
        if let Some(background) = self.background {
            return background;
        }
        // Haze without an end hides the ground below the horizon.
        let hazy = self.haze != Vec3::ZERO;
        let mut radiance = self.radiance(if hazy { above_horizon(dir) } else { dir });
        if let Some(disc) = self.disc.as_ref().filter(|disc| disc.towards.dot(dir) > 0.0) {
            let angle = libm::asin(disc.towards.cross(dir).length().min(1.0));
            let cover = ((disc.radius - angle) / width.max(1e-6) + 0.5).clamp(0.0, 1.0);
            radiance += (cover * disc.radiance).as_vec3();
        }
        radiance
    }

    /// The transmittance of `distance` units of air, by channel, and the radiance that the air itself adds, which is as bright as the
    /// horizon in that direction. `None` without haze.
    pub fn aerial_perspective(&self, dir: DVec3, distance: f64) -> Option<(Vec3, Vec3)> {
        if self.haze == Vec3::ZERO {
            return None;
        }
        let through = (self.haze * distance as f32).to_array().map(|depth| libm::expf(-depth));
        let through = Vec3::from_array(through);
        let shine = self.background.unwrap_or_else(|| self.radiance(above_horizon(dir)));
        Some((through, (Vec3::ONE - through) * shine))
    }
}

/// `dir`, raised to just above the horizon if it leads lower. There the sky is as bright as an endless layer of air.
fn above_horizon(dir: DVec3) -> DVec3 {
    DVec3::new(dir.x, dir.y.max(0.02), dir.z).try_normalize().unwrap_or(DVec3::Y)
}

/// Whether the sun is high enough for a clear sky to be computed.
pub fn is_up(towards: DVec3) -> bool {
    towards.y > -0.02
}

/// Check that a turbidity is in range.
///
/// # Errors
/// `Options` where it is not.
pub fn check_turbidity(turbidity: f64) -> Result<()> {
    let range = super::air::TURBIDITY;
    if range.contains(&turbidity) {
        return Ok(());
    }
    let (least, most) = (range.start(), range.end());
    Err(Error::Options(format!("a turbidity of {turbidity}: it must be {least} (no haze) to {most} (very hazy)")))
}
