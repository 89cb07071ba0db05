//! Curves as a source: paths with a width and a colour along them, swept by a section; tessellated only where and as finely
//! as a region of the grid needs.
//!
//! Based on: E. Catmull, R. Rom, *A Class of Local Interpolating Splines*, 1974; C. Yuksel et al., *Parameterization and
//! Applications of Catmull-Rom Curves*, CAD 2011 (centripetal); J. Bloomenthal, *Modeling the Mighty Maple*, SIGGRAPH 1985
//! (generalised cylinders in frames that do not twist).

pub mod lines;
mod path;
mod section;
mod staged;
#[cfg(test)]
mod tests;
pub mod trajectory;

use super::mesh::Fill;
use super::mesh::patch::weighted_median;
use super::placement::Placement;
use super::traits::{Source, Staged};
use crate::geom::{Aabb, DVec3};
use crate::progress::Progress;
use crate::scene::far;
use crate::{Result, Warnings};

/// A path with a width and a colour along it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Strand {
    /// In source units. A strand of one point, or of no length, is a ball.
    pub points: Vec<DVec3>,
    /// Half the width, in source units, ≥ 0: one per point; missing values at the end equal the last.
    pub radii: Vec<f32>,
    /// Linear Rec. 709 and the share that is there, in [0, 1]: one per point; missing values equal the last, or are white
    /// where there is none.
    pub colours: Vec<[f32; 4]>,
    /// Cross-section that is swept along the path.
    pub section: Section,
    /// Id of its material, where the source names some.
    pub material: u16,
    /// Direction that the flat side of a ribbon and the open side of a V face, in source space; by default the bake's up axis.
    pub up: Option<DVec3>,
}

/// Cross-section that is swept along a path.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Section {
    /// Truncated cones, closed at the ends.
    #[default]
    Round,
    /// A rectangle as wide as the strand; `thickness` is its other side as a share of the width, and 0 a sheet that is seen
    /// from both sides.
    Rectangular {
        /// Other side, as a share of the width.
        thickness: f32,
    },
    /// Two sheets that meet along the path at an angle (radians, in (0, π]), as wide at their upper edges as the strand.
    V {
        /// Angle between the sheets, radians.
        angle: f32,
    },
}

/// Interpolation between the points of a strand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interpolation {
    /// Straight lines.
    #[default]
    Linear,
    /// Centripetal Catmull-Rom: through every point, without cusps or loops within a piece.
    CatmullRom,
}

/// Options of curve sources.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CurveOptions {
    /// Interpolation between the points.
    pub interpolation: Interpolation,
    /// Inside of strands that are thicker than a voxel: empty with [`Fill::Surface`], else opaque matter.
    pub fill: Fill,
}

/// Strands of matter.
#[derive(Debug)]
pub struct CurveSource {
    points: Vec<DVec3>,
    radii: Vec<f32>,
    /// Colour per point; empty where all are white.
    colours: Vec<[f32; 4]>,
    lines: Vec<Line>,
    /// Sections and materials, as lines use them.
    sections: Vec<(Section, u16)>,
    materials: Vec<String>,
    options: CurveOptions,
    /// Offset that was subtracted from all points.
    origin: DVec3,
    bounds: Aabb,
    facet_size: f64,
    metres_per_unit: f64,
    warnings: Warnings,
    notes: Vec<String>,
}

/// One strand: points from `first` to the next line's.
#[derive(Debug, Clone, Copy)]
struct Line {
    first: usize,
    end: usize,
    /// Index into the sections.
    section: u32,
    up: Option<DVec3>,
}

impl CurveSource {
    /// `metres_per_unit`: 0 where unknown. Points that are not finite are left out, and counted in `warnings`.
    pub fn new(
        strands: impl IntoIterator<Item = Strand>,
        options: &CurveOptions,
        metres_per_unit: f64,
        warnings: Warnings,
    ) -> CurveSource {
        let mut source = CurveSource {
            points: Vec::new(),
            radii: Vec::new(),
            colours: Vec::new(),
            lines: Vec::new(),
            sections: Vec::new(),
            materials: Vec::new(),
            options: *options,
            origin: DVec3::ZERO,
            bounds: Aabb::EMPTY,
            facet_size: 0.0,
            metres_per_unit,
            warnings,
            notes: Vec::new(),
        };
        strands.into_iter().for_each(|s| source.push(&s));
        source.measure();
        source
    }

