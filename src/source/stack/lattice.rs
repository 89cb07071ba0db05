//! The filtered values of a stack at the nodes of a lattice that is at least as fine as the voxels, a block of nodes at a time.
//!
//! Based on: S. Marschner, R. Lobb, *An Evaluation of Reconstruction Filters for Volume Rendering*, VIS 1994.
//!
//! Beyond its outermost samples a stack continues with their values for half the distance of samples. There it ends.

use super::ranges::BRICK;
use super::samples::Samples;
use crate::geom::DAffine3;
use crate::simd::multiversioned;

/// Smallest standard deviation, in distances of samples, at which a Gaussian filter alone interpolates smoothly. Narrower ones are
/// combined with linear interpolation.
const MIN_SMOOTH_SIGMA: f64 = 0.5;
/// Radius at which a Gaussian ends, in standard deviations.
const FILTER_RADIUS: f64 = 3.0;

/// Nodes along one axis, and the filters by which their values are computed from the samples.
pub struct Axis {
    /// Positions in index space, ascending. The first and the last node are outside of the stack, at the same positions as the second
    /// and the last but one.
    pub nodes: Vec<f64>,
    /// Index of the first sample of each node's filter. Indices outside of the stack stand for the samples at the border.
    first: Vec<i64>,
    /// Weights of the filters, `width` per node.
    weights: Vec<f32>,
    width: usize,
    samples: usize,
    /// First cell of each brick, and one past the last cell.
    bricks: Vec<usize>,
}

/// Smallest distance of two nodes, in distances of samples.
const MIN_NODE_DISTANCE: f64 = 1e-6;
/// Largest width of a cell, in distances of samples.
const MAX_CELL_WIDTH: f64 = 1.25;
/// Largest number of nodes along an axis of a lattice that is aligned with the voxels.
const MAX_NODES_ALONG: f64 = 1e6;

/// Number of samples around a brick on which its values depend: those of the filter, of a cell that begins in the brick, and of the
/// next cell.
pub fn margin(sigma: f64) -> usize {
    reach(sigma) + 2
}

/// Radius of a filter of standard deviation `sigma`, in samples.
pub fn reach(sigma: f64) -> usize {
    (FILTER_RADIUS * sigma).ceil() as usize
}

/// Weights of the samples from `first` on for the value at `x`, which sum to 1; `first` is floor(x) − reach.
fn weights(x: f64, sigma: f64, out: &mut [f32]) {
    let r = reach(sigma) as f64;
    let t = x - x.floor();
    let gauss =
        |d: f64| if sigma > 0.0 { libm::exp(-0.5 * (d / sigma) * (d / sigma)) } else { f64::from(u8::from(d == 0.0)) };
    let mut raw = [0.0f64; 64];
    let raw = &mut raw[..out.len().min(64)];
    if sigma >= MIN_SMOOTH_SIGMA {
        raw.iter_mut().enumerate().for_each(|(n, w)| *w = gauss(n as f64 - r - t));
    } else {
        // Filtered samples, linearly between.
        for (n, w) in raw.iter_mut().enumerate() {
            let d = n as f64 - r;
            let near = |d: f64| if d.abs() <= r { gauss(d) } else { 0.0 };
            *w = (1.0 - t) * near(d) + t * near(d - 1.0);
        }
    }
    let sum: f64 = raw.iter().sum();
    for (w, v) in out.iter_mut().zip(raw.iter()) {
        *w = (v / sum) as f32;
    }
}

/// Largest standard deviation of a filter.
pub const MAX_SIGMA: f64 = 10.0;

impl Axis {
    /// Axis with this number of `samples` and nodes at the positions `inner`, which ascend. Positions outside of the stack are left out.
    pub fn new(samples: usize, inner: impl IntoIterator<Item = f64>, sigma: f64) -> Axis {
        let last = (samples - 1) as f64;
        let end = last + 0.5;
        let mut nodes = vec![-0.5, -0.5];
        nodes.extend(inner.into_iter().filter(|x| (MIN_NODE_DISTANCE - 0.5..end - MIN_NODE_DISTANCE).contains(x)));
        nodes.extend([end, end]);
        // A cell belongs to the brick in which it begins.
        let begin = |u: usize| if u == 0 { 0 } else { nodes.partition_point(|&x| x < (u * BRICK) as f64) };
        let mut bricks: Vec<usize> = (0..samples.div_ceil(BRICK)).map(begin).collect();
        bricks.push(nodes.len() - 1);
        let r = reach(sigma) as i64;
        let width = 2 * r as usize + 2;
        let mut weight = vec![0.0; width * nodes.len()];
        let mut first = Vec::with_capacity(nodes.len());
        for (x, out) in nodes.iter().zip(weight.chunks_mut(width)) {
            let x = x.clamp(0.0, last);
            weights(x, sigma, out);
            first.push(x.floor() as i64 - r);
        }
        Axis { nodes, first, weights: weight, width, samples, bricks }
    }

