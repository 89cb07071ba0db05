//! The caches of sky visibility of one scene, which all pixels of a picture share.

use super::cache::{Cache, Recent};
use super::grid::Grid;
use super::openness::Openness;
use super::packed_visibility::PackedVisibility;
use crate::geom::Aabb;
use crate::render::stats::Counts;

/// Caches of sky visibility. All threads share them.
pub struct SkyLight {
    pub(super) grid: Grid,
    /// Visibility at points in space and in copies.
    pub(super) visibility: Cache<PackedVisibility>,
    /// Visibility of the surface, or of the copy, that is nearest to a grid point; `None` where neither is near.
    pub(super) near: Cache<Option<PackedVisibility>>,
    pub(super) openness: Cache<Openness>,
}

/// The entries that one thread used last, which it finds without a lock.
pub struct RecentSky {
    pub(super) visibility: Recent<PackedVisibility>,
    pub(super) near: Recent<Option<PackedVisibility>>,
    pub(super) openness: Recent<Openness>,
}

impl RecentSky {
    pub fn new() -> RecentSky {
        RecentSky { visibility: Recent::new(), near: Recent::new(), openness: Recent::new() }
    }
}

impl SkyLight {
    /// Empty caches for a scene with these bounds, in the renderer's space.
    pub fn new(bounds: &Aabb) -> SkyLight {
        SkyLight { grid: Grid::new(bounds), visibility: Cache::new(), near: Cache::new(), openness: Cache::new() }
    }

    /// Counts of the rays and cones that filled the caches.
    pub fn counts(&self) -> Counts {
        let mut counts = self.visibility.counts();
        counts.merge(&self.near.counts());
        counts.merge(&self.openness.counts());
        counts
    }
}
