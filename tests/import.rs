//! Every real file reads as MANIFEST.md beside it says, or is refused by a known line; no damaged one panics.

use std::path::{Path, PathBuf};

use vtex::bake::{Options, bake};
use vtex::geom::{Aabb, DVec3};
use vtex::progress::Quiet;
use vtex::scene::gltf::{ReadOptions, read};
use vtex::scene::{Model, Scene};
use vtex::source::OpenOptions;
use vtex::volume::Volume;

/// The folder of real files, where the machine has one.
fn assets() -> Option<PathBuf> {
    std::env::var_os("VTEX_ASSETS").map(PathBuf::from)
}

fn gltf(path: &Path) -> vtex::Result<Scene> {
    read(path, &ReadOptions::default())
}

/// Triangles as placed, and the box around all that is placed.
fn measure(model: &Model) -> (usize, DVec3) {
    let (mut triangles, mut bounds) = (0, Aabb::EMPTY);
    for instance in &model.instances {
        let part = &model.parts[instance.part];
        triangles += part.triangles.len();
        for p in &part.positions {
            bounds = bounds.grow(instance.transform.transform_point3(DVec3::from(p.map(f64::from))));
        }
    }
    (triangles, bounds.size())
}

/// Path and notes of each file of the manifest whose path starts with one of `folders` and ends in one of `ends`.
fn listed(dir: &Path, folders: &[&str], ends: &[&str]) -> Vec<(String, String)> {
    let manifest = std::fs::read_to_string(dir.join("MANIFEST.md")).unwrap();
    let rows = manifest.lines().filter_map(|l| l.strip_prefix("| `")?.split_once('`'));
    rows.filter(|(path, _)| folders.iter().any(|f| path.starts_with(f)) && ends.iter().any(|e| path.ends_with(e)))
        .map(|(path, rest)| (path.to_string(), rest.trim_end_matches([' ', '|']).rsplit("| ").next().unwrap().into()))
        .collect()
}

/// Where more than the manifest's count of a mesh is placed, or its accessors' bounds are not those of the vertices:
/// triangles, extent.
const PLACED: &[(&str, usize, [f64; 3])] = &[
    // Instanced: the manifest counts each mesh once.
    ("gltf-features/instancing/24_gpu_instancing.gltf", 7_656_770, [678.823, 13.298, 678.823]),
    ("gltf-features/instancing/simple-instancing.glb", 1500, [14.398, 14.398, 14.398]),
    ("gltf-features/node-transforms/cube_att.gltf", 48, [6.0, 6.0, 4.0]),
    ("gltf-features/texture-transform/TextureTransformTest.gltf", 24, [3.2, 2.191, 0.01]),
    ("terrain/Mountains.gltf", 25_600, [2.002, 0.335, 2.006]),
    // One triangle has no area.
    ("plants/kenney-nature/flower_redA.glb", 75, [0.159, 0.292, 0.181]),
    // The file's min and max are not those of its vertices, or the box is of a turned box.
    ("plants/quaternius/Fern_1.gltf", 288, [2.827, 0.840, 2.652]),
    ("plants/ez-tree/flower_blue.glb", 788, [1.441, 1.769, 1.735]),
];

#[test]
fn real_files_read_as_listed() {
    let Some(dir) = assets() else { return };
    let files = listed(&dir, &["gltf-features/", "plants/", "terrain/"], &[".gltf", ".glb"]);
    assert!(files.len() > 50);
    for (path, notes) in files {
        let scene = match gltf(&dir.join(&path)) {
            Ok(scene) => scene,
            Err(e) if path.contains("/draco/") => {
                assert!(e.to_string().contains("KHR_draco_mesh_compression"), "{e}");
                continue;
            }
            Err(e) if path.ends_with("00_no_nodes.gltf") => {
                assert!(e.to_string().contains("nothing is drawn"), "{e}");
                continue;
            }
            Err(e) => panic!("{e}"),
        };
        let (triangles, size) = measure(&scene.model);
        let listed = || {
            let size = notes.split("size ").nth(1).unwrap().split(';').next().unwrap();
            let size: Vec<f64> = size.split('x').map(|v| v.parse().unwrap()).collect();
            (notes.split('t').next().unwrap().parse().unwrap(), [size[0], size[1], size[2]])
        };
        let exact = PLACED.iter().find(|p| p.0 == path).map(|p| (p.1, p.2));
        let (expected, extent) = exact.unwrap_or_else(listed);
        assert_eq!(triangles, expected, "{path}");
        for k in 0..3 {
            // The manifest has three digits.
            assert!((size[k] - extent[k]).abs() <= 0.0051 * extent[k] + 1e-3, "{path}: {size} for {extent:?}");
        }
        let textured = notes.contains("baseColorTex");
        assert_eq!(scene.model.materials.iter().any(|m| m.texture.is_some()), textured, "{path}");
        for (warning, _) in scene.model.warnings.iter() {
            assert!(!warning.contains("cannot be read"), "{path}: {warning}");
        }
    }
}

