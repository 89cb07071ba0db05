//! Small files with known numbers, one feature each.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2};
use std::path::Path;

use serde_json::{Value, json};

use super::{ReadOptions, read};
use crate::geom::{DVec3, Vec3};
use crate::scene::phong::Phong;
use crate::scene::shell::{CellWrap, Orientations, Variant};
use crate::scene::{Alpha, LightKind, Model, Projection, Scene, Wrap};
use crate::volume::Style;
use crate::{Error, Result};

mod newer;

/// A file being put together: every array its own buffer view and accessor.
pub struct Builder {
    pub json: Value,
    bin: Vec<u8>,
}

/// Component type codes.
const I8: u32 = 5120;
pub const U8: u32 = 5121;
const I16: u32 = 5122;
pub const U16: u32 = 5123;
const U32: u32 = 5125;
const F32: u32 = 5126;

impl Builder {
    /// One scene with one node that shows the mesh 0.
    pub fn new() -> Self {
        let json = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {}}]}], "accessors": [], "bufferViews": [], "buffers": [{}],
        });
        Builder { json, bin: Vec::new() }
    }

    /// A triangle (0,0,0) (1,0,0) (0,1,0).
    pub fn triangle() -> Self {
        let mut b = Builder::new();
        let a = b.floats("VEC3", &[0., 0., 0., 1., 0., 0., 0., 1., 0.]);
        b.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = a.into();
        b
    }

    pub fn set(mut self, pointer: &str, value: Value) -> Self {
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        let parent = self.json.pointer_mut(parent).unwrap();
        match key.parse::<usize>() {
            Ok(i) if parent.is_array() && i == parent.as_array().unwrap().len() => {
                parent.as_array_mut().unwrap().push(value);
            }
            Ok(i) if parent.is_array() => parent[i] = value,
            _ => parent[key] = value,
        }
        self
    }

    pub fn attribute(self, name: &str, accessor: usize) -> Self {
        self.set(&format!("/meshes/0/primitives/0/attributes/{name}"), accessor.into())
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let views = self.json["bufferViews"].as_array_mut().unwrap();
        views.push(json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()}));
        let index = views.len() - 1;
        self.bin.extend(bytes);
        index
    }

    fn accessor(&mut self, accessor: Value) -> usize {
        let list = self.json["accessors"].as_array_mut().unwrap();
        list.push(accessor);
        list.len() - 1
    }

    pub fn array(&mut self, kind: &str, component: u32, bytes: &[u8], count: usize) -> usize {
        let view = self.view(bytes);
        self.accessor(json!({"bufferView": view, "componentType": component, "type": kind, "count": count}))
    }

    pub fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.array(kind, F32, &bytes, values.len() / width)
    }

    pub fn read_with(&self, options: &ReadOptions) -> Result<Scene> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.glb");
        std::fs::write(&path, self.glb()).unwrap();
        read(&path, options)
    }

    fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"][0]["byteLength"] = self.bin.len().into();
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let mut out = b"glTF\x02\0\0\0".to_vec();
        out.extend((28 + text.len() as u32 + bin.len() as u32).to_le_bytes());
        for (kind, data) in [(b"JSON", text), (b"BIN\0", bin)] {
            out.extend((data.len() as u32).to_le_bytes());
            out.extend(kind);
            out.extend(data);
        }
        out
    }

    pub fn scene(&self) -> Scene {
        self.read_with(&ReadOptions::default()).unwrap()
    }

    pub fn model(&self) -> Model {
        self.scene().model
    }

    pub fn error(&self) -> String {
        self.read_with(&ReadOptions::default()).unwrap_err().to_string()
    }
}

/// World positions of all instances, vertex by vertex.
pub fn world(model: &Model) -> Vec<DVec3> {
    let of = |i: &crate::scene::Instance| {
        let points = &model.parts[i.part].positions;
        points.iter().map(|p| i.transform.transform_point3(Vec3::from(*p).as_dvec3())).collect::<Vec<_>>()
    };
    model.instances.iter().flat_map(of).collect()
}

