//! The surfaces that a mapping covers: their geometry and attributes, the size of their texture coordinates in metres, and their orientation.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, HashMap};
use std::rc::Rc;

use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;
use serde_json::Value;

use super::super::document::Document;
use super::super::material::uv_transform;
use super::super::nodes::{self, Placed};
use super::super::patches;
use crate::geom::{Aabb, DAffine3, DMat3, DVec3};
use crate::scene::topology;
use crate::{Result, Warnings};

/// The key under a primitive's `extras` that lists the attributes that a mapping wrote, so that the next one may replace them.
pub const WRITTEN: &str = "vtexMap";

/// A primitive of triangles, in its own space.
pub struct Geometry {
    pub positions: Vec<[f32; 3]>,
    pub normals: Option<Vec<[f32; 3]>>,
    uvs: Option<Vec<[f32; 2]>>,
    /// KHR_texture_transform of the texture that the coordinates belong to: uv' = rows · (u, v, 1).
    pub uv_rows: [[f32; 3]; 2],
    pub triangles: Vec<[u32; 3]>,
    /// Whether successive triangles that begin at the same vertex form polygons (FB_ngon_encoding).
    pub polygons: bool,
    /// `_VTEX_UVW` and `_VTEX_HEIGHT` of the file.
    pub uvw: Option<Vec<[f32; 3]>>,
    pub heights: Option<Vec<[f32; 3]>>,
    /// Names of the attributes that an earlier mapping wrote.
    written: Vec<String>,
}

impl Geometry {
    /// Read primitive `primitive` of mesh `mesh`; `None` where it has no positions. `set` is the set of texture coordinates.
    pub fn read(document: &Document, mesh: usize, primitive: usize, set: usize) -> Result<Option<Geometry>> {
        let at = format!("meshes[{mesh}].primitives[{primitive}]");
        let source = document.root.meshes.get(mesh).and_then(|m| m.primitives.get(primitive));
        let Some(source) = source else { return Ok(None) };
        let accessor = |s: Semantic| source.attributes.get(&Checked::Valid(s)).map(|i| i.value());
        let custom = |name: &str| accessor(Semantic::Extras(name.into()));
        let Some(position) = accessor(Semantic::Positions) else { return Ok(None) };
        let positions: Vec<[f32; 3]> = document.read_floats(position, 3, [0.0; 3], &at)?;
        let n = positions.len();
        fn floats<const N: usize>(
            document: &Document,
            accessor: Option<usize>,
            n: usize,
            at: &str,
        ) -> Result<Option<Vec<[f32; N]>>> {
            let read = accessor.map(|a| document.read_floats::<N>(a, N, [0.0; N], at)).transpose()?;
            Ok(read.filter(|v| v.len() == n))
        }
        let normals = floats::<3>(document, accessor(Semantic::Normals), n, &at)?;
        let uvs = floats::<2>(document, accessor(Semantic::TexCoords(set as u32)), n, &at)?;
        let uvw = floats::<3>(document, custom("VTEX_UVW"), n, &at)?;
        let heights = floats::<3>(document, custom("VTEX_HEIGHT"), n, &at)?;
        let extras = source.extras.as_ref().and_then(|e| serde_json::from_str::<Value>(e.get()).ok());
        let written =
            extras.and_then(|mut e| serde_json::from_value(e.get_mut(WRITTEN)?.take()).ok()).unwrap_or_default();
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
        let material = source.material.and_then(|m| document.root.materials.get(m.value()));
        let uv_rows = uv_transform(material, set as u32);
        let polygons = patches::uses_polygons(document)
            && source.mode == Checked::Valid(Mode::Triangles)
            // A triangle that was left out may have separated two polygons.
            && 3 * triangles.len() == indices.len();
        Ok(Some(Geometry { polygons, positions, normals, uvs, uv_rows, triangles, uvw, heights, written }))
    }

    fn point(&self, i: u32) -> DVec3 {
        self.positions.get(i as usize).map_or(DVec3::ZERO, |p| DVec3::from(p.map(f64::from)))
    }

    /// Whether the attribute `name`, if present, comes from the file's author and not from an earlier mapping.
    pub fn is_authored(&self, name: &str) -> bool {
        !self.written.iter().any(|w| w == name)
    }

    /// Whether texture coordinates are there.
    pub fn has_uvs(&self) -> bool {
        self.uvs.is_some()
    }

    /// (u, v) as the texture has them; 0 where there are none.
    fn uv(&self, i: u32) -> [f64; 2] {
        let [u, v] = self.uvs.as_ref().and_then(|uvs| uvs.get(i as usize)).copied().unwrap_or_default().map(f64::from);
        self.uv_rows.map(|[a, b, c]| f64::from(a) * u + f64::from(b) * v + f64::from(c))
    }
}

