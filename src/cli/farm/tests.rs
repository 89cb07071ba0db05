//! Jobs: how a picture is divided, and that options go from a bake to its texel and back.

#![allow(clippy::unwrap_used, clippy::panic)]

use clap::{Arg, CommandFactory, Parser};
use serde_json::Value;

use super::{grid, rebake};
use crate::cli::{Command, Vtex, bake};

#[test]
fn tiles_cover_a_picture() {
    for (size, tiles) in [([7, 5], [3, 2]), ([1920, 1080], [4, 2]), ([3, 1], [3, 1]), ([50, 36], [1, 1])] {
        let windows = grid(size, tiles).unwrap();
        assert_eq!(windows.len() as u32, tiles[0] * tiles[1]);
        let pixels: u32 = windows.iter().map(|w| w.size[0] * w.size[1]).sum();
        assert_eq!(pixels, size[0] * size[1]);
        for (i, a) in windows.iter().enumerate() {
            assert!(a.is_within(size) && windows[..i].iter().all(|b| !a.overlaps(b)), "{windows:?}");
        }
    }
    assert!(grid([7, 5], [8, 1]).is_err() && grid([7, 5], [0, 1]).is_err() && grid([9999, 9999], [33, 32]).is_err());
}

/// Options of `bake` that decide nothing of a texel, or make several.
const NOT_OF_A_TEXEL: [&str; 13] = [
    "output",
    "memory",
    "threads",
    "depfile",
    "report",
    "json",
    "if-changed",
    "frames",
    "fps",
    "frame-define",
    "max-symbols",
    "help",
    "version",
];

/// Values of an option, none of them its default.
fn examples(option: &str) -> &[&str] {
    match option {
        "fill" => &["solid"],
        "section" => &["flat"],
        "curve" => &["catmull-rom"],
        "curve-colours" => &["linear"],
        "scene" | "include" | "exclude" | "animation" | "channel" | "series" | "material" | "name" => {
            &["a b", "-x=1", "ü,é"]
        }
        "string" => &["F[+F]-F", "-F"],
        "albedo" => &["#aabbcc", "{ noise = { scale = 2 } }"],
        "window" => &["0,1", "-1.5,2"],
        "spacing" => &["1,1,0.25"],
        "define" => &["a=1", "a=-0.125"],
        "translucency" => &["0.3", "leaf=0.4", "a=b=0.5"],
        "dialect" => &["fractint"],
        "cyclic" => &["u", "u,w"],
        "up" => &["y", "z"],
        "model" => &["neyret"],
        "materials" => &["off"],
        "quality" => &["lean"],
        "resolution" | "compress" | "refine" => &["3"],
        "iso" | "angle" | "time" => &["3", "-0.1", "1e-7"],
        "voxel-size" | "line-width" | "width-scale" | "sigma" => &["3", "0.1"],
        "frame" | "iterations" | "seed" => &["3"],
        other => panic!("--{other}: give an example, or name it in NOT_OF_A_TEXEL"),
    }
}

fn parsed(words: &[String]) -> Box<bake::Args> {
    let all = ["vtex", "bake", "no.glb"].map(String::from).into_iter().chain(words.iter().cloned());
    match Vtex::try_parse_from(all).map(|cli| cli.command) {
        Ok(Command::Bake(args)) => args,
        Ok(_) => panic!("{words:?}: another command"),
        Err(e) => panic!("{words:?}: {e}"),
    }
}

/// What META keeps of every option gives the option back.
#[test]
fn options_of_a_texel_make_the_same_command() {
    let mut all = Vtex::command();
    all.build();
    let bake = all.get_subcommands().find(|c| c.get_name() == "bake").unwrap();
    let mut checked = 0;
    for option in bake.get_arguments().filter_map(Arg::get_long) {
        if NOT_OF_A_TEXEL.contains(&option) || ["quiet", "strict", "transfer"].contains(&option) {
            continue;
        }
        let lines: Vec<String> = match option {
            "tint" => vec!["--tint".into()],
            _ => examples(option).iter().map(|value| format!("--{option}={value}")).collect(),
        };
        // Each by itself, and those that may be given again together.
        let together = [option, "x"].contains(&"include").then(|| lines.clone());
        for words in lines.iter().map(|line| vec![line.clone()]).chain(together) {
            let said = parsed(&words).provenance();
            // As META has it: numbers that are whole lose their point there.
            let stored: Value =
                serde_json::from_str(&said.to_string().replace(".0,", ",").replace(".0}", "}")).unwrap();
            let flags = rebake::flags(stored.as_object().unwrap()).unwrap();
            assert!(!flags.is_empty(), "{words:?} is not kept");
            assert_eq!(parsed(&flags).provenance(), said, "{words:?} became {flags:?}");
            checked += 1;
        }
    }
    assert!(checked > 40, "{checked}");
    assert_eq!(rebake::flags(bake::default_options().as_object().unwrap()), Some(vec![]));
    let transfer = serde_json::json!({ "transfer": { "iso": 1 } });
    assert_eq!(rebake::flags(transfer.as_object().unwrap()), None, "its file is not known");
}
