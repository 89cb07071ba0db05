//! A source's facets and its texel against formulas, and texels against each other.

use std::path::Path;

use vtex::bake::{self, Options};
use vtex::geom::{Aabb, DAffine3, DVec3, directions13};
use vtex::progress::Quiet;
use vtex::render::{DepthChoice, MarchSegment, MarchStats, transmittance};
use vtex::source;
use vtex::source::{OpenOptions, Placement, Source};
use vtex::volume::Octree;

use super::bodies::Body;

/// Relative errors, but for `opacity`.
#[derive(Debug, Clone, Copy)]
pub struct Errors {
    pub area: f64,
    /// Of the projected area in 26 directions, the worst.
    pub sigma: f64,
    pub volume: Option<f64>,
    /// Mean |ΔT| over pixels as wide as a finest voxel, in 26 directions, of what covers or should.
    pub opacity: f64,
    /// What the texel covers.
    pub covered: f64,
}

/// A texel with the way into it.
pub struct Texel {
    pub tree: Octree,
    pub depth: usize,
    /// Source space → the cube [0, 1]³.
    pub into: DAffine3,
    pub place: Placement,
}

/// A file in `folder`, opened.
pub fn open(folder: &Path, name: &str, text: &[u8], options: &OpenOptions) -> Box<dyn Source> {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap_or_else(|e| panic!("{name}: {e}"));
    source::open(&path, options).unwrap_or_else(|e| panic!("{e}"))
}

/// The recipe that draws `shape` within the cube from −2 to 2, or a sheet within −1 to 1.
pub fn recipe(body: &Body) -> String {
    let window = if body.volume.is_none() { "bounds = { min = [-1, -1, -1], max = [1, 1, 1] }\n" } else { "" };
    format!("{window}[[draw]]\n{}\n", body.recipe)
}

pub fn baked(source: &dyn Source, resolution: u32) -> Texel {
    let options = Options { resolution, ..Options::default() };
    let (volume, _) = bake::bake(source, &options, &Quiet, &mut |_| ()).unwrap_or_else(|e| panic!("{e}"));
    let depth = volume.depths.len() - 1;
    let place = Placement::of(&volume.info, depth);
    let shrink = DAffine3::from_scale(DVec3::splat(1.0 / f64::from(place.side())));
    let tree = Octree::new(volume).unwrap_or_else(|e| panic!("{e}"));
    Texel { tree, depth, into: shrink * place.grid_map(), place }
}

impl Texel {
    /// Width of a finest voxel in source units.
    pub fn voxel(&self) -> f64 {
        1.0 / self.place.scale
    }

    /// Transmittance along a ray of source space.
    pub fn through(&self, origin: DVec3, dir: DVec3) -> f64 {
        let (o, d) = (self.into.transform_point3(origin), self.into.transform_vector3(dir).normalize());
        let Some((t0, t1)) = Aabb::UNIT.hit(o, 1.0 / d, 0.0, 1e9) else { return 1.0 };
        let stretch = MarchSegment {
            origin: (o + t0 * d).as_vec3(),
            dir: d.as_vec3(),
            length: (t1 - t0) as f32,
            footprint: 1.0 / (1u32 << self.depth) as f32,
            growth: 0.0,
            opacity_scale: 1.0,
        };
        transmittance(&self.tree, &stretch, DepthChoice::default(), 0.0, &mut MarchStats::default()).into()
    }
}

/// A number in [0, 1) for each `n`: Weyl's sequence, by another irrational for each `of`.
fn lot(n: u64, of: usize) -> f64 {
    // Powers of 1 / plastic number and of the golden section.
    let step = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2, 0.618_033_988_749_894_9, 0.381_966_011_250_105_1][of];
    (0.5 + step * n as f64).fract()
}

/// Mean of |a − b| over what either covers, and covered by `a` over covered by `b`: opacities along rays, by pixels `width`
/// wide anywhere in the ball of `radius` about `centre`, in 26 directions.
pub fn compared(
    centre: DVec3,
    radius: f64,
    width: f64,
    a: impl Fn(DVec3, DVec3) -> f64,
    b: impl Fn(DVec3, DVec3) -> f64,
) -> (f64, f64) {
    const PIXELS: u64 = 160;
    const RAYS: u64 = 16;
    let (mut sum, mut there, mut covers) = (0.0, 0.0, [0.0, 0.0]);
    let mut n = 0;
    for axis in directions13() {
        for dir in [axis, -axis] {
            let (right, up) = dir.any_orthonormal_pair();
            for _ in 0..PIXELS {
                let [x, y] = [0, 1].map(|k| (2.0 * lot(n, k) - 1.0) * radius);
                let mut pixel = [0.0, 0.0];
                for ray in 0..RAYS {
                    let within = [0, 1].map(|k| width * (lot(n * RAYS + ray, 2 + k) - 0.5));
                    let origin = centre + (x + within[0]) * right + (y + within[1]) * up - 3.0 * radius * dir;
                    pixel[0] += a(origin, dir) / RAYS as f64;
                    pixel[1] += b(origin, dir) / RAYS as f64;
                }
                n += 1;
                if pixel[0].max(pixel[1]) > 0.002 {
                    sum += (pixel[0] - pixel[1]).abs();
                    there += 1.0;
                }
                covers.iter_mut().zip(pixel).for_each(|(sum, c)| *sum += c);
            }
        }
    }
    (sum / there, covers[0] / covers[1])
}

/// Area, volume, and projected areas of a source's facets, in its own units.
pub fn facets(source: &dyn Source, place: &Placement) -> (f64, f64, [f64; 13]) {
    let staged = source.stage(place, &Quiet).unwrap_or_else(|e| panic!("{e}"));
    let found = source::facets(&*staged, place, 1 << 30, &Quiet).unwrap_or_else(|e| panic!("{e}"));
    let (mut area, mut volume, mut sigma) = (0.0, 0.0, [0.0; 13]);
    for piece in &found.pieces {
        let [a, b, c] = piece.corners;
        let vector = 0.5 * (b - a).cross(c - a);
        area += vector.length();
        volume += vector.dot(a) / 3.0;
        // Directions of source space, as they lie in the grid.
        for (sum, w) in sigma.iter_mut().zip(directions13()) {
            *sum += 0.5 * vector.dot(place.grid_map().transform_vector3(w).normalize()).abs();
        }
    }
    let s = place.scale;
    (area / (s * s), volume / (s * s * s), sigma.map(|v| v / (s * s)))
}

/// The body baked at a resolution.
pub fn errors(body: &Body, folder: &Path, resolution: u32) -> Errors {
    let source = open(folder, "body.toml", recipe(body).as_bytes(), &OpenOptions::default());
    let texel = baked(&*source, resolution);
    let (area, volume, sigma) = facets(&*source, &texel.place);
    // Each side of a sheet is seen, and a closed body's sides by half.
    let sides = if body.volume.is_none() { 2.0 } else { 1.0 };
    let worst = directions13().into_iter().zip(sigma).map(|(w, got)| (sides * got / (body.sigma)(w) - 1.0).abs());
    let (centre, size) = (0.5 * (source.bounds().min + source.bounds().max), source.bounds().size());
    let (opacity, covered) = compared(
        centre,
        0.5 * size.length(),
        texel.voxel(),
        |o, d| 1.0 - texel.through(o, d),
        |o, d| f64::from(u8::from((body.hits)(o, d))),
    );
    Errors {
        area: area / body.area - 1.0,
        sigma: worst.fold(0.0, f64::max),
        volume: body.volume.map(|v| volume / v - 1.0),
        opacity,
        covered: covered - 1.0,
    }
}
