//! The head: everything that is known of a file before any page is read. Parsing it checks all rules about it.

use sha2::{Digest, Sha256};

use super::codes;
use super::codes::{Violation, require};
use super::layout::{
    DEPTH_LEN, DepthEntry, HEADER_LEN, Header, MAX_META, NONE, SECTION_LEN, STREAM_LEN, SectionEntry, SectionKind,
    StreamEntry,
};
use super::{filter, meta, page};
use crate::volume::{Info, MAX_DEPTH};

/// Largest head, in bytes. A reader has to hold it before anything in it has been checked.
pub const MAX_HEAD: usize = 1 << 20;

/// The parsed head of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Head {
    pub(super) header: Header,
    /// Entries of the depths, root first.
    pub depths: Vec<DepthEntry>,
    /// Entries of the streams.
    pub streams: Vec<StreamEntry>,
    /// Entries of the sections, in the order of the file.
    pub sections: Vec<SectionEntry>,
    /// Description of the texel.
    pub info: Info,
    /// META as its canonical JSON.
    pub(super) meta: Vec<u8>,
}

/// `n` rounded up to a multiple of 8.
pub fn align8(n: u64) -> u64 {
    n.next_multiple_of(8)
}

impl Head {
    /// Length of the head of a file that starts with these bytes.
    pub(super) fn length(start: &[u8; HEADER_LEN]) -> Result<usize, Violation> {
        let header = Header::parse(start)?;
        let (length, least) = (header.head_length as usize, header.tables_end());
        require(length <= MAX_HEAD && length >= least && length % 8 == 0, codes::HEAD_LENGTH, 16, || {
            format!("a head of {length} bytes; {least} to {MAX_HEAD} and a multiple of 8 was expected")
        })?;
        Ok(length)
    }

    /// Parse and check a head of which `bytes` has [`Head::length`] bytes. The length of the file is checked by the caller.
    pub(super) fn parse(bytes: &[u8]) -> Result<Head, Violation> {
        let start = bytes.first_chunk::<HEADER_LEN>().ok_or_else(|| Violation {
            code: codes::HEAD_LENGTH,
            offset: 0,
            what: format!("it has only {} bytes", bytes.len()),
        })?;
        let length = Head::length(start)?;
        require(bytes.len() == length, codes::HEAD_LENGTH, 16, || "the head is cut short".into())?;
        let header = Header::parse(start)?;
        require(crc_of(bytes) == header.crc, codes::HEAD_CRC, 20, || "the head is damaged".into())?;
        header.check()?;

        let records = |from: usize, len: usize, n: usize| {
            bytes.get(from..from + len * n).unwrap_or_default().chunks_exact(len).enumerate()
        };
        let (depth_at, stream_at, section_at) = header.tables();
        let depths: Vec<_> =
            records(depth_at, DEPTH_LEN, header.depths.into()).map(|(_, b)| DepthEntry::parse(b)).collect();
        check_counts(&depths, header.nodes, depth_at as u64)?;
        let mut streams: Vec<StreamEntry> = Vec::new();
        for (i, b) in records(stream_at, STREAM_LEN, header.streams.into()) {
            let stream = StreamEntry::parse(b);
            stream.check(&streams, (stream_at + i * STREAM_LEN) as u64)?;
            streams.push(stream);
        }
        let id = content_id(&header, &depths, &streams);
        require(id == header.content_id, codes::CONTENT_ID, 112, || "the content id is not that of the tables".into())?;
        let sections: Vec<_> =
            records(section_at, SECTION_LEN, header.sections.into()).map(|(_, b)| SectionEntry::parse(b)).collect();
        let mut head = Head { header, depths, streams, sections, info: meta::blank_info(), meta: Vec::new() };
        head.check_sections(section_at as u64)?;
        head.check_blocks(depth_at as u64)?;
        head.read_meta(bytes)?;
        Ok(head)
    }

    fn read_meta(&mut self, bytes: &[u8]) -> Result<(), Violation> {
        let Some(section) = self.sections.first() else { return Ok(()) };
        let (from, len) = (section.offset as usize, section.length as usize);
        let body = bytes.get(from..from + len).unwrap_or_default();
        require(crc32fast::hash(body) == section.crc, codes::META_CRC, section.offset, || "META is damaged".into())?;
        let tail = bytes.get(from + len..).unwrap_or_default();
        require(tail.iter().all(|&b| b == 0), codes::PADDING, (from + len) as u64, || "padding is not zero".into())?;
        self.info = meta::parse(body, &self.header, &self.streams).map_err(|what| Violation {
            code: codes::META_JSON,
            offset: from as u64,
            what,
        })?;
        self.meta = body.to_vec();
        Ok(())
    }

