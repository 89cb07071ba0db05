//! Particles that leave a shape and fly: their trajectories as strands.
//!
//! Based on: W. Reeves, *Particle Systems — A Technique for Modeling a Class of Fuzzy Objects*, TOG 1983; W. Reeves,
//! R. Blau, *Approximate and Probabilistic Algorithms for Shading and Rendering Structured Particle Systems*, SIGGRAPH 1985
//! (grass as trajectories); M. Roberts, *The Unreasonable Effectiveness of Quasirandom Sequences*, 2018 (even spacing).

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::curve::{Section, Strand};
use crate::geom::DVec3;
use crate::random::SplitMix64;
use crate::{Error, Result};

/// Particles and the forces on them: the recipe's `[emitter]` table, with the same keys. Lengths are in source units, times in seconds.
/// Keys that end in `_jitter` are the largest deviation ± of a particle, drawn uniformly.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct EmitterSpec {
    /// Shape in or on which particles start.
    pub shape: Shape,
    /// Number of particles.
    pub count: u32,
    /// The share of seeds for which there are any particles; emitters of one seed agree.
    pub chance: f64,
    /// Whether particles start evenly spaced rather than at random.
    pub even: bool,
    /// Seed of the random choices.
    pub seed: u64,
    /// Direction in which they start to fly; by default away from the shape: up for a point and a box.
    pub direction: Option<[f64; 3]>,
    /// Half the angle of the cone about the direction, degrees.
    pub spread: f64,
    /// Speed at the start.
    pub speed: f64,
    /// ± of the speed.
    pub speed_jitter: f64,
    /// Acceleration.
    pub gravity: [f64; 3],
    /// Share of the velocity that is lost per second.
    pub drag: f64,
    /// Time that a particle flies, > 0.
    pub lifetime: f64,
    /// ± of the lifetime.
    pub lifetime_jitter: f64,
    /// Time between two points of a trajectory.
    pub time_step: f64,
    /// Standard deviation of what chance adds to each part of the velocity in a second.
    pub jitter: f64,
    /// Half widths along a life, evenly spaced.
    pub radius: Vec<f32>,
    /// ± of the radius, as a share of it.
    pub radius_jitter: f32,
    /// Linear colours along a life, evenly spaced.
    pub colour: Vec<[f32; 3]>,
    /// ± of a particle's colour, as a share of it.
    pub colour_jitter: f32,
    /// Cross-section of the trajectories.
    pub section: SectionKind,
    /// Angle between the two sheets of a V, degrees.
    pub angle: f32,
    /// Thickness of a flat section, as a share of its width.
    pub thickness: f32,
}

impl Default for EmitterSpec {
    fn default() -> Self {
        EmitterSpec {
            shape: Shape::Point { at: [0.0; 3] },
            count: 100,
            chance: 1.0,
            even: false,
            seed: 0,
            direction: None,
            spread: 20.0,
            speed: 1.0,
            speed_jitter: 0.0,
            gravity: [0.0, -9.81, 0.0],
            drag: 0.0,
            lifetime: 1.0,
            lifetime_jitter: 0.0,
            time_step: 0.05,
            jitter: 0.0,
            radius: vec![0.01],
            radius_jitter: 0.0,
            colour: Vec::new(),
            colour_jitter: 0.0,
            section: SectionKind::Round,
            angle: 70.0,
            thickness: 0.0,
        }
    }
}

/// Shape in or on which particles start.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema), schemars(rename = "EmitterShape"))]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum Shape {
    /// A point.
    Point {
        /// Where it is.
        at: [f64; 3],
    },
    /// All of a disc; `normal` by default +Y.
    Disc {
        /// Middle of the disc.
        centre: [f64; 3],
        /// Radius of the disc.
        radius: f64,
        /// Direction that the disc faces.
        #[serde(default = "upward")]
        normal: [f64; 3],
    },
    /// All of a box; a plane or a line where sides are zero.
    Box {
        /// Lower corner.
        min: [f64; 3],
        /// Upper corner.
        max: [f64; 3],
    },
    /// The surface of a sphere, or all of it.
    Sphere {
        /// Middle of the sphere.
        centre: [f64; 3],
        /// Radius of the sphere.
        radius: f64,
        /// Start anywhere in the sphere rather than on its surface.
        #[serde(default)]
        within: bool,
    },
}

