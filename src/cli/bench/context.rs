//! Settings that all measurements of a bench share, and how a step is timed.

use std::path::Path;
use std::time::Instant;

use crate::cli::Ui;

/// Settings of a bench.
pub struct Bench<'a> {
    pub folder: &'a Path,
    pub size: [u32; 2],
    /// A pixel, of references.
    pub samples: u32,
    pub quick: bool,
    pub ui: &'a Ui,
}

/// What `f` gives, and its seconds and CPU seconds.
pub fn timed<T>(f: impl FnOnce() -> T) -> ([f64; 2], T) {
    let (start, cpu) = (Instant::now(), cpu_seconds());
    let result = f();
    ([start.elapsed().as_secs_f64(), cpu_seconds() - cpu], result)
}

/// User and system time of this process, where the system tells (Linux; a tick is a hundredth of a second); else 0.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit_once(')').map_or(Vec::new(), |(_, rest)| rest.split_whitespace().collect());
    [11, 12].iter().filter_map(|&k| fields.get(k)?.parse::<f64>().ok()).sum::<f64>() / 100.0
}
