//! Pages: the units that are compressed, checksummed and read. Decompression happens here alone.

use std::cell::RefCell;

use zstd::zstd_safe::{self, CParameter};

use super::codes;
use super::codes::{Violation, require};
use super::layout::{Fields, PAGE_REF_LEN, SectionEntry, SectionKind, TOPO_REF_LEN};

/// Number of codecs: 0 stores pages as they are, 1 is [`ZSTD`].
pub const CODECS: u8 = 2;
/// Codec by which each page is a zstd frame, or is stored as it is where that is not longer.
pub const ZSTD: u8 = 1;

/// Place of a page in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PageRef {
    /// From the start of the section.
    pub offset: u64,
    /// Bytes of the page in the file.
    pub length: u32,
    /// Checksum of the page.
    pub crc: u32,
    /// In a TOPO section the rank, one depth down, of the first child of the page's first node; 0 in a PAGE section.
    pub first_child: u64,
}

/// Page of these `bytes`: a zstd frame of the level `level`, 1 to 19, or the bytes themselves where the frame is not shorter. Each
/// thread keeps a compression context, since creating one takes longer than compressing a page.
pub fn compress(level: i32, bytes: Vec<u8>) -> Vec<u8> {
    thread_local! {
        static CONTEXT: RefCell<zstd_safe::CCtx<'static>> = RefCell::new(context());
    }
    let mut out = Vec::with_capacity(zstd_safe::compress_bound(bytes.len()));
    let made = CONTEXT.with_borrow_mut(|context| {
        // Between frames and within its range this cannot fail; a failure would only change the level.
        let _ = context.set_parameter(CParameter::CompressionLevel(level));
        context.compress2(&mut out, &bytes)
    });
    match made {
        Ok(n) if n < bytes.len() => out,
        _ => bytes,
    }
}

fn context() -> zstd_safe::CCtx<'static> {
    let mut context = zstd_safe::CCtx::create();
    // Setting a parameter of a fresh context within its range cannot fail.
    let _ = context.set_parameter(CParameter::ContentSizeFlag(true));
    let _ = context.set_parameter(CParameter::ChecksumFlag(false));
    let _ = context.set_parameter(CParameter::DictIdFlag(false));
    context
}

/// Decode a page to exactly `decoded` bytes; `offset` is its place in the file, for messages. The CRC is checked first, and no more
/// than `decoded` bytes are ever allocated.
pub fn decode(bytes: &[u8], crc: u32, codec: u8, decoded: usize, offset: u64) -> Result<Vec<u8>, Violation> {
    require(crc32fast::hash(bytes) == crc, codes::PAGE_CRC, offset, || "a page is damaged".into())?;
    if bytes.len() == decoded {
        return Ok(bytes.to_vec());
    }
    let frame = |what: &str| Violation { code: codes::PAGE_FRAME, offset, what: format!("a page {what}") };
    if codec != ZSTD || bytes.len() > decoded {
        return Err(frame("is not as long as the counts say"));
    }
    let dictionary = zstd_safe::get_dict_id_from_frame(bytes).is_some();
    let whole = zstd_safe::find_frame_compressed_size(bytes) == Ok(bytes.len());
    let size = zstd_safe::get_frame_content_size(bytes).ok().flatten();
    if dictionary || !whole || size != Some(decoded as u64) || bytes.first_chunk() != Some(&ZSTD_MAGIC) {
        return Err(frame("is not one zstd frame of the size that the counts give"));
    }
    let mut out = Vec::with_capacity(decoded);
    match zstd_safe::decompress(&mut out, bytes) {
        Ok(n) if n == decoded => Ok(out),
        _ => Err(frame("does not decompress to the size that the counts give")),
    }
}

/// First bytes of a zstd frame. Skippable frames begin with others, and are not allowed.
const ZSTD_MAGIC: [u8; 4] = 0xFD2F_B528u32.to_le_bytes();

/// The index of a TOPO or PAGE section, checked: its CRC, and that the pages fill the section from the index on without a
/// gap. `bytes` are [`SectionEntry::index_len`] long.
pub fn parse_index(section: &SectionEntry, bytes: &[u8]) -> Result<Vec<PageRef>, Violation> {
    require(crc32fast::hash(bytes) == section.crc, codes::INDEX_CRC, section.offset, || {
        "the index of a section is damaged".into()
    })?;
    let mut end = section.index_len();
    let mut refs = Vec::with_capacity(section.pages as usize);
    for (i, entry) in bytes.chunks_exact(section.ref_len()).enumerate() {
        let mut f = Fields::new(entry);
        let mut page = PageRef { offset: f.u64(), length: f.u32(), crc: f.u32(), first_child: 0 };
        if section.kind == SectionKind::Topo {
            page.first_child = f.u64();
        }
        require(page.offset == end, codes::INDEX_PLACE, section.offset + (i * section.ref_len()) as u64, || {
            format!("page {i} of a section starts at {}, not where the one before ends", page.offset)
        })?;
        end += u64::from(page.length);
        refs.push(page);
    }
    require(end == section.length, codes::INDEX_PLACE, section.offset, || {
        format!("the pages of a section end at {end}, it has {} bytes", section.length)
    })?;
    Ok(refs)
}

/// Body of a section, which is its index and its pages, and the checksum of the index. `first_child` has one entry per page in a TOPO
/// section.
pub fn put_section(kind: SectionKind, pages: &[Vec<u8>], first_child: &[u64]) -> (Vec<u8>, u32) {
    let entry = if kind == SectionKind::Topo { TOPO_REF_LEN } else { PAGE_REF_LEN };
    let index_len = pages.len() * entry;
    let total = index_len + pages.iter().map(Vec::len).sum::<usize>();
    let mut out = Vec::with_capacity(total);
    let mut offset = index_len as u64;
    for (i, page) in pages.iter().enumerate() {
        out.extend(offset.to_le_bytes());
        out.extend((page.len() as u32).to_le_bytes());
        out.extend(crc32fast::hash(page).to_le_bytes());
        if kind == SectionKind::Topo {
            out.extend(first_child.get(i).copied().unwrap_or(0).to_le_bytes());
        }
        offset += page.len() as u64;
    }
    let crc = crc32fast::hash(&out);
    pages.iter().for_each(|page| out.extend(page));
    (out, crc)
}
