//! The fixed-size records of the head, as bytes.

use super::codes;
use super::codes::{Violation, require};
use super::{Channel, MAGIC};

/// Largest META.
pub const MAX_META: usize = 256 << 10;

/// Bytes of a [`Header`], magic and version included.
pub const HEADER_LEN: usize = 128;
/// Bytes of a [`DepthEntry`].
pub const DEPTH_LEN: usize = 64;
/// Bytes of a [`StreamEntry`].
pub const STREAM_LEN: usize = 32;
/// Bytes of a [`SectionEntry`].
pub const SECTION_LEN: usize = 48;
/// Bytes of an entry in the index of a TOPO section.
pub const TOPO_REF_LEN: usize = 24;
/// Bytes of an entry in the index of a PAGE section.
pub const PAGE_REF_LEN: usize = 16;
/// `depth` or `stream` of a section that has none.
pub const NONE: u8 = 255;

/// Reader of consecutive little-endian fields from bytes whose length was checked.
pub struct Fields<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Fields<'a> {
    /// Start at the first of `bytes`.
    pub fn new(bytes: &'a [u8]) -> Self {
        Fields { bytes, at: 0 }
    }

    /// The next `N` bytes; zeros past the end, which callers rule out by checking lengths first.
    pub fn take<const N: usize>(&mut self) -> [u8; N] {
        let out = self.bytes.get(self.at..self.at + N).and_then(|b| b.try_into().ok()).unwrap_or([0; N]);
        self.at += N;
        out
    }

    /// The next field, of 1 byte.
    pub fn u8(&mut self) -> u8 {
        u8::from_le_bytes(self.take())
    }
    /// The next field, an integer of 2 bytes.
    pub fn u16(&mut self) -> u16 {
        u16::from_le_bytes(self.take())
    }
    /// The next field, an integer of 4 bytes.
    pub fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }
    /// The next field, an integer of 8 bytes.
    pub fn u64(&mut self) -> u64 {
        u64::from_le_bytes(self.take())
    }
    /// The next field, a float of 4 bytes.
    pub fn f32(&mut self) -> f32 {
        f32::from_le_bytes(self.take())
    }
    /// The next field, a float of 8 bytes.
    pub fn f64(&mut self) -> f64 {
        f64::from_le_bytes(self.take())
    }
}

/// Fields of the first 128 bytes, without magic and major version.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Header {
    /// Minor version.
    pub minor: u16,
    /// Bytes of the head.
    pub head_length: u32,
    /// Checksum of the head.
    pub crc: u32,
    /// Bytes of the whole file.
    pub file_length: u64,
    /// Feature flags that a reader must know to read the file.
    pub incompat: u32,
    /// Feature flags that a reader may ignore.
    pub compat: u32,
    /// Number of depths.
    pub depths: u8,
    /// Number of streams.
    pub streams: u8,
    /// log2 of the voxels per page.
    pub page_log2: u8,
    /// log2 of the nodes per page of topology.
    pub topo_page_log2: u8,
    /// Bits of the axes along which opposite faces match.
    pub cyclic: u8,
    /// Source axis that became w: 0 x, 1 y, 2 z.
    pub up: u8,
    /// Number of sections.
    pub sections: u16,
    /// Box in source space that texel space covers.
    pub bounds: [f64; 6],
    /// Metres per source unit; 0 where unknown.
    pub metres_per_unit: f64,
    /// Number of nodes.
    pub nodes: u64,
    /// Identifier of the content.
    pub content_id: [u8; 16],
}

impl Header {
    /// Parse; the magic and the major version are checked here, since without them nothing else has a meaning.
    pub fn parse(bytes: &[u8; HEADER_LEN]) -> Result<Header, Violation> {
        let mut f = Fields::new(bytes);
        let magic: [u8; 12] = f.take();
        require(magic == MAGIC, codes::MAGIC, 0, || "the file does not start like one".into())?;
        let major = f.u16();
        require(major == super::MAJOR, codes::VERSION, 12, || {
            format!("it is of version {major}; this reader knows version {}", super::MAJOR)
        })?;
        Ok(Header {
            minor: f.u16(),
            head_length: f.u32(),
            crc: f.u32(),
            file_length: f.u64(),
            incompat: f.u32(),
            compat: f.u32(),
            depths: f.u8(),
            streams: f.u8(),
            page_log2: f.u8(),
            topo_page_log2: f.u8(),
            cyclic: f.u8(),
            up: f.u8(),
            sections: f.u16(),
            bounds: std::array::from_fn(|_| f.f64()),
            metres_per_unit: f.f64(),
            nodes: f.u64(),
            content_id: f.take(),
        })
    }

