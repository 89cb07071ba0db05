//! Files of cpfg, the plant and fractal generator of L-studio and the Virtual Laboratory: `Lsystem: 1` … `endlsystem`.
//!
//! Based on: P. Prusinkiewicz, J. Hanan, R. Měch, *An L-system-based plant modeling language*, AGTIVE 1999; R. Měch, *CPFG
//! Version 4.0 User's Manual*, University of Calgary 2005.

mod patches;
mod preprocess;
mod statements;
#[cfg(test)]
mod tests;
pub mod view;

use std::collections::{BTreeMap, BTreeSet};

use super::symbols::{Symbols, modules, predecessor};
use crate::source::lsystem::alphabet::{
    Action, Alphabet, ColourChange, ColourRange, Fallback, Forward, Given, Ratio, RatioChange, WidthChange,
    WidthParameter, common,
};
use crate::source::lsystem::expr::Expr;
use crate::source::lsystem::expr_parser;
use crate::source::lsystem::grammar::{Considered, Grammar, Module, Production, Recursion};
use crate::source::lsystem::lexer::{Char, Comments, Cursor, Parsed, characters_but};
use crate::source::lsystem::parser::START_OF_FILE;
use statements::{Scope, Statements, Variables};

/// Depth of a homomorphism or decomposition: more is recursion without an end.
const MAX_DEPTH: f64 = 1e6;
/// Colours of a map.
const COLOURS: u16 = 256;

/// Modules of the turtle that are words, and what they do; those without an action have nothing to do with a shape of cones.
const WORDS: [(&str, Option<Action>); 17] = [
    ("@v", Some(Action::Level)),
    ("@O", Some(Action::Ball(1.0))),
    ("@o", Some(Action::Disc(1.0))),
    ("@c", Some(Action::Disc(1.0))),
    ("@M", Some(Action::MoveTo)),
    ("@R", Some(Action::Head)),
    ("@D", Some(Action::Length(Ratio { change: RatioChange::Set, default: 1.0 }))),
    ("@Di", Some(Action::Length(Ratio { change: RatioChange::Multiply, default: 1.0 }))),
    ("@Dd", Some(Action::Length(Ratio { change: RatioChange::Divide, default: 1.0 }))),
    // Generalized cylinders: limbs are joined smoothly in any case.
    ("@Gs", None),
    ("@Gc", None),
    ("@Ge", None),
    ("@Gt", None),
    ("@Gr", None),
    // Sides of a cylinder, labels, and the texture of a segment.
    ("@!", None),
    ("@L", None),
    ("@Tx", None),
];

/// Symbols that are no words. Of sub-L-systems and queries are `$` and `?`.
fn is_symbol(c: char) -> bool {
    !c.is_whitespace() && !"<>:*()@~".contains(c)
}

/// The part of a file that a line belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Header,
    Productions,
    Decomposition,
    Homomorphism,
}

struct Reader {
    grammar: Grammar,
    symbols: Symbols,
    variables: Variables,
    part: Part,
    begun: bool,
    /// Whether a seed is given, and so productions are chosen by lot.
    stochastic: bool,
}

/// Read a file. `define`: values in place of its own of these names.
pub fn grammar(text: &str, define: &BTreeMap<String, f64>) -> Parsed<Grammar> {
    let chars = characters_but(text, Comments::Block)?;
    let preprocess::Preprocessed { chars, constants } = preprocess::expand(&chars, define)?;
    let mut symbols = Symbols::new(is_symbol);
    let mut actions = alphabet();
    for (word, action) in WORDS {
        let symbol = symbols.word(word);
        actions.extend(action.map(|action| (symbol, action)));
    }
    // Of queries of the environment and of sub-L-systems.
    ["?", "$"].iter().for_each(|word| symbols.refuse(word));
    let grammar = Grammar {
        constants,
        actions,
        context_first: false,
        recursion: Recursion::Depth(1),
        angle: 45.0,
        first_colour: 128.0,
        ..Grammar::default()
    };
    let mut reader = Reader {
        grammar,
        symbols,
        variables: Variables::default(),
        part: Part::Header,
        begun: false,
        stochastic: false,
    };
    reader.grammar.step_variable = Some(reader.variables.add("Q".into()));
    let mut ended = false;
    for line in lines(&chars) {
        if ended {
            let at = line.first().copied().unwrap_or(START_OF_FILE);
            return Err(at.fault("a second L-system; sub-L-systems are not read"));
        }
        ended = reader.line(line)?;
    }
    if !reader.begun {
        return Err(START_OF_FILE.fault("there is no L-system; it begins with a line such as Lsystem: 1"));
    }
    let missing = |what: &str| START_OF_FILE.fault(format!("there is no {what}"));
    if reader.grammar.axiom.is_empty() && reader.part == Part::Header {
        return Err(missing("axiom"));
    }
    reader.finish()
}

