//! Materials: shares in closed form, restyled texels against bakes of restyled sources, and the commands.

use std::path::Path;

use assert_cmd::Command;
use serde_json::Value;
use vtex::bake::{self, Options};
use vtex::geom::{DAffine3, Vec3};
use vtex::progress::Quiet;
use vtex::scene::gltf::{self, ReadOptions};
use vtex::scene::{Instance, Material, Model, Part};
use vtex::source::{Fill, MeshOptions, MeshSource};
use vtex::volume::palette::Restyled;
use vtex::volume::{Pages, Palette, Style, Volume};

fn baked(model: Model, resolution: u32) -> Volume {
    let source = MeshSource::new(model, &MeshOptions { fill: Fill::Surface });
    let options = Options { resolution, ..Options::default() };
    super::readable::readable(bake::bake(&source, &options, &Quiet, &mut |_| ()).unwrap().0)
}

/// A level square over the unit square, of strips across x that end at `ends`, one material each.
fn strips(ends: &[f32], names: &[&str]) -> Model {
    let mut model = Model::default();
    let mut from = 0.0;
    for (i, (&to, name)) in ends.iter().zip(names).enumerate() {
        let corners = [[from, 0.5, 0.0], [from, 0.5, 1.0], [to, 0.5, 1.0], [to, 0.5, 0.0]];
        model.parts.push(Part {
            positions: corners.to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            material: i,
            ..Part::default()
        });
        let shade = 0.2 + 0.1 * i as f32;
        let base_color = [shade, 1.0 - shade, 0.5, 1.0];
        model.materials.push(Material { name: (*name).into(), base_color, ..Material::default() });
        model.instances.push(Instance { part: i, transform: DAffine3::IDENTITY, node: String::new() });
        from = to;
    }
    model
}

/// Codes (Morton) of all nodes of each depth.
fn codes(volume: &Volume) -> Vec<Vec<u64>> {
    let mut all = vec![vec![0u64]];
    for depth in &volume.depths[..volume.depths.len() - 1] {
        let parents = all.last().unwrap();
        let children = parents.iter().zip(&depth.masks);
        let next = children.flat_map(|(&c, &m)| (0..8).filter(move |j| m >> j & 1 != 0).map(move |j| c << 3 | j));
        all.push(next.collect());
    }
    all
}

#[test]
fn shares_of_strips_are_their_widths_at_every_depth() {
    let ends = [0.3f32, 0.55, 1.0];
    for names in [["a", "b", "c"], ["a", "b", "a"]] {
        let volume = baked(strips(&ends, &names), 32);
        let count = volume.info.materials.len();
        assert_eq!(count, if names[2] == "a" { 2 } else { 3 });
        for (d, (depth, codes)) in volume.depths.iter().zip(codes(&volume)).enumerate() {
            assert_eq!(depth.mixes.len(), depth.voxels.len());
            let width = 1.0 / f64::from(1u32 << d);
            for (mix, code) in depth.mixes.iter().zip(codes) {
                let x0 = vtex::morton::decode(code)[0] as f64 * width;
                let mut want = vec![0.0; count];
                let mut from = 0.0;
                for (&end, name) in ends.iter().zip(names) {
                    let id = volume.info.materials.iter().position(|m| m.name == name).unwrap();
                    let end = f64::from(end);
                    want[id] += (end.min(x0 + width) - f64::max(from, x0)).max(0.0) / width;
                    from = end;
                }
                // The cube is a part in 2^20 wider than the square. Steps are 1/7 at the finest depth, 1/63 above; what is
                // seen is counted by 16 lines a voxel, a quarter of them from child to parent.
                let allowed = if d == 5 { 0.5 / 7.0 } else { 1.0 / 63.0 + 0.02 };
                let mut got = vec![0.0; count];
                mix.weights().for_each(|(id, share)| got[usize::from(id)] = share);
                for (got, want) in got.iter().zip(&want) {
                    assert!((got - want).abs() < allowed + 1e-4, "{names:?} depth {d} at {x0}: {got} {want}");
                }
            }
        }
        let told = &volume.info.materials;
        let first = if count == 2 { 0.75 } else { 0.3 };
        assert!((told[0].share - first).abs() < 0.01 && (told[1].share - 0.25).abs() < 0.01, "{told:?}");
        assert!((told[1].albedo[0] - 0.3).abs() < 1e-3 && (told[1].albedo[1] - 0.7).abs() < 1e-3, "{told:?}");
    }
}

