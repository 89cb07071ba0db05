//! The path of a ray through one box of a shell, as straight segments in the copies of texels that it crosses, ready to be marched.
//!
//! Based on: S. Porumbescu et al., *Shell Maps*, SIGGRAPH 2005 (a straight ray is a curve in texture space, here a chain of
//! chords); J. Amanatides, *Ray Tracing with Cones*, SIGGRAPH 1984 (the footprint, and so how far a chord may stray).

use super::cells::{CopyHit, TexelLayer};
use super::copy_segment::{CopySegment, round_inside};
use super::phong::{SurfaceCoords, scale_across};
use super::prepare::World;
use super::shell::{ShellBox, ShellSegment};
use crate::geom::{DMat3, DVec3, Ray};
use crate::march::transmittance::MarchSegment;

/// An interval of a ray in one box of the scene.
#[derive(Debug, Clone, Copy)]
pub struct BoxInterval {
    /// Index into [`World::boxes`].
    pub index: u32,
    /// Index of one layer of the box; `None` for all of them, one after the other.
    pub layer: Option<u32>,
    pub t0: f64,
    pub t1: f64,
}

/// Largest deviation of a chord from the ray's exact path, in widths of the cone.
const CHORD_TOLERANCE: f64 = 0.25;
/// The same in boxes over bilinear patches and under continuous jitter: a tenth of the voxel that is read, which is about as wide as the
/// cone.
const BENT_CHORD_TOLERANCE: f64 = 0.1;
/// A deviation that is always allowed, in cells: a quarter of a voxel of depth 10.
const MIN_TOLERANCE: f64 = 1.0 / 4096.0;

/// Calls `each` for the segments of `ray` in an interval, in order along the ray for each layer, until it returns false.
/// Returns false if it was stopped. `width_at(t)` is the width of the ray's cone.
pub fn for_each_segment(
    world: &World<'_>,
    ray: &Ray,
    interval: &BoxInterval,
    width_at: &dyn Fn(f64) -> f64,
    each: &mut dyn FnMut(&CopySegment) -> bool,
) -> bool {
    let BoxInterval { index, layer, t0, t1 } = *interval;
    let Some(shell) = world.boxes.get(index as usize) else { return true };
    let layers = world.layers_of(index);
    let layers = layer.map_or(layers, |layer| layers.get(layer as usize).map_or(&[], std::slice::from_ref));
    let stray = if matches!(shell, ShellBox::Patch(_)) { BENT_CHORD_TOLERANCE } else { CHORD_TOLERANCE };
    let tolerance = |t: f64, m: &DMat3| (stray * width_at(t) * scale_across(m, ray.dir)).max(MIN_TOLERANCE);
    let bent = |t: f64, m: &DMat3| (BENT_CHORD_TOLERANCE * width_at(t) * scale_across(m, ray.dir)).max(MIN_TOLERANCE);
    shell.for_each_segment(ray, t0, t1, &tolerance, &mut |segment| {
        layers.iter().all(|layer| {
            let across = || scale_across(&segment.to_texel, ray.dir);
            let coords = || SurfaceCoords::of_layer(segment, layer, across());
            layer.for_each_chord(segment, &bent, &mut |chord| {
                let cell = CellSpace::of(layer, chord, ray.dir);
                layer.for_each_copy(chord, &mut |hit| {
                    cell.segment(world, *hit, width_at, &coords).is_none_or(|s| each(&s))
                })
            })
        })
    })
}

/// The space of a layer's cells along one segment of a ray.
struct CellSpace {
    /// Linear part of the map from the renderer's space to the cells.
    to_cell: DMat3,
    /// Cells per unit of length across the ray.
    scale: f64,
    opacity_scale: f32,
    rank: u32,
}

impl CellSpace {
    /// The space of a layer along a chord in its coordinates; `dir` is the ray's.
    fn of(layer: &TexelLayer, chord: &ShellSegment, dir: DVec3) -> CellSpace {
        let opacity_scale = layer.layer.opacity_scale as f32;
        let (to_cell, rank) = (chord.to_texel, layer.rank);
        CellSpace { to_cell, scale: scale_across(&to_cell, dir), opacity_scale, rank }
    }

    /// A copy's segment, ready to be marched; `None` where it misses the texel's content.
    fn segment(
        &self,
        world: &World<'_>,
        hit: CopyHit,
        width_at: &dyn Fn(f64) -> f64,
        coords: &dyn Fn() -> SurfaceCoords,
    ) -> Option<CopySegment> {
        let texel = world.texels.get(hit.texel)?.as_ref()?;
        if hit.misses(&texel.tree.info().content) {
            return None;
        }
        let scale = self.scale * hit.inverse_scale;
        let (w0, w1) = (width_at(hit.t0), width_at(hit.t1));
        let length = hit.t1 - hit.t0;
        let march = MarchSegment {
            origin: round_inside(hit.origin),
            dir: hit.dir.as_vec3(),
            length: length as f32,
            footprint: (w0 * scale) as f32,
            growth: ((w1 - w0) / length * scale) as f32,
            opacity_scale: self.opacity_scale,
        };
        let coords = world.phongs.varies(hit.phong).then(|| Box::new(coords()));
        let (to_texel, rank) = (hit.linear * self.to_cell, self.rank);
        Some(CopySegment { hit, march, to_texel, scale, rank, affine: None, coords })
    }
}
