//! Grammars in the notations of other programs → [`Grammar`](super::grammar::Grammar). docs/lsystem-dialects.md describes them.

mod cpfg;
mod fractint;
mod houdini;
mod ini;
mod lpy;
mod rubberplant;
mod symbols;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::grammar::Grammar;
use super::lexer::{Fault, Parsed};
use super::parser;
use crate::Result;
use crate::scene::files;

/// Notation of a grammar file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Dialect {
    /// That of *The Algorithmic Beauty of Plants*, as docs/lsystems.md has it.
    Book,
    /// `.l` of Fractint: many systems in a file, whole parts of a turn.
    Fractint,
    /// `.l` of cpfg (L-studio, the Virtual Laboratory): `Lsystem: 1` to `endlsystem`.
    Cpfg,
    /// `.lpy` of L-Py, as far as it needs no Python.
    Lpy,
    /// Sections with `axiom=`, `angle=` and `rule0=F>F[+F]`.
    Ini,
    /// Rules and values of Houdini's L-System node.
    Houdini,
    /// `.ls` of RubberPlant: `lsystem name { axiom: F; r: F -> FF; }`.
    Rubberplant,
}

impl Dialect {
    /// All dialects, with descriptions for messages.
    pub const ALL: [(Dialect, &'static str); 7] = [
        (Dialect::Book, "the notation of The Algorithmic Beauty of Plants"),
        (Dialect::Fractint, "a Fractint file"),
        (Dialect::Cpfg, "a file of cpfg (L-studio)"),
        (Dialect::Lpy, "a file of L-Py"),
        (Dialect::Ini, "an INI file"),
        (Dialect::Houdini, "rules of Houdini's L-System node"),
        (Dialect::Rubberplant, "a RubberPlant file"),
    ];

    /// Description for messages.
    pub fn description(self) -> &'static str {
        Dialect::ALL.into_iter().find(|(d, _)| *d == self).map_or("", |(_, called)| called)
    }
}

/// What decides how a file is read, besides the file.
#[derive(Debug, Clone, Copy)]
pub struct Choice<'a> {
    /// Values in place of the grammar's own `#define`s of these names.
    pub define: &'a BTreeMap<String, f64>,
    /// The system to take of several.
    pub name: Option<&'a str>,
}

/// Dialect of a file, where its name or its text make it certain.
pub fn detect(path: &Path, text: &str) -> Option<Dialect> {
    // Our own files may hold anything that looks like another's.
    if files::extension(path) == "lsys" {
        return Some(Dialect::Book);
    }
    if files::extension(path) == "lpy" {
        return Some(Dialect::Lpy);
    }
    let line = |is: &dyn Fn(&str) -> bool| text.lines().any(|l| is(l.trim_start_matches('\u{feff}').trim()));
    let starts = |l: &str, word: &str| l.get(..word.len()).is_some_and(|s| s.eq_ignore_ascii_case(word));
    if line(&|l| l.eq_ignore_ascii_case("[l-system]")) {
        return Some(Dialect::Ini);
    }
    if line(&|l| starts(l, "lsystem ")) {
        return Some(Dialect::Rubberplant);
    }
    if line(&|l| starts(l, "lsystem:")) {
        return Some(Dialect::Cpfg);
    }
    let opens = line(&|l| l.split(';').next().is_some_and(|l| l.trim_end().ends_with('{')));
    if opens && line(&|l| starts(l, "axiom ") || starts(l, "axiom\t") || starts(l, "axiom=")) {
        return Some(Dialect::Fractint);
    }
    None
}

/// Read a grammar.
///
/// # Errors
/// Where it is not understood, or what of it is not read.
pub fn read(dialect: Dialect, text: &str, choice: &Choice) -> Parsed<Grammar> {
    match dialect {
        Dialect::Book => parser::grammar_with(text, choice.define),
        Dialect::Fractint => fractint::grammar(text, choice.name),
        Dialect::Cpfg => cpfg::grammar(text, choice.define),
        Dialect::Lpy => lpy::grammar(text, choice.define),
        Dialect::Ini => ini::grammar(text),
        Dialect::Houdini => houdini::grammar(text, choice.define),
        Dialect::Rubberplant => rubberplant::grammar(text),
    }
}

/// Files beside `path` that belong to it and are read with it.
pub fn companion_files(dialect: Dialect, path: &Path) -> Vec<PathBuf> {
    if dialect == Dialect::Cpfg { cpfg::view::files(path) } else { Vec::new() }
}

/// Read the files beside `path` into its grammar.
///
/// # Errors
/// What reading them gives.
pub fn read_companions(dialect: Dialect, path: &Path, grammar: &mut Grammar) -> Result<()> {
    if dialect == Dialect::Cpfg { cpfg::view::read(path, grammar) } else { Ok(()) }
}

/// Error for a file whose dialect is not certain.
pub fn unknown() -> Fault {
    let names = Dialect::ALL.map(|(d, _)| format!("{d:?}").to_lowercase()).join(", ");
    Fault {
        line: 1,
        column: 1,
        what: format!("it is not clear in which notation this is written; give option `dialect`, one of: {names}"),
        of_options: true,
    }
}

#[cfg(test)]
pub mod tests;
