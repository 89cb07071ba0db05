//! Sky visibility in a copy of a texel: the openness of its own matter, times the visibility past everything else.
//!
//! The latter is computed at points of the copy itself, or, for copies that are small in the picture, is shared by copies of the
//! same texel that stand close together.

use super::PointInCopy;
use super::cache::{GridId, GridPoint};
use super::cones::{lift_above_ground, visibility_at};
use super::grid::{corners, two_levels};
use super::openness::{self, Openness};
use super::packed_visibility::PackedVisibility;
use crate::geom::{DVec3, Ray};
use crate::render::affine::ConeWidth;
use crate::render::copy_segment::CopySegment;
use crate::render::environment_light::{SECTORS, SectorVisibility};
use crate::render::pixel::Tracer;
use crate::render::prepare::{Item, Texel, World};
use crate::render::segments::{BoxInterval, for_each_segment};
use crate::render::shadow::LeftOut;
use crate::render::stats::Counts;

/// Size of a copy, in widths of the cone that sees it, from which on it has points of its own. Below the first number it shares those
/// of copies nearby; between the two numbers both are blended.
const OWN_PLACES: [f64; 2] = [7.0, 10.0];
/// Distance between a copy's own points, in widths of the cone that sees it. Most copies have one point.
const PITCH: f64 = 40.0;
/// Most levels of such points; each level has twice as many along each axis.
const MAX_LEVELS: f64 = 5.0;
/// Points are snapped to a grid whose cells are at most this share of the distance between points.
const QUANTUM: f64 = 0.25;
/// Width of the cones from such a point, as a share of that distance.
const WIDTH: f64 = 0.25;
/// Distance from a flat surface, in cells, at which its openness is looked up: points within the surface see nothing.
const LIFT: f64 = 0.5;

