//! The reference against explicit instances, noise and hostile sources.

use std::sync::Arc;

use super::*;
use crate::geom::{Aabb, DAffine3, DMat3, DVec3};
use crate::progress::Quiet;
use crate::render::{Ambient, CameraChoice};
use crate::scene::phong::Phong;
use crate::scene::shell::{Environment, Layer, ShellMaterial};
use crate::scene::{Alpha, Instance, Light, LightKind, Material, Model, Part, Texture, TextureRef};
use crate::volume::{Info, Volume};

fn info(bounds: Aabb) -> Info {
    Info { bounds, ..Info::default() }
}

/// A cube of 2 m standing on the ground around the origin.
const BOUNDS: Aabb = Aabb { min: DVec3::new(-1.0, 0.0, -1.0), max: DVec3::new(1.0, 2.0, 1.0) };

/// Leaves scattered in [`BOUNDS`]: opaque ones, masked ones, and half-transparent ones.
fn plant() -> Model {
    let mut number = 1u32;
    let mut random = || {
        number = sampling::hash(number);
        f64::from(number) / f64::from(u32::MAX)
    };
    let mut model = Model::default();
    let texels = vec![[255, 255, 255, 255], [255, 255, 255, 0], [200, 50, 20, 0], [255, 255, 255, 255]];
    let mut texture = Texture::new("leaf", 2, 2, texels);
    texture.nearest = true;
    let texture = Arc::new(texture);
    for (k, alpha) in [Alpha::Opaque, Alpha::Mask(0.5), Alpha::Blend].into_iter().enumerate() {
        let mut part = Part { uvs: vec![vec![]], normals: Some(vec![]), material: k, ..Part::default() };
        for _ in 0..60 {
            let centre = DVec3::new(random() - 0.5, random(), random() - 0.5) * 1.7 + DVec3::Y * 0.15;
            let base = part.positions.len() as u32;
            for uv in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]] {
                let p = centre + 0.3 * DVec3::new(random() - 0.5, random() - 0.5, random() - 0.5);
                part.positions.push(p.as_vec3().to_array());
                part.uvs[0].push(uv);
                let n = DVec3::new(random() - 0.5, 1.0, random() - 0.5).normalize();
                part.normals.as_mut().unwrap().push(n.as_vec3().to_array());
            }
            part.triangles.push([base, base + 1, base + 2]);
        }
        model.parts.push(part);
        let texture =
            TextureRef { texture: Arc::clone(&texture), tex_coord: 0, transform: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] };
        model.materials.push(Material {
            base_color: [0.3, 0.6, 0.1 + 0.2 * k as f32, if alpha == Alpha::Blend { 0.5 } else { 1.0 }],
            texture: (alpha != Alpha::Blend).then_some(texture),
            alpha,
            ..Material::default()
        });
        let transform = DAffine3::from_translation(DVec3::new(0.0, 0.01 * k as f64, 0.0));
        model.instances.push(Instance { part: k, transform, node: String::new() });
    }
    model
}

const TILES: usize = 3;

/// Edges along x and z of a tile, and the height of the shell, all at right angles, as one matrix.
fn tile() -> DMat3 {
    DMat3::from_rotation_y(0.3) * DMat3::from_diagonal(DVec3::splat(2.0))
}

