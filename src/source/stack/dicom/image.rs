//! One DICOM file: its frames, where they lie, and what their numbers mean.
//!
//! Based on: NEMA PS3.3, sections C.7.6.2 (image plane), C.7.6.16 (multi-frame functional groups), C.8.4.8 (nuclear medicine's
//! vectors) and C.8.8.3 (radiotherapy's doses).

use std::path::{Path, PathBuf};

use super::dataset::{Dataset, File, Tag};
use super::layout::Layout;
use super::tables::{Palette, Table};
use super::{attributes, dataset, tables};
use crate::geom::DVec3;
use crate::source::stack::bytes::Bytes;
use crate::source::stack::coding::Coding;
use crate::source::stack::samples::Samples;
use crate::{Error, Result};

/// Description of a file's images.
pub struct Image {
    pub path: PathBuf,
    pub series: String,
    pub number: String,
    /// Modality and description.
    pub title: String,
    pub instance: f64,
    pub layout: Layout,
    pub frames: Vec<Frame>,
    /// Thickness, or distance of slices.
    pub thickness: Option<f64>,
    pub syntax: String,
    /// Trigger and acquisition time, which sort as text.
    pub when: String,
    pub modality: Option<Table>,
    pub palette: Option<Palette>,
    /// Least and greatest stored number that are no values.
    pub padding: Option<[f32; 2]>,
}

/// Sequence of nuclear medicine's detectors, the first of which says where the first frame lies.
const DETECTOR: Tag = 0x0054_0022;

/// One slice.
#[derive(Clone)]
pub struct Frame {
    /// Millimetres; of the middle of the first pixel.
    pub position: Option<DVec3>,
    /// Along a row, and along a column.
    pub axes: Option<[DVec3; 2]>,
    /// Distance of columns, and of rows.
    pub spacing: Option<[f64; 2]>,
    pub rescale: (f64, f64),
    /// Whether its slope is said to be 0, for which 1 is taken, as GDCM does.
    pub has_no_slope: bool,
    /// By which frames of a series belong to different stacks.
    pub attributes: Vec<Option<String>>,
}

impl Image {
    /// Read what a file says of its frames; `None` where it has none. A deflated file may become `memory` bytes.
    ///
    /// # Errors
    /// As [`File::open`].
    pub fn read(path: &Path, memory: u64) -> Result<Option<Image>> {
        let file = File::open(path, memory)?;
        let pixels = [dataset::PIXEL_DATA, dataset::FLOAT_PIXEL_DATA, dataset::DOUBLE_PIXEL_DATA];
        if !pixels.iter().any(|tag| file.data.0.contains_key(tag)) {
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
        let mut frames: Vec<Frame> =
            (0..count as usize).map(|n| Frame::new(&file, &[each.get(n), shared, Some(data)])).collect();
        if each.is_empty() {
            frames.iter_mut().zip(offsets(&file, count as usize)).for_each(|(frame, by)| frame.shift(by));
        }
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
            when: format!("{:020.3} {}", number(0x0018_1060).unwrap_or(0.0), text(0x0008_0032)),
            modality: tables::modality(&file, layout.signed).filter(|_| layout.channels == 1),
            palette: Palette::read(&file, layout.signed).filter(|_| layout.is_palette()),
            padding: tables::padding(&file, |bits| layout.number(bits)).filter(|_| layout.channels == 1),
            layout,
            frames,
            thickness,
            syntax: file.syntax,
        }))
    }
}

/// Distance of frames from the first, along their normal or along z.
#[derive(Debug, Clone, Copy)]
enum Offset {
    Normal(f64),
    Z(f64),
}

/// Where the frames of a file lie that says the place of the first alone; none where it does not say, or where they are moments.
fn offsets(file: &File, count: usize) -> Vec<Offset> {
    const GRID_FRAME_OFFSETS: Tag = 0x3004_000c;
    const FRAME_INCREMENT: Tag = 0x0028_0009;
    const SLICE_VECTOR: Tag = 0x0054_0080;
    /// Group of the tags by which frames are moments.
    const ACQUISITION: u16 = 0x0018;
    let data = &file.data;
    if let Some(list) = file.numbers(data, GRID_FRAME_OFFSETS).filter(|l| l.len() == count) {
        let z = file.numbers(data, 0x0020_0032).and_then(|p| p.get(2).copied());
        // The first is 0, or the z of the first frame where all are z.
        let absolute = list[0] != 0.0 && z == Some(list[0]);
        return list.iter().map(|&v| if absolute { Offset::Z(v - list[0]) } else { Offset::Normal(v) }).collect();
    }
    let number = |tag| file.numbers(data, tag).and_then(|l| l.first().copied()).filter(|v| *v != 0.0);
    let step = number(0x0018_0088).or_else(|| number(0x0018_0050).map(f64::abs));
    let Some(step) = step.filter(|_| file.short(data, FRAME_INCREMENT) != Some(ACQUISITION)) else { return Vec::new() };
    let slices = file.shorts(data, SLICE_VECTOR).filter(|l| l.len() == count);
    let slice = |n: usize| slices.as_ref().map_or(n as f64, |l| f64::from(l[n]) - 1.0);
    (0..count).map(|n| Offset::Normal(step * slice(n))).collect()
}

