//! Wavefront OBJ files with their MTL materials → [`Model`].
//!
//! Read here and not by a crate, because points, polylines, concave polygons and vertex colours all have to arrive, and
//! because a damaged file has to end in a line that says where.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

mod mtl;
use super::select::Selection;
use super::texture::srgb_to_linear;
use super::triangulate::Cutter;
use super::{Instance, Material, Model, Part, ReadOptions, files, topology};
use crate::geom::{DAffine3, DVec3};
use crate::{Error, Result, Warnings};

/// Corners of one face: beyond, cutting it takes too long.
const MAX_CORNERS: usize = 1 << 16;
/// Of a corner: no such index.
const NONE: u32 = u32::MAX;

/// Read a file. `options.include` and `exclude` choose objects and groups by name; colours of vertices are taken as
/// sRGB, `Kd` as linear; v of texture coordinates is turned to point down.
///
/// # Errors
/// [`Error::Io`], [`Error::Limit`], [`Error::Input`] with the line that is not understood, [`Error::Options`] where a
/// scene or a name is asked for that is not there.
pub fn read(path: &Path, options: &ReadOptions) -> Result<Model> {
    if let Some(scene) = &options.scene {
        return Err(Error::Options(format!("{} has no scenes; leave out the scene {scene}", path.display())));
    }
    let bytes = files::read(path, options.max_bytes)?;
    let text = String::from_utf8_lossy(&bytes);
    let mut reader = Reader::new(path, options);
    for (number, line) in logical_lines(&text) {
        reader.line(&line).map_err(|what| Error::input(path, format!("line {number}"), what))?;
    }
    reader.finish()
}

/// The text before a `#` that begins a word.
pub(super) fn without_comment(line: &str) -> &str {
    let begins = |(i, _): &(usize, &str)| line[..*i].chars().next_back().is_none_or(char::is_whitespace);
    line.match_indices('#').find(begins).map_or(line, |(i, _)| &line[..i])
}

/// Lines, those that end in a backslash joined to the next, with the number of the first.
fn logical_lines(text: &str) -> impl Iterator<Item = (usize, std::borrow::Cow<'_, str>)> {
    let mut lines = text.lines().enumerate();
    std::iter::from_fn(move || {
        let (number, line) = lines.next()?;
        let mut whole = std::borrow::Cow::Borrowed(line);
        while let Some(open) = whole.trim_end().strip_suffix('\\').map(str::to_string) {
            let next = lines.next().map_or("", |(_, l)| l);
            whole = format!("{open} {next}").into();
        }
        Some((number + 1, whole))
    })
}

/// The material files that `rest` of a statement names in the file `path`: one name with spaces, or several; a space
/// within a name may have a backslash before it. Names of files that are not there are errors.
fn libraries(path: &Path, rest: &str) -> Vec<Result<PathBuf, String>> {
    const SPACE: &str = "\u{1}";
    let dir = path.parent().unwrap_or(Path::new(""));
    if let Some(path) = files::find(dir, rest, true) {
        return vec![Ok(path)];
    }
    let escaped = rest.replace("\\ ", SPACE);
    let names = escaped.split_whitespace().map(|name| name.replace(SPACE, " "));
    names.map(|name| files::find(dir, &name, true).ok_or(name)).collect()
}

/// The files that an OBJ names, as reading it would find them: material files, each with its textures.
pub fn named_files(path: &Path) -> Vec<PathBuf> {
    let text = files::read(path, u64::MAX).unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    let mut out = Vec::new();
    for (_, line) in logical_lines(&text) {
        let Some(rest) = without_comment(&line).trim().strip_prefix("mtllib").filter(|r| r.starts_with([' ', '\t']))
        else {
            continue;
        };
        for library in libraries(path, rest.trim()).into_iter().flatten() {
            let materials = files::read(&library, u64::MAX).unwrap_or_default();
            let dir = library.parent().unwrap_or(Path::new("")).to_path_buf();
            out.push(library);
            let materials = mtl::parse(&String::from_utf8_lossy(&materials), &dir, &mut Warnings::default());
            out.extend(materials.iter().flat_map(mtl::Source::files));
        }
    }
    out
}

/// Where the text has led so far.
struct Reader<'a> {
    path: &'a Path,
    options: &'a ReadOptions,
    selection: Selection<'a>,
    positions: Vec<[f32; 3]>,
    /// As long as `positions` once the first vertex has a colour, else empty.
    colors: Vec<[f32; 4]>,
    uvs: Vec<[f32; 2]>,
    normals: Vec<[f32; 3]>,
    materials: Vec<mtl::Source>,
    object: String,
    group: String,
    taken: bool,
    material: Option<usize>,
    /// By object and material.
    parts: BTreeMap<(String, Option<usize>), Building>,
    /// Order in which parts began.
    order: Vec<(String, Option<usize>)>,
    cutter: Cutter,
    warnings: Warnings,
}

