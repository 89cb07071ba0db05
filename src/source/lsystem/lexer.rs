//! The text of a grammar as characters that know where they stand, and a cursor that walks over them.

use std::collections::BTreeSet;

/// Signs that are symbols besides letters and digits.
const SIGNS: &str = "+-&^\\/|[]{}.!'$%~_";
/// A character and its place; both count from 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Char {
    pub c: char,
    pub line: u32,
    pub column: u32,
}

/// Syntax error: its place and cause.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    pub line: u32,
    pub column: u32,
    pub what: String,
    /// Whether options are wrong, or missing, and not the file.
    pub of_options: bool,
}

/// Shorthand for results of parsing.
pub type Parsed<T> = Result<T, Fault>;

impl Char {
    pub fn fault(&self, what: impl Into<String>) -> Fault {
        Fault { line: self.line, column: self.column, what: what.into(), of_options: false }
    }

    /// An option is needed, or another.
    pub fn of_options(&self, what: impl Into<String>) -> Fault {
        Fault { of_options: true, ..self.fault(what) }
    }
}

/// A character as messages show it.
pub fn shown(c: char) -> String {
    if c.is_control() || (c.is_whitespace() && c != ' ') || c == char::REPLACEMENT_CHARACTER {
        format!("the character U+{:04X}", u32::from(c))
    } else {
        format!("'{c}'")
    }
}

/// What a notation's comments look like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Comments {
    /// `/* … */`, and `#` before a space to the end of the line.
    BlockOrHash,
    /// `/* … */`.
    Block,
    /// This character to the end of the line.
    ToEnd(char),
}

/// All characters of a grammar in our notation without comments; line ends are kept.
pub fn characters(text: &str) -> Parsed<Vec<Char>> {
    characters_but(text, Comments::BlockOrHash)
}

/// All characters without comments; line ends are kept. Typographic signs become those of a keyboard.
pub fn characters_but(text: &str, comments: Comments) -> Parsed<Vec<Char>> {
    let (block, hash) = (!matches!(comments, Comments::ToEnd(_)), comments == Comments::BlockOrHash);
    let mut out: Vec<Char> = Vec::with_capacity(text.len());
    let (mut line, mut column) = (1, 0);
    let mut comment: Option<Char> = None;
    let mut to_end = false;
    let mut chars = text.strip_prefix('\u{feff}').unwrap_or(text).chars().peekable();
    while let Some(c) = chars.next() {
        column += 1;
        let at = Char { c: plain(c), line, column };
        if c == '\n' {
            (line, column, to_end) = (line + 1, 0, false);
            // A comment over several lines does not end a statement.
            if comment.is_none() {
                out.push(at);
            }
        } else if comment.is_some() {
            if c == '*' && chars.peek() == Some(&'/') {
                chars.next();
                column += 1;
                comment = None;
            }
        } else if to_end {
        } else if block && c == '/' && chars.peek() == Some(&'*') {
            comment = Some(at);
        } else if comments == Comments::ToEnd(c)
            || (hash && c == '#' && chars.peek().is_none_or(|n| n.is_whitespace() || *n == '#'))
        {
            to_end = true;
        } else if c != '\r' {
            out.push(at);
        }
    }
    match comment {
        Some(open) => Err(open.fault("a comment that is opened here is never closed by */")),
        None => Ok(out),
    }
}

/// Signs as they are printed in books → as they are typed.
fn plain(c: char) -> char {
    match c {
        '\u{2019}' | '\u{2032}' => '\'',
        '\u{2227}' | '\u{02c6}' => '^',
        '\u{2212}' | '\u{2013}' => '-',
        '\u{2217}' => '*',
        _ => c,
    }
}

/// A place in a run of characters.
#[derive(Debug, Clone)]
pub struct Cursor<'a> {
    chars: &'a [Char],
    at: usize,
    /// Place after the last character, for messages.
    end: Char,
}

