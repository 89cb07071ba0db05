//! Rigid copies: where they stand, and the nodes that place them.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use glam::DQuat;
use serde_json::{Value, json};

use super::super::document::Document;
use super::super::extension::NAME;
use super::super::nodes::{self, Graph, INSTANCING, Placed};
use super::super::write::Editor;
use super::options::{Cells, Covered, MapOptions};
use super::plan::{Plan, metres_per_unit};
use super::scatter::{Border, Discs, Point, Target};
use super::shell::palette;
use super::surface::{Coordinates, Surface, WRITTEN};
use crate::geom::{Aabb, DVec3};
use crate::random::SplitMix64;
use crate::scene::copies::to_texel;
use crate::scene::shell::Orientations;
use crate::{Error, Result, Warnings};

/// The least distance between copies, in mean spacings. Random darts fill the plane at .83, and independent points have none:
/// at this, stands look grown, neither planted in rows nor thrown.
const APART: f64 = 0.7;
/// Steeper slopes sink copies no more than this one does (tangent).
const STEEPEST: f64 = 2.0;
/// The source's origin may lie this far outside of the content, in its widths, and still be what stands on the ground.
const PIVOT_ROOM: f64 = 0.25;
/// More copies than this are not placed in one mapping.
const MOST_COPIES: f64 = (1u64 << 24) as f64;
/// Copies along the shorter side of a ground that is smaller than one.
const FEW_FIT: f64 = 16.0;

/// A texel as copies of it are placed, at scale 1: metres, the source's origin at 0, +Y up.
struct Kind {
    name: String,
    /// The content's box.
    content: Aabb,
    /// What is put on the ground.
    pivot: DVec3,
    /// Factor that all its copies are drawn by.
    size: f64,
}

impl Kind {
    /// Mean width of the content, metres.
    fn width(&self) -> f64 {
        let size = self.content.size();
        0.5 * (size.x + size.z) * self.size
    }

    /// How far the content reaches from the pivot, across the heights.
    fn reach(&self) -> f64 {
        let (a, b) = (self.content.min - self.pivot, self.content.max - self.pivot);
        let far = a.abs().max(b.abs());
        far.x.hypot(far.z) * self.size
    }
}

/// The copies of one texel on one material.
struct Stand {
    material: Option<usize>,
    kind: usize,
    translations: Vec<DVec3>,
    rotations: Vec<[f32; 4]>,
    scales: Vec<f32>,
}

