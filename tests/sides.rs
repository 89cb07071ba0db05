//! Single-sided facets: the eye sees them from the front alone, whether they are a plain mesh, voxels, a texel's source near the
//! camera or the reference's; light is stopped by both sides.

use std::sync::Arc;

use vtex::bake::{self, Options};
use vtex::geom::{DAffine3, DMat3, DVec3};
use vtex::progress::Quiet;
use vtex::render::reference::{SourceMesh, reference_with};
use vtex::render::{CameraChoice, Film, Options as RenderOptions, render_with};
use vtex::scene::shell::{Environment, ShellMaterial, TexelRef};
use vtex::scene::{Alpha, Instance, Light, LightKind, Material, Model, Part, Scene, Texture, TextureRef};
use vtex::source::{Fill, MeshOptions, MeshSource};
use vtex::volume::{Octree, Volume, surface};

fn material(double_sided: bool) -> Material {
    Material { name: "leaf".into(), base_color: [0.5, 0.5, 0.5, 1.0], double_sided, ..Material::default() }
}

/// A square from −1 to 1 that is seen, from its front, from the unit direction `front`.
fn square(front: DVec3, centre: DVec3) -> Part {
    let (a, b) = front.any_orthonormal_pair();
    let b = if a.cross(b).dot(front) > 0.0 { b } else { -b };
    let corner = |[x, y]: [f64; 2]| (centre + x * a + y * b).as_vec3().to_array();
    Part {
        positions: [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(corner).to_vec(),
        uvs: vec![vec![[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Part::default()
    }
}

fn placed(part: usize, transform: DAffine3) -> Instance {
    Instance { part, transform, node: String::new() }
}

fn dark() -> Environment {
    Environment { sky: Some([0.0; 3].into()), background: Some([0.0; 3]), ..Environment::default() }
}

fn looking(eye: DVec3, target: DVec3, yfov: f64, size: u32) -> RenderOptions {
    let camera = CameraChoice::LookAt { eye, target, yfov };
    RenderOptions { size: [size, size], camera, ..RenderOptions::measuring() }
}

/// The share of a picture that is covered.
fn cover(film: &Film) -> f64 {
    film.pixels.iter().map(|p| f64::from(p[3])).sum::<f64>() / film.pixels.len() as f64
}

/// Whether the middle of a plain square that faces up is seen from above and from below, in a picture and in its reference.
fn seen_of_a_plain_square(material: Material, transform: DAffine3) -> [[bool; 2]; 2] {
    let model = Model {
        parts: vec![square(DVec3::Y, DVec3::ZERO)],
        materials: vec![material],
        instances: vec![placed(0, transform)],
        ..Model::default()
    };
    let scene = Scene { model, environment: dark(), ..Scene::default() };
    [3.0, -3.0].map(|y| {
        let options = looking(DVec3::new(0.0, y, 1e-3), DVec3::ZERO, 0.2, 4);
        let drawn = render_with(&scene, vec![], &options, &Quiet).unwrap().film;
        let traced = reference_with(&scene, vec![], &[], &options, 0..4, &Quiet).unwrap().film;
        [drawn, traced].map(|film| {
            let share = cover(&film);
            assert!(share == 0.0 || share == 1.0, "{share}");
            share == 1.0
        })
    })
}

#[test]
fn a_plain_square_is_seen_from_its_front() {
    let mirrored = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)));
    let turned = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)));
    let white = || {
        let texture = Texture::new("white", 1, 1, vec![[255; 4]]);
        let texture =
            TextureRef { texture: Arc::new(texture), tex_coord: 0, transform: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] };
        Some(texture)
    };
    // What a picture's fine rays see is found in another way.
    let card = |double_sided| Material { alpha: Alpha::Mask(0.5), texture: white(), ..material(double_sided) };
    for (single, double) in [(material(false), material(true)), (card(false), card(true))] {
        // A mirror turns neither the front nor what the format says of it.
        for (transform, seen) in
            [(DAffine3::IDENTITY, [true, false]), (mirrored, [true, false]), (turned, [false, true])]
        {
            assert_eq!(seen_of_a_plain_square(single.clone(), transform), seen.map(|s| [s; 2]));
            assert_eq!(seen_of_a_plain_square(double.clone(), transform), [[true; 2]; 2]);
        }
    }
}

