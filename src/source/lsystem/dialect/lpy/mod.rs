//! L-Py's files, as far as they need no Python: `Axiom: A(1)`, `production:`, `A(x) --> F(x) A(x+1)`, and rules of
//! `if`, `produce` and `nproduce`.
//!
//! Based on: F. Boudon, C. Pradal, T. Cokelaer, P. Prusinkiewicz, C. Godin, *L-Py: an L-system simulation framework for modeling
//! plant architecture development based on a dynamic language*, Frontiers in Plant Science 3:76, 2012.

mod colours;
mod python;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};

use super::symbols::{Symbols, modules, predecessor};
use crate::geom::{DMat3, DVec3};
use crate::source::lsystem::alphabet::{
    Action, Alphabet, ColourChange, ColourRange, Fallback, Forward, Given, Ratio, RatioChange, WidthChange,
    WidthParameter, common,
};
use crate::source::lsystem::expr::{Binary, Expr};
use crate::source::lsystem::expr_parser::{self, Names, Syntax};
use crate::source::lsystem::grammar::{Considered, Grammar, Module, Production, Recursion, Surface};
use crate::source::lsystem::lexer::{Char, Comments, Cursor, Parsed, characters_but};
use crate::source::lsystem::parser::START_OF_FILE;
use crate::source::lsystem::predecessor::Predecessor;
use python::Line;

/// Depth of an interpretation or decomposition: more is recursion without an end.
const MAX_DEPTH: f64 = 1e6;
/// What ends a file's L-system for good: what follows was written by L-Py's window.
const WINDOW: &str = "###### INITIALISATION ######";

/// Symbols that have a word as well.
const ALIASES: [(&str, char); 18] = [
    ("SB", '['),
    ("EB", ']'),
    ("Left", '+'),
    ("Right", '-'),
    ("Up", '^'),
    ("Down", '&'),
    ("RollL", '/'),
    ("RollR", '\\'),
    ("TurnAround", '|'),
    ("BP", '{'),
    ("EP", '}'),
    ("PP", '.'),
    ("IncWidth", '_'),
    ("DecWidth", '!'),
    ("IncColor", ';'),
    ("DecColor", ','),
    ("Cut", '%'),
    ("SetWidth", '_'),
];

/// Words that the turtle acts on, or that have nothing to do with a shape of cones.
const WORDS: [(&str, Option<Action>); 28] = [
    ("@v", Some(Action::Level)),
    ("RollToVert", Some(Action::Level)),
    ("@O", Some(Action::Ball(2.0))),
    ("Sphere", Some(Action::Ball(2.0))),
    ("@o", Some(Action::Disc(2.0))),
    ("Circle", Some(Action::Disc(2.0))),
    ("@M", Some(Action::MoveTo)),
    ("MoveTo", Some(Action::MoveTo)),
    ("@R", Some(Action::Head)),
    ("SetHead", Some(Action::Head)),
    ("@D", Some(scale(RatioChange::Set))),
    ("SetScale", Some(scale(RatioChange::Set))),
    ("@Di", Some(scale(RatioChange::Multiply))),
    ("MultScale", Some(scale(RatioChange::Multiply))),
    ("@Dd", Some(scale(RatioChange::Divide))),
    ("DivScale", Some(scale(RatioChange::Divide))),
    (SET_COLOUR, Some(Action::Colour(ColourChange { default: 0.0, relative: 0.0, range: ColourRange::Any }))),
    ("@Gc", None),
    ("StartGC", None),
    ("@Ge", None),
    ("EndGC", None),
    ("SectionResolution", None),
    ("TextureScale", None),
    ("TextureUScale", None),
    ("TextureVScale", None),
    ("TextureVCoeff", None),
    ("TextureTranslation", None),
    ("TextureRotation", None),
];

/// The word whose three parameters are a colour of bytes.
const SET_COLOUR: &str = "SetColor";

