//! A group against the same matter as one mesh.

use super::*;
use crate::bake::{Options, bake};
use crate::progress::Quiet;
use crate::scene::model::{Instance, Material, Model, Part as MeshPart};
use crate::source::mesh::{MeshOptions, MeshSource};
use crate::source::placement::REGION_LOG2;

/// Cubes of edge 1 standing on 0, one per instance.
fn cubes(places: &[DAffine3]) -> MeshSource {
    let positions = (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(|v| v as f32)).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    let part = MeshPart { positions, triangles, ..MeshPart::default() };
    let instances = places.iter().map(|&transform| Instance { part: 0, transform, node: String::new() }).collect();
    let model = Model { parts: vec![part], instances, materials: vec![Material::default()], ..Model::default() };
    MeshSource::new(model, &MeshOptions::default())
}

fn places(n: usize) -> Vec<DAffine3> {
    let turn = |i: usize| {
        let t = 0.7 * i as f64;
        let s = 0.5 + 0.1 * (i % 4) as f64;
        let mirror = if i.is_multiple_of(3) { DVec3::new(-s, s, s) } else { DVec3::splat(s) };
        DAffine3::from_translation(DVec3::new(2.0 * (i % 4) as f64, 0.3 * i as f64, 2.0 * (i / 4) as f64))
            * DAffine3::from_axis_angle(DVec3::new(1.0, 2.0, 0.5).normalize(), t)
            * DAffine3::from_scale(mirror)
    };
    (0..n).map(turn).collect()
}

fn group(places: &[DAffine3]) -> GroupSource {
    let parts: Vec<Part> = places.iter().map(|&transform| Part { source: 0, transform }).collect();
    GroupSource::new(vec![Box::new(cubes(&[DAffine3::IDENTITY]))], &parts, 0.0)
}

/// Area and area vector of everything that a source gives at 64^3.
fn area(source: &dyn Source) -> (f64, DVec3) {
    let place = crate::bake::plan(source.bounds(), &Options { resolution: 64, ..Options::default() }).unwrap();
    let staged = source.stage(&place, &Quiet).unwrap();
    let mut sum = (0.0, DVec3::ZERO);
    for (i, &code) in staged.regions().iter().enumerate() {
        let b = cube(code, REGION_LOG2);
        staged.emit(i, &mut |p| {
            let mut room = None;
            if let Some(p) = p.clip(b.min, b.max, &mut room) {
                sum.0 += p.area_vector().length();
                sum.1 += p.area_vector();
                assert!(p.facet < staged.facets() && staged.one_sided(p.facet));
            }
        });
    }
    (sum.0 / place.scale.powi(2), sum.1)
}

#[test]
fn copies_have_the_area_of_instances() {
    for n in [2, 13] {
        let p = places(n);
        let group = group(&p);
        let exact: f64 = p.iter().map(|t| 6.0 * libm::pow(t.matrix3.determinant().abs(), 2.0 / 3.0)).sum();
        let (sum, vector) = area(&group);
        // Positions in f32, cut at region borders in two grids: each crossing rounds to 1e-7 of the edge.
        assert!((sum - exact).abs() < 1e-5 * exact, "{n}: {sum} {exact}");
        // Closed surfaces: the vectors cancel, mirrored or not.
        assert!(vector.length() < 1e-3, "{vector}");
        let whole = cubes(&p);
        assert!((whole.bounds().min - group.bounds().min).length() < 1e-12);
        assert!((whole.bounds().max - group.bounds().max).length() < 1e-12);
    }
}

#[test]
fn copies_bake_as_instances_do() {
    let p = places(13);
    let options = Options { resolution: 128, ..Options::default() };
    let volume = |source: &dyn Source| bake(source, &options, &Quiet, &mut |_| {}).unwrap().0;
    let (copies, instances) = (volume(&group(&p)), volume(&cubes(&p)));
    for (a, b) in copies.depths.iter().zip(&instances.depths) {
        let (a, b) = (a.voxels.len() as f64, b.voxels.len() as f64);
        // Corners that touch a voxel by a rounding error, and middles of columns within two grids.
        assert!((a - b).abs() <= 0.002 * b + 1.0, "{a} {b}");
    }
    let solid = |v: &crate::volume::Volume| {
        let all = &v.depths.last().unwrap().voxels;
        all.iter().filter(|v| v.rate == crate::volume::voxel::RATE_MAX).count() as f64
    };
    assert!((solid(&copies) / solid(&instances) - 1.0).abs() < 0.02);
}

#[test]
fn what_cannot_be_placed_is_counted() {
    let cube = || Box::new(cubes(&[DAffine3::IDENTITY]));
    let flat = DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0));
    let lost = DAffine3::from_translation(DVec3::NAN);
    let parts = [(0, flat), (0, lost), (7, DAffine3::IDENTITY)].map(|(source, transform)| Part { source, transform });
    let group = GroupSource::new(vec![cube()], &parts, 0.0);
    assert!(group.bounds().is_empty());
    assert_eq!(group.warnings().iter().next().unwrap().1, 3);
}
