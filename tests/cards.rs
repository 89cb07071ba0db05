//! Cards with masks, one before the other: a picture covers, and shades, what their union does.

use std::path::Path;
use std::sync::Arc;

use glam::DQuat;
use vtex::geom::{DAffine3, DMat3, DVec3};
use vtex::progress::Quiet;
use vtex::render::reference::reference;
use vtex::render::{Film, Options, render};
use vtex::scene::shell::Environment;
use vtex::scene::{
    Alpha, Camera, Instance, Light, LightKind, Material, Model, Part, Projection, Scene, Texture, TextureRef, gltf,
};

/// A square of 8 × 8 texels, those there for which `is_there` holds.
fn pattern(is_there: fn(u32, u32) -> bool) -> TextureRef {
    let texels = (0..64).map(|i| [255, 255, 255, if is_there(i % 8, i / 8) { 255 } else { 0 }]).collect();
    let mut texture = Texture::new("pattern", 8, 8, texels);
    texture.nearest = true;
    TextureRef { texture: Arc::new(texture), tex_coord: 0, transform: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] }
}

fn left(x: u32, _: u32) -> bool {
    x < 4
}

fn right(x: u32, _: u32) -> bool {
    x >= 4
}

fn top(_: u32, y: u32) -> bool {
    y < 4
}

fn checks(x: u32, y: u32) -> bool {
    (x + y).is_multiple_of(2)
}

fn other_checks(x: u32, y: u32) -> bool {
    !checks(x, y)
}

