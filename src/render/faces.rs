//! From a mesh with height vectors to the boxes of its shell.

use super::shell::{Corner, PatchBox, PatchFault, Prism, ShellBox};
use crate::Warnings;
use crate::geom::{DAffine3, DVec3};
use crate::scene::Part;
use crate::scene::shell::ShellMaterial;
use crate::scene::wind::Moment;

/// Wind that bends height vectors, in the renderer's space: (world − eye) / unit.
pub struct Bend {
    pub wind: Moment,
    pub eye: DVec3,
    pub unit: f64,
}

/// Boxes of a shell.
#[derive(Default)]
pub struct Boxes {
    pub list: Vec<ShellBox>,
    /// For each bilinear patch of the part, whether a box is over it; else, collapsed or folded, it is taken as two triangles.
    pub curved: Vec<bool>,
}

/// The boxes over the faces of a part, between `from` and `to` of the height vectors, and `stretch` times as high as that.
/// `place` takes part space to the renderer's space.
pub fn boxes(
    part: &Part,
    (material, [from, to], stretch): (&ShellMaterial, [f64; 2], f64),
    place: DAffine3,
    bend: Option<&Bend>,
    warnings: &mut Warnings,
) -> Boxes {
    let Some(corners) = moved(part, (material, [from, to], stretch), place, bend, warnings) else {
        return Boxes::default();
    };
    let groups = by_position(part);
    let mut faces: Vec<Option<[Corner; 3]>> = part.triangles.iter().map(|t| face(&corners, t)).collect();
    let mut made = Boxes::default();
    let mut whole = vec![false; faces.len()];
    for (i, patch) in part.patches.iter().enumerate() {
        let shell = face(&corners, patch).and_then(|quad| over_patch(&quad, &part.name, warnings));
        made.curved.push(shell.is_some());
        if let Some(shell) = shell {
            made.list.push(shell);
            for (face, whole) in faces.iter_mut().zip(&mut whole).skip(2 * i).take(2) {
                (*face, *whole) = (None, true);
            }
        }
    }
    let (mut flat, mut folded) = (0, 0);
    let partner = partners(part, &faces, &groups);
    for (i, face) in faces.iter().enumerate().filter(|(i, _)| !whole[*i]) {
        let Some(face) = face else {
            flat += 1;
            continue;
        };
        match &partner[i] {
            Partner::Second => continue,
            Partner::First(quad) => {
                if let Some(prism) = Prism::new(quad.as_slice()) {
                    made.list.push(ShellBox::Prism(Box::new(prism)));
                    continue;
                }
            }
            Partner::None => {}
        }
        match ShellBox::new(face) {
            Some(b) => {
                if let ShellBox::Twisted(t) = &b {
                    folded += u64::from(t.folded());
                }
                made.list.push(b);
            }
            None => flat += 1,
        }
    }
    warnings.add_many(format!("{}: a shell's face has no volume and is left out", part.name), flat);
    warnings.add_many(format!("{}: a shell's box is folded: its height vectors cross", part.name), folded);
    made
}

/// The corners of a face, if they are finite.
fn face<const N: usize>(corners: &[Corner], face: &[u32; N]) -> Option<[Corner; N]> {
    let zero = Corner { p: DVec3::NAN, h: DVec3::ZERO, q: DVec3::ZERO, dw: 1.0, jitter: 1.0 };
    let face = face.map(|v| corners.get(v as usize).copied().unwrap_or(zero));
    face.iter().all(|c| c.p.is_finite() && c.h.is_finite()).then_some(face)
}

/// The box over a bilinear patch: a prism, where it is a parallelogram with one affine map. `None` (counted, with a warning)
/// where its two triangles have to stand for it.
fn over_patch(corners: &[Corner; 4], name: &str, warnings: &mut Warnings) -> Option<ShellBox> {
    let [a, b, c, d] = *corners;
    // As the triangles (b, c, a) and (d, a, c) that share the diagonal.
    if let Some(prism) = quad([b, c, a], [d, a, c]).and_then(|ring| Prism::new(&ring)) {
        return Some(ShellBox::Prism(Box::new(prism)));
    }
    match PatchBox::new(corners) {
        Ok(patch) => Some(ShellBox::Patch(Box::new(patch))),
        Err(fault) => {
            let why = match fault {
                PatchFault::Collapsed => "two corners are one",
                PatchFault::Folded => "it is concave, flat, or its height vectors cross",
            };
            warnings.add(format!("{name}: a bilinear patch is taken as two triangles: {why}"));
            None
        }
    }
}