fn warned(model: &Model, text: &str) -> u64 {
    model.warnings.iter().filter(|(w, _)| w.contains(text)).map(|(_, n)| n).sum()
}

#[test]
fn integers_are_normalised_as_the_format_says() {
    let mut b = Builder::triangle();
    let bytes: Vec<u8> = [-128i8, -127, 0, 127, 64, 1, 0, 0, 0].map(|v| v as u8).to_vec();
    let position = b.array("VEC3", I8, &bytes, 3);
    b.json["accessors"][position]["normalized"] = true.into();
    let uv: Vec<u8> = [0u16, 65535, 32768, 1, 0, 0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let uv = b.array("VEC2", U16, &uv, 3);
    let plain = b.array("VEC2", I16, &[0xFF, 0xFF, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0], 3);
    b.json["accessors"][uv]["normalized"] = true.into();
    let m = b.attribute("POSITION", position).attribute("TEXCOORD_0", uv).attribute("TEXCOORD_1", plain).model();
    assert_eq!(m.parts[0].positions, [[-1.0, -1.0, 0.0], [1.0, 64.0 / 127.0, 1.0 / 127.0], [0.0; 3]]);
    assert_eq!(m.parts[0].uvs[0][..2], [[0.0, 1.0], [32768.0 / 65535.0, 1.0 / 65535.0]]);
    assert_eq!(m.parts[0].uvs[1][0], [-1.0, 2.0]);
}

#[test]
fn interleaved_and_sparse_values_land_where_they_belong() {
    let mut b = Builder::triangle();
    // Position and colour in one view of stride 16.
    let mut bytes = Vec::new();
    for i in 0..3u8 {
        bytes.extend([f32::from(i), f32::from(i * i), 0.0].iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend([255, 0, 51 * i, 255]);
    }
    let view = b.view(&bytes);
    b.json["bufferViews"][view]["byteStride"] = 16.into();
    let at = |offset: u32, component: u32, kind: &str| {
        json!({"bufferView": view, "byteOffset": offset, "componentType": component, "type": kind, "count": 3,
            "normalized": component == U8})
    };
    let position = b.accessor(at(0, F32, "VEC3"));
    let color = b.accessor(at(12, U8, "VEC4"));
    // Zeros but for vertex 2.
    let (indices, values) = (b.view(&[2]), b.view(&7f32.to_le_bytes()));
    let dw = b.accessor(json!({"componentType": F32, "type": "SCALAR", "count": 3, "sparse": {"count": 1,
        "indices": {"bufferView": indices, "componentType": U8}, "values": {"bufferView": values}}}));
    let b = b.attribute("POSITION", position).attribute("COLOR_0", color).attribute("_VTEX_DW", dw);
    let part = &b.model().parts[0];
    assert_eq!(part.positions, [[0.0; 3], [1.0, 1.0, 0.0], [2.0, 4.0, 0.0]]);
    assert_eq!(part.colors.as_ref().unwrap()[1], [1.0, 0.0, 0.2, 1.0]);
    assert_eq!(part.dw.as_ref().unwrap(), &[0.0, 0.0, 7.0]);

    let beyond = Builder { json: b.json.clone(), bin: b.bin.clone() }.set("/accessors/3/sparse/count", 2.into());
    assert!(beyond.error().contains("reach beyond a view"));
}

#[test]
fn accessors_are_checked_before_anything_is_taken() {
    for (pointer, value, what) in [
        ("/accessors/0/count", json!(4), "4 elements from byte 0 reach beyond a view of 36 bytes"),
        ("/accessors/0/count", json!(1u64 << 62), "reach beyond"),
        ("/accessors/0/byteOffset", json!(u64::MAX), "reach beyond"),
        ("/bufferViews/0/byteOffset", json!(8), "reach beyond buffers[0]"),
        ("/bufferViews/0/byteLength", json!(u64::MAX), "reach beyond buffers[0]"),
        ("/bufferViews/0/byteStride", json!(4), "do not fit a stride of 4"),
        ("/bufferViews/0/buffer", json!(9), "buffers[9]"),
        ("/accessors/0/type", json!("VEC2"), "has 2 numbers an element, not 3"),
        ("/accessors/0/componentType", json!(7), "unknown componentType"),
        ("/accessors/0/bufferView", json!(5), "bufferViews[5]"),
        ("/accessors/0", json!({"componentType": F32, "type": "VEC3", "count": 1u64 << 40}), "without a buffer view"),
        ("/meshes/0/primitives/0/material", json!(3), "materials[3]: does not exist"),
        ("/meshes/0/primitives/0/mode", json!(9), "unknown mode"),
        ("/nodes/0/mesh", json!(2), "meshes[2]: does not exist"),
        ("/nodes/0/skin", json!(0), "skins[0]: does not exist"),
        ("/scene", json!(4), "scenes[4] does not exist"),
        ("/asset/version", json!("1.0"), "glTF version 1.0"),
    ] {
        let error = Builder::triangle().set(pointer, value).error();
        assert!(error.contains(what), "{pointer}: {error}");
    }
    let b = Builder::triangle();
    let tight = ReadOptions { max_bytes: b.glb().len() as u64 + 20, ..ReadOptions::default() };
    assert!(matches!(b.read_with(&tight), Err(Error::Limit { .. })));
}

#[test]
fn nodes_compose_in_double_precision_and_keep_their_handedness() {
    let b = Builder::triangle().set(
        "/nodes",
        json!([
            {"translation": [1e6, 0.1, 0], "scale": [-2, 2, 2], "children": [1]},
            {"mesh": 0, "rotation": [0, 0, FRAC_1_SQRT_2, FRAC_1_SQRT_2]},
        ]),
    );
    let m = b.model();
    // A quarter turn takes x to y, y to −x; then x is mirrored and all doubled.
    let exact = [(0.0, 0.0), (0.0, 2.0), (2.0, 0.0)].map(|(x, y)| DVec3::new(1e6 + x, 0.1 + y, 0.0));
    for (p, e) in world(&m).iter().zip(exact) {
        // 1e6 in f64 has a spacing of 1.2e-10.
        assert!((*p - e).length() < 1e-9, "{p}");
    }
    assert!(m.instances[0].transform.matrix3.determinant() < 0.0);

    let matrix = json!([0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]);
    let m = Builder::triangle().set("/nodes/0/matrix", matrix).model();
    assert_eq!(world(&m)[1], DVec3::new(5.0, 7.0, 7.0));
    let m = Builder::triangle().set("/nodes/0/rotation", json!([0, 0, 0, 0])).model();
    assert_eq!((warned(&m, "rotation of length 0"), world(&m)[1]), (1, DVec3::X));
}

#[test]
fn graphs_that_are_no_trees_end() {
    let cycle = Builder::triangle().set("/nodes", json!([{"children": [1]}, {"mesh": 0, "children": [0]}]));
    assert!(cycle.error().contains("is its own ancestor"));
    let deep: Vec<Value> = (0..20_000).map(|i| json!({"children": [i + 1]})).chain([json!({"mesh": 0})]).collect();
    assert_eq!(Builder::triangle().set("/nodes", deep.into()).model().instances.len(), 1);
    // Each node twice below the one before: 2^60 ways.
    let wide: Vec<Value> = (0..60).map(|i| json!({"children": [i + 1, i + 1]})).chain([json!({})]).collect();
    assert!(Builder::triangle().set("/nodes", wide.into()).error().contains("too many ways"));
    let missing = Builder::triangle().set("/nodes/0/children", json!([7]));
    assert!(missing.error().contains("nodes[7]: does not exist"));
}

#[test]
fn scenes_and_nodes_are_chosen() {
    let b =
        Builder::triangle().set("/scenes", json!([{"name": "a", "nodes": [0]}, {"name": "1st", "nodes": [1, 2]}])).set(
            "/nodes",
            json!([{"mesh": 0, "name": "x"}, {"mesh": 0, "name": "trunk", "children": [3]},
            {"mesh": 0, "name": "pot"}, {"mesh": 0, "name": "leaf.001"}]),
        );
    let names = |options: &ReadOptions| {
        b.read_with(options).map(|s| s.model.instances.iter().map(|i| i.node.clone()).collect::<Vec<_>>().join(" "))
    };
    let scene = |s: &str| ReadOptions { scene: Some(s.into()), ..ReadOptions::default() };
    assert_eq!(names(&ReadOptions::default()).unwrap(), "x");
    assert_eq!(names(&scene("1st")).unwrap(), "trunk leaf.001 pot");
    assert_eq!(names(&scene("1")).unwrap(), "trunk leaf.001 pot");
    assert!(matches!(names(&scene("2")), Err(Error::Options(e)) if e.contains("a, 1st")));
    let only = |include: &[&str], exclude: &[&str]| ReadOptions {
        include: include.iter().map(|s| s.to_string()).collect(),
        exclude: exclude.iter().map(|s| s.to_string()).collect(),
        ..scene("1")
    };
    assert_eq!(names(&only(&["trunk"], &[])).unwrap(), "trunk leaf.001", "with all below");
    assert_eq!(names(&only(&[], &["leaf*"])).unwrap(), "trunk pot");
    assert_eq!(names(&only(&["leaf.001"], &[])).unwrap(), "leaf.001");
    assert!(matches!(names(&only(&["oak"], &[])), Err(Error::Options(_))));
    let none = Builder::triangle().set("/scenes", json!([])).set("/nodes", json!([{"children": [1]}, {"mesh": 0}]));
    let mut none = none;
    none.json.as_object_mut().unwrap().remove("scene");
    assert_eq!((none.model().instances.len(), warned(&none.model(), "no scene")), (1, 1));
}

#[test]
fn seven_modes() {
    let mut base = Builder::new();
    let points: Vec<f32> =
        [(0, 0), (1, 0), (0, 1), (1, 1), (2, 3), (4, 9)].iter().flat_map(|&(x, y)| [x as f32, y as f32, 0.0]).collect();
    let a = base.floats("VEC3", &points);
    let base = base.attribute("POSITION", a);
    for (mode, counts) in
        [(0, [0, 0, 6]), (1, [0, 3, 0]), (2, [0, 6, 0]), (3, [0, 5, 0]), (4, [2, 0, 0]), (5, [4, 0, 0]), (6, [4, 0, 0])]
    {
        for component in [None, Some(U8), Some(U16), Some(U32)] {
            let mut b = Builder { json: base.json.clone(), bin: base.bin.clone() };
            if let Some(component) = component {
                let size = match component {
                    U8 => 1,
                    U16 => 2,
                    _ => 4,
                };
                let bytes: Vec<u8> = (0..6u32).flat_map(|i| i.to_le_bytes().into_iter().take(size)).collect();
                let indices = b.array("SCALAR", component, &bytes, 6);
                b = b.set("/meshes/0/primitives/0/indices", indices.into());
            }
            let m = b.set("/meshes/0/primitives/0/mode", mode.into()).model();
            let p = &m.parts[0];
            assert_eq!([p.triangles.len(), p.lines.len(), p.points.len()], counts, "mode {mode}");
        }
    }
}

#[test]
fn morph_targets_move_by_their_weights() {
    let mut b = Builder::triangle();
    let delta = b.floats("VEC3", &[0., 0., 2., 0., 0., 4., 0., 0., 0.]);
    let height = b.floats("VEC3", &[0., 1., 0., 0., 1., 0., 0., 1., 0.]);
    let b = b
        .attribute("_VTEX_HEIGHT", height)
        .set("/meshes/0/primitives/0/targets", json!([{"POSITION": delta, "_VTEX_HEIGHT": delta}]))
        .set("/meshes/0/weights", json!([0.5]));
    let m = b.model();
    assert_eq!(m.parts[0].positions[1], [1.0, 0.0, 2.0]);
    assert_eq!(m.parts[0].heights.as_ref().unwrap()[0], [0.0, 1.0, 1.0]);
    // A node's own weights win, and give another part.
    let b = b.set("/nodes/1", json!({"mesh": 0, "weights": [1.0]})).set("/scenes/0/nodes", json!([0, 1]));
    let m = b.model();
    assert_eq!((m.parts.len(), m.parts[1].positions[1]), (2, [1.0, 0.0, 4.0]));
}

#[test]
fn skins_are_posed_where_their_joints_are() {
    let mut b = Builder::triangle();
    let joints = b.array("VEC4", U8, &[0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0], 3);
    let weights = b.floats("VEC4", &[0.5, 0.5, 0., 0., 2., 0., 0., 0., 0., 0., 0., 0.]);
    let mut bind: Vec<f32> = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.].repeat(2);
    bind[28] = -1.0;
    let bind = b.floats("MAT4", &bind);
    let b = b
        .attribute("JOINTS_0", joints)
        .attribute("WEIGHTS_0", weights)
        .set(
            "/nodes",
            json!([{"mesh": 0, "skin": 0, "translation": [50, 0, 0]},
            {"translation": [0, 10, 0]}, {"translation": [3, 0, 0], "scale": [2, 2, 2]}]),
        )
        .set("/skins", json!([{"joints": [1, 2], "inverseBindMatrices": bind}]));
    // Joint 0 lifts by 10; joint 1 takes x to 2 (x − 1) + 3. The node's own transform counts only without weights.
    let p = world(&b.model());
    assert_eq!(p[0], DVec3::new(0.5, 5.0, 0.0));
    assert_eq!(p[1], DVec3::new(3.0, 0.0, 0.0));
    assert_eq!(p[2], DVec3::new(50.0, 1.0, 0.0));
}

#[test]
fn instances_multiply() {
    let mut b = Builder::triangle();
    let at = b.floats("VEC3", &[0., 0., 5., 0., 0., 6.]);
    let turn = b.array("VEC4", I16, &[0, 0, 0, 0, 0xFF, 0x7F, 0, 0, 0, 0, 0, 0, 0, 0, 0xFF, 0x7F], 2);
    b.json["accessors"][turn]["normalized"] = true.into();
    let b = b.set("/nodes/0/scale", json!([10, 10, 10])).set(
        "/nodes/0/extensions",
        json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": at, "ROTATION": turn}}}),
    );
    let m = b.model();
    let p = world(&m);
    assert_eq!((m.parts.len(), m.instances.len()), (1, 2));
    // The first is half a turn about z.
    assert!((p[1] - DVec3::new(-10.0, 0.0, 50.0)).length() < 1e-12);
    assert_eq!(p[4], DVec3::new(10.0, 0.0, 60.0));
    let few = ReadOptions { max_instances: 1, ..ReadOptions::default() };
    assert!(matches!(b.read_with(&few), Err(Error::Limit { needed: 2, .. })));
    let uneven = b.set("/nodes/0/extensions/EXT_mesh_gpu_instancing/attributes/SCALE", 0.into());
    assert!(uneven.error().contains("different numbers"));
}

/// A PNG of two texels: opaque red, transparent white.
fn png() -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    let image = image::RgbaImage::from_raw(2, 1, vec![255, 0, 0, 255, 255, 255, 255, 0]).unwrap();
    image.write_to(&mut out, image::ImageFormat::Png).unwrap();
    out.into_inner()
}

