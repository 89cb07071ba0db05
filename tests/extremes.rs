//! Sizes and shapes at their ends: metres from 1e-30 to 1e30, one voxel, flat, thinner than any voxel; against closed forms.

use std::path::Path;
use std::sync::Arc;

use assert_cmd::Command;
use serde_json::json;
use vtex::format::{Limits, Reader};
use vtex::geom::Vec3;
use vtex::render::{DepthChoice, MarchSegment, MarchStats, transmittance};
use vtex::volume::Octree;

/// Run vtex in a folder.
fn vtex(folder: &Path, arguments: &[&str]) {
    Command::cargo_bin("vtex").unwrap().current_dir(folder).args(arguments).arg("-q").assert().success();
}

/// An OBJ file of quads, its numbers times `scale`.
fn obj(folder: &Path, name: &str, corners: &[[f64; 3]], quads: &[[u8; 4]], scale: f64) {
    let vertices = corners.iter().map(|c| format!("v {:e} {:e} {:e}\n", scale * c[0], scale * c[1], scale * c[2]));
    let faces = quads.iter().map(|[a, b, c, d]| format!("f {a} {b} {c} {d}\n"));
    std::fs::write(folder.join(name), vertices.chain(faces).collect::<String>()).unwrap();
}

/// A closed cube without one of its corners, so that no symmetry hides a mistake.
fn block() -> (Vec<[f64; 3]>, [[u8; 4]; 6]) {
    let mut corners: Vec<[f64; 3]> = (0..8).map(|i| [0, 1, 2].map(|k| f64::from(i >> k & 1))).collect();
    corners[7] = [0.75, 0.5, 0.875];
    (corners, [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]])
}

/// One copy of a texel and nothing else, lit from everywhere.
fn landscape(folder: &Path, texel: &str, edge: f32) -> String {
    use base64::Engine;
    let corners = [[0.0; 3], [edge, 0.0, 0.0], [0.0, edge, 0.0]];
    let bytes: Vec<u8> = corners.iter().flatten().flat_map(|v: &f32| v.to_le_bytes()).collect();
    let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let json = json!({
        "asset": { "version": "2.0" }, "extensionsUsed": ["VTEX_volumetric_texture"],
        "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "materials": [{ "extensions": { "VTEX_volumetric_texture": { "copies": { "texel": 0 } } } }],
        "extensions": { "VTEX_volumetric_texture": {
            "texels": [{ "frames": [{ "uri": texel }] }], "environment": { "sky": [1, 1, 1], "background": [0, 0, 0] } } },
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
            "min": [0, 0, 0], "max": [edge, edge, 0] }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
        "buffers": [{ "byteLength": 36, "uri": format!("data:application/octet-stream;base64,{data}") }],
    });
    let name = texel.replace(".vtex", ".gltf");
    std::fs::write(folder.join(&name), json.to_string()).unwrap();
    name
}

/// Scaling by a power of two is exact in floating point, so the same voxels and the same picture have to come of it: from
/// 8e-31 m to 1e30 m, and the 1e±12 m on the way.
#[test]
fn voxels_and_pictures_do_not_depend_on_the_unit_of_length() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    let (corners, quads) = block();
    let made = |exponent: i32| {
        let scale = f64::from(exponent).exp2();
        let [source, texel, picture] = ["obj", "vtex", "exr"].map(|e| format!("scale{exponent}.{e}"));
        obj(folder, &source, &corners, &quads, scale);
        vtex(folder, &["bake", &source, "-r", "8"]);
        let volume = Reader::open(folder.join(&texel), &Limits::default()).unwrap().read_all().unwrap();
        let land = landscape(folder, &texel, scale as f32);
        let place = |p: [f64; 3]| p.map(|v| format!("{:e}", v * scale)).join(",");
        let (eye, middle) = (place([2.5, 1.75, 3.5]), place([0.5; 3]));
        vtex(folder, &["render", &land, "--eye", &eye, "--look-at", &middle, "--size", "32x18", "-o", &picture]);
        let bounds = volume.info.bounds;
        let corners = [bounds.min, bounds.max].map(|c| (c / scale).to_array());
        (crate::vectors::listing(&volume), corners, std::fs::read(folder.join(picture)).unwrap())
    };
    let wanted = made(0);
    assert!(wanted.0.len() > 400, "{} voxels", wanted.0.len());
    for exponent in [-100, -40, 40, 100] {
        let found = made(exponent);
        assert_eq!(found.0, wanted.0, "voxels at 2^{exponent} m");
        assert_eq!(found.1, wanted.1, "bounds at 2^{exponent} m");
        assert!(found.2 == wanted.2, "the picture at 2^{exponent} m");
    }
}

