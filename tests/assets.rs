//! Every real file through `vtex bake`: what bakes has the colour that it should, the rest is refused by one line that says why.

use std::path::{Path, PathBuf};
use std::time::Duration;

use assert_cmd::Command;
use vtex::format::{Limits, Reader, verify};
use vtex::volume::Volume;

fn assets() -> Option<PathBuf> {
    std::env::var_os("VTEX_ASSETS").map(PathBuf::from)
}

/// `vtex bake` with at most 2 GiB of memory (where the system can hold it to that) and 60 s.
fn bake(input: &Path, output: &Path, args: &[&str]) -> std::process::Output {
    let program = assert_cmd::cargo::cargo_bin("vtex");
    let mut command = if cfg!(target_os = "linux") {
        let mut shell = Command::new("sh");
        shell.args(["-c", "ulimit -v 2097152; exec \"$0\" \"$@\""]).arg(program);
        shell
    } else {
        Command::new(program)
    };
    command.arg("bake").arg(input).arg("-o").arg(output).args(args).timeout(Duration::from_secs(60)).output().unwrap()
}

/// All files below `dir` in order.
fn walk(dir: &Path, out: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = std::fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() { walk(&path, out) } else { out.push(path) }
    }
}

fn texel(path: &Path) -> Volume {
    Reader::open(path, &Limits::default()).unwrap().read_all().unwrap()
}

fn errors(stderr: &str) -> usize {
    stderr.lines().filter(|l| l.starts_with("error:")).count()
}

/// What is refused, and a word of why.
const REFUSED: &[(&str, &str)] = &[
    ("gltf-features/draco/Box_Draco.glb", "KHR_draco_mesh_compression"),
    ("gltf-features/draco/DenseSphere.glb", "KHR_draco_mesh_compression"),
    ("gltf-features/scenes/00_no_nodes.gltf", "no node of the scene shows a mesh"),
    ("obj/tinyobjloader/line-prim.obj", "--line-width"),
    ("obj/tinyobjloader/points-prim.obj", "--line-width"),
    ("obj/tobj/lines.obj", "--line-width"),
];

#[test]
fn every_real_file_bakes_or_is_refused_by_name() {
    let Some(assets) = assets() else { return };
    let dir = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    ["plants", "terrain", "obj", "gltf-features"].iter().for_each(|d| walk(&assets.join(d), &mut files));
    files.retain(|f| matches!(f.extension().and_then(|e| e.to_str()), Some("gltf" | "glb" | "obj")));
    // 7.6 M triangles: the reading of it is tested elsewhere.
    files.retain(|f| !f.ends_with("24_gpu_instancing.gltf"));
    assert!(files.len() > 75);
    let mut refused = 0;
    for file in files {
        let out = dir.path().join("out.vtex");
        let run = bake(&file, &out, &["-r", "16"]);
        let stderr = String::from_utf8_lossy(&run.stderr);
        let name = file.strip_prefix(&assets).unwrap().to_str().unwrap();
        if let Some((_, word)) = REFUSED.iter().find(|(path, _)| *path == name) {
            assert_eq!(run.status.code(), Some(1), "{name}: {stderr}");
            assert!(errors(&stderr) == 1 && stderr.lines().count() == 1 && stderr.contains(word), "{name}: {stderr}");
            assert!(!out.exists(), "{name}");
            refused += 1;
            continue;
        }
        assert_eq!(run.status.code(), Some(0), "{name}: {stderr}");
        verify(&out).unwrap();
        assert!(texel(&out).depths.last().unwrap().voxels.len() > 2, "{name}");
        std::fs::remove_file(&out).unwrap();
    }
    assert_eq!(refused, REFUSED.len());
}

/// Linear colours of the whole, from darkest channel to brightest, as the textures and factors have them.
const COLOURS: &[(&str, &str)] = &[
    ("plants/ez-tree/flower_blue.glb", "rgb"),
    ("plants/kaykit/Grass_1_D_Color1.gltf", "brg"),
    ("plants/kaykit/Rock_3_R_Color1.gltf", "rgb"),
    ("plants/kaykit/Tree_4_C_Color1.gltf", "brg"),
    // A teal factor, as shipped.
    ("plants/kenney-nature/grass.glb", "rbg"),
    ("plants/kenney-nature/tree_default_fall.glb", "bgr"),
    ("plants/pinkponk/tree.glb", "brg"),
    ("plants/quaternius/Bush_Common.gltf", "gbr"),
    ("plants/quaternius/CommonTree_5.gltf", "brg"),
    ("plants/quaternius/Pine_5.gltf", "brg"),
    ("terrain/Mountains.gltf", "brg"),
    ("gltf-features/interleaved/BoxInterleaved.glb", "gbr"),
    ("gltf-features/skin/Fox.glb", "bgr"),
];

fn colour(volume: &Volume) -> String {
    let albedo = volume.depths[0].voxels[0].albedo();
    let mut order: Vec<(f32, char)> = vec![(albedo.x, 'r'), (albedo.y, 'g'), (albedo.z, 'b')];
    // Equal channels stay in the order r, g, b.
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    order.into_iter().map(|c| c.1).collect()
}

#[test]
fn plants_keep_their_colours() {
    let Some(assets) = assets() else { return };
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out.vtex");
    let mut wrong = Vec::new();
    for (name, want) in COLOURS {
        let run = bake(&assets.join(name), &out, &["-r", "16"]);
        assert!(run.status.success(), "{name}");
        let volume = texel(&out);
        let got = colour(&volume);
        if got != *want {
            wrong.push(format!("{name} {got} {}", volume.depths[0].voxels[0].albedo()));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn every_bad_file_gives_one_error_or_counted_warnings() {
    let Some(assets) = assets() else { return };
    let dir = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    walk(&assets.join("bad"), &mut files);
    files.retain(|f| !f.to_string_lossy().ends_with(".report.json"));
    assert!(files.len() > 140);
    for file in files {
        let run = bake(&file, &dir.path().join("out.vtex"), &["-r", "16"]);
        let stderr = String::from_utf8_lossy(&run.stderr);
        let name = file.display();
        match run.status.code() {
            Some(0) => {
                assert!(stderr.lines().any(|l| l.starts_with("warning:")), "{name}: {stderr}");
                std::fs::remove_file(dir.path().join("out.vtex")).unwrap();
            }
            Some(1) => assert!(errors(&stderr) == 1 && stderr.lines().count() == 1, "{name}: {stderr}"),
            other => panic!("{name}: {other:?} {stderr}"),
        }
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "{name} leaves nothing behind");
    }
}
