//! Content of a grammar file, as plain data with every default filled in.
//!
//! Based on: P. Prusinkiewicz, A. Lindenmayer, *The Algorithmic Beauty of Plants*, Springer 1990.

use std::collections::{BTreeMap, BTreeSet};

use super::alphabet::{self, Alphabet};
use super::expr::Expr;
use super::program::Statement;
use crate::Warnings;
use crate::geom::{DMat3, DVec3};

/// A symbol with the expressions of its parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Module {
    pub symbol: char,
    pub arguments: Vec<Expr>,
}

/// Pattern that matches a symbol with `count` parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pattern {
    pub symbol: char,
    pub count: usize,
}

/// `left < predecessor > right : condition -> successor : weight`.
#[derive(Debug, Clone, PartialEq)]
pub struct Production {
    pub left: Vec<Pattern>,
    pub predecessor: Pattern,
    /// May hold brackets, nested well.
    pub right: Vec<Pattern>,
    /// Run before the condition. Its parameters are those of left, predecessor and right, in this order, and then its own
    /// variables; so for all that follows.
    pub before: Vec<Statement>,
    pub condition: Option<Expr>,
    /// Relative probability among the productions that match and have a weight.
    pub weight: Option<Expr>,
    /// Run where it is applied.
    pub after: Vec<Statement>,
    pub successor: Vec<Module>,
    /// Number of its own variables.
    pub variables: usize,
    /// Number of productions given before it.
    pub number: usize,
}

impl Production {
    /// One that always matches, and gives nothing.
    pub fn new(left: Vec<Pattern>, predecessor: Pattern, right: Vec<Pattern>) -> Production {
        Production {
            left,
            predecessor,
            right,
            before: Vec::new(),
            condition: None,
            weight: None,
            after: Vec::new(),
            successor: Vec::new(),
            variables: 0,
            number: 0,
        }
    }

    pub fn in_context(&self) -> bool {
        !(self.left.is_empty() && self.right.is_empty())
    }

    /// Test whether it reads or sets variables of the grammar.
    pub fn shares(&self) -> bool {
        let arguments = self.successor.iter().flat_map(|m| &m.arguments);
        arguments.chain(&self.condition).chain(&self.weight).any(Expr::shares)
            || self.before.iter().chain(&self.after).any(Statement::shares)
    }
}

/// Productions by their predecessor, in the order in which they are tried.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Rules(BTreeMap<char, Vec<Production>>);

impl Rules {
    /// Add a production. Those with a context come first, else they stay as they were given.
    pub fn add(&mut self, production: Production) {
        let list = self.0.get(&production.predecessor.symbol).map_or(&[][..], Vec::as_slice);
        let free = list.iter().position(|p| !p.in_context()).filter(|_| production.in_context());
        let at = free.unwrap_or(list.len());
        self.insert(at, production);
    }

    /// Add a production after all that were given.
    pub fn append(&mut self, production: Production) {
        let end = self.of(production.predecessor.symbol).len();
        self.insert(end, production);
    }

    fn insert(&mut self, at: usize, mut production: Production) {
        production.number = self.0.values().map(Vec::len).sum();
        self.0.entry(production.predecessor.symbol).or_default().insert(at, production);
    }

    pub fn of(&self, symbol: char) -> &[Production] {
        self.0.get(&symbol).map_or(&[], Vec::as_slice)
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Test whether random numbers decide which productions match the symbol.
    pub fn random(&self, symbol: char) -> bool {
        self.of(symbol).iter().any(|p| [&p.condition, &p.weight].into_iter().flatten().any(Expr::random))
    }

    /// All productions.
    pub fn iter(&self) -> impl Iterator<Item = &Production> {
        self.0.values().flatten()
    }

    /// Test whether any production has a context.
    pub fn in_context(&self) -> bool {
        self.0.values().flatten().any(Production::in_context)
    }
}

/// Surface that `~` draws.
#[derive(Debug, Clone, PartialEq)]
pub enum Surface {
    /// A polygon: x to the turtle's right, y ahead, z up; and its colour (linear), without one the turtle's.
    Polygon { corners: Vec<DVec3>, colour: Option<[f32; 3]> },
    /// Triangles with the axes and, per position, the colours of a polygon; and the place where the turtle goes on.
    Patches { positions: Vec<DVec3>, colours: Vec<Option<[f32; 3]>>, triangles: Vec<[u32; 3]>, end: DVec3 },
    /// A mesh file, as it is named, and the place that names it.
    Mesh { file: String, line: u32, column: u32 },
}

/// Materials by symbol, surface and colour. Ids count from 1; 0 stands for no material.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Materials {
    names: Vec<String>,
    colours: BTreeMap<i64, u16>,
    symbols: BTreeMap<char, u16>,
    surfaces: BTreeMap<char, u16>,
}

