//! Text that comes from files and command lines, made safe to print: what it holds cannot look like this program's own
//! lines, nor steer the terminal.

use std::borrow::Cow;
use std::fmt::Write as _;

/// Whether a character stays out of what is printed: controls, which begin lines and steer terminals (C0, DEL and C1), and
/// those that turn the order of writing or break lines.
fn is_unsafe(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{2028}' | '\u{2029}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{feff}')
}

/// The text in one line, each unsafe character as Rust writes it: `\n`, `\u{1b}`.
pub fn one_line(text: &str) -> Cow<'_, str> {
    escaped(text, is_unsafe, |c, out| out.extend(c.escape_default()))
}

/// A table or another text of several lines: newlines and tabs stay.
pub fn lines(text: &str) -> Cow<'_, str> {
    escaped(text, |c| !matches!(c, '\n' | '\t') && is_unsafe(c), |c, out| out.extend(c.escape_default()))
}

/// JSON, which stays JSON: what its writer leaves as it is in strings becomes `\u001b`.
pub fn json(text: &str) -> Cow<'_, str> {
    escaped(
        text,
        |c| c != '\n' && is_unsafe(c),
        |c, out| {
            let _ = write!(out, "\\u{:04x}", u32::from(c));
        },
    )
}

fn escaped(text: &str, is_unsafe: impl Fn(char) -> bool, escape: impl Fn(char, &mut String)) -> Cow<'_, str> {
    if !text.contains(&is_unsafe) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_unsafe(c) { escape(c, &mut out) } else { out.push(c) }
    }
    Cow::Owned(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_steers_the_terminal_or_begins_a_line() {
        let forged = "leaf\nerror: \x1b[31mred\x07 \u{9b}1m \u{202e}back é\t";
        let shown = "leaf\\nerror: \\u{1b}[31mred\\u{7} \\u{9b}1m \\u{202e}back é\\t";
        assert_eq!(one_line(forged), shown);
        assert_eq!(lines(forged), shown.replace("\\n", "\n").replace("\\t", "\t"));
        assert!(matches!(one_line("a b é \"x\""), Cow::Borrowed(_)));
        let value = serde_json::json!({ forged: [forged, "\u{7f}"] });
        let printed = format!("{value:#}");
        let printed = json(&printed);
        assert!(!printed.chars().any(|c| c != '\n' && is_unsafe(c)), "{printed}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&printed).unwrap(), value);
    }
}
