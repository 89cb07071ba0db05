//! JSON by its published schema: recipes, and the objects of a landscape's extension. What keeps the schema gets past the reader's
//! first checks; some of it breaks it in one place.

use std::path::Path;
use std::sync::OnceLock;

use arbitrary::{Result, Unstructured};
use serde_json::{Map, Value, json};
use vtex::scene::{ReadOptions, gltf};
use vtex::source;

use super::{number, one_in};
use crate::targets::{MEMORY, baked, seen};
use crate::{run, small};

/// Names and other texts that mean something somewhere.
const TEXTS: [&str; 14] = [
    "leaf.vtex",
    "quad.obj",
    "leaf",
    "stem",
    "stick",
    "#80ff00",
    "#ffffff",
    "grass.png",
    "",
    "a",
    "made.toml",
    "../a",
    "é",
    "0",
];
/// Objects within one another.
const MAX_DEPTH: usize = 7;

/// A schema, and keys of which an object has exactly one.
struct Schema {
    root: Value,
    one_of: Vec<String>,
}

impl Schema {
    fn new(text: &str, one_of: &[&str]) -> Schema {
        Schema { root: serde_json::from_str(text).unwrap(), one_of: one_of.iter().map(|&key| key.to_owned()).collect() }
    }

    fn definition(&self, name: &str) -> &Value {
        &self.root["$defs"][name]
    }

    fn value(&self, u: &mut Unstructured, schema: &Value, depth: usize) -> Result<Value> {
        if one_in(u, 256)? {
            return Ok(u.choose(&[json!(null), json!([]), json!({}), json!("x"), json!(-1), json!(true)])?.clone());
        }
        if let Some(name) = schema["$ref"].as_str() {
            return self.value(u, self.root.pointer(&name[1..]).unwrap(), depth);
        }
        if let Some(list) = schema["enum"].as_array() {
            return Ok(u.choose(list)?.clone());
        }
        if let Some(value) = schema.get("const") {
            return Ok(value.clone());
        }
        if schema.get("if").is_some() {
            let branch = if u.arbitrary()? { "then" } else { "else" };
            return self.value(u, &schema[branch], depth);
        }
        let chosen = ["anyOf", "oneOf"].iter().find_map(|key| schema[key].as_array());
        let chosen = match chosen {
            // What is null is mostly left out.
            Some(list) if list.iter().any(|s| s["type"] == "null") && depth < MAX_DEPTH && !one_in(u, 32)? => {
                list.iter().find(|s| s["type"] != "null")
            }
            Some(list) => Some(u.choose(list)?),
            None => None,
        };
        let is_object = schema.get("properties").is_some() || schema["type"] == "object";
        if let Some(branch) = chosen.filter(|_| !is_object) {
            return self.value(u, branch, depth);
        }
        let kind = match &schema["type"] {
            Value::Array(kinds) => kinds[0].as_str().unwrap_or_default().to_owned(),
            kind => kind.as_str().unwrap_or(if is_object { "object" } else { "" }).to_owned(),
        };
        let bound = |key: &str, otherwise: f64| schema[key].as_f64().unwrap_or(otherwise);
        Ok(match &*kind {
            "object" => self.object(u, schema, chosen, depth)?,
            "array" => {
                let least = bound("minItems", 0.0) as usize;
                let most = (bound("maxItems", 3.0) as usize).min(least + 3);
                let count = if depth > MAX_DEPTH { least } else { u.int_in_range(least..=most)? };
                (0..count).map(|_| self.value(u, &schema["items"], depth + 1)).collect::<Result<_>>()?
            }
            "boolean" => u.arbitrary::<bool>()?.into(),
            "string" => (*u.choose(&TEXTS)?).into(),
            "integer" => {
                let (least, most) = (bound("minimum", -2.0), bound("maximum", 9.0));
                match one_in(u, 32)? {
                    true => (number(u)? as i64).into(),
                    false => u.int_in_range(least as i64..=most.min(least + 9.0).max(least) as i64)?.into(),
                }
            }
            "number" => {
                let free = number(u)?;
                let least = bound("minimum", bound("exclusiveMinimum", f64::MIN));
                let most = bound("maximum", f64::MAX);
                let near = if free < least || free > most {
                    least.max(-1.0) + (most.min(1e3) - least.max(-1.0)) * 0.4
                } else {
                    free
                };
                json!(if one_in(u, 64)? { free } else { near })
            }
            "null" => Value::Null,
            _ => json!(number(u)?),
        })
    }

