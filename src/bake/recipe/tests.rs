//! Recipes against closed forms, each drawing mode against what it says, and hostile ones.

use std::f64::consts::PI;
use std::path::PathBuf;

use super::*;
use crate::bake::{Options, plan};
use crate::geom::{Aabb, DVec3};
use crate::morton;
use crate::progress::Quiet;

/// A folder with a recipe.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new(text: &str) -> Folder {
        let folder = Folder(tempfile::tempdir().unwrap());
        folder.add("r.toml", text);
        folder
    }

    fn add(&self, name: &str, text: &str) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    fn open(&self) -> Result<Box<dyn Source>> {
        open(&self.0.path().join("r.toml"), &OpenOptions::default())
    }
}

/// What a recipe is made of, in its own units.
#[derive(Debug, Default)]
struct Sums {
    area: f64,
    /// Area by colour's red, and by alpha.
    red: f64,
    there: f64,
    /// Of area vectors.
    vector: DVec3,
    /// Of what is opaque, from the area vectors (divergence theorem), and from the points that are within.
    volume: f64,
    within: f64,
    /// Area by the normal that is shown: |x|.
    shown: f64,
}

fn sums(text: &str, resolution: u32) -> Sums {
    let source = Folder::new(text).open().unwrap_or_else(|e| panic!("{e}"));
    let place = plan(source.bounds(), &Options { resolution, up: 2, ..Options::default() }).unwrap();
    let staged = source.stage(&place, &Quiet).unwrap();
    let levels = place.region_log2();
    let width = f64::from(1u32 << levels);
    let mut s = Sums::default();
    for (i, &code) in staged.regions().iter().enumerate() {
        let corner = DVec3::from(morton::decode(code).map(f64::from)) * width;
        staged.emit(i, &mut |p| {
            let Some(p) = p.clip(corner, corner + width) else { return };
            p.split_voxels(&mut |p, _| {
                let (area, at) = (p.area_vector(), p.middle());
                let Some(normal) = area.try_normalize() else { return };
                let surface = staged.surface(p.facet, at, 0.0);
                let cut = staged.cut_out(p.facet);
                s.area += area.length();
                s.red += area.length() * f64::from(surface.albedo[0]);
                s.there += area.length() * if cut { f64::from(surface.alpha) } else { 1.0 };
                s.shown += area.length() * staged.normal(p.facet, at, normal).x.abs();
                if staged.one_sided(p.facet) {
                    s.vector += area;
                    s.volume += area.dot(at) / 3.0;
                }
            });
        });
    }
    let side = place.side();
    for code in 0..u64::from(side).pow(3) {
        let at = DVec3::from(morton::decode(code).map(f64::from)) + 0.5;
        s.within += f64::from(u8::from(staged.level(at) < 0.0));
    }
    let unit = 1.0 / place.scale;
    for area in [&mut s.area, &mut s.red, &mut s.there, &mut s.shown] {
        *area *= unit * unit;
    }
    s.vector *= unit * unit;
    s.volume *= unit.powi(3);
    s.within *= unit.powi(3);
    s
}

#[track_caller]
fn near(got: f64, want: f64, tolerance: f64) {
    assert!((got - want).abs() <= tolerance * want.abs(), "{got}, not {want}");
}

