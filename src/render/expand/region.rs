//! Decomposition of a shell into convex regions on which texel coordinates are, nearly enough, an affine function of the position: the whole
//! prism of a face if its height vectors agree, else tetrahedra.
//!
//! Based on: S. Porumbescu, B. Budge, L. Feng, K. Joy, *Shell Maps*, SIGGRAPH 2005 (prisms are cut into tetrahedra, on which
//! the map of the shell is affine).

use super::clip::HalfSpace;
use crate::geom::{Aabb, DAffine3, DMat3, DVec3};
use crate::render::cells::TexelLayer;
use crate::render::faces::Face;
use crate::render::jitter::height_stretch;
use crate::render::shell::{Corner, ShellPoint};

/// Most subdivisions of a face's edges and of its height; a face that would need more gets a larger error.
const MAX_CUTS: [usize; 2] = [512, 32];

/// A convex region of a shell, in the texel coordinates of a layer.
#[derive(Debug, Clone)]
pub struct Region {
    pub half_spaces: Vec<HalfSpace>,
    pub bounds: Aabb,
    /// Map from texel coordinates to the world.
    pub to_world: DAffine3,
}

/// A point of a shell: its world position `x`, its texel coordinates `q` in the layer, and its height as a share of the shell's, which
/// ends at 1.
#[derive(Debug, Clone, Copy)]
struct ShellSample {
    x: DVec3,
    q: DVec3,
    height: f64,
}

/// A face of a shell with a layer in it.
pub struct FacePrism<'a> {
    pub face: &'a Face,
    pub layer: &'a TexelLayer,
}

