//! Bilinear patches in files: as the extension lists them, as polygons of FB_ngon_encoding, and as quads of an OBJ.

use std::path::Path;

use assert_cmd::Command;
use serde_json::{Value, json};
use vtex::format;
use vtex::geom::{Aabb, DVec3};
use vtex::scene::gltf::{self, ReadOptions};
use vtex::volume::{Depth, Info, Volume, Voxel};

fn vtex(folder: &Path, args: &[&str]) -> assert_cmd::assert::Assert {
    Command::cargo_bin("vtex").unwrap().current_dir(folder).args(args).assert()
}

/// A cyclic texel of one voxel, a metre wide.
fn texel(path: &Path) {
    let info = Info {
        bounds: Aabb::new(DVec3::new(-0.5, 0.0, -0.5), DVec3::new(0.5, 1.0, 0.5)),
        facet_size: 0.01,
        cyclic: [true, true, false],
        ..Info::default()
    };
    let depths = vec![Depth { masks: vec![0], voxels: vec![Voxel::default()], mixes: Vec::new() }];
    format::write(&Volume { info, depths }, path, &Default::default()).unwrap();
}

/// Two patches side by side and a triangle, bent; `change` has the last word on the file.
fn landscape(folder: &Path, patches: &[u16], change: impl Fn(&mut Value)) {
    let positions: [[f32; 3]; 7] = [
        [0.0, 0.0, 0.0],
        [1.0, 0.2, 0.0],
        [2.0, 0.0, 0.0],
        [2.0, 0.3, -1.0],
        [1.0, 0.0, -1.0],
        [0.0, 0.1, -1.0],
        [3.0, 0.0, 0.0],
    ];
    let indices: [u16; 15] = [0, 1, 4, 0, 4, 5, 1, 2, 3, 1, 3, 4, 2, 6, 3];
    let mut bytes: Vec<u8> = positions.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend(positions.iter().flat_map(|p| [p[0], p[2]]).flat_map(f32::to_le_bytes));
    bytes.extend(indices.iter().flat_map(|i| i.to_le_bytes()));
    bytes.extend([0; 2]);
    bytes.extend(patches.iter().flat_map(|i| i.to_le_bytes()));
    std::fs::write(folder.join("l.bin"), &bytes).unwrap();
    let mut file = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "extensionsUsed": ["VTEX_volumetric_texture"],
        "extensions": {"VTEX_volumetric_texture": {"texels": [{"name": "t", "frames": [{"uri": "t.vtex"}]}]}},
        "materials": [{"extensions": {"VTEX_volumetric_texture": {"thickness": 0.5, "layers": [{"texel": 0}]}}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0,
            "extensions": {"VTEX_volumetric_texture": {"patches": 3}}}]}],
        "buffers": [{"uri": "l.bin", "byteLength": bytes.len()}],
        "bufferViews": [{"buffer": 0, "byteLength": 84}, {"buffer": 0, "byteOffset": 84, "byteLength": 56},
            {"buffer": 0, "byteOffset": 140, "byteLength": 30},
            {"buffer": 0, "byteOffset": 172, "byteLength": 2 * patches.len()}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 7, "type": "VEC3", "min": [0, 0, -1], "max": [3, 0.3, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 7, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 15, "type": "SCALAR"},
            {"bufferView": 3, "componentType": 5123, "count": patches.len(), "type": "SCALAR"}],
    });
    change(&mut file);
    std::fs::write(folder.join("l.gltf"), file.to_string()).unwrap();
}

const PATCHES: [u16; 8] = [0, 1, 4, 5, 1, 2, 3, 4];

#[test]
fn listed_patches_are_rendered_and_counted() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    texel(&folder.join("t.vtex"));
    landscape(folder, &PATCHES, |_| {});
    let scene = gltf::read(&folder.join("l.gltf"), &ReadOptions::default()).unwrap();
    let part = &scene.model.parts[0];
    assert_eq!(part.patches, [[0, 1, 4, 5], [1, 2, 3, 4]]);
    assert_eq!(part.triangles.len(), 5);
    assert!(scene.model.warnings.is_empty(), "{:?}", scene.model.warnings);
    let render = ["render", "l.gltf", "-o", "l.png", "--size", "32x24", "--stats", "--json"];
    let out = vtex(folder, &render).success().get_output().stdout.clone();
    let told: Value = serde_json::from_slice(&out).unwrap();
    assert_eq!((&told["patches"], &told["split_patches"]), (&json!(2), &json!(0)), "{told}");
}

#[test]
fn polygons_of_the_draft_are_patches_under_a_shell() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    let polygons = |file: &mut Value| {
        file["extensionsUsed"] = json!(["VTEX_volumetric_texture", "FB_ngon_encoding"]);
        file["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("extensions");
    };
    landscape(folder, &PATCHES, polygons);
    let read = || gltf::read(&folder.join("l.gltf"), &ReadOptions::default()).unwrap().model.parts.remove(0);
    assert_eq!(read().patches, [[0, 1, 4, 5], [1, 2, 3, 4]]);
    // A plain surface stays triangles.
    landscape(folder, &PATCHES, |file| {
        polygons(file);
        file["materials"] = json!([{}]);
    });
    assert!(read().patches.is_empty());
}

