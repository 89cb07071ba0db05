//! How far a baked texel's opacity is from its source's: mean, 95th percentile and bias of |T − T_true| over many parallel
//! beams, for pixels of one and of four voxels, at the finest depths. `cargo run --release --example bake_error [MESH [R]]`.

#![allow(clippy::unwrap_used)]

use std::time::Instant;

use vtex::bake::{self, MeshOptions, MeshSource, Options};
use vtex::geom::{DAffine3, DVec3};
use vtex::progress::Quiet;
use vtex::render::{DepthChoice, MarchStats, Stretch, transmittance};
use vtex::scene::{Instance, Material, Model, Part};
use vtex::volume::Octree;

struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn direction(&mut self) -> DVec3 {
        let (z, a) = (2.0 * self.unit() - 1.0, std::f64::consts::TAU * self.unit());
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * a.cos(), r * a.sin(), z)
    }

    fn point(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit())
    }
}

fn frame(w: DVec3) -> (DVec3, DVec3) {
    let a = if w.z.abs() < 0.9 { DVec3::Z.cross(w) } else { DVec3::X.cross(w) }.normalize();
    (a, w.cross(a))
}

#[derive(Default)]
struct Soup(Vec<[DVec3; 3]>);

impl Soup {
    fn quad(&mut self, c: DVec3, a: DVec3, b: DVec3) {
        let p = [c - a - b, c + a - b, c + a + b, c - a + b];
        self.0.push([p[0], p[1], p[2]]);
        self.0.push([p[0], p[2], p[3]]);
    }

    fn model(&self) -> Model {
        let mut part = Part::default();
        for t in &self.0 {
            let i = part.positions.len() as u32;
            part.positions.extend(t.map(|p| p.as_vec3().to_array()));
            part.triangles.push([i, i + 1, i + 2]);
        }
        let instance = Instance { part: 0, transform: DAffine3::IDENTITY, node: String::new() };
        Model { parts: vec![part], materials: vec![Material::default()], instances: vec![instance], ..Model::default() }
    }
}

