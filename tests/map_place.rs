//! `vtex map` places rigid copies: by numbers, by pictures, by tables, and on grounds that are pictures of heights.

use std::path::Path;

use assert_cmd::Command;
use vtex::format;
use vtex::geom::{Aabb, DVec3};
use vtex::scene::Scene;
use vtex::scene::gltf::{self, ReadOptions};
use vtex::volume::{Depth, Info, Volume, Voxel};

/// A texel of one voxel, `size` metres wide and high.
fn texel(path: &Path, size: f64) {
    let half = size / 2.0;
    let bounds = Aabb::new(DVec3::new(-half, 0.0, -half), DVec3::new(half, size, half));
    let info = Info { bounds, facet_size: 0.01, ..Info::default() };
    let depths = vec![Depth { masks: vec![0], voxels: vec![Voxel::default()], mixes: Vec::new() }];
    format::write(&Volume { info, depths }, path, &Default::default()).unwrap();
}

fn vtex(folder: &Path, line: &str) -> assert_cmd::assert::Assert {
    Command::cargo_bin("vtex").unwrap().current_dir(folder).args(line.split_whitespace()).assert()
}

fn read(folder: &Path) -> Scene {
    gltf::read(&folder.join("out.glb"), &ReadOptions::default()).unwrap()
}

/// Where copies stand, with the name of their texel, and how high they are for a texel of a metre.
fn copies(scene: &Scene) -> Vec<(String, DVec3, f64)> {
    let mut all = Vec::new();
    for set in &scene.copies {
        let name = &scene.texels[set.variants[0].texel].name;
        all.extend((0..set.len()).map(|i| {
            let map = set.to_world * set.local(i);
            (name.clone(), map.translation, map.matrix3.y_axis.length())
        }));
    }
    all
}

/// A 16-bit picture.
fn png(path: &Path, width: u32, height: u32, at: impl Fn(u32, u32) -> f64) {
    let shade = |x, y| image::Luma([(at(x, y) * 65535.0).round() as u16]);
    image::ImageBuffer::from_fn(width, height, shade).save(path).unwrap();
}

/// A folder with a texel of a metre, and a ground of 128 m each way: level in the west, rising from x = 0 on by 1 in 1.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    texel(&dir.path().join("t.vtex"), 1.0);
    // Pixels are 2 m wide, their middles at −63, −61, …
    png(&dir.path().join("ground.png"), 64, 64, |x, _| ((2.0 * f64::from(x) - 63.0).max(0.0)) / 64.0);
    dir
}

const GROUND: &str = "map ground.png --pixel 2 --relief 0,64 --texel t.vtex -o out.glb";

#[test]
fn a_picture_of_heights_is_a_ground() {
    let dir = folder();
    vtex(dir.path(), &format!("{GROUND} --density 0.05/m2 --height-along 0,1,0")).success();
    let scene = read(dir.path());
    let part = &scene.model.parts[0];
    assert_eq!((part.positions.len(), part.triangles.len()), (64 * 64, 2 * 63 * 63));
    let [x, y, z] = part.positions[64 * 64 - 1];
    // Codes of 16 bits are a thousandth of 64 m apart.
    assert!(part.positions[0] == [-63.0, 0.0, -63.0] && x == 63.0 && z == 63.0 && (y - 63.0).abs() < 5e-4, "{y}");
    let all = copies(&scene);
    // 126 m each way, half of it steeper by √2, to a copy.
    let wanted = 0.05 * 63.0 * 126.0 * (1.0 + 2.0f64.sqrt());
    // The last copies may find no room between the others.
    assert!(all.len() as f64 > 0.99 * wanted && all.len() as f64 <= wanted.round(), "{} {wanted}", all.len());
    // The ground rises from the pixel at −1 m, of height 0, to that at 1 m.
    for (_, at, _) in &all {
        let height = if at.x > 1.0 { at.x } else { ((at.x + 1.0) / 2.0).max(0.0) };
        assert!((at.y - height).abs() < 2e-3, "{at}");
    }
}

