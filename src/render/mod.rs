//! The renderer: from a scene to a film, by one or a few cones per pixel through meshes and shells full of texels.
//!
//! Units: world space in metres, radiance linear Rec. 709. A directional light's intensity is the irradiance on a surface
//! that faces it; a diffuse facet reflects albedo / π · E · max(0, n·l) · visibility + albedo · sky.

mod adaptive;
mod affine;
mod air;
mod bvh;
mod camera;
mod cards;
mod cells;
mod copies;
mod copy_segment;
mod curved;
mod environment;
mod environment_light;
pub mod error;
mod events;
#[cfg(feature = "bake")]
pub mod expand;
mod faces;
mod film;
pub mod image_io;
mod jitter;
mod lane;
mod layer;
mod light;
mod lighting;
mod mask;
mod mesh;
pub mod metrics;
mod options;
mod phong;
mod pixel;
mod placement;
mod prepare;
pub mod preview;
pub mod reference;
mod segments;
pub mod session;
mod shadow;
mod shared_shadow;
mod shell;
mod sky;
mod source_lod;
mod source_mesh;
mod stats;
pub mod stress;
#[cfg(test)]
mod tests;
mod tile;
mod tone;
mod trace;
mod weld;

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

pub use environment::DEFAULT_TURBIDITY;
pub use film::Film;
pub use light::{LUMENS_PER_WATT, photometric};
pub use options::{Ambient, CameraChoice, CropWindow, Options, Sky, SourceLod, SunPosition};
pub use placement::hash;
pub use prepare::picture_size;
pub use stats::{Counts, Stats, peak_memory};
pub use tile::{Tile, stitch};
pub use tone::Tone;
pub use trace::{Trace, TraceEvent};

pub use crate::march::transmittance::{DepthChoice, MarchSegment, MarchStats, Sink, VoxelHit, march, transmittance};

use crate::format::{Limits, Reader};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::scene::shell::TexelRef;
use crate::volume::octree::Pages;
use crate::volume::palette::Restyled;
use crate::volume::{Octree, Palette, Volume};
use crate::{Error, Result, Warnings, par};
use pixel::Tracer;
use prepare::World;

/// A rendered picture with statistics and messages.
#[derive(Debug, Clone)]
pub struct Rendered {
    /// The picture.
    pub film: Film,
    /// Counts of what its rays met, and times.
    pub stats: Stats,
    /// Warnings about what was mended or left out, counted.
    pub warnings: Warnings,
    /// Notes about choices that neither caller nor file made, a line each.
    pub notes: Vec<String>,
}

/// Render a scene. Its texels are opened from the files that it names, and only the pages that some cone needs are read.
///
/// # Errors
/// `Io`, `Input` and `Unsupported` as reading a texel gives; `Options` where an option is out of range, there is no such camera, or a
/// texel that is used is missing; `Limit` where the scene takes more memory than `options.memory`, or the picture is too large.
pub fn render(scene: &Scene, options: &Options, progress: &dyn Progress) -> Result<Rendered> {
    let opened = Opened::new(scene)?;
    let mut rendered = render_with(scene, opened.trees()?, options, progress)?;
    opened.count(&mut rendered.stats, &mut rendered.warnings);
    Ok(rendered)
}

