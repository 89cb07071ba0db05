//! Whole scenes with closed-form answers.

use super::*;
use crate::geom::{DAffine3, DMat3, DVec3};
use crate::progress::Quiet;
use crate::scene::phong::Phong;
use crate::scene::shell::{Environment, Layer, ShellMaterial, TexelRef};
use crate::scene::{Instance, Light, LightKind, Material, Model, Part, Transmission};
use crate::volume::{Depth, Info, Volume, Voxel, voxel};

/// A texel that is the same voxel everywhere inside `fill` (texel units), down to `finest`.
fn texel(finest: usize, proto: Voxel, fill: impl Fn(DVec3) -> bool) -> Octree {
    let mut depths: Vec<Depth> = vec![Depth::default(); finest + 1];
    let mut codes: Vec<u64> = (0..1u64 << (3 * finest))
        .filter(|&c| {
            let p = crate::morton::decode(c).map(|k| (f64::from(k) + 0.5) / f64::from(1u32 << finest));
            fill(DVec3::from_array(p))
        })
        .collect();
    for d in (0..=finest).rev() {
        depths[d].voxels = vec![Voxel { rate: rate_at(proto.rate, finest, d), ..proto }; codes.len()];
        if d == finest {
            depths[d].masks = vec![0; codes.len()];
        }
        if d > 0 {
            (codes, depths[d - 1].masks) = crate::morton::parents(&codes);
        }
    }
    let info = Info::default();
    Octree::new(Volume { info, depths }).unwrap()
}

/// The code of the same density a coarser depth: twice the rate a voxel edge for each.
fn rate_at(code: u8, finest: usize, depth: usize) -> u8 {
    (usize::from(code) + 16 * (finest - depth)).min(255) as u8
}

fn shell(thickness: f64, surface_visible: bool) -> Material {
    let shell = ShellMaterial { thickness, surface_visible, ..ShellMaterial::default() };
    Material { base_color: [0.5, 0.5, 0.5, 1.0], shell: Some(Arc::new(shell)), ..Default::default() }
}

/// A square of side 2 `half` in the plane y = 0, facing up, with `tiles` copies along each side.
fn square(half: f32, tiles: f32, material: usize) -> Part {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0f32]];
    Part {
        name: "square".into(),
        positions: corners.map(|[x, z]| [x * half, 0.0, z * half]).to_vec(),
        normals: Some(vec![[0.0, 1.0, 0.0]; 4]),
        uvs: vec![corners.map(|[x, z]| [0.5 * (x + 1.0) * tiles, 0.5 * (1.0 - z) * tiles]).to_vec()],
        triangles: vec![[0, 3, 1], [1, 3, 2]],
        material,
        ..Default::default()
    }
}

fn scene(parts: Vec<Part>, materials: Vec<Material>, at: Vec<DAffine3>) -> Scene {
    let instances =
        at.into_iter().enumerate().map(|(part, transform)| Instance { part, transform, node: String::new() }).collect();
    let model = Model { parts, materials, instances, metres_per_unit: 1.0, ..Default::default() };
    let texel = TexelRef { name: "t".into(), frames: vec!["t.vtex".into()], ..TexelRef::default() };
    let environment = Environment { sky: Some([0.0; 3].into()), background: Some([0.0; 3]), ..Default::default() };
    Scene { model, texels: vec![texel], copies: Vec::new(), environment }
}

fn sun(towards: DVec3, irradiance: f64) -> Light {
    Light {
        name: String::new(),
        to_world: DAffine3::from_quat(glam::DQuat::from_rotation_arc(DVec3::Z, towards.normalize())),
        intensity: [irradiance; 3],
        kind: LightKind::Directional,
        range: f64::INFINITY,
    }
}

fn looking(eye: DVec3, target: DVec3, size: u32) -> Options {
    Options {
        size: [size, size],
        camera: CameraChoice::LookAt { eye, target, yfov: 0.5 },
        sky: Some([0.0; 3].into()),
        background: Some([0.0; 3]),
        ..Options::measuring()
    }
}

fn grey(rate: f64) -> Voxel {
    let mut v = Voxel { rate: voxel::encode_rate(rate), ..Default::default() };
    v.set_albedo([0.5; 3]);
    v
}

/// No light at all: then what is seen is the sky's reflection and the background.
fn dark(mut scene: Scene) -> Scene {
    scene.model.lights = vec![sun(DVec3::Y, 0.0)];
    scene
}

