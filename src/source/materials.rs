//! Names and ids of materials: those of a model, and those of several sources that are combined.

use super::traits::Source;
use crate::scene::{Model, Part};
use crate::volume::Mix;
use crate::volume::surface::SurfaceMeans;

/// Name of materials without a name, where others have one.
pub const UNNAMED: &str = "unnamed";

/// Names of the materials of several sources, each once, and for each source a map from its own ids to those of the result. The list
/// of names is empty where no source names any.
pub fn unite<'s>(sources: impl IntoIterator<Item = &'s dyn Source>) -> (Vec<String>, Vec<Vec<u16>>) {
    let sources: Vec<&dyn Source> = sources.into_iter().collect();
    let (mut names, mut maps) = (Vec::new(), Vec::with_capacity(sources.len()));
    if sources.iter().all(|s| s.materials().is_empty()) {
        return (names, vec![vec![0]; sources.len()]);
    }
    let mut known = std::collections::BTreeMap::new();
    let mut id = |name: &str| {
        *known.entry(name.to_owned()).or_insert_with(|| {
            names.push(name.to_owned());
            (names.len() - 1).min(u16::MAX.into()) as u16
        })
    };
    for source in sources {
        let own = source.materials();
        maps.push(if own.is_empty() { vec![id(UNNAMED)] } else { own.iter().map(|n| id(n)).collect() });
    }
    (names, maps)
}

/// Surfaces of the `materials` of several combined sources, each given with its map of ids from [`unite`]; empty where all are plain.
/// Where several sources have a material of the same name, the plain mean of theirs is taken.
pub fn unite_surfaces<'s>(
    sources: impl IntoIterator<Item = (&'s dyn Source, &'s Vec<u16>)>,
    materials: usize,
) -> Vec<SurfaceMeans> {
    let mut all = vec![Vec::new(); materials.max(1)];
    let mut plain = true;
    for (source, ids) in sources {
        let own = source.surfaces();
        plain &= own.is_empty();
        for (k, id) in ids.iter().enumerate() {
            if let Some(list) = all.get_mut(usize::from(*id)) {
                list.push(own.get(k).copied().unwrap_or_default());
            }
        }
    }
    if plain { Vec::new() } else { all.iter().map(|of| SurfaceMeans::mean(of)).collect() }
}

/// Names of the materials of those parts of a model that are `wanted` and have instances, each once, and for each of the model's
/// materials the id of its name. The list of names is empty where none of them has a name.
pub fn of_model(model: &Model, wanted: impl Fn(&Part) -> bool) -> (Vec<String>, Vec<u16>) {
    let mut used = vec![false; model.materials.len()];
    for part in model.instances.iter().map(|i| &model.parts[i.part]).filter(|p| wanted(p)) {
        used[part.material] = true;
    }
    let (mut names, mut ids) = (Vec::new(), vec![0; used.len()]);
    for ((material, id), _) in model.materials.iter().zip(&mut ids).zip(used).filter(|(_, used)| *used) {
        let name = if material.name.is_empty() { UNNAMED } else { &material.name };
        let known = names.iter().position(|n| n == name).unwrap_or_else(|| {
            names.push(name.to_owned());
            names.len() - 1
        });
        *id = known.min(u16::MAX.into()) as u16;
    }
    if names == [UNNAMED] {
        names.clear();
    }
    (names, ids)
}

/// `mix` with every id replaced by the one that `map` has for it.
pub fn renamed(mix: &Mix, map: &[u16]) -> Mix {
    mix.renamed(|id| map.get(usize::from(id)).map_or(0, |&id| id.min(254) as u8))
}
