//! `vtex export`: a texel for other programs, which are told apart by the output's extension; or a source as a mesh.

mod mitsuba;
mod page;
mod ply;
mod solid;
mod source;
mod splats;
mod usd;
mod vdb;
mod voxels;

use std::path::{Path, PathBuf};

use serde_json::json;

use super::depfile::DepfileArgs;
use super::download::{self, DownloadArgs, Need};
use super::results::{print, shown};
use super::{Ui, outputs};
use crate::error::short;
use crate::format::{Limits, Reader, save};
use crate::volume::Pages;
use crate::{Error, Result};
use solid::Form;

/// Largest file that is put into a page: browsers hold its text twice while they read it.
const MAX_BYTES: u64 = 256 << 20;
/// Most voxels of a mesh or of splats: their file has some gigabytes then.
const MAX_VOXELS: usize = 1 << 24;

/// Write a texel for other programs: a page for any browser (.html), blocks, points or Gaussian splats (.glb), Gaussian splats
/// (.ply), grids of OpenVDB (.vdb), levels of detail of OpenUSD (.usda), a scene of Mitsuba 3 (.xml); or a source that can be
/// baked, as a mesh (.glb, .gltf)
#[derive(clap::Args)]
pub struct Args {
    /// The .vtex file, or a URL of one; or a source: a grammar, a recipe, curves, a stack, a mesh
    file: PathBuf,
    /// The file to write: .html, .glb, .ply, .vdb, .usda or .xml; of a source .glb or .gltf
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    /// Name that a page shows; by default the file's
    #[arg(long)]
    title: Option<String>,
    /// Depth that is written, all but pages: 2^DEPTH voxels along each side [default: .glb 5, .usda and .xml
    /// 7, .vdb and splats 8, or the finest]
    #[arg(long, value_name = "DEPTH")]
    depth: Option<u8>,
    /// What stands for a voxel in a .glb [default: blocks]
    #[arg(long, value_enum)]
    form: Option<Form>,
    /// Voxels that take a smaller share of the light have no block or point [default: 0.1]
    #[arg(long, value_name = "SHARE", value_parser = share)]
    least_opacity: Option<f64>,
    #[command(flatten)]
    depfile: DepfileArgs,
    /// Print a summary as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    download: DownloadArgs,
    #[command(flatten)]
    mesh: source::MeshArgs,
}

/// What was written.
struct Written {
    bytes: u64,
    /// What a person is told of it.
    said: String,
    /// Files besides the output.
    more: Vec<PathBuf>,
}

pub fn run(mut args: Args, ui: &Ui) -> Result<()> {
    if source::is_meant(&args.file) {
        return source::run(&args, ui);
    }
    let writes = [Some(args.output.as_path()), args.depfile.path()];
    let kind = args.output.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let export = match kind.as_str() {
        "html" => to_page,
        "glb" => to_mesh,
        "ply" => to_splats,
        "usda" => to_usd,
        "vdb" => to_vdb,
        "xml" => to_mitsuba,
        _ => {
            let known =
                ".html (a page), .glb (blocks, points or splats), .ply (splats), .vdb, .usda or .xml (Mitsuba 3)";
            return Err(Error::Options(format!("{}: give it a name that ends in {known}", args.output.display())));
        }
    };
    args.check_used(Some(&kind))?;
    outputs::check(std::slice::from_ref(&args.file), writes.into_iter().flatten())?;
    let downloads = download::local(std::slice::from_mut(&mut args.file), Need::Whole, &args.download, ui)?;
    downloads.no_depfile(args.depfile.path())?;
    let args = &args;
    let reader = Reader::open(&args.file, &Limits::default())?;
    let written = export(args, &reader)?;
    args.depfile.write([(args.output.as_path(), vec![args.file.clone()])], ui)?;
    let (input, output) = (shown(&args.file), shown(&args.output));
    if !args.json {
        ui.say(&format!("{output}: {}", written.said));
    }
    let more: Vec<_> = written.more.iter().map(|path| shown(path)).collect();
    let mut summary = json!({ "input": input, "output": output, "file_bytes": written.bytes });
    if !more.is_empty() {
        summary["more"] = json!(more);
    }
    print(summary, args.json, ui)
}

