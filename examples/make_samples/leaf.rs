//! One leaf as a folded, curved surface with an outline, and its stalk.

use glam::DVec3;

use crate::glb::Mesh;
use crate::random::turn;

/// The shape of a species' leaves, in units of the blade's length.
pub struct Shape {
    /// Along the blade, and half the width there, from base to tip (both ends are points on the midrib).
    pub outline: [(f64, f64); 3],
    /// Angle by which each half is lifted about the midrib, radians.
    pub fold: f64,
    /// How far the blade bends down towards its tip, radians.
    pub bend: f64,
}

/// Where a leaf is: its stalk starts at `base`, the blade runs along `along` and faces `up`; metres.
pub struct Place {
    pub base: DVec3,
    pub along: DVec3,
    pub up: DVec3,
    pub length: f64,
    pub stalk: f64,
    pub color: DVec3,
}

/// Add the nine triangles of a leaf.
pub fn add(mesh: &mut Mesh, shape: &Shape, place: &Place) {
    let along = place.along.normalize();
    let side = along.cross(place.up).normalize();
    let up = side.cross(along);
    let start = place.base + along * place.stalk;
    // A circular arc: position and direction at the share s of the blade's length.
    let arc = |s: f64| {
        let angle = shape.bend * s;
        let (sin, cos) = turn(angle);
        let (forward, down) =
            if shape.bend.abs() < 1e-6 { (s, 0.0) } else { (sin / shape.bend, (1.0 - cos) / shape.bend) };
        (start + place.length * (along * forward - up * down), along * sin + up * cos)
    };
    let (sin, cos) = turn(shape.fold);
    let rib = |s: f64| arc(s).0;
    let rim = |s: f64, width: f64, sign: f64| {
        let (p, n) = arc(s);
        p + place.length * width * (side * (sign * cos) + n * sin)
    };
    let middle = 0.42;
    // The midrib is paler, the rim darker: what vertex colours can say of veins.
    let (pale, dark) = (place.color * 1.18, place.color * 0.94);
    for sign in [-1.0, 1.0] {
        let normal = |s: f64| {
            let n = arc(s).1;
            n * cos - side * (sign * sin)
        };
        let base = mesh.vertex(rib(0.0), normal(0.0), pale);
        let centre = mesh.vertex(rib(middle), normal(middle), pale);
        let tip = mesh.vertex(rib(1.0), normal(1.0), dark);
        let rims = shape.outline.map(|(s, width)| mesh.vertex(rim(s, width, sign), normal(s), dark));
        let mut fan = |a: u32, b: u32| {
            mesh.triangles.push(if sign > 0.0 { [centre, a, b] } else { [centre, b, a] });
        };
        fan(base, rims[0]);
        fan(rims[0], rims[1]);
        fan(rims[1], rims[2]);
        fan(rims[2], tip);
    }
    let half = 0.012 * place.length;
    let stalk = [place.base - side * half, place.base + side * half, start]
        .map(|p| mesh.vertex(p, up, place.color * DVec3::new(1.5, 1.1, 1.0)));
    mesh.triangles.push(stalk);
}
