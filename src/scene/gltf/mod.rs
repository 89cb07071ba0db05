//! glTF 2.0 files (`.gltf`, `.glb`) → [`Scene`]: the one place that knows the format.

mod accessor;
mod attributes;
mod chart;
mod document;
mod extension;
mod filters;
mod light;
pub mod map;
mod material;
mod meshopt;
mod nodes;
mod primitive;
mod skin;
mod support;
#[cfg(test)]
mod tests;
mod write;

use std::path::Path;

use super::select::Selection;
use super::{Instance, Model, Scene};
use crate::{Error, Result, Warnings};
use document::Document;
pub use document::{is_landscape, named_files};

pub use super::ReadOptions;

/// Read the chosen scene of a file.
///
/// # Errors
/// [`Error::Io`] where a file cannot be read, [`Error::Input`] where it breaks glTF's rules or holds nothing that is
/// drawn, [`Error::Unsupported`] where it requires an extension that is not read, [`Error::Limit`] beyond the limits,
/// [`Error::Options`] where the scene or a node that was asked for is not there.
pub fn read(path: &Path, options: &ReadOptions) -> Result<Scene> {
    let document = Document::open(path, options)?;
    support::check(&document)?;
    let mut warnings = Warnings::default();
    let mut selection = Selection::new(&options.include, &options.exclude);
    let graph = nodes::walk(&document, options, &mut selection, &mut warnings)?;
    let mut parts = primitive::Parts::new(&document);
    let mut instances: Vec<Instance> = Vec::new();
    for placed in &graph.meshes {
        let ids = parts.of_node(&document, &graph, placed, &mut warnings)?;
        let transforms = nodes::instances(&document, placed, ids.relative_to, &mut warnings)?;
        if transforms.len().saturating_mul(ids.parts.len()) > options.max_instances - instances.len() {
            return Err(Error::Limit {
                what: format!("{}: placing meshes", path.display()),
                needed: (transforms.len() as u64).saturating_mul(ids.parts.len() as u64),
                allowed: options.max_instances as u64,
            });
        }
        for transform in transforms {
            let place = |&part| Instance { part, transform, node: placed.name.clone() };
            instances.extend(ids.parts.iter().map(place));
        }
    }
    selection.finish("node")?;
    if instances.is_empty() {
        let why = warnings.as_reasons();
        return Err(Error::input(path, "", format!("nothing is drawn: no node of the scene shows a mesh{why}")));
    }
    let root = extension::root(&document, &mut warnings)?;
    let mut texels = extension::Texels::new(root.texels);
    let materials = material::read(&document, options, &mut parts.list, &mut texels, &mut warnings)?;
    let model = Model {
        parts: parts.list,
        materials,
        instances,
        cameras: graph.cameras,
        lights: graph.lights,
        metres_per_unit: 1.0,
        warnings,
    };
    Ok(Scene { model, texels: texels.all, environment: root.environment })
}
