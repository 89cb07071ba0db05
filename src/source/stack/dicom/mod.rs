//! DICOM: the images of a folder or a file, sorted into series, and a series' slices sorted along their normal.
//!
//! Based on: NEMA PS3.3, sections C.7.6.2 (image plane) and C.7.6.16 (multi-frame functional groups).

mod attributes;
mod dataset;
mod image;
mod layout;
mod packed;
mod pixels;
mod tables;
mod volumes;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::Stack;
use super::bytes::{Spool, check_ratio};
use super::choice::Choice;
use super::coding::{Coding, Kind};
use super::samples::Samples;
use crate::error::short;
use crate::geom::{DAffine3, DMat3, DVec3};
use crate::{Error, Result, Warnings, par};
use dataset::File;
use image::Image;
use volumes::Slice;

/// Whether a file is DICOM, by its first bytes or its name.
pub fn is_dicom(path: &Path) -> bool {
    use std::io::Read;
    let mut head = [0; 132];
    let read = crate::format::open_file(path).ok().and_then(|mut f| f.read_exact(&mut head).ok());
    (read.is_some() && dataset::has_magic(&head)) || path.extension().is_some_and(|e| e.eq_ignore_ascii_case("dcm"))
}

/// Read the stack that `--series` names, or the only series.
pub fn read(choice: &Choice, files: &[PathBuf], in_memory: u64) -> Result<Stack> {
    let path = choice.path;
    let mut warnings = Warnings::default();
    let (images, mut slices) = choose(choice, files, &mut warnings)?;
    let (first, first_frame) = (&images[slices[0].0], slices[0].1);
    if let Some(what) = slices.iter().find_map(|s| pixels::unsupported(&images[s.0].layout, &images[s.0].syntax)) {
        return Err(Error::unsupported(path, what));
    }
    if slices.iter().any(|s| images[s.0].frames[s.1].has_no_slope) {
        warnings.add("its Rescale Slope is 0, by which all values were one: 1 is taken");
    }
    let affine = arrange(path, &images, &mut slices, &mut warnings)?;
    let rescale = first.frames[first_frame].rescale;
    let like_first = |&(i, f): &Slice| {
        let image = &images[i];
        image.frames[f].rescale == rescale && image.padding == first.padding && image.modality.is_none()
    };
    // Numbers stay as they are stored where they all mean the same.
    let stored = slices.iter().all(like_first);
    let palette = first.layout.is_palette();
    let coding = match () {
        () if palette => Coding::native(Kind::U8, 3),
        () if stored => first.layout.coding(),
        () => Coding::native(Kind::F32, first.layout.channels),
    };
    let mut spool = Spool::new(in_memory);
    let total = slices.len() as u64 * first.layout.bytes() as u64;
    let mut in_files: Vec<usize> = slices.iter().map(|s| s.0).collect();
    in_files.sort_unstable();
    in_files.dedup();
    let packed = in_files.iter().filter_map(|&i| std::fs::metadata(&images[i].path).ok()).map(|m| m.len()).sum();
    check_ratio(path, total, packed)?;
    for group in slices.chunks(4 * par::threads()) {
        let decoded = par::map(group.len(), |n| {
            let (i, f) = group[n];
            let image = &images[i];
            let wrong = |e: String| Error::input(&image.path, format!("frame {}", f + 1), e);
            let bytes = pixels::frame(&File::open(&image.path, choice.memory)?, &image.layout, f, image.frames.len())
                .map_err(wrong)?;
            match () {
                () if palette => image.colours(bytes).map_err(wrong),
                () if stored => Ok(bytes),
                () => image.values(bytes, f).map_err(wrong),
            }
        });
        for bytes in decoded {
            spool.push(&bytes?)?;
        }
    }
    let dims = [first.layout.columns, first.layout.rows, slices.len()];
    let mut samples = Samples::new(spool.finish()?, 0, coding, dims).map_err(|e| Error::input(path, "", e))?;
    if stored && !palette {
        samples.rescale = rescale;
        samples.padding = first.padding.map(|range| {
            let [a, b] = range.map(|v| (f64::from(v) * rescale.0 + rescale.1) as f32);
            [a.min(b), a.max(b)]
        });
    }
    Stack::new(path, samples, affine, 1e-3, warnings)
}

