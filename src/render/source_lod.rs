//! Source LOD: the transition from voxels to the mesh that they were baked from, where a pixel is smaller than the finest voxel.
//!
//! Based on: G. Loubet, F. Neyret, *Hybrid Mesh-Volume LoDs for All-Scale Pre-Filtering of Complex 3D Assets*, EG 2017.

use std::path::PathBuf;
use std::sync::OnceLock;

use super::source_mesh::SourceMesh;
use crate::scene::shell::Pose;
use crate::volume::{Info, Palette};
use crate::{Result, Warnings};

/// Copies whose voxels are 2^[`BEGIN`] pixels wide are the first to be traced, and from 2^([`BEGIN`] + [`BAND`]) on all are; in between,
/// neighbouring pixels choose one or the other by ordered dithering, so that no seam shows. In a crown whose leaves are several voxels wide
/// triangles are better from half a voxel per pixel on (FLIP .045 with three rays per pixel, .071 with one cone through voxels, 1.4 times
/// the time).
const BEGIN: f32 = -1.0;
const BAND: f32 = 0.5;
/// 2^[`BEGIN`].
const FARTHEST: f32 = 0.5;
/// Facets narrower than three voxels count as voxels of a third of their width, so that they are 1.5 pixels wide where the transition begins:
/// with three rays per pixel, smaller ones alias (FLIP at one voxel per pixel, voxels and triangles: facets of .8 pixels .054 and .083, of
/// 1.1 .017 and .022, of 1.9 .043 and .039, of 6 .062 and .032).
const FACET: f32 = 3.0;

/// The mesh that a texel was baked from, read when a cone first needs it.
pub struct LazySource {
    path: PathBuf,
    palette: Palette,
    pose: Option<Pose>,
    source: OnceLock<Result<(SourceMesh, Warnings)>>,
}

impl LazySource {
    /// The mesh at `path`, shown in the colours of `palette`, as its animations have it at `pose`.
    pub fn new(path: PathBuf, palette: Palette, pose: Option<Pose>) -> LazySource {
        LazySource { path, palette, pose, source: OnceLock::new() }
    }

    /// The mesh, if a cone of the width `width` is to trace it; the finest voxels are `voxel` wide (both in cube edges). Also `None` if the
    /// mesh cannot be read.
    pub fn get(&self, info: &Info, voxel: f32, width: f32, lod_dither: f32) -> Option<&SourceMesh> {
        let facet = if info.facet_size > 0.0 { info.facet_size as f32 } else { f32::INFINITY };
        let smallest = voxel.min(facet / FACET);
        // For most copies, which are far away, the first test decides without a power.
        if smallest <= width * FARTHEST || smallest <= width * (BEGIN + BAND * lod_dither).exp2() {
            return None;
        }
        let read = || {
            let mut warnings = Warnings::default();
            SourceMesh::open(&self.path, info, (&self.palette, self.pose.as_ref()), &mut warnings)
                .map(|source| (source, warnings))
        };
        self.source.get_or_init(read).as_ref().ok().map(|(source, _)| source)
    }

    /// Number of triangles that were read; problems are added to `warnings`.
    pub fn finish(self, warnings: &mut Warnings) -> u64 {
        match self.source.into_inner() {
            Some(Ok((source, own))) => {
                warnings.merge(own);
                source.mesh.len() as u64
            }
            Some(Err(error)) => {
                warnings.add(format!("a texel's geometry cannot be read; near the camera its voxels show: {error}"));
                0
            }
            None => 0,
        }
    }
}