/// A part that grows.
#[derive(Default)]
struct Building {
    part: Part,
    /// Corner → vertex.
    vertices: HashMap<[u32; 3], u32>,
    has_uvs: bool,
    has_normals: bool,
}

impl<'a> Reader<'a> {
    fn new(path: &'a Path, options: &'a ReadOptions) -> Self {
        let selection = Selection::new(&options.include, &options.exclude);
        Reader {
            path,
            options,
            taken: selection.takes_all(),
            selection,
            positions: Vec::new(),
            colors: Vec::new(),
            uvs: Vec::new(),
            normals: Vec::new(),
            materials: Vec::new(),
            object: String::new(),
            group: String::new(),
            material: None,
            parts: BTreeMap::new(),
            order: Vec::new(),
            cutter: Cutter::new(),
            warnings: Warnings::default(),
        }
    }

    fn line(&mut self, line: &str) -> Result<(), String> {
        let line = without_comment(line).trim();
        let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        match key {
            "v" => self.vertex(rest)?,
            "vt" => {
                let n = numbers(rest)?;
                let u = *n.first().ok_or("a texture coordinate without numbers")?;
                self.uvs.push([u, 1.0 - n.get(1).copied().unwrap_or(0.0)]);
            }
            "vn" => {
                let n = numbers(rest)?;
                let n = n.first_chunk::<3>().ok_or("a normal needs three numbers")?;
                self.normals.push(*n);
            }
            "f" => self.element(rest, 3)?,
            "l" => self.element(rest, 2)?,
            "p" => self.element(rest, 1)?,
            "o" => {
                self.object = rest.into();
                self.group.clear();
                self.choose();
            }
            "g" => {
                self.group = rest.into();
                self.choose();
            }
            "usemtl" => self.use_material(rest),
            "mtllib" => self.library(rest),
            "curv" | "curv2" | "surf" => self.warnings.add("a free-form curve or surface is left out"),
            _ => {}
        }
        Ok(())
    }

