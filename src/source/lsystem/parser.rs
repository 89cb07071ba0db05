//! Grammar files in the notation of the field → [`Grammar`]. docs/lsystems.md describes what is read.

use std::collections::BTreeMap;

use super::directive;
use super::expr::Expr;
use super::expr_parser::{self, Names, Syntax};
use super::grammar::{Grammar, Module, Pattern, Production};
use super::lexer::{Char, Cursor, Parsed, characters, is_symbol, shown};
use super::predecessor;

/// Brackets within brackets in a right context.
const MAX_NESTED: usize = 64;

/// Kind of a statement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Directive,
    Axiom,
    Production,
}

/// Parse a grammar, or a derived string alone.
#[cfg(test)]
pub fn grammar(text: &str) -> Parsed<Grammar> {
    grammar_with(text, &BTreeMap::new())
}

/// Parse a grammar in which `given` stand in place of its own `#define`s of these names.
pub fn grammar_with(text: &str, given: &BTreeMap<String, f64>) -> Parsed<Grammar> {
    let chars = join_broken_lines(&characters(text)?);
    let mut reader = Reader::new(Grammar { given: given.clone(), ..Grammar::default() });
    for (kind, chars) in statements(&chars) {
        reader.statement(kind, chars)?;
    }
    reader.finish()
}

/// Parse a derived string, which may use the grammar's constants and surfaces.
pub fn string(text: &str, grammar: &Grammar) -> Parsed<Vec<Module>> {
    let chars: Vec<Char> = characters(text)?;
    let mut cursor = Cursor::new(&chars, START);
    let names = Names::new(Syntax::Book, &grammar.constants, &[]);
    let mut named = Vec::new();
    let modules = modules(&mut cursor, &names, &mut named)?;
    if !cursor.at_end() {
        return Err(cursor.unexpected("a symbol"));
    }
    check_surfaces(&named, grammar)?;
    Ok(modules)
}

/// Place before the first character of a text.
const START: Char = Char { c: ' ', line: 1, column: 0 };

/// Runs of lines that belong together: a line that begins nothing new goes on with what stands above it.
fn statements(chars: &[Char]) -> Vec<(Kind, &[Char])> {
    let mut out: Vec<(Kind, usize, usize)> = Vec::new();
    let (mut start, mut braces) = (0, false);
    for line in chars.split_inclusive(|c| c.c == '\n') {
        let range = (start, start + line.len());
        start = range.1;
        let text = line.iter().position(|c| !c.c.is_whitespace()).map(|i| &line[i..]).unwrap_or_default();
        let open = braces;
        let kind = if text.is_empty() || open {
            None
        } else if let Some(kind) = begun(text) {
            Some(kind)
        } else if out.last().is_none_or(|s| s.0 == Kind::Directive) {
            Some(Kind::Axiom)
        } else {
            None
        };
        // Corners of a surface may go over several lines.
        if open || kind == Some(Kind::Directive) {
            for c in line {
                braces = (braces || c.c == '{') && c.c != '}';
            }
        }
        match (kind, out.last_mut()) {
            (Some(kind), _) => out.push((kind, range.0, range.1)),
            (None, Some(last)) => last.2 = range.1,
            (None, None) => {}
        }
    }
    let end = |a: usize, b: usize| chars[a..b].iter().rposition(|c| !c.c.is_whitespace()).map_or(a, |i| a + i + 1);
    out.into_iter().map(|(kind, a, b)| (kind, &chars[a..end(a, b)])).collect()
}

/// Kind of the statement that a line begins, if any; leading spaces are cut off.
fn begun(line: &[Char]) -> Option<Kind> {
    let begins = |word: &str| {
        let n = word.chars().count();
        line.len() > n && word.chars().zip(line).all(|(w, c)| w == c.c)
    };
    if line.first()?.c == '#' {
        Some(Kind::Directive)
    } else if ["axiom:", "axiom :", "ω:", "ω :"].iter().any(|w| begins(w)) {
        Some(Kind::Axiom)
    } else {
        arrow(line).map(|_| Kind::Production)
    }
}

/// Lines that end in a backslash, joined to the next. The backslash is a symbol as well: it is one where there is no next
/// line, and where that begins something new.
fn join_broken_lines(chars: &[Char]) -> Vec<Char> {
    let lines: Vec<&[Char]> = chars.split_inclusive(|c| c.c == '\n').collect();
    let mut out = Vec::with_capacity(chars.len());
    for (i, &line) in lines.iter().enumerate() {
        let next = lines.get(i + 1).copied().unwrap_or_default();
        let start = next.iter().position(|c| !c.c.is_whitespace());
        let goes_on = start.is_some_and(|start| begun(&next[start..]).is_none());
        match line.iter().rposition(|c| !c.c.is_whitespace()).filter(|&last| line[last].c == '\\' && goes_on) {
            Some(last) => {
                out.extend(&line[..last]);
                out.push(Char { c: ' ', ..line[last] });
            }
            None => out.extend(line),
        }
    }
    out
}

