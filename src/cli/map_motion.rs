//! The options of `vtex map` for what moves.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use serde_json::{Value, json};

use super::frames;
use super::quantity::{finite, positive};
use crate::format::{Limits, Reader};
use crate::scene::gltf::map::Motion;
use crate::volume::{Info, Pages};
use crate::{Error, Result};

/// How a landscape moves.
#[derive(clap::Args)]
#[command(next_help_heading = "Motion")]
pub struct MotionArgs {
    /// How copies of a texel of frames (--texel NAME.####.vtex) go through them
    #[arg(long, value_enum, default_value = "loop")]
    frame_mode: Mode,
    /// How far copies are ahead of each other: not at all, each by a share drawn by lot, or neighbours by nearly the same
    #[arg(long, value_enum, default_value = "per-cell")]
    phase: Phase,
    /// Frames a second [default: as the texel was baked]
    #[arg(long, value_name = "F", value_parser = positive)]
    fps: Option<f64>,
    /// Wind in what is covered: how far it leans in the mean, the tangent of the angle, 0 to 4; 0.25 is a breeze in grass, 0.05
    /// in trees
    #[arg(long, value_name = "STRENGTH", value_parser = finite)]
    wind: Option<f64>,
    /// Where the wind blows to
    #[arg(long, value_name = "X,Y,Z", default_value = "1,0,0", value_parser = direction, allow_hyphen_values = true)]
    wind_direction: [f64; 3],
    /// Metres from gust to gust
    #[arg(long, value_name = "METRES", default_value_t = 12.0, value_parser = positive)]
    gust_scale: f64,
    /// Metres a second at which gusts travel
    #[arg(long, value_name = "SPEED", default_value_t = 5.0, value_parser = finite)]
    wind_speed: f64,
}

#[derive(Clone, Copy, ValueEnum)]
enum Mode {
    Loop,
    Pingpong,
    Random,
}

#[derive(Clone, Copy, ValueEnum)]
enum Phase {
    Global,
    PerCell,
    Noise,
}

fn direction(text: &str) -> std::result::Result<[f64; 3], String> {
    let list: Vec<f64> = text.split(',').map(|v| finite(v.trim())).collect::<std::result::Result<_, _>>()?;
    let three: [f64; 3] = list.try_into().map_err(|_| "three numbers are needed, such as 1,0,0.5")?;
    if three == [0.0; 3] { Err("must not be 0,0,0".into()) } else { Ok(three) }
}

/// The files of a texel: its frames, in order, each with the pose of its geometry.
pub type Frames = Vec<(PathBuf, Option<Value>)>;

/// A texel that `--texel` names: its first file, what that says (with the box that all frames fill), and its frames; none
/// of a texel that is one file.
///
/// # Errors
/// `Input` where a frame is missing, or covers another box than the first.
pub fn texel(path: &Path) -> Result<(PathBuf, Info, Frames)> {
    let open = |path: &Path| Ok::<_, Error>(Reader::open(path, &Limits::default())?.info().clone());
    if !frames::is_numbered(path) || path.is_file() {
        return Ok((path.to_path_buf(), open(path)?, Vec::new()));
    }
    let mut first: Option<(PathBuf, Info)> = None;
    let mut list = Vec::new();
    for (number, file) in frames::found(path)? {
        let info = open(&file)?;
        let pose = info.meta.get("animation").and_then(|a| a.get("pose")).cloned();
        match &mut first {
            None => first = Some((file.clone(), info)),
            Some((_, own)) => {
                if info.bounds != own.bounds || info.up != own.up {
                    let what =
                        format!("frame {number} covers another box than the first; bake them together, by --frames");
                    return Err(Error::input(&file, "", what));
                }
                own.content = own.content.union(info.content);
            }
        }
        list.push((file, pose));
    }
    let (path, info) = first.ok_or_else(|| Error::input(path, "", "has no frames"))?;
    Ok((path, info, list))
}

impl MotionArgs {
    /// What is written for texels of these `frames`; `baked`: what the first says of its animation.
    pub fn motion(&self, frames: Vec<Frames>, infos: &[&Info]) -> Result<Motion> {
        let moving = frames.iter().zip(infos).find(|(list, _)| list.len() > 1).map(|(_, info)| *info);
        let animation = moving.map(|info| {
            let baked = info.meta.get("animation").and_then(|a| a.get("framesPerSecond")).and_then(Value::as_f64);
            let fps = self.fps.or(baked).unwrap_or(24.0);
            let mode = ["loop", "pingpong", "random"][self.frame_mode as usize];
            let phase = ["global", "perCell", "noise"][self.phase as usize];
            json!({ "mode": mode, "framesPerSecond": fps, "phase": phase })
        });
        if self.wind.is_some_and(|w| !(0.0..=4.0).contains(&w)) || self.wind_speed < 0.0 {
            return Err(Error::Options("--wind lies in 0 to 4, and --wind-speed is not negative".into()));
        }
        let wind = self.wind.map(|strength| {
            json!({ "direction": self.wind_direction, "strength": strength, "gustScale": self.gust_scale,
                "speed": self.wind_speed })
        });
        Ok(Motion { frames, animation, wind })
    }
}
