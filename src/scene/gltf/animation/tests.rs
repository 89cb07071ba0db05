//! Animated nodes, morphs and skins against closed forms.

use std::f64::consts::FRAC_1_SQRT_2;

use serde_json::{Value, json};

use crate::geom::DVec3;
use crate::scene::gltf::tests::{Builder, U8, world};
use crate::scene::{Model, ReadOptions};

/// A file whose sampler goes through `times` and `values`.
fn animated(b: Builder, path: &str, kind: &str, times: &[f32], values: &[f32], way: &str) -> Builder {
    let mut b = b;
    let (input, output) = (b.floats("SCALAR", times), b.floats(kind, values));
    let one = json!({"channels": [{"sampler": 0, "target": {"node": 0, "path": path}}],
        "samplers": [{"input": input, "output": output, "interpolation": way}]});
    let mut list = b.json["animations"].as_array().cloned().unwrap_or_default();
    list.push(one);
    b.set("/animations", list.into())
}

fn at(b: &Builder, time: f64) -> Model {
    b.read_with(&ReadOptions { time: Some(time), ..ReadOptions::default() }).unwrap().model
}

fn refused(b: &Builder) -> String {
    b.read_with(&ReadOptions { time: Some(0.5), ..ReadOptions::default() }).unwrap_err().to_string()
}

/// Numbers come as f32, of size 1: a few of its roundings.
fn near(a: DVec3, b: DVec3) {
    assert!((a - b).length() < 1e-6, "{a} is not {b}");
}

#[test]
fn a_turning_node_turns_evenly() {
    // From no turn to a quarter about z in 2 s; the second key is the same turn by the other sign.
    let h = FRAC_1_SQRT_2 as f32;
    for sign in [1.0, -1.0] {
        let keys = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, sign * h, sign * h];
        let b = animated(Builder::triangle(), "rotation", "VEC4", &[1.0, 3.0], &keys, "LINEAR");
        for time in [0.0_f64, 1.0, 1.5, 2.0, 2.75, 3.0, 9.0] {
            let angle = (time.clamp(1.0, 3.0) - 1.0) * std::f64::consts::FRAC_PI_4;
            near(world(&at(&b, time))[1], DVec3::new(angle.cos(), angle.sin(), 0.0));
        }
        // At rest it stands as the file has it.
        assert_eq!(world(&b.model())[1], DVec3::X);
        let again = ReadOptions { time: Some(3.0 + 1.5), repeat: true, ..ReadOptions::default() };
        near(world(&b.read_with(&again).unwrap().model)[1], world(&at(&b, 1.5))[1]);
    }
}

#[test]
fn steps_lines_and_splines_go_through_known_values() {
    let step = animated(
        Builder::triangle(),
        "translation",
        "VEC3",
        &[0.0, 1.0, 2.0],
        &[0., 0., 0., 5., 0., 0., 7., 0., 0.],
        "STEP",
    );
    for (time, x) in [(0.0, 0.0), (0.999, 0.0), (1.0, 5.0), (1.5, 5.0), (2.0, 7.0), (3.0, 7.0)] {
        assert_eq!(world(&at(&step, time))[0].x, x, "{time}");
    }
    let line = animated(Builder::triangle(), "scale", "VEC3", &[0.0, 2.0], &[1., 1., 1., 3., 1., 1.], "LINEAR");
    assert_eq!(world(&at(&line, 0.5))[1].x, 1.5);
    // The cubic through p(0) = 0, p'(0) = 2, p(2) = 4, p'(2) = -6 is 2t + 4t² − 2t³: a segment 2 s long, so tangents count
    // by the second.
    let keys = [9., 0., 0., 0., 0., 0., 2., 0., 0., -6., 0., 0., 4., 0., 0., 9., 0., 0.];
    let spline = animated(Builder::triangle(), "translation", "VEC3", &[1.0, 3.0], &keys, "CUBICSPLINE");
    for time in [0.0, 0.25, 1.0, 1.6, 2.0] {
        let t: f64 = time;
        near(world(&at(&spline, 1.0 + t))[0], DVec3::X * (2.0 * t + 4.0 * t * t - 2.0 * t * t * t));
    }
}