/// The coordinates that a chart uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coordinates {
    Uv,
    /// Those of `_VTEX_UVW`.
    Own,
    /// World coordinates seen along an axis.
    Planar(usize),
}

/// One primitive of a mesh, with all nodes that show it in the same size and with the same direction of up.
pub struct Surface {
    pub mesh: usize,
    pub primitive: usize,
    pub material: Option<usize>,
    pub geometry: Rc<Geometry>,
    /// Maps from the primitive to the world. The first stands for all, since they differ only by translations and by rotations about up.
    pub worlds: Vec<DAffine3>,
    /// Nodes that show it.
    pub nodes: Vec<usize>,
}

/// A triangle in the world with its chart coordinates.
pub struct Face {
    pub corners: [DVec3; 3],
    /// Twice the area vector, in the direction of the front face's normal.
    pub cross: DVec3,
    pub chart: [[f64; 2]; 3],
}

impl Surface {
    /// Whether some triangle has an area in the world.
    pub fn has_area(&self) -> bool {
        self.faces(self.world(), Coordinates::Uv).any(|f| f.cross.length() > 0.0)
    }

    pub fn world(&self) -> DAffine3 {
        self.worlds.first().copied().unwrap_or(DAffine3::IDENTITY)
    }

    fn chart_of(&self, i: u32, coordinates: Coordinates, world: &DAffine3) -> [f64; 2] {
        match coordinates {
            Coordinates::Uv => self.geometry.uv(i),
            Coordinates::Own => {
                let own = self.geometry.uvw.as_ref().and_then(|v| v.get(i as usize)).copied().unwrap_or_default();
                [own[0].into(), own[1].into()]
            }
            Coordinates::Planar(axis) => planar(world.transform_point3(self.geometry.point(i)), axis),
        }
    }

    /// The triangles as `world` places them.
    pub fn faces(&self, world: DAffine3, coordinates: Coordinates) -> impl Iterator<Item = Face> {
        let turned = world.matrix3.determinant() < 0.0;
        self.geometry.triangles.iter().map(move |t| {
            let corners = t.map(|i| world.transform_point3(self.geometry.point(i)));
            let chart = t.map(|i| self.chart_of(i, coordinates, &world));
            let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            Face { corners, cross: if turned { -cross } else { cross }, chart }
        })
    }

    /// `_VTEX_UVW`: copies of the texel counted from the chart's origin, on the base of the shell.
    pub fn uvw(&self, coordinates: Coordinates, scale: [f64; 2], origin: [f64; 2]) -> Vec<[f32; 3]> {
        let world = self.world();
        let at = |i: u32| {
            let c = self.chart_of(i, coordinates, &world);
            [((c[0] - origin[0]) * scale[0]) as f32, ((c[1] - origin[1]) * scale[1]) as f32, 0.0]
        };
        (0..self.geometry.positions.len() as u32).map(at).collect()
    }

    /// `_VTEX_HEIGHT`: the same world vector everywhere, in the mesh's own space.
    pub fn heights_along(&self, height: DVec3) -> Vec<[f32; 3]> {
        let own = self.world().matrix3.inverse() * height;
        vec![finite(own); self.geometry.positions.len()]
    }

    /// `_VTEX_HEIGHT`: `thickness` metres along the normals; vertices at one position get one vector, so that the shell
    /// does not tear at seams.
    pub fn heights_normal(&self, thickness: f64) -> Vec<[f32; 3]> {
        let (world, geometry) = (self.world(), &*self.geometry);
        let mut sums: HashMap<[u32; 3], DVec3> = HashMap::new();
        let key =
            |i: u32| geometry.positions.get(i as usize).map(|p| p.map(|x| (x + 0.0).to_bits())).unwrap_or_default();
        let to_world = world.matrix3.inverse().transpose();
        match &geometry.normals {
            Some(normals) => {
                for (i, n) in normals.iter().enumerate() {
                    let n = (to_world * DVec3::from(n.map(f64::from))).normalize_or_zero();
                    *sums.entry(key(i as u32)).or_default() += n;
                }
            }
            None => {
                for (face, corners) in self.faces(world, Coordinates::Uv).zip(&geometry.triangles) {
                    for &i in corners {
                        *sums.entry(key(i)).or_default() += face.cross;
                    }
                }
            }
        }
        let back = world.matrix3.inverse();
        let height = |i: u32| {
            let n = sums.get(&key(i)).copied().unwrap_or_default().try_normalize().unwrap_or(DVec3::Y);
            finite(back * (n * thickness))
        };
        (0..geometry.positions.len() as u32).map(height).collect()
    }

    /// `_VTEX_HEIGHT` of the file, turned from Z up to Y up.
    pub fn heights_turned(&self) -> Option<Vec<[f32; 3]>> {
        self.geometry.heights.as_ref().map(|h| h.iter().copied().map(turned).collect())
    }

