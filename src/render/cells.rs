//! From texel coordinates to copies of the texel: each integer cell of (u, v, w) holds one, wrapped, and varied by a hash.
//!
//! Based on: F. Neyret, *Synthesizing Verdant Landscapes using Volumetric Textures*, RR-2846, 1996 (jittered copies);
//! M. Jarzynski, M. Olano, *Hash Functions for GPU Rendering*, JCGT 2020 (pcg4d); J. Amanatides, A. Woo, *A Fast Voxel
//! Traversal Algorithm for Ray Tracing*, 1987.

use super::shell::ShellSegment;
use crate::geom::{Aabb, DMat3, DVec3, Ray, Vec3};
use crate::scene::cycle::Cycle;
use crate::scene::shell::{CellWrap, Discrete, Layer, Orientations};
use crate::volume::Info;
use crate::{Error, Result};

/// A layer, ready for rays.
#[derive(Debug, Clone)]
pub struct TexelLayer {
    pub layer: Layer,
    /// Texels that the hash chooses from, at least one.
    pub choices: Vec<TexelChoice>,
}

/// A texel that a cell may hold.
#[derive(Debug, Clone)]
pub struct TexelChoice {
    /// Index into the scene's texels.
    pub texel: usize,
    /// Frames of the texel, in a row from `texel` on, and which of them a cell shows.
    pub frames: u32,
    pub cycle: Option<Cycle>,
    /// The chance of this or an earlier one, rising to 1.
    pub cumulative: f64,
    /// The box of its content, texel space.
    pub content: Aabb,
    /// Multiplies its albedo.
    pub tint: Vec3,
}

impl TexelChoice {
    /// The texel that `cell` shows: of one that has frames, one of them.
    fn shown(&self, cell: [i64; 3]) -> usize {
        let Some(cycle) = self.cycle.filter(|_| self.frames > 1) else { return self.texel };
        let lot = Cycle::lot(cell);
        let place = DVec3::new(cell[0] as f64, cell[1] as f64, cell[2] as f64);
        self.texel + cycle.frame(self.frames, cycle.ahead(lot, place), lot) as usize
    }
}

/// The frames of a texel together.
pub struct Row<'a> {
    /// What the first says.
    pub info: &'a Info,
    /// The box of all their contents.
    pub content: Aabb,
}

/// The `frames` of a texel, `first` and those behind it; `None` where one of them is not open.
///
/// # Errors
/// [`Error::Options`] where they do not cover one box: what stands in it would jump.
pub fn row<'i>(first: usize, frames: u32, info: impl Fn(usize) -> Option<&'i Info>) -> Result<Option<Row<'i>>> {
    let Some(own) = info(first) else { return Ok(None) };
    let mut content = own.content;
    for k in 1..frames as usize {
        let Some(next) = info(first + k) else { return Ok(None) };
        if next.bounds != own.bounds || next.up != own.up {
            return Err(Error::Options(format!(
                "frame {k} of a texel covers another box than frame 0; bake them together, with --frames"
            )));
        }
        content = content.union(next.content);
    }
    Ok(Some(Row { info: own, content }))
}

/// A copy of a texel that a ray hits, and the straight segment of the ray in the copy's cell.
#[derive(Debug, Clone, Copy)]
pub struct CopyHit {
    pub texel: usize,
    /// Multiplies the texel's albedo.
    pub tint: Vec3,
    /// The cell that holds the copy, or for a rigid copy its number: what tells copies apart.
    pub cell: [i64; 3],
    pub t0: f64,
    pub t1: f64,
    /// Texel space, the cube [0,1]^3: where the ray is at t0, and how far it goes per unit of t.
    pub origin: DVec3,
    pub dir: DVec3,
    /// Cell space → texel space: a signed permutation over the copy's scale.
    pub linear: DMat3,
    /// 1 / the copy's scale: what `linear` multiplies lengths by.
    pub zoom: f64,
}

