//! `vtex render --time` and `--frames` from the outside: what moves, what is kept, and how it fails.

use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};
use vtex::render::image_io;

/// A folder with land.gltf: a wide floor, and above it a card that moves along x from −1 m to 1 m within two seconds.
fn land() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut bin: Vec<u8> = Vec::new();
    let mut floats = |values: &[f32]| {
        let at = bin.len();
        bin.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        (at, bin.len() - at)
    };
    let card = floats(&[-0.5, 0., 0., 0.5, 0., 0., 0., 1., 0.]);
    let times = floats(&[0.0, 2.0]);
    let places = floats(&[-1., 0., 0., 1., 0., 0.]);
    let view = |(at, length): (usize, usize)| json!({"buffer": 0, "byteOffset": at, "byteLength": length});
    let accessor = |i: usize, kind: &str, count: usize| json!({"bufferView": i, "componentType": 5126, "type": kind, "count": count});
    let file = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"camera": 0, "translation": [0, 0.5, 4]}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.6, "aspectRatio": 2, "znear": 0.1}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "animations": [{"name": "slide", "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
            "samplers": [{"input": 1, "output": 2}]}],
        "accessors": [accessor(0, "VEC3", 3), accessor(1, "SCALAR", 2), accessor(2, "VEC3", 2)],
        "bufferViews": [view(card), view(times), view(places)],
        "buffers": [{"uri": "land.bin", "byteLength": bin.len()}],
    });
    std::fs::write(folder.path().join("land.gltf"), file.to_string()).unwrap();
    std::fs::write(folder.path().join("land.bin"), bin).unwrap();
    folder
}

