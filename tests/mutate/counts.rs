//! Small files whose counts multiply: meshes that are placed often, materials that share a picture, targets of zeros. Each is
//! refused before what it asks for is taken.

use std::fmt::Write as _;
use std::path::Path;

use serde_json::json;

use crate::memory;
use crate::run::{Command, MAX_MEMORY, run};

/// A glTF of a grid of 32 × 32 squares that one node places `copies` times, with `materials` masked materials of one picture.
fn instanced(folder: &Path, copies: usize, materials: usize) -> std::path::PathBuf {
    let side = 33u16;
    let mut bin: Vec<u8> = Vec::new();
    let mut views = Vec::new();
    let mut add = |bytes: Vec<u8>| {
        views.push(json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len() }));
        bin.extend(bytes);
    };
    let floats = |v: Vec<f32>| v.into_iter().flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
    let at = |i: u16| f32::from(i) / f32::from(side - 1);
    add(floats((0..side).flat_map(|y| (0..side).flat_map(move |x| [at(x), 0.0, at(y)])).collect()));
    add(floats((0..side).flat_map(|y| (0..side).flat_map(move |x| [at(x), at(y)])).collect()));
    let corner = |x: u16, y: u16| y * side + x;
    let square = |x, y| {
        [corner(x, y), corner(x, y + 1), corner(x + 1, y), corner(x + 1, y), corner(x, y + 1), corner(x + 1, y + 1)]
    };
    let indices: Vec<u16> = (0..side - 1).flat_map(|y| (0..side - 1).flat_map(move |x| square(x, y))).collect();
    add(indices.iter().flat_map(|i| i.to_le_bytes()).collect());
    add(floats((0..copies).flat_map(|i| [i as f32 * 1e-3, 0.0, 0.0]).collect()));
    let picture =
        image::RgbaImage::from_fn(1024, 1024, |x, _| image::Rgba([90, 90, 90, if x < 512 { 255 } else { 0 }]));
    let mut png = std::io::Cursor::new(Vec::new());
    image::DynamicImage::from(picture).write_to(&mut png, image::ImageFormat::Png).unwrap();
    add(png.into_inner());
    let n = usize::from(side) * usize::from(side);
    let part = |m: usize| json!({ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": m });
    let material = |_| json!({ "alphaMode": "MASK", "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } });
    let document = json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["EXT_mesh_gpu_instancing"],
        "scene": 0, "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "extensions": { "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 3 } } } }],
        "meshes": [{ "primitives": (0..materials).map(part).collect::<Vec<_>>() }],
        "materials": (0..materials).map(material).collect::<Vec<_>>(),
        "textures": [{ "source": 0 }],
        "images": [{ "bufferView": 4, "mimeType": "image/png" }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": n, "type": "VEC3", "min": [0, 0, 0], "max": [1, 0, 1] },
            { "bufferView": 1, "componentType": 5126, "count": n, "type": "VEC2" },
            { "bufferView": 2, "componentType": 5123, "count": indices.len(), "type": "SCALAR" },
            { "bufferView": 3, "componentType": 5126, "count": copies, "type": "VEC3" },
        ],
        "bufferViews": views,
        "buffers": [{ "byteLength": bin.len(), "uri": "a.bin" }],
    });
    std::fs::write(folder.join("a.bin"), &bin).unwrap();
    let path = folder.join("a.gltf");
    std::fs::write(&path, document.to_string()).unwrap();
    path
}

/// The command fails for want of memory, and takes no more than it may.
fn refused(command: Command, input: &Path, said: &str) {
    let (result, peak) = memory::peak(|| vtex::par::with_threads(1, || run(command, input, 1)).unwrap());
    let text = result.unwrap_err().to_string();
    let mut line = String::new();
    let _ = write!(line, "{command:?}: {text}; {} MiB", peak >> 20);
    assert!(text.contains(said) && text.contains("the limit is"), "{line}");
    assert!(peak as u64 <= MAX_MEMORY, "{line}");
}

#[test]
fn counts_that_multiply_are_refused_before_memory_is_taken() {
    let _alone = memory::alone();
    let folder = tempfile::tempdir().unwrap();
    // 2000 copies of 2048 triangles: 4 million facets, of 48 bytes each while they are sorted, and of 360 in a picture.
    let often = instanced(folder.path(), 2000, 1);
    refused(Command::Bake, &often, "sort the facets");
    refused(Command::Render, &often, "placed as often");
    // Tables of 64 masks of 1024 × 1024 texels, 4 MiB each.
    let masks = instanced(folder.path(), 1, 64);
    refused(Command::Bake, &masks, "materials[");
    // Eight copies of one mesh, and one mask, are within what is allowed.
    let few = instanced(folder.path(), 8, 1);
    vtex::par::with_threads(1, || run(Command::Bake, &few, 1)).unwrap().unwrap();
}
