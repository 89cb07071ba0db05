//! The targets of `tests/mutate`, for a fuzzer: one input after the other in one process, with the memory of each counted.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, dead_code, missing_docs)]

#[path = "../../tests/mutate/memory.rs"]
mod memory;
#[path = "../../tests/mutate/mutators.rs"]
mod mutators;
#[path = "../../tests/mutate/run.rs"]
mod run;
#[path = "../../tests/mutate/seeds.rs"]
mod seeds;
#[path = "../../tests/mutate/shapes/mod.rs"]
mod shapes;
#[path = "../../tests/mutate/small.rs"]
mod small;
#[path = "../../tests/mutate/targets.rs"]
mod targets;

use std::path::{Path, PathBuf};

use mutators::Dice;
use targets::{ALL, Desk, Target};

#[global_allocator]
static ALLOCATOR: memory::Counting = memory::Counting;

/// One target, ready for inputs.
pub struct Fuzz {
    target: &'static Target,
    desk: Desk,
    most: usize,
}

/// A folder of this process, in memory where the system has such.
fn scratch() -> PathBuf {
    let memory = Path::new("/dev/shm");
    let root = if memory.is_dir() { memory.to_path_buf() } else { std::env::temp_dir() };
    root.join(format!("vtex-fuzz-{}", std::process::id()))
}

impl Fuzz {
    /// The target of this name; of `any`, that of the variable VTEX_FUZZ. With VTEX_FUZZ_SEEDS, the seeds of all targets are
    /// written to that folder first.
    pub fn new(name: &str) -> Fuzz {
        if let Some(corpus) = std::env::var_os("VTEX_FUZZ_SEEDS") {
            write_seeds(corpus.as_ref(), MAX_SEED);
        }
        let chosen = std::env::var("VTEX_FUZZ").unwrap_or_else(|_| ALL[0].name.to_owned());
        let name = if name == "any" { &chosen } else { name };
        let target = ALL.iter().find(|t| t.name == name).unwrap_or_else(|| {
            let all: Vec<&str> = ALL.iter().map(|t| t.name).collect();
            panic!("VTEX_FUZZ is {name:?}; it is one of {}", all.join(", "))
        });
        let folder = scratch();
        std::fs::create_dir_all(&folder).unwrap();
        let desk = Desk::new(target, &folder, &seeds::formats(&folder));
        Fuzz { target, desk, most: 0 }
    }

    /// Read one input. Panics where that is a fault, or takes more memory than it may.
    pub fn run(&mut self, data: &[u8]) {
        let (_, taken) = memory::peak(|| self.desk.run(data));
        assert!(taken <= self.target.most, "{taken} bytes are taken");
        if taken > self.most + self.most / 8 {
            self.most = taken;
            eprintln!("peak: {} KiB", taken.div_ceil(1024));
        }
    }

    /// Another input of the target's kind; `seed` decides which.
    pub fn mutated(&self, data: &[u8], seed: u32) -> Vec<u8> {
        let mut dice = Dice::new(u64::from(seed), 0);
        self.target.mutated(&mut dice, data, data)
    }
}

/// Bytes of a seed; larger files would make slow mutants.
const MAX_SEED: usize = 16 << 10;

/// Write the seeds of all targets, each into its folder below `corpus`; files of more than `most` bytes are left out.
fn write_seeds(corpus: &Path, most: usize) {
    let folder = scratch();
    std::fs::create_dir_all(&folder).unwrap();
    let formats = seeds::formats(&folder);
    for target in ALL {
        let own = corpus.join(target.name);
        std::fs::create_dir_all(&own).unwrap();
        let mut count = 0;
        for bytes in target.seeds(&formats).iter().filter(|b| !target.is_shape() && b.len() <= most) {
            std::fs::write(own.join(format!("seed-{:08x}-{}", crc32fast::hash(bytes), bytes.len())), bytes).unwrap();
            count += 1;
        }
        println!("{}: {count} seeds", target.name);
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
