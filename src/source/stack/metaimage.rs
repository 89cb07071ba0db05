//! MetaImage (.mha, .mhd with its data).
//!
//! Based on: the Insight Toolkit's description of MetaIO.

use std::path::{Path, PathBuf};

use super::bytes::map_file;
use super::choice::{Choice, OuterAxes};
use super::coding::{Coding, Kind};
use super::data::{Data, Packing};
use super::header::{file_list, is_utf16, numbers, size};
use super::{Channels, Stack};

use crate::geom::{DAffine3, DMat3, DVec3};
use crate::{Error, Result, Warnings};

/// Longest header that is looked through.
const MAX_HEADER: usize = 1 << 20;

fn kind(name: &str) -> Option<Kind> {
    Some(match name {
        "MET_CHAR" => Kind::I8,
        "MET_UCHAR" => Kind::U8,
        "MET_SHORT" => Kind::I16,
        "MET_USHORT" => Kind::U16,
        "MET_INT" | "MET_LONG" => Kind::I32,
        "MET_UINT" | "MET_ULONG" => Kind::U32,
        "MET_LONG_LONG" => Kind::I64,
        "MET_ULONG_LONG" => Kind::U64,
        "MET_FLOAT" => Kind::F32,
        "MET_DOUBLE" => Kind::F64,
        _ => return None,
    })
}

/// The lines `Key = value` up to `ElementDataFile`, which ends the header.
struct Fields<'a> {
    path: &'a Path,
    list: Vec<(String, String, usize)>,
    /// Byte at which the data begin, if they are in the same file.
    end: usize,
}

