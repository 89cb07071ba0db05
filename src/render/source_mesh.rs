//! The mesh that a texel was baked from, in texel space; parts that cross a cyclic border wrap around. Reference pictures trace only these
//! meshes, and other pictures trace them where a pixel is smaller than the finest voxel.

use std::path::Path;
use std::sync::Arc;

use crate::geom::{Aabb, DAffine3, DMat3, DVec3, Ray, Vec3};
use crate::scene::shell::{Pose, TexelRef};
use crate::scene::{Instance, Model, Texture, Transmission, files, gltf};
use crate::volume::axes::source_to_uvw;
use crate::volume::surface::{SurfaceTable, mean_transmission};
use crate::volume::{Info, Octree, Palette, Style};
use crate::{Error, Result, Warnings};

use super::mesh::{Contact, Mesh, MeshBuilder, Surface};

/// The geometry of a source, ready for rays in texel space.
pub struct SourceMesh {
    /// Placed in texel space.
    pub model: Model,
    /// Its triangles in texel space, with a hierarchy over them.
    pub mesh: Mesh,
}

/// A ray in the texel space of a copy.
#[derive(Debug, Clone, Copy)]
pub struct CopyRay {
    /// The ray in texel space, from its entry into the copy, which is at `t0` of the ray in the renderer's space.
    pub ray: Ray,
    pub t0: f64,
    /// The renderer's space → texel space, the linear part.
    pub to_texel: DMat3,
}

impl SourceMesh {
    /// Read the mesh at `path`, of which `info`'s texel was baked, and show it in the colours of `palette`, where its
    /// animations have it at `pose`.
    pub fn open(
        path: &Path,
        info: &Info,
        (palette, pose): (&Palette, Option<&Pose>),
        warnings: &mut Warnings,
    ) -> Result<SourceMesh> {
        if !["gltf", "glb"].contains(&files::extension(path).as_str()) {
            return Err(Error::unsupported(path, "a texel's geometry that is neither .gltf nor .glb"));
        }
        let read = gltf::ReadOptions {
            contained: true,
            // Voxels have no emission, and triangles near the camera must look as voxels do.
            emission: false,
            time: pose.map(|p| p.time),
            animations: pose.map_or_else(Vec::new, |p| p.animations.clone()),
            ..Default::default()
        };
        let mut model = gltf::read(path, &read)?.model;
        let_through(&mut model, info);
        restyle(&mut model, palette);
        warnings.merge(model.warnings.clone());
        Ok(SourceMesh::new(model, info, warnings))
    }

    /// Read the mesh that a scene's texel `texel`, whose voxels are `tree`, was baked from. `purpose` completes the message where the scene names
    /// none: "names no geometry to …".
    ///
    /// # Errors
    /// `Options` where the scene names no mesh; as [`SourceMesh::open`].
    pub fn of_texel(tree: &Octree, texel: &TexelRef, purpose: &str, warnings: &mut Warnings) -> Result<SourceMesh> {
        let Some(path) = &texel.geometry else {
            let what =
                format!("texel {:?} names no geometry to {purpose}; map it with option `geometries`", texel.name);
            return Err(Error::Options(what));
        };
        SourceMesh::open(path, tree.info(), (&texel.palette, texel.pose.as_ref()), warnings)
    }

    /// `model` in its own space, of which `info`'s texel was baked.
    pub fn new(mut model: Model, info: &Info, warnings: &mut Warnings) -> SourceMesh {
        keep_one_sided(&mut model, info);
        let to_texel = to_texel(&info.bounds, info.up);
        let mut builder = MeshBuilder::default();
        let mut placed = Vec::new();
        for instance in std::mem::take(&mut model.instances) {
            let Some(part) = model.parts.get(instance.part) else { continue };
            let thin = (part.lines.len() + part.points.len()) as u64;
            warnings.add_many("a line or point of a texel's geometry is left out of the reference", thin);
            let transform = to_texel * instance.transform;
            let at = |p: &[f32; 3]| transform.transform_point3(DVec3::from_array(p.map(f64::from)));
            let positions: Vec<DVec3> = part.positions.iter().map(at).collect();
            for shift in shifts(&Aabb::around(positions.iter().copied()), info.cyclic) {
                let moved: Vec<DVec3> = positions.iter().map(|p| p + shift).collect();
                builder.add(placed.len(), part, &moved);
                let transform = DAffine3::from_translation(shift) * transform;
                placed.push(Instance { transform, ..instance.clone() });
            }
        }
        model.instances = placed;
        SourceMesh { mesh: builder.build(&model.materials), model }
    }

