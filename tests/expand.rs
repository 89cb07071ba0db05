//! `vtex expand`: the reference picture of a landscape, and that of its expansion, which is traced without any texel, are one.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DQuat;
use vtex::Warnings;
use vtex::geom::{Aabb, DAffine3, DMat3, DVec3};
use vtex::progress::Quiet;
use vtex::random::SplitMix64;
use vtex::render::expand::{ExpandOptions, Expanded, Plan};
use vtex::render::reference::{Reference, reference};
use vtex::render::{Ambient, CameraChoice, Film, Options};
use vtex::scene::copies::CopySet;
use vtex::scene::gltf::{self, save::save};
use vtex::scene::phong::Phong;
use vtex::scene::shell::{
    CellWrap, Continuous, Discrete, Environment, Layer, Orientations, ShellMaterial, TexelRef, Variant,
};
use vtex::scene::wind::Wind;
use vtex::scene::{Camera, Instance, Light, LightKind, Material, Model, Part, Projection, Scene};
use vtex::volume::{Info, Volume};

use crate::json;
use crate::outputs::Folder;

/// Leaves in a cube of 2 m that stands on the origin: two materials, nothing the same from two sides, opaque.
fn plant(seed: u64) -> Model {
    let mut random = SplitMix64::new(seed);
    let mut model = Model::default();
    for color in [[0.3, 0.6, 0.2, 1.0], [0.7, 0.2, 0.1, 1.0]] {
        let mut part = Part { material: model.materials.len(), ..Part::default() };
        for _ in 0..40 {
            let mut random = || DVec3::new(random.signed(), random.signed(), random.signed());
            let centre = 0.8 * random() + DVec3::Y;
            for _ in 0..3 {
                let p = (centre + 0.25 * random()).clamp(DVec3::new(-1.0, 0.0, -1.0), DVec3::new(1.0, 2.0, 1.0));
                part.positions.push(p.as_vec3().to_array());
            }
            let first = part.positions.len() as u32 - 3;
            part.triangles.push([first, first + 1, first + 2]);
        }
        model.instances.push(Instance { part: model.parts.len(), transform: DAffine3::IDENTITY, node: "plant".into() });
        model.parts.push(part);
        model.materials.push(Material { base_color: color, double_sided: true, ..Material::default() });
    }
    model
}

/// Two texels without voxels, and their sources in files.
struct Plants {
    folder: tempfile::TempDir,
}

