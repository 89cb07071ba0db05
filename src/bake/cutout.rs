//! Facets that alpha cuts: which of their pieces are there, and of those that are in part, where.
//!
//! Based on: T. Porter, T. Duff, *Compositing Digital Images*, SIGGRAPH 1984 (alpha as the share that is covered); the
//! additive recurrence of M. Roberts, *The Unreasonable Effectiveness of Quasirandom Sequences*, 2018 (dither).

use crate::geom::DVec3;
use crate::geom::polygon::Polygon;
use crate::geom::projection::LINES;
use crate::source::Presence;
use crate::source::{Cut, Staged};

/// Most samples along an edge. Half as many as there are lines: finer alpha is averaged and dithered, and as many samples as
/// lines told no more of opacity.
const CELLS: usize = LINES / 2;
/// Fewest samples along an edge, and those a detail of alpha.
const FEWEST: usize = 4;
const SAMPLES: f64 = 2.0;
/// Cells whose colour is looked up.
const COLOURS: usize = 4;

/// Give what is there of `facet` within `lo..hi` by unit voxel: the piece, its voxel's lower corner, and its alpha where it
/// is there in part.
pub fn pieces(
    staged: &dyn Staged,
    facet: &Polygon,
    lo: DVec3,
    hi: DVec3,
    each: &mut impl FnMut(&Polygon, DVec3, Option<&dyn Cut>),
) {
    let mut room = None;
    let Some(piece) = facet.clip(lo, hi, &mut room) else { return };
    if !staged.cut_out(piece.facet) {
        return piece.split_voxels(&mut |piece, at| each(piece, at, None));
    }
    let cut = staged.cut(piece.facet);
    match &cut {
        Some(cut) => split_cut(&**cut, piece, each),
        None => {
            let sampled = Sampled { staged, facet: piece.facet };
            piece.split_voxels(&mut |piece, at| each(piece, at, Some(&sampled)));
        }
    }
}

/// [`Polygon::split_voxels`] of what may be there.
fn split_cut(cut: &dyn Cut, piece: &Polygon, each: &mut impl FnMut(&Polygon, DVec3, Option<&dyn Cut>)) {
    match cut.presence(piece) {
        Presence::Nothing => {}
        Presence::Whole => piece.split_voxels(&mut |piece, at| each(piece, at, None)),
        Presence::Part => match piece.middle_plane() {
            Err(at) => each(piece, at, Some(cut)),
            Ok((axis, plane)) => {
                piece.split(axis, plane).iter().for_each(|piece| split_cut(cut, piece, each));
            }
        },
    }
}

/// A facet whose source has no quick answers.
struct Sampled<'a> {
    staged: &'a dyn Staged,
    facet: u32,
}

impl Cut for Sampled<'_> {
    fn presence(&self, _: &Polygon) -> Presence {
        Presence::Part
    }

    fn detail(&self) -> f64 {
        CELLS as f64
    }

    fn row(&self, from: DVec3, step: DVec3, _: f64, alpha: &mut [f32]) {
        for (i, alpha) in alpha.iter_mut().enumerate() {
            *alpha = self.staged.surface(self.facet, from + i as f64 * step, 0.0).alpha;
        }
    }
}

/// What alpha leaves of a piece: which cells of a small grid over the box of its projection along its normal's longest axis
/// are there.
pub struct CutOut {
    /// Axes of the grid.
    axes: [usize; 2],
    min: [f64; 2],
    /// Cells a voxel edge.
    scale: [f64; 2],
    /// Row by row, `CELLS` bits each.
    cells: u64,
    size: [usize; 2],
    /// Normal, with 1 along its longest axis, and the plane's offset.
    plane: (DVec3, f64),
    /// Presence of the area that is there.
    pub share: f64,
    pub albedo: DVec3,
    /// Tight box of what is there.
    pub lo: DVec3,
    pub hi: DVec3,
}