/// Words that are known and not read.
const REFUSED: [&str; 44] = [
    "nF",
    "LineTo",
    "OLineTo",
    "LineRel",
    "OLineRel",
    "MoveRel",
    "Pinpoint",
    "PinpointRel",
    "EulerAngles",
    "Frame",
    "SetContour",
    "SetGuide",
    "EndGuide",
    "Sweep",
    "PositionOnGuide",
    "iRollL",
    "iRollR",
    "LeftReflection",
    "UpReflection",
    "HeadingReflection",
    "@2D",
    "@3D",
    "StartScreenProjection",
    "EndScreenProjection",
    "@B",
    "Box",
    "@b",
    "Quad",
    "@g",
    "PglShape",
    "@L",
    "Label",
    "surface",
    "@Ts",
    "Elasticity",
    "@Tp",
    "Tropism",
    "?P",
    "?H",
    "?U",
    "?L",
    "?R",
    "?F",
    "InterpolateColors",
];

const fn scale(change: RatioChange) -> Action {
    Action::Length(Ratio { change, default: 1.0 })
}

/// Characters that are symbols. What follows `~` makes a word with it; other words of signs are listed above.
fn is_symbol(c: char) -> bool {
    c.is_alphanumeric() || "+-&^\\/|[]{}.!_;,%".contains(c)
}

/// The part of a file that a line belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Header,
    Production,
    Decomposition,
    Interpretation,
}

struct Reader<'a> {
    grammar: Grammar,
    symbols: Symbols,
    define: &'a BTreeMap<String, f64>,
    part: Part,
    set_colour: char,
    axiom: bool,
}

impl python::Context for Reader<'_> {
    fn string(&mut self, cursor: &mut Cursor, own: &[String]) -> Parsed<Vec<Module>> {
        Reader::string(self, cursor, own)
    }
    fn names<'n>(&'n self, own: &'n [String]) -> Names<'n> {
        Reader::names(self, own)
    }
    fn constant(&self, name: &str) -> Option<f64> {
        self.grammar.constants.get(name).copied()
    }
}

/// Read a file. `define`: values in place of its own constants of these names.
pub fn grammar(text: &str, define: &BTreeMap<String, f64>) -> Parsed<Grammar> {
    let (own, window) = text.split_once(WINDOW).unwrap_or((text, ""));
    let chars = characters_but(own, Comments::ToEnd('#'))?;
    let mut symbols = Symbols::new(is_symbol);
    let mut actions = alphabet();
    ALIASES.iter().for_each(|(word, symbol)| symbols.alias(word, *symbol));
    for (word, action) in WORDS {
        let symbol = symbols.word(word);
        actions.extend(action.map(|action| (symbol, action)));
    }
    REFUSED.iter().for_each(|word| symbols.refuse(word));
    let mut grammar = Grammar {
        actions,
        context_first: false,
        recursion: Recursion::Depth(1),
        iterations: Some(1),
        angle: 60.0,
        width: Some(0.2),
        colours: colours::materials(window),
        first_colour: 1.0,
        axes: DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y),
        ..Grammar::default()
    };
    // Its leaf: a hexagon of length 1 and half as wide.
    let leaf = symbols.word("~l");
    let (third, two) = (1.0 / 3.0, 2.0 / 3.0);
    let corners = [(0.0, 0.0), (0.25, third), (0.25, two), (0.0, 1.0), (-0.25, two), (-0.25, third)];
    let corners = corners.map(|(x, y)| DVec3::new(x, y, 0.0)).to_vec();
    grammar.surfaces.insert(leaf, Surface::Polygon { corners, colour: None });
    let set_colour = symbols.word(SET_COLOUR);
    let mut reader = Reader { grammar, symbols, define, part: Part::Header, set_colour, axiom: false };
    let lines = python::lines(&chars)?;
    let mut i = 0;
    while let Some(line) = lines.get(i) {
        // What is indented below a line belongs to it.
        let below = lines[i + 1..].iter().take_while(|l| l.indent > line.indent).count();
        if reader.line(line, &lines[i + 1..i + 1 + below])? {
            break;
        }
        i += 1 + below;
    }
    match reader.axiom {
        true => Ok(reader.grammar),
        false => Err(START_OF_FILE.fault("there is no axiom; write one as Axiom: F")),
    }
}

