//! Symbols with parameters as the notations of other programs write them: some are words of several characters, which stand
//! in a grammar for symbols of their own.

use std::collections::{BTreeMap, BTreeSet};

use crate::source::lsystem::expr_parser::{self, Names};
use crate::source::lsystem::grammar::{Module, Pattern};
use crate::source::lsystem::lexer::{Char, Cursor, Parsed, shown};
use crate::source::lsystem::predecessor::{self, Predecessor};

/// First of the symbols that words stand for: the private use area that no text has a reason to use.
const FIRST_WORD: u32 = 0xF_0000;
/// Number of them.
const MAX_WORDS: u32 = 0xFFFD;
/// Brackets within brackets in a right context.
const MAX_NESTED: usize = 64;

/// Characters and words that are symbols.
#[derive(Debug, Clone)]
pub struct Symbols {
    words: BTreeMap<String, char>,
    /// Those that are known and not read.
    refused: BTreeSet<char>,
    is_symbol: fn(char) -> bool,
}

impl Symbols {
    pub fn new(is_symbol: fn(char) -> bool) -> Symbols {
        Symbols { words: BTreeMap::new(), refused: BTreeSet::new(), is_symbol }
    }

    /// The symbol of a word.
    pub fn word(&mut self, word: &str) -> char {
        let next = FIRST_WORD + (self.words.len() as u32).min(MAX_WORDS);
        *self.words.entry(word.to_owned()).or_insert(char::from_u32(next).unwrap_or(char::REPLACEMENT_CHARACTER))
    }

    /// A word for a symbol of one character.
    pub fn alias(&mut self, word: &str, symbol: char) {
        self.words.insert(word.to_owned(), symbol);
    }

    /// A word that is known and not read.
    pub fn refuse(&mut self, word: &str) {
        let symbol = self.word(word);
        self.refused.insert(symbol);
    }

    /// The word or character that a symbol is written as.
    fn written(&self, symbol: char) -> String {
        let word = self.words.iter().find(|(_, c)| **c == symbol).map(|(word, _)| word.clone());
        word.unwrap_or_else(|| symbol.to_string())
    }

    /// Take the next symbol, after spaces; the longest word that fits. None where something else comes.
    pub fn take(&self, cursor: &mut Cursor) -> Option<(char, Char)> {
        cursor.skip_space();
        let place = cursor.place();
        let fits = |word: &&String| {
            cursor.rest().len() >= word.chars().count() && word.chars().zip(cursor.rest()).all(|(w, c)| w == c.c)
        };
        if let Some(word) = self.words.keys().filter(fits).max_by_key(|w| w.len()) {
            word.chars().for_each(|_| {
                cursor.next();
            });
            return Some((self.words[word], place));
        }
        let c = cursor.peek().filter(|c| (self.is_symbol)(*c) && !(FIRST_WORD..).contains(&u32::from(*c)))?;
        cursor.next();
        Some((c, place))
    }
}

/// Symbols with parameters, until something that is none. Brackets have to match.
pub fn modules(cursor: &mut Cursor, symbols: &Symbols, names: &Names) -> Parsed<Vec<Module>> {
    let mut out = Vec::new();
    let mut open: Vec<Char> = Vec::new();
    while let Some((symbol, place)) = symbols.take(cursor) {
        match symbol {
            '[' => open.push(place),
            ']' if open.pop().is_none() => return Err(place.fault("']' closes nothing")),
            _ if symbols.refused.contains(&symbol) => {
                return Err(place.fault(format!("the module {} is not read", symbols.written(symbol))));
            }
            _ => {}
        }
        let mut arguments = Vec::new();
        if cursor.take('(') && !cursor.take(')') {
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
        out.push(Module { symbol, arguments });
    }
    match open.pop() {
        Some(bracket) => Err(bracket.fault("'[' is never closed")),
        None => Ok(out),
    }
}

/// Symbols with the names of their parameters, to the end; names are added to `parameters`.
pub fn patterns(cursor: &mut Cursor, symbols: &Symbols, parameters: &mut Vec<String>) -> Parsed<Vec<Pattern>> {
    let mut out = Vec::new();
    let mut open: Vec<Char> = Vec::new();
    while !cursor.at_end() {
        let place = cursor.place();
        let Some((symbol, place)) = symbols.take(cursor) else {
            return Err(place.fault(format!("{} is not a symbol", shown(place.c))));
        };
        match symbol {
            '[' => open.push(place),
            ']' if open.pop().is_none() => return Err(place.fault("']' closes nothing")),
            _ => {}
        }
        if open.len() > MAX_NESTED {
            return Err(place.fault(format!("more than {MAX_NESTED} brackets within each other")));
        }
        let mut count = 0;
        if cursor.take('(') && !cursor.take(')') {
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
        out.push(Pattern { symbol, count });
    }
    match open.pop() {
        Some(bracket) => Err(bracket.fault("'[' is never closed")),
        None => Ok(out),
    }
}

/// `left < predecessor > right`; a context may be `*`. `before` is where it stands if it holds nothing.
pub fn predecessor(
    chars: &[Char],
    before: Char,
    symbols: &Symbols,
    parameters: &mut Vec<String>,
) -> Parsed<Predecessor> {
    let last = chars.iter().rposition(|c| c.c == '>');
    predecessor::parse(chars, before, last, |cursor| patterns(cursor, symbols, parameters))
}
