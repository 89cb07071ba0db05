//! Where samples are: in a file that is mapped into memory, or decoded, in memory or in a file without a name.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use memmap2::Mmap;

use super::samples::{Coding, Kind, Samples, byte_count};
use crate::format::open_file;
use crate::{Error, Result};

/// Where the bytes are.
pub enum Bytes {
    Memory(Vec<u8>),
    Mapped(Mmap),
}

impl std::ops::Deref for Bytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            Bytes::Memory(bytes) => bytes,
            Bytes::Mapped(map) => map,
        }
    }
}

/// Map a whole file. It is not to be changed while it is read; an empty one is no map but nothing.
pub fn map_file(path: &Path) -> Result<Bytes> {
    let io = |e| Error::io(path, e);
    let file = open_file(path)?;
    if file.metadata().map_err(io)?.len() == 0 {
        return Ok(Bytes::Memory(Vec::new()));
    }
    // SAFETY: the map is only read, as bytes; a file that is cut short by others meanwhile ends the program, as documented.
    Ok(Bytes::Mapped(unsafe { Mmap::map(&file) }.map_err(io)?))
}

/// Takes decoded bytes one after the other; beyond `in_memory` bytes they go to a file without a name.
pub struct Spool {
    memory: Vec<u8>,
    file: Option<std::io::BufWriter<std::fs::File>>,
    written: u64,
    in_memory: u64,
}

/// Decoded samples that a stack may have: 256 GiB.
const MAX_DECODED: u64 = 1 << 38;

/// Refuse `total` bytes that `stored` ones cannot stand for: deflate gives at most 1032 bytes a byte.
pub fn check_ratio(path: &Path, total: u64, stored: u64) -> Result<()> {
    if total / 1100 > stored.saturating_add(1 << 10) {
        let what = format!("{stored} bytes cannot hold the {total} that its sizes ask for: it is cut short, or lies");
        return Err(Error::input(path, "", what));
    }
    Ok(())
}

impl Spool {
    pub fn new(in_memory: u64) -> Spool {
        Spool { memory: Vec::new(), file: None, written: 0, in_memory }
    }

    pub fn push(&mut self, bytes: &[u8]) -> Result<()> {
        self.written += bytes.len() as u64;
        if self.written > MAX_DECODED {
            return Err(Error::Limit {
                what: "a stack, decoded, in bytes,".into(),
                needed: self.written,
                allowed: MAX_DECODED,
            });
        }
        let io = |e| Error::io(std::env::temp_dir(), e);
        if self.file.is_none() && self.written > self.in_memory {
            let mut file = std::io::BufWriter::with_capacity(1 << 20, tempfile::tempfile().map_err(io)?);
            file.write_all(&self.memory).map_err(io)?;
            self.memory = Vec::new();
            self.file = Some(file);
        }
        match &mut self.file {
            Some(file) => file.write_all(bytes).map_err(io)?,
            None => self.memory.extend_from_slice(bytes),
        }
        Ok(())
    }

    pub fn finish(self) -> Result<Bytes> {
        let Some(writer) = self.file else { return Ok(Bytes::Memory(self.memory)) };
        let io = |e| Error::io(std::env::temp_dir(), e);
        let file = writer.into_inner().map_err(|e| io(e.into_error()))?;
        // SAFETY: the file has no name, so nobody else changes it.
        Ok(Bytes::Mapped(unsafe { Mmap::map(&file) }.map_err(io)?))
    }
}

/// How a file packs its samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Packing {
    Raw,
    /// gzip or zlib: what the first bytes say.
    Deflate,
    /// Numbers in words.
    Text,
}

/// Where a header says that the samples are.
pub struct Data<'a> {
    /// The header, for messages about sizes.
    pub header: &'a Path,
    /// One after the other they hold the samples.
    pub files: Vec<PathBuf>,
    /// Bytes of each file before the (packed) samples; `None`: they are the last of it.
    pub skip: Option<u64>,
    /// Bytes to leave out once the samples are unpacked.
    pub skip_unpacked: u64,
    pub packing: Packing,
    pub coding: Coding,
    pub dims: [usize; 3],
}

