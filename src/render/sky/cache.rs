//! A cache of values at grid points, each computed when a thread first asks for it (as in irradiance caching).
//!
//! The value at a point depends on the point alone, so it is the same whichever thread computes it.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hash, Hasher};
use std::sync::{Mutex, PoisonError};

use crate::render::stats::Counts;

/// Locks that the values are spread over, and values that a thread keeps besides, without a lock; powers of two.
const SHARDS: usize = 64;
const RECENT: usize = 256;

/// Which grid a point belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GridId {
    /// Points in the scene's space.
    #[default]
    Space,
    /// Points near surfaces that face along an axis (0 to 2) or against it (3 to 5).
    Surface(u8),
    /// The same, where the points were moved onto the surface.
    OnSurface(u8),
    /// Points near the copies of a texel.
    Texel(usize),
    /// Points in one copy, which its texel and its cell tell.
    Copy(usize, [i64; 3]),
}

/// A point of one of several grids: its grid, the level of that, and the point's integer coordinates there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GridPoint {
    pub grid: GridId,
    pub level: i32,
    pub index: [i32; 3],
}

impl GridPoint {
    fn hash_bits(&self) -> u64 {
        let mix = |h: u64| (h ^ (h >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
        let [x, y, z] = self.index.map(|v| u64::from(v as u32));
        let mut h = x ^ y.rotate_left(21) ^ z.rotate_left(42) ^ u64::from(self.level as u32).rotate_left(58);
        h ^= match self.grid {
            GridId::Space => 0,
            GridId::Surface(way) => mix(u64::from(way) + 1),
            GridId::OnSurface(way) => mix(u64::from(way) + 7),
            GridId::Texel(texel) => mix((texel as u64 + 13).rotate_left(20)),
            GridId::Copy(texel, cell) => {
                let [x, y, z] = cell.map(|v| v as u64);
                mix(x ^ y.rotate_left(21) ^ z.rotate_left(42) ^ (texel as u64 + 13).rotate_left(55))
            }
        };
        h = mix(mix(h));
        h ^ (h >> 32)
    }
}

impl Hash for GridPoint {
    fn hash<H: Hasher>(&self, state: &mut H) {
        state.write_u64(self.hash_bits());
    }
}

/// A hasher that passes on [`GridPoint::hash_bits`] as they are, since they are mixed already.
#[derive(Default)]
struct PassThroughHasher(u64);

impl Hasher for PassThroughHasher {
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

type Shard<V> = HashMap<GridPoint, V, BuildHasherDefault<PassThroughHasher>>;

/// The values that were computed so far.
pub struct Cache<V> {
    shards: Vec<Mutex<Shard<V>>>,
    counts: Mutex<Counts>,
}

impl<V: Copy> Cache<V> {
    pub fn new() -> Cache<V> {
        Cache { shards: (0..SHARDS).map(|_| Mutex::default()).collect(), counts: Mutex::default() }
    }

    /// Counts of the rays and cones that the values took.
    pub fn counts(&self) -> Counts {
        *self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The value at a point, computed by `find` if nobody asked for it before.
    pub fn get(&self, corner: GridPoint, find: impl FnOnce() -> (V, Counts)) -> V {
        let shard = &self.shards[corner.hash_bits() as usize & (SHARDS - 1)];
        if let Some(value) = shard.lock().unwrap_or_else(PoisonError::into_inner).get(&corner) {
            return *value;
        }
        let (value, counts) = find();
        let mut shard = shard.lock().unwrap_or_else(PoisonError::into_inner);
        // Another thread may have computed the same value meanwhile: its rays are counted once.
        if shard.insert(corner, value).is_none() {
            self.counts.lock().unwrap_or_else(PoisonError::into_inner).merge(&counts);
        }
        value
    }
}

/// The values that a thread used last.
pub struct Recent<V>(Vec<Option<(GridPoint, V)>>);

impl<V: Copy> Recent<V> {
    pub fn new() -> Recent<V> {
        Recent(vec![None; RECENT])
    }

    /// The value at a point: the thread's own, else that of `cache`, which computes it by `find` if nobody asked before.
    pub fn get(&mut self, corner: GridPoint, cache: &Cache<V>, find: impl FnOnce() -> (V, Counts)) -> V {
        let slot = &mut self.0[(corner.hash_bits() >> 8) as usize & (RECENT - 1)];
        match slot {
            Some((known, value)) if *known == corner => *value,
            _ => {
                let value = cache.get(corner, find);
                *slot = Some((corner, value));
                value
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_corner_is_found_once() {
        let cache = Cache::new();
        let one = GridPoint { grid: GridId::Space, level: 3, index: [1, -2, 5] };
        let others = [
            GridPoint { index: [1, 5, -2], ..one },
            GridPoint { level: 4, ..one },
            GridPoint { grid: GridId::Surface(0), ..one },
            GridPoint { grid: GridId::Surface(4), ..one },
            GridPoint { grid: GridId::OnSurface(0), ..one },
            GridPoint { grid: GridId::Texel(0), ..one },
            GridPoint { grid: GridId::Copy(0, [0; 3]), ..one },
            GridPoint { grid: GridId::Copy(1, [0; 3]), ..one },
            GridPoint { grid: GridId::Copy(0, [0, 0, 1]), ..one },
        ];
        let found = |v: f32| (v, Counts { sky_cones: 1, ..Counts::default() });
        assert_eq!(cache.get(one, || found(1.0)), 1.0);
        assert_eq!(cache.get(one, || found(2.0)), 1.0);
        let mut recent = Recent::new();
        for (k, other) in others.into_iter().enumerate() {
            assert_ne!(one.hash_bits(), other.hash_bits());
            assert_eq!(recent.get(other, &cache, || found(k as f32 + 3.0)), k as f32 + 3.0);
            assert_eq!(recent.get(other, &cache, || found(-1.0)), k as f32 + 3.0);
        }
        assert_eq!(cache.counts().sky_cones, 1 + others.len() as u64);
    }
}