impl Args {
    fn form(&self) -> Form {
        self.form.unwrap_or(Form::Blocks)
    }

    fn least_opacity(&self) -> f64 {
        self.least_opacity.unwrap_or(0.1)
    }

    /// Fails where an option was given that has no effect: who gave it expects something else. `kind`: the extension of what a
    /// texel is written to; `None` where a source becomes a mesh.
    fn check_used(&self, kind: Option<&str>) -> Result<()> {
        let file = self.file.display();
        let splats = kind == Some("glb") && self.form() == Form::Splats;
        let is_mesh = kind == Some("glb") && !splats;
        for (name, given, is_of) in [
            ("--title", self.title.is_some(), kind == Some("html")),
            ("--depth", self.depth.is_some(), kind != Some("html")),
            ("--form", self.form.is_some(), kind == Some("glb")),
            ("--least-opacity", self.least_opacity.is_some(), kind == Some("usda") || is_mesh),
        ] {
            match kind {
                _ if !given => {}
                None => {
                    let what = format!("{name} says how texels are written, and {file} is a source: leave it out");
                    return Err(Error::Options(what));
                }
                Some(kind) if !is_of => {
                    let what = if splats { "splats in a .glb".into() } else { format!("a .{kind}") };
                    return Err(Error::Options(format!("{name} is no option of {what}: leave it out")));
                }
                Some(_) => {}
            }
        }
        if let Some(name) = self.mesh.given().next().filter(|_| kind.is_some()) {
            let what = format!("{name} says how sources become meshes, and {file} is a texel: leave it out");
            return Err(Error::Options(what));
        }
        self.mesh.check_kind(&self.file)
    }
}

fn share(text: &str) -> std::result::Result<f64, String> {
    text.parse().ok().filter(|v| (0.0..=1.0).contains(v)).ok_or_else(|| "must lie between 0 and 1".into())
}

fn own_name(path: &Path) -> String {
    path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}

/// The page of the texel at `path`, which `reader` reads.
///
/// # Errors
/// `Limit` where the texel is too large for a page, or what reading it says.
pub fn page_of(path: &Path, reader: &Reader, title: &str) -> Result<String> {
    if reader.file_bytes() > MAX_BYTES {
        return Err(Error::Limit {
            what: format!("the texel in a page ({} keeps its coarser depths)", "vtex truncate"),
            needed: reader.file_bytes(),
            allowed: MAX_BYTES,
        });
    }
    let texel = std::fs::read(path).map_err(|e| Error::input(path, "", e.to_string()))?;
    Ok(page::of(&texel, title))
}

fn to_page(args: &Args, reader: &Reader) -> Result<Written> {
    let page = page_of(&args.file, reader, &args.title.clone().unwrap_or_else(|| own_name(&args.file)))?;
    save(&args.output, page.as_bytes())?;
    let texel = reader.file_bytes().div_ceil(1000);
    let said = format!("{} kB, of which {texel} kB are the texel", page.len().div_ceil(1000));
    Ok(Written { bytes: page.len() as u64, said, more: Vec::new() })
}

/// The voxels of the depth that was asked for, or of `otherwise`, or of the finest.
fn voxels(args: &Args, reader: &Reader, otherwise: u8) -> Result<voxels::Voxels> {
    let finest = reader.counts().len().saturating_sub(1);
    if let Some(depth) = args.depth.filter(|depth| usize::from(*depth) > finest) {
        let file = args.file.display();
        return Err(Error::Options(format!("{file} has no depth {depth}: its finest is {finest}")));
    }
    voxels::of(reader, args.depth.unwrap_or(otherwise).into(), MAX_VOXELS)
}