/// A face of a shell: a triangle, or a bilinear patch whose corners stand in a ring.
#[cfg(feature = "bake")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Face {
    Triangle([Corner; 3]),
    Patch([Corner; 4]),
}

/// The faces over which [`boxes`] has boxes; what is a parallelogram comes as two triangles.
#[cfg(feature = "bake")]
pub fn faces(
    part: &Part,
    range: (&ShellMaterial, [f64; 2], f64),
    place: DAffine3,
    bend: Option<&Bend>,
    warnings: &mut Warnings,
) -> Vec<Face> {
    let Some(corners) = moved(part, range, place, bend, warnings) else { return Vec::new() };
    let mut triangles: Vec<Option<[Corner; 3]>> = part.triangles.iter().map(|t| face(&corners, t)).collect();
    let mut found = Vec::with_capacity(triangles.len());
    for (i, patch) in part.patches.iter().enumerate() {
        let Some(quad) = face(&corners, patch) else { continue };
        if let Some(ShellBox::Patch(_)) = over_patch(&quad, &part.name, warnings) {
            found.push(Face::Patch(quad));
            triangles.iter_mut().skip(2 * i).take(2).for_each(|triangle| *triangle = None);
        }
    }
    found.extend(triangles.into_iter().flatten().map(Face::Triangle));
    found
}

/// Each vertex as a corner of boxes between `from` and `to` of the height vectors, bent by the wind, and `stretch` times as high.
fn moved(
    part: &Part,
    (material, [from, to], stretch): (&ShellMaterial, [f64; 2], f64),
    place: DAffine3,
    bend: Option<&Bend>,
    warnings: &mut Warnings,
) -> Option<Vec<Corner>> {
    let mut corners = corners(part, material, place, warnings)?;
    if let Some(Bend { wind, eye, unit }) = bend {
        corners.iter_mut().for_each(|c| c.h = wind.bend(*eye + *unit * c.p, c.h));
    }
    if [from, to] != [0.0, 1.0] {
        corners.iter_mut().for_each(|c| (c.p, c.h) = (c.p + from * c.h, (to - from) * c.h));
    }
    if stretch != 1.0 {
        corners.iter_mut().for_each(|c| (c.h, c.dw) = (stretch * c.h, stretch * c.dw));
    }
    Some(corners)
}

/// Each vertex as a corner; `None` (with a warning) where the part has no texel coordinates.
fn corners(part: &Part, material: &ShellMaterial, place: DAffine3, warnings: &mut Warnings) -> Option<Vec<Corner>> {
    let uvs = part.uvs.get(material.tex_coord);
    if part.uvw.is_none() && uvs.is_none() {
        let tex_coord = material.tex_coord;
        warnings.add(format!("{}: no _VTEX_UVW and no TEXCOORD_{tex_coord}: its shell is left out", part.name));
        return None;
    }
    let heights = heights(part, material, warnings);
    let corner = |i: usize| {
        let p = DVec3::from_array(part.positions[i].map(f64::from));
        let q = match (&part.uvw, uvs) {
            (Some(uvw), _) => uvw.get(i).map_or(DVec3::ZERO, |q| DVec3::from_array(q.map(f64::from))),
            (None, uvs) => {
                let [u, v] = uvs.and_then(|u| u.get(i)).copied().unwrap_or_default().map(f64::from);
                DVec3::new(u, v, material.w)
            }
        };
        let dw = part.dw.as_ref().and_then(|d| d.get(i)).map_or(material.dw, |&d| f64::from(d));
        let jitter = part.jitter.as_ref().and_then(|j| j.get(i)).map_or(1.0, |&j| f64::from(j).clamp(0.0, 1.0));
        Corner { p: place.transform_point3(p), h: place.matrix3 * heights[i], q, dw, jitter }
    };
    Some((0..part.positions.len()).map(corner).collect())
}

