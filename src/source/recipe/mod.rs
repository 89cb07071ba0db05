//! Recipes: a scene of shapes, files and operations on them, written down in TOML or JSON.
//!
//! Based on: F. Neyret, *Synthesizing Verdant Landscapes using Volumetric Textures*, INRIA RR-2846, 1996, section 3 (the
//! declarative script of primitives and drawing modes).

mod checked;
mod checks;
mod compile;
mod file;
mod model;
mod paint_options;
mod scatter;
mod values;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use toml::de::{DeTable, ValueDeserializer};

use super::options::OpenOptions;
use super::traits::Source;
use crate::scene::{files, text};
use crate::{Error, Result};
use model::{Either, Node, Recipe, Shape};
pub use paint_options::{PaintOptions, apply_paint, files as paint_files};

/// The published JSON Schema of recipes.
pub const SCHEMA: &str = include_str!("../../../docs/recipe.schema.json");

/// Largest recipe file, in bytes.
const MAX_BYTES: u64 = 16 << 20;
/// Recipes within recipes.
const MAX_NESTING: usize = 16;

/// Opens a source of any kind: what a recipe does with the files that it names.
pub type Opener = fn(&Path, &OpenOptions) -> Result<Box<dyn Source>>;

/// Read the recipe `path`; the files that it names are opened by `opener` ([`crate::source::open`](crate::source::open())).
///
/// # Errors
/// [`Error::Input`] with line and column, [`Error::Io`], and what the files that it names give.
pub fn open(path: &Path, options: &OpenOptions, opener: Opener) -> Result<Box<dyn Source>> {
    let chain = enter(path, &options.within)?;
    let (recipe, text) = read(path)?;
    compile::Compiler::new(&recipe, path, &text, &OpenOptions { within: chain, ..options.clone() }, opener).all()
}

/// Read the recipe `path` and all that it names; gives how many nodes are drawn.
///
/// # Errors
/// As [`open`].
pub fn check(path: &Path, options: &OpenOptions, opener: Opener) -> Result<usize> {
    open(path, options, opener)?;
    Ok(read(path)?.0.draw.len())
}

/// The files that the recipe names, and those that recipes in it name; nothing of what cannot be read.
pub fn files(path: &Path) -> Vec<PathBuf> {
    named(path).0.into_iter().map(|file| file.path).collect()
}

/// The files other than recipes that are drawn by the recipe, and by recipes in it; `None` where one cannot be read or is missing.
pub fn drawn_files(path: &Path) -> Option<Vec<PathBuf>> {
    let (files, all) = named(path);
    let drawn = files.into_iter().filter(|file| file.is_drawn && !is_recipe(&file.path));
    all.then(|| drawn.map(|file| file.path).collect())
}

/// A file that a recipe names.
struct Named {
    path: PathBuf,
    /// Whether it is a source, and not a picture of colours.
    is_drawn: bool,
}

/// The files that the recipe and recipes in it name, and whether all are there and all recipes could be read.
fn named(path: &Path) -> (Vec<Named>, bool) {
    let (mut found, mut left, mut all): (Vec<Named>, _, _) = (Vec::new(), vec![path.to_path_buf()], true);
    // A recipe may be named by many paths, without end where it names itself.
    let mut entered = BTreeSet::new();
    while let Some(path) = left.pop() {
        if std::fs::canonicalize(&path).is_ok_and(|real| !entered.insert(real)) {
            continue;
        }
        let Ok((recipe, _)) = read(&path) else {
            all = false;
            continue;
        };
        for (name, is_drawn) in names(&recipe) {
            let Some(file) = beside(&path, &name) else {
                all = false;
                continue;
            };
            if let Some(known) = found.iter_mut().find(|known| known.path == file) {
                known.is_drawn |= is_drawn;
                continue;
            }
            if is_recipe(&file) {
                left.push(file.clone());
            }
            found.push(Named { path: file, is_drawn });
        }
    }
    (found, all)
}

/// Whether a file is a recipe, by its name.
pub fn is_recipe(path: &Path) -> bool {
    ["toml", "json"].contains(&files::extension(path).as_str())
}

