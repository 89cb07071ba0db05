//! Image stacks (CT, MR, microscopy) as a source: samples on a lattice, placed as their header says.
//!
//! Raw files are mapped into memory. Compressed ones are decoded slice by slice, to an unnamed temporary file where they are larger
//! than memory. The minimum and maximum of every brick of 8³ cells tell where there may be matter. Only there values are filtered,
//! and turned into facets or soft matter, a region at a time.

mod bytes;
mod choice;
mod coding;
mod data;
mod dicom;
mod folder;
mod freesurfer;
mod header;
mod lattice;
mod march;
mod metaimage;
mod natural;
mod nifti;
mod nrrd;
mod options;
mod ranges;
mod samples;
mod slice;
mod soft;
mod source;
mod split;
#[cfg(test)]
mod tests;
mod transfer;

pub use options::StackOptions;
pub use source::StackSource;
pub use transfer::{GradientPoint, TransferPoint, TransferSpec};

use std::path::{Path, PathBuf};

use crate::geom::{DAffine3, DVec3};
use crate::{Error, Result, Warnings};
use choice::Choice;
use samples::Samples;

/// Samples and their position in space. Each sample is at the centre of a cell, which is as wide as the distance of samples.
pub struct Stack {
    path: PathBuf,
    samples: Samples,
    /// Index → source space.
    affine: DAffine3,
    /// Metres in a unit of that space; 0 where unknown.
    metres_per_unit: f64,
    channels: Channels,
    warnings: Warnings,
}

/// Meaning of a sample's channels.
enum Channels {
    /// One value, grey and opacity, or colour.
    Pixel,
    /// Separate values with these names, of which one is used.
    Values(Vec<String>),
    /// One of the values was selected already.
    Chosen,
}

impl Stack {
    fn new(path: &Path, samples: Samples, affine: DAffine3, metres_per_unit: f64, warnings: Warnings) -> Result<Stack> {
        let m = affine.matrix3;
        let lengths = m.x_axis.length() * m.y_axis.length() * m.z_axis.length();
        // Also of NaN. Axes closer than a twentieth of a degree span nothing.
        if !(affine.is_finite() && m.determinant().abs() > 1e-3 * lengths && lengths > 0.0) {
            let what = "its axes span no space (distances of 0, or axes that coincide): give the distances with option `spacing`";
            return Err(Error::input(path, "", what));
        }
        let channels = Channels::Pixel;
        Ok(Stack { path: path.to_path_buf(), samples, affine, metres_per_unit, channels, warnings })
    }

    /// Select one channel of each sample, where there are several that are no colours, or where the options name one.
    fn choose_channel(&mut self, choice: &Choice) -> Result<()> {
        let names: Vec<String> = match (&self.channels, self.samples.channels()) {
            (Channels::Chosen, _) => return Ok(()),
            (Channels::Values(names), _) => names.clone(),
            (Channels::Pixel, _) if !choice.names_channel() => return Ok(()),
            (Channels::Pixel, 1) => vec![String::new()],
            (Channels::Pixel, 2) => ["grey", "alpha"].map(str::to_owned).to_vec(),
            (Channels::Pixel, n) => ["red", "green", "blue", "alpha"].into_iter().take(n).map(str::to_owned).collect(),
        };
        let channel = choice.channel(&names, &mut self.warnings)?;
        self.samples.choose_channel(channel);
        Ok(())
    }
}

/// `affine` with a thickness for axes with one sample and no distance: the geometric mean of the distances along the other axes.
fn with_thickness(affine: DAffine3, dims: [usize; 3]) -> DAffine3 {
    let mut out = affine;
    for (n, &samples) in dims.iter().enumerate() {
        let (a, b) = (affine.matrix3.col((n + 1) % 3), affine.matrix3.col((n + 2) % 3));
        if samples == 1 && affine.matrix3.col(n) == DVec3::ZERO {
            *out.matrix3.col_mut(n) = a.cross(b).normalize_or_zero() * (a.length() * b.length()).sqrt();
        }
    }
    out
}

/// Whether `path` is a stack by its name or its first bytes: a folder, a volume, or an image.
pub fn is_stack(path: &Path) -> bool {
    path.is_dir() || !matches!(kind(path), Kind::Other) || dicom::is_dicom(path)
}

#[derive(PartialEq)]
enum Kind {
    Nifti,
    Nrrd,
    MetaImage,
    FreeSurfer,
    Image,
    Other,
}