impl Reader<'_> {
    /// Read a line that is not indented, and those below it that are; true where it ends the L-system.
    fn line(&mut self, line: &Line, below: &[Line]) -> Parsed<bool> {
        let at = line.place();
        let mut cursor = Cursor::new(&line.chars, at);
        let takes = |cursor: &mut Cursor, word: &str| {
            let mut ahead = cursor.clone();
            let found = ahead.take_text(word) && ahead.take(':');
            if found {
                *cursor = ahead;
            }
            found
        };
        if cursor.begins("from") || cursor.begins("import") {
            // Names that it brings are not known where they are used.
            return Ok(false);
        }
        if cursor.take_text("endlsystem") {
            return Ok(true);
        }
        for (word, part) in [
            ("production", Part::Production),
            ("decomposition", Part::Decomposition),
            ("interpretation", Part::Interpretation),
            ("homomorphism", Part::Interpretation),
        ] {
            if takes(&mut cursor, word) {
                self.part = part;
                return self.nothing(&mut cursor, below);
            }
        }
        if takes(&mut cursor, "Axiom") {
            self.axiom(&mut cursor, line, below)?;
            return Ok(false);
        }
        if takes(&mut cursor, "derivation length") {
            self.grammar.iterations = Some(self.whole(&mut cursor, 1e15)?);
        } else if takes(&mut cursor, "maximum depth") {
            let depth = self.whole(&mut cursor, MAX_DEPTH)?;
            match self.part {
                Part::Decomposition => self.grammar.decomposition_depth = depth,
                Part::Interpretation => self.grammar.recursion = Recursion::Depth(depth),
                _ => return Err(at.fault("a maximum depth belongs to a decomposition or an interpretation")),
            }
        } else if takes(&mut cursor, "ignore") {
            self.grammar.considered = Considered::AllBut(self.set(&mut cursor));
        } else if takes(&mut cursor, "consider") {
            self.grammar.considered = Considered::Only(self.set(&mut cursor));
        } else if cursor.begins("module ") {
            cursor.take_text("module");
            self.declare(&mut cursor)?;
        } else if let Some(name) = assigned(&mut cursor) {
            self.constant(name, &mut cursor)?;
        } else if self.part == Part::Header || python::is_statement(&cursor) {
            let word = cursor.word(|c| !c.is_whitespace() && !"(:".contains(c));
            return Err(at.fault(format!("{word}: Python is not run here")));
        } else {
            self.rule(line, below)?;
            return Ok(false);
        }
        self.nothing(&mut cursor, below)
    }

    /// That the line is at its end, and nothing is below it.
    fn nothing(&self, cursor: &mut Cursor, below: &[Line]) -> Parsed<bool> {
        match below.first().and_then(|l| l.chars.first()) {
            Some(c) => Err(c.fault("an indented line where none belongs")),
            None if cursor.at_end() => Ok(false),
            None => Err(cursor.unexpected("the end of the line")),
        }
    }

    fn names<'n>(&'n self, own: &'n [String]) -> Names<'n> {
        Names::new(Syntax::Python, &self.grammar.constants, own)
    }

    fn whole(&self, cursor: &mut Cursor, most: f64) -> Parsed<u64> {
        cursor.skip_space();
        let place = cursor.place();
        match expr_parser::parse(cursor, &self.names(&[]))?.constant() {
            Some(v) if v == v.floor() && (0.0..=most).contains(&v) => Ok(v as u64),
            _ => Err(place.fault(format!("this is not a whole number from 0 to {most}"))),
        }
    }

    fn set(&self, cursor: &mut Cursor) -> BTreeSet<char> {
        let mut out = BTreeSet::new();
        while let Some((symbol, _)) = self.symbols.take(cursor) {
            out.insert(symbol);
        }
        out
    }

    /// `module Apex(age), Leaf`: words that are symbols from here on.
    fn declare(&mut self, cursor: &mut Cursor) -> Parsed<()> {
        loop {
            cursor.skip_space();
            let word = cursor.word(|c| c.is_alphanumeric() || c == '_');
            if word.is_empty() {
                return Err(cursor.unexpected("the name of a module"));
            }
            if word.chars().count() > 1 {
                let symbol = self.symbols.word(&word);
                self.grammar.words.insert(symbol, word);
            }
            if cursor.take('(') {
                cursor.word(|c| c != ')');
                cursor.take(')');
            }
            if !cursor.take(',') {
                // What follows a colon says how it is shown.
                if cursor.peek() == Some(':') {
                    cursor.word(|_| true);
                }
                return Ok(());
            }
        }
    }

    fn constant(&mut self, name: String, cursor: &mut Cursor) -> Parsed<()> {
        let place = cursor.place();
        let value = expr_parser::parse(cursor, &self.names(&[]))
            .map_err(|f| place.fault(format!("{name} is set by Python that is not run here: {}", f.what)))?;
        let Some(value) = value.constant().filter(|v| v.is_finite()) else {
            return Err(place.fault(format!("{name} is not a finite number")));
        };
        cursor.take(')');
        let value = self.define.get(&name).copied().unwrap_or(value);
        self.grammar.constants.insert(name, value);
        Ok(())
    }

    fn axiom(&mut self, cursor: &mut Cursor, line: &Line, below: &[Line]) -> Parsed<()> {
        self.axiom = true;
        if cursor.at_end() && !below.is_empty() {
            let paths = python::paths(self, &[], &Line::default(), below)?;
            let [path] = &paths[..] else {
                return Err(line.place().fault("an axiom by Python is read where it is produced without conditions"));
            };
            if !path.before.is_empty() {
                return Err(line.place().fault("an axiom by Python is read where it is produced without variables"));
            }
            self.grammar.axiom.clone_from(&path.successor);
            return Ok(());
        }
        self.grammar.axiom = self.string(cursor, &[])?;
        self.nothing(cursor, below).map(|_| ())
    }

    /// Symbols with parameters to the end; `*` for none.
    fn string(&mut self, cursor: &mut Cursor, own: &[String]) -> Parsed<Vec<Module>> {
        // Surfaces are words of two characters, each with an action of its own.
        for pair in cursor.rest().windows(2).filter(|w| w[0].c == '~' && w[1].c.is_alphanumeric()) {
            let word: String = pair.iter().map(|c| c.c).collect();
            let symbol = self.symbols.word(&word);
            self.grammar.words.insert(symbol, word);
            self.grammar.actions.insert(symbol, Action::OwnSurface);
        }
        let mut list = modules(cursor, &self.symbols, &self.names(own))?;
        if list.is_empty() {
            cursor.take('*');
        }
        if !cursor.at_end() {
            return Err(cursor.unexpected("a symbol"));
        }
        // A colour's parts go to 255.
        for module in list.iter_mut().filter(|m| m.symbol == self.set_colour && m.arguments.len() >= 3) {
            for argument in &mut module.arguments {
                let part = std::mem::replace(argument, Expr::Number(0.0));
                *argument = Expr::Binary(Binary::Divide, Box::new([part, Expr::Number(255.0)]));
            }
        }
        Ok(list)
    }

    /// `left < predecessor > right --> successor`, or a colon and Python.
    fn rule(&mut self, line: &Line, below: &[Line]) -> Parsed<()> {
        let chars = &line.chars;
        let at = line.place();
        let arrow = chars.windows(3).position(|w| w[0].c == '-' && w[1].c == '-' && w[2].c == '>');
        let mut own = Vec::new();
        if let Some(arrow) = arrow {
            let (left, pattern, right) = self.predecessor(&chars[..arrow], at, &mut own)?;
            let mut production = Production::new(left, pattern, right);
            production.successor = self.string(&mut Cursor::new(&chars[arrow + 3..], chars[arrow + 2]), &own)?;
            self.nothing(&mut Cursor::new(&[], at), below)?;
            return self.add(production, at);
        }
        let mut depth = 0i64;
        let colon = chars.iter().position(|c| {
            depth += i64::from(c.c == '(') - i64::from(c.c == ')');
            c.c == ':' && depth == 0
        });
        let Some(colon) = colon else {
            let last = chars.last().copied().unwrap_or(at);
            return Err(Cursor::new(&[], last).unexpected("'-->' or ':' of a rule"));
        };
        let (left, pattern, right) = self.predecessor(&chars[..colon], at, &mut own)?;
        let first = Line { indent: line.indent + 1, chars: chars[colon + 1..].to_vec() };
        let parameters = own.len();
        for path in python::paths(self, &own, &first, below)? {
            let mut production = Production::new(left.clone(), pattern, right.clone());
            (production.before, production.successor) = (path.before, path.successor);
            production.variables = path.names.len() - parameters;
            self.add(production, at)?;
        }
        Ok(())
    }

    fn predecessor(&mut self, chars: &[Char], at: Char, own: &mut Vec<String>) -> Parsed<Predecessor> {
        for (a, b) in [('<', '<'), ('>', '>')] {
            if let Some(pair) = chars.windows(2).find(|w| w[0].c == a && w[1].c == b) {
                return Err(pair[0].fault("contexts in the new string, << and >>, are not read"));
            }
        }
        for pair in chars.windows(2).filter(|w| w[0].c == '~' && w[1].c.is_alphanumeric()) {
            let word: String = pair.iter().map(|c| c.c).collect();
            self.symbols.word(&word);
        }
        predecessor(chars, at, &self.symbols, own)
    }

    fn add(&mut self, production: Production, at: Char) -> Parsed<()> {
        match self.part {
            Part::Header | Part::Production => self.grammar.rules.append(production),
            Part::Decomposition => self.grammar.decomposition.append(production),
            Part::Interpretation if production.in_context() => {
                return Err(at.fault("a rule of an interpretation has no context here"));
            }
            Part::Interpretation => self.grammar.homomorphism.append(production),
        }
        Ok(())
    }
}

