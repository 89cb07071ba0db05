//! Boxes over bilinear patches: among their neighbours, against a closed form, and where they are folded.

use super::boxes::{APART, Joined, Placing, joined, spans};
use super::{Random, Tally};
use crate::geom::{DMat3, DVec3, Ray};
use crate::render::shell::{Corner, PatchBox, ShellBox, ShellSegment};

const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

pub fn patches(random: &mut Random, rays: u64) -> Tally {
    if random.once_in(3) { upright(random, rays) } else { closed(random, rays) }
}

/// A cube blown up to a ball, each of its faces n × n patches, of which some are two triangles; heights are one per vertex.
fn ball(random: &mut Random, place: &Placing) -> Vec<[Corner; 4]> {
    let n = 1 + random.below(3) as i64;
    let rough = 0.25;
    let mut heights: Vec<([i64; 3], DVec3)> = Vec::new();
    let mut faces = Vec::new();
    for (axis, side) in (0..3).flat_map(|axis| [(axis, 1), (axis, -1)]) {
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            let ring = if side > 0 { [[0, 0], [1, 0], [1, 1], [0, 1]] } else { [[0, 0], [0, 1], [1, 1], [1, 0]] };
            faces.push(ring.map(|[a, b]| {
                let mut key = [0; 3];
                key[axis] = side * n;
                key[(axis + 1) % 3] = 2 * (i + a) - n;
                key[(axis + 2) % 3] = 2 * (j + b) - n;
                let p = DVec3::from_array(key.map(|k| k as f64)).normalize();
                let known = heights.iter().find(|(k, _)| *k == key).map(|k| k.1);
                let h = known.unwrap_or_else(|| {
                    let h = p * (0.3 + rough * random.unit()) + 0.3 * rough * random.point();
                    heights.push((key, h));
                    h
                });
                Corner { p: place.at(p), h: place.along(h), q: p, dw: 1.0, jitter: 1.0 }
            }));
        }
    }
    faces
}

/// The boxes of a face: one over the patch, or two over its triangles where that is not to be had, or not `whole`.
fn boxes_of(face: &[Corner; 4], whole: bool) -> Vec<ShellBox> {
    let [a, b, c, d] = *face;
    match PatchBox::new(face) {
        Ok(patch) if whole => vec![ShellBox::Patch(Box::new(patch))],
        _ => [[a, b, c], [a, c, d]].iter().filter_map(ShellBox::new).collect(),
    }
}

fn closed(random: &mut Random, rays: u64) -> Tally {
    let place = Placing::new(random);
    let faces = ball(random, &place);
    let mut boxes = Vec::new();
    let mut tally = Tally { rays, ..Tally::default() };
    for face in &faces {
        let own = boxes_of(face, !random.once_in(4));
        // Positions of a scene far away and small have lost so many digits that boxes may be flat, or folded.
        let twisted = own.iter().all(|b| !matches!(b, ShellBox::Twisted(t) if t.folded()));
        if own.is_empty() || !twisted {
            return tally;
        }
        boxes.extend(own);
    }
    let tolerance = place.rounding();
    for _ in 0..rays {
        let target = |random: &mut Random| {
            let f = &faces[random.below(faces.len() as u64) as usize];
            let (i, w) = (random.below(4) as usize, random.below(3) as f64 * 0.5);
            let on = |i: usize| f[i % 4].p + w * f[i % 4].h;
            match random.below(4) {
                // A vertex, an edge, an inner point of a wall, of a face, or between them.
                0 => on(i),
                1 => on(i).lerp(on(i + 1), random.unit()),
                2 => f[i].p.lerp(f[(i + 1) % 4].p, 0.5) + random.unit() * f[i].h.lerp(f[(i + 1) % 4].h, 0.5),
                _ => on(0).lerp(on(1), random.unit()).lerp(on(3).lerp(on(2), random.unit()), random.unit()),
            }
        };
        let to = target(random);
        let from = match random.below(4) {
            0 => target(random),
            1 => place.at(0.3 * random.point()),
            2 => DVec3::ZERO,
            _ => place.at(3.0 * random.point()),
        };
        let Some(dir) = (to - from).try_normalize() else { continue };
        let ray = Ray { origin: from, dir };
        let spans = spans(&boxes, &ray, &mut tally);
        let Joined { missing, twice, .. } = joined(&boxes, &ray, &spans);
        tally.leaks += u64::from(missing > tolerance || twice > tolerance);
        tally.worst_step = tally.worst_step.max(missing).max(twice);
        for &(from, to, index) in &spans {
            follow(&boxes[index], &ray, [from, to], 1e-2, &mut tally, |_, _| {});
        }
    }
    tally
}

/// Follow a ray through a box: its chords are finite and abut; `each` sees their ends.
fn follow(
    shell: &ShellBox,
    ray: &Ray,
    [from, to]: [f64; 2],
    tolerance: f64,
    tally: &mut Tally,
    mut each: impl FnMut(&mut Tally, [(f64, DVec3); 2]),
) {
    let mut last: Option<ShellSegment> = None;
    shell.for_each_segment(ray, from, to, &|_, _| tolerance, &mut |piece| {
        tally.nan += u64::from(!(piece.q0.is_finite() && piece.q1.is_finite() && piece.to_texel.is_finite()));
        let joined = last.map_or(piece.t0 == from, |l| l.t1 == piece.t0 && l.q1 == piece.q0);
        tally.steps += u64::from(!joined || piece.t1 < piece.t0 || piece.t1 > to);
        each(tally, [(piece.t0, piece.q0), (piece.t1, piece.q1)]);
        last = Some(*piece);
        true
    });
    // All of the way is followed.
    tally.leaks += u64::from(last.is_none_or(|l| l.t1 != to));
}

