//! Copies of texels under one affine map each: rigid copies, and copies that fill a shell's box alone. A ray is taken to their texel
//! space by two products of a matrix and a vector, without going through the box, its layers and their cells.
//!
//! Based on: F. Neyret, *Synthesizing Verdant Landscapes using Volumetric Textures*, INRIA RR-2846, 1996 (a reference volume under
//! many maps).

use std::collections::HashMap;

use glam::Vec3A;

use super::bvh::Boxes;
use super::cells::{CONTENT_PAD, CopyHit, RIGID, TexelLayer};
use super::copies::{RigidCopy, image_bounds};
use super::copy_segment::{CopySegment, round_inside};
use super::phong::{PhongTable, SurfaceCoords};
use super::placement::PlacedCopy;
use super::shell::Prism;
use crate::geom::{Aabb, DAffine3, DMat3, DVec3, Mat3, Ray, Vec3, each3};
use crate::march::transmittance::MarchSegment;
use crate::scene::shell::CellWrap;

/// One copy, in a cache line. The map from the renderer's space to texel space is x ↦ `matrix` · (x − `middle`) + ½. Rounding to f32
/// moves a copy by at most 2^-24 of its distance from the camera, which is a thousandth of a pixel.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
struct AffineCopy {
    matrix: Mat3,
    middle: Vec3,
    /// Square root of the determinant's magnitude.
    root_determinant: f32,
    /// Index into [`AffineCopies::attributes`]; [`NO_ATTRIBUTES`] for a copy that has no volume.
    attributes: u32,
}

const NO_ATTRIBUTES: u32 = u32::MAX;

/// Attributes that many copies share.
#[derive(Debug, Clone, Copy, PartialEq)]
struct CopyAttributes {
    texel: usize,
    tint: Vec3,
    opacity_scale: f32,
    /// See [`CopyHit::phong`].
    phong: u32,
    /// Whether these parameters vary from place to place.
    varies: bool,
    /// See [`TexelLayer::rank`].
    rank: u32,
    /// The cell of a shell's copy; `None` for rigid copies, which their numbers tell apart.
    ///
    /// Where boxes of one cell overlap and a shadow ray starts in several of them, they count as one copy, so all matter around the
    /// start is the ray's own. 25 000 trees from afar have a FLIP of .0429 this way, and .0456 where the neighbours' matter occludes.
    cell: Option<[i64; 3]>,
}

/// A [`CopyAttributes`]'s texel and cell; its parameters, its rank, and the bits of its tint and the scale of its opacity.
type AttributesKey = (usize, Option<[i64; 3]>, [u32; 6]);

/// All copies under affine maps, numbered from 0.
#[derive(Default)]
pub struct AffineCopies {
    list: Vec<AffineCopy>,
    attributes: Vec<CopyAttributes>,
    known: HashMap<AttributesKey, u32>,
    /// For each texel of the scene, the bounding box of its content in texel space, widened by [`CONTENT_PAD`].
    contents: Vec<(Vec3A, Vec3A)>,
}

/// A cone's width as it grows along its ray: `start` + `growth` · t.
#[derive(Debug, Clone, Copy)]
pub struct ConeWidth {
    pub start: f64,
    pub growth: f64,
}

/// Depth by which a box may cut into the content of a copy that still counts as whole, in cube edges: corners are given as f32.
const MAX_CUT: f64 = 1e-4;

impl AffineCopies {
    /// None yet; `contents`: for each texel of the scene, the box of its content in texel space.
    pub fn new(contents: impl Iterator<Item = Aabb>) -> AffineCopies {
        let padded = |c: Aabb| ((c.min - CONTENT_PAD).as_vec3a(), (c.max + CONTENT_PAD).as_vec3a());
        AffineCopies { contents: contents.map(padded).collect(), ..AffineCopies::default() }
    }

    /// Number of copies.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Reserve memory for `count` more copies.
    pub fn reserve(&mut self, count: usize) {
        self.list.reserve_exact(count);
    }