/// Keywords by how they are written: words apart by a blank or not, of large or small first letters.
fn keyword(line: &[Char], word: &str) -> Option<usize> {
    let mut at = 0;
    for w in word.chars() {
        match line.get(at).map(|c| c.c) {
            Some(c) if w != ' ' && c.eq_ignore_ascii_case(&w) => at += 1,
            Some(' ' | '\t') if w == ' ' => at += 1,
            _ if w == ' ' => {}
            _ => return None,
        }
    }
    Some(at)
}

/// Keywords that a block of statements follows.
const BLOCKS: [&str; 5] = ["start:", "start each:", "end each:", "end:", "define:"];
/// Keywords that begin a line, with `:` where one belongs to them.
const HEADS: [&str; 11] = [
    "lsystem:",
    "seed:",
    "derivation length:",
    "maximum depth:",
    "consider:",
    "ignore:",
    "axiom:",
    "ring lsystem",
    "homomorphism",
    "decomposition",
    "endlsystem",
];

/// Runs of lines that belong together: of blocks to the brace that ends them, of productions to the arrow; and what begins
/// with a space goes on with what stands above it.
fn lines(chars: &[Char]) -> Vec<&[Char]> {
    let mut out: Vec<(usize, usize)> = Vec::new();
    let (mut start, mut depth, mut needs_arrow) = (0, 0usize, false);
    for line in chars.split_inclusive(|c| c.c == '\n') {
        let range = (start, start + line.len());
        start = range.1;
        let indent = line.iter().position(|c| !c.c.is_whitespace());
        let Some(indent) = indent else { continue };
        let text = &line[indent..];
        let is = |list: &[&str]| list.iter().any(|word| keyword(text, word).is_some());
        let (block, head) = (is(&BLOCKS), is(&HEADS));
        let has_arrow = arrow(line).is_some();
        let goes_on = depth > 0 || (!block && !head && (needs_arrow || (indent > 0 && !has_arrow && !out.is_empty())));
        if goes_on {
            if let Some(last) = out.last_mut() {
                last.1 = range.1;
            }
            needs_arrow &= !has_arrow;
        } else {
            out.push(range);
            needs_arrow = !block && !head && !has_arrow;
        }
        if depth > 0 || (block && !goes_on) {
            // A text in quotes may hold braces.
            for part in line.split(|c| c.c == '"').step_by(2) {
                for c in part {
                    match c.c {
                        '{' => depth += 1,
                        '}' => depth = depth.saturating_sub(1),
                        _ => {}
                    }
                }
            }
        }
    }
    let trimmed = |(a, b): (usize, usize)| {
        let run = &chars[a..b];
        let from = run.iter().position(|c| !c.c.is_whitespace()).unwrap_or(0);
        let to = run.iter().rposition(|c| !c.c.is_whitespace()).map_or(0, |i| i + 1);
        &run[from..to]
    };
    out.into_iter().map(trimmed).collect()
}

/// Index of the arrow, `-->` or `-o>`.
fn arrow(chars: &[Char]) -> Option<usize> {
    chars.windows(3).position(|w| w[0].c == '-' && matches!(w[1].c, '-' | 'o') && w[2].c == '>')
}