    /// Cells of the brick `n` that overlap `from .. to`, index space.
    pub fn cells(&self, n: usize, from: f64, to: f64) -> std::ops::Range<usize> {
        let (start, end) = (self.bricks[n], self.bricks[n + 1]);
        let ends = &self.nodes[start + 1..=end];
        let begins = &self.nodes[start..end];
        start + ends.partition_point(|&x| x < from)..start + begins.partition_point(|&x| x <= to)
    }

    /// Bricks whose cells overlap `from .. to`, index space.
    pub fn bricks(&self, from: f64, to: f64) -> std::ops::RangeInclusive<usize> {
        let last = self.bricks.len() - 2;
        let brick = |x: f64| ((x / BRICK as f64).max(0.0) as usize).min(last);
        brick(from - MAX_CELL_WIDTH)..=brick(to)
    }

    fn clamp(&self, virtual_index: i64) -> usize {
        virtual_index.clamp(0, self.samples as i64 - 1) as usize
    }
}

/// Lattice of nodes over the whole stack.
pub struct Lattice {
    pub axes: [Axis; 3],
    sigma: f64,
}

/// Buffers for the values of a block of nodes while it is filtered.
#[derive(Default)]
pub struct Scratch {
    raw: Vec<f32>,
    along_x: Vec<f32>,
    along_y: Vec<f32>,
    /// Values at the nodes, x fastest.
    pub values: Vec<f32>,
}

impl Lattice {
    /// Lattice with `parts` cells between neighbouring samples along each axis.
    pub fn new(dims: [usize; 3], parts: [usize; 3], sigma: f64) -> Lattice {
        let inner = |a: usize| (0..=(dims[a] - 1) * parts[a]).map(move |i| i as f64 / parts[a] as f64);
        Lattice { axes: std::array::from_fn(|a| Axis::new(dims[a], inner(a), sigma)), sigma }
    }

    /// Lattice whose nodes are where the planes between voxels cross the stack, so that no facet has to be cut. `None` where there is no
    /// such lattice: where `to_grid` turns the stack by other than quarter turns, or its samples are closer than voxels.
    pub fn aligned(dims: [usize; 3], to_grid: &DAffine3, sigma: f64) -> Option<Lattice> {
        let axis = |a: usize| {
            let column = to_grid.matrix3.col(a);
            let along = (0..3).find(|&g| column[g].abs() > (1.0 - 1e-12) * column.length())?;
            let (step, origin) = (column[along], to_grid.translation[along]);
            let ends = [-0.5, dims[a] as f64 - 0.5].map(|x| origin + step * x);
            let (lo, hi) = (ends[0].min(ends[1]).ceil(), ends[0].max(ends[1]).floor());
            if step.abs() < 1.0 / MAX_CELL_WIDTH || hi - lo > MAX_NODES_ALONG {
                return None;
            }
            let count = (hi - lo + 1.0).max(0.0) as usize;
            let plane = |n: usize| if step > 0.0 { lo + n as f64 } else { hi - n as f64 };
            Some(Axis::new(dims[a], (0..count).map(|n| (plane(n) - origin) / step), sigma))
        };
        Some(Lattice { axes: [axis(0)?, axis(1)?, axis(2)?], sigma })
    }

