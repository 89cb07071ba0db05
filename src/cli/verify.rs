//! `vtex verify`: every rule of the format, one line a file.

use std::path::PathBuf;

use serde_json::json;

use super::Ui;
use super::results::{each, shown};
use crate::progress::Progress;
use crate::{Result, format};

/// Check every checksum, count and rule of .vtex files
#[derive(clap::Args)]
pub struct Args {
    /// Files to check
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Print JSON instead of lines
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    each(&args.files, args.json, ui, |path| {
        ui.stage("verify", 0);
        let format::Report { depths, nodes, pages, bytes, .. } = format::verify(path)?;
        if !args.json {
            ui.finish();
            outln!("{}: ok, {depths} depths, {nodes} voxels, {pages} pages, {bytes} bytes", path.display())?;
        }
        Ok(json!({
            "input": shown(path), "valid": true, "depths": depths, "voxels": nodes, "pages": pages, "file_bytes": bytes,
        }))
    })
}
