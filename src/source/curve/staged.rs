//! Strands laid into a grid: their pieces sorted by region, and swept when a region is asked for.

use std::f64::consts::TAU;

use super::path;
use super::path::{Join, Knot};
use super::section;
use super::section::{Circles, Cut, Frame, Sweep};
use super::{CurveSource, Line, Section};
use crate::geom::polygon::Polygon;
use crate::geom::{Aabb, DAffine3, DMat3, DVec3};
use crate::progress::Progress;
use crate::source::memory_budget::MemoryBudget;
use crate::source::mesh::Fill;
use crate::source::placement::Placement;
use crate::source::traits::{FACET_MEMORY, Staged, Surface};
use crate::{Error, Result, morton, par};

/// Furthest that a path's pieces may be from it, in voxels.
const TOLERANCE: f64 = 1.0 / 16.0;
/// Radius in voxels from which a cube of a voxel may fit into a strand.
const THICK: f64 = 0.5;
/// No facet reaches further from its piece than so many radii: a mitre at a right angle, of a triangle.
const MAX_REACH: f64 = 1.75;
/// Strands, and pieces, in a chunk of parallel work.
const CHUNK: usize = 256;
const PIECES: usize = 4096;

/// Strands in a grid. A facet's number is that of the knot that its piece begins at, plus the number of knots for every
/// shift before its own.
pub struct StagedCurves<'a> {
    source: &'a CurveSource,
    knots: Vec<Knot>,
    /// Colour per knot; empty where all are white.
    colours: Vec<[f32; 4]>,
    circles: Circles,
    to_grid: DAffine3,
    to_source: DAffine3,
    /// Offsets of the copies, in voxels: more than one along cyclic axes.
    shifts: Vec<DVec3>,
    /// Largest number of voxels per source unit in any direction.
    scale: f64,
    region_side: f64,
    regions: Vec<u64>,
    /// Start of each region's pieces in `pieces`, and one past the last.
    starts: Vec<usize>,
    pieces: Vec<u32>,
    /// The same, of thick pieces alone.
    thick_starts: Vec<usize>,
    thick: Vec<u32>,
}

