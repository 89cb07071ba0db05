//! Tables of positions for rigid copies (`.csv`, `.tsv`), as surveys and other scatter tools write them: columns x, y [, z], size, scale,
//! turn, tint and texel, named by the first line, in any order.

use std::path::Path;

use crate::geom::DVec3;
use crate::scene::files;
use crate::scene::text::{decode, fields, logical_lines};
use crate::scene::texture::srgb_to_linear;
use crate::{Error, Result, Warnings};

/// Which of a table's axes is up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PointsUp {
    /// x east, y north, z up, as in surveys: in the scene (x, z, −y).
    #[default]
    Z,
    /// The axes of the scene: y up, z towards the viewer of a map.
    Y,
}

/// One row.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedPoint {
    /// Line of the file, from 1 on.
    pub line: usize,
    /// In the axes of the scene; the height is 0 where it is to be looked up.
    pub at: DVec3,
    /// Whether the table gives the height.
    pub has_height: bool,
    /// Metres that the copy is high.
    pub size: Option<f64>,
    /// Factor of the size that the copy has by itself.
    pub scale: Option<f64>,
    /// Radians, counter-clockwise seen from above.
    pub turn: Option<f64>,
    /// Factors of the albedo, linear.
    pub tint: Option<[f64; 3]>,
    /// Index of the texel.
    pub texel: Option<usize>,
}

/// Most rows of a table.
const MAX_POINTS: usize = 1 << 24;

/// Meaning of a column; the first six hold numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Column {
    X,
    Y,
    Z,
    Size,
    Scale,
    Turn,
    Tint,
    Texel,
}

/// Names of columns, in lower case.
const NAMES: [(&str, Column); 17] = [
    ("x", Column::X),
    ("easting", Column::X),
    ("y", Column::Y),
    ("northing", Column::Y),
    ("z", Column::Z),
    ("altitude", Column::Z),
    ("elevation", Column::Z),
    ("size", Column::Size),
    ("height", Column::Size),
    ("scale", Column::Scale),
    ("turn", Column::Turn),
    ("rotation", Column::Turn),
    ("yaw", Column::Turn),
    ("tint", Column::Tint),
    ("texel", Column::Texel),
    ("species", Column::Texel),
    ("kind", Column::Texel),
];

/// Read a table. `texels`: names that its column `texel` may hold.
///
/// # Errors
/// `Io`; `Input` with the line where a value is invalid, a texel is unknown, or a coordinate is missing.
pub fn read(path: &Path, up: PointsUp, texels: &[String], warnings: &mut Warnings) -> Result<Vec<PlacedPoint>> {
    let bytes = files::read(path, 1 << 31)?;
    let text = decode(&bytes);
    let mut lines = logical_lines(&text).filter(|(_, l)| !l.trim().is_empty() && !l.trim_start().starts_with('#'));
    let (number, first) = lines.next().ok_or_else(|| Error::input(path, "", "holds no points"))?;
    let table = Table::new(path, up, texels, (number, &first))?;
    let unknown = table.columns.iter().filter(|c| c.is_none()).count();
    warnings.add_many(format!("{}: columns of other names are ignored", path.display()), unknown as u64);
    let mut points = Vec::new();
    for (line, text) in lines {
        points.push(table.row(line, &text)?);
        if points.len() > MAX_POINTS {
            let what = format!("{}: placing copies", path.display());
            return Err(Error::Limit { what, needed: points.len() as u64, allowed: MAX_POINTS as u64 });
        }
    }
    if points.is_empty() {
        return Err(Error::input(path, "", "holds no points"));
    }
    Ok(points)
}

/// The form of a table, as its first line gives it.
struct Table<'a> {
    path: &'a Path,
    up: PointsUp,
    texels: &'a [String],
    separator: char,
    /// Names of the columns, in lower case.
    names: Vec<String>,
    /// Meanings of the columns; `None` for those that are ignored.
    columns: Vec<Option<Column>>,
}

