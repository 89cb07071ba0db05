//! What is found once and kept: values at places, each found when a thread first asks for it.
//!
//! What a place holds depends on nothing but the place, so it is the same whichever thread finds it.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hash, Hasher};
use std::sync::{Mutex, PoisonError};

use crate::render::stats::Counts;

/// Locks that the values are spread over, and values that a thread remembers without them; powers of two.
const SHARDS: usize = 64;
const RECENT: usize = 256;

/// What a grid is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Of {
    /// The scene's space.
    #[default]
    Space,
    /// What faces one way along an axis: 0 to 2, or 3 to 5 for the way against it.
    Surface(u8),
    /// The same, with corners that were moved onto the surface.
    OnSurface(u8),
    /// The copies of a texel.
    Texel(usize),
    /// One copy, by its texel and its cell.
    Copy(usize, [i64; 3]),
}

/// A place on one of several grids.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Corner {
    pub of: Of,
    pub level: i32,
    pub at: [i32; 3],
}

impl Corner {
    fn mixed(&self) -> u64 {
        let mix = |h: u64| (h ^ (h >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
        let [x, y, z] = self.at.map(|v| u64::from(v as u32));
        let mut h = x ^ y.rotate_left(21) ^ z.rotate_left(42) ^ u64::from(self.level as u32).rotate_left(58);
        h ^= match self.of {
            Of::Space => 0,
            Of::Surface(way) => mix(u64::from(way) + 1),
            Of::OnSurface(way) => mix(u64::from(way) + 7),
            Of::Texel(texel) => mix((texel as u64 + 13).rotate_left(20)),
            Of::Copy(texel, cell) => {
                let [x, y, z] = cell.map(|v| v as u64);
                mix(x ^ y.rotate_left(21) ^ z.rotate_left(42) ^ (texel as u64 + 13).rotate_left(55))
            }
        };
        h = mix(mix(h));
        h ^ (h >> 32)
    }
}

impl Hash for Corner {
    fn hash<H: Hasher>(&self, state: &mut H) {
        state.write_u64(self.mixed());
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

type Shard<V> = HashMap<Corner, V, BuildHasherDefault<AsIs>>;

/// What was found so far.
pub struct Cache<V> {
    shards: Vec<Mutex<Shard<V>>>,
    counts: Mutex<Counts>,
}

impl<V: Copy> Cache<V> {
    pub fn new() -> Cache<V> {
        Cache { shards: (0..SHARDS).map(|_| Mutex::default()).collect(), counts: Mutex::default() }
    }

    /// What it took to find all that was found.
    pub fn counts(&self) -> Counts {
        *self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What the corner holds, found by `find` if nobody asked before.
    pub fn get(&self, corner: Corner, find: impl FnOnce() -> (V, Counts)) -> V {
        let shard = &self.shards[corner.mixed() as usize & (SHARDS - 1)];
        if let Some(value) = shard.lock().unwrap_or_else(PoisonError::into_inner).get(&corner) {
            return *value;
        }
        let (value, counts) = find();
        let mut shard = shard.lock().unwrap_or_else(PoisonError::into_inner);
        // Another thread may have found the same meanwhile: it counts once.
        if shard.insert(corner, value).is_none() {
            self.counts.lock().unwrap_or_else(PoisonError::into_inner).merge(&counts);
        }
        value
    }
}

/// Values that a thread asked for last.
pub struct Recent<V>(Vec<Option<(Corner, V)>>);

impl<V: Copy> Recent<V> {
    pub fn new() -> Recent<V> {
        Recent(vec![None; RECENT])
    }

    /// What the corner holds: as remembered, or from `cache`, found by `find` if nobody asked before.
    pub fn get(&mut self, corner: Corner, cache: &Cache<V>, find: impl FnOnce() -> (V, Counts)) -> V {
        let slot = &mut self.0[(corner.mixed() >> 8) as usize & (RECENT - 1)];
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
        let one = Corner { of: Of::Space, level: 3, at: [1, -2, 5] };
        let others = [
            Corner { at: [1, 5, -2], ..one },
            Corner { level: 4, ..one },
            Corner { of: Of::Surface(0), ..one },
            Corner { of: Of::Surface(4), ..one },
            Corner { of: Of::OnSurface(0), ..one },
            Corner { of: Of::Texel(0), ..one },
            Corner { of: Of::Copy(0, [0; 3]), ..one },
            Corner { of: Of::Copy(1, [0; 3]), ..one },
            Corner { of: Of::Copy(0, [0, 0, 1]), ..one },
        ];
        let found = |v: f32| (v, Counts { sky_cones: 1, ..Counts::default() });
        assert_eq!(cache.get(one, || found(1.0)), 1.0);
        assert_eq!(cache.get(one, || found(2.0)), 1.0);
        let mut recent = Recent::new();
        for (k, other) in others.into_iter().enumerate() {
            assert_ne!(one.mixed(), other.mixed());
            assert_eq!(recent.get(other, &cache, || found(k as f32 + 3.0)), k as f32 + 3.0);
            assert_eq!(recent.get(other, &cache, || found(-1.0)), k as f32 + 3.0);
        }
        assert_eq!(cache.counts().sky_cones, 1 + others.len() as u64);
    }
}
