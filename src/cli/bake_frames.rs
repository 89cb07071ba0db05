//! Texels of frames: one bake a frame of an animation, of numbered files, of the volumes of a stack, or of a parameter.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::frames::{self, Frames};
use super::quantity::finite;
use crate::scene::files::extension;
use crate::scene::gltf;
use crate::source::{FileKind, OpenOptions, file_kind};
use crate::{Error, Result};

/// Which moments of the source are baked.
#[derive(clap::Args)]
#[command(next_help_heading = "Motion")]
pub struct FrameArgs {
    /// The moment, seconds, at which a .gltf's animations stand [default: its nodes stand at rest]
    #[arg(long, value_name = "SECONDS", value_parser = finite, allow_hyphen_values = true, conflicts_with = "frames")]
    time: Option<f64>,
    /// Play this animation of a .gltf, by name or number; may be given again [default: the first, and every other that moves
    /// nothing that one before it moves]
    #[arg(long, value_name = "NAME")]
    animation: Vec<String>,
    /// Bake frames A to B, or 0 to N−1, to a file each, NAME.####.vtex, that share one box: over a .gltf's animation, over
    /// numbered files (smoke.####.nii), over the volumes of a stack, or over --frame-define
    #[arg(long, value_name = "N|A..B", value_parser = frames::parse)]
    frames: Option<Frames>,
    /// Frames a second; of a .gltf, frame k is at k / fps seconds [default: of N frames, so many that they last as long as the
    /// animation; else 24]
    #[arg(long, value_name = "F", value_parser = super::quantity::positive, requires = "frames")]
    fps: Option<f64>,
    /// Give a #define of an L-system another value
    #[arg(long, value_name = "NAME=VALUE", value_parser = definition)]
    define: Vec<(String, f64)>,
    /// Give a #define of an L-system a value that goes from FROM at the first frame to TO at the last; may be given again
    #[arg(long, value_name = "NAME=FROM..TO", value_parser = ramp, requires = "frames")]
    frame_define: Vec<(String, [f64; 2])>,
}

fn definition(text: &str) -> std::result::Result<(String, f64), String> {
    let (name, value) = text.split_once('=').filter(|(n, _)| !n.trim().is_empty()).ok_or("NAME=VALUE is needed")?;
    Ok((name.trim().to_owned(), finite(value.trim())?))
}

fn ramp(text: &str) -> std::result::Result<(String, [f64; 2]), String> {
    let wanted = "NAME=FROM..TO is needed, such as t=0..1";
    let (name, range) = text.split_once('=').filter(|(n, _)| !n.trim().is_empty()).ok_or(wanted)?;
    let (from, to) = range.split_once("..").ok_or(wanted)?;
    Ok((name.trim().to_owned(), [finite(from.trim())?, finite(to.trim())?]))
}

/// One bake.
#[derive(Debug, Clone)]
pub struct Shot {
    pub input: PathBuf,
    pub output: PathBuf,
    pub options: OpenOptions,
    /// What the file says of its place among the frames; `None` of a single texel.
    pub animation: Option<Value>,
}

impl FrameArgs {
    /// How a source is read that is no frame of others.
    pub fn still(&self, options: &OpenOptions) -> OpenOptions {
        let mut options = options.clone();
        options.read.time = self.time;
        options.read.animations = self.animation.clone();
        options.lsystem.define = self.define.iter().cloned().collect();
        options
    }

    /// The frames that the inputs and options ask for; `None` where every input is baked by itself. `output`: as it was given.
    ///
    /// # Errors
    /// `Options` where the inputs have no frames, or the output no place for their numbers; `Input` where one is missing.
    pub fn shots(&self, inputs: &[PathBuf], output: Option<&Path>, options: &OpenOptions) -> Result<Option<Vec<Shot>>> {
        let options = self.still(options);
        if inputs.len() > 1 {
            return match output.filter(|o| frames::is_numbered(o)) {
                Some(output) => self.listed(inputs, output, &options).map(Some),
                None if self.frames.is_some() => Err(Error::Options("--frames is for one input".into())),
                None => Ok(None),
            };
        }
        let input = inputs.first().map_or(Path::new("string"), PathBuf::as_path);
        let named = Path::new(input.file_name().unwrap_or_default()).with_extension("vtex");
        let output = frames::with_place(output.unwrap_or(&named));
        if frames::is_numbered(input) && !input.is_file() {
            return self.numbered(input, &output, &options).map(Some);
        }
        let of = |frames| self.moments(frames, (input, inputs.is_empty()), &output, &options);
        self.frames.map(of).transpose()
    }

    /// A file a frame, in the order in which they are given.
    fn listed(&self, inputs: &[PathBuf], output: &Path, options: &OpenOptions) -> Result<Vec<Shot>> {
        if self.frames.is_some() {
            return Err(Error::Options("--frames is for one input; several inputs are a frame each already".into()));
        }
        let shot = |(k, input): (usize, &PathBuf)| {
            let k = k as u32;
            let animation = self.said(k, inputs.len() as u32, None);
            let (input, output) = (input.clone(), frames::file(output, k));
            Shot { input, output, options: options.clone(), animation: Some(animation) }
        };
        Ok(inputs.iter().enumerate().map(shot).collect())
    }

    /// Numbered files.
    fn numbered(&self, pattern: &Path, output: &Path, options: &OpenOptions) -> Result<Vec<Shot>> {
        let files = match self.frames {
            None => frames::found(pattern)?,
            Some(frames) => frames.numbers().map(|n| (n, frames::file(pattern, n))).collect(),
        };
        if let Some((n, missing)) = files.iter().find(|(_, file)| !file.exists()) {
            return Err(Error::input(missing, "", format!("frame {n} is missing")));
        }
        let count = files.len() as u32;
        let shot = |(n, file): (u32, PathBuf)| Shot {
            input: file,
            output: frames::file(output, n),
            options: options.clone(),
            animation: Some(self.said(n, count, None)),
        };
        Ok(files.into_iter().map(shot).collect())
    }

