//! NRRD (.nrrd, .nhdr with its data).
//!
//! Based on: G. Kindlmann, *Definition of NRRD File Format*, teem, 2005.

use std::path::{Path, PathBuf};

use super::bytes::map_file;
use super::choice::{Choice, OuterAxes, StoredVolume};
use super::coding::{Coding, Kind};
use super::data::{Data, Packing};
use super::header::{Fields, file_list, is_utf16, metres, numbers, sizes};
use super::{Channels, Stack};

use crate::geom::{DAffine3, DMat3, DVec3};
use crate::{Error, Result, Warnings};

/// Longest header that is looked through.
const MAX_HEADER: usize = 1 << 20;

/// Numbers of a type, by its names.
fn kind(name: &str) -> Option<Kind> {
    Some(match name {
        "signed char" | "int8" | "int8_t" => Kind::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => Kind::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => Kind::I16,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Kind::U16,
        "int" | "signed int" | "int32" | "int32_t" => Kind::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => Kind::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => Kind::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => Kind::U64,
        "float" => Kind::F32,
        "double" => Kind::F64,
        _ => return None,
    })
}

/// `(1,0,0) (0,1,0) none`: vectors, and `None` where one is missing, or points along axes beyond the first three alone.
fn vectors(text: &str) -> Option<Vec<Option<DVec3>>> {
    let mut out = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            out.push(None);
            rest = after.trim_start();
            continue;
        }
        let (inner, after) = rest.strip_prefix('(')?.split_once(')')?;
        let list = numbers(&inner.replace(',', " "))?;
        let at = |n: usize| list.get(n).copied().unwrap_or(0.0);
        let vector = DVec3::new(at(0), at(1), at(2));
        out.push(Some(vector).filter(|v| list.len() <= 3 || *v != DVec3::ZERO));
        rest = after.trim_start();
    }
    Some(out)
}

/// Meaning of the positions along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    Space,
    Channel,
    Frame,
}

/// Axes of a lattice: those of space in a row, before them what is stored sample by sample, after them volume by volume.
struct Axes<'a> {
    sizes: &'a [usize],
    roles: Vec<Role>,
    /// Index of the first axis of space.
    first: usize,
    /// Number of axes of space, up to three.
    space: usize,
    /// Whether the axis before those of space counts red, green, blue and opacity.
    colour: bool,
}

