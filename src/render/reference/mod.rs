//! Reference pictures: the source meshes of the texels, ray-traced through the same shells, as ground truth for pictures of texels.
//!
//! Based on: J. Kajiya, T. Kay, *Rendering Fur with Three Dimensional Textures*, SIGGRAPH 1989 (a straight ray is followed
//! through texture space); R. Cook, *Stochastic Sampling in Computer Graphics*, TOG 1986.

pub(super) mod sampling;
mod store;
#[cfg(test)]
mod tests;
mod trace;

use std::ops::Range;
use std::time::Instant;

pub use super::source_mesh::{SourceMesh, restyle};
use trace::Tracer;

use super::film::Film;
use super::options::{CropWindow, Options};
use super::prepare::World;
use super::stats::{Counts, Stats, peak_memory};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::scene::shell::TexelRef;
use crate::volume::Octree;
use crate::{Error, Result, Warnings, par};

/// A picture by many samples per pixel, with an estimate of its noise.
#[derive(Debug, Clone)]
pub struct Reference {
    /// Mean of all samples.
    pub film: Film,
    /// Means of the even and of the odd samples, which are independent: their difference is about twice the film's own noise.
    /// The same film twice where there is only one sample.
    pub halves: [Film; 2],
    /// Samples per pixel.
    pub samples: u32,
    /// Counts of what its rays met, and times.
    pub stats: Stats,
    /// Warnings about what was mended or left out, counted.
    pub warnings: Warnings,
    /// Choices that were made for want of better, a line each.
    pub notes: Vec<String>,
}

/// Trace samples `samples` of every pixel of a scene (box filter, one pixel wide) against the `geometry` that its texels
/// name. The `.vtex` files are opened for their placement alone. `options.lanes` and `depth_bias` have no effect.
///
/// Runs over parts of a range, weighted by their lengths, make up the run over all of it, and so do the halves of runs
/// over even numbers of samples. Same bytes for any number of threads.
///
/// # Errors
/// `Options` where `samples` is empty or a texel that is used names no geometry; else as [`super::render`].
pub fn reference(scene: &Scene, options: &Options, samples: Range<u32>, progress: &dyn Progress) -> Result<Reference> {
    let mut warnings = Warnings::default();
    let opened = super::Opened::new(scene)?;
    warnings.merge(opened.warnings.clone());
    let trees = opened.trees()?;
    let open = |(tree, texel): (&Option<Octree>, &TexelRef)| {
        tree.as_ref().map(|tree| SourceMesh::of_texel(tree, texel, "trace", &mut warnings)).transpose()
    };
    let sources = trees.iter().zip(&scene.texels).map(open).collect::<Result<Vec<_>>>()?;
    let mut reference = reference_with(scene, trees, &sources, options, samples, progress)?;
    reference.warnings.merge(warnings);
    Ok(reference)
}

/// [`reference()`] with texels and their sources at hand: `texels[i]` and `sources[i]` stand for the scene's texel i.
pub fn reference_with(
    scene: &Scene,
    texels: Vec<Option<Octree>>,
    sources: &[Option<SourceMesh>],
    options: &Options,
    samples: Range<u32>,
    progress: &dyn Progress,
) -> Result<Reference> {
    super::check(options)?;
    if samples.is_empty() {
        return Err(Error::Options("a reference needs at least one sample a pixel".into()));
    }
    par::with_threads(options.threads, || {
        let start = Instant::now();
        progress.stage("prepare", 0);
        let mut world = World::new(scene, super::into_shared(texels), options)?;
        let prepared = Instant::now();
        let tracer = Tracer { world: &world, sources, options };
        let (film, halves, counts) = films(&tracer, samples.clone(), progress);
        let stats = Stats {
            counts,
            shell_boxes: world.items() as u64,
            patches: world.patches(),
            split_patches: world.split_patches,
            times: vec![("prepare", prepared - start), ("trace", prepared.elapsed())],
            peak_bytes: peak_memory(),
            ..Stats::default()
        };
        let (warnings, notes) = (std::mem::take(&mut world.warnings), std::mem::take(&mut world.notes));
        Ok(Reference { film, halves, samples: samples.end - samples.start, stats, warnings, notes })
    })?
}

/// The mean of all samples, and of the even and the odd ones.
fn films(tracer: &Tracer<'_>, samples: Range<u32>, progress: &dyn Progress) -> (Film, [Film; 2], Counts) {
    let CropWindow { at: [left, top], size: [width, height] } = tracer.options.window();
    progress.stage("trace", height.into());
    let rows = par::map(height as usize, |y| {
        let mut counts = Counts::default();
        let mut pixel = |x: u32| {
            let mut sums = [([0.0f64; 4], 0u32); 2];
            for index in samples.clone() {
                let (sum, n) = &mut sums[index as usize & 1];
                for (s, v) in sum.iter_mut().zip(tracer.sample(left + x, top + y as u32, index, &mut counts)) {
                    *s += f64::from(v);
                }
                *n += 1;
            }
            sums
        };
        let row: Vec<_> = (0..width).map(&mut pixel).collect();
        progress.advance(1);
        (row, counts)
    });
    let mut counts = Counts::default();
    let film = || Film { width, height, pixels: Vec::with_capacity(width as usize * height as usize) };
    let (mut whole, mut halves) = (film(), [film(), film()]);
    for (row, own) in rows {
        counts.merge(&own);
        for [(a, n), (b, m)] in row {
            let mean = |sum: [f64; 4], n: u32| sum.map(|s| (s / f64::from(n.max(1))) as f32);
            let all = mean(std::array::from_fn(|k| a[k] + b[k]), n + m);
            whole.pixels.push(all);
            halves[0].pixels.push(if n > 0 { mean(a, n) } else { all });
            halves[1].pixels.push(if m > 0 { mean(b, m) } else { all });
        }
    }
    let [first, second] = &mut halves;
    for film in [&mut whole, first, second] {
        film.expose((tracer.options.exposure as f32).exp2());
    }
    (whole, halves, counts)
}
