//! Houdini's L-System node as a text: its premise, its rules and its values, `key = value` on a line each.
//!
//! Based on: Side Effects Software, *Houdini documentation*, geometry node L-System.

use std::collections::BTreeMap;

use super::symbols::{Symbols, modules, predecessor};
use crate::geom::DVec3;
use crate::source::lsystem::alphabet::{
    Action, Alphabet, Fallback, Forward, Given, Ratio, RatioChange, WidthChange, WidthParameter, common,
};
use crate::source::lsystem::expr::{Binary, Environment, Expr, Function};
use crate::source::lsystem::expr_parser::{self, Names, Syntax};
use crate::source::lsystem::grammar::{Considered, Grammar, Module, Production, Surface};
use crate::source::lsystem::lexer::{Char, Comments, Cursor, Parsed, characters_but};

/// Signs that are symbols, besides letters. Not of Houdini's are `:`, `<`, `>`, `=`, `,` and parentheses.
const SIGNS: &str = "+-&^\\/|*~\"!;_?@'#%$[]{}.";
/// Values of the node, as its labels and its parameters are called without blanks; several are the same one.
const KEYS: [(&str, Key); 31] = [
    ("premise", Key::Premise),
    ("axiom", Key::Premise),
    ("rule", Key::Rule),
    ("contextignore", Key::Ignore),
    ("generations", Key::Generations),
    ("angle", Key::Angle),
    ("angleinit", Key::Angle),
    ("anglescale", Key::AngleScale),
    ("stepsize", Key::Step),
    ("stepinit", Key::Step),
    ("stepsizescale", Key::StepScale),
    ("stepscale", Key::StepScale),
    ("thickness", Key::Thickness),
    ("thickinit", Key::Thickness),
    ("thicknessscale", Key::ThicknessScale),
    ("thickscale", Key::ThicknessScale),
    ("gravity", Key::Gravity),
    ("randomseed", Key::Seed),
    ("randseed", Key::Seed),
    ("b", Key::Value("b")),
    ("varb", Key::Value("b")),
    ("variableb", Key::Value("b")),
    ("c", Key::Value("c")),
    ("varc", Key::Value("c")),
    ("variablec", Key::Value("c")),
    ("d", Key::Value("d")),
    ("vard", Key::Value("d")),
    ("variabled", Key::Value("d")),
    ("leafj", Key::Leaf('J')),
    ("leafk", Key::Leaf('K')),
    ("leafm", Key::Leaf('M')),
];

#[derive(Debug, Clone, Copy)]
enum Key {
    Premise,
    Rule,
    Ignore,
    Generations,
    Angle,
    AngleScale,
    Step,
    StepScale,
    Thickness,
    ThicknessScale,
    Gravity,
    Seed,
    Value(&'static str),
    Leaf(char),
}

/// Values that symbols without a parameter take; without one such a symbol is refused.
#[derive(Debug, Default)]
struct Scales {
    step: Option<f64>,
    thickness: Option<f64>,
    angle: Option<f64>,
    gravity: Option<f64>,
}

struct Reader<'a> {
    grammar: Grammar,
    symbols: Symbols,
    scales: Scales,
    define: &'a BTreeMap<String, f64>,
}

/// Read a text. `define`: values in place of its own b, c and d.
pub fn grammar(text: &str, define: &BTreeMap<String, f64>) -> Parsed<Grammar> {
    let chars = characters_but(text, Comments::Block)?;
    let is_symbol = |c: char| c.is_alphabetic() || SIGNS.contains(c);
    let mut reader = Reader {
        grammar: Grammar { context_first: false, tropism: DVec3::NEG_Y, ..Grammar::default() },
        symbols: Symbols::new(is_symbol),
        scales: Scales::default(),
        define,
    };
    let (mut texts, mut end) = (Vec::new(), Char { c: ' ', line: 1, column: 1 });
    for line in chars.split(|c| c.c == '\n') {
        end = line.last().copied().unwrap_or(end);
        let mut cursor = Cursor::new(line, end);
        // A # before a space begins a comment, and else is a symbol.
        if cursor.at_end() || cursor.begins("//") || (cursor.begins("#") && cursor.second() == Some(' ')) {
            continue;
        }
        match key(&mut cursor) {
            Some(key @ (Key::Premise | Key::Rule)) => texts.push((key, cursor.rest(), end)),
            None => texts.push((Key::Rule, cursor.rest(), end)),
            Some(key) => {
                reader.value(key, &mut cursor)?;
                if !cursor.at_end() {
                    return Err(cursor.unexpected("the end of the line"));
                }
            }
        }
    }
    // Rules may stand before the values that they use.
    let mut axiom = None;
    for (key, chars, end) in texts {
        match key {
            Key::Premise => axiom = Some(reader.string(&mut Cursor::new(chars, end), &[])?),
            _ => reader.rule(chars, end)?,
        }
    }
    reader.grammar.axiom = axiom.ok_or_else(|| end.fault("there is no premise; write one as premise = A"))?;
    reader.grammar.actions = reader.alphabet();
    Ok(reader.grammar)
}

