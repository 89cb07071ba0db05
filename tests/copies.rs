//! Rigid copies: a copy covers what its box does, one that is placed as it is equals the same texel in a flat shell, and what
//! files may say of them.

use std::path::Path;
use std::sync::Arc;

use glam::DQuat;
use serde_json::{Value, json};
use vtex::format;
use vtex::geom::{Aabb, DAffine3, DVec3};
use vtex::progress::Quiet;
use vtex::render::{CameraChoice, Options, render_with};
use vtex::scene::copies::CopySet;
use vtex::scene::gltf::{self, ReadOptions};
use vtex::scene::shell::{CellWrap, Environment, Layer, ShellMaterial, TexelRef, Variant};
use vtex::scene::{Instance, Light, LightKind, Material, Model, Part, Scene};
use vtex::volume::{Channels, Depth, Info, Octree, Volume, Voxel};

/// A texel of `finest` depths in which `voxel(i)` is the i-th voxel of the finest depth, or nothing; the source fills the unit
/// cube.
fn texel(finest: usize, voxel: impl Fn(u64) -> Option<Voxel>) -> Octree {
    let mut codes: Vec<u64> = (0..1u64 << (3 * finest)).filter(|&c| voxel(c).is_some()).collect();
    let mut voxels: Vec<Voxel> = codes.iter().filter_map(|&c| voxel(c)).collect();
    let mut depths = Vec::new();
    let mut masks = vec![0u8; codes.len()];
    loop {
        depths.push(Depth { masks, voxels: voxels.clone(), mixes: Vec::new() });
        if codes == [0] {
            break;
        }
        // A parent is as its first child.
        let firsts =
            codes.chunk_by(|a, b| a >> 3 == b >> 3).scan(0, |at, run| Some(std::mem::replace(at, *at + run.len())));
        voxels = firsts.map(|i| Voxel { rate: voxels[i].rate.saturating_add(16), ..voxels[i] }).collect();
        (codes, masks) = vtex::morton::parents(&codes);
    }
    depths.reverse();
    let info = Info { facet_size: 0.02, channels: Channels { albedo: true, ..Channels::default() }, ..Info::default() };
    Octree::new(Volume { info, depths }).unwrap()
}

fn scene(model: Model, copies: Vec<CopySet>) -> Scene {
    let texel = TexelRef { name: "t".into(), frames: vec!["t.vtex".into()], ..TexelRef::default() };
    let environment = Environment { sky: Some([0.2; 3].into()), background: Some([0.0; 3]), ..Default::default() };
    Scene { model, texels: vec![texel], copies, environment }
}

fn copies(translation: [f32; 3], rotation: [f32; 4], scale: [f32; 3]) -> CopySet {
    CopySet {
        node: "copies".into(),
        to_world: DAffine3::IDENTITY,
        variants: vec![Variant::alone(0)],
        translations: vec![translation],
        rotations: vec![rotation],
        scales: vec![scale],
        choices: vec![],
        tints: vec![],
        phases: vec![],
        wind: None,
    }
}

const SIDE: u32 = 48;

fn shot(scene: &Scene, tree: Octree, eye: DVec3, target: DVec3) -> Vec<[f32; 4]> {
    let camera = CameraChoice::LookAt { eye, target, yfov: 0.6 };
    let options = Options { size: [SIDE, SIDE], camera, ..Options::measuring() };
    render_with(scene, vec![Some(tree)], &options, &Quiet).unwrap().film.pixels
}

/// Where the ray through a pixel's middle runs in a pinhole's picture.
fn ray(eye: DVec3, target: DVec3, x: u32, y: u32) -> DVec3 {
    let forward = (target - eye).normalize();
    let right = forward.cross(DVec3::Y).normalize();
    let up = right.cross(forward);
    let at = |k: u32| (2.0 * (f64::from(k) + 0.5) - f64::from(SIDE)) / f64::from(SIDE) * 0.3f64.tan();
    (forward + at(x) * right - at(y) * up).normalize()
}

