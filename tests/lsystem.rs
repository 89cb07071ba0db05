//! L-systems from the outside: samples and their counts, areas in closed form, errors, surfaces, limits.

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use vtex::bake::{self, Options};
use vtex::format::{Limits, Reader};
use vtex::geom::{DAffine3, directions13};
use vtex::source;
use vtex::source::{OpenOptions, lsystem};

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/lsystems").join(name)
}

fn vtex(dir: &Path, args: &[&str]) -> (i32, String, String) {
    let run = Command::cargo_bin("vtex").unwrap().current_dir(dir).args(args).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (run.status.code().unwrap(), text(&run.stdout), text(&run.stderr))
}

/// Bake `text` with `args`, which fails: exit code and the line that says why.
fn fails(text: &str, args: &[&str]) -> (i32, String) {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("x.lsys"), text).unwrap();
    let (code, _, err) = vtex(dir.path(), &[&["bake", "x.lsys", "-r", "16"], args].concat());
    let line = err.lines().find(|l| l.starts_with("error: ")).unwrap_or_default().to_owned();
    assert!(code != 0 && !dir.path().join("x.vtex").exists(), "{text} {err}");
    (code, line)
}

#[test]
fn the_samples_and_what_they_draw() {
    let count = |name: &str| lsystem::count(&sample(name), &Default::default(), 1 << 30).unwrap().0;
    // Of the paper's tree: 2 154 branches, 6 336 leaves.
    let tree = count("tree.lsys");
    assert!(tree.segments.abs_diff(2154) < 150 && tree.polygons.abs_diff(6336) < 450, "{tree:?}");
    for (name, segments) in [
        ("plant-a", 3125),
        ("plant-b", 3125),
        ("plant-c", 4096),
        ("plant-d", 4118),
        ("plant-e", 4118),
        ("plant-f", 1488),
    ] {
        let plant = count(&format!("{name}.lsys"));
        assert_eq!((plant.segments, plant.polygons), (segments, 0), "{name}");
    }
    for name in ["spruce", "willow", "fern", "flower"] {
        let plant = count(&format!("{name}.lsys"));
        assert!(plant.segments > 40 && plant.polygons > 50, "{name} {plant:?}");
        let source = source::open(&sample(&format!("{name}.lsys")), &OpenOptions::default()).unwrap();
        assert!(source.warnings().is_empty() && source.has_colour(), "{name} {:?}", source.warnings());
        assert_eq!(source.metres_per_unit(), 1.0);
    }
}

/// Projected areas of the baked root, an axis.
fn sigma(text: &str, resolution: u32) -> [f64; 13] {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.lsys");
    std::fs::write(&path, text).unwrap();
    let source = source::open(&path, &OpenOptions::default()).unwrap();
    let mut place = source::Placement {
        bounds: source.bounds(),
        transform: DAffine3::IDENTITY,
        // What lies on the cube's upper faces would belong to the next one.
        scale: f64::from(resolution) / source.bounds().size().max_element() * (1.0 - 1e-9),
        depth: resolution.trailing_zeros() as usize,
        up: 1,
        cyclic: [false; 3],
        memory: u64::MAX,
    };
    place.bounds.max = place.bounds.min + source.bounds().size().max_element();
    let staged = source.stage(&place, &vtex::progress::Quiet).unwrap();
    // Facets may come in several regions: only what lies in the region counts.
    let mut areas = [0.0; 13];
    for (i, &code) in staged.regions().iter().enumerate() {
        let width = f64::from(1u32 << place.region_log2());
        let lo = vtex::geom::DVec3::from(vtex::morton::decode(code).map(|v| f64::from(v) * width));
        staged.emit(i, &mut |facet| {
            let mut room = None;
            if let Some(piece) = facet.clip(lo, lo + width, &mut room) {
                for (sum, axis) in areas.iter_mut().zip(directions13()) {
                    *sum += 0.5 * piece.area_vector().dot(axis).abs() / place.scale.powi(2);
                }
            }
        });
    }
    areas
}

#[test]
fn a_straight_stem_has_a_cylinders_shadow() {
    // A stem of length 10 and width 1 in ten pieces: 10 · sin + π/4 · |cos| from every side, ends included.
    let areas = sigma("axiom: !(1)FFFFFFFFFF", 64);
    for (area, axis) in areas.iter().zip(directions13()) {
        // Axes u, v, w are x, −z, y: the stem stands along w.
        let (along, across) = (axis.z.abs(), (1.0 - axis.z * axis.z).sqrt());
        let exact = 10.0 * across + std::f64::consts::FRAC_PI_4 * along;
        // Sides are chosen for a sixteenth of a voxel: 1/100 of the width here.
        assert!((area / exact - 1.0).abs() < 0.02, "{axis} {area} {exact}");
    }
    // A cone from width 1 to 0: half the cylinder's profile from its side.
    let cone = sigma("axiom: !(1)F(10, 0)", 64);
    assert!((cone[0] / 5.0 - 1.0).abs() < 0.02, "{}", cone[0]);
    // A square of 2 · 2, in any plane, has its area.
    let leaf = sigma("#surface L { -1 0, 1 0, 1 2, -1 2 }\naxiom: &(30)/(20)~L", 32);
    let mut whole = 0.0;
    for (area, axis) in leaf.iter().zip(directions13()).take(3) {
        assert_eq!(axis.length(), 1.0);
        whole += (2.0 * area) * (2.0 * area);
    }
    // A sheet: areas along the three axes are those of its area vector; positions are f32.
    assert!((whole.sqrt() / 4.0 - 1.0).abs() < 1e-5, "{whole}");
}

