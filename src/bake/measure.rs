//! What is known of one voxel before anything is fitted: exact areas and support, measured coverage, colour of what is seen.
//!
//! Based on: C. Loop et al. / E. Heitz et al., *The SGGX Microflake Distribution*, 2015 (projected areas filter linearly);
//! G. Loubet, F. Neyret, *Hybrid Mesh-Volume LoDs*, EG 2017 (colour weighted by visibility).

use std::sync::Arc;

use super::beams::{Beams, Union};
use super::cutout::CutOut;
use super::materials::Weights;
use super::medium::Share;
use crate::geom::DVec3;
use crate::geom::polygon::Polygon;
use crate::geom::{axis_length, box_area, oblique_area};
use crate::source::Medium;
use crate::source::{Cut, Staged};

/// Lengths are in edges of the voxel itself.
#[derive(Debug, Clone)]
pub struct Measure {
    /// Tight support box, within [0, 1]^3.
    pub lo: DVec3,
    pub hi: DVec3,
    /// Oblique area of what is blocked, an axis.
    pub cover: [f64; 13],
    /// Sum of facet areas.
    pub total: f64,
    /// What of `total` belongs to semi-transparent matter.
    pub soft: f64,
    /// Sum of the area vectors of one-sided facets.
    pub mean: DVec3,
    /// Mean linear colour of what is seen.
    pub albedo: DVec3,
    /// Of which materials what is seen is; nothing where they are not told apart.
    pub materials: Weights,
    /// Opaque throughout.
    pub solid: bool,
    /// Share of the voxel covered, averaged over directions and then over the children, level by level: the opacity of
    /// Neyret's own model.
    pub averaged: f64,
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
            materials: Weights::default(),
            solid: false,
            averaged: 0.0,
        }
    }

    /// Of a voxel that is opaque throughout.
    pub fn full() -> Measure {
        let side = std::array::from_fn(|k| box_area(k, DVec3::ONE));
        Measure { lo: DVec3::ZERO, hi: DVec3::ONE, cover: side, solid: true, averaged: 1.0, ..Measure::empty() }
    }

    /// Whether most of it is semi-transparent.
    pub fn is_soft(&self) -> bool {
        self.soft > 0.5 * self.total
    }

    /// Of a parent from its children.
    pub fn of_children(children: &[Option<&Measure>; 8], union: &Union) -> Measure {
        let mut m = Measure::empty();
        m.solid = children.iter().all(|c| c.is_some_and(|c| c.solid));
        let mut weight = 0.0;
        for (j, child) in children.iter().enumerate() {
            let Some(child) = child else { continue };
            let offset = DVec3::new((j & 1) as f64, (j >> 1 & 1) as f64, (j >> 2) as f64);
            m.lo = m.lo.min(0.5 * (child.lo + offset));
            m.hi = m.hi.max(0.5 * (child.hi + offset));
            let mut seen = 0.0;
            for k in 0..13 {
                m.cover[k] += 0.25 * child.cover[k];
                let s = union.children[j][k];
                let first = if s.lines > 0 { f64::from(s.first) / f64::from(2 * s.lines) } else { 1.0 };
                seen += child.cover[k] * first / axis_length(k);
            }
            m.averaged += 0.125 * child.averaged;
            m.total += 0.25 * child.total;
            m.soft += 0.25 * child.soft;
            m.mean += 0.25 * child.mean;
            if child.total > 0.0 {
                // What is hidden on all 26 ways still has a colour.
                let seen = seen.max(1e-9);
                m.albedo += seen * child.albedo;
                m.materials.add_all(&child.materials, seen);
                weight += seen;
            }
        }
        if weight > 0.0 {
            m.albedo /= weight;
            m.materials.divide(weight);
        }
        for k in 0..13 {
            let ratio = if union.parts[k] > 0 { f64::from(union.lines[k]) / f64::from(union.parts[k]) } else { 1.0 };
            m.cover[k] = (m.cover[k] * ratio).min(box_area(k, m.hi - m.lo));
        }
        m
    }
}

/// A finest voxel while its facets come in, one by one; nothing is kept of them but sums.
pub struct Gather {
    measure: Box<Measure>,
    beams: Arc<Beams>,
    /// Lines of each facet, before they are united; and oblique areas, an axis.
    parts: [u32; 13],
    areas: [f64; 13],
    /// Of `areas` what belongs to closed things, and the sum of its area vectors.
    closed: [f64; 13],
    facing: DVec3,
    /// What has added lines so far.
    pieces: usize,
    /// Whether materials are told apart.
    materials: bool,
}

