//! Image stacks from the outside: agreement with meshes and among formats, real files, placement in millimetres.

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use vtex::bake::{self, Options};
use vtex::geom::{Aabb, DVec3};
use vtex::progress::Quiet;
use vtex::render::{DepthChoice, MarchSegment, MarchStats, transmittance};
use vtex::source;
use vtex::source::stack::{self, StackOptions, StackSource, TransferSpec};
use vtex::volume::{Octree, Volume};

use super::readable;

fn volumes() -> Option<PathBuf> {
    std::env::var_os("VTEX_ASSETS").map(|a| PathBuf::from(a).join("volumes"))
}

fn source(path: &Path, options: &StackOptions) -> StackSource {
    StackSource::new(stack::read(path, options, 1 << 28).unwrap(), options).unwrap()
}

fn baked(source: &StackSource, resolution: u32) -> Volume {
    let options = Options { resolution, up: 2, ..Options::default() };
    readable::readable(bake::bake(source, &options, &Quiet, &mut |_| ()).unwrap().0)
}

/// Area that is covered along `dir`, in cube faces, by 96 × 96 rays.
fn area(tree: &Octree, dir: DVec3, depth: usize) -> f64 {
    let (a, b) = dir.any_orthonormal_pair();
    let step = 1.8 / 96.0;
    let mut sum = 0.0;
    for i in 0..96 * 96 {
        let at = |v: usize| (v as f64 + 0.5) * step - 0.9;
        let origin = DVec3::splat(0.5) + at(i % 96) * a + at(i / 96) * b - 2.0 * dir;
        let Some((t0, t1)) = Aabb::UNIT.hit(origin, 1.0 / dir, 0.0, 9.0) else { continue };
        let stretch = MarchSegment {
            origin: (origin + t0 * dir).as_vec3(),
            dir: dir.as_vec3(),
            length: (t1 - t0) as f32,
            footprint: 1.0 / (1u32 << depth) as f32,
            growth: 0.0,
            opacity_scale: 1.0,
        };
        let through = transmittance(tree, &stretch, DepthChoice::default(), 0.0, &mut MarchStats::default());
        sum += 1.0 - f64::from(through);
    }
    sum * step * step
}

fn save_nrrd(path: &Path, n: usize, kind: &str, bytes: impl Iterator<Item = u8>) {
    let mut out = format!(
        "NRRD0004\ntype: {kind}\ndimension: 3\nsizes: {n} {n} {n}\nspacings: 1 1 1\nendian: little\nencoding: raw\n\n"
    )
    .into_bytes();
    out.extend(bytes);
    std::fs::write(path, out).unwrap();
}

#[test]
fn a_sphere_of_256_slices_is_the_sphere() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("sphere.nrrd");
    let n = 256usize;
    let values = (0..n * n * n).flat_map(|i| {
        let p = DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64) - 127.5;
        // Sixteen bits: 500 to a sample's distance, cut off far from the surface.
        ((32768.0 + 500.0 * (120.0 - p.length())).clamp(0.0, 65535.0) as u16).to_le_bytes()
    });
    save_nrrd(&path, n, "ushort", values);
    let options = StackOptions { transfer: TransferSpec::hard(32768.0), ..StackOptions::default() };
    let source = source(&path, &options);
    let size = source::Source::bounds(&source).size();
    // Of the radius, 120, the filter takes .6^2 / 120 = .003.
    assert!((size - 240.0).abs().max_element() < 0.02, "{size}");
    let volume = baked(&source, 64);
    let tree = Octree::new(volume).unwrap();
    let exact = std::f64::consts::PI / 4.0;
    for depth in [4, 6] {
        for dir in
            [DVec3::X, DVec3::Z, DVec3::new(1.0, 1.0, 0.0), DVec3::new(-1.0, 1.0, 1.0), DVec3::new(0.3, 0.5, 0.8)]
        {
            let ratio = area(&tree, dir.normalize(), depth) / exact;
            // A filled ball of 16 voxels covers up to 10 % too much along diagonals, which refining does not change.
            assert!((ratio - 1.0).abs() < if depth == 4 { 0.11 } else { 0.02 }, "{depth} {dir}: {ratio}");
        }
    }
}

