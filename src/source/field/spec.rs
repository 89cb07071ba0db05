//! Fields as they are written in recipes, and how they are built.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

use super::{
    Bone, Capsule, Coloured, Cone, Csg, Element, Ellipsoid, Field, Grown, HalfSpace, Kernel, Operation, Placed, Plane,
    RoundedBox, Skeleton, Sphere, Torus, Triangle,
};
use crate::geom::{DAffine3, DMat3, DVec3};
use crate::source::hypertexture::{Hypertexture, HypertextureSpec};
use crate::{Error, Result};

type Point = [f64; 3];

/// A shape, and what is done with it: grown or hollowed, coloured, then scaled, turned and moved.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema), schemars(extend("unevaluatedProperties" = false)))]
pub struct FieldSpec {
    /// The shape.
    #[serde(flatten)]
    pub shape: Shape,
    /// The operation done with it.
    #[serde(flatten)]
    pub change: Change,
}

/// Properties that every shape may have.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct Change {
    /// Matter is added all around, or with a number below 0 taken away, in source units.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grow: Option<f64>,
    /// Only a skin of this thickness about the surface.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub skin: Option<f64>,
    /// Colour of the whole shape.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub colour: Option<Colour>,
    /// A factor, or one per axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<Scale>,
    /// Degrees about x, then y, then z.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotate: Option<Point>,
    /// Shift, in source units.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub translate: Option<Point>,
}

const CHANGES: [&str; 6] = ["grow", "skin", "colour", "scale", "rotate", "translate"];

/// Scale of a shape: one number, or one per axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(untagged)]
pub enum Scale {
    /// One factor for all axes.
    Even(f64),
    /// Factors along x, y and z.
    Axes(Point),
}

/// A colour: "#rrggbb" in sRGB, or linear red, green and blue in [0, 1].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(untagged)]
pub enum Colour {
    /// Linear Rec. 709, each in [0, 1].
    Linear([f32; 3]),
    /// "#rrggbb", sRGB.
    Hex(String),
}

impl Colour {
    /// Linear Rec. 709.
    ///
    /// # Errors
    /// [`Error::Options`] where it is no colour.
    pub fn linear(&self) -> Result<[f32; 3]> {
        match self {
            Colour::Linear(c) if c.iter().all(|v| (0.0..=1.0).contains(v)) => Ok(*c),
            Colour::Linear(c) => Err(Error::Options(format!("colour {c:?}: linear components are 0 to 1"))),
            Colour::Hex(text) => {
                let digits = text.strip_prefix('#').filter(|d| d.len() == 6 && d.is_ascii());
                let code = digits.and_then(|d| u32::from_str_radix(d, 16).ok());
                let code = code.ok_or_else(|| Error::Options(format!("colour \"{text}\": #rrggbb is wanted")))?;
                let linear = |v: u32| {
                    let v = f64::from(v & 255) / 255.0;
                    (if v <= 0.04045 { v / 12.92 } else { libm::pow((v + 0.055) / 1.055, 2.4) }) as f32
                };
                Ok([linear(code >> 16), linear(code >> 8), linear(code)])
            }
        }
    }
}

