//! Shading of the voxels that a march hits. Ambient light is reflected at once; the light of punctual lights is gathered in groups of
//! voxels that share one shadow ray.

use smallvec::SmallVec;

use crate::geom::{Mat3, Vec3, each3};
use crate::simd::multiversioned;
use crate::volume::brightness::BrightnessFactors;
use crate::volume::octree::VoxelAddress;
use crate::volume::voxel::voxel_edge;
use crate::volume::{Gloss, Octree, Sggx, Voxel};

use super::specular::SeenFacets;
use super::transmittance::{Sink, VoxelHit};
use super::vndf::{EQUAL, visible_normals};

/// Share of the ray's light at which a group of voxels is closed and gets its shadow ray.
pub const GROUP_WEIGHT: f32 = 0.2;
/// Largest distance of a voxel from the mean position of its group, in voxels.
pub const MAX_FROM_MEAN: f32 = 2.0;

/// A group of voxels that one light shines on and that share one shadow ray. The radiance that they reflect is `energy` times the
/// light's irradiance / π times the visibility that the shadow ray finds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShadowGroup {
    /// Index into the lights that [`Shader::new`] was given.
    pub light: usize,
    /// Sum of weight · (E[max(0, n·l)] + E[max(0, −n·l)]): the share of the ray's light that the group stands for.
    pub weight: f32,
    /// Weighted mean of the ray's parameter.
    pub t: f32,
    /// Weighted mean of the position, texel space: the origin of the shadow ray.
    pub position: Vec3,
    /// Weighted mean edge of the voxels, cube edges.
    pub voxel: f32,
    /// Weighted mean of one-sidedness · mean normal, in the space of the lights: near unit length for the flat surface of a solid, 0 for
    /// matter without an outside.
    pub outside: Vec3,
    /// Sum of weight · (albedo · E[max(0, n·l)] + transmission · E[max(0, −n·l)] + highlights), linear.
    pub energy: Vec3,
}

impl ShadowGroup {
    /// Offset from the group's position to the start of its shadow ray, in cube edges, in the space of `towards`, the unit direction to
    /// the light. It leads a little towards the light (see [`shadow_start`]), and out of the voxels of a wall, which would otherwise
    /// shade itself where the light grazes it. `facet_size`: [`crate::volume::Info::facet_size`].
    pub fn start(&self, facet_size: f32, towards: Vec3) -> Vec3 {
        shadow_start(facet_size, self.voxel) * towards + self.voxel * self.outside
    }
}

/// Weighted sums over the voxels of one light that are not in a closed group yet.
#[derive(Clone, Copy, Default)]
struct OpenGroup {
    weight: f32,
    t: f32,
    position: Vec3,
    voxel: f32,
    outside: Vec3,
    energy: Vec3,
}

impl OpenGroup {
    /// Squared distance of `position` from the mean, cube edges squared; 0 as long as the group is empty.
    fn distance_squared_from_mean(&self, position: Vec3) -> f32 {
        if self.weight > 0.0 { (self.position / self.weight).distance_squared(position) } else { 0.0 }
    }
}

/// A voxel at the surface of a solid, and where the ray met it.
#[derive(Clone, Copy)]
struct SolidSurface {
    voxel: Voxel,
    address: VoxelAddress,
    t: f32,
    position: Vec3,
}

/// How a landscape modifies the material of a texel's surfaces, at one point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// Multiplies albedo and transmission.
    pub diffuse: Vec3,
    /// Multiplies the reflected ambient light.
    pub ambient: Vec3,
    /// Highlights of materials that have none of their own.
    pub gloss: Gloss,
    /// Factors of the strength and of the shininess of materials that have their own highlights.
    pub own_gloss: (Vec3, f32),
}

impl Look {
    /// The texel's own material, with its colours multiplied by `tint`.
    pub fn tinted(tint: Vec3) -> Look {
        Look { diffuse: tint, ambient: Vec3::ONE, gloss: Gloss::NONE, own_gloss: (Vec3::ONE, 1.0) }
    }
}

/// Largest distance between a voxel inside a solid and the surface voxel as which it is shaded, in voxels.
const SURFACE_SEEN_WITHIN: f32 = 3.0;

