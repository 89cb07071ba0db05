//! A folder of slices in natural order, or one file of slices.

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::Stack;
use super::bytes::Spool;
use super::samples::{Samples, byte_count};
use super::slice;
use super::slice::{Slice, is_image};
use crate::geom::DAffine3;
use crate::{Error, Result, Warnings, par};

/// Slices that are decoded at the same time, a thread.
const AHEAD: usize = 4;

/// Names as people count: slice2 before slice10.
pub fn natural(a: &str, b: &str) -> Ordering {
    let (mut x, mut y) = (a.as_bytes(), b.as_bytes());
    while let (Some(&c), Some(&d)) = (x.first(), y.first()) {
        if c.is_ascii_digit() && d.is_ascii_digit() {
            let digits = |s: &[u8]| s.iter().take_while(|c| c.is_ascii_digit()).count();
            let (n, m) = (digits(x), digits(y));
            let bare = |s: &[u8]| s.iter().skip_while(|c| **c == b'0').copied().collect::<Vec<u8>>();
            let (p, q) = (bare(&x[..n]), bare(&y[..m]));
            let order = p.len().cmp(&q.len()).then(p.cmp(&q));
            if order.is_ne() {
                return order;
            }
            (x, y) = (&x[n..], &y[m..]);
        } else if c != d {
            return c.cmp(&d);
        } else {
            (x, y) = (&x[1..], &y[1..]);
        }
    }
    x.len().cmp(&y.len()).then(a.cmp(b))
}

/// The files of a folder in natural order, without hidden ones.
pub fn list(dir: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(|e| Error::io(dir, e))? {
        let path = entry.map_err(|e| Error::io(dir, e))?.path();
        if path.is_file() && !name(&path).starts_with('.') {
            files.push(path);
        }
    }
    files.sort_by(|a, b| natural(&name(a), &name(b)));
    Ok(files)
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The images among files, which all have to be of one kind.
pub fn images(dir: &Path, files: &[PathBuf], warnings: &mut Warnings) -> Result<Vec<PathBuf>> {
    let mut kinds: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
    let mut others = 0;
    for file in files {
        let extension = file.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match extension.as_str() {
            "jpeg" => kinds.entry("jpg".into()).or_default().push(file.clone()),
            "tiff" => kinds.entry("tif".into()).or_default().push(file.clone()),
            e if is_image(e) => kinds.entry(extension).or_default().push(file.clone()),
            _ => others += 1,
        }
    }
    if kinds.len() > 1 {
        let list: Vec<String> = kinds.iter().map(|(kind, files)| format!("{} .{kind}", files.len())).collect();
        let what = format!("holds {}: a folder is one stack, of slices of one kind", list.join(", "));
        return Err(Error::input(dir, "", what));
    }
    let Some((_, slices)) = kinds.into_iter().next() else {
        return Err(Error::input(
            dir,
            "",
            "holds no slices (.png, .tif, .jpg, .exr or DICOM): name one file of it, if it is a volume",
        ));
    };
    warnings.add_many("files of the folder are no images and are left out", others);
    Ok(slices)
}

/// Read slices, one a file, or the pages of one file.
pub fn read(path: &Path, files: &[PathBuf], warnings: Warnings, in_memory: u64) -> Result<Stack> {
    let mut pile = Pile { path, first: None, spool: Spool::new(in_memory), count: 0, files: files.len() };
    let step = AHEAD * par::threads();
    for group in files.chunks(step) {
        if let [file] = group {
            // Page by page, never all at once.
            slice::read(file, &mut |slice| pile.push(file, slice))?;
            continue;
        }
        let decoded = par::map(group.len(), |i| {
            let mut slices = Vec::new();
            slice::read(&group[i], &mut |slice| {
                slices.push(slice);
                if slices.len() > 1 {
                    return Err(Error::input(
                        &group[i],
                        "",
                        "has several pages: among others in a folder it has to be one slice",
                    ));
                }
                Ok(())
            })
            .map(|()| slices)
        });
        for (file, slices) in group.iter().zip(decoded) {
            for slice in slices? {
                pile.push(file, slice)?;
            }
        }
    }
    pile.finish(warnings)
}

/// Slices of the same size, one on the other.
struct Pile<'a> {
    path: &'a Path,
    /// What the others have to be like, and its file.
    first: Option<(Slice, PathBuf)>,
    spool: Spool,
    count: usize,
    files: usize,
}

impl Pile<'_> {
    fn push(&mut self, file: &Path, slice: Slice) -> Result<()> {
        if let Some((first, name_of_first)) = &self.first
            && !first.is_like(&slice)
        {
            let here = if self.files == 1 { format!("page {}", self.count + 1) } else { String::new() };
            let than = if self.files == 1 { "page 1".into() } else { name(name_of_first) };
            let what =
                format!("is {}, but {than} is {}: the slices of a stack are alike", slice.describe(), first.describe());
            return Err(Error::input(file, here, what));
        }
        self.spool.push(&slice.bytes)?;
        self.count += 1;
        if self.first.is_none() {
            self.first = Some((Slice { bytes: Vec::new(), ..slice }, file.to_path_buf()));
        }
        Ok(())
    }

    fn finish(self, warnings: Warnings) -> Result<Stack> {
        let Some((first, _)) = self.first else { return Err(Error::input(self.path, "", "holds no slices")) };
        let dims = [first.width, first.height, self.count];
        if byte_count(dims, first.coding).is_none() {
            return Err(Error::input(self.path, "", "its slices are too many"));
        }
        let samples =
            Samples::new(self.spool.finish()?, 0, first.coding, dims).map_err(|e| Error::input(self.path, "", e))?;
        Stack::new(self.path, samples, DAffine3::IDENTITY, 0.0, warnings)
    }
}