    /// Add a rigid copy; `None` stands for one without a volume, which no ray meets. `phongs` is the scene's table.
    pub fn push(&mut self, copy: Option<&RigidCopy>, phongs: &PhongTable) {
        let kind = |c: &RigidCopy| {
            let RigidCopy { texel, tint, phong, .. } = *c;
            CopyAttributes { texel, tint, opacity_scale: 1.0, phong, varies: phongs.varies(phong), rank: 0, cell: None }
        };
        let made = copy.and_then(|c| self.affine_copy(&c.to_texel, kind(c)));
        let flat =
            AffineCopy { matrix: Mat3::ZERO, middle: Vec3::ZERO, root_determinant: 0.0, attributes: NO_ATTRIBUTES };
        self.list.push(made.unwrap_or(flat));
    }

    /// Try to replace a box by the one copy that it holds. If that is possible, add the copy, and its bounding box to `bounds`, and
    /// return true; a box without copies adds nothing and returns true. Return false where the box has several layers (which mix where
    /// they meet), several copies, a part of a copy, a bent copy, or one whose Phong parameters vary from place to place.
    pub fn add_whole_box(
        &mut self,
        prism: &Prism,
        layers: &[TexelLayer],
        phongs: &PhongTable,
        bounds: &mut Boxes,
    ) -> bool {
        let [layer] = layers else { return false };
        match self.box_content(prism, layer) {
            BoxContent::Empty => true,
            BoxContent::WholeCopy(_, kind) if phongs.varies(kind.phong) => false,
            BoxContent::WholeCopy(to_texel, kind) => self.affine_copy(&to_texel, kind).is_some_and(|copy| {
                self.list.push(copy);
                let content = self.content(kind.texel).unwrap_or(Aabb::EMPTY);
                bounds.push(image_bounds(&content, &to_texel.inverse()));
                true
            }),
            BoxContent::Other => false,
        }
    }

    /// The bounding box of a texel's content, widened, in texel space.
    fn content(&self, texel: usize) -> Option<Aabb> {
        self.contents.get(texel).map(|(min, max)| Aabb::new(min.as_dvec3(), max.as_dvec3()))
    }

    fn box_content(&self, prism: &Prism, layer: &TexelLayer) -> BoxContent {
        if layer.jitter.is_some() || layer.reach != [0; 3] {
            return BoxContent::Other;
        }
        let scale = DVec3::from_array(layer.layer.scale);
        let to_layer =
            DAffine3 { matrix3: DMat3::from_diagonal(scale), translation: DVec3::from_array(layer.layer.offset) };
        let cover = prism.cover().transformed(to_layer);
        let mut cell = [0i64; 3];
        for k in (0..3).filter(|&k| layer.layer.wrap[k] != CellWrap::Empty) {
            let low = (0.5 * (cover.min[k] + cover.max[k])).floor();
            let is_one = cover.min[k] >= low - MAX_CUT && cover.max[k] <= low + 1.0 + MAX_CUT && low.abs() < 1e15;
            if !is_one {
                return BoxContent::Other;
            }
            cell[k] = low as i64;
        }
        let Some((copy, to_cube)) = layer.placed(cell) else { return BoxContent::Empty };
        let Some(content) = self.content(copy.texel) else { return BoxContent::Other };
        if content.is_empty() {
            return BoxContent::Empty;
        }
        let to_texel = to_cube * to_layer * prism.to_texel();
        let from_texel = to_texel.inverse();
        if !from_texel.is_finite() || prism.cuts(&content, &from_texel, CONTENT_PAD + MAX_CUT) {
            return BoxContent::Other;
        }
        let (opacity_scale, rank) = (layer.layer.opacity_scale as f32, layer.rank);
        let PlacedCopy { texel, tint, phong, .. } = copy;
        BoxContent::WholeCopy(
            to_texel,
            CopyAttributes { texel, tint, opacity_scale, phong, varies: false, rank, cell: Some(cell) },
        )
    }

