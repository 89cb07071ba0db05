//! The node graph → placed meshes, cameras and lights in world space.

use glam::{DMat3, DQuat, DVec3};
use serde_json::Value;

use super::document::{Document, NodeTransform, index};
use super::{ReadOptions, light};
use crate::geom::DAffine3;
use crate::scene::model::{Camera, Light};
use crate::scene::select::Selection;
use crate::{Error, Result, Warnings};

/// Most visits of nodes. A tree needs one visit per node; a graph that shares nodes at every depth needs many more.
const MAX_VISITS: usize = 1 << 22;

/// Contents of the chosen scene, in world space.
pub struct Graph {
    /// Nodes that show a mesh.
    pub meshes: Vec<Placed>,
    /// Cameras.
    pub cameras: Vec<Camera>,
    /// Punctual lights.
    pub lights: Vec<Light>,
    /// Node → world, for the nodes of the scene.
    worlds: Vec<Option<DAffine3>>,
}

/// A node that shows a mesh.
pub struct Placed {
    /// None where the file has no nodes at all.
    pub node: Option<usize>,
    /// Name of the node.
    pub name: String,
    /// Index of the mesh.
    pub mesh: usize,
    /// Map from node space to the world.
    pub world: DAffine3,
}

/// Visit the chosen scene once, depth first in file order.
pub fn walk(
    document: &Document,
    options: &ReadOptions,
    selection: &mut Selection,
    warnings: &mut Warnings,
) -> Result<Graph> {
    let nodes = &document.root.nodes;
    let mut graph = Graph { meshes: vec![], cameras: vec![], lights: vec![], worlds: vec![None; nodes.len()] };
    let roots = roots(document, options, warnings)?;
    let root =
        PendingNode { node: 0, depth: 0, parent: DAffine3::IDENTITY, taken: selection.takes_all(), left_out: false };
    let mut stack: Vec<PendingNode> = roots.iter().rev().map(|&node| PendingNode { node, ..root }).collect();
    let mut visits = 0;
    while let Some(pending) = stack.pop() {
        visits += 1;
        let at = || format!("nodes[{}]", pending.node);
        if pending.depth > nodes.len() {
            return Err(document.error(at(), "is its own ancestor"));
        }
        if visits > MAX_VISITS {
            return Err(document.error(at(), "is reached along too many ways; a node has one parent"));
        }
        let below = graph.visit(document, pending, selection, warnings)?;
        let children = nodes.get(pending.node).and_then(|node| node.children.as_ref());
        stack.extend(children.into_iter().flatten().rev().map(|c| PendingNode { node: c.value(), ..below }));
    }
    if nodes.is_empty() && !document.root.meshes.is_empty() {
        warnings.add("the file has no nodes; each of its meshes is placed where it is");
        graph.meshes = unplaced_meshes(document, selection);
    }
    graph.place_others(document, warnings);
    Ok(graph)
}

/// The chosen meshes of a file without nodes.
fn unplaced_meshes(document: &Document, selection: &mut Selection) -> Vec<Placed> {
    let mut out = Vec::new();
    for (mesh, json) in document.root.meshes.iter().enumerate() {
        let name = json.name.clone().unwrap_or_else(|| format!("mesh {mesh}"));
        let (included, excluded) = (selection.includes(&name), selection.excludes(&name));
        if (included || selection.takes_all()) && !excluded {
            out.push(Placed { node: None, name, mesh, world: DAffine3::IDENTITY });
        }
    }
    out
}

/// A node that is still to be visited, with the state that its ancestors pass down.
#[derive(Clone, Copy)]
struct PendingNode {
    node: usize,
    depth: usize,
    parent: DAffine3,
    taken: bool,
    left_out: bool,
}

/// The root nodes of the chosen scene.
fn roots(document: &Document, options: &ReadOptions, warnings: &mut Warnings) -> Result<Vec<usize>> {
    let scenes = &document.root.scenes;
    let of = |scene: &gltf::json::Scene| scene.nodes.iter().map(|n| n.value()).collect();
    if let Some(wanted) = &options.scene {
        let by_index = || wanted.parse::<usize>().ok().and_then(|i| scenes.get(i));
        let scene = scenes.iter().find(|s| s.name.as_deref() == Some(wanted)).or_else(by_index);
        return scene.map(of).ok_or_else(|| {
            let names: Vec<String> =
                scenes.iter().enumerate().map(|(i, s)| s.name.clone().unwrap_or(i.to_string())).collect();
            Error::Options(format!("no scene is named {wanted}; the file has: {}", names.join(", ")))
        });
    }
    if let Some(default) = index(document.root.scene) {
        let missing = || document.error("scene", format!("scenes[{default}] does not exist"));
        return scenes.get(default).map(of).ok_or_else(missing);
    }
    if let Some(first) = scenes.first() {
        if scenes.len() > 1 {
            warnings.add(format!("the file names no default scene; the first of {} is used", scenes.len()));
        }
        return Ok(of(first));
    }
    warnings.add("the file has no scene; all its root nodes are used");
    Ok(tops(document))
}