/// The sink that shades voxels. All directions are in the shading space: texel space or, with a `warp`, the space to which that takes
/// normals.
pub struct Shader<'a> {
    view: Vec3,
    lights: &'a [Vec3],
    warp: Option<Mat3>,
    /// The modifiers of the voxels that come next.
    pub look: Look,
    brightness: &'a [BrightnessFactors],
    /// The texel, if its voxels have transmission, unlit colour or highlights besides their albedo.
    surfaces: Option<&'a Octree>,
    /// The last voxel that was hit at the surface of a solid. Light that passes it and ends inside the solid is shaded as this voxel.
    solid: Option<SolidSurface>,
    /// One open group per light; empty until the first voxel.
    open: SmallVec<[OpenGroup; 1]>,
    groups: &'a mut Vec<ShadowGroup>,
    /// Sum of weight · albedo · ambient factor over lit matter. Times the radiance of a constant sky it is the reflected ambient light.
    pub albedo: Vec3,
    /// Sum of weight · transmission · ambient factor. Times the radiance of a constant sky it is the transmitted ambient light.
    pub transmission: Vec3,
    /// Sum of weight · albedo over unlit matter, which shows its colour whatever the light.
    pub unlit: Vec3,
    /// Sum of weights: the coverage.
    pub weight: f32,
    /// If set, it accumulates the visible normals of all voxels.
    pub normals: Option<VisibleNormals>,
}

/// Sums of the moments of visible normals over voxels, weighted by the largest channel that they reflect or transmit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct VisibleNormals {
    /// Sum of the weights, 0 to 1.
    pub weight: f32,
    /// Sum of weight · mean normal, in the space of the lights.
    pub mean: Vec3,
    /// Sum of weight · second moments of the normals: xx, yy, zz, xy, yz, zx.
    pub square: [f32; 6],
}

impl VisibleNormals {
    fn add(&mut self, weight: f32, (mean, square): (Vec3, [f32; 6])) {
        self.weight += weight;
        self.mean += weight * mean;
        for (sum, v) in self.square.iter_mut().zip(square) {
            *sum += weight * v;
        }
    }

    /// Mean and second moments of the normals; those of normals in all directions if no voxel was hit.
    pub fn means(&self) -> (Vec3, [f32; 6]) {
        if self.weight > 0.0 {
            (self.mean / self.weight, self.square.map(|v| v / self.weight))
        } else {
            (Vec3::ZERO, [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, 0.0, 0.0, 0.0])
        }
    }
}

impl<'a> Shader<'a> {
    /// A shader for one ray.
    ///
    /// `view` is the unit direction from the matter to the viewer, `lights` the unit directions from the matter to each light. `tint`
    /// multiplies albedos. `brightness` holds the factors of the lights by depth; depths beyond its end have plain factors. Finished
    /// groups are appended to `groups`. `warp` is the cofactor matrix of the map from texel space to the space of `view` and `lights`;
    /// `None` where that map is a similarity and both were brought to texel space.
    pub fn new(
        view: Vec3,
        lights: &'a [Vec3],
        warp: Option<Mat3>,
        tint: Vec3,
        brightness: &'a [BrightnessFactors],
        groups: &'a mut Vec<ShadowGroup>,
    ) -> Self {
        Shader {
            view,
            lights,
            warp,
            look: Look::tinted(tint),
            brightness,
            surfaces: None,
            solid: None,
            open: SmallVec::new(),
            groups,
            albedo: Vec3::ZERO,
            transmission: Vec3::ZERO,
            unlit: Vec3::ZERO,
            weight: 0.0,
            normals: None,
        }
    }

    /// Read transmission, unlit colour and highlights of the voxels from their texel, if it has them.
    pub fn with_surfaces_of(mut self, tree: &'a Octree) -> Self {
        self.surfaces = tree.has_surfaces().then_some(tree);
        self
    }

    /// Close every group. To be called where the ray leaves the copy.
    pub fn finish(&mut self) {
        for light in 0..self.open.len() {
            self.close(light);
        }
    }

