//! Options that lay colours, a material's name and translucency on a source, the same for every command that opens one to make
//! something of it.

use std::path::Path;

use serde_json::{Value, json};

use super::results::shown;
use crate::source::paint::Translucency;
use crate::source::recipe::PaintOptions;

/// What is laid on a source.
#[derive(clap::Args)]
#[command(next_help_heading = "Sources")]
pub struct PaintArgs {
    /// Lay a colour on all of it: '#rrggbb' or r,g,b (linear), a picture, a .toml file with the keys of a recipe's albedo, or
    /// these in braces: '{ noise = { scale = 2 }, colours = ["#553311", "#998866"] }'
    #[arg(long, value_name = "COLOUR|FILE|{TABLE}")]
    albedo: Option<String>,
    /// Multiply the source's own colours by --albedo, and don't replace them
    #[arg(long)]
    tint: bool,
    /// Call all of its matter by this name, and not as the source does
    #[arg(long, value_name = "NAME")]
    material: Option<String>,
    /// Share of the light that comes through, as through leaves (0.3 to 0.5), for sources that say nothing of it: of all, or of
    /// one material; may be given again
    #[arg(long, value_name = "SHARE|MATERIAL=SHARE", value_parser = translucency)]
    translucency: Vec<Translucency>,
}

/// A share of the light, of all or of one material.
fn translucency(text: &str) -> Result<Translucency, String> {
    let (material, share) = match text.rsplit_once('=') {
        Some((name, share)) => (Some(name.to_owned()), share),
        None => (None, text),
    };
    let share: f64 = share.trim().parse().map_err(|_| "a share such as 0.4 is needed, or MATERIAL=0.4")?;
    if !(0.0..=MAX_TRANSLUCENCY).contains(&share) {
        return Err(format!("a share of 0 to {MAX_TRANSLUCENCY} is needed"));
    }
    Ok(Translucency { material, share })
}

/// Matter that let all light through would have no colour.
const MAX_TRANSLUCENCY: f64 = 0.9;

impl PaintArgs {
    pub fn options(&self) -> PaintOptions {
        PaintOptions {
            albedo: self.albedo.clone(),
            tint: self.tint,
            material: self.material.clone(),
            translucency: self.translucency.clone(),
        }
    }

    /// The first option that was given, if any was.
    pub fn given(&self) -> Option<&'static str> {
        let all = [
            ("--albedo", self.albedo.is_some()),
            ("--tint", self.tint),
            ("--material", self.material.is_some()),
            ("--translucency", !self.translucency.is_empty()),
        ];
        all.into_iter().find(|(_, given)| *given).map(|(name, _)| name)
    }

    /// Add to `out` what decides on the content.
    pub fn provenance(&self, out: &mut Value) {
        // META holds no absolute path; what is in the file is among the sources.
        let kept =
            |v: &str| Path::new(v).file_name().filter(|_| Path::new(v).is_absolute()).map(|n| shown(Path::new(n)));
        self.albedo.iter().for_each(|v| out["albedo"] = kept(v).unwrap_or_else(|| v.clone()).into());
        if self.tint {
            out["tint"] = true.into();
        }
        self.material.iter().for_each(|v| out["material"] = v.as_str().into());
        if !self.translucency.is_empty() {
            let one = |t: &Translucency| json!({ "material": t.material, "share": t.share });
            out["translucency"] = self.translucency.iter().map(one).collect();
        }
    }
}