impl<'a> StagedCurves<'a> {
    pub fn new(source: &'a CurveSource, place: &Placement, progress: &dyn Progress) -> Result<StagedCurves<'a>> {
        let to_grid = affine(place, source.bounds);
        let scale = largest_stretch(to_grid.matrix3);
        let shifts = place.shifts(grid_box(&to_grid, source.bounds));
        let up = place.transform.matrix3.inverse() * DVec3::AXES[usize::from(place.up.min(2))];
        let up = up.try_normalize().unwrap_or(DVec3::Y);
        let chunks = source.lines.len().div_ceil(CHUNK);
        let ledger = MemoryBudget::new(place.memory);
        progress.stage("lay out", chunks as u64);
        let lists = par::map(chunks, |chunk| {
            let (mut knots, mut colours) = (Vec::new(), Vec::new());
            for n in chunk * CHUNK..source.lines.len().min((chunk + 1) * CHUNK) {
                let before = knots.len();
                lay(source, n, scale, up, &mut knots, &mut colours);
                // Twice, since lists are joined.
                if !ledger.take(knots.len() - before, 2 * (size_of::<Knot>() + size_of::<[f32; 4]>()) as u64) {
                    return (Vec::new(), Vec::new());
                }
            }
            progress.advance(1);
            (knots, colours)
        });
        ledger.check("to lay out curves")?;
        let mut knots = Vec::with_capacity(lists.iter().map(|l| l.0.len()).sum());
        let mut colours = Vec::new();
        for (k, c) in lists {
            knots.extend(k);
            colours.extend(c);
        }
        let count = knots.len() as u64 * shifts.len() as u64;
        if count > u64::from(u32::MAX) {
            return Err(Error::Limit {
                what: "the number of pieces of curves".into(),
                needed: count,
                allowed: u32::MAX.into(),
            });
        }
        let most = knots.iter().map(|k: &Knot| k.sides).max().unwrap_or(3);
        let mut staged = StagedCurves {
            source,
            knots,
            colours,
            circles: Circles::new(most + 1),
            to_grid,
            to_source: to_grid.inverse(),
            shifts,
            scale,
            region_side: f64::from(1u32 << place.region_log2()),
            regions: Vec::new(),
            starts: Vec::new(),
            pieces: Vec::new(),
            thick_starts: Vec::new(),
            thick: Vec::new(),
        };
        staged.sort_by_region(place, &ledger, progress)?;
        Ok(staged)
    }

    fn sort_by_region(&mut self, place: &Placement, ledger: &MemoryBudget, progress: &dyn Progress) -> Result<()> {
        let count = self.knots.len() * self.shifts.len();
        let chunks = count.div_ceil(PIECES);
        progress.stage("sort", chunks as u64);
        let last = f64::from((place.side() >> place.region_log2()) - 1);
        let lists = par::map(chunks, |chunk| {
            let (mut out, mut codes) = (Vec::new(), Vec::new());
            for facet in chunk * PIECES..count.min((chunk + 1) * PIECES) {
                self.regions_of(facet as u32, last, &mut codes);
                if !ledger.take(codes.len(), FACET_MEMORY) {
                    return Vec::new();
                }
                out.extend(codes.iter().map(|&code| (code, facet as u32)));
            }
            progress.advance(1);
            out
        });
        ledger.check("to sort the pieces of curves by region")?;
        let mut pairs: Vec<(u64, u32)> = lists.concat();
        pairs.sort_unstable();
        for &(region, facet) in &pairs {
            if self.regions.last() != Some(&region) {
                self.regions.push(region);
                self.starts.push(self.pieces.len());
                self.thick_starts.push(self.thick.len());
            }
            self.pieces.push(facet);
            if self.is_thick(facet) {
                self.thick.push(facet);
            }
        }
        self.starts.push(self.pieces.len());
        self.thick_starts.push(self.thick.len());
        Ok(())
    }

    /// The knot that a piece begins at, the one that it ends at (itself where it is a ball), and its shift.
    fn find(&self, facet: u32) -> (usize, usize, DVec3) {
        let (shift, knot) = (facet as usize / self.knots.len(), facet as usize % self.knots.len());
        let next = if self.knots[knot].join == Join::Alone { knot } else { (knot + 1).min(self.knots.len() - 1) };
        (knot, next, self.shifts[shift])
    }

    fn section(&self, knot: &Knot) -> Section {
        self.source.sections[knot.section as usize].0
    }

    fn is_thick(&self, facet: u32) -> bool {
        let (from, to, _) = self.find(facet);
        let widest = self.knots[from].radius.max(self.knots[to].radius);
        let opaque = self.alpha(from).min(self.alpha(to)) >= 1.0;
        opaque && section::closed(self.section(&self.knots[from])) && f64::from(widest) * self.scale > THICK
    }

    fn alpha(&self, knot: usize) -> f32 {
        self.colours.get(knot).map_or(1.0, |c| c[3])
    }

    /// Regions, up to `last` along each axis, that the piece may reach; each once.
    fn regions_of(&self, facet: u32, last: f64, codes: &mut Vec<u64>) {
        codes.clear();
        let (from, to, shift) = self.find(facet);
        let (a, b) = (&self.knots[from], &self.knots[to]);
        if a.join == Join::End {
            return;
        }
        let radius = f64::from(a.radius.max(b.radius)) * section::reach(self.section(a));
        let reach = MAX_REACH * radius * self.scale / self.region_side;
        let at = |k: &Knot| (self.to_grid.transform_point3(k.at) + shift) / self.region_side;
        let (start, end) = (at(a), at(b));
        // Parts no longer than a region is wide, so that few regions are looked at.
        let parts = (end - start).abs().max_element().ceil().clamp(1.0, 1e4);
        for n in 0..parts as usize {
            let (p, q) = (start.lerp(end, n as f64 / parts), start.lerp(end, (n + 1) as f64 / parts));
            let lo = (p.min(q) - reach).floor().max(DVec3::ZERO);
            let hi = (p.max(q) + reach).floor().min(DVec3::splat(last));
            if !lo.cmple(hi).all() {
                continue;
            }
            let (lo, hi) = (lo.as_uvec3(), hi.as_uvec3());
            for z in lo.z..=hi.z {
                for y in lo.y..=hi.y {
                    for x in lo.x..=hi.x {
                        let middle = DVec3::new(x.into(), y.into(), z.into()) + 0.5;
                        // The ball around the region against the rounded piece.
                        if distance(middle, p, q) <= reach + 0.75f64.sqrt() + 1e-9 {
                            codes.push(morton::encode([x, y, z]));
                        }
                    }
                }
            }
        }
        if parts > 1.0 {
            codes.sort_unstable();
            codes.dedup();
        }
    }

    /// Unit vector from a knot to the next.
    fn way(&self, knot: usize) -> DVec3 {
        let next = self.knots.get(knot + 1).unwrap_or(&self.knots[knot]);
        (next.at - self.knots[knot].at).normalize_or_zero()
    }

    fn frame(&self, knot: usize) -> Frame {
        Frame { way: self.way(knot), across: DVec3::from(self.knots[knot].across.map(f64::from)) }
    }

    fn sweep(&self, sweep: &mut Sweep, facet: u32, each: &mut dyn FnMut(&Polygon)) {
        let (from, to, _) = self.find(facet);
        let (a, b) = (&self.knots[from], &self.knots[to]);
        let section = self.section(a);
        if a.join == Join::Alone {
            return sweep.ball(a, facet, each);
        }
        sweep.section(section, a.sides);
        let frame = self.frame(from);
        let before = if a.join == Join::Mitre { self.frame(from - 1) } else { frame };
        sweep.ring(0, before, &Cut { at: a.at, radius: f64::from(a.radius), next: frame.way });
        let after = if b.join == Join::Mitre { self.way(to) } else { frame.way };
        sweep.ring(1, frame, &Cut { at: b.at, radius: f64::from(b.radius), next: after });
        let closed = section::closed(section);
        sweep.sides(closed, facet, each);
        let round = section == Section::Round;
        let capped = |join| closed && (matches!(join, Join::Start | Join::End) || (join == Join::Ball && !round));
        if capped(a.join) {
            sweep.cap(0, facet, each);
        }
        if capped(b.join) {
            sweep.cap(1, facet, each);
        }
        if round && a.join == Join::Ball {
            sweep.ball(a, facet, each);
        }
    }

    /// Test whether the point (source space) is inside the piece: between its ends and within its section.
    fn holds(&self, facet: u32, p: DVec3) -> bool {
        let (from, to, _) = self.find(facet);
        let (a, b) = (&self.knots[from], &self.knots[to]);
        let within_ball = || (p - a.at).length_squared() <= f64::from(a.radius).powi(2);
        let round = self.section(a) == Section::Round;
        if a.join == Join::Alone {
            return within_ball();
        }
        if round && a.join == Join::Ball && within_ball() {
            return true;
        }
        let Frame { way, across } = self.frame(from);
        let mitre = |join, other: usize| if join == Join::Mitre { way + self.way(other) } else { way };
        let start = mitre(a.join, from.saturating_sub(1));
        if (p - a.at).dot(start) < 0.0 || (p - b.at).dot(mitre(b.join, to)) > 0.0 {
            return false;
        }
        let rest = p - a.at;
        let t = rest.dot(way) / (b.at - a.at).length();
        let radius = f64::from(a.radius) + t * f64::from(b.radius - a.radius);
        let (x, y) = (rest.dot(across), rest.dot(way.cross(across)));
        match self.section(a) {
            Section::Round => x * x + y * y <= radius * radius,
            Section::Rectangular { thickness } => x.abs() <= radius && y.abs() <= f64::from(thickness) * radius,
            Section::V { .. } => false,
        }
    }
}

/// The knots of line `n`, and their colours where the source has any.
fn lay(source: &CurveSource, n: usize, scale: f64, up: DVec3, knots: &mut Vec<Knot>, colours: &mut Vec<[f32; 4]>) {
    let line: &Line = &source.lines[n];
    let section = source.sections[line.section as usize].0;
    let widest = source.radii[line.first..line.end].iter().fold(0.0f32, |a, b| a.max(*b));
    if widest <= 0.0 {
        return;
    }
    let radius = f64::from(widest) * scale;
    let mut path = path::flatten(source, line, TOLERANCE / scale);
    path::simplify(&mut path, TOLERANCE / (scale * (1.0 + radius)));
    // Multiples of the golden ratio: rolls spread evenly over strands.
    let roll = (n as f64 * 0.618_033_988_749_895).fract() * TAU;
    knots.extend(path::knots(&path, (line.section, section), section::sides(radius), line.up.unwrap_or(up), roll));
    if !source.colours.is_empty() {
        colours.extend(path.iter().map(|s| s.colour));
    }
}

/// [`Placement::to_grid`] as a matrix.
fn affine(place: &Placement, bounds: Aabb) -> DAffine3 {
    let (centre, size) =
        if bounds.is_empty() { (DVec3::ZERO, 1.0) } else { (bounds.centre(), bounds.size().max_element()) };
    let step = if size > 0.0 { size } else { centre.abs().max_element().max(1.0) };
    let origin = place.to_grid(centre);
    let column = |axis: DVec3| (place.to_grid(centre + step * axis) - origin) / step;
    let linear = DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z));
    DAffine3::from_mat3_translation(linear, origin - linear * centre)
}

