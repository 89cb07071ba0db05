//! `vtex man`: a manual page for each command.

use std::path::PathBuf;

use clap::CommandFactory;
use clap_mangen::Man;

use super::{Ui, Vtex, outputs};
use crate::{Error, Result, format};

/// Write the manual pages vtex.1, vtex-bake.1 and so on, for `man`
#[derive(clap::Args)]
pub struct Args {
    /// The folder, such as ~/.local/share/man/man1
    folder: PathBuf,
}

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    let mut all = Vtex::command().disable_help_subcommand(true);
    all.build();
    let pages: Vec<Man> = std::iter::once(&all).chain(all.get_subcommands()).map(|c| Man::new(c.clone())).collect();
    let files: Vec<PathBuf> = pages.iter().map(|page| args.folder.join(page.get_filename())).collect();
    outputs::check(&[], files.iter().map(PathBuf::as_path))?;
    for (page, file) in pages.iter().zip(&files) {
        let mut text = Vec::new();
        page.render(&mut text).map_err(|e| Error::io(file, e))?;
        format::save(file, &text)?;
    }
    ui.say(&format!("{}: {} manual pages", args.folder.display(), files.len()));
    Ok(())
}