#[test]
fn materials_and_their_textures() {
    let mut b = Builder::triangle();
    let uv = b.floats("VEC2", &[0.; 6]);
    let view = b.view(&png());
    let b = b
        .attribute("TEXCOORD_0", uv)
        .set("/images", json!([{"bufferView": view, "mimeType": "image/png"}]))
        .set("/samplers", json!([{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}]))
        .set("/textures", json!([{"source": 0, "sampler": 0}]))
        .set("/meshes/0/primitives/0/material", 0.into())
        .set("/materials", json!([{"alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": true,
            "extensions": {"KHR_materials_unlit": {}},
            "pbrMetallicRoughness": {"baseColorFactor": [0.5, 1, 0, 0.75], "baseColorTexture": {"index": 0, "texCoord": 5,
                "extensions": {"KHR_texture_transform": {"offset": [3, 4], "rotation": FRAC_PI_2, "scale": [2, 5], "texCoord": 1}}}}}]));
    let m = b.model();
    let material = &m.materials[0];
    assert_eq!((material.alpha, material.base_color), (Alpha::Mask(0.25), [0.5, 1.0, 0.0, 0.75]));
    assert!(material.double_sided && material.unlit);
    let t = material.texture.as_ref().unwrap();
    assert_eq!((t.tex_coord, t.texture.wrap, t.texture.nearest), (1, [Wrap::Clamp, Wrap::Mirror], true));
    assert_eq!(t.texture.texels, [[255, 0, 0, 255], [255, 255, 255, 0]]);
    // offset + R(90°) · (2u, 5v), where R takes (x, y) to (y, −x).
    let [u, v] = t.map([1.0, 10.0]);
    assert!((u - 53.0).abs() < 1e-5 && (v - 2.0).abs() < 1e-5, "{u} {v}");
    assert_eq!((m.parts[0].uvs.len(), warned(&m, "asks for are missing")), (2, 1));

    let opaque = b.set("/materials/0/alphaMode", "OPAQUE".into()).model();
    assert_eq!(opaque.materials[0].base_color[3], 1.0);
    assert_eq!(opaque.materials[0].texture.as_ref().unwrap().texture.texels[1], [255, 255, 255, 255]);
}

