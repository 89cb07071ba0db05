//! Objects of plain triangles that measurements are made on, each hard in its own way; all in the unit cube, for 64 voxels a side.

use crate::geom::DVec3;

/// Voxels a side that sizes are given in.
pub const VOXELS: u32 = 64;
const VOXEL: f64 = 1.0 / VOXELS as f64;

/// A named list of triangles.
pub struct Shape {
    pub name: &'static str,
    pub triangles: Vec<[DVec3; 3]>,
}

/// Numbers in [0, 1) that are the same in every run (G. Marsaglia, *Xorshift RNGs*, 2003).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn direction(&mut self) -> DVec3 {
        let (z, a) = (2.0 * self.unit() - 1.0, std::f64::consts::TAU * self.unit());
        let r = libm::sqrt(1.0 - z * z);
        DVec3::new(r * libm::cos(a), r * libm::sin(a), z)
    }

    fn point(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit())
    }
}

impl Shape {
    fn new(name: &'static str) -> Shape {
        Shape { name, triangles: Vec::new() }
    }

    /// The parallelogram about `c` with half-edges `a` and `b`.
    fn quad(&mut self, c: DVec3, a: DVec3, b: DVec3) {
        let p = [c - a - b, c + a - b, c + a + b, c - a + b];
        self.triangles.extend([[p[0], p[1], p[2]], [p[0], p[2], p[3]]]);
    }
}

/// Randomly turned square leaves of `size` voxels, `area` times the area of a face of the cube.
pub fn leaves(name: &'static str, size: f64, area: f64) -> Shape {
    let (mut shape, mut random) = (Shape::new(name), Random(88_172_645_463_325_252));
    let edge = size * VOXEL;
    for _ in 0..(area / (edge * edge)) as usize {
        let (a, b) = random.direction().any_orthonormal_pair();
        shape.quad(random.point(), a * edge / 2.0, b * edge / 2.0);
    }
    shape
}

/// One sheet that lies across the grid.
pub fn sheet() -> Shape {
    let mut shape = Shape::new("sheet");
    let (a, b) = DVec3::new(0.3, 1.0, 0.5).normalize().any_orthonormal_pair();
    shape.quad(DVec3::splat(0.5), a * 0.35, b * 0.35);
    shape
}

/// A ball: a closed surface, solid within.
pub fn ball() -> Shape {
    let mut shape = Shape::new("solid");
    let n = 48;
    let at = |i: usize, j: usize| {
        let (t, p) =
            (std::f64::consts::PI * i as f64 / n as f64, std::f64::consts::PI * (j % (2 * n)) as f64 / n as f64);
        // Poles are one point each, so that the ball closes.
        let r = if i == 0 || i == n { 0.0 } else { libm::sin(t) };
        DVec3::splat(0.5) + 0.5 * DVec3::new(r * libm::cos(p), libm::cos(t), r * libm::sin(p))
    };
    for i in 0..n {
        for j in 0..2 * n {
            shape.triangles.push([at(i, j), at(i, j + 1), at(i + 1, j + 1)]);
            shape.triangles.push([at(i, j), at(i + 1, j + 1), at(i + 1, j)]);
        }
    }
    shape
}

/// Slats, a voxel and a half apart, turned by half a right angle.
pub fn blinds() -> Shape {
    let mut shape = Shape::new("blinds");
    let pitch = 1.5 * VOXEL;
    for i in 1..(1.0 / pitch) as usize - 1 {
        let c = DVec3::new(0.5, (i as f64 + 0.5) * pitch, 0.5);
        shape.quad(c, DVec3::X * 0.45, DVec3::new(0.0, 1.0, 1.0) * 0.35 * pitch);
    }
    shape
}

/// Upright hairs, a fifth of a voxel thick, bent a little.
pub fn fur() -> Shape {
    let (mut shape, mut random) = (Shape::new("fur"), Random(19_650_218));
    for _ in 0..3000 {
        let foot = DVec3::new(random.unit(), 0.1, random.unit());
        let lean = DVec3::new(random.unit() - 0.5, 0.0, random.unit() - 0.5) * 0.2;
        let at = |s: f64| foot + DVec3::Y * 0.8 * s + lean * s * s;
        let on = |k: u32| {
            let a = f64::from(k) * std::f64::consts::FRAC_PI_3;
            DVec3::new(libm::cos(a), 0.0, libm::sin(a)) * 0.1 * VOXEL
        };
        for step in 0..3 {
            let (low, high) = (at(f64::from(step) / 3.0), at(f64::from(step + 1) / 3.0));
            for k in 0..6 {
                let (p, q) = (on(k), on(k + 1));
                shape.triangles.push([low + p, high + p, high + q]);
                shape.triangles.push([low + p, high + q, low + q]);
            }
        }
    }
    shape
}

/// Clumps of small leaves, nearer to each other than a voxel.
pub fn clumps() -> Shape {
    let (mut shape, mut random) = (Shape::new("clumps"), Random(362_436_069));
    for _ in 0..6000 {
        let c = random.point();
        for _ in 0..20 {
            let (a, b) = random.direction().any_orthonormal_pair();
            let at = c + 0.7 * VOXEL * (random.point() - 0.5);
            shape.quad(at, a * 0.1 * VOXEL, b * 0.1 * VOXEL);
        }
    }
    shape
}