    /// Moments of one input.
    fn moments(
        &self,
        frames: Frames,
        (input, is_string): (&Path, bool),
        output: &Path,
        options: &OpenOptions,
    ) -> Result<Vec<Shot>> {
        let kind = if is_string { FileKind::LSystem } else { file_kind(input) };
        let is_gltf = ["gltf", "glb"].contains(&extension(input).as_str());
        let mut fps = self.fps.unwrap_or(24.0);
        if is_gltf {
            let timeline = gltf::timeline(input, &options.read)?;
            if timeline.duration <= 0.0 {
                return Err(Error::input(input, "", "has no animation to take frames of"));
            }
            if frames.counted && self.fps.is_none() {
                fps = f64::from(frames.count()) / timeline.duration;
            }
        } else if !self.frame_define.is_empty() && !matches!(kind, FileKind::LSystem | FileKind::Recipe) {
            return Err(Error::Options("--frame-define is for L-systems, and recipes that draw them".into()));
        } else if !matches!(kind, FileKind::Stack | FileKind::Recipe) && self.frame_define.is_empty() {
            let what = "--frames needs a .gltf with an animation or a recipe that draws one, numbered files (NAME.####.nii), a \
                        stack of several volumes, or an L-system with --frame-define NAME=FROM..TO";
            return Err(Error::Options(what.into()));
        }
        let last = frames.count().saturating_sub(1).max(1);
        let shot = |n: u32| {
            let k = n - frames.first;
            let mut options = options.clone();
            let mut time = None;
            if is_gltf || kind == FileKind::Recipe {
                time = Some(f64::from(n) / fps);
                options.read.time = time;
            } else if kind == FileKind::Stack {
                // Volumes are counted from 1.
                options.stack.frame = Some(n as usize + usize::from(frames.counted));
            }
            for (name, [from, to]) in &self.frame_define {
                let share = f64::from(k) / f64::from(last);
                options.lsystem.define.insert(name.clone(), from + share * (to - from));
            }
            let mut animation = self.said(n, frames.count(), time);
            animation["framesPerSecond"] = fps.into();
            let (input, output) = (input.to_path_buf(), frames::file(output, n));
            Shot { input, output, options, animation: Some(animation) }
        };
        Ok(frames.numbers().map(shot).collect())
    }

    /// What a frame's file says of itself.
    fn said(&self, number: u32, count: u32, time: Option<f64>) -> Value {
        let mut out = json!({ "frame": number, "frames": count, "framesPerSecond": self.fps.unwrap_or(24.0) });
        if let Some(time) = time {
            out["pose"] = json!({ "time": time });
            if !self.animation.is_empty() {
                out["pose"]["animations"] = json!(self.animation);
            }
        }
        out
    }

    /// Add to `out` what decides on the content, besides a frame's own place.
    pub fn provenance(&self, out: &mut Value) {
        self.time.iter().for_each(|v| out["time"] = (*v).into());
        if !self.animation.is_empty() {
            out["animation"] = json!(self.animation);
        }
        if !self.define.is_empty() {
            out["define"] =
                self.define.iter().map(|(n, v)| (n.clone(), (*v).into())).collect::<serde_json::Map<_, _>>().into();
        }
        if !self.frame_define.is_empty() {
            out["frameDefine"] =
                self.frame_define.iter().map(|(n, v)| (n.clone(), json!(v))).collect::<serde_json::Map<_, _>>().into();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(words: &str) -> FrameArgs {
        #[derive(clap::Parser)]
        struct Line {
            #[command(flatten)]
            frames: FrameArgs,
        }
        use clap::Parser;
        Line::parse_from(std::iter::once("x").chain(words.split_whitespace())).frames
    }

    #[test]
    fn parameters_go_from_end_to_end() {
        let args = args("--frames 5 --frame-define t=1..3 --define a=2");
        let shots = args.shots(&["fern.lsys".into()], None, &OpenOptions::default()).unwrap().unwrap();
        let t: Vec<f64> = shots.iter().map(|s| s.options.lsystem.define["t"]).collect();
        assert_eq!(t, [1.0, 1.5, 2.0, 2.5, 3.0]);
        assert!(shots.iter().all(|s| s.options.lsystem.define["a"] == 2.0));
        assert_eq!(shots[4].output, Path::new("fern.0004.vtex"));
        assert_eq!(shots[4].animation.as_ref().unwrap()["frames"], 5);
    }

    #[test]
    fn several_inputs_and_volumes_are_frames() {
        let two: [PathBuf; 2] = ["a.nii".into(), "b.nii".into()];
        let shots = args("").shots(&two, Some(Path::new("x.##.vtex")), &OpenOptions::default()).unwrap().unwrap();
        assert_eq!((shots.len(), &*shots[1].output), (2, Path::new("x.01.vtex")));
        assert!(args("").shots(&two, None, &OpenOptions::default()).unwrap().is_none());
        let of = |words: &str| {
            let shots = args(words).shots(&["a.nii".into()], None, &OpenOptions::default()).unwrap().unwrap();
            shots.iter().map(|s| s.options.stack.frame.unwrap()).collect::<Vec<_>>()
        };
        assert_eq!((of("--frames 3"), of("--frames 4..5")), (vec![1, 2, 3], vec![4, 5]));
        let error = args("--frames 3").shots(&["a.obj".into()], None, &OpenOptions::default()).unwrap_err();
        assert!(error.to_string().contains("--frames needs a .gltf with an animation"), "{error}");
    }
}
