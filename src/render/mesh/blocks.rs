//! Triangles in blocks of up to eight, of which a ray tests all at once: in f32, with room for rounding, so that what a block lets
//! pass is few triangles, which are then tested exactly.
//!
//! Based on: S. Woop, C. Benthin, I. Wald, *Watertight Ray/Triangle Intersection*, JCGT 2013; I. Wald, P. Slusallek, C. Benthin,
//! M. Wagner, *Interactive Rendering with Coherent Ray Tracing*, EG 2001 (a ray tests four triangles at once).

use glam::Vec4;

use super::shear::Shear;
use crate::geom::{Aabb, DVec3, Ray, each3};
use crate::render::bvh::{Bvh, bits};

/// Triangles of a block.
const WIDTH: usize = 8;

/// How far a corner may be from where it is in exact numbers, in units in which the scene is about 1 across: more than four roundings
/// to f32 of coordinates up to 2 (2^-23 each).
const MARGIN: f32 = 1.0 / (1 << 20) as f32;

/// The corners of up to eight triangles, one array per corner and axis, and their numbers. Places that are not used hold what is no
/// number, which no ray meets.
struct Block {
    corners: [[[Vec4; WIDTH / 4]; 3]; 3],
    triangles: [u32; WIDTH],
}

/// All triangles of a mesh, in blocks, with a hierarchy over these.
#[derive(Default)]
pub struct Blocks {
    bvh: Bvh,
    blocks: Vec<Block>,
}

/// A ray prepared for blocks.
struct ShearedRay {
    axes: [usize; 3],
    origin: [Vec4; 3],
    scale: [Vec4; 3],
}

impl ShearedRay {
    fn new(ray: &Ray, shear: &Shear) -> ShearedRay {
        let Shear { axes, scale } = shear;
        ShearedRay {
            axes: *axes,
            origin: each3(*axes, |k| Vec4::splat(ray.origin[k] as f32)),
            scale: each3(scale.to_array(), |s| Vec4::splat(s as f32)),
        }
    }

    /// A bit for each triangle of the block that the ray may meet in (0, `end`).
    #[inline(always)]
    fn may_meet(&self, block: &Block, end: f32) -> u32 {
        let (mut mask, [x, y, z]) = (0, self.axes);
        let margin = Vec4::splat(MARGIN);
        for half in 0..WIDTH / 4 {
            let sheared = |corner: &[[Vec4; WIDTH / 4]; 3]| {
                let depth = corner[z][half] - self.origin[2];
                let across = corner[x][half] - self.origin[0] - self.scale[0] * depth;
                let along = corner[y][half] - self.origin[1] - self.scale[1] * depth;
                [across, along, self.scale[2] * depth]
            };
            let [a, b, c] = each3([0, 1, 2], |k| sheared(&block.corners[k]));
            let u = c[0] * b[1] - c[1] * b[0];
            let v = a[0] * c[1] - a[1] * c[0];
            let w = b[0] * a[1] - b[1] * a[0];
            // Each is off by no more than the margin times its four factors.
            let size = |p: &[Vec4; 3]| p[0].abs().max(p[1].abs());
            let off = margin * 4.0 * (size(&a).max(size(&b)).max(size(&c)) + margin);
            let is_met = u.min(v).min(w).cmpge(-off) | u.max(v).max(w).cmple(off);
            let (near, far) = (a[2].min(b[2]).min(c[2]), a[2].max(b[2]).max(c[2]));
            let is_between = near.cmple(Vec4::splat(end) + 2.0 * margin) & far.cmpge(-2.0 * margin);
            mask |= (is_met & is_between).bitmask() << (4 * half);
        }
        mask
    }
}