impl<'a> Axes<'a> {
    /// By the directions, the kinds, or the sizes alone; `None` where other axes are in the midst of those of space.
    fn new(sizes: &'a [usize], kinds: &[String], directions: Option<&[Option<DVec3>]>) -> Option<Axes<'a>> {
        let kind = |axis: usize| kinds.get(axis).map(String::as_str);
        let is_space = |axis: usize| match (directions, kind(axis)) {
            (Some(directions), _) => directions[axis].is_some(),
            (None, Some(kind)) => matches!(kind, "domain" | "space" | "???" | "none"),
            (None, None) => axis > 0 || sizes.len() < 4 || sizes[0] > 4,
        };
        let first = (0..sizes.len()).find(|&axis| is_space(axis)).unwrap_or(0);
        let role = |axis: usize| match kind(axis) {
            _ if axis == first || is_space(axis) => Role::Space,
            Some("list" | "time") => Role::Frame,
            None | Some("domain" | "space" | "???" | "none") if axis > first => Role::Frame,
            _ => Role::Channel,
        };
        let mut roles: Vec<Role> = (0..sizes.len()).map(role).collect();
        let space = roles[first..].iter().take(3).take_while(|r| **r == Role::Space).count();
        let after = &mut roles[first + space..];
        if space < 3 && after.contains(&Role::Space) {
            return None;
        }
        // A fourth axis of space is time, as some programs write it.
        after.iter_mut().filter(|r| **r == Role::Space).for_each(|r| *r = Role::Frame);
        let colour = first == 1
            && matches!(sizes[0], 3 | 4)
            && match kind(0) {
                Some(kind) => {
                    matches!(kind, "vector" | "none" | "???") || kind.contains("color") && !kind.contains("sv")
                }
                None => true,
            };
        Some(Axes { sizes, roles, first, space, colour })
    }

    fn channels(&self) -> usize {
        self.sizes[..self.first].iter().fold(1, |n: usize, &d| n.saturating_mul(d))
    }

    fn dims(&self) -> [usize; 3] {
        std::array::from_fn(|n| if n < self.space { self.sizes[self.first + n] } else { 1 })
    }

    /// Whether what is stored sample by sample are frames, or channels of frames.
    fn interleaves_frames(&self) -> bool {
        self.roles[..self.first].contains(&Role::Frame)
    }

    /// The channel of each sample that is taken, where samples hold frames, and the volume of those in a row.
    fn choose(&self, choice: &Choice, warnings: &mut Warnings) -> Result<(usize, StoredVolume)> {
        let inner = if self.interleaves_frames() { 0..self.first } else { 0..0 };
        let axes = inner.clone().chain(self.first + self.space..self.sizes.len());
        let outer = OuterAxes { axes: axes.map(|n| (self.sizes[n], self.roles[n] == Role::Channel)).collect() };
        let chosen = outer.choose(choice, warnings)?;
        let channels = self.sizes[inner].iter().fold(1u64, |n, &d| n.saturating_mul(d as u64));
        let volume = StoredVolume { index: chosen.index / channels, count: chosen.count / channels };
        Ok(((chosen.index % channels) as usize, volume))
    }
}

/// Read the stack whose header is `path`.
pub fn read(choice: &Choice, in_memory: u64) -> Result<Stack> {
    let path = choice.path;
    let map = map_file(path)?;
    // Editors put a byte-order mark before a text.
    let begin = if map.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
    if !map[begin..].starts_with(b"NRRD000") {
        let what = if is_utf16(&map) { "is UTF-16: save it as UTF-8" } else { "it does not begin with NRRD000" };
        return Err(Error::input(path, "", format!("not a NRRD file: {what}")));
    }
    let head = &map[..map.len().min(MAX_HEADER)];
    let mut fields = Fields { path, list: Vec::new() };
    // Where the data begin, where an empty line says so.
    let mut body = None;
    let mut at = begin;
    let mut row = 0;
    while let Some(length) = head[at..].iter().position(|&c| c == b'\n') {
        let line = String::from_utf8_lossy(&head[at..at + length]).trim_end_matches('\r').to_owned();
        at += length + 1;
        row += 1;
        if line.is_empty() {
            body = Some(at);
            break;
        }
        // The list of files is last: it has no field's form.
        let in_list = fields.list.last().is_some_and(|f| f.0 == "data file" && f.1.starts_with("LIST"));
        if in_list {
            if let Some(list) = fields.list.last_mut() {
                list.1 += &format!("\n{line}");
            }
        } else if let Some((name, value)) =
            line.split_once(": ").filter(|_| !line.starts_with('#') && !line.contains(":="))
        {
            let name = name.trim().to_ascii_lowercase();
            let name = if name == "datafile" { "data file".to_owned() } else { name };
            fields.list.push((name, value.trim().to_owned(), row));
        }
    }
    let attached = fields.get(&["data file"]).is_none();
    let body = match body {
        Some(body) => body,
        None if attached => {
            return fields.wrong(String::new(), "its header does not end in an empty line: it is cut short");
        }
        None => map.len(),
    };
    stack(&fields, choice, attached.then_some(body), in_memory)
}

fn stack(fields: &Fields, choice: &Choice, body: Option<usize>, in_memory: u64) -> Result<Stack> {
    let mut warnings = Warnings::default();
    let (name, at) = need(fields, "type")?;
    let Some(kind) = kind(&name.to_ascii_lowercase()) else {
        return fields.wrong(at, format!("type {name:?}: not one of numbers"));
    };
    let (text, at) = need(fields, "sizes")?;
    let Some(sizes) = sizes(text) else {
        return fields.wrong(at, format!("sizes {text:?}: whole numbers from 1 on are needed"));
    };
    let words = |text: &str| text.split_whitespace().map(str::to_ascii_lowercase).collect();
    let kinds: Vec<String> = fields.get(&["kinds"]).map_or(Vec::new(), |k| words(k.0));
    let directions = directions(fields, sizes.len())?;
    let Some(axes) = Axes::new(&sizes, &kinds, directions.as_deref()) else {
        return fields.wrong(at, "an axis that is not of space lies between those of space: put it first or last");
    };
    let (channel, volume) = axes.choose(choice, &mut warnings)?;
    let (channels, dims) = (axes.channels(), axes.dims());
    let coding = Coding { kind, big_endian: big_endian(fields, kind)?, channels };
    let samples = Data { volume, ..data(fields, body, coding, dims)? }.load(in_memory)?;
    let unit = fields.get(&["space units", "units"]).and_then(|(text, _)| text.split_whitespace().find_map(metres));
    // Without a unit and directions, nothing says that distances are in millimetres.
    let metres_per_unit = unit.unwrap_or(if directions.is_some() { 1e-3 } else { 0.0 });
    let affine = super::with_thickness(affine(fields, &axes, directions.as_deref())?, dims);
    let mut stack = Stack::new(fields.path, samples, affine, metres_per_unit, warnings)?;
    if axes.interleaves_frames() {
        stack.samples.choose_channel(channel);
        stack.channels = Channels::Chosen;
    } else if channels > 1 && !axes.colour {
        stack.channels = Channels::Values(vec![String::new(); channels]);
    }
    if axes.roles[axes.first..].contains(&Role::Channel) {
        stack.channels = Channels::Chosen;
    }
    Ok(stack)
}

/// The value of a field that must be there, with its line.
fn need<'a>(fields: &'a Fields, name: &str) -> Result<(&'a str, String)> {
    fields.get(&[name]).ok_or_else(|| Error::input(fields.path, "", format!("its header has no field {name:?}")))
}