/// Place copies on `surfaces`, whose cells are `cell` wide, and add their nodes to the file; what to say of them.
///
/// # Errors
/// `Limit` where there would be too many.
pub fn place(
    (document, graph): (&Document, &Graph),
    options: &MapOptions,
    (plan, surfaces, cell): (&Plan, &[&Surface], [f64; 2]),
    texels: &[usize],
    editor: &mut Editor,
    (notes, warnings): (&mut Vec<String>, &mut Warnings),
) -> Result<Vec<Covered>> {
    let mut target = Target::default();
    for (i, surface) in surfaces.iter().enumerate() {
        for world in &surface.worlds {
            surface.faces(*world, Coordinates::Uv).for_each(|f| target.push(f.corners, f.cross, i));
        }
    }
    let kinds = kinds(options, cell, &target, notes, warnings);
    let per_area = density(options, cell, &kinds);
    let mut stands: Vec<Stand> = Vec::new();
    let wanted = per_area * target.area() * options.presence;
    if wanted.is_nan() || wanted > MOST_COPIES {
        let (needed, allowed) = (wanted as u64, MOST_COPIES as u64);
        return Err(Error::Limit { what: "placing copies (--density, --size)".into(), needed, allowed });
    }
    // Wide enough for the least distances among the new and, a quarter of a width each, to what stands already.
    let widest = kinds.iter().map(|k| radius(k, &kinds, per_area).max(0.25 * k.width())).fold(0.0, f64::max);
    let mut discs = Discs::new(widest);
    if options.add {
        for (p, r) in standing(document, graph, surfaces, &kinds, per_area)? {
            discs.insert(p, r);
        }
    }
    let border = options.inset.then(|| {
        let reach = kinds.iter().map(|k| k.reach() * options.scale[1]).fold(0.0, f64::max);
        Border::new(&target.border(), reach, plan.up)
    });
    // The widest first: they find room less easily.
    let mut order: Vec<usize> = (0..kinds.len()).collect();
    order.sort_by(|&a, &b| kinds[b].width().total_cmp(&kinds[a].width()).then(a.cmp(&b)));
    let mut random = SplitMix64::new(u64::from(options.seed));
    let (mut before, mut missing, mut overhanging) = (0.0, 0.0, 0);
    for (n, &kind) in order.iter().enumerate() {
        // A texel that is given twice comes twice as often, in one stand.
        let shown = texels.iter().position(|t| Some(t) == texels.get(kind)).unwrap_or(kind);
        // Shares that add up to the whole number of copies.
        let upto = wanted * (n + 1) as f64 / kinds.len() as f64;
        let count = upto.round() - f64::round(before);
        before = upto;
        let radius = radius(&kinds[kind], &kinds, per_area);
        let points = discs.throw(&target, count.max(0.0) as usize, radius, &mut random);
        missing += count - points.len() as f64;
        for point in points {
            let copy = placement(options, plan, &kinds[kind], &point, &mut random);
            let up = plan.up.unwrap_or(point.normal);
            let reach = kinds[kind].reach() * f64::from(copy.scale) / kinds[kind].size;
            if border.as_ref().is_some_and(|b| b.is_within(point.at, reach, up)) {
                overhanging += 1;
                continue;
            }
            let material = surfaces.get(point.surface).and_then(|s| s.material);
            let own = stands.iter().position(|s| (s.material, s.kind) == (material, shown));
            let own = own.unwrap_or_else(|| {
                let (translations, rotations, scales) = (vec![], vec![], vec![]);
                stands.push(Stand { material, kind: shown, translations, rotations, scales });
                stands.len() - 1
            });
            stands[own].translations.push(copy.at);
            stands[own].rotations.push(copy.rotation);
            stands[own].scales.push(copy.scale);
        }
    }
    if missing >= 1.0 {
        notes.push(format!("{missing:.0} copies found no room at their least distance"));
    }
    if overhanging > 0 {
        notes.push(format!("{overhanging} copies that would overhang the border were left out (--inset)"));
    }
    stands.sort_by_key(|s| (s.material, s.kind));
    let mut covered = Vec::new();
    for stand in &stands {
        let kind = &kinds[stand.kind];
        let material = stand.material.and_then(|m| document.root.materials.get(m));
        let name = material.and_then(|m| m.name.clone());
        let name = name.or(stand.material.map(|m| format!("material {m}"))).unwrap_or_else(|| "bare faces".into());
        write(options, kind, stand, &name, texels.get(stand.kind).copied().unwrap_or(0), editor)?;
        let size = kind.content.size() * kind.size * options.scale[1];
        covered.push(Covered {
            material: name,
            texel: Some(kind.name.clone()),
            cell: [size.x, size.z],
            height: size.y,
            copies: stand.translations.len() as f64,
        });
    }
    if covered.is_empty() {
        warnings.add("the ground has no room for a single copy: nothing was placed (--density, --size)");
    }
    Ok(covered)
}