fn to_mesh(args: &Args, reader: &Reader) -> Result<Written> {
    let voxels = voxels(args, reader, if args.form() == Form::Splats { 8 } else { 5 })?;
    let name = own_name(&args.file);
    let said = if args.form() == Form::Splats {
        let splats = splats::of(&voxels);
        solid::write_splats(&splats, voxels.origin, &name, &args.output)?;
        said_of_splats(splats.len())
    } else {
        let count = solid::write(&voxels, args.form(), args.least_opacity(), &name, &args.output)?;
        let form = if args.form() == Form::Blocks { "blocks" } else { "points" };
        format!("{count} {form}, {} along the cube; opacity and normals within a voxel are lost", voxels.resolution)
    };
    let bytes = std::fs::metadata(&args.output).map_err(|e| Error::io(&args.output, e))?.len();
    Ok(Written { bytes, said, more: Vec::new() })
}

fn to_splats(args: &Args, reader: &Reader) -> Result<Written> {
    let voxels = voxels(args, reader, 8)?;
    let splats = splats::of(&voxels);
    let bytes = ply::of(&splats);
    save(&args.output, &bytes)?;
    let said = said_of_splats(splats.len());
    let said = if voxels.origin == glam::DVec3::ZERO {
        said
    } else {
        let [x, y, z] = voxels.origin.to_array().map(short);
        format!("{said}; ({x}, {y}, {z}) is subtracted from their places, since the file holds 32 bits of a number")
    };
    Ok(Written { bytes: bytes.len() as u64, said, more: Vec::new() })
}

fn said_of_splats(count: usize) -> String {
    format!("{count} splats in the texel's own colours, without light; depths and block correlation are lost")
}

fn to_vdb(args: &Args, reader: &Reader) -> Result<Written> {
    let voxels = voxels(args, reader, 8)?;
    let bytes = vdb::of(&voxels)?;
    save(&args.output, &bytes)?;
    let lost = "normals, support boxes, block correlation and depths are lost";
    let said = format!("density per metre and color of {} voxels, {}³; {lost}", voxels.cells.len(), voxels.resolution);
    Ok(Written { bytes: bytes.len() as u64, said, more: Vec::new() })
}

/// Depths by which blocks are coarser than splats, and points than blocks.
const COARSER: u8 = 2;

fn to_usd(args: &Args, reader: &Reader) -> Result<Written> {
    let finest = voxels(args, reader, 7)?;
    let coarser = |by: u8| -> Result<voxels::Voxels> {
        let depth = finest.resolution.ilog2() as usize;
        voxels::of(reader, depth.saturating_sub(by.into()), MAX_VOXELS)
    };
    let (middle, far) = (coarser(COARSER)?, coarser(COARSER + 1)?);
    let shown: Vec<_> = middle.cells.iter().filter(|cell| cell.opacity() >= args.least_opacity()).collect();
    let (splats, blocks) = (splats::of(&finest), solid::blocks(&middle, &shown));
    let edge = |voxels: &voxels::Voxels| voxels.size() / f64::from(voxels.resolution);
    let levels = usd::Levels { splats: &splats, blocks: (&blocks, edge(&middle)), points: (&far, edge(&far)) };
    let text = usd::of(&levels, &own_name(&args.file));
    save(&args.output, text.as_bytes())?;
    let said = format!(
        "{} splats, {} blocks and {} points as levels of detail; light, block correlation and other depths are lost",
        splats.len(),
        shown.len(),
        far.cells.len()
    );
    Ok(Written { bytes: text.len() as u64, said, more: Vec::new() })
}

fn to_mitsuba(args: &Args, reader: &Reader) -> Result<Written> {
    let voxels = voxels(args, reader, 7)?;
    if voxels.resolution > mitsuba::MAX_RESOLUTION {
        return Err(Error::Limit {
            what: "the edge of the grids, in voxels (--depth takes a coarser one)".into(),
            needed: voxels.resolution.into(),
            allowed: mitsuba::MAX_RESOLUTION.into(),
        });
    }
    let more = mitsuba::write(&voxels, &args.output)?;
    let bytes = std::fs::metadata(&args.output).map_err(|e| Error::io(&args.output, e))?.len();
    let said = format!("with {} grids of {}³; block correlation and depths are lost", more.len(), voxels.resolution);
    Ok(Written { bytes, said, more })
}
