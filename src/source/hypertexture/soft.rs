//! Soft hypertextures as a source: density, entered as a medium, in cubes as large as it is even.

use super::Hypertexture;
use crate::geom::polygon::Polygon;
use crate::geom::{Aabb, DVec3};
use crate::progress::Progress;
use crate::source::field::{Field, FieldSample, GridField};
use crate::source::placement::Placement;
use crate::source::traits::{Source, Staged, Surface};
use crate::source::{Medium, min_extinction};
use crate::{Error, Result, Warnings, morton};

/// A hypertexture without a hard surface.
pub struct HypertextureSource {
    texture: Hypertexture,
    window: Aabb,
    repeats: [bool; 3],
    warnings: Warnings,
}

/// Difference of optical depth within a cube from which on it is cut further.
const EVEN: f64 = 0.04;
/// Cubes of up to so many levels are looked at where bounds leave it open whether they are even: bounds of noise are some
/// times wider than what it does in most places. Larger cubes may hold more than a few places tell.
const LOOKED_AT: u32 = 1;
/// Points at which a cube is looked at: every other corner of the cube around its middle with half its edge.
const PLACES: [DVec3; 4] = [
    DVec3::new(0.25, 0.25, 0.25),
    DVec3::new(0.75, 0.75, 0.25),
    DVec3::new(0.75, 0.25, 0.75),
    DVec3::new(0.25, 0.75, 0.75),
];

impl HypertextureSource {
    /// # Errors
    /// [`Error::Options`] where the shape has no end within `window`.
    pub fn new(texture: Hypertexture, window: Option<Aabb>, repeats: [bool; 3]) -> Result<HypertextureSource> {
        let own = texture.bounds_of(0.5 * texture.set.softness);
        let window = window.map_or(own, |w| w.intersection(own));
        let finite = window.min.is_finite() && window.max.is_finite();
        if !window.is_empty() && !finite {
            return Err(Error::Options("the shape has no end: give bounds within which it is to be taken".into()));
        }
        Ok(HypertextureSource { texture, window, repeats, warnings: Warnings::default() })
    }
}

impl Source for HypertextureSource {
    fn bounds(&self) -> Aabb {
        self.window
    }

    fn metres_per_unit(&self) -> f64 {
        0.0
    }

    fn facet_size(&self) -> f64 {
        0.0
    }

    fn has_colour(&self) -> bool {
        self.texture.has_colour()
    }

    fn warnings(&self) -> &Warnings {
        &self.warnings
    }

    fn stage<'a>(&'a self, place: &Placement, progress: &dyn Progress) -> Result<Box<dyn Staged + 'a>> {
        let laid = GridField::new(&self.texture, self.window, self.repeats, place, 0)?;
        let (level, width) = (0.5 * self.texture.set.softness, 1 << place.region_log2());
        let regions = laid.regions(place, level, progress);
        // Hits in a voxel's edge where it is densest.
        let density = self.texture.set.density * laid.voxel_edge();
        let least = min_extinction(place.side());
        Ok(Box::new(Soft { texture: &self.texture, laid, regions, width, density, least }))
    }
}

struct Soft<'a> {
    texture: &'a Hypertexture,
    laid: GridField<'a>,
    regions: Vec<u64>,
    /// Voxels along a region's edge.
    width: u32,
    density: f64,
    /// Hits per voxel edge below which there is nothing.
    least: f64,
}

impl Soft<'_> {
    /// The matter in the cube of `2^edge_log2` voxels at `at`.
    fn cube(&self, at: [u32; 3], edge_log2: u32, each: &mut dyn FnMut(&Medium)) {
        let edge = f64::from(1u32 << edge_log2);
        let lo = DVec3::from(at.map(f64::from));
        if edge_log2 > 0 {
            let (near, far) = self.laid.range(lo, lo + edge);
            let most = self.density * self.texture.share(near);
            if most < self.least {
                return;
            }
            let least = self.density * self.texture.share(far);
            // Beyond an optical depth of some 12 nothing is seen of what is within.
            if (most - least) * edge < EVEN || least * edge > 12.0 {
                let met = self.laid.sample(lo + 0.5 * edge);
                return self.give(at, edge_log2, self.density * self.texture.share(met.value), Some(met), each);
            }
        }
        if edge_log2 <= LOOKED_AT {
            let found = PLACES.map(|p| self.density * self.texture.share(self.laid.value_at(lo + p * edge)));
            let (least, most) = found.iter().fold((f64::INFINITY, 0.0f64), |(l, m), &v| (l.min(v), m.max(v)));
            if edge_log2 == 0 || (most - least) * edge < 0.5 * EVEN {
                return self.give(at, edge_log2, found.iter().sum::<f64>() / found.len() as f64, None, each);
            }
        }
        let half = 1 << (edge_log2 - 1);
        for j in 0..8 {
            let child = std::array::from_fn(|a| at[a] + (j >> a & 1) * half);
            self.cube(child, edge_log2 - 1, each);
        }
    }

    /// One cube, with what is met in its middle where that is known.
    fn give(
        &self,
        at: [u32; 3],
        edge_log2: u32,
        extinction: f64,
        met: Option<FieldSample>,
        each: &mut dyn FnMut(&Medium),
    ) {
        if extinction < self.least {
            return;
        }
        let centre = DVec3::from(at.map(f64::from)) + 0.5 * f64::from(1u32 << edge_log2);
        let met = met.unwrap_or_else(|| self.laid.sample(centre));
        let colour = self.texture.colour_by(met.at, || met.own).unwrap_or([1.0; 3]).map(|v| v.clamp(0.0, 1.0));
        let mut medium = Medium::even(at, edge_log2, extinction, colour);
        if let Some(normal) = met.gradient.try_normalize() {
            // How much of the density comes or goes within the way that light gets through it.
            let t = (0.5 - met.value / self.texture.set.softness).clamp(0.0, 1.0);
            let change = self.density * 6.0 * t * (1.0 - t) / self.texture.set.softness * met.gradient.length();
            let turned = change / (extinction * extinction);
            (medium.normal, medium.facing) = (normal, if turned.is_finite() { turned / (1.0 + turned) } else { 1.0 });
        }
        each(&medium);
    }

    fn colour(&self, p: DVec3) -> [f32; 3] {
        self.texture.colour(self.laid.source_of(p)).unwrap_or([1.0; 3]).map(|v| v.clamp(0.0, 1.0))
    }
}

impl Staged for Soft<'_> {
    fn regions(&self) -> &[u64] {
        &self.regions
    }

    fn weight(&self, _: usize) -> u64 {
        0
    }

    fn facets(&self) -> u32 {
        0
    }

    fn emit(&self, _: usize, _: &mut dyn FnMut(&Polygon)) {}

    fn surface(&self, _: u32, at: DVec3, _: f64) -> Surface {
        Surface { albedo: self.colour(at), alpha: 1.0 }
    }

    fn has_alpha(&self, _: u32) -> bool {
        false
    }

    fn one_sided(&self, _: u32) -> bool {
        false
    }

    fn medium(&self, region: usize, each: &mut dyn FnMut(&Medium)) {
        let at = morton::decode(self.regions[region]).map(|v| v * self.width);
        self.cube(at, self.width.trailing_zeros(), each);
    }

    fn inside(&self, _: DVec3) -> bool {
        false
    }
}
