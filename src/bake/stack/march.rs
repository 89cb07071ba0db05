//! The iso-surface of a block of the lattice as facets, a loop a cell.

use super::cells::{EDGES, Loops};
use super::lattice::{Lattice, Scratch};
use crate::bake::clip::{MAX_CORNERS, Polygon};
use crate::geom::DVec3;

/// How far from one plane the corners of a facet may be, in voxels.
const PLANAR: f64 = 0.02;

/// A block of nodes whose values are in a [`Scratch`].
pub struct Block<'a> {
    pub lattice: &'a Lattice,
    /// Lowest node, and nodes along each axis.
    pub from: [usize; 3],
    pub size: [usize; 3],
    pub iso: f32,
}

impl Block<'_> {
    /// Give the corners of every loop, index space, counter-clockwise from outside as long as index space is right-handed.
    pub fn loops(&self, loops: &Loops, scratch: &Scratch, each: &mut dyn FnMut(&[DVec3])) {
        let values = &scratch.values;
        let [nx, ny, nz] = self.size;
        let strides = [1, nx, nx * ny];
        let offset = |c: u8| (c & 1) as usize + (c >> 1 & 1) as usize * nx + (c >> 2) as usize * nx * ny;
        let offsets: [usize; 8] = std::array::from_fn(|c| offset(c as u8));
        let mut corners = [DVec3::ZERO; 12];
        for z in 0..nz - 1 {
            for y in 0..ny - 1 {
                let row = z * strides[2] + y * strides[1];
                // Columns of four corners, from one cell to the next.
                let column = |x: usize| {
                    let at = |n: usize| u8::from(values[row + x + n] >= self.iso);
                    at(0) | at(nx) << 2 | at(nx * ny) << 4 | at(nx + nx * ny) << 6
                };
                let mut left = column(0);
                for x in 0..nx - 1 {
                    let right = column(x + 1);
                    let within = left | right << 1;
                    left = right;
                    if within == 0 || within == 255 {
                        continue;
                    }
                    let at = |c: u8| values[row + x + offsets[usize::from(c)]];
                    let node = |axis: usize, n: usize| self.lattice.axes[axis].nodes[self.from[axis] + n];
                    for l in loops.of(within) {
                        for (p, &e) in corners.iter_mut().zip(l) {
                            let [a, b] = EDGES[usize::from(e)];
                            let axis = (b ^ a).trailing_zeros() as usize;
                            let (va, vb) = (f64::from(at(a)), f64::from(at(b)));
                            let t = (f64::from(self.iso) - va) / (vb - va);
                            let cell = [x + usize::from(a & 1), y + usize::from(a >> 1 & 1), z + usize::from(a >> 2)];
                            *p = DVec3::new(node(0, cell[0]), node(1, cell[1]), node(2, cell[2]));
                            let next = node(axis, cell[axis] + 1);
                            p[axis] += t * (next - p[axis]);
                        }
                        each(&corners[..l.len().min(corners.len())]);
                    }
                }
            }
        }
    }
}

/// A loop, mapped by `to_grid`, as planar convex facets; `mirrored` where the map is.
pub fn facets(corners: &[DVec3], to_grid: impl Fn(DVec3) -> DVec3, mirrored: bool, each: &mut dyn FnMut(&Polygon)) {
    let mut points = [DVec3::ZERO; 12];
    let n = corners.len().min(points.len());
    for (i, c) in corners.iter().take(n).enumerate() {
        points[if mirrored { n - 1 - i } else { i }] = to_grid(*c);
    }
    let points = &points[..n];
    if n > 3 && n <= MAX_CORNERS && is_plane(points) {
        return each(&Polygon::new(points, 0));
    }
    // From the corner whose fan bends least: of a quad, along the shorter diagonal.
    let start = if n == 4 && (points[1] - points[3]).length_squared() < (points[0] - points[2]).length_squared() {
        1
    } else {
        0
    };
    for i in 1..n.saturating_sub(1) {
        each(&Polygon::new(&[points[start], points[(start + i) % n], points[(start + i + 1) % n]], 0));
    }
}

/// Whether the corners are nearly in a plane and turn one way.
fn is_plane(points: &[DVec3]) -> bool {
    let n = points.len();
    let middle = points.iter().sum::<DVec3>() / n as f64;
    let area: DVec3 = (0..n).map(|i| (points[i] - middle).cross(points[(i + 1) % n] - middle)).sum();
    let Some(normal) = area.try_normalize() else { return false };
    (0..n).all(|i| {
        let (p, q, r) = (points[i], points[(i + 1) % n], points[(i + 2) % n]);
        normal.dot(p - middle).abs() <= PLANAR && (q - p).cross(r - q).dot(normal) >= 0.0
    })
}