impl Reader {
    /// Read a line; true where it ends the L-system.
    fn line(&mut self, line: &[Char]) -> Parsed<bool> {
        let at = line.first().copied().unwrap_or(START_OF_FILE);
        let head = HEADS.iter().chain(&BLOCKS).find_map(|word| keyword(line, word).map(|n| (*word, n)));
        let Some((word, n)) = head else {
            self.production(line, at)?;
            return Ok(false);
        };
        let mut cursor = Cursor::new(&line[n..], line[n - 1]);
        if !self.begun && word != "lsystem:" {
            return Err(at.fault("an L-system begins with a line such as Lsystem: 1"));
        }
        match word {
            "lsystem:" if self.begun => return Err(at.fault("a second L-system; sub-L-systems are not read")),
            "lsystem:" => {
                self.begun = true;
                while cursor.next().is_some() {}
            }
            "seed:" => {
                let seed = self.whole(&mut cursor, 1e15)?;
                // The homomorphism's own seed says nothing of what is drawn by one stream of lots.
                if self.part == Part::Header {
                    (self.grammar.seed, self.stochastic) = (seed, true);
                }
            }
            "derivation length:" => {
                let n = self.whole(&mut cursor, 1e15)?;
                self.grammar.iterations = Some(n);
                self.grammar.constants.insert("Z".into(), n as f64);
            }
            "maximum depth:" => {
                let depth = self.whole(&mut cursor, MAX_DEPTH)?;
                match self.part {
                    Part::Decomposition => self.grammar.decomposition_depth = depth,
                    Part::Homomorphism => self.grammar.recursion = Recursion::Depth(depth),
                    _ => return Err(at.fault("a maximum depth belongs to a decomposition or a homomorphism")),
                }
            }
            "consider:" => self.grammar.considered = Considered::Only(self.set(&mut cursor)),
            "ignore:" => self.grammar.considered = Considered::AllBut(self.set(&mut cursor)),
            "ring lsystem" => return Err(at.fault("ring L-systems, whose ends are neighbours, are not read")),
            "axiom:" => {
                self.grammar.axiom = self.modules(&mut cursor, &[])?;
                self.part = Part::Productions;
            }
            "decomposition" | "homomorphism" => {
                cursor.take(':');
                let _ = cursor.take_text("no warnings") || cursor.take_text("warnings");
                self.part = if word == "homomorphism" { Part::Homomorphism } else { Part::Decomposition };
            }
            "endlsystem" => return Ok(true),
            "define:" => self.statements(Scope::File).arrays(&mut cursor)?,
            _ => self.block(word, &mut cursor)?,
        }
        if cursor.at_end() { Ok(false) } else { Err(cursor.unexpected("the end of the line")) }
    }

    /// A block of statements, that runs when `word` says.
    fn block(&mut self, word: &str, cursor: &mut Cursor) -> Parsed<()> {
        let block = self.statements(Scope::File).block(cursor, 0)?;
        let blocks = &mut self.grammar.blocks;
        *match word {
            "start:" => &mut blocks.start,
            "start each:" => &mut blocks.start_each,
            "end each:" => &mut blocks.end_each,
            _ => &mut blocks.end,
        } = block;
        Ok(())
    }

    fn statements<'s>(&'s mut self, scope: Scope<'s>) -> Statements<'s> {
        Statements { variables: &mut self.variables, constants: &self.grammar.constants, scope }
    }

    fn whole(&self, cursor: &mut Cursor, most: f64) -> Parsed<u64> {
        cursor.skip_space();
        let place = cursor.place();
        let value = expr_parser::parse(cursor, &self.variables.names(&self.grammar.constants, &[]))?.constant();
        match value {
            Some(v) if v == v.floor() && (0.0..=most).contains(&v) => Ok(v as u64),
            _ => Err(place.fault(format!("this is not a whole number from 0 to {most}"))),
        }
    }

    fn set(&self, cursor: &mut Cursor) -> BTreeSet<char> {
        let mut out = BTreeSet::new();
        while !cursor.at_end() {
            out.extend(cursor.next().map(|c| c.c));
        }
        out
    }

    /// Symbols with parameters. Surfaces become words of two characters, each with an action of its own.
    fn modules(&mut self, cursor: &mut Cursor, own: &[String]) -> Parsed<Vec<Module>> {
        self.surfaces(cursor.rest());
        let names = self.variables.names(&self.grammar.constants, own);
        let list = modules(cursor, &self.symbols, &names)?;
        match cursor.peek() {
            Some('@') => {
                let name: String = cursor.rest().iter().take(3).map(|c| c.c).take_while(|c| *c != '(').collect();
                Err(cursor.place().fault(format!("the module {name} is not read")))
            }
            _ => Ok(list),
        }
    }

    fn surfaces(&mut self, chars: &[Char]) {
        for pair in chars.windows(2).filter(|w| w[0].c == '~' && !w[1].c.is_whitespace()) {
            let word: String = pair.iter().map(|c| c.c).collect();
            let symbol = self.symbols.word(&word);
            self.grammar.words.insert(symbol, word);
            self.grammar.actions.insert(symbol, Action::ScaledSurface);
        }
    }

