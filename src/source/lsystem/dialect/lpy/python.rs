//! The Python of L-Py's rules that is read: lines by their indentation, `if`, variables, `produce` and `nproduce`. Each way
//! through a rule becomes a production of its own, that requires what the way does.

use crate::source::lsystem::expr::{Binary, Expr, Unary};
use crate::source::lsystem::expr_parser::{self, Names};
use crate::source::lsystem::grammar::Module;
use crate::source::lsystem::lexer::{Char, Cursor, Parsed};
use crate::source::lsystem::parser::START_OF_FILE;
use crate::source::lsystem::program::{Statement, Variable};

/// Ways through a rule on which something is produced, branches on one of them, and parts of all of them together.
const MAX_PATHS: usize = 256;
const MAX_BRANCHES: usize = 32;
const MAX_VISITS: usize = 1 << 14;
/// Blocks within blocks.
const MAX_NESTED: usize = 32;
/// Columns of a tab.
const TAB: usize = 8;
/// Words that begin Python that is not run.
const STATEMENTS: [&str; 17] = [
    "def", "class", "for", "while", "try", "with", "return", "global", "print", "assert", "lambda", "raise", "del",
    "yield", "async", "group", "endgroup",
];

/// The file that a rule stands in.
pub trait Context {
    /// Symbols with parameters, to the end; `own`: the names that the rule knows.
    fn string(&mut self, cursor: &mut Cursor, own: &[String]) -> Parsed<Vec<Module>>;
    /// What names stand for in an expression.
    fn names<'n>(&'n self, own: &'n [String]) -> Names<'n>;
    /// The file's own constant of that name.
    fn constant(&self, name: &str) -> Option<f64>;
}

/// A line without its indentation and its end; what is within open parentheses goes on with it.
#[derive(Debug, Clone, Default)]
pub struct Line {
    pub indent: usize,
    pub chars: Vec<Char>,
}

impl Line {
    /// Place of its first character.
    pub fn place(&self) -> Char {
        self.chars.first().copied().unwrap_or(START_OF_FILE)
    }
}

/// One way through a rule.
#[derive(Debug, Clone, Default)]
pub struct Path {
    pub before: Vec<Statement>,
    pub successor: Vec<Module>,
    /// Parameters of the rule, and a variable for each that is set on the way.
    pub names: Vec<String>,
    produces: bool,
}

/// Lines that hold anything. Texts of three quotes are comments.
pub fn lines(chars: &[Char]) -> Parsed<Vec<Line>> {
    let mut out: Vec<Line> = Vec::new();
    let (mut depth, mut goes_on) = (0i64, false);
    let mut quoted: Option<(char, Char)> = None;
    for line in chars.split(|c| c.c == '\n') {
        let mut own = Vec::with_capacity(line.len());
        let mut i = 0;
        while let Some(c) = line.get(i) {
            let triple = matches!(c.c, '"' | '\'') && line[i..].iter().take(3).filter(|d| d.c == c.c).count() == 3;
            match quoted {
                Some((quote, _)) if triple && quote == c.c => (quoted, i) = (None, i + 3),
                Some(_) => i += 1,
                None if triple => (quoted, i) = (Some((c.c, *c)), i + 3),
                None => {
                    own.push(*c);
                    i += 1;
                }
            }
        }
        let Some(start) = own.iter().position(|c| !c.c.is_whitespace()) else { continue };
        let end = own.iter().rposition(|c| !c.c.is_whitespace()).map_or(0, |i| i + 1);
        let indent = own[..start].iter().map(|c| if c.c == '\t' { TAB } else { 1 }).sum();
        let mut text = own[start..end].to_vec();
        // A backslash at the end goes on; it is a symbol elsewhere.
        let breaks = text.last().is_some_and(|c| c.c == '\\');
        if breaks {
            text.pop();
        }
        let opens: i64 = text.iter().map(|c| i64::from(c.c == '(') - i64::from(c.c == ')')).sum();
        match out.last_mut().filter(|_| goes_on || depth > 0) {
            Some(last) => last.chars.extend(text),
            None => out.push(Line { indent, chars: text }),
        }
        depth = (depth + opens).max(0);
        goes_on = breaks;
    }
    out.retain(|l| !l.chars.is_empty());
    match quoted {
        Some((_, at)) => Err(at.fault("a text that is opened here is never closed")),
        None => Ok(out),
    }
}

/// Test whether a word comes next that begins Python which is not run.
pub fn is_statement(cursor: &Cursor) -> bool {
    let decorates = cursor.rest().iter().skip(1).take_while(|c| c.c.is_lowercase()).count() > 2;
    (cursor.begins("@") && decorates)
        || STATEMENTS.iter().any(|word| {
            let mut ahead = cursor.clone();
            // A module of the same letters has its parameters or its arrow at once.
            cursor.begins(word) && ahead.take_text(word) && ahead.peek().is_none_or(|c| !"(<>".contains(c))
        })
}

/// A condition, which `else` has not, and a block.
type Branch = (Option<Vec<Char>>, Vec<Node>);

