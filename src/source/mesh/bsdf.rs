//! What a mesh's materials are besides their colour: what is reflected of it at a point, and the means of each.

use super::patch::Face;
use super::{Piece, barycentric, texels_per_voxel};
use crate::geom::DVec3;
use crate::scene::model::{Material, Model, Part};
use crate::scene::texture::TextureRef;
use crate::scene::transmission::Transmission;
use crate::volume::surface::{SurfaceMeans, SurfaceParams};

/// Most triangles of a part that are asked for its means.
const SAMPLES: usize = 1 << 14;

/// The albedo of reflection at `at` (grid space), averaged over `width` voxels, where the base colour is `base`.
pub fn reflected(
    piece: &Piece<'_>,
    index: usize,
    transmission: &Transmission,
    (at, width): (DVec3, f64),
    base: [f32; 3],
) -> [f32; 3] {
    let corners = piece.part.triangles[index].map(|i| i as usize);
    let places = corners.map(|i| piece.corner(i as u32));
    let w = barycentric(places, at);
    let sample = |t: &TextureRef| {
        let Some(uvs) = piece.part.uvs.get(t.tex_coord) else { return [1.0; 4] };
        let uvs = corners.map(|i| t.map(uvs[i]));
        let uv = [0, 1].map(|k| (0..3).map(|i| w[i] as f32 * uvs[i][k]).sum());
        t.texture.average(uv, (width * texels_per_voxel(places, uvs, &t.texture)) as f32)
    };
    transmission.split(base, &sample).0
}

/// Sums over triangles, weighted by what of their area is there.
#[derive(Clone, Copy, Default)]
struct Sums {
    area: f64,
    reflected: [f64; 3],
    transmission: [f64; 3],
    unlit: f64,
    one_sided: f64,
}

impl Sums {
    fn means(&self) -> SurfaceMeans {
        let whole = self.area.max(f64::MIN_POSITIVE);
        let params = SurfaceParams {
            transmission: self.transmission.map(|v| v / whole),
            unlit: self.unlit / whole,
            one_sided: self.one_sided / whole,
        };
        SurfaceMeans { reflected: self.reflected.map(|v| v / whole), params }
    }
}

/// The means of each of `names` materials, or of one that has no name; `ids`: which of them each of the model's materials is.
/// `faces`: the roles of the triangles of each of the model's parts. Empty where all are matt, opaque, lit and seen from all sides.
pub fn means(model: &Model, faces: &[Vec<Face>], ids: &[u16], names: usize) -> Vec<SurfaceMeans> {
    let is_plain = |m: &Material| m.transmission.is_none() && !m.unlit;
    let has_front = |part: usize| faces.get(part).is_some_and(|of| of.contains(&Face::Front));
    let plain = |part: usize| is_plain(&model.materials[model.parts[part].material]) && !has_front(part);
    if model.instances.iter().all(|i| plain(i.part)) {
        return Vec::new();
    }
    let mut sums = vec![Sums::default(); names.max(1)];
    for instance in &model.instances {
        let part = &model.parts[instance.part];
        let step = part.triangles.len().div_ceil(SAMPLES).max(1);
        let scale = libm::cbrt(instance.transform.matrix3.determinant().abs()).powi(2) * step as f64;
        let Some(sum) = ids.get(part.material).and_then(|id| sums.get_mut(usize::from(*id))) else { continue };
        for (i, t) in part.triangles.iter().enumerate().step_by(step) {
            let weight = add(sum, model, part, *t, scale);
            let is_front = faces.get(instance.part).and_then(|of| of.get(i)) == Some(&Face::Front);
            sum.one_sided += if is_front { weight } else { 0.0 };
        }
    }
    sums.iter().map(Sums::means).collect()
}

/// Add the triangle `t` of a part whose areas count `scale` times; returns what of its area is there.
fn add(sum: &mut Sums, model: &Model, part: &Part, t: [u32; 3], scale: f64) -> f64 {
    let material = &model.materials[part.material];
    let corners = t.map(|i| i as usize);
    let places = corners.map(|i| DVec3::from(part.positions[i].map(f64::from)));
    let area = scale * (places[1] - places[0]).cross(places[2] - places[0]).length();
    if area.is_nan() || area <= 0.0 {
        return 0.0;
    }
    // The mean over the whole triangle, of each of its textures.
    let sample = |t: &TextureRef| {
        let Some(uvs) = part.uvs.get(t.tex_coord) else { return [1.0; 4] };
        let uvs = corners.map(|i| t.map(uvs[i]));
        let uv = [0, 1].map(|k| uvs.iter().map(|uv| uv[k]).sum::<f32>() / 3.0);
        let edge = libm::sqrt((places[1] - places[0]).cross(places[2] - places[0]).length());
        t.texture.average(uv, (0.7 * edge * texels_per_voxel(places, uvs, &t.texture)) as f32)
    };
    let mut rgba = material.base_color;
    if let Some(colors) = &part.colors {
        (0..4).for_each(|k| rgba[k] *= corners.iter().map(|&i| colors[i][k]).sum::<f32>() / 3.0);
    }
    if let Some(texture) = &material.texture {
        rgba.iter_mut().zip(sample(texture)).for_each(|(c, s)| *c *= s);
    }
    let there = match material.alpha {
        crate::scene::Alpha::Opaque => 1.0,
        _ => f64::from(rgba[3].clamp(0.0, 1.0)),
    };
    let base = [rgba[0], rgba[1], rgba[2]].map(|v| v.clamp(0.0, 1.0));
    let split = |t: &Transmission| t.split(base, &sample);
    let (reflected, transmitted) = material.transmission.as_deref().map_or((base, [0.0; 3]), split);
    let weight = area * there;
    sum.area += weight;
    for k in 0..3 {
        sum.reflected[k] += weight * f64::from(reflected[k]);
        sum.transmission[k] += weight * f64::from(transmitted[k]);
    }
    sum.unlit += if material.unlit { weight } else { 0.0 };
    weight
}
