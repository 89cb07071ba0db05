//! Plain .glb files that a bench makes for itself: objects, and grounds to cover.

use std::path::Path;

use serde_json::json;

use crate::cli::shapes::Shape;
use crate::geom::DVec3;
use crate::{Result, format};

/// A mesh to be written.
#[derive(Default)]
struct Plain {
    positions: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    indices: Vec<u32>,
}

/// A height field of `side`^2 squares over `size` metres, texture coordinates over the unit square; with a sun.
pub fn ground(path: &Path, side: u32, size: f64, height: fn(f64, f64) -> f64) -> Result<()> {
    let n = side + 1;
    let at = |k: u32| size * (f64::from(k) / f64::from(side) - 0.5);
    let mut mesh = Plain::default();
    for j in 0..n {
        for i in 0..n {
            mesh.positions.push([at(i) as f32, height(at(i), at(j)) as f32, at(j) as f32]);
            mesh.uvs.push([i as f32 / side as f32, j as f32 / side as f32]);
            if i < side && j < side {
                let a = j * n + i;
                mesh.indices.extend([a, a + n, a + n + 1, a, a + n + 1, a + 1]);
            }
        }
    }
    mesh.write(path, [0.1, 0.1, 0.05])
}

/// A shape, in its own unit cube.
pub fn object(path: &Path, shape: &Shape) -> Result<()> {
    let mut mesh = Plain::default();
    for (i, corner) in shape.triangles.iter().flatten().enumerate() {
        mesh.positions.push(corner.as_vec3().to_array());
        mesh.indices.push(i as u32);
    }
    mesh.write(path, [0.7, 0.7, 0.7])
}

impl Plain {
    fn write(&self, path: &Path, colour: [f64; 3]) -> Result<()> {
        let corners = || self.positions.iter().map(|p| DVec3::from_array(p.map(f64::from)));
        let (low, high) =
            (corners().fold(DVec3::INFINITY, DVec3::min), corners().fold(DVec3::NEG_INFINITY, DVec3::max));
        let sections: [Vec<u8>; 3] = [
            self.positions.iter().flatten().flat_map(|v| v.to_le_bytes()).collect(),
            self.uvs.iter().flatten().flat_map(|v| v.to_le_bytes()).collect(),
            self.indices.iter().flat_map(|v| v.to_le_bytes()).collect(),
        ];
        let mut offset = 0;
        let mut views = Vec::new();
        let mut accessors = Vec::new();
        let mut attributes = json!({});
        for (section, (name, kind, of, count)) in sections.iter().zip([
            ("POSITION", "VEC3", 5126, self.positions.len()),
            ("TEXCOORD_0", "VEC2", 5126, self.uvs.len()),
            ("indices", "SCALAR", 5125, self.indices.len()),
        ]) {
            if section.is_empty() {
                continue;
            }
            let mut accessor = json!({"bufferView": views.len(), "componentType": of, "count": count, "type": kind});
            if name == "POSITION" {
                (accessor["min"], accessor["max"]) = (json!(low.to_array()), json!(high.to_array()));
            }
            if name != "indices" {
                attributes[name] = views.len().into();
            }
            views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": section.len()}));
            offset += section.len();
            accessors.push(accessor);
        }
        let [r, g, b] = colour;
        let primitive = json!({"attributes": attributes, "indices": views.len() - 1, "material": 0});
        let sun = json!({"rotation": [-0.4, 0.25, 0.1, 0.876], "extensions": {"KHR_lights_punctual": {"light": 0}}});
        let file = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
            "nodes": [{"mesh": 0}, sun],
            "extensionsUsed": ["KHR_lights_punctual"],
            "extensions": {"KHR_lights_punctual": {"lights": [{"type": "directional", "intensity": 3.0}]}},
            "materials": [{
                "name": "plain", "doubleSided": true,
                "pbrMetallicRoughness": {"baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0},
            }],
            "meshes": [{"primitives": [primitive]}],
            "buffers": [{"byteLength": offset}],
            "bufferViews": views,
            "accessors": accessors,
        });
        let mut text = file.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        // All sections are of whole words.
        let chunks = [(b"JSON", text), (b"BIN\0", sections.concat())];
        let length = 12 + chunks.iter().map(|c| 8 + c.1.len()).sum::<usize>();
        let mut bytes = b"glTF".to_vec();
        bytes.extend([2u32, length as u32].map(u32::to_le_bytes).concat());
        for (kind, chunk) in &chunks {
            bytes.extend((chunk.len() as u32).to_le_bytes());
            bytes.extend(*kind);
            bytes.extend(chunk);
        }
        format::save(path, &bytes)
    }
}