#[test]
fn solids_have_their_area_and_volume() {
    // (recipe, area, volume). A facet's chord is off by (h/r)²/8 of its radius: .01 % at 64 voxels across; creases take more.
    let cases = [
        ("sphere = { radius = 1 }", 4.0 * PI, 4.0 / 3.0 * PI),
        ("box = { min = [0, 0, 0], max = [1, 2, 3] }", 22.0, 6.0),
        (
            "box = { corner = [0, 0, 0], edges = [[2, 0, 0], [1, 2, 0], [0, 0, 2]] }",
            16.0 + 4.0 * 5f64.sqrt() + 4.0 - 4.0,
            8.0,
        ),
        ("cylinder = { from = [0, 0, 0], to = [1, 2, 2], radius = 1 }", 8.0 * PI, 3.0 * PI),
        ("cone = { from = [0, 0, 0], to = [0, 0, 2], radii = [1.5, 0] }", PI * 1.5 * (1.5 + 2.5), PI * 1.5),
        ("torus = { axis = [1, 1, 0], radius = 2, thickness = 0.5 }", 4.0 * PI * PI, PI * PI),
        ("ellipsoid = { radii = [1, 1, 2] }", oblate(), 8.0 / 3.0 * PI),
    ];
    for (shape, area, volume) in cases {
        let s = sums(&format!("[[draw]]\n{shape}"), 64);
        println!(
            "{shape}: area {:.5} volume {:.5} within {:.4} open {:.1e}",
            s.area / area,
            s.volume / volume,
            s.within / volume,
            s.vector.length() / area
        );
        // A cone's rim and tip, slanted across voxels, lose a hundredth of its area.
        near(s.area, area, 0.013);
        near(s.volume, volume, 0.013);
        // Middles of voxels, counted: flat faces are off by up to half a voxel.
        near(s.within, volume, 0.02);
        assert!(s.vector.length() < 1e-6 * area, "{shape} closes: {}", s.vector);
    }
}

/// Area of the ellipsoid of radii 1, 1, 2.
fn oblate() -> f64 {
    let e = (3f64 / 4.0).sqrt();
    2.0 * PI * (1.0 + 2.0 / e * e.asin())
}

#[test]
fn the_area_of_a_sphere_converges_with_the_square_of_the_voxel() {
    let error = |r: u32| (sums("[[draw]]\nsphere = { radius = 1 }", r).area / (4.0 * PI) - 1.0).abs();
    let (coarse, fine) = (error(16), error(64));
    // Order 2 would be 16 times; a little is left for where facets happen to lie.
    assert!(coarse > 8.0 * fine, "{coarse} {fine}");
}

#[test]
fn csg_is_exact_at_creases() {
    // A cube of edge 2 and a ball of radius 1 about its corner: an eighth of the ball is cut out.
    let pair = "[{ box = { min = [0, 0, 0], max = [2, 2, 2] } }, { sphere = { centre = [2, 2, 2], radius = 1 } }]";
    let eighth = PI / 6.0;
    let cases = [
        ("difference", 24.0 - 3.0 * PI / 4.0 + PI / 2.0, 8.0 - eighth),
        ("intersection", 3.0 * PI / 4.0 + PI / 2.0, eighth),
        ("union", 24.0 - 3.0 * PI / 4.0 + 3.5 * PI, 8.0 + 7.0 * eighth),
    ];
    for (operation, area, volume) in cases {
        let s = sums(&format!("[[draw]]\n{operation} = {pair}"), 64);
        println!(
            "{operation}: area {:.5} volume {:.5} within {:.4} open {:.1e}",
            s.area / area,
            s.volume / volume,
            s.within / volume,
            s.vector.length() / area
        );
        near(s.area, area, 0.005);
        near(s.volume, volume, 0.005);
        near(s.within, volume, 0.02);
        // Two surfaces that are cut by one another agree to a part of a voxel along the crease.
        assert!(s.vector.length() < 1e-3 * area, "{operation} closes: {}", s.vector);
    }
}

#[test]
fn flush_faces_are_neither_doubled_nor_left() {
    // Two boxes that touch, two with a common face, and a box cut off along its own face.
    let boxes = |op: &str, b: &str| {
        sums(&format!("[[draw]]\n{op} = [{{ box = {{ min = [0, 0, 0], max = [1, 1, 1] }} }}, {{ box = {b} }}]"), 32)
    };
    near(boxes("union", "{ min = [1, 0, 0], max = [2, 1, 1] }").area, 10.0, 0.003);
    near(boxes("union", "{ min = [0.5, 0, 0], max = [2, 1, 1] }").area, 10.0, 0.003);
    near(boxes("difference", "{ min = [0.5, 0, 0], max = [2, 1, 1] }").area, 4.0, 0.003);
    near(boxes("intersection", "{ min = [0.5, 0, 0], max = [2, 1, 1] }").area, 4.0, 0.003);
}

const BALL_AND: &str = "[[draw]]\nsphere = { radius = 1 }\nalbedo = [0.5, 0.5, 0.5]\n[[draw]]\n";

