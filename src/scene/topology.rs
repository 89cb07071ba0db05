//! Topology of primitives: lists, strips and fans of indices become triangles and lines, and parts are cleaned so that all invariants of [`Part`]
//! hold.

use super::model::Part;
use crate::Warnings;
use crate::geom::{DVec3, Vec3};

pub fn lines(indices: &[u32]) -> Vec<[u32; 2]> {
    indices.as_chunks::<2>().0.to_vec()
}

/// A polyline; `closed` joins its end to its start.
pub fn line_strip(indices: &[u32], closed: bool) -> Vec<[u32; 2]> {
    let mut out: Vec<[u32; 2]> = indices.windows(2).map(|w| [w[0], w[1]]).collect();
    if let (true, [first, _, .., last]) = (closed, indices) {
        out.push([*last, *first]);
    }
    out
}

pub fn triangles(indices: &[u32]) -> Vec<[u32; 3]> {
    indices.as_chunks::<3>().0.to_vec()
}

/// The triangles of a strip, all with the same winding.
pub fn triangle_strip(indices: &[u32]) -> Vec<[u32; 3]> {
    let turned = |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] };
    indices.windows(3).enumerate().map(turned).collect()
}

pub fn triangle_fan(indices: &[u32]) -> Vec<[u32; 3]> {
    match indices {
        [hub, rim @ ..] => rim.windows(2).map(|w| [*hub, w[0], w[1]]).collect(),
        [] => Vec::new(),
    }
}

/// Remove elements that cannot be drawn, normalise normals, and drop unused vertices. In a `strip` repeated indices join strips, and are not
/// reported.
pub fn clean(part: &mut Part, strip: bool, warnings: &mut Warnings) {
    let n = part.positions.len();
    let bad: Vec<bool> = part.positions.iter().map(|p| !p.iter().all(|c| c.is_finite())).collect();
    warnings
        .add_many("a vertex with a NaN or infinite position is left out", bad.iter().filter(|b| **b).count() as u64);
    for p in part.positions.iter_mut().filter(|p| !p.iter().all(|c| c.is_finite())) {
        *p = [0.0; 3];
    }
    demote_patches(part, &bad, warnings);
    let mut outside = 0;
    let mut valid = |corners: &[u32]| {
        let inside = corners.iter().all(|&i| (i as usize) < n);
        outside += u64::from(!inside);
        inside && corners.iter().all(|&i| !bad[i as usize])
    };
    part.points.retain(|&p| valid(&[p]));
    part.lines.retain(|l| valid(l));
    part.triangles.retain(|t| valid(t));
    warnings.add_many("a triangle, line or point with an index beyond its vertices is left out", outside);

    let positions = &part.positions;
    let (all, joints) = (part.triangles.len(), part.triangles.iter().filter(|t| repeats(t)).count());
    part.triangles.retain(|t| cross(positions, t) != DVec3::ZERO);
    let flat = all - part.triangles.len() - if strip { joints } else { 0 };
    warnings.add_many("a triangle without area is left out", flat as u64);
    let all = part.lines.len();
    part.lines.retain(|&[a, b]| positions[a as usize] != positions[b as usize]);
    warnings.add_many("a line without length is left out", (all - part.lines.len()) as u64);

    if part.normals.is_some() {
        unit_normals(part, warnings);
    }
    compact(part);
}

/// Replace patches of which a triangle cannot be drawn by their triangles, which are put after those of the other patches.
fn demote_patches(part: &mut Part, bad: &[bool], warnings: &mut Warnings) {
    if part.patches.is_empty() {
        return;
    }
    let positions = &part.positions;
    let sound =
        |t: &[u32; 3]| t.iter().all(|&i| bad.get(i as usize) == Some(&false)) && cross(positions, t) != DVec3::ZERO;
    let of_patches = part.triangles.len().min(2 * part.patches.len());
    let (pairs, rest) = part.triangles.split_at(of_patches);
    let (mut patches, mut whole, mut loose) = (Vec::new(), Vec::new(), Vec::new());
    for (patch, pair) in part.patches.iter().zip(pairs.chunks(2)) {
        if pair.len() == 2 && pair.iter().all(sound) {
            patches.push(*patch);
            whole.extend(pair);
        } else {
            loose.extend(pair);
        }
    }
    part.collapsed_patches = (part.patches.len() - patches.len()) as u64;
    warnings.add_many("a bilinear patch that is collapsed is taken as triangles", part.collapsed_patches);
    whole.append(&mut loose);
    whole.extend(rest);
    (part.patches, part.triangles) = (patches, whole);
}

fn repeats([a, b, c]: &[u32; 3]) -> bool {
    a == b || b == c || c == a
}

/// Twice the area vector of a triangle, whose indices must be in range.
fn cross(positions: &[[f32; 3]], t: &[u32; 3]) -> DVec3 {
    let [a, b, c] = t.map(|i| Vec3::from(positions[i as usize]).as_dvec3());
    (b - a).cross(c - a)
}

