//! Bodies whose area, volume, projected areas and shape are known, as recipes.

use std::f64::consts::PI;

use vtex::geom::DVec3;

/// Whether a ray from a point along a unit direction meets the body.
type Hits = Box<dyn Fn(DVec3, DVec3) -> bool>;
/// ∫ |n · w| / 2 over the surface, along a unit direction w; of convex bodies what they cover.
type Sigma = Box<dyn Fn(DVec3) -> f64>;

/// A body in source space, +Y up.
pub struct Body {
    pub name: &'static str,
    pub recipe: String,
    pub area: f64,
    /// Enclosed; none of a sheet.
    pub volume: Option<f64>,
    pub sigma: Sigma,
    pub hits: Hits,
}

const CENTRE: DVec3 = DVec3::new(0.1, -0.2, 0.3);
/// A unit vector along no axis.
const AXIS: DVec3 = DVec3::new(0.48, 0.6, 0.64);

pub fn all() -> Vec<Body> {
    vec![sphere(), ellipsoid(), cylinder(), cone(), torus(), blend(), plane()]
}

fn list(p: DVec3) -> String {
    format!("[{}, {}, {}]", p.x, p.y, p.z)
}

/// Whether `inside`, a function below 0 within a body that a ball of `radius` about `centre` holds, falls below 0 on the ray:
/// its least value among samples, and between the samples around that.
fn dips(centre: DVec3, radius: f64, origin: DVec3, dir: DVec3, inside: impl Fn(DVec3) -> f64) -> bool {
    let to = centre - origin;
    let middle = to.dot(dir);
    let half2 = radius * radius - (to.length_squared() - middle * middle);
    if half2 <= 0.0 {
        return false;
    }
    let (from, step) = (middle - half2.sqrt(), half2.sqrt() / 32.0);
    let at = |t: f64| inside(origin + t * dir);
    let values: Vec<f64> = (0..=64).map(|i| at(from + f64::from(i) * step)).collect();
    (0..=64usize).any(|i| {
        let least = values[i.saturating_sub(1)].min(values[(i + 1).min(64)]);
        if values[i] > least || values[i] > 3.0 * step {
            return values[i] < 0.0;
        }
        let (mut lo, mut hi) = (from + (i as f64 - 1.0) * step, from + (i as f64 + 1.0) * step);
        for _ in 0..40 {
            let (a, b) = (lo + (hi - lo) / 3.0, hi - (hi - lo) / 3.0);
            (lo, hi) = if at(a) < at(b) { (lo, b) } else { (a, hi) };
        }
        at(0.5 * (lo + hi)) < 0.0
    })
}

fn sphere() -> Body {
    Body {
        name: "sphere",
        recipe: format!("sphere = {{ centre = {}, radius = 0.7 }}", list(CENTRE)),
        area: 4.0 * PI * 0.49,
        volume: Some(4.0 / 3.0 * PI * 0.343),
        sigma: Box::new(|_| PI * 0.49),
        hits: Box::new(|o, d| (o - CENTRE).cross(d).length() < 0.7),
    }
}

/// An oblate spheroid of radii 1, 1 and 1/2, the short one along [`AXIS`].
fn ellipsoid() -> Body {
    // Turned about z, then x is left: rotate = { axis, degrees } takes +y to AXIS.
    let turn = DVec3::Y.cross(AXIS).normalize();
    let e = 0.75f64.sqrt();
    // Along the axis the body is stretched to a unit ball.
    let ball = |p: DVec3| p + AXIS * AXIS.dot(p);
    Body {
        name: "ellipsoid",
        recipe: format!(
            "ellipsoid = {{ radii = [1, 0.5, 1] }}\nrotate = {{ axis = {}, degrees = {} }}",
            list(turn),
            AXIS.y.acos().to_degrees()
        ),
        area: 2.0 * PI * (1.0 + 0.25 / e * e.atanh()),
        volume: Some(2.0 / 3.0 * PI),
        // π √((bc x)² + (ac y)² + (ab z)²).
        sigma: Box::new(|w| {
            let along = AXIS.dot(w);
            PI * (along * along + 0.25 * (1.0 - along * along)).sqrt()
        }),
        hits: Box::new(move |o, d| ball(o).cross(ball(d).normalize()).length() < 1.0),
    }
}

