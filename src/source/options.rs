//! Options by which sources are read, and the kind of source that a file is.

use std::path::{Path, PathBuf};

use super::curve::trajectory::{self, TrajectoryOptions};
use super::lsystem::LSystemOptions;
use super::mesh::MeshOptions;
use super::stack::{self, StackOptions};
use crate::scene::files::extension;
use crate::scene::gltf::ReadOptions;

/// Options by which a source is read; each kind of source has its own part.
#[derive(Debug, Clone, Default)]
pub struct OpenOptions {
    /// Options of every source: what is selected, and the limits.
    pub read: ReadOptions,
    /// Options of mesh sources.
    pub mesh: MeshOptions,
    /// Options of image stacks.
    pub stack: StackOptions,
    /// Paths of the recipes that are being read, outermost first, by which a recipe that includes itself is noticed.
    pub within: Vec<PathBuf>,
    /// Nesting depth, in nodes, of the source within those recipes, which counts for the limit on nesting.
    pub depth: usize,
    /// Number of copies of the source that those recipes draw, which counts for the limit on copies; 0 counts as 1.
    pub copies: u64,
    /// Options of trajectories.
    pub trajectory: TrajectoryOptions,
    /// Options of L-systems.
    pub lsystem: LSystemOptions,
}

/// Kinds of sources, by how they are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// Triangle mesh.
    Mesh,
    /// L-system.
    LSystem,
    /// Trajectories, swept as curves.
    Curves,
    /// Stack of images.
    Stack,
    /// Texel that was baked before.
    Texel,
    /// Recipe that combines sources.
    Recipe,
    /// File of no known kind.
    Other,
}

/// Options that apply to some kinds of files alone: their names (keys of recipes, and command-line options with the same names), the
/// kinds, and the name of these kinds in messages. Options that are not listed apply to every source.
pub const READ_OPTIONS: [(&[&str], &[FileKind], &str); 9] = {
    use FileKind::{Curves, LSystem, Mesh, Stack};
    [
        (&["scene", "time", "animation"], &[Mesh], "glTF files"),
        (&["include", "exclude"], &[Mesh], "meshes"),
        (&["fill"], &[Mesh, Curves, LSystem], "meshes and curves"),
        (&["line_width"], &[Mesh, Curves], "meshes and curves"),
        (&["section", "curve", "width_scale"], &[Mesh, Curves], "curves"),
        (&["curve_colours"], &[Curves], "curves"),
        (&["iso", "window", "transfer", "sigma", "spacing", "channel", "frame"], &[Stack], "image stacks"),
        (&["series"], &[Stack], "DICOM folders"),
        (
            &["iterations", "seed", "angle", "string", "define", "frame_define", "dialect", "name"],
            &[LSystem],
            "L-systems",
        ),
    ]
};

/// Check whether the option `key` has no effect on the file `path`. If so, returns the name of the kinds of files that it applies to.
/// `lines` says whether lines of meshes are given a width, which makes them curves. Recipes pass options on to their files, so most
/// options have an effect on them.
pub fn unused_by(key: &str, path: &Path, lines: bool) -> Option<&'static str> {
    let (_, kinds, of) = READ_OPTIONS.into_iter().find(|(keys, ..)| keys.contains(&key))?;
    let kind = file_kind(path);
    let is_read = match (kind, key) {
        (FileKind::Recipe, "scene" | "include" | "exclude") => false,
        (FileKind::Recipe | FileKind::Other, _) => true,
        (FileKind::Mesh, "scene" | "time" | "animation") => extension(path) != "obj",
        (FileKind::Mesh, "section" | "curve" | "width_scale") => lines,
        _ => kinds.contains(&kind),
    };
    (!is_read).then_some(of)
}

/// Kind of the file `path`, by its name and, where that is not clear, by its first bytes.
pub fn file_kind(path: &Path) -> FileKind {
    match extension(path).as_str() {
        "gltf" | "glb" | "obj" => FileKind::Mesh,
        "lsys" | "ls" | "l" | "lpy" | "ini" => FileKind::LSystem,
        "vtex" => FileKind::Texel,
        "toml" | "json" => FileKind::Recipe,
        _ if !trajectory::extension(path).is_empty() => FileKind::Curves,
        "bgeo" | "geo" | "pdb" => FileKind::Other,
        _ if stack::is_stack(path) => FileKind::Stack,
        _ => FileKind::Other,
    }
}
