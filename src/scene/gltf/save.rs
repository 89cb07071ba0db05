//! Writing of a model as a glTF file that uses nothing but glTF 2.0, KHR_lights_punctual, KHR_materials_unlit,
//! KHR_materials_diffuse_transmission, KHR_materials_emissive_strength, KHR_texture_transform and EXT_mesh_gpu_instancing.

mod affine;
mod material;
pub mod points;

use std::collections::BTreeMap;
use std::path::Path;

use glam::DQuat;
use serde_json::{Value, json};

use super::write::{Editor, Saved};
use crate::geom::{DAffine3, DMat3, DVec3};
use crate::scene::model::{Camera, Light, LightKind, Model, Part, Projection};
use crate::{Error, Result, Warnings};
use affine::{Placement, placement};
use material::Materials;

/// Distance from the world's origin beyond which all nodes get a parent in their midst, since positions of instances have 32 bits.
const FAR: f64 = 4096.0;

/// Store a model as `.glb` or, with any other extension, as `.gltf` with a `.bin` beside it. Parts with several instances are stored once.
///
/// # Errors
/// `Input` where nothing is drawn, `Limit` where a `.glb` would be larger than 4 GiB, `Io` where it cannot be written.
pub fn save(model: &Model, output: &Path, warnings: &mut Warnings) -> Result<()> {
    let mut file = Editor::new(output);
    let mut nodes = meshes(model, &mut file, warnings)?;
    if nodes.is_empty() {
        return Err(Error::input(output, "", "nothing is drawn"));
    }
    let middle = middle(model);
    if middle != DVec3::ZERO {
        let root = file.push("nodes", json!({"translation": middle.to_array(), "children": nodes}))?;
        nodes = vec![root];
    }
    for camera in &model.cameras {
        nodes.push(add_camera(camera, &mut file)?);
    }
    add_lights(&model.lights, &mut file, &mut nodes)?;
    file.push("scenes", json!({"nodes": nodes}))?;
    file.json["scene"] = json!(0);
    file.save(output, &Saved::default())
}

/// The origin of the nodes: 0 if the scene lies near it, else a point in its midst.
fn middle(model: &Model) -> DVec3 {
    let n = model.instances.len() as f64;
    let mean = model.instances.iter().map(|i| i.transform.translation).sum::<DVec3>() / n;
    if mean.length() > FAR && mean.is_finite() { mean.round() } else { DVec3::ZERO }
}

/// Add nodes for all instances. Parts with the same instances become primitives of one mesh.
fn meshes(model: &Model, file: &mut Editor, warnings: &mut Warnings) -> Result<Vec<usize>> {
    let mut places: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, instance) in model.instances.iter().enumerate() {
        if model.parts.get(instance.part).is_some_and(|p| !p.triangles.is_empty()) {
            places.entry(instance.part).or_default().push(i);
        }
    }
    let (middle, mut materials) = (middle(model), Materials::new(model));
    let transform = |i: &usize| model.instances.get(*i).map(|i| i.transform);
    let mut nodes = Vec::new();
    let mut left = places.into_iter().peekable();
    while let Some((part, own)) = left.next() {
        let mut together = vec![part];
        while let Some((next, _)) = left.next_if(|(_, other)| other.iter().map(transform).eq(own.iter().map(transform)))
        {
            together.push(next);
        }
        let primitives: Vec<Value> = together
            .iter()
            .filter_map(|part| model.parts.get(*part))
            .map(|part| primitive(part, &mut materials, file, warnings))
            .collect::<Result<_>>()?;
        let mut mesh = json!({"primitives": primitives});
        if let Some(name) = model.parts.get(part).map(|p| &p.name).filter(|n| !n.is_empty()) {
            mesh["name"] = json!(name);
        }
        let mesh = file.push("meshes", mesh)?;
        let name = own.first().and_then(|i| model.instances.get(*i)).map_or("", |i| &i.node);
        let at = |i: &usize| {
            let t = transform(i)?;
            Some(DAffine3 { translation: t.translation - middle, ..t })
        };
        nodes.extend(show(mesh, name, &own.iter().filter_map(at).collect::<Vec<_>>(), file, warnings)?);
    }
    Ok(nodes)
}

/// Add nodes that show a mesh with the given transforms; several without shear become instances of one node.
fn show(
    mesh: usize,
    name: &str,
    places: &[DAffine3],
    file: &mut Editor,
    warnings: &mut Warnings,
) -> Result<Vec<usize>> {
    let (mut rigid, mut nodes, mut flat) = (Vec::new(), Vec::new(), 0);
    let named = |mut node: Value| {
        if !name.is_empty() {
            node["name"] = json!(name);
        }
        node
    };
    for place in places {
        match placement(place) {
            Some(Placement::Rigid(trs)) => rigid.push(trs),
            Some(Placement::Sheared(outer, inner)) => {
                let child = file.push("nodes", json!({"mesh": mesh, "rotation": quaternion(inner)}))?;
                let mut node = outer.json();
                node["children"] = json!([child]);
                nodes.push(file.push("nodes", named(node))?);
            }
            None => flat += 1,
        }
    }
    warnings.add_many("an instance without a volume is left out", flat);
    if let [only] = &rigid[..] {
        let mut node = only.json();
        node["mesh"] = json!(mesh);
        nodes.push(file.push("nodes", named(node))?);
    } else if !rigid.is_empty() {
        let narrow = |v: DVec3| v.as_vec3().to_array();
        let translations: Vec<[f32; 3]> = rigid.iter().map(|t| narrow(t.translation)).collect();
        let rotations: Vec<[f32; 4]> = rigid.iter().map(|t| t.rotation.as_quat().normalize().to_array()).collect();
        let scales: Vec<[f32; 3]> = rigid.iter().map(|t| narrow(t.scale)).collect();
        let attributes = json!({"TRANSLATION": file.add_floats(&translations, false)?,
            "ROTATION": file.add_floats(&rotations, false)?, "SCALE": file.add_floats(&scales, false)?});
        // A renderer that does not know it would show one copy of each.
        file.use_extension("EXT_mesh_gpu_instancing")?;
        file.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
        let node = json!({"mesh": mesh, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}});
        nodes.push(file.push("nodes", named(node))?);
    }
    Ok(nodes)
}

