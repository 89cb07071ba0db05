//! The options of `vtex bake`, one by one, on small sources that are written here.

use std::path::Path;

use assert_cmd::Command;
use tempfile::TempDir;

/// A closed cube with a lid that opens: eight corners, six quads; `open` leaves one out.
fn cube(open: bool) -> String {
    let mut text = String::from("mtllib c.mtl\nusemtl red\n");
    for i in 0..8 {
        text += &format!("v {} {} {}\n", i & 1, i >> 1 & 1, i >> 2);
    }
    let faces = ["1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"];
    for face in &faces[usize::from(open)..] {
        text += &format!("f {face}\n");
    }
    text
}

const LINES: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0.5\nl 1 2 3\n";

/// Two triangles, each a node, and a second scene with the one alone.
const NODES: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1]},{"name":"one","nodes":[1]}],
    "nodes":[{"mesh":0,"name":"Leaf.1"},{"mesh":0,"name":"Trunk","translation":[3,0,0]}],
    "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
    "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],
    "bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]}"#;

struct Bench(TempDir);

impl Bench {
    fn new() -> Bench {
        let dir = tempfile::tempdir().unwrap();
        let save = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
        save("cube.obj", &cube(false));
        save("open.obj", &cube(true));
        save("c.mtl", "newmtl red\nKd 1 0 0\n");
        save("lines.obj", LINES);
        save("nodes.gltf", NODES);
        Bench(dir)
    }

    fn path(&self, name: &str) -> std::path::PathBuf {
        self.0.path().join(name)
    }

    /// `vtex ARGS`: exit code, stdout, stderr.
    fn vtex(&self, args: &[&str]) -> (i32, String, String) {
        let run = Command::cargo_bin("vtex").unwrap().current_dir(self.0.path()).args(args).output().unwrap();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (run.status.code().unwrap(), text(&run.stdout), text(&run.stderr))
    }

    /// `vtex bake ARGS --json`, which succeeds.
    fn bake(&self, args: &[&str]) -> serde_json::Value {
        let (code, out, err) = self.vtex(&[&["bake"], args, &["--json"]].concat());
        assert_eq!(code, 0, "{args:?} {err}");
        let report: serde_json::Value = serde_json::from_str(&out).unwrap();
        super::readable::verify(&self.path(report["output"].as_str().unwrap()));
        report
    }

    /// `vtex bake ARGS`, which fails: code and the line that says why.
    fn fails(&self, args: &[&str]) -> (i32, String) {
        let (code, _, err) = self.vtex(&[&["bake"], args].concat());
        let line = err.lines().find(|l| l.starts_with("error: ")).unwrap_or_default().to_owned();
        assert!(code != 0 && !line.is_empty(), "{args:?} {err}");
        (code, line)
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }
}

#[test]
fn fill() {
    let bench = Bench::new();
    let voxels = |args: &[&str]| bench.bake(args)["finest_voxels"].as_u64().unwrap();
    let shell = voxels(&["cube.obj", "-r", "16", "--fill", "surface"]);
    let solid = voxels(&["cube.obj", "-r", "16", "--fill", "solid"]);
    // Terminal nodes above the finest depth count as one voxel each.
    assert!(solid > shell, "{solid} {shell}");
    assert_eq!(voxels(&["cube.obj", "-r", "16"]), solid);
    assert_eq!(voxels(&["open.obj", "-r", "16"]), voxels(&["open.obj", "-r", "16", "--fill", "surface"]));
    let open = bench.bake(&["open.obj", "-r", "16", "--fill", "solid"]);
    let warnings = open["warnings"].as_array().unwrap();
    let is_told = |w: &serde_json::Value| w["message"].as_str().unwrap().contains("do not close") && w["count"] == 10;
    assert!(warnings.iter().any(is_told), "{warnings:?}");
}

