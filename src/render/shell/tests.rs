//! Boxes against oracles: dense inversion, closed shells, degenerate faces.

use super::*;
use crate::render::stress::octasphere;

/// A small deterministic source of numbers in [0, 1).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn point(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }
}

fn corner(p: DVec3, h: DVec3, q: DVec3) -> Corner {
    Corner { p, h, q, dw: 1.0, jitter: 1.0 }
}

fn pieces_of(b: &ShellBox, ray: &Ray, tolerance: f64) -> Vec<ShellSegment> {
    let mut out = Vec::new();
    let mut spans = Vec::new();
    b.spans(ray, 0.0, f64::INFINITY, |a, b| spans.push((a, b)));
    for (t0, t1) in spans {
        b.for_each_segment(ray, t0, t1, &|_, _| tolerance, &mut |p| {
            out.push(*p);
            true
        });
    }
    out
}

#[test]
fn a_prism_is_exact_under_any_affine_map() {
    let mut noise = Noise(1);
    for _ in 0..200 {
        let map = DMat3::from_cols(noise.point(), noise.point(), noise.point());
        let shift = noise.point() * 5.0;
        let at = |p: DVec3| map * p + shift;
        let c = |x: f64, y: f64| corner(at(DVec3::new(x, y, 0.0)), map.z_axis, DVec3::new(x, y, 0.0));
        let quad = Prism::new(&[c(0.0, 0.0), c(1.0, 0.0), c(1.0, 1.0), c(0.0, 1.0)]).unwrap();
        let (a, b) = (noise.point(), 0.5 * (noise.point() + DVec3::ONE));
        let ray = Ray { origin: at(a), dir: map * (b - a) };
        let want = Aabb::UNIT.hit(a, 1.0 / (b - a), 0.0, 100.0);
        let got = quad.span(&ray, 0.0, 100.0);
        match (want, got) {
            (Some((w0, w1)), Some((g0, g1))) => {
                // Error of an inverse is relative to the map's condition number, up to some thousands here.
                assert!((w0 - g0).abs() < 1e-9 && (w1 - g1).abs() < 1e-9, "{w0} {w1} {g0} {g1}");
                let q = quad.texel(ray.at(g0));
                assert!(q.distance(a + g0 * (b - a)) < 1e-9);
            }
            (None, None) => {}
            other => assert!(want.is_none_or(|(a, b)| b - a < 1e-9), "{other:?}"),
        }
    }
}

/// The oracle: invert the map by Newton in three unknowns from many starts, at many points of the ray.
#[test]
fn a_twisted_box_agrees_with_dense_inversion() {
    let mut noise = Noise(2);
    let mut tested = 0;
    while tested < 40 {
        let base = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let face = base.map(|p| corner(p + 0.1 * noise.point(), DVec3::Z + 0.35 * noise.point(), p * 2.0));
        let twisted = TwistedBox::new(&face).unwrap();
        let shell = ShellBox::Twisted(Box::new(twisted.clone()));
        let to = DVec3::new(0.3, 0.3, 0.5) + 0.2 * noise.point();
        let origin = to + noise.point().normalize() * 3.0;
        let ray = Ray { origin, dir: (to - origin).normalize() };
        let n = 4000;
        let (mut length, mut inside, mut last) = (0.0, 0.0, None::<DVec3>);
        for k in 0..n {
            let x = ray.at(6.0 * (f64::from(k) + 0.5) / f64::from(n));
            let here = newton(&twisted, x);
            if let Some(q) = here {
                inside += 6.0 / f64::from(n);
                length += last.map_or(0.0, |l| l.distance(q));
            }
            last = here;
        }
        let pieces = pieces_of(&shell, &ray, 1e-4);
        let (mut got_inside, mut got_length) = (0.0, 0.0);
        for p in &pieces {
            got_inside += p.t1 - p.t0;
            got_length += p.q0.distance(p.q1);
        }
        // The oracle loses up to a step at each end; coordinates run up to about 4 a unit of t.
        let step = 6.0 / f64::from(n);
        assert!((got_inside - inside).abs() < 2.5 * step, "{got_inside} {inside}");
        assert!((got_length - length).abs() < 16.0 * step, "{got_length} {length}");
        for pair in pieces.windows(2) {
            assert!(pair[0].t1 != pair[1].t0 || pair[0].q1 == pair[1].q0);
        }
        tested += 1;
    }
}

fn newton(b: &TwistedBox, x: DVec3) -> Option<DVec3> {
    for start in [0.5, 0.1, 0.9] {
        let mut at = BoxPoint { b: [0.33, 0.33], w: start, outside: 0.0 };
        let mut left = f64::INFINITY;
        for _ in 0..30 {
            let [p, q, r] = &b.corners;
            let here = (1.0 - at.b[0] - at.b[1]) * (p.p + at.w * p.h)
                + at.b[0] * (q.p + at.w * q.h)
                + at.b[1] * (r.p + at.w * r.h);
            let step = b.edges(at).inverse() * (x - here);
            left = step.length();
            at = BoxPoint { b: [at.b[0] + step.x, at.b[1] + step.y], w: at.w + step.z, outside: 0.0 };
        }
        let inside = at.b[0] >= 0.0 && at.b[1] >= 0.0 && at.b[0] + at.b[1] <= 1.0 && (0.0..=1.0).contains(&at.w);
        if inside && left < 1e-12 {
            return Some(b.texel(at));
        }
    }
    None
}

