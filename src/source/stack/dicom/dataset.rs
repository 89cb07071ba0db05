//! DICOM files as trees of elements; values stay where they are in the file.
//!
//! Based on: NEMA PS3.5 (data structures and encoding) and PS3.10 (files).

use std::collections::BTreeMap;
use std::io::Read;
use std::ops::Range;
use std::path::Path;

use byteorder::{BigEndian, ByteOrder, LittleEndian};

use crate::source::stack::bytes::{Bytes, map_file};
use crate::{Error, Result};

/// Group and element: `0xgggg_eeee`.
pub type Tag = u32;

pub const PIXEL_DATA: Tag = 0x7fe0_0010;
/// Floats of 32 and of 64 bits in place of whole numbers.
pub const FLOAT_PIXEL_DATA: Tag = 0x7fe0_0008;
pub const DOUBLE_PIXEL_DATA: Tag = 0x7fe0_0009;
const ITEM: Tag = 0xfffe_e000;
const ITEM_END: Tag = 0xfffe_e00d;
const SEQUENCE_END: Tag = 0xfffe_e0dd;
/// Sequences that are looked into where the file does not say that they are some.
const SEQUENCES: [Tag; 14] = [
    0x0018_9076,
    0x0018_9114,
    0x0018_9117,
    0x0018_9118,
    0x0018_9226,
    0x0020_9111,
    0x0020_9113,
    0x0020_9116,
    0x0028_3000,
    0x0028_9110,
    0x0028_9145,
    0x0054_0022,
    0x5200_9229,
    0x5200_9230,
];
/// Sequences within sequences.
const MAX_NESTED: usize = 16;
/// A length that is not known.
const OPEN: usize = u32::MAX as usize;

pub enum Element {
    Value(Range<usize>),
    Items(Vec<Dataset>),
    /// Packed pixels: the table of offsets, then the pieces.
    Fragments(Vec<Range<usize>>),
}

#[derive(Default)]
pub struct Dataset(pub BTreeMap<Tag, Element>);

/// A file and its elements.
pub struct File {
    pub bytes: Bytes,
    pub data: Dataset,
    pub big_endian: bool,
    /// UID of the transfer syntax.
    pub syntax: String,
}

/// Whether the bytes begin as DICOM's files do.
pub fn has_magic(bytes: &[u8]) -> bool {
    bytes.get(128..132) == Some(b"DICM")
}

impl File {
    /// Read the elements of a file; a deflated one may become `memory` bytes.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Limit`], [`Error::Input`] with the byte that is not understood.
    pub fn open(path: &Path, memory: u64) -> Result<File> {
        let bytes = map_file(path)?;
        let wrong = |at: usize, what: &str| Error::input(path, format!("byte {at}"), what);
        let mut reader = Reader { bytes: &bytes, at: 0, explicit: true, big: false };
        let mut syntax = "1.2.840.10008.1.2".to_owned();
        if has_magic(&bytes) {
            reader.at = 132;
            while reader.bytes.get(reader.at..reader.at + 2) == Some(&[2, 0]) {
                let (tag, element) = reader.element(0).map_err(|e| wrong(reader.at, e))?;
                if let (0x0002_0010, Element::Value(range)) = (tag, element) {
                    syntax = text_of(&bytes[range]);
                }
            }
        } else if bytes.get(..2) != Some(&[8, 0]) {
            return Err(Error::input(path, "", "not a DICOM file: DICM is not at byte 128"));
        } else if bytes.get(4..6).is_some_and(|v| v.iter().all(u8::is_ascii_uppercase)) {
            // A file without a head, as old programs wrote them.
            syntax = "1.2.840.10008.1.2.1".into();
        }
        let start = reader.at;
        if syntax == "1.2.840.10008.1.2.1.99" {
            let mut inflated = Vec::new();
            let mut from = flate2::read::DeflateDecoder::new(&bytes[start..]).take(memory.saturating_add(1));
            from.read_to_end(&mut inflated).map_err(|_| wrong(start, "its deflated data are broken"))?;
            if inflated.len() as u64 > memory {
                let what = format!("decoding {}, in bytes,", path.display());
                return Err(Error::Limit { what, needed: inflated.len() as u64, allowed: memory });
            }
            return File::parse(path, Bytes::Memory(inflated), 0, "1.2.840.10008.1.2.1".into());
        }
        File::parse(path, bytes, start, syntax)
    }