impl FacePrism<'_> {
    /// The corners with their weights at a point of the face, which is given by the barycentric weights of corners 1 and 2 of a triangle, or by
    /// the two parameters of a patch.
    fn corners(&self, [s, t]: [f64; 2]) -> [(&Corner, f64); 4] {
        match self.face {
            Face::Triangle([a, b, c]) => [(a, 1.0 - s - t), (b, s), (c, t), (c, 0.0)],
            Face::Patch([a, b, c, d]) => {
                [(a, (1.0 - s) * (1.0 - t)), (b, s * (1.0 - t)), (c, s * t), (d, (1.0 - s) * t)]
            }
        }
    }

    /// The point above the point `b` of the face, at the share `w` of the height vectors.
    fn at(&self, b: [f64; 2], w: f64) -> ShellSample {
        let corners = self.corners(b);
        let mix = |of: fn(&Corner) -> DVec3| corners.iter().map(|(c, share)| *share * of(c)).sum::<DVec3>();
        let number = |of: fn(&Corner) -> f64| corners.iter().map(|(c, share)| share * of(c)).sum::<f64>();
        let layer = &self.layer.layer;
        let (scale, offset) = (DVec3::from_array(layer.scale), DVec3::from_array(layer.offset));
        let rise = w * number(|c| c.dw);
        let x = mix(|c| c.p) + w * mix(|c| c.h);
        let plain = (mix(|c| c.q) + rise * DVec3::Z) * scale + offset;
        let Some(jitter) = &self.layer.jitter else { return ShellSample { x, q: plain, height: w } };
        let mask = number(|c| c.jitter).clamp(0.0, 1.0);
        let (q, height) = jitter.jittered(&ShellPoint { q: plain, rise: rise * scale.z, height: w, mask });
        ShellSample { x, q, height: height * height_stretch(layer.continuous.as_ref()) }
    }

    /// Whether texel coordinates are an affine function of the world.
    fn is_affine(&self) -> bool {
        let Face::Triangle([a, b, c]) = self.face else { return false };
        self.layer.jitter.is_none() && a.h == b.h && a.h == c.h && a.dw == b.dw && a.dw == c.dw
    }

    /// Whether the parameters of the face fill the unit square (a patch), and not half of it (a triangle).
    fn is_square(&self) -> bool {
        matches!(self.face, Face::Patch(_))
    }

    /// Call `each` for the regions, whose maps deviate by at most `tolerance` cells from the shell's own. Regions without a volume are left
    /// out.
    pub fn regions(&self, tolerance: f64, each: &mut dyn FnMut(&Region)) {
        if self.is_affine() {
            let at =
                [self.at([0.0; 2], 0.0), self.at([1.0, 0.0], 0.0), self.at([0.0, 1.0], 0.0), self.at([0.0; 2], 1.0)];
            if let Some(region) = prism(&at) {
                each(&region);
            }
            return;
        }
        let [across, up] = self.subdivisions(tolerance);
        let grid = SampleGrid::new(self, across, up);
        grid.tetrahedra(&mut |at| {
            if let Some(region) = tetrahedron(&at) {
                each(&region);
            }
        });
    }

    /// Number of subdivisions of edges and of the height that keep to the tolerance.
    fn subdivisions(&self, tolerance: f64) -> [usize; 2] {
        let mut cuts = [1; 2];
        loop {
            let [flat, high, both] = self.deviations(cuts);
            let room = [0, 1].map(|k| cuts[k] < MAX_CUTS[k]);
            let mut more = [flat > tolerance && room[0], high > tolerance && room[1]];
            if more == [false; 2] && both > tolerance {
                // A twist, which is reduced by subdividing either; the coarser of the two is subdivided.
                let up = room[1] && (cuts[1] < cuts[0] || !room[0]);
                more = [!up && room[0], up];
            }
            if more == [false; 2] {
                return cuts;
            }
            (0..2).filter(|k| more[*k]).for_each(|k| cuts[k] *= 2);
        }
    }

    /// Largest deviations, in cells, of the middle of an edge of the grid from the mean of its ends: of edges across, of edges upward, and of
    /// diagonals. Only a sample of the edges is checked.
    fn deviations(&self, [across, up]: [usize; 2]) -> [f64; 3] {
        const CHECKS_PER_AXIS: usize = 3;
        let (n, m) = (across as f64, up as f64);
        let bend = |b: [f64; 2], w: f64, db: [f64; 2], dw: f64| {
            let at = |share: f64| self.at([b[0] + share * db[0], b[1] + share * db[1]], w + share * dw);
            let (a, c, middle) = (at(0.0), at(1.0), at(0.5));
            // A deviation in the world is converted to cells by the ratio of the edge's lengths in both.
            let size = (a.q.distance(c.q) / a.x.distance(c.x).max(f64::MIN_POSITIVE)).min(1e12);
            middle.q.distance(0.5 * (a.q + c.q)).max(size * middle.x.distance(0.5 * (a.x + c.x)))
        };
        let (mut flat, mut high, mut both) = (0.0f64, 0.0f64, 0.0f64);
        let step = |v: usize, parts: f64| ((v as f64 / CHECKS_PER_AXIS as f64) * (parts - 1.0)).round() / parts;
        let whole = self.is_square();
        let last = |i: usize| if whole { CHECKS_PER_AXIS } else { CHECKS_PER_AXIS - i };
        let looks = (0..=CHECKS_PER_AXIS)
            .flat_map(|i| (0..=last(i)).flat_map(move |j| (0..=CHECKS_PER_AXIS).map(move |k| [i, j, k])));
        for [i, j, k] in looks {
            let (b, w) = ([step(i, n), step(j, n)], step(k, m));
            high = high.max(bend(b, w, [0.0; 2], 1.0 / m));
            for db in [[1.0 / n, 0.0], [0.0, 1.0 / n], [1.0 / n, -1.0 / n]] {
                let from = if db[1] < 0.0 { [b[0], b[1] + 1.0 / n] } else { b };
                let ends = [from, [from[0] + db[0], from[1] + db[1]]];
                let most = |end: [f64; 2]| if whole { end[0].max(end[1]) } else { end[0] + end[1] };
                if ends.into_iter().all(|end| most(end) <= 1.0 + 1e-9) {
                    flat = flat.max(bend(from, w, db, 0.0)).max(bend(from, w + 1.0 / m, db, 0.0));
                    both = both.max(bend(from, w, db, 1.0 / m));
                }
            }
        }
        [flat, high, both]
    }
}

/// Samples of a face: `across` parts along its edges, `up` along its height.
struct SampleGrid {
    across: usize,
    up: usize,
    square: bool,
    samples: Vec<ShellSample>,
}

impl SampleGrid {
    fn new(face: &FacePrism<'_>, across: usize, up: usize) -> SampleGrid {
        let square = face.is_square();
        let mut samples = Vec::new();
        for k in 0..=up {
            for i in 0..=across {
                for j in 0..=if square { across } else { across - i } {
                    let b = [i as f64 / across as f64, j as f64 / across as f64];
                    samples.push(face.at(b, k as f64 / up as f64));
                }
            }
        }
        SampleGrid { across, up, square, samples }
    }

    fn index(&self, i: usize, j: usize, k: usize) -> usize {
        let n = self.across + 1;
        if self.square {
            return (k * n + i) * n + j;
        }
        // Each row of a triangle is shorter by one than the row before.
        k * (n * (n + 1) / 2) + i * n - i * i.saturating_sub(1) / 2 + j
    }

    /// Call `each` for the three tetrahedra of each small prism. Neighbouring prisms of a face are cut along the same diagonals.
    fn tetrahedra(&self, each: &mut dyn FnMut([ShellSample; 4])) {
        for k in 0..self.up {
            for i in 0..self.across {
                for j in 0..if self.square { self.across } else { self.across - i } {
                    self.small_prism([[i, j], [i + 1, j], [i, j + 1]], k, each);
                    if self.square || i + j + 1 < self.across {
                        self.small_prism([[i + 1, j], [i + 1, j + 1], [i, j + 1]], k, each);
                    }
                }
            }
        }
    }