#[test]
fn textures_that_cannot_be_had_leave_the_factor() {
    for (image, texture) in [
        (json!({"uri": "gone.png"}), json!({"source": 0})),
        (json!({"uri": "data:image/png;base64,AAAA"}), json!({"source": 0})),
        (json!({"uri": "https://example.com/a.png"}), json!({"source": 0})),
        (json!({"bufferView": 99}), json!({"source": 0})),
        (json!({}), json!({"source": 0})),
        (json!({"uri": "a.ktx2"}), json!({"extensions": {"KHR_texture_basisu": {"source": 0}}})),
    ] {
        let b = Builder::triangle()
            .set("/images", json!([image]))
            .set("/textures", json!([texture]))
            .set("/meshes/0/primitives/0/material", 0.into())
            .set("/materials", json!([{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 1, 0, 1], "baseColorTexture": {"index": 0}}}]));
        let m = b.model();
        assert!(m.materials[0].texture.is_none());
        assert_eq!(warned(&m, "the factor colour is used"), 1);
    }
}

#[test]
fn cameras_and_lights_stand_in_the_world() {
    let b = Builder::triangle()
        .set("/nodes", json!([{"mesh": 0, "children": [1, 2], "translation": [0, 0, 9]}, {"name": "eye", "camera": 0},
            {"extensions": {"KHR_lights_punctual": {"light": 0}}}]))
        .set("/cameras", json!([{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}]))
        .set("/extensions", json!({"KHR_lights_punctual": {"lights": [
            {"type": "spot", "name": "lamp", "color": [1, 0.5, 0], "intensity": 4, "range": 8, "spot": {"outerConeAngle": 0.5}}]}}));
    let m = b.model();
    assert_eq!((m.cameras[0].name.as_str(), m.cameras[0].to_world.translation.z), ("eye", 9.0));
    assert_eq!(m.cameras[0].projection, Projection::Perspective { yfov: 0.5 });
    let l = &m.lights[0];
    assert_eq!((l.name.as_str(), l.intensity, l.range), ("lamp", [4.0, 2.0, 0.0], 8.0));
    assert_eq!(l.kind, LightKind::Spot { inner: 0.0, outer: 0.5 });
}