/// A part of a block.
#[derive(Debug, Clone)]
enum Node {
    Set(String, Option<Binary>, Vec<Char>, Char),
    If(Vec<Branch>, Char),
    /// `true`: the rule ends with it.
    Produce(Vec<Char>, bool, Char),
}

impl Node {
    fn place(&self) -> Char {
        match self {
            Node::Set(.., at) | Node::If(_, at) | Node::Produce(.., at) => *at,
        }
    }
}

/// The ways through a rule with the parameters `own`: what stands after its colon, and the lines below it. Those on which
/// nothing is produced are no ways: there the next rule is tried.
pub fn paths(reader: &mut dyn Context, own: &[String], first: &Line, below: &[Line]) -> Parsed<Vec<Path>> {
    let mut all = Vec::with_capacity(below.len() + 1);
    if first.chars.iter().any(|c| !c.c.is_whitespace()) {
        if let Some(c) = below.first().and_then(|l| l.chars.first()) {
            return Err(c.fault("an indented line where none belongs"));
        }
        all.push(first.clone());
    } else {
        all.extend_from_slice(below);
    }
    let nodes = block(&all, 0)?;
    let start = Path { names: own.to_vec(), ..Path::default() };
    let mut walk = Walk { reader, out: Vec::new(), visits: 0 };
    walk.on(vec![&nodes], start, 0)?;
    Ok(walk.out)
}

/// A block from its lines, all of which are indented as far as its first or further.
fn block(lines: &[Line], depth: usize) -> Parsed<Vec<Node>> {
    let mut out = Vec::new();
    let Some(indent) = lines.first().map(|l| l.indent) else { return Ok(out) };
    let mut i = 0;
    while let Some(line) = lines.get(i) {
        let at = line.place();
        if depth > MAX_NESTED {
            return Err(at.fault(format!("more than {MAX_NESTED} blocks within each other")));
        }
        if line.indent != indent {
            return Err(at.fault("the indentation is not that of the lines above"));
        }
        let below = lines[i + 1..].iter().take_while(|l| l.indent > indent).count();
        let inner = &lines[i + 1..i + 1 + below];
        i += 1 + below;
        let mut cursor = Cursor::new(&line.chars, at);
        if let Some(word) = ["if", "elif", "else"].into_iter().find(|word| cursor.begins(word)) {
            let branch = branch(word, &mut cursor, inner, depth)?;
            match (word, out.last_mut()) {
                ("if", _) => out.push(Node::If(vec![branch], at)),
                (_, Some(Node::If(branches, _))) if branches.last().is_some_and(|b| b.0.is_some()) => {
                    branches.push(branch);
                }
                _ => return Err(at.fault(format!("{word} without an if"))),
            }
            continue;
        }
        if let Some(c) = inner.first().and_then(|l| l.chars.first()) {
            return Err(if is_statement(&cursor) {
                refused(&cursor)
            } else {
                c.fault("an indented line where none belongs")
            });
        }
        statements(&mut cursor, &mut out)?;
    }
    Ok(out)
}

/// The condition and the block of a branch that `word` begins: what stands after its colon, or the lines `inner` below it.
fn branch(word: &str, cursor: &mut Cursor, inner: &[Line], depth: usize) -> Parsed<Branch> {
    let at = cursor.place();
    cursor.take_text(word);
    let (condition, rest) = suite(cursor, word == "else")?;
    let rest = Line { indent: 0, chars: rest };
    let body = if rest.chars.is_empty() { inner } else { std::slice::from_ref(&rest) };
    if body.is_empty() || (!rest.chars.is_empty() && !inner.is_empty()) {
        return Err(at.fault(format!("{word} has to be followed by a block")));
    }
    Ok((condition, block(body, depth + 1)?))
}

/// The statements of a line, apart by semicolons; in what is produced these are symbols.
fn statements(cursor: &mut Cursor, out: &mut Vec<Node>) -> Parsed<()> {
    loop {
        cursor.skip_space();
        let at = cursor.place();
        if let Some(word) = ["produce", "nproduce"].into_iter().find(|word| cursor.begins(word)) {
            cursor.take_text(word);
            out.push(Node::Produce(cursor.rest().to_vec(), word == "produce", at));
            return Ok(());
        }
        if cursor.take_text("pass") {
        } else if let Some((name, op)) = target(cursor) {
            let rest = cursor.rest();
            let end = rest.iter().position(|c| c.c == ';').unwrap_or(rest.len());
            out.push(Node::Set(name, op, rest[..end].to_vec(), at));
            (0..end).for_each(|_| {
                cursor.next();
            });
        } else {
            return Err(refused(cursor));
        }
        if cursor.at_end() || (cursor.take(';') && cursor.at_end()) {
            return Ok(());
        }
    }
}

fn refused(cursor: &Cursor) -> crate::source::lsystem::lexer::Fault {
    let word = cursor.clone().word(|c| !c.is_whitespace() && !"(:".contains(c));
    cursor.place().fault(format!("{word}: Python is not run here, but for if, variables, produce and nproduce"))
}

