//! Boxes of shells: that they fill a closed shell without gap or overlap, and what they do where they are degenerate.

use super::{Random, Tally};
use crate::geom::{Aabb, DAffine3, DMat3, DVec3, Ray};
use crate::render::shell::{Corner, Prism, ShellBox, ShellSegment};

/// How far two numbers along a ray may be apart that ought to be one, in units in which the scene is about 1 across.
pub const APART: f64 = 1e-9;

/// Spans of all boxes along a ray, by where they begin, with the box.
pub fn spans(boxes: &[ShellBox], ray: &Ray, tally: &mut Tally) -> Vec<(f64, f64, usize)> {
    let inverse = ray.dir.recip();
    let mut all = Vec::new();
    for (i, b) in boxes.iter().enumerate() {
        let bounds = b.bounds();
        let padded = Aabb::new(bounds.min - APART, bounds.max + APART);
        if padded.hit(ray.origin, inverse, 0.0, f64::INFINITY).is_none() {
            continue;
        }
        let mut last = 0.0;
        b.spans(ray, 0.0, f64::INFINITY, |from, to| {
            tally.nan += u64::from(!(from.is_finite() && to.is_finite() && from >= 0.0 && from <= to));
            tally.leaks += u64::from(from < last);
            last = to;
            all.push((from, to, i));
        });
    }
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all
}

/// What spans are together.
pub struct Joined {
    /// Length of their union.
    pub length: f64,
    /// The longest stretch in a box that no span has, and the longest that is in two boxes.
    pub missing: f64,
    pub twice: f64,
}

/// Stretches within rounding of a wall do not count: a ray that runs in a wall has two right answers.
pub fn joined(boxes: &[ShellBox], ray: &Ray, spans: &[(f64, f64, usize)]) -> Joined {
    let inside = |from: f64, to: f64| {
        let middle = ray.at(0.5 * (from + to));
        boxes.iter().filter(|b| b.depth_inside(middle) > 1e-6).count()
    };
    let mut all = Joined { length: 0.0, missing: 0.0, twice: 0.0 };
    let mut reached = f64::NEG_INFINITY;
    for &(from, to, _) in spans {
        if from < reached {
            let end = reached.min(to);
            if end - from > all.twice && inside(from, end) > 1 {
                all.twice = end - from;
            }
        } else if from > reached && reached.is_finite() && from - reached > all.missing && inside(reached, from) > 0 {
            all.missing = from - reached;
        }
        all.length += (to - from.max(reached)).max(0.0);
        reached = reached.max(to);
    }
    all
}

/// Length of a ray within boxes that fill a room without gap or overlap; where they do not, beyond `tolerance`, it is counted.
fn length(boxes: &[ShellBox], ray: &Ray, tolerance: f64, tally: &mut Tally) -> f64 {
    let spans = spans(boxes, ray, tally);
    let Joined { length, missing, twice } = joined(boxes, ray, &spans);
    tally.leaks += u64::from(missing > tolerance || twice > tolerance);
    tally.worst_step = tally.worst_step.max(missing).max(twice);
    length
}

/// The place of everything: a shape in the unit cube brought to where it is to be, then as the renderer has it, relative to
/// the eye and in units of the scene's size.
pub struct Placing {
    map: DMat3,
    scale: f64,
    shift: DVec3,
    eye: DVec3,
    unit: f64,
}

impl Placing {
    pub fn new(random: &mut Random) -> Placing {
        let (scale, shift) = match random.below(4) {
            0 => (1.0, 1e7 * random.direction()),
            // Smaller than a centimetre and so far away, there are not digits enough in an f64 for a shape.
            1 => (random.magnitude(-2.0, 6.0), 1e7 * random.direction()),
            2 => (1.0, DVec3::ZERO),
            _ => (random.magnitude(-6.0, 6.0), DVec3::ZERO),
        };
        let mut map = DMat3::IDENTITY;
        if random.once_in(2) {
            // Sheared and mirrored, up to a hundred times flatter than wide.
            let flat = DVec3::new(1.0, 1.0, random.magnitude(-2.0, 0.0));
            let mut shear = DMat3::IDENTITY;
            shear.y_axis.x = random.between(-2.0, 2.0);
            shear.z_axis.x = random.between(-2.0, 2.0);
            map = shear * DMat3::from_diagonal(flat);
            if random.once_in(2) {
                map.x_axis = -map.x_axis;
            }
        }
        let eye = shift + scale * 3.0 * random.direction();
        // As the scene has it: a power of two not below its reach.
        let unit = libm::exp2(libm::log2(8.0 * scale).ceil());
        Placing { map, scale, shift, eye, unit }
    }

