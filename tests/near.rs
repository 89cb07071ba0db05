//! Where a pixel is smaller than a voxel: the source's triangles are traced, and only there are they read.

use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};
use vtex::render::{image_io, metrics};

fn vtex(folder: &Path, arguments: &str) -> (String, String) {
    let output =
        Command::new(env!("CARGO_BIN_EXE_vtex")).args(arguments.split(' ')).current_dir(folder).output().unwrap();
    let [out, errors] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    assert!(output.status.success(), "{arguments}: {errors}");
    (out, errors)
}

/// Ten metres of level ground with sixteen ferns of few voxels, in a folder.
fn landscape() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let sample = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/fern.glb");
    std::fs::copy(sample, dir.path().join("fern.glb")).unwrap();
    let corners = [[-5.0f32, 0.0, -5.0], [-5.0, 0.0, 5.0], [5.0, 0.0, 5.0], [5.0, 0.0, -5.0]];
    let triangles = [0u16, 1, 2, 0, 2, 3];
    let mut bytes: Vec<u8> = corners.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend(triangles.iter().flat_map(|i| i.to_le_bytes()));
    std::fs::write(dir.path().join("ground.bin"), &bytes).unwrap();
    let ground = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.1, 0.05, 1.0]}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "buffers": [{"uri": "ground.bin", "byteLength": 60}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-5, 0, -5], "max": [5, 0, 5]},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}],
    });
    std::fs::write(dir.path().join("ground.gltf"), ground.to_string()).unwrap();
    vtex(dir.path(), "bake fern.glb -r 16 -o fern.vtex");
    vtex(dir.path(), "map ground.gltf --bend --texel fern.vtex --geometry fern.glb --cell 2.5 -o land.gltf");
    dir
}

/// Under a constant sky and a sun without a size, as all that is measured.
const NEAR: &str = "render land.gltf --eye 1.2,2.2,5.5 --look-at 0.6,0.6,0 --fov 12 --sky 0.35,0.42,0.52 --ambient constant --sun-angle 0";

#[test]
fn near_the_camera_the_source_is_seen() {
    let dir = landscape();
    let folder = dir.path();
    vtex(folder, &format!("{NEAR} --size 96x54 -o truth.exr --reference 32"));
    let flip = |more: &str| {
        let (stats, _) = vtex(folder, &format!("{NEAR} --size 96x54 -o got.exr --stats --json {more}"));
        let [got, truth] = ["got.exr", "truth.exr"].map(|name| image_io::read(&folder.join(name)).unwrap());
        let stats: Value = serde_json::from_str(&stats).unwrap();
        (metrics::compare(&got, &truth, &metrics::Options::default()).unwrap().all, stats)
    };
    let (near, stats) = flip("--lanes 4");
    let (voxels, without) = flip("--lanes 4 --near voxels");
    assert!(stats["near_copies"].as_u64() > Some(0) && stats["near_triangles"].as_u64() > Some(100), "{stats}");
    assert_eq!((without["near_copies"].as_u64(), without["near_triangles"].as_u64()), (Some(0), Some(0)));
    // Four rays a pixel against 32: what remains is the noise of edges, .047 as with `--reference 4`. A voxel is seven pixels wide.
    assert!(near.flip < 0.06 && near.flip < 0.85 * voxels.flip, "{} {}", near.flip, voxels.flip);
    assert!(near.bias.abs() < 0.01, "{}", near.bias);
}

/// Pixels along edges take more cones than the lanes that are asked for, and others do not.
#[test]
fn lanes_are_added_along_edges() {
    let dir = landscape();
    let folder = dir.path();
    vtex(folder, &format!("{NEAR} --size 96x54 -o truth.exr --reference 64"));
    let truth = image_io::read(&folder.join("truth.exr")).unwrap();
    let mut last = f64::INFINITY;
    for lanes in [1, 2, 4, 8] {
        let (stats, _) = vtex(folder, &format!("{NEAR} --size 96x54 -o got.exr --stats --json --lanes {lanes}"));
        let stats: Value = serde_json::from_str(&stats).unwrap();
        let cones = stats["cones"].as_f64().unwrap() / (96.0 * 54.0);
        let most = if lanes == 1 { 3.0 } else { 2.0 * f64::from(lanes) };
        // The ground between the ferns has no edges, and of several lanes that agree two are taken.
        assert!(cones > 1.05 * f64::from(lanes.min(2)) && cones < 0.9 * most, "{lanes} lanes: {cones} cones");
        let got = image_io::read(&folder.join("got.exr")).unwrap();
        let found = metrics::compare(&got, &truth, &metrics::Options::default()).unwrap().all;
        assert!(found.flip < last && found.bias.abs() < 0.01, "{lanes} lanes: {} {}", found.flip, found.bias);
        last = found.flip;
    }
}

/// Whether a pixel takes more depends on its neighbours, also where these belong to another tile.
#[test]
fn tiles_make_the_picture() {
    let dir = landscape();
    let folder = dir.path();
    let render = |more: &str| vtex(folder, &format!("{NEAR} --size 48x27 {more}"));
    render("-o whole.exr");
    let tiles = ["0,0,19,13", "19,0,29,13", "0,13,47,14", "47,13,1,14"];
    for (i, tile) in tiles.iter().enumerate() {
        render(&format!("-o {i}.exr --tile {tile}"));
    }
    vtex(folder, "stitch 0.exr 1.exr 2.exr 3.exr -o stitched.exr");
    let [whole, stitched] = ["whole.exr", "stitched.exr"].map(|name| std::fs::read(folder.join(name)).unwrap());
    assert!(whole == stitched);
}

/// Four tenths of a layer's facets are there, as triangles near the camera and in the reference.
#[test]
fn thinned_layers_are_thin_near_the_camera() {
    let dir = landscape();
    let folder = dir.path();
    let path = folder.join("land.gltf");
    let mut land: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let layers = "/extensions/VTEX_volumetric_texture/layers/0";
    let materials = land["materials"].as_array_mut().unwrap();
    let layer = materials.iter_mut().find_map(|m| m.pointer_mut(layers)).unwrap();
    layer["opacityScale"] = json!(0.4);
    std::fs::write(&path, land.to_string()).unwrap();
    let picture = |more: &str| {
        vtex(folder, &format!("{NEAR} --size 96x54 -o a.exr {more}"));
        image_io::read(&folder.join("a.exr")).unwrap()
    };
    let (truth, near) = (picture("--reference 32"), picture("--lanes 16"));
    let found = metrics::compare(&near, &truth, &metrics::Options::default()).unwrap().all;
    // As opaque ferns have it: noise of edges, and no bias.
    assert!(found.flip < 0.06 && found.bias.abs() < 0.015, "{} {}", found.flip, found.bias);
}

#[test]
fn the_source_is_read_only_where_it_is_seen() {
    let dir = landscape();
    let folder = dir.path();
    // A pixel of a metre.
    let far = "render land.gltf --frame --size 16x9 --stats --json -o far.png";
    let stats: Value = serde_json::from_str(&vtex(folder, far).0).unwrap();
    assert_eq!(stats["near_triangles"].as_u64(), Some(0), "{stats}");
    std::fs::remove_file(folder.join("fern.glb")).unwrap();
    let (_, said) = vtex(folder, far);
    assert!(!said.contains("geometry"), "{said}");
    let (_, said) = vtex(folder, &format!("{NEAR} --size 16x9 -o near.png"));
    assert!(
        said.contains("geometry cannot be read; near the camera its voxels show") && said.contains("fern.glb"),
        "{said}"
    );
}
