//! A grid in space whose corners hold light, each found when it is first asked for.
//!
//! Based on: G. Ward, F. Rubinstein, R. Clear, *A Ray Tracing Solution for Diffuse Interreflection*, SIGGRAPH 1988 (light
//! from around changes slowly: it is found at few places and interpolated); G. Greger et al., *The Irradiance Volume*, IEEE
//! CG&A 1998 (places on a grid).
//!
//! The grid lies in the scene, not in the picture, and is as fine as pixels are small there. What its corners see depends on
//! nothing but where they are, so it is found when a pixel first asks for it, by whichever thread.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::sync::{Mutex, PoisonError};

use super::stats::Counts;
use super::surround::Harmonics;
use crate::geom::{Aabb, DVec3};

/// Edge of a cell, in widths of the cone that asks.
const CELL: f64 = 14.0;
/// Corners are moved by this share of a cell, or else they would lie in the ground of a scene that stands on its lowest plane.
const SHIFT: f64 = 0.382;
/// Finest level of the grid.
const FINEST: f64 = 30.0;
/// Locks that the corners are spread over, and corners that a thread remembers without them; powers of two.
const SHARDS: usize = 64;
const RECENT: usize = 256;

/// A corner of the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Corner {
    pub level: i32,
    pub at: [i32; 3],
}

impl Corner {
    fn mixed(&self) -> u64 {
        let [x, y, z] = self.at.map(|v| u64::from(v as u32));
        let mut h = x ^ y.rotate_left(21) ^ z.rotate_left(42) ^ u64::from(self.level as u32).rotate_left(58);
        for _ in 0..2 {
            h = (h ^ (h >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
        }
        h ^ (h >> 32)
    }
}

/// Takes what [`Corner::mixed`] gives as it is.
#[derive(Default)]
struct AsIs(u64);

impl Hasher for AsIs {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = self.0.rotate_left(8) ^ u64::from(byte);
        }
    }

    fn write_u64(&mut self, value: u64) {
        self.0 = value;
    }
}

type Shard = HashMap<u64, Vec<(Corner, Harmonics)>, BuildHasherDefault<AsIs>>;

/// What was found so far.
pub struct SkyCache {
    /// A corner of the grid, and the edge of its coarsest cell.
    origin: DVec3,
    extent: f64,
    shards: Vec<Mutex<Shard>>,
    counts: Mutex<Counts>,
}

impl SkyCache {
    /// A grid over `bounds`, in the renderer's space.
    pub fn new(bounds: &Aabb) -> SkyCache {
        let size = if bounds.is_empty() { 1.0 } else { bounds.size().max_element() };
        SkyCache {
            origin: if bounds.is_empty() { DVec3::ZERO } else { bounds.min },
            extent: if size > 0.0 && size.is_finite() { size } else { 1.0 },
            shards: (0..SHARDS).map(|_| Mutex::default()).collect(),
            counts: Mutex::default(),
        }
    }

    /// The two levels between which the cells fit a cone `width` wide, with their shares, which sum to 1. Where one level were
    /// drawn by lot, as the depths of a texel are, levels that differ would show as a grain.
    pub fn levels(&self, width: f64) -> [(i32, f64); 2] {
        let exact = libm::log2(self.extent / (CELL * width).max(f64::MIN_POSITIVE)).clamp(0.0, FINEST);
        let low = exact.floor();
        [(low as i32, 1.0 - (exact - low)), (low as i32 + 1, exact - low)]
    }

    /// Edge of a cell of a level, in the renderer's unit.
    pub fn size(&self, level: i32) -> f64 {
        self.extent * libm::exp2(f64::from(-level))
    }

    /// A place in cells of a level: whole numbers are corners.
    pub fn place(&self, x: DVec3, level: i32) -> DVec3 {
        (x - self.origin) / self.size(level) - SHIFT
    }

    /// Where a corner lies.
    pub fn position(&self, corner: Corner) -> DVec3 {
        self.origin + self.size(corner.level) * (DVec3::from_array(corner.at.map(f64::from)) + SHIFT)
    }

    /// What it took to find all that was found.
    pub fn counts(&self) -> Counts {
        *self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What the corner holds, found by `find` if nobody asked before.
    pub fn get(&self, corner: Corner, find: impl FnOnce() -> (Harmonics, Counts)) -> Harmonics {
        let key = corner.mixed();
        let shard = &self.shards[key as usize & (SHARDS - 1)];
        let known = |shard: &Shard| shard.get(&key)?.iter().find(|(c, _)| *c == corner).map(|(_, light)| *light);
        if let Some(light) = known(&shard.lock().unwrap_or_else(PoisonError::into_inner)) {
            return light;
        }
        let (light, counts) = find();
        let mut shard = shard.lock().unwrap_or_else(PoisonError::into_inner);
        // Another thread may have found the same meanwhile: it counts once.
        if known(&shard).is_none() {
            shard.entry(key).or_default().push((corner, light));
            self.counts.lock().unwrap_or_else(PoisonError::into_inner).merge(&counts);
        }
        light
    }
}

/// Corners that a thread asked for last.
pub struct Recent(Vec<(Corner, Harmonics)>);

impl Recent {
    /// What the corner holds: as remembered, or from `cache`.
    pub fn get(&mut self, corner: Corner, cache: &SkyCache, find: impl FnOnce() -> (Harmonics, Counts)) -> Harmonics {
        let slot = (corner.mixed() >> 8) as usize & (RECENT - 1);
        let (known, light) = self.0[slot];
        if known == corner {
            return light;
        }
        let light = cache.get(corner, find);
        self.0[slot] = (corner, light);
        light
    }

    pub fn new() -> Recent {
        Recent(vec![(Corner { level: -1, at: [0; 3] }, Harmonics::default()); RECENT])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Vec3;

    #[test]
    fn levels_fit_the_cone() {
        let cache = SkyCache::new(&Aabb::new(DVec3::ZERO, DVec3::new(0.5, 0.25, 0.1)));
        for width in [1e-6, 1e-4, 3e-3] {
            let levels = cache.levels(width);
            let cells = levels.map(|(level, _)| cache.size(level) / (CELL * width));
            assert!(
                (1.0..2.0 + 1e-9).contains(&cells[0]) && (0.5..1.0 + 1e-9).contains(&cells[1]),
                "{width}: {cells:?}"
            );
            assert!((levels[0].1 + levels[1].1 - 1.0).abs() < 1e-12 && levels.iter().all(|l| l.1 >= 0.0));
        }
        assert_eq!(cache.levels(9.0)[0], (0, 1.0));
        assert_eq!(cache.levels(0.0)[0], (30, 1.0));
        assert!(SkyCache::new(&Aabb::EMPTY).extent > 0.0);
    }

    #[test]
    fn a_corner_is_found_once() {
        let cache = SkyCache::new(&Aabb::UNIT);
        let (one, other) = (Corner { level: 3, at: [1, -2, 5] }, Corner { level: 3, at: [1, 5, -2] });
        let light = |v: f32| (Harmonics::constant(Vec3::splat(v)), Counts { sky_cones: 1, ..Counts::default() });
        assert_eq!(cache.get(one, || light(1.0)), light(1.0).0);
        assert_eq!(cache.get(one, || light(2.0)), light(1.0).0);
        assert_eq!(cache.get(other, || light(3.0)), light(3.0).0);
        assert_eq!(cache.counts().sky_cones, 2);
        assert_ne!(one.mixed(), other.mixed());
    }
}
