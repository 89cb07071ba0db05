//! Texels of few voxels: what they cover is that of their source, whatever it is read from.

use std::path::Path;

use vtex::bake::{self, Options};
use vtex::geom::DVec3;
use vtex::progress::Quiet;
use vtex::source::stack::TransferSpec;
use vtex::source::{self, OpenOptions, StackOptions};
use vtex::volume::Octree;

use crate::bake::area;

/// A ball of radius 1 around 0 as a shape, as samples, as a cylinder's worth of strands, and as soft matter that hides as much.
fn balls(folder: &Path) -> Vec<(&'static str, OpenOptions)> {
    let save = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).unwrap();
    save("shape.toml", b"[[draw]]\nsphere = { radius = 1 }\n");
    save("group.toml", b"[[draw]]\nsphere = { radius = 1 }\n[[draw]]\nsphere = { radius = 0.5 }\n");
    // The cell body of a neuron is a ball.
    save("soma.swc", b"1 1 0 0 0 1 -1\n");
    // 24 samples along the diameter, and two beyond it on each side; 100 at the surface.
    let mut samples =
        b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 28 28 28\nspacings: 1 1 1\nencoding: raw\n\n".to_vec();
    for n in 0..28usize.pow(3) {
        let at = DVec3::new((n % 28) as f64, (n / 28 % 28) as f64, (n / 784) as f64) - 13.5;
        samples.push((100.0 + 10.0 * (12.0 - at.length())).clamp(0.0, 200.0) as u8);
    }
    save("samples.nrrd", &samples);
    let transfer = TransferSpec { iso: Some(100.0), ..TransferSpec::default() };
    let stack = StackOptions { transfer, sigma: 0.0, ..StackOptions::default() };
    vec![
        ("shape.toml", OpenOptions::default()),
        ("group.toml", OpenOptions::default()),
        ("soma.swc", OpenOptions::default()),
        ("samples.nrrd", OpenOptions { stack, ..OpenOptions::default() }),
    ]
}

#[test]
fn a_ball_covers_as_much_in_one_voxel_as_in_many() {
    let folder = tempfile::tempdir().unwrap();
    // Of a circle as wide as the cube.
    let want = 0.25 * std::f64::consts::PI;
    for (name, open) in balls(folder.path()) {
        let source = source::open(&folder.path().join(name), &open).unwrap();
        let mut root = None;
        for resolution in [16, 8, 4, 2, 1] {
            let options = Options { resolution, up: source.up(), calibrate: false, ..Options::default() };
            let (volume, report) = bake::bake(&*source, &options, &Quiet, &mut |_| ()).unwrap();
            assert_eq!((volume.resolution(), report.depths.len()), (resolution, volume.depths.len()), "{name}");
            let volume = crate::readable::readable(volume);
            if resolution != 8 {
                // What is few is measured at 16.
                let own = volume.depths[0].voxels[0];
                assert_eq!(*root.get_or_insert(own), own, "{name} {resolution}");
            }
            let tree = Octree::new(volume).unwrap();
            for dir in [DVec3::X, DVec3::Z, DVec3::new(1.0, 1.0, 0.0), DVec3::ONE] {
                let got = area(&tree, dir.normalize(), 0, 64);
                // One voxel stands for the ball from every side: a box of matter, seen along an axis or a diagonal, whose rate is a
                // compromise of 13 directions, in codes 4.4 % apart. A full cube would be 27 % off.
                assert!((got / want - 1.0).abs() < 0.06, "{name} {resolution} {dir}: {got:.4} {want:.4}");
            }
        }
    }
}
