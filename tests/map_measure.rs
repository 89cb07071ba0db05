//! `vtex map` measures what it covers: texture transforms, densities that differ, meshes shown in several sizes, vectors that
//! the file brings, and grounds that are not as they should be.

use std::path::Path;

use assert_cmd::Command;
use serde_json::{Value, json};
use vtex::format;
use vtex::geom::{Aabb, DVec3};
use vtex::scene::Scene;
use vtex::scene::gltf::{self, ReadOptions};
use vtex::volume::{Depth, Info, Volume, Voxel};

/// A texel of one voxel, `size` metres wide and filled to the top, that goes on from cell to cell.
fn turf(path: &Path, size: f64) {
    texel(path, size, true);
}

fn texel(path: &Path, size: f64, cyclic: bool) {
    let half = size / 2.0;
    let info = Info {
        bounds: Aabb::new(DVec3::new(-half, 0.0, -half), DVec3::new(half, size, half)),
        facet_size: 0.01,
        cyclic: [cyclic, cyclic, false],
        ..Info::default()
    };
    let depths = vec![Depth { masks: vec![0], voxels: vec![Voxel::default()], mixes: Vec::new() }];
    format::write(&Volume { info, depths }, path, &Default::default()).unwrap();
}

/// A flat square around the origin in y = 0: its width in metres, how far its texture coordinates go, whether it faces up.
#[derive(Clone, Copy)]
struct Square {
    width: f32,
    uv: f32,
    faces_up: bool,
    material: usize,
}

const SQUARE: Square = Square { width: 100.0, uv: 1.0, faces_up: true, material: 0 };

