//! Writes meshes as one `.glb`: f32 positions and normals, u8 colours, u32 indices, PNG images in the buffer.

use glam::{DVec2, DVec3};
use serde_json::{Value, json};

/// A triangle list; arrays are as long as `positions`, or empty for an attribute that the mesh does not have.
#[derive(Default)]
pub struct Mesh {
    pub positions: Vec<DVec3>,
    pub normals: Vec<DVec3>,
    pub uvs: Vec<DVec2>,
    /// Linear RGB in [0, 1].
    pub colors: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Add a vertex; its index.
    pub fn vertex(&mut self, position: DVec3, normal: DVec3, color: DVec3) -> u32 {
        self.positions.push(position);
        self.normals.push(normal.normalize());
        self.colors.push(color);
        self.positions.len() as u32 - 1
    }
}

/// A `.glb` in the making.
pub struct Glb {
    json: Value,
    bin: Vec<u8>,
}

impl Glb {
    pub fn new() -> Self {
        let asset = json!({"version": "2.0", "generator": "vtex make_samples", "copyright": "CC0-1.0"});
        let json = json!({"asset": asset, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "bufferViews": []});
        Glb { json, bin: Vec::new() }
    }

    /// Append `value` to the top-level array `list`; its index there.
    pub fn push(&mut self, list: &str, value: Value) -> usize {
        if self.json[list].is_null() {
            self.json[list] = json!([]);
        }
        let array = self.json[list].as_array_mut().expect("made as an array above");
        array.push(value);
        array.len() - 1
    }

    /// Set the top-level `key`.
    pub fn set(&mut self, key: &str, value: Value) {
        self.json[key] = value;
    }

    /// Add a node to the scene.
    pub fn node(&mut self, node: Value) {
        let index = self.push("nodes", node);
        self.json["scenes"][0]["nodes"].as_array_mut().expect("made as an array in new").push(json!(index));
    }

    /// Add a PNG and a texture of it; the texture's index.
    pub fn texture(&mut self, name: &str, png: &[u8], sampler: Value) -> usize {
        let view = self.view(png, None);
        let image = self.push("images", json!({"name": name, "mimeType": "image/png", "bufferView": view}));
        let sampler = self.push("samplers", sampler);
        self.push("textures", json!({"source": image, "sampler": sampler}))
    }

    /// Add the accessors of `mesh`; the glTF primitive.
    pub fn primitive(&mut self, mesh: &Mesh, material: usize) -> Value {
        let n = mesh.positions.len();
        let floats = |v: &[DVec3]| -> Vec<u8> {
            v.iter().flat_map(|p| p.to_array()).flat_map(|x| (x as f32).to_le_bytes()).collect()
        };
        let (min, max) = mesh
            .positions
            .iter()
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), &p| (min.min(p), max.max(p)));
        let bound = |p: DVec3| p.to_array().map(|x| x as f32);
        let view = self.view(&floats(&mesh.positions), Some(34962));
        let position = self.push(
            "accessors",
            json!({"bufferView": view, "componentType": 5126, "type": "VEC3", "count": n, "min": bound(min), "max": bound(max)}),
        );
        let mut attributes = json!({"POSITION": position});
        if !mesh.normals.is_empty() {
            let view = self.view(&floats(&mesh.normals), Some(34962));
            let accessor = json!({"bufferView": view, "componentType": 5126, "type": "VEC3", "count": n});
            attributes["NORMAL"] = json!(self.push("accessors", accessor));
        }
        if !mesh.uvs.is_empty() {
            let bytes: Vec<u8> =
                mesh.uvs.iter().flat_map(|p| p.to_array()).flat_map(|x| (x as f32).to_le_bytes()).collect();
            let view = self.view(&bytes, Some(34962));
            let accessor = json!({"bufferView": view, "componentType": 5126, "type": "VEC2", "count": n});
            attributes["TEXCOORD_0"] = json!(self.push("accessors", accessor));
        }
        if !mesh.colors.is_empty() {
            let byte = |x: f64| (x.clamp(0.0, 1.0) * 255.0).round() as u8;
            let bytes: Vec<u8> = mesh.colors.iter().flat_map(|c| [byte(c.x), byte(c.y), byte(c.z), 255]).collect();
            let view = self.view(&bytes, Some(34962));
            let accessor =
                json!({"bufferView": view, "componentType": 5121, "normalized": true, "type": "VEC4", "count": n});
            attributes["COLOR_0"] = json!(self.push("accessors", accessor));
        }
        let bytes: Vec<u8> = mesh.triangles.iter().flatten().flat_map(|i| i.to_le_bytes()).collect();
        let view = self.view(&bytes, Some(34963));
        let indices = self.push(
            "accessors",
            json!({"bufferView": view, "componentType": 5125, "type": "SCALAR", "count": 3 * mesh.triangles.len()}),
        );
        json!({"attributes": attributes, "indices": indices, "material": material})
    }

    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut view = json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()});
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bin.extend_from_slice(bytes);
        self.push("bufferViews", view)
    }

    /// The file's bytes.
    pub fn finish(mut self) -> Vec<u8> {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.json["buffers"] = json!([{"byteLength": self.bin.len()}]);
        let mut text = self.json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + text.len() + 8 + self.bin.len();
        let mut out = Vec::with_capacity(total);
        out.extend_from_slice(b"glTF");
        for word in [2, total as u32, text.len() as u32, 0x4E4F_534A] {
            out.extend_from_slice(&word.to_le_bytes());
        }
        out.extend_from_slice(&text);
        for word in [self.bin.len() as u32, 0x004E_4942] {
            out.extend_from_slice(&word.to_le_bytes());
        }
        out.extend_from_slice(&self.bin);
        out
    }
}

/// `image` as a PNG.
pub fn png(image: &image::DynamicImage) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).expect("writing to memory");
    bytes.into_inner()
}
