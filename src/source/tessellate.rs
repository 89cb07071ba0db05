//! A source as a mesh: its facets as triangles with their colours at the corners, for programs that draw triangles, for pictures
//! from near and for references.

use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicU64, Ordering};

use super::placement::Placement;
use super::traits::{Source, Staged};
use crate::geom::polygon::Polygon;
use crate::geom::{DAffine3, DVec3};
use crate::progress::Progress;
use crate::scene::{Alpha, Instance, Material, Model, Part, Transmission};
use crate::volume::axes::{UVW_TO_SCENE, source_to_uvw};
use crate::volume::surface::SurfaceMeans;
use crate::{Error, Result, Warnings, morton, par};

/// The part of the mesh that a facet belongs to: by its material, by whether it is single-sided and by whether it has alpha.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct PartKey {
    material: u16,
    one_sided: bool,
    has_alpha: bool,
}

/// A corner: its place in the grid, and its colour and alpha.
type Corner = ([f32; 3], [f32; 4]);

/// The facets of a region.
#[derive(Default)]
struct RegionFacets {
    polygons: Vec<(PartKey, Vec<Corner>)>,
    has_media: bool,
}

/// The source's facets, laid into the grid `place`, as a model with +Y up: whatever is curved is cut as finely as the grid's
/// voxels ask for, and what is partly there, as by a mask, at the planes between voxels. Materials have the source's names, its
/// colours are the vertices'. Faint matter has no facets; it is left out with a warning.
///
/// # Errors
/// `Limit` where there are more than `max_triangles`, and what staging the source says.
pub fn tessellate(
    source: &dyn Source,
    place: &Placement,
    max_triangles: u64,
    progress: &dyn Progress,
    warnings: &mut Warnings,
) -> Result<Model> {
    let staged = source.stage(place, progress)?;
    let regions = staged.regions().len();
    progress.stage("facets", regions as u64);
    let count = AtomicU64::new(0);
    let found = par::map(regions, |i| {
        if count.load(Ordering::Relaxed) > max_triangles {
            return RegionFacets::default();
        }
        let found = facets_of(&*staged, place, i);
        let triangles: usize = found.polygons.iter().map(|(_, corners)| corners.len().saturating_sub(2)).sum();
        count.fetch_add(triangles as u64, Ordering::Relaxed);
        progress.advance(1);
        found
    });
    let needed = count.into_inner();
    if needed > max_triangles {
        return Err(Error::Limit { what: "triangles of the source's facets".into(), needed, allowed: max_triangles });
    }
    let faint = found.iter().any(|f| f.has_media);
    warnings.add_many("faint matter, as of clouds and soft stacks, has no facets and is left out", u64::from(faint));
    Ok(model_of(source, place, found))
}

/// The facets whose middles lie in a region, each whole.
fn facets_of(staged: &dyn Staged, place: &Placement, region: usize) -> RegionFacets {
    let Some(&code) = staged.regions().get(region) else { return RegionFacets::default() };
    let levels = place.region_log2();
    let corner = DVec3::from(morton::decode(code).map(|v| f64::from(v << levels)));
    let (width, side) = (f64::from(1u32 << levels), f64::from(place.side()));
    // What lies on the grid's own border belongs to the last region.
    let is_own = |middle: DVec3| {
        let at = middle.clamp(DVec3::ZERO, DVec3::splat(side.next_down()));
        at.cmpge(corner).all() && at.cmplt(corner + width).all()
    };
    let mut found = RegionFacets::default();
    staged.emit(region, &mut |polygon| {
        if !is_own(polygon.corner_mean()) || polygon.area_vector() == DVec3::ZERO {
            return;
        }
        let facet = polygon.facet;
        let kind = PartKey {
            material: staged.material(facet),
            one_sided: staged.one_sided(facet) && !staged.closed(facet),
            has_alpha: staged.has_alpha(facet),
        };
        let mut add = |piece: &Polygon| {
            let corners = corners(staged, piece, kind.has_alpha);
            if corners.iter().any(|(_, color)| color[3] > 0.0) {
                found.polygons.push((kind, corners));
            }
        };
        if kind.has_alpha {
            polygon.split_voxels(&mut |piece, _| add(piece));
        } else {
            add(polygon);
        }
    });
    staged.medium(region, &mut |medium| found.has_media |= medium.is_valid());
    found
}

