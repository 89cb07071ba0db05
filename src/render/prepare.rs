//! Preparation of a scene for rays: geometry, lights and texels are brought into one space around the camera, and hierarchies are built.
//!
//! That space is (world − eye) / unit, with `unit` a power of two about as large as the scene. So a picture depends neither on the
//! scene's position nor on its size, and coordinates near the camera keep their precision.

use std::sync::Arc;

use super::affine::AffineCopies;
use super::bvh::{Boxes, Bvh};
use super::camera::View;
use super::cells;
use super::cells::{CopyHit, TexelChoice, TexelLayer};
use super::copies::Copies;
use super::environment::lights_and_environment;
use super::environment_light::EnvironmentLight;
use super::faces;
use super::faces::WindBend;
use super::jitter;
use super::light::PunctualLight;
use super::mesh::{Mesh, MeshBuilder};
use super::options::{CameraChoice, Options, SourceLod};
use super::phong::{PhongTable, SurfaceCoords};
use super::shell::ShellBox;
use super::sky::store::SkyLight;
use super::source_lod::LazySource;
use super::source_mesh::SourceMesh;
use crate::geom::{Aabb, DAffine3, DVec3, Ray, Vec3};
use crate::march::shade::Look;
use crate::scene::shell::{Layer, ShellMaterial, TexelRef, Variant};
use crate::scene::{Camera, Part, Projection, Scene};
use crate::volume::voxel::voxel_edge;
use crate::volume::{Info, Octree};
use crate::{Error, Result, Warnings};

/// A texel with the scene's choices about it.
pub struct Texel {
    pub tree: Arc<Octree>,
    /// Deepest depth to be used.
    pub finest: u8,
    /// The mesh that it was baked from, if that is to be traced where a pixel is smaller than the finest voxel.
    pub source: Option<Arc<LazySource>>,
}

impl Texel {
    /// The source, if a cone `width` cube edges wide is to trace it instead of voxels; `lod_dither` in [0, 1) decides where both are
    /// possible.
    pub fn source_lod(&self, width: f32, lod_dither: f32) -> Option<&SourceMesh> {
        let source = self.source.as_ref()?;
        let finest = self.tree.finest()?.min(usize::from(self.finest));
        source.get(self.tree.info(), voxel_edge(finest as u8), width, lod_dither)
    }
}

/// An item of [`World::shells`].
pub enum Item<'w> {
    Box(&'w ShellBox),
    /// Index into [`World::copies`].
    Copy(usize),
}

/// A scene, ready for rays.
pub struct World<'a> {
    pub scene: &'a Scene,
    pub view: View,
    /// Bounding box of the scene, world space; may be empty.
    pub bounds: Aabb,
    /// Metres in a unit of length.
    pub unit: f64,
    pub mesh: Mesh,
    /// The boxes that no affine copy fills.
    pub boxes: Vec<ShellBox>,
    /// Number of bilinear patches that are represented by two prisms.
    pub split_patches: u64,
    /// Rigid copies, followed by copies that fill a box alone.
    pub copies: AffineCopies,
    /// Phong parameters of layers and copies.
    pub phongs: PhongTable,
    /// For each box, its index into `layers`.
    pub box_layers: Vec<u32>,
    /// Hierarchy over the boxes, which come first, and the copies.
    pub shells: Bvh,
    /// Groups of layers of one material that fill the same range of the height vectors.
    pub layers: Vec<Vec<TexelLayer>>,
    /// As the scene's texels; `None` for those that nothing uses.
    pub texels: Vec<Option<Texel>>,
    pub lights: Vec<PunctualLight>,
    pub environment: EnvironmentLight,
    pub sky: SkyLight,
    pub warnings: Warnings,
    /// Notes about choices that neither caller nor file made, a line each.
    pub notes: Vec<String>,
}

/// State of a scene's preparation that its shells share.
#[derive(Default)]
struct ShellSetup {
    /// For each material with a shell that was met, the index of its first group of layers in [`World::layers`].
    first_layers: Vec<Option<u32>>,
    /// Bounding boxes of the copies that fill a box alone.
    filled: Boxes,
    /// Whether some box is not finite in single precision.
    too_large: bool,
}

