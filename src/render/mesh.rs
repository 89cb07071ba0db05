//! Plain meshes: where a ray meets them, and what they look like there.
//!
//! Based on: J. Hanika, *Hacking the Shadow Terminator*, Ray Tracing Gems II, 2021.

mod blocks;
mod bundle;
mod cards;
mod shear;
mod transmission;

use blocks::Blocks;
pub use bundle::Bundle;
pub use shear::Shear;

use glam::DVec4;

use super::bvh::Bvh;
use super::curved::{self, Piece};
use super::mask::{Lookup, Masks};
use crate::geom::{Aabb, DAffine3, DMat3, DVec3, Ray, Vec3, each3};
use crate::march::shade::Look;
use crate::scene::{Alpha, Material, Model, Part};
use crate::volume::{Finish, Gloss};

/// A triangle of the scene in the renderer's space.
#[derive(Debug, Clone, Copy)]
struct Triangle {
    vertices: [u32; 3],
    /// Index into [`Model::instances`], and the triangle in its part; or, with [`CURVED`] set, the index into [`Mesh::pieces`].
    instance: u32,
    index: u32,
}

/// Marks a triangle that is a piece of a bilinear patch.
const CURVED: u32 = 1 << 31;

/// All plain triangles.
#[derive(Default)]
pub struct Mesh {
    vertices: Vec<DVec3>,
    triangles: Vec<Triangle>,
    /// Of bilinear patches that are not flat.
    pieces: Vec<Piece>,
    blocks: Blocks,
    masks: Masks,
    /// Cards: triangles whose alpha varies. Indices, and the hierarchy over them.
    cards: Vec<u32>,
    card_bvh: Bvh,
}

/// Which contacts count for a ray.
struct RayQuery {
    /// Contacts nearer or farther than this are none.
    from: f64,
    to: f64,
    /// The triangle that the ray starts on.
    skip: Option<u32>,
    /// Whether this is a camera ray, which meets single-sided facets from the front only.
    is_camera: bool,
}

impl RayQuery {
    fn until(to: f64) -> RayQuery {
        RayQuery { from: 0.0, to, skip: None, is_camera: false }
    }

    /// Of a ray that starts on a surface, maybe on the triangle `skip`.
    fn from_surface(to: f64, skip: Option<u32>) -> RayQuery {
        RayQuery { from: 1e-9, to, skip, is_camera: false }
    }

    fn of_camera(self) -> RayQuery {
        RayQuery { is_camera: true, ..self }
    }
}

/// Intersection of a ray with a triangle.
#[derive(Debug, Clone, Copy)]
pub struct Contact {
    pub t: f64,
    pub triangle: u32,
    /// Weights of its second and third corner.
    b: [f64; 2],
    /// In (0, 1].
    pub alpha: f32,
}

/// Where light meets a surface.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    pub point: DVec3,
    /// As [`Surface::lifted`].
    pub lifted: DVec3,
    /// Unit, towards the viewer.
    pub normal: DVec3,
}

impl Contact {
    /// The mean of contacts with one triangle, weighted, as one of the share `alpha`.
    pub fn mean<'a>(contacts: impl Iterator<Item = (f32, &'a Contact)>, alpha: f32) -> Option<Contact> {
        let mut mean: Option<Contact> = None;
        let mut sum = 0.0;
        for (weight, contact) in contacts.map(|(w, c)| (f64::from(w), c)) {
            sum += weight;
            let mean = mean.get_or_insert(Contact { alpha, ..*contact });
            let mix = |a: &mut f64, b: f64| *a += (b - *a) * (weight / sum);
            mix(&mut mean.t, contact.t);
            (0..2).for_each(|k| mix(&mut mean.b[k], contact.b[k]));
        }
        mean
    }

    /// Weights of the triangle's corners.
    fn weights(&self) -> [f32; 3] {
        [(1.0 - self.b[0] - self.b[1]) as f32, self.b[0] as f32, self.b[1] as f32]
    }
}

