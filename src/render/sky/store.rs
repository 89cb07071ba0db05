//! What is found of light from all around, kept for all pixels of a picture.

use super::cache::{Cache, Recent};
use super::grid::Grid;
use super::openness::Openness;
use super::shares::SmallShares;
use crate::geom::Aabb;
use crate::render::stats::Counts;

/// What was found so far of light from all around.
pub struct SkyLight {
    pub(super) grid: Grid,
    /// At places.
    pub(super) shares: Cache<SmallShares>,
    /// Near corners of the grid; `None` where nothing is that could be lit.
    pub(super) near: Cache<Option<SmallShares>>,
    pub(super) openness: Cache<Openness>,
}

/// What a thread asked for last.
pub struct RecentSky {
    pub(super) shares: Recent<SmallShares>,
    pub(super) near: Recent<Option<SmallShares>>,
    pub(super) openness: Recent<Openness>,
}

impl RecentSky {
    pub fn new() -> RecentSky {
        RecentSky { shares: Recent::new(), near: Recent::new(), openness: Recent::new() }
    }
}

impl SkyLight {
    /// For what lies in `bounds`, in the renderer's space.
    pub fn new(bounds: &Aabb) -> SkyLight {
        SkyLight { grid: Grid::new(bounds), shares: Cache::new(), near: Cache::new(), openness: Cache::new() }
    }

    /// What it took to find all that was found.
    pub fn counts(&self) -> Counts {
        let mut counts = self.shares.counts();
        counts.merge(&self.near.counts());
        counts.merge(&self.openness.counts());
        counts
    }
}