fn shot(scene: &Scene, texels: Vec<Option<Octree>>, options: &Options) -> Film {
    let done = render_with(scene, texels, options, &Quiet).unwrap();
    assert!(done.warnings.is_empty(), "{:?}", done.warnings);
    done.film
}

/// Seen through a slab of constant density, the background dims as e^−(density · chord), whatever the warp.
#[test]
fn a_slab_is_exact() {
    let tree = || vec![Some(texel(3, grey(0.25), |_| true))];
    let density = 0.25 * 8.0;
    let materials = vec![shell(0.7, false)];
    let mut leaning = square(50.0, 25.0, 0);
    leaning.heights = Some(vec![[0.4, 0.7, -0.1]; 4]);
    for part in [square(50.0, 50.0, 0), leaning] {
        let slab = dark(scene(vec![part], materials.clone(), vec![DAffine3::IDENTITY]));
        let options =
            Options { background: Some([1.0; 3]), ..looking(DVec3::new(0.3, 4.0, 0.2), DVec3::new(0.5, 0.0, 0.1), 8) };
        let film = shot(&slab, tree(), &options);
        let world = World::new(&slab, super::into_shared(tree()), &options).unwrap();
        for y in 0..8 {
            for x in 0..8 {
                let dir = world.view.cone(f64::from(x) + 0.5, f64::from(y) + 0.5, 1.0).ray.dir;
                // Texel-space length of the path: u and v run along x and −z, w over the thickness, sheared.
                let part = &slab.model.parts[0];
                let h = part.heights.as_ref().map_or([0.0, 0.7, 0.0], |h| h[0].map(f64::from));
                let w = dir.y / h[1];
                let scale = f64::from(part.uvs[0][2][0]) / 100.0;
                let q = DVec3::new((dir.x - w * h[0]) * scale, -(dir.z - w * h[2]) * scale, w);
                let truth = (-density * q.length() / w.abs()).exp();
                let got = f64::from(film.pixels[y as usize * 8 + x as usize][0]);
                // f32 sums over some dozens of voxels.
                assert!((got - truth).abs() < 2e-5, "{x},{y}: {got} {truth}");
            }
        }
    }
}

/// Albedo 1 under a sky of radiance 1 is invisible before a background of 1.
#[test]
fn white_furnace() {
    let mut white = grey(0.4);
    white.set_albedo([1.0; 3]);
    let tree = texel(4, white, |p| (p - DVec3::splat(0.5)).length() < 0.4);
    let mut bulging = square(2.0, 3.0, 0);
    bulging.heights = Some(vec![[0.2, 1.0, 0.0], [0.0, 1.5, 0.3], [-0.3, 0.8, 0.0], [0.0, 1.0, 0.0]]);
    let slab = dark(scene(vec![bulging], vec![shell(1.0, false)], vec![DAffine3::IDENTITY]));
    let one = [1.0; 3];
    let options =
        Options { sky: Some(one.into()), background: Some(one), ..looking(DVec3::new(3.0, 4.0, 5.0), DVec3::ZERO, 24) };
    for (i, p) in shot(&slab, vec![Some(tree)], &options).pixels.iter().enumerate() {
        // The remainder below 1/512 goes to the last voxel or, of a ray that stops between copies, is left out.
        assert!((p[0] - 1.0).abs() < 2.1e-3, "{i}: {p:?}");
    }
}

