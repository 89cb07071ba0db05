//! The options of sources, the same for every command that opens one.

use serde_json::{Value, json};

use super::quantity::positive;
use crate::bake::{Fill, MeshOptions, OpenOptions};
use crate::scene::ReadOptions;

/// Bytes that a source may take as it is read where --memory says nothing: a file that lies of its size cannot take more.
const READ_BYTES: u64 = 2 << 30;

/// How a source is read; each kind of source has its own part.
#[derive(clap::Args)]
pub struct SourceArgs {
    /// What is within closed surfaces: nothing, or opaque matter (auto: in every component that closes)
    #[arg(long, value_enum, default_value = "auto")]
    fill: FillArg,
    /// Width of lines and points in source units; without it they are left out
    #[arg(long, value_name = "X", value_parser = positive)]
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
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum FillArg {
    Surface,
    Solid,
    Auto,
}

impl SourceArgs {
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
            mesh: MeshOptions { line_width: self.line_width, fill },
        }
    }

    /// Add to `out` what decides on the content.
    pub fn provenance(&self, out: &mut Value) {
        out["fill"] = json!(clap_name::Name::name(&self.fill));
        self.line_width.into_iter().for_each(|v| out["lineWidth"] = v.into());
        self.scene.iter().for_each(|v| out["scene"] = v.as_str().into());
        for (key, list) in [("include", &self.include), ("exclude", &self.exclude)] {
            if !list.is_empty() {
                out[key] = list.clone().into();
            }
        }
    }
}

pub mod clap_name {
    use clap::ValueEnum;

    /// The name of an argument's value, as it is typed.
    pub trait Name {
        fn name(&self) -> String;
    }

    impl<T: ValueEnum> Name for T {
        fn name(&self) -> String {
            self.to_possible_value().map(|v| v.get_name().to_owned()).unwrap_or_default()
        }
    }
}
