//! Strands against closed forms: areas, projected widths, joints, ends, regions, copies.

use std::f64::consts::PI;

use super::*;
use crate::geom::polygon::Polygon;
use crate::geom::{DAffine3, directions13};
use crate::progress::Quiet;

/// A grid of `side` voxels on the unit cube, +Y up.
fn grid(side: u32) -> Placement {
    Placement {
        bounds: Aabb::UNIT,
        transform: DAffine3::IDENTITY,
        scale: f64::from(side),
        depth: side.trailing_zeros() as usize,
        up: 1,
        cyclic: [false; 3],
        memory: u64::MAX,
    }
}

fn source(strand: Strand) -> CurveSource {
    CurveSource::new([strand], &CurveOptions::default(), 0.0, Warnings::default())
}

fn straight(radii: [f32; 2], section: Section) -> Strand {
    let points = vec![DVec3::new(0.3, 0.2, 0.4), DVec3::new(0.6, 0.7, 0.55)];
    Strand { points, radii: radii.to_vec(), section, ..Strand::default() }
}

/// All facets, each once, cut to their regions and put together again as areas, in source units.
fn areas(source: &CurveSource, place: &Placement) -> Vec<DVec3> {
    let staged = source.stage(place, &Quiet).unwrap();
    let width = f64::from(1u32 << place.region_log2());
    let mut out = Vec::new();
    for (i, &code) in staged.regions().iter().enumerate() {
        let corner = DVec3::from(crate::morton::decode(code).map(f64::from)) * width;
        staged.emit(i, &mut |p: &Polygon| {
            let mut room = None;
            let piece = p.clip(corner, corner + width, &mut room);
            // Back from u, v, w.
            let turned = |a: DVec3| DVec3::new(a.x, a.z, -a.y);
            out.extend(piece.map(|p| turned(p.area_vector()) / place.scale.powi(2)));
        });
    }
    out
}

fn total(areas: &[DVec3]) -> f64 {
    areas.iter().map(|a| a.length()).sum()
}

#[test]
fn areas_are_those_of_the_formulas() {
    let (d, length) = {
        let p = straight([0.0; 2], Section::Round).points;
        ((p[1] - p[0]).normalize(), (p[1] - p[0]).length())
    };
    assert!(d.is_normalized());
    for side in [16, 64, 256] {
        for (r0, r1) in [(0.05f32, 0.05f32), (0.1, 0.02), (0.08, 0.0), (0.001, 0.002)] {
            let got = areas(&source(straight([r0, r1], Section::Round)), &grid(side));
            let (a, b) = (f64::from(r0), f64::from(r1));
            let lateral = PI * (a + b) * length.hypot(a - b);
            let caps = PI * (a * a + b * b);
            // Polygons have the circle's perimeter: the slope of a cone's faces and the caps are off by what r π² / 3 n² < 1/16 voxel leaves.
            let got_total = total(&got);
            let allowed = 2e-3 * lateral + 2.0 * PI * (a + b) * (0.0625 / f64::from(side)).min(0.2 * (a + b));
            assert!((got_total - lateral - caps).abs() < allowed, "{side} {r0} {r1}: {got_total} {}", lateral + caps);
            // Closed.
            assert!(got.iter().sum::<DVec3>().length() < 1e-9, "{side} {r0} {r1}");
        }
        let ribbon = areas(&source(straight([0.03, 0.01], Section::Rectangular { thickness: 0.0 })), &grid(side));
        assert!((total(&ribbon) - 0.04 * length).abs() < 1e-6);
        let bar = areas(&source(straight([0.03, 0.03], Section::Rectangular { thickness: 0.5 })), &grid(side));
        assert!((total(&bar) - (0.18 * length + 2.0 * 0.06 * 0.03)).abs() < 1e-6);
        let angle = 1.2f64;
        let v = areas(&source(straight([0.03, 0.01], Section::V { angle: angle as f32 })), &grid(side));
        // Two trapezia of widths r / sin(angle / 2); their planes lean a little out of the path's as the blade narrows.
        let flank = 0.02 / (0.5 * angle).sin();
        assert!((total(&v) / (2.0 * flank * length) - 1.0).abs() < 1e-3, "{}", total(&v));
    }
}

#[test]
fn a_cylinder_covers_its_width_from_26_sides() {
    let strand = straight([0.02; 2], Section::Round);
    let way = strand.points[1] - strand.points[0];
    let (length, d) = (way.length(), way.normalize());
    // (voxels per side, most deviation): radii of .16, 1.3 and 10 voxels, as 3, 9 and 25 sides.
    for (side, allowed) in [(8, 0.11), (64, 0.01), (512, 0.002)] {
        let got = areas(&source(strand.clone()), &grid(side));
        for w in directions13() {
            // Silhouette of a convex body: half of what faces either way.
            let seen = 0.5 * got.iter().map(|a| a.dot(w).abs()).sum::<f64>();
            let want = 0.04 * length * (1.0 - d.dot(w).powi(2)).sqrt() + PI * 4e-4 * d.dot(w).abs();
            assert!((seen / want - 1.0).abs() < allowed, "{side} {w}: {}", seen / want);
        }
    }
}