/// Sun through a slab onto the ground beside it, and an opaque plate above the slab.
#[test]
fn shadows_fall_both_ways() {
    let tree = || vec![Some(texel(3, grey(0.0625), |_| true))];
    let lifted = DAffine3::from_translation(DVec3::Y);
    let ground = Material { base_color: [0.5, 0.5, 0.5, 1.0], ..Default::default() };
    let parts = vec![square(1.0, 2.0, 0), square(30.0, 1.0, 1)];
    let mut open = scene(parts, vec![shell(1.0, false), ground], vec![lifted, DAffine3::IDENTITY]);
    open.model.lights = vec![sun(DVec3::new(1.0, 1.0, 0.0), 2.0)];
    // The ray from (−1.5, 0, 0) to the sun is in the slab from x = −.5 to .5: √2 of it; w has its cell 1 high, u 1 wide.
    let eye = DVec3::new(-1.5, 0.4, 4.0);
    let options = looking(eye, DVec3::new(-1.5, 0.0, 0.0), 1);
    let through = (-0.0625 * 8.0 * 2.0f64.sqrt()).exp();
    let lit = 0.5 / std::f64::consts::PI * 2.0 * 0.5f64.sqrt();
    let got = f64::from(shot(&open, tree(), &options).pixels[0][0]);
    assert!((got - lit * through).abs() < 1e-5, "{got} {}", lit * through);
    let unshadowed = Options { shadows: false, ..options.clone() };
    let got = f64::from(shot(&open, tree(), &unshadowed).pixels[0][0]);
    assert!((got - lit).abs() < 1e-6, "{got} {lit}");
    // From the side, the slab is lit; under a plate it is dark though it is still there.
    let side = looking(DVec3::new(0.0, 1.5, 6.0), DVec3::new(0.0, 1.5, 0.0), 1);
    let seen = shot(&open, tree(), &side).pixels[0];
    assert!(seen[0] > 0.02 && seen[3] > 0.3, "{seen:?}");
    open.model.parts.push(square(9.0, 1.0, 1));
    let above = DAffine3::from_translation(DVec3::new(0.0, 3.0, 0.0));
    open.model.instances.push(Instance { part: 2, transform: above, node: String::new() });
    let dark = shot(&open, tree(), &side).pixels[0];
    assert_eq!(dark[0], 0.0);
    assert_eq!(dark[3], seen[3]);
}

/// Two layers in one place share the light, and what passes is the product.
#[test]
fn overlapping_boxes_interleave() {
    let tree = || vec![Some(texel(5, grey(0.0625), |_| true))];
    let mut material = shell(1.0, false);
    let one = material.shell.clone().unwrap();
    let tinted = |diffuse| Layer { phong: Phong::tint(diffuse), ..one.layers[0].clone() };
    let layers = vec![tinted([1.0, 0.0, 0.0]), tinted([0.0, 0.0, 1.0])];
    material.shell = Some(Arc::new(ShellMaterial { layers, ..(*one).clone() }));
    let both = dark(scene(vec![square(9.0, 9.0, 0)], vec![material], vec![DAffine3::IDENTITY]));
    let options =
        Options { sky: Some([1.0; 3].into()), ..looking(DVec3::new(0.1, 5.0, 0.1), DVec3::new(0.1, 0.0, 0.11), 1) };
    let [r, g, b, a] = shot(&both, tree(), &options).pixels[0];
    let through = (-2.0 * 0.0625 * 32.0f32).exp();
    assert!((a - (1.0 - through)).abs() < 1e-4, "{a} {}", 1.0 - through);
    assert_eq!(g, 0.0);
    let albedo = grey(1.0).albedo().x;
    assert!((r + b - albedo * a).abs() < 1e-5, "{r} {b}");
    // Each voxel has its twin in the very same place.
    assert!((r / (r + b) - 0.5).abs() < 1e-5, "{r} {b}");
}

/// Of twins in one place, the upper is seen first and the lower through it, voxel by voxel.
#[test]
fn upper_layers_are_composited_over_lower_ones() {
    let tree = || vec![Some(texel(5, grey(0.0625), |_| true))];
    let seen = |over: [bool; 3]| {
        let mut material = shell(1.0, false);
        let one = material.shell.clone().unwrap();
        let tint = |k: usize| Phong::tint([0, 1, 2].map(|c| f64::from(u8::from(c == k))));
        let layers = (0..3).map(|k| Layer { phong: tint(k), over: over[k], ..Layer::default() }).collect();
        material.shell = Some(Arc::new(ShellMaterial { layers, ..(*one).clone() }));
        let all = dark(scene(vec![square(9.0, 9.0, 0)], vec![material], vec![DAffine3::IDENTITY]));
        // So narrow that the finest voxels are read, 32 one after the other.
        let camera =
            CameraChoice::LookAt { eye: DVec3::new(0.1, 5.0, 0.1), target: DVec3::new(0.1, 0.0, 0.1001), yfov: 0.001 };
        shot(&all, tree(), &Options { sky: Some([1.0; 3].into()), camera, ..looking(DVec3::Y, DVec3::ZERO, 1) }).pixels
            [0]
    };
    // What one voxel lets through.
    let through = (-0.0625f32).exp();
    // Faint voxels are left out one by one: one of a layer's and not those of the others is a quarter of the mean of all 96.
    let near = |a: f32, b: f32| (a / b - 1.0).abs() < 8e-3;
    let [r, g, b, alpha] = seen([false; 3]);
    assert!(near(r, g) && near(g, b), "{r} {g} {b}");
    let [r, g, b, a] = seen([false, true, true]);
    assert!(near(a, alpha) && near(r / g, through) && near(g / b, through), "{r} {g} {b} {a}");
    // The last is mixed with the second, and both are over the first.
    let [r, g, b, a] = seen([false, true, false]);
    let share = 0.5 * (1.0 - through * through);
    assert!(
        near(a, alpha) && near(g, b) && near(r / g, through * through * (1.0 - through) / share),
        "{r} {g} {b} {a}"
    );
}