/// A ground of 3 × 3 tiles, each with one copy of the texel, or without a shell.
fn ground(shell: Option<ShellMaterial>) -> Model {
    let mut part = Part { uvs: vec![vec![]], ..Part::default() };
    for z in 0..=TILES {
        for x in 0..=TILES {
            let p = tile() * DVec3::new(x as f64, 0.0, z as f64);
            part.positions.push(p.as_vec3().to_array());
            // v runs against z.
            part.uvs[0].push([x as f32, (TILES - z) as f32]);
        }
    }
    let at = |x: usize, z: usize| (z * (TILES + 1) + x) as u32;
    for z in 0..TILES {
        for x in 0..TILES {
            part.triangles.push([at(x, z), at(x, z + 1), at(x + 1, z)]);
            part.triangles.push([at(x + 1, z), at(x, z + 1), at(x + 1, z + 1)]);
        }
    }
    let material = Material { base_color: [0.4, 0.3, 0.2, 1.0], shell: shell.map(Arc::new), ..Material::default() };
    let towards = DVec3::new(-0.4, 0.8, 0.5).normalize();
    let sun = Light {
        name: String::new(),
        to_world: DAffine3::from_quat(glam::DQuat::from_rotation_arc(DVec3::Z, towards)),
        intensity: [3.0, 2.5, 2.0],
        kind: LightKind::Directional,
        range: f64::INFINITY,
    };
    Model {
        parts: vec![part],
        materials: vec![material],
        instances: vec![Instance { part: 0, transform: DAffine3::IDENTITY, node: String::new() }],
        lights: vec![sun],
        ..Model::default()
    }
}

fn shell() -> ShellMaterial {
    ShellMaterial { thickness: 2.0, ..ShellMaterial::default() }
}

fn scene(model: Model) -> Scene {
    let texel = TexelRef { name: "plant".into(), frames: vec![], ..TexelRef::default() };
    let environment =
        Environment { sky: Some([0.3, 0.4, 0.6].into()), background: Some([0.1, 0.2, 0.9]), ..Default::default() };
    Scene { model, texels: vec![texel], copies: Vec::new(), environment }
}

fn options() -> Options {
    let target = tile() * DVec3::new(1.5, 0.3, 1.5);
    let camera = CameraChoice::LookAt { eye: target + DVec3::new(3.0, 4.0, 7.0), target, yfov: 0.8 };
    Options { size: [96, 64], camera, ..Options::measuring() }
}

fn of_shell(material: ShellMaterial, options: &Options, samples: Range<u32>) -> Reference {
    let scene = scene(ground(Some(material)));
    let tree = || Octree::new(Volume { info: info(BOUNDS), depths: vec![] }).unwrap();
    let source = SourceMesh::new(plant(), &info(BOUNDS), &mut Warnings::default());
    reference_with(&scene, vec![Some(tree())], &[Some(source)], options, samples, &Quiet).unwrap()
}

/// The same scene with the plants as plain instances.
fn of_instances(options: &Options, samples: Range<u32>) -> Reference {
    let mut model = ground(None);
    let plant = plant();
    for z in 0..TILES {
        for x in 0..TILES {
            let base = tile() * DVec3::new(x as f64 + 0.5, 0.0, z as f64 + 0.5);
            // BOUNDS is 2 m wide and stands on the ground, as a tile is.
            let place = DAffine3 { matrix3: tile() * 0.5, translation: base };
            for instance in &plant.instances {
                let transform = place * instance.transform;
                model.instances.push(Instance { part: 1 + instance.part, transform, node: String::new() });
            }
        }
    }
    model.parts.extend(plant.parts.into_iter().map(|part| Part { material: 1 + part.material, ..part }));
    model.materials.extend(plant.materials);
    reference_with(&scene(model), vec![None], &[None], options, samples, &Quiet).unwrap()
}

fn rms(a: &Film, b: &Film) -> f64 {
    let square = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).map(|k| f64::from(a[k] - b[k]).powi(2)).sum::<f64>();
    (a.pixels.iter().zip(&b.pixels).map(square).sum::<f64>() / (3 * a.pixels.len()) as f64).sqrt()
}

fn mean(a: &Film) -> f64 {
    a.pixels.iter().map(|p| f64::from(p[1])).sum::<f64>() / a.pixels.len() as f64
}

