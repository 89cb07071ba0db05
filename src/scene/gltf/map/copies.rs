//! Rigid copies in a mapping: the size of each texel as a copy, and writing and removing the nodes that hold copies.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::super::document::Document;
use super::super::extension::NAME;
use super::super::nodes::{self, Graph, INSTANCING, Placed};
use super::super::write::Editor;
use super::options::{Cells, MapOptions};
use super::plan::metres_per_unit;
use super::scatter::SampledTriangles;
use super::shell::restyle;
use super::surface::{Surface, WRITTEN};
use crate::error::length;
use crate::geom::{Aabb, DVec3};
use crate::scene::copies::to_texel;
use crate::{Result, Warnings};

/// Largest distance of the source's origin outside of the content, in widths of the content, at which the origin is put on the ground.
const PIVOT_ROOM: f64 = 0.25;
/// Number of copies along the shorter side of a ground that is smaller than one copy; copies are scaled to fit.
const FEW_FIT: f64 = 16.0;

/// A texel as copies of it are placed, at scale 1: metres, the source's origin at 0, +Y up.
pub struct CopyModel {
    pub name: String,
    /// The content's box.
    pub content: Aabb,
    /// The point that is put on the ground.
    pub pivot: DVec3,
    /// Scale of all its copies.
    pub size: f64,
    /// Its share of all copies.
    pub share: f64,
}

impl CopyModel {
    /// Mean width of the content, metres.
    pub fn width(&self) -> f64 {
        let size = self.content.size();
        0.5 * (size.x + size.z) * self.size
    }

    /// How far the content reaches from the pivot, across the heights.
    pub fn reach(&self) -> f64 {
        let (a, b) = (self.content.min - self.pivot, self.content.max - self.pivot);
        let far = a.abs().max(b.abs());
        far.x.hypot(far.z) * self.size
    }
}

/// The copies of one texel on one material, which become one node.
pub struct CopyGroup {
    pub material: Option<usize>,
    /// Index of the texel, among those that are mapped.
    pub model: usize,
    pub translations: Vec<DVec3>,
    pub rotations: Vec<[f32; 4]>,
    pub scales: Vec<f32>,
    /// Factors of the albedo; empty where all are 1.
    pub tints: Vec<[f32; 3]>,
}

/// The texels with their sizes and shares.
pub fn models(
    options: &MapOptions,
    cell: [f64; 2],
    target: &SampledTriangles,
    notes: &mut Vec<String>,
    warnings: &mut Warnings,
) -> Vec<CopyModel> {
    let mut models: Vec<CopyModel> = Vec::new();
    let weights = |k: usize| options.weights.get(k).copied().unwrap_or(1.0);
    let total: f64 = (0..options.texels.len()).map(weights).sum();
    for (k, (path, info)) in options.texels.iter().enumerate() {
        let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        if info.metres_per_unit <= 0.0 {
            notes.push(format!("{}: the source's unit is unknown and taken as a metre", path.display()));
        }
        let content = info.content.transformed(to_texel(info).inverse());
        let (size, middle) = (content.size(), content.centre());
        let off = (middle.abs() - 0.5 * size) / size.x.max(size.z).max(f64::MIN_POSITIVE);
        let below = DVec3::new(middle.x, content.min.y, middle.z);
        // The origin of stacks and scans is often far from the object.
        let far = off.x > PIVOT_ROOM || off.z > PIVOT_ROOM || content.min.y > 0.5 * size.y || content.max.y <= 0.0;
        if far {
            notes.push(format!(
                "{name}: its source's origin lies apart from it; the middle of its foot stands on the ground"
            ));
        }
        let pivot = if far { below } else { DVec3::ZERO };
        models.push(CopyModel { name, content, pivot, size: 1.0, share: weights(k) / total });
    }
    let widest =
        options.texels.iter().map(|(_, i)| i.bounds.size().max_element() * metres_per_unit(i)).fold(0.0, f64::max);
    let tallest = models.iter().map(|k| k.content.size().y).fold(0.0, f64::max);
    let cell = (cell[0] * cell[1]).sqrt();
    let side = target.area().sqrt();
    if options.sizes.len() > 1 {
        for (model, metres) in models.iter_mut().zip(&options.sizes).filter(|(k, _)| k.content.size().y > 0.0) {
            model.size = metres / model.content.size().y;
        }
        return models;
    }
    let factor = match (options.sizes.first(), options.cells) {
        (Some(metres), _) if tallest > 0.0 => metres / tallest,
        (None, Cells::Repeat(_) | Cells::Wide(_)) if widest > 0.0 => cell / widest,
        (None, Cells::Texel) if side < widest => {
            warnings.add(format!(
                "the ground is {} m across and a copy {} m: copies are made smaller (option `sizes` sets their height)",
                length(side),
                length(widest)
            ));
            side / FEW_FIT / widest
        }
        _ => 1.0,
    };
    models.iter_mut().for_each(|k| k.size = factor);
    models
}

/// Positions of the copies that earlier mappings placed on the surfaces' materials.
pub fn existing_positions(document: &Document, graph: &Graph, surfaces: &[&Surface]) -> Result<Vec<DVec3>> {
    let mut found = Vec::new();
    for placed in graph.meshes.iter().filter(|placed| holds_copies(document, placed, surfaces)) {
        let places = nodes::instances(document, placed, None, &mut Warnings::default())?;
        found.extend(places.iter().map(|p| p.translation));
    }
    Ok(found)
}

