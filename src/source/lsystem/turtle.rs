//! Symbols → limbs, polygons and placed surfaces: the turtle in three dimensions.
//!
//! Based on: P. Prusinkiewicz, A. Lindenmayer, *The Algorithmic Beauty of Plants*, 1990, sections 1.5, 1.10, 2.3 and 5.1;
//! H. Abelson, A. diSessa, *Turtle Geometry*, 1982.

use std::collections::BTreeMap;

use super::budget::Budget;
use super::directive::linear;
use super::expr::sin_cos;
use super::grammar::{Action, Grammar, Surface};
use crate::geom::{DAffine3, DMat3, DVec3};
use crate::scene::model::Part;
use crate::scene::triangulate::Cutter;
use crate::source::curve::Strand;
use crate::{Error, Result, Warnings};

/// Largest coordinate, in units: beyond it single precision keeps nothing of a plant's detail.
const FARTHEST: f64 = 1e12;
/// Corners of one polygon: beyond, cutting it takes too long.
const MOST_CORNERS: usize = 1 << 16;

/// Bytes per segment: its end in the limb, in the source that is made of the limb (a list that grows by doubling), and in a
/// path. 126 bytes each were measured for two million segments in a row.
const SEGMENT_BYTES: usize = 126;

/// Geometry drawn so far.
#[derive(Debug, Default)]
pub struct Plant {
    /// Chains of segments.
    pub limbs: Vec<Strand>,
    /// Triangles of polygons, with their colours, by material.
    pub polygons: BTreeMap<u16, Part>,
    /// Transforms of the copies of each surface that is a mesh.
    pub meshes: BTreeMap<char, Vec<DAffine3>>,
    pub counts: Counts,
    pub warnings: Warnings,
    /// Approximate bytes of memory of all of it.
    bytes: usize,
}

/// Number of primitives drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Terminal segments: F and G.
    pub segments: u64,
    /// `{…}` and surfaces that are polygons.
    pub polygons: u64,
    /// Surfaces that are meshes.
    pub meshes: u64,
}

#[derive(Debug, Clone)]
struct State {
    position: DVec3,
    /// Columns: ahead, left, up.
    frame: DMat3,
    width: f64,
    colour: [f32; 3],
    /// Index into the colour table.
    index: f64,
    limb: Limb,
}

/// A chain of segments that may go on.
#[derive(Debug, Clone, Default)]
struct Limb {
    points: Vec<DVec3>,
    radii: Vec<f32>,
    colour: [f32; 3],
    material: u16,
    /// True where the last width was given with the segment, and not by a symbol after it.
    fixed: bool,
}

/// Draws symbols one after another.
pub struct Turtle<'g> {
    grammar: &'g Grammar,
    angle: f64,
    state: State,
    stack: Vec<State>,
    /// Corners of the polygons that are open.
    open: Vec<Vec<DVec3>>,
    /// Brackets that are open within what `%` cut off.
    cut: Option<u64>,
    /// True after the symbol `~`.
    surface: bool,
    cutter: Cutter,
    plant: Plant,
}