fn upward() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

/// A section's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum SectionKind {
    /// Truncated cones.
    #[default]
    Round,
    /// A rectangle, of the given thickness.
    Flat,
    /// Two sheets that meet along the trajectory.
    V,
}

impl SectionKind {
    /// `angle`: degrees between the sheets of a V; `thickness`: of a flat section, as a share of its width.
    pub fn section(self, angle: f32, thickness: f32) -> Section {
        match self {
            SectionKind::Round => Section::Round,
            SectionKind::Flat => Section::Rectangular { thickness: thickness.max(0.0) },
            SectionKind::V => Section::V { angle: angle.clamp(1.0, 180.0).to_radians() },
        }
    }
}

/// Largest number of points of all trajectories together.
const MAX_POINTS: f64 = 5e7;

/// The trajectories, by particle.
///
/// # Errors
/// [`Error::Options`] on a value that is not finite or out of range, or where there were too many points.
pub fn strands(spec: &EmitterSpec) -> Result<Vec<Strand>> {
    check(spec)?;
    let section = spec.section.section(spec.angle, spec.thickness);
    if chances(spec.seed, u64::MAX).unit() >= spec.chance {
        return Ok(Vec::new());
    }
    let fly = |n: u32| {
        let mut chance = chances(spec.seed, u64::from(n));
        let (start, away) = leave(spec, n, &mut chance);
        let away = spec.direction.map_or(away, DVec3::from).try_normalize().unwrap_or(DVec3::Y);
        let speed = spec.speed + spec.speed_jitter * chance.signed();
        let velocity = speed * within_cone(away, spec.spread.to_radians(), &mut chance);
        let life = (spec.lifetime + spec.lifetime_jitter * chance.signed()).max(0.0);
        let width = 1.0 + spec.radius_jitter * chance.signed() as f32;
        let tint = 1.0 + spec.colour_jitter * chance.signed() as f32;
        let steps = (life / spec.time_step).ceil().max(1.0);
        let mut state = (start, velocity);
        let mut strand = Strand { section, ..Strand::default() };
        for i in 0..=steps as usize {
            let age = i as f64 / steps;
            strand.points.push(state.0);
            strand.radii.push(width.max(0.0) * along(&spec.radius, age, |a, b, t| a + t * (b - a)).unwrap_or(0.0));
            let mix = |a: [f32; 3], b: [f32; 3], t: f32| std::array::from_fn(|e| a[e] + t * (b[e] - a[e]));
            let colour = along(&spec.colour, age, mix).map(|[r, g, b]| [r * tint, g * tint, b * tint, 1.0]);
            strand.colours.extend(colour);
            let step = life / steps;
            if spec.jitter > 0.0 {
                let kick = spec.jitter * step.sqrt();
                state.1 += kick * DVec3::new(chance.normal(), chance.normal(), chance.normal());
            }
            state = step_on(state, DVec3::from(spec.gravity), spec.drag, step);
        }
        strand
    };
    Ok((0..spec.count).map(fly).collect())
}

/// Largest number of points that the trajectories may have.
fn points(spec: &EmitterSpec) -> f64 {
    f64::from(spec.count) * ((spec.lifetime + spec.lifetime_jitter.abs()) / spec.time_step + 2.0)
}

/// Bytes of memory that the trajectories of a valid specification take, and the curves that are made of them.
pub fn memory(spec: &EmitterSpec) -> u64 {
    // A position, a radius and a colour, twice: lists grow by doubling, and curves are made of strands.
    const POINT_BYTES: u64 = 88;
    points(spec) as u64 * POINT_BYTES + u64::from(spec.count) * size_of::<Strand>() as u64
}