/// Scenes of a cube of 64 voxels.
fn scenes() -> Vec<(&'static str, Soup)> {
    let mut random = Random(88172645463325252);
    let h = 1.0 / 64.0;
    let mut out = Vec::new();
    for (name, size, lai) in
        [("leaves .5 voxel", 0.5, 1.0), ("leaves 1.5", 1.5, 1.5), ("leaves 4", 4.0, 2.0), ("leaves 10", 10.0, 2.0)]
    {
        let mut s = Soup::default();
        let edge = size * h;
        for _ in 0..(lai / (edge * edge)) as usize {
            let (a, b) = frame(random.direction());
            s.quad(random.point(), a * edge / 2.0, b * edge / 2.0);
        }
        out.push((name, s));
    }
    let mut s = Soup::default();
    let (a, b) = frame(DVec3::new(0.3, 0.5, 1.0).normalize());
    s.quad(DVec3::splat(0.5), a * 0.35, b * 0.35);
    out.push(("tilted sheet", s));
    let mut s = Soup::default();
    let n = 48;
    let at = |i: usize, j: usize| {
        let (t, p) = (std::f64::consts::PI * i as f64 / n as f64, std::f64::consts::PI * j as f64 / n as f64);
        DVec3::new(t.sin() * p.cos(), t.sin() * p.sin(), t.cos())
    };
    for i in 0..n {
        for j in 0..2 * n {
            s.0.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            s.0.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    out.push(("sphere", s));
    let mut s = Soup::default();
    for _ in 0..3000 {
        let c = DVec3::new(random.unit(), random.unit(), 0.5);
        for k in 0..6 {
            let on = |k: f64| {
                DVec3::new((k * std::f64::consts::FRAC_PI_3).cos(), (k * std::f64::consts::FRAC_PI_3).sin(), 0.0)
                    * 0.1
                    * h
            };
            let (p, q) = (c + on(k.into()), c + on((k + 1).into()));
            let up = DVec3::Z * 0.4;
            s.0.push([p - up, q - up, q + up]);
            s.0.push([p - up, q + up, p + up]);
        }
    }
    out.push(("stems", s));
    let mut s = Soup::default();
    for _ in 0..6000 {
        let c = random.point();
        for _ in 0..20 {
            let (a, b) = frame(random.direction());
            let e = c + 0.7 * h * (random.point() - 0.5);
            s.quad(e, a * 0.1 * h, b * 0.1 * h);
        }
    }
    out.push(("clumps", s));
    out
}

/// Covered samples of the plane across `w`, `n` a side, `per` samples a texel-cube edge; the middle is `centre`.
fn rasterise(triangles: &[[DVec3; 3]], w: DVec3, centre: DVec3, n: usize, per: f64) -> Vec<bool> {
    let (a, b) = frame(w);
    let mut hit = vec![false; n * n];
    for t in triangles {
        let p = t.map(|p| {
            let d = p - centre;
            (d.dot(a) * per + n as f64 / 2.0, d.dot(b) * per + n as f64 / 2.0)
        });
        let (lo, hi) =
            (p.map(|q| q.1).into_iter().fold(f64::MAX, f64::min), p.map(|q| q.1).into_iter().fold(f64::MIN, f64::max));
        for y in (lo - 0.5).ceil().max(0.0) as usize..((hi - 0.5).ceil().max(0.0) as usize).min(n) {
            let v = y as f64 + 0.5;
            let (mut x0, mut x1) = (f64::MAX, f64::MIN);
            for i in 0..3 {
                let (q, r) = (p[i], p[(i + 1) % 3]);
                if (q.1 <= v) != (r.1 <= v) {
                    let x = q.0 + (v - q.1) / (r.1 - q.1) * (r.0 - q.0);
                    (x0, x1) = (x0.min(x), x1.max(x));
                }
            }
            if x0 <= x1 {
                let from = (x0 - 0.5).ceil().max(0.0) as usize;
                let to = ((x1 - 0.5).ceil().max(0.0) as usize).min(n);
                if from < to {
                    hit[y * n + from..y * n + to].fill(true);
                }
            }
        }
    }
    hit
}

fn probe(name: &str, triangles: &[[DVec3; 3]], tree: &Octree, voxels: &[u64], depths: &[usize]) {
    for &depth in depths {
        let mut random = Random(77);
        let side = 1usize << depth;
        // 4 x 4 rays a voxel; 8 x 8 samples of the truth.
        let rays = (4 * side).min(512);
        let mut sums: [Vec<(f64, f64)>; 3] = Default::default();
        for _ in 0..6 {
            let w = random.direction();
            let centre = DVec3::splat(0.5) + 0.2 * (random.point() - 0.5);
            let per = (8 * side) as f64;
            let truth = rasterise(triangles, w, centre, rays * 2, per);
            let (a, b) = frame(w);
            let march = |x: usize, y: usize| {
                let at = |v: usize| (v as f64 + 0.5 - rays as f64 / 2.0) / (4 * side) as f64;
                let origin = centre + at(x) * a + at(y) * b - 2.0 * w;
                let Some((t0, t1)) = vtex::geom::Aabb::UNIT.hit(origin, 1.0 / w, 0.0, 9.0) else { return 1.0 };
                let stretch = Stretch {
                    origin: (origin + t0 * w).as_vec3(),
                    dir: w.as_vec3(),
                    length: (t1 - t0) as f32,
                    footprint: 1.0 / side as f32,
                    growth: 0.0,
                    opacity_scale: 1.0,
                };
                f64::from(transmittance(tree, &stretch, DepthChoice::default(), 0.0, &mut MarchStats::default()))
            };
            let marched: Vec<f64> = (0..rays * rays).map(|i| march(i % rays, i / rays)).collect();
            for (i, (size, lanes)) in [(4usize, 4), (4, 1), (16, 4)].into_iter().enumerate() {
                for py in 0..rays / size {
                    for px in 0..rays / size {
                        let (mut t, mut g) = (0.0, 0.0);
                        let n = if lanes == 1 { 1 } else { size * size };
                        for i in 0..n {
                            let (x, y) = if lanes == 1 { (size / 2, size / 2) } else { (i % size, i / size) };
                            t += marched[(py * size + y) * rays + px * size + x] / n as f64;
                        }
                        for i in 0..4 * size * size {
                            let (x, y) = (px * 2 * size + i % (2 * size), py * 2 * size + i / (2 * size));
                            g += f64::from(u8::from(!truth[y * rays * 2 + x])) / (4 * size * size) as f64;
                        }
                        if g < 1.0 || t < 0.999 {
                            sums[i].push((t, g));
                        }
                    }
                }
            }
        }
        let show = |s: &[(f64, f64)]| {
            let mut errors: Vec<f64> = s.iter().map(|(t, g)| (t - g).abs()).collect();
            errors.sort_by(f64::total_cmp);
            let n = s.len() as f64;
            let (t, g) = (s.iter().map(|p| 1.0 - p.0).sum::<f64>(), s.iter().map(|p| 1.0 - p.1).sum::<f64>());
            let p95 = errors.get(errors.len() * 95 / 100).copied().unwrap_or(0.0);
            format!("{:.4} p95 {p95:.3} ({:+.4}) area {:.3}", errors.iter().sum::<f64>() / n, (g - t) / n, t / g)
        };
        println!(
            "{name:16} depth {depth:2} {:8} voxels | px = voxel {} | 1 ray {} | px = 4 voxels {}",
            voxels[depth],
            show(&sums[0]),
            show(&sums[1]),
            show(&sums[2])
        );
    }
}

fn run(name: &str, model: Model, resolution: u32) {
    let source = MeshSource::new(model.clone(), &MeshOptions::default());
    let start = Instant::now();
    let (volume, report) =
        bake::bake(&source, &Options { resolution, ..Options::default() }, &Quiet, &mut |_| ()).unwrap();
    let time = start.elapsed().as_secs_f64();
    let bounds = volume.info.bounds;
    let scale = 1.0 / bounds.size().x;
    let mut triangles = Vec::new();
    for i in &model.instances {
        let part = &model.parts[i.part];
        for t in &part.triangles {
            triangles.push(t.map(|c| {
                let p = i.transform.transform_point3(DVec3::from(part.positions[c as usize].map(f64::from)));
                DVec3::new(p.x - bounds.min.x, bounds.max.z - p.z, p.y - bounds.min.y) * scale
            }));
        }
    }
    let c: f64 = volume
        .depths
        .last()
        .map_or(0.0, |d| d.voxels.iter().map(|v| f64::from(v.c())).sum::<f64>() / d.voxels.len() as f64);
    println!("{name}: {} triangles, {time:.2} s, mean c {c:.2}", triangles.len());
    let finest = volume.depths.len() - 1;
    let voxels: Vec<u64> = report.depths.iter().map(|d| d.voxels).collect();
    let tree = Octree::new(volume).unwrap();
    let depths: Vec<usize> = (0..4).filter_map(|k| finest.checked_sub(k)).collect();
    probe(name, &triangles, &tree, &voxels, &depths);
}

fn main() {
    let args: Vec<String> = std::env::args().collect();
    if args.len() < 2 {
        for (name, soup) in scenes() {
            run(name, soup.model(), 64);
        }
        return;
    }
    let resolution = args.get(2).map_or(512, |r| r.parse().unwrap());
    let scene = vtex::scene::gltf::read(args[1].as_ref(), &Default::default()).unwrap();
    run("mesh", scene.model, resolution);
}