    fn parse(path: &Path, bytes: Bytes, start: usize, syntax: String) -> Result<File> {
        let (explicit, big_endian) = match syntax.as_str() {
            "1.2.840.10008.1.2" => (false, false),
            "1.2.840.10008.1.2.2" => (true, true),
            _ => (true, false),
        };
        let mut reader = Reader { bytes: &bytes, at: start, explicit, big: big_endian };
        let mut data = Dataset::default();
        while reader.at < bytes.len() {
            let at = reader.at;
            let (tag, element) = reader.element(0).map_err(|e| Error::input(path, format!("byte {at}"), e))?;
            data.0.insert(tag, element);
            if tag >= PIXEL_DATA {
                break;
            }
        }
        Ok(File { bytes, data, big_endian, syntax })
    }

    pub fn text(&self, data: &Dataset, tag: Tag) -> Option<String> {
        match data.0.get(&tag)? {
            Element::Value(range) => Some(text_of(self.bytes.get(range.clone())?)).filter(|t| !t.is_empty()),
            _ => None,
        }
    }

    /// Numbers that are written in words, apart by backslashes.
    pub fn numbers(&self, data: &Dataset, tag: Tag) -> Option<Vec<f64>> {
        let list: Option<Vec<f64>> = self.text(data, tag)?.split('\\').map(|w| w.trim().parse().ok()).collect();
        list.filter(|l| l.iter().all(|v| v.is_finite()))
    }

    /// Bytes of a value.
    pub fn value(&self, data: &Dataset, tag: Tag) -> Option<&[u8]> {
        match data.0.get(&tag)? {
            Element::Value(range) => self.bytes.get(range.clone()),
            _ => None,
        }
    }

    /// Numbers of 16 bits.
    pub fn shorts(&self, data: &Dataset, tag: Tag) -> Option<Vec<u16>> {
        let read = if self.big_endian { BigEndian::read_u16 } else { LittleEndian::read_u16 };
        Some(self.value(data, tag)?.chunks_exact(2).map(read).collect())
    }

    /// The first number of 16 bits.
    pub fn short(&self, data: &Dataset, tag: Tag) -> Option<u16> {
        self.shorts(data, tag)?.first().copied()
    }

    /// A whole number of 16 or 32 bits.
    pub fn whole(&self, data: &Dataset, tag: Tag) -> Option<u32> {
        match (self.value(data, tag)?, self.big_endian) {
            (v, big) if v.len() == 4 => Some(if big { BigEndian::read_u32(v) } else { LittleEndian::read_u32(v) }),
            _ => self.short(data, tag).map(u32::from),
        }
    }

    /// Floats: one of 32 bits, or any number of 64 bits.
    pub fn floats(&self, data: &Dataset, tag: Tag) -> Option<Vec<f64>> {
        let value = self.value(data, tag)?;
        if value.len() == 4 {
            let read = if self.big_endian { BigEndian::read_f32 } else { LittleEndian::read_f32 };
            return Some(vec![f64::from(read(value))]);
        }
        let read = if self.big_endian { BigEndian::read_f64 } else { LittleEndian::read_f64 };
        Some(value.chunks_exact(8).map(read).collect()).filter(|l: &Vec<f64>| !l.is_empty())
    }
}

fn text_of(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).trim_matches([' ', '\0']).to_owned()
}

impl Dataset {
    pub fn items(&self, tag: Tag) -> &[Dataset] {
        match self.0.get(&tag) {
            Some(Element::Items(items)) => items,
            _ => &[],
        }
    }
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    explicit: bool,
    big: bool,
}

