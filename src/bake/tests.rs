//! One bake for every instruction set and number of threads.

use std::path::Path;
use std::sync::atomic::Ordering;

use super::*;
use crate::progress::Quiet;
use crate::simd::PLAIN_ONLY;
use crate::source::{OpenOptions, open};

/// Whole bakes, which run every kernel: leaves with an alpha mask and a closed trunk, soft matter, and a stack of samples.
/// Where the processor has no AVX2, both are the plain versions.
#[test]
fn bytes_depend_on_neither_instructions_nor_threads() {
    let samples = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples");
    for (name, model) in [
        ("tree.glb", Model::Coverage),
        ("tree.glb", Model::Neyret),
        ("hypertextures/fire.toml", Model::Coverage),
        ("stacks/shell", Model::Coverage),
    ] {
        let source = open(&samples.join(name), &OpenOptions::default()).unwrap();
        let options = Options { resolution: 64, model, ..Options::default() };
        let run = |plain: bool, threads: usize| {
            PLAIN_ONLY.store(plain, Ordering::Relaxed);
            let baked = par::with_threads(threads, || bake(&*source, &options, &Quiet, &mut |_| ())).unwrap().unwrap();
            PLAIN_ONLY.store(false, Ordering::Relaxed);
            baked
        };
        let (volume, report) = run(false, 1);
        assert!(volume.depths[6].voxels.len() > 1000, "{name}: {}", volume.depths[6].voxels.len());
        for (plain, threads) in [(false, 3), (true, 1), (true, 3)] {
            let (other, other_report) = run(plain, threads);
            assert!(volume == other, "{name}, plain {plain}, {threads} threads");
            assert_eq!(report.depths, other_report.depths, "{name}, plain {plain}, {threads} threads");
        }
    }
}
