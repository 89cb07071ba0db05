//! A recipe → sources: shapes become fields, curves and meshes, nodes groups and layers.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use super::model::{
    Albedo, Blade, Box3, Either, Line, LineSection, Mode, Node, Plane, Recipe, Shape, SourceFile, Widths,
};
use super::{Opener, model, paint_options, place, scatter};
use crate::geom::{Aabb, DAffine3, DVec3};
use crate::scene::model::{Instance, Material, Model};
use crate::source::curve::{CurveOptions, CurveSource, Interpolation, Section, Strand};
use crate::source::emitter;
use crate::source::field;
use crate::source::field::FieldSource;
use crate::source::group::{GroupSource, Part};
use crate::source::hypertexture::Hypertexture;
use crate::source::layers;
use crate::source::layers::LayersSource;
use crate::source::mesh::{MeshOptions, MeshSource};
use crate::source::options::OpenOptions;
use crate::source::paint;
use crate::source::paint::{Paint, PaintedSource, Translucency};
use crate::source::traits::Source;
use crate::{Error, Result, Warnings};

/// Nodes, each time that one is drawn by a node that uses it.
const MAX_NODES: u64 = 1 << 20;
/// Scattered copies, those in each copy of what they are scattered in counted again.
const MAX_COPIES: u64 = 1 << 32;
/// Memory of a scattered copy: its transform, its place in a group and in the group's tree.
const COPY_BYTES: u64 = 256;
/// Nodes within one another, through groups, definitions and recipes alike: all of them are walked by recursion.
const MAX_DEPTH: usize = 64;

pub struct Compiler<'a> {
    recipe: &'a Recipe,
    path: &'a Path,
    text: &'a str,
    options: &'a OpenOptions,
    opener: Opener,
    /// Names that are being drawn.
    using: Vec<&'a str>,
    nodes: u64,
    /// Nodes that the next one lies within, and copies of it that those make.
    depth: usize,
    repeated: u64,
    /// Scattered copies: that are held in memory, and that are drawn.
    held: u64,
    copies: u64,
    /// Bytes of all emitters' trajectories so far.
    emitted: u64,
}

/// Nodes that are added to one another.
#[derive(Default)]
struct Run<'a> {
    sources: Vec<Box<dyn Source>>,
    parts: Vec<Part>,
    /// Shapes that are drawn by name, as places in `sources`.
    named: BTreeMap<&'a str, usize>,
}