/// Surface as it is seen at a contact.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    pub point: DVec3,
    /// Start of shadow rays: the point lifted to the surface that the normals suggest.
    pub lifted: DVec3,
    /// Unit, towards the viewer.
    pub normal: DVec3,
    /// Linear.
    pub albedo: Vec3,
    /// Albedo of diffuse transmission, linear.
    pub transmission: Vec3,
    /// Share of the light from around that is reflected, of what would be else.
    pub ambient: Vec3,
    /// Highlights, where the material says something of them.
    pub gloss: Option<Gloss>,
    /// Light that it gives off, linear.
    pub emission: Vec3,
    pub unlit: bool,
}

impl Surface {
    /// As a landscape shows it.
    pub fn shown(self, look: &Look) -> Surface {
        let (strength, width) = look.own_gloss;
        let own = |g: Gloss| Gloss { specular: g.specular * strength, shininess: g.shininess * width };
        Surface {
            albedo: self.albedo * look.diffuse,
            transmission: self.transmission * look.diffuse,
            ambient: self.ambient * look.ambient,
            gloss: Some(self.gloss.map_or(look.gloss, own)),
            ..self
        }
    }

    /// What it reflects in its highlight of a light in the unit direction `light`, in units of the irradiance over π of a surface
    /// that faces the light; `view`: unit, towards the viewer.
    pub fn highlight(&self, view: DVec3, light: DVec3) -> Vec3 {
        let Some(gloss) = self.gloss.filter(|g| !g.is_none()) else { return Vec3::ZERO };
        gloss.specular * gloss.facet(self.normal.as_vec3(), view.as_vec3(), light.as_vec3())
    }

    /// Start of shadow rays on the side that is not seen.
    pub fn lifted_behind(&self) -> DVec3 {
        2.0 * self.point - self.lifted
    }
}

/// Builds a [`Mesh`].
#[derive(Default)]
pub struct MeshBuilder {
    vertices: Vec<DVec3>,
    triangles: Vec<Triangle>,
    pieces: Vec<Piece>,
    /// For each part that was added, its first triangle, its material, and whether its vertices have colours.
    parts: Vec<(usize, usize, bool)>,
}

impl MeshBuilder {
    /// Add a placed part, whose positions were brought into the renderer's space.
    pub fn add(&mut self, instance: usize, part: &Part, positions: &[DVec3]) {
        self.add_curved(instance, part, positions, &[]);
    }

    /// The same; of the part's patches, those that are `curved` are drawn as bilinear patches, and not as their two triangles.
    pub fn add_curved(&mut self, instance: usize, part: &Part, positions: &[DVec3], curved: &[bool]) {
        let base = self.vertices.len() as u32;
        self.vertices.extend_from_slice(positions);
        self.parts.push((self.triangles.len(), part.material, part.colors.is_some()));
        let mut cut = vec![false; part.patches.len()];
        for (i, patch) in part.patches.iter().enumerate().filter(|(i, _)| curved.get(*i) == Some(&true)) {
            let ring = patch.map(|v| positions.get(v as usize).copied().unwrap_or(DVec3::NAN));
            let n = curved::pieces(ring, part.patches.len());
            if n == 1 || !ring.iter().all(|p| p.as_vec3().is_finite()) {
                continue;
            }
            cut[i] = true;
            let first = self.vertices.len() as u32;
            let (vertices, triangles) = curved::cut(ring, i as u32, n);
            self.vertices.extend(vertices);
            for (numbers, piece) in triangles {
                let index = CURVED | self.pieces.len() as u32;
                self.pieces.push(piece);
                let vertices = numbers.map(|k| first + k);
                self.triangles.push(Triangle { vertices, instance: instance as u32, index });
            }
        }
        self.add_triangles(instance, part, positions, (base, &cut));
    }

    /// The part's triangles, but those of the patches that are `cut`; `base` is the number of its first vertex.
    fn add_triangles(&mut self, instance: usize, part: &Part, positions: &[DVec3], (base, cut): (u32, &[bool])) {
        for (index, t) in part.triangles.iter().enumerate().filter(|(i, _)| cut.get(i / 2) != Some(&true)) {
            let known = t.iter().all(|&v| positions.get(v as usize).is_some_and(|p| p.as_vec3().is_finite()));
            if known {
                let vertices = t.map(|v| base + v);
                self.triangles.push(Triangle { vertices, instance: instance as u32, index: index as u32 });
            }
        }
    }

