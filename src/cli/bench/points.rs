//! The points of one scene: its texels are baked, its reference traced, and every way to make the picture is timed and compared.

use serde::Serialize;

use super::context::{Bench, timed};
use super::made::{Made, Recipe};
use super::scenes::Place;
use crate::bake::REFINE;
use crate::cli::reference;
use crate::cli::render_stats::PerPixel;
use crate::progress::Quiet;
use crate::render::metrics;
use crate::render::metrics::flip::DEFAULT_PPD;
use crate::render::reference::{Reference, reference as trace};
use crate::render::{Film, Options, SourceLod, Tone, render};
use crate::{Error, Result};

/// One way to make a picture, or the texel for it.
#[derive(Debug, Clone, Serialize)]
pub struct Point {
    pub scene: &'static str,
    /// `render`, `reference`, or `bake`: then the seconds are the bake's, and the error that of the picture with one lane. With a
    /// peer, `peer`, or `same`: then the error is that of the peer's picture against ours of the same samples.
    pub kind: &'static str,
    pub model: &'static str,
    pub resolution: u32,
    pub refine: u8,
    /// `all` of it; without `shadows`; or only a constant white `sky`: then opacity and colour are all that there is.
    pub light: &'static str,
    pub lanes: u32,
    pub depth_bias: f64,
    pub shadow_bias: f64,
    /// Whether triangles stand for voxels that are wider than a pixel.
    pub near: bool,
    /// Samples a pixel, of a reference.
    pub samples: u32,
    pub seconds: f64,
    /// 0 where the system does not tell.
    pub cpu_seconds: f64,
    pub flip: f64,
    pub rmse: f64,
    /// Mean luminance over the reference's, less 1.
    pub bias: f64,
    /// Covered area over the reference's.
    pub area: f64,
    /// FLIP between the halves of the reference.
    pub noise: f64,
    /// CPU seconds of it that pass before the first ray; 0 where they are not told apart.
    pub setup_cpu: f64,
    /// What its rays met; of renders.
    pub per_pixel: PerPixel,
}

impl Point {
    /// A picture of one lane as it is made where nothing else is asked for, not made yet; voxels alone.
    pub fn blank(place: &Place) -> Point {
        Point {
            scene: place.name,
            kind: "render",
            model: "coverage",
            resolution: place.resolution,
            refine: REFINE,
            light: "all",
            lanes: 1,
            depth_bias: 0.0,
            shadow_bias: 0.0,
            near: false,
            samples: 0,
            seconds: 0.0,
            cpu_seconds: 0.0,
            flip: 0.0,
            rmse: 0.0,
            bias: 0.0,
            area: 0.0,
            noise: 0.0,
            setup_cpu: 0.0,
            per_pixel: PerPixel::default(),
        }
    }

    /// Seconds that count: CPU time where it is known, as others' load does not count.
    pub fn time(&self) -> f64 {
        if self.cpu_seconds > 0.0 { self.cpu_seconds } else { self.seconds }
    }
}

/// The first sample of traced baselines: none that a reference has.
const OTHER_SAMPLES: u32 = 1 << 24;

