//! The `.ls` notation of the RubberPlant examples: `lsystem name { axiom: F; r: F -> F[+F]F; a: F -> draw; angle: 25; }`.

use std::collections::BTreeMap;

use crate::source::lsystem::alphabet::{self, Action};
use crate::source::lsystem::expr::Environment;
use crate::source::lsystem::expr_parser::{self, Names, Syntax};
use crate::source::lsystem::grammar::{Considered, Grammar};
use crate::source::lsystem::lexer::{Char, Cursor, Parsed, characters, symbols};
use crate::source::lsystem::parser::{Reader, START_OF_FILE, arrow};

/// Parse a file. It does not say how often its productions are applied.
pub fn grammar(text: &str) -> Parsed<Grammar> {
    let chars = without_comments(&characters(text)?);
    let open = chars.iter().position(|c| c.c == '{');
    let close = chars.iter().rposition(|c| c.c == '}');
    let (Some(open), Some(close)) = (open, close) else {
        return Err(START_OF_FILE.fault("there is no lsystem { … }"));
    };
    let mut reader = Reader::new(Grammar { actions: alphabet::book_without_lines(), ..Grammar::default() });
    for statement in chars.get(open + 1..close).unwrap_or_default().split(|c| c.c == ';') {
        let mut cursor = Cursor::new(statement, chars[open]);
        if cursor.at_end() {
            continue;
        }
        let place = cursor.place();
        let key = cursor.word(char::is_alphanumeric);
        if !cursor.take(':') {
            return Err(cursor.unexpected("':'"));
        }
        cursor.skip_space();
        match key.as_str() {
            "axiom" => reader.axiom(&mut cursor)?,
            "angle" => {
                let constants = BTreeMap::new();
                let names = Names::new(Syntax::Book, &constants, &[]);
                let angle = expr_parser::parse(&mut cursor, &names)?;
                reader.grammar.angle = angle.value(&[], &mut Environment::new(0, &[]));
            }
            "ignore" => reader.grammar.considered = Considered::AllBut(symbols(&mut cursor)?),
            "a" => action(cursor.rest(), place, &mut reader.grammar)?,
            "r" => production(cursor.rest(), place, &mut reader)?,
            _ => return Err(place.fault(format!("{key} is none of axiom, angle, ignore, a and r"))),
        }
    }
    reader.finish()
}

/// Without what stands after `//`.
fn without_comments(chars: &[Char]) -> Vec<Char> {
    let mut out = Vec::with_capacity(chars.len());
    for line in chars.split_inclusive(|c| c.c == '\n') {
        let end = line.windows(2).position(|w| w[0].c == '/' && w[1].c == '/').unwrap_or(line.len());
        out.extend(&line[..end]);
    }
    out
}

/// `F, G -> draw`.
fn action(chars: &[Char], place: Char, grammar: &mut Grammar) -> Parsed<()> {
    let (at, length) = arrow(chars).ok_or_else(|| place.fault("an action is written a: F -> draw"))?;
    let mut cursor = Cursor::new(&chars[at + length..], chars[at]);
    cursor.skip_space();
    let place = cursor.place();
    let action = match cursor.word(char::is_alphanumeric).as_str() {
        "draw" => Some(Action::DRAW),
        "move" => Some(Action::MOVE),
        "nop" => None,
        other => return Err(place.fault(format!("{other} is none of draw, move and nop"))),
    };
    for list in chars[..at].split(|c| c.c == ',') {
        for symbol in symbols(&mut Cursor::new(list, place))? {
            action.map(|a| grammar.actions.insert(symbol, a));
        }
    }
    Ok(())
}

/// `F 0.5 -> FF, 0.5 -> F`, or without probabilities.
fn production(chars: &[Char], place: Char, reader: &mut Reader) -> Parsed<()> {
    let mut predecessor: Option<&[Char]> = None;
    for part in chars.split(|c| c.c == ',') {
        let (at, length) = arrow(part).ok_or_else(|| place.fault("a production is written r: F -> FF"))?;
        let (head, successor) = (trimmed(&part[..at]), &part[at + length..]);
        let word = head.iter().rposition(|c| c.c.is_whitespace()).map_or(0, |i| i + 1);
        let is_number = word < head.len() && head[word..].iter().all(|c| c.c.is_ascii_digit() || c.c == '.');
        let weight = if is_number && (word > 0 || predecessor.is_some()) { &head[word..] } else { &[] };
        let before = predecessor.unwrap_or(&head[..head.len() - weight.len()]);
        predecessor = Some(before);
        // The same characters in the order of a grammar of ours: they keep their places.
        let mut whole = before.to_vec();
        whole.extend(&part[at..at + length]);
        whole.extend(successor);
        if let Some(first) = weight.first() {
            whole.push(Char { c: ':', ..*first });
            whole.extend(weight);
        }
        reader.production(&whole)?;
    }
    Ok(())
}

fn trimmed(chars: &[Char]) -> &[Char] {
    let from = chars.iter().position(|c| !c.c.is_whitespace()).unwrap_or(chars.len());
    let to = chars.iter().rposition(|c| !c.c.is_whitespace()).map_or(from, |i| i + 1);
    &chars[from..to]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn examples_are_read() {
        let text =
            "// x\nlsystem s { a: F -> draw; a: f -> move ; a: X, Y -> nop;\n ignore: +-F;\n axiom : -F; angle: 22.5;
            r: F 0.25 -> FF ,\n 0.75 -> F[+F] ; // y\n r: O < X > Y -> Z; r: + -> - ; }";
        let g = grammar(text).unwrap();
        assert_eq!((g.angle, g.iterations, g.axiom.len()), (22.5, None, 2));
        assert_eq!(
            [g.actions.get(&'F'), g.actions.get(&'f'), g.actions.get(&'X')],
            [Some(&Action::DRAW), Some(&Action::MOVE), None]
        );
        assert_eq!((g.rules.of('F').len(), g.rules.of('+').len()), (2, 1));
        assert!(g.rules.of('F').iter().all(|p| p.weight.is_some()) && g.rules.in_context());
    }

    #[test]
    fn faults_have_places() {
        for (text, line, column) in [
            ("axiom: F", 1, 1),
            ("lsystem x { axiom: F; z: F; }", 1, 23),
            ("lsystem x {\n axiom F; }", 2, 8),
            ("lsystem x { axiom: F;\n r: F -> F=F; }", 2, 11),
            ("lsystem x { axiom: F; a: F -> jump; }", 1, 31),
            ("} lsystem {", 1, 1),
            ("lsystem x { }", 1, 1),
        ] {
            let fault = grammar(text).unwrap_err();
            assert_eq!((fault.line, fault.column), (line, column), "{text} {fault:?}");
        }
    }
}
