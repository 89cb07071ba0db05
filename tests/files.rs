//! The commands about `.vtex` files: what they print, and how they fail.

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use vtex::format::{WriteOptions, write};
use vtex::volume::{Channels, Depth, Info, Volume, Voxel};

/// A full diagonal of 8 voxels at depth 3.
fn diagonal(dir: &Path) -> PathBuf {
    let voxel = Voxel { rate: 150, ..Voxel::default() };
    let depths = (0..4usize).map(|d| Depth {
        mixes: Vec::new(),
        masks: vec![if d < 3 { 0b1000_0001 } else { 0 }; 1 << d],
        voxels: (0..1 << d).map(|i| Voxel { rate: 100 + i, ..voxel }).collect(),
    });
    let info = Info { channels: Channels { albedo: true, ..Channels::default() }, ..Info::default() };
    let path = dir.join("diagonal é.vtex");
    write(&Volume { info, depths: depths.collect() }, &path, &WriteOptions::default()).unwrap();
    path
}

fn vtex() -> Command {
    Command::cargo_bin("vtex").unwrap()
}

#[test]
fn inspect_counts_every_byte() {
    let dir = tempfile::tempdir().unwrap();
    let path = diagonal(dir.path());
    let out = vtex().args(["inspect", "--json"]).arg(&path).assert().success().get_output().stdout.clone();
    let json: serde_json::Value = serde_json::from_slice(&out).unwrap();
    let file_bytes = std::fs::metadata(&path).unwrap().len();
    assert_eq!((json["resolution"].as_u64(), json["finest_voxels"].as_u64()), (Some(8), Some(8)));
    assert_eq!((json["file_bytes"].as_u64(), json["model"].as_str()), (Some(file_bytes), Some("coverage")));
    assert_eq!(json["bits_per_finest_voxel"].as_f64(), Some(file_bytes as f64));
    assert_eq!(json["bounds"]["max"][2].as_f64(), Some(1.0));
    let sum = |list: &str| json[list].as_array().unwrap().iter().map(|x| x["bytes"].as_u64().unwrap()).sum::<u64>();
    let voxels: Vec<_> = json["depths"].as_array().unwrap().iter().map(|d| d["voxels"].as_u64().unwrap()).collect();
    assert_eq!(voxels, [1, 2, 4, 8]);
    // Blocks hold their sections and up to 7 bytes of padding between two.
    let (blocks, channels) = (sum("depths"), sum("channels"));
    assert!(channels <= blocks && blocks <= channels + 7 * 8, "{channels} {blocks}");
    assert!(json["channels"].as_array().unwrap().iter().any(|c| c["name"] == "albedo" && c["constant"] == true));
    vtex().arg("inspect").arg(&path).assert().success();
}

#[test]
fn truncate_then_verify() {
    let dir = tempfile::tempdir().unwrap();
    let path = diagonal(dir.path());
    let short = dir.path().join("short.vtex");
    vtex().args(["truncate", "--depth", "2", "-o"]).args([&short, &path]).assert().success();
    let out = vtex().arg("verify").args([&path, &short]).assert().success().get_output().stdout.clone();
    assert_eq!(String::from_utf8_lossy(&out).lines().count(), 2);
    // The finest depth that there is not: the command line is at fault.
    vtex().args(["truncate", "--depth", "9", "-o"]).args([&short, &path]).assert().code(2);
}

#[test]
fn a_damaged_file_is_one_line_that_names_file_rule_and_place() {
    let dir = tempfile::tempdir().unwrap();
    let path = diagonal(dir.path());
    let mut bytes = std::fs::read(&path).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let out = vtex().arg("verify").arg(&path).assert().code(1).get_output().stderr.clone();
    let text = String::from_utf8_lossy(&out);
    assert_eq!(text.lines().count(), 1, "{text}");
    assert!(text.contains("diagonal é.vtex") && text.contains("[page-crc, byte "), "{text}");
    vtex().args(["inspect", "no-such.vtex"]).assert().code(1);
}

/// `vtex inspect … | head`: what nobody reads is dropped. What cannot be written is an error.
#[cfg(target_os = "linux")]
#[test]
fn results_go_where_they_can() {
    use std::process::Stdio;
    let dir = tempfile::tempdir().unwrap();
    let path = diagonal(dir.path());
    let inspect = |stdout: Stdio| {
        let mut command = std::process::Command::new(assert_cmd::cargo::cargo_bin("vtex"));
        command.arg("inspect").arg(&path).arg("--json").stdout(stdout).stderr(Stdio::piped());
        command.output().unwrap()
    };
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let gone = inspect(writer.into());
    assert!(gone.status.success() && gone.stderr.is_empty(), "{gone:?}");
    let full = inspect(std::fs::File::create("/dev/full").unwrap().into());
    assert_eq!(full.status.code(), Some(1));
    let said = String::from_utf8(full.stderr).unwrap();
    assert!(said.starts_with("error: standard output: ") && said.lines().count() == 1, "{said}");
}
