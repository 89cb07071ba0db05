//! Covers a plain glTF mesh with texels: rigid copies of isolated objects, shells of what is continuous.

mod borders;
mod copies;
mod heightfield;
mod made;
mod motion;
mod objmesh;
mod options;
mod place;
mod plan;
mod points;
mod quads;
mod scatter;
mod shell;
mod sieve;
mod surface;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::document::Document;
use super::write::{Editor, Saved, reference};
use super::{ReadOptions, extension, nodes, support};
pub use motion::Motion;
pub use options::{
    Arrangement, Cells, Chart, Covered, Heights, MapOptions, Mapped, MaskOver, PointsTable, PointsUp, Scales,
};

use crate::geom::DVec3;
use crate::scene::select::Selection;
use crate::volume::Info;
use crate::{Error, Result, Warnings};
use plan::{Plan, SurfacePlan};
use surface::{Surface, surfaces};

/// Cover `input` and write the landscape to `output` (`.gltf`, or `.glb` by its name). Everything else in the file stays. An
/// `.obj` and a picture of heights (`.png`, `.tif`, `.tiff`) are grounds, too.
///
/// # Errors
/// Where a file cannot be read or written, where a material is not there, where nothing can be covered, and where
/// options are out of range.
pub fn map(input: &Path, options: &MapOptions, output: &Path) -> Result<Mapped> {
    if heightfield::is_picture(input) {
        let mut notes = Vec::new();
        let ground = heightfield::make(input, options.ground, &mut notes)?;
        let mut mapped = map_mesh(&ground.path, options, output)?;
        mapped.notes.splice(0..0, notes);
        return Ok(mapped);
    }
    if options.ground != Scales::default() {
        return Err(Error::Options(
            "option `pixel` and option `relief` are for a ground that is a picture of heights".into(),
        ));
    }
    if crate::scene::files::extension(input) == "obj" {
        let (made, warnings) = objmesh::make(input, options.patches)?;
        let mut mapped = map_mesh(&made.path, options, output)?;
        mapped.saved.warnings.merge(warnings);
        return Ok(mapped);
    }
    map_mesh(input, options, output)
}

fn map_mesh(input: &Path, options: &MapOptions, output: &Path) -> Result<Mapped> {
    let cyclic = |(_, info): &(PathBuf, Info)| info.cyclic[0] || info.cyclic[1];
    let continuous = options.texels.iter().filter(|t| cyclic(t)).count();
    if continuous > 0 && continuous < options.texels.len() && !options.bend {
        let what = "cyclic texels fill shells and others stand as rigid copies: map them one by one (option `add`), or bend \
                    all (option `bend`)";
        return Err(Error::Options(what.into()));
    }
    let mut rigid = continuous == 0 && !options.bend;
    options::check(options, rigid)?;
    let read = ReadOptions { contained: true, ..ReadOptions::default() };
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
    // What stands in for a texel is no ground.
    let stand_ins = super::copies::stand_ins(&document);
    let takes = |m: Option<usize>| {
        let stands = m.and_then(|m| stand_ins.get(m)).is_some_and(|stands| *stands);
        !stands && (options.materials.is_empty() || m.is_some_and(|m| chosen.contains(&m)))
    };
    let planar = matches!(options.chart, Chart::Planar(_));
    let mut surfaces = surfaces(&document, &graph.meshes, &takes, set, (up, planar), &mut warnings)?;
    if !surfaces.iter().any(|s| s.has_area()) {
        return Err(Error::input(input, "", "the chosen materials have no triangles in the scene to cover"));
    }
    surfaces.retain(Surface::has_area);
    // A file's own vectors are made for shells.
    let own = |s: &Surface| {
        let geometry = &s.geometry;
        (geometry.uvw.is_some() && geometry.is_authored("_VTEX_UVW"))
            || (geometry.heights.is_some() && geometry.is_authored("_VTEX_HEIGHT"))
    };
    if rigid && !options.replace && !options.add && surfaces.iter().any(own) {
        rigid = false;
        options::check(options, rigid)?;
    }
    let plan = Plan::new(options, &surfaces, rigid, &mut mapped.notes, &mut warnings)?;

    let mut editor = Editor::open(input, read.max_bytes)?;
    let mut saved = Saved::default();
    editor.settle(output, &mut saved)?;
    let texels = texels(&mut editor, input, options, output, &mut saved)?;
    let all: Vec<&Surface> = surfaces.iter().collect();
    if !options.add {
        copies::remove(&all, &mut editor, &mut warnings);
    }
    if rigid {
        if !options.add {
            remove_shells(&document, &surfaces, &mut editor, &mut warnings);
        }
        let said = (&mut mapped.notes, &mut warnings);
        let one = options.points.is_some();
        for (cell, members) in by_cell(&plan, &surfaces, one) {
            let of = (&plan, &members[..], cell);
            let said = (&mut *said.0, &mut *said.1);
            mapped.covered.extend(place::place((&document, &graph), options, of, &texels, &mut editor, said)?);
        }
        motion::write(&mut editor.json, &options.motion, &texels);
        editor.save(output, &saved)?;
        saved.warnings.merge(warnings);
        mapped.saved = saved;
        return Ok(mapped);
    }
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
        // Among rigid copies, the first shell has nothing to be added to.
        let has_shell = extensions.get(extension::NAME).is_some_and(|e| e.get("layers").is_some());
        let fresh = !options.add || (!has_shell && copies::stand(&document, &graph, &all));
        if !fresh {
            shell::add(&plan, &own, &shell, &mut extensions[extension::NAME], &name, &mut warnings)?;
        } else {
            extensions[extension::NAME] = shell;
        }
        borders::say(options, &plan, &members, &name, &mut warnings);
        mapped.covered.extend(covered(&name, &plan, options, &members));
        for (k, &i) in of_material[&index].iter().enumerate().filter(|_| fresh) {
            let mesh = homes.get(i).copied().unwrap_or(members[k].0.mesh);
            shell::attributes(options, &plan, &own, members[k], (mesh, index), &mut editor)?;
            quads::write(options.patches, members[k].0, mesh, &mut editor)?;
        }
    }
    editor.use_extension(extension::NAME)?;
    if !options.patches {
        quads::forget_polygons(&mut editor);
    }
    motion::write(&mut editor.json, &options.motion, &texels);
    editor.save(output, &saved)?;
    saved.warnings.merge(warnings);
    mapped.saved = saved;
    Ok(mapped)
}