fn cylinder() -> Body {
    let (r, h) = (0.4, 1.2);
    Body {
        name: "cylinder",
        recipe: format!("cylinder = {{ from = {}, to = {}, radius = {r} }}", list(CENTRE), list(CENTRE + h * AXIS)),
        area: 2.0 * PI * r * (r + h),
        volume: Some(PI * r * r * h),
        sigma: Box::new(move |w| {
            let along = AXIS.dot(w).abs();
            PI * r * r * along + 2.0 * r * h * (1.0 - along * along).max(0.0).sqrt()
        }),
        hits: Box::new(move |o, d| {
            dips(CENTRE + 0.5 * h * AXIS, 0.75, o, d, |p| {
                let along = AXIS.dot(p - CENTRE);
                ((p - CENTRE) - along * AXIS).length().max(r + (along - 0.5 * h).abs() - 0.5 * h) - r
            })
        }),
    }
}

fn cone() -> Body {
    let (r, h) = (0.6, 1.2);
    Body {
        name: "cone",
        recipe: format!("cone = {{ from = {}, to = {}, radii = [{r}, 0] }}", list(CENTRE), list(CENTRE + h * AXIS)),
        area: PI * r * (r + (r * r + h * h).sqrt()),
        volume: Some(PI * r * r * h / 3.0),
        // The hull of the base's ellipse and the apex, which is D of the ellipse's short radii away.
        sigma: Box::new(move |w| {
            let along = AXIS.dot(w).abs();
            let apex = h * (1.0 - along * along).max(0.0).sqrt();
            if apex <= r * along {
                return PI * r * r * along;
            }
            let d = apex / (r * along).max(1e-12);
            r * r * along.max(1e-12 / r) * ((d * d - 1.0).sqrt() + PI - (1.0 / d).acos())
        }),
        hits: Box::new(move |o, d| {
            let slant = (r * r + h * h).sqrt();
            dips(CENTRE + 0.5 * h * AXIS, 0.9, o, d, |p| {
                let along = AXIS.dot(p - CENTRE);
                let across = ((p - CENTRE) - along * AXIS).length();
                ((across * h - r * (h - along)) / slant).max(-along)
            })
        }),
    }
}

/// A body of revolution about [`AXIS`]: its profile as closed polygon of (distance from the axis, height).
fn revolved(profile: &[[f64; 2]]) -> (f64, f64, Sigma) {
    let edges = |profile: &[[f64; 2]]| -> Vec<[[f64; 2]; 2]> {
        (0..profile.len()).map(|i| [profile[i], profile[(i + 1) % profile.len()]]).collect()
    };
    let edges = edges(profile);
    let length = |[a, b]: &[[f64; 2]; 2]| (b[0] - a[0]).hypot(b[1] - a[1]);
    let area = edges.iter().map(|e| PI * (e[0][0] + e[1][0]) * length(e)).sum();
    // Cones: π h (a² + ab + b²) / 3.
    let volume: f64 =
        edges.iter().map(|[a, b]| PI * (b[1] - a[1]) * (a[0] * a[0] + a[0] * b[0] + b[0] * b[0]) / 3.0).sum();
    let sigma = move |w: DVec3| {
        let along = AXIS.dot(w);
        let across = (1.0 - along * along).max(0.0).sqrt();
        let turns = 256;
        let of = |[a, b]: &[[f64; 2]; 2]| {
            // The normal of the profile's edge times its length, and the circle that it goes round.
            let (out, up) = (b[1] - a[1], a[0] - b[0]);
            let mean: f64 = (0..turns)
                .map(|i| (out * across * (2.0 * PI * (f64::from(i) + 0.5) / f64::from(turns)).cos() + up * along).abs())
                .sum::<f64>()
                / f64::from(turns);
            0.5 * PI * (a[0] + b[0]) * mean
        };
        edges.iter().map(of).sum()
    };
    (area, volume.abs(), Box::new(sigma))
}

fn torus() -> Body {
    let (big, small) = (1.0, 0.4);
    let n = 720;
    // A polygon that has the circle's perimeter to (π/n)²/6: 3e-6.
    let profile: Vec<[f64; 2]> = (0..n)
        .map(|i| 2.0 * PI * f64::from(i) / f64::from(n))
        .map(|a| [big + small * a.cos(), small * a.sin()])
        .collect();
    let (_, _, sigma) = revolved(&profile);
    Body {
        name: "torus",
        recipe: format!(
            "torus = {{ centre = {}, axis = {}, radius = {big}, thickness = {small} }}",
            list(CENTRE),
            list(AXIS)
        ),
        area: 4.0 * PI * PI * big * small,
        volume: Some(2.0 * PI * PI * big * small * small),
        sigma,
        hits: Box::new(move |o, d| {
            dips(CENTRE, 1.41, o, d, |p| {
                let along = AXIS.dot(p - CENTRE);
                (((p - CENTRE) - along * AXIS).length() - big).hypot(along) - small
            })
        }),
    }
}

