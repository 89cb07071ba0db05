//! Mutated inputs of every format: whatever is wrong with an input, there is one line that says so. No panic, no abort, no work
//! or memory without bound, and what is written is valid.
//!
//! A short run belongs to the tests. More of them, and others, by these variables; CONTRIBUTING.md has examples:
//!
//! - `VTEX_MUTATIONS`: how many inputs. Input N is the same whenever it is made of the same seeds.
//! - `VTEX_MUTATIONS_FROM`: the first number; with `VTEX_MUTATIONS=1` one input again.
//! - `VTEX_MUTATIONS_OF`: the formats, by name and with commas between.
//! - `VTEX_MUTATIONS_KEEP`: a folder in which inputs that show a fault are kept.
//! - `VTEX_ASSETS`: a folder of real files, of which the small ones become seeds.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod bounds;
mod claims;
mod counts;
mod memory;
mod mutators;
mod run;
mod seeds;
mod shapes;
mod short;
mod small;
mod targets;
mod texels;
mod work;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use work::{Job, Outcome};

#[global_allocator]
static ALLOCATOR: memory::Counting = memory::Counting;

/// Inputs of the short run: at least a dozen of each format.
const SHORT: u64 = 360;

fn variable<T: std::str::FromStr>(name: &str) -> Option<T> {
    std::env::var(name).ok().and_then(|text| text.parse().ok())
}

#[test]
fn mutated_inputs_are_refused_in_a_line() {
    if let Some(job) = Job::of_this_process() {
        return job.work();
    }
    let count = variable("VTEX_MUTATIONS").unwrap_or(SHORT);
    let from = variable("VTEX_MUTATIONS_FROM").unwrap_or(0);
    let keep = variable::<PathBuf>("VTEX_MUTATIONS_KEEP");
    let folder = scratch();
    let outcomes = work::all(from..from + count, folder.path(), keep.as_deref(), count > 10 * SHORT);
    assert_eq!(outcomes.len() as u64, count, "every input was tried");
    let (table, faults) = summary(&outcomes);
    println!("{table}");
    assert!(faults.is_empty(), "{} inputs show faults:\n{}", faults.len(), faults.join("\n"));
    assert!(count < SHORT || outcomes.iter().any(|o| o.result == "baked"), "some inputs survive");
}

/// A folder of its own, in memory where the system has such: every output is brought to its disk.
fn scratch() -> tempfile::TempDir {
    let memory = Path::new("/dev/shm");
    let root = if memory.is_dir() { memory.to_path_buf() } else { std::env::temp_dir() };
    tempfile::Builder::new().prefix("vtex-mutations-").tempdir_in(root).unwrap()
}

/// Counts by format, and a line for each fault.
fn summary(outcomes: &[Outcome]) -> (String, Vec<String>) {
    let mut rows: BTreeMap<&str, [u64; 5]> = BTreeMap::new();
    let mut faults = Vec::new();
    for o in outcomes {
        let row = rows.entry(&o.format).or_default();
        row[0] += 1;
        row[match o.result.as_str() {
            "baked" => 1,
            "refused" => 2,
            _ => 3,
        }] += 1;
        row[4] = row[4].max(o.peak);
        if !["baked", "refused"].contains(&o.result.as_str()) {
            faults.push(format!("{} {} {}: {} ({} MiB)", o.number, o.format, o.result, o.text, o.peak >> 20));
        }
    }
    let mut table =
        format!("{:12}{:>10}{:>10}{:>10}{:>10}{:>12}", "format", "inputs", "done", "refused", "faults", "peak, MiB");
    for (format, [all, done, refused, wrong, peak]) in rows {
        table += &format!("\n{format:12}{all:>10}{done:>10}{refused:>10}{wrong:>10}{:>12}", peak >> 20);
    }
    (table, faults)
}
