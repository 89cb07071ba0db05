//! Expansion of a landscape to explicit triangles, for other renderers: rigid copies become instances of their sources' meshes, and copies
//! that shells bend become triangles of their own, clipped where the shell clips them.
//!
//! Based on: J. Kajiya, T. Kay, *Rendering Fur with Three Dimensional Textures*, SIGGRAPH 1989 (what stands in texture space,
//! and the world); S. Porumbescu et al., *Shell Maps*, SIGGRAPH 2005 (the inverse map: geometry of texture space put into a shell).

mod bent;
mod clip;
mod region;
mod source;
mod view;

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use self::bent::{BentKey, BentMeshes, ShellClipper, tint_bits};
use self::source::SourceTriangles;
use self::view::Frustum;
use super::copies::Copies;
use super::faces::{Face, WindBend, faces};
use super::layer::TexelLayer;
use super::options::CameraChoice;
use super::phong::PhongTable;
use super::prepare;
use super::reference::SourceMesh;
use super::shell::Corner;
use crate::geom::{Aabb, DAffine3, DVec3};
use crate::progress::Progress;
use crate::scene::shell::CellWrap;
use crate::scene::{Instance, Material, Model, Part, Scene};
use crate::volume::Octree;
use crate::{Error, Result, Warnings, par};

/// Options of an expansion.
#[derive(Debug, Clone, PartialEq)]
pub struct ExpandOptions {
    /// Keep only what this camera may see, in a picture of this width and height (pixels), which give its aspect ratio; `None` keeps everything.
    pub view: Option<(CameraChoice, [u32; 2])>,
    /// Margin around the view, metres, within which objects are kept as well.
    pub margin: f64,
    /// Largest deviation of bent triangles from the shell's exact map, in cells of the texel; above 0.
    pub tolerance: f64,
    /// Most triangles to store; those of an instanced mesh count once.
    pub max_triangles: u64,
    /// Most bytes of memory for them.
    pub max_bytes: u64,
    /// Number of threads; 0 uses all cores.
    pub threads: usize,
}

impl Default for ExpandOptions {
    fn default() -> Self {
        ExpandOptions {
            view: None,
            margin: 0.0,
            tolerance: 1e-3,
            max_triangles: 20_000_000,
            max_bytes: 4 << 30,
            threads: 0,
        }
    }
}

/// Size of an expansion.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Amount {
    /// Rigid copies.
    pub copies: u64,
    /// Faces of shells.
    pub faces: u64,
    /// Triangles that are stored for copies, each mesh once.
    pub rigid_triangles: u64,
    /// Triangles that are stored for bent copies.
    pub bent_triangles: u64,
    /// Triangles that are shown: those of an instanced mesh count for each copy.
    pub shown_triangles: u64,
}

/// A landscape without texels.
#[derive(Debug, Clone)]
pub struct Expanded {
    /// Its ground, cameras and lights as they were, and the texels' matter.
    pub model: Model,
    /// Its size.
    pub amount: Amount,
    /// Warnings about what was mended or left out, counted.
    pub warnings: Warnings,
    /// Notes about what the result cannot express, a line each.
    pub notes: Vec<String>,
}

/// Approximate bytes of a bent triangle in memory: its indices, and its share of vertices, some of which neighbours share, with normals and
/// texture coordinates.
const BENT_BYTES: u64 = 90;
/// Bytes of an instance of one part of a mesh.
const INSTANCE_BYTES: u64 = 160;
/// Most different tints of copies that are kept exactly; if there are more, they are rounded.
const EXACT_TINTS: usize = 16;

/// Parts of a model, with their maps into texel space.
type PlacedParts = Vec<(usize, DAffine3)>;

/// The faces of one shell that are to be filled, with the layers that fill them.
struct ShellFaces {
    layers: Vec<TexelLayer>,
    faces: Vec<Face>,
}

/// A planned expansion: what is kept and an estimate of its size, without any triangles yet.
pub struct Plan<'a> {
    scene: &'a Scene,
    options: ExpandOptions,
    sources: Vec<Option<SourceTriangles>>,
    cyclic: Vec<bool>,
    copies: Copies<'a>,
    /// Numbers of the copies that are kept.
    kept: Vec<u32>,
    shells: Vec<ShellFaces>,
    origin: DVec3,
    /// Its size; the number of bent triangles is an estimate.
    pub amount: Amount,
    warnings: Warnings,
    notes: Vec<String>,
}

