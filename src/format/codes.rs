//! Names of the rules that a reader checks; `format-spec/codes` says each in a line.

use std::path::Path;

use crate::Error;

pub const MAGIC: &str = "magic";
pub const VERSION: &str = "version";
pub const FLAGS: &str = "flags";
pub const HEAD_LENGTH: &str = "head-length";
pub const HEAD_CRC: &str = "head-crc";
pub const FILE_LENGTH: &str = "file-length";
pub const RANGE: &str = "range";
pub const RESERVED: &str = "reserved";
pub const FLOAT: &str = "float";
pub const COUNTS: &str = "counts";
pub const CONTENT_ID: &str = "content-id";
pub const STREAM: &str = "stream";
pub const STREAM_CRITICAL: &str = "stream-critical";
pub const SECTION_ORDER: &str = "section-order";
pub const SECTION_PLACE: &str = "section-place";
pub const SECTION_SIZE: &str = "section-size";
pub const SECTION_CODEC: &str = "section-codec";
pub const SECTION_CRITICAL: &str = "section-critical";
pub const BLOCK: &str = "block";
pub const PADDING: &str = "padding";
pub const META_CRC: &str = "meta-crc";
pub const META_JSON: &str = "meta-json";
pub const INDEX_CRC: &str = "index-crc";
pub const INDEX_PLACE: &str = "index-place";
pub const PAGE_CRC: &str = "page-crc";
pub const PAGE_FRAME: &str = "page-frame";
pub const PAGE_VALUE: &str = "page-value";
pub const TOPOLOGY: &str = "topology";
pub const DIGEST: &str = "digest";

/// Every code, in the order of the checks.
pub const ALL: [&str; 29] = [
    MAGIC,
    VERSION,
    HEAD_LENGTH,
    HEAD_CRC,
    FLAGS,
    RANGE,
    RESERVED,
    FLOAT,
    COUNTS,
    STREAM,
    STREAM_CRITICAL,
    CONTENT_ID,
    SECTION_CRITICAL,
    SECTION_ORDER,
    SECTION_PLACE,
    SECTION_SIZE,
    SECTION_CODEC,
    BLOCK,
    FILE_LENGTH,
    META_CRC,
    META_JSON,
    PADDING,
    INDEX_CRC,
    INDEX_PLACE,
    PAGE_CRC,
    PAGE_FRAME,
    PAGE_VALUE,
    TOPOLOGY,
    DIGEST,
];

/// A rule that a file breaks, before the file's name is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Broken {
    pub code: &'static str,
    pub offset: u64,
    pub what: String,
}

impl Broken {
    pub fn at(self, path: &Path) -> Error {
        Error::Format { path: path.to_path_buf(), code: self.code, offset: self.offset, what: self.what }
    }
}

/// `Err` unless `holds`.
pub(super) fn require(
    holds: bool,
    code: &'static str,
    offset: u64,
    what: impl FnOnce() -> String,
) -> Result<(), Broken> {
    if holds { Ok(()) } else { Err(Broken { code, offset, what: what() }) }
}
