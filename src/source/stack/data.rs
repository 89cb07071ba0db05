//! Loading of samples from where a header says that they are: from one or several files, raw, compressed, or as text.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::bytes::{Spool, check_ratio, map_file};
use super::choice::StoredVolume;
use super::coding::{Coding, Kind, byte_count};
use super::samples::Samples;
use crate::{Error, Result};

/// Compression of a file's samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Packing {
    Raw,
    /// gzip or zlib, told apart by the first bytes.
    Deflate,
    /// Numbers as text.
    Text,
}

impl Packing {
    /// The packing of a file whose header and samples are compressed as one, if at all.
    pub fn of_whole(bytes: &[u8]) -> Packing {
        if bytes.starts_with(&[0x1f, 0x8b]) { Packing::Deflate } else { Packing::Raw }
    }

    /// `offset` of the samples in such a file as [`Data::skip`] and [`Data::skip_unpacked`].
    pub fn skips_of_whole(self, offset: u64) -> (Option<u64>, u64) {
        if self == Packing::Raw { (Some(offset), 0) } else { (Some(0), offset) }
    }
}

/// The first bytes, at most `count`, of a header, unpacked where its file is compressed as a whole; and how that is.
pub fn binary_header(path: &Path, count: usize) -> Result<(Vec<u8>, Packing)> {
    let map = map_file(path)?;
    let packing = Packing::of_whole(&map);
    if packing == Packing::Raw {
        return Ok((map[..map.len().min(count)].to_vec(), packing));
    }
    let mut bytes = Vec::new();
    let cut = |e| Error::input(path, "", format!("its packed header is broken: {e}"));
    inflate(&map).take(count as u64).read_to_end(&mut bytes).map_err(cut)?;
    Ok((bytes, packing))
}

/// Place of the samples, as a header gives it.
pub struct Data<'a> {
    /// The header, for messages about sizes.
    pub header: &'a Path,
    /// Files that hold the samples, one after the other.
    pub files: Vec<PathBuf>,
    /// Number of bytes of each file before the (compressed) samples; `None` where they are at its end.
    pub skip: Option<u64>,
    /// Number of bytes to skip after decompression.
    pub skip_unpacked: u64,
    pub packing: Packing,
    pub coding: Coding,
    pub dims: [usize; 3],
    /// Which of the volumes that are stored one after the other is taken.
    pub volume: StoredVolume,
}

/// Decompressed contents of a stream of gzip or zlib, told apart by its first bytes.
pub fn inflate<'a>(packed: &'a [u8]) -> Box<dyn Read + 'a> {
    if packed.starts_with(&[0x1f, 0x8b]) {
        Box::new(flate2::read::MultiGzDecoder::new(packed))
    } else {
        Box::new(flate2::read::ZlibDecoder::new(packed))
    }
}