/// A polygon's corners with their colours; a piece that is partly there has one colour and alpha, those of its middle.
fn corners(staged: &dyn Staged, piece: &Polygon, has_alpha: bool) -> Vec<Corner> {
    let color = |at: DVec3, width: f64| {
        let seen = staged.surface(piece.facet, at, width);
        let [r, g, b] = seen.albedo;
        [r, g, b, if has_alpha { seen.alpha } else { 1.0 }]
    };
    let whole = has_alpha.then(|| color(piece.corner_mean(), 1.0));
    piece.corners().iter().map(|&at| (at.as_vec3().to_array(), whole.unwrap_or_else(|| color(at, 0.0)))).collect()
}

/// All facets as a model with one part for each [`PartKey`].
fn model_of(source: &dyn Source, place: &Placement, found: Vec<RegionFacets>) -> Model {
    let surfaces = source.surfaces();
    let mut kinds: BTreeMap<PartKey, PartBuilder> = BTreeMap::new();
    for (kind, corners) in found.into_iter().flat_map(|f| f.polygons) {
        let base = surfaces.get(usize::from(kind.material)).map_or(1.0, |s| 1.0 / (1.0 - share_through(s)));
        kinds.entry(kind).or_default().add(&corners, base);
    }
    let mut model = Model { metres_per_unit: source.metres_per_unit(), ..Model::default() };
    // Back into the source's own space, and +Y up.
    let turn = UVW_TO_SCENE * source_to_uvw(source.up());
    let to_source = place.grid_map().inverse();
    let stands = DAffine3::from_mat3(turn) * DAffine3::from_translation(source.origin());
    for (kind, welded) in kinds {
        let name = source.materials().get(usize::from(kind.material)).cloned().unwrap_or_default();
        let surface = surfaces.get(usize::from(kind.material)).copied().unwrap_or_default();
        let positions = welded
            .positions
            .iter()
            .map(|p| to_source.transform_point3(DVec3::from(p.map(f64::from))).as_vec3().to_array());
        let transmission = transmission(&surface, welded.mean_color()).map(Box::new);
        let part = Part {
            name: name.clone(),
            positions: positions.collect(),
            colors: Some(welded.colors),
            triangles: welded.triangles,
            material: model.materials.len(),
            ..Part::default()
        };
        model.materials.push(Material {
            name: name.clone(),
            double_sided: !kind.one_sided,
            alpha: if kind.has_alpha { Alpha::Blend } else { Alpha::Opaque },
            unlit: surface.params.unlit > 0.5,
            transmission,
            ..Material::default()
        });
        model.instances.push(Instance { part: model.parts.len(), transform: stands, node: name });
        model.parts.push(part);
    }
    model
}

/// The share of the diffuse light that comes through rather than back, in [0, 1).
fn share_through(surface: &SurfaceMeans) -> f32 {
    let (through, back) = (surface.params.transmission.iter().sum::<f64>(), surface.reflected.iter().sum::<f64>());
    if through > 0.0 { (through / (through + back)).min(0.99) as f32 } else { 0.0 }
}

/// What lets light through, of a material whose base colour, that of both sides together, is `base` in the mean. A source may know
/// transmission only in proportion to what it reflects; glTF has one colour of it for a whole material.
fn transmission(surface: &SurfaceMeans, base: [f32; 3]) -> Option<Transmission> {
    let factor = share_through(surface);
    let ratio = surface.ratio();
    let color = [0, 1, 2].map(|k| {
        let through = match surface.reflected[k] > 0.0 {
            true => base[k] * (1.0 - factor) * ratio[k] as f32,
            false => surface.params.transmission[k] as f32,
        };
        (through / factor).clamp(0.0, 1.0)
    });
    (factor > 0.0).then(|| Transmission { factor, color, ..Transmission::default() })
}

