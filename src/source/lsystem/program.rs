//! Statements of a grammar: what is done before and after each step, and what a production does to its own variables.

use super::budget::Budget;
use super::expr::{Element, Environment, Expr};
use crate::Result;

/// A variable.
#[derive(Debug, Clone, PartialEq)]
pub enum Variable {
    /// Index into the parameters of the production and its own variables.
    Own(usize),
    /// Index into the variables of the grammar.
    Global(usize),
    Element(Element),
}

#[derive(Debug, Clone, PartialEq)]
pub enum Statement {
    Assign(Variable, Expr),
    /// Run the first list where the condition holds, else the second.
    If(Expr, Vec<Statement>, Vec<Statement>),
    /// Run the list while the condition holds; with `true` it is run before the first test.
    While(Expr, Vec<Statement>, bool),
    /// The production does not match where the condition does not hold.
    Require(Expr),
}

impl Statement {
    /// Test whether it reads or sets variables of the grammar.
    pub fn shares(&self) -> bool {
        match self {
            Statement::Assign(variable, value) => !matches!(variable, Variable::Own(_)) || value.shares(),
            Statement::If(condition, then, otherwise) => {
                condition.shares() || then.iter().chain(otherwise).any(Statement::shares)
            }
            Statement::While(condition, body, _) => condition.shares() || body.iter().any(Statement::shares),
            Statement::Require(condition) => condition.shares(),
        }
    }
}

/// Run statements; `own` holds the parameters of the production and its own variables. False where one of them is not met
/// that was required.
///
/// # Errors
/// [`crate::Error::Limit`] where the budget does not last: each statement counts as a symbol.
pub fn run(program: &[Statement], own: &mut [f64], env: &mut Environment, budget: &mut Budget) -> Result<bool> {
    for statement in program {
        budget.spend(1)?;
        match statement {
            Statement::Assign(variable, value) => {
                let value = value.value(own, env);
                let target = match variable {
                    Variable::Own(i) => own.get_mut(*i),
                    Variable::Global(i) => env.globals.get_mut(*i),
                    Variable::Element(element) => {
                        let i = element.place(own, env);
                        env.globals.get_mut(i)
                    }
                };
                if let Some(target) = target {
                    *target = value;
                }
            }
            Statement::If(condition, then, otherwise) => {
                let holds = condition.value(own, env) != 0.0;
                if !run(if holds { then } else { otherwise }, own, env, budget)? {
                    return Ok(false);
                }
            }
            Statement::While(condition, body, first) => {
                let mut goes_on = *first || condition.value(own, env) != 0.0;
                while goes_on {
                    budget.spend(1)?;
                    if !run(body, own, env, budget)? {
                        return Ok(false);
                    }
                    goes_on = condition.value(own, env) != 0.0;
                }
            }
            Statement::Require(condition) => {
                if condition.value(own, env) == 0.0 {
                    return Ok(false);
                }
            }
        }
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::lsystem::expr::Binary;

    fn less(a: Expr, b: f64) -> Expr {
        Expr::Binary(Binary::Less, Box::new([a, Expr::Number(b)]))
    }

    fn plus(a: Expr, b: Expr) -> Expr {
        Expr::Binary(Binary::Add, Box::new([a, b]))
    }

    #[test]
    fn loops_sum_and_are_stopped() {
        // own[0] counts to 10, the variable 0 of the grammar sums it, an array of 2 × 2 keeps the sum in its last element.
        let count = Statement::Assign(Variable::Own(0), plus(Expr::Parameter(0), Expr::Number(1.0)));
        let sum = Statement::Assign(Variable::Global(0), plus(Expr::Global(0), Expr::Parameter(0)));
        let keep = Element { first: 1, indices: vec![(2, Expr::Number(7.0)), (2, Expr::Number(1.0))] };
        let program = [
            Statement::While(less(Expr::Parameter(0), 10.0), vec![count.clone(), sum], false),
            Statement::Assign(Variable::Element(keep), Expr::Global(0)),
            Statement::If(less(Expr::Global(0), 55.0), vec![], vec![count.clone()]),
            Statement::While(less(Expr::Parameter(0), 0.0), vec![count.clone()], true),
        ];
        let mut env = Environment::new(0, &[0.0; 5]);
        let mut own = [0.0];
        let mut budget = Budget::new(1000, 0);
        assert!(run(&program, &mut own, &mut env, &mut budget).unwrap());
        assert_eq!((own, env.globals), ([12.0], vec![55.0, 0.0, 0.0, 0.0, 55.0]));
        let endless = [Statement::While(Expr::Number(1.0), vec![], false)];
        let mut env = Environment::new(0, &[]);
        assert!(run(&endless, &mut [], &mut env, &mut Budget::new(1000, 0)).is_err());
    }

    #[test]
    fn what_is_required_ends_the_program() {
        let require = Statement::Require(less(Expr::Parameter(0), 1.0));
        let set = Statement::Assign(Variable::Own(0), Expr::Number(5.0));
        let program = [Statement::If(Expr::Number(1.0), vec![require, set], vec![])];
        for (start, met, end) in [(0.0, true, 5.0), (2.0, false, 2.0)] {
            let mut own = [start];
            let mut env = Environment::new(0, &[]);
            assert_eq!(run(&program, &mut own, &mut env, &mut Budget::new(1000, 0)).unwrap(), met);
            assert_eq!(own, [end]);
        }
    }
}