/// A closed shell: an octahedron cut finer, with heights that differ at every corner or agree on some faces.
fn ball(cuts: u32, noise: &mut Noise, rough: f64) -> Vec<[Corner; 3]> {
    let mut heights: Vec<(DVec3, DVec3)> = Vec::new();
    octasphere(cuts)
        .iter()
        .map(|f| {
            f.map(|p| {
                let known = heights.iter().find(|(q, _)| *q == p).map(|k| k.1);
                let h = known.unwrap_or_else(|| {
                    let h = p * (0.3 + rough * noise.next()) + 0.3 * rough * noise.point();
                    heights.push((p, h));
                    h
                });
                corner(p, h, p)
            })
        })
        .collect()
}

/// Where the ray is between the two surfaces, from the crossings of their triangles alone.
fn between(faces: &[[Corner; 3]], ray: &Ray) -> Vec<f64> {
    let mut t = Vec::new();
    for f in faces {
        for tri in [f.map(|c| c.p), f.map(|c| c.p + c.h)] {
            let n = (tri[1] - tri[0]).cross(tri[2] - tri[0]);
            let at = n.dot(tri[0] - ray.origin) / n.dot(ray.dir);
            let x = ray.at(at);
            if (0..3).all(|k| (tri[(k + 1) % 3] - tri[k]).cross(x - tri[k]).dot(n) >= 0.0) {
                t.push(at);
            }
        }
    }
    t.sort_by(f64::total_cmp);
    t
}

/// A hundred thousand rays through a closed shell: the boxes' intervals neither overlap nor leave a gap.
#[test]
fn a_closed_shell_is_watertight() {
    let mut noise = Noise(3);
    let faces = ball(2, &mut noise, 0.25);
    let boxes: Vec<ShellBox> = faces.iter().map(|f| ShellBox::new(f).unwrap()).collect();
    let mut skipped = 0;
    for _ in 0..100_000 {
        let origin = noise.point() * 3.0;
        let dir = (noise.point() * 1.2 - origin).normalize();
        let ray = Ray { origin: origin - 4.0 * dir, dir };
        let mut spans = Vec::new();
        for b in &boxes {
            if b.bounds().hit(ray.origin, 1.0 / ray.dir, 0.0, f64::INFINITY).is_some() {
                b.spans(&ray, 0.0, f64::INFINITY, |a, b| spans.push((a, b)));
            }
        }
        spans.sort_by(|a, b| a.0.total_cmp(&b.0));
        let truth = between(&faces, &ray);
        if !truth.len().is_multiple_of(2) {
            skipped += 1; // The oracle, not the shell, met an edge of the triangulated surface.
            continue;
        }
        let want: f64 = truth.chunks(2).map(|p| p[1] - p[0]).sum();
        let got: f64 = spans.iter().map(|s| s.1 - s.0).sum();
        // Rounding of t (about 10) times the number of crossings.
        assert!((want - got).abs() < 1e-9, "{want} {got} {spans:?} {truth:?}");
        for pair in spans.windows(2) {
            assert!(pair[1].0 - pair[0].1 > -1e-9, "overlap {pair:?}");
        }
        let joints = spans.windows(2).filter(|p| p[0].1 == p[1].0).count();
        let gaps = spans.len().saturating_sub(1) - joints;
        // Each wall crossed once, by the very same number on both its sides; only true leaps into the open are gaps.
        assert!(gaps < (truth.len() / 2).max(1) || spans.iter().any(|s| s.1 - s.0 < 1e-7), "{spans:?} {truth:?}");
    }
    assert!(skipped < 10);
}

#[test]
fn a_camera_inside_starts_inside() {
    let face = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|p| corner(p, DVec3::Z, p));
    let ray = Ray { origin: DVec3::new(0.2, 0.2, 0.5), dir: DVec3::Z };
    let mut spans = Vec::new();
    ShellBox::new(&face).unwrap().spans(&ray, 0.0, 9.0, |a, b| spans.push((a, b)));
    assert_eq!(spans, [(0.0, 0.5)]);
}

#[test]
fn folded_and_flat_boxes_are_told() {
    let p = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let up = |h: [f64; 3]| [0, 1, 2].map(|k| corner(p[k], DVec3::Z * h[k], p[k]));
    assert!(ShellBox::new(&up([0.0; 3])).is_none());
    assert!(!TwistedBox::new(&up([1.0, 2.0, 0.5])).unwrap().folded());
    assert!(TwistedBox::new(&up([1.0, 2.0, -0.5])).unwrap().folded());
    let line = [0.0, 1.0, 2.0].map(|x| corner(DVec3::X * x, DVec3::Z, DVec3::ZERO));
    assert!(ShellBox::new(&line).is_none());
    // A folded box gives intervals that end, and no endless loop.
    let folded = ShellBox::new(&up([1.0, 2.0, -0.5])).unwrap();
    let ray = Ray { origin: DVec3::new(-1.0, 0.2, 0.2), dir: DVec3::X };
    folded.spans(&ray, 0.0, 9.0, |a, b| assert!(a <= b && b <= 9.0));
}
