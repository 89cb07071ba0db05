//! Filter of OBJ statements before tobj reads them, for what tobj cannot read or misreads.
//!
//! Lines are passed on unchanged where tobj 4.0 reads them correctly. This filter handles what tobj does not support, or for which it rejects the
//! whole file without a line number: lines that continue after a backslash, comments after a statement, `p`, vertices of seven numbers, colours
//! of only some vertices, faces in which only some corners have texture coordinates, indices beyond the vertices, the ways in which C libraries
//! print NaN, and objects that contain groups.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{BufRead, Read};
use std::path::Path;

use super::mtl::{Library, libraries};
use crate::scene::far::Decimals;
use crate::scene::select::Selection;
use crate::scene::text::{keyword, logical_lines, without_comment};
use crate::scene::{ReadOptions, files};
use crate::{Error, Result, Warnings};

/// Most corners of one face; triangulating more takes too long.
const MAX_CORNERS: usize = 1 << 16;

/// ElementKind of an element.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ElementKind {
    Points,
    Polyline,
    Face,
}

/// A run of successive elements of one kind and one part.
#[derive(Debug, Clone, Copy)]
pub struct Run {
    /// Index into [`Statements::parts`].
    pub part: usize,
    pub kind: ElementKind,
    pub elements: usize,
}

/// Key of a part: the name of its object, or of its group where there is none, and its material.
pub type PartKey = (String, Option<usize>);

/// The filtered statements of a file, which tobj reads through [`BufRead`].
pub struct Statements<'a> {
    lines: Box<dyn Iterator<Item = (usize, Cow<'a, str>)> + 'a>,
    path: &'a Path,
    options: &'a ReadOptions,
    selection: Selection<'a>,
    /// Positions, texture coordinates and normals in the whole file.
    totals: [usize; 3],
    /// The same up to the current line.
    counts: [usize; 3],
    /// True where any vertex has a colour.
    coloured: bool,
    pub library: Library,
    object: String,
    group: String,
    taken: bool,
    material: Option<usize>,
    known: BTreeMap<PartKey, usize>,
    /// Parts in the order in which they begin.
    pub parts: Vec<PartKey>,
    pub runs: Vec<Run>,
    /// Decimal places of the positions.
    pub decimals: Decimals,
    pub warnings: Warnings,
    /// Number of the current line.
    line: usize,
    fault: Option<String>,
    /// Text that tobj reads next, from byte `at` on.
    out: String,
    at: usize,
    ended: bool,
    /// Approximate number of bytes that tobj takes for the statements so far.
    bytes: u64,
}

/// Bytes that tobj takes besides the text: it holds a face of up to four corners in 104 bytes, and a vertex with its
/// attributes, its key and its copy in the mesh.
const BYTES_PER_FACE: u64 = 112;
const BYTES_PER_CORNER: u64 = 28;
const BYTES_PER_VERTEX: u64 = 160;

/// A corner's position, texture coordinate and normal, from 0 on.
type Corner = [Option<usize>; 3];

