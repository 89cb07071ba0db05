//! Complete verification of a file: every rule of the format, also those that readers skip because they cost too much.

use std::path::Path;

use sha2::{Digest, Sha256};

use super::codes;
use super::codes::{Violation, require};
use super::head::align8;
use super::layout::SectionKind;
use super::{Limits, Reader};
use crate::Result;

/// Counts of what [`verify`] went through.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Report {
    /// Number of depths.
    pub depths: u64,
    /// Number of sections.
    pub sections: u64,
    /// Number of pages.
    pub pages: u64,
    /// Number of nodes over all depths.
    pub nodes: u64,
    /// Bytes of the file.
    pub bytes: u64,
}

/// Check all of the file `path`: its head, and every checksum, count, page, value, padding byte and digest. Pages are decoded one
/// at a time, so memory does not depend on the file's size.
///
/// # Errors
/// [`crate::Error::Format`] with the code and the byte of the first rule that is broken, and [`crate::Error::Io`].
pub fn verify(path: impl AsRef<Path>) -> Result<Report> {
    let path = path.as_ref();
    let reader = Reader::open(path, &Limits { decoded_bytes: u64::MAX })?;
    check(&reader).map_err(|b| b.at(path))
}

fn check(reader: &Reader) -> Result<Report, Violation> {
    let head = reader.head();
    let mut report = Report {
        depths: head.depths.len() as u64,
        sections: head.sections.len() as u64,
        bytes: reader.file_bytes(),
        ..Report::default()
    };
    let mut end = 0;
    for section in &head.sections {
        if section.kind != SectionKind::Meta {
            let padding = reader.read(end, section.offset - end)?;
            require(padding.iter().all(|&b| b == 0), codes::PADDING, end, || "padding is not zero".into())?;
        }
        end = section.offset + section.length;
        match section.kind {
            SectionKind::Meta => end = align8(end),
            SectionKind::Other(_) => {
                let crc = crc32fast::hash(&reader.read(section.offset, section.length)?);
                require(crc == section.crc, codes::PAGE_CRC, section.offset, || "a section is damaged".into())?;
            }
            _ => report.pages += u64::from(section.pages),
        }
    }
    for (d, depth) in head.depths.iter().enumerate() {
        let mut digest = Sha256::new();
        if let Some(above) = d.checked_sub(1) {
            let mut internal = 0;
            for page in 0..head.depths[above].nodes.div_ceil(1 << head.header.topo_page_log2) {
                let masks = reader.topo_page(d, page as usize)?;
                internal += masks.iter().filter(|&&m| m != 0).count() as u64;
                digest.update(&masks);
            }
            require(internal == head.depths[above].internal, codes::TOPOLOGY, depth.block_offset, || {
                format!(
                    "depth {above} has {internal} nodes with children, its entry says {}",
                    head.depths[above].internal
                )
            })?;
        }
        for (s, stream) in head.streams.iter().enumerate() {
            if stream.is_constant() {
                continue;
            }
            for page in 0..depth.nodes.div_ceil(1 << head.header.page_log2) {
                digest.update(reader.stream_page(d, s, page as usize)?);
            }
        }
        require(digest.finalize()[..] == depth.digest, codes::DIGEST, depth.block_offset, || {
            format!("the content of depth {d} is not that of its digest")
        })?;
        report.nodes += depth.nodes;
    }
    Ok(report)
}
