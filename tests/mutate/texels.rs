//! Files that are wrong on purpose, and others that claim more than fits: what each takes is little.

use std::path::{Path, PathBuf};

use vtex::format::{Limits, Reader, WriteOptions, verify, write};
use vtex::volume::{Depth, Info, Volume, Voxel};

use crate::memory::{alone, peak};
use crate::run::{MAX_MEMORY, read_and_bake};
use crate::targets::MEMORY;

/// What is taken for a file of kilobytes: its head, its tables, the states of the decompressor.
const LITTLE: usize = 1 << 20;

fn vectors(kind: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("format-spec/vectors");
    let mut all: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    let name = |p: &PathBuf| p.file_name().unwrap().to_string_lossy().into_owned();
    all.retain(|p| name(p).starts_with(kind) && name(p).ends_with(".vtex"));
    all.sort();
    all
}

#[test]
fn vectors_take_little() {
    let _alone = alone();
    let limits = Limits { decoded_bytes: MEMORY };
    for kind in ["bad-", "ok-"] {
        let (mut count, mut most) = (0, 0);
        for path in vectors(kind) {
            let (read, a) = peak(|| Reader::open(&path, &limits).and_then(|r| r.read_all().map(drop)).is_ok());
            let (_, b) = peak(|| Reader::open_prefix(&path, &limits).and_then(|r| r.read_all().map(drop)));
            let (whole, c) = peak(|| verify(&path).is_ok());
            assert!(whole == (kind == "ok-") && (read || !whole), "{}", path.display());
            let own = a.max(b).max(c);
            assert!(own <= LITTLE, "{}: {own} bytes", path.display());
            (count, most) = (count + 1, most.max(own));
        }
        println!("{count} of {kind}*: at most {} KiB", most >> 10);
        assert!(count > 20);
    }
}

/// A texel whose voxels are all there and all alike: a file of some kilobytes holds 2.4 million of them.
#[test]
fn depths_beyond_the_limit_are_not_decoded() {
    let _alone = alone();
    let dir = crate::scratch();
    let path = dir.path().join("full.vtex");
    let depth = |d: u32| {
        let count = 1usize << (3 * d);
        let voxel = Voxel { rate: 9, ..Voxel::default() };
        Depth { masks: vec![if d < 7 { 255 } else { 0 }; count], voxels: vec![voxel; count], mixes: Vec::new() }
    };
    write(&Volume { info: Info::default(), depths: (0..8).map(depth).collect() }, &path, &WriteOptions::default())
        .unwrap();
    assert!(std::fs::metadata(&path).unwrap().len() < 64 << 10);
    for limit in [1 << 16, 1 << 20, 1 << 24] {
        let open = || Reader::open(&path, &Limits { decoded_bytes: limit }).unwrap().read_all().unwrap().depths.len();
        let (depths, taken) = peak(open);
        assert!((1..8).contains(&depths), "{depths}");
        // The voxels themselves, and the codes of the pages that are being decoded.
        assert!(taken as u64 <= 2 * limit + LITTLE as u64, "{limit}: {taken}");
        println!("{limit} bytes allowed: {depths} depths, {taken} taken");
    }
    // A verifier holds one page at a time.
    let (result, taken) = peak(|| verify(&path));
    result.unwrap();
    assert!(taken <= 16 << 20, "{taken}");
}

/// Real files that are broken, where they are there: each in the memory that its reading and its bake are allowed.
#[test]
fn malformed_files_take_what_they_may() {
    let _alone = alone();
    let Some(assets) = std::env::var_os("VTEX_ASSETS").map(PathBuf::from) else { return };
    let mut left = vec![assets.join("bad")];
    let dir = crate::scratch();
    let output = dir.path().join("out.vtex");
    let (mut files, mut refused, mut most) = (0, 0, (0, PathBuf::new()));
    while let Some(path) = left.pop() {
        if path.is_dir() {
            left.extend(std::fs::read_dir(&path).unwrap().map(|e| e.unwrap().path()));
            continue;
        }
        if path.extension().is_none_or(|e| e == "json") {
            continue;
        }
        let work = || vtex::par::with_threads(1, || read_and_bake(&path, &output, 1)).unwrap();
        let (result, taken) = peak(work);
        assert!(taken as u64 <= MAX_MEMORY, "{}: {} MiB: {result:?}", path.display(), taken >> 20);
        (files, refused) = (files + 1, refused + usize::from(result.is_err()));
        if taken > most.0 {
            most = (taken, path);
        }
    }
    println!("{files} malformed files, {refused} refused, at most {} KiB: {}", most.0 >> 10, most.1.display());
    assert!(files > 100 && refused > files / 4, "{files} {refused}");
}
