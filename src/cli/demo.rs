//! `vtex demo`: landscapes from source to picture, by the very commands that a user would type.
//!
//! Each is a shell script of `samples/landscapes/`, which is built in. Of it the demo runs the lines that begin with `vtex`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::json;

use super::results::{print, shown};
use super::{Ui, samples};
use crate::format;
use crate::scene::files;
use crate::{Error, Result};

#[derive(clap::Args)]
pub struct Args {
    /// The landscape; --list tells which there are
    #[arg(default_value = DEFAULT)]
    name: String,
    /// Print the names of the landscapes, and what each is
    #[arg(long, conflicts_with_all = ["output", "size"])]
    list: bool,
    /// Folder for the samples, the texels, the landscape and the pictures [default: vtex-demo, and of other landscapes than the
    /// first vtex-demo/NAME]
    #[arg(long, short, value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// Pixels of the pictures [default: as the script has it]
    #[arg(long, value_name = "WxH", value_parser = super::render::size)]
    size: Option<[u32; 2]>,
    /// Print where the pictures are, and how long it took, as JSON
    #[arg(long)]
    json: bool,
}

const DEFAULT: &str = "valley";

/// The landscapes, the first by default.
const SCRIPTS: [(&str, &str); 5] = [
    (DEFAULT, include_str!("../../samples/landscapes/valley.sh")),
    ("lawn", include_str!("../../samples/landscapes/lawn.sh")),
    ("trees", include_str!("../../samples/landscapes/trees.sh")),
    ("teddy", include_str!("../../samples/landscapes/teddy.sh")),
    ("wind", include_str!("../../samples/landscapes/wind.sh")),
];

/// Where scripts find the samples.
const SAMPLES: &str = "$S/";

/// Write the samples, run the commands one after the other, and say how long each took and where the pictures are.
pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    if args.list {
        return list(args, ui);
    }
    let start = Instant::now();
    let Some((name, script)) = SCRIPTS.iter().find(|(name, _)| *name == args.name) else {
        let known = SCRIPTS.map(|s| s.0).join(", ");
        return Err(Error::Options(format!("no landscape {:?}; there are {known}", args.name)));
    };
    let base = Path::new("vtex-demo");
    let usual = if *name == DEFAULT { base.to_path_buf() } else { base.join(name) };
    let folder = args.output.clone().unwrap_or(usual);
    std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, e))?;
    let commands = commands(script);
    write_samples(&commands, &folder, ui)?;
    let mut times = Vec::new();
    let mut pictures = Vec::new();
    for command in &commands {
        let words = words_in(command, &folder, args.size);
        let line = words.iter().map(|w| if w.contains([' ', '#', '*']) { format!("'{w}'") } else { w.clone() });
        ui.say("");
        ui.say(&format!("$ vtex {}", line.collect::<Vec<_>>().join(" ")));
        let begun = Instant::now();
        super::run_words(&words, ui)?;
        ui.finish();
        let stage = words.first().cloned().unwrap_or_default();
        if stage == "render" {
            pictures.extend(words.iter().skip_while(|w| *w != "-o").nth(1).map(PathBuf::from));
        }
        times.push((stage, begun.elapsed()));
    }
    ui.say("");
    let mut seconds = serde_json::Map::new();
    for stage in ["bake", "map", "render"] {
        let sum: f64 = times.iter().filter(|(name, _)| name == stage).map(|(_, t)| t.as_secs_f64()).sum();
        ui.say(&format!("{stage:8} {sum:6.1} s"));
        seconds.insert(stage.into(), sum.into());
    }
    let total = start.elapsed().as_secs_f64();
    let pictures: Vec<String> = pictures.iter().map(|path| shown(path)).collect();
    ui.say(&format!("in all   {total:6.1} s"));
    ui.say(&format!("pictures: {}", pictures.join(" and ")));
    seconds.insert("total".into(), total.into());
    let told = json!({ "landscape": name, "output": shown(&folder), "pictures": pictures, "seconds": seconds });
    print(told, args.json, ui)
}

fn list(args: &Args, ui: &Ui) -> Result<()> {
    let widest = SCRIPTS.iter().map(|s| s.0.len()).max().unwrap_or(0);
    if !args.json {
        SCRIPTS.iter().try_for_each(|(name, script)| outln!("{name:widest$}  {}", title(script)))?;
    }
    let all: Vec<_> = SCRIPTS.iter().map(|(name, script)| json!({ "name": name, "title": title(script) })).collect();
    print(json!({ "landscapes": all }), args.json, ui)
}