/// The area that a texel covers along w (from above) or v, as a share of the cube's face, at each depth: rays through the middle
/// of each of `rays`² squares.
fn covered(folder: &Path, texel: &str, axis: usize, rays: u32) -> Vec<f64> {
    let tree = Octree::new(Arc::new(Reader::open(folder.join(texel), &Limits::default()).unwrap())).unwrap();
    let depths = tree.finest().map_or(0, |d| d + 1);
    (0..depths)
        .map(|depth| {
            let mut sum = 0.0;
            for i in 0..rays * rays {
                let [a, b] = [i % rays, i / rays].map(|k| (k as f32 + 0.5) / rays as f32);
                let (origin, dir) = match axis {
                    2 => (Vec3::new(a, b, 2.0), Vec3::new(0.0, 0.0, -1.0)),
                    _ => (Vec3::new(a, -1.0, b), Vec3::new(0.0, 1.0, 0.0)),
                };
                // A cone as wide as a voxel of the depth.
                let footprint = 0.5f32.powi(depth as i32);
                let segment = MarchSegment { origin, dir, length: 3.0, footprint, growth: 0.0, opacity_scale: 1.0 };
                let through = transmittance(&tree, &segment, DepthChoice::default(), 0.0, &mut MarchStats::default());
                sum += 1.0 - f64::from(through);
            }
            sum / f64::from(rays * rays)
        })
        .collect()
}

/// Half a step of the rate's code, 2^(1/16), and as much for one rate that has to do for thirteen directions.
const STEP: f64 = 0.045;

/// A square that fills the cube's face hides all of it at every depth, also where the texel is one voxel.
#[test]
fn a_flat_square_is_opaque() {
    let dir = tempfile::tempdir().unwrap();
    let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0]];
    obj(dir.path(), "flat.obj", &square, &[[1, 4, 3, 2]], 1.0);
    for resolution in ["1", "8"] {
        vtex(dir.path(), &["bake", "flat.obj", "-r", resolution, "-o", "flat.vtex"]);
        let found = covered(dir.path(), "flat.vtex", 2, 32);
        println!("square, {resolution}: {found:?}");
        // A block of one sheet has c = 1, so that it covers as much as its rate says, and that may be half a step too low.
        assert!(found.iter().all(|c| *c > 1.0 - STEP), "{resolution}: {found:?}");
        assert!(found.len() == if resolution == "1" { 1 } else { 4 });
    }
}

/// A ball in one voxel covers π/4 of its face, from each side: its width is that of the cube.
#[test]
fn a_ball_in_one_voxel_covers_its_disk() {
    let dir = tempfile::tempdir().unwrap();
    const ROUND: u8 = 16;
    let point = |i: u8, j: u8| {
        let (turn, down) = (f64::from(i) / f64::from(ROUND), f64::from(j) / f64::from(ROUND / 2 - 1));
        let [(s, c), (r, y)] = [2.0 * turn, down].map(|half| (std::f64::consts::PI * half).sin_cos());
        [r * c, y, r * s]
    };
    let corners: Vec<[f64; 3]> = (0..ROUND / 2).flat_map(|j| (0..ROUND).map(move |i| point(i, j))).collect();
    let quads: Vec<[u8; 4]> = (0..ROUND / 2 - 1)
        .flat_map(|j| (0..ROUND).map(move |i| (j, i, (i + 1) % ROUND)))
        .map(|(j, a, b)| [j * ROUND + a + 1, j * ROUND + b + 1, (j + 1) * ROUND + b + 1, (j + 1) * ROUND + a + 1])
        .collect();
    obj(dir.path(), "ball.obj", &corners, &quads, 1.0);
    vtex(dir.path(), &["bake", "ball.obj", "-r", "1", "-o", "ball.vtex"]);
    for axis in [1, 2] {
        let found = covered(dir.path(), "ball.vtex", axis, 32);
        println!("ball, {axis}: {found:?}");
        // The polyhedron of 112 faces covers up to 4 % less than the ball.
        let wanted = std::f64::consts::FRAC_PI_4;
        assert!(
            found.len() == 1 && found[0] < wanted * (1.0 + STEP) && found[0] > wanted * (0.96 - STEP),
            "{axis}: {found:?}"
        );
    }
}

