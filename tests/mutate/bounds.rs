//! Inputs of a few kilobytes that would take gigabytes: each is refused before the memory is taken.

use std::io::Cursor;
use std::path::Path;

use vtex::Error;

use crate::memory::{alone, peak};
use crate::mutators::gzip;
use crate::run::{Command, MAX_MEMORY, MEMORY, run};
use crate::seeds::put;
use crate::small;

/// A black picture of a byte a pixel, 8192 pixels wide and more high: twice the memory, in some 70 kB.
fn wide_png() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image::GrayImage::new(8192, 8200).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

fn wide_tiff() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let deflate = tiff::encoder::Compression::Deflate(tiff::encoder::DeflateLevel::Fast);
    let mut file = tiff::encoder::TiffEncoder::new(&mut bytes).unwrap().with_compression(deflate);
    file.write_image::<tiff::encoder::colortype::Gray8>(8192, 8192, &vec![0; 1 << 26]).unwrap();
    bytes.into_inner()
}

fn wide_exr(folder: &Path) -> Vec<u8> {
    let path = folder.join("wide.exr");
    exr::prelude::write_rgba_file(&path, 4096, 1024, |_, _| (0f32, 0f32, 0f32, 0f32)).unwrap();
    std::fs::read(path).unwrap()
}

/// Two hundred materials with a picture of 4 MiB each, which is one file.
fn library() -> (String, String) {
    let numbers = 0..200;
    let mut obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n".to_owned();
    numbers.clone().for_each(|n| obj += &format!("usemtl m{n}\nf 1/1 2/1 3/1\n"));
    (obj, numbers.map(|n| format!("newmtl m{n}\nmap_Kd leaf.png\nmap_d leaf.png\n")).collect())
}

/// Ten thousand copies of ten thousand copies of ten thousand.
fn nested() -> String {
    let scatter = "scatter = { count = 10000, min = [-9, 0, -9], max = [9, 0, 9] }";
    let define = |name: &str, of: &str| format!("[define.{name}]\ngroup = [{{ use = \"{of}\", {scatter} }}]\n");
    let leaf = "[define.leaf]\nsphere = { radius = 0.1 }\n";
    [leaf, &define("a", "leaf"), &define("b", "a"), &define("c", "b"), "[[draw]]\nuse = \"c\"\n"].concat()
}

#[test]
fn memory_is_refused_before_it_is_taken() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let png = wide_png();
    let (obj, mtl) = library();
    let leaf = {
        let mut bytes = Cursor::new(Vec::new());
        image::RgbaImage::new(1024, 1024).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        bytes.into_inner()
    };
    let [gltf, _] = small::grounds();
    let files = |list: &[(&str, &[u8])]| list.iter().map(|(n, b)| ((*n).to_owned(), b.to_vec())).collect::<Vec<_>>();
    let bake = Command::Bake;
    // What is opened, and the files.
    let all = [
        ("slice", bake, "s", files(&[("s/0.png", &png), ("s/1.png", &png)])),
        ("tiff", bake, "a.tif", files(&[("a.tif", &wide_tiff())])),
        ("exr", bake, "a.exr", files(&[("a.exr", &wide_exr(folder.path()))])),
        ("glTF", bake, "a.gltf", files(&[("a.gltf", &gltf), ("ground.bin", &small::corners()), ("grass.png", &png)])),
        (
            "mtl",
            bake,
            "a.obj",
            files(&[("a.obj", small::OBJ.as_bytes()), ("a.mtl", small::MTL.as_bytes()), ("leaf.png", &png)]),
        ),
        ("library", bake, "a.obj", files(&[("a.obj", obj.as_bytes()), ("a.mtl", mtl.as_bytes()), ("leaf.png", &leaf)])),
        ("albedo", Command::Albedo, "a.png", files(&[("a.png", &png), ("quad.obj", small::OBJ.as_bytes())])),
        ("compare", Command::Compare, "a.png", files(&[("a.png", &png)])),
        ("curves", bake, "a.csv.gz", files(&[("a.csv.gz", &gzip(&vec![b'\n'; 1 << 27]))])),
        ("scatter", bake, "a.toml", files(&[("a.toml", nested().as_bytes())])),
        ("L-system", bake, "a.lsys", files(&[("a.lsys", b"#iterations 60\naxiom: F\nF -> FF\n")])),
    ];
    for (name, command, main, files) in all {
        let own = folder.path().join(name);
        for (file, bytes) in &files {
            put(&own.join(file), bytes);
        }
        let (result, most) = peak(|| run(command, &own.join(main), 1));
        println!("{name:10} {:>6} MiB of {:>4}: {result:?}", most >> 20, MEMORY >> 20);
        assert!((most as u64) < MAX_MEMORY, "{name} takes {} MiB", most >> 20);
        assert!(matches!(result, Err(Error::Limit { .. })), "{name}: {result:?}");
    }
}