#[test]
fn a_copy_of_a_solid_cube_covers_what_its_box_does() {
    let solid = Voxel { rate: 255, ..Voxel::default() };
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 0.8, -0.2);
    let set = copies([0.5, -0.25, 1.0], turn.to_array().map(|v| v as f32), [1.0, 2.0, 0.5]);
    // The source's bounds are the unit cube, and v is −z: its floor's corner stands on the placement.
    let to_box = set.local(0).inverse();
    let sun = Light {
        name: String::new(),
        to_world: DAffine3::IDENTITY,
        intensity: [1.0; 3],
        kind: LightKind::Directional,
        range: f64::INFINITY,
    };
    let model = Model { lights: vec![sun], materials: vec![Material::default()], ..Model::default() };
    let scene = scene(model, vec![set]);
    let (eye, target) = (DVec3::new(4.0, 3.0, 6.0), DVec3::new(0.8, 0.6, 1.2));
    let pixels = shot(&scene, texel(2, |_| Some(solid)), eye, target);
    let (mut inside, mut edges) = (0, 0);
    for (i, pixel) in pixels.iter().enumerate() {
        let dir = ray(eye, target, i as u32 % SIDE, i as u32 / SIDE);
        let (o, d) = (to_box.transform_point3(eye), to_box.transform_vector3(dir));
        let (a, b) = (-o / d, (1.0 - o) / d);
        let length = a.max(b).min_element() - a.min(b).max_element();
        // The voxels are opaque, but not infinitely: a ray that cuts an edge off is not stopped within a hundredth of the cube.
        if length.abs() < 0.01 {
            edges += 1;
        } else {
            let want = f32::from(u8::from(length > 0.0));
            inside += u32::from(length > 0.0);
            assert!((pixel[3] - want).abs() < 1e-3, "pixel {i}: {pixel:?}, {length} inside");
        }
    }
    assert!((200..1200).contains(&inside) && edges < 40, "{inside} {edges}");
}

/// A floor with one cell of a shell over the unit square; the shell is `high`, along `lean`.
fn floor(lean: Option<[f32; 3]>) -> Model {
    let part = |low: f32, high: f32, y: f32, material: usize| Part {
        name: "floor".into(),
        positions: vec![[low, y, low], [high, y, low], [low, y, high], [high, y, high]],
        normals: Some(vec![[0.0, 1.0, 0.0]; 4]),
        uvs: vec![vec![[low, 1.0 - low], [high, 1.0 - low], [low, 1.0 - high], [high, 1.0 - high]]],
        triangles: vec![[0, 2, 3], [0, 3, 1]],
        heights: lean.filter(|_| material == 0).map(|h| vec![h; 4]),
        material,
        ..Part::default()
    };
    let wrap = [CellWrap::Empty; 3];
    let layers = vec![Layer { wrap, ..Layer::default() }];
    let shell = ShellMaterial { surface_visible: false, layers, ..ShellMaterial::default() };
    let covered = Material { shell: lean.map(|_| Arc::new(shell)), ..Material::default() };
    let sun = Light {
        name: String::new(),
        to_world: DAffine3::from_quat(DQuat::from_rotation_arc(DVec3::Z, DVec3::new(0.5, 1.0, 0.4).normalize())),
        intensity: [3.0; 3],
        kind: LightKind::Directional,
        range: f64::INFINITY,
    };
    let instance = |part: usize| Instance { part, transform: DAffine3::IDENTITY, node: String::new() };
    let mut model = Model {
        parts: vec![part(0.0, 1.0, 0.0, 0), part(-2.0, 3.0, -0.1, 1)],
        materials: vec![covered, Material::default()],
        instances: vec![instance(1)],
        lights: vec![sun],
        metres_per_unit: 1.0,
        ..Model::default()
    };
    if lean.is_some() {
        model.instances.push(instance(0));
    }
    model
}

#[test]
fn a_copy_as_it_is_equals_a_flat_shell() {
    // Half of the voxels are there, of all rates and colours.
    let voxel = |c: u64| {
        let h = c.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mut v = Voxel { rate: 90 + (h >> 40) as u8 % 100, ..Voxel::default() };
        v.set_albedo([(h >> 8 & 255) as f64 / 255.0, (h >> 16 & 255) as f64 / 255.0, 0.5]);
        (h >> 60 & 1 == 0).then_some(v)
    };
    let shell = scene(floor(Some([0.0, 1.0, 0.0])), vec![]);
    let copy = scene(floor(None), vec![copies([0.0; 3], [0.0, 0.0, 0.0, 1.0], [1.0; 3])]);
    for (eye, target) in [
        (DVec3::new(2.0, 1.5, 3.0), DVec3::new(0.5, 0.4, 0.5)),
        (DVec3::new(-9.0, 6.0, 4.0), DVec3::new(0.5, 0.4, 0.5)),
        (DVec3::new(0.4, 0.6, 0.45), DVec3::new(0.9, 0.2, 0.8)),
    ] {
        let [a, b] = [&shell, &copy].map(|scene| shot(scene, texel(3, voxel), eye, target));
        let apart = a.iter().zip(&b).flat_map(|(a, b)| (0..4).map(move |k| (a[k] - b[k]).abs())).fold(0.0, f32::max);
        assert!(a.iter().map(|p| p[0]).sum::<f32>() > 10.0, "there is something to see");
        // One is marched from the box's wall and the other from the cube's: the same points, rounded otherwise.
        assert!(apart < 2e-3, "{eye}: {apart}");
    }
}