    /// Compute the values at the nodes `from .. from + size` into `scratch.values`. Nodes outside of the stack get the value `outside`.
    pub fn fill(&self, samples: &Samples, from: [usize; 3], size: [usize; 3], outside: f32, scratch: &mut Scratch) {
        let [ax, ay, az] = &self.axes;
        let span =
            |a: &Axis, n: usize, size: usize| (a.first[n], (a.first[n + size - 1] - a.first[n]) as usize + a.width);
        let (x0, nx) = span(ax, from[0], size[0]);
        let (y0, ny) = span(ay, from[1], size[1]);
        let (z0, nz) = span(az, from[2], size[2]);
        // All of it will be overwritten.
        let Scratch { raw, along_x, along_y, values } = scratch;
        raw.resize(nx, 0.0);
        along_x.resize(size[0] * ny * nz, 0.0);
        let (lo, hi) = (ax.clamp(x0), ax.clamp(x0 + nx as i64 - 1));
        let left = (lo as i64 - x0) as usize;
        let mut before = None;
        for z in 0..nz {
            let k = az.clamp(z0 + z as i64);
            for y in 0..ny {
                let j = ay.clamp(y0 + y as i64);
                let at = (z * ny + y) * size[0];
                if before == Some((j, k)) {
                    // The same row again, at the border.
                    along_x.copy_within(at - size[0]..at, at);
                    continue;
                }
                before = Some((j, k));
                samples.row(lo, j, k, &mut raw[left..=left + hi - lo]);
                let (first, last) = (raw[left], raw[left + hi - lo]);
                raw[..left].fill(first);
                raw[left + hi - lo + 1..].fill(last);
                for (n, out) in along_x[at..at + size[0]].iter_mut().enumerate() {
                    let node = from[0] + n;
                    let start = (ax.first[node] - x0) as usize;
                    let weights = &ax.weights[node * ax.width..][..ax.width];
                    *out = raw[start..].iter().zip(weights).map(|(v, w)| v * w).sum();
                }
            }
        }
        along_y.resize(size[0] * size[1] * nz, 0.0);
        for z in 0..nz {
            for n in 0..size[1] {
                let node = from[1] + n;
                let start = (ay.first[node] - y0) as usize;
                let out = &mut along_y[(z * size[1] + n) * size[0]..][..size[0]];
                weigh(out, &along_x[(z * ny + start) * size[0]..], size[0], &ay.weights[node * ay.width..][..ay.width]);
            }
        }
        let layer = size[0] * size[1];
        values.resize(layer * size[2], 0.0);
        for n in 0..size[2] {
            let node = from[2] + n;
            let start = (az.first[node] - z0) as usize;
            let out = &mut values[n * layer..][..layer];
            weigh(out, &along_y[start * layer..], layer, &az.weights[node * az.width..][..az.width]);
        }
        self.close(from, size, outside, values);
    }

    /// Set the values of the outermost nodes of the lattice to `outside`.
    fn close(&self, from: [usize; 3], size: [usize; 3], outside: f32, values: &mut [f32]) {
        let outer = |a: usize, n: usize| from[a] + n == 0 || from[a] + n + 1 == self.axes[a].nodes.len();
        if (0..3).all(|a| from[a] > 0 && from[a] + size[a] < self.axes[a].nodes.len()) {
            return;
        }
        for z in 0..size[2] {
            for y in 0..size[1] {
                for x in 0..size[0] {
                    if outer(0, x) || outer(1, y) || outer(2, z) {
                        values[(z * size[1] + y) * size[0] + x] = outside;
                    }
                }
            }
        }
    }

    /// The filtered value at an index-space point; `None` outside.
    pub fn value(&self, samples: &Samples, at: [f64; 3]) -> Option<f32> {
        let mut weight = [[0.0f32; 64]; 3];
        let mut first = [0i64; 3];
        let r = reach(self.sigma);
        let width = (2 * r + 2).min(64);
        for a in 0..3 {
            let last = (self.axes[a].samples - 1) as f64;
            if !(at[a] >= -0.5 && at[a] <= last + 0.5) {
                return None;
            }
            let x = at[a].clamp(0.0, last);
            weights(x, self.sigma, &mut weight[a][..width]);
            first[a] = x.floor() as i64 - r as i64;
        }
        let mut sum = 0.0;
        // The samples of a row at once: those beyond its ends are the last ones there.
        let mut row = [0.0f32; 64];
        let ends = [0, width - 1].map(|x| self.axes[0].clamp(first[0] + x as i64));
        for (z, wz) in weight[2][..width].iter().enumerate().filter(|w| *w.1 > 0.0) {
            for (y, wy) in weight[1][..width].iter().enumerate().filter(|w| *w.1 > 0.0) {
                let index = |a: usize, n: usize| self.axes[a].clamp(first[a] + n as i64);
                samples.row(ends[0], index(1, y), index(2, z), &mut row[..=ends[1] - ends[0]]);
                for (x, wx) in weight[0][..width].iter().enumerate().filter(|w| *w.1 > 0.0) {
                    sum += wx * wy * wz * row[index(0, x) - ends[0]];
                }
            }
        }
        Some(sum)
    }
}

multiversioned! {
    fn weigh(out: &mut [f32], rows: &[f32], stride: usize, weights: &[f32]) = weighted_sum;
}

/// `out` = the weighted sum of rows of `stride` numbers.
#[inline(always)]
fn weighted_sum(out: &mut [f32], rows: &[f32], stride: usize, weights: &[f32]) {
    out.fill(0.0);
    for (n, w) in weights.iter().enumerate().filter(|w| *w.1 != 0.0) {
        for (o, v) in out.iter_mut().zip(&rows[n * stride..]) {
            *o += w * v;
        }
    }
}
