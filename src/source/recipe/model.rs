//! Contents of a recipe file, as plain data: every number is checked as it is read, so that an error names its place.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::checked::Checked;
pub use super::file::SourceFile;
pub use super::values::{
    Colour, Direction, Either, Least0, Matrix, Number, NumbersOrHex, OneOrThree, Point, Positive, Rotation, Scale,
    Size, Span, Turn, Unit,
};
use crate::geom::{DAffine3, DMat3, DVec3};
use crate::source::emitter::EmitterSpec;
use crate::source::field::FieldSpec;
use crate::source::hypertexture::HypertextureSpec;

/// A recipe: what is drawn, in order.
#[derive(Debug, Clone, Default, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Metres in a unit of the recipe; 0: unknown.
    #[serde(default)]
    pub metres_per_unit: Least0,
    /// The box that is baked: shapes without an end are cut off there. Without it, what the shapes fill.
    pub bounds: Option<Span>,
    /// Nodes that are drawn where a node says `use`.
    #[serde(default)]
    pub define: BTreeMap<String, Node>,
    /// Nodes, each drawn onto the matter that is there by then.
    #[serde(default)]
    pub draw: Vec<Node>,
}

/// A shape (exactly one of the first keys), where it is drawn, how, and what it looks like.
#[derive(Debug, Clone, Default, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct RawNode {
    /// A polyline with a width.
    pub line: Option<Line>,
    /// A sheet without an end, cut off by the bounds.
    pub plane: Option<Plane>,
    /// All that is below a plane.
    pub half_space: Option<Plane>,
    pub sphere: Option<Sphere>,
    pub ellipsoid: Option<Ellipsoid>,
    /// A parallelepiped.
    #[serde(rename = "box")]
    pub parallelepiped: Option<Box3>,
    pub cylinder: Option<Cylinder>,
    /// A truncated cone.
    pub cone: Option<Cone>,
    pub torus: Option<Torus>,
    /// A segment of grass: two sheets that meet in a V along a parabola.
    pub blade: Option<Blade>,
    /// Particles that fly from a shape: their paths are drawn. docs/curves.md says with which keys.
    #[cfg_attr(test, schemars(with = "Option<EmitterSpec>"))]
    pub emitter: Option<Checked<EmitterSpec>>,
    pub triangle: Option<Triangle>,
    /// An implicit function: a field by its kind, as docs/fields.md has it.
    #[cfg_attr(test, schemars(with = "Option<FieldSpec>"))]
    pub implicit: Option<Checked<FieldSpec>>,
    /// A shape formed by noise, as docs/fields.md has it.
    #[cfg_attr(test, schemars(with = "Option<HypertextureSpec>"))]
    pub hypertexture: Option<Checked<HypertextureSpec>>,
    /// Any other file that can be baked, beside the recipe.
    pub source: Option<SourceFile>,
    /// The shape that the recipe defines under this name.
    #[serde(rename = "use")]
    pub reference: Option<String>,
    /// Nodes that are drawn in order, by themselves, and then onto the rest as one.
    pub group: Option<Vec<Node>>,
    /// Matter that is in any of the nodes.
    pub union: Option<Vec<Node>>,
    /// Matter that is in all of the nodes.
    pub intersection: Option<Vec<Node>>,
    /// Matter that is in the first node and in none of the others.
    pub difference: Option<Vec<Node>>,

    /// Placed in this order: scaled, turned, moved, then by the matrix.
    pub scale: Option<Scale>,
    pub rotate: Option<Rotation>,
    pub translate: Option<Point>,
    /// Three or four rows of four numbers.
    pub matrix: Option<Matrix>,
    /// Draw it many times.
    pub scatter: Option<Scatter>,
    #[serde(default)]
    pub mode: Mode,
    #[cfg_attr(test, schemars(with = "Option<Albedo>"))]
    pub albedo: Option<Checked<Albedo>>,
    /// Share that is there, in [0, 1]; of the modes `opacity` and `threshold` the value that is set or asked for.
    pub opacity: Option<Unit>,
    /// Tilts the normals as if the surface were rough.
    pub bump: Option<Bump>,
    /// Name of all its matter, whatever names it has: a landscape can restyle it by this name.
    #[cfg_attr(test, schemars(extend("minLength" = 1)))]
    pub material: Option<String>,
    /// Share of the light that comes through, as through leaves, where the shape says nothing of it; at most 0.9.
    pub translucency: Option<Unit>,
}

