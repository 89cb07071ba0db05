//! The C preprocessor's part in a cpfg file: `#define` of numbers and texts, with parameters or without, and `#ifdef`. What a
//! macro becomes stands, for messages, where its name stood.

use std::collections::BTreeMap;

use crate::source::lsystem::expr_parser::{self, Names, Syntax};
use crate::source::lsystem::lexer::{Char, Cursor, Parsed};

/// Characters that a file may become.
const MAX_CHARACTERS: usize = 1 << 22;
/// Macros within macros.
const MAX_NESTED: usize = 64;
/// Directives that have nothing to say here.
const IDLE: [&str; 3] = ["line", "pragma", "ident"];

#[derive(Debug, Clone, Default)]
struct Macro {
    parameters: Option<Vec<String>>,
    body: Vec<Char>,
}

/// Macros by name, and those that are numbers.
#[derive(Debug, Default)]
pub struct Preprocessed {
    pub chars: Vec<Char>,
    pub constants: BTreeMap<String, f64>,
}

struct Preprocessor<'a> {
    macros: BTreeMap<String, Macro>,
    given: &'a BTreeMap<String, f64>,
    out: Preprocessed,
}

/// Expand a file whose comments are gone. `given`: values in place of the file's own of macros of these names.
pub fn expand(chars: &[Char], given: &BTreeMap<String, f64>) -> Parsed<Preprocessed> {
    let mut p = Preprocessor { macros: BTreeMap::new(), given, out: Preprocessed::default() };
    // For each condition that is open: its directive, whether it holds, and whether any of its branches has.
    let mut open: Vec<(Char, bool, bool)> = Vec::new();
    for line in joined(chars) {
        let skipped = open.iter().any(|(_, holds, _)| !holds);
        let Some((word, mut cursor, at)) = directive(&line) else {
            if !skipped {
                p.expand(&line, &mut Vec::new())?;
            }
            continue;
        };
        match word.as_str() {
            "ifdef" | "ifndef" => {
                let name = name(&mut cursor)?;
                let holds = p.macros.contains_key(&name) == (word == "ifdef");
                open.push((at, holds, holds));
            }
            "if" => {
                let holds = !skipped && p.condition(cursor.rest(), at)?;
                open.push((at, holds, holds));
            }
            "else" | "elif" => {
                let taken = open.last().is_none_or(|(.., taken)| *taken);
                let outer = open.iter().rev().skip(1).all(|(_, holds, _)| *holds);
                let holds = !taken && (word == "else" || (outer && p.condition(cursor.rest(), at)?));
                let Some(last) = open.last_mut() else { return Err(at.fault(format!("#{word} without an #if"))) };
                (last.1, last.2) = (holds, taken || holds);
            }
            "endif" if open.pop().is_none() => return Err(at.fault("#endif without an #if")),
            "endif" => {}
            _ if skipped || IDLE.contains(&word.as_str()) => {}
            "define" => p.define(&mut cursor)?,
            "undef" => {
                let name = name(&mut cursor)?;
                p.macros.remove(&name);
                p.out.constants.remove(&name);
            }
            _ => {
                let why = if word == "include" { "; put the lines of that file here" } else { "" };
                return Err(at.fault(format!("#{word} is not read{why}")));
            }
        }
    }
    match open.pop() {
        Some((at, ..)) => Err(at.fault("a condition that is begun here is never ended by #endif")),
        None => Ok(p.out),
    }
}

/// Lines with their ends; those that end in a backslash are joined to the next.
fn joined(chars: &[Char]) -> Vec<Vec<Char>> {
    let mut out: Vec<Vec<Char>> = Vec::new();
    let mut goes_on = false;
    for line in chars.split_inclusive(|c| c.c == '\n') {
        match out.last_mut().filter(|_| goes_on) {
            Some(last) => last.extend(line),
            None => out.push(line.to_vec()),
        }
        goes_on = false;
        if let [.., before, end] = line
            && before.c == '\\'
            && end.c == '\n'
            && let Some(last) = out.last_mut()
        {
            last.truncate(last.len() - 2);
            last.push(Char { c: ' ', ..*before });
            goes_on = true;
        }
    }
    out
}

/// The word of a line that is a directive, with the cursor after it and the place of its sign. The sign is a symbol of the
/// turtle as well, which no such word follows.
fn directive(line: &[Char]) -> Option<(String, Cursor<'_>, Char)> {
    const WORDS: [&str; 8] = ["define", "undef", "ifdef", "ifndef", "if", "else", "elif", "endif"];
    let mut cursor = Cursor::new(line, *line.first()?);
    cursor.skip_space();
    let at = cursor.place();
    if !cursor.take('#') {
        return None;
    }
    cursor.skip_space();
    // `# 12 "file"`, as a preprocessor leaves it.
    if cursor.peek().is_some_and(|c| c.is_ascii_digit()) && at.column == 1 {
        return Some(("line".into(), cursor, at));
    }
    let word = cursor.word(char::is_alphanumeric);
    (WORDS.contains(&word.as_str()) || IDLE.contains(&word.as_str()) || word == "include").then_some((word, cursor, at))
}

