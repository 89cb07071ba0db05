//! All commands' arguments at once: under which heading each stands, and what numbers none of them takes.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::any::TypeId;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use clap::error::ErrorKind;
use clap::{Arg, ArgAction, Command, CommandFactory};

use super::{Ui, Vtex, version};
use crate::source::READ_OPTIONS;

fn commands() -> Vec<Command> {
    let mut all = Vtex::command();
    all.build();
    all.get_subcommands().filter(|c| c.get_name() != "help").cloned().collect()
}

/// What stands under headings of its own, and only in commands that open a source.
const GROUPS: [(&str, &[&str]); 4] = [
    ("Sources", &["albedo", "tint", "material", "translucency", "fill", "line-width", "scene", "include", "exclude"]),
    ("Curves", &["section", "curve", "width-scale", "curve-colours"]),
    ("Image stacks", &["iso", "window", "transfer", "sigma", "spacing", "series", "channel", "frame"]),
    ("L-systems", &["iterations", "seed", "angle", "string", "dialect", "name", "max-symbols"]),
];

/// What stands under "Motion", by command.
const MOTION: [(&str, &[&str]); 4] = [
    ("expand", &["time", "animation", "loop"]),
    ("bake", &["time", "animation", "frames", "fps", "define", "frame-define"]),
    ("map", &["frame-mode", "phase", "fps", "wind", "wind-direction", "gust-scale", "wind-speed"]),
    ("render", &["time", "animation", "loop", "frames", "fps", "force"]),
];

#[test]
fn each_argument_stands_under_a_heading_that_fits() {
    for command in commands() {
        let mut found: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for arg in command.get_arguments() {
            let (Some(heading), Some(long)) = (arg.get_help_heading(), arg.get_long()) else {
                assert!(arg.get_help_heading().is_none(), "{}: {arg}", command.get_name());
                continue;
            };
            found.entry(heading).or_default().push(long);
        }
        let motion = MOTION.iter().find(|(name, _)| *name == command.get_name()).map(|(_, names)| names.to_vec());
        assert_eq!(found.remove("Motion"), motion, "{}", command.get_name());
        if command.get_name() == "export" {
            assert_eq!(found.remove("Meshes of sources"), Some(vec!["resolution", "max-triangles", "memory"]));
        }
        if !["bake", "error", "export"].contains(&command.get_name()) {
            assert!(found.is_empty(), "{}: {found:?}", command.get_name());
            continue;
        }
        // How colours are laid is not asked where they are measured.
        let laid = ["albedo", "tint", "material", "translucency"];
        let wanted = GROUPS.map(|(heading, names)| {
            let known = |name: &&&str| command.get_name() != "error" || !laid.contains(*name);
            (heading, names.iter().filter(known).copied().collect())
        });
        assert_eq!(found, BTreeMap::from(wanted), "{}", command.get_name());
    }
}

/// The library names options by their fields, and each of these is a flag of some command.
#[test]
fn messages_of_the_library_name_options_that_are_flags() {
    let all = commands();
    let known = |flag: &str| all.iter().flat_map(|c| c.get_arguments()).any(|arg| arg.get_long() == Some(flag));
    let mut folders = vec![PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("src")];
    let mut checked = 0;
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() && !path.ends_with("src/cli") {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let text = std::fs::read_to_string(&path).unwrap();
                for line in text.lines().filter(|line| !line.trim_start().starts_with("//")) {
                    // An arrow of a grammar is no flag.
                    let line = &line.replace("-->", "→");
                    let (named, at) = (super::flags::named(line), path.display());
                    // The flags of a whole command line are the program's own.
                    let by_flag = [" --", "(--", "\"--", "`--"].iter().any(|start| line.contains(start));
                    let whole = ["vtex ", "truncate --depth"].iter().any(|command| line.contains(command));
                    assert!(!by_flag || whole, "{at}: a flag in the library: {line}");
                    if !line.contains("option `") {
                        continue;
                    }
                    let flags = named.split("--").skip(1).map(|rest| {
                        rest.split(|c: char| !(c.is_ascii_lowercase() || c == '-')).next().unwrap_or_default()
                    });
                    flags.for_each(|flag| assert!(known(flag), "{at}: --{flag}: {line}"));
                    checked += 1;
                }
            }
        }
    }
    assert!(checked > 50, "{checked}");
}

