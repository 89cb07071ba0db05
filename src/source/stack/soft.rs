//! Semi-transparent matter of a stack: the extinction of every voxel, and the direction in which it falls off.

use super::lattice::{Lattice, Scratch};
use super::samples::Samples;
use super::transfer::{OPAQUE, TransferSpec};
use crate::geom::{Aabb, DAffine3, DVec3};
use crate::source::Medium;

/// Largest number of nodes of a block that is filtered at once. For larger blocks each point is filtered by itself.
const MAX_NODES: usize = 1 << 21;
/// Largest number of points per voxel edge at which values are looked up.
const MAX_POINTS: usize = 8;
/// Change of the opacity per distance of samples from which on matter counts as fully one-sided, like a surface.
const FACE_SLOPE: f64 = 0.25;

/// Filtered values of the stack: interpolated linearly between the nodes of a block, or filtered from the samples for each point.
pub struct Field<'a> {
    lattice: &'a Lattice,
    samples: &'a Samples,
    /// Lowest node of the block and its number of nodes per axis; `None` where each point is filtered by itself.
    block: Option<([usize; 3], [usize; 3])>,
    scratch: &'a Scratch,
}

impl<'a> Field<'a> {
    /// Values for points in `window` (index space) and up to half a distance of samples around it.
    pub fn new(lattice: &'a Lattice, samples: &'a Samples, window: Aabb, scratch: &'a mut Scratch) -> Field<'a> {
        let mut from = [0; 3];
        let mut size = [0; 3];
        for (a, axis) in lattice.axes.iter().enumerate() {
            // Not the outermost nodes: what is outside has no value.
            let inner = &axis.nodes[1..axis.nodes.len() - 1];
            let first = inner.partition_point(|&x| x <= window.min[a] - 0.5).saturating_sub(1);
            let end = (inner.partition_point(|&x| x < window.max[a] + 0.5) + 1).min(inner.len());
            from[a] = 1 + first.min(inner.len() - 1);
            size[a] = end.saturating_sub(first).max(1);
        }
        let block = (size.iter().product::<usize>() <= MAX_NODES).then_some((from, size));
        if block.is_some() {
            lattice.fill(samples, from, size, 0.0, scratch);
        }
        Field { lattice, samples, block, scratch }
    }

    /// Whether the sample whose cell an index-space point is in has no value.
    fn is_missing(&self, p: DVec3) -> bool {
        let dims = self.samples.dims();
        self.samples.is_missing(std::array::from_fn(|a| (p[a] + 0.5).clamp(0.0, (dims[a] - 1) as f64) as usize))
    }

    /// The value at an index-space point, which is moved to the border where it is outside.
    fn value(&self, p: DVec3) -> f64 {
        let dims = self.samples.dims();
        let at: [f64; 3] = std::array::from_fn(|a| p[a].clamp(-0.5, dims[a] as f64 - 0.5));
        let Some((from, size)) = self.block else {
            return self.lattice.value(self.samples, at).map_or(0.0, f64::from);
        };
        let mut cell = [0; 3];
        let mut t = [0.0; 3];
        for a in 0..3 {
            let nodes = &self.lattice.axes[a].nodes[from[a]..from[a] + size[a]];
            let n = nodes.partition_point(|&x| x <= at[a]).saturating_sub(1).min(size[a].saturating_sub(2));
            cell[a] = n;
            let (lo, hi) = (nodes[n], nodes.get(n + 1).copied().unwrap_or(nodes[n]));
            t[a] = if hi > lo { ((at[a] - lo) / (hi - lo)).clamp(0.0, 1.0) } else { 0.0 };
        }
        let mut sum = 0.0;
        for c in 0..8 {
            let mut weight = 1.0;
            let mut index = [0; 3];
            for a in 0..3 {
                let upper = c >> a & 1;
                weight *= if upper == 1 { t[a] } else { 1.0 - t[a] };
                index[a] = (cell[a] + upper).min(size[a] - 1);
            }
            if weight > 0.0 {
                sum += weight * f64::from(self.scratch.values[(index[2] * size[1] + index[1]) * size[0] + index[0]]);
            }
        }
        sum
    }
}

/// Soft matter of the voxels of one image of the stack.
pub struct MediumSampler<'a> {
    pub transfer: &'a TransferSpec,
    /// Smallest value that is solid, and not soft.
    pub solid_from: f64,
    pub to_index: DAffine3,
    /// Distance of samples in voxels, the geometric mean of the three.
    pub distance: f64,
    /// Smallest extinction that is kept, in hits per voxel edge.
    pub least: f64,
    /// Box of the stack, index space.
    pub index_bounds: Aabb,
    /// Whether the cells of samples without a value are left out.
    pub masked: bool,
}

