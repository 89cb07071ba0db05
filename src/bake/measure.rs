//! What is known of one voxel before anything is fitted: exact areas and support, measured coverage, colour of what is seen.
//!
//! Based on: C. Loop et al. / E. Heitz et al., *The SGGX Microflake Distribution*, 2015 (projected areas filter linearly);
//! G. Loubet, F. Neyret, *Hybrid Mesh-Volume LoDs*, EG 2017 (colour weighted by visibility).

use super::beams::{Beams, PROJECTIONS, Union, axis_length, box_area, oblique_area};
use super::clip::Polygon;
use super::medium::Share;
use super::source::Staged;
use crate::geom::DVec3;

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
    /// Sum of the area vectors of one-sided facets.
    pub mean: DVec3,
    /// Mean linear colour of what is seen.
    pub albedo: DVec3,
    /// Opaque throughout.
    pub solid: bool,
    /// Share of the voxel covered, averaged over directions and then over the children, level by level: the opacity of
    /// Neyret's own model.
    pub averaged: f64,
}

/// Samples of a cut-out facet along a voxel's edge.
const CUT_CELLS: usize = 8;

/// A sampling of a cut-out facet: which cells of a small grid over its dominant plane are there.
struct CutOut {
    a: usize,
    b: usize,
    min: [f64; 2],
    step: [f64; 2],
    cells: [u16; CUT_CELLS],
    size: [usize; 2],
    plane: (DVec3, f64),
    share: f64,
    albedo: DVec3,
    lo: DVec3,
    hi: DVec3,
}

impl CutOut {
    /// `polygon` is in voxel edges, `origin` its voxel in the grid. `None`: nothing of it is there.
    fn new(staged: &dyn Staged, polygon: &Polygon, origin: DVec3, normal: DVec3) -> Option<CutOut> {
        let n = normal.abs();
        let drop = if n.x >= n.y && n.x >= n.z {
            0
        } else if n.y >= n.z {
            1
        } else {
            2
        };
        let (a, b) = ((drop + 1) % 3, (drop + 2) % 3);
        let corners = polygon.corners();
        let (lo, hi) = polygon.bounds();
        let cells = |e: f64| ((e * CUT_CELLS as f64).ceil() as usize).clamp(2, CUT_CELLS);
        let size = [cells(hi[a] - lo[a]), cells(hi[b] - lo[b])];
        let step = [(hi[a] - lo[a]) / size[0] as f64, (hi[b] - lo[b]) / size[1] as f64];
        let plane = (normal, normal.dot(corners[0]));
        let mut cut = CutOut {
            a,
            b,
            min: [lo[a], lo[b]],
            step,
            cells: [0; CUT_CELLS],
            size,
            plane,
            share: 0.0,
            albedo: DVec3::ZERO,
            lo: DVec3::INFINITY,
            hi: DVec3::NEG_INFINITY,
        };
        let (mut inside, mut there) = (0u32, 0u32);
        let seed = hash(polygon.facet);
        for j in 0..size[1] {
            for i in 0..size[0] {
                let x = cut.min[0] + (i as f64 + 0.5) * step[0];
                let y = cut.min[1] + (j as f64 + 0.5) * step[1];
                let inner = holds(corners, a, b, x, y);
                let mut p = DVec3::ZERO;
                p[a] = x;
                p[b] = y;
                p[drop] = (plane.1 - normal[a] * x - normal[b] * y) / normal[drop];
                let s = staged.surface(polygon.facet, origin + p, 0.0);
                // Additive recurrence of the plastic number: an even dither for partial alpha.
                let threshold = (seed + 0.754_877_666 * i as f64 + 0.569_840_291 * j as f64).fract();
                let opaque = f64::from(s.alpha) > threshold;
                cut.cells[j] |= u16::from(opaque) << i;
                inside += u32::from(inner);
                if inner && opaque {
                    there += 1;
                    cut.albedo += DVec3::from(s.albedo.map(f64::from));
                    let half = 0.5 * DVec3::new(step[0], step[1], 0.0);
                    let mut pad = DVec3::ZERO;
                    pad[a] = half.x;
                    pad[b] = half.y;
                    pad[drop] = (normal[a].abs() * half.x + normal[b].abs() * half.y) / n[drop];
                    cut.lo = cut.lo.min(p - pad);
                    cut.hi = cut.hi.max(p + pad);
                }
            }
        }
        if there == 0 {
            return None;
        }
        cut.share = f64::from(there) / f64::from(inside);
        cut.albedo /= f64::from(there);
        (cut.lo, cut.hi) = (cut.lo.max(lo), cut.hi.min(hi));
        Some(cut)
    }

    /// Whether the line of axis `k` at plane point (x, y) meets what is there.
    fn blocks(&self, k: usize, x: f64, y: f64) -> bool {
        let p = &PROJECTIONS[k];
        let (start, end) = (p.lift(x, y, 0.0), p.lift(x, y, 1.0));
        let (n, c) = self.plane;
        let slope = n.dot(end - start);
        if slope == 0.0 {
            return false;
        }
        let at = start + (c - n.dot(start)) / slope * (end - start);
        let cell = |v: f64, i: usize| (((v - self.min[i]) / self.step[i]).max(0.0) as usize).min(self.size[i] - 1);
        self.cells[cell(at[self.b], 1)] >> cell(at[self.a], 0) & 1 != 0
    }
}

