//! The faces that a mapping covers: how large their texture coordinates are in metres, where they face, their attributes.

use std::collections::HashMap;

use gltf_json::mesh::{Mode, Semantic};
use gltf_json::validation::Checked;

use super::document::Document;
use super::map::Chart;
use super::nodes::Placed;
use crate::Result;
use crate::geom::{Aabb, DAffine3, DVec3};
use crate::scene::topology;

/// One primitive, as its first node shows it.
pub struct Sheet {
    pub mesh: usize,
    pub primitive: usize,
    pub material: Option<usize>,
    pub world: DAffine3,
    positions: Vec<[f32; 3]>,
    pub normals: Option<Vec<[f32; 3]>>,
    uvs: Option<Vec<[f32; 2]>>,
    triangles: Vec<[u32; 3]>,
}

/// A triangle in the world with its texture coordinates.
struct Face {
    /// Half of it is the area; along the normal of a front face.
    cross: DVec3,
    edges: [DVec3; 2],
    uv_edges: [[f64; 2]; 2],
}

impl Sheet {
    /// Read a primitive of triangles; `None` where it has no positions. `set` is the set of texture coordinates.
    pub fn read(document: &Document, placed: &Placed, primitive: usize, set: usize) -> Result<Option<Sheet>> {
        let at = format!("meshes[{}].primitives[{primitive}]", placed.mesh);
        let source = document.root.meshes.get(placed.mesh).and_then(|m| m.primitives.get(primitive));
        let Some(source) = source else { return Ok(None) };
        let accessor = |s: Semantic| source.attributes.get(&Checked::Valid(s)).map(|i| i.value());
        let Some(position) = accessor(Semantic::Positions) else { return Ok(None) };
        let positions: Vec<[f32; 3]> = document.read_floats(position, 3, [0.0; 3], &at)?;
        let n = positions.len();
        let normals = accessor(Semantic::Normals).map(|a| document.read_floats(a, 3, [0.0; 3], &at)).transpose()?;
        let uvs = accessor(Semantic::TexCoords(set as u32));
        let uvs = uvs.map(|a| document.read_floats(a, 2, [0.0; 2], &at)).transpose()?;
        let indices: Vec<u32> = match source.indices {
            Some(accessor) => document.read_uints::<1>(accessor.value(), &at)?.into_iter().map(|[i]| i).collect(),
            None => (0..n as u32).collect(),
        };
        let mut triangles = match source.mode {
            Checked::Valid(Mode::TriangleStrip) => topology::triangle_strip(&indices),
            Checked::Valid(Mode::TriangleFan) => topology::triangle_fan(&indices),
            _ => topology::triangles(&indices),
        };
        triangles
            .retain(|t| t.iter().all(|&i| (i as usize) < n && positions[i as usize].iter().all(|x| x.is_finite())));
        let as_long = |m: usize| m == n;
        Ok(Some(Sheet {
            mesh: placed.mesh,
            primitive,
            material: source.material.map(|m| m.value()),
            world: placed.world,
            normals: normals.filter(|v: &Vec<_>| as_long(v.len())),
            uvs: uvs.filter(|v: &Vec<_>| as_long(v.len())),
            positions,
            triangles,
        }))
    }

    fn point(&self, i: u32) -> DVec3 {
        self.positions.get(i as usize).map_or(DVec3::ZERO, |p| DVec3::from(p.map(f64::from)))
    }

    fn uv(&self, i: u32) -> [f64; 2] {
        self.uvs.as_ref().and_then(|uvs| uvs.get(i as usize)).map_or([0.0; 2], |uv| uv.map(f64::from))
    }

    fn faces(&self) -> impl Iterator<Item = Face> {
        let turned = self.world.matrix3.determinant() < 0.0;
        self.triangles.iter().map(move |&[a, b, c]| {
            let [p, q, r] = [a, b, c].map(|i| self.world.transform_point3(self.point(i)));
            let [s, t, u] = [a, b, c].map(|i| self.uv(i));
            let cross = (q - p).cross(r - p);
            Face {
                cross: if turned { -cross } else { cross },
                edges: [q - p, r - p],
                uv_edges: [[t[0] - s[0], t[1] - s[1]], [u[0] - s[0], u[1] - s[1]]],
            }
        })
    }

    /// `_VTEX_UVW`: copies of the texel counted from the chart's origin, on the base of the shell.
    pub fn uvw(&self, chart: Chart, scale: [f64; 2], origin: [f64; 2]) -> Vec<[f32; 3]> {
        (0..self.positions.len() as u32)
            .map(|i| {
                let uv = match chart {
                    Chart::Planar(axis) => planar(self.world.transform_point3(self.point(i)), axis),
                    _ => self.uv(i),
                };
                let at = |k: usize| ((uv[k] - origin[k]) * scale[k]) as f32;
                [at(0), at(1), 0.0]
            })
            .collect()
    }

    /// `_VTEX_HEIGHT`: the same world vector everywhere, in the mesh's own space.
    pub fn heights_along(&self, height: DVec3) -> Vec<[f32; 3]> {
        let own = self.world.matrix3.inverse() * height;
        vec![finite(own); self.positions.len()]
    }