/// The direction of each of `count` axes, where the header gives them; `None` of an axis that is not of space.
fn directions(fields: &Fields, count: usize) -> Result<Option<Vec<Option<DVec3>>>> {
    let Some((text, at)) = fields.get(&["space directions"]) else { return Ok(None) };
    match vectors(text).filter(|v| v.len() == count) {
        Some(directions) => Ok(Some(directions)),
        None => fields.wrong(at, format!("space directions {text:?}: {count} vectors are needed")),
    }
}

/// Index → space: by directions, or by the distances along the axes, or by numbers alone.
fn affine(fields: &Fields, axes: &Axes, directions: Option<&[Option<DVec3>]>) -> Result<DAffine3> {
    let extents = Extents::new(fields);
    let (first, dims) = (axes.first, axes.dims());
    let spacing = |n: usize| extents.spacing(first + n, dims[n]);
    let direction = |n: usize| directions.filter(|_| n < axes.space).and_then(|d| d.get(first + n).copied().flatten());
    let columns: [DVec3; 3] = std::array::from_fn(|n| match direction(n) {
        Some(direction) => direction,
        None => DVec3::AXES[n] * if n < axes.space { spacing(n).unwrap_or(1.0) } else { 0.0 },
    });
    let along = |n: usize| extents.first(first + n, spacing(n).unwrap_or(1.0)).unwrap_or(0.0);
    let mut translation = match directions {
        Some(_) => DVec3::ZERO,
        None => DVec3::from(std::array::from_fn(|n| if n < axes.space { along(n) } else { 0.0 })),
    };
    if let Some((text, at)) = fields.get(&["space origin"]) {
        // A space of more than three axes begins with those of space.
        let inner = text.trim().strip_prefix('(').and_then(|t| t.strip_suffix(')'));
        match inner.and_then(|t| numbers(&t.replace(',', " "))).as_deref() {
            Some([x, rest @ ..]) => {
                translation = DVec3::new(*x, *rest.first().unwrap_or(&0.0), *rest.get(1).unwrap_or(&0.0));
            }
            _ => return fields.wrong(at, format!("space origin {text:?}: one vector is needed")),
        }
    }
    Ok(DAffine3 { matrix3: DMat3::from_cols(columns[0], columns[1], columns[2]), translation })
}

/// Where samples lie along each axis, where no directions say so.
struct Extents {
    spacings: Vec<f64>,
    /// Least and greatest position, of the cells' faces or of the samples.
    least: Vec<f64>,
    greatest: Vec<f64>,
    /// Whether samples lie on the ends, and not in the middles of cells.
    on_ends: Vec<bool>,
}

impl Extents {
    fn new(fields: &Fields) -> Extents {
        // NaN stands for what is not known.
        let list = |names: &[&str]| {
            let text = fields.get(names).map_or("", |f| f.0);
            text.split_whitespace().map(|w| w.parse().unwrap_or(f64::NAN)).collect::<Vec<f64>>()
        };
        let centres = fields.get(&["centers", "centerings"]).map_or("", |f| f.0);
        Extents {
            spacings: list(&["spacings"]),
            least: list(&["axis mins", "axismins"]),
            greatest: list(&["axis maxs", "axismaxs"]),
            on_ends: centres.split_whitespace().map(|w| w.eq_ignore_ascii_case("node")).collect(),
        }
    }

    fn known(list: &[f64], axis: usize) -> Option<f64> {
        list.get(axis).copied().filter(|v| v.is_finite())
    }

    fn is_on_ends(&self, axis: usize) -> bool {
        self.on_ends.get(axis) == Some(&true)
    }