/// What a stream of gzip or zlib gives, by its first bytes.
pub fn inflate<'a>(packed: &'a [u8]) -> Box<dyn Read + 'a> {
    if packed.starts_with(&[0x1f, 0x8b]) {
        Box::new(flate2::read::MultiGzDecoder::new(packed))
    } else {
        Box::new(flate2::read::ZlibDecoder::new(packed))
    }
}

impl Data<'_> {
    /// Bring the samples in reach; what is decoded stays in memory up to `in_memory` bytes.
    pub fn load(&self, in_memory: u64) -> Result<Samples> {
        let wrong = |what| Error::input(self.header, "", what);
        let Some(needed) = byte_count(self.dims, self.coding) else {
            let [x, y, z] = self.dims;
            return Err(wrong(format!("{x}×{y}×{z} samples: not a size that can be read")));
        };
        if let ([file], Packing::Raw) = (&self.files[..], self.packing) {
            let bytes = map_file(file)?;
            let start = match self.skip {
                Some(skip) => usize::try_from(skip).unwrap_or(usize::MAX),
                None => bytes.len().saturating_sub(needed),
            };
            return Samples::new(bytes, start, self.coding, self.dims).map_err(|e| Error::input(file, "", e));
        }
        let mut coding = self.coding;
        let mut total = needed as u64;
        if self.packing == Packing::Text {
            coding = Coding::native(Kind::F64, self.coding.channels);
            total = byte_count(self.dims, coding).unwrap_or(usize::MAX) as u64;
        }
        let stored = self.files.iter().filter_map(|f| std::fs::metadata(f).ok()).map(|m| m.len()).sum();
        check_ratio(self.header, total, stored)?;
        let mut spool = Spool::new(in_memory);
        let mut left = total;
        for file in &self.files {
            let bytes = map_file(file)?;
            let share = (total / self.files.len() as u64) as usize;
            let skip =
                self.skip.map_or(bytes.len().saturating_sub(share), |s| usize::try_from(s).unwrap_or(usize::MAX));
            let body = bytes.get(skip..).unwrap_or_default();
            match self.packing {
                Packing::Raw => {
                    let part = &body[..body.len().min(usize::try_from(left).unwrap_or(usize::MAX))];
                    spool.push(part)?;
                    left -= part.len() as u64;
                }
                Packing::Deflate => left -= unpack(file, inflate(body), self.skip_unpacked, left, &mut spool)?,
                Packing::Text => left -= words(file, body, left, &mut spool)?,
            }
        }
        if left > 0 {
            return Err(wrong(format!(
                "its samples need {total} bytes, {} are there: it is cut short, or lies",
                total - left
            )));
        }
        Samples::new(spool.finish()?, 0, coding, self.dims).map_err(wrong)
    }
}

/// Move at most `left` bytes after the first `skip` from `from` to `spool`; gives how many.
fn unpack(path: &Path, mut from: impl Read, skip: u64, left: u64, spool: &mut Spool) -> Result<u64> {
    let broken = |e: std::io::Error| Error::input(path, "", format!("its packed samples are broken: {e}"));
    std::io::copy(&mut from.by_ref().take(skip), &mut std::io::sink()).map_err(broken)?;
    let mut buffer = vec![0; 1 << 16];
    let mut done = 0;
    let mut from = from.take(left);
    loop {
        let n = from.read(&mut buffer).map_err(broken)?;
        if n == 0 {
            return Ok(done);
        }
        spool.push(&buffer[..n])?;
        done += n as u64;
    }
}

/// Numbers in words as f64; gives how many bytes they became.
fn words(path: &Path, text: &[u8], left: u64, spool: &mut Spool) -> Result<u64> {
    let mut done = 0;
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
            if done < left {
                spool.push(&number.to_ne_bytes())?;
                done += 8;
            }
        }
    }
    Ok(done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spool_is_the_same_in_memory_and_in_a_file() {
        let fill = |in_memory| {
            let mut spool = Spool::new(in_memory);
            spool.push(&[1, 2, 3]).unwrap();
            spool.push(&[4, 5, 6]).unwrap();
            spool.finish().unwrap().to_vec()
        };
        assert_eq!(fill(6), [1, 2, 3, 4, 5, 6]);
        assert_eq!(fill(5), [1, 2, 3, 4, 5, 6]);
        assert_eq!(fill(0), [1, 2, 3, 4, 5, 6]);
        assert!(check_ratio(Path::new("a"), 1 << 36, 1000).is_err(), "a bomb");
    }
}