impl CopyHit {
    /// The ray in texel space, from t0 on.
    pub fn ray(&self) -> Ray {
        Ray { origin: self.origin, dir: self.dir }
    }

    /// Whether the segment passes by `content`, a box in texel space; where it only just does, it may say no.
    pub fn misses(&self, content: &Aabb) -> bool {
        // More than what a march allows for by rounding.
        const PAD: f64 = 1e-5;
        let inverse = self.dir.recip();
        let (a, b) = ((content.min - PAD - self.origin) * inverse, (content.max + PAD - self.origin) * inverse);
        a.min(b).max_element().max(0.0) > a.max(b).min_element().min(self.t1 - self.t0)
    }
}

/// The hash that varies copies. Normative: pcg4d on (u, v, w, seed), coordinates and seed as 32-bit two's complement.
/// `hash(cell, seed)` gives numbers 0 … 3, `hash(cell, !seed)` numbers 4 … 7, each divided by 2^32 into [0, 1):
/// 0 presence, 1 variant, 2 orientation, 3 scale, 4–6 displacement along u, v, w.
pub fn hash(cell: [i64; 3], seed: u32) -> [u32; 4] {
    let mut v = [cell[0] as u32, cell[1] as u32, cell[2] as u32, seed]
        .map(|x| x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let mix = |v: &mut [u32; 4]| {
        v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[3]));
        v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
        v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
        v[3] = v[3].wrapping_add(v[1].wrapping_mul(v[2]));
    };
    mix(&mut v);
    v = v.map(|x| x ^ (x >> 16));
    mix(&mut v);
    v
}

fn unit(x: u32) -> f64 {
    f64::from(x) * (1.0 / 4_294_967_296.0)
}

/// At most so many cells along one straight segment are looked into.
const MAX_CELLS_PER_SEGMENT: u32 = 1 << 16;

impl TexelLayer {
    /// The copies that a segment (in the layer's texel coordinates) runs through, in order, until `each` returns false.
    /// False if stopped.
    pub fn for_each_copy(&self, segment: &ShellSegment, each: &mut dyn FnMut(&CopyHit) -> bool) -> bool {
        let dir = (segment.q1 - segment.q0) / (segment.t1 - segment.t0);
        if !dir.is_finite() {
            return true;
        }
        let at = |t: f64| segment.q0 + (t - segment.t0) * dir;
        let (mut t0, mut t1) = (segment.t0, segment.t1);
        for k in (0..3).filter(|&k| self.layer.wrap[k] == CellWrap::Empty) {
            let (q, d) = (segment.q0[k], dir[k]);
            if d == 0.0 {
                if !(0.0..1.0).contains(&q) {
                    return true;
                }
                continue;
            }
            let (a, b) = (segment.t0 - q / d, segment.t0 + (1.0 - q) / d);
            t0 = t0.max(a.min(b));
            t1 = t1.min(a.max(b));
        }
        if t0.is_nan() || t1.is_nan() || t0 >= t1 {
            return true;
        }
        let start = at(t0);
        let mut cell = [0i64; 3];
        for k in 0..3 {
            // A start on a boundary belongs to the cell that the ray goes into.
            let q = start[k];
            cell[k] = if dir[k] < 0.0 { q.ceil() as i64 - 1 } else { q.floor() as i64 };
            if self.layer.wrap[k] == CellWrap::Empty {
                cell[k] = 0;
            }
        }
        let leave = |cell: &[i64; 3], k: usize| {
            if dir[k] == 0.0 || self.layer.wrap[k] == CellWrap::Empty {
                return f64::INFINITY;
            }
            let edge = cell[k] as f64 + if dir[k] > 0.0 { 1.0 } else { 0.0 };
            segment.t0 + (edge - segment.q0[k]) / dir[k]
        };
        let mut next = [leave(&cell, 0), leave(&cell, 1), leave(&cell, 2)];
        for _ in 0..MAX_CELLS_PER_SEGMENT {
            let axis = (0..3).fold(0, |best, k| if next[k] < next[best] { k } else { best });
            let end = next[axis].min(t1);
            if end > t0 {
                if let Some(hit) = self.hit(cell, at(t0), dir, t0, end)
                    && !each(&hit)
                {
                    return false;
                }
                t0 = end;
            }
            if end >= t1 {
                return true;
            }
            cell[axis] = cell[axis].saturating_add(if dir[axis] > 0.0 { 1 } else { -1 });
            next[axis] = leave(&cell, axis);
        }
        true
    }