    /// Kind, depth and stream of the sections that a file with these depths and streams must have, in order: META; then for each depth
    /// a TOPO section, except for the root, and a PAGE section for each stream that is not constant. Unknown sections that are not
    /// critical may follow.
    pub(super) fn expected(&self) -> Vec<(SectionKind, u8, u8)> {
        let mut out = vec![(SectionKind::Meta, NONE, NONE)];
        for d in 0..self.header.depths {
            if d > 0 {
                out.push((SectionKind::Topo, d, NONE));
            }
            let paged = self.streams.iter().enumerate().filter(|(_, s)| !s.is_constant());
            out.extend(paged.map(|(s, _)| (SectionKind::Page, d, s as u8)));
        }
        out
    }

    fn check_sections(&self, table_at: u64) -> Result<(), Violation> {
        let expected = self.expected();
        let mut end = self.header.tables_end() as u64;
        for (i, section) in self.sections.iter().enumerate() {
            let at = table_at + (i * SECTION_LEN) as u64;
            require(section.reserved == [0; 6] && section.flags & !3 == 0, codes::RESERVED, at, || {
                "reserved bits of a section are set".into()
            })?;
            match expected.get(i) {
                Some(&(kind, depth, stream)) => {
                    require(
                        (section.kind, section.depth, section.stream) == (kind, depth, stream),
                        codes::SECTION_ORDER,
                        at,
                        || {
                            format!(
                                "section {i} is {:?} of depth {} and stream {}, not {kind:?} of {depth} and {stream}",
                                section.kind, section.depth, section.stream
                            )
                        },
                    )?;
                    self.check_size(section, at)?;
                }
                None => {
                    let unknown = matches!(section.kind, SectionKind::Other(_));
                    require(unknown, codes::SECTION_ORDER, at, || format!("section {i} is one too many"))?;
                    require(section.flags & SectionEntry::CRITICAL == 0, codes::SECTION_CRITICAL, at, || {
                        format!("section {i} is of a type that this reader needs to know and does not")
                    })?;
                }
            }
            require(section.offset == align8(end), codes::SECTION_PLACE, at, || {
                format!("section {i} starts at {}, the one before ends at {end}", section.offset)
            })?;
            end = section.offset.checked_add(section.length).filter(|&e| e <= self.header.file_length).ok_or_else(
                || Violation {
                    code: codes::SECTION_PLACE,
                    offset: at,
                    what: format!("section {i} ends after the end of the file"),
                },
            )?;
            if section.kind == SectionKind::Meta {
                let head = u64::from(self.header.head_length);
                require(align8(end) == head, codes::HEAD_LENGTH, 16, || "the head does not end after META".into())?;
                end = head;
            }
        }
        require(self.sections.len() >= expected.len(), codes::SECTION_ORDER, table_at, || {
            format!("it has {} sections, {} were expected", self.sections.len(), expected.len())
        })?;
        require(end == self.header.file_length, codes::FILE_LENGTH, 24, || {
            format!("the header says {} bytes, the sections end at {end}", self.header.file_length)
        })
    }

    /// Check the decoded length, number of pages, codec and filter of an expected section; `at` is the offset of its entry.
    fn check_size(&self, section: &SectionEntry, at: u64) -> Result<(), Violation> {
        let nodes = |d: u8| self.depths.get(usize::from(d)).map_or(0, |e| e.nodes);
        let (decoded, pages, filters) = match section.kind {
            SectionKind::Topo => {
                let masks = nodes(section.depth.wrapping_sub(1));
                (masks, masks.div_ceil(1 << self.header.topo_page_log2), 1)
            }
            SectionKind::Page => {
                let (n, stream) = (nodes(section.depth), self.streams.get(usize::from(section.stream)));
                let components = stream.map_or(0, |s| u64::from(s.components));
                (n * components, n.div_ceil(1 << self.header.page_log2), filter::COUNT)
            }
            _ => {
                require(section.length <= MAX_META as u64, codes::SECTION_SIZE, at, || {
                    format!("META has {} bytes, {MAX_META} are allowed", section.length)
                })?;
                (section.length, 0, 1)
            }
        };
        require(section.decoded == decoded && u64::from(section.pages) == pages, codes::SECTION_SIZE, at, || {
            format!(
                "a section says {} bytes in {} pages where the counts give {decoded} in {pages}",
                section.decoded, section.pages
            )
        })?;
        let paged = section.kind != SectionKind::Meta;
        require(!paged || section.index_len() <= section.length, codes::SECTION_SIZE, at, || {
            "the index of a section is longer than the section".into()
        })?;
        let codecs = if paged { page::CODECS } else { 1 };
        require(section.codec < codecs && section.filter < filters, codes::SECTION_CODEC, at, || {
            format!("codec {} with filter {} is not known", section.codec, section.filter)
        })
    }

