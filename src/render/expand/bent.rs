//! Bent geometry: the triangles of texels' sources as shells deform them, clipped at the borders of regions and of cells, and mapped to the
//! world.

use std::collections::{BTreeMap, HashMap};

use super::clip::{ClipVertex, HalfSpace, clip};
use super::region::{FacePrism, Region};
use super::source::{SourceTriangle, SourceTriangles, VisitedTriangles};
use crate::geom::{Aabb, DAffine3, DMat3, DVec3, Vec3};
use crate::render::cells::TexelLayer;
use crate::render::faces::Face;
use crate::render::mesh::cofactor;
use crate::scene::Part;
use crate::scene::shell::CellWrap;

/// Identity of a mesh of bent triangles: a texel, a part of its source's model, and the bits of the tint.
pub type BentKey = (usize, usize, [u32; 3]);

/// Bent triangles of one identity; positions in the world, relative to an origin.
#[derive(Debug, Default)]
pub struct BentMesh {
    pub positions: Vec<[f32; 3]>,
    pub normals: Vec<[f32; 3]>,
    pub uvs: Vec<[f32; 2]>,
    pub colors: Vec<[f32; 4]>,
    pub triangles: Vec<[u32; 3]>,
}

/// All meshes of bent triangles.
#[derive(Debug, Default)]
pub struct BentMeshes(pub BTreeMap<BentKey, BentMesh>);

impl BentMeshes {
    /// Number of triangles.
    pub fn len(&self) -> u64 {
        self.0.values().map(|p| p.triangles.len() as u64).sum()
    }

    /// Bytes of memory that they take.
    pub fn bytes(&self) -> u64 {
        let of = |p: &BentMesh| {
            12 * (p.positions.len() + p.normals.len() + p.triangles.len()) + 8 * p.uvs.len() + 16 * p.colors.len()
        };
        self.0.values().map(|p| of(p) as u64).sum()
    }

    /// Append the triangles of another.
    pub fn append(&mut self, other: BentMeshes) {
        for (key, mut more) in other.0 {
            let own = self.0.entry(key).or_default();
            let first = own.positions.len() as u32;
            own.positions.append(&mut more.positions);
            own.normals.append(&mut more.normals);
            own.uvs.append(&mut more.uvs);
            own.colors.append(&mut more.colors);
            own.triangles.extend(more.triangles.iter().map(|t| t.map(|v| v + first)));
        }
    }
}

/// The bits of a copy's tint: exact, or rounded to steps of a twelfth of a stop, which is an error of at most 3 %.
pub fn tint_bits(tint: Vec3, exact: bool) -> [u32; 3] {
    let steps = |t: f32| (12.0 * libm::log2(f64::from(t))).round() / 12.0;
    let value = |t: f32| if exact || t <= 0.0 { t } else { libm::exp2(steps(t)) as f32 };
    tint.to_array().map(|t| value(t).to_bits())
}

/// Clips the triangles of sources and maps them into shells. Each thread has one.
pub struct ShellClipper<'a> {
    sources: &'a [Option<SourceTriangles>],
    /// Origin of the world positions.
    origin: DVec3,
    seen: VisitedTriangles,
    polygon: Vec<ClipVertex>,
    room: Vec<ClipVertex>,
    half_spaces: Vec<HalfSpace>,
    /// Vertices of the source that have been written already, by instance and vertex.
    shared: HashMap<(u32, u32), u32>,
    pub out: BentMeshes,
}

/// One copy in one region.
struct CopyInRegion<'a> {
    texel: usize,
    source: &'a SourceTriangles,
    tint: [u32; 3],
    to_world: DAffine3,
}

