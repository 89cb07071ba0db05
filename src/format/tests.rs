//! Tests of the parts together: round trips, hostile files, one broken file for every code.

use proptest::prelude::*;

use super::*;
use crate::geom::{Aabb, DVec3};
use crate::volume::octree::Pages;
use crate::volume::{Channels, Depth, Info, Model, Volume, Voxel};

/// Numbers that look random and are the same everywhere (splitmix64).
pub struct Dice(pub u64);

impl Dice {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
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
        metres_per_unit: 1.0,
        up: 1,
        cyclic: [true, false, false],
        model: Model::Coverage,
        content: Aabb::new(DVec3::splat(0.1), DVec3::splat(0.9)),
        facet_size: 0.02,
        channels,
        meta,
    }
}

pub const ALL_CHANNELS: Channels = Channels { correlation: true, support: true, albedo: true, mean_normal: true };

/// A tree of `depths` depths whose nodes have about 4 children, none with a chance of 1 in 16.
pub fn volume(seed: u64, depths: usize, channels: Channels) -> Volume {
    let mut dice = Dice(seed);
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
        out.push(Depth { masks, voxels });
    }
    Volume { info: info(channels), depths: out }
}

pub fn written(volume: &Volume, quality: Quality) -> (tempfile::TempDir, std::path::PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("t.vtex");
    write(volume, &path, &WriteOptions { level: 3, quality }).unwrap();
    (dir, path)
}

fn quantised(volume: &Volume, quality: Quality) -> Volume {
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
}

#[test]
fn an_empty_texel_and_a_lone_terminal_root() {
    for volume in [
        Volume { info: info(ALL_CHANNELS), depths: vec![] },
        Volume { info: info(ALL_CHANNELS), depths: vec![Depth::default()] },
        Volume {
            info: info(ALL_CHANNELS),
            depths: vec![Depth { masks: vec![0], voxels: vec![Dice(1).voxel()] }, Depth::default()],
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
fn truncation_is_the_prefix_under_a_new_head() {
    let volume = volume(9, 7, ALL_CHANNELS);
    let (dir, path) = written(&volume, Quality::Full);
    let (short, direct, cut) = (dir.path().join("s.vtex"), dir.path().join("d.vtex"), dir.path().join("c.vtex"));
    let length = truncate(&path, 4, &short).unwrap();
    verify(&short).unwrap();
    let mut coarser = volume.clone();
    coarser.depths.truncate(5);
    coarser.depths[4].masks.fill(0);
    write(&coarser, &direct, &WriteOptions { level: 3, quality: Quality::Full }).unwrap();
    assert_eq!(std::fs::read(&short).unwrap(), std::fs::read(&direct).unwrap());
    assert_eq!(std::fs::metadata(&short).unwrap().len(), length);
    // A download that stopped inside depth 5 gives the same, and cannot be mistaken for a whole file.
    let end = Reader::open(&path, &Limits::default()).unwrap().head().depths[4].block_end as usize;
    std::fs::write(&cut, &std::fs::read(&path).unwrap()[..end + 11]).unwrap();
    let refused = Reader::open(&cut, &Limits::default()).err().unwrap().to_string();
    assert!(refused.contains("truncate --depth 4") && refused.contains("[file-length"), "{refused}");
    truncate(&cut, 4, &short).unwrap();
    assert_eq!(std::fs::read(&short).unwrap(), std::fs::read(&direct).unwrap());
    assert!(truncate(&cut, 5, &short).is_err());
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