impl Plants {
    fn new() -> Plants {
        let folder = tempfile::tempdir().unwrap();
        for k in 0..2 {
            save(&plant(k), &folder.path().join(format!("{k}.glb")), &mut Warnings::default()).unwrap();
        }
        Plants { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn texels(&self, cyclic: [bool; 3]) -> Vec<TexelRef> {
        let bounds = Aabb::new(DVec3::new(-1.0, 0.0, -1.0), DVec3::new(1.0, 2.0, 1.0));
        let texel = |k: usize| {
            let info = Info { bounds, cyclic, ..Info::default() };
            let volume = Arc::new(Volume { info, depths: vec![] });
            TexelRef {
                geometry: Some(self.path(&format!("{k}.glb"))),
                ..TexelRef::in_memory(format!("plant {k}"), volume)
            }
        };
        vec![texel(0), texel(1)]
    }
}

/// A ground of 3 × 3 tiles of 2 m, `bulge` metres uneven, its texel coordinates a tile each.
fn ground(bulge: f64) -> Part {
    let mut part = Part { name: "ground".into(), uvs: vec![vec![]], ..Part::default() };
    for z in 0..=3 {
        for x in 0..=3 {
            let (u, v) = (f64::from(x), f64::from(z));
            let height = bulge * ((1.3 * u).sin() + (0.9 * v + 0.4).cos());
            part.positions.push(DVec3::new(2.0 * u, height, 2.0 * v).as_vec3().to_array());
            part.uvs[0].push([x as f32, 3.0 - z as f32]);
            if x < 3 && z < 3 {
                let at = |x: u32, z: u32| z * 4 + x;
                part.triangles.push([at(x, z), at(x, z + 1), at(x + 1, z)]);
                part.triangles.push([at(x + 1, z), at(x, z + 1), at(x + 1, z + 1)]);
            }
        }
    }
    part
}

fn scene(ground: Part, layers: Vec<Layer>, texels: Vec<TexelRef>) -> Scene {
    let shell = ShellMaterial { thickness: 2.0, layers, ..ShellMaterial::default() };
    let shell = (!shell.layers.is_empty()).then(|| Arc::new(shell));
    let material = Material { base_color: [0.4, 0.3, 0.2, 1.0], double_sided: true, shell, ..Material::default() };
    let towards = DVec3::new(-0.4, 0.8, 0.5).normalize();
    let sun = Light {
        name: "sun".into(),
        to_world: DAffine3::from_quat(DQuat::from_rotation_arc(DVec3::Z, towards)),
        intensity: [3.0, 2.5, 2.0],
        kind: LightKind::Directional,
        range: f64::INFINITY,
    };
    let model = Model {
        parts: vec![ground],
        materials: vec![material],
        instances: vec![Instance { part: 0, transform: DAffine3::IDENTITY, node: "ground".into() }],
        lights: vec![sun],
        metres_per_unit: 1.0,
        ..Model::default()
    };
    Scene { model, texels, copies: Vec::new(), environment: environment() }
}

fn environment() -> Environment {
    Environment { sky: Some([0.3, 0.4, 0.6].into()), background: Some([0.1, 0.2, 0.9]), ..Default::default() }
}

fn options() -> Options {
    let target = DVec3::new(3.0, 0.5, 3.0);
    let camera = CameraChoice::LookAt { eye: target + DVec3::new(3.0, 4.0, 7.0), target, yfov: 0.8 };
    Options { size: [96, 64], camera, ..Options::measuring() }
}

fn expanded(scene: &Scene, tolerance: f64) -> Expanded {
    let options = ExpandOptions { tolerance, threads: 2, ..ExpandOptions::default() };
    Plan::new(scene, &options).unwrap().run(&Quiet).unwrap()
}

fn traced(scene: &Scene) -> Reference {
    reference(scene, &options(), 0..4, &Quiet).unwrap()
}

fn plain(model: Model) -> Scene {
    Scene { model, environment: environment(), ..Scene::default() }
}

fn rms(a: &Film, b: &Film) -> f64 {
    let square = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).map(|k| f64::from(a[k] - b[k]).powi(2)).sum::<f64>();
    (a.pixels.iter().zip(&b.pixels).map(square).sum::<f64>() / (3 * a.pixels.len()) as f64).sqrt()
}

fn mean(a: &Film) -> f64 {
    a.pixels.iter().map(|p| f64::from(p[1])).sum::<f64>() / a.pixels.len() as f64
}

/// Both pictures are of the same samples: they differ only where a ray grazes an edge, of which positions are rounded or bent
/// by `tolerance`, far less than what the samples of a pixel differ by. Another landscape differs by more than that.
fn agree(name: &str, scene: &Scene, tolerance: f64, other: &Scene) {
    let (shown, explicit) = (traced(scene), expanded(scene, tolerance));
    assert!(explicit.warnings.is_empty(), "{name}: {:?}", explicit.warnings);
    let traced_explicit = traced(&plain(explicit.model));
    let noise = 0.5 * rms(&shown.halves[0], &shown.halves[1]);
    let apart = rms(&shown.film, &traced_explicit.film);
    assert!(apart < 0.5 * noise, "{name}: {apart}, noise {noise}");
    let bias = mean(&traced_explicit.film) / mean(&shown.film) - 1.0;
    assert!(bias.abs() < 0.003, "{name}: bias {bias}");
    let unlike = rms(&traced(other).film, &traced_explicit.film);
    assert!(unlike > 2.0 * noise, "{name}: another landscape is as like: {unlike}, noise {noise}");
}

fn bare() -> Scene {
    scene(ground(0.0), Vec::new(), Vec::new())
}

#[test]
fn shells_and_wraps() {
    let plants = Plants::new();
    let texels = || plants.texels([false; 3]);
    let with = |wrap: [CellWrap; 3]| Layer { wrap, ..Layer::default() };
    use CellWrap::{Empty, Mirror, Repeat};
    agree("flat", &scene(ground(0.0), vec![Layer::default()], texels()), 2e-4, &bare());
    let hills = scene(ground(0.35), vec![Layer::default()], texels());
    agree("hills", &hills, 2e-4, &scene(ground(0.0), vec![Layer::default()], texels()));
    let mirrored = scene(ground(0.2), vec![with([Mirror, Mirror, Empty])], texels());
    agree("mirror", &mirrored, 2e-4, &scene(ground(0.2), vec![Layer::default()], texels()));
    let one = scene(ground(0.2), vec![with([Empty, Repeat, Empty])], texels());
    agree("empty", &one, 2e-4, &mirrored);
    // Two texels a height, turned, and two layers of which each has a part of the height.
    let high = Layer { scale: [1.0, 1.0, 2.0], offset: [0.3, 0.1, 0.5], wrap: [Repeat; 3], ..Layer::default() };
    agree("offset", &scene(ground(0.2), vec![high], texels()), 2e-4, &mirrored);
    let low = Layer { skin_range: [0.0, 0.4], ..Layer::default() };
    let top = Layer { texel: 1, skin_range: [0.5, 1.0], scale: [2.0, 2.0, 1.0], ..Layer::default() };
    agree(
        "layers",
        &scene(ground(0.2), vec![low.clone(), top], texels()),
        1e-4,
        &scene(ground(0.2), vec![low], texels()),
    );
}

/// Tiles that are no planes, as bilinear patches.
#[test]
fn bilinear_patches() {
    let plants = Plants::new();
    let with = |patches: bool| {
        let mut land = ground(0.35);
        land.triangles.clear();
        for z in 0..3 {
            for x in 0..3 {
                let at = |x: u32, z: u32| z * 4 + x;
                let ring = [at(x, z + 1), at(x + 1, z + 1), at(x + 1, z), at(x, z)];
                land.triangles.extend([[ring[0], ring[1], ring[2]], [ring[0], ring[2], ring[3]]]);
                if patches {
                    land.patches.push(ring);
                }
            }
        }
        let mut made = scene(land, vec![Layer::default()], plants.texels([false; 3]));
        // The ground itself would be seen as two triangles a patch.
        let shell = made.model.materials[0].shell.as_mut().unwrap();
        Arc::get_mut(shell).unwrap().surface_visible = false;
        made
    };
    agree("patches", &with(true), 2e-4, &bare());
}

#[test]
fn discrete_jitter() {
    let plants = Plants::new();
    let with = |discrete: Discrete| {
        scene(ground(0.1), vec![Layer { discrete: Some(discrete), ..Layer::default() }], plants.texels([false; 3]))
    };
    let variant = |texel: usize, diffuse| Variant { texel, weight: 1.0 + texel as f64, phong: Phong::tint(diffuse) };
    for (k, orientations) in
        [Orientations::Identity, Orientations::W4, Orientations::W8, Orientations::Cube24, Orientations::Cube48]
            .into_iter()
            .enumerate()
    {
        let jitter = |seed: u32| Discrete {
            seed,
            orientations,
            mirror: [k % 2 == 0, k % 3 == 0, false],
            scale: [0.6, 1.0],
            displace: [0.4, 0.3, 0.1],
            presence: 0.8,
            variants: vec![variant(0, [1.0, 0.8, 0.5]), variant(1, [0.4, 1.0, 1.0])],
            tint: vec![],
        };
        agree(&format!("{orientations:?}"), &with(jitter(5)), 2e-4, &with(jitter(6)));
    }
}

#[test]
fn continuous_jitter() {
    let plants = Plants::new();
    let mut land = ground(0.15);
    land.jitter = Some((0..16).map(|i| if i % 5 == 0 { 0.2 } else { 1.0 }).collect());
    let with = |seed: u32| {
        let continuous = Continuous {
            seed,
            frequency: [0.5, 0.6, 0.5],
            octaves: 1,
            uvw_amplitude: [0.3, 0.2, 0.0],
            height_tilt: 0.3,
            height_scale: 0.25,
        };
        let layer = Layer { continuous: Some(continuous), ..Layer::default() };
        scene(land.clone(), vec![layer], plants.texels([true, true, false]))
    };
    agree("continuous", &with(3), 3e-4, &with(4));
}

#[test]
fn wind_bends_shells() {
    let plants = Plants::new();
    let wind = Wind { strength: 0.6, gust_scale: 4.0, ..Wind::default() };
    let at = |time: f64| {
        let mut made = scene(ground(0.1), vec![Layer::default()], plants.texels([false; 3]));
        made.model.materials[0].wind = Some(wind.at(time));
        made
    };
    agree("wind", &at(1.5), 2e-4, &at(0.0));
}

/// Copies of all kinds: turned, mirrored, of three scales, below a node that shears them, tinted, leaning.
fn copies(plants: &Plants, windy: bool) -> Scene {
    let wind = windy.then(|| Wind { strength: 0.3, gust_scale: 5.0, ..Wind::default() }.at(0.7));
    let set = |to_world: DAffine3, shift: f32| CopySet {
        node: "plants".into(),
        to_world,
        variants: vec![Variant::alone(0), Variant { phong: Phong::tint([0.5, 1.0, 0.7]), ..Variant::alone(1) }],
        translations: (0..5).map(|i| [1.0 + 1.2 * i as f32, 0.0, 1.0 + shift]).collect(),
        rotations: (0..5).map(|i| [0.0, (0.3 * i as f32).sin(), 0.1, (0.3 * i as f32).cos()]).collect(),
        scales: (0..5).map(|i| [0.6, 0.4 + 0.1 * i as f32, if i == 2 { -0.6 } else { 0.6 }]).collect(),
        choices: vec![0, 1, 0, 1, 0],
        tints: vec![[1.0; 3], [1.0, 0.5, 0.5], [0.3, 1.0, 0.6]],
        phases: vec![],
        wind,
    };
    let shear = DMat3::from_diagonal(DVec3::new(1.0, 1.3, 0.7)) * DMat3::from_rotation_z(0.2);
    let mut made = scene(ground(0.0), Vec::new(), plants.texels([false; 3]));
    made.copies = vec![
        set(DAffine3::IDENTITY, 0.0),
        set(DAffine3 { matrix3: shear, translation: DVec3::new(0.3, 0.2, 1.5) }, 2.0),
    ];
    made
}

#[test]
fn rigid_copies() {
    let plants = Plants::new();
    for windy in [false, true] {
        let made = copies(&plants, windy);
        agree("copies", &made, 1e-3, &bare());
        let explicit = expanded(&made, 1e-3);
        assert_eq!((explicit.amount.copies, explicit.amount.bent_triangles), (10, 0));
        assert_eq!(explicit.amount.shown_triangles, 10 * 80 + 18);
    }
}

/// What is written is what is read again: as a picture, in two forms, with its camera and its light.
#[test]
fn files_say_what_was_expanded() {
    let plants = Plants::new();
    let mut made = copies(&plants, true);
    made.model.instances.clear();
    let shells = scene(ground(0.2), vec![Layer { texel: 1, ..Layer::default() }], plants.texels([false; 3]));
    made.model = shells.model;
    // Far from the origin, where 32 bits are not enough.
    let away = DVec3::new(400_000.0, 0.0, -5_000_000.0);
    let away = DAffine3::from_translation(away);
    made.model.instances[0].transform = away;
    made.copies.iter_mut().for_each(|set| set.to_world = away * set.to_world);
    let view = options();
    let CameraChoice::LookAt { eye, target, yfov } = view.camera else { panic!() };
    let turn = DQuat::from_mat3(&look(eye, target));
    made.model.cameras.push(Camera {
        name: "view".into(),
        to_world: away * DAffine3::from_rotation_translation(turn, eye),
        projection: Projection::Perspective { yfov },
        aspect: Some(1.5),
    });
    let options = Options { camera: CameraChoice::Named("view".into()), ..options() };
    let traced = |scene: &Scene| reference(scene, &options, 0..4, &Quiet).unwrap();
    let (shown, model) = (traced(&made), expanded(&made, 1e-4).model);
    let noise = 0.5 * rms(&shown.halves[0], &shown.halves[1]);
    for name in ["out.glb", "out.gltf"] {
        let path = plants.path(name);
        save(&model, &path, &mut Warnings::default()).unwrap();
        let read = gltf::read(&path, &gltf::ReadOptions::default()).unwrap();
        assert!(read.model.warnings.is_empty(), "{:?}", read.model.warnings);
        let found = traced(&Scene { environment: environment(), ..read });
        let apart = rms(&shown.film, &found.film);
        assert!(apart < 0.5 * noise, "{name}: {apart}, noise {noise}");
    }
}

/// A camera's axes.
fn look(eye: DVec3, target: DVec3) -> DMat3 {
    let back = (eye - target).normalize();
    let right = DVec3::Y.cross(back).normalize();
    DMat3::from_cols(right, back.cross(right), back)
}

#[test]
fn a_camera_keeps_what_it_sees() {
    let plants = Plants::new();
    let mut made = copies(&plants, false);
    let shells = scene(ground(0.2), vec![Layer { texel: 1, ..Layer::default() }], plants.texels([false; 3]));
    made.model = shells.model;
    let (eye, target) = (DVec3::new(0.9, 3.0, 9.0), DVec3::new(1.0, 0.5, 4.0));
    let camera = CameraChoice::LookAt { eye, target, yfov: 0.2 };
    let options = Options { camera: camera.clone(), ..options() };
    let cut = |margin: f64| {
        let options = ExpandOptions { view: Some((camera.clone(), [96, 64])), margin, ..ExpandOptions::default() };
        Plan::new(&made, &options).unwrap().run(&Quiet).unwrap()
    };
    let (whole, seen) = (expanded(&made, 1e-3), cut(0.0));
    assert!(seen.amount.copies < whole.amount.copies && seen.amount.faces < whole.amount.faces);
    assert!(seen.amount.bent_triangles < whole.amount.bent_triangles, "{:?} {:?}", seen.amount, whole.amount);
    assert_eq!(cut(100.0).amount, whole.amount);
    // Shadows come from what is not seen, too.
    let options = Options { shadows: false, ambient: Ambient::Constant, ..options };
    let traced = |model: Model| reference(&plain(model), &options, 0..2, &Quiet).unwrap().film;
    assert!(traced(whole.model) == traced(seen.model));
}

#[test]
fn limits_are_kept() {
    let plants = Plants::new();
    let made = scene(ground(0.2), vec![Layer::default()], plants.texels([false; 3]));
    // 9 cells of 80 triangles.
    let few = ExpandOptions { max_triangles: 700, ..ExpandOptions::default() };
    let error = Plan::new(&made, &few).err().unwrap().to_string();
    assert!(error.contains("needs 720") && error.contains("option `camera`"), "{error}");
    let little = ExpandOptions { max_bytes: 1000, ..ExpandOptions::default() };
    assert!(Plan::new(&made, &little).err().unwrap().to_string().contains("memory"));
    // An estimate that is within the limit, and more in the end: triangles are cut.
    let cut = ExpandOptions { max_triangles: 730, ..ExpandOptions::default() };
    let error = Plan::new(&made, &cut).unwrap().run(&Quiet).err().unwrap().to_string();
    assert!(error.contains("the limit is 730"), "{error}");
    let mut blind = made.clone();
    blind.texels[0].geometry = None;
    assert!(Plan::new(&blind, &ExpandOptions::default()).err().unwrap().to_string().contains("names no geometry"));
    for wrong in [
        ExpandOptions { tolerance: 0.0, ..ExpandOptions::default() },
        ExpandOptions { tolerance: f64::NAN, ..ExpandOptions::default() },
        ExpandOptions { view: Some((CameraChoice::Named("none".into()), [16, 9])), ..ExpandOptions::default() },
    ] {
        assert!(Plan::new(&made, &wrong).is_err());
    }
}

/// Any number of threads gives the same file.
#[test]
fn threads_do_not_matter() {
    let plants = Plants::new();
    let made = scene(ground(0.2), vec![Layer { texel: 1, ..Layer::default() }], plants.texels([false; 3]));
    let bytes = |threads: usize| {
        let options = ExpandOptions { threads, ..ExpandOptions::default() };
        let path = plants.path(&format!("{threads}.out.glb"));
        save(&Plan::new(&made, &options).unwrap().run(&Quiet).unwrap().model, &path, &mut Warnings::default()).unwrap();
        std::fs::read(path).unwrap()
    };
    assert!(bytes(1) == bytes(3));
}

#[test]
fn the_command_says_what_it_did() {
    let folder = Folder::new();
    let sample = |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(name);
    for name in ["fern.glb", "terrain.glb"] {
        std::fs::copy(sample(name), folder.path(name)).unwrap();
    }
    folder.succeeds(&["bake", "fern.glb", "-r", "16"]);
    let map = ["map", "terrain.glb", "--texel", "fern.vtex", "--geometry", "fern.glb", "--material", "meadow"];
    folder.succeeds(&[&map[..], &["--presence", "0.2", "-o", "land.gltf"]].concat());
    let (code, stdout, errors) = folder.run(&["expand", "land.gltf", "-o", "out.glb", "--json", "--depfile", "out.d"]);
    assert_eq!(code, 0, "{errors}");
    let told = json::of("expand", &stdout);
    for key in ["copies", "shell_faces", "stored_triangles_of_copies", "shown_triangles", "file_bytes"] {
        assert!(told[key].as_u64().is_some(), "{key}: {told}");
    }
    assert!(told["shown_triangles"].as_u64().unwrap() > 100 * told["stored_triangles_of_copies"].as_u64().unwrap());
    let rule = std::fs::read_to_string(folder.path("out.d")).unwrap();
    assert!(
        rule.starts_with("out.glb: land.gltf") && rule.contains("fern.glb") && rule.contains("fern.vtex"),
        "{rule}"
    );
    assert!(!gltf::is_landscape(&folder.path("out.glb")));
    folder.succeeds(&["expand", "land.gltf", "-o", "near.gltf", "--camera", "near", "--margin", "5"]);
    let near = std::fs::metadata(folder.path("near.bin")).unwrap().len();
    assert!(near < told["file_bytes"].as_u64().unwrap());
    let land = std::fs::read(folder.path("land.gltf")).unwrap();
    for (args, code, words) in [
        (&["expand", "land.gltf", "-o", "out.obj"][..], 2, ".glb or .gltf"),
        (&["expand", "land.gltf", "-o", "land.gltf"], 2, "also an input"),
        (&["expand", "land.gltf", "-o", "a.glb", "--camera", "none"], 2, "no camera \"none\""),
        (&["expand", "land.gltf", "-o", "a.glb", "--max-triangles", "10"], 1, "triangles"),
        (&["expand", "land.gltf", "-o", "a.glb", "--memory", "10M", "--max-triangles", "1"], 1, "the limit is 1"),
        (&["expand", "none.gltf", "-o", "a.glb"], 1, "none.gltf"),
        (&["expand", "land.gltf", "-o", "a.glb", "--tolerance", "0"], 2, "above 0"),
        (&["expand", "land.gltf", "-o", "no/such/a.glb"], 1, "no/such"),
    ] {
        let (found, _, error) = folder.run(args);
        assert!(found == code && error.contains(words), "{args:?}: {found} {error}");
        assert!(!folder.path("a.glb").exists());
    }
    assert!(std::fs::read(folder.path("land.gltf")).unwrap() == land);
}
