//! The sky against closed forms and published figures.

use std::f64::consts::{FRAC_PI_2, PI};

use super::atmosphere::{Atmosphere, TURBIDITY};
use super::clear::ClearSky;
use super::spectrum::{COUNT, OZONE, RgbWeights, SUN, WAVELENGTHS, luminance};
use crate::geom::DVec3;

fn at(elevation: f64, azimuth: f64) -> DVec3 {
    let (elevation, azimuth) = (elevation.to_radians(), azimuth.to_radians());
    DVec3::new(elevation.cos() * azimuth.cos(), elevation.sin(), elevation.cos() * azimuth.sin())
}

/// Irradiance of the sky on level ground, by the midpoint rule.
fn irradiance(sky: &ClearSky) -> DVec3 {
    const N: usize = 64;
    let mut sum = DVec3::ZERO;
    for i in 0..N {
        let sin = ((i as f64 + 0.5) / N as f64).sqrt();
        for j in 0..2 * N {
            sum += sky.radiance(at(sin.asin().to_degrees(), 180.0 * (j as f64 + 0.5) / N as f64));
        }
    }
    PI * sum / (2 * N * N) as f64
}

/// Correlated colour temperature, kelvin (C. McCamy 1992).
fn kelvin(rgb: DVec3) -> f64 {
    let x = rgb.dot(DVec3::new(0.4124, 0.3576, 0.1805));
    let (y, z) = (luminance(rgb), rgb.dot(DVec3::new(0.0193, 0.1192, 0.9505)));
    let (x, y) = (x / (x + y + z), y / (x + y + z));
    let n = (x - 0.3320) / (0.1858 - y);
    ((449.0 * n + 3525.0) * n + 6823.3) * n + 5520.33
}

#[test]
fn straight_down_the_optical_depths_are_closed_forms() {
    for turbidity in [1.0, 2.5, 6.0] {
        let through = Atmosphere::new(turbidity).sun(1.0);
        for k in 0..COUNT {
            let rayleigh = 1.24062e-6 * (WAVELENGTHS[k] / 1000.0).powi(-4) * 8000.0;
            let molecules = 1.24062e-6 * 0.55f64.powi(-4) * 8000.0;
            let haze = (turbidity - 1.0) * molecules * (WAVELENGTHS[k] / 550.0).powf(-1.1);
            // From 100 m up: less by the share of the scale heights.
            let depth = rayleigh * (-0.1f64 / 8.0).exp() + haze * (-0.1f64 / 1.2).exp() + OZONE[k] * 300.0 * 2.687e20;
            let right = SUN.0[k] * (-depth).exp();
            // The table is linear between 128 angles and 32 heights, the first 142 km of distance to the horizon apart: that
            // many metres of the lowest air are skipped over linearly, worst for haze.
            assert!((through.0[k] / right - 1.0).abs() < 0.02, "{turbidity} {k}: {} {right}", through.0[k]);
        }
    }
}

#[test]
fn sun_and_sky_are_as_bright_as_handbooks_have_them() {
    // IESNA Lighting Handbook, clear sky: 127.5 klx · exp(−.21 / sin a) facing the sun, .8 + 15.5 sin^.5 a from the sky. Its
    // optical depth is that of a turbidity of 2: .10 of molecules, .10 of haze and .02 of ozone at 555 nm.
    for altitude in [10.0, 20.0, 35.0, 50.0, 65.0, 80.0f64] {
        let sky = ClearSky::new(at(altitude, 40.0), 2.0);
        let sin = altitude.to_radians().sin();
        let (sun, blue) =
            (0.683 * luminance(ClearSky::sunlight(at(altitude, 40.0), 2.0)), 0.683 * luminance(irradiance(&sky)));
        let (sun_book, blue_book) = (127.5 * (-0.21 / sin).exp(), 0.8 + 15.5 * sin.sqrt());
        // Handbooks of other places differ by a quarter from each other.
        assert!((sun / sun_book - 1.0).abs() < 0.3, "sun at {altitude}: {sun} klx, {sun_book}");
        assert!((blue / blue_book - 1.0).abs() < 0.35, "sky at {altitude}: {blue} klx, {blue_book}");
    }
}

#[test]
fn colours_are_of_daylight() {
    let noon = ClearSky::new(at(60.0, 0.0), 2.5);
    // Blackbodies as published for direct sunlight at noon 5000 … 5800 K, at sunset 1800 … 3500, blue sky beyond 10 000.
    let (sun, zenith) = (kelvin(ClearSky::sunlight(at(60.0, 0.0), 2.5)), kelvin(noon.radiance(at(85.0, 180.0))));
    assert!((4800.0..5900.0).contains(&sun), "{sun}");
    // Beyond the formula's range it is negative.
    assert!(!(0.0..=9000.0).contains(&zenith), "{zenith}");
    let low = kelvin(ClearSky::sunlight(at(3.0, 0.0), 2.5));
    assert!((1500.0..3500.0).contains(&low), "{low}");
    // White is white: D65's own colour by the weights, to the tents' 40 nm.
    let flat = RgbWeights::new().rgb(&super::spectrum::Spectrum::splat(1.0));
    // The equal-energy illuminant in Rec. 709: (1.205, .948, .909).
    let ratio = flat / luminance(flat);
    assert!((ratio - DVec3::new(1.205, 0.948, 0.909)).abs().max_element() < 0.02, "{ratio}");
}

