//! Fractint's `.l` files: `Name { Angle 8 Axiom F F=F+F--F+F }`, many in a file, drawn in a plane.
//!
//! Based on: T. Wegner, B. Tyler, *Fractal Creations*, Waite Group Press 1993, and Fractint's own documentation.

use std::collections::BTreeMap;

use crate::geom::{DMat3, DVec3};
use crate::scene::texture::srgb_to_linear;
use crate::source::lsystem::alphabet::{
    Action, Alphabet, ColourChange, ColourRange, Forward, Ratio, RatioChange, Turn, WidthParameter, common,
};
use crate::source::lsystem::expr::Expr;
use crate::source::lsystem::grammar::{Grammar, Module, Pattern, Production};
use crate::source::lsystem::lexer::{Char, Comments, Cursor, Parsed, characters_but, shown};
use crate::source::lsystem::parser::START_OF_FILE;

/// Letters that a number follows.
const NUMBERED: &str = "\\/@c<>";
/// Largest number of parts of a turn. Fractint has 50; others that read its files have more.
const MAX_PARTS: f64 = 36_000.0;
/// The sixteen colours of the EGA, which begin Fractint's own palette. It draws in the last.
const COLOURS: [u32; 16] = [
    0x000000, 0x0000aa, 0x00aa00, 0x00aaaa, 0xaa0000, 0xaa00aa, 0xaa5500, 0xaaaaaa, 0x555555, 0x5555ff, 0x55ff55,
    0x55ffff, 0xff5555, 0xff55ff, 0xffff55, 0xffffff,
];
/// Names of systems that a message lists.
const MAX_NAMED: usize = 12;

/// A system of a file: its name, and its characters between the braces.
type Entry<'a> = (String, Char, &'a [Char]);

/// Read the system `name`, or the only one.
pub fn grammar(text: &str, name: Option<&str>) -> Parsed<Grammar> {
    let chars = characters_but(text, Comments::ToEnd(';'))?;
    let entries = entries(&chars)?;
    let names = |most: usize| {
        let list: Vec<&str> = entries.iter().take(most).map(|e| e.0.as_str()).collect();
        let more = entries.len().saturating_sub(list.len());
        list.join(", ") + &if more > 0 { format!(" and {more} more") } else { String::new() }
    };
    let (_, at, body) = match (name, &entries[..]) {
        (_, []) => return Err(START_OF_FILE.fault("there is no system; one is written Name { Angle 8 Axiom F F=FF }")),
        (None, [entry]) => entry,
        (None, _) => {
            let what = format!("there are {} systems; give option `name`: {}", entries.len(), names(MAX_NAMED));
            return Err(START_OF_FILE.of_options(what));
        }
        (Some(name), _) => match entries.iter().find(|e| e.0.eq_ignore_ascii_case(name)) {
            Some(entry) => entry,
            None => {
                let what = format!("option `name`: there is no system {name}; there are: {}", names(MAX_NAMED));
                return Err(START_OF_FILE.of_options(what));
            }
        },
    };
    system(body, *at)
}

/// The systems of a file; what is named comment is none.
fn entries(chars: &[Char]) -> Parsed<Vec<Entry<'_>>> {
    let mut out = Vec::new();
    let mut rest = chars;
    while let Some(open) = rest.iter().position(|c| c.c == '{') {
        let name: String = rest[..open].iter().map(|c| c.c).collect();
        let place = rest[..open].iter().find(|c| !c.c.is_whitespace()).copied().unwrap_or(rest[open]);
        let body = &rest[open + 1..];
        let Some(close) = body.iter().position(|c| c.c == '}') else {
            return Err(rest[open].fault("'{' is never closed"));
        };
        // Only the last line before the brace names it.
        let name = name.lines().map(str::trim).rfind(|l| !l.is_empty()).unwrap_or_default().to_owned();
        if !name.eq_ignore_ascii_case("comment") {
            out.push((name, place, &body[..close]));
        }
        rest = &body[close + 1..];
    }
    match rest.iter().find(|c| !c.c.is_whitespace()) {
        Some(c) if !out.is_empty() => Err(c.fault(format!("{} where a name and '{{' should be", shown(c.c)))),
        _ => Ok(out),
    }
}

