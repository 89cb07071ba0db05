//! The lines of a grammar file that begin with `#`.

use super::alphabet::Action;
use super::expr::Environment;
use super::expr_parser::{self, Names, Syntax};
use super::grammar::{Considered, Grammar, MaterialTarget, Surface};
use super::lexer::{Char, Cursor, Parsed, symbols};
use crate::error::short;
use crate::geom::DVec3;
use crate::scene::texture::srgb_to_linear;

/// All directives, for messages.
const KNOWN: &str = "#axiom, #define, #iterations, #seed, #angle, #step, #width, #tropism, #unit, #colour, #surface, #material, #draw, \
                     #ignore, #consider, #homomorphism";
/// Corners of a surface that a grammar draws.
const MAX_CORNERS: usize = 1 << 16;

/// Read the directive `word`, that begins at `hash`; the cursor is after the word.
pub fn read(word: &str, hash: Char, cursor: &mut Cursor, grammar: &mut Grammar) -> Parsed<()> {
    cursor.skip_space();
    match word {
        "define" => define(cursor, grammar)?,
        "iterations" => grammar.iterations = Some(whole(cursor, grammar)?),
        "seed" => grammar.seed = whole(cursor, grammar)?,
        "angle" => grammar.angle = value(cursor, grammar)?,
        "step" => grammar.step = value(cursor, grammar)?,
        "width" => width(cursor, grammar)?,
        "tropism" => tropism(cursor, grammar)?,
        "unit" => unit(cursor, grammar)?,
        "colour" | "color" => indexed_colour(cursor, grammar)?,
        "surface" => surface(cursor, grammar)?,
        "material" => material(cursor, grammar)?,
        "draw" => grammar.actions.extend(symbols(cursor)?.into_iter().map(|s| (s, Action::DRAW))),
        "ignore" => match (&mut grammar.considered, symbols(cursor)?) {
            (Considered::AllBut(set), more) => set.extend(more),
            _ => return Err(hash.fault("#ignore and #consider exclude each other")),
        },
        "consider" => match (&mut grammar.considered, symbols(cursor)?) {
            (Considered::Only(set), more) => set.extend(more),
            (Considered::AllBut(set), only) if set.is_empty() => grammar.considered = Considered::Only(only),
            _ => return Err(hash.fault("#ignore and #consider exclude each other")),
        },
        _ => return Err(hash.fault(format!("#{word} is not known; there are {KNOWN}"))),
    }
    Ok(())
}

/// A constant; a value that the caller gives it goes before the file's.
fn define(cursor: &mut Cursor, grammar: &mut Grammar) -> Parsed<()> {
    let place = cursor.place();
    let name = cursor.word(|c| expr_parser::begins_name(c) || c.is_numeric());
    if !name.starts_with(expr_parser::begins_name) {
        return Err(place.fault("a #define begins with a name"));
    }
    cursor.take('=');
    let own = value(cursor, grammar)?;
    let value = grammar.given.get(&name).copied().unwrap_or(own);
    grammar.constants.insert(name, value);
    Ok(())
}

fn width(cursor: &mut Cursor, grammar: &mut Grammar) -> Parsed<()> {
    let place = cursor.place();
    match values(cursor, grammar)?[..] {
        [w] if w >= 0.0 => grammar.width = Some(w),
        [w, t] if w >= 0.0 && t >= 0.0 => (grammar.width, grammar.taper) = (Some(w), t),
        _ => {
            return Err(place.fault("#width is a width and, after a comma, what ! multiplies it by; not negative"));
        }
    }
    Ok(())
}

fn tropism(cursor: &mut Cursor, grammar: &mut Grammar) -> Parsed<()> {
    let place = cursor.place();
    let [x, y, z, e] = values(cursor, grammar)?[..] else {
        return Err(place.fault("#tropism is a vector and an elasticity: x, y, z, e"));
    };
    grammar.tropism = e * DVec3::new(x, y, z);
    Ok(())
}

fn unit(cursor: &mut Cursor, grammar: &mut Grammar) -> Parsed<()> {
    let place = cursor.place();
    grammar.metres_per_unit = value(cursor, grammar)?;
    if grammar.metres_per_unit <= 0.0 {
        return Err(place.fault("#unit is how many metres a unit is, above 0"));
    }
    Ok(())
}

fn indexed_colour(cursor: &mut Cursor, grammar: &mut Grammar) -> Parsed<()> {
    let place = cursor.place();
    let index = value(cursor, grammar)?;
    if index != index.floor() || index.abs() > 1e9 {
        return Err(place.fault("the index of a #colour is a whole number"));
    }
    cursor.take(',');
    grammar.colours.insert(index as i64, colour(cursor, grammar)?);
    Ok(())
}

/// A finite number from constants.
fn value(cursor: &mut Cursor, grammar: &Grammar) -> Parsed<f64> {
    cursor.skip_space();
    let place = cursor.place();
    let names = Names::new(Syntax::Book, &grammar.constants, &[]);
    let expr = expr_parser::parse(cursor, &names)?;
    if expr.random() {
        return Err(place.fault("what is drawn by lot stands in productions, not here"));
    }
    let value = expr.value(&[], &mut Environment::new(0, &[]));
    if value.is_finite() { Ok(value) } else { Err(place.fault("this is not a finite number")) }
}

fn whole(cursor: &mut Cursor, grammar: &Grammar) -> Parsed<u64> {
    cursor.skip_space();
    let place = cursor.place();
    let value = value(cursor, grammar)?;
    if value == value.floor() && (0.0..=1e15).contains(&value) {
        return Ok(value as u64);
    }
    Err(place.fault(format!("{} is not a whole number from 0 to 1e15", short(value))))
}

