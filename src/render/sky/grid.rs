//! Nested grids over the scene's space: the smaller the pixels, the finer the grid that they use.
//!
//! Based on: G. Ward, F. Rubinstein, R. Clear, *A Ray Tracing Solution for Diffuse Interreflection*, SIGGRAPH 1988 (light
//! from around changes slowly: it is found at few places and interpolated); G. Greger et al., *The Irradiance Volume*, IEEE
//! CG&A 1998 (places on a grid).

use crate::geom::{Aabb, DVec3};

/// Edge of a cell, in widths of the cone that it is for.
const CELL: f64 = 14.0;
/// Grid points are shifted by this share of a cell. Without it they would lie in the ground of a scene that stands on its lowest
/// plane.
const SHIFT: f64 = 0.382;
/// Finest level of the grid.
const FINEST: f64 = 30.0;

/// Grids of all levels over a scene.
pub struct Grid {
    /// A corner of the grid, and the edge of its coarsest cell.
    origin: DVec3,
    extent: f64,
}

/// The two levels around the fractional level `exact`, with their weights, which sum to 1; cells halve from level to level. Both
/// are used: if one were chosen by dithering, as depths of a texel are, levels that differ would show as grain.
pub fn two_levels(exact: f64) -> [(i32, f64); 2] {
    let low = exact.floor();
    [(low as i32, 1.0 - (exact - low)), (low as i32 + 1, exact - low)]
}

/// The eight corners of the cell around `place`, in grid coordinates, with their trilinear weights, which sum to 1. Corners of
/// weight 0 are left out.
pub fn corners(place: DVec3) -> impl Iterator<Item = ([i32; 3], f64)> {
    let low = place.floor();
    let share = place - low;
    (0..8).filter_map(move |k| {
        let of = |a: usize| if k >> a & 1 == 0 { 1.0 - share[a] } else { share[a] };
        let weight = of(0) * of(1) * of(2);
        (weight > 0.0).then(|| ([0, 1, 2].map(|a| low[a] as i32 + (k >> a & 1)), weight))
    })
}

impl Grid {
    /// A grid over `bounds`, in the renderer's space.
    pub fn new(bounds: &Aabb) -> Grid {
        let size = if bounds.is_empty() { 1.0 } else { bounds.size().max_element() };
        Grid {
            origin: if bounds.is_empty() { DVec3::ZERO } else { bounds.min },
            extent: if size > 0.0 && size.is_finite() { size } else { 1.0 },
        }
    }

    /// The two levels whose cells fit a cone `width` wide (renderer's units), with their weights, which sum to 1.
    pub fn levels(&self, width: f64) -> [(i32, f64); 2] {
        two_levels(libm::log2(self.extent / (CELL * width).max(f64::MIN_POSITIVE)).clamp(0.0, FINEST))
    }

    /// Edge of a cell of a level, in the renderer's unit.
    pub fn size(&self, level: i32) -> f64 {
        self.extent * libm::exp2(f64::from(-level))
    }

    /// The finest level whose cells are no smaller than `size`.
    pub fn level_of(&self, size: f64) -> i32 {
        libm::log2(self.extent / size.max(f64::MIN_POSITIVE)).clamp(0.0, FINEST).floor() as i32
    }

    /// The coordinates of `x` in cells of a level, in which grid points are whole numbers; `None` where they do not fit 32 bits.
    pub fn coordinates(&self, x: DVec3, level: i32) -> Option<DVec3> {
        let place = (x - self.origin) / self.size(level) - SHIFT;
        (place.abs().max_element() < f64::from(i32::MAX)).then_some(place)
    }

    /// Position of a grid point in the renderer's space.
    pub fn position(&self, level: i32, at: [i32; 3]) -> DVec3 {
        self.origin + self.size(level) * (DVec3::from_array(at.map(f64::from)) + SHIFT)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_fit_the_cone() {
        let grid = Grid::new(&Aabb::new(DVec3::ZERO, DVec3::new(0.5, 0.25, 0.1)));
        for width in [1e-6, 1e-4, 3e-3] {
            let levels = grid.levels(width);
            let cells = levels.map(|(level, _)| grid.size(level) / (CELL * width));
            assert!(
                (1.0..2.0 + 1e-9).contains(&cells[0]) && (0.5..1.0 + 1e-9).contains(&cells[1]),
                "{width}: {cells:?}"
            );
            assert!((levels[0].1 + levels[1].1 - 1.0).abs() < 1e-12 && levels.iter().all(|l| l.1 >= 0.0));
        }
        assert_eq!(grid.levels(9.0)[0], (0, 1.0));
        assert_eq!(grid.levels(0.0)[0], (30, 1.0));
        assert!(Grid::new(&Aabb::EMPTY).extent > 0.0);
        assert_eq!(grid.level_of(0.25), 1);
    }

    #[test]
    fn corners_lie_around_their_place() {
        let grid = Grid::new(&Aabb::UNIT);
        let x = DVec3::new(0.3, 0.71, -0.2);
        let around: Vec<_> = corners(grid.coordinates(x, 4).unwrap()).collect();
        let mean: DVec3 = around.iter().map(|(at, weight)| *weight * grid.position(4, *at)).sum();
        assert!((mean - x).length() < 1e-12 && around.len() == 8);
        assert!(around.iter().all(|(at, _)| (grid.position(4, *at) - x).abs().max_element() <= grid.size(4)));
        assert_eq!(corners(DVec3::new(1.0, 2.0, -3.0)).collect::<Vec<_>>(), [([1, 2, -3], 1.0)]);
        assert!(grid.coordinates(DVec3::splat(1e12), 4).is_none());
    }
}