#[test]
fn every_mode_does_what_it_says() {
    let half = "box = { min = [0, -2, -2], max = [2, 2, 2] }";
    let of = |mode: &str| {
        sums(
            &format!(
                "{BALL_AND}{half}\nalbedo = [1, 0, 0]\nmode = \"{mode}\"{}",
                match mode {
                    "opacity" => "\nopacity = 0.25",
                    "threshold" => "\nopacity = 0.5",
                    _ => "",
                }
            ),
            64,
        )
    };
    let (ball, block) = (4.0 * PI, 2.0 * 16.0 + 4.0 * 8.0);
    near(of("add").area, ball + block, 0.004);
    let set = of("set");
    // The half of the ball within is gone; of the block's face, what the other half hides.
    near(set.area, ball / 2.0 + block - PI, 0.004);
    near(set.red, ball / 4.0 + block - PI, 0.004);
    let cut = of("subtract");
    near(cut.area, ball / 2.0 + PI, 0.004);
    near(cut.red, ball / 4.0 + PI, 0.004);
    near(cut.volume, 2.0 / 3.0 * PI, 0.004);
    let kept = of("multiply");
    near(kept.area, ball / 2.0 + PI, 0.004);
    near(kept.within, 2.0 / 3.0 * PI, 0.02);
    let normals = of("normals");
    near(normals.area, ball, 0.004);
    near(normals.red, ball / 2.0, 0.004);
    // Half of it shows its own normals: the mean of |x| is 1/2; of the rest, what is nearest to the plane shows x.
    assert!(normals.shown > ball / 4.0 && normals.shown < 0.99 * ball, "{normals:?}");
    let thin = of("opacity");
    near(thin.area, ball, 0.004);
    near(thin.there, ball * 0.625, 0.004);
    let gone = of("threshold");
    near(gone.there, ball, 0.004);
    let gone = sums(
        &format!(
            "[[draw]]\nsphere = {{ radius = 1 }}\nopacity = 0.4\n[[draw]]\n{half}\nmode = \"threshold\"\nopacity = 0.5"
        ),
        64,
    );
    near(gone.there, ball * 0.5 * 0.4, 0.01);
}

#[test]
fn implicit_functions_noise_and_bumps() {
    let s = sums("[[draw]]\nimplicit = { kind = \"sphere\", radius = 1 }", 32);
    near(s.area, 4.0 * PI, 0.005);
    let rough = "albedo = { noise = { scale = 0.3 }, colours = [[0, 0, 0], [1, 1, 1]] }\nbump = { noise = { scale = 0.2, seed = 3 }, height = 0.02 }";
    let s = sums(&format!("[[draw]]\nsphere = {{ radius = 1 }}\n{rough}"), 64);
    near(s.area, 4.0 * PI, 0.004);
    // Noise is 0 in the mean, to what some hundred cells of it leave; |x| of normals all around is 1/2, tilted or not.
    near(s.red, 2.0 * PI, 0.1);
    near(s.shown, 2.0 * PI, 0.05);
    assert!(
        Folder::new("[[draw]]\nimplicit = { kind = \"blob\" }").open().err().unwrap().to_string().contains("line 2")
    );
}

#[test]
fn sheets_and_lines_have_their_area() {
    let s = sums("[[draw]]\ntriangle = { corners = [[0, 0, 0], [3, 0, 0], [0, 4, 0]] }", 32);
    near(s.area, 6.0, 1e-6);
    let s = sums(
        "bounds = { min = [0, 0, 0], max = [1, 1, 1] }\n[[draw]]\nplane = { point = [0.5, 0.5, 0.5], normal = [1, 1, 0] }",
        32,
    );
    near(s.area, 2f64.sqrt(), 1e-6);
    let s = sums("[[draw]]\nline = { points = [[0, 0, 0], [0, 0, 5]], width = 0.5, section = \"rectangular\" }", 32);
    near(s.area, 2.5, 1e-6);
    let s = sums("[[draw]]\nline = { points = [[0, 0, 0], [0, 3, 4]], width = 0.5 }", 64);
    near(s.area, PI * 0.5 * 5.0 + PI / 8.0, 0.01);
    // Both sheets of the V are half as wide again by the angle: w / (2 sin 45°) each.
    let s = sums("[[draw]]\nblade = { from = [0, 0, 0], to = [0, 0, 2], width = 0.2, tip = 0.2 }", 64);
    near(s.area, 2.0 * 2.0 * 0.1 * 2f64.sqrt(), 1e-3);
}

