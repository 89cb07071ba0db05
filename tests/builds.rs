//! `examples/builds`: each build tool makes the texels, leaves alone what has not changed, and follows every file. Where a tool is
//! not installed, that is printed and its example is not run.
#![cfg(unix)]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, SystemTime};

use crate::readable;

const VTEX: &str = env!("CARGO_BIN_EXE_vtex");

/// The examples, copied to where builds may write.
struct Builds(tempfile::TempDir);

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap().map(|e| e.unwrap().path()) {
        let to = to.join(entry.file_name().unwrap());
        if entry.is_dir() {
            copy(&entry, &to);
        } else {
            std::fs::copy(&entry, &to).unwrap();
        }
    }
}

fn is_installed(tool: &str) -> bool {
    let found = Command::new(tool).arg("--version").output().is_ok_and(|done| done.status.success());
    if !found {
        eprintln!("{tool} is not installed: its example is not run");
    }
    found
}

impl Builds {
    fn new() -> Builds {
        let builds = Builds(tempfile::tempdir().unwrap());
        copy(&Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/builds"), builds.0.path());
        // Files that are as new as the texels made of them would depend on how finely the clock ticks.
        for file in ["card.obj", "card.mtl", "card.png", "wedge.obj"] {
            builds.age(file, 100);
        }
        builds
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn age(&self, model: &str, seconds: u64) {
        let file = std::fs::File::options().write(true).open(self.path("models").join(model)).unwrap();
        file.set_modified(SystemTime::now() - Duration::from_secs(seconds)).unwrap();
    }

    fn run(&self, folder: &str, tool: &str, args: &[&str]) {
        let mut command = Command::new(tool);
        // What cargo sets for this test is not for what the test runs.
        for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("CARGO") || name.starts_with("RUST")) {
            if !["CARGO_HOME", "RUSTUP_HOME", "RUSTUP_TOOLCHAIN"].contains(&name.as_str()) {
                command.env_remove(name);
            }
        }
        let done = command.args(args).env("VTEX", VTEX).current_dir(self.path(folder)).output().unwrap();
        let text = String::from_utf8_lossy(&[done.stdout, done.stderr].concat()).into_owned();
        assert!(done.status.success(), "{tool} {args:?}: {text}");
    }

    /// Build three times: from nothing, without a change, and with another picture on one of two meshes. `texels`: those of the
    /// card and of the wedge.
    fn follows(&self, build: &dyn Fn(), texels: [&str; 2]) {
        let texels = texels.map(|name| self.path(name));
        let state = || {
            texels
                .clone()
                .map(|path| (std::fs::metadata(&path).unwrap().modified().unwrap(), std::fs::read(&path).unwrap()))
        };
        build();
        texels.iter().for_each(|path| readable::verify(path));
        let first = state();
        build();
        assert!(state() == first, "nothing has changed");
        image::RgbImage::from_pixel(2, 2, image::Rgb([200, 90, 20])).save(self.path("models/card.png")).unwrap();
        build();
        let [card, wedge] = state();
        assert!(card.1 != first[0].1, "the picture has changed");
        assert!(wedge == first[1], "what does not depend on it is left alone");
    }
}

#[test]
fn make() {
    if is_installed("make") {
        let builds = Builds::new();
        builds.follows(&|| builds.run("make", "make", &[]), ["make/texels/card.vtex", "make/texels/wedge.vtex"]);
    }
}

#[test]
fn ninja() {
    if !is_installed("ninja") {
        return;
    }
    let builds = Builds::new();
    let file = builds.path("ninja/build.ninja");
    let text = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, text.replace("vtex = vtex", &format!("vtex = {VTEX}"))).unwrap();
    std::fs::create_dir(builds.path("ninja/texels")).unwrap();
    let texels = ["ninja/texels/card.vtex", "ninja/texels/wedge.vtex"];
    builds.follows(&|| builds.run("ninja", "ninja", &[]), texels);
    // A file that is new and holds what it held.
    let made = || std::fs::metadata(builds.path(texels[1])).unwrap().modified().unwrap();
    let before = made();
    std::fs::write(builds.path("models/wedge.obj"), std::fs::read(builds.path("models/wedge.obj")).unwrap()).unwrap();
    builds.run("ninja", "ninja", &[]);
    assert_eq!(made(), before);
}

#[test]
fn cmake() {
    for (tool, generator) in [("make", "Unix Makefiles"), ("ninja", "Ninja")] {
        if is_installed("cmake") && is_installed(tool) {
            let builds = Builds::new();
            builds.run("cmake", "cmake", &["-B", "build", "-G", generator, &format!("-DVTEX={VTEX}")]);
            let build = || builds.run("cmake", "cmake", &["--build", "build"]);
            builds.follows(&build, ["cmake/build/card.vtex", "cmake/build/wedge.vtex"]);
        }
    }
}

#[test]
fn meson() {
    if is_installed("meson") && is_installed("ninja") {
        let builds = Builds::new();
        std::fs::write(builds.path("meson/native.ini"), format!("[binaries]\nvtex = '{VTEX}'\n")).unwrap();
        builds.run("meson", "meson", &["setup", "build", "--native-file", "native.ini"]);
        let build = || builds.run("meson", "ninja", &["-C", "build"]);
        builds.follows(&build, ["meson/build/card.vtex", "meson/build/wedge.vtex"]);
    }
}

#[test]
fn cargo() {
    let builds = Builds::new();
    let build = || builds.run("cargo", env!("CARGO"), &["build", "--offline", "--quiet"]);
    let texel = || {
        let outs = std::fs::read_dir(builds.path("cargo/target/debug/build")).unwrap().map(|e| e.unwrap().path());
        let texel = outs.map(|out| out.join("out/card.vtex")).find(|path| path.exists()).unwrap();
        (std::fs::metadata(&texel).unwrap().modified().unwrap(), std::fs::read(&texel).unwrap())
    };
    build();
    let first = texel();
    build();
    assert!(texel() == first, "nothing has changed");
    image::RgbImage::from_pixel(2, 2, image::Rgb([200, 90, 20])).save(builds.path("models/card.png")).unwrap();
    build();
    assert!(texel().1 != first.1, "the picture has changed");
    builds.run("cargo", env!("CARGO"), &["run", "--offline", "--quiet"]);
}