impl<'a> Compiler<'a> {
    pub fn new(
        recipe: &'a Recipe,
        path: &'a Path,
        text: &'a str,
        options: &'a OpenOptions,
        opener: Opener,
    ) -> Compiler<'a> {
        let (depth, repeated) = (options.depth, options.copies.max(1));
        let (using, nodes, held, copies, emitted) = (Vec::new(), 0, 0, 0, 0);
        Compiler { recipe, path, text, options, opener, using, nodes, depth, repeated, held, copies, emitted }
    }

    pub fn all(&mut self) -> Result<Box<dyn Source>> {
        let window = match self.recipe.bounds {
            None => None,
            Some(b) if b.min.0.cmplt(b.max.0).all() => Some(Aabb::new(b.min.0, b.max.0)),
            Some(_) => return Err(self.error("bounds", "the bounds' max has to be above their min")),
        };
        let unit = self.recipe.metres_per_unit.0;
        let drawn = self.drawn(&self.recipe.draw, window)?;
        let whole = [Part { source: 0, transform: DAffine3::IDENTITY }];
        let group = GroupSource::new(vec![drawn], &whole, unit);
        Ok(Box::new(match window {
            Some(window) => group.with_bounds(window),
            None => group,
        }))
    }

    /// An error at the first place where `word` stands.
    fn error(&self, word: &str, what: impl Into<String>) -> Error {
        let at = self.text.find(word).map_or(String::new(), |byte| place(self.text, byte));
        Error::input(self.path, at, what)
    }

    /// An error at the first place where `word` stands in the table that has `quoted`.
    fn error_after(&self, quoted: &str, word: &str, what: impl Into<String>) -> Error {
        let named = self.text.find(quoted).unwrap_or(0);
        let within = self.text.get(named..).and_then(|rest| rest.find(word)).map_or(named, |byte| named + byte);
        Error::input(self.path, place(self.text, within), what)
    }

    /// Nodes drawn one onto the other, in order. `window`: where shapes without an end are cut off.
    fn drawn(&mut self, nodes: &'a [Node], window: Option<Aabb>) -> Result<Box<dyn Source>> {
        let modes: Vec<layers::Mode> = nodes.iter().map(|n| mode(n.mode)).collect();
        self.layered(nodes, &modes, window)
    }

    fn layered(&mut self, nodes: &'a [Node], modes: &[layers::Mode], window: Option<Aabb>) -> Result<Box<dyn Source>> {
        // What only removes has to reach as far as what is there: so what has an end comes first.
        let mut extent = Aabb::EMPTY;
        let mut ready: Vec<Option<Drawn>> = Vec::with_capacity(nodes.len());
        // What a run draws by name is built once; by its name, its bounds.
        let mut named: BTreeMap<&str, Aabb> = BTreeMap::new();
        for (node, &mode) in nodes.iter().zip(modes) {
            if mode != layers::Mode::Add {
                named.clear();
            }
            if self.endless(node) {
                ready.push(None);
                continue;
            }
            let known = shared(node).and_then(|name| named.get(name)).copied();
            let drawn = match known {
                Some(_) => Drawn { source: None, parts: self.places(node)? },
                None => self.node(node, window)?,
            };
            let bounds = known.or(drawn.source.as_ref().map(|s| s.bounds())).unwrap_or(Aabb::EMPTY);
            extent = drawn.parts.iter().fold(extent, |b, t| b.union(bounds.transformed(*t)));
            if mode == layers::Mode::Add {
                named.extend(shared(node).map(|name| (name, bounds)));
            }
            ready.push(Some(drawn));
        }
        let pad = 0.05 * extent.size().max_element();
        let around = if extent.is_empty() { window } else { Some(Aabb::new(extent.min - pad, extent.max + pad)) };
        let mut layers: Vec<(layers::Mode, Box<dyn Source>)> = Vec::new();
        let mut run = Run::default();
        for ((node, &mode), drawn) in nodes.iter().zip(modes).zip(ready) {
            let drawn = match drawn {
                Some(drawn) => drawn,
                None => {
                    let removes = !matches!(mode, layers::Mode::Add | layers::Mode::Set | layers::Mode::Union);
                    self.node(node, if removes || layers_cut(modes) { around } else { window })?
                }
            };
            if mode == layers::Mode::Add {
                run.add(node, drawn);
                continue;
            }
            layers.extend(run.take(self.unit()).map(|s| (layers::Mode::Add, s)));
            let mut alone = Run::default();
            alone.add(node, drawn);
            layers.extend(alone.take(self.unit()).map(|s| (mode, s)));
        }
        layers.extend(run.take(self.unit()).map(|s| (layers::Mode::Add, s)));
        Ok(match layers.pop() {
            Some((layers::Mode::Add, only)) if layers.is_empty() => only,
            last => {
                layers.extend(last);
                Box::new(LayersSource::new(layers, self.unit()))
            }
        })
    }

    fn unit(&self) -> f64 {
        self.recipe.metres_per_unit.0
    }

    /// Whether a node has no end of its own.
    fn endless(&self, node: &Node) -> bool {
        let mut shape = &node.shape;
        for _ in 0..=self.recipe.define.len() {
            match shape {
                Shape::Plane(_) | Shape::HalfSpace(_) => return true,
                Shape::Use(name) => match self.recipe.define.get(name) {
                    Some(node) => shape = &node.shape,
                    None => return false,
                },
                _ => return false,
            }
        }
        false
    }

    /// A node's source, and where it is placed.
    fn node(&mut self, node: &'a Node, window: Option<Aabb>) -> Result<Drawn> {
        self.nodes += 1;
        if self.nodes > MAX_NODES {
            return Err(Error::Limit { what: "the number of nodes".into(), needed: self.nodes, allowed: MAX_NODES });
        }
        let parts = self.places(node)?;
        let own = match parts[..] {
            [only] => window.map(|w| w.transformed(only.inverse())),
            _ => None,
        };
        if self.depth >= MAX_DEPTH {
            let what = format!("more than {MAX_DEPTH} nodes lie within one another");
            return Err(Error::input(self.path, "", what));
        }
        let outside = self.repeated;
        (self.depth, self.repeated) = (self.depth + 1, outside.saturating_mul(parts.len().max(1) as u64));
        let source = self.shape(&node.shape, own);
        (self.depth, self.repeated) = (self.depth - 1, outside);
        let source = source?;
        let (colour, cuts) = node.albedo.as_ref().map(|a| self.colour(a)).transpose()?.unwrap_or_default();
        let paint = Paint {
            colour,
            cuts,
            tint: matches!(&node.albedo, Some(Either::Table(v)) if v.tint),
            opacity: node.opacity.map(|o| Arc::new(move |_| o.0) as paint::Varying<f64>),
            bump: node.bump.as_ref().map(bump),
            material: node.material.clone(),
            translucency: node.translucency.iter().map(|t| Translucency { material: None, share: t.0 }).collect(),
        };
        let source = if is_plain(node) { source } else { Box::new(PaintedSource::new(source, paint)) };
        Ok(Drawn { source: Some(source), parts })
    }

    /// Placement at which a node is drawn.
    fn places(&mut self, node: &Node) -> Result<Vec<DAffine3>> {
        let Some(scattered) = &node.scatter else { return Ok(vec![node.transform]) };
        let count = u64::from(scattered.count);
        self.held += count;
        self.copies = self.copies.saturating_add(count.saturating_mul(self.repeated));
        let memory = self.options.read.max_bytes / COPY_BYTES;
        for (what, needed, allowed) in [
            ("the number of scattered copies", self.held, memory),
            ("the number of scattered copies, each within each,", self.copies, MAX_COPIES),
        ] {
            if needed > allowed {
                return Err(Error::Limit { what: format!("{}: {what}", self.path.display()), needed, allowed });
            }
        }
        Ok(scatter::places(scattered).into_iter().map(|p| p * node.transform).collect())
    }

    fn shape(&mut self, shape: &'a Shape, window: Option<Aabb>) -> Result<Box<dyn Source>> {
        let solid = |field: Box<dyn field::Field>, window| -> Result<Box<dyn Source>> {
            Ok(Box::new(FieldSource::new(field, window)?))
        };
        match shape {
            Shape::Sphere(s) => solid(Box::new(field::Sphere { centre: s.centre.0, radius: s.radius.0 }), None),
            Shape::Ellipsoid(e) => solid(Box::new(field::Ellipsoid { centre: e.centre.0, radii: e.radii.0 }), None),
            Shape::Box(b) => parallelepiped(b),
            Shape::Cylinder(c) => {
                solid(Box::new(field::Cone { from: c.from.0, to: c.to.0, radii: [c.radius.0; 2] }), None)
            }
            Shape::Cone(c) => {
                solid(Box::new(field::Cone { from: c.from.0, to: c.to.0, radii: c.radii.map(|r| r.0) }), None)
            }
            Shape::Torus(t) => {
                let (centre, axis) = (t.centre.0, t.axis.0);
                solid(Box::new(field::Torus { centre, axis, radius: t.radius.0, thickness: t.thickness.0 }), None)
            }
            Shape::HalfSpace(p) => {
                let window = window.ok_or_else(|| self.endless_error("half_space"))?;
                solid(Box::new(field::HalfSpace { point: p.point.0, normal: p.normal.0 }), Some(window))
            }
            Shape::Plane(p) => {
                let window = window.ok_or_else(|| self.endless_error("plane"))?;
                Ok(polygon(&sheet(p, window)))
            }
            Shape::Triangle(t) => Ok(polygon(&t.corners.map(|c| c.0))),
            Shape::Line(line) => Ok(line_source(line)),
            Shape::Blade(blade) => Ok(blade_source(blade)),
            Shape::Emitter(spec) => {
                self.emitted = self.emitted.saturating_add(emitter::memory(spec));
                let (needed, allowed) = (self.emitted, self.options.read.max_bytes);
                if needed > allowed {
                    let what = format!(
                        "{}: the trajectories of emitters (raise option `memory`), in bytes,",
                        self.path.display()
                    );
                    return Err(Error::Limit { what, needed, allowed });
                }
                let strands = emitter::strands(spec)?;
                Ok(Box::new(CurveSource::new(strands, &CurveOptions::default(), 0.0, Warnings::default())))
            }
            Shape::Implicit(spec) => {
                let made = field::build(spec).and_then(|f| FieldSource::new(f, window));
                Ok(Box::new(made.map_err(|e| self.error("implicit", e.to_string()))?))
            }
            Shape::Hypertexture(spec) => {
                Hypertexture::source(spec).map_err(|e| self.error("hypertexture", e.to_string()))
            }
            Shape::Source(file) => self.file(file),
            Shape::Use(name) => self.named(name, window),
            Shape::Group(nodes) => self.drawn(nodes, window),
            Shape::Union(nodes) => self.layered(nodes, &csg(nodes.len(), layers::Mode::Union), window),
            Shape::Intersection(nodes) => self.layered(nodes, &csg(nodes.len(), layers::Mode::Multiply), window),
            Shape::Difference(nodes) => self.layered(nodes, &csg(nodes.len(), layers::Mode::Subtract), window),
        }
    }

    fn endless_error(&self, word: &str) -> Error {
        self.error(word, format!("a {word} has no end: give the recipe bounds, or cut it by another shape"))
    }

    fn named(&mut self, name: &'a str, window: Option<Aabb>) -> Result<Box<dyn Source>> {
        let quoted = format!("\"{name}\"");
        let Some(node) = self.recipe.define.get(name) else {
            let known: Vec<&str> = self.recipe.define.keys().map(String::as_str).collect();
            let known = if known.is_empty() { "nothing is".into() } else { known.join(", ") };
            return Err(self.error(&quoted, format!("'{name}' is not defined; defined: {known}")));
        };
        if self.using.contains(&name) {
            return Err(self.error(&quoted, format!("'{name}' draws itself")));
        }
        self.using.push(name);
        let drawn = self.node(node, window);
        self.using.pop();
        let Drawn { source, parts } = drawn?;
        let parts: Vec<Part> = parts.into_iter().map(|transform| Part { source: 0, transform }).collect();
        Ok(Box::new(GroupSource::new(source.into_iter().collect(), &parts, self.unit())))
    }

    /// The file that stands beside the recipe.
    fn find(&self, name: &str) -> Result<std::path::PathBuf> {
        let quoted = format!("\"{name}\"");
        super::beside(self.path, name).ok_or_else(|| self.error(&quoted, format!("the file '{name}' is not there")))
    }

    fn file(&mut self, file: &SourceFile) -> Result<Box<dyn Source>> {
        let path = self.find(&file.0.file)?;
        let quoted = format!("\"{}\"", file.0.file);
        let options =
            file.0.options(&path, self.options).map_err(|(key, what)| self.error_after(&quoted, key, what))?;
        (self.opener)(&path, &OpenOptions { depth: self.depth, copies: self.repeated, ..options })
    }

    fn colour(&self, albedo: &Albedo) -> Result<(Option<paint::Colouring>, bool)> {
        let find = |name: &str| self.find(name);
        paint_options::colour(albedo, &find, &|what| self.error("albedo", what), &self.options.read)
    }
}