#[test]
fn sizes() {
    let bench = Bench::new();
    let (_, _, err) = bench.vtex(&["bake", "cube.obj", "-r", "20"]);
    assert!(err.contains("-r 20 is rounded up to 32"), "{err}");
    let report = bench.bake(&["cube.obj", "--voxel-size", "0.1"]);
    assert_eq!(report["resolution"], 16);
    assert!((report["voxel_size"].as_f64().unwrap() - 0.1).abs() < 1e-6);
    for size in ["0", "nan", "1e-9"] {
        let (code, line) = bench.fails(&["cube.obj", "--voxel-size", size]);
        assert!(code == 2 && line.replace("--voxel-size", "voxel size").contains("voxel size"), "{line}");
    }
    for resolution in ["0", "4097", "x"] {
        assert_eq!(bench.fails(&["cube.obj", "-r", resolution]).0, 2);
    }
    let (code, line) = bench.fails(&["cube.obj", "--memory", "1K"]);
    assert!(code == 1 && line.contains("the limit is 1024"), "{line}");
}

/// Facets much wider than the cube, which shows a piece of them: the file says the widest that it may say.
#[test]
fn facets_wider_than_the_cube_are_readable() {
    let bench = Bench::new();
    std::fs::write(bench.path("ground.obj"), "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nf 1 2 3 4\n").unwrap();
    bench.bake(&["ground.obj", "-r", "64", "--voxel-size", "0.01", "--cyclic", "u,v"]);
    let recipe = "bounds = { min = [0,0,0], max = [1,1,1] }\n[[draw]]\n\
        triangle = { corners = [[-50,0.5,-50],[50,0.5,-50],[0,0.5,90]] }\n";
    std::fs::write(bench.path("recipe.toml"), recipe).unwrap();
    bench.bake(&["recipe.toml", "-r", "64"]);
    for name in ["ground.vtex", "recipe.vtex"] {
        let (_, out, _) = bench.vtex(&["inspect", name, "--json"]);
        let inspected: serde_json::Value = serde_json::from_str(&out).unwrap();
        assert!(inspected["facet_size"].as_f64().unwrap() <= 2.0, "{name}");
    }
}

/// A recipe that draws itself, also by another path each time, is refused in the end.
#[test]
fn a_recipe_that_draws_itself_ends() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("loop")).unwrap();
    let recipe = "[[draw]]\nsource = \"../loop/loop.toml\"\n";
    std::fs::write(bench.path("loop/loop.toml"), recipe).unwrap();
    assert!(bench.fails(&["loop/loop.toml", "-r", "16"]).1.contains("draws itself"));
    let (code, _, err) = bench.vtex(&["recipe", "--check", "loop/loop.toml"]);
    assert!(code == 1 && err.contains("draws itself"), "{err}");
}

#[test]
fn what_is_stored() {
    let bench = Bench::new();
    let bytes = |args: &[&str]| bench.bake(args)["file_bytes"].as_u64().unwrap();
    let full = bytes(&["cube.obj", "-r", "32"]);
    assert!(
        bytes(&["cube.obj", "-r", "32", "--compress", "19"]) <= bytes(&["cube.obj", "-r", "32", "--compress", "1"])
    );
    assert!(bytes(&["cube.obj", "-r", "32", "--quality", "lean"]) <= full);
    for (args, key, want) in [
        (["--cyclic", "u,w"], "cyclic", serde_json::json!([true, false, true])),
        (["--model", "neyret"], "model", serde_json::json!("neyret")),
        (["--model", "coverage"], "model", serde_json::json!("coverage")),
    ] {
        bench.bake(&[&["cube.obj", "-r", "16", "-o", "o.vtex"], &args[..]].concat());
        let (code, out, err) = bench.vtex(&["inspect", "o.vtex", "--json"]);
        assert_eq!(code, 0, "{err}");
        let inspected: serde_json::Value = serde_json::from_str(&out).unwrap();
        assert_eq!(inspected[key], want);
    }
    assert_eq!(bench.fails(&["cube.obj", "--cyclic", "x"]).0, 2);
}