    fn close(&mut self, light: usize) {
        let Some(open) = self.open.get_mut(light) else { return };
        if open.weight > 0.0 {
            let inverse = 1.0 / open.weight;
            let (t, position, voxel) = (open.t * inverse, open.position * inverse, open.voxel * inverse);
            let outside = open.outside * inverse;
            let OpenGroup { weight, energy, .. } = *open;
            self.groups.push(ShadowGroup { light, weight, t, position, voxel, outside, energy });
        }
        *open = OpenGroup::default();
    }
}

multiversioned! {
    fn shade(shader: &mut Shader<'_>, hit: &VoxelHit<'_>) = shade_inline;
}

#[inline(always)]
fn shade_inline(shader: &mut Shader<'_>, hit: &VoxelHit<'_>) {
    shader.add(hit);
}

impl Sink for Shader<'_> {
    fn voxel(&mut self, hit: &VoxelHit<'_>) {
        shade(self, hit);
    }
}

impl Shader<'_> {
    #[inline(always)]
    fn add(&mut self, hit: &VoxelHit<'_>) {
        let voxel = hit.voxel;
        let edge = voxel_edge(hit.depth);
        let address = VoxelAddress { depth: hit.depth, rank: hit.rank };
        let mut seen = SolidSurface { voxel: *voxel, address, t: hit.t, position: hit.position };
        if voxel.is_inside()
            && let Some(solid) = &self.solid
            && solid.position.distance_squared(hit.position) <= (SURFACE_SEEN_WITHIN * edge).powi(2)
        {
            seen = *solid;
        }
        let share = seen.voxel.one_sidedness();
        if share > 0.0 {
            self.solid = Some(seen);
        }
        let SolidSurface { voxel, address, t, position } = seen;
        let Look { diffuse, mut ambient, gloss, .. } = self.look;
        let mut albedo = voxel.albedo() * diffuse * hit.weight;
        let mut transmission = Vec3::ZERO;
        let mut glosses = [Gloss { specular: gloss.specular * hit.weight, ..gloss }, Gloss::NONE];
        if let Some(tree) = self.surfaces {
            let surface = tree.surface(address);
            transmission = surface.transmission() * diffuse * hit.weight;
            let unlit = surface.unlit() * albedo;
            albedo -= unlit;
            self.unlit += unlit;
            ambient *= surface.ambient();
            self.transmission += ambient * transmission;
            let (own, factor, lit) = (surface.gloss(), self.look.own_gloss, 1.0 - surface.unlit());
            glosses[0].specular *= lit * surface.without_gloss();
            let specular = own.specular * factor.0 * (lit * hit.weight);
            glosses[1] = Gloss { specular, shininess: own.shininess * factor.1 };
        }
        self.albedo += ambient * albedo;
        self.weight += hit.weight;
        if self.lights.is_empty() && self.normals.is_none() {
            return;
        }
        if self.open.is_empty() {
            self.open.resize(self.lights.len(), OpenGroup::default());
        }
        let decoded = Sggx::decode(voxel.ndf);
        let s = self.warp.map_or(decoded, |j| warped(&decoded, j));
        let normals = visible_normals(&s, self.view);
        let (weights, mean) = if share > 0.0 {
            let mean = mean_normal(&voxel, self.warp);
            (normals.one_sided(mean, share), mean)
        } else {
            (EQUAL, Vec3::ZERO)
        };
        // The NDF is fitted to opacity. Where the facets have one common normal, the mean normal is the more exact description.
        let flat = share.powi(4);
        if let Some(sums) = &mut self.normals {
            let (middle, square) = normals.moments(&weights);
            let one =
                [mean.x * mean.x, mean.y * mean.y, mean.z * mean.z, mean.x * mean.y, mean.y * mean.z, mean.z * mean.x];
            let square = std::array::from_fn(|k| square[k] + flat * (one[k] - square[k]));
            sums.add(albedo.max_element().max(transmission.max_element()), (middle.lerp(mean, flat), square));
        }
        let view = self.view;
        let facets =
            || SeenFacets { ndf: &s, normals: &normals, weights: &weights, mean, one_sidedness: share, flat, view };
        let translucent = transmission != Vec3::ZERO;
        let factors = self.brightness.get(usize::from(hit.depth)).unwrap_or(&BrightnessFactors::PLAIN);
        for light in 0..self.lights.len() {
            let towards = self.lights[light];
            let all = normals.diffuse(&weights, towards);
            let factor = factors.at_cosine(self.view.dot(towards));
            let cosine = (all + flat * (mean.dot(towards).max(0.0) - all)) * factor;
            let mut behind = 0.0;
            if translucent {
                let all = normals.diffuse(&weights, -towards);
                behind = (all + flat * ((-mean.dot(towards)).max(0.0) - all)) * factor;
            }
            let lit = hit.weight * (cosine + behind);
            if lit <= 0.0 {
                continue;
            }
            // The mean of positions far apart would be a point where there is no matter.
            let gap = self.open[light].distance_squared_from_mean(position);
            if gap > (MAX_FROM_MEAN * edge).powi(2) {
                self.close(light);
            }
            let open = &mut self.open[light];
            open.weight += lit;
            open.t += lit * t;
            open.position += lit * position;
            open.voxel += lit * edge;
            open.outside += hit.weight * (cosine - behind) * share * mean;
            open.energy += albedo * cosine + transmission * behind;
            for gloss in glosses.iter().filter(|g| !g.is_none()) {
                open.energy += gloss.specular * (factor * facets().highlight(gloss, towards));
            }
            if open.weight >= GROUP_WEIGHT {
                self.close(light);
            }
        }
    }
}