#[test]
fn luminance_falls_off_as_the_cie_clear_sky() {
    // CIE S 011, type 12 (clear, low turbidity), relative to the zenith.
    let (a, b, c, d, e) = (-1.0, -0.32, 10.0, -3.0, 0.45);
    let f = |chi: f64| 1.0 + c * ((d * chi).exp() - (d * FRAC_PI_2).exp()) + e * chi.cos().powi(2);
    let phi = |z: f64| 1.0 + a * (b / z.cos()).exp();
    let sun = at(40.0, 0.0);
    let sky = ClearSky::new(sun, 2.5);
    let zenith = luminance(sky.radiance(DVec3::Y));
    let mut worst: f64 = 1.0;
    for elevation in [10.0, 30.0, 50.0, 70.0] {
        for azimuth in [30.0, 60.0, 90.0, 135.0, 180.0] {
            let dir = at(elevation, azimuth);
            let z = (90.0f64 - elevation).to_radians();
            let book = f(dir.dot(sun).acos()) * phi(z) / (f(50f64.to_radians()) * phi(0.0));
            let ratio = luminance(sky.radiance(dir)) / zenith / book;
            worst = worst.max(ratio.max(1.0 / ratio));
        }
    }
    // A mean sky against one sky: measured skies of one type scatter by as much.
    assert!(worst < 1.7, "{worst}");
}

#[test]
fn light_is_not_made_and_the_sky_is_even() {
    for turbidity in [1.0, 3.0, 10.0] {
        for altitude in [-12.0, -4.0, 0.0, 2.0, 15.0, 60.0, 90.0] {
            let sun = at(altitude, 77.0);
            let sky = ClearSky::new(sun, turbidity);
            let direct = ClearSky::sunlight(sun, turbidity);
            let above = luminance(RgbWeights::new().rgb(&SUN)) * sun.y.max(0.0);
            let ground = luminance(direct) * sun.y.max(0.0) + luminance(irradiance(&sky));
            // At and below the horizon the air above is lit nevertheless: by at most 1500 lx (see below).
            assert!(ground < above + 1500.0 / 683.0, "{turbidity} {altitude}: {ground} of {above}");
            assert!(direct.min_element() >= 0.0);
            for elevation in [-80.0, -10.0, -3.0, 0.5, 3.0, 20.0, 45.0, 89.0] {
                for turn in [0.0, 3.0, 40.0, 100.0, 179.0] {
                    let seen = |sign: f64| sky.radiance(at(elevation, 77.0 + sign * turn));
                    // Mirrored at the sun's meridian.
                    let apart = (seen(1.0) - seen(-1.0)).length();
                    assert!(apart <= 1e-9 * seen(1.0).length(), "{altitude} {elevation} {turn}");
                    assert!(seen(1.0).is_finite() && seen(1.0).min_element() >= 0.0);
                    // Smooth: a tenth of a degree up changes little, but across the horizon.
                    let up = sky.radiance(at(elevation + 0.1, 77.0 + turn));
                    let change = (luminance(up) - luminance(seen(1.0))).abs();
                    assert!(change <= 0.06 * luminance(up) + 1e-9, "{altitude} {elevation} {turn}: {change}");
                }
            }
        }
    }
    assert!(TURBIDITY.contains(&2.5));
}

#[test]
fn dusk_grows_dark_and_red_to_blue() {
    let light = |altitude: f64| luminance(irradiance(&ClearSky::new(at(altitude, 0.0), 2.5))) * 683.0;
    // Published means: about 400 to 800 lx at sunset, 3 lx at the end of civil twilight (−6 degrees).
    let (set, civil) = (light(-0.3), light(-6.0));
    assert!((150.0..1500.0).contains(&set), "{set}");
    assert!((0.3..15.0).contains(&civil), "{civil}");
    let sky = ClearSky::new(at(1.0, 0.0), 2.5);
    let (near, far) = (sky.radiance(at(2.0, 0.0)), sky.radiance(at(60.0, 180.0)));
    assert!(near.x > 1.2 * near.z && far.z > 1.2 * far.x, "{near} {far}");
}

#[test]
fn the_sky_is_scaled_to_the_sun_of_the_scene() {
    let sun = at(30.0, 10.0);
    let factor = ClearSky::scale(sun, 3.0, 2.5);
    assert!((factor * luminance(ClearSky::sunlight(sun, 3.0)) - 2.5).abs() < 1e-9);
    assert!(ClearSky::scale(at(-20.0, 0.0), 3.0, 2.5).is_finite());
}