impl<'a> Plan<'a> {
    /// Read the meshes that the scene's texels were baked from, and decide what is kept of the scene.
    ///
    /// # Errors
    /// `Options` where a number is out of range, a texel that is used names no geometry, or there is no such camera; as
    /// [`super::render`] where a file cannot be read; `Limit` where the expansion would exceed a limit.
    pub fn new(scene: &'a Scene, options: &ExpandOptions) -> Result<Plan<'a>> {
        if !(options.tolerance > 0.0 && options.margin >= 0.0) {
            return Err(Error::Options("the tolerance must be above 0, and the margin at least 0".into()));
        }
        let mut warnings = Warnings::default();
        let opened = super::Opened::new(scene)?;
        warnings.merge(opened.warnings.clone());
        let trees = opened.trees()?;
        let sources = sources(scene, &trees, &mut warnings)?;
        let cyclic = trees.iter().map(|t| t.as_ref().is_some_and(|t| t.info().cyclic.contains(&true))).collect();
        let info = |i: usize| Some(trees.get(i)?.as_ref()?.info());
        let copies = Copies::new(scene, &PhongTable::default(), info, |world| world)?;
        let mut notes = Vec::new();
        let bounds = copies.bounds().filter(prepare::finite).fold(prepare::bounds(scene), Aabb::union);
        let frustum = frustum(scene, &bounds, options, &mut notes)?;
        let sees = |b: &Aabb| frustum.as_ref().is_none_or(|f| f.sees(b));
        let kept = (0u32..).zip(copies.bounds()).filter(|(_, b)| sees(b)).map(|(i, _)| i).collect();
        let shells = shells(scene, &trees, &sees, &mut warnings)?;
        let origin = if bounds.is_empty() { DVec3::ZERO } else { bounds.centre().round() };
        let mut plan = Plan {
            scene,
            options: options.clone(),
            sources,
            cyclic,
            copies,
            kept,
            shells,
            origin,
            amount: Amount::default(),
            warnings,
            notes,
        };
        plan.amount = plan.estimate();
        plan.check(plan.amount.rigid_triangles, plan.amount.bent_triangles)?;
        Ok(plan)
    }

    fn estimate(&self) -> Amount {
        let triangles =
            |texel: usize| self.sources.get(texel).and_then(Option::as_ref).map_or(0, |s| s.triangles.len() as u64);
        let mut amount = Amount { copies: self.kept.len() as u64, ..Amount::default() };
        let mut used = BTreeSet::new();
        for copy in self.kept.iter().filter_map(|&i| self.copies.get(i as usize)) {
            amount.shown_triangles += triangles(copy.texel);
            used.insert(copy.texel);
        }
        amount.rigid_triangles = used.into_iter().map(triangles).sum();
        let mut bent = 0.0;
        for shell in &self.shells {
            amount.faces += shell.faces.len() as u64;
            for layer in &shell.layers {
                let cells: f64 = shell.faces.iter().map(|face| cells_over(face, layer)).sum();
                let mut before = 0.0;
                let mean: f64 = layer
                    .choices
                    .iter()
                    .map(|c| {
                        let weight = c.cumulative - std::mem::replace(&mut before, c.cumulative);
                        weight * triangles(c.texel) as f64
                    })
                    .sum();
                bent += cells * mean * layer.layer.discrete.as_ref().map_or(1.0, |d| d.presence);
            }
        }
        amount.bent_triangles = bent as u64;
        amount.shown_triangles += amount.bent_triangles;
        amount
    }

    /// Check that these numbers of triangles are within the limits.
    fn check(&self, rigid: u64, bent: u64) -> Result<()> {
        let limit = |what: &str, needed: u64, allowed: u64| {
            let what = format!("{what} (fewer: option `camera`; more: option `max_triangles`, option `memory`)");
            if needed > allowed { Err(Error::Limit { what, needed, allowed }) } else { Ok(()) }
        };
        limit("the expanded landscape's triangles", rigid.saturating_add(bent), self.options.max_triangles)?;
        let parts = |texel: usize| {
            self.sources.get(texel).and_then(Option::as_ref).map_or(1, |s| s.mesh.model.instances.len() as u64)
        };
        let most = (0..self.sources.len()).map(parts).max().unwrap_or(1);
        let bytes = BENT_BYTES * (rigid + bent) + INSTANCE_BYTES * most * self.kept.len() as u64;
        limit("the expanded landscape's bytes of memory", bytes, self.options.max_bytes)
    }

    /// Carry out the expansion.
    ///
    /// # Errors
    /// `Limit` where it exceeds a limit after all; `Options` where nothing is left of the landscape.
    pub fn run(mut self, progress: &dyn Progress) -> Result<Expanded> {
        let mut model = self.plain();
        let mut builder = Builder { model: &mut model, materials: BTreeMap::new() };
        let (instances, stored) = self.rigid(&mut builder);
        let pieces = par::with_threads(self.options.threads, || self.bent(progress))??;
        let mut amount = Amount { bent_triangles: pieces.len(), rigid_triangles: stored, ..self.amount };
        self.add_pieces(&mut builder, pieces);
        model.instances.extend(instances);
        if model.instances.is_empty() {
            let what = "nothing is left of the landscape: no part of it is seen".to_owned();
            return Err(Error::Options(what));
        }
        amount.shown_triangles = shown(&model);
        self.say_what_is_lost();
        Ok(Expanded { model, amount, warnings: self.warnings, notes: self.notes })
    }

    /// The landscape without its texels.
    fn plain(&self) -> Model {
        let mut model = self.scene.model.clone();
        let shells: Vec<Option<bool>> =
            model.materials.iter().map(|m| m.shell.as_ref().map(|s| s.surface_visible)).collect();
        let hidden =
            |i: &Instance| model.parts.get(i.part).is_some_and(|p| shells.get(p.material) == Some(&Some(false)));
        let keep: Vec<bool> = model.instances.iter().map(|i| !hidden(i)).collect();
        let mut keep = keep.into_iter();
        model.instances.retain(|_| keep.next().unwrap_or(true));
        // Patches have a meaning for shells only.
        model.parts.iter_mut().for_each(|part| part.patches.clear());
        for material in &mut model.materials {
            (material.shell, material.wind) = (None, None);
        }
        model
    }

    /// Instances of the sources' meshes for rigid copies, and the number of triangles of those meshes.
    fn rigid(&mut self, builder: &mut Builder<'_>) -> (Vec<Instance>, u64) {
        let tints: BTreeSet<[u32; 3]> =
            self.kept.iter().filter_map(|&i| self.copies.get(i as usize)).map(|c| tint_bits(c.tint, true)).collect();
        let exact = tints.len() <= EXACT_TINTS;
        if !exact {
            self.notes.push(format!("{} tints of copies are rounded to steps of 6 %", tints.len()));
        }
        let mut parts: BTreeMap<(usize, [u32; 3]), PlacedParts> = BTreeMap::new();
        let (mut instances, mut stored, mut flat) = (Vec::new(), 0, 0);
        for &i in &self.kept {
            let Some(copy) = self.copies.get(i as usize) else {
                flat += 1;
                continue;
            };
            let tint = tint_bits(copy.tint, exact);
            let own = parts.entry((copy.texel, tint)).or_insert_with(|| {
                let (own, triangles) = self.prototype(builder, copy.texel, tint);
                stored += triangles;
                own
            });
            let to_world = copy.to_texel.inverse();
            let name = self.scene.texels.get(copy.texel).map_or("", |t| &t.name);
            instances.extend(own.iter().map(|(part, local)| Instance {
                part: *part,
                transform: to_world * *local,
                node: name.to_owned(),
            }));
        }
        self.warnings.add_many("a copy without a volume is left out", flat);
        (instances, stored)
    }

    /// Add the parts of a texel's source to the model; returns them with their maps into texel space, and their number of triangles.
    fn prototype(&self, builder: &mut Builder<'_>, texel: usize, tint: [u32; 3]) -> (PlacedParts, u64) {
        let Some(Some(source)) = self.sources.get(texel) else { return (Vec::new(), 0) };
        if self.cyclic.get(texel) == Some(&true) {
            let mut clipper = ShellClipper::new(&self.sources, DVec3::ZERO);
            clipper.cube_of(texel, tint);
            let triangles = clipper.out.len();
            let parts =
                clipper.out.0.into_iter().map(|(key, piece)| (builder.piece(source, key, piece), DAffine3::IDENTITY));
            return (parts.collect(), triangles);
        }
        let mut known = BTreeMap::new();
        let own = source.mesh.model.instances.iter().filter_map(|instance| {
            let part = source.mesh.model.parts.get(instance.part).filter(|p| !p.triangles.is_empty())?;
            let index = *known.entry(instance.part).or_insert_with(|| {
                let material = builder.material(&source.mesh.model, (texel, part.material, tint));
                builder.add(Part { material, lines: Vec::new(), points: Vec::new(), ..part.clone() })
            });
            Some((index, instance.transform))
        });
        (own.collect(), source.triangles.len() as u64)
    }

    /// The bent triangles of all shells.
    fn bent(&self, progress: &dyn Progress) -> Result<BentMeshes> {
        /// Faces per parallel task.
        const FACES: usize = 16;
        let jobs: Vec<(&ShellFaces, Range<usize>)> = self
            .shells
            .iter()
            .flat_map(|shell| {
                let n = shell.faces.len();
                (0..n).step_by(FACES).map(move |from| (shell, from..n.min(from + FACES)))
            })
            .collect();
        progress.stage("expand", jobs.len() as u64);
        let mut all = BentMeshes::default();
        // In batches, so that not much is computed after a limit is exceeded.
        for some in jobs.chunks(256) {
            let made = par::map(some.len(), |i| {
                let (shell, range) = &some[i];
                let mut clipper = ShellClipper::new(&self.sources, self.origin);
                let most = self.options.max_triangles;
                let mut within = true;
                for face in &shell.faces[range.clone()] {
                    for layer in &shell.layers {
                        within = within && clipper.face(face, layer, self.options.tolerance, most);
                    }
                }
                progress.advance(1);
                clipper.out
            });
            for pieces in made {
                all.append(pieces);
                self.check(self.amount.rigid_triangles, all.len())?;
            }
            let bytes = all.bytes();
            if bytes > self.options.max_bytes {
                let what = "the expanded landscape's bytes of memory (option `memory`)".into();
                return Err(Error::Limit { what, needed: bytes, allowed: self.options.max_bytes });
            }
        }
        Ok(all)
    }

    fn add_pieces(&self, builder: &mut Builder<'_>, pieces: BentMeshes) {
        for (key, piece) in pieces.0 {
            let Some(Some(source)) = self.sources.get(key.0) else { continue };
            let name = self.scene.texels.get(key.0).map_or(String::new(), |t| t.name.clone());
            let part = builder.piece(source, key, piece);
            builder.model.instances.push(Instance {
                part,
                transform: DAffine3::from_translation(self.origin),
                node: name,
            });
        }
    }

    fn say_what_is_lost(&mut self) {
        let shells = self.scene.model.materials.iter().filter_map(|m| m.shell.as_deref());
        let scaled = shells.flat_map(|shell| &shell.layers).filter(|layer| layer.opacity_scale != 1.0).count();
        self.warnings.add_many("a layer's opacityScale is lost: triangles are there or not", scaled as u64);
        let environment = &self.scene.environment;
        if environment.sky.is_some() || environment.background.is_some() || environment.haze.is_some() {
            self.notes.push("the landscape's sky and haze are no part of glTF: give them to the renderer again".into());
        }
        if self.options.view.is_some() {
            self.notes.push(
                "what the camera does not see is left out, with its shadows (option `margin` keeps what is near)"
                    .into(),
            );
        }
    }
}

/// Triangles that a model shows.
fn shown(model: &Model) -> u64 {
    let of = |i: &Instance| model.parts.get(i.part).map_or(0, |p| p.triangles.len() as u64);
    model.instances.iter().map(of).sum()
}

/// The expanded model while sources are added to it.
struct Builder<'a> {
    model: &'a mut Model,
    /// Indices of materials by texel, the source's material, and tint.
    materials: BTreeMap<BentKey, usize>,
}

