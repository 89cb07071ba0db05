//! Density of rigid copies on the ground: a factor in [0, 1] by a density map, by the slope and by the altitude.

use super::options::{MapOptions, MaskOver};
use super::scatter::{SampledTriangles, SurfacePoint};
use crate::geom::{Aabb, DVec3};
use crate::scene::raster::Raster;

/// Half the width of a limit's soft edge: of slopes in degrees, of altitudes as a share of the ground's height.
const SOFT_SLOPE: f64 = 2.5;
const SOFT_ALTITUDE: f64 = 0.04;
/// Largest half width of a soft edge, as a share of the distance between two limits.
const SOFT_MOST: f64 = 0.25;

/// An interval with soft edges: the density at a limit itself is a half.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Band {
    low: f64,
    high: f64,
    soft: f64,
}

impl Band {
    /// A band between two limits, either of which may be infinite.
    fn new([low, high]: [f64; 2], soft: f64) -> Band {
        Band { low, high, soft: soft.min(SOFT_MOST * (high - low)) }
    }

    fn share(&self, x: f64) -> f64 {
        let rise = |inside: f64| {
            if self.soft > 0.0 {
                let t = (0.5 + 0.5 * inside / self.soft).clamp(0.0, 1.0);
                t * t * (3.0 - 2.0 * t)
            } else {
                f64::from(u8::from(inside >= 0.0))
            }
        };
        rise(x - self.low) * rise(self.high - x)
    }
}

/// All that reduces the density of copies.
pub struct DensityFilter<'a> {
    mask: Option<(&'a Raster, MaskOver)>,
    /// Whether the density map repeats beyond the unit square of texture coordinates.
    repeats: bool,
    bounds: Aabb,
    slope: Option<Band>,
    altitude: Option<Band>,
    up: Option<DVec3>,
}

impl<'a> DensityFilter<'a> {
    /// `over` is the domain of the density map; `up` is the unit direction in which copies grow, if it is the same everywhere.
    pub fn new(
        options: &'a MapOptions,
        target: &SampledTriangles,
        over: MaskOver,
        up: Option<DVec3>,
    ) -> DensityFilter<'a> {
        let bounds = target.bounds();
        // A least slope of 0 or below is no limit.
        let open = |[low, high]: [f64; 2]| [if low <= 0.0 { f64::NEG_INFINITY } else { low }, high];
        DensityFilter {
            mask: options.density_map.as_ref().map(|m| (m, over)),
            repeats: !target.is_in_unit_square(),
            bounds,
            slope: options.slope.map(|s| Band::new(open(s), SOFT_SLOPE)),
            altitude: options.altitude.map(|a| Band::new(a, SOFT_ALTITUDE * bounds.size().y)),
            up,
        }
    }

    /// Share of the full density, in [0, 1].
    pub fn share(&self, point: &SurfacePoint) -> f64 {
        let mut share = 1.0;
        if let Some((mask, over)) = self.mask {
            share *= match over {
                MaskOver::Uv => mask.sample(point.uv[0], point.uv[1], self.repeats),
                MaskOver::Bounds => {
                    let at = (point.at - self.bounds.min) / self.bounds.size().max(DVec3::splat(f64::MIN_POSITIVE));
                    mask.sample(at.x, at.z, false)
                }
            };
        }
        if let Some(band) = &self.slope {
            let cosine = point.normal.dot(self.up.unwrap_or(DVec3::Y)).abs().min(1.0);
            share *= band.share(libm::acos(cosine).to_degrees());
        }
        if let Some(band) = &self.altitude {
            share *= band.share(point.at.y);
        }
        share
    }

    /// Whether the density is 1 everywhere.
    pub fn is_open(&self) -> bool {
        self.mask.is_none() && self.slope.is_none() && self.altitude.is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_soft_and_half_at_the_limit() {
        let band = Band::new([10.0, 30.0], SOFT_SLOPE);
        assert_eq!(
            [0.0, 7.5, 10.0, 12.5, 20.0, 30.0, 32.5].map(|x| band.share(x)),
            [0.0, 0.0, 0.5, 1.0, 1.0, 0.5, 0.0]
        );
        // A narrow band still reaches its full density.
        let band = Band::new([10.0, 11.0], SOFT_SLOPE);
        assert_eq!((band.share(10.5), band.share(9.7)), (1.0, 0.0));
        let open = Band::new([f64::NEG_INFINITY, 30.0], SOFT_SLOPE);
        assert_eq!((open.share(0.0), open.share(40.0)), (1.0, 0.0));
        assert_eq!((Band::new([5.0, 5.0], 1.0).share(5.0), Band::new([5.0, 5.0], 1.0).share(5.1)), (1.0, 0.0));
    }
}