/// Whether an earlier mapping placed copies on one of the surfaces' materials.
pub fn has_copies(document: &Document, graph: &Graph, surfaces: &[&Surface]) -> bool {
    graph.meshes.iter().any(|placed| holds_copies(document, placed, surfaces))
}

fn holds_copies(document: &Document, placed: &Placed, surfaces: &[&Surface]) -> bool {
    let extras = placed.node.and_then(|n| document.root.nodes.get(n)).and_then(|n| n.extras.as_ref());
    let extras = extras.and_then(|e| serde_json::from_str::<Value>(e.get()).ok());
    extras.is_some_and(|e| stands_on(&e, surfaces))
}

/// Whether a node's `extras` mark it as holding copies on one of the surfaces' materials.
fn stands_on(extras: &Value, surfaces: &[&Surface]) -> bool {
    let Some(ground) = extras.get(WRITTEN).and_then(|w| w.get("ground")) else { return false };
    surfaces.iter().any(|s| *ground == json!(s.material))
}

/// Remove the copies that earlier mappings placed on the surfaces' materials.
pub fn remove(surfaces: &[&Surface], editor: &mut Editor, warnings: &mut Warnings) {
    let Some(nodes) = editor.json.get_mut("nodes").and_then(Value::as_array_mut) else { return };
    let mut gone = Vec::new();
    for (i, node) in nodes.iter_mut().enumerate() {
        if node.get("extras").is_some_and(|e| stands_on(e, surfaces))
            && let Some(node) = node.as_object_mut()
        {
            let name = node.get("name").and_then(Value::as_str).unwrap_or("copies");
            warnings.add(format!("{name:?} of an earlier mapping are replaced (option `add` keeps them)"));
            // The node itself is kept, so that the indices of other nodes stay valid, but it shows nothing.
            for key in ["mesh", "extensions", "extras"] {
                node.shift_remove(key);
            }
            gone.push(json!(i));
        }
    }
    let scenes = editor.json.get_mut("scenes").and_then(Value::as_array_mut);
    for scene in scenes.into_iter().flatten() {
        if let Some(nodes) = scene.get_mut("nodes").and_then(Value::as_array_mut) {
            nodes.retain(|n| !gone.contains(n));
        }
    }
}

/// Add the node of a stand, its stand-in mesh and its material.
pub fn write(
    options: &MapOptions,
    model: &CopyModel,
    group: &CopyGroup,
    ground: &str,
    texel: usize,
    editor: &mut Editor,
) -> Result<()> {
    let bounds = Aabb::around(group.translations.iter().copied());
    // Relative to an origin in their midst, positions in f32 keep their millimetres wherever the landscape lies.
    let origin = bounds.centre().round();
    let near: Vec<[f32; 3]> = group.translations.iter().map(|t| (*t - origin).as_vec3().to_array()).collect();
    let translation = editor.add_floats(&near, false)?;
    let rotation = editor.add_floats(&group.rotations, false)?;
    let scales: Vec<[f32; 3]> = group.scales.iter().map(|&s| [s; 3]).collect();
    let scale = editor.add_floats(&scales, false)?;
    let mut copies = serde_json::Map::new();
    copies.insert("texel".into(), json!(texel));
    restyle(options, &mut copies);
    let name = format!("{} on {ground}", model.name);
    let material = json!({"name": name, "extensions": {NAME: {"copies": copies}}});
    let material = editor.push("materials", material)?;
    // The stand-in mesh is the content's box, which viewers show that do not know texels.
    let corner = |k: usize| {
        let pick = |axis: usize| if k >> axis & 1 == 0 { model.content.min[axis] } else { model.content.max[axis] };
        [pick(0) as f32, pick(1) as f32, pick(2) as f32]
    };
    let positions = editor.add_floats(&std::array::from_fn::<_, 8, _>(corner), true)?;
    let indices = editor.add_indices(&BOX)?;
    let primitive = json!({"attributes": {"POSITION": positions}, "indices": indices, "material": material});
    let mesh = editor.push("meshes", json!({"name": name, "primitives": [primitive]}))?;
    editor.place_loose_meshes(mesh)?;
    let mut attributes = BTreeMap::from([("TRANSLATION", translation), ("ROTATION", rotation), ("SCALE", scale)]);
    if !group.tints.is_empty() {
        attributes.insert("_VTEX_TINT", editor.add_floats(&group.tints, false)?);
    }
    let mut node = json!({"name": name, "mesh": mesh, "extensions": {INSTANCING: {"attributes": attributes}},
        "extras": {WRITTEN: {"ground": group.material}}});
    if origin != DVec3::ZERO {
        node["translation"] = json!(origin.to_array());
    }
    let node = editor.push("nodes", node)?;
    editor.add_to_scene(node);
    editor.use_extension(INSTANCING)?;
    editor.use_extension(NAME)
}

/// The triangles of a box whose corner k has bit a set where it is the upper one along axis a; they face out.
const BOX: [u16; 36] =
    [0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5, 0, 1, 5, 0, 5, 4, 2, 6, 7, 2, 7, 3, 0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stand_in_faces_out() {
        let corner = |k: u16| DVec3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2)) - 0.5;
        for t in BOX.as_chunks::<3>().0 {
            let [a, b, c] = t.map(corner);
            assert!((b - a).cross(c - a).dot(a + b + c) > 0.0, "{t:?}");
        }
    }
}