/// The meshes that the scene's texels were baked from, each to be read when a cone first needs it.
pub fn sources(scene: &Scene) -> Vec<Option<Arc<LazySource>>> {
    let source = |texel: &TexelRef| {
        let path = texel.geometry.clone()?;
        Some(Arc::new(LazySource::new(path, texel.palette.clone(), texel.pose.clone())))
    };
    scene.texels.iter().map(source).collect()
}

/// For each texel of the scene, whether a shell or a copy uses it.
pub fn used_texels(scene: &Scene) -> Vec<bool> {
    let mut used = vec![false; scene.texels.len()];
    for instance in &scene.model.instances {
        let Some(shell) = shell_of(scene, instance.part).map(|s| s.1) else { continue };
        for layer in &shell.layers {
            let variants = layer.discrete.iter().flat_map(|d| d.variants.iter().map(|v| v.texel));
            for texel in std::iter::once(layer.texel).chain(variants) {
                use_frames(scene, texel, &mut used);
            }
        }
    }
    for variant in scene.copies.iter().flat_map(|set| &set.variants) {
        use_frames(scene, variant.texel, &mut used);
    }
    used
}

/// Mark a texel as used and, if its copies show different frames, all of these.
fn use_frames(scene: &Scene, texel: usize, used: &mut [bool]) {
    let following = scene.texels.get(texel).map_or(0, |t| t.following as usize);
    used.iter_mut().skip(texel).take(1 + following).for_each(|slot| *slot = true);
}

/// The part of a number, and the shell that its material carries; `None` without a shell.
pub fn shell_of(scene: &Scene, part: usize) -> Option<(&Part, &ShellMaterial)> {
    let part = scene.model.parts.get(part)?;
    let material = scene.model.materials.get(part.material)?;
    material.shell.as_deref().map(|s| (part, s))
}

