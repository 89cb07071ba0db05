//! `vtex stitch`: the tiles of a picture → the picture.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::depfile::DepfileArgs;
use super::frames::{self, Frames};
use super::results::{each, shown};
use super::{Ui, outputs};
use crate::{Error, Result, render};

/// Put the tiles of a picture together, as `render --tile` made them: the picture has the bytes that it would have if it were
/// made whole
#[derive(clap::Args)]
pub struct Args {
    /// The tiles, .png or .exr, in any order
    #[arg(required = true, value_name = "TILE")]
    tiles: Vec<PathBuf>,
    /// The picture, with the tiles' extension
    #[arg(short, long, value_name = "OUT.png|OUT.exr")]
    output: PathBuf,
    /// Put frames A to B, or 0 to N−1, together; their numbers stand in place of the #### in all names
    #[arg(long, value_name = "A..B|N", value_parser = frames::parse)]
    frames: Option<Frames>,
    #[command(flatten)]
    depfile: DepfileArgs,
    /// Print what was made as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    let pictures = pictures(args)?;
    let outputs: Vec<PathBuf> = pictures.iter().map(|p| p.0.clone()).collect();
    outputs.iter().try_for_each(|path| render::Film::check_name(path))?;
    let reads: Vec<PathBuf> = pictures.iter().flat_map(|p| p.1.clone()).collect();
    outputs::check(&reads, outputs.iter().map(PathBuf::as_path).chain(args.depfile.path()))?;
    let (mut rules, mut left) = (Vec::new(), pictures.iter());
    let done = each(&outputs, args.json, ui, |_| {
        let Some((output, tiles)) = left.next() else { return Ok(Value::Null) };
        let [width, height] = render::stitch(tiles, output)?;
        ui.say(&format!("{}: {width}×{height} of {} tiles", output.display(), tiles.len()));
        rules.push((output.as_path(), tiles.clone()));
        Ok(json!({ "output": shown(output), "width": width, "height": height, "tiles": tiles.len() }))
    });
    if !rules.is_empty() {
        args.depfile.write(rules, ui)?;
    }
    done
}

/// The pictures, and the tiles of each.
fn pictures(args: &Args) -> Result<Vec<(PathBuf, Vec<PathBuf>)>> {
    let Some(frames) = args.frames else { return Ok(vec![(args.output.clone(), args.tiles.clone())]) };
    let names = args.tiles.iter().chain([&args.output]);
    if let Some(plain) = names.into_iter().find(|name| !frames::is_numbered(name)) {
        let what = format!("{}: --frames needs a place for the number, such as pic.####.png", plain.display());
        return Err(Error::Options(what));
    }
    let of = |name: &Path, n: u32| frames::file(name, n);
    Ok(frames.numbers().map(|n| (of(&args.output, n), args.tiles.iter().map(|t| of(t, n)).collect())).collect())
}