/// A file with one mesh a square, `more` vector attributes of four elements on each, and the given nodes and materials.
fn file(path: &Path, squares: &[Square], more: &[(&str, [f32; 3])], nodes: Value, materials: Value) {
    let (mut bytes, mut views, mut accessors, mut meshes) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut push = |data: Vec<u8>, component: u32, count: usize, kind: &str| {
        views.push(json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": data.len()}));
        bytes.extend(data);
        let view = views.len() - 1;
        accessors.push(json!({"bufferView": view, "componentType": component, "count": count, "type": kind}));
        view
    };
    let floats = |values: &[f32]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    for s in squares {
        let h = s.width / 2.0;
        let positions = floats(&[-h, 0.0, -h, h, 0.0, -h, -h, 0.0, h, h, 0.0, h]);
        let uvs = floats(&[0.0, 0.0, s.uv, 0.0, 0.0, s.uv, s.uv, s.uv]);
        let indices = if s.faces_up { [0u16, 2, 3, 0, 3, 1] } else { [0, 3, 2, 0, 1, 3] };
        let mut attributes = json!({"POSITION": push(positions, 5126, 4, "VEC3")});
        attributes["TEXCOORD_0"] = json!(push(uvs, 5126, 4, "VEC2"));
        for (name, value) in more {
            attributes[*name] = json!(push(floats(&value.repeat(4)), 5126, 4, "VEC3"));
        }
        let indices = push(indices.iter().flat_map(|i| i.to_le_bytes()).collect(), 5123, 6, "SCALAR");
        let primitive = json!({"attributes": attributes, "indices": indices, "material": s.material});
        meshes.push(json!({"primitives": [primitive]}));
    }
    let roots: Vec<usize> = (0..nodes.as_array().unwrap().len()).collect();
    let bin = path.with_extension("bin");
    std::fs::write(&bin, &bytes).unwrap();
    let uri = bin.file_name().unwrap().to_str().unwrap();
    let file = json!({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": roots}], "nodes": nodes,
        "meshes": meshes, "materials": materials, "textures": [{}],
        "buffers": [{"uri": uri, "byteLength": bytes.len()}], "bufferViews": views, "accessors": accessors});
    std::fs::write(path, file.to_string()).unwrap();
}

/// Map `in.gltf` with `turf.vtex`; what was said, and what is in the output.
fn mapped(folder: &Path, args: &[&str]) -> (String, Scene) {
    let all = [&["map", "in.gltf", "--texel", "turf.vtex", "-o", "out.gltf"], args].concat();
    let run = Command::cargo_bin("vtex").unwrap().current_dir(folder).args(&all).assert().success();
    let said = String::from_utf8(run.get_output().stderr.clone()).unwrap();
    (said, gltf::read(&folder.join("out.gltf"), &ReadOptions::default()).unwrap())
}

/// Layer's scale and offset of the material of that name.
fn layer(scene: &Scene, name: &str) -> ([f64; 3], [f64; 3]) {
    let material = scene.model.materials.iter().find(|m| m.name == name).unwrap();
    let layer = &material.shell.as_ref().unwrap().layers[0];
    (layer.scale, layer.offset)
}

#[test]
fn the_transform_of_the_texture_counts() {
    let folder = tempfile::tempdir().unwrap();
    turf(&folder.path().join("turf.vtex"), 10.0);
    let transform = json!({"offset": [0.25, 0.5], "scale": [4.0, 4.0]});
    let of = |transform: &Value| {
        let texture = json!({"index": 0, "extensions": {"KHR_texture_transform": transform}});
        json!([{"name": "soil", "pbrMetallicRoughness": {"baseColorTexture": texture}}])
    };
    // A quarter of the unit square that the transform makes whole again, as packers of coordinates write it.
    let quarter = Square { uv: 0.25, ..SQUARE };
    file(&folder.path().join("in.gltf"), &[quarter], &[], json!([{"mesh": 0}]), of(&transform));
    let (said, scene) = mapped(folder.path(), &["--repeat", "20"]);
    assert_eq!(layer(&scene, "soil"), ([80.0, -80.0, 1.0], [5.0, -10.0, 0.0]));
    assert!(said.contains("covered soil: copies 5.000 × 5.000 m, 5.000 m high, about 400 of them"), "{said}");
    // A layer cannot turn: then the coordinates are written.
    let mut turned = transform.clone();
    turned["rotation"] = json!(std::f64::consts::FRAC_PI_2);
    file(&folder.path().join("in.gltf"), &[quarter], &[], json!([{"mesh": 0}]), of(&turned));
    let (said, scene) = mapped(folder.path(), &["--repeat", "20"]);
    assert!(said.contains("copies 5.000 × 5.000 m"), "{said}");
    assert_eq!(layer(&scene, "soil"), ([1.0; 3], [0.0; 3]));
    let uvw = scene.model.parts[0].uvw.clone().unwrap();
    // (u, v) = (v·4 + .25, −u·4 + .5), twenty copies a unit, v against the image's; rounded to f32.
    for (q, [u, v]) in uvw.iter().zip([[0.0, 0.0], [0.25, 0.0], [0.0, 0.25], [0.25, 0.25f32]]) {
        let want = [20.0 * (4.0 * v + 0.25), -20.0 * (0.5 - 4.0 * u)];
        assert!((q[0] - want[0]).abs() < 1e-4 && (q[1] - want[1]).abs() < 1e-4, "{q:?} {want:?}");
    }
}

#[test]
fn each_density_has_its_scale() {
    let folder = tempfile::tempdir().unwrap();
    turf(&folder.path().join("turf.vtex"), 10.0);
    let small = Square { width: 20.0, material: 1, ..SQUARE };
    let nodes = json!([{"mesh": 0}, {"mesh": 1, "translation": [80, 0, 0]}]);
    file(&folder.path().join("in.gltf"), &[SQUARE, small], &[], nodes.clone(), json!([{"name": "a"}, {"name": "b"}]));
    let (said, scene) = mapped(folder.path(), &[]);
    assert_eq!(layer(&scene, "a").0, [10.0, -10.0, 1.0]);
    assert_eq!(layer(&scene, "b").0, [2.0, -2.0, 1.0]);
    assert!(said.contains("covered a: copies 10.000 × 10.000 m, 10.000 m high, about 100 of them"), "{said}");
    assert!(said.contains("covered b: copies 10.000 × 10.000 m, 10.000 m high, about 4 of them"), "{said}");
    // Of one material, no layer serves both, and coordinates are written.
    let small = Square { material: 0, ..small };
    file(&folder.path().join("in.gltf"), &[SQUARE, small], &[], nodes, json!([{"name": "a"}]));
    let (said, scene) = mapped(folder.path(), &[]);
    assert!(said.contains("copies 10.000 × 10.000 m, 10.000 m high, about 104 of them"), "{said}");
    let extent = |part: usize| {
        let uvw = scene.model.parts[part].uvw.as_ref().unwrap();
        uvw.iter().fold(0.0_f32, |m, q| m.max(q[0].abs()).max(q[1].abs()))
    };
    assert_eq!((extent(0), extent(1)), (10.0, 2.0));
}

#[test]
fn a_mesh_shown_in_two_sizes_gets_copies_of_one_size() {
    let folder = tempfile::tempdir().unwrap();
    turf(&folder.path().join("turf.vtex"), 10.0);
    // The third is turned about the heights alone, and shares the first one's mapping.
    let nodes = json!([{"mesh": 0}, {"mesh": 0, "translation": [400, 0, 0], "scale": [5, 5, 5]},
        {"mesh": 0, "translation": [0, 0, 200], "rotation": [0, 0.6, 0, 0.8]}]);
    file(&folder.path().join("in.gltf"), &[SQUARE], &[], nodes, json!([{"name": "a"}]));
    let (said, scene) = mapped(folder.path(), &[]);
    // 100 + 2500 + 100 cells of 10 m.
    assert!(said.contains("copies 10.000 × 10.000 m, 10.000 m high, about 2700 of them"), "{said}");
    assert_eq!(scene.model.parts.len(), 2);
    for instance in &scene.model.instances {
        let part = &scene.model.parts[instance.part];
        let up = DVec3::from(part.heights.as_ref().unwrap()[0].map(f64::from));
        assert!((instance.transform.transform_vector3(up) - 10.0 * DVec3::Y).length() < 1e-5);
        let (q, p) = (part.uvw.as_ref().unwrap(), &part.positions);
        let across = |v: &[[f32; 3]]| f64::from(v[1][0] - v[0][0]);
        let metres = across(p) * instance.transform.matrix3.x_axis.length();
        assert!((metres / across(q) - 10.0).abs() < 1e-5, "{metres}");
    }
}

#[test]
fn vectors_that_the_file_brings_stay() {
    let folder = tempfile::tempdir().unwrap();
    turf(&folder.path().join("turf.vtex"), 10.0);
    let own = [("_VTEX_HEIGHT", [1.0, 3.0, 0.0]), ("_VTEX_UVW", [0.5, 0.25, 0.0f32])];
    file(&folder.path().join("in.gltf"), &[SQUARE], &own, json!([{"mesh": 0}]), json!([{"name": "a"}]));
    let (said, scene) = mapped(folder.path(), &[]);
    assert!(said.contains("kept the file's own _VTEX_UVW, _VTEX_HEIGHT, _VTEX_DW"), "{said}");
    let part = &scene.model.parts[0];
    assert_eq!((&part.heights, &part.uvw), (&Some(vec![own[0].1; 4]), &Some(vec![own[1].1; 4])));
    assert_eq!(layer(&scene, "a").0, [1.0; 3]);
    let (said, scene) = mapped(folder.path(), &["--replace"]);
    assert!(!said.contains("kept"), "{said}");
    assert_eq!(scene.model.parts[0].heights, Some(vec![[0.0, 10.0, 0.0]; 4]));
    assert_eq!((scene.model.parts[0].uvw.is_none(), layer(&scene, "a").0), (true, [10.0, -10.0, 1.0]));
    // What a mapping wrote, the next one writes again.
    std::fs::rename(folder.path().join("out.gltf"), folder.path().join("in.gltf")).unwrap();
    let (said, scene) = mapped(folder.path(), &["--repeat", "5"]);
    assert!(!said.contains("kept"), "{said}");
    assert_eq!(scene.model.parts[0].heights, Some(vec![[0.0, 20.0, 0.0]; 4]));
}

#[test]
fn heights_made_with_z_up_are_noticed_and_turned() {
    let folder = tempfile::tempdir().unwrap();
    turf(&folder.path().join("turf.vtex"), 10.0);
    let own = [("_VTEX_HEIGHT", [0.0, 0.5, 8.0f32])];
    file(&folder.path().join("in.gltf"), &[SQUARE], &own, json!([{"mesh": 0}]), json!([{"name": "a"}]));
    let (said, scene) = mapped(folder.path(), &[]);
    assert!(said.contains("warning: the file's _VTEX_HEIGHT vectors lie flat"), "{said}");
    assert_eq!(scene.model.parts[0].heights, Some(vec![own[0].1; 4]));
    let (said, scene) = mapped(folder.path(), &["--heights", "z-up"]);
    assert!(!said.contains("warning"), "{said}");
    assert_eq!(scene.model.parts[0].heights, Some(vec![[0.0, 8.0, -0.5]; 4]));
}

#[test]
fn a_ground_that_faces_down_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    turf(&folder.path().join("turf.vtex"), 10.0);
    let flipped = Square { faces_up: false, ..SQUARE };
    file(&folder.path().join("in.gltf"), &[flipped], &[], json!([{"mesh": 0}]), json!([{"name": "a"}]));
    let (said, scene) = mapped(folder.path(), &[]);
    assert!(said.contains("warning: the ground faces down"), "{said}");
    assert_eq!(scene.model.parts[0].heights, Some(vec![[0.0, 10.0, 0.0]; 4]));
    // (u, v, up) stays right-handed although the faces are turned over.
    assert_eq!(layer(&scene, "a").0, [10.0, -10.0, 1.0]);
    let (said, scene) = mapped(folder.path(), &["--height-along", "normals"]);
    assert!(said.contains("warning: the ground faces down"), "{said}");
    assert_eq!(scene.model.parts[0].heights, Some(vec![[0.0, -10.0, 0.0]; 4]));
}

#[test]
fn what_a_shell_cuts_or_stretches_is_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let texels = folder.path().join("turf.vtex");
    file(&folder.path().join("in.gltf"), &[SQUARE], &[], json!([{"mesh": 0}]), json!([{"name": "soil"}]));
    let said = |more: &[&str]| mapped(folder.path(), more).0;
    turf(&texels, 1.0);
    // What is cyclic shows no copies that could be cut.
    assert!(!said(&["--repeat", "9.5"]).contains("warning"));
    let wide = said(&["--repeat", "10,5"]);
    assert!(wide.contains("warning: soil: copies are stretched to 10.000 × 20.000 m"), "{wide}");
    texel(&texels, 1.0, false);
    for (more, cut) in [
        (&["--repeat", "10", "--displace", "0"][..], false),
        (&["--repeat", "9.5", "--displace", "0"], true),
        (&["--repeat", "10", "--displace", "0.1"], true),
    ] {
        let text = said(&[&["--bend"], more].concat());
        assert_eq!(text.contains("warning: soil: copies that stand where it"), cut, "{more:?}: {text}");
    }
    // Rigid copies are whole.
    assert!(!said(&["--density", "100"]).contains("cut"));
}