impl Frame {
    fn shift(&mut self, by: Offset) {
        let [row, column] = self.axes.unwrap_or([DVec3::X, DVec3::Y]);
        let by = match by {
            Offset::Normal(distance) => row.cross(column).normalize_or_zero() * distance,
            Offset::Z(distance) => DVec3::Z * distance,
        };
        self.position = self.position.map(|at| at + by);
    }

    /// From what is said of the frame itself, of all frames, and of the file, in this order.
    pub fn new(file: &File, places: &[Option<&Dataset>]) -> Frame {
        let find = |sequence, tag, count: usize| {
            places.iter().flatten().find_map(|place| {
                let deep = place.items(sequence).first().and_then(|d| file.numbers(d, tag));
                deep.or_else(|| file.numbers(place, tag)).filter(|l| l.len() >= count)
            })
        };
        let vector = |l: &[f64]| DVec3::new(l[0], l[1], l[2]);
        let spacing = find(0x0028_9110, 0x0028_0030, 2).or_else(|| find(0, 0x0018_1164, 2));
        let one = |tag| find(0x0028_9145, tag, 1).map(|l| l[0]);
        let position = find(0x0020_9113, 0x0020_0032, 3).or_else(|| find(DETECTOR, 0x0020_0032, 3));
        let axes = find(0x0020_9116, 0x0020_0037, 6).or_else(|| find(DETECTOR, 0x0020_0037, 6));
        // A dose is scaled by its own attribute.
        let slope = one(0x0028_1053).or_else(|| find(0, 0x3004_000e, 1).map(|l| l[0]));
        let has_no_slope = slope == Some(0.0);
        let slope = slope.filter(|_| !has_no_slope);
        Frame {
            position: position.map(|l| vector(&l)),
            axes: axes.map(|l| [vector(&l), vector(&l[3..])]),
            spacing: spacing.map(|l| [l[1], l[0]]),
            rescale: (slope.unwrap_or(1.0), one(0x0028_1052).unwrap_or(0.0)),
            has_no_slope,
            attributes: attributes::attributes(file, places),
        }
    }
}

impl Image {
    /// A frame's stored numbers, row by row.
    pub fn numbers(&self, bytes: Vec<u8>) -> Result<Vec<f32>, String> {
        let dims = [self.layout.columns * self.layout.channels, self.layout.rows, 1];
        let one = Coding { channels: 1, ..self.layout.coding() };
        let samples = Samples::new(Bytes::Memory(bytes), 0, one, dims)?;
        let mut out = vec![0.0; dims[0] * dims[1]];
        out.chunks_mut(dims[0]).enumerate().for_each(|(j, row)| samples.row_with_nan(0, j, 0, row));
        Ok(out)
    }

    /// Values of the frame `frame`, as f32; padding is NaN.
    pub fn values(&self, bytes: Vec<u8>, frame: usize) -> Result<Vec<u8>, String> {
        let (slope, intercept) = self.frames[frame].rescale;
        let is_padding = |v: f32| self.padding.is_some_and(|[lo, hi]| (lo..=hi).contains(&v));
        let value = |v: f32| match &self.modality {
            _ if is_padding(v) => f32::NAN,
            Some(table) => f32::from(table.get(v)),
            None => (f64::from(v) * slope + intercept) as f32,
        };
        Ok(self.numbers(bytes)?.into_iter().flat_map(|v| value(v).to_ne_bytes()).collect())
    }

    /// A frame's colours by its palette.
    pub fn colours(&self, bytes: Vec<u8>) -> Result<Vec<u8>, String> {
        let palette = self.palette.as_ref().ok_or(
            "it has no palette, or one whose segments point to others: write it anew in RGB, as dcmtk's dcm2img and dcmodify, or pydicom's apply_color_lut, help to",
        )?;
        Ok(self.numbers(bytes)?.into_iter().flat_map(|v| palette.colour(v)).collect())
    }
}
