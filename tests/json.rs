//! `--json` of every command: one object, or an array of several inputs, with keys in snake_case, and nothing else on stdout.

use serde_json::Value;

use crate::outputs::Folder;

/// The JSON that `command` printed, whose keys are in one style.
pub fn of(command: &str, stdout: &[u8]) -> Value {
    let text = std::str::from_utf8(stdout).unwrap();
    let value: Value = serde_json::from_str(text).unwrap_or_else(|e| panic!("{command}: {e}: {text}"));
    check_keys(command, &value);
    value
}

/// `[a-z][a-z0-9_]*`, all the way down.
fn check_keys(command: &str, value: &Value) {
    for (key, inner) in value.as_object().into_iter().flatten() {
        let letters = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
        let is_snake = key.starts_with(|c: char| c.is_ascii_lowercase()) && key.chars().all(letters);
        assert!(is_snake, "{command}: the key {key:?}");
        check_keys(command, inner);
    }
    value.as_array().into_iter().flatten().for_each(|inner| check_keys(command, inner));
}

/// Commands without `--json`: a shell's script is all that the first prints, and the other writes manual pages.
const WITHOUT: [&str; 2] = ["completions", "man"];
/// Their JSON is checked where they are tested: they take long, go on until they are ended, or need more than the folder has.
const ELSEWHERE: [&str; 4] = ["bench", "demo", "expand", "view"];

#[test]
fn every_command_prints_json() {
    let folder = Folder::with_landscape();
    folder.save("r.toml", b"[[draw]]\nsource = \"quad.obj\"\n");
    let cases: [(&[&str], &[&str]); 23] = [
        (
            &["bake", "quad.obj", "--voxel-size", "0.1", "--line-width", "1", "--section", "flat"],
            &["input", "output", "resolution", "voxel_size", "finest_voxels", "file_bytes", "seconds", "warnings"],
        ),
        (&["compare", "a.png", "b.png"], &["all", "warnings"]),
        (&["error", "quad.vtex", "--source", "quad.obj", "--pixels", "16", "--rays", "4"], &["depths", "warnings"]),
        (&["inspect", "quad.vtex"], &["input", "resolution", "depths", "channels", "meta", "warnings"]),
        (&["merge", "quad.vtex", "quad.vtex", "-o", "m.vtex"], &["inputs", "output", "finest_voxels", "warnings"]),
        (&["resample", "quad.vtex", "-o", "s.vtex"], &["inputs", "output", "resolution", "file_bytes", "warnings"]),
        (&["recipe", "--check", "r.toml"], &["input", "nodes", "warnings"]),
        (&["render", "land.gltf", "--frame", "--size", "16x9"], &["input", "output", "width", "seconds", "warnings"]),
        (
            &["render", "land.gltf", "--frame", "--size", "16x9", "--tile", "0,0,16,9", "-o", "tile.png"],
            &["tile", "width", "height"],
        ),
        (&["stitch", "tile.png", "-o", "whole.png"], &["output", "width", "height", "tiles", "warnings"]),
        (&["farm", "land.gltf", "-o", "job.yaml"], &["input", "output", "pictures", "tiles", "bakes", "warnings"]),
        (
            &["render", "land.gltf", "--frame", "--size", "16x9", "--stats"],
            &["bytes_read", "cones", "per_pixel", "peak_bytes"],
        ),
        (&["render", "ground.gltf", "--frame", "--size", "16x9", "--reference", "2"], &["samples", "noise_rmse"]),
        (&["render", "land.gltf", "--frame", "--size", "16x9", "--pixel", "8,4"], &[]),
        (&["stress", "--rays", "1000"], &["rays", "events", "suites"]),
        (&["verify", "quad.vtex"], &["input", "valid", "voxels", "file_bytes", "warnings"]),
        (&["truncate", "quad.vtex", "--depth", "2", "-o", "t.vtex"], &["output", "resolution", "file_bytes"]),
        (
            &["map", "ground.gltf", "--texel", "quad.vtex", "--planar", "y", "-o", "l.gltf"],
            &["input", "output", "covered", "copied", "warnings"],
        ),
        (&["map", "ground.gltf", "--texel", "quad.vtex", "-o", "l.gltf"], &["covered"]),
        // Of several inputs.
        (&["bake", "quad.obj", "r.toml", "-r", "16"], &["output"]),
        (&["export", "quad.vtex", "-o", "quad.html"], &["input", "output", "file_bytes"]),
        (&["inspect", "quad.vtex", "m.vtex"], &["input"]),
        (&["render", "land.gltf", "ground.gltf", "--frame", "--size", "16x9"], &["output"]),
    ];
    for (args, wanted) in cases {
        let (code, out, err) = folder.run(&[args, &["--json"]].concat());
        assert_eq!(code, 0, "{args:?}: {err}");
        let told = of(args[0], &out);
        let objects: Vec<&Value> = told.as_array().map_or_else(|| vec![&told], |list| list.iter().collect());
        for key in wanted {
            assert!(objects.iter().all(|object| object.get(key).is_some()), "{args:?}: no {key:?} in {told}");
        }
    }
    // None is forgotten.
    let (_, help, _) = folder.run(&["--help"]);
    let help = String::from_utf8(help).unwrap();
    let listed = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let names = listed.filter_map(|line| line.split_whitespace().next().filter(|_| !line.starts_with("    ")));
    let known = |name: &str| cases.iter().any(|(args, _)| args[0] == name) || WITHOUT.contains(&name);
    let forgotten: Vec<_> = names.filter(|name| *name != "help" && !known(name) && !ELSEWHERE.contains(name)).collect();
    assert!(forgotten.is_empty(), "{forgotten:?}");
}