/// A landscape with one stand-in of a texel and three placements, `change`d.
fn landscape(folder: &Path, change: impl Fn(&mut Value)) -> vtex::Result<Scene> {
    let floats = |v: &[f32]| v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let mut bytes = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    bytes.extend(floats(&[10.0, 0.0, 0.0, 20.0, 5.0, 0.0, 30.0, 0.0, 7.0]));
    bytes.extend(floats(&[1.0, 0.0, 9.0]));
    bytes.extend(floats(&[0.5, 1.0, 2.0, 1.0, 1.0, 1.0, 0.0, -1.0, 1.0]));
    std::fs::write(folder.join("c.bin"), &bytes).unwrap();
    let accessor =
        |view: usize, kind: &str| json!({"bufferView": view, "componentType": 5126, "count": 3, "type": kind});
    let mut file = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "extensionsUsed": ["EXT_mesh_gpu_instancing", "VTEX_volumetric_texture"],
        "extensions": {"VTEX_volumetric_texture": {"texels": [
            {"name": "a", "frames": [{"uri": "a.vtex"}]}, {"name": "b", "frames": [{"uri": "b.vtex"}]}]}},
        "nodes": [{"mesh": 0, "scale": [2, 2, 2], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {
            "TRANSLATION": 1, "_VTEX_VARIANT": 2, "_VTEX_TINT": 3}}}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "materials": [{"extensions": {"VTEX_volumetric_texture": {"copies": {
            "phong": {"diffuseFactor": [0.5, 0.5, 0.5]},
            "variants": [{"texel": 0}, {"texel": 1, "phong": {"diffuseFactor": [1.0, 0.5, 1.0]}}]}}}}],
        "buffers": [{"uri": "c.bin", "byteLength": bytes.len()}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 36},
            {"buffer": 0, "byteOffset": 72, "byteLength": 12}, {"buffer": 0, "byteOffset": 84, "byteLength": 36}],
        "accessors": [accessor(0, "VEC3"), accessor(1, "VEC3"), accessor(2, "SCALAR"), accessor(3, "VEC3")],
    });
    change(&mut file);
    std::fs::write(folder.join("c.gltf"), file.to_string()).unwrap();
    gltf::read(&folder.join("c.gltf"), &ReadOptions::default())
}

#[test]
fn a_file_says_which_texel_and_colour_each_copy_has() {
    let folder = tempfile::tempdir().unwrap();
    let scene = landscape(folder.path(), |_| ()).unwrap();
    // The stand-in is not drawn.
    assert!(scene.model.instances.is_empty());
    let [set] = &scene.copies[..] else { panic!("{:?}", scene.copies) };
    let texels: Vec<usize> = set.variants.iter().map(|v| v.texel).collect();
    assert_eq!((texels, set.variants[1].phong.diffuse), (vec![0, 1], [0.5, 0.25, 0.5]));
    // An index beyond the variants is the first; a factor below 0 is 1.
    assert_eq!((&set.choices[..], set.tints[2]), (&[1, 0, 0][..], [0.0, 1.0, 1.0]));
    assert_eq!(scene.model.warnings.iter().count(), 2);
    let placed = (set.to_world * set.local(1)).transform_point3(DVec3::new(0.0, 1.0, 0.0));
    assert_eq!(placed, DVec3::new(40.0, 12.0, 0.0));
    for (change, what) in [
        ("/materials/0/extensions/VTEX_volumetric_texture/copies/variants/0/texel", "texel"),
        ("/nodes/0/extensions/EXT_mesh_gpu_instancing/attributes/TRANSLATION", "accessor"),
    ] {
        let error = landscape(folder.path(), |file| *file.pointer_mut(change).unwrap() = json!(99)).unwrap_err();
        assert!(error.to_string().contains(what), "{error}");
    }
    // Alone, a node places one copy.
    let alone = landscape(folder.path(), |file| {
        file["nodes"][0].as_object_mut().unwrap().remove("extensions");
    });
    assert_eq!(alone.unwrap().copies[0].translations, [[0.0; 3]]);
}