#[test]
fn soft_matter_takes_away_what_its_table_says() {
    // A ball of one value: through its middle, 80 samples that each let .98 through: .98^80 = .2.
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cloud.nrrd");
    let n = 96usize;
    let values = (0..n * n * n).flat_map(|i| {
        let p = DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64) - 47.5;
        ((40.0 - p.length() + 0.5).clamp(0.0, 1.0) as f32).to_le_bytes()
    });
    save_nrrd(&path, n, "float", values);
    let table: TransferSpec = serde_json::from_str(
        r#"{"points":[{"value":0,"opacity":0},{"value":1,"opacity":0.02,"colour":[1,0.5,0.25]}]}"#,
    )
    .unwrap();
    let options = StackOptions { transfer: table, ..StackOptions::default() };
    let volume = baked(&source(&path, &options), 32);
    // The colour where the value is 1: at the rim it goes over into the white of value 0.
    let inner = volume.depths.iter().flat_map(|d| &d.voxels).min_by_key(|v| v.albedo[1]).unwrap();
    let albedo = inner.albedo();
    let tree = Octree::new(volume).unwrap();
    let through = |dir: DVec3, depth: usize| {
        let origin = DVec3::splat(0.5) - 2.0 * dir;
        let (t0, t1) = Aabb::UNIT.hit(origin, 1.0 / dir, 0.0, 9.0).unwrap();
        let mut sum = 0.0;
        for i in 0..49 {
            let (a, b) = dir.any_orthonormal_pair();
            let shift = 0.04 * (f64::from(i % 7 - 3) * a + f64::from(i / 7 - 3) * b) / 3.0;
            let stretch = MarchSegment {
                origin: (origin + shift + t0 * dir).as_vec3(),
                dir: dir.as_vec3(),
                length: (t1 - t0) as f32,
                footprint: 1.0 / (1u32 << depth) as f32,
                growth: 0.0,
                opacity_scale: 1.0,
            };
            sum += f64::from(transmittance(&tree, &stretch, DepthChoice::default(), 0.0, &mut MarchStats::default()));
        }
        sum / 49.0
    };
    for dir in [DVec3::X, DVec3::Z, DVec3::new(1.0, 1.0, 0.0).normalize(), DVec3::ONE.normalize()] {
        for depth in [3, 5] {
            let t = through(dir, depth);
            // The rays are spread over a twentieth of the ball: chords of 80 to 79.9. Rates are stored in steps of 9 %.
            assert!((t - 0.98f64.powi(80)).abs() < 0.04, "{depth} {dir}: {t}");
        }
    }
    assert!((f64::from(albedo[1]) - 0.5).abs() < 0.02 && (f64::from(albedo[2]) - 0.25).abs() < 0.02, "{albedo:?}");
}

#[test]
fn a_head_is_the_same_from_every_format() {
    let Some(dir) = volumes() else { return };
    let options = StackOptions { spacing: Some([3.2, 3.2, 1.5]), ..StackOptions::default() };
    let all =
        ["headsq-png16", "headsq_multipage_u16.tif", "headsq.nrrd"].map(|f| baked(&source(&dir.join(f), &options), 32));
    assert_eq!(all[0].info.metres_per_unit, 1e-3);
    for other in &all[1..] {
        // Every voxel, bit for bit, and the same place.
        assert_eq!(other.depths, all[0].depths);
        assert_eq!(other.info.bounds, all[0].info.bounds);
    }
}

#[test]
fn a_slice_is_the_same_however_it_is_packed() {
    let Some(dir) = volumes() else { return };
    let options = StackOptions { transfer: TransferSpec::hard(600.0), ..StackOptions::default() };
    let open = |name: &str| baked(&source(&dir.join("dicom-single").join(name), &options), 32);
    let plain = open("MR_small.dcm");
    for name in ["MR_small_bigendian.dcm", "MR_small_implicit.dcm", "MR_small_RLE.dcm", "MR_small_jp2klossless.dcm"] {
        let other = open(name);
        assert_eq!((other.depths, other.info.bounds), (plain.depths.clone(), plain.info.bounds), "{name}");
    }
}

