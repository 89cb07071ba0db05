//! Small stacks that are written here, in every format, whole and broken.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::*;
use crate::source::traits::Source;

mod choices;
mod dicom_packed;
mod dicoms;
mod formats;
mod missing;
mod surface;
mod tiffs;
mod writers;

/// 4 × 3 × 2 samples: x + 10 y + 100 z.
fn numbers() -> Vec<i16> {
    (0..24).map(|n| n % 4 + 10 * (n / 4 % 3) + 100 * (n / 12)).collect()
}

fn little() -> Vec<u8> {
    numbers().iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut packer = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packer.write_all(bytes).unwrap();
    packer.finish().unwrap()
}

struct Dir(tempfile::TempDir);

impl Dir {
    fn new() -> Dir {
        Dir(tempfile::tempdir().unwrap())
    }

    fn save(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

fn open(path: &Path) -> Result<Stack> {
    read(path, &StackOptions::default(), 1 << 20)
}

fn error(path: &Path) -> String {
    open(path).err().map(|e| e.to_string()).unwrap_or_else(|| panic!("{} is taken", path.display()))
}

/// All values of the stack, rows in order.
fn values(stack: &Stack) -> Vec<f32> {
    let [x, y, z] = stack.samples.dims();
    let mut out = vec![0.0; x * y * z];
    for (n, row) in out.chunks_mut(x).enumerate() {
        stack.samples.row(0, n % y, n / y, row);
    }
    out
}

fn expect(path: &Path, map: impl Fn(DVec3) -> DVec3) {
    let stack = open(path).unwrap();
    assert_eq!(stack.samples.dims(), [4, 3, 2], "{}", path.display());
    assert_eq!(values(&stack), numbers().iter().map(|v| f32::from(*v)).collect::<Vec<_>>(), "{}", path.display());
    for p in [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z] {
        let got = stack.affine.transform_point3(p);
        assert!((got - map(p)).length() < 1e-5, "{}: {p} is at {got}", path.display());
    }
}

const NRRD: &str = "NRRD0004\n# by hand\ntype: short\ndimension: 3\nsizes: 4 3 2\nspace: left-posterior-superior\n\
    space directions: (0,2,0) (-3,0,0) (0,0,4)\nspace origin: (10,20,30)\nendian: little\n";

fn nrrd_place(p: DVec3) -> DVec3 {
    DVec3::new(10.0 - 3.0 * p.y, 20.0 + 2.0 * p.x, 30.0 + 4.0 * p.z)
}

/// Open with `--channel` and `--frame`.
fn open_with(path: &Path, channel: Option<&str>, frame: Option<usize>) -> Result<Stack> {
    let options = StackOptions { channel: channel.map(str::to_owned), frame, ..StackOptions::default() };
    read(path, &options, 1 << 20)
}