/// A layer fills its part of the skin: what is above hides what is below, and a part is a thinner shell that starts higher.
#[test]
fn layers_are_stacked_by_their_skin_ranges() {
    let tree = || vec![Some(texel(5, grey(0.0625), |_| true))];
    let ranged = |layers: Vec<([f64; 2], [f64; 3])>, thickness: f64| {
        let mut material = shell(thickness, false);
        let layer = |(skin_range, diffuse)| Layer { skin_range, phong: Phong::tint(diffuse), ..Layer::default() };
        let own =
            ShellMaterial { layers: layers.into_iter().map(layer).collect(), ..(*material.shell.unwrap()).clone() };
        material.shell = Some(Arc::new(own));
        material
    };
    let place = |material, height: f64| {
        let at = DAffine3::from_translation(DVec3::new(0.0, height, 0.0));
        dark(scene(vec![square(9.0, 9.0, 0)], vec![material], vec![at]))
    };
    let down =
        Options { sky: Some([1.0; 3].into()), ..looking(DVec3::new(0.1, 5.0, 0.1), DVec3::new(0.1, 0.0, 0.11), 1) };
    let (red, blue) = (([0.0, 0.5], [1.0, 0.0, 0.0]), ([0.5, 1.0], [0.0, 0.0, 1.0]));
    let [r, _, b, a] = shot(&place(ranged(vec![red, blue], 1.0), 0.0), tree(), &down).pixels[0];
    // Each half is the texel from floor to top, and opacity does not change as it is pressed together.
    let through = (-0.0625 * 32.0f32).exp();
    assert!((a - (1.0 - through * through)).abs() < 1e-4, "{a}");
    assert!((r / b - through).abs() < 1e-4, "{r} {b}");
    let side = looking(DVec3::new(0.5, 0.9, 8.0), DVec3::new(0.0, 0.4, 0.0), 16);
    let side = Options { sky: Some([1.0; 3].into()), ..side };
    let part = shot(&place(ranged(vec![([0.25, 0.75], [1.0; 3])], 1.0), 0.0), tree(), &side);
    let thin = shot(&place(ranged(vec![([0.0, 1.0], [1.0; 3])], 0.5), 0.25), tree(), &side);
    let apart = part.pixels.iter().flatten().zip(thin.pixels.iter().flatten()).map(|(a, b)| (a - b).abs());
    // The same boxes but for the rounding of where they are.
    assert!(apart.fold(0.0, f32::max) < 1e-5);
    assert!(part.pixels.iter().any(|p| p[3] > 0.5));
}

