//! Volume → file: requantise, filter, compress page by page, and put the head in front.

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
/// Levels that are then tried with the best filter, up to the one that is asked for; a slower one has to save one byte in
/// `WORTH`. Codes that never repeat gain nothing by a longer search, and those of small alphabets may even lose.
const LEVELS: [i32; 3] = [4, 7, 11];
const WORTH: usize = 32;

/// Options of writing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WriteOptions {
    /// zstd's level, 1 (quick) to 19 (small); lower where that saves next to nothing.
    pub level: i32,
    /// Precision of the codes in the file.
    pub quality: Quality,
}

impl Default for WriteOptions {
    fn default() -> Self {
        // From the level 12 on each costs a bake several per cent of its time.
        WriteOptions { level: 11, quality: Quality::Full }
    }
}

/// Report of what was written.
#[derive(Debug, Clone, PartialEq)]
pub struct Written {
    /// Bytes of the file.
    pub file_bytes: u64,
    /// Nodes of the finest depth.
    pub finest_voxels: u64,
    /// Identifier of the content.
    pub content_id: [u8; 16],
    /// Bytes of each depth's block.
    pub depths: Vec<u64>,
    /// Bytes of each channel over all depths; first the topology.
    pub channels: Vec<(&'static str, u64)>,
}

/// Write `volume` to `path`: whole or not at all. The bytes depend on the volume and the options alone.
///
/// Errors: [`Error::Io`]; [`Error::Options`] for a level outside 1 ..= 19, or a volume whose masks, counts or description
/// contradict each other.
pub fn write(volume: &Volume, path: impl AsRef<Path>, options: &WriteOptions) -> Result<Written> {
    if !(1..=19).contains(&options.level) {
        return Err(Error::Options(format!("compression level {} is not in 1..=19", options.level)));
    }
    let internal = check(volume)?;
    let quantiser = Quantiser::fitting(volume, options.quality);
    let constants = quantiser.constants(volume);
    let mut streams: Vec<StreamEntry> = quantiser.entries(&constants);
    let voxel_streams = streams.len();
    let coding = material::Coding::new(&volume.info.materials);
    let mixes = |d: usize| {
        let Depth { voxels, mixes, .. } = &volume.depths[d];
        coding.codes(mixes, |i| quantiser.albedo(&voxels[i]))
    };
    streams.extend(material_stream(volume, &mixes));
    let header = blank_header(volume, streams.len());
    let mut head = Head {
        header,
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

    let mut out = PartFile::create(path.as_ref())?;
    let io = |e| Error::io(path.as_ref(), e);
    out.write_all(&vec![0; head.header.head_length as usize]).map_err(io)?;
    let mut at = u64::from(head.header.head_length);
    for (d, depth) in volume.depths.iter().enumerate() {
        let mut digest = Sha256::new();
        let mut bodies = Vec::new();
        if d > 0 {
            let masks = &volume.depths[d - 1].masks;
            digest.update(masks);
            bodies.push(topo_section(masks, d as u8, options.level));
        }
        let voxels = par_chunks(&depth.voxels, |v| quantiser.quantise(v));
        for s in 0..head.streams.len() {
            if head.streams[s].is_constant() {
                continue;
            }
            let codes = if s < voxel_streams { quantiser.codes(s, &voxels) } else { mixes(d) };
            digest.update(&codes);
            let mut body = page_section(&codes, &head.streams[s].maxima(), options.level);
            (body.0.depth, body.0.stream) = (d as u8, s as u8);
            bodies.push(body);
        }
        let entry = &mut head.depths[d];
        entry.block_offset = align8(at);
        for (mut section, body) in bodies {
            section.offset = align8(at);
            out.write_all(&[0; 8][..(section.offset - at) as usize]).map_err(io)?;
            out.write_all(&body).map_err(io)?;
            at = section.offset + section.length;
            head.sections.push(section);
        }
        entry.nodes = depth.voxels.len() as u64;
        entry.internal = internal[d];
        entry.block_end = at.max(entry.block_offset);
        entry.digest = digest.finalize().into();
    }
    if volume.depths.is_empty() {
        let entry = &mut head.depths[0];
        (entry.block_offset, entry.block_end, entry.digest) = (at, at, Sha256::digest([]).into());
    }
    head.header.file_length = at;
    head.header.nodes = head.depths.iter().map(|d| d.nodes).sum();
    let bytes = head.encode();
    // The rules are the reader's own: what it would refuse is not written.
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

/// Nodes with children at each depth, after checking that the volume is a tree.
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

/// The stream of materials, where there are any to tell apart; `codes` are those of a depth.
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

/// The child masks of the depth above as a section, to be placed.
fn topo_section(masks: &[u8], depth: u8, level: i32) -> (SectionEntry, Vec<u8>) {
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

/// Codes of one depth and stream as a section, to be placed.
fn page_section(codes: &[u8], most: &[u8], level: i32) -> (SectionEntry, Vec<u8>) {
    let pages: Vec<&[u8]> = codes.chunks(most.len() << PAGE_LOG2).collect();
    let trials: Vec<&[u8]> = (0..pages.len().min(TRIAL_PAGES))
        .filter_map(|i| pages.get(i * pages.len() / pages.len().min(TRIAL_PAGES)).copied())
        .collect();
    let filters: Vec<u8> = (0..filter::COUNT).collect();
    let costs = tried(&trials, &filters, |page, &filter| {
        page::compress(TRIAL_LEVEL.min(level), filter::forward(filter, page, most))
    });
    let best = (0..filter::COUNT).min_by_key(|&f| costs[usize::from(f)]).unwrap_or(filter::INTERLEAVED);
    let levels: Vec<i32> = LEVELS.into_iter().filter(|&l| l < level).chain([level]).collect();
    let costs = tried(&trials, &levels, |page, &level| page::compress(level, filter::forward(best, page, most)));
    let slower = |best: usize, next: usize| if (WORTH - 1) * costs[best] >= WORTH * costs[next] { next } else { best };
    let level = levels[(0..levels.len()).fold(0, slower)];
    let pages = par::map(pages.len(), |i| page::compress(level, filter::forward(best, pages[i], most)));
    paged_section(SectionKind::Page, codes.len(), best, &pages, &[])
}

/// Bytes of all `pages`, as `made` with each of the `ways`.
fn tried<T: Sync>(pages: &[&[u8]], ways: &[T], made: impl Fn(&[u8], &T) -> Vec<u8> + Sync) -> Vec<usize> {
    let lengths = par::map(pages.len() * ways.len(), |i| made(pages[i / ways.len()], &ways[i % ways.len()]).len());
    (0..ways.len()).map(|way| lengths.iter().skip(way).step_by(ways.len()).sum()).collect()
}

fn paged_section(
    kind: SectionKind,
    decoded: usize,
    filter: u8,
    pages: &[Vec<u8>],
    first_child: &[u64],
) -> (SectionEntry, Vec<u8>) {
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

/// `f` of every voxel, in order, over all threads.
fn par_chunks(voxels: &[Voxel], f: impl Fn(&Voxel) -> Voxel + Sync + Send) -> Vec<Voxel> {
    let mut out = voxels.to_vec();
    par::chunks_mut(&mut out, 1 << PAGE_LOG2, |_, chunk| chunk.iter_mut().for_each(|v| *v = f(v)));
    out
}