    /// Append the bytes of this record to `out`.
    pub fn put(&self, out: &mut Vec<u8>) {
        out.extend(MAGIC);
        out.extend(super::MAJOR.to_le_bytes());
        out.extend(self.minor.to_le_bytes());
        out.extend(self.head_length.to_le_bytes());
        out.extend(self.crc.to_le_bytes());
        out.extend(self.file_length.to_le_bytes());
        out.extend(self.incompat.to_le_bytes());
        out.extend(self.compat.to_le_bytes());
        out.extend([self.depths, self.streams, self.page_log2, self.topo_page_log2, self.cyclic, self.up]);
        out.extend(self.sections.to_le_bytes());
        out.extend(self.bounds.iter().flat_map(|v| v.to_le_bytes()));
        out.extend(self.metres_per_unit.to_le_bytes());
        out.extend(self.nodes.to_le_bytes());
        out.extend(self.content_id);
    }
}

/// One depth.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct DepthEntry {
    /// Number of nodes.
    pub nodes: u64,
    /// Nodes with a non-zero child mask.
    pub internal: u64,
    /// Byte of the file at which the depth's block starts.
    pub block_offset: u64,
    /// Byte of the file after the block: a prefix of this many bytes holds all depths up to this one.
    pub block_end: u64,
    /// SHA-256 of the decoded content.
    pub digest: [u8; 32],
}

impl DepthEntry {
    /// Read the record from its bytes, whose length the caller has checked.
    pub fn parse(bytes: &[u8]) -> DepthEntry {
        let mut f = Fields::new(bytes);
        DepthEntry { nodes: f.u64(), internal: f.u64(), block_offset: f.u64(), block_end: f.u64(), digest: f.take() }
    }

    /// Append the bytes of this record to `out`.
    pub fn put(&self, out: &mut Vec<u8>) {
        for v in [self.nodes, self.internal, self.block_offset, self.block_end] {
            out.extend(v.to_le_bytes());
        }
        out.extend(self.digest);
    }
}

/// One stream: a channel and how it is coded.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StreamEntry {
    /// Four letters that name the channel.
    pub semantic: [u8; 4],
    /// Components per voxel.
    pub components: u8,
    /// Bytes per component.
    pub component_bytes: u8,
    /// Largest code of the quantisation.
    pub quant_max: u16,
    /// Flags: a sum of [`StreamEntry::CRITICAL`], [`StreamEntry::FILTERABLE`] and [`StreamEntry::CONSTANT`].
    pub flags: u16,
    /// Reserved for later versions.
    pub reserved: u16,
    /// Largest absolute error that the quantisation makes.
    pub max_abs_error: f32,
    /// The codes of every voxel, where the flag [`StreamEntry::CONSTANT`] is set.
    pub constant: [u8; 8],
    /// Reserved for later versions.
    pub reserved_tail: [u8; 8],
}

impl StreamEntry {
    /// A reader that does not know the semantic refuses the file.
    pub const CRITICAL: u16 = 1;
    /// Averages of codes are meaningful.
    pub const FILTERABLE: u16 = 2;
    /// Every voxel has the same codes; there are no pages.
    pub const CONSTANT: u16 = 4;

    /// Whether every voxel has the same codes, so that there are no pages.
    pub fn is_constant(&self) -> bool {
        self.flags & Self::CONSTANT != 0
    }

    /// The channel, if this version knows it.
    pub fn channel(&self) -> Option<Channel> {
        Channel::from_semantic(self.semantic)
    }

    /// The entry of a channel, not critical; `constant`: the codes of every voxel, where they are the same.
    pub(super) fn of(channel: Channel, q_max: u8, constant: Option<&[u8]>) -> StreamEntry {
        let mut codes = [0; 8];
        codes.iter_mut().zip(constant.unwrap_or_default()).for_each(|(slot, &code)| *slot = code);
        StreamEntry {
            semantic: channel.semantic(),
            components: channel.components(q_max.into()) as u8,
            component_bytes: 1,
            quant_max: q_max.into(),
            flags: if constant.is_some() { Self::CONSTANT } else { 0 },
            max_abs_error: channel.max_abs_error(q_max),
            constant: codes,
            ..StreamEntry::default()
        }
    }

    /// Largest code of each component.
    pub fn maxima(&self) -> Vec<u8> {
        let q_max = self.quant_max.min(255) as u8;
        let most = |k| self.channel().map_or(q_max, |c| c.component_max(k, q_max));
        (0..usize::from(self.components)).map(most).collect()
    }

