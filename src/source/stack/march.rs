//! The iso-surface of a block of the lattice as loops of corners in its cells.

use super::lattice::{Lattice, Scratch};
use crate::geom::DVec3;
use crate::source::loops::{EDGES, LoopTable};

/// A block of nodes whose values are in a [`Scratch`].
pub struct LatticeBlock<'a> {
    pub lattice: &'a Lattice,
    /// Lowest node, and nodes along each axis.
    pub from: [usize; 3],
    pub size: [usize; 3],
    pub iso: f32,
}

impl LatticeBlock<'_> {
    /// Give the corners of every loop, index space, counter-clockwise from outside as long as index space is right-handed.
    pub fn loops(&self, scratch: &Scratch, each: &mut dyn FnMut(&[DVec3])) {
        let (values, loops) = (&scratch.values, LoopTable::get());
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