    /// The copy in `cell`, for the ray at `q` going along `dir` (cell space); `None` where the cell is empty.
    fn hit(&self, cell: [i64; 3], q: DVec3, dir: DVec3, t0: f64, t1: f64) -> Option<CopyHit> {
        let origin = DVec3::new(cell[0] as f64, cell[1] as f64, cell[2] as f64);
        // A start on a face may lie outside by rounding.
        let mut p = (q - origin).clamp(DVec3::ZERO, DVec3::ONE);
        let mut sign = DVec3::ONE;
        for k in 0..3 {
            if self.layer.wrap[k] == CellWrap::Mirror && cell[k] & 1 != 0 {
                p[k] = 1.0 - p[k];
                sign[k] = -1.0;
            }
        }
        let first = self.choices.first()?;
        let Some(discrete) = &self.layer.discrete else {
            let linear = DMat3::from_diagonal(sign);
            let (texel, tint) = (first.shown(cell), first.tint);
            return Some(CopyHit { texel, tint, cell, t0, t1, origin: p, dir: sign * dir, linear, zoom: 1.0 });
        };
        let (choice, CopyPlacement { linear: m, origin, zoom }) = self.place(discrete, cell)?;
        let linear = DMat3::from_cols(m.x_axis * sign.x, m.y_axis * sign.y, m.z_axis * sign.z);
        Some(CopyHit {
            texel: choice.shown(cell),
            tint: choice.tint,
            cell,
            t0,
            t1,
            origin: m * (p - origin) + BASE,
            dir: linear * dir,
            linear,
            zoom,
        })
    }

    /// Variant and placement that the hash gives the copy in `cell`.
    fn place(&self, discrete: &Discrete, cell: [i64; 3]) -> Option<(&TexelChoice, CopyPlacement)> {
        let h = hash(cell, discrete.seed).map(unit);
        if h[0] >= discrete.presence {
            return None;
        }
        let choice = self.choices.iter().find(|c| h[1] < c.cumulative).or(self.choices.last())?;
        let turn = match discrete.orientations {
            Orientations::Identity => 0,
            Orientations::W4 => (h[2] * 4.0) as usize,
            Orientations::W8 => (h[2] * 8.0) as usize,
        };
        let scale = discrete.scale[0] + h[3] * (discrete.scale[1] - discrete.scale[0]);
        // Texel → cell: mirror v (turn ≥ 4), a quarter turn about w for each of turn mod 4, scale, displace.
        let (cos, sin) = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][turn & 3];
        let m = if turn >= 4 { -1.0 } else { 1.0 };
        let forward = DMat3::from_cols(DVec3::new(cos, sin, 0.0), DVec3::new(-sin * m, cos * m, 0.0), DVec3::Z) * scale;
        let extent = || Aabb::around([choice.content.min, choice.content.max].map(|c| forward * (c - BASE) + BASE));
        let mut origin = BASE;
        if discrete.displace.iter().any(|&d| d != 0.0) {
            let (h, extent) = (hash(cell, !discrete.seed).map(unit), extent());
            for k in 0..3 {
                let (least, most) = ((-extent.min[k]).min(0.0), (1.0 - extent.max[k]).max(0.0));
                origin[k] += (discrete.displace[k] * (2.0 * h[k] - 1.0)).clamp(least, most);
            }
        }
        let linear = forward.transpose() * (1.0 / (scale * scale));
        Some((choice, CopyPlacement { linear, origin, zoom: 1.0 / scale }))
    }
}

