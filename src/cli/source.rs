//! The options of sources, the same for every command that opens one.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::clap_name::Name;
use super::curves::CurveArgs;
use super::lsystem::LSystemArgs;
use super::quantity::{finite, positive};
use crate::scene::ReadOptions;
use crate::source;
use crate::source::mesh::{Fill, MeshOptions};
use crate::source::stack::{StackOptions, TransferSpec};
use crate::source::{FileKind, OpenOptions};
use crate::{Error, Result};

/// Bytes that a source may take as it is read where --memory says nothing: a file that lies of its size cannot take more.
const READ_BYTES: u64 = 2 << 30;

/// How a source is read; each kind of source has its own part.
#[derive(clap::Args)]
#[command(next_help_heading = "Sources")]
pub struct SourceArgs {
    /// What is within closed surfaces: nothing, or opaque matter (auto: in every component that closes)
    #[arg(long, value_enum, default_value = "auto")]
    fill: FillArg,
    /// Width in source units of lines and points, which are left out without it, and of curves whose file gives none
    #[arg(long, visible_alias = "width", value_name = "X", value_parser = positive)]
    line_width: Option<f64>,
    /// Scene of the file, by name or index
    #[arg(long, value_name = "SCENE")]
    scene: Option<String>,
    /// Take only the nodes of this name (* and ? match) and all below them; may be given again
    #[arg(long, value_name = "NAME")]
    include: Vec<String>,
    /// Leave out the nodes of this name and all below them; may be given again
    #[arg(long, value_name = "NAME")]
    exclude: Vec<String>,
    #[command(flatten)]
    curves: CurveArgs,
    #[command(flatten)]
    stack: StackArgs,
    #[command(flatten)]
    lsystem: LSystemArgs,
}

/// How an image stack (CT, MR, microscopy) is taken.
#[derive(clap::Args)]
#[command(next_help_heading = "Image stacks")]
struct StackArgs {
    /// Values from here on are solid, with a hard surface [default, where nothing else is asked for: Otsu's threshold]
    #[arg(long, value_name = "VALUE", value_parser = finite, allow_hyphen_values = true)]
    iso: Option<f64>,
    /// Opacity rises from 0 at LO to 1 at HI, over a layer as thick as samples are apart
    #[arg(long, value_name = "LO,HI", value_parser = window, allow_hyphen_values = true, conflicts_with = "transfer")]
    window: Option<[f64; 2]>,
    /// A transfer function as JSON: opacity and colour by value, and factors of opacity by gradient
    #[arg(long, value_name = "FILE.json")]
    transfer: Option<PathBuf>,
    /// Filter values with a Gaussian of this standard deviation, in distances of samples
    #[arg(long, default_value_t = StackOptions::default().sigma, value_name = "S", value_parser = finite)]
    sigma: f64,
    /// Distances of samples in millimetres, in place of all that the file says of how it lies
    #[arg(long, value_name = "X,Y,Z", value_parser = distances)]
    spacing: Option<[f64; 3]>,
    /// Of several DICOM series, the one of this UID or number; SERIES:N is the Nth of its stacks (echoes, times, phases)
    #[arg(long, value_name = "SERIES")]
    series: Option<String>,
    /// Of several channels, the one of this name, or number from 1 on
    #[arg(long, value_name = "NAME|N")]
    channel: Option<String>,
    /// Of several frames (times, volumes), the one of this number, from 1 on
    #[arg(long, value_name = "N")]
    frame: Option<usize>,
}

/// The files that the options are for: what a recipe draws, and else the input itself. A recipe that cannot be read will say so
/// itself.
fn drawn(input: &Path) -> Vec<PathBuf> {
    let is_recipe = source::file_kind(input) == FileKind::Recipe;
    let files = is_recipe.then(|| source::recipe::drawn_files(input)).flatten();
    files.unwrap_or_else(|| vec![input.to_path_buf()])
}

/// Three numbers above 0, apart by commas.
fn distances(text: &str) -> std::result::Result<[f64; 3], String> {
    let list: Vec<f64> = text.split(',').map(|v| positive(v.trim())).collect::<std::result::Result<_, _>>()?;
    list.try_into().map_err(|_| "three numbers are needed, such as 0.5,0.5,1.2".into())
}

/// Two numbers that ascend, apart by a comma.
fn window(text: &str) -> std::result::Result<[f64; 2], String> {
    let list: std::result::Result<Vec<f64>, _> = text.split(',').map(|v| v.trim().parse()).collect();
    match list.map_err(|_| "not numbers")?[..] {
        [lo, hi] if lo < hi && lo.is_finite() && hi.is_finite() => Ok([lo, hi]),
        _ => Err("two numbers are needed that ascend, such as 300,1200".into()),
    }
}

