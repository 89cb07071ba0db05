//! Arithmetic in parameters, conditions and statements, as it is evaluated: `s*r + 1`, `t < 3 & s >= .1`, `ran(10)`.

use crate::random::SplitMix64;

/// A number that may depend on a symbol's parameters. Truth is any number but 0. Angles are in degrees.
#[derive(Debug, Clone, PartialEq)]
pub enum Expr {
    Number(f64),
    /// Index into the parameters of the production, in the order they are named; its own variables follow them.
    Parameter(usize),
    /// Index into the variables of the grammar.
    Global(usize),
    /// Element of an array of the grammar.
    Element(Element),
    Unary(Unary, Box<Expr>),
    Binary(Binary, Box<[Expr; 2]>),
    /// Where the first holds the second, else the third.
    Conditional(Box<[Expr; 3]>),
    Call(Function, Vec<Expr>),
}

/// An element of an array, whose rows follow each other in the variables of the grammar.
#[derive(Debug, Clone, PartialEq)]
pub struct Element {
    /// Place of the first element.
    pub first: usize,
    /// Size and index in each dimension; an index that is out of range is taken to the nearest that is not.
    pub indices: Vec<(usize, Expr)>,
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
    /// Quotient rounded down.
    FloorDivide,
    /// Remainder with the sign of the dividend.
    Remainder,
    /// Remainder with the sign of the divisor.
    Modulo,
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
    Degrees,
    Radians,
    Sqrt,
    Exp,
    Log,
    Log10,
    Abs,
    Floor,
    Ceil,
    Round,
    Truncate,
    Sign,
    Min,
    Max,
    Pow,
    Hypot,
    Ran,
    NormalRan,
    /// Uniform in [0, 1), whatever the argument.
    Seeded,
}

/// What evaluating needs and changes besides the parameters of a symbol.
#[derive(Debug)]
pub struct Environment {
    pub rng: SplitMix64,
    /// Variables of the grammar; arrays lie in them row by row.
    pub globals: Vec<f64>,
}

impl Environment {
    pub fn new(seed: u64, globals: &[f64]) -> Environment {
        Environment { rng: SplitMix64::new(seed), globals: globals.to_vec() }
    }
}

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
    pub fn value(&self, parameters: &[f64], env: &mut Environment) -> f64 {
        match self {
            Expr::Number(v) => *v,
            Expr::Parameter(i) => parameters.get(*i).copied().unwrap_or(0.0),
            Expr::Global(i) => env.globals.get(*i).copied().unwrap_or(0.0),
            Expr::Element(element) => {
                let i = element.place(parameters, env);
                env.globals.get(i).copied().unwrap_or(0.0)
            }
            Expr::Unary(Unary::Minus, a) => -a.value(parameters, env),
            Expr::Unary(Unary::Not, a) => truth(a.value(parameters, env) == 0.0),
            Expr::Binary(op, ab) => binary(*op, ab[0].value(parameters, env), ab[1].value(parameters, env)),
            Expr::Conditional(abc) => {
                let holds = abc[0].value(parameters, env) != 0.0;
                abc[if holds { 1 } else { 2 }].value(parameters, env)
            }
            Expr::Call(f, list) => {
                let a = list.first().map_or(0.0, |e| e.value(parameters, env));
                let b = list.get(1).map_or(0.0, |e| e.value(parameters, env));
                call(*f, a, b, &mut env.rng)
            }
        }
    }

    /// Its value where it depends on nothing.
    pub fn constant(&self) -> Option<f64> {
        (!self.any(&|e| matches!(e, Expr::Parameter(_) | Expr::Global(_) | Expr::Element(_)) || e.draws()))
            .then(|| self.value(&[], &mut Environment::new(0, &[])))
    }

    /// Test whether its value depends on random numbers.
    pub fn random(&self) -> bool {
        self.any(&Expr::draws)
    }

    fn draws(&self) -> bool {
        matches!(self, Expr::Call(Function::Ran | Function::NormalRan | Function::Seeded, _))
    }

    /// Test whether its value depends on variables of the grammar.
    pub fn shares(&self) -> bool {
        self.any(&|e| matches!(e, Expr::Global(_) | Expr::Element(_)))
    }

    /// Number of its terms.
    pub fn size(&self) -> usize {
        1 + match self {
            Expr::Number(_) | Expr::Parameter(_) | Expr::Global(_) => 0,
            Expr::Element(element) => element.indices.iter().map(|(_, e)| e.size()).sum(),
            Expr::Unary(_, a) => a.size(),
            Expr::Binary(_, ab) => ab.iter().map(Expr::size).sum(),
            Expr::Conditional(abc) => abc.iter().map(Expr::size).sum(),
            Expr::Call(_, list) => list.iter().map(Expr::size).sum(),
        }
    }

    /// Test whether `is` holds for it or for any of its parts.
    fn any(&self, is: &impl Fn(&Expr) -> bool) -> bool {
        is(self)
            || match self {
                Expr::Number(_) | Expr::Parameter(_) | Expr::Global(_) => false,
                Expr::Element(element) => element.indices.iter().any(|(_, e)| e.any(is)),
                Expr::Unary(_, a) => a.any(is),
                Expr::Binary(_, ab) => ab.iter().any(|e| e.any(is)),
                Expr::Conditional(abc) => abc.iter().any(|e| e.any(is)),
                Expr::Call(_, list) => list.iter().any(|e| e.any(is)),
            }
    }
}

impl Element {
    /// Index into the variables of the grammar.
    pub fn place(&self, parameters: &[f64], env: &mut Environment) -> usize {
        let row = self.indices.iter().fold(0, |row, (size, index)| {
            // A cast takes what is no number to 0.
            let i = (index.value(parameters, env).max(0.0) as usize).min(size.saturating_sub(1));
            row * size + i
        });
        self.first + row
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
        Binary::FloorDivide => libm::floor(a / b),
        Binary::Remainder => libm::fmod(a, b),
        Binary::Modulo => a - b * libm::floor(a / b),
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
        Function::Degrees => a.to_degrees(),
        Function::Radians => a.to_radians(),
        Function::Sqrt => libm::sqrt(a),
        Function::Exp => libm::exp(a),
        Function::Log => libm::log(a),
        Function::Log10 => libm::log10(a),
        Function::Abs => a.abs(),
        Function::Floor => libm::floor(a),
        Function::Ceil => libm::ceil(a),
        // Halves go to the even neighbour, as Python has it.
        Function::Round => libm::rint(a),
        Function::Truncate => libm::trunc(a),
        Function::Sign => truth(a > 0.0) - truth(a < 0.0),
        Function::Min => a.min(b),
        Function::Max => a.max(b),
        Function::Pow => libm::pow(a, b),
        Function::Hypot => libm::hypot(a, b),
        Function::Ran => a * rng.unit(),
        Function::NormalRan => a + b * rng.normal(),
        Function::Seeded => rng.unit(),
    }
}
