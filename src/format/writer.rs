//! Writer of files: the voxels' codes are quantised, filtered and compressed page by page, depth by depth; the head is written last,
//! into the room that was left for it.

use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

use sha2::{Digest, Sha256};

use super::filter;
use super::head::{Head, align8};
use super::layout::{DepthEntry, Header, NONE, SectionEntry, SectionKind, StreamEntry};
use super::page;
use super::stream::Quantiser;
use super::{Channel, PartFile, Quality, material, meta};
use crate::volume::{Depth, MAX_DEPTH, Volume, Voxel};
use crate::{Error, Result, par};

/// log2 of the voxels in a page that this writer makes.
pub(super) const PAGE_LOG2: u8 = 12;
/// log2 of the child masks in a page.
pub(super) const TOPO_PAGE_LOG2: u8 = 14;
/// Pages of a section on which the filters are tried, and the level of that trial.
const TRIAL_PAGES: usize = 6;
const TRIAL_LEVEL: i32 = 3;
/// Levels of compression that are then tried with the best filter, besides the one that was asked for and below it.
const TRIAL_LEVELS: [i32; 3] = [4, 7, 11];
/// A slower level is used if it saves at least one byte in so many. Codes that never repeat gain nothing by a longer search, and those
/// of small alphabets may even become longer.
const MIN_GAIN: usize = 32;

/// Options of writing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WriteOptions {
    /// Highest level of zstd that is used, 1 (quick) to 19 (small).
    pub level: i32,
    /// Precision of the codes in the file.
    pub quality: Quality,
}

impl Default for WriteOptions {
    fn default() -> Self {
        // From level 12 on each level makes a bake several per cent slower.
        WriteOptions { level: 11, quality: Quality::Full }
    }
}

/// Report of what was written.
#[derive(Debug, Clone, PartialEq)]
pub struct Written {
    /// Bytes of the file.
    pub file_bytes: u64,
    /// Number of nodes of the finest depth.
    pub finest_voxels: u64,
    /// Identifier of the content.
    pub content_id: [u8; 16],
    /// Bytes of each depth's block.
    pub depths: Vec<u64>,
    /// Bytes of each channel over all depths; first the topology.
    pub channels: Vec<(&'static str, u64)>,
}

/// Write `volume` to `path`, which appears when it is complete or not at all. The bytes depend on the volume and the options alone.
///
/// # Errors
/// [`Error::Io`]; [`Error::Options`] for a level outside 1 to 19, and for a volume whose masks, counts or description contradict each
/// other.
pub fn write(volume: &Volume, path: impl AsRef<Path>, options: &WriteOptions) -> Result<Written> {
    if !(1..=19).contains(&options.level) {
        return Err(Error::Options(format!("compression level {} is not in 1..=19", options.level)));
    }
    let internal = check(volume)?;
    let encoder = Encoder::new(volume, options);
    let mut head = blank_head(volume, encoder.streams())?;
    let mut out = PartFile::create(path.as_ref())?;
    let io = |e| Error::io(path.as_ref(), e);
    out.write_all(&vec![0; head.header.head_length as usize]).map_err(io)?;
    let mut at = u64::from(head.header.head_length);
    for (d, depth) in volume.depths.iter().enumerate() {
        let block = encoder.block(d, &head.streams);
        let entry = &mut head.depths[d];
        entry.block_offset = align8(at);
        for (mut section, body) in block.sections {
            section.offset = align8(at);
            out.write_all(&[0; 8][..(section.offset - at) as usize]).map_err(io)?;
            out.write_all(&body).map_err(io)?;
            at = section.offset + section.length;
            head.sections.push(section);
        }
        entry.nodes = depth.voxels.len() as u64;
        entry.internal = internal[d];
        entry.block_end = at.max(entry.block_offset);
        entry.digest = block.digest;
    }
    if volume.depths.is_empty() {
        let entry = &mut head.depths[0];
        (entry.block_offset, entry.block_end, entry.digest) = (at, at, Sha256::digest([]).into());
    }
    head.header.file_length = at;
    head.header.nodes = head.depths.iter().map(|d| d.nodes).sum();
    let bytes = head.encode();
    // The head is checked by the reader's own rules: what a reader would refuse is not written.
    Head::parse(&bytes)
        .map_err(|broken| Error::Options(format!("the volume cannot be written: {} [{}]", broken.what, broken.code)))?;
    out.seek(SeekFrom::Start(0)).map_err(io)?;
    out.write_all(&bytes).map_err(io)?;
    out.finish()?;
    Ok(Written {
        file_bytes: at,
        finest_voxels: head.depths.last().map_or(0, |d| d.nodes),
        content_id: head.header.content_id,
        depths: head.depth_sizes(),
        channels: head.channel_sizes(),
    })
}

/// Section entry without its offset, and the section's bytes.
type Section = (SectionEntry, Vec<u8>);

/// Encoded block of one depth.
struct EncodedBlock {
    /// Sections in the order of the file.
    sections: Vec<Section>,
    /// SHA-256 of the decoded content.
    digest: [u8; 32],
}

/// Encoder of a volume's depths.
struct Encoder<'v> {
    volume: &'v Volume,
    quantiser: Quantiser,
    mixes: material::MixCoding,
    /// Highest level of compression.
    level: i32,
}

