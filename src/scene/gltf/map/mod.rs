//! Covers a plain glTF mesh with texels: rigid copies of isolated objects, shells of what is continuous.

mod copies;
mod cut_copies;
mod density;
mod heightfield;
mod motion;
mod objmesh;
mod options;
mod place;
mod plan;
mod points;
mod quads;
mod scatter;
mod shell;
mod surface;
mod temp_glb;

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
use surface::{Surface, SurfaceQuery, surfaces};

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
        let (ground, warnings) = objmesh::make(input, options.patches)?;
        let mut mapped = map_mesh(&ground.path, options, output)?;
        mapped.saved.warnings.merge(warnings);
        return Ok(mapped);
    }
    map_mesh(input, options, output)
}

/// Cover a glTF mesh.
fn map_mesh(input: &Path, options: &MapOptions, output: &Path) -> Result<Mapped> {
    let mut rigid = takes_rigid_copies(options)?;
    options::check(options, rigid)?;
    let read = ReadOptions { contained: true, ..ReadOptions::default() };
    let document = Document::open(input, &read)?;
    support::check(&document)?;
    let mut warnings = Warnings::default();
    let chosen = chosen(&document, options)?;
    let mut selection = Selection::new(&[], &[]);
    let graph = nodes::walk(&document, &read, &mut selection, &mut Warnings::default())?;
    let surfaces = covered_surfaces(&document, &graph, options, &chosen, &mut warnings)?;
    // A file that brings its own _VTEX_ attributes is meant for shells.
    if rigid && !options.replace && !options.add && surfaces.iter().any(has_authored_attributes) {
        rigid = false;
        options::check(options, rigid)?;
    }
    let mut mapped = Mapped::default();
    let plan = Plan::new(options, &surfaces, rigid, &mut mapped.notes, &mut warnings)?;
    let mut editor = Editor::open(input, read.max_bytes)?;
    let mut saved = Saved::default();
    editor.relocate_references(output, &mut saved)?;
    let texels = texels(&mut editor, input, options, output, &mut saved)?;
    let mesh =
        CoveredMesh { input, document: &document, graph: &graph, options, surfaces: &surfaces, plan: &plan, texels };
    if !options.add {
        copies::remove(&mesh.all_surfaces(), &mut editor, &mut warnings);
    }
    if rigid {
        mesh.place_copies(&mut editor, &mut mapped, &mut warnings)?;
    } else {
        mesh.write_shells(&mut editor, &mut mapped, &mut warnings)?;
    }
    motion::write(&mut editor.json, &options.motion, &mesh.texels);
    editor.save(output, &saved)?;
    saved.warnings.merge(warnings);
    mapped.saved = saved;
    Ok(mapped)
}

/// Whether the texels are placed as rigid copies: isolated objects are, unless option `bend` is set, and cyclic texels are not.
///
/// # Errors
/// `Options` where there are texels of both kinds.
fn takes_rigid_copies(options: &MapOptions) -> Result<bool> {
    let cyclic = |(_, info): &&(PathBuf, Info)| info.cyclic[0] || info.cyclic[1];
    let continuous = options.texels.iter().filter(cyclic).count();
    if continuous > 0 && continuous < options.texels.len() && !options.bend {
        let what = "cyclic texels fill shells and others stand as rigid copies: map them one by one (option `add`), or bend \
                    all (option `bend`)";
        return Err(Error::Options(what.into()));
    }
    Ok(continuous == 0 && !options.bend)
}

/// The surfaces of the `chosen` materials (of all, if the options name none) that have an area.
///
/// # Errors
/// `Input` where there is no such surface; as reading the file.
fn covered_surfaces(
    document: &Document,
    graph: &nodes::Graph,
    options: &MapOptions,
    chosen: &BTreeSet<usize>,
    warnings: &mut Warnings,
) -> Result<Vec<Surface>> {
    let set = if let Chart::Uv(set) = options.chart { set } else { 0 };
    let up = match options.heights {
        Heights::Auto => Some(DVec3::Y),
        Heights::Along(d) => d.try_normalize(),
        Heights::Normals => None,
    };
    // The stand-in mesh of a rigid copy is not covered.
    let stand_ins = super::copies::stand_ins(document);
    let takes = |m: Option<usize>| {
        let stands = m.and_then(|m| stand_ins.get(m)).is_some_and(|stands| *stands);
        !stands && (options.materials.is_empty() || m.is_some_and(|m| chosen.contains(&m)))
    };
    let planar = matches!(options.chart, Chart::Planar(_));
    let query = SurfaceQuery { takes: &takes, set, up, planar };
    let mut surfaces = surfaces(document, &graph.meshes, &query, warnings)?;
    surfaces.retain(Surface::has_area);
    if surfaces.is_empty() {
        return Err(Error::input(&document.path, "", "the chosen materials have no triangles in the scene to cover"));
    }
    Ok(surfaces)
}

/// Whether the file's author gave a surface attributes of a shell.
fn has_authored_attributes(surface: &Surface) -> bool {
    let geometry = &surface.geometry;
    (geometry.uvw.is_some() && geometry.is_authored("_VTEX_UVW"))
        || (geometry.heights.is_some() && geometry.is_authored("_VTEX_HEIGHT"))
}

