//! Tests of the parts together: round trips, hostile files, one broken file for every code.

use proptest::prelude::*;

use super::*;
use crate::Error;
use crate::geom::{Aabb, DVec3};
use crate::random::SplitMix64;
use crate::volume::octree::Pages;
use crate::volume::{Channels, Depth, Info, Volume, Voxel};

/// Voxels of any codes, the same everywhere.
pub struct Dice(SplitMix64);

impl Dice {
    pub fn new(seed: u64) -> Dice {
        Dice(SplitMix64::new(seed))
    }

    pub fn next(&mut self) -> u64 {
        self.0.bits()
    }
    fn byte(&mut self) -> u8 {
        self.next() as u8
    }
    fn voxel(&mut self) -> Voxel {
        let mut v = Voxel {
            rate: self.byte(),
            correlation: self.byte(),
            ndf: std::array::from_fn(|_| self.byte()),
            support: std::array::from_fn(|_| self.byte() & 0x77),
            albedo: std::array::from_fn(|_| self.byte()),
            mean_normal: std::array::from_fn(|_| self.byte()),
        };
        v.ndf[self.next() as usize % 3] = 255;
        v
    }
}

pub fn info(channels: Channels) -> Info {
    let mut meta = serde_json::Map::new();
    meta.insert("generator".into(), "a test".into());
    meta.insert("error".into(), serde_json::json!({ "mean": 0.25 }));
    Info {
        bounds: Aabb::new(DVec3::new(-1.5, 0.0, 2.0), DVec3::new(1.5, 3.0, 5.0)),
        cyclic: [true, false, false],
        content: Aabb::new(DVec3::splat(0.1), DVec3::splat(0.9)),
        facet_size: 0.02,
        channels,
        meta,
        ..Info::default()
    }
}

pub const ALL_CHANNELS: Channels = Channels { correlation: true, support: true, albedo: true, mean_normal: true };

/// A tree of `depths` depths whose nodes have about 4 children, none with a chance of 1 in 16.
pub fn volume(seed: u64, depths: usize, channels: Channels) -> Volume {
    let mut dice = Dice::new(seed);
    let mut out = Vec::new();
    let mut nodes = 1usize;
    for d in 0..depths {
        let finest = d + 1 == depths;
        let masks: Vec<u8> = (0..nodes)
            .map(|_| match dice.next() {
                r if finest || r % 16 == 0 => 0,
                r => (1 << (r >> 8 & 7)) | (r >> 16 & r >> 24 | r >> 32 & r >> 40) as u8,
            })
            .collect();
        let voxels = (0..nodes).map(|_| dice.voxel()).collect();
        nodes = masks.iter().map(|m| m.count_ones() as usize).sum();
        out.push(Depth { masks, voxels, mixes: Vec::new() });
    }
    Volume { info: info(channels), depths: out }
}

pub fn written(volume: &Volume, quality: Quality) -> (tempfile::TempDir, std::path::PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("t.vtex");
    write(volume, &path, &WriteOptions { level: 3, quality }).unwrap();
    (dir, path)
}

pub fn quantised(volume: &Volume, quality: Quality) -> Volume {
    let quantiser = stream::Quantiser::new(&volume.info.channels, quality);
    let mut out = volume.clone();
    out.depths.iter_mut().flat_map(|d| &mut d.voxels).for_each(|v| *v = quantiser.quantise(v));
    out
}

#[test]
fn write_then_read_is_the_requantised_volume() {
    for quality in [Quality::Full, Quality::Lean] {
        for channels in [ALL_CHANNELS, Channels::default(), Channels { support: true, ..Channels::default() }] {
            let volume = volume(7, 9, channels);
            assert!(volume.depths[8].voxels.len() > 4 * 4096);
            let (_dir, path) = written(&volume, quality);
            let reader = Reader::open(&path, &Limits::default()).unwrap();
            assert!(reader.bytes_read() < 8192);
            let back = reader.read_all().unwrap();
            assert_eq!(back, quantised(&volume, quality));
            // Quantised once, nothing changes: the second file holds the same content.
            let (_dir2, path2) = written(&back, quality);
            assert_eq!(std::fs::read(&path).unwrap(), std::fs::read(path2).unwrap());
            verify(&path).unwrap();
        }
    }
}