#[test]
fn what_is_required_and_not_read_is_refused_by_name() {
    for name in ["KHR_draco_mesh_compression", "KHR_texture_basisu", "ACME_brushes"] {
        let b = Builder::triangle().set("/extensionsRequired", json!(["KHR_mesh_quantization", name]));
        assert!(
            matches!(b.read_with(&ReadOptions::default()), Err(Error::Unsupported { what, .. }) if what.contains(name))
        );
    }
}

#[test]
fn buffers_come_from_files_with_any_name() {
    let dir = tempfile::tempdir().unwrap();
    let b = Builder::triangle();
    std::fs::create_dir(dir.path().join("sub")).unwrap();
    std::fs::write(dir.path().join("daten ä❤ 100%.bin"), &b.bin).unwrap();
    for uri in ["daten%20%C3%A4%E2%9D%A4%20100%25.bin", "daten ä❤ 100%.bin", "sub/../daten ä❤ 100%.bin"] {
        let json =
            Builder { json: b.json.clone(), bin: vec![] }.set("/buffers/0", json!({"byteLength": 36, "uri": uri})).json;
        let path = dir.path().join("t.gltf");
        std::fs::write(&path, format!("\u{feff}{json}")).unwrap();
        assert_eq!(read(&path, &ReadOptions::default()).unwrap().model.parts[0].triangles.len(), 1, "{uri}");
    }
    let path = Path::new("no/such.gltf");
    assert!(matches!(read(path, &ReadOptions::default()), Err(Error::Io { .. })));
}