#[test]
fn of_several_inputs_those_that_can_be_done_are_done() {
    let folder = Folder::with_landscape();
    std::fs::create_dir(folder.path("out")).unwrap();
    folder.save("bad.obj", b"v 0 0 0\n");
    folder.save("bad.vtex", b"no texel");
    folder.save("bad.gltf", b"no glTF");
    let size = ["--size", "16x9", "--frame"];
    let cases: [(Vec<&str>, &str); 4] = [
        (vec!["bake", "bad.obj", "quad.obj", "-r", "16", "-o", "out/"], "out/quad.vtex"),
        ([&["render", "bad.gltf", "land.gltf", "-o", "out"], &size[..]].concat(), "out/land.png"),
        (vec!["inspect", "bad.vtex", "quad.vtex"], "quad.vtex"),
        (vec!["verify", "bad.vtex", "quad.vtex"], "quad.vtex"),
    ];
    for (args, made) in cases {
        let (code, out, err) = folder.run(&[&args[..], &["--json"]].concat());
        let told = of(args[0], &out);
        assert_eq!(code, 1, "{args:?} {err}");
        assert!(told[0]["error"].as_str().unwrap().contains("bad") && told[1].get("error").is_none(), "{told}");
        let errors: Vec<_> = err.lines().filter(|line| line.starts_with("error: ")).collect();
        assert!(errors.len() == 2 && errors[0].contains("bad") && errors[1].contains("1 of 2 inputs failed"), "{err}");
        assert!(folder.path(made).exists());
    }
    // One folder cannot hold two of a name, and one name not two outputs.
    std::fs::create_dir(folder.path("in")).unwrap();
    std::fs::copy(folder.path("quad.obj"), folder.path("in/quad.obj")).unwrap();
    assert!(folder.fails(2, &["bake", "quad.obj", "in/quad.obj", "-o", "out/"]).contains("two outputs"));
    assert!(folder.fails(2, &["bake", "quad.obj", "in/quad.obj", "-o", "x.vtex"]).contains("need a folder"));
}

#[test]
fn outputs_without_a_name_stand_where_the_user_is() {
    let folder = Folder::with_landscape();
    std::fs::create_dir(folder.path("here")).unwrap();
    let there = |args: &[&str]| {
        let done = folder.command(args).current_dir(folder.path("here")).output().unwrap();
        let err = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.success(), "{args:?}: {err}");
        err
    };
    assert!(there(&["render", "../land.gltf", "--frame", "--size", "16x9"]).contains("land.png"));
    assert!(there(&["bake", "../quad.obj", "-r", "16"]).contains("quad.vtex"));
    let said = there(&["map", "../ground.gltf", "--texel", "quad.vtex", "--planar", "y"]);
    assert!(said.contains("wrote ground-landscape.gltf"), "{said}");
    for name in ["land.png", "quad.vtex", "ground-landscape.gltf"] {
        assert!(folder.path("here").join(name).is_file(), "{name}");
    }
}

