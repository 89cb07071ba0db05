//! Boxes over patches against prisms, dense inversion, and their neighbours.

use super::super::{Prism, ShellBox};
use super::*;
use crate::random::SplitMix64;

struct Random(SplitMix64);

impl Random {
    fn point(&mut self) -> DVec3 {
        DVec3::new(self.0.signed(), self.0.signed(), self.0.signed())
    }
}

const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

/// A patch over the unit square, all of its numbers off by up to `rough`.
fn rough_patch(random: &mut Random, rough: f64) -> [Corner; 4] {
    SQUARE.map(|[x, y]| {
        let p = DVec3::new(x, y, 0.0);
        let (off, lean, moved) = (random.point(), random.point(), random.point());
        let (dw, jitter) = (1.0 + rough * random.0.signed(), random.0.unit());
        Corner { p: p + rough * off, h: DVec3::Z + rough * lean, q: 2.0 * p + rough * moved, dw, jitter }
    })
}

fn pieces_of(shell: &ShellBox, ray: &Ray, tolerance: f64) -> Vec<ShellSegment> {
    let (mut out, mut spans) = (Vec::new(), Vec::new());
    shell.spans(ray, 0.0, f64::INFINITY, |a, b| spans.push((a, b)));
    for (t0, t1) in spans {
        shell.for_each_segment(ray, t0, t1, &|_, _| tolerance, &mut |piece| {
            out.push(*piece);
            true
        });
    }
    out
}

/// A ray into the middle of a box from outside.
fn towards(random: &mut Random, corners: &[Corner; 4]) -> Ray {
    let middle = corners.iter().map(|c| c.p + 0.5 * c.h).sum::<DVec3>() / 4.0;
    let to = middle + 0.3 * random.point();
    let origin = to + 3.0 * random.point().normalize();
    Ray { origin, dir: (to - origin).normalize() }
}

/// Through a rectangle whose texel coordinates are affine, a patch is what the prism over it is, which is exact.
#[test]
fn a_flat_patch_is_a_prism() {
    let mut random = Random(SplitMix64::new(1));
    let mut met = 0;
    for _ in 0..300 {
        let (e, f, h) = (DVec3::X + 0.2 * random.point(), DVec3::Y + 0.2 * random.point(), DVec3::Z);
        let (u, v, start) = (random.point(), random.point(), random.point());
        let face = SQUARE.map(|[x, y]| {
            let q = start + x * u + y * v;
            Corner { p: x * e + y * f, h, q, dw: 0.7, jitter: 0.25 + 0.5 * x }
        });
        let prism = ShellBox::Prism(Box::new(Prism::new(&face).unwrap()));
        let patch = ShellBox::Patch(Box::new(PatchBox::new(&face).unwrap()));
        let ray = towards(&mut random, &face);
        let [wanted, found] = [&prism, &patch].map(|b| pieces_of(b, &ray, 1e-7));
        assert_eq!(wanted.len(), found.len());
        for (a, b) in wanted.iter().zip(&found) {
            met += 1;
            // Both in f64; derivatives of some tens magnify its rounding.
            assert!((a.t0 - b.t0).abs().max((a.t1 - b.t1).abs()) < 1e-11);
            assert!(a.q0.distance(b.q0).max(a.q1.distance(b.q1)) < 1e-11);
            assert!((a.to_texel.determinant() - b.to_texel.determinant()).abs() < 1e-9);
            for k in 0..2 {
                let (a, b) = (a.end_heights[k], b.end_heights[k]);
                assert!((a.rise - b.rise).abs().max((a.height - b.height).abs()).max((a.mask - b.mask).abs()) < 1e-11);
            }
        }
    }
    assert!(met > 250);
}

/// The (U, V, W) of a point by Newton's method from many starts: slow, and not that of the box.
fn invert(corners: &[Corner; 4], x: DVec3) -> Option<DVec3> {
    let mix = |u: f64, v: f64, of: &dyn Fn(&Corner) -> DVec3| {
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| of(&corners[k]));
        (1.0 - u) * (1.0 - v) * a + u * (1.0 - v) * b + u * v * c + (1.0 - u) * v * d
    };
    let at = |s: DVec3| mix(s.x, s.y, &|c| c.p + s.z * c.h);
    for start in 0..27 {
        let mut s = DVec3::new(f64::from(start % 3), f64::from(start / 3 % 3), f64::from(start / 9)) * 0.5;
        for _ in 0..20 {
            // Slopes by differences, exact along each axis.
            let slope = |axis: DVec3| at(s + 0.5 * axis) - at(s - 0.5 * axis);
            let step = DMat3::from_cols(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z)).inverse() * (x - at(s));
            s += step.clamp_length_max(0.5);
        }
        let inside = s.cmpge(DVec3::splat(-1e-9)).all() && s.cmple(DVec3::splat(1.0 + 1e-9)).all();
        if inside && at(s).distance(x) < 1e-12 {
            return Some(s);
        }
    }
    None
}