/// Height vectors in part space: as given or thickness · normal, the same at vertices that share a position.
fn heights(part: &Part, material: &ShellMaterial, warnings: &mut Warnings) -> Vec<DVec3> {
    let n = part.positions.len();
    let groups = by_position(part);
    let given = part.heights.as_ref().filter(|h| h.len() == n);
    let mut heights: Vec<DVec3> = match given {
        Some(h) => h.iter().map(|h| DVec3::from_array(h.map(f64::from))).collect(),
        None => {
            let mut normals = match part.normals.as_ref().filter(|h| h.len() == n) {
                Some(normals) => normals.iter().map(|v| DVec3::from_array(v.map(f64::from))).collect(),
                None => area_normals(part),
            };
            average(&groups, &mut normals);
            normals.iter().map(|n| material.thickness * n.normalize_or_zero()).collect()
        }
    };
    if given.is_some() {
        let mended = average(&groups, &mut heights);
        warnings.add_many(format!("{}: height vectors that differ at one position were averaged", part.name), mended);
    }
    heights
}

/// Sum of the area vectors of the faces at each vertex.
fn area_normals(part: &Part) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; part.positions.len()];
    let at = |v: u32| part.positions.get(v as usize).map_or(DVec3::ZERO, |p| DVec3::from_array(p.map(f64::from)));
    for patch in &part.patches {
        // The mean over the patch, by its diagonals: the same at all its corners.
        let [a, b, c, d] = patch.map(at);
        let n = (c - a).cross(d - b);
        for &v in patch {
            if let Some(sum) = normals.get_mut(v as usize) {
                *sum += n;
            }
        }
    }
    for t in part.triangles.iter().skip(2 * part.patches.len()) {
        let [a, b, c] = t.map(at);
        let n = (b - a).cross(c - a);
        for &v in t {
            if let Some(sum) = normals.get_mut(v as usize) {
                *sum += n;
            }
        }
    }
    normals
}

/// For each vertex the lowest vertex at the same position.
fn by_position(part: &Part) -> Vec<u32> {
    // −0 and 0 are one position.
    let key = |i: u32| part.positions[i as usize].map(|v| (v + 0.0).to_bits());
    let mut order: Vec<u32> = (0..part.positions.len() as u32).collect();
    order.sort_unstable_by_key(|&i| (key(i), i));
    let mut groups = vec![0u32; order.len()];
    let mut first = 0;
    for (k, &i) in order.iter().enumerate() {
        if k == 0 || key(i) != key(order[k - 1]) {
            first = i;
        }
        groups[i as usize] = first;
    }
    groups
}

/// Give all vertices of a group the mean of their vectors; how many groups' vectors differed by more than rounding.
fn average(groups: &[u32], vectors: &mut [DVec3]) -> u64 {
    let mut sums = vec![(DVec3::ZERO, 0u32, false); vectors.len()];
    for (i, &g) in groups.iter().enumerate() {
        let apart = vectors[i].distance(vectors[g as usize]) > 1e-5 * vectors[i].length();
        let sum = &mut sums[g as usize];
        *sum = (sum.0 + vectors[i], sum.1 + 1, sum.2 || apart);
    }
    for (i, &g) in groups.iter().enumerate() {
        let (sum, n, _) = sums[g as usize];
        if n > 1 {
            vectors[i] = sum / f64::from(n);
        }
    }
    sums.iter().filter(|s| s.2).count() as u64
}

enum Partner {
    None,
    /// This face and another are one convex quadrilateral prism.
    First(Box<[Corner; 4]>),
    /// The other one.
    Second,
}

/// Pairs of faces that share their longest edge and one affine map: a tile of the ground is then one box.
fn partners(part: &Part, faces: &[Option<[Corner; 3]>], groups: &[u32]) -> Vec<Partner> {
    let mut out: Vec<Partner> = faces.iter().map(|_| Partner::None).collect();
    // (edge, face, the corner opposite to it)
    let mut edges: Vec<([u32; 2], usize, usize)> = Vec::new();
    for (i, face) in faces.iter().enumerate() {
        let Some(face) = face else { continue };
        let length = |k: usize| face[(k + 1) % 3].p.distance_squared(face[(k + 2) % 3].p);
        let opposite = (0..3).fold(0, |best, k| if length(k) > length(best) { k } else { best });
        let end = |k: usize| groups[part.triangles[i][(opposite + k) % 3] as usize];
        let (a, b) = (end(1), end(2));
        edges.push(([a.min(b), a.max(b)], i, opposite));
    }
    edges.sort_unstable_by_key(|e| (e.0, e.1));
    let mut k = 0;
    while k + 1 < edges.len() {
        let ((edge, i, a), (other, j, d)) = (edges[k], edges[k + 1]);
        k += 1;
        if edge != other {
            continue;
        }
        if let (Some(f), Some(g)) = (&faces[i], &faces[j])
            && let Some(quad) = quad([f[a], f[(a + 1) % 3], f[(a + 2) % 3]], [g[d], g[(d + 1) % 3], g[(d + 2) % 3]])
        {
            (out[i], out[j]) = (Partner::First(Box::new(quad)), Partner::Second);
            k += 1;
        }
    }
    out
}