impl MediumSampler<'_> {
    /// Number of points per voxel edge at which values are looked up: one for every sample.
    pub fn points(&self) -> usize {
        let m = self.to_index.matrix3;
        let most = [m.x_axis, m.y_axis, m.z_axis].iter().map(|c| c.length()).fold(0.0, f64::max);
        (most.ceil() as usize).clamp(1, MAX_POINTS)
    }

    /// The medium of the voxel `at`, with its colour by value; none where there is nothing.
    pub fn voxel(&self, field: &Field, at: [u32; 3], own: &dyn Fn(DVec3) -> Option<[f32; 3]>) -> Option<Medium> {
        let corner = DVec3::from(at.map(f64::from));
        let centre = self.to_index.transform_point3(corner + 0.5);
        // More points at the border of the stack, where a voxel may lie partly outside.
        let reach = 0.5 * (self.to_index.matrix3.abs() * DVec3::ONE);
        let inside =
            (centre - reach).cmpge(self.index_bounds.min).all() && (centre + reach).cmple(self.index_bounds.max).all();
        let n = if inside { self.points() } else { self.points().max(4) };
        let step = 1.0 / n as f64;
        let (mut sum, mut colour, mut slope) = (0.0, DVec3::ZERO, DVec3::ZERO);
        for i in 0..n * n * n {
            let offset = (DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64) + 0.5) * step;
            let p = self.to_index.transform_point3(corner + offset);
            if !(p.cmpge(self.index_bounds.min).all() && p.cmple(self.index_bounds.max).all()) {
                continue;
            }
            if self.masked && field.is_missing(p) {
                continue;
            }
            let value = field.value(p);
            if value >= self.solid_from {
                continue;
            }
            let mut opacity = self.transfer.by_value(value);
            if opacity <= 0.0 {
                continue;
            }
            let mut change = DVec3::ZERO;
            let mut fall = DVec3::ZERO;
            for a in 0..3 {
                let (up, down) = (field.value(p + 0.5 * DVec3::AXES[a]), field.value(p - 0.5 * DVec3::AXES[a]));
                change[a] = up - down;
                fall[a] = self.transfer.by_value(down) - self.transfer.by_value(up);
            }
            // Covectors: from index space to the grid's axes.
            let turn = self.to_index.matrix3.transpose();
            opacity *= self.transfer.by_gradient((turn * change).length() * self.distance);
            let density = -libm::log1p(-opacity.min(OPAQUE)) / self.distance;
            sum += density;
            slope += density * (turn * fall) * self.distance;
            let rgb = own(p).unwrap_or_else(|| self.transfer.colour(value));
            colour += density * DVec3::from(rgb.map(f64::from));
        }
        let extinction = sum * step * step * step;
        if extinction < self.least {
            return None;
        }
        // The slope gives the normal for shading alone: opacity is the same in all directions, as transfer functions define it.
        let slope = slope / sum;
        Some(Medium {
            normal: slope.normalize_or_zero(),
            facing: (slope.length() / FACE_SLOPE).min(1.0),
            ..Medium::even(at, 0, extinction, (colour / sum).as_vec3().to_array())
        })
    }
}