impl<'g> Turtle<'g> {
    /// At the origin, heading up +Y, left −X, its up +Z. `angle` in degrees.
    pub fn new(grammar: &'g Grammar, angle: f64) -> Turtle<'g> {
        let state = State {
            position: DVec3::ZERO,
            frame: DMat3::from_cols(DVec3::Y, DVec3::NEG_X, DVec3::Z),
            width: grammar.width.unwrap_or(0.1 * grammar.step.abs()),
            colour: grammar.colour(0.0),
            index: 0.0,
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
            cutter: Cutter::new(),
            plant: Plant::default(),
        }
    }

    /// # Errors
    /// [`Error::Limit`] where the drawing leaves all bounds.
    pub fn symbol(&mut self, symbol: char, arguments: &[f64], budget: &Budget) -> Result<()> {
        if let Some(depth) = self.cut {
            match symbol {
                '[' => self.cut = Some(depth + 1),
                ']' if depth == 0 => self.cut = None,
                ']' => self.cut = Some(depth - 1),
                _ => {}
            }
            if self.cut.is_some() {
                return Ok(());
            }
        }
        if std::mem::take(&mut self.surface) {
            self.place(symbol, arguments);
            return self.check(budget);
        }
        let s = &mut self.state;
        match symbol {
            '+' => self.turned(0, 1, arguments, 1.0),
            '-' => self.turned(0, 1, arguments, -1.0),
            '&' => self.turned(0, 2, arguments, -1.0),
            '^' => self.turned(0, 2, arguments, 1.0),
            '\\' => self.turned(1, 2, arguments, -1.0),
            '/' => self.turned(1, 2, arguments, 1.0),
            '|' => turn(&mut s.frame, 0, 1, 180.0),
            '$' => level(&mut s.frame),
            '[' => {
                let limb = std::mem::take(&mut s.limb);
                let branch = s.clone();
                self.stack.push(State { limb, ..std::mem::replace(s, branch) });
                return budget.holds(self.plant.bytes + self.stack.len() * size_of::<State>());
            }
            ']' => match self.stack.pop() {
                Some(state) => {
                    self.end_limb();
                    self.state = state;
                }
                None => self.plant.warnings.add("a ] that closes nothing is left out"),
            },
            '{' => {
                self.open.push(Vec::new());
                return budget.holds(self.plant.bytes + self.open.len() * size_of::<Vec<DVec3>>());
            }
            '}' => self.end_polygon(),
            '.' => self.corner()?,
            '!' if arguments.is_empty() => s.width *= self.grammar.taper,
            '!' => self.state.width = self.argument(arguments, 0, self.state.width).max(0.0),
            '\'' => self.tint(arguments),
            '%' => self.cut = Some(0),
            '~' => self.surface = true,
            _ => match self.grammar.actions.get(&symbol) {
                Some(Action::Draw) => self.forward(symbol, arguments, true, true)?,
                Some(Action::DrawOnly) => self.forward(symbol, arguments, true, false)?,
                Some(Action::Move) => self.forward(symbol, arguments, false, true)?,
                None => return Ok(()),
            },
        }
        self.check(budget)
    }

    /// All that was drawn.
    pub fn finish(mut self) -> Plant {
        self.end_limb();
        while let Some(state) = self.stack.pop() {
            self.state = state;
            self.end_limb();
        }
        let warnings = &mut self.plant.warnings;
        warnings.add_many("a { that is never closed is left out", self.open.len() as u64);
        self.plant
    }

    fn check(&self, budget: &Budget) -> Result<()> {
        budget.holds(self.plant.bytes)
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

    fn turned(&mut self, from: usize, to: usize, arguments: &[f64], sign: f64) {
        let angle = sign * self.argument(arguments, 0, self.angle);
        turn(&mut self.state.frame, from, to, angle);
    }

    fn tint(&mut self, arguments: &[f64]) {
        if let [r, g, b] = *arguments {
            self.state.colour = linear([r, g, b]);
            return;
        }
        self.state.index = self.argument(arguments, 0, self.state.index + 1.0);
        self.state.colour = self.grammar.colour(self.state.index);
    }

    /// `F(length, width at the end)`.
    fn forward(&mut self, symbol: char, arguments: &[f64], draws: bool, corner: bool) -> Result<()> {
        let length = self.argument(arguments, 0, self.grammar.step);
        let from = self.state.position;
        let to = from + length * self.state.frame.x_axis;
        if !to.is_finite() || to.abs().max_element() > FARTHEST {
            return Err(Error::Limit {
                what: "the L-system's drawing (check its lengths), in units from the start,".into(),
                needed: to.abs().max_element() as u64,
                allowed: FARTHEST as u64,
            });
        }
        self.state.position = to;
        if draws {
            let end = arguments.get(1).map(|_| self.argument(arguments, 1, self.state.width).max(0.0));
            let material = self.grammar.materials.drawn(symbol, self.state.index);
            self.segment(from, to, end, material);
            self.bend();
        } else if length != 0.0 {
            self.end_limb();
        }
        if corner && !self.open.is_empty() { self.corner() } else { Ok(()) }
    }

    fn segment(&mut self, from: DVec3, to: DVec3, end: Option<f64>, material: u16) {
        self.plant.counts.segments += 1;
        let radius = (0.5 * self.state.width) as f32;
        let limb = &self.state.limb;
        // A limb thins as its segments do; where it gets wider, or another colour, another begins.
        let goes_on = limb.colour == self.state.colour
            && limb.material == material
            && limb.radii.last().is_some_and(|r| if limb.fixed { *r == radius } else { *r >= radius });
        if !goes_on {
            self.end_limb();
        }
        let colour = self.state.colour;
        let limb = &mut self.state.limb;
        match limb.radii.last_mut() {
            Some(last) => *last = radius,
            None => {
                limb.colour = colour;
                limb.material = material;
                limb.points.push(from);
                limb.radii.push(radius);
            }
        }
        limb.points.push(to);
        limb.radii.push(end.map_or(radius, |w| (0.5 * w) as f32));
        limb.fixed = end.is_some();
        self.state.width = end.unwrap_or(self.state.width);
        self.plant.bytes += SEGMENT_BYTES;
    }

    fn end_limb(&mut self) {
        let limb = std::mem::take(&mut self.state.limb);
        if limb.points.len() > 1 {
            let [r, g, b] = limb.colour;
            let strand = Strand {
                points: limb.points,
                radii: limb.radii,
                colours: vec![[r, g, b, 1.0]],
                material: limb.material,
                ..Strand::default()
            };
            self.plant.limbs.push(strand);
            self.plant.bytes += 2 * size_of::<Strand>() + size_of::<[f32; 4]>();
        }
    }

    /// Bend towards the tropism's direction.
    fn bend(&mut self) {
        let torque = self.state.frame.x_axis.cross(self.grammar.tropism);
        let angle = torque.length();
        if angle > 0.0 && angle.is_finite() {
            let (sin, cos) = (libm::sin(angle), libm::cos(angle));
            let axis = torque / angle;
            let rotated = |v: DVec3| v * cos + axis.cross(v) * sin + axis * (axis.dot(v) * (1.0 - cos));
            let f = self.state.frame;
            self.state.frame = DMat3::from_cols(rotated(f.x_axis), rotated(f.y_axis), rotated(f.z_axis));
        }
    }

    fn corner(&mut self) -> Result<()> {
        let Some(polygon) = self.open.last_mut() else {
            self.plant.warnings.add("a . outside of { } is left out");
            return Ok(());
        };
        // Corners in the same place are one.
        if polygon.last() != Some(&self.state.position) {
            polygon.push(self.state.position);
            self.plant.bytes += size_of::<DVec3>();
        }
        if polygon.len() > MOST_CORNERS {
            return Err(Error::Limit {
                what: "a polygon of the L-system, in corners,".into(),
                needed: polygon.len() as u64,
                allowed: MOST_CORNERS as u64,
            });
        }
        Ok(())
    }

    fn end_polygon(&mut self) {
        let Some(mut polygon) = self.open.pop() else {
            self.plant.warnings.add("a } that closes nothing is left out");
            return;
        };
        // The start may be given again at the end, but for roundings.
        let size = polygon.iter().fold(0.0, |s: f64, p| s.max((*p - polygon[0]).length()));
        while polygon.len() > 1 && (polygon[polygon.len() - 1] - polygon[0]).length() <= 1e-9 * size {
            polygon.pop();
        }
        if polygon.len() < 3 {
            self.plant.warnings.add("polygons of fewer than three corners are left out");
            return;
        }
        let material = self.grammar.materials.coloured(self.state.index);
        self.fill(&polygon, self.state.colour, material);
    }

    fn fill(&mut self, polygon: &[DVec3], [r, g, b]: [f32; 3], material: u16) {
        let part = self.plant.polygons.entry(material).or_default();
        let first = part.positions.len() as u32;
        part.positions.extend(polygon.iter().map(|p| p.as_vec3().to_array()));
        part.colors.get_or_insert_default().resize(part.positions.len(), [r, g, b, 1.0]);
        let before = part.triangles.len();
        self.cutter.cut(polygon, |t| part.triangles.push(t.map(|i| first + i as u32)));
        self.plant.counts.polygons += 1;
        // The analysis of the mesh takes as much memory again, and more.
        self.plant.bytes += 2 * (28 * polygon.len() + 100 * (part.triangles.len() - before));
    }

    /// Draw the surface `symbol`; its parameters scale it.
    fn place(&mut self, symbol: char, arguments: &[f64]) {
        let Some(surface) = self.grammar.surfaces.get(&symbol) else {
            self.plant.warnings.add(format!("~{symbol} is left out: there is no #surface {symbol}"));
            return;
        };
        let x = self.argument(arguments, 0, 1.0);
        let y = self.argument(arguments, 1, x);
        let z = self.argument(arguments, 2, x);
        let f = self.state.frame;
        let axes = DMat3::from_cols(-x * f.y_axis, y * f.x_axis, z * f.z_axis);
        let to_world = DAffine3::from_mat3_translation(axes, self.state.position);
        match surface {
            Surface::Polygon { corners, colour } => {
                let corners: Vec<DVec3> = corners.iter().map(|c| to_world.transform_point3(*c)).collect();
                let named = &self.grammar.materials;
                let material = named.surface(symbol).unwrap_or_else(|| named.coloured(self.state.index));
                self.fill(&corners, colour.unwrap_or(self.state.colour), material);
            }
            Surface::Mesh { .. } => {
                self.plant.meshes.entry(symbol).or_default().push(to_world);
                self.plant.counts.meshes += 1;
                self.plant.bytes += 4 * size_of::<DAffine3>();
            }
        }
    }
}

/// Turn column `from` towards column `to`.
fn turn(frame: &mut DMat3, from: usize, to: usize, degrees: f64) {
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