/// The condition of a branch, and what stands after its colon.
fn suite(cursor: &mut Cursor, is_else: bool) -> Parsed<(Option<Vec<Char>>, Vec<Char>)> {
    let rest = cursor.rest();
    let mut depth = 0i64;
    let colon = rest.iter().position(|c| {
        depth += i64::from(c.c == '(') - i64::from(c.c == ')');
        c.c == ':' && depth == 0
    });
    let Some(colon) = colon else { return Err(cursor.place().fault("a branch has a colon")) };
    let condition = rest[..colon].to_vec();
    let filled = condition.iter().any(|c| !c.c.is_whitespace());
    if filled == is_else {
        return Err(cursor.unexpected(if is_else { "':'" } else { "a condition" }));
    }
    let tail = rest[colon + 1..].iter().skip_while(|c| c.c.is_whitespace()).copied().collect();
    Ok(((!is_else).then_some(condition), tail))
}

/// `x =`, `x +=`.
fn target(cursor: &mut Cursor) -> Option<(String, Option<Binary>)> {
    let mut ahead = cursor.clone();
    let name = ahead.word(|c| expr_parser::begins_name(c) || c.is_ascii_digit());
    if !name.starts_with(expr_parser::begins_name) {
        return None;
    }
    ahead.skip_space();
    let op = match ahead.peek()? {
        '+' => Some(Binary::Add),
        '-' => Some(Binary::Subtract),
        '*' => Some(Binary::Multiply),
        '/' => Some(Binary::Divide),
        _ => None,
    };
    if op.is_some() {
        ahead.next();
    }
    if ahead.peek() != Some('=') {
        return None;
    }
    ahead.next();
    if ahead.peek() == Some('=') {
        return None;
    }
    *cursor = ahead;
    Some((name, op))
}

/// Walks the ways through a rule.
struct Walk<'r> {
    reader: &'r mut dyn Context,
    out: Vec<Path>,
    /// Parts that were walked over.
    visits: usize,
}

impl Walk<'_> {
    /// Go on with what is left of the blocks, the innermost last; `branches` were taken on the way.
    fn on(&mut self, mut blocks: Vec<&[Node]>, mut path: Path, branches: usize) -> Parsed<()> {
        while let Some(inner) = blocks.pop() {
            let Some((node, rest)) = inner.split_first() else { continue };
            blocks.push(rest);
            self.visits += 1;
            if self.visits > MAX_VISITS || branches > MAX_BRANCHES || self.out.len() >= MAX_PATHS {
                let place = node.place();
                return Err(place.fault(format!("too many ways through the rule: {MAX_PATHS} may produce something")));
            }
            match node {
                Node::Set(name, op, text, _) => {
                    let value = self.value(name, *op, text, &path)?;
                    // Each time a variable is set it is another, for what was produced before keeps the old.
                    path.before.push(Statement::Assign(Variable::Own(path.names.len()), value));
                    path.names.push(name.clone());
                }
                Node::Produce(text, ends, at) => {
                    let mut cursor = Cursor::new(text, *at);
                    path.successor.extend(self.reader.string(&mut cursor, &path.names)?);
                    path.produces = true;
                    if *ends {
                        self.out.push(path);
                        return Ok(());
                    }
                }
                Node::If(list, _) => {
                    for (condition, nodes) in list {
                        let mut branch = path.clone();
                        if let Some(text) = condition {
                            let condition = expression(self.reader, text, &path)?;
                            branch.before.push(Statement::Require(condition.clone()));
                            path.before.push(Statement::Require(Expr::Unary(Unary::Not, Box::new(condition))));
                        }
                        let mut blocks = blocks.clone();
                        blocks.push(nodes);
                        self.on(blocks, branch, branches + 1)?;
                    }
                    if list.last().is_some_and(|(condition, _)| condition.is_none()) {
                        return Ok(());
                    }
                }
            }
        }
        if path.produces {
            self.out.push(path);
        }
        Ok(())
    }

    /// What a variable is set to.
    fn value(&self, name: &str, op: Option<Binary>, text: &[Char], path: &Path) -> Parsed<Expr> {
        let value = expression(self.reader, text, path)?;
        let Some(op) = op else { return Ok(value) };
        let before = match path.names.iter().rposition(|n| n == name) {
            Some(i) => Expr::Parameter(i),
            None => match (self.reader.constant(name), text.first()) {
                (Some(value), _) => Expr::Number(value),
                (None, Some(at)) => return Err(at.fault(format!("{name} has no value yet"))),
                (None, None) => return Ok(value),
            },
        };
        Ok(Expr::Binary(op, Box::new([before, value])))
    }
}

fn expression(reader: &dyn Context, text: &[Char], path: &Path) -> Parsed<Expr> {
    let at = text.first().copied().unwrap_or(START_OF_FILE);
    let mut cursor = Cursor::new(text, at);
    let value = expr_parser::parse(&mut cursor, &reader.names(&path.names))?;
    if cursor.at_end() { Ok(value) } else { Err(cursor.unexpected("an operator")) }
}
