//! Derivation: the symbols of the last string, one after another. Where no production looks at neighbours, symbols are
//! rewritten depth first and no string is kept; else strings follow each other in memory.
//!
//! Based on: P. Prusinkiewicz, A. Lindenmayer, *The Algorithmic Beauty of Plants*, 1990, ch. 1; A. Smith, *Plants, Fractals,
//! and Formal Languages*, SIGGRAPH 1984.

use super::budget::Budget;
use super::context::Text;
use super::grammar::{Considered, Grammar, Module, Production, Rules};
use crate::Result;
use crate::random::SplitMix64;

/// Takes a symbol of the last string and its parameters.
pub type Each<'a> = dyn FnMut(char, &[f64], &mut Budget) -> Result<()> + 'a;

/// Symbols of one successor that are still to be rewritten.
struct Frame<'g> {
    modules: &'g [Module],
    at: usize,
    /// Start of the parameters that its expressions use; they reach to those of the next frame.
    parameters: usize,
    stage: Stage,
}

/// Rewriting that a symbol still has to undergo.
#[derive(Clone, Copy)]
enum Stage {
    /// This many derivation steps, then the homomorphism.
    Steps(u64),
    /// Productions of the homomorphism from this one on.
    Homomorphism(usize),
}

/// Chooses productions.
pub struct Chooser<'g> {
    considered: &'g Considered,
    rng: SplitMix64,
    /// Production and weight of those that match.
    matching: Vec<(usize, f64)>,
}

impl<'g> Chooser<'g> {
    /// The production for a symbol, from number `from` on, with its parameters in `bound`. `place`: the string, and where in it the symbol is.
    fn choose<'r>(
        &mut self,
        rules: &'r Rules,
        from: usize,
        (symbol, arguments): (char, &[f64]),
        place: Option<(&Text, usize)>,
        budget: &mut Budget,
        bound: &mut Vec<f64>,
    ) -> Result<Option<&'r Production>> {
        let list = rules.of(symbol);
        self.matching.clear();
        for (i, production) in list.iter().enumerate() {
            if let Some(&(first, _)) = self.matching.first()
                && list[first].in_context() != production.in_context()
            {
                break;
            }
            if production.number < from || !self.matches(production, arguments, place, budget, bound)? {
                continue;
            }
            match &production.weight {
                Some(weight) => {
                    let weight = weight.value(bound, &mut self.rng);
                    self.matching.push((i, if weight.is_finite() { weight.max(0.0) } else { 0.0 }));
                }
                None if self.matching.is_empty() => return Ok(Some(production)),
                None => {}
            }
        }
        let total: f64 = self.matching.iter().map(|m| m.1).sum();
        if total <= 0.0 {
            return Ok(None);
        }
        let mut lot = total * self.rng.unit();
        let chosen = self.matching.iter().find(|m| {
            lot -= m.1;
            lot < 0.0
        });
        let last = self.matching.iter().rfind(|m| m.1 > 0.0);
        let Some(production) = chosen.or(last).and_then(|m| list.get(m.0)) else { return Ok(None) };
        bind(production, self.considered, arguments, place, budget, bound)?;
        Ok(Some(production))
    }

    fn matches(
        &mut self,
        production: &Production,
        arguments: &[f64],
        place: Option<(&Text, usize)>,
        budget: &mut Budget,
        bound: &mut Vec<f64>,
    ) -> Result<bool> {
        Ok(bind(production, self.considered, arguments, place, budget, bound)?
            && production.condition.as_ref().is_none_or(|c| c.value(bound, &mut self.rng) != 0.0))
    }
}

/// Collect the parameters of left context, symbol and right context; false where they do not match.
fn bind(
    production: &Production,
    considered: &Considered,
    arguments: &[f64],
    place: Option<(&Text, usize)>,
    budget: &mut Budget,
    bound: &mut Vec<f64>,
) -> Result<bool> {
    bound.clear();
    if production.predecessor.count != arguments.len() {
        return Ok(false);
    }
    let Some((text, at)) = place.filter(|_| production.in_context()) else {
        bound.extend(arguments);
        return Ok(!production.in_context());
    };
    if !text.left(at, &production.left, considered, budget, bound)? {
        return Ok(false);
    }
    bound.extend(arguments);
    text.right(at, &production.right, considered, budget, bound)
}