/// Points on a circle whose Gaussian potentials melt together to a ring: with 48 of them, .13 apart and .35 wide, the ring is
/// one of revolution to e^−70.
fn blend() -> Body {
    const COUNT: u32 = 48;
    let (weight, radius, level) = (0.2, 0.35, 0.5);
    let (a, b) = AXIS.any_orthonormal_pair();
    let points: Vec<DVec3> = (0..COUNT)
        .map(|i| 2.0 * PI * f64::from(i) / f64::from(COUNT))
        .map(|angle| CENTRE + angle.cos() * a + angle.sin() * b)
        .collect();
    let elements: Vec<String> =
        points.iter().map(|p| format!("{{ point = {}, weight = {weight} }}", list(*p))).collect();
    let potential = move |p: DVec3| -> f64 {
        points.iter().map(|q| weight * (-(p - *q).length_squared() / (radius * radius)).exp()).sum()
    };
    let n = 720usize;
    // How far the surface is from the circle, by the angle about it.
    let reach: Vec<f64> = (0..n)
        .map(|i| {
            let angle = 2.0 * PI * i as f64 / n as f64;
            let (mut lo, mut hi) = (0.0, 0.9);
            for _ in 0..50 {
                let t = 0.5 * (lo + hi);
                let at = CENTRE + (1.0 + t * angle.cos()) * a + t * angle.sin() * AXIS;
                (lo, hi) = if potential(at) > level { (t, hi) } else { (lo, t) };
            }
            lo
        })
        .collect();
    let corner = |(i, t): (usize, &f64)| {
        let angle = 2.0 * PI * i as f64 / n as f64;
        [1.0 + t * angle.cos(), t * angle.sin()]
    };
    let profile: Vec<[f64; 2]> = reach.iter().enumerate().map(corner).collect();
    let (area, volume, sigma) = revolved(&profile);
    Body {
        name: "torus-like blend",
        recipe: format!(
            "implicit = {{ kind = \"skeleton\", kernel = \"gaussian\", radius = {radius}, level = {level}, elements = [{}] }}",
            elements.join(", ")
        ),
        area,
        volume: Some(volume),
        sigma,
        hits: Box::new(move |o, d| {
            dips(CENTRE, 1.4, o, d, |p| {
                let along = AXIS.dot(p - CENTRE);
                let out = ((p - CENTRE) - along * AXIS).length() - 1.0;
                let turn = along.atan2(out).rem_euclid(2.0 * PI) / (2.0 * PI) * n as f64;
                let (i, share) = (turn as usize % n, turn.fract());
                out.hypot(along) - (reach[i] + share * (reach[(i + 1) % n] - reach[i]))
            })
        }),
    }
}

/// A sheet across the cube from −1 to 1.
fn plane() -> Body {
    let normal = DVec3::new(2.0, 3.0, 6.0) / 7.0;
    let point = DVec3::new(0.05, 0.0, 0.1);
    // Where n · p = d cuts the unit cube: Σ ± (d − n · corner)₊² / (2 n₁ n₂ n₃).
    let d = (normal.dot(point) + normal.element_sum()) / 2.0;
    let corners = (0..8u32).map(|i| {
        let corner = DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2));
        let sign = if i.count_ones() % 2 == 0 { 1.0 } else { -1.0 };
        sign * (d - normal.dot(corner)).max(0.0).powi(2)
    });
    let area = 4.0 * corners.sum::<f64>() / (2.0 * normal.element_product());
    Body {
        name: "plane",
        recipe: format!("plane = {{ point = {}, normal = {} }}", list(point), list(normal)),
        area,
        volume: None,
        sigma: Box::new(move |w| area * normal.dot(w).abs()),
        hits: Box::new(move |o, d| {
            let across = normal.dot(d);
            across != 0.0 && (o + (point - o).dot(normal) / across * d).abs().max_element() < 1.0
        }),
    }
}