/// A shape by its kind. Lengths are in source units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Shape {
    /// A ball.
    Sphere {
        /// Middle of the ball.
        #[serde(default)]
        centre: Point,
        /// Radius, > 0.
        radius: f64,
    },
    /// An ellipsoid along the axes.
    Ellipsoid {
        /// Middle of the ellipsoid.
        #[serde(default)]
        centre: Point,
        /// Half its extent along x, y and z, each > 0.
        radii: Point,
    },
    /// A box along the axes.
    Box {
        /// Lower corner.
        min: Point,
        /// Upper corner.
        max: Point,
        /// Radius of the edges.
        #[serde(default)]
        round: f64,
    },
    /// A cylinder with flat ends.
    Cylinder {
        /// Middle of one end.
        from: Point,
        /// Middle of the other end.
        to: Point,
        /// Radius, > 0.
        radius: f64,
    },
    /// Truncated where both radii are above 0.
    Cone {
        /// Middle of one end.
        from: Point,
        /// Middle of the other end.
        to: Point,
        /// Radius at either end, ≥ 0; one of them > 0.
        radii: [f64; 2],
    },
    /// A cylinder with a half-ball at each end.
    Capsule {
        /// One end of its axis.
        from: Point,
        /// The other end of its axis.
        to: Point,
        /// Radius, > 0.
        radius: f64,
    },
    /// A ring.
    Torus {
        /// Middle of the ring.
        #[serde(default)]
        centre: Point,
        /// Direction through the hole; its length does not count.
        #[serde(default = "upward")]
        axis: Point,
        /// Radius of the circle along which the ring runs.
        radius: f64,
        /// Radius of the ring itself.
        thickness: f64,
    },
    /// Everything on one side of a plane.
    HalfSpace {
        /// A point of the plane.
        #[serde(default)]
        point: Point,
        /// Direction out of the matter; its length does not count.
        #[serde(default = "upward")]
        normal: Point,
    },
    /// A plate without borders.
    Plane {
        /// A point in its middle.
        #[serde(default)]
        point: Point,
        /// Direction across the plate; its length does not count.
        #[serde(default = "upward")]
        normal: Point,
        /// Thickness, > 0.
        thickness: f64,
    },
    /// A triangular plate with rounded edges.
    Triangle {
        /// Corners in its middle.
        corners: [Point; 3],
        /// Thickness, > 0.
        thickness: f64,
    },
    /// Everything that is in one of several shapes.
    Union {
        /// Shapes, at least one.
        of: Vec<FieldSpec>,
        /// Width over which shapes blend; 0: sharp.
        #[serde(default)]
        smooth: f64,
    },
    /// Everything that is in all of several shapes.
    Intersection {
        /// Shapes, at least one.
        of: Vec<FieldSpec>,
        /// Width over which shapes blend; 0: sharp.
        #[serde(default)]
        smooth: f64,
    },
    /// The first shape without the others.
    Difference {
        /// Shapes, at least one.
        of: Vec<FieldSpec>,
        /// Width over which edges are rounded; 0: sharp.
        #[serde(default)]
        smooth: f64,
    },
    /// A soft surface around bones, which merge where they meet.
    Skeleton {
        /// Bones, at least one.
        elements: Vec<ElementSpec>,
        /// Law by which the potential falls with the distance.
        #[serde(default)]
        kernel: KernelSpec,
        /// Reach of the kernels gaussian and wyvill.
        #[serde(default = "one")]
        radius: f64,
        /// Potential of the surface.
        #[serde(default)]
        level: Option<f64>,
    },
    /// A shape formed by noise.
    Hypertexture(Box<HypertextureSpec>),
}

fn upward() -> Point {
    [0.0, 1.0, 0.0]
}

fn one() -> f64 {
    1.0
}

/// A bone: one of point, segment and triangle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ElementSpec {
    /// A point.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point: Option<Point>,
    /// The line between two points.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segment: Option<[Point; 2]>,
    /// The area between three corners.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub triangle: Option<[Point; 3]>,
    /// Factor of its potential; below 0 it takes matter away.
    #[serde(default = "one")]
    pub weight: f64,
    /// Colour near it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colour: Option<Colour>,
}

/// Law by which the potential of a bone falls with the distance d.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum KernelSpec {
    /// 1 / d².
    #[default]
    InverseSquare,
    /// e^(−d² / radius²).
    Gaussian,
    /// (1 − d² / radius²)³, and 0 from the radius on.
    Wyvill,
}

impl<'de> Deserialize<'de> for FieldSpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<FieldSpec, D::Error> {
        let mut shape = serde_json::Map::deserialize(deserializer)?;
        let mut change = serde_json::Map::new();
        for key in CHANGES {
            if let Some(value) = shape.remove(key) {
                change.insert(key.into(), value);
            }
        }
        Ok(FieldSpec {
            shape: serde_json::from_value(shape.into()).map_err(D::Error::custom)?,
            change: serde_json::from_value(change.into()).map_err(D::Error::custom)?,
        })
    }
}

/// The field that `spec` describes.
///
/// # Errors
/// [`Error::Options`] on lengths that are no lengths, directions of no length, flattening transforms and missing parts.
pub fn build(spec: &FieldSpec) -> Result<Box<dyn Field>> {
    let mut field = shape(&spec.shape)?;
    let change = &spec.change;
    if change.grow.is_some() || change.skin.is_some() {
        let by = finite("grow", change.grow.unwrap_or(0.0))?;
        let skin = change.skin.map_or(Ok(0.0), |s| positive("skin", s))?;
        field = Box::new(Grown { field, by, skin });
    }
    if let Some(colour) = &change.colour {
        field = Box::new(Coloured { field, colour: colour.linear()? });
    }
    match change.transform()? {
        Some(map) => {
            let placed = Placed::new(field, map);
            Ok(Box::new(placed.ok_or_else(|| wrong("scale", "a shape cannot be scaled to nothing"))?))
        }
        None => Ok(field),
    }
}

