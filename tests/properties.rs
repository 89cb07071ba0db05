//! Laws that hold whatever the content: written again it is the same bytes, resampled by nothing it is the same matter, merged in
//! another order it is the same to the steps of its codes, and less memory changes nothing.

use std::collections::BTreeMap;
use std::path::Path;

use vtex::bake::{Options, bake};
use vtex::format::{Limits, Quality, Reader, WriteOptions, verify, write};
use vtex::geom::{Aabb, DVec3};
use vtex::merge::{MergeOptions, merge};
use vtex::progress::Quiet;
use vtex::source::field::{FieldSource, Sphere};
use vtex::source::{self, OpenOptions};
use vtex::volume::{Volume, Voxel};
use vtex::{Warnings, par};

use crate::corpus;

fn read(path: &Path) -> Volume {
    Reader::open(path, &Limits::default()).unwrap().read_all().unwrap()
}

/// Voxels with matter, by depth and code.
fn matter(volume: &Volume) -> BTreeMap<(usize, u64), Voxel> {
    let mut all = BTreeMap::new();
    let mut codes = vec![0u64];
    for (d, depth) in volume.depths.iter().enumerate() {
        codes.truncate(depth.voxels.len());
        all.extend(codes.iter().zip(&depth.voxels).filter(|(_, v)| v.rate > 0).map(|(c, v)| ((d, *c), *v)));
        let children = |(code, mask): (&u64, &u8)| {
            (0..8).filter(|c| mask >> c & 1 == 1).map(move |c| code * 8 + c).collect::<Vec<_>>()
        };
        codes = codes.iter().zip(&depth.masks).flat_map(children).collect();
    }
    all
}

#[test]
fn what_is_read_is_written_as_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let [first, second] = ["first.vtex", "second.vtex"].map(|name| dir.path().join(name));
    let texels: Vec<_> = corpus::versions().iter().flat_map(|folder| corpus::files(folder, "vtex")).collect();
    assert!(texels.len() > 10);
    for path in texels {
        for quality in [Quality::Full, Quality::Lean] {
            let options = WriteOptions { level: 3, quality };
            write(&read(&path), &first, &options).unwrap();
            verify(&first).unwrap();
            write(&read(&first), &second, &options).unwrap();
            assert!(std::fs::read(&first).unwrap() == std::fs::read(&second).unwrap(), "{}", path.display());
        }
    }
}

/// Nodes that hold nothing are left out; all else stays, to the bit.
#[test]
fn a_texel_that_is_resampled_by_nothing_stays_as_it_is() {
    for name in ["alpha", "solid", "soft", "wall", "colours", "neyret"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/corpus/1.0/{name}.vtex"));
        let volume = read(&path);
        let again = merge(vec![(volume.clone(), Warnings::default())], &MergeOptions::default(), &Quiet).unwrap().0;
        assert_eq!(again.info.bounds, volume.info.bounds, "{name}");
        let (found, wanted) = (matter(&again), matter(&volume));
        assert!(wanted.len() > 100, "{name}");
        let changed = wanted.iter().filter(|(at, voxel)| found.get(at) != Some(voxel)).count();
        assert!(changed == 0 && found.len() == wanted.len(), "{name}: {changed} of {} changed", wanted.len());
    }
}

/// Three balls that overlap, each with colours of its own kind, on one lattice.
fn balls() -> [Volume; 3] {
    let ball = |x: f64, radius| {
        let source = FieldSource::new(Box::new(Sphere { centre: DVec3::new(x, 0.0, 0.0), radius }), None).unwrap();
        let cube = Some(Aabb::new(DVec3::splat(-2.0), DVec3::splat(2.0)));
        let options = Options { resolution: 32, cube, calibrate: false, ..Options::default() };
        bake(&source, &options, &Quiet, &mut |_| ()).unwrap().0
    };
    [ball(0.0, 1.0), ball(0.75, 1.0), ball(1.25, 0.75)]
}

/// In whichever order texels are merged: one tree, one box of matter in each voxel, and codes that differ by their rounding. The file
/// has every second code of the rates; where three meet, a sum is rounded twice.
#[test]
fn merging_is_associative_to_the_steps_of_codes() {
    let of = |all: Vec<Volume>| {
        let inputs = all.into_iter().map(|v| (v, Warnings::default())).collect();
        merge(inputs, &MergeOptions::default(), &Quiet).unwrap().0
    };
    let [a, b, c] = balls();
    let left = of(vec![of(vec![a.clone(), b.clone()]), c.clone()]);
    let right = of(vec![a.clone(), of(vec![b.clone(), c.clone()])]);
    let all = of(vec![a, b, c]);
    for (name, other) in [("right", &right), ("all at once", &all)] {
        let (x, y) = (matter(&left), matter(other));
        assert!(x.len() > 1000 && x.keys().eq(y.keys()), "{name}: {} and {} voxels", x.len(), y.len());
        let apart: Vec<u8> = x.iter().zip(&y).map(|((_, x), (_, y))| x.rate.abs_diff(y.rate)).collect();
        let beyond = apart.iter().filter(|d| **d > 2).count();
        println!("{name}: {} voxels, {beyond} more than two codes apart, at most {:?}", x.len(), apart.iter().max());
        assert!(beyond * 50 <= apart.len(), "{name}: {beyond} of {} rates are more than a step apart", apart.len());
        assert!(apart.iter().all(|d| *d <= 16), "{name}: a rate is off by a factor of two");
        assert!(x.values().zip(y.values()).all(|(x, y)| x.support == y.support), "{name}: supports");
    }
}

/// Less memory, or more threads, cut the work in other pieces.
#[test]
fn neither_memory_nor_threads_change_a_texel() {
    let samples = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples");
    for name in ["fern.glb", "recipes/ring.toml", "lsystems/plant-b.lsys"] {
        let opened = source::open(&samples.join(name), &OpenOptions::default()).unwrap();
        let baked = |memory, threads| {
            let options = Options { resolution: 32, up: opened.up(), memory, calibrate: false, ..Options::default() };
            par::with_threads(threads, || bake(&*opened, &options, &Quiet, &mut |_| ()).map(|b| b.0)).unwrap()
        };
        let wanted = baked(0, 1).unwrap();
        let mut done = 0;
        for shift in 20..30 {
            // Too little is refused; all that suffices gives the same.
            if let Ok(found) = baked(1 << shift, 1 + shift % 3) {
                assert!(found == wanted, "{name} in {} MiB", 1 << (shift - 20));
                done += 1;
            }
        }
        assert!((1..=10).contains(&done), "{name}: {done}");
    }
}
