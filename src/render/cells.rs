//! Copies of a texel in the cells of a layer: each integer cell of texel coordinates (u, v, w) holds one, which a hash varies. A ray
//! walks from cell to cell and reports the copies that it hits.
//!
//! Based on: F. Neyret, *Synthesizing Verdant Landscapes using Volumetric Textures*, RR-2846, 1996 (jittered copies);
//! J. Amanatides, A. Woo, *A Fast Voxel Traversal Algorithm for Ray Tracing*, 1987.

use super::jitter::height_stretch;
pub use super::layer::{TexelChoice, TexelLayer, texel_frames};
use super::placement::PlacedCopy;
use super::shell::{HeightInShell, MAX_CELLS, ShellSegment};
use crate::geom::{Aabb, DMat3, DVec3, Ray, Vec3};
use crate::scene::shell::CellWrap;

/// A copy of a texel that a ray hits, and the straight segment of the ray in the copy's cell.
#[derive(Debug, Clone, Copy)]
pub struct CopyHit {
    pub texel: usize,
    /// Multiplies the texel's albedo.
    pub tint: Vec3,
    /// Number of its Phong parameters, see [`super::layer::TexelChoice::phong`].
    pub phong: u32,
    /// Identity of the copy: the cell that holds it or, for a rigid copy, its number and [`RIGID`].
    pub cell: [i64; 3],
    /// Parameters at which the ray enters and leaves the cell.
    pub t0: f64,
    pub t1: f64,
    /// The ray in texel space, the cube [0,1]^3: its position at t0, and its change per unit of t.
    pub origin: DVec3,
    pub dir: DVec3,
    /// Cell space → texel space: a signed permutation over the copy's scale.
    pub linear: DMat3,
    /// 1 / the copy's scale: the factor by which `linear` multiplies lengths.
    pub inverse_scale: f64,
}

/// Margin around a texel's content within which a ray may hit it, in cube edges: more than the margin by which a march widens the content
/// against rounding.
pub const CONTENT_PAD: f64 = 1e-5;

/// The third coordinate of the cells that stand for rigid copies: no shell has a cell there.
pub const RIGID: i64 = i64::MIN;

impl CopyHit {
    /// The ray in texel space, from t0 on.
    pub fn ray(&self) -> Ray {
        Ray { origin: self.origin, dir: self.dir }
    }

    /// Whether the copy is a rigid one, which is in no cell.
    pub fn is_rigid(&self) -> bool {
        self.cell[2] == RIGID
    }

    /// Whether the segment certainly misses `content`, a box in texel space; a near miss may count as a hit.
    pub fn misses(&self, content: &Aabb) -> bool {
        let inverse = self.dir.recip();
        let (a, b) =
            ((content.min - CONTENT_PAD - self.origin) * inverse, (content.max + CONTENT_PAD - self.origin) * inverse);
        a.min(b).max_element().max(0.0) > a.max(b).min_element().min(self.t1 - self.t0)
    }
}

