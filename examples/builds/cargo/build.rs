//! Bakes a mesh into the build's folder, from where the program includes it.

use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;

fn main() {
    // The program, if it is not on the path.
    println!("cargo::rerun-if-env-changed=VTEX");
    let vtex = env::var_os("VTEX").unwrap_or_else(|| "vtex".into());
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets it"));
    let mesh = Path::new("../models/card.obj");
    let texel = out.join("card.vtex");
    let depfile = out.join("card.d");
    let status = Command::new(vtex)
        .args(["bake", "-r", "64", "--if-changed", "--quiet"])
        .arg(mesh)
        .arg("-o")
        .arg(&texel)
        .arg("--depfile")
        .arg(&depfile)
        .status()
        .expect("vtex runs; VTEX names it where it is not on the path");
    assert!(status.success(), "vtex bake: {status}");
    // Each file that was read stands in a line of its own with a colon. Names with spaces would have backslashes here.
    let rules = std::fs::read_to_string(&depfile).expect("vtex has written it");
    for file in rules.lines().filter_map(|line| line.strip_suffix(':')) {
        println!("cargo::rerun-if-changed={file}");
    }
}
