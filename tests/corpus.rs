//! Files that earlier versions wrote (`tests/corpus/VERSION/`): each is still valid, holds what it held, and still renders.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};
use vtex::format::{Limits, Reader, verify};

use crate::vectors::listing;

/// The folders of all versions.
pub fn versions() -> Vec<PathBuf> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus");
    let mut all: Vec<PathBuf> = std::fs::read_dir(corpus).unwrap().map(|entry| entry.unwrap().path()).collect();
    all.retain(|path| path.is_dir());
    all.sort();
    all
}

/// Files of a folder by their extension, in order.
pub fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    all.retain(|path| path.extension().is_some_and(|e| e == extension));
    all.sort();
    all
}

/// The digests are of the text that another reader gave, which shares no code with this one.
#[test]
fn texels_of_every_version_hold_what_they_held() {
    let mut count = 0;
    for folder in versions() {
        let digests = std::fs::read_to_string(folder.join("digests")).unwrap();
        let wanted: BTreeMap<&str, &str> =
            digests.lines().map(|line| line.split_once("  ").unwrap()).map(|(digest, name)| (name, digest)).collect();
        let texels = files(&folder, "vtex");
        assert_eq!(texels.len(), wanted.len(), "{}: each file has a digest", folder.display());
        for path in texels {
            verify(&path).unwrap_or_else(|e| panic!("{e}"));
            let volume = Reader::open(&path, &Limits::default()).unwrap().read_all().unwrap();
            let text: String = listing(&volume).iter().flat_map(|line| [line, "\n"]).collect();
            let found: String = Sha256::digest(text).iter().map(|byte| format!("{byte:02x}")).collect();
            assert_eq!(Some(&&*found), wanted.get(path.file_name().unwrap().to_str().unwrap()), "{}", path.display());
            count += 1;
        }
    }
    assert!(count >= 15, "{count}");
}

/// `--strict`: no property of theirs became unknown, and no texel another one.
#[test]
fn landscapes_of_every_version_are_rendered_without_a_warning() {
    let out = tempfile::tempdir().unwrap();
    let mut count = 0;
    for path in versions().iter().flat_map(|folder| files(folder, "glb")) {
        let picture = out.path().join("a.png");
        let mut command = assert_cmd::Command::cargo_bin("vtex").unwrap();
        command.args(["render", "--strict", "--quiet", "--frame", "--size", "32x18", "-o"]).arg(&picture).arg(&path);
        command.assert().success();
        let pixels = image::open(&picture).unwrap().to_rgb8();
        let colours: std::collections::BTreeSet<[u8; 3]> = pixels.pixels().map(|p| p.0).collect();
        assert!(colours.len() > 50, "{}: the texels are seen", path.display());
        count += 1;
    }
    assert!(count >= 2, "{count}");
}