/// The picture is the same far from the origin, and at any scale.
#[test]
fn moved_and_scaled_scenes_look_the_same() {
    let make = |scale: f64, shift: DVec3| {
        let place = DAffine3::from_scale(DVec3::splat(scale)) * DAffine3::from_translation(shift);
        let mut bulging = square(2.0, 3.0, 0);
        bulging.heights = Some(vec![[0.2, 1.0, 0.0], [0.0, 1.5, 0.3], [-0.3, 0.8, 0.0], [0.0, 1.0, 0.0]]);
        let ground = Material { base_color: [0.4, 0.5, 0.3, 1.0], ..Default::default() };
        let materials = vec![shell(1.0, true), ground];
        let low = DAffine3::from_translation(DVec3::new(0.0, -0.5, 0.0));
        let mut made = scene(vec![bulging, square(8.0, 1.0, 1)], materials, vec![place, place * low]);
        made.model.lights = vec![sun(DVec3::new(0.4, 1.0, 0.3), 3.0)];
        let at = |p: DVec3| place.transform_point3(p);
        let options = Options {
            sky: Some([0.2, 0.3, 0.4].into()),
            ..looking(at(DVec3::new(3.0, 4.0, 5.0)), at(DVec3::ZERO), 48)
        };
        let tree = texel(5, grey(0.7), |p| (p - DVec3::splat(0.5)).length() < 0.45);
        shot(&made, vec![Some(tree)], &options)
    };
    let still = make(1.0, DVec3::ZERO);
    for (scale, shift) in [(1.0, DVec3::new(1e6, 0.0, -1e6)), (1e6, DVec3::ZERO), (1e-6, DVec3::ZERO)] {
        let moved = make(scale, shift);
        let differences = still
            .pixels
            .iter()
            .zip(&moved.pixels)
            .map(|(a, b)| (0..4).map(|k| (a[k] - b[k]).abs()).fold(0.0, f32::max));
        let worst = differences.clone().fold(0.0, f32::max);
        let mean = differences.sum::<f32>() / still.pixels.len() as f32;
        println!("scale {scale} shift {shift}: largest difference {worst}, mean {mean}");
        // Positions move by 1e-10 relative; a ray through a voxel's very edge may fall on its other side.
        assert!(mean < 2e-6 && worst < 0.02, "{worst} {mean}");
    }
}

#[test]
fn any_number_of_threads_and_lanes() {
    let picture = |threads: usize, lanes: u32| {
        let tree = texel(4, grey(0.7), |p| (p - DVec3::splat(0.5)).length() < 0.45);
        let lit = scene(vec![square(2.0, 3.0, 0)], vec![shell(1.0, true)], vec![DAffine3::IDENTITY]);
        let options = Options { threads, lanes, ..looking(DVec3::new(3.0, 4.0, 5.0), DVec3::ZERO, 40) };
        shot(&lit, vec![Some(tree)], &options)
    };
    assert_eq!(picture(1, 1), picture(3, 1));
    let (one, sixteen) = (picture(0, 1), picture(0, 16));
    let mean = |f: &Film| f.pixels.iter().map(|p| p[0]).sum::<f32>() / f.pixels.len() as f32;
    assert!((mean(&one) / mean(&sixteen) - 1.0).abs() < 0.02);
}

/// A sphere of many facets with smooth normals under a light at the eye: albedo / π · I / d² · cosine, by the analytic sphere.
#[test]
fn a_sphere_is_lit_by_a_lamp() {
    let (n, mut part) = (96u32, Part::default());
    for i in 0..=n {
        for j in 0..2 * n {
            let [a, b] = [i, j].map(|k| std::f64::consts::PI * f64::from(k) / f64::from(n));
            let p = DVec3::new(a.sin() * b.cos(), a.cos(), -a.sin() * b.sin()).as_vec3().to_array();
            part.positions.push(p);
            let (k, next) = (i * 2 * n + j, i * 2 * n + (j + 1) % (2 * n));
            if i < n {
                part.triangles.extend([[k, k + 2 * n, next], [next, k + 2 * n, next + 2 * n]]);
            }
        }
    }
    part.normals = Some(part.positions.clone());
    let white = Material { base_color: [0.8, 0.8, 0.8, 1.0], ..Default::default() };
    let mut ball = scene(vec![part], vec![white], vec![DAffine3::IDENTITY]);
    let eye = DVec3::new(0.0, 0.0, 5.0);
    let to_world = DAffine3::from_translation(eye);
    let light = Light { to_world, kind: LightKind::Point, intensity: [40.0; 3], ..sun(DVec3::Y, 1.0) };
    ball.model.lights = vec![light];
    let options = looking(eye, DVec3::ZERO, 33);
    let film = shot(&ball, vec![None], &options);
    let world = World::new(&ball, vec![None], &options).unwrap();
    for (i, pixel) in film.pixels.iter().enumerate() {
        let (x, y) = ((i % 33) as f64 + 0.5, (i / 33) as f64 + 0.5);
        let dir = world.view.cone(x, y, 1.0).ray.dir;
        let (b, c) = (eye.dot(dir), eye.length_squared() - 1.0);
        let disc = b * b - c;
        let t = -b - disc.max(0.0).sqrt();
        let cosine = -(eye + t * dir).dot(dir);
        if disc > 0.05 {
            let truth = 0.8 / std::f64::consts::PI * 40.0 / (t * t) * cosine;
            // Facets of 3 degrees lie within 4e-4 of the sphere; near the rim that moves the point on it.
            assert!((f64::from(pixel[0]) / truth - 1.0).abs() < 0.01, "{x} {y} {} {truth}", pixel[0]);
        } else if disc < -0.05 {
            assert_eq!(*pixel, [0.0; 4]);
        }
    }
}

