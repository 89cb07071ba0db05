//! Surfaces that give off light: their radiance in pictures and references, and what a bake says of them.

use std::path::Path;

use assert_cmd::Command;
use base64::Engine as _;
use serde_json::json;
use vtex::render::image_io::read;

/// A square that faces the camera and fills its picture, in two halves by its texture: emission (.2, .3, .4) times `strength`,
/// where the texture is white, and none where it is black.
fn square(path: &Path, strength: f64, unlit: bool) {
    let encoded = |kind: &str, bytes: &[u8]| {
        format!("data:{kind};base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
    };
    let corners: [f32; 20] = [-1., -1., 0., 1., -1., 0., 1., 1., 0., -1., 1., 0., 0., 1., 1., 1., 1., 0., 0., 0.];
    let indices: [u16; 6] = [0, 1, 2, 0, 2, 3];
    let mut bytes: Vec<u8> = corners.iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend(indices.iter().flat_map(|v| v.to_le_bytes()));
    let mut png = std::io::Cursor::new(Vec::new());
    let white = |x: u32, _| image::Rgb(if x < 4 { [255u8; 3] } else { [0; 3] });
    image::RgbImage::from_fn(8, 8, white).write_to(&mut png, image::ImageFormat::Png).unwrap();
    let mut extensions = json!({ "KHR_materials_emissive_strength": { "emissiveStrength": strength } });
    if unlit {
        extensions["KHR_materials_unlit"] = json!({});
    }
    let document = json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_materials_emissive_strength", "KHR_materials_unlit", "KHR_lights_punctual"],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "directional", "intensity": 0.0 }] } },
        "scene": 0, "scenes": [{ "nodes": [0, 1, 2] }],
        "nodes": [{ "mesh": 0 }, { "camera": 0, "translation": [0, 0, 2] },
            { "extensions": { "KHR_lights_punctual": { "light": 0 } } }],
        "cameras": [{ "type": "orthographic", "orthographic": { "xmag": 0.9, "ymag": 0.9, "znear": 0.1, "zfar": 10 } }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": 0 }] }],
        "materials": [{
            "name": "lamp", "extensions": extensions, "emissiveFactor": [0.2, 0.3, 0.4], "emissiveTexture": { "index": 0 },
            "pbrMetallicRoughness": { "baseColorFactor": [0, 0, 0, 1] },
        }],
        "textures": [{ "source": 0, "sampler": 0 }], "samplers": [{ "magFilter": 9728 }],
        "images": [{ "uri": encoded("image/png", &png.into_inner()) }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-1, -1, 0], "max": [1, 1, 0] },
            { "bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2" },
            { "bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 48 }, { "buffer": 0, "byteOffset": 48, "byteLength": 32 },
            { "buffer": 0, "byteOffset": 80, "byteLength": 12 },
        ],
        "buffers": [{ "byteLength": bytes.len(), "uri": encoded("application/octet-stream", &bytes) }],
    });
    std::fs::write(path, document.to_string()).unwrap();
}

fn vtex(folder: &Path, words: &str) -> String {
    let done = Command::cargo_bin("vtex").unwrap().args(words.split(' ')).current_dir(folder).output().unwrap();
    let said = String::from_utf8(done.stderr).unwrap();
    assert_eq!(done.status.code(), Some(0), "{words}: {said}");
    said
}

#[test]
fn what_gives_off_light_shows_its_radiance() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let render = "render a.gltf -o a.exr --size 8x8 --sky 0,0,0 --background 0,0,0";
    for (strength, unlit) in [(1.0, false), (5.0, false), (5.0, true)] {
        square(&folder.join("a.gltf"), strength, unlit);
        for more in ["", " --reference 2"] {
            let said = vtex(folder, &format!("{render}{more}"));
            assert!(!said.contains("warning"), "{said}");
            let picture = read(&folder.join("a.exr")).unwrap();
            // Unlit, it shows its base colour alone, which is black.
            let bright = if unlit { 0.0 } else { strength };
            // Pixels 1 and 6 of a row of 8 lie whole in their halves.
            for (x, factor) in [(1, bright), (6, 0.0)] {
                let pixel = picture.rgba[4 * 8 + x];
                let want = [0.2, 0.3, 0.4].map(|v| v * factor);
                let close = pixel.iter().zip(want).all(|(got, want)| (f64::from(*got) - want).abs() < 1e-5);
                assert!(close, "{strength} {unlit}{more}, pixel {x}: {pixel:?}, want {want:?}");
            }
        }
    }
}

#[test]
fn a_texel_has_no_place_for_emission_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    square(&folder.path().join("a.gltf"), 5.0, false);
    let said = vtex(folder.path(), "bake a.gltf -r 8 -o a.vtex");
    assert!(said.contains("lamp only emits light"), "{said}");
}
