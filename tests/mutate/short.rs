//! A few hundred inputs of each of the fuzzers' targets, the same every time: the seeds, and mutants of them.

use std::collections::BTreeSet;
use std::path::Path;

use vtex::random::SplitMix64;

use crate::memory::{alone, peak};
use crate::mutators::Dice;
use crate::seeds::{Format, formats};
use crate::targets::{ALL, Desk, Target};

/// Mutants of each target.
const MUTANTS: u64 = 200;

#[test]
fn readers_by_themselves_say_a_line_and_take_little() {
    let _alone = alone();
    let folder = crate::scratch();
    let made = folder.path().join("seeds");
    std::fs::create_dir_all(&made).unwrap();
    let formats = formats(&made);
    let names: BTreeSet<&str> = ALL.iter().map(|t| t.name).collect();
    assert_eq!(names.len(), ALL.len(), "no two have one name");
    let each = |target: &'static Target| tried(target, &folder.path().join(target.name), &formats);
    vtex::par::with_threads(1, || ALL.iter().for_each(each)).unwrap();
}

/// Give a target its seeds and mutants of them.
fn tried(target: &'static Target, folder: &Path, formats: &[Format]) {
    let mut desk = Desk::new(target, folder, formats);
    let mut seeds = target.seeds(formats);
    if target.is_shape() {
        let mut dice = SplitMix64::new(22);
        seeds = (0..50).map(|n| (0..n * 40).map(|_| dice.bits() as u8).collect()).collect();
    }
    assert!(!seeds.is_empty(), "{} has seeds", target.name);
    let mutants = (0..MUTANTS).map(|n| {
        let mut dice = Dice::new(22, n);
        let (seed, other) = (dice.of(&seeds).clone(), dice.of(&seeds).clone());
        target.mutated(&mut dice, &seed, &other)
    });
    let (mut read, mut refused, mut most) = (0, BTreeSet::new(), 0);
    for input in seeds.iter().cloned().chain(mutants) {
        let (result, taken) = peak(|| desk.run(&input));
        assert!(taken <= target.most, "{}: {} MiB: {result:?}", target.name, taken >> 20);
        most = most.max(taken);
        match result {
            Ok(()) => read += 1,
            Err(e) => drop(refused.insert(e.to_string())),
        }
    }
    println!("{:16}{:>6} read, {:>6} ways to be refused, {:>6} KiB", target.name, read, refused.len(), most >> 10);
    assert!(read > 0, "{}: nothing is read, as in {refused:?}", target.name);
    assert!(refused.len() > 2 || target.is_shape(), "{}: {refused:?}", target.name);
}
