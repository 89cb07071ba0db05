//! C-like statements of a cpfg file: `{ t = t - PL; if (t > 3) { n = n + 1; } while (…) { … } }`.

use std::collections::BTreeMap;

use crate::source::lsystem::expr_parser::{self, Array, Names, Syntax};
use crate::source::lsystem::lexer::{Char, Cursor, Parsed};
use crate::source::lsystem::program::{Statement, Variable};

/// Blocks within blocks.
const MAX_NESTED: usize = 64;
/// Elements of the arrays of a file.
const MAX_ELEMENTS: usize = 1 << 16;
/// Procedures that write or show something, and do nothing to the plant.
const IDLE: [&str; 6] = ["printf", "fprintf", "fflush", "fclose", "Display", "play"];

/// Names of the variables of a file, and their first values.
#[derive(Debug, Default)]
pub struct Variables {
    pub globals: BTreeMap<String, usize>,
    pub arrays: BTreeMap<String, Array>,
    pub values: Vec<f64>,
}

impl Variables {
    pub fn add(&mut self, name: String) -> usize {
        self.values.push(0.0);
        *self.globals.entry(name).or_insert(self.values.len() - 1)
    }

    /// The names that an expression may use, with those of a production.
    pub fn names<'a>(&'a self, constants: &'a BTreeMap<String, f64>, own: &'a [String]) -> Names<'a> {
        Names { syntax: Syntax::C, constants, parameters: own, globals: &self.globals, arrays: &self.arrays }
    }
}

/// Where variables that are assigned first come from.
pub enum Scope<'s> {
    /// The file.
    File,
    /// A production, whose parameters and variables these are.
    Production(&'s mut Vec<String>),
}

/// Reads statements.
pub struct Statements<'s> {
    pub variables: &'s mut Variables,
    pub constants: &'s BTreeMap<String, f64>,
    pub scope: Scope<'s>,
}

