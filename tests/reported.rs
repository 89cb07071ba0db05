//! Inputs that users reported, made afresh, with the values that are right; image stacks are in `stack.rs`.

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use vtex::format::{Limits, Reader, verify};
use vtex::geom::DVec3;
use vtex::progress::Quiet;
use vtex::render::{Options, render};
use vtex::scene::shell::Environment;
use vtex::scene::{Scene, gltf};
use vtex::volume::{Octree, Volume};

use crate::haze::opacity;

struct Reported {
    inputs: PathBuf,
    out: tempfile::TempDir,
}

impl Reported {
    fn open() -> Option<Reported> {
        let inputs = PathBuf::from(std::env::var_os("VTEX_ASSETS")?).join("reported");
        Some(Reported { inputs, out: tempfile::tempdir().unwrap() })
    }

    fn output(&self, name: &str) -> PathBuf {
        self.out.path().join(name)
    }

    /// Exit code and what is said.
    fn run(&self, words: &[&str], output: &str) -> (i32, String) {
        let mut command = Command::cargo_bin("vtex").unwrap();
        let done = command.current_dir(&self.inputs).args(words).arg("-o").arg(self.output(output)).output().unwrap();
        (done.status.code().unwrap(), String::from_utf8(done.stderr).unwrap())
    }

    /// A texel that `bake` makes, which is valid, and what is said.
    fn baked(&self, input: &str, more: &[&str]) -> (Volume, String) {
        let (code, said) = self.run(&[&["bake", input], more].concat(), "t.vtex");
        assert_eq!(code, 0, "{input}: {said}");
        let path = self.output("t.vtex");
        verify(&path).unwrap();
        (Reader::open(&path, &Limits::default()).unwrap().read_all().unwrap(), said)
    }

    /// What `map` says of covering `input` with a texel of the sample fern.
    fn mapped(&self, input: &str, more: &[&str]) -> String {
        let texel = self.output("fern.vtex");
        if !texel.is_file() {
            let fern = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/fern.glb");
            assert_eq!(self.run(&["bake", fern.to_str().unwrap(), "-r", "16"], "fern.vtex").0, 0);
        }
        let (code, said) =
            self.run(&[&["map", input, "--texel", texel.to_str().unwrap(), "--bend"], more].concat(), "land.gltf");
        assert_eq!(code, 0, "{input}: {said}");
        said
    }
}

fn albedo(volume: &Volume, name: &str) -> [f64; 3] {
    let material = volume.info.materials.iter().find(|m| m.name == name);
    material.unwrap_or_else(|| panic!("{name} in {:?}", volume.info.materials)).albedo
}

#[test]
fn texts_are_read_whatever_their_writers_put_around_lines() {
    let Some(r) = Reported::open() else { return };
    let (marked, plain) =
        (r.baked("obj_bom/o_bom_v.obj", &["-r", "32"]).0, r.baked("obj_bom/o_nobom_v.obj", &["-r", "32"]).0);
    assert_eq!((marked.info.bounds, &marked.depths), (plain.info.bounds, &plain.depths));
    // 3 × 3 × 4 units of a cube of 4.
    let size = marked.info.content.size();
    assert!((size - DVec3::new(0.75, 1.0, 0.75)).abs().max_element() < 1.0 / 32.0, "{size}");
    for input in ["obj_bom/o_bom_mtllib.obj", "mtl_continuation/o_cont.obj"] {
        let volume = r.baked(input, &["-r", "16"]).0;
        for (name, want) in [("leaf", [0.1, 0.6, 0.05]), ("bark", [0.3, 0.2, 0.1])] {
            let got = albedo(&volume, name);
            // Albedo is coded in 255ths of its square root.
            assert!(got.iter().zip(want).all(|(g, w)| (g - w).abs() < 0.005), "{input} {name}: {got:?}");
        }
    }
}

