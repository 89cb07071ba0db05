//! Symbols → limbs, polygons and placed surfaces: the turtle in three dimensions.
//!
//! Based on: P. Prusinkiewicz, A. Lindenmayer, *The Algorithmic Beauty of Plants*, 1990, sections 1.5, 1.10, 2.3 and 5.1;
//! H. Abelson, A. diSessa, *Turtle Geometry*, 1982.

use super::alphabet::{
    Action, ColourChange, ColourRange, Fallback, Forward, Given, Ratio, RatioChange, Turn, WidthChange, WidthParameter,
};
use super::budget::Budget;
use super::directive::linear;
use super::expr::sin_cos;
use super::grammar::{Grammar, Surface};
use super::plant::{DrawStyle, Limb, Plant};
use crate::geom::{DMat3, DVec3};
use crate::scene::triangulate::Triangulator;
use crate::{Error, Result};

/// Largest coordinate, in units: beyond it single precision keeps nothing of a plant's detail.
const FARTHEST: f64 = 1e12;

#[derive(Debug, Clone)]
struct State {
    position: DVec3,
    /// Columns: ahead, left, up.
    frame: DMat3,
    /// A second heading that turns by itself, as Fractint has.
    second: DMat3,
    /// Factor of lengths, and of angles without a parameter.
    scale: f64,
    angle_scale: f64,
    /// −1 where left and right are exchanged.
    turning: f64,
    width: f64,
    colour: [f32; 3],
    /// Index into the colour table.
    index: f64,
    limb: Limb,
}

/// Draws symbols one after another.
pub struct Turtle<'g> {
    grammar: &'g Grammar,
    angle: f64,
    state: State,
    stack: Vec<State>,
    /// Corners of the polygons that are open.
    open: Vec<Vec<DVec3>>,
    /// Brackets that are open within what was cut off.
    cut: Option<u64>,
    /// True after the symbol that a surface's name follows.
    surface: bool,
    triangulator: Triangulator,
    plant: Plant,
}

