//! `vtex export` of sources: the mesh is what the texel was baked from, and what is no mesh is refused.

use std::path::Path;

use assert_cmd::Command;
use serde_json::Value;

fn sample(name: &str) -> String {
    format!("{}/samples/{name}", env!("CARGO_MANIFEST_DIR"))
}

fn vtex(folder: &Path, arguments: &[&str]) -> (i32, String) {
    let output = Command::cargo_bin("vtex").unwrap().args(arguments).current_dir(folder).output().unwrap();
    let text = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap()).concat();
    (output.status.code().unwrap(), text)
}

fn done(folder: &Path, arguments: &[&str]) -> String {
    let (code, text) = vtex(folder, arguments);
    assert_eq!(code, 0, "{arguments:?}: {text}");
    text
}

/// A plant of a grammar, whose texel's landscape is traced by its mesh: a reference, near triangles and an expanded scene.
#[test]
fn a_grammars_mesh_stands_for_its_texel() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let plant = sample("lsystems/flower.lsys");
    done(folder, &["export", &plant, "-o", "plant.glb", "-r", "128"]);
    done(folder, &["bake", &plant, "-r", "64", "-o", "plant.vtex"]);
    done(folder, &["bake", "plant.glb", "-r", "64", "-o", "again.vtex"]);
    let inspected =
        |file: &str| -> Value { serde_json::from_str(&done(folder, &["inspect", file, "--json"])).unwrap() };
    let [own, again] = ["plant.vtex", "again.vtex"].map(|file| inspected(file)["voxels"].as_f64().unwrap());
    // The finer tubes of the mesh cross some more voxels.
    assert!((again / own - 1.0).abs() < 0.05, "{own} {again}");
    let ground = sample("terrain.glb");
    let map = ["map", &ground, "--texel", "plant.vtex", "--geometry", "plant.glb", "--repeat", "6", "-o", "land.gltf"];
    done(folder, &map);
    let view = ["--size", "64x36", "--ambient", "constant", "-q"];
    let picture = |extra: &[&str], output: &str| {
        done(folder, &[&["render", "land.gltf", "-o", output][..], extra, &view].concat());
    };
    picture(&[], "drawn.exr");
    picture(&["--reference", "16"], "truth.exr");
    let compared: Value =
        serde_json::from_str(&done(folder, &["compare", "drawn.exr", "truth.exr", "--json"])).unwrap();
    let flip = compared["all"]["flip"].as_f64().unwrap_or(f64::NAN);
    let area = compared["area"]["ratio"].as_f64().unwrap_or(f64::NAN);
    // The halves of sixteen samples differ by .028; the texel's own error is about as large. Half of a percent of the area is .003.
    assert!(flip < 0.05 && (area - 1.0).abs() < 0.015, "{compared}");
    done(folder, &["expand", "land.gltf", "-o", "expanded.glb"]);
}

#[test]
fn what_is_no_mesh_is_refused_in_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let fern = sample("lsystems/fern.lsys");
    done(folder, &["bake", &sample("fern.glb"), "-r", "8", "-o", "fern.vtex"]);
    std::fs::write(folder.join("cloud.toml"), "[[node]]\n").unwrap();
    for (arguments, code, words) in [
        (vec!["export", &fern, "-o", "fern.html"], 2, "is a source, which becomes a mesh"),
        (vec!["export", &fern, "-o", "fern.glb", "--depth", "3"], 2, "--depth says how texels are written"),
        (vec!["export", &fern, "-o", "fern.glb", "--title", "x"], 2, "--title says how texels are written"),
        (vec!["export", &fern, "-o", "fern.glb", "--form", "points"], 2, "--form says how texels are written"),
        (vec!["export", &fern, "-o", "fern.glb", "--least-opacity", "0"], 2, "--least-opacity says how texels"),
        (vec!["export", &fern, "-o", "fern.glb", "-r", "0"], 2, "out of range"),
        (vec!["export", &fern, "-o", "fern.glb", "--max-triangles", "7"], 1, "triangles of the source's facets"),
        (vec!["export", &fern, "-o", "fern.glb", "--iso", "3"], 2, "--iso says how"),
        (vec!["export", "fern.vtex", "-o", "fern.glb", "-r", "8"], 2, "-r says how sources become meshes"),
        (vec!["export", "fern.vtex", "-o", "fern.html", "--max-triangles", "7"], 2, "--max-triangles says how sources"),
        (vec!["export", "fern.vtex", "-o", "fern.glb", "--memory", "1G"], 2, "--memory says how sources"),
        (vec!["export", "fern.vtex", "-o", "fern.glb", "--tint"], 2, "--tint says how sources become meshes"),
        (vec!["export", "fern.vtex", "-o", "fern.glb", "--iso", "3"], 2, "--iso says how"),
        (vec!["export", "missing.lsys", "-o", "fern.glb"], 1, "missing.lsys"),
        (vec!["export", "cloud.toml", "-o", "fern.glb"], 1, "cloud.toml"),
    ] {
        let (found, text) = vtex(folder, &arguments);
        assert!(found == code && text.contains(words), "{arguments:?}: {found} {text}");
        assert_eq!(text.trim_end().lines().count(), 1, "{arguments:?}: {text}");
        assert!(!folder.join("fern.glb").exists() && !folder.join("fern.html").exists());
    }
}
