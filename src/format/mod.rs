//! What the bytes of a `.vtex` file are: a writer, a lazy reader, and the rules that both keep (`format-spec/vtex-1.md`).
//!
//! A file is a head (counts, streams, sections, META) and one block per depth, from coarse to fine. A block holds a section with the
//! child masks of the depth above, and one section of pages per stream. Every decoded size follows from the counts in the head.

mod atomic;
mod check;
pub mod codes;
mod filter;
mod head;
mod input;
mod layout;
mod material;
mod meta;
mod page;
mod reader;
mod stream;
#[cfg(test)]
mod tests;
mod truncate;
mod writer;

pub use atomic::{PART_NAME, PartFile, save};
pub use check::{Report, verify};
pub use head::Head;
pub use input::{open_file, read_file};
pub use layout::{DepthEntry, SectionEntry, SectionKind, StreamEntry};
pub use reader::Reader;
pub use stream::{Channel, Quality};
pub use truncate::truncate;
pub use writer::{WriteOptions, Written, write};

/// The first twelve bytes. They are no valid UTF-8, and any conversion of newlines changes them, so that a file that was treated as
/// text is noticed.
pub const MAGIC: [u8; 12] = *b"\xabVTEX 1\xbb\r\n\x1a\n";
/// Major version: a reader refuses any other.
pub const MAJOR: u16 = 1;
/// Minor version: a greater one only adds what a reader may ignore.
pub const MINOR: u16 = 0;

/// Most memory that a reader may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of decoded voxels and child masks, all depths together. The finest depths that do not fit are not opened.
    pub decoded_bytes: u64,
}

impl Default for Limits {
    /// 2 GiB.
    fn default() -> Self {
        Limits { decoded_bytes: 2 << 30 }
    }
}
