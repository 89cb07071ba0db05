//! `vtex bake --if-changed`: contents decide, of every file that is read, and options; times do not.

use std::path::Path;
use std::time::{Duration, SystemTime};

use serde_json::Value;

use crate::outputs::Folder;

/// The summaries of `vtex bake ARGS --if-changed --json`, and what was said.
fn bake(folder: &Folder, args: &[&str]) -> (Vec<Value>, String) {
    let (code, out, err) = folder.run(&[&["bake"], args, &["--if-changed", "--json"]].concat());
    assert_eq!(code, 0, "{args:?}: {err}");
    let value: Value = serde_json::from_slice(&out).unwrap();
    (value.as_array().cloned().unwrap_or_else(|| vec![value]), err)
}

/// Which of the inputs were left as they are.
fn kept(folder: &Folder, args: &[&str]) -> Vec<bool> {
    bake(folder, args).0.iter().map(|summary| summary["unchanged"].as_bool().unwrap()).collect()
}

fn modified(path: &Path) -> SystemTime {
    std::fs::metadata(path).unwrap().modified().unwrap()
}

/// A mesh with a material library and a picture.
fn textured() -> Folder {
    let folder = Folder::of("quad.obj");
    folder.save("m.obj", b"mtllib m.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n");
    folder.save("m.mtl", b"newmtl a\nmap_Kd m.png\n");
    image::RgbImage::from_pixel(2, 2, image::Rgb([20, 120, 30])).save(folder.path("m.png")).unwrap();
    folder
}

#[test]
fn contents_decide_and_not_times() {
    let folder = textured();
    let args = ["m.obj", "-r", "8", "--depfile", "m.d"];
    let (first, said) = bake(&folder, &args);
    assert!(first[0]["unchanged"] == false && said.contains("m.vtex: is not there yet"), "{said}");
    let whole = std::fs::read(folder.path("m.vtex")).unwrap();
    let old = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000);
    std::fs::File::options().write(true).open(folder.path("m.vtex")).unwrap().set_modified(old).unwrap();
    for file in ["m.obj", "m.mtl", "m.png"] {
        // Written anew, with what it had.
        folder.save(file, &std::fs::read(folder.path(file)).unwrap());
    }
    std::fs::remove_file(folder.path("m.d")).unwrap();
    let (again, said) = bake(&folder, &args);
    assert!(again[0]["unchanged"] == true && said.contains("1 of 1 texels are unchanged"), "{said}");
    assert_eq!(modified(&folder.path("m.vtex")), old, "the file is left as it is");
    assert!(folder.path("m.d").exists(), "ninja takes the depfile away each time");
    for key in ["input", "output", "resolution", "voxel_size", "finest_voxels", "file_bytes", "bits_per_finest_voxel"] {
        assert_eq!(first[0][key], again[0][key], "{key}");
    }

    // A file that the library of the mesh names.
    image::RgbImage::from_pixel(2, 2, image::Rgb([20, 120, 31])).save(folder.path("m.png")).unwrap();
    let (changed, said) = bake(&folder, &args);
    assert!(changed[0]["unchanged"] == false && said.contains("m.vtex: m.png has changed"), "{said}");
    assert!(std::fs::read(folder.path("m.vtex")).unwrap() != whole);
    assert_eq!(kept(&folder, &args), [true]);
    // One that was missing, and is there again.
    std::fs::remove_file(folder.path("m.png")).unwrap();
    assert!(bake(&folder, &args).1.contains("m.png is gone"));
    assert_eq!(kept(&folder, &args), [true]);
    image::RgbImage::new(2, 2).save(folder.path("m.png")).unwrap();
    assert!(bake(&folder, &args).1.contains("m.png is new"));
}

/// Without --if-changed a bake writes the bytes that are left as they are.
#[test]
fn the_file_does_not_tell_how_it_was_decided() {
    let folder = textured();
    folder.succeeds(&["bake", "m.obj", "-r", "8", "-o", "a.vtex"]);
    assert_eq!(kept(&folder, &["m.obj", "-r", "8", "-o", "b.vtex"]), [false]);
    assert!(std::fs::read(folder.path("a.vtex")).unwrap() == std::fs::read(folder.path("b.vtex")).unwrap());
    assert_eq!(kept(&folder, &["m.obj", "-r", "8", "-o", "a.vtex"]), [true]);
}

#[test]
fn options_decide_and_limits_do_not() {
    let folder = textured();
    let base = ["m.obj", "-r", "8"];
    assert_eq!(kept(&folder, &base), [false]);
    for limit in [&["--threads", "1"][..], &["--memory", "1G"], &["--quiet"], &["--fill", "auto"], &["--refine", "10"]]
    {
        assert_eq!(kept(&folder, &[&base, limit].concat()), [true], "{limit:?}");
    }
    let others: [&[&str]; 7] = [
        &["--quality", "lean"],
        &["--compress", "3"],
        &["--up", "z"],
        &["--cyclic", "u"],
        &["--albedo", "#ffffff"],
        &["--translucency", "a=0.3"],
        &["--material", "moss"],
    ];
    for other in others {
        let args = [&base, other].concat();
        let (done, said) = bake(&folder, &args);
        assert!(done[0]["unchanged"] == false && said.contains("m.vtex: has other options"), "{other:?}: {said}");
        assert_eq!(kept(&folder, &args), [true], "{other:?}");
    }
}

