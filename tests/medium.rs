//! Semi-transparent matter against the law of Beer and Lambert, at every depth.

use vtex::bake::{self, Options};
use vtex::geom::{Aabb, DVec3, directions13};
use vtex::progress::Progress;
use vtex::render::{DepthChoice, MarchSegment, MarchStats, transmittance};
use vtex::source::{Medium, Placement, Polygon, Source, Staged, Surface};
use vtex::volume::{Octree, Volume};
use vtex::{Result, Warnings, morton};

/// Source that fills the unit cube with the medium that `matter` returns for each voxel, or cube of `2^edge_log2` voxels an edge.
struct Cloud<F> {
    edge_log2: u32,
    matter: F,
    warnings: Warnings,
}

fn cloud<F: Fn(DVec3) -> Option<Medium> + Sync>(edge_log2: u32, matter: F) -> Cloud<F> {
    Cloud { edge_log2, matter, warnings: Warnings::default() }
}

impl<F: Fn(DVec3) -> Option<Medium> + Sync> Source for Cloud<F> {
    fn bounds(&self) -> Aabb {
        Aabb::new(DVec3::ZERO, DVec3::splat(1.0 - 1e-6))
    }
    fn metres_per_unit(&self) -> f64 {
        0.0
    }
    fn facet_size(&self) -> f64 {
        0.0
    }
    fn has_colour(&self) -> bool {
        true
    }
    fn warnings(&self) -> &Warnings {
        &self.warnings
    }
    fn stage<'a>(&'a self, place: &Placement, _: &dyn Progress) -> Result<Box<dyn Staged + 'a>> {
        let count = u64::from(place.side() >> place.region_log2()).pow(3);
        Ok(Box::new(StagedCloud { cloud: self, place: *place, regions: (0..count).collect() }))
    }
}

struct StagedCloud<'a, F> {
    cloud: &'a Cloud<F>,
    place: Placement,
    regions: Vec<u64>,
}

impl<F: Fn(DVec3) -> Option<Medium> + Sync> Staged for StagedCloud<'_, F> {
    fn regions(&self) -> &[u64] {
        &self.regions
    }
    fn weight(&self, _: usize) -> u64 {
        1
    }
    fn facets(&self) -> u32 {
        0
    }
    fn emit(&self, _: usize, _: &mut dyn FnMut(&Polygon)) {}
    fn surface(&self, _: u32, _: DVec3, _: f64) -> Surface {
        Surface { albedo: [1.0; 3], alpha: 1.0 }
    }
    fn has_alpha(&self, _: u32) -> bool {
        false
    }
    fn one_sided(&self, _: u32) -> bool {
        false
    }
    fn medium(&self, region: usize, each: &mut dyn FnMut(&Medium)) {
        let width = 1u32 << self.place.region_log2();
        let corner = morton::decode(self.regions[region]).map(|v| v * width);
        let edge = 1u32 << self.cloud.edge_log2;
        for code in 0..u64::from(width / edge).pow(3) {
            let cell = morton::decode(code);
            let at: [u32; 3] = std::array::from_fn(|a| corner[a] + cell[a] * edge);
            let centre = DVec3::from(at.map(f64::from)) + 0.5 * f64::from(edge);
            if let Some(m) = (self.cloud.matter)(centre / f64::from(self.place.side())) {
                each(&Medium { at, edge_log2: self.cloud.edge_log2, ..m });
            }
        }
    }
    fn inside(&self, _: DVec3) -> bool {
        false
    }
}

fn volume(source: &dyn Source, resolution: u32) -> Volume {
    let options = Options { resolution, up: 2, ..Options::default() };
    super::readable::readable(bake::bake(source, &options, &vtex::progress::Quiet, &mut |_| ()).unwrap().0)
}

fn baked(source: &dyn Source, resolution: u32) -> Octree {
    Octree::new(volume(source, resolution)).unwrap()
}

