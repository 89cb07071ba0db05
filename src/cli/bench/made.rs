//! What a bench measures on, made once: sources, texels of each model, landscapes over them, and the cameras.

use std::path::{Path, PathBuf};

use super::context::{Bench, timed};
use super::scenes::{Layout, Matter, Place};
use super::{density, land};
use crate::bake::REFINE;
use crate::cli::{Ui, run_words, samples};
use crate::format;
use crate::format::{Limits, Reader};
use crate::geom::DVec3;
use crate::render::{CameraChoice, Options};
use crate::scene::{Scene, gltf};
use crate::volume::Pages;
use crate::{Error, Result};

/// How a texel is baked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recipe {
    /// `coverage`, `neyret`, or `density`: linear filtering.
    pub model: &'static str,
    pub resolution: u32,
    pub refine: u8,
}

impl Recipe {
    /// As `vtex bake` does where nothing else is said.
    pub fn plain(resolution: u32) -> Recipe {
        Recipe { model: "coverage", resolution, refine: REFINE }
    }
}

/// A landscape over one texel, and how long that took to bake.
pub struct Made {
    pub scene: Scene,
    pub path: PathBuf,
    pub texel: PathBuf,
    pub bake: [f64; 2],
}

impl Bench<'_> {
    /// The file of the scene's matter.
    pub fn source(&self, place: &Place) -> Result<PathBuf> {
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

    pub fn sample(&self, name: &str) -> Result<PathBuf> {
        let path = self.folder.join(name);
        let found = samples::find(&[name])?;
        format::save(&path, found.get(name).map_or(&[][..], Vec::as_slice))?;
        Ok(path)
    }

    /// A command as it would be typed; gives seconds and CPU seconds.
    fn command(&self, words: &[&str]) -> Result<[f64; 2]> {
        let words: Vec<String> = words.iter().map(|w| (*w).to_owned()).collect();
        let (seconds, done) = timed(|| run_words(&words, &Ui::new(true, false)));
        done.map(|()| seconds)
    }

    /// The texel of a source that is baked like that, and its seconds and CPU seconds; one that is there is not baked again.
    pub fn baked(&self, source: &Path, how: Recipe) -> Result<(PathBuf, [f64; 2])> {
        let Recipe { model, resolution, refine } = how;
        let stem = source.file_stem().unwrap_or_default().to_string_lossy();
        let texel = self.folder.join(format!("{stem}-{resolution}-{model}-{refine}.vtex"));
        let times = texel.with_extension("json");
        let known = format::read_file(&times, 1 << 20).ok().and_then(|text| serde_json::from_slice(&text).ok());
        let bake = match known.filter(|_| texel.exists()) {
            Some(bake) => bake,
            None if model == "density" => {
                let (baked, bake) = self.baked(source, Recipe { model: "coverage", ..how })?;
                density::write(source, &baked, &texel, &Ui::new(true, false))?;
                bake
            }
            None => {
                let (source, file) = (source.display().to_string(), texel.display().to_string());
                let (side, levels) = (resolution.to_string(), refine.to_string());
                let words = ["bake", &source, "-r", &side, "--model", model, "--refine", &levels, "-o", &file];
                let bake = self.command(&words)?;
                format::save(&times, serde_json::json!(bake).to_string().as_bytes())?;
                bake
            }
        };
        Ok((texel, bake))
    }

    /// The scene over a texel that is baked like that.
    pub fn made(&self, place: &Place, source: &Path, how: Recipe) -> Result<Made> {
        let (texel, bake) = self.baked(source, how)?;
        let Recipe { model, resolution, refine } = how;
        let path = self.folder.join(format!("{}-{resolution}-{model}-{refine}.gltf", place.name));
        self.laid(place.name, &place.layout, (&texel, source), &path)?;
        Ok(Made { scene: gltf::read(&path, &gltf::ReadOptions::default())?, path, texel, bake })
    }

    /// Write the landscape of a layout over a texel, whose source is known.
    pub fn laid(&self, name: &str, layout: &Layout, (texel, source): (&Path, &Path), path: &Path) -> Result<()> {
        let (out, ground) = (path.display().to_string(), self.folder.join(format!("{name}-ground.glb")));
        let (source, file, under) =
            (source.display().to_string(), texel.display().to_string(), ground.display().to_string());
        let common = ["map", &under, "--bend", "--texel", &file, "--geometry", &source, "-o", &out];
        match *layout {
            Layout::Alone => {
                let reader = Reader::open(texel, &Limits::default())?;
                land::ground(&ground, 1, width(reader.info()), |_, _| 0.0)?;
                self.command(&[&common[..], &STILL, &["--surface", "hidden"]].concat())?;
            }
            Layout::Forest { side, hilly, presence, hedge, .. } => {
                land::ground(&ground, side, 10.0 * f64::from(side), relief(hilly))?;
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
                        "--bend",
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
            Layout::Cut { side, cells, .. } => {
                land::ground(&ground, side, 10.0 * f64::from(cells), relief(true))?;
                self.command(&[&common[..], &["--repeat", &cells.to_string()]].concat())?;
            }
            Layout::Stands { side, hilly, rigid: true, .. } => {
                let table = self.folder.join(format!("{name}-places.csv"));
                let metres = width(Reader::open(texel, &Limits::default())?.info());
                land::places(&ground, &table, side, relief(hilly), metres)?;
                let table = table.display().to_string();
                // No shell bends them.
                let words = common.iter().filter(|word| **word != "--bend").copied();
                let points = ["--points", &table, "--points-up", "y", "--scale", "1,1"];
                self.command(&words.chain(points).collect::<Vec<_>>())?;
            }
            Layout::Stands { side, hilly, .. } => {
                land::stands(&ground, side, relief(hilly))?;
                let own = ["--material", land::STANDS, "--surface", "hidden"];
                self.command(&[&common[..], &STILL, &own].concat())?;
            }
        }
        Ok(())
    }

    pub fn options(&self, layout: &Layout, made: &Made) -> Result<Options> {
        let sky = Some([0.3, 0.35, 0.4].into());
        let common = Options { sky, background: Some([0.3, 0.35, 0.4]), ..Options::measuring() };
        let look =
            |eye: DVec3, target: DVec3, degrees: f64| CameraChoice::LookAt { eye, target, yfov: degrees.to_radians() };
        Ok(match *layout {
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
            Layout::Forest { eye, target, .. }
            | Layout::Stands { eye, target, .. }
            | Layout::Cut { eye, target, .. } => {
                let camera = look(DVec3::from_array(eye), DVec3::from_array(target), 50.0);
                Options { size: self.size, camera, ..common }
            }
        })
    }
}

/// Words that make every copy the same.
const STILL: [&str; 8] = ["--repeat", "1", "--orientations", "identity", "--scale", "1,1", "--displace", "0"];

/// Heights of the ground: hills, or none.
pub fn relief(hilly: bool) -> fn(f64, f64) -> f64 {
    let hills = |x: f64, z: f64| {
        let (long, short) = (libm::sin(x / 170.0) * libm::cos(z / 210.0), libm::sin(x / 61.0 + z / 83.0));
        40.0 * long + 12.0 * short
    };
    if hilly { hills } else { |_, _| 0.0 }
}

/// Metres along the texel's cube.
fn width(info: &crate::volume::Info) -> f64 {
    let metres = if info.metres_per_unit > 0.0 { info.metres_per_unit } else { 1.0 };
    info.bounds.size().x * metres
}