/// A change in the file of a table is a change, and one in how the file is called is not.
#[test]
fn tables_and_folders_count_by_what_is_in_them() {
    let folder = Folder::of("quad.obj");
    let slices = folder.path("slices");
    std::fs::create_dir(&slices).unwrap();
    let slice = |i: u8, value: u8| {
        let path = slices.join(format!("{i}.png"));
        image::GrayImage::from_pixel(4, 4, image::Luma([value])).save(path).unwrap();
    };
    slice(0, 200);
    slice(1, 200);
    let table = |iso: u8| folder.save("t.json", format!("{{ \"iso\": {iso} }}").as_bytes());
    table(100);
    let args = ["slices", "-r", "8", "--spacing", "1,1,1", "--transfer", "t.json"];
    assert_eq!(kept(&folder, &args), [false]);
    assert_eq!(kept(&folder, &args), [true]);
    table(101);
    assert_eq!(kept(&folder, &args), [false]);
    slice(2, 200);
    assert!(bake(&folder, &args).1.contains("2.png is new"));
    assert_eq!(kept(&folder, &args), [true]);
    slice(1, 201);
    assert_eq!(kept(&folder, &args), [false]);
}

#[test]
fn of_several_inputs_those_that_changed_are_baked() {
    let folder = textured();
    std::fs::create_dir(folder.path("out")).unwrap();
    let args = ["quad.obj", "m.obj", "-r", "8", "-o", "out/"];
    assert_eq!(kept(&folder, &args), [false, false]);
    folder.save("quad.obj", b"v 0 0 0\nv 1 0 0\nv 1 2 0\nf 1 2 3\n");
    let (done, said) = bake(&folder, &args);
    assert_eq!((&done[0]["unchanged"], &done[1]["unchanged"]), (&false.into(), &true.into()));
    assert!(said.contains("1 of 2 texels are unchanged"), "{said}");
    // What is broken is one line, and the other is left as it is.
    std::fs::remove_file(folder.path("quad.obj")).unwrap();
    let (code, _, said) = folder.run(&[&["bake"], &args[..], &["--if-changed"]].concat());
    assert!(code == 1 && said.contains("quad.obj") && said.contains("1 of 2 texels are unchanged"), "{said}");
}

#[test]
fn what_is_not_a_texel_of_this_program_is_baked() {
    let folder = textured();
    let args = ["m.obj", "-r", "8"];
    assert_eq!(kept(&folder, &args), [false]);
    let whole = std::fs::read(folder.path("m.vtex")).unwrap();
    folder.save("m.vtex", &whole[..whole.len() - 1]);
    assert!(bake(&folder, &args).1.contains("m.vtex: cannot be read"));
    assert!(std::fs::read(folder.path("m.vtex")).unwrap() == whole);
    let (code, _, error) = folder.run(&[&["bake"], &args[..], &["--if-changed", "--report", "r.json"]].concat());
    assert!(code == 2 && error.contains("'--report <FILE>'"), "{error}");
}

/// Frames share a cube, so that a change in one is a change in all.
#[test]
fn frames_are_kept_together() {
    let folder = Folder::of("quad.obj");
    for n in 0..3 {
        folder.save(&format!("s.{n}.obj"), format!("v 0 0 0\nv {} 0 0\nv 0 1 0\nf 1 2 3\n", 1 + n).as_bytes());
    }
    let all = ["s.#.obj", "-r", "8", "--frames", "0..2", "-o", "s.#.vtex"];
    assert_eq!(kept(&folder, &all), [false; 3]);
    assert_eq!(kept(&folder, &all), [true; 3]);
    let before = std::fs::read(folder.path("s.1.vtex")).unwrap();
    std::fs::remove_file(folder.path("s.1.vtex")).unwrap();
    assert_eq!(kept(&folder, &all), [true, false, true]);
    assert!(std::fs::read(folder.path("s.1.vtex")).unwrap() == before, "in the cube of all");
    assert_eq!(kept(&folder, &["s.#.obj", "-r", "8", "--frames", "0..1", "-o", "s.#.vtex"]), [false; 2]);
    assert_eq!(kept(&folder, &all), [false, false, true]);
    folder.save("s.2.obj", b"v 0 0 0\nv 9 0 0\nv 0 1 0\nf 1 2 3\n");
    assert_eq!(kept(&folder, &all), [false; 3]);
}
