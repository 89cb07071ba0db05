//! DICOM: the images of a folder or a file, sorted into series, and a series' slices sorted along their normal.
//!
//! Based on: NEMA PS3.3, sections C.7.6.2 (image plane) and C.7.6.16 (multi-frame functional groups).

mod dataset;
mod pixels;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::Stack;
use super::bytes::{Spool, check_ratio};
use super::samples::{Coding, Kind, Samples};
use crate::geom::{DAffine3, DMat3, DVec3};
use crate::{Error, Result, Warnings, par};
use dataset::{Dataset, File};
use pixels::Layout;

/// Whether a file is DICOM, by its first bytes or its name.
pub fn is_dicom(path: &Path) -> bool {
    use std::io::Read;
    let mut head = [0; 132];
    let read = crate::format::open_file(path).ok().and_then(|mut f| f.read_exact(&mut head).ok());
    (read.is_some() && dataset::has_magic(&head)) || path.extension().is_some_and(|e| e.eq_ignore_ascii_case("dcm"))
}

/// What one file says of its images.
struct Image {
    path: PathBuf,
    series: String,
    number: String,
    /// Modality and description.
    title: String,
    instance: f64,
    layout: Layout,
    frames: Vec<Frame>,
    /// Thickness, or distance of slices.
    thickness: Option<f64>,
    syntax: String,
}

/// One slice.
#[derive(Clone)]
struct Frame {
    /// Millimetres; of the middle of the first pixel.
    position: Option<DVec3>,
    /// Along a row, and along a column.
    axes: Option<[DVec3; 2]>,
    /// Distance of columns, and of rows.
    spacing: Option<[f64; 2]>,
    rescale: (f64, f64),
}

impl Image {
    fn read(path: &Path) -> Result<Option<Image>> {
        let file = File::open(path)?;
        if !file.data.0.contains_key(&dataset::PIXEL_DATA) {
            return Ok(None);
        }
        let data = &file.data;
        let layout = Layout::new(&file).map_err(|e| Error::input(path, "", e))?;
        let text = |tag| file.text(data, tag).unwrap_or_default();
        let number = |tag| file.numbers(data, tag).and_then(|l| l.first().copied());
        let count = number(0x0028_0008).unwrap_or(1.0);
        // Eight bytes a frame at least, be they pixels or the head of a piece.
        if !(1.0..=(file.bytes.len() / 8).max(1) as f64).contains(&count) {
            return Err(Error::input(path, "", format!("{count} frames cannot be in it")));
        }
        let shared = data.items(0x5200_9229).first();
        let each = data.items(0x5200_9230);
        let frames = (0..count as usize).map(|n| Frame::new(&file, &[each.get(n), shared, Some(data)])).collect();
        let thickness = [0x0018_0088, 0x0018_0050].iter().find_map(|&t| {
            let own = number(t);
            let deep = || file.numbers(shared?.items(0x0028_9110).first()?, t).and_then(|l| l.first().copied());
            own.or_else(deep).map(f64::abs).filter(|&v| v > 0.0)
        });
        Ok(Some(Image {
            path: path.to_path_buf(),
            series: text(0x0020_000e),
            number: text(0x0020_0011),
            title: format!("{} {}", text(0x0008_0060), text(0x0008_103e)).trim().to_owned(),
            instance: number(0x0020_0013).unwrap_or(0.0),
            layout,
            frames,
            thickness,
            syntax: file.syntax,
        }))
    }
}

