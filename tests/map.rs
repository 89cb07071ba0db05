//! `vtex map`: what it adds to a file, what it leaves alone, and where its references lead.

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::{Value, json};
use vtex::format;
use vtex::geom::{Aabb, DVec3};
use vtex::scene::Scene;
use vtex::scene::gltf::{self, ReadOptions};
use vtex::volume::{Depth, Info, Volume, Voxel};

/// A texel of one voxel that goes on from cell to cell: `size` metres wide, its content up to `top` of the cube.
fn texel(path: &Path, size: f64, top: f64) {
    let half = size / 2.0;
    let info = Info {
        bounds: Aabb::new(DVec3::new(-half, 0.0, -half), DVec3::new(half, size, half)),
        content: Aabb::new(DVec3::ZERO, DVec3::new(1.0, 1.0, top)),
        facet_size: 0.01,
        cyclic: [true, true, false],
        ..Info::default()
    };
    let depths = vec![Depth { masks: vec![0], voxels: vec![Voxel::default()], mixes: Vec::new() }];
    format::write(&Volume { info, depths }, path, &Default::default()).unwrap();
}

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(name)
}

fn vtex(folder: &Path, args: &[&str]) -> assert_cmd::assert::Assert {
    Command::cargo_bin("vtex").unwrap().current_dir(folder).args(args).assert()
}

fn read(path: &Path) -> Scene {
    gltf::read(path, &ReadOptions::default()).unwrap()
}

/// A flat `width` × `depth` metre quad in the plane y = 0 with texture coordinates over the unit square, v growing
/// towards +z as in an image seen from above, and no normals.
fn quad(path: &Path, width: f32, depth: f32) {
    let positions = [[0.0, 0.0, 0.0], [width, 0.0, 0.0], [0.0, 0.0, depth], [width, 0.0, depth]];
    let uvs = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0f32, 1.0]];
    let mut bytes: Vec<u8> = positions.iter().flatten().flat_map(|x: &f32| x.to_le_bytes()).collect();
    bytes.extend(uvs.iter().flatten().flat_map(|x| x.to_le_bytes()));
    bytes.extend([0u16, 2, 3, 0, 3, 1].iter().flat_map(|i| i.to_le_bytes()));
    let bin = path.with_extension("bin");
    std::fs::write(&bin, &bytes).unwrap();
    let uri = bin.file_name().unwrap().to_str().unwrap().replace(' ', "%20");
    let file = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "zzz": {"unknown": [1.5, "kept"]}, "extras": {"b": 1, "a": 0.1},
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2}]}],
        "buffers": [{"uri": uri, "byteLength": bytes.len()}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 32},
            {"buffer": 0, "byteOffset": 80, "byteLength": 12}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [width, 0, depth]},
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"}],
    });
    std::fs::write(path, file.to_string()).unwrap();
}

/// Everything of `before` is in `after`: objects may have more keys, arrays more entries at their end.
fn kept(before: &Value, after: &Value, at: &str) {
    match (before, after) {
        (Value::Object(a), Value::Object(b)) => {
            for (key, value) in a {
                kept(value, b.get(key).unwrap_or_else(|| panic!("{at}/{key} is gone")), &format!("{at}/{key}"));
            }
            let order: Vec<_> = b.keys().filter(|k| a.contains_key(*k)).collect();
            assert_eq!(order, a.keys().collect::<Vec<_>>(), "{at}: the order of keys");
        }
        (Value::Array(a), Value::Array(b)) => {
            assert!(b.len() >= a.len(), "{at}");
            for (i, value) in a.iter().enumerate() {
                kept(value, &b[i], &format!("{at}/{i}"));
            }
        }
        _ => assert_eq!(before, after, "{at}"),
    }
}

fn glb(path: &Path) -> (Value, Vec<u8>) {
    let bytes = std::fs::read(path).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    (serde_json::from_slice(&bytes[20..20 + length]).unwrap(), bytes[28 + length..].to_vec())
}

