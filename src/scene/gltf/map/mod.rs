//! Covers a plain glTF mesh with texels: the extension on its materials, and the attributes where they are asked for.

mod options;
mod plan;
mod shell;
mod surface;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::{Value, json};

use super::document::Document;
use super::write::{Editor, Saved, reference};
use super::{ReadOptions, extension, nodes, support};
pub use options::{Cells, Chart, Covered, Heights, MapOptions, Mapped};

use crate::geom::DVec3;
use crate::scene::select::Selection;
use crate::{Error, Result, Warnings};
use plan::{Plan, SurfacePlan};
use surface::{Surface, surfaces};

/// Cover `input` and write the landscape to `output` (`.gltf`, or `.glb` by its name). Everything else in the file stays.
///
/// # Errors
/// Where a file cannot be read or written, where a material is not there, where nothing can be covered, and where
/// options are out of range.
pub fn map(input: &Path, options: &MapOptions, output: &Path) -> Result<Mapped> {
    options::check(options)?;
    let read = ReadOptions::default();
    let document = Document::open(input, &read)?;
    support::check(&document)?;
    let mut mapped = Mapped::default();
    let mut warnings = Warnings::default();
    let chosen = chosen(&document, options)?;
    let mut selection = Selection::new(&[], &[]);
    let graph = nodes::walk(&document, &read, &mut selection, &mut Warnings::default())?;
    let set = if let Chart::Uv(set) = options.chart { set } else { 0 };
    let up = match options.heights {
        Heights::Auto => Some(DVec3::Y),
        Heights::Along(d) => d.try_normalize(),
        Heights::Normals => None,
    };
    let takes = |m: Option<usize>| options.materials.is_empty() || m.is_some_and(|m| chosen.contains(&m));
    let planar = matches!(options.chart, Chart::Planar(_));
    let mut surfaces = surfaces(&document, &graph.meshes, &takes, set, (up, planar), &mut warnings)?;
    if !surfaces.iter().any(|s| s.has_area()) {
        return Err(Error::input(input, "", "the chosen materials have no triangles in the scene to cover"));
    }
    surfaces.retain(Surface::has_area);
    let plan = Plan::new(options, &surfaces, false, &mut mapped.notes, &mut warnings)?;

    let mut editor = Editor::open(input, read.max_bytes)?;
    let mut saved = Saved::default();
    editor.settle(output, &mut saved)?;
    let texels = texels(&mut editor, input, options, output, &mut saved)?;
    let homes = if options.add { Vec::new() } else { separate(&surfaces, &mut editor)? };
    let mut of_material: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    let mut new_material = None;
    for (i, surface) in surfaces.iter().enumerate() {
        let material = match (surface.material, new_material) {
            (Some(m), _) | (None, Some(m)) => m,
            (None, None) => *new_material.insert(editor.push("materials", json!({"name": "shell"}))?),
        };
        of_material.entry(material).or_default().push(i);
    }
    say_kept(&plan, options, &mut mapped.notes);
    for (&index, members) in &of_material {
        let of = |&i: &usize| Some((surfaces.get(i)?, plan.surfaces.get(i)?));
        let members: Vec<(&Surface, &SurfacePlan)> = members.iter().filter_map(of).collect();
        let Some(own) = shell::MaterialPlan::new(options, &plan, &members) else { continue };
        let shell = shell::material(options, &plan, &own, &texels);
        let material = editor.json.pointer_mut(&format!("/materials/{index}"));
        let material = material.ok_or_else(|| document.error(format!("materials[{index}]"), "does not exist"))?;
        let name = material.get("name").and_then(Value::as_str).map_or(format!("material {index}"), str::to_owned);
        let extensions = Editor::object(input, material, "extensions")?;
        if options.add {
            shell::add(&plan, &own, &shell, &mut extensions[extension::NAME], &name, &mut warnings)?;
        } else {
            extensions[extension::NAME] = shell;
        }
        mapped.covered.extend(covered(&name, &plan, options, &members));
        for (k, &i) in of_material[&index].iter().enumerate().filter(|_| !options.add) {
            let mesh = homes.get(i).copied().unwrap_or(members[k].0.mesh);
            shell::attributes(options, &plan, &own, members[k], (mesh, index), &mut editor)?;
        }
    }
    editor.use_extension(extension::NAME)?;
    editor.save(output)?;
    saved.warnings.merge(warnings);
    mapped.saved = saved;
    Ok(mapped)
}