#[test]
fn places_and_copies() {
    let s =
        sums("[[draw]]\nbox = { size = [1, 1, 1] }\nscale = [2, 1, 1]\nrotate = [0, 0, 90]\ntranslate = [5, 5, 5]", 32);
    near(s.volume, 2.0, 0.005);
    let recipe = "[[draw]]\nbox = { size = [1, 1, 1] }\nscale = 2\nrotate = { axis = [0, 0, 1], degrees = 90 }\nmatrix = [[1, 0, 0, 7], [0, 1, 0, 8], [0, 0, 1, 9]]";
    let b = Folder::new(recipe).open().unwrap().bounds();
    assert!((b.min - DVec3::new(6.0, 7.0, 8.0)).length() < 1e-9, "{b:?}");
    let many = "[define.pebble]\nsphere = { radius = 0.1 }\n[[draw]]\nuse = \"pebble\"\nscatter = { count = 40, min = [0, 0, 0], max = [4, 0, 4], apart = 0.25, seed = 3 }";
    near(sums(many, 128).area, 40.0 * 4.0 * PI * 0.01, 0.02);
    let model: Recipe = toml::from_str(many).unwrap();
    let places = scatter::places(model.draw[0].scatter.as_ref().unwrap());
    for (i, a) in places.iter().enumerate() {
        for b in &places[..i] {
            assert!(a.translation.distance(b.translation) >= 0.25);
        }
    }
}

#[test]
fn bounds_are_what_is_baked() {
    let source = Folder::new("bounds = { min = [-1, -1, -1], max = [1, 1, 1] }\n[[draw]]\nhalf_space = { point = [0, 0, 0], normal = [0, 1, 0] }").open().unwrap();
    assert_eq!(source.bounds(), Aabb::new(DVec3::splat(-1.0), DVec3::ONE));
}