fn through(tree: &Octree, middle: DVec3, dir: DVec3, depth: usize) -> (f64, f64) {
    let origin = middle - 2.0 * dir;
    let (t0, t1) = Aabb::UNIT.hit(origin, 1.0 / dir, 0.0, 9.0).unwrap();
    let stretch = MarchSegment {
        origin: (origin + t0 * dir).as_vec3(),
        dir: dir.as_vec3(),
        length: (t1 - t0) as f32,
        footprint: 1.0 / (1u32 << depth) as f32,
        growth: 0.0,
        opacity_scale: 1.0,
    };
    let t = transmittance(tree, &stretch, DepthChoice::default(), 0.0, &mut MarchStats::default());
    (t.into(), t1 - t0)
}

/// Mean, and largest absolute value, over 26 directions of T(marched) − T(law), each the mean over rays through the middle part.
fn compare(tree: &Octree, depth: usize, law: impl Fn(DVec3, DVec3) -> f64) -> (f64, f64) {
    let (mut bias, mut worst) = (0.0f64, 0.0f64);
    for d in directions13() {
        for dir in [d, -d] {
            let (a, b) = dir.any_orthonormal_pair();
            let (mut got, mut want) = (0.0, 0.0);
            for i in 0..400 {
                let at = |v: usize| (v as f64 + 0.5) / 20.0 - 0.5;
                let middle = DVec3::splat(0.5) + 0.3 * (at(i % 20) * a + at(i / 20) * b);
                got += through(tree, middle, dir, depth).0 / 400.0;
                want += law(middle, dir) / 400.0;
            }
            bias += (got - want) / 26.0;
            worst = worst.max((got - want).abs());
        }
    }
    (bias, worst)
}

#[test]
fn a_slab_takes_away_e_to_the_minus_depth_in_26_directions() {
    for kappa in [0.7, 2.0, 6.0] {
        for edge_log2 in [0, 2] {
            let source = cloud(edge_log2, |p: DVec3| {
                (p.z > 0.25 && p.z < 0.75).then(|| Medium::even([0; 3], 0, kappa / 32.0, [0.5; 3]))
            });
            let tree = baked(&source, 32);
            let slab = Aabb::new(DVec3::new(-9.0, -9.0, 0.25), DVec3::new(9.0, 9.0, 0.75)).intersection(Aabb::UNIT);
            for depth in 0..=5 {
                let (bias, worst) = compare(&tree, depth, |p, dir| {
                    slab.hit(p - 2.0 * dir, 1.0 / dir, 0.0, 9.0).map_or(1.0, |(a, b)| (-kappa * (b - a)).exp())
                });
                // Codes of rates are steps of 4.4 %, which at κ = 6 is .013 of T through the slab's middle; the lines of coarse voxels
                // are drawn pseudo-randomly.
                let known = depth.min(5 - edge_log2 as usize);
                let allowed = [0.03, 0.02, 0.02, 0.01, 0.006, 0.005][known];
                assert!(bias.abs() < allowed, "{kappa} {edge_log2} {depth}: {bias} {worst}");
                let allowed = [0.1, 0.06, 0.05, 0.025, 0.02, 0.01][known];
                assert!(worst < allowed, "{kappa} {edge_log2} {depth}: {bias} {worst}");
            }
        }
    }
}

#[test]
fn a_haze_fainter_than_the_smallest_code_keeps_its_depth() {
    // .0008 hits per voxel edge, of which the smallest code is .00204: .025 of the light over the cube's edge.
    let kappa = 0.0008 * 32.0;
    let source = cloud(0, |_| Some(Medium::even([0; 3], 0, kappa / 32.0, [0.5; 3])));
    let tree = baked(&source, 32);
    for depth in 0..=5 {
        let (bias, worst) = compare(&tree, depth, |p, dir| {
            Aabb::UNIT.hit(p - 2.0 * dir, 1.0 / dir, 0.0, 9.0).map_or(1.0, |(a, b)| (-kappa * (b - a)).exp())
        });
        // Coarse depths have their own codes, in steps of 4.4 %, so up to 2.2 % of the depth. At the finest, which voxels of a block
        // have the code 1 is fixed, so that a ray of 32 voxels may miss a tenth of them or meet a tenth more.
        assert!(bias.abs() < 0.05 * kappa && worst < 0.12 * kappa, "{depth}: {bias} {worst}");
    }
}