fn vtex(folder: &Path, arguments: &str) -> (i32, String, String) {
    let output =
        Command::new(env!("CARGO_BIN_EXE_vtex")).args(arguments.split(' ')).current_dir(folder).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

/// The mean column of what is not background.
fn middle(path: &Path) -> f64 {
    let image = image_io::read(path).unwrap();
    let (mut sum, mut weight) = (0.0, 0.0);
    for (i, p) in image.rgba.iter().enumerate() {
        let own = f64::from(p[3]);
        sum += own * (i % image.width) as f64;
        weight += own;
    }
    sum / weight
}

#[test]
fn a_node_is_where_its_time_has_it() {
    let folder = land();
    let at = |options: &str, name: &str| {
        let (code, _, errors) = vtex(folder.path(), &format!("render land.gltf --size 64x32 {options}-o {name}"));
        assert_eq!(code, 0, "{errors}");
        middle(&folder.path().join(name))
    };
    let (left, centre, right) = (at("--time 0 ", "a.exr"), at("--time 1 ", "b.exr"), at("--time 7 ", "c.exr"));
    // 4 m away, 2.47 m are 32 pixels: a metre is 12.9 pixels; a cone a pixel is off by at most a half.
    assert!((centre - 31.5).abs() < 0.5, "{centre}");
    assert!((centre - left - 12.9).abs() < 1.0 && (right - centre - 12.9).abs() < 1.0, "{left} {right}");
    // At rest the node has no translation; begun anew, 5 s are 1 s.
    assert!((at("", "d.exr") - 31.5).abs() < 0.5);
    assert_eq!(at("--time 5 --loop ", "e.exr"), centre);
    assert_eq!(at("--time 1 --animation slide ", "f.exr"), centre);
    let (code, _, errors) = vtex(folder.path(), "render land.gltf --time 1 --animation walk -o g.exr");
    assert!(code == 2 && errors.contains("no animation is named walk; the file has: slide"), "{errors}");
}

#[test]
fn frames_do_not_depend_on_each_other_and_whole_ones_are_kept() {
    let folder = land();
    let path = |name: &str| folder.path().join(name);
    let render = |more: &str| {
        let (code, _, errors) = vtex(folder.path(), &format!("render land.gltf --size 32x16 {more}"));
        assert_eq!(code, 0, "{errors}");
        errors
    };
    render("--frames 2..5 --fps 4 -o a.####.png");
    let first = std::fs::read(path("a.0003.png")).unwrap();
    render("--frames 3..3 --fps 4 -o b.##.png");
    assert_eq!(first, std::fs::read(path("b.03.png")).unwrap());
    render("--time 0.75 -o c.png");
    assert_eq!(first, std::fs::read(path("c.png")).unwrap());
    // One is missing, one is cut short: these alone are made again, the same.
    std::fs::remove_file(path("a.0003.png")).unwrap();
    std::fs::write(path("a.0004.png"), &first[..first.len() / 2]).unwrap();
    let said = render("--frames 2..5 --fps 4 -o a.####.png");
    assert!(said.contains("2 frames that were there already are kept"), "{said}");
    assert!(said.contains("a.0003.png") && said.contains("a.0004.png") && !said.contains("a.0002.png"), "{said}");
    assert_eq!(first, std::fs::read(path("a.0003.png")).unwrap());
    assert!(!render("--frames 2..5 --fps 4 --force -o a.####.png").contains("kept"));
    // A landscape that is newer than its pictures.
    let later = std::time::SystemTime::now() + std::time::Duration::from_secs(60);
    std::fs::File::options().append(true).open(path("land.bin")).unwrap().set_modified(later).unwrap();
    assert!(!render("--frames 2..5 --fps 4 -o a.####.png").contains("kept"));
}

#[test]
fn pictures_that_move_hold_every_frame() {
    let folder = land();
    for name in ["a.gif", "a.apng"] {
        let (code, _, errors) =
            vtex(folder.path(), &format!("render land.gltf --size 32x16 --frames 5 --fps 12.5 -o {name}"));
        assert_eq!(code, 0, "{errors}");
        assert!(errors.contains("5 frames of 32×16"), "{errors}");
    }
    use image::AnimationDecoder;
    let open = |name: &str| std::io::BufReader::new(std::fs::File::open(folder.path().join(name)).unwrap());
    let gif = image::codecs::gif::GifDecoder::new(open("a.gif")).unwrap().into_frames().collect_frames().unwrap();
    assert_eq!(gif.len(), 5);
    assert!(gif.iter().all(|f| f.delay().numer_denom_ms() == (80, 1)));
    let png = image::codecs::png::PngDecoder::new(open("a.apng")).unwrap().apng().unwrap();
    let png = png.into_frames().collect_frames().unwrap();
    assert_eq!(png.len(), 5);
    // Frame 3 is that of its time, to the bit.
    let (code, _, errors) = vtex(folder.path(), "render land.gltf --size 32x16 --time 0.24 -o b.png");
    assert_eq!(code, 0, "{errors}");
    let still = image::open(folder.path().join("b.png")).unwrap().to_rgba8();
    assert_eq!(png[3].buffer(), &still);
    assert_ne!(png[2].buffer(), &still);
}

#[test]
fn what_is_wrong_is_one_clear_line() {
    let folder = land();
    for (options, code, what) in [
        ("--frames 5..2 -o a.####.png", 2, "frame 5 comes after frame 2"),
        ("--frames 3 -o a.png", 2, "such as a.####.png, or one .gif or .apng"),
        ("--frames 3 -o a.####.jpg", 2, "must end in .png or .exr"),
        ("--frames 3 --fps 0 -o a.####.png", 2, "must be above 0"),
        ("--time nan -o a.png", 2, "not a number"),
        ("-o a.gif", 2, "--frames is needed"),
        ("--frames 3 -o no/a.####.png", 1, "folder does not exist"),
    ] {
        let (got, _, errors) = vtex(folder.path(), &format!("render land.gltf {options}"));
        assert!(got == code && errors.contains(what), "{options}: {got} {errors}");
    }
    let text = std::fs::read_to_string(folder.path().join("land.gltf")).unwrap();
    let mut file: Value = serde_json::from_str(&text).unwrap();
    file["animations"][0]["samplers"][0]["output"] = json!(1);
    std::fs::write(folder.path().join("bad.gltf"), file.to_string()).unwrap();
    let (code, _, errors) = vtex(folder.path(), "render bad.gltf --time 1 -o a.png");
    assert!(code == 1 && errors.lines().count() == 1, "{errors}");
    assert!(errors.contains("animations[0].samplers[0].output"), "{errors}");
    assert!(!folder.path().join("a.png").exists());
}

/// A GLB of a card 1 m wide, 2 m high, that grows by half within a second.
fn growing(folder: &Path) {
    let card = [-0.5f32, 0., 0., 0.5, 0., 0., 0.5, 2., 0., -0.5, 2., 0.];
    let mut bin: Vec<u8> = card.iter().flat_map(|v| v.to_le_bytes()).collect();
    bin.extend([0u16, 1, 2, 0, 2, 3].iter().flat_map(|v| v.to_le_bytes()));
    bin.extend([0f32, 1.0, 1., 1., 1., 1., 1.5, 1.].iter().flat_map(|v| v.to_le_bytes()));
    let view = |at: usize, length: usize| json!({"buffer": 0, "byteOffset": at, "byteLength": length});
    let file = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "animations": [{"channels": [{"sampler": 0, "target": {"node": 0, "path": "scale"}}],
            "samplers": [{"input": 2, "output": 3}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 4},
            {"bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": 6},
            {"bufferView": 2, "componentType": 5126, "type": "SCALAR", "count": 2},
            {"bufferView": 3, "componentType": 5126, "type": "VEC3", "count": 2}],
        "bufferViews": [view(0, 48), view(48, 12), view(60, 8), view(68, 24)],
        "buffers": [{"byteLength": bin.len()}],
    });
    let mut text = file.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend((28 + text.len() as u32 + bin.len() as u32).to_le_bytes());
    for (kind, data) in [(b"JSON", &text), (b"BIN\0", &bin)] {
        out.extend((data.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(data);
    }
    std::fs::write(folder.join("card.glb"), out).unwrap();
}

fn info(path: &Path) -> vtex::volume::Info {
    use vtex::volume::Pages;
    vtex::format::Reader::open(path, &vtex::format::Limits::default()).unwrap().info().clone()
}

#[test]
fn frames_share_a_box_and_are_shown_at_their_time() {
    let folder = land();
    growing(folder.path());
    let path = |name: &str| folder.path().join(name);
    let run = |line: &str| {
        let (code, _, errors) = vtex(folder.path(), line);
        assert_eq!(code, 0, "{line}: {errors}");
        errors
    };
    run("bake card.glb -r 16 --frames 4 --refine 0");
    let infos: Vec<_> = (0..4).map(|k| info(&path(&format!("card.000{k}.vtex")))).collect();
    // Frame k is at k / 4 s, and the card then 2 + k / 4 m high; the box is that of the highest, 2.75 m.
    let size = infos[0].bounds.size().y;
    assert!((size - 2.75).abs() < 1e-4, "{size}");
    for (k, info) in infos.iter().enumerate() {
        assert_eq!(info.bounds, infos[0].bounds);
        let high = info.content.size().z * size;
        // Contents are told in whole voxels.
        assert!((high - (2.0 + 0.25 * k as f64)).abs() < 1.5 * size / 16.0, "{k}: {high}");
        assert_eq!(info.meta["animation"]["pose"]["time"].as_f64(), Some(0.25 * k as f64));
        assert_eq!(info.meta["animation"]["framesPerSecond"].as_f64(), Some(4.0));
    }
    std::fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/terrain.glb"), path("terrain.glb")).unwrap();
    run("map terrain.glb --texel card.####.vtex --geometry card.glb --phase global -o wood.gltf");
    let text: Value = serde_json::from_str(&std::fs::read_to_string(path("wood.gltf")).unwrap()).unwrap();
    let frames = &text["extensions"]["VTEX_volumetric_texture"]["texels"][0]["frames"];
    assert_eq!((frames.as_array().unwrap().len(), frames[3]["pose"]["time"].as_f64()), (4, Some(0.75)));
    // At 0.6 s frame 2 is shown, as a landscape of that frame alone shows it; half a second earlier another one.
    let view = "--size 48x27 --ambient constant --camera far";
    run("map terrain.glb --texel card.0002.vtex --geometry card.glb -o one.gltf");
    run(&format!("render one.gltf {view} --near voxels -o one.png"));
    run(&format!("render wood.gltf {view} --near voxels --time 0.6 -o wood.png"));
    run(&format!("render wood.gltf {view} --near voxels --time 0.1 -o other.png"));
    run(&format!("render wood.gltf {view} --near voxels --time 1.6 -o again.png"));
    let read = |name: &str| std::fs::read(path(name)).unwrap();
    assert!(read("one.png") == read("wood.png") && read("wood.png") == read("again.png"));
    assert!(read("wood.png") != read("other.png"));
    // Every copy at a phase of its own: another picture, the same one at the same time.
    run("map terrain.glb --texel card.####.vtex --geometry card.glb -o each.gltf");
    for name in ["a.png", "b.png"] {
        run(&format!("render each.gltf {view} --time 0.6 -o {name}"));
    }
    assert!(read("a.png") == read("b.png") && read("a.png") != read("wood.png"));
    // Other boxes, and a gap.
    run("bake card.glb -r 16 --time 1 --refine 0 -o card.0004.vtex");
    let (code, _, errors) = vtex(folder.path(), "map terrain.glb --texel card.####.vtex -o bad.gltf");
    assert!(code == 1 && errors.contains("card.0004.vtex") && errors.contains("another box"), "{errors}");
    std::fs::remove_file(path("card.0002.vtex")).unwrap();
    let (code, _, errors) = vtex(folder.path(), "map terrain.glb --texel card.####.vtex -o bad.gltf");
    assert!(code == 1 && errors.contains("card.0002.vtex") && errors.contains("missing"), "{errors}");
}

#[test]
fn parameters_of_an_l_system_are_frames() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("stalk.lsys"), "#define t 1\n#iterations 1\naxiom: X\nX -> F(2 * t)").unwrap();
    let (code, _, errors) = vtex(folder.path(), "bake stalk.lsys -r 8 --refine 0 --frames 3 --frame-define t=0.5..1.5");
    assert_eq!(code, 0, "{errors}");
    let infos: Vec<_> = (0..3).map(|k| info(&folder.path().join(format!("stalk.000{k}.vtex")))).collect();
    let high = |k: usize| infos[k].content.size().z * infos[k].bounds.size().y;
    // 1, 2 and 3 units high, told in whole voxels of 3 / 8 units.
    assert!(high(0) < 1.8 && (1.5..2.8).contains(&high(1)) && high(2) > 2.8, "{} {} {}", high(0), high(1), high(2));
    let (code, _, errors) = vtex(folder.path(), "bake stalk.lsys -r 8 --frames 3 --frame-define s=0..1");
    assert!(code == 2 && errors.contains("has no #define s; it has: t"), "{errors}");
    let (code, _, errors) = vtex(folder.path(), "bake stalk.lsys -r 8 --frames 3");
    assert!(code == 2 && errors.contains("--frame-define NAME=FROM..TO"), "{errors}");
}

