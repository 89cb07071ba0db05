//! Facets that are made anew whenever they are asked for, kept for a while: copies of one thing ask for the same ones again
//! and again.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::geom::DVec3;
use crate::geom::polygon::Polygon;

/// Bytes of facets that are kept between the copies that ask for them.
pub const BYTES: usize = 32 << 20;
/// Largest depth of a source's own grid.
pub const MAX_DEPTH: usize = 12;

/// Facets, without room for corners that they do not have.
#[derive(Default)]
pub struct List {
    corners: Vec<DVec3>,
    /// Number, and where its corners end.
    facets: Vec<(u32, usize)>,
}

impl List {
    pub fn push(&mut self, facet: &Polygon) {
        self.corners.extend_from_slice(facet.corners());
        self.facets.push((facet.facet, self.corners.len()));
    }

    /// Corners and number of each, in order.
    pub fn iter(&self) -> impl Iterator<Item = (&[DVec3], u32)> {
        let mut start = 0;
        self.facets.iter().map(move |&(number, end)| (&self.corners[std::mem::replace(&mut start, end)..end], number))
    }

    fn bytes(&self) -> usize {
        size_of_val(&self.corners[..]) + size_of_val(&self.facets[..])
    }
}

/// A piece of a group, and a region of its own grid.
type Key = (u32, u32);

/// The lists that were asked for last, as many as there is room for.
pub struct Kept {
    /// Bytes.
    room: usize,
    lists: Mutex<Lists>,
}

#[derive(Default)]
struct Lists {
    /// With the time when each was asked for last.
    known: BTreeMap<Key, (Arc<List>, u64)>,
    bytes: usize,
    time: u64,
}

impl Kept {
    pub fn new(room: usize) -> Kept {
        Kept { room, lists: Mutex::default() }
    }

    fn lists(&self) -> MutexGuard<'_, Lists> {
        self.lists.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The list of `key`; `make` gives the same one always.
    pub fn get(&self, key: Key, make: impl FnOnce() -> List) -> Arc<List> {
        if let Some(list) = self.lists().find(key) {
            return list;
        }
        // Not while the lock is held: another thread may make the same one, but none waits.
        let list = Arc::new(make());
        self.lists().keep(key, &list, self.room);
        list
    }
}

impl Lists {
    fn find(&mut self, key: Key) -> Option<Arc<List>> {
        self.time += 1;
        let (list, asked) = self.known.get_mut(&key)?;
        *asked = self.time;
        Some(list.clone())
    }

    fn keep(&mut self, key: Key, list: &Arc<List>, room: usize) {
        if list.bytes() > room {
            return;
        }
        self.bytes += list.bytes();
        if let Some((before, _)) = self.known.insert(key, (list.clone(), self.time)) {
            self.bytes -= before.bytes();
        }
        while self.bytes > room {
            let Some((&oldest, _)) = self.known.iter().min_by_key(|(_, (_, asked))| *asked) else { return };
            if let Some((gone, _)) = self.known.remove(&oldest) {
                self.bytes -= gone.bytes();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn list(first: u32, count: u32) -> List {
        let mut list = List::default();
        for n in 0..count {
            let at = f64::from(first + n);
            let corners = [DVec3::splat(at), DVec3::X, DVec3::Y, DVec3::Z];
            list.push(&Polygon::new(&corners[..3 + n as usize % 2], first + n));
        }
        list
    }

    #[test]
    fn lists_give_what_was_pushed() {
        let list = list(5, 3);
        let found: Vec<(usize, f64, u32)> = list.iter().map(|(c, n)| (c.len(), c[0].x, n)).collect();
        assert_eq!(found, [(3, 5.0, 5), (4, 6.0, 6), (3, 7.0, 7)]);
    }

    #[test]
    fn what_was_not_asked_for_longest_goes_first() {
        let one = list(0, 2).bytes();
        let kept = Kept::new(2 * one);
        let made = std::cell::Cell::new(0);
        let ask = |key: u32| {
            let found = kept.get((0, key), || {
                made.set(made.get() + 1);
                list(key, 2)
            });
            assert_eq!(found.iter().next().map(|f| f.1), Some(key));
            assert!(kept.lists().bytes <= 2 * one);
            made.get()
        };
        assert_eq!([1, 2, 1, 2].map(ask), [1, 2, 2, 2]);
        // The third puts the first out, which was asked for before the second.
        assert_eq!([3, 2, 3, 1, 2].map(ask), [3, 3, 3, 4, 5]);
        // What has no room is given all the same.
        assert_eq!(kept.get((1, 0), || list(9, 5)).iter().count(), 5);
        assert_eq!(kept.lists().known.len(), 2);
    }
}
