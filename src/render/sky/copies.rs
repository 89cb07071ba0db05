//! What the sky is seen of from a place in a copy: what its own matter leaves open, times what all else does.

use super::InCopy;
use super::cache::{Corner, Of};
use super::cones::{out_of_the_ground, shares_at};
use super::grid::{corners, two_levels};
use super::openness::{self, Openness};
use super::shares::SmallShares;
use crate::geom::{DVec3, Ray};
use crate::render::affine::ConeWidth;
use crate::render::copy_segment::CopySegment;
use crate::render::pixel::Tracer;
use crate::render::prepare::{Item, Texel, World};
use crate::render::segments::{BoxInterval, for_each_segment};
use crate::render::shadow::LeftOut;
use crate::render::stats::Counts;
use crate::render::surround::{PARTS, Shares};

/// Widths of the cone that a copy must have for places of its own; below the first it shares those of copies near it, and
/// between them it has both.
const OWN_PLACES: [f64; 2] = [7.0, 10.0];
/// Distance of a copy's own places, in widths of the cone that sees it: most copies have one.
const PITCH: f64 = 40.0;
/// Most levels of such places, of which each has twice as many along each axis.
const MOST_LEVELS: f64 = 5.0;
/// Places are moved to a grid with cells of at most this share of the distance between them.
const QUANTUM: f64 = 0.25;
/// Width of the cones at such a place, as a share of that distance.
const WIDTH: f64 = 0.25;
/// How far out of a flat surface its own matter is looked at, in cells: what lies within it sees nothing.
const LIFT: f64 = 0.5;

impl Tracer<'_> {
    /// The shares at `x`, which is `copy`; `None` where there is no such texel, or it is too far away.
    pub(super) fn shares_in_copy(&mut self, x: DVec3, outward: DVec3, width: f64, copy: InCopy<'_>) -> Option<Shares> {
        let (world, InCopy { segment, t }) = (self.world, copy);
        let texel = world.texels.get(segment.hit.texel)?.as_ref()?;
        let place = segment.hit.origin + (t - segment.hit.t0) * segment.hit.dir;
        let own_width = width * segment.scale;
        let widths = texel.tree.info().content.size().max_element() / own_width;
        let own = ((widths - OWN_PLACES[0]) / (OWN_PLACES[1] - OWN_PLACES[0])).clamp(0.0, 1.0);
        let mut shares = [0.0; PARTS];
        if own > 0.0 {
            self.add_past_copy(&mut shares, own, x, place, own_width, (texel, segment))?;
        }
        if own < 1.0 {
            match self.shares_nearby(x, segment.hit.texel, width) {
                Some(near) => shares.iter_mut().zip(near).for_each(|(s, v)| *s += (1.0 - own as f32) * v),
                None => self.add_past_copy(&mut shares, 1.0 - own, x, place, own_width, (texel, segment))?,
            }
        }
        let outward = (segment.to_texel * outward).normalize_or_zero() * outward.length();
        let open = self.openness(texel, segment, place, outward, own_width)?;
        open.apply(&mut shares, &world.surround.parts.axes, &segment.to_texel, segment.march.opacity_scale);
        Some(shares)
    }

    /// How open the texel is at `place`, where the mean normal is `outward`, both in texel space.
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
        let lift = lift(outward);
        let mut open = Openness::default();
        for (level, part) in openness::levels(width, texel.tree.finest()?).into_iter().filter(|l| l.1 > 0.0) {
            let size = openness::size(level);
            let place = (place + lift * size * outward).clamp(DVec3::ZERO, DVec3::ONE);
            for (at, weight) in corners(place / size) {
                let corner = Corner { of: Of::Copy(index, around), level, at };
                let find = || {
                    let mut counts = Counts { sky_cones: PARTS as u64, ..Counts::default() };
                    let at = size * DVec3::from_array(at.map(f64::from));
                    (Openness::at((&*texel.tree, texel.finest), at, size, around, &mut counts.march), counts)
                };
                let found = self.recent_sky.openness.get(corner, &world.sky.openness, find);
                open.add(&found, (part * weight) as f32);
            }
        }
        Some(open)
    }

    /// Add `weight` times what comes past all but the copy itself to `x`, which is `place` in the texel; `width`: of the cone
    /// that sees it, in cube edges.
    fn add_past_copy(
        &mut self,
        shares: &mut Shares,
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
        let exact = libm::log2(largest / (PITCH * width).max(f64::MIN_POSITIVE)).clamp(0.0, MOST_LEVELS);
        for (level, part) in two_levels(exact).into_iter().filter(|l| l.1 > 0.0) {
            let pitch = largest * libm::exp2(f64::from(-level));
            let count = (extent / pitch).round().max(DVec3::ONE);
            // What is flat has no extent along an axis.
            let step = (extent / count).max(DVec3::splat(f64::MIN_POSITIVE));
            // In steps from the first place on, which is half a step from the content's edge.
            let local = ((place - content.min) / step - 0.5).clamp(DVec3::ZERO, count - 1.0);
            for (at, share) in corners(local) {
                let at = content.min + step * (DVec3::from_array(at.map(f64::from)) + 0.5);
                let corner = place_of(world, x + to_world * (at - place), pitch, segment)?;
                let find = || find(world, corner, pitch / segment.scale, left_out(texel, segment), bias);
                let found = self.recent_sky.shares.get(corner, &world.sky.shares, find);
                found.add_to(shares, (weight * part * share) as f32);
            }
        }
        Some(())
    }

    /// What copies of a texel near `x` see past all but themselves, as the grid's corners have it; `None` where there are none.
    fn shares_nearby(&mut self, x: DVec3, texel: usize, width: f64) -> Option<Shares> {
        let (world, bias) = (self.world, self.sky_bias());
        let mut shares = [0.0; PARTS];
        let mut found = 0.0;
        for (level, part) in world.sky.grid.levels(width).into_iter().filter(|l| l.1 > 0.0) {
            for (at, weight) in corners(world.sky.grid.place(x, level)?) {
                let corner = Corner { of: Of::Texel(texel), level, at };
                let find = || near_corner(world, corner, texel, bias);
                if let Some(there) = self.recent_sky.near.get(corner, &world.sky.near, find) {
                    there.add_to(&mut shares, (part * weight) as f32);
                    found += (part * weight) as f32;
                }
            }
        }
        (found > 1e-3).then(|| shares.map(|share| share / found))
    }
}