impl<'a> Statements<'a> {
    pub fn new(path: &'a Path, text: &'a str, options: &'a ReadOptions) -> Statements<'a> {
        let mut totals = [0; 3];
        let mut coloured = false;
        for (_, line) in logical_lines(text) {
            let (key, rest) = keyword(&line);
            match key {
                "v" => {
                    totals[0] += 1;
                    coloured = coloured || without_comment(rest).split_whitespace().nth(5).is_some();
                }
                "vt" => totals[1] += 1,
                "vn" => totals[2] += 1,
                _ => {}
            }
        }
        let selection = Selection::new(&options.include, &options.exclude);
        Statements {
            lines: Box::new(logical_lines(text)),
            path,
            options,
            taken: selection.takes_all(),
            selection,
            totals,
            counts: [0; 3],
            coloured,
            library: Library::default(),
            object: String::new(),
            group: String::new(),
            material: None,
            known: BTreeMap::new(),
            parts: Vec::new(),
            runs: Vec::new(),
            decimals: Decimals::new(),
            warnings: Warnings::default(),
            line: 0,
            fault: None,
            out: String::new(),
            at: 0,
            ended: false,
            bytes: 0,
        }
    }

    /// The error that stopped tobj, with its line.
    pub fn fault(&mut self, error: tobj::LoadError) -> Error {
        if self.bytes > self.options.max_bytes {
            let what = format!("reading {} (raise option `memory`), in bytes,", self.path.display());
            return Error::Limit { what, needed: self.bytes, allowed: self.options.max_bytes };
        }
        let what = self.fault.take().unwrap_or_else(|| {
            let (key, rest) = keyword(&self.out);
            let bad = rest.split_whitespace().find(|w| w.parse::<f64>().is_err());
            let needed = match error {
                tobj::LoadError::PositionParseError => "a vertex needs three numbers",
                tobj::LoadError::NormalParseError => "a normal needs three numbers",
                tobj::LoadError::TexcoordParseError => "a texture coordinate needs a number",
                _ => return format!("{key}: {error}"),
            };
            bad.map_or(needed.to_owned(), |word| format!("{word} is not a number"))
        });
        Error::input(self.path, format!("line {}", self.line), what)
    }

    /// # Errors
    /// [`Error::Options`] where an object or group was asked for that is not there.
    pub fn finish(&self) -> Result<()> {
        self.selection.finish("object or group")
    }

    /// Read one line, and write what tobj is to read to `out`.
    fn read_line(&mut self, line: &str) -> Result<(), String> {
        let line = without_comment(line);
        let (key, rest) = keyword(line);
        match key {
            "v" => self.vertex(rest)?,
            "vt" => {
                self.counts[1] += 1;
                self.numbers("vt", rest.split_whitespace());
                if rest.split_whitespace().nth(1).is_none() {
                    self.out.push_str(" 0");
                }
            }
            "vn" => {
                self.counts[2] += 1;
                self.numbers("vn", rest.split_whitespace());
            }
            "f" => self.element(rest, ElementKind::Face)?,
            "l" => self.element(rest, ElementKind::Polyline)?,
            "p" => self.element(rest, ElementKind::Points)?,
            "o" => {
                self.object = rest.into();
                self.group.clear();
                self.update_selection();
            }
            "g" => {
                self.group = rest.into();
                self.update_selection();
            }
            "usemtl" => {
                self.material = self.library.position(rest);
                if self.material.is_none() {
                    self.warnings.add(format!("material {rest} is not in the material files; white is used"));
                }
            }
            "mtllib" => self.load(rest),
            "curv" | "curv2" | "surf" => self.warnings.add("a free-form curve or surface is left out"),
            _ => {}
        }
        if self.bytes > self.options.max_bytes { Err("the limit of memory".into()) } else { Ok(()) }
    }

    /// A statement of numbers; the forms that C runtimes print for NaN and infinity become NaN.
    fn numbers<'w>(&mut self, key: &str, words: impl Iterator<Item = &'w str>) {
        self.out.push_str(key);
        for word in words {
            let bare = word.trim_start_matches(['-', '+']);
            let odd = bare.starts_with("1.#") || bare.get(..3).is_some_and(|b| b.eq_ignore_ascii_case("nan"));
            self.out.push(' ');
            self.out.push_str(if odd { "nan" } else { word });
        }
    }

    /// x y z, x y z w, x y z r g b or x y z r g b a. Neither w nor a is used: w belongs to free-form curves. Seven numbers are
    /// no standard; red comes fourth with tinyobjloader and three.js too.
    fn vertex(&mut self, rest: &str) -> Result<(), String> {
        self.counts[0] += 1;
        self.bytes += BYTES_PER_VERTEX;
        if u32::try_from(self.counts[0]).is_err() {
            return Err("more vertices than can be numbered".into());
        }
        let count = rest.split_whitespace().count();
        rest.split_whitespace().take(3).for_each(|word| self.decimals.see(word));
        self.numbers("v", rest.split_whitespace().take(if count < 6 { 3 } else { 6 }));
        if count < 6 {
            self.out.push_str(if self.coloured { " 1 1 1" } else { "" });
            return Ok(());
        }
        // tobj skips a component of a colour that is no number, which would shift all following ones.
        let bad = rest.split_whitespace().skip(3).take(3).find(|w| !w.contains('#') && w.parse::<f64>().is_err());
        bad.map_or(Ok(()), |word| Err(format!("{word} is not a number")))
    }

    /// Decide whether the elements of the current object and group are wanted.
    fn update_selection(&mut self) {
        let names = [&self.object, &self.group];
        let mut included = self.selection.takes_all();
        let mut excluded = false;
        for name in names.into_iter().filter(|n| !n.is_empty()) {
            included |= self.selection.includes(name);
            excluded |= self.selection.excludes(name);
        }
        self.taken = included && !excluded;
    }

    fn load(&mut self, rest: &str) {
        for library in libraries(self.path, rest) {
            match library {
                Ok(path) => match files::read(&path, self.options.max_bytes) {
                    Ok(bytes) => self.library.add(&path, &bytes, &mut self.warnings),
                    Err(e) => self.warnings.add(format!("a material file cannot be read ({e})")),
                },
                Err(name) => self.warnings.add(format!("material file {name} is missing; its colours are not known")),
            }
        }
    }

