//! A string of symbols in memory, and matching of left and right contexts in the tree that its brackets describe.
//!
//! Based on: P. Prusinkiewicz, A. Lindenmayer, *The Algorithmic Beauty of Plants*, 1990, sections 1.8 and 1.10.

use super::budget::Budget;
use super::grammar::{Considered, Pattern};
use crate::Result;

/// String of symbols with their parameters.
#[derive(Debug, Default)]
pub struct ModuleString {
    symbols: Vec<char>,
    /// End of each symbol's parameters in `values`.
    ends: Vec<usize>,
    values: Vec<f64>,
    /// Index of the other bracket of a pair; of an open bracket that is never closed, the string's length.
    partners: Vec<usize>,
}

impl ModuleString {
    pub fn push(&mut self, symbol: char, arguments: &[f64]) {
        self.symbols.push(symbol);
        self.values.extend(arguments);
        self.ends.push(self.values.len());
    }

    pub fn len(&self) -> usize {
        self.symbols.len()
    }

    /// Bytes of memory, with brackets paired.
    pub fn bytes(&self) -> usize {
        self.symbols.len() * (size_of::<char>() + 2 * size_of::<usize>()) + self.values.len() * size_of::<f64>()
    }

    /// Symbol `i` < len and its parameters.
    pub fn module(&self, i: usize) -> (char, &[f64]) {
        let start = if i == 0 { 0 } else { self.ends[i - 1] };
        (self.symbols[i], &self.values[start..self.ends[i]])
    }

    /// Find the pairs of brackets; contexts need them.
    pub fn pair_brackets(&mut self) {
        self.partners = vec![self.len(); self.len()];
        let mut open = Vec::new();
        for (i, c) in self.symbols.iter().enumerate() {
            match c {
                '[' => open.push(i),
                ']' => {
                    if let Some(j) = open.pop() {
                        (self.partners[i], self.partners[j]) = (j, i);
                    }
                }
                _ => {}
            }
        }
    }

    /// Index of the `]` that ends the branch that symbol `at` is on, or the string's length.
    pub fn end_of_branch(&self, at: usize) -> usize {
        let mut i = at;
        while i < self.len() && self.symbols[i] != ']' {
            i = if self.symbols[i] == '[' { self.partners[i] + 1 } else { i + 1 };
        }
        i.min(self.len())
    }

    fn fits(&self, i: usize, pattern: Pattern, bound: &mut Vec<f64>) -> bool {
        let (symbol, values) = self.module(i);
        let fits = symbol == pattern.symbol && values.len() == pattern.count;
        if fits {
            bound.extend(values);
        }
        fits
    }

    /// Test whether `pattern` is the path that leads to symbol `at`; branches on the way and symbols that are not considered
    /// are skipped. Parameters are added to `bound` in the order of the pattern.
    pub fn left(
        &self,
        at: usize,
        pattern: &[Pattern],
        considered: &Considered,
        budget: &mut Budget,
        bound: &mut Vec<f64>,
    ) -> Result<bool> {
        let mut i = at;
        let mut places = Vec::with_capacity(pattern.len());
        for wanted in pattern.iter().rev() {
            loop {
                if i == 0 {
                    return Ok(false);
                }
                budget.spend(1)?;
                i -= 1;
                match self.symbols[i] {
                    ']' if self.partners[i] < i => i = self.partners[i],
                    '[' | ']' => {}
                    c if considered.holds(c) => break,
                    _ => {}
                }
            }
            let (symbol, values) = self.module(i);
            if symbol != wanted.symbol || values.len() != wanted.count {
                return Ok(false);
            }
            places.push(i);
        }
        for &i in places.iter().rev() {
            bound.extend(self.module(i).1);
        }
        Ok(true)
    }

    /// Test whether `pattern` follows symbol `at`; branches that it does not name are skipped. Parameters are added to `bound`.
    pub fn right(
        &self,
        at: usize,
        pattern: &[Pattern],
        considered: &Considered,
        budget: &mut Budget,
        bound: &mut Vec<f64>,
    ) -> Result<bool> {
        let mut i = at + 1;
        let mut wanted = pattern;
        while let Some((&first, rest)) = wanted.split_first() {
            if i >= self.len() {
                return Ok(false);
            }
            budget.spend(1)?;
            let c = self.symbols[i];
            if first.symbol == '[' {
                // A branch that begins as the pattern does; the first that fits is taken.
                let close = closing(rest);
                let (inner, after) = (rest.get(..close).unwrap_or_default(), rest.get(close + 1..).unwrap_or_default());
                loop {
                    match self.symbols.get(i) {
                        Some('[') => {
                            let before = bound.len();
                            if self.right(i, inner, considered, budget, bound)? {
                                break;
                            }
                            bound.truncate(before);
                            i = self.partners[i] + 1;
                        }
                        Some(&c) if c != ']' && !considered.holds(c) => i += 1,
                        _ => return Ok(false),
                    }
                    budget.spend(1)?;
                }
                i = self.partners[i] + 1;
                wanted = after;
            } else if c == ']' {
                return Ok(false);
            } else if c == '[' {
                i = self.partners[i] + 1;
            } else if !considered.holds(c) {
                i += 1;
            } else if self.fits(i, first, bound) {
                i += 1;
                wanted = rest;
            } else {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// Index in `pattern` of the bracket that closes the one open before it.
fn closing(pattern: &[Pattern]) -> usize {
    let mut depth = 0usize;
    for (i, p) in pattern.iter().enumerate() {
        match p.symbol {
            '[' => depth += 1,
            ']' if depth == 0 => return i,
            ']' => depth -= 1,
            _ => {}
        }
    }
    pattern.len()
}