/// Operation by which a node is drawn onto the matter that is there.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Both are there.
    #[default]
    Add,
    /// Matter within the shape is removed first.
    Set,
    /// Matter within the shape is removed; the cut is closed.
    Subtract,
    /// Matter outside of the shape is removed; the cut is closed.
    Multiply,
    /// Matter within the shape gets the shape's normals.
    Normals,
    /// Matter within the shape keeps `opacity` of what it covers.
    Opacity,
    /// Matter within the shape stays where it is at least as opaque as `opacity`, and goes elsewhere.
    Threshold,
}

/// A node with its one shape.
#[derive(Debug, Clone, Deserialize)]
#[serde(try_from = "RawNode")]
pub struct Node {
    pub shape: Shape,
    pub transform: DAffine3,
    pub scatter: Option<Scatter>,
    pub mode: Mode,
    pub albedo: Option<Albedo>,
    pub opacity: Option<Unit>,
    pub bump: Option<Bump>,
    pub material: Option<String>,
    pub translucency: Option<Unit>,
}

#[cfg(test)]
impl schemars::JsonSchema for Node {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Node".into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        RawNode::json_schema(generator)
    }
}

#[derive(Debug, Clone)]
pub enum Shape {
    Line(Line),
    Plane(Plane),
    HalfSpace(Plane),
    Sphere(Sphere),
    Ellipsoid(Ellipsoid),
    Box(Box3),
    Cylinder(Cylinder),
    Cone(Cone),
    Torus(Torus),
    Blade(Blade),
    Emitter(Box<EmitterSpec>),
    Triangle(Triangle),
    Implicit(Box<FieldSpec>),
    Hypertexture(Box<HypertextureSpec>),
    Source(Box<SourceFile>),
    Use(String),
    Group(Vec<Node>),
    Union(Vec<Node>),
    Intersection(Vec<Node>),
    Difference(Vec<Node>),
}

/// Keys of shapes, for messages.
const SHAPES: &str = "line, plane, half_space, sphere, ellipsoid, box, cylinder, cone, torus, blade, emitter, triangle, implicit, hypertexture, source, use, \
                      group, union, intersection or difference";

impl TryFrom<RawNode> for Node {
    type Error = String;