    /// The same, said to have had `origin` subtracted from all points.
    pub fn with_origin(mut self, origin: DVec3) -> CurveSource {
        self.origin = origin;
        self.notes.extend((origin != DVec3::ZERO).then(|| far::note(origin)));
        self
    }

    /// The same with the names that its strands' materials have by id.
    pub fn with_materials(mut self, names: Vec<String>) -> CurveSource {
        self.materials = names;
        self
    }

    fn push(&mut self, strand: &Strand) {
        let first = self.points.len();
        let white = [1.0; 4];
        for (i, &p) in strand.points.iter().enumerate() {
            let radius = strand.radii.get(i).or(strand.radii.last()).copied().unwrap_or(0.0);
            if !(p.is_finite() && radius.is_finite()) {
                self.warnings.add("points of curves that are not finite are left out");
                continue;
            }
            let colour = *strand.colours.get(i).or(strand.colours.last()).unwrap_or(&white);
            let colour = colour.map(|c| if c.is_nan() { 1.0 } else { c.clamp(0.0, 1.0) });
            if colour != white && self.colours.is_empty() {
                self.colours.resize(self.points.len(), white);
            }
            if colour != white || !self.colours.is_empty() {
                self.colours.push(colour);
            }
            self.points.push(p);
            self.radii.push(radius.max(0.0));
        }
        if self.points.len() == first {
            return;
        }
        let look = (strand.section, strand.material);
        if self.sections.last() != Some(&look) {
            self.sections.push(look);
        }
        let section = self.sections.len() as u32 - 1;
        self.lines.push(Line { first, end: self.points.len(), section, up: strand.up.filter(|u| u.is_finite()) });
    }

    /// Bounds, and the median width by area.
    fn measure(&mut self) {
        let coarse = Aabb::around(self.points.iter().copied()).size().max_element() / 8192.0;
        let mut sizes = Vec::with_capacity(self.lines.len());
        let mut bounds = Aabb::EMPTY;
        for line in &self.lines {
            let reach = section::reach(self.sections[line.section as usize].0);
            let path = path::flatten(self, line, coarse);
            let (mut area, mut width) = (0.0, 0.0);
            for (i, at) in path.iter().enumerate() {
                let radius = f64::from(at.radius) * reach;
                let (before, after) = (i.checked_sub(1).map(|j| path[j].at), path.get(i + 1).map(|k| k.at));
                let ways = [before.map(|b| at.at - b), after.map(|a| a - at.at)];
                for way in ways.iter().map(|w| w.and_then(DVec3::try_normalize)) {
                    // A disk across the path; a ball where there is none.
                    let across = way.map_or(DVec3::ONE, |d| (1.0 - d * d).max(DVec3::ZERO).map(f64::sqrt));
                    if way.is_some() || path.len() == 1 {
                        bounds = bounds.grow(at.at - radius * across).grow(at.at + radius * across);
                    }
                }
                if let Some(after) = path.get(i + 1) {
                    let (sum, length) = (f64::from(at.radius + after.radius), (after.at - at.at).length());
                    area += sum * length;
                    width += sum * sum * length;
                }
            }
            match path[..] {
                [ball] => sizes.push((2.0 * f64::from(ball.radius), f64::from(ball.radius).powi(2))),
                _ if area > 0.0 => sizes.push((width / area, area)),
                _ => {}
            }
        }
        (self.bounds, self.facet_size) = (bounds, weighted_median(sizes));
    }

    /// The colour of point `i` and what is there of it.
    fn colour(&self, i: usize) -> [f32; 4] {
        self.colours.get(i).copied().unwrap_or([1.0; 4])
    }
}

impl Source for CurveSource {
    fn bounds(&self) -> Aabb {
        self.bounds
    }

    fn origin(&self) -> DVec3 {
        self.origin
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn metres_per_unit(&self) -> f64 {
        self.metres_per_unit
    }

    fn facet_size(&self) -> f64 {
        self.facet_size
    }

    fn has_colour(&self) -> bool {
        self.colours.iter().any(|c| c[..3] != [1.0; 3])
    }

    fn materials(&self) -> &[String] {
        &self.materials
    }

    fn warnings(&self) -> &Warnings {
        &self.warnings
    }

    fn stage<'a>(&'a self, place: &Placement, progress: &dyn Progress) -> Result<Box<dyn Staged + 'a>> {
        Ok(Box::new(staged::StagedCurves::new(self, place, progress)?))
    }
}
