//! The command line: arguments in, one call into the library, results and one-line errors out.
//!
//! Exit codes: 0 done, 1 failed, 2 the command line was wrong, 128 + n ended by signal n.

/// `print!` that gives what [`ui::put`] gives.
macro_rules! out {
    ($($arg:tt)*) => { $crate::cli::ui::put(format_args!($($arg)*)) };
}
/// `println!` that gives what [`ui::put`] gives.
macro_rules! outln {
    ($($arg:tt)*) => { $crate::cli::ui::put(format_args!("{}\n", format_args!($($arg)*))) };
}

#[cfg(feature = "bake")]
mod bake;
#[cfg(feature = "bake")]
mod bake_frames;
#[cfg(all(feature = "bake", feature = "render", feature = "plot"))]
mod bench;
#[cfg(feature = "bake")]
mod clap_name;
#[cfg(feature = "render")]
mod compare;
#[cfg(feature = "render")]
mod compare_frames;
#[cfg(feature = "bake")]
mod curves;
#[cfg(all(feature = "bake", feature = "render"))]
mod demo;
mod depfile;
mod download;
#[cfg(all(feature = "bake", feature = "render", feature = "plot"))]
mod error;
#[cfg(all(feature = "bake", feature = "render"))]
mod expand;
#[cfg(feature = "bake")]
mod export;
#[cfg(feature = "render")]
mod exposure;
#[cfg(all(feature = "bake", feature = "render"))]
mod farm;
mod fetched;
mod flags;
#[cfg_attr(not(feature = "bake"), allow(dead_code))]
mod frames;
mod inspect;
mod interrupt;
#[cfg(feature = "bake")]
mod lsystem;
mod man;
#[cfg(feature = "bake")]
mod map;
#[cfg(feature = "bake")]
mod map_jitter;
#[cfg(feature = "bake")]
mod map_motion;
#[cfg(feature = "bake")]
mod merge;
mod outputs;
#[cfg(feature = "bake")]
mod paint;
#[cfg(feature = "render")]
mod pixel_trace;
#[cfg(all(feature = "bake", feature = "render", feature = "plot"))]
mod plot;
mod progress_log;
#[cfg(feature = "bake")]
mod provenance;
#[cfg_attr(not(feature = "bake"), allow(dead_code))]
mod quantity;
#[cfg(feature = "bake")]
mod recipe;
#[cfg(feature = "render")]
mod reference;
#[cfg(feature = "render")]
mod render;
mod render_stats;
mod results;
#[cfg(all(feature = "bake", feature = "render"))]
mod samples;
#[cfg(feature = "render")]
mod sequence;
#[cfg(all(feature = "bake", feature = "render", feature = "plot"))]
mod shapes;
#[cfg(feature = "bake")]
mod source;
#[cfg(feature = "render")]
mod stitch;
#[cfg(feature = "render")]
mod stress;
#[cfg(all(test, feature = "bake", feature = "render", feature = "plot"))]
mod tests;
mod text;
#[cfg(feature = "render")]
mod tile;
mod truncate;
mod ui;
mod verify;
#[cfg(all(feature = "bake", feature = "render"))]
mod view;

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};

pub use ui::Ui;

/// The version, and what it was built with: a build of fewer features knows fewer commands.
fn version() -> &'static str {
    static TEXT: std::sync::OnceLock<String> = std::sync::OnceLock::new();
    TEXT.get_or_init(|| {
        let features = [
            (cfg!(feature = "bake"), "bake"),
            (cfg!(feature = "render"), "render"),
            (cfg!(feature = "plot"), "plot"),
            (cfg!(feature = "parallel"), "parallel"),
            (cfg!(feature = "http"), "http"),
        ];
        let on: Vec<_> = features.into_iter().filter(|f| f.0).map(|f| f.1).collect();
        format!("{} ({})", env!("CARGO_PKG_VERSION"), on.join(", "))
    })
}

/// Turn any 3D source into a texel, and render landscapes covered with texels.
#[derive(Parser)]
#[command(name = "vtex", version = version(), propagate_version = true)]
struct Vtex {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    global: Global,
}