/// The texels with their sizes.
fn kinds(
    options: &MapOptions,
    cell: [f64; 2],
    target: &Target,
    notes: &mut Vec<String>,
    warnings: &mut Warnings,
) -> Vec<Kind> {
    let mut kinds: Vec<Kind> = Vec::new();
    for (path, info) in &options.texels {
        let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        if info.metres_per_unit <= 0.0 {
            notes.push(format!("{}: the source's unit is unknown and taken as a metre", path.display()));
        }
        let content = info.content.transformed(to_texel(info).inverse());
        let (size, middle) = (content.size(), content.centre());
        let off = (middle.abs() - 0.5 * size) / size.x.max(size.z).max(f64::MIN_POSITIVE);
        let below = DVec3::new(middle.x, content.min.y, middle.z);
        // Stacks and scans often have their origin somewhere else.
        let far = off.x > PIVOT_ROOM || off.z > PIVOT_ROOM || content.min.y > 0.5 * size.y || content.max.y <= 0.0;
        if far {
            notes.push(format!(
                "{name}: its source's origin lies apart from it; the middle of its foot stands on the ground"
            ));
        }
        kinds.push(Kind { name, content, pivot: if far { below } else { DVec3::ZERO }, size: 1.0 });
    }
    let widest =
        options.texels.iter().map(|(_, i)| i.bounds.size().max_element() * metres_per_unit(i)).fold(0.0, f64::max);
    let tallest = kinds.iter().map(|k| k.content.size().y).fold(0.0, f64::max);
    let cell = (cell[0] * cell[1]).sqrt();
    let side = target.area().sqrt();
    let factor = match (options.size, options.cells) {
        (Some(metres), _) if tallest > 0.0 => metres / tallest,
        (None, Cells::Repeat(_) | Cells::Wide(_)) if widest > 0.0 => cell / widest,
        (None, Cells::Texel) if side < widest => {
            warnings.add(format!(
                "the ground is {side:.3} m across and a copy {widest:.3} m: copies are made smaller (--size sets their height)"
            ));
            side / FEW_FIT / widest
        }
        _ => 1.0,
    };
    kinds.iter_mut().for_each(|k| k.size = factor);
    kinds
}

/// Copies per square metre.
fn density(options: &MapOptions, cell: [f64; 2], kinds: &[Kind]) -> f64 {
    if let Some(density) = options.density {
        return density;
    }
    if options.cells != Cells::Texel {
        return 1.0 / (cell[0] * cell[1]);
    }
    // Crowns touch.
    let mean = kinds.iter().map(|k| k.width() * k.width()).sum::<f64>() / kinds.len().max(1) as f64;
    if mean > 0.0 { 1.0 / mean } else { 1.0 }
}

/// Half the least distance between two copies of one kind: kinds share the ground by their widths.
fn radius(kind: &Kind, kinds: &[Kind], density: f64) -> f64 {
    let mean = kinds.iter().map(|k| k.width() * k.width()).sum::<f64>() / kinds.len().max(1) as f64;
    let share = if mean > 0.0 { kind.width() / mean.sqrt() } else { 1.0 };
    0.5 * APART * share / density.sqrt()
}

/// Copies that stand on the materials already, with the discs that they take: what is added may grow under their crowns, and
/// keeps half its own width from where they stand.
fn standing(
    document: &Document,
    graph: &Graph,
    surfaces: &[&Surface],
    kinds: &[Kind],
    density: f64,
) -> Result<Vec<(DVec3, f64)>> {
    let room = kinds.iter().map(|k| 0.5 * k.width() - radius(k, kinds, density)).fold(f64::INFINITY, f64::min);
    let mut found = Vec::new();
    for placed in graph.meshes.iter().filter(|placed| holds_copies(document, placed, surfaces)) {
        let places = nodes::instances(document, placed, None, &mut Warnings::default())?;
        found.extend(places.iter().map(|p| (p.translation, room)));
    }
    Ok(found)
}

/// Whether an earlier mapping placed copies on one of the surfaces' materials.
pub fn stand(document: &Document, graph: &Graph, surfaces: &[&Surface]) -> bool {
    graph.meshes.iter().any(|placed| holds_copies(document, placed, surfaces))
}

fn holds_copies(document: &Document, placed: &Placed, surfaces: &[&Surface]) -> bool {
    let extras = placed.node.and_then(|n| document.root.nodes.get(n)).and_then(|n| n.extras.as_ref());
    let extras = extras.and_then(|e| serde_json::from_str::<Value>(e.get()).ok());
    extras.is_some_and(|e| stands_on(&e, surfaces))
}

/// Whether a node's `extras` say that it holds copies that were placed on one of the surfaces' materials.
fn stands_on(extras: &Value, surfaces: &[&Surface]) -> bool {
    let Some(ground) = extras.get(WRITTEN).and_then(|w| w.get("ground")) else { return false };
    surfaces.iter().any(|s| *ground == json!(s.material))
}