impl<'a> World<'a> {
    /// `texels[i]` is the scene's texel i, opened; needed for those of [`used_texels`].
    pub fn new(scene: &'a Scene, texels: Vec<Option<Arc<Octree>>>, options: &Options) -> Result<World<'a>> {
        check_memory(scene, options.memory)?;
        let mut notes = Vec::new();
        let mut warnings = Warnings::default();
        let info = |i: usize| Some(texels.get(i)?.as_ref()?.info());
        let phongs = PhongTable::new(scene);
        let copies = Copies::new(scene, &phongs, info, |world| world)?;
        let bounds = copies.bounds().filter(finite).fold(bounds(scene), Aabb::union);
        let view = view(scene, &bounds, options, &mut notes)?;
        let reach = (bounds.min - view.eye).abs().max((bounds.max - view.eye).abs()).max_element();
        // A power of two, so that the division is exact, and small enough that its square is finite.
        let unit = if reach.is_finite() && reach > 0.0 {
            libm::exp2(libm::log2(reach).ceil().clamp(-300.0, 300.0))
        } else {
            1.0
        };
        let copies = Copies::new(scene, &phongs, info, |world| relative(world, view.eye, unit))?;
        let texel = |(tree, texel_ref): (Option<_>, &TexelRef)| {
            Some(Texel { tree: tree?, finest: texel_ref.max_depth.unwrap_or(u8::MAX), source: None })
        };
        let texels: Vec<Option<Texel>> = texels.into_iter().zip(&scene.texels).map(texel).collect();
        for (texel, texel_ref) in texels.iter().zip(&scene.texels) {
            let info = texel.as_ref().map(|t| t.tree.info());
            for name in info.into_iter().flat_map(|info| texel_ref.palette.unknown(info)) {
                warnings.add(format!("texel {:?} has no material {name:?} for a palette to restyle", texel_ref.name));
            }
        }
        let (lights, environment) = lights_and_environment(scene, options, view.eye, unit, &mut notes)?;
        let content = |texel: &Option<Texel>| texel.as_ref().map_or(Aabb::EMPTY, |t| t.tree.info().content);
        let contents = texels.iter().map(content);
        let sky = sky(&bounds, view.eye, unit);
        let mut world = World {
            scene,
            unit,
            bounds,
            mesh: Mesh::default(),
            boxes: Vec::new(),
            split_patches: 0,
            copies: AffineCopies::new(contents),
            phongs,
            box_layers: Vec::new(),
            shells: Bvh::default(),
            layers: Vec::new(),
            lights,
            view,
            texels,
            environment,
            sky,
            warnings: Warnings::default(),
            notes: Vec::new(),
        };
        world.place(&copies, &mut warnings)?;
        if world.items() == 0 && world.mesh.is_empty() {
            warnings.add("nothing to see: the scene has no triangle that could be drawn");
        }
        (world.warnings, world.notes) = (warnings, notes);
        if options.source_lod == SourceLod::Geometry {
            world.show_sources(&sources(scene));
        }
        Ok(world)
    }

    /// From now on texels near the camera are traced as the meshes `sources`, or marched as voxels where there is none.
    pub fn show_sources(&mut self, sources: &[Option<Arc<LazySource>>]) {
        for (texel, source) in self.texels.iter_mut().zip(sources) {
            texel.iter_mut().for_each(|texel| texel.source.clone_from(source));
        }
        self.sky = sky(&self.bounds, self.view.eye, self.unit);
    }

    /// Bring instances into the renderer's space as triangles and boxes, and build the hierarchies.
    fn place(&mut self, copies: &Copies<'_>, warnings: &mut Warnings) -> Result<()> {
        // Bounding boxes of rigid copies are computed again below: stored, those of a million copies take 50 MB.
        if !copies.bounds().all(|b| finite(&b)) {
            return Err(Error::Options("the scene's copies are too large to be rendered".into()));
        }
        self.copies.reserve(copies.len());
        (0..copies.len()).for_each(|i| self.copies.push(copies.get(i).as_ref(), &self.phongs));
        let scene = self.scene;
        let mut mesh = MeshBuilder::default();
        let mut shells = ShellSetup { first_layers: vec![None; scene.model.materials.len()], ..ShellSetup::default() };
        for (index, instance) in scene.model.instances.iter().enumerate() {
            let Some(part) = scene.model.parts.get(instance.part) else { continue };
            let placed = relative(instance.transform, self.view.eye, self.unit);
            let shell = shell_of(scene, instance.part).map(|s| s.1);
            let curved = match shell {
                Some(shell) => self.place_shell(part, shell, placed, &mut shells, warnings)?,
                None => Vec::new(),
            };
            if shell.is_none_or(|s| s.surface_visible) && !part.triangles.is_empty() {
                let at = |p: &[f32; 3]| placed.transform_point3(DVec3::from_array(p.map(f64::from)));
                mesh.add_curved(index, part, &part.positions.iter().map(at).collect::<Vec<_>>(), &curved);
            }
        }
        if shells.too_large {
            return Err(Error::Options("the scene's height vectors are too large to be rendered".into()));
        }
        self.mesh = mesh.build(&scene.model.materials);
        if !shells.filled.are_finite() {
            return Err(Error::Options("the scene's copies are too large to be rendered".into()));
        }
        let mut all: Boxes = self.boxes.iter().map(ShellBox::bounds).chain(copies.bounds()).collect();
        all.append(shells.filled);
        self.shells = Bvh::over(&all);
        Ok(())
    }

    /// Add the boxes of a part's shell; `placed` takes the part to the renderer's space. Returns for each of its bilinear patches whether it
    /// has a box of its own.
    fn place_shell(
        &mut self,
        part: &Part,
        shell: &ShellMaterial,
        placed: DAffine3,
        setup: &mut ShellSetup,
        warnings: &mut Warnings,
    ) -> Result<Vec<bool>> {
        let wind = self.scene.model.materials.get(part.material).and_then(|m| m.wind);
        let bend = wind.map(|wind| WindBend { wind, eye: self.view.eye, unit: self.unit });
        let ranges = layer_ranges(shell);
        let first = match setup.first_layers[part.material] {
            Some(first) => first,
            None => {
                let first = self.layers.len() as u32;
                let info = |i: usize| Some(self.texels.get(i)?.as_ref()?.tree.info());
                for &range in &ranges {
                    self.layers.push(layers_in((self.scene, &self.phongs), shell, range, &info)?);
                }
                setup.first_layers[part.material] = Some(first);
                first
            }
        };
        let mut curved = Vec::new();
        for (group, &range) in (first..).zip(&ranges) {
            // A shell's warnings are counted once, and not for each of its ranges.
            let mut again = Warnings::default();
            let warnings = if group == first { &mut *warnings } else { &mut again };
            let layers = self.layers.get(group as usize).map_or(&[][..], Vec::as_slice);
            let take = &mut |shell: ShellBox| {
                setup.too_large |= !finite(&shell.bounds());
                let (copies, phongs, filled) = (&mut self.copies, &self.phongs, &mut setup.filled);
                if !matches!(&shell, ShellBox::Prism(p) if copies.add_whole_box(p, layers, phongs, filled)) {
                    self.boxes.push(shell);
                }
            };
            let found = faces::boxes(part, (shell, range.0, range.1), placed, bend.as_ref(), warnings, take);
            if group == first {
                let folded = found.iter().filter(|c| !**c).count() as u64;
                self.split_patches += folded + part.collapsed_patches;
                curved = found;
            }
            self.box_layers.resize(self.boxes.len(), group);
        }
        Ok(curved)
    }

    /// How the scene modifies the material of a copy at the distance `t` of `ray`, averaged over `width`. `coords` gives texel coordinates
    /// along the ray, where the parameters vary.
    pub fn look(&self, hit: &CopyHit, coords: Option<&SurfaceCoords>, ray: &Ray, (t, width): (f64, f64)) -> Look {
        self.phongs.look(hit.phong, hit.tint, || {
            let metres = ray.at(t) * self.unit + self.view.eye;
            Some(coords?.at(t, metres, width, self.unit))
        })
    }

    /// Number of boxes over bilinear patches, without those whose map is affine and which are prisms.
    pub fn patches(&self) -> u64 {
        self.boxes.iter().filter(|b| matches!(b, ShellBox::Patch(_))).count() as u64
    }

    /// Number of items of `shells`.
    pub fn items(&self) -> usize {
        self.boxes.len() + self.copies.len()
    }

    /// Item `index` of `shells`: a box, or the number of a copy.
    #[inline]
    pub fn item(&self, index: u32) -> Item<'_> {
        let index = index as usize;
        self.boxes.get(index).map_or_else(|| Item::Copy(index - self.boxes.len()), Item::Box)
    }

