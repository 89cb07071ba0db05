//! Commands that are killed at random moments while they replace an output: the old file is there or the new one, and nothing else.
//! After SIGKILL, which no program can answer, a temporary file may be left where the system was between its two names.
//!
//! `VTEX_KILLS` says how many there are; the tests do with few.

use std::collections::BTreeMap;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A command, and its output before and after.
struct Case {
    name: &'static str,
    arguments: Vec<&'static str>,
    output: &'static str,
    old: Vec<u8>,
    new: Vec<u8>,
    /// How long it takes: kills are spread over that. Nothing is asserted of it.
    takes: Duration,
}

const SIGNALS: [(i32, &str); 3] = [(9, "KILL"), (15, "TERM"), (2, "INT")];

fn vtex(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_vtex"));
    command.args(arguments).current_dir(folder).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

fn succeeds(folder: &Path, arguments: &[&str]) {
    assert!(vtex(folder, arguments).status().unwrap().success(), "{arguments:?}");
}

/// Names in a folder.
fn names(folder: &Path) -> Vec<PathBuf> {
    let mut names: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    names.sort();
    names
}

/// Each command with what it replaces: the output of the same command with other options.
fn cases(folder: &Path) -> Vec<Case> {
    let samples = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples");
    for name in ["fern.glb", "terrain.glb"] {
        std::fs::copy(samples.join(name), folder.join(name)).unwrap();
    }
    succeeds(folder, &["bake", "fern.glb", "-r", "16", "-o", "fern.vtex"]);
    // Not the output of another case, which may be either of two.
    succeeds(folder, &["map", "terrain.glb", "--texel", "fern.vtex", "-o", "view.glb"]);
    let all: [(&str, &str, &str, &str); 5] = [
        ("bake", "bake fern.glb -r 32 -o baked.vtex", "--model neyret", "baked.vtex"),
        ("map", "map terrain.glb --texel fern.vtex -o land.glb", "--seed 7", "land.glb"),
        ("render", "render view.glb --camera far --size 48x27 -o seen.png", "--sky 0.2,0.5,0.9", "seen.png"),
        ("merge", "merge fern.vtex fern.vtex --translate 0.4,0,0 -o merged.vtex", "--compress 1", "merged.vtex"),
        ("resample", "resample fern.vtex -r 16 --rotate 0,30,0 -o turned.vtex", "--compress 1", "turned.vtex"),
    ];
    all.into_iter().map(|(name, line, other, output)| case(folder, name, line, other, output)).collect()
}

fn case(folder: &Path, name: &'static str, line: &'static str, other: &str, output: &'static str) -> Case {
    let arguments: Vec<&str> = line.split(' ').collect();
    let read = || std::fs::read(folder.join(output)).unwrap();
    let others: Vec<&str> = arguments.iter().copied().chain(other.split(' ')).collect();
    succeeds(folder, &others);
    let old = read();
    let start = Instant::now();
    succeeds(folder, &arguments);
    let takes = start.elapsed();
    let new = read();
    assert!(old != new, "{name}: the two outputs can be told apart");
    Case { name, arguments, output, old, new, takes }
}

#[test]
fn whatever_is_killed_leaves_the_old_file_or_the_new_one() {
    let count: u64 = std::env::var("VTEX_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(15);
    let folder = tempfile::tempdir().unwrap();
    let cases = cases(folder.path());
    let expected = names(folder.path());
    let mut dice = vtex::random::SplitMix64::new(18);
    let mut rows: BTreeMap<(&str, &str), [u64; 4]> = BTreeMap::new();
    for n in 0..count {
        let case = &cases[n as usize % cases.len()];
        let (signal, signal_name) = SIGNALS[n as usize / cases.len() % SIGNALS.len()];
        std::fs::write(folder.path().join(case.output), &case.old).unwrap();
        let mut child = vtex(folder.path(), &case.arguments).spawn().unwrap();
        std::thread::sleep(case.takes.mul_f64(1.1 * dice.unit()));
        // One that has ended already is still there until it is waited for.
        let sent = Command::new("kill").arg(format!("-{signal}")).arg(child.id().to_string()).status().unwrap();
        assert!(sent.success(), "the signal is sent");
        let status = child.wait().unwrap();
        let ended = status.success() || status.signal() == Some(signal) || status.code() == Some(128 + signal);
        assert!(ended, "{} after SIG{signal_name}: {status}", case.name);
        let found = std::fs::read(folder.path().join(case.output)).unwrap();
        assert!(found == case.old || found == case.new, "{} after SIG{signal_name}: {} bytes", case.name, found.len());
        assert!(!status.success() || found == case.new, "{}: what ends well has written", case.name);
        let litter: Vec<PathBuf> = names(folder.path()).into_iter().filter(|p| !expected.contains(p)).collect();
        let [start, end] = vtex::format::PART_NAME;
        let temporary = |p: &PathBuf| {
            let name = p.file_name().unwrap_or_default().to_string_lossy();
            signal == 9 && name.starts_with(start) && name.ends_with(end)
        };
        assert!(litter.iter().all(temporary), "{} after SIG{signal_name} leaves {litter:?}", case.name);
        litter.iter().for_each(|p| std::fs::remove_file(p).unwrap());
        let row = rows.entry((case.name, signal_name)).or_default();
        row[0] += 1;
        row[1] += u64::from(found == case.old);
        row[2] += u64::from(found == case.new);
        row[3] += litter.len() as u64;
    }
    println!("{:10}{:>8}{:>8}{:>8}{:>8}{:>12}", "command", "signal", "kills", "old", "new", "temporary");
    for ((name, signal), [kills, old, new, left]) in rows {
        println!("{name:10}{signal:>8}{kills:>8}{old:>8}{new:>8}{left:>12}");
    }
}