/// Whether `arg` takes text that is no number: nothing is to be refused there.
fn is_text(arg: &Arg) -> bool {
    let texts = [TypeId::of::<String>(), TypeId::of::<PathBuf>()];
    texts.iter().any(|id| arg.get_value_parser().type_id() == *id)
}

/// Every option that is a number or holds some, in all commands, refuses what is no number. What is refused for another
/// reason (a word that is not one of a list) is refused too.
#[test]
fn no_option_takes_nan_or_infinity() {
    let mut checked = 0;
    for command in commands() {
        let options = command.get_arguments().filter(|arg| {
            arg.get_long().is_some() && matches!(arg.get_action(), ArgAction::Set | ArgAction::Append) && !is_text(arg)
        });
        for arg in options {
            let name = format!("--{}", arg.get_long().unwrap());
            let words = ["NaN", "nan", "inf", "-inf", "infinity", "1e999"];
            let values = words.iter().flat_map(|w| {
                [
                    w.to_string(),
                    format!("{w},{w}"),
                    format!("1,{w}"),
                    format!("1,1,{w}"),
                    format!("a={w},1,1"),
                    format!("{w}/ha"),
                ]
            });
            for value in values {
                // With an equals sign, as a value that begins with a dash is another option elsewhere.
                let mut words = vec!["vtex".to_owned(), command.get_name().to_owned()];
                match arg.get_num_args().map_or(1, |n| n.min_values()) {
                    0 | 1 => words.push(format!("{name}={value}")),
                    n => words.extend(std::iter::once(name.clone()).chain(vec![value.clone(); n])),
                }
                let kind = <Vtex as clap::Parser>::try_parse_from(words).err().map(|e| e.kind());
                let refused = [ErrorKind::ValueValidation, ErrorKind::InvalidValue].map(Some);
                assert!(refused.contains(&kind), "{} {name} {value}: {kind:?}", command.get_name());
                checked += 1;
            }
        }
    }
    assert!(checked > 1000, "{checked}");
}

/// Options of `bake` that are of every source, or decide nothing of what is read of it.
const OF_EVERY_SOURCE: [&str; 27] = [
    "translucency",
    "output",
    "resolution",
    "voxel-size",
    "cyclic",
    "up",
    "model",
    "refine",
    "materials",
    "quality",
    "compress",
    "memory",
    "threads",
    "depfile",
    "if-changed",
    "report",
    "json",
    "frames",
    "fps",
    "albedo",
    "tint",
    "material",
    "max-symbols",
    "help",
    "version",
    "quiet",
    "strict",
];

/// A value that an option takes; a new option has to be told of here or above.
fn example(option: &str) -> &str {
    match option {
        "fill" => "solid",
        "section" => "flat",
        "curve" => "catmull-rom",
        "curve-colours" => "linear",
        "scene" | "include" | "exclude" | "animation" | "channel" | "series" | "string" => "x",
        "window" => "0,1",
        "spacing" => "1,1,1",
        "transfer" => "t.json",
        "dialect" => "fractint",
        "name" => "x",
        "define" => "a=1",
        "frame-define" => "a=0..1",
        "line-width" | "width-scale" | "time" | "iso" | "sigma" | "frame" | "iterations" | "seed" | "angle" => "3",
        other => panic!("--{other}: say of which sources it is, in the table READ_OPTIONS or in OF_EVERY_SOURCE"),
    }
}

/// What a command says that fails.
fn failure(words: &[&str]) -> String {
    let words: Vec<String> = words.iter().map(|w| (*w).to_owned()).collect();
    super::run_words(&words, &Ui::new(true, false)).unwrap_err().to_string()
}