/// Render with given texels: `texels[i]` stands for the scene's texel i, whatever file that names.
///
/// # Errors
/// As [`render`].
pub fn render_with(
    scene: &Scene,
    texels: Vec<Option<Octree>>,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Rendered> {
    check(options)?;
    par::with_threads(options.threads, || {
        let start = Instant::now();
        progress.stage("prepare", 0);
        let mut world = World::new(scene, into_shared(texels), options)?;
        let prepared = Instant::now();
        let (film, counts) = adaptive::film(&world, options, progress);
        let mut stats = Stats {
            counts,
            shell_boxes: world.items() as u64,
            patches: world.patches(),
            split_patches: world.split_patches,
            times: vec![("prepare", prepared - start), ("trace", prepared.elapsed())],
            peak_bytes: peak_memory(),
            ..Stats::default()
        };
        for texel in std::mem::take(&mut world.texels).into_iter().flatten() {
            let decoded = texel.tree.decoded();
            stats.bricks += decoded.pages;
            stats.voxels += decoded.voxels;
            stats.deepest = stats.deepest.max(decoded.deepest);
            if let Some(source) = texel.source.and_then(Arc::into_inner) {
                stats.near_triangles += source.finish(&mut world.warnings);
            }
            if let Some(failure) = Arc::into_inner(texel.tree).and_then(Octree::into_failure) {
                return Err(failure);
            }
        }
        Ok(Rendered {
            film,
            stats,
            warnings: std::mem::take(&mut world.warnings),
            notes: std::mem::take(&mut world.notes),
        })
    })?
}

/// Record everything that the rays of the pixel `at` (column and row, from the upper left) meet.
///
/// # Errors
/// `Options` where the pixel is outside of the picture; else as [`render`].
pub fn trace_pixel(scene: &Scene, options: &Options, at: [u32; 2]) -> Result<Trace> {
    check(options)?;
    if at[0] >= options.size[0] || at[1] >= options.size[1] {
        return Err(Error::Options(format!(
            "pixel {},{} lies outside of the {}×{} picture",
            at[0], at[1], options.size[0], options.size[1]
        )));
    }
    let world = World::new(scene, into_shared(Opened::new(scene)?.trees()?), options)?;
    let mut tracer = Tracer::new(&world, options);
    tracer.trace = Some(Trace::new());
    adaptive::trace_pixel(&mut tracer, at);
    Ok(tracer.trace.take().unwrap_or_default())
}

/// The texels in reference counters, since a session shares them between pictures.
fn into_shared(texels: Vec<Option<Octree>>) -> Vec<Option<Arc<Octree>>> {
    texels.into_iter().map(|tree| tree.map(Arc::new)).collect()
}

fn check(options: &Options) -> Result<()> {
    let [width, height] = options.size;
    if !(1..=65_536).contains(&width) || !(1..=65_536).contains(&height) {
        return Err(Error::Options(format!("a picture of {width}×{height} pixels: each side must be 1 … 65536")));
    }
    let window = options.window();
    if !window.is_within(options.size) {
        let [x, y, w, h] = [window.at[0], window.at[1], window.size[0], window.size[1]];
        let what = format!("a tile of {w}×{h} pixels at {x},{y} does not lie in the picture of {width}×{height}");
        return Err(Error::Options(what));
    }
    let pixels = u64::from(window.size[0]) * u64::from(window.size[1]);
    if pixels > image_io::MAX_PIXELS {
        return Err(Error::Limit {
            what: "the picture's pixels".into(),
            needed: pixels,
            allowed: image_io::MAX_PIXELS,
        });
    }
    if !matches!(options.lanes, 1 | 2 | 4 | 8 | 16) {
        return Err(Error::Options(format!("{} lanes: it must be 1, 2, 4, 8 or 16", options.lanes)));
    }
    Ok(())
}

/// Origin of a texel's voxels.
enum Store {
    File(Arc<Reader>),
    Memory(Arc<Volume>),
}

/// The texels that a scene's shells and copies use, opened.
struct Opened {
    /// One per texel of the scene, with its palette; `None` for texels that nothing uses.
    texels: Vec<Option<(Store, Palette)>>,
    warnings: Warnings,
}

impl Opened {
    fn new(scene: &Scene) -> Result<Opened> {
        let mut opened = Opened { texels: Vec::with_capacity(scene.texels.len()), warnings: Warnings::default() };
        for (texel, used) in scene.texels.iter().zip(prepare::used_texels(scene)) {
            let store = match (&texel.memory, texel.frames.first()) {
                _ if !used => None,
                (Some(volume), _) => Some(Store::Memory(Arc::clone(volume))),
                (None, Some(path)) => Some(Store::File(opened.file(path, texel)?)),
                (None, None) => None,
            };
            opened.texels.push(store.map(|store| (store, texel.palette.clone())));
        }
        Ok(opened)
    }

    /// The reader of a texel's first frame, which is at `path`. Texels that differ only in their palettes share the reader.
    fn file(&mut self, path: &Path, texel: &TexelRef) -> Result<Arc<Reader>> {
        if let Some(known) = self.readers().find(|reader| reader.path() == path) {
            return Ok(Arc::clone(known));
        }
        let limits = Limits::default();
        let reader = match &texel.bytes {
            Some(bytes) => Reader::from_bytes(path, Arc::clone(bytes), &limits)?,
            None => Reader::open_prefix(path, &limits)?,
        };
        if texel.content_id.is_some_and(|id| id != reader.head().content_id()) {
            let path = path.display();
            self.warnings.add(format!("{path}: is not the texel that the landscape was made for (contentId)"));
        }
        self.warnings.merge(reader.warnings());
        Ok(Arc::new(reader))
    }

    fn readers(&self) -> impl Iterator<Item = &Arc<Reader>> {
        self.texels.iter().flatten().filter_map(|(store, _)| match store {
            Store::File(reader) => Some(reader),
            Store::Memory(_) => None,
        })
    }

    fn trees(&self) -> Result<Vec<Option<Octree>>> {
        fn tree<P: Pages + 'static>(pages: Arc<P>, palette: &Palette) -> Result<Octree> {
            if palette.is_plain() { Octree::new(pages) } else { Octree::new(Restyled::new(pages, palette)) }
        }
        let open = |(store, palette): &(Store, Palette)| match store {
            Store::File(reader) => tree(Arc::clone(reader), palette),
            Store::Memory(volume) => tree(Arc::clone(volume), palette),
        };
        self.texels.iter().map(|texel| texel.as_ref().map(open).transpose()).collect()
    }

    fn count(&self, stats: &mut Stats, warnings: &mut Warnings) {
        let mut counted: Vec<&Arc<Reader>> = Vec::new();
        for reader in self.readers() {
            if counted.iter().any(|known| Arc::ptr_eq(known, reader)) {
                continue;
            }
            counted.push(reader);
            stats.bytes_read += reader.bytes_read();
            stats.bytes_in_files += reader.file_bytes();
        }
        warnings.merge(self.warnings.clone());
    }
}