#[test]
fn slopes_and_altitudes_are_limits() {
    let dir = folder();
    let all = |more: &str| {
        vtex(dir.path(), &format!("{GROUND} --density 0.2/m2 {more}")).success();
        copies(&read(dir.path()))
    };
    let level = all("--slope 0..30");
    // 62 m of level ground by 126, each with its copy per 5 m², and a strip of 2 m that rises by 27 degrees, before the soft edge.
    let expected = 0.2 * 126.0 * (62.0 + 5.0f64.sqrt());
    // Independent points of which 43 % lie there would vary by 30; discs vary less.
    assert!((level.len() as f64 - expected).abs() < 90.0, "{} {expected}", level.len());
    assert!(level.iter().all(|c| c.1.x < 1.0));
    assert!(all("--slope 35..").iter().all(|c| c.1.x > 0.99));
    let high = all("--altitude 20..40");
    // Soft edges of .04 · 63 m to both sides.
    assert!(high.iter().all(|c| (17.4..=42.6).contains(&c.1.y)));
    let inside = high.iter().filter(|c| (22.6..=37.4).contains(&c.1.y)).count() as f64;
    // Full density between the edges: 14.8 m of height, √2 along the slope, 126 m wide; discs vary less than chance.
    let expected = 0.2 * 14.8 * 2.0f64.sqrt() * 126.0;
    assert!((inside - expected).abs() < 3.0 * expected.sqrt(), "{inside} {expected}");
    // Only the strip slopes so, and it is no higher than a metre, where the altitude's soft edge ends at 10 − 2.52.
    assert_eq!(all("--slope 5..30 --altitude 10..").len(), 0);
}

#[test]
fn a_picture_thins_copies() {
    let dir = folder();
    png(&dir.path().join("mask.png"), 4, 4, |x, y| if y >= 2 { 0.0 } else { f64::from(x >= 2) * 0.5 + 0.5 });
    let counts = |more: &str| {
        vtex(dir.path(), &format!("{GROUND} --density 0.2/m2 --density-map mask.png {more}")).success();
        let all = copies(&read(dir.path()));
        // Away from where the picture's pixels blend, 16 m to both sides.
        let count = |x: f64, z: f64| {
            let inside = |c: &&(String, DVec3, f64)| (c.1.x - x).abs() < 16.0 && (c.1.z - z).abs() < 16.0;
            all.iter().filter(inside).count() as f64
        };
        [count(-40.0, -40.0), count(40.0, -40.0), count(-40.0, 40.0)]
    };
    for more in ["", "--map-over bounds"] {
        let [half, full, none] = counts(more);
        // 32² m² times .2 of copies, and of the slope √2 as many; thinning is by chance.
        assert!((half - 102.4).abs() < 35.0 && (full - 289.6).abs() < 35.0 && none == 0.0, "{half} {full} {none}");
    }
}

#[test]
fn tables_place_copies() {
    let dir = folder();
    texel(&dir.path().join("fir.vtex"), 2.0);
    let table = "x,y,z,size,turn,tint,texel\n10,20,,6,90,#ff0000,fir\n-30,0,5,,,,t\n900,0,,,,,\n";
    std::fs::write(dir.path().join("trees.csv"), table).unwrap();
    let said = vtex(dir.path(), &format!("{GROUND} --texel fir.vtex --points trees.csv --scale 1")).success();
    let said = String::from_utf8(said.get_output().stderr.clone()).unwrap();
    assert!(said.contains("points beside the ground are left out"), "{said}");
    let scene = read(dir.path());
    let all = copies(&scene);
    let find = |name: &str| all.iter().find(|c| c.0 == name).unwrap();
    assert_eq!(all.len(), 2);
    // North is −z; the fir of 2 m is three times as large, and the ground is 10 m high.
    let (_, at, scale) = find("fir");
    assert!((*at - DVec3::new(10.0, 10.0, -20.0)).length() < 1e-3 && (scale - 3.0).abs() < 1e-5, "{at} {scale}");
    let (_, at, scale) = find("t");
    assert!((*at - DVec3::new(-30.0, 5.0, 0.0)).length() < 1e-4 && (scale - 1.0).abs() < 1e-5, "{at} {scale}");
    let fir = scene.copies.iter().find(|s| scene.texels[s.variants[0].texel].name == "fir").unwrap();
    assert_eq!(fir.tints, [[1.0, 0.0, 0.0]]);
    // A quarter turn counter-clockwise from above takes x to −z.
    let turned = fir.local(0).matrix3 * DVec3::X;
    assert!((turned.normalize() + DVec3::Z).length() < 1e-6, "{turned}");
    // The axes of the scene, and another origin.
    std::fs::write(dir.path().join("trees.csv"), "x,z\n110,-20\n").unwrap();
    let more = "--points trees.csv --points-up y --points-origin 100,0 --scale 1 --orientations identity";
    vtex(dir.path(), &format!("{GROUND} {more}")).success();
    assert!((copies(&read(dir.path()))[0].1 - DVec3::new(10.0, 10.0, -20.0)).length() < 1e-3);
}

