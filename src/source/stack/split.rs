//! Splitting of a folder of slices by channel or frame, according to the files' names.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use super::natural::natural;

/// Words that may be names of channels, in one folder.
const MAX_WORDS: usize = 16;

/// Parts of a name in turn: letters, digits, and what is neither.
fn parts(name: &str) -> Vec<&str> {
    let class = |c: char| if c.is_ascii_digit() { 0 } else { u8::from(c.is_alphanumeric()) + 1 };
    let mut out = Vec::new();
    let (mut start, mut before) = (0, None);
    for (at, c) in name.char_indices() {
        if before.is_some_and(|b| b != class(c)) {
            out.push(&name[start..at]);
            start = at;
        }
        before = Some(class(c));
    }
    out.push(&name[start..]);
    out
}

/// Groups of files, in the natural order of the values of one part of their names, which must be the only difference of the
/// groups; each of several files. The part is the number after one of the words `keys`, or with `words` a word.
pub fn by_names(files: &[PathBuf], keys: &[&str], words: bool) -> Option<(Vec<String>, Vec<Vec<PathBuf>>)> {
    let stems: Vec<String> =
        files.iter().map(|f| f.file_stem().unwrap_or_default().to_string_lossy().into_owned()).collect();
    let names: Vec<Vec<&str>> = stems.iter().map(|s| parts(s)).collect();
    let after = |key: &str| {
        let position = |name: &Vec<&str>| {
            let is_key = |n: usize| {
                let number = |m: usize| name.get(m).filter(|p| p.starts_with(|c: char| c.is_ascii_digit())).map(|_| m);
                // The number follows at once, or after one sign: ch1, ch_1.
                let sign = |m: usize| name.get(m).is_some_and(|p| ["_", "-", "="].contains(p));
                let after_sign = || if sign(n + 1) { number(n + 2) } else { None };
                name[n].eq_ignore_ascii_case(key).then(|| number(n + 1).or_else(after_sign)).flatten()
            };
            (0..name.len()).find_map(is_key)
        };
        names.iter().map(position).collect::<Option<Vec<usize>>>()
    };
    for key in keys {
        if let Some(found) = after(key).and_then(|at| groups(files, &names, &at)) {
            return Some(found);
        }
    }
    let longest = names.iter().map(Vec::len).max().filter(|_| words)?;
    for at in 0..longest {
        let is_word = |name: &Vec<&str>| name.get(at).is_some_and(|p| p.chars().all(char::is_alphabetic));
        if names.iter().all(is_word)
            && let Some(found) = groups(files, &names, &vec![at; names.len()]).filter(|g| g.0.len() <= MAX_WORDS)
        {
            return Some(found);
        }
    }
    None
}

/// Files by the part `at` of each name, where that alone tells several groups apart.
fn groups(files: &[PathBuf], names: &[Vec<&str>], at: &[usize]) -> Option<(Vec<String>, Vec<Vec<PathBuf>>)> {
    let mut by_value: BTreeMap<&str, (BTreeSet<String>, Vec<PathBuf>)> = BTreeMap::new();
    for ((file, name), &at) in files.iter().zip(names).zip(at) {
        let rest = [&name[..at], &["\0"], &name[at + 1..]].concat().concat();
        let group = by_value.entry(name[at]).or_default();
        group.0.insert(rest);
        group.1.push(file.clone());
    }
    let mut all: Vec<_> = by_value.into_iter().collect();
    let alike = all.iter().all(|g| g.1.0 == all[0].1.0 && g.1.1.len() > 1);
    all.sort_by(|a, b| natural(a.0, b.0));
    (all.len() > 1 && alike).then(|| all.into_iter().map(|(value, (_, files))| (value.to_owned(), files)).unzip())
}