fn system(body: &[Char], at: Char) -> Parsed<Grammar> {
    let mut parts = None;
    let mut axiom = None;
    let mut rules: BTreeMap<char, Vec<Module>> = BTreeMap::new();
    for line in body.split(|c| c.c == '\n') {
        let mut cursor = Cursor::new(line, at);
        if cursor.at_end() {
            continue;
        }
        let place = cursor.place();
        let word = cursor.word(|c| !c.is_whitespace() && c != '=').to_lowercase();
        while cursor.take('=') {}
        cursor.skip_space();
        let mut letters = word.chars();
        match (word.as_str(), letters.next(), letters.next()) {
            ("axiom", ..) => axiom = Some(string(&mut cursor)?),
            ("angle", ..) => parts = Some(angle(&mut cursor)?),
            // Rules of the same letter are one after the other.
            (_, Some(letter), None) => rules.entry(letter).or_default().extend(string(&mut cursor)?),
            _ => return Err(place.fault(format!("{word} is neither axiom nor angle nor a rule of one letter"))),
        }
        if !cursor.at_end() {
            return Err(cursor.unexpected("the end of the line"));
        }
    }
    let parts = parts.ok_or_else(|| at.fault("there is no angle; Angle 8 turns by eighths of a turn"))?;
    let mut grammar = Grammar {
        axiom: axiom.ok_or_else(|| at.fault("there is no axiom"))?,
        angle: 360.0 / parts,
        actions: alphabet(parts),
        // Its turtle sets out to the right.
        frame: DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::Z),
        colours: (0..).zip(COLOURS.map(|c| [c >> 16, c >> 8, c].map(|c| srgb_to_linear(c as u8)))).collect(),
        first_colour: 15.0,
        ..Grammar::default()
    };
    for (symbol, successor) in rules {
        let predecessor = Pattern { symbol, count: usize::from(NUMBERED.contains(symbol)) };
        grammar.rules.append(Production { successor, ..Production::new(Vec::new(), predecessor, Vec::new()) });
    }
    Ok(grammar)
}

/// Parts of a turn.
fn angle(cursor: &mut Cursor) -> Parsed<f64> {
    let place = cursor.place();
    let digits = cursor.word(|c| c.is_ascii_digit());
    match digits.parse::<f64>() {
        Ok(n) if (3.0..=MAX_PARTS).contains(&n) => Ok(n),
        _ => Err(place.fault(format!("an angle is a whole number from 3 to {MAX_PARTS}: parts of a turn"))),
    }
}

/// Symbols to the next space. Capitals are no others than small letters.
fn string(cursor: &mut Cursor) -> Parsed<Vec<Module>> {
    let mut out = Vec::new();
    let mut open = Vec::new();
    while let Some(c) = cursor.peek().filter(|c| !c.is_whitespace()) {
        let place = cursor.place();
        cursor.next();
        let symbol = c.to_lowercase().next().unwrap_or(c);
        match symbol {
            '[' => open.push(place),
            ']' if open.pop().is_none() => return Err(place.fault("']' closes nothing")),
            _ => {}
        }
        let arguments = if NUMBERED.contains(symbol) { vec![Expr::Number(number(cursor, place)?)] } else { Vec::new() };
        out.push(Module { symbol, arguments });
    }
    match open.pop() {
        Some(bracket) => Err(bracket.fault("'[' is never closed")),
        None => Ok(out),
    }
}

/// The number after a letter: `2.5`, `Q2` for a square root, `I2` for one over it, both in any order. Without digits it is 0.
fn number(cursor: &mut Cursor, letter: Char) -> Parsed<f64> {
    let modifiers = cursor.word(|c| matches!(c, 'i' | 'I' | 'q' | 'Q')).to_lowercase();
    let place = cursor.place();
    let digits = cursor.word(|c| c.is_ascii_digit() || c == '.');
    if letter.c == '@' && digits.is_empty() {
        return Err(place.fault("@ has to be followed by the number that lengths are multiplied by"));
    }
    let mut value: f64 = if digits.is_empty() { Ok(0.0) } else { digits.parse() }
        .map_err(|_| place.fault(format!("{digits} is not a number")))?;
    if modifiers.contains('q') {
        value = value.sqrt();
    }
    if modifiers.contains('i') {
        value = 1.0 / value;
    }
    if modifiers.len() <= 2 && value.is_finite() {
        Ok(value)
    } else {
        Err(place.fault(format!("{modifiers}{digits} is not a number that can be used")))
    }
}

/// Fractint's letters. `\` and `/` turn a heading of their own, along which D and M go.
fn alphabet(parts: f64) -> Alphabet {
    let line = Forward { corner: false, width: WidthParameter::Nothing, ..Forward::DRAW };
    let second = Forward { second_heading: true, ..line };
    let turn = |sign| Action::Turn(Turn { from: 0, to: 1, sign, by: None, second_heading: true });
    let colour = |relative, range: fn(u16) -> ColourRange| {
        Action::Colour(ColourChange { default: 0.0, relative, range: range(COLOURS.len() as u16) })
    };
    let mut out = common();
    out.extend([
        ('f', Action::Forward(line)),
        ('g', Action::Forward(Forward { draws: false, ..line })),
        ('d', Action::Forward(second)),
        ('m', Action::Forward(Forward { draws: false, ..second })),
        ('\\', turn(1.0)),
        ('/', turn(-1.0)),
        // As many parts as make no more than half a turn, to the right.
        ('|', Action::turn_by(-360.0 * (0.5 * parts).floor() / parts)),
        ('!', Action::Mirror),
        ('@', Action::Length(Ratio { change: RatioChange::Multiply, default: 1.0 })),
        ('c', colour(0.0, ColourRange::Wrapped)),
        ('<', colour(1.0, ColourRange::WrappedAround0)),
        ('>', colour(-1.0, ColourRange::WrappedAround0)),
    ]);
    out
}