impl StackArgs {
    fn options(&self) -> StackOptions {
        StackOptions {
            transfer: TransferSpec {
                iso: self.iso,
                ..self.window.map_or_else(TransferSpec::default, |[lo, hi]| TransferSpec::window(lo, hi))
            },
            table: self.transfer.clone(),
            sigma: self.sigma,
            spacing: self.spacing,
            series: self.series.clone(),
            channel: self.channel.clone(),
            frame: self.frame,
        }
    }

    fn provenance(&self, out: &mut Value) {
        self.iso.into_iter().for_each(|v| out["iso"] = v.into());
        self.window.iter().for_each(|v| out["window"] = json!(v));
        if let Some(spec) = self.transfer.as_ref().and_then(|path| TransferSpec::read(path).ok()) {
            out["transfer"] = json!(spec);
        }
        if self.sigma != StackOptions::default().sigma {
            out["sigma"] = self.sigma.into();
        }
        self.spacing.iter().for_each(|v| out["spacing"] = json!(v));
        self.series.iter().for_each(|v| out["series"] = v.as_str().into());
        self.channel.iter().for_each(|v| out["channel"] = v.as_str().into());
        self.frame.into_iter().for_each(|v| out["frame"] = v.into());
    }
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum FillArg {
    Surface,
    Solid,
    Auto,
}

impl SourceArgs {
    /// Files that the options name.
    pub fn files(&self) -> Vec<PathBuf> {
        self.stack.transfer.iter().cloned().collect()
    }

    /// `memory`: bytes that reading may take.
    pub fn options(&self, memory: Option<u64>) -> OpenOptions {
        let fill = match self.fill {
            FillArg::Surface => Fill::Surface,
            FillArg::Solid => Fill::Solid,
            FillArg::Auto => Fill::Auto,
        };
        OpenOptions {
            read: ReadOptions {
                scene: self.scene.clone(),
                include: self.include.clone(),
                exclude: self.exclude.clone(),
                max_bytes: memory.filter(|&m| m > 0).unwrap_or(READ_BYTES),
                ..ReadOptions::default()
            },
            mesh: MeshOptions { fill },
            trajectory: self.curves.options(self.line_width, fill),
            stack: self.stack.options(),
            lsystem: self.lsystem.options(),
            ..OpenOptions::default()
        }
    }

    /// Check that each option that was given says something of one of `inputs` at least, or of a file that one of them draws;
    /// `more`: options of this kind that stand beside these, by their keys.
    ///
    /// # Errors
    /// `Options` that names the option and what it is for.
    pub fn check(&self, more: &Value, inputs: &[PathBuf]) -> Result<()> {
        let mut said = more.clone();
        self.provenance(&mut said);
        if self.stack.transfer.is_some() {
            said["transfer"] = true.into();
        }
        let keys = said.as_object().into_iter().flat_map(|o| o.keys()).map(String::as_str);
        let files: Vec<PathBuf> = inputs.iter().flat_map(|input| drawn(input)).collect();
        for key in keys.filter(|&key| key != "fill" || !matches!(self.fill, FillArg::Auto)) {
            let is_read = |path: &PathBuf| source::unused_by(key, path, self.line_width.is_some()).is_none();
            let reading = source::READ_OPTIONS.iter().find(|(keys, ..)| keys.contains(&key));
            let (Some((.., of)), Some(input)) = (reading, inputs.first()) else { continue };
            if !files.iter().any(is_read) {
                let verb = if source::file_kind(input) == FileKind::Recipe { "draws" } else { "is" };
                let (option, input) = (key.replace('_', "-"), input.display());
                let lines = ["section", "curve", "width_scale"].contains(&key) && self.line_width.is_none();
                let hint = if lines { " (lines of meshes become curves by --line-width)" } else { "" };
                return Err(Error::Options(format!(
                    "--{option} says how {of} are read; {input} {verb} none of them{hint}"
                )));
            }
        }
        Ok(())
    }

    /// Add to `out` what decides on the content.
    pub fn provenance(&self, out: &mut Value) {
        out["fill"] = json!(Name::name(&self.fill));
        self.line_width.into_iter().for_each(|v| out["line_width"] = v.into());
        self.curves.provenance(out);
        self.scene.iter().for_each(|v| out["scene"] = v.as_str().into());
        for (key, list) in [("include", &self.include), ("exclude", &self.exclude)] {
            if !list.is_empty() {
                out[key] = list.clone().into();
            }
        }
        self.stack.provenance(out);
        self.lsystem.provenance(out);
    }
}