#[test]
fn damaged_files_give_an_error_or_a_warning() {
    let Some(dir) = assets() else { return };
    let files = listed(&dir, &["bad/gltf/"], &[".gltf", ".glb"]);
    assert!(files.len() > 100);
    for (path, _) in files {
        if let Ok(scene) = gltf(&dir.join(&path)) {
            assert!(!scene.model.warnings.is_empty(), "{path}");
        }
    }
}

/// Triangles, lines, points and extent of every OBJ; counts of corners by hand (a face of n corners has n − 2).
const OBJ: &[(&str, [usize; 3], [f64; 3])] = &[
    ("obj/obj2gltf/box-complex-material-alpha/box-complex-material-alpha.obj", [12, 0, 0], [2.0, 2.0, 2.0]),
    ("obj/obj2gltf/box-negative-indices/box-negative-indices.obj", [12, 0, 0], [2.0, 2.0, 2.0]),
    ("obj/obj2gltf/box-objects-groups-materials/box-objects-groups-materials.obj", [36, 0, 0], [7.0, 2.0, 7.0]),
    ("obj/obj2gltf/box-texture-options/box-texture-options.obj", [12, 0, 0], [2.0, 2.0, 2.0]),
    ("obj/obj2gltf/box-unnamed-material/box-unnamed-material.obj", [12, 0, 0], [2.0, 2.0, 2.0]),
    ("obj/obj2gltf/box-windows-paths/box-windows-paths.obj", [12, 0, 0], [2.0, 2.0, 2.0]),
    ("obj/obj2gltf/box-with-tabs/box-with-tabs.obj", [12, 0, 0], [2.0, 2.0, 2.0]),
    ("obj/obj2gltf/concave/concave.obj", [16, 0, 0], [2.0, 0.727, 2.0]),
    ("obj/spot/spot_triangulated.obj", [5856, 0, 0], [0.943, 1.690, 1.718]),
    ("obj/tinyobjloader/catmark_torus_creases0.obj", [64, 0, 0], [2.501, 2.501, 0.707]),
    ("obj/tinyobjloader/cornell_box.obj", [36, 0, 0], [556.0, 548.8, 559.2]),
    ("obj/tinyobjloader/cube-vertexcol.obj", [12, 0, 0], [2.0, 2.0, 2.0]),
    // One of its two triangles has an index of 0.
    ("obj/tinyobjloader/issue-140-zero-face-idx.obj", [1, 0, 0], [1.0, 1.0, 0.0]),
    ("obj/tinyobjloader/issue-295-trianguation-failure.obj", [28, 0, 0], [1.0, 1.0, 3.0]),
    // One triangle of a polygon with a straight corner has no area.
    ("obj/tinyobjloader/issue-319-002.obj", [13, 0, 0], [22.736, 30.549, 46.713]),
    ("obj/tinyobjloader/leading-decimal-dot-issue-201.obj", [1, 0, 0], [0.860, 71.0, 11.429]),
    ("obj/tinyobjloader/line-prim.obj", [0, 6, 0], [2.0, 2.0, 2.0]),
    ("obj/tinyobjloader/missing_material_file.obj", [36, 0, 0], [556.0, 548.8, 559.2]),
    ("obj/tinyobjloader/mtl filename with whitespace issue46.obj", [12, 0, 0], [2.0, 2.0, 2.0]),
    ("obj/tinyobjloader/points-prim.obj", [0, 0, 8], [2.0, 2.0, 2.0]),
    ("obj/tinyobjloader/smoothing-normal.obj", [6, 0, 0], [2.0, 2.0, 2.0]),
    ("obj/tinyobjloader/texture-options-issue-85.obj", [1, 0, 0], [1.288, 2.219, 11.429]),
    ("obj/tinyobjloader/usemtl-issue-104.obj", [6, 0, 0], [552.8, 0.0, 559.2]),
    ("obj/tobj/empty_name_triangle.obj", [1, 0, 0], [1.0, 1.0, 0.0]),
    ("obj/tobj/lines.obj", [0, 3, 0], [1.0, 1.0, 0.0]),
    ("obj/tobj/quad_colored_merge.obj", [2, 0, 0], [1.0, 1.0, 0.0]),
    ("plants/kaykit-obj/Tree_1_C_Color1.obj", [1364, 0, 0], [6.691, 7.814, 5.753]),
    ("plants/quaternius-obj/Grass_Common_Tall.obj", [326, 0, 0], [0.895, 1.873, 0.993]),
    ("plants/quaternius-obj/Pine_5.obj", [1646, 0, 0], [6.420, 8.724, 6.222]),
];

