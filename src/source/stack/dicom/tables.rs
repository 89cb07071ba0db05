//! Tables of a DICOM file: the Modality LUT, palettes, and the values of pixels that are only there to fill the picture.
//!
//! Based on: NEMA PS3.3, sections C.11.1 (Modality LUT), C.7.6.3 (palettes), C.7.9.2 (palettes in
//! segments) and C.7.5.1.1.2 (pixel padding).

use byteorder::{BigEndian, ByteOrder, LittleEndian};

use super::dataset::{Dataset, File, Tag};

/// A table of one value per stored number; numbers beyond its ends have the value there.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    first: i64,
    values: Vec<u16>,
    /// Bits that a value takes.
    bits: u16,
}

impl Table {
    /// By the tags of its description and of its values.
    fn read(file: &File, data: &Dataset, descriptor: Tag, values: Tag, signed: bool) -> Option<Table> {
        let [entries, first, bits, ..] = file.shorts(data, descriptor)?[..] else { return None };
        let entries = if entries == 0 { 1 << 16 } else { usize::from(entries) };
        let first = if signed { i64::from(first as i16) } else { i64::from(first) };
        let bytes = file.value(data, values)?;
        let read = if file.big_endian { BigEndian::read_u16 } else { LittleEndian::read_u16 };
        // Values of eight bits may lie byte by byte.
        let values: Vec<u16> = if bits <= 8 && bytes.len() < 2 * entries {
            bytes.iter().take(entries).map(|b| u16::from(*b)).collect()
        } else {
            bytes.chunks_exact(2).take(entries).map(read).collect()
        };
        (!values.is_empty()).then_some(Table { first, values, bits })
    }

    /// The same of values that are stored as segments: runs of values, and lines from the last value to another. `None` also where
    /// a segment points to others.
    fn segmented(file: &File, descriptor: Tag, values: Tag, signed: bool) -> Option<Table> {
        let [entries, first, bits, ..] = file.shorts(&file.data, descriptor)?[..] else { return None };
        let entries = if entries == 0 { 1 << 16 } else { usize::from(entries) };
        let first = if signed { i64::from(first as i16) } else { i64::from(first) };
        let bytes = file.value(&file.data, values)?;
        let read = if file.big_endian { BigEndian::read_u16 } else { LittleEndian::read_u16 };
        let words: Vec<u16> = match bits {
            ..=8 => bytes.iter().map(|b| u16::from(*b)).collect(),
            _ => bytes.chunks_exact(2).map(read).collect(),
        };
        let (mut out, mut rest) = (Vec::<u16>::new(), &words[..]);
        while out.len() < entries {
            let [code, length, after @ ..] = rest else { return None };
            let length = usize::from(*length);
            match code {
                0 => {
                    out.extend_from_slice(after.get(..length)?);
                    rest = &after[length..];
                }
                1 => {
                    let (from, to) = (f64::from(*out.last()?), f64::from(*after.first()?));
                    let step = |i: usize| from + (to - from) * i as f64 / length as f64;
                    out.extend((1..=length).map(|i| step(i).round() as u16));
                    rest = &after[1..];
                }
                _ => return None,
            }
        }
        out.truncate(entries);
        Some(Table { first, values: out, bits })
    }

    pub fn get(&self, stored: f32) -> u16 {
        let index = (stored as i64 - self.first).clamp(0, self.values.len() as i64 - 1);
        self.values[index as usize]
    }

    /// The value in eight bits.
    fn byte(&self, stored: f32) -> u8 {
        let value = self.get(stored);
        if self.bits > 8 { (value >> 8) as u8 } else { value as u8 }
    }
}

/// The table that gives stored numbers their meaning, where the file has one.
pub fn modality(file: &File, signed: bool) -> Option<Table> {
    Table::read(file, file.data.items(0x0028_3000).first()?, 0x0028_3002, 0x0028_3006, signed)
}

/// Red, green and blue of stored numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Palette([Table; 3]);

impl Palette {
    pub fn read(file: &File, signed: bool) -> Option<Palette> {
        let table = |n: Tag| {
            let whole = Table::read(file, &file.data, 0x0028_1101 + n, 0x0028_1201 + n, signed);
            whole.or_else(|| Table::segmented(file, 0x0028_1101 + n, 0x0028_1221 + n, signed))
        };
        Some(Palette([table(0)?, table(1)?, table(2)?]))
    }

    pub fn colour(&self, stored: f32) -> [u8; 3] {
        self.0.each_ref().map(|table| table.byte(stored))
    }
}

/// Least and greatest stored number that fill the picture and are no values.
pub fn padding(file: &File, number: impl Fn(u16) -> f32) -> Option<[f32; 2]> {
    let data = &file.data;
    let float = |value: Tag| file.floats(data, value).and_then(|l| l.first().map(|v| *v as f32));
    let whole = |tag: Tag| file.short(data, tag).map(&number);
    let (value, limit) = match whole(0x0028_0120) {
        Some(value) => (value, whole(0x0028_0121)),
        None => (float(0x0028_0122).or_else(|| float(0x0028_0123))?, float(0x0028_0124).or_else(|| float(0x0028_0125))),
    };
    let limit = limit.unwrap_or(value);
    Some([value.min(limit), value.max(limit)])
}