/// The name before an `=` that is no comparison: `dt = 2`, `extern(dt = 2)`.
fn assigned(cursor: &mut Cursor) -> Option<String> {
    let mut ahead = cursor.clone();
    if ahead.take_text("extern") {
        ahead.take('(');
    }
    ahead.skip_space();
    let name = ahead.word(|c| expr_parser::begins_name(c) || c.is_ascii_digit());
    if !name.starts_with(expr_parser::begins_name) || !ahead.take('=') || ahead.peek() == Some('=') {
        return None;
    }
    ahead.skip_space();
    *cursor = ahead;
    Some(name)
}

/// The letters of L-Py's turtle.
fn alphabet() -> Alphabet {
    let width = |sign| Action::Width(WidthChange { parameter: Given::Set(2.0), otherwise: Fallback::Add(2.0 * sign) });
    let colour = |default| Action::Colour(ColourChange { default, relative: 0.0, range: ColourRange::Any });
    let line = Forward { width: WidthParameter::AtEnd(2.0), ..Forward::DRAW };
    let mut out = common();
    out.extend([
        ('F', Action::Forward(line)),
        ('f', Action::Forward(Forward { draws: false, ..line })),
        ('&', Action::pitch(-1.0)),
        ('^', Action::pitch(1.0)),
        ('/', Action::roll(1.0)),
        ('\\', Action::roll(-1.0)),
        ('{', Action::BeginPolygon),
        ('.', Action::Corner),
        ('}', Action::EndPolygon),
        ('_', width(1.0)),
        ('!', width(-1.0)),
        (';', colour(1.0)),
        (',', colour(-1.0)),
        ('%', Action::Cut),
    ]);
    out
}
