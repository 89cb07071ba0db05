//! Conversion of an OBJ mesh to a .glb that is then mapped; its faces of four corners become bilinear patches.

use std::io::Cursor;
use std::path::Path;

use serde_json::{Map, Value, json};

use super::super::extension;
use super::temp_glb;
use super::temp_glb::TempGlb;
use crate::scene::model::{Alpha, Material, Model, Part};
use crate::scene::texture::{Texture, Wrap};
use crate::scene::{ReadOptions, obj};
use crate::{Error, Result, Warnings};

/// The contents of the .glb while they are written.
#[derive(Default)]
struct Writer {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    images: Vec<Value>,
    samplers: Vec<Value>,
    textures: Vec<Value>,
}

/// Make the .glb of an OBJ file; `patches`: with its quads as bilinear patches.
///
/// # Errors
/// As [`obj::read`].
pub fn make(path: &Path, patches: bool) -> Result<(TempGlb, Warnings)> {
    let mut model = obj::read(path, &ReadOptions { patches, ..ReadOptions::default() })?;
    let warnings = std::mem::take(&mut model.warnings);
    let mut writer = Writer::default();
    let materials = model.materials.iter().map(|m| writer.material(path, m)).collect::<Result<Vec<_>>>()?;
    let meshes = model.parts.iter().map(|part| writer.mesh(part, &model)).collect::<Vec<_>>();
    let node = |instance: &crate::scene::Instance| json!({"mesh": instance.part, "name": instance.node, "translation": instance.transform.translation.to_array()});
    let nodes: Vec<Value> = model.instances.iter().map(node).collect();
    let mut json = json!({
        "asset": {"version": "2.0", "generator": "vtex"},
        "scene": 0, "scenes": [{"nodes": (0..nodes.len()).collect::<Vec<_>>()}], "nodes": nodes,
        "materials": materials, "meshes": meshes,
        "buffers": [{"byteLength": writer.bin.len()}], "bufferViews": writer.views, "accessors": writer.accessors,
    });
    if model.parts.iter().any(|part| !part.patches.is_empty()) {
        json["extensionsUsed"] = json!([extension::NAME]);
    }
    for (key, list) in [("images", writer.images), ("samplers", writer.samplers), ("textures", writer.textures)] {
        if !list.is_empty() {
            json[key] = json!(list);
        }
    }
    Ok((temp_glb::save(path, &json, &writer.bin)?, warnings))
}

impl Writer {
    fn view(&mut self, bytes: impl IntoIterator<Item = u8>, target: Option<u32>) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let start = self.bin.len();
        self.bin.extend(bytes);
        let mut view = json!({"buffer": 0, "byteOffset": start, "byteLength": self.bin.len() - start});
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.views.push(view);
        self.views.len() - 1
    }

    fn accessor(&mut self, accessor: Value) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let view = self.view(values.iter().flatten().flat_map(|v| v.to_le_bytes()), Some(34962));
        let bound = |pick: fn(f32, f32) -> f32, start: f32| {
            values.iter().fold([start; N], |b, v| std::array::from_fn(|k| pick(b[k], v[k]))).to_vec()
        };
        let (min, max) = (bound(f32::min, f32::INFINITY), bound(f32::max, f32::NEG_INFINITY));
        self.accessor(json!({"bufferView": view, "componentType": 5126, "count": values.len(), "min": min, "max": max,
            "type": format!("VEC{N}")}))
    }

    fn indices<const N: usize>(&mut self, values: &[[u32; N]]) -> usize {
        let view = self.view(values.iter().flatten().flat_map(|v| v.to_le_bytes()), Some(34963));
        self.accessor(json!({"bufferView": view, "componentType": 5125, "count": N * values.len(), "type": "SCALAR"}))
    }

    /// A mesh with one primitive each for the part's triangles, lines and points.
    fn mesh(&mut self, part: &Part, model: &Model) -> Value {
        let mut attributes = Map::new();
        attributes.insert("POSITION".into(), self.floats(&part.positions).into());
        if let Some(normals) = &part.normals {
            attributes.insert("NORMAL".into(), self.floats(normals).into());
        }
        // The texture transform of the material is applied to the coordinates.
        let moved = model.materials.get(part.material).and_then(|m| m.texture.as_ref());
        for uvs in &part.uvs {
            let uvs: Vec<[f32; 2]> = uvs.iter().map(|uv| moved.map_or(*uv, |t| t.map(*uv))).collect();
            attributes.insert("TEXCOORD_0".into(), self.floats(&uvs).into());
        }
        if let Some(colors) = &part.colors {
            attributes.insert("COLOR_0".into(), self.floats(colors).into());
        }
        let mut primitives = Vec::new();
        let mut add = |mode: u32, indices: usize, patches: Option<usize>| {
            let mut own =
                json!({"attributes": attributes, "mode": mode, "indices": indices, "material": part.material});
            if let Some(patches) = patches {
                own["extensions"] = json!({extension::NAME: {"patches": patches}});
            }
            primitives.push(own);
        };
        if !part.triangles.is_empty() {
            let patches = (!part.patches.is_empty()).then(|| self.indices(&part.patches));
            add(4, self.indices(&part.triangles), patches);
        }
        if !part.lines.is_empty() {
            add(1, self.indices(&part.lines), None);
        }
        if !part.points.is_empty() {
            let points: Vec<[u32; 1]> = part.points.iter().map(|&p| [p]).collect();
            add(0, self.indices(&points), None);
        }
        json!({"name": part.name, "primitives": primitives})
    }

    fn material(&mut self, path: &Path, material: &Material) -> Result<Value> {
        let mut pbr = json!({"baseColorFactor": material.base_color, "metallicFactor": 0.0, "roughnessFactor": 1.0});
        if let Some(texture) = &material.texture {
            pbr["baseColorTexture"] = json!({"index": self.texture(path, &texture.texture)?});
        }
        let name = if material.name.is_empty() { "ground" } else { &material.name };
        let mut own = json!({
            "name": name, "doubleSided": material.double_sided, "pbrMetallicRoughness": pbr,
        });
        match material.alpha {
            Alpha::Opaque => {}
            Alpha::Mask(cutoff) => (own["alphaMode"], own["alphaCutoff"]) = ("MASK".into(), json!(cutoff)),
            Alpha::Blend => own["alphaMode"] = "BLEND".into(),
        }
        Ok(own)
    }

    /// Store a texture as a PNG in the file. Returns its index among the textures.
    fn texture(&mut self, path: &Path, texture: &Texture) -> Result<usize> {
        let texels = texture.texels.iter().flatten().copied().collect();
        let image = image::RgbaImage::from_raw(texture.width, texture.height, texels);
        let image = image.ok_or_else(|| Error::input(path, &*texture.name, "is not as large as it says"))?;
        let mut png = Cursor::new(Vec::new());
        let failed = |e: image::ImageError| Error::input(path, &*texture.name, e.to_string());
        image.write_to(&mut png, image::ImageFormat::Png).map_err(failed)?;
        let view = self.view(png.into_inner(), None);
        self.images.push(json!({"bufferView": view, "mimeType": "image/png", "name": texture.name}));
        let wrap = |wrap: Wrap| match wrap {
            Wrap::Repeat => 10497,
            Wrap::Mirror => 33648,
            Wrap::Clamp => 33071,
        };
        self.samplers.push(json!({"wrapS": wrap(texture.wrap[0]), "wrapT": wrap(texture.wrap[1])}));
        let last = |list: &[Value]| list.len() - 1;
        self.textures.push(json!({"source": last(&self.images), "sampler": last(&self.samplers)}));
        Ok(last(&self.textures))
    }
}
