//! What commands write, and what they refuse to write or read: inputs stay, nothing half-written is left, links and devices
//! are treated by the rules of `src/format/atomic.rs`, and a landscape brings nothing from outside its folder.

use std::path::{Path, PathBuf};

use crate::readable;

/// A folder with a small source, its texel, a mesh to cover, the landscape, and a picture.
pub struct Folder(tempfile::TempDir);

const QUAD: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";

/// A square of 4 m in the XZ plane, its corners in the buffer that `uri` names, and of an image that `image` names.
pub fn ground(uri: &str, image: &str) -> String {
    serde_json::json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "material": 0 }] }],
        "materials": [{ "name": "grass", "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }],
        "textures": [{ "source": 0 }], "images": [{ "uri": image }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [4, 0, 4] },
            { "bufferView": 1, "componentType": 5121, "count": 6, "type": "SCALAR" }],
        "bufferViews": [{ "buffer": 0, "byteLength": 48 }, { "buffer": 0, "byteOffset": 48, "byteLength": 6 }],
        "buffers": [{ "byteLength": 56, "uri": uri }],
    })
    .to_string()
}

pub fn corners() -> Vec<u8> {
    let corners = [[0.0f32, 0.0, 0.0], [0.0, 0.0, 4.0], [4.0, 0.0, 4.0], [4.0, 0.0, 0.0]];
    let mut bytes: Vec<u8> = corners.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([0, 1, 2, 0, 2, 3, 0, 0]);
    bytes
}

impl Folder {
    pub fn new() -> Folder {
        let folder = Folder(tempfile::tempdir().unwrap());
        folder.save("quad.obj", QUAD.as_bytes());
        folder.save("ground.bin", &corners());
        folder.save("ground.gltf", ground("ground.bin", "grass.png").as_bytes());
        let green = image::RgbImage::from_pixel(2, 2, image::Rgb([20, 120, 30]));
        green.save(folder.path("grass.png")).unwrap();
        folder.succeeds(&["bake", "quad.obj", "-r", "16"]);
        readable::verify(&folder.path("quad.vtex"));
        folder
    }

    /// Nothing but a source of this name.
    pub fn of(source: &str) -> Folder {
        let folder = Folder(tempfile::tempdir().unwrap());
        folder.save(source, QUAD.as_bytes());
        folder
    }

    /// Also a landscape and two pictures of it.
    pub fn with_landscape() -> Folder {
        let folder = Folder::new();
        folder.succeeds(&["map", "ground.gltf", "--texel", "quad.vtex", "--planar", "y", "-o", "land.gltf"]);
        folder.succeeds(&["render", "land.gltf", "--frame", "--size", "16x9", "-o", "a.png"]);
        folder.succeeds(&["render", "land.gltf", "--frame", "--size", "16x9", "-o", "b.png"]);
        folder
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn save(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.path(name), bytes).unwrap();
    }

    pub fn command(&self, args: &[&str]) -> std::process::Command {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_vtex"));
        command.current_dir(self.0.path()).args(args);
        command
    }

    /// `vtex ARGS`: exit code, stdout, stderr.
    pub fn run(&self, args: &[&str]) -> (i32, Vec<u8>, String) {
        let out = self.command(args).output().unwrap();
        (out.status.code().unwrap(), out.stdout, String::from_utf8_lossy(&out.stderr).into_owned())
    }

    pub fn succeeds(&self, args: &[&str]) {
        let (code, _, err) = self.run(args);
        assert_eq!(code, 0, "{args:?}: {err}");
    }

    /// The one line that says why it fails.
    pub fn fails(&self, code: i32, args: &[&str]) -> String {
        let (found, _, err) = self.run(args);
        let errors: Vec<_> = err.lines().filter(|line| line.starts_with("error: ")).collect();
        let is_last = err.lines().last() == errors.last().copied();
        assert!(found == code && errors.len() == 1 && is_last, "{args:?}: {found} {err}");
        errors[0].to_owned()
    }