impl Builder<'_> {
    fn add(&mut self, part: Part) -> usize {
        self.model.parts.push(part);
        self.model.parts.len() - 1
    }

    /// A source's material, tinted.
    fn material(&mut self, source: &Model, key: BentKey) -> usize {
        if let Some(&known) = self.materials.get(&key) {
            return known;
        }
        let mut material = source.materials.get(key.1).cloned().unwrap_or_else(Material::default);
        let tint = key.2.map(f32::from_bits);
        material.base_color.iter_mut().zip(tint).for_each(|(c, t)| *c *= t);
        self.model.materials.push(material);
        let index = self.model.materials.len() - 1;
        self.materials.insert(key, index);
        index
    }

    /// Bent triangles as a part.
    fn piece(&mut self, source: &SourceTriangles, key: BentKey, piece: bent::BentMesh) -> usize {
        let model = &source.mesh.model;
        let own = model.parts.get(key.1);
        let material = self.material(model, (key.0, own.map_or(0, |p| p.material), key.2));
        let tex_coord = self.model.materials.get(material).and_then(|m| m.texture.as_ref()).map_or(0, |t| t.tex_coord);
        let some = |there: bool| there.then_some(());
        let mut uvs = Vec::new();
        if !piece.uvs.is_empty() {
            uvs = vec![Vec::new(); tex_coord];
            uvs.push(piece.uvs);
        }
        self.add(Part {
            name: own.map_or(String::new(), |p| p.name.clone()),
            normals: some(!piece.normals.is_empty()).map(|()| piece.normals),
            colors: some(!piece.colors.is_empty()).map(|()| piece.colors),
            positions: piece.positions,
            triangles: piece.triangles,
            uvs,
            material,
            ..Part::default()
        })
    }
}