fn mean_normal(voxel: &Voxel, warp: Option<Mat3>) -> Vec3 {
    let n = voxel.mean_normal();
    warp.map_or(n, |j| (j * n).try_normalize().unwrap_or(n))
}

/// J S J^T: the SGGX matrix of the normals after the map whose cofactor matrix is `j`.
pub fn warped(s: &Sggx, j: Mat3) -> Sggx {
    let rows = [j.row(0), j.row(1), j.row(2)];
    let [a, b, c] = each3(rows, |r| s.mul(r));
    Sggx {
        xx: rows[0].dot(a),
        yy: rows[1].dot(b),
        zz: rows[2].dot(c),
        xy: rows[0].dot(b),
        xz: rows[0].dot(c),
        yz: rows[1].dot(c),
    }
}

/// Start of a shadow ray in facet sizes, see [`shadow_start`].
const SHADOW_START: f32 = 0.4;

/// Distance from matter at which a shadow ray begins, in cube edges, so that a strand does not shade itself.
///
/// It is less than half a facet, since beyond that the facet's own neighbours would be missed, and at most a voxel's edge `voxel`. Flat
/// matter of the start's own block is taken into account by the correlation c instead (see
/// [`super::transmittance::transmittance_from_own_matter`]). FLIP of one lane with starts at a quarter, .4 and a half of a facet: a tree
/// .0396, –, .0409; clumps .0474, –, .0485; fur .142, –, .111; near .0405, –, .0414. `facet_size`: [`crate::volume::Info::facet_size`]
/// in cube edges; 0 where it is unknown.
pub fn shadow_start(facet_size: f32, voxel: f32) -> f32 {
    if facet_size > 0.0 { voxel.min(SHADOW_START * facet_size) } else { voxel }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::voxel::RATE_MAX;

    fn hit(voxel: &Voxel, weight: f32, t: f32) -> VoxelHit<'_> {
        VoxelHit { t, weight, depth: 3, voxel, rank: 0, position: Vec3::splat(t) }
    }

    #[test]
    fn white_furnace_gives_the_coverage() {
        let voxel = Voxel::default();
        let mut groups = Vec::new();
        let mut shader = Shader::new(Vec3::Z, &[], None, Vec3::ONE, &[], &mut groups);
        for i in 0..5 {
            shader.voxel(&hit(&voxel, 0.15, i as f32));
        }
        // Albedo 1 under a sky of radiance 1 reflects exactly what it covers.
        assert_eq!(shader.albedo, Vec3::splat(shader.weight));
        assert!((shader.weight - 0.75).abs() < 1e-6);
    }

    #[test]
    fn groups_hold_all_the_light_once() {
        let voxel = Voxel::default();
        let mut groups = Vec::new();
        let lights = [Vec3::Z, -Vec3::Z];
        let mut shader = Shader::new(Vec3::Z, &lights, None, Vec3::ONE, &[], &mut groups);
        for i in 0..10 {
            shader.voxel(&hit(&voxel, 0.1, 0.01 * i as f32));
        }
        shader.finish();
        let front: f32 = groups.iter().filter(|g| g.light == 0).map(|g| g.energy.x).sum();
        // Isotropic facets lit from the viewer: 2/3 of Lambert, by the cubature to .01.
        assert!((front - 2.0 / 3.0).abs() < 0.01, "{front}");
        assert!(groups.iter().all(|g| g.light == 0), "nothing reflects from behind");
        // Each voxel adds .0667: three reach .2, the tenth is what finish() closes.
        assert!((3..=4).contains(&groups.len()), "{groups:?}");
        assert!(groups.windows(2).all(|g| g[0].t < g[1].t));
        assert!((groups[0].voxel - 0.125).abs() < 1e-6);
    }

    /// A texel of one voxel, of one material that reflects and transmits.
    fn translucent(voxel: Voxel, transmission: f64, unlit: f64) -> Octree {
        use crate::volume::surface::{SurfaceParams, store};
        use crate::volume::{Depth, Info, Material, Volume};
        let albedo = voxel.albedo().to_array().map(f64::from);
        let materials = vec![Material { name: "leaf".into(), albedo, share: 1.0 }];
        let mut info = Info { materials, ..Info::default() };
        store(&[SurfaceParams { transmission: [transmission; 3], unlit, ..SurfaceParams::default() }], &mut info.meta);
        let depth = Depth { masks: vec![0], voxels: vec![voxel], mixes: Vec::new() };
        Octree::new(Volume { info, depths: vec![depth] }).unwrap()
    }

    #[test]
    fn light_from_behind_comes_through() {
        let mut voxel = Voxel { rate: RATE_MAX, ..Voxel::default() };
        voxel.set_albedo([0.25; 3]);
        let reflected = voxel.albedo().x;
        let tree = translucent(voxel, 0.5, 0.0);
        let at = |voxel, t| VoxelHit { depth: 0, ..hit(voxel, 1.0, t) };
        let lights = [Vec3::Z, -Vec3::Z, Vec3::X];
        let mut groups = Vec::new();
        let mut shader = Shader::new(Vec3::Z, &lights, None, Vec3::ONE, &[], &mut groups).with_surfaces_of(&tree);
        shader.voxel(&at(&voxel, 0.0));
        shader.finish();
        // Reflected and transmitted, the sky loses what is absorbed; a step of the code at .5 is 2 · sqrt(.5) / 255.
        assert!((shader.albedo + shader.transmission - (reflected + 0.5)).abs().max_element() < 0.003);
        let light = |k: usize| groups.iter().filter(|g| g.light == k).map(|g| g.energy.x).sum::<f32>();
        // Isotropic facets: 2/3 of Lambert's cosine from the viewer's side and from behind it, 1/(3π) · 2 at right angles from
        // each side, by the cubature to .01.
        assert!((light(0) - reflected * 2.0 / 3.0).abs() < 0.01, "{}", light(0));
        assert!((light(1) - 0.5 * 2.0 / 3.0).abs() < 0.01, "{}", light(1));
        let side = 2.0 / (3.0 * std::f32::consts::PI);
        assert!((light(2) - (reflected + 0.5) * side).abs() < 0.02, "{}", light(2));
    }

    #[test]
    fn what_comes_through_a_wall_is_shaded_from_behind_it() {
        let mut voxel = Voxel { rate: RATE_MAX, ..Voxel::default() };
        voxel.set_mean_normal([0.0, 0.0, 1.0], 1.0);
        voxel.set_albedo([0.25; 3]);
        let tree = translucent(voxel, 0.5, 0.0);
        let lights = [-Vec3::Z];
        let mut groups = Vec::new();
        let mut shader = Shader::new(Vec3::Z, &lights, None, Vec3::ONE, &[], &mut groups).with_surfaces_of(&tree);
        shader.voxel(&VoxelHit { depth: 0, ..hit(&voxel, 1.0, 0.0) });
        shader.finish();
        // The wall's own normal, to the step of its code.
        assert!((groups[0].energy.x - 0.5).abs() < 0.005 && groups[0].outside.z < -0.99, "{groups:?}");
    }

    #[test]
    fn what_is_unlit_shows_its_colour() {
        let mut voxel = Voxel { rate: RATE_MAX, ..Voxel::default() };
        voxel.set_albedo([0.25; 3]);
        let tree = translucent(voxel, 0.0, 1.0);
        let lights = [Vec3::Z];
        let mut groups = Vec::new();
        let mut shader = Shader::new(Vec3::Z, &lights, None, Vec3::ONE, &[], &mut groups).with_surfaces_of(&tree);
        shader.voxel(&VoxelHit { depth: 0, ..hit(&voxel, 0.5, 0.0) });
        shader.finish();
        assert_eq!((shader.albedo, shader.unlit), (Vec3::ZERO, 0.5 * voxel.albedo()));
        assert!(groups.iter().all(|g| g.energy == Vec3::ZERO), "{groups:?}");
    }

    #[test]
    fn what_is_far_apart_has_shadow_rays_of_its_own() {
        let voxel = Voxel::default();
        let mut groups = Vec::new();
        let light = [Vec3::Z];
        let mut shader = Shader::new(Vec3::Z, &light, None, Vec3::ONE, &[], &mut groups);
        // Voxels are 1/8 wide: two next to each other, and one half a cube behind.
        for t in [0.0, 0.05, 0.55] {
            shader.voxel(&hit(&voxel, 0.05, t));
        }
        shader.finish();
        let places: Vec<f32> = groups.iter().map(|g| g.t).collect();
        assert_eq!(places.len(), 2, "{places:?}");
        assert!((places[0] - 0.025).abs() < 1e-6 && (places[1] - 0.55).abs() < 1e-6, "{places:?}");
    }

    #[test]
    fn what_comes_through_a_solids_surface_is_seen_of_it() {
        let mut surface = Voxel::default();
        surface.set_mean_normal([0.0, 0.0, 1.0], 1.0);
        surface.set_albedo([0.25; 3]);
        let inside = Voxel { rate: RATE_MAX, ..Voxel::default() };
        let albedo = surface.albedo().x;
        // Depth 3: a voxel is 1/8 wide, and t is the place along all axes.
        let lit = |behind: f32| {
            let mut groups = Vec::new();
            let light = [Vec3::Z];
            let mut shader = Shader::new(Vec3::Z, &light, None, Vec3::ONE, &[], &mut groups);
            shader.voxel(&hit(&surface, 0.5, 0.0));
            shader.voxel(&hit(&inside, 0.5, behind));
            shader.finish();
            let outside = groups[0].start(0.0, Vec3::X);
            // A voxel towards the light, and one out of the wall.
            assert!((outside - Vec3::new(0.125, 0.0, 0.125)).length() < 1e-3, "{outside}");
            groups.iter().map(|g| g.energy.x).sum::<f32>()
        };
        // Lambert's law with the surface's own normal and colour, to the step of the normal's code.
        assert!((lit(0.15) / albedo - 1.0).abs() < 1e-3, "{}", lit(0.15));
        // Elsewhere the inside has normals in all directions: 2/3.
        assert!((lit(0.5) - (0.5 * albedo + 0.5 * 2.0 / 3.0)).abs() < 0.01, "{}", lit(0.5));
    }

    #[test]
    fn a_warp_turns_normals_as_cofactors_do() {
        // A facet with normal x, squeezed by 1/2 along x: its area and normal stay, those of z facets halve.
        let j = glam::Mat3::from_diagonal(Vec3::new(1.0, 0.5, 0.5));
        let s = warped(&Sggx { xx: 1.0, yy: 0.0, zz: 1.0, xy: 0.0, xz: 0.0, yz: 0.0 }, j);
        assert_eq!((s.xx, s.zz), (1.0, 0.25));
    }

    #[test]
    fn shadow_starts_within_half_a_facet() {
        assert_eq!(shadow_start(0.0, 0.5), 0.5);
        assert!((shadow_start(0.1, 0.5) - 0.04).abs() < 1e-7);
        assert_eq!(shadow_start(2.5, 0.5), 0.5);
    }
}
