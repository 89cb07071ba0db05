//! `vtex render` from the outside: what it prints, how it fails, and that threads do not show.

use std::path::{Path, PathBuf};
use std::process::Command;

use vtex::format;
use vtex::geom::{Aabb, DVec3};
use vtex::render::image_io;
use vtex::volume::{Depth, Info, Volume, Voxel};

/// A folder with land.gltf: the sample terrain under bushes of nine voxels.
fn land() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let info = Info {
        bounds: Aabb::new(DVec3::new(-4.0, 0.0, -4.0), DVec3::new(4.0, 8.0, 4.0)),
        content: Aabb::new(DVec3::ZERO, DVec3::new(1.0, 1.0, 0.5)),
        facet_size: 0.01,
        ..Info::default()
    };
    let voxel = Voxel { rate: 140, ..Voxel::default() };
    let depths = vec![
        Depth { masks: vec![15], voxels: vec![voxel], mixes: Vec::new() },
        Depth { masks: vec![0; 4], voxels: vec![voxel; 4], mixes: Vec::new() },
    ];
    format::write(&Volume { info, depths }, folder.path().join("bush.vtex"), &Default::default()).unwrap();
    let terrain = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/terrain.glb");
    std::fs::copy(terrain, folder.path().join("terrain.glb")).unwrap();
    let (code, _, errors) = vtex(folder.path(), "map terrain.glb --texel bush.vtex -o land.gltf");
    assert_eq!(code, 0, "{errors}");
    folder
}

