//! Expressions as the notations write them → [`Expr`].

use std::collections::BTreeMap;

use super::expr::{Binary, Element, Expr, Function, Unary};
use super::lexer::{Cursor, Fault, Parsed};

/// The notation that an expression is written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Syntax {
    /// As in *The Algorithmic Beauty of Plants*: `a = b & !c`, `a^b`, angles in degrees.
    Book,
    /// As in cpfg and Houdini: `a == b && !c`, `a ? b : c`, `a^b`, angles in degrees.
    C,
    /// As in Python: `a == b and not c`, `b if a else c`, `a**b`, angles in radians.
    Python,
}

type Functions = &'static [(&'static str, Function, usize)];
type Levels = &'static [&'static [(&'static str, Binary)]];

/// Name, function, number of arguments.
const FUNCTIONS: Functions = &[
    ("sin", Function::Sin, 1),
    ("cos", Function::Cos, 1),
    ("tan", Function::Tan, 1),
    ("asin", Function::Asin, 1),
    ("acos", Function::Acos, 1),
    ("atan", Function::Atan, 1),
    ("atan2", Function::Atan2, 2),
    ("sqrt", Function::Sqrt, 1),
    ("exp", Function::Exp, 1),
    ("log", Function::Log, 1),
    ("abs", Function::Abs, 1),
    ("floor", Function::Floor, 1),
    ("ceil", Function::Ceil, 1),
    ("sign", Function::Sign, 1),
    ("min", Function::Min, 2),
    ("max", Function::Max, 2),
    ("pow", Function::Pow, 2),
    ("ran", Function::Ran, 1),
    ("nran", Function::NormalRan, 2),
];

/// Those of cpfg and of Houdini besides.
const C_FUNCTIONS: Functions = &[
    ("fabs", Function::Abs, 1),
    ("trunc", Function::Truncate, 1),
    ("int", Function::Truncate, 1),
    ("rand", Function::Seeded, 1),
];

/// Those of Python and of its `math`.
const PYTHON_FUNCTIONS: Functions = &[
    ("sin", Function::Sin, 1),
    ("cos", Function::Cos, 1),
    ("tan", Function::Tan, 1),
    ("asin", Function::Asin, 1),
    ("acos", Function::Acos, 1),
    ("atan", Function::Atan, 1),
    ("atan2", Function::Atan2, 2),
    ("degrees", Function::Degrees, 1),
    ("radians", Function::Radians, 1),
    ("sqrt", Function::Sqrt, 1),
    ("exp", Function::Exp, 1),
    ("log", Function::Log, 1),
    ("log10", Function::Log10, 1),
    ("abs", Function::Abs, 1),
    ("fabs", Function::Abs, 1),
    ("floor", Function::Floor, 1),
    ("ceil", Function::Ceil, 1),
    ("round", Function::Round, 1),
    ("int", Function::Truncate, 1),
    ("trunc", Function::Truncate, 1),
    ("min", Function::Min, 2),
    ("max", Function::Max, 2),
    ("pow", Function::Pow, 2),
    ("hypot", Function::Hypot, 2),
];

/// Operators by how tightly they bind, loosest first. Longer ones come before those that they begin with.
const BOOK_LEVELS: Levels = &[
    &[("||", Binary::Or), ("|", Binary::Or)],
    &[("&&", Binary::And), ("&", Binary::And)],
    &[
        ("==", Binary::Equal),
        ("=", Binary::Equal),
        ("!=", Binary::Unequal),
        ("<=", Binary::LessEqual),
        (">=", Binary::GreaterEqual),
        ("<", Binary::Less),
        (">", Binary::Greater),
    ],
    &[("+", Binary::Add), ("-", Binary::Subtract)],
    &[("*", Binary::Multiply), ("/", Binary::Divide), ("%", Binary::Remainder)],
];

const C_LEVELS: Levels = &[
    &[("||", Binary::Or), ("|", Binary::Or)],
    &[("&&", Binary::And), ("&", Binary::And)],
    &[("==", Binary::Equal), ("!=", Binary::Unequal)],
    &[
        ("<=", Binary::LessEqual),
        (">=", Binary::GreaterEqual),
        ("<>", Binary::Unequal),
        ("<", Binary::Less),
        (">", Binary::Greater),
    ],
    &[("+", Binary::Add), ("-", Binary::Subtract)],
    &[("*", Binary::Multiply), ("/", Binary::Divide), ("%", Binary::Remainder)],
    &[("^", Binary::Power)],
];

const PYTHON_LEVELS: Levels = &[
    &[("or", Binary::Or)],
    &[("and", Binary::And)],
    // Of comparisons, `not` and chains as well.
    &[
        ("==", Binary::Equal),
        ("!=", Binary::Unequal),
        ("<=", Binary::LessEqual),
        (">=", Binary::GreaterEqual),
        ("<", Binary::Less),
        (">", Binary::Greater),
    ],
    &[("+", Binary::Add), ("-", Binary::Subtract)],
    &[("*", Binary::Multiply), ("//", Binary::FloorDivide), ("/", Binary::Divide), ("%", Binary::Modulo)],
];

/// Level of comparisons in each of the tables.
const COMPARISONS: usize = 2;

/// Largest number of operators, calls and parentheses per expression: it bounds the recursion of parsing and evaluation.
const MAX_TERMS: usize = 256;

/// Largest number of terms between two comparisons of a chain: they are evaluated twice, and so are chains within chains.
const MAX_CHAINED: usize = 8;

/// An array of a grammar.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    /// Place of its first element among the variables of the grammar.
    pub first: usize,
    /// Size in each dimension.
    pub sizes: Vec<usize>,
}

/// The names that an expression may use, and the notation that it is written in.
#[derive(Debug, Clone, Copy)]
pub struct Names<'a> {
    pub syntax: Syntax,
    pub constants: &'a BTreeMap<String, f64>,
    /// Parameters of the production, and its own variables after them, in order.
    pub parameters: &'a [String],
    /// Variables of the grammar, by their places.
    pub globals: &'a BTreeMap<String, usize>,
    pub arrays: &'a BTreeMap<String, Array>,
}