/// Whether something is cut by all of the layers.
fn layers_cut(modes: &[layers::Mode]) -> bool {
    modes.contains(&layers::Mode::Multiply)
}

/// A node that is ready.
struct Drawn {
    /// `None` where its run has it by name.
    source: Option<Box<dyn Source>>,
    parts: Vec<DAffine3>,
}

/// Whether a node looks as its shape does.
fn is_plain(node: &Node) -> bool {
    let coloured = node.albedo.is_some() || node.opacity.is_some() || node.translucency.is_some();
    !coloured && node.bump.is_none() && node.material.is_none()
}

/// The name by which nodes of a run share a source.
fn shared(node: &Node) -> Option<&str> {
    match &node.shape {
        Shape::Use(name) if is_plain(node) => Some(name),
        _ => None,
    }
}

impl<'a> Run<'a> {
    fn add(&mut self, node: &'a Node, drawn: Drawn) {
        let known = shared(node).and_then(|name| self.named.get(name)).copied();
        let at = known.unwrap_or(self.sources.len());
        if known.is_none() {
            self.sources.extend(drawn.source);
            self.named.extend(shared(node).map(|name| (name, at)));
        }
        self.parts.extend(drawn.parts.into_iter().map(|transform| Part { source: at, transform }));
    }

    /// Bounds of the matter that was added; `None` where none was.
    fn take(&mut self, unit: f64) -> Option<Box<dyn Source>> {
        let run = std::mem::take(self);
        match (run.sources.len(), &run.parts[..]) {
            (0, _) => None,
            (1, [only]) if only.transform == DAffine3::IDENTITY => run.sources.into_iter().next(),
            _ => Some(Box::new(GroupSource::new(run.sources, &run.parts, unit))),
        }
    }
}

