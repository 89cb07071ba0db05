//! The options of L-systems.

use serde_json::Value;

use super::clap_name::Name;
use super::quantity::finite;
use crate::source::lsystem::{Dialect, LSystemOptions};

/// How an L-system is taken.
#[derive(clap::Args)]
#[command(next_help_heading = "L-systems")]
pub struct LSystemArgs {
    /// Derivation steps, instead of the grammar's
    #[arg(long, value_name = "N")]
    iterations: Option<u64>,
    /// Seed of what is drawn by lot, instead of the grammar's
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Degrees that the turtle turns by, instead of the grammar's
    #[arg(long, value_name = "DEGREES", allow_hyphen_values = true, value_parser = finite)]
    angle: Option<f64>,
    /// Draw this derived string, with the grammar's constants, colours and surfaces or without a grammar
    #[arg(long, value_name = "SYMBOLS", allow_hyphen_values = true, conflicts_with = "iterations")]
    string: Option<String>,
    /// Notation of the grammar, where the file does not make it certain
    #[arg(long, value_enum, value_name = "NOTATION")]
    dialect: Option<Dialect>,
    /// System to take of a file that has several (Fractint)
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    /// Symbols that may be rewritten before it is given up
    #[arg(long, value_name = "N", default_value_t = LSystemOptions::default().max_symbols)]
    max_symbols: u64,
}

impl LSystemArgs {
    pub fn options(&self) -> LSystemOptions {
        LSystemOptions {
            iterations: self.iterations,
            seed: self.seed,
            angle: self.angle,
            string: self.string.clone(),
            max_symbols: self.max_symbols,
            define: Default::default(),
            dialect: self.dialect,
            name: self.name.clone(),
        }
    }

    /// Add to `out` what decides on the content.
    pub fn provenance(&self, out: &mut Value) {
        self.iterations.into_iter().for_each(|v| out["iterations"] = v.into());
        self.seed.into_iter().for_each(|v| out["seed"] = v.into());
        self.angle.into_iter().for_each(|v| out["angle"] = v.into());
        self.dialect.into_iter().for_each(|v| out["dialect"] = v.name().into());
        self.name.iter().for_each(|v| out["name"] = v.as_str().into());
        self.string.iter().for_each(|v| out["string"] = v.as_str().into());
    }
}