/// The point of a texel about which copies are scaled and turned: the middle of its floor.
const BASE: DVec3 = DVec3::new(0.5, 0.5, 0.0);

struct CopyPlacement {
    /// Cell → texel.
    linear: DMat3,
    /// Place of [`BASE`] in the cell.
    origin: DVec3,
    zoom: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layer(wrap: [CellWrap; 3], discrete: Option<Discrete>) -> TexelLayer {
        let layer = Layer { wrap, discrete, ..Layer::default() };
        let content = Aabb::new(DVec3::new(0.3, 0.2, 0.0), DVec3::new(0.6, 0.9, 0.8));
        let choice = TexelChoice { texel: 0, frames: 1, cycle: None, cumulative: 1.0, content, tint: Vec3::ONE };
        TexelLayer { layer, choices: vec![choice] }
    }

    fn segment(q0: DVec3, q1: DVec3) -> ShellSegment {
        ShellSegment { t0: 2.0, t1: 5.0, q0, q1, to_texel: DMat3::IDENTITY }
    }

    const REPEAT: [CellWrap; 3] = [CellWrap::Repeat, CellWrap::Repeat, CellWrap::Empty];

    /// Frozen: files that vary copies by the hash must look the same for ever.
    #[test]
    fn hash_vectors() {
        assert_eq!(hash([0, 0, 0], 0), hash([1 << 32, 0, 0], 0));
        assert_ne!(hash([1, 0, 0], 0), hash([0, 1, 0], 0));
        assert_ne!(hash([-1, 0, 0], 7), hash([1, 0, 0], 7));
        assert_eq!(hash([1, 2, 3], 4), reference([1, 2, 3, 4]));
        assert_eq!(hash([-1, -2, 3], 4), reference([u32::MAX, u32::MAX - 1, 3, 4]));
    }

    /// pcg4d in 64-bit arithmetic, written apart.
    fn reference(v: [u32; 4]) -> [u32; 4] {
        let m = 1u64 << 32;
        let [mut x, mut y, mut z, mut w] = v.map(|a| (u64::from(a) * 1_664_525 + 1_013_904_223) % m);
        for round in 0..2 {
            x = (x + y * w % m) % m;
            y = (y + z * x % m) % m;
            z = (z + x * y % m) % m;
            w = (w + y * z % m) % m;
            if round == 0 {
                [x, y, z, w] = [x, y, z, w].map(|a| a ^ a >> 16);
            }
        }
        [x as u32, y as u32, z as u32, w as u32]
    }

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

    #[test]
    fn discrete_copies_stay_in_their_cell() {
        let discrete = Discrete {
            seed: 5,
            orientations: Orientations::W8,
            scale: [0.5, 1.0],
            displace: [0.4, 0.4, 0.4],
            presence: 0.7,
            variants: vec![],
        };
        let layer = layer(REPEAT, Some(discrete.clone()));
        let mut present = 0;
        for u in -20..20 {
            for v in -20..20 {
                let Some((choice, placed)) = layer.place(&discrete, [u, v, 0]) else { continue };
                present += 1;
                let back = placed.linear.inverse();
                for corner in [choice.content.min, choice.content.max] {
                    let p = back * (corner - BASE) + placed.origin;
                    assert!(p.min_element() > -1e-12 && p.max_element() < 1.0 + 1e-12, "{p}");
                }
                assert!((placed.linear.determinant().abs() - placed.zoom.powi(3)).abs() < 1e-12);
            }
        }
        // 1600 cells at .7: standard deviation 18.
        assert!((present - 1120i32).abs() < 80, "{present}");
    }

    #[test]
    fn endless_rows_are_left_after_a_bound() {
        let mut n = 0u32;
        layer(REPEAT, None).for_each_copy(&segment(DVec3::new(0.0, 0.5, 0.5), DVec3::new(1e12, 0.5, 0.5)), &mut |_| {
            n += 1;
            true
        });
        assert_eq!(n, MAX_CELLS_PER_SEGMENT);
    }
}
