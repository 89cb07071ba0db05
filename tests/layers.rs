//! The sources themselves: which part may use which, how long a file is, and what the library must not do.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What each part may use of the crate, besides itself, `error`, `progress` and what those re-export.
const MAY_USE: [(&str, &[&str]); 17] = [
    ("geom", &[]),
    ("morton", &[]),
    ("noise", &["geom"]),
    ("par", &[]),
    ("error", &[]),
    ("progress", &[]),
    ("random", &[]),
    ("simd", &[]),
    ("system", &[]),
    ("volume", &["geom", "morton"]),
    ("format", &["geom", "morton", "par", "volume"]),
    ("scene", &["geom", "noise", "random", "volume", "format"]),
    ("march", &["geom", "morton", "par", "simd", "volume"]),
    ("source", &["geom", "morton", "noise", "par", "random", "simd", "system", "volume", "format", "scene"]),
    ("bake", &["geom", "morton", "par", "random", "simd", "volume", "march", "source"]),
    ("merge", &["geom", "morton", "volume", "source", "bake"]),
    ("render", &["geom", "morton", "noise", "par", "random", "volume", "format", "scene", "march"]),
];
/// Names at the crate's root that every part may use.
const COMMON: [&str; 5] = ["Error", "Result", "Warnings", "error", "progress"];
const MAX_LINES: usize = 600;

fn sources(folder: &str) -> Vec<(PathBuf, String)> {
    let (root, mut found) = (Path::new(env!("CARGO_MANIFEST_DIR")), Vec::new());
    let mut folders = vec![root.join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).into_iter().flatten() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let text = std::fs::read_to_string(&path).unwrap();
                found.push((path.strip_prefix(root).unwrap().to_path_buf(), text));
            }
        }
    }
    found.sort();
    found
}

/// Files and code of the library without its unit tests, which may build their inputs with any part and print.
pub fn library() -> Vec<(PathBuf, String)> {
    let files = sources("src").into_iter().filter(|(path, _)| !path.ends_with("tests.rs"));
    files.map(|(path, text)| (path, code(text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default()))).collect()
}

/// The part of `src/` that a file belongs to.
fn part(path: &Path) -> &str {
    let first = path.components().nth(1).and_then(|c| c.as_os_str().to_str()).unwrap();
    first.strip_suffix(".rs").unwrap_or(first)
}

/// The text without comments and string literals: names in those are not uses.
fn code(text: &str) -> String {
    let mut out = String::new();
    for line in text.lines() {
        let mut chars = line.chars().peekable();
        let (mut quoted, mut last) = (false, ' ');
        while let Some(c) = chars.next() {
            match c {
                '"' if last != '\'' => quoted = !quoted,
                '\\' if quoted => {
                    chars.next();
                }
                '/' if !quoted && chars.peek() == Some(&'/') => break,
                _ if quoted => {}
                _ => out.push(c),
            }
            last = c;
        }
        out.push('\n');
    }
    out
}

/// The names right after `crate::` in the text, also those in braces.
fn used(code: &str) -> Vec<String> {
    let name = |s: &str| s.trim_start().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let mut names = Vec::new();
    for (at, _) in code.match_indices("crate::") {
        // `$crate::` in a macro means the same; `some_crate::` does not.
        if code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_') {
            continue;
        }
        let rest = &code[at + "crate::".len()..];
        let Some(group) = rest.strip_prefix('{') else {
            names.push(name(rest));
            continue;
        };
        let (mut depth, mut start) = (0, true);
        for (i, c) in group.char_indices() {
            match c {
                '{' => depth += 1,
                '}' if depth == 0 => break,
                '}' => depth -= 1,
                ',' if depth == 0 => start = true,
                c if start && !c.is_whitespace() => {
                    names.push(name(&group[i..]));
                    start = false;
                }
                _ => {}
            }
        }
    }
    names
}

#[test]
fn uses_are_found() {
    let text = "use crate::{Error, geom::{DVec3, Ray}, volume};\nlet x: crate::par::Y; // crate::cli\n\"crate::bake\"";
    assert_eq!(used(&code(text)), ["Error", "geom", "volume", "par"]);
}

#[test]
fn parts_use_only_what_lies_below_them() {
    let rules: BTreeMap<_, _> = MAY_USE.into_iter().collect();
    let mut broken = Vec::new();
    for (path, code) in library() {
        let part = part(&path);
        if matches!(part, "cli" | "bin" | "lib") {
            continue;
        }
        let Some(allowed) = rules.get(part) else {
            broken.push(format!("{}: `{part}` is not in the table of layers", path.display()));
            continue;
        };
        for name in used(&code) {
            if name != part && !COMMON.contains(&name.as_str()) && !allowed.contains(&name.as_str()) {
                broken.push(format!("{}: `{part}` must not use crate::{name}", path.display()));
            }
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn files_are_short_and_say_what_they_are_for() {
    let mut broken = Vec::new();
    for (path, text) in ["src", "tests", "examples", "bench"].into_iter().flat_map(sources) {
        let lines = text.lines().count();
        if lines > MAX_LINES {
            broken.push(format!("{}: {lines} lines, more than {MAX_LINES}", path.display()));
        }
        if !text.starts_with("//! ") {
            broken.push(format!("{}: does not open with a line that says what it is for", path.display()));
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn the_library_neither_prints_nor_exits() {
    let mut broken = Vec::new();
    for (path, code) in library().into_iter().filter(|(path, _)| !matches!(part(path), "cli" | "bin")) {
        for word in
            ["println!", "eprintln!", "print!(", "dbg!", "process::exit", "static mut", "todo!", "unimplemented!"]
        {
            if code.contains(word) {
                broken.push(format!("{}: {word}", path.display()));
            }
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn results_do_not_depend_on_the_order_of_a_hash_map() {
    // A map may be looked up; walking one gives another order in every run.
    let mut broken = Vec::new();
    for (path, code) in library()
        .into_iter()
        .filter(|(path, _)| matches!(part(path), "bake" | "source" | "merge" | "march" | "format" | "volume"))
    {
        if code.contains("std::collections::HashMap") || code.contains("std::collections::HashSet") {
            broken.push(format!("{}: use a BTreeMap or a sorted list", path.display()));
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}