#[test]
fn shells_agree_with_explicit_instances() {
    for ambient in [Ambient::Constant, Ambient::Occluded] {
        let options = Options { ambient, ..options() };
        let (a, b) = (of_shell(shell(), &options, 0..16), of_instances(&options, 0..16));
        assert!(a.warnings.is_empty() && a.stats.counts.boxes > 0 && b.stats.counts.boxes == 0);
        // Samples are the same; only the chance of half-transparent leaves is drawn apart: within the noise, whose mean
        // over 6144 pixels is small.
        let noise = 0.5 * rms(&b.halves[0], &b.halves[1]);
        assert!(rms(&a.film, &b.film) < 2.0 * noise, "{} noise {noise}", rms(&a.film, &b.film));
        assert!((mean(&a.film) / mean(&b.film) - 1.0).abs() < 0.004, "{} {}", mean(&a.film), mean(&b.film));
    }
}

/// Two layers of the same facets: which of them is seen.
#[test]
fn of_facets_in_one_place_the_upper_are_seen() {
    let options = options();
    let opaque = || {
        let mut model = plant();
        model.instances.retain(|i| i.part != 2);
        SourceMesh::new(model, &info(BOUNDS), &mut Warnings::default())
    };
    let drawn = |layers: Vec<Layer>| {
        let tree = Octree::new(Volume { info: info(BOUNDS), depths: vec![] }).unwrap();
        let material = ShellMaterial { layers, surface_visible: false, ..shell() };
        let scene = scene(ground(Some(material)));
        reference_with(&scene, vec![Some(tree)], &[Some(opaque())], &options, 0..8, &Quiet).unwrap().film
    };
    let red = Layer { phong: Phong::tint([1.0, 0.0, 0.0]), ..Layer::default() };
    let blue = |over: bool| Layer { phong: Phong::tint([0.0, 0.0, 1.0]), over, ..Layer::default() };
    let alone = drawn(vec![blue(true)]);
    let over = drawn(vec![red.clone(), blue(true)]);
    // The light of two layers is added up in another order.
    assert!(rms(&over, &alone) < 1e-6, "{}", rms(&over, &alone));
    // Mixed: either by chance, half of the samples each.
    let sum = |film: &Film, k: usize| film.pixels.iter().filter(|p| p[3] > 0.0).map(|p| f64::from(p[k])).sum::<f64>();
    let (mixed, first) = (drawn(vec![red.clone(), blue(false)]), drawn(vec![red]));
    let back = |film: &Film| -> f64 {
        // The background's own red, in samples that meet nothing.
        film.pixels.iter().filter(|p| p[3] > 0.0).map(|p| 0.1 * f64::from(1.0 - p[3])).sum()
    };
    let share = (sum(&mixed, 0) - back(&mixed)) / (sum(&first, 0) - back(&first));
    // Some 20 000 samples: a standard deviation of .004.
    assert!((share - 0.5).abs() < 0.02, "{share}");
}

/// Without chance, sample by sample.
#[test]
fn opaque_shells_equal_explicit_instances() {
    let keep = |mut model: Model| {
        model.instances.retain(|i| i.part != 2);
        model
    };
    let options = options();
    let tree = Octree::new(Volume { info: info(BOUNDS), depths: vec![] }).unwrap();
    let source = SourceMesh::new(keep(plant()), &info(BOUNDS), &mut Warnings::default());
    let shells = scene(ground(Some(shell())));
    let a = reference_with(&shells, vec![Some(tree)], &[Some(source)], &options, 0..1, &Quiet).unwrap();
    let mut explicit = ground(None);
    let plant = keep(plant());
    for k in 0..TILES * TILES {
        let corner = DVec3::new((k % TILES) as f64 + 0.5, 0.0, (k / TILES) as f64 + 0.5);
        let place = DAffine3 { matrix3: tile() * 0.5, translation: tile() * corner };
        for i in &plant.instances {
            explicit.instances.push(Instance { part: 1 + i.part, transform: place * i.transform, node: String::new() });
        }
    }
    explicit.parts.extend(plant.parts.into_iter().map(|part| Part { material: 1 + part.material, ..part }));
    explicit.materials.extend(plant.materials);
    let b = reference_with(&scene(explicit), vec![None], &[None], &options, 0..1, &Quiet).unwrap();
    // Positions are f32: a ray that grazes an edge may go either way.
    let close = |(a, b): (&[f32; 4], &[f32; 4])| (0..4).all(|k| (a[k] - b[k]).abs() < 1e-4);
    let differ = a.film.pixels.iter().zip(&b.film.pixels).filter(|&pair| !close(pair)).count();
    assert!(differ < 6, "{differ} of {} pixels", a.film.pixels.len());
}

