//! The points of one scene: its texels are baked, its reference traced, and every way to make the picture is timed and compared.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use super::scenes::{Layout, Matter, Place};
use super::{density, land};
use crate::cli::{Ui, demo, reference, run_words};
use crate::format::{Limits, Reader};
use crate::geom::DVec3;
use crate::progress::Quiet;
use crate::render::metrics::{self, flip::DEFAULT_PPD};
use crate::render::reference::{Reference, reference as trace};
use crate::render::{CameraChoice, Film, Near, Options, render};
use crate::scene::{Scene, gltf};
use crate::volume::Pages;
use crate::{Error, Result};

/// One way to make a picture, or the texel for it.
#[derive(Debug, Clone, Serialize)]
pub struct Point {
    pub scene: &'static str,
    /// `render`, `reference`, or `bake`: then the seconds are the bake's, and the error that of the picture with one lane.
    pub kind: &'static str,
    pub model: &'static str,
    pub resolution: u32,
    pub lanes: u32,
    pub depth_bias: f64,
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
}

pub struct Bench<'a> {
    pub folder: &'a Path,
    pub size: [u32; 2],
    /// A pixel, of references.
    pub samples: u32,
    pub quick: bool,
    pub ui: &'a Ui,
}

/// A landscape over one texel, and how long that took to bake.
struct Made {
    scene: Scene,
    path: PathBuf,
    bake: [f64; 2],
}

/// The first sample of traced baselines: none that a reference has.
const OTHER_SAMPLES: u32 = 1 << 24;

