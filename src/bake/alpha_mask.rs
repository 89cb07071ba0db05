//! Which parts of a facet's piece its alpha leaves opaque, as a mask of at most 8 × 8 cells.
//!
//! Based on: T. Porter, T. Duff, *Compositing Digital Images*, SIGGRAPH 1984 (alpha as the share that is covered); the
//! additive recurrence of M. Roberts, *The Unreasonable Effectiveness of Quasirandom Sequences*, 2018 (dither).

use crate::geom::DVec3;
use crate::geom::polygon::Polygon;
use crate::geom::projection::LINES;
use crate::source::{AlphaSampler, Staged};

/// Most cells along an edge: half as many as there are lattice lines. Alpha that is finer is averaged and dithered; as many
/// cells as lines made opacity no more exact.
pub const MAX_ALPHA_CELLS: usize = LINES / 2;
/// Fewest cells along an edge.
const MIN_CELLS: usize = 4;
/// Cells per texel of the alpha, where the limits allow.
const CELLS_PER_TEXEL: f64 = 2.0;
/// Number of opaque cells whose colour is looked up.
const COLOUR_SAMPLES: usize = 4;
/// Steps of the dither's threshold from column to column and from row to row: the recurrence of the plastic number, whose terms are
/// even in the plane, and its mirror images. Any two of them are even together, too: where one is below a share, so is the other in
/// that share of the cells. Two facets in one place with the same steps would hide each other by anything between none and all.
const DITHERS: [[f64; 2]; 4] = [
    [0.754_877_666, 0.569_840_291],
    [0.569_840_291, 0.754_877_666],
    [0.754_877_666, 0.430_159_709],
    [0.569_840_291, 0.245_122_334],
];

/// Part of a piece that alpha leaves: its opaque cells, and the share, colour and bounds of what is left.
pub struct AlphaMask {
    grid: CellGrid,
    /// Cells per voxel edge, along both axes of the grid.
    scale: [f64; 2],
    /// Opaque cells after dithering: row by row, `MAX_ALPHA_CELLS` bits each.
    cells: u64,
    /// Mean alpha of the piece, in (0, 1].
    pub coverage: f64,
    /// Mean linear colour of what is left.
    pub albedo: DVec3,
    /// Tight box of what is left, lower and upper corner.
    pub lo: DVec3,
    pub hi: DVec3,
}

/// Grid of cells over the box of a polygon's projection along the longest axis of its normal.
struct CellGrid {
    /// Axes of the grid: of its columns and of its rows.
    axes: [usize; 2],
    /// Axis along which the polygon is projected.
    drop: usize,
    /// Tight box of the polygon.
    lo: DVec3,
    hi: DVec3,
    /// Number of columns and of rows, and their widths.
    size: [usize; 2],
    step: [f64; 2],
    /// Plane of the polygon: its normal, with 1 along `drop`, and its offset.
    normal: DVec3,
    offset: f64,
}

impl CellGrid {
    fn new(polygon: &Polygon, normal: DVec3, texels_per_voxel: f64) -> CellGrid {
        let n = normal.abs();
        let drop = if n.x >= n.y && n.x >= n.z {
            0
        } else if n.y >= n.z {
            1
        } else {
            2
        };
        let axes = [(drop + 1) % 3, (drop + 2) % 3];
        let normal = normal / normal[drop];
        let (lo, hi) = polygon.bounds();
        // A cell on the polygon is longer than its projection.
        let slope = axes.map(|e| libm::sqrt(1.0 + normal[e] * normal[e]));
        let size = [0, 1].map(|i| {
            let want = (CELLS_PER_TEXEL * texels_per_voxel * slope[i] * (hi[axes[i]] - lo[axes[i]])).ceil();
            (want.min(MAX_ALPHA_CELLS as f64) as usize).max(MIN_CELLS)
        });
        let step = [0, 1].map(|i| (hi[axes[i]] - lo[axes[i]]) / size[i] as f64);
        CellGrid { axes, drop, lo, hi, size, step, normal, offset: normal.dot(polygon.corners()[0]) }
    }

    /// Point of the plane with the coordinates `x` and `y` along the grid's axes.
    fn point(&self, x: f64, y: f64) -> DVec3 {
        let [a, b] = self.axes;
        let mut p = DVec3::ZERO;
        (p[a], p[b], p[self.drop]) = (x, y, self.offset - self.normal[a] * x - self.normal[b] * y);
        p
    }

    /// Coordinate along axis `i` of the grid, `cell` cells from its first edge.
    fn coordinate(&self, i: usize, cell: f64) -> f64 {
        self.lo[self.axes[i]] + cell * self.step[i]
    }

    /// Width of a cell on the polygon: the root of its area.
    fn cell_width(&self) -> f64 {
        libm::sqrt(self.step[0] * self.step[1] * self.normal.length())
    }