#[test]
fn a_geotiff_knows_its_place() {
    use tiff::encoder::{TiffEncoder, colortype};
    use tiff::tags::Tag;
    let dir = folder();
    let mut file = std::fs::File::create(dir.path().join("dem.tif")).unwrap();
    let mut image = TiffEncoder::new(&mut file).unwrap();
    let mut image = image.new_image::<colortype::Gray32Float>(4, 3).unwrap();
    let tags = image.encoder();
    tags.write_tag(Tag::ModelPixelScaleTag, &[10.0f64, 10.0, 0.0][..]).unwrap();
    tags.write_tag(Tag::ModelTiepointTag, &[0.0f64, 0.0, 0.0, 400_000.0, 5_800_000.0, 0.0][..]).unwrap();
    tags.write_tag(Tag::GdalNodata, "-9999").unwrap();
    image.write_data(&[50.0f32, 50.0, 50.0, -9999.0, 60.0, 60.0, 60.0, 60.0, 70.0, 70.0, 70.0, 70.0]).unwrap();
    std::fs::write(dir.path().join("p.csv"), "Easting;Northing;scale\n400010;5799985;1\n").unwrap();
    let said = vtex(dir.path(), "map dem.tif --texel t.vtex --points p.csv -o out.glb").success();
    let said = String::from_utf8(said.get_output().stderr.clone()).unwrap();
    assert!(said.contains("400020.0 east and 5799985.0 north") && said.contains("1 pixels without a height"), "{said}");
    let scene = read(dir.path());
    // Three quads of six: those of the hole are missing.
    assert_eq!(scene.model.parts[0].triangles.len(), 2 * 5);
    assert!((copies(&scene)[0].1 - DVec3::new(-10.0, 60.0, 0.0)).length() < 1e-4, "{:?}", copies(&scene));
    // A second table knows the place from the landscape.
    vtex(dir.path(), "map out.glb --texel t.vtex --points p.csv --add -o out.glb").success();
    assert_eq!(copies(&read(dir.path())).iter().map(|c| c.1.x).collect::<Vec<_>>(), [-10.0, -10.0]);
}

#[test]
fn kinds_have_weights_and_sizes() {
    let dir = folder();
    texel(&dir.path().join("fern.vtex"), 0.5);
    let kinds =
        "--texel fern.vtex --weight 1 --weight 20 --size 9 --size 1 --density 0.5/m2 --scale 1 --tint #808080..#ffffff";
    vtex(dir.path(), &format!("{GROUND} --slope ..10 {kinds}")).success();
    let scene = read(dir.path());
    let all = copies(&scene);
    let of = |name: &str| all.iter().filter(|c| c.0 == name).collect::<Vec<_>>();
    let (trees, ferns) = (of("t"), of("fern"));
    // 62 × 126 m of level ground, of the whole density one in 21.
    let expected = 0.5 * 62.0 * 126.0 / 21.0;
    assert!((trees.len() as f64 - expected).abs() < 4.0 * expected.sqrt(), "{} {expected}", trees.len());
    assert!((ferns.len() as f64 / trees.len() as f64 - 20.0).abs() < 2.5, "{}", ferns.len());
    assert!(trees.iter().all(|c| (c.2 - 9.0).abs() < 1e-4) && ferns.iter().all(|c| (c.2 - 2.0).abs() < 1e-4));
    // The wide ones keep their distance: .7 of √(1/density) by their share of the mean width.
    let mean = ((81.0 + 20.0) / 21.0f64).sqrt();
    let least = 0.7 * 9.0 / mean / 0.5f64.sqrt();
    for (i, a) in trees.iter().enumerate() {
        assert!(trees[..i].iter().all(|b| a.1.distance(b.1) >= 0.999 * least));
    }
    let tints = scene.copies.iter().flat_map(|s| &s.tints);
    assert_eq!(tints.clone().count(), all.len());
    let low = f64::from(vtex::scene::texture::srgb_to_linear(128)) as f32;
    assert!(tints.clone().all(|t| t[0] >= low && t[0] <= 1.0 && t[0] == t[1]));
    // The same again, and another seed another spread.
    let places = |seed: u32| {
        vtex(dir.path(), &format!("{GROUND} --slope ..10 {kinds} --seed {seed}")).success();
        copies(&read(dir.path())).iter().map(|c| c.1.to_array()).collect::<Vec<_>>()
    };
    assert_eq!(places(0), all.iter().map(|c| c.1.to_array()).collect::<Vec<_>>());
    assert_ne!(places(1), places(2));
}