    /// Surface of a copy as it is seen at a contact of `ray`, in the renderer's space; `width`: of the ray's cone there, cube edges.
    pub fn surface(&self, ray: &Ray, copy: &CopyRay, contact: &Contact, width: f64) -> Surface {
        let seen = self.mesh.surface(&self.model, &copy.ray, contact, width);
        let point = ray.at(copy.t0 + contact.t);
        let normal = (copy.to_texel.transpose() * seen.normal).normalize_or(-ray.dir);
        Surface {
            point,
            lifted: point + copy.to_texel.inverse() * (seen.lifted - seen.point),
            normal: if normal.dot(ray.dir) > 0.0 { -normal } else { normal },
            ..seen
        }
    }
}

/// Give materials without a transmission of their own the one with which the texel was baked.
fn let_through(model: &mut Model, info: &Info) {
    let Some(table) = SurfaceTable::new(info) else { return };
    for material in model.materials.iter_mut().filter(|m| m.transmission.is_none() && !m.unlit) {
        let Some(id) = material_id(info, &material.name) else { continue };
        let (mean, params) = table.entry(id);
        let through = mean_transmission(&params);
        let share = through.element_sum() / (mean + through).element_sum();
        if share > 0.0 {
            let color = [1.0; 3];
            let through = Transmission { factor: share, color, of_base: true, ..Transmission::default() };
            material.transmission = Some(Box::new(through));
        }
    }
}

/// Keep those of a model's materials single-sided that are so in the texel. In others only closed surfaces and tubes were
/// single-sided, whose front hides their back, so that both sides may be met.
fn keep_one_sided(model: &mut Model, info: &Info) {
    let table = SurfaceTable::new(info);
    for material in model.materials.iter_mut().filter(|m| !m.double_sided) {
        let id = material_id(info, &material.name);
        let known = table.as_ref().zip(id).map(|(table, id)| table.entry(id).1.one_sided);
        material.double_sided = known.is_none_or(|share| share <= 0.0);
    }
}

/// The id in a texel of a material of its source; `None` where it has none of the name.
fn material_id(info: &Info, name: &str) -> Option<u8> {
    let named = info.materials.iter().position(|m| m.name == name);
    // A texel without names has one material.
    named.or((info.materials.len() <= 1).then_some(0)).map(|id| id.min(255) as u8)
}

/// Apply a palette to a model's materials, by their names.
pub fn restyle(model: &mut Model, palette: &Palette) {
    if palette.is_plain() {
        return;
    }
    let styles: Vec<Style> = model.materials.iter().map(|m| palette.style(&m.name)).collect();
    for (material, style) in model.materials.iter_mut().zip(&styles) {
        let [r, g, b, alpha] = material.base_color;
        let [r, g, b] = style.apply(Vec3::new(r, g, b)).to_array();
        material.finish = style.finish;
        material.base_color = [r, g, b, alpha];
        if let Some(through) = material.transmission.as_mut().filter(|through| !through.of_base) {
            through.color = style.apply(Vec3::from_array(through.color)).to_array();
            // A new colour replaces that of both sides.
            through.color_texture = through.color_texture.take().filter(|_| style.keeps_albedo);
        }
        if let Some(texture) = material.texture.as_mut().filter(|_| !style.keeps_albedo) {
            // The texture's alpha is kept.
            let own = &*texture.texture;
            let texels = own.texels.iter().map(|t| [255, 255, 255, t[3]]).collect();
            let mut white = Texture::new(own.name.clone(), own.width, own.height, texels);
            (white.wrap, white.nearest) = (own.wrap, own.nearest);
            texture.texture = Arc::new(white);
        }
    }
    for part in model.parts.iter_mut().filter(|p| styles.get(p.material).is_some_and(|s| !s.keeps_albedo)) {
        part.colors.iter_mut().flatten().for_each(|c| *c = [1.0, 1.0, 1.0, c[3]]);
    }
}

