//! Plain .glb files that a bench makes for itself: objects, and grounds to cover.

use std::fmt::Write as _;
use std::path::Path;

use serde_json::{Value, json};

use crate::cli::shapes::Shape;
use crate::geom::DVec3;
use crate::render::hash;
use crate::{Result, format};

/// A mesh to be written.
#[derive(Default)]
struct Plain {
    positions: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    /// Height vectors of shells.
    heights: Vec<[f32; 3]>,
    indices: Vec<u32>,
}

/// Colours of the ground, and of objects.
const GROUND: [f64; 3] = [0.1, 0.1, 0.05];
const GREY: [f64; 3] = [0.7; 3];

/// A height field of `side`^2 squares over `size` metres, texture coordinates over the unit square; with a sun.
pub fn ground(path: &Path, side: u32, size: f64, height: fn(f64, f64) -> f64) -> Result<()> {
    write(path, &[("plain", GROUND, &field(side, size, height))])
}

fn field(side: u32, size: f64, height: fn(f64, f64) -> f64) -> Plain {
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
    mesh
}

/// The material of the stands of [`stands`].
pub const STANDS: &str = "stands";
/// Metres from one of [`stands`] to the next, and along the edges of its box: boxes overlap about four-fold.
const APART: f64 = 6.0;
const STAND: f64 = 11.0;
/// Squares along a side of the ground under them.
const SQUARES: u32 = 80;

/// Where one of the stands is, and the edges of its box: along u, along v, and up; metres.
pub struct Stand {
    pub foot: DVec3,
    pub edges: [DVec3; 3],
    /// Width of its box.
    pub wide: f64,
    /// Counter-clockwise seen from above, degrees.
    pub turn: f64,
}

/// All of `side`^2 stands on a height field, row by row: each turned, leaning, and as high as wide.
pub fn all_stands(side: u32, height: fn(f64, f64) -> f64) -> impl Iterator<Item = Stand> {
    (0..side).flat_map(move |j| (0..side).map(move |i| stand(side, [i, j], height)))
}

fn stand(side: u32, [i, j]: [u32; 2], height: fn(f64, f64) -> f64) -> Stand {
    // Six numbers in [0, 1).
    let draw = |seed: u32| hash([i64::from(i), i64::from(j), 0], seed).map(|v| f64::from(v) / 4_294_967_296.0);
    let ([a, b, c, d], [e, f, ..]) = (draw(1), draw(2));
    let place = |k: u32, shift: f64| APART * (f64::from(k) + 0.6 * shift) - 0.5 * APART * f64::from(side);
    let (x, z) = (place(i, a), place(j, b));
    let (wide, turn) = (STAND * (0.8 + 0.4 * c), std::f64::consts::TAU * d);
    let (sin, cos) = libm::sincos(turn);
    let along = wide * DVec3::new(cos, 0.0, sin);
    let across = wide * DVec3::new(sin, 0.0, -cos);
    let up = wide * DVec3::new(0.1 * (e - 0.5), 1.0, 0.1 * (f - 0.5));
    Stand { foot: DVec3::new(x, height(x, z), z), edges: [along, across, up], wide, turn: -360.0 * d }
}

/// `side`^2 tilted squares, each the base of a shell of its own, on a height field; with a sun.
pub fn stands(path: &Path, side: u32, height: fn(f64, f64) -> f64) -> Result<()> {
    let mut mesh = Plain::default();
    for Stand { foot, edges: [along, across, up], .. } in all_stands(side, height) {
        let first = mesh.positions.len() as u32;
        for [u, v] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
            let corner = foot + (u - 0.5) * along + (v - 0.5) * across;
            mesh.positions.push(corner.as_vec3().to_array());
            mesh.uvs.push([u as f32, v as f32]);
            mesh.heights.push(up.as_vec3().to_array());
        }
        mesh.indices.extend([0, 1, 2, 0, 2, 3].map(|k| first + k));
    }
    write(path, &[(STANDS, GROUND, &mesh), ("ground", GROUND, &under(side, height))])
}

