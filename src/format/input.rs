//! Input files. Files that are not regular are refused before they are opened: a FIFO would make the program wait, and a device could
//! fill its memory.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::{Error, Result};

/// Open a regular file.
///
/// # Errors
/// `Io` where it cannot be opened, `Input` for a folder, a device, a FIFO or a socket.
pub fn open_file(path: &Path) -> Result<File> {
    let io = |e| Error::io(path, e);
    let regular = |is: bool| if is { Ok(()) } else { Err(Error::input(path, "", "is not a file")) };
    regular(std::fs::metadata(path).map_err(io)?.is_file())?;
    let file = File::open(path).map_err(io)?;
    // Checked again, since another file may have taken the name in between.
    regular(file.metadata().map_err(io)?.is_file())?;
    Ok(file)
}

/// All bytes of a regular file of at most `limit` bytes.
///
/// # Errors
/// As [`open_file`], `Io` where it cannot be read, and `Limit`, before its bytes are taken.
pub fn read_file(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let io = |e| Error::io(path, e);
    let file = open_file(path)?;
    let too_long = |needed| Error::Limit { what: format!("reading {}", path.display()), needed, allowed: limit };
    let length = file.metadata().map_err(io)?.len();
    if length > limit {
        return Err(too_long(length));
    }
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(length as usize + 1).map_err(|e| io(std::io::Error::other(e)))?;
    // A file may have more bytes than its size says: those of /proc do, and others may be growing.
    file.take(limit.saturating_add(1)).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > limit { Err(too_long(bytes.len() as u64)) } else { Ok(bytes) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_checked_before_reading() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("five");
        std::fs::write(&path, b"12345").unwrap();
        assert_eq!(read_file(&path, 5).unwrap(), b"12345");
        assert!(matches!(read_file(&path, 4), Err(Error::Limit { needed: 5, allowed: 4, .. })));
        assert!(matches!(read_file(dir.path(), 9), Err(Error::Input { .. })));
        assert!(matches!(read_file(&dir.path().join("six"), 9), Err(Error::Io { .. })));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn what_never_ends_is_not_read() {
        for path in ["/dev/zero", "/dev/null", "/dev/tty"] {
            assert!(matches!(open_file(Path::new(path)), Err(Error::Input { .. })), "{path}");
        }
        // It says that it has no bytes, and has some.
        assert!(matches!(read_file(Path::new("/proc/self/status"), 10), Err(Error::Limit { allowed: 10, .. })));
        assert!(read_file(Path::new("/proc/self/status"), 1 << 20).unwrap().len() > 10);
        let dir = tempfile::tempdir().unwrap();
        let fifo = dir.path().join("fifo");
        assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
        assert!(matches!(open_file(&fifo), Err(Error::Input { .. })));
    }
}