/// What the second line of a script says, behind the one that names the shell.
fn title(script: &str) -> &str {
    script.lines().nth(1).map_or("", |line| line.trim_start_matches(['#', ' ']))
}

/// The words of each command of a script, without the program's name. A backslash continues a line, and single quotes hold a
/// word together.
fn commands(script: &str) -> Vec<Vec<String>> {
    let joined = script.replace("\\\n", " ");
    let lines = joined.lines().filter_map(|line| line.strip_prefix("vtex "));
    lines.map(|line| line.split_whitespace().map(|word| word.trim_matches('\'').to_owned()).collect()).collect()
}

/// Endings of the names of files in scripts.
const FILES: [&str; 9] = ["apng", "csv", "glb", "gltf", "lsys", "png", "sh", "toml", "vtex"];

/// A command's words with the folder before the names of files, and the pictures' size.
fn words_in(command: &[String], folder: &Path, size: Option<[u32; 2]>) -> Vec<String> {
    let mut before = "";
    let mut words = Vec::with_capacity(command.len());
    for word in command {
        let is_file = FILES.contains(&files::extension(Path::new(word)).as_str());
        let own = word.rsplit('/').next().unwrap_or(word);
        words.push(match (before, size) {
            ("--size", Some([width, height])) if command.first().is_some_and(|w| w == "render") => {
                format!("{width}x{height}")
            }
            _ if is_file => folder.join(own).display().to_string(),
            _ => word.clone(),
        });
        before = word;
    }
    words
}

/// Write the samples that commands name.
fn write_samples(commands: &[Vec<String>], folder: &Path, ui: &Ui) -> Result<()> {
    let mut named: Vec<&str> = commands.iter().flatten().filter_map(|word| word.strip_prefix(SAMPLES)).collect();
    named.sort_unstable();
    named.dedup();
    for (path, bytes) in samples::find(&named)? {
        let name = path.rsplit('/').next().unwrap_or(path);
        format::save(folder.join(name), &bytes)?;
    }
    ui.say(&format!("wrote the samples to {}: {}", folder.display(), named.join(", ")));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    /// The scripts say what the program understands, and name samples that are there.
    #[test]
    fn scripts_are_sound() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples");
        let mut scripts: Vec<String> = std::fs::read_dir(folder.join("landscapes"))
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .filter_map(|name| name.strip_suffix(".sh").map(str::to_owned))
            .collect();
        let mut known = SCRIPTS.map(|s| s.0.to_owned()).to_vec();
        scripts.sort();
        known.sort();
        assert_eq!(scripts, known, "samples/landscapes and SCRIPTS");
        for (name, script) in SCRIPTS {
            assert!(title(script).len() > 10, "{name}: a title in its second line");
            let commands = commands(script);
            assert!(commands.iter().any(|c| c[0] == "render"), "{name}");
            for command in &commands {
                let words = words_in(command, Path::new("out"), Some([64, 36]));
                let all = std::iter::once("vtex").chain(words.iter().map(String::as_str));
                if let Err(e) = crate::cli::Vtex::try_parse_from(all) {
                    panic!("{name}: {command:?}: {e}");
                }
                if command[0] == "render" {
                    assert!(words.contains(&"64x36".into()), "{name}: a picture without a size: {command:?}");
                }
                for sample in command.iter().filter_map(|word| word.strip_prefix(SAMPLES)) {
                    let found = samples::find(&[sample]).unwrap();
                    assert!(found[0].1 == std::fs::read(folder.join(sample)).unwrap(), "{sample}");
                }
            }
        }
    }

    #[test]
    fn words_are_as_a_shell_has_them() {
        let script = "#!/bin/sh\n# A title.\nS=..\nvtex map $S/a.glb --palette 'leaf=#ff0000' \\\n  --size 2 -o b.glb\nvtex render b.glb --size 8x4 -o c.png\n";
        let commands = commands(script);
        assert_eq!(title(script), "A title.");
        assert_eq!(commands[0], ["map", "$S/a.glb", "--palette", "leaf=#ff0000", "--size", "2", "-o", "b.glb"]);
        let words = |k: usize| words_in(&commands[k], Path::new("f"), Some([2, 1])).join(" ");
        assert_eq!(words(0), "map f/a.glb --palette leaf=#ff0000 --size 2 -o f/b.glb");
        assert_eq!(words(1), "render f/b.glb --size 2x1 -o f/c.png");
        assert!(samples::find(&["no/such.glb"]).is_err());
    }
}
