//! Output files that appear under their names when they are complete, or not at all.
//!
//! The rules are the same for every file that this crate writes:
//! - Bytes go to a new file in the output's folder, which takes the output's name at the end. Where the system can (Linux,
//!   most of its file systems) the new file has no name until then, so that even a killed process leaves nothing behind;
//!   elsewhere it is `.vtex-PROCESS-N.part`, opened so that it cannot be another's. To replace a file it needs such a name
//!   for a moment there too: a process that is killed by SIGKILL just then leaves one behind, which may be removed.
//! - An output that is there keeps its permissions, and its owner where the system allows that. Other hard links to it keep
//!   the old content.
//! - A symbolic link is followed: what it points to is replaced, the link stays. A link that points to nothing is refused.
//! - Bytes are on the disk before the file takes its name, and its folder's entry before the work counts as done, where the
//!   system can say so: a machine that loses its power has the old file or the new one, and after a success the new one.
//! - A device, a FIFO, and a name of an open file (`/dev/stdout`, `/dev/fd/1`) get all bytes at the end. A folder is refused.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Cursor, ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::{Error, Result};

/// Beginning and end of a temporary file's name.
pub const PART_NAME: [&str; 2] = [".vtex-", ".part"];
/// Names that are tried for a temporary file: more than a process writes at once.
const MAX_NAMES: u32 = 1 << 16;

/// A file that takes its name when [`PartFile::finish`]ed; dropped before, nothing is left of it.
pub struct PartFile {
    sink: Sink,
    path: PathBuf,
}

enum Sink {
    Replacing {
        file: BufWriter<File>,
        /// The temporary name, where the file has one.
        part: Option<PathBuf>,
        /// `path` with links followed.
        target: PathBuf,
    },
    /// What a device or a FIFO gets in the end.
    Stream(Cursor<Vec<u8>>),
    Finished,
}

impl PartFile {
    /// Start writing what will be `path`; an existing `path` stays as it is until the end.
    ///
    /// # Errors
    /// `Options` where `path` names no file, a folder, or a link to nothing; `Io` where its folder is not there or may not
    /// be written to.
    pub fn create(path: impl AsRef<Path>) -> Result<PartFile> {
        let path = path.as_ref();
        let wrong = |what: &str| Err(Error::Options(format!("{}: {what}", path.display())));
        let separators: &[char] = if cfg!(windows) { &['/', '\\'] } else { &['/'] };
        if path.file_name().is_none() || path.to_string_lossy().ends_with(separators) {
            return wrong("the output needs a file name");
        }
        let io = |e| Error::io(path, e);
        let old = match fs::metadata(path) {
            Ok(old) if old.is_dir() => return wrong("is a folder; name a file in it"),
            Ok(old) if !old.is_file() || names_open_file(path) => {
                return Ok(PartFile { sink: Sink::Stream(Cursor::default()), path: path.to_path_buf() });
            }
            Ok(old) => Some(old),
            Err(e) if e.kind() != ErrorKind::NotFound => return Err(io(e)),
            Err(_) if fs::symlink_metadata(path).is_ok() => return wrong("is a link to nothing; remove it first"),
            Err(_) => None,
        };
        let target = if old.is_some() { fs::canonicalize(path).map_err(io)? } else { path.to_path_buf() };
        let (file, part) = unnamed(&folder(&target)).map_or_else(|| named(&folder(&target)), Ok).map_err(io)?;
        if let Some(old) = old {
            keep_access(&file, &old);
        }
        let file = BufWriter::with_capacity(1 << 18, file);
        Ok(PartFile { sink: Sink::Replacing { file, part, target }, path: path.to_path_buf() })
    }

    /// Bring to the disk what was written, so that little is left to do when it takes its name.
    ///
    /// # Errors
    /// `Io` where it cannot be written.
    pub fn sync(&mut self) -> Result<()> {
        match &mut self.sink {
            Sink::Replacing { file, .. } => file.flush().and_then(|()| file.get_ref().sync_all()),
            Sink::Stream(_) | Sink::Finished => Ok(()),
        }
        .map_err(|e| Error::io(&self.path, e))
    }

    /// Flush to the disk, take the name, and bring the folder to the disk.
    ///
    /// # Errors
    /// `Io`. Where the folder alone cannot be brought to the disk, the file has its name.
    pub fn finish(mut self) -> Result<()> {
        let done = match std::mem::replace(&mut self.sink, Sink::Finished) {
            Sink::Replacing { file, part, target } => {
                let done = file
                    .into_inner()
                    .map_err(io::IntoInnerError::into_error)
                    .and_then(|file| file.sync_all().map(|()| file))
                    .and_then(|file| match &part {
                        Some(part) => fs::rename(part, &target),
                        None => take_name(&file, &target),
                    });
                if let (Err(_), Some(part)) = (&done, &part) {
                    let _ = fs::remove_file(part);
                }
                done.and_then(|()| sync_folder(&folder(&target)))
            }
            // Appended: a redirected standard output may hold something already.
            Sink::Stream(bytes) => {
                OpenOptions::new().append(true).open(&self.path).and_then(|mut to| to.write_all(bytes.get_ref()))
            }
            Sink::Finished => Ok(()),
        };
        done.map_err(|e| Error::io(&self.path, e))
    }
}