/// Index and length of the first arrow, `→`, `->` or `-->`.
pub fn arrow(chars: &[Char]) -> Option<(usize, usize)> {
    let at = |i: usize| chars.get(i).map(|c| c.c);
    let i = (0..chars.len()).find(|&i| at(i) == Some('→') || (at(i) == Some('-') && at(i + 1) == Some('>')))?;
    if at(i) == Some('→') {
        return Some((i, 1));
    }
    // The first of `-->` is the predecessor where nothing else is.
    let longer = i > 0 && at(i - 1) == Some('-') && chars[..i - 1].iter().any(|c| !c.c.is_whitespace());
    Some(if longer { (i - 1, 3) } else { (i, 2) })
}

/// A grammar while it is read.
pub struct Reader {
    pub grammar: Grammar,
    axiom_at: Option<Char>,
    homomorphism: bool,
    /// Symbols after `~`.
    named: Vec<Char>,
}

impl Reader {
    pub fn new(grammar: Grammar) -> Reader {
        Reader { grammar, axiom_at: None, homomorphism: false, named: Vec::new() }
    }

    fn statement(&mut self, kind: Kind, chars: &[Char]) -> Parsed<()> {
        let mut cursor = Cursor::new(chars, START);
        cursor.skip_space();
        match kind {
            Kind::Axiom => self.axiom(&mut cursor),
            Kind::Production => self.production(chars),
            Kind::Directive => {
                let hash = cursor.place();
                cursor.next();
                let word = cursor.word(|c| c.is_alphanumeric() || c == '_' || c == '-');
                match word.as_str() {
                    "axiom" => self.axiom(&mut cursor),
                    "homomorphism" => {
                        self.homomorphism = true;
                        Ok(())
                    }
                    _ => directive::read(&word, hash, &mut cursor, &mut self.grammar),
                }?;
                if cursor.at_end() { Ok(()) } else { Err(cursor.unexpected("the end of the line")) }
            }
        }
    }

    pub fn axiom(&mut self, cursor: &mut Cursor) -> Parsed<()> {
        let place = cursor.place();
        if let Some(first) = self.axiom_at {
            return Err(place.fault(format!("a second axiom; the first is in line {}", first.line)));
        }
        self.axiom_at = Some(place);
        let mut ahead = cursor.clone();
        let key = ahead.word(char::is_alphabetic);
        if (key == "axiom" || key == "ω") && ahead.take(':') {
            *cursor = ahead;
        }
        let names = Names::new(Syntax::Book, &self.grammar.constants, &[]);
        self.grammar.axiom = modules(cursor, &names, &mut self.named)?;
        if cursor.at_end() { Ok(()) } else { Err(cursor.unexpected("a symbol")) }
    }

    pub fn production(&mut self, chars: &[Char]) -> Parsed<()> {
        let (at, length) = arrow(chars).unwrap_or((chars.len(), 0));
        let (head, tail) = (&chars[..at], chars.get(at + length..).unwrap_or_default());
        let arrow = chars.get(at).copied().unwrap_or(START);
        let mut parts: Vec<&[Char]> = head.split(|c| c.c == ':').collect();
        if parts.len() > 1 && is_label(parts[0]) {
            parts.remove(0);
        }
        let mut parameters = Vec::new();
        let before = Char { column: arrow.column.saturating_sub(1), ..arrow };
        let first = parts[0].iter().position(|c| c.c == '>');
        let (left, predecessor, right) =
            predecessor::parse(parts[0], before, first, |cursor| patterns(cursor, &mut parameters, &self.grammar))?;
        let names = Names::new(Syntax::Book, &self.grammar.constants, &parameters);
        let condition = match parts.get(1) {
            Some(text) => condition(&mut Cursor::new(text, before), &names)?,
            None => None,
        };
        if let Some(more) = parts.get(2) {
            return Err(Cursor::new(more, before).place().fault("more than one condition"));
        }
        let mut cursor = Cursor::new(tail, Char { column: arrow.column + length as u32 - 1, ..arrow });
        if !(cursor.take('ε') || cursor.take('*')) {
            cursor.skip_space();
        }
        let successor = modules(&mut cursor, &names, &mut self.named)?;
        let mut weight = None;
        if cursor.take(':') {
            cursor.skip_space();
            weight = Some(expr_parser::parse(&mut cursor, &names)?);
        }
        if !cursor.at_end() {
            return Err(cursor.unexpected("a symbol or ':' and a probability"));
        }
        let production = Production { condition, weight, successor, ..Production::new(left, predecessor, right) };
        if !self.homomorphism {
            self.grammar.rules.add(production);
        } else if production.in_context() {
            return Err(arrow.fault("a production after #homomorphism has no context"));
        } else {
            self.grammar.homomorphism.add(production);
        }
        Ok(())
    }