/// Interval of [0, end] in which the ray is inside the unit cube; `None` where it has no length.
fn span_in_unit_cube(ray: &Ray, end: f64) -> Option<(f64, f64)> {
    let Ray { origin, dir } = *ray;
    let (mut near, mut far) = (0.0_f64, end);
    for k in 0..3 {
        if dir[k] == 0.0 {
            if !(0.0..1.0).contains(&origin[k]) {
                return None;
            }
            continue;
        }
        let (a, b) = (-origin[k] / dir[k], (1.0 - origin[k]) / dir[k]);
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    (near < far).then_some((near, far))
}

impl TexelLayer {
    /// Bring a shell's segment into the layer's own texel coordinates and call `each` for it, or, where continuous jitter bends it, for
    /// its chords in order, until `each` returns false. `tolerance(t, to_texel)` is how far a chord may deviate, in cells. Returns
    /// false if stopped.
    pub fn for_each_chord(
        &self,
        segment: &ShellSegment,
        tolerance: &dyn Fn(f64, &DMat3) -> f64,
        each: &mut dyn FnMut(&ShellSegment) -> bool,
    ) -> bool {
        let (scale, offset) = (DVec3::from_array(self.layer.scale), DVec3::from_array(self.layer.offset));
        let end_heights = segment.end_heights.map(|foot| HeightInShell { rise: foot.rise * scale.z, ..foot });
        let (q0, q1) = (segment.q0 * scale + offset, segment.q1 * scale + offset);
        let to_texel = DMat3::from_diagonal(scale) * segment.to_texel;
        let placed = ShellSegment { q0, q1, to_texel, end_heights, ..*segment };
        // A segment through so many cells is seen from so far away that the noise does not show.
        let many = (q1 - q0).abs().max_element() > f64::from(MAX_CELLS);
        match &self.jitter {
            Some(jitter) if !many => {
                // The noise is costly, and a shell may be many times as high as this layer.
                let placed = match self.layer.wrap[2] {
                    CellWrap::Empty => jitter.within_reach(&placed, self.height_range()).map(|span| placed.part(span)),
                    _ => Some(placed),
                };
                let stretch = height_stretch(self.layer.continuous.as_ref());
                placed.is_none_or(|placed| jitter.for_each_chord(&placed, stretch, tolerance, each))
            }
            _ => each(&placed),
        }
    }

    /// The w coordinates between which there may be matter, where w is empty beyond [0, 1].
    fn height_range(&self) -> [f64; 2] {
        if self.layer.discrete.is_some() {
            return [0.0, 1.0];
        }
        let ends = |low: f64, high: f64, c: &Aabb| (low.min(c.min.z), high.max(c.max.z));
        let (low, high) = self.choices.iter().fold((1.0, 0.0), |(low, high), c| ends(low, high, &c.content));
        [(low - CONTENT_PAD).max(0.0), (high + CONTENT_PAD).min(1.0)]
    }

    /// Call `each` for the copies that a segment (in the layer's texel coordinates) hits, in order of where it enters them, until
    /// `each` returns false. Returns false if stopped. Copies overlap where displacement moves them beyond their own cells.
    pub fn for_each_copy(&self, segment: &ShellSegment, each: &mut dyn FnMut(&CopyHit) -> bool) -> bool {
        let dir = (segment.q1 - segment.q0) / (segment.t1 - segment.t0);
        let span = if dir.is_finite() { self.span_in_cells(segment, dir) } else { None };
        let Some((t0, t1)) = span else { return true };
        let walk = CellWalk::new(self, segment, dir, t0);
        if self.reach == [0; 3] { walk.for_each_own(t0, t1, each) } else { walk.for_each_in_reach(t0, t1, each) }
    }

    /// Interval of the segment in which there are cells: along axes that do not repeat there is one alone.
    fn span_in_cells(&self, segment: &ShellSegment, dir: DVec3) -> Option<(f64, f64)> {
        let (mut t0, mut t1) = (segment.t0, segment.t1);
        for k in (0..3).filter(|&k| self.layer.wrap[k] == CellWrap::Empty) {
            let (q, d) = (segment.q0[k], dir[k]);
            if d == 0.0 {
                if !(0.0..1.0).contains(&q) {
                    return None;
                }
                continue;
            }
            let (a, b) = (segment.t0 - q / d, segment.t0 + (1.0 - q) / d);
            t0 = t0.max(a.min(b));
            t1 = t1.min(a.max(b));
        }
        (t0 < t1).then_some((t0, t1))
    }

    /// Lowest and highest of the cells whose copies may reach into `cell`.
    fn cells_in_reach(&self, cell: [i64; 3]) -> [[i64; 3]; 2] {
        let at = |side: i64| std::array::from_fn(|k| cell[k].saturating_add(side * self.reach[k]));
        [at(-1), at(1)]
    }

    /// The hit of the copy in `cell` by a ray (in the layer's texel coordinates) that begins at t0 and leaves the cell at t1; `None`
    /// where the cell is empty.
    fn hit(&self, cell: [i64; 3], ray: &Ray, [t0, t1]: [f64; 2]) -> Option<CopyHit> {
        let (copy, sign, middle) = (self.place(cell)?, self.mirror_signs(cell), cell_corner(cell) + 0.5);
        // A start on a face may lie outside by rounding.
        let p = ((ray.origin - middle).clamp(DVec3::splat(-0.5), DVec3::splat(0.5))) * sign + 0.5;
        let linear = copy.linear * DMat3::from_diagonal(sign);
        let origin = copy.linear * p + copy.offset;
        let PlacedCopy { texel, tint, phong, inverse_scale, .. } = copy;
        Some(CopyHit { texel, tint, phong, cell, t0, t1, origin, dir: linear * ray.dir, linear, inverse_scale })
    }

    /// The copy in `cell`, and the map of the layer's texel coordinates into its cube; `None` where the cell is empty.
    pub fn placed(&self, cell: [i64; 3]) -> Option<(PlacedCopy, crate::geom::DAffine3)> {
        let (copy, sign) = (self.place(cell)?, self.mirror_signs(cell));
        let matrix3 = copy.linear * DMat3::from_diagonal(sign);
        let translation = copy.linear * (0.5 - sign * (cell_corner(cell) + 0.5)) + copy.offset;
        Some((copy, crate::geom::DAffine3 { matrix3, translation }))
    }

    /// −1 along the axes along which the cell is mirrored, else 1.
    fn mirror_signs(&self, cell: [i64; 3]) -> DVec3 {
        let odd = |k: usize| self.layer.wrap[k] == CellWrap::Mirror && cell[k] & 1 != 0;
        DVec3::from_array([0, 1, 2].map(|k| if odd(k) { -1.0 } else { 1.0 }))
    }

    /// The hit of the copy that belongs to `cell` but may reach beyond it: the part of [t0, t1] in which the ray is in the copy's
    /// cube.
    fn overlapping_hit(&self, cell: [i64; 3], ray: &Ray, [t0, t1]: [f64; 2]) -> Option<CopyHit> {
        let (copy, sign) = (self.place(cell)?, self.mirror_signs(cell));
        let linear = copy.linear * DMat3::from_diagonal(sign);
        let p = (ray.origin - cell_corner(cell) - 0.5) * sign + 0.5;
        let (origin, dir) = (copy.linear * p + copy.offset, linear * ray.dir);
        let (near, far) = span_in_unit_cube(&Ray { origin, dir }, t1 - t0)?;
        let origin = (origin + near * dir).clamp(DVec3::ZERO, DVec3::ONE);
        let PlacedCopy { texel, tint, phong, inverse_scale, .. } = copy;
        Some(CopyHit { texel, tint, phong, cell, t0: t0 + near, t1: t0 + far, origin, dir, linear, inverse_scale })
    }
}

/// A walk along a segment from cell to cell.
struct CellWalk<'a> {
    layer: &'a TexelLayer,
    segment: &'a ShellSegment,
    /// Change of the texel coordinates per unit of t.
    dir: DVec3,
    cell: [i64; 3],
    /// Parameters at which the segment leaves the cell along each axis.
    leave: [f64; 3],
}