fn obj(path: &Path) -> vtex::Result<Model> {
    vtex::scene::obj::read(path, &ReadOptions::default())
}

#[test]
fn real_objs_read_as_listed() {
    let Some(dir) = assets() else { return };
    let files = listed(&dir, &["obj/", "plants/"], &[".obj"]);
    assert_eq!(files.len(), OBJ.len());
    for (path, _) in files {
        let (_, counts, extent) =
            OBJ.iter().find(|o| o.0 == path).unwrap_or_else(|| panic!("{path} is not in the table"));
        let model = obj(&dir.join(&path)).unwrap();
        let (triangles, size) = measure(&model);
        let sum = |f: fn(&vtex::scene::Part) -> usize| model.parts.iter().map(f).sum::<usize>();
        assert_eq!([triangles, sum(|p| p.lines.len()), sum(|p| p.points.len())], *counts, "{path}");
        assert!((size - DVec3::from(*extent)).abs().max_element() <= 6e-4, "{path}: {size}");
    }
}

#[test]
fn the_same_tree_as_obj_and_gltf_is_the_same() {
    let Some(dir) = assets() else { return };
    let area = |model: &Model| {
        let part = |p: &vtex::scene::Part| {
            let at = |i: u32| DVec3::from(p.positions[i as usize].map(f64::from));
            p.triangles.iter().map(|&[a, b, c]| (at(b) - at(a)).cross(at(c) - at(a)).length() / 2.0).sum::<f64>()
        };
        model.parts.iter().map(part).sum::<f64>()
    };
    let a = area(&obj(&dir.join("plants/quaternius-obj/Pine_5.obj")).unwrap());
    let b = area(&gltf(&dir.join("plants/quaternius/Pine_5.gltf")).unwrap().model);
    // The text has six decimals, about 1e-6 of each edge.
    assert!((a - b).abs() < 1e-4 * a, "{a} {b}");
}

#[test]
fn damaged_objs_and_images_give_an_error_or_a_warning() {
    let Some(dir) = assets() else { return };
    let files = listed(&dir, &["bad/obj/"], &[".obj"]);
    assert_eq!(files.len(), 5);
    for (path, _) in files {
        if let Ok(model) = obj(&dir.join(&path)) {
            assert!(!model.warnings.is_empty(), "{path}");
        }
    }
    // Each damaged image as the texture of a square.
    let work = tempfile::tempdir().unwrap();
    let mut broken = 0;
    for (path, _) in listed(&dir, &["bad/png/"], &[".png"]) {
        std::fs::copy(dir.join(&path), work.path().join("t.png")).unwrap();
        std::fs::write(work.path().join("t.gltf"), SQUARE).unwrap();
        let model = gltf(&work.path().join("t.gltf")).unwrap().model;
        let textured = model.materials[0].texture.is_some();
        assert!(textured != model.warnings.iter().any(|(w, _)| w.contains("cannot be read")), "{path}");
        broken += usize::from(!textured);
    }
    // The decoder reads on where only an optional checksum is wrong.
    assert!(broken >= 12, "{broken}");
}

/// A square of side 1, textured with t.png.
const SQUARE: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"mode":5,"material":0}]}],
"materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],"textures":[{"source":0}],"images":[{"uri":"t.png"}],
"accessors":[{"bufferView":0,"componentType":5120,"type":"VEC3","count":4}],"bufferViews":[{"buffer":0,"byteLength":16,"byteStride":4}],
"buffers":[{"byteLength":16,"uri":"data:;base64,AAAAAAEAAAAAAQAAAQEAAA"}]}"#;

