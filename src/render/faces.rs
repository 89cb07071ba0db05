//! The faces of a shell: from a mesh with height vectors to one box per face.

use super::shell::{Corner, PatchBox, PatchFault, Prism, ShellBox};
use super::weld;
use super::weld::by_position;
use crate::Warnings;
use crate::geom::{DAffine3, DVec3};
use crate::scene::Part;
use crate::scene::shell::ShellMaterial;
use crate::scene::wind::WindField;

/// Largest texel coordinate: beyond it numbers of single precision have no fractional digits, and give no position within a cell.
const MAX_TEXEL_COORDINATE: f64 = 16_777_216.0;

/// Wind that bends height vectors, in the renderer's space: (world − eye) / unit.
pub struct WindBend {
    pub wind: WindField,
    pub eye: DVec3,
    pub unit: f64,
}

/// Calls `take` with the boxes over the faces of a part. `range` is the shell's material, the lower and upper share of the height vectors
/// that the boxes fill, and a factor of their height. `place` takes part space to the renderer's space. Returns for each bilinear patch of
/// the part whether it has a box of its own; a patch that is collapsed or folded has none, and is taken as two triangles.
pub fn boxes(
    part: &Part,
    range: (&ShellMaterial, [f64; 2], f64),
    place: DAffine3,
    bend: Option<&WindBend>,
    warnings: &mut Warnings,
    take: &mut dyn FnMut(ShellBox),
) -> Vec<bool> {
    let groups = by_position(part);
    let Some(corners) = Corners::new(part, range, place, bend, &groups, warnings) else { return Vec::new() };
    let mut whole = vec![false; part.triangles.len()];
    let mut curved = Vec::with_capacity(part.patches.len());
    for (i, patch) in part.patches.iter().enumerate() {
        let shell = corners.of(patch).and_then(|quad| over_patch(&quad, corners.rounding, &part.name, warnings));
        curved.push(shell.is_some());
        if let Some(shell) = shell {
            take(shell);
            whole.iter_mut().skip(2 * i).take(2).for_each(|whole| *whole = true);
        }
    }
    let (mut flat, mut folded) = (0, 0);
    let partner = partners(&corners, &whole, &groups);
    for (i, triangle) in part.triangles.iter().enumerate().filter(|(i, _)| !whole[*i]) {
        let Some(face) = corners.of(triangle) else {
            flat += 1;
            continue;
        };
        let other = partner[i] as usize;
        if other < i {
            continue;
        }
        let quad = part.triangles.get(other).and_then(|t| joined(&face, &corners.of(t)?, corners.rounding));
        if let Some(prism) = quad.and_then(|quad| Prism::new(&quad)) {
            take(ShellBox::Prism(Box::new(prism)));
            continue;
        }
        match ShellBox::new(&face) {
            Some(b) => {
                if let ShellBox::Twisted(t) = &b {
                    folded += u64::from(t.folded());
                }
                take(b);
            }
            None => flat += 1,
        }
    }
    warnings.add_many(
        format!("{}: a shell's face has no volume, or texture coordinates beyond ±2²⁴, and is left out", part.name),
        flat,
    );
    warnings.add_many(format!("{}: a shell's box is folded: its height vectors cross", part.name), folded);
    curved
}