/// A fixed number in [0, 1) for every facet.
fn hash(facet: u32) -> f64 {
    let mut h = facet.wrapping_mul(0x9e37_79b9);
    h = (h ^ h >> 16).wrapping_mul(0x85eb_ca6b);
    h = (h ^ h >> 13).wrapping_mul(0xc2b2_ae35);
    f64::from(h ^ h >> 16) / 4_294_967_296.0
}

/// Whether the convex polygon holds the point (x, y) of its projection on the axes a, b.
fn holds(corners: &[DVec3], a: usize, b: usize, x: f64, y: f64) -> bool {
    let (mut left, mut right) = (false, false);
    for (i, p) in corners.iter().enumerate() {
        let q = corners[(i + 1) % corners.len()];
        let side = (q[a] - p[a]) * (y - p[b]) - (q[b] - p[b]) * (x - p[a]);
        left |= side > 0.0;
        right |= side < 0.0;
    }
    !(left && right)
}

impl Measure {
    fn empty() -> Measure {
        Measure {
            lo: DVec3::INFINITY,
            hi: DVec3::NEG_INFINITY,
            cover: [0.0; 13],
            total: 0.0,
            mean: DVec3::ZERO,
            albedo: DVec3::ZERO,
            solid: false,
            averaged: 0.0,
        }
    }

    /// Of a voxel that is opaque throughout.
    pub fn full() -> Measure {
        let side = std::array::from_fn(|k| box_area(k, DVec3::ONE));
        Measure { lo: DVec3::ZERO, hi: DVec3::ONE, cover: side, solid: true, averaged: 1.0, ..Measure::empty() }
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
            m.mean += 0.25 * child.mean;
            if child.total > 0.0 {
                // What is hidden on all 26 ways still has a colour.
                let seen = seen.max(1e-9);
                m.albedo += seen * child.albedo;
                weight += seen;
            }
        }
        if weight > 0.0 {
            m.albedo /= weight;
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
    measure: Measure,
    beams: Beams,
    /// Lines of each facet, before they are united; and oblique areas, an axis.
    parts: [u32; 13],
    areas: [f64; 13],
}

impl Gather {
    pub fn new() -> Gather {
        Gather { measure: Measure::empty(), beams: Beams::default(), parts: [0; 13], areas: [0.0; 13] }
    }

    /// Add a facet (grid space, already cut to the voxel at `origin`).
    pub fn add(&mut self, staged: &dyn Staged, polygon: &Polygon, origin: DVec3) {
        let m = &mut self.measure;
        let p = polygon.relative_to(origin);
        let area = p.area_vector();
        let size = area.length();
        if size.is_nan() || size < 1e-14 {
            return;
        }
        let mut share = 1.0;
        let albedo;
        let (mut lo, mut hi) = p.bounds();
        if staged.cut_out(p.facet) {
            let Some(cut) = CutOut::new(staged, &p, origin, area / size) else { return };
            self.beams.add(&p, &mut self.parts, Some(&mut |k, x, y| cut.blocks(k, x, y)));
            (share, albedo, lo, hi) = (cut.share, cut.albedo, cut.lo, cut.hi);
        } else {
            self.beams.add(&p, &mut self.parts, None);
            let s = staged.surface(p.facet, polygon.middle(), size.sqrt());
            albedo = DVec3::from(s.albedo.map(f64::from));
        }
        (m.lo, m.hi) = (m.lo.min(lo), m.hi.max(hi));
        for (k, sum) in self.areas.iter_mut().enumerate() {
            *sum += share * oblique_area(k, area);
        }
        m.total += share * size;
        if staged.one_sided(p.facet) {
            m.mean += share * area;
        }
        m.albedo += share * size * albedo;
    }

    /// Add a share of a medium: it fills `lo..hi` of the voxel, and hides what is behind it as chance has it.
    pub fn add_medium(&mut self, share: &Share, albedo: [f32; 3]) {
        let m = &mut self.measure;
        self.beams.merge(&share.beams, &mut self.parts);
        (m.lo, m.hi) = (m.lo.min(share.lo), m.hi.max(share.hi));
        self.areas.iter_mut().zip(&share.cover).for_each(|(sum, c)| *sum += c);
        m.total += share.area;
        m.mean += share.facing;
        m.albedo += share.area * DVec3::from(albedo.map(f64::from));
    }

    /// The voxel's measure and lines; `None` where its facets have no area.
    pub fn finish(self) -> Option<(Measure, Beams)> {
        let Gather { measure: mut m, beams, parts, areas } = self;
        if m.total <= 0.0 {
            return None;
        }
        m.albedo /= m.total;
        (m.lo, m.hi) = (m.lo.clamp(DVec3::ZERO, DVec3::ONE), m.hi.clamp(DVec3::ZERO, DVec3::ONE));
        for (k, &parts) in parts.iter().enumerate() {
            // One facet covers its area exactly; several share lines as the lattice finds it.
            let ratio = if parts > 0 { f64::from(beams.count(k)) / f64::from(parts) } else { 1.0 };
            m.cover[k] = (areas[k] * ratio).min(box_area(k, m.hi - m.lo).max(0.0));
            m.averaged += m.cover[k] / box_area(k, DVec3::ONE) / 13.0;
        }
        Some((m, beams))
    }
}