/// A file whose material 0 carries a shell of texel 0.
pub fn shell() -> Builder {
    Builder::triangle()
        .set("/meshes/0/primitives/0/material", 0.into())
        .set(
            "/extensions",
            json!({super::extension::NAME: {"texels": [{"frames": [{"uri": "a%20tree.vtex"}]},
            {"name": "b", "frames": [{"uri": "sub/b.vtex"}], "geometry": {"uri": "b.glb"}, "maxDepth": 9}],
            "environment": {"sky": [1, 2, 3]}}}),
        )
        .set("/materials", json!([{"extensions": {super::extension::NAME: {"layers": [{"texel": 0}]}}}]))
}

const LAYER: &str = "/materials/0/extensions/VTEX_volumetric_texture/layers/0";

#[test]
fn shells_are_read_with_their_defaults() {
    let s = shell().scene();
    assert!(s.texels[0].frames[0].ends_with("a tree.vtex") && s.texels[0].name == "a tree");
    assert!(s.texels[1].frames[0].ends_with("sub/b.vtex") && s.texels[1].max_depth == Some(9));
    assert_eq!((s.environment.sky, s.environment.background), (Some([1.0, 2.0, 3.0].into()), None));
    let m = s.model.materials[0].shell.as_ref().unwrap();
    assert_eq!((m.tex_coord, m.w, m.dw, m.thickness, m.surface_visible), (0, 0.0, 1.0, 1.0, true));
    let l = &m.layers[0];
    assert_eq!(l.wrap, [CellWrap::Repeat, CellWrap::Repeat, CellWrap::Empty]);
    assert_eq!((l.scale, l.offset, l.opacity_scale, &l.phong), ([1.0; 3], [0.0; 3], 1.0, &Phong::default()));
    assert_eq!((l.skin_range, s.texels[0].content_id), ([0.0, 1.0], None));
    assert!(l.discrete.is_none());
    assert_eq!(s.model.parts[0].uvs.len(), 1, "the shell asks for texture coordinates");
}

