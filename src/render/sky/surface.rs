//! A grid on surfaces: its corners are moved along an axis onto the surface, and find there what they see of the sky.
//!
//! Between corners in space, of which some lie above the ground and some below, a surface would get what is seen from
//! beside it; and the trees on it hide much of what is seen from above.

use super::cache::{Corner, Of};
use super::cones::{out_of_the_ground, shares_at};
use super::grid::corners;
use super::shares::SmallShares;
use crate::geom::{DVec3, Ray};
use crate::render::pixel::Tracer;
use crate::render::prepare::World;
use crate::render::stats::Counts;
use crate::render::surround::{PARTS, Shares};

/// How far a corner is moved at the most, in cells.
const REACH: f64 = 1.5;
/// How far above the surface its light is looked for, in cells, so that the surface itself does not hide it.
const LIFT: f64 = 0.02;
/// Least cosine between a normal and the axis along which its surface is looked for; at 1/√3 or above, some normals would
/// have no axis.
const LEAST_COSINE: f64 = 0.5;

/// The share of a surface's corners that must be on the surface.
const LEAST_FOUND: f32 = 1e-3;
/// How far from a surface the grid in space is asked, in cells: what lies within it sees nothing.
const OFF_SURFACE: f64 = 0.5;

impl Tracer<'_> {
    /// The shares at a place on what is no copy; `None` where the grid ends.
    pub(super) fn shares_on_surface(&mut self, x: DVec3, normal: DVec3, width: f64) -> Option<Shares> {
        let (world, bias) = (self.world, self.sky_bias());
        let mut shares = [0.0; PARTS];
        let mut found = 0.0;
        for (level, part) in world.sky.grid.levels(width).into_iter().filter(|l| l.1 > 0.0) {
            let place = world.sky.grid.place(x, level)?;
            for way in ways(normal) {
                for (at, weight) in corners(way.flat(place)) {
                    let corner = Corner { of: Of::Surface(way.index), level, at };
                    let find = || near_corner(world, corner, &way, bias);
                    if let Some(there) = self.recent_sky.near.get(corner, &world.sky.near, find) {
                        let weight = (part * way.weight * weight) as f32;
                        there.add_to(&mut shares, weight);
                        found += weight;
                    }
                }
            }
        }
        // Corners near which there is no such surface are left out.
        if found < LEAST_FOUND { self.shares_in_space(x, normal, width) } else { Some(shares.map(|s| s / found)) }
    }

    /// The same where no corner is near the surface: from the corners in space around it.
    fn shares_in_space(&mut self, x: DVec3, outward: DVec3, width: f64) -> Option<Shares> {
        let (world, bias) = (self.world, self.sky_bias());
        let grid = &world.sky.grid;
        let mut shares = [0.0; PARTS];
        for (level, part) in grid.levels(width).into_iter().filter(|l| l.1 > 0.0) {
            let size = grid.size(level);
            for (at, weight) in corners(grid.place(x + OFF_SURFACE * size * outward, level)?) {
                let corner = Corner { of: Of::Space, level, at };
                let find = || {
                    let x = out_of_the_ground(world, grid.position(level, at), size);
                    shares_at(world, x, 0.5 * size, None, bias)
                };
                let found = self.recent_sky.shares.get(corner, &world.sky.shares, find);
                found.add_to(&mut shares, (part * weight) as f32);
            }
        }
        Some(shares)
    }
}

/// A way along an axis in which a surface faces.
struct Way {
    /// Axis, or the axis and 3 where the surface faces against it.
    index: u8,
    weight: f64,
}

impl Way {
    fn axis(&self) -> usize {
        usize::from(self.index % 3)
    }

    /// Unit.
    fn dir(&self) -> DVec3 {
        let mut dir = DVec3::ZERO;
        dir[self.axis()] = if self.index < 3 { 1.0 } else { -1.0 };
        dir
    }

    /// A place in cells, moved along the axis to the nearest layer of corners.
    fn flat(&self, mut place: DVec3) -> DVec3 {
        place[self.axis()] = place[self.axis()].round();
        place
    }
}

/// The ways in which a surface of that normal faces; their weights sum to 1.
fn ways(normal: DVec3) -> impl Iterator<Item = Way> {
    let weights = normal.abs().to_array().map(|n| (n - LEAST_COSINE).max(0.0));
    let sum: f64 = weights.iter().sum();
    (0..3u8).filter_map(move |axis| {
        let weight = weights[usize::from(axis)] / sum;
        let against = normal[usize::from(axis)] < 0.0;
        (weight > 0.0).then_some(Way { index: if against { axis + 3 } else { axis }, weight })
    })
}

/// What the sky is seen of on the surface near a corner of the grid; `None` where there is none.
fn near_corner(world: &World<'_>, corner: Corner, way: &Way, bias: f32) -> (Option<SmallShares>, Counts) {
    let Some(x) = moved(world, corner, way) else { return (None, Counts::default()) };
    // One place is found once, whichever layers of corners lead there.
    let mut at = corner.at;
    if let Some(place) = world.sky.grid.place(x, corner.level) {
        at[way.axis()] = place[way.axis()].round() as i32;
    }
    let on_surface = Corner { of: Of::OnSurface(way.index), at, ..corner };
    let find = || {
        let Some(x) = moved(world, on_surface, way) else { return (None, Counts::default()) };
        let size = world.sky.grid.size(corner.level);
        let (shares, counts) = shares_at(world, x + LIFT * size * way.dir(), 0.5 * size, None, bias);
        (Some(shares), counts)
    };
    (world.sky.near.get(on_surface, find), Counts::default())
}

/// Where a corner is moved to along the way; `None` where no surface is near.
fn moved(world: &World<'_>, corner: Corner, way: &Way) -> Option<DVec3> {
    let grid = &world.sky.grid;
    let x = grid.position(corner.level, corner.at);
    let height = height_near(world, x, way, REACH * grid.size(corner.level))?;
    Some(x + height * way.dir())
}

/// How far from `x` along the way the nearest surface is that faces it; within `reach`. Where none faces it, one that is seen
/// from behind: both sides of a sheet are lit.
fn height_near(world: &World<'_>, x: DVec3, way: &Way, reach: f64) -> Option<f64> {
    let ray = Ray { origin: x + reach * way.dir(), dir: -way.dir() };
    let mut best: Option<(bool, f64)> = None;
    world.mesh.for_each_contact(&world.scene.model, &ray, 2.0 * reach, |t, faces| {
        let height = reach - t;
        let better = best.is_none_or(|(faced, known)| (!faces, height.abs(), height) < (!faced, known.abs(), known));
        if better {
            best = Some((faces, height));
        }
    });
    best.map(|(_, height)| height)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_normal_has_a_way() {
        for n in [DVec3::Y, DVec3::ONE, DVec3::new(1.0, -1.0, 0.0), DVec3::new(-1.0, 1.0, -1.0), DVec3::NEG_Z] {
            let n = n.normalize();
            let sum: f64 = ways(n).map(|way| way.weight).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{n}");
            assert!(ways(n).all(|way| way.dir().dot(n) > LEAST_COSINE));
        }
        // Steep enough for one axis alone.
        assert_eq!(ways(DVec3::new(0.4, 0.9, 0.1)).map(|way| way.index).collect::<Vec<_>>(), [1]);
    }
}
