//! Derivation of the last string, whose symbols are handed over one after another. Where no production has a context, symbols are
//! rewritten depth first, so that no string is ever stored. Else whole strings are rewritten in memory, step by step.
//!
//! Based on: P. Prusinkiewicz, A. Lindenmayer, *The Algorithmic Beauty of Plants*, 1990, ch. 1; A. Smith, *Plants, Fractals,
//! and Formal Languages*, SIGGRAPH 1984.

use super::alphabet::Action;
use super::budget::Budget;
use super::context::ModuleString;
use super::expr::Environment;
use super::grammar::{Grammar, Module, Production, Recursion, Rules};
use super::program::run;
use crate::Result;

/// Callback that receives a symbol of the last string, and its parameters.
pub type Each<'a> = dyn FnMut(char, &[f64], &mut Budget) -> Result<()> + 'a;

/// Symbols of one successor that are still to be rewritten.
struct Expansion<'g> {
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
    /// Decomposition of what a step gave, from this depth on, then these steps.
    Decomposition { depth: u64, steps: u64 },
    /// Productions of the homomorphism from this one on, at this depth.
    Homomorphism { from: usize, depth: u64 },
}

/// Place of a symbol: the string and its index in it; `None` where strings are not stored.
type Place<'t> = Option<(&'t ModuleString, usize)>;

/// A symbol that may be rewritten.
struct Occurrence<'t> {
    symbol: char,
    /// Values of its parameters.
    arguments: &'t [f64],
    place: Place<'t>,
}

/// Selection of the production to apply to a symbol.
struct Chooser<'g> {
    grammar: &'g Grammar,
    env: Environment,
    /// Productions that match: index, weight, and parameters and variables after the statements before the condition were run.
    matching: Vec<(usize, f64, Vec<f64>)>,
}

impl<'g> Chooser<'g> {
    /// Choose the production that is applied to a symbol, among those from number `from` on, and run its statements. Its parameters and
    /// variables are in `bound` then. `None` where none matches.
    fn choose<'r>(
        &mut self,
        rules: &'r Rules,
        from: usize,
        occurrence: &Occurrence,
        budget: &mut Budget,
        bound: &mut Vec<f64>,
    ) -> Result<Option<&'r Production>> {
        let list = rules.of(occurrence.symbol);
        self.matching.clear();
        let mut chosen = None;
        for (i, production) in list.iter().enumerate() {
            if self.grammar.context_first
                && let Some((first, ..)) = self.matching.first()
                && list[*first].in_context() != production.in_context()
            {
                break;
            }
            if production.number < from || !self.matches(production, occurrence, budget, bound)? {
                continue;
            }
            match &production.weight {
                Some(weight) => {
                    let weight = weight.value(bound, &mut self.env);
                    let weight = if weight.is_finite() { weight.max(0.0) } else { 0.0 };
                    let own = if production.before.is_empty() { Vec::new() } else { bound.clone() };
                    self.matching.push((i, weight, own));
                }
                None if self.matching.is_empty() => {
                    chosen = Some(production);
                    break;
                }
                None => {}
            }
        }
        if chosen.is_none()
            && let Some(i) = self.draw()
            && let (Some(production), Some((.., own))) = (list.get(i), self.matching.iter_mut().find(|m| m.0 == i))
        {
            if production.before.is_empty() {
                self.bind(production, occurrence, budget, bound)?;
            } else {
                std::mem::swap(bound, own);
            }
            chosen = Some(production);
        }
        if let Some(production) = chosen {
            run(&production.after, bound, &mut self.env, budget)?;
        }
        Ok(chosen)
    }

    /// Index of one of the matching productions, drawn at random in proportion to their weights.
    fn draw(&mut self) -> Option<usize> {
        let total: f64 = self.matching.iter().map(|m| m.1).sum();
        if total <= 0.0 {
            return None;
        }
        let mut lot = total * self.env.rng.unit();
        let chosen = self.matching.iter().find(|m| {
            lot -= m.1;
            lot < 0.0
        });
        chosen.or(self.matching.iter().rfind(|m| m.1 > 0.0)).map(|m| m.0)
    }

    fn matches(
        &mut self,
        production: &Production,
        occurrence: &Occurrence,
        budget: &mut Budget,
        bound: &mut Vec<f64>,
    ) -> Result<bool> {
        Ok(self.bind(production, occurrence, budget, bound)?
            && run(&production.before, bound, &mut self.env, budget)?
            && production.condition.as_ref().is_none_or(|c| c.value(bound, &mut self.env) != 0.0))
    }

    /// Collect the parameters of left context, symbol and right context, and variables that are 0; false where they do not
    /// match.
    fn bind(
        &self,
        production: &Production,
        occurrence: &Occurrence,
        budget: &mut Budget,
        bound: &mut Vec<f64>,
    ) -> Result<bool> {
        let &Occurrence { arguments, place, .. } = occurrence;
        bound.clear();
        if production.predecessor.count != arguments.len() {
            return Ok(false);
        }
        match place.filter(|_| production.in_context()) {
            Some((text, at)) => {
                let considered = &self.grammar.considered;
                if !text.left(at, &production.left, considered, budget, bound)? {
                    return Ok(false);
                }
                bound.extend(arguments);
                if !text.right(at, &production.right, considered, budget, bound)? {
                    return Ok(false);
                }
            }
            None if production.in_context() => return Ok(false),
            None => bound.extend(arguments),
        }
        bound.resize(bound.len() + production.variables, 0.0);
        Ok(true)
    }
}

