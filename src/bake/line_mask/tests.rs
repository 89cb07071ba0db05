//! Line masks of facets and full voxels: their areas, unions, and the lattice that neighbours share.

use super::*;
use crate::geom::polygon::Polygon;
use crate::geom::projection::{LINES, PROJECTIONS, Projection, child_offset};
use crate::geom::{DVec3, box_area, oblique_area};

/// Plane coordinates of `q`, in voxel edges from the plane origin of the voxel.
fn project(p: &Projection, q: DVec3) -> (f64, f64) {
    let along = |i: usize, s: i32| q[i] - f64::from(s) * q[p.drop] - Projection::base(s);
    (along(p.a, p.sa), along(p.b, p.sb))
}

#[test]
fn a_full_voxel_blocks_its_box_area() {
    let full = LineMask::full();
    for k in 0..13 {
        let area = f64::from(full.counts()[k]) / (LINES * LINES) as f64;
        // Lines on the silhouette's edge: an edge of 16 lines is off by half a line at most.
        assert!((area - box_area(k, DVec3::ONE)).abs() < 0.1, "{k} {area}");
    }
}

#[test]
fn eight_full_children_make_a_full_parent() {
    let full = LineMask::full();
    let union = unite(&[Some(full); 8], 3, true);
    for k in 0..13 {
        let want = box_area(k, DVec3::ONE) * (LINES * LINES) as f64;
        assert!((f64::from(union.lines[k]) / want - 1.0).abs() < 0.06, "{k} {}", union.lines[k]);
        // In each direction, every line is blocked first by one child.
        let visible: u32 = (0..8).map(|j| union.children[j][k].visible).sum();
        assert_eq!(visible, 2 * union.lines[k]);
    }
}

#[test]
fn lines_of_a_facet_measure_its_area() {
    let c =
        [DVec3::new(0.1, 0.2, 0.3), DVec3::new(0.9, 0.4, 0.2), DVec3::new(0.5, 0.8, 0.9), DVec3::new(0.2, 0.7, 0.8)];
    let p = Polygon::new(&c[..3], 0);
    let (mut mask, mut sum) = (LineMask::default(), [0; 13]);
    rasterize(&mut mask, &p, DVec3::ZERO, None, &mut sum);
    for (k, sum) in sum.into_iter().enumerate() {
        let area = f64::from(mask.counts()[k]) / (LINES * LINES) as f64;
        assert_eq!(mask.counts()[k], sum);
        // The boundary is some 3 edges of at most 16·sqrt(2) lines: off by a few lines of 256.
        assert!((area - oblique_area(k, p.area_vector())).abs() < 0.03, "{k} {area}");
    }
}

#[test]
fn neighbours_share_their_lines() {
    // A wall across two voxels, seen obliquely: each line is in one of both.
    for (k, p) in PROJECTIONS.iter().enumerate() {
        for j in 0..8 {
            let (oa, ob) = child_offset(k, j);
            let (wa, wb) = p.extent();
            assert!(oa <= wa && ob <= wb);
            let centre = DVec3::new((j & 1) as f64, (j >> 1 & 1) as f64, (j >> 2) as f64) + 0.4;
            let (x, y) = project(p, centre);
            let local = project(p, DVec3::splat(0.4));
            // The parent's plane starts at −2 child edges where sheared upward, the child's at −1.
            let base = |s: i32| if s > 0 { 1.0 } else { 0.0 };
            assert!((x + base(p.sa) - oa as f64 - local.0).abs() < 1e-12);
            assert!((y + base(p.sb) - ob as f64 - local.1).abs() < 1e-12);
        }
    }
}