impl Bench<'_> {
    /// All points of a scene.
    pub fn scene(&self, place: &Place) -> Result<Vec<Point>> {
        let source = self.source(place)?;
        let whole = Recipe::plain(place.resolution);
        let truth = self.made(place, &source, whole)?;
        let options = self.options(&place.layout, &truth)?;
        let reference = self.reference(place.name, &truth, &options)?;
        let blank = Point { noise: reference.noise(DEFAULT_PPD)?.all.flip, ..Point::blank(place) };
        let mut points = Vec::new();
        for way in self.ways(&blank) {
            points.push(shown(&truth, &options, &reference, way)?);
        }
        for how in self.recipes(whole) {
            let made = self.made(place, &source, how)?;
            let Recipe { model, resolution, refine } = how;
            let point = shown(&made, &options, &reference, Point { model, resolution, refine, ..blank.clone() })?;
            let [seconds, cpu_seconds] = made.bake;
            if model != "density" {
                points.push(Point { kind: "bake", seconds, cpu_seconds, ..point.clone() });
            }
            if how != whole {
                points.push(point);
            }
        }
        for samples in [1, 4, 16, 64] {
            if self.quick && samples > 16 {
                continue;
            }
            let range = OTHER_SAMPLES..OTHER_SAMPLES + samples;
            let (seconds, done) = timed(|| trace(&truth.scene, &options, range, &Quiet));
            let point = Point { kind: "reference", model: "triangles", samples, ..blank.clone() };
            points.push(compared(point, &done?.film, &reference, seconds)?);
        }
        if !self.quick {
            points.extend(self.terms(place, truth, &options, &blank)?);
        }
        Ok(points)
    }

    /// How the texel of full resolution is rendered: lanes, depths of what is seen and of its shadows, triangles where near.
    fn ways(&self, blank: &Point) -> Vec<Point> {
        let all_lanes: &[u32] = if self.quick { &[1, 4] } else { &[1, 2, 4, 8] };
        let mut ways = Vec::new();
        for &lanes in all_lanes {
            let plain = Point { lanes, ..blank.clone() };
            ways.push(plain.clone());
            if lanes != 1 && lanes != 4 {
                continue;
            }
            ways.push(Point { near: true, ..plain.clone() });
            if !self.quick {
                ways.extend([-1.0, -0.5, 0.5].map(|depth_bias| Point { depth_bias, ..plain.clone() }));
                ways.extend([-2.0, -1.0, 1.0].map(|shadow_bias| Point { shadow_bias, ..plain.clone() }));
            }
        }
        ways
    }

    /// Resolutions, models and levels of refining.
    fn recipes(&self, whole: Recipe) -> Vec<Recipe> {
        let mut recipes = Vec::new();
        let coarser = [1, 2, 4].map(|k| whole.resolution / k);
        for resolution in coarser.into_iter().filter(|&r| r >= 8 && (!self.quick || r == whole.resolution)) {
            recipes.extend(["coverage", "neyret", "density"].map(|model| Recipe { model, resolution, ..whole }));
            let levels: &[u8] = if self.quick { &[0] } else { &[0, 1, 4] };
            recipes.extend(levels.iter().map(|&refine| Recipe { refine, resolution, ..whole }));
        }
        recipes
    }

    /// One cause of error after the other switched off on both sides: shadows, then all light but that of a constant sky.
    fn terms(&self, place: &Place, mut truth: Made, options: &Options, blank: &Point) -> Result<Vec<Point>> {
        let mut points = Vec::new();
        for light in ["shadows", "sky"] {
            if light == "sky" {
                // Without any, a sun would be added.
                truth.scene.model.lights.iter_mut().for_each(|l| l.intensity = [0.0; 3]);
            }
            let sky = if light == "sky" { Some([1.0; 3].into()) } else { options.sky.clone() };
            let options = Options { shadows: false, sky, ..options.clone() };
            let reference = self.reference(&format!("{}-{light}", place.name), &truth, &options)?;
            let noise = reference.noise(DEFAULT_PPD)?.all.flip;
            for lanes in [1, 4] {
                points.push(shown(&truth, &options, &reference, Point { light, lanes, noise, ..blank.clone() })?);
            }
        }
        Ok(points)
    }

    /// The truth under that name; what is stored of it is gone on from.
    fn reference(&self, name: &str, of: &Made, options: &Options) -> Result<Reference> {
        let stored = self.folder.join(format!("{name}-{}x{}.exr", options.size[0], options.size[1]));
        let job = reference::Job {
            moment: String::new(),
            tone: Tone::None,
            landscape: &of.path,
            scene: &of.scene,
            scene_name: None,
            options,
            samples: self.samples,
            output: &stored,
        };
        match job.run(true, self.ui) {
            // What is stored is of another scene, or was made with other options.
            Err(Error::Input { path, .. }) if path == stored => {
                std::fs::remove_file(&stored).map_err(|e| Error::io(&stored, e))?;
                job.run(true, self.ui)
            }
            other => other,
        }
        .map(|done| done.0)
    }
}

/// A picture made that way, timed and compared.
pub fn shown(made: &Made, options: &Options, reference: &Reference, way: Point) -> Result<Point> {
    let source_lod = if way.near { SourceLod::Geometry } else { SourceLod::Voxels };
    let (lanes, depth_bias, shadow_bias) = (way.lanes, way.depth_bias, way.shadow_bias);
    let options = Options { lanes, depth_bias, shadow_bias, source_lod, ..options.clone() };
    let (seconds, done) = timed(|| render(&made.scene, &options, &Quiet));
    let done = done?;
    // The stages' times are by the clock.
    let share = |name: &str| done.stats.times.iter().find(|t| t.0 == name).map_or(0.0, |t| t.1.as_secs_f64());
    let (before, after) = (share("prepare"), share("trace"));
    let setup_cpu = seconds[1] * before / (before + after).max(1e-9);
    let mut per_pixel = PerPixel::of(&done.stats, options.size, options.threads);
    if seconds[1] > 0.0 {
        // By the processor's time where it is known, as others' load does not count.
        per_pixel.microseconds = 1e6 * (seconds[1] - setup_cpu) / f64::from(options.size[0] * options.size[1]);
    }
    compared(Point { setup_cpu, per_pixel, ..way }, &done.film, reference, seconds)
}

pub fn compared(point: Point, film: &Film, reference: &Reference, [seconds, cpu_seconds]: [f64; 2]) -> Result<Point> {
    let options = metrics::Options { ppd: DEFAULT_PPD, background: None };
    let found = metrics::compare(&film.image(), &reference.film.image(), &options)?;
    Ok(Point {
        seconds,
        cpu_seconds,
        flip: found.all.flip,
        rmse: found.all.rmse,
        bias: found.all.relative_bias.unwrap_or(0.0),
        area: found.area.and_then(|a| a.ratio).unwrap_or(0.0),
        ..point
    })
}
