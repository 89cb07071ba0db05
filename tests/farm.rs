//! `vtex farm`: a template of the form of Open Job Description, whose tasks make what `vtex render` makes. Here the tasks are run
//! by a few lines; `.ci/openjd` has them run by the real program.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::outputs::Folder;

/// A landscape whose texel stands in a folder of its own, beside its source.
fn landscape() -> Folder {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("texels")).unwrap();
    folder.succeeds(&["bake", "quad.obj", "-r", "16", "--up", "z", "--quality", "lean", "-o", "texels/quad.vtex"]);
    let map =
        ["map", "ground.gltf", "--texel", "texels/quad.vtex", "--planar", "y", "--wind", "0.5", "-o", "land.gltf"];
    folder.succeeds(&map);
    folder
}

/// Options of all pictures.
const LOOK: [&str; 7] = ["--eye=-1,1.5,5", "--look-at", "2,0,2", "--size", "31x22", "--lanes", "2"];

fn template(folder: &Folder, options: &[&str]) -> Value {
    folder.succeeds(&[&["farm", "land.gltf", "-o", "job.json"], options, &["--"], &LOOK[..]].concat());
    let template = serde_json::from_slice(&std::fs::read(folder.path("job.json")).unwrap()).unwrap();
    check_form(&template);
    template
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap()
}

/// What the specification asks of a template, as far as ours have it.
fn check_form(template: &Value) {
    assert_eq!(template["specificationVersion"], "jobtemplate-2023-09");
    assert_eq!(template["extensions"], serde_json::json!(["TASK_CHUNKING"]));
    let parameters = list(&template["parameterDefinitions"]);
    assert!((1..=50).contains(&parameters.len()));
    let mut known: BTreeSet<String> =
        parameters.iter().map(|p| format!("{{{{Param.{}}}}}", text(&p["name"]))).collect();
    assert_eq!(known.len(), parameters.len(), "names are there once");
    for parameter in parameters.iter().filter(|p| p["type"] == "PATH") {
        let default = text(&parameter["default"]);
        assert!(!default.starts_with('/') && !default.contains(".."), "{default}");
        assert!(["IN", "OUT", "INOUT"].contains(&text(&parameter["dataFlow"])));
    }
    known.extend(["{{Task.Param.Frame}}", "{{Task.Param.Tile}}"].map(String::from));
    let mut names = BTreeSet::new();
    for step in list(&template["steps"]) {
        for needed in list(&step["dependencies"]) {
            assert!(names.contains(text(&needed["dependsOn"])), "{needed}");
        }
        assert!(text(&step["name"]).chars().count() <= 64 && names.insert(text(&step["name"])));
        let run = &step["script"]["actions"]["onRun"];
        for word in list(&run["args"]).iter().chain([&run["command"]]) {
            for piece in text(word).split("{{").skip(1) {
                let name = format!("{{{{{}}}}}", piece.split_once("}}").unwrap().0);
                assert!(known.contains(&name), "{name}");
            }
        }
    }
}

/// The values of a task's parameters, one list a task.
fn tasks(template: &Value, step: &Value, per_task: u32) -> Vec<Vec<(String, String)>> {
    let mut all = vec![vec![]];
    for parameter in list(&step["parameterSpace"]["taskParameterDefinitions"]) {
        let values: Vec<String> = match text(&parameter["type"]) {
            "CHUNK[INT]" => {
                assert_eq!(
                    (text(&parameter["range"]), text(&parameter["chunks"]["rangeConstraint"])),
                    ("{{Param.Frames}}", "CONTIGUOUS")
                );
                let frames = list(&template["parameterDefinitions"]).iter().find(|p| p["name"] == "Frames").unwrap();
                let (first, last) = text(&frames["default"]).split_once('-').unwrap();
                let [first, last]: [u32; 2] = [first, last].map(|n| n.parse().unwrap());
                // A single frame is a range too.
                (first..=last)
                    .step_by(per_task as usize)
                    .map(|n| format!("{n}-{}", last.min(n + per_task - 1)))
                    .collect()
            }
            _ => list(&parameter["range"]).iter().map(|v| text(v).to_owned()).collect(),
        };
        let name = format!("{{{{Task.Param.{}}}}}", text(&parameter["name"]));
        let with = |task: &Vec<(String, String)>| -> Vec<Vec<(String, String)>> {
            values.iter().map(|value| [task.clone(), vec![(name.clone(), value.clone())]].concat()).collect()
        };
        all = all.iter().flat_map(with).collect();
    }
    all
}

