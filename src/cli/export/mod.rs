//! `vtex export`: a texel for other programs. Today: one page to look at it in a browser.

mod page;

use std::path::{Path, PathBuf};

use serde_json::json;

use super::depfile::DepfileArgs;
use super::results::{print, shown};
use super::{Ui, outputs};
use crate::format::{Limits, Reader, save};
use crate::{Error, Result};

/// Largest file that is put into a page: browsers hold its text twice while they read it.
const MOST_BYTES: u64 = 256 << 20;

/// Write a texel as one page that a browser shows: turn, zoom, depths, channels, sun, cuts. It needs no network
#[derive(clap::Args)]
pub struct Args {
    /// The .vtex file
    file: PathBuf,
    /// The page to write, .html
    #[arg(long, short, value_name = "FILE.html")]
    output: PathBuf,
    /// Name that the page shows; by default the file's
    #[arg(long)]
    title: Option<String>,
    #[command(flatten)]
    depfile: DepfileArgs,
    /// Print a summary as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    let html = |path: &Path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("html"));
    if !html(&args.output) {
        return Err(Error::Options(format!(
            "{}: only a page can be written so far; give it a name that ends in .html",
            args.output.display()
        )));
    }
    let writes = [Some(args.output.as_path()), args.depfile.path()];
    outputs::check(std::slice::from_ref(&args.file), writes.into_iter().flatten())?;
    let reader = Reader::open(&args.file, &Limits::default())?;
    if reader.file_bytes() > MOST_BYTES {
        return Err(Error::Limit {
            what: format!("the texel in a page ({} keeps its coarser depths)", "vtex truncate"),
            needed: reader.file_bytes(),
            allowed: MOST_BYTES,
        });
    }
    let texel = std::fs::read(&args.file).map_err(|e| Error::input(&args.file, "", e.to_string()))?;
    let own = || args.file.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let page = page::of(&texel, &args.title.clone().unwrap_or_else(own));
    save(&args.output, page.as_bytes())?;
    args.depfile.write([(args.output.as_path(), vec![args.file.clone()])], ui)?;
    let (input, output, bytes) = (shown(&args.file), shown(&args.output), page.len());
    if !args.json {
        ui.say(&format!(
            "{output}: {} kB, of which {} kB are the texel",
            bytes.div_ceil(1000),
            texel.len().div_ceil(1000)
        ));
    }
    print(json!({ "input": input, "output": output, "file_bytes": bytes }), args.json, ui)
}
