//! Alpha masks against point samples: discs, checkerboards and blended cards.

use std::sync::Arc;

use super::*;
use crate::bake::clip::for_each_piece;
use crate::bake::measure::VoxelAccumulator;
use crate::geom::{Aabb, DAffine3, DMat3};
use crate::progress::Quiet;
use crate::scene::model::{Alpha, Instance, Material, Model, Part};
use crate::scene::texture::Texture;
use crate::scene::texture::TextureRef;
use crate::source::mesh::{MeshOptions, MeshSource};
use crate::source::{AlphaClass, Placement, Source};

/// A tilted card, 20 voxels wide, with `texture` on it once.
fn card(texture: Texture, alpha: Alpha) -> (MeshSource, Placement) {
    let turn = DMat3::from_axis_angle(DVec3::new(0.3, 0.5, 0.8).normalize(), 0.9);
    let corner = |x: f64, y: f64| (turn * DVec3::new(20.0 * x, 20.0 * y, 0.0)).as_vec3().to_array();
    let part = Part {
        positions: vec![corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)],
        uvs: vec![vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Part::default()
    };
    let transform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let texture = TextureRef { texture: Arc::new(texture), tex_coord: 0, transform };
    let material = Material { texture: Some(texture), alpha, ..Material::default() };
    let instance = Instance { part: 0, transform: DAffine3::IDENTITY, node: String::new() };
    let model = Model { parts: vec![part], materials: vec![material], instances: vec![instance], ..Model::default() };
    let source = MeshSource::new(model, &MeshOptions::default());
    let min = DVec3::splat(-32.4);
    let place = Placement {
        bounds: Aabb::new(min, min + 64.0),
        transform: DAffine3::IDENTITY,
        scale: 1.0,
        depth: 6,
        up: 2,
        cyclic: [false; 3],
        memory: u64::MAX,
    };
    (source, place)
}

fn image(side: u32, alpha: impl Fn(f64, f64) -> u8) -> Texture {
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(side);
    let texels = (0..side * side).map(|i| [90, 120, 40, alpha(at(i % side), at(i / side))]).collect();
    Texture::new("card", side, side, texels)
}

fn disc(x: f64, y: f64) -> u8 {
    if (x - 0.5).hypot(y - 0.5) < 0.4 { 255 } else { 0 }
}

/// Mean alpha of a piece by `n` × `n` point samples of the box of its projection.
fn sampled(staged: &dyn Staged, p: &Polygon, n: usize) -> f64 {
    let normal = p.area_vector();
    let drop = (0..3).max_by(|&i, &j| normal[i].abs().total_cmp(&normal[j].abs())).unwrap();
    let (a, b) = ((drop + 1) % 3, (drop + 2) % 3);
    let (lo, hi) = p.bounds();
    let (mut inside, mut there) = (0, 0.0);
    for j in 0..n {
        let y = lo[b] + (j as f64 + 0.5) / n as f64 * (hi[b] - lo[b]);
        let (from, to) = row_interval(p.corners(), a, b, y);
        for i in 0..n {
            let x = lo[a] + (i as f64 + 0.5) / n as f64 * (hi[a] - lo[a]);
            if x >= from && x < to {
                let mut q = p.corners()[0];
                q[drop] -= (normal[a] * (x - q[a]) + normal[b] * (y - q[b])) / normal[drop];
                (q[a], q[b]) = (x, y);
                inside += 1;
                there += f64::from(staged.surface(p.facet, q, 0.0).alpha);
            }
        }
    }
    if inside > 0 { there / f64::from(inside) } else { 0.0 }
}

struct Found {
    area: f64,
    /// Area as the line masks have it, from its 13 projections.
    lines: f64,
    /// Root of the sum of the squares of the pieces' areas.
    spread: f64,
    /// Root of the mean square error of a piece's coverage against 64 × 64 samples: of the mask, and of 8 × 8 samples.
    error: [f64; 2],
}

fn find(texture: Texture, alpha: Alpha) -> Found {
    let (source, place) = card(texture, alpha);
    let staged = source.stage(&place, &Quiet).unwrap();
    let mut found = Found { area: 0.0, lines: 0.0, spread: 0.0, error: [0.0; 2] };
    let (mut whole, mut count, mut projected) = (0.0, 0.0, 0.0);
    for region in 0..staged.regions().len() {
        let wide = 1 << crate::source::REGION_LOG2;
        let low = crate::morton::decode(staged.regions()[region]).map(|v| f64::from(v * wide));
        let corner = DVec3::from(low);
        staged.emit(region, &mut |facet| {
            for_each_piece(&*staged, facet, corner, corner + f64::from(wide), &mut |p, at, alpha| {
                let area = p.area_vector();
                let size = area.length();
                let local = p.relative_to(at);
                let one = alpha.map(|alpha| AlphaMask::new(&*staged, alpha, &local, at, area / size));
                let share = one.as_ref().map_or(1.0, |c| c.as_ref().map_or(0.0, |c| c.coverage));
                found.area += share * size;
                found.spread += size * size;
                if size > 0.2 && alpha.is_some() {
                    let truth = sampled(&*staged, p, 64);
                    count += 1.0;
                    found.error[0] += (share - truth).powi(2);
                    found.error[1] += (sampled(&*staged, p, 8) - truth).powi(2);
                }
                let mut gather = VoxelAccumulator::new(false);
                gather.add(&*staged, p, at, alpha);
                for k in 0..13 {
                    whole += f64::from(gather.lines(k)) / 256.0;
                    projected += crate::geom::oblique_area(k, area) / size / 13.0 * share * size;
                }
            });
        });
    }
    found.lines = whole / 13.0 / projected * found.area;
    found.spread = found.spread.sqrt();
    found.error = found.error.map(|e: f64| (e / f64::max(count, 1.0)).sqrt());
    found
}

