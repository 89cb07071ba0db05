//! Wavefront OBJ files with their MTL materials → [`Model`].
//!
//! tobj reads the statements; the pass in `statements` hands them on and says what it cannot. Polygons are cut here, by ears,
//! since tobj makes fans of all of them. What tobj gives is one mesh in double precision, from which parts are taken.

mod mtl;
mod statements;

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use super::text::{decode, keyword, logical_lines, without_comment};
use super::texture::srgb_to_linear;
use super::triangulate::Triangulator;
use super::{Instance, Material, Model, Part, ReadOptions, far, files, topology};
use crate::geom::{Aabb, DAffine3, DVec3};
use crate::{Error, Result, Warnings};
use statements::{ElementKind, Statements};

/// Read a file. `options.include` and `exclude` choose objects and groups by name; colours of vertices are taken as
/// sRGB, `Kd` as linear; v of texture coordinates is turned to point down. Where positions are far from 0, those of the parts
/// are relative to a round number that the instances add again.
///
/// # Errors
/// [`Error::Io`], [`Error::Limit`], [`Error::Input`] with the line that is not understood, [`Error::Options`] where a
/// scene or a name is asked for that is not there.
pub fn read(path: &Path, options: &ReadOptions) -> Result<Model> {
    if let Some(scene) = &options.scene {
        return Err(Error::Options(format!("{} has no scenes; leave out the scene {scene}", path.display())));
    }
    let bytes = files::read(path, options.max_bytes)?;
    let text = decode(&bytes);
    let mut statements = Statements::new(path, &text, options);
    // One index for all that a corner has: no two vertices of the mesh agree in position, texture coordinate and normal.
    let load = tobj::LoadOptions { single_index: true, ..tobj::LoadOptions::default() };
    let no_library = |_: &Path| Err(tobj::LoadError::OpenFileFailed);
    let models = match tobj::load_obj_buf(&mut statements, &load, no_library) {
        Ok((models, _)) => models,
        Err(e) => return Err(statements.fault(e)),
    };
    statements.finish()?;
    let mut warnings = std::mem::take(&mut statements.warnings);
    // Names of objects and materials are not passed on to tobj, so all geometry is one mesh.
    let mesh = models.into_iter().next().map(|m| m.mesh).unwrap_or_default();
    let geometry = Geometry::new(&mesh, statements.decimals);
    if geometry.white > 1.0 {
        warnings.add("colours of vertices are above 1: they are taken as parts of 255");
    }
    let built = geometry.parts(&statements, options.patches);
    let mut model = Model::default();
    let mut textures = mtl::Textures::new(options.max_bytes.saturating_sub(bytes.len() as u64));
    let mut places: BTreeMap<Option<usize>, usize> = BTreeMap::new();
    for ((name, material), mut part) in statements.parts.iter().cloned().zip(built) {
        topology::clean(&mut part, false, &mut warnings);
        if part.triangles.is_empty() && part.lines.is_empty() && part.points.is_empty() {
            continue;
        }
        part.material = match places.entry(material) {
            Entry::Occupied(known) => *known.get(),
            Entry::Vacant(new) => {
                model.materials.push(match material.and_then(|m| statements.library.get(m)) {
                    Some(m) => textures.resolve(m, options, &mut warnings)?,
                    None => Material::default(),
                });
                *new.insert(model.materials.len() - 1)
            }
        };
        if part.uvs.is_empty() && model.materials[part.material].texture.is_some() {
            warnings.add("texture coordinates that a material asks for are missing; they are read as 0");
            part.uvs.push(vec![[0.0; 2]; part.positions.len()]);
        }
        part.name = name.clone();
        let transform = DAffine3::from_translation(geometry.offset);
        model.instances.push(Instance { part: model.parts.len(), transform, node: name });
        model.parts.push(part);
    }
    if model.instances.is_empty() {
        let why = warnings.as_reasons();
        return Err(Error::input(path, "", format!("nothing is drawn: no face, line or point{why}")));
    }
    model.warnings = warnings;
    Ok(model)
}

/// The files that an OBJ names, as reading it would find them: material files, each with its textures.
pub fn named_files(path: &Path) -> Vec<PathBuf> {
    let bytes = files::read(path, u64::MAX).unwrap_or_default();
    let mut out = Vec::new();
    for (_, line) in logical_lines(&decode(&bytes)) {
        let ("mtllib", rest) = keyword(without_comment(&line)) else { continue };
        for found in mtl::libraries(path, rest).into_iter().flatten() {
            let mut library = mtl::Library::default();
            library.add(&found, &files::read(&found, u64::MAX).unwrap_or_default(), &mut Warnings::default());
            out.push(found);
            out.extend(library.materials().iter().flat_map(mtl::MtlMaterial::files));
        }
    }
    out
}

/// A mesh as tobj gives it, relative to `offset`.
struct Geometry<'a> {
    mesh: &'a tobj::Mesh,
    offset: DVec3,
    decimals: far::Decimals,
    /// Divisor of vertex colours: 255 if any of them is above 1.
    white: f64,
}