impl<'a> CellWalk<'a> {
    /// In the cell in which the segment is at `t`.
    fn new(layer: &'a TexelLayer, segment: &'a ShellSegment, dir: DVec3, t: f64) -> CellWalk<'a> {
        let mut walk = CellWalk { layer, segment, dir, cell: [0; 3], leave: [0.0; 3] };
        let start = walk.ray_from(t).origin;
        for k in (0..3).filter(|&k| layer.layer.wrap[k] != CellWrap::Empty) {
            // A start on a boundary belongs to the cell that the ray goes into.
            walk.cell[k] = if dir[k] < 0.0 { start[k].ceil() as i64 - 1 } else { start[k].floor() as i64 };
        }
        walk.leave = [0, 1, 2].map(|k| walk.leave_along(k));
        walk
    }

    /// The segment from `t` on.
    fn ray_from(&self, t: f64) -> Ray {
        Ray { origin: self.segment.q0 + (t - self.segment.t0) * self.dir, dir: self.dir }
    }

    fn leave_along(&self, k: usize) -> f64 {
        if self.dir[k] == 0.0 || self.layer.layer.wrap[k] == CellWrap::Empty {
            return f64::INFINITY;
        }
        let edge = self.cell[k] as f64 + if self.dir[k] > 0.0 { 1.0 } else { 0.0 };
        self.segment.t0 + (edge - self.segment.q0[k]) / self.dir[k]
    }

    /// The axis along which the cell is left first, and the parameter there.
    fn exit(&self) -> (usize, f64) {
        let axis = (0..3).fold(0, |best, k| if self.leave[k] < self.leave[best] { k } else { best });
        (axis, self.leave[axis])
    }

    /// Go on into the next cell along `axis`.
    fn step(&mut self, axis: usize) {
        let step = if self.dir[axis] > 0.0 { 1 } else { -1 };
        self.cell[axis] = self.cell[axis].saturating_add(step);
        self.leave[axis] = self.leave_along(axis);
    }

    /// Call `each` for the hits between t0 and t1 of copies that stay in their cells. Returns false if stopped.
    fn for_each_own(mut self, mut t0: f64, t1: f64, each: &mut dyn FnMut(&CopyHit) -> bool) -> bool {
        for _ in 0..MAX_CELLS {
            let (axis, exit) = self.exit();
            let end = exit.min(t1);
            if end > t0 {
                if let Some(hit) = self.layer.hit(self.cell, &self.ray_from(t0), [t0, end])
                    && !each(&hit)
                {
                    return false;
                }
                t0 = end;
            }
            if end >= t1 {
                break;
            }
            self.step(axis);
        }
        true
    }

    /// The same for copies that reach into other cells.
    fn for_each_in_reach(mut self, t0: f64, t1: f64, each: &mut dyn FnMut(&CopyHit) -> bool) -> bool {
        let ray = self.ray_from(t0);
        let mut queue = HitQueue { hits: Vec::new() };
        let layer = self.layer;
        let add = |queue: &mut HitQueue, low: [i64; 3], high: [i64; 3]| {
            for u in low[0]..=high[0] {
                for v in low[1]..=high[1] {
                    for w in low[2]..=high[2] {
                        queue.push(layer.overlapping_hit([u, v, w], &ray, [t0, t1]));
                    }
                }
            }
        };
        let [low, high] = self.layer.cells_in_reach(self.cell);
        add(&mut queue, low, high);
        for _ in 0..MAX_CELLS {
            let (axis, exit) = self.exit();
            let end = exit.min(t1);
            // Copies of cells that come within reach later begin later.
            if !queue.emit_until(end, each) {
                return false;
            }
            if end >= t1 {
                return true;
            }
            self.step(axis);
            // The slab of cells that has newly come within reach.
            let [mut low, mut high] = self.layer.cells_in_reach(self.cell);
            let edge = if ray.dir[axis] > 0.0 { high[axis] } else { low[axis] };
            (low[axis], high[axis]) = (edge, edge);
            add(&mut queue, low, high);
        }
        queue.emit_until(t1, each)
    }
}