fn vtex(folder: &Path, arguments: &str) -> (i32, String, String) {
    let output =
        Command::new(env!("CARGO_BIN_EXE_vtex")).args(arguments.split(' ')).current_dir(folder).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

const FAR: &str = "render land.gltf --camera far --size 48x27";

#[test]
fn a_pixel_tells_what_it_met() {
    let folder = land();
    let (code, text, _) = vtex(folder.path(), "render land.gltf --camera far --pixel 640,500");
    assert_eq!(code, 0);
    assert!(text.starts_with("cone ") && text.contains("\nradiance "), "{text}");
    let (code, text, _) = vtex(folder.path(), "render land.gltf --camera far --pixel 640,500 --json");
    assert_eq!(code, 0);
    let met: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(met[0]["met"], "cone");
    let (code, _, errors) = vtex(folder.path(), "render land.gltf --camera far --pixel 1280,0");
    assert!(code == 2 && errors.contains("1280×720"), "{errors}");
}

#[test]
fn a_texel_is_no_landscape_and_says_so() {
    let folder = land();
    let (code, _, errors) = vtex(folder.path(), "render bush.vtex -o a.png");
    assert!(code > 0 && errors.lines().count() == 1, "{errors}");
    assert!(errors.contains("bush.vtex") && errors.contains("vtex inspect --preview"), "{errors}");
    assert!(!folder.path().join("a.png").exists());
}

/// One file for all: the texel's bytes in a buffer of the landscape.
#[test]
fn a_texel_in_a_buffer_view_is_rendered_as_one_in_a_file() {
    let folder = land();
    let dir = folder.path();
    let (code, _, errors) = vtex(dir, "render land.gltf --camera far --size 48x27 -o file.png");
    assert_eq!(code, 0, "{errors}");
    let mut land: serde_json::Value = serde_json::from_slice(&std::fs::read(dir.join("land.gltf")).unwrap()).unwrap();
    let frame = "/extensions/VTEX_volumetric_texture/texels/0/frames/0";
    let uri = land.pointer(frame).unwrap()["uri"].as_str().unwrap().to_owned();
    let length = std::fs::metadata(dir.join(&uri)).unwrap().len();
    let mut push = |list: &str, value: serde_json::Value| {
        let list = land[list].as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    };
    let buffer = push("buffers", serde_json::json!({"uri": "texel.bin", "byteLength": length}));
    let view = push("bufferViews", serde_json::json!({"buffer": buffer, "byteLength": length}));
    *land.pointer_mut(frame).unwrap() = serde_json::json!({"bufferView": view});
    std::fs::rename(dir.join(&uri), dir.join("texel.bin")).unwrap();
    std::fs::write(dir.join("land.gltf"), land.to_string()).unwrap();
    let (code, _, errors) = vtex(dir, "render land.gltf --camera far --size 48x27 -o view.png");
    assert_eq!(code, 0, "{errors}");
    assert_eq!(std::fs::read(dir.join("file.png")).unwrap(), std::fs::read(dir.join("view.png")).unwrap());
    // What is broken in it is told with its place.
    let mut bytes = std::fs::read(dir.join("texel.bin")).unwrap();
    bytes[0] ^= 1;
    std::fs::write(dir.join("texel.bin"), bytes).unwrap();
    let (code, _, errors) = vtex(dir, "render land.gltf --camera far --size 48x27 -o broken.png");
    assert!(
        code == 1 && errors.contains(&format!("bufferViews[{view}]")) && !dir.join("broken.png").exists(),
        "{errors}"
    );
}

#[test]
fn statistics_are_json_and_count_no_byte_twice() {
    let folder = land();
    for camera in ["near", "far"] {
        let (code, text, _) =
            vtex(folder.path(), &format!("render land.gltf --camera {camera} --size 48x27 -o a.png --stats --json"));
        assert_eq!(code, 0);
        let stats: serde_json::Value = serde_json::from_str(&text).unwrap();
        let figure = |key: &str| stats[key].as_u64().unwrap();
        assert_eq!(figure("cones"), 48 * 27);
        assert!(figure("boxes_entered") > 0 && figure("cells_marched") > 0 && figure("shadow_rays") > 0);
        assert!(figure("bytes_read") > 0 && figure("bytes_read") <= figure("bytes_in_files"), "{text}");
        assert!(stats["seconds"]["trace"].as_f64().unwrap() > 0.0);
    }
    let (_, text, _) = vtex(folder.path(), &format!("{FAR} -o a.png --stats"));
    assert!(text.contains("shadow rays"), "{text}");
}

#[test]
fn a_texel_that_the_landscape_was_not_made_for_is_told() {
    let folder = land();
    let (_, text, _) = vtex(folder.path(), "inspect bush.vtex --json");
    let own = serde_json::from_str::<serde_json::Value>(&text).unwrap()["content_id"].clone();
    let land = std::fs::read_to_string(folder.path().join("land.gltf")).unwrap();
    let mut land: serde_json::Value = serde_json::from_str(&land).unwrap();
    for (id, told) in [(own, false), ("0123456789abcdef0123456789abcdef".into(), true)] {
        land["extensions"]["VTEX_volumetric_texture"]["texels"][0]["frames"][0]["contentId"] = id;
        std::fs::write(folder.path().join("land.gltf"), land.to_string()).unwrap();
        let (code, _, errors) = vtex(folder.path(), &format!("{FAR} -o a.png"));
        assert!(code == 0 && errors.contains("bush.vtex: is not the texel") == told, "{errors}");
        assert_eq!(vtex(folder.path(), &format!("{FAR} -o a.png --strict")).0, i32::from(told));
    }
}

#[test]
fn what_cannot_be_rendered_is_said_and_the_old_picture_stays() {
    let folder = land();
    let picture: PathBuf = folder.path().join("a.png");
    std::fs::write(&picture, "old").unwrap();
    let refused = |arguments: &str, wanted: i32, words: &str| {
        let (code, output, errors) = vtex(folder.path(), arguments);
        assert_eq!((code, output.as_str()), (wanted, ""), "{arguments}: {errors}");
        assert!(errors.contains(words), "{arguments}: {errors}");
        assert_eq!(std::fs::read(&picture).unwrap(), b"old", "{arguments}");
    };
    refused("render land.gltf --camera side -o a.png", 2, "\"far\"");
    for size in ["0x5", "5", "axb", "-3x4", "70000x1"] {
        refused(&format!("render land.gltf --size={size} -o a.png"), 2, "");
    }
    refused("render land.gltf -o a.jpeg", 2, ".png or .exr");
    refused("render nothing.gltf -o a.png", 1, "nothing.gltf");
    let texel = folder.path().join("bush.vtex");
    let mut bytes = std::fs::read(&texel).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(&texel, &bytes).unwrap();
    refused(&format!("{FAR} -o a.png"), 1, "bush.vtex");
    std::fs::remove_file(&texel).unwrap();
    refused(&format!("{FAR} -o a.png"), 1, "bush.vtex");
    let left = std::fs::read_dir(folder.path())
        .unwrap()
        .filter(|f| f.as_ref().unwrap().file_name().to_str().unwrap().contains("part"));
    assert_eq!(left.count(), 0, "nothing half-written stays");
}

#[test]
fn threads_do_not_show() {
    let folder = land();
    for threads in [1, 2] {
        assert_eq!(vtex(folder.path(), &format!("{FAR} -o {threads}.exr --threads {threads}")).0, 0);
    }
    let bytes = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(bytes("1.exr") == bytes("2.exr"));
}

#[test]
fn the_light_binary_renders_the_same() {
    let folder = land();
    let view = "land.gltf --camera far --size 48x27 --quiet -o";
    assert_eq!(vtex(folder.path(), &format!("render {view} all.png")).0, 0);
    let mut light = Command::new(env!("CARGO_BIN_EXE_vtex-render"));
    let run = light.args(view.split(' ')).arg("light.png").current_dir(folder.path()).output().unwrap();
    assert!(run.status.success() && run.stdout.is_empty() && run.stderr.is_empty(), "{run:?}");
    let [all, light] = ["all.png", "light.png"].map(|name| std::fs::read(folder.path().join(name)).unwrap());
    assert_eq!(all, light);
}

/// The sample terrain with its JSON changed, under another name in the folder.
fn terrain(folder: &Path, name: &str, change: impl FnOnce(&mut serde_json::Value)) {
    let bytes = std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/terrain.glb")).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let mut json = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    change(&mut json);
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let rest = &bytes[20 + length..];
    let total = (20 + text.len() + rest.len()) as u32;
    let head = [&bytes[..8], &total.to_le_bytes(), &(text.len() as u32).to_le_bytes(), &bytes[16..20]].concat();
    std::fs::write(folder.join(name), [&head[..], &text, rest].concat()).unwrap();
}

fn sun(json: &mut serde_json::Value) -> &mut serde_json::Value {
    &mut json["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"]
}

#[test]
fn lights_in_lux_make_the_picture_that_watts_make() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // Three watts a square metre, and as Blender writes them.
    terrain(folder, "watts.glb", |json| *sun(json) = serde_json::json!(3));
    terrain(folder, "lux.glb", |json| *sun(json) = serde_json::json!(2049));
    let shot = |what: &str, name: &str| {
        let (code, _, errors) = vtex(folder, &format!("render {what} --camera far --size 48x27 -o {name}"));
        assert_eq!(code, 0, "{errors}");
        (image_io::read(&folder.join(name)).unwrap().rgba, errors)
    };
    let (watts, said) = shot("watts.glb", "watts.png");
    assert!(!said.contains("lux") && !said.contains("clipped"), "{said}");
    let (lux, said) = shot("lux.glb", "lux.png");
    assert!(said.contains("lux and candela") && said.contains("683 lm/W") && said.contains("--exposure 0"), "{said}");
    // One step of the display's 255.
    let differ = |a: &[[f32; 4]], b: &[[f32; 4]]| {
        let pairs = a.iter().flatten().zip(b.iter().flatten());
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    assert!(differ(&watts, &lux) < 0.012, "{}", differ(&watts, &lux));
    // As they are, where that is asked for, with a word on what it does to the picture.
    let (_, said) = shot("lux.glb --exposure 0", "white.png");
    assert!(said.contains("of the picture is clipped to white; try --exposure -"), "{said}");
    // An .exr keeps the numbers of the file: 683 times the sun's light, besides the sky's.
    let (plain, _) = shot("watts.glb --sky 0,0,0", "watts.exr");
    let (kept, said) = shot("lux.glb --sky 0,0,0", "lux.exr");
    assert!(said.contains("kept in an .exr"), "{said}");
    let sum = |film: &[[f32; 4]]| film.iter().map(|p| f64::from(p[0])).sum::<f64>();
    // Light of less than 1/256 of white takes its shadows from the rest of its pixel: less than a hundredth of what is summed.
    assert!((sum(&kept) / sum(&plain) / 683.0 - 1.0).abs() < 5e-3, "{} {}", sum(&kept), sum(&plain));
    let (scaled, _) = shot("lux.glb --sky 0,0,0 --exposure auto", "auto.exr");
    assert!(differ(&scaled, &plain) < 1e-5, "{}", differ(&scaled, &plain));
    // A stop more than what suits it, in powers of two, and the line still says what that is.
    let (brighter, said) = shot("lux.glb --sky 0,0,0 --exposure auto+1", "brighter.exr");
    assert!((sum(&brighter) / sum(&scaled) - 2.0).abs() < 1e-2, "{} {}", sum(&brighter), sum(&scaled));
    assert!(said.contains("683 lm/W"), "{said}");
    for bad in ["NaN", "bright", "inf", "auto1"] {
        assert_eq!(vtex(folder, &format!("render lux.glb -o a.png --exposure {bad}")).0, 2, "{bad}");
    }
}

#[test]
fn a_picture_has_the_shape_of_its_camera() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    terrain(folder, "slit.glb", |json| json["cameras"][1]["perspective"]["aspectRatio"] = serde_json::json!(0.009));
    let size = |arguments: &str| {
        let (code, _, errors) = vtex(folder, &format!("render slit.glb --no-shadows -o a.png {arguments}"));
        assert_eq!(code, 0, "{errors}");
        let picture = image_io::read(&folder.join("a.png")).unwrap();
        [picture.width, picture.height]
    };
    assert_eq!(size("--camera far"), [12, 1280]);
    assert_eq!(size("--camera far --size 32x16"), [32, 16]);
}
