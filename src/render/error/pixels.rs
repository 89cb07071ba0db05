//! Pixels of one direction, depth and size, by rays through the texel and through the truth.

use super::options::{Options, SUN};
use super::truth::{GroundTruth, TruthHit};
use crate::geom::{Aabb, DVec3, Ray, Vec3};
use crate::march::shade::{Shader, ShadowGroup};
use crate::march::transmittance::{
    DepthChoice, MarchSegment, MarchStats, Sink, VoxelHit, march, transmittance, transmittance_from_own_matter,
};
use crate::render::reference::sampling::{hash, point};
use crate::volume::{Octree, Voxel};

/// One comparison: a texel and its source, along one direction, at one depth and pixel size.
pub struct Batch<'a> {
    pub tree: &'a Octree,
    pub truth: &'a GroundTruth<'a>,
    pub options: &'a Options,
    pub depth: usize,
    /// Width of a pixel in voxels of `depth`.
    pub voxels: f64,
    /// Whether colour, shading and shadow are measured, besides opacity.
    pub shaded: bool,
    /// Unit direction of the rays.
    pub direction: DVec3,
}

/// Means over a pixel's rays, of the texel or of the ground truth. `opacity` is over all rays; the others are over the first rays,
/// which are shaded.
#[derive(Debug, Clone, Copy, Default)]
pub struct PixelMeans {
    pub opacity: f64,
    pub cover: f64,
    /// Albedo times coverage; the following are times coverage, too.
    pub albedo: [f64; 3],
    /// Mean of max(0, n·l), and the part of it that is not in shadow.
    pub lit: f64,
    pub open: f64,
    /// `open` times the brightness factor that the texel has for the depth.
    pub light: f64,
}

/// Result for one pixel.
#[derive(Debug, Clone, Copy)]
pub struct Pixel {
    pub texel: PixelMeans,
    pub truth: PixelMeans,
    /// Opacity by one ray through the texel, at the middle.
    pub one_ray: f64,
    /// Half the difference between the errors of the two halves of the rays.
    pub noise: f64,
    pub rays: u32,
}

/// Running sums of a pixel that is being measured.
struct PixelSums {
    middle: [f64; 2],
    seed: u32,
    texel: PixelMeans,
    truth: PixelMeans,
    /// Sums of the transmittance over either half of the rays: texel, ground truth.
    halves: [[f64; 2]; 2],
    rays: u32,
}

/// Positions that are tried per wanted pixel, since some are background.
const TRIES: u32 = 24;
/// A pixel of which the texel lets through more than this counts as background.
const BACKGROUND_ABOVE: f64 = 0.999;

