//! The bake that made a texel, as a command line, from what the texel's META says of it.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use crate::Result;
use crate::cli::bake;
use crate::cli::provenance::Change;
use crate::format::{Limits, Reader};
use crate::source::{PaintOptions, paint_files};

/// A bake of a job.
#[derive(Debug)]
pub struct Rebake {
    pub texel: PathBuf,
    /// `None` of a texel of a string of symbols, which has no file.
    pub source: Option<PathBuf>,
    /// Options of `vtex bake`, a word each.
    pub options: Vec<String>,
    /// All files that are read for it.
    pub files: Vec<PathBuf>,
    /// Why it will not write the texel that is there, if it will not.
    pub change: Option<Change>,
}

impl Rebake {
    /// The bake that made the texel at `path`, whose source lies in one of `folders`, or is `geometry`. The error says, in
    /// words, why there is none.
    ///
    /// # Errors
    /// `Ok(Err(_))`: the texel was made by something else than a bake, or its source is not there. `Io` or `Format` where the
    /// texel cannot be read.
    pub fn find(path: &Path, geometry: Option<&Path>, folders: &[PathBuf]) -> Result<Result<Rebake, String>> {
        let reader = Reader::open(path, &Limits { decoded_bytes: u64::MAX })?;
        let meta = &reader.head().info.meta;
        let (Some(Value::Object(said)), Some(Value::Array(sources))) = (meta.get("options"), meta.get("sources"))
        else {
            return Ok(Err("it was not made by a bake".into()));
        };
        if meta.contains_key("animation") {
            return Ok(Err("it is a frame of several".into()));
        }
        let Some(options) = flags(said) else {
            return Ok(Err("its options cannot be told from the file".into()));
        };
        let paint = PaintOptions {
            albedo: said.get("albedo").and_then(Value::as_str).map(str::to_owned),
            ..PaintOptions::default()
        };
        if !paint_files(&paint).is_empty() {
            return Ok(Err("its --albedo is a file, which has no place in a job".into()));
        }
        let source = match sources.first().and_then(|s| s["uri"].as_str()) {
            None => None,
            Some(uri) => match find_source(uri, geometry, folders) {
                None => return Ok(Err(format!("{uri} was not found; --sources names its folder"))),
                found => found,
            },
        };
        let words = source.iter().map(|s| s.to_string_lossy().into_owned()).chain(options.iter().cloned());
        let (files, provenance) = bake::provenance_of(words)?;
        let change = provenance.unchanged(path).err();
        // Otherwise it is not the bake that made the texel.
        if change == Some(Change::Options) || !provenance.has_files_of(meta) {
            return Ok(Err("its options or its files cannot be told from the file".into()));
        }
        Ok(Ok(Rebake { texel: path.to_path_buf(), source, options, files, change }))
    }
}

/// The file that META calls `uri`: the landscape's geometry where that has the name, or a file of the name in a folder.
fn find_source(uri: &str, geometry: Option<&Path>, folders: &[PathBuf]) -> Option<PathBuf> {
    let name = Path::new(uri).file_name()?;
    let own = geometry.filter(|path| path.file_name() == Some(name)).map(Path::to_path_buf);
    own.into_iter().chain(folders.iter().map(|folder| folder.join(uri))).find(|path| path.is_file())
}

/// Options as META has them → words for `vtex bake`; those that are as by default are left out. `None` where one cannot be said.
pub fn flags(options: &Map<String, Value>) -> Option<Vec<String>> {
    let defaults = bake::default_options();
    let mut words = Vec::new();
    for (key, value) in options.iter().filter(|(key, value)| defaults.get(*key) != Some(*value)) {
        let flag = format!("--{}", key.replace('_', "-"));
        let text = |value: &Value| match value {
            Value::String(text) => Some(text.clone()),
            Value::Number(number) => Some(number.to_string()),
            _ => None,
        };
        match (key.as_str(), value) {
            ("tint", Value::Bool(true)) => words.push(flag),
            ("include" | "exclude" | "animation", Value::Array(list)) => {
                for value in list {
                    words.push(format!("{flag}={}", text(value)?));
                }
            }
            ("cyclic" | "window" | "spacing", Value::Array(list)) => {
                let list: Vec<String> = list.iter().map(text).collect::<Option<_>>()?;
                words.push(format!("{flag}={}", list.join(",")));
            }
            ("define", Value::Object(map)) => {
                for (name, value) in map {
                    words.push(format!("{flag}={name}={}", text(value)?));
                }
            }
            ("translucency", Value::Array(list)) => {
                for one in list {
                    let share = text(&one["share"])?;
                    let of = one["material"].as_str().map(|name| format!("{name}=")).unwrap_or_default();
                    words.push(format!("{flag}={of}{share}"));
                }
            }
            // Of a table of opacities META has what is in the file, not its name.
            ("transfer", _) => return None,
            _ => words.push(format!("{flag}={}", text(value)?)),
        }
    }
    Some(words)
}
