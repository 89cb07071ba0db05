//! One process that bakes and renders again and again: no byte of memory and no open file is left behind. A process of its own,
//! since it counts both.
//!
//! `VTEX_SOAK` says how many times, 1000 before a release; the test does with few.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "../mutate/memory.rs"]
mod memory;

use std::path::Path;

use vtex::format::{Limits, Reader, WriteOptions};
use vtex::progress::Quiet;
use vtex::scene::{ReadOptions, gltf};
use vtex::{bake, format, render, source};

#[global_allocator]
static ALLOCATOR: memory::Counting = memory::Counting;

/// After so many rounds all that is made once has been made: threads, tables, buffers that are kept.
const WARM: u32 = 5;
/// Threads keep buffers of their queues for a while, and of two that finish together either may free a piece. What leaks a
/// hundred bytes each time is more than this after a thousand.
const SLACK: usize = 64 << 10;

/// Read, bake, write, read again, and render, each with what the tests' corpus and the samples have.
fn round(folder: &Path) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for input in
        ["samples/fern.glb", "samples/recipes/ring.toml", "samples/stacks/shell", "samples/lsystems/plant-b.lsys"]
    {
        let opened = source::open(&root.join(input), &source::OpenOptions::default()).unwrap();
        let options = bake::Options { resolution: 8, up: opened.up(), ..bake::Options::default() };
        let (volume, _) = bake::bake(&*opened, &options, &Quiet, &mut |_| ()).unwrap();
        let output = folder.join("out.vtex");
        format::write(&volume, &output, &WriteOptions::default()).unwrap();
        assert!(!Reader::open(&output, &Limits::default()).unwrap().read_all().unwrap().depths.is_empty());
    }
    for landscape in ["shells.glb", "copies.glb"] {
        let path = root.join("tests/corpus/1.0").join(landscape);
        let scene = gltf::read(&path, &ReadOptions { contained: true, ..ReadOptions::default() }).unwrap();
        let options = render::Options { size: [16, 9], ..render::Options::default() };
        let picture = render::render(&scene, &options, &Quiet).unwrap();
        assert!(picture.film.pixels.iter().flatten().all(|v| v.is_finite()));
    }
    // What fails leaves nothing behind, either.
    let bad = root.join("format-spec/vectors/bad-page-crc-1.vtex");
    assert!(Reader::open(bad, &Limits::default()).unwrap().read_all().is_err());
}

/// Open files of this process; `None` where the system does not list them.
fn open_files() -> Option<usize> {
    std::fs::read_dir("/proc/self/fd").ok().map(Iterator::count)
}

#[test]
fn memory_and_open_files_stay_as_they_were() {
    let rounds: u32 = std::env::var("VTEX_SOAK").ok().and_then(|n| n.parse().ok()).unwrap_or(12);
    let folder = tempfile::tempdir().unwrap();
    let (mut before, mut files, mut most) = (0, None, 0);
    for n in 0..rounds.max(WARM + 1) {
        round(folder.path());
        let taken = memory::taken();
        if n == WARM - 1 {
            (before, files) = (taken, open_files());
        }
        most = most.max(taken.saturating_sub(before) * usize::from(n >= WARM));
    }
    let after = memory::taken();
    println!(
        "{rounds} rounds: {before} bytes after {WARM}, {after} at the end, at most {most} more between; files {files:?}"
    );
    assert!(after <= before + SLACK, "{before} bytes became {after}");
    assert_eq!(open_files(), files, "open files");
}
