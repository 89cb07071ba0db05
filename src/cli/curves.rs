//! The options of sources that are curves.

use serde_json::{Value, json};

use super::clap_name::Name;
use super::quantity::positive;
use crate::source::curve::trajectory::TrajectoryOptions;
use crate::source::curve::{CurveOptions, Interpolation};
use crate::source::emitter::SectionKind;
use crate::source::mesh::Fill;

/// Degrees between the sheets of a V.
const V_ANGLE: f32 = 70.0;

/// How trajectories, hair, tracts and neurons are taken.
#[derive(clap::Args)]
#[command(next_help_heading = "Curves")]
pub struct CurveArgs {
    /// What is swept along curves of .csv, .tsv, .hair, .trk, .tck and .swc files
    #[arg(long, value_enum, default_value = "round")]
    section: SectionArg,
    /// What runs between the points of a curve
    #[arg(long, value_enum, default_value = "linear")]
    curve: CurveArg,
    /// Factor of all widths
    #[arg(long, default_value_t = 1.0, value_name = "X", value_parser = positive)]
    width_scale: f64,
    /// What the colours of a curve's points are
    #[arg(long, value_enum, default_value = "srgb")]
    curve_colours: ColourArg,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum SectionArg {
    Round,
    Flat,
    V,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum CurveArg {
    Linear,
    /// Centripetal
    CatmullRom,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum ColourArg {
    Srgb,
    Linear,
}

impl CurveArgs {
    pub fn options(&self, width: Option<f64>, fill: Fill) -> TrajectoryOptions {
        let kind = match self.section {
            SectionArg::Round => SectionKind::Round,
            SectionArg::Flat => SectionKind::Flat,
            SectionArg::V => SectionKind::V,
        };
        let interpolation = match self.curve {
            CurveArg::Linear => Interpolation::Linear,
            CurveArg::CatmullRom => Interpolation::CatmullRom,
        };
        TrajectoryOptions {
            section: kind.section(V_ANGLE, 0.0),
            curve: CurveOptions { interpolation, fill },
            width,
            width_scale: self.width_scale,
            linear_colour: matches!(self.curve_colours, ColourArg::Linear),
        }
    }

    /// Add to `out` what decides on the content.
    pub fn provenance(&self, out: &mut Value) {
        let choices: [(&str, &dyn Name, &str); 3] = [
            ("section", &self.section, "round"),
            ("curve", &self.curve, "linear"),
            ("curve_colours", &self.curve_colours, "srgb"),
        ];
        for (key, value, default) in choices {
            if value.name() != default {
                out[key] = json!(value.name());
            }
        }
        if self.width_scale != 1.0 {
            out["width_scale"] = self.width_scale.into();
        }
    }
}