impl Tracer<'_> {
    /// Sky visibility at `x`, which is the point `copy`; `None` where there is no such texel, or outside of the grid. `outward` is
    /// the mean normal there, and `width` that of the cone that sees it.
    pub(super) fn sky_visibility_in_copy(
        &mut self,
        x: DVec3,
        outward: DVec3,
        width: f64,
        copy: PointInCopy<'_>,
    ) -> Option<SectorVisibility> {
        let (world, PointInCopy { segment, t }) = (self.world, copy);
        let texel = world.texels.get(segment.hit.texel)?.as_ref()?;
        let place = segment.hit.origin + (t - segment.hit.t0) * segment.hit.dir;
        let own_width = width * segment.scale;
        let widths = texel.tree.info().content.size().max_element() / own_width;
        let own = ((widths - OWN_PLACES[0]) / (OWN_PLACES[1] - OWN_PLACES[0])).clamp(0.0, 1.0);
        let mut visibility = [0.0; SECTORS];
        if own > 0.0 {
            self.add_visibility_around_copy(&mut visibility, own, x, place, own_width, (texel, segment))?;
        }
        if own < 1.0 {
            match self.visibility_near_copies(x, segment.hit.texel, width) {
                Some(near) => visibility.iter_mut().zip(near).for_each(|(s, v)| *s += (1.0 - own as f32) * v),
                None => {
                    self.add_visibility_around_copy(&mut visibility, 1.0 - own, x, place, own_width, (texel, segment))?
                }
            }
        }
        let outward = (segment.to_texel * outward).normalize_or_zero() * outward.length();
        let open = self.openness(texel, segment, place, outward, own_width)?;
        open.apply(&mut visibility, &world.environment.sectors.axes, &segment.to_texel, segment.march.opacity_scale);
        Some(visibility)
    }

    /// Openness of the texel at `place`, where the mean normal is `outward`, both in texel space.
    fn openness(
        &mut self,
        texel: &Texel,
        segment: &CopySegment,
        place: DVec3,
        outward: DVec3,
        width: f64,
    ) -> Option<Openness> {
        let world = self.world;
        let LeftOut { texel: index, around, .. } = left_out(texel, segment);
        let lift = self_occlusion_offset(outward);
        let mut open = Openness::default();
        for (level, level_weight) in openness::levels(width, texel.tree.finest()?).into_iter().filter(|l| l.1 > 0.0) {
            let size = openness::size(level);
            let place = (place + lift * size * outward).clamp(DVec3::ZERO, DVec3::ONE);
            for (at, weight) in corners(place / size) {
                let corner = GridPoint { grid: GridId::Copy(index, around), level, index: at };
                let find = || {
                    let mut counts = Counts { sky_cones: SECTORS as u64, ..Counts::default() };
                    let at = size * DVec3::from_array(at.map(f64::from));
                    (Openness::measure((&*texel.tree, texel.finest), at, size, around, &mut counts.march), counts)
                };
                let found = self.recent_sky.openness.get(corner, &world.sky.openness, find);
                open.add(&found, (level_weight * weight) as f32);
            }
        }
        Some(open)
    }

    /// Add `weight` times the visibility past everything but the copy itself at `x`, which is `place` in texel space; `width` is
    /// that of the cone that sees it, in cube edges.
    fn add_visibility_around_copy(
        &mut self,
        visibility: &mut SectorVisibility,
        weight: f64,
        x: DVec3,
        place: DVec3,
        width: f64,
        (texel, segment): (&Texel, &CopySegment),
    ) -> Option<()> {
        let (world, bias) = (self.world, self.sky_bias());
        let content = texel.tree.info().content;
        let (extent, to_world) = (content.size(), segment.to_texel.inverse());
        let largest = extent.max_element();
        let exact = libm::log2(largest / (PITCH * width).max(f64::MIN_POSITIVE)).clamp(0.0, MAX_LEVELS);
        for (level, level_weight) in two_levels(exact).into_iter().filter(|l| l.1 > 0.0) {
            let pitch = largest * libm::exp2(f64::from(-level));
            let count = (extent / pitch).round().max(DVec3::ONE);
            // Flat content has no extent along an axis.
            let step = (extent / count).max(DVec3::splat(f64::MIN_POSITIVE));
            // Counted in steps from the first point, which is half a step from the content's edge.
            let local = ((place - content.min) / step - 0.5).clamp(DVec3::ZERO, count - 1.0);
            for (at, share) in corners(local) {
                let at = content.min + step * (DVec3::from_array(at.map(f64::from)) + 0.5);
                let corner = grid_point_near(world, x + to_world * (at - place), pitch, segment)?;
                let find = || visibility_at_point(world, corner, pitch / segment.scale, left_out(texel, segment), bias);
                let found = self.recent_sky.visibility.get(corner, &world.sky.visibility, find);
                found.add_to(visibility, (weight * level_weight * share) as f32);
            }
        }
        Some(())
    }

    /// Visibility, past everything but themselves, of the copies of a texel near `x`, interpolated between the grid points around it;
    /// `None` where no such copies are near.
    fn visibility_near_copies(&mut self, x: DVec3, texel: usize, width: f64) -> Option<SectorVisibility> {
        let (world, bias) = (self.world, self.sky_bias());
        let mut visibility = [0.0; SECTORS];
        let mut found = 0.0;
        for (level, level_weight) in world.sky.grid.levels(width).into_iter().filter(|l| l.1 > 0.0) {
            for (at, weight) in corners(world.sky.grid.coordinates(x, level)?) {
                let corner = GridPoint { grid: GridId::Texel(texel), level, index: at };
                let find = || visibility_of_nearest_copy(world, corner, texel, bias);
                if let Some(there) = self.recent_sky.near.get(corner, &world.sky.near, find) {
                    there.add_to(&mut visibility, (level_weight * weight) as f32);
                    found += (level_weight * weight) as f32;
                }
            }
        }
        (found > 1e-3).then(|| visibility.map(|share| share / found))
    }
}

/// Distance from matter with the mean visible normal `outward` at which its openness is looked up, in cells. It is 0 for matter with
/// normals in all directions: of those the viewer sees half, whose mean has the length 2/3.
pub fn self_occlusion_offset(outward: DVec3) -> f64 {
    LIFT * (3.0 * outward.length() - 2.0).max(0.0)
}