fn texel_at(corners: &[Corner; 4], s: DVec3) -> DVec3 {
    let top = |k: usize| corners[k].q + s.z * corners[k].dw * DVec3::Z;
    (1.0 - s.y) * ((1.0 - s.x) * top(0) + s.x * top(1)) + s.y * ((1.0 - s.x) * top(3) + s.x * top(2))
}

/// Matter that fills the texel evenly stops light by the length of the way through texel space: against a sum over many points.
#[test]
fn the_way_through_a_twisted_patch_is_that_of_dense_inversion() {
    const STEPS: u32 = 600;
    let mut random = Random(SplitMix64::new(2));
    let mut tested = 0;
    while tested < 16 {
        let corners = rough_patch(&mut random, 0.3);
        let Ok(patch) = PatchBox::new(&corners) else { continue };
        let near = Aabb::new(patch.bounds().min - 1e-6, patch.bounds().max + 1e-6);
        let shell = ShellBox::Patch(Box::new(patch));
        let ray = towards(&mut random, &corners);
        let step = 7.0 / f64::from(STEPS);
        let (mut inside, mut length, mut last) = (0.0, 0.0, None::<DVec3>);
        for k in 0..STEPS {
            let x = ray.at(step * (f64::from(k) + 0.5));
            let is_near = x.cmpge(near.min).all() && x.cmple(near.max).all();
            let here = is_near.then(|| invert(&corners, x)).flatten().map(|s| texel_at(&corners, s));
            inside += here.map_or(0.0, |_| step);
            length += here.zip(last).map_or(0.0, |(q, last)| q.distance(last));
            last = here;
        }
        let pieces = pieces_of(&shell, &ray, 1e-5);
        let found_inside: f64 = pieces.iter().map(|p| p.t1 - p.t0).sum();
        let found_length: f64 = pieces.iter().map(|p| p.q0.distance(p.q1)).sum();
        // The sums lose up to a step at each end of at most two spans; coordinates run up to some 8 per unit of t.
        assert!((found_inside - inside).abs() < 2.5 * step, "{found_inside} {inside}");
        assert!((found_length - length).abs() < 32.0 * step, "{found_length} {length}");
        // exp(−σ s): the transmittance of one optical depth per cell.
        let [a, b] = [found_length, length].map(|s| libm::exp(-s));
        assert!((a - b).abs() < 32.0 * step, "{a} {b}");
        tested += 1;
    }
}

/// Chords abut and keep to what they are allowed.
#[test]
fn chords_keep_to_the_tolerance() {
    let mut random = Random(SplitMix64::new(3));
    let (mut rays, mut worst, mut pieces_of_all) = (0, 0.0f64, 0);
    while rays < 200 {
        let corners = rough_patch(&mut random, 0.35);
        let Ok(patch) = PatchBox::new(&corners) else { continue };
        let tolerance = 10f64.powf(-2.0 - 2.0 * random.0.unit());
        let ray = towards(&mut random, &corners);
        let pieces = pieces_of(&ShellBox::Patch(Box::new(patch.clone())), &ray, tolerance);
        for pair in pieces.windows(2) {
            assert!(
                pair[0].t1 != pair[1].t0
                    || (pair[0].q1 == pair[1].q0 && pair[0].end_heights[1] == pair[1].end_heights[0])
            );
        }
        for piece in &pieces {
            for k in 1..16 {
                let share = f64::from(k) / 16.0;
                let s = patch.locate(ray.at(piece.t0 + share * (piece.t1 - piece.t0))).unwrap();
                let off = texel_at(&corners, s).distance(piece.q0.lerp(piece.q1, share));
                worst = worst.max(off / tolerance);
            }
        }
        pieces_of_all += pieces.len();
        rays += 1;
    }
    // Second derivatives are taken at three places; between them they may be somewhat larger.
    assert!(worst < 1.25, "{worst}");
    // A tolerance of 1e-4 of a cell needs chords of about a fiftieth of it.
    assert!(pieces_of_all < 200 * 64, "{pieces_of_all}");
}