#[test]
fn wind_bends_shells_and_leans_copies() {
    let folder = land();
    growing(folder.path());
    std::fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/terrain.glb"), folder.path().join("terrain.glb"))
        .unwrap();
    let run = |line: &str| {
        let (code, _, errors) = vtex(folder.path(), line);
        assert_eq!(code, 0, "{line}: {errors}");
    };
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    run("bake card.glb -r 8 --refine 0 -o card.vtex");
    for (kind, name) in [("", "copies"), ("--bend ", "shell")] {
        run(&format!("map terrain.glb --texel card.vtex {kind}-o {name}.gltf"));
        run(&format!("map terrain.glb --texel card.vtex {kind}--wind 0.6 -o {name}-wind.gltf"));
        run(&format!("map terrain.glb --texel card.vtex {kind}--wind 0 -o {name}-calm.gltf"));
        let view = "--size 64x36 --camera far";
        for (file, time, out) in [
            (name.to_owned(), 2.0, "still"),
            (format!("{name}-wind"), 2.0, "wind"),
            (format!("{name}-wind"), 2.0, "again"),
            (format!("{name}-wind"), 3.5, "later"),
            (format!("{name}-calm"), 2.0, "calm"),
        ] {
            run(&format!("render {file}.gltf {view} --time {time} -o {out}.png"));
        }
        assert!(read("wind.png") == read("again.png") && read("calm.png") == read("still.png"), "{name}");
        assert!(read("wind.png") != read("still.png") && read("wind.png") != read("later.png"), "{name}");
    }
    let (code, _, errors) = vtex(folder.path(), "map terrain.glb --texel card.vtex --wind 9 -o a.gltf");
    assert!(code == 2 && errors.contains("--wind lies in 0 to 4"), "{errors}");
}

