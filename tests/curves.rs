//! Curves from the outside: what strands cover as a texel, and the real files of hair, tracts and neurons.

use std::path::PathBuf;

use assert_cmd::Command;
use vtex::Warnings;
use vtex::bake::{self, Options};
use vtex::format::{Limits, Reader};
use vtex::geom::{DVec3, directions13};
use vtex::progress::Quiet;
use vtex::source;
use vtex::source::{CurveOptions, CurveSource, Section, Strand};
use vtex::volume::{Octree, Volume};

use super::bake::area;
use super::readable;

fn baked(strands: Vec<Strand>, resolution: u32) -> Volume {
    let source = CurveSource::new(strands, &CurveOptions::default(), 0.0, Warnings::default());
    let options = Options { resolution, ..Options::default() };
    readable::readable(bake::bake(&source, &options, &Quiet, &mut |_| ()).unwrap().0)
}

/// Strands from corner to corner of a tilted sheet in the unit cube, `width` wide.
fn fence(count: usize, width: f64, section: Section) -> Vec<Strand> {
    let strand = |i: usize| {
        let x = (i as f64 + 0.37) / count as f64;
        let points = vec![DVec3::new(x, 0.0, 0.3), DVec3::new(0.9 * x + 0.05, 1.0, 0.6)];
        Strand { points, radii: vec![0.5 * width as f32], section, ..Strand::default() }
    };
    (0..count).map(strand).collect()
}

/// The silhouette along `dir` (texel space) of round strands that hide nothing of each other.
fn silhouette(strands: &[Strand], dir: DVec3) -> f64 {
    // Texel space is (x, −z, y).
    let w = DVec3::new(dir.x, dir.z, -dir.y);
    let one = |s: &Strand| 2.0 * f64::from(s.radii[0]) * (s.points[1] - s.points[0]).cross(w).length();
    strands.iter().map(one).sum()
}

#[test]
fn thin_strands_cover_their_width_at_every_resolution() {
    // .13, .5 and 2 voxels wide; the thinnest are triangles, which show 7 % more or less of one side at their own roll.
    let strands = fence(8, 0.008, Section::Round);
    // Strands that cross from block to block cast one shadow, which one factor for all directions cannot say: .092 at 64, along an axis.
    for (resolution, allowed) in [(16, 0.12), (64, 0.1), (256, 0.04)] {
        let volume = baked(strands.clone(), resolution);
        let size = volume.info.bounds.size().x;
        let tree = Octree::new(volume).unwrap();
        for dir in [DVec3::Y, DVec3::NEG_Y, DVec3::new(0.0, 1.0, 0.4).normalize()] {
            let got = area(&tree, dir, resolution.trailing_zeros() as usize, 1200) * size * size;
            let want = silhouette(&strands, dir);
            assert!((got / want - 1.0).abs() < allowed, "{resolution} {dir}: {}", got / want);
        }
    }
}

#[test]
fn strands_thinner_than_the_lattice_are_not_counted_twice() {
    // A 200th of a voxel wide: most fall between the lines that coverage is measured along.
    let strands = fence(40, 0.0003, Section::Round);
    let volume = baked(strands.clone(), 16);
    let size = volume.info.bounds.size().x;
    let tree = Octree::new(volume).unwrap();
    for dir in directions13().into_iter().filter(|d| d.y.abs() > 0.5) {
        let got = area(&tree, dir, 4, 400) * size * size;
        let want = silhouette(&strands, dir);
        // Triangles at their own rolls: 7 % either way for one, and rates are levelled over 13 directions.
        assert!((got / want - 1.0).abs() < 0.12, "{dir}: {}", got / want);
    }
}

