//! The opacity that was aimed at, on objects that are each hard in their own way.

use super::*;
use crate::bake;
use crate::cli::shapes;
use crate::cli::shapes::{Shape, VOXELS};
use crate::geom::DAffine3;
use crate::scene::{Instance, Material, Model, Part};
use crate::source::Source;
use crate::source::mesh::{Fill, MeshOptions, MeshSource};

/// One part of one white material; vertices that agree are one.
fn model(shape: &Shape) -> Model {
    let mut part = Part::default();
    let mut known = std::collections::BTreeMap::new();
    for t in &shape.triangles {
        let corner = |p: &DVec3| {
            let p = p.as_vec3().to_array();
            *known.entry(p.map(f32::to_bits)).or_insert_with(|| {
                part.positions.push(p);
                part.positions.len() as u32 - 1
            })
        };
        part.triangles.push(t.each_ref().map(corner));
    }
    let instance = Instance { part: 0, transform: DAffine3::IDENTITY, node: String::new() };
    Model { parts: vec![part], materials: vec![Material::default()], instances: vec![instance], ..Model::default() }
}

/// Bake at 64^3 and measure the finest depths, in directions that the bake did not measure along.
fn errors(shape: &Shape, fill: Fill, depths: usize) -> Vec<DepthError> {
    let source = MeshSource::new(model(shape), &MeshOptions { fill });
    let ui = Ui::new(true, false);
    let options = bake::Options { resolution: VOXELS, ..bake::Options::default() };
    let (volume, _) = bake::bake(&source as &dyn Source, &options, &ui, &mut |_| ()).unwrap();
    let tree = Octree::new(volume).unwrap();
    let options = Options { pixels: 12, rays: [128, 128], turned: true, depths, ..Options::default() };
    against(&tree, &source, &options, 1 << 30, &ui).unwrap()
}

/// What is allowed of one shape: |ΔT| at pixel = voxel and at 4 voxels a pixel, and the covered area.
fn check(shape: &Shape, own: f64, four: f64, area: std::ops::RangeInclusive<f64>) {
    check_filled(shape, Fill::Auto, own, four, area);
}

fn check_filled(shape: &Shape, fill: Fill, own: f64, four: f64, area: std::ops::RangeInclusive<f64>) {
    for d in errors(shape, fill, 2) {
        let (name, depth, at_4) = (shape.name, d.depth, d.opacity_at_4.unwrap());
        // 312 pixels with errors of .05 to .1 on the average: means are good to some .005, areas to .01.
        assert!(d.opacity.spread.mean <= own, "{name}, depth {depth}: {:?}", d.opacity);
        assert!(at_4.spread.mean <= four, "{name}, depth {depth}: {at_4:?}");
        assert!(area.contains(&d.opacity.area), "{name}, depth {depth}: {:?}", d.opacity);
    }
}

/// Aimed at: .06, .03, and .97 to 1.03; a little more is allowed where the pixels are few.
#[test]
fn what_the_law_can_hold_meets_the_aims() {
    check(&shapes::leaves("leaves .5", 0.5, 1.0), 0.06, 0.03, 0.97..=1.03);
    check(&shapes::leaves("leaves 1.5", 1.5, 1.5), 0.06, 0.03, 0.97..=1.03);
    check(&shapes::leaves("leaves 4", 4.0, 2.0), 0.06, 0.03, 0.97..=1.03);
    check(&shapes::leaves("leaves 10", 10.0, 2.0), 0.06, 0.03, 0.97..=1.03);
    check(&shapes::clumps(), 0.06, 0.03, 0.97..=1.03);
    check(&shapes::fur(), 0.06, 0.03, 0.97..=1.03);
    check(&shapes::sheet(), 0.06, 0.03, 0.97..=1.03);
    check(&shapes::ball(), 0.06, 0.03, 0.97..=1.03);
    check_filled(&shapes::ball(), Fill::Surface, 0.06, 0.03, 0.97..=1.03);
}

/// Voxels at a solid's rim are in each other's way more than chance has it, which no correlation from 0 to 1 says; what is
/// inside must not make it worse. Measured at 32^3, 16^3 and 8^3: .007 .020 .026, .005 .014 .012, area 1.00 1.02 1.03.
#[test]
fn coarse_solids_cover_little_more_than_they_should() {
    for d in errors(&shapes::ball(), Fill::Solid, 4) {
        let at_4 = d.opacity_at_4.unwrap();
        // 312 pixels: as above.
        assert!(d.opacity.spread.mean <= 0.035 && at_4.spread.mean <= 0.025, "{d:?}");
        assert!((0.985..=1.04).contains(&d.opacity.area) && d.sigma.unwrap().mean < 0.03, "{d:?}");
    }
}

/// Slats narrower than a voxel of the coarser depth hide one another in one direction and fill each other's gaps in another;
/// a block has one correlation for all.
#[test]
fn blinds_are_as_near_as_one_correlation_gets() {
    check(&shapes::blinds(), 0.09, 0.065, 0.88..=1.04);
}

#[test]
fn options_are_compared_by_value() {
    // As `--window 200,900` is stored, and as it is read from the command line.
    let stored: Value = serde_json::from_str(r#"{"window": [200, 900.5], "fill": "auto"}"#).unwrap();
    assert!(same(&stored, &json!({ "window": [200.0, 900.5], "fill": "auto" })));
    assert!(!same(&stored, &json!({ "window": [200.0, 900.0], "fill": "auto" })));
    assert!(!same(&stored, &json!({ "window": [200.0], "fill": "auto" })));
    assert!(!same(&stored, &json!({ "window": [200.0, 900.5], "iso": "auto" })));
}
