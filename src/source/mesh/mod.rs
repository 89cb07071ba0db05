//! Triangles as a source: a model's instances laid into the grid, their colours and cut-outs looked up when asked.

mod bsdf;
mod interior;
pub mod patch;

use std::collections::BTreeSet;

use self::interior::Interior;
use self::patch::Face;
use super::memory_budget::MemoryBudget;
use super::placement::Placement;
use super::traits::{AlphaSampler, FACET_MEMORY, Source, Staged, Surface};
use crate::geom::polygon::Polygon;
use crate::geom::{Aabb, DAffine3, DVec3};
use crate::progress::Progress;
use crate::scene::alpha::{AlphaClass, AlphaSums};
use crate::scene::far;
use crate::scene::model::{Alpha, Material, Model, Part};
use crate::scene::texture::Texture;
use crate::source::materials::of_model;
use crate::volume::surface::SurfaceMeans;
use crate::{Error, Result, Warnings, morton, par};

/// Options of a mesh source.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MeshOptions {
    /// Treatment of the inside of closed surfaces.
    pub fill: Fill,
}

/// Treatment of the inside of closed surfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fill {
    /// Nothing: facets alone.
    Surface,
    /// Opaque matter in every component that closes, with a warning for those that do not.
    Solid,
    /// Opaque matter in every component that closes.
    #[default]
    Auto,
}

/// A model's triangles.
pub struct MeshSource {
    model: Model,
    /// Offset that was subtracted from the positions of all instances.
    origin: DVec3,
    bounds: Aabb,
    facet_size: f64,
    warnings: Warnings,
    notes: Vec<String>,
    /// Role of each triangle as a boundary of matter, one list per part.
    faces: Vec<Vec<Face>>,
    /// Summed-area table of the alpha of each material that is cut out or blended.
    alphas: Vec<Option<AlphaSums>>,
    fill: Fill,
    names: Vec<String>,
    /// The id in `names` of each of the model's materials.
    ids: Vec<u16>,
}

/// Triangles in a chunk of parallel work.
const CHUNK: usize = 4096;

impl MeshSource {
    /// Source of the triangles of `model`, whose lines and points are left out with a warning.
    pub fn new(mut model: Model, options: &MeshOptions) -> MeshSource {
        let mut warnings = std::mem::take(&mut model.warnings);
        let skipped = model.instances.iter().map(|i| &model.parts[i.part]).map(|p| p.lines.len() + p.points.len());
        let skipped = skipped.sum::<usize>() as u64;
        warnings.add_many("lines and points are left out: give them a width with option `width`", skipped);
        let patches = par::map(model.parts.len(), |i| {
            let part = &model.parts[i];
            patch::analyse(part, model.materials.get(part.material).is_some_and(|m| !m.double_sided))
        });
        let origin = far::offset(bounds_of(&model, DAffine3::IDENTITY));
        if origin != DVec3::ZERO {
            model.instances.iter_mut().for_each(|i| i.transform.translation -= origin);
        }
        let bounds = bounds_of(&model, DAffine3::IDENTITY);
        let mut sizes = Vec::new();
        for instance in &model.instances {
            let part = &model.parts[instance.part];
            let scale = libm::cbrt(instance.transform.matrix3.determinant().abs());
            let there = opaque_share(&model.materials[part.material]);
            let list = &patches[instance.part].patches;
            let area: f64 = list.iter().map(|p| p.1).sum();
            sizes
                .push((scale * libm::sqrt(there) * patch::weighted_median(list.clone()), scale * scale * there * area));
        }
        let faces: Vec<Vec<Face>> = patches.into_iter().map(|p| p.faces).collect();
        if options.fill == Fill::Solid {
            let open = faces.iter().flatten().filter(|f| !f.is_closed()).count();
            warnings.add_many(
                "triangles of surfaces that do not close are left hollow by option `fill` solid",
                open as u64,
            );
        }
        for material in used_materials(&model) {
            if let Some(why) = invisible(material) {
                warnings.add(why);
            }
        }
        let alphas = par::map(model.materials.len(), |i| AlphaSums::of(&model.materials[i]));
        let (names, ids) = of_model(&model, |part| !part.triangles.is_empty());
        MeshSource {
            names,
            ids,
            origin,
            notes: if origin == DVec3::ZERO { Vec::new() } else { vec![far::note(origin)] },
            bounds,
            facet_size: patch::weighted_median(sizes),
            warnings,
            faces,
            alphas,
            fill: options.fill,
            model,
        }
    }

