//! Light that comes through: cards in closed form, clouds of leaves as voxels against their triangles, and the commands.

use std::path::Path;

use vtex::bake::{self, Options};
use vtex::geom::{DAffine3, DVec3, Vec3};
use vtex::progress::Quiet;
use vtex::render::reference::{SourceMesh, reference_with};
use vtex::render::{Ambient, CameraChoice, Options as RenderOptions, render_with};
use vtex::scene::shell::{Environment, ShellMaterial, TexelRef};
use vtex::scene::{Instance, Light, LightKind, Material, Model, Part, Scene, Transmission};
use vtex::source::{Fill, MeshOptions, MeshSource};
use vtex::volume::{Octree, Volume, surface};

const BASE: [f32; 3] = [0.2, 0.5, 0.3];
const THROUGH: [f32; 3] = [0.8, 0.6, 0.1];
const SHARE: f32 = 0.4;
const SUN: f64 = 3.0;

fn leaf() -> Material {
    let transmission = Transmission { factor: SHARE, color: THROUGH, ..Transmission::default() };
    Material {
        name: "leaf".into(),
        base_color: [BASE[0], BASE[1], BASE[2], 1.0],
        double_sided: true,
        transmission: Some(Box::new(transmission)),
        ..Material::default()
    }
}

fn sun(towards: DVec3) -> Light {
    Light {
        name: String::new(),
        to_world: DAffine3::from_quat(glam::DQuat::from_rotation_arc(DVec3::Z, towards.normalize())),
        intensity: [SUN; 3],
        kind: LightKind::Directional,
        range: f64::INFINITY,
    }
}

/// A square from −`half` to `half` in y = 0.
fn square(half: f32, material: usize) -> Part {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0f32]];
    Part {
        positions: corners.map(|[x, z]| [x * half, 0.0, z * half]).to_vec(),
        uvs: vec![corners.map(|[x, z]| [0.5 * (x + 1.0), 0.5 * (1.0 - z)]).to_vec()],
        triangles: vec![[0, 3, 1], [1, 3, 2]],
        material,
        ..Part::default()
    }
}

fn instance(part: usize) -> Instance {
    Instance { part, transform: DAffine3::IDENTITY, node: String::new() }
}

fn environment(sky: f64) -> Environment {
    Environment { sky: Some([sky; 3].into()), background: Some([0.0; 3]), ..Default::default() }
}

fn looking(eye: DVec3, target: DVec3, yfov: f64, size: u32) -> RenderOptions {
    let camera = CameraChoice::LookAt { eye, target, yfov };
    RenderOptions { size: [size, size], camera, ..RenderOptions::measuring() }
}

/// Seen from above with the sun at the angle `angle` from straight below: the card shines with share · colour · E · cos / π, and
/// of a sky of radiance 1 with share · colour + (1 − share) · base.
#[test]
fn a_card_lit_from_behind_shines_as_the_formula_says() {
    for (angle, sky) in [(0.0f64, 0.0), (0.7, 0.0), (1.3, 0.5)] {
        let below = DVec3::new(angle.sin(), -angle.cos(), 0.0);
        let model = Model {
            parts: vec![square(1.0, 0)],
            materials: vec![leaf()],
            instances: vec![instance(0)],
            lights: vec![sun(below)],
            ..Model::default()
        };
        let scene = Scene { model, environment: environment(sky), ..Scene::default() };
        let options = looking(DVec3::new(0.0, 3.0, 1e-3), DVec3::ZERO, 0.2, 5);
        for ambient in [Ambient::Constant, Ambient::Occluded] {
            let options = RenderOptions { ambient, ..options.clone() };
            let drawn = render_with(&scene, vec![], &options, &Quiet).unwrap().film;
            let traced = reference_with(&scene, vec![], &[], &options, 0..64, &Quiet).unwrap().film;
            for k in 0..3 {
                let (through, back) = (f64::from(SHARE * THROUGH[k]), f64::from((1.0 - SHARE) * BASE[k]));
                let truth = through * SUN * angle.cos() / std::f64::consts::PI + sky * (through + back);
                let (a, b) = (f64::from(drawn.pixels[12][k]), f64::from(traced.pixels[12][k]));
                // The grid of light from the sky takes a sheet for the ground, below which there is no light (docs/limits.md).
                let known = sky == 0.0 || ambient == Ambient::Constant;
                assert!(!known || (a - truth).abs() < 1e-5, "{angle} {ambient:?}: {a} {truth}");
                assert!((b - truth).abs() < 1e-5, "{angle} {ambient:?}: {b} {truth}");
            }
        }
    }
}