#[test]
fn only_what_is_asked_for_is_read() {
    let (_dir, path) = written(&volume(3, 8, ALL_CHANNELS), Quality::Full);
    let reader = Reader::open(&path, &Limits::default()).unwrap();
    let before = reader.bytes_read();
    reader.voxels(3, 0).unwrap();
    let coarse = reader.bytes_read() - before;
    reader.voxels(7, 1).unwrap();
    assert!(coarse < 4096 && reader.bytes_read() < reader.file_bytes() / 2, "{coarse} {}", reader.bytes_read());
    let before = reader.bytes_read();
    reader.voxels(7, 1).unwrap();
    assert_eq!(reader.bytes_read(), before, "no byte counts twice");
    for _ in 0..2 {
        reader.read_all().unwrap();
        assert!(reader.bytes_read() <= reader.file_bytes());
    }
}

#[test]
fn an_empty_texel_and_a_lone_terminal_root() {
    for volume in [
        Volume { info: info(ALL_CHANNELS), depths: vec![] },
        Volume { info: info(ALL_CHANNELS), depths: vec![Depth::default()] },
        Volume {
            info: info(ALL_CHANNELS),
            depths: vec![
                Depth { masks: vec![0], voxels: vec![Dice::new(1).voxel()], mixes: Vec::new() },
                Depth::default(),
            ],
        },
    ] {
        let (_dir, path) = written(&volume, Quality::Full);
        verify(&path).unwrap();
        let back = Reader::open(&path, &Limits::default()).unwrap().read_all().unwrap();
        assert_eq!(back.depths.len(), volume.depths.len().max(1));
        assert_eq!(back.depths[0].voxels.len(), volume.depths.first().map_or(0, |d| d.voxels.len()));
    }
}

#[test]
fn the_same_bytes_for_any_thread_count() {
    let volume = volume(11, 8, ALL_CHANNELS);
    let bytes = |threads| {
        let (_dir, path) = crate::par::with_threads(threads, || written(&volume, Quality::Full)).unwrap();
        std::fs::read(path).unwrap()
    };
    assert_eq!(bytes(1), bytes(3));
}

#[test]
fn a_limit_drops_the_finest_depths() {
    let volume = volume(5, 7, ALL_CHANNELS);
    let (_dir, path) = written(&volume, Quality::Full);
    let nodes: usize = volume.depths[..5].iter().map(|d| d.voxels.len()).sum();
    let reader = Reader::open(&path, &Limits { decoded_bytes: 17 * nodes as u64 }).unwrap();
    assert_eq!(reader.counts().len(), 5);
    assert!(!reader.warnings().is_empty());
    assert!(reader.masks(4).unwrap().iter().all(|&m| m == 0));
    assert!(matches!(Reader::open(&path, &Limits { decoded_bytes: 3 }), Err(crate::Error::Limit { .. })));
}

#[test]
fn a_volume_that_is_not_a_tree_is_refused_and_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let mut volume = volume(1, 3, ALL_CHANNELS);
    volume.depths[2].voxels.pop();
    volume.depths[2].masks.pop();
    assert!(write(&volume, dir.path().join("t.vtex"), &WriteOptions::default()).is_err());
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}

