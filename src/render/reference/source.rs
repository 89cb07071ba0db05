//! The mesh that a texel was baked from, in texel space.

use std::path::Path;

use crate::geom::{Aabb, DAffine3, DMat3, DVec3};
use crate::scene::{Model, gltf};
use crate::volume::Info;
use crate::{Error, Result, Warnings};

use super::super::mesh::{Mesh, MeshBuilder};

/// Source geometry, ready for rays in texel space.
pub struct Source {
    /// Placed in texel space.
    pub model: Model,
    pub mesh: Mesh,
}

impl Source {
    /// Read the mesh at `path`, of which `info`'s texel was baked.
    pub fn open(path: &Path, info: &Info, warnings: &mut Warnings) -> Result<Source> {
        let known = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        if !matches!(known.as_deref(), Some("gltf" | "glb")) {
            return Err(Error::unsupported(path, "a texel's geometry that is neither .gltf nor .glb"));
        }
        let model = gltf::read(path, &gltf::ReadOptions::default())?.model;
        warnings.merge(model.warnings.clone());
        Ok(Source::new(model, info, warnings))
    }

    /// `model` in its own space, of which `info`'s texel was baked.
    pub fn new(mut model: Model, info: &Info, warnings: &mut Warnings) -> Source {
        let to_texel = to_texel(&info.bounds, info.up);
        let mut builder = MeshBuilder::default();
        for (index, instance) in model.instances.iter_mut().enumerate() {
            instance.transform = to_texel * instance.transform;
            let Some(part) = model.parts.get(instance.part) else { continue };
            let at = |p: &[f32; 3]| instance.transform.transform_point3(DVec3::from_array(p.map(f64::from)));
            let thin = (part.lines.len() + part.points.len()) as u64;
            warnings.add_many("a line or point of a texel's geometry is left out of the reference", thin);
            builder.add(index, part, &part.positions.iter().map(at).collect::<Vec<_>>());
        }
        Source { mesh: builder.build(), model }
    }
}

/// Source space → texel space, as the bake placed it.
fn to_texel(bounds: &Aabb, up: u8) -> DAffine3 {
    let turn = match up {
        1 => DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y),
        _ => DMat3::IDENTITY,
    };
    let (a, b) = (turn * bounds.min, turn * bounds.max);
    let scale = DMat3::from_diagonal(1.0 / (a - b).abs());
    DAffine3 { matrix3: scale * turn, translation: -(scale * a.min(b)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn up_becomes_w() {
        let bounds = Aabb::new(DVec3::new(1.0, 2.0, 3.0), DVec3::new(3.0, 4.0, 5.0));
        let map = to_texel(&bounds, 1);
        assert_eq!(map.transform_point3(DVec3::new(1.0, 2.0, 5.0)), DVec3::ZERO);
        assert_eq!(map.transform_point3(DVec3::new(3.0, 4.0, 3.0)), DVec3::ONE);
        assert_eq!(map.transform_vector3(DVec3::NEG_Z), 0.5 * DVec3::Y);
        assert_eq!(to_texel(&bounds, 2).transform_point3(DVec3::new(1.0, 4.0, 4.0)), DVec3::new(0.0, 1.0, 0.5));
    }
}