/// Under a wide plate a point sees half of the sky at most; in the open, all.
#[test]
fn occluded_sky_is_dark_under_a_plate() {
    let grey = Material { base_color: [0.5, 0.5, 0.5, 1.0], ..Default::default() };
    let above = DAffine3::from_translation(DVec3::new(0.0, 1.0, 0.0));
    let parts = vec![square(50.0, 1.0, 0), square(20.0, 1.0, 0)];
    let plates = dark(scene(parts, vec![grey], vec![DAffine3::IDENTITY, above]));
    let sky = || Some([1.0; 3].into());
    let under = |ambient, x: f64| {
        let options = Options { sky: sky(), ambient, ..looking(DVec3::new(x, 0.5, 0.1), DVec3::new(x, 0.0, 0.0), 65) };
        shot(&plates, vec![None], &options).pixels[32 * 65 + 32][0]
    };
    assert_eq!(under(Ambient::Constant, 0.0), 0.5);
    // The parts of the sky are summed by 144 places each: half of it to a few thousandths.
    assert!(under(Ambient::Occluded, 0.0) < 4e-3, "{}", under(Ambient::Occluded, 0.0));
    let open = under(Ambient::Occluded, 45.0);
    assert!((open - 0.5).abs() < 4e-3, "{open}");
}

/// Below the straight edge of a plate, the sun's disc is hidden up to a chord, whichever way the edge runs.
#[test]
fn a_half_shadow_is_what_is_left_of_the_disc() {
    let grey = Material { base_color: [1.0; 4], ..Default::default() };
    let (radius, height) = (0.1f64, 2.0);
    for across in [DVec3::X, DVec3::Z, DVec3::new(0.6, 0.0, 0.8)] {
        let along = across.cross(DVec3::Y);
        let turn = DMat3::from_cols(across, DVec3::Y, -along);
        // From the edge, which is above the origin, towards −`across`.
        let above = DAffine3 { matrix3: turn, translation: DVec3::Y * height - 3.0 * across };
        let parts = vec![square(9.0, 1.0, 0), square(3.0, 1.0, 0)];
        let mut land = scene(parts, vec![grey.clone()], vec![DAffine3::IDENTITY, above]);
        land.model.lights = vec![sun(DVec3::Y, std::f64::consts::PI)];
        for step in -9..=9 {
            let u = f64::from(step) * 0.1;
            let x = u * height * radius.tan() * across;
            let eye = x + 6.0 * across + 1.5 * DVec3::Y;
            let options = Options { sun_angle: Some(2.0 * radius), ..looking(eye, x, 65) };
            let seen = f64::from(shot(&land, vec![None], &options).pixels[32 * 65 + 32][0]);
            let right = 1.0 - (u.acos() - u * (1.0 - u * u).sqrt()) / std::f64::consts::PI;
            // A tenth of the disc may be missed, or its sixteen rays count one too many or too few.
            assert!((seen - right).abs() < 0.105, "{across} {u}: {seen} {right}");
        }
    }
}

/// A level sheet in the air is lit from above on one side and from below on the other, and light from below comes through it.
#[test]
fn a_sheet_is_lit_from_both_sides() {
    let leaf = Transmission { factor: 0.4, color: [1.0; 3], ..Transmission::default() };
    let sheet = Material { base_color: [0.5, 0.5, 0.5, 1.0], transmission: Some(Box::new(leaf)), ..Default::default() };
    let sheet = dark(scene(vec![square(1.0, 1.0, 0)], vec![sheet], vec![DAffine3::IDENTITY]));
    for eye in [3.0, -3.0] {
        let options = Options {
            sky: Some([1.0; 3].into()),
            ambient: Ambient::Occluded,
            ..looking(DVec3::new(0.1, eye, 0.2), DVec3::ZERO, 65)
        };
        let seen = shot(&sheet, vec![None], &options).pixels[32 * 65 + 32][0];
        // Of what comes from before it (1 − .4) · .5 are reflected, of what comes from behind .4 come through; the parts of the
        // sky are summed by 144 places each.
        assert!((seen - 0.7).abs() < 4e-3, "{eye}: {seen}");
    }
}