impl Blocks {
    /// Of `count` triangles, of which `corners` tells the corners: finite, in units in which the scene is about 1 across.
    pub fn new(count: usize, corners: impl Fn(usize) -> [DVec3; 3] + Sync) -> Blocks {
        let mut blocks = Vec::new();
        let bvh = Bvh::of_groups((0..count).map(|i| Aabb::around(corners(i))), WIDTH, |group| {
            let mut block = Block { corners: [[[Vec4::NAN; WIDTH / 4]; 3]; 3], triangles: [0; WIDTH] };
            for (k, &triangle) in group.iter().enumerate() {
                block.triangles[k] = triangle;
                for (corner, p) in corners(triangle as usize).into_iter().enumerate() {
                    (0..3).for_each(|axis| block.corners[corner][axis][k / 4][k % 4] = p[axis] as f32);
                }
            }
            blocks.push(block);
        });
        Blocks { bvh, blocks }
    }

    /// Calls `hit(triangle, t)` for triangles that the ray may meet before `t`, those in nearer boxes first; `hit` returns the new,
    /// never larger `t`.
    #[inline]
    pub fn nearest(&self, ray: &Ray, shear: &Shear, t1: f64, mut hit: impl FnMut(u32, f64) -> f64) -> f64 {
        let sheared = ShearedRay::new(ray, shear);
        self.bvh.nearest(ray, t1, |number, mut t1| {
            let block = &self.blocks[number as usize];
            for k in bits(sheared.may_meet(block, t1 as f32)) {
                t1 = hit(block.triangles[k], t1);
            }
            t1
        })
    }

    /// Calls `hit(triangle)` for all triangles that the ray may meet before `t1`, in no order, until it returns false. False if
    /// stopped.
    #[inline]
    pub fn all(&self, ray: &Ray, shear: &Shear, t1: f64, mut hit: impl FnMut(u32) -> bool) -> bool {
        let sheared = ShearedRay::new(ray, shear);
        self.bvh.all(ray, t1, |number| {
            let block = &self.blocks[number as usize];
            bits(sheared.may_meet(block, t1 as f32)).all(|k| hit(block.triangles[k]))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_triangle_that_is_met_is_left_out_and_few_others_are_let_through() {
        // Small triangles, needles, and some edge on; rays through points of them, so that edges and corners are met too.
        let at = |k: f64| DVec3::new((k * 0.6180).fract(), (k * 0.7548).fract(), (k * 0.5698).fract()) - 0.5;
        let corners = |i: usize| {
            let size = [0.3, 0.01, 1e-3][i % 3];
            let a = at(i as f64);
            let thin = if i.is_multiple_of(5) { 1e-3 } else { 1.0 };
            [a, a + size * at(i as f64 + 0.3), a + thin * size * at(i as f64 + 0.7)]
        };
        let blocks = Blocks::new(3000, corners);
        let (mut met, mut passed) = (0, 0);
        for k in 0..3000 {
            let [a, b, c] = corners(k);
            let through = [a, b, 0.5 * (a + c), (a + b + c) / 3.0][k % 4];
            let origin = at(0.37 * k as f64 + 0.11);
            let ray = Ray { origin, dir: (through - origin).normalize() };
            let shear = Shear::new(ray.dir);
            let exact =
                |i: u32| shear.meet(corners(i as usize).map(|p| p - origin)).filter(|(t, _)| *t > 0.0 && *t < 1.5);
            let mut found = Vec::new();
            blocks.all(&ray, &shear, 1.5, |i| {
                found.push(i);
                true
            });
            let want: Vec<u32> = (0..3000).filter(|&i| exact(i).is_some()).collect();
            assert!(want.iter().all(|i| found.contains(i)), "{k}");
            (met, passed) = (met + want.len(), passed + found.len());
            let mut nearest = f64::INFINITY;
            blocks.nearest(&ray, &shear, 1.5, |i, t1| match exact(i).filter(|(t, _)| *t < t1) {
                Some((t, _)) => {
                    nearest = t;
                    t
                }
                None => t1,
            });
            let least = want.iter().filter_map(|&i| Some(exact(i)?.0)).fold(f64::INFINITY, f64::min);
            assert_eq!(nearest, least, "{k}");
        }
        assert!(met > 3000, "{met}");
        // Margins are 1e-6 of the scene, which is as wide as the thinnest needles are.
        assert!(passed < 2 * met, "{passed} for {met}");
    }
}