#[test]
fn headers_place_stacks_in_millimetres() {
    let Some(dir) = volumes() else { return };
    // Everything is matter: bounds are those of the samples' cells.
    let whole = StackOptions { transfer: TransferSpec::hard(-1e9), ..StackOptions::default() };
    let bounds = |name: &str| {
        let s = source(&dir.join(name), &whole);
        assert_eq!(source::Source::metres_per_unit(&s), 1e-3, "{name}");
        source::Source::bounds(&s)
    };
    let near = |a: DVec3, b: [f64; 3]| (a - DVec3::from(b)).length() < 1e-2;
    // 15 slices of 64 × 64, 5 mm apart, the first at z = -17.69.
    let b = bounds("dicom-series-mr");
    assert!((b.min.z + 17.69 + 2.5).abs() < 0.01 && (b.size().z - 75.0).abs() < 0.01, "{b:?}");
    assert!((b.min.x + 118.12 + b.size().x / 128.0).abs() < 0.01, "{b:?}");
    // One slice of 128 × 128 pixels of .661468 mm, 5 mm thick.
    let b = bounds("dicom-single/CT_small.dcm");
    assert!(near(b.size(), [84.668, 84.668, 5.0]), "{b:?}");
    assert!(near(b.min, [-158.135803 - 0.330734, -179.035797 - 0.330734, -75.699997 - 2.5]), "{b:?}");
    // Corners of the outermost samples' cells, by the matrices in the files, worked out by hand.
    for (name, min, max) in [
        ("nifti/standard.nii.gz", [-0.5, -1.5, -1.0], [3.5, 13.5, 13.0]),
        ("nifti/anatomical.nii", [-33.0, -41.0, -17.0], [33.0, 41.0, 33.0]),
        ("nifti/minimal.nii.gz", [-1.5, -1.5, -1.5], [190.5, 190.5, 28.5]),
        ("nifti/f32.nii.gz", [-0.5; 3], [10.5; 3]),
        ("nifti/int16.nii", [-0.5; 3], [2.5; 3]),
        ("nrrd/BallBinary30x30x30.nhdr", [-0.5; 3], [29.5; 3]),
        ("headsq.nrrd", [-102.986, -2.186, -0.75], [176.771, 277.571, 138.75]),
    ] {
        let b = bounds(name);
        assert!(near(b.min, min) && near(b.max, max), "{name} {b:?}");
    }
    // 30 degrees about z: a square of 204.8 mm that is turned.
    let turned = 204.8 * (30f64.to_radians().cos() + 30f64.to_radians().sin());
    assert!(near(bounds("headsq.nrrd").size(), [turned, turned, 139.5]));
}

#[test]
fn files_of_real_writers_are_as_their_writers_meant() {
    let Some(dir) = std::env::var_os("VTEX_ASSETS").map(|a| PathBuf::from(a).join("reported")) else { return };
    let hard = |iso: f64| StackOptions { transfer: TransferSpec::hard(iso), ..StackOptions::default() };
    let open = |name: &str, iso: f64| source(&dir.join(name), &hard(iso));
    let bounds = |s: &StackSource| source::Source::bounds(s);
    let warned = |s: &StackSource| source::Source::warnings(s).as_reasons();
    // Half floats: the box of x 2.5 to 7.5, y 12.5 to 16.5, z 8.5 to 11.5, whose corners the filter rounds by less than a third.
    let b = bounds(&open("tiff/t_f16.tif", 0.5));
    let (min, max) = (DVec3::new(2.5, 12.5, 8.5), DVec3::new(7.5, 16.5, 11.5));
    assert!((b.min - min).abs().max_element() < 0.34 && (b.max - max).abs().max_element() < 0.34, "{b:?}");
    // All of it is matter: sizes are those of the lattice, in millimetres, 20 × 24 × 16 samples of .5 × .5 × 3 µm.
    for name in ["tiff/t_imagej.tif", "tiff/t_z.ome.tif", "tiff/t_hyper.tif"] {
        let s = open(name, -1e9);
        let size = bounds(&s).size() - DVec3::new(0.01, 0.012, 0.048);
        assert!(size.abs().max_element() < 1e-9 && source::Source::metres_per_unit(&s) == 1e-3, "{name} {size}");
        assert_eq!(warned(&s).contains("2 channels"), name.contains("hyper"), "{name}");
    }
    let z = bounds(&open("tiff/T_aniso.tif", 500.0)).size().z;
    // 6 slices of 5 µm, but for what the filter takes.
    assert!((z - 0.03).abs() < 0.004, "{z}");
    assert!(source::Source::has_colour(&open("tiff/t_rgb_jpeg.tif", 100.0)));
    // One echo whole, as it is alone; NaN as zeros.
    for (name, like, iso) in
        [("dicom/d_echo_mix", "dicom/d_echo_ok", 450.0), ("nifti_nan/n_tmap.nii.gz", "nifti_nan/n_tmap0.nii.gz", 3.0)]
    {
        let (a, b) = (baked(&open(name, iso), 32), baked(&open(like, iso), 32));
        assert_eq!((a.info.bounds, a.depths), (b.info.bounds, b.depths), "{name}");
    }
    assert!(warned(&open("dicom/d_echo_mix", 450.0)).contains("echo 2"));
    assert!(!bounds(&open("dicom/d_float.dcm", 0.5)).is_empty());
    assert!(warned(&open("nrrd/i_4d.nrrd", 400.0)).contains("2 frames"));
    let refused = stack::read(&dir.join("nrrd/p_skipgz.nhdr"), &hard(400.0), 1 << 28).err().unwrap().to_string();
    assert!(refused.contains("byte skip -1"), "{refused}");
    // 16 parts are 16 slices.
    assert_eq!(bounds(&open("exr/X_multi2/all.exr", -1e9)).size().z, 16.0);
}