/// Series that option `series` selects: its UID or number, and after a colon the number of a stack in it.
struct SeriesChoice<'a> {
    /// UID or number; empty for the only series.
    series: &'a str,
    /// Number of the stack, counted from 1; 0 where none is named. The error is a text that is no number.
    stack: Result<usize, &'a str>,
}

impl<'a> SeriesChoice<'a> {
    fn of(wanted: &'a str) -> SeriesChoice<'a> {
        match wanted.rsplit_once(':') {
            Some((series, stack)) => SeriesChoice { series, stack: stack.parse::<usize>().map_err(|_| stack) },
            None => SeriesChoice { series: wanted, stack: Ok(0) },
        }
    }
}

/// The images of one series, at least one, and the slices of one stack in it.
fn choose(choice: &Choice, files: &[PathBuf], warnings: &mut Warnings) -> Result<(Vec<Image>, Vec<Slice>)> {
    let wanted = choice.series.map(SeriesChoice::of);
    let images = images_of_series(choice, files, wanted.as_ref(), warnings)?;
    let slices = slices_of_stack(choice, &images, wanted.as_ref(), warnings)?;
    Ok((images, slices))
}

/// The images of the series that is `wanted`, or of the only one.
fn images_of_series(
    choice: &Choice,
    files: &[PathBuf],
    wanted: Option<&SeriesChoice>,
    warnings: &mut Warnings,
) -> Result<Vec<Image>> {
    let path = choice.path;
    let mut all: BTreeMap<String, Vec<Image>> = BTreeMap::new();
    let mut without = 0;
    for image in par::map(files.len(), |i| Image::read(&files[i], choice.memory)) {
        match image? {
            Some(image) => all.entry(image.series.clone()).or_default().push(image),
            None => without += 1,
        }
    }
    if all.is_empty() {
        let what = "none of its DICOM files holds pixels: they are in others, or it is a directory (DICOMDIR), a report or a plan";
        return Err(Error::input(path, "", what));
    }
    let there = list(&all);
    if let Some(SeriesChoice { series, .. }) = wanted {
        all.retain(|uid, images| series.is_empty() || uid == series || images[0].number == *series);
        if all.is_empty() {
            return Err(Error::input(path, "", format!("option `series` = {series} is not there; there are: {there}")));
        }
    }
    if all.len() > 1 {
        let there = list(&all);
        return Err(Error::input(
            path,
            "",
            format!("holds {} series, choose one with option `series`: {there}", all.len()),
        ));
    }
    warnings.add_many("DICOM files without pixels are left out", without);
    Ok(all.into_values().next().unwrap_or_default())
}

/// The slices of the stack that is `wanted` among those of a series, or of the largest one.
fn slices_of_stack(
    choice: &Choice,
    images: &[Image],
    wanted: Option<&SeriesChoice>,
    warnings: &mut Warnings,
) -> Result<Vec<Slice>> {
    let path = choice.path;
    let mut groups = volumes::stacks(images);
    let number = &images[0].number;
    let taken = match wanted.map_or(Ok(0), |w| w.stack) {
        // Whatever distinguishes the stacks of a series, they count as its frames, too.
        Ok(0) if choice.names_frame() => choice.frame(groups.len(), warnings)?,
        Ok(0) => {
            let taken = volumes::largest(&groups);
            if groups.len() > 1 {
                warnings.add(format!(
                    "its series {number} holds {} stacks: {}; {} is taken, or choose with option `series` = {number}:1 to {}",
                    groups.len(),
                    volumes::listed(&groups),
                    taken + 1,
                    groups.len()
                ));
            }
            taken
        }
        Ok(n) if n <= groups.len() => {
            choice.frame(1, warnings)?;
            n - 1
        }
        Ok(_) | Err(_) => {
            let asked = choice.series.unwrap_or_default();
            let what = format!("option `series` = {asked} is not there; its stacks are: {}", volumes::listed(&groups));
            return Err(Error::input(path, "", what));
        }
    };
    if groups.is_empty() {
        return Err(Error::input(path, "", "holds no slices"));
    }
    Ok(groups.swap_remove(taken).slices)
}

/// "5 (MR T2, 16 slices of 256×256, UID 1.2.3); 6 (…)".
fn list(all: &BTreeMap<String, Vec<Image>>) -> String {
    let line = |(uid, images): (&String, &Vec<Image>)| {
        let count: usize = images.iter().map(|i| i.frames.len()).sum();
        let (i, s) = (&images[0], if count == 1 { "" } else { "s" });
        let stacks = volumes::stacks(images).len();
        let stacks = if stacks > 1 { format!(" in {stacks} stacks") } else { String::new() };
        let size = format!("{}×{}", i.layout.columns, i.layout.rows);
        format!("{} ({}, {count} slice{s} of {size}{stacks}, UID {uid})", i.number, i.title)
    };
    all.iter().take(20).map(line).collect::<Vec<_>>().join("; ")
}

/// Sort the slices along their normal and say where they lie: index → millimetres.
fn arrange(path: &Path, images: &[Image], slices: &mut [(usize, usize)], warnings: &mut Warnings) -> Result<DAffine3> {
    let frame = |&(i, f): &(usize, usize)| &images[i].frames[f];
    let wrong = |what: String| Err(Error::input(path, "", what));
    slices.sort_by(|a, b| images[a.0].instance.total_cmp(&images[b.0].instance).then(a.1.cmp(&b.1)));
    let first = frame(&slices[0]).clone();
    let spacing = first.spacing.unwrap_or_else(|| {
        warnings.add("it does not say how far its pixels are apart: 1 mm is taken, or give option `spacing`");
        [1.0; 2]
    });
    let [row, column] = first.axes.unwrap_or([DVec3::X, DVec3::Y]);
    let normal = row.cross(column).normalize_or_zero();
    if normal == DVec3::ZERO || spacing.iter().any(|s| *s <= 0.0) {
        return wrong(format!(
            "its pixels are {} and {} mm apart along {row:.4} and {column:.4}: they span no plane",
            short(spacing[0]),
            short(spacing[1])
        ));
    }
    let thickness = images[slices[0].0].thickness.unwrap_or((spacing[0] * spacing[1]).sqrt());
    let affine = |origin: DVec3, step: DVec3| DAffine3 {
        matrix3: DMat3::from_cols(row * spacing[0], column * spacing[1], step),
        translation: origin,
    };
    let at = |s: &(usize, usize)| frame(s).position.unwrap_or(DVec3::ZERO);
    if slices.iter().any(|s| frame(s).position.is_none()) {
        if slices.len() > 1 {
            warnings.add("it does not say where its slices are: one on the other, by their numbers");
        }
        return Ok(affine(at(&slices[0]), normal * thickness));
    }
    slices.sort_by(|a, b| at(a).dot(normal).total_cmp(&at(b).dot(normal)));
    let n = slices.len();
    let origin = at(&slices[0]);
    if n == 1 {
        return Ok(affine(origin, normal * thickness));
    }
    let step = (at(&slices[n - 1]) - origin) / (n - 1) as f64;
    let off = |k: usize| (at(&slices[k]) - (origin + step * k as f64)).length() / step.length();
    let worst = (0..n).map(off).fold(0.0, f64::max);
    if worst > 0.25 {
        let gap = |k: usize| (at(&slices[k + 1]) - at(&slices[k])).dot(normal);
        let (mut small, mut large) = (f64::INFINITY, 0.0f64);
        (0..n - 1).map(gap).for_each(|g| (small, large) = (small.min(g), large.max(g)));
        return wrong(format!(
            "its slices are not evenly apart: {small:.4} to {large:.4} mm; one is missing, or they are not one stack"
        ));
    }
    if worst > 0.02 {
        warnings.add("its slices are not quite evenly apart: they are taken as if they were");
    }
    let lean = step.dot(normal) / step.length();
    if lean < 0.9999 {
        warnings.add(format!(
            "its slices lean by {:.2}° (gantry tilt): the stack is sheared as its positions say",
            libm::acos(lean).to_degrees()
        ));
    }
    Ok(affine(origin, step))
}
