//! Tables of points (`.csv`, `.tsv`): id, t, x, y, z [, radius, r, g, b, a], by the names of a first line, in any order.

use std::borrow::Cow;
use std::collections::BTreeMap;

use super::{Content, Fault};
use crate::geom::DVec3;
use crate::scene::far::Decimals;
use crate::scene::text::{fields, logical_lines};
use crate::source::curve::Strand;

/// Meaning of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Column {
    Id,
    Time,
    Place(usize),
    Radius,
    Width,
    Colour(usize),
}
use Column::{Colour, Id, Place, Radius, Time, Width};

/// Columns of tables without names, by their number.
const UNNAMED: [(usize, &[Column]); 6] = [
    (3, &[Place(0), Place(1), Place(2)]),
    (4, &[Id, Place(0), Place(1), Place(2)]),
    (5, &[Id, Time, Place(0), Place(1), Place(2)]),
    (6, &[Id, Time, Place(0), Place(1), Place(2), Radius]),
    (8, &[Id, Time, Place(0), Place(1), Place(2), Colour(0), Colour(1), Colour(2)]),
    (9, &[Id, Time, Place(0), Place(1), Place(2), Radius, Colour(0), Colour(1), Colour(2)]),
];

struct Row {
    time: f64,
    at: DVec3,
    radius: f32,
    colour: [f32; 4],
}

/// Read a table. Rows of one id form a strand, sorted by t where there is one; strands come in the order of their first rows.
pub fn read(text: &str) -> Result<Content, Fault> {
    let all: Vec<(usize, Cow<str>)> = logical_lines(text).collect();
    let lines = all.iter().map(|(number, line)| (*number, &**line));
    let mut lines = lines.filter(|(_, l)| !l.trim().is_empty() && !l.trim_start().starts_with('#')).peekable();
    let mut content = Content { decimals: Decimals::new(), ..Content::default() };
    let Some((number, first)) = lines.peek() else { return Ok(content) };
    let layout = Layout::new(first).map_err(|what| (format!("line {number}"), what))?;
    if !layout.names.is_empty() {
        lines.next();
    }
    let ignored = layout.columns.iter().filter(|c| c.is_none()).count();
    content.warnings.add_many("columns of other names are ignored", ignored as u64);
    let (mut ids, mut tracks): (BTreeMap<&str, usize>, Vec<Vec<Row>>) = (BTreeMap::new(), Vec::new());
    for (number, line) in lines {
        let row = layout.row(line, &mut content.decimals);
        let (id, row) = row.map_err(|(column, what)| (format!("line {number}, column {column}"), what))?;
        if row.at.is_nan() || row.time.is_nan() {
            content.warnings.add("rows without a place or a time are left out");
            continue;
        }
        let track = *ids.entry(id).or_insert(tracks.len());
        if track == tracks.len() {
            tracks.push(Vec::new());
        }
        tracks[track].push(row);
    }
    content.strands = strands(tracks, layout.is_coloured());
    Ok(content)
}

/// The tracks as strands in order of time, with a colour a point where they are coloured.
fn strands(tracks: Vec<Vec<Row>>, coloured: bool) -> Vec<Strand> {
    let brightest = tracks.iter().flatten().flat_map(|row| &row.colour[..3]).fold(0.0f32, |a, b| a.max(*b));
    // 0 … 1, or 0 … 255 where any is more.
    let scale = if brightest > 1.0 { 1.0 / 255.0 } else { 1.0 };
    let strand = |mut track: Vec<Row>| {
        track.sort_by(|a, b| a.time.total_cmp(&b.time));
        let mut strand = Strand::default();
        for row in track {
            strand.points.push(row.at);
            strand.radii.push(row.radius);
            if coloured {
                let [r, g, b, a] = row.colour;
                strand.colours.push([scale * r, scale * g, scale * b, a]);
            }
        }
        strand
    };
    tracks.into_iter().map(strand).collect()
}

/// What the first line of a table says of all.
struct Layout<'a> {
    separator: char,
    /// Names of the columns; none where the first line is a row already.
    names: Vec<&'a str>,
    /// Meaning of each column; `None`: it is ignored.
    columns: Vec<Option<Column>>,
}

