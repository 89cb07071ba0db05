//! `vtex export`: the page holds the texel, and what cannot be written is refused.

use assert_cmd::Command;
use base64::Engine;

fn vtex(arguments: &[&str], folder: &std::path::Path) -> std::process::Output {
    Command::cargo_bin("vtex").unwrap().args(arguments).current_dir(folder).output().unwrap()
}

#[test]
fn a_page_holds_the_very_texel() {
    let dir = tempfile::tempdir().unwrap();
    let vector = concat!(env!("CARGO_MANIFEST_DIR"), "/format-spec/vectors/ok-materials-3.vtex");
    let texel = dir.path().join("a <tree> & more.vtex");
    std::fs::copy(vector, &texel).unwrap();
    let done = vtex(&["export", "a <tree> & more.vtex", "-o", "page.html"], dir.path());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let page = std::fs::read_to_string(dir.path().join("page.html")).unwrap();
    assert!(page.contains("<title>a &lt;tree&gt; &amp; more</title>"));
    let data = page.split_once("id=\"data\">").unwrap().1.split_once('<').unwrap().0;
    let found = base64::engine::general_purpose::STANDARD.decode(data).unwrap();
    assert_eq!(found, std::fs::read(vector).unwrap());
    // What a page weighs without its texel, which the mail that carries it has to bear.
    assert!(page.len() - data.len() < 400_000, "{}", page.len());
}

#[test]
fn what_is_no_texel_or_no_page_is_refused_in_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let bad = concat!(env!("CARGO_MANIFEST_DIR"), "/format-spec/vectors/bad-digest-1.vtex");
    let head = concat!(env!("CARGO_MANIFEST_DIR"), "/format-spec/vectors/bad-head-crc-1.vtex");
    for (arguments, code, said) in [
        (vec!["export", head, "-o", "x.html"], 1, "head-crc"),
        (vec!["export", bad, "-o", "x.obj"], 2, ".html"),
        (vec!["export", "nothing.vtex", "-o", "x.html"], 1, "nothing.vtex"),
        (vec!["export", bad, "-o", "missing/x.html"], 1, "folder"),
        (vec!["export", bad, "-o", "x.html", "--depth", "3"], 2, "--depth is no option of a .html"),
        (vec!["export", bad, "-o", "x.ply", "--title", "x"], 2, "--title is no option of a .ply"),
        (vec!["export", bad, "-o", "x.vdb", "--form", "blocks"], 2, "--form is no option of a .vdb"),
        (vec!["export", bad, "-o", "x.glb", "--form", "splats", "--least-opacity", "0"], 2, "splats in a .glb"),
    ] {
        let done = vtex(&arguments, dir.path());
        let stderr = String::from_utf8_lossy(&done.stderr).into_owned();
        assert_eq!(done.status.code(), Some(code), "{arguments:?}: {stderr}");
        assert!(stderr.contains(said) && stderr.lines().count() == 1, "{arguments:?}: {stderr}");
        assert!(std::fs::read_dir(dir.path()).unwrap().next().is_none(), "{arguments:?} left a file");
    }
}

/// The last float of a `.ply` file's header is followed by this many bytes of data.
fn after<'a>(bytes: &'a [u8], header: &str) -> &'a [u8] {
    let at = bytes.windows(header.len()).position(|w| w == header.as_bytes()).unwrap();
    &bytes[at + header.len()..]
}

/// A ball of radius 1 at (3, 2, 1).
fn ball(folder: &std::path::Path) {
    let recipe =
        "metres_per_unit = 1.0\n[[draw]]\nsphere = { radius = 1.0, centre = [3, 2, 1] }\nalbedo = [0.5, 0.25, 0.125]\n";
    std::fs::write(folder.join("ball.toml"), recipe).unwrap();
    let done = vtex(&["bake", "ball.toml", "-r", "32", "-q"], folder);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
}