#[test]
fn morphs_move_positions_and_heights() {
    let mut b = Builder::triangle();
    let heights = b.floats("VEC3", &[0., 1., 0., 0., 1., 0., 0., 1., 0.]);
    let (one, two) = (b.floats("VEC3", &[1.0; 9]), b.floats("VEC3", &[0., 0., 2., 0., 0., 2., 0., 0., 2.]));
    let b = b
        .attribute("_VTEX_HEIGHT", heights)
        .set("/meshes/0/primitives/0/targets", json!([{"POSITION": one}, {"POSITION": two, "_VTEX_HEIGHT": two}]));
    let line = animated(b, "weights", "SCALAR", &[0.0, 1.0], &[0., 0., 1., 0.5], "LINEAR");
    let m = at(&line, 0.5);
    assert_eq!(m.parts[0].positions[0], [0.5, 0.5, 1.0]);
    assert_eq!(m.parts[0].heights.as_ref().unwrap()[0], [0.0, 1.0, 0.5]);
    // Of a spline's key: the tangents of arrival of all targets, the values, the tangents of departure.
    let keys = [0., 0., 0., 0., 4., 8., 0., 0., 1., 0.5, 0., 0.];
    let spline = animated(line, "weights", "SCALAR", &[0.0, 1.0], &keys, "CUBICSPLINE");
    let spline = spline.set("/animations/0", json!({"channels": [], "samplers": []}));
    // At a half: half of the ends, and an eighth of the tangent at the first.
    let m = at(&spline, 0.5);
    assert_eq!(m.parts[0].positions[0], [0.5 + 0.5, 0.5 + 0.5, 0.5 + 0.5 + 2.0 * 1.25]);
}

#[test]
fn a_skin_of_two_bones_bends() {
    let mut b = Builder::triangle();
    let joints = b.array("VEC4", U8, &[0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0], 3);
    let weights = b.floats("VEC4", &[1., 0., 0., 0., 0.5, 0.5, 0., 0., 1., 0., 0., 0.]);
    let heights = b.floats("VEC3", &[0., 1., 0., 0., 1., 0., 0., 1., 0.]);
    let b = b
        .attribute("JOINTS_0", joints)
        .attribute("WEIGHTS_0", weights)
        .attribute("_VTEX_HEIGHT", heights)
        .set("/nodes", json!([{}, {"mesh": 0, "skin": 0}, {}]))
        .set("/scenes/0/nodes", json!([0, 1, 2]))
        .set("/skins", json!([{"joints": [2, 0]}]));
    let h = FRAC_1_SQRT_2 as f32;
    let b = animated(b, "rotation", "VEC4", &[0.0, 1.0], &[0., 0., 0., 1., 0., 0., h, h], "LINEAR");
    let m = at(&b, 1.0);
    let p = world(&m);
    // The first joint stands. The second has turned by a quarter: (1, 0, 0) half with it goes to half of (0, 1, 0), and
    // (0, 1, 0) wholly with it to (−1, 0, 0); heights turn alike.
    near(p[0], DVec3::ZERO);
    near(p[1], DVec3::new(0.5, 0.5, 0.0));
    near(p[2], DVec3::new(-1.0, 0.0, 0.0));
    let heights = m.parts[0].heights.as_ref().unwrap();
    for (height, wanted) in heights.iter().zip([[0.0, 1.0], [-0.5, 0.5], [-1.0, 0.0]]) {
        near(DVec3::from(height.map(f64::from)), DVec3::new(wanted[0], wanted[1], 0.0));
    }
}