/// # Errors
/// [`Error::Options`] on a value that is not finite or out of range, or where there were too many points.
pub fn check(spec: &EmitterSpec) -> Result<()> {
    let bad = |what: &str| Err(Error::Options(format!("emitter: {what}")));
    let numbers =
        [spec.chance, spec.spread, spec.speed, spec.speed_jitter, spec.drag, spec.lifetime, spec.lifetime_jitter];
    let finite = numbers.iter().chain(&spec.gravity).chain([&spec.time_step, &spec.jitter]).all(|v| v.is_finite())
        && spec.radius.iter().chain(spec.colour.iter().flatten()).all(|v| v.is_finite())
        && [spec.radius_jitter, spec.colour_jitter, spec.angle, spec.thickness].iter().all(|v| v.is_finite());
    if !finite {
        return bad("every number has to be finite");
    }
    if spec.time_step <= 0.0 || spec.lifetime < 0.0 || spec.drag < 0.0 {
        return bad("time_step has to be above 0, lifetime and drag at least 0");
    }
    if spec.radius.is_empty() || spec.radius.iter().any(|r| *r < 0.0) {
        return bad("radius is a list of at least one number, none below 0");
    }
    let points = points(spec);
    if points > MAX_POINTS {
        return bad(&format!(
            "{points:.0} points are more than {MAX_POINTS:.0}; take a longer time_step or a smaller count"
        ));
    }
    Ok(())
}

/// Start of particle `n`, and the direction away from the shape there.
fn leave(spec: &EmitterSpec, n: u32, chance: &mut SplitMix64) -> (DVec3, DVec3) {
    let random = [chance.unit(), chance.unit(), chance.unit()];
    let parts = match spec.shape {
        Shape::Point { .. } => 0,
        Shape::Box { min, max } => (0..3).filter(|&a| max[a] != min[a]).count(),
        Shape::Disc { .. } | Shape::Sphere { within: false, .. } => 2,
        Shape::Sphere { within: true, .. } => 3,
    };
    // Roots of x^(d+1) = x + 1: sequences that fill d dimensions evenly.
    let root = [1.618_033_988_749_895, 1.618_033_988_749_895, 1.324_717_957_244_746, 1.220_744_084_605_759_5][parts];
    let mut offset = chances(spec.seed, u64::MAX - 1);
    let offsets: [f64; 3] = std::array::from_fn(|_| offset.unit());
    let even = |i: usize| (offsets[i] + f64::from(n) * libm::pow(root, -(i as f64 + 1.0))).fract();
    let [a, b, c] = if spec.even { std::array::from_fn(even) } else { random };
    let sphere = || {
        let (z, angle) = (1.0 - 2.0 * a, TAU * b);
        let r = (1.0 - z * z).max(0.0).sqrt();
        DVec3::new(r * libm::cos(angle), z, r * libm::sin(angle))
    };
    match spec.shape {
        Shape::Point { at } => (DVec3::from(at), DVec3::Y),
        Shape::Disc { centre, radius, normal } => {
            let normal = DVec3::from(normal).try_normalize().unwrap_or(DVec3::Y);
            let (u, v) = normal.any_orthonormal_pair();
            let (r, angle) = (radius * a.sqrt(), TAU * b);
            (DVec3::from(centre) + r * (libm::cos(angle) * u + libm::sin(angle) * v), normal)
        }
        Shape::Box { min, max } => {
            // Sides of no length take no part of the sequence.
            let mut parts = [a, b, c].into_iter();
            let at = |axis: usize| {
                if max[axis] == min[axis] {
                    min[axis]
                } else {
                    min[axis] + parts.next().unwrap_or(0.0) * (max[axis] - min[axis])
                }
            };
            (DVec3::from([0, 1, 2].map(at)), DVec3::Y)
        }
        Shape::Sphere { centre, radius, within } => {
            let away = sphere();
            let r = if within { libm::cbrt(c) } else { 1.0 };
            (DVec3::from(centre) + radius * r * away, away)
        }
    }
}

