//! A folder of slices in natural order, or one file of slices.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::bytes::Spool;
use super::choice::Choice;
use super::coding::byte_count;
use super::natural::natural;
use super::samples::Samples;
use super::slice::{self, ImageInfo, Sink, Slice, is_image};
use super::split::{by_names, oddities};
use super::{Channels, Stack};
use crate::geom::{DAffine3, DVec3};
use crate::scene::files::extension;
use crate::{Error, Result, Warnings, par};

/// Number of slices per thread that are decoded at the same time.
const AHEAD: usize = 4;

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
        let extension = extension(file);
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
        let folders: Vec<String> = std::fs::read_dir(dir)
            .map_err(|e| Error::io(dir, e))?
            .filter_map(|e| Some(e.ok()?.path()))
            .filter(|f| f.is_dir())
            .map(|f| name(&f))
            .collect();
        let best = match folders.into_iter().min_by(|a, b| natural(a, b)) {
            Some(first) => format!("name one file of it, if it is a volume, or a folder in it, as {first}"),
            None => "name one file of it, if it is a volume".into(),
        };
        return Err(Error::input(dir, "", format!("holds no slices (.png, .tif, .jpg, .exr or DICOM): {best}")));
    };
    warnings.add_many("files of the folder are no images and are left out", others);
    Ok(slices)
}

/// The images of a folder that are one stack, of one channel and one frame where folders in it or names tell of several; and
/// what is left to choose in them.
pub fn choose<'a>(
    choice: &Choice<'a>,
    files: &[PathBuf],
    warnings: &mut Warnings,
) -> Result<(Vec<PathBuf>, Choice<'a>)> {
    let is_slice = |f: &PathBuf| is_image(&extension(f));
    if !files.iter().any(is_slice) {
        let folders = subfolders(choice.path);
        if !folders.is_empty() {
            let names: Vec<String> = folders.iter().map(|f| name(f)).collect();
            let folder = &folders[choice.channel(&names, warnings)?];
            let slices = images(folder, &list(folder)?, warnings)?;
            oddities(&slices).into_iter().for_each(|what| warnings.add(what));
            return Ok((slices, choice.within(true, false)));
        }
    }
    let mut slices = images(choice.path, files, warnings)?;
    let (mut by_frame, mut by_channel) = (false, false);
    if let Some((values, groups)) = by_names(&slices, &["time", "t"], false) {
        let frame = choice.frame(values.len(), warnings)?;
        slices = groups.into_iter().nth(frame).unwrap_or_default();
        by_frame = true;
    }
    if let Some((values, groups)) = by_names(&slices, &["channel", "chan", "ch", "c", "w"], true) {
        let channel = choice.channel(&values, warnings)?;
        slices = groups.into_iter().nth(channel).unwrap_or_default();
        by_channel = true;
    }
    oddities(&slices).into_iter().for_each(|what| warnings.add(what));
    Ok((slices, choice.within(by_channel, by_frame)))
}

/// Folders in a folder that hold images, in natural order.
pub fn subfolders(dir: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(dir) else { return Vec::new() };
    let holds_images = |f: &PathBuf| {
        f.is_dir() && !name(f).starts_with('.') && list(f).is_ok_and(|l| l.iter().any(|f| is_image(&extension(f))))
    };
    let mut folders: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).filter(holds_images).collect();
    folders.sort_by(|a, b| natural(&name(a), &name(b)));
    folders
}

/// Read slices, one per file, or the pages of one file.
pub fn read(choice: &Choice, files: &[PathBuf], warnings: Warnings, in_memory: u64) -> Result<Stack> {
    let mut stacker = SliceStacker {
        path: choice.path,
        about: None,
        first: None,
        spool: Spool::new(in_memory),
        count: 0,
        files: files.len(),
        file: choice.path.to_path_buf(),
    };
    if let [file] = files {
        // Page by page, never all at once.
        stacker.file.clone_from(file);
        slice::read(choice, file, &mut stacker)?;
        return stacker.finish(warnings);
    }
    let mut left = files;
    while !left.is_empty() {
        let (group, after) = left.split_at(stacker.ahead(in_memory).min(left.len()));
        left = after;
        let decoded = par::map(group.len(), |i| {
            let mut one = SingleSlice { file: &group[i], about: ImageInfo::default(), slice: None };
            slice::read(choice, &group[i], &mut one).map(|()| (one.about, one.slice))
        });
        for (file, decoded) in group.iter().zip(decoded) {
            let (about, slice) = decoded?;
            stacker.file.clone_from(file);
            stacker.about(about)?;
            slice.into_iter().try_for_each(|slice| stacker.slice(slice))?;
        }
    }
    stacker.finish(warnings)
}

