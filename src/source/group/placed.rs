//! A copy of what lies in a grid of its own: its facets and their alpha, carried into the group's grid.

use crate::geom::polygon::{MAX_PIECE_CORNERS, Polygon};
use crate::geom::{Aabb, DAffine3, DVec3};
use crate::scene::alpha::AlphaClass;
use crate::source::traits::AlphaSampler;

/// A copy of what is in a grid of its own.
pub struct PlacedCopy {
    /// Its own grid → the group's, and back.
    pub map: DAffine3,
    pub back: DAffine3,
    /// Voxels of the own grid in a voxel edge.
    pub scale: f64,
    pub mirrored: bool,
    pub bounds: Aabb,
}

/// Alpha of a facet of a placed copy.
pub struct MappedAlpha<'a> {
    pub sampler: Box<dyn AlphaSampler + 'a>,
    /// The group's grid → the piece's own, and how much larger things are there.
    pub back: DAffine3,
    pub scale: f64,
}

impl AlphaSampler for MappedAlpha<'_> {
    fn classify(&self, piece: &Polygon) -> AlphaClass {
        self.sampler.classify(&piece.transformed(self.back))
    }

    fn texels_per_voxel(&self) -> f64 {
        self.sampler.texels_per_voxel() * self.scale
    }

    fn sample_row(&self, from: DVec3, step: DVec3, width: f64, alpha: &mut [f32]) {
        let (from, step) = (self.back.transform_point3(from), self.back.transform_vector3(step));
        self.sampler.sample_row(from, step, width * self.scale, alpha);
    }
}

/// Give the polygon of a copy in the group's grid; clipped ones may have more corners than a facet has, and go in two.
pub fn carry(corners: &[DVec3], copy: &PlacedCopy, facet: u32, each: &mut dyn FnMut(&Polygon)) {
    let mut placed = [DVec3::ZERO; MAX_PIECE_CORNERS];
    for (to, from) in placed.iter_mut().zip(corners) {
        *to = copy.map.transform_point3(*from);
    }
    let placed = &mut placed[..corners.len()];
    if copy.mirrored {
        placed.reverse();
    }
    Polygon::from_convex(placed, facet, each);
}