/// Give the symbols of the string after `iterations` steps, in order, with their parameters.
///
/// # Errors
/// [`Error::Limit`] where the budget does not last, and what `each` gives.
pub fn derive(grammar: &Grammar, iterations: u64, seed: u64, budget: &mut Budget, each: &mut Each) -> Result<()> {
    let env = Environment::new(seed, &grammar.globals);
    let chooser = Chooser { grammar, env, matching: Vec::new() };
    let mut deriver =
        Deriver { grammar, chooser, frames: Vec::new(), parameters: Vec::new(), bound: Vec::new(), one_step: false };
    if !grammar.by_strings() {
        let stage = Stage::Steps(iterations);
        deriver.frames.push(Expansion { modules: &grammar.axiom, at: 0, parameters: 0, stage });
        return deriver.run(None, budget, each);
    }
    run(&grammar.blocks.start, &mut [], &mut deriver.chooser.env, budget)?;
    let mut text = ModuleString::default();
    let mut arguments = Vec::new();
    for module in &grammar.axiom {
        arguments.clear();
        arguments.extend(module.arguments.iter().map(|a| a.value(&[], &mut deriver.chooser.env)));
        text.push(module.symbol, &arguments);
    }
    for step in 1..=iterations {
        let env = &mut deriver.chooser.env;
        if let Some(variable) = grammar.step_variable.and_then(|i| env.globals.get_mut(i)) {
            *variable = step as f64;
        }
        run(&grammar.blocks.start_each, &mut [], env, budget)?;
        text.pair_brackets();
        text = deriver.rewrite(&text, budget)?;
        run(&grammar.blocks.end_each, &mut [], &mut deriver.chooser.env, budget)?;
    }
    run(&grammar.blocks.end, &mut [], &mut deriver.chooser.env, budget)?;
    for i in 0..text.len() {
        budget.spend(1)?;
        let (symbol, arguments) = text.module(i);
        deriver.advance(&Occurrence { symbol, arguments, place: None }, Stage::Steps(0), budget, each)?;
        deriver.run(None, budget, each)?;
    }
    Ok(())
}

struct Deriver<'g> {
    grammar: &'g Grammar,
    chooser: Chooser<'g>,
    frames: Vec<Expansion<'g>>,
    /// Parameters of all frames, one after another.
    parameters: Vec<f64>,
    bound: Vec<f64>,
    /// Whether a symbol is given when its steps are done, before the homomorphism.
    one_step: bool,
}