/// Surfaces with cells of one width together, or all.
fn by_cell<'a>(plan: &Plan, surfaces: &'a [Surface], all: bool) -> Vec<([f64; 2], Vec<&'a Surface>)> {
    let mut groups: Vec<([f64; 2], Vec<&Surface>)> = Vec::new();
    for (planned, surface) in plan.surfaces.iter().zip(surfaces) {
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-6 * a.abs().max(b.abs());
        let cell = planned.cell;
        match groups.iter_mut().find(|g| all || (near(g.0[0], cell[0]) && near(g.0[1], cell[1]))) {
            Some(group) => group.1.push(surface),
            None => groups.push((cell, vec![surface])),
        }
    }
    groups
}

/// Take away the shells that an earlier mapping gave the surfaces' materials.
fn remove_shells(document: &Document, surfaces: &[Surface], editor: &mut Editor, warnings: &mut Warnings) {
    for surface in surfaces {
        shell::strip(surface, editor);
    }
    let materials: BTreeSet<usize> = surfaces.iter().filter_map(|s| s.material).collect();
    for index in materials {
        let at = format!("/materials/{index}");
        let Some(material) = editor.json.pointer_mut(&at).and_then(Value::as_object_mut) else { continue };
        let Some(extensions) = material.get_mut("extensions").and_then(Value::as_object_mut) else { continue };
        if extensions.shift_remove(extension::NAME).is_none() {
            continue;
        }
        if extensions.is_empty() {
            material.shift_remove("extensions");
        }
        let name = document.root.materials.get(index).and_then(|m| m.name.clone());
        let name = name.unwrap_or_else(|| format!("material {index}"));
        warnings.add(format!("{name}: its shell of an earlier mapping is replaced (option `add` keeps it)"));
    }
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
        notes.push(format!("kept the file's own {}{turned} (option `replace` makes new ones)", names.join(", ")));
    }
}

/// What to say of one material: a line for each size of copies.
fn covered(name: &str, plan: &Plan, options: &MapOptions, members: &[(&Surface, &SurfacePlan)]) -> Vec<Covered> {
    let mut all: Vec<Covered> = Vec::new();
    let content = options.texels.iter().map(|(_, info)| info.content.max.z).fold(0.0, f64::max);
    for (_, planned) in members {
        let [u, v] = planned.cell;
        // The file's own coordinates may cover no area.
        let copies = if u * v > 0.0 { planned.area / (u * v) * options.presence } else { 0.0 };
        // The shell may be higher than what stands in it.
        let height = planned.thickness * (content / plan.dw).min(1.0);
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-3 * a.abs().max(b.abs());
        match all.iter_mut().find(|c| near(c.cell[0], u) && near(c.cell[1], v) && near(c.height, height)) {
            Some(known) => known.copies += copies,
            None => {
                let material = name.to_owned();
                all.push(Covered { material, texel: None, cell: [u, v], height, copies });
            }
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
        let frames = motion::frames(&options.motion, k, path, output, saved)?;
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