#[test]
fn one_material_is_told_and_takes_nothing() {
    let one = baked(strips(&[1.0], &["only"]), 16);
    assert_eq!(one.info.materials.iter().map(|m| &m.name[..]).collect::<Vec<_>>(), ["only"]);
    assert!(one.depths.iter().all(|d| d.mixes.is_empty()));
    assert!((one.info.materials[0].albedo[0] - 0.2).abs() < 0.01);
    assert!(baked(strips(&[1.0], &[""]), 16).info.materials.is_empty());
    let source = MeshSource::new(strips(&[0.5, 1.0], &["a", "b"]), &MeshOptions::default());
    let options = Options { resolution: 8, materials: false, ..Options::default() };
    let off = bake::bake(&source, &options, &Quiet, &mut |_| ()).unwrap().0;
    assert!(off.info.materials.is_empty() && off.depths[3].mixes.is_empty());
    // More than there are ids.
    let ends: Vec<f32> = (1..=256).map(|i| i as f32 / 256.0).collect();
    let names: Vec<String> = (0..256).map(|i| format!("m{i}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let source = MeshSource::new(strips(&ends, &names), &MeshOptions::default());
    let error = bake::bake(&source, &Options::default(), &Quiet, &mut |_| ()).err().unwrap().to_string();
    assert!(error.contains("256") && error.contains("255") && error.contains("number of materials"), "{error}");
}

#[test]
fn many_materials_and_any_threads() {
    let ends: Vec<f32> = (1..=40).map(|i| i as f32 / 40.0).collect();
    let names: Vec<String> = (0..40).map(|i| format!("m{i}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let of = |threads| vtex::par::with_threads(threads, || baked(strips(&ends, &names), 32)).unwrap();
    let (one, three) = (of(1), of(3));
    assert!(one == three);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("m.vtex");
    vtex::format::write(&one, &path, &Default::default()).unwrap();
    vtex::format::verify(&path).unwrap();
    let back = vtex::format::Reader::open(&path, &Default::default()).unwrap().read_all().unwrap();
    assert!(back.info.materials == one.info.materials);
    assert!(back.depths.iter().zip(&one.depths).all(|(a, b)| a.mixes == b.mixes));
}

/// How far a texel of the file that is restyled is from a bake of the restyled file, a depth each: mean difference of linear
/// albedo and of its mean over all voxels.
fn restyled_against_rebaked(file: &str, name: &str, style: Style, resolution: u32) -> Vec<(f64, f64)> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(file);
    let mut model = gltf::read(&path, &ReadOptions::default()).unwrap().model;
    let own = baked(model.clone(), resolution);
    let palette = Palette { styles: [(name.to_owned(), style)].into(), ..Palette::default() };
    vtex::render::reference::restyle(&mut model, &palette);
    let want = baked(model, resolution);
    let shown = Restyled::new(own.clone(), &palette);
    let mut errors = Vec::new();
    for (d, depth) in want.depths.iter().enumerate() {
        let (mut sum, mut bias) = (0.0, Vec3::ZERO);
        let pages = (0..depth.voxels.len().div_ceil(4096)).flat_map(|page| shown.voxels(d, page).unwrap());
        for (got, want) in pages.zip(&depth.voxels) {
            let off = got.albedo() - want.albedo();
            sum += f64::from(off.abs().element_sum() / 3.0);
            bias += off;
        }
        let n = depth.voxels.len() as f64;
        errors.push((sum / n, f64::from(bias.abs().max_element()) / n));
    }
    errors
}

#[test]
fn a_restyled_texel_is_as_if_baked_so() {
    let autumn = Style { factor: [4.0, 0.8, 0.2], ..Style::UNCHANGED };
    let red = Style { factor: [0.6, 0.1, 0.02], ..Style::WHITE };
    for (file, name) in [("tree.glb", "leaf"), ("spruce.glb", "needles")] {
        for style in [autumn, red] {
            let errors = restyled_against_rebaked(file, name, style, 64);
            println!("{file} {style:?}: {errors:.4?}");
            // Of even colours what is left is the codes' steps: half of 1/255 in the square root, twice, and shares in
            // sevenths at the finest depth (measured .0020 and .0055).
            for (d, (mean, bias)) in errors.iter().enumerate() {
                assert!(*mean < 0.003 && *bias < 0.007, "{file} depth {d}: {mean} {bias}");
            }
        }
    }
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Folder {
        let dir = tempfile::tempdir().unwrap();
        let mut text = String::from("mtllib c.mtl\n");
        for (name, x) in [("red", 0), ("blue", 2)] {
            let first = if x == 0 { 1 } else { 9 };
            (0..8).for_each(|i| text += &format!("v {} {} {}\n", x + (i & 1), i >> 1 & 1, i >> 2));
            text += &format!("usemtl {name}\n");
            for face in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
                let [a, b, c, d] = face.map(|i| i + first);
                text += &format!("f {a} {b} {c} {d}\n");
            }
        }
        std::fs::write(dir.path().join("two.obj"), text).unwrap();
        std::fs::write(dir.path().join("c.mtl"), "newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n").unwrap();
        Folder(dir)
    }

    fn vtex(&self, args: &str) -> (i32, String, String) {
        self.run(&args.split(' ').collect::<Vec<_>>())
    }

    fn run(&self, args: &[&str]) -> (i32, String, String) {
        let run = Command::cargo_bin("vtex").unwrap().current_dir(self.0.path()).args(args).output().unwrap();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (run.status.code().unwrap(), text(&run.stdout), text(&run.stderr))
    }

    fn done(&self, args: &str) -> String {
        let (code, out, err) = self.vtex(args);
        assert_eq!(code, 0, "{args}: {err}");
        out
    }

    fn materials(&self, file: &str) -> Vec<(String, [f64; 3], f64)> {
        let told: Value = serde_json::from_str(&self.done(&format!("inspect {file} --json"))).unwrap();
        let list = told["materials"].as_array().unwrap().clone();
        let number = |v: &Value| v.as_f64().unwrap();
        list.iter()
            .map(|m| {
                (m["name"].as_str().unwrap().into(), [0, 1, 2].map(|k| number(&m["albedo"][k])), number(&m["share"]))
            })
            .collect()
    }

    fn names(&self, file: &str) -> Vec<String> {
        self.materials(file).into_iter().map(|m| m.0).collect()
    }

    fn save(&self, name: &str, text: &str) {
        std::fs::write(self.0.path().join(name), text).unwrap();
    }
}

#[test]
fn every_source_names_its_materials() {
    let folder = Folder::new();
    folder.done("bake two.obj -r 32");
    let told = folder.materials("two.vtex");
    assert_eq!(folder.names("two.vtex"), ["red", "blue"]);
    assert!((told[0].2 - 0.5).abs() < 0.02 && told[0].1 == [1.0, 0.0, 0.0], "{told:?}");
    assert!(folder.done("inspect two.vtex").contains("red, albedo 1 0 0"));
    folder.done("bake two.obj -r 16 --material paint -o one.vtex");
    assert_eq!(folder.names("one.vtex"), ["paint"]);
    folder.done("bake two.obj -r 16 --materials off -o none.vtex");
    assert!(folder.names("none.vtex").is_empty());
    // A grammar: by colour, by symbol, by surface.
    folder.save(
        "g.lsys",
        "#iterations 0\n#width .2\n#colour 0 #604020\n#colour 1 #208020\n#surface L { 0 0, 1 1, -1 1 }\n\
         #material bark 0\n#material green 1\n#material twig G\n#material leaf ~L\naxiom: FG'(1)F[+~L]-F\n",
    );
    folder.done("bake g.lsys -r 32");
    assert_eq!(folder.names("g.vtex"), ["bark", "green", "twig", "leaf"]);
    for (line, what) in [
        ("#material", "column 10: a #material is a name"),
        ("#material bark", "a #material is a name"),
        ("#material bark ~", "after ~ stands the symbol"),
        ("#material bark 1.5", "a material is given to"),
    ] {
        folder.save("bad.lsys", &format!("{line}\naxiom: F\n"));
        let (code, _, err) = folder.vtex("bake bad.lsys -r 8");
        assert!(code == 1 && err.contains(what) && err.contains("line 1"), "{line}: {err}");
    }
    // A recipe: a name on a node stands for all within it; a file keeps its own, and what has none is unnamed.
    folder.save(
        "r.toml",
        "[[draw]]\nsphere = { centre = [0, 3, 0], radius = 1 }\nmaterial = \"moss\"\n[[draw]]\nsource = \"two.obj\"\n\
         [[draw]]\nsource = \"two.obj\"\ntranslate = [0, 0, 3]\nmaterial = \"stone\"\n[[draw]]\nsource = \"two.vtex\"\n\
         translate = [0, 0, -3]\n[[draw]]\nbox = { min = [4, 0, 0], max = [5, 1, 1] }\n",
    );
    folder.done("bake r.toml -r 32");
    let names = folder.names("r.vtex");
    assert_eq!(names, ["moss", "red", "blue", "stone", "unnamed"]);
    folder.done("verify r.vtex");
    folder.done("truncate r.vtex --depth 3 -o short.vtex");
    folder.done("verify short.vtex");
    assert_eq!(folder.names("short.vtex"), names);
}

#[test]
fn merged_texels_keep_their_materials() {
    let folder = Folder::new();
    folder.done("bake two.obj -r 32");
    folder.save("c.mtl", "newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 1 0\n");
    let moved = std::fs::read_to_string(folder.0.path().join("two.obj")).unwrap();
    folder.save("more.obj", &moved.replace("usemtl blue", "usemtl green").replace("v ", "v 1"));
    folder.save("c.mtl", "newmtl red\nKd 1 0 0\nnewmtl green\nKd 0 1 0\n");
    folder.done("bake more.obj -r 32");
    folder.done("merge two.vtex more.vtex -o both.vtex");
    folder.done("verify both.vtex");
    let told = folder.materials("both.vtex");
    assert_eq!(folder.names("both.vtex"), ["red", "blue", "green"]);
    assert!((told[0].2 - 0.5).abs() < 0.05 && (told[1].2 - 0.25).abs() < 0.05, "{told:?}");
    folder.done("resample two.vtex -r 16 -o coarse.vtex");
    let coarse = folder.materials("coarse.vtex");
    assert!(coarse[0].0 == "red" && (coarse[0].2 - 0.5).abs() < 0.05 && coarse[0].1[2] < 0.1, "{coarse:?}");
}

#[test]
fn colours_are_laid_on_any_source() {
    let folder = Folder::new();
    let root = |file: &str| {
        let reader = vtex::format::Reader::open(folder.0.path().join(file), &Default::default()).unwrap();
        reader.voxels(0, 0).unwrap()[0].albedo()
    };
    let lays = |args: &[&str]| {
        let (code, _, err) = folder.run(&[&["bake"], args, &["-r", "16", "-o", "c.vtex"]].concat());
        assert_eq!(code, 0, "{args:?}: {err}");
        super::readable::verify(&folder.0.path().join("c.vtex"));
        root("c.vtex")
    };
    let near = |a: Vec3, b: [f32; 3]| (a - Vec3::from_array(b)).abs().max_element() < 0.02;
    let grey = lays(&["two.obj", "--albedo", "#808080"]);
    assert!(near(grey, [0.216; 3]), "{grey}");
    assert!(near(lays(&["two.obj", "--albedo", "0.5,0.25,1"]), [0.5, 0.25, 1.0]));
    assert_eq!(folder.names("c.vtex"), ["red", "blue"]);
    // Half of it is red, half blue.
    let tinted = lays(&["two.obj", "--albedo", "0.5,0.25,1", "--tint"]);
    assert!(near(tinted, [0.25, 0.0, 0.5]), "{tinted}");
    // A picture, black and white side by side, fits the box: the left cube is black.
    image::RgbImage::from_fn(2, 1, |x, _| image::Rgb([x as u8 * 255; 3])).save(folder.0.path().join("p.png")).unwrap();
    let picture = lays(&["two.obj", "--albedo", "p.png"]);
    assert!(picture.x > 0.3 && picture.x < 0.7, "{picture}");
    let around = lays(&["two.obj", "--albedo", "{ image = 'p.png', projection = 'spherical' }"]);
    assert!(around.x > 0.2 && around.x < 0.8, "{around}");
    folder.save("g.toml", "colours = ['#000000', '#ffffff']\ngradient = { from = [0, 0, 0], to = [0, 1, 0] }\n");
    let gradient = lays(&["two.obj", "--albedo", "g.toml", "--depfile", "d"]);
    assert!(gradient.x > 0.35 && gradient.x < 0.65, "{gradient}");
    assert!(std::fs::read_to_string(folder.0.path().join("d")).unwrap().contains("g.toml"));
    let noisy = lays(&["two.obj", "--albedo", "{ noise = { scale = 0.3 }, colours = [[0, 0, 0], [1, 1, 1]] }"]);
    assert!(noisy.x > 0.2 && noisy.x < 0.8, "{noisy}");
    // Curves and grammars too.
    folder.save("c.csv", "id,t,x,y,z,radius\n1,0,0,0,0,.1\n1,1,0,1,0,.1\n");
    assert!(near(lays(&["c.csv", "--albedo", "1,0,0", "--material", "hair"]), [1.0, 0.0, 0.0]));
    assert_eq!(folder.names("c.vtex"), ["hair"]);
    folder.save("bad.toml", "image = 'p.png'\ncolour = 1\n");
    for (args, what) in [
        (vec!["--albedo", "#12345"], "--albedo: '#12345' is not a colour like #4c8a2e"),
        (vec!["--albedo", "2,0,0"], "--albedo: a colour's numbers are from 0 to 1"),
        (vec!["--albedo", "1,0"], "--albedo: "),
        (vec!["--albedo", "{ noise = { scale = 1 } }"], "--albedo: an albedo is a colour, or has"),
        (vec!["--albedo", "{ noise = { scale = 0 }, colours = [] }"], "--albedo: "),
        (vec!["--albedo", "{ noise"], "--albedo: "),
        (vec!["--albedo", "none.png"], "--albedo: the picture 'none.png' is not there"),
        (vec!["--albedo", "two.obj"], "two.obj"),
        (vec!["--albedo", "none.toml"], "none.toml"),
        (vec!["--albedo", "bad.toml"], "bad.toml: unknown field `colour`"),
        (vec!["--tint"], "--tint multiplies by what --albedo says"),
        (vec!["--material", ""], "--material needs a name"),
    ] {
        let (code, _, err) = folder.run(&[&["bake", "two.obj", "-r", "8", "-o", "bad.vtex"], &args[..]].concat());
        let line = err.lines().find(|l| l.starts_with("error: ")).unwrap_or_default();
        assert!(code != 0 && line.contains(what), "{args:?}: {err}");
        assert!(!folder.0.path().join("bad.vtex").exists());
    }
}

#[test]
fn a_landscape_restyles_by_name() {
    let folder = Folder::new();
    let sample = |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(name);
    std::fs::copy(sample("tree.glb"), folder.0.path().join("tree.glb")).unwrap();
    std::fs::copy(sample("terrain.glb"), folder.0.path().join("ground.glb")).unwrap();
    folder.done("bake tree.glb -r 64");
    let map = "map ground.glb --texel tree.vtex --geometry tree.glb --material meadow --cell 14";
    folder.done(&format!("{map} -o plain.gltf"));
    folder.done(&format!("{map} --palette leaf=#d0581c --palette bark=*.4,.4,.5 -o autumn.gltf"));
    let (code, _, err) = folder.vtex(&format!("{map} --palette leaves=#d0581c -o bad.gltf"));
    assert!(code != 0 && err.contains("there are: bark, leaf") && !folder.0.path().join("bad.gltf").exists(), "{err}");
    for bad in ["leaf", "=#ffffff", "leaf=#fff", "leaf=2,0,0", "leaf=*-1,0,0", "leaf=1,2"] {
        let (code, _, err) = folder.vtex(&format!("{map} --palette {bad} -o bad.gltf"));
        assert_eq!(code, 2, "{bad}: {err}");
    }
    // The picture and its reference change alike: the error of the one stays that of the other.
    let mut flips = Vec::new();
    for land in ["plain", "autumn"] {
        let measured = "--sky 0.35,0.42,0.52 --ambient constant --sun-angle 0";
        let view = format!("render {land}.gltf --size 96x54 {measured}");
        folder.done(&format!("{view} --near voxels --lanes 4 -o {land}.exr"));
        folder.done(&format!("{view} --reference 24 -o {land}-truth.exr"));
        let told = folder.done(&format!("compare {land}.exr {land}-truth.exr --json"));
        let told: Value = serde_json::from_str(&told).unwrap();
        println!("{land}: {told}");
        flips.push(told["all"]["flip"].as_f64().or(told["flip"].as_f64()).unwrap());
    }
    assert!(flips[1] < 1.25 * flips[0] + 0.005, "{flips:?}");
    // A name that is not there is a warning, counted.
    let text = std::fs::read_to_string(folder.0.path().join("autumn.gltf")).unwrap();
    folder.save("wrong.gltf", &text.replace("\"leaf\":", "\"laef\":"));
    let (_, _, err) = folder.vtex("render wrong.gltf --size 16x9 -o w.png");
    assert!(err.contains("no material \"laef\""), "{err}");
}