#[test]
fn the_width_of_thin_strands_is_right_on_average_over_their_rolls() {
    let strands = (0..200).map(|_| straight([0.001; 2], Section::Round));
    let many = CurveSource::new(strands, &CurveOptions::default(), 0.0, Warnings::default());
    let got = areas(&many, &grid(16));
    let way = many.points[1] - many.points[0];
    for w in directions13() {
        let seen = 0.5 * got.iter().map(|a| a.dot(w).abs()).sum::<f64>() / 200.0;
        let want = 0.002 * way.cross(w).length();
        // Triangles at rolls that are spread evenly; the ends are a thousandth.
        assert!((seen / want - 1.0).abs() < 0.006, "{w}: {}", seen / want);
    }
}

#[test]
fn a_bent_tube_is_closed_and_of_the_length_of_its_axis() {
    let points: Vec<DVec3> =
        [[0.2, 0.2, 0.5], [0.5, 0.2, 0.5], [0.6, 0.45, 0.5], [0.5, 0.8, 0.6]].map(DVec3::from).into();
    let length: f64 = points.windows(2).map(|w| (w[1] - w[0]).length()).sum();
    for section in [Section::Round, Section::Rectangular { thickness: 0.3 }] {
        let strand = Strand { points: points.clone(), radii: vec![0.02], section, ..Strand::default() };
        let got = areas(&source(strand), &grid(128));
        assert!(got.iter().sum::<DVec3>().length() < 1e-12, "mitres leave no gap");
        // A mitre takes from one side of the axis what it gives to the other.
        let want = match section {
            Section::Round => 2.0 * PI * 0.02 * length + 2.0 * PI * 4e-4,
            _ => 0.04 * 2.6 * length + 2.0 * 0.04 * 0.012,
        };
        assert!((total(&got) / want - 1.0).abs() < 2e-3, "{}", total(&got) / want);
    }
}

#[test]
fn a_sharp_turn_gets_a_ball() {
    let points = vec![DVec3::new(0.2, 0.3, 0.5), DVec3::new(0.8, 0.4, 0.5), DVec3::new(0.2, 0.5, 0.5)];
    let strand = Strand { points, radii: vec![0.02], ..Strand::default() };
    let (bent, place) = (source(strand), grid(64));
    let staged = bent.stage(&place, &Quiet).unwrap();
    let mut furthest = 0.0f64;
    for i in 0..staged.regions().len() {
        staged.emit(i, &mut |p| furthest = p.corners().iter().map(|c| c.x).fold(furthest, f64::max));
    }
    // A mitre would reach six radii beyond.
    assert!((furthest / 64.0 - 0.82).abs() < 0.002, "{furthest}");
}

#[test]
fn a_point_is_a_ball_of_the_spheres_area() {
    for side in [8, 64, 512] {
        let strand = Strand { points: vec![DVec3::splat(0.5)], radii: vec![0.1], ..Strand::default() };
        let got = areas(&source(strand), &grid(side));
        assert!((total(&got) / (4.0 * PI * 0.01) - 1.0).abs() < 1e-6, "{side} {}", total(&got) / (4.0 * PI * 0.01));
        assert!(got.iter().sum::<DVec3>().length() < 1e-12);
    }
}

#[test]
fn catmull_rom_runs_through_its_points_and_bends_evenly() {
    // A circle: chords of 8 points are 2.6 % short of it, the curve is much closer.
    let on = |i: i32| {
        let a = f64::from(i) * PI / 4.0;
        DVec3::new(0.5 + 0.3 * a.cos(), 0.5, 0.5 + 0.3 * a.sin())
    };
    let strand = Strand { points: (-1..=9).map(on).collect(), radii: vec![0.001], ..Strand::default() };
    let options = CurveOptions { interpolation: Interpolation::CatmullRom, ..CurveOptions::default() };
    let curve = CurveSource::new([strand], &options, 0.0, Warnings::default());
    let path = path::flatten(&curve, &curve.lines[0], 1e-4);
    assert!(on(3) == path.iter().min_by(|a, b| a.at.distance(on(3)).total_cmp(&b.at.distance(on(3)))).unwrap().at);
    for s in &path {
        let r = (s.at - DVec3::new(0.5, 0.5, 0.5)).length();
        // The ends lack a neighbour.
        assert!((r - 0.3).abs() < 0.015, "{r}");
    }
    let inner: f64 = path.windows(2).map(|w| w[0].at.distance(w[1].at)).sum();
    let want = 0.3 * 10.0 * PI / 4.0;
    assert!((inner / want - 1.0).abs() < 0.008, "{}", inner / want);
}

