//! Curves of a quantity over the gain of a group's rates, through the values at three gains that were marched.
//!
//! Based on: F. Fritsch, J. Butland, *A Method for Constructing Local Monotone Piecewise Cubic Interpolants*, SIAM J. Sci. Stat.
//! Comput. 5(2), 1984 (the harmonic mean as the slope of a monotone interpolant).

use crate::geom::{larger, smaller};
use crate::volume::chord::{Lanes, ln};

/// Factors of the rates at which a group is marched: as they are, larger and smaller.
pub const GAINS: [f32; 3] = [1.0, TRIAL_GAIN, 1.0 / TRIAL_GAIN];
const TRIAL_GAIN: f32 = 1.5;
/// Logarithms of [`GAINS`], in units of ln [`TRIAL_GAIN`].
const GAIN_POSITIONS: [f32; 3] = [0.0, 1.0, -1.0];
/// Range of a correction of the rates, as a logarithm. Downward it ends at the gain that was marched, since below it opaque matter
/// loses opacity faster than the extrapolated curve does.
pub const MIN_LOG_GAIN: f32 = -0.4;
pub const MAX_LOG_GAIN: f32 = 0.9;

/// Quantity as a function of the gain: x is the gain's logarithm in units of ln [`TRIAL_GAIN`]. Two parabolas meet at x = 0 with
/// one slope and go on as straight lines beyond x = ±1; the curve is monotone where the values are.
pub struct GainCurve {
    middle: f32,
    pub slope: f32,
    /// Half of the second derivatives below and above 0.
    bend: [f32; 2],
    /// Slopes at and beyond −1 and 1.
    ends: [f32; 2],
}

/// Position x on gain curves, as the terms that it contributes to their polynomials.
pub struct CurvePosition {
    /// x within −1 … 1, and its square where it is below and above 0.
    inner: f32,
    below: f32,
    above: f32,
    /// Distance of x beyond −1 (negative) and beyond 1.
    lower: f32,
    higher: f32,
}

impl CurvePosition {
    #[inline(always)]
    fn new(x: f32) -> CurvePosition {
        let inner = x.clamp(-1.0, 1.0);
        let (below, above) = (smaller(inner, 0.0), larger(inner, 0.0));
        let (lower, higher) = (smaller(x + 1.0, 0.0), larger(x - 1.0, 0.0));
        CurvePosition { inner, below: below * below, above: above * above, lower, higher }
    }

    /// Positions of [`GAINS`] times e^`log_gain`.
    #[inline(always)]
    pub fn of_gains(log_gain: f32) -> [CurvePosition; GAINS.len()] {
        GAIN_POSITIONS.map(|position| CurvePosition::new(log_gain / ln(TRIAL_GAIN) + position))
    }
}

impl GainCurve {
    /// Curve through the values at [`GAINS`].
    #[inline(always)]
    pub fn new([as_is, up, down]: [f32; GAINS.len()]) -> GainCurve {
        let (below, above) = (as_is - down, up - as_is);
        let slope = if below * above > 0.0 { 2.0 * below * above / (below + above) } else { 0.0 };
        let bend = [slope - below, above - slope];
        GainCurve { middle: as_is, slope, bend, ends: [2.0 * below - slope, 2.0 * above - slope] }
    }

    /// Value at a position.
    #[inline(always)]
    pub fn value(&self, x: &CurvePosition) -> f32 {
        let bend = x.below * self.bend[0] + x.above * self.bend[1];
        let end = x.lower * self.ends[0] + x.higher * self.ends[1];
        self.middle + x.inner * self.slope + bend + end
    }

    /// Logarithm of the gain, within [`MIN_LOG_GAIN`] to [`MAX_LOG_GAIN`], at which an increasing curve has the value `want`.
    #[inline(always)]
    pub fn solve(&self, want: f32) -> f32 {
        let sign = if want < self.middle { -1.0 } else { 1.0 };
        let (change, half) = ((want - self.middle).abs(), usize::from(sign > 0.0));
        // Along the parabola as far as it goes, to the next gain that was marched; straight on from there.
        let bend = sign * self.bend[half];
        let whole = self.slope + bend;
        let x = if change > whole {
            1.0 + (change - whole) / larger(self.ends[half], 1e-20)
        } else {
            let root = larger(self.slope * self.slope + 4.0 * bend * change, 0.0).sqrt();
            2.0 * change / larger(self.slope + root, 1e-20)
        };
        (sign * x * ln(TRIAL_GAIN)).clamp(MIN_LOG_GAIN, MAX_LOG_GAIN)
    }
}

/// Weighted median of `values`; 0 where all weights are 0.
#[inline(always)]
pub fn weighted_median(values: &Lanes, weights: &Lanes) -> f32 {
    // For each value, the weight of all values up to it. Comparing all pairs needs no sorting and runs in SIMD lanes.
    let mut up_to = [0.0; 16];
    for (&value, &weight) in values.iter().zip(weights) {
        for k in 0..16 {
            up_to[k] += if value <= values[k] { weight } else { 0.0 };
        }
    }
    let half = 0.5 * weights.iter().sum::<f32>();
    let mut median = f32::INFINITY;
    for k in 0..16 {
        if weights[k] > 0.0 && up_to[k] >= half {
            median = smaller(median, values[k]);
        }
    }
    if median < f32::INFINITY { median } else { 0.0 }
}