/// Give the symbols of the string after `iterations` steps, in order, with their parameters.
///
/// # Errors
/// [`Error::Limit`] where the budget does not last, and what `each` gives.
pub fn derive(grammar: &Grammar, iterations: u64, seed: u64, budget: &mut Budget, each: &mut Each) -> Result<()> {
    let chooser = Chooser { considered: &grammar.considered, rng: SplitMix64::new(seed), matching: Vec::new() };
    let mut deriver = Deriver { grammar, chooser, frames: Vec::new(), parameters: Vec::new(), bound: Vec::new() };
    if !grammar.rules.in_context() {
        let stage = Stage::Steps(iterations);
        deriver.frames.push(Frame { modules: &grammar.axiom, at: 0, parameters: 0, stage });
        return deriver.run(budget, each);
    }
    let mut text = Text::default();
    let mut arguments = Vec::new();
    for module in &grammar.axiom {
        arguments.clear();
        arguments.extend(module.arguments.iter().map(|a| a.value(&[], &mut deriver.chooser.rng)));
        text.push(module.symbol, &arguments);
    }
    for _ in 0..iterations {
        text.pair_brackets();
        text = deriver.rewrite(&text, budget)?;
    }
    for i in 0..text.len() {
        budget.spend(1)?;
        deriver.advance(text.module(i), Stage::Steps(0), budget, each)?;
        deriver.run(budget, each)?;
    }
    Ok(())
}

struct Deriver<'g> {
    grammar: &'g Grammar,
    chooser: Chooser<'g>,
    frames: Vec<Frame<'g>>,
    /// Parameters of all frames, one after another.
    parameters: Vec<f64>,
    bound: Vec<f64>,
}

impl<'g> Deriver<'g> {
    /// One step of a whole string. What follows `%` to the end of its branch is cut off.
    fn rewrite(&mut self, text: &Text, budget: &mut Budget) -> Result<Text> {
        let mut next = Text::default();
        let mut arguments = Vec::new();
        let mut at = 0;
        while at < text.len() {
            budget.spend(1)?;
            let (symbol, values) = text.module(at);
            if symbol == '%' {
                at = text.end_of_branch(at);
                continue;
            }
            let found = (symbol, values);
            let rules = &self.grammar.rules;
            match self.chooser.choose(rules, 0, found, Some((text, at)), budget, &mut self.bound)? {
                None => next.push(symbol, values),
                Some(production) => {
                    for module in &production.successor {
                        arguments.clear();
                        let rng = &mut self.chooser.rng;
                        arguments.extend(module.arguments.iter().map(|a| a.value(&self.bound, rng)));
                        next.push(module.symbol, &arguments);
                        budget.spend(1)?;
                        budget.holds(text.bytes() + next.bytes())?;
                    }
                }
            }
            budget.holds(text.bytes() + next.bytes())?;
            at += 1;
        }
        Ok(next)
    }

    /// Give the symbol, or what it becomes, once `stage` is done.
    fn advance(&mut self, found: (char, &[f64]), mut stage: Stage, budget: &mut Budget, each: &mut Each) -> Result<()> {
        let grammar = self.grammar;
        let mut chosen = None;
        while let Stage::Steps(left @ 1..) = stage {
            stage = Stage::Steps(left - 1);
            chosen = self.chooser.choose(&grammar.rules, 0, found, None, budget, &mut self.bound)?;
            // A symbol that nothing matches is not matched later, unless by lot.
            if chosen.is_some() || !grammar.rules.random(found.0) {
                break;
            }
            budget.spend(1)?;
        }
        if chosen.is_none() {
            let from = if let Stage::Homomorphism(from) = stage { from } else { 0 };
            chosen = self.chooser.choose(&grammar.homomorphism, from, found, None, budget, &mut self.bound)?;
            stage = Stage::Homomorphism(chosen.map_or(0, |p| p.number + 1));
        }
        let Some(production) = chosen else { return each(found.0, found.1, budget) };
        let start = self.parameters.len();
        self.parameters.extend(&self.bound);
        self.frames.push(Frame { modules: &production.successor, at: 0, parameters: start, stage });
        budget.holds(self.frames.len() * size_of::<Frame>() + 8 * self.parameters.len())
    }

    /// Rewrite depth first what the frames hold.
    fn run(&mut self, budget: &mut Budget, each: &mut Each) -> Result<()> {
        let mut arguments = Vec::new();
        while let Some(frame) = self.frames.last_mut() {
            let Some(module) = frame.modules.get(frame.at) else {
                self.parameters.truncate(frame.parameters);
                self.frames.pop();
                continue;
            };
            budget.spend(1)?;
            frame.at += 1;
            let stage = frame.stage;
            arguments.clear();
            let own = self.parameters.get(frame.parameters..).unwrap_or_default();
            arguments.extend(module.arguments.iter().map(|a| a.value(own, &mut self.chooser.rng)));
            // A frame that is through makes room before its last symbol is rewritten: F → F takes no memory.
            if frame.at == frame.modules.len() {
                self.parameters.truncate(frame.parameters);
                self.frames.pop();
            }
            self.advance((module.symbol, &arguments), stage, budget, each)?;
        }
        Ok(())
    }
}
