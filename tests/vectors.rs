//! The conformance vectors of `format-spec/vectors`: made by a program that shares no code with this reader.

use std::path::{Path, PathBuf};

use vtex::Error;
use vtex::format::{Limits, Reader, verify};
use vtex::geom::Vec3;
use vtex::render::{DepthChoice, MarchSegment, MarchStats, transmittance};
use vtex::volume::{Octree, Volume, Voxel};

fn vectors(kind: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("format-spec/vectors");
    let name = |path: &PathBuf| path.file_name().unwrap().to_string_lossy().into_owned();
    let mut found: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    found.retain(|path| name(path).starts_with(kind) && name(path).ends_with(".vtex"));
    found.sort();
    found
}

#[test]
fn every_bad_vector_breaks_the_rule_of_its_name() {
    let mut codes = std::collections::BTreeSet::new();
    for path in vectors("bad-") {
        let stem = path.file_stem().unwrap().to_str().unwrap();
        let (wanted, _) = stem.strip_prefix("bad-").unwrap().rsplit_once('-').unwrap();
        match verify(&path) {
            Err(Error::Format { code, .. }) => assert_eq!(code, wanted, "{stem}"),
            other => panic!("{stem}: {other:?}"),
        }
        codes.insert(wanted.to_string());
    }
    let listed = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("format-spec/codes")).unwrap();
    let listed = listed.lines().filter(|line| !line.starts_with('#')).filter_map(|line| line.split_whitespace().next());
    assert_eq!(codes.into_iter().collect::<std::collections::BTreeSet<_>>(), listed.map(str::to_string).collect());
}

#[test]
fn every_good_vector_holds_what_its_text_says() {
    let files = vectors("ok-");
    assert!(files.len() >= 18, "{}", files.len());
    for path in files {
        verify(&path).unwrap_or_else(|e| panic!("{e}"));
        let reader = Reader::open(&path, &Limits::default()).unwrap();
        let text = std::fs::read_to_string(path.with_extension("txt")).unwrap();
        let wanted: Vec<&str> = text.lines().filter(|line| !line.starts_with("ray")).collect();
        let found = listing(&reader.read_all().unwrap());
        for (i, (found, wanted)) in found.iter().zip(&wanted).enumerate() {
            assert_eq!(found, wanted, "{} line {}", path.display(), i + 1);
        }
        assert_eq!(found.len(), wanted.len(), "{}", path.display());
    }
}

/// A ray's transmittance in f32 against the vectors' in f64. Rates are at most 2^7 per voxel edge and depths at most 3, so a
/// length that is off by a few roundings of positions up to 2 (2^-22) is off by 2^7 · 2^3 · 2^-22 · 4 = 1e-3 in the worst
/// optical depth, and by no more in T.
#[test]
fn rays_lose_what_the_text_says() {
    let mut rays = 0;
    for path in vectors("ok-") {
        let text = std::fs::read_to_string(path.with_extension("txt")).unwrap();
        let reader = std::sync::Arc::new(Reader::open(&path, &Limits::default()).unwrap());
        let tree = Octree::new(reader).unwrap();
        for line in text.lines().filter_map(|line| line.strip_prefix("ray ")) {
            let numbers: Vec<f64> = line.split(' ').map(|n| n.parse().unwrap()).collect();
            let at = |i: usize| Vec3::new(numbers[i] as f32, numbers[i + 1] as f32, numbers[i + 2] as f32);
            // A cone as wide as a voxel of the depth, which does not grow.
            let footprint = (-numbers[6]).exp2() as f32;
            let segment =
                MarchSegment { origin: at(0), dir: at(3), length: 8.0, footprint, growth: 0.0, opacity_scale: 1.0 };
            let found = transmittance(&tree, &segment, DepthChoice::default(), 0.0, &mut MarchStats::default());
            assert!((f64::from(found) - numbers[7]).abs() < 1e-3, "{}: {line}: {found}", path.display());
            rays += 1;
        }
    }
    assert!(rays > 150, "{rays}");
}

/// What `format-spec/vtex-1.md` calls the text of a texel.
pub fn listing(volume: &Volume) -> Vec<String> {
    let info = &volume.info;
    let cyclic: u8 = (0..3).map(|k| u8::from(info.cyclic[k]) << k).sum();
    let model = format!("{:?}", info.model).to_lowercase();
    let mut out = vec![format!("depths {} up {} cyclic {cyclic} model {model}", volume.depths.len(), info.up)];
    let mut at: Vec<[u32; 3]> = vec![[0; 3]];
    for (d, depth) in volume.depths.iter().enumerate() {
        at.truncate(depth.voxels.len());
        out.push(format!("depth {d} voxels {}", depth.voxels.len()));
        let mut below = Vec::new();
        for (i, (&[x, y, z], voxel)) in at.iter().zip(&depth.voxels).enumerate() {
            let mut row: Vec<i32> = vec![x as i32, y as i32, z as i32];
            row.extend(numbers(voxel));
            if let Some(mix) = depth.mixes.get(i) {
                let share =
                    |id: usize| mix.shares().filter(|s| usize::from(s.0) == id).map(|s| i32::from(s.1)).sum::<i32>();
                row.extend((0..info.materials.len()).map(share));
            }
            let row: Vec<String> = row.iter().map(i32::to_string).collect();
            let mask = depth.masks[i];
            let end = if mask == 0 && d + 1 < volume.depths.len() { " t" } else { "" };
            out.push(row.join(" ") + end);
            let child = |c: u32| [2 * x + (c & 1), 2 * y + (c >> 1 & 1), 2 * z + (c >> 2)];
            below.extend((0..8).filter(|c| mask >> c & 1 != 0).map(child));
        }
        at = below;
    }
    out
}

fn numbers(voxel: &Voxel) -> Vec<i32> {
    let side = voxel.correlation >> 4;
    let mut row = vec![i32::from(voxel.rate)];
    row.extend(voxel.ndf[..3].iter().map(|&b| i32::from(b)));
    row.extend(voxel.ndf[3..].iter().map(|&b| i32::from(b) - 128));
    row.push(i32::from(voxel.correlation & 15));
    row.extend(voxel.support.iter().map(|&b| i32::from(b & 15)));
    row.extend(voxel.support.iter().map(|&b| i32::from(b >> 4)));
    row.push(side.into());
    row.extend(voxel.mean_normal.iter().map(|&b| if side == 0 { 0 } else { i32::from(b) }));
    row.extend(voxel.albedo.iter().map(|&b| i32::from(b)));
    row
}
