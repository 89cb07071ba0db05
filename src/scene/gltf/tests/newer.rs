//! What glTF 2.0 has come to allow since it was written.

use serde_json::json;

use super::super::ReadOptions;
use super::{Builder, U8, U16, warned};

#[test]
fn a_scene_needs_no_list_of_nodes() {
    let b = Builder::triangle().set("/scenes", json!([{"name": "empty"}, {"nodes": [0]}]));
    let scene = |s: &str| ReadOptions { scene: Some(s.into()), ..ReadOptions::default() };
    assert_eq!(b.read_with(&scene("1")).unwrap().model.instances.len(), 1);
    assert!(b.read_with(&scene("empty")).unwrap_err().to_string().contains("nothing is drawn"));
}

#[test]
fn floats_of_64_bits() {
    let mut b = Builder::new();
    let values = [0.0f64, 0.0, 0.0, 1.5, 0.0, 0.0, 0.0, -2.25, 0.0];
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let a = b.array("VEC3", 5130, &bytes, 3);
    let b = b.attribute("POSITION", a);
    assert!(b.error().contains("unknown componentType"));
    for key in ["/extensionsUsed", "/extensionsRequired"] {
        let mut declared = Builder { json: b.json.clone(), bin: b.bin.clone() };
        declared = declared.set(key, json!(["KHR_accessor_float64"]));
        assert_eq!(declared.model().parts[0].positions, [[0.0; 3], [1.5, 0.0, 0.0], [0.0, -2.25, 0.0]]);
    }
    // Cut short: three elements of 24 bytes.
    let mut b = Builder::new();
    let a = b.array("VEC3", 5130, &bytes[..71], 3);
    let b = b.attribute("POSITION", a).set("/extensionsUsed", json!(["KHR_accessor_float64"]));
    assert!(b.error().contains("reach beyond a view of 71 bytes"));
}

#[test]
fn strips_begin_again_at_the_largest_index() {
    let mut base = Builder::new();
    let a = base.floats("VEC3", &[0., 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 0., 2., 3., 0., 4., 9., 0.]);
    let shorts = [0u16, 1, 2, u16::MAX, u16::MAX, 3, 4, 5, 0].map(u16::to_le_bytes).concat();
    let indices = base.array("SCALAR", U16, &shorts, 9);
    let bytes = base.array("SCALAR", U8, &[0, 1, 2, 255, 3, 4, 5, 0], 8);
    let base = base.attribute("POSITION", a).set("/extensionsRequired", json!(["KHR_mesh_primitive_restart"]));
    // 3 + 3 triangles of strips and fans would be 6 of one; a loop closes each of its runs.
    for (indices, mode, counts) in
        [(indices, 5, [3, 0]), (indices, 6, [3, 0]), (bytes, 5, [3, 0]), (indices, 3, [0, 5]), (indices, 2, [0, 7])]
    {
        let mut b = Builder { json: base.json.clone(), bin: base.bin.clone() };
        b = b.set("/meshes/0/primitives/0/mode", json!(mode)).set("/meshes/0/primitives/0/indices", json!(indices));
        let part = b.model().parts[0].clone();
        assert_eq!([part.triangles.len(), part.lines.len()], counts, "{mode}");
        assert_eq!(warned(&b.model(), "beyond its vertices"), 0);
    }
    // Without the extension it is an index like others, that is none of a vertex.
    let mut b = Builder { json: base.json.clone(), bin: base.bin.clone() };
    b.json.as_object_mut().unwrap().remove("extensionsRequired");
    let b = b.set("/meshes/0/primitives/0/mode", json!(5)).set("/meshes/0/primitives/0/indices", json!(indices));
    assert!(warned(&b.model(), "beyond its vertices") > 0);
}
