//! Areas and volumes of surfaces against their formulas.

use std::f64::consts::PI;

use super::*;
use crate::bake::clip::Polygon;
use crate::bake::source::Source;
use crate::bake::{Options, plan};
use crate::morton;
use crate::progress::Quiet;

/// Area, volume and sum of area vectors, in source units, of the facets that the source gives at a resolution.
fn surface(source: &FieldSource, resolution: u32) -> (f64, f64, DVec3) {
    let place = plan(source.bounds(), &Options { resolution, ..Options::default() }).unwrap();
    let staged = source.stage(&place, &Quiet).unwrap();
    let width = f64::from(1u32 << place.region_log2());
    let (mut area, mut volume, mut sum) = (0.0, 0.0, DVec3::ZERO);
    for (region, &code) in staged.regions().iter().enumerate() {
        let lo = DVec3::from(morton::decode(code).map(f64::from)) * width;
        staged.emit(region, &mut |polygon: &Polygon| {
            let Some(piece) = polygon.clip(lo, lo + width) else { return };
            let a = piece.area_vector();
            area += a.length();
            sum += a;
            // Divergence theorem: a plane piece is as far from the origin everywhere along its normal.
            volume += piece.corners()[0].dot(a) / 3.0;
        });
    }
    let s = place.scale;
    (area / (s * s), volume / (s * s * s), sum / (s * s))
}

fn source(field: impl Field + 'static) -> FieldSource {
    FieldSource::new(Box::new(field), None).unwrap()
}

/// Relative errors of area and volume at 16, 32 and 64 voxels a side.
fn errors(field: impl Field + Copy + 'static, area: f64, volume: f64) -> [[f64; 2]; 3] {
    [16, 32, 64].map(|n| {
        let (a, v, sum) = surface(&source(field), n);
        // Closed: area vectors cancel, but for roundings of clipping.
        assert!(sum.length() < 1e-9 * area, "{sum}");
        [a / area - 1.0, v / volume - 1.0]
    })
}

#[test]
fn smooth_bodies_are_of_second_order() {
    let centre = DVec3::new(0.1, -0.2, 0.3);
    let axis = DVec3::new(0.48, 0.6, 0.64);
    let cases = [
        ("sphere", errors(Sphere { centre, radius: 0.7 }, 4.0 * PI * 0.49, 4.0 / 3.0 * PI * 0.343)),
        (
            "torus",
            errors(Torus { centre, axis, radius: 1.0, thickness: 0.4 }, 4.0 * PI * PI * 0.4, 2.0 * PI * PI * 0.16),
        ),
        (
            "ellipsoid",
            // A spheroid, a = b = 1, c = 1/2: 2 pi a² (1 + (1 − e²)/e artanh e), e² = 3/4.
            errors(
                Ellipsoid { centre, radii: DVec3::new(1.0, 0.5, 1.0) },
                2.0 * PI * (1.0 + 0.25 / 0.75f64.sqrt() * 0.75f64.sqrt().atanh()),
                4.0 / 3.0 * PI * 0.5,
            ),
        ),
        (
            "capsule",
            errors(
                Capsule { from: centre, to: centre + axis, radius: 0.3 },
                2.0 * PI * 0.3 + 4.0 * PI * 0.09,
                PI * 0.09 + 4.0 / 3.0 * PI * 0.027,
            ),
        ),
    ];
    for (name, e) in cases {
        // A quarter at twice the resolution; measured at 64: sphere .0002, torus .0009, ellipsoid .0005, capsule .0006.
        for [coarse, fine] in [[0, 1], [1, 2]] {
            for i in 0..2 {
                let order = (e[coarse][i] / e[fine][i]).log2();
                assert!((order - 2.0).abs() < 0.15, "{name} {e:?}");
            }
        }
        assert!(e[2][0].abs() < 1e-3 && e[2][1].abs() < 1e-3, "{name} {e:?}");
    }
}

#[test]
fn creases_are_kept() {
    let from = DVec3::new(0.1, -0.2, 0.3);
    let to = from + 1.2 * DVec3::new(0.48, 0.6, 0.64);
    let slant = (1.2f64 * 1.2 + 0.09).sqrt();
    let cases = [
        (
            "box",
            errors(
                Block { min: DVec3::ZERO, max: DVec3::new(1.0, 0.61, 0.37), round: 0.0 },
                2.0 * (0.61 + 0.37 + 0.61 * 0.37),
                0.61 * 0.37,
            ),
        ),
        ("cylinder", errors(Cone { from, to, radii: [0.4; 2] }, 2.0 * PI * 0.4 * 1.6, PI * 0.16 * 1.2)),
        (
            "cone",
            errors(
                Cone { from, to, radii: [0.5, 0.2] },
                PI * (0.25 + 0.04 + 0.7 * slant),
                PI * 1.2 / 3.0 * (0.25 + 0.1 + 0.04),
            ),
        ),
    ];
    for (name, e) in cases {
        // Flat faces are met, straight creases nearly so: measured at 64, box .000003, cylinder .0004, cone .001.
        let allowed = if name == "box" { 1e-5 } else { 0.0015 };
        assert!(e[2][0].abs() < allowed && e[2][1].abs() < allowed, "{name} {e:?}");
        assert!(e[0][0].abs() < 0.006 && e[0][1].abs() < 0.006, "{name} {e:?}");
    }
}
