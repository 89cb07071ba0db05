//! How many lanes each pixel of a picture takes: one or two, and where its neighbours differ all that are asked for, or more along
//! edges of the triangles of texels' sources, which are not prefiltered.
//!
//! Based on: T. Whitted, *An Improved Illumination Model for Shaded Display*, CACM 1980 (more rays where pixels differ);
//! D. Mitchell, *Generating Antialiased Images at Low Sampling Densities*, SIGGRAPH 1987 (contrast as the eye sees it);
//! D. Kirk, J. Arvo, *Unbiased Sampling Techniques for Image Synthesis*, SIGGRAPH 1991 (samples that decide how many are taken must
//! not be counted).
//!
//! A picture is made in two passes. The first gives every pixel one or two lanes. The second adds some to pixels whose neighbours
//! differ from each other. The pixel's own value has no say in it: a bright spot that is smaller than a pixel would get more lanes
//! exactly where the first one hits it, which makes the picture too dark.

use glam::Vec4;

use super::film::Film;
use super::lane::Lane;
use super::options::{CropWindow, Options};
use super::pixel::Tracer;
use super::prepare::World;
use super::stats::Counts;
use super::trace::TraceEvent;
use crate::geom::Vec3;
use crate::par;
use crate::progress::Progress;

/// Edge of the tiles that threads render, pixels.
const TILE: u32 = 16;

/// Number of lanes that are added to a single one where triangles of a source are seen. Else the number is doubled there.
const ADDED_TO_ONE: u32 = 2;

/// The neighbours of a pixel of one or two lanes differ if the square roots of their values (the display's white is 1) do by more than
/// this; of twice as many lanes, by half of it, and so on, since so does what is left of the noise.
///
/// Of 512 trees from near at 640×360 and one lane (FLIP, cones a pixel, bias of luminance): never .0432, 1, −.1 %; by this .0301, 1.64,
/// −.1 %; by 1/12 .0315, 1.52; by 1/30 .0286, 1.80; always .0266, 3. Where the pixel is compared with its neighbours, .0303 at 1.52
/// cones, but −.3 %; with four lanes added, .0299 at 1.80. With two added by the difference between lanes of the pixel itself, .0380 at
/// 2.05. Of 25 000 trees from afar at four lanes (FLIP, time of one lane): always .0215, 3.9; by 1/32 .0219, 3.1; by 1/16 .0227, 2.3, which
/// is no better than two lanes.
const MAX_DIFFERENCE: f32 = 1.0 / 16.0;

/// Radiance and cover of a pixel's lanes, in few bytes, since a picture has many of them.
#[derive(Clone, Copy, Default)]
pub struct Pixel {
    sum: [f32; 4],
    /// At most 32.
    count: u8,
    /// Whether a texel's source was traced.
    sees_source: bool,
}

impl Pixel {
    /// The mean over the lanes, before exposure.
    fn mean(&self) -> Vec4 {
        Vec4::from_array(self.sum) / f32::from(self.count)
    }

    fn add(&mut self, tracer: &mut Tracer<'_>, at: [u32; 2], lane: u32, lanes: u32) {
        self.sum = (Vec4::from_array(self.sum) + lane_of(tracer, at, lane, lanes)).to_array();
        self.count += 1;
    }

    /// The lanes that every pixel takes, at the column and row `at`: one, or the first and the last.
    pub fn first(tracer: &mut Tracer<'_>, at: [u32; 2]) -> Pixel {
        let lanes = tracer.options.lanes;
        tracer.uses_source_geometry = false;
        let mut pixel = Pixel::default();
        pixel.add(tracer, at, 0, lanes);
        if lanes > 1 {
            pixel.add(tracer, at, lanes - 1, lanes);
        }
        Pixel { sees_source: tracer.uses_source_geometry, ..pixel }
    }

    /// The lanes that are added at edges.
    fn add_more(&mut self, tracer: &mut Tracer<'_>, at: [u32; 2]) {
        let lanes = tracer.options.lanes;
        (1..lanes.saturating_sub(1)).for_each(|lane| self.add(tracer, at, lane, lanes));
        if self.sees_source {
            let (more, count) = if lanes == 1 { (0..ADDED_TO_ONE, ADDED_TO_ONE) } else { (lanes..2 * lanes, lanes) };
            more.for_each(|lane| self.add(tracer, at, lane, count));
        }
    }

    /// Whether lanes are to be added, by the neighbours, to a pixel of `lanes`.
    fn is_by_edge<'a>(&self, neighbours: impl Iterator<Item = &'a Pixel>, lanes: u32, exposure: f32) -> bool {
        if lanes <= 2 && !self.sees_source {
            return false;
        }
        let (mut low, mut high) = (Vec4::INFINITY, Vec4::NEG_INFINITY);
        for neighbour in neighbours {
            let shown = neighbour.mean() * Vec3::splat(exposure).extend(1.0);
            // Four times white is as bright as it gets, whatever the tone curve.
            let seen = shown.clamp(Vec4::ZERO, Vec4::splat(4.0)).map(f32::sqrt);
            (low, high) = (low.min(seen), high.max(seen));
        }
        (high - low).max_element() > MAX_DIFFERENCE * 2.0 / lanes.max(2) as f32
    }
}