impl Frame {
    /// From what is said of the frame itself, of all frames, and of the file, in this order.
    fn new(file: &File, places: &[Option<&Dataset>]) -> Frame {
        let find = |sequence, tag, count: usize| {
            places.iter().flatten().find_map(|place| {
                let deep = place.items(sequence).first().and_then(|d| file.numbers(d, tag));
                deep.or_else(|| file.numbers(place, tag)).filter(|l| l.len() >= count)
            })
        };
        let vector = |l: &[f64]| DVec3::new(l[0], l[1], l[2]);
        let spacing = find(0x0028_9110, 0x0028_0030, 2).or_else(|| find(0, 0x0018_1164, 2));
        let one = |tag, otherwise| find(0x0028_9145, tag, 1).map_or(otherwise, |l| l[0]);
        Frame {
            position: find(0x0020_9113, 0x0020_0032, 3).map(|l| vector(&l)),
            axes: find(0x0020_9116, 0x0020_0037, 6).map(|l| [vector(&l), vector(&l[3..])]),
            spacing: spacing.map(|l| [l[1], l[0]]),
            rescale: (one(0x0028_1053, 1.0), one(0x0028_1052, 0.0)),
        }
    }
}

/// Read the series that `series` names, by UID or number, or the only one.
pub fn read(path: &Path, files: &[PathBuf], series: Option<&str>, in_memory: u64) -> Result<Stack> {
    let mut warnings = Warnings::default();
    let images = choose(path, files, series, &mut warnings)?;
    let mut slices: Vec<(usize, usize)> =
        images.iter().enumerate().flat_map(|(i, image)| (0..image.frames.len()).map(move |f| (i, f))).collect();
    let first = &images[0];
    if let Some(what) = images.iter().find_map(|i| i.layout.unsupported(&i.syntax)) {
        return Err(Error::unsupported(path, what));
    }
    let affine = arrange(path, &images, &mut slices, &mut warnings)?;
    let frame = |&(i, f): &(usize, usize)| &images[i].frames[f];
    let rescale = frame(&slices[0]).rescale;
    let same = slices.iter().all(|s| frame(s).rescale == rescale);
    let coding = if same { first.layout.coding() } else { Coding::native(Kind::F32, first.layout.channels) };
    let mut spool = Spool::new(in_memory);
    let total = slices.len() as u64 * first.layout.bytes() as u64;
    let stored = images.iter().filter_map(|i| std::fs::metadata(&i.path).ok()).map(|m| m.len()).sum();
    check_ratio(path, total, stored)?;
    for group in slices.chunks(4 * par::threads()) {
        let decoded = par::map(group.len(), |n| {
            let (i, f) = group[n];
            let image = &images[i];
            let wrong = |e: String| Error::input(&image.path, format!("frame {}", f + 1), e);
            let bytes = image.layout.frame(&File::open(&image.path)?, f, image.frames.len()).map_err(wrong)?;
            if same {
                return Ok(bytes);
            }
            let dims = [image.layout.columns * image.layout.channels, image.layout.rows, 1];
            let one = Coding { channels: 1, ..image.layout.coding() };
            let mut samples = Samples::new(super::bytes::Bytes::Memory(bytes), 0, one, dims).map_err(wrong)?;
            samples.rescale = image.frames[f].rescale;
            let mut row = vec![0.0; dims[0]];
            let mut out = Vec::with_capacity(4 * dims[0] * dims[1]);
            for j in 0..dims[1] {
                samples.row(0, j, 0, &mut row);
                out.extend(row.iter().flat_map(|v| v.to_ne_bytes()));
            }
            Ok(out)
        });
        for bytes in decoded {
            spool.push(&bytes?)?;
        }
    }
    let dims = [first.layout.columns, first.layout.rows, slices.len()];
    let mut samples = Samples::new(spool.finish()?, 0, coding, dims).map_err(|e| Error::input(path, "", e))?;
    if same {
        samples.rescale = rescale;
    }
    Stack::new(path, samples, affine, 1e-3, warnings)
}