#[test]
fn blocks_enclose_the_volume_of_a_ball_where_it_was() {
    let dir = tempfile::tempdir().unwrap();
    ball(dir.path());
    let done = vtex(&["export", "ball.vtex", "-o", "ball.glb", "--depth", "5", "--json"], dir.path());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let read = vtex::scene::gltf::read(&dir.path().join("ball.glb"), &Default::default()).unwrap();
    let part = &read.model.parts[0];
    let (positions, indices) = (&part.positions, part.triangles.iter().flatten().copied().collect::<Vec<u32>>());
    let at = |k: u32| glam::Vec3::from(positions[k as usize]).as_dvec3() - glam::DVec3::new(3.0, 2.0, 1.0);
    // The divergence theorem: the signed volume of all faces.
    let volume: f64 = indices.chunks(3).map(|t| at(t[0]).dot(at(t[1]).cross(at(t[2]))) / 6.0).sum();
    let exact = 4.0 / 3.0 * std::f64::consts::PI;
    // Blocks are the boxes of matter: they hold the ball, and reach beyond it by less than half a voxel on the whole
    // (voxels are 2/32 m wide, the ball's area is 4π).
    assert!(volume > exact && volume < exact + 4.0 * std::f64::consts::PI / 32.0, "{volume} {exact}");
    for p in positions {
        let r = (glam::Vec3::from(*p) - glam::Vec3::new(3.0, 2.0, 1.0)).length();
        assert!(r < 1.0 + 2.0 / 32.0 * 1.74, "{p:?}");
    }
    let color = part.colors.as_ref().unwrap()[0];
    // Albedo has 255 steps of its root.
    assert!((color[0] - 0.5).abs() < 0.006 && (color[2] - 0.125).abs() < 0.003, "{color:?}");
    let done = vtex(&["export", "ball.vtex", "-o", "points.glb", "--form", "points", "--depth", "3"], dir.path());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let bytes = std::fs::read(dir.path().join("points.glb")).unwrap();
    assert!(String::from_utf8_lossy(&bytes).contains("\"mode\":0"), "points");
}

#[test]
fn splats_lie_flat_on_a_ball_and_cover_it() {
    let dir = tempfile::tempdir().unwrap();
    ball(dir.path());
    let done = vtex(&["export", "ball.vtex", "-o", "ball.ply"], dir.path());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let bytes = std::fs::read(dir.path().join("ball.ply")).unwrap();
    let header = String::from_utf8_lossy(&bytes[..400]).into_owned();
    let count: usize = header.split_once("element vertex ").unwrap().1.lines().next().unwrap().parse().unwrap();
    let data = after(&bytes, "end_header\n");
    assert_eq!(data.len(), count * 17 * 4);
    let floats: Vec<f32> = data.chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    let (mut facing, mut surface) = (0.0, 0);
    for s in floats.chunks(17) {
        // Half a turn about z: these files have +Y down.
        let centre = glam::Vec3::new(s[0] + 3.0, s[1] + 2.0, s[2] - 1.0);
        assert!(centre.length() < 1.06, "{centre}");
        let q = glam::Quat::from_xyzw(s[14], s[15], s[16], s[13]);
        assert!((q.length() - 1.0).abs() < 1e-5);
        let thin = (0..3).min_by(|a, b| s[10 + a].total_cmp(&s[10 + b])).unwrap();
        let flat = (s[10 + thin] - s[10..13].iter().copied().fold(f32::MIN, f32::max)).exp();
        if centre.length() > 0.9 && flat < 0.5 {
            facing += f64::from((q * glam::Vec3::AXES[thin]).dot(centre.normalize()).abs());
            surface += 1;
        }
    }
    // Most voxels of the rind hold one patch of the sphere, which a splat lies along: the cosine of a tenth of a radian is
    // .995, and voxels of 1/16 radius hold normals that differ by less than that.
    assert!(surface > count / 3 && facing / f64::from(surface as u32) > 0.98, "{surface} {count} {facing}");
}