    /// `_VTEX_HEIGHT`: `thickness` metres along the normals; vertices at one position get one vector, so that the shell
    /// does not tear at seams.
    pub fn heights_normal(&self, thickness: f64) -> Vec<[f32; 3]> {
        let mut sums: HashMap<[u32; 3], DVec3> = HashMap::new();
        let key = |i: u32| self.positions.get(i as usize).map(|p| p.map(|x| (x + 0.0).to_bits())).unwrap_or_default();
        let to_world = self.world.matrix3.inverse().transpose();
        match &self.normals {
            Some(normals) => {
                for (i, n) in normals.iter().enumerate() {
                    let n = (to_world * DVec3::from(n.map(f64::from))).normalize_or_zero();
                    *sums.entry(key(i as u32)).or_default() += n;
                }
            }
            None => {
                for (face, corners) in self.faces().zip(&self.triangles) {
                    for &i in corners {
                        *sums.entry(key(i)).or_default() += face.cross;
                    }
                }
            }
        }
        let back = self.world.matrix3.inverse();
        let height = |i: u32| {
            let n = sums.get(&key(i)).copied().unwrap_or_default().try_normalize().unwrap_or(DVec3::Y);
            finite(back * (n * thickness))
        };
        (0..self.positions.len() as u32).map(height).collect()
    }
}

/// Zero where a flattened node leaves no inverse.
fn finite(v: DVec3) -> [f32; 3] {
    if v.is_finite() { v.as_vec3().to_array() } else { [0.0; 3] }
}

/// (u, v) of a world point seen along an axis; with that axis as w they are right-handed.
fn planar(p: DVec3, axis: usize) -> [f64; 2] {
    match axis {
        0 => [p.y, p.z],
        1 => [p.x, -p.z],
        _ => [p.x, p.y],
    }
}

/// All sheets together.
pub struct Ground {
    /// Square metres.
    pub area: f64,
    /// Area vector: the sum of area × normal.
    pub facing: DVec3,
    pub has_uvs: bool,
    /// (u, v, outward) is a left-handed frame.
    pub mirrored: bool,
    /// How far texture coordinates reach along u and v.
    pub uv_span: [f64; 2],
    bounds: Aabb,
}

impl Ground {
    pub fn measure(sheets: &[Sheet]) -> Ground {
        let mut ground = Ground {
            area: 0.0,
            facing: DVec3::ZERO,
            has_uvs: !sheets.is_empty() && sheets.iter().all(|s| s.uvs.is_some()),
            mirrored: false,
            uv_span: [1.0; 2],
            bounds: Aabb::EMPTY,
        };
        let (mut turned, mut uv_area) = (0.0, 0.0);
        let mut span = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for sheet in sheets {
            let hand = if sheet.world.matrix3.determinant() < 0.0 { -1.0 } else { 1.0 };
            for face in sheet.faces() {
                let area = 0.5 * face.cross.length();
                ground.area += area;
                ground.facing += 0.5 * face.cross;
                let [[a, b], [c, d]] = face.uv_edges;
                let det = a * d - b * c;
                uv_area += det.abs();
                turned += area
                    * if det > 0.0 {
                        hand
                    } else if det < 0.0 {
                        -hand
                    } else {
                        0.0
                    };
            }
            for &i in sheet.triangles.iter().flatten() {
                ground.bounds = ground.bounds.grow(sheet.world.transform_point3(sheet.point(i)));
                for (span, x) in span.iter_mut().zip(sheet.uv(i)) {
                    *span = [span[0].min(x), span[1].max(x)];
                }
            }
        }
        // Edges in triangle order turn with the front face: there a positive determinant is a right-handed (u, v, outward),
        // and a mirrored node turns it round.
        ground.mirrored = turned < 0.0;
        ground.uv_span = span.map(|[min, max]| max - min);
        ground.has_uvs &= uv_area > 0.0 && ground.uv_span.iter().all(|s| s.is_finite() && *s > 0.0);
        ground
    }

    /// Metres that one unit of u and of v covers, on average over the chart; `along` is the direction of the heights,
    /// which does not count.
    pub fn uv_metres(&self, sheets: &[Sheet], along: Option<DVec3>) -> [f64; 2] {
        let (mut sum, mut weight) = ([0.0; 2], 0.0);
        for face in sheets.iter().flat_map(Sheet::faces) {
            let [[a, b], [c, d]] = face.uv_edges;
            let det = a * d - b * c;
            let [e, f] = face.edges.map(|e| along.map_or(e, |n| e - n * n.dot(e)));
            let lengths = [(e * d - f * b).length(), (f * a - e * c).length()];
            if det != 0.0 && lengths.iter().all(|x| x.is_finite()) {
                // Each length is |dP/du| × |det|, weighted by the area in the chart.
                sum = [sum[0] + lengths[0], sum[1] + lengths[1]];
                weight += det.abs();
            }
        }
        sum.map(|s| s / weight)
    }

    /// The planar chart's least and largest (u, v), metres.
    pub fn extent(&self, axis: usize) -> ([f64; 2], [f64; 2]) {
        let (a, b) = (planar(self.bounds.min, axis), planar(self.bounds.max, axis));
        ([a[0].min(b[0]), a[1].min(b[1])], [a[0].max(b[0]), a[1].max(b[1])])
    }
}