/// Small leaves in all directions, in a cube of 2 m that stands on the ground.
fn cloud(leaves: usize, material: Material) -> Model {
    let mut random = vtex::random::SplitMix64::new(7);
    let mut part = Part::default();
    let mut direction = |length: f64| {
        let z = 2.0 * random.unit() - 1.0;
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * random.unit());
        length * DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
    };
    let mut place = vtex::random::SplitMix64::new(11);
    for _ in 0..leaves {
        let centre = DVec3::new(place.unit(), place.unit(), place.unit()) * 1.8 + DVec3::new(-0.9, 0.1, -0.9);
        let normal = direction(1.0);
        let (a, b) = normal.any_orthonormal_pair();
        let base = part.positions.len() as u32;
        for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            part.positions.push((centre + 0.06 * (x * a + y * b)).as_vec3().to_array());
        }
        part.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    }
    Model {
        parts: vec![part],
        materials: vec![material],
        instances: vec![instance(0)],
        metres_per_unit: 1.0,
        ..Model::default()
    }
}

fn baked(model: Model, resolution: u32) -> Volume {
    let source = MeshSource::new(model, &MeshOptions { fill: Fill::Surface });
    let options = Options { resolution, ..Options::default() };
    super::readable::readable(bake::bake(&source, &options, &Quiet, &mut |_| ()).unwrap().0)
}

#[test]
fn a_bake_keeps_what_comes_through() {
    let volume = baked(cloud(50, leaf()), 16);
    let kept = surface::read(&volume.info);
    assert_eq!(kept.len(), 1);
    let tree = Octree::new(volume.clone()).unwrap();
    assert!(tree.has_surfaces());
    let root = vtex::volume::octree::VoxelAddress { depth: 0, rank: 0 };
    let (reflected, through) = (tree.voxel(root).albedo(), tree.surface(root).transmission());
    let want = (1.0 - SHARE) * Vec3::from_array(BASE);
    // A code of the root is a step of 2 · sqrt(v) / 255, or where the stream has 63 of them of 2 · sqrt(v) / 63; half of it each.
    assert!((reflected - want).abs().max_element() < 0.01, "{reflected} {want}");
    let ratio = through / reflected - SHARE * Vec3::from_array(THROUGH) / want;
    assert!(ratio.abs().max_element() < 0.06, "{ratio}");
}

/// A cloud of leaves lit from behind, as voxels and as the triangles that they were baked from.
#[test]
fn leaves_lit_from_behind_shine_as_their_triangles_do() {
    let bright = |material: Material, shadows: bool| {
        let model = cloud(700, material);
        let volume = baked(model.clone(), 32);
        let source = SourceMesh::new(model, &volume.info, &mut vtex::Warnings::default());
        let shell = ShellMaterial { thickness: 2.0, surface_visible: false, ..ShellMaterial::default() };
        let ground = Material { shell: Some(std::sync::Arc::new(shell)), ..Material::default() };
        let mut part = square(1.0, 0);
        part.normals = Some(vec![[0.0, 1.0, 0.0]; 4]);
        let model = Model {
            parts: vec![part],
            materials: vec![ground],
            instances: vec![instance(0)],
            lights: vec![sun(DVec3::new(0.2, 0.3, -1.0))],
            ..Model::default()
        };
        let texels = vec![TexelRef { name: "leaves".into(), ..TexelRef::default() }];
        let scene = Scene { model, texels, environment: environment(0.05), ..Scene::default() };
        let camera = looking(DVec3::new(0.0, 1.0, 12.0), DVec3::Y, 0.2, 48);
        let options = RenderOptions { shadows, ..camera };
        let tree = || vec![Some(Octree::new(volume.clone()).unwrap())];
        let drawn = render_with(&scene, tree(), &options, &Quiet).unwrap().film;
        let traced = reference_with(&scene, tree(), &[Some(source)], &options, 0..16, &Quiet).unwrap().film;
        let mean = |film: &vtex::render::Film| -> Vec3 {
            film.pixels.iter().map(|p| Vec3::new(p[0], p[1], p[2])).sum::<Vec3>() / film.pixels.len() as f32
        };
        (mean(&drawn), mean(&traced))
    };
    let (drawn, traced) = bright(leaf(), false);
    // The eight normals' own error is .017 of 2/3, and the covered area's .03.
    assert!((drawn / traced - 1.0).abs().max_element() < 0.06, "{drawn} {traced}");
    // What comes from behind has crossed the whole cloud, of an optical depth about 2: a few hundredths of opacity, the
    // texel's own error, are a tenth and more of that light. A shadow ray that began on the wrong side would lose most of it.
    let (drawn, traced) = bright(leaf(), true);
    assert!((drawn / traced - 1.0).abs().max_element() < 0.25, "{drawn} {traced}");
    let (dark, _) = bright(Material { transmission: None, ..leaf() }, true);
    assert!(drawn.x > 2.0 * dark.x, "{drawn} {dark}");
}