/// A patch over the unit square with upright heights, through an affine map: w is the height over the ground by that of the top,
/// which is bilinear there.
fn upright(random: &mut Random, rays: u64) -> Tally {
    let mut tally = Tally { rays, ..Tally::default() };
    let tops = [0; 4].map(|_| random.magnitude(-2.0, 1.0));
    let map = loop {
        let m = DMat3::from_cols(random.point(), random.point(), random.point());
        if m.determinant().abs() > 1e-2 {
            break m;
        }
    };
    let mut k = 0;
    let face = SQUARE.map(|[x, y]| {
        let q = DVec3::new(x, y, 0.0);
        k += 1;
        Corner { p: map * q, h: map * (tops[k - 1] * DVec3::Z), q, dw: 1.0, jitter: 1.0 }
    });
    let Ok(patch) = PatchBox::new(&face) else {
        // Heights of one sign over a convex face never cross.
        tally.nan += 1;
        return tally;
    };
    let shell = ShellBox::Patch(Box::new(patch));
    let back = map.inverse();
    let top = |x: DVec3| {
        let [a, b, c, d] = tops;
        (1.0 - x.y) * ((1.0 - x.x) * a + x.x * b) + x.y * ((1.0 - x.x) * d + x.x * c)
    };
    for _ in 0..rays {
        let from = 4.0 * random.point();
        let mut to = DVec3::new(random.unit(), random.unit(), 0.0);
        to.z = random.between(0.01, 0.99) * top(to);
        let ray = Ray { origin: map * from, dir: map * (to - from) };
        let mut ends = Vec::new();
        shell.spans(&ray, 0.0, f64::INFINITY, |a, b| ends.push([a, b]));
        // The target lies in the box.
        tally.leaks += u64::from(!ends.iter().any(|e| e[0] <= 1.0 + APART && 1.0 - APART <= e[1]));
        for &span in &ends {
            follow(&shell, &ray, span, 1e-3, &mut tally, |tally, ends| {
                for (t, q) in ends {
                    let x = back * ray.at(t);
                    // Relative to the box's own size; flat tops magnify what is left of a height.
                    tally.compare(q.distance(DVec3::new(x.x, x.y, x.z / top(x))), 0.0, 1e-9);
                }
            });
        }
    }
    tally
}

/// Patches of which nothing is promised but that they, or the prisms that stand for them, end.
pub fn folds(random: &mut Random, rays: u64) -> Tally {
    let mut tally = Tally { rays, ..Tally::default() };
    let mut face = SQUARE.map(|[x, y]| {
        let p = DVec3::new(x, y, 0.0);
        Corner { p: p + 0.2 * random.point(), h: DVec3::Z + 0.2 * random.point(), q: p, dw: 1.0, jitter: 1.0 }
    });
    let tiny = random.magnitude(-12.0, -3.0);
    match random.below(9) {
        // Two corners one, or nearly; three in a row; an arrowhead; a bow tie; heights of nothing, of both signs, that cross,
        // in the face's own plane; all of it at random; huge.
        0 => face[2].p = face[1].p + f64::from(u8::from(random.once_in(2))) * tiny * random.point(),
        1 => face[2].p = face[1].p.lerp(face[3].p, 0.5) + tiny * random.point(),
        2 => face[2].p = face[0].p + 0.2 * (face[2].p - face[0].p),
        3 => face.swap(1, 2),
        4 => face.iter_mut().for_each(|c| c.h *= random.below(2) as f64 * tiny),
        5 => face[random.below(4) as usize].h *= -1.0,
        6 => face.iter_mut().for_each(|c| c.h += random.between(0.0, 8.0) * (DVec3::new(0.5, 0.5, 0.0) - c.p)),
        7 => face.iter_mut().for_each(|c| (c.p, c.h) = (random.point(), random.point())),
        _ => face.iter_mut().for_each(|c| c.h *= random.magnitude(0.0, 6.0)),
    }
    for shell in boxes_of(&face, true) {
        let bounds = shell.bounds();
        tally.nan += u64::from(!(bounds.min.is_finite() && bounds.max.is_finite()));
        for _ in 0..rays {
            let mixed = |random: &mut Random| {
                let (u, v, w) = (random.unit(), random.unit(), random.unit());
                let at = |k: usize| face[k].p + w * face[k].h;
                at(0).lerp(at(1), u).lerp(at(3).lerp(at(2), u), v)
            };
            let to = mixed(random);
            let from = if random.once_in(3) { mixed(random) } else { 3.0 * random.point() };
            let dir = if random.once_in(8) { face[1].p - face[0].p } else { to - from };
            let Some(dir) = dir.try_normalize() else { continue };
            let ray = Ray { origin: from, dir };
            let far = if random.once_in(2) { f64::INFINITY } else { 2.0 };
            let (mut last, mut all) = (0.0f64, Vec::new());
            shell.spans(&ray, 0.0, far, |a, b| {
                tally.nan += u64::from(!(a.is_finite() && b.is_finite()));
                tally.leaks += u64::from(!(last <= a && a <= b && b <= far));
                last = b;
                all.push([a, b]);
            });
            tally.leaks += u64::from(all.len() > 7);
            for &span in &all {
                if matches!(shell, ShellBox::Patch(_)) {
                    follow(&shell, &ray, span, 1e-2, &mut tally, |_, _| {});
                }
            }
        }
    }
    tally
}
