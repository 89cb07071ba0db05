//! Parsing that text headers have in common: numbers, sizes, units and lists of files.

use std::path::{Path, PathBuf};

use crate::scene::files::find;
use crate::{Error, Result};

/// Files that a header may name.
const MAX_FILES: i64 = 1 << 16;

/// The fields of a text header: name, value, and number of the line.
pub struct Fields<'a> {
    pub path: &'a Path,
    pub list: Vec<(String, String, usize)>,
}

impl Fields<'_> {
    /// The value of the first field whose name is one of `names`, with its line for messages.
    pub fn get(&self, names: &[&str]) -> Option<(&str, String)> {
        let (_, value, line) = self.list.iter().find(|f| names.contains(&f.0.as_str()))?;
        Some((value, format!("line {line}")))
    }

    pub fn wrong<T>(&self, at: String, what: impl Into<String>) -> Result<T> {
        Err(Error::input(self.path, at, what))
    }
}

/// Numbers apart by spaces; `None` where one is none, or not finite.
pub fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split_whitespace().map(|w| w.parse().ok().filter(|v: &f64| v.is_finite())).collect()
}

/// Whether a text begins with a mark of UTF-16, which headers before numbers cannot be in.
pub fn is_utf16(head: &[u8]) -> bool {
    head.starts_with(b"\xff\xfe") || head.starts_with(b"\xfe\xff")
}

/// Metres in a unit of length by its name; `None` where it is not known.
pub fn metres(unit: &str) -> Option<f64> {
    let name = unit.trim().trim_matches('"').replace(['\u{b5}', '\u{3bc}'], "u").replace("\\u00B5", "u").to_lowercase();
    Some(match name.as_str() {
        "km" | "kilometer" | "kilometers" | "kilometre" | "kilometres" => 1e3,
        "m" | "meter" | "meters" | "metre" | "metres" => 1.0,
        "cm" | "centimeter" | "centimeters" | "centimetre" | "centimetres" => 1e-2,
        "mm" | "millimeter" | "millimeters" | "millimetre" | "millimetres" => 1e-3,
        "um" | "micron" | "microns" | "micrometer" | "micrometers" | "micrometre" | "micrometres" => 1e-6,
        "nm" | "nanometer" | "nanometers" | "nanometre" | "nanometres" => 1e-9,
        "\u{e5}" | "angstrom" | "angstroms" => 1e-10,
        "pm" | "picometer" | "picometers" => 1e-12,
        "in" | "inch" | "inches" | "\"" => 0.0254,
        _ => return None,
    })
}

/// A side of a lattice.
pub fn size(word: &str) -> Option<usize> {
    word.parse().ok().filter(|&n| n > 0)
}

/// The sides of a lattice of up to 16 axes, apart by spaces.
pub fn sizes(text: &str) -> Option<Vec<usize>> {
    let sizes: Option<Vec<usize>> = text.split_whitespace().map(size).collect();
    sizes.filter(|s| (1..=16).contains(&s.len()))
}

/// The files that a header's entry stands for: a name, `PATTERN FIRST LAST STEP` where the pattern has one `%d` or `%03d`, or
/// `LIST` and a name a line.
pub fn file_list(header: &Path, text: &str, at: &str) -> Result<Vec<PathBuf>> {
    let dir = header.parent().unwrap_or(Path::new(""));
    let open = |name: &str| {
        find(dir, name, true).ok_or_else(|| Error::input(header, at, format!("its data {name:?} are not there")))
    };
    if text.starts_with("LIST") {
        return text.lines().skip(1).map(str::trim).filter(|l| !l.is_empty()).map(open).collect();
    }
    let words: Vec<&str> = text.split_whitespace().collect();
    let range: Option<Vec<i64>> =
        words.get(1..).map(|w| w.iter().take(3).filter_map(|v| v.parse::<i32>().ok()).map(i64::from).collect());
    if let (Some(pattern), Some([first, last, step])) = (words.first().filter(|w| w.contains('%')), range.as_deref()) {
        let span = last - first;
        if *step == 0 || (span < 0) != (*step < 0) && span != 0 || (span / step) >= MAX_FILES {
            return Err(Error::input(header, at, format!("{text:?} does not count up to {MAX_FILES} files")));
        }
        let Some((before, after)) = pattern.split_once('%') else { return Ok(Vec::new()) };
        let Some((width, after)) = after.split_once('d') else {
            return Err(Error::input(header, at, format!("{pattern:?}: a pattern with one %d is needed")));
        };
        let digits = width.trim_start_matches('0').parse::<usize>().unwrap_or(0).min(20);
        return (0..=span / step).map(|n| open(&format!("{before}{:0digits$}{after}", first + n * step))).collect();
    }
    open(text.trim()).map(|file| vec![file])
}
