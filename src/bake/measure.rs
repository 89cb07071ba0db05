//! Measurements of one voxel before anything is fitted: exact areas and support, coverage along 13 axes, visible colour.
//!
//! Based on: E. Heitz, J. Dupuy, C. Crassin, C. Dachsbacher, *The SGGX Microflake Distribution*, SIGGRAPH 2015 (projected areas
//! filter linearly); G. Loubet, F. Neyret, *Hybrid Mesh-Volume LoDs for All-Scale Pre-Filtering*, EG 2017 (colour weighted by
//! visibility).

use std::sync::Arc;

use super::alpha_mask::AlphaMask;
use super::line_mask::{LineMask, MaskUnion, rasterize};
use super::materials::MaterialWeights;
use super::medium::MediumCoverage;
use crate::geom::DVec3;
use crate::geom::polygon::Polygon;
use crate::geom::{axis_length, box_area, oblique_area};
use crate::source::{AlphaSampler, Medium, Staged};

/// Smallest area of a facet that is measured, in squared voxel edges: below it a normal is mostly rounding.
const MIN_AREA: f64 = 1e-14;
/// Largest id of a material.
const MAX_MATERIAL_ID: u16 = 254;

/// Measurements of one voxel; lengths are in edges of that voxel.
#[derive(Debug, Clone)]
pub struct Measure {
    /// Tight support box, within [0, 1]^3.
    pub lo: DVec3,
    pub hi: DVec3,
    /// Oblique area that is covered, per axis.
    pub cover: [f64; 13],
    /// Sum of facet areas.
    pub total: f64,
    /// Part of `total` that belongs to semi-transparent matter.
    pub soft: f64,
    /// Sum of the area vectors of one-sided facets.
    pub mean: DVec3,
    /// Mean linear colour: of the finest voxels weighted by facet area, of coarser ones by the visible area of each child.
    pub albedo: DVec3,
    /// Areas by material, visible ones as for `albedo`; empty where materials are not tracked.
    pub materials: MaterialWeights,
    /// Whether the voxel is opaque throughout.
    pub solid: bool,
    /// Opacity of Neyret's model of 1996, in [0, 1]: the covered share of a finest voxel's projection, averaged over the 13 axes;
    /// of a coarser voxel the mean over its eight children.
    pub mean_opacity: f64,
}

impl Measure {
    fn empty() -> Measure {
        Measure {
            lo: DVec3::INFINITY,
            hi: DVec3::NEG_INFINITY,
            cover: [0.0; 13],
            total: 0.0,
            soft: 0.0,
            mean: DVec3::ZERO,
            albedo: DVec3::ZERO,
            materials: MaterialWeights::default(),
            solid: false,
            mean_opacity: 0.0,
        }
    }

    /// Measurements of a voxel that is opaque throughout.
    pub fn full() -> Measure {
        let cover = std::array::from_fn(|k| box_area(k, DVec3::ONE));
        Measure { lo: DVec3::ZERO, hi: DVec3::ONE, cover, solid: true, mean_opacity: 1.0, ..Measure::empty() }
    }

    /// Whether most of the matter is semi-transparent.
    pub fn is_soft(&self) -> bool {
        self.soft > 0.5 * self.total
    }

    /// Measurements of a parent from its children's, in child order, and the union of their line masks.
    pub fn of_children(children: &[Option<&Measure>; 8], union: &MaskUnion) -> Measure {
        let mut m = Measure::empty();
        m.solid = children.iter().all(|c| c.is_some_and(|c| c.solid));
        let mut weight = 0.0;
        for (j, child) in children.iter().enumerate() {
            let Some(child) = child else { continue };
            let offset = DVec3::new((j & 1) as f64, (j >> 1 & 1) as f64, (j >> 2) as f64);
            m.lo = m.lo.min(0.5 * (child.lo + offset));
            m.hi = m.hi.max(0.5 * (child.hi + offset));
            let mut visible_area = 0.0;
            for k in 0..13 {
                m.cover[k] += 0.25 * child.cover[k];
                let lines = union.children[j][k];
                let visible = if lines.lines > 0 { f64::from(lines.visible) / f64::from(2 * lines.lines) } else { 1.0 };
                visible_area += child.cover[k] * visible / axis_length(k);
            }
            m.mean_opacity += 0.125 * child.mean_opacity;
            m.total += 0.25 * child.total;
            m.soft += 0.25 * child.soft;
            m.mean += 0.25 * child.mean;
            if child.total > 0.0 {
                // A child that is hidden in all 26 directions still counts a little, so that a voxel always has a colour.
                let visible_area = visible_area.max(1e-9);
                m.albedo += visible_area * child.albedo;
                m.materials.add_all(&child.materials, visible_area);
                weight += visible_area;
            }
        }
        if weight > 0.0 {
            m.albedo /= weight;
            m.materials.divide(weight);
        }
        for k in 0..13 {
            let sum = union.sum_before_union[k];
            let ratio = if sum > 0 { f64::from(union.lines[k]) / f64::from(sum) } else { 1.0 };
            m.cover[k] = (m.cover[k] * ratio).min(box_area(k, m.hi - m.lo));
        }
        m
    }
}

/// Accumulator of one of the finest voxels. Facets are added one by one, and only sums of them are kept.
pub struct VoxelAccumulator {
    measure: Box<Measure>,
    mask: Arc<LineMask>,
    /// Sum over the facets of their numbers of lines, per axis.
    sum_before_union: [u32; 13],
    /// Sum over the facets of their oblique areas, per axis.
    areas: [f64; 13],
    /// Part of `areas` that belongs to closed surfaces, and the sum of its area vectors.
    closed: [f64; 13],
    facing: DVec3,
    /// Number of facets and media so far.
    pieces: usize,
    track_materials: bool,
}

