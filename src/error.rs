//! What can go wrong, sorted by who is at fault, and the warnings that are counted on the way.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Every way in which a call into this library fails.
///
/// `Display` gives one line that says what, where, and what to do. It names an option by the field that sets it, as
/// "option `look_at`", and so do warnings and notes; the CLI prints the line with its flags in their place.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused: a missing file, a full disk, no permission.
    #[error("{}: {source}", path.display())]
    Io {
        /// File.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The bytes of a `.vtex` file break a rule of `format-spec/vtex-1.md`; `code` names the rule in `format-spec/codes`.
    #[error("{}: not a valid vtex file: {what} [{code}, byte {offset}]", path.display())]
    Format {
        /// File.
        path: PathBuf,
        /// Name of the broken rule.
        code: &'static str,
        /// Byte of the file at which it is broken.
        offset: u64,
        /// What is wrong.
        what: String,
    },
    /// Valid input that this version does not read.
    #[error("{}: {what} is not supported", path.display())]
    Unsupported {
        /// File.
        path: PathBuf,
        /// What is not read.
        what: String,
    },
    /// The input breaks its own format's rules, or holds nothing to work on; `at` says where in it.
    #[error("{}{}{at}: {what}", path.display(), if at.is_empty() { "" } else { ": " })]
    Input {
        /// File.
        path: PathBuf,
        /// Place in the file, in its own terms; may be empty.
        at: String,
        /// What is wrong, and what to do.
        what: String,
    },
    /// A size that was checked before memory was taken for it.
    #[error("{what} needs {needed}, the limit is {allowed}")]
    Limit {
        /// What is too large, with its unit.
        what: String,
        /// Size that was asked for.
        needed: u64,
        /// Largest size that is allowed.
        allowed: u64,
    },
    /// So many warnings were given where none was allowed.
    #[error("{0} warnings were given and option `strict` allows none")]
    Warned(u64),
    /// A check that was asked for found what must not be.
    #[error("{0}")]
    Failed(String),
    /// Options that contradict each other or are out of range: the caller's fault, exit code 2.
    #[error("{0}")]
    Options(String),
}

/// Shorthand for results of this library.
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// An [`Error::Io`] about `path`.
    pub fn io(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Error::Io { path: path.as_ref().to_path_buf(), source }
    }

    /// An [`Error::Input`] about the place `at` in `path`.
    pub fn input(path: impl AsRef<Path>, at: impl Into<String>, what: impl Into<String>) -> Self {
        Error::Input { path: path.as_ref().to_path_buf(), at: one_line(at.into()), what: one_line(what.into()) }
    }

    /// An [`Error::Unsupported`] feature of `path`.
    pub fn unsupported(path: impl AsRef<Path>, what: impl Into<String>) -> Self {
        Error::Unsupported { path: path.as_ref().to_path_buf(), what: one_line(what.into()) }
    }
}

/// A number as messages have it: at most seven significant digits.
pub fn short(value: f64) -> String {
    // To seven digits, then without those that say nothing.
    let rounded: f64 = format!("{value:.6e}").parse().unwrap_or(value);
    if rounded == 0.0 || (1e-4..1e7).contains(&rounded.abs()) || !rounded.is_finite() {
        rounded.to_string()
    } else {
        format!("{rounded:e}")
    }
}

/// A length as messages have it: three places after the point, or three digits where these would say nothing, and seven at most.
pub fn length(value: f64) -> String {
    match value.abs() {
        0.0 | 0.1..1e4 => format!("{value:.3}"),
        ..0.1 => short(format!("{value:.2e}").parse().unwrap_or(value)),
        _ => short(value),
    }
}

/// The text without a newline: decoders end their messages with one, and names in files may have them anywhere.
fn one_line(text: String) -> String {
    if text.contains(['\n', '\r']) { text.trim_end().replace('\n', "\\n").replace('\r', "\\r") } else { text }
}

/// Things that were mended or left out, each counted under its text.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Warnings(BTreeMap<String, u64>);

impl Warnings {
    /// Count `text` once.
    pub fn add(&mut self, text: impl Into<String>) {
        self.add_many(text, 1);
    }

    /// Count `text` `n` times; `n` = 0 leaves no trace.
    pub fn add_many(&mut self, text: impl Into<String>, n: u64) {
        if n > 0 {
            *self.0.entry(text.into()).or_default() += n;
        }
    }

    /// Take over all of `other`.
    pub fn merge(&mut self, other: Warnings) {
        for (text, n) in other.0 {
            self.add_many(text, n);
        }
    }

    /// Texts with their counts, in alphabetical order.
    pub fn iter(&self) -> impl Iterator<Item = (&str, u64)> {
        self.0.iter().map(|(text, &n)| (text.as_str(), n))
    }

    /// Whether there are no warnings.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Text to append to an error's line where the warnings tell its cause: "; 3 × …; 1 × …".
    pub fn as_reasons(&self) -> String {
        self.iter().map(|(text, n)| format!("; {n} × {text}")).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_seven_digits() {
        let cases = [
            (0.0, "0"),
            (-2.5, "-2.5"),
            (0.1 + 0.2, "0.3"),
            (f64::from(0.1f32), "0.1"),
            (1.0 / 3.0, "0.3333333"),
            (1234567.0, "1234567"),
            (-87654321.0, "-8.765432e7"),
            (f64::MAX, "1.797693e308"),
            (1.0e-9 / 3.0, "3.333333e-10"),
            (f64::NAN, "NaN"),
            (f64::INFINITY, "inf"),
        ];
        for (value, text) in cases {
            assert_eq!(short(value), text);
        }
        let lengths = [
            (0.0, "0.000"),
            (1.7578, "1.758"),
            (10.0, "10.000"),
            (0.000_333_44, "0.000333"),
            (999_000_999.001, "9.99001e8"),
            (12_345.678_9, "12345.68"),
        ];
        for (value, text) in lengths {
            assert_eq!(length(value), text);
        }
    }

    #[test]
    fn errors_are_one_line_whatever_decoders_and_files_say() {
        for error in [Error::input("a", "node \"x\ny\"", "cut\n"), Error::unsupported("a", "this\r\nthat\n")] {
            assert!(!error.to_string().contains(['\n', '\r']), "{error:?}");
        }
        assert_eq!(Error::input("a", "x\ny", "cut short\n").to_string(), "a: x\\ny: cut short");
    }
}