/// Geometry that a material is assigned to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MaterialTarget {
    /// Colours from this index to the next that is given one.
    Colour(i64),
    /// Geometry that this symbol draws.
    Symbol(char),
    /// Surface that `~` and this symbol draw.
    Surface(char),
}

impl Materials {
    /// Assign the material `name` to the geometry `to`.
    pub fn assign(&mut self, name: &str, to: MaterialTarget) {
        let known = self.names.iter().position(|n| n == name).unwrap_or_else(|| {
            self.names.push(name.to_owned());
            self.names.len() - 1
        });
        let id = (known + 1).min(u16::MAX.into()) as u16;
        match to {
            MaterialTarget::Colour(index) => self.colours.insert(index, id),
            MaterialTarget::Symbol(symbol) => self.symbols.insert(symbol, id),
            MaterialTarget::Surface(symbol) => self.surfaces.insert(symbol, id),
        };
    }

    /// Id of the material of what `symbol` draws in the colour `index`: by its symbol, else by its colour.
    pub fn drawn(&self, symbol: char, index: f64) -> u16 {
        self.symbols.get(&symbol).copied().unwrap_or_else(|| self.coloured(index))
    }

    /// Id of the material of the colour `index`.
    pub fn coloured(&self, index: f64) -> u16 {
        self.colours.iter().rev().find(|(i, _)| **i as f64 <= index).map_or(0, |(_, id)| *id)
    }

    /// Id of the material of the surface `symbol`, if it has one.
    pub fn surface(&self, symbol: char) -> Option<u16> {
        self.surfaces.get(&symbol).copied()
    }

    /// The name of an id; empty where it has none.
    pub fn name(&self, id: u16) -> &str {
        usize::from(id).checked_sub(1).and_then(|i| self.names.get(i)).map_or("", String::as_str)
    }
}

/// The symbols that contexts look at.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Considered {
    AllBut(BTreeSet<char>),
    Only(BTreeSet<char>),
}

impl Considered {
    pub fn holds(&self, symbol: char) -> bool {
        match self {
            Considered::AllBut(set) => !set.contains(&symbol),
            Considered::Only(set) => set.contains(&symbol) || matches!(symbol, '[' | ']'),
        }
    }
}

/// How far the productions of a homomorphism go on with what they give.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Recursion {
    /// What one production gives is rewritten by those below it.
    Below,
    /// What they give is rewritten again, to this depth.
    Depth(u64),
}

/// Statements of a grammar: before the first step, before and after each, after the last.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Blocks {
    pub start: Vec<Statement>,
    pub start_each: Vec<Statement>,
    pub end_each: Vec<Statement>,
    pub end: Vec<Statement>,
}

