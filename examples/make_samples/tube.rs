//! A branch's skin: rings of vertices along its axis, carried by parallel transport so that the tube does not twist.

use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

use crate::glb::Mesh;
use crate::random::{noise, turn};

/// One ring's place on the axis and its radius, metres.
#[derive(Clone, Copy)]
pub struct Ring {
    pub centre: DVec3,
    pub radius: f64,
}

/// Add a tube of `sides` facets around, closed to a point beyond the last ring (but for twigs of three sides). `lobes(angle, height)` scales the radius.
pub fn add(mesh: &mut Mesh, rings: &[Ring], sides: u32, color: DVec3, lobes: impl Fn(f64, f64) -> f64) {
    let Some(last) = rings.len().checked_sub(1).filter(|&n| n > 0) else { return };
    let direction = |i: usize| (rings[(i + 1).min(last)].centre - rings[i.saturating_sub(1)].centre).normalize();
    let mut across = direction(0).any_orthonormal_vector();
    let first = mesh.positions.len() as u32;
    for (i, ring) in rings.iter().enumerate() {
        let along = direction(i);
        across = (across - along * across.dot(along)).normalize();
        let other = along.cross(across);
        for k in 0..sides {
            let angle = TAU * f64::from(k) / f64::from(sides);
            let (sin, cos) = turn(angle);
            let out = across * cos + other * sin;
            let position = ring.centre + out * ring.radius * lobes(angle, ring.centre.y);
            let streak = noise(DVec2::new(angle * 4.0 + f64::from(first % 97), position.y * 1.7), 11);
            mesh.vertex(position, out, color * (1.0 + 0.28 * streak));
        }
        if i > 0 {
            let (a, b) = (first + (i as u32 - 1) * sides, first + i as u32 * sides);
            for k in 0..sides {
                let next = (k + 1) % sides;
                mesh.triangles.push([a + k, a + next, b + next]);
                mesh.triangles.push([a + k, b + next, b + k]);
            }
        }
    }
    if sides == 3 {
        return; // A twig's open end is thinner than a leaf's stalk.
    }
    let along = direction(last);
    let tip = mesh.vertex(rings[last].centre + along * rings[last].radius * 1.5, along, color);
    let ring = first + last as u32 * sides;
    for k in 0..sides {
        mesh.triangles.push([ring + k, ring + (k + 1) % sides, tip]);
    }
}
