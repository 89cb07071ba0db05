//! The folders of what was fetched from URLs: messages name files by their URLs, and nothing of them is left.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

#[cfg(feature = "http")]
use crate::{Error, Result};

/// A folder of files that were fetched.
struct Fetched {
    folder: PathBuf,
    /// How paths begin, and the beginnings of URLs that stand for them in messages; the first that fits.
    names: Vec<(String, String)>,
}

/// What was fetched: messages name it by its URL, also the last one, when it is gone; and signals remove it.
static FETCHED: Mutex<Vec<Fetched>> = Mutex::new(Vec::new());

/// A new folder for what is fetched.
#[cfg(feature = "http")]
pub fn make_folder() -> Result<PathBuf> {
    let here = std::env::temp_dir();
    let folder = tempfile::Builder::new().prefix("vtex-").tempdir_in(&here).map_err(|e| Error::io(&here, e))?.keep();
    let fetched = Fetched { folder: folder.clone(), names: Vec::new() };
    if let Ok(mut all) = FETCHED.lock() {
        all.push(fetched);
    }
    Ok(folder)
}

/// A subfolder of `folder` for what is fetched from the URL `text`, of that origin and path, which stands for it in messages
/// from now on.
#[cfg(feature = "http")]
pub fn subfolder(folder: &Path, text: &str, origin: &str, path: &Path) -> PathBuf {
    let mut all = FETCHED.lock();
    let fetched = all.iter_mut().flat_map(|all| all.iter_mut()).find(|fetched| fetched.folder == folder);
    let Some(fetched) = fetched else { return folder.to_path_buf() };
    let own = folder.join(fetched.names.len().to_string());
    // The file itself as it was named; what comes with it by its path. With a separator, so that `1` is not the beginning of `10`.
    fetched.names.push((own.join(path).display().to_string(), text.to_owned()));
    fetched.names.push((format!("{}{}", own.display(), std::path::MAIN_SEPARATOR), format!("{origin}/")));
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
pub fn remove(folder: &Path) {
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