    /// Mean length of the file's height vectors in the world, metres, and the mean cosines between them and the normals of
    /// the faces: as they are, and turned from Z up to Y up. `None` where there are none.
    pub fn height_facts(&self) -> Option<[f64; 3]> {
        let heights = self.geometry.heights.as_ref()?;
        let world = self.world();
        let (mut sums, mut weight) = ([0.0; 3], 0.0);
        for (face, t) in self.faces(world, Coordinates::Uv).zip(&self.geometry.triangles) {
            let n = face.cross.normalize_or_zero();
            for &i in t {
                let own = heights.get(i as usize).copied().unwrap_or_default();
                let [h, z] = [own, turned(own)].map(|h| world.matrix3 * DVec3::from(h.map(f64::from)));
                let area = face.cross.length();
                let values = [h.length(), h.normalize_or_zero().dot(n), z.normalize_or_zero().dot(n)];
                sums = std::array::from_fn(|k| sums[k] + area * values[k]);
                weight += area;
            }
        }
        (weight > 0.0).then(|| sums.map(|s| s / weight))
    }
}

/// A vector with Z up, converted to Y up as exporters do.
fn turned([x, y, z]: [f32; 3]) -> [f32; 3] {
    [x, z, -y]
}

/// The vector in single precision; zero if it is not finite, as where a flattened node has no inverse.
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

/// Relative difference up to which two transforms of a primitive can share a mapping.
const SAME_SHAPE: f64 = 1e-4;

/// Which surfaces are asked for, and what they are to have.
pub struct SurfaceQuery<'a> {
    /// Whether primitives of a material are taken.
    pub takes: &'a dyn Fn(Option<usize>) -> bool,
    /// Set of texture coordinates.
    pub set: usize,
    /// Direction of the heights; along the normals where it is `None`.
    pub up: Option<DVec3>,
    /// Whether charts are planar, and so depend on a node's position.
    pub planar: bool,
}

impl SurfaceQuery<'_> {
    /// Whether the attributes that are written for a primitive at `a` are right at `b` too: the transforms differ by a translation
    /// and a rotation about `up` only, or by any rotation without `up`; under planar charts not at all.
    fn alike(&self, a: &DAffine3, b: &DAffine3) -> bool {
        let near = |a: DMat3, b: DMat3| {
            let size = a.to_cols_array().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            (a - b).to_cols_array().iter().all(|v| v.abs() <= SAME_SHAPE * size)
        };
        if self.planar {
            let size = a.translation.abs().max_element().max(1.0);
            let moved = (a.translation - b.translation).abs().max_element();
            return near(a.matrix3, b.matrix3) && moved <= SAME_SHAPE * size;
        }
        // Lengths and angles within the primitive must agree, and the direction of up in it; rotations about up change nothing.
        let (aa, bb) = (a.matrix3.transpose() * a.matrix3, b.matrix3.transpose() * b.matrix3);
        let [p, q] = [a, b].map(|m| self.up.map_or(DVec3::ZERO, |up| m.matrix3.transpose() * up));
        let same_hand = (a.matrix3.determinant() < 0.0) == (b.matrix3.determinant() < 0.0);
        near(aa, bb) && (p - q).length() <= SAME_SHAPE * p.length().max(q.length()) && same_hand
    }
}

/// The surfaces that are asked for, each once for all nodes that show it alike.
pub fn surfaces(
    document: &Document,
    placed: &[Placed],
    query: &SurfaceQuery,
    warnings: &mut Warnings,
) -> Result<Vec<Surface>> {
    let mut surfaces: Vec<Surface> = Vec::new();
    let mut read: BTreeMap<(usize, usize), Option<Rc<Geometry>>> = BTreeMap::new();
    let material_of = |primitive: &Primitive| primitive.material.map(|m| m.value());
    for placed in placed {
        let primitives = document.root.meshes.get(placed.mesh).map_or(&[][..], |m| &m.primitives);
        if !primitives.iter().any(|p| (query.takes)(material_of(p))) {
            continue;
        }
        let worlds = nodes::instances(document, placed, None, &mut Warnings::default())?;
        let Some(&first) = worlds.first() else { continue };
        if worlds.iter().any(|w| !query.alike(w, &first)) {
            warnings.add(format!(
                "{}: its instances differ in size or tilt, and one mapping serves them all: copies differ in size",
                placed.name
            ));
        }
        for (i, primitive) in primitives.iter().enumerate().filter(|(_, p)| (query.takes)(material_of(p))) {
            let solid = [Mode::Triangles, Mode::TriangleStrip, Mode::TriangleFan].map(Checked::Valid);
            if !solid.contains(&primitive.mode) {
                warnings.add("points and lines cannot be covered and stay as they are");
                continue;
            }
            let geometry = match read.entry((placed.mesh, i)) {
                Entry::Occupied(known) => known.get().clone(),
                Entry::Vacant(new) => {
                    new.insert(Geometry::read(document, placed.mesh, i, query.set)?.map(Rc::new)).clone()
                }
            };
            let Some(geometry) = geometry else { continue };
            let is_known =
                |s: &&mut Surface| (s.mesh, s.primitive) == (placed.mesh, i) && query.alike(&s.world(), &first);
            match surfaces.iter_mut().find(is_known) {
                Some(known) => {
                    known.worlds.extend(&worlds);
                    known.nodes.extend(placed.node);
                }
                None => surfaces.push(Surface {
                    mesh: placed.mesh,
                    primitive: i,
                    material: material_of(primitive),
                    geometry,
                    worlds: worlds.clone(),
                    nodes: placed.node.into_iter().collect(),
                }),
            }
        }
    }
    Ok(surfaces)
}

