//! glTF 2.0 files (`.gltf`, `.glb`) → [`Scene`]: the one place that knows the format.

mod accessor;
mod animation;
mod animation_json;
mod attributes;
mod copies;
mod document;
mod emission;
mod extension;
mod filters;
mod light;
#[cfg(feature = "bake")]
pub mod map;
mod material;
mod meshopt;
mod nodes;
mod patches;
mod primitive;
#[cfg(feature = "bake")]
pub mod save;
mod skin;
mod support;
#[cfg(test)]
mod tests;
mod transmission;
#[cfg(feature = "bake")]
mod write;

use std::path::Path;

use super::select::Selection;
use super::{Instance, Model, Part, Scene};
use crate::{Error, Result, Warnings};
pub use animation::{Timeline, timeline};
use document::Document;
pub use document::{is_landscape, named_files};

pub use super::ReadOptions;

/// Read the chosen scene of a file.
///
/// # Errors
/// [`Error::Io`] where a file cannot be read, [`Error::Input`] where it breaks glTF's rules or holds nothing that is
/// drawn, [`Error::Unsupported`] where it requires an extension that is not read, [`Error::Limit`] beyond the limits,
/// [`Error::Options`] where the scene, a node or an animation that was asked for is not there.
pub fn read(path: &Path, options: &ReadOptions) -> Result<Scene> {
    let mut document = Document::open(path, options)?;
    support::check(&document)?;
    let mut warnings = Warnings::default();
    animation::pose(&mut document, options, &mut warnings)?;
    let mut selection = Selection::new(&options.include, &options.exclude);
    let graph = nodes::walk(&document, options, &mut selection, &mut warnings)?;
    let Shown { mut parts, instances, stand_ins } = Shown::of(&document, &graph, options, &mut warnings)?;
    selection.finish("node")?;
    if instances.is_empty() && stand_ins.is_empty() {
        let why = warnings.as_reasons();
        return Err(Error::input(path, "", format!("nothing is drawn: no node of the scene shows a mesh{why}")));
    }
    let root = extension::root(&document, &mut warnings)?;
    let mut texels = extension::TexelTable::new(root.texels, options.time.unwrap_or(0.0), root.wind);
    let materials = material::read(&document, options, &mut parts, &mut texels, &mut warnings)?;
    let mut sets = Vec::with_capacity(stand_ins.len());
    let mut left = options.max_instances - instances.len();
    for (placed, material) in stand_ins {
        let set = copies::read(&document, placed, material, &mut texels, &mut warnings)?;
        let (what, needed) = (format!("{}: placing copies", path.display()), set.len() as u64);
        let rest = left.checked_sub(set.len());
        left = rest.ok_or(Error::Limit { what, needed, allowed: left as u64 })?;
        sets.push(set);
    }
    let model = Model {
        parts,
        materials,
        instances,
        cameras: graph.cameras,
        lights: graph.lights,
        metres_per_unit: 1.0,
        warnings,
    };
    Ok(Scene { model, texels: texels.all, copies: sets, environment: root.environment })
}

/// What the nodes of a scene show.
struct Shown<'a> {
    parts: Vec<Part>,
    instances: Vec<Instance>,
    /// Meshes that stand in for copies of texels, with their materials. They are not drawn themselves.
    stand_ins: Vec<(&'a nodes::Placed, usize)>,
}

impl<'a> Shown<'a> {
    fn of(
        document: &Document,
        graph: &'a nodes::Graph,
        options: &ReadOptions,
        warnings: &mut Warnings,
    ) -> Result<Shown<'a>> {
        let mut parts = primitive::Parts::new(document);
        let mut instances: Vec<Instance> = Vec::new();
        let mut stand_ins: Vec<(&nodes::Placed, usize)> = Vec::new();
        let stands = copies::stand_ins(document);
        for placed in &graph.meshes {
            let mut ids = parts.of_node(document, graph, placed, warnings)?;
            ids.parts.retain(|&part| {
                let material = parts.list.get(part).map_or(usize::MAX, |p| p.material);
                let stands = stands.get(material).copied().unwrap_or(false);
                let again = |&(p, m): &(&nodes::Placed, usize)| std::ptr::eq(p, placed) && m == material;
                if stands && !stand_ins.last().is_some_and(again) {
                    stand_ins.push((placed, material));
                }
                !stands
            });
            if ids.parts.is_empty() {
                continue;
            }
            let transforms = nodes::instances(document, placed, ids.relative_to, warnings)?;
            if transforms.len().saturating_mul(ids.parts.len()) > options.max_instances - instances.len() {
                return Err(Error::Limit {
                    what: format!("{}: placing meshes", document.path.display()),
                    needed: (transforms.len() as u64).saturating_mul(ids.parts.len() as u64),
                    allowed: options.max_instances as u64,
                });
            }
            for transform in transforms {
                let place = |&part| Instance { part, transform, node: placed.name.clone() };
                instances.extend(ids.parts.iter().map(place));
            }
        }
        Ok(Shown { parts: parts.list, instances, stand_ins })
    }
}