impl<'a> Fields<'a> {
    fn read(path: &'a Path) -> Result<Fields<'a>> {
        let map = map_file(path)?;
        let head = &map[..map.len().min(MAX_HEADER)];
        if is_utf16(head) {
            return Err(Error::input(path, "", "not a MetaImage header: is UTF-16: save it as UTF-8"));
        }
        // Editors put a byte-order mark before a text.
        let end = if head.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
        let mut fields = Fields { path, list: Vec::new(), end };
        let mut row = 0;
        while fields.end < head.len() {
            let rest = &head[fields.end..];
            let length = rest.iter().position(|&c| c == b'\n').unwrap_or(rest.len());
            let line = String::from_utf8_lossy(&rest[..length]).into_owned();
            fields.end = (fields.end + length + 1).min(map.len());
            row += 1;
            // MetaIO takes a colon for the equals sign, too.
            let Some((key, value)) = line.split_once('=').or_else(|| line.split_once(':')) else {
                if line.trim().is_empty() {
                    continue;
                }
                return Err(Error::input(path, format!("line {row}"), "not a MetaImage header: lines are Key = value"));
            };
            let (key, mut value) = (key.trim().to_owned(), value.trim().to_owned());
            let last = key == "ElementDataFile";
            if last && value.starts_with("LIST") {
                value += &format!("\n{}", String::from_utf8_lossy(&head[fields.end.min(head.len())..]));
            }
            fields.list.push((key, value, row));
            if last {
                return Ok(fields);
            }
        }
        Err(Error::input(path, "", "not a MetaImage header: it names no ElementDataFile"))
    }

    fn get(&self, names: &[&str]) -> Option<(&str, String)> {
        let (_, value, line) = self.list.iter().find(|f| names.contains(&f.0.as_str()))?;
        Some((value, format!("line {line}")))
    }

    fn is_true(&self, names: &[&str]) -> bool {
        self.get(names).is_some_and(|v| v.0.eq_ignore_ascii_case("true"))
    }

    fn wrong<T>(&self, at: String, what: impl Into<String>) -> Result<T> {
        Err(Error::input(self.path, at, what))
    }

    /// A list of `count` numbers, if the header has it.
    fn list(&self, names: &[&str], count: usize) -> Result<Option<Vec<f64>>> {
        let Some((text, at)) = self.get(names) else { return Ok(None) };
        match numbers(text).filter(|l| l.len() >= count) {
            Some(list) => Ok(Some(list)),
            None => self.wrong(at, format!("{} = {text}: {count} numbers are needed", names.join(" or "))),
        }
    }

    /// The files of the samples; `None`: they follow the header.
    fn files(&self) -> Result<Option<Vec<PathBuf>>> {
        let (text, at) = self.get(&["ElementDataFile"]).unwrap_or_default();
        if text.eq_ignore_ascii_case("local") { Ok(None) } else { file_list(self.path, text, &at).map(Some) }
    }
}

/// Read the stack whose header is `path`.
pub fn read(choice: &Choice, in_memory: u64) -> Result<Stack> {
    let path = choice.path;
    let fields = Fields::read(path)?;
    let mut warnings = Warnings::default();
    let Some((text, at)) = fields.get(&["DimSize"]) else {
        return fields.wrong(String::new(), "its header has no DimSize");
    };
    let sizes: Option<Vec<usize>> = text.split_whitespace().map(size).collect();
    let Some(sizes) = sizes.filter(|s| (1..=16).contains(&s.len())) else {
        return fields.wrong(at, format!("DimSize = {text}: whole numbers from 1 on are needed"));
    };
    let rank = sizes.len();
    let side = |n: usize| sizes.get(n).copied().unwrap_or(1);
    let dims = [side(0), side(1), side(2)];
    let outer = OuterAxes { axes: sizes.iter().skip(3).map(|&size| (size, false)).collect() };
    let volume = outer.choose(choice, &mut warnings)?;
    let Some((name, at)) = fields.get(&["ElementType"]) else {
        return fields.wrong(String::new(), "its header has no ElementType");
    };
    let Some(kind) = kind(name.trim_end_matches("_ARRAY")) else {
        return fields.wrong(at, format!("ElementType = {name}: not one of numbers"));
    };
    let channels = match fields.get(&["ElementNumberOfChannels"]) {
        Some((text, at)) => match size(text) {
            Some(n) => n,
            None => return fields.wrong(at, format!("ElementNumberOfChannels = {text}: a count is needed")),
        },
        None => 1,
    };
    let big_endian = fields.is_true(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"]);
    let packing = match () {
        () if fields.get(&["BinaryData"]).is_some_and(|v| v.0.eq_ignore_ascii_case("false")) => Packing::Text,
        () if fields.is_true(&["CompressedData"]) => Packing::Deflate,
        () => Packing::Raw,
    };
    let named = fields.files()?;
    let header_size = fields.list(&["HeaderSize"], 1)?.and_then(|l| l.first().copied()).unwrap_or(0.0);
    let skip = match &named {
        None => Some(fields.end as u64),
        Some(_) if header_size < 0.0 => None,
        Some(_) => Some(header_size as u64),
    };
    let files = named.unwrap_or_else(|| vec![path.to_path_buf()]);
    let coding = Coding { kind, big_endian, channels };
    let samples =
        Data { header: path, files, skip, skip_unpacked: 0, packing, coding, dims, volume }.load(in_memory)?;

    let spacing = fields.list(&["ElementSpacing", "ElementSize"], rank)?.unwrap_or_else(|| vec![1.0; rank]);
    let matrix = fields.list(&["TransformMatrix", "Rotation", "Orientation"], rank * rank)?;
    // Row n is the direction of axis n.
    let column = |n: usize| {
        let along = match &matrix {
            Some(m) => DVec3::from(std::array::from_fn(|c| if c < rank { m[n * rank + c] } else { 0.0 })),
            None => DVec3::AXES[n],
        };
        along * spacing[n]
    };
    let columns: [DVec3; 3] = std::array::from_fn(|n| if n < rank { column(n) } else { DVec3::ZERO });
    let offset = fields.list(&["Offset", "Position", "Origin"], rank)?.unwrap_or_default();
    let translation = DVec3::from(std::array::from_fn(|c| offset.get(c).copied().unwrap_or(0.0)));
    if let Some(bad) = spacing.iter().take(3).find(|s| **s <= 0.0) {
        return fields.wrong(String::new(), format!("ElementSpacing {bad}: distances are above 0"));
    }
    let affine = DAffine3 { matrix3: DMat3::from_cols(columns[0], columns[1], columns[2]), translation };
    let mut stack = Stack::new(path, samples, super::with_thickness(affine, dims), 1e-3, warnings)?;
    // Three or four channels are taken for colours.
    if !matches!(channels, 1 | 3 | 4) {
        stack.channels = Channels::Values(vec![String::new(); channels]);
    }
    Ok(stack)
}

/// The files that the header `path` names.
pub fn named(path: &Path) -> Vec<PathBuf> {
    Fields::read(path).and_then(|f| f.files()).ok().flatten().unwrap_or_default()
}