impl<'a> Geometry<'a> {
    fn new(mesh: &'a tobj::Mesh, decimals: far::Decimals) -> Geometry<'a> {
        let positions = mesh.positions.as_chunks::<3>().0.iter().map(|p| DVec3::from(*p));
        let offset = far::offset(Aabb::around(positions.filter(|p| p.is_finite())));
        let white = if mesh.vertex_color.iter().any(|c| *c > 1.0) { 255.0 } else { 1.0 };
        Geometry { mesh, offset, decimals, white }
    }

    /// The parts of all runs of elements, in the order of [`Statements::parts`]; with `patches`, convex faces of four corners are
    /// bilinear patches.
    fn parts(&self, statements: &Statements, patches: bool) -> Vec<Part> {
        let mut parts: Vec<PartBuilder> = statements.parts.iter().map(|_| PartBuilder::default()).collect();
        let mut triangulator = Triangulator::new();
        let mut indices = &self.mesh.indices[..];
        // tobj gives no counts of corners where every element has three.
        let mut arities = self.mesh.face_arities.iter();
        let mut ids = Vec::new();
        for run in &statements.runs {
            let Some(building) = parts.get_mut(run.part) else { continue };
            for _ in 0..run.elements {
                let arity = arities.next().map_or(3, |a| *a as usize);
                let Some((corners, rest)) = indices.split_at_checked(arity) else { break };
                indices = rest;
                ids.clear();
                ids.extend(corners.iter().map(|&c| building.vertex(c, self)));
                let part = &mut building.part;
                match run.kind {
                    ElementKind::Points => part.points.extend(&ids),
                    ElementKind::Polyline => part.lines.extend(topology::line_strip(&ids, false)),
                    ElementKind::Face => {
                        let wide = |&i: &u32| DVec3::from(part.positions[i as usize].map(f64::from));
                        let polygon: Vec<DVec3> = ids.iter().map(wide).collect();
                        let first = part.triangles.len();
                        triangulator.triangulate(&polygon, |t| part.triangles.push(t.map(|i| ids[i])));
                        if let ([a, b, c, d], true) = (&ids[..], patches)
                            && part.triangles[first..] == [[*a, *b, *c], [*a, *c, *d]]
                        {
                            part.patches.push([*a, *b, *c, *d]);
                            building.of_patches.extend(part.triangles.drain(first..));
                        }
                    }
                }
            }
        }
        parts.into_iter().map(PartBuilder::finish).collect()
    }
}

/// A part that is being built.
#[derive(Default)]
struct PartBuilder {
    part: Part,
    /// The triangles of its patches, which come before the others.
    of_patches: Vec<[u32; 3]>,
    /// For each vertex of the mesh that was used, its number in the part.
    vertices: HashMap<u32, u32>,
    has_uvs: bool,
    has_normals: bool,
}

impl PartBuilder {
    /// The part's own number of a vertex of the mesh.
    fn vertex(&mut self, vertex: u32, geometry: &Geometry) -> u32 {
        let next = self.vertices.len() as u32;
        let id = *self.vertices.entry(vertex).or_insert(next);
        if id < next {
            return id;
        }
        let (mesh, at) = (geometry.mesh, vertex as usize);
        let row = |list: &[f64]| list.as_chunks::<3>().0.get(at).copied();
        let position = DVec3::from(row(&mesh.positions).unwrap_or([f64::NAN; 3]));
        let part = &mut self.part;
        part.positions.push(far::subtract(position, geometry.offset, geometry.decimals).as_vec3().to_array());
        // NaN stands for a missing or invalid attribute of a corner.
        let uv = mesh.texcoords.as_chunks::<2>().0.get(at).copied().unwrap_or([f64::NAN; 2]);
        self.has_uvs |= !uv[0].is_nan();
        let [u, v] = uv.map(|c| c as f32);
        let uv = if uv[0].is_nan() { [0.0; 2] } else { [u, 1.0 - v] };
        part.uvs.resize_with(1, Vec::new);
        part.uvs[0].push(uv.map(|c| if c.is_finite() { c } else { 0.0 }));
        let normal = row(&mesh.normals).unwrap_or([f64::NAN; 3]);
        self.has_normals |= !normal[0].is_nan();
        let normal = normal.map(|c| if c.is_nan() { 0.0 } else { c as f32 });
        part.normals.get_or_insert_default().push(normal);
        if let Some(color) = row(&mesh.vertex_color) {
            let linear = |c: f64| srgb_to_linear(((c / geometry.white).clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
            let [r, g, b] = color.map(linear);
            part.colors.get_or_insert_default().push([r, g, b, 1.0]);
        }
        id
    }

    fn finish(self) -> Part {
        let mut part = self.part;
        part.triangles.splice(0..0, self.of_patches);
        if !self.has_uvs {
            part.uvs.clear();
        }
        if !self.has_normals {
            part.normals = None;
        }
        part
    }
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
    fn quads_are_patches_where_they_are_asked_for() {
        let text = format!("{SQUARE}v .2 .2 0\nf 1 2 3\nf 1 2 3 4\nf 1 2 5 4\n");
        let options = ReadOptions { patches: true, ..ReadOptions::default() };
        let part = model_with(&text, &options).unwrap().parts.remove(0);
        // The last one is concave.
        assert_eq!(part.patches, [[0, 1, 2, 3]]);
        assert_eq!((part.triangles[..2].to_vec(), part.triangles.len()), (vec![[0, 1, 2], [0, 2, 3]], 5));
        let plain = model(&text).unwrap().parts.remove(0);
        assert!(plain.patches.is_empty() && plain.triangles[0] == [0, 1, 2] && plain.triangles.len() == 5);
    }

    #[test]
    fn points_and_polylines_arrive() {
        let m = model(&format!("{SQUARE}p 1 2\nl 1 2 3 4\n")).unwrap();
        assert_eq!((m.parts[0].points.len(), m.parts[0].lines.len()), (2, 3));
    }

    #[test]
    fn colours_of_vertices_are_srgb_and_default_to_white() {
        // Of seven numbers the last is alpha, which is not used.
        let m = model("v 0 0 0\nv 1 0 0 1 0 .5\nv 0 1 0 1 0 0 .5\nf 1 2 3").unwrap();
        let colors = m.parts[0].colors.clone().unwrap();
        assert_eq!(colors, [[1.0; 4], [1.0, 0.0, srgb_to_linear(128), 1.0], [1.0, 0.0, 0.0, 1.0]]);
        assert!(model("v 0 0 0 1 x 0").unwrap_err().to_string().contains("line 1: x is not a number"));
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

    #[test]
    fn corners_with_and_without_texture_coordinates_stand_side_by_side() {
        let m = model(&format!("{SQUARE}vt .5 0\nvn 0 0 -1\nf 1/1/1 2 3//1\nf -4/-1 -2 -1/9\nl 1 2/1\np 3")).unwrap();
        let part = &m.parts[0];
        assert_eq!((part.triangles.len(), part.lines.len(), part.points.len()), (2, 1, 1));
        let uvs: Vec<[f32; 2]> = part.triangles.iter().flatten().map(|&i| part.uvs[0][i as usize]).collect();
        assert_eq!(uvs, [[0.5, 1.0], [0.0; 2], [0.0; 2], [0.5, 1.0], [0.0; 2], [0.0; 2]]);
        // A corner without a normal gets that of the faces around it, as a normal without a direction does.
        assert_eq!(part.normals.as_ref().unwrap()[..2], [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]);
        assert!(m.warnings.iter().any(|(text, n)| text.contains("does not exist is ignored") && n == 1));
    }

    #[test]
    fn marks_and_broken_lines_change_nothing() {
        let plain = model(&format!("mtllib m.mtl\n{SQUARE}usemtl red\nf 1 2 3 4")).unwrap();
        let text = format!("\u{feff}mtllib m.mtl\n{SQUARE}usemtl\tred\r\nf 1 2 \\ \r\n 3 4 # end");
        let marked = model(&text).unwrap();
        assert_eq!(marked.parts[0].positions, plain.parts[0].positions);
        assert_eq!(marked.parts[0].triangles, plain.parts[0].triangles);
        assert_eq!(marked.materials[0].base_color, [1.0, 0.0, 0.0, 1.0]);
        let wide: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("m.mtl"), "\u{feff}newmtl red\nKd \\\n1 \\\n0 0\n").unwrap();
        std::fs::write(dir.path().join("t.obj"), wide).unwrap();
        let m = read(&dir.path().join("t.obj"), &ReadOptions::default()).unwrap();
        assert_eq!((m.materials[0].base_color, m.warnings.is_empty()), ([1.0, 0.0, 0.0, 1.0], true));
        assert_eq!(named_files(&dir.path().join("t.obj")), [dir.path().join("m.mtl")]);
    }

    #[test]
    fn far_from_0_positions_keep_their_digits() {
        let text = |x: f64, y: f64| {
            let corner = |a: f64, b: f64| format!("v {:.6} {:.6} 0.25\n", x + a, y + b);
            [corner(-0.525731, 0.850651), corner(0.525731, 0.850651), corner(0.1, -0.850651), "f 1 2 3".into()].concat()
        };
        let (near, far) = (model(&text(0.0, 0.0)).unwrap(), model(&text(448_262.0, 5_411_932.0)).unwrap());
        assert_eq!(far.parts[0].positions, near.parts[0].positions);
        assert_eq!(far.instances[0].transform.translation, DVec3::new(448_262.0, 5_411_932.0, 0.0));
        assert_eq!(near.instances[0].transform, DAffine3::IDENTITY);
    }

    #[test]
    fn memory_is_checked_while_a_file_is_read() {
        let options = ReadOptions { max_bytes: 2000, ..ReadOptions::default() };
        assert!(model_with(&format!("{SQUARE}f 1 2 3"), &options).is_ok());
        let many = format!("{SQUARE}{}", "f 1 2 3\n".repeat(20));
        assert!(matches!(model_with(&many, &options), Err(Error::Limit { allowed: 2000, .. })));
    }
}