/// What the reader would refuse is clamped where that changes no meaning, and else not written: the old file stays.
#[test]
fn the_writer_keeps_the_readers_rules() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("t.vtex");
    let with = |change: &dyn Fn(&mut Info)| {
        let mut volume = volume(3, 3, ALL_CHANNELS);
        change(&mut volume.info);
        write(&volume, &path, &WriteOptions::default())
    };
    let (low, high) = (DVec3::splat(-1e-12), DVec3::splat(1.0 + 1e-12));
    with(&|info| (info.facet_size, info.content) = (141.0, Aabb::new(low, high))).unwrap();
    verify(&path).unwrap();
    let info = Reader::open(&path, &Limits::default()).unwrap().info().clone();
    assert_eq!((info.facet_size, info.content), (2.0, Aabb::UNIT));
    let before = std::fs::read(&path).unwrap();
    type Change<'a> = &'a dyn Fn(&mut Info);
    let refused: [(&str, Change); 5] = [
        ("facet_size", &|info| info.facet_size = f64::NAN),
        ("metres per unit", &|info| info.metres_per_unit = -1.0),
        ("up axis", &|info| info.up = 3),
        ("bounds", &|info| info.bounds.max.x = f64::INFINITY),
        ("nested", &|info| {
            let deep = (0..20).fold(serde_json::json!(1), |inner, _| serde_json::json!([inner]));
            info.meta.insert("deep".into(), deep);
        }),
    ];
    for (what, change) in refused {
        let error = with(change).unwrap_err();
        assert!(matches!(&error, Error::Options(text) if text.contains(what)), "{what}: {error}");
        assert_eq!(std::fs::read(&path).unwrap(), before, "{what}");
    }
    assert_eq!(std::fs::read_dir(&dir).unwrap().count(), 1);
}