#[test]
fn what_lies_far_from_0_is_what_it_is_near_it() {
    let Some(r) = Reported::open() else { return };
    let (far, said) = r.baked("obj_utm/u_utm.obj", &["-r", "64"]);
    let near = r.baked("obj_utm/u_local.obj", &["-r", "64"]).0;
    assert!(said.contains("(448262, 5411932, 120) is subtracted"), "{said}");
    assert_eq!((far.depths, far.info.facet_size), (near.depths, near.info.facet_size));
    let moved = far.info.bounds.min - near.info.bounds.min;
    // Doubles of some 5 million are right to a billionth.
    assert!((moved - DVec3::new(448_262.0, 5_411_932.0, 120.0)).abs().max_element() < 1e-8, "{moved}");
}

#[test]
fn what_is_not_shown_as_its_writer_saw_it_is_said() {
    let Some(r) = Reported::open() else { return };
    let (code, said) = r.run(&["bake", "messages/g_a_mask_hi.glb", "-r", "16"], "t.vtex");
    assert!(code == 1 && said.contains("alpha cutoff of 1.01 is above all of its alpha"), "{said}");
    for (input, word) in [
        ("messages/o_card.obj", "its picture leafdisc.png has alpha"),
        ("landscape/B10_transparent_mix.glb", "texture leaf has alpha, which is not used"),
        ("landscape/B10_emission.glb", "only emits light"),
    ] {
        let said = r.baked(input, &["-r", "16"]).1;
        assert!(said.contains("warning: ") && said.contains(word), "{input}: {said}");
    }
    // Four numbers behind the place are its colour, the last of them alpha.
    let red = r.baked("messages/h_rgba.obj", &["-r", "16"]).0;
    assert_eq!(albedo(&red, "w"), [1.0, 0.0, 0.0]);
}

#[test]
fn curves_and_grammars_are_as_their_programs_take_them() {
    let Some(r) = Reported::open() else { return };
    let (tract, said) = r.baked("curves/S1_none.trk", &["--width", "0.2", "-r", "64"]);
    assert!(said.contains("LPS is taken"), "{said}");
    // In LPS the strand's y runs from 6 down to 1; u, v and w are x, −z and y.
    let (bounds, content) = (tract.info.bounds, tract.info.content);
    let [low, high] = [content.min, content.max].map(|c| bounds.min.y + c.z * bounds.size().y);
    let voxel = bounds.size().y / 64.0;
    assert!((low - 0.9).abs() <= 2.0 * voxel && (high - 6.1).abs() <= 2.0 * voxel, "{low} {high} {voxel}");
    let (bent, _) = r.baked("lsystem/tropism2.lsys", &["-r", "64"]);
    // e · |H × T| with T as written.
    assert!((bent.info.bounds.min.x + 3.5307).abs() < 1e-3, "{}", bent.info.bounds.min);
}

#[test]
fn what_is_written_can_be_read_and_what_cannot_end_does_not_begin() {
    let Some(r) = Reported::open() else { return };
    r.baked("robust/ground.obj", &["-r", "64", "--voxel-size", "0.01", "--cyclic", "u,v"]);
    r.baked("robust/fs2.toml", &["-r", "64"]);
    let (code, said) = r.run(&["bake", "robust/loop/loop.toml", "-r", "8"], "t.vtex");
    assert!(code == 1 && said.contains("draws itself"), "{said}");
    // It takes .28 of the light over the texel, at the finest depth as at coarser ones. Rates below the least code are drawn by
    // lot so that their sum is kept; none of them was there.
    let haze = r.baked("faint/haze.nii", &["-r", "256", "--sigma", "0", "--transfer", "faint/h.json"]).0;
    assert!(haze.depths.last().unwrap().voxels.iter().any(|v| v.rate > 0));
    // Its depths are equally bright, as it hardly shades itself; what each takes of the light is in haze.rs.
    for factor in vtex::volume::brightness::read(&haze.info).iter().take(8) {
        assert!(factor.light.iter().all(|f| (f - 1.0).abs() < 0.16), "{factor:?}");
    }
}