static NO_GLOBALS: BTreeMap<String, usize> = BTreeMap::new();
static NO_ARRAYS: BTreeMap<String, Array> = BTreeMap::new();

impl<'a> Names<'a> {
    /// Without variables.
    pub fn new(syntax: Syntax, constants: &'a BTreeMap<String, f64>, parameters: &'a [String]) -> Names<'a> {
        Names { syntax, constants, parameters, globals: &NO_GLOBALS, arrays: &NO_ARRAYS }
    }
}

/// Test whether `c` may begin a name; digits may follow.
pub fn begins_name(c: char) -> bool {
    c.is_alphabetic() || c == '_'
}

/// Parse the expression at the cursor; what follows it is left.
pub fn parse(cursor: &mut Cursor, names: &Names) -> Parsed<Expr> {
    Parser { cursor, names, terms: 0 }.whole()
}

struct Parser<'c, 'a, 'n> {
    cursor: &'c mut Cursor<'a>,
    names: &'n Names<'n>,
    terms: usize,
}

impl Parser<'_, '_, '_> {
    fn count(&mut self) -> Result<(), Fault> {
        self.terms += 1;
        if self.terms > MAX_TERMS {
            return Err(self.cursor.place().fault(format!("the expression has more than {MAX_TERMS} terms")));
        }
        Ok(())
    }

    fn levels(&self) -> Levels {
        match self.names.syntax {
            Syntax::Book => BOOK_LEVELS,
            Syntax::C => C_LEVELS,
            Syntax::Python => PYTHON_LEVELS,
        }
    }

    /// With the conditional that binds loosest of all: `a ? b : c`, `b if a else c`.
    fn whole(&mut self) -> Parsed<Expr> {
        self.count()?;
        let first = self.level(0)?;
        match self.names.syntax {
            Syntax::C if self.cursor.take('?') => {
                let second = self.whole()?;
                if !self.cursor.take(':') {
                    return Err(self.cursor.unexpected("':' of the conditional"));
                }
                Ok(Expr::Conditional(Box::new([first, second, self.whole()?])))
            }
            Syntax::Python if self.cursor.take_text("if") => {
                let condition = self.level(0)?;
                if !self.cursor.take_text("else") {
                    return Err(self.cursor.unexpected("'else' of the conditional"));
                }
                Ok(Expr::Conditional(Box::new([condition, first, self.whole()?])))
            }
            _ => Ok(first),
        }
    }

    fn level(&mut self, level: usize) -> Parsed<Expr> {
        let Some(operators) = self.levels().get(level) else { return self.power() };
        let python = self.names.syntax == Syntax::Python && level == COMPARISONS;
        if python && self.cursor.take_text("not") {
            self.count()?;
            return Ok(Expr::Unary(Unary::Not, Box::new(self.level(level)?)));
        }
        let mut left = self.level(level + 1)?;
        // The last operand of a comparison in Python: 0 < a < 1 is 0 < a and a < 1.
        let mut middle: Option<Expr> = None;
        while let Some(op) = self.operator(operators) {
            self.count()?;
            let place = self.cursor.place();
            let right = self.level(level + 1)?;
            let small = python && right.size() <= MAX_CHAINED;
            let next = small.then(|| right.clone());
            left = match middle.take() {
                Some(middle) => {
                    let more = Expr::Binary(op, Box::new([middle, right]));
                    Expr::Binary(Binary::And, Box::new([left, more]))
                }
                None => Expr::Binary(op, Box::new([left, right])),
            };
            if python && !small && operators.iter().any(|(name, _)| self.cursor.begins(name)) {
                return Err(place.fault("what stands between two comparisons is too long; write them with 'and'"));
            }
            middle = next;
        }
        Ok(left)
    }

    fn operator(&mut self, operators: &[(&str, Binary)]) -> Option<Binary> {
        self.cursor.skip_space();
        // Python's power is no product, and what follows it binds tighter.
        if self.names.syntax == Syntax::Python && self.cursor.begins("**") {
            return None;
        }
        let (name, op) = operators.iter().find(|(name, _)| self.cursor.begins(name))?;
        self.cursor.take_text(name);
        Some(*op)
    }

    /// `-a`, `!a`, `a^b`. In the book's notation and in Python powers bind tighter than a sign before them, and from the
    /// right; in C's a sign binds tightest, and powers are a level of operators.
    fn power(&mut self) -> Parsed<Expr> {
        self.count()?;
        if self.cursor.take('-') {
            return Ok(Expr::Unary(Unary::Minus, Box::new(self.power()?)));
        }
        if self.names.syntax != Syntax::Python && self.cursor.take('!') {
            return Ok(Expr::Unary(Unary::Not, Box::new(self.power()?)));
        }
        if self.cursor.take('+') {
            return self.power();
        }
        let base = self.atom()?;
        let sign = if self.names.syntax == Syntax::Python { "**" } else { "^" };
        if self.names.syntax != Syntax::C && self.cursor.take_text(sign) {
            return Ok(Expr::Binary(Binary::Power, Box::new([base, self.power()?])));
        }
        Ok(base)
    }

    fn atom(&mut self) -> Parsed<Expr> {
        if self.cursor.take('(') {
            let inner = self.whole()?;
            return if self.cursor.take(')') { Ok(inner) } else { Err(self.cursor.unexpected("')' or an operator")) };
        }
        match self.cursor.peek() {
            Some(c) if c.is_ascii_digit() || c == '.' => number(self.cursor).map(Expr::Number),
            Some(c) if begins_name(c) => self.name(),
            _ => Err(self.cursor.unexpected("a number, a name or '('")),
        }
    }

    fn name(&mut self) -> Parsed<Expr> {
        let place = self.cursor.place();
        let name = self.cursor.word(|c| begins_name(c) || c.is_numeric());
        // The last of a name is the production's own variable, which may hide a parameter.
        if let Some(i) = self.names.parameters.iter().rposition(|p| *p == name) {
            return Ok(Expr::Parameter(i));
        }
        if let Some(v) = self.names.constants.get(&name) {
            return Ok(Expr::Number(*v));
        }
        if let Some(array) = self.names.arrays.get(&name) {
            return element(self.cursor, self.names, array).map(Expr::Element);
        }
        if let Some(i) = self.names.globals.get(&name) {
            return Ok(Expr::Global(*i));
        }
        if self.names.syntax == Syntax::Python
            && let Some((_, value)) =
                [("True", 1.0), ("False", 0.0), ("pi", std::f64::consts::PI)].into_iter().find(|(n, _)| *n == name)
        {
            return Ok(Expr::Number(value));
        }
        let Some((function, count)) = self.function(&name) else {
            return Err(place.fault(format!("{name} is no parameter, {} or function", self.constant_word())));
        };
        let mut list = Vec::new();
        if !self.cursor.take('(') {
            return Err(self.cursor.unexpected(&format!("'(' after {name}")));
        }
        loop {
            list.push(self.whole()?);
            if self.cursor.take(')') {
                break;
            }
            if !self.cursor.take(',') {
                return Err(self.cursor.unexpected("',' or ')'"));
            }
        }
        // min and max of several.
        while self.names.syntax == Syntax::Python && count == 2 && list.len() > 2 {
            let rest = list.split_off(list.len() - 2);
            list.push(Expr::Call(function, rest));
        }
        if list.len() != count {
            return Err(place.fault(format!("{name} takes {count} argument(s), not {}", list.len())));
        }
        Ok(self.converted(function, list))
    }

    fn constant_word(&self) -> &'static str {
        match self.names.syntax {
            Syntax::Book => "#define",
            Syntax::C => "#define, variable",
            Syntax::Python => "constant",
        }
    }

    fn function(&self, name: &str) -> Option<(Function, usize)> {
        let (tables, more): (Functions, Functions) = match self.names.syntax {
            Syntax::Book => (FUNCTIONS, &[]),
            Syntax::C => (FUNCTIONS, C_FUNCTIONS),
            Syntax::Python => (PYTHON_FUNCTIONS, &[]),
        };
        tables.iter().chain(more).find(|f| f.0 == name).map(|f| (f.1, f.2))
    }

    /// Angles of Python's functions are in radians.
    fn converted(&self, function: Function, mut list: Vec<Expr>) -> Expr {
        if self.names.syntax != Syntax::Python {
            return Expr::Call(function, list);
        }
        match function {
            Function::Sin | Function::Cos | Function::Tan => {
                list = vec![Expr::Call(Function::Degrees, list)];
                Expr::Call(function, list)
            }
            Function::Asin | Function::Acos | Function::Atan | Function::Atan2 => {
                Expr::Call(Function::Radians, vec![Expr::Call(function, list)])
            }
            _ => Expr::Call(function, list),
        }
    }
}