    /// Names and contents of all files.
    fn state(&self) -> Vec<(PathBuf, Vec<u8>)> {
        let mut all: Vec<_> = std::fs::read_dir(self.0.path())
            .unwrap()
            .map(|e| e.unwrap().path())
            .filter(|path| path.is_file())
            .map(|path| (path.clone(), std::fs::read(path).unwrap()))
            .collect();
        all.sort();
        all
    }
}

#[test]
fn no_command_writes_over_its_input() {
    let folder = Folder::with_landscape();
    let before = folder.state();
    let cases: [&[&str]; 17] = [
        &["truncate", "quad.vtex", "--depth", "2", "-o", "quad.vtex"],
        &["truncate", "quad.vtex", "--depth", "2", "-o", "./quad.vtex"],
        &["resample", "quad.vtex", "--scale", "2", "-o", "quad.vtex"],
        &["merge", "quad.vtex", "quad.vtex", "-o", "quad.vtex"],
        &["inspect", "quad.vtex", "--preview", "quad.vtex"],
        &["bake", "quad.obj", "-r", "16", "-o", "o.vtex", "--depfile", "quad.obj"],
        &["bake", "quad.obj", "-r", "16", "-o", "o.vtex", "--report", "./quad.obj"],
        &["bake", "quad.obj", "-r", "16", "-o", "o.vtex", "--depfile", "o.vtex"],
        &["bake", "quad.obj", "-r", "16", "-o", "o.vtex", "--depfile", "o.d", "--report", "o.d"],
        &["bake", "quad.vtex", "-r", "16", "-o", "quad.vtex"],
        &["map", "ground.gltf", "--texel", "quad.vtex", "-o", "ground.gltf"],
        &["map", "ground.gltf", "--texel", "land.gltf", "-o", "land.gltf"],
        &["render", "land.gltf", "--frame", "--size", "16x9", "-o", "grass.png"],
        &["compare", "a.png", "b.png", "--map", "a.png"],
        &["compare", "a.png", "b.png", "--sheet", "b.png"],
        &["compare", "a.png", "b.png", "--map", "c.png", "--sheet", "c.png"],
        &["error", "quad.vtex", "--source", "grass.png", "--plot", "grass.png"],
    ];
    for args in cases {
        let line = folder.fails(2, args);
        assert!(line.contains("is also an input") || line.contains("two outputs"), "{args:?}: {line}");
        assert!(folder.state() == before, "{args:?}");
    }
    // A landscape may be added to in place: it is read whole before it is written.
    folder.succeeds(&["map", "land.gltf", "--texel", "quad.vtex", "--planar", "y", "-o", "land.gltf"]);
}

#[test]
fn folders_and_missing_folders_are_known_before_work_begins() {
    let folder = Folder::with_landscape();
    std::fs::create_dir(folder.path("dir.vtex")).unwrap();
    std::fs::create_dir(folder.path("dir.png")).unwrap();
    std::fs::create_dir(folder.path("dir.glb")).unwrap();
    let before = folder.state();
    let cases: [(&[&str], [&str; 2]); 7] = [
        (&["bake", "quad.obj", "-r", "16", "-o"], ["no/o.vtex", "dir.vtex"]),
        (&["truncate", "quad.vtex", "--depth", "2", "-o"], ["no/o.vtex", "dir.vtex"]),
        (&["resample", "quad.vtex", "-o"], ["no/o.vtex", "dir.vtex"]),
        (&["merge", "quad.vtex", "quad.vtex", "-o"], ["no/o.vtex", "dir.vtex"]),
        (&["map", "ground.gltf", "--texel", "quad.vtex", "-o"], ["no/o.glb", "dir.glb"]),
        (&["render", "land.gltf", "--frame", "-o"], ["no/o.png", "dir.png"]),
        (&["compare", "a.png", "b.png", "--map"], ["no/o.png", "dir.png"]),
    ];
    for (args, [missing, taken]) in cases {
        assert!(folder.fails(1, &[args, &[missing]].concat()).contains("folder does not exist"), "{args:?}");
        assert!(folder.fails(2, &[args, &[taken]].concat()).contains("is a folder"), "{args:?}");
    }
    assert!(folder.fails(2, &["map", "ground.gltf", "--texel", "quad.vtex", "-o", "x.obj"]).contains(".gltf or .glb"));
    assert!(folder.state() == before);
}

