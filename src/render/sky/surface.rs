//! Sky visibility on surfaces: grid points are moved along an axis onto the surface, and the visibility is computed there.
//!
//! Grid points that stay in space would serve a surface badly: some lie above the ground and some below, and trees that stand on
//! the ground hide much of the sky from it that points above them see.

use super::cache::{GridId, GridPoint};
use super::cones::{lift_above_ground, visibility_at};
use super::grid::corners;
use super::packed_visibility::PackedVisibility;
use crate::geom::{DVec3, Ray};
use crate::render::environment_light::{SECTORS, SectorVisibility};
use crate::render::pixel::Tracer;
use crate::render::prepare::World;
use crate::render::stats::Counts;

/// Largest distance by which a grid point is moved, in cells.
const REACH: f64 = 1.5;
/// Height above the surface at which visibility is computed, in cells, so that the surface itself hides nothing.
const LIFT: f64 = 0.02;
/// Least cosine between a normal and an axis along which its surface is looked for. It must be below 1/√3, or some normals would
/// have no such axis.
const MIN_COSINE: f64 = 0.5;

/// Least sum of the weights of grid points that were found to lie near the surface.
const MIN_FOUND: f32 = 1e-3;
/// Distance from the surface, in cells, at which the grid in space is looked up: points within the surface would see nothing.
const OFF_SURFACE: f64 = 0.5;

impl Tracer<'_> {
    /// Sky visibility at a point of a surface that belongs to no copy; `None` outside of the grid.
    pub(super) fn sky_visibility_on_surface(
        &mut self,
        x: DVec3,
        normal: DVec3,
        width: f64,
    ) -> Option<SectorVisibility> {
        let (world, bias) = (self.world, self.sky_bias());
        let mut visibility = [0.0; SECTORS];
        let mut found = 0.0;
        for (level, level_weight) in world.sky.grid.levels(width).into_iter().filter(|l| l.1 > 0.0) {
            let place = world.sky.grid.coordinates(x, level)?;
            for facing in facings(normal) {
                for (at, weight) in corners(facing.snapped(place)) {
                    let corner = GridPoint { grid: GridId::Surface(facing.index), level, index: at };
                    let find = || visibility_near_point(world, corner, &facing, bias);
                    if let Some(there) = self.recent_sky.near.get(corner, &world.sky.near, find) {
                        let weight = (level_weight * facing.weight * weight) as f32;
                        there.add_to(&mut visibility, weight);
                        found += weight;
                    }
                }
            }
        }
        // Grid points with no such surface nearby were left out.
        if found < MIN_FOUND {
            self.sky_visibility_in_space(x, normal, width)
        } else {
            Some(visibility.map(|s| s / found))
        }
    }

    /// The same where no grid point is near the surface: from the grid points in space around it.
    fn sky_visibility_in_space(&mut self, x: DVec3, outward: DVec3, width: f64) -> Option<SectorVisibility> {
        let (world, bias) = (self.world, self.sky_bias());
        let grid = &world.sky.grid;
        let mut visibility = [0.0; SECTORS];
        for (level, level_weight) in grid.levels(width).into_iter().filter(|l| l.1 > 0.0) {
            let size = grid.size(level);
            for (at, weight) in corners(grid.coordinates(x + OFF_SURFACE * size * outward, level)?) {
                let corner = GridPoint { grid: GridId::Space, level, index: at };
                let find = || {
                    let x = lift_above_ground(world, grid.position(level, at), size);
                    visibility_at(world, x, 0.5 * size, None, bias)
                };
                let found = self.recent_sky.visibility.get(corner, &world.sky.visibility, find);
                found.add_to(&mut visibility, (level_weight * weight) as f32);
            }
        }
        Some(visibility)
    }
}

/// One of the six axis directions that a surface faces, at least partly.
struct Facing {
    /// Number of the axis, plus 3 where the surface faces against it.
    index: u8,
    weight: f64,
}

impl Facing {
    fn axis(&self) -> usize {
        usize::from(self.index % 3)
    }

    /// Unit.
    fn dir(&self) -> DVec3 {
        let mut dir = DVec3::ZERO;
        dir[self.axis()] = if self.index < 3 { 1.0 } else { -1.0 };
        dir
    }

    /// Grid coordinates, moved along the axis to the nearest layer of grid points.
    fn snapped(&self, mut place: DVec3) -> DVec3 {
        place[self.axis()] = place[self.axis()].round();
        place
    }
}

/// The axis directions that a surface of this normal faces, with weights that sum to 1.
fn facings(normal: DVec3) -> impl Iterator<Item = Facing> {
    let weights = normal.abs().to_array().map(|n| (n - MIN_COSINE).max(0.0));
    let sum: f64 = weights.iter().sum();
    (0..3u8).filter_map(move |axis| {
        let weight = weights[usize::from(axis)] / sum;
        let against = normal[usize::from(axis)] < 0.0;
        (weight > 0.0).then_some(Facing { index: if against { axis + 3 } else { axis }, weight })
    })
}

/// Sky visibility on the surface near a grid point; `None` where there is no surface.
fn visibility_near_point(
    world: &World<'_>,
    corner: GridPoint,
    facing: &Facing,
    bias: f32,
) -> (Option<PackedVisibility>, Counts) {
    let Some(x) = snap_to_surface(world, corner, facing) else { return (None, Counts::default()) };
    // Points of several layers lead to the same place of the surface, where visibility is computed once.
    let mut at = corner.index;
    if let Some(place) = world.sky.grid.coordinates(x, corner.level) {
        at[facing.axis()] = place[facing.axis()].round() as i32;
    }
    let on_surface = GridPoint { grid: GridId::OnSurface(facing.index), index: at, ..corner };
    let find = || {
        let Some(x) = snap_to_surface(world, on_surface, facing) else { return (None, Counts::default()) };
        let size = world.sky.grid.size(corner.level);
        let (visibility, counts) = visibility_at(world, x + LIFT * size * facing.dir(), 0.5 * size, None, bias);
        (Some(visibility), counts)
    };
    (world.sky.near.get(on_surface, find), Counts::default())
}

/// The point of the surface to which a grid point moves along the axis; `None` where no surface is near.
fn snap_to_surface(world: &World<'_>, corner: GridPoint, facing: &Facing) -> Option<DVec3> {
    let grid = &world.sky.grid;
    let x = grid.position(corner.level, corner.index);
    let height = nearest_surface_height(world, x, facing, REACH * grid.size(corner.level))?;
    Some(x + height * facing.dir())
}

/// Signed distance from `x`, along the axis direction and within `reach`, to the nearest surface that faces that way; if none does,
/// to the nearest one that is seen from behind, since both sides of a sheet are lit.
fn nearest_surface_height(world: &World<'_>, x: DVec3, facing: &Facing, reach: f64) -> Option<f64> {
    let ray = Ray { origin: x + reach * facing.dir(), dir: -facing.dir() };
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
            let sum: f64 = facings(n).map(|facing| facing.weight).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{n}");
            assert!(facings(n).all(|facing| facing.dir().dot(n) > MIN_COSINE));
        }
        // Steep enough for one axis alone.
        assert_eq!(facings(DVec3::new(0.4, 0.9, 0.1)).map(|facing| facing.index).collect::<Vec<_>>(), [1]);
    }
}