/// The most that a matrix lengthens a vector, or a little more.
fn largest_stretch(m: DMat3) -> f64 {
    let [a, b, c] = [m.x_axis, m.y_axis, m.z_axis].map(DVec3::length);
    let crossed = [m.x_axis.dot(m.y_axis), m.y_axis.dot(m.z_axis), m.z_axis.dot(m.x_axis)];
    let most = a.max(b).max(c);
    if crossed.iter().all(|d| d.abs() <= 1e-9 * most * most) { most } else { (a * a + b * b + c * c).sqrt() }
}

fn grid_box(to_grid: &DAffine3, b: Aabb) -> Aabb {
    if b.is_empty() {
        return b;
    }
    let pick = |i: usize, axis: usize| if i >> axis & 1 == 0 { b.min[axis] } else { b.max[axis] };
    Aabb::around((0..8).map(|i| to_grid.transform_point3(DVec3::new(pick(i, 0), pick(i, 1), pick(i, 2)))))
}

/// From `p` to the segment from `a` to `b`.
fn distance(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let (rest, way) = (p - a, b - a);
    let t = (rest.dot(way) / way.length_squared().max(1e-300)).clamp(0.0, 1.0);
    (rest - t * way).length()
}

impl Staged for StagedCurves<'_> {
    fn regions(&self) -> &[u64] {
        &self.regions
    }

    /// In pieces: their facets are never held together.
    fn weight(&self, region: usize) -> u64 {
        (self.starts[region + 1] - self.starts[region]) as u64
    }

    fn facets(&self) -> u32 {
        (self.knots.len() * self.shifts.len()) as u32
    }

    fn emit(&self, region: usize, each: &mut dyn FnMut(&Polygon)) {
        let mut sweep: Option<(DVec3, Sweep)> = None;
        for &facet in &self.pieces[self.starts[region]..self.starts[region + 1]] {
            let shift = self.find(facet).2;
            let same = sweep.take().filter(|(s, _)| *s == shift).map(|(_, sweep)| sweep);
            let mut now = same.unwrap_or_else(|| {
                let mut to_grid = self.to_grid;
                to_grid.translation += shift;
                Sweep::new(&self.circles, to_grid)
            });
            self.sweep(&mut now, facet, each);
            sweep = Some((shift, now));
        }
    }

    fn material(&self, facet: u32) -> u16 {
        let (from, ..) = self.find(facet);
        self.source.sections[self.knots[from].section as usize].1
    }

    fn surface(&self, facet: u32, at: DVec3, _: f64) -> Surface {
        if self.colours.is_empty() {
            return Surface { albedo: [1.0; 3], alpha: 1.0 };
        }
        let (from, to, shift) = self.find(facet);
        let (a, b) = (&self.knots[from], &self.knots[to]);
        let way = b.at - a.at;
        let p = self.to_source.transform_point3(at - shift) - a.at;
        let t = p.dot(way) / way.length_squared().max(1e-300);
        let t = t.clamp(0.0, 1.0) as f32;
        let (a, b) = (self.colours[from], self.colours[to]);
        let [r, g, b, alpha] = std::array::from_fn(|e| a[e] + t * (b[e] - a[e]));
        Surface { albedo: [r, g, b], alpha }
    }

    fn has_alpha(&self, facet: u32) -> bool {
        let (from, to, _) = self.find(facet);
        self.alpha(from).min(self.alpha(to)) < 1.0
    }

    fn one_sided(&self, facet: u32) -> bool {
        self.is_thick(facet)
    }

    fn closed(&self, facet: u32) -> bool {
        section::closed(self.section(&self.knots[self.find(facet).0]))
    }

    fn inside(&self, at: DVec3) -> bool {
        if self.source.options.fill == Fill::Surface || self.thick.is_empty() || at.min_element() < 0.0 {
            return false;
        }
        let cell = (at / self.region_side).as_uvec3();
        let Ok(region) = self.regions.binary_search(&morton::encode(cell.to_array())) else { return false };
        let thick = &self.thick[self.thick_starts[region]..self.thick_starts[region + 1]];
        thick.iter().any(|&f| self.holds(f, self.to_source.transform_point3(at - self.find(f).2)))
    }
}