impl Data<'_> {
    /// Load the samples. Up to `in_memory` decoded bytes stay in memory.
    ///
    /// # Errors
    /// [`Error::Io`] where a file cannot be read, [`Error::Input`] where it does not hold what the header says.
    pub fn load(&self, in_memory: u64) -> Result<Samples> {
        let wrong = |what| Error::input(self.header, "", what);
        let Some(needed) = byte_count(self.dims, self.coding) else {
            let [x, y, z] = self.dims;
            return Err(wrong(format!("{x}×{y}×{z} samples: not a size that can be read")));
        };
        if let ([file], Packing::Raw) = (&self.files[..], self.packing) {
            let bytes = map_file(file)?;
            let skip = self.skip.unwrap_or_else(|| {
                (bytes.len() as u64).saturating_sub((needed as u64).saturating_mul(self.volume.count))
            });
            let before = (needed as u64).saturating_mul(self.volume.index);
            let start = usize::try_from(skip.saturating_add(before)).unwrap_or(usize::MAX);
            return Samples::new(bytes, start, self.coding, self.dims).map_err(|e| Error::input(file, "", e));
        }
        let mut coding = self.coding;
        let mut needed = needed as u64;
        if self.packing == Packing::Text {
            coding = Coding::native(Kind::F64, self.coding.channels);
            needed = byte_count(self.dims, coding).unwrap_or(usize::MAX) as u64;
        }
        let before = needed.saturating_mul(self.volume.index);
        let stored = self.files.iter().filter_map(|f| std::fs::metadata(f).ok()).map(|m| m.len()).sum();
        check_ratio(self.header, needed.saturating_add(before), stored)?;
        let mut out = SelectedBytes { before, left: needed, spool: Spool::new(in_memory) };
        let share = needed.saturating_mul(self.volume.count) / self.files.len().max(1) as u64;
        for file in &self.files {
            if out.left == 0 {
                break;
            }
            let bytes = map_file(file)?;
            let skip = self.skip.unwrap_or_else(|| (bytes.len() as u64).saturating_sub(share));
            let body = bytes.get(usize::try_from(skip).unwrap_or(usize::MAX)..).unwrap_or_default();
            match self.packing {
                Packing::Raw => out.push(body)?,
                Packing::Deflate => unpack(file, inflate(body), self.skip_unpacked, &mut out)?,
                Packing::Text => words(file, body, &mut out)?,
            }
        }
        if out.left > 0 {
            return Err(wrong(format!(
                "its samples need {needed} bytes, {} are there: it is cut short, or lies",
                needed - out.left
            )));
        }
        Samples::new(out.spool.finish()?, 0, coding, self.dims).map_err(wrong)
    }
}

/// Sink for a stream of samples that keeps one consecutive part of it: the volume that was selected.
struct SelectedBytes {
    /// Number of bytes that come before it.
    before: u64,
    /// Number of its bytes that are still to come.
    left: u64,
    spool: Spool,
}

impl SelectedBytes {
    fn push(&mut self, bytes: &[u8]) -> Result<()> {
        let skipped = bytes.len().min(usize::try_from(self.before).unwrap_or(usize::MAX));
        self.before -= skipped as u64;
        let rest = &bytes[skipped..];
        let part = &rest[..rest.len().min(usize::try_from(self.left).unwrap_or(usize::MAX))];
        self.left -= part.len() as u64;
        self.spool.push(part)
    }
}

/// Decompress `from`, without its first `skip` bytes, until `out` is complete.
fn unpack(path: &Path, mut from: impl Read, skip: u64, out: &mut SelectedBytes) -> Result<()> {
    let broken = |e: std::io::Error| Error::input(path, "", format!("its packed samples are broken: {e}"));
    std::io::copy(&mut from.by_ref().take(skip), &mut std::io::sink()).map_err(broken)?;
    let mut buffer = vec![0; 1 << 16];
    while out.left > 0 {
        let most = out.before.saturating_add(out.left).min(buffer.len() as u64) as usize;
        let n = from.read(&mut buffer[..most]).map_err(broken)?;
        if n == 0 {
            break;
        }
        out.push(&buffer[..n])?;
    }
    Ok(())
}

/// Read numbers that are written as text, as f64.
fn words(path: &Path, text: &[u8], out: &mut SelectedBytes) -> Result<()> {
    for (row, line) in text.split(|&c| c == b'\n').enumerate() {
        let apart = |c: &u8| c.is_ascii_whitespace() || *c == b',';
        for word in line.split(apart).filter(|w| !w.is_empty()) {
            let number = std::str::from_utf8(word).ok().and_then(|w| w.parse::<f64>().ok());
            let Some(number) = number else {
                let word = String::from_utf8_lossy(&word[..word.len().min(20)]).into_owned();
                return Err(Error::input(
                    path,
                    format!("line {} of the data", row + 1),
                    format!("{word:?} is not a number"),
                ));
            };
            out.push(&number.to_ne_bytes())?;
        }
    }
    Ok(())
}