fn mode(mode: Mode) -> layers::Mode {
    match mode {
        Mode::Add => layers::Mode::Add,
        Mode::Set => layers::Mode::Set,
        Mode::Subtract => layers::Mode::Subtract,
        Mode::Multiply => layers::Mode::Multiply,
        Mode::Normals => layers::Mode::Normals,
        Mode::Opacity => layers::Mode::Opacity,
        Mode::Threshold => layers::Mode::Threshold,
    }
}

/// The first node is drawn, the others by `mode`.
fn csg(count: usize, mode: layers::Mode) -> Vec<layers::Mode> {
    let first = if mode == layers::Mode::Union { mode } else { layers::Mode::Add };
    (0..count).map(|i| if i == 0 { first } else { mode }).collect()
}

fn bump(b: &model::Bump) -> paint::Varying<DVec3> {
    let (noise, height) = (paint_options::noise(&b.noise), b.height.0);
    Arc::new(move |p| height * noise.at(p).1)
}

fn parallelepiped(b: &Box3) -> Result<Box<dyn Source>> {
    let m = b.map.matrix3;
    let size = DVec3::new(m.x_axis.x, m.y_axis.y, m.z_axis.z);
    if m == crate::geom::DMat3::from_diagonal(size) {
        let min = b.map.translation;
        let block = field::RoundedBox { min, max: min + size, round: b.round };
        return Ok(Box::new(FieldSource::new(Box::new(block), None)?));
    }
    let cube = field::RoundedBox { min: DVec3::ZERO, max: DVec3::ONE, round: 0.0 };
    let cube: Box<dyn Source> = Box::new(FieldSource::new(Box::new(cube), None)?);
    Ok(Box::new(GroupSource::new(vec![cube], &[Part { source: 0, transform: b.map }], 0.0)))
}