    /// Box of the part of the polygon's plane over the cells `cells`, within the polygon's box.
    fn bounds(&self, cells: &CellRange) -> (DVec3, DVec3) {
        let corners = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(i, j)| {
            let along = |axis: usize, end: usize| self.coordinate(axis, [cells.first, cells.end][end][axis] as f64);
            self.point(along(0, i), along(1, j))
        });
        let (lo, hi) = corners.iter().fold((self.hi, self.lo), |(lo, hi), p| (lo.min(*p), hi.max(*p)));
        (lo.clamp(self.lo, self.hi), hi.clamp(self.lo, self.hi))
    }
}

/// Range of cells, column and row: the first ones, and one past the last.
struct CellRange {
    first: [usize; 2],
    end: [usize; 2],
}

/// Alpha of a polygon, sampled once in each cell of its grid.
struct AlphaSamples {
    /// Opaque cells after dithering: row by row, `MAX_ALPHA_CELLS` bits each.
    cells: u64,
    /// Samples within the polygon, and the sum of their alpha.
    inside: u32,
    sum: f64,
    /// Cells within the polygon where alpha is above 0.
    range: CellRange,
    /// Sample of the highest alpha within the polygon.
    densest: DVec3,
}

impl AlphaSamples {
    /// Sample `sampler` in the cells of `grid` over `polygon`, which lies in the voxel at `origin`.
    fn take(sampler: &dyn AlphaSampler, grid: &CellGrid, polygon: &Polygon, origin: DVec3) -> AlphaSamples {
        let [a, b] = grid.axes;
        let along = grid.point(grid.step[0], 0.0) - grid.point(0.0, 0.0);
        let width = grid.cell_width();
        let mut cells = 0;
        let (mut inside, mut sum) = (0u32, 0.0);
        let mut range = CellRange { first: [usize::MAX; 2], end: [0; 2] };
        let (mut densest, mut highest) = (polygon.corner_mean(), 0.0);
        let seed = hash(polygon.facet, origin);
        let [across, down] = DITHERS[polygon.facet as usize % DITHERS.len()];
        let mut row = [0.0f32; MAX_ALPHA_CELLS];
        for j in 0..grid.size[1] {
            let y = grid.coordinate(1, j as f64 + 0.5);
            let row = &mut row[..grid.size[0]];
            sampler.sample_row(origin + grid.point(grid.lo[a] + 0.5 * grid.step[0], y), along, width, row);
            let (from, to) = row_interval(polygon.corners(), a, b, y);
            for (i, &alpha) in row.iter().enumerate() {
                let alpha = f64::from(alpha).clamp(0.0, 1.0);
                let x = grid.coordinate(0, i as f64 + 0.5);
                let term = seed + across * i as f64 + down * j as f64;
                let threshold = term - f64::from(term as u32);
                cells |= u64::from(alpha > threshold) << (j * MAX_ALPHA_CELLS + i);
                if x >= from && x < to {
                    inside += 1;
                    sum += alpha;
                    if alpha > highest {
                        (densest, highest) = (grid.point(x, y), alpha);
                    }
                    if alpha > 0.0 {
                        range.first = [range.first[0].min(i), range.first[1].min(j)];
                        range.end = [range.end[0].max(i + 1), range.end[1].max(j + 1)];
                    }
                }
            }
        }
        if inside == 0 {
            // A sliver between the samples: one sample in its middle stands for it.
            let mut alpha = [0.0];
            sampler.sample_row(origin + densest, DVec3::ZERO, width, &mut alpha);
            (inside, sum) = (1, f64::from(alpha[0]).clamp(0.0, 1.0));
            range = CellRange { first: [0; 2], end: grid.size };
        }
        AlphaSamples { cells, inside, sum, range, densest }
    }
}

impl AlphaMask {
    /// Mask of `polygon` (voxel edges, in the voxel at `origin`) of the unit `normal`; `None` where all of it is transparent.
    pub fn new(
        staged: &dyn Staged,
        sampler: &dyn AlphaSampler,
        polygon: &Polygon,
        origin: DVec3,
        normal: DVec3,
    ) -> Option<AlphaMask> {
        let grid = CellGrid::new(polygon, normal, sampler.texels_per_voxel());
        let samples = AlphaSamples::take(sampler, &grid, polygon, origin);
        if samples.sum <= 0.0 {
            return None;
        }
        let width = grid.cell_width();
        let colour = |p: DVec3| DVec3::from(staged.surface(polygon.facet, origin + p, width).albedo.map(f64::from));
        let (lo, hi) = grid.bounds(&samples.range);
        let mut mask = AlphaMask {
            scale: grid.step.map(|s| if s > 0.0 { 1.0 / s } else { 0.0 }),
            grid,
            cells: samples.cells,
            coverage: samples.sum / f64::from(samples.inside),
            albedo: DVec3::ZERO,
            lo,
            hi,
        };
        mask.albedo = mask.mean_colour(polygon.corners(), samples.densest, colour);
        Some(mask)
    }