/// A direction drawn evenly from the cone about `axis` of the half angle `half`.
fn within_cone(axis: DVec3, half: f64, chance: &mut SplitMix64) -> DVec3 {
    let (u, v) = axis.any_orthonormal_pair();
    let z = 1.0 - chance.unit() * (1.0 - libm::cos(half));
    let (r, angle) = ((1.0 - z * z).max(0.0).sqrt(), TAU * chance.unit());
    r * (libm::cos(angle) * u + libm::sin(angle) * v) + z * axis
}

/// Place and velocity after `t`, exactly: v' = gravity − drag · v.
fn step_on((at, velocity): (DVec3, DVec3), gravity: DVec3, drag: f64, t: f64) -> (DVec3, DVec3) {
    let k = drag * t;
    // (1 − e^−k) / k and (k − 1 + e^−k) / k², as series near 0.
    let (once, twice) = if k < 1e-3 {
        (1.0 - 0.5 * k + k * k / 6.0, 0.5 - k / 6.0 + k * k / 24.0)
    } else {
        (-libm::expm1(-k) / k, (k + libm::expm1(-k)) / (k * k))
    };
    (at + t * once * velocity + t * t * twice * gravity, velocity * libm::exp(-k) + t * once * gravity)
}

/// The value at `t` in [0, 1] among evenly spaced `keys`.
fn along<T: Copy>(keys: &[T], t: f64, mix: impl Fn(T, T, f32) -> T) -> Option<T> {
    let last = keys.len().checked_sub(1)?;
    let at = t.clamp(0.0, 1.0) * last as f64;
    let i = (at as usize).min(last);
    Some(mix(*keys.get(i)?, keys[(i + 1).min(last)], (at - i as f64) as f32))
}

