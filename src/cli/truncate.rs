//! `vtex truncate`: the coarser depths of a file as a file.

use std::path::PathBuf;

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
}

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    outputs::check(std::slice::from_ref(&args.file), [args.output.as_path()])?;
    let bytes = format::truncate(&args.file, args.depth.into(), &args.output)?;
    ui.say(&format!("{}: resolution {}, {bytes} bytes", args.output.display(), 1u32 << args.depth));
    Ok(())
}
