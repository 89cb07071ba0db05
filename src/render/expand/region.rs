//! Convex regions of a shell on which texel coordinates are an affine function of the world, or near enough to one: a face's
//! prism whole where its height vectors agree, else tetrahedra.
//!
//! Based on: S. Porumbescu, B. Budge, L. Feng, K. Joy, *Shell Maps*, SIGGRAPH 2005 (prisms are cut into tetrahedra, on which
//! the map of the shell is affine).

use super::clip::HalfSpace;
use crate::geom::{Aabb, DAffine3, DMat3, DVec3};
use crate::render::cells::TexelLayer;
use crate::render::faces::Face;
use crate::render::jitter::stretch;
use crate::render::shell::{Corner, ShellPoint};

/// Most parts of a face's edges and of its height: beyond that a face bends as it may.
const MOST_CUTS: [usize; 2] = [512, 32];

/// A convex piece of a shell, in the texel coordinates of a layer.
#[derive(Debug, Clone)]
pub struct Region {
    pub spaces: Vec<HalfSpace>,
    pub bounds: Aabb,
    /// Texel coordinates → world.
    pub to_world: DAffine3,
}

/// A point of a shell: the world, the layer's texel coordinates, and how far up the shell, of which 1 is the end.
#[derive(Debug, Clone, Copy)]
struct Sample {
    x: DVec3,
    q: DVec3,
    height: f64,
}

/// A face of a shell with a layer in it.
pub struct Prism<'a> {
    pub face: &'a Face,
    pub layer: &'a TexelLayer,
}