    /// The mesh, whose parts are of `materials`.
    pub fn build(self, materials: &[Material]) -> Mesh {
        let MeshBuilder { vertices, triangles, pieces, parts } = self;
        let bounds = |t: &Triangle| Aabb::around(t.vertices.map(|v| vertices[v as usize]));
        let blocks = Blocks::new(triangles.len(), |i| triangles[i].vertices.map(|v| vertices[v as usize]));
        let ends = parts.iter().skip(1).map(|p| p.0).chain([triangles.len()]);
        let is_card = |&(&(_, material, colors), _): &(&(usize, usize, bool), usize)| {
            materials.get(material).is_some_and(|m| m.alpha != Alpha::Opaque && (m.texture.is_some() || colors))
        };
        let of_cards = parts.iter().zip(ends).filter(is_card);
        let cards: Vec<u32> = of_cards.flat_map(|(part, end)| part.0 as u32..end as u32).collect();
        let card_bvh = Bvh::new(cards.iter().map(|&i| bounds(&triangles[i as usize])));
        Mesh { vertices, triangles, pieces, blocks, masks: Masks::new(materials), cards, card_bvh }
    }
}

impl Mesh {
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    #[inline]
    fn corners(&self, t: &Triangle) -> [DVec3; 3] {
        let ([a, b, c], at) = (t.vertices, |v: u32| self.vertices[v as usize]);
        [at(a), at(b), at(c)]
    }

    /// What the part's vertices have, at the corners of a triangle; `None` where it has none.
    fn at_corners(&self, part: &Part, triangle: &Triangle, of: impl Fn(u32) -> DVec4) -> Option<[DVec4; 3]> {
        if triangle.index & CURVED == 0 {
            return part.triangles.get(triangle.index as usize).map(|t| each3(*t, of));
        }
        let piece = self.pieces.get((triangle.index & !CURVED) as usize)?;
        part.patches.get(piece.patch as usize).map(|ring| piece.mix(ring.map(of)))
    }

    /// The nearest contact in (0, t1) that lets nothing through; those before it that let light through are appended to
    /// `blended`, in no order. `width_at(t)` is the width of the ray there.
    pub fn nearest(
        &self,
        model: &Model,
        ray: &Ray,
        t1: f64,
        width_at: impl Fn(f64) -> f64,
        blended: &mut Vec<Contact>,
    ) -> Option<Contact> {
        self.nearest_of(ray, t1, blended, |i, shear, t1| {
            self.contact(model, shear, ray, i, &RayQuery::until(t1), &width_at)
        })
    }

    /// The same for a camera ray, which meets single-sided facets from the front only, with the facets' opacity scaled: see
    /// [`scaled_alpha`].
    pub fn nearest_for_camera(
        &self,
        model: &Model,
        ray: &Ray,
        (t1, opacity_scale): (f64, f32),
        width_at: impl Fn(f64) -> f64,
        blended: &mut Vec<Contact>,
    ) -> Option<Contact> {
        self.nearest_of(ray, t1, blended, |i, shear, t1| {
            let contact = self.contact(model, shear, ray, i, &RayQuery::until(t1).of_camera(), &width_at)?;
            let alpha = scaled_alpha(contact.alpha, opacity_scale);
            (alpha > 0.0).then_some(Contact { alpha, ..contact })
        })
    }

    /// The nearest of the contacts that `contact` gives for a triangle before a distance.
    fn nearest_of(
        &self,
        ray: &Ray,
        t1: f64,
        blended: &mut Vec<Contact>,
        contact: impl Fn(u32, &Shear, f64) -> Option<Contact>,
    ) -> Option<Contact> {
        let mut found = None;
        let shear = Shear::new(ray.dir);
        let end = self.blocks.nearest(ray, &shear, t1, |i, t1| match contact(i, &shear, t1) {
            Some(contact) if contact.alpha >= 1.0 => {
                found = Some(contact);
                contact.t
            }
            Some(contact) => {
                blended.push(contact);
                t1
            }
            None => t1,
        });
        blended.retain(|v| v.t < end);
        found
    }