impl<'a> Cursor<'a> {
    /// `before`: where the run ends if it holds nothing.
    pub fn new(chars: &'a [Char], before: Char) -> Cursor<'a> {
        let end = chars.last().copied().unwrap_or(before);
        Cursor { chars, at: 0, end: Char { column: end.column + 1, c: ' ', ..end } }
    }

    pub fn peek(&self) -> Option<char> {
        self.chars.get(self.at).map(|c| c.c)
    }

    /// The character after the next.
    pub fn second(&self) -> Option<char> {
        self.chars.get(self.at + 1).map(|c| c.c)
    }

    /// The next character's place, or the end's.
    pub fn place(&self) -> Char {
        self.chars.get(self.at).copied().unwrap_or(self.end)
    }

    pub fn next(&mut self) -> Option<Char> {
        let c = self.chars.get(self.at).copied();
        self.at += usize::from(c.is_some());
        c
    }

    pub fn skip_space(&mut self) {
        while self.peek().is_some_and(char::is_whitespace) {
            self.at += 1;
        }
    }

    /// Take `c` where it comes next, after spaces.
    pub fn take(&mut self, c: char) -> bool {
        self.skip_space();
        let there = self.peek() == Some(c);
        self.at += usize::from(there);
        there
    }

    /// Test whether `text` comes next; a text that ends in a letter has to end a word.
    pub fn begins(&self, text: &str) -> bool {
        let rest = self.rest();
        let n = text.chars().count();
        let is_word = |c: char| c.is_alphanumeric() || c == '_';
        let ends = !text.ends_with(is_word) || rest.get(n).is_none_or(|c| !is_word(c.c));
        rest.len() >= n && text.chars().zip(rest).all(|(t, c)| t == c.c) && ends
    }

    /// Take `text` where it comes next, after spaces.
    pub fn take_text(&mut self, text: &str) -> bool {
        self.skip_space();
        let there = self.begins(text);
        self.at += if there { text.chars().count() } else { 0 };
        there
    }

    /// Skip spaces, and test whether nothing is left.
    pub fn at_end(&mut self) -> bool {
        self.skip_space();
        self.at == self.chars.len()
    }

    /// The next characters for which `is` holds.
    pub fn word(&mut self, is: impl Fn(char) -> bool) -> String {
        let rest = self.rest();
        let n = rest.iter().position(|c| !is(c.c)).unwrap_or(rest.len());
        self.at += n;
        rest[..n].iter().map(|c| c.c).collect()
    }

    /// Remaining characters.
    pub fn rest(&self) -> &'a [Char] {
        self.chars.get(self.at..).unwrap_or_default()
    }

    /// Syntax error at the next character: `wanted` says what should stand there.
    pub fn unexpected(&self, wanted: &str) -> Fault {
        let found = self.peek().map_or("the end".to_owned(), shown);
        self.place().fault(format!("{found} where {wanted} should be"))
    }
}

/// Test whether a character may be a symbol of an L-system.
pub fn is_symbol(c: char) -> bool {
    c.is_alphanumeric() || SIGNS.contains(c)
}

/// Symbols alone, to the end.
pub fn symbols(cursor: &mut Cursor) -> Parsed<BTreeSet<char>> {
    let mut out = BTreeSet::new();
    while !cursor.at_end() {
        let place = cursor.place();
        match cursor.next() {
            Some(c) if is_symbol(c.c) => out.insert(c.c),
            _ => return Err(place.fault(format!("{} is not a symbol", shown(place.c)))),
        };
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_and_places() {
        let text = "a # no\r\n/* x\n y */b//c # d\n##e\n\u{2212}";
        let out = characters(text).unwrap();
        let read: String = out.iter().map(|c| c.c).collect();
        assert_eq!(read, "a \nb//c \n\n-");
        let b = out.iter().find(|c| c.c == 'b').unwrap();
        assert_eq!((b.line, b.column), (3, 6));
        let open = characters("ab\n /* x").unwrap_err();
        assert_eq!((open.line, open.column), (2, 2));
    }
}