#[test]
fn a_graded_medium_integrates_its_density() {
    // Density 6 z: the integral along a ray is the mean of both ends times the length.
    let source = cloud(0, |p: DVec3| Some(Medium::even([0; 3], 0, 6.0 * p.z / 32.0, [0.5; 3])));
    let tree = baked(&source, 32);
    for depth in 1..=5 {
        let (bias, worst) = compare(&tree, depth, |p, dir| {
            let origin = p - 2.0 * dir;
            let (a, b) = Aabb::UNIT.hit(origin, 1.0 / dir, 0.0, 9.0).unwrap();
            (-6.0 * (origin + 0.5 * (a + b) * dir).z * (b - a)).exp()
        });
        // As above, and at depth 1 a voxel's density is the mean of 0 … 3 or 3 … 6.
        assert!(bias.abs() < [0.0, 0.04, 0.025, 0.015, 0.01, 0.01][depth], "{depth} {bias} {worst}");
        assert!(worst < [0.0, 0.1, 0.05, 0.03, 0.02, 0.015][depth], "{depth} {bias} {worst}");
    }
}

#[test]
fn colours_are_weighted_by_what_is_there() {
    let source = cloud(0, |p: DVec3| {
        let (extinction, albedo) = if p.x < 0.5 { (0.03, [1.0, 0.0, 0.0]) } else { (0.01, [0.0, 0.0, 1.0]) };
        Some(Medium::even([0; 3], 0, extinction, albedo))
    });
    let root = volume(&source, 8).depths[0].voxels[0].albedo();
    // Faint matter hardly hides itself, so colours mix as extinctions do, 3 : 1; codes are squares of 1/255 steps.
    assert!((root.x - 0.75).abs() < 0.05 && (root.z - 0.25).abs() < 0.05 && root.y == 0.0, "{root}");
}

#[test]
fn a_half_filled_voxel_blocks_on_its_filled_side() {
    let half = Medium { hi: DVec3::new(0.5, 1.0, 1.0), ..Medium::even([0; 3], 0, 1.2, [0.5; 3]) };
    let source = cloud(0, |p: DVec3| (p.z > 0.5 && p.z < 0.56).then_some(half));
    let tree = baked(&source, 16);
    for voxel in 0..16 {
        let at = |share: f64| DVec3::new((f64::from(voxel) + share) / 16.0, 0.5, 8.5 / 16.0);
        let filled = through(&tree, at(0.25), DVec3::Z, 4).0;
        // One layer of voxels: e^−1.2; the rates of a block are corrected together, here by 8 %.
        assert!((filled - (-1.2f64).exp()).abs() < 0.04, "{filled}");
        assert_eq!(through(&tree, at(0.75), DVec3::Z, 4).0, 1.0);
    }
}

#[test]
fn flakes_block_more_across_than_along() {
    let flat = Medium { flat: 1.0, normal: DVec3::Z, facing: 1.0, ..Medium::even([0; 3], 0, 0.05, [0.5; 3]) };
    let volume = volume(&cloud(0, |_| Some(flat)), 16);
    let voxel = volume.depths[4].voxels[77];
    let tree = Octree::new(volume).unwrap();
    let along = |dir: DVec3| -through(&tree, DVec3::splat(0.5), dir, 4).0.ln() / 16.0;
    // σ(w) = 2 extinction |n · w|; the SGGX keeps 1 % of its largest axis, and approximates a flake's |cos|.
    assert!((along(DVec3::Z) / 0.1 - 1.0).abs() < 0.06, "{}", along(DVec3::Z));
    assert!(along(DVec3::X) < 0.004, "{}", along(DVec3::X));
    assert!(voxel.one_sidedness() > 0.99 && voxel.mean_normal().z > 0.999);
}

#[test]
fn hostile_media_are_left_out() {
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(volume(&cloud(0, |_| Some(Medium::even([0; 3], 0, bad, [0.5; 3]))), 8).depths.is_empty());
    }
}
