//! Numbers of a binary file, read one after another in either order of bytes.

use byteorder::{BE, ByteOrder, LE};

use crate::geom::DVec3;

/// A fault in a file: its place, and the text that says what is wrong.
pub type Fault = (String, String);

pub fn at_byte(offset: usize, what: impl Into<String>) -> Fault {
    (format!("byte {offset}"), what.into())
}

/// A place in a file. Reading beyond its end is a fault that says how much was announced.
pub struct Cursor<'a> {
    bytes: &'a [u8],
    pub at: usize,
    pub big_endian: bool,
}

impl<'a> Cursor<'a> {
    /// At the first byte; little-endian.
    pub fn new(bytes: &'a [u8]) -> Cursor<'a> {
        Cursor { bytes, at: 0, big_endian: false }
    }

    pub fn take(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        let taken = self.at.checked_add(count).and_then(|end| self.bytes.get(self.at..end));
        let taken = taken.ok_or_else(|| {
            at_byte(
                self.at,
                format!("the file ends too early: {count} more bytes were announced, {} are left", self.left()),
            )
        })?;
        self.at += count;
        Ok(taken)
    }

    pub fn u16(&mut self) -> Result<u16, Fault> {
        let bytes = self.take(2)?;
        Ok(if self.big_endian { BE::read_u16(bytes) } else { LE::read_u16(bytes) })
    }

    pub fn u32(&mut self) -> Result<u32, Fault> {
        let bytes = self.take(4)?;
        Ok(if self.big_endian { BE::read_u32(bytes) } else { LE::read_u32(bytes) })
    }

    pub fn f32(&mut self) -> Result<f32, Fault> {
        let bytes = self.take(4)?;
        Ok(if self.big_endian { BE::read_f32(bytes) } else { LE::read_f32(bytes) })
    }

    pub fn f64(&mut self) -> Result<f64, Fault> {
        let bytes = self.take(8)?;
        Ok(if self.big_endian { BE::read_f64(bytes) } else { LE::read_f64(bytes) })
    }

    /// `count` numbers; that they are there is checked before memory is taken for them.
    pub fn u16s(&mut self, count: usize) -> Result<Vec<u16>, Fault> {
        let bytes = self.take(count.saturating_mul(2))?;
        let mut out = vec![0; count];
        if self.big_endian {
            BE::read_u16_into(bytes, &mut out)
        } else {
            LE::read_u16_into(bytes, &mut out)
        }
        Ok(out)
    }

    /// `count` numbers, as [`Cursor::u16s`].
    pub fn f32s(&mut self, count: usize) -> Result<Vec<f32>, Fault> {
        let bytes = self.take(count.saturating_mul(4))?;
        let mut out = vec![0.0; count];
        if self.big_endian {
            BE::read_f32_into(bytes, &mut out)
        } else {
            LE::read_f32_into(bytes, &mut out)
        }
        Ok(out)
    }

    /// Bytes to the end.
    pub fn left(&self) -> usize {
        self.bytes.len().saturating_sub(self.at)
    }
}

pub fn point(p: [f32; 3]) -> DVec3 {
    DVec3::from(p.map(f64::from))
}