#[derive(clap::Args)]
struct Global {
    /// Print nothing but results, warnings and errors
    #[arg(long, short, global = true)]
    quiet: bool,
    /// Fail on warnings
    #[arg(long, global = true)]
    strict: bool,
}

/// One variant and one line in `run` a command; each command's file holds its `Args` and `run(&Args, &Ui) -> Result<()>`.
#[derive(Subcommand)]
enum Command {
    /// Turn 3D sources (meshes, curves, image stacks, L-systems, recipes) into texels
    #[cfg(feature = "bake")]
    Bake(Box<bake::Args>),
    /// Time against error of bakes and pictures, beside the baselines: a table, CSV and plots
    #[cfg(all(feature = "bake", feature = "render", feature = "plot"))]
    Bench(bench::Args),
    /// Measure how far a picture is from a reference: RMSE, relMSE, PSNR, FLIP, bias, covered area
    #[cfg(feature = "render")]
    Compare(compare::Args),
    /// Measure how far a texel is from its source: opacity, normals, colour, shadows, by depth
    #[cfg(all(feature = "bake", feature = "render", feature = "plot"))]
    Error(Box<error::Args>),
    #[cfg(all(feature = "bake", feature = "render"))]
    Expand(Box<expand::Args>),
    #[cfg(feature = "bake")]
    Export(Box<export::Args>),
    #[cfg(all(feature = "bake", feature = "render"))]
    Farm(farm::Args),
    Inspect(inspect::Args),
    #[cfg(feature = "bake")]
    Merge(merge::MergeArgs),
    #[cfg(feature = "bake")]
    Resample(merge::ResampleArgs),
    /// Check a recipe, or print what one may say
    #[cfg(feature = "bake")]
    Recipe(recipe::Args),
    /// Render a landscape: one cone a pixel, the texels read only as far as they are seen
    #[cfg(feature = "render")]
    Render(Box<render::Args>),
    #[cfg(feature = "render")]
    Stitch(stitch::Args),
    /// Cast rays through hostile geometry and count what goes wrong
    #[cfg(feature = "render")]
    Stress(stress::Args),
    Verify(verify::Args),
    #[cfg(all(feature = "bake", feature = "render"))]
    View(view::Args),
    Truncate(truncate::Args),
    /// Cover a plain glTF mesh with texels
    #[cfg(feature = "bake")]
    Map(Box<map::Args>),
    /// Bake the built-in samples, cover the built-in valley with them, render it
    #[cfg(all(feature = "bake", feature = "render"))]
    Demo(demo::Args),
    Man(man::Args),
    /// Print the completion script of a shell
    Completions {
        shell: clap_complete::Shell,
    },
}

/// `main` of `vtex`.
pub fn vtex() -> ExitCode {
    #[cfg(feature = "bake")]
    crate::system::keep_free_pages();
    let cli = Vtex::parse();
    report(&Ui::new(cli.global.quiet, cli.global.strict), |ui| run(cli.command, ui))
}

/// Render a landscape covered with texels.
#[cfg(feature = "render")]
#[derive(Parser)]
#[command(name = "vtex-render", version = version())]
struct VtexRender {
    #[command(flatten)]
    args: render::Args,
    #[command(flatten)]
    global: Global,
}

/// `main` of `vtex-render`.
#[cfg(feature = "render")]
pub fn vtex_render() -> ExitCode {
    let cli = VtexRender::parse();
    report(&Ui::new(cli.global.quiet, cli.global.strict), |ui| render::run(cli.args, ui))
}

