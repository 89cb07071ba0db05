//! MetaImage (.mha, .mhd with its data).
//!
//! Based on: the Insight Toolkit's description of MetaIO.

use std::path::{Path, PathBuf};

use super::bytes::map_file;
use super::choice::{Choice, OuterAxes, StoredVolume};
use super::coding::{Coding, Kind};
use super::data::{Data, Packing};
use super::header::{Fields, file_list, is_utf16, numbers, size, sizes};
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
struct Header<'a> {
    fields: Fields<'a>,
    /// Byte at which the data begin, if they are in the same file.
    end: usize,
}

impl<'a> Header<'a> {
    fn read(path: &'a Path) -> Result<Header<'a>> {
        let map = map_file(path)?;
        let head = &map[..map.len().min(MAX_HEADER)];
        if is_utf16(head) {
            return Err(Error::input(path, "", "not a MetaImage header: is UTF-16: save it as UTF-8"));
        }
        let mut fields = Fields { path, list: Vec::new() };
        // Editors put a byte-order mark before a text.
        let mut end = if head.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
        let mut row = 0;
        while end < head.len() {
            let rest = &head[end..];
            let length = rest.iter().position(|&c| c == b'\n').unwrap_or(rest.len());
            let line = String::from_utf8_lossy(&rest[..length]).into_owned();
            end = (end + length + 1).min(map.len());
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
                value += &format!("\n{}", String::from_utf8_lossy(&head[end.min(head.len())..]));
            }
            fields.list.push((key, value, row));
            if last {
                return Ok(Header { fields, end });
            }
        }
        Err(Error::input(path, "", "not a MetaImage header: it names no ElementDataFile"))
    }

    /// The value of a field that must be there, with its line.
    fn need(&self, name: &str) -> Result<(&str, String)> {
        let missing = || Error::input(self.fields.path, "", format!("its header has no {name}"));
        self.fields.get(&[name]).ok_or_else(missing)
    }

    fn is_true(&self, names: &[&str]) -> bool {
        self.fields.get(names).is_some_and(|v| v.0.eq_ignore_ascii_case("true"))
    }

    /// A list of `count` numbers, if the header has it.
    fn list(&self, names: &[&str], count: usize) -> Result<Option<Vec<f64>>> {
        let Some((text, at)) = self.fields.get(names) else { return Ok(None) };
        match numbers(text).filter(|l| l.len() >= count) {
            Some(list) => Ok(Some(list)),
            None => self.fields.wrong(at, format!("{} = {text}: {count} numbers are needed", names.join(" or "))),
        }
    }

    /// The files of the samples; `None`: they follow the header.
    fn files(&self) -> Result<Option<Vec<PathBuf>>> {
        let (text, at) = self.fields.get(&["ElementDataFile"]).unwrap_or_default();
        if text.eq_ignore_ascii_case("local") { Ok(None) } else { file_list(self.fields.path, text, &at).map(Some) }
    }

    /// Number of samples along each axis.
    fn sizes(&self) -> Result<Vec<usize>> {
        let (text, at) = self.need("DimSize")?;
        match sizes(text) {
            Some(sizes) => Ok(sizes),
            None => self.fields.wrong(at, format!("DimSize = {text}: whole numbers from 1 on are needed")),
        }
    }

    fn coding(&self) -> Result<Coding> {
        let (name, at) = self.need("ElementType")?;
        let Some(kind) = kind(name.trim_end_matches("_ARRAY")) else {
            return self.fields.wrong(at, format!("ElementType = {name}: not one of numbers"));
        };
        let channels = match self.fields.get(&["ElementNumberOfChannels"]) {
            Some((text, at)) => match size(text) {
                Some(n) => n,
                None => {
                    return self.fields.wrong(at, format!("ElementNumberOfChannels = {text}: a count is needed"));
                }
            },
            None => 1,
        };
        let big_endian = self.is_true(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"]);
        Ok(Coding { kind, big_endian, channels })
    }

    /// Place of the samples: behind the header, or in other files.
    fn data(&self, coding: Coding, dims: [usize; 3], volume: StoredVolume) -> Result<Data<'a>> {
        let header = self.fields.path;
        let is_text = self.fields.get(&["BinaryData"]).is_some_and(|v| v.0.eq_ignore_ascii_case("false"));
        let packing = match () {
            () if is_text => Packing::Text,
            () if self.is_true(&["CompressedData"]) => Packing::Deflate,
            () => Packing::Raw,
        };
        let named = self.files()?;
        let header_size = self.list(&["HeaderSize"], 1)?.and_then(|l| l.first().copied()).unwrap_or(0.0);
        let skip = match &named {
            None => Some(self.end as u64),
            Some(_) if header_size < 0.0 => None,
            Some(_) => Some(header_size as u64),
        };
        let files = named.unwrap_or_else(|| vec![header.to_path_buf()]);
        Ok(Data { header, files, skip, skip_unpacked: 0, packing, coding, dims, volume })
    }

    /// Index → space, of a lattice of `rank` axes.
    fn affine(&self, rank: usize) -> Result<DAffine3> {
        let spacing = self.list(&["ElementSpacing", "ElementSize"], rank)?.unwrap_or_else(|| vec![1.0; rank]);
        let matrix = self.list(&["TransformMatrix", "Rotation", "Orientation"], rank * rank)?;
        // Row n is the direction of axis n.
        let column = |n: usize| {
            let along = match &matrix {
                Some(m) => DVec3::from(std::array::from_fn(|c| if c < rank { m[n * rank + c] } else { 0.0 })),
                None => DVec3::AXES[n],
            };
            along * spacing[n]
        };
        let columns: [DVec3; 3] = std::array::from_fn(|n| if n < rank { column(n) } else { DVec3::ZERO });
        let offset = self.list(&["Offset", "Position", "Origin"], rank)?.unwrap_or_default();
        let translation = DVec3::from(std::array::from_fn(|c| offset.get(c).copied().unwrap_or(0.0)));
        if let Some(bad) = spacing.iter().take(3).find(|s| **s <= 0.0) {
            return self.fields.wrong(String::new(), format!("ElementSpacing {bad}: distances are above 0"));
        }
        Ok(DAffine3 { matrix3: DMat3::from_cols(columns[0], columns[1], columns[2]), translation })
    }
}

/// Read the stack whose header is `path`.
pub fn read(choice: &Choice, in_memory: u64) -> Result<Stack> {
    let header = Header::read(choice.path)?;
    let mut warnings = Warnings::default();
    let sizes = header.sizes()?;
    let dims = std::array::from_fn(|n| sizes.get(n).copied().unwrap_or(1));
    let outer = OuterAxes { axes: sizes.iter().skip(3).map(|&size| (size, false)).collect() };
    let volume = outer.choose(choice, &mut warnings)?;
    let coding = header.coding()?;
    let samples = header.data(coding, dims, volume)?.load(in_memory)?;
    let affine = super::with_thickness(header.affine(sizes.len())?, dims);
    let mut stack = Stack::new(choice.path, samples, affine, 1e-3, warnings)?;
    // Three or four channels are taken for colours.
    if !matches!(coding.channels, 1 | 3 | 4) {
        stack.channels = Channels::Values(vec![String::new(); coding.channels]);
    }
    Ok(stack)
}

/// The files that the header `path` names.
pub fn named(path: &Path) -> Vec<PathBuf> {
    Header::read(path).and_then(|h| h.files()).ok().flatten().unwrap_or_default()
}
