//! Decoding of text files: byte-order marks, UTF-16, lines that end with a carriage return, continuation lines, comments, tables.

use std::borrow::Cow;

/// The bytes of a text in UTF-8, without a byte-order mark. UTF-16 is known by its mark alone.
pub fn utf8(bytes: &[u8]) -> Cow<'_, [u8]> {
    let wide = |rest: &[u8], unit: fn([u8; 2]) -> u16| {
        let units = rest.as_chunks::<2>().0.iter().map(|b| unit(*b));
        let text: String = char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect();
        Cow::Owned(text.into_bytes())
    };
    match bytes {
        [0xef, 0xbb, 0xbf, rest @ ..] => Cow::Borrowed(rest),
        [0xff, 0xfe, rest @ ..] => wide(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => wide(rest, u16::from_be_bytes),
        _ => Cow::Borrowed(bytes),
    }
}

/// The same as a string; what is not UTF-8 becomes U+FFFD, and carriage returns become the ends of lines where there are no others.
pub fn decode(bytes: &[u8]) -> Cow<'_, str> {
    let text = match utf8(bytes) {
        Cow::Borrowed(bytes) => String::from_utf8_lossy(bytes),
        Cow::Owned(bytes) => String::from_utf8_lossy(&bytes).into_owned().into(),
    };
    if text.contains('\r') && !text.contains('\n') { text.replace('\r', "\n").into() } else { text }
}

/// Lines, each with its number from 1 on. A line that ends in a backslash goes on with the next, and has the number of
/// the first.
pub fn logical_lines(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut lines = text.lines().enumerate();
    std::iter::from_fn(move || {
        let (number, line) = lines.next()?;
        let Some(open) = line.trim_end().strip_suffix('\\') else { return Some((number + 1, Cow::Borrowed(line))) };
        let mut whole = open.to_owned();
        for (_, line) in lines.by_ref() {
            whole.push(' ');
            let open = line.trim_end().strip_suffix('\\');
            whole.push_str(open.unwrap_or(line));
            if open.is_none() {
                break;
            }
        }
        Some((number + 1, Cow::Owned(whole)))
    })
}

/// The line before a `#` that begins a word.
pub fn without_comment(line: &str) -> &str {
    let begins = |(i, _): &(usize, &str)| line[..*i].chars().next_back().is_none_or(char::is_whitespace);
    line.match_indices('#').find(begins).map_or(line, |(i, _)| &line[..i])
}

/// The first word of a line and what follows it, both without spaces around.
pub fn keyword(line: &str) -> (&str, &str) {
    let line = line.trim();
    let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    (key, rest.trim())
}

/// The fields of a line of a table, without quotes, each with the column of its first character, from 1 on.
pub fn fields(line: &str, separator: char) -> impl Iterator<Item = (usize, &str)> {
    let mut rest = Some((0, line));
    std::iter::from_fn(move || {
        let (start, text) = rest.take()?;
        let skipped =
            text.len() - text.trim_start_matches(|c: char| c.is_whitespace() && c != separator || c == ' ').len();
        let (start, text) = (start + skipped, &text[skipped..]);
        if text.is_empty() && separator == ' ' {
            return None;
        }
        let end = match text.strip_prefix('"').and_then(|t| t.find('"')) {
            Some(quote) => text[quote + 2..].find(separator).map(|e| e + quote + 2),
            None => text.find(separator),
        };
        rest = end.map(|e| (start + e + 1, &text[e + 1..]));
        let field = text[..end.unwrap_or(text.len())].trim();
        let field = field.strip_prefix('"').and_then(|f| f.strip_suffix('"')).unwrap_or(field);
        Some((line[..start].chars().count() + 1, field))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_left_out() {
        for bytes in [&b"v \xc3\xa9"[..], b"\xef\xbb\xbfv \xc3\xa9", b"\xff\xfev\0 \0\xe9\0", b"\xfe\xff\0v\0 \0\xe9"] {
            assert_eq!(decode(bytes), "v é", "{bytes:?}");
        }
        assert_eq!(decode(b"\xff\xfe\x00\xd8a"), "\u{fffd}", "half a pair, and half a unit");
        assert_eq!(decode(b"a\xffb"), "a\u{fffd}b");
        assert_eq!(decode(b""), "");
        // As programs of the classic Mac OS write lines; beside a line feed a carriage return is none of its own.
        assert_eq!([decode(b"a\rb\r"), decode(b"a\rb\r\n")], ["a\nb\n", "a\rb\r\n"]);
    }

    #[test]
    fn broken_lines_are_joined() {
        let lines = |text| logical_lines(text).map(|(n, l)| (n, l.into_owned())).collect::<Vec<_>>();
        let expected = [(1, "a b c"), (4, "d"), (5, "e")].map(|(n, l)| (n, l.to_owned()));
        assert_eq!(lines("a\\\r\nb\\ \nc\nd\ne\\"), expected);
        assert_eq!(lines("e\\\n")[0].1, "e");
        assert_eq!(lines("e\\\n\nf"), [(1, "e ".to_owned()), (3, "f".to_owned())]);
        // Each line is joined once, so that a long run of them takes time in proportion to its length.
        assert_eq!(lines(&"a\\\n".repeat(100_000)).len(), 1);
    }

    #[test]
    fn comments_begin_words() {
        assert_eq!(without_comment("newmtl a#1 # note"), "newmtl a#1 ");
        assert_eq!(without_comment("# all"), "");
        assert_eq!(keyword("  map_Kd \t a b.png "), ("map_Kd", "a b.png"));
        assert_eq!(keyword("end"), ("end", ""));
    }
}
