//! All facets of a staged source as triangles, and their projected areas per voxel: the ground truth that `vtex error` compares a texel
//! with.

use super::placement::Placement;
use super::traits::Staged;
use crate::geom::{DVec3, directions13};
use crate::progress::Progress;
use crate::source::Medium;
use crate::{Error, Result, morton, par};

/// A triangle of a facet.
#[derive(Debug, Clone, Copy)]
pub struct FacetTriangle {
    /// Grid space.
    pub corners: [DVec3; 3],
    /// The source's own number for the facet.
    pub facet: u32,
    /// Whether alpha cuts parts out of the facet.
    pub cut_out: bool,
}

/// Result of [`facets`].
#[derive(Debug, Clone, Default)]
pub struct Facets {
    /// Triangles of all facets.
    pub pieces: Vec<FacetTriangle>,
    /// Morton codes of finest voxels with the projected areas of what is in them along the 13 axes, in squares of their
    /// edge; in Morton order.
    pub areas: Vec<(u64, [f32; 13])>,
    /// Cubes of semi-transparent matter; `areas` does not contain theirs.
    pub media: Vec<Medium>,
}

/// Weights of a triangle's second and third corner where its alpha is looked up: the middles of its four quarters.
const INNER: [[f64; 2]; 4] =
    [[1.0 / 3.0, 1.0 / 3.0], [1.0 / 6.0, 1.0 / 6.0], [2.0 / 3.0, 1.0 / 6.0], [1.0 / 6.0, 2.0 / 3.0]];

/// All facets and media of `staged` within the cube, cut at the borders of regions.
///
/// # Errors
/// `Limit` where they take more than `max_bytes`.
pub fn facets(staged: &dyn Staged, place: &Placement, max_bytes: u64, progress: &dyn Progress) -> Result<Facets> {
    let regions = staged.regions();
    let region_log2 = place.region_log2();
    progress.stage("facets", regions.len() as u64);
    let taken = std::sync::atomic::AtomicU64::new(0);
    let full = |bytes: usize| taken.fetch_add(bytes as u64, std::sync::atomic::Ordering::Relaxed) > max_bytes;
    let axes = directions13();
    let parts = par::map(regions.len(), |i| {
        let mut found = Facets::default();
        if full(0) {
            return found;
        }
        let corner = DVec3::from(morton::decode(regions[i]).map(|v| f64::from(v << region_log2)));
        let width = f64::from(1u32 << region_log2);
        staged.emit(i, &mut |facet| {
            let mut room = None;
            let Some(polygon) = facet.clip(corner, corner + width, &mut room) else { return };
            let cut_out = staged.has_alpha(facet.facet);
            let c = polygon.corners();
            for k in 2..c.len() {
                found.pieces.push(FacetTriangle { corners: [c[0], c[k - 1], c[k]], facet: facet.facet, cut_out });
            }
            polygon.split_voxels(&mut |piece, at| {
                let cell = at.clamp(corner, corner + (width - 1.0)).as_uvec3();
                let mut area = piece.area_vector();
                if cut_out {
                    area *= share(staged, piece.corners(), facet.facet);
                }
                let code = morton::encode(cell.to_array());
                let own = axes.map(|w| area.dot(w).abs() as f32);
                match found.areas.last_mut() {
                    Some((last, sum)) if *last == code => sum.iter_mut().zip(own).for_each(|(s, a)| *s += a),
                    _ => found.areas.push((code, own)),
                }
            });
        });
        found.merge();
        staged.medium(i, &mut |medium| {
            if medium.is_valid() {
                found.media.push(*medium);
            }
        });
        progress.advance(1);
        full(size_of_val(&found.pieces[..]) + size_of_val(&found.areas[..]) + size_of_val(&found.media[..]));
        found
    });
    if full(0) {
        return Err(Error::Limit {
            what: "the source's facets (raise option `memory`, or measure a coarser texel), in bytes,".into(),
            needed: taken.into_inner(),
            allowed: max_bytes,
        });
    }
    let mut all = Facets::default();
    for mut part in parts {
        all.pieces.append(&mut part.pieces);
        all.areas.append(&mut part.areas);
        all.media.append(&mut part.media);
    }
    Ok(all)
}

impl Facets {
    /// Sort the areas by their codes and add up those of the same voxel.
    fn merge(&mut self) {
        self.areas.sort_by_key(|v| v.0);
        self.areas.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            if same {
                kept.1.iter_mut().zip(next.1).for_each(|(sum, area)| *sum += area);
            }
            same
        });
    }
}

/// Mean alpha of a polygon.
fn share(staged: &dyn Staged, c: &[DVec3], facet: u32) -> f64 {
    let (mut there, mut whole) = (0.0, 0.0);
    for k in 2..c.len() {
        let (e, f) = (c[k - 1] - c[0], c[k] - c[0]);
        let area = e.cross(f).length();
        whole += area;
        for [u, v] in INNER {
            there += 0.25 * area * f64::from(staged.surface(facet, c[0] + u * e + v * f, 0.0).alpha);
        }
    }
    if whole > 0.0 { there / whole } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{Aabb, DAffine3};
    use crate::progress::Quiet;
    use crate::scene::{Instance, Material, Model, Part};
    use crate::source::mesh::{MeshOptions, MeshSource};
    use crate::source::traits::Source;

    #[test]
    fn areas_are_those_of_the_mesh() {
        // A square of edge 90 in a grid of 128: pieces in many regions and voxels.
        let corners = [[0.0, 0.3, 0.0], [0.9, 0.3, 0.0], [0.9, 0.3, 0.9], [0.0, 0.3, 0.9]];
        let part = Part { positions: corners.to_vec(), triangles: vec![[0, 1, 2], [0, 2, 3]], ..Part::default() };
        let instance = Instance { part: 0, transform: DAffine3::IDENTITY, node: String::new() };
        let model = Model {
            parts: vec![part],
            materials: vec![Material::default()],
            instances: vec![instance],
            ..Model::default()
        };
        let source = MeshSource::new(model, &MeshOptions::default());
        let place = Placement {
            bounds: Aabb::UNIT,
            transform: DAffine3::IDENTITY,
            scale: 128.0,
            depth: 7,
            up: 1,
            cyclic: [false; 3],
            memory: u64::MAX,
        };
        let staged = source.stage(&place, &Quiet).unwrap();
        let found = facets(&*staged, &place, 1 << 30, &Quiet).unwrap();
        let area: f64 = found
            .pieces
            .iter()
            .map(|p| 0.5 * (p.corners[1] - p.corners[0]).cross(p.corners[2] - p.corners[0]).length())
            .sum();
        let whole = (0.9f64 * 128.0).powi(2);
        assert!((area / whole - 1.0).abs() < 1e-6, "{area}");
        for (k, w) in directions13().into_iter().enumerate() {
            let projected: f64 = found.areas.iter().map(|v| f64::from(v.1[k])).sum();
            // Sums of some ten thousand f32.
            assert!((projected - whole * w.z.abs()).abs() < 1e-4 * whole, "{k} {projected}");
        }
        assert!(found.areas.windows(2).all(|v| v[0].0 < v[1].0));
        assert!(matches!(facets(&*staged, &place, 1000, &Quiet), Err(Error::Limit { .. })));
    }
}
