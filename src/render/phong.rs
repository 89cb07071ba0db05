//! Phong parameters that layers and copies give to their texels, evaluated where rays see them.

use super::cells::CopyHit;
use super::layer::TexelLayer;
use super::shell::ShellSegment;
use crate::geom::{DMat3, DVec3, Vec3};
use crate::march::shade::Look;
use crate::scene::Scene;
use crate::scene::phong::{Factors, Phong, ShadingPoint};
use crate::volume::Gloss;

/// The distinct Phong parameters of a scene's layers and copies, numbered from 1, without their constant tints. Number 0 is no change.
#[derive(Debug, Clone, Default)]
pub struct PhongTable {
    list: Vec<Phong>,
}

impl PhongTable {
    /// The parameters of all layers and all copies of a scene.
    pub fn new(scene: &Scene) -> PhongTable {
        let mut table = PhongTable::default();
        let shells = scene.model.materials.iter().filter_map(|m| m.shell.as_deref());
        for layer in shells.flat_map(|shell| &shell.layers) {
            table.add(&layer.phong);
            let variants = layer.discrete.iter().flat_map(|d| &d.variants);
            variants.for_each(|v| table.add(&v.phong.within(&layer.phong)));
        }
        scene.copies.iter().flat_map(|set| &set.variants).for_each(|v| table.add(&v.phong));
        table
    }

    fn add(&mut self, phong: &Phong) {
        let phong = untinted(phong);
        if phong != Phong::default() && !self.list.contains(&phong) {
            self.list.push(phong);
        }
    }

    /// The number of parameters, apart from their tint; 0 if the table does not contain them.
    pub fn number(&self, phong: &Phong) -> u32 {
        let phong = untinted(phong);
        self.list.iter().position(|p| *p == phong).map_or(0, |i| i as u32 + 1)
    }

    fn get(&self, number: u32) -> Option<&Phong> {
        self.list.get((number as usize).checked_sub(1)?)
    }

    /// Whether parameters vary from place to place.
    pub fn varies(&self, number: u32) -> bool {
        self.get(number).is_some_and(|p| !p.variations.is_empty())
    }

    /// The material modifiers by parameters `number` and a `tint` of all colours. `place` gives the point that is shaded; it is called only
    /// if the parameters vary.
    pub fn look(&self, number: u32, tint: Vec3, place: impl FnOnce() -> Option<ShadingPoint>) -> Look {
        let Some(phong) = self.get(number) else { return Look::tinted(tint) };
        let mut factors = Factors::ONE;
        if !phong.variations.is_empty()
            && let Some(place) = place()
        {
            phong.variations.iter().for_each(|v| v.apply(&place, &mut factors));
        }
        let Gloss { specular, shininess } = phong.finish.gloss();
        Look {
            diffuse: tint * factors.diffuse,
            ambient: factors.ambient * Vec3::from_array(phong.finish.ambient.map(|v| v as f32)),
            gloss: Gloss { specular: specular * factors.specular, shininess: shininess * factors.shininess },
            own_gloss: (factors.specular, factors.shininess),
        }
    }
}

/// Tints are kept with the copies themselves, most of which have nothing else.
fn untinted(phong: &Phong) -> Phong {
    Phong { diffuse: [1.0; 3], ..phong.clone() }
}

/// Texel coordinates along a straight segment of a ray, as [`ShadingPoint`] has them.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceCoords {
    t0: f64,
    /// The mesh's texel coordinates at t0, and their change per unit of t.
    ground: [DVec3; 2],
    /// Their units per unit of length across the ray.
    ground_scale: f64,
    /// Scale and offset from them to the layer's texel coordinates.
    scale: DVec3,
    offset: DVec3,
}

impl SurfaceCoords {
    /// Along a segment in a shell, in the mesh's texel coordinates; `across`: their units per unit of length across the ray.
    pub fn of_layer(segment: &ShellSegment, layer: &TexelLayer, across: f64) -> SurfaceCoords {
        let per_t = (segment.q1 - segment.q0) / (segment.t1 - segment.t0);
        SurfaceCoords {
            t0: segment.t0,
            ground: [segment.q0, if per_t.is_finite() { per_t } else { DVec3::ZERO }],
            ground_scale: across,
            scale: DVec3::from_array(layer.layer.scale),
            offset: DVec3::from_array(layer.layer.offset),
        }
    }

    /// Along a segment in a rigid copy; `across`: cube edges per unit of length across the ray.
    pub fn of_copy(hit: &CopyHit, across: f64) -> SurfaceCoords {
        let ground = [hit.origin, hit.dir];
        SurfaceCoords { t0: hit.t0, ground, ground_scale: across, scale: DVec3::ONE, offset: DVec3::ZERO }
    }

    /// The point at t, whose world position is `world`, metres; the cone is `width` renderer's units wide there, each of `unit` metres.
    pub fn at(&self, t: f64, world: DVec3, width: f64, unit: f64) -> ShadingPoint {
        let ground = self.ground[0] + (t - self.t0) * self.ground[1];
        let texel = ground * self.scale + self.offset;
        let ground_width = width * self.ground_scale;
        let widest = self.scale.abs().max_element();
        ShadingPoint {
            ground: [ground.x, ground.y],
            ground_width,
            texel,
            texel_width: ground_width * widest,
            world,
            world_width: width * unit,
        }
    }
}

/// Scale of the map `m` at right angles to the unit direction `d`: the square root of the ratio of areas.
pub fn scale_across(m: &DMat3, d: DVec3) -> f64 {
    let along = (*m * d).length();
    if along > 0.0 { (m.determinant().abs() / along).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::phong::Variation;
    use crate::volume::Finish;
    use std::sync::Arc;

    #[test]
    fn what_is_the_same_but_for_its_tint_has_one_number() {
        let glossy = |tint, shininess| Phong {
            finish: Finish { specular: Some([0.1; 3]), shininess: Some(shininess), ..Finish::PLAIN },
            ..Phong::tint(tint)
        };
        let mut table = PhongTable::default();
        let varied = Phong { variations: vec![Arc::new(Variation::default())], ..Phong::default() };
        for phong in [Phong::tint([0.5; 3]), glossy([1.0; 3], 9.0), glossy([0.5; 3], 9.0), varied.clone()] {
            table.add(&phong);
        }
        assert_eq!(table.list.len(), 2);
        assert_eq!([0.5, 2.0].map(|v| table.number(&Phong::tint([v; 3]))), [0, 0]);
        assert_eq!((table.number(&glossy([3.0; 3], 9.0)), table.number(&glossy([1.0; 3], 8.0))), (1, 0));
        assert!(table.varies(table.number(&varied)) && !table.varies(1) && !table.varies(0));
        let look = table.look(1, Vec3::splat(0.25), || panic!("nothing varies"));
        assert_eq!((look.diffuse, look.ambient, look.gloss.shininess), (Vec3::splat(0.25), Vec3::ONE, 9.0));
    }
}
