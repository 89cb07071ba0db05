//! Rigid copies of texels: upright, unsheared and whole, each placed by its own transform, beside the shells that bend theirs.

use glam::DQuat;

use super::shell::Variant;
use super::wind::WindField;
use crate::geom::{DAffine3, DMat3, DVec3};
use crate::volume::Info;
use crate::volume::axes::{UVW_TO_SCENE, to_uvw};

/// Copies that one node places. Copies beyond the end of a list of properties have the default, so that a million copies without such
/// properties take 12 MB.
#[derive(Debug, Clone, PartialEq)]
pub struct CopySet {
    /// Name of the node, for messages.
    pub node: String,
    /// The node's space → world.
    pub to_world: DAffine3,
    /// Texels to choose from; at least one.
    pub variants: Vec<Variant>,
    /// Position of the source's origin in the node's space, metres; one per copy.
    pub translations: Vec<[f32; 3]>,
    /// Quaternions x, y, z, w of any length above 0; identity where absent.
    pub rotations: Vec<[f32; 4]>,
    /// Scales along the copy's own axes; 1 where absent.
    pub scales: Vec<[f32; 3]>,
    /// Indices into `variants`; 0 where absent.
    pub choices: Vec<u8>,
    /// Factors of the albedo, linear; 1 where absent.
    pub tints: Vec<[f32; 3]>,
    /// Phase of each copy in its texel's animation, as a share of the cycle; where absent, the animation's own rule decides.
    pub phases: Vec<f32>,
    /// The wind in which the copies lean.
    pub wind: Option<WindField>,
}

impl CopySet {
    /// Number of copies.
    pub fn len(&self) -> usize {
        self.translations.len()
    }

    /// Whether there are no copies.
    pub fn is_empty(&self) -> bool {
        self.translations.is_empty()
    }

    /// The linear map, in world space and about the copy's foot, by which a copy leans in the wind; `None` without wind.
    pub fn lean(&self, copy: usize) -> Option<DMat3> {
        let wind = self.wind.as_ref()?;
        let stands = self.to_world * self.local(copy);
        Some(wind.lean(stands.translation, stands.matrix3.y_axis))
    }

    /// Map from a copy's own space to the node's.
    pub fn local(&self, copy: usize) -> DAffine3 {
        let wide = |v: &[f32; 3]| DVec3::from(v.map(f64::from));
        let turn = |q: &[f32; 4]| {
            let q = DQuat::from_array(q.map(f64::from));
            if q.length().is_normal() { q.normalize() } else { DQuat::IDENTITY }
        };
        DAffine3::from_scale_rotation_translation(
            self.scales.get(copy).map_or(DVec3::ONE, wide),
            self.rotations.get(copy).map_or(DQuat::IDENTITY, turn),
            self.translations.get(copy).map_or(DVec3::ZERO, wide),
        )
    }

    /// Index into `variants` of a copy's texel; 0 where the stored index is out of range.
    pub fn choice(&self, copy: usize) -> usize {
        let choice = self.choices.get(copy).copied().map_or(0, usize::from);
        if choice < self.variants.len() { choice } else { 0 }
    }
}

/// A copy's own space (metres, +Y up, the source's origin at 0) → the texel's cube.
pub fn to_texel(info: &Info) -> DAffine3 {
    let metres = if info.metres_per_unit > 0.0 { info.metres_per_unit } else { 1.0 };
    let (min, max) = (info.bounds.min * metres, info.bounds.max * metres);
    let (a, b) = (to_uvw(info.up, min), to_uvw(info.up, max));
    let scale = 1.0 / (b - a).abs();
    DAffine3 { matrix3: DMat3::from_diagonal(scale) * UVW_TO_SCENE.transpose(), translation: -(scale * a.min(b)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Aabb;

    #[test]
    fn the_origin_of_the_source_stands_on_the_placement() {
        let bounds = Aabb::new(DVec3::new(-1.0, -0.5, -2.0), DVec3::new(3.0, 3.5, 2.0));
        let info = Info { bounds, metres_per_unit: 0.5, ..Info::default() };
        let map = to_texel(&info);
        assert_eq!(map.transform_point3(DVec3::ZERO), DVec3::new(0.25, 0.5, 0.125));
        // Up is w, and −z is v.
        assert_eq!(map.transform_vector3(DVec3::Y), DVec3::new(0.0, 0.0, 0.5));
        assert_eq!(map.transform_vector3(DVec3::NEG_Z), DVec3::new(0.0, 0.5, 0.0));
        // Of a source with Z up, z is up in the scene.
        let map = to_texel(&Info { up: 2, ..info.clone() });
        assert_eq!(map.transform_vector3(DVec3::Y), DVec3::new(0.0, 0.0, 0.5));
        assert_eq!(map.transform_point3(DVec3::ZERO), DVec3::new(0.25, 0.125, 0.5));
        // Of one with X up, x is.
        let map = to_texel(&Info { up: 0, ..info });
        assert_eq!(map.transform_vector3(DVec3::Y), DVec3::new(0.0, 0.0, 0.5));
        assert_eq!(map.transform_point3(DVec3::ZERO), DVec3::new(0.125, 0.5, 0.25));
    }

    #[test]
    fn what_is_absent_has_its_default() {
        let variant = Variant::alone(0);
        let set = CopySet {
            node: String::new(),
            to_world: DAffine3::IDENTITY,
            variants: vec![variant.clone(), variant],
            translations: vec![[1.0, 2.0, 3.0]; 2],
            rotations: vec![[0.0; 4]],
            scales: vec![],
            choices: vec![1, 7],
            tints: vec![],
            phases: vec![],
            wind: None,
        };
        assert_eq!(set.local(0), DAffine3::from_translation(DVec3::new(1.0, 2.0, 3.0)));
        assert_eq!((set.choice(0), set.choice(1), set.choice(2)), (1, 0, 0));
    }
}