#[test]
fn recipes_and_files_within() {
    let f = Folder::new(
        "[[draw]]\nsource = \"a b.json\"\ntranslate = [1, 0, 0]\n[[draw]]\nsource = { file = \"c.obj\", fill = \"solid\" }\nmode = \"subtract\"",
    );
    f.add("a b.json", r#"{ "draw": [{ "sphere": { "radius": 1 } }] }"#);
    f.add("c.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let source = f.open().unwrap();
    assert!((source.bounds().max.x - 2.0).abs() < 1e-9);
    let all = crate::bake::dependencies(&f.0.path().join("r.toml"));
    let names: Vec<_> = all.iter().map(|p| p.file_name().unwrap().to_string_lossy().into_owned()).collect();
    assert_eq!(names, ["r.toml", "a b.json", "c.obj"]);
    assert_eq!(check(&f.0.path().join("r.toml"), &OpenOptions::default()).unwrap(), 2);
    f.add("a b.json", r#"{ "draw": [{ "source": "r.toml" }] }"#);
    assert!(f.open().err().unwrap().to_string().contains("draws itself"));
}

#[test]
fn errors_say_where() {
    let cases = [
        ("[[draw]]\nsphere = { radius = -1 }", "line 2, column 21: -1 is not a number above 0"),
        ("[[draw]]\nsphere = { radius = nan }", "line 2, column 21"),
        ("[[draw]]\nspher = { radius = 1 }", "line 2, column 1: unknown field `spher`"),
        ("[[draw]]\nsphere = { radius = 1, radii = 2 }", "line 2, column 24: unknown field"),
        ("[[draw]]\nsphere = { radius = 1 }\nalbedo = \"#12\"", "line 3, column 10: '#12' is not a colour"),
        ("[[draw]]\nsphere = { radius = 1 }\nalbedo = { image = 3 }", "line 3, column 20"),
        ("[[draw]]\nsphere = { radius = 1 }\nscale = 0", "line 3, column 9"),
        ("[[draw]]\nsphere = { radius = 1 }\nbox = { size = [1, 1, 1] }", "one shape"),
        ("[[draw]]\nmode = \"add\"", "needs a shape"),
        ("[[draw]]\nbox = { min = [0, 0, 0], max = [1, 0, 1] }", "line 2, column 7"),
        (
            "[[draw]]\nhalf_space = { point = [0, 0, 0], normal = [0, 0, 1] }",
            "line 2, column 1: a half_space has no end",
        ),
        ("[[draw]]\nuse = \"x\"", "line 2, column 7: 'x' is not defined"),
        ("[define.x]\nuse = \"x\"\n[[draw]]\nuse = \"x\"", "draws itself"),
        ("[[draw]]\nsource = \"no such.glb\"", "line 2, column 10: the file 'no such.glb' is not there"),
        ("[[draw]]\nunion = []", "line 1"),
        ("[[draw", "line 1"),
    ];
    for (text, want) in cases {
        let error = Folder::new(text).open().err().unwrap().to_string();
        assert!(error.contains(want), "{text}: {error}");
        assert!(!error.contains('\n') && error.contains("r.toml"), "{error}");
    }
    let f = Folder::new("");
    let json = f.add("x.json", "{ \"draw\": [\n { \"sphere\": { \"radius\": 0 } } ] }");
    let error = open(&json, &OpenOptions::default()).err().unwrap().to_string();
    assert!(error.contains("line 2, column") && error.contains("0 is not a number above 0"), "{error}");
    std::fs::write(&json, [b'{', 0xff]).unwrap();
    assert!(open(&json, &OpenOptions::default()).err().unwrap().to_string().contains("UTF-8"));
}

#[test]
fn laughs_and_depths_are_bounded() {
    // Ten levels of ten: drawn once each, because what is drawn by name is shared.
    let mut text = String::from("[define.a0]\nsphere = { radius = 1 }\n");
    for i in 1..10 {
        let uses = format!("{{ use = \"a{}\" }}, ", i - 1).repeat(10);
        text += &format!("[define.a{i}]\ngroup = [{uses}]\n");
    }
    assert!(Folder::new(&format!("{text}[[draw]]\nuse = \"a9\"")).open().is_ok());
    // By modes they cannot be shared.
    let text = text.replace("{ use", "{ mode = \"set\", use");
    let error = Folder::new(&format!("{text}[[draw]]\nuse = \"a9\"")).open().err().unwrap();
    assert!(matches!(error, Error::Limit { .. }), "{error}");
    let deep =
        format!("[[draw]]\ngroup = {}{{ sphere = {{ radius = 1 }} }}{}", "[{ group = ".repeat(5000), "}]".repeat(5000));
    assert!(Folder::new(&deep).open().is_err());
    let error = Folder::new(
        "[[draw]]\nsphere = { radius = 1 }\nscatter = { count = 4000000000, min = [0, 0, 0], max = [1, 1, 1] }",
    )
    .open()
    .err()
    .unwrap();
    assert!(matches!(error, Error::Limit { .. }), "{error}");
    assert!(Folder::new("").open().unwrap().bounds().is_empty());
}

/// Names of properties, by definition.
fn properties(schema: &serde_json::Value) -> Vec<(String, Vec<String>)> {
    let names = |v: &serde_json::Value| {
        let mut keys: Vec<String> = v["properties"].as_object().into_iter().flatten().map(|(k, _)| k.clone()).collect();
        keys.sort_unstable();
        keys
    };
    let mut all: Vec<(String, Vec<String>)> =
        schema["$defs"].as_object().into_iter().flatten().map(|(name, v)| (name.clone(), names(v))).collect();
    all.push(("Recipe".into(), names(schema)));
    all.retain(|(_, keys)| !keys.is_empty());
    all.sort_unstable();
    all
}

#[test]
fn the_published_schema_has_the_models_properties() {
    let schema = serde_json::to_value(schemars::schema_for!(Recipe)).unwrap();
    if std::env::var_os("VTEX_BLESS").is_some() {
        let text = format!("{}\n", serde_json::to_string_pretty(&schema).unwrap());
        std::fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/recipe.schema.json"), text).unwrap();
        return;
    }
    let published: serde_json::Value = serde_json::from_str(SCHEMA).unwrap();
    assert_eq!(properties(&schema), properties(&published), "run this test with VTEX_BLESS=1");
}
