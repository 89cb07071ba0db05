//! The predecessor of a production, with its contexts: the same in every notation but for what its symbols are.

use super::grammar::Pattern;
use super::lexer::{Char, Cursor, Parsed, shown};

/// Patterns of a predecessor with its contexts: left, itself, right.
pub type Predecessor = (Vec<Pattern>, Pattern, Vec<Pattern>);

/// `left < predecessor > right`; a context may be `*`. `before` is where it stands if it holds nothing, `more` the place of the
/// '>' if there is one, and `patterns` reads symbols with parameters to the end.
pub fn parse(
    chars: &[Char],
    before: Char,
    more: Option<usize>,
    mut patterns: impl FnMut(&mut Cursor) -> Parsed<Vec<Pattern>>,
) -> Parsed<Predecessor> {
    let less = chars.iter().position(|c| c.c == '<');
    let more = more.filter(|&m| less.is_none_or(|l| l < m));
    let (from, end) = (less.map_or(0, |l| l + 1), more.unwrap_or(chars.len()));
    let mut part = |chars: &[Char], context: bool| {
        let mut cursor = Cursor::new(chars, before);
        cursor.skip_space();
        let place = cursor.place();
        if context && cursor.take('*') {
            return if cursor.at_end() { Ok(Vec::new()) } else { Err(cursor.unexpected("the end of the context")) };
        }
        let list = patterns(&mut cursor)?;
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