#[test]
fn a_terrain_with_texture_coordinates_is_covered_in_proportion() {
    let dir = tempfile::tempdir().unwrap();
    texel(&dir.path().join("tree.vtex"), 10.0, 0.8);
    let terrain = sample("terrain.glb");
    let args = ["map", terrain.to_str().unwrap(), "--texel", "tree.vtex", "--material", "forest", "-o", "out.glb"];
    vtex(dir.path(), &args).success();
    let scene = read(&dir.path().join("out.glb"));
    assert_eq!(scene.texels.len(), 1);
    assert_eq!(scene.texels[0].frames, [dir.path().join("tree.vtex")]);
    let shells: Vec<_> = scene.model.materials.iter().filter_map(|m| m.shell.as_ref().map(|s| (&m.name, s))).collect();
    assert_eq!(shells.len(), 1);
    let (name, shell) = &shells[0];
    assert_eq!(*name, "forest");
    // 320 m of unit-square coordinates hold 32 copies of 10 m; v of an image runs against the texel's.
    assert_eq!(shell.layers[0].scale, [32.0, -32.0, 1.0]);
    assert!((shell.dw - 0.8008).abs() < 1e-12 && (shell.thickness - 8.008).abs() < 1e-3, "{shell:?}");
    let part = scene.model.parts.iter().find(|p| scene.model.materials[p.material].name == "forest").unwrap();
    let up = part.heights.as_ref().unwrap();
    assert!(up.iter().all(|h| h[0] == 0.0 && h[2] == 0.0 && (f64::from(h[1]) - shell.thickness).abs() < 1e-5));
    assert!(scene.model.parts.iter().any(|p| p.heights.is_none()), "the meadow stays as it was");
    // The rest of the file is as it was, to the byte.
    let ((before, old), (after, new)) = (glb(&terrain), glb(&dir.path().join("out.glb")));
    let mut expected = before.clone();
    expected["buffers"][0]["byteLength"] = after["buffers"][0]["byteLength"].clone();
    kept(&expected, &after, "");
    assert_eq!(old, new[..old.len()]);
}

#[test]
fn a_second_mapping_adds_to_the_first() {
    let dir = tempfile::tempdir().unwrap();
    texel(&dir.path().join("tree.vtex"), 10.0, 1.0);
    texel(&dir.path().join("fern.vtex"), 1.6, 0.3);
    let terrain = sample("terrain.glb");
    let first = ["map", terrain.to_str().unwrap(), "--texel", "tree.vtex", "--material", "forest", "-o", "a b.gltf"];
    vtex(dir.path(), &first).success();
    vtex(dir.path(), &["map", "a b.gltf", "--texel", "fern.vtex", "--material", "meadow", "-o", "a b.gltf"]).success();
    let scene = read(&dir.path().join("a b.gltf"));
    assert_eq!(scene.texels.iter().map(|t| t.name.as_str()).collect::<Vec<_>>(), ["tree", "fern"]);
    let texel = |name: &str| {
        let material = scene.model.materials.iter().find(|m| m.name == name).unwrap();
        material.shell.as_ref().unwrap().layers[0].texel
    };
    assert_eq!((texel("forest"), texel("meadow")), (0, 1));
}

#[test]
fn a_layer_is_added_in_the_proportions_of_the_first() {
    let dir = tempfile::tempdir().unwrap();
    texel(&dir.path().join("tall.vtex"), 20.0, 1.0);
    texel(&dir.path().join("low.vtex"), 10.0, 0.8);
    let terrain = sample("terrain.glb");
    let base = ["map", terrain.to_str().unwrap(), "--material", "forest", "-o", "out.glb", "--texel"];
    vtex(dir.path(), &[&base[..], &["low.vtex", "--add"]].concat()).code(2);
    vtex(dir.path(), &[&base[..], &["tall.vtex"]].concat()).success();
    let before = read(&dir.path().join("out.glb"));
    let more = ["map", "out.glb", "--material", "forest", "-o", "out.glb", "--texel", "low.vtex", "--add"];
    vtex(dir.path(), &[&more[..], &["--offset", "0.5,-0.25"]].concat()).success();
    let after = read(&dir.path().join("out.glb"));
    let shell = |s: &Scene| s.model.materials.iter().find_map(|m| m.shell.clone()).unwrap();
    let (a, b) = (shell(&before), shell(&after));
    assert_eq!((a.thickness, a.dw, &a.layers[0]), (b.thickness, b.dw, &b.layers[0]));
    // A unit of w is 20 m of the shell, 10 m of the layer.
    let layer = &b.layers[1];
    assert_eq!((layer.texel, layer.offset), (1, [0.5, -0.25, 0.0]));
    assert_eq!(layer.scale[..2], [32.0, -32.0]);
    assert!((layer.scale[2] - 2.0).abs() < 1e-3, "{layer:?}");
    let heights = |s: &Scene| s.model.parts.iter().map(|p| p.heights.clone()).collect::<Vec<_>>();
    assert_eq!(heights(&before), heights(&after));
}