    /// The layers of box `index`; none where there is no such box.
    pub fn layers_of(&self, index: u32) -> &[TexelLayer] {
        let layers = self.box_layers.get(index as usize).and_then(|&group| self.layers.get(group as usize));
        layers.map_or(&[], Vec::as_slice)
    }
}

/// Bytes of memory per placed triangle and per vertex of a plain mesh, measured while hierarchies are built, and roughly per triangle of a
/// shell and range of its layers.
const TRIANGLE_MEMORY: u64 = 360;
const VERTEX_MEMORY: u64 = 24;
const BOX_MEMORY: u64 = 1200;

/// Check that the scene's instances fit into the allowed memory.
fn check_memory(scene: &Scene, allowed: u64) -> Result<()> {
    let mut needed = 0u64;
    for instance in &scene.model.instances {
        let Some(part) = scene.model.parts.get(instance.part) else { continue };
        let (triangles, vertices) = (part.triangles.len() as u64, part.positions.len() as u64);
        let shell = shell_of(scene, instance.part).map(|s| s.1);
        if shell.is_none_or(|s| s.surface_visible) {
            needed = needed.saturating_add(triangles * TRIANGLE_MEMORY + vertices * VERTEX_MEMORY);
        }
        let ranges = shell.map_or(0, |s| layer_ranges(s).len()) as u64;
        needed = needed.saturating_add(triangles * ranges * BOX_MEMORY);
    }
    if needed <= allowed {
        return Ok(());
    }
    let what = "the scene's triangles, placed as often as it shows them (allow more memory), in bytes,".into();
    Err(Error::Limit { what, needed, allowed })
}