    fn object(&self, u: &mut Unstructured, schema: &Value, branch: Option<&Value>, depth: usize) -> Result<Value> {
        let mut out = Map::new();
        let empty = Map::new();
        let keys = |s: &Value| {
            s["required"].as_array().into_iter().flatten().filter_map(Value::as_str).map(str::to_owned).collect()
        };
        let mut required: Vec<String> = keys(schema);
        required.extend(branch.map(keys).unwrap_or_default());
        let own = schema["properties"].as_object().unwrap_or(&empty);
        let more = branch.and_then(|b| b["properties"].as_object()).unwrap_or(&empty);
        let shapes: Vec<&String> = self.one_of.iter().filter(|key| own.contains_key(*key)).collect();
        let shape = match shapes.is_empty() {
            true => None,
            // At the end of the bytes, or of what may lie within one another, the first is taken: one that holds no other.
            false if depth > MAX_DEPTH => Some(shapes[0]),
            false => Some(*u.choose(&shapes)?),
        };
        for (key, inner) in own.iter().chain(more) {
            let is_shape = shapes.contains(&key);
            let wanted = required.contains(key) || shape == Some(key);
            if wanted && !one_in(u, 128)? || !is_shape && depth <= MAX_DEPTH && one_in(u, 4)? {
                out.insert(key.clone(), self.value(u, inner, depth + 1)?);
            }
        }
        if let Some(free) = schema.get("additionalProperties").filter(|s| s.is_object()) {
            for _ in 0..u.int_in_range(0..=2u8)? {
                out.insert((*u.choose(&TEXTS)?).into(), self.value(u, free, depth + 1)?);
            }
        }
        Ok(out.into())
    }
}

const NODES: [&str; 20] = [
    "sphere",
    "line",
    "plane",
    "half_space",
    "ellipsoid",
    "box",
    "cylinder",
    "cone",
    "torus",
    "blade",
    "emitter",
    "triangle",
    "implicit",
    "hypertexture",
    "source",
    "use",
    "group",
    "union",
    "intersection",
    "difference",
];

/// A recipe; one in eight is baked.
pub fn recipe(u: &mut Unstructured, folder: &Path) -> Result<vtex::Result<()>> {
    static SCHEMA: OnceLock<Schema> = OnceLock::new();
    let schema = SCHEMA.get_or_init(|| Schema::new(source::recipe::SCHEMA, &NODES));
    let text = schema.value(u, &schema.root, 0)?.to_string();
    let path = folder.join("made.json");
    std::fs::write(&path, &text).unwrap();
    let mut options = run::open_options();
    options.read.max_bytes = MEMORY;
    options.lsystem.max_symbols = 2000;
    let hash = if one_in(u, 8)? { 0 } else { 1 };
    Ok(source::recipe::open(&path, &options, source::open).and_then(|source| baked(&*source, hash)))
}

const X: &str = "VTEX_volumetric_texture";

/// The square of ground in an arbitrary landscape's material, and in another, with copies; one in sixteen becomes a picture.
pub fn landscape(u: &mut Unstructured, folder: &Path) -> Result<vtex::Result<()>> {
    static SCHEMA: OnceLock<Schema> = OnceLock::new();
    let schema = SCHEMA.get_or_init(|| Schema::new(include_str!("../../../format-spec/landscape-1.schema.json"), &[]));
    let [ground, _] = small::grounds();
    let mut file: Value = serde_json::from_slice(&ground).unwrap();
    file["extensionsUsed"] = json!([X, "FB_ngon_encoding", "KHR_lights_punctual", "EXT_mesh_gpu_instancing"]);
    // What is not replaced stays as it is in a ground that is read, so that one part by itself can be right.
    if u.arbitrary()? {
        file["extensions"][X] = schema.value(u, schema.definition("root"), 0)?;
        if file["extensions"][X].is_object() && !one_in(u, 8)? {
            // Texels that are there; any others are no landscape.
            let frames = json!([{ "uri": "leaf.vtex" }, { "uri": "leaf.vtex" }]);
            let count = u.int_in_range(1..=2usize)?;
            file["extensions"][X]["texels"] =
                json!([{ "frames": &frames.as_array().unwrap()[..count] }, { "frames": [{ "uri": "leaf.vtex" }] }]);
        }
    }
    if u.arbitrary()? {
        file["materials"][0]["extensions"][X] = schema.value(u, schema.definition("material"), 0)?;
    }
    if u.arbitrary()? {
        let copies = schema.value(u, &schema.definition("material")["then"], 0)?;
        file["materials"].as_array_mut().unwrap().push(json!({ "extensions": { X: copies } }));
        let mut part = file["meshes"][0]["primitives"][0].clone();
        part["material"] = json!(1);
        file["meshes"].as_array_mut().unwrap().push(json!({ "primitives": [part] }));
        file["nodes"]
            .as_array_mut()
            .unwrap()
            .push(json!({ "mesh": 1, "translation": [number(u)?, 0.5, 1.5], "scale": [1, 2, 1] }));
        file["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(3));
    }
    file["accessors"]
        .as_array_mut()
        .unwrap()
        .push(json!({ "bufferView": 1, "componentType": 5126, "count": 4, "type": "SCALAR" }));
    let attributes = [("_VTEX_UVW", 0), ("_VTEX_HEIGHT", 0), ("NORMAL", 0), ("_VTEX_DW", 3), ("_VTEX_JITTER", 3)];
    for (name, accessor) in attributes {
        if one_in(u, 3)? {
            file["meshes"][0]["primitives"][0]["attributes"][name] = json!(accessor);
        }
    }
    let path = folder.join("made.gltf");
    std::fs::write(&path, file.to_string()).unwrap();
    let options = ReadOptions { max_bytes: MEMORY, max_instances: 1 << 12, contained: true, ..ReadOptions::default() };
    let is_seen = one_in(u, 16)?;
    Ok(gltf::read(&path, &options).and_then(|scene| if is_seen { seen(&scene) } else { Ok(()) }))
}