const CUT: &str = "the file is cut short";

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], &'static str> {
        let b = *self.bytes.get(self.at..).and_then(|b| b.first_chunk()).ok_or(CUT)?;
        self.at += N;
        Ok(b)
    }

    fn u16(&mut self) -> Result<u16, &'static str> {
        let b = self.take::<2>()?;
        Ok(if self.big { BigEndian::read_u16(&b) } else { LittleEndian::read_u16(&b) })
    }

    fn u32(&mut self) -> Result<usize, &'static str> {
        let b = self.take::<4>()?;
        Ok(if self.big { BigEndian::read_u32(&b) } else { LittleEndian::read_u32(&b) } as usize)
    }

    fn tag(&mut self) -> Result<Tag, &'static str> {
        Ok(u32::from(self.u16()?) << 16 | u32::from(self.u16()?))
    }

    fn skip(&mut self, length: usize) -> Result<Range<usize>, &'static str> {
        let end = self.at.checked_add(length).filter(|&e| e <= self.bytes.len()).ok_or(CUT)?;
        let range = self.at..end;
        self.at = end;
        Ok(range)
    }

    fn element(&mut self, nested: usize) -> Result<(Tag, Element), &'static str> {
        let tag = self.tag()?;
        let mut kind = *b"  ";
        let length = if self.explicit && tag >> 16 != 0xfffe {
            kind = self.take()?;
            match &kind {
                b"OB" | b"OD" | b"OF" | b"OL" | b"OV" | b"OW" | b"SQ" | b"SV" | b"UC" | b"UN" | b"UR" | b"UT"
                | b"UV" => {
                    self.u16()?;
                    self.u32()?
                }
                k if k.iter().all(u8::is_ascii_uppercase) => usize::from(self.u16()?),
                _ => return Err("not an element of a DICOM file"),
            }
        } else {
            self.u32()?
        };
        if tag == PIXEL_DATA && length == OPEN {
            return Ok((tag, Element::Fragments(self.fragments()?)));
        }
        let listed = &kind == b"SQ" || (&kind == b"  " || &kind == b"UN") && SEQUENCES.contains(&tag);
        if length != OPEN && !listed {
            return Ok((tag, Element::Value(self.skip(length)?)));
        }
        if nested >= MAX_NESTED {
            return Err("sequences are nested too deep");
        }
        // What is unknown is written as without types.
        let explicit = self.explicit;
        self.explicit &= &kind != b"UN";
        let items = self.items(length, nested + 1);
        self.explicit = explicit;
        Ok((tag, Element::Items(items?)))
    }

    fn items(&mut self, length: usize, nested: usize) -> Result<Vec<Dataset>, &'static str> {
        let end = if length == OPEN { self.bytes.len() } else { self.at.checked_add(length).ok_or(CUT)? };
        if end > self.bytes.len() {
            return Err(CUT);
        }
        let mut items = Vec::new();
        while self.at < end {
            let (tag, length) = (self.tag()?, self.u32()?);
            if tag == SEQUENCE_END {
                break;
            }
            if tag != ITEM {
                return Err("a sequence holds something other than items");
            }
            let item_end = if length == OPEN { end } else { self.at.checked_add(length).ok_or(CUT)? };
            let mut item = Dataset::default();
            while self.at < item_end.min(end) {
                if self.bytes.get(self.at..self.at + 4).is_some_and(|_| self.peek() == Some(ITEM_END)) {
                    self.skip(8)?;
                    break;
                }
                let (tag, element) = self.element(nested)?;
                item.0.insert(tag, element);
            }
            items.push(item);
        }
        Ok(items)
    }

    fn peek(&mut self) -> Option<Tag> {
        let at = self.at;
        let tag = self.tag().ok();
        self.at = at;
        tag
    }

    fn fragments(&mut self) -> Result<Vec<Range<usize>>, &'static str> {
        let mut fragments = Vec::new();
        loop {
            let (tag, length) = (self.tag()?, self.u32()?);
            match tag {
                ITEM => fragments.push(self.skip(length)?),
                SEQUENCE_END => return Ok(fragments),
                _ => return Err("packed pixels hold something other than items"),
            }
        }
    }
}