/// The file or the folder of slices that `name` stands for beside the recipe `path`.
fn beside(path: &Path, name: &str) -> Option<PathBuf> {
    let here = path.parent().unwrap_or(Path::new(""));
    let folder = || Some(here.join(name)).filter(|f| !name.is_empty() && f.is_dir());
    files::find(here, name, false).or_else(folder)
}

/// Names of files, in order, and whether each is drawn.
fn names(recipe: &Recipe) -> Vec<(String, bool)> {
    let mut names = Vec::new();
    let mut left: Vec<&Node> = recipe.draw.iter().chain(recipe.define.values()).rev().collect();
    while let Some(node) = left.pop() {
        match &node.shape {
            Shape::Source(source) => names.push((source.0.file.clone(), true)),
            Shape::Group(n) | Shape::Union(n) | Shape::Intersection(n) | Shape::Difference(n) => {
                left.extend(n.iter().rev());
            }
            _ => {}
        }
        if let Some(Either::Table(varied)) = &node.albedo {
            names.extend(varied.image.clone().map(|image| (image, false)));
        }
    }
    names
}

/// The recipes that are being read, with `path` as the innermost.
fn enter(path: &Path, within: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let real = std::fs::canonicalize(path).map_err(|e| Error::io(path, e))?;
    if within.contains(&real) {
        return Err(Error::input(path, "", "the recipe draws itself"));
    }
    if within.len() >= MAX_NESTING {
        return Err(Error::input(path, "", format!("more than {MAX_NESTING} recipes within one another")));
    }
    Ok(within.iter().cloned().chain([real]).collect())
}

/// The recipe and its text.
fn read(path: &Path) -> Result<(Recipe, String)> {
    let bytes = text::utf8(&files::read(path, MAX_BYTES)?).into_owned();
    let text = String::from_utf8(bytes).map_err(|e| {
        let line = e.as_bytes()[..e.utf8_error().valid_up_to()].iter().filter(|&&b| b == b'\n').count() + 1;
        Error::input(path, format!("line {line}"), "is not UTF-8 text")
    })?;
    let json = files::extension(path) == "json";
    let parsed = if json { from_json(&text) } else { from_toml(&text) };
    let recipe = parsed.map_err(|(at, what)| Error::input(path, at, what))?;
    Ok((recipe, text))
}

/// The error's place and text.
fn from_toml(text: &str) -> Result<Recipe, (String, String)> {
    toml::from_str(text).map_err(|e| {
        let at = e.span().map_or(String::new(), |span| place(text, drawn(text, span.start)));
        (at, one_line(e.message()))
    })
}

/// Where the node begins that an error is in: of what is wrong with a `[[draw]]` as a whole, the first one's start is told.
fn drawn(text: &str, start: usize) -> usize {
    const HEAD: &str = "[[draw]]";
    if !text.get(start..).is_some_and(|rest| rest.starts_with(HEAD)) {
        return start;
    }
    let Ok(table) = DeTable::parse(text) else { return start };
    let nodes = table.get_ref().get("draw").and_then(|draw| draw.get_ref().as_array());
    // By the deserializer that reads the whole: with another one, all of the model would be compiled once more.
    let wrong =
        nodes.and_then(|n| n.iter().position(|n| Node::deserialize(ValueDeserializer::from(n.clone())).is_err()));
    wrong.and_then(|n| text.match_indices(HEAD).nth(n)).map_or(start, |(byte, _)| byte)
}

fn from_json(text: &str) -> Result<Recipe, (String, String)> {
    serde_json::from_str(text).map_err(|e| {
        let whole = e.to_string();
        let what = whole.rsplit_once(" at line ").map_or(whole.as_str(), |(what, _)| what);
        (format!("line {}, column {}", e.line(), e.column()), one_line(what))
    })
}

fn one_line(text: &str) -> String {
    text.split('\n').map(str::trim).filter(|l| !l.is_empty()).collect::<Vec<_>>().join("; ")
}

/// Line and column (in characters, from 1) of a byte of the text.
fn place(text: &str, byte: usize) -> String {
    let before = text.get(..byte).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().unwrap_or("").chars().count() + 1;
    format!("line {line}, column {column}")
}

#[cfg(test)]
mod tests;
