//! Every preset: safe ranges, gradients, exact periods, and the mass of soft matter.

use proptest::prelude::*;

use super::*;
use crate::bake::{Options, plan};
use crate::progress::Quiet;
use crate::source::field::{Cells, GridField};

const PRESETS: [&str; 6] = ["noise", "fur", "fire", "marble", "melt", "eroded"];

fn spec(text: &str) -> HypertextureSpec {
    serde_json::from_str(text).unwrap()
}

fn ball(preset: &str) -> Hypertexture {
    let base = r#"{"kind": "sphere", "radius": 1}"#;
    Hypertexture::new(&spec(&format!(r#"{{"preset": "{preset}", "base": {base}, "seed": 3}}"#))).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]
    #[test]
    fn ranges_bounds_and_gradients_hold(
        kind in 0..PRESETS.len(),
        a in proptest::array::uniform3(-1.8f64..1.8),
        size in 0.0f64..0.3,
        at in proptest::array::uniform3(0.0f64..1.0),
    ) {
        let field = ball(PRESETS[kind]);
        let b = Aabb::new(a.into(), DVec3::from(a) + size);
        let p = b.min + DVec3::from(at) * b.size();
        let (low, high) = field.range(&b);
        let v = field.value(p);
        prop_assert!(low - 1e-9 <= v && v <= high + 1e-9, "{} {low} {v} {high}", PRESETS[kind]);
        let bounds = field.bounds();
        prop_assert!(v > 0.0 || (p.cmpge(bounds.min).all() && p.cmple(bounds.max).all()));
        let numeric = central_difference(|p| field.value(p), p, 1e-6);
        let coarse = central_difference(|p| field.value(p), p, 1e-5);
        // Near the surface, where no crease is near either.
        if v.abs() < 0.05 && numeric.distance(coarse) < 1e-4 * numeric.length() && numeric.length() > 1e-3 {
            let way = field.gradient(p).normalize_or_zero();
            prop_assert!(way.dot(numeric.normalize()) > 0.99, "{} {way} {numeric}", PRESETS[kind]);
        }
    }
}

#[test]
fn opposite_faces_match_bit_for_bit() {
    for preset in PRESETS {
        let text = format!(
            r#"{{"preset": "{preset}", "base": {{"kind": "half-space", "point": [0, 0.4, 0]}}, "cyclic": [true, false, true],
            "amplitude": 0.3, "bounds": {{"min": [0, 0, 0], "max": [1.3, 1, 1.3]}}}}"#
        );
        let texture = Hypertexture::new(&spec(&text)).unwrap();
        let options = Options { resolution: 32, cyclic: [true, true, false], ..Options::default() };
        let window = texture.set.window.unwrap();
        let place = plan(window, &options).unwrap();
        let laid = GridField::new(&texture, window, texture.set.cyclic, &place, 0).unwrap();
        let mut both = 0;
        for i in 0..32 * 32 {
            let (j, k) = (i % 32, i / 32);
            for (last, first, far, near) in [
                ([31, j, k], [0, j, k], DVec3::new(1.0, 0.3, 0.7), DVec3::new(0.0, 0.3, 0.7)),
                ([j, 31, k], [j, 0, k], DVec3::new(0.3, 1.0, 0.7), DVec3::new(0.3, 0.0, 0.7)),
            ] {
                let v = laid.value(first, near);
                // The seam itself, and cells beyond it.
                assert!((laid.value(last, far) - v).abs() < 1e-9, "{preset}");
                let beyond: [i64; 3] = std::array::from_fn(|a| if first[a] == last[a] { first[a] } else { 32 });
                assert_eq!(laid.value(beyond, near).to_bits(), v.to_bits(), "{preset}");
                assert_eq!(laid.gradient(beyond, near), laid.gradient(first, near), "{preset}");
                both += i32::from(v < 0.0);
            }
        }
        // There is matter on both sides of a surface there, or the test says nothing.
        assert!(both > 100 && both < 2000, "{preset} {both}");
    }
}

#[test]
fn soft_matter_has_the_mass_of_its_shape() {
    // A layer 1/2 thick over a square of edge 1, softened evenly to both sides: mass = density · thickness.
    for softness in [0.05, 0.2] {
        let text = format!(
            r#"{{"preset": "fire", "amplitude": 0, "density": 3, "softness": {softness},
            "base": {{"kind": "plane", "point": [0, 0.5, 0], "thickness": 0.5}}, "cyclic": [true, false, true],
            "bounds": {{"min": [0, 0, 0], "max": [1, 1, 1]}}}}"#
        );
        let source = Hypertexture::source(&spec(&text)).unwrap();
        for resolution in [16, 64] {
            let options = Options { resolution, cyclic: [true, true, false], ..Options::default() };
            let place = plan(source.bounds(), &options).unwrap();
            let staged = source.stage(&place, &Quiet).unwrap();
            let mut mass = 0.0;
            for region in 0..staged.regions().len() {
                staged.medium(region, &mut |m| mass += m.extinction * f64::from(8u32.pow(m.edge_log2)));
            }
            let mass = mass / place.scale.powi(2);
            let want = 1.5;
            // Eight places a voxel: second order in what the softness spans.
            assert!((mass / want - 1.0).abs() < 0.02, "{softness} {resolution} {mass}");
        }
    }
}

#[test]
fn numbers_out_of_range_are_told() {
    for (text, word) in [
        (r#"{"base": {"kind": "sphere", "radius": 1}, "octaves": 11}"#, "octaves"),
        (r#"{"base": {"kind": "sphere", "radius": 1}, "gain": 1}"#, "gain"),
        (r#"{"base": {"kind": "sphere", "radius": 1}, "frequency": 0}"#, "frequency"),
        (r#"{"base": {"kind": "sphere", "radius": 1}, "cyclic": [true, false, false]}"#, "bounds"),
        (r#"{"base": {"kind": "half-space"}}"#, "bounds"),
        (r#"{"base": {"kind": "sphere", "radius": 1}, "bounds": {"min": [0, 0, 0], "max": [0, 1, 1]}}"#, "bounds"),
    ] {
        let error = Hypertexture::source(&spec(text)).err().map(|e| e.to_string());
        assert!(error.as_ref().is_some_and(|e| e.contains(word)), "{text}: {error:?}");
    }
    assert!(
        serde_json::from_str::<HypertextureSpec>(r#"{"base": {"kind": "sphere", "radius": 1}, "oops": 1}"#).is_err()
    );
}