#[test]
fn thick_strands_are_opaque_within() {
    let strand = Strand {
        points: vec![DVec3::new(0.2, 0.3, 0.3), DVec3::new(0.5, 0.3, 0.3), DVec3::new(0.6, 0.7, 0.5)],
        radii: vec![0.15, 0.1],
        ..Strand::default()
    };
    let solid = source(strand.clone());
    let place = grid(128);
    let staged = solid.stage(&place, &Quiet).unwrap();
    let inside = |p: [f64; 3]| staged.inside(place.to_grid(DVec3::from(p)));
    assert!(inside([0.22, 0.4, 0.3]) && inside([0.56, 0.5, 0.4]) && inside([0.52, 0.32, 0.31]));
    assert!(!inside([0.19, 0.3, 0.3]) && !inside([0.35, 0.46, 0.3]) && !inside([0.9, 0.9, 0.9]));
    let hollow = CurveOptions { fill: Fill::Surface, ..CurveOptions::default() };
    let hollow = CurveSource::new([strand], &hollow, 0.0, Warnings::default());
    assert!(!hollow.stage(&place, &Quiet).unwrap().inside(place.to_grid(DVec3::new(0.22, 0.4, 0.3))));
}

#[test]
fn ribbons_face_up_and_the_v_opens_upward() {
    let points = vec![DVec3::new(0.2, 0.5, 0.5), DVec3::new(0.7, 0.6, 0.5)];
    let strand = |section| Strand { points: points.clone(), radii: vec![0.05], section, ..Strand::default() };
    for a in areas(&source(strand(Section::Rectangular { thickness: 0.0 })), &grid(64)) {
        assert!(a.z.abs() < 1e-12, "{a}");
    }
    let v = source(strand(Section::V { angle: 1.0 }));
    let staged = v.stage(&grid(64), &Quiet).unwrap();
    let (mut axis, mut edge) = (f64::INFINITY, f64::NEG_INFINITY);
    staged.emit(0, &mut |p| {
        for c in p.corners().iter().filter(|c| c.x < 15.0) {
            (axis, edge) = (axis.min(c.z), edge.max(c.z));
        }
    });
    assert!((axis - 32.0).abs() < 1e-9 && edge > axis + 3.2, "{axis} {edge}");
}

#[test]
fn dense_paths_are_thinned_to_the_grid() {
    let wave = |i: i32| DVec3::new(f64::from(i) / 1000.0, 0.5 + 1e-5 * f64::from(i % 2), 0.5);
    let strand = Strand { points: (0..=1000).map(wave).collect(), radii: vec![0.001], ..Strand::default() };
    let dense = source(strand);
    for side in [16, 64] {
        let got = areas(&dense, &grid(side));
        // Three sides of 1000 pieces were there, along the edge of four regions.
        assert!(got.len() < 500, "{}", got.len());
        assert!((total(&got) / (2.0 * PI * 0.001) - 1.0).abs() < 2e-3, "{}", total(&got));
    }
}

#[test]
fn bounds_are_tight() {
    let b = source(straight([0.05, 0.02], Section::Round)).bounds();
    let d = DVec3::new(0.3, 0.5, 0.15).normalize();
    let low = DVec3::new(0.3, 0.2, 0.4) - 0.05 * (1.0 - d * d).map(f64::sqrt);
    // Radii in f32.
    assert!((b.min - low).length() < 1e-8, "{b:?}");
}

#[test]
fn hostile_strands_are_harmless() {
    let nan = f64::NAN;
    let strands = vec![
        Strand::default(),
        Strand { points: vec![DVec3::splat(nan), DVec3::ONE], radii: vec![0.1, f32::NAN], ..Strand::default() },
        Strand { points: vec![DVec3::ONE; 5], radii: vec![-1.0], ..Strand::default() },
        Strand { points: vec![DVec3::ZERO, DVec3::splat(1e300)], radii: vec![1.0], ..Strand::default() },
        Strand { points: vec![DVec3::ZERO, DVec3::ONE], radii: vec![1e30], ..Strand::default() },
        Strand {
            points: vec![DVec3::ZERO, DVec3::ONE, DVec3::ZERO],
            up: Some(DVec3::ONE),
            section: Section::V { angle: 0.0 },
            radii: vec![0.1],
            ..Strand::default()
        },
    ];
    for interpolation in [Interpolation::Linear, Interpolation::CatmullRom] {
        let options = CurveOptions { interpolation, ..CurveOptions::default() };
        let curves = CurveSource::new(strands.clone(), &options, 0.0, Warnings::default());
        assert!(!curves.warnings().is_empty());
        let staged = curves.stage(&grid(32), &Quiet).unwrap();
        (0..staged.regions().len()).for_each(|i| staged.emit(i, &mut |p| assert!(p.corners().len() <= 8)));
        staged.inside(DVec3::splat(3.5));
    }
}

#[test]
fn a_copy_comes_in_on_the_other_side() {
    let strand = Strand {
        points: vec![DVec3::new(0.8, 0.5, 0.5), DVec3::new(1.3, 0.5, 0.5)],
        radii: vec![0.02],
        ..Strand::default()
    };
    let curves = source(strand);
    let place = Placement { cyclic: [true, false, false], ..grid(64) };
    let got = total(&areas(&curves, &place));
    let want = 2.0 * PI * 0.02 * 0.5 + 2.0 * PI * 4e-4;
    assert!((got / want - 1.0).abs() < 2e-3, "{got} {want}");
    let plain = total(&areas(&curves, &grid(64)));
    assert!(plain < 0.45 * want);
}