/// Empty caches of sky visibility for the space around `eye`.
fn sky(bounds: &Aabb, eye: DVec3, unit: f64) -> SkyLight {
    SkyLight::new(&Aabb::new((bounds.min - eye) / unit, (bounds.max - eye) / unit))
}

/// Whether a box is finite in single precision.
pub fn finite(b: &Aabb) -> bool {
    b.min.as_vec3().is_finite() && b.max.as_vec3().is_finite()
}

/// `transform`, then (x − eye) / unit.
fn relative(transform: DAffine3, eye: DVec3, unit: f64) -> DAffine3 {
    DAffine3 { matrix3: transform.matrix3 * (1.0 / unit), translation: (transform.translation - eye) / unit }
}

/// Bounding box of the scene's meshes and shells, world space.
pub fn bounds(scene: &Scene) -> Aabb {
    let mut bounds = Aabb::EMPTY;
    for instance in &scene.model.instances {
        let Some(part) = scene.model.parts.get(instance.part) else { continue };
        if part.triangles.is_empty() {
            continue;
        }
        let mut own = Aabb::around(part.positions.iter().map(|p| DVec3::from_array(p.map(f64::from))));
        if let Some((part, shell)) = shell_of(scene, instance.part) {
            let high = |h: &[f32; 3]| DVec3::from_array(h.map(f64::from)).abs();
            let reach = match &part.heights {
                Some(h) => h.iter().fold(DVec3::ZERO, |m, h| m.max(high(h))),
                None => DVec3::splat(shell.thickness.abs()),
            };
            own = Aabb::new(own.min - reach, own.max + reach);
        }
        if !own.is_empty() {
            let corner = |k: usize| {
                let pick = |a: usize| if k >> a & 1 == 0 { own.min[a] } else { own.max[a] };
                instance.transform.transform_point3(DVec3::new(pick(0), pick(1), pick(2)))
            };
            bounds = bounds.union(Aabb::around((0..8).map(corner).filter(|p| p.is_finite())));
        }
    }
    bounds
}

/// The file's camera that `choice` names; `None` where another view is wanted or the file has none.
fn camera_of<'a>(scene: &'a Scene, choice: &CameraChoice) -> Result<Option<&'a Camera>> {
    let cameras = &scene.model.cameras;
    match choice {
        CameraChoice::Framed | CameraChoice::LookAt { .. } => Ok(None),
        CameraChoice::Default => Ok(cameras.first()),
        CameraChoice::Named(name) => {
            let numbered = name.parse().ok().and_then(|k: usize| cameras.get(k));
            let found = cameras.iter().find(|c| c.name == *name).or(numbered);
            found.map(Some).ok_or_else(|| {
                let names: Vec<_> = cameras.iter().map(|c| format!("{:?}", c.name)).collect();
                let known = if names.is_empty() { "none".into() } else { names.join(", ") };
                Error::Options(format!("no camera {name:?} in the file; it has {known}"))
            })
        }
    }
}

/// Width and height of a picture for which nobody asked for a size: of the shape that the camera has in the file, with a
/// longer side as that of [`Options::default`], whose size it is where no camera has a shape.
///
/// # Errors
/// `Options` where the file has no such camera.
pub fn picture_size(scene: &Scene, choice: &CameraChoice) -> Result<[u32; 2]> {
    let plain = Options::default().size;
    let Some(aspect) = camera_of(scene, choice)?.and_then(|camera| camera.aspect) else { return Ok(plain) };
    let long = plain[0];
    // At least a pixel, however thin.
    let short = (f64::from(long) * aspect.min(1.0 / aspect)).round().max(1.0) as u32;
    Ok(if aspect < 1.0 { [short, long] } else { [long, short] })
}