/// Translations by which an object in `bounds` has to be repeated, so that its parts beyond a cyclic border re-enter on the other side.
fn shifts(bounds: &Aabb, cyclic: [bool; 3]) -> Vec<DVec3> {
    let steps = |k: usize| {
        let [before, after] = [cyclic[k] && bounds.max[k] > 1.0, cyclic[k] && bounds.min[k] < 0.0];
        [(true, 0.0), (before, -1.0), (after, 1.0)].into_iter().filter(|s| s.0).map(|s| s.1)
    };
    let all = steps(0).flat_map(|u| steps(1).flat_map(move |v| steps(2).map(move |w| DVec3::new(u, v, w))));
    all.collect()
}

/// Source space → texel space, as the bake placed it.
fn to_texel(bounds: &Aabb, up: u8) -> DAffine3 {
    let turn = source_to_uvw(up);
    let (a, b) = (turn * bounds.min, turn * bounds.max);
    let scale = DMat3::from_diagonal(1.0 / (a - b).abs());
    DAffine3 { matrix3: scale * turn, translation: -(scale * a.min(b)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_leaves_along_a_cyclic_axis_comes_in_again() {
        let across = Aabb::new(DVec3::new(-0.2, 0.1, 0.5), DVec3::new(0.3, 1.1, 1.5));
        assert_eq!(shifts(&across, [false; 3]), [DVec3::ZERO]);
        let moved = [DVec3::ZERO, DVec3::NEG_Y, DVec3::X, DVec3::new(1.0, -1.0, 0.0)];
        assert_eq!(shifts(&across, [true, true, false]), moved);
    }

    #[test]
    fn what_was_baked_to_let_light_through_does() {
        use crate::volume::surface::{SurfaceParams, store};
        let named = |name: &str| crate::scene::Material {
            name: name.into(),
            base_color: [0.5, 0.8, 0.1, 1.0],
            ..Default::default()
        };
        let mut model = Model { materials: vec![named("bark"), named("leaf"), named("moss")], ..Model::default() };
        let of = |name: &str| crate::volume::Material { name: name.into(), albedo: [0.3, 0.48, 0.06], share: 0.5 };
        let mut info = Info { materials: vec![of("bark"), of("leaf")], ..Info::default() };
        let leaf = SurfaceParams { transmission: [0.2, 0.32, 0.04], ..SurfaceParams::default() };
        store(&[SurfaceParams::default(), leaf], &mut info.meta);
        let_through(&mut model, &info);
        let [bark, leaf, moss] = [0, 1, 2].map(|i| model.materials[i].transmission.as_deref());
        assert!(bark.is_none() && moss.is_none());
        let (reflected, through) = leaf.unwrap().split([0.5, 0.8, 0.1], &|_| [1.0; 4]);
        let near = |a: [f32; 3], b: [f32; 3]| (0..3).all(|k| (a[k] - b[k]).abs() < 1e-6);
        assert!(near(reflected, [0.3, 0.48, 0.06]) && near(through, [0.2, 0.32, 0.04]), "{reflected:?} {through:?}");
        // A vertex colour is in both.
        let (reflected, through) = leaf.unwrap().split([0.05, 0.4, 0.0], &|_| [1.0; 4]);
        assert!(near(reflected, [0.03, 0.24, 0.0]) && near(through, [0.02, 0.16, 0.0]), "{reflected:?} {through:?}");
    }

    #[test]
    fn up_becomes_w() {
        let bounds = Aabb::new(DVec3::new(1.0, 2.0, 3.0), DVec3::new(3.0, 4.0, 5.0));
        let map = to_texel(&bounds, 1);
        assert_eq!(map.transform_point3(DVec3::new(1.0, 2.0, 5.0)), DVec3::ZERO);
        assert_eq!(map.transform_point3(DVec3::new(3.0, 4.0, 3.0)), DVec3::ONE);
        assert_eq!(map.transform_vector3(DVec3::NEG_Z), 0.5 * DVec3::Y);
        assert_eq!(to_texel(&bounds, 2).transform_point3(DVec3::new(1.0, 4.0, 4.0)), DVec3::new(0.0, 1.0, 0.5));
        assert_eq!(to_texel(&bounds, 0).transform_point3(DVec3::new(1.0, 4.0, 4.0)), DVec3::new(1.0, 0.5, 0.0));
    }
}
