//! Interface between a source and a bake: its extent, and its matter as facets, a region at a time.

use super::medium::Medium;
use super::placement::Placement;
use crate::geom::polygon::Polygon;
use crate::geom::{Aabb, DAffine3, DVec3};
use crate::progress::Progress;
use crate::scene::alpha::AlphaClass;
use crate::volume::surface::SurfaceMeans;
use crate::{Result, Warnings};

/// Appearance of a facet at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Linear Rec. 709.
    pub albedo: [f32; 3],
    /// Share of the surface that is there, in [0, 1].
    pub alpha: f32,
}

/// Anything that can be baked.
pub trait Source: Sync {
    /// The tight box of all matter, in source space; empty where there is none.
    fn bounds(&self) -> Aabb;
    /// Vector that was subtracted from all coordinates because they are far from 0; bounds and all else that the source says of
    /// places are relative to it. The texel that is baked says where it was.
    fn origin(&self) -> DVec3 {
        DVec3::ZERO
    }
    /// A box of all matter where the source is placed by `transform`; the tight one where that is affordable.
    fn bounds_in(&self, transform: DAffine3) -> Aabb {
        self.bounds().transformed(transform)
    }
    /// Metres in a source unit; 0 where unknown.
    fn metres_per_unit(&self) -> f64;
    /// Edge of a mean facet patch (a leaf, a twig's width), in source units; 0 where unknown.
    fn facet_size(&self) -> f64;
    /// Whether any facet's colour is anything but white.
    fn has_colour(&self) -> bool;
    /// Names of the materials that its matter is of, by id, each once; none where it names none.
    fn materials(&self) -> &[String] {
        &[]
    }
    /// What these materials are besides their colour, by id, or of one that has no name; empty where all are matt and opaque.
    /// The albedo of [`Staged::surface`] is what is reflected alone.
    fn surfaces(&self) -> Vec<SurfaceMeans> {
        Vec::new()
    }
    /// Warnings of things that were mended or left out while the source was read.
    fn warnings(&self) -> &Warnings;
    /// Choices made where no option was given, one line per choice.
    fn notes(&self) -> &[String] {
        &[]
    }
    /// Source axis that points up where nothing else is asked for: 1 (+Y) or 2 (+Z).
    fn up(&self) -> u8 {
        1
    }
    /// Whether a grid of any resolution tells as exactly what is within the matter, so that a fine one is of no use.
    fn exact_inside(&self) -> bool {
        false
    }
    /// Lay the source into a grid: sort what it has by region.
    ///
    /// # Errors
    /// [`crate::Error::Limit`] where that takes more memory than the placement allows, before it is taken.
    fn stage<'a>(&'a self, place: &Placement, progress: &dyn Progress) -> Result<Box<dyn Staged + 'a>>;
}

/// Bytes of memory per facet that is kept for a region, while they are sorted by region.
pub const FACET_MEMORY: u64 = 48;

/// A source in a grid.
pub trait Staged: Sync {
    /// Morton codes of the regions that may hold matter, ascending. A region is 2^region_log2 voxels wide.
    fn regions(&self) -> &[u64];
    /// Number of facets that are kept in memory for a region.
    fn weight(&self, region: usize) -> u64;
    /// One more than the highest number of a facet.
    fn facets(&self) -> u32;
    /// Bytes of memory that it keeps, roughly.
    fn bytes(&self) -> u64 {
        (0..self.regions().len()).map(|r| 12 + 4 * self.weight(r)).sum()
    }
    /// Give the facets that may reach into `regions()[region]`, one by one: planar and convex, in grid space, in a fixed
    /// order. What reaches beyond the region is cut off by the caller.
    fn emit(&self, region: usize, each: &mut dyn FnMut(&Polygon));
    /// Appearance of the facet at `at` (grid space), averaged over about `width` voxels; with 0, a point sample.
    fn surface(&self, facet: u32, at: DVec3, width: f64) -> Surface;
    /// The id of the facet's material, among [`Source::materials`]; 0 where it names none.
    fn material(&self, _facet: u32) -> u16 {
        0
    }
    /// Whether the facet's alpha may be below 1 somewhere.
    fn has_alpha(&self, facet: u32) -> bool;
    /// Sampler of the alpha of a facet that [`has_alpha`](Staged::has_alpha); without one, [`surface`](Staged::surface) is
    /// point-sampled.
    fn alpha_sampler(&self, _facet: u32) -> Option<Box<dyn AlphaSampler + '_>> {
        None
    }
    /// The unit normal (grid space) that a facet of the unit normal `own` shows at `at`; another one leaves alone how much it
    /// covers in the mean over all directions.
    fn normal(&self, _facet: u32, _at: DVec3, own: DVec3) -> DVec3 {
        own
    }
    /// Whether the facet is one face of a closed thing: its normal points to where it is seen from.
    fn one_sided(&self, facet: u32) -> bool;
    /// Whether the facet is one face of a closed thing, were it so thin that it is seen from both sides within a voxel.
    fn closed(&self, facet: u32) -> bool {
        self.one_sided(facet)
    }
    /// Give the semi-transparent matter in `regions()[region]`, cube by cube: no two overlap, and a cube lies within the
    /// region. What of it is within opaque matter is to be left out.
    fn medium(&self, _region: usize, _each: &mut dyn FnMut(&Medium)) {}
    /// Whether the point `at` (grid space) is within opaque matter; only asked of cubes that no facet reaches, about their
    /// middles. Regions without facets that are within have to be among [`Staged::regions`].
    fn inside(&self, at: DVec3) -> bool;
    /// A value that is below 0 within opaque matter and above 0 outside, at any point; by default its sign alone is known.
    fn level(&self, at: DVec3) -> f64 {
        if self.inside(at) { -1.0 } else { 1.0 }
    }
    /// Whether the box `b` lies wholly within opaque matter (true) or wholly outside (false); `None` where it may be on the
    /// frontier, or where that is not known.
    fn side(&self, _b: &Aabb) -> Option<bool> {
        None
    }
}

/// Alpha of one facet.
pub trait AlphaSampler {
    /// Conservative bound on the alpha of `piece` (grid space).
    fn classify(&self, piece: &Polygon) -> AlphaClass;
    /// Number of texels of the alpha along a voxel's edge: more samples than these tell nothing new.
    fn texels_per_voxel(&self) -> f64;
    /// Fill `alpha` with the alpha at `from`, `from + step` … (grid space), each averaged over about `width` voxels where texels
    /// are smaller than that.
    fn sample_row(&self, from: DVec3, step: DVec3, width: f64, alpha: &mut [f32]);
}
