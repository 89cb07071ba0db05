//! Lines and points as thin round bodies, so that they cover what they should.

use crate::geom::{DAffine3, DVec3};
use crate::scene::model::{Instance, Model, Part};

/// Sides of a tube.
const SIDES: usize = 8;

/// Give the model's lines and points the width `width` (source units): each line becomes a prism of eight sides, each point
/// an octahedron, both of the mean width of the round body. Without a width they are left out; gives how many.
pub fn thicken(model: &mut Model, width: Option<f64>) -> u64 {
    let mut skipped = 0;
    let mut bodies = Vec::new();
    for instance in &model.instances {
        let part = &model.parts[instance.part];
        if part.lines.is_empty() && part.points.is_empty() {
            continue;
        }
        let Some(width) = width else {
            skipped += (part.lines.len() + part.points.len()) as u64;
            continue;
        };
        let at = |i: u32| instance.transform.transform_point3(DVec3::from(part.positions[i as usize].map(f64::from)));
        let mut body = Part { name: part.name.clone(), material: part.material, ..Part::default() };
        let colors = part.colors.as_ref();
        let mut body_colors = Vec::new();
        for &[a, b] in &part.lines {
            prism(&mut body, at(a), at(b), width);
            body_colors.resize(
                body.positions.len().saturating_sub(SIDES).max(body_colors.len()),
                colors.map_or([1.0; 4], |c| c[a as usize]),
            );
            body_colors.resize(body.positions.len(), colors.map_or([1.0; 4], |c| c[b as usize]));
        }
        for &p in &part.points {
            octahedron(&mut body, at(p), width);
            body_colors.resize(body.positions.len(), colors.map_or([1.0; 4], |c| c[p as usize]));
        }
        body.colors = colors.map(|_| body_colors);
        bodies.push((body, instance.node.clone()));
    }
    for (body, node) in bodies {
        model.instances.push(Instance { part: model.parts.len(), transform: DAffine3::IDENTITY, node });
        model.parts.push(body);
    }
    skipped
}

/// Without ends; a line of no length becomes nothing.
fn prism(body: &mut Part, a: DVec3, b: DVec3, width: f64) {
    let Some(along) = (b - a).try_normalize() else { return };
    let (u, v) = along.any_orthonormal_pair();
    // The perimeter of the polygon is the circle's, so the mean projected width is the circle's too (Cauchy).
    let half = std::f64::consts::PI / SIDES as f64;
    let radius = 0.5 * width * half / libm::sin(half);
    let first = body.positions.len() as u32;
    for end in [a, b] {
        for k in 0..SIDES {
            let angle = 2.0 * half * k as f64;
            let p = end + radius * (libm::cos(angle) * u + libm::sin(angle) * v);
            body.positions.push(p.as_vec3().to_array());
        }
    }
    let n = SIDES as u32;
    for k in 0..n {
        let (i, j) = (first + k, first + (k + 1) % n);
        body.triangles.extend([[i, j, j + n], [i, j + n, i + n]]);
    }
}

fn octahedron(body: &mut Part, p: DVec3, width: f64) {
    // The surface 4 sqrt(3) r^2 is the sphere's, pi w^2.
    let r = width * (std::f64::consts::PI / (4.0 * 3.0f64.sqrt())).sqrt();
    let first = body.positions.len() as u32;
    for d in [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z] {
        body.positions.push((p + r * d).as_vec3().to_array());
    }
    for k in 0..4 {
        let (i, j) = (first + k, first + (k + 1) % 4);
        body.triangles.extend([[i, j, first + 4], [j, i, first + 5]]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::DAffine3;

    #[test]
    fn a_line_covers_its_width() {
        let part = Part { positions: vec![[0.0; 3], [0.0, 0.0, 3.0]], lines: vec![[0, 1]], ..Part::default() };
        let instance = Instance { part: 0, transform: DAffine3::IDENTITY, node: String::new() };
        let mut model = Model { parts: vec![part], instances: vec![instance], ..Model::default() };
        assert_eq!(thicken(&mut model.clone(), None), 1);
        assert_eq!(thicken(&mut model, Some(0.1)), 0);
        let body = &model.parts[1];
        let area: f64 = body
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| DVec3::from(body.positions[i as usize].map(f64::from)));
                0.5 * (b - a).cross(c - a).length()
            })
            .sum();
        // pi · width · length, positions in f32.
        assert!((area - std::f64::consts::PI * 0.3).abs() < 1e-6);
    }
}
