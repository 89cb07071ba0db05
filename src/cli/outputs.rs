//! Files that a command will write, checked before its work begins.

use std::path::{Path, PathBuf};

use crate::format::PartFile;
use crate::{Error, Result};

/// That each of `writes` has a place where it can be written, and is neither one of `reads` nor written twice.
///
/// # Errors
/// As [`PartFile::create`]; `Options` where an output is an input, or two outputs are one file.
pub fn check<'a>(reads: &[PathBuf], writes: impl IntoIterator<Item = &'a Path>) -> Result<()> {
    let read: Vec<PathBuf> = reads.iter().filter_map(|path| std::fs::canonicalize(path).ok()).collect();
    let mut written: Vec<PathBuf> = Vec::new();
    for path in writes {
        let wrong = |what: &str| Err(Error::Options(format!("{}: {what}", path.display())));
        let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            return Err(Error::input(path, "", "its folder does not exist; make it first"));
        }
        // Made and given up: what cannot be written is known before the work is done.
        drop(PartFile::create(path)?);
        let Some(real) = real_name(path, folder) else { continue };
        if read.contains(&real) {
            return wrong("is also an input; write to another name");
        }
        if written.contains(&real) {
            return wrong("two outputs have this name; give each its own");
        }
        written.push(real);
    }
    Ok(())
}

/// Whether two paths lead to one file, be it there or not.
#[cfg(feature = "bake")]
pub fn same(a: &Path, b: &Path) -> bool {
    let real =
        |path: &Path| real_name(path, path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new(".")));
    real(a).is_some_and(|a| real(b) == Some(a))
}

/// The path without links. `None` for a device or a FIFO: it takes any number of outputs, and what it gives is not lost.
fn real_name(path: &Path, folder: &Path) -> Option<PathBuf> {
    match std::fs::metadata(path) {
        Ok(there) if !there.is_file() => None,
        Ok(_) => std::fs::canonicalize(path).ok(),
        Err(_) => Some(std::fs::canonicalize(folder).ok()?.join(path.file_name()?)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_output_is_no_input_and_no_other_output() {
        let dir = tempfile::tempdir().unwrap();
        let [input, output, third] = ["in", "out", "third"].map(|name| dir.path().join(name));
        std::fs::write(&input, "").unwrap();
        let reads = [input.clone(), dir.path().join("missing")];
        check(&reads, [&*output, &*third]).unwrap();
        assert!(!output.exists(), "nothing is made");
        let refused = |writes: &[&Path]| check(&reads, writes.iter().copied()).unwrap_err().to_string();
        assert!(refused(&[&output, &input]).contains("is also an input"));
        assert!(refused(&[&dir.path().join("./in")]).contains("is also an input"));
        assert!(refused(&[&output, &dir.path().join("./out")]).contains("two outputs"));
        assert!(refused(&[&dir.path().join("no/out")]).contains("folder does not exist"));
        assert!(refused(&[dir.path()]).contains("is a folder"));
        #[cfg(unix)]
        {
            let link = dir.path().join("link");
            std::os::unix::fs::symlink(&input, &link).unwrap();
            assert!(refused(&[&link]).contains("is also an input"));
            let null = Path::new("/dev/null");
            check(&[null.to_path_buf()], [null, null]).unwrap();
        }
        #[cfg(feature = "bake")]
        {
            assert!(same(&input, &dir.path().join("./in")) && same(&output, &dir.path().join("./out")));
            assert!(!same(&input, &output));
        }
    }
}