#[test]
fn sections_cover_what_they_should_from_above() {
    // Level strands: a ribbon and a V show their width from above, and a V of 90 degrees half of it from the side.
    let level = |section| {
        let strand = |i: usize| {
            let z = (i as f64 + 0.4) / 4.0;
            let points = vec![DVec3::new(0.0, 0.5, z), DVec3::new(1.0, 0.5, z)];
            Strand { points, radii: vec![0.02], section, ..Strand::default() }
        };
        (0..4).map(strand).collect::<Vec<_>>()
    };
    let right = std::f32::consts::FRAC_PI_2;
    let flat = Section::Rectangular { thickness: 0.0 };
    let bar = Section::Rectangular { thickness: 0.5 };
    for (section, above, beside) in [(flat, 0.16, 0.0), (Section::V { angle: right }, 0.16, 0.02), (bar, 0.16, 0.02)] {
        let volume = baked(level(section), 128);
        let size = volume.info.bounds.size().x;
        let tree = Octree::new(volume).unwrap();
        let down = area(&tree, DVec3::NEG_Z, 7, 1000) * size * size;
        let side = area(&tree, DVec3::Y, 7, 1000) * size * size;
        assert!((down / above - 1.0).abs() < 0.04, "{section:?} {down}");
        // All four are behind one another; a sheet's SGGX keeps a hundredth.
        assert!((side - beside).abs() < 0.004, "{section:?} {side}");
    }
}

#[test]
fn point_files_of_others_are_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["a.bgeo", "b.geo", "c.PDB"] {
        let path = dir.path().join(name);
        std::fs::write(&path, b"PGEOMETRY V5").unwrap();
        let error = source::open(&path, &source::OpenOptions::default()).err().unwrap().to_string();
        assert!(error.contains("Partio") && error.contains(".csv"), "{error}");
    }
}

fn assets() -> Option<PathBuf> {
    std::env::var_os("VTEX_ASSETS").map(|a| PathBuf::from(a).join("curves"))
}

#[test]
fn real_hair_tracts_and_neurons_bake() {
    let Some(assets) = assets() else { return };
    let dir = tempfile::tempdir().unwrap();
    let output = dir.path().join("out.vtex");
    let bake = |file: &str, args: &[&str]| {
        let mut command = Command::new(assert_cmd::cargo::cargo_bin("vtex"));
        let done = command
            .arg("bake")
            .arg(assets.join(file))
            .arg("-o")
            .arg(&output)
            .args(["-r", "64"])
            .args(args)
            .output()
            .unwrap();
        assert!(done.status.success(), "{file}: {}", String::from_utf8_lossy(&done.stderr));
        readable::verify(&output);
        Reader::open(&output, &Limits::default()).unwrap().read_all().unwrap()
    };
    let (a, b) = (bake("hair/mohawk_557strands.hair", &[]), bake("hair/mohawk_279strands.csv", &["--width", "0.0008"]));
    // The same head, and half of its hair.
    assert!((a.info.bounds.size().x / b.info.bounds.size().x - 1.0).abs() < 0.1);
    assert!(a.info.channels.albedo && !b.info.channels.albedo);
    let (a, b) = (bake("hair/neuron722817260.hair", &[]), bake("swc/722817260.swc", &[]));
    assert!((a.info.bounds.size().x / b.info.bounds.size().x - 1.0).abs() < 0.01);
    let voxels = |v: &Volume| v.depths.last().unwrap().voxels.len() as f64;
    assert!((voxels(&a) / voxels(&b) - 1.0).abs() < 0.1, "{} {}", voxels(&a), voxels(&b));
    // One tract, in both formats the same millimetres.
    let thin = ["--width", "0.05"];
    let (a, b) = (bake("streamlines/standard.trk", &thin), bake("streamlines/standard.tck", &thin));
    assert_eq!(a.info.metres_per_unit, 1e-3);
    assert!((a.info.bounds.min - b.info.bounds.min).length() < 1e-3, "{:?} {:?}", a.info.bounds, b.info.bounds);
    assert_eq!(voxels(&a), voxels(&b));
    assert!(
        bake("streamlines/complex.trk", &["--width", "0.5", "--curve", "catmull-rom", "--section", "v"])
            .info
            .channels
            .albedo
    );
}