#[test]
fn what_is_far_from_0_keeps_its_detail() {
    let dir = tempfile::tempdir().unwrap();
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 1.0]];
    let place = [448_262.125, 5_411_932.25, 120.0];
    let line = |c: [f64; 3]| format!("v {} {} {}\n", place[0] + c[0], place[1] + c[1], place[2] + c[2]);
    std::fs::write(dir.path().join("far.obj"), corners.map(line).concat() + "f 1 2 3\n").unwrap();
    assert!(vtex(&["bake", "far.obj", "-r", "8"], dir.path()).status.success());
    for form in ["blocks", "points", "splats"] {
        let done = vtex(&["export", "far.vtex", "-o", "far.glb", "--depth", "3", "--form", form], dir.path());
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        let bytes = std::fs::read(dir.path().join("far.glb")).unwrap();
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        // Nodes add up to where the mesh is.
        let nodes = json["nodes"].as_array().unwrap();
        let origin = |axis: usize| nodes.iter().filter_map(|n| n["translation"][axis].as_f64()).sum::<f64>();
        let bound = |name: &str, axis: usize| json["accessors"][0][name][axis].as_f64().unwrap();
        for axis in 0..3 {
            let (low, high) = (bound("min", axis) + origin(axis), bound("max", axis) + origin(axis));
            // The middle of a voxel is up to half of one, 1/16, from the end.
            let near = if form == "blocks" { 1e-3 } else { 0.0626 };
            let off = (low - place[axis]).abs().max((high - place[axis] - 1.0).abs());
            assert!(off < near, "{form}, axis {axis}: {low} to {high}");
        }
    }
}

