//! What a triangle's material sends back, lets through and gives off, over the width of a cone.

use glam::DVec4;

use super::{Contact, Mesh, Triangle};
use crate::geom::{DVec3, Vec3, each3};
use crate::scene::{Material, Part, TextureRef};

impl Mesh {
    /// Linear albedo of reflection and of diffuse transmission at a contact, of a material whose base colour there is `base`,
    /// over `width` of the surface.
    pub(super) fn reflected(
        &self,
        part: &Part,
        material: &Material,
        triangle: &Triangle,
        at: &Contact,
        (width, base): (f64, [f32; 3]),
    ) -> (Vec3, Vec3) {
        let Some(transmission) = &material.transmission else { return (Vec3::from_array(base), Vec3::ZERO) };
        let (reflected, transmitted) =
            transmission.split(base, &|reference| self.averaged(part, reference, triangle, at, width));
        (Vec3::from_array(reflected), Vec3::from_array(transmitted))
    }

    /// Light that a material gives off at a contact, over `width` of the surface.
    pub(super) fn emitted(
        &self,
        part: &Part,
        material: &Material,
        triangle: &Triangle,
        at: &Contact,
        width: f64,
    ) -> Vec3 {
        let Some(emission) = &material.emission else { return Vec3::ZERO };
        let texture = emission.texture.as_ref();
        let [r, g, b, _] = texture.map_or([1.0; 4], |reference| self.averaged(part, reference, triangle, at, width));
        Vec3::from_array(emission.color) * Vec3::new(r, g, b)
    }

    /// A texture's linear RGBA at a contact, over `width` of the surface; white where it cannot be laid on.
    fn averaged(&self, part: &Part, reference: &TextureRef, triangle: &Triangle, at: &Contact, width: f64) -> [f32; 4] {
        let Some(uvs) = part.uvs.get(reference.tex_coord) else { return [1.0; 4] };
        let uv = |i: u32| uvs.get(i as usize).copied().unwrap_or_default().map(f64::from);
        let corners = self.at_corners(part, triangle, |i| DVec4::new(uv(i)[0], uv(i)[1], 0.0, 0.0));
        let Some(corners) = corners else { return [1.0; 4] };
        let [a, b, c] = each3(corners, |c| reference.map([c.x as f32, c.y as f32]));
        let weights = at.weights();
        let uv = [0, 1].map(|k| weights[0] * a[k] + weights[1] * b[k] + weights[2] * c[k]);
        let texture = &*reference.texture;
        // Texels per length, by the areas of the triangle in both.
        let [p, q, r]: [DVec3; 3] = self.corners(triangle);
        let area = (q - p).cross(r - p).length();
        let across = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        let texels = f64::from(across.abs()) * f64::from(texture.width) * f64::from(texture.height);
        let footprint = if area > 0.0 { width * (texels / area).sqrt() } else { 0.0 };
        texture.average(uv, footprint as f32)
    }
}
