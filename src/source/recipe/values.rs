//! The quantities of a recipe: numbers within bounds, points, turns and colours, each checked as it is read.

use serde::Deserialize;

use crate::geom::{DAffine3, DMat3, DVec3};

/// A plain value, or a table.
#[derive(Debug, Clone)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[cfg_attr(test, schemars(untagged))]
pub enum Either<S, T> {
    Plain(S),
    Table(T),
}

/// A finite number.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(try_from = "f64")]
#[cfg_attr(test, schemars(with = "f64"))]
pub struct Number(pub f64);

/// A number of at least 0.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(try_from = "f64")]
#[cfg_attr(test, schemars(with = "f64", extend("minimum" = 0)))]
pub struct Least0(pub f64);

/// A number above 0.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(try_from = "f64")]
#[cfg_attr(test, schemars(with = "f64", extend("exclusiveMinimum" = 0)))]
pub struct Positive(pub f64);

/// A number in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(try_from = "f64")]
#[cfg_attr(test, schemars(with = "f64", extend("minimum" = 0, "maximum" = 1)))]
pub struct Unit(pub f64);

/// Three finite numbers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(from = "[Number; 3]")]
#[cfg_attr(test, schemars(with = "[f64; 3]"))]
pub struct Point(pub DVec3);

/// Three numbers above 0.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(from = "[Positive; 3]")]
#[cfg_attr(test, schemars(with = "[f64; 3]"))]
pub struct Size(pub DVec3);

/// Three numbers, not all 0; made a unit vector.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(try_from = "Point")]
#[cfg_attr(test, schemars(with = "[f64; 3]"))]
pub struct Direction(pub DVec3);

/// One number for all axes, or one each; negative mirrors, 0 is refused.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(try_from = "OneOrThree")]
#[cfg_attr(test, schemars(with = "OneOrThree"))]
pub struct Scale(pub DVec3);

#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(untagged, expecting = "a number or three")]
pub enum OneOrThree {
    One(f64),
    Three([f64; 3]),
}

/// Degrees about x, then y, then z; or about an axis.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(try_from = "Turn")]
#[cfg_attr(test, schemars(with = "Turn"))]
pub struct Rotation(pub DMat3);

#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(untagged, expecting = "three angles in degrees, or { axis = [x, y, z], degrees = d }")]
pub enum Turn {
    Angles([f64; 3]),
    About { axis: [f64; 3], degrees: f64 },
}

/// Three or four rows of four numbers; the fourth is 0, 0, 0, 1.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(try_from = "Vec<[Number; 4]>")]
#[cfg_attr(test, schemars(with = "Vec<[f64; 4]>"))]
pub struct Matrix(pub DAffine3);

/// Linear Rec. 709 as three numbers in [0, 1], or sRGB as "#rrggbb".
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(try_from = "NumbersOrHex")]
#[cfg_attr(test, schemars(with = "NumbersOrHex"))]
pub struct Colour(pub [f32; 3]);

#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(untagged, expecting = "three numbers from 0 to 1, or a colour like \"#4c8a2e\"")]
pub enum NumbersOrHex {
    Linear([f64; 3]),
    Hex(String),
}

/// A box along the axes.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Span {
    pub min: Point,
    pub max: Point,
}