    /// The stored form of a copy; `None` where it has no volume.
    fn affine_copy(&mut self, to_texel: &DAffine3, kind: CopyAttributes) -> Option<AffineCopy> {
        let middle = to_texel.inverse().transform_point3(DVec3::splat(0.5)).as_vec3();
        let root_determinant = to_texel.matrix3.determinant().abs().sqrt() as f32;
        let matrix = to_texel.matrix3.as_mat3();
        let usable = middle.is_finite() && root_determinant.is_normal() && matrix.is_finite();
        usable.then(|| {
            let [r, g, b] = kind.tint.to_array().map(f32::to_bits);
            let key = (kind.texel, kind.cell, [kind.phong, kind.rank, r, g, b, kind.opacity_scale.to_bits()]);
            let attributes = &mut self.attributes;
            let number = *self.known.entry(key).or_insert_with(|| {
                attributes.push(kind);
                attributes.len() as u32 - 1
            });
            AffineCopy { matrix, middle, root_determinant, attributes: number }
        })
    }

    /// The ray's segment before `t1` in copy `index`, ready to be marched; `None` where it misses the texel's content.
    #[inline]
    pub fn segment(&self, index: usize, ray: &Ray, t1: f64, width: ConeWidth) -> Option<CopySegment> {
        let copy = self.list.get(index)?;
        let kind = self.attributes.get(copy.attributes as usize)?;
        let content = self.contents.get(kind.texel)?;
        // The difference is taken in f64, where it loses no digits; the rest needs no more precision than the map has.
        let offset = (ray.origin - copy.middle.as_dvec3()).as_vec3a();
        let along = ray.dir.as_vec3a();
        let [x, y, z] = each3([copy.matrix.x_axis, copy.matrix.y_axis, copy.matrix.z_axis], Vec3A::from);
        let origin = x * offset.x + y * offset.y + z * offset.z + 0.5;
        let dir = x * along.x + y * along.y + z * along.z;
        // A ray that runs along a face of the cube counts as inside at the lower face, and as outside at the upper one.
        let inverse = Vec3A::select(dir.cmpeq(Vec3A::ZERO), Vec3A::splat(1e30), dir.recip());
        let within = |min: Vec3A, max: Vec3A| {
            let (a, b) = ((min - origin) * inverse, (max - origin) * inverse);
            let (near, far) = (a.min(b).max_element().max(0.0), a.max(b).min_element().min(t1 as f32));
            (near < far).then_some((near, far))
        };
        within(content.0, content.1)?;
        let (t0, t1) = within(Vec3A::ZERO, Vec3A::ONE)?;
        let length = dir.length();
        let scale = copy.root_determinant / length.sqrt();
        // By rounding, a start on a face may lie outside of the cube.
        let start = (origin + t0 * dir).clamp(Vec3A::ZERO, Vec3A::ONE);
        let march = MarchSegment {
            origin: round_inside(start.as_dvec3()),
            dir: dir.into(),
            length: t1 - t0,
            footprint: (width.start + width.growth * f64::from(t0)) as f32 * scale,
            growth: width.growth as f32 * scale,
            opacity_scale: kind.opacity_scale,
        };
        let (texel, tint, phong) = (kind.texel, kind.tint, kind.phong);
        let cell = kind.cell.unwrap_or([index as i64, 0, RIGID]);
        let (t0, t1, origin, dir) = (f64::from(t0), f64::from(t1), start.as_dvec3(), dir.as_dvec3());
        let hit =
            CopyHit { texel, tint, phong, cell, t0, t1, origin, dir, linear: DMat3::IDENTITY, inverse_scale: 1.0 };
        let scale = f64::from(scale);
        let coords = kind.varies.then(|| Box::new(SurfaceCoords::of_copy(&hit, scale)));
        let (to_texel, rank, affine) = (copy.matrix.as_dmat3(), kind.rank, Some(index as u32));
        Some(CopySegment { hit, march, to_texel, scale, rank, affine, coords })
    }
}

