//! A temporary .glb into which a ground of another kind is converted before it is mapped.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::{Error, Result};

/// A temporary file, which is deleted when this is dropped.
pub struct TempGlb {
    pub path: PathBuf,
    _folder: tempfile::TempDir,
}

/// Write a .glb with the file stem of `path` into a temporary folder of its own.
pub fn save(path: &Path, json: &Value, bin: &[u8]) -> Result<TempGlb> {
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let padding = bin.len().next_multiple_of(4) - bin.len();
    let length = 28 + text.len() + bin.len() + padding;
    let folder = tempfile::tempdir().map_err(|e| Error::io(std::env::temp_dir(), e))?;
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_else(|| "ground".into());
    let file = folder.path().join(format!("{stem}.glb"));
    let too_long = |_| Error::Limit { what: "a ground".into(), needed: length as u64, allowed: u32::MAX.into() };
    let mut head = b"glTF\x02\0\0\0".to_vec();
    head.extend(u32::try_from(length).map_err(too_long)?.to_le_bytes());
    head.extend((text.len() as u32).to_le_bytes());
    head.extend(b"JSON");
    head.extend(text);
    head.extend(((bin.len() + padding) as u32).to_le_bytes());
    head.extend(b"BIN\0");
    head.extend(bin);
    head.resize(head.len() + padding, 0);
    std::fs::write(&file, head).map_err(|e| Error::io(&file, e))?;
    Ok(TempGlb { path: file, _folder: folder })
}
