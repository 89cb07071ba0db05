//! What a texel was made of: digests and names in its META, and whether a bake would write the same file once more.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

use crate::format::{Limits, Reader};
use crate::scene::files::{hex, sha256};
use crate::{Result, par};

/// Key of META for the digest of all that a bake is a function of.
pub const INPUTS: &str = "inputs_sha256";
/// Bytes of META that the list of sources may take: half of what META may have.
const MAX_SOURCES: usize = 128 << 10;

/// SHA-256 of files, each read once however many texels are made of it.
#[derive(Default)]
pub struct Digests(BTreeMap<PathBuf, String>);

impl Digests {
    /// Read `files` on all threads. One that cannot be read is left to [`Digests::of`], which says so.
    pub fn read_ahead<'a>(&mut self, files: impl Iterator<Item = &'a PathBuf>) {
        let files: Vec<PathBuf> = files.collect::<BTreeSet<_>>().into_iter().cloned().collect();
        let digests = par::map(files.len(), |i| sha256(&files[i]).ok());
        self.0.extend(files.into_iter().zip(digests).filter_map(|(file, digest)| Some((file, digest?))));
    }

    /// # Errors
    /// `Io` where the file cannot be read.
    pub fn of(&mut self, file: &Path) -> Result<String> {
        if let Some(known) = self.0.get(file) {
            return Ok(known.clone());
        }
        let digest = sha256(file)?;
        self.0.insert(file.to_path_buf(), digest.clone());
        Ok(digest)
    }

    /// Names, relative to the input's folder, and digests, as META keeps them.
    ///
    /// # Errors
    /// As [`Digests::of`].
    pub fn sources(&mut self, input: &Path, files: &[PathBuf]) -> Result<Value> {
        let folder = input.parent().unwrap_or(Path::new(""));
        let mut list = Vec::new();
        for file in files {
            let name = file.strip_prefix(folder).ok().filter(|n| n.is_relative()).map(Path::to_path_buf);
            let name = name.or_else(|| file.file_name().map(PathBuf::from)).unwrap_or_default();
            list.push((name.to_string_lossy().replace('\\', "/"), self.of(file)?));
        }
        Ok(source_list(&list))
    }
}

/// Names and digests as META keeps them. Where they take too much room, the first alone, and of the others their number and the
/// digest of the list that `sha256sum` would print of them.
fn source_list(files: &[(String, String)]) -> Value {
    let entry = |(uri, sha256): &(String, String)| json!({ "uri": uri, "sha256": sha256 });
    let list: Vec<Value> = files.iter().map(entry).collect();
    let room: usize = list.iter().map(|entry| entry.to_string().len() + 1).sum();
    let Some((first, rest)) = files.split_first().filter(|_| room > MAX_SOURCES) else { return list.into() };
    let mut digest = Sha256::new();
    for (uri, sha256) in rest {
        digest.update(format!("{sha256}  {uri}\n"));
    }
    json!([entry(first), { "files": rest.len(), "sha256": hex(digest.finalize()) }])
}

/// What a bake is a function of.
#[derive(Debug, Clone, Default)]
pub struct Provenance {
    /// Names and digests of the files that are read.
    sources: Value,
    /// Options that decide on the file, as they were asked for.
    options: Value,
    /// META's [`INPUTS`].
    inputs: String,
}

impl Provenance {
    /// `frames`: of a texel of frames, a digest of what decides on the cube that all share; `animation`: what the frame says of
    /// itself.
    pub fn new(sources: Value, options: &Value, frames: &str, animation: Option<&Value>) -> Provenance {
        let inputs = digest(&json!([generator(), options, sources, frames, animation]));
        Provenance { sources, options: options.clone(), inputs }
    }

    /// Put it into META.
    pub fn store(&self, meta: &mut Map<String, Value>) {
        meta.insert("sources".into(), self.sources.clone());
        meta.insert("options".into(), self.options.clone());
        meta.insert(INPUTS.into(), self.inputs.as_str().into());
    }

    /// The texel at `output`, where a bake would write it once more; else what has changed.
    pub fn unchanged(&self, output: &Path) -> Result<Reader, Change> {
        if !output.is_file() {
            return Err(Change::Missing);
        }
        let reader = Reader::open(output, &Limits { decoded_bytes: u64::MAX }).map_err(|_| Change::Unreadable)?;
        let meta = &reader.head().info.meta;
        let text = |key: &str| meta.get(key).and_then(Value::as_str);
        if text(INPUTS) == Some(&self.inputs) {
            return Ok(reader);
        }
        Err(match (text("generator"), meta.get("sources")) {
            (Some(other), _) if other != generator() => Change::Program(other.to_owned()),
            (_, Some(sources)) if *sources != self.sources => Change::Source(self.difference(sources)),
            _ => Change::Options,
        })
    }