/// The four neighbours of the pixel `at` that lie within a picture of `size`.
fn neighbours([x, y]: [u32; 2], size: [u32; 2]) -> impl Iterator<Item = [u32; 2]> {
    let around = [[x.wrapping_sub(1), y], [x + 1, y], [x, y.wrapping_sub(1)], [x, y + 1]];
    around.into_iter().filter(move |&[x, y]| x < size[0] && y < size[1])
}

/// Trace one pixel as [`film`] does. If the tracer has a trace, the rays of this pixel are in it, and not those of its neighbours.
pub fn trace_pixel(tracer: &mut Tracer<'_>, at: [u32; 2]) {
    let mut pixel = Pixel::first(tracer, at);
    let trace = tracer.trace.take();
    let around: Vec<Pixel> = neighbours(at, tracer.options.size).map(|at| Pixel::first(tracer, at)).collect();
    tracer.trace = trace;
    if pixel.is_by_edge(around.iter(), tracer.options.lanes, tracer.exposure) {
        pixel.add_more(tracer, at);
    }
}

/// The picture of the options' window, and what its rays met.
pub fn film(world: &World<'_>, options: &Options, progress: &dyn Progress) -> (Film, Counts) {
    let window = options.window();
    let may_add = options.lanes > 2 || world.texels.iter().flatten().any(|texel| texel.source.is_some());
    // The neighbours of its pixels, too, so that a window has the same pixels as the picture.
    let traced = if may_add { grown(&window, options.size) } else { window };
    let mut pass = Pass::new(world, options, traced);
    let tiles = tiles(&pass.window);
    progress.stage("render", tiles.len() as u64);
    pass.trace(tiles.len(), |i| in_window(&tiles[i]).collect(), progress, |tracer, at, _| Pixel::first(tracer, at));
    let exposure = (options.exposure as f32).exp2();
    let is_by_edge = |at: &[u32; 2]| {
        let around = neighbours(*at, options.size).map(|at| pass.pixel(at));
        window.contains(*at) && pass.pixel(*at).is_by_edge(around, options.lanes, exposure)
    };
    let of_edges = |tile: &CropWindow| in_window(tile).filter(is_by_edge).collect();
    let edges: Vec<Vec<[u32; 2]>> = tiles.iter().map(of_edges).filter(|tile: &Vec<_>| !tile.is_empty()).collect();
    if !edges.is_empty() {
        progress.stage("edges", edges.len() as u64);
        let more = |tracer: &mut Tracer<'_>, at, mut pixel: Pixel| {
            pixel.add_more(tracer, at);
            pixel
        };
        pass.trace(edges.len(), |i| edges[i].clone(), progress, more);
    }
    let [width, height] = window.size;
    let pixels = in_window(&window).map(|at| pass.pixel(at).mean().to_array()).collect();
    let mut film = Film { width, height, pixels };
    film.expose(exposure);
    pass.counts.merge(&world.sky.counts());
    (film, pass.counts)
}

/// The pixels of a window while their lanes are traced.
struct Pass<'w> {
    world: &'w World<'w>,
    options: &'w Options,
    window: CropWindow,
    pixels: Vec<Pixel>,
    counts: Counts,
}

