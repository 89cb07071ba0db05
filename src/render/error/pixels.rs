//! Pixels of one direction, depth and size, by rays through the texel and through the truth.

use super::options::{Options, SUN};
use super::truth::{Layer, Truth};
use crate::geom::{Aabb, DVec3, Ray, Vec3};
use crate::march::shade::{Shader, ShadowGroup};
use crate::march::transmittance::{
    DepthChoice, MarchSegment, MarchStats, Sink, VoxelHit, march, transmittance, transmittance_from_own_matter,
};
use crate::render::reference::sampling::{hash, point};
use crate::volume::{Octree, Voxel};

/// Texel and source that are compared.
pub struct Batch<'a> {
    pub tree: &'a Octree,
    pub truth: &'a Truth<'a>,
    pub options: &'a Options,
    pub depth: usize,
    /// Width of a pixel in voxels of `depth`.
    pub voxels: f64,
    /// Whether colour, shading and shadow are measured, besides opacity.
    pub shaded: bool,
    /// Unit, the way that the rays go.
    pub direction: DVec3,
}

/// Means over a pixel's rays, of one side. All but `opacity` are over the first rays, which are shaded.
#[derive(Debug, Clone, Copy, Default)]
pub struct Side {
    pub opacity: f64,
    pub cover: f64,
    /// Times the coverage, as are the next.
    pub albedo: [f64; 3],
    /// Mean of max(0, n·l), and what of it is not in shadow.
    pub lit: f64,
    pub open: f64,
    /// As `open`, with the factor of light that the texel gives the depth.
    pub light: f64,
}

/// A pixel, measured.
#[derive(Debug, Clone, Copy)]
pub struct Pixel {
    pub texel: Side,
    pub truth: Side,
    /// Opacity by one ray through the texel, at the middle.
    pub one_ray: f64,
    /// Half the difference between the errors by each half of the rays.
    pub noise: f64,
    pub rays: u32,
}

/// A pixel that is being measured.
struct Open {
    middle: [f64; 2],
    seed: u32,
    texel: Side,
    truth: Side,
    /// Sums of what comes through by either half of the rays: texel, truth.
    halves: [[f64; 2]; 2],
    rays: u32,
}

/// Places tried for a pixel that is not background.
const TRIES: u32 = 24;
/// A texel that lets more through is not there.
const CLEAR: f64 = 0.999;

impl Batch<'_> {
    /// Pixels that are not background; `number` tells this direction from others.
    pub fn measure(&self, number: u32) -> Vec<Pixel> {
        let seed = hash(self.options.seed ^ hash(number ^ hash(self.depth as u32 ^ hash(self.voxels as u32))));
        let frame = Frame::new(self, seed);
        let mut scratch = Scratch::default();
        let mut open: Vec<Open> = Vec::new();
        for i in 0..self.options.pixels * TRIES {
            if open.len() == self.options.pixels as usize {
                break;
            }
            let mut pixel = Open {
                middle: frame.place(point(i, seed)),
                seed: hash(seed ^ hash(i)),
                texel: Side::default(),
                truth: Side::default(),
                halves: [[0.0; 2]; 2],
                rays: 0,
            };
            self.cast(&frame, &mut pixel, self.options.rays[0], &mut scratch);
            let n = f64::from(pixel.rays);
            if pixel.halves[1].iter().sum::<f64>() < n || pixel.halves[0].iter().sum::<f64>() < CLEAR * n {
                open.push(pixel);
            }
        }
        // All of them as finely, so that which pixels are done does not depend on their error.
        let noise = |open: &[Open]| open.iter().map(Open::noise).sum::<f64>() / open.len().max(1) as f64;
        let mut rays = self.options.rays[0];
        while rays < self.options.rays[1] && noise(&open) > self.options.noise {
            for pixel in &mut open {
                self.cast(&frame, pixel, rays, &mut scratch);
            }
            rays *= 2;
        }
        open.iter().map(|p| self.finish(&frame, p)).collect()
    }

    /// Cast `count` more rays through a pixel; the first ones of it are shaded.
    fn cast(&self, frame: &Frame, pixel: &mut Open, count: u32, scratch: &mut Scratch) {
        let shaded = self.shaded && pixel.rays == 0;
        for index in pixel.rays..pixel.rays + count {
            let half = (index & 1) as usize;
            let [dx, dy] = point(index >> 1, hash(pixel.seed ^ index & 1));
            let ray =
                frame.ray([pixel.middle[0] + frame.pixel * (dx - 0.5), pixel.middle[1] + frame.pixel * (dy - 0.5)]);
            let truth = self.truth.see(&ray, &mut scratch.layers);
            pixel.halves[1][half] += truth;
            pixel.halves[0][half] += if shaded {
                self.truth_shaded(&ray, truth, &scratch.layers, &mut pixel.truth);
                self.texel_shaded(&ray, &mut pixel.texel, scratch)
            } else {
                self.through(&ray)
            };
        }
        if shaded {
            for side in [&mut pixel.texel, &mut pixel.truth] {
                let share = 1.0 / f64::from(count);
                *side = Side {
                    opacity: 0.0,
                    cover: side.cover * share,
                    albedo: side.albedo.map(|v| v * share),
                    lit: side.lit * share,
                    open: side.open * share,
                    light: side.light * share,
                };
            }
        }
        pixel.rays += count;
    }

    fn truth_shaded(&self, ray: &Ray, through: f64, layers: &[Layer], sum: &mut Side) {
        sum.cover += 1.0 - through;
        for layer in layers {
            for (s, a) in sum.albedo.iter_mut().zip(layer.albedo) {
                *s += layer.weight * f64::from(a);
            }
            let lit = layer.weight * layer.lit(ray.dir, SUN);
            if lit > 0.0 {
                sum.lit += lit;
                sum.open += lit * self.truth.open(&Ray { origin: ray.at(layer.t), dir: SUN }, layer.facet);
            }
        }
        sum.light = sum.open;
    }

    /// Shades as pictures are, with white facets for the light; gives what comes through.
    fn texel_shaded(&self, ray: &Ray, sum: &mut Side, scratch: &mut Scratch) -> f64 {
        let Some(stretch) = self.stretch(ray) else { return 1.0 };
        let lights = [SUN.as_vec3()];
        scratch.groups.clear();
        let mut sink = White {
            shader: Shader::new(-ray.dir.as_vec3(), &lights, None, Vec3::ONE, &[], &mut scratch.groups),
            albedo: Vec3::ZERO,
        };
        let mut stats = MarchStats::default();
        let through = march(self.tree, &stretch, DepthChoice::default(), 1.0, &mut sink, &mut stats);
        sink.shader.finish();
        sum.cover += 1.0 - f64::from(through);
        for (s, a) in sum.albedo.iter_mut().zip(sink.albedo.to_array()) {
            *s += f64::from(a);
        }
        let facet = self.tree.info().facet_size as f32;
        let factor = self.tree.brightness_factors()[self.depth].lit((-ray.dir).dot(SUN) as f32);
        for group in &scratch.groups {
            let origin = group.position + group.start(facet, lights[0]);
            let shadow = MarchSegment { origin, dir: lights[0], length: 2.0, ..stretch };
            let open =
                transmittance_from_own_matter(self.tree, &shadow, DepthChoice::default(), 1.0 / 256.0, &mut stats);
            sum.lit += f64::from(group.energy.x);
            sum.open += f64::from(group.energy.x * open);
            sum.light += f64::from(group.energy.x * open * factor);
        }
        through.into()
    }

    fn through(&self, ray: &Ray) -> f64 {
        let mut stats = MarchStats::default();
        self.stretch(ray)
            .map_or(1.0, |s| transmittance(self.tree, &s, DepthChoice::default(), 1.0 / 512.0, &mut stats).into())
    }

    /// The ray's way through the cube, as wide as a voxel of the depth that is measured.
    fn stretch(&self, ray: &Ray) -> Option<MarchSegment> {
        let (t0, t1) = Aabb::UNIT.hit(ray.origin, 1.0 / ray.dir, 0.0, 9.0)?;
        Some(MarchSegment {
            origin: ray.at(t0).as_vec3(),
            dir: ray.dir.as_vec3(),
            length: (t1 - t0) as f32,
            footprint: (-(self.depth as f32)).exp2(),
            growth: 0.0,
            opacity_scale: 1.0,
        })
    }

    fn finish(&self, frame: &Frame, pixel: &Open) -> Pixel {
        let n = f64::from(pixel.rays);
        let [texel, truth] = pixel.halves.map(|h| 1.0 - (h[0] + h[1]) / n);
        Pixel {
            texel: Side { opacity: texel, ..pixel.texel },
            truth: Side { opacity: truth, ..pixel.truth },
            one_ray: 1.0 - self.through(&frame.ray(pixel.middle)),
            noise: pixel.noise(),
            rays: pixel.rays,
        }
    }
}

