//! Semi-transparent matter as sources give it: cubes filled evenly by a cloud of specks.
//!
//! Based on: J. Kajiya, B. Von Herzen, *Ray Tracing Volume Densities*, SIGGRAPH 1984 (what a density takes away along a ray);
//! W. Jakob et al., *A Radiative Transfer Framework for Rendering Materials with Anisotropic Structure*, SIGGRAPH 2010
//! (extinction by flakes with normals).

use crate::geom::{DVec3, directions13};
use crate::volume::Mix;

/// Hits per voxel edge below which matter is left out of a grid of `side` voxels an edge: over the whole edge they take away a
/// thousandth of the light.
pub fn least_extinction(side: u32) -> f64 {
    1e-3 / f64::from(side)
}

/// Matter that fills a cube of voxels evenly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Medium {
    /// Lowest voxel of the cube, in grid space.
    pub at: [u32; 3],
    /// log2 of the cube's edge in voxels. The cube lies at a multiple of its edge, within one region.
    pub levels: u32,
    /// The part of the cube that is filled, within [0, 1]^3 of the cube.
    pub lo: DVec3,
    /// Upper corner of the part that is filled.
    pub hi: DVec3,
    /// Hits in a voxel's edge, > 0, in the mean over all directions.
    pub extinction: f64,
    /// Share of the matter that is flakes square to `normal`, in [0, 1]; the rest looks the same from every side.
    pub flat: f64,
    /// Unit direction that the matter faces, in grid space; zero where there is none.
    pub normal: DVec3,
    /// One-sidedness, in [0, 1]: the length of the mean normal of what is seen.
    pub facing: f64,
    /// Whether chance alone has put its matter where it is, as in smoke; else it stands for surfaces, which go on from cube to
    /// cube and whose coverage is corrected as a surface's is.
    pub scattered: bool,
    /// Linear Rec. 709.
    pub albedo: [f32; 3],
    /// Materials that it is of, among those of its source.
    pub materials: Mix,
}

impl Medium {
    /// A whole cube that looks the same from every side.
    pub fn even(at: [u32; 3], levels: u32, extinction: f64, albedo: [f32; 3]) -> Medium {
        Medium {
            at,
            levels,
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

    /// Whether there is anything, and nothing out of range.
    pub fn is_valid(&self) -> bool {
        let inner = self.lo.cmpge(DVec3::ZERO).all() && self.hi.cmple(DVec3::ONE).all();
        self.extinction > 0.0 && self.extinction.is_finite() && inner && self.lo.cmplt(self.hi).all()
    }

    /// Hits in an edge of the cube of `2^levels` voxels along each axis.
    pub fn rates(&self, levels: u32) -> [f64; 13] {
        let whole = self.extinction * f64::from(1u32 << levels);
        // Flakes of one normal: |n . w| is 1/2 in the mean.
        directions13().map(|w| whole * (1.0 + self.flat * (2.0 * self.normal.dot(w).abs() - 1.0)))
    }
}