/// A square of `edge` metres about the origin that faces +z.
fn square(edge: f32, material: usize) -> Part {
    let h = 0.5 * edge;
    Part {
        positions: vec![[-h, -h, 0.0], [h, -h, 0.0], [h, h, 0.0], [-h, h, 0.0]],
        uvs: vec![vec![[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        material,
        ..Part::default()
    }
}

/// The pattern of a card's mask, and by how many degrees the card is turned about the vertical.
type Layer = (fn(u32, u32) -> bool, f64);

/// Cards of 1 m about the origin, all of one colour; seen along −z, `high` metres of them, from `aside` metres to the right and above.
fn cards(layers: &[Layer], color: f32, high: f64, aside: [f64; 2]) -> Model {
    let mut model = Model::default();
    for (i, &(is_there, turn)) in layers.iter().enumerate() {
        let texture = Some(pattern(is_there));
        let base_color = [color, color, color, 1.0];
        model.materials.push(Material {
            texture,
            base_color,
            alpha: Alpha::Mask(0.5),
            unlit: true,
            ..Material::default()
        });
        model.parts.push(square(1.0, i));
        // Apart, so that which is met first is no chance; by less than shadows or sizes would show.
        let apart = DVec3::new(0.0, 0.0, -1e-5 * i as f64);
        let transform = DAffine3::from_rotation_translation(DQuat::from_rotation_y(turn.to_radians()), apart);
        model.instances.push(Instance { part: i, transform, node: String::new() });
    }
    let to_world = DAffine3::from_translation(DVec3::new(aside[0], aside[1], 5.0));
    let projection = Projection::Orthographic { ymag: 0.5 * high };
    model.cameras.push(Camera { name: String::new(), to_world, projection, aspect: None });
    model
}

fn scene(model: Model) -> Scene {
    let environment = Environment { sky: Some([0.0; 3].into()), background: Some([0.0; 3]), ..Default::default() };
    Scene { model, texels: vec![], copies: vec![], environment }
}

fn mean(film: &Film, channel: usize) -> f64 {
    film.pixels.iter().map(|p| f64::from(p[channel])).sum::<f64>() / film.pixels.len() as f64
}

fn picture(scene: &Scene, side: u32, lanes: u32) -> Film {
    render(scene, &Options { size: [side; 2], lanes, ..Options::measuring() }, &Quiet).unwrap().film
}

/// Quarters of a pixel by which a camera is moved aside, from 0 on, in both directions.
const QUARTERS: u32 = 4;

/// Mean of a channel over pictures of `side`² pixels, in the mean over positions within a pixel, of the scene that `of` makes
/// for a camera moved aside.
fn over_positions(side: u32, high: f64, lanes: u32, channel: usize, of: impl Fn([f64; 2]) -> Model) -> f64 {
    let step = high / f64::from(side * QUARTERS);
    let one = |i: u32| {
        let aside = [i % QUARTERS, i / QUARTERS].map(|k| step * f64::from(k));
        mean(&picture(&scene(of(aside)), side, lanes), channel)
    };
    (0..QUARTERS * QUARTERS).map(one).sum::<f64>() / f64::from(QUARTERS * QUARTERS)
}

/// Stacks of cards, and the area of their union as it is seen along z.
fn stacks() -> Vec<(&'static str, Vec<Layer>, f64)> {
    let half = 0.5f64.sqrt();
    vec![
        ("one", vec![(checks, 0.0)], 0.5),
        ("two in one place", vec![(left, 0.0); 2], 0.5),
        ("three in one place", vec![(checks, 0.0); 3], 0.5),
        ("eight in one place", vec![(checks, 0.0); 8], 0.5),
        ("two halves", vec![(left, 0.0), (right, 0.0)], 1.0),
        ("two shifted by a check", vec![(checks, 0.0), (other_checks, 0.0)], 1.0),
        ("two that know nothing of one another", vec![(left, 0.0), (top, 0.0)], 0.75),
        ("three that know nothing of one another", vec![(left, 0.0), (top, 0.0), (checks, 0.0)], 0.875),
        // Seen from the middle between them, both are as wide as one another.
        ("two that cross", vec![(top, 45.0), (top, -45.0)], 0.5 * half),
        ("two that cross, shifted", vec![(checks, 45.0), (other_checks, -45.0)], half),
    ]
}

#[test]
fn cards_cover_their_union_at_any_distance() {
    for (name, layers, union) in stacks() {
        for (side, high, lanes) in [(80, 1.25, 1), (20, 1.25, 1), (16, 4.0, 1), (16, 4.0, 2), (16, 4.0, 8)] {
            let found = high * high * over_positions(side, high, lanes, 3, |aside| cards(&layers, 1.0, high, aside));
            // The fewest points, 16 in each of 16 pixels of 16 pictures, have a standard deviation of 1.6 % of a half where
            // they are random, and these are stratified: at most half of it.
            assert!(
                (found / union - 1.0).abs() < 0.025,
                "{name}, {high} m, {side} pixels, {lanes} lanes: {found} {union}"
            );
        }
    }
}

/// Black cards in a sun aslant, above a white ground that is seen from above: what they hide and their shadow, beside it.
#[test]
fn shadows_of_cards_are_of_their_union() {
    let of = |layers: &[Layer], high: f64, aside: [f64; 2]| {
        let mut model = cards(layers, 0.0, high, aside);
        model.parts.push(square(1.2 * high as f32, layers.len()));
        model.materials.push(Material::default());
        let transform = DAffine3 { matrix3: DMat3::IDENTITY, translation: DVec3::new(0.0, 0.0, -1.25) };
        model.instances.push(Instance { part: layers.len(), transform, node: String::new() });
        let to_world = DAffine3::from_quat(DQuat::from_rotation_arc(DVec3::Z, DVec3::new(1.0, 0.0, 1.0).normalize()));
        // The open ground has radiance 1.
        let intensity = [std::f64::consts::PI * 2f64.sqrt(); 3];
        let kind = LightKind::Directional;
        model.lights.push(Light { name: String::new(), to_world, intensity, kind, range: f64::INFINITY });
        model
    };
    // Those that are turned have another shadow.
    for (name, layers, union) in stacks().into_iter().filter(|s| s.1.iter().all(|layer| layer.1 == 0.0)) {
        for (side, high) in [(64, 4.0), (16, 4.0)] {
            let dark = 1.0 - over_positions(side, high, 1, 0, |aside| of(&layers, high, aside));
            let found = 0.5 * high * high * dark;
            // As above, of points that are seen and of those in shadow.
            assert!((found / union - 1.0).abs() < 0.025, "{name}, {high} m, {side} pixels: {found} {union}");
        }
    }
}

/// The sample fern as a plain mesh, on a white ground if `ground` is given.
fn fern(ground: bool) -> Model {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/fern.glb");
    let mut model = gltf::read(&path, &Default::default()).unwrap().model;
    if ground {
        let part = model.parts.len();
        model.parts.push(square(200.0, model.materials.len()));
        model.materials.push(Material::default());
        let matrix3 = DMat3::from_rotation_x(-std::f64::consts::FRAC_PI_2);
        let transform = DAffine3 { matrix3, translation: DVec3::new(0.0, -0.01, 0.0) };
        model.instances.push(Instance { part, transform, node: String::new() });
        let to_world = DAffine3::from_quat(DQuat::from_rotation_arc(DVec3::Z, DVec3::new(0.6, 1.0, 0.3).normalize()));
        let kind = LightKind::Directional;
        let intensity = [std::f64::consts::PI; 3];
        model.lights.push(Light { name: String::new(), to_world, intensity, kind, range: f64::INFINITY });
        // Black, so that all that is dark is hidden or in shadow.
        model.materials[0].base_color = [0.0, 0.0, 0.0, 1.0];
    }
    model
}

/// A camera that looks at the fern's middle from `distance` metres in direction `from`, moved aside by `aside` metres. Its
/// pictures of `side` pixels have the same pixels, 40 degrees over 64 of them.
fn camera(from: DVec3, distance: f64, side: u32, aside: [f64; 2]) -> Camera {
    let z = from.normalize();
    let x = DVec3::Y.cross(z).normalize();
    let y = z.cross(x);
    let target = DVec3::new(0.0, 0.25, 0.0) + aside[0] * x + aside[1] * y;
    let to_world = DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: target + distance * z };
    let half = 20f64.to_radians().tan() * f64::from(side) / 64.0;
    let projection = Projection::Perspective { yfov: 2.0 * libm::atan(half) };
    Camera { name: String::new(), to_world, projection, aspect: None }
}

/// Of the fern that `model` makes: what `of` says of the reference, and of pictures in the mean over `positions`² positions
/// within a pixel.
fn fern_seen(
    model: impl Fn() -> Model,
    from: DVec3,
    (distance, side, samples, positions): (f64, u32, u32, u32),
    of: impl Fn(&Film) -> f64,
) -> (f64, f64) {
    let pixel = 2.0 * distance * 20f64.to_radians().tan() / 64.0;
    let at = |i: u32| {
        let aside = [i % positions, i / positions].map(|k| pixel * f64::from(k) / f64::from(positions));
        let mut model = model();
        model.cameras = vec![camera(from, distance, side, aside)];
        scene(model)
    };
    let options = Options { size: [side; 2], ..Options::measuring() };
    let truth = of(&reference(&at(0), &options, 0..samples, &Quiet).unwrap().film);
    let count = positions * positions;
    let found = (0..count).map(|i| of(&picture(&at(i), side, 1))).sum::<f64>() / f64::from(count);
    (found, truth)
}

/// Distances in metres, at which the fern is 74, 18 and 4 pixels wide; sizes of pictures, samples of the reference, and positions.
/// The reference has 5000 samples or more on the fern: 1.3 % where they are random, and stratified ones have half of it. The
/// pictures have as many rays on it, in which a mask is there or not.
const VIEWS: [(f64, u32, u32, u32); 3] = [(2.0, 96, 32, 1), (8.0, 32, 256, 2), (32.0, 16, 4096, 8)];

#[test]
fn a_fern_covers_the_same_at_any_distance() {
    for view in VIEWS {
        for from in [DVec3::new(0.0, 0.2, 1.0), DVec3::new(0.5, 1.0, 0.6)] {
            let (found, truth) = fern_seen(|| fern(false), from, view, |film| mean(film, 3));
            assert!((found / truth - 1.0).abs() < 0.03, "{} m from {from}: {found} {truth}", view.0);
        }
    }
}

#[test]
fn a_ferns_shadow_is_as_dark_at_any_distance() {
    // Radiance of the open ground.
    let open = DVec3::new(0.6, 1.0, 0.3).normalize().y;
    for view in VIEWS {
        let dark = |film: &Film| 1.0 - mean(film, 0) / open;
        let (found, truth) = fern_seen(|| fern(true), DVec3::new(0.1, 1.0, 0.3), view, dark);
        assert!((found / truth - 1.0).abs() < 0.03, "{} m: {found} {truth}", view.0);
    }
}

/// Leaves of plain triangles, smaller than a pixel, cover as much at any number of lanes.
#[test]
fn leaves_thinner_than_the_space_between_lanes_are_not_missed() {
    let mut random = vtex::random::SplitMix64::new(3);
    let mut part = Part::default();
    for i in 0..400u32 {
        let [x, y] = [0, 1].map(|_| 2.0 * random.unit() as f32 - 1.0);
        // A fortieth of the picture by a hundredth, at depths of their own.
        let z = -0.001 * i as f32;
        part.positions.extend([[x, y, z], [x + 0.05, y, z], [x + 0.05, y + 0.02, z], [x, y + 0.02, z]]);
        part.triangles.extend([[4 * i, 4 * i + 1, 4 * i + 2], [4 * i, 4 * i + 2, 4 * i + 3]]);
    }
    let mut model = cards(&[], 1.0, 2.2, [0.0; 2]);
    model.materials.push(Material { unlit: true, ..Material::default() });
    model.parts.push(part);
    model.instances.push(Instance { part: 0, transform: DAffine3::IDENTITY, node: String::new() });
    let scene = scene(model);
    let options = Options { size: [16; 2], ..Options::measuring() };
    let truth = mean(&reference(&scene, &options, 0..256, &Quiet).unwrap().film, 3);
    for lanes in [4, 8, 16] {
        let found = mean(&picture(&scene, 16, lanes), 3);
        // A ray a lane, 256 pixels, of which some 60 hold edges: by chance .5 · 16 / (256 · 4) at four lanes, and less with more.
        let bound = 0.03 / f64::from(lanes).sqrt();
        assert!((found - truth).abs() < bound, "{lanes}: {found} {truth}");
    }
}
