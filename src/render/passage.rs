//! A ray's way through one box: the straight stretches in the copies of texels that it passes; and how much light they
//! let through.

use super::cells::Visit;
use super::prepare::World;
use super::shell::Piece;
use super::stats::Counts;
use crate::geom::{DMat3, DVec3, Ray, Vec3};
use crate::march::transmittance::{DepthChoice, Stretch, leaving, transmittance};

/// A stretch in one copy, ready to be marched.
pub struct Stretched {
    pub visit: Visit,
    pub stretch: Stretch,
    /// World → texel, the linear part.
    pub to_texel: DMat3,
    /// Cube edges in a unit of length across the ray.
    pub scale: f64,
}

/// A triangle that a ray starts on: of the scene's meshes, or of the source of a texel's copy.
#[derive(Clone, Copy)]
pub struct Start {
    pub triangle: u32,
    pub copy: Option<(usize, [i64; 3])>,
}

impl Start {
    /// The triangle, if it is of the source of this copy.
    pub fn within(start: Option<Start>, visit: &Visit) -> Option<u32> {
        start.filter(|s| s.copy == Some((visit.texel, visit.cell))).map(|s| s.triangle)
    }

    /// Whether the ray starts on matter of this copy.
    pub fn is_on(start: Option<Start>, visit: &Visit) -> bool {
        start.is_some_and(|s| s.copy == Some((visit.texel, visit.cell)))
    }

    /// The triangle, if it is of the scene's meshes.
    pub fn plain(start: Option<Start>) -> Option<u32> {
        start.filter(|s| s.copy.is_none()).map(|s| s.triangle)
    }
}

/// How far a straight piece may stray from the path, in widths of the cone.
const STRAY: f64 = 0.25;
/// And at the least, in cells: finer than a voxel of depth 10.
const LEAST_STRAY: f64 = 1.0 / 4096.0;

/// Stretches of `ray` in [t0, t1] of a box, of one layer or of all, in order of depth per layer, or of a copy, until `each` returns false.
/// False if stopped.
pub fn passage(
    world: &World<'_>,
    ray: &Ray,
    index: u32,
    layer: Option<u32>,
    (t0, t1): (f64, f64),
    width_at: &dyn Fn(f64) -> f64,
    each: &mut dyn FnMut(&Stretched) -> bool,
) -> bool {
    let Some(shell) = world.boxes.get(index as usize) else {
        let Some(copy) = world.copy(index) else { return true };
        let matrix = copy.to_texel.matrix3;
        let edges = across(&matrix, ray.dir);
        return stretched(world, copy.visit(ray, t0, t1), &matrix, edges, 1.0, width_at).is_none_or(|s| each(&s));
    };
    let skins = world.skins_of(index);
    let skins = layer.map_or(skins, |layer| skins.get(layer as usize).map_or(&[], std::slice::from_ref));
    let tolerance = |t: f64, m: &DMat3| (STRAY * width_at(t) * across(m, ray.dir)).max(LEAST_STRAY);
    shell.pieces(ray, t0, t1, &tolerance, &mut |piece| {
        skins.iter().all(|skin| {
            let (scale, offset) = (DVec3::from_array(skin.layer.scale), DVec3::from_array(skin.layer.offset));
            let to_cell = DMat3::from_diagonal(scale) * piece.to_texel;
            let piece =
                Piece { q0: piece.q0 * scale + offset, q1: piece.q1 * scale + offset, to_texel: to_cell, ..*piece };
            let edges = across(&to_cell, ray.dir);
            let opacity_scale = skin.layer.opacity_scale as f32;
            skin.walk(&piece, &mut |visit| {
                stretched(world, *visit, &to_cell, edges, opacity_scale, width_at).is_none_or(|s| each(&s))
            })
        })
    })
}