/// Indices of the materials that were asked for.
fn chosen(document: &Document, options: &MapOptions) -> Result<BTreeSet<usize>> {
    let root = &document.root;
    let name = |i: usize| root.materials.get(i).and_then(|m| m.name.as_deref());
    let mut chosen = BTreeSet::new();
    for wanted in &options.materials {
        let before = chosen.len();
        chosen.extend((0..root.materials.len()).filter(|&i| name(i) == Some(wanted)));
        if chosen.len() == before {
            let index = wanted.parse().ok().filter(|&i: &usize| i < root.materials.len());
            chosen.insert(index.ok_or_else(|| {
                let names: Vec<_> = (0..root.materials.len()).map(|i| name(i).unwrap_or("(unnamed)")).collect();
                Error::Options(format!("no material is named {wanted}; the file has: {}", names.join(", ")))
            })?);
        }
    }
    Ok(chosen)
}

/// The mesh that each surface's attributes go to: nodes that show a mesh in another size, or tilted, get a copy of it, which
/// shares everything but what a mapping writes.
fn separate(surfaces: &[Surface], editor: &mut Editor) -> Result<Vec<usize>> {
    let mut homes = Vec::with_capacity(surfaces.len());
    // By the mesh and the first node: the primitives of one mesh stay together.
    let mut copies: BTreeMap<(usize, Option<usize>), usize> = BTreeMap::new();
    let mut taken = BTreeSet::new();
    for surface in surfaces {
        let key = (surface.mesh, surface.nodes.first().copied());
        if let Some(&known) = copies.get(&key) {
            homes.push(known);
            continue;
        }
        let mut home = surface.mesh;
        if !taken.insert(surface.mesh)
            && let Some(mesh) = editor.json.pointer(&format!("/meshes/{}", surface.mesh)).cloned()
        {
            home = editor.push("meshes", mesh)?;
            for node in &surface.nodes {
                if let Some(node) = editor.json.pointer_mut(&format!("/nodes/{node}")) {
                    node["mesh"] = json!(home);
                }
            }
        }
        copies.insert(key, home);
        homes.push(home);
    }
    Ok(homes)
}

/// A word about attributes that stay.
fn say_kept(plan: &Plan, options: &MapOptions, notes: &mut Vec<String>) {
    if options.add {
        return;
    }
    let any = |keeps: fn(&SurfacePlan) -> bool| plan.surfaces.iter().any(keeps);
    let (uvw, heights) = (any(|s| s.keeps_uvw), any(|s| s.keeps_heights));
    let names = [(uvw, "_VTEX_UVW"), (heights, "_VTEX_HEIGHT"), (uvw || heights, "_VTEX_DW")];
    if uvw || heights {
        let names: Vec<&str> = names.into_iter().filter(|n| n.0).map(|n| n.1).collect();
        let turned = if options.z_up { ", the heights turned from Z up to Y up" } else { "" };
        notes.push(format!("kept the file's own {}{turned} (--replace makes new ones)", names.join(", ")));
    }
}

/// What to say of one material: a line for each size of copies.
fn covered(name: &str, plan: &Plan, options: &MapOptions, members: &[(&Surface, &SurfacePlan)]) -> Vec<Covered> {
    let mut all: Vec<Covered> = Vec::new();
    let content = options.texels.iter().map(|(_, info)| info.content.max.z).fold(0.0, f64::max);
    for (_, planned) in members {
        let [u, v] = planned.cell;
        let copies = planned.area / (u * v) * options.presence;
        // The shell may be higher than what stands in it.
        let height = planned.thickness * (content / plan.dw).min(1.0);
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-3 * a.abs().max(b.abs());
        match all.iter_mut().find(|c| near(c.cell[0], u) && near(c.cell[1], v) && near(c.height, height)) {
            Some(known) => known.copies += copies,
            None => all.push(Covered { material: name.to_owned(), cell: [u, v], height, copies }),
        }
    }
    all
}

/// Name the texels in the root's extension; their indices there.
fn texels(
    editor: &mut Editor,
    input: &Path,
    options: &MapOptions,
    output: &Path,
    saved: &mut Saved,
) -> Result<Vec<usize>> {
    let extensions = Editor::object(input, &mut editor.json, "extensions")?;
    let root = Editor::object(input, extensions, extension::NAME)?;
    let list = root.as_object_mut().map(|root| root.entry("texels").or_insert_with(|| json!([])));
    let list = list.and_then(Value::as_array_mut);
    let list = list.ok_or_else(|| Error::input(input, format!("{}.texels", extension::NAME), "is not an array"))?;
    let mut indices = Vec::new();
    for (k, (path, _)) in options.texels.iter().enumerate() {
        let frames = json!([{"uri": reference(path, output, saved)?}]);
        let known = list.iter().position(|t| t.get("frames") == Some(&frames));
        let index = known.unwrap_or_else(|| {
            let name = path.file_stem().map(|s| s.to_string_lossy().into_owned());
            list.push(json!({"name": name.unwrap_or_default(), "frames": frames}));
            list.len() - 1
        });
        if let (Some(geometry), Some(texel)) = (options.geometries.get(k), list[index].as_object_mut()) {
            texel.insert("geometry".into(), json!({"uri": reference(geometry, output, saved)?}));
        }
        indices.push(index);
    }
    Ok(indices)
}