/// The key that a line begins with, and what follows it: `Step Size = .1`, `rule2: A=FB`. None at a rule alone.
fn key(cursor: &mut Cursor) -> Option<Key> {
    let mut ahead = cursor.clone();
    ahead.skip_space();
    let label = ahead.word(|c| c.is_alphanumeric() || c == ' ' || c == '_');
    if !(ahead.take('=') || ahead.take(':')) {
        return None;
    }
    let label: String = label.to_lowercase().chars().filter(char::is_ascii_alphabetic).collect();
    let (_, key) = KEYS.into_iter().find(|(name, _)| *name == label)?;
    // A rule of the symbol b is no value: values are numbers.
    let mut number = ahead.clone();
    number.skip_space();
    if matches!(key, Key::Value(_)) && !number.peek().is_some_and(|c| c.is_ascii_digit() || c == '.' || c == '-') {
        return None;
    }
    ahead.skip_space();
    *cursor = ahead;
    Some(key)
}

impl Reader<'_> {
    fn value(&mut self, key: Key, cursor: &mut Cursor) -> Parsed<()> {
        let place = cursor.place();
        if let Key::Leaf(symbol) = key {
            let file = cursor.word(|_| true);
            let file = file.trim().trim_matches('"').to_owned();
            self.grammar.surfaces.insert(symbol, Surface::Mesh { file, line: place.line, column: place.column });
            return Ok(());
        }
        if matches!(key, Key::Ignore) {
            let mut ignored = std::collections::BTreeSet::new();
            while let Some((symbol, _)) = self.symbols.take(cursor) {
                ignored.insert(symbol);
            }
            self.grammar.considered = Considered::AllBut(ignored);
            return Ok(());
        }
        let names = Names::new(Syntax::C, &self.grammar.constants, &[]);
        let value = expr_parser::parse(cursor, &names)?.value(&[], &mut Environment::new(0, &[]));
        let whole = || match value == value.floor() && (0.0..=1e15).contains(&value) {
            true => Ok(value as u64),
            false => Err(place.fault(format!("{value} is not a whole number from 0 to 1e15"))),
        };
        if !value.is_finite() {
            return Err(place.fault("this is not a finite number"));
        }
        match key {
            Key::Generations => self.grammar.iterations = Some(whole()?),
            Key::Seed => self.grammar.seed = whole()?,
            Key::Angle => self.grammar.angle = value,
            Key::AngleScale => self.scales.angle = Some(value),
            Key::Step => self.grammar.step = value,
            Key::StepScale => self.scales.step = Some(value),
            Key::Thickness if value >= 0.0 => self.grammar.width = Some(value),
            Key::Thickness => return Err(place.fault("the thickness is not negative")),
            Key::ThicknessScale => self.scales.thickness = Some(value),
            Key::Gravity => self.scales.gravity = Some(value),
            Key::Value(name) => {
                let value = self.define.get(name).copied().unwrap_or(value);
                self.grammar.constants.insert(name.to_owned(), value);
            }
            Key::Premise | Key::Rule | Key::Ignore | Key::Leaf(_) => {}
        }
        Ok(())
    }

    /// Symbols to what is none; the value that a symbol without a parameter takes has to be there.
    fn string(&self, cursor: &mut Cursor, parameters: &[String]) -> Parsed<Vec<Module>> {
        let mut out = Vec::new();
        let names = Names::new(Syntax::C, &self.grammar.constants, parameters);
        let start = cursor.place();
        for module in modules(cursor, &self.symbols, &names)? {
            let needs = match module.symbol {
                '"' | '_' if self.scales.step.is_none() => "step size scale",
                '!' | '?' if self.scales.thickness.is_none() => "thickness scale",
                ';' | '@' if self.scales.angle.is_none() => "angle scale",
                'T' if self.scales.gravity.is_none() => "gravity",
                _ => "",
            };
            if !needs.is_empty() && module.arguments.is_empty() {
                let symbol = module.symbol;
                return Err(start.fault(format!("{symbol} without a parameter needs a value {needs} = …")));
            }
            if module.symbol == '~' { out.extend(anyhow(module)) } else { out.push(module) }
        }
        Ok(out)
    }

    /// `left<symbol>right:condition=successor:probability`.
    fn rule(&mut self, chars: &[Char], end: Char) -> Parsed<()> {
        let start = chars.first().copied().unwrap_or(end);
        let at = equals(chars).ok_or_else(|| start.fault("neither a known value nor a rule such as A=F[+A]"))?;
        let (head, tail) = (&chars[..at], &chars[at + 1..]);
        let colon = head.iter().position(|c| c.c == ':');
        let mut parameters = Vec::new();
        let patterns = &head[..colon.unwrap_or(head.len())];
        let (left, pattern, right) = predecessor(patterns, start, &self.symbols, &mut parameters)?;
        let names = Names::new(Syntax::C, &self.grammar.constants, &parameters);
        let mut production = Production::new(left, pattern, right);
        if let Some(colon) = colon {
            let mut cursor = Cursor::new(&head[colon + 1..], head[colon]);
            production.condition = Some(expr_parser::parse(&mut cursor, &names)?);
            if !cursor.at_end() {
                return Err(cursor.unexpected("'=' or an operator"));
            }
        }
        let mut cursor = Cursor::new(tail, chars[at]);
        production.successor = self.string(&mut cursor, &parameters)?;
        if cursor.take(':') {
            production.weight = Some(expr_parser::parse(&mut cursor, &names)?);
        }
        if !cursor.at_end() {
            return Err(cursor.unexpected("a symbol or ':' and a probability"));
        }
        self.grammar.rules.append(production);
        Ok(())
    }

    fn alphabet(&self) -> Alphabet {
        let line = Forward { scales_parameter: false, width: WidthParameter::OfSegment, bends: false, ..Forward::DRAW };
        let half = Forward { share: 0.5, ..line };
        let move_by = |share| Action::Forward(Forward { draws: false, share, ..line });
        let ratio = |default: Option<f64>, change| Ratio { change, default: default.unwrap_or(1.0) };
        let (multiply, divide) = (RatioChange::Multiply, RatioChange::Divide);
        let thickness = self.scales.thickness.unwrap_or(1.0);
        let width = |parameter, factor| Action::Width(WidthChange { parameter, otherwise: Fallback::Multiply(factor) });
        let mut out = common();
        out.extend([
            ('F', Action::Forward(line)),
            ('H', Action::Forward(half)),
            ('G', Action::Forward(Forward { corner: false, ..line })),
            ('f', move_by(1.0)),
            ('h', move_by(0.5)),
            ('+', Action::turn(-1.0)),
            ('-', Action::turn(1.0)),
            ('&', Action::pitch(-1.0)),
            ('^', Action::pitch(1.0)),
            ('\\', Action::roll(1.0)),
            ('/', Action::roll(-1.0)),
            ('*', Action::roll_by(180.0)),
            ('"', Action::Length(ratio(self.scales.step, multiply))),
            ('_', Action::Length(ratio(self.scales.step, divide))),
            (';', Action::Angle(ratio(self.scales.angle, multiply))),
            ('@', Action::Angle(ratio(self.scales.angle, divide))),
            ('!', width(Given::Multiply, thickness)),
            ('?', width(Given::Divide, 1.0 / thickness)),
            ('T', Action::Bend(self.scales.gravity.unwrap_or(0.0))),
            ('$', Action::Level),
            ('%', Action::Cut),
            ('{', Action::BeginPolygon),
            ('.', Action::Corner),
            ('}', Action::EndPolygon),
            ('J', Action::OwnSurface),
            ('K', Action::OwnSurface),
            ('M', Action::OwnSurface),
        ]);
        out
    }
}

/// Index of the `=` between predecessor and successor: the first that stands alone, outside of parentheses.
fn equals(chars: &[Char]) -> Option<usize> {
    let mut depth = 0i64;
    let at = |i: usize| chars.get(i).map_or(' ', |c| c.c);
    (0..chars.len()).find(|&i| {
        match at(i) {
            '(' => depth += 1,
            ')' => depth -= 1,
            '=' if depth == 0 => {
                let compares = at(i + 1) == '=' || (i > 0 && matches!(at(i - 1), '=' | '<' | '>' | '!'));
                return !compares;
            }
            _ => {}
        }
        false
    })
}

/// `~(a)`: turned, pitched and rolled by angles drawn from −a to a, each by its own lot; 180 without a parameter.
fn anyhow(module: Module) -> [Module; 3] {
    let most = module.arguments.into_iter().next().unwrap_or(Expr::Number(180.0));
    let lot = || {
        let twice = Expr::Binary(Binary::Multiply, Box::new([Expr::Number(2.0), most.clone()]));
        Expr::Binary(Binary::Subtract, Box::new([Expr::Call(Function::Ran, vec![twice]), most.clone()]))
    };
    ['+', '&', '/'].map(|symbol| Module { symbol, arguments: vec![lot()] })
}