    /// `left < predecessor > right : { before } condition { after } --> successor : probability`.
    fn production(&mut self, line: &[Char], at: Char) -> Parsed<()> {
        if self.part == Part::Header {
            let known = "seed, derivation length, ignore, consider, define, start, starteach, endeach, end, axiom";
            return Err(at.fault(format!("what a line before the axiom says is none of {known}")));
        }
        let Some(arrow) = arrow(line) else { return Err(at.fault("a production has an arrow, -->")) };
        let (head, tail) = (&line[..arrow], &line[arrow + 3..]);
        self.surfaces(head);
        let colon = head.iter().position(|c| c.c == ':');
        let mut own = Vec::new();
        let (left, pattern, right) = predecessor(&head[..colon.unwrap_or(head.len())], at, &self.symbols, &mut own)?;
        if let Some(name) = own.iter().find(|name| self.grammar.constants.contains_key(*name)) {
            return Err(at.fault(format!("the parameter {name} is a #define already")));
        }
        let parameters = own.len();
        let mut production = Production::new(left, pattern, right);
        if let Some(colon) = colon {
            let mut cursor = Cursor::new(&head[colon + 1..], head[colon]);
            cursor.skip_space();
            if cursor.peek() == Some('{') {
                production.before = self.statements(Scope::Production(&mut own)).block(&mut cursor, 0)?;
            }
            cursor.skip_space();
            if !cursor.take('*') && !matches!(cursor.peek(), None | Some('{')) {
                let names = self.variables.names(&self.grammar.constants, &own);
                production.condition = Some(expr_parser::parse(&mut cursor, &names)?);
            }
            cursor.skip_space();
            if cursor.peek() == Some('{') {
                production.after = self.statements(Scope::Production(&mut own)).block(&mut cursor, 0)?;
            }
            if !cursor.at_end() {
                return Err(cursor.unexpected("'-->' or an operator"));
            }
        }
        let mut cursor = Cursor::new(tail, line[arrow + 2]);
        if !cursor.take('*') {
            production.successor = self.modules(&mut cursor, &own)?;
        }
        let mut weight = None;
        if cursor.take(':') {
            let names = self.variables.names(&self.grammar.constants, &own);
            weight = Some(expr_parser::parse(&mut cursor, &names)?);
        }
        if !cursor.at_end() {
            return Err(cursor.unexpected("a symbol or ':' and a probability"));
        }
        production.variables = own.len() - parameters;
        self.add(production, weight, at)
    }

    fn add(&mut self, mut production: Production, weight: Option<Expr>, at: Char) -> Parsed<()> {
        match self.part {
            Part::Productions | Part::Header if self.stochastic => {
                production.weight = Some(weight.unwrap_or(Expr::Number(1.0)));
            }
            _ if weight.is_some() => {
                let what = "probabilities are passed over: the file has no seed, and so its first production that matches is taken";
                self.grammar.warnings.add(what);
            }
            _ => {}
        }
        match self.part {
            Part::Header | Part::Productions => self.grammar.rules.append(production),
            Part::Decomposition => self.grammar.decomposition.append(production),
            Part::Homomorphism if production.in_context() => {
                return Err(at.fault("a production of a homomorphism has no context"));
            }
            Part::Homomorphism => self.grammar.homomorphism.append(production),
        }
        Ok(())
    }

    fn finish(mut self) -> Parsed<Grammar> {
        self.grammar.globals = self.variables.values;
        // It is a macro's or a variable's as the file says, and never a constant of the command line.
        self.grammar.constants.remove("Z");
        Ok(self.grammar)
    }
}

/// The letters of cpfg's turtle. Its up points away from us: it rolls the other way.
fn alphabet() -> Alphabet {
    let line = Forward { width: WidthParameter::Nothing, ..Forward::DRAW };
    let width = |sign| Action::Width(WidthChange { parameter: Given::Set(1.0), otherwise: Fallback::Add(sign) });
    let colour =
        |default| Action::Colour(ColourChange { default, relative: 0.0, range: ColourRange::Wrapped(COLOURS) });
    let mut out = common();
    out.extend([
        ('F', Action::Forward(line)),
        ('G', Action::Forward(Forward { corner: false, ..line })),
        ('f', Action::Forward(Forward { draws: false, ..line })),
        ('g', Action::Forward(Forward { draws: false, corner: false, ..line })),
        ('&', Action::pitch(-1.0)),
        ('^', Action::pitch(1.0)),
        ('/', Action::roll(-1.0)),
        ('\\', Action::roll(1.0)),
        ('{', Action::BeginPolygon),
        ('.', Action::Corner),
        ('}', Action::EndPolygon),
        ('#', width(0.0)),
        ('!', width(0.0)),
        (';', colour(1.0)),
        (',', colour(-1.0)),
        ('%', Action::Cut),
    ]);
    out
}