/// The box over a bilinear patch: a prism, if the patch is a parallelogram with an affine map. `None`, with a counted warning, where the
/// patch has to be taken as two triangles.
fn over_patch(corners: &[Corner; 4], rounding: f64, name: &str, warnings: &mut Warnings) -> Option<ShellBox> {
    let [a, b, c, d] = *corners;
    // As the triangles (b, c, a) and (d, a, c) that share the diagonal.
    if let Some(prism) = quad([b, c, a], [d, a, c], rounding).and_then(|ring| Prism::new(&ring)) {
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

/// The faces over which [`boxes`] makes boxes. A parallelogram is given as two triangles.
#[cfg(feature = "bake")]
pub fn faces(
    part: &Part,
    range: (&ShellMaterial, [f64; 2], f64),
    place: DAffine3,
    bend: Option<&WindBend>,
    warnings: &mut Warnings,
) -> Vec<Face> {
    let groups = by_position(part);
    let Some(corners) = Corners::new(part, range, place, bend, &groups, warnings) else { return Vec::new() };
    let mut triangles: Vec<Option<[Corner; 3]>> = part.triangles.iter().map(|t| corners.of(t)).collect();
    let mut found = Vec::with_capacity(triangles.len());
    for (i, patch) in part.patches.iter().enumerate() {
        let Some(quad) = corners.of(patch) else { continue };
        if let Some(ShellBox::Patch(_)) = over_patch(&quad, corners.rounding, &part.name, warnings) {
            found.push(Face::Patch(quad));
            triangles.iter_mut().skip(2 * i).take(2).for_each(|triangle| *triangle = None);
        }
    }
    found.extend(triangles.into_iter().flatten().map(Face::Triangle));
    found
}

/// The vertices of a part as corners of boxes. They are computed on demand: as a list, those of a million separate quads would take 350 MB.
struct Corners<'a> {
    part: &'a Part,
    material: &'a ShellMaterial,
    uvs: Option<&'a Vec<[f32; 2]>>,
    place: DAffine3,
    heights: Heights<'a>,
    /// Lower and upper share of the height vectors that boxes fill, and a factor of the boxes' height.
    from: f64,
    to: f64,
    stretch: f64,
    /// Rounding error of the f32 positions, in the renderer's units.
    rounding: f64,
}

/// Height vectors.
enum Heights<'a> {
    /// As the file has them, in part space.
    Given(&'a [[f32; 3]]),
    /// In the renderer's space.
    Computed(Vec<DVec3>),
}

impl<'a> Corners<'a> {
    /// `None` (with a warning) where the part has no texel coordinates. `groups`: [`by_position`].
    fn new(
        part: &'a Part,
        (material, [from, to], stretch): (&'a ShellMaterial, [f64; 2], f64),
        place: DAffine3,
        bend: Option<&WindBend>,
        groups: &[u32],
        warnings: &mut Warnings,
    ) -> Option<Corners<'a>> {
        let uvs = part.uvs.get(material.tex_coord);
        if part.uvw.is_none() && uvs.is_none() {
            let tex_coord = material.tex_coord;
            warnings.add(format!("{}: no _VTEX_UVW and no TEXCOORD_{tex_coord}: its shell is left out", part.name));
            return None;
        }
        let given = part.heights.as_deref().filter(|h| h.len() == part.positions.len());
        // Vertices that share a position but have different height vectors get the mean vector.
        let agree = |h: &&[[f32; 3]]| groups.iter().enumerate().all(|(i, &g)| h[i] == h[g as usize]);
        let heights = match given.filter(agree) {
            Some(given) if bend.is_none() => Heights::Given(given),
            _ => {
                let mut made = heights(part, material, groups, warnings);
                made.iter_mut().for_each(|h| *h = place.matrix3 * *h);
                if let Some(WindBend { wind, eye, unit }) = bend {
                    for (h, p) in made.iter_mut().zip(&part.positions) {
                        *h = wind.bend(*eye + *unit * placed(&place, p), *h);
                    }
                }
                Heights::Computed(made)
            }
        };
        let farthest = part.positions.iter().flatten().fold(0.0f32, |most, v| most.max(v.abs()));
        let m = place.matrix3;
        let scale = m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length());
        let rounding = f64::from(farthest) * scale * f64::from(f32::EPSILON);
        Some(Corners { part, material, uvs, place, heights, from, to, stretch, rounding })
    }

    /// Vertex `v`; `None` where there is none, it is not finite, or its texture coordinates have no fractions.
    fn get(&self, v: u32) -> Option<Corner> {
        let (part, i) = (self.part, v as usize);
        let p = placed(&self.place, part.positions.get(i)?);
        let h = match &self.heights {
            Heights::Given(given) => self.place.matrix3 * DVec3::from_array(given.get(i)?.map(f64::from)),
            Heights::Computed(made) => *made.get(i)?,
        };
        let q = match &part.uvw {
            Some(uvw) => uvw.get(i).map_or(DVec3::ZERO, |q| DVec3::from_array(q.map(f64::from))),
            None => {
                let [u, v] = self.uvs.and_then(|u| u.get(i)).copied().unwrap_or_default().map(f64::from);
                DVec3::new(u, v, self.material.w)
            }
        };
        let dw = part.dw.as_ref().and_then(|d| d.get(i)).map_or(self.material.dw, |&d| f64::from(d));
        let jitter = part.jitter.as_ref().and_then(|j| j.get(i)).map_or(1.0, |&j| f64::from(j).clamp(0.0, 1.0));
        let mut corner = Corner { p, h, q, dw, jitter };
        if [self.from, self.to] != [0.0, 1.0] {
            (corner.p, corner.h) = (p + self.from * h, (self.to - self.from) * h);
        }
        if self.stretch != 1.0 {
            (corner.h, corner.dw) = (self.stretch * corner.h, self.stretch * dw);
        }
        let scales = self.material.layers.iter().map(|layer| DVec3::from_array(layer.scale).abs());
        let cells = q.abs() * scales.fold(DVec3::ONE, DVec3::max);
        let known =
            corner.p.is_finite() && corner.h.is_finite() && cells.cmplt(DVec3::splat(MAX_TEXEL_COORDINATE)).all();
        known.then_some(corner)
    }

    /// The corners of a face; `None` where one is missing.
    fn of<const N: usize>(&self, face: &[u32; N]) -> Option<[Corner; N]> {
        let nowhere = Corner { p: DVec3::ZERO, h: DVec3::ZERO, q: DVec3::ZERO, dw: 1.0, jitter: 1.0 };
        let mut found = [nowhere; N];
        for (corner, &v) in found.iter_mut().zip(face) {
            *corner = self.get(v)?;
        }
        Some(found)
    }
}

