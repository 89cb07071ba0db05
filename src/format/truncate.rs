//! Truncation of a file to its coarser depths: a new head before the same blocks.

use std::io::Write;
use std::path::Path;

use super::head::{Head, align8};
use super::layout::SectionKind;
use super::{Limits, PartFile, Reader};
use crate::{Error, Result};

/// Bytes that are copied at a time.
const COPY_BYTES: u64 = 1 << 20;

/// Write the depths 0 to `depth` of the file `path` to `out`, without decoding any page. `path` may be cut short, as long as those
/// depths are whole. Returns the number of bytes written.
///
/// # Errors
/// Those of reading and writing; [`Error::Options`] where the file has no such depth; [`Error::Input`] where the depths are not whole.
pub fn truncate(path: impl AsRef<Path>, depth: usize, out: impl AsRef<Path>) -> Result<u64> {
    let (path, out) = (path.as_ref(), out.as_ref());
    let reader = Reader::open_head(path, &Limits { decoded_bytes: u64::MAX })?;
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

    let mut part = PartFile::create(out)?;
    part.write_all(&bytes).map_err(|e| Error::io(out, e))?;
    let mut at = from;
    while at < to {
        let length = COPY_BYTES.min(to - at);
        // Through the reader's open file: by now the path may name another one.
        let piece = reader.read(at, length).map_err(|b| b.at(path))?;
        part.write_all(&piece).map_err(|e| Error::io(out, e))?;
        at += length;
    }
    part.finish()?;
    Ok(to - shift)
}

/// Head of the depths 0 to `depth` alone, and the number of bytes by which the blocks move towards the start.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::tests::{ALL_CHANNELS, volume, written};
    use crate::format::{Quality, WriteOptions, verify, write};

    #[test]
    fn a_file_that_is_cut_short_opens_to_the_depth_that_is_whole() {
        let dir = tempfile::tempdir().unwrap();
        let (path, cut) = (dir.path().join("t.vtex"), dir.path().join("c.vtex"));
        let volume = volume(3, 6, ALL_CHANNELS);
        write(&volume, &path, &WriteOptions::default()).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let reader = Reader::open(&path, &Limits::default()).unwrap();
        let (whole, ends) = (reader.read_all().unwrap(), reader.head().depths.iter().map(|d| d.block_end as usize));
        assert!(reader.warnings().is_empty() && reader.whole_depths() == 6);
        for (depth, end) in ends.enumerate() {
            for (length, opened) in [(end - 1, depth), (end, depth + 1)] {
                std::fs::write(&cut, &bytes[..length]).unwrap();
                let prefix = Reader::open_prefix(&cut, &Limits::default());
                if opened == 0 {
                    let refused = prefix.err().unwrap().to_string();
                    assert!(
                        refused.contains("no depth of it is whole") && refused.contains("[file-length"),
                        "{refused}"
                    );
                    continue;
                }
                let prefix = prefix.unwrap();
                let found = prefix.read_all().unwrap();
                assert_eq!((found.depths.len(), prefix.whole_depths()), (opened, opened));
                for (d, (found, whole)) in found.depths.iter().zip(&whole.depths).enumerate() {
                    assert_eq!(found.voxels, whole.voxels);
                    // The last depth that is there is the finest.
                    assert!(if d + 1 < opened {
                        found.masks == whole.masks
                    } else {
                        found.masks.iter().all(|&m| m == 0)
                    });
                }
                let said: Vec<_> = prefix.warnings().iter().map(|(text, _)| text.to_owned()).collect();
                let wanted = format!(
                    "cut short after {length} of {} bytes; its depths up to {} are whole",
                    bytes.len(),
                    opened - 1
                );
                assert_eq!(said.len(), usize::from(length < bytes.len()), "{said:?}");
                assert!(said.iter().all(|text| text.contains(&wanted)), "{said:?}");
                assert!(length == bytes.len() || Reader::open(&cut, &Limits::default()).is_err());
            }
        }
        // Within the head nothing can be read, and what is too long is no prefix.
        for wrong in [&bytes[..200], &[&bytes[..], b"x"].concat()] {
            std::fs::write(&cut, wrong).unwrap();
            assert!(Reader::open_prefix(&cut, &Limits::default()).is_err());
        }
    }

    #[test]
    fn truncation_is_the_prefix_under_a_new_head() {
        let volume = volume(9, 7, ALL_CHANNELS);
        let (dir, path) = written(&volume, Quality::Full);
        let (short, direct, cut) = (dir.path().join("s.vtex"), dir.path().join("d.vtex"), dir.path().join("c.vtex"));
        let length = truncate(&path, 4, &short).unwrap();
        verify(&short).unwrap();
        let mut coarser = volume.clone();
        coarser.depths.truncate(5);
        coarser.depths[4].masks.fill(0);
        write(&coarser, &direct, &WriteOptions { level: 3, quality: Quality::Full }).unwrap();
        assert_eq!(std::fs::read(&short).unwrap(), std::fs::read(&direct).unwrap());
        assert_eq!(std::fs::metadata(&short).unwrap().len(), length);
        // A download that stopped inside depth 5 gives the same, and cannot be mistaken for a whole file.
        let end = Reader::open(&path, &Limits::default()).unwrap().head().depths[4].block_end as usize;
        std::fs::write(&cut, &std::fs::read(&path).unwrap()[..end + 11]).unwrap();
        let refused = Reader::open(&cut, &Limits::default()).err().unwrap().to_string();
        assert!(refused.contains("truncate --depth 4") && refused.contains("[file-length"), "{refused}");
        truncate(&cut, 4, &short).unwrap();
        assert_eq!(std::fs::read(&short).unwrap(), std::fs::read(&direct).unwrap());
        assert!(truncate(&cut, 5, &short).is_err());
    }
}
