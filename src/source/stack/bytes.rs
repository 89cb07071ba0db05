//! Storage of samples: a mapped file, or decoded bytes in memory or in an unnamed temporary file.

use std::io::Write;
use std::path::Path;

use memmap2::Mmap;

use crate::format::open_file;
use crate::{Error, Result, system};

/// Place of the bytes.
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
    Ok(Bytes::Mapped(system::map(&file).map_err(io)?))
}

/// Collector of decoded bytes. If they are more than `in_memory`, all of them go to an unnamed temporary file.
pub struct Spool {
    memory: Vec<u8>,
    file: Option<std::io::BufWriter<std::fs::File>>,
    written: u64,
    in_memory: u64,
}

/// Decoded samples that a stack may have: 256 GiB.
const MAX_DECODED: u64 = 1 << 38;

/// Refuse `total` bytes that `stored` ones cannot stand for: deflate gives at most 1032 bytes per byte.
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
        Ok(Bytes::Mapped(system::map(&file).map_err(io)?))
    }
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