#[test]
fn a_bare_quad_gets_what_it_lacks_and_keeps_the_rest() {
    let dir = tempfile::tempdir().unwrap();
    texel(&dir.path().join("t.vtex"), 1.0, 1.0);
    let file = dir.path().join("ä quad.gltf");
    quad(&file, 8.0, 4.0);
    let args = ["--displace", "0", "--scale", "1", "--orientations", "identity"];
    vtex(dir.path(), &[&["map", "ä quad.gltf", "--texel", "t.vtex", "-o", "out.gltf"], &args[..]].concat()).success();
    let text = |p: &Path| serde_json::from_str::<Value>(&std::fs::read_to_string(p).unwrap()).unwrap();
    kept(&text(&file), &text(&dir.path().join("out.gltf")), "");
    let scene = read(&dir.path().join("out.gltf"));
    let shell = scene.model.materials.iter().find_map(|m| m.shell.clone()).unwrap();
    assert_eq!(shell.layers[0].scale, [8.0, -4.0, 1.0]);
    assert_eq!(scene.model.parts[0].heights, Some(vec![[0.0, 1.0, 0.0]; 4]));
    // The same by planar coordinates: right-handed, u along +x, v along −z.
    let planar = ["map", "ä quad.gltf", "--texel", "t.vtex", "-o", "out.glb", "--planar", "y", "--cell", "2"];
    vtex(dir.path(), &[&planar, &args[..]].concat()).success();
    let scene = read(&dir.path().join("out.glb"));
    let uvw = scene.model.parts[0].uvw.clone().unwrap();
    assert_eq!(uvw, [[0.0, 2.0, 0.0], [4.0, 2.0, 0.0], [0.0, 0.0, 0.0], [4.0, 0.0, 0.0]]);
    assert_eq!(scene.model.parts[0].heights, Some(vec![[0.0, 2.0, 0.0]; 4]));
    // Along the normals, made from the faces.
    let normals = ["map", "ä quad.gltf", "--texel", "t.vtex", "-o", "n.gltf", "--height-along", "normals"];
    vtex(dir.path(), &[&normals[..], &["--thickness", "3", "--repeat", "5,7"]].concat()).success();
    let scene = read(&dir.path().join("n.gltf"));
    assert_eq!(scene.model.parts[0].heights, Some(vec![[0.0, 3.0, 0.0]; 4]));
    let shell = scene.model.materials.iter().find_map(|m| m.shell.clone()).unwrap();
    assert_eq!((shell.layers[0].scale, shell.thickness), ([5.0, -7.0, 1.0], 3.0));
}

#[test]
fn references_resolve_from_another_folder() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("far away");
    std::fs::create_dir(&out).unwrap();
    texel(&dir.path().join("t.vtex"), 1.0, 1.0);
    quad(&dir.path().join("my quad.gltf"), 8.0, 8.0);
    vtex(dir.path(), &["map", "my quad.gltf", "--texel", "t.vtex", "-o", "far away/out.gltf"]).success();
    let scene = read(&out.join("out.gltf"));
    assert_eq!(scene.texels[0].frames, [out.join("t.vtex")]);
    assert!(out.join("t.vtex").is_file() && out.join("my quad.bin").is_file());
    // A texel below the output's folder is referred to, not copied.
    std::fs::create_dir(dir.path().join("texels é")).unwrap();
    texel(&dir.path().join("texels é/u.vtex"), 1.0, 1.0);
    vtex(dir.path(), &["map", "my quad.gltf", "--texel", "texels é/u.vtex", "-o", "near.gltf"]).success();
    assert_eq!(read(&dir.path().join("near.gltf")).texels[0].frames, [dir.path().join("texels é/u.vtex")]);
    // A different file of that name is not overwritten.
    texel(&dir.path().join("texels é/t.vtex"), 2.0, 1.0);
    let refused = vtex(dir.path(), &["map", "my quad.gltf", "--texel", "texels é/t.vtex", "-o", "far away/b.gltf"]);
    let error = String::from_utf8(refused.code(2).get_output().stderr.clone()).unwrap();
    assert!(error.contains("a different t.vtex is already there"), "{error}");
    assert!(!out.join("b.gltf").exists());
}

#[test]
fn what_cannot_be_done_is_said_in_one_line() {
    let dir = tempfile::tempdir().unwrap();
    texel(&dir.path().join("t.vtex"), 1.0, 1.0);
    quad(&dir.path().join("q.gltf"), 8.0, 8.0);
    for (args, code, what) in [
        (&["q.gltf", "--texel", "t.vtex", "--material", "rock"][..], 2, "no material is named rock"),
        (&["q.gltf", "--texel", "none.vtex"], 1, "none.vtex"),
        (&["none.gltf", "--texel", "t.vtex"], 1, "none.gltf"),
        (&["t.vtex", "--texel", "t.vtex"], 1, "t.vtex"),
        (&["q.gltf", "--texel", "t.vtex", "--repeat", "0"], 2, "above 0"),
        (&["q.gltf", "--texel", "t.vtex", "--scale", "0,2"], 2, "--scale"),
        (&["q.gltf", "--texel", "t.vtex", "--uv", "3"], 2, "TEXCOORD_3"),
        (&["q.gltf", "--texel", "t.vtex", "--planar", "x"], 2, "flat along"),
        (&["q.gltf", "--texel", "t.vtex", "--height-along", "0,0,0"], 2, "--height-along"),
    ] {
        let assert = vtex(dir.path(), &[&["map", "-o", "out.gltf"], args].concat()).code(code);
        let error = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
        assert!(error.contains(what) && error.lines().count() == 1, "{args:?}: {error}");
        assert!(!dir.path().join("out.gltf").exists());
    }
}