/// A needle that is a thousandth of the cube wide covers that at every depth. One of a millionth is below the least rate, and
/// covers no more than that rate does in the smallest support.
#[test]
fn needles_cover_their_width() {
    let dir = tempfile::tempdir().unwrap();
    let needle = |width: f64| [[0.0, 0.0, 0.0], [width, 0.0, 0.0], [width, 1.0, 0.0], [0.0, 1.0, 0.0]];
    for resolution in ["1", "8"] {
        obj(dir.path(), "needle.obj", &needle(1e-3), &[[1, 2, 3, 4]], 1.0);
        vtex(dir.path(), &["bake", "needle.obj", "-r", resolution, "-o", "needle.vtex"]);
        // 16 rays across a voxel of the finest depth: as many as a support box has steps.
        let found = covered(dir.path(), "needle.vtex", 1, 128);
        println!("needle, {resolution}: {found:?}");
        assert!(found.iter().all(|c| (c / 1e-3 - 1.0).abs() < 2.0 * STEP), "{resolution}: {found:?}");
        obj(dir.path(), "thin.obj", &needle(1e-6), &[[1, 2, 3, 4]], 1.0);
        vtex(dir.path(), &["bake", "thin.obj", "-r", resolution, "-o", "thin.vtex"]);
        let found = covered(dir.path(), "thin.vtex", 1, 128);
        println!("thin needle, {resolution}: {found:?}");
        // The least rate, 2^(-143/16) hits per voxel edge, in two sixteenths of a voxel each way.
        let most = libm::exp2(-143.0 / 16.0) / 64.0;
        assert!(found.iter().all(|c| *c <= most * 1.01), "{resolution}: {found:?} {most}");
    }
}

/// A card under a shell whose texture coordinates collapse on one triangle: a copy without width, from which light is looked for
/// past the card.
#[test]
fn copies_without_width_over_a_card_are_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let half = |x: u32, _| image::Rgba([255, 255, 255, if x == 0 { 255 } else { 0 }]);
    image::RgbaImage::from_fn(2, 2, half).save(folder.join("mask.png")).unwrap();
    let corners: [[f32; 3]; 4] = [[-1.0, 0.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 0.0, -1.0], [1.0, 0.0, 1.0]];
    let coordinates: [[f32; 2]; 4] = [[-1.0, 0.0], [1.0, 1.0], [0.0, -1.0], [-1.0, 0.0]];
    let numbers = [0u16, 1, 2, 0, 3, 1];
    let mut bytes: Vec<u8> =
        corners.iter().flatten().chain(coordinates.iter().flatten()).flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend(numbers.iter().flat_map(|v| v.to_le_bytes()));
    std::fs::write(folder.join("card.bin"), &bytes).unwrap();
    let card = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "materials": [{"name": "card", "alphaMode": "MASK", "doubleSided": true,
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "images": [{"uri": "mask.png"}], "textures": [{"source": 0}],
        "buffers": [{"uri": "card.bin", "byteLength": bytes.len()}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 32},
            {"buffer": 0, "byteOffset": 80, "byteLength": 12}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-1, 0, -1], "max": [1, 0, 1]},
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"}],
    });
    std::fs::write(folder.join("card.gltf"), card.to_string()).unwrap();
    let fern = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/fern.glb");
    vtex(folder, &["bake", fern, "-r", "16", "-o", "fern.vtex"]);
    vtex(folder, &["map", "card.gltf", "--texel", "fern.vtex", "--bend", "-o", "land.gltf"]);
    vtex(folder, &["render", "land.gltf", "--size", "8x8", "-o", "land.exr"]);
    let film = vtex::render::image_io::read(&folder.join("land.exr")).unwrap();
    assert!(film.rgba.iter().flatten().all(|v| v.is_finite()));
}