/// A texel of one voxel, `wide` and `high`, for the mapping.
fn tree(path: &Path, wide: f64, high: f64) {
    let half = high / 2.0;
    let share = 0.5 * wide / high;
    let info = Info {
        bounds: Aabb::new(DVec3::new(-half, 0.0, -half), DVec3::new(half, high, half)),
        content: Aabb::new(DVec3::new(0.5 - share, 0.5 - share, 0.0), DVec3::new(0.5 + share, 0.5 + share, 1.0)),
        facet_size: 0.01,
        ..Info::default()
    };
    let depths = vec![Depth { masks: vec![0], voxels: vec![Voxel::default()], mixes: Vec::new() }];
    format::write(&Volume { info, depths }, path, &Default::default()).unwrap();
}

/// A square of `width` metres around the origin, without texture coordinates, turned by 0.2 about z.
fn slope(path: &Path, width: f32) {
    let h = width / 2.0;
    let mut bytes: Vec<u8> =
        [-h, 0.0, -h, h, 0.0, -h, -h, 0.0, h, h, 0.0, h].iter().flat_map(|x: &f32| x.to_le_bytes()).collect();
    bytes.extend([0u16, 2, 3, 0, 3, 1].iter().flat_map(|i| i.to_le_bytes()));
    std::fs::write(path.with_extension("bin"), &bytes).unwrap();
    let name = path.with_extension("bin").file_name().unwrap().to_str().unwrap().to_owned();
    let file = json!({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "rotation": [0.0, 0.0, 0.1f64.sin(), 0.1f64.cos()]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"name": "soil"}], "buffers": [{"uri": name, "byteLength": bytes.len()}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}]});
    std::fs::write(path, file.to_string()).unwrap();
}

fn map(folder: &Path, args: &str) -> (String, Scene) {
    let run = assert_cmd::Command::cargo_bin("vtex").unwrap().current_dir(folder).args(args.split(' ')).assert();
    let said = String::from_utf8(run.success().get_output().stderr.clone()).unwrap();
    (said, gltf::read(&folder.join("out.glb"), &ReadOptions::default()).unwrap())
}

/// All placements: where, how large, and the direction that is up.
fn placed(scene: &Scene) -> Vec<(DVec3, f64, DVec3)> {
    let each = |set: &CopySet| {
        let all = (0..set.len()).map(|i| set.to_world * set.local(i));
        all.map(|m| (m.translation, m.matrix3.y_axis.length(), m.matrix3.y_axis.normalize())).collect::<Vec<_>>()
    };
    scene.copies.iter().flat_map(each).collect()
}

#[test]
fn isolated_objects_stand_whole_upright_and_apart() {
    let folder = tempfile::tempdir().unwrap();
    tree(&folder.path().join("tree.vtex"), 5.0, 10.0);
    slope(&folder.path().join("in.gltf"), 100.0);
    let line = "map in.gltf --texel tree.vtex --density 200/ha -o out.glb";
    let (said, scene) = map(folder.path(), line);
    assert!(said.contains("covered soil: 200 copies of tree, up to 5.000 × 5.000 m, 10.000 m high"), "{said}");
    assert!(scene.model.materials.iter().all(|m| m.shell.is_none()) && scene.model.instances.len() == 1);
    let copies = placed(&scene);
    assert_eq!(copies.len(), 200);
    for (i, (at, scale, up)) in copies.iter().enumerate() {
        // On the plane y = tan .2 x, to within f32 at 50 m.
        assert!((at.y - 0.2f64.tan() * at.x).abs() < 1e-4, "{at}");
        assert!((0.8..=1.0).contains(scale) && (*up - DVec3::Y).length() < 1e-6);
        // .7 of the mean spacing of √50 m.
        assert!(copies[..i].iter().all(|b| b.0.distance(*at) > 0.7 * 50f64.sqrt() - 1e-4));
    }
    // The same seed gives the same bytes, another one another stand.
    let first = std::fs::read(folder.path().join("out.glb")).unwrap();
    map(folder.path(), line);
    assert_eq!(first, std::fs::read(folder.path().join("out.glb")).unwrap());
    let (_, other) = map(folder.path(), &format!("{line} --seed 1"));
    assert_ne!(placed(&other), copies);
    // Size and density are two things; sinking lowers by the slope; along the normals trees lean.
    let (_, sunk) = map(folder.path(), &format!("{line} --size 20 --sink 1"));
    for ((a, s, _), (b, t, _)) in copies.iter().zip(placed(&sunk)) {
        assert!((t / s - 2.0).abs() < 1e-5 && (a.y - b.y - 0.2f64.tan()).abs() < 1e-4);
    }
    let (_, leaning) = map(folder.path(), &format!("{line} --height-along normals"));
    let normal = DVec3::new(-0.2f64.sin(), 0.2f64.cos(), 0.0);
    assert!(placed(&leaning).iter().all(|p| (p.2 - normal).length() < 1e-5));
    // Nothing reaches over the border: 5 m wide crowns, seen from above.
    let (said, inset) = map(folder.path(), &format!("{line} --inset"));
    let half = 50.0 * 0.2f64.cos();
    let reach = |s: f64| 2.5 * 2f64.sqrt() * s;
    assert!(said.contains("overhang") && placed(&inset).len() < 200);
    assert!(
        placed(&inset).iter().all(|(p, s, _)| p.x.abs() + reach(*s) < half + 1e-3 && p.z.abs() + reach(*s) < 50.001)
    );
}

