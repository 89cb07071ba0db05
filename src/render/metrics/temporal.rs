//! Temporal error of a sequence of frames against a reference: flicker, crawl and pops, which measures of single pictures do not show.
//!
//! The measure is our own: the mean change from frame to frame that the reference does not have. Correct motion does not count, and neither
//! does an error that stays the same.

use serde::Serialize;

use crate::render::image_io::{Image, srgb_encode};
use crate::{Error, Result};

/// Least change, without a like one in the reference, that counts as a pop: a tenth of the display's range.
const POP: f64 = 0.1;

/// Two successive frames of a sequence against those of a reference. Values are sRGB, clamped to [0, 1], all channels alike.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Step {
    /// Mean |(a₁ − a₀) − (b₁ − b₀)|.
    pub error: f64,
    /// Mean |a₁ − a₀| and mean |b₁ − b₀|.
    pub change: [f64; 2],
    /// Share of the pixels in which some channel's change differs by more than .1 from that of the reference.
    pub pops: f64,
}

/// All steps of a sequence.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Temporal {
    /// Mean of the steps' errors.
    pub error: f64,
    /// Largest error of a step.
    pub worst: f64,
    /// Index of the step with the largest error.
    pub worst_step: usize,
    /// Mean change per step of the pictures, and of the references.
    pub change: [f64; 2],
    /// Mean share of pixels that pop in a step.
    pub pops: f64,
    /// Each step in order.
    pub steps: Vec<Step>,
}

/// Compare the change from frame 0 to frame 1 in sequence `a` with that in the reference `b`.
///
/// # Errors
/// `Options` where the pictures differ in size.
pub fn step(a: [&Image; 2], b: [&Image; 2]) -> Result<Step> {
    let size = |i: &Image| (i.width, i.height);
    if [a[1], b[0], b[1]].iter().any(|i| size(i) != size(a[0])) {
        return Err(Error::Options("the frames differ in size; render all at one size".into()));
    }
    let (mut error, mut change, mut pops) = (0.0, [0.0; 2], 0u64);
    for i in 0..a[0].rgba.len() {
        let mut most = 0.0_f64;
        for k in 0..3 {
            let of = |image: &Image| f64::from(srgb_encode(image.rgba[i][k]));
            let (own, meant) = (of(a[1]) - of(a[0]), of(b[1]) - of(b[0]));
            let off = (own - meant).abs();
            error += off;
            change[0] += own.abs();
            change[1] += meant.abs();
            most = most.max(off);
        }
        pops += u64::from(most > POP);
    }
    let pixels = a[0].rgba.len().max(1) as f64;
    let mean = |sum: f64| sum / (3.0 * pixels);
    Ok(Step { error: mean(error), change: change.map(mean), pops: pops as f64 / pixels })
}

impl Temporal {
    /// The steps of a sequence together; `None` where there is none.
    pub fn of(steps: Vec<Step>) -> Option<Temporal> {
        let n = steps.len() as f64;
        let mean = |of: &dyn Fn(&Step) -> f64| steps.iter().map(of).sum::<f64>() / n;
        let worst_step = (0..steps.len()).reduce(|a, b| if steps[b].error > steps[a].error { b } else { a })?;
        Some(Temporal {
            error: mean(&|s| s.error),
            worst: steps[worst_step].error,
            worst_step,
            change: [mean(&|s| s.change[0]), mean(&|s| s.change[1])],
            pops: mean(&|s| s.pops),
            steps,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::image_io::srgb_decode;

    /// Four pixels of these sRGB greys.
    fn picture(greys: [f32; 4]) -> Image {
        let grey = |g: f32| [srgb_decode(g), srgb_decode(g), srgb_decode(g), 1.0];
        Image::from_fn(2, 2, |x, y| grey(greys[2 * y + x]))
    }

    #[test]
    fn only_changes_that_the_reference_does_not_have_count() {
        let (a0, a1) = (picture([0.2, 0.4, 0.6, 0.8]), picture([0.3, 0.4, 0.6, 0.3]));
        // Another offset, the same change in the first pixel, none in the last.
        let (b0, b1) = (picture([0.5, 0.1, 0.6, 0.8]), picture([0.6, 0.1, 0.6, 0.8]));
        let s = step([&a0, &a1], [&b0, &b1]).unwrap();
        // Encoding and decoding are off by roundings of single precision.
        assert!((s.error - 0.5 / 4.0).abs() < 1e-5, "{s:?}");
        assert!((s.change[0] - 0.6 / 4.0).abs() < 1e-5 && (s.change[1] - 0.1 / 4.0).abs() < 1e-5, "{s:?}");
        assert_eq!(s.pops, 0.25);
        assert_eq!(step([&a0, &a1], [&a0, &a1]).unwrap().error, 0.0);
        let all = Temporal::of(vec![step([&a0, &a0], [&a0, &a0]).unwrap(), s]).unwrap();
        assert!((all.error - 0.5 * s.error).abs() < 1e-12 && all.worst_step == 1 && all.worst == s.error);
        assert!(Temporal::of(vec![]).is_none());
        let other = Image::from_fn(1, 1, |_, _| [0.0; 4]);
        assert!(step([&a0, &a1], [&b0, &other]).is_err());
    }
}
