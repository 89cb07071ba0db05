//! What is written is readable: every bake of the tests goes through here, and `vtex verify` has to agree.

use std::path::Path;

use vtex::format;
use vtex::volume::Volume;

/// That a file breaks no rule of the format.
pub fn verify(path: &Path) {
    format::verify(path).unwrap();
}

/// The volume, after it was written and verified.
pub fn readable(volume: Volume) -> Volume {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("t.vtex");
    // The quickest level: it is the rules that count here.
    format::write(&volume, &path, &format::WriteOptions { level: 1, ..Default::default() }).unwrap();
    verify(&path);
    volume
}
