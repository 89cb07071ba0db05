//! Opening of a TIFF that is held in memory: sizes in its directories are checked against the file before the decoder allocates anything.
//!
//! An entry of a directory consists of a type, a count, and the offset of that many values. The decoder allocates memory for all values of an
//! entry before it reads them, so a count in a tiny file may cost gigabytes; and overlapping directories cost time in the square of the file's
//! size. Intact files contain neither.
//!
//! Based on: Adobe, *TIFF Revision 6.0*, 1992, section 2; and the BigTIFF design of 2007 (offsets and counts of 64 bits).

use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::Path;

use byteorder::{BigEndian, ByteOrder, LittleEndian};
use tiff::TiffError;
use tiff::decoder::{Decoder, Limits};

use crate::{Error, Result};

/// Bytes of memory that a decoder needs per value of a directory, as read and in a list of offsets.
const PER_VALUE: u64 = 48;
/// Largest ratio of the bytes of values in all directories to those of the file; it is above 1, since several pages may share values.
const MAX_SHARED: u64 = 64;
/// Tags from here on are private: errors in them do not matter unless they are in [`READ`].
const PRIVATE: u16 = 32768;
/// Private tags that are read: pixel scale, tie point, keys of a GeoTIFF, and GDAL's mark of no datum.
const READ: [u16; 4] = [33550, 33922, 34735, 42113];

/// A decoder of the file `bytes` that takes at most `memory` bytes at a time.
///
/// # Errors
/// [`TiffError`] of the first directory, and for what no whole file asks for; [`Error::Limit`] where a directory takes more
/// than `memory`. `broken` gives them their places, by the number of the directory from 0.
pub(crate) fn open<'a>(
    path: &Path,
    bytes: &'a [u8],
    memory: u64,
    broken: impl Fn(usize, TiffError) -> Error,
) -> Result<Decoder<Cursor<&'a [u8]>>> {
    if let Some(layout) = Layout::of(bytes) {
        let most = layout.check().map_err(|(n, what)| Error::input(path, format!("page {}", n + 1), what))?;
        let needed = most.saturating_mul(PER_VALUE);
        if needed > memory {
            let what = format!("reading the places of the strips of {}, in bytes,", path.display());
            return Err(Error::Limit { what, needed, allowed: memory });
        }
    }
    let mut limits = Limits::default();
    let most = usize::try_from(memory).unwrap_or(usize::MAX).min(1 << 32);
    limits.decoding_buffer_size = most;
    limits.intermediate_buffer_size = most;
    Ok(Decoder::new(Cursor::new(bytes)).map_err(|e| broken(0, e))?.with_limits(limits))
}

/// How numbers lie in a file.
struct Layout<'a> {
    bytes: &'a [u8],
    big_endian: bool,
    /// Whether offsets and counts have 64 bits.
    is_big: bool,
}

/// Bytes of a value of a type; 0 where it is none that is known, whose entries decoders skip.
fn width(kind: u64) -> u64 {
    match kind {
        1 | 2 | 6 | 7 => 1,
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        5 | 10 | 12 | 16..=18 => 8,
        _ => 0,
    }
}

impl<'a> Layout<'a> {
    /// `None` where the file does not begin as a TIFF; decoders say so in their own words.
    fn of(bytes: &'a [u8]) -> Option<Layout<'a>> {
        let (big_endian, is_big) = match bytes.get(..4)? {
            b"II*\0" => (false, false),
            b"MM\0*" => (true, false),
            b"II+\0" => (false, true),
            b"MM\0+" => (true, true),
            _ => return None,
        };
        Some(Layout { bytes, big_endian, is_big })
    }

    /// The number of `width` bytes at `at`; `None` beyond the end.
    fn number(&self, at: u64, width: usize) -> Option<u64> {
        let at = usize::try_from(at).ok()?;
        let bytes = self.bytes.get(at..at.checked_add(width)?)?;
        Some(if self.big_endian { BigEndian::read_uint(bytes, width) } else { LittleEndian::read_uint(bytes, width) })
    }

    /// The most values that one directory has; or the number, from 0, of one that is wrong, and what is.
    fn check(&self) -> std::result::Result<u64, (usize, String)> {
        let (wide, head, length) = if self.is_big { (8, 8, 20) } else { (4, 2, 12) };
        let file = self.bytes.len() as u64;
        let mut at = self.number(if self.is_big { 8 } else { 4 }, wide).unwrap_or(0);
        let (mut seen, mut directories, mut values, mut most) = (BTreeSet::new(), 0u64, 0u64, 0);
        // A chain that goes round or beyond the end is the decoder's to tell.
        for n in 0.. {
            if at == 0 || !seen.insert(at) {
                break;
            }
            let Some(count) = self.number(at, head) else { break };
            let size = count.saturating_mul(length);
            directories = directories.saturating_add(size);
            if directories > file {
                return Err((
                    n,
                    format!("its directories have {directories} bytes of entries, the file {file} in all"),
                ));
            }
            let mut sum = 0u64;
            for entry in 0..count {
                let from = at + head as u64 + entry * length;
                let Some(tag) = self.number(from, 2) else { break };
                let (kind, count) = (self.number(from + 2, 2), self.number(from + 4, wide));
                let (Some(kind), Some(count)) = (kind, count) else { break };
                let tag = tag as u16;
                if self.is_big && width(kind) == 0 {
                    // The decoder would take what follows for entries at other places.
                    return Err((n, format!("its tag {tag} has values of the type {kind}, which there is not")));
                }
                if tag >= PRIVATE && !READ.contains(&tag) {
                    continue;
                }
                let needed = width(kind).saturating_mul(count);
                if needed > wide as u64 {
                    let start = self.number(from + 4 + wide as u64, wide).unwrap_or(u64::MAX);
                    if start.saturating_add(needed) > file {
                        let what =
                            format!("its tag {tag} has {count} values, which end beyond the file's {file} bytes");
                        return Err((n, what));
                    }
                }
                values = values.saturating_add(needed);
                sum = sum.saturating_add(count);
            }
            if values > file.saturating_mul(MAX_SHARED) {
                let what = format!("its directories ask for {values} bytes of values, the file has {file}");
                return Err((n, what));
            }
            most = most.max(sum);
            let Some(next) = self.number(at + head as u64 + size, wide) else { break };
            at = next;
        }
        Ok(most)
    }
}