impl CutOut {
    /// Of `polygon` (voxel edges) in the voxel at `origin`, whose alpha is `cut`. `None`: nothing of it is there.
    pub fn new(staged: &dyn Staged, cut: &dyn Cut, polygon: &Polygon, origin: DVec3, normal: DVec3) -> Option<CutOut> {
        let n = normal.abs();
        let drop = if n.x >= n.y && n.x >= n.z {
            0
        } else if n.y >= n.z {
            1
        } else {
            2
        };
        let axes = [(drop + 1) % 3, (drop + 2) % 3];
        let [a, b] = axes;
        let corners = polygon.corners();
        let normal = normal / normal[drop];
        let plane = (normal, normal.dot(corners[0]));
        let (lo, hi) = polygon.bounds();
        // A cell is longer than its projection.
        let slope = [a, b].map(|e| libm::sqrt(1.0 + normal[e] * normal[e]));
        let detail = cut.detail();
        let size = [0, 1].map(|i| {
            let want = (SAMPLES * detail * slope[i] * (hi[axes[i]] - lo[axes[i]])).ceil();
            (want.min(CELLS as f64) as usize).max(FEWEST)
        });
        let step = [0, 1].map(|i| (hi[axes[i]] - lo[axes[i]]) / size[i] as f64);
        let at = |x: f64, y: f64| {
            let mut p = DVec3::ZERO;
            (p[a], p[b], p[drop]) = (x, y, plane.1 - normal[a] * x - normal[b] * y);
            p
        };
        let along = at(step[0], 0.0) - at(0.0, 0.0);
        let width = libm::sqrt(step[0] * step[1] * normal.length());
        let mut cells = 0;
        let (mut inside, mut there) = (0u32, 0.0);
        let (mut least, mut most) = ([usize::MAX; 2], [0; 2]);
        // Where most is there.
        let (mut densest, mut densest_share) = (polygon.middle(), 0.0);
        let seed = hash(polygon.facet);
        let mut alpha = [0.0f32; CELLS];
        for j in 0..size[1] {
            let y = lo[b] + (j as f64 + 0.5) * step[1];
            let alpha = &mut alpha[..size[0]];
            cut.row(origin + at(lo[a] + 0.5 * step[0], y), along, width, alpha);
            let (from, to) = span(corners, a, b, y);
            for (i, &alpha) in alpha.iter().enumerate() {
                let share = f64::from(alpha).clamp(0.0, 1.0);
                let x = lo[a] + (i as f64 + 0.5) * step[0];
                // The plastic number's recurrence: an even dither for what is there in part.
                let sum = seed + 0.754_877_666 * i as f64 + 0.569_840_291 * j as f64;
                let threshold = sum - f64::from(sum as u32);
                cells |= u64::from(share > threshold) << (j * CELLS + i);
                if x >= from && x < to {
                    inside += 1;
                    there += share;
                    if share > densest_share {
                        (densest, densest_share) = (at(x, y), share);
                    }
                    if share > 0.0 {
                        least = [least[0].min(i), least[1].min(j)];
                        most = [most[0].max(i + 1), most[1].max(j + 1)];
                    }
                }
            }
        }
        if inside == 0 {
            // A sliver between the samples.
            let mut alpha = [0.0];
            cut.row(origin + densest, DVec3::ZERO, width, &mut alpha);
            (inside, there) = (1, f64::from(alpha[0]).clamp(0.0, 1.0));
            (least, most) = ([0; 2], size);
        }
        if there <= 0.0 {
            return None;
        }
        let corner = |i: usize, cell: usize| lo[axes[i]] + cell as f64 * step[i];
        let ends = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(i, j)| {
            let of = |axis: usize, end: usize| corner(axis, [least, most][end][axis]);
            at(of(0, i), of(1, j))
        });
        let (first, last) = ends.iter().fold((hi, lo), |(f, l), p| (f.min(*p), l.max(*p)));
        let mut out = CutOut {
            axes,
            min: [lo[a], lo[b]],
            scale: step.map(|s| if s > 0.0 { 1.0 / s } else { 0.0 }),
            cells,
            size,
            plane,
            share: there / f64::from(inside),
            albedo: DVec3::ZERO,
            lo: first.clamp(lo, hi),
            hi: last.clamp(lo, hi),
        };
        out.albedo = out.colour(staged, polygon, origin, width, at, densest);
        Some(out)
    }

    /// Mean colour of a few of the cells that are there; of `densest` where the dither leaves none.
    fn colour(
        &self,
        staged: &dyn Staged,
        polygon: &Polygon,
        origin: DVec3,
        width: f64,
        at: impl Fn(f64, f64) -> DVec3,
        densest: DVec3,
    ) -> DVec3 {
        let look = |p: DVec3| DVec3::from(staged.surface(polygon.facet, origin + p, width).albedo.map(f64::from));
        let corners = polygon.corners();
        let place = |i: usize, j: usize| {
            let along = |cell: usize, axis: usize| self.min[axis] + (cell as f64 + 0.5) / self.scale[axis];
            [along(i, 0), along(j, 1)]
        };
        // What is there and within the polygon, row by row.
        let mut inner = [0u32; CELLS];
        let mut count = 0;
        for (j, inner) in inner.iter_mut().enumerate().take(self.size[1]) {
            let bits = self.cells >> (j * CELLS);
            let (from, to) = span(corners, self.axes[0], self.axes[1], place(0, j)[1]);
            for i in (0..self.size[0]).filter(|i| bits >> i & 1 != 0) {
                let x = place(i, j)[0];
                *inner |= u32::from(x >= from && x < to) << i;
            }
            count += inner.count_ones() as usize;
        }
        if count == 0 {
            return look(densest);
        }
        let mut wanted = (0..COLOURS).map(|n| count * (2 * n + 1) / (2 * COLOURS)).peekable();
        let mut sum = DVec3::ZERO;
        let mut before = 0;
        for (j, mut bits) in inner.into_iter().enumerate() {
            let end = before + bits.count_ones() as usize;
            while let Some(n) = wanted.next_if(|&n| n < end) {
                while before < n {
                    bits &= bits - 1;
                    before += 1;
                }
                let [x, y] = place(bits.trailing_zeros() as usize, j);
                sum += look(at(x, y));
            }
            before = end;
        }
        sum / COLOURS as f64
    }

    /// The cell, of both axes, that the plane's point with the coordinates `x`, `y` along them lies in, not rounded.
    pub fn cell(&self, p: DVec3) -> [f64; 2] {
        [0, 1].map(|i| (p[self.axes[i]] - self.min[i]) * self.scale[i])
    }

    /// Normal and offset of the plane.
    pub fn plane(&self) -> (DVec3, f64) {
        self.plane
    }

    /// What a step by `p` is in cells, of both axes.
    pub fn cells_along(&self, p: DVec3) -> [f64; 2] {
        [0, 1].map(|i| p[self.axes[i]] * self.scale[i])
    }

    /// Of the lines `from..to` of a row, those that meet what is there; `cell` and `step` are of the first line and from one
    /// to the next, in 65536ths of a cell. What is said of lines beyond `to` means nothing.
    #[inline(always)]
    pub fn row(&self, from: u32, to: u32, cell: [i32; 2], step: [i32; 2]) -> u32 {
        let last = self.size.map(|s| s as i32 - 1);
        let (low, high) = (self.cells as u32, (self.cells >> 32) as u32);
        let (mut bits, mut first) = (0, 0);
        while first < to - from {
            let mut lanes = [0; 8];
            for n in 0..8u32 {
                let along = |axis: usize| {
                    let at = cell[axis].wrapping_add(((first + n) as i32).wrapping_mul(step[axis]));
                    (at >> 16).clamp(0, last[axis]) as u32
                };
                let at = CELLS as u32 * along(1) + along(0);
                lanes[n as usize] = (if at < 32 { low } else { high } >> (at & 31) & 1) << n;
            }
            bits |= lanes.iter().fold(0, |all, lane| all | lane) << first;
            first += 8;
        }
        bits << from
    }
}

