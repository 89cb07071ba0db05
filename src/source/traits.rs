//! Interface between a source and a bake. A [`Source`] knows its extent and its materials; staged in a grid, it gives its matter
//! region by region: see [`Staged`].

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
    /// Linear Rec. 709 albedo.
    pub albedo: [f32; 3],
    /// Alpha: share of the surface that is not cut out, in [0, 1].
    pub alpha: f32,
}

/// Anything that can be baked.
pub trait Source: Sync {
    /// Tight box of all matter, in source units; empty where there is none.
    fn bounds(&self) -> Aabb;
    /// Offset that was subtracted from all coordinates because they are far from 0. Bounds and all other positions that the source
    /// gives are relative to it; the bake adds it to the bounds of the texel.
    fn origin(&self) -> DVec3 {
        DVec3::ZERO
    }
    /// Box of all matter of the source placed by `transform`: the tight one where it does not cost too much to find.
    fn bounds_in(&self, transform: DAffine3) -> Aabb {
        self.bounds().transformed(transform)
    }
    /// Metres per source unit; 0 where unknown.
    fn metres_per_unit(&self) -> f64;
    /// Typical size of a flat patch of facets (a leaf, a twig's width), in source units; 0 where unknown.
    fn facet_size(&self) -> f64;
    /// Whether any facet's colour is anything but white.
    fn has_colour(&self) -> bool;
    /// Names of its materials, by id, all different; empty where it names none.
    fn materials(&self) -> &[String] {
        &[]
    }
    /// Properties of these materials besides their colour, by id; a single entry where it names no materials; empty where all are matt
    /// and opaque. The albedo of [`Staged::surface`] is that of reflection alone.
    fn surfaces(&self) -> Vec<SurfaceMeans> {
        Vec::new()
    }
    /// Warnings about input that was repaired or left out while the source was read.
    fn warnings(&self) -> &Warnings;
    /// Choices that were made where no option was given, one line each.
    fn notes(&self) -> &[String] {
        &[]
    }
    /// Source axis that points up where nothing else is asked for: 1 (+Y) or 2 (+Z).
    fn up(&self) -> u8 {
        1
    }
    /// Whether [`Staged::inside`] is exact at any resolution of the grid, so that staging in a finer grid gains nothing.
    fn is_inside_exact(&self) -> bool {
        false
    }
    /// Stage the source in a grid: sort its matter by region.
    ///
    /// # Errors
    /// [`crate::Error::Limit`] where that takes more memory than the placement allows, before it is taken.
    fn stage<'a>(&'a self, place: &Placement, progress: &dyn Progress) -> Result<Box<dyn Staged + 'a>>;
}

/// Bytes of memory per facet and region, while facets are sorted by region.
pub const FACET_MEMORY: u64 = 48;

/// A source staged in a grid. Grid space has voxels with edges of length 1.
pub trait Staged: Sync {
    /// Morton codes of the regions that may hold matter, ascending. A region is 2^[`Placement::region_log2`] voxels wide.
    fn regions(&self) -> &[u64];
    /// Number of facets that are kept in memory for a region.
    fn weight(&self, region: usize) -> u64;
    /// One more than the largest number of a facet.
    fn facets(&self) -> u32;
    /// Approximate number of bytes of memory that it takes.
    fn bytes(&self) -> u64 {
        (0..self.regions().len()).map(|r| 12 + 4 * self.weight(r)).sum()
    }
    /// Call `each` for the facets that may reach into `regions()[region]`: planar and convex, in grid space, in a fixed order. The caller
    /// clips them to the region.
    fn emit(&self, region: usize, each: &mut dyn FnMut(&Polygon));
    /// Appearance of the facet at `at` (grid space), averaged over about `width` voxels; with 0, a point sample.
    fn surface(&self, facet: u32, at: DVec3, width: f64) -> Surface;
    /// Id of the facet's material: its index in [`Source::materials`]; 0 where the source names none.
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
    /// Shading normal (unit, grid space) at `at` of a facet whose geometric normal is `own`. It changes the normals and projected areas
    /// of a voxel, but not the facet's area.
    fn normal(&self, _facet: u32, _at: DVec3, own: DVec3) -> DVec3 {
        own
    }
    /// Whether the facet is seen from one side alone, to which its normal points: a face of a closed thing, or of a sheet that
    /// its file calls single-sided.
    fn one_sided(&self, facet: u32) -> bool;
    /// Whether the facet is part of a closed surface, even one so thin that both of its sides are seen within a voxel, which is not
    /// [`one_sided`](Staged::one_sided).
    fn closed(&self, facet: u32) -> bool {
        self.one_sided(facet)
    }
    /// Call `each` for the semi-transparent matter in `regions()[region]`, cube by cube. Cubes lie within the region and do not overlap,
    /// and none of their matter may lie inside of opaque matter.
    fn medium(&self, _region: usize, _each: &mut dyn FnMut(&Medium)) {}
    /// Whether the point `at` (grid space) is inside of opaque matter. It is called for the centres of cubes without facets alone.
    /// [`Staged::regions`] must also hold the regions without facets that are inside.
    fn inside(&self, at: DVec3) -> bool;
    /// Value at `at` (grid space) of an implicit function that is negative inside of opaque matter and positive outside, with any scale.
    /// By default only its sign is known: −1 or 1.
    fn implicit_value(&self, at: DVec3) -> f64 {
        if self.inside(at) { -1.0 } else { 1.0 }
    }
    /// Whether the box `b` (grid space) lies wholly inside of opaque matter (true) or wholly outside (false); `None` where it may contain
    /// a part of the surface, or where that is not known.
    fn is_box_inside(&self, _b: &Aabb) -> Option<bool> {
        None
    }
}

/// Alpha of one facet.
pub trait AlphaSampler {
    /// Conservative classification of `piece` (grid space): `Mixed` where it may be neither transparent nor opaque throughout.
    fn classify(&self, piece: &Polygon) -> AlphaClass;
    /// Number of texels of the alpha texture per voxel edge. More samples than these give no more detail.
    fn texels_per_voxel(&self) -> f64;
    /// Fill `alpha` with the alpha at the points `from`, `from + step`, … (grid space), each averaged over about `width` voxels where
    /// texels are smaller than that.
    fn sample_row(&self, from: DVec3, step: DVec3, width: f64, alpha: &mut [f32]);
}