impl<'a> ShellClipper<'a> {
    pub fn new(sources: &'a [Option<SourceTriangles>], origin: DVec3) -> ShellClipper<'a> {
        ShellClipper {
            sources,
            origin,
            seen: VisitedTriangles::default(),
            polygon: Vec::new(),
            room: Vec::new(),
            half_spaces: Vec::new(),
            shared: HashMap::new(),
            out: BentMeshes::default(),
        }
    }

    /// Add the triangles of a layer in the shell over one face, to within `tolerance` cells. Returns false where that would be more than `most`
    /// triangles.
    pub fn face(&mut self, face: &Face, layer: &TexelLayer, tolerance: f64, most: u64) -> bool {
        let end = self.out.len().saturating_add(most);
        let mut room_left = true;
        FacePrism { face, layer }.regions(tolerance, &mut |region| {
            if room_left {
                self.region(region, layer);
                room_left = self.out.len() <= end;
            }
        });
        room_left
    }

    fn region(&mut self, region: &Region, layer: &TexelLayer) {
        let exact = layer.layer.discrete.as_ref().is_none_or(|d| d.tint.len() < 2);
        let [low, high] = cells(&region.bounds, layer);
        for u in low[0]..=high[0] {
            for v in low[1]..=high[1] {
                for w in low[2]..=high[2] {
                    let Some((copy, to_texel)) = layer.placed([u, v, w]) else { continue };
                    let Some(Some(source)) = self.sources.get(copy.texel) else { continue };
                    let back = to_texel.inverse();
                    self.half_spaces.clear();
                    self.half_spaces.extend(region.half_spaces.iter().map(|s| s.preimage(&back)));
                    self.half_spaces.extend(borders([u, v, w], layer).iter().map(|s| s.preimage(&back)));
                    if layer.reach != [0; 3] {
                        self.half_spaces.extend(cube());
                    }
                    let to_world = region.to_world * back;
                    let bounds = region.bounds.transformed(to_texel).intersection(reached(layer, &to_texel, [u, v, w]));
                    let tint = tint_bits(copy.tint, exact);
                    self.copy(&CopyInRegion { texel: copy.texel, source, tint, to_world }, &bounds);
                }
            }
        }
    }

    /// Add the source of a cyclic texel, clipped at its cube, in texel space.
    pub fn cube_of(&mut self, texel: usize, tint: [u32; 3]) {
        let Some(Some(source)) = self.sources.get(texel) else { return };
        self.half_spaces.clear();
        self.half_spaces.extend(cube());
        let to_world = DAffine3::from_translation(self.origin);
        self.copy(&CopyInRegion { texel, source, tint, to_world }, &Aabb::UNIT);
    }

    fn copy(&mut self, placed: &CopyInRegion<'_>, bounds: &Aabb) {
        self.shared.clear();
        let mut seen = std::mem::take(&mut self.seen);
        placed.source.for_each(bounds, &mut seen, &mut |_, triangle| self.triangle(placed, triangle));
        self.seen = seen;
    }

    fn triangle(&mut self, placed: &CopyInRegion<'_>, triangle: &SourceTriangle) {
        let corner = |k: usize| ClipVertex {
            x: triangle.corners[k],
            b: [f64::from(u8::from(k == 1)), f64::from(u8::from(k == 2))],
            corner: k as u8,
        };
        self.polygon.clear();
        self.polygon.extend([corner(0), corner(1), corner(2)]);
        clip(&mut self.polygon, &mut self.room, &self.half_spaces);
        if self.polygon.len() < 3 {
            return;
        }
        let model = &placed.source.mesh.model;
        let Some(instance) = model.instances.get(triangle.instance as usize) else { return };
        let Some(part) = model.parts.get(instance.part) else { return };
        let Some(&indices) = part.triangles.get(triangle.index as usize) else { return };
        let matrix = placed.to_world.matrix3 * instance.transform.matrix3;
        let tex_coord = model.materials.get(part.material).and_then(|m| m.texture.as_ref()).map(|t| t.tex_coord);
        let piece = self.out.0.entry((placed.texel, instance.part, placed.tint)).or_default();
        let source = SourcePart { part, indices, tex_coord, turn: cofactor(matrix) };
        let mut fan = [0u32; 3];
        let flipped = matrix.determinant() < 0.0;
        for (k, point) in self.polygon.iter().enumerate() {
            let vertex = indices.get(usize::from(point.corner)).copied();
            let known = vertex.and_then(|v| self.shared.get(&(triangle.instance, v)).copied());
            let index = known.unwrap_or_else(|| {
                let at = placed.to_world.transform_point3(point.x) - self.origin;
                source.add(piece, at, point.b)
            });
            if let (Some(v), None) = (vertex, known) {
                self.shared.insert((triangle.instance, v), index);
            }
            match k {
                0 => fan[0] = index,
                1 => fan[1] = index,
                _ => {
                    fan[2] = index;
                    if has_area(&piece.positions, fan) {
                        piece.triangles.push(if flipped { [fan[0], fan[2], fan[1]] } else { fan });
                    }
                    fan[1] = index;
                }
            }
        }
    }
}

/// A triangle of a source, from which the attributes of clipped vertices are interpolated.
struct SourcePart<'a> {
    part: &'a Part,
    indices: [u32; 3],
    /// The set of texture coordinates that the material uses.
    tex_coord: Option<usize>,
    /// The map of normals.
    turn: DMat3,
}