impl Change {
    /// Scale, then rotation, then translation; `None` where nothing is said.
    ///
    /// # Errors
    /// [`Error::Options`] where a number is not finite.
    pub fn transform(&self) -> Result<Option<DAffine3>> {
        if self.scale.is_none() && self.rotate.is_none() && self.translate.is_none() {
            return Ok(None);
        }
        let scale = match self.scale {
            Some(Scale::Even(s)) => DVec3::splat(s),
            Some(Scale::Axes(s)) => DVec3::from(s),
            None => DVec3::ONE,
        };
        let turn = |degrees: f64| {
            let angle = degrees.rem_euclid(360.0).to_radians();
            (libm::cos(angle), libm::sin(angle))
        };
        let [(cx, sx), (cy, sy), (cz, sz)] = self.rotate.unwrap_or_default().map(turn);
        let rx = DMat3::from_cols(DVec3::X, DVec3::new(0.0, cx, sx), DVec3::new(0.0, -sx, cx));
        let ry = DMat3::from_cols(DVec3::new(cy, 0.0, -sy), DVec3::Y, DVec3::new(sy, 0.0, cy));
        let rz = DMat3::from_cols(DVec3::new(cz, sz, 0.0), DVec3::new(-sz, cz, 0.0), DVec3::Z);
        let matrix3 = rz * ry * rx * DMat3::from_diagonal(scale);
        let translation = DVec3::from(self.translate.unwrap_or_default());
        if !matrix3.is_finite() || !translation.is_finite() {
            return Err(wrong("scale, rotate, translate", "finite numbers are wanted"));
        }
        Ok(Some(DAffine3 { matrix3, translation }))
    }
}

fn wrong(key: &str, what: &str) -> Error {
    Error::Options(format!("{key}: {what}"))
}

fn finite(key: &str, v: f64) -> Result<f64> {
    if v.is_finite() { Ok(v) } else { Err(wrong(key, &format!("{v} is not a finite number"))) }
}

fn positive(key: &str, v: f64) -> Result<f64> {
    if v > 0.0 && v.is_finite() { Ok(v) } else { Err(wrong(key, &format!("{v}: a number above 0 is wanted"))) }
}

fn not_negative(key: &str, v: f64) -> Result<f64> {
    if v >= 0.0 && v.is_finite() { Ok(v) } else { Err(wrong(key, &format!("{v}: 0 or a number above is wanted"))) }
}

fn point(key: &str, p: Point) -> Result<DVec3> {
    let p = DVec3::from(p);
    if p.is_finite() { Ok(p) } else { Err(wrong(key, "three finite numbers are wanted")) }
}

fn direction(key: &str, p: Point) -> Result<DVec3> {
    point(key, p)?.try_normalize().ok_or_else(|| wrong(key, "a direction has a length"))
}

/// Two points that are apart.
fn segment(from: Point, to: Point) -> Result<(DVec3, DVec3)> {
    let (from, to) = (point("from", from)?, point("to", to)?);
    if from == to { Err(wrong("from, to", "both are the same point")) } else { Ok((from, to)) }
}

fn triangle(key: &str, corners: [Point; 3]) -> Result<[DVec3; 3]> {
    let [a, b, c] = corners;
    Ok([point(key, a)?, point(key, b)?, point(key, c)?])
}

fn parts(operation: Operation, of: &[FieldSpec], smooth: f64) -> Result<Box<dyn Field>> {
    if of.is_empty() {
        return Err(wrong("of", "there is nothing to join"));
    }
    let parts = of.iter().map(build).collect::<Result<Vec<_>>>()?;
    Ok(Box::new(Csg::new(operation, parts, not_negative("smooth", smooth)?)))
}

fn rounded_box(min: Point, max: Point, round: f64) -> Result<RoundedBox> {
    let (min, max) = (point("min", min)?, point("max", max)?);
    let least = (max - min).min_element();
    positive("max − min", least)?;
    let round = not_negative("round", round)?;
    if round > 0.5 * least {
        return Err(wrong("round", &format!("{round}: at most half the shortest edge, {}", 0.5 * least)));
    }
    Ok(RoundedBox { min, max, round })
}