#[cfg(unix)]
#[test]
fn links_permissions_and_devices_are_kept() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let folder = Folder::new();
    folder.save("real.vtex", b"old");
    std::fs::set_permissions(folder.path("real.vtex"), std::fs::Permissions::from_mode(0o600)).unwrap();
    symlink("real.vtex", folder.path("link.vtex")).unwrap();
    folder.succeeds(&["bake", "quad.obj", "-r", "16", "-o", "link.vtex"]);
    readable::verify(&folder.path("real.vtex"));
    assert!(std::fs::symlink_metadata(folder.path("link.vtex")).unwrap().is_symlink());
    assert_eq!(std::fs::metadata(folder.path("real.vtex")).unwrap().permissions().mode() & 0o777, 0o600);
    symlink("nowhere", folder.path("gone.vtex")).unwrap();
    assert!(folder.fails(2, &["bake", "quad.obj", "-r", "16", "-o", "gone.vtex"]).contains("a link to nothing"));
    // A link that leads to an input is that input.
    symlink("quad.vtex", folder.path("to-input.vtex")).unwrap();
    let args = ["resample", "quad.vtex", "-o", "to-input.vtex"];
    assert!(folder.fails(2, &args).contains("is also an input"));
    // Devices stay devices, and what goes to a pipe is the whole file.
    folder.succeeds(&["bake", "quad.obj", "-r", "16", "-o", "/dev/null"]);
    assert!(!std::fs::metadata("/dev/null").unwrap().is_file());
    let (code, bytes, err) = folder.run(&["bake", "quad.obj", "-r", "16", "-o", "/dev/stdout", "--quiet"]);
    assert!(code == 0 && bytes == std::fs::read(folder.path("quad.vtex")).unwrap(), "{code} {err}");
    let mkfifo = std::process::Command::new("mkfifo").arg(folder.path("pipe.vtex")).status();
    assert!(mkfifo.unwrap().success());
    let pipe = folder.path("pipe.vtex");
    let reader = std::thread::spawn(move || std::fs::read(pipe).unwrap());
    folder.succeeds(&["truncate", "quad.vtex", "--depth", "4", "-o", "pipe.vtex"]);
    assert_eq!(reader.join().unwrap(), std::fs::read(folder.path("quad.vtex")).unwrap());
}

/// Two processes that write to one name at once leave what one of them wrote.
#[test]
fn writers_to_one_name_do_not_mix() {
    let folder = Folder::new();
    let bake = |resolution: &str| {
        let args = ["bake", "quad.obj", "-r", resolution, "--quiet", "-o", "both.vtex"];
        folder.command(&args).spawn().unwrap()
    };
    folder.succeeds(&["bake", "quad.obj", "-r", "32", "-o", "32.vtex"]);
    let whole = ["quad.vtex", "32.vtex"].map(|name| std::fs::read(folder.path(name)).unwrap());
    for _ in 0..4 {
        let mut both = [bake("16"), bake("32")];
        assert!(both.iter_mut().all(|child| child.wait().unwrap().success()));
        assert!(whole.contains(&std::fs::read(folder.path("both.vtex")).unwrap()));
    }
    assert!(folder.state().iter().all(|(path, _)| !path.to_string_lossy().ends_with(".part")));
}

