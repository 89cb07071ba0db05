//! Names chosen by `--include` and `--exclude`.

use crate::{Error, Result};

/// Patterns, and which of them have met a name.
pub struct Selection<'a> {
    include: Vec<(&'a str, bool)>,
    exclude: Vec<(&'a str, bool)>,
}

impl<'a> Selection<'a> {
    /// `*` stands for any characters, `?` for any one.
    pub fn new(include: &'a [String], exclude: &'a [String]) -> Self {
        let unmet = |names: &'a [String]| names.iter().map(|n| (n.as_str(), false)).collect();
        Selection { include: unmet(include), exclude: unmet(exclude) }
    }

    /// Whether everything is taken that is not left out.
    pub fn takes_all(&self) -> bool {
        self.include.is_empty()
    }

    /// Whether `name` is taken by name.
    pub fn includes(&mut self, name: &str) -> bool {
        meets(&mut self.include, name)
    }

    /// Whether `name` is left out by name.
    pub fn excludes(&mut self, name: &str) -> bool {
        meets(&mut self.exclude, name)
    }

    /// An error about the first pattern that met no `kind` of name.
    pub fn finish(&self, kind: &str) -> Result<()> {
        match self.include.iter().chain(&self.exclude).find(|(_, met)| !met) {
            Some((pattern, _)) => Err(Error::Options(format!("no {kind} is named {pattern}"))),
            None => Ok(()),
        }
    }
}

fn meets(patterns: &mut [(&str, bool)], name: &str) -> bool {
    let mut any = false;
    for (pattern, met) in patterns {
        if *pattern == name || matches(pattern, name) {
            *met = true;
            any = true;
        }
    }
    any
}

/// Whether all of `name` is of the form `pattern`; time is bounded by the product of their lengths.
fn matches(pattern: &str, name: &str) -> bool {
    let (p, n): (Vec<char>, Vec<char>) = (pattern.chars().collect(), name.chars().collect());
    let (mut i, mut k, mut star) = (0, 0, None);
    while k < n.len() {
        if i < p.len() && p[i] == '*' {
            star = Some((i, k));
            i += 1;
        } else if i < p.len() && (p[i] == '?' || p[i] == n[k]) {
            i += 1;
            k += 1;
        } else if let Some((at, from)) = star {
            // The last star takes one character more.
            star = Some((at, from + 1));
            i = at + 1;
            k = from + 1;
        } else {
            return false;
        }
    }
    p[i..].iter().all(|&c| c == '*')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns() {
        for (pattern, name, yes) in [
            ("leaf", "leaf", true),
            ("leaf", "leaves", false),
            ("leaf*", "leaf.001", true),
            ("*leaf*", "oak_leaf_2", true),
            ("l?af", "loaf", true),
            ("l?af", "laf", false),
            ("*", "", true),
            ("a*b*c", "aXbXbXc", true),
            ("a*b*c", "aXbXbX", false),
            ("Blatt?", "Blattä", true),
        ] {
            assert_eq!(matches(pattern, name), yes, "{pattern} {name}");
        }
    }

    #[test]
    fn names_that_are_not_there_are_told() {
        let include = ["trunk".to_string(), "leaf*".to_string()];
        let mut s = Selection::new(&include, &[]);
        assert!(s.includes("leaf1") && !s.includes("root") && !s.takes_all());
        assert!(s.finish("node").unwrap_err().to_string().contains("no node is named trunk"));
        assert!(s.includes("trunk") && s.finish("node").is_ok());
        // A name that looks like a pattern still means itself.
        let exclude = ["tree[1]*".to_string()];
        assert!(Selection::new(&[], &exclude).excludes("tree[1]*"));
    }
}
