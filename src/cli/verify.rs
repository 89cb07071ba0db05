//! `vtex verify`: every rule of the format, one line a file.

use std::path::PathBuf;

use super::{Ui, ui};
use crate::{Error, Result, format};

/// Check every checksum, count and rule of .vtex files
#[derive(clap::Args)]
pub struct Args {
    /// Files to check
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
}

pub fn run(args: &Args, _ui: &Ui) -> Result<()> {
    let mut failed = 0;
    for path in &args.files {
        match format::verify(path) {
            Ok(r) => {
                let path = path.display();
                outln!("{path}: ok, {} depths, {} voxels, {} pages, {} bytes", r.depths, r.nodes, r.pages, r.bytes)?;
            }
            Err(e) if args.files.len() == 1 => return Err(e),
            Err(e) => {
                failed += 1;
                ui::message("error: ", &e.to_string());
            }
        }
    }
    if failed == 0 {
        return Ok(());
    }
    let what = format!("{failed} of {} files are not valid", args.files.len());
    Err(Error::Input { path: "verify".into(), at: String::new(), what })
}