/// A node's own transform.
fn local(place: &NodeTransform, warnings: &mut Warnings) -> DAffine3 {
    if let Some(m) = place.matrix {
        if [m[3], m[7], m[11], m[15]] != [0.0, 0.0, 0.0, 1.0] {
            warnings.add("a node's matrix has a last row other than 0 0 0 1, which is ignored");
        }
        let column = |k: usize| DVec3::new(m[4 * k], m[4 * k + 1], m[4 * k + 2]);
        return DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) };
    }
    DAffine3::from_scale_rotation_translation(
        place.scale.map_or(DVec3::ONE, DVec3::from),
        rotation(place.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]), warnings),
        place.translation.map_or(DVec3::ZERO, DVec3::from),
    )
}

fn rotation(xyzw: [f64; 4], warnings: &mut Warnings) -> DQuat {
    let q = DQuat::from_array(xyzw);
    let length = q.length();
    if length.is_normal() {
        return q / length;
    }
    warnings.add("a rotation of length 0 is ignored");
    DQuat::IDENTITY
}

impl Graph {
    /// Take what a node shows, where it is chosen; gives the state that its children inherit.
    fn visit(
        &mut self,
        document: &Document,
        pending: PendingNode,
        selection: &mut Selection,
        warnings: &mut Warnings,
    ) -> Result<PendingNode> {
        let id = pending.node;
        let at = || format!("nodes[{id}]");
        let (Some(node), Some(place), Some(seen)) =
            (document.root.nodes.get(id), document.places.get(id), self.worlds.get_mut(id))
        else {
            return Err(document.error(at(), "does not exist"));
        };
        if seen.is_some() {
            warnings.add("a node with several parents is shown below each");
        }
        let world = pending.parent * local(place, warnings);
        if !world.is_finite() {
            return Err(document.error(at(), "the transform overflows"));
        }
        *seen = Some(world);
        let mesh = index(node.mesh);
        let mesh_name = mesh.and_then(|m| document.root.meshes.get(m)).and_then(|m| m.name.clone());
        let name = node.name.clone().filter(|n| !n.is_empty()).or(mesh_name).unwrap_or_else(|| format!("node {id}"));
        let (included, excluded) = (selection.includes(&name), selection.excludes(&name));
        let extensions = node.extensions.as_ref();
        let visible = extensions.and_then(|e| e.others.get("KHR_node_visibility")?.get("visible"));
        let below = PendingNode {
            node: id,
            depth: pending.depth + 1,
            parent: world,
            taken: pending.taken || included,
            left_out: pending.left_out || excluded || visible == Some(&Value::Bool(false)),
        };
        if let Some(mesh) = mesh.filter(|_| below.taken && !below.left_out) {
            self.meshes.push(Placed { node: Some(id), name: name.clone(), mesh, world });
        }
        if let Some(camera) = index(node.camera) {
            self.cameras.extend(light::camera(document, camera, &name, world, warnings)?);
        }
        if let Some(l) = extensions.and_then(|e| e.khr_lights_punctual.as_ref()) {
            self.lights.extend(light::light(document, l.light.value(), &name, world, warnings)?);
        }
        Ok(below)
    }

    /// Map from a node to the world. Nodes outside of the scene are placed by their own ancestors.
    pub fn world(&self, document: &Document, node: usize) -> Result<DAffine3> {
        let world = self.worlds.get(node).copied().flatten();
        world.ok_or_else(|| document.error(format!("nodes[{node}]"), "does not exist, or is its own ancestor"))
    }

    /// Compute the maps of nodes that the scene does not contain, since joints may be among them.
    fn place_others(&mut self, document: &Document, warnings: &mut Warnings) {
        let mut stack: Vec<(usize, DAffine3)> =
            tops(document).into_iter().map(|node| (node, DAffine3::IDENTITY)).collect();
        let mut visited = vec![false; self.worlds.len()];
        while let Some((id, parent)) = stack.pop() {
            let (Some(node), Some(place)) = (document.root.nodes.get(id), document.places.get(id)) else { continue };
            if std::mem::replace(&mut visited[id], true) {
                continue;
            }
            let world = *self.worlds[id].get_or_insert_with(|| parent * local(place, warnings));
            stack.extend(node.children.iter().flatten().map(|c| (c.value(), world)));
        }
    }
}

