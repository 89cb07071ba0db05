//! Triangles as a source: a model's instances laid into the grid, their colours and cut-outs looked up when asked.

use super::clip::Polygon;
use super::source::{Placement, Source, Staged, Surface};
use crate::geom::{Aabb, DVec3};
use crate::progress::Progress;
use crate::scene::model::{Alpha, Material, Model, Part};
use crate::{Error, Result, Warnings, morton, par};

/// A model's triangles.
pub struct MeshSource {
    model: Model,
    bounds: Aabb,
    facet_size: f64,
    warnings: Warnings,
    /// Per instance: whether its facets are one face of something closed.
    one_sided: Vec<bool>,
}

/// Triangles in a chunk of parallel work.
const CHUNK: usize = 4096;

impl MeshSource {
    pub fn new(model: Model, facet_size: f64, one_sided: Vec<bool>) -> MeshSource {
        let mut bounds = Aabb::EMPTY;
        for instance in &model.instances {
            let part = &model.parts[instance.part];
            for &i in part.triangles.iter().flatten() {
                bounds = bounds.grow(world(part, i, instance.transform));
            }
        }
        let warnings = model.warnings.clone();
        MeshSource { model, bounds, facet_size, warnings, one_sided }
    }

    /// Triangles of all instances.
    pub fn triangles(&self) -> u64 {
        self.model.instances.iter().map(|i| self.model.parts[i.part].triangles.len() as u64).sum()
    }
}

/// Corner `i` of `part` in world space.
pub fn world(part: &Part, i: u32, transform: crate::geom::DAffine3) -> DVec3 {
    transform.transform_point3(DVec3::from(part.positions[i as usize].map(f64::from)))
}

impl Source for MeshSource {
    fn bounds(&self) -> Aabb {
        self.bounds
    }

    fn metres_per_unit(&self) -> f64 {
        self.model.metres_per_unit
    }

    fn facet_size(&self) -> f64 {
        self.facet_size
    }

    fn has_colour(&self) -> bool {
        self.model.instances.iter().any(|i| {
            let part = &self.model.parts[i.part];
            let m = &self.model.materials[part.material];
            part.colors.is_some() || m.texture.is_some() || m.base_color[..3] != [1.0; 3]
        })
    }

    fn warnings(&self) -> &Warnings {
        &self.warnings
    }

    fn stage<'a>(&'a self, place: &Placement, progress: &dyn Progress) -> Result<Box<dyn Staged + 'a>> {
        let mut pieces = Vec::with_capacity(self.model.instances.len());
        let mut first = 0u64;
        for (i, instance) in self.model.instances.iter().enumerate() {
            let part = &self.model.parts[instance.part];
            let corners: Vec<DVec3> =
                (0..part.positions.len()).map(|i| place.to_grid(world(part, i as u32, instance.transform))).collect();
            // A mirrored part turns its triangles around.
            let mirrored = instance.transform.matrix3.determinant() < 0.0;
            let material = &self.model.materials[part.material];
            pieces.push(Piece {
                part,
                material,
                corners,
                first: first as u32,
                mirrored,
                one_sided: self.one_sided.get(i) == Some(&true),
            });
            first += part.triangles.len() as u64;
            if first > u64::from(u32::MAX) {
                return Err(Error::Limit {
                    what: "the number of triangles".into(),
                    needed: first,
                    allowed: u32::MAX.into(),
                });
            }
        }
        let mut staged = StagedMesh { pieces, regions: Vec::new(), starts: Vec::new(), facets: Vec::new() };
        staged.sort_by_region(first as usize, place, progress);
        Ok(Box::new(staged))
    }
}

/// One instance in the grid.
struct Piece<'a> {
    part: &'a Part,
    material: &'a Material,
    corners: Vec<DVec3>,
    /// Number of its first facet.
    first: u32,
    mirrored: bool,
    one_sided: bool,
}

impl Piece<'_> {
    fn triangle(&self, index: usize) -> [DVec3; 3] {
        let t = self.part.triangles[index].map(|i| self.corners[i as usize]);
        if self.mirrored { [t[0], t[2], t[1]] } else { t }
    }
}

struct StagedMesh<'a> {
    pieces: Vec<Piece<'a>>,
    regions: Vec<u64>,
    /// Where each region's facets start in `facets`, and the end.
    starts: Vec<usize>,
    facets: Vec<u32>,
}