#[test]
fn every_real_stack_bakes_or_is_refused_by_one_line() {
    let Some(dir) = volumes() else { return };
    let out = tempfile::tempdir().unwrap();
    let mut inputs = vec![dir.join("dicom-series-mr"), dir.join("headsq-png16")];
    for folder in [".", "dicom-single", "metaimage", "nifti", "nrrd", "tiff"] {
        let files = std::fs::read_dir(dir.join(folder)).unwrap().map(|e| e.unwrap().path());
        inputs.extend(files.filter(|p| p.is_file() && !p.ends_with("LICENSE")));
    }
    inputs.sort();
    let refused = [(".raw", "its extension is not known")];
    for input in inputs {
        let run = Command::cargo_bin("vtex")
            .unwrap()
            .arg("bake")
            .arg(&input)
            .args(["-r", "16", "-o"])
            .arg(out.path().join("out.vtex"))
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&run.stderr).into_owned();
        let name = input.to_string_lossy().into_owned();
        match refused.iter().find(|r| name.ends_with(r.0)) {
            Some((_, why)) => {
                assert_eq!(run.status.code(), Some(1), "{name}: {text}");
                assert!(text.contains(why) && text.trim_end().lines().count() == 1, "{name}: {text}");
            }
            None => {
                assert!(run.status.success(), "{name}: {text}");
                readable::verify(&out.path().join("out.vtex"));
            }
        }
    }
}

#[test]
fn the_sample_stack_shows_by_window_and_by_iso() {
    let out = tempfile::tempdir().unwrap();
    let sample = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/stacks/shell");
    for (args, name) in [(["--iso", "128"], "hard"), (["--window", "20,200"], "soft")] {
        let path = out.path().join(name);
        let run = Command::cargo_bin("vtex")
            .unwrap()
            .arg("bake")
            .arg(sample)
            .args(["-r", "32", "--spacing", "1,1,2", "-o"])
            .arg(&path)
            .args(args)
            .output()
            .unwrap();
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        readable::verify(&path);
        assert!(path.metadata().unwrap().len() > 1000);
    }
}

/// A stack of more files than META has room to list.
#[test]
fn a_stack_of_3000_slices_is_baked() {
    let dir = tempfile::tempdir().unwrap();
    let slices = dir.path().join("slices");
    std::fs::create_dir(&slices).unwrap();
    for i in 0..3000 {
        let inside = (1000..2000).contains(&i);
        image::GrayImage::from_pixel(2, 2, image::Luma([if inside { 255 } else { 0 }]))
            .save(slices.join(format!("a slice of a long name, as scanners give them {i}.png")))
            .unwrap();
    }
    let run = |args: &[&str]| {
        let output = Command::cargo_bin("vtex").unwrap().args(args).current_dir(dir.path()).assert().success();
        String::from_utf8(output.get_output().stdout.clone()).unwrap()
    };
    run(&["bake", "slices", "--iso", "128", "--sigma", "0", "-r", "32", "-q", "-o", "s.vtex"]);
    run(&["verify", "s.vtex", "-q"]);
    let told: serde_json::Value = serde_json::from_str(&run(&["inspect", "s.vtex", "--json"])).unwrap();
    let sources = told["meta"]["sources"].as_array().unwrap();
    assert_eq!(sources.len(), 2);
    assert_eq!(sources[1]["files"], 2999);
    assert_eq!(sources[1]["sha256"].as_str().map(str::len), Some(64));
}