/// Real files with a few bytes changed or the end cut off: an error, a warning or other numbers, never a panic.
#[test]
fn damage_never_panics() {
    let Some(dir) = assets() else { return };
    let work = tempfile::tempdir().unwrap();
    // A linear congruential generator (Knuth): the same damage every time.
    let mut state = 1u64;
    let mut random = |n: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % n
    };
    let files = [
        "gltf-features/meshopt/pirate.glb",
        "gltf-features/skin/SimpleSkin.gltf",
        "gltf-features/sparse/box_sparse.glb",
        "gltf-features/instancing/simple-instancing.glb",
        "gltf-features/primitive-modes/MeshPrimitiveModes.gltf",
        "plants/ez-tree/grass.glb",
        "obj/obj2gltf/concave/concave.obj",
        "obj/tinyobjloader/issue-319-002.obj",
    ];
    for name in files {
        let whole = std::fs::read(dir.join(name)).unwrap();
        let path = work.path().join(Path::new(name).file_name().unwrap());
        for round in 0..rounds() {
            let mut bytes = whole.clone();
            for _ in 0..1 + round % 4 {
                // Mostly in the first kilobyte or two, where the structure is.
                let at = random(if round % 3 == 0 { bytes.len() } else { bytes.len().min(2000) });
                bytes[at] = if round % 2 == 0 { random(256) as u8 } else { b"0123456789-,.e[]{}\""[random(19)] };
            }
            if round % 8 == 7 {
                bytes.truncate(random(bytes.len()));
            }
            std::fs::write(&path, bytes).unwrap();
            let options = ReadOptions { max_bytes: 64 << 20, ..ReadOptions::default() };
            if name.ends_with(".obj") {
                let _ = vtex::scene::obj::read(&path, &options);
            } else {
                let _ = read(&path, &options);
            }
        }
    }
}

/// Damaged copies of each file: a few in every run, more where asked for.
fn rounds() -> usize {
    std::env::var("VTEX_DAMAGE_ROUNDS").ok().and_then(|v| v.parse().ok()).unwrap_or(60)
}

/// The source `name` of this text, baked; and what is said of it.
fn baked(name: &str, text: &str, options: &OpenOptions) -> (Volume, Vec<String>) {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join(name), text).unwrap();
    let source = vtex::source::open(&dir.path().join(name), options).unwrap();
    let options = Options { resolution: 32, ..Options::default() };
    let (volume, report) = bake(&*source, &options, &Quiet, &mut |_| ()).unwrap();
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    (volume, source.notes().to_vec())
}

/// A ball of radius 1 around `at` with six digits after the point, of 24 × 12 facets.
fn ball(at: DVec3) -> String {
    let (across, up) = (24, 12);
    let mut text = String::new();
    for j in 0..=up {
        for i in 0..across {
            let (a, b) = (
                f64::from(i) / f64::from(across) * std::f64::consts::TAU,
                f64::from(j) / f64::from(up) * std::f64::consts::PI,
            );
            let d = DVec3::new(a.cos() * b.sin(), a.sin() * b.sin(), b.cos());
            // Rounded before it is moved, so that both texts have the same digits.
            let p = at + (d * 1e6).round() / 1e6;
            text += &format!("v {:.6} {:.6} {:.6}\n", p.x, p.y, p.z);
        }
    }
    let corner = |i: i32, j: i32| j * across + i % across + 1;
    for j in 0..up {
        for i in 0..across {
            let quad = [corner(i, j), corner(i, j + 1), corner(i + 1, j + 1), corner(i + 1, j)];
            // At the poles two corners are one: those facets are triangles.
            let face: Vec<String> = match j {
                0 => [quad[0], quad[1], quad[2]].map(|c| c.to_string()).to_vec(),
                j if j == up - 1 => [quad[0], quad[1], quad[3]].map(|c| c.to_string()).to_vec(),
                _ => quad.map(|c| c.to_string()).to_vec(),
            };
            text += &format!("f {}\n", face.join(" "));
        }
    }
    text
}

