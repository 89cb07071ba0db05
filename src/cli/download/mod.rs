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

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use super::Ui;
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
        self.folder.iter().for_each(|folder| remove(folder));
    }
}

/// A folder of files that were fetched.
struct Fetched {
    folder: PathBuf,
    /// How paths begin, and the beginnings of URLs that stand for them in messages; the first that fits.
    names: Vec<(String, String)>,
}

/// What was fetched: messages name it by its URL, also the last one, when it is gone; and signals remove it.
static FETCHED: Mutex<Vec<Fetched>> = Mutex::new(Vec::new());

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
        let folder = make_folder()?;
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

/// A new folder for what is fetched.
#[cfg(feature = "http")]
fn make_folder() -> Result<PathBuf> {
    let here = std::env::temp_dir();
    let folder = tempfile::Builder::new().prefix("vtex-").tempdir_in(&here).map_err(|e| Error::io(&here, e))?.keep();
    let fetched = Fetched { folder: folder.clone(), names: Vec::new() };
    if let Ok(mut all) = FETCHED.lock() {
        all.push(fetched);
    }
    Ok(folder)
}

/// A subfolder of `folder` for what is fetched from `url`, which stands for it in messages from now on.
#[cfg(feature = "http")]
fn subfolder(folder: &Path, url: &url::Url) -> PathBuf {
    let mut all = FETCHED.lock();
    let fetched = all.iter_mut().flat_map(|all| all.iter_mut()).find(|fetched| fetched.folder == folder);
    let Some(fetched) = fetched else { return folder.to_path_buf() };
    let own = folder.join(fetched.names.len().to_string());
    // The file itself as it was named; what comes with it by its path. With a separator, so that `1` is not the beginning of `10`.
    fetched.names.push((own.join(&url.path).display().to_string(), url.text.clone()));
    fetched.names.push((format!("{}{}", own.display(), std::path::MAIN_SEPARATOR), format!("{}/", url.origin)));
    own
}

/// The text with URLs in place of the files that were fetched from them.
pub fn named(text: &str) -> Cow<'_, str> {
    let mut out = Cow::Borrowed(text);
    let Ok(all) = FETCHED.lock() else { return out };
    for (path, url) in all.iter().flat_map(|fetched| &fetched.names) {
        if out.contains(path) {
            out = Cow::Owned(out.replace(path, url));
        }
    }
    out
}

/// Remove all that was fetched: the program is about to end.
pub fn remove_all() {
    let folders: Vec<PathBuf> =
        FETCHED.lock().map(|all| all.iter().map(|fetched| fetched.folder.clone()).collect()).unwrap_or_default();
    folders.iter().for_each(|folder| remove(folder));
}

/// Remove a folder of fetched files. That one cannot be removed is nothing that the user could mend.
fn remove(folder: &Path) {
    let _ = std::fs::remove_dir_all(folder);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_called_by_their_urls() {
        let folder = std::env::temp_dir().join("vtex-named-by-urls");
        let name = |path: &str, url: &str| (folder.join(path).display().to_string(), url.to_owned());
        let names = vec![
            name("0/a b.vtex", "http://localhost:1/a%20b.vtex?c"),
            name("0/", "http://localhost:1/"),
            name("1/", "https://[::1]:2/"),
        ];
        FETCHED.lock().unwrap().push(Fetched { folder: folder.clone(), names });
        let path = |name: &str| folder.join(name).display().to_string();
        let text = format!("{}: is cut; {} and {} too", path("0/a b.vtex"), path("0/c.glb"), path("1/c/d.glb"));
        let wanted =
            "http://localhost:1/a%20b.vtex?c: is cut; http://localhost:1/c.glb and https://[::1]:2/c/d.glb too";
        assert_eq!(named(&text), wanted);
        for unknown in [path("10/a"), "/0/a".to_owned()] {
            assert_eq!(named(&unknown), unknown);
        }
    }
}