/// The images of one series, which are alike; at least one.
fn choose(path: &Path, files: &[PathBuf], series: Option<&str>, warnings: &mut Warnings) -> Result<Vec<Image>> {
    let mut all: BTreeMap<String, Vec<Image>> = BTreeMap::new();
    let mut without = 0;
    for image in par::map(files.len(), |i| Image::read(&files[i])) {
        match image? {
            Some(image) => all.entry(image.series.clone()).or_default().push(image),
            None => without += 1,
        }
    }
    let list = |all: &BTreeMap<String, Vec<Image>>| -> String {
        let line = |(uid, images): (&String, &Vec<Image>)| {
            let count: usize = images.iter().map(|i| i.frames.len()).sum();
            let (i, s) = (&images[0], if count == 1 { "" } else { "s" });
            format!("{} ({}, {count} slice{s} of {}×{}, UID {uid})", i.number, i.title, i.layout.columns, i.layout.rows)
        };
        all.iter().take(20).map(line).collect::<Vec<_>>().join("; ")
    };
    if all.is_empty() {
        return Err(Error::input(path, "", "holds no DICOM images: name the folder that they are in"));
    }
    let there = list(&all);
    if let Some(wanted) = series {
        all.retain(|uid, images| uid == wanted || images[0].number == wanted);
        if all.is_empty() {
            return Err(Error::input(path, "", format!("--series {wanted} is not there; there are: {there}")));
        }
    }
    if all.len() > 1 {
        let there = list(&all);
        return Err(Error::input(path, "", format!("holds {} series, choose one with --series: {there}", all.len())));
    }
    warnings.add_many("DICOM files without pixels are left out", without);
    let images = all.into_values().next().unwrap_or_default();
    let mut kinds: BTreeMap<String, usize> = BTreeMap::new();
    for i in &images {
        let l = &i.layout;
        let key = format!("{}×{} {} {:?}", l.columns, l.rows, l.photometric, l.coding().kind);
        *kinds.entry(key).or_default() += i.frames.len();
    }
    if kinds.len() > 1 {
        let kinds: Vec<String> = kinds.iter().map(|(k, n)| format!("{n} of {k}")).collect();
        return Err(Error::input(path, "", format!("its series is mixed: slices {}", kinds.join(", "))));
    }
    Ok(images)
}

/// Sort the slices along their normal and say where they lie: index → millimetres.
fn arrange(
    path: &Path,
    images: &[Image],
    slices: &mut Vec<(usize, usize)>,
    warnings: &mut Warnings,
) -> Result<DAffine3> {
    let frame = |&(i, f): &(usize, usize)| &images[i].frames[f];
    let wrong = |what: String| Err(Error::input(path, "", what));
    slices.sort_by(|a, b| images[a.0].instance.total_cmp(&images[b.0].instance).then(a.1.cmp(&b.1)));
    let first = frame(&slices[0]).clone();
    let spacing = first.spacing.unwrap_or_else(|| {
        warnings.add("it does not say how far its pixels are apart: 1 mm is taken, or give --spacing");
        [1.0; 2]
    });
    let [row, column] = first.axes.unwrap_or([DVec3::X, DVec3::Y]);
    let normal = row.cross(column).normalize_or_zero();
    if normal == DVec3::ZERO || spacing.iter().any(|s| *s <= 0.0) {
        return wrong(format!("its pixels are {spacing:?} mm apart along {row} and {column}: they span no plane"));
    }
    let turned = |s: &(usize, usize)| frame(s).axes.is_some_and(|[r, c]| r.cross(c).dot(normal) < 0.999);
    let turned = slices.iter().filter(|s| turned(s)).count();
    if turned > 0 {
        return wrong(format!("its series is mixed: {turned} of {} slices lie another way", slices.len()));
    }
    let thickness = images[0].thickness.unwrap_or((spacing[0] * spacing[1]).sqrt());
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
    // Stable: of slices at one place, the first by number stays.
    let all = slices.len();
    slices.dedup_by(|b, a| (at(b) - at(a)).dot(normal) < 1e-3 * thickness);
    warnings.add_many(
        "slices lie where another one does and are left out (other times or echoes)",
        (all - slices.len()) as u64,
    );
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