    /// Triangles of all instances.
    pub fn triangles(&self) -> u64 {
        self.model.instances.iter().map(|i| self.model.parts[i.part].triangles.len() as u64).sum()
    }
}

/// The box of all triangles, placed by `transform`.
fn bounds_of(model: &Model, transform: DAffine3) -> Aabb {
    Aabb::around(model.instances.iter().flat_map(|instance| {
        let part = &model.parts[instance.part];
        let map = transform * instance.transform;
        part.triangles.iter().flatten().map(move |&i| world(part, i, map))
    }))
}

/// The materials of parts that are placed, each once.
fn used_materials(model: &Model) -> impl Iterator<Item = &Material> {
    let used: BTreeSet<usize> = model.instances.iter().map(|i| model.parts[i.part].material).collect();
    used.into_iter().filter_map(|m| model.materials.get(m))
}

/// Warning about a material that is transparent everywhere, whatever the mesh.
fn invisible(material: &Material) -> Option<String> {
    let texels = material.texture.as_ref().map(|t| t.texture.texels.iter().map(|t| t[3]).max().unwrap_or(0));
    let most = material.base_color[3] * texels.map_or(1.0, |code| f32::from(code) / 255.0);
    let name = &material.name;
    match material.alpha {
        Alpha::Mask(cutoff) if most < cutoff => Some(format!(
            "material {name}: nothing of it is there, since its alpha cutoff of {cutoff} is above all of its alpha (at most {most})"
        )),
        Alpha::Blend if most <= 0.0 => Some(format!("material {name}: nothing of it is there, since its alpha is 0")),
        _ => None,
    }
}

/// Mean alpha of the material's texture, in [0.01, 1]; 1 for opaque materials.
fn opaque_share(material: &Material) -> f64 {
    match (&material.texture, material.alpha) {
        (Some(t), Alpha::Mask(_) | Alpha::Blend) => {
            let whole = t.texture.width.max(t.texture.height) as f32;
            f64::from(t.texture.average([0.5, 0.5], whole)[3]).clamp(0.01, 1.0)
        }
        _ => 1.0,
    }
}

/// Corner `i` of `part` in world space.
pub fn world(part: &Part, i: u32, transform: DAffine3) -> DVec3 {
    transform.transform_point3(DVec3::from(part.positions[i as usize].map(f64::from)))
}

impl Source for MeshSource {
    fn bounds(&self) -> Aabb {
        self.bounds
    }