#[test]
fn a_masked_disc_has_the_area_of_a_disc() {
    // 6, 13 and 51 texels a voxel: every texel sampled, and averaged.
    for side in [128, 256, 1024] {
        let image = image(side, disc);
        let share = image.texels.iter().filter(|t| t[3] > 0).count() as f64 / f64::from(side * side);
        // The image's own steps.
        assert!((share / std::f64::consts::PI / 0.16 - 1.0).abs() < 4e-3);
        let f = find(image, Alpha::Mask(0.5));
        let want = 400.0 * share;
        // Some 80 voxels of rim, each off by .01: .09 of 200.
        assert!((f.area / want - 1.0).abs() < 2e-3, "{side}: {} of {want}", f.area);
        assert!((f.lines / want - 1.0).abs() < 5e-3, "{side}: {} of {want}", f.lines);
        // Up to 8 texels a voxel both are point samples, in lattices that differ in where they start; from there on ours are
        // means of all texels.
        assert!(f.error[0] < 0.015 && f.error[0] < 1.1 * f.error[1], "{side}: {:?}", f.error);
        assert!(side == 128 || f.error[0] < 0.9 * f.error[1], "{side}: {:?}", f.error);
    }
}

#[test]
fn a_fine_checkerboard_is_half_there() {
    // 51 texels a voxel in squares of 3: what point samples alias.
    let square = |x: f64, y: f64| if ((x * 341.0) as u32 + (y * 341.0) as u32).is_multiple_of(2) { 255 } else { 0 };
    let f = find(image(1023, square), Alpha::Mask(0.5));
    // Texels are there as a whole or not at all, but a piece's rim cuts squares, which it does without regard to them: errors of
    // single pieces do not know of each other, and their sum stays within three standard deviations. (One square more is there than is
    // not: 3e-6 of the whole.)
    let deviation = f.error[0] * f.spread;
    assert!((f.area - 200.0).abs() < 3.0 * deviation, "{} {deviation}", f.area);
    // Of 400 pieces or more of at most √2 (the largest cut through a cube), each off by .03: .03 · √(400 · √2).
    assert!(deviation < 0.72, "{deviation}");
    assert!((f.lines / 200.0 - 1.0).abs() < 1e-2, "{}", f.lines);
    assert!(f.error[0] < 0.03 && f.error[0] < 0.5 * f.error[1], "{:?}", f.error);
}

#[test]
fn blended_alpha_is_the_share_that_is_there() {
    // 128 of 255 everywhere, one texel and many a voxel.
    for side in [20, 1024] {
        let f = find(image(side, |_, _| 128), Alpha::Blend);
        let want = 400.0 * 128.0 / 255.0;
        assert!((f.area / want - 1.0).abs() < 1e-5, "{}", f.area);
        // A dither over some 400 pieces of 16 to 64 cells: each is off by less than half a cell, 1/128 or more.
        assert!((f.lines / want - 1.0).abs() < 2e-2, "{} {want}", f.lines);
    }
}

/// Two facets in one place, each there to one half, hide each other as unrelated matter in every voxel: both are there in a quarter of
/// its cells.
#[test]
fn dithers_of_two_facets_are_even_together() {
    struct Even(f32);
    impl AlphaSampler for Even {
        fn classify(&self, _: &Polygon) -> AlphaClass {
            AlphaClass::Mixed
        }
        fn texels_per_voxel(&self) -> f64 {
            100.0
        }
        fn sample_row(&self, _: DVec3, _: DVec3, _: f64, alpha: &mut [f32]) {
            alpha.fill(self.0);
        }
    }
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| DVec3::new(x, y, 0.5));
    let cells = |facet: u32, share: f32, origin: DVec3| {
        let polygon = Polygon::new(&corners, facet);
        let grid = CellGrid::new(&polygon, DVec3::Z, 100.0);
        AlphaSamples::take(&Even(share), &grid, &polygon, origin).cells
    };
    for (a, b, share) in [(0, 1, 0.5), (2, 3, 0.5), (5, 8, 0.5), (0, 1, 0.25)] {
        let (mut sum, mut square) = (0.0, 0.0);
        for n in 0..400 {
            let origin = DVec3::new(f64::from(n % 20), f64::from(n / 20), 3.0);
            let both = cells(a, share, origin) & cells(b, share, origin);
            let apart = f64::from(both.count_ones()) / 64.0 - f64::from(share * share);
            (sum, square) = (sum + apart, square + apart * apart);
        }
        // Cells that are drawn by lot would be off by √(3/16) / 8 = .054; those of two shifts of one pattern, by .14. The mean of 400
        // of the former has .0027.
        assert!(
            (square / 400.0).sqrt() < 0.05 && (sum / 400.0).abs() < 0.008,
            "{a} {b}: {} {sum}",
            (square / 400.0).sqrt()
        );
    }
}