fn cell_corner(cell: [i64; 3]) -> DVec3 {
    DVec3::from_array(cell.map(|c| c as f64))
}

/// Hits of overlapping copies that have not been reported yet, the last one first.
struct HitQueue {
    hits: Vec<CopyHit>,
}

impl HitQueue {
    fn push(&mut self, hit: Option<CopyHit>) {
        if let Some(hit) = hit {
            let at = self.hits.partition_point(|h| h.t0 > hit.t0);
            self.hits.insert(at, hit);
        }
    }

    /// Call `each` for the hits that begin up to `t`, in order, until it returns false. Returns false if stopped.
    fn emit_until(&mut self, t: f64, each: &mut dyn FnMut(&CopyHit) -> bool) -> bool {
        while self.hits.last().is_some_and(|h| h.t0 <= t) {
            if self.hits.pop().is_some_and(|h| !each(&h)) {
                return false;
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shell::{Discrete, Layer, Orientations};

    fn layer(wrap: [CellWrap; 3], discrete: Option<Discrete>) -> TexelLayer {
        let layer = Layer { wrap, discrete, ..Layer::default() };
        let content = Aabb::new(DVec3::new(0.3, 0.2, 0.0), DVec3::new(0.6, 0.9, 0.8));
        TexelLayer::new(layer, vec![TexelChoice::plain(content)])
    }

    fn segment(q0: DVec3, q1: DVec3) -> ShellSegment {
        ShellSegment { t0: 2.0, t1: 5.0, q0, q1, to_texel: DMat3::IDENTITY, end_heights: Default::default() }
    }

    const REPEAT: [CellWrap; 3] = [CellWrap::Repeat, CellWrap::Repeat, CellWrap::Empty];

    /// Copies abut exactly, cover the part inside w in [0, 1], and stay in the cube.
    #[test]
    fn cells_partition_a_segment() {
        let cases = [
            (DVec3::new(-2.3, 0.4, -0.5), DVec3::new(3.1, 2.2, 1.5)),
            (DVec3::new(3.0, 2.0, 0.5), DVec3::new(-3.0, -2.0, 0.5)),
            (DVec3::new(0.0, 0.0, 0.0), DVec3::new(4.0, 4.0, 1.0)),
            (DVec3::new(1.0, 0.5, 1.0), DVec3::new(1.0, 0.5, 0.0)),
        ];
        for (q0, q1) in cases {
            for wrap in [CellWrap::Repeat, CellWrap::Mirror] {
                let (mut total, mut last) = (0.0, None);
                let walked = layer([wrap, wrap, CellWrap::Empty], None).for_each_copy(&segment(q0, q1), &mut |v| {
                    assert!(last.is_none_or(|t| t == v.t0));
                    last = Some(v.t1);
                    total += v.t1 - v.t0;
                    for p in [v.origin, v.origin + (v.t1 - v.t0) * v.dir] {
                        assert!(
                            (-1e-12..1.0 + 1e-12).contains(&p.min_element()) && p.max_element() < 1.0 + 1e-12,
                            "{p}"
                        );
                    }
                    true
                });
                assert!(walked);
                let inside = if q0.z < 0.0 { 1.5 } else { 3.0 };
                assert!((total - inside).abs() < 1e-12, "{total}");
            }
        }
    }

    /// Where the ray of a hit is in the content, if it is there.
    fn in_content(hit: &CopyHit, content: &Aabb) -> Option<[f64; 2]> {
        let inverse = hit.dir.recip();
        let (a, b) = ((content.min - hit.origin) * inverse, (content.max - hit.origin) * inverse);
        let near = hit.t0 + a.min(b).max_element().max(0.0);
        let far = (hit.t0 + a.max(b).min_element()).min(hit.t1);
        (far - near > 1e-9).then_some([near, far])
    }

    /// Every copy is met once, whole, wherever it reaches over its cell, and in order.
    #[test]
    fn copies_that_reach_over_their_cells_are_whole() {
        for (displace, mirror, wrap) in [
            ([0.9, 0.4, 0.3], CellWrap::Repeat, CellWrap::Empty),
            ([0.3, 1.7, 0.0], CellWrap::Mirror, CellWrap::Empty),
            ([0.6, 0.6, 0.6], CellWrap::Repeat, CellWrap::Repeat),
        ] {
            let orientations = Orientations::W8;
            let discrete =
                Discrete { seed: 5, orientations, scale: [0.5, 1.0], displace, presence: 0.7, ..Discrete::default() };
            let layer = layer([mirror, mirror, wrap], Some(discrete));
            assert!(layer.reach[0] >= 1 && layer.reach[1] >= 1 && (layer.reach[2] == 1) == (wrap == CellWrap::Repeat));
            let content = layer.choices[0].content;
            for i in 0..40 {
                let at =
                    |k: f64| DVec3::new((k * 0.37).sin() * 4.0, (k * 0.71).cos() * 4.0, (k * 0.53).sin() * 0.5 + 0.5);
                let segment = segment(at(f64::from(i)), at(f64::from(i) + 17.3));
                let (mut found, mut last) = (Vec::new(), f64::NEG_INFINITY);
                layer.for_each_copy(&segment, &mut |hit| {
                    if let Some(span) = in_content(hit, &content) {
                        // Of the contents, that is; cubes around them may begin earlier.
                        assert!(span[1] > last || hit.t0 >= last, "{i}");
                        last = hit.t0;
                        found.push((hit.cell, span));
                    }
                    true
                });
                let dir = (segment.q1 - segment.q0) / 3.0;
                let mut all = Vec::new();
                let levels = if wrap == CellWrap::Empty { 0..=0 } else { -3..=3 };
                for cell in (-8..=8).flat_map(|u| (-8..=8).map(move |v| (u, v))) {
                    for w in levels.clone() {
                        let cell = [cell.0, cell.1, w];
                        let hit = layer.overlapping_hit(cell, &Ray { origin: segment.q0, dir }, [2.0, 5.0]);
                        all.extend(hit.and_then(|h| in_content(&h, &content)).map(|span| (cell, span)));
                    }
                }
                found.sort_by_key(|f| f.0);
                assert_eq!(found.iter().map(|f| f.0).collect::<Vec<_>>(), all.iter().map(|f| f.0).collect::<Vec<_>>());
                for (a, b) in found.iter().zip(&all) {
                    // The part beyond the layer of an empty axis is not walked through.
                    assert!((a.1[0] - b.1[0]).abs() < 1e-9 && (a.1[1] - b.1[1]).abs() < 1e-9, "{i} {a:?} {b:?}");
                }
            }
        }
    }

    #[test]
    fn endless_rows_are_left_after_a_bound() {
        let mut n = 0u32;
        layer(REPEAT, None).for_each_copy(&segment(DVec3::new(0.0, 0.5, 0.5), DVec3::new(1e12, 0.5, 0.5)), &mut |_| {
            n += 1;
            true
        });
        assert_eq!(n, MAX_CELLS);
    }
}