#[test]
fn the_example_of_the_draft_is_read() {
    let example = json!({"layers": [{"texel": 0, "wrap": ["repeat", "mirror", "empty"], "skinRange": [0, 1], "combine": "union",
        "phong": {"diffuseFactor": [0.25, 0.5, 0.15], "specularFactor": [0.04, 0.04, 0.04], "shininess": 24},
        "palette": {"bark": {"diffuseFactor": [0.35, 0.25, 0.15]}},
        "jitter": {"continuous": {"noise": "perlin2002", "seed": 7},
            "discrete": {"seed": 11, "orientations": "w8", "scale": [0.7, 1.0], "displace": [0.1, 0.1, 0],
                "variants": [{"texel": 0, "weight": 3}, {"texel": 1}]}},
        "animation": {"mode": "loop", "framesPerSecond": 12}}], "thickness": 2.5});
    let s = shell().set("/materials/0/extensions/VTEX_volumetric_texture", example).scene();
    let m = s.model.materials[0].shell.as_ref().unwrap();
    let l = &m.layers[0];
    assert_eq!((m.thickness, l.wrap[1], l.phong.diffuse), (2.5, CellWrap::Mirror, [0.25, 0.5, 0.15]));
    let d = l.discrete.as_ref().unwrap();
    assert_eq!((d.seed, d.orientations, d.scale, d.presence), (11, Orientations::W8, [0.7, 1.0], 1.0));
    // The texels in the palette's colours follow those of the root.
    let variant = |texel, weight| Variant { weight, ..Variant::alone(texel) };
    assert_eq!(d.variants, [variant(2, 3.0), variant(3, 1.0)]);
    assert_eq!((l.texel, s.texels.len()), (2, 4));
    assert!(s.texels[2].frames == s.texels[0].frames && s.texels[3].frames == s.texels[1].frames);
    assert_eq!(s.texels[2].palette.style("bark"), Style { factor: [0.35, 0.25, 0.15], ..Style::UNCHANGED });
    assert_eq!(l.continuous.map(|c| (c.seed, c.octaves)), Some((7, 1)));
    assert_eq!((l.phong.finish.specular, l.phong.finish.shininess), (Some([0.04; 3]), Some(24.0)));
    assert_eq!(warned(&s.model, "is ignored"), 0);
}