#[test]
fn splats_of_glb_and_ply_are_the_same_but_for_half_a_turn_about_z() {
    let dir = tempfile::tempdir().unwrap();
    ball(dir.path());
    for arguments in [vec!["-o", "ball.ply"], vec!["-o", "ball.glb", "--form", "splats"]] {
        let done = vtex(&[vec!["export", "ball.vtex"], arguments].concat(), dir.path());
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    }
    let ply = std::fs::read(dir.path().join("ball.ply")).unwrap();
    let floats = |bytes: &[u8]| -> Vec<f32> {
        bytes.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
    };
    let rows = floats(after(&ply, "end_header\n"));
    let glb = std::fs::read(dir.path().join("ball.glb")).unwrap();
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let doc: serde_json::Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    assert!(doc["extensionsUsed"].as_array().unwrap().iter().any(|name| name == "KHR_gaussian_splatting"));
    let primitive = &doc["meshes"][0]["primitives"][0];
    assert_eq!(primitive["mode"], 0);
    let values = |name: &str| {
        let accessor = &doc["accessors"][primitive["attributes"][name].as_u64().unwrap() as usize];
        let view = &doc["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let [start, size] = ["byteOffset", "byteLength"].map(|k| view[k].as_u64().unwrap_or(0) as usize);
        floats(&glb[28 + length + start..28 + length + start + size])
    };
    let own = |name: &str| values(&format!("KHR_gaussian_splatting:{name}"));
    let (centres, turns, scales, opacities) = (values("POSITION"), own("ROTATION"), own("SCALE"), own("OPACITY"));
    let harmonics = own("SH_DEGREE_0_COEF_0");
    assert_eq!(rows.len() / 17, opacities.len());
    for (i, row) in rows.chunks(17).enumerate() {
        let up = [-row[0], -row[1], row[2]];
        assert_eq!(up, centres[3 * i..3 * i + 3]);
        assert_eq!(row[6..9], harmonics[3 * i..3 * i + 3]);
        // The extension has opacities and deviations as they are, and the real part of a turn last.
        assert!((1.0 / (1.0 + (-row[9]).exp()) - opacities[i]).abs() < 1e-6);
        (0..3).for_each(|k| assert!((row[10 + k].exp() / scales[3 * i + k] - 1.0).abs() < 1e-5));
        let turn = glam::Quat::from_xyzw(row[14], row[15], row[16], row[13]);
        let up = glam::Quat::from_xyzw(0.0, 0.0, -1.0, 0.0) * turn;
        let same = up.to_array().iter().zip(&turns[4 * i..]).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(same, "{row:?} {:?}", &turns[4 * i..4 * i + 4]);
    }
}

#[test]
fn grids_of_openvdb_hold_the_ball() {
    let dir = tempfile::tempdir().unwrap();
    ball(dir.path());
    let done = vtex(&["export", "ball.vtex", "-o", "ball.vdb", "--depth", "4"], dir.path());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let bytes = std::fs::read(dir.path().join("ball.vdb")).unwrap();
    assert_eq!(bytes[..8], 0x5644_4220u64.to_le_bytes());
    let again = dir.path().join("again.vdb");
    vtex(&["export", "ball.vtex", "-o", "again.vdb", "--depth", "4"], dir.path());
    assert!(bytes == std::fs::read(again).unwrap(), "the same texel gives the same file");
    // Each grid says where it ends: the first where the second begins, the second at the end of the file.
    let int = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    let place = |name: &str| bytes.windows(name.len()).position(|w| w == name.as_bytes()).unwrap() + name.len() + 4;
    let (density, color) = (place("Tree_float_5_4_3"), place("Tree_vec3s_5_4_3"));
    assert_eq!([int(density), int(color)], [density + 24, color + 24]);
    assert_eq!([int(density + 16), int(color + 16)], [color - 4 - 16 - 4 - 5 - 4, bytes.len()]);
}

#[test]
fn levels_of_usd_are_three() {
    let dir = tempfile::tempdir().unwrap();
    ball(dir.path());
    let done = vtex(&["export", "ball.vtex", "-o", "ball.usda"], dir.path());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let text = std::fs::read_to_string(dir.path().join("ball.usda")).unwrap();
    assert!(text.starts_with("#usda 1.0\n") && text.contains("defaultPrim = \"ball\""));
    for (open, close) in [('{', '}'), ('[', ']'), ('(', ')')] {
        assert_eq!(text.matches(open).count(), text.matches(close).count(), "{open}");
    }
    let level = |name: &str| text.find(name).unwrap_or_else(|| panic!("{name}"));
    let levels =
        ["def ParticleField3DGaussianSplat \"splats\"", "def Mesh \"blocks\"", "def Points \"points\""].map(level);
    assert!(levels.is_sorted(), "near ones first");
    // Blocks of 1/8 and points of 1/4 of the diameter, 2 m, in pixels of 1080 over a view of 40 degrees.
    let line = text.lines().find(|line| line.contains("thresholds")).unwrap();
    let found: Vec<f64> =
        line.split(['[', ']']).nth(3).unwrap().split(", ").map(|number| number.parse().unwrap()).collect();
    assert!((found[0] - 0.25 * 1080.0 / 0.728).abs() < 1.0 && (found[1] - 2.0 * found[0]).abs() < 0.1, "{found:?}");
}

#[test]
fn a_scene_of_mitsuba_has_grids_of_the_texel() {
    let dir = tempfile::tempdir().unwrap();
    ball(dir.path());
    let done = vtex(&["export", "ball.vtex", "-o", "ball.xml", "--depth", "4", "--json"], dir.path());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let said: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(said["more"].as_array().unwrap().len(), 3, "{said}");
    for (name, channels) in [("density", 1), ("albedo", 3), ("sggx", 6)] {
        let grid = std::fs::read(dir.path().join(format!("ball-{name}.vol"))).unwrap();
        assert_eq!(&grid[..4], b"VOL\x03");
        assert_eq!(grid.len(), 48 + 16 * 16 * 16 * channels * 4, "{name}");
    }
    let scene = std::fs::read_to_string(dir.path().join("ball.xml")).unwrap();
    scene_is_whole(&scene);
    let done = vtex(&["export", "ball.vtex", "-o", "ball.glb", "--depth", "9"], dir.path());
    assert_eq!(done.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&done.stderr).contains("finest is 5"));
}

/// Every tag that opens closes.
fn scene_is_whole(text: &str) {
    assert_eq!(text.matches("<volume").count(), 3);
    assert_eq!(text.matches("</volume>").count(), 3);
    assert!(text.trim_end().ends_with("</scene>"));
}
