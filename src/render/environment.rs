//! The lights and the sky of a scene: the caller's choice, else the file's, else a clear sky that fits the sun.

use super::air::{ClearSky, luminance};
use super::environment_light::{EnvironmentLight, Sun, check_turbidity, is_up};
use super::light::{DEFAULT_SKY, PunctualLight, default_sun};
use super::options::{Options, SunPosition};
use crate::geom::DVec3;
use crate::scene::Scene;
use crate::scene::model::Light;
use crate::scene::shell::Sky;
use crate::{Error, Result};

/// Angular size of the sun, radians: .53 degrees.
pub const SUN_ANGLE: f64 = 0.009_25;
/// Turbidity of a clear day.
pub const DEFAULT_TURBIDITY: f64 = 2.5;

/// The lights and the environment light of a scene; a note about each choice that neither caller nor file made is added to `notes`. The
/// renderer's space is (world − eye) / unit.
///
/// # Errors
/// `Options` where a number is out of its range, or a clear sky has no sun; as [`EnvironmentLight::picture`].
pub fn lights_and_environment(
    scene: &Scene,
    options: &Options,
    eye: DVec3,
    unit: f64,
    notes: &mut Vec<String>,
) -> Result<(Vec<PunctualLight>, EnvironmentLight)> {
    let file = &scene.environment;
    let radius = 0.5 * options.sun_angle.or(file.sun_angle).unwrap_or(SUN_ANGLE);
    if !(0.0..=0.5).contains(&radius) {
        return Err(Error::Options("the sun's angular size must be 0 to 57 degrees".into()));
    }
    let sky = options.sky.as_ref().or(file.sky.as_ref());
    let turbidity = turbidity(sky);
    check_turbidity(turbidity)?;
    let place = |light: &Light, scale: f64| Some(PunctualLight::new(light, scale, eye, unit)?.with_radius(radius));
    let own = scene.model.lights.iter().filter_map(|light| place(light, options.light_scale));
    let mut lights: Vec<PunctualLight> = own.collect();
    if scene.model.lights.is_empty() && !matches!(sky, Some(Sky::Picture(_))) {
        if options.sun.is_none() {
            notes.push("no light in the file: a sun from the upper left was added (option `sun` sets it)".into());
        }
        lights.extend(place(&default_sun(), 1.0));
    }
    if let Some(position) = &options.sun {
        move_sun(&mut lights, position, turbidity, radius)?;
    }
    let environment = environment(sky, &mut lights, notes)?;
    let haze = options.haze.or(file.haze);
    if haze.is_some_and(|visibility| !(visibility > 0.0 && visibility.is_finite())) {
        return Err(Error::Options("the visibility in haze must be above 0 metres".into()));
    }
    let background = options.background.or(file.background).map(DVec3::from_array);
    Ok((lights, environment.with_background(background).with_haze(haze, unit)))
}

fn turbidity(sky: Option<&Sky>) -> f64 {
    if let Some(Sky::Clear(turbidity)) = sky { *turbidity } else { DEFAULT_TURBIDITY }
}

/// The light of the sky; a sun in a picture of it is added to `lights`.
fn environment(
    sky: Option<&Sky>,
    lights: &mut Vec<PunctualLight>,
    notes: &mut Vec<String>,
) -> Result<EnvironmentLight> {
    let suns = lights.iter().filter_map(PunctualLight::sun);
    let sun = suns.reduce(|a, b| if luminance(b.irradiance) > luminance(a.irradiance) { b } else { a });
    Ok(match (sky, &sun) {
        (Some(Sky::Constant(radiance)), _) => EnvironmentLight::constant(DVec3::from_array(*radiance)),
        (Some(Sky::Clear(_)), None) => {
            let what = "a clear sky needs a sun, and the file has no directional light (option `sun` sets one)";
            return Err(Error::Options(what.into()));
        }
        (Some(Sky::Clear(_)), Some(sun)) => EnvironmentLight::clear(sun, turbidity(sky)),
        (Some(Sky::Picture(path)), _) => {
            let (environment, found) = EnvironmentLight::picture(path)?;
            if let Some(sun) = found {
                notes.push(format!("the sun in {} is a light of its own", path.display()));
                lights.push(PunctualLight::from_sun(&sun));
            }
            environment
        }
        (None, Some(sun)) if is_up(sun.towards) => {
            notes.push("no sky in the file: a clear one that fits the sun (option `sky` sets another)".into());
            EnvironmentLight::clear(sun, turbidity(sky))
        }
        (None, _) => {
            notes.push("no sky in the file, and no sun above: a plain sky (option `sky` sets another)".into());
            EnvironmentLight::constant(DVec3::from_array(DEFAULT_SKY))
        }
    })
}

/// Put the brightest parallel light, or a new one, where the caller wants the sun. It keeps its luminance and takes the
/// colour that the air gives it there.
fn move_sun(lights: &mut Vec<PunctualLight>, position: &SunPosition, turbidity: f64, radius: f64) -> Result<()> {
    let SunPosition { elevation, azimuth } = *position;
    if !(-90.0..=90.0).contains(&elevation) || !azimuth.is_finite() {
        return Err(Error::Options("option `sun`: the elevation is −90 to 90 degrees".into()));
    }
    let (up, level) = libm::sincos(elevation.to_radians());
    let (east, north) = libm::sincos(azimuth.to_radians());
    let towards = DVec3::new(level * east, up, -level * north);
    let bright = |light: &PunctualLight| light.sun().map_or(-1.0, |sun| luminance(sun.irradiance));
    let brightest = (0..lights.len()).reduce(|a, b| if bright(&lights[b]) > bright(&lights[a]) { b } else { a });
    let own = brightest.map(|i| (i, bright(&lights[i]))).filter(|(_, bright)| *bright >= 0.0);
    // Where the sun has set its light has no colour left; the last one then.
    let seen_from = DVec3::new(towards.x, towards.y.max(0.035), towards.z);
    let colour = ClearSky::sunlight(seen_from, turbidity);
    let wanted = own.map_or_else(|| luminance(DVec3::from_array(default_sun().intensity)), |(_, bright)| bright);
    let irradiance = colour * (wanted / luminance(colour).max(1e-30));
    let sun = PunctualLight::from_sun(&Sun { towards, irradiance, radius });
    match own {
        Some((i, _)) => lights[i] = sun,
        None => lights.push(sun),
    }
    Ok(())
}
