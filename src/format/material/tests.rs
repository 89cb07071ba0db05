//! Materials in files: codes, round trips, prefixes, and files that contradict themselves.

use proptest::prelude::*;

use super::*;
use crate::format::tests::{ALL_CHANNELS, Dice, quantised, volume, written};
use crate::format::{Head, Limits, Quality, Reader, WriteOptions, filter, truncate, verify, write};
use crate::volume::material::FINE_STEP;
use crate::volume::octree::Pages;
use crate::volume::{Mix, Volume};

fn coding(materials: usize) -> MixCoding {
    let named = |i: usize| {
        let albedo = [0.1, 0.5, 0.9].map(|v: f64| (v + i as f64 * 0.37).fract());
        Material { name: i.to_string(), albedo, share: 0.5 }
    };
    MixCoding::new(&(0..materials).map(named).collect::<Vec<_>>())
}

#[test]
fn the_likely_material_is_zero() {
    let coding = coding(3);
    let own = [1.0, 0.5, 0.9].map(|v: f64| v.fract());
    assert_eq!(coding.likely([81, 180, 242]), 0, "{own:?}");
    // The second's mean: .47, .87, .27.
    let albedo = [175, 238, 132];
    assert_eq!(coding.likely(albedo), 1);
    assert_eq!(coding.codes(&[Mix::one(1), Mix::one(0), Mix::one(2)], |_| albedo), [0, 0, 63, 0, 0, 63]);
}

proptest! {
    #[test]
    fn mixes_read_back(
        materials in 2usize..=255,
        albedo: [u8; 3],
        weights in proptest::collection::vec((any::<prop::sample::Index>(), 0.0f64..1.0), 0..7),
    ) {
        let ids: std::collections::BTreeMap<u8, f64> =
            weights.iter().map(|(i, w)| (i.index(materials) as u8, *w)).collect();
        let (own, coding) = (Mix::new(ids, FINE_STEP), coding(materials));
        let codes = coding.codes(&[own, Mix::default()], |_| albedo);
        let n = components(materials);
        prop_assert!((0..codes.len()).all(|i| codes[i] <= component_max(materials, i % n)));
        prop_assert_eq!(coding.mix(&codes[..n], albedo), Some(own));
        prop_assert_eq!(coding.mix(&codes[n..], albedo), Some(Mix::default()));
    }

    #[test]
    fn any_codes_have_a_meaning_or_none(materials in 2usize..=255, codes: [u8; 7], albedo: [u8; 3]) {
        let (n, coding) = (components(materials), coding(materials));
        let mix = coding.mix(&codes[..n], albedo);
        prop_assert_eq!(mix.is_some(), coding.is_whole(&codes[..n]));
        if let Some(mix) = mix {
            prop_assert_eq!(mix.shares().map(|s| u32::from(s.1)).sum::<u32>(), u32::from(SHARE_SUM));
        }
    }
}

/// The same with mixes of `count` materials.
fn mixed(mut volume: Volume, count: usize) -> Volume {
    let mut dice = Dice::new(count as u64);
    let named = |i| Material { name: format!("m{i}"), albedo: [0.25, 0.5, 1.0], share: 0.5 };
    volume.info.materials = (0..count).map(named).collect();
    for depth in &mut volume.depths {
        let mut mix = || {
            let n = dice.next() % 6;
            let weights: std::collections::BTreeMap<u8, f64> =
                (0..n).map(|_| ((dice.next() % count as u64) as u8, (dice.next() % 100) as f64)).collect();
            Mix::new(weights, FINE_STEP)
        };
        depth.mixes = depth.voxels.iter().map(|_| mix()).collect();
    }
    volume
}

#[test]
fn materials_read_back_and_are_read_only_for_themselves() {
    for count in [2, 3, 4, 5, 255] {
        let volume = mixed(volume(7, 9, ALL_CHANNELS), count);
        let (dir, path) = written(&volume, Quality::Full);
        let reader = Reader::open(&path, &Limits::default()).unwrap();
        reader.voxels(8, 0).unwrap();
        let (before, finest) = (reader.bytes_read(), reader.counts().len() - 1);
        let page = reader.mixes(finest, 0).unwrap();
        assert!(page[..] == volume.depths[finest].mixes[..page.len()] && reader.bytes_read() > before);
        assert_eq!(reader.read_all().unwrap(), quantised(&volume, Quality::Full));
        verify(&path).unwrap();
        // A prefix is what is written of the coarser texel.
        let (short, direct) = (dir.path().join("s.vtex"), dir.path().join("d.vtex"));
        truncate(&path, 4, &short).unwrap();
        let mut coarser = volume.clone();
        coarser.depths.truncate(5);
        coarser.depths[4].masks.fill(0);
        write(&coarser, &direct, &WriteOptions { level: 3, quality: Quality::Full }).unwrap();
        assert_eq!(std::fs::read(&short).unwrap(), std::fs::read(&direct).unwrap());
    }
    // One and the same everywhere takes no page.
    let mut even = mixed(volume(3, 6, ALL_CHANNELS), 2);
    even.depths.iter_mut().flat_map(|d| &mut d.mixes).for_each(|m| *m = Mix::new([(0, 1.0), (1, 2.0)], FINE_STEP));
    let (_dir, path) = written(&even, Quality::Full);
    let reader = Reader::open(&path, &Limits::default()).unwrap();
    assert!(reader.head().streams.last().unwrap().is_constant());
    assert_eq!(reader.read_all().unwrap().depths[5].mixes, even.depths[5].mixes);
}