impl VoxelAccumulator {
    /// Accumulator without matter; with `track_materials`, areas are kept for each material.
    pub fn new(track_materials: bool) -> VoxelAccumulator {
        VoxelAccumulator {
            track_materials,
            measure: Box::new(Measure::empty()),
            mask: Arc::default(),
            sum_before_union: [0; 13],
            pieces: 0,
            areas: [0.0; 13],
            closed: [0.0; 13],
            facing: DVec3::ZERO,
        }
    }

    /// Add a facet (grid space, already cut to the voxel at `origin`); `alpha` samples its alpha where it may be below 1.
    pub fn add(&mut self, staged: &dyn Staged, polygon: &Polygon, origin: DVec3, alpha: Option<&dyn AlphaSampler>) {
        let m = &mut self.measure;
        let area = polygon.area_vector();
        let size = area.length();
        if size.is_nan() || size < MIN_AREA {
            return;
        }
        self.pieces += 1;
        let mut coverage = 1.0;
        let albedo;
        let (lo, hi) = polygon.bounds();
        let (mut lo, mut hi) = (lo - origin, hi - origin);
        let lines = Arc::make_mut(&mut self.mask);
        if let Some(alpha) = alpha {
            let local = polygon.relative_to(origin);
            let Some(alpha) = AlphaMask::new(staged, alpha, &local, origin, area / size) else { return };
            rasterize(lines, polygon, origin, Some(&alpha), &mut self.sum_before_union);
            (coverage, albedo, lo, hi) = (alpha.coverage, alpha.albedo, alpha.lo, alpha.hi);
        } else {
            rasterize(lines, polygon, origin, None, &mut self.sum_before_union);
            let surface = staged.surface(polygon.facet, polygon.corner_mean(), size.sqrt());
            albedo = DVec3::from(surface.albedo.map(f64::from));
        }
        (m.lo, m.hi) = (m.lo.min(lo), m.hi.max(hi));
        let own = area / size;
        // A normal map turns the normals, and with them the projected areas, but not the total.
        let shown = staged.normal(polygon.facet, polygon.corner_mean(), own);
        let area = if shown == own { area } else { size * shown };
        for (k, sum) in self.areas.iter_mut().enumerate() {
            *sum += coverage * oblique_area(k, area);
        }
        if staged.closed(polygon.facet) {
            for (k, sum) in self.closed.iter_mut().enumerate() {
                *sum += coverage * oblique_area(k, area);
            }
            self.facing += coverage * area;
        }
        m.total += coverage * size;
        if staged.one_sided(polygon.facet) {
            m.mean += coverage * area;
        }
        m.albedo += coverage * size * albedo;
        if self.track_materials {
            m.materials.add(staged.material(polygon.facet).min(MAX_MATERIAL_ID) as u8, coverage * size, albedo);
        }
    }

    /// Add `medium`, which covers `part` of the voxel.
    pub fn add_medium(&mut self, part: &MediumCoverage, medium: &Medium) {
        self.pieces += 1;
        let m = &mut self.measure;
        self.sum_before_union.iter_mut().zip(part.mask.counts()).for_each(|(sum, more)| *sum += more);
        Arc::make_mut(&mut self.mask).unite_with(&part.mask);
        (m.lo, m.hi) = (m.lo.min(part.lo), m.hi.max(part.hi));
        self.areas.iter_mut().zip(&part.cover).for_each(|(sum, c)| *sum += c);
        m.total += part.area;
        m.soft += if medium.scattered { part.area } else { 0.0 };
        m.mean += part.facing;
        let albedo = DVec3::from(medium.albedo.map(f64::from));
        m.albedo += part.area * albedo;
        if self.track_materials {
            medium.materials.weights().for_each(|(id, share)| m.materials.add(id, part.area * share, albedo));
        }
    }

    /// Sum over the facets so far of their numbers of lines along the axis `k`.
    #[cfg(test)]
    pub fn lines(&self, k: usize) -> u32 {
        self.sum_before_union[k]
    }

    /// Measurements and line mask of the voxel; `None` where its facets have no area.
    pub fn finish(mut self: Box<VoxelAccumulator>) -> Option<(Box<Measure>, Arc<LineMask>)> {
        let m = &mut self.measure;
        if m.total <= 0.0 {
            return None;
        }
        m.albedo /= m.total;
        m.materials.divide(m.total);
        (m.lo, m.hi) = (m.lo.clamp(DVec3::ZERO, DVec3::ONE), m.hi.clamp(DVec3::ZERO, DVec3::ONE));
        let lines = if self.pieces == 1 { self.sum_before_union } else { self.mask.counts() };
        for (k, &sum) in self.sum_before_union.iter().enumerate() {
            // One facet covers exactly its area. Several cover the share of their summed area that the lattice finds united.
            // Where all of them slip between the lines, a closed surface covers the larger of its front and back faces.
            let area = if sum > 0 {
                self.areas[k] * f64::from(lines[k]) / f64::from(sum)
            } else {
                self.areas[k] - 0.5 * (self.closed[k] - oblique_area(k, self.facing))
            };
            m.cover[k] = area.min(box_area(k, m.hi - m.lo).max(0.0));
            m.mean_opacity += m.cover[k] / box_area(k, DVec3::ONE) / 13.0;
        }
        Some((self.measure, self.mask))
    }
}