/// Nodes without a parent.
fn tops(document: &Document) -> Vec<usize> {
    let mut is_child = vec![false; document.root.nodes.len()];
    for child in document.root.nodes.iter().flat_map(|n| n.children.iter().flatten()) {
        if let Some(flag) = is_child.get_mut(child.value()) {
            *flag = true;
        }
    }
    (0..is_child.len()).filter(|&i| !is_child[i]).collect()
}

/// Name of the extension by which one node shows its mesh many times.
pub const INSTANCING: &str = "EXT_mesh_gpu_instancing";

/// The EXT_mesh_gpu_instancing of a node.
pub struct Instancing<'a> {
    document: &'a Document,
    name: &'a str,
    json: &'a Value,
}

impl<'a> Instancing<'a> {
    /// `None` where the node places its mesh once.
    pub fn of(document: &'a Document, placed: &'a Placed) -> Option<Self> {
        let extensions = placed.node.and_then(|n| document.root.nodes.get(n)).and_then(|n| n.extensions.as_ref());
        let json = extensions.and_then(|e| e.others.get(INSTANCING))?;
        Some(Instancing { document, name: &placed.name, json })
    }

    fn at(&self, name: &str) -> String {
        format!("{} instancing {name}", self.name)
    }

    /// An error about the attribute `name`.
    pub fn error(&self, name: &str, what: &str) -> Error {
        self.document.error(self.at(name), what)
    }

    /// Number of copies, from the lengths of the attributes that are there; `None` without any.
    pub fn count(&self, lengths: &[Option<usize>]) -> Result<Option<usize>> {
        let mut lengths = lengths.iter().flatten();
        let first = lengths.next().copied();
        if lengths.any(|&n| Some(n) != first) {
            return Err(self.error("attributes", "have different numbers of elements"));
        }
        Ok(first)
    }

    /// The attribute `name`, with `N` numbers per copy; three numbers of a colour are extended by an alpha of 1.
    pub fn floats<const N: usize>(&self, name: &str) -> Result<Option<Vec<[f32; N]>>> {
        let Some(index) = self.json.get("attributes").and_then(|a| a.get(name)) else { return Ok(None) };
        let accessor = index.as_u64().and_then(|v| usize::try_from(v).ok());
        let accessor = accessor.ok_or_else(|| self.error(name, "is not an accessor's index"))?;
        let least = if name == "_VTEX_TINT" { 3 } else { N };
        self.document.read_floats::<N>(accessor, least, [1.0; N], &self.at(name)).map(Some)
    }
}

/// Transforms of a placed mesh: one, or as many as EXT_mesh_gpu_instancing gives. `posed` is the transform of a skinned mesh, whose joints place
/// it.
pub fn instances(
    document: &Document,
    placed: &Placed,
    posed: Option<DAffine3>,
    warnings: &mut Warnings,
) -> Result<Vec<DAffine3>> {
    let world = posed.unwrap_or(placed.world);
    let Some(instancing) = Instancing::of(document, placed) else { return Ok(vec![world]) };
    let (translations, scales) = (instancing.floats::<3>("TRANSLATION")?, instancing.floats::<3>("SCALE")?);
    let rotations = instancing.floats::<4>("ROTATION")?;
    let lengths =
        [translations.as_ref().map(Vec::len), scales.as_ref().map(Vec::len), rotations.as_ref().map(Vec::len)];
    let Some(count) = instancing.count(&lengths)? else { return Ok(vec![world]) };
    document.charge((count as u64).saturating_mul(size_of::<DAffine3>() as u64), &instancing.at("attributes"))?;
    let wide = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    let mut out = Vec::with_capacity(count);
    for i in 0..count {
        let transform = world
            * DAffine3::from_scale_rotation_translation(
                scales.as_ref().map_or(DVec3::ONE, |s| wide(s[i])),
                rotations.as_ref().map_or(DQuat::IDENTITY, |r| rotation(r[i].map(f64::from), warnings)),
                translations.as_ref().map_or(DVec3::ZERO, |t| wide(t[i])),
            );
        if transform.is_finite() {
            out.push(transform);
        } else {
            warnings.add("an instance with a NaN or infinite transform is left out");
        }
    }
    Ok(out)
}
