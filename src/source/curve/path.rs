//! A strand's path as straight pieces, as fine as a tolerance asks, in frames that do not twist.
//!
//! Based on: C. Yuksel et al., *Parameterization and Applications of Catmull-Rom Curves*, CAD 2011; W. Wang et al.,
//! *Computation of Rotation Minimizing Frames*, TOG 2008 (the frame turns with the path and not about it).

use super::{CurveSource, Interpolation, Line, Section};
use crate::geom::DVec3;

/// A point of a path.
#[derive(Debug, Clone, Copy)]
pub struct Station {
    pub at: DVec3,
    pub radius: f32,
    pub colour: [f32; 4],
}

/// A station that the pieces of a path run between.
#[derive(Debug, Clone, Copy)]
pub struct Knot {
    pub at: DVec3,
    /// Unit vector across the piece that begins here: along the section's width.
    pub across: [f32; 3],
    pub radius: f32,
    /// Index into the sections.
    pub section: u32,
    /// Number of sides of a round section.
    pub sides: u16,
    pub join: Join,
}

/// Joint between the piece before a knot and the piece after it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Join {
    /// The path begins.
    Start,
    /// Both pieces meet in the plane half-way between them.
    Mitre,
    /// The path turns by more than a right angle: both pieces end square, a ball between them.
    Ball,
    /// The path ends: no piece begins here.
    End,
    /// The strand is a single point: a ball.
    Alone,
}

/// Most pieces that a curve between two points is cut into.
const MAX_PIECES: f64 = 256.0;
/// A point is left out where the path stays closer than this share of the tolerance to a straight piece …
const SLACK: f64 = 0.25;
/// … that is at most so many tolerances long and at least by this factor as long as the path.
const LONGEST: f64 = 32.0;
const STRAIGHT: f64 = 0.9975;

/// The stations of `line`, nowhere more than `tolerance` (source units) away from the curve; at least one, and no two
/// neighbours at the same place.
pub fn flatten(source: &CurveSource, line: &Line, tolerance: f64) -> Vec<Station> {
    let station = |i: usize| Station { at: source.points[i], radius: source.radii[i], colour: source.colour(i) };
    let mut controls: Vec<Station> = (line.first..line.end).map(station).collect();
    controls.dedup_by(|b, a| a.at == b.at);
    if source.options.interpolation == Interpolation::Linear || controls.len() < 3 {
        return controls;
    }
    let mut out = Vec::with_capacity(4 * controls.len());
    let mirrored = |a: DVec3, b: DVec3| 2.0 * a - b;
    for i in 0..controls.len() - 1 {
        let (b, c) = (controls[i], controls[i + 1]);
        let a = i.checked_sub(1).map_or(mirrored(b.at, c.at), |j| controls[j].at);
        let d = controls.get(i + 2).map_or(mirrored(c.at, b.at), |s| s.at);
        let bezier = centripetal(a, b.at, c.at, d);
        let bend = |k: usize| (bezier[k] - 2.0 * bezier[k + 1] + bezier[k + 2]).length();
        // A chord of a 1/n piece is at most max |C''| / (8 n²) away, and |C''| ≤ 6 bends.
        let pieces = (0.75 * bend(0).max(bend(1)) / tolerance.max(1e-300)).sqrt().ceil().clamp(1.0, MAX_PIECES);
        for k in 0..pieces as usize {
            let t = k as f64 / pieces;
            let mix = |x: f32, y: f32| x + t as f32 * (y - x);
            out.push(Station {
                at: if k == 0 { b.at } else { bezier_at(&bezier, t) },
                radius: mix(b.radius, c.radius),
                colour: std::array::from_fn(|e| mix(b.colour[e], c.colour[e])),
            });
        }
    }
    out.extend(controls.last());
    out.dedup_by(|b, a| a.at == b.at);
    out
}

