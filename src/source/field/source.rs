//! A field as a source: facets of its surface and an opaque inside. The regions that the surface passes are found by descending an octree
//! with bounds of the field.
//!
//! Based on: F. Neyret, *Synthesizing Verdant Landscapes using Volumetric Textures*, INRIA RR-2846, 1996, section 3.1 (the
//! recursion that stops outside and inside and goes on at the frontier).

use super::Field;
use super::contour::{Cells, contour};
use crate::geom::polygon::Polygon;
use crate::geom::{Aabb, DAffine3, DVec3};
use crate::progress::Progress;
use crate::source::placement::Placement;
use crate::source::traits::{Source, Staged, Surface};
use crate::{Error, Result, Warnings, morton};

/// A field's inside as opaque matter.
pub struct FieldSource {
    field: Box<dyn Field>,
    /// Box in which the field is looked at; finite.
    window: Aabb,
    /// Source axes along which the field repeats itself with the window's width.
    repeats: [bool; 3],
    /// log2 of the cells that a voxel's edge is cut into.
    fine: u32,
    metres_per_unit: f64,
    warnings: Warnings,
}

/// Most cells of a voxel's edge, as log2.
const MAX_FINE: u32 = 3;

impl FieldSource {
    /// `window`: where the field is looked at, in its own space; what reaches beyond is cut off by a plane. Without one, the
    /// field's own box.
    ///
    /// # Errors
    /// [`Error::Options`] where the box is not finite.
    pub fn new(field: Box<dyn Field>, window: Option<Aabb>) -> Result<FieldSource> {
        let own = field.bounds();
        let window = window.map_or(own, |w| w.intersection(own));
        let finite = window.min.is_finite() && window.max.is_finite();
        if !window.is_empty() && !finite {
            return Err(Error::Options(
                "the shape has no end: give bounds within which it is to be taken, or cut it by a box".into(),
            ));
        }
        Ok(FieldSource {
            field,
            window,
            repeats: [false; 3],
            fine: 0,
            metres_per_unit: 0.0,
            warnings: Warnings::default(),
        })
    }

    /// Cut every voxel into `2^fine` cells per edge where the surface is looked for, for details smaller than a voxel.
    pub fn with_cells(mut self, fine: u32) -> FieldSource {
        self.fine = fine.min(MAX_FINE);
        self
    }

    /// The field repeats itself along these source axes with the window's width.
    pub fn repeating(mut self, axes: [bool; 3]) -> FieldSource {
        self.repeats = axes;
        self
    }

    /// The same field, of which a source unit is so many metres long.
    pub fn with_unit(mut self, metres: f64) -> FieldSource {
        self.metres_per_unit = metres;
        self
    }

    /// The field that is baked.
    pub fn field(&self) -> &dyn Field {
        &*self.field
    }
}

impl Source for FieldSource {
    fn bounds(&self) -> Aabb {
        self.window
    }

    fn metres_per_unit(&self) -> f64 {
        self.metres_per_unit
    }

    fn facet_size(&self) -> f64 {
        0.0
    }

    fn has_colour(&self) -> bool {
        self.field.has_colour()
    }

    fn warnings(&self) -> &Warnings {
        &self.warnings
    }

    fn is_inside_exact(&self) -> bool {
        true
    }

    fn stage<'a>(&'a self, place: &Placement, progress: &dyn Progress) -> Result<Box<dyn Staged + 'a>> {
        let laid = GridField::new(&*self.field, self.window, self.repeats, place, self.fine)?;
        let regions = laid.regions(place, 0.0, progress);
        Ok(Box::new(StagedField { laid, regions, cells: (1 << place.region_log2()) << self.fine }))
    }
}

/// A field in a grid of cells, of which a voxel has one or several per edge.
pub struct GridField<'a> {
    field: &'a dyn Field,
    /// Cells → source space.
    to_source: DAffine3,
    /// Cells in a voxel's edge.
    cells: f64,
    /// Box that the field's inside is cut down to, along axes where it does not repeat itself.
    window: Aabb,
    /// Cells after which a cyclic axis of the grid begins anew.
    period: [Option<i64>; 3],
    /// Offsets of the field's copies, in cells.
    shifts: Vec<DVec3>,
}

/// Value and gradient of a field at a point of the grid.
pub struct FieldSample {
    /// The point in source space.
    pub at: DVec3,
    /// The field's own value, and the value of its intersection with the window.
    pub own: f64,
    pub value: f64,
    /// Along the grid's axes.
    pub gradient: DVec3,
}