/// Tints that vary over the land are noise of the copies' material, and no copy has one of its own; shells say the same.
#[test]
fn tints_in_patches_are_noise() {
    let dir = folder();
    for how in ["--density 0.1/m2", "--bend"] {
        vtex(dir.path(), &format!("{GROUND} {how} --tint 0.5,1,1..1,2,1 --tint-patches 40 --seed 3")).success();
        let scene = read(dir.path());
        assert!(scene.copies.iter().all(|s| s.tints.is_empty()));
        let of_copies = scene.copies.iter().flat_map(|s| &s.variants).map(|v| &v.phong);
        let layers = scene.model.materials.iter().filter_map(|m| m.shell.as_ref()).flat_map(|s| &s.layers);
        let phongs: Vec<_> = of_copies.chain(layers.map(|l| &l.phong)).collect();
        assert!(!phongs.is_empty());
        for phong in phongs {
            let noise = phong.variations[0].noise.as_ref().unwrap();
            assert_eq!(noise.diffuse, [[0.5, 1.0, 1.0], [1.0, 2.0, 1.0]]);
            assert_eq!(noise.space, vtex::scene::phong::NoiseSpace::World);
            assert_eq!(noise.noise.frequency.to_array(), [1.0 / 40.0, 0.0, 1.0 / 40.0]);
        }
    }
}

#[test]
fn what_is_wrong_is_one_line() {
    let dir = folder();
    png(&dir.path().join("mask.png"), 2, 2, |_, _| 1.0);
    let mut nan = image::ImageBuffer::<image::Luma<f32>, Vec<f32>>::new(2, 2);
    nan.put_pixel(1, 0, image::Luma([f32::NAN]));
    let mut file = std::fs::File::create(dir.path().join("nan.tif")).unwrap();
    let mut tiff = tiff::encoder::TiffEncoder::new(&mut file).unwrap();
    tiff.write_image::<tiff::encoder::colortype::Gray32Float>(2, 2, &nan.into_raw()).unwrap();
    std::fs::write(dir.path().join("no_x.csv"), "y,z\n1,2\n").unwrap();
    std::fs::write(dir.path().join("elm.csv"), "x,y,texel\n1,2,elm\n").unwrap();
    std::fs::write(dir.path().join("far.csv"), "x,y\n5e5,2\n").unwrap();
    std::fs::write(dir.path().join("t.png"), b"no picture").unwrap();
    for (line, code, what) in [
        ("--density-map nan.tif", 1, "nan.tif: column 2, row 1: is no number"),
        ("--density-map none.png", 1, "none.png"),
        ("--points no_x.csv", 1, "no_x.csv: line 1: no column is named x"),
        ("--points elm.csv", 1, "elm.csv: line 2: no texel is named `elm`; there are: t"),
        ("--points far.csv", 1, "no point lies on the ground, which is x -63.0 to 63.0"),
        ("--slope 30..10", 2, "from less to more"),
        ("--slope 30", 2, ".."),
        ("--altitude a..", 2, "not a number"),
        ("--weight 1 --weight 2", 2, "--weight is given once for each --texel"),
        ("--size 1 --size 2", 2, "--size is given once for all"),
        ("--weight 0", 2, "above 0"),
        ("--bend --slope 0..10", 2, "--slope is for rigid copies"),
        ("--tint #12", 2, "not a colour"),
        ("--tint-patches 5", 2, "--tint"),
        ("--tint #808080..#ffffff --tint-patches 0", 2, "above 0"),
    ] {
        let assert = vtex(dir.path(), &format!("{GROUND} {line}")).code(code);
        let error = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
        assert!(error.contains(what), "{line}: {error}");
        assert!(code == 2 || error.lines().count() == 1, "{line}: {error}");
        assert!(!dir.path().join("out.glb").exists());
    }
    for (line, what) in [
        ("map ground.png --texel t.vtex -o out.glb", "--pixel"),
        ("map ground.png --pixel 1 --texel t.vtex -o out.glb", "--relief"),
        ("map nan.tif --pixel 1 --relief 0,1 --texel t.vtex -o out.glb", "without --relief"),
        ("map t.png --pixel 1 --relief 0,1 --texel t.vtex -o out.glb", "t.png: is neither a PNG nor a TIFF"),
        ("map nan.tif --pixel 1 --texel t.vtex -o out.glb", "no four neighbouring pixels"),
    ] {
        let assert = vtex(dir.path(), line).failure();
        let error = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
        assert!(error.contains(what) && error.lines().count() == 1, "{line}: {error}");
    }
}
