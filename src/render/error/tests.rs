//! Errors whose size is known: a texel that is what its source is, one that is not there, and veils.

use super::*;
use crate::geom::{Aabb, Ray};
use crate::progress::Quiet;
use crate::volume::voxel::RATE_MAX;
use crate::volume::{Depth, Info, Volume, Voxel};

/// All voxels of `depth` alike, at every depth.
fn full(depth: usize, voxel: Voxel) -> Octree {
    let info = Info { facet_size: 0.01, ..Info::default() };
    let depths = (0..=depth).map(|d| {
        let n = 1usize << (3 * d);
        Depth { masks: vec![if d == depth { 0 } else { 255 }; n], voxels: vec![voxel; n], mixes: Vec::new() }
    });
    Octree::new(Volume { info, depths: depths.collect() }).unwrap()
}

/// The faces of the box `lo ..= hi`.
fn cube(lo: DVec3, hi: DVec3) -> Vec<Facet> {
    let mut facets = Vec::new();
    for axis in 0..3 {
        for level in [lo[axis], hi[axis]] {
            let at = |i: usize| {
                let mut p = lo;
                p[axis] = level;
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                p[u] = if i & 1 == 0 { lo[u] } else { hi[u] };
                p[v] = if i & 2 == 0 { lo[v] } else { hi[v] };
                p
            };
            for corners in [[0, 1, 3], [0, 3, 2]] {
                facets.push(Facet { corners: corners.map(at), number: axis as u32, cut_out: false });
            }
        }
    }
    facets
}

fn quick() -> Options {
    Options { pixels: 12, rays: [64, 64], ..Options::default() }
}

fn white(_: u32, _: DVec3) -> ([f32; 3], f32) {
    ([1.0; 3], 1.0)
}

#[test]
fn an_opaque_cube_is_itself() {
    let tree = full(3, Voxel { rate: RATE_MAX, ..Voxel::default() });
    let truth = GroundTruth::new(cube(DVec3::ZERO, DVec3::ONE), vec![], &white);
    // ProjectedAreas alike along every axis, as those of isotropic normals are.
    let areas = ProjectedAreas::new((0..512).map(|code| (code, [1.0; 13])).collect());
    let found = measure(&tree, &truth, Some(areas), &quick(), &Quiet).unwrap();
    assert_eq!(found.len(), 4);
    for d in &found {
        // The cube's rim: a chord of less than a hundredth of a voxel lets something through.
        assert!(d.opacity.spread.mean < 0.01 && (d.opacity.area - 1.0).abs() < 0.01, "{d:?}");
        assert!(d.opacity_at_4.is_none_or(|o| o.spread.mean < 0.01));
        assert_eq!(d.voxels, 8u64.pow(d.depth as u32));
        assert!(d.albedo.mean < 1e-6 && d.sigma.unwrap().mean < 1e-3, "{d:?}");
    }
}

#[test]
fn what_is_missing_is_all_of_the_error() {
    let tree = full(2, Voxel::default());
    let truth = GroundTruth::new(cube(DVec3::ZERO, DVec3::ONE), vec![], &white);
    let found = measure(&tree, &truth, None, &Options { depths: 1, ..quick() }, &Quiet).unwrap();
    let opacity = found[0].opacity;
    // A pixel is a quarter of the cube's edge: most of those that meet the cube lie within its outline.
    assert!(opacity.spread.mean > 0.6 && opacity.spread.p95 == 1.0, "{opacity:?}");
    assert_eq!((opacity.area, opacity.spread.bias), (0.0, -opacity.spread.mean));
    assert_eq!((found[0].depth, found[0].sigma), (2, None));
}