/// The command lines of a step's tasks.
fn lines(template: &Value, step: &Value) -> Vec<Vec<String>> {
    let per_task = list(&template["parameterDefinitions"]).iter().find(|p| p["name"] == "FramesPerTask");
    let per_task = per_task.map_or(1, |p| p["default"].as_u64().unwrap() as u32);
    let line = |task: Vec<(String, String)>| {
        let said = list(&template["parameterDefinitions"])
            .iter()
            .filter_map(|p| Some((format!("{{{{Param.{}}}}}", text(&p["name"])), p["default"].as_str()?.to_owned())));
        let values: Vec<(String, String)> = said.chain(task).collect();
        let fill =
            |word: &Value| values.iter().fold(text(word).to_owned(), |word, (name, value)| word.replace(name, value));
        list(&step["script"]["actions"]["onRun"]["args"]).iter().map(fill).collect()
    };
    tasks(template, step, per_task).into_iter().map(line).collect()
}

/// Run all tasks in the order of the steps; what was said.
fn run(folder: &Folder, template: &Value) -> String {
    let mut said = String::new();
    for step in list(&template["steps"]) {
        for line in lines(template, step) {
            let words: Vec<&str> = line.iter().map(String::as_str).collect();
            let (code, _, err) = folder.run(&words);
            assert_eq!(code, 0, "{line:?}: {err}");
            said += &err;
        }
    }
    said
}

#[test]
fn a_job_makes_the_pictures() {
    let folder = landscape();
    let template = template(&folder, &["--frames", "1..3", "--fps", "2", "--chunk", "2", "--tiles", "2x2"]);
    let steps: Vec<&str> = list(&template["steps"]).iter().map(|s| text(&s["name"])).collect();
    assert_eq!(steps, ["Bake 1 quad.vtex", "Render", "Stitch"]);
    let declared = |flow: &str| -> Vec<&str> {
        let of = list(&template["parameterDefinitions"]).iter().filter(|p| p["dataFlow"] == flow);
        of.map(|p| text(&p["default"])).collect()
    };
    assert_eq!(declared("IN"), ["grass.png", "ground.bin", "land.gltf", "land.shell.bin", "quad.obj"]);
    assert_eq!(declared("OUT"), ["land-frames"]);
    assert_eq!(declared("INOUT"), ["land-frames/tiles", "texels/quad.vtex"]);

    let texel = std::fs::read(folder.path("texels/quad.vtex")).unwrap();
    let said = run(&folder, &template);
    assert!(said.contains("1 of 1 texels are unchanged"), "the bake is the one that made the texel: {said}");
    assert!(std::fs::read(folder.path("texels/quad.vtex")).unwrap() == texel);
    folder.succeeds(
        &[&["render", "land.gltf", "--frames", "1..3", "--fps", "2", "-o", "whole.#.png"], &LOOK[..]].concat(),
    );
    let picture = |n: u32| folder.path(&format!("land-frames/land.000{n}.png"));
    for n in 1..=3 {
        let whole = std::fs::read(folder.path(&format!("whole.{n}.png"))).unwrap();
        assert!(std::fs::read(picture(n)).unwrap() == whole, "{n}");
    }

    // Frames that are there are not made again; one that is gone is, by its own task.
    let tile = folder.path("land-frames/tiles/land.15,0,16,11.0002.png");
    let bytes = std::fs::read(&tile).unwrap();
    std::fs::remove_file(&tile).unwrap();
    let said = run(&folder, &template);
    assert_eq!(said.matches("1 frames that were there already are kept").count(), 5, "{said}");
    assert_eq!(said.matches("2 frames that were there already are kept").count(), 3, "{said}");
    assert!(std::fs::read(&tile).unwrap() == bytes);

    // What the texel is made of changes: it is baked anew, and so are the pictures.
    folder.save("quad.obj", b"v 0 0 0\nv 1 0 0\nv 1 0 1\nf 1 2 3\n");
    let said = run(&folder, &template);
    assert!(said.contains("quad.obj has changed") && !said.contains("kept"), "{said}");
}