#[test]
fn blended_surfaces_let_light_through() {
    let glass = Material {
        base_color: [1.0, 0.0, 0.0, 0.25],
        alpha: crate::scene::Alpha::Blend,
        unlit: true,
        ..Default::default()
    };
    let pane = dark(scene(vec![square(3.0, 1.0, 0)], vec![glass], vec![DAffine3::IDENTITY]));
    let options =
        Options { background: Some([0.0, 1.0, 0.0]), ..looking(DVec3::Y * 4.0, DVec3::new(0.0, 0.0, 1e-3), 1) };
    assert_eq!(shot(&pane, vec![None], &options).pixels[0], [0.25, 0.75, 0.0, 0.25]);
}

#[test]
fn wrong_options_are_told() {
    let empty = scene(vec![], vec![], vec![]);
    let bad = [
        Options { size: [0, 5], ..Default::default() },
        Options { lanes: 3, ..Default::default() },
        Options { camera: CameraChoice::Named("x".into()), ..Default::default() },
        looking(DVec3::ONE, DVec3::ONE, 4),
    ];
    for options in bad {
        assert!(matches!(render_with(&empty, vec![], &options, &Quiet), Err(Error::Options(_))), "{options:?}");
    }
    let done = render_with(&empty, vec![], &Options { size: [4, 4], ..Default::default() }, &Quiet).unwrap();
    assert_eq!(done.warnings.iter().count(), 1);
    assert!(trace_pixel(&empty, &Options::default(), [5000, 0]).is_err());
}

/// A long wall on the ground hides (1 − d / r) / 2 of the sky at the distance d, r being the distance to its upper edge.
#[test]
fn a_wall_hides_its_form_factor() {
    let white = Material { base_color: [1.0; 4], ..Default::default() };
    let upright = DMat3::from_cols(DVec3::new(0.0, 0.5, 0.0), DVec3::NEG_X, DVec3::new(0.0, 0.0, 100.0));
    let wall = DAffine3 { matrix3: upright, translation: DVec3::new(0.0, 0.5, 0.0) };
    let parts = vec![square(60.0, 1.0, 0), square(1.0, 1.0, 0)];
    let land = dark(scene(parts, vec![white], vec![DAffine3::IDENTITY, wall]));
    let (mut square, mut worst, mut count) = (0.0f64, 0.0f64, 0.0);
    for d in [0.4, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0f64] {
        let options = Options {
            sky: Some([1.0; 3].into()),
            ambient: Ambient::Occluded,
            ..looking(DVec3::new(d + 1.5, 3.0, 0.1), DVec3::new(d, 0.0, 0.1), 65)
        };
        let seen = f64::from(shot(&land, vec![None], &options).pixels[32 * 65 + 32][0]);
        let right = 0.5 + 0.5 * d / d.hypot(1.0);
        let error = seen - right;
        (square, worst, count) = (square + error * error, worst.max(error.abs()), count + 1.0);
    }
    // Of 41 rays that reach above the ground, up to seven run along an edge of the wall: a few hundredths of the light.
    assert!((square / count).sqrt() < 0.05 && worst < 0.1, "{} {worst}", (square / count).sqrt());
}

mod patches;

/// Texture coordinates as a damaged file has them: a ray would run through more cells than it ever comes to the end of.
#[test]
fn cells_without_number_end() {
    let tree = || vec![Some(texel(2, grey(0.25), |_| true))];
    for (far, left_out) in [(3e38, true), (f32::NAN, true), (1e7, false)] {
        let mut part = square(50.0, 50.0, 0);
        part.uvs[0][0] = [far; 2];
        // Leaning, so that the box is twisted and its rays are cut in pieces.
        part.heights = Some(vec![[0.4, 0.7, -0.1], [0.0, 0.9, 0.3], [-0.2, 0.7, 0.0], [0.0, 0.5, 0.0]]);
        let scene = dark(scene(vec![part], vec![shell(0.7, true)], vec![DAffine3::IDENTITY]));
        let options = looking(DVec3::new(0.3, 4.0, 0.2), DVec3::new(0.5, 0.0, 0.1), 4);
        let warnings = render_with(&scene, tree(), &options, &Quiet).unwrap().warnings.as_reasons();
        assert_eq!(warnings.contains("beyond ±2²⁴"), left_out, "{far}: {warnings}");
    }
}