    fn check_blocks(&self, table_at: u64) -> Result<(), Violation> {
        let mut start = u64::from(self.header.head_length);
        for (d, depth) in self.depths.iter().enumerate() {
            let at = table_at + (d * DEPTH_LEN) as u64;
            let sections = self.sections.iter().filter(|s| s.kind != SectionKind::Meta && usize::from(s.depth) == d);
            let end = sections
                .filter(|s| !matches!(s.kind, SectionKind::Other(_)))
                .map(|s| s.offset + s.length)
                .fold(start, u64::max);
            require(depth.block_offset == start && depth.block_end == end, codes::BLOCK, at, || {
                format!(
                    "the block of depth {d} is said to span {}..{}, its sections span {start}..{end}",
                    depth.block_offset, depth.block_end
                )
            })?;
            start = align8(end);
        }
        Ok(())
    }

    /// Number of bytes of each depth's block, without padding.
    pub fn depth_sizes(&self) -> Vec<u64> {
        self.depths.iter().map(|d| d.block_end - d.block_offset).collect()
    }

    /// Number of bytes of the topology and of each stream, over all depths: their pages and indices, without padding and head. A
    /// constant stream takes none.
    pub fn channel_sizes(&self) -> Vec<(&'static str, u64)> {
        let sum = |wanted: &dyn Fn(&SectionEntry) -> bool| {
            self.sections.iter().filter(|s| wanted(s)).map(|s| s.length).sum::<u64>()
        };
        let mut out = vec![("topology", sum(&|s| s.kind == SectionKind::Topo))];
        for (i, stream) in self.streams.iter().enumerate() {
            let bytes = sum(&|s| s.kind == SectionKind::Page && usize::from(s.stream) == i);
            out.push((stream.channel().map_or("other", |c| c.name()), bytes));
        }
        out
    }

    /// Number of voxels along the cube's edge at the finest depth of the file.
    pub fn resolution(&self) -> u32 {
        1 << self.depths.len().saturating_sub(1)
    }

    /// Identifier of the file's content: a hash that does not depend on how the content is compressed.
    pub fn content_id(&self) -> [u8; 16] {
        self.header.content_id
    }

    /// Length of the file in bytes, according to the head.
    pub fn file_length(&self) -> u64 {
        self.header.file_length
    }

    /// Bytes of the head; its content id and CRC are set. Sections, depths and META must be final.
    pub(super) fn encode(&mut self) -> Vec<u8> {
        self.header.content_id = content_id(&self.header, &self.depths, &self.streams);
        let mut out = Vec::with_capacity(self.header.head_length as usize);
        self.header.put(&mut out);
        self.depths.iter().for_each(|d| d.put(&mut out));
        self.streams.iter().for_each(|s| s.put(&mut out));
        self.sections.iter().for_each(|s| s.put(&mut out));
        out.extend(&self.meta);
        out.resize(self.header.head_length as usize, 0);
        self.header.crc = crc_of(&out);
        out[20..24].copy_from_slice(&self.header.crc.to_le_bytes());
        out
    }
}

impl Header {
    /// Offsets of the depth, stream and section tables.
    fn tables(&self) -> (usize, usize, usize) {
        let streams = HEADER_LEN + usize::from(self.depths) * DEPTH_LEN;
        (HEADER_LEN, streams, streams + usize::from(self.streams) * STREAM_LEN)
    }

    pub fn tables_end(&self) -> usize {
        self.tables().2 + usize::from(self.sections) * SECTION_LEN
    }

