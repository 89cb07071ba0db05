//! `vtex view`: a texel or a landscape in a browser on this machine.

mod http;
mod landscape;
mod words;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::json;

use super::results::{print, shown};
use super::{Ui, export};
use crate::format::{Limits, Reader};
use crate::scene::files::extension;
use crate::{Error, Result};
use http::{Client, Request};
use landscape::Landscape;

/// Show a texel or a landscape in a browser: a server on this machine alone, until Ctrl-C ends it
#[derive(clap::Args)]
pub struct Args {
    /// A texel, .vtex, or a landscape, .gltf or .glb
    file: PathBuf,
    /// Port on 127.0.0.1; 0: any that is free
    #[arg(long, value_name = "N", default_value_t = 0)]
    port: u16,
    /// Open the page in the browser that the system has for pages
    #[arg(long)]
    open: bool,
    /// Print the page's address as JSON
    #[arg(long)]
    json: bool,
    /// Options of `vtex render` for a landscape, after `--`, such as -- --sun 12,240 --haze 3000
    #[arg(last = true, value_name = "OPTIONS")]
    render: Vec<String>,
}

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    if extension(&args.file) != "vtex" {
        let how = super::after_dashes(["vtex", "render"].map(String::from).into(), &args.render, &args.file)?;
        let landscape = super::render::look(&how, ui)?;
        let command = words::command(&args.file, &args.render);
        let landscape = Landscape::new(&landscape, name(&args.file), command, ui)?;
        return serve(args, ui, &|request, client| landscape.answer(request, client));
    }
    if !args.render.is_empty() {
        return Err(Error::Options(
            "options after -- are of a landscape: a texel's page has controls of its own".into(),
        ));
    }
    let reader = Reader::open(&args.file, &Limits::default())?;
    let page = export::page_of(&args.file, &reader, &name(&args.file))?;
    serve(args, ui, &|request, client| match request.path.as_str() {
        // The page says by itself what it may load.
        "/" => client.answer("200 OK", "text/html; charset=utf-8", "frame-ancestors 'none'", page.as_bytes()),
        _ => client.missing(),
    })
}

fn name(path: &Path) -> String {
    path.file_stem().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

fn serve(args: &Args, ui: &Ui, answer: &(dyn Fn(&Request, &mut Client) -> std::io::Result<()> + Sync)) -> Result<()> {
    let (listener, port) = http::listen(args.port).map_err(|e| match e.kind() {
        std::io::ErrorKind::AddrInUse => {
            Error::Failed(format!("port {} is taken by another program; --port 0 takes one that is free", args.port))
        }
        _ => Error::io(format!("127.0.0.1:{}", args.port), e),
    })?;
    let url = format!("http://127.0.0.1:{port}/");
    if args.json {
        print(json!({ "input": shown(&args.file), "url": url }), true, ui)?;
    } else {
        ui.finish();
        outln!("{url}")?;
    }
    ui.say(&format!("shows {}; Ctrl-C ends it", args.file.display()));
    if args.open {
        open(&url)?;
    }
    http::serve(&listener, port, answer);
    Ok(())
}

/// Open the page by the program that the system has for that.
fn open(url: &str) -> Result<()> {
    let opener = match () {
        () if cfg!(target_os = "macos") => "open",
        () if cfg!(windows) => "explorer",
        () => "xdg-open",
    };
    let started =
        Command::new(opener).arg(url).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    started.map(drop).map_err(|e| Error::Failed(format!("--open: {opener} cannot be started: {e}")))
}