/// Triangles (a, b, c) and (d, c, b), if they are one convex face with one affine map.
fn quad([a, b, c]: [Corner; 3], [d, e, f]: [Corner; 3]) -> Option<[Corner; 4]> {
    let agree = [b, c, d].iter().all(|k| k.h == a.h && k.dw == a.dw) && e == c && f == b;
    if !agree {
        return None;
    }
    let edges = glam::DMat3::from_cols(b.p - a.p, c.p - a.p, a.h);
    let at = edges.inverse() * (d.p - a.p);
    let q = a.q + at.x * (b.q - a.q) + at.y * (c.q - a.q);
    // Positions and coordinates come as f32: what is rounding there is the same map here.
    let size = (b.q - a.q).abs().max_element().max((c.q - a.q).abs().max_element());
    let off = q.distance(d.q) / size.max(1e-5 * q.abs().max_element());
    let jitter = a.jitter + at.x * (b.jitter - a.jitter) + at.y * (c.jitter - a.jitter);
    let convex = at.x > 0.0 && at.y > 0.0 && at.x + at.y > 1.0;
    (convex && at.z.abs() < 1e-5 && off < 1e-5 && (jitter - d.jitter).abs() < 1e-5).then_some([a, b, d, c])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell() -> ShellMaterial {
        ShellMaterial { tex_coord: 0, w: 0.0, dw: 1.0, thickness: 0.5, surface_visible: true, layers: vec![] }
    }

    /// An n × n grid of unit tiles, two triangles each; heights along y unless the ground bulges.
    fn ground(n: u32, bulge: f32) -> Part {
        let mut part = Part { name: "ground".into(), uvs: vec![vec![]], ..Default::default() };
        for z in 0..=n {
            for x in 0..=n {
                let (x, z) = (x as f32, z as f32);
                part.positions.push([x, bulge * (x * 1.3).sin() * z.cos(), z]);
                part.uvs[0].push([x, z]);
            }
        }
        let at = |x: u32, z: u32| z * (n + 1) + x;
        for z in 0..n {
            for x in 0..n {
                part.triangles.push([at(x, z), at(x, z + 1), at(x + 1, z)]);
                part.triangles.push([at(x + 1, z), at(x, z + 1), at(x + 1, z + 1)]);
            }
        }
        part
    }

    #[test]
    fn flat_tiles_become_one_box_each() {
        let mut warnings = Warnings::default();
        let made = boxes(&ground(4, 0.0), (&shell(), [0.0, 1.0], 1.0), DAffine3::IDENTITY, None, &mut warnings).list;
        assert_eq!(made.len(), 16);
        assert!(warnings.is_empty());
        let made = boxes(&ground(4, 0.3), (&shell(), [0.0, 1.0], 1.0), DAffine3::IDENTITY, None, &mut warnings).list;
        assert_eq!(made.len(), 32);
        assert!(made.iter().all(|b| matches!(b, ShellBox::Twisted(_))));
    }

    #[test]
    fn split_vertices_get_one_height() {
        let mut part = ground(1, 0.0);
        // The same tile again with its own vertices and other heights.
        let n = part.positions.len() as u32;
        part.positions.extend_from_within(..);
        part.uvs[0].extend_from_within(..);
        part.triangles.push([n, n + 2, n + 1]);
        part.heights = Some((0..2 * n).map(|i| [0.0, if i < n { 1.0 } else { 2.0 }, 0.0]).collect());
        let mut warnings = Warnings::default();
        let heights = heights(&part, &shell(), &mut warnings);
        assert!(heights.iter().all(|h| *h == DVec3::new(0.0, 1.5, 0.0)));
        assert_eq!(warnings.iter().map(|w| w.1).sum::<u64>(), 4);
    }

    #[test]
    fn without_coordinates_there_is_a_word() {
        let part = Part { uvs: vec![], ..ground(1, 0.0) };
        let mut warnings = Warnings::default();
        assert!(boxes(&part, (&shell(), [0.0, 1.0], 1.0), DAffine3::IDENTITY, None, &mut warnings).list.is_empty());
        assert_eq!(warnings.iter().count(), 1);
    }
}