    fn small_prism(&self, foot: [[usize; 2]; 3], k: usize, each: &mut dyn FnMut([ShellSample; 4])) {
        // Diagonals go from the lower vertex of an edge's base to the higher one's top.
        let mut foot = foot;
        foot.sort_unstable();
        let at = |[i, j]: [usize; 2], k: usize| self.samples.get(self.index(i, j, k)).copied();
        let [a, b, c] = foot;
        for corners in [
            [at(a, k), at(b, k), at(c, k), at(c, k + 1)],
            [at(a, k), at(b, k), at(b, k + 1), at(c, k + 1)],
            [at(a, k), at(a, k + 1), at(b, k + 1), at(c, k + 1)],
        ] {
            if let [Some(p), Some(q), Some(r), Some(s)] = corners {
                each([p, q, r, s]);
            }
        }
    }
}

/// The matrix whose rows map texel coordinates to weights of the three edges from the first corner, and the affine map to the world; `None`
/// for a tetrahedron without a volume.
fn affine(at: &[ShellSample; 4]) -> Option<(DMat3, DAffine3)> {
    let edges = |of: fn(&ShellSample) -> DVec3| {
        DMat3::from_cols(of(&at[1]) - of(&at[0]), of(&at[2]) - of(&at[0]), of(&at[3]) - of(&at[0]))
    };
    let (q, x) = (edges(|s| s.q), edges(|s| s.x));
    // A region thinner than 1e-12 of its size counts as having no volume.
    let size = q.x_axis.length() * q.y_axis.length() * q.z_axis.length();
    if q.determinant().abs().partial_cmp(&(1e-12 * size)) != Some(std::cmp::Ordering::Greater) {
        return None;
    }
    let inverse = q.inverse();
    let matrix3 = x * inverse;
    let to_world = DAffine3 { matrix3, translation: at[0].x - matrix3 * at[0].q };
    (to_world.is_finite() && matrix3.determinant() != 0.0).then_some((inverse.transpose(), to_world))
}

/// The half-space 0 ≤ n · (q − q0). `outer` tells that no other region lies beyond, so it is closed.
fn above(n: DVec3, q0: DVec3, outer: bool) -> HalfSpace {
    let space = HalfSpace::shared(-n, -n.dot(q0));
    HalfSpace { closed: space.closed || outer, ..space }
}

/// The half-space n · (q − q0) ≤ 1; `outer` as in [`above`].
fn below(n: DVec3, q0: DVec3, outer: bool) -> HalfSpace {
    let space = HalfSpace::shared(n, 1.0 + n.dot(q0));
    HalfSpace { closed: space.closed || outer, ..space }
}

/// The whole prism of a face, from the three corners of its base and the top above the first one.
fn prism(at: &[ShellSample; 4]) -> Option<Region> {
    let (rows, to_world) = affine(at)?;
    let q0 = at[0].q;
    let (b1, b2, w) = (rows.x_axis, rows.y_axis, rows.z_axis);
    let half_spaces = vec![
        above(b1, q0, false),
        above(b2, q0, false),
        below(b1 + b2, q0, false),
        above(w, q0, true),
        below(w, q0, true),
    ];
    let rise = at[3].q - q0;
    let base = [at[0].q, at[1].q, at[2].q];
    let bounds = Aabb::around(base.into_iter().flat_map(|q| [q, q + rise]));
    Some(Region { half_spaces, bounds, to_world })
}

/// The part of a tetrahedron below the shell's end. Faces in the shell's base and top belong to it.
fn tetrahedron(at: &[ShellSample; 4]) -> Option<Region> {
    let (rows, to_world) = affine(at)?;
    if at.iter().all(|s| s.height >= 1.0) {
        return None;
    }
    let q0 = at[0].q;
    let lies = |skip: usize, height: f64| (0..4).filter(|k| *k != skip).all(|k| at[k].height == height);
    let mut half_spaces = vec![
        above(rows.x_axis, q0, lies(1, 0.0)),
        above(rows.y_axis, q0, lies(2, 0.0)),
        above(rows.z_axis, q0, lies(3, 0.0)),
        below(rows.x_axis + rows.y_axis + rows.z_axis, q0, lies(0, 0.0)),
    ];
    if at.iter().any(|s| s.height > 1.0) {
        let n = (1..4).map(|k| (at[k].height - at[0].height) * rows.col(k - 1)).sum::<DVec3>();
        half_spaces.push(HalfSpace { n, c: 1.0 - at[0].height + n.dot(q0), closed: true });
    }
    let bounds = Aabb::around(at.iter().map(|s| s.q));
    Some(Region { half_spaces, bounds, to_world })
}
