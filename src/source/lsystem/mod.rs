//! L-systems as a source: a grammar in the notation of the field is derived, and the turtle draws its string as truncated
//! cones, polygons and placed meshes.
//!
//! Based on: P. Prusinkiewicz, A. Lindenmayer, *The Algorithmic Beauty of Plants*, Springer 1990.

mod alphabet;
mod budget;
mod context;
mod derive;
mod dialect;
mod directive;
mod expr;
mod expr_parser;
mod grammar;
mod lexer;
mod parser;
mod plant;
mod predecessor;
mod program;
#[cfg(test)]
mod tests;
mod turtle;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::curve::{CurveOptions, CurveSource, Strand};
use super::group::{GroupSource, Part as Placed};
use super::mesh::{MeshOptions, MeshSource};
use super::paint::{Paint, PaintedSource};
use super::traits::Source;
use crate::geom::DAffine3;
use crate::scene::model::{Instance, Material, Part};
use crate::scene::{self, Model, ReadOptions, files, text};
use crate::source::materials::UNNAMED;
use crate::{Error, Result};
use budget::Budget;
use grammar::{Grammar, Materials, Surface};
use lexer::Fault;
use plant::Plant;
use turtle::Turtle;

pub use dialect::Dialect;
pub use plant::Counts;

/// Options of an L-system; they take precedence over the grammar file.
#[derive(Debug, Clone, PartialEq)]
pub struct LSystemOptions {
    /// Derivation steps, instead of the grammar's.
    pub iterations: Option<u64>,
    /// Seed of the random choices, instead of the grammar's.
    pub seed: Option<u64>,
    /// Degrees that the turtle turns by where a symbol does not say, instead of the grammar's.
    pub angle: Option<f64>,
    /// A derived string to draw, instead of the grammar's.
    pub string: Option<String>,
    /// Largest number of symbols that are rewritten or examined; a grammar that takes more is an error.
    pub max_symbols: u64,
    /// Values of `#define`s, instead of the grammar's.
    pub define: BTreeMap<String, f64>,
    /// Notation of the file; without one it follows from the file.
    pub dialect: Option<Dialect>,
    /// The system to take of a file that has several.
    pub name: Option<String>,
}

impl Default for LSystemOptions {
    fn default() -> Self {
        LSystemOptions {
            iterations: None,
            seed: None,
            angle: None,
            string: None,
            max_symbols: 100_000_000,
            define: BTreeMap::new(),
            dialect: None,
            name: None,
        }
    }
}

/// Approximate number of bytes per character of a grammar while it is read.
const BYTES_PER_CHARACTER: u64 = 64;

/// Open the grammar `path`, or draw `options.string` alone where there is none.
///
/// # Errors
/// [`Error::Input`] with line and column where the grammar is not understood, [`Error::Limit`] where it grows beyond what
/// is allowed, and what reading the meshes of its surfaces gives.
pub fn open(
    path: Option<&Path>,
    options: &LSystemOptions,
    read: &ReadOptions,
    mesh: &MeshOptions,
) -> Result<Box<dyn Source>> {
    let (grammar, dialect) = match path {
        Some(path) => read_grammar(path, read.max_bytes, options)?,
        None => (Grammar::default(), Dialect::Book),
    };
    let read_as = (dialect != Dialect::Book).then(|| format!("read as {}", dialect.description()));
    let (plant, _) = draw(path, grammar.clone(), options, read.max_bytes)?;
    let Plant { mut limbs, polygons, meshes, warnings, .. } = plant;
    let names = limb_materials(&mut limbs, &grammar.materials);
    let unit = grammar.metres_per_unit;
    let curves = CurveOptions { fill: mesh.fill, ..CurveOptions::default() };
    let mut sources: Vec<Box<dyn Source>> =
        vec![Box::new(CurveSource::new(limbs, &curves, unit, warnings).with_materials(names))];
    let mut places = vec![Placed { source: 0, transform: DAffine3::IDENTITY }];
    let mut add = |source: Box<dyn Source>, transforms: Vec<DAffine3>| {
        places.extend(transforms.into_iter().map(|transform| Placed { source: sources.len(), transform }));
        sources.push(source);
    };
    if polygons.values().any(|p| !p.triangles.is_empty()) {
        let mut model = Model { metres_per_unit: unit, ..Model::default() };
        for (material, (id, part)) in polygons.into_iter().enumerate() {
            let name = grammar.materials.name(id).to_owned();
            model.materials.push(Material { name, ..Material::default() });
            model.parts.push(Part { material, ..part });
            model.instances.push(Instance { part: material, transform: DAffine3::IDENTITY, node: String::new() });
        }
        add(Box::new(MeshSource::new(model, mesh)), vec![DAffine3::IDENTITY]);
    }
    for (symbol, transforms) in meshes {
        let (Some(path), Some(Surface::Mesh { file, line, column })) = (path, grammar.surfaces.get(&symbol)) else {
            continue;
        };
        let at = format!("line {line}, column {column}");
        let Some(found) = find(path, file) else {
            return Err(Error::input(path, at, format!("there is no file {file} beside the grammar")));
        };
        if !["gltf", "glb", "obj"].contains(&files::extension(&found).as_str()) {
            return Err(Error::input(path, at, format!("{file} is no mesh; a surface is a .gltf, .glb or .obj file")));
        }
        let read = ReadOptions { max_bytes: read.max_bytes, ..ReadOptions::default() };
        let mut mesh: Box<dyn Source> = Box::new(MeshSource::new(scene::read_model(&found, &read)?, mesh));
        if let Some(id) = grammar.materials.surface(symbol) {
            let material = Some(grammar.materials.name(id).to_owned());
            mesh = Box::new(PaintedSource::new(mesh, Paint { material, ..Paint::default() }));
        }
        add(mesh, transforms);
    }
    Ok(Box::new(GroupSource::new(sources, &places, unit).with_notes(read_as.into_iter().collect())))
}