/// Write `bytes` as `path`.
///
/// # Errors
/// As [`PartFile::create`], and `Io` where it cannot be written.
pub fn save(path: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
    let mut part = PartFile::create(path.as_ref())?;
    part.write_all(bytes).map_err(|e| Error::io(path.as_ref(), e))?;
    part.finish()
}

impl Write for PartFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.sink {
            Sink::Replacing { file, .. } => file.write(bytes),
            Sink::Stream(all) => all.write(bytes),
            Sink::Finished => Err(ErrorKind::BrokenPipe.into()),
        }
    }
    fn flush(&mut self) -> io::Result<()> {
        match &mut self.sink {
            Sink::Replacing { file, .. } => file.flush(),
            Sink::Stream(_) | Sink::Finished => Ok(()),
        }
    }
}

impl Seek for PartFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match &mut self.sink {
            Sink::Replacing { file, .. } => file.seek(to),
            Sink::Stream(all) => all.seek(to),
            Sink::Finished => Err(ErrorKind::BrokenPipe.into()),
        }
    }
}

impl Drop for PartFile {
    fn drop(&mut self) {
        if let Sink::Replacing { part: Some(part), .. } = &self.sink {
            let _ = fs::remove_file(part);
        }
    }
}

fn folder(path: &Path) -> PathBuf {
    path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_path_buf()
}