/// Measurements of surfaces that share a chart and its density.
#[derive(Debug, Clone)]
pub struct SurfaceStats {
    /// Square metres, of all placements.
    pub area: f64,
    /// Sum of the area vectors.
    pub facing: DVec3,
    /// Metres that one unit of the chart covers along each axis, on average over the chart; 0 where it has no area.
    pub metres: [f64; 2],
    /// Whether (u, v, up) is left-handed over most of the area.
    pub mirrored: bool,
    /// Least and largest coordinates.
    pub span: [[f64; 2]; 2],
    pub bounds: Aabb,
}

impl SurfaceStats {
    /// `up`: the direction of the heights, which does not count as length along u or v; along the normals where it is `None`.
    pub fn of<'a>(
        surfaces: impl IntoIterator<Item = &'a Surface>,
        coordinates: Coordinates,
        up: Option<DVec3>,
    ) -> SurfaceStats {
        let mut stats = SurfaceStats {
            area: 0.0,
            facing: DVec3::ZERO,
            metres: [0.0; 2],
            mirrored: false,
            span: [[f64::INFINITY, f64::NEG_INFINITY]; 2],
            bounds: Aabb::EMPTY,
        };
        let (mut handed, mut weight) = (0.0, 0.0);
        for surface in surfaces {
            for (k, world) in surface.worlds.iter().enumerate() {
                for face in surface.faces(*world, coordinates) {
                    let area = 0.5 * face.cross.length();
                    stats.area += area;
                    stats.facing += 0.5 * face.cross;
                    stats.bounds = face.corners.iter().fold(stats.bounds, |b, p| b.grow(*p));
                    if k > 0 && !matches!(coordinates, Coordinates::Planar(_)) {
                        continue;
                    }
                    let [p, q, r] = face.chart;
                    for c in face.chart {
                        for (span, x) in stats.span.iter_mut().zip(c) {
                            *span = [span[0].min(x), span[1].max(x)];
                        }
                    }
                    let [[a, b], [c, d]] = [[q[0] - p[0], q[1] - p[1]], [r[0] - p[0], r[1] - p[1]]];
                    let det = a * d - b * c;
                    let edges = [face.corners[1] - face.corners[0], face.corners[2] - face.corners[0]];
                    // Edges in triangle order turn with the world's own handedness, whatever a mirrored node makes of the front.
                    let winding = edges[0].cross(edges[1]);
                    let above = up.map_or_else(|| winding.dot(face.cross), |up| winding.dot(up));
                    handed += area * det.signum() * f64::from(u8::from(det != 0.0)) * above.signum();
                    let [e, f] = edges.map(|e| up.map_or(e, |n| e - n * n.dot(e)));
                    let lengths = [(e * d - f * b).length(), (f * a - e * c).length()];
                    if det != 0.0 && lengths.iter().all(|x| x.is_finite()) {
                        // Each length is |dP/du| × |det|, weighted by the area in the chart.
                        stats.metres = [stats.metres[0] + lengths[0], stats.metres[1] + lengths[1]];
                        weight += det.abs();
                    }
                }
            }
        }
        stats.metres = if weight > 0.0 { stats.metres.map(|m| m / weight) } else { [0.0; 2] };
        stats.mirrored = handed < 0.0;
        stats
    }

    /// Extent of the chart along its axes.
    pub fn extent(&self) -> [f64; 2] {
        self.span.map(|[min, max]| if max >= min { max - min } else { 0.0 })
    }

    /// Whether the chart has an area and an extent along both axes.
    pub fn usable(&self) -> bool {
        self.metres.iter().all(|m| *m > 0.0 && m.is_finite()) && self.extent().iter().all(|s| *s > 0.0 && s.is_finite())
    }
}
