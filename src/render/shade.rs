//! Shading of what a march meets: reflected sky at once, and sunlight gathered in groups that share one shadow ray.

use crate::geom::{Mat3, Vec3};
use crate::volume::level::Level;
use crate::volume::{Sggx, Voxel};

use super::march::{Hit, Sink};
use super::vndf::{EQUAL, visible_normals};

/// Weight of a group of voxels that share a shadow ray.
pub const GROUP_WEIGHT: f32 = 0.2;

/// A share of the ray's light that one light shines on: to be multiplied by the light's irradiance / π and what of it arrives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Group {
    /// Index into the lights that [`Shader::new`] was given.
    pub light: usize,
    /// Weighted mean of the ray's parameter, and of the position in texel space: the shadow ray's origin.
    pub t: f32,
    pub position: Vec3,
    /// Weighted mean edge of the voxels, cube edges.
    pub voxel: f32,
    /// Sum of weight · albedo · E[max(0, n·l)], linear.
    pub energy: Vec3,
}

/// Sums of one light's voxels that have no shadow ray yet.
#[derive(Clone, Copy, Default)]
struct Open {
    weight: f32,
    t: f32,
    position: Vec3,
    voxel: f32,
    energy: Vec3,
}

/// The sink that shades. Directions are in the space in which normals are to be taken: texel space, or with a `warp` the
/// space that it leads to.
pub struct Shader<'a> {
    view: Vec3,
    lights: &'a [Vec3],
    warp: Option<Mat3>,
    tint: Vec3,
    levels: &'a [Level],
    /// One a light, from the first voxel on.
    open: Vec<Open>,
    groups: &'a mut Vec<Group>,
    /// Sum of weight · albedo: times the radiance of a constant sky, the ambient light reflected.
    pub albedo: Vec3,
    /// Sum of weights: the coverage.
    pub weight: f32,
}

impl<'a> Shader<'a> {
    /// `view`: unit direction from the matter to the viewer; `lights`: unit directions from the matter to each light;
    /// `tint` multiplies albedos, `levels` the lights by depth (plain where it ends); finished groups are appended to `groups`. `warp`: the cofactor matrix of the map from
    /// texel space to where `view` and `lights` are given; `None` where that map is a similarity that they were brought
    /// through.
    pub fn new(
        view: Vec3,
        lights: &'a [Vec3],
        warp: Option<Mat3>,
        tint: Vec3,
        levels: &'a [Level],
        groups: &'a mut Vec<Group>,
    ) -> Self {
        Shader { view, lights, warp, tint, levels, open: Vec::new(), groups, albedo: Vec3::ZERO, weight: 0.0 }
    }

    /// Close every group; to be called where the ray leaves the instance.
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
            self.groups.push(Group { light, t, position, voxel, energy: open.energy });
        }
        *open = Open::default();
    }
}

impl Sink for Shader<'_> {
    fn voxel(&mut self, hit: &Hit<'_>) {
        let voxel = hit.voxel;
        let albedo = voxel.albedo() * self.tint * hit.weight;
        self.albedo += albedo;
        self.weight += hit.weight;
        if self.lights.is_empty() {
            return;
        }
        if self.open.is_empty() {
            self.open.resize(self.lights.len(), Open::default());
        }
        let decoded = Sggx::decode(voxel.ndf);
        let s = self.warp.map_or(decoded, |j| warped(&decoded, j));
        let normals = visible_normals(&s, self.view);
        let weights = match voxel.one_sidedness() {
            0.0 => EQUAL,
            share => normals.one_sided(mean_normal(voxel, self.warp), share),
        };
        let level = self.levels.get(usize::from(hit.depth)).unwrap_or(&Level::PLAIN);
        for light in 0..self.lights.len() {
            let towards = self.lights[light];
            let cosine = normals.diffuse(&weights, towards) * level.lit(self.view.dot(towards));
            let lit = hit.weight * cosine;
            if lit <= 0.0 {
                continue;
            }
            let open = &mut self.open[light];
            open.weight += lit;
            open.t += lit * hit.t;
            open.position += lit * hit.position;
            open.voxel += lit * (-f32::from(hit.depth)).exp2();
            open.energy += albedo * cosine;
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

/// J S J^T.
pub fn warped(s: &Sggx, j: Mat3) -> Sggx {
    let rows = [j.row(0), j.row(1), j.row(2)];
    let [a, b, c] = rows.map(|r| s.mul(r));
    Sggx {
        xx: rows[0].dot(a),
        yy: rows[1].dot(b),
        zz: rows[2].dot(c),
        xy: rows[0].dot(b),
        xz: rows[0].dot(c),
        yz: rows[1].dot(c),
    }
}

/// How far from the matter that it starts in a shadow ray begins, in cube edges, so that a voxel doesn't shade itself: a
/// quarter of a facet, beyond which the facet's own neighbours are missed, and within the voxel. Chosen with the depth of
/// shadow rays by FLIP against traced geometry, mean of a tree and a spruce from near and far: .0232; from half a facet
/// .0237, a whole .0260, 0 .0241; one depth coarser .0249, .0256, .0274, .0247. `facet_size`:
/// [`crate::volume::Info::facet_size`]; 0 where it is unknown.
pub fn shadow_start(facet_size: f32, voxel: f32) -> f32 {
    if facet_size > 0.0 { voxel.min(0.25 * facet_size) } else { voxel }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hit(voxel: &Voxel, weight: f32, t: f32) -> Hit<'_> {
        Hit { t, weight, depth: 3, voxel, position: Vec3::splat(t) }
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
            shader.voxel(&hit(&voxel, 0.1, i as f32));
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

    #[test]
    fn a_warp_turns_normals_as_cofactors_do() {
        // A facet with normal x, squeezed by 1/2 along x: its area and normal stay, those of z facets halve.
        let j = glam::Mat3::from_diagonal(Vec3::new(1.0, 0.5, 0.5));
        let s = warped(&Sggx { xx: 1.0, yy: 0.0, zz: 1.0, xy: 0.0, xz: 0.0, yz: 0.0 }, j);
        assert_eq!((s.xx, s.zz), (1.0, 0.25));
    }

    #[test]
    fn shadow_starts_within_a_quarter_of_a_facet() {
        assert_eq!(shadow_start(0.0, 0.5), 0.5);
        assert_eq!(shadow_start(0.1, 0.5), 0.025);
        assert_eq!(shadow_start(2.5, 0.5), 0.5);
    }
}