fn run(command: Command, ui: &Ui) -> crate::Result<()> {
    match command {
        #[cfg(feature = "bake")]
        Command::Bake(args) => bake::run(&args, ui),
        #[cfg(all(feature = "bake", feature = "render", feature = "plot"))]
        Command::Bench(args) => bench::run(&args, ui),
        #[cfg(feature = "render")]
        Command::Compare(args) => compare::run(&args, ui),
        #[cfg(all(feature = "bake", feature = "render", feature = "plot"))]
        Command::Error(args) => error::run(&args, ui),
        #[cfg(all(feature = "bake", feature = "render"))]
        Command::Expand(args) => expand::run(&args, ui),
        #[cfg(feature = "bake")]
        Command::Export(args) => export::run(*args, ui),
        #[cfg(all(feature = "bake", feature = "render"))]
        Command::Farm(args) => farm::run(&args, ui),
        Command::Inspect(args) => inspect::run(args, ui),
        #[cfg(feature = "bake")]
        Command::Merge(args) => merge::run_merge(&args, ui),
        #[cfg(feature = "bake")]
        Command::Resample(args) => merge::run_resample(&args, ui),
        #[cfg(feature = "bake")]
        Command::Recipe(args) => recipe::run(&args, ui),
        #[cfg(feature = "render")]
        Command::Render(args) => render::run(*args, ui),
        #[cfg(feature = "render")]
        Command::Stitch(args) => stitch::run(&args, ui),
        #[cfg(feature = "render")]
        Command::Stress(args) => stress::run(&args, ui),
        Command::Verify(args) => verify::run(&args, ui),
        #[cfg(all(feature = "bake", feature = "render"))]
        Command::View(args) => view::run(&args, ui),
        Command::Truncate(args) => truncate::run(&args, ui),
        #[cfg(feature = "bake")]
        Command::Map(args) => map::run(&args, ui),
        #[cfg(all(feature = "bake", feature = "render"))]
        Command::Demo(args) => demo::run(&args, ui),
        Command::Man(args) => man::run(&args, ui),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Vtex::command(), "vtex", &mut script);
            out!("{}", String::from_utf8_lossy(&script))
        }
    }
}

/// `vtex render` of a landscape: `words` up to its options, then those that another command was given after `--`.
///
/// # Errors
/// `Options` where one is not known.
#[cfg(all(feature = "bake", feature = "render"))]
fn after_dashes(
    words: Vec<String>,
    options: &[String],
    landscape: &std::path::Path,
) -> crate::Result<Box<render::Args>> {
    let words = words.into_iter().chain(options.iter().cloned());
    // Last, so that the value of no option is taken for it.
    let words = words.map(Into::into).chain([landscape.as_os_str().to_owned()]);
    match Vtex::try_parse_from(words.collect::<Vec<std::ffi::OsString>>()).map(|cli| cli.command) {
        Ok(Command::Render(how)) => Ok(how),
        Ok(_) => Err(crate::Error::Options("what stands after -- is not of `vtex render`".into())),
        Err(e) => {
            let text = e.to_string();
            // What is missing stands on lines of its own.
            let said: Vec<_> = text.lines().take_while(|line| !line.is_empty()).map(str::trim).collect();
            let line = said.join(" ").trim_start_matches("error: ").to_owned();
            Err(crate::Error::Options(format!("after --: {line}")))
        }
    }
}

/// Run one command given as its words, without the program's name.
#[cfg(feature = "bake")]
fn run_words(words: &[String], ui: &Ui) -> crate::Result<()> {
    let all = std::iter::once("vtex").chain(words.iter().map(String::as_str));
    let cli = Vtex::try_parse_from(all).map_err(|e| crate::Error::Options(e.to_string()))?;
    run(cli.command, ui)
}

/// Run one command, given as its words without the program's name, inside another program: nothing is printed, and what the
/// command would print to stdout is handed back. With `--json` among the words that is an object that holds the warnings
/// too; its `message`s are what the terminal would show.
///
/// # Errors
/// What the command gives; [`crate::Error::Options`] where the words are no command, in clap's own words (several lines).
///
/// ```
/// let text = vtex::cli::run_inside(&["completions", "bash"])?;
/// assert!(text.contains("vtex"));
/// # Ok::<(), vtex::Error>(())
/// ```
#[cfg(feature = "bake")]
pub fn run_inside<S: AsRef<str>>(words: &[S]) -> crate::Result<String> {
    let words: Vec<String> = words.iter().map(|word| word.as_ref().to_owned()).collect();
    ui::captured(|| run_words(&words, &Ui::silent()))
}

/// Run `f`, print its error in one line, and choose the exit code.
fn report(ui: &Ui, f: impl FnOnce(&Ui) -> crate::Result<()>) -> ExitCode {
    interrupt::watch();
    let result = f(ui);
    ui.finish();
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            ui::message("error: ", &e.to_string());
            ExitCode::from(if matches!(e, crate::Error::Options(_)) { 2 } else { 1 })
        }
    }
}