/// Errors are told where they were measured, and nowhere else.
#[test]
fn errors_are_those_that_were_measured() {
    let bench = Bench::new();
    for (model, measured) in [("coverage", true), ("neyret", false)] {
        bench.bake(&["cube.obj", "-r", "16", "--model", model, "-o", "o.vtex", "--report", "o.json"]);
        let report: serde_json::Value = serde_json::from_slice(&bench.bytes("o.json")).unwrap();
        let (_, out, _) = bench.vtex(&["inspect", "o.vtex", "--json"]);
        let inspected: serde_json::Value = serde_json::from_str(&out).unwrap();
        let finest = |json: &serde_json::Value| json["depths"].as_array().unwrap().last().unwrap().clone();
        assert_eq!(finest(&report)["error_p95"].is_number(), measured);
        assert_eq!(finest(&inspected)["error"].is_object(), measured);
        assert_eq!(inspected["meta"].get("error").is_some(), measured);
    }
}

#[test]
fn any_number_of_threads_writes_the_same_bytes() {
    let bench = Bench::new();
    for threads in ["1", "2", "5"] {
        bench.bake(&["cube.obj", "-r", "64", "--threads", threads, "-o", &format!("{threads}.vtex")]);
    }
    assert!(bench.bytes("1.vtex") == bench.bytes("2.vtex") && bench.bytes("1.vtex") == bench.bytes("5.vtex"));
}

#[test]
fn scenes_and_nodes() {
    let bench = Bench::new();
    let size = |args: &[&str]| {
        let report = bench.bake(&[&["nodes.gltf", "-r", "16"], args].concat());
        report["voxel_size"].as_f64().unwrap() * 16.0
    };
    let both = size(&[]);
    let one = size(&["--include", "Trunk"]);
    // 4 m and 1 m, and at most a voxel and a half around.
    assert!((4.0..4.5).contains(&both) && (1.0..1.2).contains(&one), "{both} {one}");
    for args in [["--include", "Leaf*"], ["--exclude", "Tr?nk"], ["--scene", "one"], ["--scene", "1"]] {
        assert!((size(&args) - one).abs() < 1e-6, "{args:?}");
    }
    for args in [["--include", "oak"], ["--scene", "9"]] {
        let (code, line) = bench.fails(&["nodes.gltf", args[0], args[1]]);
        assert!(code == 2 && line.contains(args[1]), "{line}");
    }
    let (code, line) = bench.fails(&["nodes.gltf", "--exclude", "*"]);
    assert!(code == 1 && line.contains("nothing is drawn"), "{line}");
}

#[test]
fn lines_need_a_width() {
    let bench = Bench::new();
    let (code, line) = bench.fails(&["lines.obj"]);
    assert!(code == 1 && line.contains("2 × lines and points are left out"), "{line}");
    assert!(!bench.path("lines.vtex").exists());
    let report = bench.bake(&["lines.obj", "-r", "32", "--line-width", "0.05"]);
    assert!(report["finest_voxels"].as_u64().unwrap() > 50);
    assert_eq!(bench.fails(&["lines.obj", "--line-width", "0"]).0, 2);
}

#[test]
fn outputs_are_checked_before_work_begins() {
    let bench = Bench::new();
    let before = bench.bytes("cube.obj");
    for args in [["-o", "no/where.vtex"], ["--depfile", "no/where.d"], ["--report", "no/where.json"]] {
        let (code, line) = bench.fails(&["cube.obj", "-r", "16", args[0], args[1]]);
        assert!(code == 1 && line.contains("no/where") && line.contains("folder"), "{line}");
        assert!(!bench.path("cube.vtex").exists(), "{args:?}");
    }
    for output in ["cube.obj", "./c.mtl", "."] {
        let (code, line) = bench.fails(&["cube.obj", "-r", "16", "-o", output]);
        assert_eq!(code, 2, "{line}");
    }
    assert_eq!(bench.bytes("cube.obj"), before);
    let (code, line) = bench.fails(&["cube.stl"]);
    assert!(code == 1 && line.contains(".gltf, .glb, .obj"), "{line}");
    assert!(!parts_left(bench.0.path()));
}