/// Where the line at `y` along axis `b` is in the convex polygon, along axis `a`.
fn span(corners: &[DVec3], a: usize, b: usize, y: f64) -> (f64, f64) {
    let (mut from, mut to) = (f64::INFINITY, f64::NEG_INFINITY);
    let Some(mut p) = corners.last() else { return (from, to) };
    for q in corners {
        if (p[b] <= y) != (q[b] <= y) {
            let x = p[a] + (y - p[b]) / (q[b] - p[b]) * (q[a] - p[a]);
            (from, to) = (from.min(x), to.max(x));
        }
        p = q;
    }
    (from, to)
}

/// A fixed number in [0, 1) for every facet.
fn hash(facet: u32) -> f64 {
    let mut h = facet.wrapping_mul(0x9e37_79b9);
    h = (h ^ h >> 16).wrapping_mul(0x85eb_ca6b);
    h = (h ^ h >> 13).wrapping_mul(0xc2b2_ae35);
    f64::from(h ^ h >> 16) / 4_294_967_296.0
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::bake::measure::Gather;
    use crate::geom::{Aabb, DAffine3, DMat3};
    use crate::progress::Quiet;
    use crate::scene::model::{Alpha, Instance, Material, Model, Part, TextureRef};
    use crate::scene::texture::Texture;
    use crate::source::mesh::{MeshOptions, MeshSource};
    use crate::source::{Placement, Source};

    /// A tilted card, 20 voxels wide, with `texture` on it once.
    fn card(texture: Texture, alpha: Alpha) -> (MeshSource, Placement) {
        let turn = DMat3::from_axis_angle(DVec3::new(0.3, 0.5, 0.8).normalize(), 0.9);
        let corner = |x: f64, y: f64| (turn * DVec3::new(20.0 * x, 20.0 * y, 0.0)).as_vec3().to_array();
        let part = Part {
            positions: vec![corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)],
            uvs: vec![vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Part::default()
        };
        let transform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let texture = TextureRef { texture: Arc::new(texture), tex_coord: 0, transform };
        let material = Material { texture: Some(texture), alpha, ..Material::default() };
        let instance = Instance { part: 0, transform: DAffine3::IDENTITY, node: String::new() };
        let model =
            Model { parts: vec![part], materials: vec![material], instances: vec![instance], ..Model::default() };
        let source = MeshSource::new(model, &MeshOptions::default());
        let min = DVec3::splat(-32.4);
        let place = Placement {
            bounds: Aabb::new(min, min + 64.0),
            transform: DAffine3::IDENTITY,
            scale: 1.0,
            depth: 6,
            up: 2,
            cyclic: [false; 3],
        };
        (source, place)
    }

    fn image(side: u32, alpha: impl Fn(f64, f64) -> u8) -> Texture {
        let at = |i: u32| (f64::from(i) + 0.5) / f64::from(side);
        let texels = (0..side * side).map(|i| [90, 120, 40, alpha(at(i % side), at(i / side))]).collect();
        Texture::new("card", side, side, texels)
    }

    fn disc(x: f64, y: f64) -> u8 {
        if (x - 0.5).hypot(y - 0.5) < 0.4 { 255 } else { 0 }
    }

    /// Presence of a piece by `n` × `n` point samples of the box of its projection.
    fn sampled(staged: &dyn Staged, p: &Polygon, n: usize) -> f64 {
        let normal = p.area_vector();
        let drop = (0..3).max_by(|&i, &j| normal[i].abs().total_cmp(&normal[j].abs())).unwrap();
        let (a, b) = ((drop + 1) % 3, (drop + 2) % 3);
        let (lo, hi) = p.bounds();
        let (mut inside, mut there) = (0, 0.0);
        for j in 0..n {
            let y = lo[b] + (j as f64 + 0.5) / n as f64 * (hi[b] - lo[b]);
            let (from, to) = span(p.corners(), a, b, y);
            for i in 0..n {
                let x = lo[a] + (i as f64 + 0.5) / n as f64 * (hi[a] - lo[a]);
                if x >= from && x < to {
                    let mut q = p.corners()[0];
                    q[drop] -= (normal[a] * (x - q[a]) + normal[b] * (y - q[b])) / normal[drop];
                    (q[a], q[b]) = (x, y);
                    inside += 1;
                    there += f64::from(staged.surface(p.facet, q, 0.0).alpha);
                }
            }
        }
        if inside > 0 { there / f64::from(inside) } else { 0.0 }
    }

    struct Found {
        area: f64,
        /// What the lines say of the area, from its 13 projections.
        lines: f64,
        /// Root of the mean square error of a piece's share, against 64 × 64 samples: of this, and of 8 × 8 samples.
        error: [f64; 2],
    }

    fn find(texture: Texture, alpha: Alpha) -> Found {
        let (source, place) = card(texture, alpha);
        let staged = source.stage(&place, &Quiet).unwrap();
        let mut found = Found { area: 0.0, lines: 0.0, error: [0.0; 2] };
        let (mut whole, mut count, mut projected) = (0.0, 0.0, 0.0);
        for region in 0..staged.regions().len() {
            let wide = 1 << crate::source::REGION_LOG2;
            let low = crate::morton::decode(staged.regions()[region]).map(|v| f64::from(v * wide));
            let corner = DVec3::from(low);
            staged.emit(region, &mut |facet| {
                pieces(&*staged, facet, corner, corner + f64::from(wide), &mut |p, at, cut| {
                    let area = p.area_vector();
                    let size = area.length();
                    let local = p.relative_to(at);
                    let one = cut.map(|cut| CutOut::new(&*staged, cut, &local, at, area / size));
                    let share = one.as_ref().map_or(1.0, |c| c.as_ref().map_or(0.0, |c| c.share));
                    found.area += share * size;
                    if size > 0.2 && cut.is_some() {
                        let truth = sampled(&*staged, p, 64);
                        count += 1.0;
                        found.error[0] += (share - truth).powi(2);
                        found.error[1] += (sampled(&*staged, p, 8) - truth).powi(2);
                    }
                    let mut gather = Gather::new(false);
                    gather.add(&*staged, p, at, cut);
                    for k in 0..13 {
                        whole += f64::from(gather.lines(k)) / 256.0;
                        projected += crate::geom::oblique_area(k, area) / size / 13.0 * share * size;
                    }
                });
            });
        }
        found.lines = whole / 13.0 / projected * found.area;
        found.error = found.error.map(|e: f64| (e / f64::max(count, 1.0)).sqrt());
        found
    }

    #[test]
    fn a_masked_disc_has_the_area_of_a_disc() {
        // 6, 13 and 51 texels a voxel: every texel sampled, and averaged.
        for side in [128, 256, 1024] {
            let image = image(side, disc);
            let share = image.texels.iter().filter(|t| t[3] > 0).count() as f64 / f64::from(side * side);
            // The image's own steps.
            assert!((share / std::f64::consts::PI / 0.16 - 1.0).abs() < 4e-3);
            let f = find(image, Alpha::Mask(0.5));
            let want = 400.0 * share;
            // Some 80 voxels of rim, each off by .01: .09 of 200.
            assert!((f.area / want - 1.0).abs() < 2e-3, "{side}: {} of {want}", f.area);
            assert!((f.lines / want - 1.0).abs() < 5e-3, "{side}: {} of {want}", f.lines);
            // Up to 8 texels a voxel both are point samples, in lattices that differ in where they start; from there on ours are
            // means of all texels.
            assert!(f.error[0] < 0.015 && f.error[0] < 1.1 * f.error[1], "{side}: {:?}", f.error);
            assert!(side == 128 || f.error[0] < 0.9 * f.error[1], "{side}: {:?}", f.error);
        }
    }

    #[test]
    fn a_fine_checkerboard_is_half_there() {
        // 51 texels a voxel in squares of 3: what point samples alias.
        let square = |x: f64, y: f64| if ((x * 341.0) as u32 + (y * 341.0) as u32).is_multiple_of(2) { 255 } else { 0 };
        let f = find(image(1023, square), Alpha::Mask(0.5));
        // The share of a voxel's 17 × 17 squares, with those that its rim cuts.
        assert!((f.area / 200.0 - 1.0).abs() < 3e-3, "{}", f.area);
        assert!((f.lines / 200.0 - 1.0).abs() < 1e-2, "{}", f.lines);
        assert!(f.error[0] < 0.03 && f.error[0] < 0.5 * f.error[1], "{:?}", f.error);
    }

    #[test]
    fn blended_alpha_is_the_share_that_is_there() {
        // 128 of 255 everywhere, one texel and many a voxel.
        for side in [20, 1024] {
            let f = find(image(side, |_, _| 128), Alpha::Blend);
            let want = 400.0 * 128.0 / 255.0;
            assert!((f.area / want - 1.0).abs() < 1e-5, "{}", f.area);
            // A dither over some 400 pieces of 16 to 64 cells: each is off by less than half a cell, 1/128 or more.
            assert!((f.lines / want - 1.0).abs() < 2e-2, "{} {want}", f.lines);
        }
    }
}