#[test]
fn errors_are_one_line_with_a_place() {
    for (text, args, code, want) in [
        ("axiom: F\nF -> F=F", &[][..], 1, "x.lsys: line 2, column 7: '='"),
        ("axiom: F\nF -> FF", &[], 2, "--iterations"),
        ("axiom: F", &["--string", "F]"], 2, "--string: line 1, column 2: ']'"),
        ("axiom: F\nF -> FF", &["--iterations", "60", "--max-symbols", "100000"], 1, "--max-symbols"),
        ("#iterations 1000000000\naxiom: F\nF -> F", &["--max-symbols", "1000000"], 1, "--max-symbols"),
        ("#surface L \"no.glb\"\naxiom: ~L", &[], 1, "line 1, column 12: there is no file no.glb"),
        ("#surface L \"x.lsys\"\naxiom: ~L", &[], 1, "x.lsys is no mesh"),
        ("axiom: f", &[], 1, "nothing in it to bake"),
        ("\u{0}\u{1}PNG", &[], 1, "U+0000"),
        ("", &[], 1, "axiom"),
    ] {
        let (got, line) = fails(text, args);
        assert!(got == code && line.contains(want), "{text:?} {args:?}: {got} {line}");
    }
    assert_eq!(vtex(Path::new("."), &["bake"]).0, 2);
}

#[test]
fn strings_options_and_surfaces() {
    let dir = tempfile::tempdir().unwrap();
    let save = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    let baked = |name: &str| {
        super::readable::verify(&dir.path().join(name));
        let reader = Reader::open(dir.path().join(name), &Limits::default()).unwrap();
        reader.read_all().unwrap().info.bounds.size().max_element()
    };
    let run = |args: &[&str]| {
        let (code, _, err) = vtex(dir.path(), args);
        assert_eq!(code, 0, "{args:?} {err}");
    };
    // Without a file: named by what it is; turned by --angle.
    run(&["bake", "--string", "F(3)+F(4)", "--angle", "90", "-r", "16"]);
    assert!((baked("string.vtex") - 4.0).abs() < 0.2);
    save("a.lsys", "#iterations 1\n#define l 2\naxiom: F\nF -> FF");
    for (args, size) in [(&[][..], 2.0), (&["--iterations", "3"], 8.0), (&["--string", "F(l)F(l)F(l)"], 6.0)] {
        run(&[&["bake", "a.lsys", "-r", "16"], args].concat());
        assert!((baked("a.vtex") - size).abs() < 0.2, "{args:?} {}", baked("a.vtex"));
    }
    // A surface from a mesh, that is in the depfile with what it names; many copies of it.
    save("my leaf.obj", "mtllib l.mtl\nusemtl green\nv -1 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n");
    save("l.mtl", "newmtl green\nKd 0 1 0\n");
    save("b.lsys", "#iterations 6\n#surface L \"my leaf.obj\"\naxiom: A\nA -> F[+(60)~L(.5)][-(60)~L(.5)]A");
    run(&["bake", "b.lsys", "-r", "64", "--depfile", "b.d"]);
    let rule = std::fs::read_to_string(dir.path().join("b.d")).unwrap();
    assert_eq!(rule, "b.vtex: b.lsys \\\n  my\\ leaf.obj \\\n  l.mtl\n\nb.lsys:\n\nmy\\ leaf.obj:\n\nl.mtl:\n");
    let (_, out, _) = vtex(dir.path(), &["inspect", "b.vtex", "--json"]);
    assert!(out.contains("my leaf.obj"), "{out}");
}

#[test]
fn seeds_and_threads() {
    let dir = tempfile::tempdir().unwrap();
    let text = "#iterations 4\naxiom: A\nA -> F[+(ran(60))A][-(ran(60))A] : .7\nA -> FA : .3";
    std::fs::write(dir.path().join("s.lsys"), text).unwrap();
    let bytes = |args: &[&str]| {
        let (code, _, err) = vtex(dir.path(), &[&["bake", "s.lsys", "-r", "64"], args].concat());
        assert_eq!(code, 0, "{err}");
        std::fs::read(dir.path().join("s.vtex")).unwrap()
    };
    let one = bytes(&["--threads", "1", "--seed", "3"]);
    assert!(one == bytes(&["--threads", "3", "--seed", "3"]));
    assert!(one != bytes(&["--seed", "4"]));
}