/// The names of the materials that the limbs have, each once; ids become places among them.
fn limb_materials(limbs: &mut [Strand], materials: &Materials) -> Vec<String> {
    let mut ids: Vec<u16> = limbs.iter().map(|l| l.material).collect();
    ids.sort_unstable();
    ids.dedup();
    if ids == [0] {
        return Vec::new();
    }
    for limb in limbs {
        limb.material = ids.binary_search(&limb.material).unwrap_or(0) as u16;
    }
    let name = |id: u16| if id == 0 { UNNAMED } else { materials.name(id) }.to_owned();
    ids.into_iter().map(name).collect()
}

/// Count what the L-system draws, and the symbols that are rewritten or looked at.
///
/// # Errors
/// As [`open`].
pub fn count(path: &Path, options: &LSystemOptions, max_bytes: u64) -> Result<(Counts, u64)> {
    let (plant, symbols) = draw(Some(path), read_grammar(path, max_bytes, options)?.0, options, max_bytes)?;
    Ok((plant.counts, symbols))
}

/// The files that are read with the grammar `text`, as they are found beside `path`: those that its notation has, and those
/// that its surfaces name.
pub fn companion_files(path: &Path, text: &str) -> Vec<PathBuf> {
    let read = |dialect| parse(path, text, &LSystemOptions { dialect, ..LSystemOptions::default() });
    // Houdini's rules are known by the option alone.
    let read = read(None).or_else(|_| read(Some(Dialect::Houdini)));
    let (grammar, dialect) = read.unwrap_or((Grammar::default(), Dialect::Book));
    let mesh = |s: &Surface| match s {
        Surface::Mesh { file, .. } => find(path, file),
        Surface::Polygon { .. } | Surface::Patches { .. } => None,
    };
    dialect::companion_files(dialect, path).into_iter().chain(grammar.surfaces.values().filter_map(mesh)).collect()
}

fn find(path: &Path, file: &str) -> Option<PathBuf> {
    files::find(path.parent().unwrap_or(Path::new("")), file, false)
}

fn read_grammar(path: &Path, max_bytes: u64, options: &LSystemOptions) -> Result<(Grammar, Dialect)> {
    let bytes = files::read(path, max_bytes / BYTES_PER_CHARACTER)?;
    let (mut grammar, dialect) = parse(path, &text::decode(&bytes), options).map_err(|f| match f.of_options {
        true => Error::Options(format!("{}: {}", path.display(), f.what)),
        false => Error::input(path, place(&f), f.what),
    })?;
    dialect::read_companions(dialect, path, &mut grammar)?;
    if let Some(name) = options.define.keys().find(|name| !grammar.constants.contains_key(*name)) {
        let known: Vec<&str> = grammar.constants.keys().map(String::as_str).collect();
        let known = if known.is_empty() { "none".into() } else { known.join(", ") };
        return Err(Error::Options(format!("{}: has no #define {name}; it has: {known}", path.display())));
    }
    Ok((grammar, dialect))
}

fn parse(path: &Path, text: &str, options: &LSystemOptions) -> Result<(Grammar, Dialect), Fault> {
    let dialect = options.dialect.or_else(|| dialect::detect(path, text)).ok_or_else(dialect::unknown)?;
    let choice = dialect::Choice { define: &options.define, name: options.name.as_deref() };
    Ok((dialect::read(dialect, text, &choice)?, dialect))
}

fn place(fault: &Fault) -> String {
    format!("line {}, column {}", fault.line, fault.column)
}

fn draw(path: Option<&Path>, mut grammar: Grammar, options: &LSystemOptions, max_bytes: u64) -> Result<(Plant, u64)> {
    let mut iterations = options.iterations.or(grammar.iterations);
    if let Some(text) = &options.string {
        grammar.axiom = parser::string(text, &grammar)
            .map_err(|f| Error::Options(format!("option `string`: {}: {}", place(&f), f.what)))?;
        iterations = Some(0);
    } else if grammar.rules.is_empty() && grammar.decomposition.is_empty() {
        iterations = Some(0);
    }
    let Some(iterations) = iterations else {
        let name = path.unwrap_or(Path::new("")).display();
        return Err(Error::Options(format!("{name} does not say how often it is applied; give option `iterations`")));
    };
    let mut budget = Budget::new(options.max_symbols, max_bytes);
    let mut turtle = Turtle::new(&grammar, options.angle.unwrap_or(grammar.angle));
    let seed = options.seed.unwrap_or(grammar.seed);
    derive::derive(&grammar, iterations, seed, &mut budget, &mut |symbol, arguments, budget| {
        turtle.symbol(symbol, arguments, budget)
    })?;
    Ok((turtle.finish(), budget.symbols()))
}