    /// x y z, x y z w, x y z r g b or x y z w r g b.
    fn vertex(&mut self, rest: &str) -> Result<(), String> {
        let n = numbers(rest)?;
        let position = n.first_chunk::<3>().ok_or("a vertex needs three numbers")?;
        let color = match n.len() {
            6 => n.last_chunk::<3>(),
            7.. => n[4..].first_chunk::<3>(),
            _ => None,
        };
        if color.is_some() && self.colors.is_empty() {
            self.colors = vec![[1.0; 4]; self.positions.len()];
        }
        self.positions.push(*position);
        if !self.colors.is_empty() || color.is_some() {
            let linear = |c: f32| srgb_to_linear((c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
            self.colors.push(color.map_or([1.0; 4], |c| [linear(c[0]), linear(c[1]), linear(c[2]), 1.0]));
        }
        if u32::try_from(self.positions.len()).is_err() {
            return Err("more vertices than can be numbered".into());
        }
        Ok(())
    }

    /// Whether what follows is wanted.
    fn choose(&mut self) {
        let names = [&self.object, &self.group];
        let mut included = self.selection.takes_all();
        let mut excluded = false;
        for name in names.into_iter().filter(|n| !n.is_empty()) {
            included |= self.selection.includes(name);
            excluded |= self.selection.excludes(name);
        }
        self.taken = included && !excluded;
    }

    fn use_material(&mut self, name: &str) {
        self.material = self.materials.iter().position(|m| m.name == name);
        if self.material.is_none() {
            self.warnings.add(format!("material {name} is not in the material files; white is used"));
        }
    }

    fn library(&mut self, rest: &str) {
        for library in libraries(self.path, rest) {
            match library {
                Ok(path) => self.load(&path),
                Err(name) => self.warnings.add(format!("material file {name} is missing; its colours are not known")),
            }
        }
    }

    fn load(&mut self, path: &Path) {
        match files::read(path, self.options.max_bytes) {
            Ok(bytes) => {
                let dir = path.parent().unwrap_or(Path::new(""));
                let text = String::from_utf8_lossy(&bytes);
                self.materials.extend(mtl::parse(&text, dir, &mut self.warnings));
            }
            Err(e) => self.warnings.add(format!("a material file cannot be read ({e})")),
        }
    }

    /// A face (`least` 3 corners), polyline (2) or points (1).
    fn element(&mut self, rest: &str, least: usize) -> Result<(), String> {
        let mut corners = Vec::new();
        let mut outside = false;
        for word in rest.split_whitespace() {
            match self.corner(word)? {
                Some(corner) => corners.push(corner),
                None => outside = true,
            }
        }
        if outside {
            self.warnings.add("a face, line or point with an index beyond the vertices is left out");
            return Ok(());
        }
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
        let name = if self.object.is_empty() { &self.group } else { &self.object };
        let key = (name.clone(), self.material);
        if !self.parts.contains_key(&key) {
            self.order.push(key.clone());
        }
        let building = self.parts.entry(key).or_default();
        let mut ids = Vec::with_capacity(corners.len());
        for &corner in &corners {
            let next = building.vertices.len() as u32;
            let id = *building.vertices.entry(corner).or_insert(next);
            if id == next {
                let [v, t, n] = corner;
                let part = &mut building.part;
                part.positions.push(self.positions[v as usize]);
                let uv = self.uvs.get(t as usize);
                let normal = self.normals.get(n as usize);
                building.has_uvs |= uv.is_some();
                building.has_normals |= normal.is_some();
                part.uvs.resize_with(1, Vec::new);
                part.uvs[0].push(uv.copied().unwrap_or_default());
                part.normals.get_or_insert_default().push(normal.copied().unwrap_or_default());
                if let Some(color) = self.colors.get(v as usize) {
                    // Vertices before the first that has a colour are white.
                    let colors = part.colors.get_or_insert_default();
                    colors.resize(next as usize, [1.0; 4]);
                    colors.push(*color);
                }
            }
            ids.push(id);
        }
        match least {
            1 => building.part.points.extend(ids),
            2 => building.part.lines.extend(topology::line_strip(&ids, false)),
            _ => {
                let wide = |c: &[u32; 3]| DVec3::from(self.positions[c[0] as usize].map(f64::from));
                let polygon: Vec<DVec3> = corners.iter().map(wide).collect();
                let triangles = &mut building.part.triangles;
                self.cutter.cut(&polygon, |t| triangles.push(t.map(|i| ids[i])));
            }
        }
        Ok(())
    }

    /// `v`, `v/vt`, `v//vn` or `v/vt/vn`: counted from 1, or from the end where negative. None where v does not exist.
    fn corner(&mut self, word: &str) -> Result<Option<[u32; 3]>, String> {
        let mut out = [NONE; 3];
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        for (k, (field, count)) in word.splitn(3, '/').zip(counts).enumerate() {
            if field.is_empty() {
                continue;
            }
            let index: i64 = field.parse().map_err(|_| format!("{word} is not an index"))?;
            let from_zero = if index < 0 { index.checked_add(count as i64) } else { index.checked_sub(1) };
            match from_zero.and_then(|i| usize::try_from(i).ok()).filter(|&i| i < count) {
                Some(i) => out[k] = i as u32,
                None if k == 0 => return Ok(None),
                None => self.warnings.add("an index of a texture coordinate or normal that does not exist is ignored"),
            }
        }
        Ok((out[0] != NONE).then_some(out))
    }

    fn finish(mut self) -> Result<Model> {
        self.selection.finish("object or group")?;
        let mut model = Model::default();
        let mut textures = mtl::Textures::default();
        let mut places: BTreeMap<Option<usize>, usize> = BTreeMap::new();
        for key in self.order {
            let Some(Building { mut part, has_uvs, has_normals, .. }) = self.parts.remove(&key) else { continue };
            let (name, source) = key;
            if !has_uvs {
                part.uvs.clear();
            }
            if !has_normals {
                part.normals = None;
            }
            if let Some(colors) = &mut part.colors {
                colors.resize(part.positions.len(), [1.0; 4]);
            }
            for uv in part.uvs.iter_mut().flatten().flatten().filter(|v| !v.is_finite()) {
                *uv = 0.0;
            }
            topology::clean(&mut part, false, &mut self.warnings);
            if part.triangles.is_empty() && part.lines.is_empty() && part.points.is_empty() {
                continue;
            }
            part.material = match places.get(&source) {
                Some(&place) => place,
                None => {
                    let source_material = source.and_then(|s| self.materials.get(s));
                    model.materials.push(match source_material {
                        Some(m) => textures.resolve(m, self.options, &mut self.warnings),
                        None => Material { double_sided: true, ..Material::default() },
                    });
                    places.insert(source, model.materials.len() - 1);
                    model.materials.len() - 1
                }
            };
            if part.uvs.is_empty() && model.materials[part.material].texture.is_some() {
                self.warnings.add("texture coordinates that a material asks for are missing; they are read as 0");
                part.uvs.push(vec![[0.0; 2]; part.positions.len()]);
            }
            part.name = name.clone();
            let part_index = model.parts.len();
            model.instances.push(Instance { part: part_index, transform: DAffine3::IDENTITY, node: name });
            model.parts.push(part);
        }
        if model.instances.is_empty() {
            let why = self.warnings.as_reasons();
            return Err(Error::input(self.path, "", format!("nothing is drawn: no face, line or point{why}")));
        }
        model.warnings = self.warnings;
        Ok(model)
    }
}

/// All words of a line as numbers; the forms that C runtimes print for NaN and infinity count as NaN.
fn numbers(text: &str) -> Result<Vec<f32>, String> {
    let one = |word: &str| {
        word.parse().or_else(|_| {
            let bare = word.trim_start_matches(['-', '+']).to_ascii_lowercase();
            if bare.starts_with("1.#") || bare.starts_with("nan") { Ok(f32::NAN) } else { Err(()) }
        })
    };
    text.split_whitespace().map(|w| one(w).map_err(|()| format!("{w} is not a number"))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model(text: &str) -> Result<Model> {
        model_with(text, &ReadOptions::default())
    }

    fn model_with(text: &str, options: &ReadOptions) -> Result<Model> {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("m.mtl"), "newmtl red\nKd 1 0 0\n").unwrap();
        std::fs::write(dir.path().join("t.obj"), text).unwrap();
        read(&dir.path().join("t.obj"), options)
    }

    const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

    #[test]
    fn corners_share_vertices_and_v_points_down() {
        let m = model(&format!("{SQUARE}vt 0 0\nvt 1 .25\nvn 0 0 2\nf 1/1/1 2/2/1 3/2/1 \\\n-1/1/-1")).unwrap();
        let part = &m.parts[0];
        assert_eq!((part.positions.len(), part.triangles.clone()), (4, vec![[0, 1, 2], [0, 2, 3]]));
        assert_eq!(part.uvs[0][1], [1.0, 0.75]);
        assert_eq!(part.normals.as_ref().unwrap()[3], [0.0, 0.0, 1.0]);
        assert!(m.warnings.is_empty() && part.colors.is_none() && m.materials[0].double_sided);
    }

    #[test]
    fn points_and_polylines_arrive() {
        let m = model(&format!("{SQUARE}p 1 2\nl 1 2 3 4\n")).unwrap();
        assert_eq!((m.parts[0].points.len(), m.parts[0].lines.len()), (2, 3));
    }

    #[test]
    fn colours_of_vertices_are_srgb_and_default_to_white() {
        let m = model("v 0 0 0\nv 1 0 0 1 0 .5\nv 0 1 0 1 1 1 1\nf 1 2 3").unwrap();
        let colors = m.parts[0].colors.clone().unwrap();
        assert_eq!(colors, [[1.0; 4], [1.0, 0.0, srgb_to_linear(128), 1.0], [1.0; 4]]);
    }

    #[test]
    fn objects_and_groups_are_chosen_by_name() {
        let text =
            format!("mtllib m.mtl\n{SQUARE}o trunk\nf 1 2 3\no crown\ng leaves\nusemtl red\nf 1 2 3 4\ng twigs\nl 1 2");
        let triangles = |include: &[&str], exclude: &[&str]| {
            let names = |n: &[&str]| n.iter().map(|s| s.to_string()).collect();
            let options = ReadOptions { include: names(include), exclude: names(exclude), ..ReadOptions::default() };
            model_with(&text, &options).map(|m| m.parts.iter().map(|p| p.triangles.len()).sum::<usize>())
        };
        assert_eq!(triangles(&[], &[]).unwrap(), 3);
        assert_eq!(triangles(&["trunk"], &[]).unwrap(), 1);
        assert_eq!(triangles(&[], &["lea*"]).unwrap(), 1);
        assert_eq!(triangles(&["crown"], &["twigs"]).unwrap(), 2);
        assert!(matches!(triangles(&["bark"], &[]), Err(Error::Options(_))));
        let red = model(&text).unwrap();
        assert_eq!(red.materials[red.parts[1].material].base_color, [1.0, 0.0, 0.0, 1.0]);
        assert_eq!(red.instances[1].node, "crown");
    }

    #[test]
    fn faults_are_counted_or_told_with_their_line() {
        let line_of = |text: &str| model(text).unwrap_err().to_string();
        assert!(line_of("v 0 0 0\nv 1 x 0").contains("line 2: x is not a number"));
        assert!(line_of("v 0 0").contains("line 1"));
        assert!(line_of("f 1 2 a").contains("a is not an index"));
        assert!(line_of("# nothing").contains("nothing is drawn"));
        let m =
            model(&format!("{SQUARE}v nan -nan(ind) 1.#INF\nf 1 2 3\nf 1 2 9\nf 0 1 2\nf 1 2 5\nf 1 2\nusemtl none"))
                .unwrap();
        assert_eq!(m.parts[0].triangles.len(), 1);
        assert_eq!(m.warnings.iter().map(|(_, n)| n).sum::<u64>(), 2 + 1 + 1 + 1);
        assert!(m.warnings.iter().any(|(text, _)| text.contains("material none")));
    }
}