/// A cube blown up to a ball, its faces cut into patches, with heights that are one per vertex; one patch in four is two
/// triangles.
fn ball(cuts: u32, random: &mut Random) -> Vec<ShellBox> {
    let mut heights: Vec<([i64; 3], DVec3)> = Vec::new();
    let mut boxes = Vec::new();
    for face in 0..6 {
        let (axis, side) = (face / 2, if face % 2 == 0 { 1 } else { -1 });
        let n = i64::from(cuts);
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            let ring = if side > 0 { [[0, 0], [1, 0], [1, 1], [0, 1]] } else { [[0, 0], [0, 1], [1, 1], [1, 0]] };
            let corners = ring.map(|[a, b]| {
                let mut key = [0; 3];
                key[axis] = side * n;
                key[(axis + 1) % 3] = 2 * (i + a) - n;
                key[(axis + 2) % 3] = 2 * (j + b) - n;
                let p = DVec3::from_array(key.map(|k| k as f64)).normalize();
                let known = heights.iter().find(|(k, _)| *k == key).map(|k| k.1);
                let h = known.unwrap_or_else(|| {
                    let h = p * (0.3 + 0.2 * random.0.unit()) + 0.06 * random.point();
                    heights.push((key, h));
                    h
                });
                Corner { p, h, q: p, dw: 1.0, jitter: 1.0 }
            });
            let [a, b, c, d] = corners;
            match PatchBox::new(&corners) {
                Ok(patch) if (i + j) % 4 != 0 => boxes.push(ShellBox::Patch(Box::new(patch))),
                _ => boxes.extend([[a, b, c], [a, c, d]].iter().filter_map(ShellBox::new)),
            }
        }
    }
    boxes
}

/// Rays through a closed shell: neighbours neither overlap nor leave a gap, be they patches or triangles.
#[test]
fn a_closed_shell_of_patches_is_watertight() {
    let mut random = Random(SplitMix64::new(4));
    let boxes = ball(3, &mut random);
    assert!(boxes.iter().filter(|b| matches!(b, ShellBox::Patch(_))).count() >= 36);
    let (mut joints, mut leaps) = (0u64, 0u64);
    for _ in 0..60_000 {
        let from = 3.0 * random.point();
        let dir = (1.2 * random.point() - from).normalize();
        let ray = Ray { origin: from - 4.0 * dir, dir };
        let mut spans = Vec::new();
        for b in &boxes {
            if b.bounds().hit(ray.origin, 1.0 / ray.dir, 0.0, f64::INFINITY).is_some() {
                b.spans(&ray, 0.0, f64::INFINITY, |a, b| spans.push((a, b)));
            }
        }
        spans.sort_by(|a, b| a.0.total_cmp(&b.0));
        for pair in spans.windows(2) {
            let apart = pair[1].0 - pair[0].1;
            assert!(apart > -1e-9, "overlap {pair:?}");
            if apart == 0.0 {
                // Both have the very same number for the wall between them.
                joints += 1;
                continue;
            }
            // Else the ray leaves the shell there: nothing is in any box.
            leaps += 1;
            for k in 1..8 {
                let x = ray.at(pair[0].1 + apart * f64::from(k) / 8.0);
                assert!(boxes.iter().all(|b| b.depth_inside(x) < 1e-9), "gap {pair:?}");
            }
        }
    }
    assert!(joints > 60_000 && leaps > 10_000, "{joints} {leaps}");
}

#[test]
fn a_camera_inside_starts_inside() {
    let mut random = Random(SplitMix64::new(5));
    let corners = rough_patch(&mut random, 0.1);
    let shell = ShellBox::Patch(Box::new(PatchBox::new(&corners).unwrap()));
    let ray = Ray { origin: DVec3::new(0.5, 0.5, 0.5), dir: DVec3::Z };
    let mut spans = Vec::new();
    shell.spans(&ray, 0.0, 9.0, |a, b| spans.push((a, b)));
    assert!(spans.len() == 1 && spans[0].0 == 0.0 && spans[0].1 > 0.3 && spans[0].1 < 0.7, "{spans:?}");
    // Up to a surface inside of it.
    shell.spans(&ray, 0.0, 0.1, |a, b| assert_eq!((a, b), (0.0, 0.1)));
}

#[test]
fn collapsed_and_folded_patches_are_told() {
    let flat = |heights: [f64; 4]| {
        let mut k = 0;
        SQUARE.map(|[x, y]| {
            k += 1;
            let p = DVec3::new(x, y, 0.0);
            Corner { p, h: heights[k - 1] * DVec3::Z, q: p, dw: 1.0, jitter: 1.0 }
        })
    };
    let fault = |corners: &[Corner; 4]| PatchBox::new(corners).err();
    assert_eq!(fault(&flat([1.0, 2.0, 0.5, 1.0])), None);
    assert_eq!(fault(&flat([0.0; 4])), Some(PatchFault::Folded));
    assert_eq!(fault(&flat([1.0, 1.0, -1.0, 1.0])), Some(PatchFault::Folded));
    let mut corners = flat([1.0; 4]);
    corners[2].p = corners[1].p;
    assert_eq!(fault(&corners), Some(PatchFault::Collapsed));
    corners[2].p = DVec3::new(0.1, 0.1, 0.0);
    assert_eq!(fault(&corners), Some(PatchFault::Folded));
}