impl<'a> GridField<'a> {
    /// # Errors
    /// [`Error::Options`] where `place` flattens the source.
    pub fn new(
        field: &'a dyn Field,
        window: Aabb,
        repeats: [bool; 3],
        place: &Placement,
        fine: u32,
    ) -> Result<GridField<'a>> {
        let cells = f64::from(1u32 << fine);
        // The grid is an affine image of the source: its columns from four points.
        let origin = place.to_grid(DVec3::ZERO);
        let column = |d: DVec3| (place.to_grid(d) - origin) * cells;
        let to_cells = DAffine3 {
            matrix3: crate::geom::DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z)),
            translation: origin * cells,
        };
        let to_source = to_cells.inverse();
        if !(to_source.matrix3.is_finite() && to_source.translation.is_finite()) {
            return Err(Error::Options("a shape cannot be placed by a transform that flattens it".into()));
        }
        let mut laid = GridField {
            field,
            to_source,
            cells,
            window,
            period: place.cyclic.map(|c| c.then(|| i64::from(place.side()) << fine)),
            shifts: vec![DVec3::ZERO],
        };
        // Grid axes along which the field itself repeats: the source axis is brought onto the grid's, and the widths agree.
        let mut within = corners(window).map(|c| place.to_grid(c));
        for axis in 0..3 {
            let Some(period) = laid.period[axis] else { continue };
            let row = to_cells.matrix3.row(axis).abs();
            let source = (0..3).find(|&a| row[a] >= (1.0 - 1e-9) * row.element_sum());
            let Some(source) = source.filter(|&a| repeats[a]) else { continue };
            let width = (window.max[source] - window.min[source]) * row[source];
            if (width / period as f64 - 1.0).abs() < 1e-5 {
                // Neither copies nor an end along this axis; and the widths are made to agree exactly.
                *laid.to_source.matrix3.col_mut(axis) *= width / period as f64;
                within.iter_mut().for_each(|c| c[axis] = 0.25);
                laid.window.min[source] = f64::NEG_INFINITY;
                laid.window.max[source] = f64::INFINITY;
            }
        }
        if !window.is_empty() {
            laid.shifts = place.shifts(Aabb::around(within)).into_iter().map(|s| s * cells).collect();
        }
        Ok(laid)
    }

    /// Position of the point `at` of `cell`, in cells: cyclic axes begin anew.
    fn place(&self, cell: [i64; 3], at: DVec3) -> DVec3 {
        let axis = |a: usize| self.period[a].map_or(cell[a], |p| cell[a].rem_euclid(p)) as f64;
        DVec3::new(axis(0), axis(1), axis(2)) + at
    }

    fn source(&self, p: DVec3, shift: DVec3) -> DVec3 {
        self.to_source.transform_point3(p - shift)
    }

    /// Distance of `p` from the window along the axis where it is farthest; negative within.
    fn beyond(&self, p: DVec3) -> f64 {
        (self.window.min - p).max(p - self.window.max).max_element()
    }

    fn value_of(&self, p: DVec3, shift: DVec3) -> f64 {
        let q = self.source(p, shift);
        self.field.value(q).max(self.beyond(q))
    }

    /// The value at `p`, in cells within the cube; of copies, the lowest. No number counts as outside.
    pub fn value_at(&self, p: DVec3) -> f64 {
        self.shifts.iter().fold(f64::INFINITY, |least, &shift| least.min(self.value_of(p, shift)))
    }

    /// The copy whose value at `p` is the lowest.
    fn nearest(&self, p: DVec3) -> DVec3 {
        match self.shifts[..] {
            [only] => only,
            _ => {
                let by = |s: &&DVec3| self.value_of(p, **s);
                self.shifts.iter().min_by(|a, b| by(a).total_cmp(&by(b))).copied().unwrap_or_default()
            }
        }
    }

    /// Position in source space of the field that is met at `p` (in cells).
    pub fn source_of(&self, p: DVec3) -> DVec3 {
        self.source(p, self.nearest(p))
    }

    /// The field at `p`, in cells.
    pub fn sample(&self, p: DVec3) -> FieldSample {
        let at = self.source_of(p);
        let (value, mut g) = self.field.value_and_gradient(at);
        let beyond = self.beyond(at);
        if beyond > value {
            // The window's own face.
            let (low, high) = (self.window.min - at, at - self.window.max);
            let face = |a: usize| f64::from(u8::from(high[a] == beyond)) - f64::from(u8::from(low[a] == beyond));
            g = DVec3::new(face(0), face(1), face(2));
        }
        FieldSample { at, own: value, value: value.max(beyond), gradient: self.to_source.matrix3.transpose() * g }
    }

    /// The gradient at `p` along the grid's axes.
    pub fn gradient_at(&self, p: DVec3) -> DVec3 {
        self.sample(p).gradient
    }

    /// Bounds of the value over the box `lo .. hi` of cells, which crosses no border of a cyclic axis.
    pub fn range(&self, lo: DVec3, hi: DVec3) -> (f64, f64) {
        let mut out = (f64::INFINITY, f64::INFINITY);
        for &shift in &self.shifts {
            let b = Aabb::around(corners(Aabb::new(lo, hi)).map(|c| self.source(c, shift)));
            let outside = (self.window.min - b.max).max(b.min - self.window.max).max_element();
            let farthest = (self.window.min - b.min).max(b.max - self.window.max).max_element();
            let (low, high) = if outside > 0.0 { (outside, f64::INFINITY) } else { self.field.range(&b) };
            out = (out.0.min(low.max(outside)), out.1.min(high.max(farthest)));
        }
        out
    }

    /// A voxel's edge in source units: of a placement that shears or stretches, the mean.
    pub fn voxel_edge(&self) -> f64 {
        self.cells * libm::cbrt(self.to_source.matrix3.determinant().abs())
    }

    /// Codes of the regions that may hold values of at most `level`, by descending from the whole grid.
    pub fn regions(&self, place: &Placement, level: f64, progress: &dyn Progress) -> Vec<u64> {
        progress.stage("sort", 1);
        let mut codes = Vec::new();
        let levels = place.depth - place.region_log2();
        let region = f64::from(1u32 << place.region_log2()) * self.cells;
        let mut left = vec![(0u64, levels)];
        while let Some((code, levels)) = left.pop() {
            let width = region * f64::from(1u32 << levels);
            let lo = DVec3::from(morton::decode(code).map(f64::from)) * width;
            if self.range(lo, lo + width).0 > level {
                continue;
            }
            match levels {
                0 => codes.push(code),
                _ => left.extend((0..8).rev().map(|j| (code * 8 + j, levels - 1))),
            }
        }
        progress.advance(1);
        codes
    }
}