    fn try_from(raw: RawNode) -> Result<Node, String> {
        let shapes = [
            raw.line.map(Shape::Line),
            raw.plane.map(Shape::Plane),
            raw.half_space.map(Shape::HalfSpace),
            raw.sphere.map(Shape::Sphere),
            raw.ellipsoid.map(Shape::Ellipsoid),
            raw.parallelepiped.map(Shape::Box),
            raw.cylinder.map(Shape::Cylinder),
            raw.cone.map(Shape::Cone),
            raw.torus.map(Shape::Torus),
            raw.blade.map(Shape::Blade),
            raw.emitter.map(|e| Shape::Emitter(Box::new(e.0))),
            raw.triangle.map(Shape::Triangle),
            raw.implicit.map(|f| Shape::Implicit(Box::new(f.0))),
            raw.hypertexture.map(|h| Shape::Hypertexture(Box::new(h.0))),
            raw.source.map(|f| Shape::Source(Box::new(f))),
            raw.reference.map(Shape::Use),
            raw.group.map(Shape::Group),
            raw.union.map(Shape::Union),
            raw.intersection.map(Shape::Intersection),
            raw.difference.map(Shape::Difference),
        ];
        let mut shapes = shapes.into_iter().flatten();
        let shape = shapes.next().ok_or_else(|| format!("a node needs a shape: {SHAPES}"))?;
        if shapes.next().is_some() {
            return Err("a node has one shape; this one has several".into());
        }
        if let Shape::Union(nodes) | Shape::Intersection(nodes) | Shape::Difference(nodes) = &shape {
            if nodes.is_empty() {
                return Err("needs at least one node".into());
            }
            if nodes.iter().any(|n| n.mode != Mode::Add) {
                return Err("nodes of a union, an intersection or a difference have no mode".into());
            }
        }
        if raw.material.as_ref().is_some_and(String::is_empty) {
            return Err("a material has a name".into());
        }
        if raw.translucency.is_some_and(|t| t.0 > 0.9) {
            return Err("a translucency is at most 0.9".into());
        }
        if matches!(raw.mode, Mode::Opacity | Mode::Threshold) && raw.opacity.is_none() {
            return Err("the modes opacity and threshold need an opacity".into());
        }
        let scale = DMat3::from_diagonal(raw.scale.map_or(DVec3::ONE, |s| s.0));
        let turn = raw.rotate.map_or(DMat3::IDENTITY, |r| r.0);
        let moved = raw.translate.map_or(DVec3::ZERO, |t| t.0);
        let placed = DAffine3::from_mat3_translation(turn * scale, moved);
        let transform = raw.matrix.map_or(placed, |m| m.0 * placed);
        Ok(Node {
            shape,
            transform,
            scatter: raw.scatter,
            mode: raw.mode,
            albedo: raw.albedo.map(|a| a.0),
            opacity: raw.opacity,
            bump: raw.bump,
            material: raw.material,
            translucency: raw.translucency,
        })
    }
}

#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// Two or more.
    pub points: Vec<Point>,
    /// All along, or one per point.
    pub width: Widths,
    #[serde(default)]
    pub section: LineSection,
    /// Other side of a rectangular section as a share of its width; 0: a sheet.
    pub thickness: Option<Unit>,
    /// Direction that the flat side of a rectangular section faces.
    pub up: Option<Direction>,
    /// Run smoothly through the points (centripetal Catmull-Rom) and not straight.
    #[serde(default)]
    pub smooth: bool,
}