fn kind(path: &Path) -> Kind {
    let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default().to_ascii_lowercase();
    let bare = name.strip_suffix(".gz").unwrap_or(&name);
    let extension = bare.rsplit_once('.').map_or("", |e| e.1);
    match extension {
        "nii" | "hdr" | "img" => Kind::Nifti,
        "nrrd" | "nhdr" => Kind::Nrrd,
        "mha" | "mhd" => Kind::MetaImage,
        "mgh" | "mgz" => Kind::FreeSurfer,
        e if slice::is_image(e) && bare.len() == name.len() => Kind::Image,
        _ => Kind::Other,
    }
}

/// Read the stack `path`. Up to `in_memory` bytes of decoded samples stay in memory, larger stacks go to an unnamed temporary file.
///
/// # Errors
/// [`Error::Io`], [`Error::Input`] where the files are broken or contradict the options, and [`Error::Limit`].
pub fn read(path: &Path, options: &StackOptions, in_memory: u64) -> Result<Stack> {
    let choice = Choice::new(path, options, in_memory);
    if choice.series.is_some() && !is_dicom(path) {
        return Err(Error::input(path, "", "series are of DICOM, which this is not: leave option `series` out"));
    }
    let mut stack = match kind(path) {
        _ if path.is_dir() => folder(&choice, in_memory)?,
        Kind::Nifti => nifti::read(&choice, in_memory)?,
        Kind::Nrrd => nrrd::read(&choice, in_memory)?,
        Kind::MetaImage => metaimage::read(&choice, in_memory)?,
        Kind::FreeSurfer => freesurfer::read(&choice, in_memory)?,
        Kind::Image => folder::read(&choice, &[path.to_path_buf()], Warnings::default(), in_memory)?,
        Kind::Other => dicom::read(&choice, &[path.to_path_buf()], in_memory)?,
    };
    stack.choose_channel(&choice)?;
    if let Some(spacing) = options.spacing {
        stack.affine = DAffine3::from_scale(DVec3::from(spacing));
        stack.metres_per_unit = 1e-3;
    }
    Ok(stack)
}

/// Whether the stack `path` is read as DICOM.
fn is_dicom(path: &Path) -> bool {
    match kind(path) {
        _ if path.is_dir() => folder::list(path).unwrap_or_default().iter().any(|f| dicom::is_dicom(f)),
        kind => kind == Kind::Other,
    }
}

/// Files that make a folder an image of Zarr.
const ZARR: [&str; 4] = ["zarr.json", ".zattrs", ".zgroup", ".zarray"];

fn folder(choice: &Choice, in_memory: u64) -> Result<Stack> {
    if ZARR.iter().any(|name| choice.path.join(name).is_file()) {
        let what = "an OME-Zarr image (write one of its levels as TIFF or NRRD; in Python: \
                    tifffile.imwrite('x.tif', zarr.open('x.zarr/0')[0, 0]))";
        return Err(Error::unsupported(choice.path, what));
    }
    let files = folder::list(choice.path)?;
    let (dicom, others): (Vec<PathBuf>, Vec<PathBuf>) = files.into_iter().partition(|f| dicom::is_dicom(f));
    if dicom.is_empty() {
        let mut warnings = Warnings::default();
        let (images, within) = folder::choose(choice, &others, &mut warnings)?;
        let mut stack = folder::read(&within, &images, warnings, in_memory)?;
        stack.choose_channel(&within)?;
        stack.channels = Channels::Chosen;
        return Ok(stack);
    }
    let mut stack = dicom::read(choice, &dicom, in_memory)?;
    stack.warnings.add_many("files of the folder are not DICOM and are left out", others.len() as u64);
    Ok(stack)
}

/// The files that the stack `path` is made of.
pub fn files(path: &Path) -> Vec<PathBuf> {
    let own = path.to_path_buf();
    match kind(path) {
        _ if path.is_dir() => {
            let files = folder::list(path).unwrap_or_default();
            let dicom: Vec<PathBuf> = files.iter().filter(|f| dicom::is_dicom(f)).cloned().collect();
            let images = |dir: &Path, files: &[PathBuf]| {
                folder::images(dir, files, &mut Warnings::default()).unwrap_or_default()
            };
            let inner =
                || folder::subfolders(path).into_iter().flat_map(|d| images(&d, &folder::list(&d).unwrap_or_default()));
            match images(path, &files) {
                _ if !dicom.is_empty() => dicom,
                own if own.is_empty() => inner().collect(),
                own => own,
            }
        }
        Kind::Nifti => {
            let (header, data) = nifti::files(path);
            if header == data { vec![data] } else { vec![header, data] }
        }
        Kind::Nrrd => [vec![own], nrrd::named(path)].concat(),
        Kind::MetaImage => [vec![own], metaimage::named(path)].concat(),
        Kind::FreeSurfer | Kind::Image | Kind::Other => vec![own],
    }
}