impl Cells for GridField<'_> {
    fn value(&self, cell: [i64; 3], at: DVec3) -> f64 {
        self.value_at(self.place(cell, at))
    }

    fn gradient(&self, cell: [i64; 3], at: DVec3) -> DVec3 {
        self.gradient_at(self.place(cell, at))
    }

    fn may_cross(&self, lo: [i64; 3], hi: [i64; 3]) -> bool {
        for a in 0..3 {
            if self.period[a].is_some_and(|p| lo[a].div_euclid(p) != (hi[a] - 1).div_euclid(p)) {
                return true;
            }
        }
        let low = self.place(lo, DVec3::ZERO);
        let size = DVec3::new((hi[0] - lo[0]) as f64, (hi[1] - lo[1]) as f64, (hi[2] - lo[2]) as f64);
        let (least, most) = self.range(low, low + size);
        // Values that are no numbers are not pruned.
        !(least > 0.0 || most < 0.0)
    }
}

fn corners(b: Aabb) -> [DVec3; 8] {
    std::array::from_fn(|j| {
        let at = |a: usize| if j >> a & 1 == 1 { b.max[a] } else { b.min[a] };
        DVec3::new(at(0), at(1), at(2))
    })
}

struct StagedField<'a> {
    laid: GridField<'a>,
    regions: Vec<u64>,
    /// Cells along a region's edge.
    cells: i64,
}

impl Staged for StagedField<'_> {
    fn regions(&self) -> &[u64] {
        &self.regions
    }

    fn weight(&self, _: usize) -> u64 {
        0
    }

    fn facets(&self) -> u32 {
        1
    }

    fn emit(&self, region: usize, each: &mut dyn FnMut(&Polygon)) {
        let lo = morton::decode(self.regions[region]).map(|v| i64::from(v) * self.cells);
        let scale = 1.0 / self.laid.cells;
        contour(&self.laid, lo, self.cells, &mut |polygon| each(&polygon.scaled(scale)));
    }

    fn surface(&self, _: u32, at: DVec3, _: f64) -> Surface {
        let albedo = match self.laid.field.has_colour() {
            true => self.laid.field.colour(self.laid.source_of(at * self.laid.cells)),
            false => None,
        };
        Surface { albedo: albedo.unwrap_or([1.0; 3]).map(|v| v.clamp(0.0, 1.0)), alpha: 1.0 }
    }

    fn has_alpha(&self, _: u32) -> bool {
        false
    }

    fn one_sided(&self, _: u32) -> bool {
        true
    }

    fn inside(&self, at: DVec3) -> bool {
        self.implicit_value(at) < 0.0
    }

    fn implicit_value(&self, at: DVec3) -> f64 {
        self.laid.value_at(at * self.laid.cells)
    }

    fn is_box_inside(&self, b: &Aabb) -> Option<bool> {
        let (least, most) = self.laid.range(b.min * self.laid.cells, b.max * self.laid.cells);
        if most < 0.0 { Some(true) } else { (least > 0.0).then_some(false) }
    }
}