    /// Distance of samples along an axis of `count`.
    fn spacing(&self, axis: usize, count: usize) -> Option<f64> {
        let by_ends = || {
            let length = Self::known(&self.greatest, axis)? - Self::known(&self.least, axis)?;
            let steps = if self.is_on_ends(axis) { count.saturating_sub(1) } else { count };
            Some(length / steps as f64).filter(|v| v.is_finite() && *v != 0.0)
        };
        Self::known(&self.spacings, axis).or_else(by_ends)
    }

    /// Position of the first sample.
    fn first(&self, axis: usize, spacing: f64) -> Option<f64> {
        let half = if self.is_on_ends(axis) { 0.0 } else { 0.5 * spacing };
        Self::known(&self.least, axis).map(|least| least + half)
    }
}

fn big_endian(fields: &Fields, kind: Kind) -> Result<bool> {
    let is_text = |encoding: &str| ["ascii", "txt", "text"].iter().any(|name| name.eq_ignore_ascii_case(encoding));
    let text = fields.get(&["encoding"]).is_some_and(|e| is_text(e.0));
    match fields.get(&["endian"]) {
        Some((order, at)) => match order.to_ascii_lowercase().as_str() {
            "little" => Ok(false),
            "big" => Ok(true),
            _ => fields.wrong(at, format!("endian {order:?}: little or big")),
        },
        None if kind.bytes() == 1 || text => Ok(false),
        None => need(fields, "endian").map(|_| false),
    }
}

/// Place of the samples: behind the header, or in other files.
fn data<'a>(fields: &Fields<'a>, body: Option<usize>, coding: Coding, dims: [usize; 3]) -> Result<Data<'a>> {
    let path = fields.path;
    let (encoding, _) = need(fields, "encoding")?;
    let packing = match encoding.to_ascii_lowercase().as_str() {
        "raw" => Packing::Raw,
        "gz" | "gzip" => Packing::Deflate,
        "txt" | "text" | "ascii" => Packing::Text,
        other => return Err(Error::unsupported(path, format!("NRRD of encoding {other:?} (save it as raw or gzip)"))),
    };
    let count = |names: &[&str]| match fields.get(names) {
        Some((text, at)) => match text.parse::<i64>() {
            Ok(n) if n >= -1 => Ok(n),
            _ => fields.wrong(at, format!("{:?}: a count, or -1", text)),
        },
        None => Ok(0),
    };
    let (lines, bytes) = (count(&["line skip", "lineskip"])?.max(0), count(&["byte skip", "byteskip"])?);
    let files = files(fields)?;
    let mut skip = body.unwrap_or(0) as u64;
    if lines > 0 {
        let Some(first) = files.first() else { return fields.wrong(String::new(), "names no file of data") };
        let map = map_file(first)?;
        for _ in 0..lines {
            let rest = map.get(skip as usize..).unwrap_or_default();
            skip += rest.iter().position(|&c| c == b'\n').map_or(rest.len(), |n| n + 1) as u64;
            if rest.is_empty() {
                break;
            }
        }
    }
    if bytes < 0 && packing != Packing::Raw {
        let what = "byte skip -1 counts from the end, which only encoding raw can: give the count, or leave it out";
        return fields.wrong(fields.get(&["byte skip", "byteskip"]).unwrap_or_default().1, what);
    }
    let (skip, skip_unpacked) = match packing {
        Packing::Raw if bytes < 0 => (None, 0),
        Packing::Deflate => (Some(skip), bytes.max(0) as u64),
        _ => (Some(skip + bytes.max(0) as u64), 0),
    };
    Ok(Data { header: path, files, skip, skip_unpacked, packing, coding, dims, volume: StoredVolume::ONLY })
}

/// The files of the samples.
fn files(fields: &Fields) -> Result<Vec<PathBuf>> {
    let Some((text, at)) = fields.get(&["data file"]) else { return Ok(vec![fields.path.to_path_buf()]) };
    file_list(fields.path, text, &at)
}

/// The files that the header `path` names.
pub fn named(path: &Path) -> Vec<PathBuf> {
    let Ok(map) = map_file(path) else { return Vec::new() };
    let head = String::from_utf8_lossy(&map[..map.len().min(MAX_HEADER)]).into_owned();
    let head = head.replace("\r\n", "\n");
    let head = head.split("\n\n").next().unwrap_or_default();
    let start = |key: &str| head.find(&format!("\n{key}: ")).map(|at| &head[at + key.len() + 3..]);
    let Some(text) = start("data file").or_else(|| start("datafile")) else { return Vec::new() };
    let text = if text.starts_with("LIST") { text } else { text.lines().next().unwrap_or_default() };
    file_list(path, text, "").unwrap_or_default()
}