    /// Whether files of the same names are read as META says.
    #[cfg(feature = "render")]
    pub fn has_files_of(&self, meta: &Map<String, Value>) -> bool {
        let names = |sources: &Value| -> Vec<Value> {
            sources.as_array().into_iter().flatten().map(|entry| entry["uri"].clone()).collect()
        };
        meta.get("sources").is_some_and(|old| names(old) == names(&self.sources))
    }

    /// What differs from the sources `old`, in words.
    fn difference(&self, old: &Value) -> String {
        let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
        let (old, new) = (list(old), list(&self.sources));
        let uri = |entry: &Value| entry["uri"].as_str().unwrap_or("one of many files").to_owned();
        match new.iter().find(|entry| !old.contains(entry)) {
            Some(entry) if old.iter().any(|o| uri(o) == uri(entry)) => format!("{} has changed", uri(entry)),
            Some(entry) => format!("{} is new", uri(entry)),
            None => match old.iter().find(|entry| !new.contains(entry)) {
                Some(gone) => format!("{} is gone", uri(gone)),
                None => "the files are in another order".into(),
            },
        }
    }
}

/// Why a texel is not what a bake would write.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Change {
    Missing,
    Unreadable,
    /// Another version of the program made it; its name.
    Program(String),
    /// What has become of a file, in words.
    Source(String),
    /// Options, or files of other frames.
    Options,
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Change::Missing => f.write_str("is not there yet"),
            Change::Unreadable => f.write_str("cannot be read and is made anew"),
            Change::Program(other) => write!(f, "was made by {other} and is made anew"),
            Change::Source(what) => write!(f, "{what}"),
            Change::Options => f.write_str("has other options and is made anew"),
        }
    }
}

/// SHA-256 of a value's text, in hexadecimal.
pub fn digest(value: &Value) -> String {
    hex(Sha256::digest(value.to_string()))
}

/// Program and version, as the bake writes them into META.
fn generator() -> &'static str {
    concat!("vtex ", env!("CARGO_PKG_VERSION"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_list_of_sources_is_a_digest() {
        let files = |n: usize| (0..n).map(|i| (format!("slice{i}.png"), format!("{i:064x}"))).collect::<Vec<_>>();
        assert_eq!(source_list(&files(500)).as_array().unwrap().len(), 500);
        let many = source_list(&files(3000));
        assert_eq!(many[0], json!({ "uri": "slice0.png", "sha256": format!("{:064x}", 0) }));
        let text: String = (1..3000).map(|i| format!("{i:064x}  slice{i}.png\n")).collect();
        let all = hex(Sha256::digest(text));
        assert_eq!(many[1], json!({ "files": 2999, "sha256": all }));
        assert_eq!(many.as_array().unwrap().len(), 2);
    }

    #[test]
    fn a_change_is_named() {
        let list = |files: &[(&str, &str)]| {
            source_list(&files.iter().map(|(a, b)| (a.to_string(), b.to_string())).collect::<Vec<_>>())
        };
        let now = Provenance { sources: list(&[("a.obj", "1"), ("a.mtl", "2")]), ..Provenance::default() };
        for (old, said) in [
            (&[("a.obj", "1"), ("a.mtl", "3")][..], "a.mtl has changed"),
            (&[("a.obj", "1")], "a.mtl is new"),
            (&[("a.obj", "1"), ("a.mtl", "2"), ("a.png", "4")], "a.png is gone"),
            (&[("a.mtl", "2"), ("a.obj", "1")], "the files are in another order"),
        ] {
            assert_eq!(now.difference(&list(old)), said);
        }
    }

    #[test]
    fn everything_that_decides_is_in_the_digest() {
        let of = |sources: Value, options: Value, frames: &str, animation: Option<&Value>| {
            Provenance::new(sources, &options, frames, animation).inputs
        };
        let first = of(json!([1]), json!({ "a": 1 }), "", None);
        assert_eq!(first, of(json!([1]), json!({ "a": 1 }), "", None));
        let others = [
            of(json!([2]), json!({ "a": 1 }), "", None),
            of(json!([1]), json!({ "a": 2 }), "", None),
            of(json!([1]), json!({ "a": 1 }), "f", None),
            of(json!([1]), json!({ "a": 1 }), "", Some(&json!({ "frame": 1 }))),
        ];
        assert!(!others.contains(&first));
    }
}
