//! `vtex expand`: a landscape to a plain glTF file.

use std::path::PathBuf;
use std::time::Instant;

use serde_json::json;

use super::depfile::{self, DepfileArgs};
use super::quantity::{bytes, count, finite, positive, size};
use super::results::{print, shown};
use super::{Ui, outputs};
use crate::progress::Progress;
use crate::render::expand::{Amount, ExpandOptions, Plan};
use crate::render::{CameraChoice, picture_size};
use crate::scene::gltf;
use crate::scene::gltf::save::save;
use crate::scene::{Scene, files};
use crate::{Error, Result, Warnings};

/// Turn a landscape into plain glTF for other renderers: the triangles that its texels were baked from, where it shows them
#[derive(clap::Args)]
pub struct Args {
    /// The landscape, .gltf or .glb; its texels must name the meshes that they were baked from (map --geometry)
    landscape: PathBuf,
    /// The file to write, .glb, or .gltf with a .bin beside it
    #[arg(long, short, value_name = "OUT.glb")]
    output: PathBuf,
    /// Keep only what this camera of the file may see, by name or number, and all of the ground [default: everything]
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Width and height of the camera's picture, which give its shape [default: the shape that it has in the file, or 16:9]
    #[arg(long, value_name = "WxH", value_parser = super::render::size, requires = "camera")]
    size: Option<[u32; 2]>,
    /// Keep what is so many metres beside the camera's view as well: its shadows may be seen
    #[arg(long, value_name = "METRES", value_parser = not_negative, default_value_t = 0.0, requires = "camera")]
    margin: f64,
    /// How far bent triangles may lie from where the shell has them, in widths of a copy
    #[arg(long, value_name = "CELLS", value_parser = positive, default_value_t = ExpandOptions::default().tolerance)]
    tolerance: f64,
    /// Most triangles in the file; a mesh of which there are many copies counts once. What is expected to be more is refused
    /// before work begins
    #[arg(long, value_name = "N", default_value_t = ExpandOptions::default().max_triangles)]
    max_triangles: u64,
    /// Memory that they may take, such as 800M or 2G [default: 4G]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    memory: Option<u64>,
    /// Threads; 0: one a core
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// The scene of the file, by name or number
    #[arg(long, value_name = "NAME")]
    scene: Option<String>,
    #[command(flatten)]
    depfile: DepfileArgs,
    /// Print a summary as JSON
    #[arg(long)]
    json: bool,
    /// The moment, seconds: of the file's animations, of texels of frames and of the wind [default: nodes stand at rest, and
    /// all else as at 0]
    #[arg(long, value_name = "SECONDS", value_parser = finite, allow_hyphen_values = true, help_heading = "Motion")]
    time: Option<f64>,
    /// Play this animation of the file, by name or number; may be given again
    #[arg(long, value_name = "NAME", help_heading = "Motion")]
    animation: Vec<String>,
    /// Begin the file's animations anew after their last key
    #[arg(long = "loop", help_heading = "Motion")]
    repeat: bool,
}

fn not_negative(text: &str) -> std::result::Result<f64, String> {
    let value = finite(text)?;
    if value >= 0.0 { Ok(value) } else { Err("must be at least 0".into()) }
}

impl Args {
    fn options(&self, scene: &Scene) -> Result<ExpandOptions> {
        let view = match &self.camera {
            None => None,
            Some(name) => {
                let camera = CameraChoice::Named(name.clone());
                let size = self.size.map_or_else(|| picture_size(scene, &camera), Ok)?;
                Some((camera, size))
            }
        };
        let plain = ExpandOptions::default();
        Ok(ExpandOptions {
            view,
            margin: self.margin,
            tolerance: self.tolerance,
            max_triangles: self.max_triangles,
            max_bytes: self.memory.unwrap_or(plain.max_bytes),
            threads: self.threads,
        })
    }
}

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    let start = Instant::now();
    if !["gltf", "glb"].contains(&files::extension(&args.output).as_str()) {
        let path = args.output.display();
        return Err(Error::Options(format!("{path}: the output's name must end in .glb or .gltf")));
    }
    let inputs = depfile::of_landscape(&args.landscape);
    let beside = args.output.with_extension("bin");
    let bin = (files::extension(&args.output) == "gltf").then_some(beside.as_path());
    let writes = [Some(args.output.as_path()), bin, args.depfile.path()];
    outputs::check(&inputs, writes.into_iter().flatten())?;
    ui.stage("read", 0);
    let plain = gltf::ReadOptions::default();
    let read = gltf::ReadOptions {
        scene: args.scene.clone(),
        contained: true,
        time: args.time,
        animations: args.animation.clone(),
        repeat: args.repeat,
        max_bytes: args.memory.unwrap_or(plain.max_bytes),
        ..plain
    };
    let scene = gltf::read(&args.landscape, &read)?;
    ui.finish();
    ui.warn(&scene.model.warnings)?;
    let plan = Plan::new(&scene, &args.options(&scene)?)?;
    ui.finish();
    ui.say(&said(&plan.amount, "expected: "));
    let done = plan.run(ui)?;
    ui.finish();
    done.notes.iter().for_each(|note| ui.say(note));
    let mut warnings: Warnings = done.warnings;
    save(&done.model, &args.output, &mut warnings)?;
    ui.warn(&warnings)?;
    args.depfile.write([(args.output.as_path(), inputs)], ui)?;
    let written = |path: &std::path::Path| std::fs::metadata(path).map_or(0, |m| m.len());
    let bytes = written(&args.output) + bin.map_or(0, written);
    let path = args.output.display();
    ui.say(&said(&done.amount, &format!("{path}: ")));
    ui.say(&format!("{path}: {} in {:.2} s", size(bytes), start.elapsed().as_secs_f64()));
    let Amount { copies, faces, rigid_triangles, bent_triangles, shown_triangles } = done.amount;
    let summary = json!({
        "input": shown(&args.landscape),
        "output": shown(&args.output),
        "copies": copies,
        "shell_faces": faces,
        "stored_triangles_of_copies": rigid_triangles,
        "stored_triangles_of_shells": bent_triangles,
        "shown_triangles": shown_triangles,
        "file_bytes": bytes,
    });
    print(summary, args.json, ui)
}

fn said(amount: &Amount, before: &str) -> String {
    let Amount { copies, faces, rigid_triangles, bent_triangles, .. } = amount;
    format!(
        "{before}{} rigid copies of {} triangles, {} triangles in shells over {} faces",
        count(*copies),
        count(*rigid_triangles),
        count(*bent_triangles),
        count(*faces)
    )
}