pub fn view(scene: &Scene, bounds: &Aabb, options: &Options, notes: &mut Vec<String>) -> Result<View> {
    let size = options.size;
    let cameras = &scene.model.cameras;
    let framed = || {
        let bounds = if bounds.is_empty() { Aabb::UNIT } else { *bounds };
        View::framing(&bounds, size).ok_or_else(|| Error::Options("the scene is too large to be framed".into()))
    };
    let of_file = |camera: &Camera| {
        View::new(camera, size)
            .ok_or_else(|| Error::Options(format!("camera {:?} has no direction or no field of view", camera.name)))
    };
    if let CameraChoice::LookAt { eye, target, yfov } = &options.camera {
        let view = View::towards(*eye, *target - *eye, DVec3::Y, size, Projection::Perspective { yfov: *yfov });
        let what = "the camera's eye and what it looks at must differ, and the field of view lie in 0 … 180 degrees";
        return view.ok_or_else(|| Error::Options(what.into()));
    }
    let camera = camera_of(scene, &options.camera)?;
    if options.camera == CameraChoice::Default {
        match camera {
            Some(camera) if cameras.len() > 1 => {
                notes.push(format!(
                    "camera {:?}, the first of {} (option `camera` chooses another)",
                    camera.name,
                    cameras.len()
                ));
            }
            Some(_) => {}
            None => notes
                .push("no camera in the file: the scene is framed (option `eye` and option `look_at` set one)".into()),
        }
    }
    camera.map_or_else(framed, of_file)
}

/// Lower and upper share of the height vectors that a layer fills, and the factor by which its boxes are higher.
fn range_of(layer: &Layer) -> ([f64; 2], f64) {
    (layer.skin_range, jitter::height_stretch(layer.continuous.as_ref()))
}

/// The ranges of a shell's layers, each once.
pub fn layer_ranges(shell: &ShellMaterial) -> Vec<([f64; 2], f64)> {
    let mut ranges = Vec::new();
    for range in shell.layers.iter().map(range_of) {
        if !ranges.contains(&range) {
            ranges.push(range);
        }
    }
    ranges
}

/// The layers of `shell` that fill `range`; `info(i)` gives the head of the scene's texel i, if it is open.
pub fn layers_in<'i>(
    (scene, phongs): (&Scene, &PhongTable),
    shell: &ShellMaterial,
    range: ([f64; 2], f64),
    info: &dyn Fn(usize) -> Option<&'i Info>,
) -> Result<Vec<TexelLayer>> {
    let ranks = shell.layers.iter().scan(0, |rank, layer| {
        *rank += u32::from(layer.over);
        Some(*rank)
    });
    shell
        .layers
        .iter()
        .zip(ranks)
        .filter(|(layer, _)| range_of(layer) == range)
        .map(|(layer, rank)| {
            let listed = layer.discrete.iter().flat_map(|d| &d.variants);
            let mut variants: Vec<Variant> = listed.filter(|v| v.weight > 0.0).cloned().collect();
            if variants.is_empty() {
                variants.push(Variant::alone(layer.texel));
            }
            let total: f64 = variants.iter().map(|v| v.weight).sum();
            let mut cumulative = 0.0;
            let choices = variants
                .into_iter()
                .map(|Variant { texel, weight, phong }| {
                    let texel_ref = scene.texels.get(texel);
                    let frames = texel_ref.map_or(1, |t| t.following + 1);
                    let missing =
                        || Error::Options(format!("the scene's shells use texel {texel}, which is not there"));
                    let content = cells::texel_frames(texel, frames, info)?.ok_or_else(missing)?.content;
                    let cycle = texel_ref.and_then(|t| t.cycle);
                    cumulative += weight / total;
                    let phong = phong.within(&layer.phong);
                    let tint = Vec3::from_array(phong.diffuse.map(|v| v as f32));
                    let phong = phongs.number(&phong);
                    Ok(TexelChoice { texel, frames, cycle, cumulative, content, tint, phong })
                })
                .collect::<Result<Vec<_>>>()?;
            Ok(TexelLayer { rank, ..TexelLayer::new(layer.clone(), choices) })
        })
        .collect()
}
