//! The checks of a recipe's numbers, as they are read.

use std::marker::PhantomData;

use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserialize, Deserializer, IntoDeserializer, MapAccess, SeqAccess, Visitor};

use super::checked::Check;
use super::model::{
    Albedo, Box3, Colour, Direction, Either, Least0, Matrix, Number, NumbersOrHex, OneOrThree, Point, Positive, RawBox,
    Rotation, Scale, Size, Turn, Unit,
};
use crate::geom::{DAffine3, DMat3, DVec3};
use crate::scene::texture::srgb_to_linear;
use crate::source::emitter;
use crate::source::emitter::EmitterSpec;
use crate::source::field;
use crate::source::field::FieldSpec;
use crate::source::hypertexture::{Hypertexture, HypertextureSpec};

impl<'de, S: Deserialize<'de>, T: Deserialize<'de>> Deserialize<'de> for Either<S, T> {
    /// By the kind of what comes, and not by trial: so an error within a table keeps its place.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Kinds<S, T>(PhantomData<(S, T)>);

        impl<'de, S: Deserialize<'de>, T: Deserialize<'de>> Visitor<'de> for Kinds<S, T> {
            type Value = Either<S, T>;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a value or a table")
            }

            fn visit_f64<E: serde::de::Error>(self, v: f64) -> Result<Self::Value, E> {
                S::deserialize(v.into_deserializer()).map(Either::Plain)
            }

            fn visit_i64<E: serde::de::Error>(self, v: i64) -> Result<Self::Value, E> {
                S::deserialize(v.into_deserializer()).map(Either::Plain)
            }

            fn visit_u64<E: serde::de::Error>(self, v: u64) -> Result<Self::Value, E> {
                S::deserialize(v.into_deserializer()).map(Either::Plain)
            }

            fn visit_str<E: serde::de::Error>(self, v: &str) -> Result<Self::Value, E> {
                S::deserialize(v.into_deserializer()).map(Either::Plain)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Self::Value, A::Error> {
                S::deserialize(SeqAccessDeserializer::new(seq)).map(Either::Plain)
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
                T::deserialize(MapAccessDeserializer::new(map)).map(Either::Table)
            }
        }

        deserializer.deserialize_any(Kinds(PhantomData))
    }
}

impl Check for EmitterSpec {
    fn check(&self) -> Result<(), String> {
        emitter::check(self).map_err(|e| e.to_string())
    }
}

impl Check for FieldSpec {
    fn check(&self) -> Result<(), String> {
        field::build(self).map(|_| ()).map_err(|e| e.to_string())
    }
}

impl Check for HypertextureSpec {
    fn check(&self) -> Result<(), String> {
        Hypertexture::new(self).map(|_| ()).map_err(|e| e.to_string())
    }
}

impl Check for Albedo {
    fn check(&self) -> Result<(), String> {
        let Either::Table(v) = self else { return Ok(()) };
        match (&v.image, &v.gradient, &v.noise, v.colours.is_empty()) {
            (Some(_), None, None, _) | (None, Some(_), None, false) | (None, None, Some(_), false) => Ok(()),
            _ => Err("an albedo is a colour, or has either an image, or noise or a gradient and its colours".into()),
        }
    }
}

impl TryFrom<f64> for Number {
    type Error = String;

    fn try_from(v: f64) -> Result<Number, String> {
        if v.is_finite() { Ok(Number(v)) } else { Err(format!("{v} is not a finite number")) }
    }
}

impl TryFrom<f64> for Least0 {
    type Error = String;

    fn try_from(v: f64) -> Result<Least0, String> {
        if v.is_finite() && v >= 0.0 { Ok(Least0(v)) } else { Err(format!("{v} is not a number of at least 0")) }
    }
}

impl TryFrom<f64> for Positive {
    type Error = String;

    fn try_from(v: f64) -> Result<Positive, String> {
        if v.is_finite() && v > 0.0 { Ok(Positive(v)) } else { Err(format!("{v} is not a number above 0")) }
    }
}

impl TryFrom<f64> for Unit {
    type Error = String;

    fn try_from(v: f64) -> Result<Unit, String> {
        if (0.0..=1.0).contains(&v) { Ok(Unit(v)) } else { Err(format!("{v} is not a number from 0 to 1")) }
    }
}

impl From<[Number; 3]> for Point {
    fn from(v: [Number; 3]) -> Point {
        Point(DVec3::from(v.map(|n| n.0)))
    }
}

impl From<[Positive; 3]> for Size {
    fn from(v: [Positive; 3]) -> Size {
        Size(DVec3::from(v.map(|n| n.0)))
    }
}

impl TryFrom<Point> for Direction {
    type Error = String;

    fn try_from(p: Point) -> Result<Direction, String> {
        // By the largest number first: squares of tiny ones are 0.
        let largest = p.0.abs().max_element();
        (p.0 / largest).try_normalize().map(Direction).ok_or_else(|| "a direction cannot be 0, 0, 0".into())
    }
}