    fn origin(&self) -> DVec3 {
        self.origin
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn bounds_in(&self, transform: DAffine3) -> Aabb {
        bounds_of(&self.model, transform)
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

    fn materials(&self) -> &[String] {
        &self.names
    }

    fn surfaces(&self) -> Vec<SurfaceMeans> {
        bsdf::means(&self.model, &self.faces, &self.ids, self.names.len())
    }

    fn warnings(&self) -> &Warnings {
        &self.warnings
    }

    fn stage<'a>(&'a self, place: &Placement, progress: &dyn Progress) -> Result<Box<dyn Staged + 'a>> {
        let mut pieces = Vec::with_capacity(self.model.instances.len());
        let mut first = 0u64;
        let placed_mirrored = place.transform.matrix3.determinant() < 0.0;
        for instance in &self.model.instances {
            let part = &self.model.parts[instance.part];
            let corners = (0..part.positions.len()).map(|i| place.to_grid(world(part, i as u32, instance.transform)));
            // A mirrored part turns its triangles around.
            let mirrored = placed_mirrored != (instance.transform.matrix3.determinant() < 0.0);
            let material = &self.model.materials[part.material];
            let faces = &self.faces[instance.part][..];
            let sums = self.alphas[part.material].as_ref();
            for shift in place.shifts(Aabb::around(corners)) {
                let id = self.ids[part.material];
                let (transform, first_facet) = (instance.transform, first as u32);
                pieces.push(Piece {
                    part,
                    material,
                    id,
                    sums,
                    place: *place,
                    transform,
                    shift,
                    first: first_facet,
                    mirrored,
                    faces,
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
        }
        let mut staged =
            StagedMesh { pieces, regions: Vec::new(), starts: Vec::new(), facets: Vec::new(), interior: None };
        staged.sort_by_region(first as usize, place, progress)?;
        if self.fill != Fill::Surface {
            staged.fill(first as usize, place)?;
        }
        Ok(Box::new(staged))
    }
}

/// One instance of a part. Its corners are transformed into the grid whenever they are asked for: a mesh that is placed a million
/// times takes its own memory once.
struct Piece<'a> {
    part: &'a Part,
    material: &'a Material,
    /// Id of the material's name.
    id: u16,
    sums: Option<&'a AlphaSums>,
    place: Placement,
    /// Part space → the source's.
    transform: DAffine3,
    /// In the grid, by whole sides along cyclic axes.
    shift: DVec3,
    /// Number of its first facet.
    first: u32,
    mirrored: bool,
    faces: &'a [Face],
}

impl Piece<'_> {
    fn corner(&self, i: u32) -> DVec3 {
        self.place.to_grid(world(self.part, i, self.transform)) + self.shift
    }

    fn triangle(&self, index: usize) -> [DVec3; 3] {
        let t = self.part.triangles[index].map(|i| self.corner(i));
        if self.mirrored != (self.faces[index] == Face::Inward) { [t[0], t[2], t[1]] } else { t }
    }
}

struct StagedMesh<'a> {
    pieces: Vec<Piece<'a>>,
    regions: Vec<u64>,
    /// Start of each region's facets in `facets`, and one past the last.
    starts: Vec<usize>,
    facets: Vec<u32>,
    interior: Option<Interior>,
}

impl StagedMesh<'_> {
    /// Piece that a facet belongs to, and the index of its triangle in it.
    fn find(&self, facet: u32) -> (&Piece<'_>, usize) {
        let at = self.pieces.partition_point(|p| p.first <= facet) - 1;
        // Pieces without triangles share their first number with the next, which is found first.
        let piece = &self.pieces[at];
        (piece, (facet - piece.first) as usize)
    }

    /// Build the winding numbers of closed components, and add the regions that lie wholly inside them.
    fn fill(&mut self, count: usize, place: &Placement) -> Result<()> {
        if !self.pieces.iter().any(|p| p.faces.iter().any(|f| f.is_closed())) {
            return Ok(());
        }
        let closed = |facet: usize| {
            let (piece, index) = self.find(facet as u32);
            let opaque = piece.material.alpha == Alpha::Opaque;
            (opaque && piece.faces[index].is_closed()).then(|| piece.triangle(index))
        };
        let interior = Interior::new(place.side(), count, place.memory, closed)?;
        let width = 1u32 << place.region_log2();
        let across = place.side() / width;
        let (mut regions, mut starts, mut next) = (Vec::new(), Vec::new(), 0);
        for code in 0..u64::from(across).pow(3) {
            let corner = DVec3::from(morton::decode(code).map(|v| f64::from(v * width)));
            if self.regions.get(next) == Some(&code) {
                regions.push(code);
                starts.push(self.starts[next]);
                next += 1;
            } else if interior.holds(corner + 0.5 * f64::from(width)) {
                regions.push(code);
                starts.push(self.starts[next]);
            }
        }
        starts.push(self.facets.len());
        (self.regions, self.starts, self.interior) = (regions, starts, Some(interior));
        Ok(())
    }

    fn sort_by_region(&mut self, count: usize, place: &Placement, progress: &dyn Progress) -> Result<()> {
        let chunks = count.div_ceil(CHUNK);
        progress.stage("sort", chunks as u64);
        let side = f64::from(1u32 << place.region_log2());
        let last = f64::from((place.side() >> place.region_log2()) - 1);
        let ledger = MemoryBudget::new(place.memory);
        let lists = par::map(chunks, |chunk| {
            let (mut out, mut counted) = (Vec::<(u64, u32)>::new(), 0);
            for facet in chunk * CHUNK..count.min((chunk + 1) * CHUNK) {
                if out.len() - counted >= CHUNK {
                    if !ledger.take(out.len() - counted, FACET_MEMORY) {
                        return Vec::new();
                    }
                    counted = out.len();
                }
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
            if ledger.take(out.len() - counted, FACET_MEMORY) { out } else { Vec::new() }
        });
        ledger.check("to sort the facets of a mesh by region")?;
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
        Ok(())
    }
}

