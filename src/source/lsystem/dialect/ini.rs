//! Grammars as INI files: `[L-System] axiom=F angle=25 rule0=F>F[+F]F`. Every capital letter draws, in a plane whose y points
//! down.

use crate::geom::{DMat3, DVec3};
use crate::source::lsystem::alphabet::{Action, Alphabet};
use crate::source::lsystem::expr::sin_cos;
use crate::source::lsystem::grammar::{Grammar, Module, Pattern, Production};
use crate::source::lsystem::lexer::{Char, Cursor, Fault, Parsed, shown};

/// Keys that say how the window is laid out and what it is called.
const UNUSED: [&str; 6] = ["name", "numrules", "x", "y", "closed", "author"];

/// Read a file. What stands before its section `[L-System]` is passed over, and other sections are.
pub fn grammar(text: &str) -> Parsed<Grammar> {
    let mut grammar = Grammar { actions: alphabet(), ..Grammar::default() };
    let (mut axiom, mut within, mut rotation) = (None, false, 0.0);
    let mut end = Char { c: ' ', line: 1, column: 1 };
    for (i, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let place = |column: usize| Char { c: ' ', line: i as u32 + 1, column: column as u32 + 1 };
        let chars: Vec<Char> = line.chars().enumerate().map(|(k, c)| Char { c, ..place(k) }).collect();
        end = place(chars.len());
        let content = line.trim();
        if content.is_empty() || content.starts_with(['#', ';']) {
            continue;
        }
        if content.starts_with('[') && content.ends_with(']') && !content.contains('=') {
            within = content.eq_ignore_ascii_case("[l-system]");
            continue;
        }
        if !within {
            continue;
        }
        let mut cursor = Cursor::new(&chars, end);
        cursor.skip_space();
        let at = cursor.place();
        let key = cursor.word(|c| c != '=' && !c.is_whitespace()).to_lowercase();
        if !cursor.take('=') {
            return Err(cursor.unexpected("'='"));
        }
        cursor.skip_space();
        match key.as_str() {
            "axiom" => axiom = Some(string(&mut cursor)?),
            "angle" => grammar.angle = number(&mut cursor)?,
            "rotation" => rotation = number(&mut cursor)?,
            "linelength" => grammar.step = number(&mut cursor)?,
            "iterations" => {
                let (at, n) = (cursor.place(), number(&mut cursor)?);
                if n < 0.0 || n != n.floor() || n > 1e15 {
                    return Err(at.fault("iterations are a whole number"));
                }
                grammar.iterations = Some(n as u64);
            }
            _ if key.strip_prefix("rule").is_some_and(|n| n.chars().all(|c| c.is_ascii_digit())) => {
                rule(&mut cursor, &mut grammar)?;
            }
            _ if UNUSED.contains(&key.as_str()) => while cursor.next().is_some() {},
            _ => {
                let known = "axiom, angle, rule0, rule1, …, iterations, lineLength, rotation";
                return Err(at.fault(format!("the key {key} is not known; there are {known}")));
            }
        }
        if !cursor.at_end() {
            return Err(cursor.unexpected("the end of the line"));
        }
    }
    grammar.axiom = axiom.ok_or_else(|| end.fault("there is no axiom in a section [L-System]"))?;
    // Angles are from the right, with the clock.
    let (sin, cos) = sin_cos(rotation);
    grammar.frame = DMat3::from_cols(DVec3::new(cos, -sin, 0.0), DVec3::new(sin, cos, 0.0), DVec3::Z);
    Ok(grammar)
}

/// `F>FF`, or with another sign between.
fn rule(cursor: &mut Cursor, grammar: &mut Grammar) -> Parsed<()> {
    let (Some(letter), Some(sign)) = (cursor.next(), cursor.next()) else {
        return Err(cursor.unexpected("a rule such as F>F[+F]"));
    };
    if !matches!(sign.c, '>' | '=') || letter.c.is_whitespace() {
        return Err(sign.fault(format!("{} where '>' should be, after one letter", shown(sign.c))));
    }
    if matches!(letter.c, '[' | ']') {
        return Err(letter.fault("a bracket cannot be rewritten"));
    }
    let predecessor = Pattern { symbol: letter.c, count: 0 };
    // The last rule of a letter counts.
    if !grammar.rules.of(letter.c).is_empty() {
        return Err(letter.fault(format!("a second rule of {}", shown(letter.c))));
    }
    let successor = string(cursor)?;
    grammar.rules.append(Production { successor, ..Production::new(Vec::new(), predecessor, Vec::new()) });
    Ok(())
}

/// Symbols to the end of the line.
fn string(cursor: &mut Cursor) -> Parsed<Vec<Module>> {
    let mut out = Vec::new();
    let mut open = Vec::new();
    while !cursor.at_end() {
        let Some(c) = cursor.next() else { break };
        match c.c {
            '[' => open.push(c),
            ']' if open.pop().is_none() => return Err(c.fault("']' closes nothing")),
            _ => {}
        }
        out.push(Module { symbol: c.c, arguments: Vec::new() });
    }
    match open.pop() {
        Some(bracket) => Err(bracket.fault("'[' is never closed")),
        None => Ok(out),
    }
}

fn number(cursor: &mut Cursor) -> Result<f64, Fault> {
    let place = cursor.place();
    let text = cursor.word(|c| !c.is_whitespace());
    text.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| place.fault(format!("{text} is not a number")))
}

fn alphabet() -> Alphabet {
    let mut out: Alphabet = ('A'..='Z').map(|c| (c, Action::DRAW_ONLY)).collect();
    out.extend([
        // To the right: its angles go with the clock.
        ('+', Action::turn(-1.0)),
        ('-', Action::turn(1.0)),
        ('|', Action::turn_by(180.0)),
        ('[', Action::Push),
        (']', Action::Pop),
    ]);
    out
}