impl Gather {
    pub fn new(materials: bool) -> Gather {
        Gather {
            materials,
            measure: Box::new(Measure::empty()),
            beams: Arc::default(),
            parts: [0; 13],
            pieces: 0,
            areas: [0.0; 13],
            closed: [0.0; 13],
            facing: DVec3::ZERO,
        }
    }

    /// Add a facet (grid space, already cut to the voxel at `origin`); `cut` where alpha leaves only some of it.
    pub fn add(&mut self, staged: &dyn Staged, polygon: &Polygon, origin: DVec3, cut: Option<&dyn Cut>) {
        let m = &mut self.measure;
        let area = polygon.area_vector();
        let size = area.length();
        if size.is_nan() || size < 1e-14 {
            return;
        }
        self.pieces += 1;
        let mut share = 1.0;
        let albedo;
        let (lo, hi) = polygon.bounds();
        let (mut lo, mut hi) = (lo - origin, hi - origin);
        if let Some(cut) = cut {
            let p = polygon.relative_to(origin);
            let Some(cut) = CutOut::new(staged, cut, &p, origin, area / size) else { return };
            Arc::make_mut(&mut self.beams).add(polygon, origin, &mut self.parts, Some(&cut));
            (share, albedo, lo, hi) = (cut.share, cut.albedo, cut.lo, cut.hi);
        } else {
            Arc::make_mut(&mut self.beams).add(polygon, origin, &mut self.parts, None);
            let s = staged.surface(polygon.facet, polygon.middle(), size.sqrt());
            albedo = DVec3::from(s.albedo.map(f64::from));
        }
        (m.lo, m.hi) = (m.lo.min(lo), m.hi.max(hi));
        let own = area / size;
        let shown = staged.normal(polygon.facet, polygon.middle(), own);
        let area = if shown == own { area } else { size * shown };
        for (k, sum) in self.areas.iter_mut().enumerate() {
            *sum += share * oblique_area(k, area);
        }
        if staged.closed(polygon.facet) {
            for (k, sum) in self.closed.iter_mut().enumerate() {
                *sum += share * oblique_area(k, area);
            }
            self.facing += share * area;
        }
        m.total += share * size;
        if staged.one_sided(polygon.facet) {
            m.mean += share * area;
        }
        m.albedo += share * size * albedo;
        if self.materials {
            m.materials.add(staged.material(polygon.facet).min(254) as u8, share * size, albedo);
        }
    }

    /// Add a share of a medium: it fills `lo..hi` of the voxel, and hides what is behind it as chance has it.
    pub fn add_medium(&mut self, share: &Share, medium: &Medium) {
        self.pieces += 1;
        let m = &mut self.measure;
        Arc::make_mut(&mut self.beams).merge(&share.beams, &mut self.parts);
        (m.lo, m.hi) = (m.lo.min(share.lo), m.hi.max(share.hi));
        self.areas.iter_mut().zip(&share.cover).for_each(|(sum, c)| *sum += c);
        m.total += share.area;
        m.soft += if medium.scattered { share.area } else { 0.0 };
        m.mean += share.facing;
        let albedo = DVec3::from(medium.albedo.map(f64::from));
        m.albedo += share.area * albedo;
        if self.materials {
            medium.materials.weights().for_each(|(id, part)| m.materials.add(id, share.area * part, albedo));
        }
    }

    #[cfg(test)]
    pub fn lines(&self, k: usize) -> u32 {
        self.parts[k]
    }

    /// The voxel's measure and lines; `None` where its facets have no area.
    pub fn finish(mut self: Box<Gather>) -> Option<(Box<Measure>, Arc<Beams>)> {
        let m = &mut self.measure;
        if m.total <= 0.0 {
            return None;
        }
        m.albedo /= m.total;
        m.materials.divide(m.total);
        (m.lo, m.hi) = (m.lo.clamp(DVec3::ZERO, DVec3::ONE), m.hi.clamp(DVec3::ZERO, DVec3::ONE));
        let lines = if self.pieces == 1 { self.parts } else { self.beams.counts() };
        for (k, &parts) in self.parts.iter().enumerate() {
            // One facet covers its area exactly; several share lines as the lattice finds it. Where they slip between its
            // lines, what is closed covers as much as faces one way, the way that more does.
            let area = if parts > 0 {
                self.areas[k] * f64::from(lines[k]) / f64::from(parts)
            } else {
                self.areas[k] - 0.5 * (self.closed[k] - oblique_area(k, self.facing))
            };
            m.cover[k] = area.min(box_area(k, m.hi - m.lo).max(0.0));
            m.averaged += m.cover[k] / box_area(k, DVec3::ONE) / 13.0;
        }
        Some((self.measure, self.beams))
    }
}