#[test]
fn both_sides_stop_light() {
    // A roof that faces down, above a ground that faces up, the sun straight above: the eye sees through the roof into its shadow.
    let floor = Part {
        positions: vec![[-9.0, 0.0, 9.0], [9.0, 0.0, 9.0], [9.0, 0.0, -9.0], [-9.0, 0.0, -9.0]],
        ..square(DVec3::Y, DVec3::ZERO)
    };
    let up = glam::DQuat::from_rotation_arc(DVec3::Z, DVec3::Y);
    let sun = Light {
        name: String::new(),
        to_world: DAffine3::from_quat(up),
        intensity: [std::f64::consts::PI; 3],
        kind: LightKind::Directional,
        range: f64::INFINITY,
    };
    let model = Model {
        parts: vec![floor, square(DVec3::NEG_Y, DVec3::Y)],
        materials: vec![material(false)],
        instances: vec![placed(0, DAffine3::IDENTITY), placed(1, DAffine3::IDENTITY)],
        lights: vec![sun],
        ..Model::default()
    };
    let scene = Scene { model, environment: dark(), ..Scene::default() };
    for (x, light) in [(0.0, 0.0), (4.0, 0.5)] {
        let options = looking(DVec3::new(x, 5.0, 1e-3), DVec3::new(x, 0.0, 0.0), 0.02, 1);
        let drawn = render_with(&scene, vec![], &options, &Quiet).unwrap().film.pixels[0];
        let traced = reference_with(&scene, vec![], &[], &options, 0..16, &Quiet).unwrap().film.pixels[0];
        // A diffuse albedo of ½ under an irradiance of π.
        for pixel in [drawn, traced] {
            assert!(pixel[3] == 1.0 && (pixel[0] - light).abs() < 1e-4, "{x}: {pixel:?}");
        }
    }
}

fn baked(model: Model, resolution: u32) -> Volume {
    let source = MeshSource::new(model, &MeshOptions { fill: Fill::Auto });
    let options = Options { resolution, ..Options::default() };
    super::readable::readable(bake::bake(&source, &options, &Quiet, &mut |_| ()).unwrap().0)
}

/// The covered share of a picture of a texel of the model, which fills the cube from (−1, 0, −1) to (1, 2, 1), seen from the
/// unit direction `from`: as voxels, as its source near the camera, and in the reference.
fn covers_of_texel(model: &Model, volume: &Volume, from: DVec3) -> [f64; 3] {
    let shell = ShellMaterial { thickness: 2.0, surface_visible: false, ..ShellMaterial::default() };
    let ground = Material { shell: Some(Arc::new(shell)), ..Material::default() };
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0f32]];
    let part = Part {
        positions: corners.map(|[x, z]| [x, 0.0, z]).to_vec(),
        uvs: vec![corners.map(|[x, z]| [0.5 * (x + 1.0), 0.5 * (1.0 - z)]).to_vec()],
        normals: Some(vec![[0.0, 1.0, 0.0]; 4]),
        triangles: vec![[0, 3, 1], [1, 3, 2]],
        ..Part::default()
    };
    let landscape = Model {
        parts: vec![part],
        materials: vec![ground],
        instances: vec![placed(0, DAffine3::IDENTITY)],
        ..Model::default()
    };
    let texels = vec![TexelRef { name: "leaves".into(), ..TexelRef::default() }];
    let scene = Scene { model: landscape, texels, environment: dark(), ..Scene::default() };
    let source = || SourceMesh::new(model.clone(), &volume.info, &mut vtex::Warnings::default());
    let tree = || vec![Some(Octree::new(volume.clone()).unwrap())];
    // A pixel is some four of the finest voxels wide, then some.
    let options = looking(DVec3::Y + 14.0 * from, DVec3::Y, 0.26, 64);
    let drawn = render_with(&scene, tree(), &options, &Quiet).unwrap().film;
    let traced = reference_with(&scene, tree(), &[Some(source())], &options, 0..16, &Quiet).unwrap().film;
    let near = near_cover(&source(), &options, from);
    [cover(&drawn), near, cover(&traced)]
}

/// The same of the source's own triangles, one ray a pixel, as the renderer meets them near the camera.
fn near_cover(source: &SourceMesh, options: &RenderOptions, from: DVec3) -> f64 {
    let scene = Scene { model: source.model.clone(), environment: dark(), ..Scene::default() };
    // The source stands in texel space: the cube from 0 to 1, w up; the axes (u, v, w) are (x, −z, y).
    let to_texel = |v: DVec3| DVec3::new(v.x, -v.z, v.y);
    let eye = DVec3::new(0.5, 0.5, 0.5) + 7.0 * to_texel(from);
    let camera = CameraChoice::LookAt { eye, target: DVec3::splat(0.5), yfov: 0.26 };
    let options = RenderOptions { camera, lanes: 16, ..options.clone() };
    cover(&render_with(&scene, vec![], &options, &Quiet).unwrap().film)
}

