//! Inputs that are URLs: fetched into a temporary folder before a command runs, so that all else only ever sees files.
//!
//! Of a texel whose head is all that is needed, 64 KiB are asked for, as `format-spec/vtex-1.md` §7.1 advises. With a
//! landscape come the files that it names below its own folder. SECURITY.md says what is refused, and why.

#[cfg(feature = "http")]
mod client;
#[cfg(feature = "http")]
mod fetch;
#[cfg(feature = "http")]
mod url;

use std::path::{Path, PathBuf};

use super::{Ui, fetched};
use crate::{Error, Result};

/// What is fetched, and how much of it.
#[derive(clap::Args)]
#[command(next_help_heading = "Inputs by http:// and https://")]
pub struct DownloadArgs {
    /// Let URLs name other machines than this one
    #[cfg(feature = "http")]
    #[arg(long)]
    allow_remote: bool,
    /// Most bytes that are fetched; of a longer texel, those depths are used that are whole
    #[cfg(feature = "http")]
    #[arg(long, value_name = "BYTES", value_parser = super::quantity::bytes, default_value = "2G")]
    max_download: u64,
    /// Most seconds that fetching may take
    #[cfg(feature = "http")]
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..=86_400), default_value_t = 600)]
    download_timeout: u64,
}

/// What a command needs of its inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// The head of a texel. The file that stands for it has its length, and a hole after the head.
    Head,
    /// A texel, of which those depths will do that are whole.
    #[cfg_attr(not(feature = "render"), allow(dead_code))]
    Depths,
    /// A file as it is.
    #[cfg_attr(not(feature = "bake"), allow(dead_code))]
    Whole,
    /// A landscape with all that it names.
    #[cfg_attr(not(feature = "render"), allow(dead_code))]
    Landscape,
}

/// Fetched files, which are removed when this is dropped.
#[must_use]
pub struct Downloads {
    folder: Option<PathBuf>,
}

impl Downloads {
    /// Refuse a depfile where an input was fetched: make does not know whether it has changed.
    ///
    /// # Errors
    /// `Options`.
    pub fn no_depfile(&self, depfile: Option<&Path>) -> Result<()> {
        match depfile.filter(|_| self.folder.is_some()) {
            Some(_) => Err(Error::Options("--depfile is of files: make cannot follow a URL; download it first".into())),
            None => Ok(()),
        }
    }
}

impl Drop for Downloads {
    fn drop(&mut self) {
        self.folder.iter().for_each(|folder| fetched::remove(folder));
    }
}

/// Fetch the URLs among `inputs`, and put the files in their places.
///
/// # Errors
/// `Options` for a URL that is not to be followed, `Input` for one that does not give a file, `Limit` for one that gives too
/// much, `Io` where the network fails.
pub fn local(inputs: &mut [PathBuf], need: Need, args: &DownloadArgs, ui: &Ui) -> Result<Downloads> {
    let is_url = |input: &PathBuf| {
        let text = input.to_string_lossy();
        ["http://", "https://"]
            .iter()
            .any(|scheme| text.get(..scheme.len()).is_some_and(|s| s.eq_ignore_ascii_case(scheme)))
    };
    if !inputs.iter().any(is_url) {
        return Ok(Downloads { folder: None });
    }
    #[cfg(feature = "http")]
    {
        let folder = fetched::make_folder()?;
        // From here on it is removed whatever happens.
        let downloads = Downloads { folder: Some(folder.clone()) };
        let mut client = client::Client::new(args.allow_remote, args.max_download, args.download_timeout);
        for input in inputs.iter_mut().filter(|input| is_url(input)) {
            *input = fetch::fetch(&mut client, &input.to_string_lossy(), need, &folder, ui)?;
        }
        Ok(downloads)
    }
    #[cfg(not(feature = "http"))]
    {
        let _ = (need, args, ui);
        let url = inputs.iter().find(|input| is_url(input)).map(|url| url.display().to_string()).unwrap_or_default();
        Err(Error::Options(format!("{url}: this vtex was built without the feature `http`; download the file first")))
    }
}