/// `[i][j]` after the name of an array.
pub fn element(cursor: &mut Cursor, names: &Names, array: &Array) -> Parsed<Element> {
    let mut indices = Vec::with_capacity(array.sizes.len());
    for size in &array.sizes {
        if !cursor.take('[') {
            return Err(cursor.unexpected(&format!("'[' and one of {} indices", array.sizes.len())));
        }
        indices.push((*size, parse(cursor, names)?));
        if !cursor.take(']') {
            return Err(cursor.unexpected("']' or an operator"));
        }
    }
    Ok(Element { first: array.first, indices })
}

/// A decimal number without a sign.
pub fn number(cursor: &mut Cursor) -> Parsed<f64> {
    let place = cursor.place();
    let mut text = cursor.word(|c| c.is_ascii_digit() || c == '.');
    if matches!(cursor.peek(), Some('e' | 'E')) {
        let mut ahead = cursor.clone();
        ahead.next();
        let mut exponent = String::from("e");
        if let Some(sign) = ahead.peek().filter(|c| matches!(c, '+' | '-')) {
            exponent.push(sign);
            ahead.next();
        }
        let digits = ahead.word(|c| c.is_ascii_digit());
        if !digits.is_empty() {
            text = text + &exponent + &digits;
            *cursor = ahead;
        }
    }
    match text.parse::<f64>() {
        Ok(v) if v.is_finite() => Ok(v),
        _ => Err(place.fault(format!("{text} is not a number that can be used"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::SplitMix64;
    use crate::source::lsystem::expr::Environment;
    use crate::source::lsystem::lexer::{Char, characters};

    fn value(text: &str) -> Parsed<f64> {
        value_in(Syntax::Book, text)
    }

    fn value_in(syntax: Syntax, text: &str) -> Parsed<f64> {
        let constants = BTreeMap::from([("r1".to_owned(), 0.5)]);
        let parameters = ["s".to_owned(), "t".to_owned()];
        let chars = characters(text).unwrap();
        let mut cursor = Cursor::new(&chars, Char { c: ' ', line: 1, column: 0 });
        let expr = parse(&mut cursor, &Names::new(syntax, &constants, &parameters))?;
        assert!(cursor.at_end(), "{text}");
        Ok(expr.value(&[3.0, 4.0], &mut Environment::new(1, &[])))
    }

    #[test]
    fn operators_bind_as_usual() {
        for (text, want) in [
            ("1+2*3", 7.0),
            ("(1+2)*3", 9.0),
            ("-2^2", -4.0),
            ("2^3^2", 512.0),
            ("7 - 2 - 1", 4.0),
            ("7 % 4", 3.0),
            ("s*r1 + t", 5.5),
            ("s < t & t = 4", 1.0),
            ("s >= t || !(t != 4)", 1.0),
            ("1.5e2 + .5", 150.5),
            ("2*-3", -6.0),
            ("max(s, t) + min(s, t)", 7.0),
            ("sin(90) + cos(180) + sin(30)", 0.5),
            ("atan2(1, 0)", 90.0),
            ("floor(-.5) + ceil(.5) + sign(-2) + abs(-4)", 3.0),
            ("ran(0)", 0.0),
        ] {
            assert!((value(text).unwrap() - want).abs() < 1e-12, "{text}");
        }
    }

    #[test]
    fn notations_differ() {
        for (syntax, text, want) in [
            // A sign binds tighter than C's power, which goes from the left.
            (Syntax::C, "-2^2", 4.0),
            (Syntax::C, "2^3^2", 64.0),
            (Syntax::C, "s<4 && t<>3 ? trunc(-1.5) : fabs(-7)", -1.0),
            (Syntax::C, "1 < 2 == 1", 1.0),
            (Syntax::Python, "-2**2", -4.0),
            (Syntax::Python, "2**3**2", 512.0),
            (Syntax::Python, "2 * 3**2 * 2", 36.0),
            (Syntax::Python, "not s == 3 or t >= 4 and 0 < s < 4", 1.0),
            (Syntax::Python, "5 < 4 < 3", 0.0),
            (Syntax::Python, "-7 // 2 + -7 % 3", -2.0),
            (Syntax::Python, "10 if s > t else 20", 20.0),
            (Syntax::Python, "sin(pi/2) + atan(1)*4 - pi + min(3, 1, 2) + True", 3.0),
            (Syntax::Python, "round(2.5) + round(3.5) + int(-2.7)", 4.0),
        ] {
            assert!((value_in(syntax, text).unwrap() - want).abs() < 1e-12, "{text}");
        }
        for (syntax, text) in
            [(Syntax::C, "s = 3"), (Syntax::Python, "s & t"), (Syntax::Python, "!s"), (Syntax::Python, "random()")]
        {
            let constants = BTreeMap::new();
            let chars = characters(text).unwrap();
            let mut cursor = Cursor::new(&chars, Char { c: ' ', line: 1, column: 0 });
            let parameters = ["s".to_owned(), "t".to_owned()];
            let parsed = parse(&mut cursor, &Names::new(syntax, &constants, &parameters));
            assert!(parsed.is_err() || !cursor.at_end(), "{text}");
        }
    }

    #[test]
    fn faults_point_at_the_character() {
        for (text, column, what) in [
            ("1+", 3, "the end"),
            ("1+*2", 3, "'*'"),
            ("(1", 3, "')'"),
            ("x+1", 1, "x is no parameter"),
            ("sin 3", 5, "'('"),
            ("1+max(1)", 3, "takes 2"),
            ("1.2.3", 1, "1.2.3"),
            ("1e999", 1, "1e999"),
        ] {
            let fault = value(text).unwrap_err();
            assert!(fault.column == column && fault.what.contains(what), "{text}: {fault:?}");
        }
        assert!(value(&"(".repeat(100_000)).unwrap_err().what.contains("more than"));
        assert!(value(&"-".repeat(100_000)).unwrap_err().what.contains("more than"));
        assert!(value(&"1+".repeat(100_000)).unwrap_err().what.contains("more than"));
    }

    #[test]
    fn lots_are_fair() {
        let mut rng = SplitMix64::new(7);
        let n = 10_000;
        let mean = (0..n).map(|_| rng.unit()).sum::<f64>() / f64::from(n);
        // Deviation of the mean: 1 / sqrt(12 n) = .0029.
        assert!((mean - 0.5).abs() < 0.012);
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..n {
            let v = rng.normal();
            (sum, squares) = (sum + v, squares + v * v);
        }
        // Deviations .01 and .014.
        assert!((sum / f64::from(n)).abs() < 0.04 && (squares / f64::from(n) - 1.0).abs() < 0.06);
    }
}
