//! `vtex bench`: time against error, of bakes and of pictures, beside the baselines; every figure that docs/measuring.md quotes.

mod context;
mod cost;
mod density;
mod land;
mod made;
mod peer;
mod points;
mod report;
mod scenes;
mod summary;
mod texels;

use std::path::PathBuf;

use super::Ui;
use super::results::print;
use crate::{Error, Result, par};
use context::Bench;

#[derive(clap::Args)]
pub struct Args {
    /// Folder for scenes, texels, references, the table and the plots; what is there already is not made again
    #[arg(long, short, value_name = "FOLDER", default_value = "vtex-bench")]
    output: PathBuf,
    /// A small form of it all, in less than two minutes on two cores
    #[arg(long)]
    quick: bool,
    /// Only this scene; may be given again
    #[arg(long, value_name = "NAME", value_parser = scenes::SCENES.map(|s| s.name))]
    scene: Vec<String>,
    /// Pixels of the landscapes; single objects have squares of a third of the width
    #[arg(long, value_name = "WxH", value_parser = super::render::size)]
    size: Option<[u32; 2]>,
    /// Samples a pixel of the references
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1 << 20))]
    samples: Option<u32>,
    /// Measure only pictures of 1, 2 and 4 lanes, against the pictures that this program traces of the landscape's triangles, such
    /// as bench/peers/run.sh builds; for the scenes whose trees stand close, own-… and copies-…
    #[arg(long, value_name = "PROGRAM", requires = "scene")]
    peer: Option<PathBuf>,
    /// Measure instead what pictures cost by the number of trees (1 to 1 000 000; to 99 856 with --quick), the faces of the ground,
    /// pixels and lanes: cost.csv, cost.svg and cost.png, and exponents
    #[arg(long, conflicts_with_all = ["scene", "size", "samples"])]
    cost: bool,
    /// Threads to use [default: all cores]
    #[arg(long, default_value_t = 0, hide_default_value = true, value_name = "N")]
    threads: usize,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    std::fs::create_dir_all(&args.output).map_err(|e| Error::io(&args.output, e))?;
    if args.cost {
        return cost::run(&args.output, (args.quick, args.threads), args.json, ui);
    }
    let chosen: Vec<&scenes::Place> = scenes::SCENES
        .iter()
        .filter(|s| match &args.scene[..] {
            [] => !s.on_request && (!args.quick || s.quick),
            names => names.iter().any(|n| n == s.name),
        })
        .collect();
    let size = args.size.unwrap_or(if args.quick { [192, 108] } else { [384, 216] });
    let samples = args.samples.unwrap_or(if args.quick { 64 } else { 256 });
    let (found, texels) = par::with_threads(args.threads, || {
        let bench = Bench { folder: &args.output, size, samples, quick: args.quick, ui };
        let (mut found, mut texels) = (Vec::new(), Vec::<texels::Texel>::new());
        let mut measured = std::collections::BTreeSet::new();
        for place in chosen {
            ui.say(&format!("{}: {}", place.name, place.about));
            if let Some(program) = &args.peer {
                found.extend(bench.against(place, program)?);
                ui.finish();
                continue;
            }
            found.extend(bench.scene(place)?);
            let first = measured.insert((bench.source(place)?, place.resolution));
            texels.push(bench.texel(place, first)?);
            ui.finish();
        }
        Ok::<_, Error>((found, texels))
    })??;
    report::write(&args.output, &found, &texels)?;
    if args.json {
        print(serde_json::json!({ "size": size, "samples": samples, "points": found, "texels": texels }), true, ui)?;
    } else {
        out!("{}\n", report::table(&found))?;
        if args.peer.is_some() {
            out!("{}", summary::beside_peer(&found))?;
        } else {
            out!("{}", summary::markdown(&found, &texels))?;
        }
    }
    ui.say(&format!("{}: bench.csv, bench.md, bench.svg, bench.png", args.output.display()));
    Ok(())
}
