//! `vtex compare`: a picture against a reference.

use std::path::PathBuf;

use super::quantity::finite;
use super::results::print;
use super::{Ui, compare_frames, frames, outputs};
use crate::progress::Progress;
use crate::render::image_io;
use crate::render::image_io::srgb_decode;
use crate::render::metrics;
use crate::render::metrics::{Comparison, Measures, flip, picture};
use crate::render::reference::Reference;
use crate::{Error, Result, Warnings};

#[derive(clap::Args)]
pub struct Args {
    /// The picture: .png (sRGB) or .exr (linear); of two sequences, NAME.####.png or .exr, means and the temporal error
    a: PathBuf,
    /// The reference, of the same size
    b: PathBuf,
    /// Write the FLIP error in false colour (magma)
    #[arg(long, value_name = "PNG")]
    map: Option<PathBuf>,
    /// Write A, B and the error map side by side
    #[arg(long, value_name = "PNG")]
    sheet: Option<PathBuf>,
    /// Linear colour that pictures without alpha have where nothing is covered; measures what is covered apart
    #[arg(long, value_name = "R,G,B", value_parser = parse_colour)]
    background: Option<[f32; 3]>,
    /// Pixels per degree of visual angle, 1 to 1000
    #[arg(long, default_value_t = flip::DEFAULT_PPD, hide_default_value = true, value_parser = finite)]
    ppd: f64,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// `r,g,b`, or `#rrggbb` in sRGB, as linear values.
fn parse_colour(text: &str) -> std::result::Result<[f32; 3], String> {
    const WANTED: &str = "wanted r,g,b (linear) or #rrggbb (sRGB)";
    if let Some(hex) = text.strip_prefix('#') {
        if hex.len() != 6 || hex.starts_with('+') {
            return Err(WANTED.into());
        }
        let code = u32::from_str_radix(hex, 16).map_err(|_| WANTED)?;
        return Ok([16, 8, 0].map(|shift| srgb_decode((code >> shift & 0xff) as f32 / 255.0)));
    }
    let parts: Vec<f32> = text.split(',').map_while(|c| c.trim().parse().ok()).collect();
    match parts[..] {
        [r, g, b] if text.matches(',').count() == 2 && parts.iter().all(|c| c.is_finite()) => Ok([r, g, b]),
        _ => Err(WANTED.into()),
    }
}

pub fn run(args: &Args, ui: &Ui) -> Result<()> {
    let measured = metrics::Options { ppd: args.ppd, background: args.background };
    if frames::is_numbered(&args.a) && frames::is_numbered(&args.b) {
        if args.map.is_some() || args.sheet.is_some() {
            return Err(Error::Options("--map and --sheet are of one picture; name one frame of each".into()));
        }
        return compare_frames::run(&args.a, &args.b, &measured, args.json);
    }
    let pictures = [args.a.clone(), args.b.clone()];
    outputs::check(&pictures, [&args.map, &args.sheet].into_iter().filter_map(|path| path.as_deref()))?;
    let (a, b) = (image_io::read(&args.a)?, image_io::read(&args.b)?);
    if (a.width, a.height) != (b.width, b.height) {
        let (width, height, reference) = (b.width, b.height, args.b.display());
        let what = format!("{}×{}, but {reference} is {width}×{height}; render both at one size", a.width, a.height);
        return Err(Error::input(&args.a, "", what));
    }
    ui.stage("compare", 0);
    let comparison = metrics::compare(&a, &b, &measured)?;
    let mut warnings = Warnings::default();
    for (path, n) in [&args.a, &args.b].into_iter().zip(comparison.not_finite) {
        warnings.add_many(format!("{}: a pixel is not a finite number; taken for black", path.display()), n);
    }
    let noise = Reference::load(&args.b, None).and_then(|reference| reference.noise(args.ppd)).ok();
    ui.finish();
    let errors = picture::false_colour(&comparison.flip_map);
    if let Some(path) = &args.map {
        image_io::write_png(path, a.width, a.height, &errors)?;
    }
    if let Some(path) = &args.sheet {
        let (shown_a, shown_b) = (picture::display(&a), picture::display(&b));
        let (columns, sheet) = picture::side_by_side(a.width, &[&shown_a, &shown_b, &errors]);
        image_io::write_png(path, columns, a.height, &sheet)?;
    }
    ui.warn(&warnings)?;
    if args.json {
        let mut found = serde_json::json!(comparison);
        if let Some(noise) = &noise {
            found["reference_noise"] =
                serde_json::json!({ "rmse": 0.5 * noise.all.rmse, "flip_of_halves": noise.all.flip });
        }
        print(found, true, ui)
    } else {
        outln!("{} against {}, {}×{}", args.a.display(), args.b.display(), a.width, a.height)?;
        out!("{}", table(&comparison))?;
        if let Some(noise) = &noise {
            let (rmse, flip) = (0.5 * noise.all.rmse, noise.all.flip);
            outln!("noise of B        RMSE {rmse:.6}, FLIP {flip:.5} between its halves")?;
        }
        Ok(())
    }
}

/// One line a measure, one column a set of pixels.
fn table(c: &Comparison) -> String {
    let sets: Vec<&Measures> = std::iter::once(&c.all).chain(&c.covered).collect();
    let line = |name: &str, cell: &dyn Fn(&Measures) -> String| {
        let cells: String = sets.iter().map(|set| format!("{:>20}", cell(set))).collect();
        format!("{name:18}{cells}\n")
    };
    let heads = ["all pixels", "covered pixels"];
    let mut text = format!("{:18}", "");
    text.extend(heads.iter().take(sets.len()).map(|head| format!("{head:>20}")));
    text.push('\n');
    text += &line("pixels", &|m| m.pixels.to_string());
    text += &line("RMSE", &|m| format!("{:.6}", m.rmse));
    text += &line("relMSE", &|m| format!("{:.6}", m.rel_mse));
    text += &line("PSNR", &|m| format!("{:.2} dB", m.psnr));
    text += &line("PSNR of sRGB", &|m| format!("{:.2} dB", m.psnr_srgb));
    text += &line("FLIP", &|m| format!("{:.5}", m.flip));
    text += &line("bias of luminance", &|m| match m.relative_bias {
        Some(relative) => format!("{:+.5} ({:+.2} %)", m.bias, 100.0 * relative),
        None => format!("{:+.5}", m.bias),
    });
    if let Some(area) = c.area {
        let ratio = area.ratio.map_or(String::new(), |r| format!(", ratio {r:.4}"));
        text += &format!("covered area      {:.4} against {:.4}{ratio}\n", area.a, area.b);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_linear_triples_or_srgb_codes() {
        assert_eq!(parse_colour("0,0.5, 2"), Ok([0.0, 0.5, 2.0]));
        assert_eq!(parse_colour("#ff0000"), Ok([1.0, 0.0, 0.0]));
        for bad in ["", "1,2", "1,2,3,4", "1,x,3", "nan,0,0", "#12345", "#1234567", "#+12345"] {
            assert!(parse_colour(bad).is_err(), "{bad}");
        }
    }
}
