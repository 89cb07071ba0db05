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
        open(&self.0.path().join("r.toml"), &OpenOptions::default(), crate::source::open)
    }
}

/// Facets of a recipe, in its own units.
#[derive(Debug, Default)]
struct Sums {
    area: f64,
    /// Area by colour's red, and by alpha.
    red: f64,
    there: f64,
    /// Sum of the area vectors.
    vector: DVec3,
    /// Volume of what is opaque, from the area vectors (divergence theorem), and from the points that are within.
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
            let mut room = None;
            let Some(p) = p.clip(corner, corner + width, &mut room) else { return };
            p.split_voxels(&mut |p, _| {
                let (area, at) = (p.area_vector(), p.corner_mean());
                let Some(normal) = area.try_normalize() else { return };
                let surface = staged.surface(p.facet, at, 0.0);
                let cut = staged.has_alpha(p.facet);
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
        s.within += f64::from(u8::from(staged.implicit_value(at) < 0.0));
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
    // Of 3.1 voxels' radius: facets around a sphere are (h / r)² / 4 larger than it, as of one that is drawn by itself.
    near(sums(many, 128).area, 40.0 * 4.0 * PI * 0.01, 0.03);
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
    let all = crate::source::open::dependencies(&f.0.path().join("r.toml"));
    let names: Vec<_> = all.iter().map(|p| p.file_name().unwrap().to_string_lossy().into_owned()).collect();
    assert_eq!(names, ["r.toml", "a b.json", "c.obj"]);
    assert_eq!(check(&f.0.path().join("r.toml"), &OpenOptions::default(), crate::source::open).unwrap(), 2);
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
    let error = open(&json, &OpenOptions::default(), crate::source::open).err().unwrap().to_string();
    assert!(error.contains("line 2, column") && error.contains("0 is not a number above 0"), "{error}");
    std::fs::write(&json, [b'{', 0xff]).unwrap();
    assert!(open(&json, &OpenOptions::default(), crate::source::open).err().unwrap().to_string().contains("UTF-8"));
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

#[test]
fn nodes_within_one_another_are_bounded() {
    let chain = |n: usize| {
        let mut text = String::from("[define.a0]\nsphere = { radius = 1 }\n");
        for i in 1..n {
            text += &format!("[define.a{i}]\nuse = \"a{}\"\n", i - 1);
        }
        Folder::new(&format!("{text}[[draw]]\nuse = \"a{}\"", n - 1))
    };
    // The node that is drawn uses the last of them.
    assert!(chain(63).open().is_ok());
    for n in [64, 700, 20_000] {
        let error = chain(n).open().err().unwrap().to_string();
        assert!(error.contains("more than 64 nodes"), "{n}: {error}");
    }
    // Recipes within count on: 40 and 40 nodes are too many.
    let outer = chain(40);
    std::fs::rename(outer.0.path().join("r.toml"), outer.0.path().join("inner.toml")).unwrap();
    let text = std::fs::read_to_string(chain(40).0.path().join("r.toml")).unwrap();
    outer.add("r.toml", &text.replace("sphere = { radius = 1 }", "source = \"inner.toml\""));
    assert!(outer.open().err().unwrap().to_string().contains("more than 64 nodes"));
}

#[test]
fn copies_within_copies_are_counted_again() {
    let nested = |counts: [u32; 3]| {
        let scatter = |n: u32| format!("scatter = {{ count = {n}, min = [0, 0, 0], max = [1, 1, 1] }}\n");
        let [a, b, c] = counts.map(scatter);
        Folder::new(&format!(
            "[define.a]\nsphere = {{ radius = 1 }}\n{a}[define.b]\nuse = \"a\"\n{b}[[draw]]\nuse = \"b\"\n{c}"
        ))
    };
    assert!(nested([100, 100, 100]).open().is_ok());
    let error = nested([2000, 2000, 2000]).open().err().unwrap();
    assert!(matches!(error, Error::Limit { needed: 8_004_002_000, allowed: 4_294_967_296, .. }), "{error}");
    // Recipes within count on.
    let outer = nested([1, 3000, 3000]);
    outer.add(
        "inner.toml",
        "[[draw]]\nsphere = { radius = 1 }\nscatter = { count = 500, min = [0, 0, 0], max = [1, 1, 1] }",
    );
    assert!(outer.open().is_ok());
    let text = std::fs::read_to_string(outer.0.path().join("r.toml")).unwrap();
    outer.add("r.toml", &text.replace("sphere = { radius = 1 }", "source = \"inner.toml\""));
    assert!(matches!(outer.open().err().unwrap(), Error::Limit { .. }));
    // Those that are held take memory.
    let read = crate::scene::ReadOptions { max_bytes: 1 << 20, ..Default::default() };
    let options = OpenOptions { read, ..OpenOptions::default() };
    let few = |n| open(&nested([1, 1, n]).0.path().join("r.toml"), &options, crate::source::open).map(|_| ());
    assert!(few(4000).is_ok());
    assert!(matches!(few(5000), Err(Error::Limit { allowed: 4096, .. })));
}

/// Trajectories take memory before anything of them is laid out: a million of them were 1.3 GB where 32 MB were allowed.
#[test]
fn emitters_are_weighed_before_they_emit() {
    let read = crate::scene::ReadOptions { max_bytes: 1 << 20, ..Default::default() };
    let options = OpenOptions { read, ..OpenOptions::default() };
    let opened = |counts: &[u32]| {
        let draw = |n: &u32| format!("[[draw]]\nemitter = {{ count = {n}, lifetime = 1, time_step = 0.1 }}\n");
        let files = Folder::new(&counts.iter().map(draw).collect::<String>());
        open(&files.0.path().join("r.toml"), &options, crate::source::open).map(|_| ())
    };
    // Twelve points of 88 bytes and the strand's own, some 1 200 bytes each.
    assert!(opened(&[700]).is_ok());
    assert!(matches!(opened(&[1_000_000]), Err(Error::Limit { allowed: 1_048_576, .. })));
    assert!(matches!(opened(&[700, 700]), Err(Error::Limit { .. })));
}

#[test]
fn the_published_schema_is_the_models() {
    let schema = serde_json::to_value(schemars::schema_for!(Recipe)).unwrap();
    if std::env::var_os("VTEX_BLESS").is_some() {
        let text = format!("{}\n", serde_json::to_string_pretty(&schema).unwrap());
        std::fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/recipe.schema.json"), text).unwrap();
        return;
    }
    let published: serde_json::Value = serde_json::from_str(SCHEMA).unwrap();
    assert!(schema == published, "run this test with VTEX_BLESS=1");
}

#[test]
fn files_are_read_as_the_recipe_says() {
    // A stack of 8³ values that rise by 10 along x, in distances of 1: from 40 on, it is solid from the middle on.
    let ramp: String = (0..512).map(|i| format!("{} ", i % 8 * 10)).collect();
    let nrrd =
        format!("NRRD0004\ntype: uchar\ndimension: 3\nsizes: 8 8 8\nspacings: 1 1 1\nencoding: text\n\n{ramp}\n");
    let with = |text: &str| {
        let f = Folder::new(&format!("[[draw]]\n{text}"));
        f.add("s.nrrd", &nrrd);
        f.add("c.csv", "id,t,x,y,z,radius\n1,0,0,0,0,1\n1,1,0,9,0,1\n");
        f.add("l.lsys", "#iterations 1\n#angle 90\naxiom: F\nF -> FF");
        f.add("f.l", "a {\nangle 4\naxiom F\n}\nb {\nangle 4\naxiom FFFF\n}");
        f.open().map(|s| s.bounds())
    };
    let size = |text: &str| with(text).unwrap_or_else(|e| panic!("{e}")).size();
    // Samples are the middles of cells 0 … 8; the value 35 is half-way between two of them.
    assert!((size("source = { file = \"s.nrrd\", iso = 35, sigma = 0 }").x - 4.0).abs() < 0.01);
    assert!(
        (size("source = { file = \"s.nrrd\", iso = 35, sigma = 0, spacing = [2, 1, 3] }") - DVec3::new(8.0, 8.0, 24.0))
            .length()
            < 0.02
    );
    assert!(size("source = { file = \"s.nrrd\", window = [60, 70], sigma = 0 }").x < 2.01);
    let table = "transfer = { points = [{ value = 55, opacity = 0 }, { value = 65, opacity = 0.5, colour = [1, 0, 0] }], gradient = [{ magnitude = 0, opacity = 0 }, { magnitude = 5, opacity = 1 }] }";
    let box_ = size(&format!("source = {{ file = \"s.nrrd\", sigma = 0, {table} }}"));
    assert!(box_.x < 3.01 && box_.x > 1.9, "{box_}");
    assert!((size("source = { file = \"c.csv\", width_scale = 3 }").x - 6.0).abs() < 0.2);
    // A flat ribbon of width 2 has no thickness, but what its bounds are wide.
    assert!(with("source = { file = \"c.csv\", section = \"flat\", curve = \"catmull-rom\" }").is_ok());
    assert!((size("source = { file = \"l.lsys\", iterations = 3 }").y - 8.0).abs() < 0.2);
    assert!((size("source = { file = \"f.l\", dialect = \"fractint\", name = \"b\" }").x - 4.0).abs() < 0.2);
    // A folder of slices.
    let f = Folder::new("[[draw]]\nsource = { file = \"slices\", iso = 100, spacing = [1, 1, 2] }");
    std::fs::create_dir(f.0.path().join("slices")).unwrap();
    for i in 0..4 {
        let side = if i == 0 { 0 } else { 255 };
        image::GrayImage::from_pixel(4, 4, image::Luma([side]))
            .save(f.0.path().join(format!("slices/{i}.png")))
            .unwrap();
    }
    // From the middle of a slice's distance, 2, below the second to half of it above the last; the filter moves the lower end.
    let height = f.open().unwrap().bounds().size().z;
    assert!((5.5..6.6).contains(&height), "{height}");
    assert_eq!(crate::source::open::dependencies(&f.0.path().join("r.toml")).len(), 5);
    for (text, want) in [
        ("source = { file = \"s.nrrd\", window = [9, 3] }", "line 2, column 38: a window needs two values that ascend"),
        (
            "source = { file = \"s.nrrd\",\n transfer = { points = [{ value = 1, opacity = 2 }] } }",
            "line 3, column 13: ",
        ),
        ("source = { file = \"s.nrrd\", transfer = { pionts = [] } }", "unknown field `pionts`"),
        ("source = { file = \"s.nrrd\", window = [3, 9], transfer = { iso = 3 } }", "either a window or a transfer"),
        (
            "source = { file = \"c.csv\", iso = 3 }",
            "line 2, column 28: iso says how image stacks are read; 'c.csv' is none",
        ),
        ("source = { file = \"s.nrrd\", angle = 3 }", "angle says how L-systems are read"),
    ] {
        let error = with(text).err().unwrap().to_string();
        assert!(error.contains(want), "{text}: {error}");
    }
}

#[test]
fn errors_are_told_of_the_node_they_are_in() {
    for (bad, what) in [
        ("implicit = { kind = \"sphere\", radius = -1 }", "radius"),
        ("hypertexture = { base = { kind = \"sphere\", radius = 1 }, gain = 1 }", "gain"),
        ("emitter = { count = 3, drag = -1 }", "drag"),
        ("sphere = { radius = 1 }\nalbedo = { noise = { scale = 1 } }", "albedo"),
        ("sphere = { radius = 1 }\ncone = { from = [0, 0, 0], to = [0, 1, 0], radii = [1, 0] }", "one shape"),
        ("union = []", "at least one"),
    ] {
        let good = "[[draw]]\nimplicit = { kind = \"sphere\", radius = 1 }\n[[draw]]\nemitter = { count = 1 }\n[[draw]]\nhypertexture = { base = { kind = \"sphere\", radius = 1 } }\nalbedo = \"#ffffff\"\n";
        let error = Folder::new(&format!("{good}[[draw]]\n{bad}")).open().err().unwrap().to_string();
        // The node's own lines, or its head.
        let lines = (8..=9 + bad.matches('\n').count()).map(|n| format!("line {n}, "));
        assert!(lines.clone().any(|l| error.contains(&l)) && error.contains(what), "{error}");
    }
}

#[test]
fn samples_are_right_and_say_the_same_in_json() {
    let mut seen = 0;
    for folder in ["recipes", "hypertextures"] {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(folder);
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            assert!(check(&path, &OpenOptions::default(), crate::source::open).unwrap() > 0, "{}", path.display());
            let text = std::fs::read_to_string(&path).unwrap();
            let value: serde_json::Value = toml::from_str(&text).unwrap();
            let (toml, json) = (from_toml(&text).unwrap(), from_json(&value.to_string()).unwrap());
            assert_eq!(format!("{toml:?}"), format!("{json:?}"), "{}", path.display());
            seen += 1;
        }
    }
    assert!(seen >= 12);
}