#[test]
fn stands_are_added_and_replaced() {
    let folder = tempfile::tempdir().unwrap();
    tree(&folder.path().join("tree.vtex"), 5.0, 10.0);
    tree(&folder.path().join("bush.vtex"), 2.0, 2.0);
    slope(&folder.path().join("in.gltf"), 100.0);
    // Two texels at their own sizes, a third of the ground for each of three.
    let three = "--texel tree.vtex --texel bush.vtex --texel bush.vtex";
    let (said, scene) = map(folder.path(), &format!("map in.gltf {three} --density 300 -o out.glb"));
    assert!(
        said.contains("100 copies of tree, up to 5.000") && said.contains("200 copies of bush, up to 2.000"),
        "{said}"
    );
    assert_eq!(scene.copies.len(), 2);
    let (_, more) = map(folder.path(), "map out.glb --add --texel bush.vtex --density 100 --seed 3 -o out.glb");
    let all = placed(&more);
    assert_eq!(all.len(), 400);
    let nearest = |i: usize| (0..i).map(|k| all[k].0.distance(all[i].0)).fold(f64::INFINITY, f64::min);
    assert!((300..400).all(|i| nearest(i) > 0.999), "added among the others");
    let (said, fewer) = map(folder.path(), "map out.glb --texel bush.vtex --repeat 5 -o out.glb");
    assert!(said.contains("warning: \"tree on soil\" of an earlier mapping are replaced"), "{said}");
    // One for each of 5 × 5 cells, as large as the cell; the ground is 100 × 98 m seen from above.
    let left = placed(&fewer);
    assert!((25..=26).contains(&left.len()) && left.iter().all(|p| p.1 < 10.0 && p.1 > 7.8), "{left:?}");
    let strict = ["--strict", "map", "out.glb", "--texel", "bush.vtex", "-o", "other.glb"];
    assert_cmd::Command::cargo_bin("vtex").unwrap().current_dir(&folder).args(strict).assert().code(1);
}

#[test]
fn grass_is_added_among_trees() {
    let folder = tempfile::tempdir().unwrap();
    tree(&folder.path().join("tree.vtex"), 5.0, 10.0);
    let info = Info { cyclic: [true, true, false], facet_size: 0.01, ..Info::default() };
    let depths = vec![Depth { masks: vec![0], voxels: vec![Voxel::default()], mixes: Vec::new() }];
    format::write(&Volume { info, depths }, folder.path().join("grass.vtex"), &Default::default()).unwrap();
    slope(&folder.path().join("in.gltf"), 100.0);
    map(folder.path(), "map in.gltf --texel tree.vtex --density 50 -o out.glb");
    let (said, both) = map(folder.path(), "map out.glb --texel grass.vtex --add -o out.glb");
    assert_eq!(placed(&both).len(), 50, "{said}");
    assert!(both.model.materials.iter().any(|m| m.name == "soil" && m.shell.is_some()));
    assert!(both.model.parts.iter().any(|p| p.heights.is_some()), "their heights are written too");
    // One by one, since either is laid in its own way.
    let mixed = ["map", "in.gltf", "--texel", "tree.vtex", "--texel", "grass.vtex", "-o", "mixed.glb"];
    assert_cmd::Command::cargo_bin("vtex").unwrap().current_dir(&folder).args(mixed).assert().code(2);
    // An option that only shells understand asks for one.
    let (said, bent) = map(folder.path(), "map in.gltf --texel tree.vtex --displace 0 -o out.glb");
    assert!(said.contains("--displace is for shells") && bent.copies.is_empty(), "{said}");
}
