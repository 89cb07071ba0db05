//! What a URL stands for, as files: a texel or a part of it, or a landscape with what it names.

use std::path::{Path, PathBuf};

use super::Need;
use super::client::{Answer, Client};
use super::url::Url;
use crate::cli::{Ui, fetched};
use crate::progress::Progress;
use crate::scene::files::extension;
use crate::scene::gltf;
use crate::{Error, Result, Warnings};

/// Bytes that hold the head of nearly every file.
const FIRST: u64 = 64 << 10;
/// Where a `.vtex` file says how long its head is, and how long that may be.
const HEAD_LENGTH: std::ops::Range<usize> = 16..20;
const LONGEST_HEAD: u64 = 1 << 20;

/// Fetch what `text` names into `folder`, and give the file that stands for it.
pub fn fetch(client: &mut Client, text: &str, need: Need, folder: &Path, ui: &Ui) -> Result<PathBuf> {
    let url = Url::parse(text).map_err(|what| Error::Options(format!("{text}: {what}")))?;
    let root = fetched::subfolder(folder, &url.text, &url.origin, &url.path);
    let mut job = Job { client, origin: &url, root: &root, ui };
    ui.stage("download", 0);
    let file = match need {
        Need::Head => job.head(),
        Need::Landscape => job.landscape(),
        Need::Depths | Need::Whole => job.file(&url, need == Need::Depths),
    };
    ui.finish();
    file?.ok_or_else(|| Error::input(text, "", "the server has no such file"))
}

/// The URL that is being fetched, and where to.
struct Job<'a> {
    client: &'a mut Client,
    origin: &'a Url,
    root: &'a Path,
    ui: &'a Ui,
}

impl Job<'_> {
    /// The first `most` bytes of a file, in its place.
    fn get(&mut self, url: &Url, most: u64) -> Result<Option<(PathBuf, Answer)>> {
        let to = self.root.join(&url.path);
        let parent = to.parent().unwrap_or(self.root);
        std::fs::create_dir_all(parent).map_err(|e| Error::io(parent, e))?;
        Ok(self.client.get(url, most, &to, self.ui)?.map(|answer| (to, answer)))
    }

    /// The head of a texel, in a file that is as long as the texel.
    fn head(&mut self) -> Result<Option<PathBuf>> {
        let Some((to, mut answer)) = self.get(self.origin, FIRST)? else { return Ok(None) };
        let start = crate::format::read_file(&to, FIRST)?;
        let length = start.get(HEAD_LENGTH).and_then(|b| b.try_into().ok()).map_or(0, u32::from_le_bytes);
        if (FIRST..=LONGEST_HEAD).contains(&length.into())
            && let Some((_, longer)) = self.get(self.origin, length.into())?
        {
            answer = longer;
        }
        if let Some(why) = answer.broke {
            return Err(Error::input(&self.origin.text, "", format!("the connection broke: {why}")));
        }
        // Where the server does not say how long it is, it is as long as what came.
        let total = answer.total.unwrap_or(answer.got);
        if answer.got < total.min(length.into()) {
            let what = format!("to download the head of {}, in bytes,", self.origin.text);
            return Err(Error::Limit { what, needed: length.into(), allowed: answer.got });
        }
        let file = std::fs::OpenOptions::new().write(true).open(&to).map_err(|e| Error::io(&to, e))?;
        file.set_len(total).map_err(|e| Error::io(&to, e))?;
        Ok(Some(to))
    }

    /// A file, `None` where there is no such; where a `prefix` will do, as much of it as comes within the limits.
    fn file(&mut self, url: &Url, prefix: bool) -> Result<Option<PathBuf>> {
        let allowed = self.client.left;
        let Some((to, answer)) = self.get(url, u64::MAX)? else { return Ok(None) };
        let Answer { got, total, broke } = answer;
        if let Some(why) = broke {
            let what = format!("the connection broke after {got} bytes: {why}");
            if !prefix {
                return Err(Error::input(&url.text, "", what));
            }
            let mut warnings = Warnings::default();
            warnings.add(format!("{}: {what}", url.text));
            self.ui.warn(&warnings)?;
        } else if !prefix && (total.is_some_and(|total| total > got) || (total.is_none() && got == allowed)) {
            let what = format!("to download {}, in bytes,", url.text);
            return Err(Error::Limit { what, needed: total.unwrap_or(got + 1), allowed });
        }
        Ok(Some(to))
    }

    /// A landscape, and below its folder what it names, and what the models that it names do. What the server does not have
    /// is missing, as it would be on a disk.
    fn landscape(&mut self) -> Result<Option<PathBuf>> {
        let Some(main) = self.file(self.origin, false)? else { return Ok(None) };
        let home = main.parent().unwrap_or(self.root).to_path_buf();
        let mut models = vec![main.clone()];
        while let Some(model) = models.pop() {
            for file in gltf::named_files(&model) {
                // What lies elsewhere is not fetched; the reader of the landscape refuses it.
                let below = file.starts_with(&home);
                let Some(url) =
                    file.strip_prefix(self.root).ok().filter(|_| below).and_then(|p| self.origin.sibling(p))
                else {
                    continue;
                };
                let to = self.root.join(&url.path);
                if to.exists() {
                    continue;
                }
                let kind = extension(&file);
                let found = self.file(&url, kind == "vtex")?;
                models.extend(found.filter(|_| ["gltf", "glb"].contains(&kind.as_str())));
            }
        }
        Ok(Some(main))
    }
}