/// Bring a folder's entries to the disk. Not every system opens a folder, and not every file system can do this.
fn sync_folder(folder: &Path) -> io::Result<()> {
    match File::open(folder).map(|f| f.sync_all()) {
        Ok(Err(e)) if !matches!(e.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => Err(e),
        _ => Ok(()),
    }
}

/// Whether the name stands for a file that is open already: its entry in a folder must not be replaced.
fn names_open_file(path: &Path) -> bool {
    ["/dev/stdout", "/dev/stderr", "/dev/fd", "/proc"].iter().any(|special| path.starts_with(special))
}

/// Give the new file the permissions and, where the system allows it, the owner of the old one.
fn keep_access(new: &File, old: &fs::Metadata) {
    #[cfg(unix)]
    {
        use std::os::unix::fs::{MetadataExt, fchown};
        let _ = fchown(new, Some(old.uid()), Some(old.gid()));
    }
    let _ = new.set_permissions(old.permissions());
}

/// A new file in `folder` without a name, where the system has such.
fn unnamed(folder: &Path) -> Option<(File, Option<PathBuf>)> {
    #[cfg(target_os = "linux")]
    {
        use std::os::unix::fs::OpenOptionsExt;
        // It gets its name through /proc, which some containers do not have.
        let flags =
            i32::try_from(rustix::fs::OFlags::TMPFILE.bits()).ok().filter(|_| Path::new(OPEN_FILES).is_dir())?;
        let file = OpenOptions::new().write(true).custom_flags(flags).open(folder).ok()?;
        Some((file, None))
    }
    #[cfg(not(target_os = "linux"))]
    {
        let _ = folder;
        None
    }
}

/// A new file in `folder` with a name that no other file has.
fn named(folder: &Path) -> io::Result<(File, Option<PathBuf>)> {
    with_part_name(folder, |part| OpenOptions::new().write(true).create_new(true).open(part))
        .map(|(file, part)| (file, Some(part)))
}

/// The first temporary name that `make` finds free.
fn with_part_name<T>(folder: &Path, make: impl Fn(&Path) -> io::Result<T>) -> io::Result<(T, PathBuf)> {
    let [start, end] = PART_NAME;
    for n in 0..MAX_NAMES {
        let part = folder.join(format!("{start}{}-{n}{end}", std::process::id()));
        match make(&part) {
            Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
            made => return made.map(|made| (made, part)),
        }
    }
    Err(ErrorKind::AlreadyExists.into())
}

#[cfg(target_os = "linux")]
const OPEN_FILES: &str = "/proc/self/fd";

/// Give a file without a name the name `target`.
#[cfg(target_os = "linux")]
fn take_name(file: &File, target: &Path) -> io::Result<()> {
    use rustix::fs::{AtFlags, CWD, linkat};
    use std::os::fd::AsRawFd;
    let open = format!("{OPEN_FILES}/{}", file.as_raw_fd());
    let link = |name: &Path| linkat(CWD, &open, CWD, name, AtFlags::SYMLINK_FOLLOW).map_err(io::Error::from);
    match link(target) {
        Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
        done => return done,
    }
    // A name that is taken is only replaced by another name.
    let ((), part) = with_part_name(&folder(target), link)?;
    fs::rename(&part, target).inspect_err(|_| {
        let _ = fs::remove_file(&part);
    })
}

#[cfg(not(target_os = "linux"))]
fn take_name(_: &File, _: &Path) -> io::Result<()> {
    Err(ErrorKind::Unsupported.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names in a folder.
    fn names(dir: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn takes_its_name_only_when_finished() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a b.vtex");
        save(&path, b"first").unwrap();
        let mut part = PartFile::create(&path).unwrap();
        part.write_all(b"new").unwrap();
        drop(part);
        assert_eq!(fs::read(&path).unwrap(), b"first");
        assert_eq!(names(dir.path()), ["a b.vtex"]);
        let mut part = PartFile::create(&path).unwrap();
        part.write_all(b"  w").unwrap();
        part.seek(SeekFrom::Start(0)).unwrap();
        part.write_all(b"ne").unwrap();
        part.finish().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(names(dir.path()), ["a b.vtex"]);
    }

    #[test]
    fn two_writers_to_one_name_do_not_meet() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("o");
        let [mut a, mut b] = [PartFile::create(&path).unwrap(), PartFile::create(&path).unwrap()];
        for _ in 0..100 {
            a.write_all(&[b'a'; 10_000]).unwrap();
            b.write_all(&[b'b'; 9_000]).unwrap();
        }
        a.finish().unwrap();
        assert_eq!(fs::read(&path).unwrap(), [b'a'; 1_000_000]);
        b.finish().unwrap();
        assert_eq!(fs::read(&path).unwrap(), [b'b'; 900_000]);
        assert_eq!(names(dir.path()), ["o"]);
    }

    #[test]
    fn temporary_names_are_nobody_elses() {
        let dir = tempfile::tempdir().unwrap();
        let taken = dir.path().join(format!(".vtex-{}-0.part", std::process::id()));
        fs::write(&taken, "another's").unwrap();
        let (file, part) = named(dir.path()).unwrap();
        assert_eq!(part.as_ref().unwrap(), &dir.path().join(format!(".vtex-{}-1.part", std::process::id())));
        let target = dir.path().join("o");
        let mut named = PartFile {
            sink: Sink::Replacing { file: BufWriter::new(file), part, target: target.clone() },
            path: target.clone(),
        };
        named.write_all(b"mine").unwrap();
        named.finish().unwrap();
        assert_eq!((fs::read(&taken).unwrap(), fs::read(&target).unwrap()), (b"another's".to_vec(), b"mine".to_vec()));
        assert_eq!(names(dir.path()).len(), 2);
    }

    #[test]
    fn what_is_no_place_for_a_file_is_an_error_that_names_it() {
        let dir = tempfile::tempdir().unwrap();
        let refused = |path: PathBuf| PartFile::create(path).err().unwrap().to_string();
        assert!(refused(dir.path().join("no/such.vtex")).contains("such.vtex"));
        assert!(refused(dir.path().to_path_buf()).contains("is a folder"));
        assert!(refused(dir.path().join("such/")).contains("needs a file name"));
        assert!(refused("..".into()).contains("needs a file name"));
        assert!(names(dir.path()).is_empty());
    }

    #[cfg(unix)]
    #[test]
    fn permissions_are_kept_and_links_followed() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let dir = tempfile::tempdir().unwrap();
        let [path, link, gone] = ["file", "link", "gone"].map(|name| dir.path().join(name));
        fs::write(&path, "old").unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o7777;
        let usual = mode(&path);
        for kept in [0o640, 0o444] {
            fs::set_permissions(&path, fs::Permissions::from_mode(kept)).unwrap();
            save(&path, b"new").unwrap();
            assert_eq!(mode(&path), kept);
        }
        save(dir.path().join("another"), b"").unwrap();
        assert_eq!(mode(&dir.path().join("another")), usual);
        symlink("file", &link).unwrap();
        save(&link, b"through").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"through");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        symlink("nowhere", &gone).unwrap();
        assert!(save(&gone, b"").unwrap_err().to_string().contains("a link to nothing"));
        assert_eq!(names(dir.path()), ["another", "file", "gone", "link"]);
    }

    #[cfg(unix)]
    #[test]
    fn devices_get_all_at_the_end() {
        save("/dev/null", b"something").unwrap();
        assert!(fs::symlink_metadata("/dev/null").unwrap().file_type() != fs::metadata(".").unwrap().file_type());
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
    }
}