impl<'g> Turtle<'g> {
    /// At the origin. `angle` in degrees.
    pub fn new(grammar: &'g Grammar, angle: f64) -> Turtle<'g> {
        let state = State {
            position: DVec3::ZERO,
            frame: grammar.frame,
            second: grammar.frame,
            scale: 1.0,
            angle_scale: 1.0,
            turning: 1.0,
            width: grammar.width.unwrap_or(0.1 * grammar.step.abs()),
            colour: grammar.colour(grammar.first_colour),
            index: grammar.first_colour,
            limb: Limb::default(),
        };
        Turtle {
            grammar,
            angle,
            state,
            stack: Vec::new(),
            open: Vec::new(),
            cut: None,
            surface: false,
            triangulator: Triangulator::new(),
            plant: Plant { warnings: grammar.warnings.clone(), ..Plant::default() },
        }
    }

    /// # Errors
    /// [`Error::Limit`] where the drawing leaves all bounds.
    pub fn symbol(&mut self, symbol: char, arguments: &[f64], budget: &Budget) -> Result<()> {
        let action = self.grammar.actions.get(&symbol).copied();
        if self.is_cut(action) {
            return Ok(());
        }
        if std::mem::take(&mut self.surface) {
            self.place(symbol, arguments)?;
        } else if let Some(action) = action {
            self.act(action, symbol, arguments)?;
        } else {
            return Ok(());
        }
        let opened = match action {
            Some(Action::Push) => self.stack.len() * size_of::<State>(),
            Some(Action::BeginPolygon) => self.open.len() * size_of::<Vec<DVec3>>(),
            _ => 0,
        };
        budget.holds(self.plant.bytes + opened)
    }

    /// Whether a symbol of this action lies in what was cut off of a branch; the bracket that ends the branch does not.
    fn is_cut(&mut self, action: Option<Action>) -> bool {
        let Some(depth) = self.cut else { return false };
        self.cut = match action {
            Some(Action::Push) => Some(depth + 1),
            Some(Action::Pop) => depth.checked_sub(1),
            _ => Some(depth),
        };
        self.cut.is_some()
    }

    fn act(&mut self, action: Action, symbol: char, arguments: &[f64]) -> Result<()> {
        let s = &mut self.state;
        match action {
            Action::Forward(forward) => self.forward(symbol, arguments, forward)?,
            Action::Turn(turn) => self.turned(turn, arguments),
            Action::Level => level(&mut s.frame),
            Action::Mirror => s.turning = -s.turning,
            Action::Push => self.push(),
            Action::Pop => self.pop(),
            Action::Cut => self.cut = Some(0),
            Action::BeginPolygon => self.open.push(Vec::new()),
            Action::Corner => self.plant.corner(&mut self.open, s.position)?,
            Action::EndPolygon => self.end_polygon(),
            Action::Width(change) => self.widen(change, arguments),
            Action::Colour(change) => self.tint(change, arguments),
            Action::Length(ratio) => self.state.scale = self.changed(ratio, self.state.scale, arguments),
            Action::Angle(ratio) => self.state.angle_scale = self.changed(ratio, self.state.angle_scale, arguments),
            Action::Bend(default) => {
                let angle = self.argument(arguments, 0, default);
                self.bend(angle);
            }
            Action::MoveTo => self.move_to(arguments)?,
            Action::Head => self.head(arguments),
            Action::Ball(factor) => {
                let radius = self.radius(factor, arguments);
                let style = self.style();
                self.plant.ball(self.state.position, self.state.frame.x_axis, radius, style);
            }
            Action::Disc(factor) => {
                let radius = self.radius(factor, arguments);
                let (style, f) = (self.style(), self.state.frame);
                self.plant.disc(&mut self.triangulator, self.state.position, [f.x_axis, f.y_axis], radius, style);
            }
            Action::Surface => self.surface = true,
            Action::ScaledSurface => self.place(symbol, arguments)?,
            Action::OwnSurface => {
                let size = self.argument(arguments, 0, self.grammar.step * self.state.scale);
                self.place(symbol, &[size / self.state.scale])?;
            }
        }
        Ok(())
    }

    /// Begin a branch; the limb goes on where the branch has ended.
    fn push(&mut self) {
        let limb = std::mem::take(&mut self.state.limb);
        let branch = self.state.clone();
        self.stack.push(State { limb, ..std::mem::replace(&mut self.state, branch) });
    }

    fn pop(&mut self) {
        let Some(state) = self.stack.pop() else {
            self.plant.warnings.add("a ] that closes nothing is left out");
            return;
        };
        self.plant.end_limb(&mut self.state.limb);
        self.state = state;
    }

    fn end_polygon(&mut self) {
        let Some(polygon) = self.open.pop() else {
            self.plant.warnings.add("a } that closes nothing is left out");
            return;
        };
        let style = self.style();
        self.plant.polygon(&mut self.triangulator, polygon, style);
    }

    /// All that was drawn.
    pub fn finish(mut self) -> Plant {
        self.plant.end_limb(&mut self.state.limb);
        while let Some(mut state) = self.stack.pop() {
            self.plant.end_limb(&mut state.limb);
        }
        let warnings = &mut self.plant.warnings;
        warnings.add_many("a { that is never closed is left out", self.open.len() as u64);
        self.plant
    }

    /// Argument `i`, or `default` where there is none.
    fn argument(&mut self, arguments: &[f64], i: usize, default: f64) -> f64 {
        match arguments.get(i) {
            Some(v) if v.is_finite() => *v,
            Some(_) => {
                self.plant.warnings.add("parameters that are not finite numbers are taken as not given");
                default
            }
            None => default,
        }
    }

    /// Colour, and the material that belongs to it.
    fn style(&self) -> DrawStyle {
        DrawStyle { colour: self.state.colour, material: self.grammar.materials.coloured(self.state.index) }
    }

    fn radius(&mut self, factor: f64, arguments: &[f64]) -> f64 {
        match arguments.is_empty() {
            true => 0.5 * self.state.width,
            false => 0.5 * factor * (self.state.scale * self.argument(arguments, 0, 0.0)).max(0.0),
        }
    }

    fn turned(&mut self, turn: Turn, arguments: &[f64]) {
        let angle = match turn.by {
            Some(angle) => angle,
            None => self.state.turning * self.argument(arguments, 0, self.angle * self.state.angle_scale),
        };
        let s = &mut self.state;
        rotate(if turn.second_heading { &mut s.second } else { &mut s.frame }, turn.from, turn.to, turn.sign * angle);
    }

    fn widen(&mut self, change: WidthChange, arguments: &[f64]) {
        let width = self.state.width;
        let given = arguments.first().map(|_| self.argument(arguments, 0, f64::NAN)).filter(|v| !v.is_nan());
        let new = match (given, change.parameter, change.otherwise) {
            (Some(v), Given::Set(factor), _) => v * factor * self.state.scale,
            (Some(v), Given::Multiply, _) => width * v,
            (Some(v), Given::Divide, _) => width / v,
            // A parameter that is no number leaves the width.
            (None, ..) if !arguments.is_empty() => width,
            (None, _, Fallback::Add(v)) => width + v * self.state.scale,
            (None, _, Fallback::Multiply(v)) => width * v,
            (None, _, Fallback::Taper) => width * self.grammar.taper,
        };
        self.state.width = if new.is_finite() { new.max(0.0) } else { width };
    }

    fn tint(&mut self, change: ColourChange, arguments: &[f64]) {
        if let [r, g, b, ..] = *arguments {
            self.state.colour = linear([r, g, b]);
            return;
        }
        let before = self.state.index;
        let index = if arguments.is_empty() {
            before + change.default
        } else if change.relative == 0.0 {
            self.argument(arguments, 0, before + change.default)
        } else {
            before + change.relative * self.argument(arguments, 0, 0.0)
        };
        self.state.index = match change.range {
            ColourRange::Any => index,
            ColourRange::Wrapped(n) => index.rem_euclid(n.into()),
            ColourRange::WrappedAround0(n) => match index.rem_euclid(n.into()) {
                0.0 if index > before => 1.0,
                0.0 if index < before => f64::from(n) - 1.0,
                i => i,
            },
        };
        self.state.colour = self.grammar.colour(self.state.index);
    }

    fn changed(&mut self, ratio: Ratio, before: f64, arguments: &[f64]) -> f64 {
        let by = self.argument(arguments, 0, ratio.default);
        let new = match ratio.change {
            RatioChange::Set => by,
            RatioChange::Multiply => before * by,
            RatioChange::Divide => before / by,
        };
        if new.is_finite() { new } else { before }
    }

    fn forward(&mut self, symbol: char, arguments: &[f64], forward: Forward) -> Result<()> {
        let s = &self.state;
        let scale = s.scale;
        let given = if forward.scales_parameter { scale } else { 1.0 };
        let default = self.grammar.step * scale;
        let length = forward.share
            * match arguments.is_empty() {
                true => default,
                false => self.argument(arguments, 0, default / given) * given,
            };
        let ahead = if forward.second_heading { self.state.second } else { self.state.frame }.x_axis;
        let from = self.state.position;
        let to = from + length * ahead;
        self.go(to)?;
        if forward.draws {
            let given = arguments.get(1).map(|_| self.argument(arguments, 1, self.state.width).max(0.0));
            let end = match forward.width {
                WidthParameter::Nothing => None,
                WidthParameter::AtEnd(factor) => given.map(|w| w * factor),
                WidthParameter::OfSegment => {
                    self.state.width = given.unwrap_or(self.state.width);
                    None
                }
            };
            let material = self.grammar.materials.drawn(symbol, self.state.index);
            let style = DrawStyle { colour: self.state.colour, material };
            let s = &mut self.state;
            self.plant.segment(&mut s.limb, [from, to], s.width, end, style);
            s.width = end.unwrap_or(s.width);
            if forward.bends {
                self.bend(1.0);
            }
        } else if length != 0.0 {
            self.plant.end_limb(&mut self.state.limb);
        }
        if forward.corner && !self.open.is_empty() { self.plant.corner(&mut self.open, to) } else { Ok(()) }
    }

    fn go(&mut self, to: DVec3) -> Result<()> {
        if !to.is_finite() || to.abs().max_element() > FARTHEST {
            return Err(Error::Limit {
                what: "the L-system's drawing (check its lengths), in units from the start,".into(),
                needed: to.abs().max_element() as u64,
                allowed: FARTHEST as u64,
            });
        }
        self.state.position = to;
        Ok(())
    }

    fn move_to(&mut self, arguments: &[f64]) -> Result<()> {
        let [x, y, z] = [0, 1, 2].map(|i| self.argument(arguments, i, 0.0));
        self.plant.end_limb(&mut self.state.limb);
        self.go(self.grammar.axes * DVec3::new(x, y, z))
    }

    fn head(&mut self, arguments: &[f64]) {
        let mut axis = |i: usize| {
            let v = [i, i + 1, i + 2].map(|i| self.argument(arguments, i, 0.0));
            (self.grammar.axes * DVec3::from(v)).try_normalize()
        };
        let (ahead, up) = (axis(0), axis(3));
        let f = &mut self.state.frame;
        let Some(ahead) = ahead else { return };
        // Without an up, the one that was stays as near as it can.
        let left = up.unwrap_or(f.z_axis).cross(ahead).try_normalize();
        let left = left.unwrap_or_else(|| ahead.any_orthonormal_vector());
        *f = DMat3::from_cols(ahead, left, ahead.cross(left));
    }

    /// Bend towards the tropism's direction, by this much of it.
    fn bend(&mut self, share: f64) {
        let torque = share * self.state.frame.x_axis.cross(self.grammar.tropism);
        let angle = torque.length();
        if angle > 0.0 && angle.is_finite() {
            let (sin, cos) = (libm::sin(angle), libm::cos(angle));
            let axis = torque / angle;
            let rotated = |v: DVec3| v * cos + axis.cross(v) * sin + axis * (axis.dot(v) * (1.0 - cos));
            let f = self.state.frame;
            self.state.frame = DMat3::from_cols(rotated(f.x_axis), rotated(f.y_axis), rotated(f.z_axis));
        }
    }

    /// Draw the surface `symbol`; its parameters scale it.
    fn place(&mut self, symbol: char, arguments: &[f64]) -> Result<()> {
        let Some(surface) = self.grammar.surfaces.get(&symbol) else {
            let name = self.grammar.written(symbol);
            self.plant.warnings.add(format!("the surface {name} is left out: the grammar has none of this name"));
            return Ok(());
        };
        let x = self.argument(arguments, 0, 1.0);
        let size = [x, self.argument(arguments, 1, x), self.argument(arguments, 2, x)].map(|v| v * self.state.scale);
        let s = &self.state;
        let material = self.grammar.materials.surface(symbol).unwrap_or_else(|| self.style().material);
        let style = DrawStyle { colour: s.colour, material };
        self.plant.place(&mut self.triangulator, (symbol, surface), (s.position, s.frame), size, style);
        let Surface::Patches { end, .. } = surface else { return Ok(()) };
        let end = size[0] * s.frame * DVec3::new(end.y, -end.x, end.z);
        self.plant.end_limb(&mut self.state.limb);
        self.go(self.state.position + end)
    }
}

/// Turn column `from` towards column `to`.
fn rotate(frame: &mut DMat3, from: usize, to: usize, degrees: f64) {
    let (sin, cos) = sin_cos(degrees);
    let (a, b) = (frame.col(from), frame.col(to));
    *frame.col_mut(from) = a * cos + b * sin;
    *frame.col_mut(to) = b * cos - a * sin;
}

/// Roll until left is level.
fn level(frame: &mut DMat3) {
    if let Some(left) = DVec3::Y.cross(frame.x_axis).try_normalize() {
        frame.y_axis = left;
        frame.z_axis = frame.x_axis.cross(left);
    }
}