    /// World positions are sums in f64, of which a scene far away keeps as many digits as it does.
    pub fn at(&self, p: DVec3) -> DVec3 {
        (self.scale * (self.map * p) + self.shift - self.eye) / self.unit
    }

    pub fn along(&self, v: DVec3) -> DVec3 {
        self.scale * (self.map * v) / self.unit
    }

    /// How far rounding of world positions may move a point, in the renderer's units.
    pub fn rounding(&self) -> f64 {
        APART + 8.0 * f64::EPSILON * (self.shift.length() + self.scale) / self.unit
    }
}

/// Faces of an octahedron in the unit sphere, each cut in four `cuts` times, with every corner on the sphere.
pub fn octasphere(cuts: u32) -> Vec<[DVec3; 3]> {
    let mut faces: Vec<[DVec3; 3]> = Vec::new();
    for s in 0..8 {
        let sign = |k: u32| if s >> k & 1 == 0 { 1.0 } else { -1.0 };
        let f = [DVec3::X * sign(0), DVec3::Y * sign(1), DVec3::Z * sign(2)];
        faces.push(if sign(0) * sign(1) * sign(2) > 0.0 { f } else { [f[0], f[2], f[1]] });
    }
    for _ in 0..cuts {
        faces = faces
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = ((a + b).normalize(), (b + c).normalize(), (c + a).normalize());
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    faces
}

/// An [`octasphere`] with rough heights that are one per vertex.
fn ball(cuts: u32, random: &mut Random, rough: f64, place: &Placing) -> Vec<[Corner; 3]> {
    let mut heights: Vec<(DVec3, DVec3)> = Vec::new();
    let mut corner = |p: DVec3| {
        let known = heights.iter().find(|k| k.0 == p).map(|k| k.1);
        let h = known.unwrap_or_else(|| {
            let h = p * (0.3 + rough * random.unit()) + 0.3 * rough * random.point();
            heights.push((p, h));
            h
        });
        Corner { p: place.at(p), h: place.along(h), q: p, dw: 1.0, jitter: 1.0 }
    };
    octasphere(cuts).iter().map(|f| f.map(&mut corner)).collect()
}

pub fn shells(random: &mut Random, rays: u64) -> Tally {
    let place = Placing::new(random);
    let cuts = random.below(3) as u32;
    let faces = ball(cuts, random, 0.25, &place);
    let boxes: Vec<ShellBox> = faces.iter().filter_map(ShellBox::new).collect();
    let mut tally = Tally { rays, ..Tally::default() };
    // Positions of a scene far away and small have lost so many digits that boxes may be flat.
    let tolerance = place.rounding();
    if boxes.len() < faces.len() {
        return tally;
    }
    for _ in 0..rays {
        let target = |random: &mut Random| {
            let f = &faces[random.below(faces.len() as u64) as usize];
            let (i, w) = (random.below(3) as usize, random.below(3) as f64 * 0.5);
            let on = |i: usize| f[i % 3].p + w * f[i % 3].h;
            match random.below(4) {
                // A vertex, an edge, an inner point of a wall or of a face.
                0 => on(i),
                1 => on(i).lerp(on(i + 1), random.unit()),
                2 => f[i].p.lerp(f[(i + 1) % 3].p, 0.5) + random.unit() * f[i].h.lerp(f[(i + 1) % 3].h, 0.5),
                _ => (on(0) + on(1) + on(2)) / 3.0,
            }
        };
        let to = target(random);
        let from = match random.below(4) {
            // Inside of a box, another target, or the eye.
            0 => target(random),
            1 => place.at(0.3 * random.point()),
            2 => DVec3::ZERO,
            _ => place.at(3.0 * random.point()),
        };
        let Some(dir) = (to - from).try_normalize() else { continue };
        let ray = Ray { origin: from, dir };
        let got = length(&boxes, &ray, tolerance, &mut tally);
        if let Some(want) = between(&faces, &ray, tolerance) {
            let off = tally.measure(got, want);
            tally.deviations += u64::from(off.is_nan() || off > 1e3 * tolerance);
        }
    }
    tally
}

/// How long the ray is between the two surfaces, from the crossings of their triangles alone; `None` where it passes an
/// edge or a vertex so near that a triangle's test cannot tell, or runs along a triangle.
fn between(faces: &[[Corner; 3]], ray: &Ray, tolerance: f64) -> Option<f64> {
    let mut t = Vec::new();
    for f in faces {
        for tri in [f.map(|c| c.p), f.map(|c| c.p + c.h)] {
            let n = (tri[1] - tri[0]).cross(tri[2] - tri[0]);
            let size = n.length();
            let slope = n.dot(ray.dir) / size;
            let height = n.dot(tri[0] - ray.origin) / size;
            let at = height / slope;
            let x = ray.at(at);
            // Distances from the edges, in the triangle's plane.
            let least = (0..3)
                .map(|k| {
                    let e = tri[(k + 1) % 3] - tri[k];
                    e.cross(x - tri[k]).dot(n) / (size * e.length())
                })
                .fold(f64::INFINITY, f64::min);
            if slope.abs() < 1e-4 {
                // Nearly along it: only where it is far away does that not matter.
                let middle = (tri[0] + tri[1] + tri[2]) / 3.0;
                if (middle - ray.origin).cross(ray.dir).length() < 2.0 * size.sqrt() {
                    return None;
                }
                continue;
            }
            if least.is_nan() || least.abs() < 1e4 * tolerance {
                return None;
            }
            if least > 0.0 {
                if at.abs() < 1e4 * tolerance {
                    return None;
                }
                t.push(at);
            }
        }
    }
    t.sort_by(f64::total_cmp);
    if t.len() % 2 == 1 {
        return None;
    }
    Some(t.chunks(2).map(|p| p[1].max(0.0) - p[0].max(0.0)).sum())
}

/// A flat grid of prisms over squares, whole or as two triangles, in any affine place.
struct Slab {
    /// Squares along a side.
    squares: f64,
    boxes: Vec<ShellBox>,
    /// The unit cube → the renderer's space, and back.
    map: DAffine3,
    inverse: DAffine3,
    tolerance: f64,
}

impl Slab {
    fn new(random: &mut Random) -> Slab {
        let n = 1 + random.below(4) as u32;
        let place = Placing::new(random);
        let height = DVec3::new(random.between(-0.5, 0.5), random.between(-0.5, 0.5), random.magnitude(-2.0, 0.5));
        let corner = |i: u32, j: u32| {
            let p = DVec3::new(f64::from(i), f64::from(j), 0.0) / f64::from(n);
            Corner { p: place.at(p), h: place.along(height), q: p, dw: 1.0, jitter: 1.0 }
        };
        let mut boxes = Vec::new();
        for i in 0..n {
            for j in 0..n {
                let f = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
                let whole = if random.once_in(2) { Prism::new(&f) } else { None };
                match whole {
                    Some(prism) => boxes.push(ShellBox::Prism(Box::new(prism))),
                    None => boxes.extend([[f[0], f[1], f[2]], [f[0], f[2], f[3]]].iter().filter_map(ShellBox::new)),
                }
            }
        }
        let matrix3 = DMat3::from_cols(place.along(DVec3::X), place.along(DVec3::Y), place.along(height));
        let map = DAffine3 { matrix3, translation: place.at(DVec3::ZERO) };
        let inverse = DAffine3 { matrix3: matrix3.inverse(), translation: -(matrix3.inverse() * map.translation) };
        Slab { squares: f64::from(n), boxes, map, inverse, tolerance: place.rounding() * 1e2 }
    }

    /// A ray towards a point of the slab, often one on a wall, and along a wall.
    fn ray(&self, random: &mut Random) -> Option<Ray> {
        let inside = |random: &mut Random| {
            let mut b = DVec3::new(random.unit(), random.unit(), random.unit());
            for k in 0..2 {
                if random.once_in(2) {
                    b[k] = (b[k] * self.squares).round() / self.squares;
                }
            }
            b
        };
        let (a, mut b) = (if random.once_in(3) { inside(random) } else { 4.0 * random.point() }, inside(random));
        if random.once_in(4) {
            // Along a wall.
            let axis = random.below(2) as usize;
            b[axis] = a[axis];
        }
        let [from, to] = [a, b].map(|p| self.map.matrix3 * p + self.map.translation);
        Some(Ray { origin: from, dir: (to - from).try_normalize()? })
    }

    /// Length of a ray within the slab: of the slab shrunk by rounding, as it is, and grown. `None` where one cannot tell which
    /// box the ray is in, as along the line of a vertex.
    fn lengths(&self, ray: &Ray) -> Option<[f64; 3]> {
        let origin = self.inverse.transform_point3(ray.origin);
        let inverse_dir = self.inverse.transform_vector3(ray.dir).recip();
        let hit = |room: Aabb| room.hit(origin, inverse_dir, 0.0, f64::INFINITY);
        let grown = |by: f64| {
            let room = Aabb::new(DVec3::splat(-by), DVec3::splat(1.0 + by));
            hit(room).map_or(0.0, |(a, b)| b - a)
        };
        let m = self.inverse.matrix3;
        let largest = m.x_axis.abs().max(m.y_axis.abs()).max(m.z_axis.abs()).max_element();
        // A ray in the slab's own faces has two right answers.
        let by = 1e-9 + 1e-2 * self.tolerance * largest;
        let lengths = [grown(-by), grown(0.0), grown(by)];
        let middle = hit(Aabb::UNIT).map_or(ray.origin, |(a, b)| ray.at(0.5 * (a + b)));
        let is_nowhere = lengths[1] > 0.0 && self.boxes.iter().all(|b| b.depth_inside(middle) < 1e-6);
        (!is_nowhere).then_some(lengths)
    }
}

pub fn prisms(random: &mut Random, rays: u64) -> Tally {
    let slab = Slab::new(random);
    let mut tally = Tally { rays, ..Tally::default() };
    if !slab.inverse.matrix3.is_finite() {
        return tally;
    }
    let tolerance = slab.tolerance;
    for _ in 0..rays {
        let Some(ray) = slab.ray(random) else { continue };
        let got = length(&slab.boxes, &ray, tolerance, &mut tally);
        let Some([least, want, most]) = slab.lengths(&ray) else { continue };
        tally.deviations += u64::from(got < least - tolerance || got > most + tolerance);
        if most - least < 1e-6 {
            tally.measure(got, want);
        }
    }
    tally
}

/// One box over the triangle (0, 0), (1, 0), (0, 1) with upright heights, through an affine map: w is the height over the
/// ground by the height of the top there.
pub fn upright(random: &mut Random, rays: u64) -> Tally {
    let mut tally = Tally { rays, ..Tally::default() };
    let tops = [random.magnitude(-2.0, 1.0), random.magnitude(-2.0, 1.0), random.magnitude(-2.0, 1.0)];
    let map = loop {
        let m = DMat3::from_cols(random.point(), random.point(), random.point());
        if m.determinant().abs() > 1e-2 {
            break m;
        }
    };
    let ground = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let face = [0, 1, 2].map(|k| Corner {
        p: map * ground[k],
        h: map * (tops[k] * DVec3::Z),
        q: ground[k],
        dw: 1.0,
        jitter: 1.0,
    });
    let Some(shell) = ShellBox::new(&face) else {
        tally.nan += 1;
        return tally;
    };
    let back = map.inverse();
    for _ in 0..rays {
        let (from, to) = (4.0 * random.point(), DVec3::new(random.between(0.0, 0.5), random.between(0.0, 0.5), 0.0));
        let to = to + DVec3::Z * random.unit() * tops[0].min(tops[1]).min(tops[2]);
        let ray = Ray { origin: map * from, dir: map * (to - from) };
        let mut ends = Vec::new();
        shell.spans(&ray, 0.0, f64::INFINITY, |a, b| ends.push((a, b)));
        let contains = ends.iter().any(|e| e.0 <= 1.0 + APART && 1.0 - APART <= e.1);
        // The target lies in the box.
        tally.leaks += u64::from(!contains);
        for &(a, b) in &ends {
            let mut last: Option<ShellSegment> = None;
            shell.for_each_segment(&ray, a, b, &|_, _| 1e-3, &mut |piece| {
                for (t, q) in [(piece.t0, piece.q0), (piece.t1, piece.q1)] {
                    let x = back * ray.at(t);
                    let top = tops[0] + x.x * (tops[1] - tops[0]) + x.y * (tops[2] - tops[0]);
                    // Relative to the box's own size; flat tops magnify what is left of a height.
                    tally.compare(q.distance(DVec3::new(x.x, x.y, x.z / top)), 0.0, 1e-9);
                }
                let joined = last.is_none_or(|l| l.t1 == piece.t0 && l.q1 == piece.q0);
                tally.steps += u64::from(!joined);
                last = Some(*piece);
                true
            });
        }
    }
    tally
}

/// Boxes of which nothing is promised but that they end.
pub fn broken(random: &mut Random, rays: u64) -> Tally {
    let mut tally = Tally { rays, ..Tally::default() };
    let mut face =
        [0; 3].map(|_| Corner { p: random.point(), h: random.point(), q: random.point(), dw: 1.0, jitter: 1.0 });
    match random.below(7) {
        // A sliver, a needle, corners that agree, heights of 0, folded, huge, sheared into its own plane.
        0 => face[2].p = face[0].p.lerp(face[1].p, 0.5) + random.magnitude(-12.0, -4.0) * random.point(),
        1 => face[1].p = face[0].p + random.magnitude(-12.0, -4.0) * random.point(),
        2 => (face[1].p, face[1].h) = (face[0].p, face[0].h),
        3 => face.iter_mut().for_each(|c| c.h *= random.below(2) as f64 * random.magnitude(-12.0, 0.0)),
        4 => face[0].h = -face[1].h,
        5 => face.iter_mut().for_each(|c| c.h *= random.magnitude(0.0, 6.0)),
        _ => {
            let (a, b) = (face[1].p - face[0].p, face[2].p - face[0].p);
            face.iter_mut().for_each(|c| c.h = c.h.x * a + c.h.y * b + random.magnitude(-12.0, -3.0) * c.h);
        }
    }
    let Some(shell) = ShellBox::new(&face) else { return tally };
    let bounds = shell.bounds();
    tally.nan += u64::from(!(bounds.min.is_finite() && bounds.max.is_finite()));
    for _ in 0..rays {
        let mixed = |random: &mut Random| {
            let (a, b, w) = (random.unit(), random.unit(), random.unit());
            (1.0 - a) * (face[0].p + w * face[0].h)
                + a * (1.0 - b) * (face[1].p + w * face[1].h)
                + a * b * (face[2].p + w * face[2].h)
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
            all.push((a, b));
        });
        tally.leaks += u64::from(all.len() > 6);
        for &(a, b) in &all {
            let mut end = a;
            shell.for_each_segment(&ray, a, b, &|_, _| 1e-2, &mut |piece| {
                tally.nan += u64::from(!(piece.q0.is_finite() && piece.q1.is_finite() && piece.to_texel.is_finite()));
                tally.steps += u64::from(piece.t0 < end || piece.t1 < piece.t0 || piece.t1 > b);
                end = piece.t1;
                true
            });
        }
    }
    tally
}