/// A visit, ready to be marched; `None` where it passes by the texel's content. `edges`: cells per unit of length across the
/// ray.
fn stretched(
    world: &World<'_>,
    visit: Visit,
    to_cell: &DMat3,
    edges: f64,
    opacity_scale: f32,
    width_at: &dyn Fn(f64) -> f64,
) -> Option<Stretched> {
    let texel = world.texels.get(visit.texel)?.as_ref()?;
    if visit.misses(&texel.tree.info().content) {
        return None;
    }
    let scale = edges * visit.zoom;
    let (w0, w1) = (width_at(visit.t0), width_at(visit.t1));
    let length = visit.t1 - visit.t0;
    let stretch = Stretch {
        origin: inside(visit.origin),
        dir: visit.dir.as_vec3(),
        length: length as f32,
        footprint: (w0 * scale) as f32,
        growth: ((w1 - w0) / length * scale) as f32,
        opacity_scale,
    };
    Some(Stretched { visit, stretch, to_texel: visit.linear * *to_cell, scale })
}

/// To f32, so that what is inside of a cube's upper faces stays so: a ray along one lies in one cube only.
fn inside(origin: DVec3) -> Vec3 {
    let rounded = origin.as_vec3();
    Vec3::select(rounded.cmpeq(Vec3::ONE) & origin.cmplt(DVec3::ONE), Vec3::splat(1.0f32.next_down()), rounded)
}

/// How many texel units a unit of length across the unit direction `d` is: the root of the ratio of areas.
fn across(m: &DMat3, d: DVec3) -> f64 {
    let along = (*m * d).length();
    if along > 0.0 { (m.determinant().abs() / along).sqrt() } else { 0.0 }
}

/// A cone towards a light or a part of the sky.
pub struct ShadowCone {
    pub ray: Ray,
    /// Distance to what shines.
    pub end: f64,
    /// Where the ray starts on matter.
    pub start: Option<Start>,
    /// Width at the start, and what it grows by along the ray.
    pub width: f64,
    pub growth: f64,
}

impl ShadowCone {
    /// The share of light that comes through the scene's meshes along the cone's ray.
    pub fn through_meshes(&self, world: &World<'_>) -> f32 {
        world.mesh.transmittance(&world.scene.model, &self.ray, self.end, Start::plain(self.start), self.width)
    }
}

/// The share of light that comes along a cone through all texels, of the share `through` that meshes leave; 0 below `stop`.
pub fn visibility(
    world: &World<'_>,
    cone: &ShadowCone,
    mut through: f32,
    choice: DepthChoice,
    stop: f32,
    counts: &mut Counts,
) -> f32 {
    if through < stop {
        return 0.0;
    }
    let ShadowCone { ray, end: t1, start, width, growth } = *cone;
    let ray = &ray;
    let width_at = |t: f64| width + growth * t;
    let end = world.shells.nearest(ray, t1, |index, t1| {
        let mut open = true;
        world.spans(index, ray, t1, |a, b| {
            counts.boxes += 1;
            open = open
                && passage(world, ray, index, None, (a, b), &width_at, &mut |step| {
                    let Some(Some(texel)) = world.texels.get(step.visit.texel) else { return true };
                    let visit = &step.visit;
                    if let Some(source) = texel.near(step.stretch.footprint, choice.threshold) {
                        counts.near_copies += 1;
                        let width = f64::from(step.stretch.footprint);
                        let inside = Ray { origin: visit.origin, dir: visit.dir };
                        let skip = Start::within(start, visit);
                        let t1 = visit.t1 - visit.t0;
                        through *= source.mesh.transmittance(&source.model, &inside, t1, skip, width);
                        return through >= stop;
                    }
                    let choice = DepthChoice { finest: texel.finest, ..choice };
                    let stop_below = stop / through;
                    let own = visit.t0 <= 0.0 && Start::is_on(start, visit);
                    let (tree, stretch, march) = (&texel.tree, &step.stretch, &mut counts.march);
                    through *= if own {
                        leaving(tree, stretch, choice, stop_below, march)
                    } else {
                        transmittance(tree, stretch, choice, stop_below, march)
                    };
                    through >= stop
                });
        });
        if open { t1 } else { -1.0 }
    });
    if end < 0.0 { 0.0 } else { through }
}