fn vtex(folder: &Path, arguments: &[&str]) -> (i32, String) {
    let output =
        std::process::Command::new(env!("CARGO_BIN_EXE_vtex")).args(arguments).current_dir(folder).output().unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn the_commands_say_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let sample = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/fern.glb");
    for (value, code, words) in [
        ("1.5", 2, "a share of 0 to 0.9"),
        ("nan", 2, "a share of 0 to 0.9"),
        ("-1", 2, "a share of 0 to 0.9"),
        ("moss=0.4", 2, "no such material"),
        ("leaf", 2, "0.4"),
    ] {
        let option = format!("--translucency={value}");
        let (found, errors) = vtex(folder, &["bake", sample, "-r", "8", "-o", "a.vtex", &option]);
        assert_eq!(found, code, "{value}: {errors}");
        assert!(errors.contains(words), "{value}: {errors}");
        assert!(!folder.join("a.vtex").exists());
    }
    let (code, errors) = vtex(folder, &["bake", sample, "-r", "8", "-o", "a.vtex", "--translucency", "0.4"]);
    assert_eq!(code, 0, "{errors}");
    let volume = vtex::format::Reader::open(folder.join("a.vtex"), &Default::default()).unwrap().read_all().unwrap();
    let surfaces = surface::read(&volume.info);
    for (material, surface) in volume.info.materials.iter().zip(&surfaces) {
        for k in 0..3 {
            // 40 % come through of what 60 % are reflected of; four places are kept.
            let want = material.albedo[k] * 0.4 / 0.6;
            assert!((surface.transmission[k] - want).abs() < 2e-4, "{}: {surface:?}", material.name);
        }
    }
    assert!(!surfaces.is_empty());
}

/// A triangle whose material has the extension `said`.
fn triangle(folder: &Path, said: serde_json::Value) -> vtex::Result<Model> {
    use base64::Engine;
    let positions: Vec<u8> =
        [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let uri = format!("data:application/octet-stream;base64,{}", base64::prelude::BASE64_STANDARD.encode(positions));
    let json = serde_json::json!({
        "asset": {"version": "2.0"}, "extensionsUsed": ["KHR_materials_diffuse_transmission"],
        "extensionsRequired": ["KHR_materials_diffuse_transmission"],
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "materials": [{"name": "leaf", "extensions": {"KHR_materials_diffuse_transmission": said}}],
        "images": [{"uri": "leaf.png"}, {"uri": "missing.png"}], "textures": [{"source": 0}, {"source": 1}],
        "buffers": [{"uri": uri, "byteLength": 36}], "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}],
    });
    std::fs::write(folder.join("leaf.gltf"), json.to_string()).unwrap();
    vtex::scene::gltf::read(&folder.join("leaf.gltf"), &Default::default()).map(|scene| scene.model)
}

#[test]
fn the_extension_is_read_and_its_ranges_are_checked() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    image::RgbaImage::from_pixel(1, 1, image::Rgba([255, 188, 0, 128])).save(folder.join("leaf.png")).unwrap();
    let model = triangle(
        folder,
        serde_json::json!({"diffuseTransmissionFactor": 0.5, "diffuseTransmissionColorFactor": [0.5, 1.0, 1.0],
            "diffuseTransmissionTexture": {"index": 0}, "diffuseTransmissionColorTexture": {"index": 0, "texCoord": 1}}),
    )
    .unwrap();
    let transmission = model.materials[0].transmission.as_deref().unwrap();
    let sample = |t: &vtex::scene::TextureRef| t.texture.sample([0.5, 0.5]);
    let (reflected, through) = transmission.split([0.4, 0.8, 1.0], &sample);
    // The alpha 128 is a share of .502 of the half; 188 is a linear .503.
    let share = 0.5 * 128.0 / 255.0;
    let near = |a: [f32; 3], b: [f32; 3]| (0..3).all(|k| (a[k] - b[k]).abs() < 1e-3);
    assert!(near(reflected, [0.4, 0.8, 1.0].map(|c| c * (1.0 - share))), "{reflected:?}");
    assert!(near(through, [0.5 * share, 0.5029 * share, 0.0]), "{through:?}");
    assert_eq!(model.parts[0].uvs.len(), 2);
    assert!(triangle(folder, serde_json::json!({})).unwrap().materials[0].transmission.is_none());
    let missing = serde_json::json!({"diffuseTransmissionFactor": 1, "diffuseTransmissionTexture": {"index": 1}});
    assert!(!triangle(folder, missing).unwrap().warnings.is_empty());
    for (bad, words) in [
        (serde_json::json!({"diffuseTransmissionFactor": 1.5}), "1.5 is not in [0, 1]"),
        (serde_json::json!({"diffuseTransmissionFactor": -1}), "-1 is not in [0, 1]"),
        (serde_json::json!({"diffuseTransmissionColorFactor": [0, 2, 0]}), "2 is not in [0, 1]"),
        (serde_json::json!({"diffuseTransmissionColorFactor": [0, 0]}), "invalid length"),
        (
            serde_json::json!({"diffuseTransmissionFactor": 1, "diffuseTransmissionTexture": {"index": 9}}),
            "does not exist",
        ),
        (serde_json::json!(7), "KHR_materials_diffuse_transmission"),
    ] {
        let error = triangle(folder, bad).err().unwrap().to_string();
        assert!(error.contains(words) && error.lines().count() == 1, "{error}");
    }
}