#[test]
fn a_depfile_is_a_rule_of_make() {
    let bench = Bench::new();
    bench.bake(&["cube.obj", "-r", "16", "-o", "a b.vtex", "--depfile", "a.d"]);
    assert_eq!(
        String::from_utf8(bench.bytes("a.d")).unwrap(),
        "a\\ b.vtex: cube.obj \\\n  c.mtl\n\ncube.obj:\n\nc.mtl:\n"
    );
    // What is found although it is named as on another machine, and what a GLB names.
    let save = |name: &str, bytes: &[u8]| std::fs::write(bench.path(name), bytes).unwrap();
    save("c.mtl", b"newmtl red\nmap_Kd -s 1 1 1 C:\\work\\my leaf.png\n");
    save("my leaf.png", b"no picture");
    bench.bake(&["cube.obj", "-r", "16", "--depfile", "a.d"]);
    let text = String::from_utf8(bench.bytes("a.d")).unwrap();
    assert!(text.starts_with("cube.vtex: cube.obj \\\n  c.mtl \\\n  my\\ leaf.png\n\n"), "{text}");
    let data = NODES.split_once("data:").and_then(|(_, rest)| rest.split_once('"')).unwrap().0;
    let mut json = NODES.replace(&format!("data:{data}"), "tri%20angle.bin").into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut glb = b"glTF\x02\0\0\0".to_vec();
    glb.extend((20 + json.len() as u32).to_le_bytes());
    glb.extend((json.len() as u32).to_le_bytes());
    glb.extend(b"JSON");
    glb.extend(json);
    save("nodes.glb", &glb);
    let corners: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    save("tri angle.bin", &corners.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
    bench.bake(&["nodes.glb", "-r", "16", "--depfile", "a.d"]);
    let text = String::from_utf8(bench.bytes("a.d")).unwrap();
    assert!(text.starts_with("nodes.vtex: nodes.glb \\\n  tri\\ angle.bin\n\n"), "{text}");
}

#[test]
fn strict_fails_on_warnings_and_leaves_the_old_file() {
    let bench = Bench::new();
    std::fs::remove_file(bench.path("c.mtl")).unwrap();
    std::fs::write(bench.path("cube.vtex"), "old").unwrap();
    assert!(bench.fails(&["cube.obj", "-r", "16", "--strict"]).1.contains("--strict"));
    assert_eq!(bench.bytes("cube.vtex"), b"old");
    bench.bake(&["cube.obj", "-r", "16"]);
    assert_ne!(bench.bytes("cube.vtex"), b"old");
    assert!(!parts_left(bench.0.path()));
}

fn parts_left(dir: &Path) -> bool {
    std::fs::read_dir(dir).unwrap().any(|e| e.unwrap().path().extension().is_some_and(|e| e == "part"))
}

/// Bytes of the program, its tables and the source, besides what `--memory` is about.
#[cfg(target_os = "linux")]
const PROGRAM: u64 = 64 << 20;

/// Bake with `more`, and give the largest memory that the process had.
#[cfg(target_os = "linux")]
fn peak_of(output: &Path, more: &[&str]) -> u64 {
    let tree = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/tree.glb");
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_vtex"))
        .args(["bake", "--quiet", "-r", "256", "--compress", "1", "-o"])
        .arg(output)
        .arg(tree)
        .args(more)
        .spawn()
        .unwrap();
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0;
    while child.try_wait().unwrap().is_none() {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:"));
        let kib = line.and_then(|l| l.split_whitespace().next()).and_then(|n| n.parse::<u64>().ok());
        peak = peak.max(1024 * kib.unwrap_or(0));
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    assert!(child.wait().unwrap().success());
    peak
}

#[cfg(target_os = "linux")]
#[test]
fn a_limit_of_memory_is_kept_and_changes_no_byte() {
    let dir = TempDir::new().unwrap();
    let [free, limited, report] = ["free.vtex", "limited.vtex", "report.json"].map(|name| dir.path().join(name));
    peak_of(&free, &["--report", &report.display().to_string()]);
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(report).unwrap()).unwrap();
    let limit = report["estimate"]["memory_bytes"].as_u64().unwrap();
    let peak = peak_of(&limited, &["--memory", &limit.to_string()]);
    assert!(peak > 0 && peak <= limit + PROGRAM, "{peak} of {limit}");
    assert_eq!(std::fs::read(free).unwrap(), std::fs::read(limited).unwrap());
}