impl<'v> Encoder<'v> {
    fn new(volume: &'v Volume, options: &WriteOptions) -> Encoder<'v> {
        Encoder {
            volume,
            quantiser: Quantiser::fitting(volume, options.quality),
            mixes: material::MixCoding::new(&volume.info.materials),
            level: options.level,
        }
    }

    /// Entries of all streams: those of the voxels, then that of the mixes of materials.
    fn streams(&self) -> Vec<StreamEntry> {
        let mut streams = self.quantiser.entries(&self.quantiser.constants(self.volume));
        streams.extend(material_stream(self.volume, &|d| self.mix_codes(d)));
        streams
    }

    /// Codes of the mixes of the depth `d`, voxel by voxel.
    fn mix_codes(&self, d: usize) -> Vec<u8> {
        let Depth { voxels, mixes, .. } = &self.volume.depths[d];
        self.mixes.codes(mixes, |i| self.quantiser.albedo(&voxels[i]))
    }

    /// Block of the depth `d`, where `streams` are those of [`Encoder::streams`].
    fn block(&self, d: usize, streams: &[StreamEntry]) -> EncodedBlock {
        let mut digest = Sha256::new();
        let mut sections = Vec::new();
        if d > 0 {
            let masks = &self.volume.depths[d - 1].masks;
            digest.update(masks);
            sections.push(topo_section(masks, d as u8, self.level));
        }
        let voxels = par_chunks(&self.volume.depths[d].voxels, |v| self.quantiser.quantise(v));
        for (s, stream) in streams.iter().enumerate().filter(|(_, stream)| !stream.is_constant()) {
            let is_mixes = stream.channel() == Some(Channel::Material);
            let codes = if is_mixes { self.mix_codes(d) } else { self.quantiser.codes(s, &voxels) };
            digest.update(&codes);
            let mut section = page_section(&codes, &stream.maxima(), self.level);
            (section.0.depth, section.0.stream) = (d as u8, s as u8);
            sections.push(section);
        }
        EncodedBlock { sections, digest: digest.finalize().into() }
    }
}

/// Head of a file of `volume` with these `streams`. Its length is final; the depths' entries are blank, and META is its only section.
fn blank_head(volume: &Volume, streams: Vec<StreamEntry>) -> Result<Head> {
    let mut head = Head {
        header: blank_header(volume, streams.len()),
        depths: vec![DepthEntry::default(); volume.depths.len().max(1)],
        streams,
        sections: Vec::new(),
        info: volume.info.clone(),
        meta: meta::encode(&volume.info)?,
    };
    head.header.sections = head.expected().len() as u16;
    let tables_end = head.header.tables_end() as u64;
    head.header.head_length = align8(tables_end + head.meta.len() as u64) as u32;
    head.sections.push(meta_section(&head.meta, tables_end));
    Ok(head)
}

/// Check that the masks, counts and bounds of a volume agree. Returns the number of nodes with children of each depth.
fn check(volume: &Volume) -> Result<Vec<u64>> {
    let bad = |d: usize, what: &str| Err(Error::Options(format!("the volume's depth {d} {what}")));
    if volume.depths.len() > MAX_DEPTH + 1 {
        return bad(MAX_DEPTH + 1, "is deeper than a file holds");
    }
    let mut children = volume.depths.first().map_or(0, |d| d.voxels.len().min(1));
    let mut internal = Vec::new();
    for (d, Depth { masks, voxels, mixes }) in volume.depths.iter().enumerate() {
        if masks.len() != voxels.len() || voxels.len() != children || voxels.len() >= u32::MAX as usize {
            return bad(d, "has another number of nodes than its masks or the depth above say");
        }
        let mixed = if volume.info.materials.len() > 1 { voxels.len() } else { 0 };
        if mixes.len() != mixed {
            return bad(
                d,
                "has another number of mixes of materials than of nodes, or some where there is one material",
            );
        }
        children = masks.iter().map(|m| m.count_ones() as usize).sum();
        internal.push(masks.iter().filter(|&&m| m != 0).count() as u64);
    }
    if children != 0 {
        return bad(volume.depths.len() - 1, "is the finest and has children");
    }
    let b = &volume.info.bounds;
    if b.is_empty() || !b.min.is_finite() || !b.max.is_finite() || !volume.info.metres_per_unit.is_finite() {
        return Err(Error::Options("the volume's bounds are empty or not finite".into()));
    }
    Ok(internal)
}

/// Entry of the stream of mixes, if the texel has several materials; `codes` gives the codes of the mixes of a depth.
fn material_stream(volume: &Volume, codes: &dyn Fn(usize) -> Vec<u8>) -> Option<StreamEntry> {
    let count = volume.info.materials.len();
    let q_max = u8::try_from(count.checked_sub(1)?).ok().filter(|&q| q > 0)?;
    let components = material::components(count);
    let mut first = if volume.depths.is_empty() { Vec::new() } else { codes(0) };
    first.resize(components, 0);
    let same = (0..volume.depths.len()).all(|d| codes(d).chunks_exact(components).all(|c| *c == first));
    Some(StreamEntry::of(Channel::Material, q_max, same.then_some(&first[..])))
}

fn blank_header(volume: &Volume, streams: usize) -> Header {
    let info = &volume.info;
    let (min, max) = (info.bounds.min.to_array(), info.bounds.max.to_array());
    Header {
        minor: super::MINOR,
        depths: volume.depths.len().max(1) as u8,
        streams: streams as u8,
        page_log2: PAGE_LOG2,
        topo_page_log2: TOPO_PAGE_LOG2,
        cyclic: (0..3).map(|k| u8::from(info.cyclic[k]) << k).sum(),
        up: info.up,
        bounds: [min[0], min[1], min[2], max[0], max[1], max[2]],
        metres_per_unit: info.metres_per_unit,
        ..Header::default()
    }
}

fn meta_section(meta: &[u8], offset: u64) -> SectionEntry {
    SectionEntry {
        kind: SectionKind::Meta,
        flags: SectionEntry::CRITICAL,
        depth: NONE,
        stream: NONE,
        offset,
        length: meta.len() as u64,
        decoded: meta.len() as u64,
        pages: 0,
        crc: crc32fast::hash(meta),
        codec: 0,
        filter: 0,
        reserved: [0; 6],
    }
}

/// Section of the child masks of the depth above `depth`; its offset in the file is not set yet.
fn topo_section(masks: &[u8], depth: u8, level: i32) -> Section {
    let pages: Vec<&[u8]> = masks.chunks(1 << TOPO_PAGE_LOG2).collect();
    let mut children = 0;
    let first_child: Vec<u64> = pages
        .iter()
        .map(|page| {
            let first = children;
            children += page.iter().map(|m| u64::from(m.count_ones())).sum::<u64>();
            first
        })
        .collect();
    let pages = par::map(pages.len(), |i| page::compress(level, pages[i].to_vec()));
    let mut section = paged_section(SectionKind::Topo, masks.len(), filter::INTERLEAVED, &pages, &first_child);
    section.0.depth = depth;
    section
}

/// Section of the codes of one depth and stream, whose component k is at most `most[k]`; its depth, stream and offset are not set yet.
/// Filter and level are those that compress a few sample pages best.
fn page_section(codes: &[u8], most: &[u8], level: i32) -> Section {
    let pages: Vec<&[u8]> = codes.chunks(most.len() << PAGE_LOG2).collect();
    let trials: Vec<&[u8]> = (0..pages.len().min(TRIAL_PAGES))
        .filter_map(|i| pages.get(i * pages.len() / pages.len().min(TRIAL_PAGES)).copied())
        .collect();
    let filters: Vec<u8> = (0..filter::COUNT).collect();
    let costs = compressed_sizes(&trials, &filters, |page, &filter| {
        page::compress(TRIAL_LEVEL.min(level), filter::forward(filter, page, most))
    });
    let best = (0..filter::COUNT).min_by_key(|&f| costs[usize::from(f)]).unwrap_or(filter::INTERLEAVED);
    let levels: Vec<i32> = TRIAL_LEVELS.into_iter().filter(|&l| l < level).chain([level]).collect();
    let costs =
        compressed_sizes(&trials, &levels, |page, &level| page::compress(level, filter::forward(best, page, most)));
    let slower =
        |best: usize, next: usize| if (MIN_GAIN - 1) * costs[best] >= MIN_GAIN * costs[next] { next } else { best };
    let level = levels[(0..levels.len()).fold(0, slower)];
    let pages = par::map(pages.len(), |i| page::compress(level, filter::forward(best, pages[i], most)));
    paged_section(SectionKind::Page, codes.len(), best, &pages, &[])
}

/// Total number of bytes of all `pages` after `compress`, for each of its `settings`.
fn compressed_sizes<T: Sync>(
    pages: &[&[u8]],
    settings: &[T],
    compress: impl Fn(&[u8], &T) -> Vec<u8> + Sync,
) -> Vec<usize> {
    let n = settings.len();
    let lengths = par::map(pages.len() * n, |i| compress(pages[i / n], &settings[i % n]).len());
    (0..n).map(|i| lengths.iter().skip(i).step_by(n).sum()).collect()
}

fn paged_section(kind: SectionKind, decoded: usize, filter: u8, pages: &[Vec<u8>], first_child: &[u64]) -> Section {
    let (body, crc) = page::put_section(kind, pages, first_child);
    let section = SectionEntry {
        kind,
        flags: SectionEntry::CRITICAL,
        depth: NONE,
        stream: NONE,
        offset: 0,
        length: body.len() as u64,
        decoded: decoded as u64,
        pages: pages.len() as u32,
        crc,
        codec: page::ZSTD,
        filter,
        reserved: [0; 6],
    };
    (section, body)
}

/// Values of `f` for all voxels, in order, computed by all threads.
fn par_chunks(voxels: &[Voxel], f: impl Fn(&Voxel) -> Voxel + Sync + Send) -> Vec<Voxel> {
    let mut out = voxels.to_vec();
    par::chunks_mut(&mut out, 1 << PAGE_LOG2, |_, chunk| chunk.iter_mut().for_each(|v| *v = f(v)));
    out
}