#[test]
fn which_of_several_play() {
    let up = [0., 0., 0., 0., 1., 0.];
    let b = animated(Builder::triangle(), "translation", "VEC3", &[0.0, 1.0], &up, "LINEAR");
    let b = animated(b, "translation", "VEC3", &[0.0, 2.0], &[0., 0., 0., 0., 0., 8.], "LINEAR");
    let b = animated(b, "scale", "VEC3", &[0.0, 4.0], &[1., 1., 1., 5., 1., 1.], "LINEAR");
    let b = b.set("/animations/1/name", "walk".into());
    let m = at(&b, 1.0);
    assert_eq!(world(&m)[1], DVec3::new(2.0, 1.0, 0.0));
    assert!(m.warnings.iter().any(|(text, _)| text.contains("\"walk\" moves what one before it moves")));
    let only = |names: &[&str]| ReadOptions {
        time: Some(1.0),
        animations: names.iter().map(|n| (*n).to_owned()).collect(),
        ..ReadOptions::default()
    };
    assert_eq!(world(&b.read_with(&only(&["walk"])).unwrap().model)[1], DVec3::new(1.0, 0.0, 4.0));
    assert_eq!(world(&b.read_with(&only(&["2", "walk"])).unwrap().model)[1], DVec3::new(2.0, 0.0, 4.0));
    let error = b.read_with(&only(&["run"])).unwrap_err().to_string();
    assert!(error.contains("no animation is named run; the file has: 0, walk, 2"), "{error}");
}

#[test]
fn a_matrix_is_taken_apart_and_pointers_stand_still() {
    let b = Builder::triangle()
        .set("/nodes/0", json!({"mesh": 0, "matrix": [0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 1, 1, 1, 1]}));
    let b = animated(b, "translation", "VEC3", &[0.0], &[7., 0., 0.], "LINEAR");
    near(world(&at(&b, 0.5))[1], DVec3::new(7.0, 2.0, 0.0));
    let pointer = json!({"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": "/cameras/0"}}});
    let b = b.set("/animations/0/channels/0/target", pointer);
    assert_eq!(b.model().instances.len(), 1);
    assert_eq!(at(&b, 0.5).warnings.iter().filter(|(text, _)| text.contains("KHR_animation_pointer")).count(), 1);
}

#[test]
fn broken_animations_are_one_clear_line() {
    let nan = f32::NAN;
    let whole = [0., 0., 0., 1., 0., 0.];
    let cases: [(&[f32], &[f32], &str, &str); 7] = [
        (&[1.0, 0.5], &whole, "LINEAR", "input: times do not ascend: key 0 is at 1 s, key 1 at 0.5 s"),
        (&[0.0, nan], &whole, "LINEAR", "key 1 is at NaN s"),
        (&[-1.0, 0.0], &whole, "LINEAR", "key 0 is at -1 s"),
        (&[], &whole, "LINEAR", "has no keys"),
        (&[0.0, 1.0], &whole[..3], "LINEAR", "output: has 1 elements; 2 keys need 2"),
        (&[0.0, 1.0], &whole, "CUBICSPLINE", "has 2 elements; 2 keys as cubic splines need 6"),
        (&[0.0, 1.0], &[0., 0., 0., nan, 0., 0.], "LINEAR", "element 1 holds a NaN"),
    ];
    for (times, values, way, what) in cases {
        let error = refused(&animated(Builder::triangle(), "translation", "VEC3", times, values, way));
        assert!(error.contains(what), "{error}");
    }
    let sound = || animated(Builder::triangle(), "translation", "VEC3", &[0.0, 1.0], &whole, "LINEAR");
    let cases: [(&str, Value, &str); 4] = [
        ("/animations/0/samplers/0/interpolation", "EASE".into(), "\"EASE\" is not LINEAR"),
        ("/animations/0/channels/0/sampler", 3.into(), "samplers[3] does not exist"),
        ("/animations/0/channels/0/target/node", 9.into(), "nodes[9], which does not exist"),
        ("/animations/0/samplers/0/input", 99.into(), "accessors[99] does not exist"),
    ];
    for (pointer, value, what) in cases {
        let error = refused(&sound().set(pointer, value));
        assert!(error.contains(what), "{error}");
    }
    let never = ReadOptions { time: Some(f64::NAN), ..ReadOptions::default() };
    assert!(sound().read_with(&never).unwrap_err().to_string().contains("finite number of seconds"));
}