#[test]
fn coordinates_far_from_0_bake_to_the_same_voxels() {
    let utm = DVec3::new(448_262.0, 5_411_932.0, 120.0);
    let wide = |width| {
        let mut options = OpenOptions::default();
        options.trajectory.width = Some(width);
        options
    };
    let strand = |at: DVec3| {
        format!(
            "x,y,z\n{:.3},{:.3},{:.3}\n{:.3},{:.3},{:.3}\n",
            at.x - 0.123,
            at.y - 0.4,
            at.z,
            at.x + 0.777,
            at.y + 0.6,
            at.z
        )
    };
    let cases = [("ball.obj", ball as fn(DVec3) -> String, OpenOptions::default()), ("strand.csv", strand, wide(0.1))];
    for (name, text, options) in cases {
        let (near, quiet) = baked(name, &text(DVec3::ZERO), &options);
        let (far, said) = baked(name, &text(utm), &options);
        assert!(near.depths == far.depths, "{name}");
        assert_eq!(near.info.facet_size, far.info.facet_size, "{name}");
        // The place is a sum of the round number and the place around 0, rounded once.
        let moved = far.info.bounds.min - near.info.bounds.min - utm;
        assert!(moved.abs().max_element() < 1e-8, "{name}: {moved}");
        assert!(quiet.is_empty() && said.len() == 1 && said[0].contains("(448262, 5411932, 120)"), "{name}: {said:?}");
    }
}

#[test]
fn a_recipe_draws_a_far_model_where_its_file_has_it() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("ball.obj"), ball(DVec3::new(448_262.0, 5_411_932.0, 120.0))).unwrap();
    let recipe = "[[draw]]\nsource = { file = \"ball.obj\" }\ntranslate = [-448262, -5411932, -120]\n";
    std::fs::write(dir.path().join("r.toml"), recipe).unwrap();
    let source = vtex::source::open(&dir.path().join("r.toml"), &OpenOptions::default()).unwrap();
    let (bounds, expected) = (source.bounds(), Aabb::new(DVec3::splat(-1.0), DVec3::splat(1.0)));
    assert!((bounds.min - expected.min).length() < 1e-6 && (bounds.max - expected.max).length() < 1e-6, "{bounds:?}");
}

#[test]
fn a_cutoff_above_all_alpha_is_named() {
    let json = SQUARE
        .replace("\"baseColorTexture\":{\"index\":0}", "\"baseColorFactor\":[1,1,1,0.75]")
        .replace("\"materials\":[{", "\"materials\":[{\"name\":\"leaf\",\"alphaMode\":\"MASK\",\"alphaCutoff\":1.01,");
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("t.gltf"), json).unwrap();
    let source = vtex::source::open(&dir.path().join("t.gltf"), &OpenOptions::default()).unwrap();
    let said = source.warnings().as_reasons();
    assert!(
        said.contains("material leaf: nothing of it is there") && said.contains("1.01") && said.contains("0.75"),
        "{said}"
    );
}

#[test]
fn emission_alone_and_unused_alpha_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let said = |json: &str| {
        std::fs::write(dir.path().join("t.gltf"), json).unwrap();
        // As a bake reads it.
        let options = ReadOptions { emission: false, ..ReadOptions::default() };
        read(&dir.path().join("t.gltf"), &options).unwrap().model.warnings.as_reasons()
    };
    let lamp = SQUARE
        .replace("\"baseColorTexture\":{\"index\":0}", "\"baseColorFactor\":[0,0,0,1]")
        .replace("\"materials\":[{", "\"materials\":[{\"name\":\"lamp\",\"emissiveFactor\":[1,1,1],");
    assert!(said(&lamp).contains("material lamp only emits light"));
    assert!(!said(&lamp.replace("[0,0,0,1]", "[0,1,0,1]")).contains("emits"));
    let card = |clear: u32| {
        let pixel = |x: u32, _| image::Rgba([10, 200, 10, if x < clear { 0 } else { 255 }]);
        image::RgbaImage::from_fn(8, 8, pixel).save(dir.path().join("t.png")).unwrap();
    };
    card(4);
    assert!(said(SQUARE).contains("has alpha, which is not used: an alphaMode of OPAQUE"));
    assert!(
        !said(&SQUARE.replace("\"materials\":[{", "\"materials\":[{\"alphaMode\":\"MASK\",")).contains("has alpha")
    );
    card(0);
    assert!(!said(SQUARE).contains("has alpha"));
}