impl Staged for StagedMesh<'_> {
    fn facets(&self) -> u32 {
        self.pieces.last().map_or(0, |p| p.first + p.part.triangles.len() as u32)
    }

    fn regions(&self) -> &[u64] {
        &self.regions
    }

    fn weight(&self, region: usize) -> u64 {
        (self.starts[region + 1] - self.starts[region]) as u64
    }

    fn emit(&self, region: usize, each: &mut dyn FnMut(&Polygon)) {
        for &facet in &self.facets[self.starts[region]..self.starts[region + 1]] {
            let (piece, index) = self.find(facet);
            each(&Polygon::new(&piece.triangle(index), facet));
        }
    }

    fn surface(&self, facet: u32, at: DVec3, width: f64) -> Surface {
        let (piece, index) = self.find(facet);
        let m = piece.material;
        let mut rgba = m.base_color;
        let corners = piece.part.triangles[index].map(|i| i as usize);
        let texture = m.texture.as_ref().and_then(|t| Some((t, piece.part.uvs.get(t.tex_coord)?)));
        if texture.is_some() || piece.part.colors.is_some() {
            let places = corners.map(|i| piece.corner(i as u32));
            let w = barycentric(places, at);
            let blend = |v: [f32; 3]| (0..3).map(|i| w[i] as f32 * v[i]).sum::<f32>();
            if let Some(colors) = &piece.part.colors {
                for (e, v) in rgba.iter_mut().enumerate() {
                    *v *= blend(corners.map(|i| colors[i][e]));
                }
            }
            if let Some((t, uvs)) = texture {
                let uvs = corners.map(|i| t.map(uvs[i]));
                let uv = [blend(uvs.map(|c| c[0])), blend(uvs.map(|c| c[1]))];
                let texel = if width > 0.0 {
                    t.texture.average(uv, (width * texels_per_voxel(places, uvs, &t.texture)) as f32)
                } else {
                    t.texture.sample(uv)
                };
                rgba.iter_mut().zip(texel).for_each(|(v, t)| *v *= t);
            }
        }
        let alpha = m.alpha.share(rgba[3]);
        let mut albedo = [rgba[0], rgba[1], rgba[2]];
        if let Some(transmission) = &m.transmission {
            albedo = bsdf::reflected(piece, index, transmission, (at, width), albedo);
        }
        Surface { albedo: albedo.map(|v| v.clamp(0.0, 1.0)), alpha }
    }

    fn material(&self, facet: u32) -> u16 {
        self.find(facet).0.id
    }

    fn has_alpha(&self, facet: u32) -> bool {
        self.find(facet).0.material.alpha != Alpha::Opaque
    }

    fn alpha_sampler(&self, facet: u32) -> Option<Box<dyn AlphaSampler + '_>> {
        let (piece, index) = self.find(facet);
        let cut = FacetAlpha::new(piece, index)?;
        Some(Box::new(cut))
    }

    fn one_sided(&self, facet: u32) -> bool {
        let (piece, index) = self.find(facet);
        piece.faces[index] != Face::Sheet
    }

    fn closed(&self, facet: u32) -> bool {
        let (piece, index) = self.find(facet);
        piece.faces[index].is_closed()
    }

    fn bytes(&self) -> u64 {
        let pieces = size_of_val(&self.pieces[..]) + size_of_val(&self.regions[..]) + size_of_val(&self.starts[..]);
        (pieces + size_of_val(&self.facets[..])) as u64 + self.interior.as_ref().map_or(0, Interior::bytes)
    }

    fn inside(&self, at: DVec3) -> bool {
        self.interior.as_ref().is_some_and(|i| i.holds(at))
    }
}