impl<'w> Pass<'w> {
    fn new(world: &'w World<'w>, options: &'w Options, window: CropWindow) -> Pass<'w> {
        let count = window.size[0] as usize * window.size[1] as usize;
        Pass { world, options, window, pixels: vec![Pixel::default(); count], counts: Counts::default() }
    }

    fn index(&self, [x, y]: [u32; 2]) -> usize {
        let CropWindow { at: [left, top], size: [width, _] } = self.window;
        (y - top) as usize * width as usize + (x - left) as usize
    }

    fn pixel(&self, at: [u32; 2]) -> &Pixel {
        &self.pixels[self.index(at)]
    }

    /// Replace the pixels of `groups` groups by what `pixel` makes of their columns and rows and of themselves; each group in one
    /// thread. `group(i)` lists columns and rows.
    fn trace(
        &mut self,
        groups: usize,
        group: impl Fn(usize) -> Vec<[u32; 2]> + Sync + Send,
        progress: &dyn Progress,
        pixel: impl Fn(&mut Tracer<'_>, [u32; 2], Pixel) -> Pixel + Sync + Send,
    ) {
        let traced = par::map(groups, |i| {
            let mut tracer = Tracer::new(self.world, self.options);
            let pixels: Vec<Pixel> = group(i).into_iter().map(|at| pixel(&mut tracer, at, *self.pixel(at))).collect();
            progress.advance(1);
            (pixels, tracer.counts)
        });
        for (i, (pixels, counts)) in traced.into_iter().enumerate() {
            self.counts.merge(&counts);
            for (at, pixel) in group(i).into_iter().zip(pixels) {
                let index = self.index(at);
                self.pixels[index] = pixel;
            }
        }
    }
}

/// The window with a rim of one pixel, as far as the picture reaches.
fn grown(window: &CropWindow, size: [u32; 2]) -> CropWindow {
    let at = window.at.map(|n| n.saturating_sub(1));
    let end = [0, 1].map(|k| (window.at[k] + window.size[k] + 1).min(size[k]));
    CropWindow { at, size: [end[0] - at[0], end[1] - at[1]] }
}

/// The tiles of a window, row by row.
fn tiles(window: &CropWindow) -> Vec<CropWindow> {
    let [width, height] = window.size;
    let corners =
        (0..height).step_by(TILE as usize).flat_map(|y| (0..width).step_by(TILE as usize).map(move |x| [x, y]));
    let tile = |[x, y]: [u32; 2]| CropWindow {
        at: [window.at[0] + x, window.at[1] + y],
        size: [TILE.min(width - x), TILE.min(height - y)],
    };
    corners.map(tile).collect()
}

/// Columns and rows of a window's pixels, row by row.
fn in_window(window: &CropWindow) -> impl Iterator<Item = [u32; 2]> + use<> {
    let CropWindow { at: [left, top], size: [width, height] } = *window;
    (top..top + height).flat_map(move |y| (left..left + width).map(move |x| [x, y]))
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

#[cfg(test)]
mod tests {
    use super::*;

    fn pixel(value: f32, sees_source: bool) -> Pixel {
        Pixel { sum: [3.0 * value; 4], count: 3, sees_source }
    }

    #[test]
    fn edges_are_where_neighbours_differ_as_the_eye_sees_it() {
        let own = pixel(0.9, true);
        let of_lanes = |own: &Pixel, values: &[f32], lanes: u32, exposure: f32| {
            let around: Vec<Pixel> = values.iter().map(|v| pixel(*v, false)).collect();
            own.is_by_edge(around.iter(), lanes, exposure)
        };
        let is_by_edge = |own: &Pixel, values: &[f32], exposure: f32| of_lanes(own, values, 1, exposure);
        // However bright the pixel itself is.
        assert!(!is_by_edge(&own, &[0.2; 4], 1.0));
        assert!(is_by_edge(&own, &[0.2, 0.2, 0.3, 0.2], 1.0));
        assert!(!is_by_edge(&pixel(0.9, false), &[0.2, 0.2, 0.3, 0.2], 1.0), "voxels are prefiltered");
        // The same difference shows in the dark, and not in the light, nor beyond what any display shows.
        assert!(is_by_edge(&own, &[0.01, 0.03], 1.0) && !is_by_edge(&own, &[0.91, 0.93], 1.0));
        assert!(!is_by_edge(&own, &[5.0, 50.0], 1.0) && is_by_edge(&own, &[5.0, 50.0], 0.01));
        assert!(!is_by_edge(&own, &[0.3], 1.0) && !is_by_edge(&own, &[], 1.0));
        // More lanes see smaller differences, and voxels too.
        let voxels = pixel(0.5, false);
        let with = |apart: f32, lanes: u32| of_lanes(&voxels, &[0.25, 0.25 + apart], lanes, 1.0);
        assert!(!with(0.5, 1) && !with(0.5, 2) && with(0.04, 4));
        assert!(!with(0.02, 4) && with(0.02, 8) && !with(0.005, 16) && with(0.01, 16));
    }

    #[test]
    fn windows_have_the_neighbours_of_their_pixels() {
        for (at, size, want) in [
            ([0, 0], [10, 7], [[0, 0], [10, 7]]),
            ([3, 2], [2, 1], [[2, 1], [4, 3]]),
            ([0, 6], [1, 1], [[0, 5], [2, 2]]),
            ([9, 0], [1, 7], [[8, 0], [2, 7]]),
        ] {
            let window = CropWindow { at, size };
            let grown = grown(&window, [10, 7]);
            assert_eq!([grown.at, grown.size], want);
            let all: Vec<[u32; 2]> = tiles(&grown).iter().flat_map(in_window).collect();
            assert_eq!(all.len() as u32, grown.size[0] * grown.size[1]);
            assert!(in_window(&window).flat_map(|at| neighbours(at, [10, 7])).all(|at| grown.contains(at)));
        }
        assert_eq!(neighbours([0, 3], [1, 4]).collect::<Vec<_>>(), [[0, 2]]);
    }
}