impl Bench<'_> {
    /// All points of a scene.
    pub fn scene(&self, place: &Place) -> Result<Vec<Point>> {
        let source = self.source(place)?;
        let truth = self.made(place, &source, "coverage", place.resolution)?;
        let options = self.options(place, &truth)?;
        let stored = self.folder.join(format!("{}-{}x{}.exr", place.name, options.size[0], options.size[1]));
        let job = reference::Job {
            landscape: &truth.path,
            scene: &truth.scene,
            scene_name: None,
            options: &options,
            samples: self.samples,
            output: &stored,
        };
        let (reference, _) = match job.run(true, self.ui) {
            // What is stored is of another scene, or was made with other options.
            Err(Error::Input { path, .. }) if path == stored => {
                std::fs::remove_file(&stored).map_err(|e| Error::io(&stored, e))?;
                job.run(true, self.ui)?
            }
            other => other?,
        };
        let noise = reference.noise(DEFAULT_PPD)?.all.flip;
        let blank = Point {
            scene: place.name,
            kind: "render",
            model: "coverage",
            resolution: place.resolution,
            lanes: 1,
            depth_bias: 0.0,
            near: false,
            samples: 0,
            seconds: 0.0,
            cpu_seconds: 0.0,
            flip: 0.0,
            rmse: 0.0,
            bias: 0.0,
            area: 0.0,
            noise,
        };
        let mut points = Vec::new();
        let shown = |made: &Made, point: Point| -> Result<Point> {
            let near = if point.near { Near::Geometry } else { Near::Voxels };
            let options = Options { lanes: point.lanes, depth_bias: point.depth_bias, near, ..options.clone() };
            let (seconds, done) = timed(|| render(&made.scene, &options, &Quiet));
            compared(point, &done?.film, &reference, seconds)
        };
        let all_lanes: &[u32] = if self.quick { &[1, 4] } else { &[1, 2, 4, 8] };
        let biases: &[f64] = if self.quick { &[0.0] } else { &[-1.0, -0.5, 0.0, 0.5] };
        for &lanes in all_lanes {
            for &depth_bias in biases.iter().filter(|&&b| b == 0.0 || lanes == 1 || lanes == 4) {
                points.push(shown(&truth, Point { lanes, depth_bias, ..blank.clone() })?);
            }
            if lanes == 1 || lanes == 4 {
                points.push(shown(&truth, Point { lanes, near: true, ..blank.clone() })?);
            }
        }
        for model in ["coverage", "neyret", "density"] {
            let coarser = [place.resolution, place.resolution / 2, place.resolution / 4];
            for resolution in coarser.into_iter().filter(|&r| r >= 8 && (!self.quick || r == place.resolution)) {
                let made = self.made(place, &source, model, resolution)?;
                let point = shown(&made, Point { model, resolution, ..blank.clone() })?;
                let [seconds, cpu_seconds] = made.bake;
                if model != "density" {
                    points.push(Point { kind: "bake", seconds, cpu_seconds, ..point.clone() });
                }
                if (model, resolution) != ("coverage", place.resolution) {
                    points.push(point);
                }
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
        Ok(points)
    }

    /// The file of the scene's matter.
    fn source(&self, place: &Place) -> Result<PathBuf> {
        match place.matter {
            Matter::Sample(name) => self.sample(name),
            Matter::Shape(make) => {
                let shape = make();
                let path = self.folder.join(format!("{}.glb", shape.name));
                land::object(&path, &shape)?;
                Ok(path)
            }
        }
    }

    fn sample(&self, name: &str) -> Result<PathBuf> {
        let path = self.folder.join(name);
        let bytes = demo::SAMPLES.iter().find(|s| s.0 == name).map_or(&[][..], |s| s.1);
        std::fs::write(&path, bytes).map_err(|e| Error::io(&path, e))?;
        Ok(path)
    }

    /// A command as it would be typed; gives seconds and CPU seconds.
    fn command(&self, words: &[&str]) -> Result<[f64; 2]> {
        let words: Vec<String> = words.iter().map(|w| (*w).to_owned()).collect();
        let (seconds, done) = timed(|| run_words(&words, &Ui::new(true, false)));
        done.map(|()| seconds)
    }

    /// The scene over a texel of that model and resolution; a texel that is there is not baked again, unless it is timed.
    fn made(&self, place: &Place, source: &Path, model: &'static str, resolution: u32) -> Result<Made> {
        let stem = source.file_stem().unwrap_or_default().to_string_lossy();
        let texel = self.folder.join(format!("{stem}-{resolution}-{model}.vtex"));
        let times = texel.with_extension("json");
        let (source, file) = (source.display().to_string(), texel.display().to_string());
        let known = std::fs::read(&times).ok().and_then(|text| serde_json::from_slice(&text).ok());
        let bake = match known.filter(|_| texel.exists()) {
            Some(bake) => bake,
            None if model == "density" => {
                let bake = self.made(place, Path::new(&source), "coverage", resolution)?.bake;
                let baked = self.folder.join(format!("{stem}-{resolution}-coverage.vtex"));
                density::write(Path::new(&source), &baked, &texel, &Ui::new(true, false))?;
                bake
            }
            None => {
                let side = resolution.to_string();
                let bake = self.command(&["bake", &source, "-r", &side, "--model", model, "-o", &file])?;
                std::fs::write(&times, serde_json::json!(bake).to_string()).map_err(|e| Error::io(&times, e))?;
                bake
            }
        };
        let path = self.folder.join(format!("{}-{resolution}-{model}.gltf", place.name));
        let (out, ground) = (path.display().to_string(), self.folder.join(format!("{}-ground.glb", place.name)));
        let under = ground.display().to_string();
        let common = ["map", &under, "--texel", &file, "--geometry", &source, "-o", &out];
        match place.layout {
            Layout::Alone => {
                let reader = Reader::open(&texel, &Limits::default())?;
                land::ground(&ground, 1, width(reader.info()), |_, _| 0.0)?;
                let still = ["--repeat", "1", "--orientations", "identity", "--scale", "1,1", "--displace", "0"];
                self.command(&[&common[..], &still, &["--surface", "hidden"]].concat())?;
            }
            Layout::Forest { side, hilly, presence, hedge, .. } => {
                let hills = |x: f64, z: f64| {
                    let (long, short) = (libm::sin(x / 170.0) * libm::cos(z / 210.0), libm::sin(x / 61.0 + z / 83.0));
                    40.0 * long + 12.0 * short
                };
                land::ground(&ground, side, 10.0 * f64::from(side), if hilly { hills } else { |_, _| 0.0 })?;
                let (cells, share) = (side.to_string(), presence.to_string());
                self.command(&[&common[..], &["--repeat", &cells, "--presence", &share]].concat())?;
                if hedge {
                    let fern = self.sample("fern.glb")?.display().to_string();
                    let texel = self.folder.join("hedge.vtex").display().to_string();
                    self.command(&["bake", &fern, "-r", "128", "-o", &texel])?;
                    let many = (side * 6).to_string();
                    self.command(&[
                        "map",
                        &out,
                        "--add",
                        "--texel",
                        &texel,
                        "--geometry",
                        &fern,
                        "--repeat",
                        &many,
                        "-o",
                        &out,
                    ])?;
                }
            }
        }
        Ok(Made { scene: gltf::read(&path, &gltf::ReadOptions::default())?, path, bake })
    }

    fn options(&self, place: &Place, made: &Made) -> Result<Options> {
        let sky = Some([0.3, 0.35, 0.4]);
        let common = Options { sky, background: Some([0.3, 0.35, 0.4]), ..Options::default() };
        let look =
            |eye: DVec3, target: DVec3, degrees: f64| CameraChoice::LookAt { eye, target, yfov: degrees.to_radians() };
        Ok(match place.layout {
            Layout::Alone => {
                let Some(texel) = made.scene.texels.first().and_then(|t| t.frames.first()) else {
                    return Err(Error::input(&made.path, "", "names no texel"));
                };
                let reader = Reader::open(texel, &Limits::default())?;
                let (info, wide) = (reader.info(), width(reader.info()));
                let high = 0.5 * (info.content.min.z + info.content.max.z) * wide;
                let target = DVec3::new(0.0, high, 0.0);
                let eye = target + wide * DVec3::new(2.1, 1.2, 3.2);
                // So that the cube's edge is as wide as the picture, at the middle.
                let degrees = 2.0 * libm::atan(0.5 * wide / eye.distance(target)).to_degrees();
                Options { size: [self.size[0] / 3; 2], camera: look(eye, target, degrees), ..common }
            }
            Layout::Forest { eye, target, .. } => {
                let camera = look(DVec3::from_array(eye), DVec3::from_array(target), 50.0);
                Options { size: self.size, camera, ..common }
            }
        })
    }
}

/// Metres along the texel's cube.
fn width(info: &crate::volume::Info) -> f64 {
    let metres = if info.metres_per_unit > 0.0 { info.metres_per_unit } else { 1.0 };
    info.bounds.size().x * metres
}

fn compared(point: Point, film: &Film, reference: &Reference, [seconds, cpu_seconds]: [f64; 2]) -> Result<Point> {
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

/// What `f` gives, and its seconds and CPU seconds.
fn timed<T>(f: impl FnOnce() -> T) -> ([f64; 2], T) {
    let (start, cpu) = (Instant::now(), cpu_seconds());
    let result = f();
    ([start.elapsed().as_secs_f64(), cpu_seconds() - cpu], result)
}

/// User and system time of this process, where the system tells (Linux; a tick is a hundredth of a second); else 0.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit_once(')').map_or(Vec::new(), |(_, rest)| rest.split_whitespace().collect());
    [11, 12].iter().filter_map(|&k| fields.get(k)?.parse::<f64>().ok()).sum::<f64>() / 100.0
}
