//! `vtex render --reference` from the outside: a terrain of ferns, in pieces and at once.

use std::path::Path;
use std::process::Command;

use vtex::format;
use vtex::geom::{Aabb, DVec3};
use vtex::render::image_io::read;
use vtex::scene::gltf;
use vtex::volume::{Depth, Info, Volume, Voxel};

fn vtex(folder: &Path, arguments: &str) -> (i32, String, String) {
    let output =
        Command::new(env!("CARGO_BIN_EXE_vtex")).args(arguments.split(' ')).current_dir(folder).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

/// A texel placed as a bake of `mesh` would place it; of its voxels there is one.
fn texel(mesh: &Path, path: &Path) {
    let model = gltf::read(mesh, &Default::default()).unwrap().model;
    let points = model.instances.iter().flat_map(|i| {
        let part = &model.parts[i.part];
        part.positions.iter().map(|p| i.transform.transform_point3(DVec3::from_array(p.map(f64::from))))
    });
    let content = Aabb::around(points);
    let edge = content.size().max_element();
    let mut min = content.centre() - 0.5 * edge;
    min.y = content.min.y;
    let info = Info { bounds: Aabb::new(min, min + edge), facet_size: 0.01, ..Info::default() };
    let depths = vec![Depth { masks: vec![0], voxels: vec![Voxel::default()], mixes: Vec::new() }];
    format::write(&Volume { info, depths }, path, &Default::default()).unwrap();
}

#[test]
fn pieces_make_up_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for name in ["fern.glb", "terrain.glb"] {
        std::fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(name), folder.join(name)).unwrap();
    }
    texel(&folder.join("fern.glb"), &folder.join("fern.vtex"));
    let done = |arguments: &str| {
        let (code, output, errors) = vtex(folder, arguments);
        assert_eq!(code, 0, "{arguments}: {errors}");
        (output, errors)
    };
    done("map terrain.glb --texel fern.vtex --geometry fern.glb -o land.gltf");
    let render = "render land.gltf --camera near --size 64x36";
    done(&format!("{render} -o whole.exr --reference 5"));
    done(&format!("{render} -o pieces.exr --reference 2"));
    let (told, said) = done(&format!("{render} -o pieces.exr --reference 5 --resume --json"));
    assert!(said.contains("2 samples a pixel so far"), "{said}");
    let told: serde_json::Value = serde_json::from_str(&told).unwrap();
    assert_eq!(told["samples"], 5);
    assert!(told["noise_rmse"].as_f64().unwrap() > 0.0);
    let (whole, pieces) = (read(&folder.join("whole.exr")).unwrap(), read(&folder.join("pieces.exr")).unwrap());
    // Means are kept as f32.
    let close = |(a, b): (&[f32; 4], &[f32; 4])| (0..4).all(|k| (a[k] - b[k]).abs() <= 1e-6 * (1.0 + a[k].abs()));
    assert!(whole.rgba.iter().zip(&pieces.rgba).all(close));
    // Ferns are there: the picture is not that of the bare ground.
    done("render terrain.glb --camera near --size 64x36 -o bare.exr --reference 5");
    let (table, _) = done("compare whole.exr bare.exr --json");
    let found: serde_json::Value = serde_json::from_str(&table).unwrap();
    assert!(found["all"]["rmse"].as_f64().unwrap() > 0.01 && found["reference_noise"].is_object(), "{table}");
}

#[test]
fn what_cannot_be_traced_is_said_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for name in ["fern.glb", "terrain.glb"] {
        std::fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(name), folder.join(name)).unwrap();
    }
    texel(&folder.join("fern.glb"), &folder.join("fern.vtex"));
    let refused = |arguments: &str, wanted: i32, words: &str| {
        let (code, output, errors) = vtex(folder, arguments);
        assert_eq!((code, output.as_str()), (wanted, ""), "{arguments}: {errors}");
        assert!(errors.contains(words), "{arguments}: {errors}");
    };
    refused("map terrain.glb --texel fern.vtex --geometry fern.obj -o land.gltf", 2, ".glb");
    assert_eq!(vtex(folder, "map terrain.glb --texel fern.vtex -o land.gltf").0, 0);
    let render = "render land.gltf --camera near --size 8x8";
    refused(&format!("{render} -o a.exr --reference 1"), 2, "--geometry");
    refused(&format!("{render} -o a.exr --reference 0"), 2, "--reference");
    refused(&format!("{render} -o a.png --reference 1 --resume"), 2, ".exr");
    let bare = "render terrain.glb --camera near --size 8x8 -o a.exr";
    assert_eq!(vtex(folder, bare).0, 0);
    refused(&format!("{bare} --reference 1 --resume"), 1, "no reference");
    assert_eq!(vtex(folder, &format!("{bare} --reference 1")).0, 0);
    refused(&format!("{bare} --reference 2 --resume --exposure 1"), 1, "other options");
}