/// What is baked of the grammar `text`, saved as `name`.
fn depths(name: &str, text: &str, dialect: Option<source::lsystem::Dialect>) -> Vec<vtex::volume::Depth> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, text).unwrap();
    let lsystem = source::LSystemOptions { dialect, iterations: Some(4), ..Default::default() };
    let source = source::open(&path, &OpenOptions { lsystem, ..OpenOptions::default() }).unwrap();
    let options = Options { resolution: 32, ..Options::default() };
    bake::bake(&*source, &options, &vtex::progress::Quiet, &mut |_| {}).unwrap().0.depths
}

#[test]
fn notations_give_the_same_texel() {
    let book = |head: &str| depths("a.lsys", &format!("{head}axiom: X\nX -> F[+X]F[-X]+X\nF -> FF"), None);
    let want = book("#angle 20\n");
    for (name, text, dialect) in [
        ("a.l", "#define A F[+(20)X]F[-(20)X]+(20)X\nLsystem: 1\nAxiom: X\nX --> A\nF --> FF\nendlsystem\n", None),
        ("a.ls", "[L-System]\naxiom=x\nrule0=x>F[-x]F[+x]-x\nrule1=F>FF\nangle=20\nlineLength=1\nrotation=270\n", None),
        ("b.lsys", "angle=20\npremise=X\nX=F[-X]F[+X]-X\nF=FF\n", Some(source::lsystem::Dialect::Houdini)),
    ] {
        assert!(depths(name, text, dialect) == want, "{name}");
    }
    // L-Py begins with brown lines, twice as wide.
    let brown = book("#angle 60\n#width .2\n#colour 0 195/255, 135/255, 45/255\n");
    let lpy = "Axiom: X\nproduction:\nX :\n  nproduce F[+X]\n  if 1:\n    produce F[-X]+X\nF --> FF\n";
    assert!(depths("a.lpy", lpy, None) == brown);
}

#[test]
fn notations_are_told_asked_for_and_chosen() {
    let dir = tempfile::tempdir().unwrap();
    let save = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    save("f.l", "One { ; x\nAngle 4\nAxiom F+F\n}\nTwo {\nAngle 6\nAxiom F+F\nF=F+F\n}\n");
    save("g.l", "%%\n");
    let run = |args: &[&str]| vtex(dir.path(), &[&["bake", "-r", "16"], args].concat());
    let (code, _, err) = run(&["f.l", "--name", "two", "--iterations", "2"]);
    assert!(code == 0 && err.contains("read as a Fractint file"), "{err}");
    for (args, code, what) in [
        (&["f.l"][..], 2, "give --name: One, Two"),
        (&["f.l", "--name", "six"], 2, "there is no system six; there are: One, Two"),
        (&["f.l", "--name", "Two"], 2, "--iterations"),
        (&["g.l"], 2, "give --dialect, one of: book, fractint, cpfg, lpy, ini, houdini, rubberplant"),
        (&["g.l", "--dialect", "cpfg"], 1, "line 1, column 1"),
        (&["f.l", "--dialect", "xml"], 2, "xml"),
    ] {
        let (got, _, err) = run(args);
        assert!(got == code && err.contains(what), "{args:?}: {got} {err}");
    }
    // The view file and the map are among what a grammar is made of.
    save("p.l", "Lsystem: 1\nderivation length: 0\nAxiom: F+F\nendlsystem\n");
    save("p.v", "angle increment: 90\n");
    let (code, _, err) = run(&["p.l", "--depfile", "p.d"]);
    assert!(
        code == 0 && std::fs::read_to_string(dir.path().join("p.d")).unwrap().starts_with("p.vtex: p.l \\\n  p.v\n"),
        "{err}"
    );
}

#[test]
fn classical_examples_are_read() {
    let Some(assets) = std::env::var_os("VTEX_ASSETS") else { return };
    let folder = Path::new(&assets).join("lsystems/rubberplant");
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "ls"))
        .collect();
    files.sort();
    assert_eq!(files.len(), 15);
    for path in files {
        let options = OpenOptions {
            lsystem: source::LSystemOptions { iterations: Some(5), ..Default::default() },
            ..OpenOptions::default()
        };
        let source = source::open(&path, &options).unwrap();
        let options = Options { resolution: 32, ..Options::default() };
        let (volume, _) = bake::bake(&*source, &options, &vtex::progress::Quiet, &mut |_| {}).unwrap();
        assert!(!super::readable::readable(volume).depths.is_empty(), "{}", path.display());
    }
}
