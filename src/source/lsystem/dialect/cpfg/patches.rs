//! Surfaces of bicubic Bézier patches, as the editor of surfaces beside cpfg writes them (`.s`).

use std::path::Path;

use crate::geom::{DMat3, DVec3};
use crate::source::lsystem::grammar::{Grammar, Surface};
use crate::{Error, Result};

/// Steps of a patch each way, where no file says them.
const STEPS: usize = 5;
/// Most steps each way, as cpfg takes them.
const MAX_STEPS: usize = 10;
/// Largest coordinate, in units.
const FARTHEST: f64 = 1e12;
/// Names of a patch's eight neighbours, in lines of them.
const NEIGHBOURS: [&str; 8] = ["AL:", "A:", "AR:", "L:", "R:", "BL:", "B:", "BR:"];

/// Control points in rows, and the index of the colour of its upper side; 0 stands for the turtle's.
struct Patch {
    points: [[DVec3; 4]; 4],
    colour: f64,
}

/// Read a surface of the size `size` in units, each patch in `steps` that are given, or as the file says.
///
/// # Errors
/// [`Error::Input`] where the file is none of these.
pub fn read(file: &Path, text: &str, size: f64, steps: [Option<usize>; 2], grammar: &Grammar) -> Result<Surface> {
    let mut words = Words::new(file, text);
    for _ in 0..6 {
        words.number()?;
    }
    let mut own = [STEPS; 2];
    if words.peek() == Some("PRECISION") {
        words.labels("PRECISION S:")?;
        own[0] = words.number()? as usize;
        words.labels("T:")?;
        own[1] = words.number()? as usize;
    }
    let steps = [0, 1].map(|i| steps[i].unwrap_or(own[i]).clamp(1, MAX_STEPS));
    let contact = words.vector("CONTACT POINT")?;
    let end = words.vector("END POINT")?;
    let (heading, up) = (words.vector("HEADING")?, words.vector("UP")?);
    words.labels("SIZE:")?;
    let scale = size / words.number()?;
    let left = heading.try_normalize().zip(heading.cross(up).try_normalize());
    let Some((heading, left)) = left.filter(|_| scale.is_finite()) else {
        return Err(words.fault("has to have a size, and a heading and an up across it"));
    };
    // The axes are columns, as cpfg has them, although rows are what would turn them to the turtle's. Of cpfg's turtle x is
    // left, y ahead, and z up, which points away from our up.
    let to_turtle =
        DMat3::from_diagonal(DVec3::new(-scale, scale, -scale)) * DMat3::from_cols(left, heading, left.cross(heading));
    let mut mesh = Mesh { positions: Vec::new(), colours: Vec::new(), triangles: Vec::new() };
    while words.peek().is_some() {
        let mut patch = words.patch()?;
        patch.points = patch.points.map(|row| row.map(|p| to_turtle * (p - contact)));
        let far = patch.points.iter().flatten().any(|p| !p.is_finite() || p.abs().max_element() > FARTHEST);
        if far {
            return Err(words.fault(format!("a point is more than {FARTHEST} units away")));
        }
        let coloured = patch.colour != 0.0 && !grammar.colours.is_empty();
        mesh.add(&patch.points, steps, coloured.then(|| grammar.colour(patch.colour)));
    }
    let Mesh { positions, colours, triangles } = mesh;
    Ok(Surface::Patches { positions, colours, triangles, end: to_turtle * (end - contact) })
}

struct Mesh {
    positions: Vec<DVec3>,
    colours: Vec<Option<[f32; 3]>>,
    triangles: Vec<[u32; 3]>,
}

impl Mesh {
    fn add(&mut self, points: &[[DVec3; 4]; 4], [rows, columns]: [usize; 2], colour: Option<[f32; 3]>) {
        let first = self.positions.len() as u32;
        for row in 0..=rows {
            for column in 0..=columns {
                let s = bernstein(row as f64 / rows as f64);
                let t = bernstein(column as f64 / columns as f64);
                let sum = |row: &[DVec3; 4]| (0..4).map(|j| t[j] * row[j]).sum::<DVec3>();
                self.positions.push((0..4).map(|i| s[i] * sum(&points[i])).sum());
                self.colours.push(colour);
            }
        }
        let at = |row: usize, column: usize| first + (row * (columns + 1) + column) as u32;
        for row in 0..rows {
            for column in 0..columns {
                let [a, b] = [at(row, column), at(row, column + 1)];
                let [c, d] = [at(row + 1, column), at(row + 1, column + 1)];
                self.triangles.extend([[a, b, c], [b, d, c]]);
            }
        }
    }
}

/// Bernstein polynomials of degree 3.
fn bernstein(t: f64) -> [f64; 4] {
    let s = 1.0 - t;
    [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t]
}

/// Words of the file, each with its line.
struct Words<'a> {
    file: &'a Path,
    list: Vec<(usize, &'a str)>,
    next: usize,
}

impl<'a> Words<'a> {
    fn new(file: &'a Path, text: &'a str) -> Words<'a> {
        let lines = text.lines().enumerate();
        let list = lines.flat_map(|(i, line)| line.split_whitespace().map(move |w| (i + 1, w))).collect();
        Words { file, list, next: 0 }
    }

    /// What is wrong at the word before, or at the last.
    fn fault(&self, what: impl Into<String>) -> Error {
        let at = self.list.get(self.next.saturating_sub(1)).or(self.list.last()).map_or(1, |(line, _)| *line);
        Error::input(self.file, format!("line {at}"), what.into())
    }

    fn peek(&self) -> Option<&'a str> {
        self.list.get(self.next).map(|(_, word)| *word)
    }

    fn word(&mut self, wanted: &str) -> Result<&'a str> {
        let word = self.peek();
        self.next += 1;
        word.ok_or_else(|| self.fault(format!("ends before {wanted}; a surface of patches is a .s file of cpfg")))
    }

    fn number(&mut self) -> Result<f64> {
        let word = self.word("a number")?;
        let number = word.parse().ok().filter(|v: &f64| v.is_finite());
        number.ok_or_else(|| self.fault(format!("{word} is no number; a surface of patches is a .s file of cpfg")))
    }

    fn labels(&mut self, labels: &str) -> Result<()> {
        for label in labels.split(' ') {
            let word = self.word(label)?;
            if word != label {
                return Err(self.fault(format!("{label} has to stand where {word} does")));
            }
        }
        Ok(())
    }

    fn vector(&mut self, name: &str) -> Result<DVec3> {
        self.labels(name)?;
        let mut v = [0.0; 3];
        for (label, v) in ["X:", "Y:", "Z:"].iter().zip(&mut v) {
            self.labels(label)?;
            *v = self.number()?;
        }
        Ok(v.into())
    }

    fn patch(&mut self) -> Result<Patch> {
        self.word("a patch's name")?;
        self.labels("TOP COLOR:")?;
        let colour = self.number()?;
        self.labels("DIFFUSE:")?;
        self.number()?;
        self.labels("BOTTOM COLOR:")?;
        self.number()?;
        self.labels("DIFFUSE:")?;
        self.number()?;
        for neighbour in NEIGHBOURS {
            self.labels(neighbour)?;
            self.word("a neighbour's name")?;
        }
        let mut points = [[DVec3::ZERO; 4]; 4];
        for point in points.as_flattened_mut() {
            *point = DVec3::new(self.number()?, self.number()?, self.number()?);
        }
        Ok(Patch { points, colour })
    }
}