fn finite(v: [f64; 3]) -> Result<DVec3, String> {
    let v = DVec3::from(v);
    if v.is_finite() { Ok(v) } else { Err("numbers have to be finite".into()) }
}

impl TryFrom<OneOrThree> for Scale {
    type Error = String;

    fn try_from(v: OneOrThree) -> Result<Scale, String> {
        let v = finite(match v {
            OneOrThree::One(s) => [s; 3],
            OneOrThree::Three(s) => s,
        })?;
        if v.abs().min_element() > 0.0 { Ok(Scale(v)) } else { Err("a scale of 0 leaves nothing".into()) }
    }
}

impl TryFrom<Turn> for Rotation {
    type Error = String;

    fn try_from(v: Turn) -> Result<Rotation, String> {
        Ok(Rotation(match v {
            Turn::Angles(degrees) => {
                let [x, y, z] = finite(degrees)?.map(f64::to_radians).to_array();
                about(DVec3::Z, z) * about(DVec3::Y, y) * about(DVec3::X, x)
            }
            Turn::About { axis, degrees } => {
                let axis = Direction::try_from(Point(finite(axis)?))?;
                about(axis.0, Number::try_from(degrees)?.0.to_radians())
            }
        }))
    }
}

/// A turn about a unit axis: the same on every machine.
pub fn about(axis: DVec3, radians: f64) -> DMat3 {
    let (s, c) = (libm::sin(radians), libm::cos(radians));
    let column = |e: DVec3| c * e + s * axis.cross(e) + (1.0 - c) * axis.dot(e) * axis;
    DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z))
}

impl TryFrom<Vec<[Number; 4]>> for Matrix {
    type Error = String;

    fn try_from(rows: Vec<[Number; 4]>) -> Result<Matrix, String> {
        let (rows, last) = match &rows[..] {
            [a, b, c] => ([a, b, c], None),
            [a, b, c, d] => ([a, b, c], Some(d.map(|n| n.0))),
            _ => return Err("a matrix has three or four rows".into()),
        };
        if last.is_some_and(|d| d != [0.0, 0.0, 0.0, 1.0]) {
            return Err("the fourth row of a matrix is 0, 0, 0, 1".into());
        }
        let column = |j: usize| DVec3::new(rows[0][j].0, rows[1][j].0, rows[2][j].0);
        let map = DAffine3::from_cols(column(0), column(1), column(2), column(3));
        if map.matrix3.determinant().abs() > 0.0 { Ok(Matrix(map)) } else { Err("the matrix flattens all".into()) }
    }
}

impl TryFrom<NumbersOrHex> for Colour {
    type Error = String;

    fn try_from(v: NumbersOrHex) -> Result<Colour, String> {
        match v {
            NumbersOrHex::Linear(rgb) if rgb.iter().all(|v| (0.0..=1.0).contains(v)) => {
                Ok(Colour(rgb.map(|v| v as f32)))
            }
            NumbersOrHex::Linear(_) => Err("a colour's numbers are from 0 to 1".into()),
            NumbersOrHex::Hex(text) => {
                let digits =
                    text.strip_prefix('#').filter(|d| d.len() == 6 && d.bytes().all(|b| b.is_ascii_hexdigit()));
                let code = digits.and_then(|d| u32::from_str_radix(d, 16).ok());
                let code = code.ok_or_else(|| format!("'{text}' is not a colour like #4c8a2e"))?;
                Ok(Colour([16, 8, 0].map(|shift| srgb_to_linear((code >> shift & 255) as u8))))
            }
        }
    }
}

impl TryFrom<RawBox> for Box3 {
    type Error = String;

    fn try_from(raw: RawBox) -> Result<Box3, String> {
        let along = |min: DVec3, size: DVec3| DAffine3::from_mat3_translation(DMat3::from_diagonal(size), min);
        let map = match raw {
            RawBox { min: Some(min), max: Some(max), centre: None, size: None, corner: None, edges: None, .. } => {
                along(min.0, max.0 - min.0)
            }
            RawBox { size: Some(size), min: None, max: None, corner: None, edges: None, centre, .. } => {
                along(centre.map_or(DVec3::ZERO, |c| c.0) - 0.5 * size.0, size.0)
            }
            RawBox { corner: Some(corner), edges: Some(e), min: None, max: None, centre: None, size: None, .. } => {
                DAffine3::from_cols(e[0].0, e[1].0, e[2].0, corner.0)
            }
            _ => return Err("a box is given by min and max, by centre and size, or by corner and edges".into()),
        };
        let upright = raw.edges.is_none();
        let size = map.matrix3.to_cols_array_2d();
        let shortest = (0..3).map(|i| size[i][i]).fold(f64::INFINITY, f64::min);
        if upright && shortest <= 0.0 || map.matrix3.determinant() == 0.0 {
            return Err("the box has no inside: max has to be above min".into());
        }
        if raw.round.0 > 0.0 && !(upright && 2.0 * raw.round.0 <= shortest) {
            return Err("round is at most half the shortest edge, and not for a box by edges".into());
        }
        Ok(Box3 { map, round: raw.round.0 })
    }
}