/// `level`: potential of the surface; where there is none, the kernel's usual one.
fn skeleton(elements: &[ElementSpec], kernel: KernelSpec, radius: f64, level: Option<f64>) -> Result<Skeleton> {
    if elements.is_empty() {
        return Err(wrong("elements", "a skeleton has a point, a segment or a triangle at least"));
    }
    let elements = elements.iter().map(element).collect::<Result<Vec<_>>>()?;
    let radius = positive("radius", radius)?;
    let (kernel, usual) = match kernel {
        KernelSpec::InverseSquare => (Kernel::InverseSquare, 1.0),
        KernelSpec::Gaussian => (Kernel::Gaussian { radius }, 0.5),
        KernelSpec::Wyvill => (Kernel::Wyvill { radius }, 0.5),
    };
    Ok(Skeleton::new(elements, kernel, positive("level", level.unwrap_or(usual))?))
}

fn shape(shape: &Shape) -> Result<Box<dyn Field>> {
    Ok(match shape {
        Shape::Sphere { centre, radius } => {
            Box::new(Sphere { centre: point("centre", *centre)?, radius: positive("radius", *radius)? })
        }
        Shape::Ellipsoid { centre, radii } => {
            let [x, y, z] = *radii;
            let radii = DVec3::new(positive("radii", x)?, positive("radii", y)?, positive("radii", z)?);
            Box::new(Ellipsoid { centre: point("centre", *centre)?, radii })
        }
        Shape::Box { min, max, round } => Box::new(rounded_box(*min, *max, *round)?),
        Shape::Cylinder { from, to, radius } => {
            let (from, to) = segment(*from, *to)?;
            Box::new(Cone { from, to, radii: [positive("radius", *radius)?; 2] })
        }
        Shape::Cone { from, to, radii } => {
            let (from, to) = segment(*from, *to)?;
            let radii = [not_negative("radii", radii[0])?, not_negative("radii", radii[1])?];
            positive("the greater of radii", radii[0].max(radii[1]))?;
            Box::new(Cone { from, to, radii })
        }
        Shape::Capsule { from, to, radius } => Box::new(Capsule {
            from: point("from", *from)?,
            to: point("to", *to)?,
            radius: positive("radius", *radius)?,
        }),
        Shape::Torus { centre, axis, radius, thickness } => Box::new(Torus {
            centre: point("centre", *centre)?,
            axis: direction("axis", *axis)?,
            radius: positive("radius", *radius)?,
            thickness: positive("thickness", *thickness)?,
        }),
        Shape::HalfSpace { point: at, normal } => {
            Box::new(HalfSpace { point: point("point", *at)?, normal: direction("normal", *normal)? })
        }
        Shape::Plane { point: at, normal, thickness } => Box::new(Plane {
            point: point("point", *at)?,
            normal: direction("normal", *normal)?,
            thickness: positive("thickness", *thickness)?,
        }),
        Shape::Triangle { corners, thickness } => Box::new(Triangle {
            corners: triangle("corners", *corners)?,
            thickness: positive("thickness", *thickness)?,
        }),
        Shape::Union { of, smooth } => parts(Operation::Union, of, *smooth)?,
        Shape::Intersection { of, smooth } => parts(Operation::Intersection, of, *smooth)?,
        Shape::Difference { of, smooth } => parts(Operation::Difference, of, *smooth)?,
        Shape::Skeleton { elements, kernel, radius, level } => Box::new(skeleton(elements, *kernel, *radius, *level)?),
        Shape::Hypertexture(spec) => Box::new(Hypertexture::new(spec)?),
    })
}

fn element(spec: &ElementSpec) -> Result<Element> {
    let bone = match (spec.point, spec.segment, spec.triangle) {
        (Some(p), None, None) => Bone::Point(point("point", p)?),
        (None, Some([a, b]), None) => Bone::Segment([point("segment", a)?, point("segment", b)?]),
        (None, None, Some(t)) => Bone::Triangle(triangle("triangle", t)?),
        _ => return Err(wrong("elements", "each is one of point, segment and triangle")),
    };
    let weight = finite("weight", spec.weight)?;
    if weight == 0.0 {
        return Err(wrong("weight", "0 has no effect"));
    }
    Ok(Element { bone, weight, colour: spec.colour.as_ref().map(Colour::linear).transpose()? })
}