/// Triangles of one part; corners of one position and colour are one vertex.
#[derive(Default)]
struct PartBuilder {
    numbers: HashMap<[u32; 7], u32>,
    positions: Vec<[f32; 3]>,
    colors: Vec<[f32; 4]>,
    triangles: Vec<[u32; 3]>,
}

impl PartBuilder {
    /// Add a convex polygon, with its colours multiplied by `base`.
    fn add(&mut self, corners: &[Corner], base: f32) {
        let numbers: Vec<u32> = corners.iter().map(|corner| self.number(corner, base)).collect();
        for k in 2..numbers.len() {
            let triangle = [numbers[0], numbers[k - 1], numbers[k]];
            if triangle[0] != triangle[1] && triangle[1] != triangle[2] && triangle[2] != triangle[0] {
                self.triangles.push(triangle);
            }
        }
    }

    /// Mean colour of the triangles, by their areas.
    fn mean_color(&self) -> [f32; 3] {
        let (mut sum, mut whole) = ([0.0f64; 3], 0.0);
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|k| DVec3::from(self.positions[k as usize].map(f64::from)));
            let area = (b - a).cross(c - a).length();
            whole += area;
            for corner in triangle {
                (0..3).for_each(|k| sum[k] += area * f64::from(self.colors[*corner as usize][k]) / 3.0);
            }
        }
        sum.map(|s| if whole > 0.0 { (s / whole) as f32 } else { 0.0 })
    }

    fn number(&mut self, (position, [r, g, b, alpha]): &Corner, base: f32) -> u32 {
        let color = [r * base, g * base, b * base, *alpha].map(|c| c.clamp(0.0, 1.0));
        let mut key = [0; 7];
        key.iter_mut().zip(position.iter().chain(&color)).for_each(|(k, v)| *k = (v + 0.0).to_bits());
        *self.numbers.entry(key).or_insert_with(|| {
            self.positions.push(*position);
            self.colors.push(color);
            self.positions.len() as u32 - 1
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Aabb;
    use crate::progress::Quiet;
    use crate::source::paint::{Paint, PaintedSource, Translucency};
    use crate::source::{OpenOptions, facets, open};

    fn placed(source: &dyn Source, depth: usize) -> Placement {
        let bounds = source.bounds();
        let edge = bounds.size().max_element() * (1.0 + 1e-6);
        let cube = Aabb::new(bounds.min, bounds.min + edge);
        let scale = f64::from(1u32 << depth) / edge;
        let up = source.up();
        Placement {
            bounds: cube,
            transform: DAffine3::IDENTITY,
            scale,
            depth,
            up,
            cyclic: [false; 3],
            memory: u64::MAX,
        }
    }

    /// A mesh has each facet once, of any kind of source: the area of what a bake measures.
    #[test]
    fn a_mesh_has_the_area_of_its_source() {
        let folder = tempfile::tempdir().unwrap();
        let hair = folder.path().join("hair.csv");
        let rows: Vec<String> = (0..50)
            .flat_map(|i| (0..9).map(move |k| (i, k)))
            .map(|(i, k)| {
                format!("{i},{},{},{},0.02", 0.1 * f64::from(i % 7), 0.1 * f64::from(k), 0.07 * f64::from(i + k))
            })
            .collect();
        std::fs::write(&hair, format!("strand,x,y,z,width\n{}\n", rows.join("\n"))).unwrap();
        let sample = |name: &str| std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(name);
        let files = [
            sample("lsystems/fern.lsys"),
            sample("recipes/nut.toml"),
            sample("recipes/ring.toml"),
            sample("tree.glb"),
            hair,
        ];
        for file in files {
            let source = open(&file, &OpenOptions::default()).unwrap();
            let place = placed(&*source, 6);
            let staged = source.stage(&place, &Quiet).unwrap();
            let pieces = facets(&*staged, &place, 1 << 32, &Quiet).unwrap().pieces;
            let area = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a).length();
            let wanted = pieces.iter().map(|p| area(p.corners)).sum::<f64>() / place.scale.powi(2);
            let mut warnings = Warnings::default();
            let model = tessellate(&*source, &place, 1 << 24, &Quiet, &mut warnings).unwrap();
            let found: f64 = model
                .parts
                .iter()
                .flat_map(|part| {
                    part.triangles.iter().map(|t| t.map(|i| DVec3::from(part.positions[i as usize].map(f64::from))))
                })
                .map(area)
                .sum();
            // Places are of 32 bits, 2^-24 of the source's size; slivers of that width have no area to speak of.
            assert!((found / wanted - 1.0).abs() < 2e-4, "{}: {found} {wanted}", file.display());
            let bounds =
                Aabb::around(model.parts.iter().flat_map(|p| &p.positions).map(|p| DVec3::from(p.map(f64::from))));
            // A tube is a prism that is as wide in the mean as its circle: its edges lie outside.
            let (own, pad) = (source.bounds(), 1e-3 * source.bounds().size().max_element());
            assert!(
                bounds.min.cmpge(own.min - pad).all() && bounds.max.cmple(own.max + pad).all(),
                "{}",
                file.display()
            );
            assert!(
                tessellate(&*source, &place, 3, &Quiet, &mut warnings).is_err_and(|e| matches!(e, Error::Limit { .. }))
            );
        }
    }

    /// Colours, materials and what lets light through are those of the source.
    #[test]
    fn leaves_keep_their_colours_and_what_comes_through() {
        let leaf = |transmission: Option<Transmission>| {
            let leaf = Material {
                name: "leaf".into(),
                base_color: [0.2, 0.6, 0.1, 1.0],
                double_sided: transmission.is_none(),
                transmission: transmission.map(Box::new),
                ..Material::default()
            };
            let part = Part {
                positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.5], [0.0, 1.0, 0.5]],
                triangles: vec![[0, 1, 2], [0, 2, 3]],
                ..Part::default()
            };
            let instance = Instance { part: 0, transform: DAffine3::IDENTITY, node: String::new() };
            let (parts, instances) = (vec![part], vec![instance]);
            let model = Model { parts, materials: vec![leaf], instances, ..Model::default() };
            crate::source::MeshSource::new(model, &Default::default())
        };
        let source = leaf(Some(Transmission { factor: 0.25, color: [0.4, 0.8, 0.2], ..Transmission::default() }));
        let made = tessellate(&source, &placed(&source, 5), 1 << 20, &Quiet, &mut Warnings::default()).unwrap();
        assert_eq!(
            (made.materials.len(), made.materials[0].name.as_str(), made.materials[0].double_sided),
            (1, "leaf", false)
        );
        let through = made.materials[0].transmission.as_ref().unwrap();
        let base = made.parts[0].colors.as_ref().unwrap()[0];
        let (reflected, transmitted) = through.split([base[0], base[1], base[2]], &|_| [1.0; 4]);
        for k in 0..3 {
            // What is reflected of the base, and what comes through, as the material says; the share is one of all channels.
            assert!((reflected[k] - 0.75 * [0.2, 0.6, 0.1][k]).abs() < 1e-6, "{reflected:?}");
            assert!((transmitted[k] - 0.25 * [0.4, 0.8, 0.2][k]).abs() < 1e-6, "{transmitted:?}");
        }
        // Where translucency is painted on, what comes through has the colour of what is reflected, and is not white.
        let translucency = vec![Translucency { material: None, share: 0.25 }];
        let painted = PaintedSource::new(Box::new(leaf(None)), Paint { translucency, ..Paint::default() });
        let made_of_painted =
            tessellate(&painted, &placed(&painted, 5), 1 << 20, &Quiet, &mut Warnings::default()).unwrap();
        let through = made_of_painted.materials[0].transmission.as_ref().unwrap();
        for k in 0..3 {
            assert!((through.color[k] - [0.2, 0.6, 0.1][k]).abs() < 1e-6 && through.factor == 0.25, "{through:?}");
        }
        // Its front is where it was: towards −z and up.
        let part = &made.parts[0];
        let [a, b, c] = part.triangles[0].map(|i| DVec3::from(part.positions[i as usize].map(f64::from)));
        assert!((b - a).cross(c - a).z > 0.0);
    }
}