    /// A face, a polyline or points.
    fn element(&mut self, rest: &str, kind: ElementKind) -> Result<(), String> {
        let mut corners: Vec<Corner> = Vec::new();
        let (mut outside, mut as_it_stands) = (false, true);
        for word in rest.split_whitespace() {
            let corner = self.corner(word)?;
            outside |= corner[0].is_none();
            // tobj reuses the neighbour's texture coordinate or normal for a corner that has none while others have.
            as_it_stands &= (1..3).all(|k| corner[k].is_some() == (self.totals[k] > 0));
            // And it rejects indices that do not exist.
            as_it_stands &=
                word.split('/').filter(|field| !field.is_empty()).count() == corner.iter().flatten().count();
            corners.push(corner);
        }
        if outside {
            self.warnings.add("a face, line or point with an index beyond the vertices is left out");
            return Ok(());
        }
        let least = match kind {
            ElementKind::Points => 1,
            ElementKind::Polyline => 2,
            ElementKind::Face => 3,
        };
        if corners.len() < least {
            self.warnings.add("a face or line with too few corners is left out");
            return Ok(());
        }
        if corners.len() > MAX_CORNERS {
            return Err(format!("a face of {} corners; at most {MAX_CORNERS} are read", corners.len()));
        }
        if !self.taken {
            return Ok(());
        }
        self.bytes += BYTES_PER_FACE + BYTES_PER_CORNER * corners.len() as u64;
        let name = if self.object.is_empty() { &self.group } else { &self.object };
        let key = (name.clone(), self.material);
        let part = *self.known.entry(key).or_insert_with_key(|key| {
            self.parts.push(key.clone());
            self.parts.len() - 1
        });
        match self.runs.last_mut() {
            Some(run) if run.part == part && run.kind == kind => run.elements += 1,
            _ => self.runs.push(Run { part, kind, elements: 1 }),
        }
        self.out.push('f');
        if as_it_stands {
            self.out.push(' ');
            self.out.push_str(rest);
            return Ok(());
        }
        for corner in corners {
            // A missing attribute becomes the NaN that is appended after the file's last statement.
            let [v, t, n] = [0, 1, 2].map(|k| corner[k].unwrap_or(self.totals[k]) + 1);
            let _ = match [self.totals[1] > 0, self.totals[2] > 0] {
                [true, true] => std::fmt::write(&mut self.out, format_args!(" {v}/{t}/{n}")),
                [true, false] => std::fmt::write(&mut self.out, format_args!(" {v}/{t}")),
                [false, true] => std::fmt::write(&mut self.out, format_args!(" {v}//{n}")),
                [false, false] => std::fmt::write(&mut self.out, format_args!(" {v}")),
            };
        }
        Ok(())
    }

    /// Parse `v`, `v/vt`, `v//vn` or `v/vt/vn`; indices count from 1, or from the end if negative. Indices that do not exist give `None`.
    fn corner(&mut self, word: &str) -> Result<Corner, String> {
        let mut out = [None; 3];
        for (k, field) in word.splitn(3, '/').enumerate() {
            if field.is_empty() {
                continue;
            }
            let index: i64 = field.parse().map_err(|_| format!("{word} is not an index"))?;
            let count = self.counts[k];
            let from_zero = if index < 0 { index.checked_add(count as i64) } else { index.checked_sub(1) };
            out[k] = from_zero.and_then(|i| usize::try_from(i).ok()).filter(|&i| i < count);
            if k > 0 && out[k].is_none() {
                self.warnings.add("an index of a texture coordinate or normal that does not exist is ignored");
            }
        }
        Ok(out)
    }

    /// Fill `out` with the next statement for tobj; false at the end.
    fn refill(&mut self) -> Result<bool, String> {
        self.out.clear();
        self.at = 0;
        while self.out.is_empty() {
            let Some((number, line)) = self.lines.next() else {
                if self.ended {
                    return Ok(false);
                }
                self.ended = true;
                // For corners without a texture coordinate or normal in a file in which others have one.
                self.out.push_str("vt nan nan\nvn nan nan nan\n");
                return Ok(true);
            };
            self.line = number;
            self.read_line(&line)?;
        }
        self.out.push('\n');
        Ok(true)
    }
}

impl BufRead for Statements<'_> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        if self.at == self.out.len()
            && let Err(what) = self.refill()
        {
            self.fault = Some(what);
            return Err(std::io::Error::other("a fault that is told by its place"));
        }
        Ok(self.out.as_bytes().get(self.at..).unwrap_or_default())
    }

    fn consume(&mut self, bytes: usize) {
        self.at = (self.at + bytes).min(self.out.len());
    }
}

impl Read for Statements<'_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let mut rest = self.fill_buf()?;
        let taken = rest.read(out)?;
        self.consume(taken);
        Ok(taken)
    }
}
