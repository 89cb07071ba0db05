//! Symbols with parameters as the notations of other programs write them: some are words of several characters, which stand
//! in a grammar for symbols of their own.

use std::collections::{BTreeMap, BTreeSet};

use crate::source::lsystem::expr_parser::{self, Names};
use crate::source::lsystem::grammar::{Module, Pattern};
use crate::source::lsystem::lexer::{Char, Cursor, Parsed, shown};

/// First of the symbols that words stand for: the private use area that no text has a reason to use.
const FIRST_WORD: u32 = 0xF_0000;
/// Number of them.
const MOST_WORDS: u32 = 0xFFFD;
/// Brackets within brackets in a right context.
const MOST_NESTED: usize = 64;

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
        let next = FIRST_WORD + (self.words.len() as u32).min(MOST_WORDS);
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
        if open.len() > MOST_NESTED {
            return Err(place.fault(format!("more than {MOST_NESTED} brackets within each other")));
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

/// Patterns of a predecessor with its contexts: left, itself, right.
pub type Predecessor = (Vec<Pattern>, Pattern, Vec<Pattern>);

/// `left < predecessor > right`; a context may be `*`. `before` is where it stands if it holds nothing.
pub fn predecessor(
    chars: &[Char],
    before: Char,
    symbols: &Symbols,
    parameters: &mut Vec<String>,
) -> Parsed<Predecessor> {
    let less = chars.iter().position(|c| c.c == '<');
    let more = chars.iter().rposition(|c| c.c == '>').filter(|&m| less.is_none_or(|l| l < m));
    let (from, end) = (less.map_or(0, |l| l + 1), more.unwrap_or(chars.len()));
    let mut part = |chars: &[Char], context: bool| {
        let mut cursor = Cursor::new(chars, before);
        cursor.skip_space();
        let place = cursor.place();
        if context && cursor.take('*') {
            return if cursor.at_end() { Ok(Vec::new()) } else { Err(cursor.unexpected("the end of the context")) };
        }
        let list = patterns(&mut cursor, symbols, parameters)?;
        if list.is_empty() {
            return Err(place.fault(format!("{} where a symbol should be", shown(place.c))));
        }
        Ok(list)
    };
    let left = less.map_or(Ok(Vec::new()), |l| part(&chars[..l], true))?;
    let middle = part(&chars[from..end], false)?;
    let right = more.map_or(Ok(Vec::new()), |m| part(&chars[m + 1..], true))?;
    let at = |i: usize| chars.iter().skip(i).find(|c| !c.c.is_whitespace()).copied().unwrap_or(before);
    if let Some(p) = left.iter().position(|p| matches!(p.symbol, '[' | ']')) {
        return Err(at(p).fault("a left context is a path without branches"));
    }
    match middle[..] {
        [p] if !matches!(p.symbol, '[' | ']') => Ok((left, p, right)),
        [_] => Err(at(from).fault("a bracket cannot be rewritten")),
        _ => Err(at(from).fault("one symbol is rewritten at a time; its neighbours stand before '<' and after '>'")),
    }
}