/// Numbers with commas between.
fn values(cursor: &mut Cursor, grammar: &Grammar) -> Parsed<Vec<f64>> {
    let mut out = vec![value(cursor, grammar)?];
    while cursor.take(',') {
        out.push(value(cursor, grammar)?);
    }
    Ok(out)
}

/// `#8040ff`, or three numbers in [0, 1]; both sRGB. Gives linear.
fn colour(cursor: &mut Cursor, grammar: &Grammar) -> Parsed<[f32; 3]> {
    cursor.skip_space();
    let place = cursor.place();
    if cursor.take('#') {
        let digits = cursor.word(|c| c.is_ascii_hexdigit());
        return match u32::from_str_radix(&digits, 16) {
            Ok(v) if digits.len() == 6 => Ok([v >> 16, v >> 8, v].map(|c| srgb_to_linear(c as u8))),
            _ => Err(place.fault("a colour has six digits: #rrggbb")),
        };
    }
    match values(cursor, grammar)?[..] {
        [r, g, b] => Ok(linear([r, g, b])),
        _ => Err(place.fault("a colour is #rrggbb or three numbers from 0 to 1: r, g, b")),
    }
}

/// sRGB in [0, 1] → linear.
pub fn linear(srgb: [f64; 3]) -> [f32; 3] {
    srgb.map(|c| {
        let c = c.clamp(0.0, 1.0);
        (if c <= 0.04045 { c / 12.92 } else { libm::pow((c + 0.055) / 1.055, 2.4) }) as f32
    })
}

/// `L "leaf.glb"`, or `L { x y, x y z, … } colour`.
fn surface(cursor: &mut Cursor, grammar: &mut Grammar) -> Parsed<()> {
    let name = match cursor.next() {
        Some(c) if c.c.is_alphanumeric() => c.c,
        _ => return Err(cursor.unexpected("the symbol of the surface, a letter,")),
    };
    cursor.skip_space();
    let place = cursor.place();
    let surface = if cursor.take('"') {
        let file = cursor.word(|c| c != '"' && c != '\n');
        if file.is_empty() || !cursor.take('"') {
            return Err(cursor.unexpected("'\"' after the name of a file"));
        }
        Surface::Mesh { file, line: place.line, column: place.column }
    } else if cursor.take('{') {
        let mut corners = Vec::new();
        loop {
            corners.push(corner(cursor)?);
            if cursor.take('}') {
                break;
            }
            if !cursor.take(',') {
                return Err(cursor.unexpected("',' or '}'"));
            }
        }
        if !(3..=MAX_CORNERS).contains(&corners.len()) {
            return Err(place.fault(format!("a surface has 3 to {MAX_CORNERS} corners, not {}", corners.len())));
        }
        let colour = if cursor.at_end() { None } else { Some(colour(cursor, grammar)?) };
        Surface::Polygon { corners, colour }
    } else {
        return Err(cursor.unexpected("a file's name in quotes, or the corners between { and },"));
    };
    grammar.surfaces.insert(name, surface);
    Ok(())
}

/// `leaf 1 ~L K`: a name, and what is called so: indices of colours, surfaces and symbols that draw.
fn material(cursor: &mut Cursor, grammar: &mut Grammar) -> Parsed<()> {
    let place = cursor.place();
    let name = cursor.word(|c| !c.is_whitespace());
    cursor.skip_space();
    if name.is_empty() || cursor.at_end() {
        return Err(
            place.fault("a #material is a name and what is of it: indices of colours, ~ with a surface, symbols")
        );
    }
    while !cursor.at_end() {
        let place = cursor.place();
        let giver = if cursor.take('~') {
            MaterialTarget::Surface(
                cursor
                    .next()
                    .map(|c| c.c)
                    .filter(|c| c.is_alphanumeric())
                    .ok_or_else(|| place.fault("after ~ stands the symbol of a surface, a letter"))?,
            )
        } else if cursor.peek().is_some_and(|c| c.is_ascii_digit() || c == '-') {
            let sign = if cursor.take('-') { "-" } else { "" };
            let digits = cursor.word(|c| c.is_ascii_digit());
            let index = format!("{sign}{digits}").parse().ok().filter(|i: &i64| i.abs() <= 1_000_000_000);
            MaterialTarget::Colour(index.ok_or_else(|| place.fault("the index of a colour is a whole number"))?)
        } else {
            match cursor.next() {
                Some(c) if c.c.is_alphabetic() => MaterialTarget::Symbol(c.c),
                _ => {
                    return Err(
                        place.fault("a material is given to an index of a colour, to ~ with a surface, or to a symbol")
                    );
                }
            }
        };
        grammar.materials.assign(&name, giver);
        cursor.take(',');
        cursor.skip_space();
    }
    Ok(())
}

/// Two or three numbers with spaces between.
fn corner(cursor: &mut Cursor) -> Parsed<DVec3> {
    let mut out = DVec3::ZERO;
    for axis in 0..3 {
        cursor.skip_space();
        if axis == 2 && matches!(cursor.peek(), Some(',' | '}')) {
            break;
        }
        let sign = if cursor.take('-') { -1.0 } else { 1.0 };
        if !cursor.peek().is_some_and(|c| c.is_ascii_digit() || c == '.') {
            return Err(cursor.unexpected("a number"));
        }
        out[axis] = sign * expr_parser::number(cursor)?;
    }
    Ok(out)
}