/// Small leaves whose fronts are towards `front` and up to some 60 degrees from it, in the cube from (−1, 0, −1) to (1, 2, 1).
fn leaves(front: DVec3, count: usize) -> Model {
    let mut random = vtex::random::SplitMix64::new(7);
    let mut part = Part::default();
    for _ in 0..count {
        let mut draw = || 2.0 * random.unit() - 1.0;
        let centre = 0.93 * DVec3::new(draw(), draw(), draw()) + DVec3::Y;
        let normal = (front + 0.8 * DVec3::new(draw(), draw(), draw())).normalize();
        let leaf = square(normal, DVec3::ZERO);
        let base = part.positions.len() as u32;
        part.positions.extend(leaf.positions.iter().map(|p| std::array::from_fn(|k| centre[k] as f32 + 0.05 * p[k])));
        part.triangles.extend(leaf.triangles.iter().map(|t| t.map(|i| base + i)));
    }
    // Corners of the cube, so that the texel's bounds are its own.
    for y in [0.0f32, 2.0] {
        let base = part.positions.len() as u32;
        let at = |x: f32, z: f32| [x, y, z];
        part.positions.extend([at(-1.0, -1.0), at(-0.999, -1.0), at(-1.0, -0.999)]);
        part.positions.extend([at(1.0, 1.0), at(0.999, 1.0), at(1.0, 0.999)]);
        part.triangles.extend([[base, base + 1, base + 2], [base + 3, base + 4, base + 5]]);
    }
    Model {
        parts: vec![part],
        materials: vec![material(false)],
        instances: vec![placed(0, DAffine3::IDENTITY)],
        metres_per_unit: 1.0,
        ..Model::default()
    }
}

#[test]
fn leaves_of_a_texel_are_seen_from_their_front() {
    let front = DVec3::new(0.3, 0.2, 0.93).normalize();
    let model = leaves(front, 500);
    let volume = baked(model.clone(), 64);
    let sides = surface::read(&volume.info);
    assert!(sides.len() == 1 && sides[0].one_sided == 1.0, "{sides:?}");
    let aside = front.any_orthonormal_vector();
    for from in [front, (front + aside).normalize(), aside, (aside - front).normalize(), -front] {
        let [voxels, near, reference] = covers_of_texel(&model, &volume, from);
        // The texel's own area is within .03 of all; near triangles are 16 rays a pixel as the reference's samples are.
        assert!((voxels - reference).abs() < 0.04, "{from}: {voxels} {reference}");
        assert!((near - reference).abs() < 0.01, "{from}: {near} {reference}");
    }
    // From behind there is next to nothing: leaves up to 60 degrees off the front.
    let [voxels, _, reference] = covers_of_texel(&model, &volume, -front);
    let [all, ..] = covers_of_texel(&model, &volume, front);
    assert!(reference < 0.01 && voxels < 0.005 && all > 0.15, "{reference} {voxels} {all}");
    // The same leaves seen from both sides.
    let double = Model { materials: vec![material(true)], ..model };
    let volume = baked(double.clone(), 64);
    assert!(surface::read(&volume.info).is_empty());
    let [front_on, behind] = [front, -front].map(|from| covers_of_texel(&double, &volume, from)[0]);
    assert!((front_on - all).abs() < 0.02 && (behind - all).abs() < 0.04, "{front_on} {behind} {all}");
}

#[test]
fn tubes_and_solids_lose_nothing() {
    // A tube with open ends: from outside its front hides its back, at any depth.
    let sides = 12u32;
    let ring = |y: f32| {
        (0..sides).map(move |i| {
            let (sin, cos) = libm::sincosf(std::f32::consts::TAU * i as f32 / sides as f32);
            [0.1 * cos, y, -0.1 * sin]
        })
    };
    let quads = (0..sides).flat_map(|i| {
        let j = (i + 1) % sides;
        [[i, j, sides + j], [i, sides + j, sides + i]]
    });
    let part = Part { positions: ring(0.0).chain(ring(2.0)).collect(), triangles: quads.collect(), ..Part::default() };
    let model = Model {
        parts: vec![part],
        materials: vec![material(false)],
        instances: vec![placed(0, DAffine3::IDENTITY)],
        metres_per_unit: 1.0,
        ..Model::default()
    };
    let volume = baked(model, 32);
    assert!(surface::read(&volume.info).is_empty());
}