/// How far out of matter with the mean normal `outward` its openness is looked up, in cells. Normals in all directions, of which
/// those are seen that face the eye, have a mean of length 2/3.
pub fn lift(outward: DVec3) -> f64 {
    LIFT * (3.0 * outward.length() - 2.0).max(0.0)
}

/// The copy's own matter: what the openness of its texel counts already.
fn left_out(texel: &Texel, segment: &CopySegment) -> LeftOut {
    let hit = &segment.hit;
    let info = texel.tree.info();
    // Around a rigid copy there is no cell.
    let around = info.cyclic.map(|cyclic| i64::from(cyclic && !hit.is_rigid()));
    LeftOut { texel: hit.texel, cell: hit.cell, around }
}

/// The corner near `x` at which it is found what a copy sees, whose places are `pitch` cube edges apart. Where a copy is bent,
/// it depends on the ray where a place is; so it is one of few that are the same for all rays.
fn place_of(world: &World<'_>, x: DVec3, pitch: f64, segment: &CopySegment) -> Option<Corner> {
    let level = world.sky.grid.level_of(QUANTUM * pitch / segment.scale);
    let at = world.sky.grid.place(x, level)?.round().to_array().map(|v| v as i32);
    Some(Corner { of: Of::Copy(segment.hit.texel, segment.hit.cell), level, at })
}

/// The shares at such a corner; `size`: the distance between places.
fn find(world: &World<'_>, corner: Corner, size: f64, left_out: LeftOut, bias: f32) -> (SmallShares, Counts) {
    let x = out_of_the_ground(world, world.sky.grid.position(corner.level, corner.at), 0.5 * size);
    shares_at(world, x, WIDTH * size, Some(left_out), bias)
}

/// What the copy of the texel sees that is nearest, above or below, to a corner of the grid.
fn near_corner(world: &World<'_>, corner: Corner, texel: usize, bias: f32) -> (Option<SmallShares>, Counts) {
    let size = world.sky.grid.size(corner.level);
    let x = world.sky.grid.position(corner.level, corner.at);
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
        let corner = place_of(world, ray.at(t), extent.min(size * segment.scale), &segment)?;
        let find = || find(world, corner, extent / segment.scale, left_out(texel, &segment), bias);
        Some(world.sky.shares.get(corner, find))
    };
    (found(), Counts::default())
}