    pub fn finish(self) -> Parsed<Grammar> {
        if self.axiom_at.is_none() {
            return Err(START_OF_FILE.fault("there is no axiom; write one as axiom: F"));
        }
        check_surfaces(&self.named, &self.grammar)?;
        Ok(self.grammar)
    }
}

pub const START_OF_FILE: Char = Char { c: ' ', line: 1, column: 1 };

/// That what follows each `~` is a surface, or may become one.
fn check_surfaces(named: &[Char], grammar: &Grammar) -> Parsed<()> {
    let known = |c: char| {
        grammar.surfaces.contains_key(&c) || !grammar.rules.of(c).is_empty() || !grammar.homomorphism.of(c).is_empty()
    };
    match named.iter().find(|c| !known(c.c)) {
        Some(c) => Err(c.fault(format!("there is no #surface {}", c.c))),
        None => Ok(()),
    }
}

/// Test whether `chars` is the label of a production, such as p1: a word of more than one letter.
fn is_label(chars: &[Char]) -> bool {
    let text: String = chars.iter().map(|c| c.c).collect();
    let text = text.trim();
    text.chars().count() > 1 && text.chars().all(char::is_alphanumeric) && text.starts_with(char::is_alphabetic)
}

/// A condition; `*` stands for none.
fn condition(cursor: &mut Cursor, names: &Names) -> Parsed<Option<Expr>> {
    let condition = if cursor.take('*') { None } else { Some(expr_parser::parse(cursor, names)?) };
    if cursor.at_end() { Ok(condition) } else { Err(cursor.unexpected("'→', '->' or an operator")) }
}

/// Symbols with parameters, until something that is none. Brackets have to match; symbols after `~` are added to `named`.
fn modules(cursor: &mut Cursor, names: &Names, named: &mut Vec<Char>) -> Parsed<Vec<Module>> {
    let mut out = Vec::new();
    let mut open: Vec<Char> = Vec::new();
    let mut surface = false;
    loop {
        cursor.skip_space();
        let place = cursor.place();
        let Some(c) = cursor.peek().filter(|c| is_symbol(*c)) else { break };
        cursor.next();
        match c {
            '[' => open.push(place),
            ']' if open.pop().is_none() => return Err(place.fault("']' closes nothing")),
            _ => {}
        }
        if surface {
            named.push(place);
        }
        surface = c == '~';
        let mut arguments = Vec::new();
        if cursor.take('(') {
            loop {
                arguments.push(expr_parser::parse(cursor, names)?);
                if cursor.take(')') {
                    break;
                }
                if !cursor.take(',') {
                    return Err(cursor.unexpected("',', ')' or an operator"));
                }
            }
        }
        out.push(Module { symbol: c, arguments });
    }
    if surface {
        return Err(cursor.unexpected("the symbol of a surface"));
    }
    match open.pop() {
        Some(bracket) => Err(bracket.fault("'[' is never closed")),
        None => Ok(out),
    }
}

/// Symbols with the names of their parameters, to the end. Names are added to `parameters`.
fn patterns(cursor: &mut Cursor, parameters: &mut Vec<String>, grammar: &Grammar) -> Parsed<Vec<Pattern>> {
    let mut out = Vec::new();
    let mut open: Vec<Char> = Vec::new();
    while !cursor.at_end() {
        let place = cursor.place();
        let Some(c) = cursor.next().filter(|c| is_symbol(c.c)) else {
            return Err(place.fault(format!("{} is not a symbol", shown(place.c))));
        };
        match c.c {
            '[' => open.push(place),
            ']' if open.pop().is_none() => return Err(place.fault("']' closes nothing")),
            _ => {}
        }
        if open.len() > MAX_NESTED {
            return Err(place.fault(format!("more than {MAX_NESTED} brackets within each other")));
        }
        let mut count = 0;
        if cursor.take('(') {
            loop {
                cursor.skip_space();
                let place = cursor.place();
                if !cursor.peek().is_some_and(expr_parser::begins_name) {
                    return Err(cursor.unexpected("the name of a parameter"));
                }
                let name = cursor.word(|c| expr_parser::begins_name(c) || c.is_numeric());
                if parameters.contains(&name) {
                    return Err(place.fault(format!("a second parameter {name}")));
                }
                if grammar.constants.contains_key(&name) {
                    return Err(place.fault(format!("{name} is a #define already")));
                }
                parameters.push(name);
                count += 1;
                if cursor.take(')') {
                    break;
                }
                if !cursor.take(',') {
                    return Err(cursor.unexpected("',' or ')'"));
                }
            }
        }
        out.push(Pattern { symbol: c.c, count });
    }
    match open.pop() {
        Some(bracket) => Err(bracket.fault("'[' is never closed")),
        None => Ok(out),
    }
}
