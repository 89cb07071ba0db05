//! Layout of a DICOM file's pixels: size, channels, bits, colour space.
//!
//! Based on: NEMA PS3.3, section C.7.6.3 (image pixel), and PS3.5, section 8 (pixel data).

use super::dataset::{DOUBLE_PIXEL_DATA, FLOAT_PIXEL_DATA, File, PIXEL_DATA, Tag};
use crate::source::stack::coding::{Coding, Kind};

/// Layout of a file's pixels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    pub rows: usize,
    pub columns: usize,
    pub channels: usize,
    /// Bits that a number takes, that it has, and the highest of these.
    pub allocated: usize,
    pub stored: usize,
    pub high: usize,
    pub signed: bool,
    pub planar: bool,
    /// Attribute that holds the pixels: whole numbers or floats.
    pub data: Tag,
    pub photometric: String,
}

impl Layout {
    pub fn new(file: &File) -> Result<Layout, String> {
        let data = &file.data;
        let need = |tag, name: &str| {
            file.short(data, tag).map(usize::from).ok_or_else(|| format!("it does not say its {name}"))
        };
        let pixels = [PIXEL_DATA, FLOAT_PIXEL_DATA, DOUBLE_PIXEL_DATA].into_iter().find(|tag| data.0.contains_key(tag));
        let pixels = pixels.unwrap_or(PIXEL_DATA);
        let allocated = need(0x0028_0100, "bits")?;
        // Floats use all of their bits and do not say so.
        let stored = if pixels == PIXEL_DATA { need(0x0028_0101, "bits")? } else { allocated };
        let high = file.short(data, 0x0028_0102).filter(|_| pixels == PIXEL_DATA);
        let layout = Layout {
            rows: need(0x0028_0010, "rows")?,
            columns: need(0x0028_0011, "columns")?,
            channels: file.short(data, 0x0028_0002).map_or(1, usize::from),
            allocated,
            stored,
            high: high.map_or_else(|| stored.saturating_sub(1), usize::from),
            signed: file.short(data, 0x0028_0103) == Some(1),
            planar: file.short(data, 0x0028_0006) == Some(1),
            data: pixels,
            photometric: file.text(data, 0x0028_0004).unwrap_or_default(),
        };
        let bits = (1..=layout.allocated).contains(&layout.stored)
            && layout.stored - 1 <= layout.high
            && layout.high < layout.allocated;
        if layout.rows == 0 || layout.columns == 0 || !bits || ![1, 3].contains(&layout.channels) {
            return Err(format!("its pixels cannot be: {layout:?}"));
        }
        Ok(layout)
    }

    pub fn is_palette(&self) -> bool {
        self.photometric == "PALETTE COLOR" && self.channels == 1
    }

    /// Whether slices of both can be in one stack.
    pub fn is_like(&self, other: &Layout) -> bool {
        (self.columns, self.rows, self.coding(), &self.photometric)
            == (other.columns, other.rows, other.coding(), &other.photometric)
    }

    /// "512×512 MONOCHROME2 U16".
    pub fn describe(&self) -> String {
        format!("{}×{} {} {:?}", self.columns, self.rows, self.photometric, self.coding().kind)
    }

    /// Type of number that frames are decoded to.
    pub fn coding(&self) -> Coding {
        let kind = match (self.allocated, self.signed) {
            (32, _) if self.data == FLOAT_PIXEL_DATA => Kind::F32,
            (64, _) => Kind::F64,
            (8, false) => Kind::U8,
            (8, true) => Kind::I8,
            (16, false) => Kind::U16,
            (16, true) => Kind::I16,
            (_, false) => Kind::U32,
            (_, true) => Kind::I32,
        };
        Coding::native(kind, self.channels)
    }

    /// Bytes of a frame.
    pub fn bytes(&self) -> usize {
        self.rows * self.columns * self.coding().sample()
    }

    /// The number that 16 stored bits are.
    pub fn number(&self, bits: u16) -> f32 {
        if self.allocated != 16 {
            return if self.signed { f32::from(bits as i16) } else { f32::from(bits) };
        }
        let bits = self.clean(&bits.to_le_bytes(), false).first_chunk().map_or(bits, |b| u16::from_ne_bytes(*b));
        if self.signed { f32::from(bits as i16) } else { f32::from(bits) }
    }

    /// Only the bits that are said to be the number's, the sign carried on.
    pub fn clean(&self, raw: &[u8], big: bool) -> Vec<u8> {
        let width = self.allocated / 8;
        let (down, up) = (self.high + 1 - self.stored, 32 - self.stored);
        let mut out = Vec::with_capacity(raw.len());
        for bytes in raw.chunks_exact(width) {
            let mut b = [0u8; 4];
            for (n, v) in bytes.iter().enumerate() {
                b[if big { width - 1 - n } else { n }] = *v;
            }
            let v = u32::from_le_bytes(b) >> down << up;
            let v = if self.signed { (v as i32 >> up) as u32 } else { v >> up };
            let all = v.to_ne_bytes();
            out.extend_from_slice(if cfg!(target_endian = "big") { &all[4 - width..] } else { &all[..width] });
        }
        out
    }
}