/// A position of a part in the renderer's space.
fn placed(place: &DAffine3, p: &[f32; 3]) -> DVec3 {
    place.transform_point3(DVec3::from_array(p.map(f64::from)))
}

/// Height vectors in part space: as given or thickness · normal, the same at vertices that share a position.
fn heights(part: &Part, material: &ShellMaterial, groups: &[u32], warnings: &mut Warnings) -> Vec<DVec3> {
    let n = part.positions.len();
    let given = part.heights.as_ref().filter(|h| h.len() == n);
    let mut heights: Vec<DVec3> = match given {
        Some(h) => h.iter().map(|h| DVec3::from_array(h.map(f64::from))).collect(),
        None => {
            let mut normals = match part.normals.as_ref().filter(|h| h.len() == n) {
                Some(normals) => normals.iter().map(|v| DVec3::from_array(v.map(f64::from))).collect(),
                None => area_normals(part),
            };
            average(groups, &mut normals);
            normals.iter().map(|n| material.thickness * n.normalize_or_zero()).collect()
        }
    };
    if given.is_some() {
        let mended = average(groups, &mut heights);
        warnings.add_many(format!("{}: height vectors that differ at one position were averaged", part.name), mended);
    }
    heights
}

/// Sum of the area vectors of the faces around each vertex, in part space.
fn area_normals(part: &Part) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; part.positions.len()];
    let at = |v: u32| part.positions.get(v as usize).map_or(DVec3::ZERO, |p| DVec3::from_array(p.map(f64::from)));
    for patch in &part.patches {
        // The mean area vector of the patch, from its diagonals; all its corners get the same one.
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

/// Give all vertices of a group the mean of their vectors. Returns the number of groups whose vectors differed by more than rounding.
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

/// For each triangle the other one with which it forms one convex quadrilateral prism, or [`weld::NONE`]. The two share their longest edge
/// and have one affine map. A square tile of the ground thus becomes one box.
fn partners(corners: &Corners<'_>, whole: &[bool], groups: &[u32]) -> Vec<u32> {
    let triangles = &corners.part.triangles;
    let opposite = |(t, whole): (&[u32; 3], &bool)| {
        let place = |v: u32| corners.part.positions.get(v as usize).map(|p| placed(&corners.place, p));
        match t.map(place) {
            [Some(a), Some(b), Some(c)] if !whole => opposite_longest([a, b, c]) as u8,
            _ => u8::MAX,
        }
    };
    let opposite: Vec<u8> = triangles.iter().zip(whole).map(opposite).collect();
    let edge = |i: u32| {
        let k = usize::from(opposite[i as usize]);
        let end = |step: usize| groups[triangles[i as usize][(k + step) % 3] as usize];
        (k < 3).then(|| [end(1).min(end(2)), end(1).max(end(2))])
    };
    let join = |i: u32, j: u32| {
        let faces = [i, j].map(|t| corners.of(&triangles[t as usize]));
        matches!(faces, [Some(f), Some(g)] if joined(&f, &g, corners.rounding).is_some())
    };
    weld::partners(triangles.len(), edge, join)
}

/// Number of the corner opposite to a triangle's longest edge.
fn opposite_longest(corners: [DVec3; 3]) -> usize {
    let length = |k: usize| corners[(k + 1) % 3].distance_squared(corners[(k + 2) % 3]);
    (0..3).fold(0, |best, k| if length(k) > length(best) { k } else { best })
}

/// Two triangles that share their longest edge as one quadrilateral, if [`quad`] can join them.
fn joined(f: &[Corner; 3], g: &[Corner; 3], rounding: f64) -> Option<[Corner; 4]> {
    let from = |face: &[Corner; 3]| {
        let k = opposite_longest(face.map(|corner| corner.p));
        [0, 1, 2].map(|step| face[(k + step) % 3])
    };
    quad(from(f), from(g), rounding)
}

/// The triangles (a, b, c) and (d, c, b) as one quadrilateral, if they form a convex face with one affine map, up to the `rounding` of
/// positions.
fn quad([a, b, c]: [Corner; 3], [d, e, f]: [Corner; 3], rounding: f64) -> Option<[Corner; 4]> {
    let agree = [b, c, d].iter().all(|k| k.h == a.h && k.dw == a.dw) && e == c && f == b;
    if !agree {
        return None;
    }
    let edges = glam::DMat3::from_cols(b.p - a.p, c.p - a.p, a.h);
    let at = edges.inverse() * (d.p - a.p);
    let q = a.q + at.x * (b.q - a.q) + at.y * (c.q - a.q);
    // Positions and coordinates are given as f32, so maps that differ by that rounding are the same. In units of the edges and the height.
    const SAME: f64 = 1e-5;
    let across = SAME + 2.0 * rounding / edges.x_axis.length().min(edges.y_axis.length());
    let size = (b.q - a.q).abs().max_element().max((c.q - a.q).abs().max_element());
    let off = q.distance(d.q) / size.max(1e-5 * q.abs().max_element());
    let jitter = a.jitter + at.x * (b.jitter - a.jitter) + at.y * (c.jitter - a.jitter);
    let convex = at.x > 0.0 && at.y > 0.0 && at.x + at.y > 1.0;
    let flat = at.z.abs() < SAME + 2.0 * rounding / edges.z_axis.length();
    (convex && flat && off < across && (jitter - d.jitter).abs() < across).then_some([a, b, d, c])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell() -> ShellMaterial {
        ShellMaterial { thickness: 0.5, layers: vec![], ..ShellMaterial::default() }
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

    fn made(part: &Part, warnings: &mut Warnings) -> Vec<ShellBox> {
        let mut list = Vec::new();
        boxes(part, (&shell(), [0.0, 1.0], 1.0), DAffine3::IDENTITY, None, warnings, &mut |b| list.push(b));
        list
    }

    #[test]
    fn flat_tiles_become_one_box_each() {
        let mut warnings = Warnings::default();
        assert_eq!(made(&ground(4, 0.0), &mut warnings).len(), 16);
        assert!(warnings.is_empty());
        let bulging = made(&ground(4, 0.3), &mut warnings);
        assert_eq!(bulging.len(), 32);
        assert!(bulging.iter().all(|b| matches!(b, ShellBox::Twisted(_))));
    }

    /// Tilted tiles 3 km out, whose positions are off by up to 2^-13 m.
    #[test]
    fn tiles_that_rounding_bends_are_one_box() {
        let mut part = ground(4, 0.0);
        for p in &mut part.positions {
            let [x, z] = [p[0] * 7.3, p[2] * 7.3];
            *p = [3000.1 + x, 40.3 + 0.123 * x - 0.077 * z, 2900.7 + z];
        }
        part.heights = Some(vec![[0.3, 5.0, 0.1]; part.positions.len()]);
        assert_eq!(made(&part, &mut Warnings::default()).len(), 16);
        // A centimetre is no rounding.
        part.positions.iter_mut().step_by(2).for_each(|p| p[1] += 0.01);
        assert_eq!(made(&part, &mut Warnings::default()).len(), 32);
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
        let heights = heights(&part, &shell(), &by_position(&part), &mut warnings);
        assert!(heights.iter().all(|h| *h == DVec3::new(0.0, 1.5, 0.0)));
        assert_eq!(warnings.iter().map(|w| w.1).sum::<u64>(), 4);
    }

    #[test]
    fn without_coordinates_there_is_a_word() {
        let part = Part { uvs: vec![], ..ground(1, 0.0) };
        let mut warnings = Warnings::default();
        assert!(made(&part, &mut warnings).is_empty());
        assert_eq!(warnings.iter().count(), 1);
    }
}