fn quaternion(turn: DQuat) -> [f64; 4] {
    turn.normalize().to_array()
}

fn primitive(part: &Part, materials: &mut Materials<'_>, file: &mut Editor, warnings: &mut Warnings) -> Result<Value> {
    let mut attributes = json!({"POSITION": file.add_floats(&part.positions, true)?});
    let n = part.positions.len();
    if let Some(normals) = part.normals.as_ref().filter(|v| v.len() == n) {
        let unit: Vec<[f32; 3]> = normals.iter().map(|v| unit(*v)).collect();
        attributes["NORMAL"] = json!(file.add_floats(&unit, true)?);
    }
    let uvs = materials.tex_coord(part.material).and_then(|k| part.uvs.get(k)).filter(|v| v.len() == n);
    if let Some(uvs) = uvs {
        attributes["TEXCOORD_0"] = json!(file.add_floats(uvs, true)?);
    }
    if let Some(colors) = part.colors.as_ref().filter(|v| v.len() == n) {
        let within: Vec<[f32; 4]> = colors.iter().map(|c| c.map(|v| v.clamp(0.0, 1.0))).collect();
        attributes["COLOR_0"] = json!(file.add_floats(&within, true)?);
    }
    // The greatest index of 16 bits ends a strip in some interfaces.
    let indices = if n < 65_535 {
        file.add_indices(&part.triangles.iter().flatten().map(|v| *v as u16).collect::<Vec<_>>())?
    } else {
        file.add_long_indices(&part.triangles)?
    };
    let material = materials.index(part.material, uvs.is_some(), file, warnings)?;
    Ok(json!({"attributes": attributes, "indices": indices, "material": material}))
}

/// Of unit length to within the rounding of 32 bits; up, where there is no direction.
fn unit(v: [f32; 3]) -> [f32; 3] {
    DVec3::from_array(v.map(f64::from)).normalize_or(DVec3::Y).as_vec3().to_array()
}

/// A node with the position and the orientation of `to_world`, without its scale.
fn standing(to_world: &DAffine3) -> Value {
    let m = to_world.matrix3;
    let back = m.z_axis.normalize_or(DVec3::Z);
    let right = m.y_axis.cross(back).try_normalize().unwrap_or_else(|| back.any_orthonormal_vector());
    let turn = DQuat::from_mat3(&DMat3::from_cols(right, back.cross(right), back));
    json!({"translation": to_world.translation.to_array(), "rotation": quaternion(turn)})
}

fn add_camera(camera: &Camera, file: &mut Editor) -> Result<usize> {
    /// Metres before a camera at which its picture begins, and, of parallel rays, ends.
    const NEAR: f64 = 0.01;
    const END: f64 = 1e5;
    let mut json = match camera.projection {
        Projection::Perspective { yfov } => {
            json!({"type": "perspective", "perspective": {"yfov": yfov, "znear": NEAR}})
        }
        Projection::Orthographic { ymag } => {
            let xmag = ymag * camera.aspect.unwrap_or(1.0);
            json!({"type": "orthographic", "orthographic": {"xmag": xmag, "ymag": ymag, "znear": 0.0, "zfar": END}})
        }
    };
    if let (Some(aspect), Some(view)) = (camera.aspect, json.get_mut("perspective")) {
        view["aspectRatio"] = json!(aspect);
    }
    let mut node = standing(&camera.to_world);
    if !camera.name.is_empty() {
        (json["name"], node["name"]) = (json!(camera.name), json!(camera.name));
    }
    node["camera"] = json!(file.push("cameras", json)?);
    file.push("nodes", node)
}

fn add_lights(lights: &[Light], file: &mut Editor, nodes: &mut Vec<usize>) -> Result<()> {
    if lights.is_empty() {
        return Ok(());
    }
    let mut list = Vec::new();
    for light in lights {
        let intensity = light.intensity.iter().copied().fold(0.0, f64::max);
        let color = light.intensity.map(|c| if intensity > 0.0 { c / intensity } else { 1.0 });
        let mut json = json!({"color": color, "intensity": intensity});
        match light.kind {
            LightKind::Directional => json["type"] = json!("directional"),
            LightKind::Point => json["type"] = json!("point"),
            LightKind::Spot { inner, outer } => {
                json["type"] = json!("spot");
                json["spot"] = json!({"innerConeAngle": inner, "outerConeAngle": outer});
            }
        }
        if light.range.is_finite() && light.kind != LightKind::Directional {
            json["range"] = json!(light.range);
        }
        let mut node = standing(&light.to_world);
        if !light.name.is_empty() {
            (json["name"], node["name"]) = (json!(light.name), json!(light.name));
        }
        node["extensions"] = json!({"KHR_lights_punctual": {"light": list.len()}});
        list.push(json);
        nodes.push(file.push("nodes", node)?);
    }
    file.use_extension("KHR_lights_punctual")?;
    file.json["extensions"]["KHR_lights_punctual"]["lights"] = json!(list);
    Ok(())
}