/// The meshes that the used texels were baked from. A mesh that several texels share is read for each of them.
fn sources(scene: &Scene, trees: &[Option<Octree>], warnings: &mut Warnings) -> Result<Vec<Option<SourceTriangles>>> {
    let open = |(tree, texel): (&Option<Octree>, &crate::scene::shell::TexelRef)| {
        let mesh = tree.as_ref().map(|tree| SourceMesh::of_texel(tree, texel, "expand it to", warnings)).transpose()?;
        Ok(mesh.map(SourceTriangles::new))
    };
    trees.iter().zip(&scene.texels).map(open).collect()
}

fn frustum(scene: &Scene, bounds: &Aabb, options: &ExpandOptions, notes: &mut Vec<String>) -> Result<Option<Frustum>> {
    let Some((camera, size)) = &options.view else { return Ok(None) };
    let seen_by = super::Options { camera: camera.clone(), size: *size, ..super::Options::default() };
    let view = prepare::view(scene, bounds, &seen_by, notes)?;
    Ok(Some(Frustum::new(&view, *size, options.margin)))
}

/// The visible faces of the scene's shells, with their layers.
fn shells(
    scene: &Scene,
    trees: &[Option<Octree>],
    sees: &dyn Fn(&Aabb) -> bool,
    warnings: &mut Warnings,
) -> Result<Vec<ShellFaces>> {
    let mut found = Vec::new();
    let info = |i: usize| Some(trees.get(i)?.as_ref()?.info());
    for instance in &scene.model.instances {
        let Some((part, shell)) = prepare::shell_of(scene, instance.part) else { continue };
        let wind = scene.model.materials.get(part.material).and_then(|m| m.wind);
        let bend = wind.map(|wind| WindBend { wind, eye: DVec3::ZERO, unit: 1.0 });
        for (nth, range) in prepare::layer_ranges(shell).into_iter().enumerate() {
            // A shell's warnings are counted once, and not for each of its ranges.
            let mut again = Warnings::default();
            let warnings = if nth == 0 { &mut *warnings } else { &mut again };
            let all = faces(part, (shell, range.0, range.1), instance.transform, bend.as_ref(), warnings);
            let reach = |face: &Face| Aabb::around(corners(face).iter().flat_map(|c| [c.p, c.p + c.h]));
            let faces: Vec<_> = all.into_iter().filter(|face| sees(&reach(face))).collect();
            if !faces.is_empty() {
                found.push(ShellFaces {
                    layers: prepare::layers_in((scene, &PhongTable::default()), shell, range, &info)?,
                    faces,
                });
            }
        }
    }
    Ok(found)
}

fn corners(face: &Face) -> &[Corner] {
    match face {
        Face::Triangle(corners) => corners,
        Face::Patch(corners) => corners,
    }
}

/// Approximate number of cells of a layer over a face.
fn cells_over(face: &Face, layer: &TexelLayer) -> f64 {
    let ring = corners(face);
    let [u, v, w] = layer.layer.scale;
    let Some(first) = ring.first() else { return 0.0 };
    let cross = |pair: &[Corner]| {
        let (e, f) = (pair[0].q - first.q, pair[1].q - first.q);
        0.5 * (e.x * f.y - e.y * f.x)
    };
    let area: f64 = ring.windows(2).map(cross).sum();
    let up = if layer.layer.wrap[2] == CellWrap::Empty { 1.0 } else { (first.dw * w).abs() };
    area.abs() * (u * v).abs() * up
}