impl<'a> Layout<'a> {
    fn new(first: &'a str) -> Result<Layout<'a>, String> {
        let separator = [',', '\t', ';'].into_iter().find(|s| first.contains(*s)).unwrap_or(' ');
        let names: Vec<&str> = fields(first, separator).map(|f| f.1).collect();
        if !names.iter().all(|n| n.parse::<f64>().is_ok()) {
            let columns = named(&names)?;
            return Ok(Layout { separator, names, columns });
        }
        let Some((_, known)) = UNNAMED.iter().find(|u| u.0 == names.len()) else {
            let what = "columns without names are read as id,t,x,y,z[,radius][,r,g,b]; name these in a first line";
            return Err(format!("{} {what}", names.len()));
        };
        Ok(Layout { separator, names: Vec::new(), columns: known.iter().map(|c| Some(*c)).collect() })
    }

    fn is_coloured(&self) -> bool {
        [Colour(0), Colour(3)].iter().any(|c| self.columns.contains(&Some(*c)))
    }

    /// A row with its id, or what is wrong and the column of the line's text.
    fn row<'l>(&self, line: &'l str, decimals: &mut Decimals) -> Result<(&'l str, Row), (usize, String)> {
        let mut row = Row { time: 0.0, at: DVec3::ZERO, radius: f32::NAN, colour: [1.0; 4] };
        let (mut id, mut count) = ("", 0);
        for ((at, field), column) in fields(line, self.separator).zip(&self.columns) {
            count += 1;
            let Some(column) = column else { continue };
            if *column == Id {
                id = field;
                continue;
            }
            let value = if field.is_empty() { Ok(f64::NAN) } else { field.parse::<f64>() };
            let value = value.map_err(|_| {
                let name = self.names.get(count - 1).filter(|n| n.parse::<f64>().is_err());
                (at, format!("{} is `{field}` and not a number", name.unwrap_or(&"value")))
            })?;
            match *column {
                Id => {}
                Time => row.time = value,
                Place(axis) => {
                    row.at[axis] = value;
                    decimals.see(field);
                }
                Radius => row.radius = value as f32,
                Width => row.radius = 0.5 * value as f32,
                Colour(part) => row.colour[part] = value as f32,
            }
        }
        if count < self.columns.len() {
            let what = format!("{count} values where there are {} columns", self.columns.len());
            return Err((line.chars().count() + 1, what));
        }
        Ok((id, row))
    }
}

/// Meaning of each column by its name; `None` for an unknown name.
fn named(names: &[&str]) -> Result<Vec<Option<Column>>, String> {
    let lower: Vec<String> = names.iter().map(|n| n.trim().to_ascii_lowercase()).collect();
    // `r` is red beside g and b.
    let red = if lower.iter().any(|n| n == "g") && lower.iter().any(|n| n == "b") { Colour(0) } else { Radius };
    let column = |name: &str| match name {
        "id" | "strand" | "particle" | "particle_id" | "track" | "track_id" | "trajectory" | "curve" | "streamline" => {
            Some(Id)
        }
        "t" | "time" | "point" | "frame" | "index" | "step" => Some(Time),
        "x" | "pos_x" | "px" => Some(Place(0)),
        "y" | "pos_y" | "py" => Some(Place(1)),
        "z" | "pos_z" | "pz" => Some(Place(2)),
        "radius" => Some(Radius),
        "width" | "diameter" | "thickness" => Some(Width),
        "r" => Some(red),
        "red" => Some(Colour(0)),
        "g" | "green" => Some(Colour(1)),
        "b" | "blue" => Some(Colour(2)),
        "a" | "alpha" | "opacity" => Some(Colour(3)),
        _ => None,
    };
    let columns: Vec<Option<Column>> = lower.iter().map(|n| column(n)).collect();
    for (axis, letter) in ["x", "y", "z"].iter().enumerate() {
        if !columns.contains(&Some(Place(axis))) {
            return Err(format!(
                "no column is named {letter}; known names are id, t, x, y, z, radius, width, r, g, b, a"
            ));
        }
    }
    for (i, c) in columns.iter().enumerate() {
        if c.is_some() && columns[..i].contains(c) {
            return Err(format!("column {} is the second for the same: `{}`", i + 1, names[i]));
        }
    }
    Ok(columns)
}
