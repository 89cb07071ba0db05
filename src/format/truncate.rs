//! A coarser texel from a finer one: a new head over the same blocks.

use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;

use super::head::{Head, align8};
use super::layout::SectionKind;
use super::{Limits, PartFile, Reader, open_file};
use crate::{Error, Result};

/// Write depths 0 ..= `depth` of `path` to `out`; no page is decoded. A file that is cut short will do, as long as those
/// depths are whole.
///
/// Errors: those of reading and writing, and [`Error::Options`] where the file has no such depth or `out` is the file itself.
pub fn truncate(path: impl AsRef<Path>, depth: usize, out: impl AsRef<Path>) -> Result<u64> {
    let (path, out) = (path.as_ref(), out.as_ref());
    let reader = Reader::open_prefix(path, &Limits { decoded_bytes: u64::MAX })?;
    let head = reader.head();
    let Some(last) = head.depths.get(depth) else {
        return Err(Error::Options(format!(
            "{}: there is no depth {depth}, the finest is {}",
            path.display(),
            head.depths.len() - 1
        )));
    };
    if last.block_end > reader.file_bytes() {
        return Err(Error::input(path, "", format!("the file is cut short before the end of depth {depth}")));
    }
    let (from, to) = (head.depths[0].block_offset, last.block_end);
    let (mut head, shift) = shortened(head, depth);
    let bytes = head.encode();

    let mut source = open_file(path)?;
    source.seek(SeekFrom::Start(from)).map_err(|e| Error::io(path, e))?;
    let mut part = PartFile::create(out)?;
    part.write_all(&bytes).map_err(|e| Error::io(out, e))?;
    let copied = std::io::copy(&mut source.take(to - from), &mut part).map_err(|e| Error::io(out, e))?;
    if copied != to - from {
        return Err(Error::input(path, "", "the file became shorter while it was read"));
    }
    part.finish()?;
    Ok(to - shift)
}

/// The head of depths 0 ..= `depth` alone, and by how much its blocks move towards the start.
fn shortened(head: &Head, depth: usize) -> (Head, u64) {
    let mut head = head.clone();
    let wanted = |kind: SectionKind, d: u8| {
        kind == SectionKind::Meta || (!matches!(kind, SectionKind::Other(_)) && usize::from(d) <= depth)
    };
    head.sections.retain(|s| wanted(s.kind, s.depth));
    head.depths.truncate(depth + 1);
    if let Some(last) = head.depths.last_mut() {
        last.internal = 0;
    }
    head.header.depths = head.depths.len() as u8;
    head.header.sections = head.sections.len() as u16;
    head.header.nodes = head.depths.iter().map(|d| d.nodes).sum();
    let tables_end = head.header.tables_end() as u64;
    let length = align8(tables_end + head.meta.len() as u64);
    let shift = u64::from(head.header.head_length) - length;
    head.header.head_length = length as u32;
    for section in &mut head.sections {
        section.offset = if section.kind == SectionKind::Meta { tables_end } else { section.offset - shift };
    }
    for d in &mut head.depths {
        d.block_offset -= shift;
        d.block_end -= shift;
    }
    head.header.file_length = head.depths.last().map_or(length, |d| d.block_end);
    (head, shift)
}