/// The alpha of a triangle: its texture, along an affine map.
struct FacetAlpha<'a> {
    material: &'a Material,
    texture: &'a Texture,
    sums: &'a AlphaSums,
    /// Texture coordinate at the grid's origin, and its change along x, y, z.
    uv: [(f64, DVec3); 2],
    texels: f64,
}

impl FacetAlpha<'_> {
    /// `None` where it takes more than a texture to tell: alpha by vertex, or none of either.
    fn new<'a>(piece: &Piece<'a>, index: usize) -> Option<FacetAlpha<'a>> {
        let material = piece.material;
        let reference = material.texture.as_ref()?;
        let coords = piece.part.uvs.get(reference.tex_coord)?;
        let corners = piece.part.triangles[index].map(|i| i as usize);
        if piece.part.colors.as_ref().is_some_and(|c| corners.iter().any(|&i| c[i][3] != 1.0)) {
            return None;
        }
        let places = corners.map(|i| piece.corner(i as u32));
        let uvs = corners.map(|i| reference.map(coords[i]));
        // Gradients of the weights of the second corner and the third.
        let (e1, e2) = (places[1] - places[0], places[2] - places[0]);
        let n = e1.cross(e2);
        let nn = n.length_squared();
        if nn.is_nan() || nn <= 0.0 {
            return None;
        }
        let (g1, g2) = (e2.cross(n) / nn, n.cross(e1) / nn);
        let uv = [0, 1].map(|k| {
            let [c0, c1, c2] = uvs.map(|uv| f64::from(uv[k]));
            let slope = (c1 - c0) * g1 + (c2 - c0) * g2;
            (c0 - slope.dot(places[0]), slope)
        });
        let texture = &*reference.texture;
        Some(FacetAlpha { material, texture, sums: piece.sums?, uv, texels: texels_per_voxel(places, uvs, texture) })
    }

    fn at(&self, p: DVec3) -> [f64; 2] {
        self.uv.map(|(first, slope)| first + slope.dot(p))
    }
}

impl AlphaSampler for FacetAlpha<'_> {
    fn classify(&self, piece: &Polygon) -> AlphaClass {
        let (mut lo, mut hi) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for &corner in piece.corners() {
            let uv = self.at(corner);
            lo = [lo[0].min(uv[0]), lo[1].min(uv[1])];
            hi = [hi[0].max(uv[0]), hi[1].max(uv[1])];
        }
        self.sums.classify(lo, hi)
    }

    fn texels_per_voxel(&self) -> f64 {
        self.texels
    }

    fn sample_row(&self, from: DVec3, step: DVec3, width: f64, alpha: &mut [f32]) {
        let (first, step) = (self.at(from), self.uv.map(|(_, slope)| slope.dot(step)));
        let texels = width * self.texels;
        let factor = self.material.base_color[3];
        for (i, alpha) in alpha.iter_mut().enumerate() {
            let uv = [0, 1].map(|k| first[k] + i as f64 * step[k]);
            *alpha = if texels > 1.0 {
                self.sums.mean(uv, texels)
            } else {
                self.material.alpha.share(factor * self.texture.alpha(uv.map(|v| v as f32)))
            };
        }
    }
}

/// Number of texels per voxel edge on a triangle: the square root of its area in texels over its area in voxel faces.
fn texels_per_voxel(t: [DVec3; 3], uvs: [[f32; 2]; 3], texture: &Texture) -> f64 {
    let area = (t[1] - t[0]).cross(t[2] - t[0]).length();
    let d = |i: usize| [0, 1].map(|k| f64::from(uvs[i][k] - uvs[0][k]));
    let ([ax, ay], [bx, by]) = (d(1), d(2));
    let texels = (ax * by - ay * bx).abs() * f64::from(texture.width) * f64::from(texture.height);
    libm::sqrt(texels / area.max(1e-30))
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
