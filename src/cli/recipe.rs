//! `vtex recipe`: is a recipe right, and what may one say.

use std::path::PathBuf;

use serde_json::json;

use super::Ui;
use super::results::{print, shown};
use crate::Result;
use crate::source::OpenOptions;
use crate::source::{self, recipe};

/// Check a recipe, or print what one may say
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("what").required(true))]
pub struct Args {
    /// Read this recipe (.toml or .json) and every file that it names; say what is wrong with it, and where
    #[arg(long, value_name = "FILE", group = "what")]
    check: Option<PathBuf>,
    /// Print the JSON Schema of recipes, for editors
    #[arg(long, group = "what")]
    schema: bool,
    /// Print what --check found as JSON
    #[arg(long, requires = "check")]
    json: bool,
}

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    if args.schema {
        out!("{}", recipe::SCHEMA)?;
    }
    if let Some(path) = &args.check {
        let nodes = recipe::check(path, &OpenOptions::default(), source::open)?;
        if !args.json {
            ui.say(&format!("{}: a recipe of {nodes} nodes, nothing wrong", path.display()));
        }
        print(json!({ "input": shown(path), "nodes": nodes }), args.json, ui)?;
    }
    Ok(())
}