/// The slice of a file among others.
struct SingleSlice<'a> {
    file: &'a Path,
    about: ImageInfo,
    slice: Option<Slice>,
}

impl Sink for SingleSlice<'_> {
    fn about(&mut self, about: ImageInfo) -> Result<()> {
        self.about = about;
        Ok(())
    }

    fn slice(&mut self, slice: Slice) -> Result<()> {
        if self.slice.is_some() {
            let what = "has several pages: among others in a folder it has to be one slice";
            return Err(Error::input(self.file, "", what));
        }
        self.slice = Some(slice);
        Ok(())
    }
}

/// Slices of the same size, one on the other.
struct SliceStacker<'a> {
    path: &'a Path,
    /// Description by the first file.
    about: Option<ImageInfo>,
    /// Description that the others have to match, and its file.
    first: Option<(Slice, PathBuf)>,
    spool: Spool,
    count: usize,
    files: usize,
    /// The file that slices come from.
    file: PathBuf,
}

impl Sink for SliceStacker<'_> {
    fn about(&mut self, about: ImageInfo) -> Result<()> {
        self.about.get_or_insert(about);
        Ok(())
    }

    fn slice(&mut self, slice: Slice) -> Result<()> {
        if let Some((first, name_of_first)) = &self.first
            && !first.is_like(&slice)
        {
            let here = if self.files == 1 { format!("page {}", self.count + 1) } else { String::new() };
            let than = if self.files == 1 { "page 1".into() } else { name(name_of_first) };
            let what =
                format!("is {}, but {than} is {}: the slices of a stack are alike", slice.describe(), first.describe());
            return Err(Error::input(&self.file, here, what));
        }
        self.spool.push(&slice.bytes)?;
        self.count += 1;
        if self.first.is_none() {
            self.first = Some((Slice { bytes: Vec::new(), ..slice }, self.file.clone()));
        }
        Ok(())
    }
}

impl SliceStacker<'_> {
    /// Number of slices that are decoded at the same time: the first by itself, then as many as memory has room for.
    fn ahead(&self, memory: u64) -> usize {
        let Some((first, _)) = &self.first else { return 1 };
        let bytes = byte_count([first.width, first.height, 1], first.coding).map_or(u64::MAX, |n| n as u64);
        let room = usize::try_from(memory / bytes.saturating_mul(4).max(1)).unwrap_or(usize::MAX);
        room.clamp(1, AHEAD * par::threads())
    }

    fn finish(self, mut warnings: Warnings) -> Result<Stack> {
        let Some((first, _)) = self.first else { return Err(Error::input(self.path, "", "holds no slices")) };
        let dims = [first.width, first.height, self.count];
        if byte_count(dims, first.coding).is_none() {
            return Err(Error::input(self.path, "", "its slices are too many"));
        }
        let samples =
            Samples::new(self.spool.finish()?, 0, first.coding, dims).map_err(|e| Error::input(self.path, "", e))?;
        let about = self.about.unwrap_or_default();
        warnings.merge(about.warnings);
        let (mut affine, mut metres) = (DAffine3::IDENTITY, 0.0);
        if let Some(spacing) = about.spacing {
            let between = spacing.slices.unwrap_or_else(|| {
                if self.count > 1 {
                    warnings.add("it says how far its pixels are apart, but not its slices: as far as columns, or give option `spacing`");
                }
                spacing.columns
            });
            affine = DAffine3::from_scale(DVec3::new(spacing.columns, spacing.rows, between));
            metres = spacing.metres;
        }
        let mut stack = Stack::new(self.path, samples, affine, metres, warnings)?;
        if about.chosen {
            stack.channels = Channels::Chosen;
        }
        if let Some(names) = about.values {
            stack.channels = Channels::Values(names);
        }
        Ok(stack)
    }
}
