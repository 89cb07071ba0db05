//! Rigid copies of texels: where a scene's placements put them, the texel's cube under one affine map each.

use super::cells;
use super::phong::PhongTable;
use crate::geom::{Aabb, DAffine3, DMat3, Vec3};
use crate::scene::Scene;
use crate::scene::copies::{CopySet, to_texel};
use crate::scene::cycle::Cycle;
use crate::volume::Info;
use crate::{Error, Result};

/// All copies of a scene, numbered through.
#[derive(Default)]
pub struct Copies<'a> {
    sets: Vec<PlacedSet<'a>>,
    count: usize,
}

/// One set in the renderer's space.
struct PlacedSet<'a> {
    set: &'a CopySet,
    /// Number of the set's first copy.
    first: usize,
    /// The node's space → the renderer's.
    place: DAffine3,
    /// One per variant of the set.
    variants: Vec<CopyVariant>,
}

impl PlacedSet<'_> {
    /// A copy's own space → the renderer's, leaning in the wind.
    fn map(&self, copy: usize) -> DAffine3 {
        let stands = self.place * self.set.local(copy);
        // The lean is about the copy's foot, so the translation stays; both spaces have the same axes.
        self.set.lean(copy).map_or(stands, |lean| DAffine3 { matrix3: lean * stands.matrix3, ..stands })
    }
}

/// A texel that copies of a set may show.
struct CopyVariant {
    texel: usize,
    /// Number of the texel's frames, and the rule by which a copy shows one of them.
    frames: u32,
    cycle: Option<Cycle>,
    tint: Vec3,
    phong: u32,
    /// Map from a copy's own space to texel space, and the content's bounding box in the copy's own space.
    to_texel: DAffine3,
    content: Aabb,
}

/// One copy.
#[derive(Debug, Clone, Copy)]
pub struct RigidCopy {
    pub texel: usize,
    pub tint: Vec3,
    /// See [`super::cells::CopyHit::phong`].
    pub phong: u32,
    /// The renderer's space → the texel's cube.
    pub to_texel: DAffine3,
}

impl<'a> Copies<'a> {
    /// `phongs`: the scene's; `info(i)`: what the file of the scene's texel i says, if it is open; `place` takes world space to the renderer's.
    ///
    /// # Errors
    /// [`Error::Options`] where a texel that is used is not open.
    pub fn new<'i>(
        scene: &'a Scene,
        phongs: &PhongTable,
        info: impl Fn(usize) -> Option<&'i Info>,
        place: impl Fn(DAffine3) -> DAffine3,
    ) -> Result<Copies<'a>> {
        let mut copies = Copies::default();
        for set in &scene.copies {
            let kind = |v: &crate::scene::shell::Variant| {
                let missing =
                    || Error::Options(format!("the scene's copies use texel {}, which is not there", v.texel));
                let texel_ref = scene.texels.get(v.texel);
                let frames = texel_ref.map_or(1, |t| t.following + 1);
                let row = cells::texel_frames(v.texel, frames, &info)?.ok_or_else(missing)?;
                let map = to_texel(row.info);
                let content = row.content.transformed(map.inverse());
                let tint = Vec3::from_array(v.phong.diffuse.map(|d| d as f32));
                let phong = phongs.number(&v.phong);
                Ok(CopyVariant {
                    texel: v.texel,
                    frames,
                    cycle: texel_ref.and_then(|t| t.cycle),
                    tint,
                    phong,
                    to_texel: map,
                    content,
                })
            };
            let variants = set.variants.iter().map(kind).collect::<Result<Vec<_>>>()?;
            copies.sets.push(PlacedSet { set, first: copies.count, place: place(set.to_world), variants });
            copies.count += set.len();
        }
        Ok(copies)
    }

    /// Number of copies.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Bounding boxes of the copies' contents in the renderer's space, in order.
    pub fn bounds(&self) -> impl Iterator<Item = Aabb> {
        self.sets.iter().flat_map(|placed| {
            (0..placed.set.len()).map(|i| {
                let map = placed.map(i);
                let content = placed.variants.get(placed.set.choice(i)).map_or(Aabb::EMPTY, |k| k.content);
                if content.is_empty() {
                    return Aabb::new(map.translation, map.translation);
                }
                image_bounds(&content, &map)
            })
        })
    }

    /// The copy of a number; `None` where there is none, or it has no volume.
    pub fn get(&self, index: usize) -> Option<RigidCopy> {
        let after = self.sets.partition_point(|placed| placed.first <= index);
        let placed = self.sets.get(after.checked_sub(1)?)?;
        let i = index - placed.first;
        let kind = placed.variants.get(placed.set.choice(i)).filter(|_| i < placed.set.len())?;
        let to_texel = kind.to_texel * placed.map(i).inverse();
        let tint = placed.set.tints.get(i).map_or(kind.tint, |t| kind.tint * Vec3::from_array(*t));
        let frame = kind.cycle.filter(|_| kind.frames > 1).map_or(0, |cycle| {
            let hash = Cycle::cell_hash([i as i64, 0, 0]);
            let place = || (placed.set.to_world * placed.set.local(i)).translation;
            let ahead = placed.set.phases.get(i).map_or_else(|| cycle.phase_of(hash, place()), |p| f64::from(*p));
            cycle.frame(kind.frames, ahead, hash)
        });
        let (texel, phong) = (kind.texel + frame as usize, kind.phong);
        let found = RigidCopy { texel, tint, phong, to_texel };
        to_texel.is_finite().then_some(found)
    }
}

