//! Opening a source by its file's extension, and listing the files that it refers to.

use std::path::{Path, PathBuf};

use super::curve::CurveSource;
use super::curve::{lines, trajectory};
use super::group::GroupSource;
use super::lsystem;
use super::materials;
use super::mesh::MeshSource;
use super::options::{FileKind, OpenOptions, file_kind};
use super::stack;
use super::stack::StackSource;
use super::texel::TexelSource;
use super::traits::Source;
use super::{group, recipe};
use crate::geom::{DAffine3, DVec3};
use crate::scene::files::extension;
use crate::scene::{self, files, gltf, text};
use crate::{Error, Result, Warnings};

/// Extensions that are known, for messages.
const KNOWN: &str = ".gltf, .glb, .obj, .lsys, .ls, .l, .lpy, .ini, .csv, .tsv, .hair, .trk, .trx, .tck, .swc (these also as .gz), .vtex, .toml and .json (recipes), .nii, .nii.gz, .hdr, .img, .nrrd, .nhdr, .mha, .mhd, .mgh, .mgz, .dcm, .tif, a folder of slices or of DICOM";

/// Largest grammar that is searched for names of files, in bytes.
const MAX_TEXT: u64 = 1 << 30;

/// Open the source `path`.
///
/// # Errors
/// [`Error::Input`] where the extension is not known, and all that reading gives.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>> {
    let extension = extension(path);
    let mut model = match file_kind(path) {
        FileKind::Mesh => {
            let read = scene::ReadOptions { emission: false, ..options.read.clone() };
            scene::read_model(path, &read)?
        }
        FileKind::LSystem => return lsystem::open(Some(path), &options.lsystem, &options.read, &options.mesh),
        FileKind::Texel => return Ok(Box::new(TexelSource::open(path, options.read.max_bytes)?)),
        FileKind::Recipe => return recipe::open(path, options, open_settled),
        FileKind::Curves => {
            return Ok(Box::new(trajectory::read(path, options.read.max_bytes, &options.trajectory)?));
        }
        FileKind::Stack => {
            let stack = stack::read(path, &options.stack, options.read.max_bytes)?;
            return Ok(Box::new(StackSource::new(stack, &options.stack)?));
        }
        FileKind::Other if ["bgeo", "geo", "pdb"].contains(&extension.as_str()) => {
            return Err(Error::unsupported(path, "a Partio or Houdini file (export its points as .csv)"));
        }
        // Grammars of other programs have extensions of all kinds.
        FileKind::Other if options.lsystem.dialect.is_some() => {
            return lsystem::open(Some(path), &options.lsystem, &options.read, &options.mesh);
        }
        FileKind::Other => {
            return Err(Error::input(path, "", format!("its extension is not known; what can be baked: {KNOWN}")));
        }
    };
    let curves = &options.trajectory;
    let (names, ids) = materials::of_model(&model, |p| !(p.lines.is_empty() && p.points.is_empty()));
    let mut strands =
        curves.width.map_or_else(Vec::new, |w| lines::take(&mut model, w * curves.width_scale, curves.section));
    let units = model.metres_per_unit;
    let mesh = MeshSource::new(model, &options.mesh);
    if strands.is_empty() {
        return Ok(Box::new(mesh));
    }
    strands.iter_mut().for_each(|s| s.material = ids.get(usize::from(s.material)).copied().unwrap_or(0));
    let curves = CurveSource::new(strands, &curves.curve, units, Warnings::default()).with_materials(names);
    let part = |source| group::Part { source, transform: DAffine3::IDENTITY };
    Ok(Box::new(GroupSource::new(vec![Box::new(mesh), Box::new(curves)], &[part(0), part(1)], units)))
}

/// Open a part of a recipe. If coordinates far from 0 were moved ([`Source::origin`]), they are moved back, so that the part has the
/// coordinates of its file.
fn open_settled(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>> {
    let source = open(path, options)?;
    if source.origin() == DVec3::ZERO {
        return Ok(source);
    }
    let (units, part) = (source.metres_per_unit(), group::Part { source: 0, transform: DAffine3::IDENTITY });
    Ok(Box::new(GroupSource::new(vec![source], &[part], units)))
}

/// The file `path` itself and, in order, the existing files that it refers to.
pub fn dependencies(path: &Path) -> Vec<PathBuf> {
    if stack::is_stack(path) {
        return stack::files(path);
    }
    let mut found = vec![path.to_path_buf()];
    let mut add = |file: PathBuf| {
        if file.is_file() && !found.contains(&file) {
            found.push(file);
        }
    };
    let text = || files::read(path, MAX_TEXT).map(|b| text::decode(&b).into_owned()).unwrap_or_default();
    let may_be_grammar = matches!(file_kind(path), FileKind::LSystem | FileKind::Other);
    match extension(path).as_str() {
        "gltf" | "glb" => gltf::named_files(path).into_iter().for_each(&mut add),
        "obj" => crate::scene::obj::named_files(path).into_iter().for_each(&mut add),
        _ if may_be_grammar => {
            // Surfaces are meshes; a grammar that names itself is an error when it is opened.
            for file in lsystem::companion_files(path, &text()) {
                match extension(&file).as_str() {
                    "gltf" | "glb" | "obj" => dependencies(&file).into_iter().for_each(&mut add),
                    "v" | "map" | "s" => add(file),
                    _ => {}
                }
            }
        }
        "toml" | "json" => {
            let of = |f: PathBuf| if recipe::is_recipe(&f) { vec![f] } else { dependencies(&f) };
            recipe::files(path).into_iter().flat_map(of).for_each(&mut add);
        }
        _ => {}
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_extensions_are_told_the_known() {
        let error = open(Path::new("a.xyz"), &OpenOptions::default()).err().unwrap();
        assert!(error.to_string().contains(".gltf"), "{error}");
    }

    #[test]
    fn a_dialect_makes_any_file_a_grammar() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tree.txt");
        std::fs::write(folder.path().join("leaf.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        let text =
            "premise = FJ\ngenerations = 1\nangle = 30\nstep size = 1\nthickness = .1\nleaf J = leaf.obj\nF=FF\n";
        std::fs::write(&path, text).unwrap();
        let mut options = OpenOptions::default();
        assert!(open(&path, &options).err().unwrap().to_string().contains("extension is not known"));
        options.lsystem.dialect = Some(lsystem::Dialect::Houdini);
        assert!(open(&path, &options).is_ok());
        assert_eq!(dependencies(&path), [path, folder.path().join("leaf.obj")]);
    }
}