#[test]
fn a_single_picture_has_neither_frames_nor_a_stitch() {
    let folder = landscape();
    let template = template(&folder, &["--format", "exr"]);
    let names: Vec<&str> = list(&template["steps"]).iter().map(|s| text(&s["name"])).collect();
    assert_eq!(names, ["Bake 1 quad.vtex", "Render"]);
    run(&folder, &template);
    folder.succeeds(&[&["render", "land.gltf", "-o", "whole.exr"], &LOOK[..]].concat());
    let [made, whole] = ["land-frames/land.exr", "whole.exr"].map(|name| std::fs::read(folder.path(name)).unwrap());
    assert!(made == whole);
}

/// A texel that no bake made, or whose source is elsewhere, is an input.
#[test]
fn texels_that_cannot_be_baked_are_taken_as_they_are() {
    let folder = landscape();
    std::fs::create_dir(folder.path("elsewhere")).unwrap();
    std::fs::rename(folder.path("quad.obj"), folder.path("elsewhere/quad.obj")).unwrap();
    let farm = ["farm", "land.gltf", "-o", "job.json"];
    let (code, _, said) = folder.run(&farm);
    assert!(
        code == 0 && said.contains("texels/quad.vtex: quad.obj was not found; --sources names its folder"),
        "{said}"
    );
    let (code, out, said) = folder.run(&[&farm[..], &["--sources", "elsewhere", "--json"]].concat());
    let summary: Value = serde_json::from_slice(&out).unwrap();
    assert!(code == 0 && summary["bakes"] == serde_json::json!(["quad.vtex"]), "{said}");
    std::fs::copy(folder.path("elsewhere/quad.obj"), folder.path("quad.obj")).unwrap();
    for (options, why) in [
        (&["resample", "quad.vtex", "--scale", "2"][..], "it was not made by a bake"),
        (&["bake", "quad.obj", "-r", "8", "--albedo", "grass.png"], "its --albedo is a file"),
    ] {
        folder.succeeds(&[options, &["-o", "texels/quad.vtex"]].concat());
        let (code, _, said) = folder.run(&farm);
        assert!(code == 0 && said.contains(why), "{said}");
    }
}

#[test]
fn a_job_that_cannot_be_is_one_line() {
    let folder = landscape();
    std::fs::create_dir(folder.path("jobs")).unwrap();
    let farm = |more: &[&str]| folder.fails(2, &[&["farm", "land.gltf"], more].concat());
    for (more, what) in [
        (&["-o", "job.txt"][..], "ends in .yaml or .json"),
        (&["-o", "jobs/job.yaml"], "lies outside of"),
        (&["-o", "job.yaml", "--tiles", "0x1"], "cannot be divided so"),
        (&["-o", "job.yaml", "--tiles", "40x40", "--", "--size", "64x64"], "a job may have 1024 tiles"),
        (&["-o", "job.yaml", "--tiles", "40x1", "--", "--size", "32x32"], "cannot be divided so"),
        (&["-o", "job.yaml", "--", "--nonsense"], "after --: unexpected argument '--nonsense'"),
        (&["-o", "job.yaml", "--", "-o", "x.png"], "cannot be used multiple times"),
        (&["-o", "job.yaml", "--", "--stats"], "--stats, --json, --tile and --depfile"),
        (&["-o", "job.yaml", "--", "--tile", "0,0,1,1"], "--stats, --json, --tile and --depfile"),
        (&["-o", "job.yaml", "--tiles", "2x1", "--", "--reference", "2"], "--reference is not made in tiles"),
        (&["-o", "job.yaml", "--", "other.gltf"], "a job is of one landscape"),
        (&["-o", "job.yaml", "--", "--camera", "{{x}}"], "no camera"),
        (&["-o", "job.yaml", "--", "--scene", "0", "--sky", "a\n.exr"], "control character"),
    ] {
        let error = farm(more);
        assert!(error.contains(what), "{more:?}: {error}");
    }
    assert!(!folder.path("job.yaml").exists());
    let missing = folder.fails(1, &["farm", "missing.gltf", "-o", "job.yaml"]);
    assert!(missing.contains("missing.gltf"), "{missing}");
}
