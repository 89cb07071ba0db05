//! Codes of the rules that a reader checks. `format-spec/codes` explains each in a line.

use std::path::Path;

use crate::Error;

/// Code of a file that does not start with the magic bytes.
pub const MAGIC: &str = "magic";
/// Code of a major version that this reader does not know.
pub const VERSION: &str = "version";
/// Code of the rule on the feature flags of the header.
pub const FLAGS: &str = "flags";
/// Code of the rule on the head's length.
pub const HEAD_LENGTH: &str = "head-length";
/// Code of the rule on the head's checksum.
pub const HEAD_CRC: &str = "head-crc";
/// Code of the rule on the file's length.
pub const FILE_LENGTH: &str = "file-length";
/// Code of a field that is outside of its range.
pub const RANGE: &str = "range";
/// Code of a reserved field that is not zero.
pub const RESERVED: &str = "reserved";
/// Code of the rule on floating-point fields.
pub const FLOAT: &str = "float";
/// Code of the rule on numbers of nodes.
pub const COUNTS: &str = "counts";
/// Code of the rule on the content identifier.
pub const CONTENT_ID: &str = "content-id";
/// Code of the rule on entries of streams.
pub const STREAM: &str = "stream";
/// Code of a critical stream that this reader does not know.
pub const STREAM_CRITICAL: &str = "stream-critical";
/// Code of the rule on the order of sections.
pub const SECTION_ORDER: &str = "section-order";
/// Code of the rule on the places of sections in the file.
pub const SECTION_PLACE: &str = "section-place";
/// Code of the rule on the sizes of sections.
pub const SECTION_SIZE: &str = "section-size";
/// Code of the rule on the codec and filter of a section.
pub const SECTION_CODEC: &str = "section-codec";
/// Code of a critical section that this reader does not know.
pub const SECTION_CRITICAL: &str = "section-critical";
/// Code of the rule on the extents of the depths' blocks.
pub const BLOCK: &str = "block";
/// Code of the rule on padding bytes.
pub const PADDING: &str = "padding";
/// Code of the rule on META's checksum.
pub const META_CRC: &str = "meta-crc";
/// Code of the rule on META's JSON.
pub const META_JSON: &str = "meta-json";
/// Code of the rule on the checksum of a section's index of pages.
pub const INDEX_CRC: &str = "index-crc";
/// Code of the rule on the places of pages that an index lists.
pub const INDEX_PLACE: &str = "index-place";
/// Code of the rule on a page's checksum.
pub const PAGE_CRC: &str = "page-crc";
/// Code of the rule on a page's compressed frame.
pub const PAGE_FRAME: &str = "page-frame";
/// Code of the rule on the values in a page.
pub const PAGE_VALUE: &str = "page-value";
/// Code of the rule on child masks.
pub const TOPOLOGY: &str = "topology";
/// Code of the rule on a depth's digest.
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
pub(super) struct Violation {
    /// Code of the rule, one of [`ALL`].
    pub code: &'static str,
    /// Byte of the file at which the rule is broken.
    pub offset: u64,
    /// Explanation for people.
    pub what: String,
}

impl Violation {
    /// Turn this into an error of the file `path`.
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
) -> Result<(), Violation> {
    if holds { Ok(()) } else { Err(Violation { code, offset, what: what() }) }
}