impl<'g> Deriver<'g> {
    /// One step of a whole string. What follows a cut to the end of its branch is left out.
    fn rewrite(&mut self, text: &ModuleString, budget: &mut Budget) -> Result<ModuleString> {
        let mut next = ModuleString::default();
        let grammar = self.grammar;
        self.one_step = true;
        let mut at = 0;
        while at < text.len() {
            budget.spend(1)?;
            let (symbol, arguments) = text.module(at);
            if grammar.actions.get(&symbol) == Some(&Action::Cut) {
                at = text.end_of_branch(at);
                continue;
            }
            let place = Some((text, at));
            let found = Occurrence { symbol, arguments, place };
            let mut each = |symbol: char, arguments: &[f64], budget: &mut Budget| {
                next.push(symbol, arguments);
                budget.holds(text.bytes() + next.bytes())
            };
            match self.chooser.choose(&grammar.rules, 0, &found, budget, &mut self.bound)? {
                Some(production) => self.open(production, self.after_step(0), budget)?,
                None => self.advance(&found, self.after_step(0), budget, &mut each)?,
            }
            self.run(place, budget, &mut each)?;
            at += 1;
        }
        self.one_step = false;
        Ok(next)
    }

    /// Stage of what a step gave or left.
    fn after_step(&self, steps: u64) -> Stage {
        if self.grammar.decomposition.is_empty() {
            Stage::Steps(steps)
        } else {
            Stage::Decomposition { depth: 0, steps }
        }
    }

    /// Give the symbol, or open a frame of what it becomes, once `stage` is done.
    fn advance(&mut self, found: &Occurrence, mut stage: Stage, budget: &mut Budget, each: &mut Each) -> Result<()> {
        let grammar = self.grammar;
        loop {
            let (rules, from, next) = match stage {
                Stage::Decomposition { depth, steps } if depth < grammar.decomposition_depth => {
                    (&grammar.decomposition, 0, Stage::Decomposition { depth: depth + 1, steps })
                }
                Stage::Decomposition { steps, .. } => {
                    stage = Stage::Steps(steps);
                    continue;
                }
                Stage::Steps(0) if self.one_step => return each(found.symbol, found.arguments, budget),
                Stage::Steps(0) => {
                    stage = Stage::Homomorphism { from: 0, depth: 0 };
                    continue;
                }
                Stage::Steps(left) => (&grammar.rules, 0, self.after_step(left - 1)),
                Stage::Homomorphism { from, depth } => match grammar.recursion {
                    Recursion::Depth(most) if depth >= most => return each(found.symbol, found.arguments, budget),
                    _ => (&grammar.homomorphism, from, Stage::Homomorphism { from, depth: depth + 1 }),
                },
            };
            if let Some(production) = self.chooser.choose(rules, from, found, budget, &mut self.bound)? {
                let next = match (next, grammar.recursion) {
                    (Stage::Homomorphism { depth, .. }, Recursion::Below) => {
                        Stage::Homomorphism { from: production.number + 1, depth }
                    }
                    (next, _) => next,
                };
                return self.open(production, next, budget);
            }
            stage = match stage {
                Stage::Decomposition { steps, .. } => Stage::Steps(steps),
                // A symbol that nothing matches is not matched later, unless by lot.
                Stage::Steps(_)
                    if !grammar.rules.random(found.symbol) && grammar.decomposition.of(found.symbol).is_empty() =>
                {
                    Stage::Steps(0)
                }
                Stage::Steps(_) => {
                    budget.spend(1)?;
                    next
                }
                Stage::Homomorphism { .. } => return each(found.symbol, found.arguments, budget),
            };
        }
    }

    /// A frame of what `production` gives; its parameters are bound.
    fn open(&mut self, production: &'g Production, stage: Stage, budget: &mut Budget) -> Result<()> {
        let start = self.parameters.len();
        self.parameters.extend(&self.bound);
        self.frames.push(Expansion { modules: &production.successor, at: 0, parameters: start, stage });
        budget.holds(self.frames.len() * size_of::<Expansion>() + 8 * self.parameters.len())
    }

    /// Rewrite depth first what the frames hold.
    fn run(&mut self, place: Place, budget: &mut Budget, each: &mut Each) -> Result<()> {
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
            arguments.extend(module.arguments.iter().map(|a| a.value(own, &mut self.chooser.env)));
            // A frame that is through makes room before its last symbol is rewritten: F → F takes no memory.
            if frame.at == frame.modules.len() {
                self.parameters.truncate(frame.parameters);
                self.frames.pop();
            }
            let found = Occurrence { symbol: module.symbol, arguments: &arguments, place };
            self.advance(&found, stage, budget, each)?;
        }
        Ok(())
    }
}