/// The Bézier points of the curve from `b` to `c`, where `a` and `d` are the points before and after.
fn centripetal(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> [DVec3; 4] {
    // Distances to the power of 1/2.
    let [da, db, dc] = [(b - a), (c - b), (d - c)].map(|v| v.length().sqrt());
    let inner = |a: DVec3, b: DVec3, c: DVec3, da: f64, db: f64| {
        let below = 3.0 * da * (da + db);
        if below > 0.0 {
            (da * da * c - db * db * a + (2.0 * da * da + 3.0 * da * db + db * db) * b) / below
        } else {
            b
        }
    };
    [b, inner(a, b, c, da, db), inner(d, c, b, dc, db), c]
}

fn bezier_at(p: &[DVec3; 4], t: f64) -> DVec3 {
    let s = 1.0 - t;
    s * s * s * p[0] + 3.0 * s * s * t * p[1] + 3.0 * s * t * t * p[2] + t * t * t * p[3]
}

/// Leave out stations that a straight piece between others replaces: by a share of the tolerance in place, and a 32nd in
/// radius and colour.
pub fn simplify(path: &mut Vec<Station>, tolerance: f64) {
    let (mut kept, mut from) = (1, 0);
    while from + 1 < path.len() {
        let mut to = from + 1;
        let mut length = (path[to].at - path[from].at).length();
        while to + 1 < path.len() && to - from < 16 {
            length += (path[to + 1].at - path[to].at).length();
            if !replaces(&path[from..=to + 1], length, tolerance) {
                break;
            }
            to += 1;
        }
        path[kept] = path[to];
        kept += 1;
        from = to;
    }
    path.truncate(kept);
}

fn replaces(run: &[Station], length: f64, tolerance: f64) -> bool {
    let [first, .., last] = run else { return true };
    let way = last.at - first.at;
    let chord = way.length();
    if !(chord > 0.0 && chord <= LONGEST * tolerance && chord >= STRAIGHT * length) {
        return false;
    }
    run.iter().all(|s| {
        let t = (s.at - first.at).dot(way) / (chord * chord);
        let mix = |a: f32, b: f32| a + t as f32 * (b - a);
        (s.at - first.at - t * way).length() <= SLACK * tolerance
            && (s.radius - mix(first.radius, last.radius)).abs() <= s.radius / 32.0
            && (0..4).all(|e| (s.colour[e] - mix(first.colour[e], last.colour[e])).abs() <= 1.0 / 32.0)
    })
}

/// Knots of a path. `up`: where ribbons face; `roll`: how a round section is turned about its path, radians.
pub fn knots(path: &[Station], section: (u32, Section), sides: u16, up: DVec3, roll: f64) -> Vec<Knot> {
    let knot =
        |s: &Station, join| Knot { at: s.at, across: [0.0; 3], radius: s.radius, section: section.0, sides, join };
    let ways: Vec<DVec3> = path.windows(2).map(|w| (w[1].at - w[0].at).normalize_or_zero()).collect();
    if ways.is_empty() {
        return path.iter().map(|s| knot(s, Join::Alone)).collect();
    }
    let seed = match section.1 {
        Section::Round => 0,
        // Where the path is most level, its frame is surest.
        _ => (0..ways.len()).fold(0, |best, i| {
            let level = |i: usize| ways[i].cross(up).length_squared();
            if level(i) > level(best) * (1.0 + 1e-6) { i } else { best }
        }),
    };
    let first = match section.1 {
        Section::Round => {
            let (u, v) = ways[0].any_orthonormal_pair();
            libm::cos(roll) * u + libm::sin(roll) * v
        }
        _ => up.cross(ways[seed]).try_normalize().unwrap_or_else(|| ways[seed].any_orthonormal_vector()),
    };
    let mut across = vec![first; ways.len()];
    for i in seed + 1..ways.len() {
        across[i] = turned(across[i - 1], ways[i - 1], ways[i]);
    }
    for i in (0..seed).rev() {
        across[i] = turned(across[i + 1], ways[i + 1], ways[i]);
    }
    let mut knots = Vec::with_capacity(path.len());
    for (i, station) in path.iter().enumerate() {
        let join = match i {
            0 => Join::Start,
            i if i == ways.len() => Join::End,
            i if ways[i - 1].dot(ways[i]) < 0.0 => Join::Ball,
            _ => Join::Mitre,
        };
        let across = across.get(i).map_or([0.0; 3], |a| a.as_vec3().to_array());
        knots.push(Knot { across, ..knot(station, join) });
    }
    knots
}

/// `v` after the least rotation that takes `from` to `to` (unit vectors); at right angles to `to`.
pub fn turned(v: DVec3, from: DVec3, to: DVec3) -> DVec3 {
    let (axis, cosine) = (from.cross(to), from.dot(to));
    let w = if cosine > -0.999_999 { v * cosine + axis.cross(v) + axis * (axis.dot(v) / (1.0 + cosine)) } else { v };
    (w - w.dot(to) * to).try_normalize().unwrap_or_else(|| to.any_orthonormal_vector())
}
