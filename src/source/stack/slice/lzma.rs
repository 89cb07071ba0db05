//! Pages that are packed by LZMA, which the TIFF decoder does not unpack: each is written anew, not packed, for the decoder.
//!
//! Each strip or tile is a stream of the format xz (method 34925, libtiff's own), mostly with a delta filter.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Read};

use lzma_rust2::XzReader;
use tiff::decoder::ChunkType;
use tiff::tags::{ByteOrder, Tag};

use super::check_memory;
use super::pages::{Layout, MAX_RATIO, Pages, broken};
use crate::{Error, Result};

/// Tags that say how samples lie in strips or tiles.
const LAYOUT: [Tag; 12] = [
    Tag::ImageWidth,
    Tag::ImageLength,
    Tag::BitsPerSample,
    Tag::PhotometricInterpretation,
    Tag::SamplesPerPixel,
    Tag::RowsPerStrip,
    Tag::PlanarConfiguration,
    Tag::Predictor,
    Tag::TileWidth,
    Tag::TileLength,
    Tag::ExtraSamples,
    Tag::SampleFormat,
];

impl Pages<'_> {
    /// The page at which the decoder stands as a BigTIFF of its own that is not packed; `taken` bytes of memory are spent besides.
    ///
    /// # Errors
    /// [`Error::Limit`] where that takes more memory than is allowed; [`Error::Input`] where a strip or tile is broken.
    pub(super) fn unpacked(&mut self, page: usize, layout: &Layout, taken: u64) -> Result<Vec<u8>> {
        let (path, wrong) = (self.path, broken(self.path, page));
        let input = |what: String| Error::input(path, format!("page {}", page + 1), what);
        let is_tiled = self.decoder.get_chunk_type() == ChunkType::Tile;
        let mut list = |tag| self.decoder.find_tag_unsigned_vec::<u64>(tag).map_err(&wrong);
        let mut short: BTreeMap<u16, Vec<u64>> = BTreeMap::new();
        for tag in LAYOUT {
            short.extend(list(tag)?.map(|values| (tag.to_u16(), values)));
        }
        let planar = short.get(&Tag::PlanarConfiguration.to_u16()).is_some_and(|v| v.first() == Some(&2));
        let [strips, tiles] = [[Tag::StripOffsets, Tag::StripByteCounts], [Tag::TileOffsets, Tag::TileByteCounts]];
        let [starts, counts] = if is_tiled { tiles } else { strips };
        let packed: Vec<(u64, u64)> =
            list(starts)?.unwrap_or_default().into_iter().zip(list(counts)?.unwrap_or_default()).collect();

        let (width, rows) = self.decoder.chunk_dimensions();
        let per_pixel = layout.bits as u64 * if planar { 1 } else { layout.channels as u64 };
        let row = u64::from(width).saturating_mul(per_pixel).div_ceil(8);
        let (height, rows) = (layout.height as u64, u64::from(rows).max(1));
        // Tiles are whole; the last strip of a plane ends with it.
        let rows_of = |k: u64| if is_tiled { rows } else { rows.min(height - k % height.div_ceil(rows) * rows) };
        let sizes: Vec<u64> = (0..packed.len() as u64).map(|k| row.saturating_mul(rows_of(k))).collect();
        let all = sizes.iter().fold(0u64, |sum, n| sum.saturating_add(*n));
        if all / MAX_RATIO as u64 > self.bytes.len() as u64 {
            return Err(input(format!("{} bytes cannot hold {all} bytes of strips or tiles", self.bytes.len())));
        }
        check_memory(self.choice, path, taken.saturating_add(all))?;
        // What is left is for the dictionary of one strip at a time.
        let left = (self.choice.memory - taken - all) / 1024;
        let most = u32::try_from(left).unwrap_or(u32::MAX - 1).min(u32::MAX - 1);

        let mut file = Writer::new(self.decoder.byte_order());
        let mut offsets = Vec::with_capacity(packed.len());
        for (k, ((start, count), size)) in packed.iter().zip(&sizes).enumerate() {
            let end = start.saturating_add(*count).min(self.bytes.len() as u64);
            let stream = self.bytes.get(*start as usize..end as usize).unwrap_or_default();
            offsets.push(file.out.len() as u64);
            let from = file.out.len();
            file.out.resize(from + *size as usize, 0);
            let done = XzReader::new_mem_limit(stream, false, most).read_exact(&mut file.out[from..]);
            done.map_err(|e| {
                let what = match e.kind() {
                    ErrorKind::OutOfMemory => "takes more memory than is allowed".to_owned(),
                    ErrorKind::UnexpectedEof => "ends too early".to_owned(),
                    _ => format!("is broken: {e}"),
                };
                input(format!("strip or tile {}, packed by LZMA, {what}", k + 1))
            })?;
        }
        let long = BTreeMap::from([(starts.to_u16(), offsets), (counts.to_u16(), sizes)]);
        Ok(file.finish(&short, &long))
    }
}

/// A BigTIFF of one page.
struct Writer {
    big_endian: bool,
    out: Vec<u8>,
}

impl Writer {
    const SHORT: u64 = 3;
    const LONG8: u64 = 16;

    fn new(order: ByteOrder) -> Writer {
        let big_endian = order == ByteOrder::BigEndian;
        let mut file = Writer { big_endian, out: if big_endian { b"MM".to_vec() } else { b"II".to_vec() } };
        // Version, bytes of an offset, and the offset of the page's tags, which is not known yet.
        [43, 8, 0].into_iter().for_each(|v| file.number(v, 2));
        file.number(0, 8);
        file
    }

    /// The lowest `width` bytes of a number.
    fn number(&mut self, value: u64, width: usize) {
        if self.big_endian {
            self.out.extend_from_slice(&value.to_be_bytes()[8 - width..]);
        } else {
            self.out.extend_from_slice(&value.to_le_bytes()[..width]);
        }
    }

    /// The file with its tags; those that are `short` have 16 bits where all of their values have.
    fn finish(mut self, short: &BTreeMap<u16, Vec<u64>>, long: &BTreeMap<u16, Vec<u64>>) -> Vec<u8> {
        let fits = |list: &[u64]| list.iter().all(|v| *v <= u64::from(u16::MAX));
        let mut entries = BTreeMap::new();
        for (tag, list) in short.iter().chain(long) {
            let (kind, width) = if short.contains_key(tag) && fits(list) { (Self::SHORT, 2) } else { (Self::LONG8, 8) };
            let at = self.out.len();
            list.iter().for_each(|v| self.number(*v, width));
            // A few values stand in the entry itself.
            let value = if self.out.len() - at <= 8 { Err(self.out.split_off(at)) } else { Ok(at as u64) };
            entries.insert(*tag, (kind, list.len() as u64, value));
        }
        let at = self.out.len();
        self.number(entries.len() as u64, 8);
        for (tag, (kind, count, value)) in entries {
            self.number(tag.into(), 2);
            self.number(kind, 2);
            self.number(count, 8);
            match value {
                Ok(offset) => self.number(offset, 8),
                Err(mut bytes) => {
                    bytes.resize(8, 0);
                    self.out.extend(bytes);
                }
            }
        }
        self.number(0, 8);
        let offset = if self.big_endian { (at as u64).to_be_bytes() } else { (at as u64).to_le_bytes() };
        self.out[8..16].copy_from_slice(&offset);
        self.out
    }
}