/// A mesh that is covered, and the decisions about that.
struct CoveredMesh<'a> {
    input: &'a Path,
    document: &'a Document,
    graph: &'a nodes::Graph,
    options: &'a MapOptions,
    surfaces: &'a [Surface],
    plan: &'a Plan,
    /// Indices of the texels in the list of the root's extension.
    texels: Vec<usize>,
}

impl CoveredMesh<'_> {
    fn all_surfaces(&self) -> Vec<&Surface> {
        self.surfaces.iter().collect()
    }

    /// Place rigid copies on all surfaces.
    fn place_copies(&self, editor: &mut Editor, mapped: &mut Mapped, warnings: &mut Warnings) -> Result<()> {
        let CoveredMesh { document, graph, options, plan, texels, .. } = self;
        if !options.add {
            remove_shells(document, self.surfaces, editor, warnings);
        }
        for (cell, surfaces) in by_cell(plan, self.surfaces, options.points.is_some()) {
            let ground = place::Ground { document, graph, plan, surfaces: &surfaces, cell };
            mapped.covered.extend(place::place(&ground, options, texels, editor, &mut mapped.notes, warnings)?);
        }
        Ok(())
    }

    /// Give the materials of all surfaces shells, and the primitives the attributes that these need.
    fn write_shells(&self, editor: &mut Editor, mapped: &mut Mapped, warnings: &mut Warnings) -> Result<()> {
        let CoveredMesh { document, graph, options, surfaces, plan, texels, .. } = self;
        let homes = if options.add { Vec::new() } else { separate(surfaces, editor)? };
        note_kept_attributes(plan, options, &mut mapped.notes);
        for (&index, numbers) in &by_material(surfaces, editor)? {
            let of = |&i: &usize| Some((surfaces.get(i)?, plan.surfaces.get(i)?));
            let members: Vec<(&Surface, &SurfacePlan)> = numbers.iter().filter_map(of).collect();
            let Some(own) = shell::MaterialPlan::new(options, plan, &members) else { continue };
            let shell = own.material(texels);
            let material = editor.json.pointer_mut(&format!("/materials/{index}"));
            let material = material.ok_or_else(|| document.error(format!("materials[{index}]"), "does not exist"))?;
            let name = material.get("name").and_then(Value::as_str).map_or(format!("material {index}"), str::to_owned);
            let extensions = Editor::object(self.input, material, "extensions")?;
            // With option `add` on rigid copies, there is no shell yet to which the layer could be added.
            let has_shell = extensions.get(extension::NAME).is_some_and(|e| e.get("layers").is_some());
            let fresh = !options.add || (!has_shell && copies::has_copies(document, graph, &self.all_surfaces()));
            if !fresh {
                own.add(&shell, &mut extensions[extension::NAME], &name, warnings)?;
            } else {
                extensions[extension::NAME] = shell;
            }
            cut_copies::warn(options, plan, &members, &name, warnings);
            mapped.covered.extend(covered(&name, plan, options, &members));
            for (k, &i) in numbers.iter().enumerate().filter(|_| fresh) {
                let mesh = homes.get(i).copied().unwrap_or(members[k].0.mesh);
                own.attributes(members[k], (mesh, index), editor)?;
                quads::write(options.patches, members[k].0, mesh, editor)?;
            }
        }
        editor.use_extension(extension::NAME)?;
        if !options.patches {
            quads::forget_polygons(editor);
        }
        Ok(())
    }
}

/// Numbers of the surfaces of each material, by its index; surfaces without a material get a new one.
fn by_material(surfaces: &[Surface], editor: &mut Editor) -> Result<BTreeMap<usize, Vec<usize>>> {
    let mut of_material: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    let mut new_material = None;
    for (i, surface) in surfaces.iter().enumerate() {
        let material = match (surface.material, new_material) {
            (Some(m), _) | (None, Some(m)) => m,
            (None, None) => *new_material.insert(editor.push("materials", json!({"name": "shell"}))?),
        };
        of_material.entry(material).or_default().push(i);
    }
    Ok(of_material)
}

/// Surfaces grouped by the size of their cells, or all in one group.
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

/// Remove the shells of earlier mappings from the surfaces' materials.
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

/// Indices of the materials that the options name.
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

/// For each surface the index of the mesh that gets its attributes. Nodes that show a mesh in another size or tilt get a copy of the mesh,
/// which shares everything but the attributes that a mapping writes.
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

/// Note which attributes of the file are kept.
fn note_kept_attributes(plan: &Plan, options: &MapOptions, notes: &mut Vec<String>) {
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

/// Report about one material: one entry for each size of copies.
fn covered(name: &str, plan: &Plan, options: &MapOptions, members: &[(&Surface, &SurfacePlan)]) -> Vec<Covered> {
    let mut all: Vec<Covered> = Vec::new();
    let content = options.texels.iter().map(|(_, info)| info.content.max.z).fold(0.0, f64::max);
    for (_, planned) in members {
        let [u, v] = planned.cell;
        // Texture coordinates of the file may cover no area.
        let copies = if u * v > 0.0 { planned.area / (u * v) * options.presence } else { 0.0 };
        // The shell may be higher than its content.
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

/// Add the texels to the list in the root's extension. Returns their indices there.
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
