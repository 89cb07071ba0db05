//! Semi-transparent matter as sources give it: cubes that are filled evenly with small particles.
//!
//! Based on: J. Kajiya, B. Von Herzen, *Ray Tracing Volume Densities*, SIGGRAPH 1984 (what a density takes away along a ray);
//! W. Jakob et al., *A Radiative Transfer Framework for Rendering Materials with Anisotropic Structure*, SIGGRAPH 2010
//! (extinction by flakes with normals).

use crate::geom::{DVec3, directions13};
use crate::volume::Mix;

/// Smallest extinction, in hits per voxel edge, that is kept in a grid of `side` voxels per edge. Along the whole edge of the grid it
/// absorbs a thousandth of the light.
pub fn min_extinction(side: u32) -> f64 {
    1e-3 / f64::from(side)
}

/// Matter that fills a cube of voxels evenly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Medium {
    /// Lowest voxel of the cube, in grid space.
    pub at: [u32; 3],
    /// log2 of the cube's edge in voxels. The cube lies at a multiple of its edge, within one region.
    pub edge_log2: u32,
    /// Lower corner of the part that is filled, in edges of the cube: within [0, 1]^3.
    pub lo: DVec3,
    /// Upper corner of the part that is filled.
    pub hi: DVec3,
    /// Extinction: hits per voxel edge, > 0, averaged over all directions.
    pub extinction: f64,
    /// Share of the matter that consists of flakes perpendicular to `normal`, in [0, 1]. The rest is isotropic.
    pub flat: f64,
    /// Unit normal of the flakes, and direction of the mean normal, in grid space; zero where there is none.
    pub normal: DVec3,
    /// One-sidedness: length of the mean normal, in [0, 1].
    pub facing: f64,
    /// Whether its particles are independent, as in smoke. Else it stands for surfaces, which continue from cube to cube, and the bake
    /// corrects its coverage like that of surfaces.
    pub scattered: bool,
    /// Linear Rec. 709 albedo.
    pub albedo: [f32; 3],
    /// Mix of the source's materials.
    pub materials: Mix,
}

impl Medium {
    /// Isotropic medium that fills the whole cube.
    pub fn even(at: [u32; 3], edge_log2: u32, extinction: f64, albedo: [f32; 3]) -> Medium {
        Medium {
            at,
            edge_log2,
            lo: DVec3::ZERO,
            hi: DVec3::ONE,
            extinction,
            flat: 0.0,
            normal: DVec3::ZERO,
            facing: 0.0,
            scattered: true,
            albedo,
            materials: Mix::default(),
        }
    }

    /// Whether the extinction is positive and finite, and the filled box is not empty and lies within the cube.
    pub fn is_valid(&self) -> bool {
        let inner = self.lo.cmpge(DVec3::ZERO).all() && self.hi.cmple(DVec3::ONE).all();
        self.extinction > 0.0 && self.extinction.is_finite() && inner && self.lo.cmplt(self.hi).all()
    }

    /// Rate along each of the 13 axes, in hits per edge of a cube of `2^edge_log2` voxels.
    pub fn rates(&self, edge_log2: u32) -> [f64; 13] {
        let whole = self.extinction * f64::from(1u32 << edge_log2);
        // The projected area of flakes along w is |n · w|, whose mean over all directions is 1/2.
        directions13().map(|w| whole * (1.0 + self.flat * (2.0 * self.normal.dot(w).abs() - 1.0)))
    }
}