    fn check(&self) -> Result<(), Violation> {
        require(self.incompat == 0, codes::FLAGS, 32, || {
            format!("it needs features that this reader does not know (flags {:#x})", self.incompat)
        })?;
        for (name, value, least, most, at) in [
            ("depths", self.depths, 1, MAX_DEPTH as u8 + 1, 40),
            ("streams", self.streams, 1, 32, 41),
            ("page_log2", self.page_log2, 10, 16, 42),
            ("topo_page_log2", self.topo_page_log2, 10, 16, 43),
            ("cyclic axes", self.cyclic, 0, 7, 44),
            ("up axis", self.up, 0, 2, 45),
        ] {
            require((least..=most).contains(&value), codes::RANGE, at, || {
                format!("{name} is {value}, not in {least}..={most}")
            })?;
        }
        require((1..=4096).contains(&self.sections), codes::RANGE, 46, || {
            format!("{} sections, not in 1..=4096", self.sections)
        })?;
        let b = &self.bounds;
        let ordered = (0..3).all(|k| b[k].is_finite() && b[k + 3].is_finite() && b[k] <= b[k + 3]);
        require(ordered, codes::FLOAT, 48, || "the bounds are not finite, or upside down".into())?;
        require(self.metres_per_unit.is_finite() && self.metres_per_unit >= 0.0, codes::FLOAT, 96, || {
            "metres per unit is not a finite number from 0 up".into()
        })
    }
}

impl StreamEntry {
    fn check(&self, earlier: &[StreamEntry], at: u64) -> Result<(), Violation> {
        require(
            self.reserved == 0 && self.reserved_tail == [0; 8] && self.flags & !7 == 0,
            codes::RESERVED,
            at,
            || "reserved bits of a stream are set".into(),
        )?;
        let name = String::from_utf8_lossy(&self.semantic).into_owned();
        let known = self.channel();
        require(known.is_some() || self.flags & Self::CRITICAL == 0, codes::STREAM_CRITICAL, at, || {
            format!("the stream {name:?} is one that this reader needs to know and does not")
        })?;
        let used = usize::from(self.components);
        let shape = (1..=8).contains(&used)
            && self.component_bytes == 1
            && (1..=255).contains(&self.quant_max)
            && known.is_none_or(|c| c.components(self.quant_max) == used && c.allows(self.quant_max));
        let most = self.maxima();
        let within = |k: usize, c: u8| most.get(k).is_some_and(|&most| c <= most);
        let error = self.max_abs_error.is_finite() && self.max_abs_error >= 0.0;
        let constant = self
            .constant
            .iter()
            .enumerate()
            .all(|(k, &c)| if self.is_constant() && k < used { within(k, c) } else { c == 0 });
        let single = earlier.iter().all(|e| e.semantic != self.semantic);
        require(shape && error && constant && single, codes::STREAM, at, || {
            format!("the entry of the stream {name:?} breaks its rules, or is there twice")
        })
    }
}

fn check_counts(depths: &[DepthEntry], sum: u64, at: u64) -> Result<(), Violation> {
    let bad = |d: usize, what: String| Violation { code: codes::COUNTS, offset: at + (d * DEPTH_LEN) as u64, what };
    let mut total = 0u64;
    let mut least = 0u64;
    for (d, depth) in depths.iter().enumerate() {
        let most = if d == 0 { 1 } else { 8 * least };
        if depth.nodes < least || depth.nodes > most || depth.nodes >= u64::from(u32::MAX) {
            return Err(bad(d, format!("depth {d} has {} nodes, not in {least}..={most}", depth.nodes)));
        }
        if depth.internal > depth.nodes || (d + 1 == depths.len() && depth.internal != 0) {
            return Err(bad(d, format!("depth {d} has {} inner of {} nodes", depth.internal, depth.nodes)));
        }
        least = depth.internal;
        total += depth.nodes;
    }
    require(total == sum, codes::COUNTS, 104, || format!("the depths have {total} nodes, the header says {sum}"))
}

/// Identity of a file's content, in 16 bytes, however it is compressed: SHA-256 over the fields that give the content a meaning and the
/// depths' digests.
fn content_id(header: &Header, depths: &[DepthEntry], streams: &[StreamEntry]) -> [u8; 16] {
    let mut bytes = vec![header.depths, header.cyclic, header.up];
    bytes.extend(header.bounds.iter().flat_map(|v| v.to_le_bytes()));
    bytes.extend(header.metres_per_unit.to_le_bytes());
    streams.iter().for_each(|s| s.put(&mut bytes));
    for depth in depths {
        bytes.extend(depth.nodes.to_le_bytes());
        bytes.extend(depth.digest);
    }
    let digest = Sha256::digest(&bytes);
    std::array::from_fn(|i| digest[i])
}

/// CRC-32 of a head in which the field of the CRC itself counts as 0.
fn crc_of(head: &[u8]) -> u32 {
    let mut crc = crc32fast::Hasher::new();
    crc.update(head.get(..20).unwrap_or_default());
    crc.update(&[0; 4]);
    crc.update(head.get(24..).unwrap_or_default());
    crc.finalize()
}