impl<'a> Table<'a> {
    /// From the first line, which has the number `number`.
    fn new(path: &'a Path, up: PointsUp, texels: &'a [String], (number, first): (usize, &str)) -> Result<Table<'a>> {
        let separator = [',', '\t', ';'].into_iter().find(|s| first.contains(*s)).unwrap_or(' ');
        let names: Vec<String> = fields(first, separator).map(|f| f.1.to_lowercase()).collect();
        let columns: Vec<Option<Column>> =
            names.iter().map(|n| NAMES.iter().find(|known| known.0 == n).map(|known| known.1)).collect();
        let table = Table { path, up, texels, separator, names, columns };
        let plane =
            if up == PointsUp::Z { [(Column::X, "x"), (Column::Y, "y")] } else { [(Column::X, "x"), (Column::Z, "z")] };
        for (column, name) in plane {
            if !table.columns.contains(&Some(column)) {
                let known = "x, y, z, size (metres high), scale, turn (degrees), tint (#rrggbb), texel";
                let what = format!("no column is named {name}; the first line names the columns: {known}");
                return Err(table.error(number, what));
            }
        }
        for (i, column) in table.columns.iter().enumerate() {
            if column.is_some() && table.columns[..i].contains(column) {
                let what = format!("column {} is the second for the same: `{}`", i + 1, table.names[i]);
                return Err(table.error(number, what));
            }
        }
        Ok(table)
    }

    /// An error about a line.
    fn error(&self, line: usize, what: impl Into<String>) -> Error {
        Error::input(self.path, format!("line {line}"), what)
    }

    /// The point of one line.
    fn row(&self, line: usize, text: &str) -> Result<PlacedPoint> {
        let mut values = [f64::NAN; 6];
        let (mut tint, mut texel) = (None, None);
        for (k, (column, (_, field))) in self.columns.iter().zip(fields(text, self.separator)).enumerate() {
            let Some(column) = column.filter(|_| !field.is_empty()) else { continue };
            match column {
                Column::Tint => {
                    let wrong = || self.error(line, format!("tint is `{field}` and not a #rrggbb"));
                    tint = Some(hex(field).ok_or_else(wrong)?);
                }
                Column::Texel => {
                    let known = self.texels.join(", ");
                    let wrong = || self.error(line, format!("no texel is named `{field}`; there are: {known}"));
                    texel = Some(self.texels.iter().position(|t| t == field).ok_or_else(wrong)?);
                }
                number => {
                    let value = field.parse().ok().filter(|v: &f64| v.is_finite());
                    let wrong = || self.error(line, format!("{} is `{field}` and not a number", self.names[k]));
                    values[number as usize] = value.ok_or_else(wrong)?;
                }
            }
        }
        let [x, y, z, size, scale, turn] = values;
        let (north, height) = if self.up == PointsUp::Z { (y, z) } else { (-z, y) };
        if x.is_nan() || north.is_nan() {
            return Err(self.error(line, "has no place: a coordinate is missing"));
        }
        Ok(PlacedPoint {
            line,
            at: DVec3::new(x, if height.is_nan() { 0.0 } else { height }, -north),
            has_height: !height.is_nan(),
            size: self.positive(line, size, "size")?,
            scale: self.positive(line, scale, "scale")?,
            turn: (!turn.is_nan()).then(|| turn.to_radians()),
            tint,
            texel,
        })
    }

    /// A value that must be above 0; `None` where it is absent (NaN).
    fn positive(&self, line: usize, value: f64, name: &str) -> Result<Option<f64>> {
        match value {
            v if v.is_nan() => Ok(None),
            v if v > 0.0 => Ok(Some(v)),
            _ => Err(self.error(line, format!("{name} must be above 0"))),
        }
    }
}

/// Linear factors from `#rrggbb`.
fn hex(text: &str) -> Option<[f64; 3]> {
    let digits = text.strip_prefix('#').filter(|d| d.len() == 6)?;
    let code = u32::from_str_radix(digits, 16).ok()?;
    Some([16, 8, 0].map(|shift| f64::from(srgb_to_linear((code >> shift & 255) as u8))))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str, up: PointsUp) -> Result<Vec<PlacedPoint>, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("p.csv");
        std::fs::write(&path, text).unwrap();
        let texels = ["oak".to_owned(), "fir".to_owned()];
        let read = read(&path, up, &texels, &mut Warnings::default());
        read.map_err(|e| e.to_string().replace(&format!("{}: ", path.display()), ""))
    }

    #[test]
    fn columns_go_by_their_names() {
        let rows = table("id;Y;x;Height;TURN;species;tint\n1;20;10;7,5;;;\n", PointsUp::Z);
        assert_eq!(rows.unwrap_err(), "line 2: height is `7,5` and not a number");
        let rows =
            table("id;Y;x;Height;TURN;species;tint\n1;20;10;7.5;90;fir;#ff0000\n\n2;-1;0;;;;\n", PointsUp::Z).unwrap();
        assert_eq!((rows[0].at, rows[0].has_height), (DVec3::new(10.0, 0.0, -20.0), false));
        assert_eq!((rows[0].size, rows[0].texel, rows[0].tint), (Some(7.5), Some(1), Some([1.0, 0.0, 0.0])));
        assert!((rows[0].turn.unwrap() - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
        assert_eq!((rows[1].at, rows[1].line, rows[1].size, rows[1].turn), (DVec3::new(0.0, 0.0, 1.0), 4, None, None));
    }

    #[test]
    fn axes_are_those_of_a_survey_or_of_the_scene() {
        let at = |up| table("x,y,z\n1,2,3\n", up).unwrap()[0].at;
        assert_eq!(at(PointsUp::Z), DVec3::new(1.0, 3.0, -2.0));
        assert_eq!(at(PointsUp::Y), DVec3::new(1.0, 2.0, 3.0));
        assert!(!table("x,z\n1,3\n", PointsUp::Y).unwrap()[0].has_height);
    }

    #[test]
    fn what_is_wrong_is_said_with_its_line() {
        for (text, what) in [
            ("y,z\n1,2\n", "line 1: no column is named x"),
            ("1,2\n3,4\n", "line 1: no column is named x"),
            ("x,y,x\n1,2,3\n", "line 1: column 3 is the second for the same: `x`"),
            ("x,y\n1,\n", "line 2: has no place"),
            ("x,y\n1,nan\n", "line 2: y is `nan` and not a number"),
            ("x,y,texel\n1,2,elm\n", "line 2: no texel is named `elm`; there are: oak, fir"),
            ("x,y,size\n1,2,0\n", "line 2: size must be above 0"),
            ("x,y,tint\n1,2,red\n", "line 2: tint is `red` and not a #rrggbb"),
            ("x,y\n", "holds no points"),
            ("", "holds no points"),
        ] {
            let error = table(text, PointsUp::Z).unwrap_err();
            assert!(error.starts_with(what), "{error}");
        }
    }
}