/// Take away the copies that an earlier mapping placed on the surfaces' materials.
pub fn remove(surfaces: &[&Surface], editor: &mut Editor, warnings: &mut Warnings) {
    let Some(nodes) = editor.json.get_mut("nodes").and_then(Value::as_array_mut) else { return };
    let mut gone = Vec::new();
    for (i, node) in nodes.iter_mut().enumerate() {
        if node.get("extras").is_some_and(|e| stands_on(e, surfaces))
            && let Some(node) = node.as_object_mut()
        {
            let name = node.get("name").and_then(Value::as_str).unwrap_or("copies");
            warnings.add(format!("{name:?} of an earlier mapping are replaced (--add keeps them)"));
            // The node stays, so that numbers of others do, and shows nothing.
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

/// One copy, placed.
struct Placement {
    at: DVec3,
    rotation: [f32; 4],
    scale: f32,
}

fn placement(options: &MapOptions, plan: &Plan, kind: &Kind, point: &Point, random: &mut SplitMix64) -> Placement {
    let up = plan.up.unwrap_or(point.normal);
    let [least, most] = options.scale;
    let scale = kind.size * (least + random.unit() * (most - least));
    let turn = random.unit() * TAU;
    let turn = if options.orientations == Orientations::Identity { 0.0 } else { turn };
    let rotation = DQuat::from_rotation_arc(DVec3::Y, up) * DQuat::from_rotation_y(turn);
    let cosine = point.normal.dot(up).abs().clamp(1e-6, 1.0);
    let slope = ((1.0 - cosine * cosine).sqrt() / cosine).min(STEEPEST);
    let at = point.at - up * (options.sink * slope) - rotation * (kind.pivot * scale);
    Placement { at, rotation: rotation.to_array().map(|v| v as f32), scale: scale as f32 }
}

/// Add the node of a stand, its stand-in mesh and its material.
fn write(
    options: &MapOptions,
    kind: &Kind,
    stand: &Stand,
    ground: &str,
    texel: usize,
    editor: &mut Editor,
) -> Result<()> {
    let bounds = Aabb::around(stand.translations.iter().copied());
    // Near its own origin f32 keeps millimetres, wherever the landscape lies.
    let origin = bounds.centre().round();
    let near: Vec<[f32; 3]> = stand.translations.iter().map(|t| (*t - origin).as_vec3().to_array()).collect();
    let translation = editor.add_floats(&near, false)?;
    let rotation = editor.add_floats(&stand.rotations, false)?;
    let scales: Vec<[f32; 3]> = stand.scales.iter().map(|&s| [s; 3]).collect();
    let scale = editor.add_floats(&scales, false)?;
    let mut copies = serde_json::Map::new();
    copies.insert("texel".into(), json!(texel));
    if !options.palette.is_empty() {
        copies.insert("palette".into(), palette(&options.palette));
    }
    let name = format!("{} on {ground}", kind.name);
    let material = json!({"name": name, "extensions": {NAME: {"copies": copies}}});
    let material = editor.push("materials", material)?;
    // The content's box, for viewers that know nothing of texels.
    let corner = |k: usize| {
        let pick = |axis: usize| if k >> axis & 1 == 0 { kind.content.min[axis] } else { kind.content.max[axis] };
        [pick(0) as f32, pick(1) as f32, pick(2) as f32]
    };
    let positions = editor.add_floats(&std::array::from_fn::<_, 8, _>(corner), true)?;
    let indices = editor.add_indices(&BOX)?;
    let primitive = json!({"attributes": {"POSITION": positions}, "indices": indices, "material": material});
    let mesh = editor.push("meshes", json!({"name": name, "primitives": [primitive]}))?;
    editor.place_loose_meshes(mesh)?;
    let attributes = BTreeMap::from([("TRANSLATION", translation), ("ROTATION", rotation), ("SCALE", scale)]);
    let mut node = json!({"name": name, "mesh": mesh, "extensions": {INSTANCING: {"attributes": attributes}},
        "extras": {WRITTEN: {"ground": stand.material}}});
    if origin != DVec3::ZERO {
        node["translation"] = json!(origin.to_array());
    }
    let node = editor.push("nodes", node)?;
    editor.show(node);
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