/// The ground of [`stands`] alone, and a table of their places for copies of an object that is `metres` wide.
pub fn places(ground: &Path, table: &Path, side: u32, height: fn(f64, f64) -> f64, metres: f64) -> Result<()> {
    write(ground, &[("ground", GROUND, &under(side, height))])?;
    let mut text = String::from("x,y,z,scale,turn\n");
    for stand in all_stands(side, height) {
        let DVec3 { x, y, z } = stand.foot;
        let _ = writeln!(text, "{x:.3},{y:.3},{z:.3},{:.5},{:.3}", stand.wide / metres, stand.turn);
    }
    format::save(table, text.as_bytes())
}

fn under(side: u32, height: fn(f64, f64) -> f64) -> Plain {
    field(SQUARES, APART * f64::from(side), height)
}

/// A shape, in its own unit cube.
pub fn object(path: &Path, shape: &Shape) -> Result<()> {
    let mut mesh = Plain::default();
    for (i, corner) in shape.triangles.iter().flatten().enumerate() {
        mesh.positions.push(corner.as_vec3().to_array());
        mesh.indices.push(i as u32);
    }
    write(path, &[("plain", GREY, &mesh)])
}

/// What a file holds so far.
#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    /// Add an accessor, if it has elements; its number.
    fn add(&mut self, words: Vec<[u8; 4]>, kind: &str, (component, width): (u32, usize)) -> Option<usize> {
        if words.is_empty() {
            return None;
        }
        let count = words.len() / width;
        self.accessors
            .push(json!({"bufferView": self.views.len(), "componentType": component, "count": count, "type": kind}));
        self.views.push(json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": 4 * words.len()}));
        self.bytes.extend(words.into_iter().flatten());
        Some(self.accessors.len() - 1)
    }
}

/// A .glb of meshes, each with the name and the colour of its material, and a sun.
fn write(path: &Path, parts: &[(&str, [f64; 3], &Plain)]) -> Result<()> {
    let mut buffer = Buffer::default();
    let (mut primitives, mut materials) = (Vec::new(), Vec::new());
    for (name, [r, g, b], mesh) in parts {
        primitives.push(mesh.primitive(&mut buffer, materials.len()));
        let colour = json!({"baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0});
        materials.push(json!({"name": name, "doubleSided": true, "pbrMetallicRoughness": colour}));
    }
    let sun = json!({"rotation": [-0.4, 0.25, 0.1, 0.876], "extensions": {"KHR_lights_punctual": {"light": 0}}});
    let file = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, sun],
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "directional", "intensity": 3.0}]}},
        "materials": materials,
        "meshes": [{"primitives": primitives}],
        "buffers": [{"byteLength": buffer.bytes.len()}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
    });
    let mut text = file.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    // All sections are of whole words.
    let chunks = [(b"JSON", text), (b"BIN\0", buffer.bytes)];
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

impl Plain {
    fn primitive(&self, buffer: &mut Buffer, material: usize) -> Value {
        const FLOAT: u32 = 5126;
        const UNSIGNED_INT: u32 = 5125;
        let floats = |list: &[[f32; 3]]| -> Vec<[u8; 4]> { list.iter().flatten().map(|v| v.to_le_bytes()).collect() };
        let uvs: Vec<[u8; 4]> = self.uvs.iter().flatten().map(|v| v.to_le_bytes()).collect();
        let mut attributes = json!({});
        for (name, kind, words, width) in [
            ("POSITION", "VEC3", floats(&self.positions), 3),
            ("TEXCOORD_0", "VEC2", uvs, 2),
            ("_VTEX_HEIGHT", "VEC3", floats(&self.heights), 3),
        ] {
            if let Some(number) = buffer.add(words, kind, (FLOAT, width)) {
                attributes[name] = number.into();
                if name == "POSITION" {
                    let corners = || self.positions.iter().map(|p| DVec3::from_array(p.map(f64::from)));
                    let low = corners().fold(DVec3::INFINITY, DVec3::min).to_array();
                    let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max).to_array();
                    let accessor = &mut buffer.accessors[number];
                    (accessor["min"], accessor["max"]) = (json!(low), json!(high));
                }
            }
        }
        let indices = self.indices.iter().map(|v| v.to_le_bytes()).collect();
        let indices = buffer.add(indices, "SCALAR", (UNSIGNED_INT, 1));
        json!({"attributes": attributes, "indices": indices, "material": material})
    }
}