impl StagedMesh<'_> {
    /// The piece of a facet and its triangle in it.
    fn find(&self, facet: u32) -> (&Piece<'_>, usize) {
        let at = self.pieces.partition_point(|p| p.first <= facet) - 1;
        // Pieces without triangles share their first number with the next, which is found first.
        let piece = &self.pieces[at];
        (piece, (facet - piece.first) as usize)
    }

    fn sort_by_region(&mut self, count: usize, place: &Placement, progress: &dyn Progress) {
        let chunks = count.div_ceil(CHUNK);
        progress.stage("sort", chunks as u64);
        let side = f64::from(1u32 << place.region_log2());
        let last = f64::from((place.side() >> place.region_log2()) - 1);
        let lists = par::map(chunks, |chunk| {
            let mut out: Vec<(u64, u32)> = Vec::new();
            for facet in chunk * CHUNK..count.min((chunk + 1) * CHUNK) {
                let (piece, index) = self.find(facet as u32);
                let t = piece.triangle(index);
                let normal = (t[1] - t[0]).cross(t[2] - t[0]);
                let area = normal.length_squared();
                if area.is_nan() || area <= 0.0 {
                    continue;
                }
                let lo = (t[0].min(t[1]).min(t[2]) / side).floor().clamp(DVec3::ZERO, DVec3::splat(last));
                let hi = (t[0].max(t[1]).max(t[2]) / side).floor().clamp(DVec3::ZERO, DVec3::splat(last));
                let (lo, hi) = (lo.as_uvec3(), hi.as_uvec3());
                for z in lo.z..=hi.z {
                    for y in lo.y..=hi.y {
                        for x in lo.x..=hi.x {
                            let middle = (DVec3::new(x.into(), y.into(), z.into()) + 0.5) * side;
                            // The plane's distance to the middle against the region's reach along the normal.
                            let reach = 0.5 * side * normal.abs().element_sum();
                            if normal.dot(middle - t[0]).abs() <= reach * (1.0 + 1e-9) {
                                out.push((morton::encode([x, y, z]), facet as u32));
                            }
                        }
                    }
                }
            }
            progress.advance(1);
            out
        });
        let mut pairs: Vec<(u64, u32)> = lists.concat();
        pairs.sort_unstable();
        for (i, &(region, facet)) in pairs.iter().enumerate() {
            if self.regions.last() != Some(&region) {
                self.regions.push(region);
                self.starts.push(i);
            }
            self.facets.push(facet);
        }
        self.starts.push(pairs.len());
    }
}

impl Staged for StagedMesh<'_> {
    fn regions(&self) -> &[u64] {
        &self.regions
    }

    fn weight(&self, region: usize) -> u64 {
        (self.starts[region + 1] - self.starts[region]) as u64
    }

    fn emit(&self, region: usize, out: &mut Vec<Polygon>) {
        for &facet in &self.facets[self.starts[region]..self.starts[region + 1]] {
            let (piece, index) = self.find(facet);
            out.push(Polygon::new(&piece.triangle(index), facet));
        }
    }

    fn surface(&self, facet: u32, at: DVec3, _width: f64) -> Surface {
        let (piece, index) = self.find(facet);
        let m = piece.material;
        let mut rgba = m.base_color;
        if let Some(colors) = &piece.part.colors {
            let corners = piece.part.triangles[index].map(|i| i as usize);
            let w = barycentric(corners.map(|i| piece.corners[i]), at);
            let c: [f32; 4] = std::array::from_fn(|e| (0..3).map(|i| w[i] as f32 * colors[corners[i]][e]).sum());
            for e in 0..4 {
                rgba[e] *= c[e];
            }
        }
        let alpha = match m.alpha {
            Alpha::Opaque => 1.0,
            Alpha::Mask(cutoff) => f32::from(u8::from(rgba[3] >= cutoff)),
            Alpha::Blend => rgba[3].clamp(0.0, 1.0),
        };
        Surface { albedo: [rgba[0], rgba[1], rgba[2]].map(|v| v.clamp(0.0, 1.0)), alpha }
    }

    fn cut_out(&self, facet: u32) -> bool {
        self.find(facet).0.material.alpha != Alpha::Opaque
    }

    fn one_sided(&self, facet: u32) -> bool {
        self.find(facet).0.one_sided
    }
}

/// Weights of the corners of `t` at `p`, clamped to the triangle.
fn barycentric(t: [DVec3; 3], p: DVec3) -> [f64; 3] {
    let (e1, e2, d) = (t[1] - t[0], t[2] - t[0], p - t[0]);
    let n = e1.cross(e2);
    let nn = n.length_squared();
    if nn.is_nan() || nn <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let w1 = (d.cross(e2).dot(n) / nn).clamp(0.0, 1.0);
    let w2 = (e1.cross(d).dot(n) / nn).clamp(0.0, 1.0 - w1);
    [1.0 - w1 - w2, w1, w2]
}