    /// Calls `each` with t in (0, t1) of every contact of `ray` that lets less than half of the light through, in no order, and
    /// whether the triangle's own normal is towards the ray's origin.
    pub fn for_each_contact(&self, model: &Model, ray: &Ray, t1: f64, mut each: impl FnMut(f64, bool)) {
        let shear = Shear::new(ray.dir);
        self.blocks.nearest(ray, &shear, t1, |i, t1| {
            if let Some(contact) = self.contact(model, &shear, ray, i, &RayQuery::until(t1), &|_| 0.0)
                && contact.alpha >= 0.5
            {
                let [p, q, r] = self.corners(&self.triangles[i as usize]);
                each(contact.t, (q - p).cross(r - p).dot(ray.dir) < 0.0);
            }
            t1
        });
    }

    /// The share of light that comes through from `ray`'s origin up to t1; `skip` is the triangle that it starts on.
    pub fn transmittance(&self, model: &Model, ray: &Ray, t1: f64, skip: Option<u32>, width: f64) -> f32 {
        self.transmittance_scaled(model, ray, (t1, 1.0), skip, width)
    }

    /// The same, of facets with their opacity scaled: see [`scaled_alpha`].
    pub fn transmittance_scaled(
        &self,
        model: &Model,
        ray: &Ray,
        (t1, opacity_scale): (f64, f32),
        skip: Option<u32>,
        width: f64,
    ) -> f32 {
        let each = |i: u32, shear: &Shear, t1: f64| {
            let contact = self.contact(model, shear, ray, i, &RayQuery::from_surface(t1, skip), &|_| width)?;
            Some(Contact { alpha: scaled_alpha(contact.alpha, opacity_scale), ..contact })
        };
        through(&self.blocks, ray, t1, each).0
    }

    /// The same, where cards that lie one after the other have their alpha in the ray itself, and not over its width.
    pub fn transmittance_of_overlapping(
        &self,
        model: &Model,
        ray: &Ray,
        t1: f64,
        skip: Option<u32>,
        width: f64,
    ) -> f32 {
        let each = |width: f64| {
            through(&self.blocks, ray, t1, |i, shear, t1| {
                self.contact(model, shear, ray, i, &RayQuery::from_surface(t1, skip), &|_| width)
            })
        };
        let (found, met) = each(width);
        if met > 1 && found > 0.0 { each(0.0).0 } else { found }
    }

    fn contact(
        &self,
        model: &Model,
        shear: &Shear,
        ray: &Ray,
        index: u32,
        query: &RayQuery,
        width_at: &impl Fn(f64) -> f64,
    ) -> Option<Contact> {
        if query.skip == Some(index) {
            return None;
        }
        let triangle = &self.triangles[index as usize];
        let [a, b, c] = self.corners(triangle);
        let corners = [a - ray.origin, b - ray.origin, c - ray.origin];
        let (t, b) = shear.meet(corners)?;
        if !(t > query.from && t < query.to) {
            return None;
        }
        let mut contact = Contact { t, triangle: index, b, alpha: 1.0 };
        let instance = &model.instances[triangle.instance as usize];
        let part = &model.parts[instance.part];
        let material = &model.materials[part.material];
        if query.is_camera && !material.double_sided && !is_front(&corners, ray.dir, &instance.transform) {
            return None;
        }
        if material.alpha != Alpha::Opaque {
            if !shear.is_within(corners) {
                return None;
            }
            let cosine = facing(&corners, ray.dir);
            contact.alpha = self.share(part, material, triangle, &contact, width_at(t) / cosine);
        }
        (contact.alpha > 0.0).then_some(contact)
    }

    /// The share of `width` of the surface around a contact that is there.
    fn share(&self, part: &Part, material: &Material, triangle: &Triangle, at: &Contact, width: f64) -> f32 {
        let lookup = self.lookup(part, material, triangle, at, width);
        let (Alpha::Mask(_), Some(lookup)) = (material.alpha, lookup) else {
            return material.alpha.share(self.color(part, material, triangle, at, width)[3]);
        };
        self.masks.share(material, part.material, &lookup)
    }