fn is_name(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

fn begins_name(c: char) -> bool {
    is_name(c) && !c.is_ascii_digit()
}

fn name(cursor: &mut Cursor) -> Parsed<String> {
    cursor.skip_space();
    if !cursor.peek().is_some_and(begins_name) {
        return Err(cursor.unexpected("a name"));
    }
    Ok(cursor.word(is_name))
}

impl Preprocessor<'_> {
    fn define(&mut self, cursor: &mut Cursor) -> Parsed<()> {
        let name = name(cursor)?;
        // Parameters follow at once; after a space a parenthesis belongs to the body.
        let parameters = if cursor.peek() == Some('(') { Some(parameters(cursor)?) } else { None };
        let rest = cursor.rest();
        let end = rest.iter().rposition(|c| !c.c.is_whitespace()).map_or(0, |i| i + 1);
        let mut body: Vec<Char> = rest[..end].iter().skip_while(|c| c.c.is_whitespace()).copied().collect();
        if let (Some(value), None) = (self.given.get(&name), &parameters) {
            let place = body.first().copied().unwrap_or(cursor.place());
            body = format!("({value})").chars().map(|c| Char { c, ..place }).collect();
        }
        self.macros.insert(name.clone(), Macro { parameters, body: body.clone() });
        if let Ok(Some(value)) = self.number(&body) {
            self.out.constants.insert(name, value);
        }
        Ok(())
    }

    /// The value of a text that is a constant.
    fn number(&mut self, text: &[Char]) -> Parsed<Option<f64>> {
        let kept = std::mem::take(&mut self.out.chars);
        let expanded = self.expand(text, &mut Vec::new());
        let chars = std::mem::replace(&mut self.out.chars, kept);
        expanded?;
        let Some(first) = chars.first() else { return Ok(None) };
        let mut cursor = Cursor::new(&chars, *first);
        let constants = BTreeMap::new();
        let value = expr_parser::parse(&mut cursor, &Names::new(Syntax::C, &constants, &[]))?;
        let whole = cursor.at_end();
        Ok(value.constant().filter(|v| whole && v.is_finite()))
    }

    fn condition(&mut self, text: &[Char], at: Char) -> Parsed<bool> {
        // defined(X) and defined X are numbers as well.
        let mut plain = Vec::with_capacity(text.len());
        let mut cursor = Cursor::new(text, at);
        while let Some(c) = cursor.peek() {
            if begins_name(c) {
                let place = cursor.place();
                let word = cursor.word(is_name);
                if word == "defined" {
                    let parenthesis = cursor.take('(');
                    let known = self.macros.contains_key(&name(&mut cursor)?);
                    if parenthesis && !cursor.take(')') {
                        return Err(cursor.unexpected("')'"));
                    }
                    plain.push(Char { c: if known { '1' } else { '0' }, ..place });
                } else {
                    plain.extend(word.chars().map(|c| Char { c, ..place }));
                }
            } else {
                plain.extend(cursor.next());
            }
        }
        match self.number(&plain)? {
            Some(value) => Ok(value != 0.0),
            None => Err(at.fault("the condition of #if is not a constant number")),
        }
    }

    /// Add a text to what comes out, its macros expanded. `within`: the macros that it comes from.
    fn expand(&mut self, text: &[Char], within: &mut Vec<String>) -> Parsed<()> {
        let Some(first) = text.first() else { return Ok(()) };
        let mut cursor = Cursor::new(text, *first);
        while let Some(c) = cursor.peek() {
            let place = cursor.place();
            if !is_name(c) {
                self.out.chars.extend(cursor.next());
            } else {
                let start = cursor.clone();
                let word = cursor.word(is_name);
                let used = self.macros.get(&word).filter(|_| begins_name(c) && !within.contains(&word)).cloned();
                let arguments = match used.as_ref().map(|m| m.parameters.as_ref()) {
                    Some(Some(parameters)) => call(&mut cursor, parameters.len())?,
                    _ => Some(Vec::new()),
                };
                match (used, arguments) {
                    (Some(used), Some(arguments)) => {
                        if within.len() >= MAX_NESTED {
                            return Err(place.fault(format!("more than {MAX_NESTED} macros within each other")));
                        }
                        let body = substituted(&used, &arguments, place);
                        within.push(word);
                        self.expand(&body, within)?;
                        within.pop();
                    }
                    _ => self.out.chars.extend(&start.rest()[..word.chars().count()]),
                }
            }
            if self.out.chars.len() > MAX_CHARACTERS {
                return Err(place.fault(format!("macros make more than {MAX_CHARACTERS} characters of the file")));
            }
        }
        Ok(())
    }
}

/// `(a, b)` after the name of a macro.
fn parameters(cursor: &mut Cursor) -> Parsed<Vec<String>> {
    let mut out = Vec::new();
    cursor.take('(');
    if cursor.take(')') {
        return Ok(out);
    }
    loop {
        out.push(name(cursor)?);
        if cursor.take(')') {
            return Ok(out);
        }
        if !cursor.take(',') {
            return Err(cursor.unexpected("',' or ')'"));
        }
    }
}