#[cfg(target_os = "linux")]
#[test]
fn signals_leave_nothing_behind() {
    let folder = Folder::new();
    folder.save("out.vtex", b"old");
    let before = folder.state();
    let tree = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/tree.glb");
    let args = ["bake", tree.to_str().unwrap(), "-r", "512", "--quiet", "-o", "out.vtex"];
    for (signal, code) in [("-INT", 130), ("-TERM", 143)] {
        let mut child = folder.command(&args).spawn().unwrap();
        let id = child.id().to_string();
        // Until it listens; what it does from then on takes much longer than to ask it to stop.
        let listens = || {
            let status = std::fs::read_to_string(format!("/proc/{id}/status")).unwrap();
            let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap();
            u64::from_str_radix(caught.trim(), 16).unwrap() & 0b10 != 0
        };
        while !listens() {
            assert!(child.try_wait().unwrap().is_none(), "{signal}: it ended before it was asked to");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        std::thread::sleep(std::time::Duration::from_millis(100));
        assert!(std::process::Command::new("kill").args([signal, &id]).status().unwrap().success());
        assert_eq!(child.wait().unwrap().code(), Some(code), "{signal}");
        assert!(folder.state() == before, "{signal}");
    }
}

#[test]
fn a_landscape_brings_nothing_from_outside_its_folder() {
    let folder = Folder::new();
    let secret = folder.path("secret");
    std::fs::write(&secret, corners()).unwrap();
    let inside = folder.path("in");
    std::fs::create_dir(&inside).unwrap();
    std::fs::write(inside.join("ground.bin"), corners()).unwrap();
    std::fs::copy(folder.path("grass.png"), inside.join("grass.png")).unwrap();
    std::fs::create_dir(folder.path("out")).unwrap();
    let absolute = secret.display().to_string();
    let outside = [absolute.clone(), format!("file://{absolute}"), "../secret".into(), "%2e%2e/secret".into()];
    for uri in outside {
        for (buffer, image) in [(&*uri, "grass.png"), ("ground.bin", &*uri)] {
            std::fs::write(inside.join("g.gltf"), ground(buffer, image)).unwrap();
            for output in ["out/o.gltf", "out/o.glb", "in/o.glb"] {
                let args = ["map", "in/g.gltf", "--texel", "quad.vtex", "--planar", "y", "-o", output];
                assert!(folder.fails(1, &args).contains("is not a relative path"), "{uri} {output}");
            }
            assert_eq!(std::fs::read_dir(folder.path("out")).unwrap().count(), 0, "{uri}");
        }
        // A picture is drawn without the image, and not at all without the mesh.
        std::fs::write(inside.join("g.gltf"), ground("ground.bin", &uri)).unwrap();
        let args = ["render", "in/g.gltf", "--frame", "--size", "16x9", "-o", "o.png"];
        let (code, _, err) = folder.run(&args);
        assert!(code == 0 && err.contains("is not a relative path"), "{uri}: {err}");
        std::fs::write(inside.join("g.gltf"), ground(&uri, "grass.png")).unwrap();
        assert!(folder.fails(1, &args).contains("is not a relative path"), "{uri}");
    }
    // A name is decoded once: what is then a name with percent signs does not lead anywhere else.
    let twice = "%252e%252e/secret";
    std::fs::write(inside.join("g.gltf"), ground(twice, "grass.png")).unwrap();
    assert!(folder.fails(1, &["render", "in/g.gltf", "--frame", "-o", "o.png"]).contains("%2e%2e/secret"));
    std::fs::write(inside.join("g.gltf"), ground("ground.bin", twice)).unwrap();
    let args = ["map", "in/g.gltf", "--texel", "quad.vtex", "--planar", "y", "-o", "out/o.gltf"];
    let (code, _, err) = folder.run(&args);
    assert!(code == 0 && err.contains("is missing beside the input"), "{err}");
    assert!(!folder.path("out/secret").exists());
    // Nor does the picture of the sky, which a landscape names in the extension.
    folder.succeeds(&["map", "in/g.gltf", "--texel", "quad.vtex", "--planar", "y", "-o", "in/land.gltf"]);
    let mut land: serde_json::Value =
        serde_json::from_slice(&std::fs::read(inside.join("land.gltf")).unwrap()).unwrap();
    let mut sky = |uri: &str| {
        land["extensions"]["VTEX_volumetric_texture"]["environment"] = serde_json::json!({ "image": { "uri": uri } });
        std::fs::write(inside.join("sky.gltf"), land.to_string()).unwrap();
    };
    let args = ["map", "in/sky.gltf", "--texel", "quad.vtex", "--add", "-o", "out/sky.gltf"];
    for uri in ["../secret", "%2e%2e/secret"] {
        sky(uri);
        assert!(folder.fails(1, &args).contains("is not a relative path"), "{uri}");
        assert!(
            folder.fails(1, &["render", "in/sky.gltf", "--frame", "-o", "o.png"]).contains("relative path"),
            "{uri}"
        );
    }
    sky("grass.png");
    folder.succeeds(&args);
    assert!(folder.path("out/grass.png").is_file(), "the sky goes with the landscape");
    // What lies inside is copied as before.
    std::fs::remove_dir_all(folder.path("out")).unwrap();
    std::fs::create_dir(folder.path("out")).unwrap();
    std::fs::write(inside.join("g.gltf"), ground("ground.bin", "grass.png")).unwrap();
    folder.succeeds(&["map", "in/g.gltf", "--texel", "quad.vtex", "--planar", "y", "-o", "out/o.gltf"]);
    assert!(folder.path("out/ground.bin").is_file() && folder.path("out/grass.png").is_file());
}

#[cfg(unix)]
#[test]
fn what_never_ends_is_not_read() {
    let folder = Folder::with_landscape();
    assert!(std::process::Command::new("mkfifo").arg(folder.path("fifo")).status().unwrap().success());
    for name in [
        "f.vtex", "f.obj", "f.gltf", "f.lsys", "f.toml", "f.nrrd", "f.nii", "f.mha", "f.dcm", "f.tif", "f.csv", "f.png",
    ] {
        std::os::unix::fs::symlink("fifo", folder.path(name)).unwrap();
    }
    std::os::unix::fs::symlink("/dev/zero", folder.path("z.vtex")).unwrap();
    std::os::unix::fs::symlink("/dev/zero", folder.path("z.exr")).unwrap();
    for source in [
        "f.vtex", "f.obj", "f.gltf", "f.lsys", "f.toml", "f.nrrd", "f.nii", "f.mha", "f.dcm", "f.tif", "f.csv",
        "z.vtex",
    ] {
        folder.fails(1, &["bake", source, "-r", "16", "-o", "o.vtex"]);
    }
    for args in [
        &["verify", "f.vtex"][..],
        &["inspect", "z.vtex"],
        &["truncate", "f.vtex", "--depth", "1", "-o", "o.vtex"],
        &["merge", "quad.vtex", "f.vtex", "-o", "o.vtex"],
        &["render", "f.gltf", "-o", "o.png"],
        &["map", "f.gltf", "--texel", "quad.vtex", "-o", "o.glb"],
        &["map", "ground.gltf", "--texel", "z.vtex", "-o", "o.glb"],
        &["compare", "f.png", "a.png"],
        &["compare", "a.png", "z.exr"],
        &["error", "quad.vtex", "--source", "f.obj"],
        &["recipe", "--check", "f.toml"],
    ] {
        folder.fails(1, args);
    }
}

#[test]
fn text_from_files_is_shown_as_text() {
    let folder = Folder::new();
    let forged = "leaf\nerror: all is lost \u{1b}[31m\u{7f}\u{9b}";
    let gltf = ground("ground.bin", "missing.png").replace("\"grass\"", &serde_json::json!(forged).to_string());
    folder.save("forged.gltf", gltf.as_bytes());
    let unsafe_char = |text: &str| text.chars().any(|c| c != '\n' && c != '\t' && c.is_control());
    folder.succeeds(&["bake", "forged.gltf", "-r", "16", "-o", "forged.vtex"]);
    for args in [
        &["bake", "forged.gltf", "-r", "16", "-o", "o.vtex"][..],
        &["inspect", "forged.vtex"],
        &["inspect", "forged.vtex", "--json"],
        &["map", "forged.gltf", "--texel", "quad.vtex", "--planar", "y", "-o", "o.gltf"],
    ] {
        let (code, out, err) = folder.run(args);
        let out = String::from_utf8(out).unwrap();
        assert_eq!(code, 0, "{err}");
        for line in out.lines().chain(err.lines()) {
            assert!(!line.starts_with("error") && !unsafe_char(line), "{args:?}: {line:?}");
        }
    }
    let (_, out, _) = folder.run(&["inspect", "forged.vtex", "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&out).unwrap();
    assert_eq!(json["materials"][0]["name"], forged, "escaped, not changed");
}

/// Nobody listens: no message, no panic, the same exit codes.
#[cfg(unix)]
#[test]
fn a_closed_standard_error_is_no_failure() {
    let folder = Folder::new();
    let closed = |args: &str| {
        let line = format!("exec '{}' {args} 2>&-", env!("CARGO_BIN_EXE_vtex"));
        std::process::Command::new("sh").arg("-c").arg(line).current_dir(folder.0.path()).status().unwrap().code()
    };
    assert_eq!(closed("bake quad.obj -r 16 -o o.vtex"), Some(0));
    assert_eq!(closed("verify missing.vtex"), Some(1));
    assert_eq!(closed("truncate quad.vtex --depth 2 -o quad.vtex"), Some(2));
    readable::verify(&folder.path("o.vtex"));
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let status = folder.command(&["verify", "missing.vtex"]).stderr(writer).status().unwrap();
    assert_eq!(status.code(), Some(1));
}

/// Sources, texels and landscapes in folders of their own, made twice from somewhere else: the second run takes the new
/// versions. What the user has put there is never written over.
#[test]
fn a_second_run_refreshes_what_the_first_copied() {
    let folder = Folder::new();
    for name in ["from", "texels", "out", "elsewhere"] {
        std::fs::create_dir(folder.path(name)).unwrap();
    }
    for name in ["quad.obj", "ground.gltf", "ground.bin", "grass.png"] {
        std::fs::copy(folder.path(name), folder.path("from").join(name)).unwrap();
    }
    let there = |args: &[&str]| {
        let done = folder.command(args).current_dir(folder.path("elsewhere")).output().unwrap();
        (done.status.success(), String::from_utf8_lossy(&done.stderr).into_owned())
    };
    let bake = || there(&["bake", "../from/quad.obj", "-r", "16", "-o", "../texels/t.vtex"]);
    let map = |name: &str| {
        let output = format!("../out/{name}");
        there(&["map", "../from/ground.gltf", "--texel", "../texels/t.vtex", "--planar", "y", "-o", &output])
    };
    let render = || there(&["render", "../out/l.gltf", "--frame", "--size", "16x9", "-o", "../out/l.png"]);
    let same = |a: &str, b: &str| std::fs::read(folder.path(a)).unwrap() == std::fs::read(folder.path(b)).unwrap();
    let works = |(done, err): (bool, String)| assert!(done, "{err}");

    works(bake());
    works(map("l.gltf"));
    works(map("second.glb"));
    works(render());
    let first = std::fs::read(folder.path("out/l.gltf")).unwrap();
    works(map("l.gltf"));
    assert!(std::fs::read(folder.path("out/l.gltf")).unwrap() == first, "the same again is the same");
    let picture = std::fs::read(folder.path("out/l.png")).unwrap();
    std::fs::write(folder.path("from/quad.obj"), QUAD.replace("v 1 1 0", "v 1 3 0")).unwrap();
    image::RgbImage::from_pixel(2, 2, image::Rgb([200, 20, 30])).save(folder.path("from/grass.png")).unwrap();
    works(bake());
    assert!(!same("texels/t.vtex", "out/t.vtex"));
    works(map("l.gltf"));
    works(render());
    assert!(same("texels/t.vtex", "out/t.vtex") && same("from/grass.png", "out/grass.png"));
    assert_ne!(std::fs::read(folder.path("out/l.png")).unwrap(), picture);
    // Either of two landscapes in one folder may be the first.
    std::fs::write(folder.path("from/quad.obj"), QUAD.replace("v 1 1 0", "v 1 2 0")).unwrap();
    works(bake());
    works(map("second.glb"));
    works(map("l.gltf"));
    assert!(same("texels/t.vtex", "out/t.vtex"));
    // Not if somebody else wrote it since.
    std::fs::copy(folder.path("quad.vtex"), folder.path("out/t.vtex")).unwrap();
    let (done, err) = map("l.gltf");
    assert!(!done && err.contains("a different t.vtex is already there"), "{err}");
    assert!(same("quad.vtex", "out/t.vtex"));
}
