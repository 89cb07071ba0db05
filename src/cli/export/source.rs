//! `vtex export` of a source: its facets as a mesh.

use std::path::{Path, PathBuf};

use serde_json::json;

use super::super::paint::PaintArgs;
use super::super::results::{print, shown};
use super::super::source::SourceArgs;
use super::super::{Ui, outputs};
use super::Args;
use crate::bake::{Options, plan};
use crate::scene::files::extension;
use crate::scene::gltf::save::save;
use crate::source::{FileKind, Placement, apply_paint, dependencies, file_kind, open, paint_files, tessellate};
use crate::{Error, Result, Warnings};

/// Voxels along the cube's edge where nobody says.
const RESOLUTION: u32 = 512;
/// Most triangles where nobody says.
const MAX_TRIANGLES: u64 = 20_000_000;

/// How a source becomes a mesh.
#[derive(clap::Args)]
#[command(next_help_heading = "Meshes of sources")]
pub struct MeshArgs {
    /// How fine curved things are cut, and masks: as for a texel of so many voxels along its edge [default: 512]
    #[arg(long, short, value_name = "N")]
    resolution: Option<u32>,
    /// Most triangles of the mesh [default: 20000000]
    #[arg(long, value_name = "N")]
    max_triangles: Option<u64>,
    /// Most bytes of memory to read the source, and to lay it out
    #[arg(long, value_name = "BYTES", value_parser = super::super::quantity::bytes)]
    memory: Option<u64>,
    #[command(flatten)]
    paint: PaintArgs,
    #[command(flatten)]
    how: SourceArgs,
}

impl MeshArgs {
    /// Names of the options that were given and say how a source becomes a mesh, whatever the source.
    pub fn given(&self) -> impl Iterator<Item = &'static str> + use<> {
        let own = [
            ("-r", self.resolution.is_some()),
            ("--max-triangles", self.max_triangles.is_some()),
            ("--memory", self.memory.is_some()),
        ];
        own.into_iter().filter(|(_, given)| *given).map(|(name, _)| name).chain(self.paint.given())
    }

    /// Check that each option that was given and is of some kinds of sources alone says something of `file`.
    pub fn check_kind(&self, file: &Path) -> Result<()> {
        self.how.check(&json!({}), &[file.to_path_buf()])
    }
}

/// Whether the file is a source, and no texel.
pub fn is_meant(file: &Path) -> bool {
    !matches!(file_kind(file), FileKind::Texel | FileKind::Other)
}

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    let (input, output) = (&args.file, &args.output);
    if !["glb", "gltf"].contains(&extension(output).as_str()) {
        let (input, output) = (input.display(), output.display());
        return Err(Error::Options(format!(
            "{output}: {input} is a source, which becomes a mesh (.glb or .gltf); of a texel that is baked from it there is more"
        )));
    }
    args.check_used(None)?;
    let mut files: Vec<PathBuf> = dependencies(input);
    files.extend(paint_files(&args.mesh.paint.options()));
    files.extend(args.mesh.how.files());
    let writes = [Some(output.as_path()), args.depfile.path()];
    outputs::check(&files, writes.into_iter().flatten())?;
    let how = &args.mesh;
    let options = how.how.options(how.memory);
    let source = apply_paint(open(input, &options)?, &how.paint.options(), &options.read)?;
    source.notes().iter().for_each(|note| ui.say(note));
    ui.warn(source.warnings())?;
    let resolution = how.resolution.unwrap_or(RESOLUTION);
    let options = Options { resolution, up: source.up(), memory: how.memory.unwrap_or(0), ..Options::default() };
    let place: Placement = plan(source.bounds(), &options)?;
    let mut warnings = Warnings::default();
    let model = tessellate(&*source, &place, how.max_triangles.unwrap_or(MAX_TRIANGLES), ui, &mut warnings)?;
    ui.finish();
    let triangles: usize = model.parts.iter().map(|part| part.triangles.len()).sum();
    if triangles == 0 {
        return Err(Error::input(input, "", "has no facets: there is nothing that a mesh could show"));
    }
    save(&model, output, &mut warnings)?;
    ui.warn(&warnings)?;
    args.depfile.write([(output.as_path(), files)], ui)?;
    let bytes = std::fs::metadata(output).map_err(|e| Error::io(output, e))?.len();
    if !args.json {
        ui.say(&format!("{}: {triangles} triangles of {} materials", shown(output), model.materials.len()));
    }
    let summary =
        json!({ "input": shown(input), "output": shown(output), "file_bytes": bytes, "triangles": triangles });
    print(summary, args.json, ui)
}
