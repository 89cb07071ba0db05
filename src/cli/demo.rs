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
    #[arg(long, conflicts_with_all = ["output", "size", "draft"])]
    list: bool,
    /// Folder for the samples, the texels, the landscape and the pictures [default: vtex-demo, and of other landscapes than the
    /// first vtex-demo/NAME]
    #[arg(long, short, value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// Pixels of the pictures [default: as the script has it]
    #[arg(long, value_name = "WxH", value_parser = super::render::size)]
    size: Option<[u32; 2]>,
    /// A quick look: voxels eight times as wide, a fiftieth of the copies, a few frames, small pictures
    #[arg(long)]
    draft: bool,
    /// Print where the pictures are, and how long it took, as JSON
    #[arg(long)]
    json: bool,
}

const DEFAULT: &str = "valley";

/// The landscapes, the first by default.
const SCRIPTS: [(&str, &str); 9] = [
    (DEFAULT, include_str!("../../samples/landscapes/valley.sh")),
    ("lawn", include_str!("../../samples/landscapes/lawn.sh")),
    ("trees", include_str!("../../samples/landscapes/trees.sh")),
    ("teddy", include_str!("../../samples/landscapes/teddy.sh")),
    ("wind", include_str!("../../samples/landscapes/wind.sh")),
    ("mountains", include_str!("../../samples/landscapes/mountains.sh")),
    ("million", include_str!("../../samples/landscapes/million.sh")),
    ("zoom", include_str!("../../samples/landscapes/zoom.sh")),
    ("crypt", include_str!("../../samples/landscapes/crypt.sh")),
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
    let form = Form { size: args.size.or(args.draft.then_some(DRAFT_SIZE)), draft: args.draft };
    let commands = commands(script);
    write_samples(&commands, &folder, ui)?;
    let mut times = Vec::new();
    let mut pictures = Vec::new();
    for command in &commands {
        let words = words_in(command, &folder, &form);
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

/// How a landscape is made in another form than its script says.
struct Form {
    /// Pixels of pictures.
    size: Option<[u32; 2]>,
    draft: bool,
}

/// Of a draft: the pictures' size, how much wider voxels are, the share of copies, and the most frames.
const DRAFT_SIZE: [u32; 2] = [320, 180];
const DRAFT_VOXELS: f64 = 8.0;
const DRAFT_COPIES: f64 = 0.02;
/// Densities up to this one, per hectare, are left as they are.
const FEW_COPIES: f64 = 100.0;
const DRAFT_FRAMES: f64 = 4.0;

impl Form {
    /// What stands behind option `option` in place of `word`.
    fn word(&self, option: &str, word: &str) -> Option<String> {
        let changed = |by: &dyn Fn(f64) -> f64| {
            let digits = word.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(word.len());
            let (number, unit) = word.split_at(digits);
            number.parse().ok().map(|n| format!("{}{unit}", by(n)))
        };
        match (option, self.size) {
            ("--size", Some([width, height])) => Some(format!("{width}x{height}")),
            ("-r", _) if self.draft => changed(&|n| (n / DRAFT_VOXELS).max(8.0)),
            ("--voxel-size", _) if self.draft => changed(&|n| n * DRAFT_VOXELS),
            ("--density", _) if self.draft => changed(&|n| if n > FEW_COPIES { n * DRAFT_COPIES } else { n }),
            ("--frames", _) if self.draft => changed(&|n| n.min(DRAFT_FRAMES)),
            _ => None,
        }
    }
}

/// A command's words with the folder before the names of files, in that form.
fn words_in(command: &[String], folder: &Path, form: &Form) -> Vec<String> {
    let maps = command.first().is_some_and(|w| w == "map");
    let mut before = "";
    let mut words = Vec::with_capacity(command.len());
    for word in command {
        let is_file = FILES.contains(&files::extension(Path::new(word)).as_str());
        let own = word.rsplit('/').next().unwrap_or(word);
        // The size that `map` takes is that of copies.
        let other = form.word(before, word).filter(|_| !(maps && before == "--size"));
        words.push(match other {
            Some(word) => word,
            None if is_file => folder.join(word.strip_prefix(SAMPLES).unwrap_or(own)).display().to_string(),
            None => word.clone(),
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
    let found = samples::find(&named)?;
    for (path, bytes) in &found {
        let path = folder.join(path);
        let parent = path.parent().unwrap_or(folder);
        std::fs::create_dir_all(parent).map_err(|e| Error::io(parent, e))?;
        format::save(path, bytes)?;
    }
    let names: Vec<&str> = found.keys().map(String::as_str).collect();
    ui.say(&format!("wrote the samples to {}: {}", folder.display(), names.join(", ")));
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
                let words = words_in(command, Path::new("out"), &Form { size: Some([64, 36]), draft: true });
                let all = std::iter::once("vtex").chain(words.iter().map(String::as_str));
                if let Err(e) = crate::cli::Vtex::try_parse_from(all) {
                    panic!("{name}: {command:?}: {e}");
                }
                if command[0] == "render" {
                    assert!(words.contains(&"64x36".into()), "{name}: a picture without a size: {command:?}");
                }
                for sample in command.iter().filter_map(|word| word.strip_prefix(SAMPLES)) {
                    for (path, bytes) in samples::find(&[sample]).unwrap() {
                        assert!(bytes == std::fs::read(folder.join(&path)).unwrap(), "{path}");
                    }
                }
            }
        }
    }

    #[test]
    fn words_are_as_a_shell_has_them() {
        let script = "#!/bin/sh\n# A title.\nS=..\nvtex map $S/a.glb --palette 'leaf=#ff0000' \\\n  --size 2 -o b.glb\nvtex render b.glb --size 8x4 -o c.png\nvtex bake $S/d/e.toml -r 256 --voxel-size 0.25\nvtex map a.obj --density 500/ha\n";
        let commands = commands(script);
        assert_eq!(title(script), "A title.");
        assert_eq!(commands[0], ["map", "$S/a.glb", "--palette", "leaf=#ff0000", "--size", "2", "-o", "b.glb"]);
        let form = Form { size: Some([2, 1]), draft: true };
        let words = |k: usize| words_in(&commands[k], Path::new("f"), &form).join(" ");
        assert_eq!(words(0), "map f/a.glb --palette leaf=#ff0000 --size 2 -o f/b.glb");
        assert_eq!(words(1), "render f/b.glb --size 2x1 -o f/c.png");
        assert_eq!(words(2), "bake f/d/e.toml -r 32 --voxel-size 2");
        assert_eq!(words(3), "map a.obj --density 10/ha");
        assert!(samples::find(&["no/such.glb"]).is_err());
    }
}