impl SourcePart<'_> {
    /// Add a vertex with the weights `b` of the corners 1 and 2. Returns its index.
    fn add(&self, piece: &mut BentMesh, at: DVec3, b: [f64; 2]) -> u32 {
        let weights = [1.0 - b[0] - b[1], b[0], b[1]];
        let index = piece.positions.len() as u32;
        piece.positions.push(at.as_vec3().to_array());
        if let Some(normals) = &self.part.normals {
            let sum = self.sum(normals, weights);
            let normal = (self.turn * DVec3::from_array(sum)).normalize_or(DVec3::Y);
            piece.normals.push(normal.as_vec3().to_array());
        }
        if let Some(uvs) = self.tex_coord.and_then(|k| self.part.uvs.get(k)) {
            piece.uvs.push(self.sum(uvs, weights).map(|v| v as f32));
        }
        if let Some(colors) = &self.part.colors {
            piece.colors.push(self.sum(colors, weights).map(|v| v as f32));
        }
        index
    }

    fn sum<const N: usize>(&self, values: &[[f32; N]], weights: [f64; 3]) -> [f64; N] {
        let mut sum = [0.0; N];
        for (v, weight) in self.indices.iter().zip(weights) {
            let value = values.get(*v as usize).copied().unwrap_or([0.0; N]);
            sum.iter_mut().zip(value).for_each(|(s, x)| *s += weight * f64::from(x));
        }
        sum
    }
}

fn has_area(positions: &[[f32; 3]], [a, b, c]: [u32; 3]) -> bool {
    let at = |i: u32| positions.get(i as usize).map_or(DVec3::ZERO, |p| DVec3::from_array(p.map(f64::from)));
    (at(b) - at(a)).cross(at(c) - at(a)).length_squared() > 0.0
}

/// Lowest and highest of the cells whose copies may reach into a box of texel coordinates.
fn cells(bounds: &Aabb, layer: &TexelLayer) -> [[i64; 3]; 2] {
    let at = |k: usize, x: f64, by: i64| match layer.layer.wrap[k] {
        CellWrap::Empty => 0,
        _ => (x.floor() as i64).saturating_add(by),
    };
    [
        std::array::from_fn(|k| at(k, bounds.min[k], -layer.reach[k])),
        std::array::from_fn(|k| at(k, bounds.max[k], layer.reach[k])),
    ]
}

/// The half-spaces that bound the copy of `cell`, in the layer's texel coordinates: the cell's own borders. For copies that reach over their
/// cells, only those along axes without repetition.
fn borders(cell: [i64; 3], layer: &TexelLayer) -> Vec<HalfSpace> {
    let mut half_spaces = Vec::with_capacity(6);
    for k in 0..3 {
        let empty = layer.layer.wrap[k] == CellWrap::Empty;
        if layer.reach == [0; 3] || empty {
            let low = cell[k] as f64;
            let n = DVec3::from_array(std::array::from_fn(|i| f64::from(u8::from(i == k))));
            half_spaces.push(HalfSpace { n: -n, c: -low, closed: true });
            half_spaces.push(HalfSpace { n, c: low + 1.0, closed: empty });
        }
    }
    half_spaces
}

/// Bounding box, in texel space, of the part of a copy that may be visible.
fn reached(layer: &TexelLayer, to_texel: &DAffine3, cell: [i64; 3]) -> Aabb {
    if layer.reach != [0; 3] {
        return Aabb::UNIT;
    }
    let low = DVec3::from_array(cell.map(|c| c as f64));
    let own = Aabb::new(low, low + 1.0).transformed(*to_texel);
    Aabb::new(own.min - 1e-9, own.max + 1e-9)
}

/// The half-spaces of a texel's cube. Its upper faces along u and v belong to the next cube.
fn cube() -> [HalfSpace; 6] {
    [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z].map(|n| {
        let upper = n.element_sum() > 0.0;
        HalfSpace { n, c: if upper { 1.0 } else { 0.0 }, closed: !upper || n == DVec3::Z }
    })
}
