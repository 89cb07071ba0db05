//! The conformance vectors of `format-spec/vectors`: made by a program that shares no code with this reader.

use std::path::{Path, PathBuf};

use vtex::Error;
use vtex::format::{Limits, Reader, verify};
use vtex::geom::{Mat3, Vec3};
use vtex::march::shade::Shader;
use vtex::render::{DepthChoice, MarchSegment, MarchStats, Sink, VoxelHit, march, transmittance};
use vtex::volume::brightness::BrightnessFactors;
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
    assert!(files.len() >= 24, "{}", files.len());
    for path in files {
        verify(&path).unwrap_or_else(|e| panic!("{e}"));
        let reader = Reader::open(&path, &Limits::default()).unwrap();
        let text = std::fs::read_to_string(path.with_extension("txt")).unwrap();
        let wanted: Vec<&str> =
            text.lines().filter(|line| !line.starts_with("ray ") && !line.starts_with("eye ")).collect();
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

/// A camera's ray, which needs no list of what it meets.
struct Camera;

impl Sink for Camera {
    const IS_CAMERA: bool = true;
    fn voxel(&mut self, _: &VoxelHit<'_>) {}
}

/// The mean projected area over all directions is a cubature's, up to 4 % off for sheets: a share of facets is then off by up to .02
/// where it is not clamped, and the share of single-sided facets is kept to 1/510. T is off by at most exp(−τ) τ, 1/e, times
/// the relative error of τ; and what lets less than 1/512 through lets nothing through.
#[test]
fn eyes_see_some_facets_from_one_side_alone() {
    let (mut eyes, mut apart) = (0, 0);
    for path in vectors("ok-") {
        let text = std::fs::read_to_string(path.with_extension("txt")).unwrap();
        let reader = std::sync::Arc::new(Reader::open(&path, &Limits::default()).unwrap());
        let tree = Octree::new(reader).unwrap();
        let mut light = f64::NAN;
        for line in text.lines() {
            let Some((kind, given)) = line.split_once(' ').filter(|(kind, _)| ["ray", "eye"].contains(kind)) else {
                continue;
            };
            let n: Vec<f64> = given.split(' ').map(|n| n.parse().unwrap()).collect();
            if kind == "ray" {
                light = n[7];
                continue;
            }
            let at = |i: usize| Vec3::new(n[i] as f32, n[i + 1] as f32, n[i + 2] as f32);
            let footprint = (-n[6]).exp2() as f32;
            let segment =
                MarchSegment { origin: at(0), dir: at(3), length: 8.0, footprint, growth: 0.0, opacity_scale: 1.0 };
            let found = march(&tree, &segment, DepthChoice::default(), 1.0, &mut Camera, &mut MarchStats::default());
            assert!((f64::from(found) - n[7]).abs() < 0.02, "{}: {line}: {found}", path.display());
            eyes += 1;
            apart += usize::from((n[7] - light).abs() > 0.1);
        }
    }
    assert!(eyes >= 30 && apart >= 5, "{eyes} {apart}");
}

/// R6 to R8: what is seen of a voxel is lit as the vectors say. Eight normals stand for all: of ten thousand random lobes the worst
/// was .071 off, and weights of one side leave fewer of them.
#[test]
fn voxels_are_lit_as_the_text_says() {
    const CUBATURE: f32 = 0.1;
    let text = include_str!("../format-spec/vectors/shading-1.txt");
    let (mut seen, mut lamps, mut squares) = (0, 0, 0.0);
    for line in text.lines() {
        let (given, wanted) = line.split_once(" → ").unwrap();
        let (kind, given) = given.split_once(' ').unwrap();
        let numbers = |text: &str| text.split(' ').map(|n| n.parse::<f32>().unwrap()).collect::<Vec<_>>();
        let (n, wanted) = (numbers(given), numbers(wanted));
        let at = |i: usize| Vec3::new(n[i], n[i + 1], n[i + 2]);
        if kind == "lamp" {
            let found = BrightnessFactors::new([0, 1, 2].map(|i| n[i].into())).at_cosine(n[3]);
            // Factors are kept to a step of 1/256.
            assert!((found - wanted[0]).abs() < 3e-3, "{line}: {found}");
            lamps += 1;
            continue;
        }
        let voxel = Voxel {
            ndf: [0, 1, 2, 3, 4, 5].map(|i| if i < 3 { n[i] as u8 } else { (n[i] + 128.0) as u8 }),
            correlation: (n[6] as u8) << 4,
            mean_normal: [n[7] as u8, n[8] as u8],
            ..Voxel::default()
        };
        let jacobian = Mat3::from_cols(at(9), at(12), at(15)).transpose();
        let cofactors = jacobian.inverse().transpose() * jacobian.determinant();
        let (view, light) = (at(18).normalize(), at(21).normalize());
        for (light, wanted) in [light, -light].into_iter().zip(&wanted) {
            let mut groups = Vec::new();
            let lights = [light];
            let mut shader = Shader::new(view, &lights, Some(cofactors), Vec3::ONE, &[], &mut groups);
            shader.voxel(&VoxelHit { t: 0.0, weight: 1.0, depth: 0, voxel: &voxel, rank: 0, position: Vec3::ZERO });
            shader.finish();
            let found: f32 = groups.iter().map(|g| g.energy.x).sum();
            assert!((found - wanted).abs() < CUBATURE, "{line}: {found} for {wanted}");
            squares += (found - wanted).powi(2);
            seen += 1;
        }
    }
    assert!(seen > 90 && lamps > 10, "{seen} {lamps}");
    // The root of the mean square of random lobes is .014, of one-sided ones more.
    assert!((squares / seen as f32).sqrt() < 0.03, "{}", (squares / seen as f32).sqrt());
}

/// The table of `rules.md` names every vector that there is.
#[test]
fn the_table_of_rules_is_whole() {
    let rules = include_str!("../format-spec/rules.md");
    let mut count = std::collections::BTreeMap::new();
    for path in vectors("bad-") {
        let (code, _) = path.file_stem().unwrap().to_str().unwrap()[4..].rsplit_once('-').unwrap();
        *count.entry(code.to_owned()).or_insert(0) += 1;
    }
    for (code, count) in count {
        let row = rules.lines().find(|line| line.starts_with(&format!("| `{code}` |"))).unwrap();
        let cell = row.split('|').nth(3).unwrap().trim();
        let wanted = if count == 1 { "1".to_owned() } else { format!("1 … {count}") };
        assert_eq!(cell, wanted, "{code}");
    }
    for path in vectors("ok-") {
        let name = &path.file_stem().unwrap().to_str().unwrap()[3..];
        let group = name.rsplit_once('-').map_or(name, |(group, _)| group);
        let is_named = rules.contains(&format!("`{name}`")) || rules.contains(&format!("`{group}-…`"));
        assert!(is_named || name.starts_with("filter-"), "{name}");
    }
}

/// What `format-spec/vtex-1.md` calls the text of a texel.
pub fn listing(volume: &Volume) -> Vec<String> {
    let info = &volume.info;
    let cyclic: u8 = (0..3).map(|k| u8::from(info.cyclic[k]) << k).sum();
    let model = format!("{:?}", info.model).to_lowercase();
    let mut out = vec![format!("depths {} up {} cyclic {cyclic} model {model}", volume.depths.len(), info.up)];
    let whole = |v: f64| (1e4 * v + 0.5).floor();
    for (i, s) in vtex::volume::surface::read(info).iter().enumerate() {
        let [r, g, b] = s.transmission.map(whole);
        out.push(format!("surface {i} {r} {g} {b} {} {}", whole(s.unlit), whole(s.one_sided)));
    }
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