#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(untagged, expecting = "a width of at least 0, or a list of them")]
pub enum Widths {
    One(Least0),
    Many(Vec<Least0>),
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum LineSection {
    #[default]
    Round,
    Rectangular,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Plane {
    pub point: Point,
    /// Out of the matter, where there is any.
    pub normal: Direction,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Sphere {
    #[serde(default)]
    pub centre: Point,
    pub radius: Positive,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Ellipsoid {
    #[serde(default)]
    pub centre: Point,
    pub radii: Size,
}

/// Either `min` and `max`, or `centre` and `size`, or `corner` and three `edges`.
#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(try_from = "RawBox")]
#[cfg_attr(test, schemars(with = "RawBox"))]
pub struct Box3 {
    /// The unit cube → the box.
    pub map: DAffine3,
    /// Radius of the edges, for boxes along the axes.
    pub round: f64,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct RawBox {
    pub min: Option<Point>,
    pub max: Option<Point>,
    pub centre: Option<Point>,
    pub size: Option<Size>,
    pub corner: Option<Point>,
    pub edges: Option<[Point; 3]>,
    /// Radius of rounded edges, at most half the shortest edge; not with `edges`.
    #[serde(default)]
    pub round: Least0,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Cylinder {
    pub from: Point,
    pub to: Point,
    pub radius: Positive,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Cone {
    pub from: Point,
    pub to: Point,
    /// At `from` and at `to`.
    pub radii: [Least0; 2],
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Torus {
    #[serde(default)]
    pub centre: Point,
    pub axis: Direction,
    pub radius: Positive,
    /// Radius of the ring itself.
    pub thickness: Positive,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Blade {
    pub from: Point,
    pub to: Point,
    /// Point that the parabola's ends point to (its control point); without it the blade is straight.
    pub by: Option<Point>,
    /// At the root; at the tip it is `tip`.
    pub width: Positive,
    #[serde(default)]
    pub tip: Least0,
    /// Between the sheets, in degrees, up to 180.
    #[serde(default = "right_angle")]
    pub angle: Positive,
    /// Pieces that the parabola is drawn with.
    #[serde(default = "eight")]
    pub pieces: u16,
}

fn right_angle() -> Positive {
    Positive(90.0)
}

fn eight() -> u16 {
    8
}

#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Triangle {
    pub corners: [Point; 3],
}

/// Copies at random, the same for the same seed.
#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Scatter {
    pub count: u32,
    /// Box of the copies' origins; flat where min and max agree.
    pub min: Point,
    pub max: Point,
    /// Only within the ellipse in the box, and not in its corners.
    #[serde(default)]
    pub round: bool,
    /// Least distance between origins: copies that find no place after a number of trials are left out.
    #[serde(default)]
    pub apart: Least0,
    #[serde(default)]
    pub seed: u64,
    /// Each is turned about `axis` by up to half of so many degrees either way.
    #[serde(default = "full_turn")]
    pub turn: Least0,
    /// Each is tilted by up to so many degrees.
    #[serde(default)]
    pub tilt: Least0,
    #[serde(default = "up")]
    pub axis: Direction,
    /// Least and largest size.
    #[serde(default = "same_size")]
    pub scale: [Positive; 2],
}

fn full_turn() -> Least0 {
    Least0(360.0)
}

fn up() -> Direction {
    Direction(DVec3::Y)
}

fn same_size() -> [Positive; 2] {
    [Positive(1.0); 2]
}

/// A colour, or what it varies by. It replaces the colours that the shape has.
pub type Albedo = Either<Colour, Varied>;

/// Exactly one of `image`, `noise` and `gradient`, the last two with `colours`.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Varied {
    /// A picture beside the recipe.
    pub image: Option<String>,
    /// Projection by which the picture is laid on.
    #[serde(default)]
    pub projection: Projection,
    /// Point at which the picture begins: the plane's corner, or the middle of the cylinder or the sphere.
    #[serde(default)]
    pub origin: Point,
    /// The plane's normal, or the axis of the cylinder or the sphere.
    #[serde(default = "up")]
    pub axis: Direction,
    /// Width and height of the picture on a plane; its height on a cylinder (the width goes round).
    #[serde(default = "unit_size")]
    pub size: [Positive; 2],
    /// Colours by the value of noise.
    pub noise: Option<Noise>,
    /// Colours along a line.
    pub gradient: Option<Gradient>,
    /// Colours of the noise or the gradient, evenly spaced from its low end to its high end.
    #[serde(default)]
    pub colours: Vec<Colour>,
    /// Multiply the colours that the shape has, and don't replace them.
    #[serde(default)]
    pub tint: bool,
}

fn unit_size() -> [Positive; 2] {
    [Positive(1.0); 2]
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum Projection {
    #[default]
    Planar,
    Cylindrical,
    Spherical,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Gradient {
    pub from: Point,
    pub to: Point,
}

/// Gradient noise in three dimensions.
#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Noise {
    /// Width of its largest features.
    pub scale: Positive,
    /// Each of half the width and half the strength of the one before; up to 10.
    #[serde(default = "one_octave")]
    pub octaves: u8,
    #[serde(default)]
    pub seed: u32,
    /// Sum the octaves' absolute values.
    #[serde(default)]
    pub turbulence: bool,
}

fn one_octave() -> u8 {
    1
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Bump {
    pub noise: Noise,
    /// Height of the roughness, in the recipe's unit.
    pub height: Positive,
}