/// Random numbers of one particle.
fn chances(seed: u64, particle: u64) -> SplitMix64 {
    let mut chance = SplitMix64::new(seed ^ particle.wrapping_mul(0xd134_2543_de82_ef95));
    chance.bits();
    chance
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_drag_a_path_is_a_parabola() {
        let spec = EmitterSpec {
            spread: 0.0,
            speed: 3.0,
            direction: Some([1.0, 1.0, 0.0]),
            lifetime: 2.0,
            count: 1,
            ..EmitterSpec::default()
        };
        let strand = &strands(&spec).unwrap()[0];
        assert_eq!(strand.points.len(), 41);
        for (i, p) in strand.points.iter().enumerate() {
            let t = 0.05 * i as f64;
            let v = 3.0 / 2.0f64.sqrt();
            assert!((*p - DVec3::new(v * t, v * t - 0.5 * 9.81 * t * t, 0.0)).length() < 1e-12);
        }
    }

    #[test]
    fn drag_is_exact_for_any_step() {
        let spec = |drag: f64, time_step: f64| EmitterSpec {
            drag,
            time_step,
            count: 1,
            lifetime: 2.0,
            ..EmitterSpec::default()
        };
        for drag in [1e-9, 1e-4, 0.02, 3.0] {
            let end = |step| *strands(&spec(drag, step)).unwrap()[0].points.last().unwrap();
            let (coarse, fine) = (end(2.0), end(0.01));
            assert!((coarse - fine).length() < 1e-9, "{drag} {coarse} {fine}");
        }
        // Falling for long, at the end by gravity / drag a second.
        let spec = EmitterSpec { drag: 10.0, lifetime: 100.0, count: 1, ..EmitterSpec::default() };
        let points = &strands(&spec).unwrap()[0].points;
        let fall = points[points.len() - 1].y - points[points.len() - 2].y;
        assert!((fall / 0.05 + 0.981).abs() < 1e-9);
    }

    #[test]
    fn particles_start_on_their_shape() {
        let shapes = [
            Shape::Sphere { centre: [1.0, 0.0, 0.0], radius: 2.0, within: false },
            Shape::Sphere { centre: [1.0, 0.0, 0.0], radius: 2.0, within: true },
            Shape::Disc { centre: [0.0; 3], radius: 2.0, normal: [1.0, 0.0, 0.0] },
            Shape::Box { min: [0.0, 0.0, 0.0], max: [1.0, 0.0, 1.0] },
        ];
        for even in [false, true] {
            for shape in shapes {
                let spec = EmitterSpec { shape, even, count: 4000, lifetime: 0.0, ..EmitterSpec::default() };
                let starts: Vec<DVec3> = strands(&spec).unwrap().iter().map(|s| s.points[0]).collect();
                let mean = starts.iter().sum::<DVec3>() / 4000.0;
                let (want, size) = match shape {
                    Shape::Box { .. } => (DVec3::new(0.5, 0.0, 0.5), 1.0),
                    Shape::Disc { .. } => (DVec3::ZERO, 2.0),
                    _ => (DVec3::X, 2.0),
                };
                // Standard error of a mean of 4000 within ± 2: .03; the even ones are far closer.
                assert!((mean - want).length() < if even { 0.01 } else { 0.1 }, "{shape:?} {mean}");
                for p in &starts {
                    let r = (*p - DVec3::X).length();
                    match shape {
                        Shape::Sphere { within: false, .. } => assert!((r - size).abs() < 1e-12),
                        Shape::Sphere { .. } => assert!(r <= size),
                        Shape::Disc { .. } => assert!(p.x.abs() < 1e-12 && p.length() <= size),
                        _ => assert!(p.y == 0.0 && p.min_element() >= 0.0 && p.max_element() <= size),
                    }
                }
            }
        }
    }

    #[test]
    fn seeds_decide_and_repeat() {
        let spec = EmitterSpec { jitter: 1.0, speed_jitter: 0.5, count: 5, seed: 7, ..EmitterSpec::default() };
        assert_eq!(strands(&spec).unwrap(), strands(&spec).unwrap());
        assert_ne!(strands(&spec).unwrap(), strands(&EmitterSpec { seed: 8, ..spec.clone() }).unwrap());
        let some = |seed| !strands(&EmitterSpec { seed, chance: 0.5, ..spec.clone() }).unwrap().is_empty();
        let share = (0..1000).filter(|&s| some(s)).count();
        // Binomial: 500 ± 16.
        assert!((420..580).contains(&share), "{share}");
    }

    #[test]
    fn radius_and_colour_go_along_the_life() {
        let spec = EmitterSpec {
            radius: vec![0.0, 0.2, 0.1],
            colour: vec![[0.0; 3], [1.0, 0.5, 0.0]],
            lifetime: 1.0,
            time_step: 0.25,
            count: 1,
            ..EmitterSpec::default()
        };
        let strand = &strands(&spec).unwrap()[0];
        let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-6);
        assert!(near(&strand.radii, &[0.0, 0.1, 0.2, 0.15, 0.1]));
        assert!(near(&strand.colours[1], &[0.25, 0.125, 0.0, 1.0]));
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        let base = EmitterSpec::default();
        for bad in [
            EmitterSpec { time_step: 0.0, ..base.clone() },
            EmitterSpec { time_step: 1e-12, ..base.clone() },
            EmitterSpec { count: u32::MAX, ..base.clone() },
            EmitterSpec { speed: f64::NAN, ..base.clone() },
            EmitterSpec { radius: vec![], ..base.clone() },
            EmitterSpec { radius: vec![-1.0], ..base.clone() },
        ] {
            assert!(matches!(strands(&bad), Err(Error::Options(_))), "{bad:?}");
        }
        let json = r#"{ "shape": { "kind": "disc", "centre": [0,0,0], "radius": 1 }, "section": "v", "sped": 1 }"#;
        assert!(serde_json::from_str::<EmitterSpec>(json).unwrap_err().to_string().contains("sped"));
        assert!(serde_json::from_str::<EmitterSpec>(&json.replace("sped", "speed")).is_ok());
    }
}