impl Prism<'_> {
    /// The corners with their shares of the point `b`: of a triangle the weights of corners 1 and 2, of a patch its two
    /// parameters.
    fn corners(&self, [s, t]: [f64; 2]) -> [(&Corner, f64); 4] {
        match self.face {
            Face::Triangle([a, b, c]) => [(a, 1.0 - s - t), (b, s), (c, t), (c, 0.0)],
            Face::Patch([a, b, c, d]) => {
                [(a, (1.0 - s) * (1.0 - t)), (b, s * (1.0 - t)), (c, s * t), (d, (1.0 - s) * t)]
            }
        }
    }

    /// The point over `b`, at the share `w` of the height vectors.
    fn at(&self, b: [f64; 2], w: f64) -> Sample {
        let corners = self.corners(b);
        let mix = |of: fn(&Corner) -> DVec3| corners.iter().map(|(c, share)| *share * of(c)).sum::<DVec3>();
        let number = |of: fn(&Corner) -> f64| corners.iter().map(|(c, share)| share * of(c)).sum::<f64>();
        let said = &self.layer.layer;
        let (scale, offset) = (DVec3::from_array(said.scale), DVec3::from_array(said.offset));
        let rise = w * number(|c| c.dw);
        let x = mix(|c| c.p) + w * mix(|c| c.h);
        let plain = (mix(|c| c.q) + rise * DVec3::Z) * scale + offset;
        let Some(jitter) = &self.layer.jitter else { return Sample { x, q: plain, height: w } };
        let mask = number(|c| c.jitter).clamp(0.0, 1.0);
        let (q, height) = jitter.bend(&ShellPoint { q: plain, rise: rise * scale.z, height: w, mask });
        Sample { x, q, height: height * stretch(said.continuous.as_ref()) }
    }

    /// Whether texel coordinates are an affine function of the world.
    fn is_affine(&self) -> bool {
        let Face::Triangle([a, b, c]) = self.face else { return false };
        self.layer.jitter.is_none() && a.h == b.h && a.h == c.h && a.dw == b.dw && a.dw == c.dw
    }

    /// Whether both parameters of the face run over all of [0, 1], and not over half of their square.
    fn is_square(&self) -> bool {
        matches!(self.face, Face::Patch(_))
    }

    /// The regions, which stray by no more than `tolerance` cells from the shell's own map. Those without a volume are left out.
    pub fn regions(&self, tolerance: f64, each: &mut dyn FnMut(&Region)) {
        if self.is_affine() {
            let at =
                [self.at([0.0; 2], 0.0), self.at([1.0, 0.0], 0.0), self.at([0.0, 1.0], 0.0), self.at([0.0; 2], 1.0)];
            if let Some(region) = prism(&at) {
                each(&region);
            }
            return;
        }
        let [across, up] = self.cuts(tolerance);
        let grid = Grid::new(self, across, up);
        grid.tetrahedra(&mut |at| {
            if let Some(region) = tetrahedron(&at) {
                each(&region);
            }
        });
    }

    /// Into how many parts edges and heights are cut.
    fn cuts(&self, tolerance: f64) -> [usize; 2] {
        let mut cuts = [1; 2];
        loop {
            let [flat, high, both] = self.bends(cuts);
            let room = [0, 1].map(|k| cuts[k] < MOST_CUTS[k]);
            let mut more = [flat > tolerance && room[0], high > tolerance && room[1]];
            if more == [false; 2] && both > tolerance {
                // A twist, which either mends by half: the coarser of both is cut.
                let up = room[1] && (cuts[1] < cuts[0] || !room[0]);
                more = [!up && room[0], up];
            }
            if more == [false; 2] {
                return cuts;
            }
            (0..2).filter(|k| more[*k]).for_each(|k| cuts[k] *= 2);
        }
    }

    /// How far, in cells, the middles of the grid's edges across, upward, and of its diagonals are from where their ends put
    /// them. Looked for at some of them.
    fn bends(&self, [across, up]: [usize; 2]) -> [f64; 3] {
        const LOOKS: usize = 3;
        let (n, m) = (across as f64, up as f64);
        let bend = |b: [f64; 2], w: f64, db: [f64; 2], dw: f64| {
            let at = |share: f64| self.at([b[0] + share * db[0], b[1] + share * db[1]], w + share * dw);
            let (a, c, middle) = (at(0.0), at(1.0), at(0.5));
            // What strays in the world is measured in cells by what a step of the edge is of both.
            let size = (a.q.distance(c.q) / a.x.distance(c.x).max(f64::MIN_POSITIVE)).min(1e12);
            middle.q.distance(0.5 * (a.q + c.q)).max(size * middle.x.distance(0.5 * (a.x + c.x)))
        };
        let (mut flat, mut high, mut both) = (0.0f64, 0.0f64, 0.0f64);
        let step = |v: usize, parts: f64| ((v as f64 / LOOKS as f64) * (parts - 1.0)).round() / parts;
        let whole = self.is_square();
        let last = |i: usize| if whole { LOOKS } else { LOOKS - i };
        let looks = (0..=LOOKS).flat_map(|i| (0..=last(i)).flat_map(move |j| (0..=LOOKS).map(move |k| [i, j, k])));
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
struct Grid {
    across: usize,
    up: usize,
    square: bool,
    samples: Vec<Sample>,
}

impl Grid {
    fn new(face: &Prism<'_>, across: usize, up: usize) -> Grid {
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
        Grid { across, up, square, samples }
    }

    fn index(&self, i: usize, j: usize, k: usize) -> usize {
        let n = self.across + 1;
        if self.square {
            return (k * n + i) * n + j;
        }
        // Rows get shorter by one each.
        k * (n * (n + 1) / 2) + i * n - i * i.saturating_sub(1) / 2 + j
    }

    /// Each small prism as three tetrahedra, cut so that neighbours within the face share their faces.
    fn tetrahedra(&self, each: &mut dyn FnMut([Sample; 4])) {
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

    fn small_prism(&self, foot: [[usize; 2]; 3], k: usize, each: &mut dyn FnMut([Sample; 4])) {
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

/// The rows by which texel coordinates become weights of the edges from the first corner, and the map to the world; `None`
/// where there is no volume.
fn affine(at: &[Sample; 4]) -> Option<(DMat3, DAffine3)> {
    let edges = |of: fn(&Sample) -> DVec3| {
        DMat3::from_cols(of(&at[1]) - of(&at[0]), of(&at[2]) - of(&at[0]), of(&at[3]) - of(&at[0]))
    };
    let (q, x) = (edges(|s| s.q), edges(|s| s.x));
    // A region that is 1e-12 of its size thick is none.
    let size = q.x_axis.length() * q.y_axis.length() * q.z_axis.length();
    if q.determinant().abs().partial_cmp(&(1e-12 * size)) != Some(std::cmp::Ordering::Greater) {
        return None;
    }
    let inverse = q.inverse();
    let matrix3 = x * inverse;
    let to_world = DAffine3 { matrix3, translation: at[0].x - matrix3 * at[0].q };
    (to_world.is_finite() && matrix3.determinant() != 0.0).then_some((inverse.transpose(), to_world))
}

/// 0 ≤ n · (q − q0), as a half-space; `outer`: nothing lies beyond.
fn above(n: DVec3, q0: DVec3, outer: bool) -> HalfSpace {
    let space = HalfSpace::shared(-n, -n.dot(q0));
    HalfSpace { closed: space.closed || outer, ..space }
}

/// n · (q − q0) ≤ 1.
fn below(n: DVec3, q0: DVec3, outer: bool) -> HalfSpace {
    let space = HalfSpace::shared(n, 1.0 + n.dot(q0));
    HalfSpace { closed: space.closed || outer, ..space }
}

/// A face's whole prism: its base's corners, and the top over the first.
fn prism(at: &[Sample; 4]) -> Option<Region> {
    let (rows, to_world) = affine(at)?;
    let q0 = at[0].q;
    let (b1, b2, w) = (rows.x_axis, rows.y_axis, rows.z_axis);
    let spaces = vec![
        above(b1, q0, false),
        above(b2, q0, false),
        below(b1 + b2, q0, false),
        above(w, q0, true),
        below(w, q0, true),
    ];
    let rise = at[3].q - q0;
    let base = [at[0].q, at[1].q, at[2].q];
    let bounds = Aabb::around(base.into_iter().flat_map(|q| [q, q + rise]));
    Some(Region { spaces, bounds, to_world })
}

/// What of a tetrahedron lies below the shell's end. Facets in the shell's own base and top belong to it.
fn tetrahedron(at: &[Sample; 4]) -> Option<Region> {
    let (rows, to_world) = affine(at)?;
    if at.iter().all(|s| s.height >= 1.0) {
        return None;
    }
    let q0 = at[0].q;
    let lies = |skip: usize, height: f64| (0..4).filter(|k| *k != skip).all(|k| at[k].height == height);
    let mut spaces = vec![
        above(rows.x_axis, q0, lies(1, 0.0)),
        above(rows.y_axis, q0, lies(2, 0.0)),
        above(rows.z_axis, q0, lies(3, 0.0)),
        below(rows.x_axis + rows.y_axis + rows.z_axis, q0, lies(0, 0.0)),
    ];
    if at.iter().any(|s| s.height > 1.0) {
        let n = (1..4).map(|k| (at[k].height - at[0].height) * rows.col(k - 1)).sum::<DVec3>();
        spaces.push(HalfSpace { n, c: 1.0 - at[0].height + n.dot(q0), closed: true });
    }
    let bounds = Aabb::around(at.iter().map(|s| s.q));
    Some(Region { spaces, bounds, to_world })
}