/// An L-system and how its string is drawn. Lengths are in the source's units, angles in degrees.
#[derive(Debug, Clone, PartialEq)]
pub struct Grammar {
    pub constants: BTreeMap<String, f64>,
    /// Values that stand in place of its own for constants of these names.
    pub given: BTreeMap<String, f64>,
    pub axiom: Vec<Module>,
    pub rules: Rules,
    /// Whether of several productions that match one is drawn by lot only among those with a context, or without.
    pub context_first: bool,
    /// Applied after each step, to what it gave and to what it left, again and again to a depth.
    pub decomposition: Rules,
    pub decomposition_depth: u64,
    /// Applied to the string that was derived.
    pub homomorphism: Rules,
    pub recursion: Recursion,
    /// Initial values of the variables of the grammar.
    pub globals: Vec<f64>,
    /// The variable that holds the number of the step.
    pub step_variable: Option<usize>,
    pub blocks: Blocks,
    pub considered: Considered,
    pub iterations: Option<u64>,
    pub seed: u64,
    pub angle: f64,
    /// Length of a segment without a parameter.
    pub step: f64,
    /// Width at the start; without one it follows from the drawing's size.
    pub width: Option<f64>,
    /// Factor of the width at `!` without a parameter.
    pub taper: f64,
    /// The vector T times the elasticity e: a segment of heading H bends by |H × eT| radians.
    pub tropism: DVec3,
    /// Linear Rec. 709 by index.
    pub colours: BTreeMap<i64, [f32; 3]>,
    pub surfaces: BTreeMap<char, Surface>,
    pub materials: Materials,
    pub actions: Alphabet,
    /// Names of symbols that stand for words.
    pub words: BTreeMap<char, String>,
    /// Axes of the turtle at the start: ahead, left, up.
    pub frame: DMat3,
    /// Axes of positions that symbols give.
    pub axes: DMat3,
    /// Index of the colour at the start.
    pub first_colour: f64,
    /// Warnings about what was ignored while it was read.
    pub warnings: Warnings,
    /// Metres in a unit; 0 where unknown.
    pub metres_per_unit: f64,
}

impl Default for Grammar {
    fn default() -> Self {
        Grammar {
            constants: BTreeMap::new(),
            given: BTreeMap::new(),
            axiom: Vec::new(),
            rules: Rules::default(),
            context_first: true,
            decomposition: Rules::default(),
            decomposition_depth: 1,
            homomorphism: Rules::default(),
            recursion: Recursion::Below,
            globals: Vec::new(),
            step_variable: None,
            blocks: Blocks::default(),
            considered: Considered::AllBut(BTreeSet::new()),
            iterations: None,
            seed: 0,
            angle: 90.0,
            step: 1.0,
            width: None,
            taper: std::f64::consts::FRAC_1_SQRT_2,
            tropism: DVec3::ZERO,
            colours: BTreeMap::new(),
            surfaces: BTreeMap::new(),
            materials: Materials::default(),
            actions: alphabet::book(),
            words: BTreeMap::new(),
            frame: DMat3::from_cols(DVec3::Y, DVec3::NEG_X, DVec3::Z),
            axes: DMat3::IDENTITY,
            first_colour: 0.0,
            warnings: Warnings::default(),
            metres_per_unit: 0.0,
        }
    }
}

impl Grammar {
    /// Test whether whole strings have to follow each other, because productions look at neighbours or share variables.
    pub fn by_strings(&self) -> bool {
        let rules = [&self.rules, &self.decomposition, &self.homomorphism];
        rules.iter().any(|r| r.in_context())
            || rules.iter().flat_map(|r| r.iter()).any(Production::shares)
            || self.axiom.iter().flat_map(|m| &m.arguments).any(Expr::shares)
    }

    /// A symbol as its notation writes it.
    pub fn written(&self, symbol: char) -> String {
        self.words.get(&symbol).cloned().unwrap_or_else(|| symbol.to_string())
    }

    /// The colour of an index that need not be whole: between the nearest of the table; white without a table.
    pub fn colour(&self, index: f64) -> [f32; 3] {
        let below = self.colours.iter().rev().find(|(i, _)| **i as f64 <= index);
        let above = self.colours.iter().find(|(i, _)| **i as f64 >= index);
        match (below, above) {
            (Some((i, a)), Some((j, b))) if i != j => {
                let t = ((index - *i as f64) / (*j as f64 - *i as f64)) as f32;
                std::array::from_fn(|k| a[k] + t * (b[k] - a[k]))
            }
            (Some((_, c)), _) | (None, Some((_, c))) => *c,
            (None, None) => [1.0; 3],
        }
    }
}