impl Statements<'_> {
    fn expression(&self, cursor: &mut Cursor) -> Parsed<crate::source::lsystem::expr::Expr> {
        let own: &[String] = match &self.scope {
            Scope::File => &[],
            Scope::Production(own) => own,
        };
        expr_parser::parse(cursor, &self.variables.names(self.constants, own))
    }

    /// `{ … }`.
    pub fn block(&mut self, cursor: &mut Cursor, depth: usize) -> Parsed<Vec<Statement>> {
        if depth > MAX_NESTED {
            return Err(cursor.place().fault(format!("more than {MAX_NESTED} blocks within each other")));
        }
        if !cursor.take('{') {
            return Err(cursor.unexpected("'{'"));
        }
        let mut out = Vec::new();
        while !cursor.take('}') {
            out.extend(self.statement(cursor, depth)?);
        }
        Ok(out)
    }

    fn condition(&self, cursor: &mut Cursor) -> Parsed<crate::source::lsystem::expr::Expr> {
        if !cursor.take('(') {
            return Err(cursor.unexpected("'(' and a condition"));
        }
        let condition = self.expression(cursor)?;
        if cursor.take(')') { Ok(condition) } else { Err(cursor.unexpected("')' or an operator")) }
    }

    fn statement(&mut self, cursor: &mut Cursor, depth: usize) -> Parsed<Option<Statement>> {
        cursor.skip_space();
        let place = cursor.place();
        if cursor.take(';') {
            return Ok(None);
        }
        if cursor.take_text("if") {
            let condition = self.condition(cursor)?;
            let then = self.block(cursor, depth + 1)?;
            let otherwise = if cursor.take_text("else") { self.block(cursor, depth + 1)? } else { Vec::new() };
            return Ok(Some(Statement::If(condition, then, otherwise)));
        }
        if cursor.take_text("while") {
            let condition = self.condition(cursor)?;
            return Ok(Some(Statement::While(condition, self.block(cursor, depth + 1)?, false)));
        }
        if cursor.take_text("do") {
            let body = self.block(cursor, depth + 1)?;
            if !cursor.take_text("while") {
                return Err(cursor.unexpected("'while'"));
            }
            let condition = self.condition(cursor)?;
            end(cursor)?;
            return Ok(Some(Statement::While(condition, body, true)));
        }
        let name = cursor.word(|c| expr_parser::begins_name(c) || c.is_ascii_digit());
        if !name.starts_with(expr_parser::begins_name) {
            return Err(cursor.unexpected("a statement or '}'"));
        }
        if IDLE.contains(&name.as_str()) {
            procedure(cursor, place)?;
            return Ok(None);
        }
        if cursor.peek() == Some('(') {
            return Err(place.fault(format!("the procedure {name} is not read")));
        }
        let variable = self.variable(cursor, name, place)?;
        if !cursor.take('=') {
            return Err(cursor.unexpected("'='"));
        }
        let value = self.expression(cursor)?;
        end(cursor)?;
        Ok(Some(Statement::Assign(variable, value)))
    }

    fn variable(&mut self, cursor: &mut Cursor, name: String, place: Char) -> Parsed<Variable> {
        if self.constants.contains_key(&name) {
            return Err(place.fault(format!("{name} is a #define and cannot be assigned to")));
        }
        if let Scope::Production(own) = &self.scope
            && let Some(i) = own.iter().rposition(|n| *n == name)
        {
            return Ok(Variable::Own(i));
        }
        if let Some(array) = self.variables.arrays.get(&name).cloned() {
            let own: &[String] = match &self.scope {
                Scope::File => &[],
                Scope::Production(own) => own,
            };
            let element = expr_parser::element(cursor, &self.variables.names(self.constants, own), &array)?;
            return Ok(Variable::Element(element));
        }
        if let Some(&i) = self.variables.globals.get(&name) {
            return Ok(Variable::Global(i));
        }
        match &mut self.scope {
            Scope::File => Ok(Variable::Global(self.variables.add(name))),
            Scope::Production(own) => {
                own.push(name);
                Ok(Variable::Own(own.len() - 1))
            }
        }
    }

    /// `{ array a[2][3] = {1, 2, …}, b[4]; … }`.
    pub fn arrays(&mut self, cursor: &mut Cursor) -> Parsed<()> {
        if !cursor.take('{') {
            return Err(cursor.unexpected("'{'"));
        }
        while !cursor.take('}') {
            cursor.skip_space();
            let place = cursor.place();
            if !cursor.take_text("array") {
                let word = cursor.word(char::is_alphanumeric);
                return Err(place.fault(format!("{word} where 'array' should be; nothing else is defined here")));
            }
            loop {
                self.array(cursor)?;
                if !cursor.take(',') {
                    break;
                }
            }
            end(cursor)?;
        }
        Ok(())
    }

    fn array(&mut self, cursor: &mut Cursor) -> Parsed<()> {
        cursor.skip_space();
        let place = cursor.place();
        let name = cursor.word(|c| expr_parser::begins_name(c) || c.is_ascii_digit());
        if !name.starts_with(expr_parser::begins_name) {
            return Err(cursor.unexpected("the name of an array"));
        }
        let first = self.variables.values.len();
        let (mut sizes, mut count) = (Vec::new(), 1usize);
        while cursor.take('[') {
            let at = cursor.place();
            let size = self.expression(cursor)?.constant().filter(|v| *v >= 1.0 && *v == v.floor());
            let size = size.map_or(0, |v| v as usize);
            count = count.saturating_mul(size);
            if size == 0 || first.saturating_add(count) > MAX_ELEMENTS {
                return Err(
                    at.fault(format!("a size is a whole number, and arrays have up to {MAX_ELEMENTS} elements"))
                );
            }
            sizes.push(size);
            if !cursor.take(']') {
                return Err(cursor.unexpected("']' or an operator"));
            }
        }
        if sizes.is_empty() {
            return Err(cursor.unexpected("'[' and the size of the array"));
        }
        let mut values = Vec::new();
        if cursor.take('=') {
            if !cursor.take('{') {
                return Err(cursor.unexpected("'{'"));
            }
            while !cursor.take('}') {
                let at = cursor.place();
                let value = self.expression(cursor)?.constant();
                values.push(value.ok_or_else(|| at.fault("the first values of an array are constants"))?);
                if !cursor.take(',') && cursor.peek() != Some('}') {
                    return Err(cursor.unexpected("',' or '}'"));
                }
            }
            if values.len() > count {
                return Err(place.fault(format!("{} values for {count} elements of {name}", values.len())));
            }
        }
        values.resize(count, 0.0);
        self.variables.values.extend(values);
        self.variables.arrays.insert(name, Array { first, sizes });
        Ok(())
    }
}

fn end(cursor: &mut Cursor) -> Parsed<()> {
    if cursor.take(';') { Ok(()) } else { Err(cursor.unexpected("';' or an operator")) }
}

/// Pass over the arguments of a procedure, whose texts may hold anything.
fn procedure(cursor: &mut Cursor, place: Char) -> Parsed<()> {
    let (mut depth, mut quoted) = (0, false);
    while let Some(c) = cursor.next() {
        match c.c {
            '\\' if quoted => {
                cursor.next();
            }
            '"' => quoted = !quoted,
            '(' if !quoted => depth += 1,
            ')' if !quoted => depth -= 1,
            ';' if !quoted && depth == 0 => return Ok(()),
            _ => {}
        }
    }
    Err(place.fault("a procedure that is called here never ends in ';'"))
}