/// The arguments of a macro that is called; none where no parenthesis follows, and so it is not.
fn call(cursor: &mut Cursor, count: usize) -> Parsed<Option<Vec<Vec<Char>>>> {
    let mut ahead = cursor.clone();
    if !ahead.take('(') {
        return Ok(None);
    }
    let (mut out, mut depth) = (vec![Vec::new()], 0);
    while let Some(c) = ahead.next() {
        match c.c {
            ')' if depth == 0 => {
                *cursor = ahead;
                let none = count == 0 && out.len() == 1;
                return match out.len() == count || none {
                    true => Ok(Some(out)),
                    false => Err(c.fault(format!("the macro takes {count} argument(s), not {}", out.len()))),
                };
            }
            ',' if depth == 0 => {
                out.push(Vec::new());
                continue;
            }
            '(' => depth += 1,
            ')' => depth -= 1,
            _ => {}
        }
        if let Some(last) = out.last_mut() {
            last.push(c);
        }
    }
    Err(ahead.unexpected("')'"))
}

/// The body of a macro with its arguments, all of it at `place`.
fn substituted(used: &Macro, arguments: &[Vec<Char>], place: Char) -> Vec<Char> {
    let mut out = Vec::with_capacity(used.body.len());
    let parameters = used.parameters.as_deref().unwrap_or_default();
    let mut cursor = Cursor::new(&used.body, place);
    while let Some(c) = cursor.peek() {
        if !is_name(c) {
            out.extend(cursor.next());
            continue;
        }
        let word = cursor.word(is_name);
        match parameters.iter().position(|p| *p == word).and_then(|i| arguments.get(i)) {
            Some(argument) => out.extend(argument),
            None => out.extend(word.chars().map(|c| Char { c, ..place })),
        }
    }
    out.iter().map(|c| Char { c: c.c, ..place }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::lsystem::lexer::{Comments, characters_but};

    fn expanded(text: &str) -> Parsed<String> {
        let chars = characters_but(text, Comments::Block)?;
        Ok(expand(&chars, &BTreeMap::new())?.chars.iter().map(|c| c.c).collect())
    }

    #[test]
    fn macros_and_conditions() {
        for (text, want) in [
            ("#define N 5\n#define M (N*2)\nF(M)N NN\n", "F((5*2))5 NN\n"),
            ("#define f(x, y) x+y*x\nf(1,(2,3)) f g\n", "1+(2,3)*1 f g\n"),
            // A macro does not expand itself.
            ("#define a a b\n#define b a\na b\n", "a a a b\n"),
            ("#define X 1\n#ifdef X\nyes\n#else\nno\n#endif\n#ifndef X\nno\n#endif\n", "yes\n"),
            ("#define X 2\n#if X > 1 && !defined(Y)\na\n#elif 1\nb\n#else\nc\n#endif\n", "a\n"),
            ("#if 0\n#if 1\na\n#else\nb\n#endif\n#define Z 1\n#elif 1\nc\n#endif\nZ\n", "c\nZ\n"),
            ("#define L F\\\nF\nL\n#undef L\nL\n", "F F\nL\n"),
            // Signs that are symbols of the turtle.
            ("A --> #(2)F\n\t#F\n# 7 \"file\"\n", "A --> #(2)F\n\t#F\n"),
        ] {
            assert_eq!(expanded(text).unwrap(), want, "{text}");
        }
        let chars = characters_but("#define N 5\n#define T F(N)\n#define H N/2.\n", Comments::Block).unwrap();
        let given = BTreeMap::from([("N".to_owned(), 3.0)]);
        let constants = expand(&chars, &given).unwrap().constants;
        assert_eq!(constants, BTreeMap::from([("N".to_owned(), 3.0), ("H".to_owned(), 1.5)]));
    }

    #[test]
    fn faults_have_places() {
        for (text, line, column, what) in [
            ("a\n#include \"x.h\"\n", 2, 1, "#include is not read"),
            ("#if 1\n", 1, 1, "never ended"),
            ("#endif\n", 1, 1, "without"),
            ("#else\n", 1, 1, "without"),
            ("#define 5\n", 1, 9, "a name"),
            ("#define f(x) x\nf(1,2)\n", 2, 6, "takes 1"),
            ("#define f(x) x\nf(1", 2, 4, "')'"),
            ("#if a\n#endif\n", 1, 5, "a is no"),
        ] {
            let fault = expanded(text).unwrap_err();
            assert!((fault.line, fault.column) == (line, column) && fault.what.contains(what), "{text} {fault:?}");
        }
        // Each macro doubles the one before.
        let doubling: String = (1..40).map(|i| format!("#define m{i} m{} m{}\n", i - 1, i - 1)).collect();
        assert!(expanded(&format!("{doubling}m39\n")).unwrap_err().what.contains("characters"));
    }
}