/// What a layer puts into a box.
enum BoxContent {
    /// No copy.
    Empty,
    /// One copy, whole, with the map from the renderer's space to its cube.
    WholeCopy(DAffine3, CopyAttributes),
    /// Anything else.
    Other,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::bvh::Bvh;
    use crate::render::layer::TexelChoice;
    use crate::render::shell::{Corner, ShellBox};
    use crate::scene::shell::{Continuous, Discrete, Layer, Orientations};

    const CONTENT: Aabb = Aabb { min: DVec3::new(0.2, 0.1, 0.0), max: DVec3::new(0.7, 0.8, 0.9) };

    fn layer(discrete: Option<Discrete>) -> TexelLayer {
        TexelLayer::new(Layer { discrete, ..Layer::default() }, vec![TexelChoice::plain(CONTENT)])
    }

    /// A prism over a sheared square whose texel coordinates span [u, u + size]², its height vector leaning.
    fn prism(u: f64, size: f64) -> Prism {
        let corner = |x: f64, y: f64| Corner {
            p: DVec3::new(0.3 + 0.1 * x + 0.02 * y, 0.2 - 0.01 * x, 0.5 - 0.09 * y),
            h: DVec3::new(0.01, 0.12, -0.02),
            q: DVec3::new(u + size * x, u + size * y, 0.0),
            dw: 1.0,
            jitter: 1.0,
        };
        Prism::new(&[corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)]).unwrap()
    }

    fn filled(prism: &Prism, layer: &TexelLayer) -> (bool, AffineCopies, Boxes) {
        let (mut copies, mut bounds) = (AffineCopies::new(std::iter::once(CONTENT)), Boxes::default());
        let done = copies.add_whole_box(prism, std::slice::from_ref(layer), &PhongTable::default(), &mut bounds);
        assert_eq!(bounds.len(), copies.len());
        (done, copies, bounds)
    }

    fn ray(i: usize) -> Ray {
        let at = |k: f64| (k * (i as f64 + 0.5)).sin();
        let dir = DVec3::new(at(1.3), at(0.7) - 0.5, at(2.1)).normalize();
        Ray { origin: DVec3::new(0.36, 0.26, 0.46) + 0.05 * DVec3::new(at(3.1), at(4.3), at(5.9)) - 0.4 * dir, dir }
    }

    #[test]
    fn a_copy_that_fills_its_box_is_met_as_through_the_box() {
        let turned = Discrete { seed: 3, orientations: Orientations::W8, scale: [0.7, 1.0], ..Discrete::default() };
        let width = ConeWidth { start: 0.001, growth: 0.01 };
        for layer in [layer(None), layer(Some(turned))] {
            let prism = prism(4.0, 1.0);
            let (done, copies, bounds) = filled(&prism, &layer);
            assert!(done && copies.len() == 1);
            let shell = ShellBox::Prism(Box::new(prism));
            let mut met = 0;
            for i in 0..2000 {
                let ray = ray(i);
                let mut want: Option<(CopyHit, DMat3)> = None;
                shell.spans(&ray, 0.0, 9.0, |t0, t1| {
                    shell.for_each_segment(&ray, t0, t1, &|_, _| 1.0, &mut |segment| {
                        layer.for_each_copy(segment, &mut |hit| {
                            // By rounding a ray may also run along the edge of the next cell.
                            if !hit.misses(&CONTENT) {
                                want = Some((*hit, segment.to_texel));
                            }
                            true
                        })
                    });
                });
                let found = copies.segment(0, &ray, 9.0, width);
                let (Some((hit, to_cell)), Some(segment)) = (want, &found) else {
                    // Only just passed by, on either way.
                    let grazes = |hit: &CopyHit| hit.misses(&Aabb::new(CONTENT.min + 1e-4, CONTENT.max - 1e-4));
                    assert!(want.is_none_or(|w| grazes(&w.0)) && found.as_ref().is_none_or(|s| grazes(&s.hit)), "{i}");
                    continue;
                };
                met += 1;
                // The box ends where the scaled copy's cube does not; what it holds is the same. Maps are f32, places .5 away
                // are 2^-25 off, a cell is .1 wide.
                let at = |hit: &CopyHit, t: f64| hit.origin + (t - hit.t0) * hit.dir;
                let t = 0.5 * (hit.t0.max(segment.hit.t0) + hit.t1.min(segment.hit.t1));
                assert!((at(&hit, t) - at(&segment.hit, t)).abs().max_element() < 3e-6, "{i}");
                assert!((hit.dir - segment.hit.dir).abs().max_element() < 1e-5, "{i}");
                let to_texel = hit.linear * to_cell;
                let scale = (to_texel.determinant().abs() / (to_texel * ray.dir).length()).sqrt();
                assert!((segment.scale / scale - 1.0).abs() < 1e-6);
                let footprint = (0.001 + 0.01 * segment.hit.t0) * scale;
                assert!((f64::from(segment.march.footprint) / footprint - 1.0).abs() < 1e-6);
                assert!(Bvh::over(&bounds).nearest(&ray, 9.0, |_, _| -1.0) < 0.0, "{i}");
            }
            assert!(met > 300, "{met}");
        }
    }

    #[test]
    fn boxes_that_hold_more_or_less_than_a_copy_stay_boxes() {
        assert!(filled(&prism(0.0, 1.0), &layer(None)).0);
        // Two cells, half a cell with a cut through the content, and a part of a cell that holds all of the content.
        assert!(!filled(&prism(0.5, 1.0), &layer(None)).0);
        assert!(!filled(&prism(0.0, 0.5), &layer(None)).0);
        assert!(filled(&prism(0.05, 0.85), &layer(None)).0);
        let bent = Layer { continuous: Some(Continuous { seed: 1, octaves: 1, ..still() }), ..Layer::default() };
        let bent = TexelLayer::new(bent, vec![TexelChoice::plain(CONTENT)]);
        assert!(!filled(&prism(0.0, 1.0), &bent).0);
        let reaching = Discrete { displace: [0.9, 0.9, 0.0], ..Discrete::default() };
        assert!(!filled(&prism(0.0, 1.0), &layer(Some(reaching))).0);
        // A cell in which the lot puts nothing.
        let (done, copies, _) =
            filled(&prism(0.0, 1.0), &layer(Some(Discrete { presence: 0.0, ..Discrete::default() })));
        assert!(done && copies.len() == 0);
    }

    fn still() -> Continuous {
        Continuous {
            seed: 0,
            frequency: [1.0; 3],
            octaves: 1,
            uvw_amplitude: [0.1; 3],
            height_tilt: 0.0,
            height_scale: 0.0,
        }
    }

    #[test]
    fn flat_copies_are_met_by_no_ray() {
        let mut copies = AffineCopies::new(std::iter::once(CONTENT));
        copies.push(None, &PhongTable::default());
        let flat = DAffine3 { matrix3: DMat3::from_diagonal(DVec3::new(1.0, 0.0, 1.0)), translation: DVec3::ZERO };
        let rigid = |to_texel| RigidCopy { texel: 0, tint: Vec3::ONE, phong: 0, to_texel };
        copies.push(Some(&rigid(flat)), &PhongTable::default());
        copies.push(Some(&rigid(DAffine3::IDENTITY)), &PhongTable::default());
        let width = ConeWidth { start: 0.0, growth: 0.0 };
        let along = |origin: DVec3| Ray { origin, dir: DVec3::X };
        let met = |i: usize, y: f64| copies.segment(i, &along(DVec3::new(-1.0, y, 0.5)), 9.0, width);
        assert!(met(0, 0.5).is_none() && met(1, 0.5).is_none() && met(3, 0.5).is_none());
        let hit = met(2, 0.5).unwrap().hit;
        assert_eq!((hit.t0, hit.t1, hit.origin), (1.0, 2.0, DVec3::new(0.0, 0.5, 0.5)));
        // Past the content, which ends at y = .8.
        assert!(met(2, 0.79).is_some() && met(2, 0.81).is_none());
        assert!(copies.segment(2, &along(DVec3::new(-1.0, 0.5, 0.5)), 0.9, width).is_none());
    }
}