#[test]
fn runs_add_up_and_threads_do_not_matter() {
    let options = Options { threads: 2, ..options() };
    let whole = of_shell(shell(), &options, 0..8);
    assert!(of_shell(shell(), &Options { threads: 1, ..options.clone() }, 0..8).film == whole.film);
    let (first, second) = (of_shell(shell(), &options, 0..4), of_shell(shell(), &options, 4..8));
    let add_up = |a: &Film, b: &Film, sum: &Film| {
        let pairs = a.pixels.iter().zip(&b.pixels).zip(&sum.pixels);
        // Radiances are of size 1, means are rounded to f32.
        pairs.into_iter().all(|((a, b), sum)| (0..4).all(|k| (0.5 * (a[k] + b[k]) - sum[k]).abs() < 1e-6))
    };
    assert!(add_up(&first.film, &second.film, &whole.film));
    assert!((0..2).all(|k| add_up(&first.halves[k], &second.halves[k], &whole.halves[k])));
    assert!(add_up(&whole.halves[0], &whole.halves[1], &whole.film) && whole.halves[0] != whole.halves[1]);
    // The same through a file, in pieces of odd length.
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    of_shell(shell(), &options, 0..3).save(&path, "key").unwrap();
    let mut grown = Reference::load(&path, Some("key")).unwrap();
    grown.add(of_shell(shell(), &options, 3..8));
    assert_eq!(grown.samples, 8);
    assert!(add_up(&grown.film, &grown.film, &whole.film));
    assert!((0..2).all(|k| add_up(&grown.halves[k], &grown.halves[k], &whole.halves[k])));
    assert!(Reference::load(&path, Some("another")).is_err() && Reference::load(&path, None).is_ok());
    assert!(grown.noise(67.0).unwrap().all.rmse > 0.0);
    assert!(crate::render::image_io::read(&path).unwrap().has_alpha());
    let one = of_shell(shell(), &options, 0..1);
    assert!(one.halves[0] == one.halves[1] && one.halves[0] == one.film);
    assert!(reference_with(&scene(ground(None)), vec![None], &[None], &options, 3..3, &Quiet).is_err());
}

/// Height vectors that differ by a hair make boxes that take the way of curved ones, of nearly the same picture.
#[test]
fn curved_boxes_tend_to_straight_ones() {
    let options = options();
    let straight = of_shell(shell(), &options, 0..4);
    let lean = |amount: f32| {
        let mut model = ground(Some(shell()));
        let part = &mut model.parts[0];
        let lean = |i: usize| amount * if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        part.heights = Some((0..part.positions.len()).map(|i| [lean(i), 2.0, lean(i)]).collect());
        let tree = Octree::new(Volume { info: info(BOUNDS), depths: vec![] }).unwrap();
        let source = SourceMesh::new(plant(), &info(BOUNDS), &mut Warnings::default());
        reference_with(&scene(model), vec![Some(tree)], &[Some(source)], &options, 0..4, &Quiet).unwrap()
    };
    let noise = 0.5 * rms(&straight.halves[0], &straight.halves[1]);
    let nearly = rms(&lean(1e-4).film, &straight.film);
    assert!(nearly < noise, "{nearly}, noise {noise}");
    assert!(rms(&lean(0.3).film, &straight.film) > 2.0 * nearly);
}
