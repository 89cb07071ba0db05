//! Conversion of mesh primitives to [`Part`]s, each once for all nodes that show it with the same skin and morph weights.

use std::collections::BTreeMap;

use super::attributes::Reader;
use super::document::{Document, index};
use super::nodes::{Graph, Placed};
use super::skin;
use crate::geom::DAffine3;
use crate::scene::model::Part;
use crate::{Result, Warnings};

/// The parts that were read so far.
pub struct Parts {
    pub list: Vec<Part>,
    made: BTreeMap<(usize, Option<usize>, Vec<u32>), MeshParts>,
    /// Index of the material that parts without one get.
    default_material: usize,
}

/// The parts of a mesh as a node shows it.
#[derive(Debug, Clone, Default)]
pub struct MeshParts {
    pub parts: Vec<usize>,
    /// Map from the part to the world, where a skin determines it instead of the node.
    pub relative_to: Option<DAffine3>,
}

impl Parts {
    pub fn new(document: &Document) -> Self {
        Parts { list: Vec::new(), made: BTreeMap::new(), default_material: document.root.materials.len() }
    }

    /// The parts that a placed mesh shows; primitives without anything to draw are left out.
    pub fn of_node(
        &mut self,
        document: &Document,
        graph: &Graph,
        placed: &Placed,
        warnings: &mut Warnings,
    ) -> Result<MeshParts> {
        let at = format!("meshes[{}]", placed.mesh);
        let mesh = document.root.meshes.get(placed.mesh).ok_or_else(|| document.error(&*at, "does not exist"))?;
        let node = placed.node.and_then(|n| document.root.nodes.get(n));
        let weights = node.and_then(|n| n.weights.as_ref()).or(mesh.weights.as_ref()).map_or(&[][..], Vec::as_slice);
        let skin = node.and_then(|n| index(n.skin));
        let key = (placed.mesh, skin, weights.iter().map(|w| w.to_bits()).collect());
        if let Some(made) = self.made.get(&key) {
            return Ok(made.clone());
        }
        let skeleton = match skin {
            Some(skin) => Some(skin::Skeleton::read(document, graph, skin, placed)?),
            None => None,
        };
        let mut made = MeshParts { parts: Vec::new(), relative_to: skeleton.as_ref().map(|s| s.origin) };
        for (i, primitive) in mesh.primitives.iter().enumerate() {
            let at = format!("{at}.primitives[{i}]");
            let targets = document.targets.get(placed.mesh).and_then(|m| m.get(i)).map_or(&[][..], Vec::as_slice);
            let reader = Reader { document, primitive, targets, weights, at };
            let Some(mut part) = reader.attributes(warnings)? else { continue };
            part.name = mesh.name.clone().unwrap_or_else(|| format!("mesh {}", placed.mesh));
            part.material = index(primitive.material).unwrap_or(self.default_material);
            if let Some(skeleton) = &skeleton {
                skeleton.pose(&reader, &mut part, warnings)?;
            }
            reader.topology(&mut part, warnings)?;
            if part.triangles.is_empty() && part.lines.is_empty() && part.points.is_empty() {
                warnings.add("a primitive without anything to draw is left out");
                continue;
            }
            made.parts.push(self.list.len());
            self.list.push(part);
        }
        self.made.insert(key, made.clone());
        Ok(made)
    }
}
