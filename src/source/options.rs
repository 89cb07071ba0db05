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
    /// Recipes that are being read: none of them may draw itself.
    pub within: Vec<PathBuf>,
    /// Nodes of those recipes that the source lies within, and copies of it that they draw (0 is 1): their limits go on.
    pub depth: usize,
    /// Copies that those recipes draw of the source; 0 counts as 1.
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

/// By the name, and where that says nothing by the first bytes.
pub fn file_kind(path: &Path) -> FileKind {
    match extension(path).as_str() {
        "gltf" | "glb" | "obj" => FileKind::Mesh,
        "lsys" | "ls" => FileKind::LSystem,
        "vtex" => FileKind::Texel,
        "toml" | "json" => FileKind::Recipe,
        _ if !trajectory::extension(path).is_empty() => FileKind::Curves,
        "bgeo" | "geo" | "pdb" => FileKind::Other,
        _ if stack::is_stack(path) => FileKind::Stack,
        _ => FileKind::Other,
    }
}
