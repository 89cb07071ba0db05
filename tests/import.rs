//! Every real file reads as MANIFEST.md beside it says, or is refused by a known line; no damaged one panics.

use std::path::{Path, PathBuf};

use vtex::geom::{Aabb, DVec3};
use vtex::scene::gltf::{ReadOptions, read};
use vtex::scene::{Model, Scene};

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
