//! Arithmetic in parameters, conditions and directives: `s*r + 1`, `t < 3 & s >= .1`, `ran(10)`.

use std::collections::BTreeMap;

use super::lexer::{Cursor, Fault, Parsed};
use crate::random::SplitMix64;

/// A number that may depend on a symbol's parameters. Truth is any number but 0. Angles are in degrees.
#[derive(Debug, Clone, PartialEq)]
pub enum Expr {
    Number(f64),
    /// Index into the parameters of the production, in the order they are named.
    Parameter(usize),
    Unary(Unary, Box<Expr>),
    Binary(Binary, Box<[Expr; 2]>),
    Call(Function, Vec<Expr>),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unary {
    Minus,
    Not,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Binary {
    Or,
    And,
    Equal,
    Unequal,
    Less,
    LessEqual,
    Greater,
    GreaterEqual,
    Add,
    Subtract,
    Multiply,
    Divide,
    Remainder,
    Power,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Function {
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Atan2,
    Sqrt,
    Exp,
    Log,
    Abs,
    Floor,
    Ceil,
    Sign,
    Min,
    Max,
    Pow,
    Ran,
    NormalRan,
}

/// Name, function, number of arguments.
const FUNCTIONS: [(&str, Function, usize); 19] = [
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

/// Operators by how tightly they bind, loosest first. Longer ones come before those that they begin with.
const LEVELS: [&[(&str, Binary)]; 5] = [
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

/// Largest number of operators, calls and parentheses per expression: it bounds the recursion of parsing and evaluation.
const MOST_TERMS: usize = 256;

/// Sine and cosine of an angle in degrees, exact at right angles.
pub fn sin_cos(degrees: f64) -> (f64, f64) {
    let turn = libm::fmod(degrees, 360.0);
    let quarter = turn / 90.0;
    if quarter == libm::round(quarter) {
        return [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][(quarter as i64).rem_euclid(4) as usize];
    }
    let a = turn.to_radians();
    (libm::sin(a), libm::cos(a))
}

impl Expr {
    pub fn value(&self, parameters: &[f64], rng: &mut SplitMix64) -> f64 {
        match self {
            Expr::Number(v) => *v,
            Expr::Parameter(i) => parameters.get(*i).copied().unwrap_or(0.0),
            Expr::Unary(Unary::Minus, a) => -a.value(parameters, rng),
            Expr::Unary(Unary::Not, a) => truth(a.value(parameters, rng) == 0.0),
            Expr::Binary(op, ab) => binary(*op, ab[0].value(parameters, rng), ab[1].value(parameters, rng)),
            Expr::Call(f, list) => {
                let a = list.first().map_or(0.0, |e| e.value(parameters, rng));
                let b = list.get(1).map_or(0.0, |e| e.value(parameters, rng));
                call(*f, a, b, rng)
            }
        }
    }

    /// Test whether its value depends on random numbers.
    pub fn random(&self) -> bool {
        match self {
            Expr::Number(_) | Expr::Parameter(_) => false,
            Expr::Unary(_, a) => a.random(),
            Expr::Binary(_, ab) => ab.iter().any(Expr::random),
            Expr::Call(f, list) => matches!(f, Function::Ran | Function::NormalRan) || list.iter().any(Expr::random),
        }
    }
}

fn truth(is: bool) -> f64 {
    f64::from(u8::from(is))
}

fn binary(op: Binary, a: f64, b: f64) -> f64 {
    match op {
        Binary::Or => truth(a != 0.0 || b != 0.0),
        Binary::And => truth(a != 0.0 && b != 0.0),
        Binary::Equal => truth(a == b),
        Binary::Unequal => truth(a != b),
        Binary::Less => truth(a < b),
        Binary::LessEqual => truth(a <= b),
        Binary::Greater => truth(a > b),
        Binary::GreaterEqual => truth(a >= b),
        Binary::Add => a + b,
        Binary::Subtract => a - b,
        Binary::Multiply => a * b,
        Binary::Divide => a / b,
        Binary::Remainder => libm::fmod(a, b),
        Binary::Power => libm::pow(a, b),
    }
}

fn call(f: Function, a: f64, b: f64, rng: &mut SplitMix64) -> f64 {
    match f {
        Function::Sin => sin_cos(a).0,
        Function::Cos => sin_cos(a).1,
        Function::Tan => sin_cos(a).0 / sin_cos(a).1,
        Function::Asin => libm::asin(a).to_degrees(),
        Function::Acos => libm::acos(a).to_degrees(),
        Function::Atan => libm::atan(a).to_degrees(),
        Function::Atan2 => libm::atan2(a, b).to_degrees(),
        Function::Sqrt => libm::sqrt(a),
        Function::Exp => libm::exp(a),
        Function::Log => libm::log(a),
        Function::Abs => a.abs(),
        Function::Floor => libm::floor(a),
        Function::Ceil => libm::ceil(a),
        Function::Sign => truth(a > 0.0) - truth(a < 0.0),
        Function::Min => a.min(b),
        Function::Max => a.max(b),
        Function::Pow => libm::pow(a, b),
        Function::Ran => a * rng.unit(),
        Function::NormalRan => a + b * rng.normal(),
    }
}

/// The names that an expression may use.
#[derive(Debug, Clone, Copy)]
pub struct Names<'a> {
    pub constants: &'a BTreeMap<String, f64>,
    /// Parameters of the production, in order.
    pub parameters: &'a [String],
}

/// Test whether `c` may begin a name; digits may follow.
pub fn begins_name(c: char) -> bool {
    c.is_alphabetic() || c == '_'
}

/// Parse the expression at the cursor; what follows it is left.
pub fn parse(cursor: &mut Cursor, names: &Names) -> Parsed<Expr> {
    Parser { cursor, names, terms: 0 }.level(0)
}

struct Parser<'c, 'a, 'n> {
    cursor: &'c mut Cursor<'a>,
    names: &'n Names<'n>,
    terms: usize,
}

impl Parser<'_, '_, '_> {
    fn count(&mut self) -> Result<(), Fault> {
        self.terms += 1;
        if self.terms > MOST_TERMS {
            return Err(self.cursor.place().fault(format!("the expression has more than {MOST_TERMS} terms")));
        }
        Ok(())
    }

    fn level(&mut self, level: usize) -> Parsed<Expr> {
        let Some(operators) = LEVELS.get(level) else { return self.power() };
        let mut left = self.level(level + 1)?;
        while let Some(op) = self.operator(operators) {
            self.count()?;
            left = Expr::Binary(op, Box::new([left, self.level(level + 1)?]));
        }
        Ok(left)
    }

    fn operator(&mut self, operators: &[(&str, Binary)]) -> Option<Binary> {
        self.cursor.skip_space();
        let (first, second) = (self.cursor.peek()?, self.cursor.second());
        let (name, op) = operators.iter().find(|(name, _)| {
            let mut c = name.chars();
            c.next() == Some(first) && c.next().is_none_or(|c| Some(c) == second)
        })?;
        for _ in name.chars() {
            self.cursor.next();
        }
        Some(*op)
    }

    /// `-a`, `!a`, `a^b`: powers bind tighter than a sign before them, and from the right.
    fn power(&mut self) -> Parsed<Expr> {
        self.count()?;
        if self.cursor.take('-') {
            return Ok(Expr::Unary(Unary::Minus, Box::new(self.power()?)));
        }
        if self.cursor.take('!') {
            return Ok(Expr::Unary(Unary::Not, Box::new(self.power()?)));
        }
        if self.cursor.take('+') {
            return self.power();
        }
        let base = self.atom()?;
        if self.cursor.take('^') {
            return Ok(Expr::Binary(Binary::Power, Box::new([base, self.power()?])));
        }
        Ok(base)
    }

    fn atom(&mut self) -> Parsed<Expr> {
        if self.cursor.take('(') {
            let inner = self.level(0)?;
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
        if let Some(i) = self.names.parameters.iter().position(|p| *p == name) {
            return Ok(Expr::Parameter(i));
        }
        if let Some(v) = self.names.constants.get(&name) {
            return Ok(Expr::Number(*v));
        }
        let Some((_, function, count)) = FUNCTIONS.iter().find(|f| f.0 == name) else {
            return Err(place.fault(format!("{name} is no parameter, #define or function")));
        };
        let mut list = Vec::new();
        if !self.cursor.take('(') {
            return Err(self.cursor.unexpected(&format!("'(' after {name}")));
        }
        loop {
            list.push(self.level(0)?);
            if self.cursor.take(')') {
                break;
            }
            if !self.cursor.take(',') {
                return Err(self.cursor.unexpected("',' or ')'"));
            }
        }
        if list.len() != *count {
            return Err(place.fault(format!("{name} takes {count} argument(s), not {}", list.len())));
        }
        Ok(Expr::Call(*function, list))
    }
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
    use crate::source::lsystem::lexer::{Char, characters};

    fn value(text: &str) -> Parsed<f64> {
        let constants = BTreeMap::from([("r1".to_owned(), 0.5)]);
        let parameters = ["s".to_owned(), "t".to_owned()];
        let chars = characters(text).unwrap();
        let mut cursor = Cursor::new(&chars, Char { c: ' ', line: 1, column: 0 });
        let expr = parse(&mut cursor, &Names { constants: &constants, parameters: &parameters })?;
        assert!(cursor.at_end(), "{text}");
        Ok(expr.value(&[3.0, 4.0], &mut SplitMix64::new(1)))
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