#[test]
fn what_are_no_patches_is_one_clear_line() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    texel(&folder.join("t.vtex"));
    let refused = |patches: &[u16], change: &dyn Fn(&mut Value), what: &str| {
        landscape(folder, patches, change);
        let failed = vtex(folder, &["render", "l.gltf", "-o", "l.png"]).failure().code(1).get_output().clone();
        let told = String::from_utf8(failed.stderr).unwrap();
        assert!(told.contains(what) && told.trim_end().lines().count() == 1, "{told}");
        assert!(!folder.join("l.png").exists());
    };
    let none = |_: &mut Value| {};
    refused(&PATCHES[..6], &none, "has 6 indices; a patch has 4");
    refused(&[0, 1, 4, 9], &none, "patch 0 has the vertex 9; the primitive has 7");
    refused(&[0, 1, 4, 5, 1, 2, 3, 0], &none, "patch 1 needs the triangles 2 and 3 to be (1, 2, 3) and (1, 3, 0)");
    refused(&[PATCHES, PATCHES].concat(), &none, "patch 2 needs the triangles 4 and 5");
    let primitive = |key: &'static str, value: Value| {
        move |file: &mut Value| file["meshes"][0]["primitives"][0][key] = value.clone()
    };
    refused(&PATCHES, &primitive("mode", json!(5)), "has patches, and is no list of triangles");
    let listed = |value: Value| primitive("extensions", json!({"VTEX_volumetric_texture": {"patches": value}}));
    refused(&PATCHES, &listed(json!("3")), "is not an accessor's index");
    refused(&PATCHES, &listed(json!(9)), "accessors[9]");
}

/// A quad, a triangle, and a five-cornered face.
const OBJ: &str = "mtllib g.mtl\nv 0 0 0\nv 1 .2 0\nv 1 0 -1\nv 0 .3 -1\nv 2 0 0\nv 2 0 -1\nv 2.5 0 -.5\n\
    vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt 2 0\nvt 2 1\nvt 2.5 .5\nusemtl red\n\
    f 1/1 2/2 3/3 4/4\nf 2/2 5/5 3/3\nf 5/5 7/7 6/6 3/3 2/2\nf 2/2 5/5 6/6 3/3\n";

#[test]
fn quads_of_an_obj_become_patches() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    texel(&folder.join("t.vtex"));
    std::fs::write(folder.join("g.obj"), OBJ).unwrap();
    std::fs::write(folder.join("g.mtl"), "newmtl red\nKd .6 .1 .1\nmap_Kd g.png\n").unwrap();
    image::RgbaImage::from_pixel(2, 2, image::Rgba([10, 200, 30, 255])).save(folder.join("g.png")).unwrap();
    vtex(folder, &["map", "g.obj", "--texel", "t.vtex", "-o", "l.glb"]).success();
    let scene = gltf::read(&folder.join("l.glb"), &ReadOptions::default()).unwrap();
    let (part, material) = (&scene.model.parts[0], &scene.model.materials[0]);
    assert_eq!((part.patches.len(), part.triangles.len()), (2, 8));
    assert!(material.shell.is_some() && material.name == "red");
    assert_eq!(material.texture.as_ref().unwrap().texture.texels, vec![[10, 200, 30, 255]; 4]);
    let render = ["render", "l.glb", "-o", "l.png", "--size", "32x24"];
    vtex(folder, &render).success();
    // As triangles, where they are wanted.
    vtex(folder, &["map", "g.obj", "--texel", "t.vtex", "-o", "plain.glb", "--no-patches"]).success();
    let plain = gltf::read(&folder.join("plain.glb"), &ReadOptions::default()).unwrap();
    assert!(plain.model.parts[0].patches.is_empty() && plain.model.parts[0].triangles.len() == 8);
    // What is wrong with the OBJ is told as ever.
    std::fs::write(folder.join("bad.obj"), "v 0 0 x\n").unwrap();
    let failed = vtex(folder, &["map", "bad.obj", "--texel", "t.vtex"]).failure().code(1).get_output().stderr.clone();
    assert!(String::from_utf8(failed).unwrap().contains("line 1"));
}

#[test]
fn polygons_are_mapped_as_patches_or_as_triangles() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    texel(&folder.join("t.vtex"));
    landscape(folder, &PATCHES, |file| {
        file["extensionsUsed"] = json!(["FB_ngon_encoding"]);
        file["materials"] = json!([{"name": "ground"}]);
        file["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("extensions");
        file.as_object_mut().unwrap().remove("extensions");
    });
    vtex(folder, &["map", "l.gltf", "--texel", "t.vtex", "-o", "m.gltf"]).success();
    let file: Value = serde_json::from_slice(&std::fs::read(folder.join("m.gltf")).unwrap()).unwrap();
    let listed = &file["meshes"][0]["primitives"][0]["extensions"]["VTEX_volumetric_texture"]["patches"];
    assert!(listed.is_u64(), "{file}");
    let patches =
        |name: &str| gltf::read(&folder.join(name), &ReadOptions::default()).unwrap().model.parts.remove(0).patches;
    assert_eq!(patches("m.gltf"), [[0, 1, 4, 5], [1, 2, 3, 4]]);
    // Mapped again, they stay; or go.
    vtex(folder, &["map", "m.gltf", "--texel", "t.vtex", "-o", "again.gltf"]).success();
    assert_eq!(patches("again.gltf").len(), 2);
    vtex(folder, &["map", "m.gltf", "--texel", "t.vtex", "-o", "none.gltf", "--no-patches"]).success();
    assert!(patches("none.gltf").is_empty());
}