/// A file that another process shortens while it is read is an error, wherever the end falls.
#[test]
fn a_file_cut_short_while_it_is_read_is_an_error() {
    let (_dir, path) = written(&volume(7, 6, ALL_CHANNELS), Quality::Full);
    let whole = std::fs::read(&path).unwrap();
    for share in [0, 1, 2, 3] {
        std::fs::write(&path, &whole).unwrap();
        let reader = Reader::open(&path, &Limits::default()).unwrap();
        let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
        file.set_len(whole.len() as u64 * share / 4).unwrap();
        let error = reader.read_all().unwrap_err();
        assert!(matches!(&error, Error::Format { code: codes::FILE_LENGTH, .. }), "{error}");
        assert!(error.to_string().contains("became shorter"), "{error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]
    /// Flipped bytes and cuts: an error, or the same volume (where only padding or an unread byte changed), never a panic.
    #[test]
    fn damage_is_found(at in proptest::collection::vec((any::<prop::sample::Index>(), 1u8..), 1..4), cut in proptest::option::weighted(0.3, any::<prop::sample::Index>())) {
        let (_dir, path) = written(&volume(2, 5, ALL_CHANNELS), Quality::Full);
        let mut bytes = std::fs::read(&path).unwrap();
        let good = bytes.clone();
        for (at, flip) in at {
            let i = at.index(bytes.len());
            bytes[i] ^= flip;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        std::fs::write(&path, &bytes).unwrap();
        prop_assert_eq!(verify(&path).is_ok(), bytes == good);
        if let Ok(reader) = Reader::open(&path, &Limits { decoded_bytes: 1 << 20 }) {
            let _ = reader.read_all();
        }
    }
}

/// A good file to break, and what is needed to mend its checksums afterwards.
struct Patient {
    bytes: Vec<u8>,
    head: Head,
    dir: tempfile::TempDir,
}

impl Patient {
    fn new() -> Patient {
        let (dir, path) = written(&volume(2, 6, ALL_CHANNELS), Quality::Full);
        let head = Reader::open(&path, &Limits::default()).unwrap().head().clone();
        Patient { bytes: std::fs::read(path).unwrap(), head, dir }
    }

    /// Change fields of the head and write it again with its content id and CRC right.
    fn with_head(change: impl FnOnce(&mut Head)) -> Patient {
        let mut patient = Patient::new();
        change(&mut patient.head);
        let bytes = patient.head.encode();
        patient.bytes.splice(..bytes.len(), bytes);
        patient
    }

    /// Change bytes of the head and mend only its CRC.
    fn with_bytes(change: impl FnOnce(&mut Vec<u8>)) -> Patient {
        let mut patient = Patient::new();
        change(&mut patient.bytes);
        let length = patient.head.depths[0].block_offset as usize;
        patient.bytes[20..24].fill(0);
        let crc = crc32fast::hash(&patient.bytes[..length]);
        patient.bytes[20..24].copy_from_slice(&crc.to_le_bytes());
        patient
    }

    /// Replace page 0 of a section's pages by another, which may be longer or shorter in the index alone; mends the page's
    /// CRC, the index's and the head's.
    fn with_index(number: usize, change: impl FnOnce(&mut [u8], &mut [u8])) -> Patient {
        let mut patient = Patient::new();
        let section = patient.head.sections[number].clone();
        let body = &mut patient.bytes[section.offset as usize..(section.offset + section.length) as usize];
        let (index, pages) = body.split_at_mut(section.index_len() as usize);
        change(index, pages);
        patient.head.sections[number].crc = crc32fast::hash(index);
        let bytes = patient.head.encode();
        patient.bytes.splice(..bytes.len(), bytes);
        patient
    }

    /// A section of a type that nobody knows, behind the blocks.
    fn with_unknown_section(flags: u16) -> Patient {
        let Patient { bytes, mut head, dir } = Patient::new();
        let (start, end) = (head.header.head_length as usize, head.header.file_length);
        let last = head.sections.last().unwrap().clone();
        head.header.sections += 1;
        let tables_end = head.header.tables_end() as u64;
        head.header.head_length = head::align8(tables_end + head.meta.len() as u64) as u32;
        let shift = u64::from(head.header.head_length) - start as u64;
        head.sections.iter_mut().for_each(|s| s.offset += shift);
        head.sections[0].offset = tables_end;
        head.depths
            .iter_mut()
            .for_each(|d| (d.block_offset, d.block_end) = (d.block_offset + shift, d.block_end + shift));
        let body = *b"anything";
        let offset = head::align8(end + shift);
        let (kind, crc) = (SectionKind::Other(*b"NEWS"), crc32fast::hash(&body));
        head.sections.push(SectionEntry { kind, flags, offset, length: 8, decoded: 8, pages: 0, crc, ..last });
        head.header.file_length = offset + 8;
        let mut out = head.encode();
        out.extend(&bytes[start..]);
        out.resize(offset as usize, 0);
        out.extend(body);
        Patient { bytes: out, head, dir }
    }

    fn code(&self) -> &'static str {
        let path = self.dir.path().join("bad.vtex");
        std::fs::write(&path, &self.bytes).unwrap();
        match verify(&path) {
            Err(crate::Error::Format { code, .. }) => code,
            other => panic!("{other:?}"),
        }
    }

    /// The first section of `kind` that has a page.
    fn section(kind: SectionKind) -> usize {
        Patient::new().head.sections.iter().position(|s| s.kind == kind && s.pages > 0).unwrap()
    }
}

#[test]
fn every_code_has_a_file_that_breaks_its_rule() {
    let (topo, page) = (Patient::section(SectionKind::Topo), Patient::section(SectionKind::Page));
    let block = |p: &Patient| p.head.depths[0].block_offset as usize;
    let set_u32 = |b: &mut [u8], at: usize, v: u32| b[at..at + 4].copy_from_slice(&v.to_le_bytes());
    let meta = |text: &'static str| {
        Patient::with_head(move |h| {
            let last = h.meta.len();
            let mut body = text.as_bytes().to_vec();
            body.resize(last, b' ');
            h.sections[0].crc = crc32fast::hash(&body);
            h.meta = body;
        })
    };
    let mut found = std::collections::BTreeSet::new();
    let mut check = |code: &'static str, patients: Vec<Patient>| {
        for (i, patient) in patients.iter().enumerate() {
            assert_eq!(patient.code(), code, "file {i}");
        }
        found.insert(code);
    };
    check(codes::MAGIC, vec![Patient::with_bytes(|b| b[0] = b'V'), Patient { bytes: vec![], ..Patient::new() }]);
    check(codes::VERSION, vec![Patient::with_bytes(|b| b[12] = 2)]);
    check(
        codes::HEAD_LENGTH,
        vec![
            Patient::with_bytes(|b| set_u32(b, 16, u32::MAX)),
            Patient::with_bytes(|b| set_u32(b, 16, 64)),
            Patient::with_bytes(|b| b[16] += 1),
        ],
    );
    let mut patient = Patient::new();
    patient.bytes[200] ^= 1;
    check(codes::HEAD_CRC, vec![patient]);
    check(codes::FLAGS, vec![Patient::with_bytes(|b| b[34] = 1)]);
    check(
        codes::RANGE,
        vec![
            Patient::with_head(|h| h.header.page_log2 = 9),
            Patient::with_head(|h| h.header.topo_page_log2 = 17),
            Patient::with_head(|h| h.header.cyclic = 8),
            Patient::with_head(|h| h.header.up = 3),
        ],
    );
    check(
        codes::RESERVED,
        vec![Patient::with_head(|h| h.streams[0].reserved = 1), Patient::with_head(|h| h.sections[2].reserved[5] = 1)],
    );
    check(
        codes::FLOAT,
        vec![
            Patient::with_head(|h| h.header.bounds[4] = f64::NAN),
            Patient::with_head(|h| h.header.bounds[0] = 1e9),
            Patient::with_head(|h| h.header.metres_per_unit = f64::NEG_INFINITY),
        ],
    );
    check(
        codes::COUNTS,
        vec![
            Patient::with_head(|h| h.depths[0].nodes = 2),
            Patient::with_head(|h| h.depths[3].nodes = u64::MAX),
            Patient::with_head(|h| h.depths[5].internal = 1),
            Patient::with_head(|h| h.header.nodes += 1),
        ],
    );
    check(
        codes::STREAM,
        vec![
            Patient::with_head(|h| h.streams[0].quant_max = 0),
            Patient::with_head(|h| h.streams[1].components = 4),
            Patient::with_head(|h| h.streams[1].component_bytes = 2),
            Patient::with_head(|h| h.streams[1] = h.streams[0].clone()),
            Patient::with_head(|h| h.streams[1].max_abs_error = f32::NAN),
            Patient::with_head(|h| h.streams[1].constant[7] = 1),
        ],
    );
    check(codes::STREAM_CRITICAL, vec![Patient::with_head(|h| h.streams[0].semantic = *b"NEWS")]);
    check(codes::CONTENT_ID, vec![Patient::with_bytes(|b| b[115] ^= 1)]);
    check(codes::SECTION_CRITICAL, vec![Patient::with_unknown_section(SectionEntry::CRITICAL)]);
    check(
        codes::SECTION_ORDER,
        vec![
            Patient::with_head(|h| h.sections.swap(1, 2)),
            Patient::with_head(|h| h.sections[3].kind = SectionKind::Meta),
            Patient::with_head(|h| h.sections[3].stream = 0),
        ],
    );
    check(
        codes::SECTION_PLACE,
        vec![
            Patient::with_head(|h| h.sections[3].offset += 8),
            Patient::with_head(|h| h.sections[3].offset = u64::MAX - 7),
            Patient::with_head(|h| h.sections[3].length = u64::MAX),
        ],
    );
    check(
        codes::SECTION_SIZE,
        vec![
            Patient::with_head(|h| h.sections[3].decoded += 1),
            Patient::with_head(|h| h.sections[3].pages = u32::MAX),
            Patient::with_head(|h| h.sections[3].length = 3),
            Patient::with_head(|h| h.sections[0].decoded = 1),
        ],
    );
    check(
        codes::SECTION_CODEC,
        vec![
            Patient::with_head(|h| h.sections[3].codec = 2),
            Patient::with_head(move |h| h.sections[page].filter = filter::COUNT),
            Patient::with_head(move |h| h.sections[topo].filter = 1),
        ],
    );
    check(
        codes::BLOCK,
        vec![Patient::with_head(|h| h.depths[2].block_offset += 8), Patient::with_head(|h| h.depths[2].block_end -= 1)],
    );
    let (mut short, mut long) = (Patient::new(), Patient::new());
    short.bytes.pop();
    long.bytes.push(0);
    check(codes::FILE_LENGTH, vec![short, long, Patient::with_head(|h| h.header.file_length += 8)]);
    check(codes::META_CRC, vec![Patient::with_head(|h| h.sections[0].crc ^= 1)]);
    check(codes::META_JSON, vec![meta("{"), meta("[]"), meta("{}"), meta(&"[".repeat(160)[..].to_owned().leak()[..])]);
    let mut padded = Patient::new();
    let gap = padded.head.sections.windows(2).map(|w| ((w[0].offset + w[0].length) as usize, w[1].offset as usize));
    let at = gap.skip(1).find(|(a, b)| a < b).unwrap().0;
    padded.bytes[at] = 1;
    check(codes::PADDING, vec![padded]);
    let mut index = Patient::new();
    let at = block(&index);
    index.bytes[at] ^= 1;
    check(codes::INDEX_CRC, vec![index]);
    check(
        codes::INDEX_PLACE,
        vec![
            Patient::with_index(page, |index, _| index[0] += 1),
            Patient::with_index(page, |index, _| index[8] -= 1),
            Patient::with_index(page, |index, _| set_u32(index, 8, u32::MAX)),
        ],
    );
    check(codes::PAGE_CRC, vec![Patient::with_index(page, |_, pages| pages[0] ^= 1)]);
    // The largest page: it is compressed.
    let big = Patient::new()
        .head
        .sections
        .iter()
        .enumerate()
        .filter(|(_, s)| s.pages > 0)
        .max_by_key(|(_, s)| s.decoded.saturating_sub(s.length))
        .unwrap()
        .0;
    let mend = |index: &mut [u8], pages: &[u8]| set_u32(index, 12, crc32fast::hash(pages));
    check(
        codes::PAGE_FRAME,
        vec![
            Patient::with_index(big, |index, pages| {
                pages[0] ^= 1;
                mend(index, pages);
            }),
            Patient::with_index(big, |index, pages| {
                let last = pages.len() - 1;
                pages[last..].fill(0x55);
                pages[last / 2..].fill(0xff);
                mend(index, pages);
            }),
        ],
    );
    check(
        codes::PAGE_VALUE,
        vec![Patient::with_index(2, |index, pages| {
            pages[0] = 255;
            mend(index, pages);
        })],
    );
    check(
        codes::TOPOLOGY,
        vec![
            Patient::with_index(topo, |index, _| index[16] = 1),
            Patient::with_index(topo, |index, pages| {
                pages[0] ^= 0xff;
                mend(index, pages);
            }),
        ],
    );
    check(codes::DIGEST, vec![Patient::with_head(|h| h.depths[3].digest[0] ^= 1)]);
    assert_eq!(found.into_iter().collect::<Vec<_>>(), {
        let mut all = codes::ALL.to_vec();
        all.sort_unstable();
        all
    });
}

#[test]
fn an_unknown_section_that_is_not_critical_is_skipped_and_dropped_by_truncation() {
    let patient = Patient::with_unknown_section(0);
    let (path, short) = (patient.dir.path().join("a.vtex"), patient.dir.path().join("b.vtex"));
    std::fs::write(&path, &patient.bytes).unwrap();
    verify(&path).unwrap();
    truncate(&path, 5, &short).unwrap();
    assert_eq!(std::fs::read(short).unwrap(), Patient::new().bytes);
}

#[test]
fn the_list_of_codes_is_that_of_the_specification() {
    let text = include_str!("../../format-spec/codes");
    let listed: Vec<&str> =
        text.lines().filter(|l| !l.starts_with('#')).filter_map(|l| l.split_whitespace().next()).collect();
    assert_eq!(listed, codes::ALL);
}