/// Normalise normals; one without a direction is replaced by the normal of the faces around the vertex.
fn unit_normals(part: &mut Part, warnings: &mut Warnings) {
    let Some(normals) = &mut part.normals else { return };
    let unit = |n: [f32; 3]| Vec3::from(n).as_dvec3().try_normalize();
    let broken: Vec<usize> = (0..normals.len()).filter(|&i| unit(normals[i]).is_none()).collect();
    let mut mended = vec![DVec3::ZERO; if broken.is_empty() { 0 } else { normals.len() }];
    if !broken.is_empty() {
        for t in &part.triangles {
            let area = cross(&part.positions, t);
            for &i in t {
                mended[i as usize] += area;
            }
        }
        warnings.add_many("a normal without a direction is made from the faces around", broken.len() as u64);
    }
    for (i, normal) in normals.iter_mut().enumerate() {
        let n = unit(*normal).or_else(|| mended.get(i).and_then(|m| m.try_normalize())).unwrap_or(DVec3::Y);
        *normal = n.as_vec3().to_array();
    }
}

/// Remove unused vertices, keeping the order of the others, if at least a quarter is unused.
fn compact(part: &mut Part) {
    const UNUSED: u32 = u32::MAX;
    let mut new = vec![UNUSED; part.positions.len()];
    let corners = part.triangles.iter().flatten().chain(part.lines.iter().flatten()).chain(&part.points);
    for &i in corners {
        new[i as usize] = 0;
    }
    let used: Vec<usize> = (0..new.len()).filter(|&i| new[i] != UNUSED).collect();
    if used.len() > new.len() / 4 * 3 {
        return;
    }
    for (to, &from) in used.iter().enumerate() {
        new[from] = to as u32;
    }
    let corners = part.triangles.iter_mut().flatten().chain(part.lines.iter_mut().flatten()).chain(&mut part.points);
    for i in corners.chain(part.patches.iter_mut().flatten()) {
        *i = new[*i as usize];
    }
    fn keep<T: Copy>(values: &mut Vec<T>, used: &[usize]) {
        *values = used.iter().map(|&i| values[i]).collect();
    }
    keep(&mut part.positions, &used);
    part.uvs.iter_mut().for_each(|v| keep(v, &used));
    part.normals.iter_mut().for_each(|v| keep(v, &used));
    part.colors.iter_mut().for_each(|v| keep(v, &used));
    part.uvw.iter_mut().for_each(|v| keep(v, &used));
    part.heights.iter_mut().for_each(|v| keep(v, &used));
    part.dw.iter_mut().for_each(|v| keep(v, &used));
    part.jitter.iter_mut().for_each(|v| keep(v, &used));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_fans_and_loops_come_apart() {
        assert_eq!(triangle_strip(&[0, 1, 2, 3]), [[0, 1, 2], [2, 1, 3]]);
        assert_eq!(triangle_fan(&[9, 1, 2, 3]), [[9, 1, 2], [9, 2, 3]]);
        assert_eq!(line_strip(&[4, 5, 6], true), [[4, 5], [5, 6], [6, 4]]);
        assert_eq!(line_strip(&[4, 5], true), [[4, 5]], "there and back is one line");
        assert_eq!(lines(&[1, 2, 3]), [[1, 2]]);
        for n in 0..3 {
            let few: Vec<u32> = (0..n).collect();
            assert!(triangle_strip(&few).is_empty() && triangle_fan(&few).is_empty() && triangles(&few).is_empty());
        }
    }

    #[test]
    fn collapsed_patches_become_triangles() {
        let mut part = Part {
            positions: [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [2.0, 0.0]].map(|[x, y]| [x, y, 0.0]).to_vec(),
            patches: vec![[1, 4, 4, 2], [0, 1, 2, 3]],
            triangles: vec![[1, 4, 4], [1, 4, 2], [0, 1, 2], [0, 2, 3], [4, 2, 1]],
            ..Part::default()
        };
        let mut warnings = Warnings::default();
        clean(&mut part, false, &mut warnings);
        assert_eq!(part.patches, [[0, 1, 2, 3]]);
        assert_eq!(part.triangles, [[0, 1, 2], [0, 2, 3], [1, 4, 2], [4, 2, 1]]);
        assert_eq!(part.collapsed_patches, 1);
        assert!(warnings.iter().any(|(text, n)| text.contains("collapsed") && n == 1));
    }

    #[test]
    fn what_cannot_be_drawn_is_counted() {
        let mut part = Part {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [f32::NAN, 0.0, 0.0], [2.0, 0.0, 0.0]],
            normals: Some(vec![[0.0, 0.0, 3.0], [0.0; 3], [f32::NAN; 3], [0.0; 3], [0.0; 3]]),
            triangles: vec![[0, 1, 2], [0, 1, 1], [0, 1, 4], [0, 1, 3], [0, 1, 5]],
            points: vec![0, 7],
            ..Part::default()
        };
        let mut warnings = Warnings::default();
        clean(&mut part, false, &mut warnings);
        assert_eq!(part.triangles, [[0, 1, 2]]);
        assert_eq!(part.points, [0]);
        assert_eq!(part.positions.len(), 3, "vertices that nothing uses are gone");
        assert_eq!(part.normals, Some(vec![[0.0, 0.0, 1.0]; 3]));
        let counts: Vec<u64> = warnings.iter().map(|(_, n)| n).collect();
        // In alphabetical order: normals, area, index beyond, NaN.
        assert_eq!(counts, [4, 2, 2, 1]);
    }
}