/// A name that clears the screen and forges a line, in every place of a file that commands print.
#[test]
fn text_of_files_is_shown_as_text() {
    let folder = Folder::with_landscape();
    let evil = "x\u{1b}[31m\nerror: y";
    let text = crate::outputs::ground("ground.bin", "grass.png");
    let mut file: Value = serde_json::from_str(&text).unwrap();
    for list in ["materials", "meshes", "nodes", "scenes", "textures", "images", "accessors"] {
        file[list][0]["name"] = evil.into();
    }
    file["asset"]["generator"] = evil.into();
    file["extensionsUsed"] = serde_json::json!([evil]);
    folder.save("evil.gltf", file.to_string().as_bytes());
    let frame = ["--frame", "--size", "16x9"];
    let cases: [(i32, Vec<&str>); 9] = [
        (0, vec!["bake", "evil.gltf", "-r", "16", "--report", "evil.json"]),
        (0, vec!["inspect", "evil.vtex"]),
        (0, vec!["verify", "evil.vtex"]),
        (0, vec!["map", "evil.gltf", "--texel", "evil.vtex", "--planar", "y", "-o", "evil.glb"]),
        (0, vec!["map", "evil.glb", "--texel", "evil.vtex", "--planar", "y", "--bend", "-o", "again.glb"]),
        (0, [&["render", "again.glb", "--pixel", "8,4"], &frame[..]].concat()),
        (0, [&["render", "evil.glb", "--stats"], &frame[..]].concat()),
        // Errors that list what there is.
        (2, vec!["map", "evil.gltf", "--texel", "evil.vtex", "--material", "none", "-o", "no.glb"]),
        (2, vec!["bake", "evil.gltf", "-r", "16", "--include", "none", "-o", "no.vtex"]),
    ];
    for (wanted, args) in cases {
        for json in [&[][..], &["--json"]] {
            let all = [&args[..], json].concat();
            let (code, out, err) = folder.run(&all);
            assert!(code == wanted || (wanted != 0 && code != 0), "{all:?}: {code} {err}");
            let out = String::from_utf8(out).unwrap();
            for text in [&out, &err] {
                assert!(!text.chars().any(|c| c.is_control() && c != '\n' && c != '\t'), "{all:?}: {text:?}");
                assert!(!text.lines().any(|line| line.starts_with("error: y")), "{all:?}: {text}");
            }
            if !json.is_empty() && code == 0 {
                serde_json::from_str::<Value>(&out).unwrap_or_else(|e| panic!("{all:?}: {e}: {out}"));
            }
        }
    }
}

/// Streams that are closed, or that nobody reads, are no reason to fail.
#[cfg(target_os = "linux")]
#[test]
fn closed_streams_are_no_panic() {
    let folder = Folder::with_landscape();
    let shell = |line: String| {
        let mut command = std::process::Command::new("sh");
        let done = command.current_dir(folder.path("")).args(["-c", &line]).output().unwrap();
        (done.status.code(), String::from_utf8_lossy(&done.stderr).into_owned())
    };
    let vtex = env!("CARGO_BIN_EXE_vtex");
    let commands = [
        "bake quad.obj -r 2 -o c.vtex --json",
        "inspect quad.vtex",
        "verify quad.vtex --json",
        "map ground.gltf --texel quad.vtex --planar y -o c.glb --json",
        "render land.gltf --frame --size 16x9 -o c.png --stats",
        "truncate quad.vtex --depth 2 -o c2.vtex --json",
    ];
    for command in commands {
        for streams in ["2>&-", "1>&-", "1>&- 2>&-", "| true", "2>&1 | true"] {
            let (code, err) = shell(format!("'{vtex}' {command} {streams}"));
            assert!(!err.contains("panicked"), "{command} {streams}: {err}");
            // A shell gives the code of `true` for a pipe.
            assert!(matches!(code, Some(0)) || streams.contains("1>&-"), "{command} {streams}: {code:?} {err}");
            assert_ne!(code, Some(101), "{command} {streams}");
        }
        let (code, _) = shell(format!("'{vtex}' {command} --no-such-option 2>&- 1>&-"));
        assert_eq!(code, Some(2), "{command}");
    }
}

/// What a library's caller gets is what the terminal's user gets; a bake prints from a pool of threads of its own.
#[test]
fn inside_another_program_results_are_handed_back() {
    let folder = Folder::with_landscape();
    let path = |name: &str| folder.path(name).to_str().unwrap().to_owned();
    let (quad, out) = (path("quad.obj"), path("inside.vtex"));
    let words = ["bake", "--json", "--voxel-size=0.1", "--line-width=1", "--section=flat", "-o", &out, "--", &quad];
    let told = of("bake", vtex::cli::run_inside(&words).unwrap().as_bytes());
    assert_eq!((&told["input"], &told["output"]), (&quad.as_str().into(), &out.as_str().into()));
    let seen = of("inspect", vtex::cli::run_inside(&["inspect", "--json", &out]).unwrap().as_bytes());
    assert_eq!(seen["resolution"], told["resolution"]);
    let wrong = vtex::cli::run_inside(&["bake", "--no-such-option"]).unwrap_err();
    assert!(matches!(wrong, vtex::Error::Options(_)), "{wrong}");
}
