//! `vtex truncate`: the coarser depths of a file as a file.

use std::path::PathBuf;

use serde_json::json;

use super::depfile::DepfileArgs;
use super::results::{print, shown};
use super::{Ui, outputs};
use crate::{Result, format};

/// Keep the depths from the root down to one; what was cut short in a download can be saved so
#[derive(clap::Args)]
pub struct Args {
    /// The .vtex file
    file: PathBuf,
    /// Finest depth to keep: its resolution is 2^DEPTH
    #[arg(long, value_name = "DEPTH")]
    depth: u8,
    /// The file to write
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    depfile: DepfileArgs,
    /// Print a summary as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    let writes = [Some(args.output.as_path()), args.depfile.path()];
    outputs::check(std::slice::from_ref(&args.file), writes.into_iter().flatten())?;
    let bytes = format::truncate(&args.file, args.depth.into(), &args.output)?;
    args.depfile.write([(args.output.as_path(), vec![args.file.clone()])], ui)?;
    let resolution = 1u32 << args.depth;
    if !args.json {
        ui.say(&format!("{}: resolution {resolution}, {bytes} bytes", args.output.display()));
    }
    let (input, output) = (shown(&args.file), shown(&args.output));
    let summary =
        json!({ "input": input, "output": output, "depth": args.depth, "resolution": resolution, "file_bytes": bytes });
    print(summary, args.json, ui)
}
