//! Frames of a sequence: which there are, when they are, and how their files are called.

use std::path::{Path, PathBuf};

use crate::{Error, Result};

/// Largest number of a frame.
const MAX_NUMBER: u32 = 999_999;
/// Most frames in a sequence.
const MAX_FRAMES: u32 = 100_000;

/// Frames from the first to the last, both included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frames {
    pub first: u32,
    pub last: u32,
    /// Whether only their number was given.
    pub counted: bool,
}

impl Frames {
    pub fn count(self) -> u32 {
        self.last - self.first + 1
    }

    pub fn numbers(self) -> std::ops::RangeInclusive<u32> {
        self.first..=self.last
    }
}

/// `A..B` or `A-B`, both included, or `N` for 0 to N − 1.
pub fn parse(text: &str) -> std::result::Result<Frames, String> {
    let number = |s: &str| {
        let value: Option<u32> = s.trim().parse().ok().filter(|n| *n <= MAX_NUMBER);
        value.ok_or_else(|| format!("{s:?} is not a whole number from 0 to {MAX_NUMBER}"))
    };
    // Render farms say 5-8.
    let frames = match text.split_once("..").or_else(|| text.split_once('-')) {
        Some((a, b)) => Frames { first: number(a)?, last: number(b.trim_start_matches('='))?, counted: false },
        None => match number(text)? {
            0 => return Err("at least one frame is needed".into()),
            n => Frames { first: 0, last: n - 1, counted: true },
        },
    };
    if frames.first > frames.last {
        return Err(format!("frame {} comes after frame {}: FIRST..LAST is needed", frames.first, frames.last));
    }
    if frames.count() > MAX_FRAMES {
        return Err(format!("{} frames are more than {MAX_FRAMES}", frames.count()));
    }
    Ok(frames)
}

/// Where the number of a frame stands in a file's name: the last row of `#`.
fn place(name: &str) -> Option<(usize, usize)> {
    let end = name.rfind('#')? + 1;
    let start = name[..end].rfind(|c| c != '#').map_or(0, |i| i + name[i..].chars().next().map_or(1, char::len_utf8));
    Some((start, end))
}

/// Whether a file's name has a place for a number, as `smoke.####.nii`.
pub fn is_numbered(path: &Path) -> bool {
    path.file_name().and_then(|n| n.to_str()).is_some_and(|n| n.contains('#'))
}

/// The name with `.####` before its extension, where it has no place for a number.
pub fn with_place(path: &Path) -> PathBuf {
    if is_numbered(path) {
        return path.to_path_buf();
    }
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let extension = path.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default();
    path.with_file_name(format!("{stem}.####{extension}"))
}

/// The file of a frame: its number, with zeros before it, in place of the last row of `#` in the name.
pub fn file(path: &Path, frame: u32) -> PathBuf {
    let Some(name) = path.file_name().and_then(|n| n.to_str()) else { return path.to_path_buf() };
    let Some((start, end)) = place(name) else { return path.to_path_buf() };
    path.with_file_name(format!("{}{frame:0width$}{}", &name[..start], &name[end..], width = end - start))
}

/// The numbered files that are there, in order, without a gap between them.
///
/// # Errors
/// [`Error::Input`] where there are none, or one between them is missing.
pub fn found(path: &Path) -> Result<Vec<(u32, PathBuf)>> {
    let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Some((start, end)) = place(name) else { return Ok(vec![(0, path.to_path_buf())]) };
    let mut numbers: Vec<u32> = Vec::new();
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?;
    for entry in entries.flatten() {
        let other = entry.file_name();
        let number = other.to_str().and_then(|n| n.strip_prefix(&name[..start])?.strip_suffix(&name[end..]));
        let number = number.filter(|n| n.len() >= end - start && n.bytes().all(|b| b.is_ascii_digit()));
        numbers.extend(number.and_then(|n| n.parse::<u32>().ok()).filter(|n| *n <= MAX_NUMBER));
    }
    numbers.sort_unstable();
    numbers.dedup();
    if numbers.is_empty() {
        return Err(Error::input(path, "", "there is no file of this name with a number in place of the #"));
    }
    if let Some(pair) = numbers.windows(2).find(|p| p[1] != p[0] + 1) {
        let missing = file(path, pair[0] + 1);
        return Err(Error::input(missing, "", format!("this frame is missing between {} and {}", pair[0], pair[1])));
    }
    Ok(numbers.into_iter().map(|n| (n, file(path, n))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges() {
        assert_eq!(parse("24"), Ok(Frames { first: 0, last: 23, counted: true }));
        assert_eq!(parse("5..8"), Ok(Frames { first: 5, last: 8, counted: false }));
        assert_eq!(parse("5..=8").unwrap().count(), 4);
        assert_eq!(parse("5-8"), parse("5..8"));
        assert_eq!(parse("5-5").unwrap().count(), 1);
        assert!(parse("5..2").unwrap_err().contains("frame 5 comes after frame 2"));
        for wrong in ["", "0", "-1", "5-", "1-2-3", "a..b", "1..", "1.5", "0..999999", "9999999"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn names() {
        let named = |p: &str, n| file(Path::new(p), n).to_string_lossy().into_owned();
        assert_eq!(named("a/pic.####.png", 7), "a/pic.0007.png");
        assert_eq!(named("pic#.png", 12345), "pic12345.png");
        assert_eq!(named("ä###ö##.png", 1), "ä###ö01.png");
        assert_eq!(named("##.png", 1), "01.png");
        assert_eq!(with_place(Path::new("a/b.vtex")), Path::new("a/b.####.vtex"));
        assert_eq!(with_place(Path::new("a/b#.vtex")), Path::new("a/b#.vtex"));
    }

    #[test]
    fn numbered_files_are_found_in_order() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["s.0009.x", "s.0010.x", "s.0008.x", "s.10.x", "s.abcd.x", "t.0007.x", "s.0007.y"] {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        let files = found(&dir.path().join("s.####.x")).unwrap();
        assert_eq!(files.iter().map(|f| f.0).collect::<Vec<_>>(), [8, 9, 10]);
        assert!(files[2].1.ends_with("s.0010.x"));
        std::fs::remove_file(dir.path().join("s.0009.x")).unwrap();
        let error = found(&dir.path().join("s.####.x")).unwrap_err().to_string();
        assert!(error.contains("s.0009.x") && error.contains("missing between 8 and 10"), "{error}");
        assert!(found(&dir.path().join("u.####.x")).unwrap_err().to_string().contains("no file of this name"));
    }
}