impl Batch<'_> {
    /// Measure pixels that are not background; `number` is that of the direction.
    pub fn measure(&self, number: u32) -> Vec<Pixel> {
        let seed = hash(self.options.seed ^ hash(number ^ hash(self.depth as u32 ^ hash(self.voxels as u32))));
        let plane = ImagePlane::new(self, seed);
        let mut scratch = Scratch::default();
        let mut open: Vec<PixelSums> = Vec::new();
        for i in 0..self.options.pixels * TRIES {
            if open.len() == self.options.pixels as usize {
                break;
            }
            let mut pixel = PixelSums {
                middle: plane.place(point(i, seed)),
                seed: hash(seed ^ hash(i)),
                texel: PixelMeans::default(),
                truth: PixelMeans::default(),
                halves: [[0.0; 2]; 2],
                rays: 0,
            };
            self.cast(&plane, &mut pixel, self.options.rays[0], &mut scratch);
            let n = f64::from(pixel.rays);
            if pixel.halves[1].iter().sum::<f64>() < n || pixel.halves[0].iter().sum::<f64>() < BACKGROUND_ABOVE * n {
                open.push(pixel);
            }
        }
        // All pixels get the same number of rays; otherwise it would depend on their errors, which would bias the mean.
        let noise = |open: &[PixelSums]| open.iter().map(PixelSums::noise).sum::<f64>() / open.len().max(1) as f64;
        let mut rays = self.options.rays[0];
        while rays < self.options.rays[1] && noise(&open) > self.options.noise {
            for pixel in &mut open {
                self.cast(&plane, pixel, rays, &mut scratch);
            }
            rays *= 2;
        }
        open.iter().map(|p| self.finish(&plane, p)).collect()
    }

    /// Cast `count` more rays through a pixel; those of the first call are shaded.
    fn cast(&self, plane: &ImagePlane, pixel: &mut PixelSums, count: u32, scratch: &mut Scratch) {
        let shaded = self.shaded && pixel.rays == 0;
        for index in pixel.rays..pixel.rays + count {
            let half = (index & 1) as usize;
            let [dx, dy] = point(index >> 1, hash(pixel.seed ^ index & 1));
            let ray =
                plane.ray([pixel.middle[0] + plane.pixel * (dx - 0.5), pixel.middle[1] + plane.pixel * (dy - 0.5)]);
            let truth = self.truth.trace(&ray, &mut scratch.hits);
            pixel.halves[1][half] += truth;
            pixel.halves[0][half] += if shaded {
                self.truth_shaded(&ray, truth, &scratch.hits, &mut pixel.truth);
                self.texel_shaded(&ray, &mut pixel.texel, scratch)
            } else {
                self.through(&ray)
            };
        }
        if shaded {
            for side in [&mut pixel.texel, &mut pixel.truth] {
                let share = 1.0 / f64::from(count);
                *side = PixelMeans {
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

    fn truth_shaded(&self, ray: &Ray, through: f64, hits: &[TruthHit], sum: &mut PixelMeans) {
        sum.cover += 1.0 - through;
        for layer in hits {
            for (s, a) in sum.albedo.iter_mut().zip(layer.albedo) {
                *s += layer.weight * f64::from(a);
            }
            let lit = layer.weight * layer.lit(ray.dir, SUN);
            if lit > 0.0 {
                sum.lit += lit;
                sum.open += lit * self.truth.transmittance(&Ray { origin: ray.at(layer.t), dir: SUN }, layer.facet);
            }
        }
        sum.light = sum.open;
    }

    /// March and shade as pictures are, with white facets for the light; returns the transmittance.
    fn texel_shaded(&self, ray: &Ray, sum: &mut PixelMeans, scratch: &mut Scratch) -> f64 {
        let Some(segment) = self.segment(ray) else { return 1.0 };
        let lights = [SUN.as_vec3()];
        scratch.groups.clear();
        let mut sink = WhiteShader {
            shader: Shader::new(-ray.dir.as_vec3(), &lights, None, Vec3::ONE, &[], &mut scratch.groups),
            albedo: Vec3::ZERO,
        };
        let mut stats = MarchStats::default();
        let through = march(self.tree, &segment, DepthChoice::default(), 1.0, &mut sink, &mut stats);
        sink.shader.finish();
        sum.cover += 1.0 - f64::from(through);
        for (s, a) in sum.albedo.iter_mut().zip(sink.albedo.to_array()) {
            *s += f64::from(a);
        }
        let facet = self.tree.info().facet_size as f32;
        let factor = self.tree.brightness_factors()[self.depth].at_cosine((-ray.dir).dot(SUN) as f32);
        for group in &scratch.groups {
            let origin = group.position + group.start(facet, lights[0]);
            let shadow = MarchSegment { origin, dir: lights[0], length: 2.0, ..segment };
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
        self.segment(ray)
            .map_or(1.0, |s| transmittance(self.tree, &s, DepthChoice::default(), 1.0 / 512.0, &mut stats).into())
    }

    /// The ray's segment in the cube, as wide as a voxel of the depth that is measured.
    fn segment(&self, ray: &Ray) -> Option<MarchSegment> {
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

    fn finish(&self, plane: &ImagePlane, pixel: &PixelSums) -> Pixel {
        let n = f64::from(pixel.rays);
        let [texel, truth] = pixel.halves.map(|h| 1.0 - (h[0] + h[1]) / n);
        Pixel {
            texel: PixelMeans { opacity: texel, ..pixel.texel },
            truth: PixelMeans { opacity: truth, ..pixel.truth },
            one_ray: 1.0 - self.through(&plane.ray(pixel.middle)),
            noise: pixel.noise(),
            rays: pixel.rays,
        }
    }
}

impl PixelSums {
    fn noise(&self) -> f64 {
        let error = |half: usize| self.halves[0][half] - self.halves[1][half];
        (error(0) - error(1)).abs() / f64::from(self.rays)
    }
}

#[derive(Default)]
struct Scratch {
    hits: Vec<TruthHit>,
    groups: Vec<ShadowGroup>,
}

/// A sink that shades all voxels as white, and sums up their colour separately.
struct WhiteShader<'a> {
    shader: Shader<'a>,
    albedo: Vec3,
}

impl Sink for WhiteShader<'_> {
    fn voxel(&mut self, hit: &VoxelHit<'_>) {
        self.albedo += hit.weight * hit.voxel.albedo();
        let voxel = Voxel { albedo: [255; 3], ..*hit.voxel };
        self.shader.voxel(&VoxelHit { voxel: &voxel, ..*hit });
    }
}

/// The image plane at right angles to a direction, with the rectangle on which the texel's content is seen.
struct ImagePlane {
    axes: [DVec3; 3],
    /// Width of a pixel, cube edges.
    pixel: f64,
    min: [f64; 2],
    max: [f64; 2],
}

impl ImagePlane {
    fn new(batch: &Batch<'_>, seed: u32) -> ImagePlane {
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
        ImagePlane { axes, pixel, min, max }
    }

    fn place(&self, at: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| self.min[k] + at[k] * (self.max[k] - self.min[k]))
    }

    fn ray(&self, at: [f64; 2]) -> Ray {
        let [a, b, w] = self.axes;
        Ray { origin: DVec3::splat(0.5) + at[0] * a + at[1] * b - 2.0 * w, dir: w }
    }
}