#[test]
fn sequences_are_compared_frame_by_frame() {
    let folder = land();
    for name in ["a.##.png", "b.##.png"] {
        let shift = if name.starts_with('a') { "" } else { "--loop " };
        let line = format!("render land.gltf --size 32x16 --frames 0..9 --fps 4 {shift}-o {name}");
        assert_eq!(vtex(folder.path(), &line).0, 0);
    }
    let compare = |words: &str| vtex(folder.path(), &format!("compare {words}"));
    let (code, text, _) = compare("a.##.png a.##.png --json");
    let same: Value = serde_json::from_str(&text).unwrap();
    assert_eq!((code, &same["temporal"]["error"]), (0, &json!(0.0)));
    assert!(same["temporal"]["change"][0].as_f64().unwrap() > 0.0);
    // The looped one jumps back at 2 s, from frame 7 to frame 8, where the other stands still from then on.
    let (code, text, _) = compare("b.##.png a.##.png --json");
    let jump: Value = serde_json::from_str(&text).unwrap();
    assert_eq!((code, &jump["temporal"]["worst_step"]), (0, &json!(7)));
    assert!(compare("b.##.png a.##.png").1.contains("temporal error"));
    std::fs::remove_file(folder.path().join("b.03.png")).unwrap();
    let (code, _, errors) = compare("b.##.png a.##.png");
    assert!(code == 1 && errors.contains("b.03.png") && errors.contains("missing"), "{errors}");
    std::fs::remove_file(folder.path().join("a.00.png")).unwrap();
    std::fs::remove_file(folder.path().join("a.09.png")).unwrap();
    for k in 0..3 {
        std::fs::remove_file(folder.path().join(format!("b.0{k}.png"))).unwrap();
    }
    let (code, _, errors) = compare("b.##.png a.##.png");
    assert!(code == 2 && errors.contains("the frames 4 to 9 are compared with 1 to 8"), "{errors}");
}
