//! Another file as a shape: what a recipe says of how it is read, as the options of sources.

use std::path::Path;

use serde::Deserialize;

use super::values::{Either, Least0, Number, Positive, Size};
use crate::scene::ReadOptions;
use crate::source::curve::trajectory::TrajectoryOptions;
use crate::source::curve::{CurveOptions, Interpolation};
use crate::source::emitter::SectionKind;
use crate::source::lsystem::{Dialect, LSystemOptions};
use crate::source::mesh::{Fill, MeshOptions};
use crate::source::options::{OpenOptions, unused_by};
use crate::source::stack::{StackOptions, TransferSpec};

/// Degrees between the sheets of a V, as on the command line.
const V_ANGLE: f32 = 70.0;

/// A file's name, or the name with how it is read.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(from = "Either<String, SourceTable>")]
#[cfg_attr(test, schemars(with = "Either<String, SourceTable>"))]
pub struct SourceFile(pub SourceTable);

impl From<Either<String, SourceTable>> for SourceFile {
    fn from(v: Either<String, SourceTable>) -> SourceFile {
        SourceFile(match v {
            Either::Plain(file) => SourceTable { file, ..SourceTable::default() },
            Either::Table(table) => table,
        })
    }
}

/// Options by which a file is read; one that is not given is as on the command line.
#[derive(Debug, Clone, Default, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct SourceTable {
    pub file: String,
    /// Scene of a glTF file, and which of its nodes.
    pub scene: Option<String>,
    #[serde(default)]
    pub include: Vec<String>,
    #[serde(default)]
    pub exclude: Vec<String>,
    /// Matter within closed surfaces of a mesh.
    pub fill: Option<FillName>,
    /// Width of lines and points of a mesh, and of curves whose file gives none.
    pub line_width: Option<Positive>,
    /// Factor of all widths of curves.
    pub width_scale: Option<Positive>,
    /// Cross-section that is swept along curves.
    pub section: Option<SectionKind>,
    /// Curve that runs from point to point.
    pub curve: Option<CurveName>,
    /// Value of an image stack from which on it is solid.
    pub iso: Option<Number>,
    /// Values of an image stack: opacity rises from 0 at the first to 1 at the second.
    pub window: Option<Window>,
    /// Opacity and colour of an image stack by value, and factors of opacity by gradient.
    pub transfer: Option<Transfer>,
    /// Standard deviation of the filter of an image stack's values, in distances of samples.
    pub sigma: Option<Least0>,
    /// Distances of an image stack's samples in millimetres.
    pub spacing: Option<Size>,
    /// UID or number of one of several DICOM series; after a colon the number of a stack in it.
    pub series: Option<String>,
    /// Name of one of several channels of an image stack, or its number from 1 on.
    pub channel: Option<String>,
    /// Number of one of several frames of an image stack, from 1 on.
    pub frame: Option<usize>,
    /// Derivation steps of an L-system, the seed of its random choices, degrees that the turtle turns by.
    pub iterations: Option<u64>,
    pub seed: Option<u64>,
    pub angle: Option<Number>,
    /// Notation of an L-system, and which of several in its file.
    pub dialect: Option<Dialect>,
    pub name: Option<String>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum FillName {
    Surface,
    Solid,
    Auto,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum CurveName {
    Linear,
    CatmullRom,
}

/// Two values that ascend.
#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(try_from = "[Number; 2]")]
#[cfg_attr(test, schemars(with = "[f64; 2]"))]
pub struct Window([f64; 2]);

impl TryFrom<[Number; 2]> for Window {
    type Error = String;

    fn try_from([lo, hi]: [Number; 2]) -> Result<Window, String> {
        if lo.0 < hi.0 { Ok(Window([lo.0, hi.0])) } else { Err("a window needs two values that ascend".into()) }
    }
}

/// A transfer function whose numbers are in order.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(try_from = "TransferSpec")]
#[cfg_attr(test, schemars(with = "TransferSpec"))]
pub struct Transfer(TransferSpec);

impl TryFrom<TransferSpec> for Transfer {
    type Error = String;

    fn try_from(spec: TransferSpec) -> Result<Transfer, String> {
        spec.check().map_err(|e| e.to_string())?;
        Ok(Transfer(spec))
    }
}

impl SourceTable {
    /// The options to open `path` with: what is said here in place of `base`.
    ///
    /// # Errors
    /// A key and what is wrong with it: one that says nothing of this kind of file, or two that exclude each other.
    pub fn options(&self, path: &Path, base: &OpenOptions) -> Result<OpenOptions, (&'static str, String)> {
        self.check(path, base)?;
        let fill = match self.fill {
            Some(FillName::Surface) => Fill::Surface,
            Some(FillName::Solid) => Fill::Solid,
            Some(FillName::Auto) => Fill::Auto,
            None => base.mesh.fill,
        };
        let interpolation = match self.curve {
            Some(CurveName::Linear) => Interpolation::Linear,
            Some(CurveName::CatmullRom) => Interpolation::CatmullRom,
            None => base.trajectory.curve.interpolation,
        };
        let read = ReadOptions {
            scene: self.scene.clone(),
            include: self.include.clone(),
            exclude: self.exclude.clone(),
            ..base.read.clone()
        };
        let trajectory = TrajectoryOptions {
            section: self.section.map_or(base.trajectory.section, |s| s.section(V_ANGLE, 0.0)),
            curve: CurveOptions { interpolation, fill },
            width: self.line_width.map(|w| w.0).or(base.trajectory.width),
            width_scale: self.width_scale.map_or(base.trajectory.width_scale, |w| w.0),
            ..base.trajectory
        };
        let lsystem = LSystemOptions {
            iterations: self.iterations.or(base.lsystem.iterations),
            seed: self.seed.or(base.lsystem.seed),
            angle: self.angle.map(|a| a.0).or(base.lsystem.angle),
            dialect: self.dialect.or(base.lsystem.dialect),
            name: self.name.clone().or_else(|| base.lsystem.name.clone()),
            ..base.lsystem.clone()
        };
        let stack = self.stack(&base.stack);
        Ok(OpenOptions { read, mesh: MeshOptions { fill }, stack, trajectory, lsystem, ..base.clone() })
    }

    fn stack(&self, base: &StackOptions) -> StackOptions {
        let iso = self.iso.map(|v| v.0);
        let matter = match (&self.transfer, self.window) {
            (Some(t), _) => TransferSpec { iso: iso.or(t.0.iso), ..t.0.clone() },
            (None, Some(Window([lo, hi]))) => TransferSpec { iso, ..TransferSpec::window(lo, hi) },
            (None, None) => TransferSpec { iso, ..TransferSpec::default() },
        };
        let own = !matter.is_empty();
        StackOptions {
            transfer: if own { matter } else { base.transfer.clone() },
            table: if own { None } else { base.table.clone() },
            sigma: self.sigma.map_or(base.sigma, |s| s.0),
            spacing: self.spacing.map(|s| s.0.to_array()).or(base.spacing),
            series: self.series.clone().or_else(|| base.series.clone()),
            channel: self.channel.clone().or_else(|| base.channel.clone()),
            frame: self.frame.or(base.frame),
        }
    }

    fn check(&self, path: &Path, base: &OpenOptions) -> Result<(), (&'static str, String)> {
        if self.window.is_some() && self.transfer.is_some() {
            return Err(("window", "a stack has either a window or a transfer function".into()));
        }
        let said = [
            ("scene", self.scene.is_some()),
            ("include", !self.include.is_empty()),
            ("exclude", !self.exclude.is_empty()),
            ("fill", self.fill.is_some()),
            ("line_width", self.line_width.is_some()),
            ("width_scale", self.width_scale.is_some()),
            ("section", self.section.is_some()),
            ("curve", self.curve.is_some()),
            ("iso", self.iso.is_some()),
            ("window", self.window.is_some()),
            ("transfer", self.transfer.is_some()),
            ("sigma", self.sigma.is_some()),
            ("spacing", self.spacing.is_some()),
            ("series", self.series.is_some()),
            ("channel", self.channel.is_some()),
            ("frame", self.frame.is_some()),
            ("iterations", self.iterations.is_some()),
            ("seed", self.seed.is_some()),
            ("angle", self.angle.is_some()),
            ("dialect", self.dialect.is_some()),
            ("name", self.name.is_some()),
        ];
        let lines = self.line_width.is_some() || base.trajectory.width.is_some();
        let wrong = |(key, said): (&'static str, bool)| {
            let of = unused_by(key, path, lines).filter(|_| said)?;
            Some((key, format!("{key} says how {of} are read; '{}' is none of them", self.file)))
        };
        said.into_iter().find_map(wrong).map_or(Ok(()), Err)
    }
}