    /// Place of a contact in its material's texture; `None` without one, or without coordinates for it.
    fn lookup<'a>(
        &self,
        part: &Part,
        material: &'a Material,
        triangle: &Triangle,
        at: &Contact,
        width: f64,
    ) -> Option<Lookup<'a>> {
        let reference = material.texture.as_ref()?;
        let texture = &*reference.texture;
        let uvs = part.uvs.get(reference.tex_coord)?;
        let uv = |i: u32| uvs.get(i as usize).copied().unwrap_or_default().map(f64::from);
        let corners = self.at_corners(part, triangle, |i| DVec4::new(uv(i)[0], uv(i)[1], 0.0, 0.0))?;
        let corners = each3(corners, |c| reference.map([c.x as f32, c.y as f32]));
        let [a, b, c] = corners;
        let weights = at.weights();
        let uv = [0, 1].map(|k| weights[0] * a[k] + weights[1] * b[k] + weights[2] * c[k]);
        let corner_alphas = self.corner_alphas(part, triangle);
        let own_alpha = weights.iter().zip(corner_alphas).map(|(w, alpha)| w * alpha).sum();
        // Texels across the width, by how fast u and v change on the surface: the gradient of a linear function whose differences
        // along the edges e and f are d has the square (d₀² f·f − 2 d₀ d₁ e·f + d₁² e·e) / |e × f|².
        let [p, q, r] = self.corners(triangle);
        let (e, f) = (q - p, r - p);
        let (ee, ef, ff, area) = (e.dot(e), e.dot(f), f.dot(f), e.cross(f).length_squared());
        let widths = [(0, texture.width), (1, texture.height)].map(|(k, size)| {
            let d = [f64::from(b[k] - a[k]), f64::from(c[k] - a[k])];
            let square = (d[0] * d[0] * ff - 2.0 * d[0] * d[1] * ef + d[1] * d[1] * ee) / area;
            if area > 0.0 { (width * f64::from(size) * square.max(0.0).sqrt()) as f32 } else { 0.0 }
        });
        Some(Lookup { texture, uv, corners, widths, corner_alphas, own_alpha })
    }

    /// Alpha of the vertices' own colours at a triangle's corners.
    fn corner_alphas(&self, part: &Part, triangle: &Triangle) -> [f32; 3] {
        let Some(colors) = &part.colors else { return [1.0; 3] };
        let alpha = |i: u32| DVec4::splat(f64::from(colors.get(i as usize).map_or(1.0, |c| c[3])));
        self.at_corners(part, triangle, alpha).map_or([0.0; 3], |corners| each3(corners, |c| c.x as f32))
    }

    /// Linear RGBA at a contact, over `width` of the surface.
    fn color(&self, part: &Part, material: &Material, triangle: &Triangle, at: &Contact, width: f64) -> [f32; 4] {
        let weights = at.weights();
        let mut rgba = material.base_color;
        if let Some(colors) = &part.colors {
            let color = |i: u32| colors.get(i as usize).map_or(DVec4::ONE, |c| DVec4::from_array(c.map(f64::from)));
            let Some(corners) = self.at_corners(part, triangle, color) else { return [0.0; 4] };
            for k in 0..4 {
                let mixed: f32 = (0..3).map(|i| weights[i] * corners[i][k] as f32).sum();
                rgba[k] *= mixed;
            }
        }
        if let Some(lookup) = self.lookup(part, material, triangle, at, width) {
            let sampled = lookup.texture.average(lookup.uv, lookup.footprint());
            rgba.iter_mut().zip(sampled).for_each(|(c, s)| *c *= s);
        }
        rgba
    }

    /// Surface as it is seen at a contact of `ray`, whose cone is `width` wide there.
    pub fn surface(&self, model: &Model, ray: &Ray, contact: &Contact, width: f64) -> Surface {
        let triangle = &self.triangles[contact.triangle as usize];
        let part = &model.parts[model.instances[triangle.instance as usize].part];
        let material = &model.materials[part.material];
        let Place { point, lifted, normal } = self.place(model, ray, contact);
        let cosine = facing(&self.corners(triangle), ray.dir);
        let [r, g, b, _] = self.color(part, material, triangle, contact, width / cosine);
        let (albedo, transmission) = self.reflected(part, material, triangle, contact, (width / cosine, [r, g, b]));
        let Finish { ambient, .. } = material.finish;
        Surface {
            point,
            lifted,
            normal,
            albedo,
            transmission,
            ambient: Vec3::from_array(each3(ambient, |v| v as f32)),
            gloss: material.finish.has_gloss().then(|| material.finish.gloss()),
            emission: self.emitted(part, material, triangle, contact, width / cosine),
            unlit: material.unlit,
        }
    }

    /// Where a contact of `ray` is.
    pub fn place(&self, model: &Model, ray: &Ray, contact: &Contact) -> Place {
        let triangle = &self.triangles[contact.triangle as usize];
        let instance = &model.instances[triangle.instance as usize];
        let part = &model.parts[instance.part];
        let corners = self.corners(triangle);
        let weights = [1.0 - contact.b[0] - contact.b[1], contact.b[0], contact.b[1]];
        let mix = |[a, b, c]: [DVec3; 3]| weights[0] * a + weights[1] * b + weights[2] * c;
        let point = mix(corners);
        let flat = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or(-ray.dir);
        let (mut normal, mut lifted) = (flat, point);
        let given = part.normals.as_ref().and_then(|normals| {
            let of = |i: u32| normals.get(i as usize).map_or(DVec3::ZERO, |n| DVec3::from_array(n.map(f64::from)));
            self.at_corners(part, triangle, |i| of(i).extend(0.0))
        });
        if let Some(given) = given {
            let turn = cofactor(instance.transform.matrix3);
            let at = each3(given, |n| (turn * n.truncate()).try_normalize().unwrap_or(flat));
            normal = mix(at).try_normalize().unwrap_or(flat);
            let side = if normal.dot(ray.dir) > 0.0 { -1.0 } else { 1.0 };
            let lift = |i: usize| {
                let n = side * at[i];
                point - (point - corners[i]).dot(n).min(0.0) * n
            };
            lifted = mix(each3([0, 1, 2], lift));
        }
        if normal.dot(ray.dir) > 0.0 {
            normal = -normal;
        }
        Place { point, lifted, normal }
    }
}

