//! Depfiles of all commands: they name every file that is read, and make and ninja take names and deletions as they are
//! meant. Where a build tool is not installed, its part is left out.
#![cfg(unix)]

use std::path::Path;
use std::process::Command;

use crate::outputs::{Folder, corners, ground};

/// The rule's prerequisites, split where a space has no backslash before it; escapes are kept.
fn prerequisites(folder: &Folder, depfile: &str) -> Vec<String> {
    let text = std::fs::read_to_string(folder.path(depfile)).unwrap();
    let rule = text.split("\n\n").next().unwrap().split_once(": ").unwrap().1;
    rule.split(" \\\n").map(|line| line.trim().to_owned()).collect()
}

#[test]
fn every_file_that_is_read_is_named() {
    let folder = Folder::with_landscape();
    folder.save("inner.toml", b"[[draw]]\nsource = \"quad.obj\"\n");
    folder.save("outer.toml", b"[[draw]]\nsource = \"inner.toml\"\n[[draw]]\nsource = \"m.obj\"\n");
    folder.save("m.obj", b"mtllib m.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n");
    folder.save("m.mtl", b"newmtl a\nmap_Kd grass.png\n");
    folder.save("t.json", br#"{ "iso": 100 }"#);
    let slices = folder.path("slices");
    std::fs::create_dir(&slices).unwrap();
    for i in 0..2 {
        image::GrayImage::from_pixel(4, 4, image::Luma([200])).save(slices.join(format!("{i}.png"))).unwrap();
    }
    folder.succeeds(&["bake", "outer.toml", "-r", "16", "--depfile", "a.d"]);
    assert_eq!(
        prerequisites(&folder, "a.d"),
        ["outer.toml", "inner.toml", "m.obj", "m.mtl", "grass.png", "quad.obj"],
        "recipes within recipes, libraries and textures"
    );
    let args = ["bake", "slices", "-r", "16", "--spacing", "1,1,1", "--transfer", "t.json", "--albedo", "grass.png"];
    folder.succeeds(&[&args[..], &["--depfile", "a.d"]].concat());
    assert_eq!(prerequisites(&folder, "a.d"), ["slices/0.png", "slices/1.png", "grass.png", "t.json"]);

    // A landscape with a texel whose geometry has buffers and pictures of its own.
    folder.succeeds(&["bake", "ground.gltf", "-r", "16", "-o", "ground.vtex"]);
    folder.succeeds(&["map", "ground.gltf", "--texel", "ground.vtex", "--planar", "y", "-o", "l.gltf"]);
    let text = std::fs::read_to_string(folder.path("l.gltf")).unwrap();
    let mut file: serde_json::Value = serde_json::from_str(&text).unwrap();
    file["extensions"]["VTEX_volumetric_texture"]["texels"][0]["geometry"] = serde_json::json!({ "uri": "own.gltf" });
    folder.save("l.gltf", file.to_string().as_bytes());
    folder.save("own.gltf", ground("own.bin", "own.png").as_bytes());
    folder.save("own.bin", &corners());
    std::fs::copy(folder.path("grass.png"), folder.path("own.png")).unwrap();
    folder.succeeds(&["render", "l.gltf", "--frame", "--size", "16x9", "--depfile", "a.d"]);
    let mut found = prerequisites(&folder, "a.d");
    assert_eq!(found.remove(0), "l.gltf");
    found.sort();
    assert_eq!(found, ["grass.png", "ground.bin", "ground.vtex", "l.shell.bin", "own.bin", "own.gltf", "own.png"]);
    folder.succeeds(&[
        "map",
        "ground.gltf",
        "--texel",
        "quad.vtex",
        "--planar",
        "y",
        "-o",
        "o.glb",
        "--depfile",
        "a.d",
    ]);
    assert_eq!(prerequisites(&folder, "a.d"), ["ground.gltf", "ground.bin", "grass.png", "quad.vtex"]);
    folder.succeeds(&["merge", "quad.vtex", "ground.vtex", "-o", "o.vtex", "--depfile", "a.d"]);
    assert_eq!(prerequisites(&folder, "a.d"), ["quad.vtex", "ground.vtex"]);
    for more in [&["resample", "quad.vtex"][..], &["truncate", "quad.vtex", "--depth", "2"]] {
        folder.succeeds(&[more, &["-o", "o.vtex", "--depfile", "a.d"]].concat());
        assert_eq!(prerequisites(&folder, "a.d"), ["quad.vtex"]);
    }
    // Several outputs, a rule each.
    folder.succeeds(&["bake", "quad.obj", "m.obj", "-r", "16", "--depfile", "a.d"]);
    let text = std::fs::read_to_string(folder.path("a.d")).unwrap();
    assert!(text.contains("quad.vtex: quad.obj\n") && text.contains("m.vtex: m.obj \\\n  m.mtl"), "{text}");
}

/// Names that build tools read otherwise where they are not escaped.
const NAMES: [&str; 10] =
    ["a b", "a  b", "a#b", "a$b", "a$(b)", "a:b", "a\\b", "a\\ b", "a\\\\ #:$ b", "é (1), 'x' [2]"];

/// `tool ARGS` in `folder`; how often the rule has run by then.
fn runs(folder: &Path, tool: &str) -> usize {
    let done = Command::new(tool).current_dir(folder).output().unwrap();
    let text = [done.stdout, done.stderr].concat();
    assert!(done.status.success(), "{tool}: {}", String::from_utf8_lossy(&text));
    std::fs::read_to_string(folder.join("log")).unwrap_or_default().lines().count()
}

fn is_installed(tool: &str) -> bool {
    Command::new(tool).arg("--version").output().is_ok_and(|done| done.status.success())
}

/// Give a file a time of its own, so that nothing depends on how finely the clock ticks.
fn age(path: &Path, seconds: u64) {
    let time = std::time::UNIX_EPOCH + std::time::Duration::from_secs(seconds);
    std::fs::File::options().write(true).open(path).unwrap().set_modified(time).unwrap();
}

/// The output is made again when the file changed and when it is gone, and not otherwise.
fn follows(tool: &str, name: &str) {
    let source = format!("{name}.obj");
    let folder = Folder::of(&source);
    folder.succeeds(&["bake", &source, "-r", "2", "--refine", "0", "-o", "o.vtex", "--depfile", "o.d"]);
    let make = "o.vtex:\n\techo run >> log\n\ttouch o.vtex\n-include o.d\n";
    folder.save("Makefile", make.as_bytes());
    // ninja takes the depfile away, so it is given again by the rule.
    std::fs::copy(folder.path("o.d"), folder.path("kept.d")).unwrap();
    let ninja = "rule bake\n  command = cp kept.d o.d; echo run >> log; touch o.vtex\n  depfile = o.d\n  deps = gcc\nbuild o.vtex: bake\n";
    folder.save("build.ninja", ninja.as_bytes());
    let dir = folder.path("");
    age(&folder.path(&source), 1_000_000_000);
    let first = runs(&dir, tool);
    assert_eq!(runs(&dir, tool), first, "{tool} {name:?}: nothing changed");
    // Later than what the rule has just touched.
    age(&folder.path(&source), 4_000_000_000);
    assert_eq!(runs(&dir, tool), first + 1, "{tool} {name:?}: the file changed");
    std::fs::remove_file(folder.path(&source)).unwrap();
    assert_eq!(runs(&dir, tool), first + 2, "{tool} {name:?}: the file is gone");
}

#[test]
fn make_and_ninja_take_every_name() {
    for tool in ["make", "ninja"].into_iter().filter(|tool| is_installed(tool)) {
        for name in NAMES {
            // No spelling says a backslash before # to both; and ninja 1.11 reads a name as two at an apostrophe.
            if tool == "make" {
                follows(tool, name);
            } else if !name.contains("\\#") {
                follows(tool, &name.replace('\'', ""));
            }
        }
    }
}

/// The same for the output's name.
#[test]
fn targets_are_escaped() {
    for name in NAMES {
        let folder = Folder::of("quad.obj");
        let out = format!("{name}.vtex");
        folder.succeeds(&["bake", "quad.obj", "-r", "2", "--refine", "0", "-o", &out, "--depfile", "o.d"]);
        if is_installed("make") {
            // Asked for by its own name: make knows it only from the depfile.
            age(&folder.path("quad.obj"), 4_000_000_000);
            folder.save("Makefile", b"-include o.d\n");
            let text = Command::new("make").arg("-rpn").current_dir(folder.path("")).output().unwrap().stdout;
            let text = String::from_utf8(text).unwrap();
            let as_make_prints = format!("\n{out}: quad.obj\n");
            assert!(text.contains(&as_make_prints), "{name:?}");
        }
    }
}

#[test]
fn what_no_build_tool_can_be_told_is_said() {
    let folder = Folder::of("a\nb.obj");
    let (code, _, err) = folder.run(&["bake", "a\nb.obj", "-r", "2", "-o", "o.vtex", "--depfile", "o.d"]);
    assert!(code == 0 && err.contains("a\\nb.obj: left out of the depfile"), "{err}");
    assert_eq!(std::fs::read_to_string(folder.path("o.d")).unwrap(), "o.vtex:\n");
}