#[test]
fn veils_let_their_share_through() {
    let look = |number: u32, _: DVec3| ([number as f32, 0.0, 0.0], if number == 2 { 0.25 } else { 0.5 });
    let facets = cube(DVec3::splat(0.25), DVec3::splat(0.75));
    let truth = GroundTruth::new(facets.into_iter().map(|f| Facet { cut_out: true, ..f }).collect(), vec![], &look);
    let mut layers = Vec::new();
    // In at a facet of axis 2, out at the other.
    let ray = Ray { origin: DVec3::new(0.4, 0.45, -1.0), dir: DVec3::Z };
    assert!((truth.trace(&ray, &mut layers) - 0.75 * 0.75).abs() < 1e-12);
    assert_eq!(layers.len(), 2);
    assert!((layers[0].weight - 0.25).abs() < 1e-12 && (layers[1].weight - 0.75 * 0.25).abs() < 1e-12);
    assert!(layers.iter().all(|l| l.normal == DVec3::NEG_Z && l.albedo[0] == 2.0));
    let along = Ray { origin: DVec3::new(0.5, 0.45, 0.4), dir: DVec3::X };
    assert_eq!(truth.transmittance(&along, u32::MAX), 0.5);
    assert_eq!(truth.transmittance(&Ray { origin: DVec3::splat(0.9), ..along }, u32::MAX), 1.0);
}

#[test]
fn soft_matter_lets_through_what_its_depth_says() {
    let soft = |lo: f64, hi: f64, flat: f64| MediumBox {
        bounds: Aabb::new(DVec3::new(0.0, 0.0, lo), DVec3::new(1.0, 1.0, hi)),
        extinction: 3.0,
        flat,
        normal: if flat > 0.0 { DVec3::Z } else { DVec3::ZERO },
        albedo: [0.5; 3],
    };
    let mut layers = Vec::new();
    let square_on = Ray { origin: DVec3::new(0.4, 0.45, -1.0), dir: DVec3::Z };
    // Flakes square to z are seen twice as well along it as in the mean.
    let truth = GroundTruth::new(vec![], vec![soft(0.5, 1.0, 1.0), soft(0.0, 0.5, 0.0)], &white);
    assert!((truth.trace(&square_on, &mut layers) - libm::exp(-1.5 - 3.0)).abs() < 1e-12);
    assert!((layers[0].weight - (1.0 - libm::exp(-1.5))).abs() < 1e-12 && layers[0].flat == 0.0);
    assert!(layers[1].flat == 1.0 && layers[1].normal == DVec3::NEG_Z);
    let half_way = Ray { origin: DVec3::new(0.4, 0.45, 0.25), dir: 2.0 * DVec3::Z };
    assert!((truth.transmittance(&half_way, 0) - libm::exp(-0.75 - 3.0)).abs() < 1e-12);
    assert!((truth.transmittance(&Ray { dir: DVec3::X, ..half_way }, 0) - libm::exp(-3.0 * 0.6)).abs() < 1e-12);
    // Nothing of it behind a facet.
    let truth = GroundTruth::new(cube(DVec3::splat(0.25), DVec3::splat(0.75)), vec![soft(0.0, 1.0, 0.0)], &white);
    assert_eq!(truth.trace(&square_on, &mut layers), 0.0);
    assert!((layers[1].weight - libm::exp(-0.75)).abs() < 1e-12, "{layers:?}");
    // A ball lit from where it is seen from: 2/3, half way round 2/(3π), from behind nothing.
    let ball = layers[0];
    assert!((ball.lit(DVec3::Z, DVec3::NEG_Z) - 2.0 / 3.0).abs() < 1e-12);
    assert!((ball.lit(DVec3::Z, DVec3::X) - 2.0 / 3.0 * std::f64::consts::FRAC_1_PI).abs() < 1e-12);
    assert!(ball.lit(DVec3::Z, DVec3::Z).abs() < 1e-12);
}

#[test]
fn the_95th_percentile_is_by_weight() {
    let spread = ErrorStats::of(vec![(0.5, 4.0), (-0.1, 96.0)]);
    assert_eq!(spread.p95, 0.1);
    assert!((spread.mean - 0.116).abs() < 1e-12 && (spread.bias + 0.076).abs() < 1e-12);
    assert_eq!(ErrorStats::of(vec![(1.0, 0.0)]), ErrorStats::default());
    assert!(
        measure(
            &full(0, Voxel::default()),
            &GroundTruth::new(vec![], vec![], &white),
            None,
            &Options { pixels: 0, ..quick() },
            &Quiet
        )
        .is_err()
    );
}

#[test]
fn no_direction_is_that_of_an_axis_once_turned() {
    for w in directions(true) {
        assert!((w.length() - 1.0).abs() < 1e-12);
        assert!(directions13().iter().all(|axis| axis.dot(w).abs() < 0.999), "{w}");
    }
    assert!((SUN.length() - 1.0).abs() < 1e-12);
}