#[test]
fn shells_out_of_range_are_refused_with_their_place() {
    for (key, value, what) in [
        ("texel", json!(2), "layers[0].texel: is not the index of one of the 2 texels"),
        ("texel", json!(-1), "layers[0].texel"),
        ("wrap", json!(["repeat", "repeat"]), "is not three times repeat, mirror, empty"),
        ("wrap", json!(["repeat", "repeat", "clamp"]), "layers[0].wrap"),
        ("scale", json!([1, 0, 1]), "must not be 0"),
        ("offset", json!([1, "x", 1]), "offset: is not a number"),
        ("opacityScale", json!(-1), "is not a number of at least 0"),
        ("skinRange", json!([0.5, 0.5]), "from less to more"),
        ("jitter", json!({"discrete": {"scale": [0, 1]}}), "jitter.discrete.scale: must be above 0"),
        ("jitter", json!({"discrete": {"presence": 1.5}}), "is not a number in [0, 1]"),
        ("jitter", json!({"discrete": {"seed": 1u64 << 32}}), "is not a whole number"),
        ("jitter", json!({"discrete": {"variants": [{"texel": 0, "weight": 0}]}}), "variants[0].weight"),
        ("jitter", json!([]), "jitter: is not an object"),
    ] {
        let error = shell().set(&format!("{LAYER}/{key}"), value).error();
        assert!(error.contains(what), "{key}: {error}");
    }
    let material = "/materials/0/extensions/VTEX_volumetric_texture";
    for (key, value) in
        [("thickness", json!(0)), ("layers", json!([])), ("surface", json!("maybe")), ("texCoord", json!(99))]
    {
        assert!(shell().set(&format!("{material}/{key}"), value).error().contains(key));
    }
    let frame = "/extensions/VTEX_volumetric_texture/texels/0/frames/0";
    for bad in ["0123", "0123456789ABCDEF0123456789ABCDEF", "+123456789abcdef0123456789abcdef"] {
        let error = shell().set(&format!("{frame}/contentId"), bad.into()).error();
        assert!(error.contains("contentId: is not 32 hexadecimal digits"), "{error}");
    }
    let named = shell().set(&format!("{frame}/contentId"), "000102030405060708090a0b0c0d0eff".into()).scene();
    assert_eq!(named.texels[0].content_id.map(|id| (id[1], id[15])), Some((1, 255)));
    let uri = &format!("{frame}/uri");
    for bad in [
        "",
        "/etc/x.vtex",
        "../x.vtex",
        "a/%2e%2e/x.vtex",
        "http://h/x.vtex",
        "file:x.vtex",
        "x.vtex?v=1",
        "C:/x.vtex",
        "..\\x.vtex",
    ] {
        assert!(shell().set(uri, bad.into()).error().contains("is not a relative path"), "{bad}");
    }
    let unknown = shell().set(&format!("{LAYER}/colour"), 1.into()).scene();
    assert_eq!(warned(&unknown.model, "colour is not a known property"), 1);
}