/// Corners of the polygon in which the plane cuts the box, in order around.
fn sheet(plane: &Plane, b: Aabb) -> Vec<DVec3> {
    let (point, n) = (plane.point.0, plane.normal.0);
    let (u, v) = n.any_orthonormal_pair();
    let mut corners = Vec::new();
    for axis in 0..3 {
        let (a, c) = ((axis + 1) % 3, (axis + 2) % 3);
        for side in 0..4 {
            let mut from = b.min;
            from[a] = if side & 1 == 0 { b.min[a] } else { b.max[a] };
            from[c] = if side & 2 == 0 { b.min[c] } else { b.max[c] };
            let t = (point - from).dot(n) / n[axis];
            if t >= 0.0 && t <= b.max[axis] - b.min[axis] {
                from[axis] += t;
                corners.push(from);
            }
        }
    }
    let middle = corners.iter().sum::<DVec3>() / corners.len().max(1) as f64;
    let angle = |p: &DVec3| libm::atan2((*p - middle).dot(v), (*p - middle).dot(u));
    corners.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    corners
}

/// A convex polygon, seen from both sides.
fn polygon(corners: &[DVec3]) -> Box<dyn Source> {
    let part = crate::scene::model::Part {
        positions: corners.iter().map(|c| c.as_vec3().to_array()).collect(),
        triangles: (2..corners.len() as u32).map(|i| [0, i - 1, i]).collect(),
        ..Default::default()
    };
    let instance = Instance { part: 0, transform: DAffine3::IDENTITY, node: String::new() };
    let model = Model {
        parts: vec![part],
        instances: vec![instance],
        materials: vec![Material::default()],
        ..Model::default()
    };
    Box::new(MeshSource::new(model, &MeshOptions::default()))
}

fn line_source(line: &Line) -> Box<dyn Source> {
    let widths = match &line.width {
        Widths::One(w) => vec![*w],
        Widths::Many(w) => w.clone(),
    };
    let strand = Strand {
        points: line.points.iter().map(|p| p.0).collect(),
        radii: widths.iter().map(|w| (0.5 * w.0) as f32).collect(),
        section: match line.section {
            LineSection::Round => Section::Round,
            LineSection::Rectangular => Section::Rectangular { thickness: line.thickness.map_or(0.0, |t| t.0 as f32) },
        },
        up: line.up.map(|u| u.0),
        ..Strand::default()
    };
    let interpolation = if line.smooth { Interpolation::CatmullRom } else { Interpolation::Linear };
    let options = CurveOptions { interpolation, ..CurveOptions::default() };
    Box::new(CurveSource::new([strand], &options, 0.0, Warnings::default()))
}

fn blade_source(blade: &Blade) -> Box<dyn Source> {
    let (from, to) = (blade.from.0, blade.to.0);
    let by = blade.by.map_or(0.5 * (from + to), |b| b.0);
    let pieces = blade.pieces.clamp(1, 1024);
    let shares = (0..=pieces).map(|i| f64::from(i) / f64::from(pieces));
    let strand = Strand {
        points: shares.clone().map(|t| (1.0 - t) * (1.0 - t) * from + 2.0 * t * (1.0 - t) * by + t * t * to).collect(),
        radii: shares.map(|t| (0.5 * (blade.width.0 + t * (blade.tip.0 - blade.width.0))) as f32).collect(),
        section: Section::V { angle: blade.angle.0.min(180.0).to_radians() as f32 },
        ..Strand::default()
    };
    Box::new(CurveSource::new([strand], &CurveOptions::default(), 0.0, Warnings::default()))
}
