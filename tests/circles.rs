//! The sources themselves: no files import one another in a circle.

use std::collections::{BTreeMap, BTreeSet};

use super::layers::library;

type Module = Vec<String>;

/// The module that a file is.
fn module(path: &std::path::Path) -> Module {
    let mut parts: Module = path.iter().skip(1).map(|p| p.to_string_lossy().into_owned()).collect();
    let last = parts.pop().unwrap();
    match last.trim_end_matches(".rs") {
        "mod" | "lib" => {}
        name => parts.push(name.to_owned()),
    }
    parts
}

/// The paths in a tree of `use`, such as `a::{b, c::d}`, without what they are renamed to.
fn flat(tree: &str) -> Vec<String> {
    let Some((before, rest)) = tree.split_once('{') else {
        return vec![tree.split(" as ").next().unwrap_or_default().trim().to_owned()];
    };
    let inner = rest.rsplit_once('}').map_or(rest, |(inner, _)| inner);
    let (mut depth, mut start, mut out) = (0, 0, Vec::new());
    for (i, c) in inner.char_indices().chain([(inner.len(), ',')]) {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                let one = inner[start..i].trim();
                out.extend(flat(one).into_iter().filter(|p| !p.is_empty()).map(|p| format!("{}{p}", before.trim())));
                start = i + 1;
            }
            _ => {}
        }
    }
    out
}

/// The paths that start at the crate or at a module above, as they stand in the text.
fn paths(code: &str) -> Vec<String> {
    let mut out = Vec::new();
    for statement in code.split(';') {
        let statement = statement.trim_start();
        // A `pub use` of what is below makes it visible; it is no import.
        let tree = statement.lines().skip_while(|l| l.trim_start().starts_with('#')).collect::<Vec<_>>().join(" ");
        if let Some(tree) = tree.trim_start().strip_prefix("use ") {
            out.extend(flat(tree));
        } else {
            for start in ["crate::", "super::"] {
                for (at, _) in code_words(statement, start) {
                    let path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
                    out.push(statement[at..].chars().take_while(|&c| path(c)).collect());
                }
            }
        }
    }
    out
}

/// Where `word` begins that is no end of another word or path.
fn code_words<'a>(text: &'a str, word: &'a str) -> impl Iterator<Item = (usize, &'a str)> {
    text.match_indices(word)
        .filter(|&(at, _)| !text[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':'))
}

/// The file that `path` leads to, as seen from the module `from`.
fn target(path: &str, from: &[String], files: &BTreeSet<Module>) -> Option<Module> {
    let mut parts: Vec<&str> = path.split("::").collect();
    let mut at: Module = from.to_vec();
    match parts[0] {
        "crate" => {
            at.clear();
            parts.remove(0);
        }
        "super" | "self" => {
            while matches!(parts.first(), Some(&"super" | &"self")) {
                if parts.remove(0) == "super" {
                    at.pop()?;
                }
            }
        }
        first => {
            let child = [&at[..], &[first.to_owned()]].concat();
            files.contains(&child).then_some(())?;
        }
    }
    let mut found = files.contains(&at).then(|| at.clone());
    for part in parts {
        at.push(part.to_owned());
        if !files.contains(&at) {
            break;
        }
        found = Some(at.clone());
    }
    found
}

#[test]
fn trees_of_use_are_flattened() {
    assert_eq!(
        flat("crate::a::{self, b::{C, d}, E as F}"),
        ["crate::a::self", "crate::a::b::C", "crate::a::b::d", "crate::a::E"]
    );
    assert_eq!(
        paths("use super::x::Y;\npub use z::W;\nfn f() -> crate::q::R { not_crate::s() }"),
        ["super::x::Y", "crate::q::R"]
    );
}

#[test]
fn no_files_import_one_another_in_a_circle() {
    let sources: BTreeMap<Module, String> = library().into_iter().map(|(path, code)| (module(&path), code)).collect();
    let files: BTreeSet<Module> = sources.keys().cloned().collect();
    let mut imports: BTreeMap<Module, BTreeSet<Module>> = BTreeMap::new();
    for (from, code) in &sources {
        let paths = paths(code);
        let to = paths.iter().filter_map(|p| target(p, from, &files)).filter(|to| to != from && !to.is_empty());
        imports.insert(from.clone(), to.collect());
    }
    // Files that import nothing which is left are no part of a circle, again and again.
    loop {
        let done: Vec<Module> = imports.iter().filter(|(_, to)| to.is_empty()).map(|(from, _)| from.clone()).collect();
        if done.is_empty() {
            break;
        }
        done.iter().for_each(|d| {
            imports.remove(d);
        });
        imports.values_mut().for_each(|to| to.retain(|t| !done.contains(t)));
    }
    // What is left is in a circle, or leads to one: drop what nothing left imports.
    loop {
        let used: BTreeSet<Module> = imports.values().flatten().cloned().collect();
        let before = imports.len();
        imports.retain(|from, _| used.contains(from));
        if imports.len() == before {
            break;
        }
    }
    let line = |(from, to): (&Module, &BTreeSet<Module>)| {
        format!("{} imports {}", from.join("::"), to.iter().map(|t| t.join("::")).collect::<Vec<_>>().join(", "))
    };
    assert!(imports.is_empty(), "{}", imports.iter().map(line).collect::<Vec<_>>().join("\n"));
}