/// The copy's own matter, which the openness of its texel accounts for already.
fn left_out(texel: &Texel, segment: &CopySegment) -> LeftOut {
    let hit = &segment.hit;
    let info = texel.tree.info();
    // Around a rigid copy there is no cell.
    let around = info.cyclic.map(|cyclic| i64::from(cyclic && !hit.is_rigid()));
    LeftOut { texel: hit.texel, cell: hit.cell, around }
}

/// The grid point near `x` at which the visibility around a copy is computed; the copy's points are `pitch` cube edges apart. In a
/// bent copy the position of a point depends on the ray, so it is snapped to a grid that is the same for all rays.
fn grid_point_near(world: &World<'_>, x: DVec3, pitch: f64, segment: &CopySegment) -> Option<GridPoint> {
    let level = world.sky.grid.level_of(QUANTUM * pitch / segment.scale);
    let at = world.sky.grid.coordinates(x, level)?.round().to_array().map(|v| v as i32);
    Some(GridPoint { grid: GridId::Copy(segment.hit.texel, segment.hit.cell), level, index: at })
}

/// Visibility at such a grid point; `size` is the distance between the copy's points in the renderer's units.
fn visibility_at_point(
    world: &World<'_>,
    corner: GridPoint,
    size: f64,
    left_out: LeftOut,
    bias: f32,
) -> (PackedVisibility, Counts) {
    let x = lift_above_ground(world, world.sky.grid.position(corner.level, corner.index), 0.5 * size);
    visibility_at(world, x, WIDTH * size, Some(left_out), bias)
}

/// Visibility around the copy of the texel that is nearest, above or below, to a grid point; `None` where no copy is near.
fn visibility_of_nearest_copy(
    world: &World<'_>,
    corner: GridPoint,
    texel: usize,
    bias: f32,
) -> (Option<PackedVisibility>, Counts) {
    let size = world.sky.grid.size(corner.level);
    let x = world.sky.grid.position(corner.level, corner.index);
    let ray = Ray { origin: x + size * DVec3::Y, dir: DVec3::NEG_Y };
    let mut best: Option<(f64, f64, CopySegment)> = None;
    let content = world.texels.get(texel).and_then(|t| Some(t.as_ref()?.tree.info().content));
    let mut consider = |segment: &CopySegment| {
        let hit = &segment.hit;
        let within = content.filter(|_| hit.texel == texel);
        let within = within.and_then(|b| b.hit(hit.origin, hit.dir.recip(), 0.0, hit.t1 - hit.t0));
        if let Some((a, b)) = within {
            let t = hit.t0 + 0.5 * (a + b);
            if best.as_ref().is_none_or(|(distance, ..)| (t - size).abs() < *distance) {
                best = Some(((t - size).abs(), t, segment.clone()));
            }
        }
        true
    };
    let (reach, width) = (2.0 * size, 0.25 * size);
    world.shells.nearest(&ray, reach, |index, end| {
        match world.item(index) {
            Item::Copy(number) => {
                let width = ConeWidth { start: width, growth: 0.0 };
                if let Some(segment) = world.copies.segment(number, &ray, reach, width) {
                    consider(&segment);
                }
            }
            Item::Box(shell) => shell.spans(&ray, 0.0, reach, |t0, t1| {
                let interval = BoxInterval { index, layer: None, t0, t1 };
                for_each_segment(world, &ray, &interval, &|_| width, &mut consider);
            }),
        }
        end
    });
    let found = || {
        let (_, t, segment) = best?;
        let texel = world.texels.get(texel)?.as_ref()?;
        let extent = texel.tree.info().content.size().max_element();
        let corner = grid_point_near(world, ray.at(t), extent.min(size * segment.scale), &segment)?;
        let find = || visibility_at_point(world, corner, extent / segment.scale, left_out(texel, &segment), bias);
        Some(world.sky.visibility.get(corner, find))
    };
    (found(), Counts::default())
}