/// Bounding box of the image of a box under an affine map.
pub fn image_bounds(content: &Aabb, map: &DAffine3) -> Aabb {
    let m = map.matrix3;
    // The half size of the corners' bounding box is the matrix of magnitudes times the half size.
    let reach = DMat3::from_cols(m.x_axis.abs(), m.y_axis.abs(), m.z_axis.abs()) * (0.5 * content.size());
    let middle = map.transform_point3(content.centre());
    Aabb::new(middle - reach, middle + reach)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::DVec3;
    use crate::scene::phong::Phong;
    use crate::scene::shell::Variant;

    #[test]
    fn copies_are_found_by_their_numbers_and_lie_in_their_bounds() {
        let variant = |texel: usize| Variant { phong: Phong::tint([0.5, 1.0, 2.0]), ..Variant::alone(texel) };
        let set = |n: usize, texel: usize| CopySet {
            node: String::new(),
            to_world: DAffine3::from_scale(DVec3::new(2.0, 1.0, 1.0)),
            variants: vec![variant(texel), variant(1 - texel)],
            translations: (0..n).map(|i| [i as f32, 0.0, 1.0]).collect(),
            rotations: (0..n).map(|i| [0.0, i as f32, 0.3, 1.0]).collect(),
            scales: (0..n).map(|i| [1.0, 0.5, -1.0 - i as f32]).collect(),
            choices: (0..n).map(|i| (i % 2) as u8).collect(),
            tints: vec![[2.0, 1.0, 1.0]; n],
            phases: vec![],
            wind: None,
        };
        let scene = Scene { copies: vec![set(3, 0), set(0, 0), set(2, 1)], ..Scene::default() };
        let info = Info {
            bounds: Aabb::new(DVec3::new(-1.0, 0.0, -1.0), DVec3::new(1.0, 2.0, 1.0)),
            content: Aabb::new(DVec3::new(0.2, 0.3, 0.0), DVec3::new(0.6, 0.9, 0.7)),
            ..Info::default()
        };
        let copies = Copies::new(&scene, &PhongTable::new(&scene), |_| Some(&info), |world| world).unwrap();
        assert_eq!(copies.len(), 5);
        let texels: Vec<usize> = (0..5).map(|i| copies.get(i).unwrap().texel).collect();
        assert_eq!(texels, [0, 1, 0, 1, 0]);
        assert!(copies.get(5).is_none());
        for (i, bounds) in copies.bounds().enumerate() {
            let copy = copies.get(i).unwrap();
            assert_eq!(copy.tint, Vec3::new(1.0, 1.0, 2.0));
            let own = info.content.transformed(copy.to_texel.inverse());
            // The same box by its corners; a few roundings apart.
            assert!((own.min - bounds.min).abs().max((own.max - bounds.max).abs()).max_element() < 1e-9, "{i}");
        }
        assert!(
            Copies::new(&scene, &PhongTable::new(&scene), |i| Some(&info).filter(|_| i == 0), |world| world).is_err()
        );
    }
}