    /// Read the record from its bytes, whose length the caller has checked.
    pub fn parse(bytes: &[u8]) -> StreamEntry {
        let mut f = Fields::new(bytes);
        StreamEntry {
            semantic: f.take(),
            components: f.u8(),
            component_bytes: f.u8(),
            quant_max: f.u16(),
            flags: f.u16(),
            reserved: f.u16(),
            max_abs_error: f.f32(),
            constant: f.take(),
            reserved_tail: f.take(),
        }
    }

    /// Append the bytes of this record to `out`.
    pub fn put(&self, out: &mut Vec<u8>) {
        out.extend(self.semantic);
        out.extend([self.components, self.component_bytes]);
        out.extend(self.quant_max.to_le_bytes());
        out.extend(self.flags.to_le_bytes());
        out.extend(self.reserved.to_le_bytes());
        out.extend(self.max_abs_error.to_le_bytes());
        out.extend(self.constant);
        out.extend(self.reserved_tail);
    }
}

/// Kind of a section.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SectionKind {
    /// JSON that describes the texel.
    Meta,
    /// Child masks of the depth above.
    Topo,
    /// Codes of the voxels of a depth in a stream.
    Page,
    /// A type that this version does not know.
    Other([u8; 4]),
}

impl SectionKind {
    fn from_bytes(kind: [u8; 4]) -> Self {
        match &kind {
            b"META" => SectionKind::Meta,
            b"TOPO" => SectionKind::Topo,
            b"PAGE" => SectionKind::Page,
            _ => SectionKind::Other(kind),
        }
    }

    fn to_bytes(self) -> [u8; 4] {
        match self {
            SectionKind::Meta => *b"META",
            SectionKind::Topo => *b"TOPO",
            SectionKind::Page => *b"PAGE",
            SectionKind::Other(kind) => kind,
        }
    }
}

/// One section of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SectionEntry {
    /// Type of the section.
    pub kind: SectionKind,
    /// Flags: a sum of [`SectionEntry::CRITICAL`] and [`SectionEntry::SAFE_TO_COPY`].
    pub flags: u16,
    /// Depth of the section, or `NONE`.
    pub depth: u8,
    /// Index of the stream, or `NONE`.
    pub stream: u8,
    /// Byte of the file at which the section starts.
    pub offset: u64,
    /// Bytes in the file.
    pub length: u64,
    /// Bytes once decoded.
    pub decoded: u64,
    /// Number of pages.
    pub pages: u32,
    /// Checksum: of the body of META and unknown sections, of the index of TOPO and PAGE sections.
    pub crc: u32,
    /// Number of the codec.
    pub codec: u8,
    /// Number of the filter.
    pub filter: u8,
    /// Reserved for later versions.
    pub reserved: [u8; 6],
}

impl SectionEntry {
    /// A reader that does not know the type refuses the file.
    pub const CRITICAL: u16 = 1;
    /// An editor that does not know the type may copy it.
    pub const SAFE_TO_COPY: u16 = 2;

    /// Read the record from its bytes, whose length the caller has checked.
    pub fn parse(bytes: &[u8]) -> SectionEntry {
        let mut f = Fields::new(bytes);
        SectionEntry {
            kind: SectionKind::from_bytes(f.take()),
            flags: f.u16(),
            depth: f.u8(),
            stream: f.u8(),
            offset: f.u64(),
            length: f.u64(),
            decoded: f.u64(),
            pages: f.u32(),
            crc: f.u32(),
            codec: f.u8(),
            filter: f.u8(),
            reserved: f.take(),
        }
    }

    /// Append the bytes of this record to `out`.
    pub fn put(&self, out: &mut Vec<u8>) {
        out.extend(self.kind.to_bytes());
        out.extend(self.flags.to_le_bytes());
        out.extend([self.depth, self.stream]);
        for v in [self.offset, self.length, self.decoded] {
            out.extend(v.to_le_bytes());
        }
        out.extend(self.pages.to_le_bytes());
        out.extend(self.crc.to_le_bytes());
        out.extend([self.codec, self.filter]);
        out.extend(self.reserved);
    }

    /// Bytes of an index entry in this kind of section.
    pub fn ref_len(&self) -> usize {
        match self.kind {
            SectionKind::Topo => TOPO_REF_LEN,
            _ => PAGE_REF_LEN,
        }
    }

    /// Bytes of the index.
    pub fn index_len(&self) -> u64 {
        u64::from(self.pages) * self.ref_len() as u64
    }
}