/// Every option of `bake` against a file of every kind. The files are not there: what is not refused for the option is for that.
#[test]
fn an_option_that_says_nothing_of_the_input_is_refused() {
    let files = ["no.glb", "no.obj", "no.swc", "no.lsys", "no.nii", "no.vtex"];
    let bake = commands().into_iter().find(|c| c.get_name() == "bake").unwrap();
    let mut table = BTreeSet::new();
    for option in bake.get_arguments().filter_map(Arg::get_long).filter(|o| !OF_EVERY_SOURCE.contains(o)) {
        let key = option.replace('-', "_");
        assert!(READ_OPTIONS.iter().any(|(keys, ..)| keys.contains(&key.as_str())), "--{option}");
        let long = format!("--{option}={}", example(option));
        let refused = files.map(|file| {
            let line = failure(&["bake", file, "--frames", "2", &long]);
            let without_frames = failure(&["bake", file, &long]);
            [line, without_frames].iter().any(|l| l.contains(&format!("--{option} says how")))
        });
        // None is of a texel, and each is of something.
        assert!(refused[5] && refused.contains(&false), "--{option}: {refused:?}");
        table.insert(format!("{option} {}", refused.map(|r| if r { "-" } else { "+" }).concat()));
    }
    // As a person would say it: of .glb, .obj, .swc, .lsys, .nii, .vtex.
    for row in [
        "channel ----+-",
        "iso ----+-",
        "scene +-----",
        "time +-----",
        "include ++----",
        "fill ++++--",
        "line-width +++---",
        "curve-colours --+---",
        "section --+---",
        "seed ---+--",
        "series ----+-",
    ] {
        assert!(table.contains(row), "{row}: {table:#?}");
    }
    // A width makes curves of a mesh's lines.
    assert!(!failure(&["bake", "no.obj", "--section", "flat", "--line-width", "1"]).contains("says how"));
    assert!(failure(&["bake", "no.glb", "--section", "flat"]).contains("--line-width"));
    // What is of one of several inputs is not refused.
    assert!(!failure(&["bake", "no.glb", "no.nii", "--iso", "3"]).contains("says how"));
    // A recipe passes options on to the files that it draws: here there are none, a picture of colours, and a mesh.
    let folder = tempfile::tempdir().unwrap();
    let recipe = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_string_lossy().into_owned()
    };
    let sphere = "[[draw]]\nsphere = { centre = [0, 0, 0], radius = 1 }\n";
    let shapes = recipe("shapes.toml", sphere);
    recipe("p.png", "");
    let painted = recipe("painted.toml", &format!("{sphere}albedo = {{ image = \"p.png\", axis = [0, 0, 1] }}\n"));
    recipe("m.glb", "");
    recipe("within.toml", "[[draw]]\nsource = { file = \"m.glb\" }\n");
    let nested = recipe("nested.toml", "[[draw]]\nsource = { file = \"within.toml\" }\n");
    for (path, of) in [(&shapes, ""), (&painted, ""), (&nested, "scene fill line-width include")] {
        for option in ["iso", "channel", "seed", "section", "scene", "fill", "line-width", "include"] {
            let said = failure(&["bake", path, &format!("--{option}={}", example(option))]);
            let is_refused = said.contains(&format!("--{option} says how"));
            assert_eq!(is_refused, !of.split(' ').any(|o| o == option), "{path} --{option}: {said}");
        }
    }
    // What is not there is told of as it is.
    let missing = recipe("missing.toml", "[[draw]]\nsource = { file = \"no.nrrd\" }\n");
    assert!(!failure(&["bake", &missing, "--iso", "3"]).contains("says how"));
    assert!(failure(&["bake", "no.glb", "--model", "neyret", "--refine", "3"]).contains("--refine says nothing"));
    assert!(failure(&["bake", "no.glb", "--voxel-size", "1", "-r", "64"]).contains("-r says nothing"));
    assert!(failure(&["error", "no.vtex", "--source", "no.glb", "--channel", "99"]).len() > 1);
}

#[test]
fn every_command_has_a_manual_page() {
    let dir = tempfile::tempdir().unwrap();
    let man = |folder: &std::path::Path| {
        let words = ["man".to_owned(), folder.display().to_string()];
        super::run_words(&words, &Ui::new(true, false))
    };
    man(dir.path()).unwrap();
    let mut pages = 1;
    for command in commands() {
        let page = std::fs::read_to_string(dir.path().join(format!("vtex-{}.1", command.get_name()))).unwrap();
        for option in command.get_arguments().filter(|arg| !arg.is_hide_set()).filter_map(Arg::get_long) {
            // roff would break a line at a bare hyphen.
            let escaped = option.replace('-', "\\-");
            assert!(page.contains(&format!("\\-\\-{escaped}")), "{}: --{option}", command.get_name());
        }
        pages += 1;
    }
    assert!(dir.path().join("vtex.1").exists());
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), pages);
    assert!(man(&dir.path().join("no")).unwrap_err().to_string().contains("folder does not exist"));
}

#[test]
fn the_version_names_the_features() {
    assert_eq!(version(), format!("{} (bake, render, plot, parallel)", env!("CARGO_PKG_VERSION")));
    assert_eq!(Vtex::command().get_version(), Some(version()));
}
