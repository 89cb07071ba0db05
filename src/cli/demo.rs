//! `vtex demo`: the built-in samples from source to picture, by the very commands that a user would type.

use std::path::PathBuf;
use std::time::Instant;

use serde_json::json;

use super::results::{print, shown};
use super::{Ui, samples};
use crate::format;
use crate::{Error, Result};

#[derive(clap::Args)]
pub struct Args {
    /// Folder for the samples, the texels, the landscape and the pictures
    #[arg(long, short, value_name = "FOLDER", default_value = "vtex-demo")]
    output: PathBuf,
    /// Pixels of the pictures
    #[arg(long, value_name = "WxH", default_value = "1280x720")]
    size: String,
    /// Print where the pictures are, and how long it took, as JSON
    #[arg(long)]
    json: bool,
}

/// The commands; `@` stands for the folder, `#` for the size.
const COMMANDS: [&str; 9] = [
    "bake @tree.glb -r 512 -o @tree.vtex",
    "bake @spruce.glb -r 256 -o @spruce.vtex",
    "bake @fern.glb -r 128 -o @fern.vtex",
    "bake @meadow.toml -r 128 --cyclic u,v -o @meadow.vtex",
    "map @terrain.glb --texel @meadow.vtex --scale 1,1 --displace 0 -o @landscape.glb",
    "map @landscape.glb --material forest --add --texel @spruce.vtex --texel @tree.vtex --texel @tree.vtex -o @landscape.glb",
    "map @landscape.glb --material meadow --texel @fern.vtex --presence 0.2 --add -o @landscape.glb",
    "render @landscape.glb --camera near --sun 14,303 --haze 7000 --exposure 1.2 --size # -o @near.png",
    "render @landscape.glb --camera far --sun 24,262 --haze 14000 --exposure 1 --size # -o @far.png",
];

/// Write the samples, run the commands one after the other, and say how long each took and where the pictures are.
pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    let start = Instant::now();
    let folder = &args.output;
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    for (name, bytes) in samples::unpack()? {
        format::save(folder.join(name), &bytes)?;
    }
    ui.say(&format!(
        "wrote the samples to {}: a broad-leaved tree, a spruce, a fern, a meadow, a valley",
        folder.display()
    ));
    let mut times = Vec::new();
    for command in COMMANDS {
        let words = command.split(' ').map(|word| match (word.strip_prefix('@'), word) {
            (Some(name), _) => folder.join(name).display().to_string(),
            (None, "#") => args.size.clone(),
            (None, word) => word.to_owned(),
        });
        let words: Vec<String> = words.collect();
        let line = words.iter().map(|w| if w.contains(' ') { format!("'{w}'") } else { w.clone() });
        ui.say("");
        ui.say(&format!("$ vtex {}", line.collect::<Vec<_>>().join(" ")));
        let begun = Instant::now();
        super::run_words(&words, ui)?;
        ui.finish();
        times.push((command.split(' ').next(), begun.elapsed()));
    }
    ui.say("");
    let mut seconds = serde_json::Map::new();
    for stage in ["bake", "map", "render"] {
        let sum: f64 = times.iter().filter(|(name, _)| *name == Some(stage)).map(|(_, t)| t.as_secs_f64()).sum();
        ui.say(&format!("{stage:8} {sum:6.1} s"));
        seconds.insert(stage.into(), sum.into());
    }
    let (total, pictures) = (start.elapsed().as_secs_f64(), ["near.png", "far.png"].map(|name| folder.join(name)));
    ui.say(&format!("in all   {total:6.1} s"));
    ui.say(&format!("pictures: {} and {}", pictures[0].display(), pictures[1].display()));
    seconds.insert("total".into(), total.into());
    let pictures = pictures.map(|path| shown(&path));
    print(json!({ "output": shown(folder), "pictures": pictures, "seconds": seconds }), args.json, ui)
}
