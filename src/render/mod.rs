//! The renderer: from a scene to a film, by one or a few cones per pixel through meshes and shells full of texels.
//!
//! Units: world space in metres, radiance linear Rec. 709. A directional light's intensity is the irradiance on a surface
//! that faces it; a diffuse facet reflects albedo / π · E · max(0, n·l) · visibility + albedo · sky.

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
use glam::Vec4;

use crate::geom::Vec3;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::scene::shell::TexelRef;
use crate::volume::octree::Pages;
use crate::volume::palette::Restyled;
use crate::volume::{Octree, Palette, Volume};
use crate::{Error, Result, Warnings, par};
use lane::Lane;
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
        let (film, counts) = film(&world, options, progress);
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
    pixel_of(&mut tracer, at[0], at[1]);
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

/// Edge of the tiles that threads render, pixels.
const TILE: u32 = 16;

fn film(world: &World<'_>, options: &Options, progress: &dyn Progress) -> (Film, Counts) {
    let CropWindow { at: [left, top], size: [width, height] } = options.window();
    let (across, down) = (width.div_ceil(TILE), height.div_ceil(TILE));
    let tiles = across as usize * down as usize;
    progress.stage("render", tiles as u64);
    let traced = par::map(tiles, |i| {
        let (x0, y0) = (i as u32 % across * TILE, i as u32 / across * TILE);
        let mut tracer = Tracer::new(world, options);
        let mut pixels = Vec::with_capacity((TILE * TILE) as usize);
        for y in y0..(y0 + TILE).min(height) {
            for x in x0..(x0 + TILE).min(width) {
                pixels.push(pixel_of(&mut tracer, left + x, top + y));
            }
        }
        progress.advance(1);
        (pixels, tracer.counts)
    });
    let mut film = Film { width, height, pixels: vec![[0.0; 4]; width as usize * height as usize] };
    let mut counts = Counts::default();
    for (i, (pixels, own)) in traced.into_iter().enumerate() {
        counts.merge(&own);
        let (x0, y0) = (i as u32 % across * TILE, i as u32 / across * TILE);
        let columns = (width - x0).min(TILE) as usize;
        for (row, chunk) in pixels.chunks(columns).enumerate() {
            let start = (y0 as usize + row) * width as usize + x0 as usize;
            film.pixels[start..start + columns].copy_from_slice(chunk);
        }
    }
    film.expose((options.exposure as f32).exp2());
    counts.merge(&world.sky.counts());
    (film, counts)
}

/// Number of lanes that are added to one or two lanes if a texel's source was traced, because triangles are not prefiltered.
const SOURCE_LANES: u32 = 2;

/// If the first and the last lane differ by no more than this (the display's white is 1), the other lanes are left out; but not where
/// there are triangles or cards, which may be thinner than the distance between lanes: a tree of plain triangles whose leaves are
/// smaller than a pixel lost 4 % of its area at sixteen lanes.
const SAME_BELOW: f32 = 1.0 / 256.0;

/// The mean over the pixel's lanes, before exposure.
fn pixel_of(tracer: &mut Tracer<'_>, x: u32, y: u32) -> [f32; 4] {
    let lanes = tracer.options.lanes;
    (tracer.uses_source_geometry, tracer.uses_fine_rays) = (false, false);
    let mut sum = Vec4::ZERO;
    let mut count = 0;
    let mut add = |tracer: &mut Tracer<'_>, lane: u32, lanes: u32| {
        let seen = lane_of(tracer, [x, y], lane, lanes);
        sum += seen;
        count += 1;
        seen
    };
    let first = add(tracer, 0, lanes);
    if lanes > 1 {
        let last = add(tracer, lanes - 1, lanes);
        let apart = (first - last).abs() * Vec3::splat(tracer.exposure).extend(1.0);
        let uneven = tracer.uses_source_geometry || tracer.uses_fine_rays;
        if uneven || apart.max_element() > SAME_BELOW || is_mesh_near(tracer.world, [x, y]) {
            (1..lanes - 1).for_each(|lane| {
                add(tracer, lane, lanes);
            });
        }
        if lanes == 2 && tracer.uses_source_geometry {
            // Otherwise a picture of two lanes would get fewer rays here than one of a single lane.
            (2..2 + SOURCE_LANES).for_each(|lane| {
                add(tracer, lane, lanes);
            });
        }
    } else if tracer.uses_source_geometry {
        (0..SOURCE_LANES).for_each(|lane| {
            add(tracer, lane, SOURCE_LANES);
        });
    }
    (sum / count as f32).to_array()
}

/// Whether there may be plain triangles in the pixel.
fn is_mesh_near(world: &World<'_>, [x, y]: [u32; 2]) -> bool {
    let cone = Lane { x, y, index: 0, count: 1 }.cone(&world.view, world.unit);
    world.mesh.is_near(&cone.ray, |t| lane::REACH * cone.width_at(t))
}

/// Radiance and cover of one lane of a pixel.
fn lane_of(tracer: &mut Tracer<'_>, [x, y]: [u32; 2], index: u32, count: u32) -> Vec4 {
    let world = tracer.world;
    let lane = Lane { x, y, index, count };
    let cone = lane.cone(&world.view, world.unit);
    if let Some(trace) = &mut tracer.trace {
        let width = cone.width * world.unit;
        trace.push(TraceEvent::Cone { direction: cone.ray.dir.to_array(), width, growth: cone.growth });
    }
    let (radiance, alpha) = tracer.cone(&cone, lane);
    if let Some(trace) = &mut tracer.trace {
        trace.push(TraceEvent::Radiance { rgb: radiance.to_array(), alpha });
    }
    radiance.extend(alpha)
}