    /// Mean `colour` of up to [`COLOUR_SAMPLES`] opaque cells within the polygon, evenly spread over them; that of the point
    /// `fallback` where the dither leaves none.
    fn mean_colour(&self, corners: &[DVec3], fallback: DVec3, colour: impl Fn(DVec3) -> DVec3) -> DVec3 {
        let [a, b] = self.grid.axes;
        let middle = |i: usize, j: usize| {
            let along =
                |cell: usize, axis: usize| self.grid.lo[self.grid.axes[axis]] + (cell as f64 + 0.5) / self.scale[axis];
            [along(i, 0), along(j, 1)]
        };
        // Opaque cells within the polygon, row by row.
        let mut inner = [0u32; MAX_ALPHA_CELLS];
        let mut count = 0;
        for (j, inner) in inner.iter_mut().enumerate().take(self.grid.size[1]) {
            let bits = self.cells >> (j * MAX_ALPHA_CELLS);
            let (from, to) = row_interval(corners, a, b, middle(0, j)[1]);
            for i in (0..self.grid.size[0]).filter(|i| bits >> i & 1 != 0) {
                let x = middle(i, j)[0];
                *inner |= u32::from(x >= from && x < to) << i;
            }
            count += inner.count_ones() as usize;
        }
        if count == 0 {
            return colour(fallback);
        }
        // The n-th opaque cell, for n in the middles of equal parts of all of them.
        let mut wanted = (0..COLOUR_SAMPLES).map(|n| count * (2 * n + 1) / (2 * COLOUR_SAMPLES)).peekable();
        let mut sum = DVec3::ZERO;
        let mut before = 0;
        for (j, mut bits) in inner.into_iter().enumerate() {
            let end = before + bits.count_ones() as usize;
            while let Some(n) = wanted.next_if(|&n| n < end) {
                while before < n {
                    bits &= bits - 1;
                    before += 1;
                }
                let [x, y] = middle(bits.trailing_zeros() as usize, j);
                sum += colour(self.grid.point(x, y));
            }
            before = end;
        }
        sum / COLOUR_SAMPLES as f64
    }

    /// Position of the point `p` of the plane in the grid: in cells along both axes, not rounded.
    pub fn cell(&self, p: DVec3) -> [f64; 2] {
        let axes = self.grid.axes;
        [0, 1].map(|i| (p[axes[i]] - self.grid.lo[axes[i]]) * self.scale[i])
    }

    /// Step `p` in cells along both axes.
    pub fn cell_step(&self, p: DVec3) -> [f64; 2] {
        [0, 1].map(|i| p[self.grid.axes[i]] * self.scale[i])
    }

    /// Normal of the plane, with 1 along its longest axis, and the plane's offset.
    pub fn plane(&self) -> (DVec3, f64) {
        (self.grid.normal, self.grid.offset)
    }

    /// Bits, at `from..to`, of the lines of a row that meet an opaque cell; bits from `to` on are arbitrary. `cell` is where the
    /// line `from` meets the grid and `step` the way from one line to the next, both in 65536ths of a cell; lines beyond the
    /// grid meet its nearest cell.
    #[inline(always)]
    pub fn opaque_lines(&self, from: u32, to: u32, cell: [i32; 2], step: [i32; 2]) -> u32 {
        let last = self.grid.size.map(|s| s as i32 - 1);
        let (low, high) = (self.cells as u32, (self.cells >> 32) as u32);
        let (mut bits, mut first) = (0, 0);
        while first < to - from {
            let mut lanes = [0; 8];
            for n in 0..8u32 {
                let along = |axis: usize| {
                    let at = cell[axis].wrapping_add(((first + n) as i32).wrapping_mul(step[axis]));
                    (at >> 16).clamp(0, last[axis]) as u32
                };
                let at = MAX_ALPHA_CELLS as u32 * along(1) + along(0);
                lanes[n as usize] = (if at < 32 { low } else { high } >> (at & 31) & 1) << n;
            }
            bits |= lanes.iter().fold(0, |all, lane| all | lane) << first;
            first += 8;
        }
        bits << from
    }
}

/// Interval along axis `a` of the convex polygon's points with the coordinate `y` along axis `b`; empty where there are none.
fn row_interval(corners: &[DVec3], a: usize, b: usize, y: f64) -> (f64, f64) {
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

/// Fixed pseudo-random number in [0, 1) of a facet in the voxel at `origin`. It differs from voxel to voxel, so that the dithers of two
/// parallel facets are independent on average: with one number per facet, they would hide each other by the same wrong share
/// everywhere.
fn hash(facet: u32, origin: DVec3) -> f64 {
    let at = origin.as_ivec3();
    let mut h = facet.wrapping_mul(0x9e37_79b9);
    for (v, prime) in [(at.x, 0x85eb_ca6b_u32), (at.y, 0xc2b2_ae35), (at.z, 0x27d4_eb2f)] {
        h = (h ^ v as u32).wrapping_mul(prime);
        h ^= h >> 15;
    }
    h = (h ^ h >> 16).wrapping_mul(0x85eb_ca6b);
    h = (h ^ h >> 13).wrapping_mul(0xc2b2_ae35);
    f64::from(h ^ h >> 16) / 4_294_967_296.0
}

#[cfg(test)]
mod tests;