/// What the names of slices tell that is odd: names of several forms, and numbers that are missing from a row.
pub fn oddities(files: &[PathBuf]) -> Vec<String> {
    let name = |f: &PathBuf| f.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let stems: Vec<String> =
        files.iter().map(|f| f.file_stem().unwrap_or_default().to_string_lossy().to_lowercase()).collect();
    let names: Vec<Vec<&str>> = stems.iter().map(|s| parts(s)).collect();
    let is_number = |part: &&str| part.starts_with(|c: char| c.is_ascii_digit());
    let form = |name: &[&str]| name.iter().map(|p| if is_number(p) { "\0" } else { p }).collect::<String>();
    let Some(first) = names.first() else { return Vec::new() };
    if let Some(other) = names.iter().position(|n| form(n) != form(first)) {
        let (a, b) = (name(&files[0]), name(&files[other]));
        return vec![format!("names of its slices are not alike ({a}, {b}): all are taken, in this order")];
    }
    // The one number that differs.
    let differing: Vec<usize> = (0..first.len()).filter(|&n| names.iter().any(|name| name[n] != first[n])).collect();
    let [at] = differing[..] else { return Vec::new() };
    let Some(numbers) = names.iter().map(|n| n[at].parse().ok()).collect::<Option<Vec<u64>>>() else {
        return Vec::new();
    };
    let steps = || numbers.windows(2).map(|w| w[1].abs_diff(w[0]));
    let Some(step) = steps().min().filter(|s| *s > 0) else { return Vec::new() };
    let Some(gap) = numbers.windows(2).position(|w| w[1].abs_diff(w[0]) != step) else { return Vec::new() };
    let missing: u64 = steps().map(|s| (s / step).saturating_sub(1)).fold(0, u64::saturating_add);
    let (a, b) = (name(&files[gap]), name(&files[gap + 1]));
    vec![format!(
        "{missing} of its slices may be missing, the first between {a} and {b}: they are taken as evenly apart"
    )]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn split(names: &[&str], keys: &[&str]) -> Vec<String> {
        let files: Vec<PathBuf> = names.iter().map(|n| PathBuf::from(format!("{n}.tif"))).collect();
        by_names(&files, keys, keys.contains(&"c")).map_or_else(Vec::new, |g| g.0)
    }

    #[test]
    fn channels_are_found_by_key_or_word_and_slices_are_left_alone() {
        let keys = ["channel", "ch", "c"];
        assert_eq!(split(&["z1_c1", "z1_c2", "z2_c1", "z2_c2"], &keys), ["1", "2"]);
        assert_eq!(
            split(&["img_channel000_z000", "img_channel001_z000", "img_channel000_z001", "img_channel001_z001"], &keys),
            ["000", "001"]
        );
        assert_eq!(split(&["t1c10z1", "t1c10z2", "t1c9z1", "t1c9z2"], &keys), ["9", "10"]);
        assert_eq!(split(&["i_0_GFP_1", "i_0_DAPI_1", "i_0_GFP_2", "i_0_DAPI_2"], &keys), ["DAPI", "GFP"]);
        assert_eq!(split(&["t01_z1", "t02_z1", "t01_z2", "t02_z2"], &["time", "t"]), ["01", "02"]);
        // One running number, whatever the letter before it; or groups that are no copies of each other.
        assert!(split(&["c001", "c002", "c003"], &keys).is_empty());
        assert!(split(&["z1_c1", "z2_c1", "z3_c2", "z4_c2"], &keys).is_empty());
        assert!(split(&["slice1", "slice2", "Slice3"], &keys).is_empty());
    }

    #[test]
    fn a_picture_of_another_kind_and_a_gap_are_said() {
        let odd = |names: &[&str]| oddities(&names.iter().map(PathBuf::from).collect::<Vec<_>>()).concat();
        for even in [&["a_1.png", "A_2.PNG", "a_3.png"][..], &["s10", "s20", "s30"], &["x"], &[], &["a1b2", "a2b4"]] {
            assert_eq!(odd(even), "", "{even:?}");
        }
        assert!(odd(&["a_1.png", "a_2.png", "mip.png"]).contains("(a_1.png, mip.png)"));
        assert!(odd(&["z-1", "z-2", "z0", "z1"]).contains("(z-1, z0)"), "their order is not known");
        assert!(
            odd(&["s1", "s2", "s5", "s6", "s8"])
                .starts_with("3 of its slices may be missing, the first between s2 and s5")
        );
    }
}