impl Open {
    fn noise(&self) -> f64 {
        let error = |half: usize| self.halves[0][half] - self.halves[1][half];
        (error(0) - error(1)).abs() / f64::from(self.rays)
    }
}

#[derive(Default)]
struct Scratch {
    layers: Vec<Layer>,
    groups: Vec<ShadowGroup>,
}

/// Shades as if all were white, and keeps the colour apart.
struct White<'a> {
    shader: Shader<'a>,
    albedo: Vec3,
}

impl Sink for White<'_> {
    fn voxel(&mut self, hit: &VoxelHit<'_>) {
        self.albedo += hit.weight * hit.voxel.albedo();
        let voxel = Voxel { albedo: [255; 3], ..*hit.voxel };
        self.shader.voxel(&VoxelHit { voxel: &voxel, ..*hit });
    }
}

/// The plane across a direction, with what of it the texel's content can be seen on.
struct Frame {
    axes: [DVec3; 3],
    /// Width of a pixel, cube edges.
    pixel: f64,
    min: [f64; 2],
    max: [f64; 2],
}

impl Frame {
    fn new(batch: &Batch<'_>, seed: u32) -> Frame {
        let (a, b) = batch.direction.any_orthonormal_pair();
        let (sin, cos) = (std::f64::consts::TAU * f64::from(seed) / 4_294_967_296.0).sin_cos();
        let axes = [cos * a + sin * b, cos * b - sin * a, batch.direction];
        let pixel = batch.voxels * libm::exp2(-(batch.depth as f64));
        let content = batch.tree.info().content.intersection(Aabb::UNIT);
        let (mut min, mut max) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for corner in 0..8 {
            let pick = |k: usize| if corner >> k & 1 == 0 { content.min[k] } else { content.max[k] };
            let p = DVec3::new(pick(0), pick(1), pick(2)) - 0.5;
            for k in 0..2 {
                min[k] = min[k].min(p.dot(axes[k]) - 0.5 * pixel);
                max[k] = max[k].max(p.dot(axes[k]) + 0.5 * pixel);
            }
        }
        Frame { axes, pixel, min, max }
    }

    fn place(&self, at: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| self.min[k] + at[k] * (self.max[k] - self.min[k]))
    }

    fn ray(&self, at: [f64; 2]) -> Ray {
        let [a, b, w] = self.axes;
        Ray { origin: DVec3::splat(0.5) + at[0] * a + at[1] * b - 2.0 * w, dir: w }
    }
}
