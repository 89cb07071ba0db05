//! What the turtle does at a symbol. Each notation has an alphabet of its own.
//!
//! Based on: P. Prusinkiewicz, A. Lindenmayer, *The Algorithmic Beauty of Plants*, Springer 1990, appendix C.

use std::collections::BTreeMap;

/// Actions by symbol.
pub type Alphabet = BTreeMap<char, Action>;

/// Action of the turtle at a symbol.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Action {
    Forward(Forward),
    Turn(Turn),
    /// Roll until left is level.
    Level,
    /// Turn left into right from here on, and back.
    Mirror,
    /// Begin and end a branch.
    Push,
    Pop,
    /// Cut off the rest of the branch.
    Cut,
    /// Begin a polygon, add a corner, end it.
    BeginPolygon,
    Corner,
    EndPolygon,
    Width(WidthChange),
    Colour(ColourChange),
    /// Change the length of segments.
    Length(Ratio),
    /// Change the angle of turns without a parameter.
    Angle(Ratio),
    /// Turn towards the tropism, by the parameter or else this.
    Bend(f64),
    /// Go to the position of three parameters, in the axes that the notation has.
    MoveTo,
    /// Head as three parameters say, with three more for up.
    Head,
    /// Draw a ball or a disc; the parameter is its diameter (or radius) times this over 2. Without one: the width.
    Ball(f64),
    Disc(f64),
    /// Draw the surface that the next symbol names.
    Surface,
    /// Draw the surface that this symbol names; its first parameter, or else the length of segments, scales it.
    OwnSurface,
    /// Draw the surface that this symbol names; its parameters scale it, as does the factor of lengths.
    ScaledSurface,
}

/// Draw or move ahead: by the first parameter, or by the length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Forward {
    pub draws: bool,
    /// Whether its end is a corner, within a polygon.
    pub corner: bool,
    /// Factor of the distance.
    pub share: f64,
    /// Whether the scale of lengths holds for the parameter as well.
    pub scales_parameter: bool,
    pub width: WidthParameter,
    /// Whether it goes where the second heading points.
    pub second_heading: bool,
    /// Whether the turtle bends towards the tropism after it.
    pub bends: bool,
}

/// What the second parameter of a segment is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WidthParameter {
    Nothing,
    /// The width at its end, times this.
    AtEnd(f64),
    /// The width of all of it.
    OfSegment,
}

/// A rotation, by the parameter or by the angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn {
    /// Column of the frame (ahead, left, up) that turns towards another.
    pub from: usize,
    pub to: usize,
    /// Factor of the angle.
    pub sign: f64,
    /// Degrees, in place of the parameter and of the angle.
    pub by: Option<f64>,
    /// Whether it turns the second heading.
    pub second_heading: bool,
}

/// How a width is changed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WidthChange {
    pub parameter: Given,
    /// Without a parameter.
    pub otherwise: Fallback,
}

/// What a parameter does to a width.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Given {
    /// It is the width, over this.
    Set(f64),
    Multiply,
    Divide,
}

/// What is done to a width without a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fallback {
    Add(f64),
    Multiply(f64),
    /// Multiply by the taper of the grammar.
    Taper,
}

/// How the index into the table of colours is changed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColourChange {
    /// Added without a parameter.
    pub default: f64,
    /// Factor of a parameter that is added; 0 where it is the index.
    pub relative: f64,
    pub range: ColourRange,
}

/// Where indices of colours lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColourRange {
    Any,
    /// From 0 to below this, and on from the other end.
    Wrapped(u16),
    /// The same, but for the background's: what comes to 0 from below is 1, and from above is the last.
    WrappedAround0(u16),
}

/// How a ratio is changed: by the parameter, or by a number without one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ratio {
    pub change: RatioChange,
    pub default: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RatioChange {
    Set,
    Multiply,
    Divide,
}

impl Forward {
    /// Draws; the second parameter is the width at its end.
    pub const DRAW: Forward = Forward {
        draws: true,
        corner: true,
        share: 1.0,
        scales_parameter: true,
        width: WidthParameter::AtEnd(1.0),
        second_heading: false,
        bends: true,
    };
}

impl Action {
    /// F: draw a segment; within a polygon its end is a corner.
    pub const DRAW: Action = Action::Forward(Forward::DRAW);
    /// G: draw a segment.
    pub const DRAW_ONLY: Action = Action::Forward(Forward { corner: false, ..Forward::DRAW });
    /// f: move; within a polygon the end is a corner.
    pub const MOVE: Action = Action::Forward(Forward { draws: false, ..Forward::DRAW });
    /// Turn to the left; −1: to the right.
    pub const fn turn(sign: f64) -> Action {
        Action::Turn(Turn { from: 0, to: 1, sign, by: None, second_heading: false })
    }

    /// Pitch up; −1: down.
    pub const fn pitch(sign: f64) -> Action {
        Action::Turn(Turn { from: 0, to: 2, sign, by: None, second_heading: false })
    }

    /// Roll so that left goes up; −1: down.
    pub const fn roll(sign: f64) -> Action {
        Action::Turn(Turn { from: 1, to: 2, sign, by: None, second_heading: false })
    }

    /// Roll so that left goes up, by these degrees.
    pub const fn roll_by(degrees: f64) -> Action {
        Action::Turn(Turn { from: 1, to: 2, sign: 1.0, by: Some(degrees), second_heading: false })
    }

    /// Turn to the left by these degrees.
    pub const fn turn_by(degrees: f64) -> Action {
        Action::Turn(Turn { from: 0, to: 1, sign: 1.0, by: Some(degrees), second_heading: false })
    }
}

/// What all notations have: turns and brackets.
pub fn common() -> Alphabet {
    Alphabet::from([
        ('+', Action::turn(1.0)),
        ('-', Action::turn(-1.0)),
        ('|', Action::turn_by(180.0)),
        ('[', Action::Push),
        (']', Action::Pop),
    ])
}

/// The alphabet of the book, but for the symbols that draw.
pub fn book_without_lines() -> Alphabet {
    let mut out = common();
    out.extend([
        ('&', Action::pitch(-1.0)),
        ('^', Action::pitch(1.0)),
        ('\\', Action::roll(-1.0)),
        ('/', Action::roll(1.0)),
        ('$', Action::Level),
        ('{', Action::BeginPolygon),
        ('}', Action::EndPolygon),
        ('.', Action::Corner),
        ('!', Action::Width(WidthChange { parameter: Given::Set(1.0), otherwise: Fallback::Taper })),
        ('\'', Action::Colour(ColourChange { default: 1.0, relative: 0.0, range: ColourRange::Any })),
        ('%', Action::Cut),
        ('~', Action::Surface),
    ]);
    out
}

/// The alphabet of the book.
pub fn book() -> Alphabet {
    let mut out = book_without_lines();
    out.extend([('F', Action::DRAW), ('G', Action::DRAW_ONLY), ('f', Action::MOVE)]);
    out
}
