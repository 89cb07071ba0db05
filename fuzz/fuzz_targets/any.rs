//! A fuzz target: that of this binary's name, or of the variable VTEX_FUZZ. Half of the mutants are made by what knows the format.
#![no_main]

use std::sync::{Mutex, MutexGuard, OnceLock};

use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};
use vtex_fuzz::Fuzz;

fn fuzz() -> MutexGuard<'static, Fuzz> {
    static FUZZ: OnceLock<Mutex<Fuzz>> = OnceLock::new();
    FUZZ.get_or_init(|| Mutex::new(Fuzz::new(env!("CARGO_BIN_NAME")))).lock().expect("it is used once at a time")
}

// What is made once is no part of the first input.
fuzz_target!(init: drop(fuzz()), |data: &[u8]| fuzz().run(data));

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    if seed % 2 == 0 {
        return fuzzer_mutate(data, size, max_size);
    }
    let mut made = fuzz().mutated(&data[..size], seed);
    made.truncate(max_size);
    data[..made.len()].copy_from_slice(&made);
    made.len()
});