#[test]
fn a_card_covers_as_much_from_afar() {
    let Some(r) = Reported::open() else { return };
    for (name, half) in [("0.5", 0.5), ("2", 2.0), ("8", 8.0)] {
        let model = gltf::read(&r.inputs.join(format!("render/k_card_{name}.glb")), &Default::default()).unwrap().model;
        let environment = Environment { sky: Some([1.0; 3].into()), background: Some([0.0; 3]), ..Default::default() };
        let scene = Scene { model, texels: vec![], copies: vec![], environment };
        let film = render(&scene, &Options { size: [64; 2], ..Options::measuring() }, &Quiet).unwrap().film;
        let share = film.pixels.iter().map(|p| f64::from(p[3])).sum::<f64>() / film.pixels.len() as f64;
        let area = 4.0 * half * half * share;
        // 4096 points of the smallest card's 16 pixels, some 400 of them on what is there: 5 % where they are random, and these are
        // even over each pixel.
        assert!((area / 0.0956 - 1.0).abs() < 0.03, "{name}: {area}");
    }
}

#[test]
fn coincident_sheets_hide_each_other_as_unrelated_matter() {
    let Some(r) = Reported::open() else { return };
    for refine in ["0", "10"] {
        let sheets = r.baked("sheets/coincident_sheets.toml", &["-r", "64", "--refine", refine]).0;
        let tree = Octree::new(sheets).unwrap();
        for depth in 3..=6 {
            // Up is w.
            let found = opacity(&tree, depth, DVec3::Z, 0.9);
            assert!((found / 0.75 - 1.0).abs() < 0.05, "{refine}, depth {depth}: {found}");
        }
    }
}

#[test]
fn map_measures_what_it_covers() {
    let Some(r) = Reported::open() else { return };
    let said = r.mapped("landscape/terr_pack.glb", &["--repeat", "32"]);
    // 931 and 136 of the two materials: 1067 in all, 10 × 10 m.
    assert!(said.contains("10.000 m, 3.125 m high, about 931") && said.contains("about 136 of them"), "{said}");
    let said = r.mapped("landscape/two.glb", &["--repeat", "10"]);
    assert!(
        said.contains("covered A: copies 10.000 × 10.000 m") && said.contains("covered B: copies 2.000 × 2.000 m"),
        "{said}"
    );
    let said = r.mapped("landscape/N2_scale.glb", &["--repeat", "10"]);
    assert!(said.contains("copies 4.000 × 4.000 m") && said.contains("copies 20.000 × 20.000 m"), "{said}");
    let said = r.mapped("landscape/RT_zup.glb", &[]);
    assert!(said.contains("kept the file's own _VTEX_UVW, _VTEX_HEIGHT") && said.contains("--heights z-up"), "{said}");
    let said = r.mapped("messages/m_flip.glb", &["--repeat", "4"]);
    assert!(said.contains("the ground faces down"), "{said}");
}

#[test]
fn pictures_are_of_the_shape_and_brightness_that_their_writer_saw() {
    let Some(r) = Reported::open() else { return };
    let (code, said) =
        r.run(&["render", "landscape/B12_scene.glb", "--sky", "1,1,1", "--ambient", "constant"], "a.png");
    assert_eq!(code, 0, "{said}");
    assert_eq!(image::image_dimensions(r.output("a.png")).unwrap(), (720, 1280));
    for input in ["landscape/RT_plain.glb", "render/b_light.glb"] {
        let (code, said) = r.run(&["render", input, "--size", "64x36", "--ambient", "constant"], "a.png");
        assert!(code == 0 && said.contains("lux and candela"), "{said}");
        let picture = image::open(r.output("a.png")).unwrap().into_rgb8();
        let white = picture.pixels().filter(|p| p.0 == [255; 3]).count();
        assert!(white < picture.pixels().len() / 20, "{input}: {white}");
    }
}
