//! The library's messages name an option by the field that sets it, "option `look_at`"; here it becomes the flag that does.

use std::borrow::Cow;

/// What is not called as its field is; a longer text stands before one that it begins with.
const NAMED_OTHERWISE: [(&str, &str); 11] = [
    ("`animations`", "--animation"),
    ("`cells`", "--cell (or --repeat)"),
    ("`chart` along", "--planar"),
    ("`chart`", "--planar"),
    ("`geometries`", "--geometry"),
    ("`heights` along", "--height-along"),
    ("`sizes`", "--size"),
    ("`texels`", "--texel"),
    ("`weights`", "--weight"),
    ("`width`", "--line-width"),
    ("`z_up`", "--heights z-up"),
];

/// The text with flags in place of options: "option `sigma` = 9" becomes "--sigma 9".
pub fn named(text: &str) -> Cow<'_, str> {
    const MARK: &str = "option `";
    let mut pieces = text.split(MARK);
    let (Some(first), true) = (pieces.next(), text.contains(MARK)) else { return Cow::Borrowed(text) };
    let mut out = first.to_owned();
    for piece in pieces {
        let Some((name, rest)) = piece.split_once('`').filter(|(name, _)| is_field(name)) else {
            out += MARK;
            out += piece;
            continue;
        };
        let quoted = |known: &&(&str, &str)| known.0.strip_prefix('`').is_some_and(|k| piece.starts_with(k));
        let rest = match NAMED_OTHERWISE.iter().find(quoted) {
            Some((known, flag)) => {
                out += flag;
                piece.get(known.len() - 1..).unwrap_or_default()
            }
            None => {
                out += "--";
                out += &name.replace('_', "-");
                rest
            }
        };
        // What it is set to follows the flag.
        out += rest.strip_prefix(" =").unwrap_or(rest);
    }
    Cow::Owned(out)
}

fn is_field(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|b| b.is_ascii_lowercase() || b == b'_')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_become_flags() {
        assert_eq!(named("raise option `max_symbols`, or not"), "raise --max-symbols, or not");
        assert_eq!(named("option `sigma` = 9: 0 to 4"), "--sigma 9: 0 to 4");
        assert_eq!(named("use option `chart` along y (option `chart`)"), "use --planar y (--planar)");
        assert_eq!(named("option `geometries` = a.txt: no"), "--geometry a.txt: no");
        assert_eq!(named("option `Not a field`, option `open"), "option `Not a field`, option `open");
        assert!(matches!(named("no option at all"), Cow::Borrowed(_)));
    }
}