#[test]
fn materials_that_contradict_each_other_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("t.vtex");
    let refused = |change: &dyn Fn(&mut Volume)| {
        let mut volume = mixed(volume(3, 5, ALL_CHANNELS), 3);
        change(&mut volume);
        assert!(write(&volume, &path, &WriteOptions::default()).is_err() && !path.exists());
    };
    refused(&|v| v.depths[2].mixes.clear());
    refused(&|v| v.info.materials.truncate(1));
    refused(&|v| v.info.materials[1].name.clear());
    refused(&|v| v.info.materials[1].name = "m0".into());
    refused(&|v| v.info.materials[1].share = 1.5);
    refused(&|v| v.info.materials[2].albedo[1] = f64::NAN);
    refused(&|v| {
        v.info.materials = (0..256).map(|i| Material { name: format!("{i}"), albedo: [0.0; 3], share: 0.0 }).collect()
    });
    // A file whose META and stream do not fit together.
    for (from, to) in [("\"m2\"", "\"m1\""), ("\"m2\"", "\"\"  "), ("\"share\":0.5},{", "\"share\":1.5},{")] {
        let (_dir, path) = written(&mixed(volume(2, 6, ALL_CHANNELS), 3), Quality::Full);
        let mut head = Reader::open(&path, &Limits::default()).unwrap().head().clone();
        let mut bytes = std::fs::read(&path).unwrap();
        let text = String::from_utf8(head.meta.clone()).unwrap();
        assert!(text.contains(from), "{text}");
        head.meta = text.replacen(from, to, 1).into_bytes();
        head.sections[0].crc = crc32fast::hash(&head.meta);
        let new = head.encode();
        bytes.splice(..new.len(), new);
        std::fs::write(&path, &bytes).unwrap();
        let error = verify(&path).err().unwrap().to_string();
        assert!(error.contains("meta-json"), "{error}");
    }
    // As many materials as the stream does not say; an id that none has; shares of more than all.
    let (_dir, path) = written(&mixed(volume(2, 6, ALL_CHANNELS), 6), Quality::Full);
    let good = Reader::open(&path, &Limits::default()).unwrap().head().clone();
    let file = std::fs::read(&path).unwrap();
    let broken = |change: &dyn Fn(&mut Head, &mut Vec<u8>)| {
        let (mut head, mut bytes) = (good.clone(), file.clone());
        change(&mut head, &mut bytes);
        let new = head.encode();
        bytes.splice(..new.len(), new);
        std::fs::write(&path, &bytes).unwrap();
        verify(&path).err().unwrap().to_string()
    };
    let stream = good.streams.len() - 1;
    assert!(broken(&|h, _| h.streams[stream].quant_max = 6).contains("meta-json"));
    assert!(broken(&|h, _| h.streams[stream].quant_max = 2).contains("[stream"));
    assert!(broken(&|h, _| h.streams[stream].components = 3).contains("[stream"));
    assert!(broken(&|h, _| h.streams[stream].quant_max = 255).contains("[stream"));
    // The root's page is stored as it is: seven codes.
    let section = good.sections.iter().position(|s| usize::from(s.stream) == stream && s.depth == 0).unwrap();
    for (codes, what) in [
        ([6u8, 0, 0, 0, 0, 0, 0], "page-value"),
        ([0, 1, 2, 3, 40, 20, 4], "page-value"),
        ([0, 1, 2, 3, 255, 255, 2], "page-value"),
    ] {
        let error = broken(&|head, bytes| {
            let s = &mut head.sections[section];
            assert_eq!((s.length - s.index_len(), s.filter), (7, filter::INTERLEAVED));
            let at = (s.offset + s.index_len()) as usize;
            bytes[at..at + 7].copy_from_slice(&codes);
            let crc = crc32fast::hash(&codes);
            let index = s.offset as usize;
            bytes[index + 12..index + 16].copy_from_slice(&crc.to_le_bytes());
            s.crc = crc32fast::hash(&bytes[index..at]);
        });
        assert!(error.contains(what), "{error}");
    }
}
