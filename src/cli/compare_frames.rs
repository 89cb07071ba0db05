//! `vtex compare` of two sequences: every frame against its reference, and how they change.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::frames;
use super::ui::put_json;
use crate::render::image_io::{self, Image};
use crate::render::metrics;
use crate::render::metrics::temporal::{Temporal, step};
use crate::{Error, Result};

/// What is found.
#[derive(Serialize)]
struct Found {
    frames: usize,
    /// Means over the frames.
    flip: f64,
    rmse: f64,
    bias: f64,
    temporal: Temporal,
}

/// The frames of `a` against those of `b`, both NAME.####.png or .exr, of the same numbers.
///
/// # Errors
/// `Input` where a frame is missing or broken, or the sequences are not of the same frames.
pub fn run(a: &Path, b: &Path, options: &metrics::Options, json: bool) -> Result<()> {
    let (a, b) = (frames::found(a)?, frames::found(b)?);
    let numbers = |list: &[(u32, PathBuf)]| list.iter().map(|f| f.0).collect::<Vec<_>>();
    if numbers(&a) != numbers(&b) {
        let range = |list: &[(u32, PathBuf)]| match list {
            [(first, _), .., (last, _)] => format!("{first} to {last}"),
            [(one, _)] => one.to_string(),
            [] => "none".into(),
        };
        return Err(Error::Options(format!("the frames {} are compared with {}", range(&a), range(&b))));
    }
    let (mut steps, mut before): (Vec<_>, Option<(Image, Image)>) = (Vec::new(), None);
    let (mut flip, mut rmse, mut bias) = (0.0, 0.0, 0.0);
    for ((_, a), (_, b)) in a.iter().zip(&b) {
        let (own, meant) = (image_io::read(a)?, image_io::read(b)?);
        let measured = metrics::compare(&own, &meant, options).map_err(|e| Error::input(a, "", e.to_string()))?.all;
        flip += measured.flip;
        rmse += measured.rmse;
        bias += measured.bias;
        if let Some((a0, b0)) = &before {
            steps.push(step([a0, &own], [b0, &meant]).map_err(|e| Error::input(a, "", e.to_string()))?);
        }
        before = Some((own, meant));
    }
    let count = a.len();
    let first = a.first().map_or(0, |f| f.0);
    let temporal = Temporal::of(steps);
    let temporal =
        temporal.ok_or_else(|| Error::Options("at least two frames are needed to see them change".into()))?;
    let n = count as f64;
    let found = Found { frames: count, flip: flip / n, rmse: rmse / n, bias: bias / n, temporal };
    if json {
        return put_json(&found);
    }
    let t = &found.temporal;
    let worst = first as usize + t.worst_step;
    outln!(
        "{count} frames; means: FLIP {:.5}, RMSE {:.6}, bias of luminance {:+.5}",
        found.flip,
        found.rmse,
        found.bias
    )?;
    outln!("temporal error    {:.6} (at most {:.6}, from frame {worst} to {})", t.error, t.worst, worst + 1)?;
    outln!("change a frame    {:.6} against {:.6}", t.change[0], t.change[1])?;
    outln!("pops              {:.4} % of the pixels a frame", 100.0 * t.pops)
}