/// The alpha of a facet whose layer's rates are multiplied by `scale`. Below 1, that share of the facets is there, which
/// multiplies the rate of hits exactly; above, the optical depth is multiplied, of which an opaque facet has enough.
fn scaled_alpha(alpha: f32, scale: f32) -> f32 {
    if scale <= 1.0 { alpha * scale } else { 1.0 - (1.0 - alpha).powf(scale) }
}

/// The share of light that comes through along `ray` up to t1, where `contact` tells what it meets of an item, and how much
/// of what it met lets light through.
fn through(blocks: &Blocks, ray: &Ray, t1: f64, contact: impl Fn(u32, &Shear, f64) -> Option<Contact>) -> (f32, u32) {
    let (mut through, mut met) = (1.0, 0);
    let shear = Shear::new(ray.dir);
    let is_open = blocks.all(ray, &shear, t1, |i| {
        let Some(contact) = contact(i, &shear, t1) else { return true };
        through *= 1.0 - contact.alpha;
        met += 1;
        through > 0.0
    });
    (if is_open { through } else { 0.0 }, met)
}

/// Whether a ray along `dir` comes to the front of a triangle, around which its corners run counter-clockwise; `to_space` is the
/// map by which they came into the ray's space, and mirrored maps turn that around.
fn is_front([a, b, c]: &[DVec3; 3], dir: DVec3, to_space: &DAffine3) -> bool {
    ((b - a).cross(c - a).dot(dir) < 0.0) != (to_space.matrix3.determinant() < 0.0)
}

/// Cosine between a ray and a triangle's normal, at least .05: how much wider a cone is on the surface.
fn facing(corners: &[DVec3; 3], dir: DVec3) -> f64 {
    let n = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
    n.dot(dir).abs().max(0.05)
}

/// Matrix by which normals transform: the cofactors, for outward normals of mirrored parts too.
pub fn cofactor(m: DMat3) -> DMat3 {
    let c = DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
    if m.determinant() < 0.0 { c * -1.0 } else { c }
}
